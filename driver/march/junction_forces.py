"""Forces at junctions (contact/junctions.py), which displacements do not tell, at a step's end.

Which of them a solver comes to depends on its way, and with that on the cut. They are chosen anew,
which moves nothing, as near as the laws of all nodes allow to the forces that the tractions of the
nodes beside them would make: what is open stays open, what slides stays on its bound, and what
wears off as it slides keeps its pressure. A least-squares problem with linear constraints is one of
least distance (qp/least_distance.py).
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..contact.beside import Beside, beside, neighbours
from ..contact.junctions import Junction, junctions
from ..contact.law import law_at
from ..feti.supports import constrained_keys
from ..qp.least_distance import least_distance

NOISE = 20.0  # times the tolerance of displacements: distances and slips beyond that are some
LEAST = 1e-6  # of the deformation, likewise, where tolerances are finer
SLIGHT = 1e-9  # part of the forces by which a law may be missed: rounding
FEWER = 0.1  # of the forces, by which they are chosen again
MOST = 6  # nodes of a junction that press or pull, of which all signs are tried
UNKNOWN = 1e-3  # weight of forces beside which there is no node


@dataclass
class JunctionForces:
    """Shares the forces of all junctions; the same on every rank, with the rows that it owns.

    `of`: the junctions; `normal`, `tangential` (n,) positions of their nodes' rows in the rank's
    dual vectors, -1 where it owns none; `in_tangential` (n,) likewise in ContactRows; `bilateral`
    and `wears` (n,); `known` (n,) whether a node lies `beside` them.
    """

    of: list[Junction]
    normal: np.ndarray
    tangential: np.ndarray
    in_tangential: np.ndarray
    bilateral: np.ndarray
    wears: np.ndarray
    beside: Beside
    known: np.ndarray

    def shared(self, x: np.ndarray, gradient: np.ndarray, rows, deformation: np.ndarray,
               rtol: float, comm) -> np.ndarray:
        """Multipliers x (owned,) with the forces at junctions chosen; `gradient` is F x - d.

        `rows` are the ContactRows; distances and slips are right to `rtol` times the `deformation`
        (owned,). Collective.
        """
        force, moved, size, (F, c) = (np.sum(comm.allgather(own), axis=0) for own in (
            self._at(x), self._at(gradient), self._at(deformation),
            law_at(rows, self.in_tangential)))
        moved[np.abs(moved) <= max(LEAST, NOISE * rtol) * size] = 0.0
        near = self.beside.forces(x, comm)[0]
        shared, first = x.copy(), 0
        for junction in self.of:
            own = slice(first, first := first + len(junction.nodes))
            chosen = _nearest(junction, force[own], moved[own], F[own], c[own],
                              self.bilateral[own], self.wears[own], near[own], self.known[own])
            for places, values in zip((self.normal[own], self.tangential[own]), chosen.T):
                shared[places[places >= 0]] = values[places >= 0]
        return shared

    def _at(self, values: np.ndarray) -> np.ndarray:
        """(n, 2) of `values` (owned,) at the rank's rows of the nodes, zero at others."""
        more = np.append(values, 0.0)
        return np.column_stack([more[self.normal], more[self.tangential]])


def _nearest(junction: Junction, force, moved, F, c, bilateral, wears, near,
             known) -> np.ndarray:
    """(k, 2) forces of a junction's nodes, `near` those beside; the present ones if none obey.

    `moved` (k, 2) are distances and slips, zero where they are none.
    """
    if not force.any():
        return force
    way = np.where(force[:, 1] != 0, np.sign(force[:, 1]), -np.sign(moved[:, 1]))
    slides = (np.abs(force[:, 1]) >= (1 - SLIGHT) * (F * np.abs(force[:, 0]) + c)) & (
        moved[:, 1] != 0)
    opened = ~bilateral & (force[:, 0] == 0) & (moved[:, 0] > 0)
    held = opened | wears & slides
    weight = np.repeat(np.where(known, 1.0, UNKNOWN), 2)
    found, least = None, np.inf
    for sign in _signs(bilateral, F, force[:, 0]):
        laws = _laws(sign, way * slides, np.where(held, force[:, 0], np.nan), F, c)
        chosen = _chosen(junction, *laws, force.ravel(), near.ravel(), weight)
        if chosen is None:
            continue
        off = np.linalg.norm(weight * (chosen - near.ravel()))
        if off < (1 - SLIGHT) * least:
            found, pressing, least = chosen, sign, off
    if found is None:
        return force
    p, q = found.reshape(-1, 2).T
    p = np.where(opened | (p * pressing < 0), 0.0, p)
    bound = F * np.abs(p) + c
    inside = (1 - SLIGHT) * bound  # what does not slide is not said to
    return np.column_stack([p, np.where(slides, way * bound, np.clip(q, -inside, inside))])


def _signs(bilateral: np.ndarray, F: np.ndarray, pressure: np.ndarray):
    """Signs (k,) of normal forces in turn, 1 or -1; 0 for those that no law tells from one another.

    Friction of what may press and pull has two cones: all combinations of them, but where they
    are too many those of the `pressure` (k,) that there is.
    """
    either = bilateral & (F > 0)
    sign = np.where(either & (pressure < 0), -1.0, np.where(bilateral & ~either, 0.0, 1.0))
    if np.count_nonzero(either) > MOST:
        return [sign]
    choices = [(1.0, -1.0) if two else (one,) for two, one in zip(either, sign)]
    return map(np.array, product(*choices))


def _laws(sign, way, held, F, c) -> tuple[np.ndarray, np.ndarray]:
    """A (m, 2 k) and b (m,) of A f <= b: what the laws demand of forces f of k nodes.

    `sign` of normal forces, as from `_signs`; `way` of slips that stay slips, else 0; `held` are
    normal forces that stay, else NaN.
    """
    most, unit = [], np.eye(2 * len(sign))
    for i, (p, q) in enumerate(zip(unit[::2], unit[1::2])):
        most += [(side * q - F[i] * sign[i] * p, c[i]) for side in (1.0, -1.0)]
        most.append((-sign[i] * p, 0.0))
        if way[i]:
            most.append((F[i] * sign[i] * p - way[i] * q, -c[i]))
        if not np.isnan(held[i]):
            most += [(side * p, side * held[i]) for side in (1.0, -1.0)]
    return np.array([row for row, _ in most]), np.array([value for _, value in most])


def _chosen(junction: Junction, A, b, present, near, weight) -> np.ndarray | None:
    """The forces f = `present` + N y (2 k,) nearest to those `near` by `weight`, so that A f <= b.

    None if there are none. What of a law is rounding is a part of the forces: where those that are
    present are far larger than the ones chosen, as those of jammed bodies, they are chosen again.
    """
    free = np.zeros((len(present), junction.free.shape[1]))
    free[junction.rows] = junction.free
    free = free @ np.linalg.inv(np.linalg.qr(weight[:, None] * free)[1])  # orthonormal by weight
    chosen, largest, before = None, np.abs(present).max(), np.inf
    while 0 < largest < FEWER * before:
        best = free.T @ (weight**2 * (near - present))
        left = b - A @ (present + free @ best)
        step = least_distance(A @ free, left / largest + SLIGHT)
        if step is None:
            break
        chosen = present = present + free @ (best + largest * step)
        largest, before = np.abs(present).max(), largest
    return chosen


def junction_forces(structure, rows, law, effects, comm) -> JunctionForces | None:
    """Those of a Substructure, None where there are none; collective.

    `rows` are the rank's ContactRows, `law` the ContactLaw.
    """
    contact, (start, stop) = structure.contact, structure.row_range
    declared, count = contact.declared, len(contact.gid)
    yields, wears = np.zeros((2, count), bool)
    yields[: len(declared.gid)] = effects.yields(declared)
    wears[: len(declared.gid)] = declared.columns.get("wear", np.zeros(len(declared.gid))) > 0
    keys = np.unique(np.concatenate(comm.allgather(constrained_keys(structure))))
    found = junctions(contact, keys, yields)
    if not found:
        return None
    nodes = np.concatenate([junction.nodes for junction in found])
    place = np.full(count, -1)
    place[rows.tangential_node] = np.arange(len(rows.tangential_node))

    def owned(numbers: np.ndarray) -> np.ndarray:
        return np.where((numbers >= start) & (numbers < stop), numbers - start, -1)

    return JunctionForces(found, owned(contact.normal_row[nodes]),
                          owned(contact.tangential_row[nodes]), place[nodes],
                          law.bilateral[nodes], wears[nodes],
                          beside(contact, nodes[None], owned), neighbours(contact, nodes) >= 0)
