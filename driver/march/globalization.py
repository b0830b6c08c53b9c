"""What is tried, in this order, where successive approximations do not contract.

1. Anderson acceleration of the same map, with its QPs: a few more products.
2. The contact rows alone, condensed: semismooth Newton from the last iterate, and where that does
   not settle Lemke's method, which finds a solution for any friction coefficient.

Smaller steps are not among them: a time step has a solution whatever its size.
"""

from dataclasses import dataclass, field

import numpy as np

from ..qp import complementarity
from ..qp.coulomb import CoulombProblem

ANDERSON = "Anderson acceleration"
NEWTON = "Newton on the condensed contact rows"
LEMKE = "Lemke's method"
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
    for method, find in ((NEWTON, lambda: complementarity.newton(problem, start)),
                         (LEMKE, lambda: complementarity.lemke(problem))):
        x = find()
        if x is not None:
            return x, method
    return None, ""
