"""Nodes on the axis of bodies of revolution."""

import numpy as np

AXIS = 1e-9  # of the largest radius: below it a node is on the axis


def on_axis(radius: np.ndarray) -> np.ndarray:
    """(n,) whether nodes at `radius` (n,) are on the axis."""
    return np.abs(radius) <= AXIS * np.abs(radius).max(initial=0.0)


def smooth_normals(normal: np.ndarray, edges: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(n, 2) unit `normal` of nodes, along the axis where a smooth surface meets it.

    On the axis a node's normal is that of its one edge. On a sphere its neighbour's is turned twice
    as far; on a cone, whose tip keeps the normal of the cone, as far. `edges` (e, 2) and `radius`
    (n,) of the nodes.
    """
    normal, begins = normal.copy(), on_axis(radius)
    for inner, outer in (edges.T, edges.T[::-1]):
        here = begins[inner] & (np.abs(normal[outer, 0]) > 1.5 * np.abs(normal[inner, 0]))
        upright = np.sign(normal[inner[here], 1])
        normal[inner[here]] = np.column_stack([0 * upright, upright])
    return normal
