"""The SPMD part of a run: loader, operator, time stepping and results on one communicator."""

import resource
import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from petsc4py import PETSc

from ..estimates import adaptivity, soundness
from ..scene import elements
from ..march.checkpoint import Checkpoints
from ..errors import DriverError, agreed_writes
from ..estimates.energy import EnergyEstimator, report
from ..results.ledger import ledger
from ..scene.manifest import Manifest
from ..options import Settings
from ..march.problem import assemble
from ..march.step import StepFailed
from ..results.relinearization import linearized
from ..results.writer import Writer
from ..timing import Laps
from .workspace import lock_log

PRIMAL = {"gluing": 0, "normal": 1, "tangential": 2}


class Progress:
    """Steps done, residual and time left: a bar on a terminal, plain lines elsewhere, all lines in a log."""

    def __init__(self, total: int, done: int, label: str, quiet: bool, log: Path | None):
        """`done` steps of `total` are those of an interrupted run."""
        self.total, self.done, self.label, self.quiet, self.bar = total, done, label, quiet, None
        self.log = open(log, "a") if log else None
        if self.log:
            lock_log(self.log)
        if not quiet and sys.stderr.isatty():
            from tqdm import tqdm

            self.bar = tqdm(total=total, initial=done, desc=label, unit="step", file=sys.stderr)
        self.start = time.perf_counter()

    def update(self, step) -> None:
        """Report one finished step."""
        worst, spent = max(step.residuals.values()), time.perf_counter() - self.start
        line = (f"{self.label}: step {step.index}/{self.total}, {step.fixed_point_iterations} fixed-point iterations, "
                f"{step.products} products, KKT residual {worst:.1e}")
        self.note(f"{line}, {spent:.2f} s")
        if self.bar is not None:
            self.bar.set_postfix(fixed_point=step.fixed_point_iterations, products=step.products, kkt=f"{worst:.1e}")
            self.bar.update()
        elif not self.quiet and (step.index % max(1, self.total // 5) == 0 or step.index == self.total):
            print(f"{line}, {spent * (self.total - step.index) / (step.index - self.done):.0f} s left", flush=True)

    def note(self, line: str) -> None:
        """One line for the log alone."""
        if self.log:
            print(line, file=self.log, flush=True)

    def close(self, outcome: str) -> None:
        """Leave the bar and close the log with how the run ended."""
        self.note(outcome)
        if self.log:
            self.log.close()
        if self.bar is not None:
            self.bar.close()


def run(directory: Path, request: dict, comm) -> tuple[int, str]:
    """Solve the export in ``directory/export`` and write the results into `directory`.

    `request` holds scene, settings (of options.Settings), fields (bool), quiet (bool), seconds (of the
    stages before), errors, refine (bool) and fingerprint (see checkpoint). Goes on from a checkpoint in `directory`, if
    one is there. Collective over `comm`; returns exit status and reason, the same on every rank. Raises DriverError, on
    all ranks alike, where there is nothing to keep.
    """
    lap = Laps(request["seconds"])
    seconds = lap.seconds
    settings = Settings(**request["settings"])
    problem = linearized(assemble(directory / "export", comm, lap), settings, comm)
    manifest, structure, operator = problem.manifest, problem.structure, problem.operator
    solver = problem.solver(settings)
    lap("setup")
    writer = Writer(directory, manifest, operator, solver, request["fields"])
    estimator = EnergyEstimator(operator, manifest, writer.contact, settings.estimator)
    parts = {"solver": solver, "writer": writer, "estimator": estimator}
    checkpoints = Checkpoints(directory, request["fingerprint"], parts, comm)
    checkpoints.restore()
    root, done, spent = comm.rank == 0, solver.history.steps, solver.history.seconds
    with agreed_writes(comm):
        progress = Progress(manifest.steps, done, request["scene"], request["quiet"] or not root,
                            directory / "run.log" if root else None)
        progress.note(f"{request['scene']} {manifest.parameters} {request['settings']} on {comm.size} ranks"
                      + f", resumed after step {done}" * bool(done))
    history, failure = solver.history, None

    def report_step(step) -> None:
        with agreed_writes(comm):
            progress.update(step)
        estimator.consider(step, *writer.add(step))

    try:
        for step in solver.steps():
            report_step(step)
            checkpoints.save()
    except StepFailed as stop:
        if not history.steps:
            raise
        failure = stop
        if failure.step is not None:
            report_step(failure.step)
    history.warnings += soundness.warnings(problem, estimator.largest and estimator.largest[1])
    with agreed_writes(comm):
        progress.close(str(failure or "converged"))
    seconds["solve"] = history.seconds
    summary = summarize(request, problem, solver, failure, settings, comm)
    lap("output")
    seconds["output"] -= history.seconds - spent  # of this process; seconds["solve"] is that of all steps
    if request["errors"] != "no" and not (failure and failure.exit_status == 3):
        estimates = estimator.estimates()
        summary["errors"] = {"energy": _energy_error(estimates, writer, estimator.kind)}
        if request.get("refine"):
            _next_mesh(directory, estimator, estimates, comm)
        lap("energy_error")
    if request["errors"] == "yes" and not failure:
        summary["errors"] |= _budget(directory, request, problem, writer, comm)
        lap("estimates")
    seconds["total"] = sum(seconds.values())
    summary["seconds"], summary["resumed_after_step"] = seconds, done
    summary["effects_ledger"] = ledger_of(summary["sizes"], structure, solver, manifest.factors, writer, comm)
    writer.close(summary)
    return (failure.exit_status, str(failure)) if failure else (0, "")


def _energy_error(estimates, writer, kind: str) -> dict:
    """Error in the energy norm of the estimated steps, whose fields get the indicator."""
    for step, estimate in estimates:
        if estimate.indicator is not None:
            writer.indicate(step, estimate.indicator)
    return report(estimates, kind)


def _next_mesh(directory: Path, estimator, estimates, comm) -> None:
    """Leave the element sizes of the next cycle's mesh."""
    with agreed_writes(comm):
        if comm.rank == 0:
            adaptivity.next_mesh(directory / adaptivity.STEM, estimator.body.mesh, [found for _, found in estimates],
                                 elements.DEGREE[estimator.manifest.element])


def _budget(directory: Path, request: dict, problem, writer, comm) -> dict:
    """Error budget in the quantities of interest, from companions of the finished run."""
    from ..estimates.levels import Levels, assess

    settings = Settings(**{**request["settings"], "uniqueness": "no"})
    levels = Levels(Path(request["path"]), request["parameters"], directory / "companions", comm, settings,
                    [Path(place) for place in request["cycles"]])
    try:
        return assess(levels, problem, settings, *writer.record.quantities())
    finally:
        levels.close()


def summarize(request, problem, solver, failure: DriverError | None, settings, comm) -> dict:
    """summary.json but for quantities, errors and ledger; `failure` says why a run did not converge. Collective."""
    manifest, structure, history, uniqueness = problem.manifest, problem.structure, solver.history, solver.uniqueness
    reason = str(failure or "")
    kinds = np.bincount(structure.row_kind, minlength=3)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    variant = next((str(v) for k, v in manifest.parameters.items() if k == "loading"), "")
    return {
        "scene": request["scene"], "variant": variant, "converged": failure is None,
        "reason": reason,
        "warnings": [*history.warnings, *history.fallbacks.warnings(), *uniqueness.warnings(),
                     *([reason] if reason else [])],
        "effects": problem.effects.summary,
        "sizes": {"subdomains": structure.total, "primal_dofs": structure.primal_dofs,
                  "dual_dofs": structure.dual_dofs, **{f"dual_{name}": int(kinds[k]) for name, k in PRIMAL.items()},
                  "coarse_dofs": structure.coarse_dofs, "contact_nodes": len(structure.contact.gid)},
        "steps": history.steps, "t_end": manifest.t_end, "counts": history.counts, "residuals": history.residuals,
        "contraction": history.contraction,
        "fallbacks": {name: len(steps) for name, steps in history.fallbacks.steps.items()},
        "uniqueness": uniqueness.summary(),
        "memory_mib": comm.allreduce(peak), "ranks": comm.size, "units": manifest.units,
        "amplitudes": manifest.amplitudes, "parameters": {**manifest.parameters, **asdict(settings)},
        "versions": _versions(),
    }


def ledger_of(sizes: dict, structure, solver, amplitudes, writer, comm) -> dict:
    """Entry `effects_ledger` of summary.json: which declared effects mattered and what they cost; collective.

    `sizes` as in summary.json, `amplitudes` (steps + 1, patterns).
    """
    largest = [max([np.abs(sub.loads[k]).max(initial=0) for sub in structure.subdomains]
                   + [np.abs(values[k]).max(initial=0) for values in structure.fixed_values], default=0.0)
               for k in range(structure.patterns)]
    return ledger(solver, sizes, amplitudes, np.max(comm.allgather(largest), axis=0), writer.history_rows)


def _versions() -> dict:
    return {"python": sys.version.split()[0], "numpy": np.__version__,
            "petsc": ".".join(map(str, PETSc.Sys.getVersion()))}
