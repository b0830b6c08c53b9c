"""Solutions where Newton's and Lemke's methods find none: all states, descent; and what counts as a
solution where conditions depend on one another or bodies jam.
"""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.optimize

from driver.march import globalization
from driver.qp import approximations, branching, coefficients, complementarity, scaled
from driver.qp.coulomb import FORWARD, CoulombProblem
from driver.qp.scaled import Scaled
from driver.hard.bounded import unbalanced_by_friction
from driver.hard.states import States

SEEDS = 12


def random_problem(seed: int, nodes: int, motions: int, pulls: bool = False, largest: float = 4.0):
    """Bodies free in `motions`, of which a part has no equilibrium; `pulls`: bilateral contact."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2 * nodes, 2 * nodes + 1))
    unit = 10 ** rng.uniform(-0.5, 0.5, 2 * nodes)
    return CoulombProblem(root @ root.T * np.outer(unit, unit), rng.standard_normal(2 * nodes),
                          rng.uniform(0.1, largest, nodes), np.arange(nodes), pulls,
                          rng.standard_normal((2 * nodes, motions)), rng.standard_normal(motions))


def has_solution(problem: CoulombProblem) -> bool:
    """By trying all states, with all signs of the forces where contact pulls."""
    signs = itertools.product((1.0, -1.0), repeat=problem.n) if problem.bilateral.any() else (
        np.ones(problem.n),)
    return any(problem.solves(problem.solution_in(np.array(states), np.array(sign)))
               for sign in signs
               for states in itertools.product(*map(problem.choices, range(problem.n))))


@pytest.mark.parametrize("nodes, motions, pulls", [(3, 1, False), (3, 2, False), (2, 0, True),
                                                   (2, 3, True)])
@pytest.mark.some(2)
def test_branch_and_bound_says_what_all_states_say(nodes, motions, pulls):
    """The solver's search, which then has a solution, and the judge's of the same problems."""
    none = 0
    for seed in range(10, 10 + SEEDS):
        problem = random_problem(seed, nodes, motions, pulls, 20.0 if pulls else 4.0)
        expected = has_solution(problem)
        found = branching.search_states(problem)
        assert found.certain and (found.solution is not None) == expected, seed
        assert not expected or problem.solves(found.solution)
        n, R, C = nodes, problem.motions, problem.compliance
        judged = States(np.hstack([C, R]), -problem.load[:n], -problem.load[n:],
                        problem.coefficient, problem.coefficient, np.zeros(n), R.T,
                        problem.balance, np.full(n, pulls), np.zeros((n, n), bool)).search(500)
        assert judged == expected, seed
        none += not expected
    assert none > 0 or pulls  # bodies that contact cannot pull back may fall off


@pytest.mark.parametrize("soft", [1e4, 1e7])
def test_ways_on_soft_springs_hide_nothing_from_searches(soft):
    """A body that springs hold by next to nothing: what it deforms by decides on its contact."""
    none = 0
    for seed in range(30, 30 + SEEDS):
        problem = random_problem(seed, 3, 1)
        way = np.random.default_rng(seed).standard_normal(6)
        C, load = problem.compliance + soft * np.outer(way, way), problem.load + 0.3 * soft * way
        problem = CoulombProblem(C, load, problem.coefficient, problem.pair, False,
                                 problem.motions, problem.balance)
        assert Scaled(problem).k >= 2  # the motion, and the way on the springs
        expected, found = has_solution(problem), branching.search_states(problem)
        assert found.certain and (found.solution is not None) == expected, seed
        none += not expected
    assert 0 < none < SEEDS


def test_soft_rows_move_stiff_ones_by_ways_that_are_unknowns():
    """C = L L' + rest, of which rest is stiff rows alone, and each row has its own stiffness."""
    rng = np.random.default_rng(4)
    root = np.vstack([np.eye(4), np.zeros((5, 4))]) + 0.1 * rng.standard_normal((9, 4))
    stiff = 1e-5 * (np.eye(5) + 0.1 * rng.standard_normal((5, 5)))
    C = root @ root.T
    C[4:, 4:] += stiff @ stiff.T
    L, rest, own = scaled._levels(C)
    assert L.shape == (9, 4)
    np.testing.assert_allclose(L @ L.T + rest, C, atol=1e-13)
    assert np.abs(rest[:4]).max() < 1e-14 and own[:4] == pytest.approx(np.diag(C)[:4])
    np.testing.assert_allclose(rest[4:, 4:], stiff @ stiff.T, atol=1e-13)
    np.testing.assert_allclose(own[4:], np.diag(stiff @ stiff.T), rtol=1e-2)
    assert scaled._levels(np.eye(3))[0].shape == (3, 0)


def test_what_nothing_loads_rests():
    """There is no size of a force to go by."""
    problem = random_problem(1, 2, 1)
    problem = CoulombProblem(problem.compliance, np.zeros(4), problem.coefficient, np.arange(2),
                             False, problem.motions, np.zeros(1))
    found = branching.search_states(problem)
    assert found.certain and not found.solution.any()


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_body_that_is_pulled_off_has_no_state(friction):
    """Contact does not pull: proved, not merely not found; pushed it rests on its two feet."""
    motions = np.array([[1.0], [1.0], [0.0], [0.0]])
    for force in (-1.0, 1.0):
        problem = CoulombProblem(np.diag([1.0, 2.0, 1.0, 2.0]), np.zeros(4), np.full(2, friction),
                                 np.arange(2), False, motions, np.array([force]))
        found = branching.search_states(problem)
        assert found.certain and (found.solution is None) == (force < 0)
    assert found.solution[:2].sum() == pytest.approx(1.0)
    assert found.solution[0] == pytest.approx(2 * found.solution[1])  # by their compliances


def test_branch_and_bound_knows_its_limits(monkeypatch):
    """Too many nodes, or programs, are no proof that there is no solution."""
    problem = random_problem(1, 3, 3)
    many = branching.search_states(random_problem(1, branching.MOST_NODES + 1, 1))
    assert many.solution is None and not many.certain
    monkeypatch.setattr(branching, "newton", lambda *_: None)
    solvable = next(problem for problem in (random_problem(seed, 3, 1) for seed in range(SEEDS))
                    if has_solution(problem))
    hidden = branching.search_states(solvable)  # states obey every law, but nothing is exact
    assert hidden.solution is None and not hidden.certain
    monkeypatch.setattr(branching, "PROGRAMS", 1)
    found = branching.search_states(problem)
    assert found.solution is None and not found.certain


def test_a_program_without_end_ends_the_search(monkeypatch):
    """It is stopped, the next ones would be like it, and nothing is proved."""
    given, milp = [], scipy.optimize.milp

    def endless(*args, options, **words):
        given.append(options["time_limit"])
        return milp(*args, options={**options, "time_limit": 0.0 if given[1:] else 1.0}, **words)

    monkeypatch.setattr(scipy.optimize, "milp", endless)
    monkeypatch.setattr(branching, "newton", lambda *_: None)  # so that there are next ones
    found = branching.search_states(random_problem(1, 3, 3))
    assert found.solution is None and not found.certain and given == 2 * [branching.CIRCLES]


# ------------------------------------------------------------------------------ programs

APART, PRESSES, PULLS = branching.APART, branching.PRESSES, branching.PULLS
STICKS, FORTH, BACK = branching.STICKS, branching.FORTH, branching.BACK
ANY = branching.ANY


class Known:
    """A problem of four nodes with a solution `z` in `contact` and `rub` (4,), drawn with them.

    Nodes 0 and 1 are bilateral if `pulls`; node 0 has no offset, node 1 no friction coefficient;
    `broken`: a node of which contact or friction does not obey the law.
    """

    def __init__(self, seed: int, pulls: bool, broken: str = ""):
        rng, n = np.random.default_rng(seed), 4
        root = rng.standard_normal((2 * n, 2 * n + 1))
        C, self.bilateral = root @ root.T, pulls & (np.arange(n) < 2)
        F, offset = rng.uniform(0.2, 1.5, n), rng.uniform(0.1, 0.5, n)
        offset[0], F[1] = 0.0, 0.0
        self.contact = np.where(self.bilateral, rng.choice([PRESSES, PULLS], n),
                                rng.choice([APART, PRESSES], n))
        self.rub = rng.choice([STICKS, FORTH, BACK], n)
        size = rng.uniform(0.5, 1.5, n)
        normal = np.select([self.contact == PRESSES, self.contact == PULLS], [size, -size], 0.0)
        over = np.where(self.contact == APART, -rng.uniform(0.5, 1.5, n), 0.0)
        bound = offset + F * np.abs(normal)
        part = np.select([self.rub == FORTH, self.rub == BACK], [1.0, -1.0],
                         rng.uniform(-0.8, 0.8, n))
        slip = np.select([self.rub == FORTH, self.rub == BACK], [1.0, -1.0],
                         0.0) * rng.uniform(0.5, 1.5, n)
        if broken == "contact":  # the last node presses from afar
            normal[3], over[3], part[3] = 1.0, -1.0, 0.5
            bound[3] = offset[3] + F[3]
            slip[3] = 0.0
        if broken == "friction":  # and slides inside its bound
            part[3], slip[3] = 0.5, 1.0
            bound[3] = max(bound[3], 0.1)
        x, R = np.append(normal, part * bound), rng.standard_normal((2 * n, 2))
        beta = rng.standard_normal(2)
        self.z = np.append(x, beta)
        self.problem = CoulombProblem(C, np.append(over, slip) + C @ x - R @ beta, F, np.arange(n),
                                      self.bilateral, R, R.T @ x, offset)
        self.strict = bound > 0
        self.slides = np.abs(slip) > 0

    def point(self, scaled) -> np.ndarray:
        """The unknowns of programs at the solution."""
        rows = self.problem.rows
        force = self.z[:rows] / scaled.unit / scaled.force
        moved = self.problem.movement(self.z) * scaled.unit / scaled.way
        k, whole = self.problem.k, scaled.rows.toarray()
        softly = -whole[len(whole) - scaled.k + k :, :rows] @ force  # what soft rows move all by
        of, motions, ways = np.split(whole[:rows], [rows, rows + k], axis=1)
        left = moved - of @ force - ways @ softly - scaled.given
        x = np.concatenate([force, np.linalg.lstsq(motions, left, rcond=None)[0], softly])
        np.testing.assert_allclose(scaled.rows[:rows] @ x + scaled.given, moved, atol=1e-10)
        np.testing.assert_allclose(scaled.exact(x), self.z, rtol=1e-8, atol=1e-9)
        return x


def inside(search, contact, rub, x) -> bool:
    """Whether x obeys the limits of given states, but for rounding."""
    row_low, row_high, low, high = search._limits(contact, rub)
    rows = search.rows @ x
    return bool((rows >= row_low - 1e-9).all() and (rows <= row_high + 1e-9).all()
                and (x >= low - 1e-9).all() and (x <= high + 1e-9).all())


@pytest.mark.parametrize("pulls", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_a_solution_is_inside_the_limits_of_its_states_alone(seed, pulls):
    """Of no state, of that of any node, and of all; outside as soon as a node is said to be in
    another one.
    """
    known = Known(seed, pulls)
    assert known.problem.solves(known.z)
    search = branching._Search(known.problem)
    x = known.point(search)
    # contact that pulls without friction has no sign to be decided on
    none = np.where(known.bilateral & (known.problem.coefficient == 0), PULLS, ANY)
    free, whole = np.zeros(4, int), np.where(none == PULLS, PULLS, known.contact)
    assert inside(search, none, free, x) and inside(search, whole, known.rub, x)
    assert not search._branches(none, free, x) and not search._branches(whole, known.rub, x)
    for node in range(4):
        for own, others, states in ((none, known.contact, (
                PRESSES, PULLS if known.bilateral[node] else APART)), (free, known.rub, (
                    STICKS, FORTH, BACK))):
            for state in states:
                one = own.copy()
                one[node] = state
                of = (one, free) if own is none else (whole, one)
                if others is known.contact and none[node] == PULLS:
                    continue
                if state == others[node]:
                    assert inside(search, *of, x)
                elif others is known.contact or known.slides[node] or (
                        known.strict[node] and state != STICKS):
                    assert not inside(search, *of, x), (node, state)


@pytest.mark.parametrize("pulls", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_the_node_that_breaks_its_law_is_decided_on(seed, pulls):
    """On its contact before its friction; in each way that there is, and nothing else changes."""
    free = np.zeros(4, int)
    for broken, ways in (("contact", {APART, PRESSES}), ("friction", {STICKS, FORTH, BACK})):
        known = Known(seed, pulls, broken)
        search = branching._Search(known.problem)
        x = known.point(search)
        none = np.where(known.bilateral & (known.problem.coefficient == 0), PULLS, ANY)
        assert not known.problem.solves(known.z)
        branches = search._branches(none, free, x)
        for contact, rub in branches:
            assert contact[:3].tolist() == none[:3].tolist() and not rub[:3].any()
            assert (rub[3] == ANY) == (broken == "contact") and (contact[3] == ANY) == (
                broken == "friction")
        assert {int(of[broken == "friction"][3]) for of in branches} == ways
        assert len(branches) == len(ways)


@pytest.mark.parametrize("seed", range(6))
def test_points_of_programs_press_and_open_least(seed):
    """No more than a solution does, at nodes that are not decided on; contact that pulls may."""
    known = Known(seed, seed % 2 == 1)
    search = branching._Search(known.problem)
    x, free = known.point(search), np.zeros(4, int)
    for contact in (free, np.where(np.arange(4) < 2, known.contact, ANY)):
        feasible, found = search._program(contact, free)
        assert feasible and inside(search, contact, free, found)

        def cost(of, open_=contact == ANY):
            over = search.rows[:4] @ of + search.given[:4]
            return (of[:4] * ~known.bilateral - over)[open_].sum()

        assert cost(found) <= cost(x) + 1e-9


def test_bodies_are_moved_by_nothing_but_their_motions():
    """Forces in equilibrium deform; what is rigid of their movements is left to the motions."""
    known = Known(1, False)
    scaled = Scaled(known.problem)
    x = known.point(scaled)
    x[8:] = 0.0
    moved = (scaled.rows[:8] @ x + scaled.given) * scaled.way / scaled.unit
    assert np.abs(known.problem.motions.T @ moved).max() < 1e-10 * np.abs(moved).max()
    # to the last motion that a row feels
    R = known.problem.motions
    twice = CoulombProblem(known.problem.compliance, known.problem.load, known.problem.coefficient,
                           known.problem.pair, False, np.column_stack([R, R[:, 0]]),
                           np.append(known.problem.balance, known.problem.balance[0]))
    for name in ("given", "work"):
        one, other = (getattr(Scaled(of), name) for of in (known.problem, twice))
        np.testing.assert_allclose(other[: len(one)], one, atol=1e-9)


def test_what_a_program_does_not_answer_is_no_proof(monkeypatch):
    """Other states may still be those of a solution."""
    known, calls = Known(2, False), []
    program, honest = branching._Search._program, branching.newton

    def unanswered(self, contact, rub):
        calls.append(contact)
        return (True, None) if len(calls) == 2 else program(self, contact, rub)

    monkeypatch.setattr(branching._Search, "_program", unanswered)
    monkeypatch.setattr(branching, "newton", lambda problem, *given: (
        None if len(calls) == 1 else honest(problem, *given)))
    monkeypatch.setattr(branching._Search, "_branches", lambda self, contact, rub, x: [
        (contact, rub), (contact, rub)] if len(calls) == 1 else [])
    found = branching.search_states(known.problem)
    assert found.certain and known.problem.solves(found.solution) and len(calls) == 3
    calls.clear()
    monkeypatch.setattr(branching._Search, "_program", lambda *_: (True, None))
    assert branching.search_states(known.problem) == branching.Search(None, False)
    monkeypatch.setattr(branching._Search, "_program", program)
    monkeypatch.setattr("scipy.optimize.milp", lambda *_, **more: SimpleNamespace(status=1, x=None))
    assert branching._Search(known.problem)._program(*np.zeros((2, 4), int)) == (True, None)


@pytest.mark.parametrize("scale", [1e-6, 1e5])
def test_searches_do_not_know_units(scale, monkeypatch):
    """Of length and of force: linear programs are the same ones, in numbers of order one."""
    made, honest = [], Scaled.__init__

    def init(self, problem):
        honest(self, problem)
        made.append(self)

    monkeypatch.setattr(Scaled, "__init__", init)
    one = random_problem(3, 3, 2)
    one.offset = np.array([0.1, 0.0, 0.2])
    other = CoulombProblem(one.compliance * scale**2, one.load * scale, one.coefficient, one.pair,
                           False, one.motions * scale, one.balance, one.offset / scale)
    first, second = branching.search_states(one), branching.search_states(other)
    assert first.certain and (first.solution is None) == (second.solution is None)
    for name in ("given", "offset", "work", "cone_matrix"):
        np.testing.assert_allclose(getattr(made[1], name), getattr(made[0], name), rtol=1e-9,
                                   atol=1e-12)
    np.testing.assert_allclose(made[1].rows.toarray(), made[0].rows.toarray(), atol=1e-9)
    x = np.random.default_rng(1).standard_normal(8)
    z = made[0].exact(x)
    np.testing.assert_allclose(made[1].exact(x)[:6] * scale, z[:6], rtol=1e-9)
    # forces in equilibrium move rows as the problem says
    net = made[0].rows[-2:].toarray()
    x -= np.linalg.pinv(net) @ (net @ x - made[0].work)
    z = made[0].exact(x)
    np.testing.assert_allclose(one.motions.T @ z[:6], one.balance, rtol=1e-9)
    moved = (made[0].rows[:6] @ x + made[0].given) * made[0].way / made[0].unit
    np.testing.assert_allclose(one.movement(z), moved, atol=1e-9 * np.abs(moved).max())


def test_descent_by_single_states_leads_to_a_solution():
    """From all nodes alike, for bodies without support; where there is no solution to none."""
    ends, exist = 0, 0
    for seed in range(SEEDS):
        problem = random_problem(seed, 3, 2)
        starts = complementarity.all_alike(problem)
        found = [z for z in (complementarity.descend(problem, start) for start in starts)
                 if z is not None]
        assert all(problem.solves(z) for z in found)
        ends, exist = ends + bool(found), exist + has_solution(problem)
    assert 0.7 * exist <= ends <= exist


def test_descent_goes_from_less_to_less(monkeypatch):
    """By several points where one is not enough, each violating the law less than the one before;
    and no farther than to one beside which nothing violates it less.
    """
    visited, honest = [], complementarity._neighbours
    monkeypatch.setattr(complementarity, "_neighbours",
                        lambda problem, z: visited.append(z) or honest(problem, z))
    monkeypatch.setattr(complementarity, "PROMISING", 1)
    most, given_up = 0, 0
    for seed in range(5):
        problem = random_problem(seed, 4, 3, largest=20.0)
        for start in complementarity.all_alike(problem):
            visited.clear()
            found = complementarity.descend(problem, start)
            off = [problem.violation(z) for z in visited]
            assert all(after < before for before, after in zip(off, off[1:]))
            most = max(most, len(visited) if found is not None else 0)
            if found is None and len(visited) < complementarity.DESCENTS:
                assert min(map(problem.violation, honest(problem, visited[-1]))) >= off[-1]
                given_up += 1
    assert most > 1 and given_up > 0


def test_conditions_that_depend_on_one_another_share_a_force_evenly():
    """Two nodes at one place: of all forces that stop it those with the least squares."""
    problem = CoulombProblem(np.ones((2, 2)), np.full(2, 3.0), np.zeros(0), np.zeros(0, int), True)
    z = problem.solution_in(np.array([1, 1]))
    assert z == pytest.approx([1.5, 1.5])
    apart = problem.under(np.array([3.0, 2.0]), problem.coefficient)
    assert apart.solution_in(np.array([1, 1])) is None  # one place, two gaps
    # three conditions on two displacements, of which rounding hides that they depend
    rows = np.random.default_rng(3).standard_normal((3, 2))
    way = rows @ np.array([0.7, -0.4])
    three = CoulombProblem(rows @ rows.T, way, np.zeros(0), np.zeros(0, int), True)
    forces = three.solution_in(np.ones(3, int))
    assert forces == pytest.approx(np.linalg.pinv(rows @ rows.T) @ way)


@pytest.mark.parametrize("seed", range(4))
def test_conditions_that_depend_on_one_another_slide_on_their_bounds(seed):
    """Three nodes on a rigid bottom: a row inside its bound by a rounding would count as sticking.
    """
    rng = np.random.default_rng(seed)
    rows = np.column_stack([np.ones(3), rng.random(3)])
    rows = np.block([[rows, np.zeros((3, 1))], [np.zeros((3, 2)), np.ones((3, 1))]])
    problem = CoulombProblem(rows @ rows.T, rows @ rng.random(3), 0.1 + rng.random(3), np.arange(3))
    z = problem.solution_in(np.full(3, FORWARD))
    assert np.array_equal(z[3:], problem.coefficient * np.abs(z[:3])) and z[:3].any()


def test_forces_that_run_in_a_circle_excuse_nothing():
    """Forces of 1e12 that hold one another leave the loads unanswered, however small beside them.
    """
    problem = CoulombProblem(np.ones((2, 2)), np.full(2, 3.0), np.zeros(0), np.zeros(0, int), True)
    assert problem.solves(np.array([2.0, 1.0]))
    assert not problem.solves(np.array([1e12, -1e12]))
    for unit in (1.0, 1e-5):
        of = problem.under(unit * problem.load, problem.coefficient)
        circle = 1e12 * unit * np.array([1.0, -1.0])
        assert of.violation(circle) == pytest.approx(1e-3)  # 3 of 1e3 times 3


def test_friction_that_its_own_slip_changes(monkeypatch):
    """A node of compliance 1 that presses by 1 and is dragged by 1: the slip s is what friction
    leaves, s = 1 - F(s).

    F falls from 0.6 by s / 2, so that s = 0.8, F = 0.2. With F = 0.6 - 2 s nothing is left of it
    from s = 0.3 on: s = 1. Where F grows from 0.5 by 4 s, faster than successive approximations
    follow, s = 0.1, F = 0.9. Steps with the derivative of the law are few.
    """
    monkeypatch.setattr(coefficients, "STEPS", 6)
    problem = CoulombProblem(np.eye(2), np.array([1.0, 1.0]), np.array([0.5]), np.array([0]))
    start = complementarity.newton(problem, np.zeros(2))
    for slope, first, slip in ((-0.5, 0.6, 0.8), (-2.0, 0.6, 1.0), (4.0, 0.5, 0.1)):
        z = coefficients.consistent(
            problem, start, lambda s: np.maximum(first + slope * np.abs(s), 0.0))
        assert np.isclose(problem.movement(z)[1], slip, rtol=1e-9)


def test_what_is_found_has_the_friction_of_its_slip():
    """Three nodes of a body that may move one way, friction up to half as much again by slip.

    A solution of the problem with the coefficients of its own slip is right however it is found.
    """
    found = 0
    for seed in range(30):
        problem = random_problem(seed, 3, 1)
        start = complementarity.newton(problem, problem.whole(np.zeros(problem.rows)))
        if start is None:
            continue

        def law(slip, own=problem.coefficient):
            return own * (1 + 0.5 * np.tanh(np.abs(slip)))

        asked = []
        z = coefficients.consistent(
            problem, start, lambda slip, law=law, asked=asked: asked.append(law(slip)) or asked[-1])
        if z is not None:
            slip = problem.movement(z)[problem.n :]
            assert problem.under(problem.load, law(slip)).solves(z)
            # to the last bit, by which solvers tell what slides from what sticks
            bound, shear = asked[-1] * z[problem.pair], np.abs(z[problem.n : problem.rows])
            assert np.array_equal(shear >= bound, np.abs(slip) > 1e-9)
            assert (shear <= bound).all() and (z[: problem.n] >= 0).all()
            found += 1
    assert found >= 10


@pytest.mark.parametrize("seed", range(5))
def test_the_derivative_is_that_of_the_residual(seed):
    """Of a law that depends on slip, by central differences, where no state changes between."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((6, 7))
    problem = CoulombProblem(root @ root.T, rng.standard_normal(6), np.ones(3), np.arange(3), False,
                             offset=np.full(3, 0.1))
    equations = coefficients._Equations(problem, lambda slip: 0.4 / (1 + slip**2))
    z, step = rng.standard_normal(6), 1e-6

    def residual(z):
        return equations.residual(z, problem.movement(z))

    expected = np.column_stack([
        (residual(z + step * e) - residual(z - step * e)) / (2 * step) for e in np.eye(6)])
    # by the unknowns over their units
    found = equations.derivative(z, problem.movement(z))
    np.testing.assert_allclose(found, expected * equations.unit,
                               atol=1e-5 * np.abs(expected).max() * equations.unit.max())


@pytest.mark.parametrize("slip", [1e-9, -1e-9])
def test_a_law_of_the_size_of_slip_is_derived_on_its_own_side(slip):
    """Nearer to where nothing slides than the difference that derivatives are taken by, 1e-7 of the
    largest slip.
    """
    problem = CoulombProblem(np.eye(4), np.zeros(4), np.ones(2), np.arange(2))
    z = np.array([1.0, 2.0, 0.0, 0.0])
    problem.load = z + np.array([0.0, 0.0, 1.0, slip])
    z[3] = 4.0 * np.sign(slip)  # it slides
    problem.load[3] += z[3]
    equations = coefficients._Equations(problem, lambda s: 0.5 + np.abs(s))
    # lambda_t - sign (0.5 + |slip|) 2, where slip falls by lambda_t
    assert equations.derivative(z, problem.movement(z))[3, 3] == pytest.approx(1.0 + 2.0, rel=1e-6)


def test_friction_that_cannot_balance_a_push_is_known_without_a_search():
    """Bilateral contact with friction whose own pressures are bounded, and a motion along it.

    Whenever the bounds say that there is no solution, trying all states and signs says so.
    """
    said, none = 0, 0
    for seed in range(12):
        problem = random_problem(seed, 3, 2, True, 0.3)
        problem.motions[:3, 0] = 0.0  # slides along all contact
        expected, n = has_solution(problem), problem.n
        states = States(np.hstack([problem.compliance, problem.motions]), -problem.load[:n],
                        -problem.load[n:], problem.coefficient, problem.coefficient, np.zeros(n),
                        problem.motions.T, problem.balance, np.full(n, True),
                        np.zeros((n, n), bool))
        share, _ = unbalanced_by_friction(states)
        assert share <= 1e-6 or not expected, seed
        said, none = said + (share > 1e-6), none + (not expected)
    assert 0.5 * none < said


@pytest.mark.parametrize("seed, motions, pulls, friction", [(75, 2, True, 20.0),
                                                            (64, 3, False, 100.0)])
@pytest.mark.some(1)
def test_a_path_ends_in_a_solution_that_other_methods_do_not_find(seed, motions, pulls, friction):
    """Found by going through random problems: five nodes, much friction."""
    problem = random_problem(seed, 5, motions, pulls, friction)
    start = problem.whole(0 * problem.load)
    assert approximations.approached(problem, start) is None
    assert globalization._newton_from_all_alike(problem) is None
    assert complementarity.lemke(problem) is None
    assert globalization._descended(problem, start) is None
    found, method = globalization.solve_condensed(problem, start)
    assert problem.solves(found) and method == globalization.CONTINUATION


@pytest.mark.parametrize("force, solves", [(1e-19, True), (1e-12, False)])
def test_a_loose_body_without_loads_feels_no_rounding(force, solves):
    """A node that just touches where gaps are of 1, and what rounding leaves of its force: nothing
    else acts on the body, of whose forces it is all.
    """
    body = CoulombProblem(np.eye(2), np.array([0.0, -1.0]), np.zeros(0), np.zeros(0, int), False,
                          np.array([[1.0], [1.0]]), np.zeros(1))
    assert body.solves(np.array([force, 0.0, 0.0])) == solves
