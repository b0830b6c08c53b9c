"""Lagrange triangles: nodes, shape functions and what follows at places inside a triangle.

Places are barycentric coordinates l = (l_0, l_1, l_2). Nodes are the vertices, then, with quadratic
elements, the middles of the sides opposite to them, then, with the bubble of P2-mixed, the
centroid c:

    phi_i = l_i (2 l_i - 1),    phi_3+i = 4 l_j l_k    (i, j, k different),

less phi(c) phi_6 with phi_6 = 27 l_0 l_1 l_2.

Triangles are given by their vertices, `corner` (n_t, 3, 2), or, where sides are curved, by vertices
and middles (n_t, 6, 2), whose quadratic shape functions make the places (isoparametric). Strains
of these are rational functions.
"""

import numpy as np

from ..vectors import turned_left

CENTER = np.full((1, 3), 1 / 3)
NODE_PLACES = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1],
                        [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])  # of quadratic triangles
AT_CENTER = np.array([-1.0, -1, -1, 4, 4, 4]) / 9  # quadratic shape functions at the centroid
INVERSE_MASS = 12 * (np.eye(3) - 0.25)  # of the hat functions on triangles of area 1
TO_VTK = [0, 1, 2, 5, 3, 4]  # VTK goes round the sides from vertex 0
# of degree 4 on triangles of area 1 (Strang, Fix: An Analysis of the Finite Element Method, 1973,
# table 4.1)
_A, _B = 0.445948490915965, 0.091576213509771
POINTS = np.array([np.roll([1 - 2 * a, a, a], k) for a in (_A, _B) for k in range(3)])
WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...) cross products of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def areas(corner: np.ndarray) -> np.ndarray:
    """(n_t,) areas of triangles, negative if their corners run clockwise."""
    if corner.shape[1] == 6:
        return 0.5 * jacobians(corner, POINTS) @ WEIGHTS
    return 0.5 * cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])


def shapes(nodes: int, places: np.ndarray) -> np.ndarray:
    """(m, nodes) shape functions at places (m, 3)."""
    if nodes == 3:
        return places
    quadratic = np.column_stack([places * (2 * places - 1),
                                 4 * places[:, [1, 2, 0]] * places[:, [2, 0, 1]]])
    if nodes == 6:
        return quadratic
    bubble = 27 * places.prod(axis=1)[:, None]
    return np.column_stack([quadratic - AT_CENTER * bubble, bubble])


def slopes(nodes: int, places: np.ndarray) -> np.ndarray:
    """(m, nodes, 3) derivatives of the shape functions by l_0, l_1, l_2 at places (m, 3)."""
    if nodes == 3:
        return np.broadcast_to(np.eye(3), (len(places), 3, 3))
    quadratic = np.zeros((len(places), 6, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        quadratic[:, i, i] = 4 * places[:, i] - 1
        quadratic[:, 3 + i, j], quadratic[:, 3 + i, k] = 4 * places[:, k], 4 * places[:, j]
    if nodes == 6:
        return quadratic
    bubble = 27 * (places[:, [1, 2, 0]] * places[:, [2, 0, 1]])[:, None]
    return np.concatenate([quadratic - AT_CENTER[:, None] * bubble, bubble], axis=1)


def mean_strains(corner: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(n_t, 3) means over the triangles of the strains as in `strains`.

    A bubble has none on straight triangles.
    """
    if corner.shape[1] == 6:
        share = jacobians(corner, POINTS) * WEIGHTS
        return (share[:, None] @ strains(corner, value, POINTS))[:, 0] / share.sum(axis=1)[:, None]
    return strains(corner, value[:, :6], CENTER)[:, 0]


def linear_strains(corner: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(n_t, 3 corners, 3) strains as in `strains`, in L2 projected to linear functions.

    Of quadratic displacements these are the strains; with a bubble they are what the stress of
    P2-mixed has for its pressure.
    """
    if corner.shape[1] == 6:
        return projected(jacobians(corner, POINTS), strains(corner, value, POINTS))
    return (INVERSE_MASS @ (POINTS.T * WEIGHTS)) @ strains(corner, value, POINTS)


def projected(density: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n_t, 3 corners, k) linear functions next to `values` (n_t, POINTS, k) in L2.

    `density` (n_t, POINTS) weighs the places.
    """
    weight = WEIGHTS * density
    right = POINTS.T @ (weight[..., None] * values)
    products = POINTS[:, :, None] * POINTS[:, None]
    mass = (weight @ products.reshape(len(POINTS), 9)).reshape(-1, 3, 3)
    return np.linalg.solve(mass, right)


def radii(corner: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n_t, m) x at the places (m, 3) in triangles."""
    return corner[..., 0] @ shapes(corner.shape[1], places).T


def located(corner: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n_t, 2) coordinates of a place (n_t, 3) of each curved triangle, and derivatives there.

    These as `_tangents` has them, (n_t, 2, 2).
    """
    at = np.einsum("tn,tnk->tk", shapes(6, place), corner)
    by_place = np.einsum("tnc,tnk->tck", slopes(6, place), corner)
    return at, by_place[:, 1:] - by_place[:, :1]


def _tangents(corner: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n_t, m, 2, 2) derivatives [c, k] of coordinate k by l_1 and l_2, with l_0 = 1 - l_1 - l_2.
    """
    by_place = _by_places(corner, places)
    return by_place[:, :, 1:] - by_place[:, :, :1]


def _by_places(value: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n_t, m, 3, 2) derivatives by the three coordinates of the places (m, 3) of a function with
    `value` (n_t, nodes, 2) at the nodes.
    """
    count, nodes, _ = value.shape
    slope = slopes(nodes, places).transpose(0, 2, 1).reshape(-1, nodes)
    # one product of matrices for all triangles: as one for each it takes four times as long
    product = slope @ value.transpose(1, 0, 2).reshape(nodes, 2 * count)
    return product.reshape(len(places), 3, count, 2).transpose(2, 0, 1, 3)


def jacobians(corner: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n_t, m) twice the area that triangles have per area of their places (m, 3)."""
    tangent = _tangents(corner, places)
    return cross(tangent[:, :, 0], tangent[:, :, 1])


def hat_gradients(corner: np.ndarray) -> np.ndarray:
    """(n_t, 3, 2) gradients of the hat functions; corners (n_t, 3, 2) run counterclockwise."""
    edge = corner[:, [2, 0, 1]] - corner[:, [1, 2, 0]]  # edge opposite to each vertex
    double_area = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    return turned_left(edge) / double_area[:, None, None]


def linear_gradients(corner: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(n_t, 2, 2) d[j, k] = d u_k / d x_j of linear displacements.

    `value` (n_t, 3, 2) at the corners (n_t, 3, 2).
    """
    # components first: long rows instead of many short ones
    (x1, y1), (x2, y2) = _sides(corner)
    by = 1.0 / (x1 * y2 - y1 * x2)
    result = np.empty((len(corner), 2, 2))
    for k, (u, v) in enumerate(np.swapaxes(_sides(value), 0, 1)):
        result[:, 0, k] = (y2 * u - y1 * v) * by
        result[:, 1, k] = (x1 * v - x2 * u) * by
    return result


def _sides(values: np.ndarray) -> np.ndarray:
    """(2, 2, n_t) [s, k] differences of component k from corner 0 to 1 and to 2; (n_t, 3, 2)."""
    of_corner = np.ascontiguousarray(values.transpose(1, 2, 0))
    return of_corner[1:] - of_corner[0]


def strains(corner: np.ndarray, value: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n_t, m, 3) strains e11, e22, 2 e12 at places (m, 3).

    `value` (n_t, nodes, 2) displacements of the nodes.
    """
    nodes = value.shape[1]
    if corner.shape[1] == 6:
        moved = _by_places(value, places)
        return _strains(_solved(_tangents(corner, places), moved[:, :, 1:] - moved[:, :, :1]))
    if nodes == 3:  # the same everywhere
        constant = _strains(linear_gradients(corner, value))[:, None]
        return np.broadcast_to(constant, (len(corner), len(places), 3))
    at_corners = _by_places(value, places)
    # d[t, m, j, k] = d u_k / d x_j
    return _strains(np.einsum("tcj,tmck->tmjk", hat_gradients(corner), at_corners))


def shape_gradients(corner: np.ndarray, nodes: int, places: np.ndarray) -> np.ndarray:
    """(n_t, m, nodes, 2) gradients of the shape functions at places (m, 3)."""
    slope = slopes(nodes, places).transpose(0, 2, 1)  # (m, 3, nodes)
    by_place = np.broadcast_to(slope, (len(corner), *slope.shape))
    if corner.shape[1] == 3:
        gradient = np.einsum("tcj,tmci->tmji", hat_gradients(corner), by_place)
    else:
        moved = by_place[:, :, 1:] - by_place[:, :, :1]
        gradient = _solved(_tangents(corner, places), moved)
    return gradient.transpose(0, 1, 3, 2)


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (..., 2, n) of systems of two equations each, `matrix` (..., 2, 2)."""
    (a, b), (c, d) = np.moveaxis(matrix, (-2, -1), (0, 1))
    first, second = right[..., 0, :], right[..., 1, :]
    rows = np.stack([d[..., None] * first - b[..., None] * second,
                     a[..., None] * second - c[..., None] * first], axis=-2)
    return rows / (a * d - b * c)[..., None, None]


def _strains(d: np.ndarray) -> np.ndarray:
    """(..., 3) strains e11, e22, 2 e12 from d (..., 2, 2), d[j, k] = d u_k / d x_j."""
    return np.stack([d[..., 0, 0], d[..., 1, 1], d[..., 1, 0] + d[..., 0, 1]], axis=-1)


def hoop_strains(corner: np.ndarray, value: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n_t, m) hoop strains u_x / x at places (m, 3) inside of triangles; arrays as `strains`."""
    return value[..., 0] @ shapes(value.shape[1], places).T / radii(corner, places)
