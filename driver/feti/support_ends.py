"""What a vertex does where labels meet that supports hold each in a way of its own.

Displacements of several numbers on one label are added, as loads are. A vertex of two labels is on
both, and added up it would move as neither: it moves as one of them. FreeFEM, where one declaration
holds both, takes the last.
"""

from dataclasses import dataclass

import numpy as np

from .gathering import gather, lookup

JUMP = 10.0  # times what the displacement changes by along the next edges
WAY = 4  # vertices that tell a jump from a smooth change
SMALL = 1e-6  # part of the largest prescribed displacement that is none
NOTHING = 1e-9  # part of a pattern's largest displacement that is rounding


@dataclass
class Jump:
    """A vertex that moves otherwise than the next ones of a label, along x or y."""

    place: np.ndarray  # (2,)
    component: int
    label: int  # the one that it leaves
    labels: list[int]  # of all that hold it
    size: float  # largest of the history


class SupportEnds:
    """The vertices where labels meet, at least one of which prescribes displacements."""

    def __init__(self, fixed: tuple, skeleton, manifest):
        """`fixed` as `fixed_dofs` of supports.py returns it. Collective."""
        self.keys, self.values = fixed[0], fixed[1].copy()
        self.numbers = np.array([pattern["amplitude"] for pattern in manifest.patterns], int)
        self.factors = manifest.factors
        edges, _ = skeleton.outline
        self.node, at = np.unique(edges[:, :2], return_inverse=True)
        self.at, self.label = at.reshape(-1, 2), edges[:, 2]
        lowest = np.full(len(self.node), np.iinfo(np.int64).max)
        highest = -lowest
        for end in self.at.T:
            np.minimum.at(lowest, end, self.label)
            np.maximum.at(highest, end, self.label)
        self.inner, self.of = lowest == highest, lowest  # vertices of one label, and which
        self.jumps = []
        self.largest = float(np.abs(self.values).max(axis=0, initial=0.0)
                             @ np.abs(self.factors).max(axis=0, initial=0.0))
        self._where(skeleton)
        for component in (0, 1):
            self._settle(component)

    @property
    def fixed(self) -> tuple[np.ndarray, np.ndarray]:
        """As given, but each vertex moves as one of its labels does."""
        return self.keys, self.values

    def _where(self, skeleton) -> None:
        """`place` (nodes, 2) of the vertices where labels meet; collective."""
        own = skeleton.owned & np.isin(skeleton.gids, self.node[~self.inner])
        gids = gather(skeleton.comm, skeleton.gids[own])
        places = gather(skeleton.comm, skeleton.place[own])
        self.place = np.zeros((len(self.node), 2))
        self.place[np.searchsorted(self.node, gids)] = places

    def _settle(self, component: int) -> None:
        """Of what labels that meet say along x or y one is taken, and what of it jumps noted."""
        row, held = lookup(self.keys, 2 * self.node + component)
        moves = np.zeros((len(self.node), len(self.numbers)), bool)
        moves[held] = np.abs(self.values[row[held]]) > NOTHING * np.abs(self.values).max(axis=0)
        of_label = {label: moves[self.inner & held & (self.of == label)].any(axis=0)
                    for label in np.unique(self.of[self.inner & held]).tolist()}
        for label in np.setdiff1d(self.label, self.of[self.inner]).tolist():
            both = np.unique(self.at[self.label == label])  # no vertex is its own: what its ends do
            if held[both].all():
                of_label[label] = moves[both].all(axis=0)
        ends = np.flatnonzero(~self.inner & held & moves.any(axis=1))
        for vertex in ends:
            labels = np.unique(self.label[(self.at == vertex).any(axis=1)]).tolist()
            holding = [label for label in labels if label in of_label]
            if not any((of_label[label] >= moves[vertex]).all() for label in holding):
                self._take_one(row[vertex], [of_label[label] for label in holding])
        for vertex in ends:
            self._compare(vertex, component, row, held)

    def _take_one(self, row: int, sets: list[np.ndarray]) -> None:
        """Of the labels' sets of patterns that with the highest number of a displacement."""
        own = self.values[row] != 0
        sets = [patterns for patterns in sets if (patterns & own).any()]
        if sets:
            last = max(sets, key=lambda patterns: self.numbers[patterns & own].max())
            self.values[row, ~last] = 0.0

    def _compare(self, vertex: int, component: int, row: np.ndarray, held: np.ndarray) -> None:
        """Note the labels along which the next vertices move otherwise."""
        mine = np.flatnonzero((self.at == vertex).any(axis=1))
        for edge in mine:
            way = self._way(vertex, edge)
            if len(way) < WAY or not held[way].all():
                continue
            moves = self.values[row[way]] @ self.factors.T
            step, *next_ones = np.abs(np.diff(moves, axis=0)).max(axis=1)
            if step > max(JUMP * max(next_ones), SMALL * self.largest):
                self.jumps.append(Jump(self.place[vertex], component, int(self.label[edge]),
                                       np.unique(self.label[mine]).tolist(), float(step)))

    def _way(self, vertex: int, edge: int) -> list[int]:
        """Vertices of one label from `vertex` on, the first `edge` being given: WAY at most."""
        way = [vertex]
        while edge is not None:
            way.append(int(self.at[edge].sum()) - way[-1])
            beyond = [k for k in np.flatnonzero((self.at == way[-1]).any(axis=1)) if k != edge]
            inside = len(way) < WAY and self.inner[way[-1]] and len(beyond) == 1
            edge = beyond[0] if inside else None
        return way
