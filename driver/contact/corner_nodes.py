"""Corners: two contact nodes at one vertex, whose rows depend on one another.

On a rigid corner a vertex has two contact conditions and two of friction, four rows on at most two
displacements; where a support leaves it one, two normal rows act on the same. Only sums of their
multipliers are determined, unless both surfaces are rough (corner_pairs.py). So each corner is in a
state that leaves as many multipliers free as there are displacements, see acting.py.

A state is right if the excluded condition is not penetrated and none of both has opened. `switch`
moves on to the state that a violation asks for after each fixed point of the friction bound. Where
friction drags a vertex from one side to the other, one side alone violates the other and both
without friction open again: a corner that returns to `both` stands instead. One that has changed
its state `MOST` times in a step and is still not right is `undecided`: no solution.

Friction that needs no pressure (Tresca, cohesion) acts on both sides of a vertex that neither
presses, and of one that touches both, where forces are shared by the laws of both. Where one side
presses it acts on that side alone. With the other side's, too, there were three multipliers on two
displacements; and a vertex that sticks would leave undetermined how much of its pressure that other
side takes, and with it Coulomb's bound on this one. What is left out is the friction of an open
side, on half an edge: a force that falls with the mesh size like the error of the tractions next to
a corner.

Several states may hold a vertex that touches both sides with the same force. So the end of a step
does not know in which one it got there: the force is `shared` anew between the sides, and the state
becomes that of the shares. Where a vertex arrives in its corner both sides have rubbed on the way,
each obeys Coulomb's law with that slip; one that was there a step ago and still is has not slid, if
no obstacle has moved, whatever the errors of two steps add up to, and is held with the least change
of its friction; between bodies with the forces nearest to those that the tractions of the next
nodes would make (beside.py), as one stress on both sides of the corner asks for. Where rows between
bodies depend only nearly, as they do with a gap left in the corner, forces stay in the rows of the
state. The next step starts with the force in the rows of its state (`own`).
"""

from dataclasses import dataclass, field

import numpy as np

from ..vectors import turned_left
from .acting import (BOTH, FIRST, FIRST_RUBS, NEITHER, NORMAL_OUT, RUBS, SECOND, SECOND_RUBS,
                     STANDING, TANGENTIAL_OUT, Acting)
from .beside import Beside, beside
from .law import law_at
from .sharing import alike, least_friction

MOST = 12  # changes of a corner's state in one step
AGAIN = 2  # changes after which it stands where both would press
NEAR = 1e-7  # penetration, relative to the deformation, for which no state is changed
TOUCHES = 1e-6  # distance from a side, relative to the deformation, that is none
SLIPS = 10 * TOUCHES  # slip that the errors of two steps do not make, likewise
NOISE = 10.0  # times the tolerance of displacements: slip of a corner beyond that counts
SLIGHT = 1e-9  # relative difference of gaps that counts as none
DEPENDENT = 1e-8  # determinant of two forces of about unit length that are one
ROUNDED = 1e-12  # part of a vertex' force that a side has by rounding: it bears nothing


@dataclass
class CornerNodes:
    """The states of all v corners, the same on every rank, and the rows of those the rank owns.

    `nodes` (v, 2) are contact nodes; `normal`, `tangential` (v, 2) positions in the rank's dual
    vectors, -1 where it owns none; `in_tangential` (v, 2) likewise in ContactRows.
    `alone` (v,): one condition acts at a time, see corner_pairs.py. `bilateral` (v, 2). `offset`
    (v, 2): friction forces that need no pressure. `gap` (v, 2): a corner starts with the side that
    is nearer, alike distances with both.
    """

    nodes: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray
    in_tangential: np.ndarray
    alone: np.ndarray
    bilateral: np.ndarray
    offset: np.ndarray
    gap: np.ndarray
    directions: np.ndarray  # (v, 2, 2) normals
    exact: np.ndarray  # (v,) rows depend exactly: the same force in others of them moves nothing
    beside: Beside | None  # where corners lie between bodies
    acting: np.ndarray = field(init=False)
    switches: np.ndarray = field(init=False)
    rested: np.ndarray = field(init=False)  # (v,) was in its corner at the end of the step before
    shifted: np.ndarray = field(init=False)  # (v,) obstacles that it may meet move in the step
    friction: np.ndarray = field(init=False)  # (v, 2) forces at the end of the step before

    def __post_init__(self):
        first, second = self.gap.T
        alike = np.abs(first - second) <= SLIGHT * np.abs(self.gap).max()
        nearer = np.where(alike, BOTH, np.where(first < second, FIRST, SECOND))
        self.acting = np.where(self.alone & (nearer == BOTH), FIRST,
                               np.where(self.bilateral.any(axis=1) & ~self.alone, BOTH, nearer))
        self.rested = np.zeros(len(self.nodes), bool)
        self.shifted = np.zeros(len(self.nodes), bool)
        self.friction = np.zeros((len(self.nodes), 2))
        self.begin_step()
        self.begin()

    def begin_step(self) -> None:
        """States may change again."""
        self.switches = np.zeros(len(self.nodes), int)
        self.undecided = np.zeros(len(self.nodes), bool)  # wrong states that do not change any more

    def begin(self) -> None:
        """A step begins: its corners are in these states."""
        self.began, self.reconsidered = self.acting, False

    def reconsider(self) -> None:
        """Corners that vertices have come to in this step, and stand in, are left again.

        They stand where nothing else was right, and for good. What worn and rough surfaces yield
        was not known then.
        """
        left = (self.acting == STANDING) & ~self.rested & (self.began != STANDING)
        self.acting = np.where(left, self.began, self.acting)
        self.switches[left] = 0
        self.reconsidered = bool(left.any())

    def carried(self) -> dict[str, np.ndarray]:
        """What goes on from step to step, for checkpoints."""
        return {"acting": self.acting, "rested": self.rested, "friction": self.friction}

    def restore(self, carried: dict[str, np.ndarray]) -> None:
        """Go on from what was `carried`."""
        self.acting, self.rested = carried["acting"], carried["rested"]
        self.friction = carried["friction"]

    @property
    def arriving(self) -> bool:
        """Whether a vertex may just have come to its corner."""
        return bool((np.isin(self.acting, [BOTH, STANDING, *RUBS]) & ~self.rested).any())

    @property
    def standing(self) -> np.ndarray:
        """Positions of the normal rows that are equations in the rank's dual vectors."""
        return self.normal[self.acting == STANDING].ravel()

    @property
    def _excluded(self) -> tuple[np.ndarray, np.ndarray]:
        """(v, 2) nodes whose normal rows, and whose tangential rows, are excluded."""
        return NORMAL_OUT[self.acting], TANGENTIAL_OUT[self.acting]

    @property
    def excluded(self) -> np.ndarray:
        """Positions of the excluded rows in the rank's dual vectors."""
        normal, tangential = self._excluded
        rows = np.concatenate([self.normal[normal], self.tangential[tangential]])
        return rows[rows >= 0]

    @property
    def without_friction(self) -> np.ndarray:
        """Positions of the excluded tangential rows among those of ContactRows."""
        rows = self.in_tangential[self._excluded[1]]
        return rows[rows >= 0]

    def act(self, count: int) -> np.ndarray:
        """(2, count) whether contact nodes have a normal, and a tangential row that acts."""
        acts = np.ones((2, count), bool)
        for of, excluded in zip(acts, self._excluded):
            of[self.nodes[excluded]] = False
        return acts

    def others(self) -> list[np.ndarray]:
        """Other states (v,) of all corners, one of which is changed to each of its own.

        Standing, which holds whatever friction can, before one side alone.
        """
        changed = []
        for state in (STANDING, *RUBS, FIRST, SECOND):
            able = ~self.exact if state in RUBS else True
            for v in np.flatnonzero((self.acting != state) & ~self.alone & able):
                changed.append(np.where(np.arange(len(self.acting)) == v, state, self.acting))
        return changed

    # ---- which state is right --------------------------------------------------------------------
    def switch(self, x: np.ndarray, gradient: np.ndarray, rows, scale: np.ndarray, tol: float,
               comm, deformation: np.ndarray) -> bool:
        """Whether a corner has changed its state at multipliers x, where F x - d is `gradient`.

        `rows` are the ContactRows, None without friction; `scale` (owned,) times displacements over
        `tol` count if they are more than NEAR, slip if it is more than SLIPS times `deformation`
        (owned,). Collective.
        """
        wanted = np.zeros(len(self.nodes), int)
        for v in np.flatnonzero(self.normal[:, 0] >= 0):
            n = self.normal[v]
            if self.acting[v] == STANDING:
                wanted[v] = self._stands(v, x, rows)
                continue
            near = max(tol, (NEAR * deformation[n] * scale[n]).max())
            wanted[v] = self._wanted(v, x[n], -gradient[n] * scale[n], near)
            if wanted[v] == self.acting[v] == BOTH:
                # friction on the way would have stopped it short of one side
                t, missed = self.tangential[v], np.zeros(2, bool)
                least = np.maximum(NOISE * tol / scale[t], SLIPS * deformation[t])
                parts = self._parts(v, self._force(v, x), -gradient[t], rows, least)
                if parts is not None and x[n].all():
                    missed = ~self._able(v, parts[0])
                wanted[v] = BOTH if missed.all() or not missed.any() else (
                    SECOND if missed[0] else FIRST)
        wanted = np.sum(comm.allgather(wanted), axis=0)
        again = (wanted == BOTH) & (self.acting != BOTH) & (self.switches >= AGAIN)
        wanted[again & ~self.alone] = STANDING
        wrong = wanted != self.acting
        changed = wrong & (self.switches < MOST)
        self.switches[changed] += 1
        self.undecided = wrong & ~changed
        self.acting = np.where(changed, wanted, self.acting)
        return bool(changed.any())

    def _stands(self, v: int, x: np.ndarray, rows) -> Acting:
        """State of a standing corner v: the side that would be left if both cannot hold it.

        Where rows depend only nearly forces stay in them: for a pull the other side must rub.
        """
        force = x[self.normal[v]]
        if not self.exact[v]:
            able = self._able(v, force)
            return STANDING if able.all() else FIRST_RUBS if able[0] else SECOND_RUBS
        if self._shared_at_rest(v, self._force(v, x), rows) is not None:
            return STANDING
        return FIRST if force[0] >= force[1] else SECOND

    def _wanted(self, v: int, force: np.ndarray, over: np.ndarray, tol: float) -> Acting:
        """State of corner v with normal forces (2,), at the movements (2,) beyond the gaps."""
        bilateral = self.bilateral[v]
        if self.acting[v] in (BOTH, *RUBS):
            opened = ~bilateral & (force == 0) & (over < -tol)
            if not opened.any():
                return self.acting[v]
            if opened.all():  # only what rubs without pressure matters
                if self._rubs_open(v):
                    return NEITHER
                opened = self.offset[v] < self.offset[v].max()
                return BOTH if not opened.any() and not self.offset[v].any() else (
                    SECOND if opened[0] else FIRST)
            return SECOND if opened[0] else FIRST
        if self.acting[v] == NEITHER:
            closed = over > tol
            return BOTH if closed.all() else NEITHER if not closed.any() else (
                FIRST if closed[0] else SECOND)
        own = 0 if self.acting[v] == FIRST else 1
        missed = over[1 - own]
        if (force[own] == 0 and over[own] < -tol and missed <= tol and self._rubs_open(v)
                and self.switches[v] < AGAIN):
            return NEITHER
        if max(missed, abs(missed) * bilateral[1 - own]) <= tol:
            return self.acting[v]
        if self.alone[v] or force[own] == 0 and not bilateral[own]:
            return SECOND if own == 0 else FIRST
        return BOTH

    def _rubs_open(self, v: int) -> bool:
        """Whether both sides of corner v rub without pressure."""
        return bool((self.offset[v] > 0).all() and (self.in_tangential[v] >= 0).all()
                    and not self.bilateral[v].any() and not self.alone[v])

    # ---- how forces are shared -------------------------------------------------------------------
    def end_step(self, x: np.ndarray, gradient: np.ndarray, rows, deformation: np.ndarray,
                 comm) -> tuple[np.ndarray, bool]:
        """Multipliers x shared by the vertices that touch both sides, and whether states change.

        `rows` are the ContactRows, None without friction; nearer than `deformation` (owned,)
        times TOUCHES is touching, slip by SLIPS times as much counts. Collective.
        """
        shared, inside = x.copy(), np.zeros(len(self.nodes), int)
        acting = np.zeros(len(self.nodes), int)
        near = None if self.beside is None else self.beside.forces(x, comm)
        for v in np.flatnonzero(self.normal[:, 0] >= 0):
            n, t = self.normal[v], self.tangential[v]
            acting[v] = self.acting[v]
            if self.alone[v] or (np.abs(gradient[n]) > TOUCHES * deformation[n]).any():
                continue
            force, inside[v] = self._force(v, x), 1
            if not self.exact[v]:
                continue
            parts = self._parts(v, force, -gradient[t], rows, SLIPS * deformation[t])
            if parts is None or not self._able(v, parts[0]).all():
                if near is not None and self.beside.known[v]:
                    parts = alike(force, self.directions[v], *self._law(v, rows),
                                  self.bilateral[v], near[v])
                else:
                    parts = self._shared_at_rest(v, force, rows)
            if parts is not None:
                parts = np.where(np.abs(parts) > ROUNDED * np.linalg.norm(force), parts, 0.0)
                shared[n], shared[t[t >= 0]] = parts[0], parts[1][t >= 0]
                acting[v] = self._state_of(v, force, rows)
        acting, inside = np.sum(comm.allgather((acting, inside)), axis=0)
        self.rested, before, self.acting = inside > 0, self.acting, acting
        rubs = np.where(self.tangential >= 0, np.append(shared, 0.0)[self.tangential], 0.0)
        self.friction = np.sum(comm.allgather(rubs), axis=0)
        return shared, not np.array_equal(before, acting)

    def own(self, x: np.ndarray) -> np.ndarray:
        """x with the same forces at the vertices in rows that their states leave free."""
        moved = x.copy()
        for v in np.flatnonzero((self.normal[:, 0] >= 0) & ~self.alone
                                & ~np.isin(self.acting, RUBS)):
            n, t, force = self.normal[v], self.tangential[v], self._force(v, x)
            if self.acting[v] == NEITHER:
                moved[n], moved[t] = 0.0, np.linalg.solve(self._tangents(v).T, force)
                continue
            if self.acting[v] in (BOTH, STANDING):
                moved[n], moved[t[t >= 0]] = np.linalg.solve(self.directions[v].T, force), 0.0
                continue
            k = 0 if self.acting[v] == FIRST else 1
            if not x[n[1 - k]]:  # nothing to move, and not by rounding either
                continue
            moved[n], moved[t[t >= 0]] = 0.0, 0.0
            moved[n[k]] = force @ self.directions[v, k]
            if t[k] >= 0:
                moved[t[k]] = force @ self._tangents(v)[k]
        return moved

    def _force(self, v: int, x: np.ndarray) -> np.ndarray:
        """(2,) force that the rows of corner v make up with multipliers x."""
        t = self.tangential[v]
        rubbing = np.where(t >= 0, x[t], 0.0)
        return x[self.normal[v]] @ self.directions[v] + rubbing @ self._tangents(v)

    def _tangents(self, v: int) -> np.ndarray:
        """(2, 2) tangents: the normals turned by +90 degrees."""
        return turned_left(self.directions[v])

    def _state_of(self, v: int, force: np.ndarray, rows) -> Acting:
        """The state that holds corner v, in touch with both sides, with a force (2,)."""
        pressures = np.linalg.solve(self.directions[v].T, force)
        if self._able(v, pressures).all():
            return BOTH
        (F, c), normal = self._law(v, rows), self.directions[v] @ force
        tangential = np.abs(self._tangents(v) @ force)
        alone = self._able(v, normal) & (tangential <= F * np.abs(normal) + c)
        alone &= ~self.bilateral[v][::-1]
        if alone.any():
            return FIRST if alone[0] else SECOND
        return STANDING

    def _able(self, v: int, pressures: np.ndarray) -> np.ndarray:
        """(2,) whether the nodes of corner v can have the `pressures`."""
        return self.bilateral[v] | (pressures >= 0)

    def _law(self, v: int, rows) -> np.ndarray:
        """(2, 2) coefficients and offsets of the friction bounds of corner v, 0 without friction.
        """
        return np.zeros((2, 2)) if rows is None else law_at(rows, self.in_tangential[v])

    def _shared_at_rest(self, v: int, force: np.ndarray, rows):
        """Pressures and friction forces (2,) each that hold corner v with `force` (2,), or None.

        With the least change of those forces if it has stayed, else with the least of them.
        """
        F, c = self._law(v, rows)
        before = self.friction[v] if self.rested[v] else np.zeros(2)
        return least_friction(force, self.directions[v], F, c, self.bilateral[v], before)

    def _parts(self, v: int, force: np.ndarray, slip: np.ndarray, rows, least):
        """Pressures and friction forces (2,) each of corner v under the force (2,) it arrives with.

        None where it has not arrived in this step, nor has an obstacle moved: no slip (2,)
        beyond `least`.
        """
        sign = np.where(np.abs(slip) > least, np.sign(slip), 0.0)
        rests = self.rested[v] and not self.shifted[v]
        if rows is None or rests or (self.tangential[v] < 0).any() or not sign.any():
            return None
        (F, c), normal, tangent = self._law(v, rows), self.directions[v], self._tangents(v)
        # contact that can pull does so as without friction
        side = np.where(self.bilateral[v], np.sign(np.linalg.solve(normal.T, force)), 1.0)
        rays = normal + (sign * F * side)[:, None] * tangent
        if abs(np.linalg.det(rays)) < DEPENDENT:
            return None
        pressures = np.linalg.solve(rays.T, force - (sign * c) @ tangent)
        if (self.bilateral[v] & (pressures * side < 0)).any():
            return None
        return pressures, sign * (F * np.abs(pressures) + c)


def corner_nodes(structure, in_tangential: np.ndarray, law) -> CornerNodes | None:
    """The corners of a Substructure; None, which costs nothing, where there are none.

    `in_tangential` (n_c,): places of tangential rows among the rank's, or -1; `law`: ContactLaw.
    """
    contact, (start, stop) = structure.contact, structure.row_range
    if not len(contact.corners):
        return None
    nodes, rank, exact = contact.corners[:, :2], contact.corners[:, 2], contact.corners[:, 3]
    normal, tangential = contact.normal_row[nodes], contact.tangential_row[nodes]

    def owned(rows: np.ndarray) -> np.ndarray:
        return np.where((rows >= start) & (rows < stop), rows - start, -1)

    return CornerNodes(nodes, owned(normal), owned(tangential), in_tangential[nodes], rank == 1,
                       law.bilateral[nodes], law_at(law, nodes)[1], contact.gap[nodes],
                       contact.normal[nodes], exact == 1,
                       beside(contact, nodes, owned) if contact.paired[nodes].any() else None)
