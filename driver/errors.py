"""What can go wrong for a user, and the exit status each kind has."""

import errno
import sys
from contextlib import contextmanager

NO_MEMORY = "not enough memory"
PETSC_ERR_MEM = 55


class DriverError(Exception):
    """Base of all errors that are reported in one line, without a traceback."""

    exit_status = 1


class InputError(DriverError):
    """Bad input or a missing dependency (exit status 2)."""

    exit_status = 2


class NoSolution(DriverError):
    """The problem has no solution, or none the method can vouch for (exit status 3)."""

    exit_status = 3


class NotConverged(DriverError):
    """The allowed iterations did not suffice; partial results are kept (exit status 4)."""

    exit_status = 4


def shortage(problem: BaseException) -> str:
    """One line for an error that comes of too little memory, empty for any other."""
    found = problem
    while found is not None:
        if (isinstance(found, MemoryError) or isinstance(found, OSError) and found.errno == errno.ENOMEM
                or getattr(found, "ierr", 0) == PETSC_ERR_MEM
                or isinstance(found, ImportError) and "failed to map segment" in str(found)):
            return NO_MEMORY
        found = found.__cause__ or found.__context__
    # Python's own code and imports lose their errors where they find no memory for them
    return f"Python failed ({problem}); was there enough memory?" if isinstance(problem, SystemError) else ""


def file_error(problem: Exception, said: str) -> InputError:
    """What is `said` of a file or program that the system does not give, unless memory was too short for it."""
    return InputError(shortage(problem) or said)


def tell(problem) -> None:
    """An error in one line of its own, also where several ranks write at the same time."""
    sys.stderr.write(f"error: {problem}\n")


def agree(comm, error: DriverError | None) -> None:
    """Raise on every rank of `comm` the first rank's error, if any rank has one.

    Without this a rank that refuses its input leaves the others waiting in the next collective call.
    """
    for found in comm.allgather(error):
        if found is not None:
            raise found


@contextmanager
def agreed_writes(comm):
    """A block in which ranks may write files and nothing is collective; its DriverError or OSError is raised on all."""
    error = None
    try:
        yield
    except DriverError as problem:
        error = problem
    except OSError as problem:
        error = write_error(problem)
    agree(comm, error)


def write_error(problem: OSError) -> InputError:
    """A full disk, a directory that is not writable, ... in one line."""
    where = f" ({problem.filename})" if problem.filename else ""
    return file_error(problem, f"writing the results failed: {problem.strerror or problem}{where}")


def error_of(status: int, reason: str) -> DriverError:
    """The error that stands for an exit status."""
    kind = {2: InputError, 3: NoSolution, 4: NotConverged}[status]
    return kind(reason)
