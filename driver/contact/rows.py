"""Contact conditions at the contact nodes: a rank's rows, bounds of multipliers, node states.

Multipliers are nodal forces on the body: lambda_n >= 0 presses along -n, lambda_t pushes along -t,
so that sigma_n = -lambda_n / weight and sigma_t = -lambda_t / weight. With r = F lambda - d the
rows read B u - c = -r, where c is the gap (normal) or the previous tangential displacement
(tangential rows).
"""

import contextlib
from dataclasses import dataclass

import numpy as np

from ..feti.rows import RowKind
from ..feti.structure import Substructure
from .corner_nodes import CornerNodes, corner_nodes
from .law import ContactLaw, friction_bound
from .states import OPEN, SLIP, STICK

ROUNDING = 1e-13  # relative, of a bound: a pressure is a sum of hundreds of terms


@dataclass
class ContactRows:
    """The contact rows a rank owns, as positions in its dual vectors.

    `normal` (k,) with `normal_node`, `gap` and whether contact `pulls` there by its law;
    `tangential` (j,) with `tangential_node` and `pair`, the position of the same node's normal row.
    `coefficient` (j,) of friction, and `offset` (j,) of its bound, are None where no declared
    effect has one; the march changes both from step to step. `gluing` are the rows of interfaces.
    `corners` are vertices with two contact nodes, whose states exclude rows: their multipliers are
    zero. None where there are none. `idle` are rows of nodes that face nothing, likewise, if any.
    """

    normal: np.ndarray
    normal_node: np.ndarray
    gap: np.ndarray
    tangential: np.ndarray
    tangential_node: np.ndarray
    pair: np.ndarray
    coefficient: np.ndarray | None
    offset: np.ndarray | None
    gluing: np.ndarray
    pulls: np.ndarray
    corners: CornerNodes | None = None
    idle: np.ndarray | None = None

    @property
    def bilateral(self) -> np.ndarray:
        """(k,) whether normal multipliers may have any sign: by the law, or as a vertex stands."""
        if self.corners is None:
            return self.pulls
        return self.pulls | np.isin(self.normal, self.corners.standing)

    @contextlib.contextmanager
    def under(self, coefficient: np.ndarray | None, offset: np.ndarray | None):
        """Other coefficients (j,) and offsets (j,) of the friction bounds, until the block ends."""
        known = self.coefficient, self.offset
        self.coefficient, self.offset = coefficient, offset
        try:
            yield
        finally:
            self.coefficient, self.offset = known

    @property
    def bound_is_given(self) -> bool:
        """Whether friction bounds do not depend on the pressure: then a step is one QP."""
        return self.coefficient is None

    def limits(self, size: int, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of all owned multipliers under the nodal pressures in `pressure` (owned,)."""
        return self.limits_at(size, self.friction_bound(pressure))

    def limits_at(self, size: int, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same under the friction bounds `bound` (j,)."""
        lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
        lower[self.normal[~self.bilateral]] = 0.0
        lower[self.tangential], upper[self.tangential] = -bound, bound
        excluded = self.excluded
        lower[excluded] = upper[excluded] = 0.0
        return lower, upper

    @property
    def excluded(self) -> np.ndarray:
        """Rows without force: those that states of corners exclude, those that face nothing."""
        corners = None if self.corners is None else self.corners.excluded
        return np.concatenate([np.zeros(0, int), *(rows for rows in (corners, self.idle)
                                                   if rows is not None)])

    def pressing(self, x: np.ndarray) -> np.ndarray:
        """x without the pulling normal multipliers that contact has not, unless it is bilateral."""
        pressed, unilateral = x.copy(), self.normal[~self.bilateral]
        pressed[unilateral] = np.maximum(x[unilateral], 0.0)
        return pressed

    def sliding(self, x: np.ndarray, bound: np.ndarray) -> np.ndarray:
        """(j,) sign of the multiplier at tangential rows on their bound, 0 at the others.

        A bound that follows from a pressure is off by the rounding of that.
        """
        multiplier = x[self.tangential]
        return np.where(np.abs(multiplier) >= (1 - ROUNDING) * bound, np.sign(multiplier), 0.0)

    def follow(self, x: np.ndarray, sliding: np.ndarray) -> np.ndarray:
        """x with sliding nodes moved to the friction bound of x, and the others cut at it.

        If they stayed where they were, sliding nodes would be inside a bound that has grown, and
        the QP would have to find them again one expansion step after the other.
        """
        moved, t = x.copy(), self.tangential
        bound = self.friction_bound(x)
        moved[t] = np.where(sliding != 0, sliding * bound,
                            np.minimum(np.maximum(x[t], -bound), bound))
        return moved

    def friction_bound(self, multipliers: np.ndarray) -> np.ndarray:
        """(j,) largest friction forces under the pressures in the dual vector `multipliers`.

        Zero where a corner's state excludes friction.
        """
        bound = self.law_bound(multipliers)
        if self.corners is not None:
            bound = bound.copy()
            bound[self.corners.without_friction] = 0.0
        return bound

    def law_bound(self, multipliers: np.ndarray) -> np.ndarray:
        """(j,) the same by the law alone, whatever the states of corners."""
        return friction_bound(self, multipliers[self.pair])

    def states(self, multipliers: np.ndarray) -> np.ndarray:
        """(k,) OPEN, STICK or SLIP of the nodes with a normal row, by exact comparison."""
        states = np.full(len(self.normal), STICK)
        states[(multipliers[self.normal] == 0) & ~self.bilateral] = OPEN
        sliding = np.abs(multipliers[self.tangential]) >= self.law_bound(multipliers)
        place = np.searchsorted(self.normal_node, self.tangential_node)
        states[place[sliding & (states[place] == STICK)]] = SLIP
        if self.coefficient is None and self.offset is None:  # nothing holds a node that touches
            states[states == STICK] = SLIP
        return states


def contact_rows(structure: Substructure, law: ContactLaw) -> ContactRows:
    """The rank's contact rows from the replicated contact boundary and its law."""
    contact, (start, stop) = structure.contact, structure.row_range
    normal = np.flatnonzero((contact.normal_row >= start) & (contact.normal_row < stop))
    tangential = np.flatnonzero((contact.tangential_row >= start) & (contact.tangential_row < stop))
    coefficient, offset = (None if values is None else values[tangential]
                           for values in (law.coefficient, law.offset))
    place = np.full(len(contact.gid), -1)
    place[tangential] = np.arange(len(tangential))
    idle = None
    if contact.idle.any():
        idle = np.concatenate([contact.normal_row[normal][contact.idle[normal]],
                               contact.tangential_row[tangential][contact.idle[tangential]]])
        idle = idle - start
    return ContactRows(contact.normal_row[normal] - start, normal, contact.gap[normal],
                       contact.tangential_row[tangential] - start, tangential,
                       contact.normal_row[tangential] - start, coefficient, offset,
                       np.flatnonzero(structure.row_kind == RowKind.GLUING),
                       law.bilateral[normal], corner_nodes(structure, place, law), idle)
