"""The point of a polyhedron that is nearest to the origin.

    min |y|   subject to   A y <= b

by its dual, a nonnegative least squares problem (C. Lawson, R. Hanson, Solving Least Squares
Problems, SIAM 1995, chapter 23): with u >= 0 that minimises |E u - f|, E = [-A'; -b'], f = (0, ..,
0, 1), and its residual r = E u - f the answer is y_j = -r_j / r_(n+1); r = 0 where nothing is
feasible.
"""

import numpy as np


def least_distance(A: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """y (n,) for A (m, n) and b (m,); None where no y is feasible."""
    if np.all(b >= 0):
        return np.zeros(A.shape[1])
    from scipy.optimize import nnls  # slow to import, and few problems come here

    size = np.linalg.norm(A, axis=1)
    size[size == 0] = 1.0
    A, b = A / size[:, None], b / size
    far = np.abs(b).max()
    f = np.append(np.zeros(A.shape[1]), 1.0)
    u, distance = nnls(-np.vstack([A.T, b / far]), f)
    if distance <= 1e-9:
        return None
    residual = -np.append(A.T @ u, b @ u / far) - f
    return -far * residual[:-1] / residual[-1]
