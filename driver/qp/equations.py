"""States of contact nodes, and what the law of contact and friction says of every row in them."""

from enum import IntEnum

import numpy as np


class State(IntEnum):
    """State of a node: open, or in contact and sticking or sliding by the sign of lambda_t.

    The negative of one in contact: open, and sticking or sliding by the friction bound's offset.
    """

    OPEN = 0
    STICK = 1
    FORWARD = 2
    BACKWARD = 3


# plain numbers: of others NumPy asks their class what they are, and drops interrupts that come then
OPEN, STICK, FORWARD, BACKWARD = (int(state) for state in State)


class Equations:
    """One equation a row of a CoulombProblem `problem` in given states.

    Rows (n + m,) that are `still` do not move, (C x - R beta)_i = d_i; of the others forces are
    given: zero of open nodes, slope lambda_n + given (m,) of those that slide. `slides` (m,) by
    their pressure, `bound` (m,) times |lambda_n|.
    """

    def __init__(self, problem, states: np.ndarray, sign: np.ndarray):
        """`states` and `sign` of lambda_n (n,)."""
        state = states[problem.pair]
        way = np.where(np.abs(state) == FORWARD, 1.0, -1.0)
        self.still = np.concatenate([states > OPEN, np.abs(state) == STICK])
        self.slides = state > STICK
        self.bound = np.where(self.slides, way * problem.coefficient, 0.0)
        self.slope = self.bound * sign[problem.pair]
        self.given = np.zeros(problem.m)
        if problem.offset is not None:
            self.given = np.where(np.abs(state) > STICK, way * problem.offset, 0.0)

    def unlike(self, other: "Equations") -> np.ndarray:
        """The rows whose left sides differ."""
        return np.flatnonzero((self.still != other.still) | np.append(
            np.zeros(len(self.still) - len(self.slope), bool), self.slope != other.slope))

    def left(self, problem, rows: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Left sides (len(rows), ...) of `rows` at x (n + m + k, ...)."""
        n, still = problem.n, self.still[rows]
        result, held = x[rows].copy(), rows[still]
        result[still] = problem.compliance[held] @ x[: problem.rows]
        if problem.k:
            result[still] -= problem.motions[held] @ x[problem.rows :]
        along = np.flatnonzero(~still & (rows >= n))
        t = rows[along] - n
        result[along] -= (self.slope[t] * x[problem.pair[t]].T).T
        return result

    def right(self, problem) -> np.ndarray:
        """Right sides (n + m,)."""
        return np.where(self.still, problem.load, np.append(np.zeros(problem.n), self.given))

    def put(self, problem, x: np.ndarray) -> None:
        """Give the forces in x (n + m,) that are given exactly, in place."""
        force = np.append(np.zeros(problem.n), self.bound * np.abs(x[problem.pair]) + self.given)
        x[~self.still] = force[~self.still]
