"""Contact that follows the boundaries as they move: its nodes about any displacements.

About displacements w at the time t a node has the condition

    n_w . ([u] - [w]) <= d_w,

d_w the distance of the displaced place from what it meets then, n_w the normal there: of a rigid
obstacle at the foot of the place on it, of another body by the mortar coupling of the displaced
boundaries (mortar.py). That is u_n <= gap with gap = d_w + n_w . [w]; where w is the solution the
distance itself is gap - u_n. See Wriggers, Computational Contact Mechanics (2006), 4.1, 6.3;
Laursen, Computational Contact and Impact Mechanics (2002).

Nodes, rows and weights are those of the boundaries as a whole, once and for all, less those that a
support leaves no condition at the start: the next ones have their weights. Nodes that face nothing
are idle.
"""

import copy
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..vectors import turned_left
from .boundary import Configuration, ContactBoundary
from .motion import ObstacleMotion


@dataclass
class FollowedMotion(ObstacleMotion):
    """The motion of obstacles whose distances, `gap` (1, n), are those at one time."""

    def gap_at(self, time: float) -> np.ndarray:
        """(n,) distances."""
        return self.gap[0]


@dataclass
class Plane:
    """The plane normal . X = offset of every contact node; the body is where it is less.

    `normal` (n, 2), `offset` (n,).
    """

    normal: np.ndarray
    offset: np.ndarray

    def distance(self, place: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(k,) distances of places (k, 2) of the `nodes`, (k, 2) normals from the body."""
        normal = self.normal[nodes]
        return self.offset[nodes] - (normal * place).sum(axis=1), normal


@dataclass
class Outline:
    """A rigid obstacle by a Curve (curve.py), known in the box [left, right, low, high]."""

    curve: object
    box: np.ndarray

    def distance(self, place: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `Plane.distance`. Raises InputError for a place out of the box."""
        left, right, low, high = self.box
        outside = np.maximum(np.maximum(left - place[:, 0], place[:, 0] - right),
                             np.maximum(low - place[:, 1], place[:, 1] - high))
        if outside.max(initial=0.0) > 0:
            x, y = place[outside.argmax()]
            raise InputError(f"the contact boundary comes to ({x:.4g}, {y:.4g}), as the obstacle "
                             f"sees it, by {outside.max():.3g} farther than largeSliding says: "
                             "give a larger length, by that at least")
        distance, normal = self.curve.distance(place)
        return distance, -normal


class Following:
    """Contact nodes about displacements (k, 2) of the vertices `gids` (k,): see the module."""

    def __init__(self, nodes, motion: ObstacleMotion | None, surface: Plane | Outline,
                 reach: float):
        """`nodes` as nodes.py makes them, `surface` of those on rigid obstacles."""
        self.nodes, self.motion, self.surface, self.reach = nodes, motion, surface, reach
        self.rigid = np.flatnonzero(nodes.family == 0)
        self.joints = []  # rows of joints.py
        self.lost = None  # (n,) nodes that a support leaves no condition at the start, see held.py

    def first(self, found, gap: np.ndarray, sides) -> ContactBoundary:
        """The boundary before any load; `found` the FoundNodes, `gap` (n,) what pairs have beyond
        their geometry, `sides` their boundaries.
        """
        self.found, self.gap, self.sides = found, gap, sides
        more = np.unique(sides.gid) if sides is not None else np.zeros(0, int)
        self.gids = np.union1d(self.nodes.gid, more)
        self._own = np.searchsorted(self.gids, self.nodes.gid)
        return self._boundary(np.zeros((len(self.gids), 2)), 0.0)

    def settle(self, boundary: ContactBoundary) -> None:
        """Take over rows and corners of the first boundary, which all others share."""
        self.start = boundary

    def about(self, moved: np.ndarray, time: float) -> ContactBoundary:
        """The boundary about the displacements `moved` (k, 2) at `time`."""
        boundary, first = self._boundary(moved, time), self.start
        if self.joints:
            from .joints import appended

            boundary = appended(boundary, self.joints)
        return replace(boundary, normal_row=first.normal_row, tangential_row=first.tangential_row,
                       corners=first.corners, periods=first.periods)

    def passed(self, before: np.ndarray, moved: np.ndarray, time: float) -> InputError | None:
        """What to say of nodes that a step has taken through the other body; None if of none.

        `before` and `moved` (k, 2) are the displacements at its start and at its end. Who has come
        through farther than the reach faces nothing any more, as who has never met the other body.
        """
        if self.sides is None or np.linalg.norm(np.ptp(moved - before, axis=0)) <= self.reach:
            return None
        whole = copy.copy(self)
        whole.reach = np.inf
        first, now = whole._boundary(before, time).declared, self._boundary(moved, time).declared
        jump = (first.normal[first.term_node]
                * moved[np.searchsorted(self.gids, first.term_gid)]).sum(axis=1)
        over = np.bincount(first.term_node, first.term_value * jump, len(first.gid)) - first.gap
        through = np.flatnonzero(first.paired & ~first.idle & now.idle & (over > self.reach))
        if not len(through):
            return None
        x, y = first.xy[through[over[through].argmax()]]
        return InputError(f"the contact boundary passes through the other body at ({x:.4g}, "
                          f"{y:.4g}), by {over[through].max():.3g}, farther than largeSliding "
                          "says: give a larger length")

    def _boundary(self, moved: np.ndarray, time: float) -> ContactBoundary:
        """The same without rows and corners."""
        here, u = self.rigid, moved[self._own]
        place, normal, gap = self.nodes.xy + u, self.nodes.normal.copy(), self.gap.copy()
        distance, normal[here] = self._from_obstacles(place[here], time)
        gap[here] = distance + (normal[here] * u[here]).sum(axis=1)
        sides, motion = self.sides, self.motion
        if sides is not None:
            sides = sides.displaced(Configuration(self.gids, moved))
        if motion is not None:
            tangent = turned_left(normal)
            motion = FollowedMotion(**vars(motion) | {"gap": gap[None].copy(), "xy": place,
                                                      "tangent": tangent})
        boundary = self.found.boundary(gap, motion, sides, self, normal)
        idle = boundary.idle
        if idle.any():
            at = moved[np.searchsorted(self.gids, boundary.gid[idle])]
            boundary.gap[idle] = self.reach + (boundary.normal[idle] * at).sum(axis=1)
            if boundary.motion is not None:
                boundary.motion.gap[0, idle] = boundary.gap[idle]
        return replace(boundary, about=Configuration(self.gids, moved), time=time)

    def _from_obstacles(self, place: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Distances and normals of the places (r, 2) of nodes on rigid obstacles."""
        if not len(self.rigid):
            return np.zeros(0), np.zeros((0, 2))
        if self.motion is None:
            return self.surface.distance(place, self.rigid)
        # where the obstacle's own points are that have come here
        k, m = self.motion.index(time), self.motion
        angle, pivot = m.angle[k, self.rigid], m.pivot[self.rigid]
        cos, sin = np.cos(angle), np.sin(angle)
        x, y = (place - pivot - m.shift[k, self.rigid]).T
        back = pivot + np.column_stack([cos * x + sin * y, cos * y - sin * x])
        distance, (x, y) = (of.T for of in self.surface.distance(back, self.rigid))
        return distance, np.column_stack([cos * x - sin * y, sin * x + cos * y])
