"""The fixed point lambda_n = Phi(lambda_n) for local Coulomb friction in one time step.

Successive approximations with QPs that are solved only as far as it pays; where they do not
contract the methods of `globalization` take over. Bodies without support follow their springs in
the same iterations.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import NotConverged
from ..qp.anderson import Anderson, gives_up
from ..qp.box import clipped, projected_gradient
from ..text import step_name
from . import globalization
from .condensation import Condensation
from .condensed_search import CondensedSearch, without_solution
from .friction_qp import FrictionQP
from .shortcut import Shortcut
from .slip import SlipState
from .step import WINDOW, Load, Trace, Unfinished

SETTLING = 0.3  # relative change of friction bounds below which free bodies follow their springs
DIVERGED = 1e8  # growth of the residual at which the contact problem with F_cc is given up
CORRECTIONS = 30  # friction bounds in the contact problem with F_cc, at most
CORRECTION = 0.1  # its residual, relative to the whole one before
BALANCED = 0.1  # its imbalance of bodies without support, relative to the one before
HEADWAY = 1.0  # growth of this imbalance in a QP above which the corrector moves them no more
MANY = 200  # products of a search that are not many, however few unknowns it has
ASTRAY = 1e6  # growth of multipliers after which they are no start: their rounding hides the loads


@dataclass
class _Approximation:
    """Where the successive approximations of a step are."""

    x: np.ndarray
    gradient: np.ndarray | None
    sliding: np.ndarray
    before: int  # iterations, and products with F, before the first of them
    products: int
    eliminates: bool  # where stiffness jumps, once
    start: tuple = ()  # of the QP at hand: multipliers and gradient
    taken: int = 0  # QPs that were solved
    loose: float = np.inf  # imbalance of bodies without support, and that before
    last: float = np.inf

    @property
    def state(self) -> tuple:
        """Multipliers, gradient and the rows that slide."""
        return self.x, self.gradient, self.sliding


class FixedPoint:
    """Multipliers that solve the QP with the friction bound of their pressures. Collective."""

    def __init__(self, qp: FrictionQP, bodies, slip: SlipState, condensation: Condensation):
        """`bodies`: FreeBodies of free_bodies.py, or SupportedBodies."""
        self.qp, self.bodies, self.slip, self.condensation = qp, bodies, slip, condensation
        self.operator, self.rows = qp.operator, qp.rows
        self.settings, self.history = qp.settings, qp.history
        coupled = len(self.rows.tangential) > 0 and not self.rows.bound_is_given
        self.search = CondensedSearch(qp, bodies, slip, condensation)
        self.shortcut = Shortcut(qp, bodies, slip, condensation)
        self.corrects_motion, self.rtol = False, self.settings.friction_rtol
        self.coupled = bool(self.operator.comm.allreduce(int(coupled)))

    def find(self, index: int, load: Load, x, gradient, sliding, trace: Trace, rtol: float):
        """Successive approximations lambda_n -> Phi(lambda_n), each QP solved as far as it pays.

        The first QPs would be solved far beyond the error of their friction bound; each reduces its
        initial residual by `inner_rtol`, and the last one meets the tolerance. Bodies without
        support move in the same iterations. `rtol` is the relative change of pressures and friction
        bounds, and the imbalance of bodies, to be reached. Starts from and returns multipliers,
        gradient and the rows that slide. Raises Unfinished.
        """
        self.rtol, self.corrects_motion = rtol, self.operator.modes > 0
        now = _Approximation(x, gradient, sliding, trace.iterations, self.operator.products,
                             self.search.stiff)
        secants, place = self.bodies.secants(), self.bodies.place(load)
        found = (self.shortcut.begins(load, trace, x, gradient, rtol)
                 and self.shortcut.solution(index, load, x, trace, rtol))
        while not (found or trace.fallback):
            trace.iterations += 1
            now.start = self._start(load, now.x, now.gradient, now.sliding, trace)
            try:
                result, change = self._solve(index, load, now, trace)
            except Unfinished as failure:
                if self.operator.modes:
                    break  # bodies that nothing balances have run away
                start, gradient = now.start
                return self.condensed(index, load, self._no_further(start, x), gradient,
                                      now.sliding, trace, rtol, failure)
            if result.status == "stopped":
                found = self.shortcut.solution(index, load, now.x, trace, rtol)
                continue
            found = self._found(index, load, now, result, change, trace)
            if not found:
                self._go_on(load, now, change, secants, trace)
        if found:
            return found
        latest = self._no_further(self.rows.follow(now.x, now.sliding), x)
        return self._globalise(index, load, latest, place, trace)

    def _solve(self, index: int, load: Load, now: _Approximation, trace: Trace):
        """The next QP, from its start: its result, where approximations are `now`, their change.
        """
        start, gradient = now.start
        bound = self.rows.friction_bound(start)
        reduction = self._reduction(trace) if self._repeats else 0.0
        result, change = self._approximate(index, trace, load.d, start, bound, reduction,
                                           self.coupled, gradient, self.shortcut.patience(trace))
        now.x, now.gradient = result.x, result.gradient
        now.sliding = self.rows.sliding(result.x, bound)
        return result, change

    @property
    def _repeats(self) -> bool:
        """Whether a step takes more than one QP."""
        return self.coupled or self.operator.modes > 0

    def _found(self, index: int, load: Load, now: _Approximation, result, change: float,
               trace: Trace):
        """The solution where the last QP is it, or where another method costs less; else None.

        Raises Unfinished where no more of the few approximations that are allowed are left.
        """
        if not self._repeats:
            self.shortcut.learn(now.x, self.operator.products - now.products)
            return now.state
        now.last, now.loose = now.loose, self.bodies.imbalance(load, now.x)
        trace.changes.append(max(change, now.loose * self._pressing(now.x)))
        if now.loose <= self.rtol and self._settled(change, result):
            return now.state
        now.taken += 1
        spent = self.operator.products - now.products
        if self.shortcut.pays(trace, now.x, self._target(now.x), spent, now.taken):
            if found := self.shortcut.solution(index, load, now.x, trace, self.rtol):
                return found
        if self._tired(now, trace) and trace.iterations - now.before <= 2 * WINDOW:
            error = NotConverged(f"{step_name(index)}: no fixed point of the friction bound in "
                                 f"{trace.iterations} iterations")
            raise Unfinished(error, now.x, now.gradient)
        if now.eliminates and spent > self._exhausting:
            now.eliminates = False
            return self._eliminated(index, load, now.x, trace)
        return None

    def _tired(self, now: _Approximation, trace: Trace) -> bool:
        """Whether all approximations that are allowed were made."""
        return trace.iterations - now.before >= self.settings.max_fixed_point

    def _go_on(self, load: Load, now: _Approximation, change: float, secants, trace: Trace):
        """Moves bodies without support, and says how the next QP is solved, if not by others."""
        if now.loose > self.rtol and change <= SETTLING * self._pressing(now.x):
            # before, friction is too far off to say where to
            now.gradient = now.gradient - self.bodies.lead(load, now.x, secants)
        # for given gluing multipliers bodies may move too far, and back again after the next QP
        self.corrects_motion = self.corrects_motion and now.loose <= HEADWAY * now.last
        # by the errors of QPs left early, or by starts that answer to the gluing forces of the
        # iteration before? With neither they must stall again
        if trace.stalls and not trace.exact:
            trace.exact, trace.changes = True, []
        trace.fallback = trace.stalls or self._tired(now, trace)

    def _no_further(self, x: np.ndarray, first: np.ndarray) -> np.ndarray:
        """x, or the `first` multipliers of the step where those in x have grown beyond all bounds.
        """
        largest, qp = self.qp.largest(x), self.qp
        return x if largest <= ASTRAY * max(qp.largest(first), qp.scales.d) else first

    def _start(self, load: Load, x, gradient, sliding, trace: Trace):
        """Start of the next QP, x at the friction bound of its pressures, and its gradient."""
        start, before = self.rows.follow(x, sliding), load.d.copy()
        if self.settings.corrector == "contact":
            relaxation = self.qp.accelerators.relaxation
            # where rounding ends QPs early a start saves them hundreds of products
            if relaxation is not None and (self.operator.uneven or not trace.exact):
                start = self._correct(load, start, relaxation.moved(start, x, gradient), relaxation)
            elif relaxation is None and self.condensation.whole and not self.rows.bound_is_given:
                x, gradient = self.qp.placed(start, load.d, x, gradient)
                return self.condensation.solution(load, x, gradient, sliding) or (x, gradient)
        if self.operator.modes:  # d has changed where bodies without support moved
            gradient = gradient - (load.d - before)
        return self.qp.placed(start, load.d, x, gradient)

    def _correct(self, load: Load, x, gradient, relaxation):
        """x with the contact multipliers that solve contact and friction, gluing ones unchanged.

        Successive approximations as in `find`, with F_cc for F, and bodies without support follow
        as soon as these have settled, as long as that leaves them better balanced: beyond, they may
        lose contact, and nothing would stop them. `gradient` need be right only on the contact
        rows. Where they do not settle: the best of them.
        """
        rows, qp, aim = self.rows, self.qp, None
        for _ in range(CORRECTIONS):
            limits, bound = rows.limits(self.operator.owned, x), rows.friction_bound(x)
            residual = projected_gradient(x, gradient, *limits)
            if aim is None:
                whole, loose = qp.size(residual), self.bodies.imbalance(load, x)
                aim = max(0.5 * qp.tol, CORRECTION * whole)
                balanced, best, least = max(0.5 * self.rtol, BALANCED * loose), x, np.inf
                placed, loose = None, np.inf
            residual[rows.gluing] = 0.0
            left = qp.size(residual)
            if left > DIVERGED * whole:
                break
            if left < least:
                best, least = x, left
            if whole <= qp.tol or left <= aim:
                before, loose = loose, self.bodies.imbalance(load, x)
                if not self.corrects_motion or loose <= balanced:
                    return x
                if loose > HEADWAY * before:
                    self.bodies.bring(load, placed[1])
                    return placed[0]
                placed = x, self.bodies.place(load)
                gradient, least = gradient - self.bodies.follow(load, x), np.inf
            solved, gradient = relaxation(x, gradient, limits, 0.5 * aim)
            x = rows.follow(solved, rows.sliding(solved, bound))
            gradient = relaxation.moved(x, solved, gradient)
        return best

    def _approximate(self, index, trace, d, x, bound, reduction, coupled=True, gradient=None,
                     gives_up=None):
        """Result of the QP with friction bounds `bound` from x, change of pressures and bounds.

        `gives_up` as FrictionQP.solve takes it.
        """
        limits = self.rows.limits_at(len(x), bound)
        inside = clipped(x, *limits)
        x, gradient = self.qp.placed(inside, d, x, gradient)
        result = self.qp.solve(index, trace.iterations, d, limits, x, reduction, gradient,
                               gives_up)
        if not coupled:
            return result, 0.0
        self.slip.renew_coefficient(self._slides(result, bound))
        return result, max(self.search.norm(self.rows.normal,
                                            result.x[self.rows.normal] - x[self.rows.normal]),
                           self.search.norm(self.rows.tangential,
                                            self.rows.friction_bound(result.x) - bound))

    def _slides(self, result, bound: np.ndarray) -> np.ndarray:
        """The gradient of a QP with friction bounds `bound`, without what sticks.

        There it is but the residual of a QP that was left early: taken for slip, it could weaken
        friction that holds.
        """
        gradient, t = result.gradient.copy(), self.rows.tangential
        along = self.rows.sliding(result.x, bound) * gradient[t] < 0
        gradient[t] *= along | (bound == 0)  # what has no bound goes where it is moved
        return gradient

    def _reduction(self, trace: Trace) -> float:
        """Residual reduction of a QP of the fixed point."""
        return 0.0 if trace.exact else self.settings.inner_rtol

    def _settled(self, change: float, result) -> bool:
        return change <= self._target(result.x) and result.residual <= self.qp.tol

    def _target(self, x) -> float:
        """What changes of pressures and friction bounds are to fall below, near x."""
        pressing = max(self._pressing(x), self.qp.scales.faded("pressing"))
        return self.rtol * pressing

    def place(self, load: Load) -> tuple[np.ndarray, np.ndarray | None]:
        """Rigid motions (modes,) and states of corners, None without corners, to come `back` to."""
        corners = self.rows.corners
        return self.bodies.place(load), None if corners is None else corners.acting.copy()

    def back(self, load: Load, place: tuple[np.ndarray, np.ndarray | None], state: tuple) -> tuple:
        """The `state` (multipliers, gradient, ..) from before, with bodies and corners in `place`.

        Corners stay as they are where it says nothing of them. Collective.
        """
        motion, acting = place
        self.bodies.bring(load, motion)
        self.slip.renew_coefficient(state[1])
        if acting is not None and (acting != self.rows.corners.acting).any():
            self.rows.corners.acting = acting
            self.condensation.select()
        return state

    # ---- where they do not contract ------------------------------------------------------------
    def _globalise(self, index: int, load: Load, x, place: np.ndarray, trace: Trace):
        """The fixed point by the methods of `globalization`, in their order; see `find`.

        Each starts with bodies in their `place` (modes,).
        """
        for method in (self._accelerate, self._eliminate):
            failed = solution = None
            # those before may have left bodies far away, whose rounding hides small forces
            self.bodies.bring(load, place)
            load.forget()
            try:
                solution = method(index, load, x, trace)
            except Unfinished as problem:  # a QP with bounds that are those of no solution
                if problem.final:
                    raise
                failed = problem
            if solution is not None:
                return solution
        if failed and self.bodies.imbalance(load, x) <= self.rtol:
            raise failed
        raise self._without_solution(index, load, x)

    def condensed(self, index: int, load: Load, x, gradient, sliding, trace: Trace, rtol: float,
                  failure: Unfinished | None = None):
        """As `find`, by the condensed problem alone, from x. Raises `failure` without a solution.

        Rounding ends QPs early where stiff parts hang on soft ones: their contact forces follow
        from displacements of many digits less, by elimination with as many digits as there are.
        """
        self.rtol = rtol
        solution = self._eliminated(index, load, x, trace)
        if solution is None:
            raise failure or self._without_solution(index, load, x)
        return solution

    def _eliminate(self, index: int, load: Load, x, trace: Trace):
        """As `find`, by the condensed problem; None if it fails. Raises Unfinished."""
        return self.search.solution(index, load, x, trace, self.rtol)

    def _eliminated(self, index: int, load: Load, x, trace: Trace):
        """As `_eliminate`. Raises Unfinished only where it has shown that there is no solution."""
        try:
            return self._eliminate(index, load, x, trace)
        except Unfinished as failure:
            if failure.final:
                raise
            return None

    def _without_solution(self, index: int, load: Load, x) -> Unfinished:
        return without_solution(self.qp, self.bodies, index, load, x, self.rtol)

    @property
    def _exhausting(self) -> int:
        """Products of a search from which elimination is tried where stiffness jumps.

        Conjugate gradients are done with a face after as many as it has unknowns, but for rounding.
        """
        return max(MANY, 2 * self.operator.structure.dual_dofs)

    def _accelerate(self, index: int, load: Load, x, trace: Trace):
        """Anderson acceleration of friction bounds and of motions, as forces of their springs.

        None if it makes no headway.
        """
        rows, op, changes, j = self.rows, self.operator, [], len(self.rows.tangential)
        softness = op.rho if op.modes else 1.0
        point = np.append(rows.friction_bound(x), self.bodies.place(load) / softness)
        method = Anderson(lambda a, b: self.search.dot(a[:j], b[:j]) + a[j:] @ b[j:])
        while not (changes and gives_up(changes)):
            trace.iterations += 1
            bound = np.maximum(point[:j], 0.0)
            self.bodies.bring(load, softness * point[j:])
            reduction = self._reduction(trace)
            result, change = self._approximate(index, trace, load.d, x, bound, reduction)
            x, sliding = result.x, rows.sliding(result.x, bound)
            loose = self.bodies.imbalance(load, x)
            changes.append(max(change, loose * self._pressing(x)))
            if loose <= self.rtol and self._settled(change, result):
                self.history.fallbacks.note(globalization.ANDERSON, index)
                return x, result.gradient, sliding
            net, _ = op.imbalance(x, load.weights)
            point = method.next(np.append(bound, point[j :]),
                                np.append(rows.friction_bound(x), point[j :] + net))
        return None

    def _pressing(self, x: np.ndarray) -> float:
        """Norm of the normal multipliers in x."""
        return self.search.norm(self.rows.normal, x[self.rows.normal])
