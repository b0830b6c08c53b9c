"""Steps in which something slides at a junction, whose forces displacements do not tell.

Which of the forces at a junction (contact/junctions.py) a solver comes to decides there on the
friction of what slides, and with that on displacements: Coulomb's law has a family of solutions.
Of these the one is taken whose forces are nearest to what the tractions beside would make, as where
nothing slides. Successive approximations: bounds of friction at junctions are given, those of the
forces that are nearest in the iteration before, accelerated, until these keep to Coulomb's law.
"""

import contextlib

import numpy as np

from ..qp.anderson import Anderson, gives_up
from ..text import counted, step_name
from .junction_forces import JunctionForces
from .step import Load, Trace, Unfinished

SEVERAL = "forces are those of one of several solutions"


class JunctionBounds:
    """The solutions of one problem's steps with such forces. Collective."""

    def __init__(self, march, forces: JunctionForces):
        """`march`: the QuasistaticSolver; `forces`: those of its junctions."""
        self.march, self.forces = march, forces

    def settled(self, index: int, load: Load, x: np.ndarray, gradient: np.ndarray,
                sliding: np.ndarray, trace: Trace) -> tuple:
        """A step's multipliers, gradient, last change and residuals from a state of the first two
        and the rows that slide.

        Where the iterations do not converge those by Coulomb's law alone. Raises Unfinished.
        """
        march = self.march
        first = march.settled(index, load, x, gradient, sliding, trace)
        place = march.fixed_point.place(load)
        try:
            found = self._nearest(index, load, first, trace)
        except Unfinished:
            found = None
        if found is None:
            march.fixed_point.back(load, place, first)
            self._warn(index)
        return found or first

    def _nearest(self, index: int, load: Load, found: tuple, trace: Trace) -> tuple | None:
        """As `settled` from what it has `found` by Coulomb's law; None if it does not converge.

        Raises Unfinished.
        """
        march, given = self.march, np.full(len(self.march.rows.tangential), np.nan)
        sliding, excess, secants = self._sliding(found[0]), [], None
        while not (excess and gives_up(excess)):
            x, asked = self._under_given(*found[:2], given)
            fixed = ~np.isnan(asked)
            if not self._any(fixed):
                return found
            if self._any(fixed == np.isnan(given)):
                given, secants = asked, Anderson(march.fixed_point.search.dot, damping=1.0)
            sliding = np.where(fixed, self._sliding(x), sliding)
            x, gradient, moved = march.into_cone(load.d, x, None, sliding)
            if trace.refined:
                gradient = march.operator.gradient(x, load)
            residuals = march.residuals.of(load, x, gradient)
            if march.residuals.enough(residuals):
                return x, gradient, moved, residuals
            excess.append(max(march.residuals.excess(residuals).values()))
            renewed = secants.next(*(np.where(fixed, bounds, 0.0) for bounds in (given, asked)))
            given = np.where(fixed, np.maximum(renewed, 0.0), np.nan)
            trace.again()
            if march.rows.corners is not None:
                march.rows.corners.reconsider()
            with self._law(given):
                found = march.settled(index, load, x, gradient, sliding, trace)
                sliding = self._sliding(found[0])
            march.slip.renew_coefficient(found[1])
        return None

    def _warn(self, index: int) -> None:
        """Say, once in a run, that a step has one of several solutions."""
        lines, contact = self.march.history.warnings, self.march.contact
        if any(SEVERAL in line for line in lines):
            return
        x, y = contact.xy[self.forces.of[0].nodes[0]]
        others = len(self.forces.of) - 1
        where = f"at ({x:.3g}, {y:.3g})" + (f" or at {counted(others, 'more place')}" if others
                                            else "")
        lines.append(f"{step_name(index)}: {SEVERAL} {where}, where bodies meet and slide: another "
                     "cut into subdomains may give another solution")

    def _sliding(self, x: np.ndarray) -> np.ndarray:
        """(j,) signs of friction in x that is on its bound, with the present coefficients."""
        return self.march.rows.sliding(x, self.march.rows.friction_bound(x))

    def _any(self, rows: np.ndarray) -> bool:
        """Whether there are such rows (j,) on any rank."""
        return self.march.operator.minimum(-float(rows.any())) < 0

    def _under_given(self, x, gradient, given) -> tuple[np.ndarray, np.ndarray]:
        """x with forces at junctions nearest to those beside, and the bounds that go with them."""
        return self.forces.under_given(x, gradient, *self._measures(), given)

    def shared(self, x: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """x with forces at junctions nearest to those beside, by Coulomb's law."""
        return self.forces.shared(x, gradient, *self._measures())

    def _measures(self) -> tuple:
        """The rows, and what tells slips and distances from rounding."""
        march, op = self.march, self.march.operator
        return (march.rows, march.scales.displacements[op.row_level],
                march.settings.primal_rtol, op.comm)

    @contextlib.contextmanager
    def _law(self, given: np.ndarray):
        """Bounds of friction that are `given` (j,), NaN where the law's are, in a block."""
        rows, slip, fixed = self.march.rows, self.march.slip, ~np.isnan(given)
        known, offset = slip.coefficient, rows.offset
        offset = np.zeros(len(fixed)) if offset is None else offset
        slip.coefficient = np.where(fixed, 0.0, known)
        try:
            with rows.under(np.where(fixed, 0.0, rows.coefficient), np.where(fixed, given, offset)):
                yield
        finally:
            slip.coefficient = known
