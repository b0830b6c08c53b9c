"""Displacements of the dual rows to all the digits that stiffness and forces determine.

Solutions of K u = f by factors are off by what factors round off, relative to the largest u: where
stiff parts hang on soft ones, or keep their volume, that may be more than they deform by. Iterative
refinement with residuals in extended precision (N. Higham, Accuracy and Stability of Numerical
Algorithms, SIAM 2002, chapter 12) takes it away,

    r = f - K u,   K d = r by the same factors,   u <- u + d,

u and r in extended precision. The rounding of K's own entries stays: a change of a soft spring that
all forces see alike.
"""

import numpy as np
from mpi4py import MPI

LONG = np.longdouble  # 64 bits of mantissa on x86, no less than 53 anywhere
DIGITS = 44  # binary ones of a whole number, so that hundreds of them have a sum of no more than 53
HALF = (np.finfo(LONG).nmant - 9) // 2  # digits of factors, a thousand of whose products add up
PASSES = 3  # corrections; each leaves of the error what a factor rounds off of its solution


class Refinement:
    """Refined displacements of one torn body; collective."""

    def __init__(self, structure, classes, coarse, recovery):
        """`classes`, `coarse` and `recovery` of the operator, see operator.py."""
        self.structure, self.classes = structure, classes
        self.coarse, self.recovery = coarse, recovery
        self._stiffness = [_split(c.K.astype(LONG)) for c in classes]

    def fields(self, rows: np.ndarray, weights: np.ndarray) -> list[np.ndarray]:
        """Displacements u (dofs,) of the subdomains under sum_k weights_k f_k - B' lambda.

        `rows` are stacked, signed local multipliers, `weights` (patterns,). Springs of bodies
        without support do not move: far under each force, they would by the last digits of all.
        """
        springs, self.coarse.rho = self.coarse.rho, np.zeros(len(self.coarse.rho))
        whole = np.append(weights, np.zeros(len(springs)))
        try:
            fields = self.recovery.displacements(rows, whole, None)
            fields = [u.astype(LONG) for u in fields]
            for _ in range(PASSES):
                parts = self._changes(self._residual(rows, weights, fields), len(rows))
                fields = [sum(of_field) for of_field in zip(fields, *parts)]
        finally:
            self.coarse.rho = springs
        return fields

    def _residual(self, rows: np.ndarray, weights: np.ndarray, fields: list) -> list[np.ndarray]:
        """f - K u (dofs,) of every subdomain, zero where displacements are prescribed."""
        left = [np.empty(0)] * len(fields)
        for c, K in zip(self.classes, self._stiffness):
            inner = _product(K, np.column_stack([fields[s] for s in c.members]))
            multipliers = rows[c.rows].reshape(len(c.members), -1).T.astype(LONG)
            force = np.zeros_like(inner)
            force[c.torn] = -(c.B_r.T.astype(LONG) @ multipliers)
            force[c.corner] = -(c.B_c.T.astype(LONG) @ multipliers)
            for k, s in enumerate(c.members):
                force[:, k] += weights.astype(LONG) @ self.structure.subdomains[s].loads
                force[self.structure.fixed[s], k] = inner[self.structure.fixed[s], k]
                left[s] = force[:, k] - inner[:, k]
        return left

    def _changes(self, left: list[np.ndarray], count: int) -> tuple[list, list]:
        """Displacements (dofs,) of the subdomains by the residuals `left`, in two parts.

        At corners subdomains bear one another by forces far beyond what is left of their sum. So
        they go in whole numbers of a unit, whose sum has no rounding, and the rest. `count` is the
        number of stacked local rows.
        """
        nothing = np.zeros(count), np.zeros(self.structure.patterns + len(self.coarse.rho))
        corner = np.zeros(len(self.coarse.numbers), LONG)
        for c in self.classes:
            corner[c.corners] = np.concatenate([left[s][c.corner] for s in c.members])
        largest = float(np.abs(corner).max(initial=0.0))
        largest = self.coarse.comm.allreduce(largest, op=MPI.MAX)
        unit = LONG(2.0) ** (np.frexp(largest)[1] - DIGITS)
        whole = (np.rint(corner / unit) * unit).astype(float)
        for c in self.classes:
            for s, of_corner in zip(c.members, whole[c.corners].reshape(len(c.members), -1)):
                left[s][c.corner] -= of_corner
        rest = [of.astype(float) for of in left]
        return (self.recovery.displacements(*nothing, rest),
                self.recovery.between_corners(*nothing, self.coarse.solve(whole)))

    def moved(self, rows: np.ndarray, fields: list[np.ndarray]) -> np.ndarray:
        """Local B u of `fields`, stacked and unsigned as `rows` are, less what rows that yield give
        way by.
        """
        moved = np.zeros(len(rows))
        for c in self.classes:
            of_members = moved[c.rows].reshape(len(c.members), -1)
            multipliers = rows[c.rows].reshape(len(c.members), -1)
            for k, s in enumerate(c.members):
                local = self.structure.rows[s]
                terms = (local.coefficient + local.fixed_part) * fields[s][local.dof]
                of_members[k] = terms.sum(axis=1)
                if self.structure.yields:
                    of_members[k] -= self.structure.own_compliance(s) * multipliers[k]
        return moved


def _split(K) -> tuple:
    """K as its leading `HALF` digits, beside its largest entry, and the rest; scipy CSR both."""
    leading, rest = K.copy(), K.copy()
    leading.data = _rounded(K.data[:, None])[:, 0]
    rest.data = K.data - leading.data
    return leading, rest


def _rounded(values: np.ndarray) -> np.ndarray:
    """`values` (n, k) to `HALF` digits beside the largest of their column."""
    unit = LONG(2.0) ** (np.frexp(np.abs(values).max(axis=0, initial=0))[1] - HALF)
    return np.rint(values / unit) * unit


def _product(K: tuple, u: np.ndarray) -> np.ndarray:
    """K u of a matrix in two parts and u (dofs, k), in `HALF` digits more than LONG has.

    What motions without stress leave of large terms has no rounding: products of leading digits add
    up exactly (K. Ozaki, T. Ogita, S. Oishi, S. Rump, Numer. Algor. 59 (2012) 95-118).
    """
    leading, rest = K
    large = _rounded(u)
    return leading @ large + (leading @ (u - large) + rest @ u)
