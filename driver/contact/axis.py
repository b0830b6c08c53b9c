"""Nodes on the axis of bodies of revolution."""

import numpy as np

AXIS = 1e-9  # of the largest radius: below it a node is on the axis


def on_axis(radius: np.ndarray) -> np.ndarray:
    """(n,) whether nodes at `radius` (n,) are on the axis."""
    return np.abs(radius) <= AXIS * np.abs(radius).max(initial=0.0)


def along_axis(normal: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(n, 2) normals (of any length) at `radius` (n,), on the axis without a radial part."""
    return np.where(on_axis(radius)[:, None], normal * [0.0, 1.0], normal)
