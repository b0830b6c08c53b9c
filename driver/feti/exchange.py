"""What ranks tell one another directly: rows of tables, and values at the nodes that they share.

Ranks find those that they share something with at a place that both know, the rank that keeps a
range of keys (a rendezvous): no rank ever holds what all of them have.
"""

import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .gathering import gather


def exchange(comm, to: np.ndarray, *tables: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows of `tables` (n, ...) that other ranks send here, each to the rank `to` (n,) of a row.

    First the ranks (m,) that they come from, then the tables (m, ...): in rank order, then in the
    order in which they were sent. Collective over `comm`.
    """
    if comm.size == 1:
        return to, *tables
    sent, received = np.bincount(to, minlength=comm.size), np.empty(comm.size, np.int64)
    comm.Alltoall(sent, received)
    order = np.argsort(to, kind="stable")
    return np.repeat(np.arange(comm.size), received), *(
        exchanged(comm, table[order], sent, received) for table in tables)


def exchanged(comm, table: np.ndarray, sent: np.ndarray, received: np.ndarray) -> np.ndarray:
    """Rows from all ranks for rows of `table` in the order of the ranks that they go to."""
    result = np.empty((received.sum(), *table.shape[1:]), table.dtype)
    width = int(np.prod(table.shape[1:]))
    layouts = [((counts * width).tolist(),
                (width * (np.cumsum(counts) - counts)).tolist()) for counts in (sent, received)]
    comm.Alltoallv((np.ascontiguousarray(table), layouts[0]), (result, layouts[1]))
    return result


def sharers(comm, keys: np.ndarray, span: int) -> np.ndarray:
    """(n, 2) position in `keys` and rank: all the other ranks that have one of the rank's keys.

    `keys` are distinct, 0 <= key < span. Sorted by rank, then position. Collective over `comm`.
    """
    if comm.size == 1:
        return np.empty((0, 2), np.int64)
    source, key = exchange(comm, keys * comm.size // span, keys)
    order = np.argsort(key, kind="stable")
    source, key = source[order], key[order]
    pairs, apart = [np.empty((0, 3), np.int64)], 0
    while True:  # ranks that have a key, one after the other, in pairs
        apart += 1
        same = np.flatnonzero(key[apart:] == key[:-apart])
        if not len(same):
            break
        one, two = source[same], source[same + apart]
        pairs += [np.column_stack([one, key[same], two]), np.column_stack([two, key[same], one])]
    pairs = np.concatenate(pairs)
    _, known = exchange(comm, pairs[:, 0], pairs[:, 1:])
    order = np.argsort(keys)
    known[:, 0] = order[np.searchsorted(keys[order], known[:, 0])]
    return known[np.lexsort(known.T)]


class Copies:
    """Values of entries of this rank beside those of the copies that other ranks have of them.

    Collective over `comm`.
    """

    def __init__(self, comm, keys: np.ndarray, span: int):
        """`keys` (n,) of the rank's entries, 0 <= key < span; copies have the same key."""
        self.comm = comm
        if comm.size == 1:
            return
        distinct, entry = np.unique(keys, return_inverse=True)
        shared = sharers(comm, distinct, span)
        order = np.argsort(entry, kind="stable")
        first = np.searchsorted(entry[order], np.arange(len(distinct) + 1))
        count = np.diff(first)[shared[:, 0]]
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        entries = order[np.repeat(first[shared[:, 0]], count) + within]
        to = np.repeat(shared[:, 1], count)
        order = np.lexsort((entries, to))
        self.to, self.entries = to[order], entries[order]  # what goes where
        self._sent = np.bincount(to, minlength=comm.size)
        self._received = np.empty(comm.size, np.int64)
        comm.Alltoall(self._sent, self._received)
        self._below = int(self._received[: comm.rank].sum())

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values of all entries: of lower ranks, the rank's own (n, ...), of higher ranks."""
        if self.comm.size == 1:
            return values
        others = exchanged(self.comm, values[self.entries], self._sent, self._received)
        return np.concatenate([others[: self._below], values, others[self._below :]])

    @property
    def below(self) -> int:
        """How many copies lower ranks have."""
        return 0 if self.comm.size == 1 else self._below


def components(comm, items: np.ndarray, groups: np.ndarray, total: int) -> np.ndarray:
    """(total,) the connected component of every item, on every rank; collective over `comm`.

    The rank knows that its `items` (n,), 0 <= item < total, of the same one of its `groups` (n,)
    are connected.
    """
    label = _components(items, groups, total)
    if comm.size == 1:
        return label
    pairs = np.unique(items)
    pairs = np.column_stack([pairs, label[pairs]])
    counts = comm.allgather(int(label.max(initial=-1)) + 1)
    pairs[:, 1] += sum(counts[: comm.rank])
    return _components(*gather(comm, pairs).T, total)


def _components(items: np.ndarray, groups: np.ndarray, total: int) -> np.ndarray:
    """The same of one rank."""
    size = total + int(groups.max(initial=-1)) + 1
    links = coo_matrix((np.ones(len(items)), (items, total + groups)), shape=(size, size))
    return connected_components(links, directed=False)[1][:total]


class Route:
    """Values that go from rank to rank by the same way again and again. Collective over `comm`."""

    def __init__(self, comm, to: np.ndarray):
        """`to` (n,): the rank that each of this rank's entries goes to."""
        self._stays = not comm.allreduce(bool(np.any(to != comm.rank)))
        if self._stays:  # on all ranks
            return
        self._order = np.argsort(to, kind="stable")
        sent, received = np.bincount(to, minlength=comm.size), np.empty(comm.size, np.int64)
        comm.Alltoall(sent, received)
        sources, targets = np.flatnonzero(received), np.flatnonzero(sent)
        self._counts = sent[targets], received[sources]
        self._others = sources != comm.rank
        graph = sources.tolist(), targets.tolist()
        self._there = comm.Create_dist_graph_adjacent(*graph, reorder=False)
        self._back = comm.Create_dist_graph_adjacent(*graph[::-1], reorder=False)

    def forward(self, values: np.ndarray) -> np.ndarray:
        """(m,) what has come here, in rank order, then as sent, for `values` (n,) of entries."""
        if self._stays:
            return values
        return _to_neighbours(self._there, values[self._order], *self._counts)

    def backward(self, values: np.ndarray) -> np.ndarray:
        """(n,) `values` (m,) of what has come here, sent back to where it came from."""
        if self._stays:
            return values
        result = np.empty(len(self._order), values.dtype)
        result[self._order] = _to_neighbours(self._back, values, *self._counts[::-1])
        return result

    @property
    def size(self) -> int:
        """Entries that come here from other ranks."""
        return 0 if self._stays else int(self._counts[1][self._others].sum())

    @property
    def neighbours(self) -> int:
        """Other ranks that entries come from."""
        return 0 if self._stays else int(self._others.sum())


def _to_neighbours(graph, values: np.ndarray, sent: np.ndarray,
                   received: np.ndarray) -> np.ndarray:
    """What the neighbours in a `graph` of ranks send, for `values` in the order of ranks."""
    result = np.empty(received.sum(), values.dtype)
    layouts = [(counts.tolist(), (np.cumsum(counts) - counts).tolist())
               for counts in (sent, received)]
    graph.Neighbor_alltoallv((np.ascontiguousarray(values), layouts[0]), (result, layouts[1]))
    return result


class Handover:
    """Arrays that one rank has and another one, or itself, takes up later, by a number of theirs.

    Nobody waits to give, and what is taken has been given under the same number before, or will be
    by another rank. `finish` before a number is given again.
    """

    def __init__(self, comm):
        self.comm = comm
        self._kept, self._sent = {}, []

    def give(self, number: int, to: int, *arrays: np.ndarray) -> None:
        """Leave `arrays`, which stay as they are, to the rank `to`."""
        if to == self.comm.rank:
            self._kept[number] = arrays
            return
        self._sent += [self.comm.Isend(np.ascontiguousarray(array), int(to), tag=int(number))
                       for array in arrays]

    def taken(self, number: int, source: int, *into: np.ndarray) -> tuple[np.ndarray, ...]:
        """The arrays that the rank `source` gives; those of other ranks are put `into` these."""
        if source == self.comm.rank:
            return self._kept.pop(number)
        for array in into:
            self.comm.Recv(array, int(source), tag=int(number))
        return into

    def finish(self) -> None:
        """Wait until all has been taken."""
        MPI.Request.Waitall(self._sent)
        self._sent = []
