"""Seal of an export: sizes and checksums of its files, and which scene they came from.

The driver writes ``seal.json`` once FreeFEM has ended, and every later reader checks what it opens:
a file that was truncated, changed, exchanged or belongs to another text of the scene is refused
with that reason.
"""

import hashlib
import json
import math
import mmap
import os
import re
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

from ..errors import InputError, file_error
from ..files import write_json

SHARED = "shared.bin"  # what subdomains have in common, where they do
VALUE = "value.bin"  # what a value of a parameter study changes
CHUNK = 1 << 20  # bytes read at once
# bytes; FreeFEM's buffers are smaller, so this much is not free after one of its writes has failed
PROBE = 1 << 16


@dataclass(frozen=True)
class Seal:
    """What `write` found in an export directory.

    `scene` is the digest of the scene's text, `content` that of manifest and records, the same for
    any number of blocks; `files` holds (size in bytes, CRC-32) by name.
    """

    scene: str
    content: str
    files: dict[str, tuple[int, int]]


def write(directory: Path, scene: str, names: list[str]) -> Seal:
    """Seal the manifest and the records `names` that FreeFEM wrote.

    `scene` is the digest of the scene's text. What the records share is sealed as well, if they do.

    FreeFEM does not report writes that fail: room for a little more proves that they did not.
    Raises OSError if there is none, InputError if a file is missing.
    """
    probe = directory / "probe"
    probe.write_bytes(bytes(PROBE))
    probe.unlink()
    for path in (directory / name for name in ("manifest.json", *names)):
        if not path.is_file():
            raise InputError(f"{path} is missing: the FreeFEM stage did not finish; "
                             "run the scene again")
    if (directory / SHARED).is_file():
        names = [*names, SHARED]
    records, manifest = hashlib.sha256(), (directory / "manifest.json").read_bytes()
    files = {name: measure(directory / name, records) for name in names}
    files["manifest.json"] = (len(manifest), zlib.crc32(manifest))
    records.update(re.sub(rb'"blocks": \d+', b"", manifest, count=1))
    seal = Seal(scene, records.hexdigest(), files)
    write_json(directory / "seal.json", asdict(seal))
    return seal


def measure(path: Path, *digests, most: float = math.inf) -> tuple[int, int]:
    """Size and CRC-32 of a file, of its first `most` bytes where it has more.

    `digests` are updated with the same bytes.
    """
    size = check = 0
    with open(path, "rb") as file:
        while part := file.read(min(CHUNK, most - size)):
            size, check = size + len(part), zlib.crc32(part, check)
            for digest in digests:
                digest.update(part)
    return size, check


def read(directory: Path, scene: str | None = None) -> Seal:
    """The seal of an export.

    With `scene`, the digest that the scene's text has now, it must be that text's. Raises
    InputError when it is missing, not readable, or of another text.
    """
    path = directory / "seal.json"
    try:
        raw = json.loads(path.read_text())
        seal = Seal(str(raw["scene"]), str(raw["content"]),
                    {name: (int(size), int(check)) for name, (size, check) in raw["files"].items()})
    except FileNotFoundError:
        raise InputError(f"{path} is missing: the FreeFEM stage did not finish; "
                         "run the scene again") from None
    except (OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError,
            RecursionError) as problem:
        raise file_error(problem, f"{path} is not readable; run the scene again") from None
    if scene is not None and scene != seal.scene:
        raise InputError(f"{directory} is stale: the scene, or a file that it includes, was edited "
                         "after this export; run the scene again")
    return seal


def check(seal: Seal, path: Path) -> bytes | mmap.mmap:
    """Bytes of a file, compared with the seal of its export.

    They are compared in pieces: a map of the file holds in memory all that was looked at there.
    Raises InputError with what is wrong with it.
    """
    content = b""
    try:
        measured = measure(path)
        with open(path, "rb") as file:
            if os.fstat(file.fileno()).st_size:
                content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError:
        raise InputError(f"{path} is missing: the export is incomplete; "
                         "run the scene again") from None
    except OSError as problem:
        raise file_error(problem, f"{path} is not readable ({problem.strerror}); "
                                  "run the scene again") from None
    if path.name not in seal.files:
        raise InputError(f"{path} is not of this export; run the scene again")
    sealed = seal.files[path.name]
    if measured == sealed:
        return content
    others = [name for name, other in seal.files.items() if other == measured]
    if others:
        reason = f"holds what FreeFEM wrote to {others[0]}: the files were exchanged"
    elif measured[0] < sealed[0]:
        reason = f"is truncated: {measured[0]} of {sealed[0]} bytes"
    elif measured[0] > sealed[0]:
        reason = f"goes on after its last record: {measured[0]} bytes instead of {sealed[0]}"
    else:
        reason = "was changed after FreeFEM wrote it (wrong checksum)"
    raise InputError(f"{path} {reason}; run the scene again")
