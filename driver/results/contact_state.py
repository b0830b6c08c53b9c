"""Quantities of the contact nodes in every step, from the ranks' solutions."""

import numpy as np

from ..contact.states import ContactField
from ..feti.nodal import NodalFields
from ..feti.operator import DualOperator
from ..feti.supports import constrained_keys
from ..march.cycle_verdict import MOVED, WORN
from ..march.quasistatic import QuasistaticSolver
from ..march.step import Step
from .held_nodes import ACROSS, HeldNodes, complete_start, held_along, of_axis, untilted

JOINTS, WEAR, HELD = "joints", "wear", "held"  # in what `ContactState.evaluate` returns
SLID = "slip_law.accumulated_slip"  # of what a cycle hands on


def less_wear(states: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """`states` with u_n less what has worn away: at most the gap of the new surface."""
    if WEAR not in states:
        return states
    return states | {ContactField.U_N: states[ContactField.U_N] - states[WEAR]}


class ContactState:
    """Nodal contact quantities of the whole body in every step, on every rank; arrays (n_c,)."""

    def __init__(self, operator: DualOperator, solver: QuasistaticSolver):
        self.operator, self.rows = operator, solver.rows
        self.boundary = operator.structure.contact.declared
        self.law = solver.effects.contact_law(self.boundary)
        self.frictional = solver.effects.frictional
        self.solver = solver
        # of the step before: tangential displacement less travel, and pattern factors of that
        self._elastic = self._weights = None
        self.held_nodes = HeldNodes(self.boundary, solver.effects, solver.initial)
        # where the scene declares wear, that and the depth so far, by the slip of displacements
        self._wear = solver.effects.rooms.get("wear")
        self.worn = None if self._wear is None else np.zeros(len(self.boundary.gid))
        self._time = 0.0
        # what the cycle at hand began with, of a history that is repeated
        self._begun: dict[str, np.ndarray] = {}
        self.constrained = self._constrained(self.boundary.gid)
        following, structure = self.boundary.following, operator.structure
        self._gids = (np.unique(self.boundary.term_gid) if following is None else following.gids)
        self._nodal = NodalFields(structure, self._gids, operator.comm)
        travel = structure.travel
        self._travelled = {k: self._nodal(travel.displacements(unit, structure.subdomains))
                           for k, unit in enumerate(np.eye(structure.patterns))
                           if k in travel.patterns}
        self._before = np.zeros((len(self._gids), 2))  # displacements less travel a step before
        self._take_geometry()

    def _take_geometry(self) -> None:
        """Take over the present contact boundary."""
        self.boundary = self.operator.structure.contact.declared
        self._term = np.searchsorted(self._gids, self.boundary.term_gid)
        self._value = self._of_terms()
        # (patterns, n_c, 2) displacements, between bodies jumps, by the travel of the patterns
        self._travel = np.zeros((self.operator.structure.patterns, len(self.boundary.gid), 2))
        for k, moved in self._travelled.items():
            self._travel[k] = self._jump(moved)

    def _of_terms(self) -> np.ndarray:
        """(terms, 2) values of the terms of the jump by displacement components.

        What a node slides by that supports hold along the boundary, together with what it meets, is
        what they move each by. A multiplier of the node acts on free nodes beside it as well, which
        are at other places. On the axis of a revolution nothing slides, and what is beside it does
        not count either.
        """
        b = self.boundary
        value, guided = np.tile(b.term_value, (2, 1)).T, b.paired & b.guided
        value[(of_axis(b) & (np.abs(b.normal[:, 0]) < ACROSS))[b.term_node], 0] = 0.0
        guided &= held_along(b, self.constrained)
        if not guided.any():
            return value
        along, held = np.abs(b.tangent).argmax(axis=1), self._constrained(b.term_gid)
        met = np.flatnonzero(guided[b.term_node] & b.term_other)
        node, component = b.term_node[met], along[b.term_node[met]]
        kept = np.where(held[met, component], b.term_value[met], 0.0)
        whole, part = (np.bincount(node, values, len(b.gid))
                       for values in (b.term_value[met], kept))
        scale = np.divide(whole, part, out=np.zeros_like(whole), where=part != 0)
        value[met, component] = kept * scale[node]
        return value

    def _constrained(self, gids: np.ndarray) -> np.ndarray:
        """(n, 2): displacement components of vertices (n,) that a support constrains."""
        keys = 2 * gids[:, None] + [0, 1]
        own = np.isin(keys, constrained_keys(self.operator.structure))
        return np.any(self.operator.comm.allgather(own), axis=0)

    def evaluate(self, step: Step, displacements: list[np.ndarray]) -> dict[str, np.ndarray]:
        """Arrays (n_c,) of every `ContactField` at the end of `step`, status as code; collective.

        Beside them JOINTS, the nodal forces of the rows of joints, HELD, tangential ones of nodes
        that have no row, and WEAR where it is declared.

        `displacements` (dofs,) of the rank's subdomains, less the travel. Steps must come in their
        order: slip is counted from the step before.
        """
        follows = self.boundary.following is not None
        if follows:
            self._take_geometry()
            self.law = self.solver.effects.contact_law(self.boundary)
        b, rows, n = self.boundary, self.rows, len(self.operator.structure.contact.gid)
        values = np.zeros((4, n))  # lambda_n, lambda_t, bound, status
        values[0, rows.normal_node] = step.multipliers[rows.normal]
        values[1, rows.tangential_node] = step.multipliers[rows.tangential]
        values[2, rows.tangential_node] = step.friction_bound
        values[3, rows.normal_node] = step.status
        values = np.sum(self.operator.comm.allgather(values), axis=0)
        joints, values = values[0, len(b.gid):], values[:, : len(b.gid)]
        moved, held = self._nodal(displacements), held_along(b, self.constrained)
        u, tangent = self._jump(moved), untilted(b.tangent, held)
        u_n, elastic = (u * b.normal).sum(axis=1), (u * tangent).sum(axis=1)
        weights = step.weights[: len(self._travel)]
        carried = np.tensordot(weights, self._travel, axes=1)
        u_n = u_n + (carried * b.normal).sum(axis=1)
        u_t = elastic + (carried * tangent).sum(axis=1)
        if self._weights is None:
            self._weights = self.solver.initial_weights
            complete_start(self.solver, held, self.prescribed)
            self._elastic = self.solver.initial[: len(b.gid)] - self._carried_t(
                self._weights, tangent)
        if self.solver.cycles is not None and step.index == self.solver.cycles.begin + 1:
            self._begun = self._handed_on()
        if follows:  # along the tangents of now
            self._elastic = (self._jump(self._before) * tangent).sum(axis=1)
        slip = elastic - self._elastic + self._carried_t(weights - self._weights, tangent)
        slip -= b.way(self._time, step.time)
        self._time = step.time
        self._elastic, self._weights, self._before = elastic, weights, moved
        if self.frictional:  # a node constrained tangentially has no row of its own, but a bound
            reach = self._reach(moved, weights)
            bound = self.held_nodes.add(self.law, held, values[0], slip, reach)
            # one that a support holds along the normal alone has neither pressure nor friction
            bound = np.where((b.normal_row < 0) & ~held, 0.0, bound)
            values[2] = np.where(b.tangential_row < 0, bound, values[2])
            values[1] += self.held_nodes.friction
            values[3] = self.held_nodes.states(held, values[2], values[3])
        more = {} if self.worn is None else {WEAR: self._worn_by(slip, values[0])}
        if step.cycle:
            self._cycle_ends(step)
        return {**more, ContactField.U_N: u_n, ContactField.U_T: u_t, ContactField.SLIP: slip,
                ContactField.SIGMA_N: 0.0 - values[0] / b.weight,
                ContactField.SIGMA_T: 0.0 - values[1] / b.weight,
                ContactField.BOUND: values[2] / b.weight,
                ContactField.STATUS: values[3].astype(int), JOINTS: joints,
                HELD: self.held_nodes.friction}

    def prescribed(self) -> np.ndarray:
        """(patterns, n_c) displacements along the boundary of the nodes held along it, by what each
        pattern prescribes; zero of others. Collective.
        """
        b, structure = self.boundary, self.operator.structure
        held, found = held_along(b, self.constrained), np.zeros((structure.patterns, len(b.gid)))
        tangent = untilted(b.tangent, held)
        for k, carried in enumerate(self._travel):
            fields = [np.zeros(sub.dofs) for sub in structure.subdomains]
            for field, fixed, values in zip(fields, structure.fixed, structure.fixed_values):
                field[fixed] = values[k]
            moved = self._jump(self._nodal(fields)) + carried
            found[k] = np.where(held, (moved * tangent).sum(axis=1), 0.0)
        return found

    def _handed_on(self) -> dict[str, np.ndarray]:
        """What a cycle hands on to the next, None what is not there."""
        return {MOVED: self._elastic, WORN: self.worn,
                SLID: None if self.held_nodes.way is None else self.held_nodes.way.slid.copy()}

    def _cycle_ends(self, step: Step) -> None:
        """A cycle ends; what grows in those that are jumped over after it has grown."""
        now = self._handed_on()
        # of nodes without a row the march does not see whether they slide
        for name in {*step.grown, SLID} if step.skips else ():
            if now.get(name) is not None and name in self._begun:
                now[name] = now[name] + step.skips * (now[name] - self._begun[name])
        self._begun, self._elastic = now, now[MOVED]
        self.worn = now[WORN]
        if self.held_nodes.way is not None:
            self.held_nodes.way.slid = now[SLID]

    def _worn_by(self, slip: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(n_c,) worn depth at the end of a step; supports that hold nodes are not worn against.
        """
        rubs = np.flatnonzero(self.boundary.tangential_row >= 0)
        self.worn = self.worn.copy()
        self.worn[rubs] += self._wear.closure(rubs, force[rubs], np.abs(slip[rubs]))
        return self.worn

    def _carried_t(self, weights: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """(n_c,) displacements along `tangent` (n_c, 2) by travel with pattern factors `weights`.
        """
        carried = np.tensordot(weights, self._travel, axes=1)
        return (carried * tangent).sum(axis=1)

    def _reach(self, moved: np.ndarray, weights: np.ndarray) -> float:
        """Largest displacement of a vertex, `moved` (k, 2) or travelling with pattern `weights`."""
        travelled = (weights[k] * unit for k, unit in self._travelled.items())
        return max(np.abs(of).max(initial=0.0) for of in (moved, *travelled))

    def _jump(self, moved: np.ndarray) -> np.ndarray:
        """(n_c, 2) displacement of the contact nodes, between bodies the jump.

        `moved` (k, 2) are displacements of the vertices.
        """
        b = self.boundary
        jump = np.zeros((len(b.gid), 2))
        np.add.at(jump, b.term_node, self._value * moved[self._term])
        return jump
