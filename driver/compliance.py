"""Stage 4, condensed: the dual problem on the contact rows alone, for studies that solve it many times.

Gluing multipliers have no bounds. Minimising over them leaves, on the contact rows c with the gluing rows g,

    C = F_cc - F_cg F_gg^-1 F_gc,      d_C = d_c - F_cg F_gg^-1 d_g.

C is the compliance of the assembled body at its contact nodes. Every column costs one solution with F_gg, whose
condition number the Dirichlet preconditioner makes small and independent of the number of subdomains; after
that a time step costs a few products with a small dense matrix.
"""

import copy
import dataclasses

import numpy as np
from mpi4py import MPI
from scipy.linalg import cho_factor, cho_solve

from .contactboundary import ContactBoundary
from .errors import NotConverged
from .fetidp import DualOperator
from .substructuring import GLUING

WIDTH = 32  # columns solved at a time
GLUING_RTOL = 1e-10  # residual of F_gg per column, relative to its right-hand side: far below the tolerances of a QP
MAX_ITERATIONS = 200  # Dirichlet-preconditioned F_gg has a condition number of about 5


class ContactCompliance:
    """C and d_C with the interface of DualOperator, whole on every rank: each solves by itself.

    Vectors have one entry per contact row, in the order of the dual rows. `condensation_products` counts the
    products with F that it took, a block of k columns as k. Collective over the operator's communicator.
    Raises NotConverged if the gluing problem cannot be solved.
    """

    def __init__(self, operator: DualOperator):
        self.comm, self.products, self.modes = MPI.COMM_SELF, 0, 0  # bodies that supports hold
        before, structure = operator.products, operator.structure
        kind = structure.row_kind[slice(*structure.row_range)]
        self._operator, self._gluing = operator, (kind == GLUING)[:, None]
        self._preconditioner = operator.preconditioner()
        rows = np.flatnonzero(structure.row_kind != GLUING)
        self.owned = len(rows)
        self.structure = _on_contact_rows(structure, rows)
        mine = np.searchsorted(rows, structure.row_range[0] + np.flatnonzero(kind != GLUING))
        weights = np.eye(structure.patterns)
        C, moved = self._columns(len(rows), mine, kind != GLUING)
        d, loaded = self._responses(weights, kind != GLUING)
        self.C = 0.5 * (C + C.T)  # symmetric but for the tolerance of the gluing
        self.d, self._moved, self._loaded = d, moved, loaded
        self.condensation_products = operator.products - before

    def _columns(self, count: int, mine: np.ndarray, on_contact: np.ndarray):
        """C and the corner displacements of its unit forces, (rows, rows) and (corner dofs, rows)."""
        C, moved = np.empty((count, count)), []
        for first in range(0, count, WIDTH):
            unit = np.zeros((len(on_contact), min(WIDTH, count - first)))
            here = (mine >= first) & (mine < first + unit.shape[1])
            unit[np.flatnonzero(on_contact)[here], mine[here] - first] = 1.0
            unit -= self._glue(self._operator.apply_columns(unit))
            C[:, first : first + unit.shape[1]] = self._everywhere(self._operator.apply_columns(unit)[on_contact])
            moved += [self._corners(column, np.zeros(self.structure.patterns)) for column in unit.T]
        return C, np.array(moved).reshape(count, -1).T

    def _responses(self, weights: np.ndarray, on_contact: np.ndarray):
        """d_C (patterns, rows) and corner displacements (patterns, corner dofs) of every load pattern alone."""
        d, loaded = np.empty((len(weights), self.owned)), []
        for k, weight in enumerate(weights):
            response = self._operator.load_response(weight)
            glued = self._glue(response[:, None])
            left = response[:, None] - self._operator.apply_columns(glued)
            d[k] = self._everywhere(left[on_contact])[:, 0]
            loaded.append(self._corners(glued[:, 0], weight))
        return d, np.array(loaded).reshape(len(weights), -1)

    def _glue(self, right: np.ndarray) -> np.ndarray:
        """F_gg^-1 of the gluing rows of `right` (owned, k), zero on the others: preconditioned CG, column by column."""
        op, gluing = self._operator, self._gluing
        r = np.where(gluing, right, 0.0)
        x, p, old = np.zeros_like(r), np.zeros_like(r), np.ones(r.shape[1])
        target = GLUING_RTOL**2 * op.dots(r, r)
        for _ in range(MAX_ITERATIONS):
            open_ = op.dots(r, r) > target
            if not open_.any():
                return x
            z = self._preconditioner.columns(r, gluing)
            new = op.dots(r, z)
            p = z + np.divide(new, old, out=np.zeros_like(new), where=open_) * p
            Fp = np.where(gluing, op.apply_columns(p), 0.0)
            step = np.divide(new, op.dots(p, Fp), out=np.zeros_like(new), where=open_)
            x, r, old = x + step * p, r - step * Fp, new
        raise NotConverged(f"the contact compliance: no solution of the gluing problem in {MAX_ITERATIONS} iterations")

    def _everywhere(self, mine: np.ndarray) -> np.ndarray:
        """Rows of all ranks, which own them in their order."""
        return np.concatenate(self._operator.comm.allgather(mine))

    def _corners(self, multipliers: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Displacements of the coarse dofs of the body, on every rank."""
        return self._operator.coarse_displacements(multipliers, weights)

    # ---- the interface of DualOperator --------------------------------------------------------
    def with_contact(self, contact: ContactBoundary) -> "ContactCompliance":
        """The same body with other gaps, friction or initial state at its contact nodes; counts its own products."""
        other = copy.copy(self)
        boundary = dataclasses.replace(contact, normal_row=self.structure.contact.normal_row,
                                       tangential_row=self.structure.contact.tangential_row)
        other.structure, other.products = dataclasses.replace(self.structure, contact=boundary), 0
        return other

    def apply(self, multipliers: np.ndarray) -> np.ndarray:
        """C times a vector of contact multipliers."""
        self.products += 1
        return self.C @ multipliers

    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Scalar product."""
        return float(a @ b)

    def load_response(self, weights: np.ndarray) -> np.ndarray:
        """d_C for the load sum_k weights_k f_k."""
        return weights @ self.d

    def corner_displacement(self, multipliers: np.ndarray, weights: np.ndarray) -> float:
        """Largest displacement of a corner."""
        return float(np.abs(weights @ self._loaded + self._moved @ multipliers).max(initial=0.0))

    def preconditioner(self) -> "FaceInverse":
        """The inverse of C on a face."""
        return FaceInverse(self.C)


class FaceInverse:
    """(C_ff)^-1 by a Cholesky factorization that is kept as long as the face f stays."""

    def __init__(self, C: np.ndarray):
        self.C, self.face, self.factor = C, None, None

    def __call__(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """C_ff^-1 residual_f on the face `free`, zero elsewhere."""
        result, f = np.zeros_like(residual), np.flatnonzero(free)
        if len(f) == 0:
            return result
        if self.face is None or not np.array_equal(f, self.face):
            self.face, self.factor = f, cho_factor(self.C[np.ix_(f, f)], lower=True, check_finite=False)
        result[f] = cho_solve(self.factor, residual[f], check_finite=False)
        return result


def _on_contact_rows(structure, rows: np.ndarray):
    """The skeleton as a solver on `rows` alone sees it."""
    contact = structure.contact
    number = lambda row: np.where(row >= 0, np.searchsorted(rows, row), -1)
    contact = dataclasses.replace(contact, normal_row=number(contact.normal_row),
                                  tangential_row=number(contact.tangential_row))
    return dataclasses.replace(structure, contact=contact, dual_dofs=len(rows), row_range=(0, len(rows)),
                               row_kind=structure.row_kind[rows])
