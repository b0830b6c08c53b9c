"""A dense contact problem in unknowns of like size, as linear programs need it.

Stiff bodies on soft ones, or on soft springs, move far as a whole and deform by little, which sums
of both would hide, and a program's tolerance with them. So the ways that soft rows make all rows go
are unknowns of their own: with the Cholesky factorization of the compliance, the largest pivots
first (N. Higham, Accuracy and Stability of Numerical Algorithms, SIAM 2002, section 10.3),

    C = L L' + rest,   movement = d + R beta - L y - rest x,   y = L'x,

L the columns before the last place at which pivots drop from soft rows to stiff ones.
"""

import numpy as np
from scipy.sparse import csc_matrix

from .coulomb import SLIGHT, CoulombProblem

DROP = 5.0  # of pivots, from soft rows to stiff ones
ROUNDED = 1e-14  # part of the largest compliance that is rounding


class Scaled:
    """A problem whose unknowns are over their sizes: forces of like size, and motions by reach.

    Unknowns are forces (n + m,) and `k` motions and ways y. `rows` of over, slip, lambda_t -+ F
    lambda_n, equilibrium and y - L'x = 0; `given` movement (n + m,) by the load, `offset` (m,) and
    `work` (k,) in the same units. Motions are those beyond what the springs make of the load, which
    may be far more than bodies deform by. `even` are the rows times `over`, for unknowns over their
    `own` sizes: with entries of many sizes linear programs may end without an answer.
    """

    def __init__(self, problem: CoulombProblem):
        self.problem = problem
        n, m = problem.n, problem.m
        C, load = _elastic(problem)
        soft = np.diag(C).max()
        way = max(np.abs(load).max(initial=0.0),
                  soft * np.abs(problem.balance / problem.reach).max(initial=0.0)) or 1.0
        self.force, self.way = way / soft, way
        L, rest, stiff = _levels(C)
        self.unit = unit = np.sqrt(soft / stiff)  # stiff rows: large forces, small ways
        ways = unit[:, None] * np.hstack([problem.motions / problem.reach, -L / np.sqrt(soft)])
        self.k = k = ways.shape[1]
        self.cone_matrix = pick = np.zeros((m, n))
        pick[np.arange(m), problem.pair] = (problem.coefficient * unit[problem.pair] / unit[n:])
        along, nothing = np.eye(m), np.zeros((m, k))
        answers = np.diag(np.repeat([0.0, 1.0], [problem.k, L.shape[1]]))
        rows = np.vstack([np.hstack([-rest * unit[:, None] * unit / soft, ways]),
                          np.hstack([-pick, along, nothing]), np.hstack([pick, along, nothing]),
                          np.hstack([ways.T, answers])])
        self.rows, self.given = csc_matrix(rows), load * unit / way
        self.over = np.ones(len(rows))
        self.over[n + m : n + 3 * m] /= np.tile(np.maximum(pick.max(axis=1, initial=0.0), 1.0), 2)
        even = self.over[:, None] * rows
        largest = np.abs(even).max(axis=0, initial=0.0)
        self.own = 1.0 / np.where(largest > 0, largest, 1.0)
        self.even = csc_matrix(even * self.own)
        self.offset = problem.offsets / unit[n:] / self.force
        self.work = np.append(problem.balance / problem.reach / self.force, np.zeros(L.shape[1]))

    def exact(self, x: np.ndarray) -> np.ndarray:
        """z of the problem by the unknowns x."""
        problem = self.problem
        forces = x[: problem.rows] * self.unit * self.force
        moved = self.rows[: problem.rows] @ x + self.given
        away = moved * self.way / self.unit - problem.movement(problem.whole(forces))
        return np.append(forces, np.linalg.lstsq(
            problem.motions / problem.reach, away, rcond=None)[0] / problem.reach)


def _elastic(problem: CoulombProblem) -> tuple[np.ndarray, np.ndarray]:
    """Compliance (n + m, n + m) and load (n + m,) with springs like the bodies in stiffness.

    Forces in equilibrium move rows by the same but for a rigid motion: by P (d - C x_0) - P C P x
    with P = 1 - Q Q', Q an orthonormal basis of the motions R, and x_0 any forces with R'x_0 = L.
    """
    C, load = problem.compliance, problem.load
    if not problem.k:
        return C, load
    R = problem.motions / problem.reach
    Q, sizes, basis = np.linalg.svd(R, full_matrices=False)
    kept = sizes > SLIGHT * sizes[0]
    Q = Q[:, kept]
    forces = Q @ ((basis[kept] @ (problem.balance / problem.reach)) / sizes[kept])

    def bent(columns):
        return columns - Q @ (Q.T @ columns)

    own = bent(bent(C).T)
    soft = np.median(np.diag(own))
    return own + soft * Q @ Q.T, bent(load - C @ forces) + soft * forces


def _levels(C: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """L (n, q) and the rest (n, n), and what rows yield beside softer ones alone (n,)."""
    rest, stiff, columns, last = C, np.diag(C).copy(), [], np.inf
    kept, done, left = C, 0, np.ones(len(C), bool)
    least = ROUNDED * stiff.max(initial=0.0)
    while left.any():
        pivots = np.where(left, np.diag(rest), 0.0)
        row = int(pivots.argmax())
        if not pivots[row] > least:
            break
        if pivots[row] * DROP < last < np.inf:
            stiff[left], done, kept = np.maximum(pivots[left], least), len(columns), rest
        last = pivots[row]
        columns.append(rest[:, row] / np.sqrt(last))
        rest = rest - np.outer(columns[-1], columns[-1])
        left[row] = False
    return np.array(columns[:done]).reshape(done, len(C)).T, kept, stiff
