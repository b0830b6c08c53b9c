"""A scene at several mesh sizes, time steps and tolerances: the runs that companions.py compares.

They share one process. Every mesh is exported and reduced once, however many runs it serves.
Collective over one communicator; the root rank alone starts FreeFEM, with one rank of its own.
"""

import dataclasses
import time
from pathlib import Path

import numpy as np

from ..errors import DriverError, agree, file_error
from ..march.problem import Problem, assemble
from ..march.quasistatic import QuasistaticSolver
from ..options import Settings
from ..results.record import Record
from ..results.relinearization import linearized
from ..results.touch import Touch
from .exports import Exports, spelled
from .mesh_counts import elements
from .refinement import STEM


def samples(manifest, stride: int) -> np.ndarray:
    """Indices of every `stride`-th time of a history, from the last back, and of the first.

    Where a cycle begins the history is cut in two.
    """
    start = manifest.cycle_start
    return np.unique(np.r_[0, np.arange(start, -1, -stride),
                           np.arange(manifest.steps, start, -stride)])


@dataclasses.dataclass
class Level:
    """A finished run."""

    record: Record
    values: dict  # quantities of interest
    at: int  # index of the step that they belong to
    products: int
    solver: QuasistaticSolver
    steps: list  # its `Step`s
    seconds: float  # of these
    declared: int  # steps of the history, with one cycle where it is repeated
    energy: dict | None = None  # error in energy at the step of the values, once it is estimated

    @property
    def touch(self) -> Touch:
        """Contact at the step of the values; collective."""
        return self.record.touch(self.at)


class Unwatched:
    """Is told of runs and their steps and of the stages that they belong to, and says nothing."""

    def stage(self, name: str, names: list[str]) -> None:
        """One of the stages `names` begins."""

    def begin(self, total: int) -> None:
        """A run of `total` steps begins."""

    def update(self) -> None:
        """A step of it is done."""

    def end(self) -> None:
        """It has ended."""


class Levels:
    """Meshes and finished runs of one scene."""

    def __init__(self, scene: Path, parameters: dict[str, str], folder: Path, comm,
                 settings: Settings, refined=(), without=(), plan: list | None = None,
                 watch=Unwatched()):
        """`parameters` of the command line; exports go to `folder`, which `close` removes.

        `settings`: of the runs about which contact is linearized, if they ask for that. `refined`:
        directories of finished cycles of adaptive refinement, whose exports are the meshes cycle=0,
        1, ... `without`: effects treated as undeclared. `plan`: cycles of the run that were jumped
        over after each. `watch`: what runs/watch.py has in place of Unwatched.
        """
        self.parameters, self.folder, self.comm = parameters, folder, comm
        self.settings, self.refined = settings, refined
        self.plan, self.watch = plan, watch
        self._exports = Exports(scene, parameters, without, folder)
        self.problems: dict = {}
        self.runs: dict = {}
        self.seconds = dict.fromkeys(("export", "setup", "solve"), 0.0)
        self.spent: dict = {}  # by problem: those of its export and its set-up
        self.products = 0

    def export_ahead(self, *exports: tuple) -> None:
        """Have another core make `exports`, each with the arguments of `exported`, one by one.

        Nothing is done where ranks keep the cores busy.
        """
        if self.comm.size == 1:
            self._exports.ahead(*exports)

    def place(self, **changes) -> Path:
        """Directory of the export with some parameters changed."""
        return self.folder / "-".join(f"{name}{spelled(value)}"
                                      for name, value in sorted(changes.items()))

    def problem(self, **changes) -> Problem:
        """The scene with parameters changed. Raises DriverError where it is refused."""
        key = tuple(sorted(changes.items()))
        if key not in self.problems:
            self.problems[key] = self._assemble(changes)
        return self.problems[key]

    def refines(self, mesh: dict, other: dict) -> bool:
        """Whether the body and its contact boundary have more elements on a mesh than on another.

        Collective.
        """
        fine, coarse = (elements(self.problem(**changes)) for changes in (mesh, other))
        return all(many > few for many, few in zip(fine, coarse) if many)

    def _assemble(self, changes: dict) -> Problem:
        if "cycle" not in changes:
            return self.exported(self.place(**changes), changes)
        cycle, more = changes["cycle"], {k: v for k, v in changes.items() if k != "cycle"}
        if not more:
            return linearized(assemble(self.refined[cycle] / "export", self.comm), self.settings,
                              self.comm)
        sizes = self.refined[cycle - 1] / STEM if cycle else None
        return self.exported(self.place(**changes), more, sizes, tuple(sorted(changes.items())))

    def exported(self, place: Path, changes: dict, sizes: Path | None = None,
                 key: tuple | None = None) -> Problem:
        """The scene with parameters changed, exported to `place`.

        `sizes`: stem of a field of element sizes; `key` of the problem, by default the changes.
        Raises DriverError where it is refused.
        """
        error, spent = None, {"export": 0.0}
        if self.comm.rank == 0:
            try:
                spent["export"] = self._exports.made(place, changes, sizes)
            except DriverError as refusal:
                error = refusal
            except OSError as failure:
                error = file_error(failure, f"writing the export failed: {failure.strerror}")
        agree(self.comm, error)
        spent = self.comm.bcast(spent)
        clock = time.perf_counter()
        problem = linearized(assemble(place, self.comm), self.settings, self.comm)
        spent["setup"] = time.perf_counter() - clock
        self.spent[key or tuple(sorted(changes.items()))] = spent
        for stage, seconds in spent.items():
            self.seconds[stage] += seconds
        return problem

    def run(self, settings: Settings, stride: int = 1, plan=None, **changes) -> Level:
        """The run with `settings` on every `stride`-th time. Raises DriverError if it fails.

        `plan`: cycles to skip after each, if not those of the run.
        """
        key = (*dataclasses.astuple(settings), stride, plan and tuple(plan),
               *sorted(changes.items()))
        if key not in self.runs:
            try:
                self.runs[key] = self._run(self.problem(**changes), settings, stride,
                                           plan or self.plan)
            except DriverError as failure:
                self.runs[key] = failure
        if isinstance(self.runs[key], DriverError):
            raise self.runs[key]
        return self.runs[key]

    def _run(self, problem: Problem, settings: Settings, stride: int, plan) -> Level:
        clock, before = time.perf_counter(), problem.operator.products
        times = samples(problem.manifest, stride)
        solver = problem.solver(settings, times, plan)
        record, steps = Record(problem.operator, solver), []
        self.watch.begin(solver.total)
        try:
            for step in solver.steps():
                record.add(step)
                steps.append(step)
                self.watch.update()
        finally:
            self.watch.end()
            products = problem.operator.products - before
            spent = time.perf_counter() - clock
            self.products += products
            self.seconds["solve"] += spent
        return Level(record, *record.quantities(), products, solver, steps, spent, len(times) - 1)

    def close(self) -> None:
        """Remove what is left of the exports, and end those that are under way."""
        if self.comm.rank == 0:
            self._exports.close()
