"""Checkpoints: the state after a finished step, from which an interrupted run goes on with the same
numbers.

A checkpoint is one file, renamed into place when it is whole: the packed state, before it its
CRC-32. It holds no more than the parts of a run need for the steps to come
and for their report, numbered so that any number of ranks can go on from it. A run looks for one
before FreeFEM starts: NumPy is imported where there is one.
"""

import errno
import functools
import hashlib
import os
import re
import shutil
import sys
import zipfile
import zlib
from pathlib import Path

from ..environment import ROOT, petsc_place, undisturbed
from ..files import renamed

NAME = "checkpoint.bin"
FIELDS = re.compile(r"fields/\w+\.p?vtu")  # files beside it that a checkpoint may name
END = b"</VTKFile>\n"
# of the wall time that checkpoints may take: one follows after every step that pays for it
SHARE = 0.02


@functools.cache
def program() -> str:
    """Digest of the code that makes the numbers, as it is when it is first asked for."""
    from importlib.metadata import version  # here: FreeFEM starts before, and it takes a while

    versions = f"{sys.version} {version('numpy')} {petsc_place()}"
    digest = hashlib.sha256(versions.encode())
    for path in sorted((ROOT / "driver").rglob("*.py")):
        digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()


def fingerprint(content: str, options: dict) -> dict:
    """What a run's numbers depend on, by the name that it has for a user; `content` as in
    seal.Seal.
    """
    return {"scene or parameters": content, "options": options, "program": program()}


def write(directory: Path, state: dict) -> None:
    """Keep `state`, dictionaries of numbers, words, lists, arrays and stacks, in `directory`.

    It is written as it is: a copy would take as much memory again. Raises OSError.
    """
    from .packing import pack

    with renamed(directory / NAME) as hidden, open(hidden, "wb") as file:
        file.write(bytes(4))
        summed = _Summed(file)
        pack(state, summed)
        file.seek(0)
        file.write(summed.crc.to_bytes(4, "little"))
        file.flush()
        os.fsync(file.fileno())


class _Summed:
    """A file that is written from its beginning to its end, and the CRC-32 of that."""

    def __init__(self, file):
        self.file, self.crc = file, 0

    def write(self, data) -> int:
        """As that of files."""
        self.crc = zlib.crc32(data, self.crc)
        return self.file.write(data)

    def flush(self) -> None:
        """As that of files."""
        self.file.flush()


def read(directory: Path) -> dict | None:
    """The state kept in `directory`; None if there is none, or one that is damaged, lacks files of
    fields or names files elsewhere.

    Raises OSError if memory is too short to see.
    """
    with undisturbed():  # packages whose import is interrupted stay there in parts
        from .packing import unpacked

    try:
        content = (directory / NAME).read_bytes()
        if int.from_bytes(content[:4], "little") != zlib.crc32(content[4:]) or len(content) <= 4:
            return None
        state = unpacked(content[4:])
        whole = isinstance(steps(state), int) and isinstance(state["fingerprint"], dict)
        return state if whole and all(_ends(directory, name) for name in state["files"]) else None
    except OSError as problem:
        if problem.errno == errno.ENOMEM:  # not what an error that is being handled was about
            raise
        return None
    except (ValueError, LookupError, TypeError, zipfile.BadZipFile):  # not written by `write`
        return None


def _ends(directory: Path, name: str) -> bool:
    """Whether `name` is a file of fields that has its last line; a power failure may have taken it.

    Raises OSError if it is empty or a link.
    """
    if not FIELDS.fullmatch(name):
        return False
    with open(os.open(directory / name, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
        file.seek(-len(END), os.SEEK_END)
        return file.read() == END


def copy(source: Path, target: Path) -> None:
    """Give `target` what a run needs to go on from `source`, the checkpoint last; `source` keeps it
    as well.
    """
    state = read(source)
    for name in state["files"]:
        (target / name).parent.mkdir(exist_ok=True)
        _link(source / name, target / name)
    shutil.copy(source / "run.log", target / "run.log")
    _link(source / NAME, target / NAME)


def _link(source: Path, target: Path) -> None:
    try:
        os.link(source, target)
    except OSError:  # a file system without links
        shutil.copy(source, target)


def steps(state: dict) -> int:
    """Number of finished steps of a kept state."""
    return state["solver"]["history"]["steps"]


def differences(kept: dict, wanted: dict) -> list[str]:
    """In what the fingerprint of a kept state differs from that of the run at hand."""
    return [name for name in wanted if kept["fingerprint"].get(name) != wanted[name]]
