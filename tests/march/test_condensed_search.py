"""Steps by their condensed contact rows, beside what products round off on gluing rows."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.errors import NotConverged
from driver.march import condensed_search, fixed_point, globalization
from driver.march.step import Load, Trace, Unfinished
from test_dense_steps import N, TIGHT, load_of, parts, solves

NOISE = 1e-7  # part of displacements that products round off


# a corner model without corners
OPEN = SimpleNamespace(excluded=np.zeros(0, int), standing=np.zeros(0, int),
                       without_friction=np.zeros(0, int))


def noisy(seed: int):
    """A dense problem whose products are off by NOISE, each time otherwise, but for gradients.

    And its products without that.
    """
    of, draw = parts(seed, levels=2, **TIGHT), np.random.default_rng(seed)
    product = of.operator.apply

    def apply(x: np.ndarray) -> np.ndarray:
        y = product(x)
        return y + NOISE * np.linalg.norm(y) * draw.standard_normal(3 * N)

    of.operator.apply = apply
    of.operator.gradient = lambda x, load: product(x) - load.d
    return of, product


def natural(of, product, load, x: np.ndarray) -> np.ndarray:
    """Natural residuals of contact and friction at x, relative to the load."""
    move, bound = load.d - product(x), of.rows.friction_bound(x)
    n, t = x[:N], x[N : 2 * N]
    return np.append(n - np.maximum(n + move[:N], 0.0),
                     t - np.clip(t + move[N : 2 * N], -bound, bound)) / np.linalg.norm(load.d)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_contact_rows_keep_digits_that_gluing_rows_lose(seed):
    """Products are off by NOISE, and QPs end there; the condensed compliance is off by as much.
    Contact and gluing rows are solved to rounding all the same, by gradients that are not.
    """
    of, product = noisy(seed)
    load, zero = load_of(of), np.zeros(3 * N)
    draw = np.random.default_rng(seed).standard_normal((2 * N, 2 * N))
    of.condensation._compliance *= 1 + NOISE * (draw + draw.T)
    of.qp.tol = 10 * NOISE * np.linalg.norm(load.d)
    x, gradient, _ = of.fixed.condensed(1, load, zero, -load.d, np.zeros(N), Trace(), 1e-9)
    glued = np.abs((load.d - product(x))[2 * N :]).max() / np.linalg.norm(load.d)
    assert glued < 1e-4 * NOISE
    assert np.abs(natural(of, product, load, x)).max() < 1e-6 * NOISE
    np.testing.assert_array_equal(gradient, product(x) - load.d)


def test_what_slides_is_on_its_bound_to_the_last_digit():
    """Inside it by rounding it would count as sticking; well inside it does."""
    of = parts(1, 0.3, **TIGHT)
    x, eps = np.zeros(3 * N), np.finfo(float).eps
    x[:3], bound = [1.0, 2.0, 4.0], 0.3 * np.array([1.0, 2.0, 4.0])
    x[N : N + 3] = bound * [1 - 2 * eps, -1 + 2 * eps, 1 - 1e-12]
    moved = of.fixed.search._on_bounds(x.copy())
    assert moved[N] == bound[0] and moved[N + 1] == -bound[1]
    assert moved[N + 2] == x[N + 2] and (moved[:N] == x[:N]).all()


@pytest.mark.parametrize("passes, best, idle", [
    ([(1.0, 1.0), (0.4, 0.9), (0.3, 0.8)], 2, 1),
    ([(1e-9, 1e-4), (2e-9, 1e-6), (1e-9, 1e-6), (3e-9, 2e-7)], 3, 0),  # forces alone get digits
    ([(1e-9, 1e-4), (1e-9, 1e-6), (1e-10, 4e-6)], 1, 0),  # the better forces
    # forces between stiff bodies have few digits: displacements tell
    ([(4e-6, 1e-5), (1e-10, 1.1e-7), (3e-15, 1.3e-7), (4e-17, 1.7e-7)], 3, 0),
    ([(1e-9, 3e-15), (1e-9, 1e-15), (1e-9, 1e-16)], 0, 2),  # nothing is known of less
    ([(4.0, np.inf), (1.0, np.inf), (2.0, np.inf)], 1, 1),
    ([(1.0, np.inf), (None, None), (0.9, np.inf), (0.8, np.inf)], 3, 2)])
def test_passes_go_on_while_displacements_or_forces_halve(passes, best, idle):
    """The answer is that with the best forces, or where these are unknown, displacements."""
    headway = condensed_search._Headway()
    for number, (missed, lacking) in enumerate(passes):
        if missed is None:  # friction has not settled
            headway.note(None, 0.95, np.inf)
        else:
            headway.note((number,), missed, lacking)
    assert headway.answer == (best,) and headway.idle == idle


@pytest.mark.parametrize("stiff", [False, True])
def test_rounding_that_ends_a_qp_ends_no_elimination_of_stiff_parts(stiff):
    """Where stiffness jumps residuals judge what is left; elsewhere it is no solution."""
    of = parts(1, levels=1 + stiff, **TIGHT)
    load, solve = load_of(of), of.qp.solve

    def stagnates(*given):
        result = solve(*given)
        raise Unfinished(NotConverged("MPRGP stagnated"), result.x, result.gradient,
                         stagnated=True)

    of.qp.solve = stagnates
    given = 1, load, np.zeros(3 * N), Trace(), 1e-9
    if stiff:
        assert solves(of, load, of.fixed.search.solution(*given)[0])
        return
    with pytest.raises(Unfinished, match="stagnated"):
        of.fixed.search.solution(*given)


@pytest.mark.parametrize("fails", ["none", "raises"])
def test_bodies_are_where_they_were_after_a_search_that_failed(fails, monkeypatch):
    of = parts(1, **TIGHT)
    load, bodies = load_of(of), SimpleNamespace(at=5.0)

    def search(*_):
        bodies.at = 7.0
        if fails == "raises":
            raise Unfinished(NotConverged("lost"), None, None)

    bodies.place, bodies.bring = lambda load: bodies.at, lambda load, at: setattr(bodies, "at", at)
    of.fixed.search.bodies = bodies
    monkeypatch.setattr(of.fixed.search, "_search", search)
    assert of.fixed._eliminated(1, load, np.zeros(3 * N), Trace()) is None
    assert bodies.at == 5.0


@pytest.mark.parametrize("pressed, changed, settled", [
    (0.0, 0.0, True), (0.0, 1e-9, False), (4.0, 3.9e-3, True), (4.0, 4.1e-3, False)])
def test_bounds_settle_beside_the_pressures(pressed, changed, settled):
    """To a part of them; where nothing presses they are settled if they do not change."""
    of, x = parts(1, **TIGHT), np.zeros(3 * N)
    x[1] = pressed
    change = np.array([0.0, 0.0, changed])
    assert of.fixed.search._settled(load_of(of), x, change, 1e-3) == settled
    of.fixed.search.bodies = SimpleNamespace(imbalance=lambda load, x: 2e-3)
    assert not of.fixed.search._settled(load_of(of), x, change, 1e-3)


@pytest.mark.parametrize("solver, changes, corners, proved", [
    (globalization.NO_STATE, False, None, True), ("", False, None, False),
    (globalization.NO_STATE, True, None, False), (globalization.NO_STATE, False, OPEN, False),
    (globalization.NEWTON, False, None, False)])
def test_only_a_search_of_all_states_proves_that_there_is_no_solution(solver, changes, corners,
                                                                      proved, monkeypatch):
    """Of the one problem that there is: neither slip changes its friction nor corners its rows."""
    of = parts(1, **TIGHT)
    of.slip.effects.coefficient_changes = changes
    monkeypatch.setattr(of.fixed.search, "_solved_for", lambda *_: (None, solver))
    load, zero = load_of(of), np.zeros(3 * N)
    of.rows.corners = corners
    if not proved:
        assert of.fixed.search._search(1, load, zero, Trace(), 1e-9) is None
        return
    with pytest.raises(Unfinished) as end:
        of.fixed.search._search(1, load, zero, Trace(), 1e-9)
    assert end.value.final


@pytest.mark.parametrize("levels, many, eliminates", [
    (2, 1, True), (2, 10**6, False), (1, 1, False)])
def test_a_search_of_more_products_than_unknowns_is_eliminated(levels, many, eliminates,
                                                               monkeypatch):
    """Where stiffness jumps: conjugate gradients end with the unknowns, but for rounding."""
    monkeypatch.setattr(fixed_point, "MANY", many)
    of, tried = parts(1, 0.5, levels=levels, inner_rtol=1e-12, **TIGHT), []
    solution = of.fixed.search.solution
    of.fixed.search.solution = lambda *given: tried.append(of.operator.products) or (
        solution(*given))
    load = load_of(of)
    x, _, _ = of.fixed.find(1, load, np.zeros(3 * N), -load.d, np.zeros(N), Trace(), 1e-9)
    assert solves(of, load, x)
    assert len(tried) == eliminates and all(products > 2 * 3 * N for products in tried)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_an_open_corner_rubs_without_its_normal_row(seed):
    """Its friction needs no pressure: of the node whose normal row a corner leaves out the
    tangential one obeys Tresca's law, however far the normal one would be penetrated.
    """
    of = parts(seed, 0.3, offset=0.5, **TIGHT)
    acts = np.arange(N) > 0
    of.rows.corners = SimpleNamespace(
        excluded=np.array([0]), standing=np.zeros(0, int), without_friction=np.zeros(0, int),
        act=lambda count: (acts, np.ones(count, bool)))
    of.condensation.select()
    assert of.condensation.apart.tolist() == [0]
    load = load_of(of)
    problem = of.condensation.problem(load, np.zeros(3 * N), -load.d)
    pushed = 1e3 * np.random.default_rng(seed).standard_normal(2 * N) * (np.arange(2 * N) > 0)
    assert problem.movement(pushed)[0] < 0  # whatever the others do
    x, _, _ = of.fixed.condensed(1, load, np.zeros(3 * N), -load.d, np.zeros(N), Trace(), 1e-9)
    move, t = load.d - of.operator.F @ x, slice(N, 2 * N)
    bound = 0.5 + 0.3 * x[:N]
    assert x[0] == 0.0 and abs(x[N]) > 0.0
    missed = np.concatenate([(x - np.maximum(x + move, 0.0))[1:N], move[2 * N :],
                             x[t] - np.clip(x[t] + move[t], -bound, bound)])
    np.testing.assert_allclose(missed, 0.0, atol=1e-8 * np.abs(load.d).max())


@pytest.mark.parametrize("change, own, found", [(1e-9, 1e-8, True), (1e-9, 1e-10, False),
                                                (1e-7, 1e-8, False)])
def test_the_best_pass_is_judged_where_a_tightened_tolerance_is_below_rounding(change, own, found):
    """Friction bounds that go on changing by rounding, of size `change`, settle within what a step
    asks for, `own`, but not within 1e-12.
    """
    of = parts(1, 0.3, rtol=1e-11, friction_rtol=own)
    load, search = load_of(of), of.fixed.search
    search._settled = lambda load, x, bounds, rtol: change <= rtol
    answer = search.solution(1, load, np.zeros(3 * N), Trace(), 1e-12)
    assert (answer is not None) == found
    if found:
        assert solves(of, load, answer[0])


def test_rows_that_a_corner_leaves_out_have_the_friction_of_their_own_slip():
    """By which the force on a vertex is shared, whatever coefficient they had when it was found."""
    of = parts(1, 0.3, **TIGHT)
    of.rows.corners = SimpleNamespace(without_friction=np.array([2]))
    of.slip.effects.coefficient_changes = True
    solved, of.rows.coefficient = np.full(N, 0.3), np.full(N, 0.2)
    assert of.fixed.search._of_acting(solved).tolist() == [
        0.2 if row == 2 else 0.3 for row in range(N)]
    assert solved.tolist() == [0.3] * N
    of.slip.effects.coefficient_changes = False
    assert of.fixed.search._of_acting(solved) is solved


def slipping(seed: int) -> SimpleNamespace:
    """Friction that falls by slip, and a load that presses all nodes."""
    of, pressing = parts(seed, 0.3, **TIGHT), np.zeros(3 * N)
    load, pressing[: 2 * N] = load_of(of), np.repeat([1.0, 0.1], N)
    load = Load(load.weights, load.d + of.operator.F @ pressing, load.extent)

    def renew(gradient: np.ndarray) -> None:
        of.rows.coefficient = 0.3 / (1.0 + 0.5 * np.abs(gradient[N : 2 * N]))

    of.slip.effects.coefficient_changes, of.slip.renew_coefficient = True, renew
    of.slip.largest_coefficient = lambda: np.full(N, 0.3)
    of.load = load
    return of


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_search_ends_with_the_friction_of_slip_in_rows_that_corners_leave_out(seed):
    of, acts = slipping(seed), np.arange(N) < N - 1
    of.rows.corners = SimpleNamespace(
        excluded=np.array([N - 1, 2 * N - 1]), standing=np.zeros(0, int),
        without_friction=np.array([N - 1]), act=lambda count: (acts, acts))
    of.condensation.select()
    _, gradient, _ = of.fixed.search.solution(1, of.load, np.zeros(3 * N), Trace(), 1e-9)
    found, slip = of.rows.coefficient[-1], gradient[2 * N - 1]
    assert abs(slip) > 0.1 and found == pytest.approx(0.3 / (1.0 + 0.5 * abs(slip)), rel=1e-9)


@pytest.mark.parametrize("levels", [1, 2])
def test_nodes_that_slide_stay_on_their_bound_to_the_last_bit(levels):
    """A row inside its bound by a rounding would count as one that sticks, with all its slip."""
    of = parts(1, 0.3, levels=levels, **TIGHT)
    load, start = load_of(of), np.zeros(3 * N)
    start[:N], start[N : 2 * N] = 0.1, 0.01
    change = np.zeros(2 * N)
    change[:N], change[N:] = 0.2, 0.3 * 0.3 * (1 - 4e-16) - 0.01
    x, _ = of.fixed.search._followed(1, load, start, of.operator.apply(start) - load.d, change,
                                     Trace())
    assert np.array_equal(x[N : 2 * N], of.rows.friction_bound(x))
    assert not np.array_equal(start[N : 2 * N] + change[N:], of.rows.friction_bound(x))


@pytest.mark.parametrize("growth, starts_from_there", [(1.0, True), (1e9, False)])
def test_no_search_starts_from_multipliers_that_ran_away(monkeypatch, growth, starts_from_there):
    """Their rounding hides the loads: the step begins where it began."""
    of, met = parts(1, 0.3, **TIGHT), []
    load, first, sliding = load_of(of), np.zeros(3 * N), np.zeros(N)
    of.qp.scales.renew(d=of.qp.size(load.d))
    away = growth * of.qp.scales.d / of.qp.bound * np.ones(3 * N) / np.sqrt(3 * N)

    def fail(*_):
        raise Unfinished(NotConverged("of the test"), away, away)

    monkeypatch.setattr(of.fixed, "_start", lambda *_: (away, -load.d))
    monkeypatch.setattr(of.fixed, "_approximate", fail)
    monkeypatch.setattr(of.fixed, "condensed", lambda index, load, x, *_: met.append(x))
    of.fixed.find(1, load, first, -load.d, sliding, Trace(), 1e-8)
    assert np.array_equal(met[0], away if starts_from_there else first)


@pytest.mark.parametrize("changes, solves_at, tried", [
    (False, 2, [("followed", 0.3), ("searched", 0.3)]),
    (True, 2, [("followed", 0.2), ("followed", 0.3)]),
    (True, 3, [("followed", 0.2), ("followed", 0.3), ("followed", 0.4)]),
    (True, 5, [("followed", 0.2), ("followed", 0.3), ("followed", 0.4), ("searched", 0.2),
               ("searched", 0.3)])])
def test_searches_come_after_the_friction_of_nodes_that_do_not_slide(monkeypatch, changes,
                                                                     solves_at, tried):
    """What takes seconds is not done while another friction, of quick methods, may do: friction is
    0.2 by the latest slip, 0.3 without any, 0.4 at some displacement.
    """
    of, met = slipping(1), []
    of.slip.effects.coefficient_changes = changes
    if changes:
        of.rows.coefficient = np.full(N, 0.2)
        of.slip.largest_coefficient = lambda: np.full(N, 0.4)

    def method(name):
        def solve(problem, start):
            met.append((name, problem.coefficient[0]))
            return (start, name) if len(met) == solves_at else (None, "")
        return solve

    for name in ("followed", "searched"):
        monkeypatch.setattr(globalization, name, method(name))
    search = of.fixed.search
    monkeypatch.setattr(search, "_with_own_slip", lambda problem, solution: solution)
    change, solver = search._solved_for(of.load, np.zeros(3 * N), -of.load.d)
    assert met == tried and solver == tried[-1][0] and not change.any()


SLIDING = """include "scene.idp"
real first = physical("first", 2e-5);
units("m", "Pa");
quasistatic(1.);
int[int] floorSides = [1, 11, 21, 31], blockSides = [101, 111, 121, 131];
mesh Floor = square(6, 2, [3.2*x, 0.8*y], label = floorSides);
mesh Block = square(3, 3, [1. + 1.2*x, 0.8 + y], label = blockSides);
Block = change(Block, fregion = 1);
addBody(Floor)
addBody(Block)
macro young() 2e11 //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(121, 0., -2e6) //
macro load2() traction(121, 1.2e5, 0.) //
macro contactPair() 21, 101 //
macro friction() 0.1 //
real slipRange = 2e-5;
macro displacementFactor(s) (1. - 0.6*s/slipRange) //
macro initialX() first //
macro amplitude1(t) 1. //
macro amplitude2(t) (t > 0.6 ? 1. : 0.) //
include "export.idp"
"""


@pytest.mark.slow
@pytest.mark.parametrize("cut", [1, 3])
@pytest.mark.some(1)
def test_a_block_slides_to_where_friction_holds_it(solved, named_scene, cut):
    """A way of 2e-5 to one side has left 0.04 of friction coefficients of 0.1, which cannot hold a
    load of 0.06 of the weight; sliding back into the middle it comes to where they are 0.06, for
    a block that is nearly rigid at 2e-5/1.5. To the other side there is no such place.
    """
    scene = named_scene("sliding", SLIDING)
    run = solved(scene, steps=2, subdomains=cut)
    assert run.status == 0 and not any("rigid motion" in line for line in run.summary["warnings"])
    pulled = run.summary["quantities"]["tangential_resultant"]
    assert abs(pulled) == pytest.approx(1.2 * 1.2e5, rel=1e-4)
    place = run.contact["u_t"][-1]
    assert np.abs(place).mean() == pytest.approx(2e-5 / 1.5, rel=0.1)
    away = solved(scene, steps=2, subdomains=cut, first=-2e-5)
    assert away.status == 3


def test_a_step_is_searched_for_once(monkeypatch):
    """Passes with other friction coefficients had searched again, a minute each: 300 seconds of two
    blocks in a corner with coefficients that displacements change had not been enough.
    """
    of, met = slipping(1), []
    of.slip.effects.coefficient_changes = True
    for name in ("followed", "searched"):
        monkeypatch.setattr(globalization, name,
                            lambda *_, name=name: met.append(name) or (None, ""))
    search = of.fixed.search
    for _ in range(2):
        assert search._solved_for(of.load, np.zeros(3 * N), -of.load.d) == (None, "")
    assert met == ["followed"] * 2 + ["searched"] * 2 + ["followed"] * 2
    search._solved_for(load_of(of), np.zeros(3 * N), -of.load.d)  # the next step
    assert met[-2:] == ["searched"] * 2


@pytest.mark.parametrize("levels, expected", [(2, 7.0 + 0.5 * 3.0), (1, 7.0)])
def test_bodies_move_by_what_springs_would_where_gradients_leave_springs_out(levels, expected):
    """A condensed problem has bodies on springs: forces of work -3 on a motion change by as much
    what the springs of compliance 0.5 carry, and bodies move that way beside the 7 of the problem.
    """
    of = parts(1, levels=levels, **TIGHT)
    load, moved, zero = load_of(of), [], np.zeros(3 * N)
    of.operator.modes, of.operator.rho = 1, np.array([0.5])
    of.operator.structure.patterns = 1
    work = np.append(np.array([1.0, 2.0]), zero[2:])
    of.operator.imbalance = lambda x, weights: (np.array([-work @ x + weights @ [100.0]]), None)
    of.fixed.search.bodies = SimpleNamespace(
        shift=lambda load, change: moved.extend(change.tolist()))
    change = np.append([-1.0, -1.0], np.zeros(2 * N - 2))
    of.fixed.search._followed(1, load, zero, -load.d, np.append(change, 7.0), Trace())
    assert moved == [expected]
