"""Bodies without support: can contact hold them, and how do they move where it cannot yet?

No macro declares them: a scene has them where its supports leave a body a rigid motion. The motion
is found by the proximal point method: springs hold the bodies (see feti), and their rest position
moves by what they carry in every iteration of the friction bound until they carry nothing.
"""

import functools

import numpy as np
from scipy.linalg import block_diag

from ..contact.equilibrium import Latest, rigid_equilibrium, still_balances
from ..contact.kkt import FADED, Scales
from ..contact.rows import ContactRows
from ..errors import NoSolution
from ..feti import free_motions
from ..qp.anderson import Anderson
from ..qp.least_distance import least_distance
from ..text import step_name

SECANTS = 5  # of the rigid motions' response that are combined
BESIDE = 1e-2  # part of all contact forces on a body beside which its imbalance counts at least
WEAK = 1e-4  # part of a motion that rows feel, whose square resists it: below all tolerances
NOTHING = 1e-12  # part of the largest contact force that is rounding of it
SLIGHT = 1e-9  # part of a friction bound by which rounding leaves what slid below it
LOOSE = "neither contact nor sticking friction prevents a rigid motion of a body without support"


class FreeBodies:
    """Rigid motions of the bodies that no support holds; supported.py has the same interface.

    Collective.
    """

    def __init__(self, operator, rows: ContactRows, effects, scales: Scales, history):
        """`history.warnings` get a line where a motion stays undetermined."""
        self.operator, self.rows, self.effects, self.scales = operator, rows, effects, scales
        self.history = history
        # (bodies, 3) rigid part of the displacements at the end of the last step
        self.placed = np.zeros((len(operator.structure.travel.bodies.size), 3))
        self._latest = Latest()

    def can_rest(self, index: int, weights: np.ndarray,
                 last: np.ndarray | None = None) -> np.ndarray:
        """Rigid motion (modes,) that closes gaps until contact balances the loads `weights`.

        Zero where forces near the `last` multipliers (owned,), if given, do so. Raises NoSolution
        if nothing balances them.
        """
        op = self.operator
        work, size = op.imbalance(np.zeros(op.owned), weights)
        motions = np.column_stack(op.motions)
        if last is not None and still_balances(self.rows, motions, work, size, last, op.comm):
            return np.zeros(len(work))
        motion = rigid_equilibrium(self.rows, motions, work, size, op.comm, self._latest)
        if motion is None:
            raise NoSolution(f"{step_name(index)}: {self._why_no_rest(index, work)}")
        return motion

    @staticmethod
    def _names(modes) -> str:
        """The bodies of some rigid modes."""
        bodies = sorted({mode.body + 1 for mode in modes})
        return f"{'body' if len(bodies) == 1 else 'bodies'} {', '.join(map(str, bodies))}"

    def why_unbalanced(self, load, x: np.ndarray) -> str:
        """Why bodies do not rest in any state of contact and friction although rigid ones could."""
        shares, modes = self._shares(load, x), self.operator.structure.rigid_modes
        worst = [mode for mode, share in zip(modes, shares) if share > 0.1 * shares.max()]
        return ("no equilibrium was found: contact and friction could hold rigid bodies, but with "
                f"the contact pressures of these bodies {100 * shares.max():.3g} % of the forces "
                f"on {self._names(worst)}, which no support holds, remain unbalanced: "
                f"{self._way(load, x, modes[int(shares.argmax())].body)}")

    def _way(self, load, x: np.ndarray, body: int) -> str:
        """Where the unbalanced forces drive a body."""
        structure = self.operator.structure
        net, _ = self.operator.imbalance(x, load.weights)
        own = [(force, mode) for force, mode in zip(net, structure.rigid_modes)
               if mode.body == body]
        along = sum(force * mode.translation for force, mode in own)
        turn = abs(sum(force * mode.rotation for force, mode in own))
        way = np.linalg.norm(along)
        if way < turn * structure.travel.bodies.size[body]:
            return f"body {body + 1} is free to turn"
        return (f"body {body + 1} is free to move off in the direction "
                "({:.2g}, {:.2g})".format(*((along / way).round(6) + 0.0)))

    def _why_no_rest(self, index: int, work: np.ndarray) -> str:
        """`work` (modes,) of the loads on the rigid motions."""
        modes = self.operator.structure.rigid_modes
        how = "contact cannot" if self.effects.contact else "without contact nothing can"
        if self.effects.frictional:
            how = "contact and friction cannot" if index else "contact without friction cannot"
        return (f"no equilibrium: {how} balance the loads on {self._names(modes)}"
                f"{_sum(modes, work)}, which no support holds: it slides off, tips over or is "
                "pulled away; add supports or friction")

    def follow(self, load, x: np.ndarray) -> np.ndarray:
        """Rigid motions follow what their springs still carry; d with them.

        Returns the change of d.
        """
        net, _ = self.operator.imbalance(x, load.weights)
        return self.shift(load, self.operator.rho * net)

    @staticmethod
    def secants() -> Anderson:
        """What `lead` combines over the iterations of one step."""
        return Anderson(np.dot, SECANTS, 1.0, 0.01)

    def lead(self, load, x: np.ndarray, secants: Anderson) -> np.ndarray:
        """As `follow`, with Anderson acceleration: springs ignore how bodies hold one another."""
        net, _ = self.operator.imbalance(x, load.weights)
        unit, motion = np.sqrt(self.operator.rho), self.place(load)
        return self.bring(load, unit * secants.next(motion / unit, motion / unit + unit * net))

    def shift(self, load, change: np.ndarray) -> np.ndarray:
        """Move by `change` (modes,); d with it. Returns the change of d."""
        return load.move(self.operator.motions, change)

    def place(self, load) -> np.ndarray:
        """(modes,) how far bodies have moved, to `bring` them back to."""
        return load.weights[self.operator.structure.patterns :].copy()

    def bring(self, load, place: np.ndarray) -> np.ndarray:
        """Move to a `place` (modes,); d with it. Returns the change of d."""
        return self.shift(load, place - self.place(load))

    def imbalance(self, load, x: np.ndarray) -> float:
        """Largest spring force of the rigid motions relative to the forces on them."""
        return float(self._shares(load, x).max())

    def _shares(self, load, x: np.ndarray) -> np.ndarray:
        """(modes,) the same of every motion.

        Relative to the forces on any motion of the body, which are of one size at its corners: a
        block that only its weight acts on has nothing but rounding along the floor. A body with
        supports in the other directions may have none at all on its free motions.
        """
        op = self.operator
        net, size = op.imbalance(x, load.weights)
        body = [mode.body for mode in op.structure.rigid_modes]
        largest = np.zeros(max(body) + 1)
        np.maximum.at(largest, body, size)
        for number, touched in self._touched.items():
            largest[number] = max(largest[number], BESIDE * op.dot(touched, np.abs(x)))
        self.scales.renew(work=largest[body])
        work = self.scales.work
        return np.abs(net) / np.where(work > 0, work, 1.0)

    @functools.cached_property
    def _touched(self) -> dict[int, np.ndarray]:
        """By body the work (owned,) of unit contact forces on its translations, in any direction.

        Of bodies whose supports leave them less than all motions.
        """
        op, modes = self.operator, self.operator.structure.rigid_modes
        bodies = [mode.body for mode in modes]
        return {number: free_motions.touched(
                    op.structure, op.classes, op.vectors,
                    [mode for mode in modes if mode.body == number])
                for number in sorted(set(bodies)) if bodies.count(number) < 3}

    # ---- what contact and friction leave undetermined -------------------------------------------
    def settle(self, load, x: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Move bodies as little over the step as its forces allow; returns the change of d.

        Among the rigid motions with the same forces the one of least int |u - u_0|^2 is taken, u_0
        the displacements at the end of the step before: contact that presses and nodes that stick
        stay where they are, open ones apart, and nodes slide on in their direction or not at all.
        It depends on no cut, start or number of ranks. Motions that rows hardly feel count as free
        (a polygon in a polygon hardly resists turning): multipliers may have to follow. Collective.
        """
        op, parts = self.operator, self.operator.rigid_parts
        placed = (parts.coefficients(op.deformations(x, load.weights, refined=op.uneven))
                  + op.structure.travel.of(load.weights))
        turn, gram, whiten = self._measure
        aim = -whiten.T @ turn.T @ gram @ (placed - self.placed).ravel()
        rows = op.comm.gather(self._conditions(x, gradient))
        change = np.zeros(op.modes)
        if op.comm.rank == 0:
            place, held, beside, limited, room = (np.concatenate(part) for part in zip(*rows))
            held, order = held[np.argsort(place)], np.argsort(beside)
            limited, room = limited[order], room[order]
            change = whiten @ _least(held @ whiten, limited @ whiten, room, aim)
        change = op.comm.bcast(change)
        self.placed = placed + (turn @ change).reshape(placed.shape)
        return self.shift(load, change)

    def leave(self, load, gradient: np.ndarray) -> np.ndarray:
        """Move bodies, as little as possible, out of all that they are in; returns the change of d.

        `gradient` is that at the state. None move where no motion clears all. Collective.
        """
        op, whiten = self.operator, self._measure[2]  # which all ranks make together
        normal = np.column_stack(op.motions)[self.rows.normal]
        place = self.rows.normal + op.structure.row_range[0]
        rows = op.comm.gather((place, normal, gradient[self.rows.normal]))
        change = np.zeros(op.modes)
        if op.comm.rank == 0:
            place, normal, room = (np.concatenate(part) for part in zip(*rows))
            order = np.argsort(place)
            moved = least_distance(normal[order] @ whiten, room[order])
            if moved is not None:
                change = whiten @ moved
        return self.shift(load, op.comm.bcast(change))

    @functools.cached_property
    def _measure(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Motions of bodies by the free ones, their gram matrix, and free motions of which |z|^2
        is the square of int |motion|^2, in columns.
        """
        parts = self.operator.rigid_parts
        turn = free_motions.of_bodies(parts.bodies, self.operator.structure.rigid_modes)
        gram = block_diag(*parts.gram)
        return turn, gram, np.linalg.inv(np.linalg.cholesky(turn.T @ gram @ turn)).T

    def _conditions(self, x: np.ndarray, gradient: np.ndarray):
        """What rigid motions do at the rank's contact rows: (h, modes) at those that may not move,
        (m, modes) at those that may move by no more than (m,).

        Before either come the places of these rows in an order that ranks do not change.
        """
        rows, motions = self.rows, np.column_stack(self.operator.motions)
        normal, rub = motions[rows.normal], motions[rows.tangential]
        over, slip = -gradient[rows.normal], -gradient[rows.tangential]
        bound, way = rows.friction_bound(x), np.sign(x[rows.tangential])
        presses = self._presses(x)
        rubs = self._counts(rows.tangential, bound)
        sticks = rubs & (np.abs(x[rows.tangential]) < (1 - SLIGHT) * bound)
        slides = rubs & ~sticks
        # all normal rows, then all tangential ones
        structure = self.operator.structure
        first = rows.normal + structure.row_range[0]
        then = rows.tangential + structure.row_range[0] + structure.dual_dofs
        return (np.concatenate([first[presses], then[sticks]]),
                np.concatenate([normal[presses], rub[sticks]]),
                np.concatenate([first[~presses], then[slides]]),
                np.concatenate([normal[~presses], -way[slides, None] * rub[slides]]),
                np.maximum(np.concatenate([-over[~presses], (way * slip)[slides]]), 0.0))

    def _presses(self, x: np.ndarray) -> np.ndarray:
        """(n,) whether normal rows act: their forces, if any, are more than rounding and than what
        the balance leaves open; collective.
        """
        force = np.abs(x[self.rows.normal])
        largest = -self.operator.minimum(-force.max(initial=0.0))
        return self.rows.bilateral | (force > NOTHING * largest) & self._counts(
            self.rows.normal, force)

    def _counts(self, rows: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(n,) whether forces >= 0 on such rows are more to a body than its balance leaves open.

        Relative to all forces on the body: of one that the others have left alone solvers leave
        some at nodes here or there, by which it would rest on one cut and not on another.
        """
        felt = np.abs(np.column_stack(self.operator.motions)[rows]) * force[:, None]
        return (felt > FADED * self.scales.work).any(axis=1)

    def note_loose_motion(self, index: int, x: np.ndarray) -> None:
        """Warn once if no node that touches or sticks holds a rigid motion.

        Such a body is in equilibrium at many places. The motion leaves no row that acts, or only
        those of zero. Where friction changes with slip in any row, it may hold what slides.
        """
        op, rows = self.operator, self.rows
        if any(LOOSE in line for line in self.history.warnings):
            return
        motions, acts = np.column_stack(op.motions), np.zeros(op.owned)
        acts[rows.normal] = self._presses(x)
        bound, changes = rows.friction_bound(x), self.effects.coefficient_changes
        acts[rows.tangential] = self._counts(rows.tangential, bound) & (
            (np.abs(x[rows.tangential]) < (1 - SLIGHT) * bound) | changes)
        stiffness = np.array([op.vectors.dots(motions, (acts * a)[:, None]) for a in motions.T])
        # squares of roundings
        largest = op.vectors.dots(motions, motions).max()
        if np.linalg.eigvalsh(stiffness)[0] <= 1e-12 * largest:
            self.history.warnings.append(
                f"{step_name(index)}: {LOOSE}; its displacements are one of many solutions")


def _least(held: np.ndarray, limited: np.ndarray, room: np.ndarray,
           aim: np.ndarray) -> np.ndarray:
    """z (modes,) nearest to `aim` with `held` z = 0 and `limited` z <= `room`, none negative."""
    reach = np.abs(np.vstack([held, limited])).max(initial=0.0)
    _, sizes, basis = np.linalg.svd(np.linalg.qr(held, "r"))
    free = basis[np.count_nonzero(sizes > WEAK * reach * np.sqrt(len(held) + 1)) :]
    aim, limited = free @ aim, limited @ free.T
    # what `held` keeps in place also leaves rounding of rows, of either sign, that would be limits
    limited = np.where(np.abs(limited).max(axis=1, keepdims=True, initial=0.0)
                       > free_motions.STILL * reach, limited, 0.0)
    moved = least_distance(limited, room - limited @ aim)
    # no motion at all is feasible, but for rounding
    return free.T @ (np.zeros(len(aim)) if moved is None else aim + moved)


def _sum(modes, work: np.ndarray) -> str:
    """The loads' resultant on one body, as far as it may shift; `work` (modes,) of the loads."""
    shifts = [(force, mode.translation) for force, mode in zip(work, modes) if not mode.rotation]
    if len({mode.body for mode in modes}) > 1 or not shifts:
        return ""
    force = sum(size * along / np.linalg.norm(along) ** 2 for size, along in shifts)
    rounded = np.round(force / max(np.abs(force).max(), np.finfo(float).tiny), 6)
    return " ({:.4g}, {:.4g})".format(*(rounded * np.abs(force).max() + 0.0))
