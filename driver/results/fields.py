"""Stage 7: fields for ParaView, gathered on rank 0: displacements and stresses of the bodies.

A VTU file a step, step 0 being the undeformed bodies, named with its time in fields.pvd. Points are
the nodes of the torn subdomains. Stresses at points are means over the triangles round the node in
its body, weighted by their areas (Zienkiewicz, Zhu, IJNME 24 (1987) 337-357), of quadratic elements
means of the linear stresses at the node; where the material changes they smear its jump. Lines of
the contact boundary are in contact.pvd, see contact_lines.py.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..errors import agreed_writes
from ..feti.gathering import joined
from ..feti.operator import DualOperator
from ..files import renamed
from ..march.step import Step
from ..scene import element_kinds, elements
from ..scene.kinematics import corner_stresses, stresses, von_mises
from ..scene.loader import Subdomain
from .contact_lines import ContactLines
from .tables import FIELDS_FOLDER, STRESSES, contact_file, error_file, field_file

SAME_MATERIAL = 1e-9  # relative difference of moduli: means over triangles, which round


@dataclass
class TornMesh:
    """The torn bodies on rank 0: n points, n_t elements."""

    xy: np.ndarray  # (n, 2)
    node: np.ndarray  # (n,) numbers of these nodes in the untorn bodies
    elements: np.ndarray  # (n_t, 3 or 6)
    area: np.ndarray  # (n_t,)
    # (n_t,) subdomain, body, region, shear_modulus where that differs
    cell_data: dict[str, np.ndarray]


class Fields:
    """Writes the fields of the steps of a run; collective, rank 0 writes."""

    def __init__(self, directory: Path, element: str, operator: DualOperator):
        """Writes step 0. Raises InputError if `directory` cannot be written to."""
        self.directory, self.operator, self.root = directory, operator, operator.comm.rank == 0
        self.steps = []  # (time, number) of every step
        self.errors = []  # likewise, of those with an error indicator
        self.mesh = self._gather_mesh(min(6, element_kinds.NODES[element]))
        self.lines = None
        if len(operator.structure.contact.declared.gid):
            self.lines = ContactLines(directory, operator.structure, self.root)
        with agreed_writes(operator.comm):
            if self.root:
                (directory / FIELDS_FOLDER).mkdir(exist_ok=True)
                count, of_elements = len(self.mesh.xy), len(self.mesh.elements)
                self._write(0, np.zeros((count, 2)), np.zeros((of_elements, 4)),
                            np.zeros((of_elements, 3, 4)))

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
        stress = [stresses(sub, u, step.weights) for sub, u in zip(subs, displacements)]
        corners = [corner_stresses(sub, u, step.weights) for sub, u in zip(subs, displacements)]
        whole = self.operator.with_travel(displacements, step.weights)
        shown = [u.reshape(-1, 2)[_drawn(sub)] for sub, u in zip(subs, whole)]
        parts = self.operator.comm.gather((joined(shown, float, 2), joined(stress, float, 4),
                                           joined(corners, float, 3, 4)))
        with agreed_writes(self.operator.comm):
            if self.root:
                u, stress, corners = (np.concatenate([part[k] for part in parts])
                                      for k in range(3))
                self._write(step.index, u, stress, corners)
                if self.lines is not None:
                    moved = np.zeros((self.mesh.node.max() + 1, 2))
                    moved[self.mesh.node] = u
                    self.lines.write(step.index, step.time, moved, state)

    def indicate(self, step: Step, indicator: np.ndarray | None) -> None:
        """A file of its own with the error indicator (n_t,) of a step, which rank 0 has."""
        self.errors.append((step.time, step.index))
        with agreed_writes(self.operator.comm):
            if self.root:
                self._write_mesh(error_file(step.index), {}, {"error_indicator": indicator})

    @property
    def files(self) -> list[str]:
        """Files of the steps, relative to the directory."""
        kinds = [field_file] if self.lines is None else [field_file, contact_file]
        return [name(index) for _, index in self.steps for name in kinds]

    def write_collections(self) -> None:
        """fields.pvd, contact.pvd, error.pvd, which name the files and their times; on rank 0."""
        _collection(self.directory / "fields.pvd", field_file, [(0.0, 0), *self.steps])
        if self.lines is not None:
            _collection(self.directory / "contact.pvd", contact_file, self.steps)
        if self.errors:
            _collection(self.directory / "error.pvd", error_file, sorted(self.errors))

    def _gather_mesh(self, nodes: int) -> TornMesh | None:
        """The mesh on rank 0, None elsewhere; collective."""
        subs = self.operator.structure.subdomains
        drawn = [_drawn(sub) for sub in subs]
        offset = np.cumsum([0, *(shown.sum() for shown in drawn)])
        numbers = [(first + np.cumsum(shown) - 1)[sub.elements[:, :nodes]]
                   for sub, shown, first in zip(subs, drawn, offset)]
        parts = self.operator.comm.gather((
            joined((sub.xy[shown] for sub, shown in zip(subs, drawn)), float, 2),
            joined(numbers, int, nodes),
            joined((np.full(len(sub.triangles), sub.index) for sub in subs), int),
            joined((sub.region for sub in subs), int),
            joined((sub.elasticity[:, 2, 2] for sub in subs), float),
            joined((sub.node_gid[shown] for sub, shown in zip(subs, drawn)), int)))
        if not self.root:
            return None
        start = np.cumsum([0, *(len(xy) for xy, *_ in parts)])
        xy, subdomain, region, shear, gid = (np.concatenate([part[k] for part in parts])
                                             for k in (0, 2, 3, 4, 5))
        cells = np.concatenate([part[1] + first for part, first in zip(parts, start)])
        data = {"subdomain": subdomain, "body": _bodies(gid[cells[:, :3]]), "region": region}
        if np.ptp(shear) > SAME_MATERIAL * shear.max():
            data["shear_modulus"] = shear
        return TornMesh(xy, gid, cells, elements.areas(xy[cells[:, :3]]), data)

    def _write(self, index: int, u: np.ndarray, stress: np.ndarray, corners: np.ndarray) -> None:
        """The file of a step from u (n, 2), mean and corner stresses (n_t, 4), (n_t, 3, 4)."""
        points = {"displacement": _in_space(u), "stress": _averages(self.mesh, corners)}
        self._write_mesh(field_file(index), points,
                         {"stress": stress, "von_mises": von_mises(stress)})

    def _write_mesh(self, name: str, points: dict, cells: dict) -> None:
        """A file of the mesh with data of its points and cells, never there in part."""
        import meshio

        mesh = self.mesh
        shape = ("triangle", mesh.elements)
        if mesh.elements.shape[1] == 6:
            shape = ("triangle6", mesh.elements[:, elements.TO_VTK])
        cell_data = {key: [values] for key, values in {**cells, **mesh.cell_data}.items()}
        with renamed(self.directory / name) as hidden:
            meshio.Mesh(_in_space(mesh.xy), [shape], point_data=points,
                        cell_data=cell_data).write(hidden)
            _name_components(hidden)


def _in_space(pairs: np.ndarray) -> np.ndarray:
    """(n, 3) vectors in space from those in the plane (n, 2)."""
    return np.column_stack([pairs, np.zeros(len(pairs))])


def _drawn(sub: Subdomain) -> np.ndarray:
    """(n_v,) whether a node is a point of the files: not the centroids of P2-mixed."""
    drawn = np.ones(len(sub.xy), bool)
    drawn[sub.elements[:, 6:]] = False
    return drawn


def _bodies(corners: np.ndarray) -> np.ndarray:
    """(n_t,) number of the connected body of every triangle (n_t, 3), by their smallest nodes."""
    size = corners.max() + 1
    ends = corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(ends[0]), bool), ends), (size, size))
    found = connected_components(graph, directed=False)[1][corners[:, 0]]
    return np.unique(found, return_inverse=True)[1]


def _averages(mesh: TornMesh, corners: np.ndarray) -> np.ndarray:
    """(n, 4) stresses at the points from those at the corners of triangles (n_t, 3, 4)."""
    values = corners
    if mesh.elements.shape[1] == 6:  # in the middle of a side it is the mean of both ends
        middles = (corners[:, [1, 2, 0]] + corners[:, [2, 0, 1]]) / 2
        values = np.concatenate([corners, middles], axis=1)
    node = mesh.node[mesh.elements].ravel()
    weight = np.repeat(mesh.area, mesh.elements.shape[1])
    total = np.column_stack([np.bincount(node, weight * column)
                             for column in values.reshape(-1, 4).T])
    return (total / np.maximum(np.bincount(node, weight), 1e-300)[:, None])[mesh.node]


def _name_components(path: Path) -> None:
    """Name the components of stresses in a VTU file, which meshio has no word for."""
    names = " ".join(f'ComponentName{k}="{name}"' for k, name in enumerate(STRESSES))
    text = path.read_bytes()
    path.write_bytes(text.replace(b'Name="stress" ', f'Name="stress" {names} '.encode()))


def _collection(path: Path, name, steps: list[tuple[float, int]]) -> None:
    """A PVD file of `steps` (time, number), whose files are name(number)."""
    sets = "".join(f'<DataSet timestep="{time!r}" part="0" file="{name(index)}"/>\n'
                   for time, index in steps)
    path.write_text('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n'
                    f"<Collection>\n{sets}</Collection>\n</VTKFile>\n")
