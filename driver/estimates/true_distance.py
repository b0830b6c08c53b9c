"""Distances and overlaps of boundaries where displacements have taken them.

Contact conditions are linear: a node's distance is that of the tangent at the place where it met
the other boundary before any load. Here the distance is measured at the displaced places. A rigid
obstacle is known by the feet of the contact nodes on it, x + gap n, and by their normals: a cubic
between neighbouring feet, beyond the ends an arc of the curvature there.
"""

import numpy as np

from ..contact.curve import CHUNK, Curve
from ..scene.elements import cross

FOLDED = 0.5  # cosine of the turn from foot to foot below which they do not follow one another


def obstacle(foot: np.ndarray, normal: np.ndarray, joined=True) -> Curve | None:
    """The curve through feet (k, 2) in their order; `normal` (k, 2) points to the obstacle.

    `joined` (k - 1,): whether the nodes of neighbouring feet are neighbours on the boundary. None
    where fewer than two feet follow one another.
    """
    if len(foot) < 2:
        return None
    chord = np.diff(foot, axis=0)
    length = np.linalg.norm(chord, axis=1)
    along = chord / np.where(length > 0, length, 1.0)[:, None]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    sense = np.sign(np.einsum("sk,sk->s", along, tangent[:-1] + tangent[1:]).sum()) or 1.0
    tangent = sense * tangent
    cosine = np.minimum((along * tangent[:-1]).sum(axis=1), (along * tangent[1:]).sum(axis=1))
    good = (length > 1e-12 * max(length.max(), 1e-300)) & (cosine > FOLDED) & joined
    if not good.any():
        return None
    away = -sense * np.column_stack([-along[:, 1], along[:, 0]])
    if ((away * (normal[:-1] + normal[1:])).sum(axis=1)[good]).sum() > 0:
        away = -away
    steep = np.maximum(cosine, FOLDED)  # good ones are above
    rise, fall = ((of * away).sum(axis=1) / steep for of in (tangent[:-1], tangent[1:]))
    before, after = good & ~np.r_[False, good[:-1]], good & ~np.r_[good[1:], False]
    return Curve(*(of[good] for of in (foot[:-1], foot[1:], away, rise, fall, before, after)))


def polygon(start: np.ndarray, end: np.ndarray) -> Curve:
    """Straight edges (s, 2) with the body that they bound on their left."""
    chord = end - start
    outward = np.column_stack([chord[:, 1], -chord[:, 0]])
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
    order = np.argsort(low[:, 0], kind="stable")
    left, found = low[order, 0], []
    for place, first in enumerate(order):
        last = np.searchsorted(left, high[first, 0], side="right")
        others = order[place + 1 : last]
        others = others[(low[others, 1] <= high[first, 1]) & (high[others, 1] >= low[first, 1])]
        others = others[~np.isin(ends[others], ends[first]).any(axis=1)]
        if not len(others):
            continue
        chord, chords = end[first] - start[first], end[others] - start[others]
        side = [cross(chord, of[others] - start[first]) for of in (start, end)]
        back = [cross(chords, of[first] - start[others]) for of in (start, end)]
        cut = (side[0] * side[1] < 0) & (back[0] * back[1] < 0)
        found += [(first, other) for other in others[cut]]
    return np.array(found, int).reshape(-1, 2)
