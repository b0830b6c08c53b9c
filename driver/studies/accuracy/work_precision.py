"""Pictures of the study `accuracy`: error over seconds, drawn from the tables that it left."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from ...figures import BLUE, GREEN, INCH, INK, ORANGE, RED, STYLE, WIDTH, place_header, write
from .trial import KNOBS, percent, words

LOOK = {"mesh": (BLUE, "o"), "quadratic": ("#56B4E9", "h"), "adapt": (GREEN, "^"), "steps": (ORANGE, "s"),
        "friction_rtol": ("#CC79A7", "D"),
        "rtol": (RED, "v"), "together": ("#888888", ".")}
SIZES = {"mesh": "$h$", "quadratic": "$h$", "steps": "$\\Delta t$", "rtol": "tol", "friction_rtol": "tol"}
LEAST = 1e-9  # errors below are drawn there


@dataclass
class Point:
    """A run as the picture needs it; errors are relative."""

    knob: str
    value: float
    setting: str
    seconds: float
    least: float
    most: float
    error: float
    sure: float
    own: float | None
    front: bool


def read(path: Path) -> list[dict]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def points(table: list[dict], quantity: str) -> list[Point]:
    """The runs of accuracy.csv that have a result."""
    def point(row):
        seconds = (float(row[f"seconds_solver{suffix}"]) for suffix in ("", "_least", "_most"))
        error, sure, own = (float(row[f"{quantity}_{name}"] or "nan") for name in ("error", "sure", "own"))
        return Point(row["knob"], float(row["value"]), row["setting"], *seconds, error, sure,
                     None if math.isnan(own) else own, row[f"{quantity}_front"] == "1")

    return [point(row) for row in table if row["seconds_solver"]]


def exponent(x: list[float], errors: list[float], span: float) -> float | None:
    """Least-squares exponent of error over x; None with less than three runs or if x spans less than that factor."""
    good = [(math.log(a), math.log(e)) for a, e in zip(x, errors) if e > LEAST]
    if len(good) < 3 or np.ptp([a for a, _ in good]) < math.log(span):
        return None
    return float(np.polyfit(*zip(*good), 1)[0])


def draw(folder: Path, every: bool = False) -> list[Path]:
    """Draw work_precision, of the main quantity, and if `every` one picture of each other; returns the files."""
    table, paths = read(folder / "accuracy.csv"), []
    for reference in read(folder / "reference.csv"):
        main = reference["main"] == "1"
        if main or every:
            name = reference["quantity"]
            with matplotlib.rc_context(STYLE):
                paths += write(compose(points(table, name), reference), folder, "work_precision" + f"_{name}" * (not main))
    return paths


def compose(found: list[Point], reference: dict) -> Figure:
    """Left the error against the reference, right what the knob alone has of it; below, the settings of the front."""
    best = sorted((p for p in found if p.front), key=lambda p: p.seconds)
    figure = Figure(figsize=(WIDTH, (11.3 + 0.42 * len(best)) * INCH), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 1, height_ratios=[9.2, 0.42 * len(best) + 0.6])
    top = grid[0].subgridspec(2, 2, height_ratios=[9, 1])
    total = figure.add_subplot(top[0, 0])
    own = figure.add_subplot(top[0, 1])
    floor = float(reference["uncertainty"])
    handles = _errors(total, found, best, floor)
    slopes = figure.add_subplot(top[1, :])
    slopes.axis("off")
    slopes.legend(*_own(own, found), title="powers of seconds s, and of size $h$, step $\\Delta t$, tolerance",
                  loc="center", ncols=5, fontsize=7,
                  title_fontsize=7, frameon=False, columnspacing=1.2, handlelength=1.5)
    total.set(xlabel="seconds of the solver", ylabel=f"relative error of the {words(reference['quantity'])}",
              title="all errors, against the reference")
    own.set(xlabel="seconds of the solver", title="the knob's own part")
    for axes in (total, own):
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axes.xaxis.set_minor_formatter(FuncFormatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else ""))
        axes.tick_params(axis="x", which="both", labelsize=7, length=3)
    _settings(figure.add_subplot(grid[1]), best)
    source = "closed form" if reference["source"] != "overkill" else "overkill run"
    figure.text(0.5, 1, f"What accuracy costs: {words(reference['quantity'])}", ha="center", va="top", fontsize=10)
    told = f"{reference['scene']}; reference: {source}, good to {percent(floor)}; bars: spread of repeated runs"
    figure.text(0.5, 1, told, ha="center",
                va="top", fontsize=8, color="0.35")
    figure.legend(handles=handles, loc="upper center", ncols=4, frameon=False, borderpad=0, borderaxespad=0,
                  columnspacing=1.2, handlelength=1.8)
    place_header(figure)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure


def _errors(axes, found: list[Point], best: list[Point], floor: float) -> list:
    handles = []
    for knob, (colour, marker) in LOOK.items():
        line = [p for p in found if p.knob == knob]
        if not line:
            continue
        _curve(axes, line, [p.error for p in line], colour, marker, "" if knob == "together" else "-")
        handles.append(Line2D([], [], color=colour, marker=marker, ls="" if knob == "together" else "-", label=KNOBS[knob]))
    axes.plot([p.seconds for p in best], [p.sure for p in best], "o", ls=":", lw=0.8, color=INK, mfc="none", ms=8,
              mew=0.8, zorder=5)
    for number, p in enumerate(best, 1):
        axes.annotate(str(number), (p.seconds, p.sure), xytext=(-8, -8), textcoords="offset points", fontsize=7,
                      ha="center", va="center", zorder=6)
    handles.append(Line2D([], [], color=INK, marker="o", mfc="none", ms=7, lw=0.8, ls=":", label="Pareto front"))
    axes.axhspan(LEAST / 10, floor, color="0.9", zorder=0)
    axes.set(xscale="log", yscale="log")
    axes.margins(x=0.09)
    errors = [max(p.error, LEAST) for p in found]
    axes.set_ylim(min(min(errors), floor) / 1.6, min(max(errors), 10) * 1.6)
    axes.grid(color="0.92", lw=0.5)
    handles.append(matplotlib.patches.Patch(color="0.9", label="below the reference's own error"))
    return handles


def _own(axes, found: list[Point]):
    """Curves of the knobs alone; handles and labels that tell their slopes."""
    for knob, (colour, marker) in LOOK.items():
        line = [p for p in found if p.knob == knob and p.own is not None]
        if not line:
            continue
        errors = [p.own for p in line]
        parts = [f"{symbol}$^{{{power:.1f}}}$".replace("-", "\N{MINUS SIGN}") for symbol, power in
                 (("s", exponent([p.seconds for p in line], errors, 2)),
                  (SIZES.get(knob), exponent([p.value for p in line], errors, 2)))
                 if power is not None and symbol]
        label = ", ".join(parts) or "\N{EN DASH}"
        _curve(axes, line, errors, colour, marker, "-", label)
    axes.set(xscale="log", yscale="log")
    axes.grid(color="0.92", lw=0.5)
    return axes.get_legend_handles_labels()


def _curve(axes, line: list[Point], errors: list[float], colour, marker, style, label=None) -> None:
    seconds, shown = [p.seconds for p in line], [max(e, LEAST) for e in errors]
    spread = [[p.seconds - p.least for p in line], [p.most - p.seconds for p in line]]
    axes.errorbar(seconds, shown, xerr=spread, color=colour, marker=marker, ls=style, lw=1, ms=4, elinewidth=0.6,
                  label=label)


def _settings(axes, best: list[Point]) -> None:
    """The front's settings by number."""
    axes.axis("off")
    axes.set(xlim=(0, 1), ylim=(len(best) + 0.5, -0.5))
    for x, text, side in ((0.055, "Pareto front", "left"), (0.3, "seconds", "right"), (0.4, "error", "right"),
                          (0.43, "setting", "left")):
        axes.text(x, 0, text, fontsize=7, ha=side, va="center", weight="bold")
    for number, p in enumerate(best, 1):
        axes.text(0.045, number, f"{number}", fontsize=7, ha="right", va="center")
        axes.text(0.055, number, KNOBS[p.knob], fontsize=7, va="center")
        axes.text(0.3, number, f"{p.seconds:.2f}", fontsize=7, ha="right", va="center")
        axes.text(0.4, number, percent(p.sure), fontsize=7, ha="right", va="center")
        axes.text(0.43, number, p.setting, fontsize=6, va="center", family="monospace")
