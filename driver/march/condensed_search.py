"""A step by its condensed contact problem, corrected until it solves the whole.

Every pass solves the contact rows, condensed, for the residual that they have at the present
multipliers x; then the gluing multipliers follow. The change y_c of the contact multipliers and
the residual r_g of the gluing rows ask for

    F_gg y_g = -F_gc y_c - r_g,

which is solved to digits of the change, not of x: iterative refinement (N. Higham, Accuracy and
Stability of Numerical Algorithms, SIAM 2002, chapter 12). Where stiffness jumps, what products
round off may be more than stiff parts deform by. There residuals are those of refined displacements
(feti/extended_precision.py), and once the condensed problem has a solution near x, contact rows are
corrected by increments, too: what its compliance rounds off slows passes down and is in no result.
"""

import numpy as np

from ..errors import NoSolution, NotConverged
from ..qp.anderson import Anderson
from ..qp.coefficients import consistent
from ..qp.correction import corrected
from ..qp.box import projected_gradient
from ..text import step_name
from . import globalization
from .step import Load, Trace, Unfinished

PASSES = 30  # corrections of a solution of the condensed contact problem
HALF = 0.5  # of what it misses, which a correction leaves at most
IDLE = 4  # corrections that leave more: rounding, and residuals say whether it will do
ROUNDED = 1e-14  # part of forces that is rounding
LAST_DIGITS = 16 * np.finfo(float).eps  # of forces that are sums of a few
LATER = 1  # passes after which gluing rows have answered to what the one before rounded off
DIGITS = 1e-3  # of a change, which gluing multipliers answer to, ...
SHARE = 0.3  # ... or this part of the tolerance, if that is less, ...
FINEST = 1e-13  # ... but no less than this part of the change
LAW_SECANTS = 10  # of friction coefficients that slip changes, combined


class _Headway:
    """Of passes: the best `answer` so far, and since how many passes nothing was halved, `idle`."""

    def __init__(self):
        self.missed = self.lacking = np.inf
        self.idle, self.answer = 0, None
        self._of_answer = np.inf, np.inf  # what the best one misses and lacks

    def note(self, answer: tuple | None, missed: float, lacking: float) -> None:
        """A pass with this answer, None if friction and bodies have not settled in it.

        `missed` are displacements, of which little may be known but rounding when forces are known
        to all digits: `lacking`, the part of them by which they are to change, infinite if unknown.
        Forces between stiff bodies may be known to few digits: by less than half these do not tell
        which pass is better.
        """
        lacking = max(lacking, ROUNDED)
        halved = missed <= HALF * self.missed or lacking < HALF * self.lacking
        self.idle = 0 if halved or answer is None else self.idle + 1
        of_missed, of_lacking = self._of_answer
        alike = not HALF * lacking > of_lacking
        if answer is not None and (self.answer is None or lacking < HALF * of_lacking
                                   or missed < of_missed and alike):
            self.answer, self._of_answer = answer, (missed, lacking)
        self.missed, self.lacking = min(missed, self.missed), min(lacking, self.lacking)


class CondensedSearch:
    """Steps of one problem by its contact rows, condensed. Collective."""

    def __init__(self, qp, bodies, slip, condensation):
        """As FixedPoint takes them."""
        self.qp, self.bodies, self.slip, self.condensation = qp, bodies, slip, condensation
        self.operator, self.rows = qp.operator, qp.rows
        self._in_vain = None  # Load of the step that was searched for

    @property
    def stiff(self) -> bool:
        """Whether products lack digits, so that contact rows are corrected by increments."""
        return self.operator.jumps and not self.operator.contact_rows_only

    def solution(self, index: int, load: Load, x: np.ndarray, trace: Trace, rtol: float):
        """Multipliers near x that solve the step, their gradient and the rows that slide.

        None if it fails; then bodies are where they were. `rtol` is the relative change of friction
        bounds, and the imbalance of bodies, to be reached. Raises Unfinished, `final` where a
        search has shown that there is no solution.
        """
        if self.condensation.n > globalization.CONDENSED_NODES and not self.condensation.eliminated:
            return None
        place = self.bodies.place(load)
        try:
            answer = self._search(index, load, x, trace, rtol)
        except Unfinished as failure:
            if not failure.final:
                self.bodies.bring(load, place)
            raise
        if answer is None:
            self.bodies.bring(load, place)
            return None
        x, gradient, self.rows.coefficient, place = answer
        self.bodies.bring(load, place)
        trace.refined = self.stiff
        return x, gradient, self.rows.sliding(x, self.rows.friction_bound(x))

    def _search(self, index: int, load: Load, x, trace: Trace, rtol: float) -> tuple | None:
        """Multipliers, gradient, friction coefficients and motions of a solution, or None.

        Where rounding keeps friction bounds or bodies from settling within a tightened `rtol`, the
        best pass in which they settle as far as a step asks for: its residuals say whether it does.
        """
        rows, changes = self.rows, self.slip.effects.coefficient_changes
        secants, method = Anderson(self.dot, LAW_SECANTS, 1.0), globalization.NEWTON
        headway, nearly, own = _Headway(), _Headway(), self.qp.settings.friction_rtol
        x = self.condensation.place(self.condensation.gather(x), x)  # without what corners exclude
        x, gradient = self._glued(index, load, x, trace)
        for _ in range(PASSES):
            self.qp.history.at_work(index, self.qp.operator.products)
            coefficient, bound = rows.coefficient, rows.friction_bound(x)
            self.slip.renew_coefficient(gradient)
            coefficient = self._of_acting(coefficient)
            apart = rows.friction_bound(x) - bound
            settled = self._settled(load, x, apart, rtol)
            almost = settled or own > rtol and self._settled(load, x, apart, own)
            whole, missed = self._missed(x, gradient, bound)
            state = x, gradient, coefficient, self.bodies.place(load)
            if changes:  # before rows are corrected: they end on the bounds that the next pass has
                rows.coefficient = np.maximum(secants.next(coefficient, rows.coefficient), 0.0)
            known = settled or not changes  # friction
            change = self._corrected(load, x, gradient) if known else None
            solver = globalization.NEWTON
            lacking = np.inf if change is None else self._share(change, x)
            headway.note(state if settled else None, missed, lacking)
            nearly.note(state if almost else None, missed, lacking)
            if settled and self._ends(whole, missed, headway.idle):
                self.qp.history.fallbacks.note(method, index)
                return headway.answer
            if change is None:
                change, solver = self._solved_for(load, x, gradient)
            if change is None:
                if solver == globalization.NO_STATE and not changes and rows.corners is None:
                    raise without_solution(self.qp, self.bodies, index, load, x, rtol, final=True)
                return None
            method = method if solver == globalization.NEWTON else solver
            x, gradient = self._followed(index, load, x, gradient, change, trace)
        if nearly.answer is not None:
            self.qp.history.fallbacks.note(method, index)
        return nearly.answer

    def _of_acting(self, coefficient: np.ndarray) -> np.ndarray:
        """`coefficient` (j,) where friction acts, in other rows of corners that of their own slip.

        Condensed problems leave these out; what a vertex's force is shared by depends on both.
        """
        if self.rows.corners is None or not self.slip.effects.coefficient_changes:
            return coefficient
        renewed, idle = coefficient.copy(), self.rows.corners.without_friction
        renewed[idle] = self.rows.coefficient[idle]
        return renewed

    # ---- one pass --------------------------------------------------------------------------------
    def _settled(self, load: Load, x, change: np.ndarray, rtol: float) -> bool:
        """Whether friction bounds (j,) and bodies change no more."""
        pressing = self.norm(self.rows.normal, x[self.rows.normal])
        return (self.norm(self.rows.tangential, change) <= rtol * pressing
                and self.bodies.imbalance(load, x) <= rtol)

    def _missed(self, x, gradient, bound: np.ndarray) -> tuple[float, float]:
        """Sizes of the projected gradient under friction bounds (j,): of all rows, and that by
        which passes are judged, where stiffness jumps that of the contact rows.
        """
        residual = projected_gradient(x, gradient, *self.rows.limits_at(len(x), bound))
        whole = self.qp.size(residual)
        if not self.stiff:
            return whole, whole
        residual[self.rows.gluing] = 0.0
        return whole, self.qp.size(residual)

    def _ends(self, whole: float, missed: float, idle: int) -> bool:
        """Whether no more passes are made: contact rows between stiff parts get all digits."""
        enough = whole <= 2 * self.qp.tol  # of which the gluing rows alone may have tol
        return missed == 0 or idle >= IDLE or enough and (not self.stiff or idle > LATER)

    def _glued(self, index: int, load: Load, x, trace: Trace) -> tuple[np.ndarray, np.ndarray]:
        """x with the gluing multipliers that its contact multipliers ask for, and its gradient."""
        trace.iterations += 1
        fixed = self.condensation.fixing(x)
        x, gradient = self._solved(index, trace.iterations, load.d, fixed, x, None)
        return x, self._exact(load, x) if self.stiff else gradient

    def _exact(self, load: Load, x: np.ndarray) -> np.ndarray:
        """The gradient at x to all digits."""
        return self.operator.gradient(x, load)

    def _followed(self, index: int, load: Load, x, gradient, change: np.ndarray, trace: Trace):
        """x after a `change` of contact rows and motions, and its gradient.

        Where stiffness jumps gluing multipliers answer to what the `gradient` at x leaves, too.
        """
        trace.iterations += 1
        op, qp, tol = self.operator, self.qp, self.qp.tol
        contact, motion = np.split(change, [self.condensation.size])
        change = self.condensation.place(contact, np.zeros_like(x))
        before = gradient if self.stiff else np.zeros_like(x)
        moved = op.apply(change) + before
        pushed = np.zeros_like(moved)
        pushed[self.rows.gluing] = moved[self.rows.gluing]
        pushed = qp.size(pushed)
        qp.tol = max(min(DIGITS * pushed, SHARE * tol), FINEST * pushed)
        try:
            change, _ = self._solved(index, trace.iterations, -before,
                                     self.condensation.fixing(change), change, moved)
        finally:
            qp.tol = tol
        if self.stiff and op.modes:  # gradients leave out what springs move, compliances do not
            motion = motion + op.rho * op.imbalance(change, np.zeros(op.structure.patterns))[0]
        self.bodies.shift(load, motion)
        x = self._on_bounds(x + change)
        return x, self._exact(load, x)

    def _on_bounds(self, x: np.ndarray) -> np.ndarray:
        """x with forces that are on their friction bound but for rounding exactly on it.

        A row inside its bound by the last digit would count as one that sticks, with all its slip.
        """
        bound, along = self.rows.friction_bound(x), x[self.rows.tangential]
        near = np.abs(np.abs(along) - bound) <= LAST_DIGITS * bound
        x[self.rows.tangential] = np.where(near, np.copysign(bound, along), along)
        return x

    def _solved(self, index: int, iteration: int, d, limits, x, gradient):
        """Solution of a QP and its gradient; where stiffness jumps, as far as products go."""
        try:
            result = self.qp.solve(index, iteration, d, limits, x, 0.0, gradient)
        except Unfinished as failure:
            if not (self.stiff and failure.stagnated):
                raise
            result = failure
        return result.x, result.gradient

    # ---- the condensed problem -------------------------------------------------------------------
    def _corrected(self, load: Load, x, gradient) -> np.ndarray | None:
        """Change (n + m + k,) of contact rows and motions to a solution near x, to its own digits.

        With the friction coefficients as they are. Where stiffness jumps; None elsewhere, or if
        none is near.
        """
        if not self.stiff:
            return None
        try:
            problem = self.condensation.problem(load, x, gradient)
        except NotConverged:
            return None
        start = problem.whole(self.condensation.gather(x))
        return corrected(problem, start, -self.condensation.gather(gradient))

    def _share(self, change: np.ndarray, x: np.ndarray) -> float:
        """Norm of the contact forces in a `change` (n + m + k,), over that of those in x."""
        size = self.condensation.size
        whole = np.linalg.norm(self.condensation.gather(x))
        return float(np.linalg.norm(change[:size]) / whole) if whole > 0 else np.inf

    def _solved_for(self, load: Load, x, gradient) -> tuple[np.ndarray | None, str]:
        """Change (n + m + k,) to a solution of the condensed problem at x and its `gradient`, and
        the method; or None.

        Bodies that ran away have slipped so far that friction by a law of slip holds them no more:
        where nothing solves the problem, friction is that of nodes that do not slide, or the
        largest that the law may give: bodies may slide to where it is. Searches, which take long,
        come after all, and once a step: they hardly depend on where it starts.
        """
        solver, tried = "", self._frictions(gradient)
        ways = (globalization.followed, tried), (globalization.searched, tried[:2])
        for solve, coefficients in ways:
            if solve is globalization.searched:
                if self._in_vain is load:
                    break
                self._in_vain = load
            for self.rows.coefficient in coefficients:
                try:
                    problem = self.condensation.problem(load, x, gradient)
                except NotConverged:
                    return None, ""
                start = problem.whole(self.condensation.gather(x))
                solution, solver = solve(problem, start)
                if solution is not None:
                    if self.slip.effects.coefficient_changes:
                        solution = self._with_own_slip(problem, solution)
                    return solution - start, solver
        return None, solver

    def _frictions(self, gradient: np.ndarray) -> list[np.ndarray]:
        """Friction coefficients (j,): the latest, without slip, the largest if others than these.
        """
        slip, found = self.slip, [self.rows.coefficient]
        if slip.effects.coefficient_changes:
            slip.renew_coefficient(np.zeros_like(gradient))
            found += [self.rows.coefficient, slip.largest_coefficient()]
            if self.operator.minimum(float(np.array_equal(*found[1:]))):
                found.pop()
        return found

    def _with_own_slip(self, problem, solution: np.ndarray) -> np.ndarray:
        """The solution near this one with the coefficients of its own slip, which `rows` take.

        The same one, with the same coefficients, where none is found.
        """
        known = self.rows.coefficient

        def law(slip: np.ndarray) -> np.ndarray:
            gradient = np.zeros(self.operator.owned)
            whole = self.condensation.place(np.append(np.zeros(problem.n), -slip), gradient)
            self.slip.renew_coefficient(whole)
            return self.condensation.of_tangential(self.rows.coefficient)

        own = consistent(problem, solution, law)
        if own is None:
            self.rows.coefficient = known
            return solution
        return own

    # ---- norms -----------------------------------------------------------------------------------
    def norm(self, rows: np.ndarray, values: np.ndarray) -> float:
        """Euclidean norm of `values` on `rows`."""
        full = np.zeros(self.operator.owned)
        full[rows] = values
        return np.sqrt(self.operator.dot(full, full))

    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Scalar product of values on the tangential rows."""
        full = np.zeros((2, self.operator.owned))
        full[:, self.rows.tangential] = a, b
        return self.operator.dot(*full)


def without_solution(qp, bodies, index: int, load: Load, x: np.ndarray, rtol: float,
                     final: bool = False) -> Unfinished:
    """What ends a step in which x is the latest of no solution; `final`: there is none.

    `rtol` is the imbalance of bodies that counts as none. Collective.
    """
    unbalanced = bodies.imbalance(load, x) > rtol
    why = bodies.why_unbalanced(load, x) if unbalanced else (
        "the fixed point for the friction bound does not contract, and no other method found a "
        "solution; the friction coefficient is beyond the range of a unique solution")
    return Unfinished(NoSolution(f"{step_name(index)}: {why}"), x,
                      qp.operator.apply(x) - load.d, final)
