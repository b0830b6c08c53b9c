"""Vectors of multipliers on the ranks: layout, local rows of the subdomains, scalar products.

Results do not depend on the number of ranks, not even in the last bit: MPRGP decides by
comparisons, and two runs that differ in rounding may take different paths to answers that differ by
the tolerance. So every sum is taken in an order that the distribution does not change: scalar
products add the partial sums of the subdomains in their order, or exactly, of more than MANY; and
rows that more than two subdomains share add their terms in that order, too.
"""

import numpy as np
from petsc4py import PETSc

from .exchange import exchange
from .gathering import Gathering, exact_sum, joined
from .reduction import LocalClass
from .structure import Substructure

MANY = 50_000  # subdomains


class DualVectors:
    """Layout of dual vectors and of the local rows that the rank's subdomains have of them.

    A dual vector is a numpy array (owned,), the rank's part of a PETSc vector of `dual_dofs`
    entries. Local rows are stacked class by class as `LocalClass.rows` says; `sign` and `scaling`
    are those of `LocalRows`, stacked. Collective over `comm`.
    """

    def __init__(self, structure: Substructure, classes: list[LocalClass], comm):
        self.comm, self.owned = comm, structure.row_range[1] - structure.row_range[0]
        order = [s for c in classes for s in c.members]
        self.sign = joined([structure.rows[s].sign for s in order], float)
        self.scaling = joined([structure.rows[s].scaling for s in order], float)
        numbers = joined([structure.rows[s].row for s in order], PETSc.IntType)
        start, stop = structure.row_range
        # local rows of other ranks
        foreign = (numbers < start) | (numbers >= stop)
        self.foreign = int(np.count_nonzero(foreign))
        begin = np.array(comm.allgather(start))
        owner = np.searchsorted(begin, numbers, side="right") - 1
        self.neighbours = len(np.unique(owner[foreign]))  # ranks that have them
        self._dual = PETSc.Vec().createMPI((self.owned, structure.dual_dofs), comm=comm)
        self._gathered, self._to_rows = _scatter(self._dual, numbers)
        self._local = self._gathered.duplicate()
        paired = structure.contact.coupled.any()
        self._slots = _Slots(structure, numbers, order, owner, comm) if paired else None
        # partial sums of a scalar product: the rows of each subdomain, in the order of subdomains
        starts = structure.row_starts
        self._filled = starts < np.append(starts[1:], self.owned)  # reduceat has no empty segments
        self._filled_starts, self._subdomains = starts[self._filled], len(starts)
        self._many = structure.total > MANY
        self._all_partial = None if self._many else Gathering(comm, self._subdomains)

    @property
    def received(self) -> int:
        """Numbers that the rank gets from others for a scalar product."""
        return 3 if self._many else self._all_partial.size - self._subdomains

    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Global scalar product: partial sums by subdomain, added in their order."""
        partial = self._partial(a, b)
        if self._many:
            return float(exact_sum(self.comm, partial[:, None])[0])
        return float(self._all_partial(partial).sum())

    def dots_of(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """(k,) global scalar products of k pairs of dual vectors, as `dot`, in one message."""
        partial = np.array([self._partial(a, b) for a, b in pairs])
        if self._many:
            return exact_sum(self.comm, partial.T)
        return self._all_partial.rows(partial).sum(axis=1)

    def _partial(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(subdomains,) sums over the rows of each of the rank's subdomains."""
        if len(self._filled_starts) == self._subdomains > 0:
            return np.add.reduceat(a * b, self._filled_starts)
        partial = np.zeros(self._subdomains)
        if self.owned:
            partial[self._filled] = np.add.reduceat(a * b, self._filled_starts)
        return partial

    def dots(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(k,) global scalar products of the columns of blocks (owned, k), added as in `dot`."""
        partial = np.zeros((self._subdomains, a.shape[1]))
        if self.owned:
            partial[self._filled] = np.add.reduceat(a * b, self._filled_starts, axis=0)
        if self._many:
            return exact_sum(self.comm, partial)
        return np.concatenate(self.comm.allgather(partial)).sum(axis=0)

    def gather(self, x: np.ndarray) -> np.ndarray:
        """The rank's stacked local rows of x, unsigned; overwritten by the next call."""
        self._dual.array[:] = x
        self._to_rows.scatter(self._dual, self._gathered, addv=False, mode="forward")
        return self._gathered.array

    @property
    def local(self) -> np.ndarray:
        """Stacked local rows to be filled for `add_up`."""
        return self._local.array

    def add_up(self) -> np.ndarray:
        """Dual vector of the sums of the stacked rows in `local`."""
        if self._slots is not None:
            return self._slots.add_up(self._local.array)
        self._dual.set(0)
        self._to_rows.scatter(self._local, self._dual, addv=True, mode="reverse")
        return self._dual.array.copy()

    def assemble(self, rows: np.ndarray) -> np.ndarray:
        """Dual vector of the sums of the stacked local `rows`."""
        self.local[:] = rows
        return self.add_up()


class _Slots:
    """Sums over the subdomains of a row in their order, for rows that more than two of them share.

    Sums of two terms do not depend on their order, those of more do: here every term travels to its
    own slot at the row's rank, and the slots of a row are added up there.
    """

    def __init__(self, structure: Substructure, rows: np.ndarray, order: list[int],
                 owner: np.ndarray, comm):
        """`owner` (n,) are the ranks of the stacked local `rows` (n,)."""
        subdomain = np.repeat([structure.first + s for s in order],
                              [len(structure.rows[s].row) for s in order])
        terms = np.column_stack([rows, subdomain, np.arange(len(rows))]).astype(np.int64)
        source, terms = exchange(comm, owner, terms)
        order = np.lexsort((terms[:, 1], terms[:, 0]))
        self._starts = np.searchsorted(terms[order, 0], np.arange(*structure.row_range))
        self._vector = PETSc.Vec().createMPI((len(terms), None), comm=comm)
        terms[order, 1] = self._vector.getOwnershipRange()[0] + np.arange(len(terms))
        _, answer = exchange(comm, source, terms[:, 1:])
        slot = np.empty(len(rows), PETSc.IntType)
        slot[answer[:, 1]] = answer[:, 0]
        self._local, self._scatter = _scatter(self._vector, slot)

    def add_up(self, local: np.ndarray) -> np.ndarray:
        """Dual vector of stacked local rows."""
        self._local.array[:] = local
        self._scatter.scatter(self._local, self._vector, addv=False, mode="reverse")
        none = not len(self._starts)  # reduceat takes no empty list
        return np.zeros(0) if none else np.add.reduceat(self._vector.array, self._starts)


def _scatter(vector: PETSc.Vec, index: np.ndarray):
    """A local vector and the scatter that fills it with the entries `index` of `vector`."""
    local = PETSc.Vec().createSeq(len(index))
    source = PETSc.IS().createGeneral(index, comm=PETSc.COMM_SELF)
    target = PETSc.IS().createStride(len(index), first=0, step=1, comm=PETSc.COMM_SELF)
    return local, PETSc.Scatter().create(vector, source, local, target)
