"""Stage 6: implicit time steps; in each the fixed point for local Coulomb friction around the QP.

Time step (Haslinger, Vlach, Dostal, SNA'07): with the previous tangential displacement v_T in the
functional, find (u, lambda) with lambda_n = Phi(lambda_n), where Phi(g) solves the contact problem with
given friction bound F g, the box-constrained QP

    min 1/2 lambda' F lambda - lambda' d,   lambda_n >= 0,  |lambda_t| <= F g.

Multipliers and g start from those of the previous iteration and the previous step. `frictionqp` solves the QP,
`fixedpoint` finds lambda_n, `freebodies` moves what no support holds; `uniqueness` looks whether a step has other
solutions.
"""

import time
from dataclasses import asdict

import numpy as np
from mpi4py import MPI

from ..contact import friction
from . import globalization
from .condensation import Condensation
from ..errors import NotConverged
from ..feti.fetidp import DualOperator
from .fixed_point import FixedPoint
from .free_bodies import FreeBodies
from .friction_qp import FrictionQP
from ..qp.mprgp import projected_gradient
from ..options import Settings
from .step import History, Load, Step, Trace
from .uniqueness import Uniqueness, worthwhile

CANCELLED = 1e-8  # displacements below this part of ||d|| are what rounding leaves of loads that contact takes
TIGHTENINGS = 3  # tenfold reductions of the QP tolerance that a step may ask for
KEPT = ("counts", "residuals", "steps", "warnings", "contraction", "seconds")  # of a History in a snapshot


class QuasistaticSolver:
    """Marches through the time steps of one problem. Collective over the operator's communicator."""

    def __init__(self, operator: DualOperator, effects: dict, amplitudes: np.ndarray, times: np.ndarray,
                 settings: Settings, slip_law: friction.SlipLaw | None = None):
        """`amplitudes` (steps + 1, patterns): factor of every load pattern at every time of `times`."""
        self.operator, self.settings, self.effects = operator, settings, effects
        self.amplitudes, self.times = amplitudes, times
        self.rows = friction.contact_rows(operator.structure, effects)
        self.slid = friction.SlidState(self.rows, operator.structure.contact.initial, slip_law)
        self.history, self.scales = History(), friction.Scales()
        self.qp = FrictionQP(operator, self.rows, settings, self.scales, self.history)
        self.history.counts["dual_multiplications_setup"] = operator.products
        self.bodies = FreeBodies(operator, self.rows, effects, self.scales, self.history)
        self.condensation = Condensation(operator, self.rows)
        self.fixed_point = FixedPoint(self.qp, self.bodies, self.slid, self.condensation)
        largest = operator.comm.allreduce(float(0.0 if self.rows.tresca else self.rows.bound.max(initial=0)), op=MPI.MAX)
        self.uniqueness, self.largest_friction = Uniqueness(largest > 0), largest
        self.doubtful = False
        self.motion = self.older_motion = np.zeros(operator.modes)  # of bodies that no support holds
        self.multipliers = self.older = np.zeros(operator.owned)  # of the last step and of the one before

    def steps(self):
        """Generate the finished `Step`s after those in `history`; stops early, with the reason there, if one fails."""
        clock = time.perf_counter()
        if self.history.steps == 0 and self.effects.get("initial") == "preload":
            self.multipliers = self.older = self._preload()
            self.older_motion = self.motion
        for index in range(self.history.steps + 1, len(self.times) if self.history.exit_status == 0 else 1):
            rest = self.bodies.can_rest(index, self.amplitudes[index])
            if rest is None:
                return
            if index == 1 and not self.motion.any():
                self.motion = rest
            lam = self.multipliers
            growth = self._growth(index)
            load = self._load(index, self.motion + growth * (self.motion - self.older_motion), self.slid.u_t)
            sliding = self.rows.sliding(lam, self.rows.friction_bound(lam))
            step = self._step(index, load, lam + growth * (lam - self.older), sliding)
            self.multipliers, self.older = step.multipliers, lam
            self.motion, self.older_motion = step.weights[self.operator.structure.patterns :], self.motion
            self.slid.advance(step.gradient)
            self._record(step)
            self.history.seconds += time.perf_counter() - clock
            yield step
            clock = time.perf_counter()
            if self.history.exit_status:
                return

    def _load(self, index: int, motion: np.ndarray, u_t: np.ndarray) -> Load:
        """Load of a step that starts from rigid motions `motion` and tangential displacements u_t."""
        weights = np.concatenate([self.amplitudes[index], motion])
        d = self.operator.load_response(weights)
        d[self.rows.normal] -= self.rows.gap
        d[self.rows.tangential] -= u_t
        return Load(weights, d)

    def _preload(self) -> np.ndarray:
        """Multipliers of the frictionless equilibrium at time 0, whose displacement becomes u_0."""
        op, rows, contact = self.operator, self.rows, self.operator.structure.contact
        load, x = self._load(0, self.motion, np.zeros(len(rows.tangential))), np.zeros(op.owned)
        self.scales.d = self.qp.extent(load.d)
        limits = rows.limits_at(op.owned, np.zeros(len(rows.tangential)))
        self.qp.tol = self.settings.rtol * self.scales.d
        for iteration in range(1, self.settings.max_fixed_point + 1):
            result = self.qp.solve(0, iteration, load.d, limits, x, 0.0)
            x = result.x
            if self.history.exit_status or self.bodies.imbalance(load, x) <= self.settings.friction_rtol:
                break
            self.bodies.follow(load, x)
        else:
            self.history.end(4, f"preload: no equilibrium of the free bodies in {iteration} iterations")
        self.motion = load.weights[op.structure.patterns :]
        self.slid.u_t = -result.gradient[rows.tangential]
        found = np.zeros(len(contact.gid))
        found[rows.tangential_node] = self.slid.u_t
        contact.initial[:] = np.sum(op.comm.allgather(found), axis=0)
        return result.x

    def _growth(self, index: int) -> float:
        """Part of the last change of the multipliers by which a step starts from them, that of the change of the load.

        Exact as long as the response is proportional to the load (a contact zone that is not changing under
        loading); on reversal the step starts from the previous one.
        """
        if self.settings.predictor == "previous" or index < 2:
            return 0.0
        older, last, new = self.amplitudes[index - 2 : index + 1]
        before, now = last - older, new - last
        size = before @ before
        return min(max(now @ before / size, 0.0), 2.0) if size > 0 else 0.0

    def _record(self, step: Step) -> None:
        counts, worst = self.history.counts, self.history.residuals
        counts["fixed_point_iterations"] += step.fixed_point_iterations
        counts["dual_multiplications"] = self.operator.products - counts["dual_multiplications_setup"]
        if self.qp.relaxation is not None:
            counts["contact_block_products"] += self.qp.relaxation.products
            self.qp.relaxation.products = 0
        for name, value in step.residuals.items():
            worst[name] = max(worst.get(name, 0.0), value)
        self.history.steps = step.index
        self.history.contraction = max(self.history.contraction, step.contraction)  # which NaN leaves as it is

    # ---- one time step -----------------------------------------------------------------------
    def _step(self, index: int, load: Load, start, sliding) -> Step:
        """One time step, with a tighter QP tolerance until displacements are good to `primal_rtol`.

        The tolerance on the projected gradient is relative to ||d||, the displacements of the body without
        contact and glue, which may be far larger than those of the solution.
        """
        op, settings, rows = self.operator, self.settings, self.rows
        self.scales.d = max(self.scales.d, self.qp.extent(load.d))
        self.qp.tol = settings.rtol * self.scales.d
        products, trace = op.products, Trace()
        x = rows.follow(rows.pressing(start), sliding)
        gradient = op.apply(x) - load.d
        for _ in range(TIGHTENINGS + 1):
            x, gradient, sliding = self.fixed_point.find(index, load, x, gradient, sliding, trace)
            x, gradient, moved = self._into_cone(load.d, x, gradient, sliding)
            residuals = self._residuals(load, x, gradient)
            poor = max(residuals["gluing"], residuals["penetration"])
            if self.history.exit_status or poor <= settings.primal_rtol:
                break
            self.qp.tol *= 0.1
        else:
            self.history.warnings.append(f"step {index}: gluing or penetration residual {poor:.1e} above "
                                         f"{settings.primal_rtol:.0e} although MPRGP was tightened")
        self._examine(index, load, x, gradient, trace)
        self.bodies.note_loose_motion(index, x)
        return Step(index, float(self.times[index]), load.weights, x, gradient, friction.status(rows, x),
                    rows.friction_bound(x), trace.iterations, op.products - products, trace.contraction, residuals, moved)

    def _examine(self, index: int, load: Load, x, gradient, trace: Trace) -> None:
        """Look for other solutions of the step where there is reason to; see `uniqueness`."""
        found, choice, nodes = self.uniqueness, self.settings.uniqueness, self.condensation.n
        self.doubtful = self.doubtful or trace.fallback
        if not found.frictional or self.history.exit_status or found.failure:
            return
        if not worthwhile(choice, nodes, self.largest_friction, self.doubtful):
            return
        if nodes > globalization.CONDENSED_NODES:
            found.failure = f"{nodes} contact nodes, more than {globalization.CONDENSED_NODES}"
            return
        try:
            problem = self.condensation.problem(load, x, gradient)
        except NotConverged as problem:
            found.failure = str(problem)
            return
        contact = self.operator.structure.contact
        found.examine(index, problem, self.condensation.gather(x), contact.weight[contact.normal_row >= 0])

    def _into_cone(self, d, x, gradient, sliding):
        """Multipliers put exactly into the cone of their own pressures, their gradient, the change.

        The last QP was solved with the bound of the iterate before. Nodes that slid stay on the bound and
        the others inside it, so that the active set the QP has found is kept.
        """
        final, renewed = self.qp.placed(self.rows.follow(x, sliding), d, x, gradient)
        return final, renewed, final - x

    def _residuals(self, load: Load, x, gradient) -> dict:
        """KKT residuals of the step's state."""
        op = self.operator
        left = projected_gradient(x, gradient, *self.rows.limits(op.owned, x))
        self.scales.displacement = max(self.scales.displacement, op.corner_displacement(x, load.weights),
                                       CANCELLED * self.scales.d)
        found = friction.kkt_residuals(self.rows, x, gradient, self.qp.size(left), self.scales, op.comm)
        return found | {"equilibrium": self.bodies.imbalance(load, x, note=True)} if op.modes else found

    # ---- checkpoints ---------------------------------------------------------------------------
    def snapshot(self) -> dict | None:
        """All that the next step depends on and that the run reports, for `restore`, on rank 0; collective.

        Arrays follow the global numbering of dual rows and contact nodes, numbers are exact: any number of ranks
        goes on from it with the same bits.
        """
        op, contact, history = self.operator, self.operator.structure.contact, self.history
        parts = op.comm.gather((self.multipliers, self.older, self.rows.tangential_node,
                                self.slid.u_t, self.slid.way, self.rows.bound))
        if parts is None:
            return None
        multipliers, older, node, *values = map(np.concatenate, zip(*parts))
        by_node = np.zeros((3, len(contact.gid)))
        by_node[:, node] = values
        product, step, iteration, kind, residual = zip(*history.log) if history.log else ((),) * 5
        return {"multipliers": multipliers, "older": older, "u_t": by_node[0], "way": by_node[1], "bound": by_node[2],
                "initial": contact.initial, "norm_bound": float(self.qp.bound), "products": op.products,
                "scales": {**asdict(self.scales), "work": np.asarray(self.scales.work)},
                "motion": self.motion, "older_motion": self.older_motion,
                "log_numbers": np.array([product, step, iteration], np.int64), "log_kind": np.array(kind, str),
                "log_residual": np.array(residual, float), "fallbacks": history.fallbacks.steps,
                "history": {name: getattr(history, name) for name in KEPT}, "doubtful": self.doubtful,
                "uniqueness": {**asdict(self.uniqueness), "several": list(self.uniqueness.several.items())}}

    def restore(self, state: dict) -> None:
        """Continue from a `snapshot` of the same problem and settings; the same on every rank."""
        mine, node, history = slice(*self.operator.structure.row_range), self.rows.tangential_node, self.history
        self.multipliers, self.older = state["multipliers"][mine], state["older"][mine]
        self.motion, self.older_motion = state["motion"], state["older_motion"]
        self.slid.u_t, self.slid.way, self.rows.bound = (state[name][node] for name in ("u_t", "way", "bound"))
        self.operator.structure.contact.initial[:] = state["initial"]
        self.qp.bound, self.doubtful = state["norm_bound"], state["doubtful"]
        for name, value in state["scales"].items():
            setattr(self.scales, name, value)
        self.uniqueness = Uniqueness(**{**state["uniqueness"], "several": dict(state["uniqueness"]["several"])})
        self.operator.products = state["products"]
        history.log.extend(zip(*state["log_numbers"].tolist(), state["log_kind"].tolist(), state["log_residual"].tolist()))
        history.fallbacks.steps = state["fallbacks"]
        for name in KEPT:
            setattr(history, name, state["history"][name])
