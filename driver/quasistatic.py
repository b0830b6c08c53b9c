"""Stage 6: implicit time steps; in each the fixed point for local Coulomb friction around the QP.

Time step (Haslinger, Vlach, Dostal, SNA'07): with the previous tangential displacement v_T in the
functional, find (u, lambda) with lambda_n = Phi(lambda_n), where Phi(g) solves the contact problem with
given friction bound F g, the box-constrained QP

    min 1/2 lambda' F lambda - lambda' d,   lambda_n >= 0,  |lambda_t| <= F g.

Multipliers and g start from those of the previous iteration and the previous step. Where the iteration does not
contract the methods of `globalization` take over; `uniqueness` looks whether a step has other solutions.
"""

import time
from dataclasses import asdict, dataclass, field, fields

import numpy as np
from mpi4py import MPI

from . import friction, globalization
from .condensation import Condensation
from .contactblock import ContactBlock
from .deflation import DeflatedPreconditioner, Deflation
from .equilibrium import rigid_equilibrium
from .errors import NoSolution, NotConverged
from .fetidp import DualOperator
from .mprgp import mprgp, norm_bound, projected_gradient
from .options import Settings
from .relaxation import ContactRelaxation
from .substructuring import GLUING
from .uniqueness import Uniqueness, worthwhile

CANCELLED = 1e-8  # displacements below this part of ||d|| are what rounding leaves of loads that contact takes
SETTLING = 0.3  # relative change of pressures and friction bounds below which free bodies follow their springs
WINDOW = 8  # iterations of the fixed point over which its changes must have fallen
CORRECTIONS = 30  # friction bounds in the contact problem with F_cc, at most
CORRECTION = 0.1  # its residual, relative to the whole one before
CONDENSED_PASSES = 30  # corrections of a solution of the condensed contact problem
LOOSE = "nothing that touches or sticks holds a rigid motion of a body without support"
TIGHTENINGS = 3  # tenfold reductions of the QP tolerance that a step may ask for


@dataclass
class Step:
    """State at the end of a time step; multiplier arrays hold the rank's rows."""

    index: int
    time: float
    weights: np.ndarray  # factors of the load patterns, then of the free rigid motions
    multipliers: np.ndarray
    gradient: np.ndarray
    status: np.ndarray  # of the rank's nodes with a normal row
    fixed_point_iterations: int
    products: int
    contraction: float  # mean ratio of successive changes of the fixed point, NaN if there was one
    residuals: dict
    moved: np.ndarray | None = None  # last change of the multipliers, to the friction bound of their own pressures


def gathered(step: Step, rows: friction.ContactRows, contact_nodes: int, comm) -> dict | None:
    """A step as numbers and arrays of the whole problem on rank 0, for `scattered`; collective."""
    moved = np.empty(0) if step.moved is None else step.moved
    parts = comm.gather((step.multipliers, step.gradient, rows.normal_node, step.status, moved))
    if parts is None:
        return None
    multipliers, gradient, node, status, moved = map(np.concatenate, zip(*parts))
    by_node = np.zeros(contact_nodes, np.int64)
    by_node[node] = status
    return {f.name: getattr(step, f.name) for f in fields(Step)} | {
        "multipliers": multipliers, "gradient": gradient, "status": by_node,
        "moved": None if step.moved is None else moved}


def scattered(state: dict, rows: friction.ContactRows, row_range: tuple[int, int]) -> Step:
    """This rank's part of a step from what `gathered` returned."""
    mine = slice(*row_range)
    moved = None if state["moved"] is None else state["moved"][mine]
    return Step(**state | {"multipliers": state["multipliers"][mine], "gradient": state["gradient"][mine],
                           "status": state["status"][rows.normal_node], "moved": moved})


@dataclass
class _Load:
    """What drives a time step: factors of the load patterns, then of the free rigid motions, and the d they make."""

    weights: np.ndarray
    d: np.ndarray


@dataclass
class History:
    """Counts over a run, the log of MPRGP steps and how the run ended."""

    counts: dict = field(default_factory=lambda: dict.fromkeys(
        ("fixed_point_iterations", "dual_multiplications", "dual_multiplications_setup", "cg_steps",
         "expansion_steps", "proportioning_steps", "contact_block_products"), 0))
    log: list = field(default_factory=list)  # (product, step, iteration, kind, residual)
    residuals: dict = field(default_factory=dict)
    steps: int = 0
    exit_status: int = 0
    reason: str = ""
    warnings: list = field(default_factory=list)
    fallbacks: globalization.Fallbacks = field(default_factory=globalization.Fallbacks)
    contraction: float = 0.0  # worst of the steps
    seconds: float = 0.0


KEPT = ("counts", "residuals", "steps", "warnings", "contraction", "seconds")  # of a History in a snapshot


@dataclass
class _Trace:
    """Iterations of the fixed point in one time step and the changes they made."""

    iterations: int = 0
    changes: list = field(default_factory=list)
    fallback: bool = False  # successive approximations did not contract
    exact: bool = False  # every QP is solved to the tolerance: where multipliers answer violently to residuals

    @property
    def contraction(self) -> float:
        """Geometric mean of the ratios of successive changes, over the last `WINDOW` ones; NaN if there are none.

        A QP that is left as it is makes no change, which says nothing of the next one.
        """
        last = [change for change in self.changes if change > 0][-WINDOW - 1 :]
        return (last[-1] / last[0]) ** (1 / (len(last) - 1)) if len(last) > 1 else np.nan

    @property
    def stalls(self) -> bool:
        """Whether the changes have not fallen over a window."""
        return len(self.changes) > 2 * WINDOW and min(self.changes[-WINDOW:]) >= min(self.changes[:-WINDOW])


class QuasistaticSolver:
    """Marches through the time steps of one problem. Collective over the operator's communicator."""

    def __init__(self, operator: DualOperator, effects: dict, amplitudes: np.ndarray, times: np.ndarray,
                 settings: Settings, slip_law: friction.SlipLaw | None = None):
        """`amplitudes` (steps + 1, patterns): factor of every load pattern at every time of `times`."""
        self.operator, self.settings, self.effects = operator, settings, effects
        self.amplitudes, self.times = amplitudes, times
        self.rows = friction.contact_rows(operator.structure, effects)
        self.coefficient, self.slip_law = self.rows.bound, slip_law
        self.u_t = operator.structure.contact.initial[self.rows.tangential_node]  # tangential displacement at the end of the last step
        self.way = np.zeros(len(self.rows.tangential))  # length of the way slid until then
        self.history = History()
        structure = operator.structure
        self.scale = structure.row_scale[slice(*structure.row_range)]
        self.bound = self._bound_norm()
        self.preconditioner, self.relaxation = self._accelerators()
        self.history.counts["dual_multiplications_setup"] = operator.products
        self.scales = friction.Scales()
        self.condensation = Condensation(operator, self.rows)
        largest = operator.comm.allreduce(float(0.0 if self.rows.tresca else self.rows.bound.max(initial=0)), op=MPI.MAX)
        self.uniqueness, self.largest_friction = Uniqueness(largest > 0), largest
        self.doubtful = False
        self.motion = self.older_motion = np.zeros(operator.modes)  # of bodies that no support holds
        self.multipliers = self.older = np.zeros(operator.owned)  # of the last step and of the one before

    def _bound_norm(self) -> float:
        """Upper bound of the scaled ||F||; the same random start vector for any number of ranks."""
        structure, op = self.operator.structure, self.operator
        if structure.dual_dofs == 0:  # one subdomain without contact: nothing to iterate on
            return 1.0
        start = np.random.default_rng(1).standard_normal(structure.dual_dofs)
        return norm_bound(lambda y: self.scale * op.apply(self.scale * y), op.owned, dot=op.dot,
                          start=start[slice(*structure.row_range)])[0]

    def _accelerators(self):
        """The preconditioner and the relaxation of the contact multipliers that the settings ask for, or None.

        Without gluing the contact block is the whole operator, and neither deflation nor relaxation has a sense.
        """
        settings, op = self.settings, self.operator
        relaxed = "contact" in (settings.expansion, settings.corrector)
        kinds = np.unique(op.structure.row_kind)
        coupled = (relaxed or settings.preconditioner == "deflated") and GLUING in kinds and len(kinds) > 1
        local = op.preconditioner() if settings.preconditioner != "none" or coupled else None
        chosen = local if settings.preconditioner != "none" else None
        if not coupled:
            return chosen, None
        deflation = Deflation(ContactBlock(op, local), op.structure)
        if settings.preconditioner == "deflated":
            chosen = DeflatedPreconditioner(local, deflation)
        return chosen, ContactRelaxation(op, deflation, self.bound, self.scale) if relaxed else None

    def _size(self, displacements: np.ndarray) -> float:
        """Norm of displacements of the dual rows in the scale that MPRGP works in."""
        scaled = self.scale * displacements
        return np.sqrt(self.operator.dot(scaled, scaled))

    def _extent(self, d: np.ndarray) -> float:
        """||d|| without what is left of gaps that the load alone would not close: they could be any distance.

        Bilateral contact closes them all.
        """
        if self.rows.bilateral:
            return self._size(d)
        seen, normal, gap = d.copy(), self.rows.normal, self.rows.gap
        reach = np.abs(d[normal] + gap)
        seen[normal] = np.where(gap > 0, np.clip(d[normal], -reach, reach), d[normal])
        return self._size(seen)

    def steps(self):
        """Generate the finished `Step`s after those in `history`; stops early, with the reason there, if one fails."""
        clock = time.perf_counter()
        if self.history.steps == 0 and self.effects.get("initial") == "preload":
            self.multipliers = self.older = self._preload()
            self.older_motion = self.motion
        for index in range(self.history.steps + 1, len(self.times) if self.history.exit_status == 0 else 1):
            if not self._can_rest(index):
                return
            lam = self.multipliers
            load = self._load(index, self._predict(index, self.motion, self.older_motion), self.u_t)
            start, sliding = self._predict(index, lam, self.older), self._sliding(lam, self.rows.friction_bound(lam))
            step = self._step(index, load, start, sliding)
            self.multipliers, self.older = step.multipliers, lam
            self.motion, self.older_motion = step.weights[self.operator.structure.patterns :], self.motion
            slip = -step.gradient[self.rows.tangential]
            self.u_t, self.way = self.u_t + slip, self.way + np.abs(slip)
            self._record(step)
            self.history.seconds += time.perf_counter() - clock
            yield step
            clock = time.perf_counter()
            if self.history.exit_status:
                return

    def _load(self, index: int, motion: np.ndarray, u_t: np.ndarray) -> _Load:
        """Load of a step that starts from rigid motions `motion` and tangential displacements u_t."""
        weights = np.concatenate([self.amplitudes[index], motion])
        d = self.operator.load_response(weights)
        d[self.rows.normal] -= self.rows.gap
        d[self.rows.tangential] -= u_t
        return _Load(weights, d)

    def _can_rest(self, index: int) -> bool:
        """Can contact hold the bodies without support? If so, the first step starts with gaps closed."""
        op = self.operator
        if not op.modes:
            return True
        weights = self.amplitudes[index]
        motions = np.column_stack([d for d, _ in op.loaded[op.structure.patterns :]])
        work, size = op.imbalance(np.zeros(op.owned), weights)
        found = rigid_equilibrium(self.rows, motions, work, size, op.comm)
        if found is None:
            self.history.exit_status = 3
            self.history.reason = f"step {index}: {self._why_no_rest()}"
            if index == 1:
                raise NoSolution(self.history.reason)  # there is nothing to keep
            return False
        if index == 1 and not self.motion.any():
            self.motion = found
        return True

    def _why_no_rest(self) -> str:
        bodies = sorted({mode.body + 1 for mode in self.operator.structure.rigid_modes})
        names = f"{'body' if len(bodies) == 1 else 'bodies'} {', '.join(map(str, bodies))}"
        how = {"none": "without contact nothing can", "unilateral": "contact cannot", "bilateral": "contact cannot"}[
            self.effects["contact"]]
        if self.effects["friction"] != "none":
            how = "contact and friction cannot"
        return (f"no equilibrium: {how} balance the loads on {names}, which no support holds: it slides off, tips over "
                "or is pulled away; add supports or friction")

    def _move(self, load: _Load, x: np.ndarray, gradient: np.ndarray) -> None:
        """Rigid motions follow what their springs still carry; d and the gradient with them."""
        op = self.operator
        net, _ = op.imbalance(x, load.weights)
        change = op.rho * net
        load.weights[op.structure.patterns :] += change
        for factor, (d, _) in zip(change, op.loaded[op.structure.patterns :]):
            load.d += factor * d
            gradient -= factor * d

    def _imbalance(self, load: _Load, x: np.ndarray) -> float:
        """Largest force that rigid motions leave to their springs, relative to the forces at work."""
        if not self.operator.modes:
            return 0.0
        net, size = self.operator.imbalance(x, load.weights)
        self.scales.work = np.maximum(self.scales.work, size)
        return float(np.max(np.abs(net) / np.where(self.scales.work > 0, self.scales.work, 1.0)))

    def _preload(self) -> np.ndarray:
        """Multipliers of the frictionless equilibrium at time 0, whose displacement becomes u_0."""
        op, rows, contact = self.operator, self.rows, self.operator.structure.contact
        load, x = self._load(0, self.motion, np.zeros(len(rows.tangential))), np.zeros(op.owned)
        self.scales.d = self._extent(load.d)
        lower, upper = rows.limits(op.owned, np.zeros(op.owned))
        lower[rows.tangential] = upper[rows.tangential] = 0.0
        self.tol = self.settings.rtol * self.scales.d
        for iteration in range(1, self.settings.max_fixed_point + 1):
            result = self._solve_qp(0, iteration, load.d, (lower, upper), x, 0.0)
            x = result.x
            if self.history.exit_status or self._imbalance(load, x) <= self.settings.friction_rtol:
                break
            self._move(load, x, result.gradient)
        else:
            self.history.exit_status = 4
            self.history.reason = f"preload: no equilibrium of the free bodies in {iteration} iterations"
        self.motion = load.weights[op.structure.patterns :]
        self.u_t = -result.gradient[rows.tangential]
        found = np.zeros(len(contact.gid))
        found[rows.tangential_node] = self.u_t
        contact.initial[:] = np.sum(op.comm.allgather(found), axis=0)
        return result.x

    def _predict(self, index: int, lam: np.ndarray, older: np.ndarray) -> np.ndarray:
        """Multipliers to start the step from: the last change, scaled like the change of the load.

        Exact as long as the response is proportional to the load (a contact zone that is not changing under
        loading); on reversal the step starts from the previous one.
        """
        if self.settings.predictor == "previous" or index < 2:
            return lam
        change, last = np.diff(self.amplitudes[index - 2 : index + 1], axis=0)[::-1]
        size = last @ last
        ratio = change @ last / size if size > 0 else 0.0
        return lam + min(max(ratio, 0.0), 2.0) * (lam - older)

    def _record(self, step: Step) -> None:
        counts, worst = self.history.counts, self.history.residuals
        counts["fixed_point_iterations"] += step.fixed_point_iterations
        counts["dual_multiplications"] = self.operator.products - counts["dual_multiplications_setup"]
        if self.relaxation is not None:
            counts["contact_block_products"] += self.relaxation.products
            self.relaxation.products = 0
        for name, value in step.residuals.items():
            worst[name] = max(worst.get(name, 0.0), value)
        self.history.steps = step.index
        self.history.contraction = max(self.history.contraction, np.nan_to_num(step.contraction))

    # ---- checkpoints ---------------------------------------------------------------------------
    def snapshot(self) -> dict | None:
        """All that the next step depends on and that the run reports, for `restore`, on rank 0; collective.

        Arrays follow the global numbering of dual rows and contact nodes, numbers are exact: any number of ranks
        goes on from it with the same bits.
        """
        op, contact, history = self.operator, self.operator.structure.contact, self.history
        parts = op.comm.gather((self.multipliers, self.older, self.rows.tangential_node,
                                self.u_t, self.way, self.rows.bound))
        if parts is None:
            return None
        multipliers, older, node, *values = map(np.concatenate, zip(*parts))
        by_node = np.zeros((3, len(contact.gid)))
        by_node[:, node] = values
        product, step, iteration, kind, residual = zip(*history.log) if history.log else ((),) * 5
        return {"multipliers": multipliers, "older": older, "u_t": by_node[0], "way": by_node[1], "bound": by_node[2],
                "initial": contact.initial, "norm_bound": float(self.bound), "products": op.products,
                "scales": {**asdict(self.scales), "work": np.asarray(self.scales.work)},
                "motion": self.motion, "older_motion": self.older_motion,
                "log_numbers": np.array([product, step, iteration], np.int64), "log_kind": np.array(kind, str),
                "log_residual": np.array(residual, float), "fallbacks": history.fallbacks.steps,
                "history": {name: getattr(history, name) for name in KEPT}, "doubtful": self.doubtful,
                "condensed": self.condensation.known,
                "uniqueness": {**asdict(self.uniqueness), "several": list(self.uniqueness.several.items())}}

    def restore(self, state: dict) -> None:
        """Continue from a `snapshot` of the same problem and settings; the same on every rank."""
        mine, node, history = slice(*self.operator.structure.row_range), self.rows.tangential_node, self.history
        self.multipliers, self.older = state["multipliers"][mine], state["older"][mine]
        self.motion, self.older_motion = state["motion"], state["older_motion"]
        self.u_t, self.way, self.rows.bound = (state[name][node] for name in ("u_t", "way", "bound"))
        self.operator.structure.contact.initial[:] = state["initial"]
        self.bound, self.doubtful, self.scales = state["norm_bound"], state["doubtful"], friction.Scales(**state["scales"])
        self.uniqueness = Uniqueness(**{**state["uniqueness"], "several": dict(state["uniqueness"]["several"])})
        if state["condensed"]:
            self.condensation.compliance()  # its products have been counted
        self.operator.products = state["products"]
        history.log.extend(zip(*state["log_numbers"].tolist(), state["log_kind"].tolist(), state["log_residual"].tolist()))
        history.fallbacks.steps = state["fallbacks"]
        for name in KEPT:
            setattr(history, name, state["history"][name])

    # ---- one time step -----------------------------------------------------------------------
    def _step(self, index: int, load: _Load, start, sliding) -> Step:
        """One time step, with a tighter QP tolerance until displacements are good to `primal_rtol`.

        The tolerance on the projected gradient is relative to ||d||, the displacements of the body without
        contact and glue, which may be far larger than those of the solution.
        """
        op, settings, rows = self.operator, self.settings, self.rows
        self.scales.d = max(self.scales.d, self._extent(load.d))
        self.tol = settings.rtol * self.scales.d
        products, trace = op.products, _Trace()
        lower, _ = rows.limits(op.owned, start)
        x = self._follow(np.maximum(start, lower), sliding)
        gradient = op.apply(x) - load.d
        for _ in range(TIGHTENINGS + 1):
            x, gradient, sliding = self._fixed_point(index, load, x, gradient, sliding, trace)
            x, gradient, moved = self._into_cone(load.d, x, gradient, sliding)
            residuals = self._residuals(load, x, gradient)
            poor = max(residuals["gluing"], residuals["penetration"])
            if self.history.exit_status or poor <= settings.primal_rtol:
                break
            self.tol *= 0.1
        else:
            self.history.warnings.append(f"step {index}: gluing or penetration residual {poor:.1e} above "
                                         f"{settings.primal_rtol:.0e} although MPRGP was tightened")
        self._examine(index, x, gradient, trace)
        self._note_loose_motion(index, x)
        return Step(index, float(self.times[index]), load.weights, x, gradient, friction.status(rows, x, gradient),
                    trace.iterations, op.products - products, trace.contraction, residuals, moved)

    def _fixed_point(self, index: int, load: _Load, x, gradient, sliding, trace: "_Trace"):
        """Successive approximations lambda_n -> Phi(lambda_n), each QP solved only as far as it pays.

        The first QPs would be solved far beyond the error of their friction bound; each reduces its initial
        residual by `inner_rtol`, and the last one meets the tolerance. Bodies without support move in the same
        iterations. Starts from and returns multipliers, gradient and the rows that slide.
        """
        settings, rows, free = self.settings, self.rows, self.operator.modes > 0
        coulomb = bool(self.operator.comm.allreduce(int(len(rows.tangential) > 0 and not rows.tresca)))
        while not trace.fallback:
            trace.iterations += 1
            x, gradient = self._placed(self._start(x, gradient, sliding), load.d, x, gradient)
            bound, reduction = rows.friction_bound(x), self._reduction(trace) if coulomb or free else 0.0
            result, change = self._approximate(index, trace, load.d, x, bound, reduction, coulomb, gradient)
            x, gradient = result.x, result.gradient
            sliding = self._sliding(x, bound)
            if self.history.exit_status or not (coulomb or free):
                return x, gradient, sliding
            trace.changes.append(change)
            balanced = self._imbalance(load, x) <= settings.friction_rtol
            if balanced and self._settled(change, result):
                return x, gradient, sliding
            tired = trace.iterations >= settings.max_fixed_point
            if tired and (free or trace.iterations <= 2 * WINDOW):
                self._end(4, f"step {index}: no fixed point of the friction bound in {trace.iterations} iterations")
                return x, gradient, sliding
            if not balanced and change <= SETTLING * self._norm(x[rows.normal]):
                self._move(load, x, gradient)  # before, friction is too far off to say where to
            if trace.stalls and not trace.exact:  # by the errors of QPs left early? Solved in full they must stall again
                trace.exact, trace.changes = True, []
            trace.fallback = (trace.stalls or tired) and not free  # a motion renews the pressures: no sign of stalling
        return self._globalise(index, load.d, self._follow(x, sliding), trace)

    def _start(self, x, gradient, sliding):
        """Start of the next QP: x moved to the friction bound of its own pressures, and corrected if so set."""
        start = self._follow(x, sliding)
        if self.relaxation is None or self.settings.corrector == "none":
            return start
        return self._correct(start, self.relaxation.moved(start, x, gradient))

    def _correct(self, x, gradient):
        """x with the contact multipliers that solve contact and friction while the gluing ones stay.

        Successive approximations as in `_fixed_point`, with F_cc for F. `gradient` need be right only on the contact rows.
        """
        rows, aim = self.rows, None
        for _ in range(CORRECTIONS):
            limits, bound = rows.limits(self.operator.owned, x), rows.friction_bound(x)
            left = projected_gradient(x, gradient, *limits)
            if aim is None:
                whole = self._size(left)
                aim = max(0.5 * self.tol, CORRECTION * whole)
            left[rows.gluing] = 0.0
            if whole <= self.tol or self._size(left) <= aim:
                break
            solved, gradient = self.relaxation(x, gradient, limits, 0.5 * aim)
            x = self._follow(solved, self._sliding(solved, bound))
            gradient = self.relaxation.moved(x, solved, gradient)
        return x

    def _placed(self, moved, d, x, gradient):
        """`moved` and its gradient, which takes a product unless it is x and the gradient there is known."""
        if gradient is None or self.operator.comm.allreduce(int(np.count_nonzero(moved != x))):
            return moved, self.operator.apply(moved) - d
        return x, gradient

    def _approximate(self, index, trace, d, x, bound, reduction, coulomb=True, gradient=None):
        """The QP with friction bounds `bound` started from x: its result, and the change of pressures and bounds."""
        limits = self._limits(x, bound)
        x, gradient = self._placed(np.clip(x, *limits), d, x, gradient)
        result = self._solve_qp(index, trace.iterations, d, limits, x, reduction, gradient)
        if self.history.exit_status or not coulomb:
            return result, 0.0
        self._renew_coefficient(result.gradient)
        return result, max(self._norm(result.x[self.rows.normal] - x[self.rows.normal]),
                           self._norm(self.rows.friction_bound(result.x) - bound, tangential=True))

    def _reduction(self, trace: "_Trace") -> float:
        """Residual reduction of a QP of the fixed point."""
        return 0.0 if trace.exact else self.settings.inner_rtol

    def _settled(self, change: float, result) -> bool:
        return change <= self.settings.friction_rtol * self._norm(result.x[self.rows.normal]) and result.residual <= self.tol

    def _globalise(self, index: int, d, x, trace: "_Trace"):
        """The fixed point by the methods of `globalization`, in their order; see `_fixed_point`."""
        found = self._accelerate(index, d, x, trace)
        if found is None and not self.history.exit_status:
            found = self._condense(index, d, x, trace)
        if found is not None:
            return found
        if not self.history.exit_status:
            self._end(3, f"step {index}: the fixed point for the friction bound does not contract, and no other method "
                         "found a solution; the friction coefficient is beyond the range of a unique one")
        return x, self.operator.apply(x) - d, self._sliding(x, self.rows.friction_bound(x))

    def _accelerate(self, index: int, d, x, trace: "_Trace"):
        """Anderson acceleration of the friction bounds; None if it makes no headway."""
        rows, bound, changes = self.rows, self.rows.friction_bound(x), []
        method = globalization.Anderson(self._tangential_dot)
        while not (changes and globalization.gives_up(changes)):
            trace.iterations += 1
            result, change = self._approximate(index, trace, d, x, bound, self._reduction(trace))
            if self.history.exit_status:
                return None
            x, sliding = result.x, self._sliding(result.x, bound)
            changes.append(change)
            if self._settled(change, result):
                self.history.fallbacks.note(globalization.ANDERSON, index)
                return x, result.gradient, sliding
            bound = method.next(bound, rows.friction_bound(x))
        return None

    def _condense(self, index: int, d, x, trace: "_Trace"):
        """A solution of the condensed contact problem, corrected until it is one of the whole; None if none is found.

        Every pass solves for the gluing multipliers with the contact multipliers held. What then is left on the
        contact rows makes the load of the condensed problem exact for the next pass.
        """
        if self.condensation.n > globalization.CONDENSED_NODES:
            return None
        rows, method, part, last = self.rows, globalization.NEWTON, 1.0, np.inf
        for _ in range(CONDENSED_PASSES):
            trace.iterations += 1
            bound, coefficient = rows.friction_bound(x), rows.bound
            result = self._solve_qp(index, trace.iterations, d, self.condensation.held(x), x, 0.0)
            if self.history.exit_status:
                return None
            x = result.x
            self._renew_coefficient(result.gradient)
            change = self._norm(rows.friction_bound(x) - bound, tangential=True)
            left = projected_gradient(x, result.gradient, *self._limits(x, bound))
            # the gluing rows alone may be left with a residual of tol
            if change <= self.settings.friction_rtol * self._norm(x[rows.normal]) and self._size(left) <= 2 * self.tol:
                self.history.fallbacks.note(method, index)
                return x, result.gradient, self._sliding(x, bound)
            part, last = part if change <= 0.5 * last else 0.5 * part, change
            rows.bound = coefficient + part * (rows.bound - coefficient)
            try:
                contact, found = globalization.solve_condensed(self.condensation.problem(x, result.gradient),
                                                               self.condensation.gather(x))
            except NotConverged:
                return None
            if contact is None:
                return None
            method = found if found == globalization.LEMKE else method
            x = self.condensation.place(contact, x)
        return None

    def _limits(self, x: np.ndarray, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the multipliers under the friction bounds `bound`."""
        lower, upper = self.rows.limits(self.operator.owned, x)
        lower[self.rows.tangential], upper[self.rows.tangential] = -bound, bound
        return lower, upper

    def _note_loose_motion(self, index: int, x: np.ndarray) -> None:
        """Say it once if nothing that touches or sticks holds a rigid motion of a body without support.

        Such a body is in equilibrium at many places. The motion leaves no row that acts, or only those of zero.
        """
        op, rows = self.operator, self.rows
        if not op.modes or self.history.exit_status or any(LOOSE in line for line in self.history.warnings):
            return
        acts = np.zeros(op.owned)
        acts[rows.normal] = rows.bilateral | (x[rows.normal] != 0)
        acts[rows.tangential] = np.abs(x[rows.tangential]) < rows.friction_bound(x)
        motions = [d for d, _ in op.loaded[op.structure.patterns :]]
        held = np.array([[op.dot(acts * a, b) for b in motions] for a in motions])
        if np.linalg.eigvalsh(held)[0] <= 1e-12 * max(op.dot(d, d) for d in motions):  # squares of roundings
            self.history.warnings.append(f"step {index}: {LOOSE}, and displacements are one answer of many")

    def _examine(self, index: int, x, gradient, trace: "_Trace") -> None:
        """Look for other solutions of the step where there is reason to; see `uniqueness`."""
        found, choice, nodes = self.uniqueness, self.settings.uniqueness, self.condensation.n
        self.doubtful = self.doubtful or trace.fallback
        if not found.frictional or self.history.exit_status or found.failure:
            return
        if self.operator.modes:
            found.failure = "a body without support"
            return
        if not worthwhile(choice, nodes, self.largest_friction, self.doubtful):
            return
        if nodes > globalization.CONDENSED_NODES:
            found.failure = f"{nodes} contact nodes, more than {globalization.CONDENSED_NODES}"
            return
        try:
            problem = self.condensation.problem(x, gradient)
        except NotConverged as problem:
            found.failure = str(problem)
            return
        contact = self.operator.structure.contact
        found.examine(index, problem, self.condensation.gather(x), contact.weight[contact.normal_row >= 0])

    def _renew_coefficient(self, gradient: np.ndarray) -> None:
        """Friction coefficients at the tangential displacements of the latest iterate."""
        if self.slip_law is not None:
            u_t = self.u_t - gradient[self.rows.tangential]
            self.rows.bound = self.coefficient * self.slip_law.factor(u_t, self.u_t, self.way)

    def _sliding(self, x: np.ndarray, bound: np.ndarray) -> np.ndarray:
        """Sign of the multiplier at tangential rows that are on their bound, 0 at the others."""
        multiplier = x[self.rows.tangential]
        return np.where(np.abs(multiplier) >= bound, np.sign(multiplier), 0.0)

    def _follow(self, x: np.ndarray, sliding: np.ndarray) -> np.ndarray:
        """x with sliding nodes moved to, and the others cut at, the friction bound of its own pressures.

        Left where they were, sliding nodes would be inside a bound that has grown and the QP would have to
        find them again one expansion step after the other.
        """
        moved, t = x.copy(), self.rows.tangential
        bound = self.rows.friction_bound(x)
        moved[t] = np.where(sliding != 0, sliding * bound, np.clip(x[t], -bound, bound))
        return moved

    def _solve_qp(self, index, iteration, d, limits, x, reduction, gradient=None):
        op, settings, history = self.operator, self.settings, self.history
        if gradient is None:
            gradient = op.apply(x) - d
        left = projected_gradient(x, gradient, *limits)
        tol = max(self.tol, reduction * self._size(left))
        offset, relax = op.products, None
        if self.relaxation is not None and settings.expansion == "contact":
            relax = lambda y, gradient: self.relaxation(y, gradient, limits, 0.5 * tol)[0]

        def monitor(kind, products, residual):
            history.log.append((offset + products, index, iteration, kind, residual / (self.scales.d or 1.0)))

        def attempt(x, gradient, relax):
            found = mprgp(op.apply, d, *limits, x, tol=tol, norm_bound=self.bound,
                          preconditioner=self.preconditioner, max_products=settings.max_products, gradient0=gradient,
                          dot=op.dot, monitor=monitor, scale=self.scale, relax=relax,
                          expansion="gradient" if settings.expansion == "gradient" else "cg")
            self.bound = found.norm_bound
            for name in ("cg_steps", "expansion_steps", "proportioning_steps"):
                history.counts[name] += getattr(found, name)
            return found

        result = attempt(x, gradient, relax)
        if result.status == "stagnated" and relax is not None:
            # steps on the contact rows alone may be all rounding where the stiffness jumps within subdomains
            offset = op.products
            result = attempt(result.x, op.apply(result.x) - d, None)
        if result.status != "converged":
            self._end(3 if result.status == "indefinite operator" else 4,
                      f"step {index}: MPRGP ended with '{result.status}': {result.reason}")
        return result

    def _end(self, status: int, reason: str) -> None:
        """The run ends after this step, with an exit status and the reason."""
        self.history.exit_status, self.history.reason = status, reason

    def _length(self, vector: np.ndarray) -> float:
        """Euclidean norm of a dual vector."""
        return np.sqrt(self.operator.dot(vector, vector))

    def _on(self, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        """The dual vector with `values` on `rows` and zero elsewhere."""
        full = np.zeros(self.operator.owned)
        full[rows] = values
        return full

    def _norm(self, values: np.ndarray, tangential: bool = False) -> float:
        """Euclidean norm of values on the normal (or tangential) rows."""
        return self._length(self._on(self.rows.tangential if tangential else self.rows.normal, values))

    def _tangential_dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Scalar product of values on the tangential rows."""
        return self.operator.dot(*(self._on(self.rows.tangential, values) for values in (a, b)))

    def _into_cone(self, d, x, gradient, sliding):
        """Multipliers put exactly into the cone of their own pressures, their gradient, the change (None: no change).

        The last QP was solved with the bound of the iterate before. Nodes that slid stay on the bound and
        the others inside it, so that the active set the QP has found is kept.
        """
        final, renewed = self._placed(self._follow(x, sliding), d, x, gradient)
        return final, renewed, None if final is x else final - x

    def _residuals(self, load: _Load, x, gradient) -> dict:
        """KKT residuals of the step's state."""
        op = self.operator
        left = projected_gradient(x, gradient, *self.rows.limits(op.owned, x))
        self.scales.displacement = max(self.scales.displacement, op.corner_displacement(x, load.weights),
                                       CANCELLED * self.scales.d)
        found = friction.kkt_residuals(self.rows, x, gradient, self._size(left), self.scales, op.comm)
        return found | {"equilibrium": self._imbalance(load, x)} if op.modes else found
