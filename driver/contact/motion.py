"""Where rigid obstacles stand at every time of a load history: distances, and ways of surfaces."""

from dataclasses import dataclass, field, replace

import numpy as np

from ..vectors import turned_left

SAME = 1e-9  # of a history's largest value, or of a period, that is rounding


@dataclass
class ObstacleMotion:
    """Distances and rigid motions of the obstacles that n contact nodes meet, at `times` (T,).

    `gap` (T, n) is the distance along the nodes' normals. The obstacle of a node has shifted by
    `shift` (T, n, 2) and turned by `angle` (T, n), in radians, about the point `pivot` (n, 2),
    which shifts with it. `xy` (n, 2) are the nodes' places, `tangent` (n, 2) their tangents. From
    the last of the times on they stand where they stood after the one with the index `again`.
    """

    times: np.ndarray
    gap: np.ndarray
    shift: np.ndarray
    angle: np.ndarray
    pivot: np.ndarray
    xy: np.ndarray
    tangent: np.ndarray
    # by macro the largest departure from straight lines between the times, over the largest value,
    # and when
    missed: dict[str, tuple[float, float]] = field(default_factory=dict)
    again: int = 0
    own: bool = False  # whether distances have a history of their own beside shifts and angles

    def gap_at(self, time: float) -> np.ndarray:
        """(n,) distances at one of the `times`, or of their repetitions."""
        return self.gap[self.index(time)]

    def way(self, before: float, now: float) -> np.ndarray:
        """(n,) tangential way, from one of these times to another, of the surfaces at the nodes.

        The integral of the velocity that an obstacle's points have as they come by the node's
        place, shift and angle growing in proportion: angle times arm, however far it turns.
        """
        first, last = self.index(before), self.index(now)
        turn = self.angle[last] - self.angle[first]
        arm = self.xy - self.pivot - (self.shift[first] + self.shift[last]) / 2
        passed = self.shift[last] - self.shift[first] + turned_left(turn[:, None] * arm)
        return (passed * self.tangent).sum(axis=1)

    def rests(self, before: float, now: float) -> bool:
        """Whether all obstacles stand at one of these times where they stood at another."""
        first, last = self.index(before), self.index(now)
        return all(np.array_equal(values[first], values[last])
                   for values in (self.gap, self.shift, self.angle))

    def moved(self, before: float, now: float) -> np.ndarray:
        """(n,) whether the obstacle of a node stands elsewhere at the second of two times."""
        first, last = self.index(before), self.index(now)
        return ((self.shift[first] != self.shift[last]).any(axis=1)
                | (self.angle[first] != self.angle[last])
                | (self.gap_at(before) != self.gap_at(now)))

    def of(self, nodes: np.ndarray) -> "ObstacleMotion":
        """The same at some nodes."""
        return replace(self, gap=self.gap[:, nodes], shift=self.shift[:, nodes],
                       angle=self.angle[:, nodes], pivot=self.pivot[nodes], xy=self.xy[nodes],
                       tangent=self.tangent[nodes])

    def padded(self, count: int) -> "ObstacleMotion":
        """The same with `count` nodes more, whose obstacles stand still at no distance."""
        if not count:
            return self
        more = {name: np.concatenate([values, np.zeros((*values.shape[:axis], count,
                                                        *values.shape[axis + 1:]))], axis)
                for name, axis in (("gap", 1), ("shift", 1), ("angle", 1), ("pivot", 0), ("xy", 0),
                                   ("tangent", 0))
                for values in (getattr(self, name),)}
        return replace(self, **more)

    def returns(self) -> bool:
        """Whether obstacles stand at the last time where they stood at the time `again`.

        Beside the size of the boundary rounding is no motion, where a history is zero but for it.
        """
        size = np.ptp(self.xy, axis=0).max() if len(self.xy) else 0.0
        return all(np.abs(values[-1] - values[self.again]).max(initial=0.0)
                   <= SAME * max(np.abs(values).max(initial=0.0), least)
                   for values, least in ((self.gap, size), (self.shift, size), (self.angle, 1.0)))

    def histories(self, nodes: np.ndarray) -> dict[str, list[float]]:
        """What moves the obstacle that `nodes` of one label meet: shift_x, shift_y, angle.

        Values at `times`, those that are zero all along left out; where none is left, or distances
        do not follow from them, distance, that of the nearest node, if it changes.
        """
        shift = self.shift[:, nodes[0]]
        known = {"shift_x": shift[:, 0], "shift_y": shift[:, 1], "angle": self.angle[:, nodes[0]]}
        moving = {name: values.tolist() for name, values in known.items() if values.any()}
        nearest = self.gap[:, nodes].min(axis=1)
        if np.ptp(nearest) > 0 and (self.own or not moving):
            moving["distance"] = nearest.tolist()
        return moving

    def index(self, time: float) -> int:
        """Place of the nearest of the `times`, or of the one that a later time repeats."""
        first, last = self.times[self.again], self.times[-1]
        if time > last + SAME * (last - first):
            time = first + (time - first) % (last - first)
        return int(np.abs(self.times - time).argmin())
