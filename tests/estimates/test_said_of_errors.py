"""What budgets, companions and price lists say, and what they do where companions fail."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.energy_norm import energy
from driver.energy_norm.bound import Estimate, _root, coupling
from driver.errors import InputError, NotConverged
from driver.estimates import alternatives, budget, budget_words
from driver.estimates.between_steps import Strides
from driver.estimates.budget import Part, mesh_knob
from driver.estimates.companions import UNLOOKED, Companions
from driver.estimates.levels import Levels
from driver.options import Settings
from driver.validity import soundness

UNITS = {"length": "mm", "stress": "MPa"}


# ------------------------------------------------------------------------------ words

@pytest.mark.parametrize("error, value, words", [
    (None, 3.0, "?"), (0, 3.0, "0"), (1e-9, 0.0, "1e-09"), (1e-6, 1.0, "<0.001 %"),
    (1e-5, -1.0, "0.001 %"), (0.00234, 1.0, "0.23 %"), (0.0234, -1.0, "2.3 %"),
    (0.234, 1.0, "23 %"), (2.34, 1.0, "234 %"),
    (269.28, 1.0, ">1000 %")])
def test_errors_are_read_as_parts_of_the_value(error, value, words):
    assert budget_words.share(error, value) == words


def test_the_budget_is_a_table():
    """A line a quantity, with parts of it by source; those that are zero have no parts."""
    errors = {"quantities": {
        "normal_resultant": {"value": 50.0, "mesh": 0.5, "solver": 0.0, "total": 0.5},
        "slip": {"value": 0.01, "mesh": None, "time": 1e-4, "total": None, "note": "why not"},
        "tangential_resultant": {"value": 1e-18, "mesh": 1e-19, "total": 1e-19}},
        "advice": "take more", "notes": ["a note"], "energy": {"reason": "a point load"}}
    head, force, slip, zero, why, *rest = budget_words.describe(errors, UNITS)
    assert head.split() == ["estimated", "errors", "value", "mesh", "time", "solver", "total"]
    assert force.split() == ["normal", "resultant", "[N/mm]", "50", "1.0", "%", "0", "1.0", "%"]
    assert slip.split() == ["slip", "[mm]", "0.01", "?", "1.0", "%", "?"]
    assert why == "?, slip: why not"
    assert zero.split() == ["tangential", "resultant", "[N/mm]", "about", "0", "within", "1e-19"]
    assert rest == ["take more", "a note", "no error in the energy norm: a point load"]
    assert len({len(line) for line in (head, force)}) == 1
    assert budget_words.describe({"energy": {}}, UNITS) == []
    head, force, *_ = budget_words.describe(errors, UNITS, 0.5)
    assert "estimated errors at time 0.5 " in head and len(head) == len(force)


def test_a_reason_of_several_unknown_errors_is_said_once():
    budget = {"slip": {"note": "coarse"}, "peak_pressure": {"note": "singular"},
              "normal_resultant": {}, "contact_length": {"note": "coarse"}}
    assert budget_words.unknown(budget) == ["?, slip, contact length: coarse",
                                            "?, peak pressure: singular"]
    assert budget_words.unknown(dict.fromkeys(budget, {"note": "coarse"})) == [
        "?, all of them: coarse"]


@pytest.mark.parametrize("boundaries, title, said", [
    (1, "normal resultant [N/mm]", []),
    (2, "normal resultant, sum of 2 [N/mm]", ["through both of them counts at each"]),
    (3, "normal resultant, sum of 3 [N/mm]", ["through several of them counts at each"])])
def test_resultants_of_several_boundaries_are_called_sums(boundaries, title, said):
    errors = {"quantities": {name: {"value": 2.0, "mesh": 0.1, "total": 0.1}
                             for name in ("slip", "normal_resultant")},
              "advice": "", "notes": [], "energy": {}}
    head, slip, force, *notes, _ = budget_words.describe(errors, UNITS, None, boundaries)
    assert force.startswith(f"{title} ") and slip.startswith("slip [mm] ")
    assert len(head) == len(slip) == len(force) and len(notes) == len(said)
    assert all(words in note for words, note in zip(said, notes))
    assert budget_words.of_sums(["displacement"], boundaries) == []


@pytest.mark.parametrize("time, end, said", [
    (1.0, 2.0, 1.0), (2.0, 2.0, None), (None, 2.0, None), (2.0 - 1e-15, 2.0, None)])
def test_the_time_of_the_quantities_is_said_where_it_is_not_the_end(time, end, said):
    summary = {"t_end": end} | ({} if time is None else {"quantities_time": time})
    assert budget_words.earlier(summary) == said


def test_the_error_in_the_energy_norm_in_words():
    entry = {"kind": "equilibrated", "mesh": 0.1, "solver": 0.0, "friction": 0.02,
             "correction": 0.01, "total": 0.15, "norm": 1.0, "coupling": 0.03,
             "excluded": ["curved boundaries"]}
    first, beside, left = budget_words.describe_energy(entry)
    assert "at most 15 % (mesh 10 %, solver 0, friction 2.0 %, correction 1.0 %)" in first
    assert beside == "in addition, in the energy norm: Coulomb's law about 3.0 %"
    _, beside, _ = budget_words.describe_energy({**entry, "coupling": 9.6})  # digits of nothing
    assert beside == "in addition, in the energy norm: Coulomb's law more than 100 %"
    assert left == "not included: curved boundaries"
    smoothed = budget_words.describe_energy({**entry, "kind": "recovery", "coupling": 0.0,
                                             "time": 0.04, "excluded": []})
    assert "about 1" in smoothed[0] and smoothed[0].endswith("from smoothed stresses, not a bound")
    assert smoothed[1:] == ["in addition, in the energy norm: time steps about 4.0 %"]


@pytest.mark.parametrize("parts, words", [
    ({"mesh": 0.3, "time": 0.1, "total": 0.4, "relative": 0.1},
     "75 % of the error of the normal resultant is due to the mesh: H=1 would lower it"),
    ({"mesh": 0.1, "time": 0.3, "total": 0.4, "relative": 0.1},
     "75 % of the error of the normal resultant is due to the time step: STEPS=9 would lower it"),
    ({"mesh": 1e-7, "time": 0.0, "total": 1e-7, "relative": 1e-7},
     "the normal resultant needs no finer settings"),
    ({"mesh": None, "time": None, "total": None, "relative": None},
     "the error of the normal resultant from mesh and time step is not known")])
def test_advice_is_of_the_largest_part(parts, words):
    remedies = {"mesh": "H=1", "time": "STEPS=9"}
    both = {"displacement": {}, "normal_resultant": parts}
    assert budget_words.advice(both, remedies) == words
    assert budget_words.advice(both, remedies, {"time"}) == words.replace("9 would", "9 may")


def test_advice_is_not_of_a_resultant_that_is_rounding():
    """Of contact that pulls as it presses: whose errors are all of it."""
    entry = {"mesh": 0.1, "total": 0.1, "relative": 0.1}
    budget_of = {"displacement": entry | {"value": 1.0}, "peak_pressure": entry | {"value": 0.8},
                 "contact_length": entry | {"value": 40.0},
                 "normal_resultant": entry | {"value": 1e-13}}
    assert "displacement" in budget_words.advice(budget_of, {"mesh": "H=1"})
    budget_of["normal_resultant"] = entry | {"value": 3.0}
    assert "normal resultant" in budget_words.advice(budget_of, {"mesh": "H=1"})


# ------------------------------------------------------------------------------ energy

def test_roots_of_the_bound():
    """x^2 = sqrt(square) x + gap."""
    for square, gap in ((4.0, 3.0), (0.0, 9.0), (4.0, 0.0)):
        x = _root(square, gap)
        assert x**2 == pytest.approx(np.sqrt(square) * x + gap) and x > 0
    assert coupling(2.0, 0.5) == 2.0 and coupling(2.0, np.nan) == 0.0
    assert coupling(2.0, 1.5) == pytest.approx(2.0 * 99)


def test_entries_of_the_summary():
    """The last step, that with most energy, and what the estimate does not say."""
    one = Estimate(4, mesh=0.25, solver=0.5, friction=0.125, correction=0.0625, total=1.0,
                   coupling=2.0, norm=4.0)
    found = energy.report([(None, one), (None, Estimate(2, reason="why"))], "equilibrated",
                          ["this"])
    assert found == {"kind": "equilibrated", "step": 4, "mesh": 0.25, "solver": 0.5,
                     "friction": 0.125, "correction": 0.0625, "total": 1.0, "coupling": 2.0,
                     "norm": 4.0, "relative": 0.25, "largest": {"step": 2, "reason": "why"},
                     "excluded": ["this"]}
    smoothed = energy.report([(None, Estimate(1))], "recovery", ["this"], "a law")
    assert smoothed["relative"] == 0.0 and smoothed["why"].endswith("not a bound: a law")
    assert energy.report([], "none") == {"kind": "none"}


@pytest.mark.parametrize("work, norms, expected", [
    ({"time": 0.08, "value": 1.0}, (2.0, 1.0), 0.4),
    ({"time": 0.08, "value": 1.0}, (1.0, 2.0), 0.4),
    ({"time": 0.08, "value": 3.0}, (2.0, 1.0), None), ({"time": None, "value": 1.0}, (2.0,), None),
    ({}, (2.0,), None)])
def test_steps_in_the_energy_norm(work, norms, expected):
    """Half the square of the difference is what dissipated energies differ by; not beyond what the
    bodies store.
    """
    entry = {"norm": norms[0], **({"largest": {"norm": norms[1]}} if len(norms) > 1 else {})}
    found = energy.of_time({"dissipated_energy": work} if work else {}, entry)
    assert found == ({} if expected is None else {"time": pytest.approx(expected)})


def test_which_steps_are_estimated():
    """The last one and that with most energy; not a last one that is unloaded, nor one twice."""
    of = object.__new__(energy.EnergyEstimator)
    steps = [SimpleNamespace(index=k) for k in range(4)]
    of.kind, of.operator = "recovery", SimpleNamespace(comm=SimpleNamespace(bcast=lambda e: e))
    of._estimate, of.contact = lambda step, state: step.index, SimpleNamespace(boundary=None)
    for last, largest, expected in ((1.0, 2.0, [3, 1]), (1e-13, 2.0, [1]), (2.0, None, [3])):
        of.last, of.largest = (last, steps[3], {}), (largest, steps[1], {})
        of.carrying = of.largest  # contact carries nothing
        if largest is None:
            of.largest = of.last
        assert [e for _, e in of.estimates()] == expected
        assert {step.index for step, _ in of.considered} == {3, 3 if largest is None else 1}
    of.kind = "none"
    assert of.estimates() == []


@pytest.mark.parametrize("bilateral, changes", [
    ([1, 1, 0, 0, 1, 1], False), ([1, 0, 0, 0, 1, 1], True), ([1, 1, 0, 0, 1, 0], True),
    ([1, 1, 0, 1, 1, 1], True), ([0, 0, 1, 1, 0, 0], False)])
def test_whether_bilateral_contact_goes_on_as_unilateral(bilateral, changes):
    """Along an edge of a rigid obstacle, or on one of the boundaries that meet another body."""
    of = object.__new__(energy.EnergyEstimator)
    b = SimpleNamespace(edges=np.array([[0, 1], [1, 9]]), family=np.array([0, 0, 1, 1, 2, 2]),
                        meeting=["one", "two"])
    of.contact = SimpleNamespace(boundary=b, law=SimpleNamespace(bilateral=np.array(bilateral) > 0))
    assert of._changes_kind() == changes


# ------------------------------------------------------------------------------ companions

def companions(fails=(), finer=1, **more) -> Companions:
    """Those of a run whose quantity errs by 0.1 a mesh and 0.01 a stride, `finer` times that where
    times are not sampled; `fails`: meshes.
    """
    of = object.__new__(Companions)

    def run(settings, stride=1, plan=None, **mesh):
        if mesh.get("h") in fails or ("fine" in fails and "sampling" in mesh):
            raise NotConverged(f"no solution at {mesh}")
        shorter = 0.5 if plan else 0.0
        errs = 0.1 * mesh.get("h", 0) + 0.01 * stride * (1 if "sampling" in mesh else finer)
        return SimpleNamespace(values={"slip": 1 + errs + shorter},
                               touch=SimpleNamespace(nodes=9))

    def problem(**mesh):
        if "fine" in fails:
            raise InputError("too many")

    of.levels = SimpleNamespace(run=run, problem=problem, refined=())
    of.settings, of.notes, of.values = Settings(), [], {"slip": 1.01}
    of.base, of.manifest = {"h": 1}, SimpleNamespace(steps=2, element="P1", between={})
    of.knob, of.jumps, of.summed = "h", None, {}
    of.strides = Strides(None, of.manifest, None)
    vars(of).update(more)
    return of


def test_a_companion_that_fails_is_noted_unless_nobody_asked():
    of = companions(fails=(2,))
    assert of._values({"h": 2}) is None and of.level({"h": 2}, quiet=True) is None
    assert of.notes == ["companion H=2: no solution at {'h': 2}"]
    assert of._values({"h": 1}, 2) == {"slip": pytest.approx(1.12)}


def test_more_steps_tell_where_there_are_few():
    """Four times as many: their distance from the run's, and their own error."""
    found = companions(finer=4)._more_time()["slip"]
    assert found.error > 0.03 and found.error < 0.1
    for failing in (companions(fails=("fine",)), companions(fails=(1,))):
        part = failing._more_time()["slip"]
        assert part.error is None and part.note


def test_more_steps_are_not_run_where_no_total_can_come_of_them():
    """No part of the mesh is known: a note says so, and nothing is solved."""
    of = companions(effects=SimpleNamespace(frictional=True))
    of.levels.run = of.levels.problem = None
    assert of._time(wanted=False)["slip"] == Part(None)
    assert of.notes == [UNLOOKED]


@pytest.mark.parametrize("element, coarse, said", [
    ("P1", 0.4, True), ("P1", 0.9, False), ("P1", 1.6, False), ("P2", 0.4, False)])
def test_linear_triangles_that_may_be_too_stiff_are_named(element, coarse, said):
    """Where the displacement grows much from the next coarser mesh to that of the run."""
    of = companions(meshes=[{}, {"h": 2.0}], values={"displacement": 1.0})
    of.manifest.element, of._values = element, lambda mesh: {"displacement": coarse}
    assert ["ELEMENT=P2" in line for line in of._stiff()] == [True] * said


@pytest.mark.parametrize("coarse, force, said", [
    (1.0, 2.0, True), (1.0, 1.1, False), (1.0, 0.5, False), (0.9, 2.0, False)])
def test_linear_triangles_that_prescribed_displacements_bend_are_named_by_the_force(
        coarse, force, said):
    """Which falls much from the next coarser mesh, on which supports move as much."""
    of = companions(meshes=[{}, {"h": 2.0}],
                    values={"displacement": 1.0, "normal_resultant": 1.0})
    of._values = lambda mesh: {"displacement": coarse, "normal_resultant": force}
    assert ["fell by 100 %" in line for line in of._stiff()] == [True] * said


def test_what_is_zero_but_for_tolerances():
    """Shear, slip and work beside force and displacement, or beside errors of their own size."""
    values = {"normal_resultant": 2.0, "displacement": 0.5, "tangential_resultant": 1e-7,
              "slip": 1e-3, "dissipated_energy": 1e-5, "worn_volume": 1.0}
    assert budget.vanishing(values) == {"tangential_resultant"}
    errors = {"slip": 1e-2, "dissipated_energy": 2e-5}
    assert budget.vanishing(values, errors) == {"tangential_resultant", "dissipated_energy"}
    assert "slip" in budget.vanishing(values | {"slip": 4e-4}, errors)
    assert budget.vanishing(values | {"slip": 1e-8}) >= {"slip", "worn_volume"}
    assert budget.vanishing({"displacement": 1.0}) == set()
    # of bilateral contact, in which pulling and pressing may cancel
    pulled = {"normal_resultant": -1e-13, "peak_pressure": 0.8, "contact_length": 40.0}
    assert budget.vanishing(pulled) == {"normal_resultant"}
    assert not budget.vanishing(pulled | {"normal_resultant": 1e-3})
    assert not budget.vanishing(dict.fromkeys(pulled, 0.0))  # nothing touches


def test_jumps_half_as_long_tell_what_jumps_leave():
    of = companions(jumps=[0, 9, 0])
    of._values = lambda mesh: {"slip": 1.0}
    found = of._jumps()["slip"]
    assert found.error is not None and found.error > 0
    of.summed = {"slip": [3.0, 2.0, 1.5], "dissipated_energy": [0.0, 0.0, 9.0]}
    assert of._jumps()["slip"].error == 9 * 0.5 / (1 - 0.5)  # which the companion does not see


def test_the_run_itself_is_not_repeated():
    """Where its quantities are asked for; in other steps, or with other tolerances, it is run."""
    of, asked = companions(), []
    of.levels.run = lambda settings, stride, plan: asked.append(stride) or SimpleNamespace(
        values={"slip": 2.0})
    assert of._values({}) == {"slip": 1.01} and not asked
    assert of._values({}, 2) == of._values({}, 1, Settings(rtol=1e-10)) == {"slip": 2.0}
    assert asked == [2, 1]


def test_where_tolerances_cannot_be_tightened_residuals_stay():
    """Tighter QPs with the residuals of the run, where rounding lets no tighter ones be."""
    of, asked = companions(), []

    def run(settings, stride, plan=None, **mesh):
        asked.append(settings.primal_rtol)
        if settings.primal_rtol < 1e-6:
            raise NotConverged("rounding")
        return SimpleNamespace(values={"slip": settings.rtol})

    of.levels.run, of.settings = run, Settings(primal_rtol=1e-5)
    assert of._settled(1, Settings(rtol=1e-9, primal_rtol=1e-8)) == {"slip": 1e-9}
    assert asked == [1e-8, 1e-5]
    of.ratios = [2.0]
    of._values = lambda *_: None
    found = of._algebraic({}, {"primal_rtol": 1e-8})["slip"]
    assert found.error is None and "tighter tolerances failed" in found.note


def test_where_fewer_steps_have_no_solution_tolerances_are_told_by_those_of_the_run():
    """As where they miss the load that clamps a body; what failed on the way is no note then."""
    of, asked = companions(), []

    def run(settings, stride, plan=None, **mesh):
        asked.append(stride)
        if stride > 1:
            raise NotConverged("free to move off")
        return SimpleNamespace(values={"slip": settings.rtol})

    of.levels.run, of.manifest.steps, of.ratios, of.given = run, 8, [2.0], set()
    found = of._algebraic({}, {"rtol": 1e-10})["slip"]
    assert found.error == pytest.approx(2 * 2.0 * (Settings().rtol - 1e-10))
    assert 4 in asked and asked[-2:] == [1, 1] and not of.notes


def test_notes_of_companions_say_in_which_steps_and_with_which_tolerances_they_were_run():
    of = companions(fails=(1, 2, 4))
    of._values({"h": 2}, 4)
    of._values({"h": 2}, 2, of.settings)
    of._values({"h": 2}, 1, Settings(rtol=1e-10))
    assert [note.split(":")[0] for note in of.notes] == [
        "companion H=2 in every fourth step", "companion H=2 in every second step",
        "companion H=2 with tighter tolerances"]


def test_a_run_that_failed_is_not_tried_again():
    levels, tried = object.__new__(Levels), []
    levels.runs, levels.plan = {}, None
    levels.problem = lambda **changes: tried.append(changes)

    def failing(*_):
        raise NotConverged("once")

    levels._run = failing
    for _ in range(2):
        with pytest.raises(NotConverged, match="once"):
            levels.run(Settings(), 2, h=1)
    assert len(tried) == 1
    levels._run = lambda *given: given
    assert levels.run(Settings(), 1, h=1)[2:] == (1, None)
    assert levels.run(Settings(), 1, [3], h=1)[3] == [3] and len(tried) == 3


@pytest.mark.parametrize("sizes, meshes, ratios, note", [
    ({"h": 1.0}, [{}, {"h": 2.0}, {"h": 4.0}], [2.0, 2.0], ""),
    ({"cells": 8}, [{}, {"cells": 4}, {"cells": 2}], [2.0, 2.0], ""),
    ({"cells": 3}, [{}, {"cells": 2}, {"cells": 1}], [1.5, 2.0], ""),
    ({"remesh": 1.0, "h": 3.0}, [{}, {"remesh": 2.0}, {"remesh": 4.0}], [2.0, 2.0], ""),
    ({"cells": 1}, [{}], [], "no coarser mesh than CELLS=1")])
def test_coarser_meshes_as_far_as_there_are_such(sizes, meshes, ratios, note):
    of = companions()
    of.knob, of.manifest.parameters = mesh_knob(sizes), sizes
    of.levels.refines = lambda fine, coarse: True
    assert of._uniform() == (meshes, pytest.approx(ratios))
    assert note in " ".join(of.notes) and bool(note) == bool(of.notes)


def test_meshes_that_are_refused_end_the_sequence():
    of = companions()

    def problem(**mesh):
        if mesh["h"] > 2:
            raise InputError("one line")

    of.levels.problem, of.manifest.parameters = problem, {"h": 1.0}
    of.levels.refines = lambda fine, coarse: True
    assert of._uniform() == ([{}, {"h": 2.0}], [2.0])
    assert of.notes == ["companion H=4: one line"]


# ------------------------------------------------------------------------------ prices

@pytest.mark.parametrize("entry, reason", [
    ({"value": 1.0, "total": None}, "is not known"),
    ({"value": 1e-20, "total": 1e-20}, "is zero but for its error"),
    ({"value": 1.0, "total": 0.1}, "could not be predicted: too bad")])
def test_why_there_are_no_prices(monkeypatch, entry, reason):
    def predicted(*_):
        raise NotConverged("too bad")

    monkeypatch.setattr(alternatives, "_predicted", predicted)
    of = SimpleNamespace()
    whole = {"slip": entry, "normal_resultant": {"value": 2.0, "total": 0.1},
             "displacement": {"value": 2.0, "total": 0.1}}
    found = alternatives.price_list(of, {}, whole, "slip", None, 1.0)
    assert reason in found["reason"] and found["quantity"] == "slip" and found["lines"] == []
    monkeypatch.setattr(alternatives, "_predicted", lambda *given: list(given[2:4]))
    unnamed = alternatives.price_list(of, {}, whole, "", None, 1.0)
    first = "slip" if reason.startswith("could") else "normal_resultant"
    assert unnamed["quantity"] == first and unnamed["lines"] == [first, whole[first]["value"]]


@pytest.mark.parametrize("error, first", [(1e-6, "displacement"), (1e-3, "normal_resultant")])
def test_prices_are_not_those_of_a_force_that_loads_give(monkeypatch, error, first):
    monkeypatch.setattr(alternatives, "_predicted", lambda *_: [])
    names = ("normal_resultant", "displacement")
    whole = {name: {"value": 2.0, "total": 0.1} for name in names}
    parts = {"mesh": {"normal_resultant": Part(error), "displacement": Part(0.1)}}
    for budget_, name in ((whole, first), ({names[0]: whole[names[0]]}, names[0])):
        found = alternatives.price_list(SimpleNamespace(), parts, budget_, "", None, 1.0)
        assert found["quantity"] == name


def test_prices_are_not_those_of_what_is_exact(monkeypatch):
    """Contact all along a boundary has no error; where nothing has one the first is named."""
    monkeypatch.setattr(alternatives, "_predicted", lambda *_: [])
    exact = {"contact_length": {"value": 2.0, "total": 0.0}}
    for budget_, name in ((exact | {"slip": {"value": 2.0, "total": 0.1}}, "slip"),
                          (exact, "contact_length")):
        found = alternatives.price_list(SimpleNamespace(), {}, budget_, "", None, 1.0)
        assert found["quantity"] == name


def test_prices_are_not_said_of_what_is_not_there():
    """Where no error is known it was the wear of a lining that does not wear, "but for its error".
    """
    unknown, nothing = {"value": 2.0, "total": None}, {"value": 0.0, "total": 0.0}
    for budget_, reason in (
            ({"normal_resultant": unknown, "worn_volume": nothing},
             "the error of the normal resultant is not known"),
            ({"worn_volume": nothing}, "the worn volume is zero")):
        found = alternatives.price_list(SimpleNamespace(), {}, budget_, "", None, 1.0)
        assert found["reason"] == reason


def test_errors_of_coarser_meshes_add_up_to_one_that_failed():
    """The run's, and the distance from mesh to mesh in the same steps."""
    of = object.__new__(alternatives.Alternatives)
    of.name, of.mesh = "slip", Part(0.5)
    values = {(2.0, 1): 1.25, (4.0, 2): 2.0, (2.0, 2): 1.5}

    def level(mesh, stride=1):
        value = values.get((mesh["h"], stride))  # the run itself is not run again
        return value and SimpleNamespace(values={"slip": value})

    of.companions = SimpleNamespace(meshes=[{}, {"h": 2.0}, {"h": 4.0}], level=level,
                                    values={"slip": 1.0},
                                    strides=SimpleNamespace(of_coarse_meshes=2))
    assert of._errors() == pytest.approx([0.5, 0.75, 1.25])
    del values[4.0, 2]
    assert of._errors() == pytest.approx([0.5, 0.75])


@pytest.mark.parametrize("revolved", [False, True])
def test_pressure_and_shear_of_a_uniform_strain(revolved):
    """By the tensors: p = lambda tr(e) and s : s of 2 mu dev(e); round an axis u_r / r is a strain.
    """
    a, b, c, d = 0.3, -0.2, 0.5, 0.1  # u = (a x + b y, c x + d y), without shear round an axis
    if revolved:
        b = c = 0.0
    xy = np.array([[1.0, 0.0], [2.0, 0.2], [1.2, 1.5]])
    law = np.diag([5.0, 5.0, 1.5]) + 2.0 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]])
    triangle = np.array([[0, 1, 2]])
    sub = SimpleNamespace(corner=xy[None], elements=triangle, triangles=triangle, curved=False,
                          elasticity=law[None], axisymmetric=revolved, node_gid=np.arange(3))
    vertex, area, lam, mu, stress = soundness._stresses(
        sub, np.array([0]), (xy @ [[a, c], [b, d]]).ravel())
    strain = np.array([[a, (b + c) / 2, 0], [(b + c) / 2, d, 0], [0, 0, a if revolved else 0]])
    assert (lam, mu) == (2.0, 1.5) and vertex.tolist() == [[0, 1, 2]]
    assert area == pytest.approx(np.cross(xy[1] - xy[0], xy[2] - xy[0]) / 2)
    np.testing.assert_allclose(stress[..., 0], 2.0 * np.trace(strain))
    shear = 2 * 1.5 * (strain - np.trace(strain) / 3 * np.eye(3))
    np.testing.assert_allclose((stress[..., 1:] ** 2).sum(axis=-1), (shear**2).sum())


@pytest.mark.slow
def test_equal_meshes_tell_no_error(solved, named_scene):
    """Of a scene that limits its element size: what coarser sizes do not change is not certain."""
    path = named_scene("limited", """include "scene.idp"
real asked = meshSize(0.25), h = min(asked, 0.25);
units("mm", "MPa");
int n = rint(1./h);
body = square(2*n, n, [2.*x, y]);
macro young() 1000. //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 0., u2 = -0.01) //
macro contact() 1 //
macro friction() 0.3 //
include "export.idp"
""")
    errors = solved(path, errors="yes").summary["errors"]
    assert all(entry["mesh"] is None for entry in errors["quantities"].values())
    assert ("companion H=0.5 has no fewer triangles, or no fewer sides in contact, than H=0.25"
            in errors["notes"])
    finer = solved(path, errors="yes", h=0.125).summary["errors"]["quantities"]
    assert finer["normal_resultant"]["mesh"] > 0  # of two meshes


@pytest.mark.slow
def test_forces_beside_a_place_held_inside_an_obstacle_have_no_error(solved, named_scene):
    """A wall moves into a side whose upper end the support holds: the displacement jumps there."""
    text = """include "scene.idp"
units("mm", "MPa");
rectangle(0., 2., 0., 1.);
quasistatic(1.);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 2 //
macro obstacleX(t) (-0.02*t) //
macro friction() 0.3 //
include "export.idp"
"""
    run = solved(named_scene("wall", text), errors="yes", cells=8, steps=2)
    errors = run.summary["errors"]["quantities"]
    assert {name for name, entry in errors.items() if entry["total"] is None} >= {
        "peak_pressure", "normal_resultant", "tangential_resultant"}
    assert ("a support holds the boundary 2 at (2, 1) inside the obstacle or other body, by 0.02 "
            "in step 2" in " ".join(run.summary["warnings"]))
    along = text.replace("macro support()", "macro displacement1()").replace(
        "u1 = 0., u2 = 0.", "u1 = -0.02, u2 = 0.")
    moved = solved(named_scene("moved", along), errors="yes", cells=4, steps=2)
    assert "a support holds" not in " ".join(moved.summary["warnings"])


@pytest.mark.slow
def test_forces_beside_a_place_of_a_pair_held_inside_the_other_body_have_no_error(
        solved, named_scene):
    """A wall leans on a block whose lower end is clamped: without a condition there it goes on into
    the block by less and less, so that forces tend to those of the pair that the wall is first in.
    """
    text = """include "scene.idp"
units("mm", "MPa");
int[int] b = [11, 12, 13, 14], w = [1, 2, 3, 4];
addBody(square(6, 6, [4.*x, 4.*y], label = b))
addBody(square(2, 9, [-1. + x, -2. + 6.*y], label = w))
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(11, u1 = 0., u2 = 0.) + on(1, u1 = 0., u2 = 0.) //
macro load1() traction(4, 5., 0.) //
macro contactPair() {pair} //
include "export.idp"
"""
    pairs = {first: text.replace("{pair}", f"{first}, {16 - first}") for first in (14, 2)}
    block, wall = (solved(named_scene(f"first{first}", scene), errors="yes", element="P2")
                   for first, scene in pairs.items())
    forces = [run.summary["errors"]["quantities"]["normal_resultant"] for run in (block, wall)]
    assert forces[0]["total"] is None and forces[1]["total"] > 0
    said = [" ".join(run.summary["warnings"]) for run in (block, wall)]
    assert "a support holds the boundary 14 at (0, 0) inside the obstacle or" in said[0]
    assert "or name 2 first in the pair" in said[0] and "a support holds" not in said[1]


@pytest.mark.slow
def test_a_round_boundary_in_contact_as_a_whole_is_as_long_as_its_polygon(solved, named_scene):
    """A hole around a pin that is too large: what the sides lack of the circle is in the claim."""
    path = named_scene("hole", """include "scene.idp"
real h = meshSize(0.5);
border outer(s = 0, 2*pi) {x = 3*cos(s); y = 3*sin(s); label = 2;}
border inner(s = 2*pi, 0) {x = cos(s); y = sin(s); label = 1;}
body = buildmesh(outer(rint(18/h)) + inner(rint(12/h)));
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(2, u1 = 0., u2 = 0.) //
macro contact() 1 //
macro obstacle(x, y) (sqrt((x)^2 + (y)^2) - 1.002) //
include "export.idp"
""")
    entry = solved(path, errors="yes").summary["errors"]["quantities"]["contact_length"]
    true = 2 * np.pi - entry["value"]
    assert true > 0.01 and true < entry["total"] < 4 * true


ONE = """include "scene.idp"
body = square(2, 2, [2*x, y]);
bodyMaterial("block", 1000., 0.3);
macro support() on(4, u1 = 0., u2 = 0.) + on(2, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0.5, -10.) //
macro contact() 1 //
include "export.idp"
"""


def test_a_boundary_with_one_node_is_claimed_as_others_are(solved, named_scene):
    """One place tells no line, and no curve."""
    run = solved(str(named_scene("one", ONE)), ERRORS="yes")
    assert len(run.contact["x"][-1]) == 1 and "normal_resultant" in run.summary["errors"][
        "quantities"]
    assert not any("could be estimated" in line for line in run.summary["warnings"])
