"""Pictures of finished runs and studies, drawn again from the files in their directories."""

import functools
import json
from pathlib import Path

from ..errors import InputError
from . import (accuracy, animation, bench, curved, effects, hard, locking, saddle, stopping, study,
               table, verify)
from .gallery import draw_run

TABLES = {  # first column of a study's table: what draws it
    "sweep": functools.partial(accuracy.draw, every=True), "element": locking.draw,
    "sides": curved.draw,
    "row": stopping.draw,
    "without": effects.draw, "n_s": table.draw, "family": hard.draw, "part": bench.draw,
    "kind": verify.draw}


def redraw(directory: Path) -> list[Path]:
    """Redraw all that lies in `directory`; returns the files written.

    Raises InputError if it holds neither a finished run nor a study.
    """
    summary = directory / "summary.json"
    if summary.is_file():
        draw = study.draw if "study" in json.loads(summary.read_text()) else draw_run
        animated = (directory / "figures" / animation.NAME).exists()
        return [*draw(directory), *([animation.draw_animation(directory)] if animated else [])]
    paths = []
    for path in sorted(directory.glob("*.csv")):
        with open(path) as file:
            first = file.readline().partition(",")[0]
        if first in TABLES:
            paths += TABLES[first](path)
    if (directory / "saddle.json").is_file():
        paths += saddle.draw(directory)
    if not paths:
        raise InputError(f"{directory} holds no finished run (no summary.json)")
    return paths
