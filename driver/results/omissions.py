"""What a run says of things that a scene leaves out silently and that are seldom meant."""

import numpy as np

from ..contact.boundary import ContactBoundary
from ..options import Settings
from ..text import counted
from ..units import split_unit
from .held_nodes import held_along, without_row

SHAPED = {"obstacle", "obstacle_motion", "large_sliding", "bilateral"}  # else it is a mould
GIVES_GAP = {"obstacle", "obstacle_motion"}  # may give the distance instead of gap
SMOOTH, ROUND = np.cos(np.radians((20, 30)))  # normals of neighbours, and of a label's ends
DIAMOND = 1e12  # Pa: twice its shear modulus
COARSE = 0.01  # RTOL beyond which forces are guesses; FRICTION_RTOL: ten times that
FAR = 3.0  # times the size of the largest body
APART = 0.5  # of that size, from which on a declared distance is seldom meant
LACKS = 1e-3  # part of all friction that a node may lack unnoticed
SLIDES = 1e-6  # part of the largest slip that is one
ROUNDED = 1e-9  # part of a load that is none
LONGER = 10.0  # times the largest slip, up to which a table of a law of that is fine enough
UNRESOLVED = 0.01  # part of the largest factor of friction by which its table may be wrong
PERCENT = 5.0  # beyond all coefficients of friction that are measured, but for adhesive rubber
OVERLAP, FACETS = 1e-3, 0.05  # of the boundary's size, of a dual segment: what facets may overlap


def warnings(boundary: ContactBoundary, declared, displacements: list[float],
             settings: Settings, softest: float, units: dict[str, str]) -> list[str]:
    """A sentence for each; `declared` are the names of the declared effects, `displacements` the
    largest of every step, `softest` the smallest shear modulus in the scene's `units`.
    """
    said = []
    exponent, pascal = split_unit(units["stress"])
    if pascal == "Pa" and softest * 10.0**exponent > DIAMOND:
        said.append(f"the softest material has a shear modulus of {softest:.2g} {units['stress']}, "
                    "more than twice that of diamond: is young in the scene's unit of stress?")
    if displacements and not any(displacements):
        said.append("nothing moves: no load, prescribed displacement or overlap acts on the bodies")
    if "friction" in declared:
        said += _percents(boundary)
    if "normal_compliance" in declared:
        said += _half_rough(boundary)
    if "slip_law" in declared and not boundary.columns["friction"].any():
        said.append("the factor of slip changes nothing: the coefficient of friction that it "
                    "multiplies is zero everywhere, and cohesion does not change with slip")
    if "gap" not in declared:
        said += _of_no_distance(boundary, set(declared), np.ones(len(boundary.gid), bool))
    for name, limit in (("rtol", COARSE), ("friction_rtol", 10 * COARSE)):
        if getattr(settings, name) > limit:
            said.append(f"{name.upper()}={getattr(settings, name):g} is too coarse for meaningful "
                        f"forces and contact zones; use at most {limit:g}")
    return said


def far_moves(structure, displacements: list[float], amplitudes: np.ndarray, comm) -> list[str]:
    """A sentence where bodies without support move by several times the size of all of them beyond
    what supports and obstacles move by with the `amplitudes` (steps, patterns) of a run. Collective
    over `comm`.
    """
    size = structure.travel.bodies.size.max(initial=0.0)
    largest = max(displacements, default=0.0)
    if not structure.rigid_modes or largest <= FAR * size:
        return []
    if largest - _prescribed(structure, amplitudes, comm) <= FAR * size:
        return []
    return [f"a body without support moves by {largest:.3g}, {largest / size:.0f} times the size "
            "of the largest body, until something holds it: check its initial position and its "
            "unit of length"]


def _prescribed(structure, amplitudes: np.ndarray, comm) -> float:
    """The largest displacement that supports and obstacles prescribe in a run, or a little more."""
    travel, obstacles = structure.travel.motion, structure.contact.motion_of_all_times
    carried = 0.0  # what lies on an obstacle goes with it
    if obstacles is not None:
        arm = np.linalg.norm(obstacles.xy - obstacles.pivot, axis=1)
        carried = (np.linalg.norm(obstacles.shift, axis=-1)
                   + np.abs(obstacles.angle) * arm).max(initial=0.0)
    given = [np.abs(amplitudes @ values).max(initial=0.0) for values in structure.fixed_values]
    moved = np.tensordot(amplitudes[:, :len(travel)], travel, axes=1)
    return float(np.sqrt(2.0) * max(comm.allgather(max(given, default=0.0)))
                 + np.abs(moved).sum(axis=-1).max(initial=0.0) + carried)


def far_gaps(structure, declared) -> list[str]:
    """A sentence for every label all of which is declared to lie far from what it meets.

    Of obstacles that move towards it that may be meant.
    """
    b, size = structure.contact.start.declared, structure.travel.bodies.size.max(initial=0.0)
    if "gap" not in declared or "obstacle_motion" in declared:
        return []
    said = []
    for label in np.unique(b.label):
        own = b.label == label
        least = b.columns["gap"][own].min()
        if least > APART * size:
            macro = "pairGap" if b.paired[own].any() else "gap"
            said.append(f"{macro} keeps contact label {label} at least {least:.3g} away from the "
                        f"other side, {least / size:.2g} of the size of the largest body: check "
                        "its sign and unit")
    return said


def coarse_table(record, effects) -> list[str]:
    """A sentence if friction depends on slip in a way that its table does not resolve, unless it is
    as fine as tables are: a factor that jumps at once is a line within a small part of the slip.
    """
    law = effects.rooms.get("slip_law")
    if law is None or law.missed <= UNRESOLVED * law.values.max():
        return []
    most = (np.abs(record.states["u_t"]) if law.argument == "displacement" else
            np.abs(record.states["slip"]).sum(axis=0)).max(initial=0.0)
    if law.arguments[-1] <= LONGER * most:
        return []
    return [f"the factor of friction bends within the first step of its table, slipRange/1000 = "
            f"{law.arguments[1]:.3g}, where it is taken as linear and wrong by up to "
            f"{law.missed:.2g}: give a slipRange that is somewhat more than the largest slip"]


def held_loads(structure, manifest, comm) -> list[str]:
    """A sentence for every load on boundaries that acts in a direction along which supports hold
    all of them. Collective over `comm`.
    """
    sizes = np.zeros((2, len(manifest.patterns), 2))  # all of it, what is not held; by components
    for sub, fixed in zip(structure.subdomains, structure.fixed):
        for pattern in sub.edge_loads:
            load = np.abs(sub.loads[pattern])
            sizes[0, pattern] += load.reshape(-1, 2).sum(axis=0)
            load[fixed] = 0.0
            sizes[1, pattern] += load.reshape(-1, 2).sum(axis=0)
    whole, free = comm.allreduce(sizes)
    axes, said = "rz" if manifest.axisymmetric else "xy", []
    for k, pattern in enumerate(manifest.patterns):
        lost = (free[k] == 0) & (whole[k] > ROUNDED * whole[k].sum())
        ways = " and ".join(axis for axis, gone in zip(axes, lost) if gone)
        if ways:
            said.append(f"load{pattern['amplitude']} acts along {ways} only on boundaries that "
                        f"supports constrain along {ways}: it moves nothing")
    return said


def support_jumps(jumps: list) -> list[str]:
    """A sentence where displacements of labels that meet differ, as Jump of support_ends.py."""
    if not jumps:
        return []
    first = jumps[0]
    others = ", ".join(str(label) for label in first.labels if label != first.label)
    more = f", and {len(jumps) - 1} more" if len(jumps) > 1 else ""
    return [f"displacements along {'xy'[first.component]} on the labels {first.label} and {others} "
            f"differ by {first.size:.3g} where these meet, at ({first.place[0]:.3g}, "
            f"{first.place[1]:.3g}){more}: the vertex does not move as label {first.label} "
            "prescribes, and stresses and reactions there grow with mesh refinement"]


def without_wear(record) -> list[str]:
    """A sentence if contact nodes slide that a support holds along the boundary: their surface is
    taken for one that does not wear.
    """
    b = record.contact.boundary
    if "wear" not in b.columns:
        return []
    held = without_row(b) & (b.columns["wear"] > 0)
    slip = np.abs(record.states["slip"])
    pressed = np.array(record.states["sigma_n"]) < 0
    sliding = held & (slip * pressed > SLIDES * slip.max(initial=0.0)).any(axis=0)
    if not sliding.any():
        return []
    x, y = b.xy[sliding][0]
    return [f"{np.count_nonzero(sliding)} contact nodes, the first at ({x:.3g}, {y:.3g}), slide "
            "although a support or prescribed displacement constrains them along the boundary: no "
            "wear is computed for them, so they protrude as other nodes wear; let the support end "
            "before the contact label"]


def without_friction(record) -> list[str]:
    """A sentence if contact nodes slide without friction that would be a part of all of it: a
    support leaves them one component of a slanted boundary.
    """
    b, states = record.contact.boundary, record.states
    half = without_row(b) & ~held_along(b, record.contact.constrained)
    if not record.contact.frictional or not half.any():
        return []
    slip, bound = np.abs(states["slip"]), np.array(states["bound"]) * b.weight
    part = bound / np.maximum(bound.sum(axis=1), np.finfo(float).tiny)[:, None]
    lacks = half & (slip > SLIDES * slip.max(initial=0.0)) & (part > LACKS)
    nodes = lacks.any(axis=0)
    if not nodes.any():
        return []
    x, y = b.xy[nodes][0]
    most = np.where(lacks, part, 0.0).sum(axis=1).max()
    return [f"no friction acts on {counted(np.count_nonzero(nodes), 'contact node')} of a slanted "
            f"boundary, the first at ({x:.3g}, {y:.3g}), where a support constrains one component "
            f"of the displacement: up to {100 * most:.2g} % of all friction is missing; let the "
            "support end before the contact label"]


def held_inside(record) -> list[str]:
    """A sentence if a support holds a place of a contact boundary inside what it meets."""
    held = record.held_inside()
    if not held.any():
        return []
    step, node = np.unravel_index(np.argmax(np.where(held, record.inside, 0.0)), held.shape)
    place, deep = record.contact.boundary.clamped, record.inside[step][node]
    advice = "move it with the obstacle"
    if node >= len(place.gid):
        node, place = node - len(place.gid), record.contact.boundary.held
        other = place.other[node]
        advice = f"name {other if other >= 0 else 'the other side'} first in the pair"
    x, y = place.xy[node]
    return [f"a support holds the boundary {place.label[node]} at ({x:.4g}, {y:.4g}) inside the "
            f"obstacle or other body, by {deep:.2g} in step {step + 1}: pressures and forces "
            "beside it grow with mesh refinement; let the support end before the contact label, or "
            f"{advice}"]


def _percents(b: ContactBoundary) -> list[str]:
    """Of the largest coefficient of friction, if it may be meant as a percentage."""
    friction = b.columns["friction"]
    largest = friction.max(initial=0.0)
    if not PERCENT < largest <= 100.0:
        return []
    return [f"friction is {largest:.3g} on contact label {b.label[friction.argmax()]}: if percent "
            f"are meant, write {largest / 100:.3g}"]


def _half_rough(b: ContactBoundary) -> list[str]:
    """Of the first corner, if any, in which a rough boundary and a smooth one meet."""
    rough = b.columns["normal_compliance"] > 0
    for pair in b.corners[:, :2]:
        if rough[pair].sum() == 1:
            x, y = b.xy[pair[0]]
            one, two = b.label[pair[np.argsort(~rough[pair])]]
            return [f"the rough boundary {one} and the smooth boundary {two} meet in a corner, at "
                    f"({x:.4g}, {y:.4g}): forces on a vertex that touches both are as between "
                    "smooth boundaries, not by the law of the rough one; declare normalCompliance "
                    "on both, with a large value on the smooth one"]
    return []


def half_declared(b: ContactBoundary, rooms: dict) -> list[str]:
    """What `warnings` says where no distance is declared, of scenes that declare one between bodies
    alone, or to obstacles alone; `rooms` are those of the declared effects.
    """
    if "gap" not in rooms:
        return []
    lacks = ~rooms["gap"].declares(b.paired)
    return _of_no_distance(b, set(rooms), lacks)


def _of_no_distance(b: ContactBoundary, declared: set[str], lacks: np.ndarray) -> list[str]:
    """Of boundaries with nodes that `lacks` (n_c,) marks, whose distance no scene declares."""
    if not lacks.any():
        return []
    return [*_overlaps(b, lacks, declared), *([] if SHAPED & declared else _moulds(b, lacks))]


def _moulds(b: ContactBoundary, lacks: np.ndarray) -> list[str]:
    """Of every round boundary whose rigid obstacle has its shape, as none is declared."""
    said, here = [], lacks & ~b.paired
    for label in np.unique(b.label[here]):
        normal = b.normal[(b.label == label) & here]
        turns = np.einsum("ij,ij->i", normal[1:], normal[:-1])
        if len(turns) and turns.min() > SMOOTH and (normal @ normal[0]).min() < ROUND:
            said.append(
                f"contact label {label} is round, and so is its obstacle: without gap and obstacle "
                "a rigid obstacle has the shape of the boundary; declare  macro obstacle(x, y) ... "
                "//  or, if this is intended, macro gap() 0. //")
    return said


def _overlaps(b: ContactBoundary, lacks: np.ndarray, declared: set[str]) -> list[str]:
    """Of every boundary that starts inside what it meets, beyond what facets of curves do."""
    said, size = [], float(np.linalg.norm(np.ptp(b.xy, axis=0)))
    for label in np.unique(b.label[lacks]):
        own = (b.label == label) & lacks
        deep = -(b.gap[own] + FACETS * b.length[own])
        if deep.max() > 0 and -b.gap[own].min() > OVERLAP * size:
            place = b.xy[own][np.argmin(b.gap[own])]
            paired = b.paired[own].any()
            intended = (f"if this is intended declare macro {'pairGap' if paired else 'gap'}() 0. "
                        "//, otherwise correct the geometry")
            if not paired and GIVES_GAP & declared:  # beside which gap would be refused
                intended = ("if this is intended give the distance by macro gap() instead, "
                            "otherwise correct the geometry or the obstacle")
            said.append(
                f"contact label {label} starts up to {-b.gap[own].min():.3g} inside the other "
                f"side, at ({place[0]:.3g}, {place[1]:.3g}), and is pushed out as in a press fit; "
                f"{intended}")
    return said
