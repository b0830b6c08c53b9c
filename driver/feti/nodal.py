"""Displacements of some vertices of the body, on every rank, from the fields of the subdomains."""

import numpy as np

from .gathering import gather, joined


class NodalFields:
    """Fields of the subdomains of `structure` at the vertices `gids` (k,), sorted; collective."""

    def __init__(self, structure, gids: np.ndarray, comm):
        self.comm, subs = comm, structure.subdomains
        gid = joined((sub.node_gid for sub in subs), np.int64)
        copies = np.flatnonzero(np.isin(gid, gids))
        start = np.cumsum([0, *(len(sub.node_gid) for sub in subs)])
        owner = np.searchsorted(start, copies, side="right") - 1
        # of the rank: (subdomain, its nodes)
        self._copies = [(s, copies[owner == s] - start[s]) for s in np.unique(owner)]
        self._copied = gather(comm, np.searchsorted(gids, gid[copies]))
        self._count = np.bincount(self._copied)

    def __call__(self, fields: list[np.ndarray]) -> np.ndarray:
        """(k, 2) means of the subdomains' displacements (dofs,) there."""
        own = (fields[s].reshape(-1, 2)[node] for s, node in self._copies)
        copies = gather(self.comm, joined(own, float, 2))  # in the order of subdomains
        return np.column_stack([np.bincount(self._copied, u) for u in copies.T]) / (
            self._count[:, None])
