"""Forces at junctions (contact/junctions.py), which displacements do not tell, at a step's end.

Which of them a solver comes to depends on its way, and with that on the cut. They are chosen anew,
which moves nothing, as near as the laws of all nodes allow to the forces that the tractions of the
nodes beside them would make: what is open stays open, what slides stays on its bound. A
least-squares problem with linear constraints is one of least distance (qp/least_distance.py).
"""

from dataclasses import dataclass

import numpy as np

from ..contact.beside import Beside, beside, neighbours
from ..contact.junctions import Junction
from ..qp.least_distance import least_distance

TOUCHES = 1e-6  # distance, relative to the deformation, that is none
SLIPS = 10 * TOUCHES  # slip, likewise, that the errors of two steps do not make
SLIGHT = 1e-9  # part of the forces by which a law may be missed: rounding


@dataclass
class JunctionForces:
    """Shares the forces of all junctions; the same on every rank, with the rows that it owns.

    `of`: the junctions; `normal`, `tangential` (n,) positions of their nodes' rows in the rank's
    dual vectors, -1 where it owns none; `in_tangential` (n,) likewise in ContactRows; `bilateral`
    (n,); `known` (n,) whether a node lies `beside` them, else nothing is beside.
    """

    of: list[Junction]
    normal: np.ndarray
    tangential: np.ndarray
    in_tangential: np.ndarray
    bilateral: np.ndarray
    beside: Beside
    known: np.ndarray

    def shared(self, x: np.ndarray, gradient: np.ndarray, rows, deformation: np.ndarray,
               comm) -> np.ndarray:
        """Multipliers x (owned,) with the forces at junctions chosen; `gradient` is F x - d.

        `rows` are the ContactRows; `deformation` (owned,) by which what touches and slides is
        judged. Collective.
        """
        force, moved, size, (F, c) = (np.sum(comm.allgather(own), axis=0) for own in (
            self._at(x), self._at(gradient), self._at(deformation), self._law(rows)))
        near = np.where(self.known[:, None], self.beside.forces(x, comm)[0], 0.0)
        shared, first = x.copy(), 0
        for junction in self.of:
            own = slice(first, first := first + len(junction.nodes))
            chosen = _nearest(junction, force[own], moved[own], size[own], F[own], c[own],
                              self.bilateral[own], near[own])
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


def _nearest(junction: Junction, force, moved, size, F, c, bilateral, near) -> np.ndarray:
    """(k, 2) forces of a junction's nodes, `near` those beside; the present ones if none obey."""
    largest, k = np.abs(force).max(), len(force)
    if largest == 0:
        return force
    free = np.zeros((2 * k, junction.free.shape[1]))
    free[junction.rows] = junction.free
    present = force.ravel() / largest
    most, sign = [], np.where(bilateral & (force[:, 0] < 0), -1.0, 1.0)
    bound = F * np.abs(force[:, 0]) + c
    at_bound = np.abs(force[:, 1]) >= (1 - SLIGHT) * bound
    slides = at_bound & (np.abs(moved[:, 1]) > SLIPS * size[:, 1]) & (bound > 0)
    opened = ~bilateral & (force[:, 0] == 0) & (moved[:, 0] > TOUCHES * size[:, 0])
    unit = np.eye(2 * k)
    for i, (p, q) in enumerate(zip(unit[::2], unit[1::2])):
        way = np.sign(force[i, 1])
        within = [side * q - F[i] * sign[i] * p for side in (1.0, -1.0)]
        most += [(-sign[i] * p, 0.0), *((row, c[i] / largest) for row in within)]
        if opened[i]:
            most.append((p, 0.0))
        if slides[i]:
            most.append((F[i] * sign[i] * p - way * q, -c[i] / largest))
    A, b = np.array([row for row, _ in most]), np.array([value for _, value in most])
    aim = free.T @ (near.ravel() / largest - present)
    step = least_distance(A @ free, b + SLIGHT - A @ (present + free @ aim))
    if step is None:
        return force
    p, q = largest * (present + free @ (aim + step)).reshape(-1, 2).T
    p = np.where(opened | (p * sign <= 0), 0.0, p)
    bound = F * np.abs(p) + c
    inside = (1 - SLIGHT) * bound  # what does not slide is not said to
    q = np.where(slides, np.sign(force[:, 1]) * bound, np.clip(q, -inside, inside))
    return np.column_stack([p, q])


def junction_forces(structure, rows, law) -> JunctionForces:
    """Those of a Substructure; `rows` are the rank's ContactRows, `law` the ContactLaw."""
    contact, (start, stop) = structure.contact, structure.row_range
    nodes = np.concatenate([junction.nodes for junction in contact.junctions])
    place = np.full(len(contact.gid), -1)
    place[rows.tangential_node] = np.arange(len(rows.tangential_node))

    def owned(numbers: np.ndarray) -> np.ndarray:
        return np.where((numbers >= start) & (numbers < stop), numbers - start, -1)

    return JunctionForces(contact.junctions, owned(contact.normal_row[nodes]),
                          owned(contact.tangential_row[nodes]), place[nodes],
                          law.bilateral[nodes], beside(contact, nodes[None], owned),
                          neighbours(contact, nodes) >= 0)
