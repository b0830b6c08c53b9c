"""Complementary pivots: a solution of a linear complementarity problem by Lemke's method."""

import numpy as np
from scipy.linalg import blas

TIE = 1e-13  # relative difference of ratios that is rounding
GONE = 1e-10  # part of the load by which the artificial variable of Lemke's method is rounding


def solution(M: np.ndarray, q: np.ndarray, cover: np.ndarray) -> np.ndarray | None:
    """z >= 0 with w = M z + q >= 0, w'z = 0, by Lemke's method; None on a ray.

    (R. Cottle, J.-S. Pang, R. Stone, The Linear Complementarity Problem, 4.4 and 4.9.)

    `cover` > 0 is the covering vector. The tableau holds w or z of every row in terms of the
    nonbasic ones: columns 0..k-1 and the artificial one k. Pivots are lexicographic: of the rows
    with the least ratio the one is taken that q + (e, e^2, ..), for all small e > 0, singles out.

    Where the artificial variable and another one become zero at once, rounding may let the other
    one leave: then it stays as a zero, and what would be a ray begins in a solution.
    """
    k = len(q)
    if q.min(initial=0.0) >= 0:
        return np.zeros(k)
    table = np.column_stack([-M, -cover, q])
    basic, nonbasic = np.arange(k), np.arange(k, 2 * k + 1)  # w_i: i, z_i: k + i, artificial: 2 k
    ratio = q / cover
    row, column = int(np.flatnonzero(ratio <= ratio.min() + TIE)[-1]), k
    for _ in range(50 * k):
        _pivot(table, row, column)
        leaving = basic[row]
        basic[row], nonbasic[column] = nonbasic[column], leaving
        if leaving == 2 * k:
            return _multipliers_of(table, basic)
        partner = leaving + k if leaving < k else leaving - k
        column = int(np.flatnonzero(nonbasic == partner)[0])
        entry = table[:, column]
        able = np.flatnonzero(entry > 1e-11 * np.abs(entry).max())
        if not len(able):
            gone = table[basic == 2 * k, -1].item() <= GONE  # q is of order one
            return _multipliers_of(table, basic) if gone else None
        ties = _least_of(able, table[able, -1] / entry[able])
        artificial = ties[basic[ties] == 2 * k]
        row = int(artificial[0] if len(artificial) else
                  _lexicographic(table, basic, nonbasic, ties, entry))
    return None


def _multipliers_of(table: np.ndarray, basic: np.ndarray) -> np.ndarray:
    """z (k,) of a tableau (k, k + 2) with the variables `basic` (k,): w, z, the artificial one."""
    k = len(basic)
    values = np.zeros(2 * k + 1)
    values[basic] = table[:, -1]
    return np.maximum(values[k : 2 * k], 0.0)


def _least_of(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Those of `rows` with the least of the `values`, to rounding."""
    return rows[values <= values.min() + TIE * max(1.0, abs(values.min()))]


def _lexicographic(table: np.ndarray, basic: np.ndarray, nonbasic: np.ndarray, ties: np.ndarray,
                   entry: np.ndarray) -> int:
    """Of the rows `ties` that whose row of B^-1, the columns of w in the tableau, over `entry` is
    lexicographically least.
    """
    if len(ties) == 1:
        return int(ties[0])
    place = {int(variable): column for column, variable in enumerate(nonbasic)}
    for w in range(len(basic)):
        if len(ties) == 1:
            break
        column = table[ties, place[w]] if w in place else (basic[ties] == w).astype(float)
        ties = _least_of(ties, column / entry[ties])
    return int(ties[0])


def _pivot(table: np.ndarray, row: int, column: int) -> None:
    """Exchange the variables of `row` and `column`."""
    pivot = table[row, column]
    line = table[row] / pivot
    line[column] = 1.0 / pivot
    entry = table[:, column].copy()
    entry[row] = 0.0
    table[:, column] = 0.0
    table[row] = 0.0
    blas.dger(-1.0, line, entry, a=table.T, overwrite_a=1)
    table[row] = line
