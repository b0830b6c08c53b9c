"""The states of corners: which rows of two contact nodes at one vertex act.

Each leaves as many multipliers of the two contact nodes free as the vertex has displacements, and
holds the others at zero (corner_nodes.py):

    first, second   one of the two nodes acts, with its contact and friction; the other one is open
    both            both press, neither rubs: the vertex stands, and what holds it is contact's
    standing        both conditions are equations, whatever force they take, as long as the laws of
                    both sides, with friction, can make it up between them (sharing.py)
    neither         both are open, and both rub with the friction that needs no pressure
    first rubs, second rubs
                    both press and one rubs: where rows depend on those of other vertices, which
                    one row less ends

Together the states hold every force that the two laws admit between contact with either side: where
F is so small that a vertex does not jam, tan(angle between the normals) F < 1, the cones of the
states side by side are the sum of the cones of both nodes. With fixed multipliers that are not
free F is regular on every face, so that nothing is regularized or dropped.
"""

from enum import IntEnum

import numpy as np


class Acting(IntEnum):
    """Which of the two nodes of a corner act; plain numbers below, see qp/equations.py."""

    BOTH = 0
    FIRST = 1
    SECOND = 2
    STANDING = 3
    NEITHER = 4
    FIRST_RUBS = 5
    SECOND_RUBS = 6


BOTH, FIRST, SECOND, STANDING, NEITHER, FIRST_RUBS, SECOND_RUBS = (int(state) for state in Acting)
RUBS = FIRST_RUBS, SECOND_RUBS
# by state: whether the normal, the tangential row of the (first, second) node is excluded
NORMAL_OUT = np.array([[state in (SECOND, NEITHER), state in (FIRST, NEITHER)] for state in Acting])
TANGENTIAL_OUT = np.array([[state in (SECOND, BOTH, STANDING, SECOND_RUBS),
                            state in (FIRST, BOTH, STANDING, FIRST_RUBS)] for state in Acting])
