"""One dense front: what it is made of added up, its pivots eliminated, and solved with.

Of symmetric matrices the lower triangle counts. Pivots are positive or negative definite, and
need no others (see fronts.py).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import blas, lapack, solve_triangular

from ..errors import NotConverged
from .halves import Half

AT_ONCE = 1024  # pivots: without copies of a large front
A_BLOCK = 200  # entries that are added one by one in the time that a block takes however small


@dataclass
class Factor:
    """That of some pivots of one sign of a front: the lower triangle of L (m, m), row after row,
    and L^-1 times what comes after them (m, r).
    """

    sign: float
    pivots: np.ndarray
    rest: np.ndarray

    def __len__(self) -> int:
        return len(self.rest)

    def solved(self, right: np.ndarray, transposed: bool) -> np.ndarray:
        """L^-1 times a `right` side (m,), or L^-T."""
        return blas.dtpsv(len(self), self.pivots, right, lower=0, trans=int(not transposed))


@dataclass
class Factors:
    """The factors of a front: those of its gluing rows, then of its corners, AT_ONCE or fewer each.

    `index` (n,) are the places of its unknowns, ascending, its `count` pivots first, less those of
    contact rows, which are known where it is used. `children` are the positions in it of what its
    children leave, by their numbers.
    """

    index: np.ndarray
    count: int
    children: dict[int, np.ndarray]
    parts: list[Factor] = field(default_factory=list)

    @property
    def own(self) -> np.ndarray:
        """(count,) places of the pivots."""
        return self.index[: self.count]

    def condense(self, values: np.ndarray) -> None:
        """Forward substitution of a right side (n,), in place: at its end what is left of it."""
        for part in self.parts:
            m = len(part)
            values[:m] = part.solved(values[:m], transposed=False)
            values[m:] -= part.sign * (values[:m] @ part.rest)
            values = values[m:]

    def expand(self, values: np.ndarray) -> None:
        """Backward substitution (n,), in place, where its end is the solution there."""
        stop = self.count
        for part in reversed(self.parts):
            start = stop - len(part)
            own = part.sign * (values[start:stop] - part.rest @ values[stop:])
            values[start:stop] = part.solved(own, transposed=True)
            stop = start


def assembled(parts: list[tuple], count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ascending index (n,) and lower triangle of the sum of matrices with indices of their own.

    Of this the first `count` columns (n, count), and apart from them what is beside them, which
    stays when they are used up. `parts` are pairs of index and matrix, half of it or what makes it;
    they are taken out one by one.
    """
    if len(parts) == 1:
        index, matrix = _taken(parts)
        matrix = matrix.lower() if isinstance(matrix, Half) else matrix
        return index, matrix[:, :count], np.ascontiguousarray(matrix[count:, count:])
    index = np.unique(np.concatenate([np.empty(0, int), *(part for part, _ in parts)]))
    columns, rest = np.zeros((len(index), count)), np.zeros([len(index) - count] * 2)
    while parts:
        part, matrix = _taken(parts)
        _add(columns, rest, np.searchsorted(index, part), matrix)
        del matrix  # before the next one is made
    return index, columns, rest


def _taken(parts: list[tuple]) -> tuple[np.ndarray, np.ndarray | Half]:
    """Index and matrix, or half of it, of the last of `parts`, which has it no more."""
    index, matrix = parts.pop()
    return index, matrix() if callable(matrix) else matrix


def _add(columns: np.ndarray, rest: np.ndarray, place: np.ndarray, matrix: np.ndarray | Half
         ) -> None:
    """Add the lower triangle of `matrix` (m, m) to rows and columns `place` (m,) of another one.

    It has the first `columns` (n, k) and beside them the `rest` (n - k, n - k).
    """
    for band in matrix.bands() if isinstance(matrix, Half) else [matrix]:
        _add_band(columns, rest, place[: band.shape[1]], band)


def _add_band(columns: np.ndarray, rest: np.ndarray, place: np.ndarray, band: np.ndarray) -> None:
    """Add the last rows `band` (k, m) of a lower triangle whose places are `place` (m,).

    Unknowns of a group lie beside one another, so that blocks are added, and few of them.
    """
    if not len(place):  # of a body without contact: the last of its fronts leaves nothing
        return
    count, first = columns.shape[1], len(place) - len(band)
    inner = int(np.searchsorted(place, count))
    ends = np.flatnonzero(np.diff(place) > 1) + 1
    if A_BLOCK * len(ends) * np.sum(ends > first) > band.size:
        columns[np.ix_(place[first:], place[:inner])] += band[:, :inner]
        start = max(first, inner)  # rows before are those of pivots
        rest[np.ix_(place[start:] - count, place[inner:] - count)] += band[start - first :, inner:]
        return
    ends = np.unique([*ends, *(end for end in (inner, first) if 0 < end < len(place))]).astype(int)
    blocks = [(slice(i, j), slice(p, p + j - i)) for i, j, p in
              zip([0, *ends], [*ends, len(place)], place[[0, *ends]])]
    for k, (own, to) in enumerate(blocks):
        if own.start < first:
            continue
        rows = _from(own, first)
        for across, beside in blocks[: k + 1]:
            if beside.start < count:
                columns[to, beside] += band[rows, across]
            else:
                rest[_from(to, count), _from(beside, count)] += band[rows, across]


def _from(places: slice, count: int) -> slice:
    """`places`, counted from the place `count` on."""
    return slice(places.start - count, places.stop - count)


def _at_once(pivots: np.ndarray) -> Iterator[tuple[float, int, int]]:
    """Signs, first places and ends of parts of the `pivots` (2,), positive and negative ones."""
    end = 0
    for count, sign in zip(pivots, (1.0, -1.0)):
        first, end = end, end + count
        for start in range(first, end, AT_ONCE):
            yield sign, start, min(start + AT_ONCE, end)


def eliminated(columns: np.ndarray, rest: np.ndarray,
               pivots: np.ndarray) -> tuple[list[Factor], np.ndarray]:
    """The factors of the first `pivots` (2,) unknowns, positive and negative definite ones, and
    what their elimination leaves of the others (r, r).

    `columns` (n, n - r) are those of the pivots and `rest` (r, r) is what is beside them; both are
    used up. Of the matrix that they make, and of what is left, the lower triangle counts. Raises
    NotConverged.
    """
    parts, (size, count), left = [], columns.shape, rest
    for sign, first, end in _at_once(pivots):
        # L' by the transposed, whose memory LAPACK takes for the factor
        upper, failed = lapack.dpotrf((sign * columns[first:end, first:end]).T, overwrite_a=1)
        if failed or not np.isfinite(upper.diagonal()).all():
            raise NotConverged("the contact compliance: gluing conditions could not be eliminated")
        below = solve_triangular(upper, columns[end:, first:end].T, trans="T", check_finite=False
                                 ) if end < size else np.zeros((end - first, 0))
        columns[end:, end:] -= sign * (below.T @ below[:, : count - end])  # pivots to come
        parts.append(Factor(sign, Half(upper.T).entries, below))
    for part in parts:
        if left.size:
            # its lower triangle is the upper one of the transpose, which BLAS takes as it is
            left = blas.dsyrk(-part.sign, part.rest[:, -len(left) :], beta=1.0, c=left.T, trans=1,
                              lower=0, overwrite_c=1).T
    return parts, left
