"""The laws of contact and friction on the assembled body, for every law that a scene can declare.

What a run reports is compared with displacements of the untorn body under the reported contact
forces; of the solver only the contact boundary (weights, normals, gaps, mortar jumps) is taken.
"""

from dataclasses import dataclass

import numpy as np

from . import deformations
from .oracle import Assembled

ROUNDINGS = 4  # random ones of the stiffness
ROUNDED = 4 * np.finfo(float).eps  # of a place, where nothing deforms
RESTS = 1e-6  # of the deformation: a gap that counts as closed, the accuracy of displacements
# part of the largest force on any body below which others are its rounding: what may be unbalanced
# of it, 1e-6, is some last bits of the largest
NOTHING = 1e-9
AXIS = 1e-9  # of the body's extent: below that radius a node is on the axis
NEARLY = 0.1  # part of a tangent beyond the normals where those of a mortar side depend nearly


@dataclass(frozen=True)
class Reported:
    """A run's contact.csv in the order of the assembled body's nodes; arrays (steps, n_c)."""

    u_n: np.ndarray
    u_t: np.ndarray
    slip: np.ndarray
    sigma_n: np.ndarray
    sigma_t: np.ndarray
    bound: np.ndarray
    weight: np.ndarray
    gap: np.ndarray

    @classmethod
    def of(cls, body: Assembled, contact: dict) -> "Reported":
        """The columns of `contact`. Raises ValueError if the nodes are others."""
        order = same_nodes(body, contact)
        return cls(*(contact[name][:, order] for name in cls.__annotations__))

    def forces(self, body: Assembled) -> np.ndarray:
        """(steps, 2 n_c) nodal forces on the body along n, then t."""
        return np.concatenate([self.sigma_n * body.weight, self.sigma_t * body.weight], axis=1)


def same_nodes(body: Assembled, contact: dict) -> np.ndarray:
    """Column of contact.csv for every contact node of the assembled body. Raises ValueError.

    Of nodes at one place those with the same normal, then label, are the same.
    """
    last = {name: contact[name][-1] for name in ("x", "y", "normal_x", "normal_y")}
    place, normal = (np.column_stack([last[x], last[y]])
                     for x, y in (("x", "y"), ("normal_x", "normal_y")))
    label = contact["boundary"][-1] if "boundary" in contact else body.label
    if len(place) != len(body.gid):
        raise ValueError("contact.csv and the assembled body have different contact nodes")
    likeness = body.normal @ normal.T + 0.1 * (body.label[:, None] == label)
    apart = np.abs(body.xy[:, None] - place).max(axis=2)
    likeness[apart > 1e-12 * np.abs(place).max()] = -np.inf
    order = likeness.argmax(axis=1)
    alike = np.einsum("ij,ij->i", body.normal, normal[order])
    here = likeness[np.arange(len(order)), order] > -np.inf
    if len(set(order)) < len(order) or not (here & (alike > 1 - 1e-9)).all():
        raise ValueError("contact.csv and the assembled body have different contact nodes")
    return order


def pressed(body: Assembled, sigma_n: np.ndarray) -> np.ndarray:
    """(steps + 1, n_c) whether nodes press at time 0, where all do that have no gap, and at ends of
    steps with tractions `sigma_n` (steps, n_c).
    """
    extent = np.ptp(body.xy, axis=0).max()
    return np.vstack([body.distances()[0] <= 1e-9 * extent, sigma_n != 0])


def ways_in_contact(slip: np.ndarray, presses: np.ndarray) -> np.ndarray:
    """(steps, n_c) what slip laws count of the `slip` (steps, n_c): the part under pressure.

    Half of a step at one end of which a node does not press, see `pressed`.
    """
    return np.abs(slip) * (presses[1:] * 0.5 + presses[:-1] * 0.5)


def bounds(body: Assembled, manifest, reported: Reported, start: np.ndarray) -> np.ndarray:
    """(steps, n_c) largest shear tractions under the reported pressures and displacements.

    `start` (n_c,) are the tangential displacements at time 0. That the reported ones are those of
    the forces is a law of its own: a slip law may fall from one bound to another over a way on
    which displacements have not many digits.
    """
    column = {name: body.columns.get(name, np.zeros(len(body.gid)))
              for name in ("friction", "cohesion", "tresca")}
    factor = 1.0
    law = manifest.rooms.get("slip_law")
    if law:
        u_t = reported.u_t
        ways = body.ways()
        slip = np.diff(np.vstack([start, u_t]), axis=0) - ways
        slip = np.cumsum(ways_in_contact(slip, pressed(body, reported.sigma_n)), axis=0)
        u_t = u_t - np.cumsum(ways, axis=0)
        table = np.linspace(0.0, law["range"], len(law["values"]))
        factor = np.interp(slip if law["argument"] == "slip" else np.abs(u_t), table,
                           law["values"])
    return factor * column["friction"] * np.abs(reported.sigma_n) + (
        column["cohesion"] + column["tresca"])


def violations(body: Assembled, manifest, contact: dict,
               far: np.ndarray | float = 0.0) -> dict[str, float]:
    """Relative violation of every law by the displacements under the reported forces.

    Displacements and gaps are relative to what material like the node's deforms by in the run
    (deformations.py), or `far` (n_c,) if that is larger; tractions to the largest one. Contact and
    friction are complementary: of pressure, a part of the largest nodal force, and distance the
    smaller is the violation, of what friction may still grow by and slip as well. Bodies that no
    support holds: the forces must balance, and their rigid motion is fitted to the reported one.

    The displacement of a node that never touches is no matter of contact: it counts by what the
    whole body deforms by, with which stiff parts move.

    Reported are forces and displacements, each to its own accuracy: of a body that hardly anything
    holds against turning forces that are nothing move nodes far. So displacements are corrected by
    forces, up to `RESTS` of the largest, that bring them nearest to the reported ones.

    Balance is relative to the loads and the reported forces of all conditions on the body, in
    whatever direction, of those at one place as well that hand on to one another what the body
    does not feel.

    What a support prescribes is no matter of contact. At a corner friction belongs to the one
    condition that is closed (contact/corner_nodes.py): a vertex that rests on both does not slide
    at the end of the step, whatever way it took there, and one that is open has no side to rub on.
    Rough surfaces are passed by what they yield, which is a scale of displacements as well.
    """
    reported, history = Reported.of(body, contact), manifest.factors
    force = reported.forces(body)
    fields = np.array([body.solve(w, body.B.T @ f) for w, f in zip(history[1:], force)])
    extent = max(np.ptp(sub.xy, axis=0).max() for sub in body.subdomains)
    far = np.maximum(far, ROUNDED * extent / RESTS)
    scale, whole = deformations.of_nodes(body, fields, manifest.axisymmetric)
    touched = reported.sigma_n.any(axis=0) | reported.sigma_t.any(axis=0)
    known_to = np.tile(np.maximum(np.where(touched, scale, whole), far), 2)
    scale = np.maximum(scale, far)
    turned = body.B @ body.motions
    told = np.concatenate([reported.u_n, reported.u_t], axis=1)
    u = fields @ body.B.T
    if manifest.axisymmetric:  # nothing slides on the axis; the condition there sees what is beside
        rows = len(body.xy) + np.flatnonzero(body.xy[:, 0] <= AXIS * extent)
        told[:, rows] = u[:, rows]
    u += (turned @ np.linalg.lstsq(turned, (told - u).T, rcond=None)[0]).T
    u += _moved_by_little(body, turned, told - u, np.tile(scale, 2), np.abs(force).max())
    start = reported.u_t[:1] - reported.slip[:1] - body.ways()[:1]
    u_n, u_t = np.split(u, 2, axis=1)
    slip = np.diff(np.concatenate([start, u_t]), axis=0) - body.ways()
    gap = body.distances()[-len(u_n):]
    press = max(np.abs(reported.sigma_n).max(), np.abs(reported.sigma_t).max())
    bound = bounds(body, manifest, reported, start)
    held, rubs = supported(body), rubbing(body)
    sigma_n, sigma_t = reported.sigma_n, reported.sigma_t
    yields = closures(body, sigma_n)
    over = np.where(held, 0.0, u_n - gap - yields)
    scale = np.maximum(scale, np.abs(yields).max(axis=0, initial=0.0))
    over, one_sided = parts(over, scale), ~pulling(body, manifest)
    # what presses touches, to the accuracy that penetration and distance are judged by
    closed, beside = (np.abs(over) <= RESTS) | (sigma_n < 0), corners(body)
    alone = closed & ~((closed.astype(int) @ beside) > 0)
    rubs = rubs & (alone | ~beside.any(axis=1))
    pressing, forward, back = (parts(of * body.weight, np.abs(force).max()) for of in (
        np.abs(sigma_n), bound - sigma_t, bound + sigma_t))
    slides = parts(slip, scale)  # against friction: along the bound that resists it
    balance = [(np.abs(body.motions.T @ (w @ body.loads + body.B.T @ f)),
                sizes(body, np.abs(w) @ np.abs(body.loads) + abs(body.B).T @ np.abs(f)))
               for w, f in zip(history[1:], force)]
    largest = np.max([size for _, size in balance], axis=0, initial=0.0)
    return {
        "weight": np.abs(reported.weight / body.weight - 1).max(),
        "gap": parts(np.abs(reported.gap - gap).max(axis=0),
                     np.maximum(scale, np.abs(gap).max())).max(),
        "displacement": parts(np.abs(u - told), known_to).max(),
        "penetration": np.where(one_sided, over, np.abs(over)).max(initial=0),
        "tension": ratio((one_sided * sigma_n).max(initial=0), press),
        "pressure at a distance": np.minimum(pressing, one_sided * np.abs(over)).max(),
        "friction bound": ratio((np.abs(sigma_t) - bound).max(initial=0), press),
        "reported bound": ratio((rubs * np.abs(reported.bound - bound)).max(initial=0),
                                np.abs(bound).max(initial=press)),
        "slip along friction": np.minimum(
            rubs * np.abs(slides), np.where(slides > 0, back, forward)).max(initial=0),
        "balance": max((ratio(net.max(initial=0), largest.max(initial=0)) for net, _ in balance),
                       default=0.0)}


def exponents(body: Assembled) -> np.ndarray:
    """(n_c,) powers of the closure that pressures of rough surfaces are, 1 where they are smooth.
    """
    declared = body.columns.get("compliance_exponent", np.ones(len(body.gid)))
    return np.where(declared > 0, declared, 1.0)


def closures(body: Assembled, sigma_n: np.ndarray) -> np.ndarray:
    """(steps, n_c) by how much rough surfaces yield, with the sign of the pressure."""
    c = body.columns.get("normal_compliance", np.zeros(len(body.gid)))
    power = 1.0 / exponents(body)
    size = np.divide(np.abs(sigma_n), c, out=np.zeros(sigma_n.shape), where=c > 0) ** power
    return -np.sign(sigma_n) * size


def sizes(body: Assembled, force: np.ndarray) -> np.ndarray:
    """(modes,) work of forces of the sizes `force` (dofs,) on free motions, in any direction.

    What is across a motion does none, but for rounding. Nor does what acts on other bodies, but for
    rounding of that: a body that nothing presses has forces of 1e-18 of the others.
    """
    dofs, modes = body.motions.shape
    far = np.linalg.norm(body.motions.reshape(dofs // 2, 2, modes), axis=1)
    acting = np.linalg.norm(force.reshape(-1, 2), axis=1)
    return far.T @ acting + NOTHING * acting.max(initial=0.0) * far.max(axis=0, initial=0.0)


def rounding(body: Assembled, manifest, contact: dict) -> np.ndarray:
    """(n_c,) by how much displacements change when every entry of the stiffness is rounded once.

    The driver's subdomains and the oracle's body round each for themselves. Where stiffness jumps,
    or hardly any change of volume is left, no solver knows displacements better. The largest of a
    few random roundings, and of nodes with one deformation.
    """
    force = Reported.of(body, contact).forces(body)
    turned = body.B @ body.motions

    def moved(of: Assembled) -> np.ndarray:
        return np.array([of.solve(w, of.B.T @ f) for w, f in zip(manifest.factors[1:], force)])

    def of_nodes(fields: np.ndarray) -> np.ndarray:
        u = fields @ body.B.T
        return u - (turned @ np.linalg.lstsq(turned, u.T, rcond=None)[0]).T

    exact = moved(body)
    scale, _ = deformations.of_nodes(body, exact, manifest.axisymmetric)
    apart = np.zeros(len(scale))
    for seed in range(ROUNDINGS):
        of_rows = np.abs(of_nodes(moved(body.rounded(seed)) - exact)).max(axis=0)
        apart = np.maximum(apart, of_rows.reshape(2, -1).max(axis=0))
    _, alike = np.unique(scale, return_inverse=True)
    largest = np.zeros(alike.max(initial=-1) + 1)
    np.maximum.at(largest, alike, apart)
    return 2 * largest[alike]


def _moved_by_little(body: Assembled, turned: np.ndarray, missing: np.ndarray, scale: np.ndarray,
                     largest: float) -> np.ndarray:
    """(steps, 2 n_c) part of the displacements `missing` that next to no contact forces make.

    Those of least |(missing - C f) / scale|^2 + |f|^2 / largest^2, with `scale` (2 n_c,), rigid
    motions `turned` (2 n_c, modes) apart, cut to RESTS of the largest force.
    """
    if not largest > 0 or (np.abs(missing) <= 0.1 * RESTS * scale).all() or not scale.min() > 0:
        return np.zeros_like(missing)
    C = np.array([body.B @ body.solve(np.zeros(len(body.loads)), row) for row in body.B]).T
    unit, turned = C * largest / scale[:, None], turned / scale[:, None]
    size = np.abs(turned).max(axis=0, initial=0.0)
    both = np.hstack([unit, turned[:, size > 0] / size[size > 0]])
    smallness = np.eye(both.shape[1])[: unit.shape[1]]
    found = np.linalg.lstsq(np.vstack([both, smallness]),
                            np.vstack([(missing / scale).T, np.zeros((len(C), len(missing)))]),
                            rcond=None)[0]
    share = np.minimum(1.0, RESTS / np.maximum(np.abs(found[: len(C)]).max(axis=0), 1e-300))
    return (share * (both @ found)).T * scale


def pulling(body: Assembled, manifest) -> np.ndarray:
    """(n_c,) whether contact at the node can pull."""
    everywhere = np.full(len(body.gid), "bilateral" in manifest.rooms)
    return body.columns.get("bilateral", everywhere) != 0


def supported(body: Assembled) -> np.ndarray:
    """(n_c,) whether supports leave the node no displacement along n."""
    normal = np.abs(body.B[:len(body.gid)])
    return normal[:, body.free].max(axis=1, initial=0.0) <= 1e-9 * normal.max(axis=1)


def rubbing(body: Assembled) -> np.ndarray:
    """(n_c,) whether the node has friction: supports leave it both displacements, not one."""
    return np.isin(2 * body.gid, body.free) & np.isin(2 * body.gid + 1, body.free)


def corners(body: Assembled) -> np.ndarray:
    """(n_c, n_c) whether two nodes are conditions at one vertex of which one holds the other up.

    Where both surfaces are rough each follows its own law.
    """
    rough = body.columns.get("normal_compliance", np.zeros(len(body.gid))) > 0
    same = (body.gid[:, None] == body.gid) & ~np.eye(len(body.gid), dtype=bool)
    return same & ~(rough[:, None] & rough)


def resting(body: Assembled) -> np.ndarray:
    """(n_c, n_c) the `corners` that hold a node still where all of their conditions are closed.

    Where another body is one of them it still moves along the node.
    """
    count, held = len(body.gid), corners(body)
    for node in np.flatnonzero(held.any(axis=1)):
        normals = body.B[:count][held[node] | (np.arange(count) == node)]
        along = body.B[count + node]
        left = along - normals.T @ np.linalg.lstsq(normals.T, along, rcond=None)[0]
        held[node] &= np.linalg.norm(left) <= NEARLY * np.linalg.norm(along)
    return held


def disagreement(body: Assembled, one: dict, other: dict) -> float:
    """Largest difference of the contact forces of two runs, relative to the largest force."""
    first, second = (Reported.of(body, contact).forces(body) for contact in (one, other))
    return ratio(np.abs(first - second).max(initial=0), np.abs(first).max(initial=0))


def distance(body: Assembled, one: dict, other: dict) -> float:
    """Largest distance of the contact forces of two runs in the norm of the energy, relative.

    What differs between conditions at one vertex, or deforms nothing, does not count.
    """
    first, second = (Reported.of(body, contact).forces(body) for contact in (one, other))

    def energy(forces: np.ndarray) -> float:
        moved = [body.B @ body.solve(np.zeros(len(body.loads)), body.B.T @ f) for f in forces]
        return max(float(f @ u) for f, u in zip(forces, moved))

    return np.sqrt(ratio(energy(first - second), energy(first)))


def parts(values: np.ndarray, whole: np.ndarray | float) -> np.ndarray:
    """`ratio` of every one of the `values`, with its sign, to its own of `whole`."""
    whole = np.broadcast_to(whole, values.shape)
    infinite = np.where(values == 0, 0.0, np.copysign(np.inf, values))
    return np.where(whole > 0, values / np.where(whole > 0, whole, 1.0), infinite)


def ratio(part: float, whole: float) -> float:
    """part / whole; where the whole is zero, 0 for nothing and infinity for something."""
    return float(part / whole) if whole > 0 else (0.0 if part == 0 else np.inf)
