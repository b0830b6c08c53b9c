"""Stage 7: fields for ParaView: displacements and stresses of the bodies.

A VTU file a step, step 0 being the undeformed bodies, named with its time in fields.pvd; of large
bodies a PVTU file that names the VTU files of pieces. A piece is a range of subdomains, the same on
any number of ranks; the rank that has its first one writes it, so that no rank gathers a field.

Points are the nodes of the torn subdomains. Stresses at points are means over the triangles round
the node in its body, weighted by their areas (Zienkiewicz, Zhu, IJNME 24 (1987) 337-357), of
quadratic elements means of the linear stresses at the node; where the material changes they smear
its jump. Lines of the contact boundary are in contact.pvd, see contact_lines.py.
"""

from pathlib import Path

import numpy as np

from ..errors import agreed_writes
from ..feti.exchange import exchange
from ..feti.gathering import gather, joined, largest
from ..feti.operator import DualOperator
from ..files import renamed
from ..march.step import Step
from ..scene import element_kinds, elements
from ..scene.kinematics import corner_stresses, stresses, von_mises
from ..scene.loader import Subdomain
from .contact_lines import ContactLines
from .nodal_means import NodalMeans
from .tables import FIELDS_FOLDER, STRESSES, contact_file, error_file, field_file, piece_file
from .vtu import VtuMesh, attributes

SAME_MATERIAL = 1e-9  # relative difference of moduli: means over triangles, which round
PIECE = 100_000  # points of a piece, roughly
COMPONENTS = {"stress": STRESSES}


class Fields:
    """Writes the fields of the steps of a run; collective."""

    def __init__(self, directory: Path, element: str, operator: DualOperator):
        """Writes step 0. Raises InputError if `directory` cannot be written to."""
        self.directory, self.operator, self.root = directory, operator, operator.comm.rank == 0
        self.steps = []  # (time, number) of every step
        self.errors = []  # likewise, of those with an error indicator
        self._share_out()
        self.meshes = self._meshes(min(6, element_kinds.NODES[element]))
        self.lines, contact = None, operator.structure.contact.declared
        if len(contact.gid):
            self.lines = ContactLines(directory, operator.structure, self.root)
            self._touching = [np.flatnonzero(np.isin(sub.node_gid, contact.gid))
                              for sub in operator.structure.subdomains]
        with agreed_writes(operator.comm):
            if self.root:
                (directory / FIELDS_FOLDER).mkdir(exist_ok=True)
        subs = operator.structure.subdomains
        points, triangles = self._points.sum(), sum(len(sub.triangles) for sub in subs)
        self._write(field_file(0, self.pieces), {"displacement": np.zeros((points, 3)),
                                                 "stress": np.zeros((points, 4))},
                    {"stress": np.zeros((triangles, 4)), "von_mises": np.zeros(triangles)})

    def add(self, step: Step, displacements: list[np.ndarray], state: dict,
            written: bool = False) -> None:
        """Fields of one step; not again if `written`.

        `displacements` (dofs,) by subdomain less the travel, `state` of the contact nodes as
        ContactState has it.
        """
        self.steps.append((step.time, step.index))
        if written:
            return
        subs = self.operator.structure.subdomains
        means = [stresses(sub, u, step.weights) for sub, u in zip(subs, displacements)]
        corners = joined((corner_stresses(sub, u, step.weights, mean)
                          for sub, u, mean in zip(subs, displacements, means)), float, 3, 4)
        stress = joined(means, float, 4)
        whole = [u.reshape(-1, 2) for u in self.operator.with_travel(displacements, step.weights)]
        shown = joined((u[_drawn(sub)] for sub, u in zip(subs, whole)), float, 2)
        self._write(field_file(step.index, self.pieces),
                    {"displacement": _in_space(shown), "stress": self._means(corners)},
                    {"stress": stress, "von_mises": von_mises(stress)})
        if self.lines is not None:
            self._write_lines(step, whole, state)

    def _write_lines(self, step: Step, whole: list[np.ndarray], state: dict) -> None:
        """The file of the contact boundary for displacements (nodes, 2) by subdomain."""
        subs, comm = self.operator.structure.subdomains, self.operator.comm
        gid = gather(comm, joined((sub.node_gid[k] for sub, k in zip(subs, self._touching)), int))
        u = gather(comm, joined((u[k] for u, k in zip(whole, self._touching)), float, 2))
        with agreed_writes(comm):
            if self.root:
                moved = np.zeros((gid.max() + 1, 2))
                moved[gid] = u
                self.lines.write(step.index, step.time, moved, state)

    def indicate(self, step: Step, indicator: np.ndarray | None) -> None:
        """A file of its own with the error indicator (n_t,) of a step, which rank 0 has."""
        self.errors.append((step.time, step.index))
        comm, to, values = self.operator.comm, np.empty(0, np.int64), np.empty(0)
        if self.root:
            to, values = np.repeat(self._writer, self._triangles), indicator
        _, own = exchange(comm, to, values)
        self._write_pieces(error_file(step.index, self.pieces), {}, {"error_indicator": own})

    @property
    def files(self) -> list[str]:
        """Files of the steps, relative to the directory."""
        names = [field_file(index, self.pieces) for _, index in self.steps]
        if self.pieces > 1:
            names += [piece_file(name, k) for name in names for k in range(self.pieces)]
        if self.lines is not None:
            names += [contact_file(index) for _, index in self.steps]
        return names

    def write_collections(self) -> None:
        """fields.pvd, contact.pvd, error.pvd, which name the files and their times; on rank 0."""
        _collection(self.directory / "fields.pvd",
                    [(time, field_file(index, self.pieces))
                     for time, index in [(0.0, 0), *self.steps]])
        if self.lines is not None:
            _collection(self.directory / "contact.pvd",
                        [(time, contact_file(index)) for time, index in self.steps])
        if self.errors:
            _collection(self.directory / "error.pvd",
                        [(time, error_file(index, self.pieces))
                         for time, index in sorted(self.errors)])

    # ---- pieces --------------------------------------------------------------------------------
    def _share_out(self) -> None:
        """How many pieces there are, who writes them, and what this rank's subdomains go to."""
        structure, comm = self.operator.structure, self.operator.comm
        subs, total = structure.subdomains, structure.total
        self._points = np.array([_drawn(sub).sum() for sub in subs], np.int64)
        points = comm.allreduce(int(self._points.sum()))
        self.pieces = min(total, max(1, round(points / PIECE)))
        first = total * np.arange(self.pieces) // self.pieces
        self._writer = ((first + 1) * comm.size - 1) // total  # see structure.partition
        self._mine = np.flatnonzero(self._writer == comm.rank)
        piece = np.searchsorted(first, [sub.index for sub in subs], side="right") - 1
        triangles = np.array([len(sub.triangles) for sub in subs], np.int64)
        counts = [np.bincount(piece, of, self.pieces).astype(np.int64)
                  for of in (self._points, triangles)]
        counts, self._triangles = (comm.allreduce(count) for count in counts)
        self._to = {"points": np.repeat(self._writer[piece], self._points),
                    "cells": np.repeat(self._writer[piece], triangles)}
        self._ends = {kind: np.cumsum(of[self._mine])[:-1]
                      for kind, of in (("points", counts), ("cells", self._triangles))}

    def _received(self, kind: str, values: np.ndarray) -> np.ndarray:
        """Values of the rank's pieces, for those (n, ...) of the points or cells of its subdomains.
        """
        return exchange(self.operator.comm, self._to[kind], values)[1]

    def _split(self, kind: str, values: np.ndarray) -> list[np.ndarray]:
        """Values of all of the rank's pieces, piece by piece."""
        return np.split(values, self._ends[kind]) if len(self._mine) else []

    def _meshes(self, nodes: int) -> list[VtuMesh]:
        """The meshes of the rank's pieces; collective.

        With subdomain, body and region of the triangles, and shear_modulus where that differs.
        """
        subs, comm = self.operator.structure.subdomains, self.operator.comm
        drawn = [_drawn(sub) for sub in subs]
        numbers = [(np.cumsum(shown) - 1)[sub.elements[:, :nodes]]
                   for sub, shown in zip(subs, drawn)]
        self._means = NodalMeans(
            comm, joined((sub.node_gid[shown] for sub, shown in zip(subs, drawn)), np.int64),
            joined((sub.xy[shown] for sub, shown in zip(subs, drawn)), float, 2),
            joined((own + k for own, k in zip(numbers, np.cumsum(self._points) - self._points)),
                   np.int64, nodes))
        shear = joined((sub.elasticity[:, 2, 2] for sub in subs), float)
        data = {"subdomain": joined((np.full(len(sub.triangles), sub.index) for sub in subs), int),
                "body": self._means.bodies(),
                "region": joined((sub.region for sub in subs), int)}
        low, high = largest(comm, np.array([(-shear).max(initial=-np.inf),
                                            shear.max(initial=-np.inf)]))
        if high + low > SAME_MATERIAL * high:
            data["shear_modulus"] = shear
        size = np.repeat(self._points, [len(own) for own in numbers])
        *data_, cells, size = (self._split("cells", self._received("cells", values)) for values in (
            *data.values(), joined(numbers, np.int64, nodes), size))
        data = dict(zip(data, data_))
        xy = self._split("points", self._received("points", self._means.xy))
        meshes = []
        for k, (places, own) in enumerate(zip(xy, cells)):
            new = np.diff(data["subdomain"][k], prepend=-1) != 0  # triangles that begin one
            first = np.cumsum(size[k][new]) - size[k][new]
            own = own + first[np.cumsum(new) - 1][:, None]
            own = own[:, elements.TO_VTK] if nodes == 6 else own
            meshes.append(VtuMesh(_in_space(places), own,
                                  {name: of[k] for name, of in data.items()}, COMPONENTS))
        return meshes

    def _write(self, name: str, points: dict, cells: dict) -> None:
        """A file for data of the points and triangles of the rank's subdomains; collective."""
        points, cells = ({key: self._received(kind, values) for key, values in data.items()}
                         for kind, data in (("points", points), ("cells", cells)))
        self._write_pieces(name, points, cells)

    def _write_pieces(self, name: str, points: dict, cells: dict) -> None:
        """The same for data of all of the rank's pieces."""
        points, cells = ({key: self._split(kind, values) for key, values in data.items()}
                         for kind, data in (("points", points), ("cells", cells)))
        with agreed_writes(self.operator.comm):
            for k, (number, mesh) in enumerate(zip(self._mine, self.meshes)):
                own = [{key: parts[k] for key, parts in data.items()} for data in (points, cells)]
                path = name if self.pieces == 1 else piece_file(name, number)
                mesh.write(self.directory / path, *own)
                if number == 0 and self.pieces > 1:
                    _write_index(self.directory / name, self.pieces, own[0],
                                 {**own[1], **mesh.cell_data})


def _write_index(path: Path, pieces: int, points: dict, cells: dict) -> None:
    """The PVTU file that names the `pieces` of a file `path`, with data such as these."""

    def arrays(data: dict) -> str:
        return "".join(f"<PDataArray {attributes(name, values, COMPONENTS.get(name, ()))}/>\n"
                       for name, values in data.items())

    sources = "".join(f'<Piece Source="{Path(piece_file(path.name, k)).name}"/>\n'
                      for k in range(pieces))
    with renamed(path) as hidden:
        hidden.write_text(
            '<?xml version="1.0"?>\n<VTKFile type="PUnstructuredGrid" version="0.1">\n'
            '<PUnstructuredGrid GhostLevel="0">\n'
            f"<PPointData>\n{arrays(points)}</PPointData>\n"
            f"<PCellData>\n{arrays(cells)}</PCellData>\n"
            '<PPoints><PDataArray type="Float64" NumberOfComponents="3"/></PPoints>\n'
            f"{sources}</PUnstructuredGrid>\n</VTKFile>\n")


def _in_space(pairs: np.ndarray) -> np.ndarray:
    """(n, 3) vectors in space from those in the plane (n, 2)."""
    return np.column_stack([pairs, np.zeros(len(pairs))])


def _drawn(sub: Subdomain) -> np.ndarray:
    """(n_v,) whether a node is a point of the files: not the centroids of P2-mixed."""
    drawn = np.ones(len(sub.xy), bool)
    drawn[sub.elements[:, 6:]] = False
    return drawn


def _collection(path: Path, steps: list[tuple[float, str]]) -> None:
    """A PVD file of `steps` (time, file)."""
    sets = "".join(f'<DataSet timestep="{time!r}" part="0" file="{name}"/>\n'
                   for time, name in steps)
    path.write_text('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n'
                    f"<Collection>\n{sets}</Collection>\n</VTKFile>\n")
