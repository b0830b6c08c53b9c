"""Parameter studies: one scene for many values of a friction coefficient, a gap, a load history or a step count.

The body is exported, factorized and, where its contact boundary is small enough, condensed once (compliance.py);
every value then costs few operations with small matrices. FreeFEM evaluates the contact data and histories of
all values in one process that assembles nothing. In the interpreter:

    from driver.study import make_study
    summary, folder = make_study({"scene": "model", "friction": "0.05:1.0:100", "subdomains": "16x8"})

`study.csv` has one row per value (last step and totals), `history.csv` one per value and step, `contact.csv`
one per value and contact node at the last step.
"""

import csv
import json
import os
import shutil
import time
from pathlib import Path

import numpy as np

from ..scene import freefem
from .. import options
from ..runs import launch
from ..errors import InputError, error_of
from ..options import RESULTS
from ..runs.request import Request
from ..runs.run import Run
from ..runs.workspace import Workspace

TOLD = 3  # warnings on the screen


def solver():
    """Stage: all values of a study."""
    from .parametric import run

    return run


def make_study(pairs: dict[str, str]) -> tuple[dict, Path]:
    """Run a study as given by NAME=VALUE pairs; returns its summary and directory.

    Exactly one scene parameter holds several values: first:last:count, equally spaced, or a,b,c. Raises
    DriverError; values that did not converge are told at the end and kept in the files, marked so.
    """
    name, values = _studied(pairs)
    pairs = {**pairs, name: values[0]}
    options.read("study", pairs)
    run = Run.from_pairs(pairs)
    out = (run.out if "out" in pairs else RESULTS / "study" / f"{run.scene.stem}-{name}").absolute()
    with Workspace(out) as place:
        clock, work = time.perf_counter(), place.path
        freefem.export_study(
            run.scene, work / "values", run.parameters, name, values,
            lambda: freefem.export(run.scene, work / "export", run.parameters, run.ranks, None,
                                   lambda: launch.preload(solver, run.ranks), run.without),
            run.without)
        request = Request.of(run, study=name, values=tuple(values),
                             seconds={"export": time.perf_counter() - clock})
        status, reason = launch.solve(work, request, run.ranks, solver)
        if not (work / "summary.json").exists():
            raise error_of(status, reason)
        if run.figures:
            draw_study(work)
        for folder in ("export", "values"):
            shutil.rmtree(work / folder)
        place.publish(out)
    if status:
        raise error_of(status, f"{reason}; the study is kept in {os.path.relpath(out)}")
    return json.loads((out / "summary.json").read_text()), out


def _studied(pairs: dict[str, str]) -> tuple[str, list[str]]:
    """The one parameter with several values, and those."""
    several = [name for name, text in pairs.items() if name not in options.OF_RUNS and ("," in text or ":" in text)]
    if len(several) != 1:
        raise InputError("a study needs SCENE= and exactly one parameter with several values: first:last:count or a,b,c"
                         + f" (here {', '.join(map(str.upper, several)) or 'none'})")
    name = several[0]
    values = pairs[name].split(",")
    if ":" in pairs[name]:
        try:
            first, last, count = pairs[name].split(":")
            values = [f"{value:.12g}" for value in np.linspace(float(first), float(last), int(count))]
        except ValueError:
            raise InputError(f"{name.upper()}={pairs[name]} is not of the form first:last:count") from None
    if not values or not all(values) or len(set(values)) < len(values):
        raise InputError(f"{name.upper()}={pairs[name]} lacks a value or gives one twice")
    return name, values


def describe(summary: dict, out: Path) -> str:
    """Few lines about a finished study."""
    s, counts = summary["seconds"], summary["counts"]
    how = f"{summary['contact_rows']} contact rows condensed" if summary["condensed"] else "not condensed"
    return (f"{summary['scene']}: {summary['values']} values of {summary['study']}, {how}, "
            f"{counts['dual_multiplications']} products\n"
            f"  {s['total']:.2f} s (FreeFEM {s['export']:.2f}, setup "
            f"{s['read'] + s['setup']:.2f}, condensation {s['condense']:.2f}, solve {s['solve']:.2f}), results in "
            f"{os.path.relpath(out)}" + "".join(f"\n  {line}" for line in _told(summary["warnings"])))


def _told(warnings: list[str]) -> list[str]:
    """The first warnings for the screen; all are in summary.json."""
    more = len(warnings) - TOLD
    return [f"warning: {line}" for line in warnings[:TOLD]] + [f"and {more} warnings more in summary.json"] * (more > 0)


def draw_study(directory: Path) -> list[Path]:
    """Resultants, peak pressure, zones and dissipated energy over the values at the last step, from the files."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ..figures import BLUE, GREEN, INCH, ORANGE, STYLE, WIDTH, scale_for, write

    summary = json.loads((directory / "summary.json").read_text())
    with open(directory / "study.csv", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["converged"] == "yes"]
    if not rows:
        return []
    name = summary["study"]
    line = "-"
    try:
        x = [float(row[name]) for row in rows]
    except ValueError:
        x, line = [row[name] for row in rows], ""  # nothing lies between words
    y = lambda column: np.array([float(row[column]) for row in rows])
    length, stress = summary["units"]["length"], summary["units"]["stress"]
    marker = "o" if len(rows) <= 20 or not line else ""

    def plot(axes, what: str, unit: str, curves: dict) -> None:
        scale = scale_for(unit, np.concatenate([values for values, _ in curves.values()]))
        for label, (values, colour) in curves.items():
            axes.plot(x, values * scale.factor, color=colour, ls=line, marker=marker, label=label)
        axes.set_ylabel(f"{what} [{scale.label}]" if unit else what)
        axes.margins(x=0.3 if not line else 0.05)

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 12 * INCH), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        forces, peak, zones, energy = figure.subplots(2, 2, sharex=True).ravel()
        plot(forces, "contact force", f"{stress}·{length}", {"pressing, $-R_n$": (-y("resultant_n"), BLUE),
                                                             "friction, $R_t$": (y("resultant_t"), ORANGE)})
        plot(peak, "largest pressure", stress, {"": (y("peak_pressure"), BLUE)})
        plot(zones, "contact nodes", "", {zone: (y(f"nodes_{zone}"), colour) for zone, colour in
                                          (("stick", GREEN), ("slip", ORANGE), ("open", BLUE))})
        plot(energy, "dissipated energy", f"{stress}·{length}²", {"": (y("dissipated"), ORANGE)})
        for axes in (forces, zones):
            axes.legend(frameon=False)
        for axes in (zones, energy):
            axes.set_xlabel(name.replace("_", " "))
        figure.suptitle(f"{summary['scene']}: {summary['values']} values of {name}, end of the history")
        (directory / "figures").mkdir(exist_ok=True)
        return write(figure, directory / "figures", "study")
