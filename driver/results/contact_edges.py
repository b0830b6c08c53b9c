"""Where contact ends between nodes, and how long it is.

Counting nodes tells a length by the mesh size only. Near an edge of contact the opening grows like
r^(3/2) (Johnson, Contact Mechanics, 4.2 and 5.1), so that its power 2/3 is linear in the arc and
locates the edge; the node next to it, whose opening errs most, is left out if there are others.
"""

import numpy as np

from ..contact.states import OPEN

# of a chord: what the boundary between contact nodes is longer, where one in between has none; on
# smooth boundaries L^2/24 R^2 of it, in corners more
BEND = 1e-2
# columns of a ContactBoundary that places between nodes follow from
NODES = ("xy", "arc", "chain", "weight", "length", "gap", "paired", "middle", "mirrored", "onward",
         "seam")
NEXT = 3  # open nodes that locate an end of contact, the first of them once and once not
EDGE = 0.3  # of an edge in which contact ends: what is open of the place
# pressure, or wear, at an end of the boundary, or in a dip, over the next: below it contact may end
# before
FALLS = 0.6


def chains(nodes: dict) -> list[np.ndarray]:
    """Indices of the contact nodes of every connected boundary piece, in the order of arc."""
    arc, xy, chain = nodes["arc"], nodes["xy"], nodes["chain"]
    along, across = np.diff(arc), np.linalg.norm(np.diff(xy, axis=0), axis=1)
    breaks = (chain[1:] != chain[:-1]) | (np.abs(along - across) > BEND * across)
    breaks |= across < 1e-9 * across.max(initial=0.0)  # bodies side by side, one label
    return np.split(np.arange(len(arc)), np.flatnonzero(breaks) + 1)


def beyond_ends(nodes: dict, piece: np.ndarray) -> np.ndarray:
    """(2,) lengths of the edges beyond the ends of a piece, zero at an end of the boundary.

    There is such an edge where a clamped node, which carries no contact condition, follows; the
    dual segment of the last node then covers half of it, between two bodies all of it. What closes
    a ring, or leads on across a period, is shared by both ends. Between nodes of quadratic elements
    it is half an edge: a vertex has a third of it, the middle two thirds of either half. Below zero
    is what an end between two bodies faces less than its edge: that edge has straight shape
    functions, and what it faces is what both its nodes have of it.
    """
    side = np.diff(nodes["arc"][piece])
    if not len(side):
        return np.zeros(2)
    ends = piece[[0, -1]]
    weight, near = nodes.get("length", nodes["weight"])[ends], side[[0, -1]]
    beyond = np.where(nodes["paired"][ends], weight - near / 2, 2 * weight - near)
    if nodes["middle"].any():
        beyond = np.where(nodes["paired"][ends], weight - near / 3, 3 * weight - near)
        beyond = np.where(nodes["middle"][ends], near, beyond)
    if len(side) > 1:
        own = nodes.get("length", nodes["weight"])[piece]
        for k, (end, next_one, far) in enumerate(((0, 1, side[1]), (-1, -2, side[-2]))):
            if nodes["paired"][ends[k]] and not nodes["middle"][piece[[end, next_one]]].any():
                rest = far / (3 if nodes["middle"].any() else 2)
                beyond[k] = own[end] + own[next_one] - rest - near[k]
    beyond[np.abs(beyond) < 1e-6 * near] = 0.0
    beyond = np.where(nodes["paired"][ends], beyond, np.maximum(beyond, 0.0))
    across = onward(nodes, piece) >= 0
    if across.any():
        return np.where(across, nodes["seam"][ends] / 2, beyond)
    if (beyond > 0).all() and is_ring(nodes, piece):
        return np.full(2, np.linalg.norm(np.subtract(*nodes["xy"][ends])) / 2)
    return beyond


def is_ring(nodes: dict, piece: np.ndarray) -> bool:
    """Whether the last node of a piece is followed by its first, there or across a period."""
    if len(piece) < 3:
        return False
    side, closing = np.diff(nodes["arc"][piece]), np.subtract(*nodes["xy"][piece[[0, -1]]])
    return (onward(nodes, piece)[1] == piece[0]
            or float(np.linalg.norm(closing)) < 1.5 * side.max())


def onward(nodes: dict, piece: np.ndarray) -> np.ndarray:
    """(2,) nodes that follow the ends of a piece across a period, -1 where none does."""
    return nodes["onward"][piece[[0, -1]]] if "onward" in nodes else np.full(2, -1)


def part_of(nodes: dict, own: np.ndarray) -> dict:
    """The columns of some nodes, by their indices `own` (k,), in rising order."""
    columns = {name: column[own] for name, column in nodes.items()}
    place = np.searchsorted(own, columns["onward"]).clip(0, len(own) - 1)
    columns["onward"] = np.where(own[place] == columns["onward"], place, -1)
    return columns


def contact_length(nodes: dict, pieces: list[np.ndarray], steps: dict, index: int) -> float:
    """Length in contact at step `index`, of all boundaries, see `contact_lengths`."""
    return float(contact_lengths(nodes, pieces, steps, index).sum())


def contact_lengths(nodes: dict, pieces: list[np.ndarray], steps: dict, index: int) -> np.ndarray:
    """(boundaries,) lengths in contact at step `index`; edges between a closed and an open node
    count in part.

    A node that touches alone, and has no part of its edges by how they open, counts by its dual
    segment: what bears a force has a length. An edge belongs to the boundary of both its nodes, of
    which vertices between two boundaries have `shares` in both.
    """
    own = nodes.get("length", nodes["weight"])
    shares = nodes.get("shares", np.ones((1, len(own))))
    parts = [_lengths_of(nodes, piece, steps, index) for piece in pieces]
    one, other, lengths = (np.concatenate(column) for column in zip(*parts))
    both = shares[:, one] * shares[:, other]
    both = np.where(both.any(axis=0), both, shares[:, one])
    return both / both.sum(axis=0) @ lengths


def _lengths_of(nodes: dict, piece: np.ndarray, steps: dict,
                index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(k,) nodes, others, and lengths in contact of the edges between them, or of what is one's
    alone.
    """
    own, closed = nodes.get("length", nodes["weight"]), steps["status"][index][piece] != OPEN
    if len(piece) == 1:
        return piece, piece, own[piece] * closed
    inside = np.diff(nodes["arc"][piece]) * (closed[1:] & closed[:-1])
    beyond, whole = beyond_ends(nodes, piece), closed[[0, -1]] & closed[[1, -2]]  # at the ends
    for end, follows in enumerate(onward(nodes, piece)):
        if follows >= 0 and closed[-end] and steps["status"][index][follows] == OPEN:
            beyond[end] = _across(nodes, piece[::-1] if end else piece, steps, index)
    at_ends = np.where(whole, beyond, np.maximum(beyond, 0.0)) * closed[[0, -1]]
    parts = edges_of_contact(nodes, piece, steps, index)
    ends = [(0, -1, beyond[0]), (len(piece) - 1, len(piece), beyond[1])]
    few = [*zip((0, -1), (0, -1), at_ends), *parts,
           *((k, k, own[piece[k]]) for k in _pointlike(closed, parts + ends))]
    one, other, length = (np.array(column) for column in zip(*few))
    return (np.r_[piece[:-1], piece[one]], np.r_[piece[1:], piece[other]], np.r_[inside, length])


def _pointlike(closed: np.ndarray, parts: list[tuple[int, int, float]]) -> list[int]:
    """Places of closed nodes between open ones, or at an end, whose edges have no part in contact.

    `closed` (k,) of a piece, `parts` of its edges from `edges_of_contact`.
    """
    beside = np.concatenate([[False], closed, [False]])
    alone = np.flatnonzero(closed & ~beside[:-2] & ~beside[2:])
    return [k for k in alone if not sum(part for node, _, part in parts if node == k) > 0]


def edges_of_contact(nodes: dict, piece: np.ndarray, steps: dict,
                     index: int) -> list[tuple[int, int, float]]:
    """Closed node, open node (places in `piece`), length in contact of edges between such."""
    x, closed = nodes["arc"][piece], steps["status"][index][piece] != OPEN
    opening = _opening(nodes, steps, index)[piece]
    pressure = np.maximum(-steps["sigma_n"][index], 0.0)[piece]
    edges = []
    for i in np.flatnonzero(closed[1:] != closed[:-1]):
        if closed[i]:
            part = _part(x[i:], opening[i:], pressure[i::-1], x[i::-1], closed[i:])
            edges.append((i, i + 1, part))
        else:
            k = i + 1
            part = _part(-x[k::-1], opening[k::-1], pressure[k:], -x[k:], closed[k::-1])
            edges.append((k, i, part))
    return edges


def _across(nodes: dict, piece: np.ndarray, steps: dict, index: int) -> float:
    """Length in contact between the closed node that a piece begins with and the open one that
    follows it across a period.
    """
    arc, first = nodes["arc"], nodes["onward"][piece[0]]
    other = next(own for own in chains(nodes) if first in own)
    line = np.append(piece[0], other if other[0] == first else other[::-1])
    x = nodes["seam"][first] + np.abs(arc[line] - arc[first])
    x[0] = 0.0
    pressure = np.maximum(-steps["sigma_n"][index], 0.0)
    return _part(x, _opening(nodes, steps, index)[line], pressure[piece],
                 -np.abs(arc[piece] - arc[piece[0]]), steps["status"][index][line] != OPEN)


def _opening(nodes: dict, steps: dict, index: int) -> np.ndarray:
    """(n,) distances of the nodes from what they may touch, zero where they do."""
    gap = steps["gap"][index] if "gap" in steps else nodes["gap"]  # of the step: obstacles move
    return np.maximum(gap - steps["u_n"][index], 0.0)


def doubt_of_ends(nodes: dict, piece: np.ndarray, steps: dict, index: int) -> float:
    """By how much the ends of contact on a piece would lie elsewhere, located by other nodes.

    Next to the end the opening is not yet like r^(3/2): the line through the first two open nodes
    meets zero elsewhere than that through the next two, which locates the end. Where there are not
    so many the end is somewhere in a part of the edge.
    """
    x, closed = nodes["arc"][piece], steps["status"][index][piece] != OPEN
    power = _opening(nodes, steps, index)[piece] ** (2 / 3)
    total = 0.0
    for inner, outer, part in edges_of_contact(nodes, piece, steps, index):
        way = slice(inner, None) if outer > inner else slice(inner, None, -1)
        arc, apart, touching = np.abs(x[way] - x[inner]), power[way], closed[way]
        other = None
        if len(arc) > NEXT and not touching[1 : NEXT + 1].any():
            other = _zero(arc[1], arc[2], apart[1], apart[2])
        side = arc[1]
        total += EDGE * side if other is None else abs(np.clip(other, -side, 2 * side) - part)
    return float(total)


def worn_ends(nodes: dict, piece: np.ndarray, closed: np.ndarray, pressure: np.ndarray,
              worn: np.ndarray) -> float:
    """Length at the ends of a piece, closed as they are, over which contact may have ended before
    it came there by wear, from (k,) of its nodes: in contact, pressure, worn depth.

    Worn surfaces conform: pressure does not fall towards the place that contact has come to, but
    the worn depth does, to zero. A node at an end closes as soon as its half of the last edge can.
    One that is pressed more than the next does not wear, as where a support holds it.
    """
    side, early = np.diff(nodes["arc"][piece]), 0.0
    for end, near in ((0, 1), (-1, -2)):
        if (closed[end] and not nodes["mirrored"][piece[end]] and worn[end] < FALLS * worn[near]
                and pressure[end] <= pressure[near]):
            early += side[end] / 2 * (1 - worn[end] / worn[near])
    return float(early)


def _part(x, opening, pressure, inward, closed) -> float:
    """Length from the last closed node x[0] to the edge of contact, at most to the open x[1].

    `x` rises; `opening` and `closed` belong to it; `pressure` over `inward` starts at the closed
    node and goes the other way. With a single open node the pressure, which vanishes like r^(1/2),
    has to locate the edge.
    """
    side, stop = x[1] - x[0], 1
    while stop < len(x) and not closed[stop]:
        stop += 1
    if stop > 2:
        i, k = (2, 3) if stop > 3 else (1, 2)
        edge = _zero(x[i], x[k], opening[i] ** (2 / 3), opening[k] ** (2 / 3))
    elif len(pressure) > 1:
        edge = _zero(inward[0], inward[1], pressure[0] ** 2, pressure[1] ** 2)
    else:
        edge = None
    return side / 2 if edge is None else float(np.clip(edge - x[0], 0.0, side))


def _zero(x0: float, x1: float, y0: float, y1: float) -> float | None:
    """Where the line through two points vanishes on the side of the first; None if nowhere."""
    return x0 - y0 * (x1 - x0) / (y1 - y0) if y1 > y0 else None
