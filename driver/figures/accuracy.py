"""Pictures of the study `accuracy`: error over seconds, drawn from the tables that it left."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter

from ..files import read_rows
from ..text import percent, words
from .style import BLUE, GREEN, INK, ORANGE, PURPLE, RED, SKY, canvas, header, literal, write

SWEEPS = {  # sweep: its name in the legend, colour, marker and the symbol of what is varied
    "mesh": ("uniform meshes", BLUE, "o", "$h$"), "quadratic": ("uniform, P2", SKY, "h", "$h$"),
    "adapt": ("adaptive meshes", GREEN, "^", ""),
    "steps": ("time steps", ORANGE, "s", "$\\Delta t$"),
    "friction_rtol": ("fixed point", PURPLE, "D", "tol"), "rtol": ("MPRGP", RED, "v", "tol"),
    "together": ("together", "#888888", ".", "")}
SLOW = 0.1  # exponents below it are none
LEAST = 1e-9  # smaller errors are drawn there


@dataclass
class Point:
    """A run as the picture needs it; relative errors, NaN where the sweep has none of its own."""

    sweep: str
    value: float
    setting: str
    seconds: float
    least: float
    most: float
    error: float
    trusted: float
    own: float
    front: bool


def points(table: list[dict], quantity: str) -> list[Point]:
    """The runs of accuracy.csv that have a result."""
    def point(row: dict) -> Point:
        seconds = (float(row[f"seconds_solver{suffix}"]) for suffix in ("", "_least", "_most"))
        errors = (float(row[f"{quantity}_{name}"] or "nan") for name in ("error", "trusted", "own"))
        return Point(row["sweep"], float(row["value"]), row["setting"], *seconds, *errors,
                     row[f"{quantity}_front"] == "1")

    return [point(row) for row in table if row["seconds_solver"]]


def exponent(x: list[float], errors: list[float], span: float) -> float | None:
    """Least-squares exponent of error over x; None for few runs or where x spans too little."""
    good = [(math.log(a), math.log(e)) for a, e in zip(x, errors) if e > LEAST]
    if len(good) < 3 or np.ptp([a for a, _ in good]) < math.log(span):
        return None
    return float(np.polyfit(*zip(*good), 1)[0])


def draw(table: Path, every: bool = False) -> list[Path]:
    """Draw accuracy.csv with reference.csv beside it; returns the files written.

    The picture work_precision is of the main quantity; if `every`, the others have one each.
    """
    runs, paths = read_rows(table), []
    for reference in read_rows(table.with_name("reference.csv")):
        main = reference["main"] == "1"
        if main or every:
            name = reference["quantity"]
            figure = compose(points(runs, name), reference)
            paths += write(figure, table.parent,
                           "work_precision" if main else f"work_precision_{name}")
    return paths


def compose(runs: list[Point], reference: dict) -> Figure:
    """The figure for one quantity, a row of reference.csv."""
    front = sorted((p for p in runs if p.front), key=lambda p: p.seconds)
    return canvas(lambda figure: _fill(figure, runs, front, reference), 11.3 + 0.42 * len(front))


def _fill(figure: Figure, runs: list[Point], front: list[Point], reference: dict) -> None:
    """Left all errors, right each sweep's own part; below, the settings of the front."""
    grid = figure.add_gridspec(2, 1, height_ratios=[9.2, 0.42 * len(front) + 0.6])
    top = grid[0].subgridspec(2, 2, height_ratios=[9, 1])
    total = figure.add_subplot(top[0, 0])
    own = figure.add_subplot(top[0, 1])
    limit, quantity = float(reference["uncertainty"]), words(reference["quantity"])
    handles = _errors(total, runs, front, limit)
    slopes = figure.add_subplot(top[1, :])
    slopes.axis("off")
    slopes.legend(*_own(own, runs),
                  loc="center", ncols=3, fontsize=7, frameon=False, columnspacing=1.2,
                  handlelength=1.5)
    total.set(ylabel=f"relative error of the {quantity}", title="all errors, against the reference")
    own.set(title="the sweep's own part")
    for axes in (total, own):
        axes.set(xlabel="seconds of the solver", xscale="log", yscale="log")
        axes.grid(color="0.92", lw=0.5)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axes.xaxis.set_minor_formatter(FuncFormatter(
            lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else ""))
        axes.tick_params(axis="x", which="both", labelsize=7, length=3)
    _settings(figure.add_subplot(grid[1]), front)
    source = "reference run" if reference["source"] == "reference run" else "closed form"
    identity = (f"{literal(reference['scene'])}; against the {source}, good to {percent(limit)}; "
                "bars: spread of repeated runs")
    header(figure, f"What accuracy costs: {quantity}", identity, handles)


def _errors(axes, runs: list[Point], front: list[Point], limit: float) -> list:
    """All errors over seconds, with the front; handles for the legend."""
    handles = []
    for sweep, (label, colour, marker, _) in SWEEPS.items():
        own = [p for p in runs if p.sweep == sweep]
        if own:
            line = "" if sweep == "together" else "-"
            _curve(axes, own, [p.error for p in own], colour, marker, line)
            handles.append(Line2D([], [], color=colour, marker=marker, ls=line, label=label))
    axes.plot([p.seconds for p in front], [p.trusted for p in front], "o", ls=":", lw=0.8,
              color=INK, mfc="none", ms=8, mew=0.8, zorder=5)
    for number, p in enumerate(front, 1):
        axes.annotate(str(number), (p.seconds, p.trusted), xytext=(-8, -8),
                      textcoords="offset points", fontsize=7, ha="center", va="center", zorder=6)
    handles.append(Line2D([], [], color=INK, marker="o", mfc="none",
                   ms=7, lw=0.8, ls=":", label="Pareto front"))
    axes.axhspan(LEAST / 10, limit, color="0.9", zorder=0)
    handles.append(Patch(color="0.9", label="below the reference's own error"))
    axes.margins(x=0.09)
    errors = [max(p.error, LEAST) for p in runs]
    axes.set_ylim(min(min(errors), limit) / 1.6, min(max(errors), 10) * 1.6)
    return handles


def _own(axes, runs: list[Point]) -> tuple[list, list]:
    """Curves of the sweeps' own parts; handles and labels with their orders."""
    for sweep, (name, colour, marker, symbol) in SWEEPS.items():
        own = [p for p in runs if p.sweep == sweep and not math.isnan(p.own)]
        if not own:
            continue
        errors = [p.own for p in own]
        power = exponent([p.value for p in own], errors, 2) if symbol else None
        if power is not None and power > SLOW:  # else nothing falls with it
            name += f": error \N{PROPORTIONAL TO} {symbol}$^{{{power:.1f}}}$"
        _curve(axes, own, errors, colour, marker, "-", name)
    return axes.get_legend_handles_labels()


def _curve(axes, runs: list[Point], errors: list[float], colour, marker, line, label=None) -> None:
    """Errors over seconds, with bars from the shortest to the longest repetition."""
    spread = [[p.seconds - p.least for p in runs], [p.most - p.seconds for p in runs]]
    axes.errorbar([p.seconds for p in runs], [max(e, LEAST) for e in errors], xerr=spread,
                  color=colour, marker=marker, ls=line, lw=1, ms=4, elinewidth=0.6, label=label)


def _settings(axes, front: list[Point]) -> None:
    """The front's settings by number."""
    axes.axis("off")
    axes.set(xlim=(0, 1), ylim=(len(front) + 0.5, -0.5))
    for x, text, side in ((0.055, "Pareto front", "left"), (0.3, "seconds", "right"),
                          (0.4, "error", "right"), (0.43, "setting", "left")):
        axes.text(x, 0, text, fontsize=7, ha=side, va="center", weight="bold")
    for number, p in enumerate(front, 1):
        axes.text(0.045, number, f"{number}", fontsize=7, ha="right", va="center")
        axes.text(0.055, number, SWEEPS[p.sweep][0], fontsize=7, va="center")
        axes.text(0.3, number, f"{p.seconds:.2f}", fontsize=7, ha="right", va="center")
        axes.text(0.4, number, percent(p.trusted), fontsize=7, ha="right", va="center")
        axes.text(0.43, number, p.setting, fontsize=6, va="center", family="monospace")
