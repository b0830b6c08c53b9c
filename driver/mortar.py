"""Stage 3, between bodies: mortar coupling of two boundaries with dual multipliers.

One side of a contact pair carries the contact nodes. The multiplier's basis functions psi_i are biorthogonal to
the side's hat functions, int psi_i phi_j ds = delta_ij int phi_i ds, so that every node has a condition and a
bound of its own,

    n_i . jump_i <= gap_i,    jump_i = u_i - 1/w_i int psi_i (u* o pi) ds,    gap_i = 1/w_i int psi_i g ds,

with w_i = int phi_i ds over the part of the boundary that faces the other side, pi the projection onto that side
along the field n of averaged nodal normals, u* its displacement and g the distance on that way. Both sides are cut
at each other's vertices, so that the integrals are exact on straight boundaries; as the psi_i add up to one,
constant stress passes (patch test). On edges that are covered in part the psi_i are dual on that part. See
Wohlmuth, A mortar finite element method using dual spaces for the Lagrange multiplier (2000); Popp, Gitterle,
Gee, Wall (2010); for normals and projection Yang, Laursen, Meng (2005).
"""

from dataclasses import dataclass

import numpy as np

from .errors import InputError

POINT = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])  # Gauss, exact to degree 5 on [-1, 1]
WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0  # of an interval of length 1
FACING = -0.2  # cosine between the normals of facing edges, at most
SLIVER = 1e-6  # parts of an edge shorter than this, relative to the edge, do not count


@dataclass
class Side:
    """One side of a pair: vertices with place (n, 2), and edges (e, 2) with the unit outward normal of each."""

    xy: np.ndarray
    edges: np.ndarray
    edge_normal: np.ndarray

    def nodal_normals(self) -> np.ndarray:
        """(n, 2) unit averages of the normals of a vertex's edges, weighted with their lengths."""
        length = np.linalg.norm(self.xy[self.edges[:, 1]] - self.xy[self.edges[:, 0]], axis=1)
        total = np.zeros_like(self.xy)
        np.add.at(total, self.edges.ravel(), np.repeat(self.edge_normal * length[:, None], 2, axis=0))
        return total / np.linalg.norm(total, axis=1)[:, None]


@dataclass
class Coupling:
    """What the contact nodes of one pair keep; n is the number of vertices of the first side.

    `weight` (n,) = w_i, zero where nothing is faced; `gap` (n,); `normal` (n, 2). The jump is a sum of terms:
    value_k times the displacement of vertex vertex_k of side side_k goes to row node_k.
    """

    weight: np.ndarray
    gap: np.ndarray
    normal: np.ndarray
    node: np.ndarray
    side: np.ndarray
    vertex: np.ndarray
    value: np.ndarray


def couple(first: Side, second: Side, held: np.ndarray) -> Coupling:
    """Mortar coupling of two sides. Raises InputError if a place of the first faces several of the second.

    A vertex of the first side that a support holds (`held`, (n,) bool) has no displacement to constrain: the next
    vertex's multiplier takes its part over, which keeps constant stress exact and the rows independent.
    """
    normal = first.nodal_normals()
    e, o, start, stop = _facing_parts(first, normal, second)
    n, dual = len(first.xy), _dual_basis(len(first.edges), e, start, stop)
    weight, gap = np.zeros(n), np.zeros(n)
    terms = []
    for point, share in zip(POINT, WEIGHT):
        xi = (start + stop) / 2 + (stop - start) / 2 * point
        eta, distance, ds = _project(first, normal, second, e, o, xi)
        for end in (0, 1):  # the two multipliers of an edge
            row = np.where(held[first.edges[e, end]], first.edges[e, 1 - end], first.edges[e, end])
            part = share * (stop - start) * ds * (dual[e, end, 0] * (1.0 - xi) + dual[e, end, 1] * xi)
            np.add.at(weight, row, part)
            np.add.at(gap, row, part * distance)
            for side, edges, shape in ((0, first.edges[e], xi), (1, second.edges[o], eta)):
                sign = 1.0 if side == 0 else -1.0
                for corner, value in enumerate((1.0 - shape, shape)):
                    terms.append((row, np.full(len(row), side), edges[:, corner], sign * part * value))
    used = (weight > SLIVER * weight.max(initial=0.0)) & ~held
    node, side, vertex, value = (np.concatenate([t[k] for t in terms]) for k in range(4))
    return Coupling(np.where(used, weight, 0.0), np.divide(gap, weight, out=np.zeros(n), where=used), normal,
                    *_merge(node, side, vertex, value, weight, used))


def _dual_basis(edges: int, e: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """(edges, 2, 2) dual basis of every edge in terms of its hat functions: psi_a = sum_b A_ab phi_b.

    A = D M^-1 with D_aa = int phi_a, M_ab = int phi_a phi_b over the covered part of the edge.
    """
    D, M = np.zeros((edges, 2)), np.zeros((edges, 2, 2))
    for point, share in zip(POINT, WEIGHT):
        xi = (start + stop) / 2 + (stop - start) / 2 * point
        phi = np.column_stack([1.0 - xi, xi])
        part = share * (stop - start)
        np.add.at(D, e, part[:, None] * phi)
        np.add.at(M, e, part[:, None, None] * phi[:, :, None] * phi[:, None, :])
    covered = D.sum(axis=1) > 0
    A = np.zeros_like(M)
    A[covered] = D[covered][:, :, None] * np.linalg.inv(M[covered])
    return A


def _merge(node, side, vertex, value, weight, used):
    """Terms with equal row and vertex added up and divided by the row's weight."""
    keys, inverse = np.unique(np.column_stack([node, side, vertex]), axis=0, return_inverse=True)
    total = np.bincount(inverse, value, minlength=len(keys))
    node, side, vertex = keys.T
    keep = used[node] & (np.abs(total) > 1e-12 * weight[node])  # the dual basis leaves rounding at the neighbours
    return node[keep], side[keep], vertex[keep], total[keep] / weight[node[keep]]


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@dataclass
class Segments:
    """Parts of the first side that each face one edge of the second; arrays of length m.

    Part k goes from `at[k, 0]` to `at[k, 1]` (coordinates in [0, 1]) on edge `edge[k]` of the first side, and so
    do the places `facing[k]` on edge `other[k]` of the second side that its ends are projected to. Parts of an edge
    follow one another.
    """

    edge: np.ndarray
    other: np.ndarray
    at: np.ndarray
    facing: np.ndarray


def segments(first: Side, second: Side) -> Segments:
    """The parts that `couple` integrates over; ends that only rounding and slivers keep apart are made one."""
    normal = first.nodal_normals()
    e, o, start, stop = _facing_parts(first, normal, second)
    near = 2 * SLIVER
    follows = np.r_[False, (e[1:] == e[:-1]) & (np.abs(start[1:] - stop[:-1]) < near)]
    start = np.where(start < near, 0.0, start)
    stop = np.where(stop > 1.0 - near, 1.0, stop)
    start[1:] = np.where(follows[1:], stop[:-1], start[1:])
    facing = [_project(first, normal, second, e, o, xi)[0] for xi in (start, stop)]
    return Segments(e, o, np.column_stack([start, stop]), np.column_stack(facing))


def _facing_parts(first: Side, normal: np.ndarray, second: Side):
    """Pairs of facing edges and the interval [start, stop] of the first edge that each pair shares."""
    e, o = np.nonzero(first.edge_normal @ second.edge_normal.T < FACING)
    ends = [_foot(first, normal, e, second.xy[second.edges[o, k]]) for k in (0, 1)]
    start, stop = np.clip(np.minimum(*ends), 0.0, 1.0), np.clip(np.maximum(*ends), 0.0, 1.0)
    keep = stop - start > SLIVER
    e, o, start, stop = e[keep], o[keep], start[keep], stop[keep]
    covered = np.bincount(e, stop - start, minlength=len(first.edges))
    if covered.max(initial=0.0) > 1.0 + 1e-6:
        at = first.xy[first.edges[covered.argmax()]].mean(axis=0)
        raise InputError(f"contact pair: the boundary near ({at[0]:g}, {at[1]:g}) faces several places of the other "
                         "side; label only the parts that can meet")
    order = np.lexsort((start, e))
    return e[order], o[order], start[order], stop[order]


def _foot(first: Side, normal: np.ndarray, e: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Coordinate xi on edge e from which the field of normals meets `point`: (point - x(xi)) x n(xi) = 0."""
    a, b = first.edges[e].T
    r, t = point - first.xy[a], first.xy[b] - first.xy[a]
    n, change = normal[a], normal[b] - normal[a]
    xi = _cross(r, n) / _cross(t, n)
    for _ in range(8):  # Newton on the quadratic equation; straight boundaries need no step
        value = _cross(r - xi[:, None] * t, n + xi[:, None] * change)
        slope = -_cross(t, n + xi[:, None] * change) + _cross(r - xi[:, None] * t, change)
        step = np.divide(value, slope, out=np.zeros_like(value), where=slope != 0)
        xi = xi - step
    return np.where(np.isfinite(xi), xi, -1.0)


def _project(first: Side, normal: np.ndarray, second: Side, e, o, xi):
    """Coordinate eta on edge o, distance along the normal, and ds/dxi, seen from xi on edge e."""
    a, b = first.edges[e].T
    t = first.xy[b] - first.xy[a]
    x = first.xy[a] + xi[:, None] * t
    n = normal[a] + xi[:, None] * (normal[b] - normal[a])
    n = n / np.linalg.norm(n, axis=1)[:, None]
    c, d = second.xy[second.edges[o, 0]], second.xy[second.edges[o, 1]]
    eta = np.clip(_cross(x - c, n) / _cross(d - c, n), 0.0, 1.0)
    distance = ((c + eta[:, None] * (d - c) - x) * n).sum(axis=1)
    return eta, distance, np.linalg.norm(t, axis=1)
