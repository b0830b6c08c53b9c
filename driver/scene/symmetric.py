"""The stiffness of a subdomain: a symmetric sparse matrix, of which half is kept.

FreeFEM assembles, sorts and writes half of a symmetric matrix in less than half the time, and half
of it is all that products and factors need. Elements whose matrix is a product give it whole: then
both halves are compared (record_checks.py), and one is dropped.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix


@dataclass(eq=False)
class Symmetric:
    """A symmetric matrix (n, n) with the same entries above the diagonal as below it.

    Those below it stand row after row: `row_start` (n + 1,) and `columns` (entries,) say where.
    `values` (entries + n,) are theirs, then those of the diagonal.
    """

    row_start: np.ndarray
    columns: np.ndarray
    values: np.ndarray

    @classmethod
    def of_lower(cls, rows: np.ndarray, columns: np.ndarray, values: np.ndarray,
                 size: int) -> "Symmetric":
        """By entries of the lower triangle, in the order of rows; what is above it is left out."""
        below, at = np.flatnonzero(columns < rows), np.flatnonzero(columns == rows)
        diagonal = np.zeros(size)
        diagonal[rows[at]] = values[at]
        start = np.zeros(size + 1, np.int32)
        np.cumsum(np.bincount(rows[below], minlength=size), out=start[1:])
        return cls(start, columns[below], np.concatenate([values[below], diagonal]))

    def replaced(self, values: np.ndarray) -> "Symmetric":
        """The matrix with other `values` in the same places."""
        return Symmetric(self.row_start, self.columns, values)

    def plus(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> "Symmetric":
        """The sum with entries of the lower triangle of another symmetric matrix."""
        own = self.below.tocoo()
        at = np.arange(self.shape[0])
        rows, columns, values = map(np.concatenate, zip(
            (own.row, own.col, own.data), (at, at, self.diagonal()), (rows, columns, values)))
        total = coo_matrix((values, (rows, columns)), self.shape).tocsr().tocoo()
        return Symmetric.of_lower(total.row, total.col, total.data, self.shape[0])

    @property
    def shape(self) -> tuple[int, int]:
        """(n, n)."""
        return (len(self.row_start) - 1,) * 2

    @cached_property
    def below(self) -> csr_matrix:
        """(n, n) what is below the diagonal; it shares the arrays."""
        entries = self.values[: len(self.columns)]
        return csr_matrix((entries, self.columns, self.row_start), self.shape)

    @cached_property
    def above(self) -> csc_matrix:
        """(n, n) what is above the diagonal; it shares the arrays."""
        return self.below.T

    def diagonal(self) -> np.ndarray:
        """(n,) the diagonal."""
        return self.values[len(self.columns) :]

    def entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns and values (2 entries + n,) of both triangles, made anew, in no order."""
        row, at = self.below.tocoo().row, np.arange(self.shape[0], dtype=np.int32)
        below = self.values[: len(self.columns)]
        return (np.concatenate([row, self.columns, at]), np.concatenate([self.columns, row, at]),
                np.concatenate([below, below, self.diagonal()]))

    def toarray(self) -> np.ndarray:
        """(n, n) dense."""
        below = self.below.toarray()
        return below + below.T + np.diag(self.diagonal())

    def between(self, some: np.ndarray, others: np.ndarray) -> csr_matrix:
        """(n_s, n_o) the entries that couple `some` dofs with `others`, which are none of them."""
        return self.below[some][:, others] + self.below[others][:, some].T.tocsr()

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        """Times x (n,) or (n, k)."""
        diagonal = self.diagonal() if x.ndim == 1 else self.diagonal()[:, None]
        return self.below @ x + self.above @ x + diagonal * x
