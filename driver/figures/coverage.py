"""Picture of `make accuracy PART=coverage`: claimed over true errors, a point a claim."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..files import read_table
from ..quantity_table import QUANTITIES
from .style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED, SKY, canvas, write

LOOK = dict(zip(QUANTITIES, zip((RED, BLUE, SKY, GREEN, ORANGE, PURPLE, INK, GREY), "^osDvPpX"),
                strict=True))
LEAST = 1e-6  # smaller true errors are drawn there


def draw(table: Path) -> list[Path]:
    """Draw coverage.csv; returns the files written, none where no claim is judged."""
    columns = read_table(table)
    if not (columns["judged"] == "yes").any():
        return []
    return write(canvas(lambda figure: _fill(figure, columns), 12), table.parent, "coverage")


def _fill(figure: Figure, table: dict) -> None:
    judged = table["judged"] == "yes"
    true = np.maximum(table["true"][judged].astype(float), LEAST)
    claimed = np.maximum(table["claimed"][judged].astype(float), LEAST)
    axes = figure.subplots()
    for name, (colour, marker) in LOOK.items():
        own = table["quantity"][judged] == name
        if own.any():
            axes.loglog(true[own], claimed[own], marker, color=colour, ms=3.5, alpha=0.8,
                        label=name.replace("_", " "))
    ends = np.array([LEAST, max(true.max(), claimed.max())])
    axes.loglog(ends, ends, color=INK, lw=1.0)
    axes.loglog(ends, 4 * ends, color=INK, lw=0.6, ls=":")
    axes.loglog(ends, ends / 2, color=RED, lw=0.6, ls="--")
    for factor, text in ((1, "claim = truth"), (4, "4 times"), (0.5, "half")):
        axes.annotate(text, (ends[1], factor * ends[1]), xytext=(3, 0), textcoords="offset points",
                      fontsize=7, va="center")
    axes.set_xlim(ends[0] / 2, 10 * ends[1])  # with room for these words
    held = np.count_nonzero(table["held"][judged] == "yes")
    axes.set(xlabel="true error, relative", ylabel="claimed error, relative",
             title=f"{held} of {judged.sum()} claims hold")
    axes.legend(loc="lower right", ncols=2)
