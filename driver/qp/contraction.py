"""By how much successive approximations of friction bounds contract near a solution."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack

from .coulomb import CoulombProblem
from .equations import Equations
from .state_system import SINGULAR


def contraction(problem: CoulombProblem, z: np.ndarray, rounds: int) -> float:
    """Mean factor of `rounds` changes of friction bounds in the states of the solution z.

    A change of the forces of sliding nodes moves pressures with sticking nodes held and open ones
    open, these the forces again by their slope: the iteration is linear, and starts in proportion
    to the forces; bodies without support move until these balance. NaN where nothing slides, so
    that no bound counts, or all bounds are given, where it ends at once, and where what is held
    does not hold all bodies or holds a vertex twice.
    """
    if not problem.coefficient.any():
        return np.nan
    equations = Equations(problem, problem.states(z), problem.signs(z))
    held, slides = np.flatnonzero(equations.still), np.flatnonzero(equations.slides)
    if not len(slides):
        return np.nan
    pair, slope, slip = problem.pair[slides], equations.slope[slides], problem.n + slides
    solve = _held(problem, held)
    toward = problem.compliance[np.ix_(held, slip)]
    change, answer, sizes = z[slip], np.zeros(problem.rows), []
    for _ in range(rounds + 1):
        sizes.append(np.linalg.norm(change))
        if not sizes[-1] > np.finfo(float).tiny:
            return np.nan
        answer[held] = -solve(toward @ change, problem.motions[slip].T @ change)
        change = slope * answer[pair]
    # the first change is not yet one that the iteration makes
    return float((sizes[-1] / sizes[1]) ** (1 / (rounds - 1)))


def _held(problem: CoulombProblem, held: np.ndarray):
    """Forces on the rows `held` for their movements, with the work of all that bodies balance.

    NaN where these may move, or rows depend on one another.
    """
    C, R = problem.compliance[np.ix_(held, held)], problem.motions[held]
    if not problem.k:
        try:
            factor = cho_factor(C, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            return lambda moved, work: np.full(len(held), np.nan)
        return lambda moved, work: cho_solve(factor, moved, check_finite=False)
    root = np.sqrt(np.diag(C))
    alike = np.block([[C / np.outer(root, root), R / root[:, None] / problem.reach],
                      [(R / root[:, None] / problem.reach).T, np.zeros((problem.k, problem.k))]])
    factor, order, failed = lapack.dgetrf(alike)
    pivots = np.abs(np.diag(factor))
    if failed or pivots.min() <= SINGULAR * pivots.max():
        return lambda moved, work: np.full(len(held), np.nan)

    def forces(moved: np.ndarray, work: np.ndarray) -> np.ndarray:
        found, _ = lapack.dgetrs(factor, order, np.append(moved / root, work / problem.reach))
        return found[: len(held)] / root

    return forces
