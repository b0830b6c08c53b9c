"""Means over the triangles round a node in its body, where ranks have the bodies in parts."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..feti.exchange import Copies, components
from ..feti.gathering import gather, largest
from ..scene import elements


class NodalMeans:
    """Means at the n nodes of the rank's subdomains of values at the corners of n_t triangles.

    Sums go over the subdomains of a node in their order, each a sum over its triangles: they are
    the same bits on any number of ranks. `xy` (n, 2). Collective over `comm`.
    """

    def __init__(self, comm, gid: np.ndarray, xy: np.ndarray, triangles: np.ndarray):
        """`gid` (n,) in the order of subdomains, `triangles` (n_t, 3 or 6) by positions in it."""
        self.comm, self.xy, self.triangles = comm, xy, triangles
        span = 1 + int(largest(comm, np.array([gid.max(initial=-1)]))[0])
        self._copies = Copies(comm, gid, span)
        every = self._copies.spread(gid)
        self._own = slice(self._copies.below, self._copies.below + len(gid))
        self._order = np.argsort(every, kind="stable")
        self._first = np.flatnonzero(np.diff(every[self._order], prepend=-1))
        self._node = np.empty(len(every), np.int64)
        self._node[self._order] = np.cumsum(np.diff(every[self._order], prepend=-1) != 0) - 1
        self._gid = gid
        self._weight = np.repeat(elements.areas(xy[triangles[:, :3]]), triangles.shape[1])
        self._size = self._sums(np.ones((len(self._weight), 1)))

    def __call__(self, corners: np.ndarray) -> np.ndarray:
        """(n, k) means of values (n_t, 3, k) at the corners of the triangles."""
        values = corners
        if self.triangles.shape[1] == 6:  # in the middle of a side it is the mean of both ends
            middles = (corners[:, [1, 2, 0]] + corners[:, [2, 0, 1]]) / 2
            values = np.concatenate([corners, middles], axis=1)
        total = self._sums(values.reshape(-1, corners.shape[2]))
        return total / np.maximum(self._size, 1e-300)

    def _sums(self, values: np.ndarray) -> np.ndarray:
        """(n, k) sums of `values` (n_t nodes, k), weighted with areas."""
        node = self.triangles.ravel()
        own = np.column_stack([np.bincount(node, self._weight * column, len(self._gid))
                               for column in values.T])
        every = self._copies.spread(own)[self._order]
        if not len(every):
            return own
        return np.add.reduceat(every, self._first)[self._node[self._own]]

    def bodies(self) -> np.ndarray:
        """(n_t,) number of the connected body of every triangle, by their smallest nodes."""
        corners, count = self.triangles[:, :3], len(self._gid)
        ends = corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel()
        graph = coo_matrix((np.ones(len(ends[0]), bool), ends), (count, count))
        part = connected_components(graph, directed=False)[1]
        counts = self.comm.allgather(int(part.max(initial=-1)) + 1)
        every = self._copies.spread(part + sum(counts[: self.comm.rank]))
        whole = components(self.comm, every, self._node, sum(counts))
        body, used = whole[every[self._own]], np.unique(corners)
        names, place = np.unique(body[used], return_inverse=True)
        least = np.full(len(names), np.iinfo(np.int64).max)
        np.minimum.at(least, place, self._gid[used])
        least, names = gather(self.comm, np.column_stack([least, names])).T
        names, first = np.unique(names[np.argsort(least)], return_index=True)
        return np.argsort(np.argsort(first))[np.searchsorted(names, body[corners[:, 0]])]
