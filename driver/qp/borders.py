"""Solutions that sit on the border between sticking and sliding.

Where slip comes to a halt, as behind the front at which a belt begins to slide back, whole rows of
nodes stick with the friction that they slid with. Newton's method finds other states for them in
every step: forces of sticking nodes miss their bounds by what movements round off, times the
rigidity of the material. Cut at the bounds they move a thin, limp body by many times that rounding,
of which the law, whose movements count by the rigidity of the limp body, sees next to nothing.
"""

import numpy as np

from .coulomb import ROUNDING, CoulombProblem

# parts of a friction bound within which forces are taken as on it: the least that helps counts
WIDTHS = (1e-6, 1e-5, 1e-4)
HELPS = 0.01  # part of the violation of the law to which that must lessen it
CLEAN = 1e-3 * ROUNDING  # violation of the law that is left alone
NEARLY = 1e3 * ROUNDING  # violation up to which states may be wrong at the border alone


def on_border(problem: CoulombProblem, z: np.ndarray | None,
              *others: np.ndarray) -> np.ndarray | None:
    """A solution z (n + m + k,), if any is known; a better one near it, or near the `others`, if
    nodes with friction near the bound are exactly on it there.
    """
    violation = ROUNDING if z is None else problem.violation(z)
    if violation <= CLEAN:
        return z
    for start in (*others, *(() if z is None else (z,))):
        if problem.violation(start) > NEARLY:
            continue
        along, bound = start[problem.n : problem.rows], problem.bounds(start)
        for width in WIDTHS:
            slides = np.where(np.abs(along) >= (1 - width) * bound, np.sign(along), 0.0)
            placed = problem.solution_in(problem.states_of(start, slides), problem.signs(start))
            if placed is not None and problem.violation(placed) <= HELPS * violation:
                return placed
    return z
