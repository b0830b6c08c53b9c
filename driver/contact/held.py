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

SOME = 1e-6  # of what a place meets; what is less is the rounding of its coordinate


def yielding(first, second, gids: tuple, fixed_keys: np.ndarray, normal: np.ndarray,
             rubs: np.ndarray, able: np.ndarray, reach: float | None) -> np.ndarray:
    """(n,) nodes of the side `first` that are held in a direction in which `second` can move.

    That is along the `normal` (n, 2) or, of nodes that rub, (n,), along the tangent. `gids` are
    those of the nodes of both sides; `able` and `reach` as of mortar.couple.
    """
    own, others = gids
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    held = [(normal, ~free_along(own, normal, fixed_keys)),
            (tangent, rubs & ~free_along(own, tangent, fixed_keys))]
    found = np.zeros(len(own), bool)
    if not any(stands.any() for _, stands in held):
        return found
    node, of, value = mortar.met_at_nodes(first, second, able, reach)
    for direction, stands in held:
        moves = free_along(others[of], direction[node], fixed_keys) & (np.abs(value) > SOME)
        found |= stands & (np.bincount(node, moves, len(own)) > 0)
    return found


def check_passed_on(first, labels: np.ndarray, lost: np.ndarray, held: np.ndarray, pairs: list,
                    both: bool) -> None:
    """InputError if nodes `lost` (n,) of the side `first` have no next one on their edge.

    All others are `held` (n,) as well. `labels` (e,) are those of its edges, `pairs` labels that
    meet; `both`: supports hold the other side too.
    """
    whole = lost[first.edges].any(axis=1) & held[first.edges].all(axis=1)
    if whole.any():
        edge = int(whole.argmax())
        one, two = next(pair for pair in pairs if pair[0] == labels[edge])
        x, y = first.xy[first.edges[edge, :2]].mean(axis=0)
        advice = ("supports of both bodies belong elsewhere than on their contact" if both else
                  f"name {two} first")
        raise InputError(f"a support holds the boundary {one} of a contact pair near ({x:g}, "
                         f"{y:g}), where {two} can move: {advice}")
