"""Private directories of runs: where a run works, how it replaces an older one, what it leaves.

A run to `out` works in a hidden directory beside it, which it locks as long as it lives. The
directory becomes `out` as a whole. If the process ends before that, the directory stays where it
holds a checkpoint; the next run to the same place finds it, because its lock is free.

The locks are on directories themselves and on rank 0's log, so that nothing has to be made, found
or removed beside them. The package filelock locks only files, which it empties.
"""

import ctypes
import errno
import fcntl
import os
import re
import shutil
import signal
import time
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError, NoSolution, NotConverged, file_error, write_error
from ..march import checkpoint

AT_FDCWD, RENAME_EXCHANGE = -100, 2  # of Linux
PATIENCE = 10  # seconds for the ranks of a killed run to end
ATTEMPTS = 100  # to find a name that is free


class Workspace:
    """The private directory `path` of a run to `out`, and `abandoned` ones of killed runs to there.

    As a context: a file error inside becomes an InputError, and the directory is removed at the end
    unless the run was stopped and another one could go on from what is there.
    """

    def __init__(self, out: Path):
        """Raises InputError if results cannot be written to `out`, an absolute path."""
        self.out, self._locks = out, {}
        _check(out)
        try:
            self._take_back()
            self.abandoned = [path for path in self._private() if self._lock(path)]
            for path in list(self.abandoned):
                if not _has_checkpoint(path):
                    self._remove(path)
            self.path = self._create()
        except OSError as problem:
            self._unlock_all()
            message = f"cannot write results to {out.parent}: {problem.strerror}"
            raise file_error(problem, message) from None

    def __enter__(self) -> "Workspace":
        return self

    def __exit__(self, kind, problem, _) -> None:
        stopped = kind is not None and not issubclass(kind, (NoSolution, NotConverged))
        try:
            outlook = self._outlook() if stopped else ""
            if not outlook:
                self._remove(self.path)
        finally:
            self._unlock_all()
        if stopped and issubclass(kind, OSError):
            raise InputError(f"{write_error(problem)}{outlook}") from None
        if outlook and issubclass(kind, (InputError, KeyboardInterrupt)):
            raise kind(f"{problem}{outlook}") from None

    def _outlook(self) -> str:
        """What another run with the same arguments would save."""
        state = checkpoint.read(self.path)
        if state:
            return f"; the same command goes on after step {checkpoint.steps(state)}"
        return "; the same command goes on from there" if _has_checkpoint(self.path) else ""

    def _create(self) -> Path:
        """A new directory, locked before another run can take it for a killed one's."""
        self.out.parent.mkdir(parents=True, exist_ok=True)
        for number in range(os.getpid(), os.getpid() + ATTEMPTS):
            path = self.out.with_name(f".{self.out.name}.{number}")
            try:
                path.mkdir()
            except FileExistsError:
                continue
            if self._lock(path):
                return path
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    # ---- what earlier runs have left -------------------------------------------------------------
    def _private(self, kind: str = "") -> list[Path]:
        """Private directories of runs to `out`; `kind` "old\\.": results between two renames."""
        pattern = re.compile(rf"\.{re.escape(self.out.name)}\.{kind}\d+")
        if not self.out.parent.is_dir():
            return []
        return sorted(path for path in self.out.parent.iterdir()
                      if pattern.fullmatch(path.name) and path.is_dir())

    def _take_back(self) -> None:
        """A result whose successor was killed between two renames has its private name only."""
        for path in self._private(r"old\."):
            if self.out.exists():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.rename(self.out)

    def take_up(self, stage: Path, identity: dict, resume: bool) -> tuple[int, set[str]]:
        """Copy to `stage` the checkpoint with this fingerprint that came farthest.

        `stage` is `path` or a directory in it. With `resume` false none is copied, and those that
        would fit are removed. Returns the number of finished steps, 0 without a checkpoint, and
        what is wrong with those that do not fit.
        """
        name, steps, misfits = stage.relative_to(self.path), {}, set()
        for path in list(self.abandoned):
            if not (path / name / checkpoint.NAME).is_file():
                continue
            state = checkpoint.read(path / name)
            if state is None or not _ended(path / name):
                misfits.add("a damaged one")
            elif different := checkpoint.differences(state, identity):
                misfits.add(f"one of other {' and '.join(different)}")
            elif resume:
                steps[path] = checkpoint.steps(state)
            else:
                self._remove(path)
        if steps:
            checkpoint.copy(max(steps, key=steps.get) / name, stage)
        if stage == self.path:  # which has all of them now, finished refinement cycles included
            for path in steps:
                self._remove(path)
        return max(steps.values(), default=0), misfits

    # ---- the end of a run ------------------------------------------------------------------------
    def publish(self, out: Path) -> None:
        """Put the finished directory in the place of an older one and remove abandoned ones."""
        with _undisturbed():
            for name in (checkpoint.NAME, f".{checkpoint.NAME}"):
                (self.path / name).unlink(missing_ok=True)
            if not out.exists():
                self.path.rename(out)
            elif not _exchange(self.path, out):
                old = out.with_name(f".{out.name}.old.{os.getpid()}")
                out.rename(old)
                self.path.rename(out)
                shutil.rmtree(old, ignore_errors=True)
        for path in list(self.abandoned):
            self._remove(path)

    def _remove(self, path: Path) -> None:
        """Remove a directory and free its lock."""
        shutil.rmtree(path, ignore_errors=True)
        if path in self.abandoned:
            self.abandoned.remove(path)
        if path in self._locks:
            os.close(self._locks.pop(path))

    # ---- locks -----------------------------------------------------------------------------------
    def _lock(self, path: Path) -> bool:
        """Lock a directory; False if the run that works there is alive."""
        try:
            descriptor = os.open(path, os.O_RDONLY)
        except OSError:
            return False
        if not _locked(descriptor):
            os.close(descriptor)
            return False
        self._locks[path] = descriptor
        return True

    def _unlock_all(self) -> None:
        while self._locks:
            os.close(self._locks.popitem()[1])


def _check(out: Path) -> None:
    """A run replaces its whole directory: it must be new, empty, or hold an earlier run."""
    try:
        if not out.name or out.exists() and not out.is_dir():
            raise InputError(f"OUT={out} is no directory that results can be written to")
        if out.is_dir() and any(out.iterdir()) and not (out / "summary.json").is_file():
            raise InputError(f"OUT={out} holds files but no earlier run; choose another directory "
                             "or empty it")
    except (OSError, ValueError) as problem:
        message = f"OUT={out} is no directory that results can be written to ({problem})"
        raise file_error(problem, message) from None


def _has_checkpoint(path: Path) -> bool:
    """Whether a run left a checkpoint in its directory, of itself or of a refinement cycle."""
    return any(path.rglob(checkpoint.NAME))


def _locked(descriptor) -> bool:
    """Lock an open file or directory; False if another process holds it or locks are unknown."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def lock_log(file) -> None:
    """Rank 0 locks its log, if it can: a killed run's ranks end before it is taken up."""
    _locked(file)


def _ended(path: Path) -> bool:
    """Wait until no rank writes to the log of a killed run; False if one does not end."""
    limit = time.monotonic() + PATIENCE
    with open(path / "run.log", "a") as log:
        while time.monotonic() < limit:
            if _locked(log):
                return True
            time.sleep(0.05)
    return False


@contextmanager
def _undisturbed():
    """Hold back interrupts, and the alarm that repeats them, until the block is done."""
    held, numbers = [], (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [signal.signal(number, lambda caught, _: held.append(caught)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before):
            signal.signal(number, handler)
        for number in held:
            signal.raise_signal(number)


def _exchange(first: Path, second: Path) -> bool:
    """Exchange two directories at once by Linux's renameat2; False where a file system cannot."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None)
    if rename is None:
        return False
    paths = os.fsencode(first), os.fsencode(second)
    return rename(AT_FDCWD, paths[0], AT_FDCWD, paths[1], RENAME_EXCHANGE) == 0
