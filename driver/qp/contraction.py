"""By how much successive approximations of friction bounds contract near a solution."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .coulomb import CoulombProblem
from .equations import BACKWARD, FORWARD, OPEN, STICK


def contraction(problem: CoulombProblem, z: np.ndarray, rounds: int) -> float:
    """Mean factor of `rounds` changes of friction bounds in the states of the solution z.

    A change of the bounds of sliding nodes moves pressures with sticking nodes held and open ones
    open, these the bounds again by F: the iteration is linear, and starts in proportion to the
    bounds. NaN where nothing slides, so that no bound counts, or where it ends at once. Without
    free rigid motions, where C is positive definite on the closed rows.
    """
    states = problem.states(z)
    way = states[problem.pair]
    slides = np.flatnonzero((way == FORWARD) | (way == BACKWARD))
    held = np.concatenate([states > OPEN, np.abs(way) == STICK])
    if not len(slides):
        return np.nan
    C, pair, direction = problem.compliance, problem.pair[slides], np.where(way == FORWARD, 1, -1)
    factor = cho_factor(C[np.ix_(held, held)], lower=True, check_finite=False)
    toward = C[np.ix_(held, problem.n + slides)] * direction[slides]
    rubs = problem.coefficient[slides] * problem.signs(z)[pair]
    change, answer, sizes = problem.bounds(z)[slides], np.zeros(problem.rows), []
    for _ in range(rounds + 1):
        sizes.append(np.linalg.norm(change))
        if sizes[-1] <= np.finfo(float).tiny:
            return np.nan
        answer[held] = -cho_solve(factor, toward @ change, check_finite=False)
        change = rubs * answer[pair]
    # the first change is not yet one that the iteration makes
    return float((sizes[-1] / sizes[1]) ** (1 / (rounds - 1)))
