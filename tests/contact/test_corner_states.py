"""States of corners: which of two conditions at one vertex act, and how they share its force."""

import re
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linprog

from driver.contact.acting import (BOTH, FIRST, FIRST_RUBS, NEITHER, SECOND, SECOND_RUBS,
                                   STANDING)
from driver.contact.beside import Beside
from driver.contact.corner_nodes import MOST, CornerNodes
from driver.contact.sharing import least_friction
from driver.errors import NoSolution, NotConverged
from driver.march.corner_states import CornerStates
from driver.march.step import Trace, Unfinished
from driver.march.supported import SupportedBodies


def corner(alone=False, bilateral=(False, False), offset=(0.0, 0.0), gap=(0.0, 0.0)):
    """One corner, with dual rows n1, n2, t1, t2."""
    return CornerNodes(np.array([[0, 1]]), np.array([[0, 1]]), np.array([[2, 3]]),
                       np.array([[0, 1]]), np.array([alone]), np.array([bilateral]),
                       np.array([offset]), np.array([gap]), -np.eye(2)[None],
                       np.array([True]), None)


def switched(nodes: CornerNodes, force, over) -> tuple[bool, int]:
    """Whether the state changes under normal forces and movements beyond the gap; the new one."""
    law = SimpleNamespace(coefficient=None, offset=None)
    alone = SimpleNamespace(allgather=lambda value: [value])
    x, gradient = np.append(force, [0.0, 0.0]), -np.append(over, [0.0, 0.0])
    changed = nodes.switch(x, gradient, law, np.ones(4), 1e-9, alone, np.zeros(4))
    return changed, int(nodes.acting[0])


@pytest.mark.parametrize("slip", [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (0.0, -1.0), (1.0, 0.0)])
@pytest.mark.parametrize("pulls", [(False, False), (True, False)])
def test_what_a_corner_arrives_with_is_shared_by_the_law_of_sliding(slip, pulls):
    """Pressures and friction on its bound, the way that each side slides, make up the force."""
    nodes, force = corner(bilateral=pulls), np.array([-3.0, -2.0])
    F, c = np.array([0.3, 0.2]), np.array([0.1, 0.05])
    rows = SimpleNamespace(coefficient=F, offset=c)
    nodes.rested = np.array([False])
    p, q = nodes._parts(0, force, np.array(slip), rows, 1e-9)
    way = np.sign(slip)
    np.testing.assert_allclose(q, way * (F * np.abs(p) + c))
    normal = -np.eye(2)
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    np.testing.assert_allclose(p @ normal + q @ tangent, force, rtol=1e-12)
    assert nodes._parts(0, force, np.zeros(2), rows, 1e-9) is None
    assert nodes._parts(0, force, np.array(slip), None, 1e-9) is None


def test_a_corner_takes_the_state_that_its_conditions_ask_for():
    nodes = corner()
    assert nodes.excluded.tolist() == [2, 3]
    assert switched(nodes, [1.0, 1.0], [0.0, 0.0]) == (False, BOTH)
    assert switched(nodes, [1.0, 0.0], [0.0, -1e-3]) == (True, FIRST)
    assert nodes.excluded.tolist() == [1, 3]
    assert switched(nodes, [1.0, 0.0], [0.0, -1e-3]) == (False, FIRST)
    assert switched(nodes, [1.0, 0.0], [0.0, 1e-3]) == (True, BOTH)
    assert switched(nodes, [0.0, 1.0], [-1e-3, 0.0]) == (True, SECOND)
    assert switched(nodes, [0.0, 0.0], [1e-3, -1e-3]) == (True, FIRST)
    held = corner(bilateral=(True, False))  # never open
    assert switched(held, [0.0, 0.0], [-1e-3, -1e-3]) == (True, FIRST)
    assert switched(held, [0.0, 0.0], [0.0, 1e-3]) == (True, BOTH)
    for size in (1.0, -1.0, 1e9):  # the side that is nearer, of overlaps as well
        assert corner(gap=(size + 1e-3 * abs(size), size)).acting[0] == SECOND
        assert corner(gap=(size, size + 1e-3 * abs(size))).acting[0] == FIRST
        assert corner(gap=(size, size)).acting[0] == BOTH  # both are
    assert corner(gap=(1e-3, 0.0)).acting[0] == SECOND
    given = corner(offset=(1.0, 2.0))  # friction that needs no pressure
    assert switched(given, [0.0, 0.0], [-1e-3, -1e-3]) == (True, NEITHER)
    assert given.excluded.tolist() == [0, 1]
    assert switched(given, [0.0, 0.0], [-1e-3, 0.0]) == (False, NEITHER)
    assert switched(given, [0.0, 0.0], [-1e-3, 1e-3]) == (True, SECOND)
    assert switched(given, [0.0, 1.0], [-1e-3, 0.0]) == (False, SECOND)
    given = corner(offset=(0.0, 2.0))
    assert switched(given, [0.0, 0.0], [-1e-3, -1e-3]) == (True, SECOND)
    one = corner(alone=True)
    assert switched(one, [1.0, 0.0], [0.0, 1e-3]) == (True, SECOND)


@pytest.mark.parametrize("state", [BOTH, FIRST, SECOND, STANDING, NEITHER])
def test_a_vertex_keeps_its_force_in_the_rows_of_its_state(state):
    """A step starts from the forces before it: what its state excludes goes to the other rows, and
    the force on the vertex, as far as these can make it up, remains.
    """
    nodes, rng = corner(), np.random.default_rng(int(state))
    nodes.directions[0, 1] = [-0.6, -0.8]  # not perpendicular
    nodes.acting[:] = state
    normal, x = nodes.directions[0], rng.uniform(1.0, 2.0, 4)
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    moved = nodes.own(x)
    force, kept = (y[:2] @ normal + y[2:] @ tangent for y in (x, moved))
    assert not moved[nodes.excluded].any()
    np.testing.assert_allclose(kept, force, rtol=1e-12)


CIRCLE = {BOTH: ([1.0, 0.0], [0.0, -1.0]), FIRST: ([1.0, 0.0], [0.0, 1.0])}


def test_a_corner_that_circles_stands_where_friction_can_hold_it():
    """On two perpendicular sides, F = 0.5: a pull of 0.4 on one is friction of the other."""
    nodes = corner()
    while nodes.acting[0] != STANDING:
        assert switched(nodes, *CIRCLE[nodes.acting[0]])[0]
    assert nodes.excluded.tolist() == [2, 3] and nodes.standing.tolist() == [0, 1]
    x, law = np.array([1.0, -0.4, 0.0, 0.0]), SimpleNamespace(coefficient=np.full(2, 0.5),
                                                              offset=None)
    alone = SimpleNamespace(allgather=lambda value: [value])
    assert not nodes.switch(x, np.zeros(4), law, np.ones(4), 1e-9, alone, np.zeros(4))
    assert not nodes.undecided[0]
    # the sides' normals are -x and -y, the first one's tangent is -y
    shared, changed = nodes.end_step(x, np.zeros(4), law, np.ones(4), alone)
    assert nodes.rested.all() and changed and nodes.acting[0] == FIRST  # which alone can hold it
    assert shared == pytest.approx([1.0, 0.0, -0.4, 0.0])


ALONE = SimpleNamespace(allgather=lambda value: [value])
LAW = SimpleNamespace(coefficient=np.full(2, 0.4), offset=None)


def ended(state, x, *, slip=(0.0, 0.0), over=(0.0, 0.0), rested=False):
    """The corner after a step that got there in a state, with forces x (4,), and its new forces."""
    nodes = corner()
    nodes.acting[:], nodes.rested[:] = state, rested
    gradient = -np.array([*over, *slip])
    return nodes, nodes.end_step(np.array(x), gradient, LAW, np.ones(4), ALONE)[0]


def test_slip_of_a_vertex_that_was_there_is_an_error():
    """Also where it is more than what counts as slip of one that arrives."""
    for slip in ([1e-4, -1e-4], [-1e-4, 1e-4]):
        _, x = ended(BOTH, [1.0, 2.0, 0.0, 0.0], slip=slip, rested=True)
        assert x == pytest.approx([1.0, 2.0, 0.0, 0.0], abs=1e-15)
        nodes, x = ended(BOTH, [1.0, 2.0, 0.0, 0.0], slip=slip)
        assert x[2:] == pytest.approx(np.sign(slip) * 0.4 * x[:2]) and nodes.rested[0]
    _, x = ended(BOTH, [1.0, 2.0, 0.0, 0.0], slip=[1e-6, 1e-6])
    assert x == pytest.approx([1.0, 2.0, 0.0, 0.0], abs=1e-15)


@pytest.mark.parametrize("force", [(-1.0, -2.0), (-1.0, -0.2), (-1.0, 0.3), (0.3, -1.0)])
def test_the_end_of_a_step_does_not_know_the_way(force):
    """All states that hold a vertex with the same force end in the same shares and state.

    The sides have the normals -x and -y, and so the tangents -y and x.
    """
    x, y = force
    ways = {BOTH: [-x, -y, 0.0, 0.0], STANDING: [-x, -y, 0.0, 0.0],
            FIRST: [-x, 0.0, -y, 0.0], SECOND: [0.0, -y, 0.0, x]}
    ends = [ended(state, shares) for state, shares in ways.items()]
    total = [shares[:2] @ -np.eye(2) + shares[2:] @ [[0, -1], [1, 0]] for _, shares in ends]
    assert np.abs(np.array(total) - force).max() <= 1e-15
    assert len({int(nodes.acting[0]) for nodes, _ in ends}) == 1
    assert np.abs(np.array([shares for _, shares in ends]) - ends[0][1]).max() <= 1e-15
    nodes, shares = ends[0]
    own = nodes.own(shares)  # the next step starts with the same force on rows that are free
    assert (own[nodes.excluded] == 0).all()
    assert own[:2] @ -np.eye(2) + own[2:] @ [[0, -1], [1, 0]] == pytest.approx(force)
    apart_from_it, shares = ended(FIRST, ways[FIRST], over=[0.0, -1e-3])
    assert shares.tolist() == ways[FIRST] and not apart_from_it.rested[0]


@pytest.mark.parametrize("sign", [1.0, -1.0, 0.0])
def test_a_side_that_bears_no_more_than_rounding_is_open(sign):
    """One side carries the force and its friction; rounding is no contact of the other one."""
    for state, rounded in ((BOTH, [1.0, sign * 1e-15, 0.0, 0.0]),
                           (FIRST, [1.0, 0.0, sign * 1e-15, 0.0])):
        _, x = ended(state, rounded)
        assert x.tolist() == [1.0, 0.0, 0.0, 0.0]


def test_every_corner_is_judged_whatever_the_others_do():
    """The first stands by friction, as it has done; the second opens one of its sides."""
    nodes = CornerNodes(np.array([[0, 1], [4, 5]]), np.array([[0, 1], [4, 5]]),
                        np.array([[2, 3], [6, 7]]), np.array([[0, 1], [2, 3]]),
                        np.array([False, False]), np.zeros((2, 2), bool), np.zeros((2, 2)),
                        np.zeros((2, 2)), np.array([-np.eye(2)] * 2), np.array([True, True]), None)
    nodes.acting[0] = STANDING
    law = SimpleNamespace(coefficient=None, offset=None)
    alone = SimpleNamespace(allgather=lambda value: [value])
    x, over = np.zeros(8), np.zeros(8)
    x[4], over[5] = 1.0, -1e-3
    nodes._stands = lambda *_: STANDING
    assert nodes.switch(x, -over, law, np.ones(8), 1e-9, alone, np.zeros(8))
    assert nodes.acting.tolist() == [STANDING, FIRST]


def test_every_corner_starts_with_its_force_in_its_rows():
    """The first has nothing to move; the force of the second goes over to the side that acts."""
    nodes = CornerNodes(np.array([[0, 1], [4, 5]]), np.array([[0, 1], [4, 5]]),
                        np.array([[2, 3], [6, 7]]), np.array([[0, 1], [2, 3]]),
                        np.array([False, False]), np.zeros((2, 2), bool), np.zeros((2, 2)),
                        np.zeros((2, 2)), np.array([-np.eye(2)] * 2), np.array([True, True]), None)
    nodes.acting[:] = FIRST
    own = nodes.own(np.array([3.0, 0.0, 0.5, 0.0, 2.0, 1.0, 0.0, 0.0]))
    assert own[:4].tolist() == [3.0, 0.0, 0.5, 0.0]
    assert own[4] == 2.0 and own[5] == 0.0 and abs(own[6]) == 1.0 and own[7] == 0.0


def test_a_touch_within_the_tolerance_changes_no_state():
    nodes = corner()
    nodes.acting[:] = FIRST
    for over, changes in ((5e-8, False), (5e-7, True)):
        gradient = -np.array([0.0, over, 0.0, 0.0])
        assert nodes.switch(np.array([1.0, 0, 0, 0]), gradient, None, np.ones(4), 1e-13, ALONE,
                            np.ones(4)) == changes


def test_a_corner_that_no_state_holds_is_undecided():
    """Without friction nothing pulls: the standing vertex is left to one side, and circles."""
    nodes, changes = corner(), 0
    violation = CIRCLE | {STANDING: ([1.0, -0.4], [0.0, 0.0])}
    while switched(nodes, *violation[nodes.acting[0]])[0]:
        changes += 1
    assert changes == MOST and nodes.undecided[0]
    nodes.begin_step()
    assert not nodes.undecided[0]


@pytest.mark.parametrize("method", ["find", "condensed"])
def test_other_states_are_tried_before_a_step_is_given_up(method):
    """A vertex that only friction holds, standing: in the state it is in nothing solves the step,
    by neither method. Those that fail all end it, and are not tried again in the same step.
    """
    nodes, tried = corner(), []

    def find(_index, _load, x, gradient, sliding, _trace, _rtol):
        tried.append(int(nodes.acting[0]))
        if nodes.acting[0] != wanted:
            raise Unfinished(NotConverged("none"), x, gradient)
        return x, gradient, sliding

    operator = SimpleNamespace(
        apply=np.zeros_like, row_level=np.zeros(4, int),
        comm=SimpleNamespace(allgather=lambda value: [value]),
        deformation_by_level=lambda x, weights: np.zeros(1))
    fixed_point = SimpleNamespace(
        **{method: find}, rows=SimpleNamespace(corners=nodes, coefficient=None, offset=None),
        qp=SimpleNamespace(operator=operator, scale=np.ones(4), tol=1e-9,
                           scales=SimpleNamespace(displacements=np.zeros(1))),
        bodies=SupportedBodies(),
        condensation=SimpleNamespace(select=lambda: None))
    states, load = CornerStates(fixed_point, None), SimpleNamespace(weights=np.zeros(0), d=0.0)
    solve = getattr(states, method)
    given = load, np.array([1.0, 1.0, 0.0, 0.0]), np.zeros(4), np.zeros(2), Trace(), 1e-8
    wanted = STANDING
    solve(1, *given)
    assert tried == [BOTH, STANDING]
    wanted, tried = None, []
    for count in (3, 1):  # the states of one corner, then only that which it has
        with pytest.raises(Unfinished):
            solve(2, *given)
        assert len(tried) == count
        tried.clear()
    wanted = FIRST if nodes.acting[0] != FIRST else SECOND  # in the next step all may be tried
    solve(3, *given)
    assert tried[-1] == wanted


@pytest.mark.parametrize("undecided, final, ends", [
    (True, False, True), (False, True, True), (False, False, False)])
def test_what_ends_with_an_undecided_corner_is_the_end_of_the_step(undecided, final, ends):
    """No residual sees what a wrong state leaves out; nor is the end of a search forgotten."""
    nodes, states = corner(), object.__new__(CornerStates)
    nodes.undecided[:], nodes.switch = undecided, lambda *_: False
    states.corners, states.index, states.others, states.none = nodes, 1, [], None
    states._deformation = lambda load, x: None
    states.qp = SimpleNamespace(scale=None, tol=None, operator=SimpleNamespace(comm=None))
    states.fixed_point = SimpleNamespace(rows=None, bodies=SupportedBodies())

    def fails(index, load, x, *_):
        raise Unfinished(NotConverged("no end"), x, x, final)

    with pytest.raises(Unfinished) as caught:
        states._settled(fails, 1, SimpleNamespace(weights=np.zeros(0)), np.zeros(4), np.zeros(4),
                        np.zeros(2), Trace(), 1e-8)
    assert caught.value.final == ends


def test_a_step_with_an_undecided_corner_names_it():
    """Whatever the residuals of what its state leaves: exit status 4."""
    nodes = corner()
    nodes.undecided[:] = True
    states = object.__new__(CornerStates)
    states.corners, states.contact = nodes, SimpleNamespace(xy=np.array([[2.0, 0.5]]))
    failure = states._undecided(3, np.zeros(4), np.zeros(4))  # pylint: disable=protected-access
    assert re.match(r"step 3: .* at the corner \(2, 0.5\)", str(failure))
    assert failure.final and failure.error.exit_status == 4


@pytest.mark.parametrize("errors", [(NoSolution("turns"), NotConverged("circles")),
                                    (NotConverged("circles"), NoSolution("turns"))])
def test_a_body_without_equilibrium_has_none_whatever_its_corners_do(errors):
    """In one state of its corner it turns without end, in the other no state of the corner is
    right: no equilibrium (status 3), whichever of the two comes last; the corner alone is status 4.
    """
    nodes, states = corner(), object.__new__(CornerStates)
    states.corners, states.others, states.none = nodes, [np.array([STANDING])], None
    for last, error in enumerate(errors):
        nodes.undecided[:] = isinstance(error, NotConverged)
        with pytest.raises(Unfinished) if last else nullcontext() as caught:
            states._next(Unfinished(error, None, None))  # pylint: disable=protected-access
    assert caught.value.error.exit_status == 3


def test_least_friction_shares_a_force():
    """Against a linear program, for random corners; no share is outside a cone."""
    rng, ended = np.random.default_rng(5), []
    for _ in range(60):
        angle = rng.uniform(0, 2 * np.pi) + np.array([0.0, rng.uniform(0.6, 2.5)])
        normals = np.column_stack([np.cos(angle), np.sin(angle)])
        tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
        F, c, force = rng.uniform(0, 1, 2), rng.choice([0, 0.1], 2), rng.normal(size=2)
        found = least_friction(force, normals, F, c, np.zeros(2, bool))
        cone = np.hstack([-np.diag(F), np.eye(2), np.eye(2)])  # of p, q+ and q-
        best = linprog([0, 0, 1, 1, 1, 1], A_ub=cone, b_ub=c, b_eq=force,
                       A_eq=np.hstack([normals.T, tangents.T, -tangents.T]))
        ended.append(best.status == 0)
        assert (found is not None) == ended[-1]
        if found is not None:
            p, q = found
            assert p @ normals + q @ tangents == pytest.approx(force, abs=1e-8)
            assert (p >= 0).all() and (np.abs(q) <= F * p + c).all()
            assert np.abs(q).sum() == pytest.approx(best.fun, abs=1e-6)
    assert 10 < sum(ended) < 50


def test_where_a_pull_would_hold_a_corner_of_many_the_other_side_rubs():
    """Rows that depend on those of other vertices keep their forces: a pull there is no sum of
    pressures and friction, but one of both sides may rub.
    """
    for force, state in (([5.0, -1.0], FIRST_RUBS), ([-1.0, 5.0], SECOND_RUBS)):
        nodes = corner()
        nodes.acting, nodes.exact = np.array([STANDING]), np.array([False])
        assert switched(nodes, [1.0, 2.0], [0.0, 0.0]) == (False, STANDING)
        assert switched(nodes, force, [0.0, 0.0]) == (True, state)
        assert nodes.excluded.tolist() == [3 if state == FIRST_RUBS else 2]
        assert switched(nodes, [1.0, 2.0], [0.0, 0.0]) == (False, state)
        x = np.array([1.0, 2.0, 0.3, 0.0])
        assert nodes.own(x).tolist() == x.tolist()  # nothing moves from row to row
        assert switched(nodes, [1.0, 0.0], [0.0, -1e-3]) == (True, FIRST)


PIN = """// a stiff pin of revolution in a hole that is nothing but corners, pressed in and moved up
include "scene.idp"
units("mm", "MPa");
subdomains("1");
quasistatic(1.);
border lower(t = 0, 1) { x = 40 + 70*t; y = 0; label = 1; }
border outer(t = 0, 1) { x = 110; y = 60*t; label = 2; }
border upper(t = 0, 1) { x = 110 - 70*t; y = 60; label = 3; }
border inner(t = 0, 1) { x = 40; y = 60 - 60*t; label = 4; }
border hole(t = 0, -2*pi) { x = 75 + 14*cos(t); y = 30 + 14*sin(t); label = 5; }
border pin(t = 0, 2*pi) { x = 75 + 14*cos(t + pi/8); y = 30 + 14*sin(t + pi/8); label = 6; }
border core(t = 0, -2*pi) { x = 75 + 6*cos(t); y = 30 + 6*sin(t); label = 7; }
mesh block = buildmesh(lower(5) + outer(4) + upper(5) + inner(4) + hole(8));
mesh peg = buildmesh(pin(16) + core(8));
peg = change(peg, fregion = 1);
addBody(block)
addBody(peg)
macro axisymmetric() 1 //
macro young() (region == 1 ? 2e8 : 2e5) //
macro poisson() 0.45 //
macro displacement1() on(7, u1 = 0., u2 = -0.2) //
macro load2() traction(3, -30., 0.) //
macro contact() 1 //
macro contactPair() 5, 6 //
macro friction() 0.3 //
macro amplitude1(t) 1. - abs(2*t - 1.) //
macro amplitude2(t) t //
include "export.idp"
"""


def test_no_vertex_of_a_hole_of_corners_is_pulled(solved, tmp_path):
    """No pressure is below zero, nor friction above its bound, and the forces balance."""
    path = tmp_path / "pin.edp"
    path.write_text(PIN)
    run = solved(path, steps=2, errors="no")
    pressure = -run.contact["sigma_n"]
    assert run.status == 0 and pressure.max() > 0 and pressure.min() == 0.0
    assert (np.abs(run.contact["sigma_t"]) <= 0.3 * pressure * (1 + 1e-6)).all()


RING = """// a ring between two plates, whose labels meet where neither touches it
include "scene.idp"
units("mm", "MPa");
subdomains("3");
border lower(t = pi, 2*pi) { x = 20*cos(t); y = 20*sin(t); label = 1; }
border upper(t = 0, pi) { x = 20*cos(t); y = 20*sin(t); label = 2; }
border inner(t = 0, 2*pi) { x = 14*cos(t); y = 14*sin(t); label = 3; }
body = buildmesh(lower(20) + upper(20) + inner(-28));
if (physical("apart", 0.) > 0)
  body = change(body, flabel = (label < 3 && abs(y) < 4. ? 5 : label));
quasistatic(1.);
macro young() 5. //
macro poisson() 0.4 //
macro contact() 1, 2 //
macro obstacle(x, y) (label == 1 ? y + 20. : 20. - y) //
macro obstacleY(t) (label == 2 ? -0.5*t : 0.) //
macro obstacleX(t) (label == 2 ? 0.1*t : 0.) //
macro friction() 0.5 //
include "export.idp"
"""


def test_a_vertex_between_obstacles_that_face_one_another(solved, tmp_path):
    """Its two normals are opposite. Without contact there, a label of its own, forces are the same,
    but for what the fixed point leaves, 1e-6 of the pressures.
    """
    path = tmp_path / "ring.edp"
    path.write_text(RING)
    meeting, apart = (solved(path, apart=apart, steps=2, errors="energy") for apart in (0, 1))
    assert meeting.status == apart.status == 0 and meeting.summary["errors"]["energy"]["total"] > 0
    for one, other in zip(meeting.summary["boundaries"], apart.summary["boundaries"]):
        assert one["normal_resultant"] > 0.05
        for name in ("force_x", "force_y", "dissipated_energy"):
            assert one[name] == pytest.approx(other[name], abs=1e-5 * one["normal_resultant"])


def test_tractions_beside_a_corner_make_forces_by_its_weight():
    """Of any rows, the first among them; what other ranks own comes from there."""
    rows = np.array([[[0, 2], [1, 3]], [[-1, -1], [3, 0]]])
    near = Beside(rows, np.array([[2.0, 0.5], [1.0, 4.0]]), np.ones(2, bool))
    x, others = np.array([1.0, 3.0, 5.0, 7.0]), np.zeros((2, 2, 2))
    others[1, 0] = [8.0, 9.0]
    comm = SimpleNamespace(allgather=lambda mine: [mine, others])
    assert near.forces(x, comm).tolist() == [[[2, 10], [1.5, 3.5]], [[8, 9], [28, 4]]]


@pytest.mark.parametrize("away", [0, 1, 2])
def test_every_corner_ends_its_step(away):
    """Whether it rests does not depend on those before it: one of two, or none, is away from its
    corner, or has one condition at a time, and others lie in it.
    """
    pairs = np.array([[0, 1], [2, 3]])
    for alone in (False, True):
        one = CornerNodes(pairs, pairs, 4 + pairs, pairs, np.arange(2) == (away if alone else 2),
                          np.zeros((2, 2), bool), np.zeros((2, 2)), np.zeros((2, 2)),
                          np.tile(-np.eye(2), (2, 1, 1)), np.zeros(2, bool), None)
        x, gradient = np.ones(8), np.zeros(8)
        gradient[pairs[away : away + 1]] = 0.0 if alone else 0.5
        one.end_step(x, gradient, None, np.ones(8), SimpleNamespace(allgather=lambda of: [of]))
        assert one.rested.tolist() == [away != 0, away != 1]
