"""The machine: where it keeps FreeFEM, Open MPI and PETSc, as Debian packages them; how signals
end this process; memory and threads.
"""

import contextlib
import ctypes
import importlib.util
import mmap
import os
import re
import resource
import shutil
import signal
import sys
import threading
import warnings
from pathlib import Path

from .errors import InputError, file_error

ROOT = Path(__file__).resolve().parent.parent
LIBRARY = ROOT / "edp" / "lib"
CPU = Path("/proc/cpuinfo")
BLAS_BUFFER = 2**27  # bytes that OpenBLAS asks for at its first product
PETSC_ROOM = 150 * 2**20  # bytes of address space that PETSc, MPI and their libraries take at least
PETSC = Path("/usr/lib/petsc")  # where Debian's alternatives may have it
OPEN_FILES = 256  # that MPI, FreeFEM and matplotlib may need to have open together
AGAIN = 0.01  # seconds after which a lost interrupt comes once more
# Open MPI looks for fast networks and starts a daemon even for a single process, which takes longer
# than a small run; without the daemon such processes would share one directory
ALONE = {"OMPI_MCA_pml": "ob1", "OMPI_MCA_btl": "self", "OMPI_MCA_ess_singleton_isolated": "1",
         "OMPI_MCA_orte_create_session_dirs": "0"}
LEFT_BEHIND = ("OMPI_MCA_ess", "OMPI_MCA_pmix")  # what it then sets itself in the environment
LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID")  # set by launchers
EVERY_STEP = "DRIVER_EVERY_STEP"  # set where each step is to be printed, not some of them
SET_UP = "run 'make setup' (apt packages: see apt-packages.txt)"

_interrupts = []  # signals that have interrupted this process


def version() -> str:
    """The suite's version, which stands in pyproject.toml."""
    text = (ROOT / "pyproject.toml").read_text()
    return re.search(r'^version = "([^"]+)"', text, re.MULTILINE)[1]


@contextlib.contextmanager
def undisturbed():
    """Hold back interrupts, and the alarm that repeats them, until the block is done.

    They reach the main thread alone: in others there is nothing to do.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held, numbers = [], (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [signal.signal(number, lambda caught, _: held.append(caught)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before):
            signal.signal(number, handler)
        for number in held:
            signal.raise_signal(number)


def start_petsc() -> None:
    """Initialize MPI and PETSc.

    Raises ImportError if they are not installed and MemoryError if memory is short, for which they
    would end the process with a page of their own words.
    """
    if not {"mpi4py.MPI", "petsc4py.PETSc"} & set(sys.modules):  # else they have most of it
        _ask_for(PETSC_ROOM)
    _find_petsc()
    import petsc4py

    alone = not any(name in os.environ for name in LAUNCHED)
    settings = {name: value for name, value in ALONE.items() if alone and name not in os.environ}
    os.environ.update(settings)
    try:
        petsc4py.init(["driver", "-no_signal_handler"])  # the driver reports SIGINT and SIGPIPE
    finally:
        for name in settings:  # this process's own, not its children's
            del os.environ[name]
        for name in LEFT_BEHIND:
            if name not in os.environ:
                os.unsetenv(name)


def petsc_place() -> Path:
    """The folder of the PETSc that runs use, whether it is loaded or not."""
    if "PETSC_DIR" in os.environ:
        return Path(os.environ["PETSC_DIR"])
    newest = max(Path("/usr/lib/petscdir").glob("petsc*/*-real"), default=PETSC)
    return PETSC if PETSC.exists() else newest


def _find_petsc() -> None:
    """Let petsc4py find its PETSc, whose place Debian's package alone does not say.

    The package's .pth file reads PETSC_DIR when Python starts: here the path is set as well.
    """
    place = petsc_place()
    if place != PETSC:
        os.environ["PETSC_DIR"] = str(place)
    packages = place / "lib/python3/dist-packages"
    if packages.is_dir() and str(packages) not in sys.path:
        sys.path.append(str(packages))


def interpreter() -> str:
    """The Python that a run from Python is made with: this one, if it can have Debian's packages.

    The kernel of a notebook is often one of its own, without them or with another numpy.
    """
    debian = shutil.which("python3", path="/usr/bin")
    if debian is None or importlib.util.find_spec("mpi4py"):
        return sys.executable
    return debian


def check_process() -> None:
    """Refuse to start where MPI would fail with a page of its own words, or NumPy is not there.

    Raises InputError.
    """
    try:
        os.getcwd()
    except FileNotFoundError:
        raise InputError("the current directory no longer exists: "
                         "change to one that does") from None
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < OPEN_FILES <= hard:
        resource.setrlimit(resource.RLIMIT_NOFILE, (OPEN_FILES, hard))
    elif soft < OPEN_FILES:
        raise InputError(f"only {soft} files may be open at a time: raise the limit, "
                         f"ulimit -n {OPEN_FILES}")
    if importlib.util.find_spec("numpy") is None:  # before anything is begun that needs it
        raise package_error(ModuleNotFoundError(name="numpy"))


def heed_interrupts() -> None:
    """Clean up on SIGTERM as on ctrl-C, wherever it comes.

    In a callback of Python itself, as in imports, an interrupt is printed and lost: it is repeated.
    Libraries may drop one without a word, as NumPy does while it looks up what an object is:
    `heed_lost_interrupt` raises it.
    """
    def interrupt(number, frame):
        _interrupts.append(number)
        signal.default_int_handler(number, frame)

    def again(unraisable):
        if isinstance(unraisable.exc_value, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
        else:
            sys.__unraisablehook__(unraisable)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
        if number != signal.SIGINT or signal.getsignal(number) is signal.default_int_handler:
            signal.signal(number, interrupt)  # a job in the background may have to ignore SIGINT
    sys.unraisablehook = again


def heed_lost_interrupt() -> None:
    """Raise KeyboardInterrupt if one came and this is reached all the same; costs nothing."""
    if _interrupts:
        raise KeyboardInterrupt


def prepare_libraries() -> None:
    """One thread a rank, the same kernels of OpenBLAS everywhere, small pages for numpy.

    To be called before these are loaded.

    Many small dense products and factors run slower with more threads. CHOLMOD asks for four
    whatever OMP_NUM_THREADS says, for every few columns of a factor: on subdomains waiting for them
    takes three times as long as the work. Only the limit ends that. On processors that are newer
    than itself OpenBLAS takes kernels of 2004 (0.3.21 does from 2023 on): fronts take half as long
    again as with those of Haswell, which no others beat here. These round alike on all that have
    AVX2: products and factors are the same there to the last bit. Numpy asks for huge pages for
    arrays from 4 MiB on, and Linux makes room for them first: where arrays live for a subdomain
    that takes longer than they save, a fifth of the time of eliminating gluing rows.
    """
    os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if os.environ["OMP_NUM_THREADS"].isdigit():
        os.environ.setdefault("OMP_THREAD_LIMIT", os.environ["OMP_NUM_THREADS"])
    if {"avx2", "fma"} <= _features():
        os.environ.setdefault("OPENBLAS_CORETYPE", "HASWELL")


def _features() -> set[str]:
    """What the processor can do, as Linux names it on x86; empty where it says nothing."""
    try:
        return set(re.search("^flags.*:(.*)$", CPU.read_text(), re.MULTILINE)[1].split())
    except (OSError, TypeError):
        return set()


# options of linear programs: the postsolve of HiGHS in scipy 1.10 may abort the whole process
PLAIN_PROGRAM = {"presolve": False}


@contextlib.contextmanager
def silenced():
    """Keep what libraries print themselves off the screen: HiGHS tells of its phases."""
    sys.stdout.flush()
    try:
        kept = os.dup(1)
    except OSError:  # there is no screen
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # what C has not yet written
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def give_back_memory() -> None:
    """Return freed memory to the system: glibc keeps what factorizations leave, for other sizes."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # other C libraries have none
    if trim is not None:
        trim(0)


def prepare_numpy() -> None:
    """Let a shortage of memory end in an error, whenever it comes. Raises MemoryError.

    OpenBLAS that gets no work space tries again for ever, so it takes it here; NumPy that gets none
    for a comparison warns and continues with False.
    """
    warnings.filterwarnings("error", "elementwise comparison failed", DeprecationWarning)
    with undisturbed():  # packages whose import is interrupted stay there in parts
        import numpy as np

    _ask_for(BLAS_BUFFER)
    np.dot(np.ones((300, 300)), np.ones(300))  # smaller products do without


def _ask_for(size: int) -> None:
    """Raises MemoryError if the system would not give `size` bytes in one piece."""
    try:
        mmap.mmap(-1, size).close()
    except OSError:
        raise MemoryError from None


def package_error(problem: ImportError) -> InputError:
    """The error for a Python package that is missing or cannot be loaded, as with little memory."""
    if isinstance(problem, ModuleNotFoundError):
        debian = shutil.which("python3", path="/usr/bin")
        other = debian and Path(debian).resolve() != Path(sys.executable).resolve()
        remedy = f" and use {debian}, not {sys.executable}" if other else ""
        return InputError(f"the Python package {problem.name} is not installed; {SET_UP}{remedy}")
    words = " ".join(str(problem).split())
    return file_error(problem, f"a Python package cannot be loaded: {words}")
