"""Contact conditions in which a node yields by a law of its force and slip: rough or worn surfaces.

With the closure h >= 0 of a node under its normal force, and what has worn away before, the
Signorini conditions of a step are

    u_n - h(lambda_n, slip) <= g + worn,      lambda_n >= 0,      one of them an equality.

Newton's method: h is replaced by its tangent, offset + slope lambda_n, which is a diagonal of the
dual operator and a change of the gap; the step is solved with it as any other, and the tangent
renewed there until law and tangent agree. What a law takes its tangent about is its own affair
(`Effect.tangent`): a power law with exponent above one is smooth in the closure, one below in the
pressure.
"""

import numpy as np
from mpi4py import MPI

from ..errors import NotConverged
from ..text import step_name
from .step import Load, Unfinished

MOST = 60  # tangents in a step


class Closure:
    """Tangents of the laws of the rank's nodes with a normal row; k nodes. Collective.

    `slope` and `offset` (rooms, k) are those of every room with a law.
    """

    def __init__(self, qp, effects, residuals):
        """`qp`: the FrictionQP whose operator gets the diagonal; `residuals` say what is small."""
        self.qp, self.rows, self.residuals = qp, qp.rows, residuals
        self.rooms = [room for room in effects if room.closes]
        self.nodes, self.gap = self.rows.normal_node, self.rows.gap.copy()
        self.place = np.searchsorted(self.nodes, self.rows.tangential_node)
        self.slope, self.offset = np.zeros((2, len(self.rooms), len(self.nodes)))
        self.slides = True
        self.worn = np.zeros(len(self.nodes))  # depth (k,) before the step

    def begin_step(self, moving: bool, slides: bool = True) -> None:
        """Gaps grow by what has worn away; tangents of the step before are forgotten.

        Where obstacles are `moving` gaps are those of the step already. `slides`: slip counts.
        """
        self.worn, self.slides = sum(room.worn(self.nodes) for room in self.rooms), slides
        self.rows.gap = (self.rows.gap if moving else self.gap) + self.worn
        self.slope[:], self.offset[:] = 0.0, 0.0
        self.qp.soften(np.zeros(self.qp.operator.owned))

    def renew(self, load: Load, x: np.ndarray, gradient: np.ndarray,
              sliding: np.ndarray | None = None) -> np.ndarray:
        """Take the tangents at multipliers x with their gradient, which is returned anew.

        Where the rows that are `sliding` are given, those of a start, others have no slip yet: a
        node that sticks wears nothing, while wear by what a start is off would take the pressure,
        and with it the friction, that holds it.
        """
        force, own, slip = self._state(x, gradient)
        if sliding is not None:
            slip[self.place] *= sliding * gradient[self.rows.tangential] < 0
        before = self.slope.sum(axis=0), self.offset.sum(axis=0)
        for k, room in enumerate(self.rooms):
            largest = self.qp.operator.comm.allreduce(
                room.reach(self.nodes, force, own[k]), op=MPI.MAX)
            self.slope[k], self.offset[k] = room.tangent(self.nodes, force, own[k], slip, largest)
        slope, offset = self.slope.sum(axis=0), self.offset.sum(axis=0)
        full, shift = np.zeros((2, len(x)))
        full[self.rows.normal] = slope
        shift[self.rows.normal] = offset - before[1]
        self.qp.soften(full)
        load.widen(-shift)
        changed = gradient + shift
        changed[self.rows.normal] += (slope - before[0]) * force
        return changed

    def missed(self, x: np.ndarray, gradient: np.ndarray) -> float:
        """By how much tangents miss the laws, over the node's closure or what material like its
        own deforms by, whichever is larger.
        """
        force, own, slip = self._state(x, gradient)
        error, closed = np.zeros((2, len(force)))
        for k, room in enumerate(self.rooms):
            law = room.closure(self.nodes, force, slip)
            tangent = self.offset[k] + self.slope[k] * force
            # nodes without force may be beyond the gap where a tangent alone says so
            error += np.where((force > 0) | self.rows.pulls, law - tangent,
                              np.maximum(own[k], 0.0))
            closed += np.abs(law)
        operator = self.qp.operator
        deformed = self.residuals.scales.displacements[operator.row_level][self.rows.normal]
        size = np.maximum(closed, deformed)
        share = np.divide(np.abs(error), size, out=np.zeros(len(size)), where=size > 0)
        return operator.comm.allreduce(float(share.max(initial=0.0)), op=MPI.MAX)

    def yielded(self, x: np.ndarray) -> np.ndarray:
        """(k,) by how much more u_n is than gap less gradient at the end of a step with x."""
        return self.offset.sum(axis=0) + self.slope.sum(axis=0) * x[self.rows.normal]

    def _state(self, x, gradient):
        """Forces (k,), closures of every room (rooms, k) by tangents, and slips (k,).

        Contact that pulls stays on the tangent; nothing else has forces below zero.
        """
        force, pulls = x[self.rows.normal], self.rows.pulls
        force = np.where(pulls, force, np.maximum(force, 0.0))
        # without force the way beyond the gap that the tangent leaves
        over = -gradient[self.rows.normal]
        own = self.offset + self.slope * force
        own = np.where((force > 0) | pulls, own, np.where(over < 0, over + own, own))
        slip = np.zeros(len(force))
        if self.slides:
            slip[self.place] = np.abs(gradient[self.rows.tangential])
        return force, own, slip

    def settled(self, index: int, load: Load, start: tuple, trace, solve):
        """A step's multipliers, gradient, last change and residuals with laws and tangents agreed.

        `start` are multipliers, gradient and rows that slide; `solve` finds the first four for
        given tangents from such. Raises Unfinished.
        """
        x, gradient, sliding = start
        aim, began = self.qp.settings.primal_rtol, sliding
        for _ in range(MOST):
            gradient, began = self.renew(load, x, gradient, began), None
            x, gradient, moved, residuals = solve(index, load, x, gradient, sliding, trace)
            missed = self.missed(x, gradient)
            if missed <= aim:
                residuals["complementarity"] = max(residuals["complementarity"], missed)
                return x, gradient, moved, residuals
            trace.again()
            if self.rows.corners is not None:
                self.rows.corners.reconsider()
            sliding = self.rows.sliding(x, self.rows.friction_bound(x))
        raise Unfinished(NotConverged(
            f"{step_name(index)}: the law of worn or rough surfaces still has an error of "
            f"{missed:.1e} after {MOST} tangents; smaller steps may help"), x, gradient)
