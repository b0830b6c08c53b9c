"""What a run saves of its finished steps in checkpoints, and how it takes them up again.

The solver's own state is that after the last step; of each finished step the multipliers and what
else a `Step` holds are kept, so that tables, records and estimates can see it again. Arrays follow
the global numbering of dual rows and contact nodes and numbers are exact: any number of ranks goes
on with the same bits.
"""

import time
from pathlib import Path

import numpy as np

from ..errors import agreed_writes
from . import checkpoint
from .quasistatic import QuasistaticSolver
from .step import Step


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
        self.solver.restore(state["solver"])
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
        state = {"fingerprint": self.identity, "solver": self.solver.snapshot()}
        with agreed_writes(self.comm):
            if self.comm.rank == 0:
                checkpoint.write(self.directory,
                                 state | {"steps": _stacked(self.saved), "files": files})
        now = time.perf_counter()
        self.next = now + (now - start) / checkpoint.SHARE


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
    """Steps by name of their parts: arrays stacked to (steps, ...), lists of everything else."""
    return {name: np.array([step[name] for step in steps]) if isinstance(part, np.ndarray) else
            [step[name] for step in steps] for name, part in steps[0].items()}


def _unstacked(parts: dict) -> list[dict]:
    """The steps again."""
    return [dict(zip(parts, values)) for values in zip(*parts.values())]
