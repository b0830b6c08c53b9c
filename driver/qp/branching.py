"""Branch and bound over the states of contact nodes: a solution, or the proof that there is none.

Where bodies have no support Lemke's method may end on a ray although there is a solution, and where
there is none it cannot say so. In given states the law of contact and friction is linear; nodes
that are not decided yet obey what all of their states have in common,

    lambda_n >= 0,   over <= 0,   |lambda_t| <= c + F lambda_n.

Where this linear program has no solution, no states beyond those decided solve the problem. Else
Newton's method starts from its point, and the node whose law that violates most is decided next
(compare Fortuny-Amat, McCarl, J. Oper. Res. Soc. 32 (1981) on complementarity by branching).
Contact that can pull branches by the sign of lambda_n first, as F |lambda_n| is not convex.
"""

from dataclasses import dataclass

import numpy as np

from ..environment import PLAIN_PROGRAM, silenced
from .complementarity import BRIEFLY, newton
from .coulomb import CoulombProblem
from .scaled import Scaled

MOST_NODES = 60  # contact nodes up to which states are searched
PROGRAMS = 500  # linear programs in a search, at most: some seconds
ANY, APART, PRESSES, PULLS = range(4)  # of contact
STICKS, FORTH, BACK = range(1, 4)  # of friction; ANY
NOTHING = 1e-7  # of forces and movements of order one: what linear programs leave of zero
INFEASIBLE, UNENDED = 2, 1  # status of scipy's linear programs
# seconds in which HiGHS does not end a program of so few nodes where coefficients differ by many
# orders of magnitude: it goes round in circles. Others take hundredths of one
CIRCLES = 5.0


@dataclass
class Search:
    """What came of a search: `solution` z (n + m + k,) or None, which is `certain` or not."""

    solution: np.ndarray | None
    certain: bool


def search_states(problem: CoulombProblem) -> Search:
    """Look for a solution in all states.

    In the order of depth first, deterministic. Not certain where there are more than MOST_NODES, or
    more than PROGRAMS linear programs would be needed, or one has no end, or rounding hides a
    solution.
    """
    if problem.n > MOST_NODES:
        return Search(None, False)
    return _Search(problem).run()


class _Search(Scaled):
    """One search."""

    def __init__(self, problem: CoulombProblem):
        super().__init__(problem)
        self.endless = False  # a program has not come to an end
        self.signed = np.zeros(problem.n, bool)  # whether the sign of the force decides on friction
        self.signed[problem.pair] = problem.coefficient > 0

    def run(self) -> Search:
        """The search."""
        pulls = self.problem.bilateral
        first = np.where(pulls & ~self.signed, PULLS, ANY)
        left, hidden = [(first, np.zeros(self.problem.m, int))], False
        for _ in range(PROGRAMS):
            if not left:
                return Search(None, not hidden)
            contact, rub = left.pop()
            feasible, x = self._program(contact, rub)
            if self.endless:
                break
            if not feasible:
                continue
            if x is None:
                hidden = True
                continue
            solution = self._exact(x)
            if solution is not None:
                return Search(solution, True)
            ways = self._branches(contact, rub, x)
            hidden = hidden or not ways
            left += ways
        return Search(None, False)

    def _exact(self, x: np.ndarray) -> np.ndarray | None:
        """The solution that Newton's method comes to from the point of a linear program."""
        return newton(self.problem, self.exact(x), BRIEFLY)

    def _limits(self, contact: np.ndarray, rub: np.ndarray):
        """Lower and upper limits of the rows and of the unknowns."""
        problem, inf = self.problem, np.inf
        n, m, k = problem.n, problem.m, self.k
        pulls, here = problem.bilateral, contact[problem.pair]
        touching = pulls | (contact >= PRESSES)
        over = np.where(touching, 0.0, -inf), np.zeros(n)
        slip = (np.where((rub == STICKS) | (rub == FORTH), 0.0, -inf),
                np.where((rub == STICKS) | (rub == BACK), 0.0, inf))
        # with pull F |lambda_n| = -F lambda_n: the two rows change their roles
        o, pulled, free = self.offset, here == PULLS, pulls[problem.pair] & (here == ANY)
        upper = np.where(free | pulled, inf, o)  # of lambda_t - F lambda_n
        lower = np.where(free | pulled, -inf, -o)  # of lambda_t + F lambda_n
        pulled_low, pulled_high = np.where(pulled, -o, -inf), np.where(pulled, o, inf)
        # lambda_t = o + F |lambda_n| where it slides forth, its negative where it slides back
        forth, back = rub == FORTH, rub == BACK
        less_low = np.where(forth & ~pulled & ~free, o, pulled_low)
        less_high = np.where(back & pulled, -o, upper)
        more_low = np.where(forth & pulled, o, lower)
        more_high = np.where(back & ~pulled & ~free, -o, pulled_high)
        force_low = np.where(contact == PULLS, -inf, np.where(pulls & (contact == ANY), -inf, 0.0))
        force_high = np.where(contact == APART, 0.0, np.where(
            (contact == PULLS) & self.signed, 0.0, inf))
        row_low = np.concatenate([over[0] - self.given[:n], slip[0] - self.given[n:], less_low,
                                  more_low, self.work])
        row_high = np.concatenate([over[1] - self.given[:n], slip[1] - self.given[n:], less_high,
                                   more_high, self.work])
        rest = np.full(m + k, inf)
        return row_low, row_high, np.append(force_low, -rest), np.append(force_high, rest)

    def _program(self, contact: np.ndarray, rub: np.ndarray):
        """Whether states beyond these may solve the problem, and a point (n + m + k,) if one is
        known: that of least pressures and openings.
        """
        from scipy.optimize import Bounds, LinearConstraint, milp

        row_low, row_high, low, high = self._limits(contact, rub)
        n, undecided, over = self.problem.n, contact == ANY, self.over
        cost = -np.asarray(self.rows[:n][undecided].sum(axis=0)).ravel()
        cost[:n] += undecided & ~self.problem.bilateral
        for aim in (self.own * cost, 0.0 * cost):  # openings may be without end
            with silenced():
                answer = milp(aim, bounds=Bounds(low / self.own, high / self.own),
                              constraints=LinearConstraint(self.even, over * row_low,
                                                           over * row_high),
                              options={**PLAIN_PROGRAM, "time_limit": CIRCLES})
            if answer.status == INFEASIBLE:
                return False, None
            if answer.status == UNENDED:
                self.endless = True
                break
            if answer.x is not None:
                return True, self.own * answer.x
        return True, None

    def _branches(self, contact: np.ndarray, rub: np.ndarray, x: np.ndarray) -> list:
        """States with one more node decided, the likeliest last; none if x obeys every law."""
        problem, n = self.problem, self.problem.n
        moved = self.rows[: problem.rows] @ x + self.given
        normal, along = x[:n], x[n : problem.rows]
        over, slip = moved[:n], moved[n:]
        pulls, pair = problem.bilateral, problem.pair
        bound = self.offset + self.cone_matrix @ np.abs(normal)
        # of contact that pulls the bound is known with the sign of the force
        excess, missed = np.zeros(n), np.abs(along) - bound
        excess[pair] = np.where((rub == FORTH) | (rub == BACK), np.abs(missed), missed)
        wrong = np.where(pulls, excess, np.minimum(normal, -over))
        wrong = np.where(contact == ANY, wrong, 0.0)
        if wrong.max(initial=0.0) > NOTHING:
            node = int(wrong.argmax())
            ways = (PULLS, PRESSES) if pulls[node] else (APART, PRESSES)
            likely = normal[node] > (0.0 if pulls[node] else -over[node])
            return [(np.where(np.arange(n) == node, state, contact), rub)
                    for state in (ways if likely else ways[::-1])]
        missing = np.where(slip > 0, bound - along, bound + along)
        wrong = np.where(rub == ANY, np.minimum(missing, np.abs(slip)), 0.0)
        if wrong.max(initial=0.0) <= NOTHING:
            return []
        row = int(wrong.argmax())
        ways = (BACK, STICKS, FORTH) if slip[row] > 0 else (FORTH, STICKS, BACK)
        return [(contact, np.where(np.arange(len(rub)) == row, state, rub)) for state in ways]
