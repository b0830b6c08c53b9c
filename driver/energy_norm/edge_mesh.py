"""Triangles of the untorn body and their half-edges."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..scene.elements import areas, hat_gradients
from ..vectors import turned_left


@dataclass
class Mesh:
    """Untorn triangles and their half-edges.

    A half-edge is an edge at one of its ends; it is the `first` of the triangle that lies left of
    it, seen from that end, and the `last` of the other one. Number 2 e + k belongs to end k of edge
    e, smaller vertex first.
    """

    corner: np.ndarray  # (n_t, 3, 2) coordinates
    triangles: np.ndarray  # (n_t, 3) vertices, counterclockwise
    edges: np.ndarray  # (n_e, 2) vertices
    first: np.ndarray  # (n_t, 3) half-edge towards the next vertex of the triangle, by vertex
    last: np.ndarray  # (n_t, 3) half-edge towards the one before
    boundary: np.ndarray  # (n_e,) true on edges with one triangle

    @classmethod
    def of(cls, triangles: np.ndarray, corner: np.ndarray) -> "Mesh":
        """Mesh of triangles (n_t, 3) with corners (n_t, 3, 2)."""
        start, end = triangles, np.roll(triangles, -1, axis=1)
        span = triangles.max() + 1
        keys, edge, count = np.unique(np.minimum(start, end) * span + np.maximum(start, end),
                                      return_inverse=True, return_counts=True)
        edge = edge.reshape(-1, 3)
        first = 2 * edge + (start > end)
        last = np.roll(2 * edge + (end > start), 1, axis=1)
        return cls(corner, triangles, np.column_stack(np.divmod(keys, span)), first, last,
                   count == 1)

    @cached_property
    def gradient(self) -> np.ndarray:
        """(n_t, 3, 2) gradients of the hat functions."""
        return hat_gradients(self.corner)

    def find(self, ends: np.ndarray) -> np.ndarray:
        """Numbers of edges given by their vertices (n, 2); they must exist."""
        span = self.edges.max() + 1
        low, high = np.sort(ends, axis=1).T
        keys = self.edges[:, 0] * span + self.edges[:, 1]
        return np.searchsorted(keys, low * span + high)

    @cached_property
    def outward(self) -> np.ndarray:
        """(n_t, 3, 2) outward normals of the sides k to k + 1, as long as these."""
        side = np.roll(self.corner, -1, axis=1) - self.corner
        return -turned_left(side)

    @cached_property
    def length(self) -> np.ndarray:
        """(n_e,) of the edges."""
        length = np.empty(len(self.edges))
        length[self.first // 2] = np.linalg.norm(self.outward, axis=2)
        return length

    @cached_property
    def columns(self) -> np.ndarray:
        """(n_t, 2, 2) Jacobian matrices of the maps from the reference triangle."""
        return np.stack([self.corner[:, 1] - self.corner[:, 0],
                         self.corner[:, 2] - self.corner[:, 0]], axis=2)

    @cached_property
    def area(self) -> np.ndarray:
        """(n_t,)"""
        return areas(self.corner)


def full_tensor(voigt: np.ndarray) -> np.ndarray:
    """(..., 2, 2) tensors of stresses (..., 3): s11, s22, s12."""
    return voigt[..., [[0, 2], [2, 1]]]


def side_moments(mesh: Mesh, stress: np.ndarray) -> np.ndarray:
    """(n_t, 3, 2) moments of constant stresses (n_t, 3) on the sides, alike at both ends."""
    return 0.5 * mesh.outward @ full_tensor(stress)
