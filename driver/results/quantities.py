"""Values of the quantities of interest, whose meanings and units are in quantity_table.py.

Peaks lie between nodes, by the parabola through three (`largest_pressure`), and so do ends of
contact (contact_edges.py). Of several boundaries the magnitudes of resultants are added
(`resultant`); friction's work is of dissipation.py.

All but slip, energy and worn volume belong to one moment, the end of the load history; where
contact carries nothing then, to the step at which it carries most, and where it never does, or
there is none, and the body is not deformed then, to that of the largest displacement.
"""

import numpy as np

from ..contact.states import OPEN, SLIP
from .contact_edges import (beyond_ends, chains, contact_length, edges_of_contact, is_ring,
                            onward)
from .kinks import kinks

END = 2  # nodes that count as the end of a boundary
NEARLY = 0.5  # part of the largest pressure that may exceed it on a finer mesh
REPEATS = "repeats"  # column of steps: how often each is gone through, if not once
AS_NOW = 0.9  # part of a history's slip, and of its largest force, that is one with all of it
NOTHING = 1e-5  # part of the largest resultant of the history that tolerances leave


def quantities(effects, nodes: dict, steps: dict, displacement) -> tuple[dict[str, float], int]:
    """Values of `effects.quantities` by name, and the index of the step that they belong to.

    `nodes` holds the columns xy (n, 2), arc, weight, length (by default the weight), gap, chain,
    paired, middle and mirrored (n,) of the contact nodes, sorted by chain and arc; `steps` u_n,
    slip, sigma_n, sigma_t and status (steps, n) and, with friction, its `work` (steps, n) from
    dissipation.py; `displacement` (steps,) the largest displacement in the body. All as in
    contact.csv and history.csv, status as its code.
    """
    displacement = np.asarray(displacement, float)
    if not effects.contact:
        index = _moment(displacement)
        return {"displacement": float(displacement[index])}, index
    forces, pieces = carried(nodes, steps), chains(nodes)
    index = _moment(forces if forces.any() else displacement)
    values = of_moment(effects, nodes, steps, displacement, index)
    if effects.frictional:
        values |= {"slip": max(longest_ways(nodes, piece, steps)[-1] for piece in pieces),
                   "dissipated_energy": steps["work"].sum()}
    if "worn_volume" in effects.quantities:
        values["worn_volume"] = steps["wear"][-1] @ nodes["weight"]
    return {name: float(values[name]) for name in effects.quantities}, index


def of_moment(effects, nodes: dict, steps: dict, displacement, index: int) -> dict[str, float]:
    """Those of the quantities that belong to one moment, in the step `index`; as `quantities`."""
    if not effects.contact:
        return {"displacement": float(displacement[index])}
    pressure, weight = -steps["sigma_n"][index], nodes["weight"]
    shares = nodes.get("shares", np.ones((1, len(weight))))
    values = {"peak_pressure": largest_pressure(nodes, chains(nodes), pressure),
              "normal_resultant": resultant(shares, pressure, weight),
              "contact_length": contact_length(nodes, chains(nodes), steps, index),
              "displacement": displacement[index]}
    if effects.frictional:
        values["tangential_resultant"] = resultant(shares, steps["sigma_t"][index], weight)
    return {name: float(values[name]) for name in effects.quantities if name in values}


def resultant(shares: np.ndarray, tractions: np.ndarray, weight: np.ndarray):
    """Integral of nodal `tractions` (..., n); of several boundaries the sizes of theirs, added.

    `shares` (boundaries, n) are those of the boundaries in the nodes, see shares.py.

    Directions of different boundaries have nothing to do with each other: forces on the two flanks
    of a groove must not cancel.
    """
    if len(shares) <= 1:
        return tractions @ weight
    return sum(abs(tractions @ (weight * share)) for share in shares)


def singular_places(nodes: dict, steps: dict, index: int) -> tuple[str, ...]:
    """Quantities that may be infinite: a largest pressure where contact reaches the boundary's end,
    or beside which it ends within a side, as under an edge or a rounding that no node resolves, or
    next to corners_of_materials, or to a kink of a rigid obstacle (kinks.py).

    `nodes` as above and `mirrored` (n,), where a support lets nodes move along the normal alone, as
    in a plane of symmetry, unless the next node slides: in such a plane shear vanishes, and where
    it does not pressure grows like the logarithm of the distance. Under the edge of a punch, where
    a body ends on another or beside a clamped corner pressures grow like a negative power of the
    distance, or like none: meshes hardly tell which, nor on which of them an end begins to exceed
    the rest. Where a period ends contact goes on. Bilateral contact pulls as well, and its peak is
    the largest of both: tension that grows at an end is no less singular.
    """
    pressure, status = np.abs(steps["sigma_n"][index]), steps["status"][index]
    rubs = (status == SLIP) & (steps["sigma_t"][index] != 0)
    largest, at_end = pressure.max(initial=0.0), 0.0
    side = 2 if nodes["middle"].any() else 1
    near = END * side
    corners = corners_of_materials(nodes, steps, index) | kinks(nodes, steps, index)
    for piece in chains(nodes):
        for k in np.flatnonzero(corners[piece]):
            at_end = max(at_end, pressure[piece[max(k - near + 1, 0):k + near]].max())
        if is_ring(nodes, piece):
            continue
        p = np.maximum(pressure[piece], traction(nodes, pressure, piece))
        top = int(p.argmax())
        if (status[piece][max(top - side, 0):top + side + 1] == OPEN).any():
            at_end = max(at_end, p[top])
        for end, outer, follows in zip((0, -1), (slice(near), slice(-near, None)),
                                       onward(nodes, piece)):
            mirrored = nodes["mirrored"][piece[end]] and not rubs[piece[outer]].any()
            if status[piece[end]] != OPEN and not mirrored and follows < 0:
                at_end = max(at_end, p[outer].max())
    return ("peak_pressure",) if at_end > NEARLY * largest else ()


def corners_of_materials(nodes: dict, steps: dict, index: int) -> np.ndarray:
    """(n,) where, in step `index`, stresses grow towards corners of materials that contact nodes
    are at, see material_corners.py: where friction acts or the other side yields.
    """
    corners = nodes.get("material_corner", np.zeros(len(nodes["arc"]), bool))
    acts = nodes["paired"] | bool(np.any(steps["sigma_t"][index]))
    return corners & acts & (steps["status"][index] != OPEN)


def carried(nodes: dict, steps: dict) -> np.ndarray:
    """(steps,) what contact carries, of bilateral contact, which may push and pull alike, sizes."""
    return np.abs(steps["sigma_n"]) @ nodes["weight"]


def made_under_load(nodes: dict, steps: dict, index: int) -> bool:
    """Whether the largest slip until step `index` was made one way, under what contact carries
    then: it did not turn, nor come to rest, nor did contact carry more before, but for AS_NOW. So
    is no slip.
    """
    node, force = farthest_node(steps, index), carried(nodes, steps)[: index + 1]
    sliding = steps["status"][: index + 1, node] == SLIP
    way = np.where(sliding, steps["slip"][: index + 1, node], 0.0)
    as_now = abs(way.sum()) >= AS_NOW * np.abs(way).sum() and force[-1] >= AS_NOW * force.max()
    return bool(as_now and sliding[-1] or not way.any())


def _moment(size: np.ndarray) -> int:
    """The last step, or that of the largest `size` (steps,) where nothing is left in the last."""
    return len(size) - 1 if size[-1] > NOTHING * size.max() else int(np.argmax(size))


def largest_pressure(nodes: dict, pieces: list[np.ndarray], pressure: np.ndarray) -> float:
    """Largest |pressure| (n,) on the nodes' `pieces`, between nodes and at ends from inside."""
    if not len(pressure):
        return 0.0
    size = np.abs(pressure)
    return max(_largest(nodes, size, piece) for piece in pieces)


def _largest(nodes: dict, pressure: np.ndarray, piece: np.ndarray) -> float:
    """The same of pressures (n,) that are positive on one piece."""
    members, arc, own = _over_period(nodes, piece)
    p = pressure[members]
    p[own] = traction(nodes, pressure, piece)
    return peak(arc, p, _top(p, own))


def _over_period(nodes: dict, piece: np.ndarray) -> tuple[np.ndarray, np.ndarray, slice]:
    """Nodes (k,) of a piece and their arc (k,), with the next node beyond where a period ends, and
    which of them are the piece.
    """
    members, arc, begin = piece, nodes["arc"][piece], 0
    for end, follows in zip((0, -1), onward(nodes, piece)):
        if follows >= 0:
            side = nodes["seam"][piece[end]]
            at, place = (len(arc), arc[-1] + side) if end else (0, arc[0] - side)
            arc, members = np.insert(arc, at, place), np.insert(members, at, follows)
            begin += at == 0
    return members, arc, slice(begin, begin + len(piece))


def _top(values: np.ndarray, own: slice) -> int:
    """Where values (k,) are largest: where the piece's `own` are, rather than at an image of it."""
    top = own.start + int(np.argmax(values[own]))
    return top if values[top] >= values.max() else int(np.argmax(values))


def traction(nodes: dict, pressure: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Pressures (k,) of the nodes of a piece, those at ends of the boundary continued from inside.

    An end node has half a dual segment and one or two triangles: force over weight errs there by
    O(h) however smooth the pressure is. The line through its neighbours is of second order. With
    quadratic elements so is the node's own: its shape function has no first moment. On a line of
    symmetry, where `mirrored` nodes (n,) are, pressure is level, and that a parabola. Across a
    period the boundary goes on.
    """
    p, x = pressure[piece].copy(), nodes["arc"][piece]
    if nodes["middle"].any():
        return p
    level = nodes["mirrored"][piece]
    for end, (near, far), edge in zip((0, -1), ((1, 2), (-2, -3)), beyond_ends(nodes, piece)):
        if edge <= 0 and len(piece) > 3 and min(p[[end, near, far]]) > 0:
            one, two = np.abs(x[[near, far]] - x[end])
            share = one**2 / (two**2 - one**2) if level[end] else one / (two - one)
            p[end] = max(0.0, p[near] + share * (p[near] - p[far]))
    return p


def peak(arc: np.ndarray, values: np.ndarray, top: int | None = None) -> float:
    """Largest of `values` (k,) over `arc`, of a parabola where both neighbours are positive.

    At an edge of contact, beyond which they vanish, they are not smooth. `top` is the largest node
    where that is known.
    """
    k = int(np.argmax(values)) if top is None else top
    if k in (0, len(values) - 1):
        return float(values[k])
    x, y = arc[k - 1 : k + 2] - arc[k], values[k - 1 : k + 2]
    if y.min() <= 0:
        return float(y[1])
    left, right = (y[1] - y[0]) / -x[0], (y[2] - y[1]) / x[2]
    bend = (right - left) / (x[2] - x[0])
    slope = left + bend * -x[0]
    return float(y[1] - slope**2 / (4 * bend)) if bend < 0 else float(y[1])


def moves(steps: dict) -> np.ndarray:
    """(steps, n) sizes of slips, as often as each step is gone through."""
    size = np.abs(steps["slip"])
    return size * steps[REPEATS] if REPEATS in steps else size


def longest_ways(nodes: dict, piece: np.ndarray, steps: dict) -> np.ndarray:
    """(steps,) longest way until each step that a point of a piece has slid in contact, also
    between its nodes.

    Slip is often largest at an edge of contact; the last closed node alone would tell it by the
    mesh size only. What the open node beyond has moved while its neighbour slid counts up to it.
    Where contact recedes the farthest point lies at an edge of before: no way becomes shorter.
    """
    members, arc, own = _over_period(nodes, piece)
    move, status = moves(steps)[:, members], steps["status"][:, members]
    sliding = status == SLIP
    way, longest = np.where(sliding, move, 0.0).cumsum(axis=0), np.zeros(len(move))
    for k, slid in enumerate(way):
        top = _top(slid, own)
        longest[k] = peak(arc, _on_the_same_way(slid, status[: k + 1], sliding[: k + 1], top), top)
        for *ends, part in edges_of_contact(nodes, piece, steps, k):
            closed, beyond = np.add(ends, own.start)
            along = sliding[: k + 1, closed] | sliding[: k + 1, beyond]
            with_it = np.where(along, move[: k + 1, beyond], 0.0).sum()
            side = abs(arc[beyond] - arc[closed])
            longest[k] = max(longest[k],
                             float(slid[closed] + part / side * (with_it - slid[closed])))
    return np.maximum.accumulate(longest)


def _on_the_same_way(slid: np.ndarray, status: np.ndarray, sliding: np.ndarray,
                     top: int) -> np.ndarray:
    """`slid` (k,), zero beside the node `top` that slid farthest where nodes were open while it
    did.

    Their ways are shorter by what it did alone: a step that no parabola follows. `status` and
    `sliding` (steps, k) until then.
    """
    near = slice(max(top - 1, 0), top + 2)
    left = ((status[:, near] == OPEN) & sliding[:, [top]]).any(axis=0)
    kept = slid.copy()
    kept[near][left] = 0.0
    return kept


def peak_nodes(nodes: dict, steps: dict, index: int) -> np.ndarray:
    """Node of the largest pressure at step `index`, and its neighbours on the piece if in contact.
    """
    size, closed = np.abs(steps["sigma_n"][index]), steps["status"][index] != OPEN
    top = int(size.argmax())
    piece = next(piece for piece in chains(nodes) if top in piece)
    near = piece[np.abs(piece - top) <= 1]
    return near[closed[near] | (near == top)]


def farthest_node(steps: dict, index: int) -> int:
    """Node that has slid farthest in contact until step `index`."""
    sliding = steps["status"][: index + 1] == SLIP
    return int(np.where(sliding, moves(steps)[: index + 1], 0.0).sum(axis=0).argmax())
