"""A boundary that bodies are to stay off, as a curve: distances and normals of any places."""

from dataclasses import dataclass

import numpy as np

from ..vectors import turned_left

CHUNK = 2_000_000  # pairs of places and segments that are compared at a time
FEET = 4  # steps of Newton's method
BEYOND = 0.1  # of a segment by which a foot may be beyond its end, on the next one


@dataclass
class Curve:
    """A chain of segments from `start` to `end` (s, 2), which the body is to stay off.

    The curve leaves the chord by the slopes `rise` and `fall` (s,) at its ends, to the side of
    `normal` (s, 2), which points to the body. `before` and `after` (s,): it goes on beyond
    that end, where no segment follows, for places to which that end is the nearest of all.
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

    def _nearest(self, place):
        """Of the chords the nearest to places (n, 2).

        The part of it where the place is along it, which may be beyond its ends, whether the curve
        goes on there, the way from its start, its length, direction and normal, and the slopes at
        its ends; all (n,) or (n, 2).
        """
        chord = self.end - self.start
        length = np.linalg.norm(chord, axis=1)
        along = chord / length[:, None]
        away = place[:, None] - self.start
        s = np.einsum("nsk,sk->ns", away, along) / length
        foot = (np.clip(s, 0.0, 1.0) * length)[..., None] * along
        nearest = ((away - foot) ** 2).sum(axis=2).argmin(axis=1)
        k = np.arange(len(place))
        return (s[k, nearest], away[k, nearest],
                *(of[nearest] for of in (self.before, self.after, length, along, self.normal,
                                         self.rise, self.fall)))

    def _distance(self, place):
        s, off, before, after, length, along, normal, rise, fall = self._nearest(place)
        s = np.clip(s, np.where(before, -np.inf, 0.0), np.where(after, np.inf, 1.0))
        # on the segment the cubic, beyond it a parabola with the curve's slope and mean curvature
        cubic, slope, _ = _cubic(s, rise, fall)
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


@dataclass
class SmoothCurve(Curve):
    """The same with the feet of places where their normals are: smooth from segment to segment."""

    def _distance(self, place):
        s, away, _, _, length, along, normal, rise, fall = self._nearest(place)
        s = np.clip(s, 0.0, 1.0)
        x, y = ((away * of).sum(axis=1) / length for of in (along, normal))
        for _ in range(FEET):  # Newton's method for (x - s) + (y - c) c' = 0
            cubic, slope, bend = _cubic(s, rise, fall)
            steepness = 1 + slope**2 - (y - cubic) * bend
            step = ((x - s) + (y - cubic) * slope) / np.maximum(steepness, 0.5)
            s = np.clip(s + step, -BEYOND, 1 + BEYOND)
        cubic, slope, _ = _cubic(s, rise, fall)
        turned = normal - slope[:, None] * along
        turned /= np.linalg.norm(turned, axis=1)[:, None]
        foot = length[:, None] * (s[:, None] * along + cubic[:, None] * normal)
        return ((away - foot) * turned).sum(axis=1), turned


def _cubic(s, rise, fall):
    """The cubic with slopes at both ends (n,), its slope and second derivative at s (n,)."""
    return (s * (1 - s) ** 2 * rise - s**2 * (1 - s) * fall,
            (1 - s) * (1 - 3 * s) * rise - s * (2 - 3 * s) * fall,
            (6 * s - 4) * rise + (6 * s - 2) * fall)


def through(segments: np.ndarray) -> SmoothCurve:
    """The curve of segments (s, 8) by both ends and the directions to the body there."""
    start, end = segments[:, :2], segments[:, 2:4]
    chord = end - start
    along = chord / np.linalg.norm(chord, axis=1)[:, None]
    away = turned_left(along)
    toward = (away * (segments[:, 4:6] + segments[:, 6:8])).sum(axis=1)
    away = np.where(toward < 0, -1.0, 1.0)[:, None] * away
    rise, fall = (-(way * along).sum(axis=1) / (way * away).sum(axis=1)
                  for way in (segments[:, 4:6], segments[:, 6:8]))
    no = np.zeros(len(start), bool)
    return SmoothCurve(start, end, away, rise, fall, no, no)
