"""The contact boundary: its nodes, gaps and weights, on rigid obstacles and between two bodies.

On a rigid obstacle a node's displacement is constrained alone: the multipliers are dual to the traces of the shape
functions, and force / weight is the mean of the traction with the node's function, whose integral is the weight. With
linear and quadratic functions in 2D all weights are positive, so that bounds of tractions are bounds of forces, and the
mean of a linear traction is its value at the node (not at the ends of a boundary of linear elements). Any force at the
nodes is seen by a displacement of the same nodes, of bounded norm: the inf-sup condition (see mortar.py).
"""

from dataclasses import dataclass

import numpy as np

from . import mortar
from ..errors import InputError
from ..scene.loader import ContactData, Subdomain
from ..scene.manifest import Manifest
from ..feti.skeleton import edge_labels, gather


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
class Configuration:
    """Where contact between bodies is linearized: displacements u (k, 2) of the vertices `gid` (k,) of both sides."""

    gid: np.ndarray
    u: np.ndarray


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
    middle: np.ndarray  # the node is the middle of an edge
    term_node: np.ndarray
    term_gid: np.ndarray
    term_value: np.ndarray
    term_other: np.ndarray  # the term belongs to the other body
    normal_row: np.ndarray
    tangential_row: np.ndarray
    clamped: ClampedContact
    about: Configuration | None = None  # of pairs; None: the initial geometry

    @property
    def columns(self):
        return {"friction": self.friction, "tresca": self.friction, "initial": self.initial}

    @property
    def tangent(self) -> np.ndarray:
        """(n_c, 2): the normal turned by +90 degrees."""
        return np.column_stack([-self.normal[:, 1], self.normal[:, 0]])


def contact_boundary(manifest, subdomains, skeleton, fixed, comm, moved=None) -> ContactBoundary:
    """Contact nodes of all subdomains, the parts of a node's dual segment added up.

    `moved`, if given, holds displacements (dofs,) of the rank's subdomains: between bodies normals, facing parts and
    gaps are those of the displaced boundaries.
    """
    found = [np.empty((0, 10))]
    for sub in subdomains:
        if sub.contact is not None:
            found.append(contact_table(sub.contact, sub.node_gid[sub.contact.node], sub.xy[sub.contact.node]))
    found = gather(comm, np.concatenate(found))
    keys, at, total = add_parts(found)
    label, gid = keys.T.astype(np.int64)
    xy, weight, n = found[at, 8:10], total[:, 0].copy(), len(gid)
    normal = total[:, 1:3] / np.linalg.norm(total[:, 1:3], axis=1)[:, None]
    gap, friction, initial = (total[:, k] / weight for k in (3, 4, 5))
    missing = [wanted for wanted in manifest.contact_labels if wanted not in label]
    if missing:
        raise InputError(f"no contact node has the label {missing[0]}: the scene declares contact on a label "
                         "that its mesh lacks")
    arc = _arc_lengths(label, gid, xy, skeleton)
    paired = np.isin(label, [one for one, _ in manifest.contact_pairs])
    terms = [tuple(column[~paired] for column in (np.arange(n), gid, np.ones(n), np.zeros(n, bool)))]
    sides = _PairSides(manifest, subdomains, fixed, comm, moved)
    for one, two in manifest.contact_pairs:
        here = np.flatnonzero(label == one)
        weight[here], normal[here], more, (node, *term) = sides.couple(one, two, gid[here])
        gap[here] += more
        terms.append((here[node], *term))
    middle = np.isin(gid, skeleton.middles)
    held = held_nodes(gid, fixed)
    values = fixed[1][np.searchsorted(fixed[0], 2 * gid[held & ~paired][:, None] + [0, 1])]
    clamped = ClampedContact(gid[held & ~paired], *(of[held & ~paired] for of in (label, xy, normal, gap)), values)
    kept = np.flatnonzero(~held & (weight > 0))
    order = kept[np.lexsort((arc[kept], label[kept]))]
    position = np.full(n, -1)
    position[order] = np.arange(len(order))
    node, gids, value, other = (np.concatenate(column) for column in zip(*terms))
    node = position[node]
    none, used = np.full(len(order), -1), node >= 0
    fields = (of[order] for of in (gid, label, xy, arc, weight, normal, gap, friction, initial, paired, middle))
    terms = (of[used] for of in (node, gids, value, other))
    return ContactBoundary(*fields, *terms, none, none.copy(), clamped, sides.about)


class _PairSides:
    """Boundaries that meet in contact pairs, replicated on every rank."""

    def __init__(self, manifest: Manifest, subdomains: list[Subdomain], fixed, comm, moved=None):
        labels, self.fixed, self.about = np.unique(manifest.contact_pairs), fixed, None
        self.nodes = n = 2 if manifest.element == "P1" else 3  # of an edge
        found = [np.empty((0, 3 + 5 * n))]
        for s, sub in enumerate(subdomains if len(labels) else ()):
            edges = _outward_edges(sub.triangles)
            label = edge_labels(sub.edges, sub.edge_label, np.sort(edges, axis=1))
            edges, label = edges[np.isin(label, labels)], label[np.isin(label, labels)]
            bow, u = np.zeros((len(edges), 2)), np.zeros_like(sub.xy) if moved is None else moved[s].reshape(-1, 2)
            if n == 3:
                edges = np.column_stack([edges, sub.middles(edges)])
                bow = sub.bow[edges[:, 2]]
            found.append(np.column_stack([label, bow, sub.node_gid[edges], sub.xy[edges].reshape(-1, 2 * n),
                                          u[edges].reshape(-1, 2 * n)]))
        found = gather(comm, np.concatenate(found))
        self.label, self.bow, self.gid = found[:, 0], found[:, 1:3], found[:, 3 : 3 + n].astype(np.int64)
        self.xy, self.u = (found[:, 3 + k * n : 3 + (k + 2) * n].reshape(-1, n, 2) for k in (1, 3))
        if moved is not None:
            gids, first = np.unique(self.gid, return_index=True)
            self.about = Configuration(gids, self.u.reshape(-1, 2)[first])

    def couple(self, one: int, two: int, nodes: np.ndarray):
        """Weight (n,), normal (n, 2), gap (n,) and terms (node, gid, value, other body) of the nodes of a pair.

        About a displacement w with the normals n of the displaced boundaries the condition n . [u] <= gap has as much
        room at u = w as there is distance then: gap = distance + n . [w].
        """
        (first, gids), (second, others) = self._side(one), self._side(two)
        found = mortar.couple(first, second, held_nodes(gids, self.fixed))
        if not found.weight.any():
            raise InputError(f"the boundaries {one} and {two} of a contact pair do not face each other, or a support "
                             f"holds all nodes of {one}: then name {two} first")
        at = np.searchsorted(gids, nodes)
        position = np.full(len(gids), -1)
        position[at] = np.arange(len(nodes))
        node_gid = np.where(found.side == 0, gids[np.where(found.side == 0, found.of, 0)],
                            others[np.where(found.side == 1, found.of, 0)])
        gap = found.gap
        if self.about is not None:
            u = self.about.u[np.searchsorted(self.about.gid, node_gid)]
            gap = gap + np.bincount(found.node, found.value * (found.normal[found.node] * u).sum(axis=1), minlength=len(gap))
        terms = position[found.node], node_gid, found.value, found.side == 1
        return found.weight[at], found.normal[at], gap[at], terms

    def _side(self, label: int) -> tuple[mortar.Side, np.ndarray]:
        """The side as it lies about `about`, with the lengths of the initial geometry; gids of its nodes."""
        here = self.label == label
        gids, first, inverse = np.unique(self.gid[here], return_index=True, return_inverse=True)
        xy, u, bow = self.xy[here], self.u[here].copy(), None
        length = np.linalg.norm(xy[:, 1] - xy[:, 0], axis=1)
        rise = mortar.sagitta(xy[:, :2].reshape(-1, 2)[first], inverse.reshape(-1, 2)) if self.nodes == 2 else None
        if self.nodes == 3:  # middles stay on the straight edge between the ends
            straight = u[:, :2].mean(axis=1)
            bow, u[:, 2] = self.bow[here] + u[:, 2] - straight, straight
        xy = xy + u
        x, y = (xy[:, 1] - xy[:, 0]).T
        normal = np.column_stack([y, -x]) / np.hypot(x, y)[:, None]
        if rise is not None:
            bow = rise[:, None] * normal
        return mortar.Side(xy.reshape(-1, 2)[first], inverse.reshape(-1, self.nodes), normal, bow, length), gids


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


def held_nodes(gid: np.ndarray, fixed) -> np.ndarray:
    """True where both displacement components of a vertex are fixed."""
    return np.isin(2 * gid, fixed[0]) & np.isin(2 * gid + 1, fixed[0])


def _arc_lengths(label, gid, xy, skeleton) -> np.ndarray:
    """Arc length of every contact node along its label's chain of edges; pieces follow one another.

    A piece starts at its end with the smaller x (then y), a closed piece at its node with the smallest gid.
    """
    arc = np.zeros(len(gid))
    for one in np.unique(label):
        nodes = np.flatnonzero(label == one)
        index = {g: i for i, g in zip(nodes, gid[nodes])}
        links = {i: [] for i in nodes}
        for a, b in skeleton.links(one):
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
