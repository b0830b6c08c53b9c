"""Rigid motions that supports leave to the bodies."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

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
        return self.translation + self.rotation * np.column_stack([-away[:, 1], away[:, 0]])


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
    if "springs" not in manifest.rooms:
        return Springs(np.empty(0, int), np.empty((0, 2)), np.empty((0, 2, 2)))
    parts = [np.empty((0, 6))]
    for sub in subdomains:
        if sub.springs is not None:
            node = np.flatnonzero(sub.springs.any(axis=1))
            parts.append(np.column_stack([np.full(len(node), sub.index), sub.xy[node],
                                          sub.springs[node]]))
    table = gather(comm, np.concatenate(parts))
    return Springs(table[:, 0].astype(int), table[:, 1:3],
                   table[:, [3, 4, 4, 5]].reshape(-1, 2, 2))


def rigid_modes(skeleton, fixed_keys, corner_keys, springs: Springs,
                axisymmetric: bool) -> tuple[list[RigidMode], np.ndarray]:
    """Rigid motions that supports and springs leave to each body, orthonormal at its coarse dofs.

    Bodies of revolution (`axisymmetric`) have that along the axis alone.
    """
    possible = [1] if axisymmetric else [0, 1, 2]
    total = int(skeleton.nodes[:, 0].max()) + 1
    ends = skeleton.nodes[:, 0], total + skeleton.node_id
    links = coo_matrix((np.ones(len(ends[0])), ends), shape=(total + len(skeleton.gids),) * 2)
    _, body = connected_components(links, directed=False)
    place = skeleton.place
    modes, columns = [], []
    for number, component in enumerate(dict.fromkeys(body[:total].tolist())):  # by first subdomain
        vertices = np.flatnonzero(body[total:] == component)
        center, size = place[vertices].mean(axis=0), np.ptp(place[vertices], axis=0).max()
        keys = (2 * skeleton.gids[vertices][:, None] + [0, 1]).ravel()
        away = (place[vertices] - center) / size
        along_x, along_y = (np.tile(axis, (len(away), 1)) for axis in np.eye(2))
        turned = np.column_stack([-away[:, 1], away[:, 0]])
        motions = np.stack([along_x, along_y, turned], axis=2).reshape(-1, 3)
        members = np.flatnonzero(body[:total] == component)
        holding = np.vstack([motions[np.isin(keys, fixed_keys)],
                             springs.resistance(members, center, size)])
        held = np.linalg.qr(holding[:, possible], mode="r")
        _, sizes, basis = np.linalg.svd(held, full_matrices=True)
        rank = int((sizes > 1e-10 * max(1.0, sizes.max(initial=0.0))).sum())
        free = np.zeros((3, basis.shape[1] - rank))
        free[possible] = np.where(np.abs(basis[rank:]) > ROUNDED, basis[rank:], 0.0).T
        at_corner = np.isin(keys, corner_keys)
        if not free.shape[1] or not at_corner.any():
            continue
        _, triangle = np.linalg.qr(motions[at_corner] @ free)
        free = free @ np.linalg.inv(triangle)
        column = np.zeros((len(corner_keys), free.shape[1]))
        column[np.searchsorted(corner_keys, keys[at_corner])] = motions[at_corner] @ free
        columns.append(column)
        modes += [RigidMode(number, members, center, c[:2].copy(), c[2] / size) for c in free.T]
    return modes, np.hstack([np.zeros((len(corner_keys), 0)), *columns])
