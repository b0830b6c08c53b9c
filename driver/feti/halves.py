"""Dense symmetric matrices of which one half is kept, or counts."""

from collections.abc import Iterator

import numpy as np
from scipy.linalg import blas, lapack

AT_A_TIME = 256  # rows that are mirrored or taken out: without copies of a large triangle


def mirrored(matrix: np.ndarray) -> np.ndarray:
    """`matrix` (n, n), of which the lower triangle counts, made symmetric in place."""
    for first in range(0, len(matrix), AT_A_TIME):
        here, beyond = slice(first, first + AT_A_TIME), slice(first + AT_A_TIME, None)
        lower = np.tril(matrix[here, here])
        matrix[here, here] = lower + np.tril(lower, -1).T
        matrix[here, beyond] = matrix[beyond, here].T
    return matrix


class Half:
    """A symmetric matrix (n, n) by its lower triangle, row after row: `entries` (n (n + 1) / 2,).

    LAPACK's packed format of the upper one, whose matrices are transposed.
    """

    def __init__(self, matrix: np.ndarray):
        """Of `matrix` (n, n) the lower triangle counts."""
        self._size = len(matrix)
        self.replace(matrix)

    @classmethod
    def of(cls, size: int, entries: np.ndarray) -> "Half":
        """That of `entries` which another one has had."""
        half = cls.__new__(cls)
        half._size, half.entries = size, entries
        return half

    def __len__(self) -> int:
        return self._size

    def replace(self, matrix: np.ndarray) -> None:
        """Be another `matrix` of the same size."""
        self.entries, _ = lapack.dtrttp(matrix.T, uplo="U")

    def lower(self) -> np.ndarray:
        """(n, n) with the lower triangle, a copy; what is above it counts for nothing."""
        upper, _ = lapack.dtpttr(self._size, self.entries, uplo="U")
        return upper.T

    def bands(self) -> Iterator[np.ndarray]:
        """Copies of AT_A_TIME rows after the others, up to where their diagonal ends (k, end).

        What is above the diagonal counts for nothing.
        """
        for first in range(0, len(self), AT_A_TIME):
            end = min(first + AT_A_TIME, len(self))
            band = np.zeros((end - first, end))
            for place, row in enumerate(range(first, end)):
                start = row * (row + 1) // 2
                band[place, : row + 1] = self.entries[start : start + row + 1]
            yield band

    def whole(self) -> np.ndarray:
        """(n, n) all of it, a copy."""
        return mirrored(self.lower())

    def add_product(self, x: np.ndarray, first: int, y: np.ndarray, target: int) -> None:
        """Add its product with the entries of x from `first` on to those of y from `target` on."""
        blas.dspmv(self._size, 1.0, self.entries, x, offx=first, beta=1.0, y=y, offy=target,
                   overwrite_y=1)
