"""Steps that the condensed contact problem solves, because successive approximations would take
longer: the same solution for fewer products, decided from counts alone.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.errors import NotConverged
from driver.march import globalization, shortcut
from driver.march.condensation import Condensation
from driver.march.shortcut import Shortcut
from driver.march.step import History, Trace
from driver.qp import state_system

# the rubber block dragged at once: friction bounds settle slowly as all nodes slide
DRAGGED = {"h": 0.8, "element": "P2", "subdomains": 4, "without": "quasistatic"}


def products(outcome) -> int:
    """Products with F in all steps."""
    return outcome.summary["counts"]["dual_multiplications"]


def forces(outcome) -> np.ndarray:
    """(2, nodes) tractions at the end."""
    return np.array([outcome.contact[name][-1] for name in ("sigma_n", "sigma_t")])


def test_slow_approximations_are_cut_short(solved, monkeypatch):
    """For a third of the products, to the tolerance of both; nothing has failed, so nothing is
    said.
    """
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    short = solved("tutorial", **DRAGGED, resume="no")
    monkeypatch.setattr(shortcut, "LEAST", np.inf)
    long = solved("tutorial", **DRAGGED, quiet="no")  # another key: a run of its own
    assert products(short) < 60 and products(short) < 0.4 * products(long)
    assert not short.summary["fallbacks"]
    assert max(short.summary["residuals"].values()) <= 1e-10
    assert np.abs(forces(short) - forces(long)).max() <= 1e-5 * np.abs(forces(long)).max()


def test_factorizations_show_that_a_step_is_at_work(built, steps_of):
    """Those of many contact nodes take seconds each, without any product."""
    solver, _ = steps_of(built("tutorial", **DRAGGED_PROBLEM))
    seen, fixed_point = [], solver.fixed_point
    solver.history.watch = lambda *words: seen.append(words)
    load = solver.load(1, solver.motion, solver.operator.apply(solver.multipliers))
    fixed_point.condensation.select()  # no factors are kept
    found = fixed_point.shortcut.solution(7, load, 0 * solver.multipliers, Trace(), 1e-3)
    assert found is not None and seen
    assert all(index == 7 and residual is None for index, _, residual in seen)


@pytest.mark.slow
@pytest.mark.parametrize("scene, words, most", [
    ("tutorial", DRAGGED, 60),
    ("joint", {"h": 0.14, "steps": 2, "subdomains": 7, "uniqueness": "no"}, 15)])
@pytest.mark.some(1)
def test_ranks_cut_short_alike(solved, scene, words, most):
    """Also bodies without support, whose motions are eliminated on all ranks."""
    one, two = (solved(scene, **words, np=ranks) for ranks in (1, 2))
    assert one.summary["counts"]["condensed_steps"] > 0
    assert products(one) == products(two) < most
    assert (one.directory / "contact.csv").read_bytes() == (
        two.directory / "contact.csv").read_bytes()


def test_approximations_go_on_where_newton_does_not_settle(built, steps_of, monkeypatch):
    """As if it had not been tried, but for its products; and it is tried once in a step."""
    problem, tried = built("tutorial", **DRAGGED_PROBLEM), []
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)

    def unsettled(*_):
        tried.append(1)

    monkeypatch.setattr(shortcut.one_solution, "only_solution", unsettled)
    _, (failed, *_) = steps_of(problem)
    assert tried == [1]
    monkeypatch.setattr(shortcut, "LEAST", np.inf)
    _, (plain, *_) = steps_of(problem)
    assert np.array_equal(failed.multipliers, plain.multipliers)
    # what forces miss at the end of the step is asked of Newton's method
    assert failed.products == plain.products + 1


DRAGGED_PROBLEM = {"h": 0.8, "element": "P2", "subdomains": 4, "steps": 1}


@pytest.fixture
def decided(built, steps_of):
    """decided(changes, each=10, target=1e-6, tried=None, spent=100): whether a shortcut pays where
    an iteration takes `each` products and `spent` have been.
    """
    problem = built("tutorial", **DRAGGED_PROBLEM)
    solver, _ = steps_of(problem)
    way = solver.fixed_point.shortcut
    assert isinstance(way, Shortcut) and way.possible

    def decide(changes, each=10, target=1e-6, tried=None, spent=100) -> bool:
        trace = Trace(changes=list(changes), shortcut=tried)
        return way.pays(trace, np.zeros(problem.operator.owned), target, spent,
                        spent / each)

    decide.way = way
    return decide


def test_it_pays_where_more_products_are_to_come_than_its_price(decided):
    halved = 0.5 ** np.arange(4)  # 17 more iterations until 1e-6
    assert decided(halved, 10)
    assert not decided(halved, 6)  # 102 products: less than LEAST
    assert not decided(0.1 ** np.arange(4), 10)  # 3 more iterations
    assert decided(halved, 10, spent=30) and not decided(halved, 10, spent=29)  # too early
    assert not decided(halved[:2], 10)  # two changes show no rate
    assert not decided(halved, 10, tried=False) and not decided(halved, 10, tried=True)
    assert not decided(halved, 10, target=0.2)  # settled
    # no contraction: the first changes may grow; then as many as with the slowest rate
    assert not decided(np.ones(7), 2) and decided(np.ones(8), 2)


def test_it_comes_first_where_rows_are_cheap_to_eliminate(decided, monkeypatch):
    """By sizes alone: the price of the elimination, that of factors of all contact rows."""
    way, x = decided.way, np.zeros(decided.way.qp.operator.owned)
    monkeypatch.setattr(way.condensation, "eliminated", False)
    fronts, moved, asked = way.condensation.elimination, np.ones_like(x), []

    def first(price=shortcut.AT_ONCE, newton=2 * shortcut.AT_ONCE, tried=None, alike=False,
              cut_alike=False, published=300, relaxing=0.0):
        monkeypatch.setattr(type(way.condensation.operator), "alike", alike)
        monkeypatch.setattr(type(way.condensation.operator), "cut_alike", cut_alike)
        monkeypatch.setattr(shortcut, "PUBLISHED", published)
        vars(way).pop("_cheaper", None)
        monkeypatch.setattr(fronts, "price", price)

        def products(count, dense=True):
            asked.append((count, dense))
            return newton if dense else relaxing

        monkeypatch.setattr(fronts, "products", products)
        return way.begins(None, Trace(shortcut=tried), x, moved, 1e-6)

    assert first()  # factors of matrices of all contact rows, which lie near
    assert asked == [(shortcut.FACTORIZATIONS * way.condensation.total**3 / 3, True),
                     (shortcut.BESIDE * shortcut.RELAXED * way.condensation.total**2, False)]
    assert not first(price=shortcut.AT_ONCE + 1) and not first(newton=2 * shortcut.AT_ONCE + 1)
    # relaxation of many contact rows takes as long as Newton's method may
    assert first(newton=6 * shortcut.AT_ONCE, relaxing=2.0)
    assert not first(newton=6 * shortcut.AT_ONCE, relaxing=1.9)
    monkeypatch.setattr(shortcut, "DENSE", way.condensation.total - 1)
    assert not first(newton=6 * shortcut.AT_ONCE, relaxing=2.0) and first()
    assert not first(alike=True)  # products of alike subdomains cost little
    monkeypatch.setattr(way.condensation, "junctions", True)
    assert first(alike=True)  # but not where bodies meet in junctions: equal bricks
    monkeypatch.setattr(way.condensation, "junctions", False)
    rows = way.condensation.operator.structure.dual_dofs
    assert first(cut_alike=True, published=rows) and first(published=rows + 1)
    assert not first(cut_alike=True, published=rows + 1)
    assert not first(tried=False)  # and did not settle
    assert not way.begins(None, Trace(), x, np.zeros_like(x), 1e-6)  # x is the solution


@pytest.mark.slow
def test_a_history_of_a_small_body_takes_few_products(solved):
    """700 dual rows: eight products a step, at most, where approximations took 50 to 90."""
    run = solved("bracket", h=3.0, element="P2", steps=4, subdomains=2)
    assert run.summary["counts"]["condensed_steps"] == 4 and products(run) <= 8 * 4
    assert max(run.summary["residuals"].values()) <= 1e-9


def test_elimination_first_ends_in_the_same_state(solved, monkeypatch):
    """In a step that no approximations precede, for the few products that show it."""
    first = solved("tutorial", **DRAGGED, friction=0.4)
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    later = solved("tutorial", **DRAGGED, quiet="no", friction=0.4)
    assert first.summary["counts"]["fixed_point_iterations"] == 0 and products(first) <= 8
    assert max(first.summary["residuals"].values()) <= 1e-10
    assert np.abs(forces(first) - forces(later)).max() <= 1e-5 * np.abs(forces(later)).max()
    # how fast approximations would have contracted is known, for estimates of the last step
    rates = first.history["contraction"][-1], later.history["contraction"][-1]
    assert rates[0] == pytest.approx(rates[1], rel=0.5)


def test_bodies_that_nothing_balances_are_no_solution(built, steps_of, monkeypatch):
    """However small the residuals are."""
    problem = built("joint", h=1.6, subdomains=3, steps=1)
    solver, _ = steps_of(problem)
    way, owned, trace = solver.fixed_point.shortcut, problem.operator.owned, Trace()
    load = solver.load(1, np.zeros(problem.operator.modes), np.zeros(owned))
    assert way.solution(1, load, np.zeros(owned), trace, 1e-6) is not None and trace.shortcut
    asked = []
    monkeypatch.setattr(way.bodies, "imbalance", lambda *_: asked.append(1) or 1e-5)
    assert way.solution(1, load, np.zeros(owned), trace, 1e-6) is None and not trace.shortcut
    assert len(asked) == shortcut.PASSES  # more would lessen residuals alone


@pytest.mark.parametrize("left, made", [
    ((0.5,), 1), ((30.0, 3.0, 5.0, 2.0, 0.9), 5), ((30.0, 25.0, 20.0), None),
    ((2.0, 3.0, 4.0, 11.0), None), ((3.0,) * shortcut.MORE, None)])
@pytest.mark.some(3)
def test_where_rounding_is_about_the_tolerance_more_passes_are_made(built, steps_of, monkeypatch,
                                                                    left, made):
    """By what products have `left` of it, in tolerances: of a thin sheet that is held at one end
    they round off as much, and approximations had taken 600 products in place of 5.
    """
    problem = built("joint", h=1.6, subdomains=3, steps=1)
    solver, _ = steps_of(problem)
    way, owned, sizes = solver.fixed_point.shortcut, problem.operator.owned, list(left)
    load = solver.load(1, np.zeros(problem.operator.modes), np.zeros(owned))
    monkeypatch.setattr(way.qp, "size", lambda _: sizes.pop(0) * way.qp.tol, raising=False)
    found = way._passes(1, load, np.zeros(owned), Trace(), 1e-6)
    assert not sizes and (found is not None) == (made is not None)


def test_of_passes_above_a_tightened_tolerance_the_best_is_kept(built, steps_of, monkeypatch):
    """That meets the tolerance of the step; what it misses is judged by its residuals."""
    problem = built("joint", h=1.6, subdomains=3, steps=1)
    solver, _ = steps_of(problem)
    way, owned, glued = solver.fixed_point.shortcut, problem.operator.owned, []
    load = solver.load(1, np.zeros(problem.operator.modes), np.zeros(owned))
    own, sizes = way.qp.settings.rtol * way.qp.scales.d, [0.9, 0.1, 0.4, 0.5]
    monkeypatch.setattr(way.qp, "size", lambda _: sizes.pop(0) * own, raising=False)
    pair = way.condensation.glued
    monkeypatch.setattr(way.condensation, "glued",
                        lambda *args: glued.append(pair(*args)) or glued[-1])
    way.qp.tol = 1e-6 * own
    found = way._passes(1, load, np.zeros(owned), Trace(), 1e-6)
    assert len(glued) == shortcut.PASSES and found[0] is glued[1][0]
    sizes[:] = [30.0, 20.0, 10.0]
    assert way._passes(1, load, np.zeros(owned), Trace(), 1e-6) is None


def test_bodies_go_back_where_newton_does_not_settle(built, steps_of, monkeypatch):
    """The search that follows starts where the step does."""
    problem = built("joint", h=1.6, subdomains=3, steps=1)
    solver, _ = steps_of(problem)
    way, places = solver.fixed_point.shortcut, []
    load = solver.load(1, np.zeros(problem.operator.modes), np.zeros(problem.operator.owned))

    def runs_away(index, load, *_):
        way.bodies.shift(load, np.ones(problem.operator.modes))
        places.append(load.weights.copy())
        raise NotConverged("no state settles")

    monkeypatch.setattr(way, "_passes", runs_away)
    before, d, farthest = load.weights.copy(), load.d.copy(), load.farthest
    assert way.solution(1, load, np.zeros(problem.operator.owned), Trace(), 1e-6) is None
    assert (places[0] != before).any() and np.array_equal(load.weights, before)
    assert np.array_equal(load.d, d) and load.farthest == farthest


@pytest.mark.filterwarnings("error")
def test_an_iteration_that_changes_nothing_tells_no_rate(decided):
    """Of a QP that starts from its solution; the changes after it do."""
    halved = 0.5 ** np.arange(4)
    assert decided([0.0, *halved], 10) and not decided([0.0, 0.0, 0.5], 10)


def test_a_price_above_what_is_to_come_does_not_pay(decided, monkeypatch):
    """171 products to come: that of the elimination, and of factors of the rows that are free."""
    halved = 0.5 ** np.arange(4)
    monkeypatch.setattr(Shortcut, "_price", lambda *_: 175.0)
    assert not decided(halved, 10)
    monkeypatch.setattr(Shortcut, "_price", lambda *_: 165.0)
    assert decided(halved, 10)


def test_one_long_qp_is_enough_to_learn_from(decided, monkeypatch):
    """Where friction bounds are given a step has one QP, after which nothing can pay any more."""
    way = decided.way
    x = np.zeros(way.qp.operator.owned)
    monkeypatch.setattr(Shortcut, "_price", lambda *_: 150.0)
    for spent, learned in ((140, False), (shortcut.LEAST, False), (151, True)):
        monkeypatch.setattr(way.condensation, "eliminated", False)
        way.learn(x, spent)
        assert way.condensation.eliminated == learned
    monkeypatch.setattr(Shortcut, "possible", False)
    monkeypatch.setattr(way.condensation, "eliminated", False)
    way.learn(x, 10_000)
    assert not way.condensation.eliminated


def test_another_problem_has_a_rate_of_its_own():
    """As that of other states of corners, or of another tangent."""
    trace = Trace(shortcut=True, rate=0.25)
    trace.again()
    assert np.isnan(trace.contraction) and trace.shortcut


LEFT = shortcut.LEAST  # products after which a QP may be left

# a strip a hundred times as long as it is thick, on a floor: pressures of many waves bend it
STRIP = """include "scene.idp"
units("mm", "MPa");
rectangle(0., 100., 0., 1.);
subdomains("20x1");
macro young() 5e3 //
macro poisson() 0.3 //
macro load1() pressure(3, 0.3) //
macro displacement1() on(2, u1 = 0.5) //
macro contact() 1 //
macro friction() 0.2 //
include "export.idp"
"""


def test_one_endless_qp_is_left_for_elimination(solved, named_scene):
    """Of pieces that are alike, where elimination does not come first. The first QP alone would
    take 325 products, and what follows 1,800.
    """
    strip = solved(named_scene("strip", STRIP), cells=2)
    assert LEFT < products(strip) < 2 * LEFT
    assert strip.summary["counts"]["condensed_steps"] == 1
    # all of it slides: 30 N/mm press, a fifth of it is friction
    carried = (forces(strip) * strip.contact["weight"][-1]).sum(axis=1)
    assert np.allclose(carried, [-30, -6], rtol=1e-7, atol=0)


def test_what_lies_far_away_counts_for_nothing(built, steps_of, named_scene):
    """Contact all round a block, with an obstacle under it: sides that cannot be closed."""
    text = """include "scene.idp"
body = square(16, 16);
macro young() 1000. //
macro poisson() 0.3 //
macro contact() 1, 2, 3, 4 //
macro gap() (label == 1 ? 0. : GAP) //
macro bodyForce1() [0., -1.] //
include "export.idp"
"""
    near, far = (steps_of(built(named_scene(f"round-{gap}", text.replace("GAP", gap))))[0]
                 .condensation for gap in ("0.002", "0.5"))
    assert near.near == near.total == far.total
    assert far.near <= 0.3 * far.total  # a quarter of the outline, with its corners


@pytest.mark.parametrize("products, own, price, leaves", [
    (LEFT, 0, 1.0, False), (LEFT + 1, 0, 1.0, True), (LEFT + 1, 0, 200.0, False),
    (LEFT + 1, 100, 200.0, True), (1, LEFT + 1, 1.0, True)])
def test_what_a_qp_may_take_is_the_price_of_elimination(decided, monkeypatch, products, own, price,
                                                        leaves):
    """With what the relaxation of contact rows takes beside it: a product of these for one with F
    here.
    """
    way = decided.way
    elimination = SimpleNamespace(
        price=price, products=lambda operations, dense=True: operations / (
            (1.0 if dense else shortcut.RELAXED) * way.condensation.total**2))
    monkeypatch.setattr(way.condensation, "elimination", elimination)
    monkeypatch.setattr(way.condensation, "eliminated", False)
    monkeypatch.setattr(shortcut, "FACTORIZATIONS", 0)
    monkeypatch.setattr(Shortcut, "possible", True)
    gives_up = way.patience(Trace())
    way.qp.history.counts["contact_block_products"] += own
    assert gives_up(products) == leaves
    way.qp.history.counts["contact_block_products"] -= own
    monkeypatch.setattr(Shortcut, "possible", False)
    assert not gives_up(products) and way.patience(Trace(shortcut=False)) is None


def test_the_price_counts_free_rows(built, steps_of):
    """Pressing nodes and, of friction below its bound, tangential rows: cubes of their number."""
    solver, (step, *_) = steps_of(built("tutorial", **DRAGGED_PROBLEM))
    way, rows = solver.fixed_point.shortcut, solver.rows
    elimination = way.condensation.elimination
    x = step.multipliers
    free = (x[rows.normal] > 0).sum() + (
        np.abs(x[rows.tangential]) < rows.friction_bound(x)).sum()
    assert free > 20
    newton = elimination.products(shortcut.FACTORIZATIONS * free**3 / 3)
    way.condensation.eliminated = False
    assert way._price(way._free(x)) == pytest.approx(elimination.price + newton, rel=1e-12)
    assert way._price(way._free(0 * x)) == elimination.price
    way.condensation.eliminated = True
    assert way._price(way._free(x)) == pytest.approx(newton, rel=1e-12)
    assert way._price(way._free(0 * x)) == 0


@pytest.mark.slow
def test_steps_after_an_elimination_begin_with_newton(built, steps_of, monkeypatch):
    """Four products each, that of the start, one for the gluing multipliers, one that shows the
    residual and one that says what forces miss, where they took sixty; the answer is the same.
    """
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    problem = built("tutorial", **DRAGGED_PROBLEM | {"subdomains": 8, "steps": 6})
    solver, short = steps_of(problem)
    assert solver.condensation.eliminated and solver.history.counts["condensed_steps"] == 6
    assert [step.fixed_point_iterations for step in short] == [3, 0, 0, 0, 0, 0]
    assert {step.products for step in short[1:]} == {4}
    monkeypatch.setattr(Shortcut, "begins", lambda *_: False)
    monkeypatch.setattr(shortcut, "LEAST", np.inf)
    plain, long = steps_of(problem)
    assert plain.history.counts["condensed_steps"] == 0
    assert sum(step.products for step in long) > 3 * sum(step.products for step in short)
    for one, other in zip(short, long):
        np.testing.assert_allclose(one.multipliers, other.multipliers, rtol=0,
                                   atol=1e-5 * np.abs(other.multipliers).max())


def test_steps_that_begin_with_newton_prepare_no_qp(built, steps_of, monkeypatch):
    """Neither preconditioner nor relaxation; with QPs they are there."""
    monkeypatch.setattr(Shortcut, "comes_first", True)
    problem = built("tutorial", **DRAGGED_PROBLEM | {"subdomains": 5, "steps": 2})
    solver, _ = steps_of(problem)
    assert solver.history.counts["condensed_steps"] == 2
    assert "accelerators" not in vars(solver.qp)
    monkeypatch.setattr(Shortcut, "comes_first", False)
    solver, _ = steps_of(problem, corrector="contact")
    assert solver.history.counts["contact_block_products"] > 0
    assert solver.qp.accelerators.preconditioner is not None


def test_forces_that_are_missing_are_those_of_newton(built, steps_of, monkeypatch):
    """By which pressures have been changed, as long as every node stays in its state; what gluing
    multipliers alone are off by is missing in no contact force.
    """
    monkeypatch.setattr(Shortcut, "comes_first", True)
    problem = built("tutorial", **DRAGGED_PROBLEM | {"subdomains": 5, "steps": 1})
    solver, (step,) = steps_of(problem, rtol=1e-12)
    op, rows, condensation = problem.operator, solver.rows, solver.condensation
    rng, x = np.random.default_rng(1), step.multipliers
    change, pressing = np.zeros_like(x), x[rows.normal] > 1e-3 * x[rows.normal].max()
    change[rows.normal[pressing]] = 1e-4 * rng.random(pressing.sum()) * x[rows.normal[pressing]]
    moved = rows.follow(x + change, rows.sliding(x, rows.friction_bound(x)))
    change = moved - x
    assert np.abs(change[rows.tangential]).max() > 0
    load = solver.load(1, np.zeros(0), np.zeros(op.owned))
    found = condensation.correction(load, moved, op.apply(moved) - op.apply(x) + step.gradient)
    np.testing.assert_allclose(found, -change, rtol=0, atol=1e-6 * np.abs(change).max())
    said = solver.residuals._missing(load, moved, op.apply(moved) - op.apply(x) + step.gradient)
    contact = np.append(rows.normal, rows.tangential)
    size = np.linalg.norm(change[contact]) / np.linalg.norm(moved[contact])
    assert said == pytest.approx(size, rel=1e-5)
    monkeypatch.setattr(state_system, "SINGULAR", np.inf)  # of what may be singular nothing
    condensation.problem(load, x, step.gradient).latest.clear()
    assert condensation.correction(load, moved, step.gradient) is None
    monkeypatch.undo()
    condensation.problem(load, x, step.gradient).latest.clear()
    glue = np.zeros_like(x)
    glue[rows.gluing] = 1e-3 * rng.standard_normal(len(rows.gluing)) * np.abs(x).max()
    found = condensation.correction(load, x + glue, op.apply(glue) + step.gradient)
    assert np.abs(found).max() <= 1e-8 * np.abs(glue).max()


@pytest.mark.parametrize("scene, options", [("model", {"cells": 4}), ("punch", {"h": 0.2}),
                                            ("tutorial", {"h": 1.6, "subdomains": 3})])
@pytest.mark.some(2)
def test_loads_alone_say_what_contact_forces_have_to_undo(built, steps_of, scene, options):
    """As forces do that the gluing multipliers answer to: loads, travel, gaps and earlier slip."""
    problem = built(scene, steps=2, **options)
    solver, _ = steps_of(problem)
    op, condensation = problem.operator, solver.condensation
    load = solver.load(2, np.zeros(0), np.zeros(op.owned))
    x = np.random.default_rng(1).standard_normal(op.owned)
    x, gradient = condensation.glued(load.d, x, op.apply(x) - load.d)
    exact = condensation.problem(load, x, gradient).load
    rounding = 1e-11 * np.abs(condensation.compliance() @ condensation.gather(x)).max()
    np.testing.assert_allclose(condensation.problem_by_loads(load).load, exact, atol=rounding)


@pytest.mark.parametrize("eliminated, tried, begins", [
    (False, None, False), (True, None, True), (True, False, False), (False, True, True)])
def test_where_a_search_begins_with_newton(decided, eliminated, tried, begins, monkeypatch):
    """After an elimination, or where the step's last search ended so; not where it failed in this
    step, nor where the start is a solution.
    """
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    way = decided.way
    vars(way).pop("_cheaper", None)  # which the steps before may have found
    way.condensation.eliminated, zero = eliminated, np.zeros(way.qp.operator.owned)
    trace = Trace(shortcut=tried)
    assert way.begins(None, trace, zero, zero + 1.0, 1e-6) == begins
    assert not way.begins(None, trace, zero, zero, 1e-6)


@pytest.mark.parametrize("changed", [
    {"size": 0}, {"elimination": None},
    {"corners": object(), "offset": np.ones(2), "modes": 1},
    {"elimination": SimpleNamespace(fits=False)}, {"hardly_felt": True},
    {"coefficient_changes": True}, {"coefficient": np.array([0.3, 0.9])}])
def test_where_it_is_not_possible(changed):
    """Slip changes friction: the problem is another one in every iteration. Nor where no node faces
    anything, there is nothing to eliminate, no room for its factors, perhaps more than one
    solution, a motion that rows resist by next to nothing, or corners in which a loose body may rub
    without pressure.
    """
    known = {"size": 4, "corners": None, "offset": None, "modes": 0, "hardly_felt": False,
             "elimination": SimpleNamespace(fits=True), "coefficient_changes": False,
             "coefficient": np.array([0.3, 0.8])}
    for given, expected in ((known, True), (known | changed, False)):
        own = SimpleNamespace(**given)
        slip = SimpleNamespace(effects=own, suspended=False)
        way = Shortcut(SimpleNamespace(rows=own, operator=own), None, slip, own)
        assert way.possible == expected


@pytest.mark.parametrize("changed", [{"uneven": True}, {"contact_rows_only": True}])
def test_what_is_not_eliminated(changed):
    """Large jumps of stiffness take pivots, studies have no gluing rows."""
    own = SimpleNamespace(**({"uneven": False, "contact_rows_only": False} | changed))
    condensation = object.__new__(Condensation)
    condensation.operator = own
    assert condensation.elimination is None


def test_what_cannot_be_eliminated_is_no_shortcut(monkeypatch):
    """And the step goes on as if it had not been tried, but is not tried again."""
    trace = Trace(changes=[1.0, 2.0])
    way = Shortcut(SimpleNamespace(rows=None, history=History()), None, None, None)

    def fails(*_):
        raise NotConverged("not definite")

    monkeypatch.setattr(Shortcut, "_found", fails)
    assert way.solution(5, None, None, trace, 1e-6) is None
    assert trace.shortcut is False and not trace.fallback and not way.qp.history.fallbacks.steps


@pytest.mark.parametrize("changes, noted", [((1.0, 2.0, 1.0, 3.0), True), ((3.0, 2.0, 1.0), False)])
def test_approximations_that_do_not_contract_are_noted(monkeypatch, changes, noted):
    """Once, and the step is one in doubt."""
    history, trace = History(), Trace(changes=list(changes))
    way = Shortcut(SimpleNamespace(rows=None, history=history), None, None, None)
    monkeypatch.setattr(Shortcut, "_found", lambda *_: ("x", "gradient", "sliding"))
    for _ in range(2):
        assert way.solution(5, None, None, trace, 1e-6) == ("x", "gradient", "sliding")
    assert trace.fallback == noted and trace.shortcut
    assert history.fallbacks.steps == ({globalization.NEWTON: [5]} if noted else {})
