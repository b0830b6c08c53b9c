"""Programs that this process starts, FreeFEM and mpirun above all, and how they end."""

import atexit
import contextlib
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from . import environment
from .environment import ROOT, SET_UP
from .errors import InputError, file_error

HOST_FILE = "OMPI_MCA_orte_default_hostfile"  # Open MPI's own name of the file of hosts
OWN_PLACE = "orte_tmpdir_base"  # Open MPI's own name of the place of what it keeps while it runs
PLACE = "driver-mpi-"  # begins the name of that place
OLD = 3600.0  # seconds after which an empty one is one that a killed run has left
HOSTS_KNOWN = (HOST_FILE, "SLURM_JOB_ID")  # set where ranks may start on other hosts
# of the environment to ranks on other hosts, besides Open MPI's own settings
HANDED_ON = re.compile("PATH|LD_LIBRARY_PATH|EXPORT_DIRECTORY|SIZE_FIELD|"
                       "(PYTHON|PETSC|OMP_|OPENBLAS_|FF_|DRIVER_).*")
LOOK_AGAIN = 0.01  # seconds between two looks at what a child has come to
PATIENCE = 10  # seconds that an interrupted child has to end by itself


def program(name: str) -> str:
    """Full path of a program. Raises InputError if it is not installed."""
    path = shutil.which(name)
    if not path:
        raise InputError(f"{name} is not installed; {SET_UP}")
    return path


def several_hosts() -> bool:
    """Whether ranks may start on other hosts than this one."""
    return any(name in os.environ for name in HOSTS_KNOWN)


def mpirun(ranks: int, env: dict[str, str] | None = None) -> list[str]:
    """Command prefix that starts `ranks` processes, more than cores if asked; they end with it.

    `env` is the environment that mpirun will have; ranks on other hosts get what they need of it.
    Raises InputError if mpirun is not installed or has no place to work in.
    """
    start = [program("mpirun"), "--oversubscribe", "--bind-to", "none"]
    if several_hosts():  # where it would leave a place of its own behind on each
        start += [word for name in filter(HANDED_ON.fullmatch, env or ()) for word in ("-x", name)]
    else:
        start += ["--mca", OWN_PLACE, place_of_mpirun()]
    return [*start, "-n", str(ranks), *end_with_parent("KILL")]


def end_with_parent(signal_name: str) -> list[str]:
    """Command prefix of a process that gets a signal when its parent ends, unless that ends in the
    first milliseconds.

    Raises InputError if util-linux, which every Debian has, is not installed.
    """
    return [program("setpriv"), "--pdeathsig", signal_name]


def place_of_mpirun() -> str:
    """A new directory for what one mpirun keeps while it runs, gone when this process ends.

    Left to themselves all of a user share one that the last of them removes; one that starts at
    that moment fails (Open MPI issue 8510: here one of 1,500, two at a time). So do two that make
    it at one moment, as FreeFEM's and the solver's of one run: one of 100. What runs that were
    killed have left goes first. Raises InputError.
    """
    try:
        _clear_places(Path(tempfile.gettempdir()))
        place = tempfile.mkdtemp(prefix=PLACE)
    except OSError as problem:
        raise file_error(problem, "mpirun has no place for temporary files: "
                                  f"{problem.strerror}") from None
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return place


def _clear_places(folder: Path) -> None:
    """Remove places of old that are empty, as those are whose mpirun has ended, if only killed."""
    for place in folder.glob(PLACE + "*"):
        with contextlib.suppress(OSError):  # of others, in use, or gone by now
            if time.time() - place.lstat().st_mtime > OLD:
                place.rmdir()


def run_child(command: list[str], meanwhile=lambda: None, **options) -> subprocess.CompletedProcess:
    """subprocess.run whose child ends with this process, however that ends.

    Calls `meanwhile` while it runs, again and again as long as that returns True. Raises InputError
    if the program cannot be started.
    """
    with started(command, stdin=subprocess.DEVNULL, **options) as child:
        while meanwhile():
            with contextlib.suppress(subprocess.TimeoutExpired):
                output, errors = child.communicate(timeout=LOOK_AGAIN)
                break
        else:
            output, errors = child.communicate()
    return subprocess.CompletedProcess(command, child.returncode, output, errors)


@contextlib.contextmanager
def started(command: list[str], **options):
    """A child that ends with this process, however that ends, or with a block that an error ends.

    On an interrupt mpirun has the time to stop its ranks and clean up. Raises InputError if the
    program cannot be started.
    """
    # FreeFEM catches SIGTERM and may go on for hours in what it was at; it has no ranks to stop
    signal_name = "KILL" if Path(command[0]).name == "FreeFem++" else "TERM"
    # as with threads and MPI it takes 50 ms to fork, for which Python's preexec_fn would ask
    try:
        child = subprocess.Popen([*end_with_parent(signal_name), *command], **options)
    except OSError as problem:
        message = f"{command[0]} cannot be started: {problem.strerror}"
        raise file_error(problem, message) from None
    with child:
        try:
            yield child
        except BaseException:
            _stop(child)
            raise


def _stop(child: subprocess.Popen) -> None:
    for number, patience in ((signal.SIGTERM, PATIENCE), (signal.SIGKILL, None)):
        child.send_signal(number)
        try:
            child.wait(patience)
            return
        except subprocess.TimeoutExpired:
            continue


def python_path() -> str:
    """PYTHONPATH of child processes: they find this package, whatever directory they work in."""
    return os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))


def child_environment(parallel: bool = False, element: str = "P1") -> dict[str, str]:
    """Environment of child processes: FreeFEM, which uses an `element` of the library, and MPI.

    FreeFEM looks for its includes and plugins where the package does not put them. Open MPI refuses
    to start as root without two settings, looks for fast networks for a quarter of a second, and
    lets waiting ranks keep a core busy that others could use. Between hosts a fast network counts.
    """
    env = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    if not several_hosts():
        env.setdefault("OMPI_MCA_pml", "ob1")
    env.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
    library = environment.LIBRARY
    own = [library, library / ("mpi" if parallel else "serial"), library / element]
    includes = [*map(str, own), env.get("FF_INCLUDEPATH"), "/usr/include/freefem++/idp"]
    plugins = ["/usr/lib/freefem++/mpi" if parallel else None, env.get("FF_LOADPATH"),
               "/usr/lib/freefem++"]
    env.update(DRIVER_LIBRARY=str(library), FF_INCLUDEPATH=";".join(filter(None, includes)),
               FF_LOADPATH=";".join(filter(None, plugins)))
    return env
