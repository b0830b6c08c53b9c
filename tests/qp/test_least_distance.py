"""The point of a polyhedron nearest to the origin, by the conditions that characterize it."""

import numpy as np
import pytest

from driver.qp.least_distance import least_distance


@pytest.mark.parametrize("seed", range(20))
def test_projection_on_a_polyhedron(seed):
    """y is feasible, and -y a nonnegative combination of the normals of the planes it lies on."""
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 6), rng.integers(1, 12)
    A = rng.standard_normal((m, n)) * 10.0 ** rng.integers(-6, 7, (m, 1))
    inside = rng.standard_normal(n)
    b = A @ inside + np.abs(A).max(axis=1) * rng.random(m) * rng.integers(0, 2, m)
    y, size = least_distance(A, b), np.linalg.norm(A, axis=1)
    assert np.all(A @ y - b <= 1e-9 * size * (1 + np.abs(inside).max()))
    met = np.abs(A @ y - b) <= 1e-9 * size * (1 + np.abs(inside).max())
    if not y.any():
        assert np.all(b >= 0)
        return
    normals = (A / size[:, None])[met].T
    from scipy.optimize import nnls

    assert nnls(normals, -y)[1] <= 1e-8 * np.linalg.norm(y)


def test_nothing_is_feasible():
    assert least_distance(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([-1.0, -1.0])) is None
