"""Stage 6, bodies without support: can contact hold them, and the rigid motion that follows what it cannot yet.

The motion is found by the proximal point method: springs hold the bodies (see feti/free_motions.py), and their rest moves by what
they carry in every iteration of the friction bound until they carry nothing.
"""

import numpy as np

from ..contact.equilibrium import rigid_equilibrium
from ..errors import NoSolution
from ..feti.dual_problem import DualProblem
from ..contact.friction import ContactRows, Scales
from .globalization import Anderson
from .step import History, Load

SECANTS = 5  # of the rigid motions' response that are combined
LOOSE = "nothing that touches or sticks holds a rigid motion of a body without support"


class FreeBodies:
    """Rigid motions of the bodies that no support holds; none of it does anything without such bodies. Collective."""

    def __init__(self, operator: DualProblem, rows: ContactRows, effects: dict, scales: Scales, history: History):
        self.operator, self.rows, self.effects, self.scales, self.history = operator, rows, effects, scales, history

    @property
    def _motions(self) -> list[np.ndarray]:
        """Displacements of the rank's dual rows under every rigid motion."""
        return self.operator.motions

    def can_rest(self, index: int, weights: np.ndarray) -> np.ndarray | None:
        """Rigid motion that closes gaps until contact balances the loads `weights`; None, noted, if nothing does.

        Raises NoSolution in the first step, before which there is nothing to keep.
        """
        op = self.operator
        if not op.modes:
            return np.zeros(0)
        work, size = op.imbalance(np.zeros(op.owned), weights)
        found = rigid_equilibrium(self.rows, np.column_stack(self._motions), work, size, op.comm)
        if found is None:
            self.history.end(3, f"step {index}: {self._why_no_rest()}")
            if index == 1:
                raise NoSolution(self.history.reason)
        return found

    def _names(self, modes) -> str:
        """The bodies of some rigid modes."""
        bodies = sorted({mode.body + 1 for mode in modes})
        return f"{'body' if len(bodies) == 1 else 'bodies'} {', '.join(map(str, bodies))}"

    def why_unbalanced(self, load: Load, x: np.ndarray) -> str:
        """Why no state of contact and friction was found in which the bodies rest, although rigid ones could."""
        shares, modes = self._shares(load, x), self.operator.structure.rigid_modes
        worst = [mode for mode, share in zip(modes, shares) if share > 0.1 * shares.max()]
        return (f"no equilibrium was found: contact and friction could hold rigid bodies, but where these ones press and "
                f"rub, {100 * shares.max():.2g} % of the forces on {self._names(worst)}, which no support holds, stay "
                "unbalanced")

    def _why_no_rest(self) -> str:
        modes = self.operator.structure.rigid_modes
        how = {"none": "without contact nothing can", "unilateral": "contact cannot", "bilateral": "contact cannot"}[
            self.effects["contact"]]
        if self.effects["friction"] != "none":
            how = "contact and friction cannot"
        return (f"no equilibrium: {how} balance the loads on {self._names(modes)}, which no support holds: it slides off, "
                "tips over or is pulled away; add supports or friction")

    def follow(self, load: Load, x: np.ndarray) -> np.ndarray:
        """Rigid motions follow what their springs still carry; d with them. Returns the change of d."""
        net, _ = self.operator.imbalance(x, load.weights)
        return self.shift(load, self.operator.rho * net)

    def secants(self) -> Anderson:
        """What `lead` combines over the iterations of one step."""
        return Anderson(np.dot, SECANTS, 1.0, 0.01)

    def lead(self, load: Load, x: np.ndarray, secants: Anderson) -> np.ndarray:
        """As `follow`, with Anderson acceleration: as springs know nothing of how contact holds bodies on one another."""
        net, _ = self.operator.imbalance(x, load.weights)
        unit, motion = np.sqrt(self.operator.rho), load.weights[self.operator.structure.patterns :]
        return self.shift(load, unit * secants.next(motion / unit, motion / unit + unit * net) - motion)

    def shift(self, load: Load, change: np.ndarray) -> np.ndarray:
        """Move by `change` (modes,); d with it. Returns the change of d."""
        load.weights[self.operator.structure.patterns :] += change
        moved = sum((factor * d for factor, d in zip(change, self._motions)), np.zeros(self.operator.owned))
        load.d += moved
        return moved

    def imbalance(self, load: Load, x: np.ndarray, note: bool = False) -> float:
        """Largest force that rigid motions leave to their springs, relative to the largest forces at work so far.

        `note`: those of this state count from now on.
        """
        if not self.operator.modes:
            return 0.0
        return float(self._shares(load, x, note).max())

    def _shares(self, load: Load, x: np.ndarray, note: bool = False) -> np.ndarray:
        """(modes,) the same of every motion."""
        net, size = self.operator.imbalance(x, load.weights)
        work = np.maximum(self.scales.work, size)
        self.scales.work = work if note else self.scales.work
        return np.abs(net) / np.where(work > 0, work, 1.0)

    def note_loose_motion(self, index: int, x: np.ndarray) -> None:
        """Say it once if nothing that touches or sticks holds a rigid motion of a body without support.

        Such a body is in equilibrium at many places. The motion leaves no row that acts, or only those of zero.
        """
        op, rows = self.operator, self.rows
        if not op.modes or self.history.exit_status or any(LOOSE in line for line in self.history.warnings):
            return
        motions = self._motions
        acts = np.zeros(op.owned)
        acts[rows.normal] = rows.bilateral | (x[rows.normal] != 0)
        acts[rows.tangential] = np.abs(x[rows.tangential]) < rows.friction_bound(x)
        held = np.array([[op.dot(acts * a, b) for b in motions] for a in motions])
        if np.linalg.eigvalsh(held)[0] <= 1e-12 * max(op.dot(d, d) for d in motions):  # squares of roundings
            self.history.warnings.append(f"step {index}: {LOOSE}, and displacements are one answer of many")
