"""Newton's method on the dense contact problem, where one solution is expected.

Then the way to it may be chosen by what it takes alone: complementarity.py has the methods.
"""

import numpy as np

from .complementarity import PARTS, approached, approached_once, approximation, newton
from .coulomb import ROUNDING, CoulombProblem


def only_solution(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """As `approached`, where a problem has one solution: by the ways that take least, in turn.

    Of several solutions they could end in another one. Loads of the step before leave a start in
    whose movements all nodes slide or turn: of it and the solution in the states of its forces the
    one nearer to the law is taken. As long as ever fewer nodes change their states Newton's method
    goes on; else approximations come first, as they have no pressures that friction depends on.
    """
    if not problem.coefficient.any():
        return approached(problem, start)
    start = _nearer(problem, start)
    z = newton(problem, start, narrowing=True)
    if z is not None:
        return z
    for part in PARTS:
        softer = problem.softer(part)
        z = approximation(softer, start)
        z = z if z is None else approached_once(softer, z)
        if z is not None:
            return z
    return approached(problem, start)


def _nearer(problem: CoulombProblem, start: np.ndarray) -> np.ndarray:
    """`start` z, or the solution in the states that its forces alone say, if nearer to the law."""
    along, bound = start[problem.n : problem.rows], problem.bounds(start)
    slides = np.abs(along) >= (1 - ROUNDING) * bound
    states = problem.states_of(start, np.where(slides, np.sign(along), 0.0))
    z = problem.solution_in(states, problem.signs(start))
    return start if z is None or problem.violation(z) >= problem.violation(start) else z
