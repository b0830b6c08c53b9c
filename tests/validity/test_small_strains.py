"""Strains and rotations of triangles of many subdomains together."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.validity import small_strains
from driver.validity.small_strains import MEASURES, SmallStrains

TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]])
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


def piece(index: int, size: float) -> SimpleNamespace:
    """A square of two triangles, two lengths from the one before."""
    return SimpleNamespace(index=index, xy=size * SQUARE + [2.0 * index, 0.0],
                           triangles=TRIANGLES, axisymmetric=False,
                           elasticity=np.tile(5.0 * np.eye(3), (2, 1, 1)))


@pytest.mark.parametrize("at_a_time", [1, 3, 100])
def test_every_subdomain_has_its_own(monkeypatch, at_a_time):
    """Uniform gradients: a stretch, a shear and a rotation, one further turned."""
    monkeypatch.setattr(small_strains, "AT_A_TIME", at_a_time)
    subs = [piece(4, 1.0), piece(1, 0.5), piece(2, 0.25)]
    gradients = np.array([[[0.2, 0.0], [0.0, -0.1]], [[0.0, 0.3], [0.3, 0.0]],
                          [[0.0, -0.4], [0.4, 0.0]]])  # d u_k / d x_j at [k, j]
    fields = [(sub.xy @ d.T).ravel() for sub, d in zip(subs, gradients)]
    limits = np.array([[0.15, 0.25], [0.05, 0.28]])
    found = SmallStrains.of(subs, fields, np.array([0.1, 0.0, -0.1]), 6, limits)
    np.testing.assert_allclose(found.areas, [0, 0.25, 0.0625, 0, 1.0, 0])
    # strains 0.2, 0.3 and 0; turns -0 + 0.1, 0 and -+0.4 - 0.1
    np.testing.assert_allclose(found.beyond[0], [[0, 0.25, 0, 0, 1, 0], [0, 0.25, 0, 0, 0, 0]])
    np.testing.assert_allclose(found.beyond[1], [[0, 0, 0.0625, 0, 1, 0], [0, 0, 0.0625, 0, 0, 0]])
    assert found.largest["largest_strain"] == (pytest.approx(0.3),
                                               pytest.approx((2 + 1 / 6, 1 / 6)))
    assert found.largest["largest_rotation"][0] == pytest.approx(0.3)
    assert set(found.largest) == set(MEASURES)
    # squares of strains 0.2 and 0.3, and of half the squares of turns 0.1, 0 and 0.3
    np.testing.assert_allclose(found.squares[0], [0, 5 * 0.25 * 0.3**2, 0, 0, 5 * 0.2**2, 0],
                               atol=1e-17)
    np.testing.assert_allclose(found.squares[1], [0, 0, 5 * 0.0625 * 0.3**4 / 4, 0,
                                                  5 * 0.1**4 / 4, 0], atol=1e-17)


def test_hoop_strains_are_strains():
    """A ring that widens evenly by 0.2 of its inner radius 2 at a length that does not change."""
    ring = piece(1, 1.0)
    ring.axisymmetric, ring.curved, ring.elements = True, False, TRIANGLES
    ring.corner = ring.xy[TRIANGLES]
    found = SmallStrains.of([ring], [np.tile([0.4, 0.0], 4)], np.zeros(1), 2,
                            np.array([[0.1, 0.17], [1.0, 1.0]]))
    value, place = found.largest["largest_strain"]  # u_r / r in the middle of the inner triangle
    assert value == pytest.approx(0.4 / (2 + 1 / 3)) and place == pytest.approx((2 + 1 / 3, 1 / 3))
    np.testing.assert_allclose(found.beyond[0], [[0, 1.0], [0, 0.5]])


def test_a_rank_without_subdomains_has_nothing():
    found = SmallStrains.of([], [], np.zeros(0), 2, np.ones((2, 2)))
    assert not found.largest and not found.areas.any() and not found.beyond.any()
