"""Stage 3: pairs whose bodies repeat themselves meet beyond their ends, too.

What periodic boundaries (joints.py) declare once goes on for ever: a body that begins elsewhere
than the other one, or slides along it, meets the other's image, moved by a whole number of periods.
Images have the displacements of what they are images of.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from ..errors import InputError
from .joints import CONGRUENT, boundary_edges, translation
from .side import Side

ASKEW = 0.01  # sine of the angle from which on two directions are two


def translations(joints, manifest, subdomains, comm) -> np.ndarray:
    """(d, 2), d <= 2, the periods of the periodic ones of `joints`; collective.

    Raises InputError for bodies with different periods in one direction.
    """
    joints = [joint for joint in joints if joint.periodic]
    labels = sorted({label for joint in joints for label in (joint.first, joint.second)})
    edges = boundary_edges(subdomains, labels, 2, comm)
    found = np.zeros((0, 2))
    for joint in joints:
        period = translation(joint, edges.of(joint.first), edges.of(joint.second),
                             manifest.axisymmetric)
        size = np.linalg.norm(period)
        same = [min(np.linalg.norm(period - other), np.linalg.norm(period + other))
                <= CONGRUENT * size for other in found]
        if any(same):
            continue
        askew = [abs(np.linalg.det([period, other])) > ASKEW * size * np.linalg.norm(other)
                 for other in found]
        if len(found) == 2 or not all(askew):
            raise InputError(
                f"bodies in contact repeat themselves by ({period[0]:.6g}, {period[1]:.6g}) and by "
                f"({found[0, 0]:.6g}, {found[0, 1]:.6g}): give them one period, as by more waves")
        found = np.vstack([found, period])
    return found


def offsets(near: np.ndarray, place: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """(m, 2) by which images of places (k, 2) are moved that come beside `near` (n, 2).

    The first is zero: the places themselves.
    """
    basis = np.linalg.pinv(periods)
    here, there = near @ basis, place @ basis
    lowest = np.ceil(here.min(axis=0) - there.max(axis=0) - CONGRUENT).astype(int)
    highest = np.floor(here.max(axis=0) - there.min(axis=0) + CONGRUENT).astype(int)
    numbers = product(*(range(low, high + 1) for low, high in zip(lowest, highest)))
    return np.array([[0.0, 0.0], *(np.array(k) @ periods for k in numbers if any(k))])


def repeated(side: Side, near: np.ndarray, periods: np.ndarray) -> tuple[Side, int]:
    """A side with its images beside the places `near` (n, 2), and how often it is there.

    Image k has nodes and edges of the side, in their order, k times their number on.
    """
    moves, n = offsets(near, side.xy, periods), len(side.xy)
    count = len(moves)
    edges = np.concatenate([side.edges + k * n for k in range(count)])
    copied = {name: None if value is None else np.concatenate([value] * count)
              for name, value in vars(side).items() if name not in ("xy", "edges")}
    place = (moves[:, None] + side.xy).reshape(-1, 2)
    return replace(side, xy=place, edges=edges, **copied), count


def with_images(edges: np.ndarray, place: np.ndarray, moved: np.ndarray, near: np.ndarray,
                periods: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges (e, 2) with their images beside `near` (n, 2): edges, places and displacements.

    `place`, `moved` (k, 2) of all nodes; those of images follow them.
    """
    moves, count = offsets(near, place[edges].reshape(-1, 2), periods), len(place)
    return (np.concatenate([edges + k * count for k in range(len(moves))]),
            (moves[:, None] + place).reshape(-1, 2), np.tile(moved, (len(moves), 1)))
