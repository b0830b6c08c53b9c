"""Linear systems of states near factorized ones, against factors of their own."""

import gc
import weakref

import numpy as np
import pytest
from test_complementarity import random_problem
from test_one_solution import halfspace

from driver.contact.states import STICK
from driver.qp.coulomb import FORWARD, CoulombProblem
from driver.qp.nearby import FEW, Nearby, nearly_in
from driver.qp.one_solution import only_solution
from driver.qp.state_system import StateSystem

NODES = 40


def drawn(rng, problem: CoulombProblem) -> np.ndarray:
    """(n,) states of all kinds that the problem's nodes may be in."""
    return np.array([rng.choice(problem.choices(node)) for node in range(problem.n)])


def changed(rng, problem: CoulombProblem, states: np.ndarray, count: int) -> np.ndarray:
    """`states` (n,) with others at `count` nodes."""
    states, where = states.copy(), rng.choice(problem.n, count, replace=False)
    states[where] = drawn(rng, problem)[where]
    return states


@pytest.mark.parametrize("kind", ["friction", "offsets", "given bounds", "bilateral", "free"])
@pytest.mark.parametrize("count", [0, 1, 4])
def test_few_changes_are_those_of_new_factors(kind, count):
    """Rows begin or cease to move, slide or turn, with friction that pressures bound or not."""
    rng, problem = np.random.default_rng(count), halfspace(NODES, 0.4)
    offset = rng.uniform(0.0, 0.2, NODES)
    if kind == "offsets":
        problem = problem.under(problem.load, problem.coefficient, offset=offset)
    elif kind == "given bounds":
        problem = problem.under(problem.load, np.zeros(NODES), offset=offset)
    elif kind == "bilateral":
        problem = CoulombProblem(problem.compliance, problem.load, problem.coefficient,
                                 problem.pair, rng.random(NODES) < 0.5)
    elif kind == "free":
        problem = CoulombProblem(problem.compliance, problem.load, problem.coefficient,
                                 problem.pair, motions=rng.standard_normal((2 * NODES, 3)),
                                 balance=rng.standard_normal(3), offset=offset)
    sign = np.where(problem.bilateral & (rng.random(NODES) < 0.5), -1.0, 1.0)
    states = np.where(np.arange(NODES) < NODES // 2, STICK, drawn(rng, problem))
    problem.solution_in(states, sign)
    states = changed(rng, problem, states, count)
    if kind == "bilateral":
        sign[:2] *= -1.0
    near = nearly_in(problem, states, sign)
    assert problem.latest[problem.rubs][2], "factors were made anew"
    exact = problem.solution_in(states, sign)
    # rounding times the condition of systems of some 60 rows, 1e4 here, with room
    np.testing.assert_allclose(near, exact, rtol=0, atol=1e-10 * np.abs(exact).max())


def test_many_changes_have_factors_of_their_own():
    """Also where states let bodies go, or the factorized ones did."""
    problem = halfspace(NODES, 0.4)
    sticks, slides = np.full(NODES, STICK), np.full(NODES, FORWARD)
    problem.solution_in(sticks, np.ones(NODES))
    _, system, _ = problem.latest[True]
    few = int(FEW * 2 * NODES)
    states = np.where(np.arange(NODES) < few, FORWARD, STICK)
    assert Nearby(system, problem.rows).solution(problem, states, np.ones(NODES)) is not None
    assert Nearby(system, problem.rows).solution(problem, slides, np.ones(NODES)) is None
    exact = problem.solution_in(slides, np.ones(NODES))
    problem.solution_in(sticks, np.ones(NODES))
    assert np.array_equal(nearly_in(problem, slides, np.ones(NODES)), exact)
    lifted = np.zeros(NODES, int)
    for _ in range(2):  # all open: there is nothing to be solved
        assert not nearly_in(problem, lifted, np.ones(NODES)).any()
    free, signs = random_problem(1, 6, motions=2), np.ones(6)
    held, loose = np.full(6, STICK), np.where(np.arange(6) < 1, FORWARD, 0)
    assert free.held(held).shape[1] == 2 > free.held(loose).shape[1]
    for first, second in ((held, loose), (loose, held)):
        free.solution_in(first, signs)
        near = nearly_in(free, second, signs)
        assert np.array_equal(near, free.solution_in(second, signs))


def test_a_system_that_becomes_singular_is_not_updated():
    """Two rows of the same movements, but for rounding: one may stick, or the other."""
    nodes = 12
    C = np.eye(2 * nodes)
    C[-2:, -2:] = [[1.0, 1.0], [1.0, 1.0 + 1e-13]]
    problem = CoulombProblem(C, np.ones(2 * nodes), np.full(nodes, 0.3), np.arange(nodes))
    states, sign = np.full(nodes, STICK), np.ones(nodes)
    states[-1] = FORWARD
    problem.solution_in(states, sign)
    near = Nearby(problem.latest[True][1], problem.rows)
    assert near.solution(problem, states, sign) is not None
    assert near.solution(problem, np.full(nodes, STICK), sign) is None


def test_systems_go_when_others_come():
    """At once: each is as large as the compliance, and cycles are looked for seldom."""
    problem, states = halfspace(NODES, 0.4), np.full(NODES, STICK)
    problem.solution_in(states, np.ones(NODES))
    system = weakref.ref(problem.latest[True][1])
    nearly_in(problem, np.where(np.arange(NODES) < 2, FORWARD, STICK), np.ones(NODES))
    assert problem.latest[True][1] is system() and problem.latest[True][2]
    gc.disable()
    try:
        problem.solution_in(np.full(NODES, FORWARD), np.ones(NODES))
        assert system() is None
    finally:
        gc.enable()


def test_steps_of_a_drag_are_solved_with_few_factors(monkeypatch):
    """One or two a step: those of the solution, and where friction bounds are given."""
    made, honest = [], StateSystem.__init__
    monkeypatch.setattr(StateSystem, "__init__",
                        lambda self, *given: made.append(1) or honest(self, *given))
    problem, z, drags = halfspace(120, 0.3), np.zeros(240), np.sin(np.linspace(0, 2 * np.pi, 40))
    for drag in drags:
        problem.load[120:] = 0.3 * drag
        z = only_solution(problem, z)
        assert problem.solves(z)
    assert len(made) <= 2 * len(drags)
