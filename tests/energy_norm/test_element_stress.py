"""Statically admissible stresses in a triangle, against moments on its sides and its body force."""

import numpy as np
import pytest

from driver.energy_norm import element_stress
from driver.energy_norm.element_stress import CORNER

QUARTER = np.array([[0, 1], [-1, 0]])
MOMENTS = np.array([[2, 1], [1, 2]]) / 6  # of a density linear between its ends


def parts(corner):
    """(3, 3, 2) nodes of the parts: two corners and the centroid."""
    return np.array([[corner[k - 2], corner[k - 1], corner.mean(axis=0)] for k in range(3)])


def tensors(stress):
    """(..., 2, 2) of s11, s22, s12."""
    return stress[..., [[0, 2], [2, 1]]]


def on_sides(corner, stress):
    """(side, end, 2) moments of the tractions of stress (part, node, 2, 2)."""
    found = np.zeros((3, 2, 2))
    for side in range(3):
        normal = QUARTER @ (corner[(side + 1) % 3] - corner[side])  # by the side's length
        found[side] = MOMENTS @ (stress[side - 1, :2] @ normal)
    return found


def body_moments(corner, stress):
    """(corner, 2) of the force that holds the divergence of the parts in balance."""
    found = np.zeros((3, 2))
    for part, node in enumerate(parts(corner)):
        places = np.column_stack([node, np.ones(3)])
        slope, area = np.linalg.inv(places)[:2], np.linalg.det(places) / 2  # slopes of the hats
        force = -np.einsum("dn,ncd->c", slope, stress[part])
        weight = np.full(3, 1 / 9 + 1 / 3)  # the mean of the hats of the corners
        weight[part] = 1 / 9
        found += area * weight[:, None] * force
    return found


def jumps(corner, stress):
    """Tractions between the parts that differ."""
    middle, worst = corner.mean(axis=0), 0.0
    for j in range(3):
        one, other = (j + 1) % 3, (j + 2) % 3  # corner j is the node 1 of one, 0 of the other
        across = QUARTER @ (middle - corner[j])
        worst = max(worst, np.abs((stress[one, [1, 2]] - stress[other, [0, 2]]) @ across).max())
    return worst


def test_stresses_have_the_tractions_that_are_given():
    """In any triangle without a body force, from forces at ends of sides that are in balance."""
    rng = np.random.default_rng(1)
    corner = np.array([[[0.2, 0.1], [1.7, 0.4], [0.6, 2.0]]])
    given = rng.standard_normal((3, 2, 2))
    given[0] -= given.sum(axis=(0, 1)) / 2
    place = np.stack([corner[0], corner[0][[1, 2, 0]]], axis=1)  # of the ends
    torque = (place[..., 0] * given[..., 1] - place[..., 1] * given[..., 0]).sum()
    arm = corner[0][1] - corner[0][0]
    couple = QUARTER @ arm / (arm @ arm) * torque
    given[0] += [-couple, couple]
    stress = tensors(element_stress.johnson_mercier(corner, given[None])[0])
    np.testing.assert_allclose(on_sides(corner[0], stress), given, atol=1e-13)
    np.testing.assert_allclose(body_moments(corner[0], stress), 0, atol=1e-13)
    assert jumps(corner[0], stress) < 1e-13


@pytest.mark.parametrize("body", [False, True])
def test_modes_load_the_reference_triangle_as_they_say(body):
    """Each of one corner, of one side or with one moment of the body force."""
    modes = element_stress.reference_modes(body)
    assert modes.shape == (27, 15 if body else 9)
    for mode, values in enumerate(modes.T):
        stress = tensors(values.reshape(3, 3, 3))
        sides, force = np.zeros((3, 2, 2)), np.zeros((3, 2))
        k, c = divmod(mode if mode < 6 else mode - 9, 2)
        if mode < 6:
            sides[k, 0, c], sides[k - 1, 1, c] = 1, -1
        elif mode < 9:
            along = CORNER[(mode - 5) % 3] - CORNER[mode - 6]
            sides[mode - 6] = [along, -along]
        else:
            sides[k, 0, c] = sides[k - 1, 1, c] = -0.5
            force[k, c] = 1
        np.testing.assert_allclose(on_sides(CORNER, stress), sides, atol=1e-12)
        np.testing.assert_allclose(body_moments(CORNER, stress), force, atol=1e-12)
        assert jumps(CORNER, stress) < 1e-12
