"""Means over the triangles round a node in its body, where ranks have the bodies in parts."""

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..feti.exchange import Copies, components
from ..feti.gathering import gather, joined, largest
from ..scene import elements


class NodalMeans:
    """Means at the n nodes of the rank's subdomains of values at the corners of their triangles.

    Sums go over the subdomains of a node in their order, each a sum over its triangles: they are
    the same bits on any number of ranks. Collective over `comm`.
    """

    def __init__(self, comm, gid: list[np.ndarray], xy: list[np.ndarray],
                 triangles: list[np.ndarray]):
        """Of every subdomain `gid` and `xy` of its nodes, (n_s,) and (n_s, 2), and its `triangles`
        (n_t, 3 or 6) by positions in these.
        """
        self.comm, self.triangles = comm, triangles
        self._areas = [elements.areas(at[of[:, :3]]) for at, of in zip(xy, triangles)]
        self._gid, self._counts = joined(gid, np.int64), [len(own) for own in gid]
        span = 1 + int(largest(comm, np.array([self._gid.max(initial=-1)]))[0])
        self._copies = Copies(comm, self._gid, span)
        every = self._copies.spread(self._gid)
        self._own = slice(self._copies.below, self._copies.below + len(self._gid))
        self._order = np.argsort(every, kind="stable")
        begins = np.diff(every[self._order], prepend=-1) != 0
        self._first = np.flatnonzero(begins)
        self._node = np.empty(len(every), np.int64)
        self._node[self._order] = np.cumsum(begins) - 1
        self._size = self._sums(lambda s: np.ones((*triangles[s].shape, 1)), 1)

    def __call__(self, corners: Callable[[int], np.ndarray], width: int) -> np.ndarray:
        """(n, width) means of values (n_t, 3, width) at the corners of a subdomain's triangles."""

        def at_nodes(s: int) -> np.ndarray:
            values = corners(s)
            if self.triangles[s].shape[1] == 3:
                return values
            # in the middle of a side it is the mean of both ends
            middles = (values[:, [1, 2, 0]] + values[:, [2, 0, 1]]) / 2
            return np.concatenate([values, middles], axis=1)

        total = self._sums(at_nodes, width)
        total /= np.maximum(self._size, 1e-300)
        return total

    def _sums(self, values: Callable[[int], np.ndarray], width: int) -> np.ndarray:
        """(n, width) sums of `values` (n_t, nodes, width) of a subdomain, weighted with areas."""

        def own(s: int) -> np.ndarray:
            node = self.triangles[s].ravel()
            weighted = (self._areas[s][:, None, None] * values(s)).reshape(-1, width)
            return np.column_stack([np.bincount(node, column, self._counts[s])
                                    for column in weighted.T])

        total = joined(map(own, range(len(self.triangles))), float, width)
        every = self._copies.spread(total)
        if len(every):  # column by column: each takes some copies
            for column, into in zip(every.T, total.T):
                sums = np.add.reduceat(column[self._order], self._first)
                into[:] = sums[self._node[self._own]]
        return total

    def bodies(self) -> list[np.ndarray]:
        """(n_t,) number of the connected body of every triangle, by their smallest nodes.

        Of every subdomain.
        """
        part = self._parts()
        counts = self.comm.allgather(int(part.max(initial=-1)) + 1)
        every = self._copies.spread(part + sum(counts[: self.comm.rank]))
        whole = components(self.comm, every, self._node, sum(counts))
        starts = np.cumsum([0, *self._counts[:-1]]) if self._counts else []
        corners = [of[:, :3] + start for of, start in zip(self.triangles, starts)]
        used = joined((np.unique(of) for of in corners), np.int64)
        body = whole[every[self._own]]
        names, place = np.unique(body[used], return_inverse=True)
        least = np.full(len(names), np.iinfo(np.int64).max)
        np.minimum.at(least, place, self._gid[used])
        least, names = gather(self.comm, np.column_stack([least, names])).T
        names, first = np.unique(names[np.argsort(least)], return_index=True)
        number = np.argsort(np.argsort(first))
        return [number[np.searchsorted(names, body[of[:, 0]])] for of in corners]

    def _parts(self) -> np.ndarray:
        """(n,) number of the connected part of its subdomain that a node belongs to."""
        parts, number = [], 0
        for of, count in zip(self.triangles, self._counts):
            ends = of[:, [0, 1]].ravel(), of[:, [1, 2]].ravel()
            graph = coo_matrix((np.ones(len(ends[0]), bool), ends), (count, count))
            here, label = connected_components(graph, directed=False)
            parts.append(number + label)
            number += here
        return joined(parts, np.int64)
