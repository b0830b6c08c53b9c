"""Newton's method on the dense contact problem, where one solution is expected.

Then the way to it may be chosen by what it takes alone: complementarity.py and approximations.py
have the methods.
"""

import numpy as np

from .anderson import Anderson
from .approximations import approached, approximation
from .borders import NEARLY, on_border
from .complementarity import newton
from .coulomb import STICK, CoulombProblem
from .dependent_rows import by_yielding
from .nearby import nearly_in

NEAR = 0.1  # part of the nodes whose movements say another state than their forces, at most
SOFT = 0.03  # part of the rigidity by which movements count in approximations
APPROXIMATIONS = 6  # of friction bounds that come no nearer to the law by what is CLOSER
CLOSER = 0.9  # times the least violation of the law by those before
# compliance of springs, over that of a row: of softer ones less is left to be followed, of stiffer
# ones the first solution is sooner found. Of 270 lugs on pins that turn by 0.3 to 1.2 times what
# friction may carry the solution of 118 is found at 0.1, of 190 at 10, of 193 at 1e3
SPRINGS = 1e3
SOFTER = 10  # times as soft are the next ones, whose rest follows the bodies: they may glide far
FOLLOWED = 4  # times that it does


def only_solution(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """As `approached`, where a problem has one solution: by the way that takes least.

    Of several solutions it could end in another one. Near the solution Newton's method goes there
    as long as ever fewer nodes, or few, change their states. Else friction bounds are given first,
    as often as that comes nearer to the law, and movements count by little: a whole surface that
    closes or turns is far softer than each of its nodes, which would open and close in turn.
    """
    if problem.depends:
        return by_yielding(problem, start, only_solution)
    given, loose = start, problem.k and not start[: problem.n].any()
    if loose:
        start = _first(problem, start)
    if not problem.coefficient.any():
        return approached(problem, start)
    start = _nearer(problem, start)
    solution = _approximated(problem, start)
    if solution is None and loose:  # later it would hide that there may be several solutions
        solution = on_springs(problem, given)
    return approached(problem, start) if solution is None else solution


def _approximated(problem: CoulombProblem, z: np.ndarray) -> np.ndarray | None:
    """As `only_solution`, by Newton's method from z or from approximations by friction bounds.

    A solution z of which many movements say other states than forces is on the border of states.
    Bodies that glide wherever they touch, as many ways forth as back, are held by what rounding
    leaves: approximations come no nearer to the law than that, and the caller judges by residuals.
    """
    softer, bounds = problem.softer(SOFT), Anderson(np.dot, damping=1.0)
    near = np.count_nonzero(problem.states(z) != problem.states_by_forces(z)) <= NEAR * problem.n
    if problem.solves(z) and not near:
        return _exactly(problem, z)
    solution = _ended(problem, z) if near else None
    least, nearest, left = problem.violation(z), z, APPROXIMATIONS
    bound = before = problem.bounds(z)
    while solution is None and left > 0:
        z = approximation(softer, z, bound, before, nearly=True)
        if z is None:
            break
        solution, violation = _ended(problem, z), problem.violation(z)
        left = APPROXIMATIONS if violation < CLOSER * least else left - 1
        if violation <= least:
            least, nearest = violation, z
        before, bound = bound, np.maximum(bounds.next(bound, problem.bounds(z)), 0.0)
    return nearest if solution is None and problem.k and least <= NEARLY else solution


def on_springs(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """As `only_solution`, of bodies that nothing holds yet, from springs whose rest follows them.

    Friction bounds on the way to those of the solution need not suffice to hold them.
    """
    softnesses = np.median(1.0 / problem.rigidity) * SPRINGS * SOFTER ** np.arange(FOLLOWED)
    ends = (None if z is None else _ended(problem, z)
            for z in problem.along_springs(start, softnesses, only_solution))
    return next((end for end in ends if end is not None), None)


def _first(problem: CoulombProblem, start: np.ndarray) -> np.ndarray:
    """z where nothing presses yet and so nothing holds bodies without support: no system can be
    solved.

    Nodes that are all closed and stick hold them. From there that without the friction of pressures
    is nearer, if contact alone holds the bodies. The `start` where there is neither.
    """
    z = nearly_in(problem, np.full(problem.n, STICK), np.ones(problem.n))
    if z is None:
        return start
    smooth = newton(problem.under(problem.load, np.zeros(problem.m)), z, nearly=True)
    return z if smooth is None else smooth


def _ended(problem: CoulombProblem, z: np.ndarray) -> np.ndarray | None:
    """The solution that Newton's method goes to from z, to all digits."""
    z = newton(problem, z, narrowing=True, nearly=True)
    return None if z is None else on_border(problem, _exactly(problem, z))


def _exactly(problem: CoulombProblem, z: np.ndarray) -> np.ndarray:
    """A solution z to all digits, in the states that its forces say, or else its movements.

    These are rounding on the border between sticking and sliding, and others in every step.
    """
    for states in (problem.states_by_forces(z), problem.states(z)):
        exact = problem.solution_in(states, problem.signs(z))
        if problem.solves(exact):
            return exact
    return z


def _nearer(problem: CoulombProblem, start: np.ndarray) -> np.ndarray:
    """`start` z, or the solution in the states of its forces, if nearer to the law.

    Loads of the step before leave a start in whose movements all nodes slide or turn.
    """
    z = nearly_in(problem, problem.states_by_forces(start), problem.signs(start))
    return start if z is None or problem.violation(z) >= problem.violation(start) else z
