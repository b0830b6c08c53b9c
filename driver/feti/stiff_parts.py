"""What stiff parts of bodies deform by, where the stiffness jumps.

Displacements that are nothing to a soft part decide on the contact of a stiff one. So rows of B
count relative to the deformation of what they touch. With k the stiffness of a triangle (trace of
Hooke's law), k_0 that of the softest one in the scene and delta_0 the deformation of the bodies
(rigid_parts.py), material of k >= 10^e k_0 falls into parts, connected by edges, and for e > 0

    delta_e = max(largest |u - R c| of a vertex of any of these parts, 10^(d - e) delta_d, d < e),

R c the rigid motion nearest to u in the part, with a uniform swelling where anything is heated:
what stress deforms the stiff material by, and no less than that of softer material would. Of a row
it is the e with 10^e the power of ten at or below the stiffness that it meets (row_stiffness.py)
over k_0. Neither the cut nor units nor ranks change it, and where stiffness varies by less than ten
it is delta_0 and costs nothing.

Where it varies by `UNEVEN` and more within a body, factors round off more of displacements than
steps may miss, of soft parts as well: a step is judged by refined ones (extended_precision.py).
Bodies that contact or ties connect have factors of their own; where these differ as much, steps
are judged by refined displacements if they find no solution without.
"""

import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..scene import elements
from ..vectors import turned_left
from .edges import split_edges
from .gathering import gather, joined, largest

UNEVEN = 1e4  # stiffness of a body's stiffest triangle over that of its softest from which factors
# round off more of displacements than the tolerances of a step, whatever contact touches
ROUNDED = 1e-6  # of an exponent: no rounding decides on which side of a power of ten a ratio is


class StiffParts:
    """Scales of displacements of the rows of `structure`, by levels of stiffness; collective.

    `exponents` (levels,) are the e that rows have, and 0, which is the first; `level` (owned,) is
    the place of the row's own in them. `uneven`: displacements need refinement for their digits;
    `bodies_differ`: they may, as one body is so much stiffer than another.
    """

    def __init__(self, structure, comm):
        subs, self.comm = structure.subdomains, comm
        laws = {id(sub.elasticity): sub.elasticity for sub in subs}  # equal subdomains share one
        stiffness = {key: np.einsum("tii->t", law) for key, law in laws.items()}
        low, high = _of_bodies(structure, stiffness, comm)
        softest, self.uneven = low.min(initial=np.inf), bool((high >= UNEVEN * low).any())
        self.bodies_differ = bool(high.max(initial=0.0) >= UNEVEN * softest)

        def exponent(k: np.ndarray) -> np.ndarray:
            return np.floor(np.log10(k / softest) + ROUNDED).astype(int)

        rows = np.maximum(exponent(structure.row_stiffness), 0)
        self.exponents = np.unique(gather(comm, np.append(np.unique(rows), 0)))
        self.level = np.searchsorted(self.exponents, rows)
        self._parts = []
        if len(self.exponents) > 1:
            meshes = _Meshes(subs)
            of_triangles = [exponent(stiffness[id(sub.elasticity)]) for sub in subs]
            heated = comm.allreduce(any(stress.any() for sub in subs
                                        for stress in sub.thermal.values()), op=MPI.LOR)
            possible = np.append(structure.travel.bodies.possible, heated)
            self._parts = [_Parts(meshes, [of >= e for of in of_triangles], possible, comm)
                           for e in self.exponents[1:]]

    def deformations(self, fields: list[np.ndarray], whole: float) -> np.ndarray:
        """(levels,) the delta_e under displacements (dofs,) of the rank's subdomains.

        `whole` is delta_0. Collective.
        """
        own = np.array([whole, *(parts.deformation(fields) for parts in self._parts)])
        return stressed_alike(own, self.exponents)


def stressed_alike(deformations: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """(levels,) no less than what the stress of softer levels makes of them."""
    stress = np.maximum.accumulate(deformations * 10.0**exponents)
    return np.maximum(deformations, stress / 10.0**exponents)


def _of_bodies(structure, stiffness: dict, comm) -> tuple[np.ndarray, np.ndarray]:
    """(bodies,) least and largest stiffness of a triangle, from (n,) those by subdomains' laws."""
    number, bodies = structure.travel.bodies.number, len(structure.travel.bodies.size)
    low, high = np.full(bodies, -np.inf), np.full(bodies, -np.inf)
    for sub in structure.subdomains:
        own, k = number[sub.index], stiffness[id(sub.elasticity)]
        low[own], high[own] = max(low[own], -k.min()), max(high[own], k.max())
    return -largest(comm, low), largest(comm, high)


class _Meshes:
    """Vertices, triangles and edges of the rank's subdomains, one after the other."""

    def __init__(self, subs):
        self.subs = subs
        self.start = np.cumsum([0, *(len(sub.xy) for sub in subs)])
        self.xy = joined((sub.xy for sub in subs), float, 2)
        known = {}  # by mesh, which subdomains of the same shape share
        self.edges = [known.get(id(sub.elements))
                      or known.setdefault(id(sub.elements), split_edges(sub.triangles))
                      for sub in subs]


class _Parts:
    """The parts of the rank's and of other ranks' subdomains made of some `chosen` triangles.

    A piece is what a part has in a subdomain; sums go over pieces in the order of subdomains, so
    that they are the same bits on any number of ranks. `possible` (4,) is one for each motion
    without stress: along x, along y, turning, swelling.
    """

    def __init__(self, meshes: _Meshes, chosen: list[np.ndarray], possible: np.ndarray, comm):
        self.comm, self.possible = comm, possible
        pieces, nodes, count = [], [], 0
        keys = [np.empty((0, 3), np.int64)]  # both ends of outer edges, and the piece
        for sub, (outer, triangle, inner), here, start in zip(
                meshes.subs, meshes.edges, chosen, meshes.start):
            inner = inner[here[inner].all(axis=1)]
            graph = coo_matrix((np.ones(len(inner)), inner.T), shape=(len(here),) * 2)
            component = connected_components(graph, directed=False)[1]
            component[here] = np.unique(component[here], return_inverse=True)[1]
            ends, triangle = outer[here[triangle]], triangle[here[triangle]]
            keys.append(np.column_stack([np.sort(sub.node_gid[ends], axis=1),
                                         component[triangle] + count]))
            pieces.append(component[here] + count)
            nodes.append(sub.triangles[here] + start)
            count += component[here].max(initial=-1) + 1
        self.nodes, self.piece = joined(nodes, np.int64, 3), joined(pieces, np.int64)
        self.count, counts = count, comm.allgather(count)
        first = sum(counts[: comm.rank])
        edges = np.concatenate(keys) + [0, 0, first]
        self._part = _joined_pieces(gather(comm, edges), sum(counts))
        self.own = self._part[first : first + count]
        corner = meshes.xy[self.nodes]
        self.area = np.abs(elements.areas(corner)) / 3
        self.mass = np.maximum(self._sums(np.ones((len(self.nodes), 3, 1))), 1e-300)
        self.center = self._sums(corner) / self.mass
        self.away = corner - self.center[self.own[self.piece]][:, None]
        self.inertia = np.maximum(self._sums((self.away**2).sum(axis=2)[:, :, None]), 1e-300)

    def deformation(self, fields: list[np.ndarray]) -> float:
        """Largest displacement of a vertex beyond the nearest motion without stress of its part."""
        u, part = joined(fields, float).reshape(-1, 2)[self.nodes], self.own[self.piece]
        deformed = u - (self._sums(u) / self.mass * self.possible[:2])[part][:, None]
        across = turned_left(self.away)
        for motion, possible in ((across, self.possible[2]), (self.away, self.possible[3])):
            if possible:
                work = self._sums((motion * u).sum(axis=2)[:, :, None])
                deformed -= (work / self.inertia)[part][:, None] * motion
        largest = float((deformed**2).sum(axis=2).max(initial=0.0))
        return float(np.sqrt(self.comm.allreduce(largest, op=MPI.MAX)))

    def _sums(self, values: np.ndarray) -> np.ndarray:
        """(parts, k) integrals of `values` (triangles, 3 corners, k) by the corners' rule."""
        each = self.area[:, None] * values.sum(axis=1)
        pieces = np.column_stack([np.bincount(self.piece, v, self.count) for v in each.T])
        total = np.zeros((self._part.max(initial=-1) + 1, pieces.shape[1]))
        np.add.at(total, self._part, gather(self.comm, pieces))
        return total


def _joined_pieces(edges: np.ndarray, count: int) -> np.ndarray:
    """(count,) the part of every piece, by `edges` (n, 3) of outer edges' ends and their piece."""
    order = np.lexsort(edges.T[::-1])
    edges = edges[order]
    same = (edges[1:, :2] == edges[:-1, :2]).all(axis=1)
    links = edges[:-1][same, 2], edges[1:][same, 2]
    graph = coo_matrix((np.ones(len(links[0])), links), shape=(count, count))
    return connected_components(graph, directed=False)[1]
