"""The contact boundary as lines for ParaView, a VTU file a step; of pairs the first side."""

from pathlib import Path

import numpy as np

from ..contact.states import ContactField
from ..feti.structure import Substructure
from .contact_edges import chains
from .contact_state import WEAR, less_wear
from .tables import contact_file
from .vtu import VtuMesh, in_space


class ContactLines:
    """Writes contact quantities on the edges between contact nodes."""

    def __init__(self, directory: Path, structure: Substructure, root: bool):
        """`root`: whether this rank writes."""
        self.directory, self.structure = directory, structure
        self.mesh = _mesh(structure) if root else None

    def write(self, index: int, time: float, moved: np.ndarray, state: dict) -> None:
        """The file of step `index`; `moved` (nodes, 2) are displacements, `state` as ContactState.

        Gap is the distance at the start, as in contact.csv, to moving obstacles that at `time`,
        opening what is left of it.
        """
        b = self.structure.contact.declared.at(time)
        opening = b.gap - less_wear(state)[ContactField.U_N]
        data = {"displacement": moved[b.gid], "normal": b.normal,
                "pressure": -state[ContactField.SIGMA_N] + 0.0,
                "shear": state[ContactField.SIGMA_T], "gap": b.gap,
                "opening": opening, "slip": state[ContactField.SLIP],
                "status": state[ContactField.STATUS].astype(int), "boundary": b.label.astype(int)}
        if WEAR in state:
            data["wear"] = state[WEAR]
        if b.motion is not None:
            data["obstacle"] = b.gap[:, None] * b.normal  # warped by it the line is the obstacle
        data = {name: in_space(values) if values.ndim == 2 else values
                for name, values in data.items()}
        self.mesh.write(self.directory / contact_file(index), data, {})


def _mesh(structure: Substructure) -> VtuMesh:
    """Contact nodes and the lines between them, vertices where there are none."""
    b, lines = structure.contact.declared, _lines(structure)
    cells = lines if len(lines) else np.arange(len(b.gid))[:, None]
    return VtuMesh(in_space(b.xy), cells, {}, {})


def _lines(structure: Substructure) -> np.ndarray:
    """(k, 2) contact nodes at the ends of edges, of quadratic elements of their halves."""
    b, edges, middles = structure.contact.declared, structure.outer_edges, structure.outer_middles
    nodes = {name: getattr(b, name) for name in ("arc", "xy", "chain")}
    pieces = chains(nodes)
    pairs = [np.column_stack([piece[:-1], piece[1:]]) for piece in pieces]
    # that closes a ring
    pairs += [piece[[[0, -1]]] for piece in pieces if len(piece) > 2]
    pairs = np.concatenate(pairs)
    sides = edges[:, :2]
    if len(middles):
        sides = np.concatenate([np.column_stack([end, middles]) for end in sides.T])
    span = max(sides.max(), b.gid.max()) + 1
    known = np.isin(np.sort(b.gid[pairs], axis=1) @ [span, 1],
                    np.sort(sides, axis=1) @ [span, 1])
    return np.unique(np.sort(pairs[known], axis=1), axis=0)
