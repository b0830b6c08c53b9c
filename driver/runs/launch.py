"""Starts the part of a run that the ranks share, in this process or on several ranks.

A stage is given as a function without arguments, which imports a module for the ranks and makes a
`Stage` with what that does.
"""

import contextlib
import gc
import json
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

from .. import children, environment
from ..errors import Defect, DriverError, InputError, defect_line, kept
from ..options import CORES
from ..scene.manifest import Manifest, announced
from . import hosts
from .request import NAME, Request

ANSWER = "answer.json"
RANK = 80_000  # dofs for which a rank of its own pays
POLL = 2e-3  # seconds between two looks of a rank whether there is a request


def ranks_for(export: Manifest) -> int:
    """The ranks that solve an `export` on this machine, where nobody asked for a number.

    One step alone is mostly set-up, of which a rank does its part while FreeFEM writes: it leaves a
    core for that. On two cores a second rank would take a tenth of the time for a third more
    memory.
    """
    cores = CORES if export.quasistatic else max(1, CORES - 1)
    return min(cores, export.subdomains, paid_by(export))


def paid_by(export: Manifest) -> int:
    """The ranks that the size of an `export` pays for, on however many cores."""
    return max(1, 2 * export.nodes // RANK)


class Stage:
    """What ranks do, by a function run(directory, request, comm) that returns exit status and
    reason, on every rank alike.
    """

    ahead = False  # whether a part can be done before there is a request

    def __init__(self, run):
        self.run = run

    def advance(self, work: Path, comm) -> bool:  # pylint: disable=unused-argument
        """Do a little while FreeFEM works in `work`; whether there was something to do."""
        return False

    def __call__(self, work: Path, request: Request, comm) -> tuple[int, str]:
        """Exit status and reason."""
        return self.run(work, request, comm)


class Ranks(contextlib.ExitStack):
    """This process or ranks of their own, which get ready for a stage while FreeFEM works.

    with Ranks(work, stage, number) as ranks:
        manifest = freefem.export(..., meanwhile=ranks.prepare)
        status, reason = ranks.solve(request, manifest)
    """

    def __init__(self, work: Path, stage, number: int | None, wanted=ranks_for):
        """`number` None: as many as are `wanted` for the export, of which a function says that."""
        super().__init__()
        self.work, self.stage, self.number, self.wanted = work, stage, number, wanted
        self._child, self._loaded = None, None  # ranks that were started; the Stage, here

    def prepare(self) -> bool:
        """Start ranks or load the stage here, and begin with it; whether to call again: how many
        ranks there are to be is known once FreeFEM has the mesh, whether they live at any time.

        Raises InputError if a package is missing or a rank has died.
        """
        if self._child and self._child.poll() is not None:
            self._answer()  # there is none
        if self.number is None and (known := announced(self.work / "export")):
            self.number = self.wanted(known)
        if (self.number or 1) > 1:
            self._start()
        elif self._loaded is None:
            self._loaded = load(self.stage)
        elif self.number == 1:
            while self._loaded.advance(self.work, _world()):
                pass  # what there is to do has to be done, whether FreeFEM has ended or not
        return self.number is None or self._child is not None or self._loaded.ahead

    def solve(self, request: Request, manifest: Manifest | None = None) -> tuple[int, str]:
        """Run the stage; exit status and reason. The size is that of the export of `manifest`.

        Raises InputError if a rank dies, Defect if it does of an unexpected exception.
        """
        if self.number is None:
            self.number = self.wanted(manifest)
        if self.number == 1:
            return solve_here(self.work, request, self._loaded or load(self.stage))
        request.write(self.work)
        self._start()
        return self._answer()

    def _start(self) -> None:
        """Start the ranks, unless they run; they wait until their input ends."""
        if self._child is None:
            env = {**children.child_environment(), "PYTHONPATH": children.python_path()}
            command = [*children.mpirun(self.number, env), sys.executable, "-m", "driver",
                       "solve", self.stage.__name__, str(self.work)]
            self._child = self.enter_context(children.started(
                command, env=env, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                errors="replace"))
            self.callback(self._dismiss)

    def _dismiss(self) -> None:
        """Tell ranks that still wait that no request comes: they end by themselves.

        Mpirun takes two seconds to stop them.
        """
        if not self._child.stdin.closed:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._child.communicate(timeout=children.PATIENCE)

    def _answer(self) -> tuple[int, str]:
        """Let the ranks begin, which the end of their input tells them; what they come to."""
        errors = self._child.communicate()[1]
        done = subprocess.CompletedProcess(self._child.args, self._child.returncode, "", errors)
        try:
            answer = json.loads((self.work / ANSWER).read_text())
        except FileNotFoundError:
            raise _why_no_answer(done) from None
        if done.returncode == 0:
            sys.stderr.write(done.stderr)
        else:  # a rank died when the results were there
            with open(self.work / "run.log", "a") as log:
                log.write(done.stderr)
        for name in (NAME, ANSWER):
            (self.work / name).unlink()
        return answer["status"], answer["reason"]


def _world():
    """All ranks that this process was started with."""
    from mpi4py import MPI

    return MPI.COMM_WORLD


def awaited(work: Path, stage: Stage) -> Request | None:
    """What a rank that was started early is to do; None if the run came to nothing before.

    Rank 0 is told by the end of its input, the others by rank 0. Meanwhile they begin with the
    stage, and sleep where there is nothing to do, as the cores are FreeFEM's. Collective.
    """
    comm = _world()
    while comm.rank == 0 and not select.select([sys.stdin], [], [], 0)[0]:
        if not stage.advance(work, comm):
            time.sleep(POLL)
    begun = comm.Ibarrier()
    while not begun.Test():
        if not stage.advance(work, comm):
            time.sleep(POLL)
    there = comm.bcast((work / NAME).exists() if comm.rank == 0 else None)
    return Request.read(work) if there else None


def write_answer(work: Path, status: int, reason: str) -> None:
    """Leave what `solve` waits for; of rank 0."""
    (work / ANSWER).write_text(json.dumps({"status": status, "reason": reason}))


def _why_no_answer(done: subprocess.CompletedProcess) -> DriverError:
    """The error that mpirun and its ranks tell of; a traceback goes to a log."""
    if "Traceback" in done.stderr:
        last = next(line for line in done.stderr.partition("Traceback")[2].splitlines()[1:]
                    if line[:1].strip() and not line.startswith("Traceback"))
        return Defect(defect_line(f"{last} on a rank of the solver", done.stderr))
    return InputError(_why_it_died(done))


def _why_it_died(done: subprocess.CompletedProcess) -> str:
    """One line on ranks that ended without a traceback."""
    errors = [line.removeprefix("error: ") for line in done.stderr.splitlines()
              if line.startswith("error: ")]
    if errors:
        return errors[0]
    if children.several_hosts():
        return f"{hosts.lost(done.stderr)} was lost: it is down or a rank there was killed"
    if done.returncode in (-signal.SIGKILL, 128 + signal.SIGKILL):
        return "a rank of the solver was killed; was there enough memory?"
    said = f" What it said is {kept(done.stderr)}" if done.stderr.strip() else ""
    return (f"a rank of the solver died (mpirun exit {done.returncode}); was there enough memory?"
            f"{said}")


def load(stage) -> Stage:
    """Start PETSc and make the Stage. Raises InputError if a package is missing."""
    known = len(sys.modules)
    try:
        with environment.undisturbed():  # packages whose import is interrupted stay there in parts
            environment.prepare_numpy()
            environment.start_petsc()
            loaded = stage()
    except ImportError as problem:
        raise environment.package_error(problem) from None
    except ValueError as problem:
        if "numpy" not in str(problem):
            raise
        raise InputError(f"the numpy of this Python is not the one that petsc4py was built with "
                         f"({problem}): use /usr/bin/python3") from None
    if len(sys.modules) > known:
        gc.freeze()  # modules stay to the end: the collector need not look through them again
    return loaded


def solve_here(work: Path, request: Request, stage: Stage) -> tuple[int, str]:
    """Run a stage on the ranks that this process was started with; exit status and reason."""
    try:
        return stage(work, request, _world())
    except DriverError as problem:  # all ranks have agreed on it
        return problem.exit_status, str(problem)
