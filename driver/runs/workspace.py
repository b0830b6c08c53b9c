"""Private directories of runs: where a run works, how it replaces an older one, what it leaves.

A run to `out` works in a hidden directory beside it, which it locks as long as it lives. The
directory becomes `out` as a whole. If the process ends before that, the directory stays where it
holds a checkpoint; the next run to the same place finds it, because its lock is free.

The locks are on directories themselves and on rank 0's log, so that nothing has to be made, found
or removed beside them. The package filelock locks only files, which it empties.
"""

import contextlib
import ctypes
import errno
import os
import re
import shutil
import sys
import time
from pathlib import Path

from .. import environment
from ..errors import Defect, InputError, NoSolution, NotConverged, file_error, write_error
from ..march import checkpoint
from ..text import shown
from . import guard

AT_FDCWD, RENAME_EXCHANGE = -100, 2  # of Linux
PATIENCE = 10  # seconds for the ranks of a killed run to end
ATTEMPTS = 100  # to find a name that is free


class Workspace:
    """The private directory `path` of a run to `out`, and `abandoned` ones of killed runs to there.

    As a context: a file error inside becomes an InputError, and the directory is removed at the end
    unless the run was stopped and another one could go on from what is there.

    Private directories that are not this user's, or hold what no run writes, are left alone. Where
    other users could put something else in the place of a directory, the directories are reached by
    their descriptors.
    """

    def __init__(self, out: Path):
        """Raises InputError if results cannot be written to `out`."""
        self.out, self.abandoned = _checked(out), []
        self._held = {}  # by path: name and descriptor
        self._made = []  # directories above `out` that were not there
        try:
            self._take_back()
            self._before = _identity(self.out)
            private = self._private()
            self.abandoned += filter(None, map(self._hold, private))
            held = [name for name, _ in self._held.values()]
            if any(_alive(name) for name in private if name not in held):
                _warn(f"another run also writes to {shown(self.out)}: the results of the run that "
                      "ends last remain; stop one of them, or give it another OUT")
            for path in list(self.abandoned):
                if guard.foreign(path, unfinished=True):
                    self._release(path)
                elif not _has_checkpoint(path):
                    self._remove(path)
            self.path = self._create()
        except OSError as problem:
            self._release_all()
            message = f"cannot write results to {self.out.parent}: {problem.strerror}"
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
            self._release_all()
        if stopped and issubclass(kind, OSError):
            raise InputError(f"{write_error(problem)}{outlook}") from None
        if outlook and issubclass(kind, (InputError, Defect, KeyboardInterrupt)):
            raise kind(f"{problem}{outlook}") from None
        if outlook:
            problem.add_note(outlook)

    def _outlook(self) -> str:
        """What another run with the same arguments would save."""
        state = checkpoint.read(self.path)
        if state:
            return f"; the same command goes on after step {checkpoint.steps(state)}"
        return "; the same command goes on from there" if _has_checkpoint(self.path) else ""

    def _create(self) -> Path:
        """A new directory, locked before another run can take it for a killed one's."""
        self._made += [path for path in self.out.parents if not path.exists()]
        self.out.parent.mkdir(parents=True, exist_ok=True)
        for number in range(os.getpid(), os.getpid() + ATTEMPTS):
            name = self.out.with_name(f".{self.out.name}.{number}")
            try:
                name.mkdir(0o700)
            except FileExistsError:
                continue
            if path := self._hold(name):
                return path
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    # ---- what earlier runs have left -------------------------------------------------------------
    def _private(self, kind: str = "") -> list[Path]:
        """Names of private directories of runs to `out`; `kind` "old\\.": results between two
        renames.
        """
        pattern = re.compile(rf"\.{re.escape(self.out.name)}\.{kind}\d+")
        if not self.out.parent.is_dir():
            return []
        return sorted(path for path in self.out.parent.iterdir() if pattern.fullmatch(path.name))

    def _take_back(self) -> None:
        """A result whose successor was killed between two renames has its private name only."""
        for name in self._private(r"old\."):
            if not guard.is_own(name) or guard.foreign(name):
                continue
            if self.out.exists():
                shutil.rmtree(name, ignore_errors=True)
            else:
                name.rename(self.out)

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
    def publish(self, out: Path) -> Path:
        """Put the finished directory in the place of an older one and remove abandoned ones.

        Returns its new place: one beside `out`, which is said, if something else than a run is at
        `out` by now.
        """
        name, descriptor = self._held[self.path]
        if not os.path.samestat(os.lstat(name), os.fstat(descriptor)):
            raise InputError(f"{name} has been replaced by someone during the run: choose OUT in a "
                             "directory that others cannot write to")
        with environment.undisturbed():
            os.fchmod(descriptor, 0o777 & ~_umask())
            wanted, out = out, _free(out)
            if out == self.out and _identity(out) != self._before:
                _warn(f"another run has put its results into {shown(out)} meanwhile: these "
                      "replace them")
            if not out.exists():
                name.rename(out)
            elif _exchange(name, out):
                shutil.rmtree(name, ignore_errors=True)
            else:
                old = out.with_name(f".{out.name}.old.{os.getpid()}")
                out.rename(old)
                name.rename(out)
                shutil.rmtree(old, ignore_errors=True)
            for file in (checkpoint.NAME, f".{checkpoint.NAME}"):
                (out / file).unlink(missing_ok=True)
            self._release(self.path)
        for path in list(self.abandoned):
            self._remove(path)
        if out != wanted:
            print(f"{shown(wanted)} now holds something other than results and is left unchanged: "
                  f"the results are in {shown(out)}", file=sys.stderr)
        return out

    # ---- directories that are held ---------------------------------------------------------------
    def _hold(self, name: Path) -> Path | None:
        """Lock a directory; its path, None if it is another user's or the run there is alive."""
        descriptor = guard.open_own(name)
        if descriptor is None:
            return None
        if not guard.locked(descriptor):
            os.close(descriptor)
            return None
        path = name
        if guard.is_shared(name.parent):
            path = Path(f"/proc/{os.getpid()}/fd/{descriptor}")
        self._held[path] = name, descriptor
        return path

    def _remove(self, path: Path) -> None:
        """Remove a directory and free its lock."""
        if path in self._held:
            name, _ = self._held[path]
            for entry in os.scandir(path):
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path, ignore_errors=True)
                else:
                    os.unlink(entry.path)
            with contextlib.suppress(OSError):  # published, or no longer there
                name.rmdir()
            self._release(path)

    def _release(self, path: Path) -> None:
        """Free the lock of a directory and leave it alone."""
        if path in self.abandoned:
            self.abandoned.remove(path)
        os.close(self._held.pop(path)[1])

    def _release_all(self) -> None:
        while self._held:
            os.close(self._held.popitem()[1][1])
        for path in self._made:
            with contextlib.suppress(OSError):  # no longer empty
                path.rmdir()


def _checked(out: Path) -> Path:
    """`out` without links. Raises InputError where a run may not put its results.

    A run replaces its whole directory: it must be new, empty, or hold an earlier run; so must the
    one for results that have not converged.
    """
    place = out
    try:
        if ";" in str(out):
            raise ValueError("has a semicolon in its name, which FreeFEM does not take")
        resolved = guard.resolve(out.absolute())
        reason = guard.obstacle(resolved)
        if not reason:
            place = unconverged(resolved)
            reason = guard.obstacle(place)
    except OSError as problem:
        message = f"OUT={place}: cannot write results there ({problem.strerror})"
        raise file_error(problem, message) from None
    except ValueError as problem:
        reason = str(problem)
    if reason:
        raise InputError(f"OUT={place} {reason}")
    return resolved


def unconverged(out: Path) -> Path:
    """Where results go that have not converged, if `out` holds some that have."""
    return out.with_name(f"{out.name}-unconverged")


def _free(out: Path) -> Path:
    """`out`, or a name beside it where something else than a run has come to be there."""
    place, number = out, 1
    while guard.obstacle(place):
        number += 1
        place = out.with_name(f"{out.name}-{number}")
    return place


def _umask() -> int:
    """The user's umask, which can only be read by setting it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def _has_checkpoint(path: Path) -> bool:
    """Whether a run left a checkpoint in its directory, of itself or of a refinement cycle."""
    return any(path.rglob(checkpoint.NAME))


def _identity(out: Path) -> tuple[int, int] | None:
    """What tells the directory at `out` from another one that takes its name; None without one."""
    try:
        found = os.stat(out)
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _alive(name: Path) -> bool:
    """Whether a run of this user works in a private directory that is locked."""
    descriptor = guard.open_own(name)
    if descriptor is not None:
        os.close(descriptor)
    return descriptor is not None


def _warn(words: str) -> None:
    """A line on the screen, also of quiet runs."""
    print(f"warning: {words}", file=sys.stderr, flush=True)


def lock_log(file) -> None:
    """Rank 0 locks its log, if it can: a killed run's ranks end before it is taken up."""
    guard.locked(file)


def _ended(path: Path) -> bool:
    """Wait until no rank writes to the log of a killed run; False if one does not end."""
    limit = time.monotonic() + PATIENCE
    with open(path / "run.log", "a") as log:
        while time.monotonic() < limit:
            if guard.locked(log):
                return True
            time.sleep(0.05)
    return False


def _exchange(first: Path, second: Path) -> bool:
    """Exchange two directories at once by Linux's renameat2; False where a file system cannot."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None)
    if rename is None:
        return False
    paths = os.fsencode(first), os.fsencode(second)
    return rename(AT_FDCWD, paths[0], AT_FDCWD, paths[1], RENAME_EXCHANGE) == 0
