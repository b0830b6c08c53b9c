"""Kinks of rigid obstacles, or of boundaries on them, that press into a body.

Under the edge of a wedge, however blunt, pressure grows like the logarithm of the distance (K. L.
Johnson, Contact Mechanics, 1985, 5.2). The gap tells it: it bends much more at a node or two than
beside them. A rounding that has no more nodes looks alike, and is as little resolved.
"""

import numpy as np

from ..contact.states import OPEN
from .contact_edges import chains

SHARP = 4.0  # bend of the gap at a node over those beside
PRESSES = 0.01  # of the largest u_n: what it bends by within a side


def bends(nodes: dict, gap: np.ndarray):
    """Of every chain of three nodes and more: places of its nodes (k,), lengths of its sides
    (k - 1,) and second derivatives of the `gap` (n,) at the nodes inside (k - 2,).
    """
    for piece in chains(nodes):
        side = np.diff(nodes["arc"][piece])
        if len(piece) >= 3 and (side > 0).all():
            width = (side[1:] + side[:-1]) / 2
            yield piece, side, np.diff(np.diff(gap[piece]) / side) / width


def kinks(nodes: dict, steps: dict, index: int) -> np.ndarray:
    """(n,) whether a node that touches in step `index` is at a kink; of rigid obstacles alone.

    `nodes` and `steps` as of quantities.py.
    """
    gap = steps["gap"][index] if "gap" in steps else nodes["gap"]
    found = np.zeros(len(gap), bool)
    least = PRESSES * np.abs(steps["u_n"][index]).max(initial=0.0)
    beyond = 4 if nodes["middle"].any() else 2
    for piece, side, bend in bends(nodes, gap):
        width = (side[1:] + side[:-1]) / 2
        size = np.pad(np.abs(bend), beyond)
        beside = np.maximum(size[: -2 * beyond], size[2 * beyond:])
        found[piece[1:-1]] = (bend * width**2 > least) & (bend > SHARP * beside)
    return found & ~nodes["paired"] & (steps["status"][index] != OPEN)
