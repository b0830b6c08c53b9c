"""Newton's method on the dense contact problem, where one solution is expected.

Then the way to it may be chosen by what it takes alone: complementarity.py has the methods.
"""

import numpy as np

from .anderson import Anderson
from .borders import on_border
from .complementarity import approached, approximation, newton
from .coulomb import ROUNDING, STICK, CoulombProblem
from .dependent_rows import by_yielding
from .nearby import nearly_in

NEAR = 0.1  # part of the nodes whose movements say another state than their forces, at most
SOFT = 0.03  # part of the rigidity by which movements count in approximations
APPROXIMATIONS = 3  # of friction bounds that come no nearer to the law by what is CLOSER
CLOSER = 0.9  # times the least violation of the law by those before


def only_solution(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """As `approached`, where a problem has one solution: by the way that takes least.

    Of several solutions it could end in another one. Near the solution Newton's method goes there
    as long as ever fewer nodes, or few, change their states. Else friction bounds are given first,
    as often as that comes nearer to the law, and movements count by little: a whole surface that
    closes or turns is far softer than each of its nodes, which would open and close in turn.
    """
    if problem.depends:
        return by_yielding(problem, start, only_solution)
    if problem.k and not start[: problem.n].any():
        start = _touching(problem, start)
    if not problem.coefficient.any():
        return approached(problem, start)
    z = start = _nearer(problem, start)
    softer = problem.softer(SOFT)
    near = np.count_nonzero(problem.states(z) != _of_forces(problem, z)) <= NEAR * problem.n
    solution = _ended(problem, z) if near else None
    least, left = problem.violation(z), APPROXIMATIONS
    bound, method = problem.bounds(z), Anderson(np.dot, damping=1.0)
    while solution is None and left > 0:
        z = approximation(softer, z, bound, nearly=True)
        if z is None:
            break
        solution, violation = _ended(problem, z), problem.violation(z)
        left = APPROXIMATIONS if violation < CLOSER * least else left - 1
        least = min(least, violation)
        bound = np.maximum(method.next(bound, problem.bounds(z)), 0.0)
    return approached(problem, start) if solution is None else solution


def _touching(problem: CoulombProblem, start: np.ndarray) -> np.ndarray:
    """z with all nodes closed and sticking, or the `start` where there is none.

    Where nothing presses yet nothing holds bodies without support, and no system can be solved.
    """
    z = nearly_in(problem, np.full(problem.n, STICK), np.ones(problem.n))
    return start if z is None else z


def _ended(problem: CoulombProblem, z: np.ndarray) -> np.ndarray | None:
    """The solution that Newton's method goes to from z, to all digits."""
    z = newton(problem, z, narrowing=True, nearly=True)
    exact = None if z is None else problem.solution_in(problem.states(z), problem.signs(z))
    return on_border(problem, exact) if problem.solves(exact) else z


def _of_forces(problem: CoulombProblem, z: np.ndarray) -> np.ndarray:
    """(n,) states that the forces in z alone say."""
    along, bound = z[problem.n : problem.rows], problem.bounds(z)
    slides = np.abs(along) >= (1 - ROUNDING) * bound
    return problem.states_of(z, np.where(slides, np.sign(along), 0.0))


def _nearer(problem: CoulombProblem, start: np.ndarray) -> np.ndarray:
    """`start` z, or the solution in the states of its forces, if nearer to the law.

    Loads of the step before leave a start in whose movements all nodes slide or turn.
    """
    z = nearly_in(problem, _of_forces(problem, start), problem.signs(start))
    return start if z is None or problem.violation(z) >= problem.violation(start) else z
