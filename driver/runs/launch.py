"""Starts the SPMD part of a run: in this process or on several ranks, and tells how it ended."""

import gc
import importlib
import json
import signal
import subprocess
import sys
from pathlib import Path

from .. import environment
from ..errors import DriverError, InputError

# modules that run on the ranks
STAGES = {"run": "driver.runs.solve", "study": "driver.studies.parametric", "accuracy": "driver.runs.goal"}


def solve(work: Path, request: dict, ranks: int) -> tuple[int, str]:
    """Run the SPMD part on `ranks` ranks; exit status and reason."""
    if ranks == 1:
        return solve_here(work, request)
    (work / "request.json").write_text(json.dumps(request))
    command = [*environment.mpirun(ranks), sys.executable, "-m", "driver", "solve", str(work)]
    env = {**environment.child_environment(), "PYTHONPATH": environment.python_path()}
    done = environment.run_child(command, env=env, stderr=subprocess.PIPE, text=True, errors="replace")
    try:
        answer = json.loads((work / "answer.json").read_text())
    except FileNotFoundError:
        raise InputError(_why_no_answer(done)) from None
    if done.returncode == 0:  # else a rank was killed after the work was done, and mpirun tells of it at length
        sys.stderr.write(done.stderr)
    for name in ("request.json", "answer.json"):
        (work / name).unlink()
    return answer["status"], answer["reason"]


def _why_no_answer(done) -> str:
    """One line out of what mpirun and its ranks have said; a traceback, which no user has caused, is shown whole."""
    told = [line.removeprefix("error: ") for line in done.stderr.splitlines() if line.startswith("error: ")]
    if told:
        return told[0]
    if "Traceback" in done.stderr:
        sys.stderr.write(done.stderr)
        return "a rank of the solver failed"
    if done.returncode in (-signal.SIGKILL, 128 + signal.SIGKILL):
        return "a rank of the solver was killed; was there enough memory?"
    return f"a rank of the solver died (mpirun exit {done.returncode}); was there enough memory?"


def load(kind: str = "run"):
    """Start PETSc and import the module that runs on the ranks. Raises InputError if a package is missing.

    `kind` is one of STAGES.
    """
    name = STAGES[kind]
    known = name in sys.modules
    try:
        environment.start_petsc()
        stage = importlib.import_module(name)
    except ImportError as problem:
        raise environment.package_error(problem) from None
    if not known:
        gc.freeze()  # modules stay to the end: the collector need not look through them again and again
    return stage


def solve_here(work: Path, request: dict) -> tuple[int, str]:
    """The SPMD part on the ranks this process was started with."""
    stage = load(next((kind for kind in ("accuracy", "study") if kind in request), "run"))
    from mpi4py import MPI

    try:
        return stage.run(work, request, MPI.COMM_WORLD)
    except DriverError as problem:  # all ranks have agreed on it
        return problem.exit_status, str(problem)
