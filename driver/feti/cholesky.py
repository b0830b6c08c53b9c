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
from scipy.sparse import coo_matrix, csr_matrix
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
    """

    def __init__(self, K, torn: np.ndarray, seen: np.ndarray):
        """`K` (dofs, dofs) is CSR, `torn` (n_r,) are the torn dofs, `seen` (n_r,) marks those of t.
        """
        self._K, self._torn, self._inner = K, torn, int((~seen).sum())
        inner = np.flatnonzero(~seen)
        self._order = np.append(inner[_fill_reducing(K, torn[inner])], np.flatnonzero(seen))
        # the first columns of L, and the torn dofs in its order
        self._columns = self._place = None
        # of its last rows L_tt, half a matrix in LAPACK's rectangular full packed format, and L_ct
        self._packed = self._coupling = None

    def reduced(self, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """K_rr^-1 (n_t, n_t) and K_rr^-1 K_rc (n_t, n_c) on t, and K_cc - K_cr K_rr^-1 K_rc.

        `corner` (n_c,) are the corner dofs. Raises NoSolution unless K_rr is positive definite.
        """
        K, order = self._K, np.append(self._torn[self._order], corner)
        n_c, size, added = len(corner), len(order), np.zeros(len(order))
        added[size - n_c :] = K.diagonal()[corner]
        if not size:  # supports hold all dofs
            self._place, self._coupling = order, np.empty((0, 0))
            return np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0))
        factor, places = _in_order(K, order, self._inner, added)
        self._place = self._order[places[: size - n_c]]
        whole = cholmod.getfactor(factor)
        L, n_t = _last_rows(whole, size - self._inner), size - self._inner - n_c
        self._columns = _FirstColumns(whole, self._inner, order[places] // 2)
        L_tt, L_ct, L_cc = L[:n_t, :n_t], L[n_t:, :n_t], L[n_t:, n_t:]
        self._packed, self._coupling = _packed(L_tt), L_ct.copy()
        schur = L_cc @ L_cc.T - np.diag(added[size - n_c :])
        return _inverse(L_tt), _backward(L_tt, L_ct.T), (schur + schur.T) / 2

    def solve(self, right: np.ndarray) -> np.ndarray:
        """K_rr^-1 times the columns of `right` (n_r, k)."""
        if not right.size:
            return np.zeros_like(right)
        if self._columns is None:
            self.reduced(np.empty(0, int))
        none = np.zeros(len(self._coupling))
        return np.column_stack([self.backward(self.forward(column), none) for column in right.T])

    def forward(self, right: np.ndarray) -> np.ndarray:
        """L^-1 times `right` (n_r,), which is zero on the corners, in the order of L."""
        torn = len(self._place)
        if not torn:
            return right.copy()
        whole = np.append(right[self._place], np.zeros(len(self._coupling)))
        result = self._columns.forward(whole)[:torn]
        result[self._inner :] = self._on_rows(result[self._inner :])
        return result

    def forward_of_rows(self, right: np.ndarray) -> np.ndarray:
        """`forward` of what is zero but on t: the last rows of L have it all."""
        y = np.zeros(len(self._place))
        y[self._inner :] = self._on_rows(right[self._place[self._inner :]])
        return y

    def _on_rows(self, right: np.ndarray, trans: str = "N") -> np.ndarray:
        """L_tt^-1 times `right` (n_t,), or L_tt^-T."""
        if not len(right):
            return right
        return lapack.dtfsm(1.0, self._packed, right[:, None], uplo="L", trans=trans)[:, 0]

    def backward(self, forward: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """K_rr^-1 (f_r - K_rc u_c) (n_r,) by `forward` (n_r,) of f_r and u_c, `corner` (n_c,).

        K_rc comes in by the rows of L at the corners.
        """
        torn, solution = len(self._place), np.empty(len(self._place))
        if not torn:
            return solution
        rows = forward[self._inner :] - self._coupling.T @ corner
        whole = np.concatenate([forward[: self._inner], self._on_rows(rows, "T"), corner])
        solution[self._place] = self._columns.backward(whole)[:torn]
        return solution


class _FirstColumns:
    """The first columns of L, to solve with; beyond them it is the identity here.

    Transposed, and in blocks of the two dofs of a node: indices take a quarter of the memory. A dof
    whose node's other one is not beside it has an unknown of its own there that is zero.
    """

    def __init__(self, L: spmatrix, inner: int, node: np.ndarray):
        """The first `inner` columns of L (n, n); `node` (n,) of every row."""
        self._place, size = _pairs(node)
        self._upper = _in_blocks(_transposed(L, inner, self._place, size))

    def forward(self, right: np.ndarray) -> np.ndarray:
        """L^-1 times `right` (n,)."""
        return self._solved(self._upper.solveTranspose, right)

    def backward(self, right: np.ndarray) -> np.ndarray:
        """L^-T times `right` (n,)."""
        return self._solved(self._upper.solve, right)

    def _solved(self, solve, right: np.ndarray) -> np.ndarray:
        x, y = self._upper.createVecs()
        x.array[:] = 0.0
        x.array[self._place] = right
        solve(x, y)
        return y.array[self._place]


def _factorized(lower: spmatrix, extra: np.ndarray | None = None):
    """CHOLMOD's factor of a matrix, `extra` (n,) added to its diagonal. Raises NoSolution."""
    diagonal = np.array(matrix(lower[:: lower.size[0] + 1])).ravel()
    if extra is not None:
        diagonal += extra
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


def _in_order(K, order: np.ndarray, inner: int, added: np.ndarray):
    """CHOLMOD's factor of `K` in the `order` of dofs (n,), and the places (n,) of its rows in it.

    Those after the first `inner` keep theirs. `added` (n,) is added to the diagonal. The first
    dofs mostly hang together: only where they do not, and the factor shows it, they are searched.
    """
    last = np.arange(inner, len(order))
    for roots in (lambda *_: np.arange(inner)[-1:], _roots):
        factor = _factorized(_lower(K, _places(K, order), inner, roots), added)
        places = _permutation(factor, len(order))
        if np.array_equal(places[inner:], last):
            break  # the last rows are where they were
    return factor, places


def _permutation(factor, size: int) -> np.ndarray:
    """(size,) the rows of the matrix in the order of its factor."""
    rows = matrix(range(size), tc="d")
    cholmod.solve(factor, rows, sys=7)
    return np.array(rows).ravel().astype(int)


def _last_rows(L: spmatrix, count: int) -> np.ndarray:
    """The lower triangle (count, count) at the end of L."""
    if not count:
        return np.empty((0, 0))
    return np.array(matrix(L[-count:, -count:]))


def _packed(L: np.ndarray) -> np.ndarray | None:
    """The lower triangle L (n, n) in the rectangular full packed format; None without rows."""
    return lapack.dtrttf(L, uplo="L")[0] if len(L) else None


def _pairs(node: np.ndarray) -> tuple[np.ndarray, int]:
    """(n,) places of rows that make those of a `node` (n,) beside one another a block of two.

    And the number of places: one beside each row whose node has no other one there.
    """
    first, begin = np.ones(len(node), bool), np.flatnonzero(np.diff(node, prepend=-1))
    length = np.diff(np.append(begin, len(node)))
    first[begin[length == 2] + 1] = False
    block = np.cumsum(first, dtype=np.int32) - 1
    return 2 * block + ~first, 2 * int(first.sum())


def _transposed(L: spmatrix, inner: int, place: np.ndarray, size: int) -> csr_matrix:
    """The first `inner` columns of L (n, n) as rows, at these of `size` places; `place` (n,)."""
    first, row, value = (np.asarray(part).ravel() for part in L.CCS)
    end = int(first[inner])
    count = np.zeros(size, np.int32)  # of the entries of a place
    count[place[:inner]] = np.diff(first[: inner + 1])
    start = np.append(np.zeros(1, np.int32), np.cumsum(count, dtype=np.int32))
    return csr_matrix((value[:end], place[row[:end]], start), (size, size))


def _in_blocks(upper: csr_matrix) -> PETSc.Mat:
    """The first rows of an upper triangular matrix, to solve with, in blocks of two.

    Rows without entries, the last ones and some of the second rows of blocks, are of the identity.
    ILU(0) has nothing to eliminate but in the blocks of the diagonal, and works in place.
    """
    size, empty = upper.shape, np.diff(upper.indptr).reshape(-1, 2) == 0
    blocks = upper.tobsr((2, 2))
    del upper  # it is large
    blocks.sort_indices()
    start, column = blocks.indptr, blocks.indices
    first = int((~empty[:, 0]).sum())
    last = np.arange(first, len(empty), dtype=start.dtype)
    values = np.empty((len(column) + len(last), 2, 2))
    values[: len(column)] = blocks.data.transpose(0, 2, 1)  # by columns, as PETSc keeps them
    values[start[:first][empty[:first, 1]], 1, 1] = 1.0  # blocks of the diagonal come first
    values[len(column) :] = np.eye(2)
    del blocks
    start = np.append(start[: first + 1], start[first] + 1 + last - first)
    csr = start.astype(PETSc.IntType), np.append(column, last).astype(PETSc.IntType), values.ravel()
    mat = PETSc.Mat().create(PETSc.COMM_SELF)
    mat.setSizes(size, bsize=2)
    mat.setType(PETSc.Mat.Type.SEQBAIJ)
    mat.setOption(PETSc.Mat.Option.ROW_ORIENTED, False)
    mat.setPreallocationCSR(csr)
    order = PETSc.IS().createStride(size[0], first=0, step=1, comm=PETSc.COMM_SELF)
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


def _places(K, order: np.ndarray) -> np.ndarray:
    """(dofs,) the place of every dof of `K` in `order`, -1 where it has none."""
    place = np.full(K.shape[0], -1)
    place[order] = np.arange(len(order))
    return place


def _fill_reducing(K, dofs: np.ndarray) -> np.ndarray:
    """Order of `dofs` (n,) that keeps the factor of their part of `K` sparse.

    Dofs 2 k and 2 k + 1 are of one node and have the same neighbours: nodes are ordered.
    """
    if not len(dofs):
        return np.empty(0, int)
    nodes, of_dof = np.unique(dofs // 2, return_inverse=True)
    place = np.full((K.shape[0] + 1) // 2, -1)
    place[nodes] = np.arange(len(nodes))
    first = K.indptr[2 * nodes]
    count = K.indptr[2 * nodes + 1] - first
    entry = np.arange(count.sum()) + (first - np.cumsum(count) + count).repeat(count)
    column = K.indices[entry]
    row, column = np.arange(len(nodes)).repeat(count), np.where(column % 2, -1, place[column // 2])
    inside = (column >= 0) & (row >= column)
    row, column = row[inside], column[inside]
    order = amd.order(spmatrix(1.0, row, column, (len(nodes), len(nodes))))
    turn = np.empty(len(nodes), int)
    turn[np.array(order).ravel()] = np.arange(len(nodes))
    return np.argsort(turn[of_dof], kind="stable")


def _lower(K, place: np.ndarray, inner: int, roots) -> spmatrix:
    """The lower triangle of `K`, a dof's row and column at its `place` (dofs,), -1 for none.

    With entries, if only zeros, that keep all dofs after the first `inner` in their places:
    `roots` gives of rows, columns and `inner` the last of every connected part of these.
    """
    row, column = place.repeat(np.diff(K.indptr)), place[K.indices]
    inside = (column >= 0) & (row >= column)
    row, column, values, n = row[inside], column[inside], K.data[inside], int(place.max()) + 1
    if inner < n:
        last = np.concatenate([roots(row, column, inner), np.arange(inner, n - 1)])
        parent = np.maximum(inner, last + 1)
        row, column = np.append(row, parent), np.append(column, last)
        values = np.append(values, np.zeros(len(last)))
    return spmatrix(values, row, column, (n, n))


def _roots(row: np.ndarray, column: np.ndarray, inner: int) -> np.ndarray:
    """The last of every connected part of the first `inner` dofs of a matrix with these entries."""
    among = row < inner
    graph = coo_matrix((np.ones(among.sum()), (row[among], column[among])), shape=(inner, inner))
    _, part = connected_components(graph)
    last = np.full(part.max(initial=-1) + 1, -1)
    np.maximum.at(last, part, np.arange(inner))
    return last
