"""Gluing rows and corners eliminated from the dual problem by dense fronts.

With the displacements u of the corners as unknowns the dual problem is that of the local matrices,

    [ F_i   -A   ] [ lambda ]   [ d ]
    [ -A'  -S_cc ] [    u   ] = [ 0 ],

which is symmetric quasidefinite: F_i is positive, -S_cc negative definite on what is eliminated,
and any order of elimination does without pivoting (R. J. Vanderbei, SIAM J. Optim. 5 (1995)
100-113). Rows that the same subdomains share, an interface, are eliminated together, and so are
the dofs of corners: fronts of hundreds of unknowns, dense anyway, as the local matrices are (I. S.
Duff, J. K. Reid, ACM Trans. Math. Softw. 9 (1983) 302-325), one after the other as a tree says
(elimination_tree.py). What is left on the contact rows is the compliance C of the glued body (see
compliance.py).

Bodies that no support holds are pinned at some corner dofs (coarse.py). Gluing forces do not move a
body as a whole, so that no gluing row feels the pins. Contact rows do. With what they move by, R,
with the motions Q, and with what rows move by under corner forces Q on pinned bodies, f = A S^+ Q,
and on these glued, C on springs of compliance rho is

    C_rho = C - R y' - y R' + R (e + rho) R',    y = f_c - F_cg F_gg^-1 f_g,
                                                 e = Q' S^+ Q - f_g' F_gg^-1 f_g,

as S_rho^-1 = P S^+ P + rho Q Q' says, P = I - Q Q', for any S^+.
"""

import functools

import numpy as np
from scipy.linalg import blas

from ..errors import NotConverged, agree
from .dense_front import Factors, assembled, eliminated
from .dissection import halved, middles
from .elimination_tree import EliminationTree
from .exchange import Handover, exchanged
from .gathering import gather, joined
from .halves import Half, mirrored
from .operator import DualOperator
from .rows import contact_row_numbers

# what takes the time of a multiplication in a product with F, which waits for memory
SPEED = 4.0  # operations of a front
SHARED = 5.0  # multiplications with a matrix that many subdomains share
WITH_PRECONDITIONER = 2.0  # the Dirichlet preconditioner has matrices of the size of F's
# multiplications in the time that a front takes however small, and a product with what QPs do by it
EACH_FRONT, EACH_PRODUCT = 4e5, 8e5
A_DOF, FACTORIZED = 25, 200  # numbers kept of a dof: mesh, solutions; its subdomain's own factor
LITTLE = 2**25  # numbers that any machine has room for


class GluingElimination:
    """Elimination of all but the contact rows; the ranks share the fronts. Collective.

    What a front is made of is added in an order that does not depend on who has it. `price` is what
    `compliance` takes on one rank, in products with F; `fits` is whether its factors take no more
    memory than all else, or little: subdomains that are alike share their factors, but no front.
    """

    def __init__(self, operator: DualOperator):
        structure, self._operator = operator.structure, operator
        rows, self._dual = contact_row_numbers(structure.contact), structure.dual_dofs
        self._last, size = len(rows), structure.dual_dofs + structure.coarse_dofs
        # of every subdomain the numbers of its unknowns, corners after dual rows
        self._numbers = self._of_subdomains(
            lambda s, c: np.append(structure.rows[s].row,
                                   self._dual + structure.corner_global[s]))
        self._holder = np.repeat(np.arange(operator.comm.size),
                                 operator.comm.allgather(len(structure.subdomains)))
        halves, _ = halved(gather(operator.comm, middles(structure)), 1)
        self._tree = EliminationTree(self._numbers, size, self._dual, rows, halves)
        self._place = self._tree.place
        self._owner, self._turn = self._tree.shared(self._holder, operator.comm.size)
        self._factors, self._compliance = {}, None
        shared = self._of_subdomains(lambda s, c: SHARED if c.shared else 1.0)
        work = sum(len(of) ** 2 / factor for of, factor in zip(self._numbers, shared))
        fronts = self._tree.operations / SPEED + EACH_FRONT * len(self._tree.fronts)
        self._product = WITH_PRECONDITIONER * work + EACH_PRODUCT
        self.price = fronts / self._product
        held = sum(self._of_subdomains(
            lambda s, c: structure.subdomains[s].dofs * (A_DOF + (not c.shared) * FACTORIZED)))
        self.fits = self._tree.entries <= max(held, LITTLE)

    def compliance(self) -> np.ndarray:
        """C (c, c) as `contact_row_numbers` orders it; made once. Raises NotConverged."""
        if self._compliance is None:
            self._eliminate()
            if self._operator.modes:
                self._compliance = self._on_springs(self._compliance)
        return self._compliance

    def _on_springs(self, C: np.ndarray) -> np.ndarray:
        """C_rho for the `C` of pinned bodies, in its place."""
        op, products = self._operator, self._operator.products
        rows = contact_row_numbers(op.structure.contact)
        moved, work = op.coarse.pinned_motions()
        R, felt = (np.column_stack([gather(op.comm, of) for of in columns])
                   for columns in (op.motions, map(op.movements, moved.T)))
        glued = np.column_stack([self.change(-of) for of in felt.T])
        work = work - felt.T @ glued
        answered = np.column_stack([gather(op.comm, op.apply(of[slice(*op.structure.row_range)]))
                                    for of in glued.T])
        op.products = products  # a part of the elimination
        y, R = felt[rows] - answered[rows] - R[rows] @ (felt.T @ glued), R[rows]
        # R half' + half R' are all three terms, added to the lower triangle without copies of C
        half = R @ ((work + work.T) / 2 + np.diag(op.rho)) / 2 - y
        return mirrored(blas.dsyr2k(1.0, R, half, beta=1.0, c=C.T, overwrite_c=1).T)

    def products(self, operations: float, dense: bool = True) -> float:
        """The number of products with F that take as long as `operations` (multiplications).

        `dense` ones, as of factorizations, or such that wait for memory as a product with F does.
        """
        return operations / (SPEED if dense else 1.0) / self._product

    def change(self, residual: np.ndarray) -> np.ndarray:
        """(dual rows,) change of the gluing multipliers that takes F's `residual` off their rows.

        Zero on contact rows. `compliance` has been asked for.
        """
        x, way = np.zeros(len(self._place)), Handover(self._operator.comm)
        x[self._place[: self._dual]] = -residual
        x[len(x) - self._last :] = 0.0
        owner, parent = self._owner, self._tree.parent
        for front, factors in self._factors.items():
            values = np.append(x[factors.own], np.zeros(len(factors.index) - factors.count))
            for child, place in factors.children.items():
                values[place] += way.taken(child, owner[child], np.empty(len(place)))[0]
            factors.condense(values)
            x[factors.own] = values[: factors.count]
            if len(values) > factors.count:
                way.give(front, owner[parent[front]], values[factors.count :])
        way.finish()
        for front, factors in reversed(self._factors.items()):
            values = np.append(x[factors.own], np.zeros(len(factors.index) - factors.count))
            if len(values) > factors.count:
                above, rest = owner[parent[front]], values[factors.count :]
                rest[:] = way.taken(front, above, np.empty(len(rest)))[0]
            factors.expand(values)
            x[factors.own] = values[: factors.count]
            for child, place in factors.children.items():
                way.give(child, owner[child], values[place])
        way.finish()
        x[self._pivots] = gather(self._operator.comm, x[self._own_pivots])
        return x[self._place[: self._dual]]

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
        if self._operator.modes:
            pinned = np.flatnonzero(
                np.isin(self._operator.structure.corner_global[s], self._operator.coarse.pins))
            place = len(c.A) + pinned  # F would be a copy
            matrix[place] = matrix[:, place] = 0.0
            matrix[place, place] = -c.corner_stiffness[pinned]  # S may have but rounding there
        return matrix[np.ix_(order, order)]

    def _matrices(self) -> list[list[tuple]]:
        """By front of this rank index and matrix, or what makes it, of its subdomains, in order."""
        operator, tree = self._operator, self._tree
        comm, begin = operator.comm, operator.structure.first
        # matrices are made when they are needed: never are all there at once
        made = {begin + s: functools.partial(self._matrix, s, c)
                for c in operator.classes for s in c.members}
        to, size = self._owner[tree.first], np.array([len(of) for of in self._numbers], int)
        if comm.size > 1:
            own, there = self._holder == comm.rank, to == comm.rank
            away, foreign = np.flatnonzero(own & ~there), np.flatnonzero(there & ~own)
            away = away[np.argsort(to[away], kind="stable")]
            sent, received = (np.bincount(ranks, size[of] ** 2, comm.size).astype(int) for ranks, of
                              in ((to[away], away), (self._holder[foreign], foreign)))
            entries = joined([made[s]().ravel() for s in away], float)
            entries = exchanged(comm, entries, sent, received)
            for s, part in zip(foreign, np.split(entries, np.cumsum(size[foreign] ** 2)[:-1])):
                made[s] = part.reshape(size[s], size[s])
        parts = [[] for _ in self._owner]
        for s in np.flatnonzero((to == comm.rank) & (size > 0)):
            parts[tree.first[s]].append((np.sort(self._place[self._numbers[s]]), made[s]))
        return parts

    def _eliminate(self) -> None:
        """This rank's fronts one after the other, and C on every rank."""
        tree, comm, error = self._tree, self._operator.comm, None
        parts, way, C = self._matrices(), Handover(comm), None
        for front in self._turn[self._owner[self._turn] == comm.rank].tolist():
            left = [self._left(way, child) for child in tree.children[front]]
            met = {child: index for child, (index, _) in zip(tree.children[front], left)}
            parts[front] += left
            del left  # matrices are given back one by one, as they are added
            last = front == len(tree.fronts)  # the contact rows, each of which has a subdomain
            count = 0 if last else tree.pivots[front].sum()
            index, columns, rest = assembled(parts[front], count)
            if last:
                C = rest
                break
            places = {child: np.searchsorted(index, of) for child, of in met.items()}
            try:
                rest = self._eliminated_front(front, index, columns, rest, places)
            except NotConverged as problem:  # what waits for this front must not wait for ever
                error, rest = problem, np.full([len(index) - count] * 2, np.nan)
            way.give(front, self._owner[tree.parent[front]], index[count:], Half(rest).entries)
            del columns, rest
        way.finish()
        agree(comm, error)
        C = np.empty([self._last] * 2) if C is None else C
        comm.Bcast(C, self._owner[-1])
        self._own_pivots = joined([factors.own for factors in self._factors.values()], int)
        self._pivots = gather(comm, self._own_pivots)
        self._compliance = mirrored(C)

    def _left(self, way: Handover, child: int) -> tuple:
        """Index of the matrix that the front `child` leaves, and half of it."""
        size = self._tree.fronts[child].size - self._tree.fronts[child].pivots
        index, entries = way.taken(child, self._owner[child], np.empty(size, int),
                                   np.empty(size * (size + 1) // 2))
        return index, Half.of(size, entries)

    def _eliminated_front(self, front: int, index: np.ndarray, columns: np.ndarray,
                          rest: np.ndarray, places: dict[int, np.ndarray]) -> np.ndarray:
        """What is left of the front with these `columns` and this `rest`; its factors are kept.

        `places` are those of what its children leave, in its `index` (n,). Raises NotConverged.
        """
        pivots = self._tree.pivots[front]
        inner = np.searchsorted(index, len(self._place) - self._last)
        places = {child: place[place < inner] for child, place in places.items()}
        places = {child: place for child, place in places.items() if len(place)}
        factors, first = Factors(index[:inner], pivots.sum(), places), 0
        parts, left = eliminated(columns, rest, pivots)
        for part in parts:
            first += len(part)
            part.rest = part.rest[:, : inner - first].copy()
        factors.parts = parts
        self._factors[front] = factors
        return left
