"""The way to the only solution of the dense contact problem that takes least."""

from types import SimpleNamespace

import numpy as np
import pytest

from contact_law import assert_obeys
from driver.qp import one_solution
from driver.qp.approximations import approached
from driver.qp.coulomb import CoulombProblem
from driver.qp.nearby import Nearby
from driver.qp.one_solution import only_solution
from driver.qp.state_system import StateSystem


def counted(monkeypatch) -> list:
    """A list that grows with every linear system that is solved, by factors of its own or not."""
    systems, factorize, solution = [], StateSystem.__init__, Nearby.solution

    def make(*given):
        systems.append(1)
        factorize(*given)

    def update(*given):
        z = solution(*given)
        systems.extend([1] * (z is not None))
        return z

    monkeypatch.setattr(StateSystem, "__init__", make)
    monkeypatch.setattr(Nearby, "solution", update)
    return systems


def halfspace(nodes: int, friction: float) -> CoulombProblem:
    """Nodes along a line on a half-space, pressed by a parabola and dragged, of one solution."""
    distance = np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    near, none = 1.0 - np.log(1.0 + distance) / (2 * np.log(nodes)), np.zeros((nodes, nodes))
    place = np.linspace(-1.2, 1.2, nodes)
    load = np.append(1.0 - place**2, np.full(nodes, 0.1))
    return CoulombProblem(np.block([[near, none], [none, near]]), load,
                          np.full(nodes, friction), np.arange(nodes))


@pytest.mark.parametrize("friction, part", [(0.0, 1.0), (0.3, 0.8), (0.6, 0.6)])
def test_an_only_solution_takes_fewer_systems(friction, part, monkeypatch):
    """Step after step of a drag to and fro, to the bits of what other ways come to.
    """
    problem, before = halfspace(120, friction), np.zeros(240)
    systems, taken = counted(monkeypatch), {approached: 0, only_solution: 0}
    for drag in np.sin(np.linspace(0, 2 * np.pi, 20)):
        problem.load[120:] = 0.3 * drag
        found = {}
        for way in taken:
            del systems[:]
            found[way] = way(problem, before)
            taken[way] += len(systems)
        before = found[only_solution]
        assert np.array_equal(before, found[approached])
        assert_obeys(problem, before)
    assert taken[only_solution] <= part * taken[approached]


def test_a_surface_that_closes_is_far_softer_than_its_nodes(monkeypatch):
    """Under half the load all nodes would open again and close: movements count by little."""
    systems, taken = counted(monkeypatch), []
    for soft in (one_solution.SOFT, 1.0):
        monkeypatch.setattr(one_solution, "SOFT", soft)
        problem, z = halfspace(120, 0.3), np.zeros(240)
        del systems[:]
        for press in (1.0, 0.3, 2.0, 0.1):
            problem.load[:120] = press - np.linspace(-1.2, 1.2, 120) ** 2
            problem.load[120:] = 0.2 * press
            z = only_solution(problem, z)
            assert_obeys(problem, z)
        taken.append(len(systems))
    assert taken[0] <= 0.75 * taken[1]  # a descent of the energy, too, changes many nodes at once


def test_a_body_that_nothing_holds_yet_starts_where_all_nodes_stick(monkeypatch):
    """A round punch that moves freely, put down and pushed; one node has no tangential row. Nodes
    that stick hold it, and then most of them open; from no forces at all nothing leads on.
    """
    half, kept = halfspace(60, 0.3), np.delete(np.arange(120), 60)
    along = np.repeat(np.eye(2), 60, axis=0)[kept]
    gap = np.append(-12.0 * np.linspace(-1, 1, 60)**2, np.zeros(59))
    problem = CoulombProblem(half.compliance[np.ix_(kept, kept)], gap, np.full(59, 0.3),
                             np.arange(1, 60), motions=along, balance=np.array([20.0, 3.0]))
    z = only_solution(problem, problem.whole(np.zeros(119)))
    assert 10 < np.count_nonzero(z[:60] > 0) < 50
    assert_obeys(problem, z)
    monkeypatch.setattr(one_solution, "_first", lambda problem, start: start)
    monkeypatch.setattr(one_solution, "on_springs", lambda problem, start: None)
    assert only_solution(problem, problem.whole(np.zeros(119))) is None


def lug(turned: float, nodes: int = 24, friction: float = 0.25) -> CoulombProblem:
    """A lug that lies loose on a pin, pulled by one and turned by a part of what friction carries.

    A clearance of the size of its deformation, so that contact is less than all around.
    """
    angle, none = 2 * np.pi * np.arange(nodes) / nodes, np.zeros(nodes)
    apart = np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    near = np.exp(-np.minimum(apart, nodes - apart) / 3.0)
    motions = np.vstack([np.column_stack([np.cos(angle), np.sin(angle), none]),
                         np.column_stack([-np.sin(angle), np.cos(angle), none + 1.0])])
    return CoulombProblem(np.kron(np.eye(2), near), np.append(none - 1.0, none), none + friction,
                          np.arange(nodes), motions=motions,
                          balance=np.array([1.0, 0.0, turned * friction]))


@pytest.mark.parametrize("turned", [0.6, 0.9, 1.0])  # arcs of contact carry a little more than 1
def test_springs_hold_a_body_that_friction_bounds_on_the_way_do_not(turned, monkeypatch):
    """They are those of pressures that may be too small to balance what turns it."""
    problem = lug(turned)
    z = only_solution(problem, problem.whole(np.zeros(48)))
    assert_obeys(problem, z)
    monkeypatch.setattr(one_solution, "on_springs", lambda problem, start: None)
    assert only_solution(problem, problem.whole(np.zeros(48))) is None


@pytest.mark.parametrize("along", [False, True])
def test_a_body_that_contact_holds_starts_without_friction(along):
    """Where it is free `along` the obstacle, too, nodes that stick hold it."""
    half, motion = halfspace(80, 0.3), np.repeat(np.eye(2), 80, axis=0)[:, : 1 + along]
    problem = CoulombProblem(half.compliance, half.load, half.coefficient, half.pair,
                             motions=motion, balance=np.array([20.0, 3.0])[: 1 + along])
    z = one_solution._first(problem, problem.whole(np.zeros(160)))
    assert z[80:160].any() == along and z[80:160].sum() == pytest.approx(3.0 * along)
    assert z[:80].min() > 0 and z[:80].sum() == pytest.approx(20.0)


@pytest.mark.parametrize("by_forces", [True, False])
def test_a_solution_has_the_states_of_its_forces(by_forces):
    """If these are a solution's; those of its movements are rounding on the border of states."""
    problem = SimpleNamespace(states_by_forces=lambda z: "forces", states=lambda z: "movements",
                              solution_in=lambda states, signs: states, signs=lambda z: None,
                              solves=lambda z: z == "movements" or by_forces)
    assert one_solution._exactly(problem, "z") == ("forces" if by_forces else "movements")


def test_a_solution_on_the_border_of_states_is_left_as_it_is(monkeypatch):
    """Of nodes that have slid and rest with all the friction that they had movements are rounding,
    and say other states than forces. One system says that it is a solution.
    """
    problem = halfspace(80, 0.3)
    problem.load[80:] = 1.0
    z = only_solution(problem, np.zeros(160))
    slid = np.abs(z[80:]) >= (1 - 1e-9) * problem.bounds(z)
    assert np.count_nonzero(slid & (z[:80] > 0)) > 20
    rounded = 1e-12 * np.random.default_rng(3).standard_normal(160)
    problem.load[80:] = (problem.compliance @ z)[80:]
    problem.load += rounded
    systems = counted(monkeypatch)
    found = only_solution(problem, z)
    assert_obeys(problem, found)
    assert len(systems) <= 2
    np.testing.assert_allclose(found, z, atol=1e-9)
