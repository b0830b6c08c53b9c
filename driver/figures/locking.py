"""Picture of `make accuracy PART=locking`: errors over the mesh size, a column a ratio."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..files import read_table
from .style import BLUE, GREY, INK, RED, canvas, write

LOOK = {"P1": (GREY, "s"), "P2": (BLUE, "o"), "P2-mixed": (RED, "D")}


def draw(table: Path) -> list[Path]:
    """Draw locking.csv; returns the files written."""
    columns = read_table(table)
    return write(canvas(lambda figure: _fill(figure, columns), 11), table.parent, "locking")


def _fill(figure: Figure, table: dict) -> None:
    """Strain above, pressure below."""
    ratios = list(dict.fromkeys(table["poisson"]))
    panels = figure.subplots(2, len(ratios), sharex=True, sharey="row", squeeze=False)
    for column, poisson in zip(panels.T, ratios):
        for panel, quantity in zip(column, ("strain", "pressure")):
            for element, (colour, marker) in LOOK.items():
                own = (table["element"] == element) & (table["poisson"] == poisson)
                panel.loglog(table["h"][own], table[quantity][own], color=colour, marker=marker,
                             ms=4, label=element)
            h = np.unique(table["h"])[::-1]
            panel.loglog(h, 0.003 * (h / h[0]) ** 2, color=INK, lw=0.8, ls=":", label="$h^2$")
        column[0].set_title(rf"$\nu = {poisson:g}$")
        column[1].set(xlabel="element size $h$", xticks=h,
                      xticklabels=[f"1/{1 / size:.0f}" for size in h])
        column[1].minorticks_off()
    panels[0, 0].set_ylabel("error of the strain\n(relative, $L_2$)")
    panels[1, 0].set_ylabel("error of the pressure\n(relative, $L_2$)")
    # sharey: room for the legend in all columns
    panels[0, 0].set_ylim(top=100 * panels[0, 0].get_ylim()[1])
    panels[0, 0].legend(loc="upper left", handlelength=1.5)
