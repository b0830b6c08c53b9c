"""The stiffness of a record, given by its lower triangle, with both triangles.

FreeFEM assembles, sorts and writes half of a symmetric matrix in less than half the time. Elements
whose matrix is a product give it whole: then both halves are compared (record_checks.py).
"""

import numpy as np


class Mirror:
    """What makes both triangles, sorted by rows, of the sorted entries of the lower one."""

    def __init__(self, rows: np.ndarray, columns: np.ndarray, dofs: int):
        """`rows` and `columns` (entries,) of the lower triangle of a matrix (dofs, dofs)."""
        self.given = rows, columns
        lower = np.bincount(rows, minlength=dofs)
        above = np.flatnonzero(rows != columns)
        # short integers are sorted without comparisons
        keys = columns[above].astype(np.uint16) if dofs <= 1 << 16 else columns[above]
        above = above[np.argsort(keys, kind="stable")]
        upper = np.bincount(columns[above], minlength=dofs)
        # a row holds the entries of the lower triangle, then those of the upper one
        before = np.cumsum(upper) - upper
        place = np.arange(len(rows)) + before[rows]
        mirrored = np.arange(len(above)) + np.cumsum(lower)[columns[above]]
        self.source = np.empty(len(rows) + len(above), np.int32)
        self.source[place], self.source[mirrored] = np.arange(len(rows)), above
        self.rows = np.repeat(np.arange(dofs, dtype=np.int32), lower + upper)
        self.columns = columns[self.source]
        self.columns[mirrored] = rows[above]

    def whole(self, values: np.ndarray) -> np.ndarray:
        """All entries of a matrix whose lower triangle has the entries `values`."""
        return values[self.source]


class Mirrors:
    """Both triangles of one matrix after the other; what is equal is kept once.

    Arrays that are those of the matrix before, the same objects, have results that are.
    """

    def __init__(self):
        self.mirror, self.last = None, (None, None)

    def whole(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray,
              dofs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns and values of both triangles: as they are where both are given."""
        if (columns > rows).any():
            return rows, columns, values
        given = self.mirror.given if self.mirror else (None, None)
        if rows is not given[0] or columns is not given[1]:
            self.mirror, self.last = Mirror(rows, columns, dofs), (None, None)
        if values is not self.last[0]:
            self.last = values, self.mirror.whole(values)
        return self.mirror.rows, self.mirror.columns, self.last[1]
