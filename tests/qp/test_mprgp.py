"""MPRGP against a dense active-set oracle, closed forms and its own promises."""

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from driver.hard.dense import box_qp

import driver.qp.mprgp as module
from driver.qp.lanczos import norm_bound
from driver.qp import box
from driver.qp.box import projected_gradient
from driver.qp.mprgp import mprgp

EPS = np.finfo(float).eps


class Operator:
    """Matrix as an operator that counts its calls."""

    def __init__(self, A):
        self.A, self.calls = A, 0

    def __call__(self, v):
        self.calls += 1
        return self.A @ v


@pytest.fixture(autouse=True)
def feasible_always(monkeypatch):
    """Every iterate and every half step of every test of this file is checked to be feasible."""
    place = module._Mprgp.place

    def checked(self, x, g, updates):
        assert np.all(self.lower <= x) and np.all(x <= self.upper)
        place(self, x, g, updates)

    monkeypatch.setattr(module._Mprgp, "place", checked)


def orthogonal(rng, n):
    return np.linalg.qr(rng.standard_normal((n, n)))[0]


def spd(rng, n, cond):
    """Random SPD matrix (n, n) with eigenvalues between 1/cond and 1."""
    d = cond ** -np.append(rng.random(max(n - 2, 0)), [0.0, 1.0])[:n]
    Q = orthogonal(rng, n)
    A = (Q * d) @ Q.T
    return (A + A.T) / 2


def problem(seed):
    """(A, b, lower, upper) of one of eight kinds, by seed."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 13))
    A = spd(rng, n, 10 ** rng.uniform(0, 6))
    kind = seed % 8
    if kind == 7:  # badly scaled components: A_ii between 1e-6 and 1e6
        s = 10 ** rng.uniform(-3, 3, n)
        A = spd(rng, n, 10.0) * np.outer(s, s)
    lower, upper = -rng.random(n), rng.random(n)
    # The right hand side comes from a point outside and inside the box, so that all cases occur.
    b = A @ (2 * rng.standard_normal(n))
    if kind == 1:
        upper[:] = np.inf
    elif kind == 2:
        lower[:] = -np.inf
    elif kind == 3:
        lower[rng.random(n) < 0.5], upper[rng.random(n) < 0.5] = -np.inf, np.inf
    elif kind == 4:
        fixed = rng.random(n) < 0.4
        upper[fixed] = lower[fixed]
    elif kind == 5:  # gap and multiplier zero together in some components
        x = np.clip(rng.standard_normal(n), lower, upper)
        multiplier = np.where(x == lower, 1.0, np.where(x == upper, -1.0, 0.0))
        b = A @ x - multiplier * (rng.random(n) < 0.5)
    elif kind == 6:  # tight boxes far from the minimiser: many release and fixing steps
        lower, upper = lower * 1e-2, upper * 1e-2
    return A, b, lower, upper


def corner(seed):
    """A start (n,) in a random corner of the box of problem(seed): components must be released."""
    _, b, lower, upper = problem(seed)
    x = np.where(np.random.default_rng(seed + 5000).random(len(b)) < 0.5, lower, upper)
    return np.where(np.isfinite(x), x, np.clip(0.0, lower, upper))


def solve(A, b, lower, upper, relative=1e-8, **options):
    """mprgp with the exact norm and tol = relative ||b||."""
    options.setdefault("norm_bound", np.linalg.norm(A, 2) * (1 + 1e-12))
    options.setdefault("max_products", 200_000)
    return mprgp(lambda v: A @ v, b, lower, upper, tol=relative * np.linalg.norm(b), **options)


def residual_of(A, b, lower, upper, x):
    """||g^P||, written down independently of the module; and the rounding of A x - b."""
    total = 0.0
    for i, g in enumerate(A @ x - b):
        if x[i] == lower[i] and g > 0 or x[i] == upper[i] and g < 0 or lower[i] == upper[i]:
            continue
        total += g * g
    rounding = 4 * len(b) * EPS * np.linalg.norm(np.abs(A) @ np.abs(x) + np.abs(b))
    return np.sqrt(total), rounding


def assert_solves(A, b, lower, upper, found, relative=1e-8):
    """Converged, and ||x - x*|| <= (residual + residual of the oracle) / lambda_min.

    For y with projected gradient g^P(y) and the solution x*: the variational inequality at x*
    and g_i (y - x*)_i <= g^P_i (y - x*)_i, componentwise, give with monotonicity
    lambda_min ||y - x*||^2 <= g^P(y)'(y - x*).  No multiplier, gap or activity enters.  The
    oracle's distance is bounded in the same way by its own residual.
    """
    assert found.status == "converged", found
    assert np.all(lower <= found.x) and np.all(found.x <= upper)
    residual, rounding = residual_of(A, b, lower, upper, found.x)
    assert residual <= relative * np.linalg.norm(b) + rounding
    assert np.linalg.norm(found.gradient - (A @ found.x - b)) <= (
        0.1 * relative * np.linalg.norm(b) + rounding)
    x = box_qp(A, b, lower, upper)
    oracle, rounding_oracle = residual_of(A, b, lower, upper, x)
    allowed = residual + oracle + rounding + rounding_oracle
    assert np.linalg.norm(found.x - x) <= allowed / np.linalg.eigvalsh(A)[0] * (1 + 1e-6)


# -- against the oracle -------------------------------------------------------------------------


@pytest.mark.parametrize("block", range(10))
@pytest.mark.some(2)
def test_random_problems_against_the_active_set_oracle(block):
    for seed in range(40 * block, 40 * (block + 1)):
        A, b, lower, upper = problem(seed)
        assert_solves(A, b, lower, upper, solve(A, b, lower, upper))
        assert_solves(A, b, lower, upper, solve(A, b, lower, upper, x0=corner(seed)))
        assert_solves(A, b, lower, upper,
                      solve(A, b, lower, upper, x0=corner(seed), expansion="cg"))


def test_all_kinds_of_steps_occur_in_the_random_problems():
    counts = np.zeros(3)
    for seed in range(100):
        r = solve(*problem(seed), x0=corner(seed))
        counts += r.cg_steps, r.expansion_steps, r.proportioning_steps
    assert counts.min() >= 50


def test_random_starts_lead_to_the_same_point():
    for seed in range(40):
        A, b, lower, upper = problem(seed)
        x0 = 3 * np.random.default_rng(seed + 1000).standard_normal(len(b))
        found = solve(A, b, lower, upper, x0=x0, gamma=0.3 + seed / 20, alpha_factor=1.0)
        assert_solves(A, b, lower, upper, found)


@settings(max_examples=100, derandomize=True, deadline=None)
@given(st.data())
def test_property_small_integer_problems(data):
    n = data.draw(st.integers(1, 5))
    entry = st.integers(-3, 3)
    root = np.array(data.draw(st.lists(entry, min_size=n * n, max_size=n * n)), float)
    A = root.reshape(n, n).T @ root.reshape(n, n) + np.eye(n)
    b = np.array(data.draw(st.lists(entry, min_size=n, max_size=n)), float)
    lower = np.array(data.draw(st.lists(st.sampled_from([-np.inf, -1.0, 0.0]),
                                        min_size=n, max_size=n)))
    upper = np.array(data.draw(st.lists(st.sampled_from([0.0, 1.0, np.inf]),
                                        min_size=n, max_size=n)))
    found = solve(A, b, lower, upper)
    if not b.any():  # tol = 0 is met exactly here: 0 is the solution and the start
        assert found.products == 1
    assert_solves(A, b, lower, upper, found)


def test_projected_gradient_compares_exactly():
    lower, upper = np.zeros(6), np.array([1.0, 1, 1, 1, 1, 0])
    x = np.array([0.0, 0, 1, 1, 5e-324, 0])
    g = np.array([2.0, -2, 2, -2, 2, 7])
    assert np.array_equal(projected_gradient(x, g, lower, upper), [0, -2, 2, 0, 2, 0])


# -- closed forms --------------------------------------------------------------------------------


def obstacle(m=8, n=40):
    """String under unit load over a flat obstacle, nodes j h, contact exactly from node m on.

    Second differences of parabolas are exact: u = x^2/2 - a x up to the contact at a = m h, the
    obstacle is at -a^2/2.  Nodal contact forces: h inside the contact, h/2 at its two ends.
    Returns K (n-1, n-1), load, u, multiplier, obstacle height.
    """
    h = 1.0 / n
    K = (2 * np.eye(n - 1) - np.eye(n - 1, k=1) - np.eye(n - 1, k=-1)) / h
    a = m * h
    x = np.minimum(np.arange(1, n), n - np.arange(1, n)) * h
    u = np.where(x < a, x**2 / 2 - a * x, -(a**2) / 2)
    j = np.arange(1, n)
    multiplier = np.where((j > m) & (j < n - m), h, np.where((j == m) | (j == n - m), h / 2, 0.0))
    return K, np.full(n - 1, -h), u, multiplier, -(a**2) / 2


def test_dualized_string_over_an_obstacle():
    K, load, u, multiplier, height = obstacle()
    B = -np.eye(len(load))  # contact condition B u <= c
    c = np.full(len(load), -height)
    F = B @ np.linalg.solve(K, B.T)
    d = B @ np.linalg.solve(K, load) - c
    found = solve(F, d, 0.0, np.inf, relative=1e-12)
    assert found.status == "converged"
    # residual / lambda_min(F), with lambda_min(F) = 1/||K||; factor 2 for rounding in F and d
    tolerance = 2 * 1e-12 * np.linalg.norm(d) * np.linalg.norm(K, 2)
    assert np.linalg.norm(found.x - multiplier) <= tolerance
    assert np.array_equal(found.x > 0, multiplier > 0)
    u_found = np.linalg.solve(K, load - B.T @ found.x)
    assert np.linalg.norm(u_found - u) <= 1e-9 * np.linalg.norm(u)


def test_primal_string_over_an_obstacle():
    K, load, u, _, height = obstacle()
    found = solve(K, load, height, np.inf, relative=1e-10)
    allowed = 1e-10 * np.linalg.norm(load) / np.linalg.eigvalsh(K)[0]
    assert found.status == "converged"
    assert np.linalg.norm(found.x - u) <= 1.01 * allowed


def test_separable_problem_is_a_projection():
    c = np.array([-2.0, 0.5, 3.0, 0.2])
    found = solve(np.eye(4), c, 0.0, 1.0)
    assert np.array_equal(found.x, [0, 0.5, 1, 0.2])


def test_zero_width_boxes_need_no_step():
    A, b, lower, _ = problem(0)
    found = solve(A, b, lower, lower)
    assert (found.status, found.products) == ("converged", 1)
    assert np.array_equal(found.x, lower)


# -- invariances and products --------------------------------------------------------------------


def steps_of(r):
    return r.products, r.cg_steps, r.expansion_steps, r.proportioning_steps


@pytest.mark.parametrize("base", [2.0**40, 2.0**-40, 1e12, 1e-12])
@pytest.mark.some(2)
def test_units_do_not_matter(base):
    """x -> s x, f -> c f: powers of two are exact in every bit, powers of ten up to rounding."""
    for seed in range(24):
        A, b, lower, upper = problem(seed)
        if base in (1e12, 1e-12):  # rounding differs: keep away from ties of long CG runs
            A = A + np.linalg.norm(A, 2) * np.eye(len(b)) / 10
        for s, c in ((base, 1.0), (1.0, base), (base, 1 / base)):
            plain = solve(A, b, lower, upper)
            L = np.linalg.norm(A, 2) * (1 + 1e-12) * c / s**2
            found = mprgp(lambda v: (A * (c / s**2)) @ v, b * (c / s), lower * s, upper * s,
                          tol=1e-8 * np.linalg.norm(b) * c / s, norm_bound=L,
                          max_products=200_000)
            assert steps_of(found) == steps_of(plain)
            assert np.allclose(found.x / s, plain.x, rtol=1e-9, atol=1e-11)


def test_the_monitor_may_end_it():
    """At a feasible point with its own gradient, whatever step it is."""
    A, b, lower, upper = problem(0)
    r = mprgp(Operator(A), b, lower, upper, tol=1e-12, norm_bound=np.linalg.norm(A, 2) * 1.01,
              monitor=lambda kind, products, residual: products >= 3)
    assert r.status == "stopped" and 3 <= r.products <= 5
    assert ((lower <= r.x) & (r.x <= upper)).all()
    assert np.allclose(r.gradient, A @ r.x - b, rtol=0, atol=1e-12 * np.abs(b).max())


def test_products_are_one_per_step_and_two_per_expansion():
    for seed in range(40):
        A, b, lower, upper = problem(seed)
        op, calls = Operator(A), []
        r = mprgp(op, b, lower, upper, tol=1e-6 * np.linalg.norm(b), max_products=100_000,
                  norm_bound=np.linalg.norm(A, 2) * (1 + 1e-12),
                  monitor=lambda *a: calls.append(a))
        assert r.products == op.calls
        upper_count = 1 + r.cg_steps + r.proportioning_steps + 2 * r.expansion_steps
        # expansions in which nothing is left to move need one product only
        assert upper_count - r.expansion_steps <= r.products <= upper_count
        kinds = [kind for kind, _, _ in calls]
        assert kinds[0] == "start" and len(kinds) == len(calls)
        assert [kinds.count(k) for k in ("cg", "expansion", "proportioning")] == [
            r.cg_steps, r.expansion_steps, r.proportioning_steps]
        assert all(p <= q for (_, p, _), (_, q, _) in zip(calls, calls[1:]))
        assert calls[-1][2] == pytest.approx(r.residual, rel=1e-12)


def test_warm_start_and_known_gradient():
    A, b, lower, upper = problem(16)
    x = box_qp(A, b, lower, upper)
    assert solve(A, b, lower, upper, x0=x).products <= 1
    assert solve(A, b, lower, upper, x0=x, gradient0=A @ x - b).products == 0
    x0 = np.clip(np.ones_like(b) / 3, lower, upper)
    plain = solve(A, b, lower, upper, x0=x0)
    known = solve(A, b, lower, upper, x0=x0, gradient0=A @ x0 - b)
    assert known.products == plain.products - 1
    assert np.array_equal(known.x, plain.x)


def test_the_operator_may_reuse_its_output():
    A, b, lower, upper = problem(24)
    out = np.empty_like(b)
    found = mprgp(lambda v: np.matmul(A, v, out=out), b, lower, upper,
                  norm_bound=np.linalg.norm(A, 2), tol=1e-8 * np.linalg.norm(b))
    assert_solves(A, b, lower, upper, found)


def test_preconditioner_in_the_face():
    rng = np.random.default_rng(5)
    n = 60
    s = 10 ** rng.uniform(-1.5, 1.5, n)
    A = spd(rng, n, 10.0) * np.outer(s, s)
    b = A @ (rng.standard_normal(n) + 0.5)
    lower, upper = np.full(n, -0.5), np.full(n, np.inf)

    def jacobi(r, free):
        assert r.shape == free.shape and not r[~free].any()
        return np.where(free, r / np.diag(A), 0.0)

    plain = solve(A, b, lower, upper)
    found = solve(A, b, lower, upper, preconditioner=jacobi)
    assert_solves(A, b, lower, upper, plain)
    assert_solves(A, b, lower, upper, found)
    assert found.cg_steps < 0.5 * plain.cg_steps
    with pytest.raises(ValueError, match="preconditioner"):
        solve(A, b, lower, upper, preconditioner=lambda r, free: -r)


def test_ranks_take_the_same_branches():
    """Three threads as ranks, one empty; different branches would break the barrier."""
    for seed in (3, 6, 11, 14, 22):
        A, b, lower, upper = problem(seed)
        n = len(b)
        parts = [slice(0, n // 2), slice(n // 2, n // 2), slice(n // 2, n)]
        barrier, sums, pieces, found = threading.Barrier(3), [0.0] * 3, [None] * 3, [None] * 3

        def run(rank, part):
            def exchange(slots, mine):
                slots[rank] = mine
                barrier.wait(5)
                everything = list(slots)
                barrier.wait(5)
                return everything

            def dot(a, c):
                return sum(exchange(sums, float(a @ c)))

            def minimum(value):
                return min(exchange(sums, value))

            def product(v):
                return A[part] @ np.concatenate(exchange(pieces, v))

            L, _ = norm_bound(product, 0, dot=dot, start=np.arange(1.0, n + 1)[part])
            found[rank] = mprgp(product, b[part], lower[part], upper[part], dot=dot,
                                minimum=minimum,
                                tol=1e-8 * np.linalg.norm(b), norm_bound=2 * L,
                                max_products=3000)

        threads = [threading.Thread(target=run, args=(k, p)) for k, p in enumerate(parts)]
        for t in threads:
            t.start()
        for t in threads:
            t.join(30)
        assert len({(steps_of(r), r.status, r.norm_bound) for r in found}) == 1
        x = np.concatenate([r.x for r in found])
        whole = solve(A, b, lower, upper, norm_bound=found[0].norm_bound, max_products=3000)
        assert whole.status == found[0].status == "converged"
        # both are within tol / lambda_min of the solution
        allowed = 2.1e-8 * np.linalg.norm(b) / np.linalg.eigvalsh(A)[0]
        assert np.linalg.norm(x - whole.x) <= allowed


def test_cut_step_finds_the_smallest_ratio_of_all_ranks():
    """Three threads, ratios over many magnitudes, with ties, with inf, and with an empty rank."""
    rng = np.random.default_rng(0)
    cases = [[10.0 ** rng.uniform(-8, 8, k) for k in rng.integers(0, 4, 3)] for _ in range(30)]
    cases += [[np.full(2, 0.1)] * 3, [np.full(2, np.inf)] * 3]
    cases += [[np.zeros(1), np.ones(1), np.ones(0)]]
    barrier, smallest, found = threading.Barrier(3), [0.0] * 3, [[], [], []]

    def run(rank):
        def minimum(value):
            smallest[rank] = value
            barrier.wait(5)
            total = min(smallest)
            barrier.wait(5)
            return total

        for case in cases:
            found[rank] += [module._cut_step(case[rank], w, minimum) for w in (1e-3, 1.0, np.inf)]

    threads = [threading.Thread(target=run, args=(k,)) for k in range(3)]
    for t in threads:
        t.start()
    for t in threads:
        t.join(30)
    assert found[0] == found[1] == found[2] and len(found[0]) == 3 * len(cases)
    wishes = [(np.concatenate(case).min(initial=np.inf), w)
              for case in cases for w in (1e-3, 1.0, np.inf)]
    for (step, blocked), (least, wish) in zip(found[0], wishes):
        assert step == min(least, wish)
        assert blocked == (least <= wish and least < np.inf)


def kinds_of(A, b, x0, **options):
    kinds = []
    r = mprgp(lambda v: A @ v, b, 0.0, np.inf, x0, tol=1e-10, norm_bound=1.0,
              monitor=lambda kind, *_: kinds.append(kind), **options)
    return kinds, r


def test_gradients_are_split_by_the_bounds_that_are_met():
    """Free where no bound is met, chopped where it points out of the box, neither in no width."""
    lower = np.array([0.0, 0, 0, -1, -1, -1, 2, -np.inf])
    upper = np.array([1.0, 1, 1, 0, 0, 0, 2, np.inf])
    x = np.array([0.0, 0, 0.5, 0, 0, -0.5, 2, 7])
    g = np.array([3.0, -3, 3, 3, -3, -3, 5, 4])
    phi, beta = box.split_gradient(x, g, lower, upper)
    assert phi.tolist() == [0, 0, 3, 0, 0, -3, 0, 4]
    assert beta.tolist() == [0, -3, 0, 3, 0, 0, 0, 0]
    np.testing.assert_array_equal(projected_gradient(x, g, lower, upper), phi + beta)


@pytest.mark.parametrize("step", [0.1, 1.0, 10.0])
def test_what_projection_leaves_of_a_gradient_step(step):
    """(x - P(x - a phi)) / a; and steps along a direction reach a bound at their ratio."""
    rng = np.random.default_rng(4)
    lower, upper = -rng.random(9), rng.random(9)
    lower[0], upper[1] = -np.inf, np.inf
    x = np.clip(rng.standard_normal(9) / 3, np.maximum(lower, -9), np.minimum(upper, 9))
    phi = np.where((x == lower) | (x == upper), 0.0, rng.standard_normal(9))
    found = module.reduced_free_gradient(x, phi, lower, upper, step)
    np.testing.assert_allclose(found, (x - np.clip(x - step * phi, lower, upper)) / step,
                               atol=1e-14)
    ratio = box.bound_ratios(x, phi, lower, upper)
    finite = np.isfinite(ratio)
    ends = (x - np.where(finite, ratio, 0.0) * phi)[finite]
    np.testing.assert_allclose(ends, np.where(phi > 0, lower, upper)[finite], atol=1e-14)
    assert (ratio >= 0).all() and (ratio[phi == 0] == np.inf).all()
    assert ratio[0] < np.inf or phi[0] >= 0
    assert module._cut_step(ratio, np.inf, lambda value: value)[1]
    least = ratio.min()
    for wish, expected in ((least / 2, (least / 2, False)), (least, (least, True)),
                           (2 * least, (least, True))):
        assert module._cut_step(ratio, wish, lambda value: value) == expected
    assert module._cut_step(np.full(3, np.inf), np.inf, lambda value: value) == (np.inf, False)


def test_release_criterion_looks_at_the_room_that_is_left():
    """phi = 1 but only 1e-6 of room: phi~'phi = 5e-7 < ||beta||^2 = 1/4, unless Gamma is large."""
    b, x0 = np.array([-1.0, 0.5]), np.array([1e-6, 0.0])
    assert kinds_of(np.eye(2), b, x0)[0][1] == "proportioning"
    assert kinds_of(np.eye(2), b, x0, gamma=1e4)[0][1] == "expansion"


def test_expansion_step_by_hand():
    """g = phi = (2, 2); half step 1/2 to (0, 2), where phi = (0, 1); then 1.95 along it."""
    kinds, r = kinds_of(np.eye(2), np.array([-1.0, 1.0]), np.array([1.0, 3.0]), max_products=3)
    assert kinds == ["start", "expansion"]
    assert r.x[0] == 0 and r.x[1] == pytest.approx(0.05, rel=1e-12)
    _, half = kinds_of(np.eye(2), np.array([-1.0, 1.0]), np.array([1.0, 3.0]), max_products=2)
    assert np.array_equal(half.x, [0, 2]) and np.array_equal(half.gradient, [1, 1])


def test_projected_cg_step_is_taken_only_if_it_lowers_the_objective_enough():
    """A = I: the projected CG step is the solution. Strongly coupled: it would raise f, but a
    quarter does not.
    """
    b = np.array([-1.0, 1.0])
    r = mprgp(lambda v: v, b, 0.0, np.inf, np.array([1.0, 3.0]), tol=1e-12, norm_bound=1.0,
              expansion="cg")
    assert np.array_equal(r.x, [0, 1]) and (r.expansion_steps, r.products) == (1, 3)
    # from (0.1, 1) the CG step goes to (-4, 3.6); projected to (0, 3.6) f is larger
    A = np.array([[1.0, 0.95], [0.95, 1.0]])
    b, x0 = A @ np.array([-9.0, 10.0]), np.array([0.1, 1.0])

    def f(x):
        return x @ (A @ x) / 2 - b @ x

    seen = []
    r = mprgp(lambda v: A @ v, b, 0.0, np.inf, x0, tol=1e-10, norm_bound=1.95, expansion="cg",
              monitor=lambda *step: seen.append(step))
    assert r.status == "converged" and f(r.x) <= f(x0)
    # b_2 > 0 and the first component is held at zero
    assert r.x == pytest.approx([0.0, b[1]], abs=1e-9)
    # a quarter of the CG step along -g, which is 7.4 long, ends at (0, 1.66), lower than where the
    # half step meets the bound
    r = mprgp(lambda v: A @ v, b, 0.0, np.inf, x0, tol=1e-10, norm_bound=1.95, expansion="cg",
              max_products=4)
    g = A @ x0 - b
    assert (r.products, r.expansion_steps) == (4, 1)  # start, CG step, two points of the arc
    assert r.x == pytest.approx([0.0, 1 - g[1] * (g @ g) / (g @ A @ g) / 4], rel=1e-12)


def test_conjugate_directions_need_one_step_per_distinct_eigenvalue():
    rng = np.random.default_rng(3)
    Q = orthogonal(rng, 20)
    A = (Q * np.resize([1.0, 10.0, 100.0], 20)) @ Q.T
    assert solve(A, rng.standard_normal(20), -np.inf, np.inf).cg_steps == 3


# -- bad operators, bad data, limits ---------------------------------------------------------------


def test_too_small_norm_bound_is_found_out():
    raised = 0
    for seed in range(80):
        A, b, lower, upper = problem(seed)
        L = np.linalg.norm(A, 2)
        found = solve(A, b, lower, upper, norm_bound=L / 10)
        assert_solves(A, b, lower, upper, found)
        assert found.norm_bound < 2.2 * L
        raised += found.norm_bound > L / 10
        exact = solve(A, b, lower, upper)
        assert exact.norm_bound == L * (1 + 1e-12)  # a right one is never blamed
    assert raised >= 10


@pytest.mark.parametrize("expansion", ["gradient", "cg"])
def test_objective_never_rises(monkeypatch, expansion):
    """f at every iterate, also with a norm bound ten times too small."""
    for seed in range(40):
        A, b, lower, upper = problem(seed)
        values, place = [], module._Mprgp.place

        def watch(self, x, g, updates):
            values.append(x @ (A @ x) / 2 - b @ x)
            place(self, x, g, updates)

        with monkeypatch.context() as patch:
            patch.setattr(module._Mprgp, "place", watch)
            r = solve(A, b, lower, upper, norm_bound=np.linalg.norm(A, 2) / 10, expansion=expansion)
        size = np.linalg.norm(A, 2) * np.dot(r.x, r.x) + np.abs(b) @ np.abs(r.x) + abs(values[0])
        assert np.all(np.diff(values) <= 100 * EPS * size)


@pytest.mark.parametrize("useful", [True, False], ids=["minimiser of a block", "random points"])
def test_relaxation_helps_or_does_no_harm(monkeypatch, useful):
    """A block minimiser is taken; points that do not lower f enough are refused, so MPRGP converges
    all the same.
    """
    taken, tried = 0, 0
    for seed in range(40):
        A, b, lower, upper = problem(seed)
        half, rng, values = len(b) // 2 + 1, np.random.default_rng(seed), []
        place, relaxed = module._Mprgp.place, module._Mprgp.relaxed_step

        def relax(y, g, known):
            # a point with its gradient, and the residual of the iterate
            assert known > 0
            assert np.abs(g - A @ y + b).max() <= 1e-9 * (np.abs(A) @ np.abs(y) + np.abs(b)).max()
            if not useful:
                return np.clip(y + rng.standard_normal(len(b)), lower, upper)
            rest = b[:half] - A[:half, half:] @ np.clip(y, lower, upper)[half:]
            block = box_qp(A[:half, :half], rest, lower[:half], upper[:half])
            return np.concatenate([block, np.clip(y, lower, upper)[half:]])

        def watch(self, x, g, updates):
            values.append(x @ (A @ x) / 2 - b @ x)
            place(self, x, g, updates)

        def count(self, *args):
            nonlocal taken, tried
            found = relaxed(self, *args)
            taken, tried = taken + found, tried + 1
            return found

        with monkeypatch.context() as patch:
            patch.setattr(module._Mprgp, "place", watch)
            patch.setattr(module._Mprgp, "relaxed_step", count)
            r = solve(A, b, lower, upper, expansion="cg", relax=relax)
        assert_solves(A, b, lower, upper, r)
        size = np.linalg.norm(A, 2) * np.dot(r.x, r.x) + np.abs(b) @ np.abs(r.x) + abs(values[0])
        assert np.all(np.diff(values) <= 100 * EPS * size)
    assert tried > 20 and taken > (tried / 2 if useful else 0)


@pytest.mark.parametrize("bounds", [(-np.inf, np.inf), (0.0, np.inf), (-np.inf, 0.5)])
def test_indefinite_operator(bounds):
    A = np.diag([1.0, 2.0, -1.0])
    found = mprgp(lambda v: A @ v, np.array([1.0, 1, 1e-3 if bounds[1] > 1 else -1e-3]),
                  *bounds, tol=1e-8, norm_bound=2.0)
    assert found.status == "indefinite operator"
    assert "curvature" in found.reason


def test_unbounded_ray_and_bounded_semidefinite_problem():
    A = np.array([[1.0, -1.0], [-1.0, 1.0]])
    b = np.array([1.0, 1.0])
    for lower in (-np.inf, 0.0):
        found = solve(A, b, lower, np.inf)
        assert found.status == "indefinite operator" and "unbounded" in found.reason
    found = solve(A, b, 0.0, np.array([2.0, np.inf]))  # the box ends the ray: x = (2, 3)
    assert found.status == "converged"
    assert np.allclose(found.x, [2, 3], rtol=1e-7)
    consistent = solve(A, np.array([1.0, -1.0]), -np.inf, np.inf)
    assert consistent.status == "converged"


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("call", [1, 2, 3, 4])
def test_values_that_are_not_finite_end_with_a_status(bad, call):
    A, b, lower, upper = problem(10)
    assert solve(A, b, lower, upper, x0=corner(10), relative=0.0).products >= 4
    op = Operator(A)

    def broken(v):
        out = op(v)
        if op.calls == call:
            out = out.copy()
            out[0] = bad
        return out

    found = mprgp(broken, b, lower, upper, corner(10), tol=0.0, norm_bound=np.linalg.norm(A, 2))
    assert found.status == "indefinite operator" and "finite" in found.reason
    assert np.all(np.isfinite(found.x))


def test_iteration_limit_is_kept():
    A, b, lower, upper = problem(6)
    enough = solve(A, b, lower, upper).products
    for limit in range(1, enough):
        op = Operator(A)
        found = mprgp(op, b, lower, upper, tol=1e-8 * np.linalg.norm(b), max_products=limit,
                      norm_bound=np.linalg.norm(A, 2) * (1 + 1e-12))
        assert found.status == "iteration limit"
        assert op.calls == found.products == limit
        true, rounding = residual_of(A, b, lower, upper, found.x)
        assert abs(true - found.residual) <= 100 * rounding


@pytest.mark.parametrize("relative", [1e-30, 0.0])
def test_tolerance_below_rounding_stagnates(relative):
    stagnated = 0
    for seed in range(24):
        A, b, lower, upper = problem(seed)
        found = solve(A, b, lower, upper, relative=relative)
        assert found.status in ("stagnated", "converged"), (seed, found)
        assert found.products < 5000
        stagnated += found.status == "stagnated"
        residual, _ = residual_of(A, b, lower, upper, found.x)
        assert residual <= 1e-6 * np.linalg.norm(b)
    assert stagnated >= 5


@pytest.mark.parametrize("noise", [1e-7, 1e-3])
def test_noisy_operator_stagnates(noise):
    """Noise far above the rounding that the module reckons with."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        A = spd(rng, 30, 100.0)
        b = A @ rng.standard_normal(30)

        def noisy(v):
            return A @ v * (1 + noise * rng.standard_normal(30))

        found = mprgp(noisy, b, -1.0, 1.0, tol=1e-12 * np.linalg.norm(b), norm_bound=1.1,
                      max_products=20_000)
        assert found.status == "stagnated" and found.products < 3000, found
        assert residual_of(A, b, np.full(30, -1.0), np.ones(30), found.x)[0] < (
            100 * noise * np.linalg.norm(b))


@pytest.mark.parametrize("expansion", ["cg", "gradient"])
def test_a_gradient_below_its_own_rounding_is_not_followed(expansion):
    """Solution 0 and tol 0: updates take the gradient to 1e-158 while x stays at 1e-17, and then
    p'Ap underflows.
    """
    rng = np.random.default_rng(0)
    Q = orthogonal(rng, 6)
    A = 1e-12 * (Q @ Q.T)
    x0 = np.array([4.5, 3.9, -2.7, 1.3, -0.9, 2.3])
    found = mprgp(lambda v: A @ v, np.zeros(6), -rng.random(6), np.inf, x0, tol=0.0,
                  norm_bound=1e-12, expansion=expansion)
    assert found.products < 100 and found.status in ("converged", "stagnated")
    assert np.abs(found.x).max() < 1e-100


def test_a_preconditioned_gradient_that_is_rounding_stagnates():
    """What the preconditioner gives is across the gradient, but for a part of 1e-5 against it: no
    symmetric positive definite one does that, but one with a condition of 1e16 does after rounding.
    No caller's mistake: what has been found so far is returned.
    """
    A, b, lower, upper = problem(8)
    lower, upper = np.full_like(b, -1e3), np.full_like(b, 1e3)

    def rounded(r, free):
        across = np.roll(r, 1)
        across -= r * (r @ across) / (r @ r)
        return across - 1e-5 * np.linalg.norm(across) / np.linalg.norm(r) * r

    found = mprgp(lambda v: A @ v, b, lower, upper, tol=1e-8 * np.linalg.norm(b),
                  norm_bound=np.linalg.norm(A, 2), preconditioner=rounded)
    assert found.status == "stagnated" and "preconditioned gradient" in found.reason, found


def test_steps_that_lead_nowhere_stagnate(monkeypatch):
    def step(self):
        self.product(self.x)
        return "cg"

    monkeypatch.setattr(module._Mprgp, "step", step)
    found = solve(*problem(8))
    assert found.status == "stagnated" and 200 < found.products < 300


@pytest.mark.parametrize("change, reason", [
    ({"lower": [0.0, 2.0]}, "box is empty"), ({"lower": [np.inf, 0.0], "upper": np.inf}, "empty"),
    ({"lower": [0.0, np.nan]}, "NaN"), ({"upper": np.nan}, "NaN"), ({"b": [np.nan, 1.0]}, "b has"),
    ({"b": [np.inf, 1.0]}, "b has"), ({"x0": [np.nan, 0.0]}, "x0"), ({"x0": [0.0]}, "x0"),
    ({"x0": [np.inf, 0.0], "upper": np.inf}, "x0"), ({"norm_bound": 0.0}, "norm_bound"),
    ({"norm_bound": np.nan}, "norm_bound"), ({"alpha_factor": 2.1}, "alpha_factor"),
    ({"gamma": 0.0}, "gamma"), ({"tol": np.nan}, "tol"), ({"max_products": 0}, "max_products"),
    ({"x0": [5.0, 0.0], "gradient0": [0.0, 0.0]}, "gradient0"),
])
def test_impossible_data(change, reason):
    data = {"b": [1.0, 1.0], "lower": [0.0, 0.0], "upper": 1.0, "x0": None, "tol": 1e-8,
            "norm_bound": 1.0, **change}
    with pytest.raises(ValueError, match=reason) as caught:
        mprgp(lambda v: v, **data)
    assert "\n" not in str(caught.value)


# -- norm bound -----------------------------------------------------------------------------------


def spectra(rng, n):
    """Spectra (n,): evenly spread, decaying, clustered, one on top, alternating, low rank."""
    k = np.arange(1, n + 1) / n
    if n == 1:
        yield k
        return
    yield from (k, k**2, 0.5 + 0.5 * np.cos(np.pi * k), rng.random(n) + 1e-9, 1e-6**k)
    yield 1 - 1e-3 * rng.random(n)
    yield np.append(np.full(n - 1, 0.9), 1.0)
    yield np.where(np.arange(n) % 2, 0.999, 1.0) * (1 + 1e-3 * k)
    yield np.where(np.arange(n) < 3, np.arange(n) + 1.0, 0.0)


def test_norm_bound_is_an_upper_bound():
    for seed in range(60):
        rng = np.random.default_rng(seed)
        n = int(rng.choice([1, 2, 5, 15, 40, 120]))
        Q = orthogonal(rng, n)
        for d in spectra(rng, n):
            unit = 10.0 ** rng.integers(-12, 13)
            A = Operator((Q * (unit * d)) @ Q.T)
            bound, products = norm_bound(A, n, seed=seed)
            assert products == A.calls <= 15
            assert 1 - 1e-13 <= bound / (unit * d.max()) <= 1.5


def test_norm_bound_with_alternating_dominant_mode_and_large_n():
    """Largest mode is (+1, -1, ...): orthogonal to smooth vectors.  Operator without matrix."""
    def string(v):
        return 2 * v - np.append(v[1:], 0) - np.append(0, v[:-1])

    for n in (100, 3000):
        for seed in range(10):
            assert 4 * np.cos(np.pi / (2 * n + 2)) ** 2 <= norm_bound(string, n, seed=seed)[0] < 6


def test_norm_bound_breakdown_and_start():
    assert norm_bound(lambda v: 3 * v, 50) == (pytest.approx(3), 1)
    assert norm_bound(lambda v: 0 * v, 5) == (0, 1)
    A = np.diag([1.0, 2, 3])
    assert norm_bound(lambda v: A @ v, 3, start=np.ones(3))[0] == pytest.approx(3)
    assert norm_bound(lambda v: A @ v, 3, steps=1)[0] >= 3
    with pytest.raises(ValueError):
        norm_bound(lambda v: v, 3, start=np.zeros(3))
    with pytest.raises(ValueError):
        norm_bound(lambda v: v * np.nan, 3)


@pytest.mark.parametrize("steps", [8, 15])
def test_the_norm_bound_leaves_the_error_that_random_starts_have(steps):
    """The largest Ritz value by Krylov vectors made orthogonal, and the relative error eps that
    risk = 1.648 sqrt(N) exp(-sqrt(eps) (2 k - 1)) says of k steps, at most 1/2.
    """
    values = np.linspace(0.0, 1.0, 400)
    krylov = [np.ones(400)]
    for _ in range(steps - 1):
        krylov.append(np.linalg.qr(np.column_stack([*krylov, values * krylov[-1]]))[0][:, -1])
    basis = np.linalg.qr(np.column_stack(krylov))[0]
    theta = np.linalg.eigvalsh(basis.T @ (values[:, None] * basis))[-1]
    eps = brentq(lambda eps: 1.648 * 20 * np.exp(-np.sqrt(eps) * (2 * steps - 1)) - 1e-3, 0, 9)
    bound, _ = norm_bound(lambda v: values * v, 400, start=np.ones(400), steps=steps)
    assert bound == pytest.approx(theta / (1 - min(eps, 0.5)), rel=1e-9)


# --------------------------------------------------------------------------------- scaling

@pytest.mark.parametrize("expansion", ["cg", "gradient"])
def test_scale_makes_up_for_rows_of_different_size(expansion):
    """D A D of a well-conditioned matrix spoilt by 1e6 is solved like that matrix: the same steps,
    the same answer.
    """
    rng = np.random.default_rng(5)
    n = 30
    A, b = spd(rng, n, 10.0), rng.standard_normal(n)
    lower, upper = np.full(n, -0.3), np.where(rng.random(n) < 0.5, 0.2, np.inf)
    plain = mprgp(Operator(A), b, lower, upper, tol=1e-10, norm_bound=1.0, expansion=expansion)
    D = 2.0 ** rng.integers(-10, 11, n)  # powers of two: not a bit may change
    spoilt = A / np.outer(D, D)

    def jacobi(r, free):
        return np.where(free, r / np.diag(spoilt), 0.0)

    same = dict(tol=1e-10, norm_bound=1.0, expansion=expansion, scale=D)
    found = mprgp(Operator(spoilt), b / D, lower * D, upper * D, **same)
    assert np.array_equal(found.x / D, plain.x) and found.products == plain.products
    assert found.residual == plain.residual and np.array_equal(found.gradient * D, plain.gradient)
    started = mprgp(Operator(spoilt), b / D, lower * D, upper * D, plain.x * D,
                    gradient0=(A @ plain.x - b) / D,
                    preconditioner=jacobi, **same)
    assert started.status == "converged" and started.products <= 2


@pytest.mark.parametrize("slope, status", [(1e-3, "indefinite operator"), (1e-12, "stagnated")])
def test_a_ray_without_curvature_is_endless_or_rounding(slope, status):
    """By what products leave of a gradient, times the updates since the last one."""
    solver = object.__new__(module._Mprgp)
    solver.x, solver.updates, solver.dot = np.ones(3), 9, np.dot
    solver.bound, solver.b_norm = 1e3, 1.0
    p = np.array([0.0, 2.0, 0.0])
    solver.refuse_endless(1.0, p, 2 * slope)  # it ends
    with pytest.raises(module._Stop) as stop:
        solver.refuse_endless(np.inf, p, 2 * slope)
    assert stop.value.args[0] == status


@pytest.mark.parametrize("start, steps", [([0.0, 0.0], 5), ([1.0, np.inf], 5), ([1.0, np.nan], 5),
                                          ([1.0, 0.0], 0)])
def test_a_norm_needs_a_vector_and_a_step(start, steps):
    with pytest.raises(ValueError, match="start vector"):
        norm_bound(lambda v: 2 * v, 2, start=start, steps=steps)


@pytest.mark.parametrize("expansion", ["cg", "gradient"])
@pytest.mark.parametrize("seed", range(7))
def test_decreases_of_all_steps_add_up_to_that_of_f(monkeypatch, seed, expansion):
    """Of CG, expansion and proportioning steps: stagnation is judged by their sum."""
    A, b, lower, upper = problem(seed)
    runs = []
    monkeypatch.setattr(module._Mprgp, "refuse_stagnation", lambda run: runs.append(run))
    x0 = corner(seed)
    found = solve(A, b, lower, upper, x0=x0, expansion=expansion)

    def f(x):
        return 0.5 * x @ A @ x - b @ x

    drop = f(x0) - f(found.x)
    assert found.status == "converged" and drop > 0
    size = np.abs(A).max() * (x0 @ x0 + found.x @ found.x) + np.abs(b) @ (np.abs(x0) + 1)
    assert runs[-1].decrease == pytest.approx(drop, abs=1e4 * EPS * size)  # of some hundred steps


def test_scalar_products_of_a_step_are_asked_for_together():
    """The same iterates as one after the other; per step one message for the gradient's parts and
    one for the curvature, besides what only their results tell to ask for.
    """
    rng = np.random.default_rng(5)
    A, b = spd(rng, 30, 100.0), rng.standard_normal(30)
    plain, single, several = [], [], []

    def dot(into):
        return lambda a, c: into.append(1) or float(np.dot(a, c))

    def dots(*pairs):
        several.append(len(pairs))
        return [float(np.dot(a, c)) for a, c in pairs]

    options = {"tol": 1e-9, "norm_bound": 1.01 * np.linalg.norm(A, 2), "expansion": "cg"}
    one = mprgp(lambda v: A @ v, b, 0.0, 1.0, dot=dot(plain), **options)
    other = mprgp(lambda v: A @ v, b, 0.0, 1.0, dot=dot(single), dots=dots, **options)
    assert np.array_equal(one.x, other.x) and one.products == other.products
    steps = one.cg_steps + one.expansion_steps + one.proportioning_steps
    assert len(plain) == len(single) + sum(several)
    assert several.count(3) >= steps + 1 and several.count(2) >= steps + 1


def test_a_norm_whose_square_overflows_is_no_defect_of_the_operator():
    """A number that is none is one."""
    with pytest.raises(OverflowError):
        norm_bound(lambda v: 1e200 * np.arange(1.0, 6.0) * v, 5)
    with pytest.raises(ValueError, match="not finite"):
        norm_bound(lambda v: np.nan * v, 5)
