"""Stage 4, contact part: deflation of slowly varying contact tractions that the Dirichlet preconditioner misses.

Preconditioning by subdomains knows nothing of how the body as a whole holds contact tractions that vary slowly from corner to corner:
F M has about two large eigenvalues per contact corner. Traction hats (piecewise linear between neighbouring contact corners, for
normal and tangential multipliers), restricted to the rows W of the current face, take them out:

    z = (I - P) M (I - P) r + W (W' F W)^-1 W' r,      P = W (W'W)^-1 W'.

This is the balancing preconditioner of Mandel (1993) with the orthogonal projector P in the place of the F-orthogonal one,
a two-level splitting that is stable in H^(-1/2), where tractions live. Neither P nor
W' F W = W' F_cc W (see contactblock.py) needs a product with F, so the deflation follows the face for free.
It is symmetric positive definite on the face, as M is.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack
from scipy.sparse import csr_matrix

from .contactblock import ContactBlock
from .fetidp import DirichletPreconditioner, DualOperator
from .substructuring import Substructure

DEPENDENT = 1e-4  # squared sine of the angle below which a restricted hat counts as a combination of the others


def traction_hats(structure: Substructure, rows: np.ndarray, comm):
    """(len(rows), k) CSR: nodal forces on the contact rows of tractions that are hat functions at contact corners."""
    contact = structure.contact
    row, node = _row_nodes(structure)
    position = np.searchsorted(rows, row)
    corner = np.isin(contact.gid, _corner_vertices(structure, comm))
    columns, count = [], 0
    for kind in np.unique(structure.row_kind[row]):
        for label in np.unique(contact.label):
            here = np.flatnonzero((structure.row_kind[row] == kind) & (contact.label[node] == label))
            arc, on_label = contact.arc[node[here]], contact.label == label
            knots = np.unique(np.concatenate([contact.arc[corner & on_label], [contact.arc[on_label].min(), contact.arc[on_label].max()]]))
            values = np.column_stack([np.interp(arc, knots, hat) for hat in np.eye(len(knots))])
            at, hat = np.nonzero(values)
            columns.append((position[here[at]], count + hat, (values * contact.weight[node[here], None])[at, hat]))
            count += len(knots)
    i, j, value = (np.concatenate([np.empty(0), *part]) for part in zip(*columns)) if columns else np.empty((3, 0))
    return csr_matrix((value, (i.astype(int), j.astype(int))), shape=(len(rows), count))


def _row_nodes(structure: Substructure) -> tuple[np.ndarray, np.ndarray]:
    """Global rows of all contact conditions and the contact node each belongs to."""
    numbers = np.concatenate([structure.contact.normal_row, structure.contact.tangential_row])
    node = np.tile(np.arange(len(structure.contact.gid)), 2)
    return numbers[numbers >= 0], node[numbers >= 0]


def _corner_vertices(structure: Substructure, comm) -> np.ndarray:
    """Vertex numbers of the corners of all subdomains."""
    mine = [sub.vertex_gid[sub.dof_vertex[dofs]] for sub, dofs in zip(structure.subdomains, structure.corner_dofs)]
    return np.unique(np.concatenate([np.empty(0, int), *(part for rank in comm.allgather(mine) for part in rank)]))


def _independent(matrix: np.ndarray) -> np.ndarray:
    """Columns of a positive semidefinite matrix with unit diagonal that are not nearly combinations of the others."""
    if not len(matrix):
        return np.empty(0, int)
    _, pivots, rank, _ = lapack.dpstrf(matrix, tol=DEPENDENT)
    return np.sort(pivots[:rank] - 1)


class Face:
    """The traction hats restricted to a face, with the factors of W'W and W'FW."""

    def __init__(self, block: ContactBlock, hats, free: np.ndarray):
        W = hats.multiply(free[:, None]).tocsc()
        length = np.sqrt(np.asarray(W.multiply(W).sum(axis=0)).ravel())
        W = (W[:, length > 0].multiply(1 / length[length > 0])).tocsc()
        W = W[:, _independent((W.T @ W).toarray())]
        self.W, self.W_transposed = W.tocsr(), W.T.tocsr()
        self.size = W.shape[1]
        if self.size:
            self.gram, self.coarse = cho_factor((W.T @ W).toarray()), cho_factor(block.galerkin(W))

    def average(self, v: np.ndarray) -> np.ndarray:
        """P v: the part of v (n,) that varies as slowly as the hats."""
        return self.W @ cho_solve(self.gram, self.W_transposed @ v) if self.size else np.zeros_like(v)

    def correction(self, v: np.ndarray) -> np.ndarray:
        """W (W'FW)^-1 W' v."""
        return self.W @ cho_solve(self.coarse, self.W_transposed @ v) if self.size else np.zeros_like(v)


class Deflation:
    """Keeps the hats of the latest face and preconditions residuals on the contact rows."""

    def __init__(self, block: ContactBlock, structure: Substructure):
        self.block, self.hats = block, traction_hats(structure, block.rows, block.comm)
        self._free = self._face = None

    def face(self, free: np.ndarray) -> Face:
        """The hats on the contact rows where `free` (n,) is set."""
        if self._free is None or not np.array_equal(free, self._free):
            self._free, self._face = free, Face(self.block, self.hats, free)
        return self._face

    def contact(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """z for F_cc alone, with M_cc for M; shapes (n,)."""
        face = self.face(free)
        residual = np.where(free, residual, 0.0)
        z = np.where(free, self.block.M @ (residual - face.average(residual)), 0.0)
        return z - face.average(z) + face.correction(residual)


class DeflatedPreconditioner:
    """z for the whole of F: the Dirichlet preconditioner deflated by the traction hats of the face."""

    def __init__(self, dirichlet: DirichletPreconditioner, deflation: Deflation):
        self.dirichlet, self.deflation = dirichlet, deflation

    def __call__(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """The preconditioned residual on the face `free`, zero elsewhere; dual vectors."""
        block = self.deflation.block
        face = self.deflation.face(block.gather(free) > 0)
        contact = block.gather(np.where(free, residual, 0.0))
        z = self.dirichlet(block.scatter(contact - face.average(contact), residual), free)
        found = block.gather(z)
        return block.scatter(found - face.average(found) + face.correction(contact), z)
