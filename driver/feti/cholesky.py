"""Sparse Cholesky factors of subdomains, those dofs last that rows act on, and corners.

With the interior dofs i, the torn dofs t that rows act on and the corner dofs c in this order, and
alpha > 0 added to the diagonal at c, where K alone may be singular,

        [ L_ii             ]     L_tt L_tt' = S_tt,     L_ct L_tt' = S_ct,
    L = [ L_ti  L_tt       ],
        [ L_ci  L_ct  L_cc ]     L_cc L_cc' - alpha = S_cc - S_ct S_tt^-1 S_tc,

where S is what eliminating i leaves of K. So K_rr^-1 on t and what couples t and c come from the
last rows of one factor and dense algebra; solutions for every dof of t would take a pass through
the factor each. CHOLMOD factorizes (Chen, Davis, Hager, Rajamanickam, ACM Trans. Math. Softw. 35
(2008)), by its bindings in cvxopt.

CHOLMOD sorts any order again so that children precede their parents in the elimination tree (each
dof's parent is the next one that its column of L reaches). The last dofs keep their places if the
tree ends in the chain of them with all others below its first: entries that are zero say so.
"""

import numpy as np
from cvxopt import amd, cholmod, matrix, spmatrix
from petsc4py import PETSc
from scipy.linalg import lapack, solve_triangular
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..errors import NoSolution

cholmod.options.update(supernodal=2, nmethods=1)  # L L'; the given order and no other
AT_A_TIME = 256  # rows that are mirrored: without copies of a large triangle
SINGULAR = ("stiffness is not positive definite to rounding, which no cut can cause: check whether "
            "the material varies by many orders of magnitude and triangles are next to degenerate")


class TornFactor:
    """Factor of K_rr, the stiffness (n_r, n_r) of the torn dofs; made when it is first used.

    One factorization serves both: the last rows of L for `reduced` and, without the corners, all
    of it for `solve`, kept in parts. CHOLMOD's own factor is used up where it hands out L.

    L has both dofs of a node beside one another, with the same neighbours, if one is free. One that
    supports hold stands for itself there: off the diagonal its row and column are zeros.
    """

    def __init__(self, K, torn: np.ndarray, nodes: np.ndarray, together: int = 1):
        """`K` (dofs, dofs) is CSR, `torn` (n_r,) are the torn dofs, t those of the `nodes` (n,).

        Dofs 2 k and 2 k + 1 are of node k. L_tt takes so many right-hand sides `together`, filled
        up with zeros: the bits of one do not depend on how many there are.
        """
        self._K, self._torn, self._together = K, torn, together
        self.seen = np.isin(torn // 2, nodes)  # (n_r,) marks those of t
        self._columns = None  # the first columns of L
        # places in L of torn dofs (n_r,), t (n_t,) and corners (n_c,), and where corner nodes begin
        self._place = self._of_t = self._of_c = self._end = None
        # of its last rows L_tt, half a matrix in LAPACK's rectangular full packed format, and L_ct
        self._packed = self._coupling = None

    def reduced(self, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """K_rr^-1 (n_t, n_t) and K_rr^-1 K_rc (n_t, n_c) on t, and K_cc - K_cr K_rr^-1 K_rc.

        `corner` (n_c,), ascending, are all free dofs of some nodes. Raises NoSolution unless K_rr
        is positive definite.
        """
        K, torn, seen = self._K, self._torn, self.seen
        added = np.zeros(K.shape[0])
        added[corner] = K.diagonal()[corner]
        parts = [np.unique(dofs // 2) for dofs in (torn[~seen], torn[seen], corner)]
        free = np.zeros(K.shape[0], bool)
        free[torn] = free[corner] = True
        factor, order, inner = _in_order(K.tobsr((2, 2)), parts, free, added)
        place = _places(order, K.shape[0])
        self._place, self._of_t, self._of_c = place[torn], place[torn[seen]], place[corner]
        self._end = len(order) - 2 * len(parts[2])
        whole = cholmod.getfactor(factor) if len(order) else spmatrix([], [], [], (0, 0))
        self._columns = _FirstColumns(whole, inner)
        L = _last_rows(whole, inner, np.append(self._of_t, self._of_c))
        n_t = len(self._of_t)
        L_tt, L_ct, L_cc = L[:n_t, :n_t], L[n_t:, :n_t], L[n_t:, n_t:]
        self._packed, self._coupling = _packed(L_tt), L_ct.copy()
        schur = L_cc @ L_cc.T - np.diag(added[corner])
        return _inverse(L_tt), _backward(L_tt, L_ct.T), (schur + schur.T) / 2

    def solve(self, right: np.ndarray) -> np.ndarray:
        """K_rr^-1 times the columns of `right` (n_r, k)."""
        if not right.size:
            return np.zeros_like(right)
        if self._columns is None:
            self.reduced(np.empty(0, int))
        none = np.zeros((right.shape[1], len(self._coupling)))
        return self.backward(self.forward(right.T), none).T

    def forward(self, right: np.ndarray) -> np.ndarray:
        """L^-1 times rows of `right` (k, n_r), zero on the corners, in the order of L up to them.
        """
        whole = np.zeros((len(right), self._columns.size))
        whole[:, self._place] = right
        result = self._columns.forward(whole)[:, : self._end]
        result[:, self._of_t] = self._on_rows(result[:, self._of_t])
        return result

    def forward_of_rows(self, right: np.ndarray) -> np.ndarray:
        """`forward` of what is zero but on t: the last rows of L have it all."""
        result = np.zeros((len(right), self._end))
        result[:, self._of_t] = self._on_rows(right[:, self.seen])
        return result

    def _on_rows(self, right: np.ndarray, trans: str = "N") -> np.ndarray:
        """L_tt^-1 times rows of `right` (k, n_t), or L_tt^-T."""
        result, n_t = np.empty(right.shape), right.shape[1]
        for first in range(0, len(right) if n_t else 0, self._together):
            part = right[first : first + self._together]
            filled = np.zeros((self._together, n_t))
            filled[: len(part)] = part
            solved = lapack.dtfsm(1.0, self._packed, filled.T, uplo="L", trans=trans, overwrite_b=1)
            result[first : first + self._together] = solved.T[: len(part)]
        return result

    def backward(self, forward: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """K_rr^-1 (f_r - K_rc u_c) (k, n_r) by rows of `forward` of f_r and u_c, `corner` (k, n_c).

        K_rc comes in by the rows of L at the corners.
        """
        whole = np.zeros((len(forward), self._columns.size))
        whole[:, : self._end] = forward
        # one by one: bits do not depend on how many there are
        on_rows = forward[:, self._of_t] - np.array([u @ self._coupling for u in corner])
        whole[:, self._of_t] = self._on_rows(on_rows, "T")
        whole[:, self._of_c] = corner
        return self._columns.backward(whole)[:, self._place]


class _FirstColumns:
    """The first columns of L, to solve with; beyond them it is the identity here.

    Transposed, in blocks of the two dofs of a node: indices take a quarter of the memory.
    """

    def __init__(self, L: spmatrix, inner: int):
        """The first `inner` columns of L (n, n); 2 k and 2 k + 1 have the same rows below both."""
        self.size = L.size[0]
        self._upper = _upper(*_blocks(L, inner)) if self.size else None

    def forward(self, right: np.ndarray) -> np.ndarray:
        """L^-1 times rows of `right` (k, n)."""
        return self._solved("solveTranspose", right)

    def backward(self, right: np.ndarray) -> np.ndarray:
        """L^-T times rows of `right` (k, n)."""
        return self._solved("solve", right)

    def _solved(self, solve: str, right: np.ndarray) -> np.ndarray:
        result = np.empty(right.shape)
        if result.size:
            (x, y), solve = self._upper.createVecs(), getattr(self._upper, solve)
            for given, found in zip(right, result):
                x.array[:] = given
                solve(x, y)
                found[:] = y.array
        return result


def _factorized(lower: spmatrix, added: np.ndarray):
    """CHOLMOD's factor of a matrix, `added` (n,) to its diagonal. Raises NoSolution."""
    diagonal = np.array(matrix(lower[:: lower.size[0] + 1])).ravel() + added
    lower[:: lower.size[0] + 1] = matrix(diagonal)
    factor = cholmod.symbolic(lower, p=matrix(range(len(diagonal))))
    try:
        cholmod.numeric(lower, factor)
    except ArithmeticError:
        raise NoSolution(f"a subdomain's {SINGULAR}") from None
    # a pivot is what is left of a dof's stiffness when those before it give way
    pivots = np.array(cholmod.diag(factor)).ravel() ** 2
    if not np.all(pivots > len(pivots) * np.finfo(float).eps * diagonal):
        raise NoSolution(f"a subdomain's {SINGULAR}")
    return factor


def _in_order(blocks, parts: list[np.ndarray], free: np.ndarray, added: np.ndarray):
    """CHOLMOD's factor of the stiffness of the nodes `parts`, inner ones, those of t and corners.

    And its dofs (n,) in the order of the factor, and the number of those of inner nodes, which come
    first; the others keep their order. `blocks` are K's blocks of nodes, `free` (dofs,) marks what
    no support holds, `added` (dofs,) is added to the diagonal. Inner nodes mostly hang together:
    only where they do not, and the factor shows it, they are searched.
    """
    inner = len(parts[0])
    nodes = np.concatenate([parts[0][_fill_reducing(blocks, parts[0])], *parts[1:]])
    order = (2 * nodes[:, None] + [0, 1]).ravel()
    if not len(nodes):
        return None, order, 0
    last = np.arange(2 * inner, len(order))
    for roots in (lambda *_: np.arange(inner)[-1:], _roots):
        factor = None  # before the next one is made
        factor = _factorized(_lower(blocks, nodes, inner, free[order], roots), added[order])
        rows = _permutation(factor, len(order))
        if np.array_equal(rows[2 * inner :], last):
            break  # the last rows are where they were
    return factor, order[rows], 2 * inner


def _permutation(factor, size: int) -> np.ndarray:
    """(size,) the rows of the matrix in the order of its factor."""
    rows = matrix(range(size), tc="d")
    cholmod.solve(factor, rows, sys=7)
    return np.array(rows).ravel().astype(int)


def _last_rows(L: spmatrix, first: int, which: np.ndarray) -> np.ndarray:
    """The rows and columns `which` (n,) of L, all of them after the `first` ones."""
    if not len(which):
        return np.empty((0, 0))
    last = np.array(matrix(L[first:, first:]))
    if np.array_equal(which, np.arange(first, first + len(last))):
        return last
    return last[np.ix_(which - first, which - first)]


def _packed(L: np.ndarray) -> np.ndarray | None:
    """The lower triangle L (n, n) in the rectangular full packed format; None without rows."""
    return lapack.dtrttf(L, uplo="L")[0] if len(L) else None


def _blocks(L: spmatrix, inner: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The first `inner` columns of L (n, n) and others of the identity, in blocks of two.

    Beginnings (n / 2 + 1,) of the columns of blocks, rows (k,) and values (k, 2, 2) of these, row
    after row. Columns 2 k and 2 k + 1 have the same rows below.
    """
    first, row, value = (np.asarray(part).ravel() for part in L.CCS)
    count = np.diff(first[: inner + 1])[::2].astype(np.int32)
    last = np.arange(inner // 2, L.size[0] // 2)
    start = np.cumsum(np.concatenate([[0], count // 2, np.ones(len(last), int)]))
    inside = start[inner // 2]
    # entries of both rows of a block at once
    pairs = np.ndarray(max(len(value) - 1, 0), complex, value, strides=value.strides)
    entry = 2 * np.arange(inside, dtype=np.int32)
    entry += np.repeat((first[:inner:2] - 2 * start[: inner // 2]).astype(np.int32), count // 2)
    row, values = np.append(row[entry] >> 1, last), np.empty((start[-1], 2, 2))
    values[:inside, :, 0] = pairs[entry].view(float).reshape(-1, 2)
    # the second column has an entry less, above the diagonal
    entry += np.repeat(count - 1, count // 2)
    values[:inside, :, 1] = pairs[entry].view(float).reshape(-1, 2)
    values[start[: inner // 2], 0, 1] = 0.0
    values[inside:] = np.eye(2)
    return start, row, values


def _upper(start: np.ndarray, row: np.ndarray, values: np.ndarray) -> PETSc.Mat:
    """The transposed of a lower triangle given in `_blocks`, to solve with.

    ILU(0) has nothing to eliminate but in the blocks of the diagonal, and works in place.
    """
    size = 2 * len(start) - 2
    mat = PETSc.Mat().create(PETSc.COMM_SELF)
    mat.setSizes(size, bsize=2)
    mat.setType(PETSc.Mat.Type.SEQBAIJ)
    mat.setOption(PETSc.Mat.Option.ROW_ORIENTED, False)  # rows of the triangle are columns here
    start, row = start.astype(PETSc.IntType), row.astype(PETSc.IntType)
    mat.setPreallocationCSR((start, row, values.ravel()))
    order = PETSc.IS().createStride(size, first=0, step=1, comm=PETSc.COMM_SELF)
    mat.factorILU(order, order)
    return mat


def _backward(L: np.ndarray, right: np.ndarray) -> np.ndarray:
    """L^-T times `right` (n, k), L (n, n) lower triangular."""
    if not right.size:
        return np.zeros(right.shape)
    return solve_triangular(L, right, lower=True, trans="T", check_finite=False)


def _inverse(L: np.ndarray) -> np.ndarray:
    """(L L')^-1 (n, n), symmetric to the last bit."""
    if not L.size:
        return np.empty((0, 0))
    return mirrored(lapack.dpotri(L, lower=1)[0])


def mirrored(matrix: np.ndarray) -> np.ndarray:
    """`matrix` (n, n), of which the lower triangle counts, made symmetric in place."""
    for first in range(0, len(matrix), AT_A_TIME):
        here, beyond = slice(first, first + AT_A_TIME), slice(first + AT_A_TIME, None)
        lower = np.tril(matrix[here, here])
        matrix[here, here] = lower + np.tril(lower, -1).T
        matrix[here, beyond] = matrix[beyond, here].T
    return matrix


def _places(order: np.ndarray, size: int) -> np.ndarray:
    """(size,) the place in `order` of every number below `size`, -1 where it has none."""
    place = np.full(size, -1)
    place[order] = np.arange(len(order))
    return place


def _fill_reducing(blocks, nodes: np.ndarray) -> np.ndarray:
    """Order of `nodes` (n,) that keeps the factor of their part of the stiffness sparse."""
    row, column, _ = _entries(blocks, nodes)
    order = amd.order(spmatrix(1.0, row, column, (len(nodes), len(nodes))))
    return np.array(order).ravel()


def _entries(blocks, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns, places in `nodes`, of the lower triangle's blocks, and which they are."""
    place = _places(nodes, blocks.shape[0] // 2)
    row, column = place.repeat(np.diff(blocks.indptr)), place[blocks.indices]
    which = np.flatnonzero((column >= 0) & (row >= column))
    return row[which], column[which], which


def _lower(blocks, nodes: np.ndarray, inner: int, free: np.ndarray, roots) -> spmatrix:
    """The lower triangle of the stiffness of `nodes` (n,), in this order, to factorize.

    With entries, if only zeros, that keep all nodes after the first `inner` in their places:
    `roots` gives of rows, columns and `inner` the last of every connected part of these. What is
    not `free` (2 n,) is coupled to nothing.
    """
    row, column, which = _entries(blocks, nodes)
    values, n = blocks.data[which], len(nodes)
    if not free.all():
        free = free.reshape(-1, 2)
        coupled = free[row][:, :, None] & free[column][:, None, :]
        values *= coupled | ((row == column)[:, None, None] & np.eye(2, dtype=bool))
    if inner < n:
        last = np.concatenate([roots(row, column, inner), np.arange(inner, n - 1)])
        row, column = np.append(row, np.maximum(inner, last + 1)), np.append(column, last)
        values = np.concatenate([values, np.zeros((len(last), 2, 2))])
    rows = np.broadcast_to((2 * row)[:, None, None] + [[0], [1]], values.shape)
    columns = np.broadcast_to((2 * column)[:, None, None] + [[0, 1]], values.shape)
    return spmatrix(values.ravel(), rows.ravel(), columns.ravel(), (2 * n, 2 * n))


def _roots(row: np.ndarray, column: np.ndarray, inner: int) -> np.ndarray:
    """The last of every connected part of the first `inner` dofs of a matrix with these entries."""
    among = row < inner
    graph = coo_matrix((np.ones(among.sum()), (row[among], column[among])), shape=(inner, inner))
    _, part = connected_components(graph)
    last = np.full(part.max(initial=-1) + 1, -1)
    np.maximum.at(last, part, np.arange(inner))
    return last
