"""Pictures of `make verify`: for each case what was computed as lines, the reference as points."""

from pathlib import Path

from matplotlib.figure import Figure

from ..files import read_rows
from .style import BLUE, INK, ORANGE, canvas, write

LINES = {"P1": (BLUE, "-"), "P2": (ORANGE, "--")}


def draw(table: Path) -> list[Path]:
    """Draw curves.csv; returns the files written."""
    curves: dict[str, list[dict]] = {}
    for row in read_rows(table):
        curves.setdefault(row["case"], []).append(row)
    folder = table.parent / "figures"
    folder.mkdir(exist_ok=True)
    paths = []
    for name, rows in curves.items():
        figure = canvas(lambda figure, rows=rows: _fill(figure, rows), 6.5, 10)
        paths += write(figure, folder, name)
    return paths


def _fill(figure: Figure, rows: list[dict]) -> None:
    axes = figure.subplots()
    for kind in dict.fromkeys(row["kind"] for row in rows):
        x, y = zip(*((float(row["x"]), float(row["y"])) for row in rows if row["kind"] == kind))
        if kind == "reference":
            axes.plot(x, y, "o", color=INK, mfc="none", ms=3.5, mew=0.7, label="reference")
        else:
            colour, line = LINES[kind]
            axes.plot(x, y, line, color=colour, lw=1.2, label=kind)
    known = [float(row["y"]) for row in rows if row["kind"] == "reference"]
    low, high = min(known), max(known)
    if low < 0.8 * high:  # from zero; where the pressure is infinite nodes have large means
        axes.set_ylim(0, 1.15 * high)
    else:
        axes.set_ylim(low - max(high - low, 0.02 * high), high + max(high - low, 0.02 * high))
    across = [float(row["x"]) for row in rows if row["kind"] == "reference"]
    margin = 0.15 * (max(across) - min(across))
    axes.set_xlim(min(across) - margin, max(across) + margin)
    axes.set(xlabel=rows[0]["x_name"], ylabel=rows[0]["y_name"])
    axes.legend()
