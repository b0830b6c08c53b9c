"""What is tried, in this order, where successive approximations of the friction bound do not contract.

1. Anderson acceleration of the same map, with its QPs: a few more products.
2. The contact rows alone, condensed: semismooth Newton from the last iterate, and where that does not settle
   Lemke's method, which finds a solution for any friction coefficient.

Smaller steps are not among them: a time step has a solution whatever its size.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..qp import complementarity
from ..qp.coulomb import CoulombProblem

ANDERSON, NEWTON, LEMKE = "Anderson acceleration", "Newton on the condensed contact rows", "Lemke's method"
DEPTH = 4  # differences that Anderson acceleration combines
DAMPING = 0.5  # part of the map's own change that it takes
PATIENCE = 8  # its iterations without a change below half the best one
ACCELERATED = 40  # its iterations at most
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
        return [f"{method} found the solution where successive approximations of the friction bound did not settle, "
                f"from step {steps[0]} on in {len(steps)} of the steps" for method, steps in self.steps.items()]


class Anderson:
    """Anderson acceleration of a fixed-point map g -> map(g) (D. Anderson, J. ACM 12 (1965) 547-560).

    `dot` is the global scalar product of two rank's parts; `depth` differences are combined, those within `noise` of the
    others left out, and the part `damping` of the map's own change is taken.
    """

    def __init__(self, dot: Callable[[np.ndarray, np.ndarray], float], depth: int = DEPTH, damping: float = DAMPING,
                 noise: float = 1e-6):
        self.dot, self.depth, self.damping, self.noise = dot, depth, damping, noise
        self.points, self.changes = [], []

    def next(self, g: np.ndarray, mapped: np.ndarray) -> np.ndarray:
        """The next point from the latest pair g, map(g)."""
        self.points.append(g)
        self.changes.append(mapped - g)
        del self.points[: -self.depth - 1], self.changes[: -self.depth - 1]
        new = g + self.damping * self.changes[-1]
        moves = [(b - a, d - c) for a, b, c, d in zip(self.points, self.points[1:], self.changes, self.changes[1:])]
        if moves:
            gram = np.array([[self.dot(f, h) for _, h in moves] for _, f in moves])
            right = np.array([self.dot(f, self.changes[-1]) for _, f in moves])
            share = np.linalg.lstsq(gram, right, rcond=self.noise**2)[0]
            new = new - sum(s * (p + self.damping * f) for s, (p, f) in zip(share, moves))
        return new


def gives_up(changes: list[float]) -> bool:
    """Whether `changes` of an accelerated iteration show no headway, or are too many."""
    best = int(np.argmin(changes))
    halved = [k for k in range(len(changes)) if changes[k] < 0.5 * min(changes[:k], default=np.inf)]
    return len(changes) >= ACCELERATED or len(changes) - 1 - max(best if not halved else halved[-1], 0) >= PATIENCE


def solve_condensed(problem: CoulombProblem, start: np.ndarray) -> tuple[np.ndarray | None, str]:
    """A solution z of the condensed problem, and the method that found it; None if none did."""
    for method, find in ((NEWTON, lambda: complementarity.newton(problem, start)),
                         (LEMKE, lambda: complementarity.lemke(problem))):
        x = find()
        if x is not None:
            return x, method
    return None, ""
