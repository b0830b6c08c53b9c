"""Problems with given friction bounds, where Newton's method circles: bodies that rock."""

import numpy as np
import pytest

from driver.qp import active_set, approximations
from driver.qp.active_set import _Descent, solution_within
from driver.qp.approximations import approximation
from driver.qp.complementarity import newton
from driver.qp.coulomb import CoulombProblem
from driver.qp.one_solution import only_solution

N = 30


def rocking(seed: int, friction: float = 0.3, smooth: float = 0.0) -> CoulombProblem:
    """A stiff flat that a soft hinge holds above an arch, `smooth` of whose nodes rub by nothing.

    Nodes yield by 1e-3 each, the flat as a whole by one where it rises and by 30 where it turns,
    and along the arch together.
    """
    rng = np.random.default_rng(seed)
    along = np.sort(rng.uniform(-1.0, 1.0, N))
    rises, turns = np.ones(N), along - 0.3 * rng.uniform(-1, 1)
    normal = np.outer(rises, rises) + 30.0 * np.outer(turns, turns)
    aside = 2.0 * np.ones(N) + 0.1 * turns
    C = np.block([[normal, 0.2 * np.outer(rises, aside)],
                  [0.2 * np.outer(aside, rises), np.outer(aside, aside)]])
    C += np.diag(rng.uniform(1e-3, 2e-3, 2 * N))
    over = 1.0 - 2.0 * (along - 0.2 * rng.uniform(-1, 1)) ** 2
    load = np.concatenate([over, rng.uniform(-1, 1) * aside])
    coefficient = np.where(rng.uniform(size=N) < smooth, 0.0, friction)
    return CoulombProblem(C, load, coefficient, np.arange(N))


def bounded(problem: CoulombProblem, g: np.ndarray) -> CoulombProblem:
    """The problem under given friction bounds g (N,)."""
    return problem.under(problem.load, np.zeros(problem.m), offset=g)


@pytest.mark.parametrize("smooth", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.some(2)
def test_forces_are_those_of_least_energy(seed, smooth):
    """From any start: within their bounds, and the energy falls no further by any force that may
    still change. It is convex, so that there is no other such point.
    """
    problem = rocking(seed, smooth=smooth)
    g = problem.coefficient * np.random.default_rng(seed).uniform(0.0, 1.0, N)
    upper, lower = np.append(np.full(N, np.inf), g), np.append(np.zeros(N), -g)
    for start in np.zeros(2 * N), np.append(np.ones(N), g), np.append(np.zeros(N), -g):
        x = solution_within(bounded(problem, g), start)
        slope = problem.compliance @ x - problem.load
        assert (x >= lower).all() and (x <= upper).all()
        rounding = 1e-10 * np.abs(problem.load).max()
        assert (slope[x < upper] >= -rounding).all() and (slope[x > lower] <= rounding).all()


def test_newton_circles_where_bodies_rock():
    """In most of these; then a descent finds what the approximations of friction ask for."""
    circled = 0
    for seed in range(12):
        problem = rocking(seed)
        start = np.zeros(2 * N)
        given = bounded(problem, problem.bounds(start))
        circled += newton(given, start) is None
        assert given.solves(approximation(problem, start))
        assert problem.solves(approximations.approached(problem, start))
        assert given.solves(only_solution(given, start))  # of a scene with given bounds
    assert circled >= 6


@pytest.mark.parametrize("alone", [False, True])
def test_every_step_lowers_the_energy(monkeypatch, alone):
    """Whether rows are let go all together or, as where these come back, one at a time."""
    if alone:
        monkeypatch.setattr(_Descent, "_pushed", _Descent._at_bounds)
    energies, move = [], _Descent._move

    def watched(self, *args) -> bool:
        went = move(self, *args)
        energies.append(self.energy)
        return went

    monkeypatch.setattr(_Descent, "_move", watched)
    for seed in range(12):
        energies.clear()
        given = bounded(rocking(seed), np.full(N, 0.1))
        assert given.solves(solution_within(given, np.zeros(2 * N)))
        assert len(energies) > 2
        assert (np.diff(energies) <= 1e-12 * abs(energies[-1])).all()


def test_a_descent_that_takes_too_long_ends(monkeypatch):
    monkeypatch.setattr(active_set, "CHANGES", 0.02)  # one change
    assert solution_within(bounded(rocking(0), np.full(N, 0.1)), np.zeros(2 * N)) is None


@pytest.mark.slow  # twelve problems
def test_bodies_without_support_come_to_rest_on_springs():
    """Flats that rock and besides rise and shift with nothing to hold them: Newton's method circles
    in all of these. The end is that of the bodies themselves, in balance to rounding.
    """
    for seed in range(12):
        held, rng = rocking(seed), np.random.default_rng(seed)
        rises = np.append(np.ones(N), np.full(N, 0.3))[:, None]
        balance = rises.T @ np.append(rng.uniform(0.0, 0.3, N), np.zeros(N))
        flat = CoulombProblem(held.compliance, held.load, np.zeros(N), np.arange(N), False, rises,
                              balance, offset=np.full(N, 0.1))
        start = np.zeros(2 * N + 1)
        assert newton(flat, start) is None
        assert flat.solves(solution_within(flat, start))
        assert flat.solves(approximation(flat, start))


def test_a_body_that_its_load_moves_off_comes_to_no_rest():
    """None, not a number."""
    body = CoulombProblem(np.eye(2), np.array([1.0, 1.0]), np.zeros(0), np.zeros(0, int), False,
                          np.ones((2, 1)), np.array([-1.0]))
    assert solution_within(body, np.zeros(3)) is None


def test_softer_springs_are_tried_where_stiffer_ones_leave_something(monkeypatch):
    tried = []
    monkeypatch.setattr(active_set, "_followed", lambda problem, start, softness: tried.append(
        softness) or (start if len(tried) == 2 else None))
    body = CoulombProblem(np.eye(2), np.zeros(2), np.zeros(0), np.zeros(0, int), False,
                          np.ones((2, 1)), np.zeros(1))
    assert solution_within(body, np.zeros(3)) is not None
    assert tried == [1e3, 1e5]


def test_many_rows_are_let_go_and_held_at_once(monkeypatch):
    """Of springs in a row that all slide one way and are pushed the other way."""
    n, taken = 100, []
    reach = np.minimum.outer(np.arange(1.0, n + 1), np.arange(1.0, n + 1))
    C = np.block([[np.eye(n), np.zeros((n, n))], [np.zeros((n, n)), reach]])
    load = np.append(np.ones(n), -100.0 * np.arange(n))
    springs = CoulombProblem(C, load, np.zeros(n), np.arange(n), offset=np.ones(n))
    least = _Descent._least
    monkeypatch.setattr(_Descent, "_least", lambda *args: taken.append(1) or least(*args))
    assert springs.solves(solution_within(springs, np.append(np.ones(n), -np.ones(n))))
    together = len(taken)
    monkeypatch.setattr(active_set, "TOGETHER", 1.0)
    monkeypatch.setattr(active_set, "ARC", ())
    assert springs.solves(solution_within(springs, np.append(np.ones(n), -np.ones(n))))
    assert 2 * together < len(taken) - together


def test_rows_that_would_leave_where_they_are_are_held_together(monkeypatch):
    """A flat that is pushed up most at one end: all rows give way, of which a few carry."""
    n, taken = 100, []
    flat = CoulombProblem(np.full((n, n), 10.0) + np.eye(n), np.linspace(0.01, 1.0, n), np.zeros(0),
                          np.zeros(0, int))
    least = _Descent._least
    monkeypatch.setattr(_Descent, "_least", lambda *args: taken.append(1) or least(*args))
    monkeypatch.setattr(active_set, "ARC", ())
    x = solution_within(flat, np.zeros(n))
    assert flat.solves(x) and np.count_nonzero(x) < n / 2
    assert len(taken) < 10


def dragged(lacking: float) -> CoulombProblem:
    """Two nodes of a body that nothing but friction holds along them, pressed and dragged by as
    much as that carries, and by `lacking` more.
    """
    return CoulombProblem(np.eye(4), np.array([1.0, 1.0, 0.0, 0.0]), np.full(2, 0.3),
                          np.arange(2), motions=np.array([[0.0], [0.0], [1.0], [1.0]]),
                          balance=np.array([0.6 + lacking]))


@pytest.mark.parametrize("lacking, nearly", [(1e-8, True), (1e-4, True), (0.1, False)])
def test_bounds_that_nearly_hold_a_body_have_forces(lacking, nearly):
    """They are within bounds, in balance but for what these lack, and not the solution."""
    problem = dragged(lacking)
    given = problem.under(problem.load, np.zeros(2), offset=np.full(2, 0.3))
    assert solution_within(given, np.zeros(5)) is None
    z = solution_within(given, np.zeros(5), 1e-3)
    assert (z is not None) == nearly
    if nearly:
        np.testing.assert_allclose(z[:4], [1.0, 1.0, 0.3, 0.3], rtol=1e-9)


@pytest.mark.parametrize("lacking, nearly", [(1e-7, True), (1e-4, False)])
def test_bodies_that_glide_are_held_by_rounding(lacking, nearly):
    """Forces that obey the law but for as little are left to the judgement of residuals."""
    z = only_solution(dragged(lacking), np.zeros(5))
    assert (z is not None) == nearly


def test_projections_are_tried_ever_more_rarely_where_they_fail(monkeypatch):
    tried = []
    monkeypatch.setattr(_Descent, "_move", lambda self, x, aim=np.inf: tried.append(aim))
    descent = _Descent(bounded(rocking(0), np.full(N, 0.1)), np.zeros(2 * N))
    descent.energy, descent.slope, descent.x = 0.0, np.full(2 * N, -1.0), np.zeros(2 * N)
    del tried[:]
    for _ in range(64):
        descent._projected(np.ones(2 * N), np.full(2 * N, 1e-3), np.zeros(2 * N, bool))
    assert len(tried) == 7 * len(active_set.ARC)  # after 1, 2, 4, ... 64 changes
