"""Records of an export: counted arrays in the order in which ``edp/lib/export.idp`` writes them.

Each array is an int64 count followed by its raw int64 or float64 values. Consecutive records with
arrays of the same sizes are read together, as one array each of shape (records, count).
"""

import itertools
import os
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from . import element_kinds, seal
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
    layout = [HEAD, ("gid", head.nodes, np.int64), *places_layout(head),
              ("edge_label", head.edges, np.int64)]
    if head.entries:
        layout += piece_layout(head, manifest)
    layout += [(("load", k), head.dofs, np.float64) for k in range(head.patterns)]
    layout += [("fixed", head.fixed, np.int64)]
    for k, pattern in enumerate(manifest.patterns):
        for name, count in pattern_layout(pattern["given_on"], head, manifest):
            layout.append(((name, k), count, np.float64))
    layout += [(("field", name), head.nodes, np.float64) for name in manifest.fields]
    if head.contact:
        layout += [("node", head.contact, np.int64), ("label", head.contact, np.int64)]
        layout += contact_layout(head.contact, manifest)
    return layout


def pattern_layout(given_on: str, head: Head, manifest: Manifest) -> list[tuple[str, int]]:
    """Names and counts of what a record holds of a load besides nodal forces.

    ``edp/lib/given/<given_on>.idp`` writes them.
    """
    if given_on == "edges":
        moments = [("edge_load", 4 * head.edges)] if manifest.element == "P1" else []
        return [*moments, ("unseen", 1)]
    if given_on == "triangles" and manifest.element == "P1":
        return [(f"body_load_{factor}", 2 * head.triangles) for factor in "1xy"]
    if given_on == "initial_stress":
        count = _moments(manifest) * head.triangles
        return [(f"suppressed_{row}", count) for row in ("11", "22", "12")]
    if given_on == "supports":
        return [("fixed_value", max(1, head.fixed))]
    return []


def places_layout(head: Head) -> Layout:
    """Coordinates of the nodes."""
    return [("x", head.nodes, np.float64), ("y", head.nodes, np.float64)]


def piece_layout(head: Head, manifest: Manifest) -> Layout:
    """What subdomains cut alike have in common: mesh but for the places, elasticity, stiffness."""
    moments = _moments(manifest) * head.triangles
    return [("elements", element_kinds.NODES[manifest.element] * head.triangles, np.int64),
            ("region", head.triangles, np.int64), ("edges", 2 * head.edges, np.int64),
            *((name, moments, np.float64) for name in moduli(manifest)),
            ("dof_coordinate", head.dofs, np.float64), ("is_x", head.dofs, np.float64),
            ("rows", head.entries, np.int64), ("columns", head.entries, np.int64),
            ("values", head.entries, np.float64)]


def contact_layout(count: int, manifest: Manifest) -> Layout:
    """Numbers of `count` contact nodes: weight, normal and the columns of declared effects."""
    layout = [(name, count, np.float64) for name in ("weight", "normal_x", "normal_y")]
    return layout + [(("column", name), count, np.float64) for name in manifest.columns]


def moduli(manifest: Manifest) -> tuple[str, ...]:
    """Names of the arrays that hold the elasticity."""
    if manifest.material == "isotropic":
        return ("lambda", "mu")
    return ("c11", "c12", "c13", "c22", "c23", "c33")


def _moments(manifest: Manifest) -> int:
    """Numbers per triangle that stand for a function."""
    return 1 if manifest.element == "P1" else 3


class Records:
    """Sequential reader of records: `position` is the number of `words` that are read."""

    def __init__(self, path: Path, words: np.ndarray):
        """`words` (n,) are those of the file `path`, or some of them."""
        self.path, self.words, self.position = path, words, 0

    @property
    def ended(self) -> bool:
        """Whether the last record has been read."""
        return self.position == len(self.words)

    def head(self) -> Head:
        """The head of the record that comes next."""
        fields = len(Head._fields)
        words = self.words[self.position : self.position + 1 + fields].tolist()
        if len(words) <= fields or words[0] != fields:
            self._refuse_counts(self.words[None, self.position :], [0], [fields])
        return Head(*words[1:])

    def alike(self, head: Head, layout: Layout) -> int:
        """How many of the next records have the sizes of the first of them.

        That is one at least, and no more than STACK has room for.
        """
        size, start = _words(layout), self.position
        most = min(STACK // size + 1, (len(self.words) - start) // size)
        sizes = np.array([len(head), *head[1:]])
        compared = [0, *range(2, 1 + len(head))]  # all but the number of the subdomain

        def differ(heads: np.ndarray) -> np.ndarray:
            return (heads[:, compared] != sizes).any(axis=1)

        if most < 2 or differ(self.words[None, start + size : start + size + 1 + len(head)])[0]:
            return 1
        table = self.words[start : start + most * size].reshape(most, size)
        others = differ(table[:, : 1 + len(head)])
        return int(np.argmax(others)) if others.any() else most

    def stack(self, layout: Layout, records: int = 1) -> dict:
        """The arrays (records, count) of the next records by name; float64 ones must be finite."""
        size = _words(layout)
        table = self.words[self.position : self.position + records * size]
        # a single record may lack its end
        table = table.reshape(records, size) if records > 1 else table[None]
        counts = [count for _, count, _ in layout]
        starts = [0, *itertools.accumulate(1 + count for count in counts)]
        if table.shape[1] < size or (table[:, starts[:-1]] != counts).any():
            self._refuse_counts(table, starts, counts)
        # whole numbers seen as float64 are finite as well, unless they are absurd or negative
        finite = np.isfinite(table.view(np.float64)).all()
        arrays = {}
        for (name, count, kind), start in zip(layout, starts):
            arrays[name] = values = np.array(table[:, start + 1 : start + 1 + count]).view(kind)
            if not finite and kind is np.float64 and not np.isfinite(values).all():
                record = int(np.argmin(np.isfinite(values).all(axis=1)))
                raise InputError(f"{self.path}: a number that is not finite in the array at word "
                                 f"{self.position + record * size + start + 1}")
        self.position += records * size
        return arrays

    def _refuse_counts(self, table: np.ndarray, starts: list[int], counts: list[int]) -> None:
        """Raises InputError for the first array that is not all there, or has another count."""
        for start, count in zip(starts, counts):
            if start + 1 + count > table.shape[1]:
                raise InputError(f"{self.path} is truncated: {count} more numbers expected at word "
                                 f"{self.position + start}")
            wrong = table[:, start] != count
            if wrong.any():
                record = int(np.argmax(wrong))
                word = self.position + record * table.shape[1] + start
                raise InputError(f"{self.path}: an array of {count} numbers expected at word "
                                 f"{word}, found a count of {table[record, start]}")


class RecordFile(Records):
    """One sealed file."""

    def __init__(self, path: Path, sealed: seal.Seal):
        """Raises InputError where the file is not what the seal says."""
        content = seal.check(sealed, path)
        if len(content) % 8:
            raise InputError(f"{path} is truncated: its size is not a multiple of 8 bytes")
        super().__init__(path, np.frombuffer(content, np.int64))
        self._sealed = sealed.files[path.name]

    def check_of(self, words: int) -> int:
        """CRC-32 of the first `words`, as `GrowingFile.check`: of all of them the seal has it."""
        size, check = self._sealed
        return check if 8 * words == size else seal.measure(self.path, most=8 * words)[1]


class GrowingFile:
    """A file that FreeFEM is writing: record after record, once it is whole.

    `words` and `check` are the number and the CRC-32 of those that were read.
    """

    def __init__(self, path: Path):
        self.path, self.words, self.check = path, 0, 0

    def head(self) -> Head | None:
        """The head of the next record. Raises InputError where it is none."""
        words = self._next(1 + len(Head._fields))
        return None if words is None else Records(self.path, words).head()

    def record(self, layout: Layout) -> Records | None:
        """The next record, which counts as read then."""
        words = self._next(_words(layout))
        if words is None:
            return None
        self.words, self.check = self.words + len(words), zlib.crc32(words, self.check)
        return Records(self.path, words)

    def _next(self, count: int) -> np.ndarray | None:
        """(count,) words that come next; None as long as there are fewer."""
        try:
            with open(self.path, "rb") as file:
                if os.fstat(file.fileno()).st_size < 8 * (self.words + count):
                    return None
                file.seek(8 * self.words)
                words = np.fromfile(file, np.int64, count)
        except FileNotFoundError:
            return None
        return words if len(words) == count else None


def _words(layout: Layout) -> int:
    return sum(1 + count for _, count, _ in layout)
