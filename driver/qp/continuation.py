"""Solutions of the dense contact problem by way of less friction.

Bodies that friction holds may be in equilibrium although neither Newton's method from what is known
nor Lemke's comes to it. With less friction there is often a solution that they find; from there the
coefficients grow to their own again, by steps that Newton's method can follow: solutions of a
piecewise linear problem move on continuously but where the path turns back (E. Allgower, K. Georg,
Numerical Continuation Methods, Springer 1990, chapter 11).
"""

import numpy as np

from . import complementarity
from .coulomb import CoulombProblem

HALVINGS = 4  # of the coefficients, for a first solution
STEPS = 100  # of their growth, at most
LARGEST, LEAST = 2.0, 1.0001  # factor by which they grow in one, between these


def with_growing_friction(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """A solution z; None where the path turns back or nothing is solved with less friction."""
    z, part = _with_less(problem, start)
    grows = LARGEST
    for _ in range(STEPS):
        if z is None or part == 1.0:
            return z
        tried = min(1.0, part * grows)
        near = complementarity.newton(_weakened(problem, tried), z)
        if near is not None:
            z, part, grows = near, tried, min(grows**1.5, LARGEST)
        elif grows < LEAST:
            return None
        else:
            grows = np.sqrt(grows)
    return None


def _with_less(problem: CoulombProblem, start: np.ndarray) -> tuple[np.ndarray | None, float]:
    """A solution with a part of the friction coefficients, and this part, the largest tried."""
    part = 1.0
    for _ in range(HALVINGS):
        part *= 0.5
        weaker = _weakened(problem, part)
        for near in (start, *complementarity.all_alike(weaker)):
            z = complementarity.newton(weaker, near)
            if z is not None:
                return z, part
        z = complementarity.lemke(weaker)
        if z is not None:
            return z, part
    return None, part


def _weakened(problem: CoulombProblem, part: float) -> CoulombProblem:
    """The problem with a part of its friction coefficients."""
    return problem.under(problem.load, part * problem.coefficient, problem.balance,
                         problem.offset)
