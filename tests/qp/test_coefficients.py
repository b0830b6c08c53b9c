"""Friction of its own slip: bodies on weak springs."""

import numpy as np
import pytest
from test_continuation import random_problem

from driver.march.globalization import solve_condensed
from driver.qp import approximations, coefficients
from driver.qp.coulomb import ROUNDING, CoulombProblem

NODES = 6
SOFT = 1e5  # times as soft as the body are the springs that it hangs on


def on_springs(seed: int, soft: float = SOFT) -> CoulombProblem:
    """A body of NODES nodes that springs of compliance `soft` hold, pressed and dragged."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2 * NODES, 2 * NODES + 4))
    elastic = root @ root.T / (2 * NODES)
    way = np.block([[np.ones((NODES, 1)), np.zeros((NODES, 1)), rng.standard_normal((NODES, 1))],
                    [np.zeros((NODES, 1)), np.ones((NODES, 1)), rng.standard_normal((NODES, 1))]])
    compliance = elastic + soft * way @ way.T
    forces = np.append(rng.uniform(0.2, 1.0, NODES), rng.uniform(-0.4, 0.4, NODES))
    return CoulombProblem(compliance, compliance @ forces + rng.standard_normal(2 * NODES),
                          np.full(NODES, 0.3), np.arange(NODES))


def law(slip: np.ndarray) -> np.ndarray:
    """Friction that falls by slip."""
    return 0.3 / (1.0 + 0.5 * np.abs(slip))


def test_bodies_on_weak_springs_find_the_friction_of_their_slip():
    """Steps lead to it from most solutions with given friction, as they do on stiffer springs, 31
    of 40. With rows' own compliances, which say nothing of what nodes do, they did from 8.
    """
    found = 0
    for seed in range(40):
        problem = on_springs(seed)
        start = approximations.approached(problem, np.zeros(2 * NODES))
        z = None if start is None else coefficients.consistent(problem, start, law)
        if z is not None:
            slip = problem.movement(z)[NODES:]
            assert problem.under(problem.load, law(slip)).violation(z) < 10 * ROUNDING
            found += 1
    assert found >= 24


@pytest.mark.parametrize("motions, pulls", [(0, "none"), (1, "none"), (0, "all"), (1, "all")])
@pytest.mark.some(2)
def test_conditions_that_depend_on_one_another_find_the_friction_of_their_slip(motions, pulls):
    """Two pairs of nodes at one place each, as where three bodies meet; friction grows by slip.

    From nearly every solution with given friction; of 20 it had been from 8, 5, none and none where
    such rows were taken for as rigid against each other as their rounding.
    """
    twice = np.array([0, 1, 2, 3, 4, 5, 0, 1, 6, 7, 8, 9, 10, 6, 7])  # nodes 0 and 1, with friction
    found = 0
    for seed in range(10):
        one = random_problem(seed, 6, motions, pulls)
        problem = CoulombProblem(
            one.compliance[np.ix_(twice, twice)], one.load[twice], np.full(7, 0.8),
            np.array([0, 1, 2, 3, 4, 6, 7]), one.bilateral[twice[:8]], one.motions[twice],
            one.balance)
        start, _ = solve_condensed(problem, np.zeros(problem.rows + motions))
        most = np.abs(problem.movement(start)[8:]).max()
        z = coefficients.consistent(problem, start, lambda slip, most=most: (
            0.8 * (1.0 + 0.3 * np.minimum(np.abs(slip) / most, 1.0))))
        found += z is not None
    assert found >= 8
