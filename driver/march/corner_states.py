"""The states of corners (contact/corner_nodes.py) in a time step: fixed points until each is right.
"""

import numpy as np

from ..errors import NoSolution, NotConverged
from ..text import step_name
from .fixed_point import FixedPoint
from .step import Load, Trace, Unfinished


class CornerStates:
    """Finds a step's fixed point as FixedPoint does, and which nodes of corners act. Collective."""

    def __init__(self, fixed_point: FixedPoint, contact):
        self.fixed_point, self.contact = fixed_point, contact
        self.qp, self.corners = fixed_point.qp, fixed_point.rows.corners
        self.index, self.others = 0, None  # states left to try where those asked for have failed
        self.none = None  # the step's first error that no equilibrium was found

    def find(self, index: int, load: Load, x, gradient, sliding, trace: Trace, rtol: float):
        """As FixedPoint.find; states that a violated condition refutes are changed.

        Raises Unfinished.
        """
        return self._settled(self.fixed_point.find, index, load, x, gradient, sliding, trace, rtol)

    def condensed(self, index: int, load: Load, x, gradient, sliding, trace: Trace, rtol: float):
        """As FixedPoint.condensed, likewise."""
        return self._settled(self.fixed_point.condensed, index, load, x, gradient, sliding, trace,
                             rtol)

    def _settled(self, solve, index: int, load: Load, x, gradient, sliding, trace: Trace,
                 rtol: float):
        """What `solve`, a method of FixedPoint, finds in states that no condition refutes."""
        if self.index != index:
            if self.index == 0:  # a preload may have changed states
                self.fixed_point.condensation.select()
            self.index, self.others, self.none = index, None, None
            self.corners.begin_step()
            self.corners.begin()
        if self.corners.reconsidered:
            self.fixed_point.condensation.select()
            self.corners.reconsidered = False
        start = x, self.fixed_point.bodies.place(load), sliding
        while True:
            failure = None
            try:
                x, gradient, sliding = solve(index, load, x, gradient, sliding, trace, rtol)
            except Unfinished as problem:  # perhaps for want of friction where a side is open
                failure, x, gradient = problem, problem.x, problem.gradient
            if not self.corners.switch(x, gradient, self.fixed_point.rows, self.qp.scale,
                                       self.qp.tol, self.qp.operator.comm,
                                       self._deformation(load, x)):
                failure = failure or self._undecided(index, x, gradient)
                if failure is None:
                    return x, gradient, sliding
                self._next(failure)
            if failure is not None:  # bodies may be anywhere, under any force
                x, gradient, sliding = self._anew(load, *start)
            self.fixed_point.condensation.select()
            trace.again()

    def _next(self, failure: Unfinished) -> None:
        """Change to states that are left to try after `failure`; raise it if there are none.

        Where a corner is undecided, for want of an equilibrium in some state if there was none:
        which of the two ends the search depends on the order of states, and so on the cut.
        """
        if isinstance(failure.error, NoSolution):
            self.none = self.none or failure.error
        if self.others is None:
            self.others = self.corners.others()
        if not self.others:
            if self.corners.undecided.any():  # residuals do not see what wrong states leave out
                failure.final, failure.error = True, self.none or failure.error
            raise failure
        self.corners.begin_step()
        self.corners.acting = self.others.pop(0)

    def _anew(self, load: Load, x, place, sliding):
        """The start again: multipliers x, their gradient, bodies in their `place`, `sliding`."""
        self.fixed_point.bodies.bring(load, place)
        return x, self.qp.operator.apply(x) - load.d, sliding

    def _deformation(self, load: Load, x: np.ndarray) -> np.ndarray:
        """(owned,) of the step, where a vertex may have arrived in its corner, else the last.

        Collective.
        """
        op = self.qp.operator
        if self.corners.arriving:
            return op.deformation_by_level(x, load.weights)[op.row_level]
        return self.qp.scales.displacements[op.row_level]

    def end_step(self, x: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Multipliers (owned,) of the end of a step: forces at corners as `shared` there."""
        op = self.qp.operator
        x, changed = self.corners.end_step(x, gradient, self.fixed_point.rows,
                                           self.qp.scales.displacements[op.row_level], op.comm)
        if changed:
            self.fixed_point.condensation.select()
        return x

    def _undecided(self, index: int, x: np.ndarray, gradient: np.ndarray) -> Unfinished | None:
        """The failure of a step in which no state of a corner is right."""
        wrong = self.corners.nodes[self.corners.undecided, 0]
        if not wrong.size:
            return None
        where = ", ".join(f"({x:g}, {y:g})" for x, y in self.contact.xy[wrong])
        return Unfinished(NotConverged(
            f"{step_name(index)}: no state of contact and friction was found for the two "
            f"conditions at the corner {where}; smaller steps or a rounded corner may help"),
            x, gradient, final=True)
