"""Pictures of a suite's rows: a table in colours, case by case, and the products along the sweeps."""

import textwrap
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from ..figures import BLUE, GREEN, INCH, INK, ORANGE, RED, STYLE, WIDTH, write
from .report import RESIDUALS, Row

COLUMNS = ("status", *RESIDUALS[:-1], "comple-\nmentarity", "error\n/ allowed", "products\n/ easy",
           "condition\nof $MF$", "seconds")
PALE = {"good": "#CFE8DD", "near": "#F8E3B4", "bad": "#F2B8A0", "told": "#CFE0EE", "none": "#FFFFFF"}


def draw(rows: list[Row], folder: Path) -> list[Path]:
    """report.png and, if a sweep has several places, sweeps.png (and .pdf), in `folder`."""
    with matplotlib.rc_context(STYLE):
        made = _draw_table(_worst(rows), folder)
        names = [name for name in dict.fromkeys(row.sweep for row in rows if row.sweep)
                 if len({row.place for row in rows if row.sweep == name}) > 1]
        if names:
            made += _draw_sweeps(rows, names, folder)
    return made


def _worst(rows: list[Row]) -> list[tuple[str, str, list[Row]]]:
    """Family, case and rows of all sizes of every case, in their order."""
    found: dict[tuple, list[Row]] = {}
    for row in rows:
        found.setdefault((row.family, row.case), []).append(row)
    return [(*key, own) for key, own in found.items()]


def _cells(own: list[Row]):
    """Text and kind of every column for one case, the worst of its sizes."""
    failed = [row for row in own if row.status == "FAILED"]
    word = "FAILED" if failed else own[0].status + (f" ({own[0].exit})" if own[0].status == "refused" else "")
    yield word, "bad" if failed else "told" if own[0].status == "refused" else "good"
    worst = lambda name: np.nanmax([getattr(row, name) for row in own]) if any(
        np.isfinite(getattr(row, name)) for row in own) else np.nan
    for name in RESIDUALS:
        value, limit = worst(name), worst("kkt_tolerance")
        yield _power(value), _kind(value, limit)
    yield _number(worst("error")), _kind(worst("error"), 1.0)
    over = worst("iterations_ratio") > worst("ratio_allowed")
    yield _number(worst("iterations_ratio")), "none" if np.isnan(worst("ratio_allowed")) else "bad" if over else "good"
    yield _number(worst("condition")), "none"
    yield _number(worst("seconds")), "none"


def _kind(value: float, limit: float) -> str:
    if not (np.isfinite(value) and np.isfinite(limit)):
        return "none"
    return "bad" if value > limit else "near" if value > 0.5 * limit else "good"


def _power(value: float) -> str:
    return "" if not np.isfinite(value) else "0" if value == 0 else f"{value:.0e}".replace("e-0", "e-")


def _number(value: float) -> str:
    if not np.isfinite(value):
        return ""
    return f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}" if value < 1e5 else f"{value:.0e}".replace("e+0", "e")


def _draw_table(table, folder: Path) -> list[Path]:
    """One line a case, families apart; the worst of its sizes in every cell."""
    lines, last = [], None
    for family, case, own in table:
        if family != last:
            lines.append((family, None))
        lines.append((case, own))
        last = family
    wide, high, name = 1.35, 0.4, 8.2  # centimetres
    width, height = name + wide * len(COLUMNS), high * len(lines) + 2.0
    figure = Figure(figsize=(width * INCH, height * INCH), dpi=150)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis("off")
    for k, text in enumerate(COLUMNS):
        axes.text(name + wide * (k + 0.5), height - 0.95, text, ha="center", va="bottom", fontsize=6)
    for at, (text, own) in enumerate(lines):
        y = height - 1.05 - high * (at + 1)
        axes.text(0.15 if own is None else 0.4, y + high / 2, text, va="center", fontsize=7 if own is None else 6.5,
                  weight="bold" if own is None else "normal")
        for k, (word, kind) in enumerate(_cells(own) if own else ()):
            axes.add_patch(Rectangle((name + wide * k, y), wide, high, facecolor=PALE[kind], edgecolor="white", lw=0.8))
            axes.text(name + wide * (k + 0.5), y + high / 2, word, ha="center", va="center", fontsize=6)
    key = {"good": "as it must be", "near": "over half of what is allowed", "told": "refused as it must be", "bad": "failed"}
    axes.legend(handles=[Patch(color=PALE[kind], label=text) for kind, text in key.items()], loc="lower left", ncols=4,
                frameon=False, fontsize=6.5, bbox_to_anchor=(0, 0))
    return write(figure, folder, "report")


def _draw_sweeps(rows: list[Row], names: list[str], folder: Path) -> list[Path]:
    """Products over the places of every sweep, one panel a sweep, one line a size."""
    across = min(3, len(names))
    down = -(-len(names) // across)
    figure = Figure(figsize=(WIDTH, 5 * down * INCH), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    panels = np.ravel(figure.subplots(down, across, squeeze=False))
    for axes, name in zip(panels, names):
        own = [row for row in rows if row.sweep == name and row.status == "solved"]
        sizes = list(dict.fromkeys(row.size for row in own))
        for size, colour, marker in zip(sizes, (BLUE, ORANGE, GREEN, RED, INK), "osD^v"):
            line = sorted((row.place, row.products) for row in own if row.size == size)
            axes.plot(*zip(*line), color=colour, marker=marker,
                      label=size.replace("SUBDOMAINS=", "").replace("CELLS=", "cells "))
        places = [row.place for row in own]
        if places and min(places) > 0 and max(places) > 20 * min(places):
            axes.set_xscale("log")
        axes.set(xlabel=textwrap.fill(name, 26), ylim=(0, 1.1 * max((row.products for row in own), default=1)))
        axes.grid(color="0.9", lw=0.6)
        axes.legend(frameon=False, fontsize=6)
    for axes in panels[len(names):]:
        axes.axis("off")
    for axes in panels[::across]:
        axes.set_ylabel("products with $F$")
    return write(figure, folder, "sweeps")
