"""By what stiffness rows of B are scaled, and which they count by where it jumps."""

import numpy as np

from .rows import RowKind

CROWDED = 1.2  # rows for every vertex of the other body, from which they depend on one another
SOFTER = 0.1  # share over counted below which a node is `left_alone`
MOST_ALONE = 500  # nodes that have a hat of their own for that: dense rows of the preconditioner
SLIGHT = 1e-6  # part of the largest term of a row below which it does not touch a vertex


def seen_stiffness(skeleton, row_gid, kind, share) -> np.ndarray:
    """(rows,) traces of Hooke's law that rows meet.

    A gluing row meets the more compliant of its two sides, a contact row the stiffest of its node's
    subdomains, or `share` (rows,) of that.
    """
    low, high = (skeleton.over_subdomains(extreme, skeleton.stiffness)
                 for extreme in (np.minimum, np.maximum))
    node = np.searchsorted(skeleton.gids, row_gid)
    return np.where(kind == RowKind.GLUING, low[node], high[node] * share)


def row_scale(seen: np.ndarray, stiffest: float) -> np.ndarray:
    """(rows,) D for a diagonal of D F D of like size where stiffness jumps; ones where it does not.

    `seen` (rows,) is the stiffness of the rows. Powers of two, so that scaling rounds nothing;
    relative to the `stiffest` row, so that units do not matter.
    """
    ratio = np.round(np.log2(seen / stiffest), 6)  # no rounding decides
    return 2.0 ** np.round(0.5 * ratio)


def shares(skeleton, contact) -> tuple[np.ndarray, np.ndarray]:
    """(n_c,) parts of a node's own stiffness that its rows are scaled by, and that they count by.

    On obstacles 1. Of pairs that of both sides in series, sides as stiff as one another alike,
    which is no jump. What rows count by is no less where how nodes share a force is up to the
    stiffest body among those that it passes through. Collective.
    """
    if not contact.paired.any():
        return np.ones(len(contact.gid)), np.ones(len(contact.gid))
    stiffness = skeleton.over_subdomains(np.maximum, skeleton.stiffness)
    own, met = (skeleton.at(gid, stiffness) for gid in (contact.gid, contact.term_gid))
    share = _in_series(contact, met)
    return share, np.maximum.reduce([share, _crowded(contact), _handed_on(contact, met) / own])


def left_alone(share: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """(k,) contact nodes of stiff bodies whose forces are shared by what these alone feel.

    By `share` and `counted` (n_c,) of `shares`. A soft body on the other side makes nearly all of
    the compliance of the row, and nothing of that of forces that alternate from node to node. None
    where they are more than MOST_ALONE.
    """
    alone = np.flatnonzero(share < SOFTER * counted)
    return alone if len(alone) <= MOST_ALONE else alone[:0]


def _in_series(contact, stiffness: np.ndarray) -> np.ndarray:
    """(n_c,) part that the stiffness of both sides in series is of the node's own, by (terms,)."""
    size = np.abs(contact.term_value)

    def mean(terms):
        """(n_c,) stiffness at the nodes of some terms, weighted with their sizes."""
        node, count = contact.term_node[terms], len(contact.gid)
        total = np.bincount(node, (size * stiffness)[terms], count)
        return total / np.maximum(np.bincount(node, size[terms], count), 1e-300)

    own, other = mean(~contact.term_other), mean(contact.term_other)
    met = contact.paired & (own > 0) & ~contact.idle
    return np.where(met, 2 * other / np.maximum(own + other, 1e-300), 1.0)


def _crowded(contact) -> np.ndarray:
    """(n_c,) nodes that meet so coarse a mesh that it cannot follow each of them on its own.

    More than CROWDED of them share a vertex of the other body: how they share a force is up to the
    stiffness of their own body, however soft the other one is.
    """
    other = contact.term_other
    node, size = contact.term_node[other], np.abs(contact.term_value[other])
    _, vertex = np.unique(contact.term_gid[other], return_inverse=True)
    rows = np.bincount(vertex, size)  # that a vertex of the other body has to follow
    count = len(contact.gid)
    total = np.bincount(node, size, count)
    return np.bincount(node, size * rows[vertex], count) > CROWDED * np.maximum(total, 1e-300)


def _handed_on(contact, stiffness: np.ndarray) -> np.ndarray:
    """(n_c,) the largest `stiffness` (terms,) where pairs and other contact meet at a vertex, or 0.

    So it is where two blocks that touch stand on one floor: a force can go from one to the floor
    or by the friction of both through the other one, whose stiffness alone feels a difference.
    """
    size = np.abs(contact.term_value)
    touches = size > SLIGHT * size.max(initial=0.0)
    node, gid, stiffness = (of[touches] for of in (contact.term_node, contact.term_gid, stiffness))
    vertex = np.unique(gid, return_inverse=True)[1]
    condition = np.where(contact.family > 0, contact.family, -1 - contact.label)[node]
    least, most = (np.full(vertex.max(initial=-1) + 1, start) for start in (np.inf, -np.inf))
    np.minimum.at(least, vertex, condition)
    np.maximum.at(most, vertex, condition)
    meets = ((most > least) & (most > 0))[vertex]
    of_node, found, of_vertex = *np.zeros((2, len(contact.gid))), np.zeros(len(least))
    np.maximum.at(of_node, node, stiffness)
    np.maximum.at(of_vertex, vertex, of_node[node])
    np.maximum.at(found, node[meets], of_vertex[vertex[meets]])
    return found
