"""Friction beyond contraction and beyond uniqueness: fallbacks, other solutions, and what is said
about them.
"""

import numpy as np
import pytest
from small_scenes import BOTTOM, LEFT, TOP, Body, Scene, solve

from driver.qp import complementarity, coulomb
from driver.march import globalization
from driver.march.uniqueness import Uniqueness
from driver.qp import anderson
from driver.qp.complementarity import (
    all_solutions,
    index,
    lemke,
    newton,
    search,
    settled,
)
from driver.qp.coulomb import CoulombProblem
from driver.hard.oracle import Assembled


# ----------------------------------------------------------- the dense problem on the contact nodes

def one_node(coefficient, load=(-1.0, 0.5)):
    """C = (1 -1; -1 2), pulled off and dragged along: open, sticking and sliding at once for F > 1.
    """
    return CoulombProblem(np.array([[1.0, -1.0], [-1.0, 2.0]]), np.array(load),
                          np.array([coefficient]), np.array([0]))


def test_one_node_with_three_solutions():
    """By hand. C^-1 = (2 1; 1 1). Stick: x = C^-1 d, needs |x_t| <= F x_n. Slip with lambda_t = F
    lambda_n: over = 0 gives (1 - F) lambda_n = d_n, so d_n < 0 needs F > 1. Open: x = 0, as d_n <
    0."""
    d, F = np.array([-1.0, 3.0]), 4.0
    problem = one_node(F, d)
    stick, slip = np.array([1.0, 2.0]), np.array([1.0, F]) * d[0] / (1 - F)
    found = all_solutions(problem)
    assert len(found) == 3
    for expected in (np.zeros(2), stick, slip):
        assert any(np.allclose(x, expected, rtol=1e-14, atol=1e-15) for x in found)
    assert sorted(index(problem, x) for x in found) == [-1, 1, 1] and index(problem, slip) == -1
    assert len(all_solutions(one_node(0.9, d))) == 1  # lifted off: below F = 1 there is no way back


def random_problem(seed, nodes, largest=6.0):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2 * nodes, 2 * nodes + 1))
    unit = 10 ** rng.uniform(-0.5, 0.5, 2 * nodes)
    return CoulombProblem(root @ root.T * np.outer(unit, unit), rng.standard_normal(2 * nodes),
                          rng.uniform(0, largest, nodes), np.arange(nodes))


@pytest.mark.parametrize("nodes", [1, 2, 3])
@pytest.mark.some(2)
def test_signs_of_all_solutions_add_up_to_one(nodes):
    """The degree of the law is one, whatever the coefficient: if enumeration lost or invented a
    solution, it would show. Lemke's and Newton's are among them; the search finds no false ones."""
    several = 0
    for seed in range(25):
        problem = random_problem(seed, nodes)
        found = all_solutions(problem)
        assert sum(index(problem, x) for x in found) == 1, seed

        def among(y):
            return any(np.abs(x - y).max() <= 1e-9 * max(np.abs(x).max(), 1e-300)
                       for x in found)

        assert among(lemke(problem)), seed
        reached = newton(problem, np.zeros(2 * nodes))
        assert reached is None or among(reached), seed
        assert all(among(x) for x in search(problem, found[0])), seed
        several += len(found) > 1
        # holds for these, is not promised
        assert len(search(problem, found[0])) == len(found), seed
    assert several >= 1 or nodes == 1


def test_lemke_where_newton_cycles():
    """Lemke's method ends in a solution where Newton's steps from rest come back to where they
    were.
    """
    cycled = 0
    for seed in range(100):
        problem = random_problem(seed, 6, largest=20.0)
        if newton(problem, np.zeros(12)) is None:
            cycled += 1
            assert problem.violation(lemke(problem)) <= 1e-12
    assert cycled >= 2


def test_units_of_the_dense_problem():
    """Lengths in 2^-30, forces in 2^40: the same states, scaled exactly."""
    for seed in range(20):
        plain = random_problem(seed, 3)
        length, force = 2.0**-30, 2.0**40
        scaled = CoulombProblem(plain.compliance * (length / force), plain.load * length,
                                plain.coefficient, plain.pair)
        assert np.array_equal(lemke(scaled), lemke(plain) * force)
        assert scaled.violation(lemke(plain) * force) == plain.violation(lemke(plain))


def test_violation_finds_every_broken_law():
    problem = one_node(0.5, (1.0, 0.2))  # pressed on
    x = lemke(problem)
    assert problem.solves(x)
    for broken in (x + [0.1, 0], x - [0.1, 0], x + [0, 0.1], x - [0, 0.1], [-1.0, 0.0],
                   [np.nan, 0.0]):
        assert not problem.solves(np.array(broken))


def test_bilateral_law_allows_tension():
    problem = one_node(0.5)
    problem = CoulombProblem(problem.compliance, problem.load, problem.coefficient, problem.pair,
                             bilateral=True)
    x = newton(problem, np.zeros(2))
    assert x[0] < 0 and abs(x[1]) <= 0.5 * abs(x[0])
    assert problem.solves(lemke(problem))


def test_anderson_settles_what_plain_iteration_does_not():
    """g -> b - A g with eigenvalues of A up to 3: plain iteration explodes, five differences
    suffice for five unknowns.
    """
    rng = np.random.default_rng(3)
    A = np.diag([3.0, 2.0, 1.5]) + 0.1 * rng.standard_normal((3, 3))
    solution = np.array([1.0, 2.0, 3.0])
    b = solution + A @ solution
    method, g, changes = anderson.Anderson(np.dot), np.zeros(3), []
    while not (changes and anderson.gives_up(changes)) and (not changes or changes[-1] > 1e-12):
        mapped = np.maximum(b - A @ g, 0.0)
        changes.append(np.abs(mapped - g).max())
        g = method.next(g, mapped)
    assert np.abs(g - solution).max() <= 1e-10 and len(changes) <= 12


def test_anderson_gives_up_in_time():
    assert not anderson.gives_up([1.0, 0.4, 0.1])
    assert anderson.gives_up([1.0] * 9) and not anderson.gives_up([1.0] * 8)
    assert anderson.gives_up([0.5**k for k in range(anderson.LIMIT)])


# ------------------------------------------------------------------------- through the whole solver

def leaning_rod(coefficient, force, **more) -> Scene:
    """One triangle, clamped on its left side, its lower right vertex the one contact node: a rod
    that leans.
    """
    xy = np.array([[0.0, 0.6], [0.25, 1.0], [1.0, 0.0]])
    outline = np.array([[0, 2, BOTTOM], [2, 1, TOP], [1, 0, LEFT]])
    body = Body(xy, np.array([[0, 2, 1]]), outline, np.zeros(1, int), np.ones(1), 0.3)
    return Scene(body, [{TOP: np.asarray(force)}], np.array([[0.0], [1.0]]), friction=coefficient,
                 **more)


def by_hand(scene):
    """The condensed problem of the scene's first step, from the assembled body."""
    body = Assembled(scene.manifest(), scene.subdomains())
    d = body.B @ body.solve(scene.amplitudes[1]) - np.append(body.gap, 0 * body.gap)
    return CoulombProblem(body.compliance(), d, body.friction, np.arange(len(body.gid)))


def three_ways():
    """A leaning rod and a load under which it may stick, slide or lift off: F beyond c_nn / |c_nt|,
    and d between.
    """
    C = by_hand(leaning_rod(1.0, (0.0, -1e-3))).compliance
    # the direction in which friction lifts the node's compliance to nothing
    way = -np.sign(C[0, 1])
    F = 4 * C[0, 0] / abs(C[0, 1])
    aim = C @ np.array([1.0, 0.5 * F * way])  # stick within the cone
    unit = np.column_stack([by_hand(leaning_rod(F, force)).load
                            for force in ((1.0, 0.0), (0.0, 1.0))])
    return leaning_rod(F, np.linalg.solve(unit, aim * 1e-3)), F


def test_a_node_that_sticks_slides_or_lifts_off_is_reported_so():
    scene, _ = three_ways()
    expected = all_solutions(by_hand(scene))
    assert len(expected) == 3, "the geometry was to have three solutions"
    run = solve(scene)
    assert run.solver.failure is None
    found = run.solver.uniqueness
    assert found.verdict == "not unique" and list(found.several) == [1]
    names = found.several[1]
    assert sorted((s["open"], s["stick"], s["slip"]) for s in names) == [(0, 0, 1), (0, 1, 0),
                                                                         (1, 0, 0)]
    for x in expected:  # each solution with its own contact force
        assert any(np.isclose(-s["resultant_n"], x[0], rtol=1e-6, atol=1e-12) for s in names)
    lam = run.steps[0].multipliers
    assert any(np.allclose(lam, x, rtol=1e-6, atol=1e-6 * abs(expected[-1]).max())
               for x in expected)
    line, = found.warnings()
    assert "not unique" in line and "1 stick" in line and "1 open" in line and "1 slip" in line


def test_the_same_rod_with_little_friction_is_proved_unique():
    scene, F = three_ways()
    scene.friction = F / 8
    run = solve(scene)
    assert run.solver.uniqueness.verdict == "unique" and not run.solver.uniqueness.warnings()


def test_frictionless_scenes_are_unique_and_not_examined():
    scene, _ = three_ways()
    scene.friction = 0.0
    run = solve(scene, uniqueness="yes")
    assert run.solver.uniqueness.verdict == "unique" and run.solver.uniqueness.examined == 0


# ----------------------------------------------------------------------------- the model example

@pytest.mark.parametrize("friction", [6, 15])
@pytest.mark.some(1)
def test_model_beyond_uniqueness(solved, built, friction):
    """From F = 5.45, the largest |lambda_t| / lambda_n of a bottom that sticks everywhere, that is
    a solution beside one with an open node and, between the two, one with a sliding node. The
    answer is one of them to the default tolerance, and all are named."""
    found = solved(friction=friction, steps=1)
    assert found.status == 0, found.reason
    said = found.summary["uniqueness"]
    assert said["verdict"] == "not unique" and said["steps_not_unique"] == [1]
    assert sorted((s["open"], s["stick"], s["slip"])
                  for s in said["solutions"]) == [(0, 39, 1), (0, 40, 0), (1, 39, 0)]
    assert sum(s["index"] for s in said["solutions"]) == 1
    assert any("not unique" in line for line in found.summary["warnings"])
    problem = built(reduce=False, friction=friction, steps=1)
    body = Assembled(problem.manifest, problem.subdomains)
    dense = CoulombProblem(body.compliance(), body.B @ body.solve([1.0]), body.friction,
                           np.arange(len(body.gid)))
    lam = np.concatenate([-found.contact["sigma_n"][0],
                          -found.contact["sigma_t"][0]]) * np.tile(body.weight, 2)
    assert dense.violation(lam) <= 1e-4  # cond F times rtol


def test_fallback_is_reported(solved):
    """Here successive approximations jump between states until their QPs are solved in full."""
    found = solved(friction=10, steps=1, corrector="none", max_fixed_point=17)
    assert sum(found.summary["fallbacks"].values()) == 1
    assert any("bound did not converge" in line and "step 1" in line
               for line in found.summary["warnings"])


def test_newton_improves_what_is_a_solution_but_for_rounding():
    """The caller may have asked for more than ROUNDING: a start within it is not the answer."""
    d, F = np.array([1.0, 0.4]), 0.5
    problem = one_node(F, d)
    near = newton(problem, np.zeros(2)) * (1 + 5e-10)
    assert 1e-10 < problem.violation(near) < coulomb.ROUNDING
    assert problem.violation(newton(problem, near)) < 1e-15


def test_newton_near_a_solution_leaves_those_of_negative_index():
    """Of the three solutions by hand above; stick and open are found from near them, slip, the one
    between, is not.
    """
    problem = one_node(4.0, (-1.0, 3.0))
    found = {index(problem, x): settled(problem, x * (1 + 1e-6), problem.movement(x * (1 + 1e-6)))
             for x in all_solutions(problem)}
    assert found[-1] is None and problem.solves(found[1][0])


def test_newton_far_from_a_solution_factorizes_nothing():
    """States that a start is thought to be in, and those that it falls into, differ at more nodes
    than are near.
    """
    nodes = complementarity.NEAR + 1
    problem = CoulombProblem(np.eye(2 * nodes), np.ones(2 * nodes), np.full(nodes, 2.0),
                             np.arange(nodes))
    start, thought = np.zeros(2 * nodes), np.full(nodes, coulomb.OPEN)
    assert settled(problem, start, problem.load, thought) is None and not problem.latest
    thought[0] = coulomb.STICK
    assert problem.solves(settled(problem, start, problem.load, thought)[0])


@pytest.mark.parametrize("friction", [6, 8, 10])
@pytest.mark.some(2)
def test_qps_solved_in_full_settle_without_a_fallback(solved, friction):
    """As above with more iterations: QPs left early made it stall, none of the other methods is
    needed.
    """
    found = solved(friction=friction, steps=1, corrector="none", uniqueness="no")
    assert found.status == 0 and not found.summary["fallbacks"]


def test_condensed_newton_finds_the_fixed_point(built, steps_of, monkeypatch):
    """Stopped after 5 of the 16 iterations it needs and with Anderson acceleration out of the way:
    the same answer.
    """
    from driver.march import fixed_point as fixedpoint, step

    problem = built(cells=4, friction=3, steps=1)
    _, plain = steps_of(problem, rtol=1e-11, friction_rtol=1e-11, uniqueness="no")
    monkeypatch.setattr(fixedpoint.FixedPoint, "_accelerate", lambda *a: None)
    monkeypatch.setattr(step, "WINDOW", 2)
    monkeypatch.setattr(fixedpoint, "WINDOW", 2)
    solver, steps = steps_of(problem, rtol=1e-11, friction_rtol=1e-11, uniqueness="no",
                             max_fixed_point=5)
    assert solver.failure is None and solver.history.fallbacks.steps == {globalization.NEWTON: [1]}
    size = np.abs(plain[0].multipliers).max()
    # cond F times rtol, with room
    assert np.abs(steps[0].multipliers - plain[0].multipliers).max() <= 1e-6 * size


@pytest.mark.slow
def test_fallbacks_do_not_depend_on_ranks(solved):
    one, two = (solved(friction=6, steps=1, cells=4, corrector="none", max_fixed_point=17, NP=ranks)
                for ranks in (1, 2))
    assert one.summary["fallbacks"], "look for another coefficient at which one is needed"
    for name in ("u_n", "u_t", "sigma_n", "sigma_t"):
        assert np.array_equal(one.contact[name], two.contact[name])
    for name in ("counts", "uniqueness", "warnings"):
        assert one.summary[name] == two.summary[name]


def test_examination_changes_no_number(solved):
    """Asked for or not, the tractions are the same to the last bit; it takes no products."""
    plain, examined = (solved(steps=2, cells=4, uniqueness=choice) for choice in ("no", "yes"))
    for name in ("u_n", "u_t", "sigma_n", "sigma_t"):
        assert np.array_equal(plain.contact[name], examined.contact[name])
    assert plain.summary["uniqueness"]["verdict"] == "not examined"
    assert examined.summary["uniqueness"]["verdict"] == "no second solution found"
    assert examined.summary["uniqueness"]["steps_examined"] == 2
    counts = [run.summary["counts"]["dual_multiplications"] for run in (plain, examined)]
    assert counts[1] == counts[0]


@pytest.mark.slow  # several histories
def test_contraction_is_reported(solved):
    """About 0.2 at F = 0.3 and growing with the coefficient: Phi's Lipschitz constant is
    proportional to it.
    """
    rates = [solved(friction=F, steps=1, corrector="none", rtol=1e-11,
                    friction_rtol=1e-11).summary["contraction"]
             for F in (0.3, 1, 2)]
    assert 0 < rates[0] < rates[1] < rates[2] < 1
    history = solved(friction=0.3, steps=1, corrector="none", rtol=1e-11,
                     friction_rtol=1e-11).history
    assert history["contraction"].max() == rates[0]


def test_no_method_left_is_a_status(monkeypatch):
    """If Newton and Lemke failed too the run would end with exit 3 and say so."""
    scene, _ = three_ways()
    monkeypatch.setattr(complementarity, "newton", lambda *a: None)
    monkeypatch.setattr(complementarity, "lemke", lambda *a: None)
    monkeypatch.setattr(anderson.Anderson, "next", lambda self, g, mapped: g + 1.0)
    from driver.contact.rows import ContactRows

    bound, rng = ContactRows.friction_bound, np.random.default_rng(0)
    monkeypatch.setattr(ContactRows, "friction_bound", lambda self,
                        x: bound(self, x) * (1 + 0.1 * rng.random()))
    scene.tractions = [{TOP: np.array([0.0, -1e-3])}]
    run = solve(scene)
    assert run.solver.failure.exit_status == 3 and "step 1" in str(run.solver.failure)


# --------------------------------------------------------------------------- what counts as a proof

def test_a_line_of_solutions_is_not_overlooked():
    """F = 1 makes over = d_n - (1 - F) lambda_n = d_n for all pressures while the node slides: with
    d_n = 0 those up to 0.2 all solve; none with 1, and F = 0.5 has no singular state.
    """
    assert complementarity.all_isolated(one_node(0.5, (0.0, 0.2)))
    assert complementarity.all_isolated(one_node(1.0, (1.0, 0.2)))
    # without any load the line has one point at rest, which its proof cannot tell from more
    assert not complementarity.all_isolated(one_node(1.0, (0.0, 0.0)))
    line = one_node(1.0, (0.0, 0.2))
    assert not complementarity.all_isolated(line)
    # in the middle of the line, from where no end of it may be seen
    found = Uniqueness(True)
    found.examine(1, line, np.array([0.1, 0.1]), np.ones(1))
    assert found.verdict != "unique"


def test_friction_that_falls_with_slip_is_not_called_unique(solved, tmp_path):
    """A pad whose friction falls to a fifth over 1e-6 sticks in one node and slides in three;
    another solution slides everywhere, that of the fifth.
    """
    script = tmp_path / "falling.edp"
    script.write_text('''include "scene.idp"
units("m", "Pa");
subdomains("1x1");
rectangle(0., 1., 0., 1.);
macro young() 1e9 //
macro poisson() 0.3 //
real slipRange = 1e-6;
macro displacement1() on(3, u1 = 4e-5, u2 = -1e-4) //
macro contact() 1 //
macro friction() 0.5 //
macro slipFactor(s) max(0.2, 1. - 0.8*s/1e-6) //
include "export.idp"
''')
    for choice in ("auto", "yes"):
        summary = solved(str(script), cells=3, uniqueness=choice).summary
        assert summary["uniqueness"]["verdict"] == "not examined"
        assert any("friction depends on slip" in line for line in summary["warnings"])


def test_lemke_does_not_cycle_where_everything_ties():
    """Loads of a few equal numbers on equal nodes: all ratios tie. A solution of any friction."""
    for nodes in (2, 4, 6):
        for F in (0.5, 2.0, 8.0):
            C = np.eye(2 * nodes) + 0.5 * np.eye(2 * nodes, k=nodes) + 0.5 * np.eye(2 * nodes,
                                                                                   k=-nodes)
            for d in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (0.0, 1.0)):
                problem = CoulombProblem(C, np.repeat(d, nodes), np.full(nodes, F),
                                         np.arange(nodes))
                assert problem.solves(lemke(problem))
