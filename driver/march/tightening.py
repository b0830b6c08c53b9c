"""Tightens the tolerances of a step until the residuals of its solution are small enough.

What the QP and the fixed point stop at is relative to displacements that may be far larger than
those of the solution (without gluing the body would hang on its corners). So both are tightened
until the residuals of the solution itself are below `primal_rtol` and the imbalance of free bodies
below `friction_rtol`. Where that leads no further the condensed problem is tried: elimination keeps
digits that products lose where stiffness jumps or friction jams. Last comes the best state that
will do if as much is rounding as products show.

Where stiffness jumps by much, states are judged by refined displacements, the QPs that follow are
of what these say (a defect correction: products with F stand for the exact ones near the latest
multipliers), and an answer that will do is followed by a finer one.
"""

import numpy as np

from ..errors import DriverError, NoSolution, NotConverged
from ..text import step_name
from . import outlook
from .slip import FAR
from .step import Load, Trace, Unfinished

LAST_PART = 1e-6  # of tolerances, below which tightening must at least halve the residuals
LAST_FRICTION = 1e-4  # likewise, of that of the fixed point
ROUNDED = 1e-14  # part of forces by which they change or stay unbalanced without end
# part of the residuals asked for to which QPs go on where stiffness jumps by much: what stiff
# material deforms by counts with triangles that are partly soft, its forces with few digits then
FINER = 0.01
ACCEPTABLE = 1e-4  # residuals up to which another tolerance is offered: contact forces to 4 digits
TENTH, BELOW = 0.1, 0.3  # QPs are tightened by that at least, or to so much of what is asked for
MUCH = 0.01  # by which they are tightened where forces answer to what they leave by stiffness
IDLE = 0.5  # part of the least residual so far above which tightening has not helped
NEARLY = 1e-3  # imbalance of bodies without support up to which exacter QPs may settle them


class Tightening:
    """Of the tolerances in one step. Collective over the operator's communicator.

    A state is multipliers, their gradient and the rows that slide; an `answer` multipliers,
    gradient, last change and residuals.
    """

    def __init__(self, march, index: int, load: Load, trace: Trace):
        """`march`: the QuasistaticSolver whose step it is."""
        self.march, self.index, self.load, self.trace = march, index, load, trace
        self.operator, self.qp, self.rows, self.bodies = (
            march.operator, march.qp, march.rows, march.bodies)
        self.residuals, self.fixed_point = march.residuals, march.fixed_point
        self.find, self.condensed = march.corners.find, march.corners.condensed
        # parts of the tolerances
        self.of_qp = outlook.foresight(march.loads, index) if march.largest_friction else 1.0
        self.of_friction = self.of_qp
        self.motion, self.first = self.bodies.place(load), None
        self.best, self.answer = np.inf, None  # least so far of worst residuals over what is asked
        self.nearest = np.inf, "", np.inf  # the same of all tries, its name, the residual
        # answers that will do, as `_kept`: one that a finer one is looked for beyond, and one that
        # what products round off admits
        self.enough = self.rounded = None
        # what ended the search for a fixed point, if products hide loads by rounding there; what
        # ended it before the condensed problem was tried
        self.stop, self.hidden, self.why = None, False, None

    def earned(self, x: np.ndarray, gradient: np.ndarray, sliding: np.ndarray) -> tuple:
        """The answer whose residuals are as small as asked for, from a state.

        Raises Unfinished.
        """
        state = self.first = x, gradient, sliding
        # the step before had no forces either?
        if self.operator.modes and self.index > 1 and not self.residuals.acts(x):
            self.answer = self.residuals.free_of_forces(self.load, x)
        while self.answer is None:
            try:
                state, self.stop = self._found(*state), None
            except Unfinished as failed:
                state = self._after(failed)
                if self.stop is None:
                    continue
            state = self._judged(*state)
        return self.answer

    @property
    def _eliminates(self) -> bool:
        return self.find == self.condensed

    @property
    def _by_newton(self) -> bool:
        """Whether the state is a solution of Newton's method for the contact rows, whose residuals
        are what products, or its system, round off: once it has been found again to a tolerance
        below them, no tighter QPs help.
        """
        found = bool(self.trace.shortcut) and not self._eliminates
        return found and self.march.condensation.elimination is not None

    def _found(self, x, gradient, sliding) -> tuple:
        """The next state. Raises Unfinished."""
        self.qp.aim(self.of_qp, x)
        self.trace.refined = self.operator.uneven
        rtol = max(self.of_friction * self.march.settings.friction_rtol, ROUNDED)
        return self.find(self.index, self.load, x, gradient, sliding, self.trace, rtol)

    def _after(self, failed: Unfinished) -> tuple:
        """The state in which the search `failed`, which may do, and `stop` for what ended it.

        Without `stop` there is an answer, or QPs are to be exacter. Raises it if it may not.
        """
        x, self.stop = failed.x, None
        state = x, failed.gradient, self.rows.sliding(x, self.rows.friction_bound(x))
        self.answer = self._without_forces(x)
        if self.answer is None and self.enough is not None:
            self.answer = self._back_to(self.enough)
        if self.answer is None and self.rounded is not None and self._eliminates:
            self.answer = self._back_to(self.rounded)
        if self.answer is not None:
            return state
        imbalance = self.bodies.imbalance(self.load, x)
        settles = self.operator.modes > 0 and imbalance <= NEARLY
        # a tolerance that no arithmetic reaches is no matter of what stiff parts hide
        reached = self.march.settings.rtol >= np.finfo(float).eps
        self.hidden = reached and not self._eliminates and self.qp.hides(x)
        if failed.final or self.of_qp == 1.0 and not (settles or self.hidden):
            failed.error = failed.error if failed.final or not self.why else self.why
            raise failed
        if settles and self.of_qp > LAST_PART:  # forces answer to what QPs leave by stiffness
            self.of_qp *= MUCH
            self.trace.again()
        else:
            self.stop = failed.error
        return state

    def _without_forces(self, x) -> tuple | None:
        """An answer without forces: bodies may stay where the step starts, or were drawn."""
        modes = self.operator.modes
        for place in (self.motion, np.zeros(modes))[: 1 + (modes > 0)]:
            answer = self.residuals.free_of_forces(self.load, x, place)
            if answer is not None:
                return answer
        return None

    def _judged(self, x, gradient, sliding) -> tuple:
        """The state to go on from; `answer` if none is needed. Raises Unfinished."""
        load, residuals = self.load, self.residuals
        if self.operator.modes and self.operator.minimum(
                -load.farthest) < -FAR * self.march.scales.displacement:
            gradient = None  # it has followed bodies that went so far: their rounding is in it
        x, gradient, moved = self.march.into_cone(load.d, x, gradient, sliding)
        if self.trace.refined:  # as what is reported of it
            gradient = self._to_all_digits(x)
        found = residuals.of(load, x, gradient, exact=True)
        self.answer = residuals.free_of_forces(load, x) if residuals.faded(x) else None
        excess = residuals.excess(found)
        worst, name = max((value, name) for name, value in excess.items())
        idle = worst > IDLE * self.best
        if self.answer is None and worst <= 1:
            if self._may_be_finer(worst, idle):
                self.enough, self.best = self._kept(x, gradient, moved, found), worst
                self._tighten(excess, worst / FINER, idle)
                return x, gradient, sliding
            self.answer = x, gradient, moved, found
        elif self.answer is None and self.enough is not None:
            self.answer = self._back_to(self.enough)
        if self.answer is not None:
            return x, gradient, sliding
        if self.operator.levels > 1 and worst < self.best:
            likely = residuals.of(load, x, gradient)
            if residuals.enough(likely):
                self.rounded = self._kept(x, gradient, moved, likely)
        self.best = min(self.best, worst)
        self.nearest = min(self.nearest, (worst, name, found[name]))
        stays = NotConverged(self._said(*self.nearest[1:]))
        if isinstance(self.stop, NoSolution) and excess.get("equilibrium", 0.0) <= 1:
            self.stop = stays  # none was found to more digits than were asked for
        if self.stop or idle or self._by_newton and self.trace.refined:
            state = self._otherwise(x, gradient, sliding, stays)
            if state is not None:
                return state
        self._tighten(excess, worst, idle)
        if self._by_newton and self.qp.asked > 0:
            # it may be far below a tolerance already, which then asks for nothing
            left = self.qp.left(x, gradient) / self.qp.asked
            self.of_qp = min(self.of_qp, BELOW / worst * left)
        return x, gradient, sliding

    def _said(self, name: str, residual: float) -> str:
        """That the step came no nearer than to a residual, and which tolerance accepts it."""
        said = (f"{step_name(self.index)}: the {name} residual stays at {residual:.1e}, above the "
                f"tolerance of {self.residuals.asked(name):.0e}")
        if residual > ACCEPTABLE:
            return said
        option = self.residuals.option(name).upper()
        return f"{said}; {option}={10.0 ** np.ceil(np.log10(residual)):.0e} accepts that"

    def _may_be_finer(self, worst: float, idle: bool) -> bool:
        """Whether QPs go on from an answer that will do."""
        ended = idle or self.stop is not None or self._eliminates
        return self.operator.uneven and worst > FINER and not ended

    def _to_all_digits(self, x: np.ndarray) -> np.ndarray:
        """Gradient at x by refined displacements, which the QPs that follow see near x, too.

        Springs move nothing in these: bodies go where their springs have moved them.
        """
        op, load = self.operator, self.load
        if op.modes and not self._eliminates:
            self.bodies.follow(load, x)
        gradient = op.gradient(x, load)
        if not self._eliminates:
            load.correct(op.apply(x) - load.d - gradient + op.by_springs(x, load.weights))
        return gradient

    def _otherwise(self, x, gradient, sliding, stays: DriverError) -> tuple | None:
        """The state to go on from where tightening leads no further; None if it still may.

        `stays` says which residual is too large. Raises Unfinished.
        """
        stop, stiff = self.stop, self.operator.levels > 1
        if not self._eliminates and stop and self.hidden and self.rounded is None:
            # friction that jams hides the loads in its forces' rounding
            state = self.fixed_point.back(self.load, (self.motion, None), self.first)
            self._eliminate(stop)
            self.best, self.of_qp = np.inf, 1.0
            return state
        if not self._eliminates and (self.rounded is not None or stop and stiff):
            self._eliminate(stop)
            return x, gradient, sliding
        if self.rounded is not None:
            self.answer = self._back_to(self.rounded)
            return x, gradient, sliding
        loose = not self._eliminates and self.of_friction > LAST_FRICTION
        if not (stop or self._by_newton) and (loose or self.of_qp > LAST_PART):
            return None
        if stop or self._eliminates:  # or forces of bodies that nothing holds are rounding alone
            self.answer = self._without_forces(x) if self.operator.modes else None
            if self.answer is None and isinstance(stop, NoSolution):
                raise Unfinished(stop, x, gradient)
            if self.answer is None:
                raise Unfinished(stays, x, gradient, near=self.nearest[2] <= ACCEPTABLE)
            return x, gradient, sliding
        if self.nearest[2] <= ACCEPTABLE and self.march.more_digits.likely:
            raise Unfinished(stays, x, gradient, near=True)
        self._eliminate(None)
        return x, gradient, sliding

    def _kept(self, *answer) -> tuple:
        """The `answer` with its place, scales and whether it is refined, to come back to."""
        return (self.fixed_point.place(self.load), answer, vars(self.march.scales).copy(),
                self.trace.refined)

    def _back_to(self, kept: tuple) -> tuple:
        """An answer `_kept` before; corners are decided by its scales, too."""
        place, answer, scales, self.trace.refined = kept
        vars(self.march.scales).update(scales)
        return self.fixed_point.back(self.load, place, answer)

    def _eliminate(self, why: DriverError | None) -> None:
        """Try the condensed problem, whose passes end where they lead no further; so its tolerance
        is that of the step. `why`: what is to be said if it fails.
        """
        self.find, self.why, self.of_friction = self.condensed, why, 1.0

    def _tighten(self, excess: dict[str, float], worst: float, idle: bool) -> None:
        """Tighten the next QPs by what the `worst` residual misses, tenfold at least."""
        tighter = min(TENTH, BELOW / worst)
        self.of_qp *= tighter
        # not QPs alone are to blame: what forces still change by moves stiff parts, too
        if idle or max(excess["gluing"], excess["penetration"]) <= 1:
            self.of_friction *= tighter
