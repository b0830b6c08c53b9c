"""Work that friction takes in the time steps, to second order in their length.

In a step in which a node slides in contact, friction takes the integral of s |du_t| with the
friction bound s. The trapezoid 1/2 (s_before + s_now) |du_t| follows it to second order, and
exactly where pressure and displacement grow in proportion; s_now alone is the rule of the implicit
Euler method, which errs by the step. Where a node opens or touches inside a step, only the part of
it counts in which there is contact. That part follows from the rate at which the bound (opening)
or the distance (touching) has fallen over the step before; it needs no accuracy, as a node opens
and touches a few times in all and its share of one step is of second order itself. Where contact
travels, and passes nodes in a few steps or less, that part says nothing: every node opens and
touches then, and is seen in contact as often as it should be in the mean. Those seen at no more
than FEW ends of steps count whole trapezoids.

A node slides where its shear traction is on the bound. What sticks moves by what tolerances leave,
and friction takes nothing from it.
"""

import functools
from dataclasses import dataclass

import numpy as np

from ..contact.states import ContactField
from ..errors import NotConverged

CLOSED = 1e-9  # part of the largest displacement below which a distance is rounding
FEW = 3  # step ends at which a node that contact passes is seen in contact: too few to say more
# of what a node slides before it touches, and of its work where nodes touch one after the other,
# which hold one another: what errs; 0.44 and 0.12 found
LEFT, HOLD = 0.6, 0.2
GLUED = 1e-8  # of the jumps of a torn body: what is left of them
TOGETHER = 1e-6  # part of the loads within which nodes touch at once
UNKNOWN = 0.5  # part of a step that counts where there is no step before to say more


@dataclass
class Moment:
    """Friction bounds and distances of the nodes (n,) at a time."""

    time: float
    bound: np.ndarray
    distance: np.ndarray


class Dissipation:
    """Takes the steps of a run in their order."""

    def __init__(self, weight: np.ndarray, gap: np.ndarray, start: np.ndarray | None,
                 alone=None):
        """`weight`, `gap` (n,) of the contact nodes.

        `start` (n,): friction bounds (tractions) at time 0; None where the run starts from a loaded
        state, whose bounds and distances are taken for those of the first step. `alone`() gives,
        where nodes first touch in the first step, (2, n) normal and tangential displacement that it
        would end with were there no contact, infinite where nothing else holds a node, or it is not
        known; None where no node is apart, or contact follows the motion.
        """
        self.weight, self.gap, self.alone = weight, gap, alone
        self.open = 0.0  # of the work, what first touches within the first step leave open
        self.before = self.last = None
        # (n,) steps since a node touched, and work of the part of that step before it did
        self.seen, self.left_out = np.zeros(len(weight), int), np.zeros(len(weight))
        if start is not None:
            self.last = Moment(0.0, start, np.maximum(gap, 0.0))

    def add(self, time: float, state: dict, gap: np.ndarray | None = None) -> np.ndarray:
        """(n,) work of friction at the nodes in the step that ends at `time`, stress x length^2.

        `state`: arrays (n,) of every `ContactField` at its end; `gap` (n,) then, if another one.
        """
        bound, slip, u_n = (state[name] for name in (ContactField.BOUND, ContactField.SLIP,
                                                     ContactField.U_N))
        now = Moment(time, bound, np.maximum((self.gap if gap is None else gap) - u_n, 0.0))
        if self.last is None:
            self.last = Moment(0.0, now.bound, now.distance)
        size = CLOSED * np.abs([slip, u_n]).max(initial=0.0)
        last, part = self.last, np.ones(len(slip))
        opens = (bound == 0) & (last.bound > 0)
        touches = (last.bound == 0) & (bound > 0) & (last.distance > size)
        passed = opens & (self.seen > 0) & (self.seen <= FEW)
        part[opens] = self._until_zero(time, "bound")[opens]
        part[passed] = 1.0
        part[touches] = 1 - self._until_zero(time, "distance")[touches]
        sigma_t = state[ContactField.SIGMA_T]
        slides = (np.abs(sigma_t) >= bound) & (bound > 0)
        # what opens is on no bound any more: it slid the way it went
        way = np.where(opens, np.abs(slip), np.where(slides, -np.sign(sigma_t) * slip, 0.0))
        if self.before is None and self.alone is not None and touches.any():
            way[touches] = self._rubbed(way, sigma_t, bound, touches)
            part[touches] = 1.0
        whole = way * (last.bound + bound) / 2 * self.weight
        missed = np.where(passed, self.left_out, 0.0)
        self.left_out = np.where(touches, (1 - part) * whole, self.left_out)
        self.seen = np.where(touches, 1, np.where((bound > 0) & (self.seen > 0), self.seen + 1, 0))
        self.before, self.last = last, now
        return part * whole + missed

    def _rubbed(self, way, sigma_t, bound, touches) -> np.ndarray:
        """Of the `way` (n,) of a first step what nodes that touch in it go in contact; `open`.

        Loads grow in proportion. Until it touches a node moves as if there were no contact. Where
        nothing else holds it, it comes at the first of the loads; where nothing holds it along the
        boundary either, it may have gone any part of its way.
        """
        (normal, tangential), distance = self.alone(), self.last.distance
        whole = np.maximum(normal, distance)
        part = np.divide(distance, whole, out=np.zeros(len(whole)), where=whole > 0)
        known = np.isfinite(tangential)
        first = np.where(np.isfinite(normal) & known, part * np.where(known, tangential, 0.0), 0.0)
        rubbed = np.maximum(way + np.sign(sigma_t) * first, 0.0)
        rubbed = np.where(known, rubbed, UNKNOWN * way)[touches]
        work = (bound * self.weight)[touches] / 2
        missed = np.where(known[touches], LEFT, 1.0) * np.abs(way[touches] - rubbed)
        in_turn = np.ptp(part[touches]) > TOGETHER
        self.open = float((missed + HOLD * in_turn * rubbed) @ work)
        return np.where(way[touches] > 0, rubbed, 0.0)

    def _until_zero(self, time: float, name: str) -> np.ndarray:
        """(n,) part of the step to `time` after which a quantity has fallen to zero.

        It goes on as in the step before, if it fell there. Where it fell too little to reach zero
        in this step, as it does, that says the less: down to nothing where it stood still.
        """
        values = getattr(self.last, name)
        if self.before is None:
            return np.full(len(values), UNKNOWN)
        fallen = getattr(self.before, name) - values
        falls = fallen > 0
        rate = np.where(falls, fallen, 1.0) / (self.last.time - self.before.time)
        parts = np.maximum(values / rate / (time - self.last.time), 0.0)
        late = UNKNOWN + (1 - UNKNOWN) / np.maximum(parts, 1.0)
        return np.where(falls, np.where(parts > 1.0, late, parts), UNKNOWN)


def of_run(solver, law, boundary) -> Dissipation:
    """The work of a `solver`'s run at the nodes of a contact `boundary` with a `law`; collective.

    What acts at time 0 are loads that are not zero, and travel of whole bodies.
    """
    operator = solver.operator
    motion = boundary.motion_of_all_times
    units = np.eye(operator.structure.patterns, operator.structure.patterns + operator.modes)
    acts = [bool(operator.elastic_response(unit).any() or operator.rigid_response(unit).any())
            for unit in units]
    acts = np.any(operator.comm.allgather(acts), axis=0)
    moves = motion is not None and not motion.rests(*solver.times[:2])
    begin = start(solver.effects, law, boundary.weight, solver.amplitudes[:, acts], moves)
    alone = None
    if begin is not None and boundary.following is None and (boundary.gap > 0).any():
        alone = functools.partial(without_contact, solver, boundary)
    return Dissipation(boundary.weight, boundary.gap, begin, alone)


def without_contact(solver, boundary) -> np.ndarray:
    """(2, n) as `alone` of Dissipation, of a `solver`'s first step, relative to obstacles of the
    `boundary` that move; collective.
    """
    operator, rows = solver.operator, solver.rows
    patterns = operator.structure.patterns
    weights = np.zeros(patterns + operator.modes)
    weights[:patterns] = solver.amplitudes[1]
    rigid, (start, end) = operator.rigid_response(weights), solver.times[:2]
    # not the gaps of the `rows`, which are those of the step that a run is at
    gap = operator.structure.contact.at(end).gap[rows.normal_node]
    moved = _whole(solver, weights, rigid[rows.normal] - gap) + rigid
    free = np.zeros(len(moved), bool)
    for unit in np.eye(patterns + operator.modes)[patterns:]:
        motion = np.abs(operator.rigid_response(unit))
        free |= motion > CLOSED * -operator.minimum(-float(motion.max(initial=0.0)))
    if solver.initial.any():  # slip counts from there, and what a node goes to its obstacle
        free[rows.tangential] = True
    moved = np.where(free, np.inf, moved)
    found = np.zeros((2, len(operator.structure.contact.gid)))
    found[0, rows.normal_node] = moved[rows.normal]
    found[1, rows.tangential_node] = moved[rows.tangential]
    found = np.sum(operator.comm.allgather(found), axis=0)[:, : len(boundary.gid)]
    found[0] += boundary.gap - boundary.at(end).gap
    found[1] -= boundary.way(start, end)
    return found


def _whole(solver, weights: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """(owned,) displacements of contact rows under loads of `weights`, of bodies glued and tied.

    Bilateral contact holds as well, where whole bodies move by `apart` (k,) more than normal rows
    have gaps: what it meets is not met first. By what the first step has eliminated, where it has.
    Collective.
    """
    if solver.fixed_point.shortcut.comes_first:
        try:
            return solver.condensation.without_contact(weights, apart)
        except NotConverged:
            pass  # nor could the step be solved by it
    softness = solver.operator.softness
    if softness is None:
        return _iterated(solver, weights, apart)
    solver.qp.soften(np.zeros(len(softness)))  # not by the step that a run is at
    try:
        return _iterated(solver, weights, apart)
    finally:
        solver.qp.soften(softness)


def _iterated(solver, weights: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """As `_whole`, by conjugate gradients with the operator as it is."""
    rows, qp, torn = solver.rows, solver.qp, solver.operator.elastic_response(weights)
    d = torn.copy()
    d[rows.normal[rows.pulls]] += apart[rows.pulls]
    lower, upper = np.full((2, len(d)), [[-np.inf], [np.inf]])
    fixed = np.append(rows.normal[~rows.pulls], rows.tangential)
    lower[fixed] = upper[fixed] = 0.0
    size = qp.size(np.where(upper > 0, d, 0.0))
    if not size:
        return torn
    products = solver.operator.products
    found = qp.linear(d, (lower, upper), np.zeros(len(d)), GLUED * size, -d)
    solver.operator.products = products  # none of a step's: made again after an interruption
    return torn - d - found.gradient


def start(effects, law, weight: np.ndarray, amplitudes: np.ndarray,
          moves: bool = False) -> np.ndarray | None:
    """(n,) friction bounds at time 0 as `Dissipation` takes them, of a run with `effects`.

    `law` is the ContactLaw of the nodes, `amplitudes` (steps + 1, patterns) are the factors of
    loads that are not zero. The nodes carry nothing at time 0 unless there is a preload, or loads
    that stand there while others begin to grow or, in the first step, an obstacle `moves`.
    """
    begin, first = amplitudes[:2]
    stands = begin.any() and (moves or not np.array_equal(begin, first))
    if "preload" in effects or stands:
        return None
    return law.friction_bound(np.zeros(len(weight))) / weight
