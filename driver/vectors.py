"""Vectors in the plane."""

import numpy as np


def turned_left(vectors: np.ndarray) -> np.ndarray:
    """(..., 2) vectors turned by +90 degrees: of outward normals the tangents of contact.csv."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def unit(vectors: np.ndarray) -> np.ndarray:
    """(n, 2) vectors divided by their lengths."""
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]
