"""By how much successive approximations contract near a solution, by one linear iteration."""

import numpy as np
import pytest
from test_complementarity import random_problem

from driver.qp import one_solution
from driver.qp.contraction import contraction
from driver.qp.coulomb import CoulombProblem
from driver.qp.equations import FORWARD, STICK


def approximated(problem, bounds):
    """Friction bounds of the pressures that the solution with given `bounds` (m,) has."""
    given = problem.under(problem.load, np.zeros(problem.m), offset=bounds)
    return problem.bounds(one_solution.only_solution(given, given.whole(np.zeros(given.rows))))


@pytest.mark.parametrize("motions", [0, 2])
@pytest.mark.parametrize("seed", range(8))
def test_changes_of_friction_bounds_fall_by_it(seed, motions):
    """From bounds next to those of the solution, so that no state changes; nodes that are held
    pull, too, and bodies without support move.
    """
    problem = random_problem(seed, 8, largest=0.6, bilateral=seed % 2 == 1, motions=motions)
    z = one_solution.only_solution(problem, problem.whole(np.zeros(problem.rows)))
    if z is None:  # nothing balances what was drawn
        assert motions
        return
    rate, bounds = contraction(problem, z, 3), problem.bounds(z)
    slides = problem.states(z)[problem.pair] > STICK
    found, sizes = (1 + 1e-5) * bounds, []
    for _ in range(4):
        sizes.append(np.linalg.norm((found - bounds)[slides]))
        found = approximated(problem, found)
    if sizes[1] <= 1e-14 * np.abs(bounds).max():  # nothing slides, or it presses all the same
        assert np.isnan(rate)
    else:
        rounding = 1e-13 * np.abs(bounds).max()
        assert sizes[1] * rate**2 == pytest.approx(sizes[3], rel=1e-4, abs=rounding)


def test_nothing_contracts_where_nothing_slides():
    problem = random_problem(0, 8, largest=0.6)
    stuck = problem.under(np.append(np.ones(problem.n), np.zeros(problem.m)),
                          np.full(problem.m, 1e3))
    z = one_solution.only_solution(stuck, stuck.whole(np.zeros(stuck.rows)))
    assert np.isnan(contraction(stuck, z, 4))


def test_a_vertex_that_is_held_twice_tells_no_rate():
    """Where three bodies meet, conditions depend on one another; of given bounds none is asked."""
    C = np.kron([[1.0, 0.2], [0.2, 1.0]], np.ones((2, 2)))
    z = np.array([1.0, 1.0, 0.3, 0.0])
    problem = CoulombProblem(C, C @ z, np.full(2, 0.3), np.arange(2))
    assert problem.states(z).tolist() == [FORWARD, STICK] and np.isnan(contraction(problem, z, 3))
    given = problem.under(problem.load, np.zeros(2), offset=np.array([0.3, 0.3]))
    assert given.states(z).tolist() == [FORWARD, STICK] and np.isnan(contraction(given, z, 3))
