"""What is tried, in this order, where successive approximations do not contract.

1. Anderson acceleration of the same map, with its QPs: a few more products.
2. The contact rows alone, condensed: semismooth Newton from the last iterate, and where that does
   not settle Lemke's method, which finds a solution for any friction coefficient. It may fail for
   bodies without support and contact that pulls: then friction that grows from less, states that
   violate the law less and less, and branch and bound over all states.

Smaller steps are not among them: a time step has a solution whatever its size.
"""

from dataclasses import dataclass, field

import numpy as np

from ..qp import complementarity
from ..qp.branching import MOST_NODES, search_states
from ..qp.continuation import with_growing_friction
from ..qp.coulomb import CoulombProblem

ANDERSON = "Anderson acceleration"
NEWTON = "Newton on the condensed contact rows"
LEMKE = "Lemke's method"
CONTINUATION = "growing friction"
SEARCH = "a search of the states of contact nodes"
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

    def warnings(self) -> list[str]:
        """One line for every method that was used."""
        return [f"{method} found the solution where successive approximations of the friction "
                f"bound did not settle, from step {steps[0]} on in {len(steps)} of the steps"
                for method, steps in self.steps.items()]


def solve_condensed(problem: CoulombProblem, start: np.ndarray) -> tuple[np.ndarray | None, str]:
    """A solution z of the condensed problem, and the method that found it; None if none did."""
    ways = ((NEWTON, lambda: _newton_from_all_alike(problem)),
            (LEMKE, lambda: complementarity.lemke(problem)),
            (CONTINUATION, lambda: _with_growing_friction(problem, start)),
            (SEARCH, lambda: _descended(problem, start)),
            (SEARCH, lambda: search_states(problem, complementarity.newton).solution))
    if not problem.k and not problem.bilateral.any():
        ways = ways[1:]  # Lemke's method is sure to end, and looks at no state in vain
    z = complementarity.newton(problem, start)
    if z is not None:
        return z, NEWTON
    for method, look in ways:
        z = look()
        if z is not None:
            return z, method
    return None, ""


def _newton_from_all_alike(problem: CoulombProblem) -> np.ndarray | None:
    """The first solution that Newton comes to from all nodes sticking, sliding or open."""
    ends = (complementarity.newton(problem, z) for z in complementarity.all_alike(problem))
    return next((z for z in ends if z is not None), None)


def _with_growing_friction(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """A solution by way of less friction, where there are not too many nodes to look for one."""
    few = problem.n <= MOST_NODES and problem.coefficient.any()
    return with_growing_friction(problem, start) if few else None


def _descended(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """The first solution down from the start, or from all nodes alike."""
    if problem.n > MOST_NODES:
        return None
    ends = (complementarity.descend(problem, z)
            for z in (start, *complementarity.all_alike(problem)))
    return next((z for z in ends if z is not None), None)
