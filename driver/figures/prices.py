"""Picture of `make accuracy PART=prices`: predicted and taken seconds, accuracy and true error."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..files import read_table
from .style import BLUE, GREEN, INK, ORANGE, canvas, write

LOOK = {"P1": (BLUE, "o"), "P2": (ORANGE, "s"), "ADAPT": (GREEN, "^")}
LEAST = 1e-6  # smaller true errors are drawn there


def draw(table: Path) -> list[Path]:
    """Draw prices.csv; returns the files written."""
    columns = read_table(table)
    return write(canvas(lambda figure: _fill(figure, columns), 12), table.parent, "prices")


def _fill(figure: Figure, table: dict) -> None:
    left, right = figure.subplots(1, 2)
    predicted, taken = table["seconds_predicted"].astype(float), table["seconds"].astype(float)
    asked = table["accuracy"].astype(float)
    true = np.maximum(table["true"].astype(float), LEAST)
    for name, (colour, marker) in LOOK.items():
        own = table["kind"] == name
        if own.any():
            left.loglog(predicted[own], taken[own], marker, color=colour, ms=4, label=name)
            right.loglog(asked[own], true[own], marker, color=colour, ms=4, alpha=0.7)
    for axes, values, factors in ((left, predicted, (0.5, 1, 2)), (right, asked, (1,))):
        ends = np.array([values.min() / 1.5, values.max() * 1.5])
        for factor in factors:
            axes.loglog(ends, factor * ends, color=INK, lw=0.8, ls="-" if factor == 1 else ":")
    left.set(xlabel="predicted seconds", ylabel="taken seconds",
             title="dotted: a factor of two")
    right.set(xlabel="accuracy that the price is for", ylabel="true error, relative",
              title="below the line: accuracy met")
    left.legend(loc="upper left")
