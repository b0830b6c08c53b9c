"""Whether a step has a solution, by a search of the states of the contact nodes.

Open, in contact, sticking, sliding either way: in given states contact and friction are linear
equations and inequalities of forces and rigid motions. Nodes whose state is not yet decided obey
what holds in each of them: no tension, no penetration, friction inside its bound. Where the linear
program of some decided nodes has no solution, the states of the others need not be tried; else the
node whose law is violated most is decided next (branch and bound). No bound on forces or
displacements is needed.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csc_matrix

from ..environment import PLAIN_PROGRAM, silenced
from .slip_limits import SlipLimits

UNDECIDED, OPEN, PRESSES, PULLS = range(4)
STICKS, FORTH, BACK, RESTS = range(1, 5)  # of friction, 0: undecided; RESTS: see `States`
INFEASIBLE = 2  # status of scipy's linear programs
ENOUGH = 0.95  # part of the width of limits below which it is worth tightening them once more
NOTHING = 1e-7  # of forces and displacements of order one: what linear programs leave of zero


@dataclass(frozen=True)
class States:
    """A step in units in which forces and displacements are of order one; n nodes, m motions.

    `movement` (2n, 2n + m): over the gap and slip by forces on the body along n, then t, and by
    rigid motions; over = movement - `room` (n,), slip = movement - `start` (n,). The friction bound
    lies between `least` (n,) and `most` (n,) times the pressure, and `offset` (n,) is added.
    `balance` (m, 2n) times the forces is -`load` (m,). `pulls` (n,): contact is bilateral.
    `corners` (n, n): nodes are conditions at one vertex, which rests where it closes all of them,
    its friction anywhere inside the bounds. `reach` (2, n): least and largest normal force where
    they are known. There F |f_n| is at most the chord between the two, however contact pulls: a
    cone of unknown sign is convex as well, and programs tighten these limits in turn. `slips`
    (2, n): least and largest slip, by which `law` narrows the limits of friction.
    """

    movement: np.ndarray
    room: np.ndarray
    start: np.ndarray
    least: np.ndarray
    most: np.ndarray
    offset: np.ndarray
    balance: np.ndarray
    load: np.ndarray
    pulls: np.ndarray
    corners: np.ndarray
    reach: np.ndarray | None = None
    law: SlipLimits | None = None
    slips: np.ndarray | None = None

    @cached_property
    def _rows(self) -> csc_matrix:
        """Over, slip, tangential plus and minus `most`, then `least` times normal force, balance.
        """
        n, m = len(self.room), len(self.load)
        unit, none = np.eye(n), np.zeros((n, m))
        cones = [np.hstack([sign * np.diag(of), unit, none])
                 for of in (self.most, self.least) for sign in (1.0, -1.0)]
        chords = [] if self.reach is None else [
            np.hstack([sign * np.diag(self.most * self._chord[0]), unit, none])
            for sign in (1.0, -1.0)]
        return csc_matrix(np.vstack([self.movement, *cones, *chords,
                                     np.hstack([self.balance, np.zeros((m, m))])]))

    @cached_property
    def _even(self) -> tuple[np.ndarray, np.ndarray, csc_matrix]:
        """What rows and unknowns are multiplied by, and the rows then: entries of like size.

        With friction of a thousand times the pressure beside rows of order one a program may end
        without an answer.
        """
        rows, n = self._rows.toarray(), len(self.room)
        over = np.ones(len(rows))
        over[2 * n : len(rows) - len(self.load)] /= np.maximum(
            np.abs(rows[2 * n : len(rows) - len(self.load)]).max(axis=1, initial=0.0), 1.0)
        rows = over[:, None] * rows
        largest = np.abs(rows).max(axis=0, initial=0.0)
        own = 1.0 / np.where(largest > 0, largest, 1.0)
        return over, own, csc_matrix(rows * own)

    def _program(self, cost: np.ndarray, low, high, least, largest):
        """Status, unknowns or None, and value of the linear program of least `cost`."""
        over, own, rows = self._even
        answer = milp(own * cost, bounds=Bounds(least / own, largest / own), options=PLAIN_PROGRAM,
                      constraints=LinearConstraint(rows, over * low, over * high))
        return answer.status, None if answer.x is None else own * answer.x, answer.fun

    @property
    def _chord(self) -> tuple[np.ndarray, np.ndarray]:
        """Slope and height (n,) of the chord that |f_n| is under within its reach."""
        low, high = self.reach
        slope = (np.abs(high) - np.abs(low)) / (high - low)
        return slope, np.abs(low) - slope * low

    def search(self, programs: int) -> bool | None:
        """Whether some states solve the step; None if that takes more than so many programs."""
        with silenced():
            tightened = self._tightened()
            return False if tightened is None else tightened._search(programs)

    def _tightened(self) -> "States | None":
        """The step with limits of normal forces as its programs know them; None if it has none."""
        step, nothing = self, np.zeros(len(self.room), int)
        while step.reach is not None:
            low, high = step.reach
            limits, ends = step._limits(step._signs, nothing), []
            for sign, known in ((1.0, low), (-1.0, high)):
                for node, value in enumerate(known):
                    cost = np.zeros(len(limits[-1]))
                    cost[node] = sign
                    status, x, least = step._program(cost, *limits)
                    if status == INFEASIBLE:
                        return None
                    ends.append(value if x is None else sign * max(least - NOTHING, sign * value))
            reach = np.reshape(ends, (2, -1))
            idle = np.ptp(reach, axis=0).sum() > ENOUGH * np.ptp(step.reach, axis=0).sum()
            step = replace(step, reach=reach)
            if idle:
                break
        return step

    @property
    def _signs(self) -> np.ndarray:
        """States of contact that are known at the start: no sign where it decides nothing."""
        signs = np.where(self.pulls & (self.most == 0), PRESSES, UNDECIDED)
        if self.reach is not None:
            low, high = self.reach
            rubs = self.pulls & (self.most > 0)
            signs = np.where(rubs & (high <= 0), PRESSES, np.where(rubs & (low >= 0), PULLS, signs))
        return signs

    def _search(self, programs: int) -> bool | None:
        """As `search`, within the limits that are known."""
        tried, lost = 0, False
        left = [(self, self._signs, np.zeros(len(self.room), int))]
        while left:
            if tried >= programs:
                return None
            tried += 1
            step, normal, rub = left.pop()
            step = step._narrowed(rub)
            feasible, x = step._solved(normal, rub)
            if not feasible:
                continue
            node, tangential = step._next(normal, rub, x)
            if node is not None:
                left += [(step, *states) for states in step._decided(
                    normal, rub, node, tangential, x)]
                continue
            parts = [] if x is None else step._by_slip(normal, rub, x)
            if x is not None and not parts:
                return True
            lost = lost or x is None
            left += [(part, normal, rub) for part in parts]
        return None if lost else False

    def _narrowed(self, rub: np.ndarray) -> "States":
        """The step with the friction that slip of these states can give."""
        if self.law is None:
            return self
        low = np.where((rub == STICKS) | (rub == FORTH), 0.0, -np.inf)
        high = np.where((rub == STICKS) | (rub == BACK), 0.0, np.inf)
        low, high = np.maximum(low, self.slips[0]), np.minimum(high, self.slips[1])
        least, most = self.law.within(low, np.maximum(low, high))
        return replace(self, least=least, most=most, slips=np.array([low, high]))

    def _by_slip(self, normal: np.ndarray, rub: np.ndarray, x: np.ndarray) -> list["States"]:
        """The step with less slip, and with more, of the node whose friction is off the law most.

        None if all have the friction of their slip. Programs know limits of that slip first.
        """
        if self.law is None:
            return []
        n = len(normal)
        slip, along = (self._rows[n : 2 * n] @ x) - self.start, np.abs(x[n : 2 * n])
        bound = self.law.at(slip) * np.abs(x[:n]) + self.offset
        slides = (rub == FORTH) | (rub == BACK)
        wrong = np.where(slides, np.abs(along - bound), along - bound)
        if wrong.max(initial=0.0) <= NOTHING:
            return []
        node = int(wrong.argmax())
        low, high = self._slip_of(node, normal, rub)
        return self._divided(node, low, high, slip[node])

    def _divided(self, node: int, low: float, high: float, near: float) -> list["States"]:
        """The step with slip of a node from `low` to about `near`, and from there to `high`."""
        end = self.law.end(node)  # beyond which friction no longer changes
        inner = np.clip([low, high], -end, end)
        near = np.clip(near, *(inner + np.array([0.25, -0.25]) * (inner[1] - inner[0])))
        parts = []
        for ends in ((low, near), (near, high)):
            slips = self.slips.copy()
            slips[:, node] = ends
            parts.append(replace(self, slips=slips))
        return parts

    def _limits(self, normal: np.ndarray, rub: np.ndarray):
        """Limits of the rows and of the unknowns in some states."""
        inf, o, closed = np.full(len(normal), np.inf), self.offset, normal >= PRESSES
        presses, pulled = normal == PRESSES, normal == PULLS
        sided = presses | ~self.pulls  # the friction cone is that of pressure
        over = np.where((closed | self.pulls) & ~np.isinf(self.room), self.room, -np.inf)
        slip = (np.where((rub == STICKS) | (rub == FORTH), self.start, -inf),
                np.where((rub == STICKS) | (rub == BACK), self.start, inf))
        if self.law is not None:
            slip = (np.maximum(slip[0], self.start + self.slips[0]),
                    np.minimum(slip[1], self.start + self.slips[1]))
        # most f_n + f_t, -most f_n + f_t; the same with the least
        low = [over, slip[0], np.where(pulled, -o, -inf), np.where(sided, -o, -inf),
               np.where((rub == BACK) & sided, o, -inf), np.where((rub == BACK) & pulled, o, -inf)]
        high = [self.room, slip[1], np.where(sided, o, inf), np.where(pulled, o, inf),
                np.where((rub == FORTH) & pulled, -o, inf),
                np.where((rub == FORTH) & sided, -o, inf)]
        motions = np.full(len(self.load), np.inf)
        least = np.where(pulled | (normal == OPEN), 0.0, -inf)
        largest = np.where(pulled | (self.pulls & ~presses) | (self.pulls & (self.most == 0)),
                           inf, 0.0)
        least = np.where(self.pulls & (self.most == 0), -inf, least)
        if self.reach is not None:
            under = o + self.most * self._chord[1]
            low, high = [*low, -under, -inf], [*high, inf, under]
            least, largest = np.maximum(least, self.reach[0]), np.minimum(largest, self.reach[1])
        return (np.concatenate([*low, -self.load]), np.concatenate([*high, -self.load]),
                np.concatenate([least, -inf, -motions]), np.concatenate([largest, inf, motions]))

    def _solved(self, normal: np.ndarray, rub: np.ndarray):
        """Whether the linear program may have a solution, and forces and motions if it was solved.

        Of all solutions that with the least pressures and openings of nodes not yet decided.
        """
        limits, n, undecided = self._limits(normal, rub), len(normal), normal == UNDECIDED
        aim = -np.asarray(self._rows[:n][undecided].sum(axis=0)).ravel()
        aim[:n][undecided & ~self.pulls] -= 1.0
        for cost in (aim, 0.0 * aim):  # which rounding may keep it from, or openings without end
            status, x, _ = self._program(cost, *limits)
            if status == INFEASIBLE:
                return False, None
            if x is not None:
                return True, x
        return True, None

    def _slip_of(self, node: int, normal: np.ndarray, rub: np.ndarray) -> tuple[float, float]:
        """Least and largest slip of a node in some states."""
        limits = self._limits(normal, rub)
        cost, ends = self.movement[len(normal) + node], list(self.slips[:, node])
        for end, sign in enumerate((1.0, -1.0)):
            _, x, least = self._program(sign * cost, *limits)
            if x is not None:
                known = sign * (least - NOTHING) - self.start[node]
                ends[end] = max(ends[end], known) if sign > 0 else min(ends[end], known)
        return ends[0], max(ends)

    def _next(self, normal: np.ndarray, rub: np.ndarray, x: np.ndarray | None):
        """Node that is decided next and whether by its friction; None where all obey their law."""
        n = len(normal)
        if x is None:  # unknown to rounding: any that is left
            touching, rubbing = normal == UNDECIDED, (rub == 0) & (normal >= PRESSES)
            which = touching if touching.any() else rubbing
            return (int(which.argmax()), not touching.any()) if which.any() else (None, False)
        moved, force, along = self._rows[: 2 * n] @ x, np.abs(x[:n]), x[n : 2 * n]
        open_by, slip = self.room - moved[:n], moved[n:] - self.start
        most, least = self.most * force + self.offset, self.least * force + self.offset
        # where contact pulls, sliding friction is known with the sign of the force
        excess = np.where((rub == FORTH) | (rub == BACK), np.maximum(
            np.abs(along) - most, least - np.abs(along)), np.abs(along) - most)
        beside = np.where(self.pulls, excess, np.minimum(-x[:n], open_by))
        beside = np.where(normal == UNDECIDED, beside, 0.0)
        if beside.max(initial=0.0) > NOTHING:
            return int(beside.argmax()), False
        missing = np.where(slip > 0, along + least, least - along)
        wrong = np.where((rub == 0) & (most > NOTHING), np.minimum(missing, np.abs(slip)), 0.0)
        return (int(wrong.argmax()), True) if wrong.max(initial=0.0) > NOTHING else (None, False)

    def _decided(self, normal, rub, node: int, tangential: bool, x) -> list:
        """The states that are left, with `node` decided; the likeliest last."""
        ways, n, others = [], len(normal), self.corners[node]
        if not tangential:
            pressed = x is None or -x[node] > self.room[node] - (self._rows[node] @ x)[0]
            choices = (PULLS, PRESSES) if self.pulls[node] else (OPEN, PRESSES)
            for state in choices if pressed else choices[::-1]:
                ways.append((np.where(np.arange(n) == node, state, normal), rub))
            return ways
        slip = 0.0 if x is None else (self._rows[n + node] @ x)[0] - self.start[node]
        for state in (RESTS, BACK, STICKS, FORTH) if slip > 0 else (RESTS, FORTH, STICKS, BACK):
            touching = normal
            if state == RESTS:
                if not others.any() or self.offset[node] == 0 and (
                        (normal == OPEN)[others].any() or normal[node] == OPEN):
                    continue
                if self.offset[node] == 0:
                    closed = others | (np.arange(n) == node)
                    touching = np.where(closed & (normal == UNDECIDED), PRESSES, normal)
            ways.append((touching, np.where(np.arange(n) == node, state, rub)))
        return ways
