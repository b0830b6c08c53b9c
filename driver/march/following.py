"""Time steps whose contact follows the motion: the geometry of a step is that of its solution.

A step is solved with the contact conditions about displacements w (contact/following.py), first
those of the step before, moved on as supports and obstacles move, then those of its own solution,
until nothing changes: Newton's method for the distances, successive approximations for the
directions of the forces, whose rate is the displacement under contact forces over the radii of
curvature. Where these do not contract Anderson acceleration combines them. What is missed is
measured at the solution u with multipliers lambda,

    | (d_u - d_w - n_w . [u - w]) | / delta,      | (B_u - B_w)' lambda | / f,

by how much the linear distance of a node that touches (or the penetration of one that does not) is
wrong, and by how much contact forces have another direction or place; delta the deformation, f the
largest contact force of a node. Only contact rows are renewed, the body's factors stay.

Friction sees the relative motion along the tangents at the end of the step: slip is t_u . [u - u_0]
with the displacements u_0 of the same vertices at the end of the step before, so what a node
carries with it (slip so far, wear) stays with the node.
"""

import dataclasses
import time

import numpy as np

from ..contact.states import OPEN
from ..errors import DriverError, InputError, NotConverged
from ..feti.nodal import NodalFields
from ..qp.anderson import Anderson
from ..text import percent, step_name
from .quasistatic import QuasistaticSolver
from .step import Step, StepFailed

MOST = 60  # geometries in a step
PLAIN = 5  # of them before those that do not settle are combined
HEADWAY = 0.5  # part of the least that was missed before, below which they settle
COMBINED = 15  # of them with Anderson acceleration, before ...
SHARES = (0.5, 0.25)  # ... parts of the way to the next one are taken, so many times in turn:
EACH = 20
AFRESH = 0.1  # of what was missed: below it those before are of another place, and combined no more
FINER = 0.01  # part of the tolerances of a step whose geometries do not settle
COARSER = 100.0  # times the tolerances to which the first geometries of a step are solved at most
AHEAD = 0.01  # or so many times what is missed yet


def by_much(missed: float) -> str:
    """A change of geometry, relative to the deformation or to the contact forces, in words.

    Bodies that jump from one place to another may hardly deform: multiples of that say nothing.
    """
    if missed >= 1:
        return "more than the deformation of the bodies"
    return f"{percent(missed)} of the deformation or of the contact forces"


class FollowingSolver(QuasistaticSolver):
    """Steps of one problem with the effect large_sliding. Collective."""

    def __init__(self, operator, effects, amplitudes, times, settings, cycles=None):
        super().__init__(operator, effects, amplitudes, times, settings, cycles)
        structure = operator.structure
        self.following, self._examined = structure.contact.following, None
        self._attached = structure.contact  # whose rows the parts of the solver know
        gids, subdomains = self.following.gids, structure.subdomains
        self._nodal = NodalFields(structure, gids, operator.comm)
        unit = np.eye(structure.patterns)
        self._travel = [self._nodal(structure.travel.displacements(one, subdomains))
                        for one in unit]
        self._motions = [self._nodal(mode.fields(structure)) for mode in structure.rigid_modes]
        self.deformed = np.zeros((len(gids), 2))
        self.history.counts["geometries"] = 0

    def _size(self, index: int) -> float:
        """As without large sliding; obstacles that move ask for unknown displacements."""
        return 1.0 if self.contact.motion is not None else super()._size(index)

    def _advance(self, index: int) -> tuple[Step, DriverError | None]:
        """As without large sliding, about one geometry after the other."""
        operator, products, iterations = self.operator, self.operator.products, 0
        kept, asked, history = self._state(), self.settings, self.history
        condensed = history.counts["condensed_steps"]
        # where all geometries so far were the first ones, so may be this one
        part = COARSER if history.counts["geometries"] > history.steps else 1.0
        about = self._moved(self.deformed, np.append(self.amplitudes[index], self.motion))
        start, geometries, nearing = None, 0, _Nearing()
        while True:
            geometries += 1
            history.at_work(index, operator.products)
            self.settings = dataclasses.replace(
                asked, rtol=part * asked.rtol, friction_rtol=part * asked.friction_rtol,
                primal_rtol=max(part, 1.0) * asked.primal_rtol)
            self._take(self._about(about, index), index, kept)
            step, error = self._step(index, *(start or self._predicted(index)))
            iterations += step.fixed_point_iterations
            deformed = self._deformations(step)
            u = self._moved(deformed, step.weights)
            missed = np.inf if error is not None else self._missed(
                step, u, np.linalg.norm(deformed, axis=1).max(initial=0.0))
            if error is not None or missed <= asked.primal_rtol and part <= 1:
                break
            if geometries == MOST:
                error = NotConverged(
                    f"{step_name(index)}: the contact geometry still changes after {MOST} updates, "
                    f"by {by_much(missed)}; smaller steps or rounded corners may help")
                break
            patterns = operator.structure.patterns
            x = step.multipliers
            start = (step.weights[patterns:].copy(), x,
                     self.rows.sliding(x, self.rows.friction_bound(x)))
            about = nearing.next(about, u, missed)
            part = min(part, max(1.0, AHEAD * missed / asked.primal_rtol))
            if nearing.stalled is not None:  # perhaps by what steps are solved to
                part = FINER
        self.settings = asked
        if error is None:
            error = self._passed(self._moved(kept["deformed"], kept["weights"]), u, index)
        self._finish(step, error, missed)
        step.about, step.geometries = about, geometries
        step.fixed_point_iterations, step.products = iterations, operator.products - products
        history.counts["geometries"] += geometries
        history.counts["condensed_steps"] = min(history.counts["condensed_steps"], condensed + 1)
        self.deformed = deformed
        self._ends(step)
        return step, error

    # ---- geometries ------------------------------------------------------------------------------
    def _about(self, u: np.ndarray, index: int):
        """The ContactBoundary about displacements u (k, 2) in step `index`.

        Raises StepFailed where places go farther than the scene says.
        """
        try:
            return self.following.about(u, float(self.times[index]))
        except InputError as problem:
            raise StepFailed(NotConverged(f"{step_name(index)}: {problem}")) from None

    def _passed(self, before: np.ndarray, u: np.ndarray, index: int) -> NotConverged | None:
        """The error of a step that has taken bodies through each other.

        `before` and `u` (k, 2) are the displacements at its start and at its end.
        """
        problem = self.following.passed(before, u, float(self.times[index]))
        return problem and NotConverged(f"{step_name(index)}: {problem}")

    def _take(self, contact, index: int, kept: dict) -> None:
        """Take the rows of `contact` for step `index`; all that is carried is as it was `kept`."""
        clock = time.perf_counter()
        known = self.operator.structure.contact
        if contact.has_rows_of(known) and contact.has_rows_of(self._attached):
            self.operator.structure.contact = self.contact = contact
            self.rows.gap = contact.gap[self.rows.normal_node]
            self.qp.bound = kept["bound"]
        else:
            self.operator.renew(contact)
            for room in self.effects:
                room.about(contact)
            self._attach(kept["bound"])
            self._attached = contact
        self.qp.settings = self.fixed_point.settings = self.settings
        self.closure = self._closure()
        slip, rows = self.slip, self.rows
        slip.weights = kept["weights"].copy()
        met = contact.declared
        jump = np.zeros((len(met.gid), 2))
        place = np.searchsorted(self.following.gids, met.term_gid)
        np.add.at(jump, met.term_node, met.term_value[:, None] * kept["deformed"][place])
        slip.elastic = (jump * met.tangent).sum(axis=1)[rows.tangential_node]
        if kept["coefficient"] is not None:
            rows.coefficient = kept["coefficient"].copy()
        self.bodies.placed = kept["placed"].copy()
        if rows.corners is not None:
            rows.corners.restore({name: values.copy() for name, values in kept["corners"].items()})
            self.condensation.select()
        self.scales.largest = dict(kept["largest"])
        if contact.motion is not None:
            self._move_obstacles(index)
        self.history.renewing += time.perf_counter() - clock

    def _state(self) -> dict:
        """What a step begins with, whatever its geometry."""
        corners = None if self.rows.corners is None else {
            name: values.copy() for name, values in self.rows.corners.carried().items()}
        given = self.rows.bound_is_given
        return {"bound": self.qp.bound, "weights": self.slip.weights, "deformed": self.deformed,
                "coefficient": None if given else self.rows.coefficient,
                "placed": self.bodies.placed, "corners": corners,
                "largest": self.scales.largest}

    def _finish(self, step: Step, error, missed: float) -> None:
        """The last of a step's geometries is its own: other solutions are looked for."""
        step.residuals["geometry"] = missed
        if error is None and self._examined is not None:
            super()._examine(*self._examined)
        self._examined = None

    def _examine(self, *state) -> None:
        """Only once, see `_finish`."""
        self._examined = state

    def _missed(self, step: Step, u: np.ndarray, deformed: float) -> float:
        """By how much the conditions that were used miss those about the solution u (k, 2).

        Contact boundaries are `deformed` by so much: residuals may know a lower bound alone.
        """
        used, now = self.contact.declared, self._about(u, step.index).declared
        forces = np.zeros((2, len(self.contact.gid)))
        rows, x = self.rows, step.multipliers
        forces[0, rows.normal_node], forces[1, rows.tangential_node] = (x[rows.normal],
                                                                       x[rows.tangential])
        status, worn = np.zeros((2, len(self.contact.gid)))
        status[rows.normal_node] = step.status != OPEN
        worn[rows.normal_node] = self.closure.worn
        values = np.sum(self.operator.comm.allgather(np.vstack([forces, status, worn])), axis=0)
        normal, tangential, touching, worn = values[:, : len(used.gid)]
        over, pushed = [], []
        for contact in (used, now):
            place = np.searchsorted(self.following.gids, contact.term_gid)
            node, value = contact.term_node, contact.term_value
            jump = np.bincount(node, value * (contact.normal[node] * u[place]).sum(axis=1),
                               len(contact.gid))
            over.append(jump - contact.gap)
            force = normal[:, None] * contact.normal + tangential[:, None] * contact.tangent
            pushed.append(np.column_stack([
                np.bincount(place, value * of[node], len(u)) for of in force.T]))
        closed = (touching > 0) & ~used.idle & ~now.idle
        error = np.where(used.normal_row >= 0, np.maximum(over[1] - worn, 0.0), 0.0)
        error[closed] = np.abs(over[1] - over[0])[closed]
        scales, moved = self.scales, np.abs(pushed[1] - pushed[0]).max(initial=0.0)
        return max(_over(float(error.max(initial=0.0)), max(scales.displacement, deformed)),
                   _over(float(moved), scales.force))

    # ---- displacements of the vertices of contact boundaries ------------------------------------
    def _deformations(self, step: Step) -> np.ndarray:
        """(k, 2) displacements without rigid motions, prescribed or free."""
        fields = self._nodal(self.operator.deformations(step.multipliers, step.weights,
                                                        refined=step.refined))
        motion = step.weights[self.operator.structure.patterns:]
        return fields - sum((a * r for a, r in zip(motion, self._motions)), np.zeros_like(fields))

    def _moved(self, deformed: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(k, 2) all of the displacements, `deformed` (k, 2) those by deformation."""
        rigid = zip(weights, [*self._travel, *self._motions])
        return deformed + sum((a * r for a, r in rigid), np.zeros_like(deformed))


class _Nearing:
    """Where the next geometry of a step is taken, from those before."""

    def __init__(self):
        self.count, self.least, self.stalled = 0, np.inf, None
        # those that are combined, and what was missed where they begin
        self.combined, self.begun = None, np.inf

    def next(self, about: np.ndarray, u: np.ndarray, missed: float) -> np.ndarray:
        """Displacements (k, 2) after those `about` which the solution is `u` (k, 2).

        The solution, unless they go to and fro.
        """
        self.count += 1
        if self.stalled is None and self.count >= PLAIN and missed > HEADWAY * self.least:
            self.stalled, self.begun = self.count, self.least
        if self.stalled is not None and missed < AFRESH * self.begun:
            self.stalled, self.begun = self.count, missed
        self.least = min(self.least, missed)
        if self.stalled is None:
            return u
        since = self.count - self.stalled
        if since == 0:
            self.combined = Anderson(np.dot)
        if since < COMBINED:
            return self.combined.next(about.ravel(), u.ravel()).reshape(u.shape)
        share = SHARES[min((since - COMBINED) // EACH, len(SHARES) - 1)]
        return about + share * (u - about)


def _over(value: float, size: float) -> float:
    """value / size; without size its sign."""
    return value / size if size > 0 else float(np.sign(value))
