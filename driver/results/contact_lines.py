"""Stage 7: the contact boundary as lines for ParaView, a VTU file a step; of pairs the first side.
"""

from pathlib import Path

import numpy as np

from ..contact.states import ContactField
from ..feti.structure import Substructure
from ..files import renamed
from .tables import contact_file


class ContactLines:
    """Writes contact quantities on the edges between contact nodes."""

    def __init__(self, directory: Path, structure: Substructure, root: bool):
        """`root`: whether this rank writes."""
        self.directory, self.boundary = directory, structure.contact
        self.lines = _lines(structure) if root else None

    def write(self, index: int, moved: np.ndarray, state: dict) -> None:
        """The file of step `index`; `moved` (nodes, 2) are displacements, `state` as ContactState.

        Gap is the distance at the start, as in contact.csv, opening what is left of it.
        """
        import meshio

        b = self.boundary
        data = {"displacement": moved[b.gid], "normal": b.normal,
                "pressure": -state[ContactField.SIGMA_N] + 0.0,
                "shear": state[ContactField.SIGMA_T], "gap": b.gap,
                "opening": b.gap - state[ContactField.U_N], "slip": state[ContactField.SLIP],
                "status": state[ContactField.STATUS].astype(int), "boundary": b.label.astype(int)}
        data = {name: np.column_stack([values, np.zeros(len(values))]) if values.ndim == 2
                else values for name, values in data.items()}
        cells = [("line", self.lines)]
        if not len(self.lines):
            cells = [("vertex", np.arange(len(b.gid))[:, None])]
        with renamed(self.directory / contact_file(index)) as hidden:
            meshio.Mesh(np.column_stack([b.xy, np.zeros(len(b.gid))]), cells,
                        point_data=data).write(hidden)


def _lines(structure: Substructure) -> np.ndarray:
    """(k, 2) contact nodes at the ends of edges, of quadratic elements of their halves."""
    b, edges = structure.contact, structure.outer_edges
    sides = edges[:, :2]
    label = edges[:, 2]
    if len(structure.outer_middles):
        middles = structure.outer_middles
        sides = np.concatenate([np.column_stack([sides[:, 0], middles]),
                                np.column_stack([middles, sides[:, 1]])])
        label = np.concatenate([label, label])
    own = np.isin(label, b.label)
    sides, label = sides[own], label[own]
    span = max(edges[:, :2].max(), structure.outer_middles.max(initial=0), b.gid.max()) + 1
    keys = b.label * span + b.gid
    order = np.argsort(keys)
    wanted = label[:, None] * span + sides
    place = np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)
    found = keys[order][place] == wanted
    return np.unique(np.sort(order[place][found.all(axis=1)], axis=1), axis=0)
