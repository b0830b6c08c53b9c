"""Picture of the slides' table: products with F over the number of subdomains, beside ours."""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from ..files import read_table
from .reading import select
from .style import BLUE, GREEN, INK, canvas, write


def draw(table: Path) -> list[Path]:
    """Draw table.csv; returns the files written."""
    columns = read_table(table)
    return write(canvas(lambda figure: _fill(figure, columns), 8), table.parent, "table")


def _fill(figure: Figure, table: dict) -> None:
    """One panel a loading."""
    # any row of a size: all carry the slides' values
    rows = {size: row for row, size in enumerate(table["n_s"])}
    slides = select(table, [rows[size] for size in sorted(rows)])
    for axes, loading in zip(figure.subplots(1, 2, sharey=True), ("monotone", "nonmonotone")):
        theirs = slides[f"slides_n_m_{loading}"]
        axes.loglog(slides["n_s"], theirs, "o--", color=INK, label="slides")
        for method, colour, marker in (("plain", GREEN, "s"), ("default", BLUE, "D")):
            own = select(table, table["method"] == method)
            if len(own["n_s"]):
                axes.loglog(own["n_s"], own[f"n_m_{loading}"], color=colour, marker=marker,
                            label=f"ours, {method}")
        axes.set(title=f"{loading} loading", xlabel="subdomains $n_s$")
        axes.set_xticks(slides["n_s"], [f"{size:.0f}" for size in slides["n_s"]])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(color="0.9", lw=0.6)
    figure.axes[0].set_ylabel("products with $F$ in 20 steps")
    figure.axes[0].legend(frameon=False)
