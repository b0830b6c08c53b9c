"""One side of a mortar coupling: its edges, normals, curved places and their measure.

The sides of elements may be curved themselves (quadratic elements along parabolas), or be chords of
a smooth curve that bows from them by its sagitta; see mortar.py.
"""

from dataclasses import dataclass

import numpy as np

from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..scene import sides
from ..scene.elements import cross
from ..vectors import unit
from .axis import on_axis, smooth_normals

POINT = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])  # Gauss, exact to degree 5 on [-1, 1]
WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0  # of an interval of length 1


@dataclass
class Side:
    """One side of a pair: nodes with place (n, 2), and edges (e, 2), or (e, 3) with their middles.

    `edge_normal` (e, 2) are the unit outward normals, `bow` (e, 2) the ways from the middles to the
    boundary's curve, `length` (e,) that of the edges in the configuration that stresses refer to;
    by default as they lie. `radius` (n,) of the nodes there, for bodies of revolution, whose
    integrals have the weight 2 pi r. `chord` and `rise` (e, 2), of edges that are curved
    themselves, are the ways from end to end and from its middle to the edge's in that
    configuration. `same` (k, 2) are nodes that a period makes one place; the second has the
    condition there.
    """

    xy: np.ndarray
    edges: np.ndarray
    edge_normal: np.ndarray
    bow: np.ndarray | None = None
    length: np.ndarray | None = None
    radius: np.ndarray | None = None
    chord: np.ndarray | None = None
    rise: np.ndarray | None = None
    same: np.ndarray | None = None

    def __post_init__(self):
        if self.length is None:
            self.length = self._length()

    def _length(self) -> np.ndarray:
        return np.linalg.norm(self.xy[self.edges[:, 1]] - self.xy[self.edges[:, 0]], axis=1)

    def ring(self, e: np.ndarray, xi: np.ndarray):
        """(m,) 2 pi r at the places xi of edges e; 1 of plane bodies."""
        if self.radius is None:
            return 1.0
        a, b = self.radius[self.edges[e, :2]].T
        r = a + xi * (b - a)
        if self.rise is not None:
            r = r + 4 * xi * (1 - xi) * self.rise[e, 0]
        return 2 * np.pi * np.maximum(r, 0.0)

    def stretch(self, e: np.ndarray, xi: np.ndarray):
        """(m,) length along edges e at the places xi per length of the chord; 1 if straight."""
        if self.rise is None:
            return 1.0
        tangent = self.chord[e] + 4 * (1 - 2 * xi)[:, None] * self.rise[e]
        return np.linalg.norm(tangent, axis=1) / self.length[e]

    def uniform(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, 2) int phi_i n ds as the edges lie, and (n,) int phi_i ds, of curved edges.

        Of nodes at one place together.
        """
        place = self.xy[self.edges]
        place[:, 2] = place[:, :2].mean(axis=1) + self.bow
        force, length = np.zeros_like(self.xy), np.zeros(len(self.xy))
        np.add.at(force, self.edges, sides.normals(place))
        np.add.at(length, self.edges, sides.integrals(place))
        return self._joined(force), self._joined(length)

    @property
    def begins_on_axis(self) -> np.ndarray:
        """(e,) whether an end of an edge is on the axis."""
        if self.radius is None:
            return np.zeros(len(self.edges), bool)
        return on_axis(self.radius)[self.edges[:, :2]].any(axis=1)

    def nodal_normals(self) -> np.ndarray:
        """(n, 2) unit averages of the edges' normals, see `_averages`; smooth across an axis."""
        normal = self._averages() if self.rise is None else unit(self.uniform()[0])
        if self.radius is None:
            return normal
        return smooth_normals(normal, self.edges[:, :2], self.radius)

    @property
    def in_one_place(self) -> np.ndarray:
        """(n,) which node has the condition of each."""
        node = np.arange(len(self.xy))
        node[self.same[:, 0]] = self.same[:, 1]
        return node

    def _joined(self, total: np.ndarray) -> np.ndarray:
        """Sums over the edges at every node (n, ...), those at one place added up."""
        if self.same is None:
            return total
        one, two = self.same.T
        both, joined = total[one] + total[two], total.copy()
        joined[one] = joined[two] = both
        return joined

    def _averages(self) -> np.ndarray:
        """(n, 2) unit averages of the edges' normals, each weighted with the other edge's length.

        That is the normal of the circle through a vertex and its neighbours: right to second order
        on curves, however lengths change from edge to edge. Weights that grow with the edge's own
        length would be right to first order. In middles the average of both ends'.
        """
        ends, total = self.edges[:, :2], np.zeros_like(self.xy)
        np.add.at(total, ends.ravel(),
                  np.repeat(self.edge_normal / self._length()[:, None], 2, axis=0))
        total = self._joined(total)
        if self.edges.shape[1] == 3:
            total[ends] = unit(total[ends].reshape(-1, 2)).reshape(-1, 2, 2)
            total[self.edges[:, 2]] = total[ends].sum(axis=1)
        return unit(total)


def split(edges: np.ndarray, edge_normal: np.ndarray, vertex: np.ndarray,
          facing: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges (e, 2 or 3) of a side whose corners are two vertices, one of each flank.

    Its contact nodes lie at `vertex` (n,) and face as `facing` (n, 2); where two have one vertex,
    that of the second becomes a new one, at the ends of the edges that face more like it. Also the
    vertices (k,) that the new ones, numbered on, are copies of, and the (n,) vertices of the nodes.
    """
    order = np.argsort(vertex, kind="stable")
    twin = vertex[order][1:] == vertex[order][:-1]
    one, two = order[:-1][twin], order[1:][twin]
    copied, vertex, edges = vertex[two], vertex.copy(), edges.copy()
    new = edges.max(initial=-1) + 1 + np.arange(len(two))
    vertex[two] = new
    for old, number, ahead in zip(copied, new, facing[two] - facing[one]):
        e, end = np.nonzero(edges == old)
        own = edge_normal[e] @ ahead > 0
        edges[e[own], end[own]] = number
    return edges, copied, vertex


def before_flanks(first: Side, twins: np.ndarray, second_normal: np.ndarray) -> np.ndarray:
    """(e, o) whether edges of the first side are before edges with `second_normal` (o, 2).

    At a corner, whose two vertices are `twins` (k, 2), what opposes one flank more than the other
    is not before the other: beyond the end of a flank in a corner that is not quite filled its
    normals meet the other flank's side askew.
    """
    edges = first.edges
    able = np.ones((len(edges), len(second_normal)), bool)
    graph = coo_matrix((np.ones(len(edges)), edges[:, :2].T), shape=(len(first.xy),) * 2)
    piece = connected_components(graph, directed=False)[1]
    for pair in twins:
        (here,), (there,) = (np.flatnonzero((edges[:, :2] == vertex).any(axis=1))[:1]
                             for vertex in pair)
        if piece[pair[0]] == piece[pair[1]]:
            continue
        away = second_normal @ (first.edge_normal[there] - first.edge_normal[here])
        for vertex, other in ((pair[0], away < 0), (pair[1], away > 0)):
            able[np.ix_(piece[edges[:, 0]] == piece[vertex], other)] = False
    return able


def rises(xy: np.ndarray) -> dict[str, np.ndarray]:
    """`chord` and `rise` of a Side with edges at xy (e, 3, 2), nothing if they are straight."""
    if not sides.are_curved(xy):
        return {}
    return {"chord": xy[:, 1] - xy[:, 0], "rise": xy[:, 2] - xy[:, :2].mean(axis=1)}


def sagitta(xy: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(e,) distance of the middles of edges (e, 2) from the smooth curve through the vertices.

    Positive where the middles are inside, with the body on the left of the edges. The curvature
    of an edge is that of the circles through its ends and their neighbours, the smaller one;
    none where they bend to different sides, so that corners stay corners.
    """
    along = xy[edges[:, 1]] - xy[edges[:, 0]]
    length = np.linalg.norm(along, axis=1)
    before, after = np.full(len(xy), -1), np.full(len(xy), -1)
    before[edges[:, 1]], after[edges[:, 0]] = np.arange(len(edges)), np.arange(len(edges))
    inner = (before >= 0) & (after >= 0)
    arriving, leaving = along[before], along[after]
    turning = np.arctan2(cross(arriving, leaving), (arriving * leaving).sum(axis=1))
    curvature = np.where(inner, 2 * turning / (length[before] + length[after]), np.nan)
    ends = curvature[edges]
    # at the end of the side the circle of the other end
    ends = np.where(np.isnan(ends), ends[:, ::-1], ends)
    least = np.where(ends.prod(axis=1) > 0, np.sign(ends[:, 0]) * np.abs(ends).min(axis=1), 0.0)
    return least * length**2 / 8
