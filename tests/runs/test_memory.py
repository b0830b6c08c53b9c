"""Too little memory ends a run with one line and exit status 2, wherever it is met; no hang, no
wrong numbers.
"""

import errno
import mmap
import resource
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import identity
from small_scenes import halved

from driver.march import checkpoint
from driver import children, environment
from driver.scene import loader, manifest
from driver.feti import cholesky
from driver.runs import workspace
from driver.runs.request import Request
from driver.errors import NO_MEMORY, InputError, shortage

MIB = 2**20
PATIENCE = 120  # seconds; a run takes one or two


def limited(mib: int, *words: str) -> SimpleNamespace:
    """The driver in `mib` of address space."""
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (mib * MIB, mib * MIB))

    done = subprocess.run([sys.executable, "-m", "driver", "run", *words], cwd=environment.ROOT,
                          timeout=PATIENCE,
                          preexec_fn=limit, env=children.child_environment(),
                          capture_output=True, text=True)
    return SimpleNamespace(status=done.returncode, errors=done.stderr)


@pytest.mark.parametrize("mib, ranks", [(40, 1), (100, 1), (160, 1), (270, 1), (306, 1), (348, 1),
                                        (345, 2), pytest.param(500, 2, marks=pytest.mark.slow)])
@pytest.mark.some(1)
def test_runs_end_in_one_line(mib, ranks, tmp_path):
    """From what Python takes to what the run needs: packages, OpenBLAS's work space, PETSc and MPI,
    the run itself.
    """
    words = ("SCENE=model", "STEPS=1", "ERRORS=no", "FIGURES=no", "QUIET=yes", f"NP={ranks}",
             f"OUT={tmp_path / 'run'}")
    done = limited(mib, *words)
    if done.status:  # where the packages take less, the largest may suffice
        assert done.status == 2 and "Traceback" not in done.errors
        # of a rank that MPI itself has ended one knows no more than that it died
        died = ranks > 1 and done.errors.endswith("; was there enough memory?\n")
        assert died or done.errors.endswith(f"error: {NO_MEMORY}\n")
        assert not (tmp_path / "run").exists()


STARVED = """
import resource, sys
sys.path.insert(0, {root!r})
from driver import environment
import numpy as np
{before}
words = open("/proc/self/statm").read().split()
size = int(words[0]) * resource.getpagesize() + {room} * 2**20
resource.setrlimit(resource.RLIMIT_AS, (size, size))
try:
    {act}
    print("went on")
except BaseException as problem:
    from driver.errors import shortage
    print(shortage(problem))
"""


@pytest.mark.parametrize("room, before, act", [
    (64, "", "environment.prepare_numpy()"),
    (1, "environment.prepare_numpy(); x = np.zeros(10**7)", "print(x == 0)"),
    (1, "environment.prepare_numpy(); x = np.zeros(10**7)", "print(np.array_equal(x, x))"),
])
def test_numpy_fails_instead_of_waiting_or_guessing(room, before, act):
    """OpenBLAS asks for 128 MiB, a comparison of 1e7 numbers for 10; neither is there."""
    code = STARVED.format(root=str(environment.ROOT), room=room, before=before, act=act)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                          timeout=PATIENCE)
    assert done.stdout == f"{NO_MEMORY}\n", done.stderr


def test_shortages_are_told_from_other_errors():
    def raised(first, second):
        second.__cause__ = first
        return second

    assert shortage(raised(MemoryError(), DeprecationWarning("comparison failed"))) == NO_MEMORY
    assert shortage(OSError(errno.ENOMEM, "Cannot allocate memory")) == NO_MEMORY
    assert shortage(ImportError("libx.so: failed to map segment from shared object")) == NO_MEMORY
    assert "enough memory?" in shortage(SystemError("error return without exception set"))
    assert shortage(PETSc.Error(55)) == NO_MEMORY and not shortage(PETSc.Error(71))
    assert not shortage(raised(ValueError("wrong"), KeyError("name")))
    assert not shortage(OSError(errno.ENOSPC, "full"))


@pytest.mark.parametrize("owner, name, act", [
    (mmap, "mmap", lambda export, folder: loader.read_subdomains(manifest.read_manifest(export), 0,
                                                                 1, MPI.COMM_SELF)),
    (Path, "read_text", lambda export, folder: manifest.read_manifest(export)),
    (Path, "read_bytes", lambda export, folder: checkpoint.read(export)),
    (subprocess, "Popen", lambda export, folder: children.run_child(["true"])),
    (Path, "mkdir", lambda export, folder: workspace.Workspace(folder / "out"))])
def test_a_system_call_that_finds_no_memory_is_told_as_that(exported, tmp_path, monkeypatch, owner,
                                                            name, act):
    """Not as a file that is spoiled or missing or a program that is not there."""
    export = exported(cells=2, subdomains=2)

    def starved(*_, **__):
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, starved)
        with pytest.raises((InputError, OSError)) as problem:
            act(export, tmp_path)
    # as cli.main does
    told = str(problem.value) if isinstance(problem.value, InputError) else shortage(problem.value)
    assert told == NO_MEMORY


def test_a_run_without_memory_leaves_nothing_behind(tmp_path):
    """Nothing was there to read, which is no shortage although a shortage is being handled."""
    with pytest.raises(MemoryError), workspace.Workspace(tmp_path / "out"):
        raise MemoryError
    assert not list(tmp_path.glob(".out.*"))


def test_a_factorization_that_finds_no_memory_does_not_blame_the_supports(monkeypatch):
    def starved(*_):
        raise MemoryError

    monkeypatch.setattr(cholesky.cholmod, "numeric", starved)
    with pytest.raises(MemoryError) as problem:
        cholesky.Interior(halved(identity(4)), np.arange(0), np.ones(4, bool))
    assert shortage(problem.value) == NO_MEMORY


ALONE = """
import sys
sys.path.insert(0, {root!r})
from mpi4py import MPI
from petsc4py import PETSc
from driver import cli
from driver.errors import InputError
from driver.runs import launch

def solve_here(work, request, stage):
    if MPI.COMM_WORLD.rank == 1:
        raise InputError("only this rank knows")
    MPI.COMM_WORLD.barrier()

launch.solve_here = solve_here
cli.solve(["solver", {work!r}])
"""


def test_a_rank_that_fails_alone_ends_the_others(tmp_path):
    Request("model", "model.edp", {}, {}).write(tmp_path)
    code = ALONE.format(root=str(environment.ROOT), work=str(tmp_path))
    done = subprocess.run([*children.mpirun(2), sys.executable, "-c", code], capture_output=True,
                          text=True, stdin=subprocess.DEVNULL,
                          timeout=PATIENCE, env=children.child_environment())
    assert done.returncode and "error: only this rank knows\n" in done.stderr
    assert not (tmp_path / "answer.json").exists()


def test_freed_memory_is_given_back():
    """What small arrays leave between those that stay; C libraries other than glibc do nothing."""
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    pieces = [np.ones(8000) for _ in range(1500)]  # of 64 kB each, from the heap
    stay, full = pieces[::10], resident()
    del pieces
    environment.give_back_memory()
    assert resident() < full - 0.5 * 1350 * 64e3 and len(stay) == 150


def test_c_libraries_that_give_nothing_back_are_left_alone(monkeypatch):
    monkeypatch.setattr(environment.ctypes, "CDLL", lambda name: object())
    environment.give_back_memory()
