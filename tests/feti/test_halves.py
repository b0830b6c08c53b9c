"""Dense symmetric matrices by half."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.feti import halves
from driver.feti.blocks import LARGE, BlockDiagonal, by_half, whole
from driver.feti.halves import Half

ROUNDING = 1e-14  # of sums of up to some hundred terms of order one, taken in different orders


def symmetric(n: int, seed: int = 3) -> np.ndarray:
    """(n, n) random entries."""
    matrix = np.random.default_rng(seed).standard_normal((n, n))
    return matrix + matrix.T


def test_the_lower_triangle_is_mirrored(monkeypatch):
    """In blocks of any size beside that of the matrix."""
    matrix = np.random.default_rng(1).standard_normal((7, 7))
    expected = np.tril(matrix) + np.tril(matrix, -1).T
    for size in (1, 3, 7, 10):
        monkeypatch.setattr(halves, "AT_A_TIME", size)
        assert np.array_equal(halves.mirrored(matrix.copy()), expected)


@pytest.mark.parametrize("order", "CF")
@pytest.mark.parametrize("n", (0, 1, 2, 9))
def test_a_half_has_the_whole_matrix_by_its_lower_triangle(n, order):
    matrix = symmetric(n)
    half = Half(np.array(np.tril(matrix) + np.triu(np.full((n, n), np.nan), 1), order=order))
    assert len(half) == n and half.entries.size == n * (n + 1) // 2
    assert np.array_equal(half.whole(), matrix)
    assert np.array_equal(np.tril(Half.of(n, half.entries).lower()), np.tril(matrix))
    half.replace(2 * matrix)
    assert np.array_equal(half.whole(), 2 * matrix)


def test_large_blocks_of_their_own_are_kept_by_half_and_multiply_as_whole_ones():
    """Beside small and shared ones, onto what was there or not; not even a NaN stays."""
    classes, matrices, stop = [], [], 0
    for members, n, shared in ((1, LARGE, False), (1, 5, False), (4, LARGE, True),
                               (2, LARGE + 3, False)):
        classes.append(SimpleNamespace(members=list(range(members)), shared=shared,
                                       rows=slice(stop, stop + members * n)))
        matrices.append(symmetric(n, stop))
        stop += members * n
    blocks = BlockDiagonal(classes, [by_half(M, c.shared) for c, M in zip(classes, matrices)],
                           "rows", "rows")
    assert [isinstance(of, Half) for of in blocks.blocks] == [True, False, False, True]
    x, expected = np.random.default_rng(7).standard_normal(stop), np.empty(stop)

    def compare():
        for c, M in zip(classes, matrices):
            expected[c.rows] = (x[c.rows].reshape(-1, len(M)) @ M).ravel()
        y = np.full(stop, np.nan)
        blocks.multiply(x, y)
        size = LARGE * np.abs(expected).max()
        assert np.abs(y - expected).max() <= ROUNDING * size
        blocks.multiply(x, y, add=True)
        assert np.abs(y - 2 * expected).max() <= 2 * ROUNDING * size

    compare()
    for k, n in ((1, 5), (3, LARGE + 3)):
        matrices[k] = symmetric(n, 100 + k)
        blocks.put(k, matrices[k])
        assert np.array_equal(whole(blocks.blocks[k]), matrices[k])
    compare()
