"""Mortar coupling of the boundaries of two bodies with dual multipliers.

One side of a contact pair carries the contact nodes. The multiplier's basis functions psi_i are
biorthogonal to the side's hat functions, int psi_i phi_j ds = delta_ij int phi_i ds, so that every
node has a condition and a bound of its own,

    n_i . jump_i <= gap_i,    jump_i = u_i - 1/w_i int psi_i (u* o pi) ds,    gap_i = 1/w_i int
    psi_i g ds,

with w_i = int phi_i ds over the part of the boundary that faces the other side, pi the projection
onto that side along the field n of averaged nodal normals, u* its displacement and g the distance
on that way. Both sides are cut at each other's vertices, so that the integrals are exact on
straight boundaries; as the psi_i add up to one, constant stress passes (patch test). On edges that
are covered in part the psi_i are dual on that part, and one of them is 1 where that is little of
the edge. On curved boundaries the gap is that of the smooth curves that bow from the edges, by
their sagitta: the polygons' own gap, as large as an element's deformation in conforming contact,
would make pressures alternate. See Wohlmuth, A mortar finite element method using dual spaces for
the Lagrange multiplier (2000); Popp, Gitterle, Gee, Wall (2010); for normals and projection Yang,
Laursen, Meng (2005).

Quadratic elements. The psi_i are dual to the quadratic shape functions (ends, then middle), whose
integrals over an edge, 1/6, 1/6 and 4/6 of it, are positive: a nodal force and the traction that it
stands for have one sign, and the bounds act node by node as before. Their span has the linear
functions (Lamichhane, Wohlmuth, Math. Comp. 76 (2007) 233-249: so it is for every degree with the
nodes of Gauss and Lobatto), so that the multiplier does not limit the order, and duality makes the
mortar projection local and bounded, which is the inf-sup condition, for any ratio of the meshes;
for contact see Hueeber, Mair, Wohlmuth, Appl. Numer. Math. 54 (2005) 555-576. Over a part of an
edge the integral of an end's function may be negative: edges covered in part have multipliers dual
to the hats, for their ends alone, and those that lack little a mean of both. The field of normals
and the projection are those of the straight edges; the gap counts how far the boundary bows from
them. Where the sides of elements are curved themselves, integrals are along their parabolas, and a
node's normal is that of int phi_i n ds: the force of a uniform pressure, whose length is the
weight.
"""

from dataclasses import dataclass

import numpy as np

from ..vectors import unit
from .facing import SLIVER, facing_parts, places, project
from .side import POINT, WEIGHT, Side

# part of an edge on which the multiplier is constant, at most; no fraction that meshes have by
# design, where rounding would decide
LITTLE = np.sqrt(2) - 1
# part of a quadratic edge that may face nothing until hats take the place of its own functions: a
# crack in the other side, as between bodies side by side, opens and closes with every displacement,
# and conditions are not to jump with it. Integrals of the functions of ends are half of themselves
# at least
CRACK = 0.1
ROUNDED = 16 * np.finfo(float).eps  # of coordinates: their own rounding, and of a few products


@dataclass
class Coupling:
    """What the contact nodes of one pair keep; n is the number of nodes of the first side.

    `weight` (n,) = w_i, zero where nothing is faced; `length` (n,) the same along the boundary, of
    plane bodies w_i; `gap` (n,), zero where it is the rounding of coordinates: bodies that touch
    have no forces of its size; `normal` (n, 2). The jump is a sum of terms: value_k times the
    displacement of node of_k of side side_k goes to row node_k.
    """

    weight: np.ndarray
    length: np.ndarray
    gap: np.ndarray
    normal: np.ndarray
    node: np.ndarray
    side: np.ndarray
    of: np.ndarray
    value: np.ndarray


def meets(first: np.ndarray, second: np.ndarray, pairs: list) -> np.ndarray:
    """(e, o) whether edges with labels `first` (e,), `second` (o,) are to meet."""
    return np.any([np.outer(first == one, second == two) for one, two in pairs], axis=0)


def reach_of(pairs: list) -> float | None:
    """How far a place's nearest partner may be: anywhere where a boundary meets several ones; None
    where it has to face one place alone.
    """
    firsts = [one for one, _ in pairs]
    return np.inf if len(set(firsts)) < len(firsts) else None


def couple(first: Side, second: Side, held: np.ndarray, able: np.ndarray | None = None,
           reach: float | None = None, corners: np.ndarray | None = None) -> Coupling:
    """Mortar coupling of two sides; SeveralPlaces if a place of the first faces several places.

    Edges meet where `able` (e, o) says so, by default all. With a `reach` the nearest place counts
    of those that are no farther away.

    A node of the first side that a support holds (`held`, (n,) bool) has no displacement to
    constrain: the next node's multiplier on the edge takes its part over, which keeps constant
    stress exact and the rows independent. So is it with nodes beyond the other side's end that have
    next to nothing of it, see `_hardly_faces`; the direction of what takes over is the mean of the
    field of normals. At `corners` ((n,) bool), where the boundary goes on in another direction, the
    condition is that of the place alone: what a multiplier has else goes to the next node's. So
    both flanks of a corner that lies in one have the same condition, however the meshes meet,
    instead of two that hardly differ.
    """
    normal = first.nodal_normals()
    e, o, start, stop = facing_parts(first, normal, second, able, reach)
    n, (dual, hats) = len(first.xy), _dual_basis(first, e, start, stop)
    whole = hats < 1
    heir = _heirs(first.edges, whole)
    gives = held[first.edges] | _hardly_faces(first.edges, e, start, stop) & ~held[heir]
    rows = np.where(gives, heir, first.edges)
    if first.same is not None:
        rows = first.in_one_place[rows]
    heirs = np.unique(rows[gives])
    weight, length, gap, direction = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((n, 2))
    along = 1.0
    if first.rise is not None:
        force, whole_length = first.uniform()
        along = (force * normal).sum(axis=1) / whole_length
    terms = []
    for point, share in zip(POINT, WEIGHT):
        xi = (start + stop) / 2 + (stop - start) / 2 * point
        eta, distance, ds = project(first, normal, second, e, o, xi)
        own, others = _shapes(first.edges.shape[1], xi), _shapes(second.edges.shape[1], eta)
        for k in range(first.edges.shape[1]):  # the multipliers of an edge
            row = rows[e, k]
            psi = sum(dual[e, k, b] * phi for b, phi in enumerate(own))
            part = share * (stop - start) * ds * psi
            if first.radius is not None:
                shape = _primal(own, k, hats[e])
                np.add.at(length, row, share * (stop - start) * ds * shape)
                part = part * first.ring(e, xi)
            np.add.at(weight, row, part)
            np.add.at(gap, row, part * distance)
            if len(heirs):
                np.add.at(direction, row, part[:, None] * places(first, normal, e, xi)[1])
            for side, edges, shapes in ((0, first.edges[e], own), (1, second.edges[o], others)):
                sign = 1.0 if side == 0 else -1.0
                sides = np.full(len(row), side)
                for corner, value in enumerate(shapes):
                    terms.append((row, sides, edges[:, corner], sign * part * value))
    for row, next_row, side, of, value, distance in (
            () if corners is None else _at_corners(corners & ~held, first, normal, second, heir,
                                                  whole, (e, o, start, stop))):
        moved = [np.where(here == row, next_row, here) for here, *_ in terms]
        terms = [(here, *rest) for here, (_, *rest) in zip(moved, terms)]
        for to, sign in ((row, 1.0), (next_row, -1.0)):
            terms.append((np.full(len(of), to), side, of, sign * weight[row] * value))
        gap[next_row] += gap[row] - weight[row] * distance
        gap[row] = weight[row] * distance
    if first.radius is None:
        length = weight
    heirs = heirs[weight[heirs] > 0]
    normal[heirs] = unit(direction[heirs])
    used = (length > SLIVER * length.max(initial=0.0)) & (weight > 0) & ~held
    node, side, of, value = (np.concatenate([t[k] for t in terms]) for k in range(4))
    gap = np.divide(gap, weight, out=np.zeros(n), where=used)
    gap[np.abs(gap) <= ROUNDED * max(np.abs(side.xy).max() for side in (first, second))] = 0.0
    return Coupling(np.where(used, weight * along, 0.0), np.where(used, length, 0.0), gap, normal,
                    *_merge(node, side, of, value, weight, used))


def _at_corners(corner: np.ndarray, first: Side, normal: np.ndarray, second: Side,
                heir: np.ndarray, whole: np.ndarray, parts):
    """Conditions at corners that face the other side: (node, next node, sides, nodes, values, gap).

    None where the next node is a corner, too.
    """
    e, o, start, stop = parts
    for end, there in ((0, start < SLIVER), (1, stop > 1.0 - SLIVER)):
        row = first.edges[e, end]
        for k in np.flatnonzero(there & corner[row] & whole[e] & ~corner[heir[e, end]]):
            xi = np.array([float(end)])
            eta, distance, _ = project(first, normal, second, e[[k]], o[[k]], xi)
            values = np.array([1.0, *(-shape[0] for shape in _shapes(second.edges.shape[1], eta))])
            nodes = np.array([row[k], *second.edges[o[k]]])
            sides = np.array([0] + [1] * (len(nodes) - 1))
            yield row[k], heir[e[k], end], sides, nodes, values, distance[0]


def met_at_nodes(first: Side, second: Side, able: np.ndarray | None = None,
                 reach: float | None = None) -> tuple[np.ndarray, ...]:
    """What the places of the first side's nodes meet: (node, node of the second side, value,
    distance along the normal).

    Values of the shape functions of the second side's edge there; none of nodes that face nothing.
    """
    normal = first.nodal_normals()
    e, o, start, stop = facing_parts(first, normal, second, able, reach)
    found = [(np.empty(0, int), np.empty(0, int), np.empty(0), np.empty(0))]
    for k, place in enumerate((0.0, 1.0, 0.5)[: first.edges.shape[1]]):
        here = (start - SLIVER <= place) & (place <= stop + SLIVER)
        eta, distance, _ = project(first, normal, second, e[here], o[here],
                                   np.full(here.sum(), place))
        for corner, value in enumerate(_shapes(second.edges.shape[1], eta)):
            found.append((first.edges[e[here], k], second.edges[o[here], corner], value, distance))
    return tuple(np.concatenate(column) for column in zip(*found))


def _shapes(nodes: int, xi: np.ndarray) -> tuple[np.ndarray, ...]:
    """Shape functions of an edge with 2 or 3 nodes at the places xi (m,), each (m,)."""
    if nodes == 2:
        return 1.0 - xi, xi
    return (1.0 - xi) * (1.0 - 2.0 * xi), xi * (2.0 * xi - 1.0), 4.0 * xi * (1.0 - xi)


def _primal(own: tuple[np.ndarray, ...], k: int, hats: np.ndarray) -> np.ndarray:
    """(m,) the function of which multiplier k of an edge has the length, by shape functions `own`.

    The edge's own, and to the part `hats` (m,) the hat of an end.
    """
    if len(own) == 2:
        return own[k]
    hat = own[k] + own[2] / 2 if k < 2 else np.zeros(len(hats))
    return (1.0 - hats) * own[k] + hats * hat


def _heirs(edges: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """(e, nodes) that take a constrained node's part: the middle, or the other end without one."""
    if edges.shape[1] == 2:
        return edges[:, ::-1]
    return np.where(whole[:, None], edges[:, [2, 2, 2]], edges[:, [1, 0, 2]])


def _hardly_faces(edges: np.ndarray, e, start, stop) -> np.ndarray:
    """(e, nodes) ends of edges that face the other side on a part at the far end alone, if their
    nodes face it nowhere else.

    Where the other side ends just before a node the node's hat is next to nothing on what is faced.
    A condition of its own would hardly differ from the next node's, and take pressures of any size:
    on so LITTLE of an edge the multiplier is constant.
    """
    covered = np.bincount(e, stop - start, minlength=len(edges))
    begins, ends = np.ones(len(edges)), np.zeros(len(edges))
    np.minimum.at(begins, e, start)
    np.maximum.at(ends, e, stop)
    at_first, at_last = begins < SLIVER, ends > 1.0 - SLIVER
    part = (covered > 0) & (covered < LITTLE)
    hardly = np.zeros(edges.shape, bool)
    hardly[:, 0], hardly[:, 1] = part & at_last & ~at_first, part & at_first & ~at_last
    faces = np.zeros(edges.max() + 1, bool)
    faces[edges[(covered > 0)[:, None] & ~hardly]] = True
    return hardly & ~faces[edges]


def _dual_basis(side: Side, e: np.ndarray, start: np.ndarray, stop: np.ndarray):
    """(edges, nodes, nodes) dual basis by shape functions, psi_a = sum_b A_ab phi_b.

    A = D M^-1 with D_aa = int phi_a, M_ab = int phi_a phi_b over the covered part of the edge. Also
    the part (edges,) that hats, those of the ends and half that of the middle, have in A in place
    of phi: all of it on quadratic edges that are covered in part, but for a CRACK, or begin on the
    axis of a body of revolution.
    """
    edges, nodes = side.edges.shape
    covered = np.bincount(e, stop - start, minlength=edges)
    hats = np.clip((1.0 - covered - SLIVER) / (CRACK - SLIVER), 0.0, 1.0)
    hats[side.begins_on_axis] = 1.0
    linear = _duals(2, side, e, start, stop)
    if nodes == 2:
        return linear, hats
    A, own = np.zeros((edges, nodes, nodes)), hats < 1
    A[own] = (1.0 - hats[own])[:, None, None] * _duals(3, side, e, start, stop)[own]
    A[:, :2] += hats[:, None, None] * (linear @ np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]))
    return A, hats


def _duals(nodes: int, side: Side, e, start, stop) -> np.ndarray:
    """(edges, nodes, nodes) D M^-1 where an edge is covered."""
    edges = len(side.edges)
    D, M = np.zeros((edges, nodes)), np.zeros((edges, nodes, nodes))
    for point, share in zip(POINT, WEIGHT):
        xi = (start + stop) / 2 + (stop - start) / 2 * point
        phi = np.column_stack(_shapes(nodes, xi))
        part = share * (stop - start) * side.ring(e, xi) * side.stretch(e, xi)
        np.add.at(D, e, part[:, None] * phi)
        np.add.at(M, e, part[:, None, None] * phi[:, :, None] * phi[:, None, :])
    covered = np.bincount(e, minlength=edges) > 0
    A = np.zeros_like(M)
    A[covered] = D[covered][:, :, None] * np.linalg.inv(M[covered])
    return A


def _merge(node, side, of, value, weight, used):
    """Terms with equal row and node added up and divided by the row's weight."""
    keys, inverse = np.unique(np.column_stack([node, side, of]), axis=0, return_inverse=True)
    total = np.bincount(inverse, value, minlength=len(keys))
    node, side, of = keys.T
    # the dual basis leaves rounding at the neighbours
    keep = used[node] & (np.abs(total) > 1e-12 * weight[node])
    return node[keep], side[keep], of[keep], total[keep] / weight[node[keep]]
