"""Rigid motions that supports leave to the bodies."""

from dataclasses import dataclass

import numpy as np

from ..vectors import turned_left
from .gathering import gather

# part of a motion below which it is rounding: loads across do no work on it, which is all there
# may be
ROUNDED = 1e-14


@dataclass
class RigidMode:
    """A rigid motion of an unsupported body: u(x) = a + b (x - center) turned by +90 degrees."""

    body: int  # number of the body: connected subdomains, in the order of their first one
    members: np.ndarray  # subdomains of the body
    center: np.ndarray  # (2,)
    translation: np.ndarray  # (2,) a
    rotation: float  # b

    def displacement(self, xy: np.ndarray) -> np.ndarray:
        """(n, 2) displacements at the places xy (n, 2)."""
        away = xy - self.center
        return self.translation + self.rotation * turned_left(away)

    def fields(self, structure) -> list[np.ndarray]:
        """(dofs,) displacements of the local subdomains of a Substructure: zero in other bodies."""
        return [self.displacement(sub.xy).ravel() if structure.first + s in self.members
                else np.zeros(sub.dofs) for s, sub in enumerate(structure.subdomains)]


@dataclass
class Springs:
    """All springs of the torn body, replicated; k entries.

    Of each `subdomain` (k,), `xy` (k, 2) and `stiffness` (k, 2, 2).
    """

    subdomain: np.ndarray
    xy: np.ndarray
    stiffness: np.ndarray

    def resistance(self, members: np.ndarray, center: np.ndarray, size: float) -> np.ndarray:
        """(2 k, 3) forces on the springs of some subdomains under the unit motions of their body.

        Relative to the stiffest of them.
        """
        here = np.isin(self.subdomain, members)
        away, stiffness = (self.xy[here] - center) / size, self.stiffness[here]
        motions = np.zeros((len(away), 2, 3))
        motions[:, 0, 0] = motions[:, 1, 1] = 1.0
        motions[:, 0, 2], motions[:, 1, 2] = -away[:, 1], away[:, 0]
        largest = stiffness.max(initial=0.0) or 1.0
        return (stiffness / largest @ motions).reshape(-1, 3)


def all_springs(manifest, subdomains, comm) -> Springs:
    """The springs of all subdomains; collective where the scene declares any."""
    parts = [np.empty((0, 6))]
    for sub in subdomains:
        if sub.springs is not None:
            node = np.flatnonzero(sub.springs.any(axis=1))
            parts.append(np.column_stack([np.full(len(node), sub.index), sub.xy[node],
                                          sub.springs[node]]))
    table = np.concatenate(parts)
    if "springs" in manifest.rooms:
        table = gather(comm, table)
    return Springs(table[:, 0].astype(int), table[:, 1:3],
                   table[:, [3, 4, 4, 5]].reshape(-1, 2, 2))


def rigid_modes(skeleton, bodies, fixed_keys, corner_keys, springs: Springs,
                axisymmetric: bool) -> tuple[list[RigidMode], np.ndarray]:
    """Rigid motions that supports and springs leave to `bodies`, orthonormal at their coarse dofs.

    Bodies of revolution (`axisymmetric`) have that along the axis alone. Every rank gets to know
    all vertices of bodies that may move, of others those at supports; collective.
    """
    possible = [1] if axisymmetric else [0, 1, 2]
    own = bodies.number[skeleton.owner]

    def vertices_of(chosen: np.ndarray):
        """Bodies, keys (n, 2) and places of the `chosen` ones of all vertices, by gid."""
        here = np.flatnonzero(chosen & skeleton.owned)
        gid, body, place = (gather(skeleton.comm, of[here])
                            for of in (skeleton.gids, own, skeleton.place))
        order = np.argsort(gid, kind="stable")
        return body[order], 2 * gid[order][:, None] + [0, 1], place[order]

    def left(number: int, keys: np.ndarray, motions: np.ndarray, *box) -> np.ndarray:
        """(3, free) motions that supports and springs leave to a body."""
        members = np.flatnonzero(bodies.number == number)
        holding = np.vstack([motions[np.isin(keys, fixed_keys)],
                             springs.resistance(members, *box)])
        held = np.linalg.qr(holding[:, possible], mode="r")
        _, sizes, basis = np.linalg.svd(held, full_matrices=True)
        rank = int((sizes > 1e-10 * max(1.0, sizes.max(initial=0.0))).sum())
        free = np.zeros((3, basis.shape[1] - rank))
        free[possible] = np.where(np.abs(basis[rank:]) > ROUNDED, basis[rank:], 0.0).T
        return free

    fixed = np.isin(2 * skeleton.gids[:, None] + [0, 1], fixed_keys).any(axis=1)
    body, keys, place = vertices_of(fixed)
    loose = []
    for number, box in enumerate(zip(bodies.center, bodies.size)):
        here = body == number
        if left(number, keys[here].ravel(), _motions(place[here], *box), *box).shape[1]:
            loose.append(number)
    modes, columns = [], []
    if loose:
        body, keys, place = vertices_of(np.isin(own, loose))
    for number in loose:
        here = body == number
        key, xy = keys[here].ravel(), place[here]
        box = xy.mean(axis=0), np.ptp(xy, axis=0).max()
        motions = _motions(xy, *box)
        free, at_corner = left(number, key, motions, *box), np.isin(key, corner_keys)
        if not free.shape[1] or not at_corner.any():
            continue
        _, triangle = np.linalg.qr(motions[at_corner] @ free)
        free = free @ np.linalg.inv(triangle)
        column = np.zeros((len(corner_keys), free.shape[1]))
        column[np.searchsorted(corner_keys, key[at_corner])] = motions[at_corner] @ free
        columns.append(column)
        members, (center, size) = np.flatnonzero(bodies.number == number), box
        modes += [RigidMode(number, members, center, c[:2].copy(), c[2] / size) for c in free.T]
    return modes, np.hstack([np.zeros((len(corner_keys), 0)), *columns])


def _motions(xy: np.ndarray, center: np.ndarray, size: float) -> np.ndarray:
    """(2 n, 3) displacements at xy (n, 2) along x, along y, turning by length 1 / size."""
    away = (xy - center) / size
    along_x, along_y = (np.tile(axis, (len(away), 1)) for axis in np.eye(2))
    turned = turned_left(away)
    return np.stack([along_x, along_y, turned], axis=2).reshape(-1, 3)
