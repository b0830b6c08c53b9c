"""Picture of `make accuracy PART=curved`: errors between two rings over the mesh size."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..files import read_table
from .style import BLUE, GREEN, GREY, INK, RED, canvas, header, write

LOOK = {"P1": (GREY, "s", "P1"), "P2, straight": (BLUE, "o", "P2, straight sides"),
        "P2": (RED, "D", "P2, curved sides"), "P2-mixed": (GREEN, "^", "P2-mixed, curved sides")}


def draw(table: Path) -> list[Path]:
    """Draw curved.csv; returns the files written."""
    columns = read_table(table)
    return write(canvas(lambda figure: _fill(figure, columns), 8), table.parent, "curved")


def _fill(figure: Figure, table: dict) -> None:
    """Pressures left, displacements right."""
    h = np.unique(table["h"])[::-1]
    panels = figure.subplots(1, 2)
    for panel, quantity, orders in zip(panels, ("pressure", "displacement"), ((1, 2), (2, 3))):
        for sides, (colour, marker, label) in LOOK.items():
            own = table["sides"] == sides
            panel.loglog(table["h"][own], table[quantity][own], color=colour, marker=marker, ms=4,
                         label=label)
        last = table[quantity][table["h"] == h[-1]]
        for order, place, style in zip(orders, (last.max(), last.min()), (":", "--")):
            line = 0.5 * place * (h / h[-1]) ** order
            panel.loglog(h, line, color=INK, lw=0.8, ls=style)
            panel.annotate("$h$" if order == 1 else f"$h^{order}$", (h[0], line[0]), (4, -3),
                           textcoords="offset points")
        panel.set(xlabel="side of an element $h$ [m]", ylabel=f"error of the {quantity}, $L_2$",
                  xticks=h, xticklabels=[f"{size:g}" for size in h])
        panel.minorticks_off()
        panel.set_xlim(right=1.25 * h[0])
    header(figure, "Straight and curved sides of elements", "two rings under even pressure, "
           "meshes that do not match: scene verify/rings",
           panels[-1].get_legend_handles_labels()[0])
