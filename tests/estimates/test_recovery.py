"""Means of stresses round vertices, from which estimates are recovered."""

import numpy as np

from driver.estimates.recovery import averaged_stress, vertex_sums


def test_means_weigh_by_area():
    """Two triangles of areas 1 and 3 share the vertices 1 and 2: there the mean is (s + 3 t)/4."""
    triangles, area = np.array([[0, 1, 2], [2, 1, 3]]), np.array([1.0, 3.0])
    stress = np.array([[4.0, 0.0, 8.0], [0.0, 4.0, -8.0]])
    sums = vertex_sums(triangles, area, np.repeat(stress[:, None], 3, axis=1), 4)
    np.testing.assert_allclose(sums[:, 0], [1, 4, 4, 3])
    mean = averaged_stress(triangles, np.zeros(2, int), area, stress)
    shared = (stress[0] + 3 * stress[1]) / 4
    np.testing.assert_allclose(mean, [[stress[0], shared, shared], [shared, shared, stress[1]]])


def test_means_do_not_cross_regions():
    """Stresses jump where the material does."""
    triangles, stress = np.array([[0, 1, 2], [2, 1, 3]]), np.array([[1.0, 2, 3], [4.0, 5, 6]])
    mean = averaged_stress(triangles, np.array([0, 1]), np.ones(2), stress)
    np.testing.assert_allclose(mean, np.repeat(stress[:, None], 3, axis=1))
