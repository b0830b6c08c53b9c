"""Work of friction in time steps of any length, against integrals of s |du_t| by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.states import ContactField as C
from driver.march.problem import assemble
from driver.options import Settings
from driver.results import dissipation
from driver.results.dissipation import HOLD, LEFT, Dissipation
from driver.results.record import Record

F = 0.3


def march(times, pressure, u_t, gap=0.0, opening=None, start=0.0):
    """Work over `times` of a sliding node of weight 2 with these histories, functions of time."""
    of = Dissipation(np.array([2.0]), np.array([gap]), None if start is None else np.array([start]))
    total, last = 0.0, u_t(0.0)
    for time in times:
        p, moved = pressure(time), u_t(time) - last
        away = opening(time) if opening else 0.0
        state = {C.U_N: gap - away, C.SLIP: moved, C.BOUND: F * p,
                 C.SIGMA_T: -F * p * np.sign(moved)}
        total += of.add(time, {name: np.array([value]) for name, value in state.items()}).sum()
        last = u_t(time)
    return total


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_proportional_loading_is_exact_with_any_number_of_steps(steps):
    times = np.linspace(0, 1, steps + 1)[1:]
    assert march(times, lambda t: 10 * t, lambda t: 4 * t) == pytest.approx(2 * F * 20, rel=1e-14)


def test_constant_pressure_from_a_preload_is_exact():
    assert march([0.4, 1.0], lambda t: 10, lambda t: -t, start=None) == pytest.approx(2 * F * 10)


def test_second_order_in_the_step():
    def error(steps):
        # int F (1 + t^2) dt over [0, 1] = 4/3 F
        times = np.linspace(0, 1, steps + 1)[1:]
        return march(times, lambda t: 1 + t**2, lambda t: t, start=F) / (2 * F * 4 / 3) - 1

    assert error(8) / error(16) == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("steps", [3, 4, 7, 40])
def test_touching_and_opening_inside_a_step(steps):
    """A node comes at a constant rate, touches at 0.45, leaves at 0.85, and slides all the way.

    Pressure is linear in time on both sides, so that only the step in which it turns errs.
    """
    def pressure(t):
        return max(0.0, min(t - 0.45, 0.85 - t))

    def opening(t):
        return max(0.45 - t, t - 0.85, 0.0)

    times = np.linspace(0, 1, steps + 1)[1:]
    work = march(times, pressure, lambda t: t, gap=0.45, opening=opening)
    step = 1 / steps
    # area of the triangle; the trapezoid cuts at most a triangle step x step/2 off its tip, and
    # where that turns in the last step before the opening, half of step x step/2 is not known
    assert abs(work - 2 * F * 0.04) <= 2 * F * step**2 / 2 + 1e-12


def test_touching_counts_from_the_moment_of_touch():
    times = np.linspace(0, 1, 5)[1:]  # touches at 0.6, between 0.5 and 0.75
    work = march(times, lambda t: max(0.0, t - 0.6), lambda t: 3 * t, gap=0.6,
                 opening=lambda t: max(0.6 - t, 0.0))
    assert work == pytest.approx(2 * F * 3 * 0.4**2 / 2, rel=1e-12)


@pytest.mark.parametrize("moved", [1e-9, -1e-9, 0.0, 1e-3])
def test_where_a_node_stood_still_rounding_decides_nothing(moved):
    """Apart by 0.4, it comes by `moved` in one step and touches in the next: half of that counts,
    as if it had not moved, up to what it did.
    """
    work = march([0.5, 1.0], lambda t: 10.0 * (t == 1.0), lambda t: t, gap=0.4 + moved,
                 opening=lambda t: 0.4 * (t < 1.0), start=0.0)
    whole = 2 * F * 0.5 * 10 / 2
    assert work == pytest.approx(whole / 2, rel=1e-8 + 2 * abs(moved) / 0.4)


@pytest.mark.parametrize("alone, rubbed", [
    ((0.8, 0.4), 1.0 - 0.2),  # half of the loads close the gap of 0.4
    ((np.inf, 0.4), 1.0),  # the first of them does
    ((0.1, 0.4), 1.0 - 0.4)])  # only what others do
def test_one_step_in_which_a_node_touches(alone, rubbed):
    """Pressure and slip grow in proportion from then on; what is not known is what it went before.
    """
    of = Dissipation(np.ones(1), np.array([0.4]), np.zeros(1), lambda: np.array(alone)[:, None])
    state = {C.U_N: 0.4, C.SLIP: 1.0, C.BOUND: F * 5, C.SIGMA_T: -F * 5}
    work = of.add(1.0, {name: np.array([value]) for name, value in state.items()})
    assert work == pytest.approx(F * 5 * rubbed / 2, rel=1e-12)
    assert of.open == pytest.approx(LEFT * F * 5 * (1.0 - rubbed) / 2, rel=1e-12, abs=1e-15)


def test_of_a_node_that_nothing_holds_half_the_way_is_taken():
    """And the other half is left open, as it may have gone any part of it before it touched."""
    of = Dissipation(np.ones(1), np.array([0.4]), np.zeros(1), lambda: np.full((2, 1), np.inf))
    state = {C.U_N: 0.4, C.SLIP: 1.0, C.BOUND: F * 5, C.SIGMA_T: -F * 5}
    work = of.add(1.0, {name: np.array([value]) for name, value in state.items()})
    assert work == pytest.approx(F * 5 / 4) and of.open == pytest.approx(F * 5 / 4)


def test_nodes_that_touch_in_turn_hold_one_another():
    """A part of their work is open; nothing of that of nodes that touch at once."""
    def left(*normal):
        of = Dissipation(np.ones(2), np.full(2, 0.4), np.zeros(2),
                         lambda: np.array([normal, (0.0, 0.0)]))
        state = {C.U_N: 0.4, C.SLIP: 1.0, C.BOUND: F * 5, C.SIGMA_T: -F * 5}
        work = of.add(1.0, {name: np.full(2, value) for name, value in state.items()})
        assert work.sum() == pytest.approx(F * 5)
        return of.open

    assert left(0.8, 0.8) == 0.0 and left(0.8, 0.5) == pytest.approx(HOLD * F * 5)


ONTO = """include "scene.idp"
{history}
rectangle(0., 20., 0., 10.);
macro young() 2e3 //
macro poisson() 0.4 //
{loads} //
macro contact() 1 //
macro friction() 0.1 //
macro gap() 0.3 //
include "export.idp"
"""


@pytest.mark.parametrize("loads, left", [
    ("macro support() on(4, u1 = 0.) //\nmacro load1() traction(3, 0., -50.)", 0.0),
    ("macro support() on(4, u1 = 0.) //\nmacro displacement1() on(3, u2 = -0.6)", 0.0),
    ("macro support() on(4, u1 = 0., u2 = 0.) //\nmacro load1() traction(3, 30., -40.)", 0.5)],
    ids=["falls", "is moved", "bends"])
@pytest.mark.slow
def test_a_static_step_onto_an_obstacle_does_the_work_of_its_history(solved, tmp_path, loads, left):
    """As much as twenty steps of loads in proportion, but for what the step says it leaves open:
    nothing where the way to the obstacle does not lead along it.
    """
    runs = []
    for name, history in (("static", ""),
                          ("history", "quasistatic(1.);\nmacro amplitude1(t) t //")):
        path = tmp_path / f"{name}.edp"
        path.write_text(ONTO.format(history=history, loads=loads))
        runs.append(solved(path, cells=4, errors="yes").summary)
    static, history = (run["dissipated"] for run in runs)
    entry = runs[0]["errors"]["quantities"]["dissipated_energy"]
    assert static > 0 and static == pytest.approx(history, rel=5e-3, abs=entry.get("time", 0.0))
    assert entry.get("time", 0.0) <= left * static


@pytest.mark.slow  # runs at several cuts
def test_work_of_a_first_step_does_not_depend_on_the_cut(solved, tmp_path):
    """Where the body would go without contact is that of the whole body, not of its pieces, which
    hang on their corners: 7 of them had said a sixth less.
    """
    path = tmp_path / "bends.edp"
    scene = ONTO.format(history="", loads="macro support() on(4, u1 = 0., u2 = 0.) //\n"
                                          "macro load1() traction(3, 30., -40.)")
    path.write_text(scene.replace("rectangle(0., 20., 0., 10.);",
                                  "body = square(16, 8, [20. * x, 10. * y]);"))
    work = [solved(path, subdomains=cut, np=1 + cut // 5).summary["dissipated"]
            for cut in (1, 3, 7)]
    assert work[0] > 0 and work == pytest.approx(work[:1] * 3, rel=1e-6)


@pytest.mark.parametrize("pulls", ["", "macro bilateral() (label == 2) //"],
                         ids=["lifts off", "pulls"])
@pytest.mark.some(2)
def test_where_loads_alone_would_take_a_body_is_known_by_what_its_step_has_eliminated(
        exported, named_scene, monkeypatch, pulls):
    """As an iteration with its subdomains says, to what that leaves of their jumps; no product."""
    scene = ONTO.format(history="", loads=f"macro support() on(4, u1 = 0., u2 = 0.) //\n{pulls}\n"
                                          "macro load1() traction(3, 30., -40.)")
    scene = scene.replace("rectangle(0., 20., 0., 10.);",
                          "body = square(16, 8, [20. * x, 10. * y]);").replace("contact() 1",
                                                                             "contact() 1, 2")
    export = exported(named_scene(f"bends{len(pulls)}", scene), subdomains=7)
    solver = assemble(export, MPI.COMM_SELF).solver(Settings())
    boundary, shortcut = solver.operator.structure.contact, solver.fixed_point.shortcut
    assert shortcut.comes_first
    spent = solver.operator.products
    found = dissipation.without_contact(solver, boundary)
    assert solver.operator.products == spent and "accelerators" not in vars(solver.qp)
    monkeypatch.setattr(type(shortcut), "comes_first", False)
    wanted = dissipation.without_contact(solver, boundary)
    assert "accelerators" in vars(solver.qp)
    close = 10 * dissipation.GLUED * np.abs(wanted).max()
    assert found == pytest.approx(wanted, rel=0, abs=close) and np.ptp(wanted[0]) > 1e3 * close
    at_wall = np.isclose(solver.operator.structure.contact.xy[:, 0], 20.0)
    assert np.allclose(found[0, at_wall][1:-1], 0.3, rtol=0, atol=close) == bool(pulls)


@pytest.mark.parametrize("first", [True, False], ids=["eliminated", "iterated"])
@pytest.mark.some(2)
def test_where_loads_alone_would_take_a_body_does_not_depend_on_the_step_that_a_run_is_at(
        exported, named_scene, monkeypatch, first):
    """An interrupted run asks before its next step, others after the first: of bilateral contact
    with an obstacle that moves, of surfaces that wear.
    """
    scene = ONTO.format(history="quasistatic(1.);", loads="""\
macro support() on(4, u1 = 0., u2 = 0.) //
macro bilateral() (label == 2) //
macro obstacleX(t) (-0.2*t) //
macro wear() 1e-3 //
macro load1() traction(3, 30., -40.)""")
    scene = scene.replace("rectangle(0., 20., 0., 10.);",
                          "body = square(16, 8, [20. * x, 10. * y]);").replace("contact() 1",
                                                                             "contact() 1, 2")
    scene = scene.replace("macro gap() 0.3", "macro obstacle(x, y) min(20.3 - (x), (y) + 0.3)")
    export = exported(named_scene("pushed", scene), subdomains=7, steps=2)
    solver = assemble(export, MPI.COMM_SELF).solver(Settings())
    boundary = solver.operator.structure.contact
    monkeypatch.setattr(type(solver.fixed_point.shortcut), "comes_first", first)
    before, steps = dissipation.without_contact(solver, boundary), solver.steps()
    for _ in steps:
        softness = solver.operator.softness
        assert softness.any()
        assert np.array_equal(dissipation.without_contact(solver, boundary), before)
        assert np.array_equal(solver.operator.softness, softness)
    assert np.isfinite(before).all() and before.any()


def test_what_sticks_takes_nothing():
    of = Dissipation(np.ones(1), np.zeros(1), np.zeros(1))
    one = {C.U_N: 0.0, C.SLIP: 1e-9, C.BOUND: 3.0, C.SIGMA_T: -2.9}
    assert of.add(1.0, {name: np.array([value]) for name, value in one.items()}) == 0.0


def test_what_opens_counts_until_it_does():
    """Pressure falls from 1 to zero at 0.6, between two of 4 steps, while the node slides on."""
    times = np.linspace(0, 1, 5)[1:]
    work = march(times, lambda t: max(0.0, 1 - t / 0.6), lambda t: t, start=F,
                 opening=lambda t: max(t - 0.6, 0.0))
    assert work == pytest.approx(2 * F * 0.6 / 2, rel=1e-12)


@pytest.mark.slow
def test_loads_that_stand_from_the_start_press_in_the_first_step_already(solved):
    """The wedge is driven under a load that does not change: as much work in few steps."""
    few, many = (solved("wedge", h=4, steps=steps).summary["dissipated"] for steps in (4, 16))
    assert few == pytest.approx(many, rel=2e-3)  # with half of the first step's: 12 % less


PAD = """include "scene.idp"
body = square(16, 8, [8.*x, 4.*y]);
quasistatic(1.);
macro young() 1e6 //
macro poisson() 0. //
macro contact() 1 //
macro friction() 0.3 //
macro load1() pressure(3, 2.) //
"""
FLOOR_MOVES = "macro support() on(3, u1 = 0.) //\nmacro obstacleX(t) 0.5*t //\n"
PAD_MOVES = "macro displacement2() on(3, u1 = -0.5) //\nmacro amplitude2(t) t //\n"


@pytest.mark.parametrize("motion", [FLOOR_MOVES, PAD_MOVES])
@pytest.mark.some(1)
def test_a_pad_under_a_standing_load_rubs_all_the_way(solved, named_scene, motion):
    """F p L s = 2.4, whichever of the two moves, in any number of steps; half of the first step's
    share would be missing. The elastic slip of about p L / E before it slides is not work.
    """
    for steps in (3, 10):
        run = solved(named_scene("pad", PAD + motion + 'include "export.idp"\n'), steps=steps)
        assert run.summary["dissipated"] == pytest.approx(2.4, rel=1e-4), steps


def test_a_load_of_nothing_changes_no_work(solved, named_scene):
    """Though its factor stands at time 0 while the other load begins to grow."""
    growing = PAD + PAD_MOVES + "macro amplitude1(t) t //\n"
    one, two = (solved(named_scene(name, growing + more + 'include "export.idp"\n'), steps=3)
                for name, more in (("one", ""), ("two", "macro load3() traction(2, 0., 0.) //\n")))
    assert one.summary["dissipated"] == pytest.approx(two.summary["dissipated"], rel=1e-9)


def test_the_work_of_a_cycle_counts_for_those_jumped_over_after_it():
    """Cycles of two steps after one; after the second of them three more are jumped over."""
    record = object.__new__(Record)
    record.work, record.repeats, record.cycle_work, record.jumped = [], [], [], 0.0
    record.cycles, record.dissipated = SimpleNamespace(length=2, period=3.0), 0.0
    for k, ends in enumerate((False, False, True, False, True)):
        record.work.append(np.array([1.0, 10.0]) * (k + 1))
        record.dissipated += 11 * (k + 1)
        record._count(SimpleNamespace(cycle=ends, skips=3 if k == 4 else 0))
    assert record.cycle_work == [11 * 5, 11 * 9] and record.jumped == 9.0
    assert record.repeats == [1, 1, 1, 4, 4]
    np.testing.assert_array_equal(np.sum(record.work, axis=0), [6 + 4 * 9, 60 + 40 * 9])
    assert record.dissipated == np.sum(record.work)


@pytest.mark.parametrize("stride", [0.3, 1.0, 1.7, 4.1, 13.0])
def test_contact_that_travels_takes_its_force_times_the_way(stride):
    """A roller presses with 5 on about seven nodes of a line and is drawn along it by any step.

    It passes nodes in less than a step where this is longer than its contact; some are never seen.
    """
    x, radius = np.linspace(0.0, 300.0, 301), 3.5
    of, total, way = Dissipation(np.ones(301), np.zeros(301), np.zeros(301)), 0.0, 40.0
    for time in np.arange(40.0, 260.0, stride):
        pressure = np.maximum(1 - ((x - time) / radius) ** 2, 0.0)
        pressure *= 5.0 / pressure.sum()
        state = {C.U_N: -np.maximum(((x - time) / radius) ** 2 - 1, 0.0), C.BOUND: F * pressure,
                 C.SLIP: np.full(301, time - way), C.SIGMA_T: -F * pressure}
        total, way = total + of.add(time, state).sum(), time
    assert total == pytest.approx(F * 5.0 * (way - 40.0), rel=0.05)
