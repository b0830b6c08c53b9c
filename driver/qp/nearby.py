"""Linear systems of states that differ from factorized ones at few nodes.

For every row i the law in given states is an equation: the row does not move, (C x)_i = d_i, or its
force is given, x_i = slope x_node + c (coulomb.py). Where states change so do the equations of some
rows D, M' = M + E_D V, and with the factors of M

    x = y - W (M'_D W)^-1 (M'_D y - r_D),        W = M^-1 E_D,      M y = r but for the rows D

(W. Hager, SIAM Review 31 (1989) 221-239). Of n unknowns that is n^2 operations for each row in
place of n^3 for new factors. The columns of W are kept: one change of states follows the other.
Digits are those of M: Newton's method takes its steps by it and ends with factors of its own.
"""

import numpy as np
from scipy.linalg import lapack

from .coulomb import FORWARD, OPEN, STICK, CoulombProblem, StateSystem

FEW = 0.25  # part of the unknowns that rows may be for updates to pay
LEAST = 1e-8  # pivot of M'_D W, of which rows without change have 1, below which factors are new


def nearly_in(problem: CoulombProblem, states: np.ndarray,
              sign: np.ndarray) -> np.ndarray | None:
    """z of the linear system of `states` (n,) with `sign`s (n,) of lambda_n; None if singular.

    To the digits of the latest factors where few rows differ and no motion is free.
    """
    _, system, kept = problem.latest.get(problem.rubs, (None, None, None))
    z = None
    if system is not None and len(system.free) and not problem.k:
        if not kept:  # not by the system itself, which would stay until cycles are looked for
            kept.append(Nearby(problem, system))
        z = kept[0].solution(problem, states, sign)
    return problem.solution_in(states, sign) if z is None else z


class Equations:
    """What the law says of every row of a `problem` without free motions in given states."""

    def __init__(self, problem: CoulombProblem, states: np.ndarray, sign: np.ndarray):
        """`states` and `sign` of lambda_n (n,)."""
        state = states[problem.pair]
        way = np.where(np.abs(state) == FORWARD, 1.0, -1.0) * (np.abs(state) > STICK)
        # rows that do not move
        self.still = np.concatenate([states > OPEN, np.abs(state) == STICK])
        self._bound = np.where(state > STICK, way * problem.coefficient, 0.0)
        self.slope = self._bound * sign[problem.pair]
        self.given = np.zeros(problem.m) if problem.offset is None else way * problem.offset

    def unlike(self, other: "Equations") -> np.ndarray:
        """The rows whose left sides differ."""
        return np.flatnonzero((self.still != other.still) | np.append(
            np.zeros(len(self.still) - len(self.slope), bool), self.slope != other.slope))

    def left(self, problem: CoulombProblem, rows: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Left sides (len(rows), ...) of `rows` at x (n + m, ...)."""
        n, still = problem.n, self.still[rows]
        result = x[rows].copy()
        result[still] = problem.compliance[rows[still]] @ x
        along = np.flatnonzero(~still & (rows >= n))
        t = rows[along] - n
        result[along] -= (self.slope[t] * x[problem.pair[t]].T).T
        return result

    def right(self, problem: CoulombProblem) -> np.ndarray:
        """Right sides (n + m,)."""
        return np.where(self.still, problem.load, np.append(np.zeros(problem.n), self.given))

    def put(self, problem: CoulombProblem, x: np.ndarray) -> None:
        """Give the forces in x (n + m,) that are given exactly, in place."""
        n = problem.n
        force = np.append(np.zeros(n), self._bound * np.abs(x[problem.pair]) + self.given)
        x[~self.still] = force[~self.still]


class Nearby:
    """Solutions by the factors of one `system` of a problem without free motions."""

    def __init__(self, problem: CoulombProblem, system: StateSystem):
        self._system = system
        self._equations = Equations(problem, system.states, system.sign)
        self._place = np.full(problem.rows, -1)  # of a row's column of W
        self._W = np.empty((problem.rows, 0))

    def solution(self, problem: CoulombProblem, states: np.ndarray,
                 sign: np.ndarray) -> np.ndarray | None:
        """x (n + m,) of `problem`, which has the compliance of the system's, in other states.

        None where too many rows differ, or the factors are no help.
        """
        own, here = Equations(problem, states, sign), self._equations
        rows = own.unlike(here)
        if len(rows) > FEW * len(self._system.free):
            return None
        right = own.right(problem)
        base = right.copy()
        base[rows] = np.where(here.still[rows], problem.load[rows], 0.0)
        x = self._solved(problem, base[:, None])[:, 0]
        if len(rows):
            W = self._columns(problem, rows)
            stiff = np.where(own.still[rows], problem.rigidity[rows], 1.0)
            small = stiff[:, None] * own.left(problem, rows, W)
            missed = stiff * (own.left(problem, rows, x) - right[rows])
            factor, pivots, failed = lapack.dgetrf(small)
            least = np.abs(factor.diagonal())
            if failed or not least.min() > LEAST * max(least.max(), 1.0):
                return None
            x -= W @ lapack.dgetrs(factor, pivots, missed)[0]
        own.put(problem, x)
        return x if np.isfinite(x).all() else None

    def _columns(self, problem: CoulombProblem, rows: np.ndarray) -> np.ndarray:
        """Those of W (n + m, len(rows)), each as if forces were right sides."""
        new = rows[self._place[rows] < 0]
        if len(new):
            unit = np.zeros((problem.rows, len(new)))
            still = self._equations.still[new]
            unit[new, np.arange(len(new))] = np.where(still, 1.0 / problem.rigidity[new], 1.0)
            self._place[new] = self._W.shape[1] + np.arange(len(new))
            self._W = np.column_stack([self._W, self._solved(problem, unit)])
        return self._W[:, self._place[rows]]

    def _solved(self, problem: CoulombProblem, right: np.ndarray) -> np.ndarray:
        """x (n + m, r) of the system's equations with `right` sides (n + m, r)."""
        still, system = self._equations.still, self._system
        x = np.where(still[:, None], 0.0, right)
        given = np.flatnonzero(x.any(axis=1))
        free = right[system.free] - problem.compliance[np.ix_(system.free, given)] @ x[given]
        unknowns, _ = lapack.dgetrs(system.factor, system.pivots, system.scale[:, None] * free)
        x[system.free] = system.scale[:, None] * unknowns
        along = np.flatnonzero(~still[problem.n :])
        x[problem.n + along] += self._equations.slope[along, None] * x[problem.pair[along]]
        return x
