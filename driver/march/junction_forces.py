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
SLIGHT = 1e-9  # part of the forces that is rounding
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
        return self._shares(x, gradient, rows, deformation, rtol, comm, None)[0]

    def under_given(self, x: np.ndarray, gradient: np.ndarray, rows, deformation: np.ndarray,
                    rtol: float, comm, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of x that was found with `given` (j,) bounds of friction, NaN where with those
        of its pressures: of forces by which what slides keeps its friction the nearest ones.

        Then what slides is moved to the bound of its pressure. Returns the bounds, too: NaN but at
        junctions where the forces that displacements do not tell decide on friction of what slides.
        """
        return self._shares(x, gradient, rows, deformation, rtol, comm, given)

    def _shares(self, x, gradient, rows, deformation, rtol: float, comm,
                given: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """As `under_given`; without bounds that are `given` by Coulomb's law, as `shared`."""
        force, moved, size, (F, c), known = (np.sum(comm.allgather(own), axis=0) for own in (
            self._at(x), self._at(gradient), self._at(deformation),
            law_at(rows, self.in_tangential), self._bounds(x, rows, given)))
        moved[np.abs(moved) <= max(LEAST, NOISE * rtol) * size] = 0.0
        near = self.beside.forces(x, comm)[0]
        shared, first, bounds = x.copy(), 0, np.full(len(rows.tangential), np.nan)
        for junction in self.of:
            own = slice(first, first := first + len(junction.nodes))
            found = Found(force[own], moved[own], F[own], c[own], self.bilateral[own],
                          self.wears[own], known[own], given is not None, max(SLIGHT, rtol))
            if given is not None and not found.rubs_by(junction).any():
                continue
            chosen = _nearest(junction, found, near[own], self.known[own])
            for places, values in zip((self.normal[own], self.tangential[own]), chosen.T):
                shared[places[places >= 0]] = values[places >= 0]
            places, law = self.in_tangential[own], F[own] * np.abs(chosen[:, 0]) + c[own]
            bounds[places[places >= 0]] = law[places >= 0]
        return shared, bounds

    def _bounds(self, x: np.ndarray, rows, given: np.ndarray | None) -> np.ndarray:
        """(n,) bounds of friction that x was found with, zero at rows of other ranks."""
        bounds = rows.law_bound(x)
        if given is not None:
            bounds = np.where(np.isnan(given), bounds, given)
        return np.append(bounds, 0.0)[self.in_tangential]

    def _at(self, values: np.ndarray) -> np.ndarray:
        """(n, 2) of `values` (owned,) at the rank's rows of the nodes, zero at others."""
        more = np.append(values, 0.0)
        return np.column_stack([more[self.normal], more[self.tangential]])


@dataclass
class Found:
    """What a solver has found at a junction of k nodes, and their laws.

    `force`, `moved` (k, 2): normal and tangential forces, distances and slips, zero where they are
    none. `F`, `c` (k,) of Coulomb's law, `bound` (k,) of friction in the solution: by this law, or
    `given`. `bilateral`, `wears` (k,) as of JunctionForces. Forces may miss laws by a `slight` part
    of them: they are balanced no better, and it may take all of the laws.
    """

    force: np.ndarray
    moved: np.ndarray
    F: np.ndarray
    c: np.ndarray
    bilateral: np.ndarray
    wears: np.ndarray
    bound: np.ndarray
    given: bool
    slight: float

    @property
    def slides(self) -> np.ndarray:
        """(k,) whether nodes slide."""
        return (np.abs(self.force[:, 1]) >= (1 - SLIGHT) * self.bound) & (self.moved[:, 1] != 0)

    @property
    def way(self) -> np.ndarray:
        """(k,) signs of friction where nodes slide."""
        along = self.force[:, 1]
        return np.where(along != 0, np.sign(along), -np.sign(self.moved[:, 1]))

    @property
    def opened(self) -> np.ndarray:
        """(k,) whether nodes are apart."""
        return ~self.bilateral & (self.force[:, 0] == 0) & (self.moved[:, 0] > 0)

    def rubs_by(self, junction: Junction) -> np.ndarray:
        """(k,) whether nodes slide with friction by forces that displacements do not tell."""
        untold = np.zeros(2 * len(self.F), bool)
        untold[junction.rows] = (np.abs(junction.free) > SLIGHT * np.abs(junction.free).max()
                                 ).any(axis=1)
        return self.slides & untold[::2] & (self.F > 0)

    @property
    def held(self) -> np.ndarray:
        """(k, 2) whether forces stay what they are."""
        normal = self.opened | self.wears & self.slides
        return np.column_stack([normal, self.slides & self.given])


def _nearest(junction: Junction, found: Found, near: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(k, 2) forces of a junction's nodes, `near` (k, 2) those beside where they are `known`.

    The present ones if none obey the laws.
    """
    force, slides, F, c = found.force, found.slides, found.F, found.c
    if not force.any():
        return force
    weight, free = np.repeat(np.where(known, 1.0, UNKNOWN), 2), _free(junction, found.held)
    best, least = None, np.inf
    for sign in _signs(found.bilateral, F, force[:, 0]):
        laws = _laws(sign, found.way * slides, F, c, found.held[:, 1])
        chosen = _chosen(free, *laws, force.ravel(), near.ravel(), weight, found.slight)
        if chosen is None:
            continue
        off = np.linalg.norm(weight * (chosen - near.ravel()))
        if off < (1 - SLIGHT) * least:
            best, pressing, least = chosen, sign, off
    if best is None:
        return force
    p, q = best.reshape(-1, 2).T
    p = np.where(found.opened | (p * pressing < 0), 0.0, p)
    bound = F * np.abs(p) + c
    inside = bound if found.given else (1 - SLIGHT) * bound  # what does not slide is not said to
    return np.column_stack([p, np.where(slides, found.way * bound, np.clip(q, -inside, inside))])


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


def _laws(sign, way, F, c, given) -> tuple[np.ndarray, np.ndarray]:
    """A (m, 2 k) and b (m,) of A f <= b: what the laws demand of forces f of k nodes.

    `sign` of normal forces, as from `_signs`; `way` of slips that stay slips, else 0; friction that
    is `given` (k,) has no law.
    """
    most, unit = [], np.eye(2 * len(sign))
    for i, (p, q) in enumerate(zip(unit[::2], unit[1::2])):
        most.append((-sign[i] * p, 0.0))
        if given[i]:
            continue
        most += [(side * q - F[i] * sign[i] * p, c[i]) for side in (1.0, -1.0)]
        if way[i]:
            most.append((F[i] * sign[i] * p - way[i] * q, -c[i]))
    return np.array([row for row, _ in most]), np.array([value for _, value in most])


def _chosen(free, A, b, present, near, weight, slight: float) -> np.ndarray | None:
    """The forces f = `present` + N y (2 k,) nearest to those `near` by `weight`, so that A f <= b.

    N = `free` (2 k, m). None if there are none. Laws may be missed by a `slight` part of the
    forces, and are kept as far as they go together: nearly contrary ones would leave no digits.
    Where forces that are present are far larger than the ones chosen, as those of jammed bodies,
    they are chosen again.
    """
    free = free @ np.linalg.inv(np.linalg.qr(weight[:, None] * free)[1])  # orthonormal by weight
    chosen, largest, before = None, np.abs(present).max(), np.inf
    while 0 < largest < FEWER * before:
        best = free.T @ (weight**2 * (near - present))
        left = b - A @ (present + free @ best)
        step = least_distance(A @ free, left / largest + slight)
        if step is None:
            break
        chosen = present = present + free @ (best + largest * step)
        largest, before = np.abs(present).max(), largest
    if chosen is None:
        return None
    missed = b - A @ chosen
    on = missed < 0
    return chosen + free @ np.linalg.lstsq(A[on] @ free, missed[on], slight)[0]


def _free(junction: Junction, held: np.ndarray) -> np.ndarray:
    """(2 k, m) forces of a junction that displace nothing, nor change those `held` (k, 2)."""
    free = np.zeros((held.size, junction.free.shape[1]))
    free[junction.rows] = junction.free
    _, sizes, ways = np.linalg.svd(free[held.ravel()])
    return free @ ways[np.count_nonzero(sizes > SLIGHT * np.abs(free).max()) :].T


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
