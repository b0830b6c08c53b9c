"""Solutions of a step by Newton's method on the states of the contact nodes, from random ones.

Dense complementarity on the assembled body (P. Alart, A. Curnier, Comput. Methods Appl. Mech. Eng.
92 (1991) 353-375): in given states contact and friction are linear equations; forces and ways that
solve them say which states are to be next. Nothing is shown where no start leads to a solution, but
of steps that have one next to none escape: see tests/hard/test_trials.py.
"""

import numpy as np

from .states import States

PASSES = 60  # of Newton's method from one start
SOLVED = 1e-7  # violation of forces and ways of order one
SINGULAR = 1e-12  # part of what acts below which states leave forces or motions open


def solution(states: States, starts: int, seed: int = 0) -> np.ndarray | None:
    """Forces and motions (2n + m,) that solve the step, None where no start leads to any."""
    trial, dice = _Trial(states), np.random.default_rng(seed)
    for _ in range(starts):
        x = trial.from_states(*trial.drawn(dice), dice)
        if x is not None:
            return x
    return None


class _Trial:
    """Newton's method for one step.

    States are `closed` (n,), the `side` (n,) that closed nodes are on, 1 where they press and -1
    where they pull, and the `way` (n,) that nodes slide, 0 where they stick.
    """

    def __init__(self, states: States):
        self.states, self.n = states, len(states.room)
        self.smooth = (states.most == 0) & (states.offset == 0)
        self.held = ~np.isfinite(states.room)  # supports leave no way along n
        self.room = np.where(self.held, 0.0, states.room)

    def drawn(self, dice) -> tuple:
        """Random states: few or many nodes closed, sticking."""
        n, pulls = self.n, self.states.pulls
        closed = pulls | (dice.random(n) < dice.choice([0.2, 0.5, 0.8, 1.0]))
        side = np.where(pulls & (dice.random(n) < 0.5), -1, 1)
        sticks = dice.random(n) < dice.choice([0.0, 0.3, 0.7, 1.0])
        return closed, side, np.where(sticks, 0, dice.choice([-1, 1], n))

    def from_states(self, closed, side, way, dice) -> np.ndarray | None:
        """Forces and motions of a solution, None where passes come to no end or go in circles."""
        friction, seen = self.states.most, set()
        for _ in range(PASSES):
            way = np.where(self.smooth, 1, way)
            known = closed.tobytes() + side.tobytes() + way.tobytes()
            if known in seen and self.states.law is None:
                way = way.copy()  # in circles: out of them by chance
                way[dice.integers(self.n)] = dice.integers(-1, 2)
            seen.add(known)
            rests = self._resting(closed)
            x = self._solved(closed, side, way, rests, friction)
            over, slip, press, along = found = self._found(x)
            if self.states.law is not None:
                friction = self.states.law.at(slip)
            bound = friction * np.abs(press) + self.states.offset
            if self._wrong(closed, side, way, rests, bound, found, x) <= SOLVED:
                return x
            trial = along - slip
            closed = self.states.pulls | (press + over > 0)
            side = np.where(self.states.pulls & (press < 0), -1, 1)
            reach = np.where(self.states.pulls, bound, friction * np.maximum(press + over, 0.0)
                             + self.states.offset)
            way = np.where(np.abs(trial) <= reach, 0, np.where(trial < 0, 1, -1))
        return None

    def _resting(self, closed: np.ndarray) -> np.ndarray:
        """(n,) nodes that stand in their corner, whose friction is any inside the bound: none."""
        corners = self.states.corners
        return closed & corners.any(axis=1) & ~(corners & ~closed).any(axis=1)

    def _solved(self, closed, side, way, rests, friction) -> np.ndarray:
        """What solves the linear equations of some states; the least where they leave it open."""
        states, n, node = self.states, self.n, np.arange(self.n)
        A, b = np.zeros((2 * n + len(states.load),) * 2), np.zeros(2 * n + len(states.load))
        kept = closed & ~self.held
        A[:n], b[:n] = kept[:, None] * states.movement[:n], np.where(kept, self.room, 0.0)
        A[node[~kept], node[~kept]] = 1.0
        sticks = (way == 0) & ~rests
        A[n : 2 * n] = sticks[:, None] * states.movement[n:]
        b[n : 2 * n] = np.where(sticks, states.start, np.where(rests, 0.0, -way * states.offset))
        A[n + node[~sticks], n + node[~sticks]] = 1.0
        A[n + node[~sticks], node[~sticks]] = -(~rests * way * friction * side)[~sticks]
        A[2 * n :, : 2 * n], b[2 * n :] = states.balance, -states.load
        size = np.abs(A).max(axis=1, initial=0.0)
        size[size == 0] = 1.0
        A, b = A / size[:, None], b / size
        try:
            x = np.linalg.solve(A, b)
            if np.abs(x).max(initial=0.0) < 1 / SINGULAR:
                return x
        except np.linalg.LinAlgError:
            pass
        return np.linalg.lstsq(A, b, rcond=SINGULAR)[0]

    def _found(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """(n,) each: overlap, slip, pressing force and tangential force."""
        n, states = self.n, self.states
        moved = states.movement @ x
        return (np.where(self.held, 0.0, moved[:n] - self.room), moved[n:] - states.start,
                -x[:n], x[n : 2 * n])

    def _wrong(self, closed, side, way, rests, bound, found, x) -> float:
        """Largest violation of what the states do not solve for, equations left open among it."""
        states, (over, slip, press, along) = self.states, found
        pulls, rubs = states.pulls, ~self.smooth
        normal = np.where(pulls, np.where(rubs & (way != 0), np.maximum(-side * press, 0.0), 0.0),
                          np.where(closed, np.maximum(-press, np.abs(over)),
                                   np.maximum(over, np.abs(press))))
        beyond = np.maximum(np.abs(along) - bound, 0.0)
        sliding = np.maximum(np.abs(along + way * bound), rubs * np.maximum(-way * slip, 0.0))
        tangential = np.where(rests, beyond, np.where(way == 0, np.maximum(beyond, np.abs(slip)),
                                                      sliding))
        net = states.balance @ x[: 2 * self.n] + states.load
        return max(np.abs(part).max(initial=0.0)
                   for part in (normal, np.where(pulls & ~self.held, over, 0.0), tangential, net))
