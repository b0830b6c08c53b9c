"""The rigid part of displacements, body by body, and what bodies deform by without it.

The rigid motion Pi u of a body that is nearest to its displacements u in L2,

    int_body R_i . (u - R c) = 0,      Pi u = R c,      R = (along x, along y, turning),

depends neither on how the body is cut nor on where it is, and the largest |u - Pi u| of a node
measures its deformation. R is linear, so that products with R need the mass matrix of an element.
The corners tell less of it for the price of a coarse solution: see `LeastDeformation`.
"""

import numpy as np
from mpi4py import MPI

from ..scene import elements
from .gathering import joined


class RigidParts:
    """Projection on the rigid motions of the bodies of `structure`. Collective over `comm`.

    Fields are lists of displacements (dofs,) of the rank's subdomains.
    """

    def __init__(self, structure, comm):
        self.structure, self.comm, self.bodies = structure, comm, structure.travel.bodies
        subs, number = structure.subdomains, self.bodies.number
        counts = [len(sub.xy) for sub in subs]
        self._starts = np.cumsum([0, *counts])
        self._body = np.repeat(number[[sub.index for sub in subs]], counts).astype(int)
        xy, mass = joined((sub.xy for sub in subs), float, 2), np.zeros(self._starts[-1])
        self._away = (xy - self.bodies.center[self._body]) / self.bodies.size[self._body, None]
        self._moment = np.zeros((len(xy), 2))  # int phi (x - center) / size
        if subs:
            nodes = np.concatenate([sub.elements + k for sub, k in zip(subs, self._starts)])
            area = np.abs(elements.areas(xy[nodes[:, :3]]))
            shape = elements.shapes(nodes.shape[1], elements.POINTS)
            unit = (shape.T * elements.WEIGHTS) @ shape  # exact for products of quadratics
            mass += np.bincount(nodes.ravel(), np.outer(area, unit.sum(axis=1)).ravel(), len(xy))
            for c in (0, 1):
                # no BLAS product, which may round a row by how many there are on the rank
                each = area[:, None] * (self._away[nodes, c][:, :, None] * unit).sum(axis=1)
                self._moment[:, c] = np.bincount(nodes.ravel(), each.ravel(), len(xy))
        self._mass = mass
        columns = [self._products(motion) for motion in self._motions().transpose(2, 0, 1)]
        self.gram = np.stack(columns, axis=2)
        missing = self.bodies.possible == 0
        self.gram[:, missing, missing] = 1.0  # their factors are zero

    def coefficients(self, fields: list[np.ndarray]) -> np.ndarray:
        """(bodies, 3) factors c of Pi u."""
        work = self._products(joined(fields, float).reshape(-1, 2))
        return np.linalg.solve(self.gram, work[:, :, None])[:, :, 0]

    def deformation(self, fields: list[np.ndarray]) -> float:
        """Largest |u - Pi u| of a node."""
        rigid = self.coefficients(fields)[self._body]
        deformed = joined(fields, float).reshape(-1, 2) - rigid[:, :2]
        deformed -= rigid[:, 2:] * np.column_stack([-self._away[:, 1], self._away[:, 0]])
        largest = float((deformed**2).sum(axis=1).max(initial=0.0))
        return float(np.sqrt(self.comm.allreduce(largest, op=MPI.MAX)))

    def _motions(self) -> np.ndarray:
        """(nodes, 2, 3) R at the nodes of the rank's subdomains."""
        motions = np.zeros((len(self._away), 2, 3))
        motions[:, 0, 0] = motions[:, 1, 1] = 1.0
        motions[:, 0, 2], motions[:, 1, 2] = -self._away[:, 1], self._away[:, 0]
        return motions * self.bodies.possible

    def _products(self, u: np.ndarray) -> np.ndarray:
        """(bodies, 3) int R . u for displacements u (nodes, 2) of the rank's subdomains."""
        x, y = self._mass * u[:, 0], self._mass * u[:, 1]
        turned = self._moment[:, 0] * u[:, 1] - self._moment[:, 1] * u[:, 0]
        parts = np.zeros((0, 3))
        if len(u):
            parts = np.add.reduceat(np.column_stack([x, y, turned]), self._starts[:-1], axis=0)
        return _by_body(parts, self.bodies, self.comm) * self.bodies.possible


class LeastDeformation:
    """A lower bound of the deformation by displacements of the corners. Collective over `comm`.

    The mean of |u - R c|^2 over the corner dofs of a body, with the c that makes it least, is not
    larger than with the c of Pi u, and that not larger than the largest square: the root of the
    mean is at most the `deformation` of `RigidParts`.
    """

    def __init__(self, structure, classes, comm):
        self.comm, self.bodies = comm, structure.travel.bodies
        members = [s for c in classes for s in c.members]  # as the coarse problem stacks them
        dofs = [structure.corner_dofs[s] for s in members]
        self._local = np.repeat(np.array(members, int), [len(d) for d in dofs])
        self._subdomains = len(structure.subdomains)
        self._body = self.bodies.number[structure.first + self._local].astype(int)
        xy = joined((structure.subdomains[s].xy[d // 2] for s, d in zip(members, dofs)), float, 2)
        away = (xy - self.bodies.center[self._body]) / self.bodies.size[self._body, None]
        across = joined(dofs, int) % 2 == 1
        self._R = np.column_stack([~across, across, np.where(across, away[:, 0], -away[:, 1])])
        self._R = self._R * self.bodies.possible
        self._count = self._sums(np.ones((len(self._R), 1)))
        gram = self._sums((self._R[:, :, None] * self._R[:, None, :]).reshape(-1, 9))
        self._inverse = np.linalg.pinv(gram.reshape(-1, 3, 3), hermitian=True)

    def __call__(self, corner: np.ndarray) -> float:
        """The bound for displacements of the rank's stacked corner dofs."""
        factors = (self._inverse @ self._sums(self._R * corner[:, None])[:, :, None])[:, :, 0]
        deformed = corner - (self._R * factors[self._body]).sum(axis=1)
        mean = self._sums(deformed[:, None]**2) / np.maximum(self._count, 1)
        return float(np.sqrt(mean.max(initial=0.0)))

    def _sums(self, values: np.ndarray) -> np.ndarray:
        """(bodies, k) sums of `values` (corner dofs, k)."""
        parts = np.column_stack([np.bincount(self._local, v, self._subdomains) for v in values.T])
        return _by_body(parts, self.bodies, self.comm)


def _by_body(parts: np.ndarray, bodies, comm) -> np.ndarray:
    """(bodies, k) sums of the ranks' `parts` (subdomains, k), by subdomain in their order.

    So they are the same bits on any number of ranks.
    """
    total = np.zeros((len(bodies.size), parts.shape[1]))
    np.add.at(total, bodies.number, np.concatenate(comm.allgather(parts)))
    return total
