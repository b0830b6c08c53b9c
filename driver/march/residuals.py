"""Residuals of a time step: whether a state is a solution to the accuracy that was asked for."""

import numpy as np
from mpi4py import MPI

from ..contact.kkt import FADED, kkt_residuals
from ..qp.box import projected_gradient
from .condensation import Condensation
from .friction_qp import FrictionQP
from .slip import SlipState
from .step import Load

CANCELLED = 1e-8  # part of the extent below which deformation is rounding: contact takes the loads
ROUNDINGS = 4.0  # times what one product rounds off on a row: others may round off as much
TRAVELLED = 1e-9  # part of what bodies move as a whole, likewise
WAY_ROUNDED = 64 * np.finfo(float).eps  # part of what they move that rows may be off by


class Residuals:
    """Those of states of one problem. Collective over the operator's communicator."""

    def __init__(self, qp: FrictionQP, bodies, slip: SlipState, condensation: Condensation):
        """`bodies`: FreeBodies of free_bodies.py, or SupportedBodies."""
        self.qp, self.bodies, self.slip, self.condensation = qp, bodies, slip, condensation
        self.operator, self.rows, self.scales = qp.operator, qp.rows, qp.scales
        contact = np.ones(self.operator.owned)
        contact[self.rows.gluing] = 0.0
        self.contact, self.still = contact, False

    def asked(self, name: str) -> float:
        """The largest residual of this name with which a step has converged."""
        return getattr(self.qp.settings, self.option(name))

    @staticmethod
    def option(name: str) -> str:
        """The option that limits the residual of this name."""
        return "friction_rtol" if name == "equilibrium" else "primal_rtol"

    def enough(self, residuals: dict) -> bool:
        """Whether all residuals are as small as asked for."""
        return all(value <= self.asked(name) for name, value in residuals.items())

    def excess(self, residuals: dict) -> dict[str, float]:
        """Residuals by name, over those with which a step has converged."""
        return {name: value / self.asked(name) for name, value in residuals.items()}

    def faded(self, x: np.ndarray) -> bool:
        """Whether contact forces, or where nothing presses all forces, may be rounding, not zero.

        By their size, or because nothing deformed in the latest state: bodies moved.
        """
        # an upper bound where stiffness jumps: residuals judge the state without forces anyway
        least = max(self.scales.faded("pressing"), FADED * self.scales.d / self.qp.bound)
        size = self._size(x) or np.sqrt(self.operator.dot(x, x))
        return 0 < size and (self.still or size <= least)

    @property
    def least_forces(self) -> float:
        """Norm of contact forces below which they are rounding.

        Beside those of the steps before, or beside the least forces that make displacements of the
        size that is to be overcome: rows of B are scaled by `softest` at least.
        """
        return max(self.scales.faded("pressing"),
                   FADED * self.scales.d * self.qp.softest / self.qp.bound)

    def free_of_forces(self, load: Load, x: np.ndarray, motion: np.ndarray | None = None):
        """Multipliers, gradient, change from x and residuals of the state without any force.

        None if that is no solution. Bodies have moved by `motion` (modes,) in it, by default where
        they are, and from there out of what they are in. Forces that are all rounding settle
        nowhere: no step must fail for want of digits.
        """
        away = self.bodies.place(load)
        if motion is not None:
            self.bodies.bring(load, motion)
        x0, op = np.zeros_like(x), self.operator
        nothing = x0, op.gradient(x0, load) if op.uneven else -load.d
        known, still = vars(self.scales).copy(), self.still
        for leaves in (False, True)[: 1 + (op.modes > 0)]:
            if leaves:
                nothing = x0, nothing[1] - self.bodies.leave(load, nothing[1])
            residuals = self.of(load, *nothing)
            if self.enough(residuals):
                return *nothing, x, residuals
        # bodies that nothing stops go far: no scale for the state that is left
        vars(self.scales).update(known)
        self.still = still
        if motion is not None or op.modes:
            self.bodies.bring(load, away)
        return None

    def acts(self, x: np.ndarray) -> bool:
        """Whether x (owned,) has any multiplier that is not zero."""
        return self.operator.dot(x, x) > 0

    def _size(self, x: np.ndarray) -> float:
        """Norm of the contact forces in x."""
        return np.sqrt(self.operator.dot(self.contact * x, x))

    def of(self, load: Load, x: np.ndarray, gradient: np.ndarray,
           exact: bool = False) -> dict[str, float]:
        """KKT residuals of the state with multipliers x and their gradient.

        Relative to a lower bound of the deformation if they are small even so, to the deformation
        itself, which takes the fields of all subdomains, else. Where stiffness jumps, what products
        round off on stiff rows, measured, is no less than what is asked for, unless `exact`: terms
        of such products may be larger than their sum. Forces that are missing are missing, whatever
        rounding made them.
        """
        op, others = self.operator, {"stationarity": self._missing(load, x, gradient)}
        if op.modes:
            others["equilibrium"] = self.bodies.imbalance(load, x)
        missed, (nothing, least) = self._changing(x, gradient), self._least_deformation(load)
        # what decides whether a corner touches both sides must not depend on the cut
        whole = op.modes or op.jumps or self.rows.corners is not None
        quick = () if whole else (op.least_deformation,)
        for measure in (*quick, op.deformation_by_level):
            deformations = np.atleast_1d(measure(x, load.weights))
            self.still = deformations[0] <= nothing
            kkt = self._kkt(x, gradient, deformations, least, missed)
            if self.enough(kkt):
                break
        if not self.scales.pressing and not self.acts(x):
            # of displacements that nothing has to overcome the norm is rounding
            way = max(self.scales.d, self.qp.softest * self.scales.displacement)
            others["stationarity"] *= (self.scales.d or 1.0) / way if way > 0 else 1.0
        if op.levels > 1 and not exact and not self.enough(kkt):
            rounded = ROUNDINGS * self.qp.rounded_by_level(x)
            least[1:] = np.maximum(least[1:], rounded[1:] / self.asked("penetration"))
            kkt = self._kkt(x, gradient, deformations, least, missed)
        return others | kkt

    def _kkt(self, x, gradient, deformations: np.ndarray, least: np.ndarray,
             missed: float) -> dict[str, float]:
        """Residuals relative to `deformations` (levels,), no less than `least` (levels,)."""
        self.scales.renew(displacements=np.maximum(deformations, least))
        kkt = kkt_residuals(self.rows, x, gradient, self.operator.row_level, self.scales,
                            self.operator.comm)
        if self.scales.force > 0:
            kkt["cone"] = max(kkt["cone"], missed / self.scales.force)
        return kkt

    def _least_deformation(self, load: Load) -> tuple[float, np.ndarray]:
        """Deformation below which nothing deforms, and (levels,) that residuals are relative to.

        Of bodies that move far and hardly deform that is the one relative to which the last digits
        of their way are as large as residuals may be. Collective.
        """
        way = -self.operator.minimum(-max(load.travel, load.farthest))
        least = np.full(self.operator.levels, TRAVELLED * way)
        least[0] = max(least[0], CANCELLED * load.extent / self.qp.softest)
        rounded = WAY_ROUNDED * way / self.asked("penetration")
        return float(least[0]), np.maximum(least, rounded)

    def _changing(self, x: np.ndarray, gradient: np.ndarray) -> float:
        """By how much friction bounds miss those of the slip at x, a force; collective."""
        rows = self.rows
        if not self.slip.effects.coefficient_changes:
            return 0.0
        bound = rows.friction_bound(x)
        with rows.under(rows.coefficient, rows.offset):
            self.slip.renew_coefficient(gradient)
            missed = float(np.abs(rows.friction_bound(x) - bound).max(initial=0))
        return self.operator.comm.allreduce(missed, op=MPI.MAX)

    def _missing(self, load: Load, x: np.ndarray, gradient: np.ndarray) -> float:
        """Norm of the contact forces that are missing, over that of all.

        The inverse of F makes stiff parts of the body count by their stiffness. Contact forces that
        are nothing beside the body's count by FADED times these: its multipliers, and the least
        forces that make the displacements to be overcome. In a state without any contact force what
        it leaves out is relative to those of the steps before: by as much as they were asked for
        their own are unknown, and with them the slip that a later step starts from. Where nothing
        has pressed yet, gluing forces may be rounding as well (a body that expands freely); then,
        and without a preconditioner, it is the projected gradient relative to what the QP's
        tolerance is (or, without any force, to the deformation, see `of`).
        """
        op, qp, scales = self.operator, self.qp, self.scales
        projected = projected_gradient(x, gradient, *self.rows.limits(op.owned, x))
        own = self._size(x)
        scales.renew(pressing=own, forces=np.sqrt(op.dot(x, x)))
        missing = self._forces_to(load, x, gradient, projected) if scales.pressing > 0 else None
        if missing is None:
            return qp.size(projected) / (scales.d or 1.0)
        others = max(scales.forces, scales.largest.get("forces", 0.0), scales.d / qp.bound)
        whole = max(scales.pressing, FADED * others)
        if not own:
            whole = max(whole, scales.largest.get("pressing", 0.0))
        return self._size(missing) / whole

    def _forces_to(self, load: Load, x: np.ndarray, gradient: np.ndarray,
                   projected: np.ndarray) -> np.ndarray | None:
        """(owned,) multipliers, of contact rows at least, that would take the `projected` gradient.

        Where gluing rows have been eliminated those of a step of Newton's method. Else, or if its
        system is singular, those of the preconditioner; None without one.
        """
        if self.condensation.eliminated:
            correction = self.condensation.correction(load, x, gradient)
            if correction is not None:
                return correction
        preconditioner, limits = self.qp.accelerators.preconditioner, self.rows.limits(len(x), x)
        if preconditioner is None:
            return None
        # with the rows that would leave their bounds
        free = (x != limits[0]) & (x != limits[1]) | (projected != 0)
        return preconditioner(np.where(free, projected, 0.0), free)
