"""Deflation of slowly varying contact tractions.

Preconditioning by subdomains knows nothing of how the body as a whole holds contact tractions that
vary slowly from corner to corner: M F has about two large eigenvalues per contact corner. Traction
hats (piecewise linear between neighbouring contact corners, for normal and tangential multipliers)
take them out. With the hats H on the rows of the current face and their nodal forces W = D H, D the
weights of the nodes times the stiffness there,

    z = (I - P) M (I - P') r + W (W' F W)^-1 W' r,      P = W (H'W)^-1 H'.

This is the balancing preconditioner of Mandel (1993) with the mass projector P in the place of the
F-orthogonal one: P' reproduces slowly varying displacements r, P slowly varying forces z. Neither P
nor W' F W = W' F_cc W (contact_block.py) needs a product with F, so the deflation follows the face
for free. It is symmetric positive definite on the face, as M is. Measured for 10x10 cells on faces
of several kinds: condition numbers of 16 to 21 with 8 subdomains and of 20 to 25 with 32; without
deflation 260 to 850, and 630 to 2,800.

Uneven nodes (Skeleton.uneven) and those of a stiff body on a soft one with a coarser mesh
(row_stiffness.left_alone) have a hat of their own, with which F_cc is inverted there exactly: thin
triangles, jumps and directions of the stiffness raise the condition number no more. Hats begin
and end where Young's modulus jumps from subdomain to subdomain, too, and the stiffness in D lets
the stiffer side of a hat decide: large displacements of the compliant side, averaged into the hat,
would leave the stiff side a part that M answers with its stiffness. For a jump by 1e6 the condition
number was 1e11 without it and is below 20.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, lapack

from .contact_block import ContactBlock, Galerkin
from .dirichlet import DirichletPreconditioner
from .gathering import gather, joined
from .structure import Substructure

DEPENDENT = 1e-4  # squared sine below which a restricted hat counts as a combination of others
IDLE = 1e-10  # part of W'FW below which it is rounding


@dataclass
class Hats:
    """Piecewise linear tractions between the contact corners of a chain, a row between two of them.

    `number` (n, 2) are the hats at the n contact rows and `value` (n, 2) their tractions there;
    `weight` (n,) turns tractions into nodal forces, more of them where the body is stiffer.
    """

    number: np.ndarray
    value: np.ndarray
    weight: np.ndarray
    count: int

    def sums(self, at_rows: np.ndarray) -> np.ndarray:
        """(count,) sums over the rows of every hat of values (n, 2) of a row's hats."""
        return np.bincount(self.number.ravel(), at_rows.ravel(), minlength=self.count)

    def gram(self, force: np.ndarray, value: np.ndarray) -> np.ndarray:
        """(count, count) products of nodal forces and tractions of the hats, (n, 2) each."""
        products = force[:, :, None] * value[:, None, :]
        k = self.count
        return np.bincount(self._cell, products.ravel(), minlength=k * k).reshape(k, k)

    @cached_property
    def _cell(self) -> np.ndarray:
        """Where `gram` adds the products at every row."""
        return (self.number[:, :, None] * self.count + self.number[:, None, :]).ravel()


def traction_hats(structure: Substructure, rows: np.ndarray, comm) -> Hats:
    """Hats on the contact `rows`: tops at corners, ends, stiffness jumps, `with_hats`."""
    contact = structure.contact
    row, node = _row_nodes(structure)
    position = np.searchsorted(rows, row)
    top = np.isin(contact.gid, np.union1d(_corner_vertices(structure, comm), structure.with_hats))
    number, value, count = np.zeros((len(rows), 2), int), np.zeros((len(rows), 2)), 0
    place = np.searchsorted(structure.at_contact.row, row)
    kinds, scale = structure.at_contact.kind[place], structure.at_contact.scale[place]
    for kind in np.unique(kinds):
        for chain in np.unique(contact.chain):
            on_chain = contact.chain == chain
            here = np.flatnonzero((kinds == kind) & on_chain[node])
            arc = contact.arc[node[here]]
            ends = [contact.arc[on_chain].min(), contact.arc[on_chain].max()]
            jumps = _jumps(arc, scale[here])
            knots = np.unique(np.concatenate([contact.arc[top & on_chain], ends, jumps]))
            left = np.searchsorted(knots[1:-1], arc, side="right")
            right = np.minimum(left + 1, len(knots) - 1)
            share = (arc - knots[left]) / np.where(right > left, knots[right] - knots[left], 1.0)
            number[position[here]] = count + np.column_stack([left, right])
            value[position[here]] = np.column_stack([1 - share, share])
            count += len(knots)
    weight = np.empty(len(rows))
    weight[position] = contact.weight[node] * scale**2
    return Hats(number, value, weight, count)


def _jumps(arc: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Arc lengths of the stiffer neighbours where the stiffness jumps, from the rows' scales.

    Neighbouring powers of two are no jump: hardly varying stiffness may have them.
    """
    order = np.argsort(arc)
    arc, scale = arc[order], scale[order]
    edge = np.flatnonzero(np.maximum(scale[1:], scale[:-1]) > 2 * np.minimum(scale[1:], scale[:-1]))
    return arc[edge + (scale[edge + 1] > scale[edge])]


def _row_nodes(structure: Substructure) -> tuple[np.ndarray, np.ndarray]:
    """Global rows of all contact conditions and the contact node each belongs to."""
    numbers = np.concatenate([structure.contact.normal_row, structure.contact.tangential_row])
    node = np.tile(np.arange(len(structure.contact.gid)), 2)
    return numbers[numbers >= 0], node[numbers >= 0]


def _corner_vertices(structure: Substructure, comm) -> np.ndarray:
    """Vertex numbers of the contact nodes that are corners of subdomains."""
    mine = joined([sub.node_gid[sub.dof_node[dofs]]
                   for sub, dofs in zip(structure.subdomains, structure.corner_dofs)], int)
    return np.unique(gather(comm, np.intersect1d(mine, structure.contact.gid)))


class Face:
    """The traction hats restricted to a face, with the factors of H'W and W'FW.

    Hats that leave nothing on the face, or nothing new beside the others, are left out; the columns
    of H are scaled to unit diagonal of H'W.
    """

    def __init__(self, hats: Hats, galerkin: Galerkin, free: np.ndarray):
        self.hats = hats
        self.H = np.where(free[:, None], hats.value, 0.0)  # as Hats.value
        self.W = hats.weight[:, None] * self.H
        mass = hats.gram(self.W, self.H)
        size = np.diag(mass)
        scale = np.divide(1.0, np.sqrt(size), out=np.zeros(len(size)), where=size > 0)
        # pivoted Cholesky: hats beyond the rank are nothing, or combinations of the others
        scaled = mass * np.outer(scale, scale)
        factor, pivots, rank, _ = lapack.dpstrf(scaled, tol=DEPENDENT)
        self.independent = pivots[:rank] - 1
        self.scale, self.mass = scale[self.independent], np.asfortranarray(factor[:rank, :rank])
        if rank:
            scales = np.outer(self.scale, self.scale)
            coarse = galerkin(self.W)[self.independent[:, None], self.independent] * scales
            self.coarse, stopped = lapack.dpotrf(coarse, clean=0)
            # of a singular matrix rounding may leave the last pivot positive
            if stopped or (np.diag(self.coarse) ** 2 <= IDLE * np.diag(coarse)).any():
                self._without_idle(scaled, scale, coarse)

    def _without_idle(self, mass: np.ndarray, scale: np.ndarray, coarse: np.ndarray) -> None:
        """Leave out hats that together move nothing, too, where `coarse`, W'FW, is singular.

        So it is where contact conditions of bodies that meet in one place depend on one another.
        """
        size = 1.0 / np.sqrt(np.diag(coarse))
        _, pivots, rank, _ = lapack.dpstrf(coarse * np.outer(size, size), tol=IDLE)
        kept = np.sort(pivots[:rank] - 1)
        self.independent = self.independent[kept]
        self.scale, among = scale[self.independent], np.ix_(self.independent, self.independent)
        self.mass = np.asfortranarray(cho_factor(mass[among], check_finite=False)[0])
        self.coarse = cho_factor(coarse[np.ix_(kept, kept)], check_finite=False)[0]

    def deflate(self, residual: np.ndarray, precondition) -> np.ndarray:
        """(I - P) M (I - P') r + W (W'FW)^-1 W' r for residuals (n,); `precondition` is M."""
        if not len(self.independent):
            return precondition(residual)
        slow = self._sums(self.W, residual)
        z = precondition(residual - self._values(self.H, self._solve(self.mass, slow)))
        change = self._solve(self.coarse, slow) - self._solve(self.mass, self._sums(self.H, z))
        return z + self._values(self.W, change)

    def _sums(self, at_rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(independent,) products of the columns of H or W with values (n,)."""
        return self.scale * self.hats.sums(at_rows * values[:, None])[self.independent]

    def _values(self, at_rows: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """(n,) combination of the columns of H or W."""
        every = np.zeros(self.hats.count)
        every[self.independent] = self.scale * coefficients
        return (at_rows * every[self.hats.number]).sum(axis=1)

    @staticmethod
    def _solve(factor: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Solution with an upper Cholesky factor."""
        return lapack.dpotrs(factor, right)[0]


class Deflation:
    """Keeps the hats of the latest face and preconditions residuals on the contact rows."""

    def __init__(self, block: ContactBlock, structure: Substructure):
        self.block = block
        self.hats = traction_hats(structure, block.rows, block.comm)
        self.galerkin = Galerkin(block, self.hats.number, self.hats.count)
        self._free = self._face = None

    def soften(self, softness: np.ndarray) -> None:
        """Add a diagonal (owned,) to F_cc, in the place of the one before; collective."""
        self.block.softness, self._free, self._face = self.block.gather(softness), None, None

    def face(self, free: np.ndarray) -> Face:
        """The hats on the contact rows where `free` (n,) is set."""
        if self._free is None or not np.array_equal(free, self._free):
            self._free, self._face = free, Face(self.hats, self.galerkin, free)
        return self._face

    def contact(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """z for F_cc alone, with M_cc for M; shapes (n,)."""
        return self.face(free).deflate(np.where(free, residual, 0.0),
                                       lambda r: np.where(free, self.block.M @ r, 0.0))


class DeflatedPreconditioner:
    """z for the whole of F: the Dirichlet preconditioner deflated by the face's traction hats."""

    def __init__(self, dirichlet: DirichletPreconditioner, deflation: Deflation):
        self.dirichlet, self.deflation = dirichlet, deflation

    def __call__(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """The preconditioned residual on the face `free`, zero elsewhere; dual vectors."""
        block, z = self.deflation.block, None
        on_face, contact = block.gathered(free, residual)
        on_face = on_face > 0

        def dirichlet(contact: np.ndarray) -> np.ndarray:
            nonlocal z
            z = self.dirichlet(block.scatter(contact, residual), free)
            return block.gather(z)

        contact = np.where(on_face, contact, 0.0)
        return block.scatter(self.deflation.face(on_face).deflate(contact, dirichlet), z)
