"""The rigid part of displacements, body by body, and what bodies deform by without it.

The rigid motion Pi u of a body that is nearest to its displacements u in L2,

    int_body R_i . (u - R c) = 0,      Pi u = R c,      R = (along x, along y, turning),

depends neither on how the body is cut nor on where it is. R is linear, so that products with R need
the mass matrix of an element. What the body deforms by is the largest |u - R c| of a vertex, with
the integral by the corners of triangles: so stiff parts are measured (stiff_parts.py), and linear
and quadratic elements alike. A node between vertices may move far by the force on it alone.
The corners tell less of it for the price of a coarse solution: see `LeastDeformation`.
"""

from functools import cached_property

import numpy as np
from mpi4py import MPI

from ..scene import elements
from .gathering import gather, joined

AT_A_TIME = 100_000  # nodes: what is kept of each beside its displacement takes memory


class RigidParts:
    """Projection on the rigid motions of the bodies of `structure`. Collective over `comm`.

    What it takes of the meshes is worked out when it is first asked for: many runs ask for nothing.
    Fields are lists of displacements (dofs,) of the rank's subdomains.
    """

    def __init__(self, structure, comm):
        self.structure, self.comm, self.bodies = structure, comm, structure.travel.bodies
        subs, number = structure.subdomains, self.bodies.number
        counts = [len(sub.xy) for sub in subs]
        self._starts = np.cumsum([0, *counts])
        self._body = np.repeat(number[[sub.index for sub in subs]], counts).astype(int)

    @cached_property
    def gram(self) -> np.ndarray:
        """(bodies, 3, 3) products of R with itself in L2; collective when first asked for."""
        return self._gram(*self._moments)

    @cached_property
    def _corner_gram(self) -> np.ndarray:
        """(bodies, 3, 3) the same by the corners of triangles."""
        return self._gram(*self._corner_moments)

    @cached_property
    def _away(self) -> np.ndarray:
        """(nodes, 2) places of the rank's nodes from the centers of their bodies, over the size."""
        xy = joined((sub.xy for sub in self.structure.subdomains), float, 2)
        return (xy - self.bodies.center[self._body]) / self.bodies.size[self._body, None]

    @cached_property
    def _corner_moments(self) -> tuple[np.ndarray, np.ndarray]:
        """(nodes,) areas by the corners of triangles, zero at nodes between them, and moments."""
        mass = np.zeros(self._starts[-1])
        for sub, nodes in self._by_subdomain():
            mass[nodes] = np.bincount(sub.triangles.ravel(), np.repeat(_areas(sub) / 3, 3),
                                      len(sub.xy))
        return mass, mass[:, None] * self._away

    def _by_subdomain(self):
        """The rank's subdomains and their nodes among its own."""
        return zip(self.structure.subdomains, map(slice, self._starts[:-1], self._starts[1:]))

    @cached_property
    def _moments(self) -> tuple[np.ndarray, np.ndarray]:
        """(nodes,) int phi and (nodes, 2) int phi (x - center) / size."""
        mass, moment = np.zeros(self._starts[-1]), np.zeros((self._starts[-1], 2))
        for sub, nodes in self._by_subdomain():
            area, of, count = _areas(sub), sub.elements, len(sub.xy)
            shape = elements.shapes(of.shape[1], elements.POINTS)
            unit = (shape.T * elements.WEIGHTS) @ shape  # exact for products of quadratics
            mass[nodes] = np.bincount(of.ravel(), np.outer(area, unit.sum(axis=1)).ravel(), count)
            for away, into in zip(self._away[nodes].T, moment[nodes].T):
                # no BLAS product, which may round a row by how many there are
                each = area[:, None] * (away[of][:, :, None] * unit).sum(axis=1)
                into[:] = np.bincount(of.ravel(), each.ravel(), count)
        return mass, moment

    def _gram(self, mass: np.ndarray, moment: np.ndarray) -> np.ndarray:
        """(bodies, 3, 3) products of R with itself by `mass` (nodes,) and `moment` (nodes, 2)."""
        inertia = (moment * self._away).sum(axis=1)
        whole, x, y, turning = self._sums(mass, *moment.T, inertia).T
        gram, possible = np.zeros((len(whole), 3, 3)), self.bodies.possible
        gram[:, 0, 0], gram[:, 1, 1], gram[:, 2, 2] = whole, whole, turning
        gram[:, 0, 2], gram[:, 2, 0] = -y, -y
        gram[:, 1, 2], gram[:, 2, 1] = x, x
        gram *= possible[:, None] * possible
        gram[:, possible == 0, possible == 0] = 1.0  # their factors are zero
        return gram

    def coefficients(self, fields: list[np.ndarray]) -> np.ndarray:
        """(bodies, 3) factors c of Pi u."""
        work = self._products(joined(fields, float).reshape(-1, 2))
        return np.linalg.solve(self.gram, work[:, :, None])[:, :, 0]

    def deformation(self, fields: list[np.ndarray]) -> float:
        """Largest |u - R c| of a vertex, c by the corners of triangles."""
        u = joined(fields, float).reshape(-1, 2)
        work = self._corner_products(u)[:, :, None]
        factors, largest = np.linalg.solve(self._corner_gram, work)[:, :, 0], 0.0
        for first in range(0, len(u), AT_A_TIME):
            here = slice(first, first + AT_A_TIME)
            (x, y), (u_x, u_y) = self._away[here].T, u[here].T
            along, across, turning = factors[self._body[here]].T
            moved = (u_x - along + turning * y)**2 + (u_y - across - turning * x)**2
            vertices = self._corner_moments[0][here] > 0
            largest = np.maximum(largest, moved.max(initial=0.0, where=vertices))  # NaN stays
        return float(np.sqrt(self.comm.allreduce(float(largest), op=MPI.MAX)))

    def _products(self, u: np.ndarray) -> np.ndarray:
        """(bodies, 3) int R . u for displacements u (nodes, 2) of the rank's subdomains."""
        return self._work(u, *self._moments)

    def _corner_products(self, u: np.ndarray) -> np.ndarray:
        """(bodies, 3) the same by the corners of triangles."""
        return self._work(u, *self._corner_moments)

    def _work(self, u: np.ndarray, mass: np.ndarray, moment: np.ndarray) -> np.ndarray:
        """(bodies, 3) work of displacements u (nodes, 2) on R with `mass` (nodes,) and its moment.
        """
        turned = moment[:, 0] * u[:, 1] - moment[:, 1] * u[:, 0]
        return self._sums(mass * u[:, 0], mass * u[:, 1], turned) * self.bodies.possible

    def _sums(self, *columns: np.ndarray) -> np.ndarray:
        """(bodies, k) sums of k `columns` (nodes,) of the rank's subdomains; collective."""
        parts = np.zeros((len(self._starts) - 1, len(columns)))
        if len(parts):
            for k, column in enumerate(columns):
                parts[:, k] = np.add.reduceat(column, self._starts[:-1])
        return _by_body(parts, self.bodies, self.comm)


def _areas(sub) -> np.ndarray:
    """(n_t,) areas of a subdomain's triangles, as if sides were straight."""
    return np.abs(elements.areas(sub.xy[sub.triangles]))


class LeastDeformation:
    """A lower bound of the deformation by displacements of the corners. Collective over `comm`.

    The mean of |u - R c|^2 over the corner dofs of a body at vertices, with the c that makes it
    least, is not larger than with any other c, and that not larger than the largest square: the
    root of the mean is at most the `deformation` of `RigidParts`.
    """

    def __init__(self, structure, classes, comm):
        self.comm, self.bodies = comm, structure.travel.bodies
        members = [s for c in classes for s in c.members]  # as the coarse problem stacks them
        dofs = [structure.corner_dofs[s] for s in members]
        known = {id(sub.elements): sub for sub in structure.subdomains}
        vertices = {key: _vertices(sub) for key, sub in known.items()}  # by mesh
        self._at_vertices = joined(
            (vertices[id(structure.subdomains[s].elements)][d // 2] for s, d in zip(members, dofs)),
            bool)
        self._local = np.repeat(np.array(members, int), [len(d) for d in dofs])
        self._subdomains = len(structure.subdomains)
        self._body = self.bodies.number[structure.first + self._local].astype(int)
        xy = joined((structure.subdomains[s].xy[d // 2] for s, d in zip(members, dofs)), float, 2)
        away = (xy - self.bodies.center[self._body]) / self.bodies.size[self._body, None]
        across = joined(dofs, int) % 2 == 1
        motions = np.array([~across, across, np.where(across, away[:, 0], -away[:, 1])])
        self._R = motions * self.bodies.possible[:, None] * self._at_vertices  # (3, corner dofs)
        self._count = self._sums(self._at_vertices[None] * 1.0)[:, 0]
        gram = self._sums((self._R[:, None] * self._R).reshape(9, -1))
        self._inverse = np.linalg.pinv(gram.reshape(-1, 3, 3), hermitian=True)

    def __call__(self, corner: np.ndarray) -> float:
        """The bound for displacements of the rank's stacked corner dofs."""
        factors = (self._inverse @ self._sums(self._R * corner)[:, :, None])[:, :, 0]
        along, across, turning = self._R * factors.T[:, self._body]
        deformed = self._at_vertices * corner - (along + across + turning)
        mean = self._sums(deformed[None]**2)[:, 0] / np.maximum(self._count, 1)
        return float(np.sqrt(mean.max(initial=0.0)))

    def _sums(self, values: np.ndarray) -> np.ndarray:
        """(bodies, k) sums of `values` (k, corner dofs)."""
        parts = np.column_stack([np.bincount(self._local, v, self._subdomains) for v in values])
        return _by_body(parts, self.bodies, self.comm)


def _vertices(sub) -> np.ndarray:
    """(nodes,) whether a node of the subdomain is a vertex."""
    vertex = np.zeros(len(sub.xy), bool)
    vertex[sub.triangles] = True
    return vertex


def _by_body(parts: np.ndarray, bodies, comm) -> np.ndarray:
    """(bodies, k) sums of the ranks' `parts` (subdomains, k), by subdomain in their order.

    So they are the same bits on any number of ranks.
    """
    whole = gather(comm, parts)
    return np.column_stack([np.bincount(bodies.number, part, len(bodies.size))
                            for part in whole.T])
