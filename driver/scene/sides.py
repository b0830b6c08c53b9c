"""Sides of quadratic elements: parabolas through both ends and the middle, straight or curved.

    x(xi) = sum_i phi_i(xi) x_i,    ends first, then the middle, xi in [0, 1].
"""

import numpy as np

from ..vectors import turned_left

POINT = (1 + np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])) / 2  # Gauss, exact to degree 5
WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0
# (points, 3) shape functions and their derivatives by xi
SHAPE = np.column_stack([(1 - POINT) * (1 - 2 * POINT), POINT * (2 * POINT - 1),
                         4 * POINT * (1 - POINT)])
SLOPE = np.column_stack([4 * POINT - 3, 4 * POINT - 1, 4 - 8 * POINT])


def densities(xy: np.ndarray, revolved: bool = False) -> np.ndarray:
    """(e, points) ds of sides xy (e, 3, 2) at the points of quadrature, with their weights.

    Of bodies of revolution (`revolved`) times 2 pi r.
    """
    length = np.linalg.norm(SLOPE @ xy, axis=2) * WEIGHT
    return length * 2 * np.pi * np.maximum(SHAPE @ xy, 0.0)[..., 0] if revolved else length


def integrals(xy: np.ndarray, revolved: bool = False) -> np.ndarray:
    """(e, 3) integrals of the shape functions over sides as for `densities`."""
    return densities(xy, revolved) @ SHAPE


def normals(xy: np.ndarray) -> np.ndarray:
    """(e, 3, 2) integrals of shape function times outward normal, the body left of the sides."""
    tangent = np.einsum("p,pi,pj,ejc->eic", WEIGHT, SHAPE, SLOPE, xy)
    return -turned_left(tangent)


def are_curved(xy: np.ndarray) -> bool:
    """Whether middles of sides xy (e, 3, 2) are off their chords by more than rounding."""
    rise = np.abs(xy[:, 2] - xy[:, :2].mean(axis=1)).max(axis=1)
    return bool((rise > 1e-10 * np.abs(xy[:, 1] - xy[:, 0]).max(axis=1)).any())
