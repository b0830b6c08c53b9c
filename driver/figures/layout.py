"""Titles, legends and grids of axes of a run's figures."""

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .reading import Run, contact_boundaries
from .scales import length_scale
from .style import INCH, header, lay_out, literal, place_header

PANELS = 6  # contact boundaries that fit in one figure
NAMED = 5  # of those that do not, so many are named
NAMES = 0.5  # inches that the name of an upright axis takes
FLAT = 0.4  # inches; numbers of the axis of a body as flat stand on each other
LAYOUTS, ENOUGH = 5, 0.02  # layouts until a body is as wide as it can be, to this part


def run_header(figure: Figure, run: Run, caption: str, handles: list, note: str = "") -> None:
    """Title with doubts about the run, its identity and a legend, stacked above the axes."""
    state = "" if run.summary["converged"] else " (not converged)"
    verdict = run.summary.get("validity", {}).get("verdict", "ok")
    if verdict != "ok":
        state += f" ({verdict}: see the warnings)"
    names = literal(f"scene {run.scene}"), literal(run.summary.get("variant") or "")
    identity = ", ".join(words for words in (*names, note) if words)
    header(figure, caption + state, identity, handles)


def shrink_to_body(figure: Figure, axes) -> None:
    """Cut the height that equal scales of x and y leave unused; spare width goes to both sides.

    Names of axes higher than a flat body take room that only the next layout shows.
    """
    lay_out(figure)
    place = axes.get_position()
    width, shape = place.width, place.height * figure.get_figheight() / place.width
    slack = axes.get_position(original=True).height - place.height
    names = max(0.0, NAMES - place.height * figure.get_figheight())
    figure.set_figheight(figure.get_figheight() * (1 - slack) + names)
    figure.set_layout_engine("compressed")
    for _ in range(LAYOUTS):
        place_header(figure)
        lay_out(figure)
        missing = width - axes.get_position().width
        if missing < ENOUGH:
            break
        figure.set_figheight(figure.get_figheight() + missing * shape)
    if axes.get_position().height * figure.get_figheight() < FLAT:
        axes.yaxis.set_major_locator(MaxNLocator(1))


def map_axes(figure: Figure, run: Run, xy: np.ndarray):
    """Axes with equal scales for a picture of the body, and the scale of its coordinates."""
    axes = figure.add_subplot()
    return axes, as_map(axes, run, xy)


def as_map(axes, run: Run, xy: np.ndarray):
    """Make `axes` those of a picture of the body; the scale of its coordinates."""
    axes.set_aspect("equal")
    scale = length_scale(run, xy)
    names = "rz" if run.summary["effects"].get("axisymmetric") else "xy"
    axes.set(xlabel=f"${names[0]}$ [{scale.label}]", ylabel=f"${names[1]}$ [{scale.label}]")
    return scale


def panel_grid(figure: Figure, run: Run, boundaries: list, stacked: int, height: float) -> list:
    """For every boundary a list of `stacked` axes with a common arc; two boundaries a row."""
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
            cell[0].set_title(r"$\Gamma_c$, label "
                              + run.label_name(boundaries[number][0]))
        cells.append(cell)
    return cells


def fitting(boundaries: list, contact: dict) -> tuple[list, str]:
    """The contact boundaries that fit in a figure, in their order, and a note on the others.

    Of too many those that carry most of the force are shown, each in the step of all rows `contact`
    in which it carries most, so that all figures of a run show the same ones.
    """
    carried = {label: np.bincount(rows["step"].astype(int),
                                  rows["weight"] * np.abs(rows["sigma_n"])).max()
               for label, rows in contact_boundaries(contact)}
    foremost = sorted((label for label, _ in boundaries), key=lambda label: -carried[label])
    names = sorted(foremost[PANELS:])
    if not names:
        return boundaries, ""
    more = f" and {len(names) - NAMED} more" * (len(names) > NAMED)
    listed = ", ".join(str(name) for name in names[:NAMED])
    return ([(label, rows) for label, rows in boundaries if label not in names],
            f"not shown, as they carry least: {listed}{more} (see contact.csv)")
