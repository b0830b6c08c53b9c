"""Which bodies stand: on supports, or on a flat foot that keeps them where they are.

A body that contact alone keeps from turning rolls: as it turns, other points are in contact. Not so
one that rests with a flat side on a flat obstacle, or on a flat side of a body that stands itself:
as long as all of the foot is pressed, contact holds it as a clamp does where it sticks, and as a
guide where it slides.
"""

import numpy as np

from ..contact.states import OPEN, STICK
from ..results.record import ROUND, is_straight
from ..vectors import turned_left
from .finite_rotations import rolling

LOOSE = 1e-6  # part of the largest, of a rigid motion in the ways along rows that resist it


def standing(structure, comm, status: np.ndarray, time: float) -> np.ndarray:
    """(bodies,) whether supports, or flat feet in a state with the `status` (n_c,) of the contact
    nodes at a `time`, keep a body where it is. Collective over `comm`.
    """
    stands = ~rolling(structure)
    if stands.all() or not len(status):
        return stands
    boundary = structure.contact.declared.at(time)
    body, other = (_bodies(structure, comm, boundary, of_other) for of_other in (False, True))
    feet = _flat(boundary, status)
    for _ in stands:  # those that stand on others that stand
        for k in np.flatnonzero(~stands):
            on = np.where(other < 0, ~boundary.paired, stands[other])
            held = feet & ((body == k) & on | (other == k) & (body >= 0) & stands[body])
            stands[k] = _held(structure, k, boundary, held, held & (status == STICK))
    return stands


def _bodies(structure, comm, boundary, of_other: bool) -> np.ndarray:
    """(n_c,) number of the body that a contact node is on, or of the other one; -1 without."""
    terms = np.flatnonzero(boundary.term_other == of_other)
    gid, found = boundary.term_gid[terms], np.full(len(boundary.gid), -1)
    number = structure.travel.bodies.number
    for sub in structure.subdomains:
        here = np.isin(gid, sub.node_gid)
        found[boundary.term_node[terms[here]]] = number[sub.index]
    return np.max(comm.allgather(found), axis=0)


def _flat(boundary, status: np.ndarray) -> np.ndarray:
    """(n_c,) whether a node is one of three or more in contact on a flat side of a body and on one
    of what it meets.
    """
    found = np.zeros(len(status), bool)
    for chain in np.unique(boundary.chain):
        at = np.flatnonzero((boundary.chain == chain) & (status != OPEN))
        xy, normal = boundary.xy[at], boundary.normal[at]
        found[at] = (is_straight(xy) and np.ptp(normal, axis=0).max() <= ROUND
                     and is_straight(xy + boundary.gap[at, None] * normal))
    return found


def _held(structure, body: int, boundary, pressed: np.ndarray, sticks: np.ndarray) -> bool:
    """Whether contact of nodes (n_c,) along their normals and, of those that stick, along their
    tangents resists all rigid motions of a body that supports do not.
    """
    modes = [mode for mode in structure.rigid_modes
             if structure.travel.bodies.number[mode.members[0]] == body]
    ways = []
    for mode in modes:
        moved, normal = mode.displacement(boundary.xy), boundary.normal
        ways.append(np.concatenate([(moved * normal).sum(axis=1)[pressed],
                                    (moved * turned_left(normal)).sum(axis=1)[sticks]]))
    table = np.array([way / (np.abs(way).max(initial=0.0) or 1.0) for way in ways])
    return bool(np.linalg.matrix_rank(table, LOOSE) == len(modes)) if table.size else False
