"""Contact nodes between bodies that a support holds, in one direction or in both.

A row of the first boundary's node acts on the displacements of both sides. Where a support holds
its own side in the row's direction it would act on the other body alone and nearly repeat the next
rows. So the node has none, and the next node's multiplier takes its part over (mortar.py). That is
so wherever the other body can move there. Without a next node the other body would pass through the
boundary: then that one is to carry the contact nodes.

Where supports hold both bodies in a component, as on a line of symmetry of both, the node is
guided: all that it can move by from what it meets is along the other one. A slanted normal and its
tangent are two rows for one displacement then, and on meshes that do not match a tangential row
hangs on the small part of the multiplier that acts on the other body's next node. Such a node
carries pressure and no friction, like one on a rigid obstacle.
"""

import numpy as np

from ..errors import InputError
from ..feti.supports import free_along
from ..vectors import turned_left
from . import mortar

# coefficients from which on a node is met: less comes of the rounding of coordinates, or of the
# tilt of displaced normals
LEAST_SHARE = 1e-2


def lost_and_guided(first, second, gids: tuple, fixed_keys: np.ndarray, normal: np.ndarray,
                    rubs: np.ndarray, able: np.ndarray,
                    reach: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Which nodes of the side `first` have no row, and which are guided, (n,) each.

    No row have those that are held in a direction in which `second` can move: along the `normal`
    (n, 2) or, of nodes that rub, (n,), along the tangent. Guided are those held in a component in
    which all that they meet is held as well, if they meet anything. `gids` are those of the nodes
    of both sides; `able` and `reach` as of mortar.couple.
    """
    own, others = gids
    lost, guided = np.zeros((2, len(own)), bool)
    if not np.isin(own, fixed_keys // 2).any():
        return lost, guided
    node, of, value, _ = mortar.met_at_nodes(first, second, able, reach)
    node, of = (column[np.abs(value) > LEAST_SHARE] for column in (node, of))

    def meets(which: np.ndarray) -> np.ndarray:
        return np.bincount(node, which, len(own)) > 0

    tangent = turned_left(normal)
    for direction, asked in ((normal, True), (tangent, rubs)):
        stands = asked & ~free_along(own, direction, fixed_keys)
        lost |= stands & meets(free_along(others[of], direction[node], fixed_keys))
    for component in (0, 1):
        held, theirs = (np.isin(2 * gid + component, fixed_keys) for gid in (own, others))
        guided |= held & meets(theirs[of]) & ~meets(~theirs[of])
    return lost, guided


def met_by(first, second, which: np.ndarray, able: np.ndarray,
           reach: float | None) -> tuple[np.ndarray, ...]:
    """What those nodes of the side `first` meet that are `which` (n,): node, node of `second` and
    the part that it has in the place met, (terms,) each; and distances (n,) along the normal, inf
    where they face nothing, NaN of other nodes. `able` and `reach` as of mortar.couple.
    """
    node, of, value, distance = mortar.met_at_nodes(first, second, able, reach)
    node, of, value, distance = (each[which[node]] for each in (node, of, value, distance))
    times = np.bincount(node, value, len(which))  # a vertex is met from both its edges
    value = value / times[node]
    away = np.bincount(node, value * distance, len(which))
    away = np.where(times > 0, away, np.inf)
    return node, of, value, np.where(which, away, np.nan)


def check_passed_on(first, labels: np.ndarray, lost: np.ndarray, held: np.ndarray, pairs: list,
                    both: bool) -> None:
    """InputError if nodes `lost` (n,) of the side `first` have no next one on their edge.

    All others are `held` (n,) as well. `labels` (e,) are those of its edges, `pairs` labels that
    meet; `both`: supports hold the other side too.
    """
    whole = lost[first.edges].any(axis=1) & held[first.edges].all(axis=1)
    if whole.any():
        edge = int(whole.argmax())
        one = labels[edge]
        met = [two for label, two in pairs if label == one]
        two = met[0] if len(met) == 1 else "what it meets"
        x, y = first.xy[first.edges[edge, :2]].mean(axis=0)
        advice = ("supports of both bodies belong elsewhere than on their contact" if both else
                  f"name {two} first")
        raise InputError(f"a support holds the boundary {one} of a contact pair near ({x:g}, "
                         f"{y:g}), where {two} can move: {advice}")
