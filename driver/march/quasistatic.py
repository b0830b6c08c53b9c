"""Implicit time steps; in each the fixed point for local Coulomb friction around the QP.

Time step (Haslinger, Vlach, Dostal, SNA'07): with the previous tangential displacement v_T in the
functional, find (u, lambda) with lambda_n = Phi(lambda_n), where Phi(g) solves the contact problem
with given friction bound F g, the box-constrained QP

    min 1/2 lambda' F lambda - lambda' d,   lambda_n >= 0,  |lambda_t| <= F g.

Multipliers and g start from those of the previous iteration and the previous step. `friction_qp`
solves the QP, `fixed_point` finds lambda_n, free_bodies.py moves what no support holds;
`uniqueness` looks whether a step has other solutions.
"""

import time

import numpy as np
from mpi4py import MPI

from ..contact.kkt import Scales
from ..contact.rows import contact_rows
from ..effects import Effects
from ..environment import heed_lost_interrupt
from ..errors import DriverError, NotConverged
from ..feti.dual_problem import DualProblem
from ..options import Settings
from . import outlook
from .condensation import Condensation
from .corner_states import CornerStates
from .fixed_point import FixedPoint
from .friction_qp import FrictionQP
from .more_digits import MoreDigits
from .residuals import Residuals
from .slip import SlipState
from .step import History, Load, Step, StepFailed, Trace, Unfinished
from .supported import RigidSurfaces, SupportedBodies
from .tightening import Tightening
from .uniqueness import CHANGING, YIELDING, Uniqueness, too_many, worthwhile

SETTLINGS = 5  # of bodies without support, whose multipliers follow, in a step


class QuasistaticSolver:
    """Time steps of one problem. Collective over the operator's communicator."""

    def __init__(self, operator: DualProblem, effects: Effects, amplitudes: np.ndarray,
                 times: np.ndarray, settings: Settings, cycles=None):
        """`amplitudes` (steps + 1, patterns): factors of the load patterns at `times`.

        `cycles`: the Cycles of a history that is repeated; it brings more times by and by.
        """
        self.operator, self.settings, self.effects = operator, settings, effects
        self.amplitudes, self.times = amplitudes, times
        contact = operator.structure.contact
        effects.prepare(contact)
        # tangential displacement at time 0 (n_c,), and the pattern factors whose travel it holds
        self.initial = effects.initial_displacement(contact)
        self.initial_weights = np.zeros(operator.structure.patterns)
        self.history = History()
        self.scales = Scales(displacements=np.zeros(operator.levels))
        self.cycles = cycles
        self.more_digits = MoreDigits(self)
        self._attach()
        self.history.counts["dual_multiplications_setup"] = operator.products
        own = 0.0 if self.rows.bound_is_given else float(self.rows.coefficient.max(initial=0))
        self.largest_friction = operator.comm.allreduce(own, op=MPI.MAX)
        self.uniqueness = Uniqueness(self.largest_friction > 0,
                                     first_only=settings.uniqueness == "auto")
        self.doubtful = False
        self.loads = [self._size(index) for index in range(1, len(times))]
        # of the last step and of the one before: rigid motions (modes,), multipliers (owned,)
        self.motion = self.older_motion = np.zeros(operator.modes)
        self.multipliers = self.older = np.zeros(operator.owned)
        self.contraction = np.nan  # of the last step that tells
        # (k, 2) displacements of contact's vertices by deformation, where contact follows them
        self.deformed = np.zeros((0, 2))
        if cycles is not None:
            cycles.join(self)

    @property
    def total(self) -> int:
        """Steps of the whole history, with all cycles."""
        return len(self.times) - 1 if self.cycles is None else self.cycles.total

    def _attach(self, bound: float | None = None) -> None:
        """Make what solves steps with the operator's rows; `bound` as FrictionQP takes it."""
        operator = self.operator
        self.contact = operator.structure.contact
        self.law = self.effects.contact_law(self.contact)
        self.rows = contact_rows(operator.structure, self.law)
        self.junctions = self._junctions()
        self.solve = self.settled if self.junctions is None else self.junctions.settled
        self.slip = SlipState(operator, self.rows, self.effects, self.initial)
        self.qp = FrictionQP(operator, self.rows, self.settings, self.scales, self.history, bound)
        self.bodies = self._bodies()
        self.condensation = Condensation(operator, self.rows, self.junctions is not None)
        self.residuals = Residuals(self.qp, self.bodies, self.slip, self.condensation)
        self.fixed_point = FixedPoint(self.qp, self.bodies, self.slip, self.condensation)
        self.corners = self.fixed_point if self.rows.corners is None else (
            CornerStates(self.fixed_point, self.contact))
        self.closure = self._closure()

    def _bodies(self):
        """What bodies without support need, imported only where there are such bodies."""
        if not self.operator.modes:
            return SupportedBodies()
        from .free_bodies import FreeBodies

        return FreeBodies(self.operator, self.rows, self.effects, self.scales, self.history)

    def _junctions(self):
        """What shares the forces of junctions, imported only where bodies meet; None without any.
        """
        if not self.contact.declared.paired.any():
            return None
        from .junction_bounds import JunctionBounds
        from .junction_forces import junction_forces

        forces = junction_forces(self.operator.structure, self.rows, self.law, self.effects,
                                 self.operator.comm)
        return None if forces is None else JunctionBounds(self, forces)

    def _closure(self):
        """What laws of rough or worn surfaces need, imported only where there are such laws."""
        if not self.effects.closes:
            return RigidSurfaces()
        from .closure import Closure

        return Closure(self.qp, self.effects, self.residuals)

    def steps(self):
        """Generate the `Step`s after those in `history`. StepFailed where one has no solution."""
        clock = time.perf_counter()
        if self.history.steps == 0:
            self._start()
        while (index := self.history.steps + 1) < len(self.times):
            heed_lost_interrupt()
            step, error = self._advance(index)
            self.history.seconds += time.perf_counter() - clock
            if error is not None:
                raise StepFailed(error, step)
            yield step
            clock = time.perf_counter()

    def _start(self) -> None:
        """Let effects find the state from which the first step starts."""
        try:
            self.effects.before_first_step(self)
        except (Unfinished, DriverError) as problem:
            raise StepFailed(getattr(problem, "error", problem)) from None
        self.older, self.older_motion = self.multipliers, self.motion

    def _advance(self, index: int) -> tuple[Step, DriverError | None]:
        """Take and record step `index`; the error with which it was left unfinished, if it was.

        Raises StepFailed where no state can balance the loads.
        """
        if self.contact.motion is not None:
            self._move_obstacles(index)
        if self.cycles is not None:
            self.cycles.before(self, index)
        step, error = self._step(index, *self._predicted(index))
        self._ends(step)
        return step, error

    def _predicted(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rigid motions, multipliers and rows that slide from which step `index` starts.

        Raises StepFailed where no state can balance the loads.
        """
        first = not any(self.loads[: index - 1]) and not self.motion.any()
        try:
            with self.rows.under(self.slip.largest_coefficient(), self.rows.offset):
                rest = self.bodies.can_rest(index, self.amplitudes[index],
                                            None if first else self.multipliers)
        except DriverError as problem:
            raise StepFailed(problem) from None
        if first:
            self.motion = rest
        if self.rows.corners is not None:
            self.multipliers = self.rows.corners.own(self.multipliers)
        last, growth = self.multipliers, 0.0
        if self.settings.predictor == "load":
            growth = outlook.growth(self.amplitudes, index)
        sliding = self.rows.sliding(last, self.rows.friction_bound(last))
        start = self.rows.pressing(last + growth * (last - self.older))
        motion = self.motion + growth * (self.motion - self.older_motion)
        return motion, self.rows.follow(start, sliding), sliding

    def _ends(self, step: Step) -> None:
        """What the next step starts from is what `step` ends in; it is counted."""
        self.multipliers, self.older = step.multipliers, self.multipliers
        self.contraction = np.nan_to_num(step.contraction, nan=self.contraction)
        self.older_motion = self.motion
        self.motion = step.weights[self.operator.structure.patterns :]
        slip = self.slip.advance(step.multipliers, step.gradient, step.weights, self.scales)
        self.effects.step_ends(self.rows.tangential_node, slip,
                               step.multipliers[self.rows.pair])
        self._record(step)
        if self.cycles is not None:
            self.cycles.follow(self, step, slip)

    def _move_obstacles(self, index: int) -> None:
        """Obstacles go where they stand at the end of step `index`; slip counts from there."""
        rows, before, now = self.rows, self.times[index - 1], self.times[index]
        rows.gap = self.contact.motion.gap_at(now)[rows.normal_node]
        way = self.contact.way(before, now)
        self.slip.way = way[rows.tangential_node]
        if self.effects.coefficient_changes:
            self.slip.travelled = self._travelled(index)[rows.tangential_node]
        if rows.corners is not None:
            moved = self.contact.motion.moved(before, now)
            rows.corners.shifted = moved[rows.corners.nodes].any(axis=1)

    def _travelled(self, index: int) -> np.ndarray:
        """(n_c,) way of the obstacles' surfaces in all steps before `index`."""
        ends = self.times[:index]
        if not self.contact.motion.angle.any():  # then the way between two times is that of steps
            ends = ends[[0, -1]]
        return sum((self.contact.way(*step) for step in zip(ends, ends[1:])),
                   np.zeros(len(self.contact.gid)))

    def load(self, index: int, motion: np.ndarray, moved: np.ndarray) -> Load:
        """Load of a step from rigid motions (modes,); `moved` (owned,) is F x for its start x.

        Motions of whole bodies, prescribed or free, and of obstacles come into the slip by their
        increments.
        """
        op, rows = self.operator, self.rows
        weights = np.concatenate([self.amplitudes[index], motion])
        d, rigid = op.elastic_response(weights), np.zeros(op.owned)
        rigid[rows.normal] = op.rigid_response(weights)[rows.normal]
        rigid[rows.tangential] = op.rigid_response(weights - self.slip.weights)[rows.tangential]
        rigid[rows.tangential] -= self.slip.way
        extent = self.qp.extent(d, rigid, self.slip.elastic, moved)
        d += rigid
        d[rows.normal] -= rows.gap
        d[rows.tangential] -= self.slip.elastic
        travel, rest = float(np.abs(rigid).max(initial=0.0)), rigid.copy()
        rest[rows.normal] -= rows.gap
        rest[rows.tangential] -= self.slip.elastic
        return Load(weights, d, extent, travel, rest=rest)

    def without_friction(self) -> tuple[np.ndarray, np.ndarray, Load]:
        """Multipliers (owned,), gradient and load of the equilibrium without friction at time 0.

        Raises NoSolution where contact cannot balance the loads on free bodies, Unfinished.
        """
        rows, slip, smooth = self.rows, self.slip, np.zeros(len(self.rows.tangential))
        known, slip.coefficient, slip.suspended = slip.coefficient, smooth, True
        try:
            with rows.under(smooth, None):
                self.closure.begin_step(False, slides=False)
                x = np.zeros(self.operator.owned)
                load = self.load(0, self.bodies.can_rest(0, self.amplitudes[0]), x)
                self.scales.renew(d=load.extent)
                x, gradient, _, _ = self.closure.settled(
                    0, load, (x, -load.d, smooth), Trace(), self.settled)
        finally:
            slip.coefficient, slip.suspended = known, False
        self.scales.keep()
        return x, gradient, load

    def _size(self, index: int) -> float:
        """Displacements of the dual rows that a step asks for, travel along contact left out."""
        weights, rows = self.amplitudes[index], self.rows
        d = self.operator.rigid_response(weights)
        d[rows.tangential] = 0.0
        if self.contact.motion is not None:
            gap = self.contact.motion.gap_at(self.times[index])[rows.normal_node]
            d[rows.normal] += np.maximum(-gap, 0.0)
        return self.qp.asked_for(self.operator.elastic_response(weights) + d)

    def _record(self, step: Step) -> None:
        counts, worst = self.history.counts, self.history.residuals
        counts["fixed_point_iterations"] += step.fixed_point_iterations
        setup = counts["dual_multiplications_setup"]
        counts["dual_multiplications"] = self.operator.products - setup
        for name, value in step.residuals.items():
            worst[name] = max(worst.get(name, 0.0), value)
        self.history.steps = step.index
        self.history.contraction = max(self.history.contraction, step.contraction)  # unless NaN

    # ---- one time step -----------------------------------------------------------------------
    def _step(self, index: int, motion, x, sliding) -> tuple[Step, DriverError | None]:
        """One time step from rigid motions and multipliers with rows that slide.

        The error tells why it was left unfinished.
        """
        op, rows = self.operator, self.rows
        # of the last step estimates ask how fast it contracts
        products, trace, error = op.products, Trace(
            rated=index == len(self.times) - 1, refined=op.uneven), None
        self.closure.begin_step(self.contact.motion is not None)
        moved = op.apply(x)
        load = self.load(index, motion, moved)
        self.scales.renew(d=load.extent)
        try:
            start = x, moved - load.d, sliding
            answer = self._kept(load, *start[:2]) if self._holds(index) else None
            if answer is not None:
                trace.rate = self.contraction
            x, gradient, moved, residuals = answer or self.more_digits.settled(
                index, load, start, trace)
            self.history.counts["condensed_steps"] += bool(trace.shortcut)
            self._examine(index, load, x, gradient)
            self.bodies.note_loose_motion(index, x)
        except Unfinished as failure:
            error, sliding = failure.error, rows.sliding(failure.x, rows.friction_bound(failure.x))
            x, gradient, moved = self.into_cone(load.d, failure.x, failure.gradient, sliding)
            residuals = self.residuals.of(load, x, gradient)
        self.scales.keep()
        if rows.corners is not None:
            x = self.corners.end_step(x, gradient)
        if self.junctions is not None:
            x = self.junctions.shared(x, gradient)
        return Step(index, float(self.times[index]), load.weights, x, gradient, rows.states(x),
                    rows.law_bound(x), trace.iterations, op.products - products,
                    trace.contraction, residuals, moved, trace.refined), error

    def _holds(self, index: int) -> bool:
        """Whether loads and obstacles stay what they were at the end of the step before.

        The state that it ended in then is the solution: nothing slides, and friction that was at
        its bound stays there. Solved anew, its own error would be a slip, and forces of stiff parts
        would drift from step to step.
        """
        return (index > 1 and not self.contact.moves and not self.effects.closes
                and np.array_equal(self.amplitudes[index], self.amplitudes[index - 1]))

    def _kept(self, load: Load, x, gradient):
        """As `settled` from x, whose nodes do not slide, if residuals are small enough; else None.
        """
        still = self.operator.gradient(x, load) if self.operator.uneven else gradient.copy()
        still[self.rows.tangential] = 0.0
        residuals = self.residuals.of(load, x, still)
        return (x, still, np.zeros_like(x), residuals) if self.residuals.enough(residuals) else None

    def settled(self, index: int, load: Load, x, gradient, sliding, trace: Trace):
        """As `_earned`, with bodies without support where their forces move them least."""
        for _ in range(SETTLINGS if self.operator.modes else 0):
            x, gradient, moved, _ = self._earned(index, load, x, gradient, sliding, trace)
            gradient = gradient - self.bodies.settle(load, x, gradient)
            residuals = self.residuals.of(load, x, gradient)
            if self.residuals.enough(residuals):
                return x, gradient, moved, residuals
            sliding = self.rows.sliding(x, self.rows.friction_bound(x))
        return self._earned(index, load, x, gradient, sliding, trace)

    def _earned(self, index: int, load: Load, x, gradient, sliding, trace: Trace):
        """Multipliers, gradient, last change and residuals that are as small as asked for."""
        return Tightening(self, index, load, trace).earned(x, gradient, sliding)

    def _examine(self, index: int, load: Load, x, gradient) -> None:
        """Look for other solutions of the step where there is reason to; see `uniqueness`."""
        search, choice, nodes = self.uniqueness, self.settings.uniqueness, self.condensation.nodes
        # a run is examined or it is not: all nodes count, also those that face nothing in this step
        count = np.count_nonzero(self.operator.structure.contact.normal_row >= 0)
        self.doubtful = self.doubtful or self.history.fallbacks.of(index)
        if search.ended or not worthwhile(choice, count, self.largest_friction, self.doubtful):
            return
        search.failure = (CHANGING if self.effects.coefficient_changes else
                          YIELDING if self.effects.closes else too_many(count))
        if search.failure or not len(nodes):
            return
        clock = time.perf_counter()
        try:
            problem = self.condensation.problem(load, x, gradient)
        except NotConverged as error:
            search.failure = str(error)
            return
        weight = self.operator.structure.contact.weight[nodes]
        search.examine(index, problem, self.condensation.gather(x), weight,
                       self.rows.corners is None, self.residuals.least_forces)
        spent = time.perf_counter() - clock
        self.history.examining += spent
        self.history.seconds -= spent  # the step's, to which all of its time is added

    def into_cone(self, d, x, gradient, sliding):
        """Multipliers put exactly into the cone of their own pressures, their gradient, the change.

        The last QP was solved with the bound of the iterate before. Nodes that slid stay on the
        bound and the others inside it, so that the active set the QP has found is kept.
        """
        final, renewed = self.qp.placed(self.rows.follow(x, sliding), d, x, gradient)
        return final, renewed, final - x
