"""The dense contact problem with Coulomb friction on a few contact nodes: Newton, Lemke, all solutions.

With the compliance C of the contact nodes, x = (lambda_n, lambda_t) and movements d - C x = (over, slip):

    lambda_n >= 0,  over <= 0,  lambda_n over = 0,      |lambda_t| <= F lambda_n,
    slip >= 0 where lambda_t = F lambda_n,  slip <= 0 where lambda_t = -F lambda_n,  slip = 0 between.

In two dimensions this is piecewise linear: with every node open, sticking or sliding one way it is a linear
system (A. Klarbring, in: Contact Mechanics, Plenum 1995, on the 4^n states). Its map is coercive and of degree
one, so that for any F there is a solution, and an odd number of them unless one sits on the border between states.

Bodies that no support holds add their rigid motions beta as unknowns and their equilibrium as equations,

    movements d + R beta - C x,      R'x = L,

with the motions R of the contact rows and the loads' work L on them; C is that of the bodies on springs. Then there
need be no solution, and the signs of several add up to nothing one knows. A motion that no row with force or sticking
feels is left as it is: the bodies may rest at many places.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import lapack

OPEN, STICK, FORWARD, BACKWARD = 0, 1, 2, 3  # states of a node; sliding by the sign of lambda_t
ROUNDING = 1e-9  # relative violation of the law that rounding of small dense systems may leave
DISTINCT = 1e-6  # solutions nearer than this part of the largest multiplier are the same
MANY = 9  # solutions after which no more are looked for
NEWTON_STEPS = 50
NEAR = 10  # nodes whose states differ from a solution's at most for a start to be near it
A_FEW = 4  # nodes that may change their states again and again before Newton's method settles
COVERS = 4  # covering vectors Lemke's method tries
FEW = 4  # contact nodes up to which all 4^n states are tried
SPRINGS = 6  # softnesses of the springs that hold bodies without support for it
SLIGHT = 1e-9  # part of a motion's reach below which rows do not feel it


@dataclass
class CoulombProblem:
    """`compliance` (n + m, n + m) SPD, `load` d (n + m,), `coefficient` F (m,), `pair` (m,).

    n nodes have a normal row and the m nodes `pair` of them a tangential one. `bilateral`: lambda_n of any sign
    and over = 0 everywhere, the friction bound is F |lambda_n|. `motions` R (n + m, k) and `balance` L (k,) are of bodies
    without support. Solutions are vectors z = (lambda_n, lambda_t, beta) of n + m + k numbers. `latest` is the factorized
    system of the latest states, by these, shared by all problems that `under` makes.
    """

    compliance: np.ndarray
    load: np.ndarray
    coefficient: np.ndarray
    pair: np.ndarray
    bilateral: bool = False
    motions: np.ndarray | None = None
    balance: np.ndarray | None = None
    latest: dict = field(default_factory=dict, repr=False)

    def __post_init__(self):
        self.rows, self.m = len(self.load), len(self.pair)
        self.n, self.products = self.rows - self.m, 0
        self.rigidity = 1.0 / np.diag(self.compliance)  # force per length, as the scale of every row
        if self.motions is None:
            self.motions, self.balance = np.zeros((self.rows, 0)), np.zeros(0)
        self.k = self.motions.shape[1]
        reach = np.abs(self.motions).max(axis=0, initial=0.0)
        self.reach = np.where(reach > 0, reach, 1.0)  # displacement of the contact rows by a unit motion

    def under(self, load: np.ndarray, coefficient: np.ndarray, balance: np.ndarray | None = None) -> "CoulombProblem":
        """The same bodies under another load, with other friction coefficients."""
        other = object.__new__(CoulombProblem)  # as copy.copy would, but at once
        vars(other).update(vars(self))
        other.load, other.coefficient, other.products = load, coefficient, 0
        other.balance = self.balance if balance is None else balance
        return other

    def whole(self, x: np.ndarray) -> np.ndarray:
        """z with the multipliers x (n + m,) and motions zero."""
        return np.append(x, np.zeros(self.k))

    def movement(self, z: np.ndarray) -> np.ndarray:
        """(n + m,) over and slip."""
        self.products += 1
        moved = self.load - self.compliance @ z[: self.rows]
        return moved + self.motions @ z[self.rows :] if self.k else moved

    def states(self, z: np.ndarray, movement: np.ndarray | None = None) -> np.ndarray:
        """(n,) states that the augmented multipliers x + rigidity * movement fall into."""
        trial = z[: self.rows] + self.rigidity * (self.movement(z) if movement is None else movement)
        normal, tangential = trial[: self.n], trial[self.n :]
        found = np.full(self.n, STICK) if self.bilateral else np.where(normal > 0, STICK, OPEN)
        bound = self.coefficient * np.abs(normal)[self.pair]
        sliding = np.where(np.abs(tangential) < bound, STICK, np.where(tangential > 0, FORWARD, BACKWARD))
        found[self.pair] = np.where(found[self.pair] == OPEN, OPEN, sliding)
        return found

    def signs(self, z: np.ndarray) -> np.ndarray:
        """(n,) signs of lambda_n, all +1 in unilateral contact."""
        return np.where(z[: self.n] < 0, -1.0, 1.0) if self.bilateral else np.ones(self.n)

    def held(self, states: np.ndarray) -> np.ndarray:
        """(k, h) orthonormal motions, in units of their reach, that rows in contact or sticking feel."""
        if not self.k:
            return np.zeros((0, 0))
        acts = np.concatenate([states != OPEN, states[self.pair] == STICK])
        _, sizes, basis = np.linalg.svd(self.motions[acts] / self.reach, full_matrices=False)
        return basis[sizes > SLIGHT].T

    def system(self, states: np.ndarray, sign: np.ndarray) -> "StateSystem":
        """The linear system of the given states, with lambda_n of the given signs."""
        key = b"".join(part.tobytes() for part in (states, sign, self.coefficient))
        if key not in self.latest:
            self.latest.clear()
            self.latest[key] = StateSystem(self, states, sign)
        return self.latest[key]

    def solution_in(self, states: np.ndarray, sign: np.ndarray | None = None) -> np.ndarray | None:
        """z of the linear system of `states`, exactly in its states; None if the system is singular."""
        return self.system(states, np.ones(self.n) if sign is None else sign).solve(self.load, self.balance)

    def violation(self, z: np.ndarray) -> float:
        """Largest violation of the law at z, relative to the largest terms of its sums; inf if z is no number."""
        x, move = z[: self.rows], self.movement(z)
        work = np.abs(self.balance / self.reach).max(initial=0)
        force = max(np.abs(x).max(initial=0), np.abs(self.rigidity * self.load).max(initial=0), work)
        if not np.isfinite(force) or force == 0:
            return 0.0 if force == 0 else np.inf
        normal, tangential = x[: self.n], x[self.n :]
        over, slip = (self.rigidity * move)[: self.n], (self.rigidity * move)[self.n :]  # as forces
        bound = self.coefficient * np.abs(normal)[self.pair]
        natural = over if self.bilateral else normal - np.maximum(normal + over, 0)
        rub = tangential - np.clip(tangential + slip, -bound, bound)
        net = (self.balance - self.motions.T @ x) / self.reach
        return float(max(np.abs(part).max(initial=0) for part in (natural, rub, net)) / force)

    def solves(self, z: np.ndarray | None) -> bool:
        """Whether z obeys the law to rounding."""
        return z is not None and self.violation(z) <= ROUNDING

    def on_springs(self, softness: float, rest: np.ndarray) -> "CoulombProblem":
        """The bodies held by springs of compliance `softness` per unit reach whose rest are the motions `rest` (k,)."""
        turned = softness * self.motions / self.reach**2
        return CoulombProblem(self.compliance + turned @ self.motions.T,
                              self.load + self.motions @ rest + turned @ self.balance,
                              self.coefficient, self.pair, self.bilateral)


class StateSystem:
    """LU factors of the law in given states, for the multipliers that these leave free.

    Free are lambda_n in contact and lambda_t where a node sticks: their rows do not move. lambda_t = slope lambda_n of a
    sliding node is put in, open nodes are left out. Motions count as far as the states hold them: beta = turn gamma.
    """

    def __init__(self, problem: CoulombProblem, states: np.ndarray, sign: np.ndarray):
        n, C, at = problem.n, problem.compliance, states[problem.pair]
        touching, sliding = states != OPEN, np.flatnonzero(at > STICK)
        self.rows, self.motions = problem.rows, problem.motions
        free = np.concatenate([touching, at == STICK])
        self.free = np.flatnonzero(free)
        self.sliding, self.node = n + sliding, problem.pair[sliding]
        self.bound = np.where(at[sliding] == FORWARD, 1.0, -1.0) * problem.coefficient[sliding]
        slope = self.bound * sign[self.node]
        self.turn = problem.held(states) / problem.reach[:, None]
        self.soft = np.median(1.0 / problem.rigidity) if problem.k else 1.0
        columns, place = C.compress(free, 1), np.cumsum(touching) - 1
        transposed = columns.compress(free, 0)  # C is symmetric
        transposed[place[self.node]] += slope[:, None] * columns[self.sliding]
        if problem.k:
            force = problem.motions @ self.turn
            work = self.soft * force
            work[self.node] += slope[:, None] * work[self.sliding]
            border = np.zeros((force.shape[1],) * 2)
            transposed = np.block([[transposed, work[self.free]], [-force[self.free].T, border]])
        self.factor, self.pivots, failed = (
            lapack.dgetrf(transposed.T, overwrite_a=True) if len(transposed) else (transposed, np.empty(0, int), 0))
        self.singular, swaps = failed != 0, np.count_nonzero(self.pivots != np.arange(len(self.pivots)))
        # sign of the determinant, that of the whole system of normal and tangential rows as well
        self.index = int(np.prod(np.sign(np.diag(self.factor))) * (-1) ** swaps)

    def solve(self, load: np.ndarray, balance: np.ndarray) -> np.ndarray | None:
        """z under `load` (n + m,) and `balance` (k,), sliding nodes exactly on their bounds; None if there is no one z."""
        if self.singular:
            return None
        right = load[self.free]
        if len(balance):
            right = np.append(right, self.soft * (self.turn.T @ balance))
        if len(right):
            right, _ = lapack.dgetrs(self.factor, self.pivots, right)
        z = np.zeros(self.rows + len(balance))
        z[self.free] = right[: len(self.free)]
        z[self.sliding] = self.bound * np.abs(z[self.node])
        z[self.rows :] = self.turn @ right[len(self.free) :]
        return z if np.isfinite(z).all() else None


def newton(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """Semismooth Newton steps (P. Alart, A. Curnier, CMAME 92 (1991) 353-375) from `start` z.

    Each solves the linear system of the states that the last iterate falls into, the start's own too where it is a
    solution but for rounding: whoever calls may have asked for more. None where states come again without having
    settled, or a system is singular: convergence is local.
    """
    visited, seen, x = [], set(), start
    for _ in range(NEWTON_STEPS):
        visited.append(x)
        states, sign = problem.states(x), problem.signs(x)
        key = states.tobytes() + sign.tobytes()
        if key in seen:
            break
        seen.add(key)
        x = problem.solution_in(states, sign)
        if x is None:
            break
    return next((x for x in reversed(visited) if problem.solves(x)), None)


def settled(problem: CoulombProblem, start: np.ndarray, move: np.ndarray, thought: np.ndarray | None = None):
    """Newton steps from a `start` z that is near a solution: z and its movement, which whoever calls may judge.

    `move` is the movement at the start.

    None where few nodes only changing their states, and fewer every time, do not show that it is: compared with the states
    `thought` (n,), if given, before anything is factorized. Solutions of negative index are left: successive
    approximations would not stay at them either, and there are others.
    """
    x, fewest, states, sign = start, 2 * NEAR, problem.states(start, move), problem.signs(start)
    if thought is not None and np.count_nonzero(states != thought) > NEAR:
        return None
    for _ in range(NEWTON_STEPS):
        old, before, system = states, sign, problem.system(states, sign)
        x = system.solve(problem.load, problem.balance)
        if x is None:
            return None
        move = problem.movement(x)
        states, sign = problem.states(x, move), problem.signs(x)
        changes = np.count_nonzero((states != old) | (sign != before))
        if changes == 0:
            return (x, move) if system.index > 0 else None
        if changes > max(A_FEW, fewest / 2):
            return None
        fewest = min(fewest, changes)
    return None


def lemke(problem: CoulombProblem) -> np.ndarray | None:
    """A solution by complementary pivots, for any friction coefficient; unilateral contact only.

    With lambda_t = a - b and the size s of the slip the law is the linear complementarity problem

        0 <= lambda_n | -over >= 0,   0 <= a | s - slip >= 0,   0 <= b | s + slip >= 0,   0 <= s | F lambda_n - a - b >= 0.

    Its matrix is copositive, and z'Mz = 0 <= Mz has solutions (0, 0, 0, s) only, at which q'z = 0: so Lemke's
    method ends in a solution (R. Cottle, J.-S. Pang, R. Stone, The Linear Complementarity Problem, section 4.4; as
    D. Stewart and J. Trinkle, Int. J. Numer. Meth. Engng 39 (1996) 2673-2691, use it in dynamics), unless rounding
    leads it astray: then another covering vector is tried. None if all fail.

    Bodies without support are held by springs, softer every time, whose rest follows: Newton's method from there.
    """
    if problem.bilateral:
        return None
    if problem.k:
        return _lemke_on_springs(problem)
    n, m = problem.n, problem.m
    scale = np.sqrt(problem.rigidity)  # unknowns x / scale: any units, rows of like size
    C, d = problem.compliance * np.outer(scale, scale), problem.load * scale
    size = np.abs(d).max(initial=0)
    if size == 0:
        return np.zeros(n + m)
    Cnn, Cnt, Ctt = C[:n, :n], C[:n, n:], C[n:, n:]
    cone = np.zeros((m, n))
    cone[np.arange(m), problem.pair] = problem.coefficient * scale[problem.pair] / scale[n:]
    unit, none = np.eye(m), np.zeros((m, m))
    M = np.block([[Cnn, Cnt, -Cnt, np.zeros((n, m))], [Cnt.T, Ctt, -Ctt, unit], [-Cnt.T, -Ctt, Ctt, unit],
                  [cone, -unit, -unit, none]])
    q = np.concatenate([-d[:n], -d[n:], d[n:], np.zeros(m)]) / size
    rng = np.random.default_rng(1)
    for attempt in range(COVERS):
        cover = np.ones(len(q)) if attempt == 0 else rng.uniform(0.5, 1.5, len(q))
        z = _lemke_pivots(M, q, cover)
        if z is not None:
            normal, forth, back, slip = np.split(z, [n, n + m, n + 2 * m])
            states = np.where(normal > 0, STICK, OPEN)
            sliding = np.where(slip > 0, np.where(forth > back, FORWARD, BACKWARD), STICK)
            states[problem.pair] = np.where(states[problem.pair] == OPEN, OPEN, sliding)
            for x in (problem.solution_in(states), newton(problem, scale * size * np.append(normal, forth - back))):
                if problem.solves(x):
                    return x
    return None


def _lemke_on_springs(problem: CoulombProblem) -> np.ndarray | None:
    """`lemke` for bodies without support; None if they do not come to rest.

    The rest of the springs stays, and follows the motion: one may succeed where the other circles.
    """
    soft, follows = np.median(1.0 / problem.rigidity), np.zeros(problem.k)
    for softness in soft * 10.0 ** np.arange(SPRINGS):
        for rest in (follows, np.zeros(problem.k)):
            x = lemke(problem.on_springs(softness, rest))
            if x is None:
                continue
            moved = rest + softness * (problem.balance - problem.motions.T @ x) / problem.reach**2
            follows, z = moved if rest is follows else follows, np.append(x, moved)
            for found in (problem.solution_in(problem.states(z), problem.signs(z)), newton(problem, z)):
                if problem.solves(found):
                    return found
    return next(iter(all_solutions(problem)), None) if problem.n <= FEW else None


def _lemke_pivots(M: np.ndarray, q: np.ndarray, cover: np.ndarray) -> np.ndarray | None:
    """z >= 0 with w = M z + q >= 0, w'z = 0, by Lemke's method with covering vector `cover` > 0; None on a ray.

    The tableau holds w or z of every row in terms of the nonbasic ones: columns 0..k-1 and the artificial one k.
    """
    k = len(q)
    if q.min(initial=0.0) >= 0:
        return np.zeros(k)
    table = np.column_stack([-M, -cover, q])
    basic, nonbasic = np.arange(k), np.arange(k, 2 * k + 1)  # w_i is i, z_i is k + i, the artificial one 2 k
    row, column = int(np.argmin(q / cover)), k
    for _ in range(50 * k):
        _pivot(table, row, column)
        leaving = basic[row]
        basic[row], nonbasic[column] = nonbasic[column], leaving
        if leaving == 2 * k:
            z = np.zeros(2 * k)
            z[basic] = table[:, -1]
            return np.maximum(z[k:], 0.0)
        partner = leaving + k if leaving < k else leaving - k
        column = int(np.flatnonzero(nonbasic == partner)[0])
        entry = table[:, column]
        able = entry > 1e-11 * np.abs(entry).max()
        if not able.any():
            return None
        ratio = np.where(able, table[:, -1] / np.where(able, entry, 1.0), np.inf)
        ties = np.flatnonzero(ratio <= ratio.min() + 1e-13)
        artificial = ties[basic[ties] == 2 * k]
        row = int(artificial[0] if len(artificial) else ties[np.argmax(entry[ties])])
    return None


def _pivot(table: np.ndarray, row: int, column: int) -> None:
    """Exchange the variables of `row` and `column`."""
    pivot = table[row, column]
    line = table[row] / pivot
    line[column] = 1.0 / pivot
    entry = table[:, column].copy()
    entry[row] = 0.0
    table[:, column] = 0.0
    table[row] = 0.0
    table -= np.outer(entry, line)
    table[row] = line


def all_solutions(problem: CoulombProblem) -> list[np.ndarray]:
    """Every isolated solution, by trying all 4^n states (unilateral contact): for a handful of nodes.

    Bodies that may rest at many places under the same forces: one of them. A motion that nothing holds in some states,
    but that keeps nodes from overlapping or sliding the wrong way, ends where it does so in states that hold it.
    """
    found = []
    choices = [4 if i in problem.pair else 2 for i in range(problem.n)]
    for states in np.ndindex(*choices):
        z = problem.solution_in(np.array(states))
        _add_solution(problem, found, z if problem.solves(z) else None)
    return found


def search(problem: CoulombProblem, start: np.ndarray) -> list[np.ndarray]:
    """Solutions that Newton reaches from `start`, from all sticking, all sliding and all open, Lemke's, and those
    that Newton reaches from any of these with the state of one node changed. Not necessarily all there are.
    """
    whole = [np.full(problem.n, s) for s in (STICK, FORWARD, BACKWARD, OPEN)[: 3 if problem.bilateral else 4]]
    found = []
    for guess in (start, *map(problem.solution_in, whole)):
        _add_solution(problem, found, None if guess is None else newton(problem, guess))
    _add_solution(problem, found, lemke(problem))
    done = 0
    while done < len(found) < MANY:
        for guess in _neighbours(problem, found[done]):
            _add_solution(problem, found, newton(problem, guess))
        done += 1
    return found


def _neighbours(problem: CoulombProblem, x: np.ndarray):
    """The vectors that solve the linear systems of states that differ from those of x at one node."""
    states, sign = problem.states(x), problem.signs(x)
    for i in range(problem.n):
        for state in (OPEN, STICK, FORWARD, BACKWARD):
            if state == states[i] or state == OPEN and problem.bilateral or state > STICK and i not in problem.pair:
                continue
            other = states.copy()
            other[i] = state
            y = problem.solution_in(other, sign)
            if y is not None:
                yield y


def _add_solution(problem: CoulombProblem, found: list[np.ndarray], z: np.ndarray | None) -> None:
    """Append z unless it is none or its forces are, to rounding, those of one of `found`."""
    if z is not None:
        x = z[: problem.rows]
        size = max(np.abs(y[: problem.rows]).max(initial=0) for y in (*found, z))
        if all(np.abs(x - y[: problem.rows]).max(initial=0) > DISTINCT * size for y in found):
            found.append(z)


def index(problem: CoulombProblem, z: np.ndarray) -> int:
    """Sign of the determinant of the law's linear system at the solution z.

    The signs of all solutions add up to one (degree of the map; without friction the sign is one), so -1 proves
    that there are two more at least - where supports hold all bodies.
    """
    return problem.system(problem.states(z), problem.signs(z)).index
