"""Sides of elements: of quadratic ones parabolas through both ends and the middle.

    x(xi) = sum_i phi_i(xi) x_i,    ends first, then the middle, xi in [0, 1].
"""

import numpy as np

from .elements import cross

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
    return np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)


def are_curved(xy: np.ndarray) -> bool:
    """Whether middles of sides xy (e, 3, 2) are off their chords by more than rounding."""
    rise = np.abs(xy[:, 2] - xy[:, :2].mean(axis=1)).max(axis=1)
    return bool((rise > 1e-10 * np.abs(xy[:, 1] - xy[:, 0]).max(axis=1)).any())


def rises(xy: np.ndarray) -> dict[str, np.ndarray]:
    """`chord` and `rise` (e, 2) of a mortar.Side with sides xy (e, 3, 2), {} if straight."""
    if not are_curved(xy):
        return {}
    return {"chord": xy[:, 1] - xy[:, 0], "rise": xy[:, 2] - xy[:, :2].mean(axis=1)}


def speed(chord: np.ndarray, rise: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """(m,) ds/dxi at xi (m,) of sides with chords and rises (m, 2) of their middles."""
    return np.linalg.norm(chord + 4 * (1 - 2 * xi)[:, None] * rise, axis=1)


def uniform(xy: np.ndarray, nodes: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 2) int phi_i n ds and (count,) int phi_i ds of sides xy (e, 3, 2), `nodes` (e, 3)."""
    force, length = np.zeros((count, 2)), np.zeros(count)
    np.add.at(force, nodes, normals(xy))
    np.add.at(length, nodes, integrals(xy))
    return force, length


def shapes(nodes: int, xi: np.ndarray) -> tuple[np.ndarray, ...]:
    """Shape functions of a side with 2 or 3 nodes at the places xi (m,), each (m,)."""
    if nodes == 2:
        return 1.0 - xi, xi
    return (1.0 - xi) * (1.0 - 2.0 * xi), xi * (2.0 * xi - 1.0), 4.0 * xi * (1.0 - xi)


def sagitta(xy: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(e,) distance of the middles of edges (e, 2) from the smooth curve through the vertices.

    Positive where the middles are inside, with the body on the left of the edges. The curvature
    of an edge is that of the circles through its ends and their neighbours, the smaller one;
    none where they bend to different sides, so that corners stay corners.
    """
    along = xy[edges[:, 1]] - xy[edges[:, 0]]
    length = np.linalg.norm(along, axis=1)
    before, after = np.full(len(xy), -1), np.full(len(xy), -1)
    before[edges[:, 1]], after[edges[:, 0]] = np.arange(len(edges)), np.arange(len(edges))
    inner = (before >= 0) & (after >= 0)
    arriving, leaving = along[before], along[after]
    turning = np.arctan2(cross(arriving, leaving), (arriving * leaving).sum(axis=1))
    curvature = np.where(inner, 2 * turning / (length[before] + length[after]), np.nan)
    ends = curvature[edges]
    # at the end of the side the circle of the other end
    ends = np.where(np.isnan(ends), ends[:, ::-1], ends)
    least = np.where(ends.prod(axis=1) > 0, np.sign(ends[:, 0]) * np.abs(ends).min(axis=1), 0.0)
    return least * length**2 / 8
