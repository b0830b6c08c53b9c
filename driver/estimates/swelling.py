"""What bodies grow by as they turn, where contact holds them from two sides.

A rotation theta that is taken for small lengthens every distance, by theta^2/2 of it. A body that
may grow does so without a stress. One that is held between others, as a roller between two plates,
is squeezed by it: of steel, which bears strains of a thousandth, theta = 0.05 makes as much.
"""

import numpy as np

from ..contact.states import OPEN, ContactField
from ..vectors import turned_left

OPPOSED = 0.1  # of the forces from one side, up to which those from the other do not hold a body


def of_bodies(boundary, state: dict, moved: np.ndarray, body: np.ndarray, turns: np.ndarray,
              partners: dict[int, list[int]]) -> list[tuple[float, dict, np.ndarray]]:
    """Of every body that contact holds: the part of its squeeze that comes of its turning, by how
    much it turns, and where (2,) it is held.

    `boundary` and `state` of the contact nodes, `moved` (nodes, 2) displacements, `body` (nodes,)
    numbers of the nodes' bodies, `turns` (bodies,) their mean rotations, `partners` the bodies that
    each first label of pairs meets. Of a label that meets several bodies these are left out.
    """
    closed = np.flatnonzero(state[ContactField.STATUS] != OPEN)
    own, label = body[boundary.gid[closed]], boundary.label[closed].tolist()
    met = [partners.get(name, []) if paired else []
           for name, paired in zip(label, boundary.paired[closed].tolist())]
    other = np.array([bodies[0] if len(bodies) == 1 else -1 for bodies in met], int)
    normal, u = boundary.normal[closed], moved[boundary.gid[closed]]
    force = (state[ContactField.SIGMA_N] * boundary.weight)[closed, None] * normal
    jump = (state[ContactField.U_N][closed, None] * normal
            + state[ContactField.U_T][closed, None] * turned_left(normal))
    found = []
    for k in np.unique(np.concatenate([own, other[other >= 0]])):
        first, second = np.flatnonzero(own == k), np.flatnonzero(other == k)
        beside = np.abs(np.concatenate([np.where(other[first] >= 0, turns[other[first]], 0.0),
                                        turns[own[second]]]))
        xy = boundary.xy[closed[np.concatenate([first, second])]]
        part = share(xy, np.concatenate([u[first], (u - jump)[second]]),
                     np.concatenate([force[first], -force[second]]), turns[k], beside.min())
        found.append((part, {"turn": abs(float(turns[k]))}, xy[0]))
    return found


def share(xy: np.ndarray, u: np.ndarray, force: np.ndarray, turn: float, beside: float) -> float:
    """Part of the squeeze between forces (n, 2) at places `xy` (n, 2) with displacements u (n, 2)
    that comes of the rotation `turn` of the body, where what holds it turns by `beside` at least.

    0 where the forces come from one side.
    """
    direction = np.linalg.eigh(force.T @ force)[1][:, -1]
    along = force @ direction
    weights = [np.maximum(along, 0.0), np.maximum(-along, 0.0)]
    total = np.array([weight.sum() for weight in weights])
    if total.min() <= OPPOSED * total.max():
        return 0.0
    (place, other), (way, way_of_other) = (
        [weight @ values / weight.sum() for weight in weights] for values in (xy, u))
    apart = other - place
    squeeze = abs((way_of_other - way - turn * turned_left(apart[None])[0]) @ direction)
    growth = abs(apart @ direction) * max(turn**2 - beside**2, 0.0) / 2
    return float(growth / squeeze) if squeeze > 0 else 0.0
