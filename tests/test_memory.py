"""Too little memory ends a run with one line and exit status 2, wherever it is met; no hang, no wrong numbers."""

import errno
import resource
import subprocess
import sys
from types import SimpleNamespace

import pytest

from driver import environment
from driver.errors import NO_MEMORY, shortage

MIB = 2**20
PATIENCE = 120  # seconds; a run takes one or two


def limited(mib: int, *words: str) -> SimpleNamespace:
    """The driver in `mib` of address space."""
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (mib * MIB, mib * MIB))

    done = subprocess.run([sys.executable, "-m", "driver", "run", *words], cwd=environment.ROOT, timeout=PATIENCE,
                          preexec_fn=limit, env=environment.child_environment(), capture_output=True, text=True)
    return SimpleNamespace(status=done.returncode, errors=done.stderr)


@pytest.mark.parametrize("mib, ranks", [(40, 1), (100, 1), (160, 1), (270, 1), (340, 1), (345, 2), (500, 2)])
def test_runs_end_in_one_line(mib, ranks, tmp_path):
    """From what Python takes to what the run needs: packages, OpenBLAS's work space, PETSc and MPI, the run itself."""
    words = "SCENE=model", "STEPS=1", "ERRORS=no", "FIGURES=no", "QUIET=yes", f"NP={ranks}", f"OUT={tmp_path / 'run'}"
    done = limited(mib, *words)
    if done.status:  # where the packages take less, the largest may suffice
        assert done.status == 2 and done.errors.endswith(f"error: {NO_MEMORY}\n") and "Traceback" not in done.errors
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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE)
    assert done.stdout == f"{NO_MEMORY}\n", done.stderr


def test_shortages_are_told_from_other_errors():
    def raised(first, second):
        try:
            try:
                raise first
            except Exception as cause:
                raise second from cause
        except Exception as problem:
            return problem

    assert shortage(raised(MemoryError(), DeprecationWarning("comparison failed"))) == NO_MEMORY
    assert shortage(OSError(errno.ENOMEM, "Cannot allocate memory")) == NO_MEMORY
    assert shortage(ImportError("libx.so: failed to map segment from shared object")) == NO_MEMORY
    assert "enough memory?" in shortage(SystemError("error return without exception set"))
    assert not shortage(raised(ValueError("wrong"), KeyError("name"))) and not shortage(OSError(errno.ENOSPC, "full"))


ALONE = """
import sys
sys.path.insert(0, {root!r})
from mpi4py import MPI
from driver import cli
from driver.errors import InputError

def solve_here(work, request):
    if MPI.COMM_WORLD.rank == 1:
        raise InputError("only this rank knows")
    MPI.COMM_WORLD.barrier()

cli.solve_here = solve_here
cli.command_solve([{work!r}])
"""


def test_a_rank_that_fails_alone_ends_the_others(tmp_path):
    (tmp_path / "request.json").write_text("{}")
    code = ALONE.format(root=str(environment.ROOT), work=str(tmp_path))
    done = subprocess.run([*environment.mpirun(2), sys.executable, "-c", code], capture_output=True, text=True,
                          timeout=PATIENCE, env=environment.child_environment())
    assert done.returncode and "error: only this rank knows\n" in done.stderr
    assert not (tmp_path / "answer.json").exists()
