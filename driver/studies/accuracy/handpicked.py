"""make accuracy PART=handpicked [SCENE=] [OUT=]: time of ACCURACY over that of settings by hand.

Each scene runs on uniform meshes of linear and quadratic elements, coarse to fine, each with fewer
and more steps, without error estimates: whoever picks settings by hand does not know what they err
by. Of the runs that can be trusted with an accuracy (none at least as fine errs by more) the one
with the least processor time is the best by hand. ACCURACY is asked for the same; both then run
REPEATS times in turn, since the least of many times is one by chance, and the median of ACCURACY's
is divided by that of the best. Times are user seconds of whole processes, as users start them,
which other work on the machine changes little. The aim: at most three times as long.
"""

import math
import resource
import tempfile
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import median

from ...estimates.budget import mesh_knob
from ...runs.own_process import BARE, run_alone
from ...text import assignments, percent, words
from . import coverage
from .coverage import Case
from .prices import settings_of
from .requests import ASKED

SCENES = ("model", "hertz", "hertz-bodies", "stack", "wedge", "pressfit")
NAMES = ("normal_resultant", "slip", "displacement")  # those that a scene has
MESHES = {"P1": (0.125, 0.25, 0.5, 1, 2, 4), "P2": (0.125, 0.25, 0.5, 1)}  # times as fine
STEPS = (0.25, 1, 2)  # times as many
REPEATS = 3
MOST = 3.0
COLUMNS = ("scene", "quantity", "asked", "status", "seconds", "by_hand", "ratio", "within", "true",
           "trusted", "settings", "reason")


@dataclass
class Pick:
    """A run with settings by hand."""

    settings: dict
    fineness: float
    steps: float
    seconds: float
    values: dict

    def tighter(self, other: "Pick") -> bool:
        """Whether this is at least as fine in all."""
        same = self.settings.get("element") == other.settings.get("element")
        return same and self.fineness >= other.fineness and self.steps >= other.steps


def run_handpicked(out: Path, scene: str | None) -> list[Path]:
    """Compare all scenes, or `scene`; make the table in `out`.

    Raises InputError if there is no such scene, or nothing that sets its mesh size.
    """
    cases = coverage.of_each(SCENES, scene, out)
    table = out / "handpicked.csv"
    for row in coverage.judged(cases, judge, describe, table, COLUMNS):
        if row["within"] == "no":
            print(f"  {row['scene']} {words(row['quantity'])} to {percent(row['asked'])}: "
                  f"{row['seconds']:.2g} s, by hand {row['by_hand']:.2g} s ({row['settings']})")
    return [table]


def judge(case: Case, out: Path) -> list[dict]:
    """Rows of the table: some quantities of a scene at every accuracy."""
    _, finest = coverage.references(case, out)
    picks, rows = _picks(case, out), []
    for name in (name for name in NAMES if name in finest):
        reference = case.exact.get(name, finest[name])
        for asked in ASKED if reference else ():
            row = {"scene": case.scene, "quantity": name, "asked": asked,
                   **_asked(case, name, asked, reference, out)}
            best, trusted = best_of(picks, name, asked, reference)
            if best is not None and not row["status"]:
                seconds = _in_turn(case, best.settings, name, asked, out)
                row |= compared(*seconds) | {"trusted": trusted,
                                             "settings": assignments(best.settings)}
            rows.append({"within": ""} | row)
    return rows


def _picks(case: Case, out: Path) -> list[Pick]:
    """All runs by hand that converge."""
    base, picks = settings_of(case), []
    knob = mesh_knob(base)
    steps = STEPS if "steps" in base else (1,)
    for element, more in product(MESHES, steps):
        for fineness in MESHES[element]:
            size = (max(1, round(base[knob] * fineness)) if knob == "cells"
                    else base[knob] / fineness)
            settings = {knob: size, **({} if element == "P1" else {"element": element}),
                        **({"steps": max(1, round(more * base["steps"]))} if "steps" in base
                           else {})}
            spent, status, answer = _process(case, settings | {"errors": "no"}, out)
            if not status:
                picks.append(Pick(settings, fineness, more, spent, answer["quantities"]))
    return picks


def _asked(case: Case, name: str, asked: float, reference: float, out: Path) -> dict:
    """ACCURACY for a quantity: status, seconds and true error."""
    options = {"errors": "no", "accuracy": f"{asked},{name}"}
    spent, status, answer = _process(case, options, out)
    row = {"status": status, "seconds": spent}
    if status:
        return row | {"reason": answer.split("; partial")[0]}
    return row | {"reason": "", "true": abs(answer["quantities"][name] / reference - 1)}


def _process(case: Case, options: dict, out: Path) -> tuple[float, int, dict | str]:
    """User seconds of a run as a user starts it, its status, its summary or why there is none."""
    with tempfile.TemporaryDirectory(prefix=".run.", dir=out) as folder:
        begun = user_seconds()
        status, answer = run_alone(case.common | options | BARE | {
            "scene": case.scene, "out": Path(folder) / "run"})
        return user_seconds() - begun, status, answer


def best_of(picks: list[Pick], name: str, asked: float, reference: float) -> tuple:
    """The cheapest of `picks` that can be trusted with an accuracy, and with what; None if none."""
    def error(pick):
        return abs(pick.values[name] / reference - 1)

    trusted = {id(pick): max(error(other) for other in picks if other.tighter(pick))
               for pick in picks}
    best = min((pick for pick in picks if trusted[id(pick)] <= asked),
               key=lambda pick: pick.seconds, default=None)
    return best, best and trusted[id(best)]


def _in_turn(case: Case, settings: dict, name: str, asked: float, out: Path) -> list[list[float]]:
    """Seconds of ACCURACY and of the settings by hand."""
    ways = {"accuracy": f"{asked},{name}"}, settings
    runs = [[_process(case, way | {"errors": "no"}, out)[0] for way in ways]
            for _ in range(REPEATS)]
    return list(map(list, zip(*runs)))


def compared(seconds: list[float], by_hand: list[float]) -> dict:
    """What ACCURACY took over what the best by hand did, by medians."""
    spent, best = median(seconds), median(by_hand)
    return {"seconds": spent, "by_hand": best, "ratio": spent / best,
            "within": "yes" if spent <= MOST * best else "no"}


def user_seconds() -> float:
    """User seconds of the children of this process that have ended."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime


def describe(rows: list[dict]) -> str:
    """How ACCURACY compares, in a sentence."""
    judged = [row for row in rows if row["within"]]
    if not judged:
        return "nothing to compare"
    mean = math.exp(sum(math.log(row["ratio"]) for row in judged) / len(judged))
    within = sum(row["within"] == "yes" for row in judged)
    return (f"{within} of {len(judged)} requests within {MOST:g} times the best by hand, "
            f"{mean:.2g} times in the mean, {max(row['ratio'] for row in judged):.2g} at most")
