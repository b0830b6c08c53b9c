"""Recovered stresses: smoother than the computed ones, they estimate its error without bounding it.

Of linear elements they are means over the triangles round each vertex, linear in between. Of
quadratic elements the computed stress is linear on every triangle. Round each vertex, over the
triangles that share it, a quadratic polynomial is fitted to it by least squares at the middles of
the sides; its values at the vertex, and at the middle of a side the mean of those of both ends, are
the nodal values of a continuous quadratic stress, of higher order than the computed one. Patches
with too few triangles, as at boundaries, take their neighbours' in. See Zienkiewicz, Zhu: The
superconvergent patch recovery and a posteriori error estimates, IJNME 33 (1992) 1331-1382.
"""

import numpy as np
from scipy.sparse import csr_matrix

from ..scene import elements

AT_MIDDLES = 0.5 * (1 - np.eye(3))  # barycentric coordinates
AT_NODES = np.vstack([np.eye(3), AT_MIDDLES])
ENDS = np.array([[1, 2], [2, 0], [0, 1]])  # corners of the sides
ENOUGH = 5  # triangles of a patch: fifteen values for six coefficients
RINGS = 4  # of triangles round a patch, at most


class Patches:
    """What recovering stresses of quadratic elements takes of a mesh, for any of its stresses."""

    def __init__(self, corner: np.ndarray, triangles: np.ndarray, region: np.ndarray):
        """Patches end where the `region` (n_t,) changes.

        `corner` (n_t, 3, 2), or (n_t, 6, 2) with the middles of curved sides, `triangles` (n_t, 3)
        untorn.
        """
        middle = corner[:, 3:] if corner.shape[1] == 6 else AT_MIDDLES @ corner
        corner = corner[:, :3]
        _, first, vertex = np.unique(region[:, None] * (triangles.max() + 1) + triangles,
                                     return_index=True, return_inverse=True)
        self._vertex, place = vertex.reshape(-1, 3), corner.reshape(-1, 2)[first]
        patch, self._member = _patches(self._vertex, len(place))
        self._begin = np.searchsorted(patch, np.arange(len(place)))
        center = place[patch][:, None]
        extent = np.linalg.norm(corner[self._member] - center, axis=2).max(axis=1)
        size = np.maximum.reduceat(extent, self._begin)
        basis = _quadratics((middle[self._member] - center) / size[patch][:, None, None])
        self._fitting = basis.transpose(0, 2, 1)
        normal = np.add.reduceat(self._fitting @ basis, self._begin)
        self._inverse = np.linalg.pinv(normal, rcond=1e-10, hermitian=True)
        ends = self._vertex[:, ENDS]  # (n_t, 3 sides, 2)
        self._between = _quadratics((middle[:, :, None] - place[ends]) / size[ends][..., None])

    def smooth(self, stress: np.ndarray) -> np.ndarray:
        """(n_t, 6, 3) nodal values of the recovered one of a `stress` (n_t, 3 corners, 3) that is
        linear on every triangle.
        """
        right = self._fitting @ (AT_MIDDLES @ stress)[self._member]
        fitted = self._inverse @ np.add.reduceat(right, self._begin)
        at_ends = fitted[self._vertex]
        middles = (self._between[:, :, :, None] @ at_ends[:, ENDS])[:, :, :, 0].mean(axis=2)
        return np.concatenate([at_ends[:, :, 0], middles], axis=1)


def vertex_sums(vertex: np.ndarray, area: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """(count, 1 + k) sums over the triangles round each vertex: areas, areas times corner values.

    `vertex` (n_t, 3), `area` (n_t,), `values` (n_t, 3 corners, k). Their ratio is the mean of
    Zienkiewicz and Zhu (1987).
    """
    corner, weight = vertex.ravel(), np.repeat(area, 3)
    columns = [weight, *(weight * value for value in values.reshape(-1, values.shape[-1]).T)]
    return np.column_stack([np.bincount(corner, column, count) for column in columns])


def averaged_stress(triangles: np.ndarray, region: np.ndarray, area: np.ndarray,
                    stress: np.ndarray) -> np.ndarray:
    """(n_t, 3 corners, 3) means of constant stresses (n_t, 3) round each vertex, by region."""
    names, vertex = np.unique(region[:, None] * (triangles.max() + 1) + triangles,
                              return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    sums = vertex_sums(vertex, area, np.repeat(stress[:, None], 3, axis=1), len(names))
    return (sums[:, 1:] / sums[:, :1])[vertex]


def _patches(vertex: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertex and triangle of every patch's members: neighbours, and rings if these are few."""
    n = len(vertex)
    touches = csr_matrix((np.ones(3 * n), (vertex.ravel(), np.repeat(np.arange(n), 3))), (count, n))
    patch = touches
    for _ in range(RINGS):
        few = np.diff(patch.indptr) < ENOUGH
        if not few.any():
            break
        wider = (patch @ touches.T @ touches).tocsr()
        patch = (patch.multiply(~few[:, None]) + wider.multiply(few[:, None])).tocsr()
        patch.eliminate_zeros()
    patch.sort_indices()
    return np.repeat(np.arange(count), np.diff(patch.indptr)), patch.indices


def _quadratics(x: np.ndarray) -> np.ndarray:
    """(..., 6) monomials up to degree two at places (..., 2)."""
    a, b = x[..., 0], x[..., 1]
    return np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=-1)


def work(area: np.ndarray, compliance: np.ndarray, stress: np.ndarray,
         other: np.ndarray) -> np.ndarray:
    """(n_t,) int s : C^-1 r of stresses by values at corners (n_t, 3, 3) or nodes (n_t, 6, 3)."""
    shapes = elements.shapes(stress.shape[1], elements.POINTS)
    mass = (shapes.T * elements.WEIGHTS) @ shapes
    strain = (mass @ other) @ compliance
    return np.einsum("tni,tni->t", stress, strain) * area


def energy(area: np.ndarray, compliance: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """(n_t,) int s : C^-1 s of stresses as in `work`."""
    return work(area, compliance, stress, stress)


def deviation(gather, body, displacements: list[np.ndarray], quadratic: bool,
              weights: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray] | None:
    """What recovered stresses differ by from the computed ones, and the elastic ones, on rank 0.

    By values as in `work`; of displacements (dofs,) of the rank's subdomains of a plane `body`, and
    thermal strain with the pattern factors `weights`, if any. Collective; `gather` is a
    torn_body.Gather.
    """
    if not quadratic:
        thermal = 0.0 if weights is None else gather.thermal(weights, (3,))
        fields = gather.displacements(displacements)
        if not gather.root:
            return None
        elastic = body.stress(fields)
        sigma, mesh = elastic - thermal, body.mesh
        smooth = averaged_stress(mesh.triangles, body.region, mesh.area, sigma)
        return smooth - sigma[:, None], np.repeat(elastic[:, None], 3, axis=1)

    def stress(s, sub):
        u = displacements[s].reshape(-1, 2)[sub.elements]
        strain = elements.linear_strains(sub.corner, u)
        return np.einsum("tmij,tmj->tmi", sub.corner_elasticity, strain)

    thermal = 0.0 if weights is None else gather.thermal(weights, (3, 3))
    elastic = gather((3, 3), float, stress)
    if not gather.root:
        return None
    sigma = elastic - thermal
    return body.patches.smooth(sigma) - AT_NODES @ sigma, elastic
