"""Where a point lies in the bodies: triangle, side or vertex of a subdomain."""

from typing import NamedTuple

import numpy as np

from ..scene import elements

ON_SIDE = 1e-9  # of an element's height from which a place is on the side
STEPS = 8  # of Newton's method for a place in a curved triangle, from that in the straight one


class Place(NamedTuple):
    """Where a point lies in the triangle of a subdomain that it is deepest in."""

    depth: float  # smallest of the coordinates
    triangle: int
    at: np.ndarray  # (3,) barycentric coordinates
    subdomain: int


def nearest(sub, xy: np.ndarray) -> tuple[float, int, np.ndarray]:
    """Smallest coordinate, triangle, coordinates (3,) of the triangle that a place is deepest in.

    Coordinates are barycentric.
    """
    corner = sub.xy[sub.triangles]
    edge = corner[:, [2, 0, 1]] - corner[:, [1, 2, 0]]  # opposite to each vertex
    parts = elements.cross(edge, xy - corner[:, [1, 2, 0]])
    parts = parts / parts.sum(axis=1, keepdims=True)
    if sub.curved:
        parts = _on_curved(sub.corner, xy, parts)
    triangle = int(np.argmax(parts.min(axis=1)))
    return float(parts[triangle].min()), triangle, parts[triangle]


def on_side(sub, place: Place, joined: list[int]) -> tuple[frozenset[int], bool]:
    """Gids of the vertices of the side, or the vertex, that a place lies on, if on any; and whether
    it is on boundaries that are `joined`.
    """
    nodes = sub.triangles[place.triangle][place.at > ON_SIDE]
    tied = sub.edges[np.isin(sub.edge_label, joined)]
    return frozenset(sub.node_gid[nodes].tolist()), bool(np.isin(nodes, tied).all())


def _on_curved(corner: np.ndarray, xy: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(n_t, 3) coordinates of a place in triangles with curved sides, by Newton's method.

    `start` (n_t, 3) are those in the straight triangles; where these are far away they stay.
    """
    near = np.flatnonzero(start.min(axis=1) > -1.0)
    parts, found = start.copy(), start[near]
    for _ in range(STEPS):
        place, tangent = elements.located(corner[near], found)
        step = np.linalg.solve(tangent.transpose(0, 2, 1), (xy - place)[..., None])[..., 0]
        found = found + np.column_stack([-step.sum(axis=1), step])
    parts[near] = found
    return parts
