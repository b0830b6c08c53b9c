"""How nodes touch in a step: what they leave open of quantities, whatever meshes say."""

from dataclasses import dataclass, field

import numpy as np

from ..contact.states import OPEN, SLIP
from .contact_edges import (EDGE, FALLS, beyond_ends, chains, doubt_of_ends, is_ring,
                            worn_ends)
from .quantities import (carried, corners_of_materials, farthest_node, longest_ways,
                         made_under_load, moves)
from .ways import onward, passed

FEW = 6  # nodes in contact, among which the next may differ by all of a quantity's error
STEEP = 1.5  # pressure over the mean one, two sides from an end of contact, of ends that are sharp
AREA = 3  # nodes that press side by side and tell where the force of an area of contact acts
CLOSED = 1e-9  # distance at time 0 over the largest displacement, below which a node is in contact
HALF = 0.5  # of a step in which a node touched, where nothing tells more
ONE_WAY = 0.9  # of all friction, if it has one direction


@dataclass(frozen=True)
class Touch:
    """Contact in a step, as far as errors of quantities depend on it."""

    nodes: int = 0  # that touch
    lone: float = 0.0  # part of the pressing force in areas of fewer than AREA nodes
    round: int = 0  # how many press, if some of them belong to a boundary whose normals vary
    straight: bool = False  # all that press belong to straight boundaries, and meet obstacles
    dragged: bool = False  # all that touch slide, and one way
    # (k, 2) of the nodes that slide: way since they last stuck or turned, and friction force
    onward: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    open: dict = None  # what nodes leave open by quantity
    pressure: np.ndarray = field(default_factory=lambda: np.zeros(0))  # of those that touch
    length: np.ndarray = field(default_factory=lambda: np.zeros(0))  # of their boundary
    # (k, 3) of the ends of boundaries, and of corners of materials on them: place, pressure over
    # the mean one of those that touch
    ends: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    # the same in the step until then in which contact carried most
    loaded: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    apart: float = np.inf  # least opening, where none touches
    # (m, 2) opening of the nodes that do not touch, and length of their boundary
    beside: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    # the same of those boundaries of which nothing touches
    aside: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    edges: float = 0.0  # length of the element sides in which contact ends, or may
    doubt: float = 0.0  # by how much other nodes would locate its ends elsewhere
    whole: float = 0.0  # length of all contact boundaries, from node to node
    cornered: bool = False  # a few nodes press, at ends of boundaries that go on nowhere
    earlier: bool = False  # slip was made in other states than that at the end of the step
    way_at_end: bool = False  # what has slid farthest is next to one of `ends`, none of a symmetry

    @classmethod
    def of(cls, nodes: dict, steps: dict, index: int, pressing_round: int,
           straight: bool = False) -> "Touch":
        """`nodes`, `steps` as of quantities.py; `pressing_round`: `round`, `straight` as above."""
        closed, pieces = steps["status"][index] != OPEN, chains(nodes)
        sliding = (steps["status"][index] == SLIP)[closed].all()
        sliding_at_all = (steps["status"][: index + 1] == SLIP).any()
        force = steps["sigma_t"][index] * nodes["weight"]
        one_way = abs(force.sum()) > ONE_WAY * np.abs(force).sum()
        whole = nodes.get("length", nodes["weight"])
        length = whole[closed]
        pressure = -steps["sigma_n"][index]
        most = int(carried(nodes, steps)[: index + 1].argmax())
        gap = steps["gap"][index] if "gap" in steps else nodes["gap"]
        opening = gap - steps["u_n"][index]
        apart = opening.min(initial=np.inf, where=not closed.any())
        aside = [node for piece in pieces if not closed[piece].any() for node in piece]
        pressing = pressure.clip(0) * nodes["weight"]
        lines = [piece for piece in pieces if len(piece) > 1]
        lengths = [float(np.diff(nodes["arc"][piece]).sum() + beyond_ends(nodes, piece).sum())
                   for piece in lines]
        return cls(
            nodes=int(closed.sum()), lone=_lone(nodes, pressing), round=pressing_round,
            straight=straight,
            dragged=bool(sliding and one_way), onward=onward(nodes, steps, index),
            open=between_nodes(nodes, steps, index),
            pressure=pressure[closed], length=length,
            ends=_at_ends(nodes, pieces, steps, index),
            loaded=_at_ends(nodes, pieces, steps, most), apart=float(apart),
            beside=np.column_stack([opening, whole])[~closed],
            aside=np.column_stack([opening, whole])[np.array(aside, int)],
            edges=sum(_sides(nodes, piece, closed[piece])
                      + _bays(nodes, piece, closed[piece], pressure[piece]) for piece in pieces),
            doubt=sum(doubt_of_ends(nodes, piece, steps, index) for piece in lines),
            whole=sum(lengths), cornered=_cornered(nodes, pieces, pressing),
            earlier=not made_under_load(nodes, steps, index),
            way_at_end=bool(sliding_at_all and _next_to_end(
                nodes, pieces, farthest_node(steps, index),
                corners_of_materials(nodes, steps, index))))

    def lighter(self, part: float) -> float:
        """Length of contact whose pressure is below a part of the mean one."""
        mean = self.pressure @ self.length / max(self.length.sum(), 1e-300)
        return float(self.length[self.pressure < part * mean].sum())

    def uncertain(self, way: float, part: float) -> float:
        """Length of boundary that may be in contact or not: that of nodes apart by less than `way`
        or under less than a `part` of the mean pressure, and the sides in which contact ends.
        """
        opening, length = self.beside.T
        return float(length[opening < way].sum() + self.lighter(part) + self.edges)


def _at_ends(nodes: dict, pieces: list, steps: dict, index: int) -> np.ndarray:
    """(k, 3) of the ends of boundaries, and of corners of materials where they are such as in
    quantities.py: place, pressure over the mean one of what touches.
    """
    ends = [end for piece in pieces if not is_ring(nodes, piece)
            for end in dict.fromkeys(piece[[0, -1]].tolist())]
    inside = corners_of_materials(nodes, steps, index)
    inside[ends] = False
    ends += np.flatnonzero(inside).tolist()
    pressure, closed = -steps["sigma_n"][index], steps["status"][index] != OPEN
    length = nodes.get("length", nodes["weight"])[closed]
    mean = pressure[closed] @ length / max(length.sum(), 1e-300)
    return np.column_stack([nodes["xy"][ends], pressure[ends] / (mean or 1.0)])


def _cornered(nodes: dict, pieces: list, force: np.ndarray) -> bool:
    """Whether all that presses, by nodal forces, is fewer than AREA nodes next to each end of a
    boundary, an end that is none of a line of symmetry and a corner of the outline: where a label
    ends on a smooth one force is at a node by the mesh.
    """
    smooth = nodes.get("smooth_end", np.zeros(len(force), bool))
    beside = np.zeros(len(force), bool)
    for piece in pieces:
        if not is_ring(nodes, piece):
            for few in (piece[:AREA - 1], piece[:-AREA:-1]):
                beside[few] |= not (nodes["mirrored"] | smooth)[few[0]]
    return bool((force > 0).any() and beside[force > 0].all())


def _next_to_end(nodes: dict, pieces: list, node: int, corners: np.ndarray) -> bool:
    """Whether a node is at an end of a boundary, of no line of symmetry, or at one of the `corners`
    (n,) of materials, or next to it.
    """
    near = 1 + int(nodes["middle"].any())
    for piece in pieces:
        at = np.flatnonzero(piece == node)
        if at.size and corners[piece[max(at[0] - near, 0):at[0] + near + 1]].any():
            return True
    return any(node in few for piece in pieces if not is_ring(nodes, piece)
               for few in (piece[:near + 1], piece[::-1][:near + 1])
               if not nodes["mirrored"][few[0]])


def _lone(nodes: dict, force: np.ndarray) -> float:
    """Part of the pressing nodal forces in areas of contact of fewer than AREA nodes."""
    lone = 0.0
    for piece in chains(nodes):
        own = force[piece]
        if is_ring(nodes, piece) and not own.all():
            own = np.roll(own, -int(np.argmin(own)))
        areas = np.split(own, np.flatnonzero(own == 0))
        lone += sum(area.sum() for area in areas if np.count_nonzero(area) < AREA)
    return float(lone / (force.sum() or 1.0))


def between_nodes(nodes: dict, steps: dict, index: int) -> dict[str, float]:
    """What nodes leave open of the contact length and of slip at step `index`, whatever meshes say.

    Beside a clamped node contact may be lost between it and a closed one, over half of the edge, or
    over all of it where the line through the last two pressures is below zero at its end.
    Where contact ends between two nodes the place is known to a part of the edge, and where
    pressure falls steeply towards an end of the boundary contact may end before it, by as much as
    `_before_ends` says where it would be zero there but for the end node, or as `worn_ends` does
    where wear has just reached it. In a dip of pressure it
    may be lost over a bay shorter than the sides beside it. An area of a node or two
    may reach over all of the edges beside it, or be a point. The largest slip may be
    elsewhere by as much as it differs from that of the next nodes that have touched, less what an
    obstacle has moved past it while they were open, which is the same everywhere. Slip and the
    place between two nodes where FEW nodes are in contact; where there are more by less in
    proportion, as meshes tell: of slip where more have slid, as it is zero wherever all stick, but
    not where it is largest at the last node before a sharp end of contact: it grows on from there
    to a place between nodes. Of contact that may end before the boundary meshes that all close its
    last node tell nothing. The largest pressure by how far it stands out from its neighbours, see
    `_standing_out`.
    """
    touching = steps["status"][: index + 1] != OPEN
    closed, edges, falls = touching[-1], [], []
    clamped, early, bays, apart, few = 0.0, 0.0, 0.0, 0.0, 0.0
    sliding = steps["status"][: index + 1] == SLIP
    way = np.where(sliding, moves(steps)[: index + 1], 0.0).sum(axis=0)
    top = farthest_node(steps, index)
    for piece in chains(nodes):
        if len(piece) > 1:
            pressure = -steps["sigma_n"][index][piece]
            edges += _ends(nodes, piece, closed[piece])
            bays += _bays(nodes, piece, closed[piece], pressure)
            if not is_ring(nodes, piece):
                clamped += _to_clamped(nodes, piece, closed[piece], pressure)
                early += _before_ends(nodes, piece, closed[piece], pressure)
                if "wear" in steps:
                    early += worn_ends(nodes, piece, closed[piece], pressure,
                                       steps["wear"][index][piece])
                falls += _falls(nodes, piece, closed[piece], pressure)
                few += _of_few(nodes, piece, closed[piece])
        near = piece[(np.abs(piece - top) <= 1) & touching[:, piece].any(axis=0)]
        if top in piece and len(near):
            ahead = np.where(touching[:, near], 0.0, passed(nodes, steps, index, top)[:, None])
            apart = float(np.abs(way[near] + ahead.sum(axis=0) - way[top]).max())
            if not _sharp_end(nodes, piece, closed, -steps["sigma_n"][index], top):
                apart *= min(1.0, FEW / max(1, np.count_nonzero(sliding[:, piece].any(axis=0))))
    share = min(1.0, FEW / max(1, np.count_nonzero(closed)))
    ends = EDGE * float(np.hypot(share * np.linalg.norm(edges), np.linalg.norm(falls)))
    return {"peak_pressure": _standing_out(nodes, np.abs(steps["sigma_n"][index])),
            "contact_length": few + bays + max(clamped, early, ends), "slip": apart}


def _sharp_end(nodes: dict, piece: np.ndarray, closed: np.ndarray, pressure: np.ndarray,
               node: int) -> bool:
    """Whether contact ends beside a node of a piece, from high pressure within two sides.

    As under a rounding that no more nodes resolve: where they do, it falls like r^(1/2).
    """
    k, sides = int(np.flatnonzero(piece == node)[0]), 4 if nodes["middle"].any() else 2
    if not closed[node] or closed[piece[max(k - 1, 0):k + 2]].all():
        return False
    length = nodes.get("length", nodes["weight"])[closed]
    near = pressure[piece[max(k - sides + 1, 0):k + sides]].max()
    return bool(near > STEEP * (pressure[closed] @ length) / length.sum())


def of_arrivals(nodes: dict, steps: dict) -> float:
    """What the steps leave open of the largest slip: ways in those that began open and ended in
    contact.

    Such a way counts whole, though the node slid in contact in a part of the step alone, see
    `_in_contact`. The largest slip is between that with such parts and that with all. Where the
    whole way is less than such a part of the next step's, the node came back on touching what it
    had gone before in the air: its way in contact is up to all of the next step's.
    """
    part, slip = _in_contact(nodes, steps), np.abs(steps["slip"])
    onward = np.zeros_like(slip)
    onward[:-1] = np.where(steps["status"][1:] == SLIP, slip[1:], 0.0)
    turned = (part < 1.0) & (slip < part * onward)
    least, most = (max(longest_ways(nodes, piece, steps | {"slip": way})[-1]
                       for piece in chains(nodes))
                   for way in (part * slip, np.where(turned, onward, slip)))
    return float(most - least)


def slid_on_arrival(nodes: dict, steps: dict) -> float:
    """Part of the farthest way of a node that it made in steps in which it began open."""
    top, arrives = farthest_node(steps, len(steps["status"]) - 1), _arrives(nodes, steps)
    way = np.where(steps["status"] == SLIP, moves(steps), 0.0)[:, top]
    return float(way[arrives[:, top]].sum() / (way.sum() or 1.0))


def _arrives(nodes: dict, steps: dict) -> np.ndarray:
    """(steps, n) whether nodes begin a step open and end it in contact."""
    closed = steps["status"] != OPEN
    began = nodes["gap"] <= CLOSED * np.abs(steps["u_n"]).max(initial=0.0)
    return closed & ~np.vstack([began, closed[:-1]])


def _in_contact(nodes: dict, steps: dict) -> np.ndarray:
    """(steps, n) part of each step in which nodes that are in contact at its end have been so.

    Pressure that grows at one rate from when a node touches, p at the end of the step and q of the
    next, says p / (q - p), all of the step if q is less than twice p. Where no step in contact
    follows half of the step is taken.
    """
    closed = steps["status"] != OPEN
    pressure = np.abs(steps["sigma_n"])
    rise = pressure[1:] - pressure[:-1]
    grown = np.divide(pressure[:-1], rise, out=np.ones_like(rise), where=rise > pressure[:-1])
    part = np.vstack([np.where(closed[1:], grown, HALF), np.full((1, closed.shape[1]), HALF)])
    return np.where(_arrives(nodes, steps), part, 1.0)


def _standing_out(nodes: dict, pressure: np.ndarray) -> float:
    """What the nodes beside it leave open of the largest pressure.

    Nodal pressures alternate about the true one, those of quadratic elements between vertices and
    middles, and the largest is one that is too high. Means of 1, 2, 1 parts of three nodes remove
    what alternates from node to node, of which they lack half of what a node stands out from the
    mean of its neighbours; of a smooth pressure that is h^2 |p''| / 4, of second order. A node that
    stands out alone, as on a mesh that is not even, is too high by more, see `_alone`. At an edge
    of contact pressure is not smooth. In a plane of symmetry the next node has its mirror image.
    """
    found = [0.0]
    for piece in chains(nodes):
        p, x = pressure[piece], nodes["arc"][piece]
        first, last = nodes["mirrored"][piece[[0, -1]]] & (len(piece) > 1)
        if first:
            p, x = np.append(p[1], p), np.append(2 * x[0] - x[1], x)
        if last:
            p, x = np.append(p, p[-2]), np.append(x, 2 * x[-1] - x[-2])
        k = int(np.argmax(p))
        if 0 < k < len(p) - 1 and p[k - 1 : k + 2].min() > 0:
            apart = p[1:-1] - (np.diff(x)[1:] * p[:-2] + np.diff(x)[:-1] * p[2:]) / (x[2:] - x[:-2])
            found.append(_alone(apart[max(k - 2, 0) : k + 1]) * apart[k - 1])
    return float(max(found))


def _alone(apart: np.ndarray) -> float:
    """Part of what a node stands out that is its own error; of one among three that stand `apart`.

    With c of the curvature and an error e in the node alone it stands out by c + e, its neighbours
    by c - e/2; where errors alternate, by 2e and -2e. Of both neighbours the one that says more of
    this counts, as the other may be at an end; and half at least.
    """
    if len(apart) < 3 or not apart[1] > 0:
        return HALF
    back = -min(apart[0], apart[2]) / apart[1]
    return float(np.clip(min((1 + back) / 1.5, 1.5 - back), HALF, 1.0))


def _element_sides(nodes: dict, piece: np.ndarray) -> np.ndarray:
    """(k - 1,) lengths of the element sides on which edges between the k nodes of a piece lie."""
    return np.diff(nodes["arc"][piece]) * (2 if nodes["middle"].any() else 1)


def _ends(nodes: dict, piece: np.ndarray, closed: np.ndarray) -> list[float]:
    """Lengths of the element sides of a piece in which contact ends."""
    return [*_element_sides(nodes, piece)[closed[1:] != closed[:-1]]]


def _of_few(nodes: dict, piece: np.ndarray, closed: np.ndarray) -> float:
    """Length of the edges to the next nodes of areas of contact of fewer than AREA nodes."""
    around = np.flatnonzero(np.diff(np.r_[False, closed, False]))  # firsts, and ends beyond lasts
    side = np.diff(nodes["arc"][piece])
    beside = [k for first, end in around.reshape(-1, 2) if end - first < AREA
              for k in (first - 1, end - 1) if 0 <= k < len(side)]
    return float(side[beside].sum()) if beside else 0.0


def _falls(nodes: dict, piece: np.ndarray, closed: np.ndarray,
           pressure: np.ndarray) -> list[float]:
    """Lengths of the last element sides of a piece in which contact may end, closed as they are."""
    side, ends = _element_sides(nodes, piece), []
    for end, near in ((0, 1), (-1, -2)):
        mirrored = nodes["mirrored"][piece[end]]
        if closed[end] and not mirrored and pressure[end] < FALLS * pressure[near]:
            ends.append(side[end] * (1 - max(pressure[end], 0.0) / pressure[near]))
    return ends


def _bays(nodes: dict, piece: np.ndarray, closed: np.ndarray, pressure: np.ndarray) -> float:
    """Length over which contact may be lost inside a piece, about nodes in a dip of its pressure.

    As beside a step of what it meets, which a body does not follow at once: where the bay is
    shorter than two sides no node is open, on this mesh and on coarser ones, but the one in it
    presses less than both that are next to it. It reaches the farther to them the less it presses.
    Beside an end of the boundary, where pressure rises, a dip is what it rises from.
    """
    side, length = np.diff(nodes["arc"][piece]), 0.0
    near = 2 if nodes["middle"].any() else 1
    for k in range(near + 1, len(piece) - near - 1):
        beside = pressure[[k - 1, k + 1]]
        if closed[k - 1:k + 2].all() and 0 <= pressure[k] < FALLS * beside.min():
            length += side[k - 1:k + 1] @ (1 - pressure[k] / beside)
    return float(length)


def _before_ends(nodes: dict, piece: np.ndarray, closed: np.ndarray,
                 pressure: np.ndarray) -> float:
    """Length at the ends of a piece, closed as they are, over which contact may have ended.

    The line through the next two pressures is below zero there, or the node at the end, which
    carries the force of half an edge, is the only one that does not follow their fall. Pressure
    vanishes like r^(1/2): its square locates the end.
    """
    arc, early = nodes["arc"][piece], 0.0
    for end, near, far in ((0, 1, 2), (-1, -2, -3)) if len(piece) > 3 else ():
        p, q = max(pressure[near], 0.0), pressure[far]
        last, side = abs(arc[near] - arc[end]), abs(arc[far] - arc[near])
        if closed[end] and not nodes["mirrored"][piece[end]] and p < q and (
                p * side < (q - p) * last or p < pressure[end]):
            early += last - min(last, side * p**2 / (q**2 - p**2))
    return early


def _to_clamped(nodes: dict, piece: np.ndarray, closed: np.ndarray, pressure: np.ndarray) -> float:
    """Length of the edges beyond the ends of a piece, to clamped nodes, over which contact may be
    lost.
    """
    side, lost = np.diff(nodes["arc"][piece])[[0, -1]], 0.0
    for beyond, edge, end, near in zip(beyond_ends(nodes, piece), side, (0, -1), (1, -2)):
        vanishes = (pressure[near] - pressure[end]) * beyond > pressure[end] * edge
        lost += closed[end] * beyond * (1.0 if vanishes else 0.5)
    return float(lost)


def _sides(nodes: dict, piece: np.ndarray, closed: np.ndarray) -> float:
    """Length of the element sides of a piece in which contact ends, or at whose ends it does."""
    side = _element_sides(nodes, piece)
    at_end = 0.0 if is_ring(nodes, piece) or not len(side) else side[[0, -1]] @ closed[[0, -1]]
    return float(side[closed[1:] != closed[:-1]].sum() + at_end)
