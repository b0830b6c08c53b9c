"""What can go wrong for a user, and the exit status each kind has."""

import errno
import sys
from contextlib import contextmanager
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
NO_MEMORY = "not enough memory"
PARTIAL = "; partial results are in "  # after the reason of a run that did not converge
PETSC_ERR_MEM = 55


class DriverError(Exception):
    """Base of all errors that are reported in one line, without a traceback."""

    exit_status = 1


class InputError(DriverError):
    """Bad input or a missing dependency (exit status 2)."""

    exit_status = 2


class Defect(DriverError):
    """A defect of the suite, no fault of the input; a log has the traceback (exit status 1)."""


class NoSolution(DriverError):
    """The problem has no solution, or none the method can vouch for (exit status 3)."""

    exit_status = 3


class NotConverged(DriverError):
    """The allowed iterations did not suffice; partial results are kept (exit status 4)."""

    exit_status = 4


def error_of(status: int, reason: str) -> DriverError:
    """The error that stands for an exit status."""
    return {1: Defect, 2: InputError, 3: NoSolution, 4: NotConverged}[status](reason)


def report_error(problem) -> None:
    """An error in one line of its own, also where several ranks write at the same time."""
    sys.stderr.write(f"error: {problem}\n")


# ---- defects -------------------------------------------------------------------------------------

def words_of(problem: BaseException) -> str:
    """An exception in one line: what it says, or what it is."""
    return shortage(problem) or " ".join(str(problem).split()) or type(problem).__name__


def defect(problem: Exception, log: Path | None = None) -> Defect:
    """The error for an unexpected exception, whose traceback is added to `log`, else to a new file.

    Notes of the exception, such as how the run may go on, end the line.
    """
    import traceback  # here and below: what no run needs delays all, and the heed of interrupts

    name = problem.__class__.__name__
    said = " ".join([name] if str(problem) == name else [f"{name}:", *str(problem).split()])
    inside = [frame for frame in traceback.extract_tb(problem.__traceback__)
              if Path(frame.filename).is_relative_to(PACKAGE)]
    place = "".join(f" ({Path(frame.filename).relative_to(PACKAGE)} line {frame.lineno})"
                    for frame in inside[-1:])
    trace = "".join(traceback.format_exception(problem))
    return Defect("".join([defect_line(f"{said.removesuffix(':')}{place}", trace, log),
                           *getattr(problem, "__notes__", [])]))


def defect_line(cause: str, trace: str, log: Path | None = None) -> str:
    """One line about a defect; `trace` goes to the end of `log`, else to a file in a place for
    temporary ones.
    """
    return (f"a defect of the suite, not of what it was given: {cause}; please report it with the "
            f"traceback, which is {kept(trace, log)}")


def kept(trace: str, log: Path | None = None) -> str:
    """Where `trace` is: at the end of `log`, else in a file in a place for temporary ones, or lost.
    """
    import tempfile

    try:
        if log is None:
            with tempfile.NamedTemporaryFile("w", prefix="driver-", suffix=".log", delete=False,
                                             errors="replace") as file:
                file.write(trace)
            log = file.name
        else:
            with open(log, "a", errors="replace") as file:
                file.write(trace)
            log = log.name
    except OSError as failed:
        return f"lost ({failed.strerror})"
    return f"in {log}"


# ---- files and memory ----------------------------------------------------------------------------

def shortage(problem: BaseException) -> str:
    """One line for an error that comes of too little memory, empty for any other."""
    cause = problem
    while cause is not None:
        if (isinstance(cause, MemoryError) or getattr(cause, "ierr", 0) == PETSC_ERR_MEM
                or isinstance(cause, OSError) and cause.errno == errno.ENOMEM
                or isinstance(cause, ImportError) and "failed to map segment" in str(cause)):
            return NO_MEMORY
        cause = cause.__cause__ or cause.__context__
    if isinstance(problem, SystemError):  # Python loses its own errors where memory is short
        return f"Python failed ({problem}); was there enough memory?"
    return ""


def file_error(problem: Exception, message: str) -> InputError:
    """`message` about a file or program that cannot be used, unless memory was too short for it."""
    return InputError(shortage(problem) or message)


def write_error(problem: OSError) -> InputError:
    """A full disk, a directory that is not writable, ... in one line."""
    if problem.errno == errno.EPIPE:
        return InputError("what reads the output has ended: let it read to the end, or give "
                          "QUIET=yes")
    where = f" ({problem.filename})" if problem.filename else ""
    if problem.errno in (errno.ENOSPC, errno.EDQUOT):
        where += ": make room there, or give another OUT; without fields (FIELDS=no) it takes less"
    return file_error(problem, f"writing the results failed: {problem.strerror or problem}{where}")


# ---- ranks ---------------------------------------------------------------------------------------

def agree(comm, error: DriverError | None) -> None:
    """Raise on every rank of `comm` the first rank's error, if any rank has one.

    Otherwise a rank that refuses its input would leave the others waiting in a collective call.
    """
    for each in comm.allgather(error):
        if each is not None:
            raise each


@contextmanager
def agreed_writes(comm):
    """A block that writes files; its DriverError or OSError, as InputError, reaches all ranks."""
    error = None
    try:
        yield
    except DriverError as problem:
        error = problem
    except OSError as problem:
        error = write_error(problem)
    agree(comm, error)
