"""Pictures of finished runs and studies, drawn again from the files in their directories."""

import functools
import json
import os
from pathlib import Path

from ..errors import InputError
from ..files import is_study, is_summary
from . import (accuracy, animation, bench, coverage, curved, effects, hard, locking, prices, saddle,
               stopping, study, table, verify)
from .gallery import draw_run

SADDLE = "saddle.json"
REFERENCES = ("reference", "unchanged", "mutants")  # in results/, which are no runs
NAMED = {"coverage": coverage.draw, "prices": prices.draw}  # name of a study's table: what draws it
TABLES = {  # first column of a study's table: what draws it
    "sweep": functools.partial(accuracy.draw, every=True), "element": locking.draw,
    "sides": curved.draw,
    "row": stopping.draw,
    "without": effects.draw, "n_s": table.draw, "family": hard.draw, "part": bench.draw,
    "kind": verify.draw}


def redraw(directory: Path) -> list[Path]:
    """Redraw all that lies in `directory`; returns the files written, of some studies none.

    Raises InputError if it holds neither a finished run nor a study.
    """
    summary = directory / "summary.json"
    if is_summary(summary):
        draw = study.draw if "study" in json.loads(summary.read_text()) else draw_run
        animated = (directory / "figures" / animation.NAME).exists()
        return [*draw(directory), *([animation.draw_animation(directory)] if animated else [])]
    if not is_study(directory):  # tables of the user's own may begin like those of a study
        raise InputError(f"{directory} holds no finished run and no study: name the directory "
                         "that make run or a study wrote")
    paths = [drawn for path, draw in _tables(directory) for drawn in draw(path)]
    return paths + (saddle.draw(directory) if (directory / SADDLE).is_file() else [])


def finished(place: Path):
    """The directories beneath `place` that hold a finished run or a study, in order of names.

    What lies in one of them is part of it. Hidden directories are those of runs at work.
    """
    for folder, inner, files in os.walk(place):
        if Path(folder) == Path(place):
            inner[:] = sorted(set(inner) - set(REFERENCES))
        if "summary.json" in files or is_study(folder) and (
                SADDLE in files or any(_tables(Path(folder)))):
            inner.clear()
            yield Path(folder)
        inner[:] = sorted(name for name in inner if not name.startswith("."))


def _tables(directory: Path):
    """The tables in `directory` that are drawn, and what draws them."""
    for path in sorted(directory.glob("*.csv")):
        with open(path, errors="replace") as file:
            first = file.readline().partition(",")[0]
        draw = NAMED.get(path.stem) or TABLES.get(first)
        if draw:
            yield path, draw
