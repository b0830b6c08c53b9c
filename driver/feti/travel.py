"""Rigid motions that supports prescribe to whole bodies, taken out before anything is solved.

Let the prescribed displacements of a load pattern be near those of a rigid motion r of a body. Then

    u = r + w,      K r = 0,      w = (prescribed) - r   on supports,

so that w is what the body deforms by, and r acts on contact rows alone: B u = B r + B w. However
far supports carry a body, strains, energies and the tolerances of a solver see w, and no digit of
it is lost against r (a translation is taken out exactly).
"""

from dataclasses import dataclass

import numpy as np

from .exchange import components
from .gathering import gather, largest
from .rigid_modes import RigidMode
from .rows import RowKind

WORTH = 0.5  # part of the prescribed displacements that may remain, for r to be taken out


@dataclass
class Bodies:
    """Connected bodies in the order of their first subdomains.

    `number` (subdomains,) is the body of a subdomain; `center` (bodies, 2) and `size` (bodies,) are
    those of a body's bounding box, which no cut changes. `possible` (3,) is one for every motion of
    `rigid` without strain: of bodies of revolution the translation along y alone.
    """

    number: np.ndarray
    center: np.ndarray
    size: np.ndarray
    possible: np.ndarray

    def rigid(self, body: int, xy: np.ndarray) -> np.ndarray:
        """(n, 2, 3) displacements at xy (n, 2) along x, along y, and turning by length 1 / size.

        Those that are not possible are zero.
        """
        away = (xy - self.center[body]) / self.size[body]
        motions = np.zeros((len(xy), 2, 3))
        motions[:, 0, 0] = motions[:, 1, 1] = 1.0
        motions[:, 0, 2], motions[:, 1, 2] = -away[:, 1], away[:, 0]
        return motions * self.possible

    def coefficients(self, mode: RigidMode) -> np.ndarray:
        """(3 bodies,) factors of `rigid` that make a rigid mode of rigid_modes.py."""
        factors = np.zeros((len(self.size), 3))
        body = self.number[mode.members[0]]
        factors[body, :2] = mode.displacement(self.center[body : body + 1])[0]
        factors[body, 2] = mode.rotation * self.size[body]
        return factors.ravel()


def bodies_of(skeleton, axisymmetric: bool) -> Bodies:
    """The bodies of a skeleton, `axisymmetric` where they are bodies of revolution; collective."""
    part = components(skeleton.comm, skeleton.nodes[:, 0], skeleton.node_id, skeleton.total)
    _, first, number = np.unique(part, return_index=True, return_inverse=True)
    number = np.argsort(np.argsort(first))[number]  # by their first subdomains
    body, ends = number[skeleton.owner], np.full((2, len(first), 2), -np.inf)
    for extreme, sign in zip(ends, (1.0, -1.0)):
        np.maximum.at(extreme, body, sign * skeleton.place)
    high, low = largest(skeleton.comm, ends) * np.array([1.0, -1.0])[:, None, None]
    return Bodies(number, (low + high) / 2, (high - low).max(axis=1),
                  np.array([0.0, 1.0, 0.0]) if axisymmetric else np.ones(3))


@dataclass
class Travel:
    """The rigid motions `motion` (patterns, bodies, 3) of the load patterns, as in Bodies.rigid."""

    bodies: Bodies
    motion: np.ndarray

    @property
    def patterns(self) -> list[int]:
        """The patterns that move any body."""
        return np.flatnonzero(self.motion.any(axis=(1, 2))).tolist()

    def of(self, weights: np.ndarray) -> np.ndarray:
        """(bodies, 3) motions for pattern factors that may go on with other ones."""
        return np.tensordot(weights[: len(self.motion)], self.motion, axes=1)

    def displacements(self, weights: np.ndarray, subdomains) -> list[np.ndarray]:
        """(dofs,) of every subdomain, for pattern factors that may go on with other ones."""
        motion, fields = self.of(weights), []
        for sub in subdomains:
            body = self.bodies.number[sub.index]
            moved = motion[body].any()
            fields.append((self.bodies.rigid(body, sub.xy) @ motion[body]).ravel() if moved
                          else np.zeros(sub.dofs))
        return fields


def separated(skeleton, subdomains, fixed, sprung: np.ndarray, comm,
              axisymmetric: bool) -> tuple[tuple[np.ndarray, np.ndarray], Travel]:
    """The fixed dofs (keys, values) of supports.fixed_dofs less the travel, and the travel.

    Bodies of the subdomains `sprung` have none: their springs resist it. Collective over `comm`.
    """
    (keys, values), bodies = fixed, bodies_of(skeleton, axisymmetric)
    travel, left = Travel(bodies, np.zeros((values.shape[1], len(bodies.size), 3))), values.copy()
    if not values.any():
        return fixed, travel
    body, motions = _at(keys, bodies, subdomains, comm)
    for k, b in np.argwhere([[values[body == b, k].any() for b in range(len(bodies.size))]
                             for k in range(values.shape[1])]):
        if b in bodies.number[sprung]:
            continue
        here = np.flatnonzero(body == b)
        given = values[here, k]
        motion = _rigid_part(motions[here], keys[here] % 2, given)
        remaining = given - _moved(motions[here], motion)
        if np.abs(remaining).max() <= WORTH * np.abs(given).max():
            travel.motion[k, b], left[here, k] = motion, remaining
    return (keys, left), travel


def _at(keys: np.ndarray, bodies: Bodies, subdomains, comm) -> tuple[np.ndarray, np.ndarray]:
    """Bodies (n,) of the dofs `keys`, and what unit motions do there (n, 3)."""
    parts = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)))]
    for sub in subdomains:
        own = 2 * sub.node_gid[sub.dof_node[sub.fixed]] + sub.dof_component[sub.fixed]
        body = bodies.number[sub.index]
        motions = bodies.rigid(body, sub.xy[sub.dof_node[sub.fixed]])
        motions = motions[np.arange(len(own)), sub.dof_component[sub.fixed]]
        parts.append((own, np.full(len(own), body), motions))
    own, body, motions = (gather(comm, np.concatenate(column)) for column in zip(*parts))
    known, first = np.unique(own, return_index=True)
    at = first[np.searchsorted(known, keys)]
    return body[at], motions[at]


def _rigid_part(motions: np.ndarray, component: np.ndarray, given: np.ndarray) -> np.ndarray:
    """(3,) rigid motion near displacements `given` (n,) of the dofs with `motions` (n, 3) there.

    The middle of each component's values, with a rotation only where these determine one.
    """
    motion = np.zeros(3)
    for c in (0, 1):
        if motions[component == c, c].any():
            motion[c] = (given[component == c].max() + given[component == c].min()) / 2
    remaining = given - _moved(motions, motion)
    if remaining.any() and np.linalg.matrix_rank(motions, tol=1e-6) == 3:
        motion += np.linalg.lstsq(motions, remaining, rcond=None)[0]
    return motion


def _moved(motions: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """(n,) displacements of dofs; a translation is exact."""
    return motions[:, :2] @ motion[:2] + motions[:, 2] * motion[2]


def rows_moved(structure, classes, vectors, pattern: int) -> np.ndarray:
    """(owned,) B r of a pattern's travel; gluing rows do not move. Collective."""
    local, weights = np.zeros(len(vectors.sign)), np.eye(structure.patterns)[pattern]
    fields = structure.travel.displacements(weights, structure.subdomains)
    for c in classes:
        moved = local[c.rows].reshape(len(c.members), -1)
        for i, s in enumerate(c.members):
            rows = structure.rows[s]
            if fields[s].any():
                whole = rows.coefficient + rows.fixed_part
                moved[i] = (whole * fields[s][rows.dof]).sum(axis=1)
    glued = vectors.assemble(local * vectors.sign)
    glued[structure.row_kind == RowKind.GLUING] = 0.0
    return glued
