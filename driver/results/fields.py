"""Stage 7: displacements and stresses, gathered on rank 0, as a VTU file for ParaView a step."""

from pathlib import Path

import numpy as np

from ..errors import agreed_writes
from ..feti.gathering import joined
from ..feti.operator import DualOperator
from ..files import renamed
from ..march.step import Step
from ..scene import elements
from ..scene.kinematics import stresses
from ..scene.loader import Subdomain

FOLDER = "fields"


def file_name(index: int) -> str:
    """The file of step `index` in the directory of a run."""
    return f"{FOLDER}/step_{index:04d}.vtu"


class Fields:
    """Writes the fields of the steps of a run; collective, rank 0 writes."""

    def __init__(self, directory: Path, element: str, operator: DualOperator):
        """Raises InputError if `directory` cannot be written to."""
        self.directory, self.operator, self.root = directory, operator, operator.comm.rank == 0
        self.steps = []  # (time, file) of every step
        self.mesh = self._gather_mesh(min(6, elements.NODES[element]))
        with agreed_writes(operator.comm):
            if self.root:
                (directory / FOLDER).mkdir(exist_ok=True)

    def add(self, step: Step, displacements: list[np.ndarray], written: bool = False) -> None:
        """Fields of one step with `displacements` (dofs,) less travel; not again if `written`."""
        self.steps.append((step.time, file_name(step.index)))
        if not written:
            self.write(step, displacements)

    def write(self, step: Step, displacements: list[np.ndarray],
              indicator: np.ndarray | None = None) -> None:
        """The file of a step, never there in part; `indicator` (n_t,) on rank 0, if any."""
        mesh = self._mesh_with_fields(step, displacements, indicator)
        with agreed_writes(self.operator.comm):
            if self.root:
                with renamed(self.directory / file_name(step.index)) as hidden:
                    mesh.write(hidden)

    def write_collection(self) -> None:
        """fields.pvd, which names the files and their times; on rank 0."""
        sets = "".join(f'<DataSet timestep="{time!r}" part="0" file="{name}"/>\n'
                       for time, name in self.steps)
        (self.directory / "fields.pvd").write_text(
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n'
            f"<Collection>\n{sets}</Collection>\n</VTKFile>\n")

    def _gather_mesh(self, nodes: int):
        """On rank 0 points (n, 2), elements (n_t, nodes) and subdomains (n_t,) of the torn body."""
        subs = self.operator.structure.subdomains
        drawn = [_drawn(sub) for sub in subs]
        offset = np.cumsum([0, *(shown.sum() for shown in drawn)])
        xy = [sub.xy[shown] for sub, shown in zip(subs, drawn)]
        numbers = [(first + np.cumsum(shown) - 1)[sub.elements[:, :nodes]]
                   for sub, shown, first in zip(subs, drawn, offset)]
        subdomain = [np.full(len(sub.triangles), sub.index) for sub in subs]
        parts = self.operator.comm.gather((joined(xy, float, 2), joined(numbers, int, nodes),
                                           joined(subdomain, int)))
        if not self.root:
            return None
        start = np.cumsum([0, *(len(xy) for xy, _, _ in parts)])
        xy, subdomain = (np.concatenate([part[k] for part in parts]) for k in (0, 2))
        return xy, np.concatenate([part[1] + first for part, first in zip(parts, start)]), subdomain

    def _mesh_with_fields(self, step: Step, displacements: list[np.ndarray],
                          indicator: np.ndarray | None):
        """The mesh with its fields on rank 0, None elsewhere."""
        import meshio

        subs = self.operator.structure.subdomains
        tensors = [stresses(sub, u, step.weights) for sub, u in zip(subs, displacements)]
        whole = self.operator.with_travel(displacements, step.weights)
        shown = [u.reshape(-1, 2)[_drawn(sub)] for sub, u in zip(subs, whole)]
        parts = self.operator.comm.gather((joined(shown, float, 2),
                                           joined((stress for stress, _ in tensors), float, 3),
                                           joined((mises for _, mises in tensors), float)))
        if not self.root:
            return None
        u, stress, mises = (np.concatenate([part[k] for part in parts]) for k in range(3))
        xy, nodes, subdomain = self.mesh
        linear = nodes.shape[1] == 3
        cells = ("triangle", nodes) if linear else ("triangle6", nodes[:, elements.TO_VTK])
        cell_data = {"stress": [stress], "von_mises": [mises], "subdomain": [subdomain]}
        if indicator is not None:
            cell_data["error_indicator"] = [indicator]
        return meshio.Mesh(_in_space(xy), [cells], point_data={"displacement": _in_space(u)},
                           cell_data=cell_data)


def _in_space(pairs: np.ndarray) -> np.ndarray:
    """(n, 3) vectors in space from those in the plane (n, 2)."""
    return np.column_stack([pairs, np.zeros(len(pairs))])


def _drawn(sub: Subdomain) -> np.ndarray:
    """(n_v,) whether a node is a point of the files: not the centroids of P2-mixed."""
    drawn = np.ones(len(sub.xy), bool)
    drawn[sub.elements[:, 6:]] = False
    return drawn
