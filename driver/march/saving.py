"""What a run saves of its finished steps in checkpoints, and how it takes them up again.

The solver's own state is that after the last step; of each finished step the multipliers and what
else a `Step` holds are kept, so that tables, records and estimates can see it again. Arrays follow
the global numbering of dual rows and contact nodes and numbers are exact: any number of ranks goes
on with the same bits.
"""

import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ..errors import agreed_writes
from ..feti.gathering import by_node
from . import checkpoint
from .packing import Stack
from .quasistatic import QuasistaticSolver
from .step import Step
from .uniqueness import Uniqueness

CARRIED = ("counts", "residuals", "steps", "warnings", "contraction", "seconds",
           "examining", "renewing")  # of a History


class Checkpoints:
    """Saves and restores a solver and its finished steps in `directory`; collective.

    Tables, records and estimates are none of it: finished steps are replayed through them.
    """

    def __init__(self, directory: Path, identity: dict, solver: QuasistaticSolver):
        """`identity` as from `fingerprint`."""
        self.directory, self.identity, self.solver = directory, identity, solver
        self.comm = solver.operator.comm
        self.next = 0.0  # time.perf_counter() from which another one may be written
        self.saved = []  # on rank 0: the steps of the last checkpoint as `_gathered`
        self.unsaved = []  # the steps since then

    def restore(self) -> list[Step]:
        """The finished steps of a checkpoint, if any; the solver takes over its state."""
        state = self.comm.bcast(checkpoint.read(self.directory) if self.comm.rank == 0 else None)
        if state is None:
            return []
        restore(self.solver, state["solver"])
        self.saved = _unstacked(state["steps"])
        return [_scattered(step, self.solver) for step in self.saved]

    def save(self, step: Step, files: list[str]) -> None:
        """Keep the state after `step`, unless the share of time for checkpoints is used up.

        `files` in `directory` are whole, and not written again for finished steps.
        """
        start = time.perf_counter()
        self.unsaved.append(step)
        if not self.comm.bcast(start >= self.next):
            return
        self.saved += [_gathered(step, self.solver) for step in self.unsaved]
        self.unsaved = []
        state = {"fingerprint": self.identity, "solver": snapshot(self.solver)}
        with agreed_writes(self.comm):
            if self.comm.rank == 0:
                checkpoint.write(self.directory,
                                 state | {"steps": _stacked(self.saved), "files": files})
        now = time.perf_counter()
        self.next = now + (now - start) / checkpoint.SHARE


# ---- of the solver ------------------------------------------------------------------------------

def _carried(solver: QuasistaticSolver) -> dict[str, np.ndarray]:
    """What friction carries between steps at the rank's tangential rows, (j,) by name."""
    nodes = solver.rows.tangential_node
    own = {} if solver.rows.bound_is_given else {"coefficient": solver.rows.coefficient}
    return {"elastic": solver.slip.elastic, **own,
            **{name: values[nodes] for name, values in solver.effects.carried().items()}}


def snapshot(solver: QuasistaticSolver) -> dict | None:
    """All that the next step depends on and that the run reports, on rank 0; collective.

    Arrays follow the global numbering of dual rows and contact nodes, numbers are exact: any
    number of ranks goes on from it with the same bits.
    """
    op, history, rows, carried = solver.operator, solver.history, solver.rows, _carried(solver)
    cycles = {} if solver.cycles is None else solver.cycles.kept(solver)
    nodes = by_node(carried, rows.tangential_node, len(op.structure.contact.gid), op.comm)
    parts = op.comm.gather((solver.multipliers, solver.older))
    if parts is None:
        return None
    multipliers, older = map(np.concatenate, zip(*parts))
    product, step, iteration, kind, residual = zip(*history.log) if history.log else ((),) * 5
    return {
        "multipliers": multipliers, "older": older, "carried": nodes,
        "initial": solver.initial, "initial_weights": solver.initial_weights,
        "norm_bound": float(solver.qp.bound), "products": op.products,
        "scales": {name: np.asarray(value) for name, value in solver.scales.largest.items()},
        "deformation": solver.scales.displacements, "slip_weights": solver.slip.weights,
        "motion": solver.motion, "older_motion": solver.older_motion,
        "contraction": solver.contraction,
        "placed": solver.bodies.placed, "deformed": solver.deformed,
        "log_numbers": np.array([product, step, iteration], np.int64),
        "log_kind": np.array(kind, str),
        "log_residual": np.array(residual, float), "fallbacks": history.fallbacks.steps,
        "history": {name: getattr(history, name) for name in CARRIED},
        "cycles": cycles, "corners": {} if rows.corners is None else rows.corners.carried(),
        "doubtful": solver.doubtful, "more_digits": solver.more_digits.needed,
        "eliminated": solver.condensation.eliminated,
        "uniqueness": {
            **asdict(solver.uniqueness), "several": list(solver.uniqueness.several.items())}
    }


def restore(solver: QuasistaticSolver, state: dict) -> None:
    """Continue from a `snapshot` of the same problem and settings; the same on every rank."""
    mine, node = slice(*solver.operator.structure.row_range), solver.rows.tangential_node
    history = solver.history
    solver.multipliers, solver.older = state["multipliers"][mine], state["older"][mine]
    solver.motion, solver.older_motion = state["motion"], state["older_motion"]
    solver.contraction = state["contraction"]
    solver.bodies.placed, solver.deformed = state["placed"], state["deformed"]
    solver.slip.elastic = state["carried"]["elastic"][node]
    solver.slip.weights = state["slip_weights"]
    if not solver.rows.bound_is_given:
        solver.rows.coefficient = state["carried"]["coefficient"][node]
    for name, values in solver.effects.carried().items():
        values[:] = state["carried"][name]
    if solver.cycles is not None:
        solver.cycles.resume(solver, state["cycles"])
    solver.initial[:], solver.initial_weights[:] = state["initial"], state["initial_weights"]
    if solver.rows.corners is not None:
        solver.rows.corners.restore(state["corners"])
        solver.condensation.select()
    solver.qp.bound, solver.doubtful = state["norm_bound"], state["doubtful"]
    solver.more_digits.needed = state["more_digits"]
    solver.condensation.eliminated = state["eliminated"]
    solver.scales.largest = dict(state["scales"])
    solver.scales.displacements = state["deformation"]
    several = dict(state["uniqueness"]["several"])
    solver.uniqueness = Uniqueness(**state["uniqueness"] | {"several": several})
    solver.operator.products = state["products"]
    numbers = state["log_numbers"].tolist()
    kinds, residuals = state["log_kind"].tolist(), state["log_residual"].tolist()
    history.log.extend(zip(*numbers, kinds, residuals))
    history.fallbacks.steps = state["fallbacks"]
    vars(history).update(state["history"])


# ---- of finished steps --------------------------------------------------------------------------

def _gathered(step: Step, solver: QuasistaticSolver) -> dict | None:
    """A step as numbers and arrays of the whole problem by row and contact node, on rank 0."""
    rows, comm = solver.rows, solver.operator.comm
    parts = comm.gather((step.multipliers, step.moved, rows.normal_node, step.status,
                         rows.tangential_node, step.friction_bound))
    if parts is None:
        return None
    multipliers, moved, normal, status, tangential, bound = map(np.concatenate, zip(*parts))
    nodes = len(solver.operator.structure.contact.gid)
    by_node = {"status": np.zeros(nodes, status.dtype), "friction_bound": np.zeros(nodes)}
    by_node["status"][normal], by_node["friction_bound"][tangential] = status, bound
    return {**vars(step), "gradient": None, "multipliers": multipliers, "moved": moved, **by_node}


def _scattered(step: dict, solver: QuasistaticSolver) -> Step:
    """This rank's part of a step from what `_gathered` returned."""
    own, rows = slice(*solver.operator.structure.row_range), solver.rows
    return Step(**step | {"multipliers": step["multipliers"][own], "moved": step["moved"][own],
                          "status": step["status"][rows.normal_node],
                          "friction_bound": step["friction_bound"][rows.tangential_node]})


def _stacked(steps: list[dict]) -> dict:
    """Steps by name of their parts: stacks of arrays, lists of everything else."""
    return {name: (Stack if isinstance(part, np.ndarray) else list)(step[name] for step in steps)
            for name, part in steps[0].items()}


def _unstacked(parts: dict) -> list[dict]:
    """The steps again."""
    return [dict(zip(parts, values)) for values in zip(*parts.values())]
