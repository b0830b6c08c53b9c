"""Bodies that contact and friction alone hold: found, refused, solutions counted, against
enumeration on the whole body.
"""

import itertools
import re
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.qp import complementarity
from driver.errors import NotConverged
from driver.march import fixed_point as fixedpoint, globalization, shortcut, tightening
from driver.march.friction_qp import FrictionQP
from driver.march.step import Unfinished
from driver.qp.coulomb import CoulombProblem
from driver.contact import equilibrium
from driver.contact.equilibrium import rigid_equilibrium
from driver.feti import free_motions
from driver.hard.oracle import Assembled

WEIGHED = """// a block that its weight alone presses on a floor, between walls; warm in the middle
include "scene.idp"
real warm = physical("warm", 0.), room = physical("room", 0.);
units("1", "1");
subdomains("3");
body = square(6, 4, [1.4*x, y]);
macro young() 1. //
macro poisson() 0. //
macro bodyForce1() [0., -1e-4] //
macro thermal2() (warm*(y - y^2)*x) //
macro contact() 1, 2, 3, 4 //
macro gap() (label == 1 ? 0. : room) //
macro friction() (label == 4 ? 0. : 0.6) //
include "export.idp"
"""

LET_GO = """// a block pressed askew against a wall that it sticks to, then let go
include "scene.idp"
units("1", "1");
subdomains("1");
quasistatic(1.);
body = square(5, 4, [1.1*x, y]);
macro young() 1. //
macro poisson() 0.2 //
macro load1() traction(4, 2.4e-4, -1.8e-4) //
macro contact() 1, 2 //
macro gap() (label == 2 ? 0. : 1e-3) //
macro tresca() (label == 2 ? 1e-3 : 0.) //
macro amplitude1(t) (1. - abs(2*t - 1.)) //
include "export.idp"
"""


UNLOADED = """// a punch squeezes a block on a floor with Tresca friction, and goes
include "scene.idp"
units("1", "1");
quasistatic(1.);
int[int] low = [1, 2, 3, 2], high = [4, 5, 6, 5];
addBody(square(9, 4, [3.*x, y], label = low))
bodyMaterial("block", 100., 0.3);
addBody(square(6, 3, [0.6 + 1.4*x, 1. + (1 + 0.2*(x - 0.6)^2)*y + 0.2*(x - 0.6)^2], label = high))
bodyMaterial("punch", 300., 0.3);
macro contact() 1 //
macro contactPair() 4, 3 //
macro friction() (label == 4 ? 0.2 : 0.) //
macro tresca() (label == 1 ? 0.02 : 0.) //
macro displacement1() on(6, u1 = 0.03, u2 = -0.06) //
macro amplitude1(t) (1. - abs(2*t - 1.)*1.5) //
include "export.idp"
"""

# an L on its foot, that rollers keep from moving sideways at its shoulder: it may turn
ELL = """include "scene.idp"
units("um", "MPa");
subdomains("1");
real slipRange = 0.1;
quasistatic(1.);
border a0(t=0, 1) { x = 1099.8648 + 342.233*t; y = 0.; label = 1; }
border a1(t=0, 1) { x = 1442.0978 + 633.9022*t; y = 0.; label = 2; }
border a2(t=0, 1) { x = 2076.; y = 1104.*t; label = 11; }
border a3(t=0, 1) { x = 2076.*(1. - t); y = 1104.; label = 21; }
border a4(t=0, 1) { x = 0.; y = 1104. - 431.664*t; label = 31; }
border a5(t=0, 1) { x = 1099.8648*t; y = 672.336; label = 41; }
border a6(t=0, 1) { x = 1099.8648; y = 672.336*(1. - t); label = 51; }
mesh Th0 = buildmesh(a0(2) + a1(2) + a2(2) + a3(5) + a4(2) + a5(2) + a6(2));
body = Th0;
macro young() (y < 429. ? 3000. : 3.) //
macro poisson() 0.45 //
macro support() on(41, u1 = 0.) //
macro load1() pressure(21, 0.009487) //
macro contact() 1, 2 //
macro friction() 0.1 //
macro displacementFactor(s) (1. + (0.4 - 1.)*s/slipRange) //
macro amplitude1(t) t //
include "export.idp"
"""

# a plate on rollers that is pushed sideways, with a pin in its hole that may pull
PIN = """include "scene.idp"
units("1", "1");
subdomains("1");
border a0(t=0, 1) { x = 1.604*t; y = 0.; label = 1; }
border a1(t=0, 1) { x = 1.604; y = 1.798*t; label = 11; }
border a2(t=0, 1) { x = 1.604*(1. - t); y = 1.798; label = 21; }
border a3(t=0, 1) { x = 0.; y = 1.798*(1. - t); label = 31; }
border a4(t=0., -6.283185307179586) { x = 0.802 + 0.3611*cos(t); y = 0.899 + 0.3611*sin(t);
                                      label = 91; }
mesh Th0 = buildmesh(a0(7) + a1(8) + a2(7) + a3(8) + a4(10));
border b0(t=-2.3561944901923444, 3.926990816987241) { x = 0.802 + 0.359294*cos(t);
                                                      y = 0.899 + 0.359294*sin(t); label = 101; }
mesh Th1 = buildmesh(b0(16));
addBody(Th0)
addBody(Th1)
macro planeStress() 1 //
macro young() 1. //
macro poisson() 0.45 //
macro support() on(1, u2 = 0.) //
macro load1() traction(21, 0.0005, -0.005) //
macro contactPair() 91, 101 //
macro pairGap() 0.005*(x - 0.802)^2 //
macro tresca() 0.0005 //
macro bilateral() 1 //
include "export.idp"
"""


def enumerated(K, f, B, gap, u_t, F) -> list[np.ndarray]:
    """Multipliers (2 n,) of all states of contact of a body, held or not, that obey the laws.

    Every state is one linear system in all displacements and multipliers, K u + B'lambda = f with
    the singular K as it is: no compliance, no springs, no rigid motions. `B` (2 n, dofs) normal
    rows first. Where a system is singular its solution of least norm is tried: motions that nothing
    holds stay small.
    """
    n, size = len(gap), len(f)
    stiff, found = np.abs(np.diag(K)).max(), []
    for state in itertools.product("osfb", repeat=n):  # open, stick, forward, backward
        rows, right = np.zeros((2 * n, size + 2 * n)), np.zeros(2 * n)
        for i, s in enumerate(state):
            N, T = size + i, size + n + i
            if s == "o":
                rows[i, N] = rows[n + i, T] = 1 / stiff
                continue
            rows[i, :size], right[i] = B[i], gap[i]
            if s == "s":
                rows[n + i, :size], right[n + i] = B[n + i], u_t[i]
            else:
                rows[n + i, [T, N]] = 1 / stiff, (-F[i] if s == "f" else F[i]) / stiff
        system = np.vstack([np.hstack([K, B.T]), stiff * rows])
        right = np.append(f, stiff * right)
        z = np.linalg.lstsq(system, right, rcond=1e-11)[0]
        if np.abs(system @ z - right).max() > 1e-8 * np.abs(right).max():
            continue
        u, x = z[:size], z[size:]
        over, slip = B[:n] @ u - gap, B[n:] @ u - u_t
        far, force = np.abs(B @ u).max(), np.abs(x).max() + np.abs(f).max()
        way = np.array([{"o": 0, "s": 0, "f": 1, "b": -1}[s] for s in state])
        touching = np.array([s != "o" for s in state])
        if (x[:n].min() >= -1e-8 * force and over[~touching].max(initial=0) <= 1e-8 * far
                and np.all(np.abs(x[n:]) <= F * x[:n] + 1e-8 * force)
            and np.all(way * slip >= -1e-8 * far)
                and all(np.abs(x - y).max() > 1e-6 * force for y in found)):
            found.append(x)
    return found


def random_body(seed: int, nodes: int, modes: int):
    """A singular stiffness with `modes` motions, contact rows and loads that these could balance,
    at random.
    """
    rng = np.random.default_rng(seed)
    size = 2 * nodes + 3
    Z = np.linalg.qr(rng.standard_normal((size, modes)))[0]
    root = rng.standard_normal((size, size + 2))
    P = np.eye(size) - Z @ Z.T
    K, B = P @ root @ root.T @ P, rng.standard_normal((2 * nodes, size))
    F = rng.uniform(0.1, 3.0, nodes)
    normal = rng.uniform(0.2, 1.0, nodes)
    # forces inside the cone: rigid bodies can rest
    held = B.T @ np.append(normal, rng.uniform(-1, 1, nodes) * F * normal)
    f = Z @ (Z.T @ held) + P @ rng.standard_normal(size)
    return K, f, B, rng.uniform(-0.1, 0.1, nodes), rng.uniform(-0.1, 0.1, nodes), F, Z


def condensed(K, f, B, gap, u_t, F, Z) -> CoulombProblem:
    """The same on springs of some stiffness, as the driver has it."""
    held = np.linalg.inv(K + Z @ Z.T)
    return CoulombProblem(B @ held @ B.T, B @ held @ f - np.append(gap, u_t), F, np.arange(len(F)),
                          False, B @ Z, Z.T @ f)


@pytest.mark.parametrize("nodes, modes", [(1, 1), (2, 1), (2, 2), (3, 3)])
@pytest.mark.some(2)
def test_all_solutions_are_those_of_the_body(nodes, modes):
    """As many and the same, none, one or several; Lemke's and Newton's are among them."""
    numbers = []
    for seed in range(30):
        body = random_body(seed, nodes, modes)
        expected, problem = enumerated(*body[:-1]), condensed(*body)
        found = complementarity.all_solutions(problem)
        assert len(found) == len(expected), seed

        def among(z):
            return any(np.abs(z[: problem.rows] - x).max() <= 1e-6 * np.abs(x).max()
                       for x in expected)

        assert all(among(z) for z in found), seed
        start = complementarity.newton(problem, np.zeros(2 * nodes + modes))
        assert start is None or among(start), seed
        z = complementarity.lemke(problem)
        assert z is None or among(z), seed
        assert (z is None) == (not expected), seed
        numbers.append(len(expected))
    assert len(set(numbers)) > 1, "look for seeds with none or several"


def test_motion_that_nothing_holds_by_hand():
    """Two nodes on motions of their own; the load presses the first with 1, and the second is 1
    away, or overlaps by 1.

    C = 1 and springs of stiffness 1: the first moves on by 1 to be pressed with 1. The second stays
    where it is, or leaves until it touches.
    """
    for over, moved in ((-1.0, 0.0), (1.0, -1.0)):
        problem = CoulombProblem(np.eye(2), np.array([0.0, over]), np.zeros(0), np.zeros(0, int),
                                 False, np.eye(2),
                                 np.array([1.0, 0.0]))
        for z in (complementarity.lemke(problem), *complementarity.all_solutions(problem)):
            np.testing.assert_allclose(z, [1.0, 0.0, 1.0, moved], atol=1e-12)


# ------------------------------------------------------------------------------------------- scenes

HELD = "hard/held"
# nothing presses the block to the walls but its own deformation
JAM = {"n": 1, "place": "walls", "squeeze": 0}


def solutions_of(problem) -> tuple[np.ndarray, list[np.ndarray]]:
    """Node numbers and all multipliers of the assembled body after its only step, by enumeration.
    """
    body = Assembled(problem.manifest, problem.subdomains)
    weights = problem.manifest.factors[1]
    return body.gid, enumerated(body.K.toarray(), weights @ body.loads, body.B, body.gap,
                                np.zeros(len(body.gid)),
                                body.friction)


@pytest.mark.parametrize("options, count", [
    ({"n": 2}, 1), ({"n": 2, "tilt": 26.538}, 1), ({"n": 2, "push": 3e-5}, 1),
    ({"n": 2, "push": 4.9e-5, "friction": 2}, 1),
    ({"n": 1, "friction": 6, "tilt": 20, "push": 2e-5}, 1), ({**JAM, "squeeze": 1e-3}, 1),
    ({**JAM, "squeeze": 1e-5}, 0),
    ({**JAM, "friction": 3.5}, 0), ({**JAM, "friction": 4}, 1), ({**JAM, "friction": 20}, 3),
    ({**JAM, "friction": 2, "squeeze": 1e-5}, 1), ({**JAM, "friction": 4, "squeeze": -1e-6}, 1)])
@pytest.mark.some(2)
def test_small_scenes_against_enumeration(built, steps_of, options, count):
    """Resting, nearly sliding, nearly toppling, jammed by friction: what enumeration finds on the
    assembled body.

    Between the walls a rigid block could always rest, as they may press as hard as it takes: not so
    one that deforms.
    """
    problem = built(HELD, steps=1, subdomains=1, **options)
    gid, expected = solutions_of(problem)
    assert len(expected) == count
    solver, steps = steps_of(problem, rtol=1e-11, friction_rtol=1e-10)
    if not count:
        assert solver.failure.exit_status == 3 and "no equilibrium was found" in str(solver.failure)
        assert "body 1" in str(solver.failure)
        return
    assert solver.failure is None
    contact = problem.structure.contact
    order = np.array([np.flatnonzero(contact.gid == one)[0] for one in gid])
    x = steps[0].multipliers[np.concatenate([contact.normal_row[order],
                                             contact.tangential_row[order]])]
    # friction and balance are settled to 1e-10, and a jam with F = 20 answers to what is left by
    # more than a thousand times
    assert min(np.abs(x - y).max() for y in expected) < 1e-6 * np.abs(x).max()
    assert solver.uniqueness.verdict == ("unique" if count == 1 else "not unique")
    assert len(solver.uniqueness.several.get(1, [])) == (count if count > 1 else 0)


@pytest.mark.slow
def test_fallbacks_move_free_bodies(built, steps_of, monkeypatch):
    """A jam that successive approximations miss: Anderson's, and without it Newton's or Lemke's,
    reach the same state.
    """
    problem = built(HELD, steps=1, subdomains=3, **{**JAM, "n": 2, "friction": 4})
    ways = []
    for accelerate in (fixedpoint.FixedPoint._accelerate, lambda *a: None):
        monkeypatch.setattr(fixedpoint.FixedPoint, "_accelerate", accelerate)
        solver, steps = steps_of(problem, rtol=1e-11, friction_rtol=1e-9, uniqueness="no")
        assert solver.failure is None and solver.history.residuals["equilibrium"] < 1e-8
        ways.append((set(solver.history.fallbacks.steps), steps[0].multipliers))
    (first, x), (second, y) = ways
    assert first == {globalization.ANDERSON} and len(second) == 1
    assert second <= {globalization.NEWTON, globalization.LEMKE}
    assert np.abs(x - y).max() < 1e-5 * np.abs(x).max()


@pytest.mark.slow
def test_a_proof_that_no_states_solve_a_step_ends_it(built, steps_of, monkeypatch):
    """With status 3, whatever tolerances of QPs are left to tighten: no second search."""
    problem, searched = built(HELD, steps=1, subdomains=3, **{**JAM, "n": 2, "friction": 4}), []

    def proved(contact, start):
        searched.append(contact.n)
        return None, globalization.NO_STATE

    monkeypatch.setattr(fixedpoint.FixedPoint, "_accelerate", lambda *a: None)
    monkeypatch.setattr(globalization, "followed", lambda *_: (None, ""))
    monkeypatch.setattr(globalization, "searched", proved)
    monkeypatch.setattr(tightening, "NEARLY", np.inf)  # exacter QPs might settle any state
    solver, _ = steps_of(problem, rtol=1e-11, friction_rtol=1e-9, uniqueness="no")
    assert solver.failure.exit_status == 3 and len(searched) == 1


@pytest.mark.parametrize("cut", [1, 3])
def test_a_body_let_go_comes_to_rest(built, steps_of, tmp_path, cut):
    """Without load its forces are rounding of the places it went to: QPs get exact enough to end.
    """
    path = tmp_path / "let-go.edp"
    path.write_text(LET_GO)
    solver, steps = steps_of(built(scene=path, subdomains=cut, steps=4), rtol=1e-10,
                             friction_rtol=1e-8)
    assert solver.failure is None
    largest = [np.abs(step.multipliers).max() for step in steps]
    assert largest[-1] <= 1e-6 * max(largest)  # what counts as rounding of a history


DRAWN = """include "scene.idp"
subdomains("4");
quasistatic(1.);
border a(t=0, 1) { x = 0.4*t; y = -0.0086*t; label = 1; }
border b(t=0, 1) { x = 0.4 + 0.81*t; y = -0.0086 - 0.0175*t; label = 2; }
border c(t=0, 1) { x = 1.21 + 0.14*t; y = -0.0261 + 0.7216*t; label = 11; }
border d(t=0, 1) { x = 1.35 - 1.16*t; y = 0.6955 - 0.008*t; label = 21; }
border e(t=0, 1) { x = 0.19 - 0.19*t; y = 0.6875 - 0.6875*t; label = 31; }
body = buildmesh(a(2) + b(4) + c(4) + d(6) + e(4));
macro young() 1. //
macro poisson() 0.3 //
macro support() on(21, u2 = 0.) //
macro load1() traction(21, 6.45e-6, 3e-4) //
macro load2() traction(11, 1e-4, -2.15e-6) //
macro contact() 1, 2 //
macro gap() -0.0002 //
macro friction() 0.3 //
macro amplitude1(t) t //
macro amplitude2(t) 1. //
include "export.idp"
"""


def test_a_drawn_body_stays_where_friction_holds_it(built, steps_of, tmp_path):
    """Pressed between a roller and a slope and drawn along it: any cut finds the rest that is near.

    Where friction was not yet known the body was moved until it had lost contact, and by a secant
    1e14 further; some cuts then came to rest a long way off, or not at all.
    """
    path = tmp_path / "drawn.edp"
    path.write_text(DRAWN)
    forces = []
    for cut in (1, 3, 7):
        problem = built(scene=path, subdomains=cut, steps=2, element="P2")
        solver, steps = steps_of(problem, rtol=1e-10, friction_rtol=1e-8)
        assert solver.failure is None and not solver.history.fallbacks.steps
        forces.append([np.sort(step.multipliers[solver.rows.normal])
                       for step in steps])
    np.testing.assert_allclose(forces, [forces[0]] * 3, rtol=1e-5)


ALONG = """include "scene.idp"
subdomains("4");
border a(t=0, 1) { x = 1.049*t; y = 0.; label = 1; }
border b(t=0, 1) { x = 1.049; y = 0.955*t; label = 2; }
border c(t=0, 1) { x = 1.049 - 1.049*t; y = 0.955; label = 3; }
border d(t=0, 1) { x = 0.; y = 0.955 - 0.955*t; label = 4; }
body = buildmesh(a(8) + b(8) + c(8) + d(8));
macro young() 1. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0.) //
macro load1() traction(2, -1e-3, 0.) //
macro contact() 1 //
include "export.idp"
"""


def test_loads_across_a_motion_do_no_work_on_it(built, tmp_path):
    """Not by rounding either: nothing else is on a body that may move up and is pushed aside."""
    path = tmp_path / "along.edp"
    path.write_text(ALONG)
    for cut in ("3", "5", "7", "9", "13"):
        problem = built(scene=path, subdomains=cut)
        work, _ = free_motions.work_of_loads(problem.structure, MPI.COMM_SELF)
        assert work.shape[1] == 1 and not work.any()


PRESSED = """include "scene.idp"
subdomains("4");
border a(t=0, 1) { x = 1.602*t; y = 0.; label = 1; }
border b(t=0, 1) { x = 1.602; y = 1.16*t; label = 2; }
border c(t=0, 1) { x = 1.602 - 1.602*t; y = 1.16 - 0.737296*t; label = 3; }
border d(t=0, 1) { x = 0.; y = 0.422704 - 0.422704*t; label = 4; }
body = buildmesh(a(7) + b(5) + c(7) + d(2));
macro young() 1. //
macro poisson() 0.2 //
macro support() on(4, u2 = 0.) //
macro load1() traction(3, 0., -1e-4) //
macro contact() 1 //
include "export.idp"
"""


def test_loads_across_a_motion_have_the_size_of_their_rounding(built, steps_of, tmp_path):
    """A wedge on rollers, free to move aside and to turn, pressed down on a smooth floor.

    At this cut one motion is the way aside, but for 1e-17 up or down. What loads did on it was
    rounding, counted as all that they could do, and contact was said not to balance it.
    """
    path = tmp_path / "pressed.edp"
    path.write_text(PRESSED)
    forces = []
    for cut in (1, 21):
        problem = built(scene=path, subdomains=cut, element="P1")
        solver, steps = steps_of(problem, rtol=1e-10, friction_rtol=1e-8)
        assert solver.failure is None
        size = solver.operator.imbalance(np.zeros(solver.operator.owned), np.ones(1))[1]
        assert size.min() > 1e-8 * size.max()  # BALANCED is 1e-6, motions are of one size
        forces.append(steps[-1].multipliers[solver.rows.normal].sum())
    assert forces[1] == pytest.approx(forces[0], rel=1e-7)


def test_rounding_resists_no_motion():
    """Two nodes on a floor that a motion along it moves by 1e-16: pushed along, nothing holds it.

    Pressed on the floor it rests.
    """
    normal, nodes, none = np.array([[1.8e-16, 0.5], [1e-16, 0.5]]), np.arange(2), np.zeros(0)
    rows = SimpleNamespace(idle=None, normal=nodes, normal_node=nodes, gap=np.zeros(2),
                           pulls=np.ones(2, bool), tangential=none.astype(int),
                           tangential_node=none.astype(int), coefficient=None, offset=None)
    one = SimpleNamespace(gather=lambda part: [part], bcast=lambda value: value, rank=0)
    for pushed in (False, True):
        work = np.array([1e-4 * pushed, 1e-4])
        motion = rigid_equilibrium(rows, normal, work, np.full(2, 1e-4), one)
        assert (motion is None) == pushed


@pytest.fixture(scope="module")
def weighed(tmp_path_factory):
    """Path of the scene WEIGHED."""
    path = tmp_path_factory.mktemp("weighed") / "weighed.edp"
    path.write_text(WEIGHED)
    return path


@pytest.mark.parametrize("cut", [1, 5])
def test_weight_alone_leaves_nothing_along_the_floor(built, steps_of, weighed, cut):
    """Forces along the floor are rounding, and not what their balance is measured by."""
    problem = built(scene=weighed, subdomains=cut, element="P2")
    solver, _ = steps_of(problem, friction_rtol=1e-8)
    assert solver.failure is None and not solver.history.fallbacks.steps
    assert solver.history.residuals["equilibrium"] <= 1e-8


def test_heat_hides_no_weight(built, steps_of, weighed):
    """Thermal forces balance themselves: those on the floor are as near to the weight as without.
    """
    problem = built(scene=weighed, warm=1.0, room=10.0)
    solver, (step,) = steps_of(problem, friction_rtol=1e-8)
    contact = problem.structure.contact
    up = -sum(step.multipliers[rows[rows >= 0]] @ direction[rows >= 0] for rows, direction in (
        (contact.normal_row, contact.normal[:, 1]), (contact.tangential_row, contact.normal[:, 0])))
    # the tolerance, and roundings of forces that are ten thousand times the weight
    assert solver.failure is None and up == pytest.approx(1.4e-4, rel=1e-7)


def test_tower_does_not_swing(built, steps_of):
    """Moved for given gluing multipliers again and again, bodies on bodies swing: the corrector
    gives up, QPs lead on.
    """
    solver, _ = steps_of(built("hard/tower", subdomains="2x2", h=0.1, steps=2))
    assert solver.failure is None and not solver.history.fallbacks.steps
    assert solver.history.residuals["equilibrium"] < 1e-6


def test_steps_that_hardly_differ_ask_for_no_linear_program(built, steps_of, monkeypatch):
    """Forces near those of the step before balance the loads; two when the loads begin to grow."""
    solved, solve = [], equilibrium._solve
    monkeypatch.setattr(equilibrium, "_solve", lambda *law: solved.append(law) or solve(*law))
    solver, steps = steps_of(built("stack", h=0.3, steps=8))
    assert solver.failure is None and len(steps) == 8
    assert 1 <= len(solved) <= 2


@pytest.mark.slow
def test_fallbacks_of_free_bodies_do_not_depend_on_ranks(solved):
    one, two = (solved(HELD, place="walls", squeeze=0, friction=4, n=2, subdomains=3, steps=1,
                       NP=ranks) for ranks in (1, 2))
    assert one.status == 0
    assert one.summary["fallbacks"], "look for another coefficient at which one is needed"
    for name in ("u_n", "u_t", "sigma_n", "sigma_t"):
        assert np.array_equal(one.contact[name], two.contact[name])


@pytest.mark.parametrize("below, above", [
    ({"tilt": 26.5386}, {"tilt": 26.5917}),  # friction angle of 0.5: 26.5651, 0.1 % to either side
    # over its lower edge
    ({"tilt": 26.5386, "height": 2, "friction": 3}, {"tilt": 26.5917, "height": 2, "friction": 3}),
    # the same by a force at its top
    ({"push": 4.995e-5, "friction": 2}, {"push": 5.005e-5, "friction": 2}),
    ({"weight": 1e-4}, {"weight": -1e-4})])  # pulled away
@pytest.mark.some(1)
def test_limits_of_equilibrium(solved, below, above):
    """A tenth of a percent before sliding or toppling the block rests, one behind it is refused."""
    rests, fails = (solved(HELD, steps=1, **options) for options in (below, above))
    assert rests.status == 0 and rests.summary["residuals"]["equilibrium"] < 1e-6
    assert rests.summary["warnings"] == []
    assert fails.status == 3 and "no equilibrium" in fails.reason and "body 1" in fails.reason


@pytest.mark.parametrize("options", [{"place": "groove", "friction": 0},
                                     {"tilt": float(np.degrees(np.arctan(0.5)))},
                                     {"friction": 0}])
def test_motions_that_nothing_holds_are_named(solved, options):
    """A disc that may turn, a block that is about to slide, one on ice: forces are unique, places
    are not.
    """
    run = solved(HELD, steps=1, **options)
    assert run.status == 0
    assert sum("displacements are one of many solutions" in line
               for line in run.summary["warnings"]) == 1
    assert run.summary["uniqueness"]["verdict"] in ("unique", "not examined")
    assert run.summary["residuals"]["equilibrium"] < 1e-6


class RanksInTurn:
    """Two ranks that own every other contact node, seen from the first."""

    rank = 0

    def __init__(self, parts):
        self.parts = parts

    def gather(self, _part):
        return self.parts

    def bcast(self, answer):
        return answer


@pytest.mark.parametrize("friction, carried", [(0.29, False), (0.31, True)])
def test_equilibrium_does_not_depend_on_which_rank_owns_a_node(friction, carried):
    """A block on six nodes, of which the second alone is rough, pushed with 0.3 of its weight above
    that node.

    All pressure can stand there, so that friction carries the push from F = 0.3 on; with that of
    any other node it could not.
    """
    x, count = np.linspace(-1, 1, 6), 6
    # of motions along x and y and of a turn
    normal = np.column_stack([np.zeros(count), -np.ones(count), -x])
    tangential = np.column_stack([np.ones(count), np.zeros(count), np.zeros(count)])
    bound = np.where(np.arange(count) == 1, friction, 0.0)
    work, size = np.array([0.3, -1.0, -x[1]]), np.ones(3)

    def part(own):
        zero = np.zeros(len(own))
        one_sided = np.zeros(len(own), bool)
        return normal[own], zero, own, one_sided, tangential[own], own, bound[own], zero

    rows = SimpleNamespace(normal=np.arange(count), tangential=np.arange(count), gap=None,
                           normal_node=None,
                           tangential_node=None, coefficient=None, offset=None, pulls=None,
                           idle=None)
    for owned in ([np.arange(count)], [np.arange(0, count, 2), np.arange(1, count, 2)]):
        found = rigid_equilibrium(rows, normal, work, size,
                                  RanksInTurn([part(own) for own in owned]))
        assert (found is not None) == carried


RING = """include "scene.idp"
border hole(t=2*pi, 0) { x = cos(t); y = sin(t); label = 1; }
border rim(t=0, 2*pi) { x = 2*cos(t); y = 2*sin(t); label = 2; }
border disc(t=0, 2*pi) { x = cos(t); y = sin(t); label = 3; }
addBody(buildmesh(rim(24) + hole(16)))
addBody(buildmesh(disc(16)))
macro young() 1. //
macro poisson() 0.3 //
macro support() on(2, u1 = 0., u2 = 0.) //
macro bodyForce1() [0., -1e-3] //
macro contactPair() 3, 1 //
include "export.idp"
"""


def test_a_motion_that_only_rounding_resists_is_held_like_the_others(built, tmp_path):
    """A disc turns in a hole without friction: its rows move by rounding, no measure of stiffness.

    Springs by that would be softer than all others by thirty digits, and F lost in rounding.
    """
    scene = tmp_path / "ring.edp"
    scene.write_text(RING)
    rho = built(str(scene), subdomains=2).operator.rho
    assert len(rho) == 3 and rho.max() < 10 * rho.min()


@pytest.mark.parametrize("cut, friction, little", [(3, "", False), (9, "", True),
                                                   (9, "macro friction() 0.3 //\n", False)])
@pytest.mark.some(1)
def test_motions_that_rows_hardly_resist_are_known(built, steps_of, tmp_path, cut, friction,
                                                   little):
    """A disc whose nodes are on its circle to eight digits: Newton's method would turn it until the
    rest of these holds it. Without them nothing resists at all, with friction rows do.
    """
    path = tmp_path / "ring.edp"
    path.write_text(RING.replace('include "export', friction + 'include "export'))
    solver, _ = steps_of(built(path, subdomains=cut), uniqueness="no")
    assert solver.condensation.hardly_felt == little
    assert little <= (not solver.fixed_point.shortcut.possible)


@pytest.mark.parametrize("step", [1, 3])
def test_a_qp_that_fails_on_the_way_to_rest_is_not_the_end(built, steps_of, monkeypatch, step,
                                                           tmp_path):
    """Bodies may have run far away in it; other methods begin where it did."""
    path = tmp_path / "weighed.edp"
    path.write_text(WEIGHED)
    honest, calls = FrictionQP.solve, []

    def once(self, index, iteration, d, limits, x, *rest):
        calls.append(x)
        if len(calls) == step:
            raise Unfinished(NotConverged("stagnated"), x, x)
        return honest(self, index, iteration, d, limits, x, *rest)

    monkeypatch.setattr(FrictionQP, "solve", once)
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    solver, steps = steps_of(built(scene=path))
    assert solver.failure is None and len(steps) == 1 and len(calls) > step


ROLLERS = """include "scene.idp"
units("um", "MPa");
subdomains("2");
int[int] low = [1, 2, 3, 4];
int[int] top = [11, 12, 13, 14];
mesh Ta = square(6, 3, [1500.*x, 700.*y], label = low);
mesh Tb = square(5, 4, [300. + 700.*x, 700. + 800.*y], label = top);
addBody(Ta)
addBody(Tb)
macro young() 3000. //
macro poisson() 0.3 //
macro support() on(1, u2 = 0.) + on(12, u1 = 0., u2 = 0.) //
macro load1() traction(13, -3., -12.) //
macro contactPair() 11, 3 //
macro pairGap() -1. //
macro friction() 0. //
include "export.idp"
"""
DISC = """include "scene.idp"
units("mm", "MPa");
subdomains("3");
border c0(t=pi, 2*pi) { x = 20*cos(t); y = 20*sin(t); label = 1; }
border c1(t=0, 1) { x = 20 - 40*t; y = 0; label = 2; }
body = buildmesh(c0(24) + c1(12));
quasistatic(1.);
macro young() 210e3 //
macro poisson() 0.3 //
macro bodyForce1() [0.1, -1.] //
macro amplitude1(t) 1. //
macro contact() 1 //
macro gap() 1e-4 //
macro friction() 0.4 //
macro preload() 1 //
include "export.idp"
"""
SHRUNK = """include "scene.idp"
real twist = physical("twist", 0.);
units("mm", "MPa");
subdomains("3");
border c0(t=0, 2*pi) { x = 30*cos(t); y = 30*sin(t); label = 2; }
border c1(t=0, -2*pi) { x = 20*cos(t); y = 20*sin(t); label = 1; }
body = buildmesh(c0(36) + c1(24));
macro young() 210e3 //
macro poisson() 0.3 //
macro bodyForce1() [-twist*y/30., twist*x/30.] //
macro contact() 1 //
macro gap() -0.001 //
macro friction() 0.2 //
include "export.idp"
"""
SLEEVE = """include "scene.idp"
units("mm", "MPa");
subdomains("3");
int[int] sides = [11, 12, 13, 14];
body = square(4, 8, [20 + 5*x, 20*y], label = sides);
macro axisymmetric() 1 //
macro young() 210e3 //
macro poisson() 0.3 //
macro load1() traction(11, 0., 300.) //
macro contact() 14 //
macro gap() -0.01 //
macro friction() 0.2 //
include "export.idp"
"""


@pytest.mark.parametrize("cut", [2, 7])
def test_a_body_on_rollers_under_a_smooth_one_is_balanced_across(built, steps_of, tmp_path, cut):
    """Nothing acts along its rollers but the rounding of forces across, which is no imbalance."""
    path = tmp_path / "rollers.edp"
    path.write_text(ROLLERS)
    solver, steps = steps_of(built(scene=path, subdomains=cut), rtol=1e-10, friction_rtol=1e-8)
    assert solver.failure is None and len(steps) == 1
    op, x = solver.operator, steps[0].multipliers
    net, size = op.imbalance(x, steps[0].weights)
    reach = np.abs(op.structure.rigid_corners).max(axis=0)
    pressing = np.abs(x[solver.rows.normal]).sum()
    # forces have sixteen digits, of which tolerances of 1e-8 leave none below 1e-7 of them
    assert pressing > 0 and (size >= 1e-7 * reach * pressing).all() and (
        np.abs(net) <= 1e-8 * size).all()


@pytest.mark.parametrize("cut", [1, 5])
def test_a_smooth_preload_of_a_body_that_may_roll(built, steps_of, tmp_path, cut):
    """Half a disc in a shell, its weight oblique: the preload finds where it rests, and nothing
    slips from there.
    """
    path = tmp_path / "disc.edp"
    path.write_text(DISC)
    solver, steps = steps_of(built(scene=path, subdomains=cut, steps=2), rtol=1e-10,
                             friction_rtol=1e-8)
    assert solver.failure is None and len(steps) == 2
    slip = np.abs(steps[0].gradient[solver.rows.tangential]).max()
    assert slip <= 1e-5 * solver.scales.displacement  # a tenth of the accuracy of both states
    smooth = np.abs(steps[0].multipliers[solver.rows.tangential]).max()
    assert smooth <= 1e-3 * np.abs(steps[0].multipliers[solver.rows.normal]).max()


def test_a_pin_that_nothing_holds_ends_in_one_line(solved, tmp_path):
    """Of whose linear program HiGHS with presolve aborted the process: status 3."""
    path = tmp_path / "pin.edp"
    path.write_text(PIN)
    run = solved(path, subdomains=1)
    assert run.status == 3 and "cannot balance the loads" in run.reason


@pytest.mark.parametrize("cut", [1, pytest.param(5, marks=pytest.mark.slow)])
@pytest.mark.parametrize("text, options, way", [
    pytest.param(SHRUNK, {"twist": 20}, "body 1 is free to turn", marks=pytest.mark.slow),
    (SLEEVE, {}, r"body 1 is free to move off in the direction \(0, 1\)")], ids=["turn", "off"])
def test_a_body_that_slides_off_is_told_where_to(solved, tmp_path, text, options, way, cut):
    """Rings shrunk on a rigid core and pushed by more than friction can hold: status 3."""
    path = tmp_path / "ring.edp"
    path.write_text(text)
    run = solved(path, subdomains=cut, **options)
    assert run.status == 3 and re.search(way, run.reason)


@pytest.mark.slow
def test_friction_that_falls_with_the_way_holds_a_body_again(solved, tmp_path):
    """On the way of successive approximations it runs off so far that its friction holds it no
    more; from that of rest both cuts come to one answer, to a hundred residuals of 1e-8.
    """
    path, forces = tmp_path / "ell.edp", []
    path.write_text(ELL)
    for cut in (1, 3):
        run = solved(path, subdomains=cut, element="P2", steps=2, rtol=1e-10,
                     friction_rtol=1e-8)
        assert run.status == 0
        order = np.argsort(run.contact["x"][-1])
        forces.append(run.contact["sigma_n"][-1][order])
    assert np.abs(forces[0] - forces[1]).max() <= 1e-6 * np.abs(forces[0]).max()


@pytest.mark.slow
def test_a_body_that_all_have_left_stays_where_it_is_on_any_cut(solved, named_scene):
    """Rounding of contact forces, 1e-18 beside shear of 3e-3, held it here or there: places of the
    block differed by up to twice the largest displacement. The least motion is one of a kind, right
    to the tolerances, 1e-6 of the deformation, times the steps.
    """
    scene = named_scene("unloaded", UNLOADED)
    runs = [solved(scene, steps=8, subdomains=cut) for cut in (2, 5, 13)]
    largest = runs[0].history["max_displacement"].max()
    last = runs[0].contact["step"] >= 7
    assert not np.abs(runs[0].contact["sigma_n"][last]).max() > 1e-9  # all have left it
    for run in runs:
        assert "neither contact nor sticking friction prevents" in str(run.summary["warnings"])
        for name in ("u_n", "u_t"):
            off = np.abs(run.contact[name] - runs[0].contact[name]).max()
            assert off < 8e-6 * largest
