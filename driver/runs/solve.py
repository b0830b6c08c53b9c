"""The SPMD part of a run: loader, operator, time stepping and results on one communicator."""

import contextlib
import dataclasses
import time
import traceback
from pathlib import Path

import numpy as np

from ..energy_norm import adaptivity
from ..energy_norm.energy import EnergyEstimator, excluded, of_time, report
from ..errors import Defect, DriverError, InputError, agreed_writes, defect, shortage, words_of
from ..estimates import between_steps, refinement
from ..feti.gathering import largest
from ..march.ahead import Ahead
from ..march.problem import Problem, assemble
from ..march.quasistatic import QuasistaticSolver
from ..march.saving import Checkpoints
from ..march.step import Step, StepFailed
from ..options import Settings
from ..results import summary
from ..results.relinearization import linearized
from ..results.writer import Writer
from ..scene.compared import asked_elsewhere
from ..timing import Laps
from ..validity import assumptions, soundness, starts_inside
from . import launch
from .drawing import drawn_aside
from .request import Request
from .watch import Progress, Watch

NO_ESTIMATES = "not all errors could be estimated"  # a warning, with the reason


class Solution(launch.Stage):
    """The solution of a run, whose subdomains are read and eliminated while FreeFEM writes."""

    ahead = True

    def __init__(self):
        super().__init__(run)
        self._ahead = None

    def advance(self, work: Path, comm) -> bool:
        """See launch.Stage."""
        if self._ahead is None:
            self._ahead = Ahead(work / "export", comm)
        return self._ahead.advance()

    def __call__(self, work: Path, request: Request, comm) -> tuple[int, str]:
        """See launch.Stage."""
        return run(work, request, comm, self._ahead)


def run(directory: Path, request: Request, comm,
        ahead: Ahead | None = None) -> tuple[int, str]:
    """Solve the export in ``directory/export`` and write the results into `directory`.

    Goes on from a checkpoint in `directory`, if there is one; `ahead` has done a part of the work,
    if it is given. Exit status and reason are the same on every rank; collective. Raises
    DriverError on all ranks where there is nothing to keep.
    """
    ahead = ahead or Ahead(directory / "export", comm)
    lap, idle = Laps(request.seconds), comm.allreduce(ahead.idle)
    seconds, settings = lap.seconds, Settings(**request.settings)
    problem = linearized(assemble(directory / "export", comm, lap, ahead=ahead), settings, comm)
    _check_quantity(request, problem)
    starts_inside.check(problem)
    if request.refine:
        _check_estimates(problem)
    solver = problem.solver(settings)
    lap("setup")
    _book(ahead, seconds, comm)
    writer = Writer(directory, problem.manifest, problem.operator, solver, request.fields)
    estimator = EnergyEstimator(problem.operator, problem.manifest, writer.contact,
                                settings.estimator)
    with _companions(directory, request, problem) as levels:
        return _finished(directory, request, problem, solver, writer, estimator, levels, lap, idle)


def _finished(directory: Path, request: Request, problem: Problem, solver: QuasistaticSolver,
              writer: Writer, estimator: EnergyEstimator, levels, lap: Laps,
              idle: float) -> tuple[int, str]:
    """`run` from its first step on."""
    comm, seconds = problem.operator.comm, lap.seconds
    resumed, before, failure = _march(directory, request, problem, solver, writer, estimator)
    lap("output")
    history = solver.history
    seconds["output"] -= history.seconds + history.examining - before  # of this process
    seconds["solve"] = history.seconds  # of all steps
    if history.examining:
        seconds["uniqueness"] = history.examining
    if history.renewing:
        seconds["solve"] -= history.renewing
        seconds["geometry"] = history.renewing
    valid, doubt = _validity(directory, request, problem, writer, estimator)
    lap("validity")
    status, reason = (failure.exit_status, str(failure)) if failure else (0, "")
    writer.close()

    content = summary.summarize(request, problem, solver, failure, solver.settings, writer,
                                summary.largest_memory(comm), seconds,
                                resumed_after_step=resumed, validity=valid)

    def leave(errors: dict | None, warning: str) -> None:
        said = [*content.warnings, *filter(None, [doubt, warning])]
        summary.write(directory, dataclasses.replace(
            content, errors=errors, warnings=said, memory_mib=summary.largest_memory(comm),
            seconds={**seconds, "total": sum(seconds.values())}), comm)

    if _may_fail(request):  # figures are drawn meanwhile; one rank's failure would end them all
        leave(None, f"{NO_ESTIMATES}: " + ("a rank of the solver failed" if comm.size > 1 else
                                           "they did not come to their end"))
        if comm.rank == 0 and comm.size > 1:
            launch.write_answer(directory, status, reason)
    estimated = _estimated(directory, request, problem, failure, writer, estimator, levels, lap,
                           idle)
    if levels is not None:
        levels.close()  # on a full disk the summary needs the room of the companions
    try:
        leave(*estimated)
    except InputError:
        if not _may_fail(request):
            raise  # otherwise that from before the estimates stands
    return status, reason


@contextlib.contextmanager
def _companions(directory: Path, request: Request, problem: Problem):
    """Meshes and runs to compare with, gone when a block ends; exports of those that are foreseen
    begin, on another core. None where there will not be any.
    """
    if request.errors != "yes":
        yield None
        return
    from ..estimates.alternatives import foreseen
    from ..estimates.levels import Levels

    settings = Settings(**{**request.settings, "uniqueness": "no"})
    levels = Levels(Path(request.script), request.parameters, directory / "companions",
                    problem.operator.comm, settings, [Path(place) for place in request.refined],
                    request.without)
    with contextlib.closing(levels):
        if not request.refined:
            levels.export_ahead(*((levels.place(**changes), changes)
                                  for changes in foreseen(problem.manifest)))
        yield levels


def _book(ahead: Ahead, seconds: dict, comm) -> None:
    """Count what was done while FreeFEM worked to its stages, and not to FreeFEM's; collective.

    What a run takes in all stays the same.
    """
    spent = largest(comm, np.array([*ahead.seconds.values()]))
    if spent.any():
        spent *= min(1.0, seconds["export"] / spent.sum())
        seconds["export"] -= spent.sum()
        for stage, of_stage in zip(ahead.seconds, spent.tolist()):
            seconds[stage] += of_stage


def _check_quantity(request: Request, problem: Problem) -> None:
    """Raise InputError where the scene has not the quantity whose price is asked for."""
    names = problem.effects.quantities
    if request.quantity and request.quantity not in names:
        raise InputError(f"QUANTITY={request.quantity}: the scene has no such quantity; it has "
                         f"{', '.join(names)}")


def _check_estimates(problem: Problem) -> None:
    """Raise InputError where no step under load has an error to refine by, before any is solved."""
    loaded = [weights for weights in problem.manifest.factors if weights.any()]
    reasons = [problem.effects.no_estimate(weights) for weights in loaded]
    adaptivity.check(reasons[-1] if reasons and all(reasons) else "")


def _march(directory: Path, request: Request, problem: Problem, solver: QuasistaticSolver,
           writer: Writer, estimator: EnergyEstimator) -> tuple[int, float, StepFailed | None]:
    """All time steps; number and seconds of those from an interrupted run, and what ended them.

    Raises StepFailed where there is no step to keep.
    """
    comm, history, failure = writer.operator.comm, solver.history, None
    checkpoints = Checkpoints(directory, request.fingerprint, solver)
    finished, products = checkpoints.restore(), solver.operator.products
    for step in finished:
        estimator.consider(step, *writer.add(step, replayed=True))
    solver.operator.products = products  # displacements refined anew count once
    resumed, before = history.steps, history.seconds + history.examining
    with agreed_writes(comm):
        progress = _progress(directory, request, problem, solver.total, resumed, comm)

    def add(step: Step) -> None:
        with agreed_writes(comm):
            progress.update(step)
            if step.cycle:
                progress.judge(solver.cycles)
        estimator.consider(step, *writer.add(step))

    history.watch = progress.within
    try:
        for step in _steps(solver, directory):
            add(step)
            checkpoints.save(step, writer.files)
    except StepFailed as stop:
        if not history.steps:
            raise
        failure = stop
        if failure.step is not None:
            add(failure.step)
    finally:  # of a run that a notebook interrupts nothing may keep the log open
        history.watch = None
    history.warnings += doubts(request, problem, solver,
                               estimator.largest and estimator.largest[1],
                               problem.structure.contact.motion_of_all_times)
    with agreed_writes(comm):
        progress.close(str(failure or "converged"))
    return resumed, before, failure


def doubts(request: Request, problem: Problem, solver: QuasistaticSolver, step: Step | None,
           motion) -> list[str]:
    """Warnings of a run that is done; `step`: the one with the largest energy, `motion`: of
    obstacles at the times at which it was looked at.
    """
    lines = [] if solver.cycles is None else solver.cycles.warnings()
    lines += soundness.warnings(problem, step)
    lines += asked_elsewhere(Path(request.script), problem.manifest)
    lines += between_steps.half_turns(problem.structure.contact.motion_of_all_times)
    if problem.effects.frictional:  # else the end does not depend on the way
        lines += between_steps.warnings(problem.manifest, motion)
    return lines


def _steps(solver: QuasistaticSolver, directory: Path):
    """The steps of `solver`; a defect of the suite ends them as StepFailed where some are done.

    With several ranks it ends them all: the others do not know of it.
    """
    try:
        yield from solver.steps()
    except DriverError:
        raise
    except Exception as problem:  # whatever it is, steps that are done stand
        if not solver.history.steps or solver.operator.comm.size > 1 or shortage(problem):
            raise
        reason = defect(problem, directory / "run.log")
        raise StepFailed(Defect(f"step {solver.history.steps + 1}: {reason}")) from None


def _progress(directory: Path, request: Request, problem: Problem, total: int, resumed: int,
              comm) -> Progress:
    """The report of progress, with its first line."""
    root = comm.rank == 0
    progress = Progress(total, resumed, request.scene, request.quiet or not root,
                        directory / "run.log" if root else None)
    line = f"{request.scene} {problem.manifest.parameters} {request.settings} on {comm.size} ranks"
    progress.note(f"{line}, resumed after step {resumed}" if resumed else line)
    return progress


def _validity(directory: Path, request: Request, problem: Problem, writer: Writer,
              estimator: EnergyEstimator) -> tuple[dict | None, str]:
    """Entry `validity` of the summary and a warning if it could not be made; collective."""
    try:
        return assumptions.assess(problem, writer.contact, estimator.considered,
                                  request.errors != "no"), ""
    except Exception as trouble:  # whatever it is, the results stand
        if problem.operator.comm.size > 1:
            raise
        with open(directory / "run.log", "a") as log:
            traceback.print_exc(file=log)
        return None, f"validity was not checked: {words_of(trouble)}"


def _may_fail(request: Request) -> bool:
    """Whether there are error estimates that the results can do without."""
    return request.errors != "no" and not request.refine


def _estimated(directory: Path, request: Request, *parts) -> tuple[dict | None, str]:
    """Entry `errors` of the summary and a warning if it could not be made; see `_estimate`."""
    errors = {}
    try:
        _estimate(errors, directory, request, *parts)
        return errors or None, ""
    except Exception as problem:  # whatever it is, the results stand
        comm = parts[0].operator.comm
        if not _may_fail(request) or comm.size > 1 and not isinstance(problem, DriverError):
            raise
        if comm.rank == 0 and not isinstance(problem, DriverError):
            with open(directory / "run.log", "a") as log:
                traceback.print_exc(file=log)
        return errors or None, f"{NO_ESTIMATES}: {words_of(problem)}"


def _estimate(errors: dict, directory: Path, request: Request, problem: Problem,
              failure: DriverError | None, writer: Writer, estimator: EnergyEstimator,
              levels, lap: Laps, idle: float) -> None:
    """Fill the entry `errors` of the summary as far as `request` asks for it; collective."""
    if request.errors == "no" or failure and failure.exit_status in (1, 3):
        return
    estimates = estimator.estimates()
    for step, estimate in estimates:
        if estimate.indicator is not None:
            writer.indicate(step, estimate.indicator)
    carrying = estimator.unloaded(estimates)
    errors["energy"] = report(estimates, estimator.kind, excluded(problem.manifest), estimator.why,
                              carrying)
    if request.refine:
        _next_mesh(directory, estimator,
                   [*(estimate for _, estimate in estimates), *([carrying] if carrying else [])])
    lap("energy_error")
    if request.errors == "yes" and not failure:
        with drawn_aside(directory, request, problem.manifest.nodes,
                         problem.operator.comm.size) as drawn:
            _budget(errors, request, problem, writer, estimator, levels, lap, idle)
            lap("estimates")
            if drawn():
                lap("figures")


def _next_mesh(directory: Path, estimator: EnergyEstimator, estimates: list) -> None:
    """Leave the element sizes of the next cycle's mesh."""
    with agreed_writes(estimator.operator.comm):
        if estimator.gather.root:
            adaptivity.next_mesh(directory / refinement.STEM, estimator, estimates)


def _budget(errors: dict, request: Request, problem: Problem, writer: Writer,
            estimator: EnergyEstimator, levels, lap: Laps, idle: float) -> None:
    """Fill `errors` with the budget of the quantities of interest, from companions of the finished
    run and adjoint problems, and with prices.

    `lap` has its seconds so far, `idle` are MiB before anything was read.
    """
    from ..estimates import adjoint
    from ..estimates.alternatives import price_list
    from ..estimates.companions import Companions, assess
    from ..estimates.prices import Measured

    cycles = writer.solver.cycles
    levels.plan = cycles and cycles.past.plan
    levels.watch = Watch(request.scene, request.quiet or writer.operator.comm.rank > 0)
    took, record = Measured.of(lap.seconds, problem.manifest), writer.record
    values, at = record.quantities()
    step = estimator.kept(at + 1)
    adjoints = adjoint.assess(problem, record, step, values, lambda: estimator.body)
    companions = Companions(levels, problem, levels.settings, record, adjoints, errors["energy"],
                            step)
    parts = assess(errors, companions)
    errors["adjoint"] = adjoints[1]
    errors["energy"] |= of_time(errors["quantities"], errors["energy"])
    errors["prices"] = price_list(companions, parts, errors["quantities"], request.quantity,
                                  took, idle, lambda: time.perf_counter() - lap.last)
