"""Which parts of two boundaries face one another, along the normals of the first.

Both sides are cut at each other's vertices. A place of the first side faces the nearest edge of the
second that its normal meets from outside; one that has penetrated is behind it.
"""

from dataclasses import dataclass

import numpy as np

from ..scene.elements import cross
from .shared_labels import SeveralPlaces
from .side import Side

FACING = -0.2  # cosine between the normals of facing edges, at most
ROUNDED = 1e-9  # part of the largest distance by which places may be on the other side
AT_ONCE = 2**21  # pairs of edge and vertex that are looked at together: memory
SLIVER = 1e-6  # parts of an edge shorter than this, relative to the edge, do not count


@dataclass
class Segments:
    """Parts of the first side that each face one edge of the second; arrays of length m.

    Part k goes from `at[k, 0]` to `at[k, 1]` (coordinates in [0, 1]) on edge `edge[k]` of the first
    side, and so do the places `facing[k]` on edge `other[k]` of the second side that its ends are
    projected to. Parts of an edge follow one another.
    """

    edge: np.ndarray
    other: np.ndarray
    at: np.ndarray
    facing: np.ndarray


def segments(first: Side, second: Side, able: np.ndarray | None = None,
             reach: float | None = None) -> Segments:
    """The parts that `couple` integrates over; ends that only rounding separates are merged."""
    normal = first.nodal_normals()
    e, o, start, stop = facing_parts(first, normal, second, able, reach)
    near = 2 * SLIVER
    follows = np.r_[False, (e[1:] == e[:-1]) & (np.abs(start[1:] - stop[:-1]) < near)]
    start = np.where(start < near, 0.0, start)
    stop = np.where(stop > 1.0 - near, 1.0, stop)
    start[1:] = np.where(follows[1:], stop[:-1], start[1:])
    facing = [project(first, normal, second, e, o, xi)[0] for xi in (start, stop)]
    return Segments(e, o, np.column_stack([start, stop]), np.column_stack(facing))


def facing_parts(first: Side, normal: np.ndarray, second: Side, able: np.ndarray | None,
                 reach: float | None = None):
    """Pairs of facing edges and the interval [start, stop] of the first edge that they share."""
    e, o = _candidates(first, normal, second, able)
    ends = [_foot(first, normal, e, second.xy[second.edges[o, k]]) for k in (0, 1)]
    start, stop = np.clip(np.minimum(*ends), 0.0, 1.0), np.clip(np.maximum(*ends), 0.0, 1.0)
    keep = stop - start > SLIVER
    e, o, start, stop = e[keep], o[keep], start[keep], stop[keep]
    for rule in (_meets, _from_outside):
        keep = rule(first, normal, second, e, o, (start + stop) / 2)
        e, o, start, stop = e[keep], o[keep], start[keep], stop[keep]
    if reach is not None:
        e, o, start, stop = _nearest_parts(first, normal, second, e, o, start, stop, reach)
    covered = np.bincount(e, stop - start, minlength=len(first.edges))
    if covered.max(initial=0.0) > 1.0 + 1e-6:
        place = first.xy[first.edges[covered.argmax()]].mean(axis=0)
        raise SeveralPlaces(
            f"contact pair: the boundary near ({place[0]:g}, {place[1]:g}) faces several places of "
            "the other side; give parts that meet different places labels and pairs of their own")
    order = np.lexsort((start, e))
    return e[order], o[order], start[order], stop[order]


def _candidates(first: Side, normal: np.ndarray, second: Side,
                able: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the first side and such of the second that may face them: turned to one another, and
    not on one side of the normals at both ends, between which all others of the edge lie.
    """
    a, b = first.edges[:, :2].T
    c, d = second.edges[:, :2].T
    across = np.column_stack([normal[:, 1], -normal[:, 0]])
    from_origin = (first.xy * across).sum(axis=1)
    found = [(np.empty(0, int), np.empty(0, int))]
    step = max(1, AT_ONCE // max(1, len(second.xy)))
    for start in range(0, len(a), step):
        block = slice(start, start + step)
        facing = first.edge_normal[block] @ second.edge_normal.T < FACING
        if able is not None:
            facing &= able[block]
        for sign in (1.0, -1.0):
            beside = np.ones((len(facing), len(second.xy)), bool)
            for end in (a[block], b[block]):
                way = across[end] @ second.xy.T - from_origin[end, None]
                beside &= sign * way > ROUNDED * np.abs(way).max(initial=0.0)
            facing &= ~(beside[:, c] & beside[:, d])
        e, o = np.nonzero(facing)
        found.append((e + start, o))
    return tuple(np.concatenate(column) for column in zip(*found))


def _nearest_parts(first: Side, normal: np.ndarray, second: Side, e, o, start, stop,
                   reach: float):
    """The same without what is farther away than `reach`, and behind what is nearer."""
    _, distance, _ = project(first, normal, second, e, o, (start + stop) / 2)
    near = np.abs(distance) <= reach
    e, o, start, stop = e[near], o[near], start[near], stop[near]
    order = np.lexsort((start, e))
    e, o, start, stop = e[order], o[order], start[order], stop[order]
    last = np.maximum.accumulate(stop + 2.0 * e) - 2.0 * e  # end of the parts so far of an edge
    doubled = np.unique(e[1:][(e[1:] == e[:-1]) & (start[1:] < last[:-1] - SLIVER)])
    plain = ~np.isin(e, doubled)
    parts = [(e[plain], o[plain], start[plain], stop[plain])]
    for edge in doubled:
        here = np.flatnonzero(e == edge)
        cuts = np.unique(np.concatenate([start[here], stop[here]]))
        for low, high in zip(cuts[:-1], cuts[1:]):
            over = here[(start[here] <= low) & (stop[here] >= high)]
            if high - low <= SLIVER or not len(over):
                continue
            place = np.full(len(over), (low + high) / 2)
            _, away, _ = project(first, normal, second, e[over], o[over], place)
            nearest = over[np.abs(away).argmin()]
            parts.append(([edge], [o[nearest]], [low], [high]))
    return tuple(np.concatenate(column) for column in zip(*parts))


def places(side: Side, normal: np.ndarray, e: np.ndarray,
           xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, 2) places at xi (m,) on edges e (m,), and normals there, between those of the nodes."""
    a, b = side.edges[e, :2].T
    return (side.xy[a] + xi[:, None] * (side.xy[b] - side.xy[a]),
            normal[a] + xi[:, None] * (normal[b] - normal[a]))


def _meets(first: Side, normal: np.ndarray, second: Side, e: np.ndarray, o: np.ndarray,
           xi: np.ndarray) -> np.ndarray:
    """Whether the normal from xi on edge e meets edge o.

    Near the focus of the normals feet of the ends of o may lie on both sides of xi although o is
    elsewhere.
    """
    x, n = places(first, normal, e, xi)
    c, d = second.xy[second.edges[o, 0]], second.xy[second.edges[o, 1]]
    return np.abs(cross(x - c, n) / cross(d - c, n) - 0.5) < 0.5 + 1e-6


def _from_outside(first: Side, normal: np.ndarray, second: Side, e: np.ndarray, o: np.ndarray,
                  xi: np.ndarray) -> np.ndarray:
    """Whether the normal from xi on edge e meets edge o from outside, and no boundary lies on the
    way back to one that is behind.

    A place that has penetrated comes out of the other body where its normal, followed back, first
    meets a boundary. If that is its own body's other side, or a side by which the other body is
    entered, the place is not in that body at all: as the back of a clip's lip, which sees the far
    side of the shaft through the lip. What is behind by less than half of the edge is not asked.
    """
    place, n = places(first, normal, e, xi)
    n = n / np.linalg.norm(n, axis=1)[:, None]
    behind = -_along(place, n, *second.xy[second.edges[o, :2]].transpose(1, 0, 2))
    found = (n * second.edge_normal[o]).sum(axis=1) < 0
    ends = np.concatenate([side.xy[side.edges[:, :2]] for side in (first, second)])
    for k in np.flatnonzero(behind > first.length[e] / 2):
        away = -_along(place[k], n[k], *ends.transpose(1, 0, 2)) / behind[k]
        found[k] &= not ((away > SLIVER) & (away < 1.0 - SLIVER)).any()
    return found


def _along(place: np.ndarray, n: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(m,) way along n (m, 2) from places (m, 2) to the edges from c to d (m, 2), NaN beside them.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        eta = cross(place - c, n) / cross(d - c, n)
    eta = np.where(np.abs(eta - 0.5) <= 0.5 + SLIVER, eta, np.nan)
    return ((c + eta[:, None] * (d - c) - place) * n).sum(axis=1)


def _foot(first: Side, normal: np.ndarray, e: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Coordinate xi on edge e with `point` on its normal: (point - x(xi)) x n(xi) = 0."""
    a, b = first.edges[e, :2].T
    r, t = point - first.xy[a], first.xy[b] - first.xy[a]
    n, change = normal[a], normal[b] - normal[a]
    xi = cross(r, n) / cross(t, n)
    for _ in range(8):  # Newton on the quadratic equation; straight boundaries need no step
        value = cross(r - xi[:, None] * t, n + xi[:, None] * change)
        slope = -cross(t, n + xi[:, None] * change) + cross(r - xi[:, None] * t, change)
        step = np.divide(value, slope, out=np.zeros_like(value), where=slope != 0)
        xi = xi - step
    return np.where(np.isfinite(xi), xi, -1.0)


def project(first: Side, normal: np.ndarray, second: Side, e, o, xi):
    """Coordinate eta on edge o, distance along the normal, and ds/dxi, seen from xi on edge e."""
    x, n = places(first, normal, e, xi)
    n = n / np.linalg.norm(n, axis=1)[:, None]
    c, d = second.xy[second.edges[o, 0]], second.xy[second.edges[o, 1]]
    eta = np.clip(cross(x - c, n) / cross(d - c, n), 0.0, 1.0)
    distance = ((c + eta[:, None] * (d - c) - x) * n).sum(axis=1)
    for side, edge, place, sign in ((first, e, xi, -1.0), (second, o, eta, 1.0)):
        if side.bow is not None:
            distance += sign * 4.0 * place * (1.0 - place) * (side.bow[edge] * n).sum(axis=1)
    return eta, distance, first.length[e] * first.stretch(e, xi)
