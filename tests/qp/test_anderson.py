"""Anderson acceleration: exact after as many differences as a linear map has dimensions."""

import numpy as np
import pytest

from driver.qp.anderson import DEPTH, LIMIT, PATIENCE, Anderson, gives_up


def linear(seed: int, size: int):
    """A linear map that does not contract, and its fixed point."""
    rng = np.random.default_rng(seed)
    matrix, fixed = 2 * rng.standard_normal((size, size)), rng.standard_normal(size)
    return (lambda g: fixed + matrix @ (g - fixed)), fixed


@pytest.mark.parametrize("size", range(1, DEPTH + 1))
def test_a_linear_map_takes_as_many_differences_as_dimensions(size):
    """The combined change is the least there is: none, once differences span the space (Walker,
    Ni, SIAM J. Numer. Anal. 49 (2011) 1715-1735).
    """
    step, fixed = linear(size, size)
    accelerated, g = Anderson(np.dot, noise=1e-10), np.zeros(size)
    for _ in range(size + 1):
        g = accelerated.next(g, step(g))
    np.testing.assert_allclose(g, fixed, atol=1e-6 * np.abs(fixed).max())


def test_only_the_last_differences_count():
    step, _ = linear(7, 3 * DEPTH)
    long, points, g = Anderson(np.dot), [], np.ones(3 * DEPTH)
    for _ in range(2 * DEPTH):
        points.append(g)
        g = long.next(g, step(g))
    short = Anderson(np.dot)
    for point in points[-DEPTH - 1 :]:
        last = short.next(point, step(point))
    np.testing.assert_allclose(last, g, rtol=1e-9)


def test_a_difference_that_says_nothing_makes_no_step():
    """A change that stays the same up to rounding: a secant through it would lead to 1e10."""
    accelerated = Anderson(np.dot, 5, 1.0, 0.01)
    accelerated.next(np.zeros(1), np.ones(1))
    assert accelerated.next(np.ones(1), np.array([2.0 - 1e-10])) == pytest.approx(2.0)
    # one that halves it is taken: the fixed point of 1 - g/2 + g
    accelerated.next(np.zeros(1), np.ones(1))
    assert accelerated.next(np.ones(1), np.array([1.5])) == pytest.approx(2.0)


def test_it_goes_on_as_long_as_changes_are_halved():
    """Up to a limit; and for its patience where they are not."""
    halved = list(0.4 ** np.arange(LIMIT))
    assert not any(gives_up(halved[:k]) for k in range(1, LIMIT)) and gives_up(halved)
    assert not gives_up([1.0] * PATIENCE) and gives_up([1.0] * (PATIENCE + 1))
    assert not gives_up([1.0, 0.4] + [0.3] * (PATIENCE - 1))
    assert gives_up([1.0, 0.4] + [0.3] * PATIENCE)
