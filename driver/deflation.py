"""Stage 4, contact part: deflation of slowly varying contact tractions that the Dirichlet preconditioner misses.

Preconditioning by subdomains knows nothing of how the body as a whole holds contact tractions that vary slowly
from corner to corner: M F has about two large eigenvalues per contact corner. Traction hats (piecewise linear
between neighbouring contact corners, for normal and tangential multipliers) take them out. With the hats H on the
rows of the current face and their nodal forces W = D H, D the weights of the nodes,

    z = (I - P) M (I - P') r + W (W' F W)^-1 W' r,      P = W (H'W)^-1 H'.

This is the balancing preconditioner of Mandel (1993) with the mass projector P in the place of the F-orthogonal
one: P' reproduces slowly varying displacements r, P slowly varying forces z. Neither P nor W' F W = W' F_cc W
(contactblock.py) needs a product with F, so the deflation follows the face for free. It is symmetric positive
definite on the face, as M is. Measured for 10x10 cells on faces of several kinds: condition numbers of 16 to 21 with
8 subdomains and of 20 to 25 with 32; without deflation 260 to 850, and 630 to 2,800.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack
from scipy.sparse import csr_matrix

from .contactblock import ContactBlock
from .fetidp import DirichletPreconditioner
from .substructuring import Substructure

DEPENDENT = 1e-4  # squared sine of the angle below which a restricted hat counts as a combination of the others


def traction_hats(structure: Substructure, rows: np.ndarray, comm):
    """Hat functions at the contact corners on the contact `rows`, (len(rows), k) CSR, and the rows' weights."""
    contact = structure.contact
    row, node = _row_nodes(structure)
    position = np.searchsorted(rows, row)
    corner = np.isin(contact.gid, _corner_vertices(structure, comm))
    columns, count = [], 0
    for kind in np.unique(structure.row_kind[row]):
        for label in np.unique(contact.label):
            here = np.flatnonzero((structure.row_kind[row] == kind) & (contact.label[node] == label))
            arc, on_label = contact.arc[node[here]], contact.label == label
            ends = [contact.arc[on_label].min(), contact.arc[on_label].max()]
            knots = np.unique(np.concatenate([contact.arc[corner & on_label], ends]))
            values = np.column_stack([np.interp(arc, knots, hat) for hat in np.eye(len(knots))])
            at, hat = np.nonzero(values)
            columns.append((position[here[at]], count + hat, values[at, hat]))
            count += len(knots)
    i, j, value = (np.concatenate([np.empty(0), *part]) for part in zip(*columns)) if columns else np.empty((3, 0))
    weight = np.empty(len(rows))
    weight[position] = contact.weight[node]
    return csr_matrix((value, (i.astype(int), j.astype(int))), shape=(len(rows), count)), weight


def _row_nodes(structure: Substructure) -> tuple[np.ndarray, np.ndarray]:
    """Global rows of all contact conditions and the contact node each belongs to."""
    numbers = np.concatenate([structure.contact.normal_row, structure.contact.tangential_row])
    node = np.tile(np.arange(len(structure.contact.gid)), 2)
    return numbers[numbers >= 0], node[numbers >= 0]


def _corner_vertices(structure: Substructure, comm) -> np.ndarray:
    """Vertex numbers of the corners of all subdomains."""
    mine = [sub.node_gid[sub.dof_node[dofs]] for sub, dofs in zip(structure.subdomains, structure.corner_dofs)]
    return np.unique(np.concatenate([np.empty(0, int), *(part for rank in comm.allgather(mine) for part in rank)]))


def _independent(matrix: np.ndarray) -> np.ndarray:
    """Columns of a positive semidefinite matrix with unit diagonal that are not nearly combinations of the others."""
    if not len(matrix):
        return np.empty(0, int)
    _, pivots, rank, _ = lapack.dpstrf(matrix, tol=DEPENDENT)
    return np.sort(pivots[:rank] - 1)


class Face:
    """The traction hats restricted to a face, with the factors of H'W and W'FW."""

    def __init__(self, block: ContactBlock, hats, weight: np.ndarray, free: np.ndarray):
        H = hats.multiply(free[:, None]).tocsc()
        mass = H.multiply(H).T @ weight
        H = (H[:, mass > 0].multiply(1 / np.sqrt(mass[mass > 0]))).tocsc()
        H = H[:, _independent((H.T @ H.multiply(weight[:, None])).toarray())]
        W = H.multiply(weight[:, None]).tocsc()
        self.size = H.shape[1]
        self.H, self.W, self.H_transposed, self.W_transposed = H.tocsr(), W.tocsr(), H.T.tocsr(), W.T.tocsr()
        if self.size:
            self.mass, self.coarse = cho_factor((H.T @ W).toarray()), cho_factor(block.galerkin(W))

    def displacement(self, r: np.ndarray) -> np.ndarray:
        """P' r: the part of displacements r (n,) that varies as slowly as the hats."""
        return self.H @ cho_solve(self.mass, self.W_transposed @ r) if self.size else np.zeros_like(r)

    def force(self, z: np.ndarray) -> np.ndarray:
        """P z: the part of nodal forces z (n,) whose traction varies as slowly as the hats."""
        return self.W @ cho_solve(self.mass, self.H_transposed @ z) if self.size else np.zeros_like(z)

    def correction(self, r: np.ndarray) -> np.ndarray:
        """W (W'FW)^-1 W' r."""
        return self.W @ cho_solve(self.coarse, self.W_transposed @ r) if self.size else np.zeros_like(r)


class Deflation:
    """Keeps the hats of the latest face and preconditions residuals on the contact rows."""

    def __init__(self, block: ContactBlock, structure: Substructure):
        self.block = block
        self.hats, self.weight = traction_hats(structure, block.rows, block.comm)
        self._free = self._face = None

    def face(self, free: np.ndarray) -> Face:
        """The hats on the contact rows where `free` (n,) is set."""
        if self._free is None or not np.array_equal(free, self._free):
            self._free, self._face = free, Face(self.block, self.hats, self.weight, free)
        return self._face

    def contact(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """z for F_cc alone, with M_cc for M; shapes (n,)."""
        face = self.face(free)
        residual = np.where(free, residual, 0.0)
        z = np.where(free, self.block.M @ (residual - face.displacement(residual)), 0.0)
        return z - face.force(z) + face.correction(residual)


class DeflatedPreconditioner:
    """z for the whole of F: the Dirichlet preconditioner deflated by the traction hats of the face."""

    def __init__(self, dirichlet: DirichletPreconditioner, deflation: Deflation):
        self.dirichlet, self.deflation = dirichlet, deflation

    def __call__(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """The preconditioned residual on the face `free`, zero elsewhere; dual vectors."""
        block = self.deflation.block
        face = self.deflation.face(block.gather(free) > 0)
        contact = block.gather(np.where(free, residual, 0.0))
        z = self.dirichlet(block.scatter(contact - face.displacement(contact), residual), free)
        found = block.gather(z)
        return block.scatter(found - face.force(found) + face.correction(contact), z)
