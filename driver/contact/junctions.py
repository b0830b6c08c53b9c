"""Junctions: places where bodies meet one another and others, as two blocks beside on a floor.

Each of the contact nodes there has its conditions, and together they depend on one another: what
the blocks press one another by, the floor may take as friction under both. Displacements leave
forces N y open, N the null space of the transposed rows, so that which of them a solver comes to
depends on its way, and with that on the cut. At the end of a step they are chosen anew, which moves
nothing, as near as the laws of all nodes allow to the forces that the tractions of the nodes beside
them would make: what is open stays open, what slides stays on its bound.

A least-squares problem with linear constraints, which is one of least distance; that is solved by
non-negative least squares (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, SIAM 1995,
chapter 23).
"""

from dataclasses import dataclass

import numpy as np

from .beside import Beside, beside, neighbours
from .corner_pairs import rows_of

SAME = 1e-9  # part of the boundary's extent within which places are one
DEPENDENT = 1e-8  # singular value below which rows of length one depend on one another
TOUCHES = 1e-6  # distance, relative to the deformation, that is none
SLIPS = 10 * TOUCHES  # slip, likewise, that the errors of two steps do not make
SLIGHT = 1e-9  # part of the forces by which a law may be missed: rounding


@dataclass
class Junction:
    """Contact nodes (k,) at one place, their rows and forces (rows, m) that displace nothing.

    `rows`: 2 i for the normal, 2 i + 1 for the tangential row of the i-th node.
    """

    nodes: np.ndarray
    rows: np.ndarray
    free: np.ndarray


def junctions(contact, fixed_keys: np.ndarray) -> list[Junction]:
    """Those of a ContactBoundary; empty where bodies meet nothing but obstacles.

    `fixed_keys` are 2 gid + component of the displacements that supports fix. Vertices whose own
    rows depend on one another are corners (corner_pairs.py), and no junctions.
    """
    contact, known = contact.declared, set(contact.corners[:, :2].ravel().tolist())
    if not contact.paired.any():
        return []
    able = np.flatnonzero(contact.normal_row >= 0)
    size = np.ptp(contact.xy[able], axis=0).max()
    _, place, count = np.unique(np.round(contact.xy[able] / (SAME * size)), axis=0,
                                return_inverse=True, return_counts=True)
    found = []
    for group in np.flatnonzero(count > 2):
        nodes = able[place.ravel() == group]
        if known & set(nodes.tolist()):
            continue
        matrix, rows = _matrix(contact, nodes, fixed_keys)
        left, values, _ = np.linalg.svd(matrix)
        values = np.append(values, np.zeros(len(matrix) - len(values)))
        if (values <= DEPENDENT * values.max()).any():
            found.append(Junction(nodes, rows, left[:, values <= DEPENDENT * values.max()]))
    return found


def _matrix(contact, nodes: np.ndarray, fixed_keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(rows, displacements) of the nodes' rows, and which these are."""
    rows, of = [], []
    for i, node in enumerate(nodes):
        for kind, row in enumerate(rows_of(contact, node, fixed_keys)):
            rows.append(row)
            of.append(2 * i + kind)
    keys = {key: place for place, key in enumerate(sorted(set().union(*rows)))}
    matrix = np.zeros((len(rows), len(keys)))
    for number, row in enumerate(rows):
        matrix[number, [keys[key] for key in row]] = list(row.values())
    return matrix, np.array(of)


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
    least, sign = [], np.where(bilateral & (force[:, 0] < 0), -1.0, 1.0)
    bound = F * np.abs(force[:, 0]) + c
    at_bound = np.abs(force[:, 1]) >= (1 - SLIGHT) * bound
    slides = at_bound & (np.abs(moved[:, 1]) > SLIPS * size[:, 1]) & (bound > 0)
    opened = ~bilateral & (force[:, 0] == 0) & (moved[:, 0] > TOUCHES * size[:, 0])
    unit = np.eye(2 * k)
    for i, (p, q) in enumerate(zip(unit[::2], unit[1::2])):
        way = np.sign(force[i, 1])
        within = [F[i] * sign[i] * p - side * q for side in (1.0, -1.0)]
        least += [(sign[i] * p, 0.0), *((row, -c[i] / largest) for row in within)]
        if opened[i]:
            least.append((-p, 0.0))
        if slides[i]:
            least.append((way * q - F[i] * sign[i] * p, c[i] / largest))
    A, b = np.array([row for row, _ in least]), np.array([value for _, value in least])
    aim = free.T @ (near.ravel() / largest - present)
    step = least_distance(A @ free, b - SLIGHT - A @ (present + free @ aim))
    if step is None:
        return force
    p, q = largest * (present + free @ (aim + step)).reshape(-1, 2).T
    p = np.where(opened | (p * sign <= 0), 0.0, p)
    bound = F * np.abs(p) + c
    q = np.where(slides, np.sign(force[:, 1]) * bound, np.clip(q, -bound, bound))
    return np.column_stack([p, q])


def least_distance(G: np.ndarray, h: np.ndarray) -> np.ndarray | None:
    """The shortest z with G z >= h, None if there is none (Lawson, Hanson, (23.27))."""
    from scipy.optimize import nnls  # few scenes need it

    E = np.vstack([G.T, h])
    target = np.append(np.zeros(G.shape[1]), 1.0)
    rest = E @ nnls(E, target)[0] - target
    return -rest[:-1] / rest[-1] if np.linalg.norm(rest) > SLIGHT else None


def junction_forces(structure, in_tangential: np.ndarray, law) -> JunctionForces | None:
    """The junctions of a Substructure; None, which costs nothing, where there are none.

    `in_tangential` (n_c,): places of tangential rows among the rank's, or -1; `law`: ContactLaw.
    """
    contact, (start, stop) = structure.contact, structure.row_range
    if not contact.junctions:
        return None
    nodes = np.concatenate([junction.nodes for junction in contact.junctions])

    def owned(rows: np.ndarray) -> np.ndarray:
        return np.where((rows >= start) & (rows < stop), rows - start, -1)

    return JunctionForces(contact.junctions, owned(contact.normal_row[nodes]),
                          owned(contact.tangential_row[nodes]), in_tangential[nodes],
                          law.bilateral[nodes], beside(contact, nodes[None], owned),
                          neighbours(contact, nodes) >= 0)
