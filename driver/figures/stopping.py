"""Picture of `make accuracy PART=stopping`: products and changes of tractions by loading."""

from pathlib import Path

from matplotlib.figure import Figure

from ..files import read_table
from .reading import select
from .style import BLUE, GREY, INK, RED, canvas, write

LOOK = {"classical": (GREY, "s"), "fixed": (BLUE, "o"), "budget": (RED, "D")}


def draw(table: Path) -> list[Path]:
    """Draw stopping.csv; returns the files written."""
    columns = read_table(table)
    return write(canvas(lambda figure: _fill(figure, columns), 11), table.parent, "stopping")


def _fill(figure: Figure, table: dict) -> None:
    """Products above, changes of the tractions below, over 1/h."""
    loadings = list(dict.fromkeys(table["loading"]))
    panels = figure.subplots(2, len(loadings), sharex=True, sharey="row", squeeze=False)
    for (above, below), loading in zip(panels.T, loadings):
        rows = select(table, table["loading"] == loading)
        n = 1 / rows["h"]
        for rule, (colour, marker) in LOOK.items():
            above.loglog(n, rows[f"products_{rule}"], color=colour, marker=marker, ms=4, label=rule)
            below.loglog(n, rows[f"change_{rule}"], color=colour, marker=marker, ms=4)
        below.loglog(n, rows["discretization"], color=INK, ls="--", label="discretization error")
        above.set_title(loading)
        below.set(xlabel=r"$1/h$ [1/m]", xticks=n, xticklabels=[f"{value:.0f}" for value in n])
        below.minorticks_off()
    panels[0, 0].set_ylabel("products with $F$")
    panels[1, 0].set_ylabel("relative change\nof contact tractions")
    # sharey: room for the legend above the curves of all columns
    for row, names in ((0, 3), (1, 1)):
        panels[row, 0].set_ylim(top=6 * panels[row, 0].get_ylim()[1])
        panels[row, 0].legend(loc="upper left", ncols=names, columnspacing=1.0, handlelength=1.5)
