"""Problems whose rows depend on one another: places where three bodies meet."""

import dataclasses

import numpy as np
import pytest

from driver.qp import one_solution
from driver.contact.states import STICK
from driver.qp.complementarity import newton
from driver.qp.coulomb import CoulombProblem
from driver.qp.dependent_rows import by_yielding
from driver.qp.one_solution import only_solution

PLACES = 12
# rows of one place by the displacements of two blocks abreast on a floor: normal ones of either
# with the floor and between them, then the tangential ones, as contact/junctions.py has them
ROWS = np.array([[0, -1, 0, 0], [0, 0, 0, -1], [1, 0, -1, 0],
                 [1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, -1]], float)


def abreast(seed: int) -> CoulombProblem:
    """Many such places of elastic blocks, pressed down and together by random loads."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((4 * PLACES, 6 * PLACES))
    flexible = root @ root.T / (6 * PLACES) + np.eye(4 * PLACES)
    rows = np.zeros((6 * PLACES, 4 * PLACES))
    for k in range(PLACES):
        normal, tangential = 3 * k + np.arange(3), 3 * (PLACES + k) + np.arange(3)
        rows[np.append(normal, tangential), 4 * k : 4 * k + 4] = ROWS
    force = rng.uniform(-1, 1, 4 * PLACES) - np.tile([-0.5, 2.0, 0.5, 2.0], PLACES)
    return CoulombProblem(rows @ flexible @ rows.T, rows @ flexible @ force,
                          np.full(3 * PLACES, 0.3), np.arange(3 * PLACES), depends=True)


@pytest.mark.parametrize("seed", range(5))
def test_solutions_obey_the_law_of_rows_that_do_not_yield(seed):
    """To rounding; without friction bounds of their own, too, as approximations have them."""
    problem = abreast(seed)
    start = np.zeros(problem.rows)
    solution = only_solution(problem, start)
    assert problem.solves(solution)
    given = problem.under(problem.load, np.zeros(problem.m), offset=problem.bounds(solution))
    assert given.solves(only_solution(given, start))


@pytest.mark.parametrize("softer", [1e3, 1e6, 1e9])
def test_a_soft_and_a_stiff_block_leave_forces_open(softer):
    """The pivot of the stiff one's row is the rounding of the soft one's, which is large beside it.

    Rows are u, u - v and v with displacements u of a soft and v of a stiff block. Of the forces
    that go around none is left.
    """
    stiff = 1 / softer
    exact = np.array([[1.0, 1.0, 0.0], [1.0, 1.0 + stiff, -stiff], [0.0, -stiff, stiff]])
    rounding = np.diag([np.finfo(float).eps, 0.0, 0.0])
    force = np.array([1.0, 2.0, -0.5])
    problem = CoulombProblem(exact + rounding, exact @ force, np.zeros(0), np.zeros(0, int))
    system = problem.system(np.full(3, STICK), np.ones(3))
    assert system.dependent
    z = system.solve(problem.load, problem.balance)
    own = np.sqrt(np.diag(exact) * np.diag(exact).max())  # movements of stiff rows are small ones
    np.testing.assert_allclose(exact @ z / own, problem.load / own, rtol=0, atol=1e-9)
    assert np.linalg.norm(z) <= np.linalg.norm(force)


def test_what_rows_yield_is_taken_back():
    """By more than the part of 1e-9 that they yield."""
    problem = abreast(0)
    z = by_yielding(problem, np.zeros(problem.rows), only_solution)
    assert problem.violation(z) < 1e-12


def test_forces_are_the_least_within_given_bounds():
    """Those of another solution with the same movements are larger, weighed by compliance."""
    problem = abreast(1)
    problem = problem.under(problem.load, np.zeros(problem.m), offset=np.full(problem.m, 0.3))
    x = only_solution(problem, np.zeros(problem.rows))
    tried = 0
    around = np.linalg.svd(ROWS.T)[2][4:]
    own = np.diag(problem.compliance)
    for k in range(PLACES):
        here = np.append(3 * k + np.arange(3), 3 * (PLACES + k) + np.arange(3))
        for line in around:
            for part in 1e-3, -1e-3:
                other = x.copy()
                other[here] += part * line
                if problem.solves(other):
                    tried += 1
                    assert other @ (own * other) > x @ (own * x) - 1e-9
    assert tried


def test_none_where_the_method_finds_none():
    problem = abreast(0)
    assert by_yielding(problem, np.zeros(problem.rows), lambda *_: None) is None
    assert by_yielding(problem, np.zeros(problem.rows), lambda _, z: z) is None  # no solution


def test_newtons_method_alone_goes_to_and_fro():
    """In most of these: what this module is there for."""
    ends = [newton(abreast(seed), np.zeros(6 * PLACES)) for seed in range(10)]
    assert sum(end is None for end in ends) > 5


@pytest.mark.parametrize("falls, made", [(0.8, 12), (1.0, 6)])
def test_approximations_go_on_as_long_as_they_come_nearer(monkeypatch, falls, made):
    """Twelve where each violates the law by less, six where none does; then others follow."""
    problem, off = abreast(0), [1.0]
    monkeypatch.setattr(one_solution, "_nearer", lambda problem, start: start)
    monkeypatch.setattr(one_solution, "_ended", lambda *_: "found" if len(off) > 12 else None)
    monkeypatch.setattr(CoulombProblem, "violation", lambda *_: off[-1])
    monkeypatch.setattr(one_solution, "approximation", lambda problem, z, *_, **how: off.append(
        falls * off[-1]) or z)
    monkeypatch.setattr(one_solution, "approached", lambda *_: "by others")
    found = only_solution(dataclasses.replace(problem, depends=False), np.ones(problem.rows))
    assert (found, len(off) - 1) == ("found" if falls < 1 else "by others", made)
