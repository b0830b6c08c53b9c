"""Friction bounds affine in the pressure, |lambda_t| <= c + F lambda_n, on the dense contact
problem.

The law is written down anew here; with F = 0 it is a box QP, which an independent oracle solves.
Coulomb's law alone (c = 0) is tested with the time stepping, in tests/march/test_uniqueness.py.
"""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from contact_law import assert_obeys
from driver.hard.dense import box_qp
from driver.qp import complementarity, pivots, state_system
from driver.qp.complementarity import all_solutions, index, lemke, newton, search, settled
from driver.contact.states import OPEN, STICK
from driver.qp.coulomb import BACKWARD, FORWARD, CoulombProblem
from driver.qp.state_system import StateSystem

SEEDS = 20


def random_problem(seed, nodes, largest=3.0, motions=0, bilateral=False):
    """A problem whose rows are of different size, with offsets that are zero at some nodes; bodies
    free in `motions`.
    """
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2 * nodes, 2 * nodes + 1))
    unit = 10 ** rng.uniform(-0.5, 0.5, 2 * nodes)
    offset = rng.uniform(0.05, 0.5,
                         nodes) * (rng.random(nodes) < np.where(np.arange(nodes) == 0, 1.0, 0.7))
    free = {}
    if motions:
        R = rng.standard_normal((2 * nodes, motions))
        normal = rng.uniform(0.2, 1.0, nodes)  # forces inside their bounds: rigid bodies can rest
        free = {"motions": R,
                "balance": R.T @ np.append(normal, rng.uniform(-1, 1, nodes) * offset)}
    return CoulombProblem(root @ root.T * np.outer(unit, unit), rng.standard_normal(2 * nodes),
                          rng.uniform(0, largest, nodes), np.arange(nodes), bilateral,
                          offset=offset, **free)


def among(x, solutions):
    return any(np.abs(x - y).max() <= 1e-7 * max(np.abs(y).max(), 1e-300) for y in solutions)


def test_given_bounds_are_a_box_qp():
    """F = 0: one solution, that of min 1/2 x'Cx - d'x in the box 0 <= lambda_n, |lambda_t| <= c; by
    every method.
    """
    reached = 0
    for seed in range(SEEDS):
        problem = random_problem(seed, 3, largest=0.0)
        n, c = problem.n, problem.offset
        expected = box_qp(problem.compliance, problem.load, np.append(np.zeros(n), -c),
                          np.append(np.full(n, np.inf), c))
        np.testing.assert_allclose(lemke(problem), expected, rtol=0,
                                   atol=1e-9 * np.abs(expected).max())
        solutions = all_solutions(problem)
        assert len(solutions) == 1 and among(solutions[0], [expected]) and index(problem,
                                                                                 expected) == 1
        x = newton(problem, np.zeros(2 * n))
        assert x is None or among(x, [expected])
        reached += x is not None
    assert reached > SEEDS / 2  # Newton's convergence is local, but not rare


@pytest.mark.parametrize("nodes", [1, 2, 3])
@pytest.mark.some(2)
def test_solutions_obey_the_affine_law(nodes):
    """Enumerated ones, of signs that add up to one (degree of the law); those of the other methods
    are among them.
    """
    several = apart = 0
    for seed in range(SEEDS):
        problem = random_problem(seed, nodes, largest=6.0)
        solutions = all_solutions(problem)
        for x in solutions:
            assert_obeys(problem, x)
            apart += bool((problem.states(x) < 0).any())
        assert sum(index(problem, x) for x in solutions) == 1, seed
        assert among(lemke(problem), solutions), seed
        x = newton(problem, np.zeros(2 * nodes))
        assert x is None or among(x, solutions)
        assert all(among(x, solutions) for x in search(problem, solutions[0])), seed
        several += len(solutions) > 1
    assert apart > 0, "no open node was held by its offset"
    assert several > 0 or nodes < 3


@pytest.mark.parametrize("nodes", [4, 8])
def test_successive_box_qps_find_the_same(nodes):
    """Little friction: the one fixed point of box QPs with the bounds of the last pressures."""
    for seed in range(SEEDS):
        problem = random_problem(seed, nodes, largest=0.1)
        n, x = problem.n, np.zeros(2 * nodes)
        for _ in range(100):
            bound = problem.offset + problem.coefficient * x[:n]
            x, last = box_qp(problem.compliance, problem.load, np.append(np.zeros(n), -bound),
                             np.append(np.full(n, np.inf), bound)), x
            if np.abs(x - last).max() <= 1e-12 * np.abs(x).max():
                break
        else:
            continue  # does not contract: nothing to compare with
        assert_obeys(problem, x)
        z = lemke(problem)
        assert among(z, [x]), seed
        near = z * (1 + 1e-7)
        found = settled(problem, near, problem.movement(near))
        assert found is not None and among(found[0], [x]), seed
        np.testing.assert_allclose(found[1], problem.load - problem.compliance @ x,
                                   atol=1e-6 * np.abs(problem.load).max())


def test_sliding_nodes_are_exactly_on_their_bounds():
    """Comparisons with c + F lambda_n decide what slides: no rounding may come between."""
    sliding = 0
    for seed in range(SEEDS):
        problem = random_problem(seed, 3)
        x = lemke(problem)
        slides = np.abs(problem.states(x)) > 1
        bound = problem.offset + problem.coefficient * np.abs(x[:3])
        assert np.array_equal(np.abs(x[3:])[slides], bound[slides])
        sliding += slides.sum()
    assert sliding > SEEDS / 2


@pytest.mark.parametrize("pulls", [False, [True, False, False], [True, False, True]])
@pytest.mark.parametrize("largest", [0.0, 0.3])
def test_pivots_alone_end_in_the_solution(monkeypatch, largest, pulls):
    """Without Newton's method: bounds are given (F = 0, a convex problem) or friction is small."""
    monkeypatch.setattr(complementarity, "newton", lambda *_: None)
    for seed in range(SEEDS):
        problem = random_problem(seed, 3, largest=largest, bilateral=np.array(pulls))
        assert_obeys(problem, lemke(problem), bilateral=pulls)


@pytest.mark.parametrize("pulls", [[True, True, True], [True, False, True]])
def test_bilateral_law(pulls):
    """Of all nodes or some; with little friction Lemke's method solves nearly all of them."""
    solved = 0
    for seed in range(SEEDS):
        problem = random_problem(seed, 3, largest=0.5, bilateral=np.array(pulls))
        for x in search(problem, np.zeros(6)):
            assert_obeys(problem, x, bilateral=pulls)
        assert newton(problem, np.zeros(6)) is not None or seed  # the first one converges
        x = lemke(problem)
        if x is not None:
            assert_obeys(problem, x, bilateral=pulls)
            solved += 1
    assert solved > 0.8 * SEEDS


@pytest.mark.parametrize("nodes, motions", [(2, 1), (2, 2), (3, 3)])
@pytest.mark.some(2)
def test_bodies_without_support(nodes, motions):
    """Solutions balance the loads, too; where there are none Lemke's method finds none."""
    some = 0
    for seed in range(SEEDS):
        problem = random_problem(seed, nodes, motions=motions)
        solutions = all_solutions(problem)
        for z in solutions:
            assert_obeys(problem, z)
        z = lemke(problem)
        assert (z is None) == (not solutions), seed
        if z is not None:
            assert_obeys(problem, z)
            some += 1
    assert some > SEEDS / 3


def test_units():
    """Lengths in 2^-30, forces in 2^40: the same states, scaled exactly."""
    length, force = 2.0**-30, 2.0**40
    for seed in range(SEEDS):
        plain = random_problem(seed, 3)
        scaled = CoulombProblem(plain.compliance * (length / force), plain.load * length,
                                plain.coefficient, plain.pair,
                                offset=plain.offset * force)
        assert np.array_equal(lemke(scaled), lemke(plain) * force)


def test_offsets_of_zero_are_coulombs_law():
    for seed in range(SEEDS):
        plain = random_problem(seed, 3)
        plain = CoulombProblem(plain.compliance, plain.load, plain.coefficient, plain.pair)
        zero = CoulombProblem(plain.compliance, plain.load, plain.coefficient, plain.pair,
                              offset=np.zeros(3))
        assert np.array_equal(lemke(plain), lemke(zero))


def test_the_same_bodies_under_other_offsets():
    """`under` keeps the offset unless another one is given; systems that are kept are not those of
    another offset.
    """
    problem, plain = random_problem(0, 3), CoulombProblem
    load, coefficient, pair = problem.load, problem.coefficient, problem.pair
    for offset in (problem.offset, np.full(3, 0.3), np.zeros(3)):
        alone = plain(problem.compliance, load, coefficient, pair, offset=offset)
        assert np.array_equal(lemke(problem.under(load, coefficient, offset=offset)), lemke(alone))
    states, sign = np.full(3, 2), np.ones(3)
    others = (problem.under(load, coefficient, offset=np.full(3, c)) for c in (0.1, 0.2))
    small, large = (other.solution_in(states, sign) for other in others)
    assert not np.array_equal(small, large)
    assert np.array_equal(problem.under(2 * load, coefficient).offset, problem.offset)


def test_states_of_multipliers():
    """What pressures and the signs of sliding show: an open node with an offset sticks or slides,
    too.
    """
    problem = CoulombProblem(np.eye(6), np.ones(6), np.ones(3), np.arange(3),
                             offset=np.array([1.0, 1.0, 0.0]))
    x, signs = np.array([0.0, 2.0, 0.0, 1.0, -3.0, 0.0]), np.array([1.0, -1.0, 1.0])
    assert problem.states_of(x, signs).tolist() == [-2, 3, 0]
    assert problem.states_of(x, 0 * signs).tolist() == [-1, 1, 0]


@pytest.mark.parametrize("n", [3, 5, 7])
def test_lemke_does_not_cycle(n):
    """Kostreva's matrix with equal right-hand sides, where every ratio test has ties: taking the
    first of them goes round in circles (M. Kostreva, Math. Programming 16 (1979) 127-130).
    """
    M, q = np.eye(n) + 2 * np.roll(np.eye(n), 1, axis=1), -np.ones(n)
    z = pivots.solution(M, q, np.ones(n))
    np.testing.assert_allclose(z, 1 / 3, rtol=1e-12)  # the P-matrix has this solution alone


@pytest.mark.parametrize("seed", range(12))
def test_a_zero_that_stays_is_no_ray(seed):
    """Bodies on soft springs, of which many nodes are open: any s >= |slip| will do there, and the
    artificial variable becomes zero together with others. With ten of these seeds one of the others
    leaves: the artificial one stays as a zero, in the solution all the same.
    """
    rng = np.random.default_rng(seed + 25)
    root, motions = rng.standard_normal((40, 41)), rng.standard_normal((40, 3))
    load = rng.standard_normal(40) - np.repeat([0.5, 0.0], 20)
    problem = CoulombProblem(root @ root.T / 20 + 100 * motions @ motions.T, load,
                             np.full(20, 1.5), np.arange(20))
    scale = np.sqrt(problem.rigidity)
    M, q, _ = complementarity._complementary(problem, scale, np.abs(load * scale).max())
    z = pivots.solution(M, q, np.ones(len(q)))
    w = M @ z + q
    # a few hundred pivots, condition of the bases up to 1e7: eps times these
    assert z.min() >= 0 and w.min() >= -1e-8 and np.abs(z * w).max() <= 1e-8


def test_wide_gaps_hide_no_violation():
    """The force of a node that overlaps by 1e-9 counts, although another one is open by 1."""
    load = np.array([1e-9, -1.0, 0.0, 0.5])
    problem = CoulombProblem(np.eye(4), load, np.full(2, 0.3), np.arange(2))
    assert not problem.solves(np.zeros(4))
    assert problem.solves(np.array([1e-9, 0.0, 0.0, 0.0]))


def test_forces_inside_a_body_hide_no_imbalance():
    """A body lies on a node by its weight of one; lips of a slit in it press by 1e9. A thousandth
    of the weight is missing: no equilibrium, however little that is beside what the lips carry.
    """
    problem = CoulombProblem(np.eye(2), np.array([0.0, 1e9]), np.zeros(0), np.arange(0),
                             motions=np.array([[1.0], [0.0]]), balance=np.ones(1))
    assert problem.solves(np.array([1.0, 1e9, 1.0]))
    assert not problem.solves(np.array([0.999, 1e9, 0.999]))
    assert problem.violation(np.array([0.999, 1e9, 0.999])) == pytest.approx(1e-3 / 1.999)


@pytest.mark.parametrize("seed", range(5))
def test_pivots_are_those_of_a_right_side_moved_by_powers(seed):
    """Of rows that tie, q + (e, e^2, ...) singles out one for every small e > 0: entries of the
    inverse basis in the order of w, each over the row's entry in the column that comes in.
    """
    rng = np.random.default_rng(seed)
    inverse, entry = rng.integers(-2, 3, (4, 4)).astype(float), rng.integers(1, 5, 4).astype(float)
    inverse[:2] = inverse[2:] * (entry[:2] / entry[2:])[:, None]  # two pairs that tie for long
    inverse[[0, 1], [3, 3]] += 1.0
    # w of all rows are out of the basis: their columns stand first in the tableau
    nonbasic, basic = np.arange(5), np.arange(4) + 5
    table = np.column_stack([inverse, np.zeros(4), np.zeros(4)])
    row = pivots._lexicographic(  # pylint: disable=protected-access
        table, basic, nonbasic, np.arange(4), entry)
    moved = inverse @ 1e-3 ** np.arange(1, 5) / entry
    assert row == np.argmin(moved)


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_springs_do_not_know_the_unit_of_a_motion(scale):
    """A body on springs yields by as much whatever its motions are multiplied by; and by the
    forces that it lacks: softness per unit reach.
    """
    one = random_problem(3, 4, motions=1)
    other = CoulombProblem(one.compliance, one.load, one.coefficient, one.pair, one.bilateral,
                           motions=scale * one.motions, balance=scale * one.balance,
                           offset=one.offset)
    rest = np.array([0.7])
    soft, same = one.on_springs(0.2, rest), other.on_springs(0.2, rest / scale)
    np.testing.assert_allclose(same.compliance, soft.compliance, rtol=1e-12)
    np.testing.assert_allclose(same.load, soft.load, rtol=1e-12)
    z = np.append(np.linspace(0.5, 1.0, one.rows), 0.3)  # off balance, and by as much
    assert other.violation(np.append(z[:-1], z[-1] / scale)) == pytest.approx(one.violation(z))
    twice = one.on_springs(0.4, rest)
    np.testing.assert_allclose(twice.compliance - soft.compliance, soft.compliance - one.compliance,
                               rtol=0, atol=1e-12 * np.abs(twice.compliance).max())


@pytest.mark.parametrize("unit", [1e-6, 1e4])
def test_springs_for_lemke_are_as_soft_as_the_bodies(unit, monkeypatch):
    """And softer by tens, in any unit of length over force; two rests of each once they differ."""
    problem, asked = random_problem(2, 3, motions=1), []
    soft = CoulombProblem(unit * problem.compliance, unit * problem.load, problem.coefficient,
                          problem.pair, False, problem.motions, problem.balance, problem.offset)
    monkeypatch.setattr(CoulombProblem, "on_springs",
                        lambda self, softness, rest: asked.append(softness))
    monkeypatch.setattr(complementarity, "all_solutions", lambda problem: [])
    monkeypatch.setattr(CoulombProblem, "solves", lambda self, z: False)
    expected = np.median(np.diag(problem.compliance)) * 10.0 ** np.arange(complementarity.SPRINGS)
    for found, softnesses in ((None, expected), (np.zeros(6), np.repeat(expected, 2)[1:])):
        monkeypatch.setattr(complementarity, "lemke", lambda problem, found=found: found)
        for one, length in ((problem, 1.0), (soft, unit)):
            del asked[:]
            assert complementarity._lemke_on_springs(one) is None
            np.testing.assert_allclose(asked, length * softnesses, rtol=1e-12)
    monkeypatch.setattr(complementarity, "lemke", lambda problem: None)
    # the last resort of a few nodes
    monkeypatch.setattr(complementarity, "all_solutions", lambda problem: ["one", "another"])
    for nodes, found in ((3, "one"), (complementarity.FEW, "one"), (complementarity.FEW + 1, None)):
        assert complementarity._lemke_on_springs(random_problem(2, nodes, motions=1)) == found


def test_springs_carry_what_forces_leave_of_the_balance():
    """From their rest on, by their softness over the square of a motion's reach."""
    problem, rng = random_problem(3, 3, motions=2), np.random.default_rng(5)
    rest, x, softness = rng.standard_normal(2), rng.standard_normal(6), 0.7
    sprung = problem.on_springs(softness, rest)
    beta = rest + softness * (problem.balance - problem.motions.T @ x) / problem.reach**2
    np.testing.assert_allclose(sprung.movement(x), problem.movement(np.append(x, beta)),
                               rtol=1e-12)
    assert sprung.k == 0 and sprung.offset is problem.offset


def test_forces_without_any_load_are_their_own_size():
    """They violate the law by as much as they move what nothing loads."""
    problem = CoulombProblem(np.eye(2), np.zeros(2), np.array([0.5]), np.array([0]))
    assert problem.solves(np.zeros(2))
    assert problem.violation(np.array([3.0, 0.0])) == pytest.approx(1.0)
    assert problem.violation(np.array([0.0, 3.0])) == pytest.approx(1.0)
    assert problem.violation(np.array([np.nan, 0.0])) == np.inf


@pytest.mark.parametrize("unit", [1e-8, 1e6])
def test_systems_do_not_know_the_unit_of_a_motion(unit):
    """Nor that of forces and lengths: entries and pivots are the same numbers."""
    one = random_problem(3, 3, motions=2)
    other = CoulombProblem(one.compliance * 1e-4, one.load * 1e-2, one.coefficient, one.pair, False,
                           one.motions * unit, one.balance * 100.0 * unit, one.offset * 100.0)
    for states in ([1, 1, 1], [2, 1, 3], [0, 2, 1], [-1, 1, 2]):
        systems = [of.system(np.array(states), np.ones(3)) for of in (one, other)]
        np.testing.assert_allclose(systems[1].matrix, systems[0].matrix, rtol=1e-9, atol=1e-12)
        assert systems[0].index == systems[1].index
        z, w = (of.solve(problem.load, problem.balance)
                for of, problem in zip(systems, (one, other)))
        np.testing.assert_allclose(w[:6], 100.0 * z[:6], rtol=1e-7)


def test_a_family_at_large_friction_has_its_directions_alone():
    """Two nodes whose rows depend, all of them slide: what rounding leaves is no further one."""
    rng = np.random.default_rng(1)
    root = rng.standard_normal((6, 8))
    root[[2, 5]] = 0.3 * root[[1, 4]]
    compliance = root @ root.T
    problem = CoulombProblem(compliance, compliance @ np.ones(6), np.full(3, 1e7), np.arange(3))
    system = problem.system(np.full(3, FORWARD), np.ones(3))
    found = system.family(problem.load, np.zeros(0))
    assert found is not None and found[1].shape[1] == 1
    line = found[1][:3, 0]
    assert line[1] == pytest.approx(-0.3 * line[2]) and abs(line[0]) < 1e-6 * abs(line[1])


@pytest.mark.parametrize("small, directions", [(1e-9, None), (1e-11, 1), (1e-13, 1), (0.0, 1)])
def test_a_system_is_singular_before_it_is_rounding(small, directions):
    """From a ratio of pivots of 1e-10 on there are directions along which nothing changes; only
    below 1e-14 no regular solution is tried.
    """
    problem = CoulombProblem(np.array([[1.0, 1.0], [1.0, 1.0 + small]]), np.ones(2), np.zeros(0),
                             np.zeros(0, int))
    system = problem.system(np.full(2, STICK), np.ones(2))
    family = system.family(problem.load, np.zeros(0))
    assert (family is None) == (directions is None)
    assert system.dependent == (small == 0.0)
    if family is not None:
        assert family[1].shape == (2, directions)
        np.testing.assert_allclose(family[0], [0.5, 0.5], atol=1e-2)
        np.testing.assert_allclose(family[1][0], -family[1][1], rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("at_a_time", [1, 2, 99])
def test_the_system_of_states_is_that_of_their_equations(seed, at_a_time, monkeypatch):
    """Free rows move by the forces of sliding nodes, too, and all forces balance on motions."""
    monkeypatch.setattr(state_system, "AT_A_TIME", at_a_time)
    problem = random_problem(seed, 5, motions=2)
    states = np.array([STICK, FORWARD, OPEN, BACKWARD, STICK])
    system = StateSystem(problem, states, np.ones(5))
    assert system.free.tolist() == [0, 1, 3, 4, 5, 9]
    force, C = np.zeros((10, 6)), problem.compliance
    force[system.free] = np.eye(6)
    force[[6, 8]] = problem.coefficient[[1, 3], None] * np.array([[1.0], [-1.0]]) * force[[1, 3]]
    motions = problem.motions @ system.turn
    matrix = np.block([[(C @ force)[system.free], -motions[system.free]],
                       [motions.T @ force, np.zeros((2, 2))]])
    matrix *= np.outer(system.scale, system.scale)
    np.testing.assert_allclose(system.matrix, matrix, rtol=1e-12, atol=1e-13)


def test_forces_tell_states():
    """Nodes on their bounds slide as their friction does, those without any in one direction."""
    problem = CoulombProblem(np.eye(10), np.zeros(10), np.array([0.5, 0.5, 0.5, 0.0, 0.5]),
                             np.arange(5))
    z = np.array([2.0, 2.0, 2.0, 2.0, 0.0, 1.0, -1.0, 0.9, 0.0, 0.0])
    assert problem.states_by_forces(z).tolist() == [FORWARD, BACKWARD, STICK, FORWARD, OPEN]


def test_a_family_of_solutions_is_one_along_its_directions():
    """Three nodes of which two move alike: what one presses more the other may press less."""
    compliance = np.zeros((6, 6))
    compliance[:3, :3] = [[2.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    compliance[3:, 3:] = np.eye(3)
    load = np.array([2.0, 1.5, 1.5, 0.0, 0.0, 0.0])
    problem = CoulombProblem(compliance, load, np.full(3, 0.5), np.arange(3), False)
    system = StateSystem(problem, np.full(3, STICK), np.ones(3))
    z, directions = system.family(load, np.zeros(0))
    assert directions.shape == (6, 1) and np.abs(directions).max() > 0.1
    for t in (-1.0, 0.0, 2.0):
        np.testing.assert_allclose(compliance @ (z + t * directions[:, 0]), load, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_inequalities_of_states_hold_in_them_alone(seed):
    """All of them at a solution in its own states, each strict one missed where another one holds:
    an open node that moves in, one that presses called open, a slip called the other way.
    """
    problem = random_problem(seed, 4, largest=0.5)
    z = lemke(problem)
    states, rounding = problem.states(z), 1e-8 * np.abs(problem.rigidity * problem.load).max()
    assert complementarity._slack(problem, states, z).min() >= -rounding
    assert len(complementarity._slack(problem, states, z)) == 4 + 2 * np.count_nonzero(states)
    moved = problem.movement(z)
    for node in np.flatnonzero((z[:4] <= 0) & (moved[:4] < 0)):
        apart = states.copy()
        apart[node] = OPEN
        pushed = z.copy()
        pushed[node] = 2 * moved[node] / problem.compliance[node, node]  # pulls until it is inside
        assert complementarity._slack(problem, apart, pushed).min() < -rounding
    for node in np.flatnonzero(states > OPEN):
        pulled = z.copy()
        pulled[node] = -1.0
        assert complementarity._slack(problem, states, pulled).min() <= -1.0 + rounding
    for node, way in itertools.product(np.flatnonzero(states == STICK), (-1.0, 1.0)):
        rubbed = z.copy()
        rubbed[4 + node] = way * (problem.offset[node] + problem.coefficient[node] * z[node] + 1.0)
        assert complementarity._slack(problem, states, rubbed).min() <= -1.0 + rounding
    for node in np.flatnonzero(states > STICK):
        other = states.copy()
        other[node] = FORWARD + BACKWARD - states[node]
        if abs(moved[4 + node]) > 1e-6:
            assert complementarity._slack(problem, other, z).min() < -rounding


@pytest.mark.parametrize("nodes, changes, settles", [
    (400, (300, 6, 8, 0), True), (400, (300, 6, 9, 0), False),  # two nodes in a hundred
    (100, (60, 3, 4, 0), True), (100, (60, 3, 5, 0), False), (100, (60, 30, 20, 0), True)])
def test_newton_that_narrows_goes_on_while_few_nodes_change(nodes, changes, settles):
    """Many more than in the step before say that it leads away: other ways are quicker."""
    states = [np.zeros(nodes, int)]
    for count in changes:
        states.append(np.where(np.arange(nodes) < count, 1 - states[-1], states[-1]))
    problem = SimpleNamespace(
        n=nodes, states=lambda step: states[step], signs=lambda step: np.ones(nodes),
        solution_in=lambda *_: taken.append(1) or len(taken), solves=lambda step: step == 4,
        violation=lambda step: 0.0 if step == 4 else 1.0)
    taken = []
    assert complementarity.newton(problem, 0, narrowing=True) == (4 if settles else None)


@pytest.mark.parametrize("friction, pressed, sheared, isolated", [
    (0.5, 2.0, 0.2, False),  # what one presses more the other may press less
    (0.5, 0.0, 0.0, False),  # and does not: a single point of a line obeys the law
    (0.5, 2.0, 0.9, True),  # which friction cannot hold, however pressure is shared
    (0.5, -1.0, 0.0, True)])  # nor contact that would have to pull
def test_a_line_of_solutions_is_one_where_the_law_holds_on_it(friction, pressed, sheared, isolated):
    """Two nodes in one place under a force in all, the states in which they stick alone."""
    C = np.zeros((4, 4))
    C[:2, :2] = 1.0
    C[2:, 2:] = [[1.0, 0.5], [0.5, 1.0]]
    shear = np.array([sheared, sheared])
    problem = CoulombProblem(C, np.append([pressed, pressed], C[2:, 2:] @ shear),
                             np.full(2, friction), np.arange(2))
    states = np.full(2, STICK)
    family = problem.system(states, np.ones(2)).family(problem.load, problem.balance)
    assert family[1].shape == (4, 1)
    assert complementarity._obeys_somewhere(problem, states, *family) != isolated
    # wherever on the line the search begins, and whichever way it is told to be
    z, line = family
    for away, sign in ((30.0, 1.0), (-7.0, -2.0)):
        assert complementarity._obeys_somewhere(problem, states, z + away * line[:, 0],
                                                sign * line) != isolated
    assert isolated or not complementarity.all_isolated(problem)


@pytest.mark.parametrize("seed", range(6))
def test_pivots_end_in_the_solution_itself(seed, monkeypatch):
    """Newton's method, where it is needed, starts from it: in the units of the problem."""
    problem, starts = random_problem(seed, 3, largest=0.3), []
    monkeypatch.setattr(CoulombProblem, "solution_in", lambda *_: None)
    monkeypatch.setattr(complementarity, "newton", lambda problem, start: starts.append(start))
    assert lemke(problem) is None
    assert_obeys(problem, starts[0])


@pytest.mark.parametrize("seed", range(4))
def test_bodies_on_springs_are_where_these_give_way_to(seed, monkeypatch):
    """What Newton's method starts from obeys contact and friction; forces may be off balance."""
    problem, starts, sprung = random_problem(seed, 3, largest=0.3, motions=2), [], []
    honest = CoulombProblem.on_springs
    monkeypatch.setattr(CoulombProblem, "on_springs", lambda self, *given: sprung.append(
        honest(self, *given)) or sprung[-1])

    def newton_(of, start, *_):
        if of is problem:
            starts.append((start, sprung[-1]))

    monkeypatch.setattr(complementarity, "newton", newton_)
    monkeypatch.setattr(complementarity, "all_solutions", lambda problem: [])
    exact = CoulombProblem.solution_in
    monkeypatch.setattr(CoulombProblem, "solution_in", lambda self, *given: (
        None if self is problem else exact(self, *given)))
    complementarity.lemke(problem)
    assert starts
    for z, on_springs in starts:
        np.testing.assert_allclose(problem.movement(z), on_springs.movement(z[:6]), atol=1e-9 * max(
            1.0, np.abs(z[6:]).max()))


class Scripted:
    """A problem whose states change at so many nodes in the steps of Newton's method, in turn."""

    load = balance = None

    def __init__(self, changes):
        self.changes, self.now = list(changes), np.zeros(40, int)
        self.index = 1

    def states(self, x, move=None):
        if x is not None:
            k = self.changes.pop(0)
            self.now = self.now.copy()
            self.now[:k] += 1
        return self.now

    def signs(self, x):
        return np.ones(40)

    def movement(self, x):
        return x

    def system(self, states, sign):
        return SimpleNamespace(solve=lambda load, balance: "solution", index=self.index)


@pytest.mark.parametrize("changes, near", [
    ([10, 5, 4, 0], True), ([11, 0], False), ([10, 6, 0], False), ([4, 4, 4, 4, 0], True),
    ([4, 5, 0], False), ([8, 4, 4, 0], True), ([0], True)])
def test_few_and_ever_fewer_states_change_near_a_solution(changes, near):
    """Ten at first, half as many as before then; four may change again and again."""
    assert (complementarity.NEAR, complementarity.A_FEW) == (10, 4)
    found = settled(Scripted(changes), None, None)
    assert (found == ("solution", "solution")) == near and (found is None) != near
    other = Scripted(changes)
    other.index = -1
    assert settled(other, None, None) is None


def test_a_search_goes_on_from_what_it_finds(monkeypatch):
    """By the neighbours of every solution, until there are MANY; each is counted once."""
    problem = random_problem(1, 2)
    solutions = [np.full(4, float(k)) for k in range(1, 30)]
    monkeypatch.setattr(complementarity, "all_alike", lambda problem: [])
    monkeypatch.setattr(complementarity, "lemke", lambda problem: solutions[0])
    monkeypatch.setattr(complementarity, "newton", lambda problem, guess, *_: guess)
    for last in (3, 25):
        monkeypatch.setattr(complementarity, "_neighbours", lambda problem, x, last=last: (
            solutions[int(x[0]) - 1 : min(int(x[0]) + 1, last)]))
        found = search(problem, solutions[0])
        assert len(found) == min(last, complementarity.MANY)
        assert [int(x[0]) for x in found] == list(range(1, len(found) + 1))


def test_a_descent_ends_with_the_first_solution(monkeypatch):
    problem, asked = random_problem(1, 2), []
    neighbours = complementarity._neighbours
    monkeypatch.setattr(complementarity, "_neighbours", lambda problem, z: (
        asked.append(z) or neighbours(problem, z)))
    monkeypatch.setattr(complementarity, "newton", lambda *_: "found")
    assert complementarity.descend(problem, np.ones(4)) == "found" and len(asked) == 1
    monkeypatch.setattr(complementarity, "newton", lambda *_: None)
    monkeypatch.setattr(complementarity, "_neighbours", lambda problem, z: [])
    assert complementarity.descend(problem, np.ones(4)) is None


def test_newton_goes_on_while_fewer_states_change():
    """From far off, where many change at first and ever fewer after that, to the solution."""
    found = 0
    for seed in range(SEEDS):
        problem = random_problem(seed, 8, largest=0.2)
        z = lemke(problem)
        start = z * (1 + 0.3 * np.random.default_rng(seed).standard_normal(len(z)))
        end = settled(problem, start, problem.movement(start))
        assert end is None or among(end[0], [z])
        found += end is not None
    assert found > SEEDS / 2


def test_solutions_of_conditions_that_depend_are_not_settled():
    """Two nodes in one place: which of them presses nothing says, nor what a sign would count."""
    problem = CoulombProblem(np.ones((2, 2)), np.full(2, 3.0), np.zeros(0), np.zeros(0, int), True)
    z = problem.solution_in(np.full(2, STICK))
    assert problem.solves(z) and problem.system(np.full(2, STICK), np.ones(2)).index == 0
    assert settled(problem, z, problem.movement(z)) is None


def test_a_solution_is_settled_however_many_nodes_it_has():
    """Unless it was thought to be another one, whose states differ in more nodes than a few."""
    nodes = 2 * complementarity.NEAR + 4
    problem = random_problem(5, nodes, largest=0.2)
    z = lemke(problem)
    move = problem.movement(z)
    found, _ = settled(problem, z, move)
    np.testing.assert_allclose(found, z, atol=1e-8 * np.abs(z).max())
    states = problem.states(z, move)
    assert settled(problem, z, move, states) is not None
    assert settled(problem, z, move, states + 1) is None


@pytest.mark.parametrize("seed", range(4))
def test_many_nodes_hold_a_body_without_support(seed):
    """More than whose states can all be tried: springs that yield ever more are the only way."""
    problem = random_problem(seed, complementarity.FEW + 4, largest=0.3, motions=1)
    assert_obeys(problem, lemke(problem))


def test_solutions_are_counted_once_whose_forces_differ_by_rounding():
    """Relative to the largest force of all of them; what stands behind the forces does not count.
    """
    problem = SimpleNamespace(rows=2)
    solutions = [np.array([1e6, 0.0, 7.0])]
    for same in ([1e6 * (1 + 1e-12), 1e-6, 8.0], [1e6, -1e-6, 7.0]):
        complementarity._add_solution(problem, solutions, np.array(same))
    complementarity._add_solution(problem, solutions, None)
    assert len(solutions) == 1
    for other in ([1e6 * (1 + 1e-5), 0.0, 7.0], [0.0, 0.0, 7.0], [0.0, 1e6, 7.0]):
        complementarity._add_solution(problem, solutions, np.array(other))
    assert len(solutions) == 4
    nothing = [np.zeros(2)]
    complementarity._add_solution(problem, nothing, np.zeros(2))
    assert len(nothing) == 1
