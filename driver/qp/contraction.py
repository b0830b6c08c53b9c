"""By how much successive approximations of friction bounds contract near a solution."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .coulomb import CoulombProblem
from .equations import Equations


def contraction(problem: CoulombProblem, z: np.ndarray, rounds: int) -> float:
    """Mean factor of `rounds` changes of friction bounds in the states of the solution z (n + m,).

    A change of the forces of sliding nodes moves pressures with sticking nodes held and open ones
    open, these the forces again by their slope: the iteration is linear, and starts in proportion
    to the forces. NaN where nothing slides, so that no bound counts, or where it ends at once.
    Without free rigid motions, where C is positive definite on the closed rows.
    """
    equations = Equations(problem, problem.states(z), problem.signs(z))
    held, slides = equations.still, np.flatnonzero(equations.slides)
    if not len(slides):
        return np.nan
    pair, slope, slip = problem.pair[slides], equations.slope[slides], problem.n + slides
    factor = cho_factor(problem.compliance[np.ix_(held, held)], lower=True, check_finite=False)
    toward = problem.compliance[np.ix_(held, slip)]
    change, answer, sizes = z[slip], np.zeros(problem.rows), []
    for _ in range(rounds + 1):
        sizes.append(np.linalg.norm(change))
        if sizes[-1] <= np.finfo(float).tiny:
            return np.nan
        answer[held] = -cho_solve(factor, toward @ change, check_finite=False)
        change = slope * answer[pair]
    # the first change is not yet one that the iteration makes
    return float((sizes[-1] / sizes[1]) ** (1 / (rounds - 1)))
