"""What is tried, in this order, where successive approximations do not contract.

1. Anderson acceleration of the same map, with its QPs: a few more products.
2. The contact rows alone, condensed: semismooth Newton from the last iterate, or from successive
   approximations beside it, and where that does not settle, for bodies without support, the same
   on springs that follow them; then Lemke's method, which finds a solution for any friction
   coefficient. It may fail for bodies without support and contact that pulls: then a path of
   solutions under loads that become the step's, states that violate the law less and less, and
   branch and bound over all states, which may prove that there is no solution; of more nodes than
   MOST_NODES all this among those that touch or nearly do (few_nodes.py). Where slip changes
   friction, a solution with given coefficients is the start for that with those of its own slip.

Smaller steps are not among them: a time step has a solution whatever its size.
"""

from dataclasses import dataclass, field

import numpy as np

from ..qp import approximations, complementarity
from ..qp.branching import MOST_NODES, search_states
from ..qp.continuation import at_the_end_of_a_path
from ..qp.coulomb import CoulombProblem
from ..qp.few_nodes import solution_among
from ..qp.one_solution import on_springs
from ..text import step_name

ANDERSON = "Anderson acceleration"
NEWTON = "Newton on the condensed contact rows"
SPRINGS = "soft springs that follow loose bodies"
LEMKE = "Lemke's method"
CONTINUATION = "a path of solutions under other loads"
SEARCH = "a search of the states of contact nodes"
NO_STATE = "none of all states"  # is a solution, which that search has proved
CONDENSED_NODES = 1000  # contact nodes up to which their compliance, a dense matrix, is made


@dataclass
class Fallbacks:
    """Steps in which each method was needed, by its name."""

    steps: dict[str, list[int]] = field(default_factory=dict)

    def note(self, method: str, step: int) -> None:
        """Record that `method` found the fixed point of `step`."""
        known = self.steps.setdefault(method, [])
        if step not in known:
            known.append(step)

    def of(self, step: int) -> bool:
        """Whether a `step` needed one."""
        return any(step in steps for steps in self.steps.values())

    def warnings(self) -> list[str]:
        """One line for every method that was used."""
        return [f"{method} found the solution where successive approximations of the friction "
                "bound did not converge, in "
                f"{_named(steps)}" for method, steps in self.steps.items()]


def _named(steps: list[int]) -> str:
    """One step by its number, several by the first of them."""
    return (step_name(steps[0]) if len(steps) == 1 else
            f"{len(steps)} steps from {step_name(steps[0])} on")


def solve_condensed(problem: CoulombProblem, start: np.ndarray) -> tuple[np.ndarray | None, str]:
    """A solution z of the condensed problem, and the method that found it; None if none did.

    With NO_STATE for the method where there is none.
    """
    z, method = followed(problem, start)
    return (z, method) if z is not None else searched(problem, start)


def followed(problem: CoulombProblem, start: np.ndarray) -> tuple[np.ndarray | None, str]:
    """As `solve_condensed` by what takes no more than seconds: Newton, springs, Lemke, a path."""
    if not problem.n:  # there is nothing to choose
        return (start, NEWTON) if problem.solves(start) else (None, "")
    z = approximations.approached(problem, start)
    if z is not None:
        return z, NEWTON
    ways = []
    if problem.n <= CONDENSED_NODES:  # each of its pivots, as many as rows, changes a dense matrix
        ways.append((LEMKE, lambda: complementarity.lemke(problem)))
    if problem.n <= MOST_NODES:
        ways.append((CONTINUATION, lambda: at_the_end_of_a_path(problem, start)))
    if problem.k:
        ways = [(SPRINGS, lambda: on_springs(problem, start)), *ways]
    if problem.k or problem.bilateral.any():  # else Lemke's method is sure to end
        ways = [(NEWTON, lambda: _newton_from_all_alike(problem)), *ways]
    for method, look in ways:
        z = look()
        if z is not None:
            return z, method
    return None, ""


def searched(problem: CoulombProblem, start: np.ndarray) -> tuple[np.ndarray | None, str]:
    """As `solve_condensed` by the searches that come last.

    Where no node meets anything there is one state, without forces.
    """
    if not problem.n:
        return None, NO_STATE
    if problem.n > MOST_NODES:
        return solution_among(problem, start, MOST_NODES, solve_condensed)
    z = _descended(problem, start)
    if z is not None:
        return z, SEARCH
    found = search_states(problem)
    return found.solution, NO_STATE if found.certain and found.solution is None else SEARCH


def _newton_from_all_alike(problem: CoulombProblem) -> np.ndarray | None:
    """The first solution that Newton comes to from all nodes sticking, sliding or open."""
    ends = (complementarity.newton(problem, z) for z in complementarity.all_alike(problem))
    return next((z for z in ends if z is not None), None)


def _descended(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """The first solution down from the start, or from all nodes sticking."""
    starts = start, *complementarity.all_alike(problem)[:1]
    ends = (complementarity.descend(problem, z) for z in starts)
    return next((z for z in ends if z is not None), None)
