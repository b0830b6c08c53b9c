"""Stage 4, condensed: gluing rows and corners eliminated from the dual problem by dense fronts.

With the displacements u of the corners as unknowns the dual problem is that of the local matrices,

    [ F_i   -A   ] [ lambda ]   [ d ]
    [ -A'  -S_cc ] [    u   ] = [ 0 ],

which is symmetric quasidefinite: F_i is positive, -S_cc negative definite on what is eliminated,
and any order of elimination does without pivoting (R. J. Vanderbei, SIAM J. Optim. 5 (1995)
100-113). Rows that the same subdomains share, an interface, are eliminated together, and so are
the dofs of corners: fronts of hundreds of unknowns, dense anyway, as the local matrices are (I. S.
Duff, J. K. Reid, ACM Trans. Math. Softw. 9 (1983) 302-325), one after the other as a tree says
(elimination_tree.py). What is left on the contact rows is the compliance C of the glued body; see
compliance.py, which eliminates motions of free bodies as well.
"""

import functools
from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, lapack, solve_triangular

from ..errors import NotConverged
from .elimination_tree import EliminationTree
from .operator import DualOperator
from .rows import contact_row_numbers

# what takes the time of a multiplication in a product with F, which waits for memory
SPEED = 4.0  # operations of a front
SHARED = 5.0  # multiplications with a matrix that many subdomains share
WITH_PRECONDITIONER = 2.0  # the Dirichlet preconditioner has matrices of the size of F's
# multiplications in the time that a front takes however small, and a product with what QPs do by it
EACH_FRONT, EACH_PRODUCT = 4e5, 8e5


@dataclass
class Front:
    """Factor of the pivots of one sign of a front: L (m, m) and L^-1 times the rest.

    `index` (m + r,) are the places of its unknowns, ascending, the pivots first, less those of
    contact rows, which are known where it is used.
    """

    sign: float
    index: np.ndarray
    pivots: np.ndarray
    rest: np.ndarray


class GluingElimination:
    """Elimination of all but the contact rows, the same on every rank; collective.

    Of a body without free rigid motions. `price` is what `compliance` takes, in products with F.
    """

    def __init__(self, operator: DualOperator):
        structure, self._operator = operator.structure, operator
        rows, self._dual = contact_row_numbers(structure.contact), structure.dual_dofs
        self._last, size = len(rows), structure.dual_dofs + structure.coarse_dofs
        # of every subdomain the numbers of its unknowns, corners after dual rows
        self._numbers = self._of_subdomains(
            lambda s, c: np.append(structure.rows[s].row,
                                   self._dual + structure.corner_global[s]))
        self._tree = EliminationTree(self._numbers, size, self._dual, rows)
        self._place, self._start = self._tree.place, self._tree.start
        self._fronts, self._compliance = None, None
        shared = self._of_subdomains(lambda s, c: SHARED if c.shared else 1.0)
        work = sum(len(of) ** 2 / factor for of, factor in zip(self._numbers, shared))
        fronts = self._tree.operations / SPEED + EACH_FRONT * len(self._tree.fronts)
        self._product = WITH_PRECONDITIONER * work + EACH_PRODUCT
        self.price = fronts / self._product

    def compliance(self) -> np.ndarray:
        """C (c, c) as `contact_row_numbers` orders it; made once. Raises NotConverged."""
        if self._fronts is None:
            self._eliminate()
        return self._compliance

    def products(self, operations: float) -> float:
        """The number of products with F that take as long as dense `operations` (multiplications).
        """
        return operations / SPEED / self._product

    def change(self, residual: np.ndarray) -> np.ndarray:
        """(dual rows,) change of the gluing multipliers that takes F's `residual` off their rows.

        Zero on contact rows. `compliance` has been asked for.
        """
        right = np.zeros(len(self._place))
        right[self._place[: self._dual]] = -residual
        right[len(right) - self._last :] = 0.0
        for front in self._fronts:
            m = len(front.pivots)
            part = solve_triangular(front.pivots, right[front.index[:m]], lower=True,
                                    check_finite=False)
            right[front.index[m:]] -= front.sign * (part @ front.rest)
            right[front.index[:m]] = part
        for front in reversed(self._fronts):
            m = len(front.pivots)
            part = front.sign * (right[front.index[:m]] - front.rest @ right[front.index[m:]])
            right[front.index[:m]] = solve_triangular(front.pivots, part, lower=True, trans="T",
                                                      check_finite=False)
        return right[self._place[: self._dual]]

    def _of_subdomains(self, part) -> list:
        """`part` (subdomain, class) of every subdomain of all ranks, in their order."""
        operator = self._operator
        local = [None] * len(operator.structure.subdomains)
        for c in operator.classes:
            for s in c.members:
                local[s] = part(s, c)
        if operator.comm.size == 1:
            return local
        return [one for rank in operator.comm.allgather(local) for one in rank]

    def _matrix(self, s: int, c) -> np.ndarray:
        """The matrix of local subdomain s, of class c, in the order of its places."""
        rows, corner = self._operator.structure.rows[s], len(c.corner)
        number = self._numbers[self._operator.structure.first + s]
        order, sign = np.argsort(self._place[number]), np.append(rows.sign, np.ones(corner))
        matrix = np.block([[c.F, -c.A], [-c.A_transposed, -c.S]]) * sign[:, None] * sign
        return matrix[np.ix_(order, order)]

    def _eliminate(self) -> None:
        """The fronts one after the other, and C."""
        waiting = [[] for _ in self._start]

        def add(index: np.ndarray, matrix) -> None:
            front = np.searchsorted(self._start, index[0], "right") - 1
            waiting[front].append((index, matrix))

        # one rank makes them when they are needed: never are all there at once
        alone = self._operator.comm.size == 1
        matrices = self._of_subdomains(
            lambda s, c: functools.partial(self._matrix, s, c) if alone else self._matrix(s, c))
        for number, matrix in zip(self._numbers, matrices):
            if len(number):
                add(np.sort(self._place[number]), matrix)
        del matrices
        self._fronts, first = [], len(self._place) - self._last
        for g, pivots in enumerate(self._tree.pivots):
            index, matrix = _assembled(waiting[g])
            for m, sign in zip(pivots, (1.0, -1.0)):
                if not m:
                    continue
                factor, rest, matrix = _eliminated(matrix, m, sign)
                inner = np.searchsorted(index, first)
                self._fronts.append(Front(sign, index[:inner], factor, rest[:, : inner - m].copy()))
                index = index[m:]
            if len(index):
                add(index, matrix)
        C = np.tril(_assembled(waiting[-1])[1])  # all contact rows, as each has a subdomain
        C += np.tril(C, -1).T
        self._compliance = C


def _assembled(parts: list[tuple]) -> tuple[np.ndarray, np.ndarray]:
    """Ascending index and lower triangle of the sum of matrices with indices of their own.

    `parts` are pairs of index and matrix, or what makes it; they are taken out one by one.
    """
    index = np.unique(np.concatenate([np.empty(0, int), *(part for part, _ in parts)]))
    total = None
    while parts:
        part, matrix = parts.pop()
        if callable(matrix):
            matrix = matrix()
        if total is None and len(part) == len(index):
            total = matrix
            continue
        total = np.zeros((len(index),) * 2) if total is None else total
        place = np.searchsorted(index, part)
        total[np.ix_(place, place)] += matrix
    return index, np.empty((0, 0)) if total is None else total


def _eliminated(matrix: np.ndarray, m: int, sign: float) -> tuple[np.ndarray, ...]:
    """Factor L (m, m) of the first m unknowns, of definite `sign`, L^-1 times the rest (m, r), and
    what their elimination leaves of it (r, r).

    Of `matrix` (m + r, m + r) and of what is left the lower triangle counts. Raises NotConverged.
    """
    pivots, failed = lapack.dpotrf(sign * matrix[:m, :m], lower=1)
    if failed:
        raise NotConverged("the contact compliance: gluing conditions could not be eliminated")
    rest = solve_triangular(pivots, matrix[m:, :m].T, lower=True, check_finite=False)
    left = matrix[m:, m:].copy()
    if left.size:  # its lower triangle is the upper one of the transpose, which BLAS takes as it is
        left = blas.dsyrk(-sign, rest, beta=1.0, c=left.T, trans=1, lower=0, overwrite_c=1).T
    return pivots, rest, left
