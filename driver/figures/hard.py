"""Pictures of the hard cases' report.csv: a coloured table, and products along sweeps."""

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from ..files import read_rows
from . import drawn
from .style import BLUE, GREEN, INK, ORANGE, RED, canvas, write

RESIDUALS = ("stationarity", "gluing", "penetration", "sign",
             "cone", "equilibrium", "complementarity")
NUMBERS = (*RESIDUALS, "kkt_tolerance", "error", "products", "iterations_ratio", "ratio_allowed",
           "condition", "seconds", "place")
COLUMNS = ("status", *RESIDUALS[:-1], "comple-\nmentarity", "error\n/ allowed", "products\n/ easy",
           "condition\nof $MF$", "seconds")
PALE = {"good": "#CFE8DD", "near": "#F8E3B4",
        "bad": "#F2B8A0", "refused": "#CFE0EE", "none": "#FFFFFF"}
KEY = {"good": "as it must be", "near": "over half of what is allowed",
       "refused": "refused as it must be", "bad": "failed"}
# centimetres: width of a cell, height of a line, width of the names
CELL, LINE, NAME = 1.35, 0.4, 8.2


def draw(table: Path) -> list[Path]:
    """Draw report.csv, sweeps with several places, random scenes; returns the files written."""
    rows = [{**row, **{name: float(row[name] or "nan") for name in NUMBERS}}
            for row in read_rows(table)]
    scenes = [row for row in rows if row["family"] == drawn.FAMILY]
    made = drawn.draw(scenes, table.parent) if scenes else []
    if len(scenes) < len(rows):
        made += _draw_cases([row for row in rows if row["family"] != drawn.FAMILY], table.parent)
    return made


def _draw_cases(rows: list[dict], folder: Path) -> list[Path]:
    """The table and the sweeps."""
    lines = _lines(rows)
    width, height = NAME + CELL * len(COLUMNS), LINE * len(lines) + 2.0
    figure = canvas(lambda figure: _table(figure, lines, width, height), height, width, "none")
    paths = write(figure, folder, "report")
    names = [name for name in dict.fromkeys(row["sweep"] for row in rows if row["sweep"])
             if len({row["place"] for row in rows if row["sweep"] == name}) > 1]
    if names:
        across = min(3, len(names))
        down = -(-len(names) // across)
        figure = canvas(lambda figure: _sweeps(figure, rows, names, down, across), 5 * down)
        paths += write(figure, folder, "sweeps")
    return paths


def _lines(rows: list[dict]) -> list[tuple[str, list[dict]]]:
    """Lines of the table: a family's name without rows, then its cases with rows by size."""
    families: dict[str, dict] = {}
    for row in rows:
        families.setdefault(row["family"], {}).setdefault(row["case"], []).append(row)
    return [line for family, cases in families.items() for line in ((family, []), *cases.items())]


def _cells(sizes: list[dict]):
    """Text and colour of every column for one case, the worst of its sizes."""
    def worst(name: str) -> float:
        values = [row[name] for row in sizes]
        return np.nanmax(values) if np.isfinite(values).any() else np.nan

    first = sizes[0]
    if any(row["status"] == "FAILED" for row in sizes):
        yield "FAILED", "bad"
    elif first["status"] == "refused":
        yield f"refused ({first['exit']})", "refused"
    else:
        yield first["status"], "good"
    for name in RESIDUALS:
        yield _power(worst(name)), _colour(worst(name), worst("kkt_tolerance"))
    yield _number(worst("error")), _colour(worst("error"), 1.0)
    ratio, allowed = worst("iterations_ratio"), worst("ratio_allowed")
    yield _number(ratio), "none" if np.isnan(allowed) else "bad" if ratio > allowed else "good"
    yield _number(worst("condition")), "none"
    yield _number(worst("seconds")), "none"


def _colour(value: float, limit: float) -> str:
    if not (np.isfinite(value) and np.isfinite(limit)):
        return "none"
    return "bad" if value > limit else "near" if value > 0.5 * limit else "good"


def _power(value: float) -> str:
    if not np.isfinite(value):
        return ""
    return "0" if value == 0 else f"{value:.0e}".replace("e-0", "e-")


def _number(value: float) -> str:
    if not np.isfinite(value):
        return ""
    if abs(value) < 100:
        return f"{value:.2g}"
    return f"{value:.0f}" if value < 1e5 else f"{value:.0e}".replace("e+0", "e")


def _table(figure: Figure, lines: list[tuple], width: float, height: float) -> None:
    """One line a case, families apart; the worst of its sizes in every cell."""
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis("off")
    for k, text in enumerate(COLUMNS):
        axes.text(NAME + CELL * (k + 0.5), height - 0.95,
                  text, ha="center", va="bottom", fontsize=6)
    for number, (name, sizes) in enumerate(lines, 1):
        y = height - 1.05 - LINE * number
        if not sizes:
            axes.text(0.15, y + LINE / 2, name, va="center", fontsize=7, weight="bold")
            continue
        axes.text(0.4, y + LINE / 2, name, va="center", fontsize=6.5)
        for k, (text, colour) in enumerate(_cells(sizes)):
            x = NAME + CELL * k
            axes.add_patch(Rectangle((x, y), CELL, LINE,
                           facecolor=PALE[colour], edgecolor="white", lw=0.8))
            axes.text(x + CELL / 2, y + LINE / 2, text, ha="center", va="center", fontsize=6)
    axes.legend(handles=[Patch(color=PALE[colour], label=text) for colour, text in KEY.items()],
                loc="lower left", ncols=4, frameon=False, fontsize=6.5, bbox_to_anchor=(0, 0))


def _sweeps(figure: Figure, rows: list[dict], names: list[str], down: int, across: int) -> None:
    """Products over the places of every sweep, one panel a sweep, one line a size."""
    panels = np.ravel(figure.subplots(down, across, squeeze=False))
    for axes, name in zip(panels, names):
        own = [row for row in rows if row["sweep"] == name and row["status"] == "solved"]
        sizes = list(dict.fromkeys(row["size"] for row in own))
        for size, colour, marker in zip(sizes, (BLUE, ORANGE, GREEN, RED, INK), "osD^v"):
            line = sorted((row["place"], row["products"]) for row in own if row["size"] == size)
            axes.plot(*zip(*line), color=colour, marker=marker,
                      label=size.replace("SUBDOMAINS=", "").replace("CELLS=", "cells "))
        places = [row["place"] for row in own]
        if places and min(places) > 0 and max(places) > 20 * min(places):
            axes.set_xscale("log")
        most = max((row["products"] for row in own), default=1)
        axes.set(xlabel=textwrap.fill(name, 26), ylim=(0, 1.1 * most))
        axes.grid(color="0.9", lw=0.6)
        axes.legend(frameon=False, fontsize=6)
    for axes in panels[len(names):]:
        axes.axis("off")
    for axes in panels[::across]:
        axes.set_ylabel("products with $F$")
