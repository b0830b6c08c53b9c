"""What a run may replace, remove or go on from: its own directories, and nothing else.

A run replaces a directory as a whole, so the directory must hold what runs write and nothing else:
every name in it is compared with what there can be. Names are looked at without following links.
"""

import fcntl
import json
import os
import re
import stat
from pathlib import Path

from ..errors import InputError
from ..files import FIGURES, STUDY, is_study, is_summary
from ..report import page

# of results, relative to their directory; a dot in front while a file is being written
RESULTS = (r"summary\.json",
           r"(contact|history|convergence|boundary|boundaries|obstacle|probes|adaptivity)\.csv",
           r"(study|cycles)\.csv",
           r"(run|freefem)\.log", r"(fields|contact|error)\.pvd",
           r"fields/(step|contact|error)_\d+(_\d+)?\.p?vtu", r"report\.html",
           r"figures/animation\.gif",
           rf"figures/({'|'.join(FIGURES)}|study)\.(png|pdf)",
           r"checkpoint\.bin")  # of a run that was killed while it removed it
# of a run that is not finished, besides: what its stages hand on
UNFINISHED = (r"(request|answer)\.json",
              r"(export|values|companions|levels|cycle-\d+)(/.*)?")
FOLDERS = ("fields", "figures")
BUSY = "is in use by another make {}: wait for its end or choose another directory"
_at_work = {}  # descriptor of each directory of a study of this process, by device and inode


def foreign(directory: Path, unfinished: bool = False) -> str:
    """The first name in a directory that no run gives, relative to it; empty if there is none.

    A link or a device is foreign under any name, and so is a report.html that is no page of a run.
    `unfinished`: the directory is that of a run at work or of one that was stopped. Raises OSError
    where it cannot be listed.
    """
    known = re.compile("|".join(RESULTS + UNFINISHED if unfinished else RESULTS))
    remaining = [""]
    while remaining:
        folder = remaining.pop()
        for entry in sorted(os.scandir(directory / folder), key=lambda entry: entry.name):
            name = f"{folder}{entry.name}"
            if entry.is_dir(follow_symlinks=False):
                if name not in FOLDERS and not (unfinished and known.fullmatch(name)):
                    return name
                remaining.append(f"{name}/")
            elif not (entry.is_file(follow_symlinks=False)
                      and known.fullmatch(f"{folder}{entry.name.removeprefix('.')}")):
                return name
            elif name == page.FILE and not page.is_ours(directory / name):
                return name
    return ""


def obstacle(out: Path) -> str:
    """Why results cannot replace what is at `out`, a resolved path; empty if they can.

    They can where nothing is, at an empty directory and at the results of an earlier run. Raises
    OSError where that cannot be seen.
    """
    try:
        mode = os.lstat(out).st_mode
    except FileNotFoundError:
        return ""
    if not stat.S_ISDIR(mode):
        return "is no directory"
    if os.path.ismount(out):
        return "is the root of a file system; choose a directory in it"
    if _holds_working_directory(out):
        return "is the directory you are in, or holds it; choose another one or go elsewhere"
    if not any(os.scandir(out)):
        return ""
    if not is_summary(out / "summary.json"):
        what = "files and a summary.json" if (out / "summary.json").exists() else "files"
        return f"holds {what} but no earlier run; choose another directory or empty it"
    name = foreign(out)
    return name and (f"holds {name}, which is not a file of a run; choose another directory or "
                     "move that file away")


def _holds_working_directory(out: Path) -> bool:
    """Whether the process works in `out` or below it."""
    here = Path(os.path.realpath(os.getcwd()))
    return out == here or out in here.parents


def converged(out: Path) -> bool:
    """Whether `out` holds results of a run that has converged."""
    path = out / "summary.json"
    return is_summary(path) and bool(json.loads(path.read_text()).get("converged"))


# ---- studies ------------------------------------------------------------------------------------

def study_folder(out: Path | str, study: str) -> Path:
    """The directory of a study that adds its files there, made and marked; without links.

    It must be new, empty or marked by an earlier study of this name, before any work is done: such
    studies write over files of theirs and remove folders of theirs. It is locked as long as this
    process lives. Raises InputError.
    """
    try:
        place = resolve(Path(out).absolute())
        reason = _unfit(place, study)
        if not reason:
            place.mkdir(parents=True, exist_ok=True)
            reason = "" if _hold(place) else BUSY.format(study)
        if not reason:
            (place / STUDY).write_text(f"{study}\n")
            return place
    except OSError as problem:
        reason = f"cannot hold results: {problem.strerror}"
    except ValueError as problem:
        reason = str(problem)
    raise InputError(f"OUT={out} {reason}")


def _unfit(place: Path, study: str) -> str:
    """Why a study may not write to `place`; empty if it may. Raises OSError."""
    if not os.path.lexists(place):
        return ""
    if not place.is_dir():
        return "is no directory"
    if not os.listdir(place):
        return ""
    if not is_study(place):
        return (f"holds files but no results of make {study}; choose another directory or empty "
                "it")
    if (earlier := (place / STUDY).read_text(errors="replace").strip()) != study:
        return f"holds results of make {earlier}, not of make {study}; choose another directory"
    return ""


def _hold(place: Path) -> bool:
    """Lock the directory of a study; False if another process has. Raises OSError.

    File systems without locks let everybody in.
    """
    descriptor = os.open(place, os.O_RDONLY | os.O_DIRECTORY)
    status = os.fstat(descriptor)
    key = status.st_dev, status.st_ino
    if key in _at_work:  # a second lock, even of this process, would be refused
        os.close(descriptor)
        return True
    if not locked(descriptor, elsewhere=True):
        os.close(descriptor)
        return False
    _at_work[key] = descriptor
    return True


def locked(descriptor, elsewhere: bool = False) -> bool:
    """Lock an open file or directory; False if another process holds it.

    `elsewhere` is the answer of a file system that has no locks.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return elsewhere
    return True


# ---- other users ---------------------------------------------------------------------------------

def open_own(directory: Path) -> int | None:
    """Descriptor of a directory that belongs to this user and that no other one may write to.

    None for any other, for a link and for what is not there.
    """
    try:
        descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    status = os.fstat(descriptor)
    if status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return descriptor
    os.close(descriptor)
    return None


def is_own(directory: Path) -> bool:
    """Whether a name stands for a directory of this user, not for a link to one."""
    status = os.lstat(directory)
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid()


def is_shared(directory: Path) -> bool:
    """Whether other users may rename what is in a directory, or the directory or one above it."""
    for path in (directory, *directory.parents):
        status = os.stat(path)
        others = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if status.st_uid not in (0, os.geteuid()) or others and not status.st_mode & stat.S_ISVTX:
            return True
    return False


def resolve(out: Path) -> Path:
    """`out` without links, which the user may have put there. Raises OSError, and ValueError with
    the reason for a link that leads nowhere or is another user's."""
    if os.path.islink(out):
        if os.lstat(out).st_uid not in (0, os.geteuid()):
            raise ValueError("is a link that another user has made")
        if not os.path.exists(out):
            raise ValueError(f"is a link to {os.readlink(out)}, which does not exist; remove the "
                             "link or make that directory")
    return Path(os.path.realpath(out))
