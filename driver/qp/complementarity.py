"""Solutions of the dense contact problem with friction: Newton, Lemke, all states, search."""

import itertools

import numpy as np

from ..environment import PLAIN_PROGRAM, silenced
from . import pivots
from .borders import on_border
from .coulomb import BACKWARD, FORWARD, OPEN, STICK, CoulombProblem
from .nearby import nearly_in

DISTINCT = 1e-6  # solutions nearer than this part of the largest multiplier are the same
MANY = 9  # solutions after which no more are looked for
NEWTON_STEPS = 50
LAST = 4  # iterates of which one is the solution, if any was found
BRIEFLY = 8  # Newton steps from one of many starts
NEAR = 10  # nodes whose states differ from a solution's at most for a start to be near it
A_FEW = 4  # nodes that may change their states again and again before Newton's method settles
SHARE = 0.02  # part of all nodes that may, where it narrows
COVERS = 4  # covering vectors Lemke's method tries
SLACK = 1e-9  # relative violation of an inequality that is rounding
DESCENTS = 8  # changes of a node's state on the way to a solution
PROMISING = 4  # of the states that differ at one node
FEW = 4  # contact nodes up to which all 4^n states are tried
SPRINGS = 6  # softnesses of the springs that hold bodies without support for it


def newton(problem: CoulombProblem, start: np.ndarray, most: int = NEWTON_STEPS,
           narrowing: bool = False, nearly: bool = False) -> np.ndarray | None:
    """Semismooth Newton steps (P. Alart, A. Curnier, CMAME 92 (1991) 353-375) from `start` z, at
    `most` so many.

    Each solves the linear system of the states that the last iterate falls into, the start's own
    too where it is a solution but for rounding: the caller may have asked for more. None where
    states come again without having settled, or a system is singular: convergence is local. With
    `narrowing` also where more nodes change their states than in the step before, and not a few.
    `nearly`: to the digits of factors of like states, of which a solution may lack some.
    """
    visited, seen, x = [], set(), start
    before, latest = None, problem.n
    for _ in range(most):
        visited.append(x)
        states, sign = problem.states(x), problem.signs(x)
        key = states.tobytes() + sign.tobytes()
        if key in seen:
            break
        seen.add(key)
        if narrowing and before is not None:
            changes = np.count_nonzero(states != before)
            if changes > max(A_FEW, SHARE * problem.n, latest):
                break
            latest = changes
        before = states
        x = nearly_in(problem, states, sign) if nearly else problem.solution_in(states, sign)
        if x is None:
            break
    # at a solution states come again at once, on the border of some after a few turns
    last = [start, *visited[-LAST:]]
    found = next((x for x in reversed(last) if problem.solves(x)), None)
    return on_border(problem, found, visited[-1])


def settled(problem: CoulombProblem, start: np.ndarray, move: np.ndarray,
            thought: np.ndarray | None = None):
    """Newton steps from a z near a solution: z and its movement, for the caller to judge.

    `move` is the movement at `start`.

    None where few nodes only changing their states, and fewer every time, do not show that it is
    near: compared with the states `thought` (n,), if given, before anything is factorized.
    Solutions of negative index are left: successive approximations would not stay there either.
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
    """A solution by complementary pivots, in unilateral contact for any friction coefficient.

    With lambda_t = a - b and the size s of the slip the law is the linear complementarity problem

        0 <= lambda_n | -over >= 0,             0 <= a | s - slip >= 0,
        0 <= s | c + F lambda_n - a - b >= 0,   0 <= b | s + slip >= 0.

    With C positive definite z'Mz = x'Cx + s'F lambda_n >= 0 on z >= 0: M is copositive. Where z'Mz
    = 0 <= Mz, x = 0, so that a = b and F lambda_n - a - b = -2 a >= 0: z = (0, 0, 0, s), at which
    q'z = c's >= 0. For such M and q Lemke's method does not end on a ray (R. Cottle, J.-S. Pang, R.
    Stone, The Linear Complementarity Problem, theorem 4.4.13), and lexicographic pivots exclude
    cycles (ibid., 4.9): in exact arithmetic it ends in a solution. D. Stewart and J. Trinkle, Int.
    J. Numer. Meth. Engng 39 (1996) 2673-2691, use it in dynamics. Where rounding leads it astray
    another covering vector is tried. None if all fail.

    Bilateral lambda_n are eliminated by over = 0, and with 0 <= p | p - lambda_n >= 0, which makes
    p the positive part, F |lambda_n| = F (2 p - lambda_n). That matrix is not copositive: for
    bilateral contact nothing is proved, nor for bodies without support, of which there need be no
    solution. These are held by springs, ever softer, whose rest follows, before Newton.
    """
    if problem.k:
        return _lemke_on_springs(problem)
    scale = np.sqrt(problem.rigidity)  # unknowns x / scale: any units, rows of like size
    size = np.abs(problem.load * scale).max(initial=0)
    if size == 0:
        return np.zeros(problem.rows)
    try:
        M, q, multipliers = _complementary(problem, scale, size)
    except np.linalg.LinAlgError:  # conditions of contact that pulls depend on one another
        return None
    rng = np.random.default_rng(1)
    for attempt in range(COVERS):
        cover = np.ones(len(q)) if attempt == 0 else rng.uniform(0.5, 1.5, len(q))
        z = pivots.solution(M, q, cover)
        if z is not None:
            x, slip = multipliers(z)
            sliding = np.where(slip > 0, np.where(x[problem.n :] > 0, FORWARD, BACKWARD), STICK)
            touching = np.where((x[: problem.n] > 0) | problem.bilateral, STICK, OPEN)
            states, start = problem.joined(touching, sliding), scale * size * x
            exact = problem.solution_in(states, problem.signs(start))
            for solution in (exact, newton(problem, start)):
                if problem.solves(solution):
                    return solution
    return None


def _complementary(problem: CoulombProblem, scale: np.ndarray, size: float):
    """M, q of the problem of `lemke`, and how to read x (n + m,) and slip (m,) out of its z.

    Multipliers are over `scale` (n + m,) and over `size`.
    """
    n, m, rows = problem.n, problem.m, np.arange(problem.rows)
    C, d = problem.compliance * np.outer(scale, scale), problem.load * scale
    pulls = np.flatnonzero(problem.bilateral)
    rest = rows[np.append(~problem.bilateral, np.ones(m, bool))]
    k, u = len(pulls), len(rest) - m
    # lambda_n = given - answer @ those of the rest
    right = np.column_stack([d[pulls], C[pulls][:, rest]])
    solved = np.linalg.solve(C[np.ix_(pulls, pulls)], right)
    given, answer = solved[:, 0], solved[:, 1:]
    d, C = d[rest] - C[rest][:, pulls] @ given, C[np.ix_(rest, rest)] - C[rest][:, pulls] @ answer
    factor = np.zeros((m, n))
    factor[np.arange(m), problem.pair] = problem.coefficient * scale[problem.pair] / scale[n:]
    alike, differ = factor[:, rest[:u]], factor[:, pulls]
    Cnn, Cnt, Ctt, unit = C[:u, :u], C[:u, u:], C[u:, u:], np.eye(m)
    of_normal, of_tangential = answer[:, :u], answer[:, u:]
    rub, none = differ @ of_tangential, np.zeros((m, m))
    apart, aside = np.zeros((u, k)), np.zeros((m, k))
    M = np.block([
        [Cnn, Cnt, -Cnt, np.zeros((u, m)), apart], [Cnt.T, Ctt, -Ctt, unit, aside],
        [-Cnt.T, -Ctt, Ctt, unit, aside],
        [alike + differ @ of_normal, rub - unit, -rub - unit, none, 2 * differ],
        [of_normal, of_tangential, -of_tangential, aside.T, np.eye(k)]])
    offset = problem.offsets / scale[n:]
    q = np.concatenate([-d[:u], -d[u:], d[u:], offset - differ @ given, -given]) / size

    def multipliers(z):
        normal, forth, back, slip, _ = np.split(z, np.cumsum([u, m, m, m]))
        x = np.zeros(n + m)
        x[rest] = np.append(normal, forth - back)
        x[pulls] = given / size - answer @ x[rest]
        return x, slip

    return M, q, multipliers


def _lemke_on_springs(problem: CoulombProblem) -> np.ndarray | None:
    """`lemke` for bodies without support; None if they do not come to rest.

    The rest of the springs stays, and follows the motion: one may succeed where the other circles.
    """
    soft, follows = np.median(1.0 / problem.rigidity), np.zeros(problem.k)
    for softness in soft * 10.0 ** np.arange(SPRINGS):
        rests = [follows, np.zeros(problem.k)] if follows.any() else [follows]
        for rest in rests:
            x = lemke(problem.on_springs(softness, rest))
            if x is None:
                continue
            moved = problem.sprung(softness, rest, x)
            follows, z = moved if rest is rests[0] else follows, np.append(x, moved)
            exact = problem.solution_in(problem.states(z), problem.signs(z))
            for solution in (exact, newton(problem, z)):
                if problem.solves(solution):
                    return solution
    return next(iter(all_solutions(problem)), None) if problem.n <= FEW else None


def all_solutions(problem: CoulombProblem) -> list[np.ndarray]:
    """Every isolated solution, by trying all 4^n states (6^n with offsets) of a few nodes.

    Unilateral contact. Bodies that may rest at many places under the same forces: one of them. A
    motion that nothing holds in some states, but that keeps nodes from overlapping or sliding the
    wrong way, ends where it does so in states that hold it.
    """
    solutions = []
    for states in itertools.product(*(problem.choices(node) for node in range(problem.n))):
        z = problem.solution_in(np.array(states))
        _add_solution(problem, solutions, z if problem.solves(z) else None)
    return solutions


def all_isolated(problem: CoulombProblem) -> bool:
    """Whether no states of a few nodes have a line of solutions, to which trying all is blind.

    Unilateral contact. Where the linear system of states is singular and has solutions, a linear
    program decides whether one of them obeys the law's inequalities.
    """
    for states in itertools.product(*(problem.choices(node) for node in range(problem.n))):
        states = np.array(states)
        family = problem.system(states, np.ones(problem.n)).family(problem.load, problem.balance)
        if family is not None and _obeys_somewhere(problem, states, *family):
            return False
    return True


def _obeys_somewhere(problem: CoulombProblem, states, z, directions) -> bool:
    """Whether z + directions t is in the states for some t."""
    from scipy.optimize import linprog  # slow to import, and hardly any system is singular

    rest, slopes = _slack(problem, states, z), []
    for line in directions.T:
        slopes.append(_slack(problem, states, z + line) - rest)  # the law is affine in a state
    size = max(np.abs(rest).max(initial=0.0), np.abs(problem.rigidity * problem.load).max()) or 1.0
    with silenced():
        answer = linprog(np.zeros(len(slopes)), A_ub=-np.array(slopes).T / size,
                         b_ub=rest / size + SLACK, bounds=(None, None),
                         options=PLAIN_PROGRAM)
    return answer.status != 2  # infeasible


def _slack(problem: CoulombProblem, states, z) -> np.ndarray:
    """What the inequalities of the states leave at z, forces: all >= 0 where it is in them."""
    x, forces = z[: problem.rows], problem.rigidity * problem.movement(z)
    n, state = problem.n, states[problem.pair]
    bound = problem.coefficient * x[: n][problem.pair] + problem.offsets
    normal = np.where(states > OPEN, x[: n], -forces[: n])
    slip, t = forces[n :], x[n :]
    forth = np.where(np.abs(state) == STICK, bound - t, np.where(np.abs(state) == FORWARD, slip,
                                                                 -slip))
    back = np.where(np.abs(state) == STICK, bound + t, forth)
    slides = state != OPEN  # an open node without an offset is free
    return np.concatenate([normal, forth[slides], back[slides]])


def search(problem: CoulombProblem, start: np.ndarray) -> list[np.ndarray]:
    """Solutions that Newton and Lemke reach from several starts; not necessarily all there are.

    Newton starts from `start`, from all sticking, all sliding and all open, and from each solution
    with the state of one node changed.
    """
    solutions = []
    for guess in (start, *all_alike(problem)):
        _add_solution(problem, solutions, newton(problem, guess))
    _add_solution(problem, solutions, lemke(problem))
    done = 0
    while done < len(solutions) < MANY:
        for guess in _neighbours(problem, solutions[done]):
            _add_solution(problem, solutions, newton(problem, guess))
        done += 1
    return solutions


def all_alike(problem: CoulombProblem) -> list[np.ndarray]:
    """Solutions of the linear systems in which all nodes stick, slide alike, or are open."""
    states = (STICK, FORWARD, BACKWARD) if problem.bilateral.all() else (
        STICK, FORWARD, BACKWARD, OPEN)
    ends = (problem.solution_in(np.full(problem.n, state)) for state in states)
    return [z for z in ends if z is not None]


def _neighbours(problem: CoulombProblem, x: np.ndarray):
    """Solutions of the linear systems of states that differ from those of x at one node.

    Where contact can pull, by the state or by the sign of the force that friction goes by.
    """
    states, sign = problem.states(x), problem.signs(x)
    for i in range(problem.n):
        for state, way in itertools.product(problem.choices(i),
                                            (1.0, -1.0) if problem.bilateral[i] else (1.0,)):
            if state == states[i] and way == sign[i]:
                continue
            other, signs = states.copy(), sign.copy()
            other[i], signs[i] = state, way
            y = problem.solution_in(other, signs)
            if y is not None:
                yield y


def descend(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """A solution by way of states that violate the law less and less, one node changed at a time.

    Newton's method starts from the PROMISING least violations around every point. None where no
    change of a single node lessens the violation.
    """
    z, violation = start, problem.violation(start)
    for _ in range(DESCENTS):
        near = list(_neighbours(problem, z))
        off = [problem.violation(y) for y in near]
        order = np.argsort(off, kind="stable")[:PROMISING]
        ends = (newton(problem, near[k], BRIEFLY) for k in order)
        solution = next((end for end in ends if end is not None), None)
        if solution is not None or not near or not off[order[0]] < violation:
            return solution
        z, violation = near[order[0]], off[order[0]]
    return None


def _add_solution(problem: CoulombProblem, solutions: list[np.ndarray],
                  z: np.ndarray | None) -> None:
    """Append z unless it is none or its forces are, to rounding, those of one of `solutions`."""
    if z is not None:
        x = z[: problem.rows]
        size = max(np.abs(y[: problem.rows]).max(initial=0) for y in (*solutions, z))
        if all(np.abs(x - y[: problem.rows]).max(initial=0) > DISTINCT * size for y in solutions):
            solutions.append(z)


def index(problem: CoulombProblem, z: np.ndarray) -> int:
    """Sign of the determinant of the law's linear system at the solution z.

    The signs of all solutions add up to one (degree of the map; without friction the sign is one),
    so -1 proves that there are two more at least - where supports hold all bodies.
    """
    return problem.system(problem.states(z), problem.signs(z)).index
