"""Pieces of fields: ranges of subdomains, the same on any number of ranks, each with a writer.

The rank that has the first subdomain of a piece writes it. Ranks send one another what is written
in turns, in each of which a rank writes one piece at most: what is on its way is no more than that.
"""

from collections.abc import Callable

import numpy as np

from ..feti.exchange import exchange
from ..feti.gathering import joined

PIECE = 100_000  # points of a piece, roughly

Layout = dict[str, tuple]  # type and widths of arrays by name


class Pieces:
    """`count` pieces, of which this rank writes `own`, one in each of `turns`; collective.

    `points` and `triangles` (subdomains,) are how many the rank's subdomains have.
    """

    def __init__(self, comm, first: int, total: int, points: np.ndarray, triangles: np.ndarray):
        """The rank has the subdomains from `first` on, of all `total`."""
        self.comm, self.points, self.triangles = comm, points, triangles
        size = comm.allreduce(int(points.sum()))
        self.count = min(total, max(1, round(size / PIECE)))
        starts = total * np.arange(self.count) // self.count
        self._writer = ((starts + 1) * comm.size - 1) // total  # see structure.partition
        self._turn = np.arange(self.count) - np.searchsorted(self._writer, self._writer)
        self.own, self.turns = np.flatnonzero(self._writer == comm.rank), self._turn.max() + 1
        self._piece = np.searchsorted(starts, first + np.arange(len(points)), side="right") - 1
        own = np.bincount(self._piece, triangles, self.count).astype(np.int64)
        self._ends = np.append(0, np.cumsum(comm.allreduce(own)))

    def received(self, turn: int, rows: np.ndarray, layout: Layout,
                 made: Callable[[int], dict]) -> dict[str, np.ndarray]:
        """Arrays of the piece that this rank writes in a `turn`, by name; empty if there is none.

        `made` gives those of a local subdomain, each of as many `rows` (subdomains,) as it has
        points or triangles.
        """
        here = np.flatnonzero(self._turn[self._piece] == turn)
        parts = [made(s) for s in here]
        to = np.repeat(self._writer[self._piece[here]], rows[here])
        tables = (joined((part[name] for part in parts), *kind) for name, kind in layout.items())
        return dict(zip(layout, exchange(self.comm, to, *tables)[1:]))

    def scattered(self, turn: int, values: np.ndarray | None) -> np.ndarray:
        """The same of `values` (n_t,) of all triangles, which rank 0 has."""
        to, parts = np.empty(0, np.int64), []
        if self.comm.rank == 0:
            here = np.flatnonzero(self._turn == turn)
            parts = [values[self._ends[piece] : self._ends[piece + 1]] for piece in here]
            to = np.repeat(self._writer[here], [len(part) for part in parts])
        return exchange(self.comm, to, joined(parts, float))[1]
