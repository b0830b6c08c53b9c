"""Arrays whose parts the ranks hold, as a whole on every rank; parts joined to one array."""

import numpy as np
from mpi4py import MPI

from ..errors import DriverError


class Gathering:
    """Gathers arrays of the same lengths repeatedly, in rank order. Collective over `comm`."""

    def __init__(self, comm, length: int):
        """`length` of the rank's own part."""
        self.comm = comm
        counts = comm.allgather(length)
        self.size, self._layout = sum(counts), (counts, np.cumsum([0, *counts[:-1]]).tolist())

    def __call__(self, part: np.ndarray) -> np.ndarray:
        """(size,) all parts; of one rank its own part itself."""
        if self.comm.size == 1:
            return part
        everyone = np.empty(self.size)
        self.comm.Allgatherv(part, (everyone, self._layout))
        return everyone

    def rows(self, parts: np.ndarray) -> np.ndarray:
        """(k, size) of k parts (k, length) in one message."""
        if self.comm.size == 1:
            return parts
        (counts, starts), k = self._layout, len(parts)
        everyone = np.empty(k * self.size)
        layout = [k * count for count in counts], [k * start for start in starts]
        self.comm.Allgatherv(np.ascontiguousarray(parts), (everyone, layout))
        return np.concatenate([everyone[k * start : k * (start + count)].reshape(k, count)
                               for count, start in zip(counts, starts)], axis=1)


def joined(arrays, kind, *width: int) -> np.ndarray:
    """Concatenation of arrays (n, *width) to one of type `kind`, also for ranks that have none."""
    return np.concatenate([np.empty((0, *width), kind), *arrays]).astype(kind, copy=False)


def by_node(arrays: dict[str, np.ndarray], nodes: np.ndarray, count: int,
            comm) -> dict[str, np.ndarray] | None:
    """Arrays of the rank's `nodes` as (count,) of all nodes, by name, on rank 0; collective."""
    parts = comm.gather((nodes, list(arrays.values())))
    if parts is None:
        return None
    whole = {name: np.zeros(count) for name in arrays}
    for own, values in parts:
        for array, part in zip(whole.values(), values):
            array[own] = part
    return whole


def gather(comm, local: np.ndarray) -> np.ndarray:
    """The ranks' arrays (n, ...) in rank order, which is subdomain order; collective."""
    return np.concatenate(comm.allgather(local)) if comm.size > 1 else local


def by_first(comm, make, *given):
    """`make(*given)` on all ranks, by the first one alone; its DriverError, too. Collective.

    For dense work, which every rank would only repeat, with matrices of its own.
    """
    if comm.size == 1:
        return make(*given)
    found = error = None
    if comm.rank == 0:
        try:
            found = make(*given)
        except DriverError as problem:
            error = problem
    found, error = comm.bcast((found, error))
    if error is not None:
        raise error
    return found


def exact_sum(comm, terms: np.ndarray) -> np.ndarray:
    """(k,) sums of the `terms` (n, k) of all ranks, up to 2^21, by whole numbers: in any order.

    To 2^-80 of the largest term. Every rank receives as much, however many terms there are; sums in
    a given order would need all of them. (After Demmel, Nguyen, IEEE Trans. Comput. 64 (2015).)
    """
    top = largest(comm, np.abs(terms).max(axis=0, initial=0.0))
    _, exponent = np.frexp(top)
    scaled = np.ldexp(terms, 40 - exponent)
    high = np.rint(scaled)
    low = np.rint(np.ldexp(scaled - high, 40))
    own = np.array([high.sum(axis=0, dtype=np.int64), low.sum(axis=0, dtype=np.int64)])
    total = np.empty_like(own)
    comm.Allreduce(own, total)
    return np.ldexp(total[0] + np.ldexp(total[1].astype(float), -40), exponent - 40)


def largest(comm, values: np.ndarray) -> np.ndarray:
    """The largest of the ranks' `values`, entry by entry; collective."""
    if comm.size == 1:
        return values
    result = np.empty_like(values)
    comm.Allreduce(np.ascontiguousarray(values), result, op=MPI.MAX)
    return result


def lookup(keys: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of `wanted` in the sorted `keys`, and whether each is there."""
    if not len(keys):
        return np.zeros(wanted.shape, np.int64), np.zeros(wanted.shape, bool)
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return place, keys[place] == wanted
