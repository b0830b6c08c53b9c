"""Private directories of runs: where a run works, how it takes the place of an older one, what killed runs leave.

A run to `out` works in a hidden directory beside it, which it locks as long as it lives. The directory becomes
`out` as a whole. If the process ends before that, the directory stays where it holds a checkpoint; the next run
to the same place finds it, because its lock is free.
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

from ..march import checkpoint
from ..errors import InputError, NoSolution, NotConverged, file_error, write_error

AT_FDCWD, RENAME_EXCHANGE = -100, 2  # of Linux
PATIENCE = 10  # seconds for the ranks of a killed run to end


class Workspace:
    """The private directory `path` of a run to `out`, and those of earlier runs whose process is gone.

    As a context: a file error inside is told as InputError, and the directory is removed at the end unless the run
    was stopped and another one could go on from what is there.
    """

    def __init__(self, out: Path):
        """Raises InputError if results cannot be written to `out`."""
        self.out, self._locks = out, {}
        _check(out)
        try:
            self._take_back()
            self.left = [path for path in self._private() if self._claim(path)]
            for path in [path for path in self.left if not any(path.rglob(checkpoint.NAME))]:
                self._remove(path)
            self.path = self._create()
        except OSError as problem:
            self._release()
            raise file_error(problem, f"cannot write results to {out.parent}: {problem.strerror}") from None

    def __enter__(self) -> "Workspace":
        return self

    def __exit__(self, kind, problem, _) -> None:
        stopped = kind is not None and not issubclass(kind, (NoSolution, NotConverged))
        try:
            outlook = self._outlook() if stopped else ""
            if not outlook:
                self._remove(self.path)
        finally:
            self._release()
        if stopped and issubclass(kind, OSError):
            raise InputError(f"{write_error(problem)}{outlook}") from None
        if outlook and issubclass(kind, (InputError, KeyboardInterrupt)):
            raise kind(f"{problem}{outlook}") from None

    def _outlook(self) -> str:
        """What another run with the same arguments would save."""
        kept = checkpoint.read(self.path)
        if kept:
            return f"; the same command goes on after step {checkpoint.steps(kept)}"
        return "; the same command goes on from there" if any(self.path.rglob(checkpoint.NAME)) else ""

    def _create(self) -> Path:
        """A new directory that is locked before another run can take it for a killed one's."""
        self.out.parent.mkdir(parents=True, exist_ok=True)
        for number in range(os.getpid(), os.getpid() + 100):
            path = self.out.with_name(f".{self.out.name}.{number}")
            try:
                path.mkdir()
            except FileExistsError:
                continue
            if self._claim(path):
                return path
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    # ---- what earlier runs have left -------------------------------------------------------------
    def _private(self, kind: str = "") -> list[Path]:
        pattern = re.compile(rf"\.{re.escape(self.out.name)}\.{kind}\d+")
        if not self.out.parent.is_dir():
            return []
        return sorted(path for path in self.out.parent.iterdir() if pattern.fullmatch(path.name) and path.is_dir())

    def _take_back(self) -> None:
        """A result whose successor was killed between two renames has its private name only."""
        for path in self._private("old\\."):
            if self.out.exists():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.rename(self.out)

    def _claim(self, path: Path) -> bool:
        """Lock a directory; False if the run that works there is alive."""
        try:
            lock = os.open(path, os.O_RDONLY)
        except OSError:
            return False
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(lock)
            return False
        self._locks[path] = lock
        return True

    def take_up(self, stage: Path, identity: dict, resume: bool) -> tuple[int, set[str]]:
        """Let `stage`, a directory in `path` or `path` itself, start where an interrupted run with its fingerprint stopped.

        Of several such runs the one that came farthest; with `resume` false none, and they are removed. Returns
        the number of finished steps, 0 if there is none, and what is wrong with those that stay.
        """
        name, found, wrong = stage.relative_to(self.path), {}, set()
        for path in [path for path in self.left if (path / name / checkpoint.NAME).is_file()]:
            kept = checkpoint.read(path / name)
            if kept is None or not _ended(path / name):
                wrong.add("a damaged one")
            elif different := checkpoint.differences(kept, identity):
                wrong.add(f"one of other {' and '.join(different)}")
            elif resume:
                found[path] = checkpoint.steps(kept)
            else:
                self._remove(path)
        if found:
            checkpoint.copy(max(found, key=found.get) / name, stage)
        if stage == self.path:  # which has all of them now, finished refinement cycles included
            for path in found:
                self._remove(path)
        return max(found.values(), default=0), wrong

    # ---- the end of a run ------------------------------------------------------------------------
    def publish(self, out: Path) -> None:
        """Put the finished directory in the place of an older one; interrupted runs to there are of no use any more."""
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
        for path in list(self.left):
            self._remove(path)

    def _remove(self, path: Path) -> None:
        shutil.rmtree(path, ignore_errors=True)
        if path in self.left:
            self.left.remove(path)
        if path in self._locks:
            os.close(self._locks.pop(path))

    def _release(self) -> None:
        while self._locks:
            os.close(self._locks.popitem()[1])


def _check(out: Path) -> None:
    """A run replaces its whole directory: it must be new, empty, or hold an earlier run."""
    try:
        if not out.name or out.exists() and not out.is_dir():
            raise InputError(f"OUT={out} is no directory that results can be written to")
        if out.is_dir() and any(out.iterdir()) and not (out / "summary.json").is_file():
            raise InputError(f"OUT={out} holds files but no earlier run; choose another directory or empty it")
    except (OSError, ValueError) as problem:
        raise file_error(problem, f"OUT={out} is no directory that results can be written to ({problem})") from None


def lock_log(file) -> None:
    """Rank 0 holds this lock on its log: a killed run's directory is not taken up before its ranks have ended."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        pass  # a file system without locks


def _ended(path: Path) -> bool:
    """Wait until no rank writes to the log of a killed run; False if one does not end."""
    limit = time.monotonic() + PATIENCE
    with open(path / "run.log", "a") as log:
        while time.monotonic() < limit:
            try:
                fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return True
            except OSError:
                time.sleep(0.05)
    return False


@contextmanager
def _undisturbed():
    """Hold back interrupts, and the alarm by which one comes once more, until the block is done."""
    caught, numbers = [], (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [signal.signal(number, lambda got, _: caught.append(got)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before):
            signal.signal(number, handler)
        for number in caught:
            signal.raise_signal(number)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two directories in one step, as only Linux's renameat2 can; False where a file system cannot."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None)
    return rename is not None and rename(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE) == 0
