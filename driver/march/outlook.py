"""What the history of the loads says of a step: how its multipliers will change, and how exactly
they must be known for the steps after it.
"""

import numpy as np

from ..contact.kkt import FADED

NOTHING = 1e-9  # part of a load below which another one is none
FORESEEN = 10.0  # times later loads over a step's, if below 1: part of the step's tolerances


def growth(amplitudes: np.ndarray, index: int) -> float:
    """Change of the load over its last change: by it the last change of multipliers goes on.

    `amplitudes` (steps + 1, patterns), `index` of the step. Exact as long as the response is
    proportional to the load (a contact zone that is not changing under loading); on reversal the
    step starts from the previous one.
    """
    if index < 2:
        return 0.0
    older, last, new = amplitudes[index - 2 : index + 1]
    before, now = last - older, new - last
    size = before @ before
    return min(max(now @ before / size, 0.0), 2.0) if size > 0 else 0.0


def foresight(loads: list[float], index: int) -> float:
    """Part of its tolerances that step `index` is solved to; `loads` are the sizes of all steps'.

    It is 1 but before loads that are less than a tenth of the step's. Friction carries slip from a
    step to all later ones: what is nothing to a spike of the load may be more than they bring
    about. Steps without load ask for nothing.
    """
    own, *later = loads[index - 1 :]
    least = min((load / own for load in later if load > NOTHING * own > 0), default=1.0)
    return min(1.0, FORESEEN * max(least, FADED))
