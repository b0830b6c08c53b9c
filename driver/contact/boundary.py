"""The contact boundary: its nodes, gaps and weights, on rigid obstacles and between two bodies.

On a rigid obstacle a node's displacement is constrained alone: the multipliers are dual to the
traces of the shape functions, and force / weight is the mean of the traction with the node's
function, whose integral is the weight. With linear and quadratic functions in 2D all weights are
positive, so that bounds of tractions are bounds of forces, and the mean of a linear traction is its
value at the node (not at the ends of a boundary of linear elements). Any force at the nodes is seen
by a displacement of the same nodes, of bounded norm: the inf-sup condition (see mortar.py).
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..feti.gathering import gather
from ..scene.loader import ContactData


@dataclass
class ClampedContact:
    """Nodes on contact edges that supports fix in both components: without contact condition.

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
    """Displacements u (k, 2) of the vertices `gid` (k,), about which pairs are linearized."""

    gid: np.ndarray
    u: np.ndarray


@dataclass
class ContactBoundary:
    """All contact nodes of the body, replicated on every rank; arrays of length n_c.

    `columns` are what declared effects give the nodes (see ContactData), means over dual segments;
    `gap` is the distance to what the node meets: the column of that name, plus that of the two
    bodies of a pair.

    Ordered by label, then along the arc. `normal_row` and `tangential_row` are global dual rows, -1
    where a node has none (frictionless contact, or a direction that the support fixes). What meets
    at node i is the sum of value_k u(gid_k) over the terms k with node_k = i: its own displacement
    on a rigid obstacle, a mortar jump where `paired`.
    """

    gid: np.ndarray
    label: np.ndarray
    xy: np.ndarray
    arc: np.ndarray
    weight: np.ndarray
    normal: np.ndarray
    columns: dict[str, np.ndarray]
    gap: np.ndarray
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
    def tangent(self) -> np.ndarray:
        """(n_c, 2): the normal turned by +90 degrees."""
        return np.column_stack([-self.normal[:, 1], self.normal[:, 0]])


def contact_boundary(manifest, effects, subdomains, skeleton, fixed, comm,
                     sides=None) -> ContactBoundary:
    """Contact nodes of all subdomains, the parts of a node's dual segment added up.

    `effects` are those of the scene, `sides` the boundaries that meet in pairs (effects/pair.py),
    None without pairs.
    """
    parts = [np.empty((0, 7 + len(manifest.columns)))]
    for sub in subdomains:
        if sub.contact is not None:
            gid, xy = sub.node_gid[sub.contact.node], sub.xy[sub.contact.node]
            parts.append(contact_table(sub.contact, manifest.columns, gid, xy))
    table = gather(comm, np.concatenate(parts))
    keys, first, total = add_parts(table)
    label, gid = keys.T.astype(np.int64)
    xy, weight, n = table[first, -2:], total[:, 0].copy(), len(gid)
    normal = total[:, 1:3] / np.linalg.norm(total[:, 1:3], axis=1)[:, None]
    columns = {name: total[:, 3 + k] / weight for k, name in enumerate(manifest.columns)}
    gap = effects.distance(columns, n)
    missing = [wanted for wanted in manifest.contact_labels if wanted not in label]
    if missing:
        raise InputError(f"no contact node has the label {missing[0]}: the scene declares contact "
                         "on a label that its mesh lacks")
    arc = _arc_lengths(label, gid, xy, skeleton)
    paired = np.isin(label, [one for one, _ in manifest.contact_pairs])
    own = np.arange(n), gid, np.ones(n), np.zeros(n, bool)
    terms = [tuple(column[~paired] for column in own)]
    for one, two in manifest.contact_pairs:
        here = np.flatnonzero(label == one)
        weight[here], normal[here], more, (node, *term) = sides.couple(one, two, gid[here])
        gap[here] += more
        terms.append((here[node], *term))
    middle = np.isin(gid, skeleton.middles)
    held = held_nodes(gid, fixed)
    here = held & ~paired
    values = fixed[1][np.searchsorted(fixed[0], 2 * gid[here][:, None] + [0, 1])]
    clamped = ClampedContact(*(of[here] for of in (gid, label, xy, normal, gap)), values)
    active = np.flatnonzero(~held & (weight > 0))
    order = active[np.lexsort((arc[active], label[active]))]
    position = np.full(n, -1)
    position[order] = np.arange(len(order))
    node, gids, value, other = (np.concatenate(column) for column in zip(*terms))
    node = position[node]
    none, used = np.full(len(order), -1), node >= 0
    columns = {name: of[order] for name, of in columns.items()}
    fields = (*(of[order] for of in (gid, label, xy, arc, weight, normal)), columns, gap[order],
              paired[order], middle[order])
    terms = (of[used] for of in (node, gids, value, other))
    return ContactBoundary(*fields, *terms, none, none.copy(), clamped, sides and sides.about)


def contact_table(c: ContactData, columns: list[str], gid: np.ndarray,
                  xy: np.ndarray) -> np.ndarray:
    """(n, 7 + columns) contact nodes of one subdomain.

    label, gid, weight; normal and columns times weight; place.
    """
    part = np.column_stack([c.normal, *(c.columns[name] for name in columns)]) * c.weight[:, None]
    return np.column_stack([c.label, gid, c.weight, part, xy])


def add_parts(table: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(label, gid) of the nodes of a `contact_table`, their first rows, sums of what is between."""
    keys, first, inverse = np.unique(table[:, :2], axis=0, return_index=True, return_inverse=True)
    total = np.zeros((len(keys), table.shape[1] - 4))
    np.add.at(total, inverse, table[:, 2:-2])
    return keys, first, total


def held_nodes(gid: np.ndarray, fixed) -> np.ndarray:
    """True where both displacement components of a vertex are fixed."""
    return np.isin(2 * gid, fixed[0]) & np.isin(2 * gid + 1, fixed[0])


def _arc_lengths(label, gid, xy, skeleton) -> np.ndarray:
    """Arc length of every contact node along its label's chain of edges; pieces follow one another.

    A piece starts at its end with the smaller x (then y), a closed piece at its node with the
    smallest gid.
    """
    arc = np.zeros(len(gid))
    for one in np.unique(label):
        nodes = np.flatnonzero(label == one)
        index = {g: i for i, g in zip(nodes, gid[nodes])}
        links = {i: [] for i in nodes}
        for a, b in skeleton.links(one):
            if a not in index or b not in index:
                raise InputError(f"a boundary edge of contact label {one} has an end that is no "
                                 "contact node; run the scene again")
            links[index[a]].append(index[b])
            links[index[b]].append(index[a])
        start, remaining = 0.0, set(nodes)
        while remaining:
            ends = [i for i in remaining if len(links[i]) == 1]
            here = min(remaining, key=lambda i: gid[i])
            if ends:
                here = min(ends, key=lambda i: (*xy[i], gid[i]))
            while here is not None:
                remaining.discard(here)
                arc[here] = start
                onward = next((i for i in links[here] if i in remaining), None)
                if onward is not None:
                    start += np.linalg.norm(xy[onward] - xy[here])
                here = onward
    return arc
