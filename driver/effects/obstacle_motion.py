"""Rigid obstacles that shift, turn or change with time.

At time t_k a node has the condition u_n <= g(t_k), g the distance of the obstacle where it stands
then, along the node's normal n; of an obstacle phi(x, t) = 0 that is to first order

    g = phi / (-grad phi . n).

Friction sees the slip (u_t - U_t)(t_k) - (u_t - U_t)(t_k-1), U_t the tangential displacement of
the obstacle's surface. See Wriggers, Computational Contact Mechanics (2006), 4.2; Johnson, Contact
Mechanics (1985), 8.1, for creepage.
"""

import functools
from collections.abc import Callable

import numpy as np

from ..contact.motion import ObstacleMotion
from ..errors import InputError
from ..vectors import turned_left
from . import Effect, RunFacts, entry

FACING = 0.1  # cosine between the node's normal and the obstacle's below which they do not meet
ASIDE = 1e-6  # such a cosine that is rounding: the obstacle moves along the node
STEADY = 1e-7  # sine between an obstacle's normals at two times that is rounding of differences
STILL = 1e-9  # part of a distance by which one that does not change is off between steps
EVEN = 1e-9  # part of the size of the boundaries below which a difference of distances is rounding


class Room(Effect):
    """Distances at every step, and ways of the obstacles' surfaces between steps."""

    summary = {"obstacle_motion": True}

    @property
    def obstacle_normals(self) -> Callable | None:
        """See Effect; None where scenes give normals, or no shape that has them."""
        return self._steady_normals if self.data["own_normals"] else None

    def _steady_normals(self, columns, normal) -> np.ndarray:
        """(n_c, 2) of the obstacle where they are the same at all times and face the body.

        A side that the obstacle moves along, at a right angle to it but for rounding, keeps its
        own. Decided for whole nodes: of the parts that make one some may face and others not.
        """
        slope = np.stack([self._history(columns, name, len(normal))
                          for name in ("phi_x", "phi_y")], axis=1)  # (T, 2, n)
        size, first = np.linalg.norm(slope, axis=1), slope[0]
        turn = first[0] * slope[:, 1] - first[1] * slope[:, 0]
        same = (np.abs(turn) <= STEADY * size[0] * size) & ((first * slope).sum(axis=1) > 0)
        faces = (first * normal.T).sum(axis=0) < -ASIDE * size[0]
        length = -columns.get("ring", 1.0) / np.where(size[0] > 0, size[0], 1.0)
        return np.where(faces & same.all(axis=0), first * length, np.nan).T

    def _history(self, columns: dict[str, np.ndarray], name: str, count: int) -> np.ndarray:
        """(T, count) of a column at every time, zero where the scene gives none."""
        known = f"{name}@0" in columns
        return np.array([columns[f"{name}@{k}"] if known else np.zeros(count)
                         for k in range(self.manifest.steps + 1)])

    def motion(self, nodes, distance: np.ndarray) -> ObstacleMotion:
        """Distances and motions at `nodes` (contact/nodes.py); see Effect. Raises InputError."""
        columns, count, steps = nodes.columns, len(nodes.gid), self.manifest.steps
        times = np.linspace(0, self.manifest.t_end, steps + 1)
        history = functools.partial(self._history, columns, count=count)
        shift = np.stack([history("obstacle_x"), history("obstacle_y")], axis=-1)
        pivot = np.column_stack([columns.get(name, np.zeros(count))
                                 for name in ("pivot_x", "pivot_y")])
        tangent = turned_left(nodes.normal)
        if "large_sliding" in self.manifest.rooms:  # finds distances itself
            gap = np.tile(distance, (steps + 1, 1))
        elif "phi@0" in columns:
            slope = np.stack([history("phi_x"), history("phi_y")], axis=-1)
            gap = _distance(history("phi"), slope, nodes, times)
        elif "gap_in_time@0" in columns:
            gap = history("gap_in_time")
        else:
            _refuse_uneven(nodes, distance, (shift * tangent).sum(axis=-1))
            gap = distance + (shift * nodes.normal).sum(axis=-1)
        gap = np.where(nodes.family > 0, distance, gap)
        angle = history("obstacle_angle")
        missed = {macro: _missed(columns, name, values) for macro, name, values in (
            ("obstacleX", "obstacle_x", shift[..., 0]), ("obstacleY", "obstacle_y", shift[..., 1]),
            ("obstacleAngle", "obstacle_angle", angle)) if f"{name}_missed" in columns}
        for macro, name in (("gapInTime", "gap_in_time"), ("obstacleInTime", "phi")):
            missed |= _missed_change(macro, columns, name, history(name))
        motion = ObstacleMotion(times, gap, shift, angle, pivot, nodes.xy, tangent, missed,
                                own="gap_in_time@0" in columns)
        if cycles := self.manifest.rooms.get("cycles"):
            motion.again = cycles["start"]
            if not motion.returns():
                raise InputError("a cycle must end as it begins, but an obstacle is at another "
                                 "place at its end: give obstacleX, obstacleY and obstacleAngle "
                                 "the same values there as at cycleStart()")
        return motion

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node touched: what is open does not know where its obstacle went."""
        return {"obstacle_motion": entry(*facts.touched())}


def _missed(columns: dict, name: str, values: np.ndarray) -> tuple[float, float]:
    """What steps miss of a history (T, n), relative to its largest value, and when."""
    away = columns[f"{name}_missed"]
    node = int(away.argmax())
    largest = max(np.abs(values).max(), away[node])
    return float(away[node] / largest) if largest > 0 else 0.0, columns[f"{name}_missed_at"][node]


def _missed_change(macro: str, columns: dict, name: str, values: np.ndarray) -> dict:
    """The same by macro of a surface that changes, relative to its largest change; empty where
    steps miss no more than rounding.
    """
    away = columns.get(f"{name}_missed", np.zeros(1)).max()
    if away <= STILL * np.abs(values).max(initial=0.0):
        return {}
    return {macro: _missed(columns, name, values - values[0])}


def _distance(phi: np.ndarray, slope: np.ndarray, nodes, times: np.ndarray) -> np.ndarray:
    """(T, n) distances along the nodes' normals to obstacles phi (T, n) of `slope` (T, n, 2).

    Beside an obstacle, where the line along the normal misses it, a distance that is too short to
    be wrong. Raises InputError where it reaches a node from there, or touches one at the start
    though no node of the label is outside: then the sign of its function is reversed. A side that
    leans away from the obstacle may end on it.
    """
    size = np.linalg.norm(slope, axis=-1)
    size = np.where(size > 0, size, 1.0)
    facing = -(slope * nodes.normal).sum(axis=-1) / size
    extent = np.ptp(nodes.xy, axis=0).max(initial=0.0)
    rounding = EVEN * extent * size
    behind = (facing < FACING) & (phi < -rounding)
    rigid = nodes.family == 0
    outside = np.isin(nodes.label, nodes.label[rigid & (phi[0] > rounding[0])])
    behind[0] |= (facing[0] < -FACING) & (phi[0] <= rounding[0]) & ~outside
    behind &= rigid
    if behind.any():
        k, node = np.argwhere(behind)[0]
        x, y = nodes.xy[node]
        raise InputError(
            f"the obstacle covers the contact boundary at ({x:g}, {y:g}) at the time {times[k]:g}, "
            "but does not face it there: its function must be positive outside, and contact is for "
            "boundaries that the obstacle approaches from outside, along their normals")
    return phi / size / np.maximum(facing, FACING)


def _refuse_uneven(nodes, distance: np.ndarray, along: np.ndarray) -> None:
    """Refuse obstacles that slide along labels on which their distance (n,) varies.

    Vertices of several labels have the mean of their distances.
    """
    size = np.ptp(nodes.xy, axis=0).max(initial=0.0)
    labels = np.array([gid for _, gid in getattr(nodes, "members", ())])
    vertices, count = np.unique(labels, return_counts=True)
    own = (nodes.family == 0) & ~np.isin(nodes.gid, vertices[count > 1])
    for label in np.unique(nodes.label[own]):
        here = own & (nodes.label == label)
        if along[:, here].any() and np.ptp(distance[here]) > EVEN * size:
            raise InputError(
                f"the obstacle of label {label} slides along it, but its gap is not constant "
                "there: give its shape by  macro obstacle(x, y) phi //, or gapInTime(t)")
