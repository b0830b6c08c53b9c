"""Stage 3: the torn body's skeleton: corners, gluing rows, contact rows and their numbering.

Everything that couples subdomains lives on their boundaries, which are small compared with the
interiors: each rank gathers the boundary tables of all subdomains and derives the same numbering, so
that nothing here depends on how subdomains are distributed over ranks.

Rows of the constraint matrix B (Haslinger, Vlach, Dostal, SNA'07):

* gluing: u_c(a, i) - u_c(a, j) = 0 at every interface node a that is no corner (non-redundant, as such a
  node belongs to exactly two subdomains i < j), for every displacement component c that is not fixed;
* normal and tangential contact: n.u and t.u at every contact node, corners included, t being n turned
  by +90 degrees; between two bodies u is the mortar jump of mortar.py.

Rows are numbered by the subdomain that owns them (the lowest one that has the node).
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from . import mortar
from .errors import InputError, agree
from .loader import ContactData, Manifest, Subdomain

GLUING, NORMAL, TANGENTIAL = 0, 1, 2


@dataclass
class ClampedContact:
    """Nodes on contact edges that supports hold in both components: they carry no contact condition.

    Arrays of length n_k; `values` (n_k, 2, patterns) are the prescribed displacements.
    """

    gid: np.ndarray
    label: np.ndarray
    xy: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    values: np.ndarray


@dataclass
class ContactBoundary:
    """All contact nodes of the body, replicated on every rank; arrays of length n_c.

    Ordered by label, then along the arc. `normal_row` and `tangential_row` are global dual rows, -1 where
    a node has none (frictionless contact, or a direction that the support fixes). What meets at node i is
    the sum of value_k u(gid_k) over the terms k with node_k = i: its own displacement on a rigid obstacle,
    a mortar jump where `paired`.
    """

    gid: np.ndarray
    label: np.ndarray
    xy: np.ndarray
    arc: np.ndarray
    weight: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    friction: np.ndarray
    initial: np.ndarray  # tangential displacement at time 0
    paired: np.ndarray  # the node meets another body
    term_node: np.ndarray
    term_gid: np.ndarray
    term_value: np.ndarray
    term_other: np.ndarray  # the term belongs to the other body
    normal_row: np.ndarray
    tangential_row: np.ndarray
    clamped: ClampedContact

    @property
    def tangent(self) -> np.ndarray:
        """(n_c, 2): the normal turned by +90 degrees."""
        return np.column_stack([-self.normal[:, 1], self.normal[:, 0]])


@dataclass
class LocalRows:
    """Constraint rows that act on one subdomain: row r reads sign_r * sum_k coefficient_rk u[dof_rk].

    The width w is 2, or what the widest row between bodies needs; shorter rows end with zero coefficients.
    """

    row: np.ndarray  # (m,) global dual row
    sign: np.ndarray  # (m,) +1/-1 on gluing rows, 1 on contact rows, 0 where another subdomain owns one
    dof: np.ndarray  # (m, w)
    coefficient: np.ndarray  # (m, w), zero on fixed dofs
    fixed_part: np.ndarray  # (m, w): what was removed from `coefficient` there
    scaling: np.ndarray  # (m,) entry of B_D: sign times the stiffness weight

    def fixed_share(self, fixed: np.ndarray, values: np.ndarray, dofs: int) -> np.ndarray:
        """(m,) contribution of prescribed displacements to the rows."""
        u = np.zeros(dofs)
        u[fixed] = values
        return (self.fixed_part * u[self.dof]).sum(axis=1)


@dataclass
class RigidMode:
    """A rigid motion of one body that no support holds: u(x) = a + b (x - center) turned by +90 degrees."""

    body: int  # number of the body: connected subdomains, in the order of their first one
    members: np.ndarray  # subdomains of the body
    center: np.ndarray  # (2,)
    translation: np.ndarray  # (2,) a
    rotation: float  # b

    def displacement(self, xy: np.ndarray) -> np.ndarray:
        """(n, 2) displacements at the places xy (n, 2)."""
        away = xy - self.center
        return self.translation + self.rotation * np.column_stack([-away[:, 1], away[:, 0]])


@dataclass
class Substructure:
    """What one rank knows: its subdomains' dof sets and rows, and the global numbering."""

    subdomains: list[Subdomain]
    first: int  # index of the rank's first subdomain
    total: int
    fixed: list[np.ndarray]  # per subdomain: Dirichlet dofs, those marked by a neighbour included
    fixed_values: list[np.ndarray]  # per subdomain: (patterns, n_fixed)
    corner_dofs: list[np.ndarray]  # per subdomain: local dofs that are primal
    corner_global: list[np.ndarray]  # per subdomain: their numbers in the coarse problem
    rows: list[LocalRows]
    coarse_dofs: int
    dual_dofs: int
    row_kind: np.ndarray  # (dual_dofs,) GLUING, NORMAL or TANGENTIAL
    row_scale: np.ndarray  # (dual_dofs,) power of two near the root of the stiffness that a row sees, relative
    row_range: tuple[int, int]  # rows owned by this rank
    row_starts: np.ndarray  # per local subdomain: its first row, counted from row_range[0]
    patterns: int
    contact: ContactBoundary
    multiplicity: list[np.ndarray]  # per subdomain: (n_v,) number of subdomains that share a vertex
    rigid_modes: list[RigidMode]  # of bodies whose supports, if any, leave them free
    rigid_corners: np.ndarray  # (coarse_dofs, modes) orthonormal: the modes at the coarse dofs
    outer_edges: np.ndarray  # (n, 3): gid, gid, label of the edges of the untorn body's boundary
    primal_dofs: int


def partition(total: int, comm) -> tuple[int, int]:
    """Contiguous range of subdomains of this rank; ranks beyond the subdomains get none."""
    return total * comm.rank // comm.size, total * (comm.rank + 1) // comm.size


def build(manifest: Manifest, subdomains: list[Subdomain], first: int, comm) -> Substructure:
    """Derive corners, rows and numbering; collective over `comm`.

    Raises InputError for interfaces that do not conform and for contact labels without nodes.
    """
    tables = _Tables(manifest, subdomains, comm)
    tables.check_conformity(comm)
    tables.check_overlap(np.unique(manifest.contact_pairs))
    corners = _corner_vertices(tables)
    fixed = _fixed_dofs(manifest, subdomains, comm)
    contact = _contact_boundary(manifest, subdomains, tables, fixed, comm)
    return _number(manifest, subdomains, first, tables, corners, fixed, contact, comm)


def _gather(comm, local: np.ndarray) -> np.ndarray:
    """Concatenate the ranks' tables in rank order, which is subdomain order."""
    return np.concatenate(comm.allgather(local)) if comm.size > 1 else local


def boundary_edges(triangles: np.ndarray) -> np.ndarray:
    """(n, 2) edges that belong to one triangle only, smaller vertex first."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    span = edges.max() + 1
    keys, counts = np.unique(edges[:, 0] * span + edges[:, 1], return_counts=True)
    return np.column_stack(np.divmod(keys[counts == 1], span))


def vertex_stiffness(sub: Subdomain) -> np.ndarray:
    """(n_v,) stiffness of the subdomain at its vertices: the trace of Hooke's law in the stiffest triangle there."""
    found = np.zeros(len(sub.xy))
    np.maximum.at(found, sub.triangles, np.trace(sub.elasticity, axis1=1, axis2=2)[:, None])
    mantissa, exponent = np.frexp(found)  # means over triangles differ by rounding: nine digits make equals equal
    return np.ldexp(np.round(mantissa * 2.0**30) / 2.0**30, exponent)


class _Tables:
    """Boundary edges and vertices of all subdomains, replicated on every rank."""

    def __init__(self, manifest: Manifest, subdomains: list[Subdomain], comm):
        edges, vertices = [np.empty((0, 4), np.int64)], [np.empty((0, 2), np.int64)]
        coordinates, stiffness = [np.empty((0, 2))], [np.empty(0)]
        for sub in subdomains:
            local = boundary_edges(sub.triangles)
            gid = np.sort(sub.vertex_gid[local], axis=1)
            edges.append(np.column_stack([np.full(len(gid), sub.index), gid, _labels(sub, local)]))
            seen = np.unique(local)
            vertices.append(np.column_stack([np.full(len(seen), sub.index), sub.vertex_gid[seen]]))
            coordinates.append(sub.xy[seen])
            stiffness.append(vertex_stiffness(sub)[seen])
        self.edges = _gather(comm, np.concatenate(edges))  # subdomain, gid, gid, label
        self.vertices = _gather(comm, np.concatenate(vertices))  # subdomain, gid
        self.xy = _gather(comm, np.concatenate(coordinates))
        self.stiffness = _gather(comm, np.concatenate(stiffness))
        self.interface_label = manifest.interface_label
        key = self.edges[:, 1] * manifest.vertices + self.edges[:, 2]
        _, self.edge_id, self.edge_count = np.unique(key, return_inverse=True, return_counts=True)
        self.shared = self.edge_count[self.edge_id] == 2
        self.gids, inverse, counts = np.unique(self.vertices[:, 1], return_inverse=True, return_counts=True)
        self.vertex_id, self.count = inverse, counts

    def check_conformity(self, comm) -> None:
        """Every interface edge must have exactly two sides, with vertices at the same places."""
        lonely = (~self.shared) & (self.edges[:, 3] == self.interface_label)
        error = None
        if lonely.any() or self.edge_count.max() > 2:
            bad = self.edges[np.flatnonzero(lonely | (self.edge_count[self.edge_id] > 2))[0]]
            error = InputError(f"the meshes do not conform along an interface of subdomain {bad[0]}: an edge "
                               "has no match on the other side; export all subdomains from one mesh")
        low, high = (np.full((len(self.gids), 2), s * np.inf) for s in (1, -1))
        np.minimum.at(low, self.vertex_id, self.xy)
        np.maximum.at(high, self.vertex_id, self.xy)
        apart = np.abs(high - low).max(axis=1)
        if error is None and apart.max() > 1e-10 * np.ptp(self.xy, axis=0).max():
            at = self.xy[self.vertex_id == apart.argmax()][0]
            error = InputError(f"the meshes do not conform along an interface: a shared node near ({at[0]:g}, "
                               f"{at[1]:g}) has different coordinates in its subdomains")
        agree(comm, error)

    def check_overlap(self, paired: np.ndarray) -> None:
        """The outline must not cross itself: such a start would penetrate itself.

        Labels `paired` are spared: two bodies that fit may cross by the error of their meshes.
        """
        place = np.empty((len(self.gids), 2))
        place[self.vertex_id] = self.xy
        ends = np.searchsorted(self.gids, self.edges[~self.shared & ~np.isin(self.edges[:, 3], paired), 1:3])
        p, q = place[ends[:, 0]], place[ends[:, 1]]
        low, high = np.minimum(p, q), np.maximum(p, q)
        order = np.argsort(low[:, 0])
        last = np.searchsorted(low[order, 0], high[order, 0], side="right")  # edges that start before this one ends
        for i, (here, stop) in enumerate(zip(order, last)):
            other = order[i + 1 : stop]
            other = other[(low[other, 1] < high[here, 1]) & (high[other, 1] > low[here, 1])]
            if len(other) and _crosses(p[here], q[here], p[other], q[other]).any():
                at = (p[here] + q[here]) / 2
                raise InputError(f"the body penetrates itself: its outline crosses itself near ({at[0]:g}, {at[1]:g})")

    def neighbour(self) -> np.ndarray:
        """For every boundary edge the subdomain on its other side, or -1."""
        other = np.full(len(self.edges), -1)
        order = np.argsort(self.edge_id, kind="stable")
        order = order[self.shared[order]]
        other[order[0::2]], other[order[1::2]] = self.edges[order[1::2], 0], self.edges[order[0::2], 0]
        return other


def _crosses(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether the segment p-q has an inner point in common with the inside of each segment a-b."""
    side = lambda u, v, w: (v - u)[..., 0] * (w - u)[..., 1] - (v - u)[..., 1] * (w - u)[..., 0]
    # touching ends do not count; rounding of a side is about eps times the squared length of an edge
    slack = 1e-12 * np.maximum(((q - p) ** 2).sum(), ((b - a) ** 2).sum(axis=1))
    apart = lambda one, two: (one > slack) & (two < -slack) | (one < -slack) & (two > slack)
    return apart(side(p, q, a), side(p, q, b)) & apart(side(a, b, p), side(a, b, q))


def _labels(sub: Subdomain, edges: np.ndarray) -> np.ndarray:
    """Labels of the given boundary edges (pairs of local vertices, smaller first)."""
    span = len(sub.xy)
    given = np.sort(sub.edges, axis=1)
    keys = given[:, 0] * span + given[:, 1]
    order = np.argsort(keys)
    at = np.searchsorted(keys[order], edges[:, 0] * span + edges[:, 1])
    at = np.minimum(at, len(order) - 1)
    label = sub.edge_label[order[at]]
    return np.where(keys[order[at]] == edges[:, 0] * span + edges[:, 1], label, 0)


def _corner_vertices(tables: _Tables) -> np.ndarray:
    """Sorted gids of the primal vertices.

    A vertex of a subdomain's boundary is a corner of the subdomain when its two boundary edges differ in
    neighbour or label, and when it is shared by three or more subdomains. Interfaces that then hold less
    than two corners could act as a hinge: the farthest-point rule gives them the missing ones.
    """
    neighbour = tables.neighbour()
    kind = np.where(neighbour >= 0, neighbour, -1 - tables.edges[:, 3])
    sub = np.repeat(tables.edges[:, 0], 2)
    gid, kind = tables.edges[:, 1:3].ravel(), np.repeat(kind, 2)
    order = np.lexsort((kind, gid, sub))
    sub, gid, kind = sub[order], gid[order], kind[order]
    start = np.flatnonzero(np.r_[True, (np.diff(sub) != 0) | (np.diff(gid) != 0)])
    degree = np.diff(np.r_[start, len(gid)])
    mixed = np.minimum.reduceat(kind, start) != np.maximum.reduceat(kind, start)
    corners = np.union1d(gid[start][mixed | (degree != 2)], tables.gids[tables.count > 2])
    corners = np.union1d(corners, _farthest_points(tables, neighbour, corners))
    return np.union1d(corners, _missing_corners(tables, corners))


def _missing_corners(tables: _Tables, corners: np.ndarray) -> np.ndarray:
    """Corners for subdomains that have less than two: an undivided body with one label all round."""
    has = np.bincount(tables.vertices[np.isin(tables.vertices[:, 1], corners), 0],
                      minlength=int(tables.vertices[:, 0].max()) + 1)
    added = []
    for weak in np.flatnonzero(has < 2):
        mine = np.flatnonzero(tables.vertices[:, 0] == weak)
        first = mine[np.linalg.norm(tables.xy[mine] - tables.xy[mine[0]], axis=1).argmax()]
        second = mine[np.linalg.norm(tables.xy[mine] - tables.xy[first], axis=1).argmax()]
        added += [tables.vertices[first, 1], tables.vertices[second, 1]]
    return np.array(added, np.int64)


def _farthest_points(tables: _Tables, neighbour: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Corners for interface pieces (connected, between one pair of subdomains) with less than two."""
    one_side = neighbour > tables.edges[:, 0]
    edges = tables.edges[one_side]
    if not len(edges):
        return np.empty(0, np.int64)
    pair = edges[:, 0] * (tables.edges[:, 0].max() + 1) + neighbour[one_side]
    # a node of the interface graph is a (pair, vertex), so that pieces of different pairs stay apart; corners cut
    # the graph: a piece that leaves a corner and returns to it hangs on that one corner
    ends = edges[:, 1:3].T.ravel()
    copy = np.where(np.isin(ends, corners), 1 + np.arange(len(ends)), 0)
    nodes, inverse = np.unique(np.column_stack([np.tile(pair, 2), ends, copy]), axis=0, return_inverse=True)
    a, b = np.split(inverse, 2)
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(len(nodes),) * 2)
    pieces, piece = connected_components(graph, directed=False)
    at_corner = np.unique(np.column_stack([piece, nodes[:, 1]])[nodes[:, 2] > 0], axis=0)
    held = np.bincount(at_corner[:, 0], minlength=pieces)
    place = np.empty((len(tables.gids), 2))
    place[tables.vertex_id] = tables.xy
    added = []
    for weak in np.flatnonzero(held < 2):
        gids = nodes[piece == weak, 1]
        xy = place[np.searchsorted(tables.gids, gids)]
        known = np.flatnonzero(np.isin(gids, corners))
        first = known[0] if len(known) else np.linalg.norm(xy - xy[0], axis=1).argmax()
        second = np.linalg.norm(xy - xy[first], axis=1).argmax()
        added += [gids[first], gids[second]]
    return np.array(added, np.int64)


def _fixed_dofs(manifest: Manifest, subdomains: list[Subdomain], comm) -> tuple[np.ndarray, np.ndarray]:
    """Sorted keys 2 gid + component of all fixed dofs of the body, and their values (n, patterns).

    Gathered, because a subdomain may touch a support in a single vertex and not know that it is held.
    """
    keys, values = [np.empty(0, np.int64)], [np.empty((0, len(manifest.patterns)))]
    for sub in subdomains:
        keys.append(2 * sub.vertex_gid[sub.dof_vertex[sub.fixed]] + sub.dof_component[sub.fixed])
        values.append(sub.fixed_values.T)
    keys, at = np.unique(_gather(comm, np.concatenate(keys)), return_index=True)
    return keys, _gather(comm, np.concatenate(values))[at]


def _contact_boundary(manifest, subdomains, tables, fixed, comm) -> ContactBoundary:
    """Contact nodes of all subdomains, the parts of a node's dual segment added up."""
    found = [np.empty((0, 10))]
    for sub in subdomains:
        if sub.contact is not None:
            found.append(contact_table(sub.contact, sub.vertex_gid[sub.contact.vertex], sub.xy[sub.contact.vertex]))
    found = _gather(comm, np.concatenate(found))
    keys, at, total = add_parts(found)
    label, gid = keys.T.astype(np.int64)
    xy, weight, n = found[at, 8:10], total[:, 0].copy(), len(gid)
    normal = total[:, 1:3] / np.linalg.norm(total[:, 1:3], axis=1)[:, None]
    gap, friction, initial = (total[:, k] / weight for k in (3, 4, 5))
    missing = [wanted for wanted in manifest.contact_labels if wanted not in label]
    if missing:
        raise InputError(f"no contact node has the label {missing[0]}: the scene declares contact on a label "
                         "that its mesh lacks")
    arc = _arc_lengths(label, gid, xy, tables.edges)
    paired, terms = np.isin(label, [one for one, _ in manifest.contact_pairs]), [(np.arange(n), gid, np.ones(n), np.zeros(n, bool))]
    terms = [tuple(column[~paired] for column in terms[0])]
    sides = _PairSides(manifest, subdomains, fixed, comm)
    for one, two in manifest.contact_pairs:
        here = np.flatnonzero(label == one)
        weight[here], normal[here], more, (node, *term) = sides.couple(one, two, gid[here])
        gap[here] += more
        terms.append((here[node], *term))
    held = _held(gid, fixed)
    values = fixed[1][np.searchsorted(fixed[0], 2 * gid[held & ~paired][:, None] + [0, 1])]
    clamped = ClampedContact(gid[held & ~paired], *(of[held & ~paired] for of in (label, xy, normal, gap)), values)
    kept = np.flatnonzero(~held & (weight > 0))
    order = kept[np.lexsort((arc[kept], label[kept]))]
    position = np.full(n, -1)
    position[order] = np.arange(len(order))
    node, gids, value, other = (np.concatenate(column) for column in zip(*terms))
    node = position[node]
    none, used = np.full(len(order), -1), node >= 0
    return ContactBoundary(gid[order], label[order], xy[order], arc[order], weight[order], normal[order], gap[order],
                           friction[order], initial[order], paired[order], node[used], gids[used], value[used], other[used],
                           none, none.copy(), clamped)


class _PairSides:
    """Boundaries that meet in contact pairs, replicated on every rank."""

    def __init__(self, manifest: Manifest, subdomains: list[Subdomain], fixed, comm):
        labels, self.fixed = np.unique(manifest.contact_pairs), fixed
        found = [np.empty((0, 9))]
        for sub in subdomains if len(labels) else ():
            edges = _outward_edges(sub.triangles)
            label = _labels(sub, np.sort(edges, axis=1))
            edges, label = edges[np.isin(label, labels)], label[np.isin(label, labels)]
            a, b = sub.xy[edges[:, 0]], sub.xy[edges[:, 1]]
            found.append(np.column_stack([label, sub.vertex_gid[edges], a, b, (b - a)[:, 1], (a - b)[:, 0]]))
        self.edges = _gather(comm, np.concatenate(found))  # label, gid, gid, place, place, normal times length

    def couple(self, one: int, two: int, nodes: np.ndarray):
        """Weight (n,), normal (n, 2), gap (n,) and terms (node, gid, value, other body) of the nodes of a pair."""
        (first, gids), (second, others) = self._side(one), self._side(two)
        found = mortar.couple(first, second, _held(gids, self.fixed))
        if not found.weight.any():
            raise InputError(f"the boundaries {one} and {two} of a contact pair do not face each other, or a support "
                             f"holds all nodes of {one}: then name {two} first")
        at = np.searchsorted(gids, nodes)
        position = np.full(len(gids), -1)
        position[at] = np.arange(len(nodes))
        vertex_gid = np.where(found.side == 0, gids[np.where(found.side == 0, found.vertex, 0)],
                              others[np.where(found.side == 1, found.vertex, 0)])
        return found.weight[at], found.normal[at], found.gap[at], (position[found.node], vertex_gid, found.value, found.side == 1)

    def _side(self, label: int) -> tuple[mortar.Side, np.ndarray]:
        edges = self.edges[self.edges[:, 0] == label]
        gids, first, inverse = np.unique(edges[:, 1:3].ravel().astype(np.int64), return_index=True, return_inverse=True)
        normal = edges[:, 7:9] / np.linalg.norm(edges[:, 7:9], axis=1)[:, None]
        return mortar.Side(edges[:, 3:7].reshape(-1, 2)[first], inverse.reshape(-1, 2), normal), gids


def _outward_edges(triangles: np.ndarray) -> np.ndarray:
    """(n, 2) edges of one triangle only, in its (counterclockwise) direction: the body lies on their left."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    span = edges.max() + 1
    _, inverse, counts = np.unique(edges.min(axis=1) * span + edges.max(axis=1), return_inverse=True, return_counts=True)
    return edges[counts[inverse] == 1]


def contact_table(c: ContactData, gid: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """(n, 10) contact nodes of one piece: label, gid, weight, and normal, gap, friction, initial times weight; place."""
    part = np.column_stack([c.normal, c.gap, c.friction, c.initial]) * c.weight[:, None]
    return np.column_stack([c.label, gid, c.weight, part, xy])


def add_parts(found: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(label, gid) of the nodes of a `contact_table`, where each stands first, and the sums of columns 2 to 7."""
    keys, at, inverse = np.unique(found[:, :2], axis=0, return_index=True, return_inverse=True)
    total = np.zeros((len(keys), 6))
    np.add.at(total, inverse, found[:, 2:8])
    return keys, at, total


def _held(gid: np.ndarray, fixed) -> np.ndarray:
    """True where both displacement components of a vertex are fixed."""
    return np.isin(2 * gid, fixed[0]) & np.isin(2 * gid + 1, fixed[0])


def _arc_lengths(label, gid, xy, edges) -> np.ndarray:
    """Arc length of every contact node along its label's chain of edges; pieces follow one another.

    A piece starts at its end with the smaller x (then y), a closed piece at its node with the smallest gid.
    """
    arc = np.zeros(len(gid))
    for one in np.unique(label):
        nodes = np.flatnonzero(label == one)
        index = {g: i for i, g in zip(nodes, gid[nodes])}
        links = {i: [] for i in nodes}
        for a, b in np.unique(edges[edges[:, 3] == one, 1:3], axis=0):
            if a not in index or b not in index:
                raise InputError(f"a boundary edge of contact label {one} has an end that is no contact node; "
                                 "run the scene again")
            links[index[a]].append(index[b])
            links[index[b]].append(index[a])
        start, left = 0.0, set(nodes)
        while left:
            ends = [i for i in left if len(links[i]) == 1]
            here = min(ends, key=lambda i: (*xy[i], gid[i])) if ends else min(left, key=lambda i: gid[i])
            while here is not None:
                left.discard(here)
                arc[here] = start
                onward = [i for i in links[here] if i in left]
                if onward:
                    start += np.linalg.norm(xy[onward[0]] - xy[here])
                here = onward[0] if onward else None
    return arc


def _number(manifest, subdomains, first, tables, corners, fixed, contact, comm) -> Substructure:
    """Number coarse dofs and dual rows and express both in every local subdomain's dofs."""
    fixed_keys = fixed[0]
    owner = np.full(len(tables.gids), np.iinfo(np.int64).max)
    np.minimum.at(owner, tables.vertex_id, tables.vertices[:, 0])
    corner_keys = (2 * corners[:, None] + [0, 1]).ravel()
    corner_keys = corner_keys[~np.isin(corner_keys, fixed_keys)]
    plain = (tables.count == 2) & ~np.isin(tables.gids, corners)
    gluing = (2 * tables.gids[plain][:, None] + [0, 1]).ravel()
    gluing = gluing[~np.isin(gluing, fixed_keys)]
    frictional = manifest.effects["friction"] != "none"
    normal_rows = np.flatnonzero(_acts(contact, contact.normal, fixed_keys))
    tangential_rows = np.empty(0, np.int64)
    if frictional:  # where the support fixes the normal direction there is no contact pressure to rub under
        tangential_rows = normal_rows[_slides(contact, fixed_keys)[normal_rows]]

    # (owner, kind, position) of every row; sorting them gives the numbering
    kind = np.repeat([GLUING, NORMAL, TANGENTIAL], [len(gluing), len(normal_rows), len(tangential_rows)])
    row_gid = np.concatenate([gluing // 2, contact.gid[normal_rows], contact.gid[tangential_rows]])
    row_owner = owner[np.searchsorted(tables.gids, row_gid)]
    position = np.concatenate([gluing, normal_rows, tangential_rows])
    order = np.lexsort((position, kind, row_owner))
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    n_g, n_n = len(gluing), len(normal_rows)
    contact.normal_row[normal_rows] = number[n_g : n_g + n_n]
    contact.tangential_row[tangential_rows] = number[n_g + n_n :]

    row_scale = _row_scale(tables, row_gid[order], kind[order])
    last = first + len(subdomains)
    sorted_owner = row_owner[order]
    row_range = (int(np.searchsorted(sorted_owner, first)), int(np.searchsorted(sorted_owner, last)))
    row_starts = np.searchsorted(sorted_owner, np.arange(first, last)) - row_range[0]
    numbering = _Numbering(tables, corner_keys, fixed, gluing, number[:n_g], contact)
    local = [numbering.localize(sub) for sub in subdomains]
    parts = [list(column) for column in zip(*local)] if local else [[] for _ in range(6)]
    primal = comm.allreduce(sum(sub.dofs for sub in subdomains))
    outer = tables.edges[~tables.shared][:, 1:]
    modes, at_corners = _rigid_modes(tables, fixed_keys, corner_keys)
    return Substructure(subdomains, first, manifest.subdomains, *parts[:5], coarse_dofs=len(corner_keys),
                        dual_dofs=len(order), row_kind=kind[order], row_scale=row_scale, row_range=row_range, row_starts=row_starts,
                        patterns=len(manifest.patterns), contact=contact,
                        multiplicity=parts[5], rigid_modes=modes, rigid_corners=at_corners, outer_edges=outer, primal_dofs=primal)


def _row_scale(tables, row_gid, kind) -> np.ndarray:
    """(rows,) D with which D F D has a diagonal of like size where the stiffness jumps; ones where it does not.

    A gluing row meets the more compliant of its two sides, a contact row the stiffest of its node's subdomains.
    Powers of two, so that scaling rounds nothing; relative to the stiffest row, so that units do not matter.
    """
    low, high = np.full(len(tables.gids), np.inf), np.zeros(len(tables.gids))
    np.minimum.at(low, tables.vertex_id, tables.stiffness)
    np.maximum.at(high, tables.vertex_id, tables.stiffness)
    at = np.searchsorted(tables.gids, row_gid)
    seen = np.where(kind == GLUING, low[at], high[at])
    return 2.0 ** np.round(0.5 * np.log2(seen / seen.max(initial=0)))


def _slides(contact: ContactBoundary, fixed_keys) -> np.ndarray:
    """True for the contact nodes that can slide along the boundary while they touch.

    A node on a rigid obstacle with one component held has one displacement: where the obstacle stops it, it stands.
    Its friction would be a second force along that displacement, and only the sum of the two is determined: all of
    it is taken for contact's.
    """
    held = np.isin(2 * contact.gid, fixed_keys) | np.isin(2 * contact.gid + 1, fixed_keys)
    stands = held & ~contact.paired & _acts(contact, contact.normal, fixed_keys)
    return _acts(contact, contact.tangent, fixed_keys) & ~stands


def _acts(contact: ContactBoundary, direction: np.ndarray, fixed_keys) -> np.ndarray:
    """True for the contact nodes whose own displacement in `direction` a support leaves free.

    Between two bodies a multiplier that moves only its neighbours and the other side would nearly repeat theirs.
    """
    free = np.column_stack([~np.isin(2 * contact.gid + c, fixed_keys) for c in (0, 1)])
    return np.abs(direction * free).max(axis=1, initial=0) > 1e-12


def _lookup(keys: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of `wanted` in the sorted `keys`, and whether each is there."""
    if not len(keys):
        return np.zeros(len(wanted), np.int64), np.zeros(len(wanted), bool)
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return at, keys[at] == wanted


def _rigid_modes(tables, fixed_keys, corner_keys) -> tuple[list[RigidMode], np.ndarray]:
    """Rigid motions that the supports leave to each body, orthonormal at its coarse dofs."""
    total = int(tables.vertices[:, 0].max()) + 1
    links = coo_matrix((np.ones(len(tables.vertices)), (tables.vertices[:, 0], total + tables.vertex_id)),
                       shape=(total + len(tables.gids),) * 2)
    _, body = connected_components(links, directed=False)
    place = np.empty((len(tables.gids), 2))
    place[tables.vertex_id] = tables.xy
    modes, columns = [], []
    for number, one in enumerate(dict.fromkeys(body[:total].tolist())):  # in the order of the first subdomains
        vertices = np.flatnonzero(body[total:] == one)
        center, size = place[vertices].mean(axis=0), np.ptp(place[vertices], axis=0).max()
        keys = (2 * tables.gids[vertices][:, None] + [0, 1]).ravel()
        away = (place[vertices] - center) / size
        motions = np.stack([np.tile([1.0, 0.0], (len(away), 1)), np.tile([0.0, 1.0], (len(away), 1)),
                            np.column_stack([-away[:, 1], away[:, 0]])], axis=2).reshape(-1, 3)
        _, sizes, basis = np.linalg.svd(motions[np.isin(keys, fixed_keys)], full_matrices=True)
        rank = int((sizes > 1e-10 * max(1.0, sizes.max(initial=0.0))).sum())
        free = basis[rank:].T  # (3, modes)
        at = np.isin(keys, corner_keys)
        if not free.shape[1] or not at.any():
            continue
        _, triangle = np.linalg.qr(motions[at] @ free)
        free = free @ np.linalg.inv(triangle)
        column = np.zeros((len(corner_keys), free.shape[1]))
        column[np.searchsorted(corner_keys, keys[at])] = motions[at] @ free
        columns.append(column)
        modes += [RigidMode(number, np.flatnonzero(body[:total] == one), center, c[:2].copy(), c[2] / size) for c in free.T]
    return modes, np.hstack([np.zeros((len(corner_keys), 0)), *columns])


def _widen(array: np.ndarray, width: int) -> np.ndarray:
    """(m, width): `array` with columns of zeros added."""
    return np.pad(array, ((0, 0), (0, width - array.shape[1])))


class _Numbering:
    """Global numbers by key, and their localisation to one subdomain."""

    def __init__(self, tables, corner_keys, fixed, gluing, gluing_row, contact):
        self.tables, self.corner_keys, self.fixed, self.contact = tables, corner_keys, fixed, contact
        self.gluing, self.gluing_row = gluing, gluing_row  # sorted keys, row of each
        self._span = int(tables.vertices[:, 0].max()) + 1
        # how many lower subdomains share the vertex of each (vertex, subdomain) pair, and how many stiffer ones
        pairs = tables.vertices[:, 1] * self._span + tables.vertices[:, 0]
        order = np.argsort(pairs)
        self.pairs, self.stiffness = pairs[order], tables.stiffness[order]
        gid = self.pairs // self._span
        start = np.searchsorted(gid, gid)
        self.place = np.arange(len(gid)) - start
        self.rank = np.empty(len(gid), np.int64)
        self.rank[np.lexsort((-self.stiffness, gid))] = self.place  # stable: equal ones in their order
        self.shared_stiffness = np.add.reduceat(self.stiffness, np.unique(start))[np.unique(gid, return_inverse=True)[1]]
        self.contact_gids = np.unique(contact.term_gid)

    def localize(self, sub: Subdomain):
        """Fixed dofs and values, corner dofs and numbers, rows, multiplicities of one subdomain."""
        key = 2 * sub.vertex_gid[sub.dof_vertex] + sub.dof_component
        at, held = _lookup(self.fixed[0], key)
        held_values = self.fixed[1][at[held]].T
        number, corner = _lookup(self.corner_keys, key)
        multiplicity = np.ones(len(sub.vertex_gid), np.int64)
        at, on_boundary = _lookup(self.tables.gids, sub.vertex_gid)
        multiplicity[on_boundary] = self.tables.count[at[on_boundary]]
        rows = self._rows(sub, key, multiplicity, held)
        return np.flatnonzero(held), held_values, np.flatnonzero(corner), number[corner], rows, multiplicity

    def _rows(self, sub, key, multiplicity, held) -> LocalRows:
        at, glued = _lookup(self.gluing, key)
        dof = np.flatnonzero(glued)
        pair = self._pair(key[dof] // 2, sub.index)
        sign = np.where(self.place[pair] == 0, 1.0, -1.0)
        other = 1.0 - self.stiffness[pair] / self.shared_stiffness[pair]  # the other side's share of the stiffness
        coefficient = np.tile([1.0, 0.0], (len(dof), 1))
        pieces = [(self.gluing_row[at[dof]], sign, np.column_stack([dof, dof]), coefficient,
                   np.zeros_like(coefficient), other * sign)]
        if _lookup(self.contact_gids, sub.vertex_gid)[1].any():
            for direction, rows in ((self.contact.normal, self.contact.normal_row),
                                    (self.contact.tangent, self.contact.tangential_row)):
                pieces.append(self._contact_rows(sub, multiplicity, held, direction, rows))
                if self.contact.paired.any():
                    pieces.append(self._pair_rows(sub, held, direction, rows))
        width = max(piece[2].shape[1] for piece in pieces)
        pieces = [(row, sign, *(_widen(array, width) for array in (dof, *parts)), scaling)
                  for row, sign, dof, *parts, scaling in pieces]
        return LocalRows(*(np.concatenate(column) for column in zip(*pieces)))

    def _contact_rows(self, sub, multiplicity, held, direction, rows):
        """Rows of the nodes that meet a rigid obstacle."""
        order = np.argsort(sub.vertex_gid)
        at, inside = _lookup(sub.vertex_gid[order], self.contact.gid)
        here = np.flatnonzero(inside & (rows >= 0) & ~self.contact.paired)
        vertex = order[at[here]]
        # dofs are numbered vertex by vertex, as the loader has checked
        dof = 2 * vertex[:, None] + [0, 1]
        free = ~held[dof]
        # the product takes a shared node's row from its owner, the preconditioner halves it between the two
        # stiffest subdomains: sums of at most two terms do not depend on their order
        pair = self._pair(self.contact.gid[here], sub.index)
        sign = np.where(self.place[pair] == 0, 1.0, 0.0)
        scaling = np.where(multiplicity[vertex] == 1, 1.0, np.where(self.rank[pair] < 2, 0.5, 0.0))
        return rows[here], sign, dof, direction[here] * free, direction[here] * ~free, scaling

    def _pair(self, gid: np.ndarray, subdomain: int) -> np.ndarray:
        """Positions in `pairs` of vertices on the boundary of `subdomain`."""
        return _lookup(self.pairs, gid * self._span + subdomain)[0]

    def _pair_rows(self, sub, held, direction, rows):
        """Rows between two bodies: the terms at the vertices that this subdomain owns.

        The preconditioner knows a row by the stiffness of the side with the contact nodes alone: the other side's
        rows depend on one another where its mesh is coarser.
        """
        c, order = self.contact, np.argsort(sub.vertex_gid)
        at, inside = _lookup(sub.vertex_gid[order], c.term_gid)
        mine = np.flatnonzero(inside & c.paired[c.term_node] & (rows[c.term_node] >= 0))
        mine = mine[self.place[self._pair(c.term_gid[mine], sub.index)] == 0]
        mine = mine[np.argsort(c.term_node[mine], kind="stable")]
        here, start, count = np.unique(c.term_node[mine], return_index=True, return_counts=True)
        slot = np.arange(len(mine)) - np.repeat(start, count)  # a term's place in its row
        place = (np.repeat(np.arange(len(here)), count), slot)
        vertex, value, own = np.zeros((3, len(here), count.max(initial=1)))
        vertex[place], value[place], own[place] = order[at[mine]], c.term_value[mine], ~c.term_other[mine]
        shape = (len(here), 2 * vertex.shape[1])
        dof = (2 * vertex.astype(np.int64)[:, :, None] + [0, 1]).reshape(shape)
        coefficient = (value[:, :, None] * direction[here][:, None, :]).reshape(shape)
        free = ~held[dof]
        scaling = (own * value).sum(axis=1)  # adds up to 1 over the subdomains
        return rows[here], np.ones(len(here)), dof, coefficient * free, coefficient * ~free, scaling
