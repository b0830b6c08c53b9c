"""Rows whose movements depend on one another, as where three bodies meet in one place.

Forces that go around among them move nothing, so that none or many obey the states of a moment, and
Newton's method goes to and fro between states that differ by such forces alone. Where rows yield a
little they are told apart; under given friction bounds they are the least of those in bounds, by
compliance, in the limit (A. Tikhonov, V. Arsenin, Solutions of Ill-Posed Problems, Wiley 1977).
"""

import numpy as np

from .coulomb import CoulombProblem

OWN = 1e-9  # of their compliance: what rows yield more; less has too few digits beside rounding


def yielding(problem: CoulombProblem) -> CoulombProblem:
    """The same problem, in which every row yields by OWN of its compliance more."""
    if yielding not in problem.latest:
        own = np.diag(OWN * np.diag(problem.compliance))
        problem.latest[yielding] = CoulombProblem(
            problem.compliance + own, problem.load, problem.coefficient, problem.pair,
            problem.bilateral, problem.motions)
    return problem.latest[yielding].under(problem.load, problem.coefficient, problem.balance,
                                          problem.offsets)


def by_yielding(problem: CoulombProblem, start: np.ndarray, method) -> np.ndarray | None:
    """A solution by `method` (problem, z) from `start` z, where rows yield a little; None if none.

    What they yield is taken back: about the forces of before, in the states that these ended in (a
    step of the proximal point method), they yield by what rounding leaves.
    """
    regular = yielding(problem)
    z = method(regular, start)
    if z is None:
        return None
    given = OWN * np.diag(problem.compliance) * z[: problem.rows]
    again = regular.under(problem.load + given, problem.coefficient)
    exact = again.solution_in(regular.states(z), regular.signs(z))
    return next((end for end in (exact, z) if problem.solves(end)), None)
