"""Sparse Cholesky factors of the interiors of subdomains, and what is left of their rims.

With the dofs i of the interior and b of the rim, alpha = diag K_bb added to the diagonal at b,
where K alone may be singular,

    L = [ L_ii       ],     L_bb L_bb' - alpha = S = K_bb - K_bi K_ii^-1 K_ib.
        [ L_bi  L_bb ]

The rim has what rows act on and the corners, and S all that they need of the interior.
CHOLMOD factorizes (Chen, Davis, Hager, Rajamanickam, ACM Trans. Math. Softw. 35 (2008)), by its
bindings in cvxopt.

CHOLMOD sorts any order again so that children precede their parents in the elimination tree (each
dof's parent is the next one that its column of L reaches). The last dofs keep their places if the
tree ends in the chain of them with all others below its first: entries that are zero say so.
"""

import numpy as np
from cvxopt import amd, cholmod, matrix, spmatrix
from petsc4py import PETSc
from scipy.linalg import lapack
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..errors import NoSolution
from ..scene.symmetric import Symmetric
from .halves import Half

cholmod.options.update(supernodal=2, nmethods=1)  # L L'; the given order and no other
SINGULAR = ("stiffness is not positive definite to rounding, which no cut can cause: check whether "
            "the material varies by many orders of magnitude and triangles are next to degenerate")


class Interior:
    """The interior of a subdomain with the stiffness K (dofs, dofs), eliminated.

    CHOLMOD's own factor is used up where it hands out L.

    L has both dofs of a node beside one another, with the same neighbours, if one is free. One that
    supports hold stands for itself there: off the diagonal its row and column are zeros.
    """

    def __init__(self, K: Symmetric, rim: np.ndarray, free: np.ndarray):
        """`rim` (n,) are nodes, `free` (dofs,) marks what no support holds.

        Dofs 2 k and 2 k + 1 are of node k. Raises NoSolution unless K_ii is positive definite.
        """
        of_rim = (2 * rim[:, None] + [0, 1]).ravel()
        self.stiffness = K.diagonal()  # (dofs,)
        is_inner = free.reshape(-1, 2).any(axis=1)
        is_inner[rim] = False
        inner, added = np.flatnonzero(is_inner), np.zeros(len(free))
        added[of_rim] = self.stiffness[of_rim]
        L, order = _in_order(_Blocks(K), inner, rim, free, added)
        self.inner = 2 * len(inner)  # dofs
        self.place = _places(order, len(free))  # (dofs,) places in L, -1 where there is none
        schur = _product(L, self.inner)
        schur[np.diag_indices_from(schur)] -= added[of_rim]
        self._schur = Half(schur)
        first = _blocks(L, self.inner)
        del L, schur  # before the blocks are copied
        self.columns = _FirstColumns(2 * len(first[0]) - 2, first)

    @property
    def size(self) -> int:
        """Number of dofs in L."""
        return self.columns.size

    def schur(self, dofs: np.ndarray) -> np.ndarray:
        """S (n, n) on some dofs of the rim. It is handed out once, and not kept."""
        place = self.place[dofs] - self.inner
        S, self._schur = self._schur.whole(), None
        return S[np.ix_(place, place)]


class _FirstColumns:
    """The first columns of L, to solve with; beyond them it is the identity here.

    Transposed, in blocks of the two dofs of a node: indices take a quarter of the memory.
    """

    def __init__(self, size: int, blocks: tuple[np.ndarray, np.ndarray, np.ndarray]):
        """By the `blocks` of L (size, size) that `_blocks` gives."""
        self.size = size
        self._upper = _upper(*blocks) if size else None

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


class _Blocks:
    """The stiffness by its blocks of nodes: those below the diagonal, and on it their lower halves.

    `row` and `column` (k,) are nodes, `values` (k, 2, 2) the blocks. What stands on the diagonal of
    K comes last: blocks of a place are to be added.
    """

    def __init__(self, K: Symmetric):
        below, self.count = K.below.tobsr((2, 2)), K.shape[0] // 2  # nodes
        node = np.arange(self.count)
        self.row = np.append(node.repeat(np.diff(below.indptr)), node)
        self.column = np.append(below.indices, node)
        self.values = np.concatenate([below.data, np.zeros((self.count, 2, 2))])
        self.values[len(below.data) :, [0, 1], [0, 1]] = K.diagonal().reshape(-1, 2)


def _in_order(blocks: _Blocks, inner: np.ndarray, rim: np.ndarray, free: np.ndarray,
              added: np.ndarray) -> tuple[spmatrix, np.ndarray]:
    """The factor L of the stiffness of `inner` nodes and those of the `rim`, which come last.

    And its dofs (n,) in the order of the factor; those of the rim keep theirs. `free` (dofs,) marks
    what no support holds, `added` (dofs,) is added to the diagonal. Inner nodes mostly hang
    together: only where they do not, and the factor shows it, they are searched.
    """
    nodes = np.concatenate([inner[_fill_reducing(blocks, inner)], rim])
    order = (2 * nodes[:, None] + [0, 1]).ravel()
    if not len(nodes):
        return spmatrix([], [], [], (0, 0)), order
    first = 2 * len(inner)
    for roots in (lambda *_: np.arange(len(inner))[-1:], _roots):
        factor = None  # before the next one is made
        lower = _lower(blocks, nodes, len(inner), free[order], roots)
        factor = _factorized(lower, added[order])
        rows = _permutation(factor, len(order))
        if np.array_equal(rows[first:], np.arange(first, len(order))):
            break  # the last rows are where they were
    return cholmod.getfactor(factor), order[rows]


def _permutation(factor, size: int) -> np.ndarray:
    """(size,) the rows of the matrix in the order of its factor."""
    rows = matrix(range(size), tc="d")
    cholmod.solve(factor, rows, sys=7)
    return np.array(rows).ravel().astype(int)


def _product(L: spmatrix, first: int) -> np.ndarray:
    """The lower triangle of L_bb L_bb' (n, n), L_bb what L has after the `first` columns."""
    if first == L.size[0]:
        return np.empty((0, 0))
    # turned round, as LAPACK has U U' of upper triangles
    upper = np.array(matrix(L[first:, first:]))[::-1, ::-1]
    return lapack.dlauum(upper)[0][::-1, ::-1]


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


def _places(order: np.ndarray, size: int) -> np.ndarray:
    """(size,) the place in `order` of every number below `size`, -1 where it has none."""
    place = np.full(size, -1)
    place[order] = np.arange(len(order))
    return place


def _fill_reducing(blocks: _Blocks, nodes: np.ndarray) -> np.ndarray:
    """Order of `nodes` (n,) that keeps the factor of their part of the stiffness sparse."""
    row, column, *_ = _entries(blocks, nodes)
    order = amd.order(spmatrix(1.0, row, column, (len(nodes), len(nodes))))
    return np.array(order).ravel()


def _entries(blocks: _Blocks, nodes: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows and columns, places in `nodes`, of the blocks of the lower triangle in their order.

    And which `blocks` these are, and whether they are transposed there.
    """
    place = _places(nodes, blocks.count)
    row, column = place[blocks.row], place[blocks.column]
    which = np.flatnonzero((row >= 0) & (column >= 0))
    row, column = row[which], column[which]
    return np.maximum(row, column), np.minimum(row, column), which, row < column


def _lower(blocks: _Blocks, nodes: np.ndarray, inner: int, free: np.ndarray, roots) -> spmatrix:
    """The lower triangle of the stiffness of `nodes` (n,), in this order, to factorize.

    With entries, if only zeros, that keep all nodes after the first `inner` in their places:
    `roots` gives of rows, columns and `inner` the last of every connected part of these. What is
    not `free` (2 n,) is coupled to nothing.
    """
    row, column, which, turned = _entries(blocks, nodes)
    values, n = blocks.values[which], len(nodes)
    values[turned] = values[turned].swapaxes(1, 2)
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
