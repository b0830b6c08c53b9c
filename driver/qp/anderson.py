"""Anderson acceleration of fixed-point iterations."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

DEPTH = 4  # differences that are combined
DAMPING = 0.5  # part of the map's own change that is taken
PATIENCE = 8  # iterations without a change below half the best one
LIMIT = 40  # iterations at most


class Anderson:
    """Anderson acceleration of a fixed-point map g -> map(g) (J. ACM 12 (1965) 547-560).

    `dot` is the global scalar product of two rank's parts; `depth` differences are combined, those
    within `noise` of the others or of the latest change left out, and the part `damping` of the
    map's own change is taken.
    """

    def __init__(self, dot: Callable[[np.ndarray, np.ndarray], float], depth: int = DEPTH,
                 damping: float = DAMPING, noise: float = 1e-6):
        self.dot, self.depth, self.damping, self.noise = dot, depth, damping, noise
        self.points, self.changes = [], []

    def next(self, g: np.ndarray, mapped: np.ndarray) -> np.ndarray:
        """The next point from the latest pair g, map(g)."""
        self.points.append(g)
        self.changes.append(mapped - g)
        del self.points[: -self.depth - 1], self.changes[: -self.depth - 1]
        new = g + self.damping * self.changes[-1]
        both = zip(pairwise(self.points), pairwise(self.changes))
        moves = [(b - a, d - c) for (a, b), (c, d) in both]
        if moves:
            gram = np.array([[self.dot(f, h) for _, h in moves] for _, f in moves])
            right = np.array([self.dot(f, self.changes[-1]) for _, f in moves])
            share = self._shares(gram, right)
            new = new - sum(s * (p + self.damping * f) for s, (p, f) in zip(share, moves))
        return new

    def _shares(self, gram: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Of the differences in the latest change: least squares without those that say nothing."""
        size, basis = np.linalg.eigh(gram)
        largest = max(size[-1], self.dot(self.changes[-1], self.changes[-1]))
        kept = size > self.noise**2 * largest
        return basis[:, kept] @ ((basis[:, kept].T @ right) / size[kept])


def gives_up(changes: list[float]) -> bool:
    """Whether `changes` of an accelerated iteration show no headway, or are too many."""
    halved = [k for k in range(len(changes)) if changes[k] < 0.5 * min(changes[:k], default=np.inf)]
    last = halved[-1] if halved else int(np.argmin(changes))
    return len(changes) >= LIMIT or len(changes) - 1 - last >= PATIENCE
