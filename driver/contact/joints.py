"""Boundaries joined for good, by ties or periodically, whose meshes need not match.

Of every joint the first boundary carries multipliers without bounds, a row for either component of
the displacement at each of its nodes,

    u_i - 1/w_i int psi_i (u* o pi) ds = 0,

with the dual functions psi_i and the projection pi of mortar.py: rows like those of bilateral
contact, along x and y instead of along normal and tangent, without distance and without memory of
steps. Constant stress passes exactly (patch test), displacements converge as on one mesh
(Bernardi, Maday, Patera (1994); Wohlmuth (2000)). Rigid rotations of both sides together leave rows
of the order of the distance between the polygons of a curved boundary, h^2.

Periodic boundaries are those whose second side, moved by a translation, lies on the first: a tie
across it.

A node that other conditions constrain as well (a support in this component, contact, another joint)
has no multiplier: its neighbour on the edge takes the part over, as cross points of mortar methods
want it. So has one that a contact node of the second boundary meets, as at the tip of a crack whose
sides press, and a corner of the boundary, where the tractions of one stress are two. Rows stay
independent, whatever meets at the ends of joints.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..errors import InputError
from ..feti.edges import edge_labels, outward_edges
from ..feti.gathering import gather
from . import mortar
from .side import Side, rises
from .nodes import TURN

APART = 0.2  # distance of the sides over their longest edge from which they do not lie together
CONGRUENT = 1e-6  # distance of the ends of periodic sides over their length that rounding leaves
BOWED = 0.02  # relative difference of the lengths of polygons for one curve
HALF = 0.5  # share in what a contact node meets, above which a vertex is the one that it meets


@dataclass(frozen=True)
class Joint:
    """Two boundaries, by labels, that an effect `name` joins; across a translation if `periodic`.
    """

    name: str
    first: int
    second: int
    periodic: bool


@dataclass
class Edges:
    """Boundary edges of all subdomains, replicated: `label` (e,), gids `gid` (e, 2 or 3) of ends
    and middle, places `xy` (e, 2 or 3, 2); the body is on their left.
    """

    label: np.ndarray
    gid: np.ndarray
    xy: np.ndarray

    @property
    def lengths(self) -> np.ndarray:
        """(e,) lengths."""
        return np.linalg.norm(self.xy[:, 1] - self.xy[:, 0], axis=1)

    @property
    def normals(self) -> np.ndarray:
        """(e, 2) outward unit normals of the straight lines between the ends."""
        x, y = (self.xy[:, 1] - self.xy[:, 0]).T
        return np.column_stack([y, -x]) / np.hypot(x, y)[:, None]

    @property
    def ends(self) -> np.ndarray:
        """(k, 2) places where connected pieces begin or end."""
        _, first, count = np.unique(self.gid[:, :2], return_index=True, return_counts=True)
        return self.xy[:, :2].reshape(-1, 2)[first[count == 1]]

    @property
    def nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gids (n,) of the nodes, in their order, places (n, 2), and the edges by such nodes."""
        gids, first, inverse = np.unique(self.gid, return_index=True, return_inverse=True)
        return gids, self.xy.reshape(-1, 2)[first], inverse.reshape(self.gid.shape)

    def of(self, label: int) -> "Edges":
        """Those with a label."""
        here = self.label == label
        return Edges(self.label[here], self.gid[here], self.xy[here])

    def smooth_pieces(self) -> tuple[list["Edges"], np.ndarray]:
        """The edges in pieces that corners divide, and the gids of these corners.

        Tractions of one stress jump at a corner, and multipliers within a piece do not.
        """
        normal = self.normals
        gids, vertex = np.unique(self.gid[:, :2], return_inverse=True)
        vertex = vertex.reshape(-1, 2)
        before, after = np.full((2, len(gids)), -1)
        before[vertex[:, 1]], after[vertex[:, 0]] = np.arange(len(vertex)), np.arange(len(vertex))
        inner = (before >= 0) & (after >= 0)
        sharp = inner & ((normal[before] * normal[after]).sum(axis=1) < TURN)
        joins = inner & ~sharp
        graph = coo_matrix((np.ones(joins.sum()), (before[joins], after[joins])),
                           shape=(len(vertex),) * 2)
        count, number = connected_components(graph, directed=False)
        pieces = [Edges(self.label[here], self.gid[here], self.xy[here])
                  for here in (number == k for k in range(count))]
        return pieces, gids[sharp]

    def side(self, shift: np.ndarray, revolved: bool) -> tuple[Side, np.ndarray]:
        """The side that they make, moved by `shift` (2,), and the gids (n,) of its nodes."""
        gids, place, edges = self.nodes
        place = place + shift
        radius = place[:, 0] if revolved else None
        curved = rises(self.xy) if self.xy.shape[1] == 3 else {}
        return Side(place, edges, self.normals, curved.get("rise"), radius=radius, **curved), gids


def joined_edges(joints: list[Joint], manifest, subdomains, comm) -> Edges:
    """The edges of both sides of `joints`; collective."""
    nodes = 2 if manifest.element == "P1" else 3
    labels = sorted({label for joint in joints for label in (joint.first, joint.second)})
    parts = [np.empty((0, 1 + 3 * nodes))]
    for sub in subdomains:
        edges = outward_edges(sub.triangles)
        label = edge_labels(sub.edges, sub.edge_label, np.sort(edges, axis=1))
        edges, label = edges[np.isin(label, labels)], label[np.isin(label, labels)]
        if nodes == 3:
            edges = np.column_stack([edges, sub.middles(edges)])
        parts.append(np.column_stack([label, sub.node_gid[edges],
                                      sub.xy[edges].reshape(-1, 2 * nodes)]))
    table = gather(comm, np.concatenate(parts))
    return Edges(table[:, 0].astype(int), table[:, 1:1 + nodes].astype(int),
                 table[:, 1 + nodes:].reshape(-1, nodes, 2))


def with_joints(boundary, joints: list[Joint], edges: Edges, manifest, fixed):
    """A ContactBoundary with the rows of `joints`, whose sides have the `edges`, behind its own.

    `fixed` as fixed_dofs of feti returns it. Raises InputError for boundaries that cannot be
    joined.
    """
    rows = _joint_rows(boundary, joints, edges, manifest, fixed)
    if boundary.following is not None:
        boundary.following.joints = rows
    return appended(boundary, rows)


def _joint_rows(boundary, joints: list[Joint], edges: Edges, manifest, fixed) -> list[dict]:
    """The rows of `joints`, for `appended`."""
    labels = np.unique(edges.label)
    known = {label: np.unique(edges.of(label).gid) for label in labels}
    taken = np.unique(boundary.gid)
    chain = boundary.chain.max(initial=-1) + 1
    parts = []
    for joint in joints:
        others = [known[label] for other in joints for label in (other.first, other.second)
                  if other is not joint]
        crossing, swapped = (
            np.unique(np.concatenate([taken, known[second], *others,
                                      _met_from(boundary, known[second])]))
            for second in (joint.second, joint.first))
        able = np.setdiff1d(known[joint.second], swapped)
        rows = _rows(joint, edges, crossing, fixed[0], manifest.axisymmetric,
                     all(not np.isin(2 * able + k, fixed[0]).all() for k in (0, 1)))
        for part in rows:
            part["chain"] += chain
            chain = part["chain"].max(initial=chain - 1) + 1
        parts += rows
    return parts


def _met_from(boundary, second: np.ndarray) -> np.ndarray:
    """Gids of the vertices that contact nodes among the gids `second` meet.

    A row of the joint there would say of the same two vertices what contact says of them.
    """
    from_second = np.isin(boundary.gid[boundary.term_node], second)
    met = boundary.term_other & from_second & (np.abs(boundary.term_value) > HALF)
    return boundary.term_gid[met]


def _rows(joint: Joint, edges: Edges, crossing: np.ndarray, fixed: np.ndarray, revolved: bool,
          other_way: bool) -> list[dict]:
    """The rows of a joint for either component: arrays by name of members of ContactBoundary.

    `crossing` are gids of nodes with other conditions, `fixed` keys 2 gid + component, `other_way`:
    the second boundary has nodes that could carry the rows. `term_node` counts within the part.
    """
    one, two = edges.of(joint.first), edges.of(joint.second)
    shift = translation(joint, one, two, revolved) if joint.periodic else np.zeros(2)
    side = two.side(shift, revolved)
    pieces, corners = one.smooth_pieces()
    crossing, longest = np.append(crossing, corners), max(one.lengths.max(), two.lengths.max())
    parts = [part for piece in pieces
             for part in _of_piece(joint, piece, side, crossing, fixed, revolved, longest)]
    joined, gids = np.zeros(2, int), np.unique(one.gid)
    for k, part in enumerate(parts):
        joined[k % 2] += len(part["gid"])
    held = [np.isin(2 * gids + component, fixed).all() for component in (0, 1)]
    if not joined.any() or any(not joined[k] and not held[k] for k in (0, 1)):
        instead = f"name {joint.second} first, or " if other_way else ""
        raise InputError(f"{_words(joint)} do not face each other, or supports, contact and other "
                         f"joints constrain all nodes of {joint.first}: {instead}take a finer mesh")
    return parts


def _of_piece(joint: Joint, piece: Edges, side: tuple, crossing: np.ndarray, fixed: np.ndarray,
              revolved: bool, longest: float) -> list[dict]:
    """As `_rows` for one piece of the first boundary; `side` the second one and its gids.

    `longest` of all edges.
    """
    (first, gids), (second, others) = piece.side(np.zeros(2), revolved), side
    arc, piece = _along(first)
    parts = []
    for component in (0, 1):
        held = np.isin(2 * gids + component, fixed) | np.isin(gids, [*crossing, *others])
        try:
            coupled = mortar.couple(first, second, held)
        except InputError as problem:
            raise InputError(f"{_words(joint)}: {str(problem).split(': ', 1)[-1]}") from None
        here = np.flatnonzero(coupled.weight > 0)
        apart = np.abs(coupled.gap[here])
        if apart.max(initial=0.0) > APART * longest:
            x, y = first.xy[here[apart.argmax()]]
            raise InputError(f"{_words(joint)} do not lie on one another: near ({x:g}, {y:g}) they "
                             f"are {apart.max():.3g} apart; close the gap in the geometry")
        place = np.full(len(gids), -1)
        place[here] = np.arange(len(here))
        own = coupled.side == 0
        term_gid = np.where(own, gids[np.where(own, coupled.of, 0)],
                            others[np.where(own, 0, coupled.of)])
        direction = np.tile(np.eye(2)[component], (len(here), 1))
        parts.append({
            "gid": gids[here], "label": np.full(len(here), joint.first), "chain": piece[here],
            "xy": first.xy[here], "arc": arc[here], "weight": coupled.weight[here],
            "length": coupled.length[here], "normal": direction,
            "term_node": place[coupled.node], "term_gid": term_gid, "term_value": coupled.value,
            "term_other": ~own})
    return parts


def _words(joint: Joint) -> str:
    """How messages name a joint."""
    kind = "periodic boundaries" if joint.periodic else "tied boundaries"
    return f"the {kind} {joint.first} and {joint.second}"


def translation(joint: Joint, one: Edges, two: Edges, revolved: bool) -> np.ndarray:
    """(2,) by which the second side is to be moved onto the first one.

    Raises InputError where the sides are no translates of one another.
    """
    lengths = [float(side.lengths.sum()) for side in (one, two)]
    ends = [side.ends for side in (one, two)]
    marks = ends if all(map(len, ends)) else [side.xy[:, :2].reshape(-1, 2) for side in (one, two)]
    shift = marks[0].mean(axis=0) - marks[1].mean(axis=0)
    away = np.linalg.norm(ends[0][:, None] - ends[1][None] - shift, axis=2)
    missed = max(away.min(axis=k).max() for k in (0, 1)) if away.size else 0.0
    if len(ends[0]) != len(ends[1]) or missed > CONGRUENT * lengths[0] or (
            abs(lengths[0] - lengths[1]) > BOWED * lengths[0]):
        raise InputError(f"{_words(joint)} are no translates of one another, with lengths "
                         f"{lengths[0]:.6g} and {lengths[1]:.6g}: one must be the other one moved "
                         "along")
    if revolved and abs(shift[0]) > CONGRUENT * lengths[0]:
        raise InputError(f"{_words(joint)} have different radii: bodies of revolution repeat along "
                         "their axis only")
    return shift


def _along(side: Side) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths (n,) of the nodes along the side, and the numbers (n,) of its connected pieces.
    """
    after = dict(zip(side.edges[:, 0].tolist(), map(np.ndarray.tolist, side.edges)))
    starts = sorted(set(after) - set(side.edges[:, 1].tolist()))
    arc, piece = np.zeros(len(side.xy)), np.full(len(side.xy), -1)
    waiting, number = starts + sorted(after), 0  # closed sides begin anywhere
    for node in waiting:
        if piece[node] >= 0:
            continue
        piece[node] = number
        while node in after:
            _, end, *middle = after.pop(node)
            for other in (*middle, end):
                if piece[other] >= 0:
                    break
                step = np.linalg.norm(side.xy[other] - side.xy[node])
                arc[other], piece[other] = arc[node] + step, number
                node = other
        number += 1
    return arc, piece


def appended(boundary, parts: list[dict]):
    """The ContactBoundary with the rows `parts` of `_joint_rows` behind its own nodes."""
    start, placed = len(boundary.gid), []
    for part in parts:
        placed.append(part | {"term_node": part["term_node"] + start})
        start += len(part["gid"])
    joined = {name: np.concatenate([getattr(boundary, name), *(part[name] for part in placed)])
              for name in parts[0]}
    more = start - len(boundary.gid)
    none, family = np.full(start, -1), len(boundary.meeting) + 1
    return replace(
        boundary, **joined, joined=more, normal_row=none, tangential_row=none.copy(),
        family=np.append(boundary.family, np.full(more, family)),
        middle=np.append(boundary.middle, np.zeros(more, bool)),
        guided=np.append(boundary.guided, np.zeros(more, bool)),
        covered=None if boundary.covered is None else np.append(boundary.covered, np.ones(more))
    ).renewed(boundary.columns, boundary.gap, boundary.motion)
