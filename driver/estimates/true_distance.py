"""Distances and overlaps of boundaries where displacements have taken them.

Contact conditions are linear: a node's distance is that of the tangent at the place where it met
the other boundary before any load. Here the distance is measured at the displaced places. A rigid
obstacle is known by the feet of the contact nodes on it, x + gap n, and by their normals: a cubic
between neighbouring feet, beyond the ends an arc of the curvature there.
"""

from dataclasses import dataclass

import numpy as np

from ..scene.elements import cross

FOLDED = 0.5  # cosine of the turn from foot to foot below which they do not follow one another
CHUNK = 2_000_000  # pairs of points and edges that are compared at a time


@dataclass
class Curve:
    """A chain of segments from `start` to `end` (s, 2), which the body is to stay off.

    The curve leaves the chord by the slopes `rise` and `fall` (s,) at its ends, to the side of
    `normal` (s, 2), which points to the body. `before` and `after` (s,): it goes on beyond
    that end, where no segment follows.
    """

    start: np.ndarray
    end: np.ndarray
    normal: np.ndarray
    rise: np.ndarray
    fall: np.ndarray
    before: np.ndarray
    after: np.ndarray

    def distance(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) distances of places (n, 2), negative beyond the curve, and (n, 2) normals there."""
        distance, normal = np.empty(len(place)), np.empty((len(place), 2))
        step = max(1, CHUNK // len(self.start))
        for low in range(0, len(place), step):
            part = slice(low, low + step)
            distance[part], normal[part] = self._distance(place[part])
        return distance, normal

    def _distance(self, place):
        chord = self.end - self.start
        length = np.linalg.norm(chord, axis=1)
        along = chord / length[:, None]
        away = place[:, None] - self.start
        s = np.einsum("nsk,sk->ns", away, along) / length
        inside = np.clip(s, np.where(self.before, -np.inf, 0.0), np.where(self.after, np.inf, 1.0))
        square = (((away - (inside * length)[..., None] * along) ** 2).sum(axis=2))
        nearest = square.argmin(axis=1)
        k = np.arange(len(place))
        s, off = inside[k, nearest], away[k, nearest]
        along, length, normal = along[nearest], length[nearest], self.normal[nearest]
        rise, fall = self.rise[nearest], self.fall[nearest]
        # on the segment the cubic, beyond it a parabola with the curve's slope and mean curvature
        cubic = s * (1 - s) ** 2 * rise - s**2 * (1 - s) * fall
        slope = (1 - s) * (1 - 3 * s) * rise - s * (2 - 3 * s) * fall
        bend = fall - rise
        low, high = s < 0, s > 1
        cubic = np.where(low, s * rise + bend * s**2 / 2, cubic)
        slope = np.where(low, rise + bend * s, slope)
        cubic = np.where(high, (s - 1) * fall + bend * (s - 1) ** 2 / 2, cubic)
        slope = np.where(high, fall + bend * (s - 1), slope)
        turned = normal - slope[:, None] * along
        turned /= np.linalg.norm(turned, axis=1)[:, None]
        foot = (s * length)[:, None] * along + (cubic * length)[:, None] * normal
        return ((off - foot) * turned).sum(axis=1), turned


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
    rise = (tangent[:-1] * away).sum(axis=1) / np.where(cosine > 0, cosine, 1.0)
    fall = (tangent[1:] * away).sum(axis=1) / np.where(cosine > 0, cosine, 1.0)
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
