"""Forces at junctions (contact/junctions.py), which displacements do not tell, at a step's end.

Which of them a solver comes to depends on its way, and with that on the cut. They are chosen anew,
which moves nothing, as near as the laws of all nodes allow to the forces that the tractions of the
nodes beside them would make: what is open stays open, what slides stays on its bound, and what
wears off as it slides keeps its pressure. A least-squares problem with linear constraints is one of
least distance (qp/least_distance.py).
"""

from dataclasses import dataclass

import numpy as np

from ..contact.beside import Beside, beside, neighbours
from ..contact.junctions import Junction, junctions
from ..feti.supports import constrained_keys
from ..qp.least_distance import least_distance

NOISE = 20.0  # times the tolerance of displacements: distances and slips beyond that are some
LEAST = 1e-6  # of the deformation, likewise, where tolerances are finer
SLIGHT = 1e-9  # part of the forces by which a law may be missed: rounding
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
            self._at(x), self._at(gradient), self._at(deformation), self._law(rows)))
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

    def _law(self, rows) -> np.ndarray:
        """(2, n) coefficients and offsets of the rank's friction bounds, zero at others."""
        return np.array([np.zeros(len(self.normal)) if values is None
                         else np.append(values, 0.0)[self.in_tangential]
                         for values in (rows.coefficient, rows.offset)])


def _nearest(junction: Junction, force, moved, F, c, bilateral, wears, near,
             known) -> np.ndarray:
    """(k, 2) forces of a junction's nodes, `near` those beside; the present ones if none obey.

    `moved` (k, 2) are distances and slips, zero where they are none.
    """
    largest, k = np.abs(force).max(), len(force)
    if largest == 0:
        return force
    way = np.where(force[:, 1] != 0, np.sign(force[:, 1]), -np.sign(moved[:, 1]))
    slides = (np.abs(force[:, 1]) >= (1 - SLIGHT) * (F * np.abs(force[:, 0]) + c)) & (
        moved[:, 1] != 0)
    opened = ~bilateral & (force[:, 0] == 0) & (moved[:, 0] > 0)
    sign = np.where(bilateral & (force[:, 0] < 0), -1.0, 1.0)
    present, most = force.ravel() / largest, []
    unit = np.eye(2 * k)
    for i, (p, q) in enumerate(zip(unit[::2], unit[1::2])):
        most += [(side * q - F[i] * sign[i] * p, c[i] / largest) for side in (1.0, -1.0)]
        if not bilateral[i] or F[i] > 0:
            most.append((-sign[i] * p, 0.0))
        if slides[i]:
            most.append((F[i] * sign[i] * p - way[i] * q, -c[i] / largest))
        if opened[i] or wears[i] and slides[i]:
            most += [(side * p, side * p @ present) for side in (1.0, -1.0)]
    moves = _chosen(junction, np.array([row for row, _ in most]),
                    np.array([value for _, value in most]), present,
                    near.ravel() / largest - present, np.repeat(np.where(known, 1.0, UNKNOWN), 2))
    if moves is None:
        return force
    p, q = largest * (present + moves).reshape(-1, 2).T
    p = np.where(opened | ((p * sign <= 0) & (~bilateral | (F > 0))), 0.0, p)
    bound = F * np.abs(p) + c
    inside = (1 - SLIGHT) * bound  # what does not slide is not said to
    return np.column_stack([p, np.where(slides, way * bound, np.clip(q, -inside, inside))])


def _chosen(junction: Junction, A, b, present, aim, weight) -> np.ndarray | None:
    """Change N y of the forces `present` (2 k,) that is nearest to `aim` by `weight` (2 k,), so
    that A (present + N y) <= b; None if there is none.
    """
    free = np.zeros((len(present), junction.free.shape[1]))
    free[junction.rows] = junction.free
    free = free @ np.linalg.inv(np.linalg.qr(weight[:, None] * free)[1])  # orthonormal by weight
    best = free.T @ (weight**2 * aim)
    step = least_distance(A @ free, b + SLIGHT - A @ (present + free @ best))
    return None if step is None else free @ (best + step)


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
