"""Whether a time step with Coulomb friction has other solutions than the one found.

Without friction, and with given friction bounds, a step is a strictly convex problem. With
Coulomb's law it has one solution where the coefficient is small; how small depends on the body and
on the mesh (J. Haslinger, R. Kucera, O. Vlach, Bifurcations in contact problems with local Coulomb
friction, ENUMATH 2007). On the condensed contact rows other solutions are looked for, all of them
where the nodes are few.

There is a proof that a step has one solution without friction, and where the nodes are so few that
all their states were tried: if no singular linear system among theirs may hide solutions that are
not isolated. Coefficients that depend on slip or displacement are other ones at other solutions,
which are not looked for.
"""

from dataclasses import dataclass, field

import numpy as np

from ..qp import complementarity
from ..qp.complementarity import FEW
from ..qp.coulomb import OPEN, ROUNDING, STICK, CoulombProblem
from .globalization import CONDENSED_NODES

SMALL = 64  # contact nodes up to which a doubtful step is examined without being asked for
# Plane problems of a half-plane are known to have a solution up to F = sqrt(3 - 4 nu) / (2 - 2 nu)
# (C. Eck, J. Jarusek, Math. Models Meth. Appl. Sci. 8 (1998) 445-468); this is its least value,
# that of nu = 0
DOUBTFUL_FRICTION = np.sqrt(3) / 2
CHANGING = ("friction depends on slip or displacement, so other solutions would solve another "
            "problem")
YIELDING = ("surfaces yield or wear under pressure, so other solutions would solve another problem")


def worthwhile(choice: str, nodes: int, friction: float, doubtful: bool) -> bool:
    """Whether a step is to be examined: by `choice`, or by doubt about a small problem."""
    if choice != "auto":
        return choice == "yes"
    return nodes <= FEW or nodes <= SMALL and (doubtful or friction > DOUBTFUL_FRICTION)


def too_many(nodes: int) -> str:
    """Why so many contact nodes are not examined, empty if they are."""
    if nodes <= CONDENSED_NODES:
        return ""
    return f"{nodes} contact nodes, more than {CONDENSED_NODES}"


@dataclass
class Uniqueness:
    """What was found out over the steps of a run."""

    frictional: bool  # Coulomb friction with a coefficient above zero: else there is one solution
    examined: int = 0
    exhaustive: int = 0
    several: dict[int, list[dict]] = field(default_factory=dict)  # by step, the followed one first
    failure: str = ""
    first_only: bool = False  # no step after the first one that has others is examined

    @property
    def ended(self) -> bool:
        """Whether no more is looked for."""
        return bool(not self.frictional or self.failure or self.first_only and self.several)

    def examine(self, step: int, problem: CoulombProblem, x: np.ndarray,
                weight: np.ndarray, whole: bool = True, least: float = 0.0) -> None:
        """Look for solutions with other forces than x (n + m,); `weight` (n,) of the nodes.

        `whole`: whether the problem has all states of all nodes, not one of those of corners.
        Forces of a norm up to `least` are rounding, as are those that the law is open to.
        """
        self.examined += 1
        # exact to rounding, to distinguish it from the others
        mine = complementarity.newton(problem, problem.whole(x))
        if mine is None or np.abs(mine[: problem.rows] - x).max() > 1e-2 * np.abs(x).max():
            mine = problem.whole(x)
        all_of_them = problem.n <= FEW and not problem.bilateral.any()
        if all_of_them:
            solutions = complementarity.all_solutions(problem)
            self.exhaustive += whole and complementarity.all_isolated(problem)
        else:
            solutions = complementarity.search(problem, mine)
        forces = np.array([y[: problem.rows] for y in (mine, *solutions)])
        least = max(least, np.sqrt(problem.rows) * ROUNDING * max(map(problem.scale, forces)))
        apart = np.abs(forces[1:] - forces[0]).max(axis=1, initial=0)
        size = np.abs(forces).max(initial=0.0)
        norm = np.linalg.norm(forces[1:] - forces[0], axis=1)
        others = [y for y, distance, differs in zip(solutions, apart, norm > least)
                  if differs and distance > 1e-3 * size]
        # the sign of one solution implies others only where a solution is sure to exist
        tells = np.linalg.norm(forces[0]) > least and not problem.k
        if others or tells and complementarity.index(problem, mine) < 0:
            self.several[step] = [_describe(problem, y, weight) for y in (mine, *others)]

    @property
    def verdict(self) -> str:
        """unique, not unique, no second solution found, or not examined."""
        if not self.frictional:
            return "unique"
        if self.several:
            return "not unique"
        if not self.examined or self.failure:
            return "not examined"
        return "unique" if self.exhaustive == self.examined else "no second solution found"

    def summary(self) -> dict:
        """Entry of summary.json."""
        first = next(iter(self.several), None)
        return {"verdict": self.verdict, "steps_examined": self.examined,
                "steps_not_unique": list(self.several), "solutions": self.several.get(first, [])}

    def warnings(self) -> list[str]:
        """One line if there are other solutions or they could not be looked for."""
        lines = [f"uniqueness was not examined: {self.failure}"] if self.failure else []
        if self.several:
            step, solutions = next(iter(self.several.items()))
            named = "; ".join(_phrase(s) for s in solutions)
            others = " and others" if len(self.several) > 1 else ""
            more = " (UNIQUENESS=yes examines later steps as well)" if self.first_only else ""
            lines.append(f"step {step}{others}: the solution is not unique{more}; the run follows "
                         f"the first of: {named}")
        return lines


def _describe(problem: CoulombProblem, z: np.ndarray, weight: np.ndarray) -> dict:
    """Numbers that distinguish solutions."""
    states, x = problem.states(z), z[: problem.rows]
    return {"open": int(np.sum(states <= OPEN)), "stick": int(np.sum(states == STICK)),
            "slip": int(np.sum(states > STICK)), "resultant_n": float(-x[: problem.n].sum()),
            "resultant_t": float(-x[problem.n :].sum()),
            "largest_nodal_pressure": float((x[: problem.n] / weight).max(initial=0)),
            "index": complementarity.index(problem, z)}


def _phrase(s: dict) -> str:
    return (f"{s['open']} open, {s['stick']} stick, {s['slip']} slip, contact force "
            f"{s['resultant_n']:.4g} normal {s['resultant_t']:.4g} tangential")
