"""Successive approximations of friction bounds, where Newton's method alone does not settle.

Each solves the problem with the friction bounds of the one before, and is a start for Newton's
method (complementarity.py).
"""

import numpy as np

from .active_set import solution_within
from .complementarity import newton
from .coulomb import CoulombProblem
from .dependent_rows import by_yielding

APPROXIMATIONS = 8  # at most, with the start
ON_BOUND = 1 - 1e-9  # part of a friction bound from which a force is on it
LACKING = 1e-3  # violation of the law by bodies that the bounds of an approximation nearly hold
# parts of the rigidity by which movements count in Newton's method, where the one before failed
PARTS = (1.0, 0.1, 0.01)


def approached(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """A solution by Newton's method from `start` z, or from successive approximations to one.

    Where pressure and friction overtake one another Newton's method goes to and fro between the
    same states. An approximation solves the problem with the friction bounds of the one before (J.
    Haslinger, I. Hlavacek, J. Necas, Handbook of Numerical Analysis IV (1996) 313-485): one or two
    are near enough. It may go to and fro in these, too, where a whole surface turns from sliding
    one way to the other: each node is rigid, all of them together are soft, and a movement that
    counts by the rigidity of one is too much. So it counts by less then (the constant c of S.
    Hueeber, G. Stadler, B. Wohlmuth, SIAM J. Sci. Comput. 30 (2008) 572-596). None if no start
    leads to a solution.
    """
    if problem.depends:
        return by_yielding(problem, start, approached)
    if not problem.coefficient.any():
        return _within(problem, start)
    points = _Approximations(problem, start)
    solutions = (newton(problem.softer(part), z) for part in PARTS for z in points)
    return next((z for z in solutions if z is not None), None)


class _Approximations:
    """The `start` z and successive approximations from it, as far as there are any.

    They do not depend on how movements count: each is made once, when it is first asked for.
    """

    def __init__(self, problem: CoulombProblem, start: np.ndarray):
        self._problem, self._found, self._bound = problem, [start], problem.bounds(start)

    def __iter__(self):
        for k in range(APPROXIMATIONS):
            if k == len(self._found):
                self._found.append(self._next())
            if self._found[k] is None:
                return
            yield self._found[k]

    def _next(self) -> np.ndarray | None:
        z, before = self._found[-1], self._bound
        self._bound = self._problem.bounds(z)
        return approximation(self._problem, z, self._bound, before)


def approximation(problem: CoulombProblem, z: np.ndarray, bound: np.ndarray | None = None,
                  before: np.ndarray | None = None, **how) -> np.ndarray | None:
    """Solution with given friction bounds `bound` (m,), those of z, from z; Newton's method `how`.

    `before` (m,) are those that z is a solution of, if they are known. Where bounds lack a little
    of what holds bodies without support, forces nearest to that.
    """
    bound = problem.bounds(z) if bound is None else bound
    if before is not None:
        z = _sliding(problem, z, before, bound)
    given = problem.under(problem.load, np.zeros(problem.m), offset=bound)
    return _within(given, z, LACKING, **how)


def _sliding(problem: CoulombProblem, z: np.ndarray, before: np.ndarray,
             bound: np.ndarray) -> np.ndarray:
    """z whose forces at the bounds `before` (m,) are at `bound`, as they go on sliding."""
    z, along = z.copy(), z[problem.n : problem.rows]
    slides = np.abs(along) >= ON_BOUND * before
    z[problem.n : problem.rows] = np.where(slides, np.sign(along) * bound, along)
    return z


def _within(problem: CoulombProblem, start: np.ndarray, least: float = 0.0,
            **how) -> np.ndarray | None:
    """Solution under given friction bounds, by Newton's method, `how`, or a descent of the energy.

    `least` as active_set.solution_within takes it. What rounding keeps from both may be found where
    movements count by less.
    """
    solution = newton(problem, start, **how)
    if solution is None:
        solution = solution_within(problem, start, least)
    for part in PARTS[1:]:
        if solution is None:
            solution = newton(problem.softer(part), start, **how)
    return solution
