"""Stage 4, condensed: the dual problem on the contact rows alone, for studies that solve it many times.

Gluing multipliers have no bounds. Minimising over them leaves, on the contact rows c with the gluing rows g,

    C = F_cc - F_cg F_gg^-1 F_gc,      d_C = d_c - F_cg F_gg^-1 d_g,

the compliance of the glued body at its contact nodes. F = F_i + A S_cc^-1 A' with the block diagonal F_i is full, but with
the corner displacements as further unknowns it comes from a sparse matrix of the local ones alone (`fetidp`),

    [ F_i   -A   ] [ lambda ]   [ d_i - B u ]
    [ -A'  -S_cc ] [  u_c   ] = [   -f_c    ],

so that C is left on the contact rows when gluing rows and corners are eliminated by one sparse factorization. After that
a time step costs a few products with a small dense matrix.
"""

import copy
import dataclasses

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import bmat, coo_matrix, csc_matrix, diags, hstack, vstack

from .contactboundary import ContactBoundary
from .errors import NotConverged, agree
from .fetidp import DualOperator
from .reduction import petsc_matrix
WIDTH = 64  # columns solved at a time
ROUNDING = 1e-9  # residual of the elimination, relative to its terms: far below the tolerances of a QP


class ContactCompliance:
    """C and d_C with the interface of DualOperator, whole on every rank: each solves by itself.

    Vectors have one entry per contact row, as `contact_row_numbers` has them. Takes no products with F. Collective over the
    operator's communicator. Raises NotConverged if the elimination fails.
    """

    def __init__(self, operator: DualOperator):
        self.comm, self.products, self.modes = MPI.COMM_SELF, 0, 0  # bodies that supports hold
        structure = operator.structure
        rows = contact_row_numbers(structure.contact)
        self.owned, self.structure = len(rows), _on_contact_rows(structure, rows)
        patterns = np.eye(structure.patterns)
        loads = np.column_stack([np.empty((structure.dual_dofs, 0)), *(
            np.concatenate(operator.comm.allgather(operator.load_response(weights))) for weights in patterns)])
        self.C, self.d, self._moved, self._loaded = _eliminated(operator, rows, loads)
        nothing = np.zeros(operator.owned)
        for k, weights in enumerate(patterns):
            self._loaded[k] += operator.coarse_displacements(nothing, weights)

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

    @staticmethod
    def minimum(value: float) -> float:
        """The smallest of the ranks' numbers: there is one rank."""
        return value

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
            self.face = f
            self.factor = cho_factor(self.C.compress(free, 0).compress(free, 1), lower=True, check_finite=False)
        result[f] = cho_solve(self.factor, residual[f], check_finite=False)
        return result


def contact_row_numbers(contact: ContactBoundary) -> np.ndarray:
    """(n + m,) dual rows of contact: the normal ones, then the tangential ones, both in the order of the contact nodes."""
    numbers = np.concatenate([contact.normal_row, contact.tangential_row])
    return numbers[numbers >= 0]


def _on_contact_rows(structure, rows: np.ndarray):
    """The skeleton as a solver on `rows` alone, in their order, sees it."""
    contact, place = structure.contact, np.full(structure.dual_dofs + 1, -1)  # that of no row, -1, is the last
    place[rows] = np.arange(len(rows))
    contact = dataclasses.replace(contact, normal_row=place[contact.normal_row],
                                  tangential_row=place[contact.tangential_row])
    return dataclasses.replace(structure, contact=contact, dual_dofs=len(rows), row_range=(0, len(rows)),
                               row_kind=structure.row_kind[rows], row_scale=structure.row_scale[rows])


def _eliminated(operator: DualOperator, rows: np.ndarray, loads: np.ndarray):
    """C (c, c) on the contact rows, d_C (patterns, c), and the corner displacements that come with unit contact forces
    (coarse dofs, c) and with the gluing forces under loads (patterns, coarse dofs).

    `loads` (dual rows, patterns) are the d of the load patterns. Every rank factorizes; the columns are shared out in
    blocks of fixed size, so that the result does not depend on the number of ranks.
    """
    n, corners, comm = operator.structure.dual_dofs, operator.structure.coarse_dofs, operator.comm
    matrix = _saddle_matrix(operator)
    left = np.setdiff1d(np.arange(matrix.shape[0]), rows)
    gluing = left[left < n]
    below = csc_matrix((len(left) - len(gluing), loads.shape[1]))
    coupling = matrix[left][:, rows].tocsc()
    right = hstack([coupling, vstack([csc_matrix(loads[gluing]), below])]).tocsc()
    factor, found, error = _Factor(matrix[left][:, left]), {}, None
    for first in range(WIDTH * comm.rank, right.shape[1], WIDTH * comm.size):
        try:
            solved = factor.solve(right[:, first : first + WIDTH].toarray())
            found[first] = coupling.T @ solved, solved[len(gluing) : len(gluing) + corners]
        except NotConverged as problem:
            error = problem
    agree(comm, error)
    found = {first: parts for rank in comm.allgather(found) for first, parts in rank.items()}
    onto, moved = (np.hstack(parts) for parts in zip(*(found[first] for first in sorted(found))))
    k = len(rows)
    C, d = matrix[rows][:, rows].toarray() - onto[:, :k], loads[rows] - onto[:, k:]
    return (C + C.T) / 2, d.T, -moved[:, :k], moved[:, k:].T.copy()


def _saddle_matrix(operator: DualOperator):
    """Sparse symmetric matrix of dual rows, coarse dofs and motions of bodies without support, the same on every rank.

    With the motions Q of bodies on springs S_rho = S_cc + Q rho^-1 Q', which a border keeps sparse.
    """
    structure, comm = operator.structure, operator.comm
    n, corners = structure.dual_dofs, structure.coarse_dofs
    local = [None] * len(structure.subdomains)
    for c in operator.classes:
        matrix = np.block([[c.F, -c.A], [-c.A.T, -c.S]])
        for s in c.members:
            sign = np.append(structure.rows[s].sign, np.ones(len(c.corner)))
            local[s] = np.append(structure.rows[s].row, n + structure.corner_global[s]), sign, matrix
    parts = [part for rank in comm.allgather(local) for part in rank]
    i = np.concatenate([np.repeat(number, len(number)) for number, _, _ in parts])
    j = np.concatenate([np.tile(number, len(number)) for number, _, _ in parts])
    values = np.concatenate([(matrix * np.outer(sign, sign)).ravel() for _, sign, matrix in parts])
    whole = coo_matrix((values, (i, j)), shape=(n + corners,) * 2).tocsr()
    if operator.modes:
        border = np.vstack([np.zeros((n, operator.modes)), structure.rigid_corners])
        whole = bmat([[whole, border], [border.T, diags(operator.rho)]]).tocsr()
    return whole


class _Factor:
    """Factorization of a sparse symmetric indefinite matrix (CSR) by MUMPS; rows that depend on others are left out."""

    def __init__(self, matrix):
        self.matrix = matrix
        if not matrix.shape[0]:
            return
        pc = PETSc.PC().create(PETSc.COMM_SELF)
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setOperators(petsc_matrix(matrix))
        pc.setFactorSetUpSolverType()
        self.factor, self._keep = pc.getFactorMatrix(), pc
        self.factor.setMumpsIcntl(24, 1)
        pc.setUp()
        self._random = np.random.default_rng(1)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution for the columns of `right` (n, k). Raises NotConverged if a combination of them leaves a residual."""
        if not right.size:
            return np.zeros_like(right)
        b = PETSc.Mat().createDense(right.shape, array=np.asfortranarray(right), comm=PETSc.COMM_SELF)
        x = PETSc.Mat().createDense(right.shape, comm=PETSc.COMM_SELF)
        x.setUp()
        self.factor.matSolve(b, x)
        found = x.getDenseArray().copy()
        b.destroy(), x.destroy()
        v = self._random.standard_normal(right.shape[1])
        solution, wanted = found @ v, right @ v
        left = np.abs(self.matrix @ solution - wanted)
        if not np.all(left <= ROUNDING * (abs(self.matrix) @ np.abs(solution) + np.abs(wanted))):
            raise NotConverged("the contact compliance: the gluing conditions could not be eliminated")
        return found
