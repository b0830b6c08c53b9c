"""A solution of the dense contact problem at the end of a path of solutions.

A state z_0 that obeys contact and friction in itself, as with every node sticking, solves the step
under some load d_0 and resultant L_0 of their own. The solutions under

    d_0 + theta (d - d_0),   L_0 + theta (L - L_0)

make a path: a straight line in given states of the nodes, and where one of these comes to the
border of its state a line in the neighbouring one (B. C. Eaves, H. Scarf, Math. Oper. Res. 1 (1976)
1-27; E. Allgower, K. Georg, Numerical Continuation Methods, Springer 1990, chapter 12). Each is the
null vector of the law's linear system with theta among the unknowns, so that theta may fall on the
way, which is where Newton's method and loads that grow by steps get stuck, and bodies that no state
holds any more may move on until a node stops them. At theta = 1 the path has come to a solution.

With supports of all bodies the solutions at any theta are bounded; without them the path may run
off. Which way it takes follows from small random parts of d_0, so that no two nodes change their
states at once.
"""

import numpy as np
from scipy.linalg import qr

from . import complementarity
from .coulomb import BACKWARD, FORWARD, OPEN, STICK, CoulombProblem
from .dependent_rows import yielding
from .equations import Equations

PIVOTS = 300  # changes of states along a path, at most
SMALL = (1e-3, 1e-1)  # random parts of d_0, relative to forces and movements
FAR = 1e6  # theta, or ways of bodies in units of what loads move, at which a path has run off


def at_the_end_of_a_path(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """A solution z (n + m + k,) on a path from all nodes sticking, sliding, open, or from `start`.

    None if all run off or take more than PIVOTS changes of states. Deterministic.
    """
    # forces are unique; Newton's method ends in the problem as it is
    regular = yielding(problem)
    starts = *complementarity.all_alike(regular), start
    ends = (_Path(regular, near, small).end() for small in SMALL for near in starts)
    solutions = (complementarity.newton(problem, z) for z in ends if z is not None)
    solution = next((z for z in solutions if z is not None), None)
    problem.products += regular.products
    return solution


class _Path:
    """The path through a state near some z, its present point and states.

    Inequalities of the states are numbered (3, n): of pressing or of being open, of friction, and
    of friction the other way where a node sticks.
    """

    def __init__(self, problem: CoulombProblem, z: np.ndarray, small: float):
        """`small`: the random parts of the load at which the path begins."""
        self.problem, self.theta = problem, 0.0
        n, m, rng = problem.n, problem.m, np.random.default_rng(1)
        self.offset = problem.offsets
        self.row = np.full(n, -1)  # of a node its tangential row
        self.row[problem.pair] = np.arange(m)
        self.rubs = (problem.coefficient > 0) | (self.offset > 0)
        self.sign, self.states = problem.signs(z), self._begun(z)
        self.z = z = self._inside(z, small, rng)
        want = self._movements(problem.movement(z), small, rng)
        x = z[: problem.rows]
        load = want + problem.compliance @ x - problem.motions @ z[problem.rows :]
        self.load, self.change = load, problem.load - load
        self.more = problem.balance - problem.motions.T @ x
        work = np.abs(problem.balance / problem.reach).max(initial=0.0)
        self.far = FAR * max(np.abs(problem.load).max(), work / problem.rigidity.min())

    # ---- the beginning ---------------------------------------------------------------------------
    def _begun(self, z: np.ndarray) -> np.ndarray:
        """(n,) states of z: nodes that press stick or slide, others are open."""
        problem = self.problem
        rub = np.maximum(np.abs(problem.states(z)), STICK)
        apart = np.zeros(problem.n, bool)  # sticking or sliding while open
        apart[problem.pair] = self.offset > 0
        smooth = np.zeros(problem.n, bool)
        smooth[problem.pair[~self.rubs]] = True
        rub[smooth] = FORWARD
        touching = (z[: problem.n] > 0) | problem.bilateral
        return np.where(touching, rub, np.where(apart, -rub, OPEN))

    def _inside(self, z: np.ndarray, small: float, rng) -> np.ndarray:
        """z with forces strictly inside what the states admit."""
        problem, n = self.problem, self.problem.n
        z = problem.on_bounds(z, self.states)
        force = np.abs(z[:n]).max(initial=0.0) or np.abs(problem.rigidity * problem.load).max()
        presses = self.states > OPEN
        z[:n] += presses * small * force * rng.uniform(0.1, 1.0, n) * self.sign
        state, along = self.states[problem.pair], z[n : problem.rows]
        bound = problem.bounds(z)
        most = (1.0 - small * rng.uniform(0.1, 1.0, problem.m)) * bound
        way = np.select([np.abs(state) == FORWARD, np.abs(state) == BACKWARD], [1.0, -1.0])
        along[:] = np.where(np.abs(state) == STICK, np.clip(along, -most, most), way * bound)
        return z

    def _movements(self, moved: np.ndarray, small: float, rng) -> np.ndarray:
        """(n + m,) over and slip near those `moved` that the states admit strictly."""
        problem, n, states = self.problem, self.problem.n, self.states
        state, want = np.abs(states[problem.pair]), moved.copy()
        apart = small * np.abs(problem.load).max() * rng.uniform(0.1, 1.0, problem.rows)
        want[:n] = np.where(states > OPEN, 0.0, np.minimum(moved[:n], 0.0) - apart[:n])
        slip = want[n:]
        slip[state == STICK] = 0.0
        for way, slides in ((1.0, state == FORWARD), (-1.0, state == BACKWARD)):
            slip[slides] = way * (np.maximum(way * moved[n:], 0.0) + apart[n:])[slides]
        return want

    # ---- the path --------------------------------------------------------------------------------
    def end(self) -> np.ndarray | None:
        """z at theta = 1, or None."""
        changed = None
        for _ in range(PIVOTS):
            way, faster = self._direction()
            now, slip = self._slack(self.z, self.load + self.theta * self.change)
            rate, slips = self._slack(way, faster * self.change, by=True)
            # on into the new states: what they ask of the node that has changed its own grows
            forth = np.sign(faster if changed is None else rate[changed])
            if forth == 0 or not np.isfinite(rate).all():
                return None
            way, faster, rate, slips = forth * way, forth * faster, forth * rate, forth * slips
            steps = np.full(now.shape, np.inf)
            falls = self._counts() & (rate < 0)
            if changed is not None:
                falls[changed] = False
            steps[falls] = np.maximum(-now[falls] / rate[falls], 0.0)
            changed = np.unravel_index(np.argmin(steps), steps.shape)
            step = steps[changed]
            last = faster > 0 and self.theta + step * faster >= 1.0
            step = (1.0 - self.theta) / faster if last else step
            if not np.isfinite(step) or self._is_off(step * way):
                return None
            self.z, self.theta = self.z + step * way, self.theta + step * faster
            if last:
                return self.z
            changed = self._crossed(*changed, slip + step * slips)
        return None

    def _is_off(self, way: np.ndarray) -> bool:
        """Whether bodies that go on by this `way` of z, or loads, are too far to come back.

        Where nothing holds a body theta grows by rounding alone.
        """
        moved = self.problem.motions @ way[self.problem.rows :]
        return abs(self.theta) > FAR or np.abs(moved).max(initial=0.0) > self.far

    def _direction(self) -> tuple[np.ndarray, float]:
        """The way of z and of theta along the path, of either sense.

        The null vector of as many equations as there are forces that the states leave free, and
        motions; theta is one unknown more.
        """
        problem, equations = self.problem, Equations(self.problem, self.states, self.sign)
        free = np.flatnonzero(equations.still)
        unit = np.sqrt(problem.rigidity[free])
        forces = np.zeros((problem.rows, len(free)))  # all by the free ones
        forces[free, np.arange(len(free))] = unit
        slides = np.flatnonzero(equations.slides)
        place = np.cumsum(equations.still) - 1
        node = place[problem.pair[slides]]
        forces[problem.n + slides, node] = equations.slope[slides] * unit[node]
        motions = problem.motions / problem.reach
        system = np.block([
            [-unit[:, None] * (problem.compliance[free] @ forces), unit[:, None] * motions[free],
             (unit * self.change[free])[:, None]],
            [motions.T @ forces, np.zeros((problem.k,) * 2),
             -(self.more / problem.reach)[:, None]]])
        for axis in (1, 0):  # rows, then unknowns, of like size
            size = np.abs(system).max(axis=axis, keepdims=True, initial=0.0)
            size[size == 0] = 1.0
            system = system / size
        null = qr(system.T, check_finite=False)[0][:, -1] / size[0]
        way = np.append(forces @ null[: len(free)], null[len(free) : -1] / problem.reach)
        return way, float(null[-1])

    def _slack(self, z: np.ndarray, load: np.ndarray,
               by: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """(3, n) what the inequalities of the states leave at z, as forces, and slips (m,).

        Under `load` (n + m,); `by`: of changes, to which offsets add nothing.
        """
        problem, n = self.problem, self.problem.n
        x = z[: problem.rows]
        moved = load - problem.compliance @ x + problem.motions @ z[problem.rows :]
        moved *= problem.rigidity
        pressure, slip, along = self.sign * x[:n], moved[n:], x[n:]
        state, left = self.states[problem.pair], np.zeros((3, n))
        left[0] = np.where(self.states > OPEN, pressure, -moved[:n])
        bound = problem.coefficient * np.where(state > OPEN, pressure[problem.pair], 0.0)
        bound = bound if by else bound + self.offset
        sticks = np.abs(state) == STICK
        left[1, problem.pair] = np.select(
            [sticks, np.abs(state) == FORWARD, np.abs(state) == BACKWARD],
            [bound - along, slip, -slip])
        left[2, problem.pair] = np.where(sticks, bound + along, 0.0)
        return left, slip

    def _counts(self) -> np.ndarray:
        """(3, n) whether the inequalities are those of the present states."""
        problem, counts = self.problem, np.zeros((3, self.problem.n), bool)
        state = np.abs(self.states[problem.pair])
        counts[1, problem.pair] = self.rubs & (state != OPEN)
        counts[2, problem.pair] = self.rubs & (state == STICK)
        signed = np.zeros(problem.n, bool)  # of contact that pulls the sign bounds friction
        signed[problem.pair] = problem.coefficient > 0
        counts[0] = ~problem.bilateral | signed
        return counts

    def _crossed(self, kind: int, node: int, slip: np.ndarray) -> tuple[int, int]:
        """Change the state of a `node` at the border of its inequality of this `kind`.

        Returns the inequality of the new state that holds with equality there; `slip` (m,).
        """
        states, old, row = self.states, self.states[node], self.row[node]
        if kind == 0 and self.problem.bilateral[node]:
            self.sign[node] = -self.sign[node]
        elif kind == 0 and row >= 0 and self.offset[row] > 0:
            states[node] = -old
        elif kind == 0 and old == OPEN:
            states[node] = STICK if row < 0 else FORWARD if slip[row] > 0 else BACKWARD
        elif kind == 0:
            states[node] = OPEN
        elif abs(old) == STICK:
            states[node] = np.sign(old) * (FORWARD if kind == 1 else BACKWARD)
            kind = 1
        else:
            states[node] = np.sign(old) * STICK
            kind = 1 if abs(old) == FORWARD else 2
        return kind, node
