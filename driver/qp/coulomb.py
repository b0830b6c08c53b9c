"""The dense contact problem with friction on a few nodes: law, states, linear systems.

With the contact nodes' compliance C, x = (lambda_n, lambda_t) and movements d - C x = (over, slip):

    lambda_n >= 0,  over <= 0,  lambda_n over = 0,      |lambda_t| <= g = c + F lambda_n,
    slip >= 0 where lambda_t = g,  slip <= 0 where lambda_t = -g,  slip = 0 between.

The bound g is affine in the pressure: c = 0 is Coulomb's law, F = 0 that of given bounds, both
together that of Mohr and Coulomb. The offset c resists slip at open nodes, too.

In two dimensions this is piecewise linear: with every node open, sticking or sliding one way it is
a linear system (A. Klarbring, in: Contact Mechanics, Plenum 1995, on the 4^n states). Its map is
coercive and of degree one, so that for any F there is a solution, and an odd number of them unless
one sits on the border between states.

Bodies that no support holds add rigid motions beta as unknowns and equilibrium as equations,

    movements d + R beta - C x,      R'x = L,

with the motions R of the contact rows and the loads' work L on them; C is that of the bodies on
springs. Then there need be no solution, and the signs of several add up to nothing one knows. A
motion that no row with force or sticking feels stays as it is: the bodies may rest at many places.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import blas

from .equations import BACKWARD, FORWARD, OPEN, STICK
from .state_system import StateSystem

ROUNDING = 1e-9  # relative violation of the law that rounding of small dense systems may leave
ROUNDED = 1e-5  # part of any load that counts as a force: times ROUNDING that of rounding
JAMMED = 1e3  # times the forces of loads: larger ones count as if they were no larger
SLIGHT = 1e-9  # part of a motion's reach below which rows do not feel it


@dataclass
class CoulombProblem:
    """`compliance` (n + m, n + m) SPD, `load` d (n + m,), `coefficient` F (m,), pairs and offset.

    n nodes have a normal row and the m nodes `pair` (m,) of them a tangential one; `offset` c >= 0
    (m,), None: zero. `bilateral` (n,), or all alike: lambda_n of any sign and over = 0; the
    friction bound is c + F |lambda_n|. `motions` R (n + m, k) and `balance` L (k,) are of bodies
    without support. Solutions are vectors z = (lambda_n, lambda_t, beta) of n + m + k numbers.
    `depends`: movements of some rows are the same whatever the forces, as where three bodies meet.
    `latest`: what the latest systems are of, these, and a list of what is kept beside them, with
    friction that pressures bound or not, of all problems that `under` makes.
    `at_work`: called where a system has been factorized, which may take seconds.
    """

    compliance: np.ndarray
    load: np.ndarray
    coefficient: np.ndarray
    pair: np.ndarray
    bilateral: np.ndarray | bool = False
    motions: np.ndarray | None = None
    balance: np.ndarray | None = None
    offset: np.ndarray | None = None
    depends: bool = False
    latest: dict = field(default_factory=dict, repr=False)
    at_work: Callable[[], None] | None = None

    def __post_init__(self):
        self.rows, self.m = len(self.load), len(self.pair)
        self.n, self.products = self.rows - self.m, 0
        self.bilateral = np.broadcast_to(self.bilateral, self.n)
        self.rigidity = 1.0 / np.diag(self.compliance)  # force per length, the scale of rows
        self.augmentation = self.rigidity  # by which movements count in what states are to be
        if self.motions is None:
            self.motions, self.balance = np.zeros((self.rows, 0)), np.zeros(0)
        self.k = self.motions.shape[1]
        reach = np.abs(self.motions).max(axis=0, initial=0.0)
        self.reach = np.where(reach > 0, reach, 1.0)  # displacement by a unit motion
        self._set_offset(self.offset)

    def _set_offset(self, offset: np.ndarray | None) -> None:
        """Offsets of the friction bounds; None, which costs nothing, if they are zero."""
        self.offset = offset if offset is not None and offset.any() else None

    def under(self, load: np.ndarray, coefficient: np.ndarray, balance: np.ndarray | None = None,
              offset: np.ndarray | None = None) -> "CoulombProblem":
        """The same bodies under another `load` (n + m,), with other friction coefficients (m,).

        `balance` (k,) and `offset` (m,) stay those of this problem if they are not given.
        """
        other = object.__new__(CoulombProblem)  # as copy.copy would, but at once
        vars(other).update(vars(self))
        other.load, other.coefficient, other.products = load, coefficient, 0
        other.balance = self.balance if balance is None else balance
        if offset is not None:
            other._set_offset(offset)
        return other

    def softer(self, part: float) -> "CoulombProblem":
        """The same problem, in which movements count by `part` of the rigidity in `states`.

        The less they do, the more nodes stick before they slide back.
        """
        other = self.under(self.load, self.coefficient)
        other.augmentation = part * self.rigidity
        return other

    def whole(self, x: np.ndarray) -> np.ndarray:
        """z with the multipliers x (n + m,) and motions zero."""
        return np.append(x, np.zeros(self.k))

    def movement(self, z: np.ndarray) -> np.ndarray:
        """(n + m,) over and slip."""
        return self.moved(self.load, z)

    # ---- states --------------------------------------------------------------------------------
    def states(self, z: np.ndarray, movement: np.ndarray | None = None) -> np.ndarray:
        """(n,) states that the augmented multipliers x + augmentation * movement fall into."""
        movement = self.movement(z) if movement is None else movement
        trial = z[: self.rows] + self.augmentation * movement
        normal, tangential = trial[: self.n], trial[self.n :]
        touching = np.where((normal > 0) | self.bilateral, STICK, OPEN)
        bound = self.coefficient * np.abs(normal)[self.pair]
        if self.offset is not None:
            bound = self.offset + np.where(touching[self.pair] == OPEN, 0.0, bound)
        sliding = np.where(np.abs(tangential) < bound, STICK,
                           np.where(tangential > 0, FORWARD, BACKWARD))
        return self.joined(touching, sliding)

    def joined(self, touching: np.ndarray, sliding: np.ndarray) -> np.ndarray:
        """(n,) states by `touching` (n,), STICK or OPEN, overwritten, and `sliding` (m,)."""
        apart = OPEN if self.offset is None else np.where(self.offset > 0, -sliding, OPEN)
        touching[self.pair] = np.where(touching[self.pair] == OPEN, apart, sliding)
        return touching

    def states_of(self, x: np.ndarray, signs: np.ndarray) -> np.ndarray:
        """(n,) states by the multipliers x (n + m,) alone; signs (m,) where they slide, else 0."""
        touching = np.where((x[: self.n] > 0) | self.bilateral, STICK, OPEN)
        sliding = np.where(signs > 0, FORWARD, np.where(signs < 0, BACKWARD, STICK))
        return self.joined(touching, sliding)

    def states_by_forces(self, z: np.ndarray) -> np.ndarray:
        """(n,) states that the forces in z alone say; what nothing rubs slides, either way."""
        along, bound = z[self.n : self.rows], self.bounds(z)
        way = np.where(bound > 0, np.sign(along), 1.0)
        return self.states_of(z, np.where(np.abs(along) >= (1 - ROUNDING) * bound, way, 0.0))

    def on_bounds(self, z: np.ndarray, states: np.ndarray | None = None) -> np.ndarray:
        """z with the forces of open and sliding nodes exactly on the bounds of their states."""
        states, x = self.states(z) if states is None else states, z.copy()
        x[: self.n][states <= OPEN] = 0.0
        along, state = x[self.n : self.rows], np.abs(states[self.pair])
        bound = self.bounds(x)
        along[state == FORWARD] = bound[state == FORWARD]
        along[state == BACKWARD] = -bound[state == BACKWARD]
        along[state == OPEN] = 0.0
        return x

    @property
    def offsets(self) -> np.ndarray:
        """(m,) those of the friction bounds, also where they are zero."""
        return np.zeros(self.m) if self.offset is None else self.offset

    def bounds(self, z: np.ndarray) -> np.ndarray:
        """(m,) friction bounds of the forces lambda_n in z."""
        bound = self.coefficient * np.abs(z[self.pair])
        return bound if self.offset is None else self.offset + bound

    def choices(self, node: int) -> tuple[int, ...]:
        """The states that a node may be in."""
        where = np.flatnonzero(self.pair == node)
        states = (OPEN, STICK, FORWARD, BACKWARD) if len(where) else (OPEN, STICK)
        if self.offset is not None and (self.offset[where] > 0).any():
            states = (-STICK, -FORWARD, -BACKWARD, *states[1:])
        return tuple(state for state in states if state > OPEN) if self.bilateral[node] else states

    def signs(self, z: np.ndarray) -> np.ndarray:
        """(n,) signs of lambda_n, +1 in unilateral contact."""
        return np.where(self.bilateral & (z[: self.n] < 0), -1.0, 1.0)

    def held(self, states: np.ndarray) -> np.ndarray:
        """(k, h) orthonormal motions, by reach, that rows in contact or sticking feel."""
        if not self.k:
            return np.zeros((0, 0))
        acts = np.concatenate([states > OPEN, np.abs(states[self.pair]) == STICK])
        _, sizes, basis = np.linalg.svd(self.motions[acts] / self.reach, full_matrices=False)
        return basis[sizes > SLIGHT].T

    # ---- linear systems ------------------------------------------------------------------------
    def system(self, states: np.ndarray, sign: np.ndarray) -> StateSystem:
        """The linear system of the given states, with lambda_n of the given signs."""
        parts = (states, sign, self.coefficient, self.offset)
        key = b"".join(part.tobytes() for part in parts if part is not None)
        if self.latest.get(self.rubs, (None,))[0] != key:
            self.latest.pop(self.rubs, None)  # its factors make room first
            self.latest[self.rubs] = key, StateSystem(self, states, sign), []
            if self.at_work is not None:
                self.at_work()
        return self.latest[self.rubs][1]

    @property
    def rubs(self) -> bool:
        """Whether pressures bound friction: where bounds are given systems are others."""
        return bool(self.coefficient.any())

    def solution_in(self, states: np.ndarray, sign: np.ndarray | None = None) -> np.ndarray | None:
        """z of the linear system of `states`, exactly in them; None if it is singular."""
        sign = np.ones(self.n) if sign is None else sign
        return self.system(states, sign).solve(self.load, self.balance)

    def correction_in(self, states: np.ndarray, sign: np.ndarray, z: np.ndarray,
                      movement: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Change of z that solves the law in `states`, and the movement (n + m,) after it.

        `movement` is that at z. Digits are those of the change. None if the system is singular.
        """
        placed = self.on_bounds(z, states) - z
        left, x = self.moved(movement, placed), (z + placed)[: self.rows]
        change = self.system(states, sign).correction(left, self.balance - self.motions.T @ x)
        return None if change is None else (placed + change, self.moved(left, change))

    def moved(self, movement: np.ndarray, change: np.ndarray) -> np.ndarray:
        """`movement` (n + m,) after a change of z."""
        self.products += 1
        if self.rows:  # half of the symmetric matrix is read
            movement = blas.dsymv(-1.0, self.compliance.T, change[: self.rows], 1.0, movement)
        return movement + self.motions @ change[self.rows :] if self.k else movement

    # ---- the law -------------------------------------------------------------------------------
    def scale(self, x: np.ndarray) -> float:
        """The largest force of multipliers x (n + m,), of overlaps that the load alone would make,
        and of motions.

        Openings may be of any size and take no force: they count by what their rounding is worth.
        So do forces beyond JAMMED times those of loads: with much friction bodies may jam under
        any.
        """
        work = np.abs(self.balance / self.reach).max(initial=0)
        overlap = self.load[: self.n]
        overlap = np.where(self.bilateral, np.abs(overlap), np.maximum(overlap, 0.0))
        load = max((self.rigidity[: self.n] * overlap).max(initial=0),
                   ROUNDED * np.abs(self.rigidity * self.load).max(initial=0))
        load = max(load, work)
        force = np.abs(x).max(initial=0)
        return float(max(min(force, JAMMED * load) if load > 0 else force, load))

    def violation(self, z: np.ndarray, move: np.ndarray | None = None) -> float:
        """Violation of the law at z, relative to `scale`; inf for NaN.

        `move` (n + m,) is the movement at z, if known. Balance is relative to what acts on motions,
        if that is less: the lips of a slit may press one another by any force, of which the body
        that lies loose feels nothing. Where nothing loads such bodies, what acts may be rounding.
        """
        x, move = z[: self.rows], self.movement(z) if move is None else move
        force = self.scale(x)
        if not np.isfinite(force) or force == 0:
            return 0.0 if force == 0 else np.inf
        normal, tangential = x[: self.n], x[self.n :]
        forces = self.rigidity * move
        over, slip = forces[: self.n], forces[self.n :]
        bound = self.bounds(x)
        natural = np.where(self.bilateral, over, normal - np.maximum(normal + over, 0))
        rub = tangential - np.clip(tangential + slip, -bound, bound)
        net = np.abs(self.balance - self.motions.T @ x) / self.reach
        acting = (np.abs(self.balance) + np.abs(self.motions).T @ np.abs(x)) / self.reach
        least = 0.0 if self.balance.any() else ROUNDED * force
        acting = np.clip(acting.max(initial=0), least, force)
        return float(max(np.abs(natural).max(initial=0) / force, np.abs(rub).max(initial=0) / force,
                         net.max(initial=0) / acting))

    def solves(self, z: np.ndarray | None) -> bool:
        """Whether z obeys the law to rounding."""
        return z is not None and self.violation(z) <= ROUNDING

    def on_springs(self, softness: float, rest: np.ndarray) -> "CoulombProblem":
        """The bodies on springs of compliance `softness` per unit reach, at rest at `rest` (k,)."""
        turned = softness * self.motions / self.reach**2
        return CoulombProblem(self.compliance + turned @ self.motions.T,
                              self.load + self.motions @ rest + turned @ self.balance,
                              self.coefficient, self.pair, self.bilateral, offset=self.offset,
                              at_work=self.at_work)

    def sprung(self, softness: float, rest: np.ndarray, x: np.ndarray) -> np.ndarray:
        """(k,) where the bodies `on_springs` are under the forces x (n + m,)."""
        return rest + softness * (self.balance - self.motions.T @ x) / self.reach**2

    def along_springs(self, start: np.ndarray, softnesses, method):
        """z of the bodies on springs of one after the other of the `softnesses`, whose rest follows
        them from `start` z: by `method` (problem, x). None, and no more, where that finds none.
        """
        x, rest = start[: self.rows], start[self.rows :]
        for softness in softnesses:
            x = method(self.on_springs(softness, rest), x)
            if x is None:
                yield None
                return
            rest = self.sprung(softness, rest, x)
            yield np.append(x, rest)
