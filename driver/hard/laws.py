"""The laws of contact and friction on the assembled body, for every law that a scene can declare.

What a run reports is compared with displacements of the untorn body under the reported contact
forces; of the solver only the contact boundary (weights, normals, gaps, mortar jumps) is taken.
"""

from dataclasses import dataclass

import numpy as np

from .oracle import Assembled

FORCES = ("sigma_n", "sigma_t")


@dataclass(frozen=True)
class Reported:
    """A run's contact.csv in the order of the assembled body's nodes; arrays (steps, n_c)."""

    u_n: np.ndarray
    u_t: np.ndarray
    slip: np.ndarray
    sigma_n: np.ndarray
    sigma_t: np.ndarray
    bound: np.ndarray

    @classmethod
    def of(cls, body: Assembled, contact: dict) -> "Reported":
        """The columns of `contact`. Raises ValueError if the nodes are others."""
        order = same_nodes(body, contact)
        return cls(*(contact[name][:, order] for name in cls.__annotations__))

    def forces(self, body: Assembled) -> np.ndarray:
        """(steps, 2 n_c) nodal forces on the body along n, then t."""
        return np.concatenate([self.sigma_n * body.weight, self.sigma_t * body.weight], axis=1)


def same_nodes(body: Assembled, contact: dict) -> np.ndarray:
    """Column of contact.csv for every contact node of the assembled body. Raises ValueError."""
    label = contact.get("boundary", np.full(contact["x"].shape, body.label[0]))[-1]
    theirs = np.lexsort((contact["normal_y"][-1], contact["normal_x"][-1], contact["y"][-1],
                         contact["x"][-1], label))
    if len(theirs) != len(body.gid):
        raise ValueError("contact.csv and the assembled body have different contact nodes")
    ours = np.lexsort((*body.normal.T[::-1], body.xy[:, 1], body.xy[:, 0], body.label))
    order = np.empty(len(ours), int)
    order[ours] = theirs
    if not np.array_equal(body.xy, np.column_stack([contact["x"][-1], contact["y"][-1]])[order]):
        raise ValueError("contact.csv and the assembled body have different contact nodes")
    return order


def bounds(body: Assembled, manifest, reported: Reported, u_t: np.ndarray,
           start: np.ndarray) -> np.ndarray:
    """(steps, n_c) largest shear tractions under the reported pressures.

    `u_t` (steps, n_c) are the tangential displacements, `start` (n_c,) those at time 0, on which a
    slip law depends.
    """
    column = {name: body.columns.get(name, np.zeros(len(body.gid)))
              for name in ("friction", "cohesion", "tresca")}
    factor = 1.0
    law = manifest.rooms.get("slip_law")
    if law:
        slip = np.cumsum(np.abs(np.diff(np.vstack([start, u_t]), axis=0)), axis=0)
        table = np.linspace(0.0, law["range"], len(law["values"]))
        factor = np.interp(slip if law["argument"] == "slip" else np.abs(u_t), table,
                           law["values"])
    return factor * column["friction"] * np.abs(reported.sigma_n) + (
        column["cohesion"] + column["tresca"])


def violations(body: Assembled, manifest, contact: dict, far: float = 0.0) -> dict[str, float]:
    """Relative violation of every law by the displacements under the reported forces.

    Displacements and gaps are relative to the largest displacement of the run, rigid motions that
    no support resists apart, or `far` if that is larger; tractions to its largest one. Bodies that
    no support holds: the forces must balance, and their rigid motion is fitted to the reported one.
    """
    reported, history = Reported.of(body, contact), manifest.factors
    force = reported.forces(body)
    fields = np.array([body.solve(w, body.B.T @ f) for w, f in zip(history[1:], force)])
    deformation = np.abs(fields).max(initial=far)
    turned = body.B @ body.motions
    told = np.concatenate([reported.u_n, reported.u_t], axis=1)
    u = fields @ body.B.T
    u += (turned @ np.linalg.lstsq(turned, (told - u).T, rcond=None)[0]).T
    start = reported.u_t[:1] - reported.slip[:1]
    u_n, u_t = np.split(u, 2, axis=1)
    slip = np.diff(np.concatenate([start, u_t]), axis=0)
    press = max(np.abs(reported.sigma_n).max(), np.abs(reported.sigma_t).max())
    bound = bounds(body, manifest, reported, u_t, start)
    # nodes with friction of their own
    free = np.isin(2 * body.gid, body.free) & np.isin(2 * body.gid + 1, body.free)
    over, sigma_n, sigma_t = u_n - body.gap, reported.sigma_n, reported.sigma_t
    one_sided = ~np.isin(body.label, bilateral_labels(manifest))
    balance = [(np.abs(body.motions.T @ (w @ body.loads + body.B.T @ f)),
                np.abs(body.motions).T @ (np.abs(w) @ np.abs(body.loads)
                                          + np.abs(body.B.T @ f)))
               for w, f in zip(history[1:], force)]
    largest = np.max([size for _, size in balance], axis=0, initial=0.0)
    return {
        "displacement": ratio(np.abs(u - told).max(), deformation),
        "penetration": ratio(np.where(one_sided, over, np.abs(over)).max(initial=0), deformation),
        "tension": ratio((one_sided * sigma_n).max(initial=0), press),
        "pressure at a distance": ratio(np.abs(one_sided * sigma_n * over).max(),
                                        deformation * press),
        "friction bound": ratio((np.abs(sigma_t) - bound).max(initial=0), press),
        "reported bound": ratio((free * np.abs(reported.bound - bound)).max(initial=0),
                                np.abs(bound).max(initial=press)),
        "slip along friction": ratio(
            (free * (bound * np.abs(slip) + sigma_t * slip)).max(initial=0),
            deformation * np.abs(bound).max(initial=press)),
        "balance": max((ratio(net.max(initial=0), largest.max(initial=0)) for net, _ in balance),
                       default=0.0)}


def bilateral_labels(manifest) -> list[int]:
    """Labels whose contact can pull."""
    if "bilateral" not in manifest.rooms:
        return []
    return manifest.rooms["bilateral"].get("labels", manifest.contact_labels)


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


def ratio(part: float, whole: float) -> float:
    """part / whole; where the whole is zero, 0 for nothing and infinity for something."""
    return float(part / whole) if whole > 0 else (0.0 if part == 0 else np.inf)
