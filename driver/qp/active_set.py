"""Contact under given friction bounds: forces within bounds that minimize a convex energy.

Of such a problem Newton's method changes all rows at once that the present states leave out of
their bounds or moving the wrong way, and may come back to the same states for ever: a body that
rocks opens where it has closed. Here every step lowers the energy: the primal active set method (J.
Nocedal, S. Wright, Numerical Optimization, 2nd ed., 16.5). The energy falls on the way to the least
one of the rows that no bound holds, each of which is held from where it meets its own, all at once
where that lowers it, too; then rows that give way are let go, all as long as that lowers the energy
in few changes, and at the end that which gives way most. So no states come twice.

Bodies without support must be in balance besides. Soft springs hold them, whose rest follows them:
the proximal point method (R. T. Rockafellar, SIAM J. Control Optim. 14 (1976) 877-898). Its first
point differs by so little from the last that as a rule it has the states of that.
"""

import numpy as np

from .box import ARC, clipped
from .coulomb import BACKWARD, FORWARD, OPEN, ROUNDING, STICK, CoulombProblem
from .nearby import nearly_in

CHANGES = 3  # of states, for each row; bars that rock took half as many
WORK = 4e9  # multiplications that all changes may take, each rows times those with forces: seconds
# times the rows' own compliance: that of springs which hold bodies without support, in turn; the
# stiffer ones have more digits, the softer ones leave less to be followed
SOFT = (1e3, 1e5)
TOGETHER = 0.5  # part of the changes that are left for rows one by one: of bodies that rock most of
# those that are let go together must be held again
FEW = 0.3  # part of the rows that have forces, below which those alone are multiplied
FOLLOWED = 6  # times that the rest of these springs follows the bodies


def solution_within(problem: CoulombProblem, start: np.ndarray,
                    least: float = 0.0) -> np.ndarray | None:
    """z of a `problem` whose friction bounds are given, from `start` z.

    None where rounding ends it, and for bodies without support that come to no rest, but where the
    bounds lack no more of holding them than `least`, a violation of the law: then those forces.
    """
    return _on_springs(problem, start, least) if problem.k else _Descent(problem, start).end()


def _on_springs(problem: CoulombProblem, start: np.ndarray, least: float) -> np.ndarray | None:
    """As `solution_within`, of bodies without support."""
    own, lacking, nearest = np.median(1.0 / problem.rigidity), least, None
    for soft in SOFT:
        z = _followed(problem, start, soft * own)
        violation = np.inf if z is None else problem.violation(z)
        if violation <= ROUNDING:
            return z
        if violation <= lacking:
            start, lacking, nearest = z, violation, z
    return nearest


def _followed(problem: CoulombProblem, start: np.ndarray, softness: float) -> np.ndarray | None:
    """As `_on_springs`, whose compliance per unit reach is `softness`; the last z without a rest.
    """
    z = None
    for z in problem.along_springs(start, [softness] * FOLLOWED, solution_within):
        if z is None:
            break
        # on the border of states, where nodes move by rounding, the one that springs leave
        for end in (problem.solution_in(problem.states(z), problem.signs(z)), z):
            if problem.solves(end):
                return end
    return z


class _Descent:
    """Forces x (n + m,) within their bounds `lower` and `upper`, `slope` (n + m,) and `energy`
    there, and the numbers of changes that are `left`, and of multiplications for them: `work`.
    `vain`: changes since projections helped.
    """

    def __init__(self, problem: CoulombProblem, start: np.ndarray):
        self.problem, n = problem, problem.n
        bound = problem.offsets
        self.lower = np.append(np.where(problem.bilateral, -np.inf, 0.0), -bound)
        self.upper = np.append(np.full(n, np.inf), bound)
        self.left, self.work, self.vain = CHANGES * problem.rows, WORK, 0
        self._move(self._cut(start[: problem.rows]))

    def end(self) -> np.ndarray | None:
        """The solution, exactly in its states, or None."""
        left = self.left
        self._lower(self._pushed())
        while self._may_go_on:
            if self.problem.solves(self.x):
                exact = self.problem.solution_in(self._states(self._pushed()), self._signs)
                return exact if self.problem.solves(exact) else self.x
            if self.left > TOGETHER * left and self._lower(self._pushed()):
                continue
            held, gives = self._but_one()
            # what rounding hides of the energy a row that gives way still tells
            if not (self._lower(held) or gives):
                return None
        return None

    # ---- steps -----------------------------------------------------------------------------------
    def _lower(self, held: np.ndarray) -> bool:
        """Go to the least energy of rows that are not `held`; whether it falls.

        Each of them is held from where it meets a bound; at once, together, those that would leave
        where they are.
        """
        held, before = held.copy(), self.energy
        while self._may_go_on:
            y = self._least(held)
            if y is None:
                return False
            way = y - self.x
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(way < 0, self.lower - self.x, self.upper - self.x) / way
            room[held | (way == 0)] = np.inf
            least = max(float(room.min()), 0.0)
            if least >= 1:
                self._move(self._cut(y))
                return self.energy < before
            if self._projected(way, room, held):
                continue
            met = room <= least
            x = np.where(met, np.where(way < 0, self.lower, self.upper), self.x + least * way)
            held |= met
            self._move(self._cut(x))
        return False

    def _projected(self, way: np.ndarray, room: np.ndarray, held: np.ndarray) -> bool:
        """Go along `way` to the least energy, or a part of it, with what leaves bounds put on them.

        Where that lowers the energy more than to stop at the first bound, the least `room`; then
        all rows that have met theirs are `held`. Whether it does. (J. J. More, G. Toraldo, SIAM J.
        Optim. 1 (1991) 93-113.) It is tried ever more rarely where it does not.
        """
        self.vain += 1
        if self.vain & (self.vain - 1):  # 1, 2, 4, 8, ... in vain
            return False
        least, fall = float(room.min()), -float(self.slope @ way)
        aim = self.energy - fall * (least - 0.5 * least**2)
        for part in ARC:
            if part > least and self._move(self._cut(self.x + part * way), aim):
                held |= room <= part
                self.vain = 0
                return True
        return False

    @property
    def _may_go_on(self) -> bool:
        return self.left > 0 and self.work > 0

    def _but_one(self) -> tuple[np.ndarray, bool]:
        """(n + m,) rows at bounds but that which gives way most, if one does, and whether."""
        held = self._at_bounds()
        push = np.where(held & (self.lower < self.upper), self._outward(), np.inf)
        row, gives = int(push.argmin()), bool(push.min() < 0)
        held[row] = held[row] and not gives
        return held, gives

    def _move(self, x: np.ndarray, aim: float = np.inf) -> bool:
        """Go to x, if the energy there is below `aim`; whether it is."""
        compliance, acts = self.problem.compliance, np.flatnonzero(x)
        few = len(acts) < FEW * len(x)  # as of bodies whose outlines are contact all round
        self.work -= len(x) * (len(acts) if few else len(x))
        moved = x[acts] @ compliance[acts] if few else compliance @ x
        slope = moved - self.problem.load
        energy = 0.5 * float(x @ (slope - self.problem.load))
        if aim < np.inf and not energy < aim:
            return False
        self.x, self.slope, self.energy = x, slope, energy
        return True

    # ---- states ----------------------------------------------------------------------------------
    @property
    def _signs(self) -> np.ndarray:
        return np.ones(self.problem.n)

    def _cut(self, x: np.ndarray) -> np.ndarray:
        return clipped(x, self.lower, self.upper)

    def _at_bounds(self) -> np.ndarray:
        return (self.x <= self.lower) | (self.x >= self.upper)

    def _outward(self) -> np.ndarray:
        """(n + m,) by how much movements push on bounds, as forces; less than zero: give way."""
        push = self.problem.rigidity * self.slope
        return np.where(self.x <= self.lower, push, -push)

    def _pushed(self) -> np.ndarray:
        """(n + m,) rows that stay at their bounds."""
        return self._at_bounds() & ((self._outward() > 0) | (self.lower == self.upper))

    def _states(self, held: np.ndarray) -> np.ndarray:
        """(n,) states in which the rows `held` (n + m,) have the forces of their bounds."""
        n = self.problem.n
        over = self.x[n:] >= self.upper[n:]
        sliding = np.where(held[n:], np.where(over, FORWARD, BACKWARD), STICK)
        return self.problem.joined(np.where(held[:n], OPEN, STICK), sliding)

    def _least(self, held: np.ndarray) -> np.ndarray | None:
        """Forces of least energy with the rows `held` at their bounds; None if rounding has none.
        """
        self.left -= 1
        z = nearly_in(self.problem, self._states(held), self._signs)
        return None if z is None else z[: self.problem.rows]
