"""Starts the part of a run that the ranks share, in this process or on several ranks.

A stage is a function without arguments that imports a module for the ranks and gives its function
run(directory, request, comm), which returns exit status and reason, on every rank alike.
"""

import gc
import json
import signal
import subprocess
import sys
from pathlib import Path

from .. import environment
from ..errors import Defect, DriverError, InputError, defect_line, kept
from ..options import CORES
from ..scene.manifest import Manifest
from . import hosts
from .request import NAME, Request

ANSWER = "answer.json"
RANK = 80_000  # dofs for which a rank of its own pays, though it starts after FreeFEM has ended


def ranks_for(manifest: Manifest) -> int:
    """The ranks that solve an export soonest on this machine, where nobody asked for a number."""
    return max(1, min(CORES, manifest.subdomains, 2 * manifest.nodes // RANK))


def solve(work: Path, request: Request, ranks: int, stage) -> tuple[int, str]:
    """Run a stage on `ranks` ranks; exit status and reason.

    Raises InputError if a rank dies, Defect if it does of an unexpected exception.
    """
    if ranks == 1:
        return solve_here(work, request, stage)
    request.write(work)
    env = {**environment.child_environment(), "PYTHONPATH": environment.python_path()}
    command = [*environment.mpirun(ranks, env), sys.executable, "-m", "driver", "solve", str(work)]
    done = environment.run_child(command, env=env, stderr=subprocess.PIPE, text=True,
                                 errors="replace")
    try:
        answer = json.loads((work / ANSWER).read_text())
    except FileNotFoundError:
        raise _why_no_answer(done) from None
    if done.returncode == 0:
        sys.stderr.write(done.stderr)
    else:  # a rank died when the results were there
        with open(work / "run.log", "a") as log:
            log.write(done.stderr)
    for name in (NAME, ANSWER):
        (work / name).unlink()
    return answer["status"], answer["reason"]


def write_answer(work: Path, status: int, reason: str) -> None:
    """Leave what `solve` waits for; of rank 0."""
    (work / ANSWER).write_text(json.dumps({"status": status, "reason": reason}))


def _why_no_answer(done: subprocess.CompletedProcess) -> DriverError:
    """The error that mpirun and its ranks tell of; a traceback goes to a log."""
    if "Traceback" in done.stderr:
        last = next(line for line in done.stderr.partition("Traceback")[2].splitlines()[1:]
                    if line[:1].strip())
        return Defect(defect_line(f"{last} on a rank of the solver", done.stderr))
    return InputError(_why_it_died(done))


def _why_it_died(done: subprocess.CompletedProcess) -> str:
    """One line on ranks that ended without a traceback."""
    errors = [line.removeprefix("error: ") for line in done.stderr.splitlines()
              if line.startswith("error: ")]
    if errors:
        return errors[0]
    if environment.several_hosts():
        return f"{hosts.lost(done.stderr)} was lost: it is down or a rank there was killed"
    if done.returncode in (-signal.SIGKILL, 128 + signal.SIGKILL):
        return "a rank of the solver was killed; was there enough memory?"
    said = f" What it said is {kept(done.stderr)}" if done.stderr.strip() else ""
    return (f"a rank of the solver died (mpirun exit {done.returncode}); was there enough memory?"
            f"{said}")


def load(stage):
    """Start PETSc and import `stage`; its function. Raises InputError if a package is missing."""
    known = len(sys.modules)
    try:
        with environment.undisturbed():  # packages whose import is interrupted stay there in parts
            environment.prepare_numpy()
            environment.start_petsc()
            run = stage()
    except ImportError as problem:
        raise environment.package_error(problem) from None
    except ValueError as problem:
        if "numpy" not in str(problem):
            raise
        raise InputError(f"the numpy of this Python is not the one that petsc4py was built with "
                         f"({problem}): use /usr/bin/python3") from None
    if len(sys.modules) > known:
        gc.freeze()  # modules stay to the end: the collector need not look through them again
    return run


def preload(stage, ranks: int) -> None:
    """Load a stage while FreeFEM works, if this process will run it."""
    if ranks == 1:
        load(stage)


def solve_here(work: Path, request: Request, stage) -> tuple[int, str]:
    """Run a stage on the ranks that this process was started with; exit status and reason."""
    run = load(stage)
    from mpi4py import MPI

    try:
        return run(work, request, MPI.COMM_WORLD)
    except DriverError as problem:  # all ranks have agreed on it
        return problem.exit_status, str(problem)
