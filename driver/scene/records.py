"""Records of an export: counted arrays, one after the other, in the order written by ``edp/lib/export.idp``.

Each array is an int64 count followed by its raw int64 or float64 values. Consecutive records with arrays of the same
sizes are read together, as one array each of shape (records, count).
"""

import itertools
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from . import elements, seal
from .manifest import Manifest

STACK = 1 << 19  # words that are read together


class Head(NamedTuple):
    """What a record begins with: the number of its subdomain, and sizes."""

    number: int
    nodes: int
    triangles: int
    edges: int
    dofs: int
    entries: int  # of the stiffness; none where that is in shared.bin
    patterns: int
    fixed: int
    contact: int


Layout = list[tuple[object, int, type]]  # of every array its name, count and type
HEAD = ("head", len(Head._fields), np.int64)


def record_layout(head: Head, manifest: Manifest) -> Layout:
    """The arrays of a record; names of those that belong to a load pattern end with its number."""
    found = [HEAD, ("gid", head.nodes, np.int64), *places_layout(head), ("edge_label", head.edges, np.int64)]
    if head.entries:
        found += piece_layout(head, manifest)
    found += [(("load", k), head.dofs, np.float64) for k in range(head.patterns)]
    found += [("fixed", head.fixed, np.int64)]
    for k, pattern in enumerate(manifest.patterns):
        found += [((name, k), count, np.float64) for name, count in pattern_layout(pattern["given_on"], head, manifest)]
    found += [(("field", name), head.nodes, np.float64) for name in manifest.fields]
    if head.contact:
        found += [("node", head.contact, np.int64), ("label", head.contact, np.int64)]
        found += contact_layout(head.contact, manifest)
    return found


def pattern_layout(given_on: str, head: Head, manifest: Manifest) -> list[tuple[str, int]]:
    """Names and counts of what a record holds of a load besides nodal forces: ``edp/lib/given/<given_on>.idp``."""
    if given_on == "edges" and manifest.element == "P1":
        return [("edge_load", 4 * head.edges)]
    if given_on == "triangles" and manifest.element == "P1":
        return [(f"body_load_{factor}", 2 * head.triangles) for factor in "1xy"]
    if given_on == "initial_stress":
        return [(f"suppressed_{row}", _moments(manifest) * head.triangles) for row in ("11", "22", "12")]
    if given_on == "supports":
        return [("fixed_value", max(1, head.fixed))]
    return []


def places_layout(head: Head) -> Layout:
    """Coordinates of the nodes."""
    return [("x", head.nodes, np.float64), ("y", head.nodes, np.float64)]


def piece_layout(head: Head, manifest: Manifest) -> Layout:
    """What subdomains cut alike have in common: mesh but for the places, elasticity, stiffness."""
    moments = _moments(manifest) * head.triangles
    integers = lambda **counts: [(name, count, np.int64) for name, count in counts.items()]
    numbers = lambda **counts: [(name, count, np.float64) for name, count in counts.items()]
    return [*integers(elements=elements.NODES[manifest.element] * head.triangles, region=head.triangles, edges=2 * head.edges),
            *numbers(**dict.fromkeys(moduli(manifest), moments), dof_coordinate=head.dofs, is_x=head.dofs),
            *integers(rows=head.entries, columns=head.entries), *numbers(values=head.entries)]


def contact_layout(count: int, manifest: Manifest) -> Layout:
    """Numbers of `count` contact nodes: weight, normal and the columns of declared effects."""
    found = [(name, count, np.float64) for name in ("weight", "normal_x", "normal_y")]
    return found + [(("column", name), count, np.float64) for name in manifest.columns]


def moduli(manifest: Manifest) -> tuple[str, ...]:
    """Names of the arrays that tell the elasticity."""
    return ("lambda", "mu") if manifest.material == "isotropic" else ("c11", "c12", "c13", "c22", "c23", "c33")


def _moments(manifest: Manifest) -> int:
    """Numbers per triangle that stand for a function."""
    return 1 if manifest.element == "P1" else 3


class RecordFile:
    """Sequential reader of one sealed file."""

    def __init__(self, path: Path, sealed: seal.Seal):
        self.path, self.at = path, 0
        content = seal.check(sealed, path)
        if len(content) % 8:
            raise InputError(f"{path} is truncated: its size is not a multiple of 8 bytes")
        self.words = np.frombuffer(content, np.int64)

    @property
    def ended(self) -> bool:
        return self.at == len(self.words)

    def head(self) -> Head:
        """The head of the record that comes next."""
        found = self.words[self.at : self.at + 1 + len(Head._fields)].tolist()
        if len(found) <= len(Head._fields) or found[0] != len(Head._fields):
            self._refuse_counts(self.words[None, self.at :], [0], [len(Head._fields)])
        return Head(*found[1:])

    def alike(self, head: Head, layout: Layout) -> int:
        """How many records that follow have the sizes of the next one, one at least and no more than STACK has room for."""
        size = _words(layout)
        most = min(STACK // size + 1, (len(self.words) - self.at) // size)
        sizes = np.array([len(head), *head[1:]])
        differs = lambda heads: (heads[:, [0, *range(2, 1 + len(head))]] != sizes).any(axis=1)
        if most < 2 or differs(self.words[None, self.at + size : self.at + size + 1 + len(head)])[0]:
            return 1
        others = differs(self.words[self.at : self.at + most * size].reshape(most, size)[:, : 1 + len(head)])
        return int(np.argmax(others)) if others.any() else most

    def stack(self, layout: Layout, records: int = 1) -> dict:
        """The arrays (records, count) of the next records by name; float64 ones must be finite."""
        size = _words(layout)
        table = self.words[self.at : self.at + records * size]
        table = table.reshape(records, size) if records > 1 else table[None]  # which may lack its end
        counts = [count for _, count, _ in layout]
        starts = [0, *itertools.accumulate(1 + count for count in counts)]
        if table.shape[1] < size or (table[:, starts[:-1]] != counts).any():
            self._refuse_counts(table, starts, counts)
        # whole numbers are finite as well if they are seen as float64, unless they are absurd or negative
        finite = np.isfinite(table.view(np.float64)).all()
        found = {}
        for (name, count, kind), start in zip(layout, starts):
            found[name] = values = np.array(table[:, start + 1 : start + 1 + count]).view(kind)
            if not finite and kind is np.float64 and not np.isfinite(values).all():
                record = int(np.argmin(np.isfinite(values).all(axis=1)))
                raise InputError(f"{self.path}: a number that is not finite in the array at word "
                                 f"{self.at + record * size + start + 1}")
        self.at += records * size
        return found

    def _refuse_counts(self, table: np.ndarray, starts: list[int], counts: list[int]) -> None:
        """Raises InputError for the first array that is not all there, or has another count."""
        for start, count in zip(starts, counts):
            if start + 1 + count > table.shape[1]:
                raise InputError(f"{self.path} is truncated: {count} more numbers expected at word {self.at + start}")
            wrong = table[:, start] != count
            if wrong.any():
                record = int(np.argmax(wrong))
                raise InputError(f"{self.path}: an array of {count} numbers expected at word "
                                 f"{self.at + record * table.shape[1] + start}, found a count of {table[record, start]}")


def _words(layout: Layout) -> int:
    return sum(1 + count for _, count, _ in layout)
