"""Linear systems of states that differ from factorized ones at few nodes.

In given states the law is an equation for every row (equations.py). Where states change so do those
of some rows D, M' = M + E_D V, and with the factors of M

    x = y - W (M'_D W)^-1 (M'_D y - r_D),        W = M^-1 E_D,      M y = r but for the rows D

(W. Hager, SIAM Review 31 (1989) 221-239). Of n unknowns that is n^2 operations for each row in
place of n^3 for new factors. The columns of W are kept: one change of states follows the other.
Digits are those of M: Newton's method takes its steps by it and ends with factors of its own.
"""

import numpy as np
from scipy.linalg import lapack

from .coulomb import CoulombProblem
from .equations import Equations
from .state_system import StateSystem

FEW = 0.25  # part of the unknowns that rows may be for updates to pay
ROOM = 16  # columns of W that there is room for at first
LEAST = 1e-8  # pivot of M'_D W, of which rows without change have 1, below which factors are new


def nearly_in(problem: CoulombProblem, states: np.ndarray,
              sign: np.ndarray) -> np.ndarray | None:
    """z of the linear system of `states` (n,) with `sign`s (n,) of lambda_n; None if singular.

    To the digits of the latest factors where few rows differ and all bodies are held.
    """
    z = _by_latest(problem, states, sign)
    return problem.solution_in(states, sign) if z is None else z


def _by_latest(problem: CoulombProblem, states: np.ndarray, sign: np.ndarray) -> np.ndarray | None:
    """As `nearly_in` by the latest factors; None where they are no help."""
    _, system, kept = problem.latest.get(problem.rubs, (None, None, None))
    if system is None or not len(system.free) or not _holds(problem, system, states):
        return None
    if not kept:  # not by the system itself, which would stay until cycles are looked for
        kept.append(Nearby(system, problem.rows))
    return kept[0].solution(problem, states, sign)


def _holds(problem: CoulombProblem, system: StateSystem, states: np.ndarray) -> bool:
    """Whether those of the `system` and `states` leave no body a motion of its own."""
    return not problem.k or (system.turn.shape[1] == problem.k
                             and problem.held(states).shape[1] == problem.k)


class Nearby:
    """Solutions by the factors of one `system`, whose states hold all bodies."""

    def __init__(self, system: StateSystem, rows: int):
        """`rows`: n + m of the problem."""
        self._system, self._equations = system, system.equations
        self._place = np.full(rows, -1)  # of a row its column of W
        # those columns, as rows, and room for as many again; how many there are
        self._W, self._count = np.empty((ROOM, rows + system.motions.shape[1])), 0

    def solution(self, problem: CoulombProblem, states: np.ndarray,
                 sign: np.ndarray) -> np.ndarray | None:
        """z (n + m + k,) of `problem`, which has the compliance of the system's, in other states.

        None where too many rows differ, or the factors are no help.
        """
        own, here = Equations(problem, states, sign), self._equations
        rows = own.unlike(here)
        if len(rows) > FEW * len(self._system.free):
            return None
        right = np.append(own.right(problem), problem.balance)
        base = right.copy()
        base[rows] = np.where(here.still[rows], problem.load[rows], 0.0)
        x = self._solved(problem, base[:, None])[:, 0]
        if len(rows):
            W = self._columns(problem, rows)
            stiff = np.where(own.still[rows], problem.rigidity[rows], 1.0)
            small = stiff[:, None] * own.left(problem, rows, W.T)
            missed = stiff * (own.left(problem, rows, x) - right[rows])
            factor, pivots, failed = lapack.dgetrf(small)
            least = np.abs(factor.diagonal())
            if failed or not least.min() > LEAST * max(least.max(), 1.0):
                return None
            x -= lapack.dgetrs(factor, pivots, missed)[0] @ W
        own.put(problem, x[: problem.rows])
        return x if np.isfinite(x).all() else None

    def _columns(self, problem: CoulombProblem, rows: np.ndarray) -> np.ndarray:
        """Those of W, as rows (len(rows), n + m + k), each as if forces were right sides."""
        new = rows[self._place[rows] < 0]
        if len(new):
            unit = np.zeros((self._W.shape[1], len(new)))
            still = self._equations.still[new]
            unit[new, np.arange(len(new))] = np.where(still, 1.0 / problem.rigidity[new], 1.0)
            first, self._count = self._count, self._count + len(new)
            self._place[new] = np.arange(first, self._count)
            if self._count > len(self._W):
                self._W = np.concatenate([self._W[:first], np.empty((self._count, len(unit)))])
            self._W[first : self._count] = self._solved(problem, unit).T
        return self._W[self._place[rows]]

    def _solved(self, problem: CoulombProblem, right: np.ndarray) -> np.ndarray:
        """x (n + m + k, r) of the system's equations with `right` sides (n + m + k, r).

        Those of the motions are the work that they balance.
        """
        rows, still, system = problem.rows, self._equations.still, self._system
        x = np.zeros_like(right)
        x[:rows] = np.where(still[:, None], 0.0, right[:rows])
        given = np.flatnonzero(x.any(axis=1))
        free = right[system.free] - problem.compliance[np.ix_(system.free, given)] @ x[given]
        if problem.k:
            work = right[rows:] - problem.motions[given].T @ x[given]
            free = np.concatenate([free, system.turn.T @ work])
        unknowns, _ = lapack.dgetrs(system.factor, system.pivots, system.scale[:, None] * free)
        unknowns *= system.scale[:, None]
        x[system.free] = unknowns[: len(system.free)]
        x[rows:] = system.turn @ unknowns[len(system.free) :]
        along = np.flatnonzero(~still[problem.n :])
        x[problem.n + along] += self._equations.slope[along, None] * x[problem.pair[along]]
        return x
