"""Displacements of the dual rows to all the digits that stiffness and forces determine.

Solutions of K u = f by factors are off by what factors round off, relative to the largest u: where
stiff parts hang on soft ones, or keep their volume, that may be more than they deform by. Iterative
refinement with residuals in extended precision (N. Higham, Accuracy and Stability of Numerical
Algorithms, SIAM 2002, chapter 12) takes it away,

    r = f - K u,   K d = r by the same factors,   u <- u + d,

u and r in extended precision, as long as corrections get smaller. Stiff parts push soft springs by
what the last bits of u, or of a force beside a larger one, are worth times their stiffness, so
neither are rounded into a sum. The rounding of K's own entries stays: a change of a soft spring
that all forces see alike.
"""

import numpy as np
from mpi4py import MPI

from ..scene.symmetric import Symmetric
from .gathering import gather

LONG = np.longdouble  # 64 bits of mantissa on x86, no less than 53 anywhere
DIGITS = 44  # binary ones of a whole number, so that hundreds of them have a sum of no more than 53
HALF = (np.finfo(LONG).nmant - 9) // 2  # digits of factors, a thousand of whose products add up
PASSES = 10  # corrections at most; each leaves of the error what factors round off of a solution
HEADWAY = 0.5  # part of the last correction above which the next one is rounding itself


class Refinement:
    """Refined displacements of one torn body; collective."""

    def __init__(self, structure, classes, coarse, recovery):
        """`classes`, `coarse` and `recovery` of the operator, see operator.py."""
        self.structure, self.classes = structure, classes
        self.coarse, self.recovery = coarse, recovery
        self.passes = 0  # corrections of the latest fields
        self._reactions = _Reactions(structure, coarse) if structure.rigid_modes else None

    def fields(self, rows: np.ndarray, weights: np.ndarray) -> list[np.ndarray]:
        """Displacements u (dofs,) of the subdomains under sum_k weights_k f_k - B' lambda.

        `rows` are stacked, signed local multipliers, `weights` (patterns,). Springs of bodies
        without support do not move: far under each force, they would by the last digits of all.
        """
        springs, self.coarse.rho = self.coarse.rho, np.zeros(len(self.coarse.rho))
        whole = np.append(weights, np.zeros(len(springs)))
        (loads, pushed), self.passes = self._forces(rows, weights), 0
        try:
            fields = [u.astype(LONG) for u in self.recovery.displacements(rows, whole, None)]
            rest = [np.zeros_like(u) for u in fields]  # of later passes: the sum has fewer digits
            left, last, now = self._less(loads, pushed, fields), np.inf, self._largest(fields)
            while self.passes < PASSES and now <= HEADWAY * last:
                change = self._changes(left, len(rows))
                last, now = now, self._largest(change)
                if not self.passes:
                    fields = list(map(sum, zip(fields, change)))
                    missing = self._less(loads, pushed, fields)
                    left, small = [f.copy() for f in missing], [np.zeros_like(f) for f in missing]
                else:
                    rest = list(map(sum, zip(rest, change)))
                    left = self._less(missing, small, rest)
                self.passes += 1
        finally:
            self.coarse.rho = springs
        return list(map(sum, zip(fields, rest)))

    def _largest(self, fields) -> float:
        """Largest displacement in `fields` (dofs,) of all ranks."""
        largest = max((float(np.abs(u).max(initial=0.0)) for u in fields), default=0.0)
        return self.coarse.comm.allreduce(largest, op=MPI.MAX)

    def _forces(self, rows: np.ndarray, weights: np.ndarray) -> tuple[list, list]:
        """sum_k weights_k f_k and -B' lambda (dofs,) on every subdomain.

        Not their sum: beside loads of heat, which stress stiff parts, lambda would lose digits.
        """
        loads = [weights.astype(LONG) @ sub.loads for sub in self.structure.subdomains]
        pushed = [np.zeros(len(load), LONG) for load in loads]
        for c in self.classes:
            multipliers = rows[c.rows].reshape(len(c.members), -1).T.astype(LONG)
            torn, corner = c.B_r.T.astype(LONG) @ multipliers, c.B_c.T.astype(LONG) @ multipliers
            for k, s in enumerate(c.members):
                pushed[s][c.torn], pushed[s][c.corner] = -torn[:, k], -corner[:, k]
        return loads, pushed

    def _less(self, forces: list[np.ndarray], small: list[np.ndarray],
              fields: list[np.ndarray]) -> list[np.ndarray]:
        """`forces` + `small` - K u (dofs,) of every subdomain, zero where u is prescribed."""
        left = [np.empty(0)] * len(fields)
        for c in self.classes:
            inner, rest = _product(c.K, np.column_stack([fields[s] for s in c.members]))
            for k, s in enumerate(c.members):
                left[s] = (forces[s] - inner[:, k]) + (small[s] - rest[:, k])
                left[s][self.structure.fixed[s]] = 0.0
        return left

    def _changes(self, left: list[np.ndarray], count: int) -> list[np.ndarray]:
        """Displacements (dofs,) of the subdomains by the residuals `left`.

        At corners subdomains bear one another by forces far beyond what is left of their sum. So
        they go in whole numbers of a unit, whose sum has no rounding, and the rest. `count` is the
        number of stacked local rows.
        """
        if self._reactions is not None:
            self._reactions.take_from(left, self.classes)
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
        far = self.recovery.between_corners(*nothing, self.coarse.solve(whole))
        return [a.astype(LONG) + b
                for a, b in zip(self.recovery.displacements(*nothing, rest), far)]

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


class _Reactions:
    """Forces at corners that keep bodies without support where they are, see coarse.py.

    Else what forces leave unbalanced would be residual in every pass, and its rounding move nodes.
    """

    def __init__(self, structure, coarse):
        self.comm, self._corners = coarse.comm, structure.rigid_corners[coarse.numbers]
        shared = np.bincount(gather(coarse.comm, coarse.numbers), minlength=coarse.dofs)
        self._corners = self._corners.astype(LONG) / shared[coarse.numbers][:, None]
        motions = [mode.fields(structure) for mode in structure.rigid_modes]
        self._motions = [np.array(of, LONG) for of in zip(*motions)]

    def take_from(self, left: list[np.ndarray], classes) -> None:
        """Take the reactions to the forces `left` (dofs,) on the subdomains from them; collective.
        """
        work = [R @ force for R, force in zip(self._motions, left)]
        work = np.array(work, LONG).reshape(len(left), self._corners.shape[1])
        work = gather(self.comm, work).sum(axis=0)
        reaction = self._corners @ work
        for c in classes:
            for s, of_corner in zip(c.members, reaction[c.corners].reshape(len(c.members), -1)):
                left[s][c.corner] -= of_corner


def _rounded(values: np.ndarray) -> np.ndarray:
    """`values` (n, k) to `HALF` digits beside the largest of their column, of the same type."""
    unit = 2.0 ** (np.frexp(np.abs(values).max(axis=0, initial=0))[1] - HALF).astype(values.dtype)
    return np.rint(values / unit) * unit


def _product(K: Symmetric, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """K u for u (dofs, k), as a sum: `HALF` digits more than LONG has.

    What motions without stress leave of large terms has no rounding: products of leading digits add
    up exactly (K. Ozaki, T. Ogita, S. Oishi, S. Rump, Numer. Algor. 59 (2012) 95-118). K is split
    anew each time: kept in extended precision it would be as much again as factors are.
    """
    leading = K.replaced(_rounded(K.values[:, None])[:, 0])
    rest = K.replaced(K.values - leading.values)
    large = _rounded(u)
    return leading @ large, leading @ (u - large) + rest @ u
