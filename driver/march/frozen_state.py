"""The state of contact in which a step has ended, frozen: a linear problem for other forces.

Open nodes stay open, closed ones closed, sticking ones stay where they are and sliding ones keep to
the friction bound. Solved by the contact rows alone where steps have eliminated the gluing rows
(frozen_system.py), else by conjugate gradients with the operator, the rows and the preconditioner
of the run, the coupling of Coulomb's law by repetition: ten to twenty-five products each.
"""

import numpy as np

from ..contact.states import OPEN, SLIP, STICK
from ..errors import NotConverged
from .frozen_system import FrozenSystem

TOLERANCE = 1e-3  # relative
ROUNDS, STILL = 6, 1e-3  # of Coulomb's coupling, and its change with which they end
LOOSE = 1e-6  # relative work of contact forces on a motion that nothing but springs resists


class FrozenState:
    """That of a `step` of a `solver` with the `operator` and `rows` of its run. Collective."""

    def __init__(self, operator, solver, step, status: np.ndarray, coupled: bool = True):
        """`status` (n_c,) of the contact nodes; `coupled`: whether friction of sliding nodes
        follows their pressure, else it stays what it is.
        """
        self.operator, self.solver, self.step, self.rows = operator, solver, step, solver.rows
        self._freeze(status)
        if not coupled:
            self.ratio = np.zeros_like(self.ratio)
        self.system = self._condensed()
        self.free = self._moved_freely()

    def under(self, forces: list[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
        """Multipliers (owned,) and displacements (dofs,) of the local subdomains under forces
        (dofs,) on these.
        """
        x = self._solve(self.operator.response_to(forces))
        multipliers, motion = self._balanced(x, forces)
        weights = np.concatenate([np.zeros(self.operator.structure.patterns), motion])
        return multipliers, self.operator.deformations(multipliers, weights, forces)

    def _freeze(self, status: np.ndarray) -> None:
        """Which rows stay free, and what friction follows pressure by."""
        rows, x = self.rows, self.step.multipliers
        self.lower, self.upper = np.full(len(x), -np.inf), np.full(len(x), np.inf)
        still = status[rows.tangential_node] == STICK
        for row in (rows.normal[status[rows.normal_node] == OPEN], rows.tangential[~still]):
            self.lower[row] = self.upper[row] = 0.0
        slides = status[rows.tangential_node] == SLIP
        self.ratio = np.zeros(len(rows.tangential))
        if rows.coefficient is not None:
            sign = np.sign(x[rows.tangential] * x[rows.pair])
            self.ratio[slides] = (rows.coefficient * sign)[slides]

    def _condensed(self) -> FrozenSystem | None:
        """That of the state on the contact rows, where steps have eliminated the gluing rows: not
        where the last one has but learnt that it pays, as it may not for these problems alone.
        """
        condensation, counts = self.solver.condensation, self.solver.history.counts
        if not condensation.eliminated or not counts["condensed_steps"]:
            return None
        try:
            return FrozenSystem(condensation, self.upper > 0, self.ratio)
        except NotConverged:
            return None

    def _moved_freely(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Multipliers (owned,) that rigid motions of free bodies take, and their work on these."""
        motions, dot = self.operator.motions, self.operator.dot
        taken = [self._solve(motion) for motion in motions]
        work = [[dot(motion, x) for x in taken] for motion in motions]
        return taken, np.array(work).reshape(len(motions), len(motions))

    def _balanced(self, x: np.ndarray, forces: list | None) -> tuple[np.ndarray, np.ndarray]:
        """Multipliers with which forces on free bodies balance, and motions (modes,) to them."""
        structure, operator = self.operator.structure, self.operator
        if not operator.modes:
            return x, np.zeros(0)
        work = np.zeros((structure.total, operator.modes))
        for k, mode in enumerate(structure.rigid_modes if forces is not None else ()):
            for sub, force, moved in zip(structure.subdomains, forces, mode.fields(structure)):
                work[sub.index, k] = force @ moved
        applied = np.sum(operator.comm.allgather(work), axis=0).sum(axis=0)
        missing = applied - [operator.dot(motion, x) for motion in operator.motions]
        taken, each = self.free
        motion = np.linalg.lstsq(each, missing, rcond=LOOSE)[0]
        return x + np.tensordot(motion, taken, axes=1), motion

    def _solve(self, moved: np.ndarray) -> np.ndarray:
        """Multipliers mu (owned,) that take displacements `moved` (owned,) off all free rows."""
        right, qp = self._followed(moved), self.solver.qp
        tolerance = TOLERANCE * qp.size(np.where(self.upper > 0, right, 0.0))
        if tolerance == 0:
            return np.zeros(len(moved))
        if self.system is not None:
            x = self.system.solution(moved)
            left = self._followed(self.operator.apply(x)) - right
            if qp.size(np.where(self.upper > 0, left, 0.0)) <= tolerance:
                return x
        x, coupling, gradient = np.zeros(len(moved)), 0.0, -right
        for _ in range(ROUNDS):
            x = qp.linear(right - coupling, (self.lower, self.upper), x, tolerance, gradient).x
            if not self._coupled:
                break
            product = self.operator.apply(x)
            before, coupling = coupling, self._followed(product) - product
            if qp.size(coupling - before) <= STILL * qp.size(right):
                break
            gradient = product - right + coupling
        return x

    @property
    def _coupled(self) -> bool:
        """Whether friction follows pressure anywhere."""
        return self.operator.comm.allreduce(int(self.ratio.any())) > 0

    def _followed(self, moved: np.ndarray) -> np.ndarray:
        """Displacements (owned,) of the rows along the forces: normal ones with what friction
        makes of them.
        """
        along = moved.copy()
        np.add.at(along, self.rows.pair, self.ratio * moved[self.rows.tangential])
        return along
