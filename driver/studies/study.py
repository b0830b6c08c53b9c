"""Parameter studies: one scene for many values of a friction coefficient, a gap, a history ...

The body is exported, factorized and, where its contact boundary is small enough, condensed once
(compliance.py); every value then costs few operations with small matrices. FreeFEM evaluates the
contact data and histories of all values in one process that assembles nothing. In the interpreter:

    from driver.studies.study import make_study
    summary, folder = make_study({"scene": "model", "friction": "0.05:1.0:100", "subdomains":
    "16x8"})

`study.csv` has one row per value (last step and totals), `history.csv` one per value and step,
`contact.csv` one per value and contact node at the last step.
"""

import functools
import json
import shutil
import time
from pathlib import Path

import numpy as np

from .. import options
from ..errors import InputError, error_of
from ..options import RESULTS
from ..results.screen import UNCHECKED
from ..runs import hosts, launch
from ..runs import seconds as stages
from ..runs.request import Request
from ..runs.run import NO_PAGE, Run, attempt, solve
from ..runs.workspace import Workspace
from ..scene import freefem
from ..scene.manifest import Manifest
from ..text import shown
from . import value_chains

SHOWN = 3  # warnings on the screen


def parametric():
    """Stage: all values of a study."""
    from .parametric import run

    return launch.Stage(run)


def make_study(pairs: dict[str, str], since: float | None = None) -> tuple[dict, Path]:
    """Run a study as given by NAME=VALUE pairs; returns its summary and directory.

    Exactly one scene parameter holds several values: first:last:count, equally spaced, or a,b,c.
    Seconds count from `since`, a time.perf_counter(), by default from now on.
    Raises DriverError; values that did not converge are reported at the end and kept in the files,
    marked so.
    """
    since = time.perf_counter() if since is None else since
    name, values = _studied(pairs)
    pairs = {**pairs, name: values[0]}
    options.read("study", pairs)
    run = Run.from_pairs(pairs)
    out = (run.out if "out" in pairs else RESULTS / "study" / f"{run.scene.stem}-{name}")
    with Workspace(out) as place:
        work = place.path
        hosts.check(work, run.front_ranks)
        wanted = functools.partial(value_chains.ranks_for, count=len(values))
        with launch.Ranks(work, parametric, run.ranks, wanted) as ranks:
            clock = time.perf_counter()
            manifest = _export(run, work, name, values, ranks)
            request = Request.of(run, study=name, values=tuple(values),
                                 seconds={"export": time.perf_counter() - clock})
            status, reason = solve(run, ranks, request, manifest)
        if not (work / "summary.json").exists():
            raise error_of(status, reason)
        _complete(run, work, since)
        for folder in ("export", "values"):
            shutil.rmtree(work / folder)
        out = place.publish(place.out)
    if status:
        raise error_of(status, f"{reason}; the study is kept in {shown(out)}")
    return json.loads((out / "summary.json").read_text()), out


def _complete(run: Run, work: Path, since: float) -> None:
    """Figures and page, without which the tables stand as well; the user has waited `since`, a
    time.perf_counter().
    """
    from ..report.study import write

    if run.figures:
        from ..figures.study import draw

        clock = time.perf_counter()
        attempt(lambda: draw(work), work)
        stages.count(work, "figures", time.perf_counter() - clock)
    attempt(lambda: write(work), work, NO_PAGE)
    stages.count_rest(work, since)


def _export(run: Run, work: Path, name: str, values: list[str], ranks: launch.Ranks) -> Manifest:
    """The body and what every value changes of it, at a time; the manifest of the first value."""
    def body() -> None:
        freefem.export(run.scene, work / "export", run.parameters, run.front_ranks, None,
                       ranks.prepare, run.without)

    first, *_ = freefem.export_study(run.scene, work / "values", run.parameters, name, values,
                                     body, run.without)
    return first


def _studied(pairs: dict[str, str]) -> tuple[str, list[str]]:
    """The one parameter with several values, and those."""
    several = [name for name, text in pairs.items()
               if name not in options.OF_RUNS and ("," in text or ":" in text)]
    if len(several) != 1:
        raise InputError("a study needs SCENE= and exactly one parameter with several values: "
                         "first:last:count or a,b,c "
                         f"(here {', '.join(map(str.upper, several)) or 'none'})")
    name = several[0]
    values = pairs[name].split(",")
    if ":" in pairs[name]:
        try:
            first, last, count = pairs[name].split(":")
            spaced = np.linspace(float(first), float(last), int(count))
            values = [f"{value:.12g}" for value in spaced]
        except ValueError:
            raise InputError(
                f"{name.upper()}={pairs[name]} is not of the form first:last:count") from None
        if len(values) < 2:
            raise InputError(f"{name.upper()}={pairs[name]}: the count, {count}, must be 2 or more")
    if not values or not all(values) or len(set(values)) < len(values):
        raise InputError(f"{name.upper()}={pairs[name]} lacks a value or gives one twice")
    return name, values


def describe(summary: dict, out: Path) -> str:
    """Few lines about a finished study."""
    counts, how = summary["counts"], "not condensed"
    if summary["condensed"]:
        how = f"{summary['contact_rows']} contact rows condensed"
    warnings = "".join(f"\n  {line}" for line in _first(summary["warnings"]))
    return (f"{summary['scene']}: {summary['values']} values of {summary['study']}, {how}, "
            f"{counts['dual_multiplications']} products\n"
            f"  {stages.words(summary['seconds'])}, results in {shown(out)}\n"
            f"  {UNCHECKED}{warnings}")


def _first(warnings: list[str]) -> list[str]:
    """The first warnings for the screen; all are in summary.json."""
    lines = [f"warning: {line}" for line in warnings[:SHOWN]]
    if len(warnings) > SHOWN:
        lines.append(f"and {len(warnings) - SHOWN} warnings more in summary.json")
    return lines
