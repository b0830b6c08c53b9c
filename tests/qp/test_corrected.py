"""Solutions corrected by what movements miss, to digits of the change."""

import numpy as np
import pytest
from test_complementarity import random_problem

from driver.qp import correction
from driver.qp.complementarity import newton
from driver.qp.correction import corrected
from driver.qp.coulomb import CoulombProblem

WRONG = 1e-7  # part by which the compliance is off


def off(problem: CoulombProblem, seed: int) -> CoulombProblem:
    """The same problem with another compliance, by as much as rounding may make it."""
    draw = np.random.default_rng(seed).standard_normal(problem.compliance.shape)
    return CoulombProblem(problem.compliance * (1 + WRONG * (draw + draw.T)), problem.load,
                          problem.coefficient, problem.pair, problem.bilateral, problem.motions,
                          problem.balance, problem.offset)


def missed(problem: CoulombProblem, z: np.ndarray) -> np.ndarray:
    """Movement at z in extended precision."""
    x, beta = np.split(z.astype(np.longdouble), [problem.rows])
    return (problem.load - problem.compliance @ x + problem.motions @ beta).astype(float)


@pytest.mark.parametrize("bilateral", [False, True])
@pytest.mark.parametrize("motions", [0, 1])
@pytest.mark.parametrize("seed", range(6))
def test_a_solution_is_corrected_by_a_compliance_that_is_not_exact(seed, motions, bilateral):
    """From the solution with that compliance to that of the law, with all its digits."""
    problem = random_problem(seed, 4, 0.3, motions, bilateral)
    near = off(problem, seed)
    z = newton(near, np.zeros(8 + motions))
    first = problem.violation(z)
    for _ in range(3):
        z = z + corrected(near, z, missed(problem, z))
    assert first > 1e-9 and problem.violation(z) < 1e-13


def test_nodes_change_their_states_on_the_way():
    """From no force at all: contact, sticking and sliding are found, too."""
    for seed in range(6):
        problem = random_problem(seed, 4, 0.3)
        start = np.zeros(8)
        change = corrected(problem, start, problem.movement(start))
        assert problem.violation(change) < 1e-12


def test_offsets_are_no_part_of_a_change():
    """A node that slides by its offset alone is on it already."""
    problem = CoulombProblem(np.eye(2), np.array([-1.0, 2.0]), np.array([0.5]), np.array([0]),
                             offset=np.array([0.75]))
    z = np.array([0.0, 0.75])
    np.testing.assert_allclose(corrected(problem, z, problem.movement(z)), 0.0, atol=1e-15)
    np.testing.assert_allclose(corrected(problem, 0.9 * z, problem.movement(0.9 * z)),
                               [0.0, 0.075])


@pytest.mark.parametrize("overlap, settles", [(1e-10, True), (1e-2, False)])
def test_states_that_come_again_are_taken_where_the_law_holds_to_rounding(overlap, settles):
    """Rows that depend on one another, whose compliance rounding makes indefinite: neither state of
    the second node is a solution.
    """
    compliance = np.array([[1.0, 1 + 1e-6], [1 + 1e-6, 1.0]])
    problem = CoulombProblem(compliance, np.array([1.0, 1 + 1e-6 + overlap]), np.zeros(0),
                             np.zeros(0, int))
    z = np.array([1.0, 0.0])
    change = corrected(problem, z, problem.movement(z))
    assert (change is not None) == settles


def test_states_that_settle_but_balance_nothing_are_no_solution():
    """A node that opens under a load that pulls its body away: no row holds the motion."""
    pulled = CoulombProblem(np.eye(1), np.array([-1.0]), np.zeros(0), np.zeros(0, int), False,
                            np.ones((1, 1)), np.array([-2.0]))
    assert corrected(pulled, np.zeros(2), np.array([-1.0])) is None
    pushed = CoulombProblem(np.eye(1), np.array([1.0]), np.zeros(0), np.zeros(0, int), False,
                            np.ones((1, 1)), np.array([2.0]))
    assert corrected(pushed, np.zeros(2), np.array([1.0])) == pytest.approx([2.0, 1.0])


def test_rigidity_is_what_a_row_resists_while_others_stay():
    """Of rows that move together, too; one that depends on others resists as far as BESIDE goes."""
    soft = 1e3
    pair = np.array([[soft + 0.5, soft], [soft, soft + 0.5]])
    expected = 1 / (soft + 0.5 - soft**2 / (soft + 0.5))
    # the two differ by 1e-3, which BESIDE is a thousandth of
    np.testing.assert_allclose(correction.rigidity(pair), expected, rtol=2e-3)
    dependent = correction.rigidity(np.ones((2, 2)))
    assert np.isfinite(dependent).all() and (dependent > 0.1 / correction.BESIDE).all()
