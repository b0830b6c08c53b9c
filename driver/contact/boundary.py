"""The contact boundary: its nodes, gaps and weights, on rigid obstacles and between two bodies.

On a rigid obstacle a node's displacement is constrained alone: the multipliers are dual to the
traces of the shape functions, and force / weight is the mean of the traction with the node's
function, whose integral is the weight. With linear and quadratic functions in 2D all weights are
positive, so that bounds of tractions are bounds of forces, and the mean of a linear traction is its
value at the node (not at the ends of a boundary of linear elements). Any force at the nodes is seen
by a displacement of the same nodes, of bounded norm: the inf-sup condition (see mortar.py).
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ..vectors import turned_left

# members of ContactBoundary, arrays (n_c, ...)
NODAL = ("gid", "label", "chain", "xy", "arc", "weight", "length", "normal", "gap", "family",
         "middle", "guided", "normal_row", "tangential_row")
TERMS = ("term_node", "term_gid", "term_value", "term_other")
# slope of an obstacle at a line of symmetry: part of that beyond the next node which a mesh cannot
# tell from none, and what is rounding
LEVEL, STRAIGHT = 0.1, 1e-9


@dataclass
class ClampedContact:
    """Nodes on contact edges that supports fix in both components: without contact condition.

    Arrays of length n_k; `values` (n_k, 2, patterns) are the prescribed displacements.
    """

    gid: np.ndarray
    label: np.ndarray
    xy: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    values: np.ndarray
    motion: object = None  # an ObstacleMotion of contact/motion.py, if any


@dataclass
class HeldInPairs:
    """Nodes between bodies that supports hold along their normal: without contact condition.

    Arrays of length m; `gap` before any load, `other` the label that they meet, -1 if there are
    several. What they meet moves from them by the sum of value_k u(gid_k) over the terms k with
    node_k = i (held.py).
    """

    label: np.ndarray
    other: np.ndarray
    xy: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    term_node: np.ndarray
    term_gid: np.ndarray
    term_value: np.ndarray


@dataclass
class Configuration:
    """Displacements u (k, 2) of the vertices `gid` (k,), about which pairs are linearized."""

    gid: np.ndarray
    u: np.ndarray


@dataclass
class ContactBoundary:
    """All contact nodes of the body, replicated on every rank; arrays of length n_c.

    `weight` is the integral of the node's function, of bodies of revolution over the revolution
    (rings.py), `length` that along the boundary. `columns` are what declared effects give
    the nodes (see ContactData), means over dual segments; `gap` is the distance to what the node
    meets: the column of that name, plus that of the two bodies of a pair. Where obstacles move it
    is that at time 0, and `at` gives those of later times.

    Ordered by `chain`, then along the arc: see chains.py. `normal_row` and `tangential_row` are
    global dual rows, -1 where a node has none (frictionless contact, or a direction that the
    support fixes). What meets at node i is the sum of value_k u(gid_k) over the terms k with
    node_k = i: its own displacement on a rigid obstacle, a mortar jump where `paired`. `edges` are
    pairs of nodes, those of `clamped` counted on. `corners` (v, 4) as from corner_pairs.py. The
    last `joined` entries are no contact nodes but rows of joints.py: without gap and friction, with
    a component of the displacement in the place of the normal one.
    """

    gid: np.ndarray
    label: np.ndarray
    chain: np.ndarray
    xy: np.ndarray
    arc: np.ndarray
    weight: np.ndarray
    length: np.ndarray
    normal: np.ndarray
    columns: dict[str, np.ndarray]
    gap: np.ndarray
    family: np.ndarray  # 0 on rigid obstacles, else from 1 on the number of those in `meeting`
    meeting: list[list[tuple[int, int]]]  # pairs of labels, together where they are one boundary
    middle: np.ndarray  # the node is the middle of an edge
    term_node: np.ndarray
    term_gid: np.ndarray
    term_value: np.ndarray
    term_other: np.ndarray  # the term belongs to the other body
    guided: np.ndarray  # supports leave it one direction to move in, from what it meets
    normal_row: np.ndarray
    tangential_row: np.ndarray
    edges: np.ndarray  # (e, 2), on rigid obstacles
    clamped: ClampedContact
    held: HeldInPairs | None = None  # None: no node of a pair is
    corners: np.ndarray = field(default_factory=lambda: np.empty((0, 4), int))
    about: Configuration | None = None  # of pairs; None: the initial geometry
    axisymmetric: bool = False
    motion: object = None  # the ObstacleMotion; None: obstacles stand still
    joined: int = 0
    periods: object = None  # the Periods of periods.py; None: nothing repeats itself
    # (k, 2) nodes that follow one another across a period, and lengths (k,) of the boundary there
    seams: tuple = (np.empty((0, 2), int), np.zeros(0))
    # where contact follows the motion: what finds it about other displacements (following.py), the
    # covered part (n_c,) of the nodes' weights, and the time that it belongs to
    following: object = None
    covered: np.ndarray | None = None
    time: float = 0.0

    @property
    def is_joint(self) -> np.ndarray:
        """(n_c,) whether the entry is the row of a joint."""
        return np.arange(len(self.gid)) >= len(self.gid) - self.joined

    @property
    def declared(self) -> "ContactBoundary":
        """The contact nodes without the rows of joints."""
        if not self.joined:
            return self
        count, terms = len(self.gid) - self.joined, ~self.is_joint[self.term_node]
        parts = {name: getattr(self, name)[:count] for name in NODAL}
        parts |= {name: getattr(self, name)[terms] for name in TERMS}
        if self.covered is not None:
            parts["covered"] = self.covered[:count]
        return replace(self, **parts, joined=0, motion=self.motion and self.motion.of(
            np.arange(count)), columns={
                name: column[:count] for name, column in self.columns.items()})

    def renewed(self, columns: dict[str, np.ndarray], gap: np.ndarray,
                motion) -> "ContactBoundary":
        """The same with other columns, gaps (n,) and motions of the declared nodes."""
        none = np.zeros(self.joined)
        return replace(
            self, gap=np.append(gap, none), motion=motion and motion.padded(self.joined),
            columns={name: np.append(column, none) for name, column in columns.items()})

    def at(self, time: float) -> "ContactBoundary":
        """The boundary with the distances at `time`; itself where no obstacle moves."""
        if self.motion is None:
            return self
        clamped = replace(self.clamped, gap=self.clamped.motion.gap_at(time))
        return replace(self, gap=self.motion.gap_at(time), clamped=clamped)

    def way(self, before: float, now: float) -> np.ndarray | float:
        """(n_c,) tangential displacement of the obstacles' surfaces, 0 where none moves."""
        return 0.0 if self.motion is None else self.motion.way(before, now)

    def has_rows_of(self, other: "ContactBoundary") -> bool:
        """Whether another boundary of the same nodes has the same rows, to the last bit."""
        return all(np.array_equal(getattr(self, name), getattr(other, name))
                   for name in ("normal", "covered", *TERMS))

    @property
    def onward(self) -> np.ndarray:
        """(n_c,) the node that follows across a period; -1: none does."""
        onward, (one, two) = np.full(len(self.gid), -1), self.seams[0].T
        onward[one], onward[two] = two, one
        return onward

    @property
    def seam(self) -> np.ndarray:
        """(n_c,) length of the boundary to the node that follows across a period, 0 without one."""
        seam = np.zeros(len(self.gid))
        seam[self.seams[0]] = self.seams[1][:, None]
        return seam

    @property
    def motion_of_all_times(self):
        """The ObstacleMotion, also where contact follows it; None: obstacles stand still."""
        return (self.following or self).motion

    @property
    def start(self) -> "ContactBoundary":
        """That before any load, where contact follows the motion; else the boundary itself."""
        return self if self.following is None else self.following.start

    @property
    def moves(self) -> bool:
        """Whether gaps differ from step to step."""
        return self.motion is not None or self.following is not None

    @property
    def idle(self) -> np.ndarray:
        """(n_c,) whether the node faces nothing, and its rows do not act."""
        return np.zeros(len(self.gid), bool) if self.covered is None else self.covered <= 0

    @property
    def faced(self) -> np.ndarray:
        """(n_c,) part of the weight that faces anything; of nodes that face nothing all of it."""
        if self.covered is None:
            return self.weight
        return self.weight * np.where(self.covered > 0, self.covered, 1.0)

    @property
    def mirrored(self) -> np.ndarray:
        """(n_c,) whether a support lets nodes move along the normal alone: a line of symmetry.

        Unless an obstacle is not level there, and with its image has a kink.
        """
        along = np.abs(self.tangent).max(axis=1, initial=0.0) > 0.99  # of one component
        found = self.guided & (self.normal_row >= 0) & along
        for node in np.flatnonzero(found & ~self.paired):
            found[node] = self._level_at(node)
        return found

    def _level_at(self, end: int) -> bool:
        """Whether the gap at an end of a boundary, of nodes sorted by arc, begins without slope.

        By the parabola through three nodes, beside the slope between the next two. True of shorter
        boundaries.
        """
        own = np.flatnonzero(self.chain == self.chain[end])
        own = own[:3] if own[0] == end else own[:-4:-1]
        if len(own) < 3 or own[0] != end:
            return True
        x, gap = np.abs(self.arc[own] - self.arc[end])[1:], self.gap[own]
        near, far = np.diff(gap) / np.diff(np.append(0.0, x))
        slope = near - x[0] * (far - near) / x[1]
        return bool(abs(slope) <= LEVEL * abs(far) + STRAIGHT)

    @property
    def behind(self) -> np.ndarray:
        """(n_c,) distance by which pairGap has the surface behind the boundary as it is drawn."""
        declared = self.columns.get("gap", np.zeros(len(self.gid)))
        return np.where(self.paired, np.maximum(declared, 0.0), 0.0)

    @property
    def paired(self) -> np.ndarray:
        """(n_c,) whether the node meets another body."""
        return self.family > 0

    @property
    def coupled(self) -> np.ndarray:
        """(n_c,) whether a condition is made of several displacements; all of pairs count so."""
        if not self.axisymmetric:
            return self.paired
        return self.paired | (np.bincount(self.term_node, minlength=len(self.gid)) > 1)

    @property
    def tangent(self) -> np.ndarray:
        """(n_c, 2): the normal turned by +90 degrees."""
        return turned_left(self.normal)
