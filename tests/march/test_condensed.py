"""Contact conditions condensed onto their rows: digits where stiffness jumps, friction that slip
changes.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.contact.states import OPEN, SLIP
from driver.errors import NotConverged
from driver.march.condensation import Condensation
from driver.march.fixed_point import FixedPoint
from driver.march.shortcut import Shortcut
from driver.march.step import WINDOW, Load, Trace, Unfinished
from driver.qp import complementarity

STACK = """include "scene.idp"
units("m", "Pa");
subdomains("4");
int[int] low = [1, 11, 21, 31], high = [101, 111, 121, 131];
mesh Low = square(14, 4, [1.373*x^4, 0.4557*y], label = low);
mesh High = square(8, 4, [0.0018 + 1.3697*x, 0.4557 + 0.7695*y], label = high);
High = change(High, fregion = 1);
addBody(Low)
addBody(High)
macro planeStress() 1 //
macro young() (region == 0 ? 1e6 : 1.) //
macro poisson() 0.3 //
macro load1() traction(121, 0., -0.0015) //
macro contact() 1 //
macro contactPair() 101, 21 //
macro friction() 0.5 //
include "export.idp"
"""


@pytest.mark.parametrize("cut", ["4", "9"])
@pytest.mark.slow
def test_a_soft_block_on_a_stiff_one_is_balanced_exactly(built, steps_of, named_scene, cut):
    """Rows differ by 1e7, motions of both bodies are one system's: its LU factors alone leave 1e-9.
    """
    problem = built(scene=named_scene("stack", STACK), subdomains=cut, element="P2")
    solver, steps = steps_of(problem)
    last = steps[-1]
    dense = solver.condensation.problem(
        Load(last.weights, solver.operator.apply(last.multipliers) - last.gradient, 1.0),
        last.multipliers, last.gradient)
    z = complementarity.newton(dense, complementarity.all_alike(dense)[0])
    assert z is not None and dense.violation(z) < 1e-10


DISC = """include "scene.idp"
units("1", "1");
subdomains("1");
real slipRange = 0.005;
border arc(t=pi, 2*pi) { x = 0.8*cos(t); y = 0.8 + 0.8*sin(t); label = 1; }
border top(t=0, 1) { x = 0.8 - 1.6*t; y = 0.8; label = 11; }
body = buildmesh(arc(6) + top(3));
macro planeStress() 1 //
macro young() (y < 0.3934 ? 1.0 : 0.001) //
macro poisson() 0.2 //
macro load1() traction(11, -4.7e-6, -1.6e-4) //
macro contact() 1 //
macro gap() 0.005*x^2 //
macro friction() 0.5 //
macro slipFactor(s) (1. + 0.3*s/slipRange) //
include "export.idp"
"""


def test_slip_of_a_free_body_is_found_with_its_own_friction(built, steps_of, named_scene,
                                                            monkeypatch):
    """Soft material holds the springs: the last digit of a friction force moves the body visibly.

    Forces stay those that balance, at the friction they were found with; open nodes have none.
    """
    def condensed(self, index, load, x, gradient, sliding, trace, rtol):
        return self.condensed(index, load, x, gradient, sliding, trace, rtol)

    monkeypatch.setattr(FixedPoint, "find", condensed)
    problem = built(scene=named_scene("disc", DISC), element="P2")
    solver, steps = steps_of(problem, rtol=1e-10, friction_rtol=1e-8)
    assert solver.failure is None
    last, rows = steps[-1], solver.rows
    pressure, friction = (last.multipliers[row] for row in (rows.normal, rows.tangential))
    assert (last.status == SLIP).sum() == 6 and not pressure[last.status == OPEN].any()
    # nodes that slide start apart from the obstacle: half of their way counts
    way = np.minimum(np.abs(last.gradient[rows.tangential]) / 2 / 0.005, 1.0)
    bound = 0.5 * (1 + 0.3 * way) * pressure
    slides = last.status == SLIP
    np.testing.assert_allclose(np.abs(friction[slides]), bound[slides], rtol=1e-8)
    assert (np.abs(friction[~slides]) <= bound[~slides]).all()


def test_forces_that_hide_the_loads_are_no_start(built, steps_of, named_scene, monkeypatch):
    """Friction that jams lets forces balance at any size: the step begins once more without them.
    """
    calls = []

    def astray(self, index, load, x, gradient, sliding, trace, rtol):
        calls.append(rtol)
        if len(calls) > 1:
            raise Unfinished(NotConverged("lost in rounding"), calls[0], None)
        calls[0] = 1e6 * (1.0 + x)
        return calls[0], None, sliding

    monkeypatch.setattr(FixedPoint, "find", astray)
    solver, steps = steps_of(built(scene=named_scene("disc", DISC), element="P2"), rtol=1e-10)
    assert solver.failure is None and len(calls) == 2
    assert max(steps[-1].residuals.values()) <= 1e-6


def condensed(first: int, last: int, allgather, idle=(False, False, False)) -> Condensation:
    """Of one of two ranks, which owns the dual rows `first`, ..., `last` - 1; three contact nodes,
    one of them without friction, `idle` those that face nothing.
    """
    contact = SimpleNamespace(gid=np.arange(3), normal_row=np.array([6, 1, 4]),
                              tangential_row=np.array([7, -1, 2]), idle=np.array(idle))
    own = [k for k in (0, 2) if first <= contact.tangential_row[k] < last]
    operator = SimpleNamespace(structure=SimpleNamespace(contact=contact, row_range=(first, last)),
                               comm=SimpleNamespace(size=2, allgather=allgather))
    rows = np.concatenate([contact.normal_row[contact.idle], contact.tangential_row[contact.idle]])
    return Condensation(operator, SimpleNamespace(corners=None, excluded=rows - first,
                                                  tangential_node=np.array(own)))


def test_contact_parts_of_dual_vectors_go_there_and_back():
    """Normal rows in the order of the nodes, then tangential ones, whoever owns them."""
    whole, ranks = np.arange(8.0) ** 2, ((0, 5), (5, 8))
    parts = []
    for first, last in ranks:
        condensed(first, last, lambda part: parts.append(part) or [part]).gather(whole[first:last])
    expected = whole[[6, 1, 4, 7, 2]]
    np.testing.assert_array_equal(sum(parts), expected)
    for first, last in ranks:
        one = condensed(first, last, lambda part: parts)
        np.testing.assert_array_equal(one.gather(whole[first:last]), expected)
        placed = one.place(-expected, whole[first:last])
        changed = np.where(np.isin(np.arange(8), [6, 1, 4, 7, 2]), -whole, whole)[first:last]
        np.testing.assert_array_equal(placed, changed)
        assert one.pair.tolist() == [0, 2] and not one.apart.size and one.size == 5


def test_nodes_that_face_nothing_do_not_act():
    """Their rows are left out, and have no force."""
    whole = np.arange(8.0) ** 2
    one = condensed(0, 8, lambda part: [part], idle=(True, False, False))
    assert one.nodes.tolist() == [1, 2] and one.pair.tolist() == [1]
    assert (one.size, one.total) == (3, 5)
    np.testing.assert_array_equal(one.gather(whole), whole[[1, 4, 2]])
    placed = one.place(-whole[[1, 4, 2]], whole)
    np.testing.assert_array_equal(placed, np.where(np.arange(8) >= 6, 0.0, placed))
    assert placed[[1, 4, 2]].tolist() == [-1.0, -16.0, -4.0]


@pytest.mark.parametrize("near", [True, False])
def test_a_guess_is_tried_once_before_the_states_at_hand(monkeypatch, near):
    """With its own movements; the states at hand are those of x and of what slides."""
    one, tried = object.__new__(Condensation), []
    guess, x = np.array([0.5, 0.25]), np.array([9.0, 8.0])
    one.guess, one.apart, one._rubbing = guess, np.zeros(0, int), np.array([1, 0])
    one._acting, one.operator = None, SimpleNamespace(products=0)
    problem = SimpleNamespace(movement=lambda z: z + 1.0, products=3,
                              states_of=lambda start, signs: (start.tolist(), signs.tolist()))
    monkeypatch.setattr(Condensation, "problem", lambda *_: problem)
    monkeypatch.setattr(Condensation, "gather", lambda _, x: x)
    monkeypatch.setattr(Condensation, "place", lambda _, x, into: x.copy())

    def settled(of, start, move, states=None):
        tried.append((start.tolist(), move.tolist(), states))
        return (2 * start, -move) if near or states is not None else None

    monkeypatch.setattr(complementarity, "settled", settled)
    found, gradient = one.solution(None, x, np.array([1.0, -1.0]), np.array([0.0, 1.0]))
    first = ([0.5, 0.25], [1.5, 1.25], None)
    then = ([9.0, 8.0], [-1.0, 1.0], ([9.0, 8.0], [1.0, 0.0]))
    assert tried == ([first] if near else [first, then]) and one.guess is None
    assert found.tolist() == ([1.0, 0.5] if near else [18.0, 16.0])
    assert gradient.tolist() == tried[-1][1] and one.operator.products == 3
    monkeypatch.setattr(complementarity, "settled", lambda *_: None)
    assert one.solution(None, x, x, np.zeros(2)) is None


@pytest.mark.parametrize("excluded", [[], [1]])
def test_the_gradient_of_a_condensed_solution_is_that_of_the_operator(monkeypatch, excluded):
    """F x - d where rows that the states of corners leave out, without force, move as well."""
    F, d = np.array([[3.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 5.0]]), np.array([1.0, 2.0, 3.0])
    solution = np.array([0.5, 0.25, 0.75])
    one = object.__new__(Condensation)
    one.guess, one.apart, one._rubbing = None, np.zeros(0, int), np.zeros(0, bool)
    one.rows = SimpleNamespace(excluded=np.array(excluded, int))
    one.operator = SimpleNamespace(products=0, apply=lambda x: F @ x)
    monkeypatch.setattr(Condensation, "problem", lambda *_: SimpleNamespace(
        states_of=lambda *_: None, products=2))
    monkeypatch.setattr(Condensation, "gather", lambda _, x: x)
    acts = np.setdiff1d(np.arange(3), excluded)
    one._acts, one._acting = (acts, acts, len(acts)), acts if excluded else None
    moved = d - F @ solution
    monkeypatch.setattr(complementarity, "settled", lambda *_: (solution, moved))
    x, gradient = one.solution(SimpleNamespace(d=d), np.zeros(3), -d, np.zeros(0))
    assert not x[excluded].any() and one.operator.products == 2
    np.testing.assert_allclose(gradient, F @ x - d, atol=1e-15)


@pytest.mark.parametrize("settles", [True, False])
@pytest.mark.some(1)
def test_starts_that_lead_in_circles_are_left_out(built, steps_of, monkeypatch, settles):
    """Contact forces that answer to the gluing forces of the iteration before may do so for ever,
    although friction bounds would settle from the forces of a QP. Where these settle nothing is
    lost, and no other method is called for.
    """
    problem, calls = built("model", loading="monotone", subdomains=5, cells=4, steps=2), []
    known = FixedPoint._correct  # pylint: disable=protected-access

    def swings(self, load, x, gradient, relaxation):
        calls.append(0.5 * (-1) ** len(calls))
        x = known(self, load, x, gradient, relaxation)
        return x if settles else x * (1.0 + calls[-1])

    monkeypatch.setattr(FixedPoint, "_correct", swings)
    monkeypatch.setattr(Shortcut, "possible", False)  # as where there is no room for elimination
    solver, steps = steps_of(problem)
    assert solver.failure is None and not solver.history.fallbacks.warnings()
    assert max(steps[-1].residuals.values()) <= 1e-6
    assert (steps[0].fixed_point_iterations > 2 * WINDOW) == (not settles)


@pytest.mark.parametrize("exact, uneven, corrected", [
    (False, False, True), (True, False, False), (True, True, True)])
def test_what_qps_start_from(exact, uneven, corrected):
    """Contact forces that answer to the gluing forces at hand, but not after they led in circles,
    unless rounding ends QPs early: there they spare more than they cost.
    """
    one = object.__new__(FixedPoint)
    relaxation = SimpleNamespace(moved=lambda start, x, gradient: gradient)
    one.rows = SimpleNamespace(follow=lambda x, sliding: x)
    one.settings = SimpleNamespace(corrector="contact")
    one.qp = SimpleNamespace(accelerators=SimpleNamespace(relaxation=relaxation),
                             placed=lambda start, d, x, gradient: (start, gradient))
    one.operator = SimpleNamespace(uneven=uneven, modes=0)
    one._correct = lambda load, start, gradient, relaxation: start + 1.0
    start, _ = one._start(Load(np.ones(1), np.zeros(2), 1.0), np.zeros(2), np.zeros(2), None,
                          Trace(exact=exact))
    assert start.tolist() == [1.0 * corrected] * 2


@pytest.mark.parametrize("violation, by_forces", [(1e-10, True), (1e-8, False)])
def test_a_solution_is_corrected_in_the_states_of_its_forces(violation, by_forces):
    """Movements say the same but on the border of states, where they are rounding."""
    problem = SimpleNamespace(
        violation=lambda z, movement: violation, states=lambda z, movement: "movement",
        states_by_forces=lambda z: "forces", signs=lambda z: "signs",
        system=lambda states, signs: SimpleNamespace(doubtful=False),
        correction_in=lambda states, *_: (states, None))
    assert Condensation._step(problem, None, None) == ("forces" if by_forces else "movement")


def test_missing_forces_leave_nodes_apart(monkeypatch):
    """Of a corner that is open on both sides and rubs: no rounding of its movement closes it."""
    one, moved = object.__new__(Condensation), []
    one.n, one.m, one.apart, one.rows = 1, 1, np.array([0]), SimpleNamespace(corners=None)
    one.operator = SimpleNamespace(structure=SimpleNamespace(row_range=(0, 2)), owned=2,
                                   comm=SimpleNamespace(allgather=lambda part: [part], size=1),
                                   apply=np.zeros_like)
    vars(one)["elimination"] = SimpleNamespace(change=np.zeros_like)
    problem = SimpleNamespace(whole=lambda x: x, signs=lambda z: None,
                              violation=lambda z, movement: 1.0,
                              states=lambda z, movement: moved.extend(movement.tolist()),
                              system=lambda *_: SimpleNamespace(doubtful=True))
    monkeypatch.setattr(Condensation, "compliance", lambda self: np.eye(2))
    monkeypatch.setattr(Condensation, "gather", lambda self, x: x.copy())
    monkeypatch.setattr(Condensation, "_under", lambda self, load, d: problem)
    assert one.correction(None, np.zeros(2), np.array([-1e-17, 0.5])) is None
    assert moved == [-0.5, -0.5]
