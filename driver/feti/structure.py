"""The torn body as a rank knows it: its subdomains' dof sets and rows, and global numbers."""

from dataclasses import dataclass, field

import numpy as np

from ..scene.loader import Subdomain
from .gathering import joined, lookup
from .rigid_modes import RigidMode
from .rows import LocalRows
from .travel import Travel


@dataclass
class ContactTable:
    """All rows but the gluing ones, on every rank; arrays of length n."""

    row: np.ndarray  # sorted dual rows
    kind: np.ndarray  # RowKind
    scale: np.ndarray  # as Substructure.row_scale
    compliance: np.ndarray  # what they yield per force

    def has(self, rows: np.ndarray) -> np.ndarray:
        """(m,) whether dual rows are among them."""
        return lookup(self.row, rows)[1]


@dataclass
class Substructure:
    """What one rank knows: its subdomains' dof sets and rows, and the global numbering."""

    subdomains: list[Subdomain]
    first: int  # index of the rank's first subdomain
    total: int
    fixed: list[np.ndarray]  # per subdomain: Dirichlet dofs, those marked by a neighbour included
    fixed_values: list[np.ndarray]  # per subdomain: (patterns, n_fixed), less the travel
    corner_dofs: list[np.ndarray]  # per subdomain: local dofs that are primal
    corner_global: list[np.ndarray]  # per subdomain: their numbers in the coarse problem
    rows: list[LocalRows]
    coarse_dofs: int
    dual_dofs: int
    row_kind: np.ndarray  # (owned,) RowKind of the rank's rows
    row_scale: np.ndarray  # (owned,) power of two near the root of a row's relative stiffness
    row_stiffness: np.ndarray  # (owned,) that forces of a row answer to, trace of Hooke's law
    at_contact: ContactTable
    yields: bool  # contact rows do
    row_range: tuple[int, int]  # rows owned by this rank
    row_starts: np.ndarray  # per local subdomain: its first row, counted from row_range[0]
    patterns: int
    travel: Travel  # rigid motions of whole bodies that supports prescribe
    contact: object  # ContactBoundary of contact/boundary.py
    rigid_modes: list[RigidMode]  # of bodies whose supports, if any, leave them free
    rigid_corners: np.ndarray  # (coarse_dofs, modes) orthonormal: the modes at the coarse dofs
    with_hats: np.ndarray  # sorted gids of contact nodes with hats of their own, see deflation.py
    outer_edges: np.ndarray  # (n, 3): gid, gid, label of the edges of the untorn body's boundary
    outer_middles: np.ndarray  # (n,) gids of their middles; empty with linear elements
    primal_dofs: int
    support_jumps: list = field(default_factory=list)  # Jump of support_ends.py
    numbering: object = None  # of rows that are renewed, where contact follows the motion

    @property
    def touching(self) -> list[int]:
        """Local subdomains with contact rows."""
        of = np.repeat(np.arange(len(self.rows)), [len(rows.row) for rows in self.rows])
        numbers = joined((rows.row for rows in self.rows), np.int64)
        return np.unique(of[self.at_contact.has(numbers)]).tolist()

    @property
    def renewed(self) -> list[int]:
        """Local subdomains whose contact rows may change: none but where contact follows."""
        return [] if self.numbering is None else sorted(self.numbering.glued)

    def may_move(self, s: int) -> np.ndarray:
        """(dofs,) whether contact rows of local subdomain s may ever act on a dof."""
        may = np.isin(self.subdomains[s].node_gid, self.numbering.may_touch)
        return np.repeat(may, 2)

    def own_compliance(self, s: int) -> np.ndarray:
        """(m,) compliance of the rows of local subdomain s that it owns, zero at its others."""
        stop = np.append(self.row_starts, self.row_range[1] - self.row_range[0])[s + 1]
        row = self.rows[s].row - self.row_range[0]
        own = (row >= self.row_starts[s]) & (row < stop)
        return np.where(own, self.compliance_of(self.rows[s].row), 0.0)

    def compliance_of(self, rows: np.ndarray) -> np.ndarray:
        """(m,) what dual rows yield per force: zero but for contact rows.

        `at_contact` knows whole weights: where a part of them faces anything it yields more.
        """
        place, known = lookup(self.at_contact.row, rows)
        compliance = np.append(self.at_contact.compliance, 0.0)[np.where(known, place, -1)]
        contact = self.contact
        if contact.covered is None:
            return compliance
        order = np.argsort(contact.normal_row)
        place, known = lookup(contact.normal_row[order], rows)
        return compliance * np.where(known, (contact.weight / contact.faced)[order][place], 1.0)

    @property
    def own_rows(self) -> slice:
        """Those of `at_contact` that the rank owns."""
        return slice(*np.searchsorted(self.at_contact.row, self.row_range))


def partition(total: int, comm) -> tuple[int, int]:
    """Contiguous range of subdomains of this rank; ranks beyond the subdomains get none."""
    return total * comm.rank // comm.size, total * (comm.rank + 1) // comm.size
