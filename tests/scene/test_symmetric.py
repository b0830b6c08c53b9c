"""Half of a symmetric matrix does what all of it does."""

import numpy as np
import pytest
from small_scenes import halved


@pytest.fixture(scope="module", params=range(4))
def pair(request):
    """A sparse symmetric matrix as it is kept, and dense; one has a row without any entry."""
    rng, n = np.random.default_rng(request.param), 9
    half = np.tril(rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.5))
    if request.param == 3:
        half[4], half[:, 4] = 0.0, 0.0
    whole = half + np.tril(half, -1).T
    return halved(half), whole


def test_products_and_entries(pair):
    K, whole = pair
    rng = np.random.default_rng(1)
    for x in (rng.standard_normal(9), rng.standard_normal((9, 3))):
        np.testing.assert_allclose(K @ x, whole @ x, rtol=1e-14, atol=1e-14)  # sums of ten terms
    assert np.array_equal(K.toarray(), whole) and np.array_equal(K.diagonal(), np.diag(whole))
    found = np.zeros((9, 9))
    rows, columns, values = K.entries()
    np.add.at(found, (rows, columns), values)
    assert np.array_equal(found, whole)


def test_what_couples_some_with_others(pair):
    K, whole = pair
    some, others = np.array([7, 0, 3]), np.array([8, 1, 4, 2])
    assert np.array_equal(K.between(some, others).toarray(), whole[np.ix_(some, others)])


def test_a_sum_has_the_entries_of_both(pair):
    """Also where the first has none, and several in a place."""
    K, whole = pair
    total = whole.copy()
    total[6, 1] += 3.0
    total[1, 6] += 3.0
    total[4, 4] += 2.0
    found = K.plus(np.array([6, 4, 6]), np.array([1, 4, 1]), np.array([1.0, 2.0, 2.0]))
    np.testing.assert_allclose(found.toarray(), total, rtol=1e-15)


def test_the_upper_triangle_is_left_out(pair):
    """Of a matrix of which all is given."""
    K, whole = pair
    rows, columns = np.nonzero(whole)
    again = type(K).of_lower(rows, columns, whole[rows, columns], 9)
    assert np.array_equal(again.toarray(), whole)
    assert len(again.values) == np.count_nonzero(np.tril(whole, -1)) + 9
