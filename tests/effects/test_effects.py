"""What a scene does not declare costs nothing; the ledger; the study that leaves effects out."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import constants
import numpy as np
import pytest

from driver import effects as effects_of
from driver.effects import Effects, LoadEffect, RunFacts, slip_law
from driver.effects import curved as curved_sides, initial_state
from driver.effects.quasistatic import proportional
from driver.errors import InputError
from driver.files import read_rows
from driver.results import ledger
from driver.runs.guard import STUDY
from driver.runs.outcome import never_mattered
from driver.scene import freefem
from driver.scene.manifest import read_manifest
from driver.studies import effects

MODEL = freefem.find_scene("model")


def stripped(tmp_path, text, name="scene"):
    path = tmp_path / f"{name}.edp"
    path.write_text(text)
    return path


# ---- sizes and counts: an effect that is off costs nothing ---------------------------------------

def test_without_friction(solved):
    run = solved("model", WITHOUT="friction", STEPS=5)
    sizes, counts = run.summary["sizes"], run.summary["counts"]
    assert run.summary["effects"]["friction"] == "none"
    assert sizes["dual_tangential"] == 0 and sizes["dual_normal"] == sizes["contact_nodes"] == 40
    assert sizes["dual_dofs"] == sizes["dual_gluing"] + sizes["dual_normal"]
    assert counts["fixed_point_iterations"] == run.summary["steps"] == 5  # one QP a step
    assert {row["iteration"] for row in read_rows(run.directory / "convergence.csv")} == {"1"}
    assert not run.contact["sigma_t"].any() and not run.contact["bound"].any()


def test_without_contact(solved):
    run = solved("model", WITHOUT="contact", STEPS=5)
    sizes, counts = run.summary["sizes"], run.summary["counts"]
    assert run.summary["effects"]["contact"] == run.summary["effects"]["friction"] == "none"
    assert sizes["dual_normal"] == sizes["dual_tangential"] == sizes["contact_nodes"] == 0
    assert not (run.directory / "contact.csv").exists()
    assert counts["expansion_steps"] == counts["proportioning_steps"] == 0
    assert {row["kind"] for row in read_rows(run.directory / "convergence.csv")} <= {"start", "cg"}
    # preconditioned CG on the gluing alone: kappa <= 5 needs 1/2 sqrt(5) ln(2e6) = 16 products,
    # plus the residual's
    assert counts["dual_multiplications"] <= 5 * 18


def test_what_is_declared_is_named_in_the_summary():
    """By what it is, or by true: nothing that is declared is said to be absent."""
    rooms = [importlib.import_module(f"driver.effects.{path.stem}").Room
             for path in Path(effects_of.__file__).parent.glob("[a-z]*.py")
             if "class Room" in path.read_text()]
    assert len(rooms) > 20
    assert all(all(room.summary.values()) for room in rooms)


@pytest.mark.parametrize("curved, active", [({"labels": [2]}, True), (None, False)])
def test_sides_are_curved_where_elements_can_be(curved, active):
    room = SimpleNamespace(manifest=SimpleNamespace(curved=curved))
    assert curved_sides.Room.ledger(room, None)["curved"]["active"] == active


@pytest.mark.parametrize("size, factor, active", [
    (1e-9, 1e-3, True), (1e9, 1.0, True), (0.0, 1.0, False), (1.0, 0.0, False)])
def test_a_load_is_active_in_any_unit(size, factor, active):
    """Of two patterns the second counts where neither it nor its amplitude is zero all the time."""
    facts = SimpleNamespace(amplitudes=np.array([[0.0, 0.0], [0.0, factor], [0.0, 0.0]]),
                            largest=[1.0, size])
    entry, = LoadEffect.ledger(SimpleNamespace(patterns=[0, 1], heading="load"), facts).values()
    assert entry["active"] == active


@pytest.mark.parametrize("argument, factor", [("slip", 0.4), ("displacement", 1.0)])
def test_a_way_is_as_long_there_and_back(argument, factor):
    """A factor 1 - s/10: after 1 there, 3 back and 2 there again s is 6 by the way, 0 by place."""
    room = slip_law.Room("slip_law", SimpleNamespace(patterns=[], rooms={"slip_law": {
        "argument": argument, "range": 10.0, "values": [1.0, 0.5, 0.0]}}))
    room.prepare(SimpleNamespace(gid=np.arange(2), xy=np.zeros((2, 2)),
                                 at=lambda time: SimpleNamespace(gap=np.zeros(2))))
    u = np.zeros(1)
    for slip in (1.0, -3.0, 2.0):
        before, u = u, u + slip
        last = room.coefficient_factor(np.array([1]), u, before)
        room.step_ends(np.array([1]), np.array([slip]), np.ones(1))
    assert last == pytest.approx(factor)


@pytest.mark.parametrize("data", [
    {}, {"range": 0.0}, {"range": float("inf")}, {"range": "far"}, {"argument": "time"},
    {"values": [1.0]}, {"values": [1.0, float("nan")]}, {"values": None}, {"values": [1.0, -0.5]}])
def test_a_law_of_slip_has_a_range_and_factors(data):
    """What an export says of it otherwise is refused; so is friction that drives."""
    sound = {"argument": "slip", "range": 10.0, "values": [1.0, 0.5]}
    slip_law.Room("slip_law", SimpleNamespace(patterns=[], rooms={"slip_law": sound}))
    given = sound | data if data else {}
    with pytest.raises(InputError, match="slip_law must have|is negative at slip 10"):
        slip_law.Room("slip_law", SimpleNamespace(patterns=[], rooms={"slip_law": given}))


@pytest.mark.parametrize("initial, steps, slip, active", [
    (False, 1, 3, ...), (True, 0, 0, None), (True, 2, 0, False), (True, 2, 1, True)])
def test_an_initial_displacement_matters_where_friction_slides(initial, steps, slip, active):
    facts = SimpleNamespace(initial=initial, steps=steps, most=lambda state: {"slip": slip}[state])
    found = initial_state.Room.ledger(None, facts)
    assert found.get("initial_state", {"active": ...})["active"] is active


def test_static_takes_one_step(solved):
    run = solved("model-static")
    assert run.summary["effects"]["time"] == "static" and run.summary["steps"] == 1
    assert len(run.history["step"]) == 1 and set(run.contact["step"].ravel()) == {1}
    assert solved("model-static", STEPS=2).status == 2


def test_without_body_force_there_is_no_such_vector(exported, tmp_path):
    from driver.scene.loader import read_subdomains
    from mpi4py import MPI

    manifest = read_manifest(exported("model"))
    assert [p["kind"] for p in manifest.patterns] == ["traction"]
    subdomain = read_subdomains(manifest, 0, 1, MPI.COMM_SELF)[0]
    assert subdomain.loads.shape == (1, subdomain.dofs)
    size = sum(path.stat().st_size for path in exported("model").glob("block-*.bin"))
    heavy = MODEL.read_text().replace('include "export.idp"',
                                      'macro bodyForce1() [0., -7.8e4] //\ninclude "export.idp"')
    other = exported(stripped(tmp_path, heavy, "heavy"))
    assert [p["kind"] for p in read_manifest(other).patterns] == ["traction", "body_force"]
    # float64 arrays with a count: nodal forces of 242 dofs and three integrals on 200 triangles in
    # each of 8
    assert sum(path.stat().st_size
               for path in other.glob("block-*.bin")) - size == 8 * 8 * (243 + 3 * 401)


@pytest.mark.parametrize("words, absent, files", [
    ((), {"meshio", "matplotlib", "driver.figures"}, {"fields", "fields.pvd", "figures"}),
    (("FIELDS=yes",), {"meshio", "matplotlib", "driver.figures"}, {"figures"}),
])
@pytest.mark.some(1)
def test_what_is_off_is_neither_imported_nor_written(loaded, words, absent, files):
    modules, out = loaded("model-static", "ERRORS=yes", "QUIET=yes", *words)
    written = {path.name for path in out.iterdir()}
    assert "driver.runs.run" in modules
    assert not modules & (absent | {"driver.studies", "tqdm"})
    assert not written & files and "summary.json" in written


# ---- the ledger ----------------------------------------------------------------------------------

PLAIN = ("contact", "friction", "quasistatic", "traction")
SIZES = {"dual_normal": 40, "dual_tangential": 39}


def declared(*rooms, patterns=("traction",)) -> Effects:
    """The effects of a scene that declares `rooms` and load patterns of these kinds."""
    data = dict.fromkeys(rooms, {})
    return Effects(SimpleNamespace(rooms=data, patterns=[{"kind": kind} for kind in patterns],
                                   bodies=1,
                                   contact_labels=[1] if "contact" in rooms else [],
                                   quasistatic="quasistatic" in rooms))


def counted(open_, stick, slip) -> dict:
    """Numbers of nodes by state at the end of every step."""
    return {"open": np.array(open_), "stick": np.array(stick), "slip": np.array(slip)}


def entries(effects=declared(*PLAIN), nodes=None, amplitudes=((0,), (1,), (0.5,)), largest=(3.0,),
            log=(), seconds=0.0, gap=False, initial=False, sizes=None):
    """Ledger of a run; what is not given is that of a run in which all of PLAIN matters."""
    nodes = nodes or counted([9, 0], [0, 4], [0, 5])
    contact = SimpleNamespace(motion=None, following=None, covered=None, joined=0,
                              gap=np.array([float(gap)]),
                              columns={"friction": np.ones(1), "tresca": np.ones(1)},
                              weight=np.ones(1))
    homogeneous = effects.homogeneous(contact, np.array([float(initial)]))
    return effects.ledger(RunFacts(sizes or SIZES, np.array(amplitudes, float), np.array(largest),
                                   nodes, ledger.shares(list(log), seconds), gap, initial,
                                   homogeneous))


def test_what_nothing_switches_off_is_active_in_every_step():
    """Unless no step was kept."""
    facts = RunFacts({}, np.zeros((2, 1)), np.ones(1), counted([1], [0], [0]), {}, False, False,
                     True)
    assert facts.in_every_step("springs") == (True, "springs")
    assert facts.touched() == (False, "nothing touched")
    none = RunFacts({}, np.zeros((1, 1)), np.ones(1), counted([], [], []), {}, False, False, True)
    assert none.in_every_step("springs")[0] is None


def test_active_effects():
    found = entries()
    for name, unknowns in (("contact", 40), ("friction", 39), ("time", 0), ("load", 0)):
        assert found[name]["declared"] and found[name]["active"]
        assert found[name]["unknowns"] == unknowns
    assert not never_mattered(found)
    for entry in found.values():
        assert set(entry) == {"declared", "active", "reason", "unknowns", "seconds"}


@pytest.mark.parametrize("nodes, sentences", [
    (counted([9, 9], [0, 0], [0, 0]), {"contact is declared but nothing touched",
                                       "friction is declared but nothing touched"}),
    (counted([0, 0], [9, 9], [0, 0]),
     {"friction is declared but nothing slipped (9 nodes stuck at most)"}),
    (counted([8, 8], [1, 1], [0, 0]),
     {"friction is declared but nothing slipped (1 node stuck at most)"}),
])
def test_effects_that_never_mattered(nodes, sentences):
    said = set(never_mattered(entries(nodes=nodes)))
    assert sentences <= said and all(
        line.startswith("quasistatic") for line in said - sentences)


@pytest.mark.parametrize("nodes, active, reason", [
    (counted([9, 8], [0, 1], [0, 0]), True, "nodes that touched: 1 at most"),
    (counted([9, 8], [0, 0], [0, 1]), True, "nodes that touched: 1 at most"),
    (counted([5, 5, 9], [1, 3, 0], [3, 2, 0]), True, "nodes that touched: 5 at most"),  # once
    (counted([9, 9], [0, 0], [0, 0]), False, "nothing touched"),
    (counted([], [], []), None, "no step was kept"),
])
def test_contact_matters_where_one_node_touched_at_one_time(nodes, active, reason):
    found = entries(nodes=nodes, gap=True)
    assert (found["contact"]["active"], found["contact"]["reason"]) == (active, reason)
    assert found["contact"]["unknowns"] == 40
    assert found["gap"]["active"] is bool(active) and found["gap"]["declared"]
    assert active or found["gap"]["reason"] == reason
    assert not entries(nodes=nodes)["gap"]["declared"]


def test_undeclared_effects_cost_nothing():
    found = entries(declared("traction"), counted([0], [0], [0]), ((0,), (1,)))
    for name in ("contact", "friction", "time", "gap", "body_force", "displacement"):
        assert found[name] == {"declared": False, "active": False, "reason": "not declared",
                               "unknowns": 0, "seconds": 0.0}
    assert not never_mattered(found)


@pytest.mark.parametrize("amplitudes, expected", [
    ([[0, 0], [1, 2], [2, 4]], True),
    ([[0, 0], [1, 2], [1, 2]], True),  # loads that rest
    ([[0, 0], [1, 2], [2, 3]], False),  # not in proportion
    ([[0], [2], [1]], False),  # unloading
    ([[1], [2], [3]], False),  # not from zero
    ([[0], [1], [0]], False),  # back to nothing
    ([[0], [0], [0]], True),
])
def test_proportional(amplitudes, expected):
    for unit in (1.0, 1e-9, 1e9):
        assert proportional(unit * np.array(amplitudes, float)) is expected
    assert not proportional(1e9 * np.array([[0, 0], [1.0, 2], [2, 4 + 1e-10]]))


def test_time_matters_only_with_friction_and_a_way():
    growing = ((0,), (1,), (2,))
    assert entries(amplitudes=growing)["time"]["active"] is False
    assert entries(amplitudes=growing, gap=True)["time"]["active"] is True
    assert entries(amplitudes=growing, initial=True)["time"]["active"] is True
    assert entries(declared("contact", "tresca", "quasistatic", "traction"),
                   amplitudes=growing)["time"]["active"] is True
    assert entries(declared("contact", "quasistatic", "traction"),
                   sizes=SIZES | {"dual_tangential": 0})["time"]["active"] is False


def test_time_claim_holds(solved):
    """Where the ledger says that one step gives the same end, it does; where it does not, it does
    not.
    """
    for loading, same in (("monotone", True), ("nonmonotone", False)):
        run = solved("model", LOADING=loading)
        assert run.summary["effects_ledger"]["time"]["active"] is not same
        static = solved("model-static").contact["sigma_t"][-1]
        apart = np.abs(run.contact["sigma_t"][-1] - static).max() / np.abs(static).max()
        assert apart < 1e-3 if same else apart > 0.1  # both solved to 1e-6 of the load


def test_zero_body_force_is_idle():
    effects = declared(*PLAIN, "body_force", patterns=("traction", "body_force"))
    found = entries(effects, amplitudes=((0, 0), (1, 1), (2, 1)), largest=(3.0, 0.0))
    assert never_mattered(found) == ["body force is declared but is zero at every step"]


def test_seconds_are_shares_of_products():
    log = [(0, 1, 1, "start", 1), (1, 1, 1, "cg", 1), (3, 1, 1, "expansion", 1),
           (4, 1, 2, "start", 1), (6, 1, 2, "cg", 1),
           (10, 2, 1, "proportioning", 1)]
    found = entries(log=log, seconds=10.0)
    assert [found[name]["seconds"] for name in ("contact", "friction", "time")] == [6.0, 3.0, 6.0]


def test_ledger_of_a_run(solved):
    run = solved("model", LOADING="nonmonotone")
    found = run.summary["effects_ledger"]
    assert found["contact"]["unknowns"] == found["friction"]["unknowns"] == 40
    assert 0 < found["contact"]["seconds"] < run.summary["seconds"]["solve"]
    assert not found["body_force"]["declared"] and not found["gap"]["declared"]


def test_a_history_is_called_what_a_scene_calls_it():
    ledger = {"time": {"declared": True, "active": False, "reason": "one step was taken"}}
    assert never_mattered(ledger) == ["quasistatic is declared but one step was taken"]


@pytest.mark.slow  # two whole runs
def test_screen_says_what_never_mattered(command, tmp_path):
    text = MODEL.read_text().replace('include "export.idp"',
                                     'macro gap() 1. //\ninclude "export.idp"')
    done = command("run", f"SCENE={stripped(tmp_path, text, 'far')}", f"OUT={tmp_path / 'out'}",
                   "FIGURES=no", "FIELDS=no")
    assert done.returncode == 0 and "contact is declared but nothing touched" in done.stdout
    assert "friction is declared but nothing touched" in done.stdout


# ---- the study -----------------------------------------------------------------------------------

@pytest.mark.parametrize("scene, expected", [
    ("model", {"contact", "friction", "time"}),
    ("bracket", {"contact", "friction", "gap", "body force", "load 1", "time", "history of 1",
                 "history of 2"}),
    ("pressfit", {"contact", "curved", "gap"}),
    ("thermal", {"contact", "gap", "thermal strain", "time"}),
])
def test_variants_of_a_scene(exported, scene, expected):
    assert set(effects.variants(read_manifest(exported(scene)))) == expected


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The study of a small model example: rows of its table by name, and its folder."""
    out = tmp_path_factory.mktemp("effects")
    paths = effects.run_effects({"scene": "model", "loading": "nonmonotone", "steps": "4",
                                 "cells": "4", "out": str(out)})
    table = {row["without"]: row for row in read_rows(paths[0])}
    return table, out, paths


def test_study_rows_and_files(study):
    table, out, paths = study
    assert list(table) == ["", "contact", "friction", "time"]
    names = {"model.csv", "model-tractions.csv", "model.png", "model.pdf"}
    assert {path.name for path in out.iterdir()} - {STUDY} == names == {
        path.name for path in paths}
    assert all(path.stat().st_size > 0 for path in paths)


def test_study_costs(study):
    table = study[0]

    def get(name, column):
        return float(table[name][column])

    nodes = 16  # 4 subdomains of 4 cells along the bottom, the clamped corner left out
    assert get("", "dual_normal") == get("", "dual_tangential") == nodes
    assert get("friction", "dual_tangential") == 0 and get("friction", "dual_normal") == nodes
    assert get("contact", "dual_normal") == get("contact", "dual_tangential") == 0
    assert get("time", "steps") == 1 and get("", "steps") == 4
    assert get("contact", "dual_multiplications") < get("", "dual_multiplications")
    assert all(get(name, "primal_dofs") == 400 for name in table)  # 8 squares of 25 nodes


def test_study_changes(study):
    table = study[0]

    def get(name, column):
        return float(table[name][column])

    for name in ("peak_tangential", "resultant_t", "dissipated"):
        assert get("friction", f"{name}_change") == -1  # all of it
    for name in ("peak_normal", "contact_length", "resultant_n"):
        assert get("contact", f"{name}_change") == -1
    assert abs(get("time", "peak_tangential_change")) > 0.01
    assert get("", "max_displacement_change") == 0
    expected = get("friction", "max_displacement") / get("", "max_displacement") - 1
    assert get("friction", "max_displacement_change") == pytest.approx(expected, rel=1e-12)


@pytest.mark.slow  # a study of its own for one row
def test_variant_without_solution_is_a_row(tmp_path, capsys):
    """Friction alone keeps the block on its slope."""
    paths = effects.run_effects({"scene": "slope", "cells": "4", "out": str(tmp_path)})
    table = {row["without"]: row for row in read_rows(paths[0])}
    row = table["friction"]
    assert row["status"] == "3" and row["reason"] and not row["peak_normal"]
    assert table[""]["status"] == "0"
    assert row["reason"] in capsys.readouterr().out


def test_study_refuses(tmp_path, command):
    with pytest.raises(InputError, match="SCENE"):
        effects.run_effects({})
    with pytest.raises(InputError, match="FIGURES"):
        effects.run_effects({"scene": "model", "figures": "yes"})
    bare = tmp_path.parent / "bare.edp"
    bare.write_text('include "scene.idp"\nbody = square(2, 2);\nbodyMaterial("a", 1., 0.3);\n'
                    'macro support() on(1, u1 = 0., u2 = 0.) //\n'
                    'macro load1() pressure(3, 1.) //\ninclude "export.idp"\n')
    with pytest.raises(InputError, match="declares no effect that could be left out"):
        effects.run_effects({"scene": str(bare), "out": str(tmp_path.parent / "bare")})
    done = command("effects", "SCENE=model", "STEPZ=3", f"OUT={tmp_path}")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "stepz" in done.stderr.lower()
    assert {path.name for path in tmp_path.iterdir()} <= {STUDY}  # the mark of its folder


def test_constants_that_are_called_parts_are_between_none_and_all():
    assert not constants.beyond("effects")
