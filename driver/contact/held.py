"""Contact nodes between bodies that a support holds, in one direction or in both.

A row of the first boundary's node acts on the displacements of both sides. Where a support holds
its own side in the row's direction it would act on the other body alone and nearly repeat the next
rows. So the node has none, and the next node's multiplier takes its part over (mortar.py). That is
so wherever the other body can move there; where it cannot, as on a line of symmetry of both, a row
would act on nothing. Without a next node the other body would pass through the boundary: then that
one is to carry the contact nodes.
"""

import numpy as np

from ..errors import InputError
from ..feti.supports import free_along
from . import mortar

HALF = 0.5  # of what a place meets: whether it can move


def yielding(first, second, gids: tuple, fixed_keys: np.ndarray, frictional: bool,
             able: np.ndarray, reach: float | None) -> np.ndarray:
    """(n,) nodes of the side `first` that are held in a direction in which `second` can move.

    That is along the normal or, if `frictional`, along the tangent. `gids` are those of the nodes
    of both sides; `able` and `reach` as of mortar.couple.
    """
    own, others = gids
    normal = first.nodal_normals()
    directions = [normal] + [np.column_stack([-normal[:, 1], normal[:, 0]])] * frictional
    held = [~free_along(own, direction, fixed_keys) for direction in directions]
    found = np.zeros(len(own), bool)
    if not np.any(held):
        return found
    # the condition of each place alone: of neighbours on a symmetric line most may be free
    met = mortar.couple(first, second, np.zeros(len(own), bool), able, reach, np.any(held, axis=0))
    facing = met.side == 1
    node, size = met.node[facing], np.abs(met.value[facing])
    total = np.bincount(node, size, len(own))
    for direction, stands in zip(directions, held):
        free = free_along(others[met.of[facing]], direction[node], fixed_keys)
        found |= stands & (np.bincount(node, size * free, len(own)) > HALF * total)
    return found


def check_passed_on(first, labels: np.ndarray, lost: np.ndarray, pairs: list) -> None:
    """InputError if nodes `lost` (n,) of the side `first` leave no next one on their edge.

    `labels` (e,) are those of its edges, `pairs` labels that meet.
    """
    whole = lost[first.edges].all(axis=1)
    if whole.any():
        edge = int(whole.argmax())
        one, two = next(pair for pair in pairs if pair[0] == labels[edge])
        x, y = first.xy[first.edges[edge, :2]].mean(axis=0)
        raise InputError(f"a support holds the boundary {one} of a contact pair near ({x:g}, "
                         f"{y:g}), where {two} can move: name {two} first")
