"""Cycles: what they come to, against closed forms, enumeration and a theorem; jumps; misuse."""

import itertools
import types

import numpy as np
import pytest
from mpi4py import MPI

from driver.effects.cycles import Room
from driver.errors import InputError
from driver.estimates.levels import Levels
from driver.files import read_table
from driver.march.cycle_verdict import Choice, Past, geometric, judged, limit
from driver.march.cycles import Cycles
from driver.march.problem import assemble
from driver.options import Settings

TIGHT = {"rtol": 1e-11, "friction_rtol": 1e-10, "primal_rtol": 1e-9}
E, NU, P, F, U0, HEIGHT, WIDTH = 1000.0, 0.3, 4.0, 0.4, 0.02, 1.0, 2.0
G, OEDOMETER = E / (2 * (1 + NU)), E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))

# a periodic strip under uniform pressure and shear: every place is one Jenkins element
STRIP = """include "scene.idp"
real wears = physical("wears", 0.), amount = physical("amount", 0.02), held = physical("held", 0.);
subdomains("2x1");
rectangle(0., 2., 0., 1.);
macro young() 1000. //
macro poisson() 0.3 //
quasistatic(5.);
macro periodic() 2, 4 //
macro load1() pressure(3, (held > 0 ? 0. : 4.)) //
macro amplitude1(t) min(1., t) //
macro displacement2() on(3, u1 = amount) //
macro amplitude2(t) (t < 1. ? 0. : (t < 2. ? t - 1. : (t < 4. ? 3. - t : t - 5.))) //
macro contact() 1 //
macro friction() 0.4 //
macro wear() wears //
macro cycles() 4 //
macro cycleStart() 1. //
include "export.idp"
"""
# the same pressed by a given displacement, which wear relieves
HELD = ("macro displacement2() on(3, u1 = amount) //", """macro displacement1() on(3, u2 = -held) //
macro displacement2() on(3, u1 = amount) //""")


def cycles_of(run) -> dict:
    return read_table(run.directory / "cycles.csv")


def jenkins(cycles: int, steps: int, k: float = 0.0, held: float = 0.0):
    """Worn depth, slid way and work per area by cycle, of one elastic-frictional element.

    Under the pressure P, or pressed by `held`; a step is an implicit one, as in the driver.
    """
    quarter = steps // 4
    wave = np.r_[np.arange(1, quarter + 1), np.arange(quarter - 1, -quarter - 1, -1),
                 np.arange(-quarter + 1, 1)] / quarter * U0
    at, depth, last, rows = 0.0, 0.0, 0.0, []
    for _ in range(cycles):
        way, work, begun = 0.0, 0.0, depth
        for u in wave:
            p, slip = P, 0.0
            for _ in range(200):  # the depth of the step's end, by iteration
                worn = depth + k * abs(slip) * p
                p = P if not held else OEDOMETER * (held - worn) / HEIGHT
                trial = G * (u - at) / HEIGHT
                slip = np.sign(trial) * max(0.0, abs(trial) - F * p) * HEIGHT / G
            bound = F * p
            work += (last + bound) / 2 * abs(slip) if last else bound * abs(slip)
            last, at, depth, way = bound, at + slip, depth + k * abs(slip) * p, way + abs(slip)
        rows.append((depth - begun, way, work))
    return np.array(rows)


# ---------------------------------------------------------------------------- closed form

@pytest.fixture(scope="module")
def strip_scene(named_scene):
    """The strip, once for all tests of it."""
    return named_scene("strip", STRIP)


@pytest.fixture(scope="module")
def strip(solved, strip_scene):
    """The strip in four cycles of eight steps."""
    return solved(strip_scene, cells=2, steps=10, **TIGHT)


def test_a_sheared_strip_slips_to_and_fro(strip):
    """Every cycle but the first slides 4 (U0 - F p H/G) and dissipates F p times that."""
    found = cycles_of(strip)
    way = 4 * (U0 - F * P * HEIGHT / G)
    np.testing.assert_allclose(found["slip"][1:], way, rtol=1e-7)
    np.testing.assert_allclose(found["dissipated"][1:], F * P * WIDTH * way, rtol=1e-7)
    assert list(found["kind"][1:]) == ["alternating slip"] * 3
    assert list(found["settled"]) == ["no", "no", "yes", "yes"]
    assert found["change"][2:].max() < 1e-7 and found["drift"][2:].max() < 1e-8 * way
    assert list(found["time"]) == [5, 9, 13, 17] and strip.summary["t_end"] == 17
    assert strip.summary["cycles"]["settled_after"] == 3


def test_the_history_is_repeated_in_all_tables(strip):
    """Amplitudes, steps and times; the work of all steps is that of what came before and cycles."""
    amplitude = strip.history["amplitude_2"]
    assert len(amplitude) == 2 + 4 * 8
    np.testing.assert_array_equal(amplitude[2:].reshape(4, 8), np.tile(amplitude[2:10], (4, 1)))
    np.testing.assert_allclose(strip.history["time"], 0.5 * np.arange(1, 35), rtol=1e-12)
    assert strip.history["dissipated"][-1] == pytest.approx(
        strip.history["dissipated"][1] + cycles_of(strip)["dissipated"].sum(), rel=1e-12)


# a block that an obstacle rubs to and fro under a pressure that varies as well
RUBBED = """include "scene.idp"
subdomains("2x1");
rectangle(0., 2., 0., 1.);
macro young() 1000. //
macro poisson() 0.3 //
quasistatic(3.);
macro support() on(3, u1 = 0.) //
macro load1() pressure(3, 4.) //
macro amplitude1(t) (min(1., t) + 0.3*sin(pi*t)^2) //
macro contact() 1 //
macro friction() 0.4 //
macro obstacleX(t) (0.01*sin(pi*t)*min(1., t)) //
macro cycles() 3 //
macro cycleStart() 1. //
include "export.idp"
"""


@pytest.mark.slow
def test_a_repeated_history_is_the_long_one_written_out(solved, scene):
    """Loads and an obstacle that moves, to the tolerances: histories differ in their last digits.
    """
    tight = {"cells": 2, **TIGHT}
    cycles = solved(scene(RUBBED, name="cycles"), steps=12, **tight)
    long = solved(scene(RUBBED, ("quasistatic(3.)", "quasistatic(7.)"),
                        ("macro cycles() 3 //\nmacro cycleStart() 1. //\n", ""), name="long"),
                  steps=28, **tight)
    np.testing.assert_allclose(cycles.history["time"], long.history["time"], rtol=1e-12)
    for name in ("sigma_n", "sigma_t", "u_t", "slip"):
        np.testing.assert_allclose(cycles.contact[name], long.contact[name], rtol=0,
                                   atol=1e-6 * np.abs(long.contact[name]).max())
    assert cycles.history["dissipated"][-1] == pytest.approx(long.history["dissipated"][-1],
                                                             rel=1e-6)


@pytest.mark.slow  # further runs
@pytest.mark.parametrize("words, cycles", [("until settled", 3), ("2 until settled", 2), ("7", 7)])
def test_cycles_as_many_as_asked_for(solved, named_scene, words, cycles):
    """The scene's number is overridden; a run that has not settled says so."""
    run = solved(named_scene("strip", STRIP), cells=2, steps=10, cycles=words)
    assert len(cycles_of(run)["cycle"]) == cycles == run.summary["cycles"]["number"]
    assert run.summary["steps"] == 2 + 8 * cycles
    unsettled = any("not settled" in line for line in run.summary["warnings"])
    assert unsettled == (words == "2 until settled")


@pytest.mark.parametrize("changes, plan, remaining", [
    ([], [], 1.0), ([1.0], [0], 1.0), ([1.0, 0.2], [0, 0], 1.0),
    ([1.0, 0.4, 0.2], [0, 0, 0], 0.1), ([1.0, 20.0, 0.2], [0, 0, 0], 0.1),
    ([1.0, 0.25, 0.2], [0, 0, 0], 0.4), ([1.0, 8.0, 0.1], [0, 0, 0], 1.0),
    ([1.0, 0.0, 0.2], [0, 0, 0], 1.0),
    ([1.0, 0.4, 0.2], [0, 0, 3], 1.0), ([1.0, 0.4, 0.2], [0, 3, 0], 1.0),
    ([1.0, 0.4, 0.2], [3, 0, 0], 1.0)])
def test_what_is_to_come_is_told_from_three_changes_without_a_jump(changes, plan, remaining):
    """The last is 0.1: with 0.2 before it what follows is 0.1 again, a geometric series, and more
    if the one before that had fallen by less. Of changes that do not get smaller nothing is known,
    nor of two: the first fall is that of a transient. After a jump it is the mean one.
    """
    row = {"slip": 1.0, "drift": 0.0}
    past = Past(len(changes) + 1, plan, [row | {"change": change} for change in changes],
                before={"normal": np.array([9.0, 5.0])} if changes else {}, way=np.ones(2))
    found = judged(past, types.SimpleNamespace(index=8, time=1.0), {"u_t": np.zeros(2)},
                   {"normal": np.array([10.0, 5.0])},
                   lambda *parts: max(float(np.abs(part).max()) for part in parts), 1e-9, 1e-6)
    skipped = plan[-1] if plan else 0
    assert found.change == pytest.approx(0.1 / (1 + skipped) if changes else 1.0)
    assert found.remaining == pytest.approx(remaining)


@pytest.mark.parametrize("older, before, plan, remaining", [
    (10 - 4e-5, 10 - 2e-5, [0, 0], 1.0), (10 - 5e-5, 10 - 2e-5, [0, 0], 1.0),
    (10.0, 10 - 2e-5, [0, 0], 2e-6), (10 + 1e-5, 10 - 2e-5, [0, 0], 2e-6),
    (10 - 4e-7, 10 - 2e-7, [0, 0], 2e-8), (10 - 4e-5, 10 - 2e-5, [0, 3], 5e-7),
    (10 - 4e-5, 10 - 2e-5, [3, 0], 2e-6), (10 - 4e-5, 10 - 2e-4, [0, 3], 1.0)])
def test_small_changes_that_go_on_are_not_what_tolerances_leave_open(older, before, plan,
                                                                     remaining):
    """Forces of three cycles, the last 10, of which tolerances leave 9e-6 open: changes by less
    count if they add up over two cycles and are no less than residuals. Over a jump the difference
    itself is compared, as no jump makes rounding larger.
    """
    last = abs(before - older) / 10
    past = Past(3, plan, [{"change": 1.0}, {"change": last}], before={"n": np.array([before, 5.0])},
                older={"n": np.array([older, 5.0])}, way=np.ones(2))
    past.rows = [row | {"slip": 1.0, "drift": 0.0} for row in past.rows]
    found = judged(past, types.SimpleNamespace(index=8, time=1.0), {"u_t": np.zeros(2)},
                   {"n": np.array([10.0, 5.0])},
                   lambda *parts: max(float(np.abs(part).max()) for part in parts), 1e-9, 9e-6)
    assert found.remaining == pytest.approx(remaining)


@pytest.mark.slow  # many cycles
def test_slow_wear_has_not_settled(solved, named_scene):
    """A held strip loses 1e-5 of its pressure in every cycle, and half of it in 70,000: that is a
    third of what tolerances leave open between cycles (`settled` had been said after the third).
    """
    k = 1e-5 / (OEDOMETER * 4 * (U0 - F * P / G))
    run = solved(named_scene("held", STRIP.replace(*HELD)), cells=2, steps=10, wears=k,
                 held=P / OEDOMETER, cycles="6 until settled")
    found = cycles_of(run)
    assert 0.8e-5 < found["change"][2:].min() < found["change"][2:].max() < 1.2e-5
    assert list(found["settled"]) == ["no"] * 6 and found["remaining"].min() > 0.1
    assert any("not settled" in line for line in run.summary["warnings"])


@pytest.mark.parametrize("jumped, given", [([0, 3], None), ([0], [0, 3])])
def test_a_history_is_as_long_as_its_cycles_that_are_computed(jumped, given):
    """Two steps, then five cycles of eight, of which three are jumped over, as known or given."""
    cycles = types.SimpleNamespace(begin=2, length=8, count=5, past=Past(plan=jumped), given=given)
    assert Cycles.total.fget(cycles) == 2 + 8 * 2


@pytest.mark.parametrize("stride, steps", [
    (1, 34), pytest.param(2, 17, marks=pytest.mark.slow)])
def test_a_companion_is_announced_with_the_steps_of_all_its_cycles(exported, strip_scene, stride,
                                                                   steps):
    announced = []
    problem = assemble(exported(strip_scene, cells=2, steps=10), MPI.COMM_SELF)
    watch = types.SimpleNamespace(begin=announced.append, end=lambda: None,
                                  update=lambda: announced.append("step"))
    levels = Levels(strip_scene, {}, None, MPI.COMM_SELF, Settings(), watch=watch)
    levels.problems[()] = problem
    levels.run(Settings(), stride, [0] * 4)
    assert announced == [steps, *["step"] * steps]


@pytest.mark.parametrize("given, settles, settled, warned", [
    (None, True, False, True), (None, True, True, False), (None, False, False, False),
    (7, True, False, False)])
def test_only_who_waits_for_cycles_to_settle_is_told_that_they_have_not(given, settles, settled,
                                                                        warned):
    march = types.SimpleNamespace(given=given, choice=types.SimpleNamespace(settles=settles),
                                  past=types.SimpleNamespace(number=2, rows=[{"settled": settled}]))
    assert bool(Cycles.warnings(march)) == warned


def test_a_little_shear_shakes_down_at_once(solved, named_scene):
    """Below F p H/G nothing slides: settled after one cycle."""
    run = solved(named_scene("strip", STRIP), cells=2, steps=5, amount=0.9 * F * P / G,
                 cycles="until settled")
    found = cycles_of(run)
    assert list(found["kind"]) == ["shakedown"] and list(found["settled"]) == ["yes"]
    assert found["slip"][0] == 0 and found["dissipated"][0] == 0


# ---------------------------------------------------------------------------- wear and jumps

@pytest.mark.slow
@pytest.mark.parametrize("wears", [1e-4, 1e-12])
@pytest.mark.some(1)
def test_steady_wear_is_jumped_over_exactly(solved, named_scene, wears):
    """Under a given pressure every cycle wears off k p 4 (U0 - F p H/G): no jump errs.

    However little that is: the slip has to count, not the wear.
    """
    run = solved(named_scene("strip", STRIP), cells=2, steps=10, wears=wears, cycles="1000 jump",
                 **TIGHT)
    found, each = cycles_of(run), wears * P * 4 * (U0 - F * P * HEIGHT / G)
    first, _, _ = jenkins(1, 8, wears)[0]
    assert len(found["cycle"]) < 10 and found["cycle"][-1] == 1000 and run.summary["t_end"] == 4001
    assert list(found["kind"][1:]) == ["wear"] * (len(found["kind"]) - 1)
    assert run.contact["wear"][-1].max() == pytest.approx(first + 999 * each, rel=1e-6)
    # of the slip, where that is more, it says what tolerances leave open
    assert run.summary["cycles"]["error"] < max(1e-6 * 1000 * each, 1e-8 * 1000 * U0)
    work = F * P * WIDTH * (3 * (U0 - F * P / G) + max(0, U0 - 2 * F * P / G)
                            + 999 * 4 * (U0 - F * P / G))
    assert run.summary["quantities"]["dissipated_energy"] == pytest.approx(work, rel=1e-6)
    assert run.summary["quantities"]["slip"] == pytest.approx(work / (F * P * WIDTH), rel=1e-6)


@pytest.mark.slow  # a long run
def test_jumps_err_by_no_more_than_they_say(solved, named_scene):
    """Pressed by a given displacement, which wear relieves: the growth fades, jumps are short.

    Against 200 cycles of one element, which the run without jumps follows to its tolerances.
    """
    scene = named_scene("held", STRIP.replace(*HELD))
    held, k = P / OEDOMETER, 2e-5
    options = {"cells": 2, "steps": 10, "wears": k, "held": held}
    every = jenkins(200, 8, k, held)
    few = solved(scene, cycles=6, **options, **TIGHT)
    np.testing.assert_allclose(cycles_of(few)["wear"], every[:6, 0], rtol=1e-5)
    np.testing.assert_allclose(cycles_of(few)["slip"], every[:6, 1], rtol=1e-5)
    np.testing.assert_allclose(cycles_of(few)["dissipated"], WIDTH * every[:6, 2], rtol=1e-5)
    jumped = solved(scene, cycles="200 jump 2%", **options, **TIGHT)
    depth, stated = jumped.contact["wear"][-1].max(), jumped.summary["cycles"]["error"]
    assert jumped.summary["cycles"]["skipped"] > 100
    error = abs(depth - every[:, 0].sum())
    assert 0 < error < stated < 0.04 * depth


@pytest.mark.slow  # companions of all kinds
def test_quantities_after_jumps_carry_their_error(solved, named_scene):
    """In the budget of the same strip: no less than what 200 cycles of the element tell.

    The stated errors are four times what jumps half as long change, the true ones twice that.
    """
    held, k = P / OEDOMETER, 2e-5
    run = solved(named_scene("held", STRIP.replace(*HELD)), cells=4, steps=10, wears=k, held=held,
                 cycles="200 jump 2%", errors="yes")
    depth, way, work = jenkins(200, 8, k, held).sum(axis=0)
    exact = {"worn_volume": WIDTH * depth, "dissipated_energy": WIDTH * work, "slip": way}
    budget = run.summary["errors"]["quantities"]
    for name, value in exact.items():
        error = abs(budget[name]["value"] - value)
        assert error < budget[name]["jumps"] < 4 * error, name
        assert budget[name]["total"] >= budget[name]["jumps"]
    assert 'CYCLES="200 jump 1%"' in run.summary["errors"]["advice"]
    lines = run.summary["errors"]["prices"]["lines"]
    assert all("CYCLES" in line["settings"] for line in lines if "settings" in line)


# ---------------------------------------------------------------------------- by enumeration

def stiffness(problem, young: float = E) -> tuple[np.ndarray, np.ndarray]:
    """K of plane strain by the triangles of the mesh, written out here; places of its nodes."""
    sub, = problem.subdomains
    D = young / ((1 + NU) * (1 - 2 * NU)) * np.array(
        [[1 - NU, NU, 0], [NU, 1 - NU, 0], [0, 0, 0.5 - NU]])
    K = np.zeros((2 * len(sub.xy), 2 * len(sub.xy)))
    for nodes in sub.triangles:
        x, y = sub.xy[nodes].T
        b, c = y[[1, 2, 0]] - y[[2, 0, 1]], x[[2, 0, 1]] - x[[1, 2, 0]]
        area, B = 0.5 * abs(x @ b), np.zeros((3, 6))
        B[0, ::2], B[1, 1::2], B[2, ::2], B[2, 1::2] = b, c, c, b
        B /= 2 * area
        dofs = np.column_stack([2 * nodes, 2 * nodes + 1]).ravel()
        K[np.ix_(dofs, dofs)] += area * B.T @ D @ B
    return K, sub.xy


def enumerated(K, feet, force, u_t, coefficient):
    """Displacements and forces of feet in one step: those of all states that are admissible.

    A foot is open, sticks at `u_t` or slides one way or the other.
    """
    n, size, found = len(K), len(K) + 2 * len(feet), []
    for states in itertools.product(("open", "stick", 1, -1), repeat=len(feet)):
        A, rhs = np.zeros((size, size)), np.zeros(size)
        A[:n, :n], rhs[:n] = K, force  # unknown u, N and T of the feet: K u - N e_y - T e_x = f
        for k, (foot, state) in enumerate(zip(feet, states)):
            N, T = n + 2 * k, n + 2 * k + 1
            A[2 * foot + 1, N] = A[2 * foot, T] = -1.0
            A[N, N if state == "open" else 2 * foot + 1] = 1.0
            if state == "stick":
                A[T, 2 * foot], rhs[T] = 1.0, u_t[k]
            else:
                A[T, T] = 1.0
                if state != "open":
                    A[T, N] = state * coefficient  # T = -state F N
        if np.linalg.cond(A) > 1e12:
            continue
        z = np.linalg.solve(A, rhs)
        N, T, x, y = z[n::2], z[n + 1::2], z[2 * np.array(feet)], z[2 * np.array(feet) + 1]
        small = 1e-12 * np.abs(force).sum()
        if all({"open": lambda k: y[k] >= 0,
                "stick": lambda k: N[k] >= 0 and abs(T[k]) <= coefficient * N[k] + small}.get(
                    state, lambda k, state=state: N[k] >= 0 and state * (x[k] - u_t[k]) > 0)(k)
               for k, state in enumerate(states)):
            found.append((states, z[:n], N, T))
    return found


def rocking(xy, tops, turn: float) -> np.ndarray:
    """Nodal forces of the scene `walking` on the top: p (1 + 1.2 turn x/a) down, 0.45 p along."""
    force, p, a = np.zeros(2 * len(xy)), 10.0, 10.0
    for i, k in zip(tops, tops[1:]):
        length = xy[k, 0] - xy[i, 0]
        own, other = (p * (1 + 1.2 * turn * xy[node, 0] / a) for node in (i, k))
        force[[2 * i, 2 * k]] += 0.45 * p * length / 2
        force[2 * i + 1] -= length * (2 * own + other) / 6
        force[2 * k + 1] -= length * (own + 2 * other) / 6
    return force


@pytest.mark.slow
def test_three_feet_walk_as_all_their_states_say(solved, built):
    """A block of two cells: in each step of four cycles one solution in the 4^3 states of its feet.

    It walks by the same way in every cycle.
    """
    run = solved("walking", cells=1, subdomains="1x1", steps=8, cycles=4, push=0.45, rock=1.2,
                 **TIGHT)
    K, xy = stiffness(built("walking", reduce=False, cells=1, subdomains="1x1", steps=8), 2000.0)
    feet = [int(np.flatnonzero((np.abs(xy - place) < 1e-9).all(axis=1))[0])
            for place in run.contact["x"][0][:, None] * [1, 0]]
    tops = np.flatnonzero(xy[:, 1] > 9)
    tops, u_t, walked = tops[np.argsort(xy[tops, 0])], np.zeros(len(feet)), []
    for step in range(4 * 8):
        force = rocking(xy, tops, np.sin(2 * np.pi * ((step + 1) % 8) / 8))
        found = enumerated(K, feet, force, u_t, 0.5)
        _, u, N, T = found[0]  # in several states at once where they are on the verge
        assert all(np.abs(other - u).max() < 1e-10 for _, other, _, _ in found)
        names = [[state if isinstance(state, str) else "slip" for state in states]
                 for states, *_ in found]
        assert list(run.contact["status"][step]) in names
        weight, tangent = run.contact["weight"][step], -run.contact["normal_y"][step]
        np.testing.assert_allclose(-run.contact["sigma_n"][step] * weight, N, rtol=1e-7, atol=1e-6)
        np.testing.assert_allclose(run.contact["sigma_t"][step] * weight * tangent, T, rtol=1e-7,
                                   atol=1e-6)
        u_t = u[2 * np.array(feet)]
        np.testing.assert_allclose(run.contact["u_t"][step] * tangent, u_t, rtol=1e-6,
                                   atol=1e-8 * np.abs(u_t).max())
        walked.append(u_t)
    way = np.diff(np.array(walked)[7::8], axis=0)
    found = cycles_of(run)
    assert way.min() > 0 and np.ptp(way) < 1e-9 * way.max()
    np.testing.assert_allclose(found["drift"][1:], way.max(axis=1), rtol=1e-6)
    assert list(found["kind"]) == ["ratcheting"] * 4 and found["settled"][-1] == "yes"


# ---------------------------------------------------------------------------- theorem

# two blocks that mirror each other: shear moves neither off the other, contact is uncoupled
MIRROR = """include "scene.idp"
real shear = physical("shear", 1e-4), before = physical("before", 0.);
real F = physical("friction", 1e3);
int[int] lower = [11, 12, 13, 14];
addBody(square(6, 4, [2.*x - 1., y], flags = 1))
addBody(square(6, 4, [2.*x - 1., y - 1.], flags = 1, label = lower))
macro young() 1e3 //
macro poisson() 0.3 //
quasistatic(5.);
macro displacement1() on(3, u2 = -1e-3) + on(11, u2 = 1e-3) //
macro amplitude1(t) min(1., t) //
macro displacement2() on(3, u1 = shear) + on(11, u1 = -shear) //
macro amplitude2(t) (t < 1. ? 0. : sin(0.5*pi*(t - 1.))) //
macro contactPair() 1, 13 //
macro friction() F //
macro initialX() before*x //
macro cycles() 40 //
macro cycleStart() 1. //
include "export.idp"
"""
STEPS = 10  # eight of which are a cycle, which so has its extremes


@pytest.mark.slow  # five runs
def test_uncoupled_contact_shakes_down_just_where_it_can(solved, named_scene):
    """Klarbring, Ciavarella, Barber (2007): Melan's theorem holds for uncoupled contact.

    Residual forces of the closed nodes may be any, so cycles can shake down as long as at every
    node the range of the elastic shear force is below twice the bound: 2 F p >= max q - min q. They
    do so, from any initial state, up to 0.97 of this limit, and do not from 1.03 of it on.
    """
    scene, shear, friction = named_scene("mirror", MIRROR), 1e-4, 0.3
    options = {"steps": STEPS, "subdomains": 2}
    stuck = solved(scene, shear=shear, cycles=1, **options, **TIGHT)
    assert (stuck.contact["status"][1:] == "stick").all()
    last, weight = slice(2, None), stuck.contact["weight"]
    q, p = (stuck.contact[name][last] * weight[last] for name in ("sigma_t", "sigma_n"))
    # uncoupled: shear changes no pressure
    assert np.ptp(p, axis=0).max() < 1e-7 * np.abs(p).max()
    limit = shear * (2 * friction * -p[0] / np.ptp(q, axis=0)).min()
    for part, kind in ((0.97, "shakedown"), (1.03, "alternating slip")):
        for before in (0.0, 3e-4):
            run = solved(scene, shear=part * limit, friction=friction, before=before,
                         cycles="until settled", **options, **TIGHT)
            assert run.summary["cycles"]["last"]["kind"] == kind
            assert run.summary["cycles"]["settled_after"] is not None


# ---------------------------------------------------------------------------- judgement

def test_series_of_cycles_are_summed_as_geometric_ones():
    """Changes of 0.8 each time add up to c q/(1 - q); what ends in nothing tends to nothing."""
    changes = 3.0 * 0.8 ** np.arange(100)
    assert geometric(changes[4], 0.8) == pytest.approx(changes[5:].sum(), rel=1e-6)
    assert geometric(1.0, 1.0) == np.inf and geometric(0.0, 0.5) == 0
    assert limit(*(2 + changes[:3])) == pytest.approx(2) and limit(1, 2, 4) == np.inf
    assert limit(*changes[:3]) == pytest.approx(0, abs=1e-12) and limit(1, 1, 1) == 1


@pytest.mark.parametrize("words, expected", [
    ("all", Choice()), ("12", Choice(12)), ("until settled", Choice(settles=True)),
    ("jump", Choice(jumps=0.01)), ("30 jump 0.5%", Choice(30, jumps=0.005)),
    ("7 until settled", Choice(7, True))])
def test_words_of_the_option(words, expected):
    assert Choice.of(words) == expected


# ---------------------------------------------------------------------------- misuse

@pytest.mark.parametrize("changes, options, reason", [
    ([("quasistatic(5.);", "")], {}, "the scene is static"),
    ([("macro friction() 0.4 //\n", ""), ("macro wear() wears //\n", "")], {},
     "cycles is declared without friction"),
    ([("macro cycles() 4 //", "macro cycles() 0 //")], {}, "whole number of at least 1"),
    ([("macro cycleStart() 1. //", "macro cycleStart() 5. //")], {}, "no cycle begins at 5"),
    ([("macro cycleStart() 1. //", "macro cycleStart() 2. //")], {}, "when the cycle begins"),
    ([("macro friction() 0.4 //", "macro friction() 0.4 //\nmacro largeSliding() 1 //"),
      ("macro wear() wears //\n", "")], {}, "where contact follows the motion"),
    ([], {"steps": 7}, "no step ends at cycleStart"),
    ([("macro contact() 1 //", "macro contact() 1 //\nmacro obstacleX(t) t //")], {},
     "an obstacle is at another place"),
    ([], {"cycles": "settled"}, "expects a number of cycles"),
    ([("macro cycles() 4 //\n", ""),
      ("macro cycleStart() 1. //\n", "")], {"cycles": 3}, "declares no cycles"),
    ([], {"cycles": "until settled", "accuracy": "5%", "cells": ""},
     "give their number"),
])
@pytest.mark.some(5)
def test_misuse_is_refused_in_one_line(solved, scene, changes, options, reason):
    options = {name: value for name, value in {"cells": 2, **options}.items() if value}
    run = solved(scene(STRIP, *changes), **options)
    assert run.status == 2 and reason in run.reason and "\n" not in run.reason


@pytest.mark.parametrize("history, closed", [
    ((0.0, 1e-16, -2e-16, 4e-16, -5e-16), True), ((0.0, 1.0, 0.0, -1.0, 1e-12), True),
    ((0.0, 1.0, 0.0, -1.0, 1e-6), False)])
def test_a_cycle_closes_but_for_rounding(history, closed):
    """Steps at the zeros of a sine alone see nothing but rounding: no cycle that stays open."""
    manifest = types.SimpleNamespace(rooms={"cycles": {"start": 0, "count": 3}}, steps=4, t_end=1.0,
                                     patterns=[], labels=[], amplitudes={1: history})
    if closed:
        assert Room("cycles", manifest).repeats == (0, 3)
    else:
        with pytest.raises(InputError, match="a cycle must end as it begins, but amplitude1"):
            Room("cycles", manifest)


@pytest.mark.parametrize("size", [1e-2, 1.0, 1e6])
def test_a_history_of_any_size_comes_back_to_its_digits(size):
    """A millionth of a millionth is rounding, a millionth is not; near zero a thousandth counts."""
    def room(missed):
        return Room("cycles", types.SimpleNamespace(
            rooms={"cycles": {"start": 1, "count": 2}}, steps=3, t_end=3.0, patterns=[],
            amplitudes={1: np.array([0.0, size, -size, size + missed])}))

    assert room(1e-12 * size).repeats == (1, 2)
    for missed in (1e-6 * size, -1e-6 * size):
        with pytest.raises(InputError, match="a cycle must end as it begins"):
            room(missed)
