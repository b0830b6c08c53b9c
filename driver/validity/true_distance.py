"""Distances and overlaps of boundaries where displacements have taken them.

Contact conditions are linear: a node's distance is that of the tangent at the place where it met
the other boundary before any load. Here the distance is measured at the displaced places. A rigid
obstacle is known by the feet of the contact nodes on it, x + gap n, and by their normals: a cubic
between neighbouring feet, beyond the ends an arc of the curvature there.
"""

import numpy as np

from ..contact.curve import CHUNK, Curve
from ..contact.nodes import TURN
from ..scene.elements import cross
from ..vectors import turned_left

PAIRS = CHUNK // 8  # of edges, of which much more is known than a distance
FOLDED = 0.5  # cosine of the turn from foot to foot below which they do not follow one another


def obstacle(foot: np.ndarray, normal: np.ndarray, joined=True, ring=False) -> Curve | None:
    """The curve through feet (k, 2) in their order; `normal` (k, 2) points to the obstacle.

    `joined` (k - 1,): whether the nodes of neighbouring feet are neighbours on the boundary. Of a
    `ring` the last foot is the first one again. None where fewer than two feet follow one another.
    """
    if len(foot) < 2:
        return None
    chord = np.diff(foot, axis=0)
    length = np.linalg.norm(chord, axis=1)
    along = chord / np.where(length > 0, length, 1.0)[:, None]
    tangent = turned_left(normal)
    sense = np.sign(np.einsum("sk,sk->s", along, tangent[:-1] + tangent[1:]).sum()) or 1.0
    tangent = sense * tangent
    cosine = np.minimum((along * tangent[:-1]).sum(axis=1), (along * tangent[1:]).sum(axis=1))
    good = (length > 1e-12 * max(length.max(), 1e-300)) & (cosine > FOLDED) & joined
    if not good.any():
        return None
    away = -sense * turned_left(along)
    if ((away * (normal[:-1] + normal[1:])).sum(axis=1)[good]).sum() > 0:
        away = -away
    steep = np.maximum(cosine, FOLDED)  # good ones are above
    rise, fall = ((of * away).sum(axis=1) / steep for of in (tangent[:-1], tangent[1:]))
    before = good & ~np.r_[ring and good[-1], good[:-1]]
    after = good & ~np.r_[good[1:], ring and good[0]]
    return Curve(*(of[good] for of in (foot[:-1], foot[1:], away, rise, fall, before, after)))


def from_obstacle(boundary, nodes: np.ndarray, place: np.ndarray):
    """Distances (k,) and normals (k, 2) at places (k, 2) from the obstacle of a chain's `nodes`.

    None and None where that is not known, see `obstacle`. A chain that is a whole outline is longer
    than its nodes are apart along it, by the way from the last one back to the first.
    """
    along = np.linalg.norm(np.diff(boundary.xy[nodes], axis=0), axis=1)
    joined = np.abs(np.diff(boundary.arc[nodes]) - along) <= 1e-6 * along
    back = np.linalg.norm(boundary.xy[nodes[0]] - boundary.xy[nodes[-1]])
    rest = boundary.length[nodes].sum() - np.ptp(boundary.arc[nodes])
    ring = bool(back > 0 and abs(rest - back) <= 1e-6 * back)
    if ring:
        nodes, joined = np.append(nodes, nodes[0]), np.append(joined, True)
    normal = boundary.normal[nodes]
    foot = boundary.xy[nodes] + boundary.gap[nodes, None] * normal
    curve = obstacle(foot, normal, joined, ring)
    return (None, None) if curve is None else curve.distance(place)


def polygon(start: np.ndarray, end: np.ndarray) -> Curve:
    """Straight edges (s, 2) with the body that they bound on their left."""
    chord = end - start
    outward = -turned_left(chord)
    outward = outward / np.linalg.norm(outward, axis=1)[:, None]
    none, no = np.zeros(len(start)), np.zeros(len(start), bool)
    return Curve(start, end, outward, none, none, no, no)


# ---- overlaps ------------------------------------------------------------------------------------

def inside(place: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n,) whether places (n, 2) lie inside the polygons of the edges, by crossings of a ray."""
    result, step = np.zeros(len(place), bool), max(1, CHUNK // max(1, len(start)))
    for low in range(0, len(place), step):
        x, y = place[low : low + step].T[:, :, None]
        spans = (start[:, 1] <= y) != (end[:, 1] <= y)
        rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
        at = start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
        result[low : low + step] = np.count_nonzero(spans & (at > x), axis=1) % 2 == 1
    return result


def nearest(place: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) distances of places (n, 2) from the edges (s, 2), and the nearest edges' numbers."""
    chord = end - start
    square = np.maximum((chord**2).sum(axis=1), 1e-300)
    distance, number = np.empty(len(place)), np.empty(len(place), int)
    step = max(1, CHUNK // len(start))
    for low in range(0, len(place), step):
        away = place[low : low + step, None] - start
        s = np.clip(np.einsum("nsk,sk->ns", away, chord) / square, 0.0, 1.0)
        size = ((away - s[..., None] * chord) ** 2).sum(axis=2)
        number[low : low + step] = size.argmin(axis=1)
        distance[low : low + step] = np.sqrt(size.min(axis=1))
    return distance, number


def crossings(start: np.ndarray, end: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(m, 2) numbers of edges (s, 2) that cross; `ends` (s, 2) numbers of their vertices.

    Edges that share a vertex do not count.
    """
    low, high = np.minimum(start, end), np.maximum(start, end)
    order, found = np.argsort(low[:, 0], kind="stable"), [np.empty((0, 2), int)]
    # in the order of their left ends an edge reaches as far as some of those that follow it
    last = np.searchsorted(low[order, 0], high[order, 0], side="right")
    after = last - np.arange(len(order)) - 1
    total, begin = np.cumsum(after), 0
    while begin < len(order):
        before = total[begin - 1] if begin else 0
        stop = max(begin + 1, int(np.searchsorted(total, before + PAIRS, side="right")))
        count = after[begin:stop]
        place = np.repeat(np.arange(begin, stop), count)
        first = np.repeat(np.cumsum(count) - count, count)
        pair = np.column_stack([order[place], order[place + 1 + np.arange(len(place)) - first]])
        found.append(pair[_cross(*pair.T, start, end, ends)])
        begin = stop
    return np.concatenate(found)


def _cross(one: np.ndarray, two: np.ndarray, start: np.ndarray, end: np.ndarray,
           ends: np.ndarray) -> np.ndarray:
    """(n,) whether edges `one` and `two` (n,) cross, by places of their ends, and share none."""
    y = start[:, 1], end[:, 1]
    low, high = np.minimum(*y), np.maximum(*y)
    result = (low[two] <= high[one]) & (high[two] >= low[one])
    near = np.flatnonzero(result)
    one, two = one[near], two[near]
    shared = (ends[one][:, :, None] == ends[two][:, None]).any(axis=(1, 2))
    chord, chords = end[one] - start[one], end[two] - start[two]
    side = [cross(chord, of[two] - start[one]) for of in (start, end)]
    back = [cross(chords, of[one] - start[two]) for of in (start, end)]
    result[near] = ~shared & (side[0] * side[1] < 0) & (back[0] * back[1] < 0)
    return result


def may_meet(edges: np.ndarray, one: int, two: int, pairs: set) -> bool:
    """Whether contact is declared between a vertex of either edge and the other edge.

    `edges` (s, 3) are ends and labels, `pairs` sets of labels that may touch. A corner of two
    labels that passes through a face takes the edges of both along.
    """
    for own, other in ((one, two), (two, one)):
        around = np.isin(edges[:, :2], edges[own, :2]).any(axis=1)
        if any(frozenset((label, edges[other, 2])) in pairs for label in edges[around, 2]):
            return True
    return False


def largest_bend(start: np.ndarray, end: np.ndarray) -> float:
    """Largest angle between edges (s, 2) that follow one another, corners apart."""
    chord = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    known = {tuple(place): k for k, place in enumerate(start)}
    after = np.array([known.get(tuple(place), -1) for place in end])
    cosine = (chord[after >= 0] * chord[after[after >= 0]]).sum(axis=1)
    return float(np.arccos(np.clip(cosine[cosine > TURN], -1.0, 1.0)).max(initial=0.0))
