"""One value of a study: its steps, and what its rows of the tables are made of."""

import dataclasses
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from ..contact.states import STATUS_NAMES
from ..march.step import StepFailed
from ..march.uniqueness import DOUBTFUL_FRICTION
from ..options import Settings
from ..results import dissipation
from ..results.contact_edges import NODES, chains, contact_length
from ..results.contact_state import WEAR, ContactState, less_wear
from ..results.held_nodes import HeldNodes, complete_start, held_along, of_axis, without_row
from ..results.quantities import largest_pressure, resultant
from ..results.record import Record
from ..results.shares import label_shares
from ..results.tables import shown
from ..text import counted


class Prescribed(NamedTuple):
    """What supports prescribe along a contact boundary, which is the same for all values."""

    held: np.ndarray  # (n_c,) which nodes they hold along it
    along: np.ndarray  # (patterns, n_c) tangential displacements of these, zero of others

    @classmethod
    def of(cls, problem, settings: Settings) -> "Prescribed":
        """Of all patterns of a study; collective."""
        contact = problem.structure.contact.declared
        if not (problem.effects.frictional and without_row(contact).any()):
            count = len(contact.gid)
            return cls(np.zeros(count, bool), np.zeros((problem.structure.patterns, count)))
        state = ContactState(problem.operator, problem.solver(settings))
        return cls(held_along(contact, state.constrained), state.prescribed())


@dataclasses.dataclass
class Outcome:
    """One value: its rows of study.csv and history.csv, contact fields (n_c,) at the last step."""

    status: int
    reason: str
    row: dict
    history: list[dict]
    fields: dict
    warnings: list[str]


def solve(problem, settings: Settings, near: np.ndarray | None,
          prescribed: Prescribed) -> tuple[Outcome, np.ndarray | None]:
    """March through the steps of one value; also its multipliers of the first step.

    `near` are those of another value. Where several solutions may exist each value finds its own.
    """
    operator, solver, first = problem.operator, problem.solver(settings), None
    if solver.largest_friction <= DOUBTFUL_FRICTION:
        solver.condensation.guess = near
    history, fields, failure = [], {}, None
    contact = operator.structure.contact.declared
    law = solver.effects.contact_law(contact)
    friction = dissipation.of_run(solver, law, contact)
    shares, place = label_shares(operator.structure)[1], _place(contact)
    follows = contact.following is not None
    record = Record(operator, solver) if follows else _Fields(solver, law, prescribed)
    # without friction there are no rows that tell how nodes slide
    told = follows or solver.effects.frictional
    untold = {} if told else dict.fromkeys(("u_t", "slip"), np.full(len(contact.gid), np.nan))

    def add(step) -> None:
        nonlocal fields, place
        if follows:  # the boundary is that of the step
            fields, place = dict(record.add(step)[1]) | {"gap": record.gaps[-1]}, _place(contact)
        else:
            fields = record.add(step)
        bare = less_wear(fields)
        row = _quantities(*place, shares, bare | untold)
        if WEAR in fields:
            row["worn_volume"] = float(fields[WEAR] @ contact.weight)
        dissipated = float(friction.add(step.time, bare, fields["gap"]).sum())
        dissipated += history[-1]["dissipated"] if history else 0.0
        fields |= untold
        history.append({"step": step.index, "time": step.time, **row, "dissipated": dissipated,
                        "fixed_point_iterations": step.fixed_point_iterations,
                        "dual_multiplications": step.products, "kkt": max(step.residuals.values())})

    try:
        for step in solver.steps():
            first = step.multipliers if step.index == 1 else first
            add(step)
    except StepFailed as stop:
        failure = stop
        if failure.step is not None:
            add(failure.step)
    counts, ended = solver.history.counts, solver.history
    row = {"converged": "no" if failure else "yes", "steps": ended.steps,
           **(history[-1] if history else {}),
           "fixed_point_iterations": counts["fixed_point_iterations"],
           "dual_multiplications": counts["dual_multiplications"],
           "kkt": max(ended.residuals.values(), default=0.0),
           "uniqueness": solver.uniqueness.verdict, **_cycles(solver)}
    row.pop("step", None)
    row.pop("time", None)
    warnings = [*ended.warnings, *ended.fallbacks.warnings(), *solver.uniqueness.warnings(),
                *([] if follows else _half_held(solver, contact, prescribed))]
    status, reason = (failure.exit_status, str(failure)) if failure else (0, "")
    return Outcome(status, reason, row, history, fields, warnings), first


def _half_held(solver, contact, prescribed: Prescribed) -> list[str]:
    """A line if supports hold nodes in one direction of a slanted boundary: rows do not tell how
    these slide.
    """
    count = np.count_nonzero(without_row(contact) & ~prescribed.held)
    if not (solver.effects.frictional and count):
        return []
    return [f"a support holds {counted(count, 'contact node')} of a slanted boundary in one "
            "direction: runs alone tell u_t and slip there, which are wrong here, and largest_slip "
            "may be"]


def _cycles(solver) -> dict:
    """Columns on the cycles of a history that is repeated."""
    if solver.cycles is None or not solver.cycles.past.rows:
        return {}
    last = solver.cycles.past.rows[-1]
    return {"cycles": last["cycle"], "kind": last["kind"], "settled": shown(last["settled"])}


class _Fields:
    """Nodal contact quantities in one step after the other, by multipliers and gradient: at its
    rows B u = c - gradient. Arrays (n_c,).
    """

    def __init__(self, solver, law, prescribed: Prescribed):
        self.solver, self.law, self.prescribed = solver, law, prescribed
        self.contact = solver.operator.structure.contact.declared
        self.held_nodes = HeldNodes(self.contact, solver.effects, solver.initial)
        # at the end of the step before: tangential displacement, time and pattern factors
        self._u_t, self._time, self._weights = None, 0.0, solver.initial_weights

    def add(self, step) -> dict[str, np.ndarray]:
        """Those at the end of `step`, the gap then and, where the scene declares wear, its depth.

        A node that does not slide goes with the surface of its obstacle; one that supports hold
        along the boundary slides as they have it.
        """
        contact, way = self.contact, self.contact.way(self._time, step.time)
        apart = 0.0 if self._u_t is not None else self._begin()
        u_n, slip, force_n, force_t, bound, status, depth = self._of_rows(step)
        if self.solver.effects.frictional:
            alone, held = contact.tangential_row < 0, self.prescribed.held
            weights = step.weights[: len(self._weights)]
            own = (weights - self._weights) @ self.prescribed.along + apart - way
            slip = np.where(alone, own, slip)
            reach = np.abs([u_n, self._u_t + way + slip]).max(initial=0.0)
            own = self.held_nodes.add(self.law, held, force_n, slip, reach)
            bound, force_t = np.where(alone, own, bound), force_t + self.held_nodes.friction
            status, self._weights = self.held_nodes.states(held, bound, status), weights
        self._u_t, self._time = self._u_t + way + slip, step.time
        w = contact.weight
        fields = {"u_n": u_n, "u_t": self._u_t, "slip": slip, "sigma_n": 0.0 - force_n / w,
                  "sigma_t": 0.0 - force_t / w, "bound": bound / w, "status": status.astype(int),
                  "gap": contact.at(step.time).gap}
        return fields if WEAR not in self.solver.effects.rooms else fields | {WEAR: depth}

    def _begin(self) -> np.ndarray:
        """Before the first step, after a preload: (n_c,) by how much nodes that rows do not tell of
        are elsewhere at time 0 than where slip starts from.
        """
        contact, (held, along) = self.contact, self.prescribed
        complete_start(self.solver, held, lambda: along)
        self._u_t = self.solver.initial[: len(held)]
        return np.where(held | of_axis(contact), self._weights @ along - self._u_t, 0.0)

    def _of_rows(self, step) -> np.ndarray:
        """(7, n_c) u_n, slip, normal and tangential force, bound, status, worn depth: what rows
        have.
        """
        solver, rows = self.solver, self.solver.rows
        structure, wear = solver.operator.structure, solver.effects.rooms.get(WEAR)
        values = np.zeros((7, len(structure.contact.gid)))
        yielded = solver.closure.yielded(step.multipliers)  # beside what the gap grew by before
        values[0, rows.normal_node] = rows.gap + yielded - step.gradient[rows.normal]
        if structure.yields:  # B u = c - gradient + what the asperities yield
            own = structure.compliance_of(structure.row_range[0] + rows.normal)
            values[0, rows.normal_node] += own * step.multipliers[rows.normal]
        values[1, rows.tangential_node] = 0.0 - step.gradient[rows.tangential]
        values[2, rows.normal_node] = step.multipliers[rows.normal]
        values[3, rows.tangential_node] = step.multipliers[rows.tangential]
        values[4, rows.tangential_node] = step.friction_bound
        values[5, rows.normal_node] = step.status
        if wear is not None:
            values[6, rows.tangential_node] = wear.depth[rows.tangential_node]
        # a node has one rank: no sum depends on their order
        solver.operator.comm.Allreduce(MPI.IN_PLACE, values)
        return values[:, : len(self.contact.gid)]


def _place(contact) -> tuple[dict, list[np.ndarray]]:
    """Columns of the nodes of a contact boundary, and the chains that these make."""
    nodes = {name: getattr(contact, name) for name in NODES}
    return nodes, chains(nodes)


def _quantities(place: dict, pieces: list[np.ndarray], shares: np.ndarray, fields: dict) -> dict:
    """Resultants, peak, length and zones of one step, as history.csv of single runs has them.

    `place` and `pieces` as from `_place`, `shares` of labels in nodes as from shares.py.
    """
    w = place["weight"]
    now = {name: values[None] for name, values in fields.items()}
    nodes = np.bincount(fields["status"], minlength=3)
    return {"resultant_n": 0.0 - float(resultant(shares, -fields["sigma_n"], w)),
            "resultant_t": float(resultant(shares, fields["sigma_t"], w)),
            "peak_pressure": largest_pressure(place, pieces, fields["sigma_n"]),
            "contact_length": contact_length(place, pieces, now, 0),
            "largest_slip": float(np.abs(fields["slip"]).max(initial=0)),
            **{f"nodes_{name}": int(nodes[k]) for k, name in enumerate(STATUS_NAMES)}}
