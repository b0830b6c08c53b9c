"""Prices of accuracy: what is predicted from manufactured costs and errors, and lists of runs."""

from types import SimpleNamespace

import pytest

from driver.estimates import price_words, prices
from driver.estimates.alternatives import Alternatives
from driver.estimates.budget import Part
from driver.estimates.prices import Adaptive, Costs, Measured, Quantity, Uniform, Whole


def cost(unknowns, steps=1):
    """A machine: constants and powers as the model of costs has them."""
    return {"export": 0.2 + 1e-5 * unknowns, "setup": 0.02 + 1e-6 * unknowns**1.2,
            "solve": steps * (0.004 + 1e-7 * unknowns**1.2),
            "output": steps * (0.01 + 1e-6 * unknowns)}


def measured(unknowns, steps=10, stages=("export", "setup", "solve", "output")):
    return Measured(unknowns, steps, {name: cost(unknowns, steps)[name] for name in stages})


COMPANIONS = [measured(n, 10, ("export", "setup", "solve")) for n in (1e3, 4e3)]
COSTS = Costs(measured(1.6e4), COMPANIONS, COMPANIONS, COMPANIONS)


def test_costs_of_a_machine_are_extrapolated():
    """Those of the companions' stages exactly, that of the output but for its constant."""
    for unknowns, steps in ((2e3, 5), (1e5, 40), (1e6, 10)):
        for stage in ("export", "setup", "solve"):
            assert COSTS.stage(stage, unknowns, steps) == pytest.approx(
                cost(unknowns, steps)[stage], rel=1e-6)
        assert COSTS.run(unknowns, steps) == pytest.approx(sum(cost(unknowns, steps).values()),
                                                           rel=0.3)


def test_another_kind_of_mesh_costs_a_factor():
    twice = [Measured(run.unknowns, 10, {k: 2 * v for k, v in run.seconds.items()})
             for run in COMPANIONS]
    other = Costs(measured(1.6e4), twice, COMPANIONS, COMPANIONS + twice)
    assert other.stage("solve", 1e5, 3) == pytest.approx(2 * COSTS.stage("solve", 1e5, 3))


def test_stages_that_do_not_grow_yet_grow_later():
    """Rounding of clocks and starts hide it on small meshes; it is not promised to stay so."""
    flat = prices.curve([(100, 0.2), (400, 0.2), (1600, 0.2)], 1.2)
    assert flat(1600) == pytest.approx(0.2) and flat(1.6e5) > 10 * flat(1600)


def test_chance_of_small_runs_is_not_extrapolated():
    """A busy machine's companions of 1,000 unknowns that differ by 0.1 s: a hundred times as many
    do not take a hundred times as long.
    """
    noisy = prices.curve([(250, 0.2), (1000, 0.3)], 1.2, most=2e-5)
    assert noisy(1e5) < 0.3 + 2 * 2e-5 * 1e5 * 100**0.2
    assert noisy(1000) == pytest.approx(0.3)
    busy = [Measured(n, 10, {"export": 0.4 + 1e-4 * n, "setup": 1e-4 * n, "solve": 0.1})
            for n in (250, 1000)]
    slow = Costs(measured(4e3), busy, busy, busy)
    # FreeFEM starts four times as slowly: an unknown may take so much more
    assert 2 * 2e-5 * 1e5 < slow.stage("export", 1e5) < 1e-4 * 1e5 + 0.5


def test_what_large_runs_take_is_none_of_small_ones():
    """Two bodies by ACCURACY: FreeFEM took 50 s for 212,000 unknowns, and 53 s were predicted for
    2,000, as no more than a part was believed to be for unknowns.
    """
    busy = [Measured(n, 10, {"export": 0.1 + 2.4e-4 * n, "setup": 1e-5 * n, "solve": 0.1})
            for n in (400, 7e4)]
    run = Measured(2.1e5, 10, {"export": 51.0, "setup": 2.1, "solve": 1.0, "output": 1.0})
    assert Costs(run, busy, busy, busy).run(2e3, 10) < 5


UNIFORM = Uniform("P1", "h", [0.1, 0.2, 0.4], [0.01, 0.03, 0.05], [1.6e4, 4e3, 1e3], 1.0,
                  COSTS)


@pytest.mark.parametrize("room, size", [(0.06, 0.4), (0.04, 0.2), (0.01, 0.1), (0.005, 0.05)])
def test_meshes_are_those_that_were_run_or_finer_by_the_order(room, size):
    choice = UNIFORM.meets(room)
    assert float(choice.settings["H"]) == size
    assert choice.unknowns[0] == pytest.approx(1.6e4 * (0.1 / size) ** 2)


def test_a_coarse_mesh_that_is_right_by_chance_is_not_offered():
    lucky = Uniform("P1", "h", [0.1, 0.2, 0.4], [0.01, 0.03, 0.001],
                    [1.6e4, 4e3, 1e3], 1.0, COSTS)
    assert lucky.meets(0.02).settings == {"H": "0.1"}


@pytest.mark.parametrize("grows", [
    lambda h: 199 / h**2,  # all of a body
    lambda h: 199 / h**2 + 310,  # H leaves a part of the mesh alone
    lambda h: 177 / h**2 + 518 / h,  # elements that grow with their distance from a line
    lambda h: 2 * (10 / h + 1) ** 2])  # cells of a rectangle
def test_unknowns_grow_as_those_of_the_run_and_its_companions_do(grows):
    sizes = [1.6, 3.2, 6.4]
    kind = Uniform("P1", "h", sizes, [0.1, 0.2, 0.3], [grows(h) for h in sizes], 1.0, COSTS)
    assert kind.count(0.12) == pytest.approx(grows(0.12), rel=1e-6)
    assert kind.count(3.2) == grows(3.2)


def test_unknowns_of_other_elements_grow_as_those_of_the_run_do():
    """A hook with a hole: its outline makes most of the quadratic companions, two coarse meshes,
    which told of 27,300 unknowns, of 26 s and of 205 MiB, where there were 71,360.
    """
    own = Uniform("P1", "h", [2.0, 4.0, 8.0], [0.1, 0.2, 0.3], [964.0, 304.0, 138.0], 1.0, COSTS)
    other = Uniform("P2", "h", [8.0, 16.0], [0.1, 0.2], [480.0, 226.0], 1.0, COSTS, like=own)
    assert other.count(0.43) == pytest.approx(71360, rel=0.1)
    assert other.count(1.4) == pytest.approx(7178, rel=0.1) and other.count(16.0) == 226.0


def test_unknowns_of_any_mesh_grow_with_its_area_in_the_end():
    """By one mesh alone, and where what was run does not grow."""
    one = Uniform("P1", "h", [0.1], [0.01], [100.0], 1.0, COSTS)
    flat = Uniform("P1", "h", [0.1, 0.2, 0.4], [0.01, 0.02, 0.03], [100.0] * 3, 1.0, COSTS)
    assert one.count(0.01) == pytest.approx(1e4)
    assert flat.count(0.01) > 9e2 and flat.count(0.1) == 100.0


def test_other_histories_tell_nothing_of_a_step():
    """Companions of another kind with a fourth of the steps, most of which the first one takes."""
    short = [Measured(n, 5, {"solve": 0.1 + cost(n, 5)["solve"], "setup": 0.02, "export": 0.2})
             for n in (500, 2000)]
    mixed = Costs(measured(1.6e4), COMPANIONS, COMPANIONS, COMPANIONS + short)
    assert mixed.stage("solve", 1e5) == pytest.approx(COSTS.stage("solve", 1e5))


def test_a_mesh_that_none_is_coarser_than_has_no_companions_on_others():
    quantity = Quantity("slip", 1.0, 1, True, {1: 0.0}, 1.0, 0.0)
    whole = Whole(measured(1.6e4, 1), 2.0, COSTS, 150.0, 90.0)
    prices_of = [prices.price(Uniform("P2", "cells", [cells], [0.01], [1e3], 1.0, COSTS), quantity,
                              whole, 0.03) for cells in (1, 2)]
    alone, beside = (found["seconds"] - found["seconds_bare"] for found in prices_of)
    assert alone < 0.2 * beside


def test_what_is_out_of_reach_is_not_promised():
    assert UNIFORM.meets(1e-6) is None
    slow = Uniform("P1", "h", [0.1], [0.01], [1.6e4], 0.05, COSTS)
    assert slow.meets(0.005) is None


def test_cycles_of_refinement_go_on_by_their_order_and_all_are_paid():
    kind = Adaptive("ADAPT", {"H": "0.4"}, [0.05, 0.02], [1e3, 4e3], 1.0, COSTS)
    assert kind.meets(0.03).settings["ADAPT"] == "1"
    choice = kind.meets(0.006)
    assert choice.settings == {"H": "0.4", "ADAPT": "3"}
    assert choice.unknowns == (1e3, 4e3, 1.6e4, 6.4e4)


def test_cycles_of_refinement_are_paid_before_the_run():
    quantity = Quantity("slip", 1.0, 10, False, {10: 0.0}, 1.0, 0.0)
    whole = Whole(measured(1.6e4), 2.0, COSTS, 150.0, 90.0)
    adaptive = Adaptive("ADAPT", {"H": "0.4"}, [0.05, 0.02], [4e3, 1.6e4], 1.0, COSTS)
    uniform = Uniform("P1", "h", [0.1], [0.02], [1.6e4], 1.0, COSTS)
    one, two = (prices.price(kind, quantity, whole, 0.03) for kind in (uniform, adaptive))
    cycle = COSTS.run(4e3, 10)
    assert one["seconds_bare"] + 0.5 * cycle < two["seconds_bare"] < one["seconds_bare"] + cycle


@pytest.mark.parametrize("value, claimed, error", [
    (1.10, 0.01, 0.10),  # farther from the run than it claims
    (1.01, 0.02, 0.02), (1.01, None, 0.06),  # nothing known but the run and its error
    (1.01, 0.30, 0.06)])
def test_errors_of_other_meshes_are_bounded_by_the_run(value, claimed, error):
    """The run has 1 with an error of 0.05; a coarser mesh 1.2 in its steps, 1.3 in a fourth."""
    def level(mesh, stride):
        return SimpleNamespace(values={"slip": 1.2 if stride == 1 else 1.3})

    kinds = Alternatives.__new__(Alternatives)
    kinds.companions = SimpleNamespace(level=level, base={"h": 0.2}, meshes=[{}, {"h": 0.2}],
                                       values={"slip": 1.0})
    kinds.name, kinds.stride = "slip", 4
    own = SimpleNamespace(errors=[0.05])
    assert kinds._within(value + 0.1, claimed, own) == pytest.approx(error)


@pytest.mark.parametrize("steps, start, missing, counts", [
    (8, 0, 8, [8, 4, 2]), (8, 4, 8, [8, 4, 2]), (8, 2, 8, [8, 4]), (6, 0, 8, [6, 3]),
    (8, 1, 8, [8]), (7, 0, 8, [7]), (8, 0, 4, [8, 4]), (8, 0, 2, [8])])
def test_fewer_steps_err_by_what_companions_with_them_are_off(steps, start, missing, counts):
    """Where every second or fourth step ends at the end, and one where a cycle begins, and they
    miss nothing of the history.
    """
    kinds = Alternatives.__new__(Alternatives)
    kinds.name, kinds.manifest = "slip", SimpleNamespace(steps=steps)
    kinds.parts = {"time": Part(0.5), "friction": Part(0.01), "solver": Part(0.02)}
    kinds.companions = SimpleNamespace(
        effects=SimpleNamespace(frictional=True, quasistatic=True), base={}, meshes=[{}],
        values={"slip": 1.0}, manifest=SimpleNamespace(cycle_start=start),
        strides=SimpleNamespace(up_to=lambda wanted: wanted,
                                misses=lambda stride: stride >= missing),
        level=lambda mesh, stride: SimpleNamespace(values={"slip": 1.0 + 0.1 * (stride - 1)}))
    found = kinds.quantity(1.0)
    assert found.times == pytest.approx({n: 0.5 + 0.1 * (steps // n - 1) for n in counts})
    assert found.others == pytest.approx(0.03) and not found.static and found.jumps is None
    kinds.companions.effects.frictional = False
    assert kinds.quantity(1.0).times == {steps: 0.5}


def a_list(times=None, static=False):
    quantity = Quantity("slip", -1.0, 10, static, times or {5: 0.004, 10: 0.001}, 1.0, 1e-5)
    adaptive = Adaptive("ADAPT", {"H": "0.4"}, [0.05, 0.04], [1e3, 4e3], 0.2, COSTS)
    run = measured(1.6e4)
    return prices.lines([UNIFORM, adaptive], quantity, Whole(run, 2.0, COSTS, 150.0, 90.0))


def test_accuracies_that_take_the_same_have_one_row():
    """10 to 1 % the same settings, 0.3 and 0.1 % out of reach: 1 % and 0.3 % are said."""
    offer = {"settings": {"H": "0.1"}, "seconds": 2.0, "seconds_bare": 1.0, "memory_mib": 90.0}
    reached = [{"accuracy": asked, "kind": "P1", **offer, "compared": {"P1": offer}}
               for asked in (0.1, 0.03, 0.01)]
    head, *rows = price_words.table({"lines": [*reached, {"accuracy": 0.003}, {"accuracy": 0.001}]})
    assert [row[0] for row in rows] == ["1 %", "0.3 %"] and len(head) == len(rows[0])
    assert "H=0.1" in rows[0] and rows[1][1].startswith("more than")


def test_every_digit_costs_more_and_names_the_fastest():
    table = a_list()
    assert [entry["accuracy"] for entry in table] == list(prices.ASKED)
    reached = [entry for entry in table if "settings" in entry]
    assert len(reached) >= 4
    for before, after in zip(reached, reached[1:]):
        assert before["seconds"] <= after["seconds"]
        assert before["memory_mib"] <= after["memory_mib"]
    for entry in reached:
        assert entry["seconds"] == min(o["seconds"] for o in entry["compared"].values())
        assert entry["seconds_bare"] < entry["seconds"]
        size, steps = float(entry["settings"]["H"]), int(entry["settings"]["STEPS"])
        left = {0.1: 0.01, 0.2: 0.03, 0.4: 0.05}.get(size, 0.1 * size)
        late = 0.004 if steps == 5 else 0.01 / steps
        assert left + late + 1e-5 <= entry["accuracy"] * (1 + 1e-9)


def test_memory_of_packages_does_not_grow():
    """A run with 100 unknowns has 60 MiB that are not theirs; one with a million has a thousand.
    With its estimates an unknown takes up to 8 kB.
    """
    small = Whole(measured(100.0), 1.0, COSTS, 150.0, 90.0)
    assert small.memory_of(100.0) == pytest.approx(150.0) and 200 < small.memory_of(1e4) < 240
    large = Whole(measured(1e6), 1.0, COSTS, 1090.0, 90.0)
    assert large.memory_of(2e6) == pytest.approx(2090.0)


def test_steps_of_a_static_scene_are_no_choice():
    assert all("STEPS" not in entry["settings"] for entry in a_list({10: 0.0}, True)
               if "settings" in entry)


def test_words():
    found = {"quantity": "slip", "value": -1.0, "error": 0.011, "lines": a_list()}
    lines = price_words.describe(found)
    assert lines[0] == "predicted cost of the slip (present error: 1.1 %)"
    assert any("H=0.4 STEPS=5" in line for line in lines)
    assert price_words.describe({"reason": "the slip is zero", "lines": []}) == [
        "no prices of accuracy: the slip is zero"]
    assert [price_words.seconds(s) for s in (9.96, 99.6, 99.4, 5980.0, 4e5)] == [
        "10 s", "1.7 min", "99 s", "1.7 h", "111 h"]
    assert [price_words.seconds(s) for s in (0.123, 60.0, 600.0, 90000.0)] == [
        "0.12 s", "60 s", "10 min", "25 h"]


# ------------------------------------------------------------------------------ runs

@pytest.mark.slow
def test_a_run_ends_with_the_price_of_the_quantity_asked_for(solved):
    """Its lines keep to what the budget says of the run itself and of its companions."""
    run = solved("model", errors="yes", loading="nonmonotone", cells=6, steps=8, quantity="slip")
    found = run.summary["errors"]["prices"]
    entry = run.summary["errors"]["quantities"]["slip"]
    assert (found["quantity"], found["value"], found["error"]) == (
        "slip", entry["value"], entry["total"])
    lines = [line for line in found["lines"] if "settings" in line]
    assert {name for line in lines for name in line["compared"]} == {"P1", "P2", "ADAPT"}
    for line in lines:
        mine = line["compared"].get("P1", {}).get("settings", {"CELLS": 0})
        if int(mine["CELLS"]) >= 6 and int(mine["STEPS"]) >= 8:
            assert line["accuracy"] < 2 * entry["relative"] or mine == {"CELLS": "6", "STEPS": "8"}
        if line["accuracy"] < entry["relative"]:
            assert int(mine["CELLS"]) > 6 or int(mine["STEPS"]) > 8 or not int(mine["CELLS"])


def test_a_quantity_that_the_scene_has_not_is_refused_before_it_is_solved(solved):
    run = solved("model-static", quantity="loudness", errors="yes")
    assert run.status == 2 and "QUANTITY=loudness" in run.reason and "slip" in run.reason


def test_there_is_no_price_where_the_error_is_unknown(solved):
    run = solved("cantilever", errors="yes", cells=1)
    assert "is not known" in run.summary["errors"]["prices"]["reason"]
