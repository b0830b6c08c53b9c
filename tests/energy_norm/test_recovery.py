"""Means of stresses round vertices, from which estimates are recovered; work along sides."""

import numpy as np
import pytest

from driver.energy_norm.contact_tractions import slid
from driver.energy_norm.recovery import averaged_stress, vertex_sums


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


@pytest.mark.parametrize("bend, work", [(0.0, 1.0), (0.3, 1.2), (-0.3, 0.8)])
def test_work_along_a_bent_side(bend, work):
    """A bound of 1 along a side of length 1: the mean of |slip|, 1 at the ends and 1 + bend in the
    middle; of slip from -1 to 1, twice a triangle.
    """
    one = np.ones((1, 2))
    assert slid(np.ones(1), one, one, np.array([bend])) == pytest.approx(work, rel=1e-14)
    assert slid(np.full(1, 2.0), 3 * one, np.array([[-1.0, 1.0]])) == pytest.approx(3.0)
