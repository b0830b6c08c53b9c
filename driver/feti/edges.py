"""Edges of triangles: those of one triangle only, and their labels."""

import numpy as np


def split_edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges (n, 2) of one triangle only, smaller vertex first, and that triangle (n,).

    Last (k, 2) the triangles that inner edges connect.
    """
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    span = edges.max() + 1
    key = edges[:, 0] * span + edges[:, 1]
    order = np.argsort(key, kind="stable")
    key, triangle = key[order], order // 3
    same = key[1:] == key[:-1]  # as the next one
    alone = ~(np.append(same, False) | np.append(False, same))
    outer = np.column_stack(np.divmod(key[alone], span))
    return outer, triangle[alone], np.column_stack([triangle[:-1][same], triangle[1:][same]])


def outward_edges(triangles: np.ndarray) -> np.ndarray:
    """(n, 2) edges of one triangle only, counterclockwise: the body lies on their left."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    span = edges.max() + 1
    _, inverse, counts = np.unique(
        edges.min(axis=1) * span + edges.max(axis=1), return_inverse=True, return_counts=True)
    return edges[counts[inverse] == 1]


def edge_labels(labelled: np.ndarray, labels: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Labels of edges (n, 2), smaller vertex first, by those of `labelled` (m, 2), else 0."""
    span = 1 + max(labelled.max(initial=0), edges.max(initial=0))
    given = np.sort(labelled, axis=1)
    keys, wanted = given[:, 0] * span + given[:, 1], edges[:, 0] * span + edges[:, 1]
    order = np.argsort(keys)
    place = np.minimum(np.searchsorted(keys[order], wanted), len(order) - 1)
    if not len(order):
        return np.zeros(len(edges), np.int64)
    return np.where(keys[order[place]] == wanted, labels[order[place]], 0)
