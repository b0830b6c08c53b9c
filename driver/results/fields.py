"""Fields for ParaView: displacements and stresses of the bodies.

A VTU file a step, step 0 being the undeformed bodies, named with its time in fields.pvd; of large
bodies a PVTU file that names the VTU files of pieces (pieces.py).

Points are the nodes of the torn subdomains. Stresses at points are means over the triangles round
the node in its body, weighted by their areas (Zienkiewicz, Zhu, IJNME 24 (1987) 337-357), of
quadratic elements means of the linear stresses at the node; where the material changes they smear
its jump. Lines of the contact boundary are in contact.pvd, see contact_lines.py.
"""

from pathlib import Path

import numpy as np

from ..environment import give_back_memory
from ..errors import agreed_writes
from ..feti.gathering import gather, joined, largest
from ..feti.operator import DualOperator
from ..files import renamed
from ..march.step import Step
from ..scene import element_kinds, elements
from ..scene.kinematics import corner_stresses, stresses, von_mises
from ..scene.loader import Subdomain
from .contact_lines import ContactLines
from .nodal_means import NodalMeans
from .pieces import Pieces
from .tables import FIELDS_FOLDER, STRESSES, contact_file, error_file, field_file, piece_file
from .vtu import VtuMesh, attributes, in_space

SAME_MATERIAL = 1e-9  # relative difference of moduli: means over triangles, which round
COMPONENTS = {"stress": STRESSES}
POINTS = {"displacement": (float, 3), "stress": (float, 4)}
CELLS = {"stress": (float, 4), "von_mises": (float,)}


class Fields:
    """Writes the fields of the steps of a run; collective."""

    def __init__(self, directory: Path, element: str, operator: DualOperator):
        """Writes step 0. Raises InputError if `directory` cannot be written to."""
        self.directory, self.operator, self.root = directory, operator, operator.comm.rank == 0
        self.steps = []  # (time, number) of every step
        self.errors = []  # likewise, of those with an error indicator
        structure = operator.structure
        subs, contact = structure.subdomains, structure.contact.declared
        self._drawn = [_drawn(sub) for sub in subs]
        points = np.array([drawn.sum() for drawn in self._drawn], np.int64)
        triangles = np.array([len(sub.triangles) for sub in subs], np.int64)
        self._starts = np.cumsum(points) - points
        self.pieces = Pieces(operator.comm, structure.first, structure.total, points, triangles)
        self.meshes = self._meshes(min(6, element_kinds.NODES[element]))
        self.lines = None
        if len(contact.gid):
            self.lines = ContactLines(directory, structure, self.root)
            self._touching = [np.flatnonzero(np.isin(sub.node_gid, contact.gid)) for sub in subs]
        with agreed_writes(operator.comm):
            if self.root:
                (directory / FIELDS_FOLDER).mkdir(exist_ok=True)
        self._write(field_file(0, self.pieces.count), *(
            lambda s, of=of, rows=rows: {name: np.zeros((rows[s], *width), kind)
                                         for name, (kind, *width) in of.items()}
            for of, rows in ((POINTS, points), (CELLS, triangles))))

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
        nodal = self._means(lambda s: corner_stresses(subs[s], displacements[s], step.weights,
                                                      means[s]), 4)
        whole = [u.reshape(-1, 2) for u in self.operator.with_travel(displacements, step.weights)]

        def points(s: int) -> dict[str, np.ndarray]:
            own = slice(self._starts[s], self._starts[s] + self.pieces.points[s])
            return {"displacement": in_space(whole[s][self._drawn[s]]), "stress": nodal[own]}

        def cells(s: int) -> dict[str, np.ndarray]:
            return {"stress": means[s], "von_mises": von_mises(means[s])}

        self._write(field_file(step.index, self.pieces.count), points, cells)
        if self.lines is not None:
            self._write_lines(step, whole, state)
        give_back_memory()

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
        for turn in range(self.pieces.turns):
            own = self.pieces.scattered(turn, indicator)
            self._write_piece(error_file(step.index, self.pieces.count), turn, {},
                              {"error_indicator": own})

    @property
    def files(self) -> list[str]:
        """Files of the steps, relative to the directory."""
        names = [field_file(index, self.pieces.count) for _, index in self.steps]
        if self.pieces.count > 1:
            names += [piece_file(name, k) for name in names for k in range(self.pieces.count)]
        if self.lines is not None:
            names += [contact_file(index) for _, index in self.steps]
        return names

    def write_collections(self) -> None:
        """fields.pvd, contact.pvd, error.pvd, which name the files and their times; on rank 0."""
        _collection(self.directory / "fields.pvd",
                    [(time, field_file(index, self.pieces.count))
                     for time, index in [(0.0, 0), *self.steps]])
        if self.lines is not None:
            _collection(self.directory / "contact.pvd",
                        [(time, contact_file(index)) for time, index in self.steps])
        if self.errors:
            _collection(self.directory / "error.pvd",
                        [(time, error_file(index, self.pieces.count))
                         for time, index in sorted(self.errors)])

    # ---- pieces --------------------------------------------------------------------------------
    def _meshes(self, nodes: int) -> list[VtuMesh]:
        """The meshes of the rank's pieces; collective.

        With subdomain, body and region of the triangles, and shear_modulus where that differs.
        """
        subs, comm, pieces = self.operator.structure.subdomains, self.operator.comm, self.pieces
        places = [sub.xy[drawn] for sub, drawn in zip(subs, self._drawn)]
        # where all nodes are points, their own numbers: like subdomains have them in common
        numbers = [sub.elements if drawn.all() else (np.cumsum(drawn) - 1)[sub.elements[:, :nodes]]
                   for sub, drawn in zip(subs, self._drawn)]
        gid = [sub.node_gid[drawn] for sub, drawn in zip(subs, self._drawn)]
        self._means = NodalMeans(comm, gid, places, numbers)
        bodies = self._means.bodies()
        layout = {"subdomain": (int,), "body": (int,), "region": (int,)}
        shear = joined((sub.elasticity[:, 2, 2] for sub in subs), float)
        low, high = largest(comm, np.array([(-shear).max(initial=-np.inf),
                                            shear.max(initial=-np.inf)]))
        if high + low > SAME_MATERIAL * high:
            layout["shear_modulus"] = (float,)

        def cells(s: int) -> dict[str, np.ndarray]:
            sub, count = subs[s], pieces.triangles[s]
            return {"subdomain": np.full(count, sub.index), "body": bodies[s],
                    "region": sub.region, "shear_modulus": sub.elasticity[:, 2, 2],
                    "nodes": numbers[s], "size": np.full(count, pieces.points[s])}

        meshes = []
        for turn in range(pieces.turns):
            at = pieces.received(turn, pieces.points, {"xy": (float, 2)},
                                 lambda s: {"xy": places[s]})["xy"]
            data = pieces.received(turn, pieces.triangles, layout, cells)
            of = pieces.received(turn, pieces.triangles, {"subdomain": (int,), "size": (int,),
                                                          "nodes": (np.int64, nodes)}, cells)
            if turn < len(pieces.own):
                meshes.append(VtuMesh(in_space(at), _numbered(**of), data, COMPONENTS))
        return meshes

    def _write(self, name: str, points, cells) -> None:
        """A file for data of the points and triangles of a subdomain, by name; collective."""
        pieces = self.pieces
        for turn in range(pieces.turns):
            self._write_piece(name, turn, pieces.received(turn, pieces.points, POINTS, points),
                              pieces.received(turn, pieces.triangles, CELLS, cells))

    def _write_piece(self, name: str, turn: int, points: dict, cells: dict) -> None:
        """The piece that this rank writes in a turn, if it does; collective."""
        with agreed_writes(self.operator.comm):
            if turn >= len(self.pieces.own):
                return
            number, count = self.pieces.own[turn], self.pieces.count
            mesh, path = self.meshes[turn], name if count == 1 else piece_file(name, number)
            mesh.write(self.directory / path, points, cells)
            if number == 0 and count > 1:
                _write_index(self.directory / name, count, points, {**cells, **mesh.cell_data})


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


def _numbered(subdomain: np.ndarray, size: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Triangles `nodes` (n_t, 3 or 6) by the points of a piece, in VTK's order, from those by the
    points of their subdomain, (n_t,) like the number of these, its `size`.
    """
    begins = np.diff(subdomain, prepend=-1) != 0
    first = np.cumsum(size[begins]) - size[begins]
    nodes = nodes + first[np.cumsum(begins) - 1][:, None]
    return nodes[:, elements.TO_VTK] if nodes.shape[1] == 6 else nodes


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
