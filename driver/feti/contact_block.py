"""F_cc, the rows and columns of F that belong to the contact boundary.

F_cc gives contact displacements under contact forces while the gluing multipliers stay as they are.
Of F = B_r K_rr^-1 B_r' + A S_cc^-1 A' only subdomains with contact and their corners take part,

    F_cc = L + A_c G A_c',  L block diagonal over these subdomains,  G = S_cc^-1 on their corners,

so a product with it costs about n_c and not n_d operations, and needs no communication: every rank
holds all of it. It bounds the compliance C = F_cc - F_cg F_gg^-1 F_gc of the glued body from above,
and closely, as corners alone hold subdomains together well (Mandel, Dohrmann, Tezaur 2005). With 32
and 128 subdomains of 10x10 cells F_cc relative to C has eigenvalues 1 to 4.3, half <= 1.00001.
"""

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, issparse

from .blocks import whole
from .dirichlet import DirichletPreconditioner
from .gathering import Gathering, joined
from .operator import DualOperator

FULL = 0.2  # share of entries from which a matrix is kept dense
RENEWED = 0.3  # share of hats from which all of them are formed anew
FEW = 100  # hats: below that all of them take no longer


class ContactBlock:
    """F_cc and the preconditioner's M_cc on the n contact rows, replicated. Collective over `comm`.

    Contact rows are in the order of dual rows; `gather`, `scatter` go to and from dual vectors.
    """

    def __init__(self, operator: DualOperator, preconditioner: DirichletPreconditioner):
        structure, self.comm = operator.structure, operator.comm
        start, _ = structure.row_range
        self.rows = structure.at_contact.row  # global dual rows
        self._mine = structure.own_rows
        self._owned = self.rows[self._mine] - start
        self._all = Gathering(self.comm, len(self._owned))
        self.size = len(self.rows)
        parts = self._local_parts(operator, preconditioner)
        corners = np.unique(joined([part["corner"] for part in parts], int))
        self.local = self._spread(parts, "F", self.rows, self.rows)
        self.M = self._spread(parts, "M", self.rows, self.rows)
        self.A = self._spread(parts, "A", self.rows, corners)
        if len(corners) > self.size:  # where whole interfaces are corners: one dense matrix
            if structure.numbering is not None:
                operator.coarse.inverse(corners)  # is kept for the contact rows to come
            through = operator.coarse.compliance(corners, csr_matrix(self.A))
            self.local = np.asarray(self.local + through)
            self.A, self.G = np.zeros((self.size, 0)), np.zeros((0, 0))
        else:
            self.G = operator.coarse.inverse(corners)
        self._A_transposed = csr_matrix(self.A.T) if issparse(self.A) else self.A.T.copy()
        self.softness = None  # (n,) diagonal that a step adds

    def _local_parts(self, operator, preconditioner) -> list[dict]:
        """Contact rows, corners and matrices of every subdomain with contact, in their order."""
        structure = operator.structure
        parts, touching = [None] * len(structure.subdomains), set(structure.touching)
        for c, kept in zip(operator.classes, preconditioner.schur):
            for s in touching.intersection(c.members):
                rows = structure.rows[s]
                here = np.flatnonzero(structure.at_contact.has(rows.row))
                sign, scaling = rows.sign[here], rows.scaling[here]
                parts[s] = {"row": rows.row[here], "corner": structure.corner_global[s],
                            "F": c.F[np.ix_(here, here)] * np.outer(sign, sign),
                            "A": sign[:, None] * c.A[here],
                            "M": whole(kept)[np.ix_(here, here)] * np.outer(scaling, scaling)}
        ranks = self.comm.allgather([part for part in parts if part])
        return [part for rank in ranks for part in rank]

    @staticmethod
    def _spread(parts: list[dict], name: str, rows: np.ndarray, columns: np.ndarray):
        """Sum of the subdomains' matrices on `columns`, `rows` or corner dofs: CSR, or dense."""
        which = "row" if columns is rows else "corner"
        row_places = [np.searchsorted(rows, part["row"]) for part in parts]
        column_places = [np.searchsorted(columns, part[which]) for part in parts]
        i = joined([np.repeat(a, len(b)) for a, b in zip(row_places, column_places)], int)
        j = joined([np.tile(b, len(a)) for a, b in zip(row_places, column_places)], int)
        values = joined([part[name].ravel() for part in parts], float)
        matrix = coo_matrix((values, (i, j)), shape=(len(rows), len(columns))).tocsr()
        matrix.eliminate_zeros()
        # few subdomains with contact fill it: a dense product takes a fraction of the time
        return matrix.toarray() if matrix.nnz > FULL * len(rows) * len(columns) else matrix

    def gather(self, x: np.ndarray) -> np.ndarray:
        """(n,) all contact rows of a dual vector (or mask), on every rank."""
        return self._all(np.asarray(x[self._owned], float))

    def gathered(self, *vectors: np.ndarray) -> np.ndarray:
        """(k, n) the same of k dual vectors or masks, in one message."""
        parts = np.empty((len(vectors), len(self._owned)))
        for part, x in zip(parts, vectors):
            part[:] = x[self._owned]
        return self._all.rows(parts)

    def scatter(self, values: np.ndarray, x: np.ndarray) -> np.ndarray:
        """A copy of the dual vector `x` with the contact rows `values` (n,)."""
        result = x.copy()
        result[self._owned] = values[self._mine]
        return result

    def apply(self, v: np.ndarray) -> np.ndarray:
        """F_cc v, shape (n,)."""
        product = self.local @ v + self.A @ (self.G @ (self._A_transposed @ v))
        return product if self.softness is None else product + self.softness * v


class Galerkin:
    """W' F_cc W (k, k) for W with two entries a row, which change, in columns (n, 2), which stay.

    Rows with the same two columns, many as hats span a subdomain, are first summed up in L W where
    L is sparse.
    """

    def __init__(self, block: ContactBlock, columns: np.ndarray, k: int):
        self.size, self.G, self.block = k, block.G, block
        self._own = columns[:, :, None] * k + columns[:, None, :]
        pair = columns[:, 0] * k + columns[:, 1]
        A = csr_matrix(block.A).tocoo()
        if issparse(block.local):
            L = block.local.tocoo()
            self._L = _Sums(L.row, pair[L.col], L.col, L.data)
            self._row, to = L.row[self._L.entry], columns[L.col[self._L.entry]]
            self._cell = (columns[self._row][:, :, None] * k + to[:, None, :]).T.ravel()
        else:
            first = np.arange(0, columns.size + 1, 2)
            entries = np.zeros(columns.size), columns.ravel(), first
            self._hats = csr_matrix(entries, shape=(len(columns), k))
            self._hats_transposed = self._hats.T  # with the same entries
            self._local_transposed = np.ascontiguousarray(block.local.T)
        self._A = _Sums(A.col, pair[A.row], A.row, A.data)
        corners, to = max(len(self.G), 1), columns[A.row[self._A.entry]]
        cell, self._slot = np.unique((to * corners + A.col[self._A.entry][:, None]).T.ravel(),
                                     return_inverse=True)
        first = np.searchsorted(cell, np.arange(k + 1) * corners)
        entries = np.full(len(cell), np.nan), cell % corners, first
        self._coupling = csr_matrix(entries, shape=(k, len(self.G)))  # W'A
        self._hat = np.repeat(np.arange(k), np.diff(first))
        self._moved = np.zeros((len(self.G), k))  # G A'W
        self._through = np.zeros((k, k))  # W'A G A'W

    def __call__(self, W: np.ndarray) -> np.ndarray:
        """`W` (n, 2) are the entries."""
        local = self._local(W)
        W, k = np.ascontiguousarray(W.T), self.size
        coupling = np.bincount(self._slot, self._A(W).ravel(), minlength=len(self._hat))
        self._through_corners(coupling.astype(float, copy=False))
        if self.block.softness is not None:
            products = self.block.softness[:, None, None] * W.T[:, :, None] * W.T[:, None, :]
            local += np.bincount(self._own.ravel(), products.ravel(),
                                 minlength=k * k).reshape(k, k)
        return local + self._through

    def _through_corners(self, coupling: np.ndarray) -> None:
        """Renew W'A G A'W for the entries `coupling` of W'A.

        From one face to the next few hats change: their rows and columns alone are formed anew,
        with the sums of a product of all of them, so that the bits tell nothing of faces before.
        """
        T = self._coupling
        changed = np.unique(self._hat[coupling != T.data])
        T.data = coupling
        if len(changed) > RENEWED * self.size or self.size < FEW:
            self._moved = np.ascontiguousarray((T @ self.G).T)
            through = T @ self._moved
            self._through = (through + through.T) / 2
        elif len(changed):
            rows = _rows(T, changed)
            moved = np.ascontiguousarray((rows @ self.G).T)
            self._moved[:, changed] = moved
            through = (rows @ self._moved + (T @ moved).T) / 2
            self._through[changed] = through
            self._through[:, changed] = through.T

    def _local(self, W: np.ndarray) -> np.ndarray:
        """W' L W (k, k) for W (n, 2)."""
        k = self.size
        if not issparse(self.block.local):
            self._hats.data[:] = W.ravel()
            product = self._hats_transposed @ (self._hats_transposed @ self._local_transposed).T
            return (product + product.T) / 2
        W = np.ascontiguousarray(W.T)
        products = self._L(W)[:, None] * np.take(W, self._row, axis=1)
        local = np.bincount(self._cell, products.ravel(), minlength=k * k).reshape(k, k)
        return local.astype(float, copy=False)  # whole numbers where there is none to add


def _rows(matrix: csr_matrix, rows: np.ndarray) -> csr_matrix:
    """matrix[rows], which takes longer."""
    first, count = matrix.indptr[rows], np.diff(matrix.indptr)[rows]
    starts = np.append(0, np.cumsum(count))
    entry = np.arange(starts[-1]) + np.repeat(first - starts[:-1], count)
    return csr_matrix((matrix.data[entry], matrix.indices[entry], starts),
                      shape=(len(rows), matrix.shape[1]))


class _Sums:
    """Sums of products of W and entries `value` of a matrix over those that share `key`, `other`.

    `row`: the rows of W that entries belong to; `entry` (sums,) indices of an entry of every sum.
    """

    def __init__(self, key: np.ndarray, other: np.ndarray, row: np.ndarray, value: np.ndarray):
        order = np.lexsort((other, key))
        self._row, self._value = row[order], value[order]
        change = (np.diff(key[order]) != 0) | (np.diff(other[order]) != 0)
        self._first = np.flatnonzero(np.append(True, change)[: len(order)])
        self.entry = order[self._first]

    def __call__(self, W: np.ndarray) -> np.ndarray:
        """(2, sums) for W (2, n)."""
        return np.add.reduceat(self._value * np.take(W, self._row, axis=1), self._first, axis=1)
