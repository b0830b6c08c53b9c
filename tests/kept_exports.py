"""A plugin of pytest for `mutants`: FreeFEM's exports of a scene are made once and then copied.

    KEPT=folder python3 -m pytest -p kept_exports tests/qp

A mutant of the driver's numerical packages changes no export, which is most of the time of many a
test. An export is known by the texts of program, scene and library and all options; those onto a
field of element sizes are made each time.
"""

import hashlib
import os
import shutil
from pathlib import Path

from driver.scene import freefem

KEPT = Path(os.environ["KEPT"])
run = freefem._run


def kept(program: Path, scene: Path, directory: Path, parameters: dict, ranks: int, meanwhile=None,
         without=()) -> None:
    """As freefem._run."""
    meanwhile = meanwhile or freefem.nothing
    if "sizes" in parameters:
        run(program, scene, directory, parameters, ranks, meanwhile, without)
        return
    text = "" if program == scene else program.read_text().replace(str(scene), "")
    key = (freefem.text_digest(scene), scene.name, text, sorted(parameters.items()), ranks, without)
    folder = KEPT / hashlib.sha256(repr(key).encode()).hexdigest()[:24]
    if folder.exists():
        meanwhile()
        shutil.copytree(folder, directory, dirs_exist_ok=True)
        return
    run(program, scene, directory, parameters, ranks, meanwhile, without)
    half = KEPT / f"{folder.name}.{os.getpid()}"
    shutil.copytree(directory, half)
    try:
        half.rename(folder)
    except OSError:  # another process has made it
        shutil.rmtree(half)


freefem._run = kept
