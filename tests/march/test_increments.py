"""Contact rows solved beside what products round off on gluing rows."""

import numpy as np
import pytest

from driver.march.increments import DIGITS, solved_by_increments
from driver.march.step import Trace
from test_dense_steps import N, TIGHT, load_of, parts

NOISE = 1e-7  # of displacements on gluing rows: what products round off there


def noisy(seed: int):
    """A dense problem whose products are off by NOISE on gluing rows, each time otherwise."""
    of, draw = parts(seed, **TIGHT), np.random.default_rng(seed)
    product, of.operator.levels = of.operator.apply, 2

    def apply(x: np.ndarray) -> np.ndarray:
        y = product(x)
        y[2 * N :] += NOISE * np.linalg.norm(y) * draw.standard_normal(N)
        return y

    of.operator.apply = apply
    return of, product


def on_contact(of, product, load, x: np.ndarray) -> float:
    """Natural residual of contact and friction at x, relative to the load."""
    move, bound = load.d - product(x), of.rows.friction_bound(x)
    n, t = x[:N], x[N : 2 * N]
    missed = np.append(n - np.maximum(n + move[:N], 0.0),
                       t - np.clip(t + move[N : 2 * N], -bound, bound))
    return np.abs(missed).max() / np.linalg.norm(load.d)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_contact_rows_keep_digits_that_gluing_rows_lose(seed):
    """Gluing multipliers that leave what products round off move the contact rows by as much;
    beside that they are solved to rounding, and gluing rows miss no more than DIGITS of the change
    in addition.
    """
    of, product = noisy(seed)
    load, zero = load_of(of), np.zeros(3 * N)
    exact = parts(seed, **TIGHT)
    load_of(exact)
    x, _, _ = exact.fixed.find(1, load, zero, -load.d, np.zeros(N), Trace(), 1e-9)
    size, g = np.linalg.norm(load.d), slice(2 * N, None)
    left = NOISE * size * np.random.default_rng(seed).standard_normal(N)
    x[g] -= np.linalg.solve(of.operator.F[g, g], left)
    before, glued = on_contact(of, product, load, x), (load.d - product(x))[g]
    y, gradient = solved_by_increments(of.qp, of.condensation, of.bodies, 1, load, x,
                                       product(x) - load.d, 1)
    assert before > 0.1 * NOISE and on_contact(of, product, load, y) < 1e-6 * NOISE
    np.testing.assert_allclose(gradient[: 2 * N], (product(y) - load.d)[: 2 * N], atol=1e-12)
    moved = np.linalg.norm(of.operator.F[g, : 2 * N] @ (y - x)[: 2 * N])
    assert np.linalg.norm((load.d - product(y))[g] - glued) <= 2 * DIGITS * moved + 1e-12


def test_nothing_is_done_where_stiffness_does_not_jump():
    of, _ = noisy(1)
    of.operator.levels, load, x = 1, load_of(of), np.ones(3 * N)
    gradient, products = of.operator.F @ x - load.d, of.operator.products
    y, same = solved_by_increments(of.qp, of.condensation, of.bodies, 1, load, x, gradient, 1)
    assert y is x and same is gradient and of.operator.products == products
