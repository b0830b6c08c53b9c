"""What the figures are drawn from: the tables and fields that a run left, read again."""

import json
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import read_fields, read_table, whole
from ..text import called

TABLES = ("history", "contact", "convergence", "boundary", "adaptivity", "probes",
          "obstacle", "cycles")
QUARTERS = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]  # of a six-node triangle in VTK's order


@dataclass
class Mesh:
    """Torn mesh of one step: points, triangles (m, 3), displacement (n, 2), averaged stress (n,).

    Of quadratic elements, vertices `corners` (e, 3), the triangles are the four that the middles of
    their sides make. `body` and `region` (m,) are numbers, `shear_modulus` (m,) is None where it is
    the same everywhere.
    """

    time: float
    xy: np.ndarray
    triangles: np.ndarray
    displacement: np.ndarray
    von_mises: np.ndarray
    body: np.ndarray
    region: np.ndarray
    corners: np.ndarray
    degree: int  # of the displacements
    shear_modulus: np.ndarray | None = None

    def rim(self):
        """Edges (e, 2) of the subdomain boundaries and the corner (e,) of each triangle inside."""
        i, j, k = self.triangles.T
        pairs = np.concatenate([np.column_stack(c) for c in ((i, j), (j, k), (k, i))])
        keys = np.sort(pairs, axis=1) @ [len(self.xy), 1]
        _, first, count = np.unique(keys, return_index=True, return_counts=True)
        once = first[count == 1]
        return pairs[once], np.concatenate([k, i, j])[once]


@dataclass
class Run:
    """All that the figures are drawn from. Tables are dicts of columns, None where missing."""

    summary: dict
    history: dict
    contact: dict | None
    convergence: dict | None
    boundary: dict | None
    first: Mesh | None
    # at the time of the quantities: the end or, where contact is lost by then, its peak
    last: Mesh | None
    adaptivity: dict | None = None
    probes: dict | None = None
    cycles: dict | None = None
    obstacle: dict | None = None

    @property
    def quasistatic(self) -> bool:
        """Whether loads have a history in time steps."""
        return self.summary["effects"]["time"] == "quasistatic"

    def label_name(self, label: int) -> str:
        """A label, with its name if a gmsh file gives it one, for text with formulas."""
        names = self.summary.get("label_names") or {}
        return str(called(label, names.get(str(label)))).replace("$", r"\$")

    @property
    def friction(self) -> bool:
        """Whether the scene declares friction."""
        return self.summary["effects"]["friction"] != "none"

    @property
    def fixed_point(self) -> bool:
        """Does the bound depend on the solution, so that a fixed point is sought in every step?"""
        return self.summary["effects"]["friction"].startswith("coulomb")

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return Path(self.summary["scene"]).stem

    def at(self, time: float) -> str:
        """Words that name a time, none of static runs."""
        return f" at $t = {time:.4g}$" if self.quasistatic else ""


def read_mesh(path: Path, time: float) -> Mesh:
    """One .vtu of a run."""
    data = read_fields(path)
    kind, = data.cells_dict
    nodes = data.cells_dict[kind].astype(np.int64)
    if "stress" not in data.point_data:
        raise InputError(f"{path} was written by an earlier version: run the scene again")
    xx, yy, zz, xy = data.point_data["stress"].T
    mises = np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * xy**2)
    parts = QUARTERS if kind == "triangle6" else [[0, 1, 2]]
    cells = {name: np.repeat(values[kind].ravel(), len(parts))
             for name, values in data.cell_data_dict.items()
             if name in ("body", "region", "shear_modulus")}
    return Mesh(time, data.points[:, :2], nodes[:, parts].reshape(-1, 3),
                data.point_data["displacement"][:, :2], mises, cells["body"], cells["region"],
                nodes[:, :3], 2 if kind == "triangle6" else 1, cells.get("shear_modulus"))


def field_files(directory: Path) -> list[tuple[float, Path]]:
    """Time and file of every step that fields.pvd names, in their order."""
    path = directory / "fields.pvd"
    if not path.exists():
        return []
    with whole(path):
        return [(float(entry.get("timestep")), directory / entry.get("file"))
                for entry in ElementTree.parse(path).iter("DataSet")]


def read_run(directory: Path) -> Run:
    """Read a run directory; raises InputError if it is not one."""
    for name in ("summary.json", "history.csv"):
        if not (directory / name).exists():
            raise InputError(f"{directory} holds no {name}: run the scene before drawing it")
    summary = json.loads((directory / "summary.json").read_text())
    first = last = None
    if sets := field_files(directory):
        wanted = summary.get("quantities_time", max(sets)[0])
        nearest = min(sets, key=lambda entry: abs(entry[0] - wanted))
        first, last = (read_mesh(path, time) for time, path in (min(sets), nearest))
    tables = {name: read_table(directory / f"{name}.csv") for name in TABLES}
    if tables["contact"]:
        revolved = summary["effects"].get("axisymmetric", False)
        tables["contact"]["length"] = _lengths(tables["contact"], revolved)
    return Run(summary, first=first, last=last, **tables)


def _lengths(contact: dict, revolved: bool) -> np.ndarray:
    """(rows,) lengths of the nodes' dual segments; of bodies of revolution the weights are areas.

    There they are half the distance between a node's neighbours.
    """
    if not revolved:
        return contact["weight"]
    length = np.zeros(len(contact["arc"]))
    keys = np.column_stack([contact["step"], contact.get("boundary", 0 * length)])
    for key in np.unique(keys, axis=0):
        rows = np.flatnonzero((keys == key).all(axis=1))
        rows = rows[np.argsort(contact["arc"][rows])]
        half = np.diff(contact["arc"][rows]) / 2
        length[rows[:-1]] += half
        length[rows[1:]] += half
    return length


def select(table: dict, rows) -> dict:
    """The rows of a table picked by a mask or an index array."""
    return {name: column[rows] for name, column in table.items()}


def contact_boundaries(contact: dict) -> list[tuple[int, dict]]:
    """(label, rows sorted by step and arc) of the contact boundaries; an unnamed one is 0."""
    label = contact.get("boundary", np.zeros(len(contact["step"])))
    order = np.lexsort((contact["arc"], contact["step"]))
    return [(int(b), select(contact, order[label[order] == b])) for b in np.unique(label)]


def segment_ends(arc: np.ndarray, length: np.ndarray) -> np.ndarray:
    """(n + 1,) ends of the nodes' dual segments: midpoints inside, whole segments at the ends.

    The last ones are at the last nodes at least: vertices of quadratic elements have a third of
    what lies between them and the middles.
    """
    if len(arc) == 1:
        return arc[0] + length[0] * np.array([-0.5, 0.5])
    middle = (arc[1:] + arc[:-1]) / 2
    first, last = min(middle[0] - length[0], arc[0]), max(middle[-1] + length[-1], arc[-1])
    return np.concatenate([[first], middle, [last]])
