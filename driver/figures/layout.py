"""Titles, legends and grids of axes of a run's figures."""

import math

import numpy as np
from matplotlib.figure import Figure

from .reading import Run
from .scales import length_scale
from .style import INCH, PAD, place_header

PANELS = 4  # contact boundaries that fit in one figure


def header(figure: Figure, run: Run, caption: str, handles: list, note: str = "") -> None:
    """Title, identity of the run and legend, stacked above the axes."""
    state = "" if run.summary["converged"] else " (not converged)"
    variant = run.summary.get("variant")
    identity = ", ".join(w for w in (f"scene {run.scene}", variant, note) if w)
    figure.text(0.5, 1, caption + state, ha="center", va="top", fontsize=10)
    figure.text(0.5, 1, identity, ha="center", va="top", fontsize=8, color="0.35")
    columns = len(handles)
    while handles:
        figure.legend(handles=handles, loc="upper center", ncols=columns, frameon=False, borderpad=0,
                      handlelength=1.8, columnspacing=1.4, borderaxespad=0)
        width = figure.legends[0].get_window_extent(figure.canvas.get_renderer()).width
        if columns == 1 or width < figure.bbox.width - 2 * PAD * figure.dpi:
            break
        figure.legends[0].remove()
        columns -= 1
    place_header(figure)


def shrink_to_body(figure: Figure, axes) -> None:
    """Take from the figure the height that equal scales of x and y leave unused; unused width goes to both sides."""
    figure.draw_without_rendering()
    slack = axes.get_position(original=True).height - axes.get_position().height
    figure.set_figheight(figure.get_figheight() * (1 - slack))
    figure.set_layout_engine("compressed")
    place_header(figure)


def map_axes(figure: Figure, run: Run, xy: np.ndarray):
    """Axes with equal scales for a picture of the body, and the scale of its coordinates."""
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    scale = length_scale(run, xy)
    axes.set(xlabel=f"$x$ [{scale.label}]", ylabel=f"$y$ [{scale.label}]")
    return axes, scale


def panel_grid(figure: Figure, boundaries: list, stacked: int, height: float) -> list:
    """For every boundary a list of `stacked` axes with a common arc axis; at most two boundaries a row."""
    columns = min(len(boundaries), 2)
    rows = math.ceil(len(boundaries) / columns)
    figure.set_figheight(height * INCH * rows)
    grid = figure.subplots(rows * stacked, columns, squeeze=False)
    cells = []
    for number in range(rows * columns):
        row, column = divmod(number, columns)
        cell = list(grid[row * stacked:(row + 1) * stacked, column])
        if number >= len(boundaries):
            for axes in cell:
                axes.remove()
            continue
        for axes in cell[:-1]:
            axes.sharex(cell[-1])
            axes.tick_params(labelbottom=False)
        if len(boundaries) > 1:
            cell[0].set_title(rf"$\Gamma_c$, label {boundaries[number][0]}")
        cells.append(cell)
    return cells


def left_out(boundaries: list) -> str:
    """Says how many contact boundaries did not find a panel."""
    return f"{PANELS} of {len(boundaries)} contact boundaries shown" if len(boundaries) > PANELS else ""
