"""The dual problem on the contact rows alone, for studies that repeat it.

Gluing multipliers have no bounds. Minimising over them (rows g) leaves, on the contact rows c,

    C = F_cc - F_cg F_gg^-1 F_gc,      d_C = d_c - F_cg F_gg^-1 d_g,

the compliance of the glued body at its contact nodes. F = F_i + A S_cc^-1 A' with the block
diagonal F_i is full, but with the corner displacements as further unknowns it comes from a sparse
matrix of the local ones alone (see operator.py),

    [ F_i   -A   ] [ lambda ]   [ d_i - B u ]
    [ -A'  -S_cc ] [  u_c   ] = [   -f_c    ],

so that C is left on the contact rows when gluing rows and corners are eliminated by one sparse
factorization. After that a time step costs a few products with a small dense matrix.
"""

import dataclasses

import numpy as np
from mpi4py import MPI
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_matrix, csc_matrix, hstack, vstack

from ..errors import NotConverged, agree
from .dual_problem import DualProblem
from .factorization import factorized, petsc_upper, solve_columns
from .gathering import gather
from .operator import DualOperator
from .rows import RowKind, contact_row_numbers
from .structure import ContactTable

MUMPS_NO_MEMORY = -13  # INFOG(1)
WIDTH = 64  # columns solved at a time
ROUNDING = 1e-9  # residual of the elimination, relative to its terms; far below RTOL
REFINED = 1e-13  # the same, above which solutions are refined


def contact_compliance(problem: DualProblem) -> np.ndarray:
    """C (n + m, n + m) as `contact_row_numbers` orders it; collective. Raises NotConverged."""
    return problem.C if problem.contact_rows_only else ContactCompliance(problem).C


class ContactCompliance(DualProblem):
    """C and d_C as a dual problem on the contact rows, whole on every rank: each solves by itself.

    Vectors have one entry per contact row, as `contact_row_numbers` has them. Takes no products
    with F. It knows no rigid motions: bodies are those that supports hold. Collective over the
    operator's communicator. Raises NotConverged if the elimination fails.
    """

    contact_rows_only = True

    def __init__(self, operator: DualOperator):
        structure = operator.structure
        rows = contact_row_numbers(structure.contact)
        super().__init__(_on_contact_rows(structure, rows, operator.comm), len(rows), MPI.COMM_SELF)
        patterns = np.eye(structure.patterns)
        loads = np.column_stack([np.empty((structure.dual_dofs, 0)), *(
            np.concatenate(operator.comm.allgather(operator.elastic_response(weights)))
            for weights in patterns)])
        self._exponents = operator.stiff_parts.exponents
        level = np.concatenate(operator.comm.allgather(operator.row_level))
        self.row_level, self.levels = level[rows], operator.levels
        self.C, self.d, self._moved, self._loaded = _eliminated(operator, rows, loads)
        self.travels = {k: np.concatenate(operator.comm.allgather(moved))[rows]
                        for k, moved in operator.travels.items()}
        nothing = np.zeros(operator.owned)
        for k, weights in enumerate(patterns):
            self._loaded[k] += operator.coarse_displacements(nothing, weights)

    def with_contact(self, contact) -> "ContactCompliance":
        """The same body with other gaps, friction or initial state; counts its own products."""
        own = self.structure.contact
        return super().with_contact(dataclasses.replace(
            contact, normal_row=own.normal_row, tangential_row=own.tangential_row))

    def norm_bound(self, scale: np.ndarray) -> float:
        """The Frobenius norm of D C D, D = diag(scale); 1 where there are no rows."""
        return float(np.linalg.norm(scale[:, None] * self.C * scale)) or 1.0

    def apply(self, multipliers: np.ndarray) -> np.ndarray:
        """C times a vector of contact multipliers, and the diagonal of the step."""
        self.products += 1
        product = self.C @ multipliers
        return product if self.softness is None else product + self.softness * multipliers

    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Scalar product."""
        return float(a @ b)

    def elastic_response(self, weights: np.ndarray) -> np.ndarray:
        """d_C for the load sum_k weights_k f_k, without any rigid motion."""
        return weights @ self.d

    def deformation(self, multipliers: np.ndarray, weights: np.ndarray) -> float:
        """Largest displacement of a corner, or of a contact node by contact forces."""
        corner = weights @ self._loaded + self._moved @ multipliers
        return float(max(np.abs(corner).max(initial=0.0),
                         np.abs(self.C @ multipliers).max(initial=0.0)))

    def deformation_by_level(self, multipliers: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(levels,) by a rule, as there are no fields: by the root of the stiffness."""
        return self.deformation(multipliers, weights) * 10.0 ** (-0.5 * self._exponents)

    def preconditioner(self) -> "FaceInverse":
        """The inverse of C on a face."""
        return FaceInverse(self.C)


class FaceInverse:
    """(C_ff)^-1 by a Cholesky factorization that is kept as long as the face f stays."""

    def __init__(self, C: np.ndarray):
        self.C, self.rigid, self.face, self.factor = C, C, None, None

    def soften(self, softness: np.ndarray) -> None:
        """Take up a diagonal (c,) of C, in the place of the one before."""
        self.C, self.face = self.rigid + np.diag(softness), None

    def __call__(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """C_ff^-1 residual_f on the face `free`, zero elsewhere."""
        result, f = np.zeros_like(residual), np.flatnonzero(free)
        if len(f) == 0:
            return result
        if self.face is None or not np.array_equal(f, self.face):
            self.face = f
            self.factor = cho_factor(self.C.compress(free, 0).compress(free, 1), lower=True,
                                     check_finite=False)
        result[f] = cho_solve(self.factor, residual[f], check_finite=False)
        return result


def _on_contact_rows(structure, rows: np.ndarray, comm):
    """The skeleton as a solver on `rows` alone, in their order, sees it."""
    contact = structure.contact
    place = np.full(structure.dual_dofs + 1, -1)  # that of no row, -1, is the last
    place[rows] = np.arange(len(rows))
    contact = dataclasses.replace(contact, normal_row=place[contact.normal_row],
                                  tangential_row=place[contact.tangential_row])
    table, order = structure.at_contact, np.searchsorted(structure.at_contact.row, rows)
    table = ContactTable(np.arange(len(rows)), table.kind[order], table.scale[order],
                         table.compliance[order])
    stiffness = gather(comm, structure.row_stiffness[structure.row_kind != RowKind.GLUING])
    return dataclasses.replace(structure, contact=contact, dual_dofs=len(rows), at_contact=table,
                               row_range=(0, len(rows)), row_kind=table.kind,
                               row_scale=table.scale, row_stiffness=stiffness[order])


def _eliminated(operator: DualOperator, rows: np.ndarray, loads: np.ndarray):
    """C (c, c) and d_C (patterns, c) on the contact rows, and corner displacements.

    These come with unit contact forces (coarse dofs, c) and with the gluing forces under loads
    (patterns, coarse dofs). `loads` (dual rows, patterns) are the d of the load patterns. Every
    rank factorizes; the columns are shared out in blocks of fixed size, so that the result does not
    depend on the number of ranks.
    """
    n, corners, comm = operator.structure.dual_dofs, operator.structure.coarse_dofs, operator.comm
    k, inner = len(rows), n + corners + operator.modes - len(rows)
    place, gluing = np.empty(n, int), np.setdiff1d(np.arange(n), rows)
    place[gluing], place[rows] = np.arange(n - k), inner + np.arange(k)  # contact rows last
    matrix = _saddle_matrix(operator, place, n - k)
    coupling, contact = matrix[:inner, inner:].tocsc(), matrix[inner:, inner:].toarray()
    below = csc_matrix((inner - (n - k), loads.shape[1]))
    right = hstack([coupling, vstack([csc_matrix(loads[gluing]), below])]).tocsc()
    blocks, error = {}, None
    try:
        factor = _Factor(matrix[:inner, :inner])
        del matrix
        for first in range(WIDTH * comm.rank, right.shape[1], WIDTH * comm.size):
            solved = factor.solve(right[:, first : first + WIDTH].toarray())
            blocks[first] = coupling.T @ solved, solved[n - k : n - k + corners].copy()
    except NotConverged as problem:
        error = problem
    agree(comm, error)
    blocks = {first: parts for rank in comm.allgather(blocks) for first, parts in rank.items()}
    onto, moved = map(np.hstack, zip(*(blocks[first] for first in sorted(blocks))))
    C, d = np.triu(contact) + np.triu(contact, 1).T - onto[:, :k], loads[rows] - onto[:, k:]
    return (C + C.T) / 2, d.T, -moved[:, :k], moved[:, k:].T.copy()


def _saddle_matrix(operator: DualOperator, place: np.ndarray, first: int):
    """Upper triangle (CSR) of the matrix of gluing rows, coarse dofs, motions and contact rows.

    `place` (dual rows,) is where it has each of them, `first` that of the coarse dofs. It is the
    same on every rank. With the motions Q of bodies without support on springs S_rho = S_cc + Q
    rho^-1 Q', which a border keeps sparse.
    """
    structure, comm, modes = operator.structure, operator.comm, operator.modes
    local = [None] * len(structure.subdomains)
    for c in operator.classes:
        matrix = np.block([[c.F, -c.A], [-c.A.T, -c.S]])
        for s in c.members:
            sign = np.append(structure.rows[s].sign, np.ones(len(c.corner)))
            number = np.append(place[structure.rows[s].row], first + structure.corner_global[s])
            local[s] = number.astype(np.int32), sign, matrix
    entries = []
    for number, sign, matrix in (part for rank in comm.allgather(local) for part in rank):
        i, j = np.nonzero(number[:, None] <= number)
        entries.append((number[i], number[j], matrix[i, j] * sign[i] * sign[j]))
    motions = first + structure.coarse_dofs + np.arange(modes)
    corner = np.arange(first, first + structure.coarse_dofs)
    entries.append((np.repeat(corner, modes), np.tile(motions, len(corner)),
                    structure.rigid_corners.ravel()))
    entries.append((motions, motions, operator.rho))
    i, j, values = map(np.concatenate, zip(*entries))
    del entries
    size = len(place) + structure.coarse_dofs + modes
    return coo_matrix((values, (i, j)), shape=(size, size)).tocsr()


class _Factor:
    """Factorization of a sparse symmetric matrix by MUMPS, less rows that depend on others."""

    def __init__(self, upper):
        """`upper`: its upper triangle, CSR. Raises NotConverged, MemoryError if memory is short."""
        self.upper = upper
        if not upper.shape[0]:
            return
        upper.sort_indices()
        self._factor = factorized(petsc_upper(upper), "mumps")
        failed = self._factor.getFactorMatrix().getMumpsInfog(1)
        if failed == MUMPS_NO_MEMORY:
            raise MemoryError
        if failed < 0:
            raise NotConverged(f"the contact compliance: MUMPS failed ({failed})")

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution for columns `right` (n, k). Raises NotConverged where it leaves a residual."""
        if not right.size:
            return np.zeros_like(right)
        solution = solve_columns(self._factor, right)
        if self._residual(solution, right) > REFINED:  # pivots were small: where stiffness jumps
            left = right - _multiply(self.upper, solution)
            solution += solve_columns(self._factor, left)
            if not self._residual(solution, right) <= ROUNDING:
                raise NotConverged("the contact compliance: gluing conditions could not be "
                                   "eliminated")
        return solution

    def _residual(self, solution: np.ndarray, right: np.ndarray) -> float:
        """Largest residual of a row, relative to its terms, in a combination of the columns.

        Infinite for NaN. The combination is the same for the same columns, whatever rank has them.
        """
        v = np.random.default_rng(1).standard_normal(right.shape[1])
        combined, wanted = solution @ v, right @ v
        residual = np.abs(_multiply(self.upper, combined) - wanted)
        size = _multiply(abs(self.upper), np.abs(combined)) + np.abs(wanted)
        share = residual / np.where(size > 0, size, 1.0)
        return float(share.max()) if np.isfinite(share).all() else np.inf


def _multiply(upper, x: np.ndarray) -> np.ndarray:
    """The whole symmetric matrix with an `upper` triangle times x (n,) or (n, k)."""
    return upper @ x + upper.T @ x - (upper.diagonal() * x.T).T
