"""Pictures of `make verify`: for each case what was computed as lines, the reference as points.

Cases of single numbers show by how much these miss their references on one mesh after the other.
"""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..files import read_rows
from ..text import words
from .scales import scale_for
from .style import BLUE, INK, ORANGE, canvas, write

LINES = {"P1": (BLUE, "-"), "P2": (ORANGE, "--")}


MARKS = "osD^vP"  # of the numbers of a case
LEAST = 1e-16  # error that is drawn for none


def draw(table: Path) -> list[Path]:
    """Draw curves.csv, and report.csv where a case has no curve; returns the files written."""
    curves, numbers = _by_case(table), _by_case(table.with_name("report.csv"))
    folder = table.parent / "figures"
    folder.mkdir(exist_ok=True)
    paths = []
    for name, rows in numbers.items():
        fill, own = (_fill, curves[name]) if name in curves else (_errors, rows)
        figure = canvas(lambda figure, fill=fill, own=own: fill(figure, own), 6.5, 10)
        paths += write(figure, folder, name)
    return paths


def _by_case(table: Path) -> dict[str, list[dict]]:
    rows: dict[str, list[dict]] = {}
    for row in read_rows(table):
        rows.setdefault(row["case"], []).append(row)
    return rows


def _errors(figure: Figure, rows: list[dict]) -> None:
    """Relative errors of a case's numbers on its meshes, and what is allowed on the last."""
    axes = figure.subplots()
    refined = [row for row in rows if row["errors"]]
    names = list(dict.fromkeys(row["quantity"] for row in refined))
    longest = max(len(row["errors"].split()) for row in refined)
    for row in refined:
        errors = [max(float(error), LEAST) for error in row["errors"].split()]
        (colour, line), mark = LINES[row["element"]], MARKS[names.index(row["quantity"]) % 6]
        label = f"{words(row['quantity'])}, {row['element']}"
        axes.plot(range(1, len(errors) + 1), errors, line, marker=mark, color=colour, ms=4, lw=1,
                  mfc="none", label=label)
        if row.get("size_effect"):
            axes.plot([len(errors)], [float(row["remaining"])], mark, color=colour, ms=4)
        axes.plot([longest + 0.3], [float(row["tolerance"])], marker=mark, color=INK, ms=4,
                  mfc="none", ls="none")
    axes.plot([], [], "o", color=INK, mfc="none", ms=4, label="tolerance")
    if any(row.get("size_effect") for row in refined):
        axes.plot([], [], "o", color=BLUE, ms=4, label="less what the size of the body adds")
    axes.set_yscale("log")
    axes.set_xticks(range(1, longest + 1))
    axes.set(xlim=(0.7, longest + 0.6), xlabel="mesh, coarse to fine", ylabel="relative error")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.25), fontsize=5, ncols=2)


def _fill(figure: Figure, rows: list[dict]) -> None:
    axes = figure.subplots()
    scale, name = _unit(rows)
    for kind in dict.fromkeys(row["kind"] for row in rows):
        x, y = zip(*((float(row["x"]), scale * float(row["y"]))
                     for row in rows if row["kind"] == kind))
        if kind == "reference":
            axes.plot(x, y, "o", color=INK, mfc="none", ms=3.5, mew=0.7, label="reference")
        else:
            colour, line = LINES[kind]
            axes.plot(x, y, line, color=colour, lw=1.2, label=kind)
    known = [scale * float(row["y"]) for row in rows if row["kind"] == "reference"]
    low, high = min(known), max(known)
    if low < 0.8 * high:  # from zero; where the pressure is infinite nodes have large means
        axes.set_ylim(1.3 * min(low, 0.0), 1.15 * high)
    else:
        axes.set_ylim(low - max(high - low, 0.02 * high), high + max(high - low, 0.02 * high))
    across = [float(row["x"]) for row in rows if row["kind"] == "reference"]
    margin = 0.15 * (max(across) - min(across))
    axes.set_xlim(min(across) - margin, max(across) + margin)
    axes.xaxis.set_major_locator(MaxNLocator(7))
    axes.set(xlabel=rows[0]["x_name"], ylabel=name)
    axes.legend()


def _unit(rows: list[dict]) -> tuple[float, str]:
    """Factor and name of the values of a curve, "pressure [Pa]", with a prefix that suits them."""
    name, bracket, unit = rows[0]["y_name"].partition(" [")
    if not bracket:
        return 1.0, name
    scale = scale_for(unit.removesuffix("]"), [float(row["y"]) for row in rows
                                               if row["kind"] == "reference"])
    return scale.factor, f"{name} [{scale.label}]"
