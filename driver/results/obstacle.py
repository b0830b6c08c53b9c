"""obstacle.csv, the outline of a rigid obstacle that contact follows, where it stands."""

from pathlib import Path

import numpy as np

from ..contact.following import Outline
from ..errors import agreed_writes
from ..files import write_rows
from .tables import OBSTACLE, header

BEND = np.deg2rad(5.0)  # by which a side of the polygon that is written may turn
SIDES = 40  # of the obstacle's size are the longest of them
SAME = 1e-9  # of the obstacle's size, or of a radian, by which nodes may see one obstacle apart


def write_obstacle(path: Path, following, comm) -> None:
    """Write the table on rank 0, for every step if the obstacle moves, else for the start alone.

    Nothing without an obstacle given by a function. `following` is a Following. Collective.
    """
    if not isinstance(following.surface, Outline) or not len(following.rigid):
        return
    with agreed_writes(comm):
        if comm.rank == 0:
            write_rows(path, header(OBSTACLE), _rows(following))


def _rows(following) -> list[list]:
    """Rows of the table."""
    ends, motion = polygon(following.surface.curve), following.motion
    if motion is None:
        return [[0, *side] for side in ends.tolist()]
    rows, size = [], np.ptp(ends.reshape(-1, 2), axis=0).max()
    for step in range(len(motion.times)):
        here = following.rigid
        paths = np.column_stack([motion.shift[step, here], motion.angle[step, here],
                                 motion.pivot[here]])
        alike = np.round(paths / (SAME * np.array([size, size, 1.0, size, size])))
        for *shift, angle, x, y in paths[np.unique(alike, axis=0, return_index=True)[1]]:
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            pivot = np.array([x, y])
            moved = (ends.reshape(-1, 2) - pivot) @ turn.T + pivot + shift
            rows += [[step, *side] for side in moved.reshape(-1, 4).tolist()]
    return rows


def polygon(curve) -> np.ndarray:
    """(n, 4) sides x0, y0, x1, y1 of a polygon that is like a Curve, the body on its left."""
    start, end = curve.start, curve.end
    x, y = (end - start).T
    turned = x * curve.normal[:, 1] - y * curve.normal[:, 0] < 0
    start, end = (np.where(turned[:, None], *ends) for ends in ((end, start), (start, end)))
    size = np.ptp(np.concatenate([start, end]), axis=0).max()
    first, last = (list(map(tuple, np.rint(ends / size * 1e8).astype(int)))
                   for ends in (start, end))
    after, reached = {key: k for k, key in enumerate(first)}, set(last)
    waiting = [k for k, key in enumerate(first) if key not in reached] + list(range(len(first)))
    used, sides = np.zeros(len(start), bool), []
    along = end - start
    direction = np.arctan2(along[:, 1], along[:, 0])
    for k in waiting:
        begin = None
        while k is not None and not used[k]:
            used[k] = True
            if begin is None:
                begin = k
            onward = after.get(last[k])
            going = onward is not None and not used[onward]
            bend = going and abs(np.sin(direction[onward] - direction[begin])) < np.sin(BEND)
            if not bend or np.linalg.norm(end[k] - start[begin]) > size / SIDES:
                sides.append([*start[begin], *end[k]])
                begin = None
            k = onward
    return np.array(sides)
