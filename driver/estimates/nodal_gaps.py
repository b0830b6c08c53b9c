"""What linear elements miss of a gap that bends between their nodes.

Contact holds at nodes; between them linear elements have the chord, whose gap g_h differs from g by
-h^2 g''/12 in the mean of a side h. Adjoint problems see errors of stresses; to the error of a
quantity this adds

    int mu (g - g_h),   mu the contact forces of the adjoint problem,

as they are what the quantity changes by when the gap grows. Quadratic elements follow the gap to
higher order, and mortar coupling takes the mean of a pair's.
"""

import numpy as np

from ..contact.states import OPEN
from ..results.kinks import bends


def missed_gaps(nodes: dict, gap: np.ndarray, status: np.ndarray) -> np.ndarray:
    """(n,) mean of g - g_h round the nodes, over sides in contact at both ends; zero in pairs.

    `nodes` as of results/quantities.py, with the `gap` (n,) and the `status` of a step.
    """
    missed = np.zeros(len(gap))
    for piece, side, bend in bends(nodes, gap):
        bend = np.concatenate([bend[:1], bend, bend[-1:]])
        integral = -side**3 * (bend[1:] + bend[:-1]) / 24
        closed = status[piece] != OPEN
        integral[~(closed[1:] & closed[:-1]) | nodes["paired"][piece[1:]]] = 0.0
        around = np.append(0.0, integral) + np.append(integral, 0.0)
        missed[piece] = around / 2 / nodes.get("length", nodes["weight"])[piece]
    return missed
