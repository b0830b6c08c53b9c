"""Picture of the random scenes in report.csv: how they ended, by what they declare."""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .style import BLUE, GREEN, ORANGE, RED, SKY, canvas, write

FAMILY = "random"
OUTCOMES = {"solved": (GREEN, "solved, cuts agree"),
            "by laws": (SKY, "solved, perhaps one of several solutions"),
            "refused": (BLUE, "refused and confirmed"),
            "bad": (ORANGE, "bad on purpose and refused"), "FAILED": (RED, "failed")}
# what is declared by most scenes, in two columns of panels
LEFT = ("outline", "labels", "support")
RIGHT = ("law", "gap", "history", "jump", "element", "contact")
ROW = 0.42  # centimetres of a bar


def draw(rows: list[dict], folder: Path) -> list[Path]:
    """Write random.png and .pdf for the rows of random scenes; the files written."""
    scenes = [(_outcome(row), _declared(row)) for row in rows]
    heights = [sum(len(_values(scenes, key)) + 2 for key in keys) for keys in (LEFT, RIGHT)]
    figure = canvas(lambda figure: _panels(figure, scenes), ROW * max(heights) + 2.2, 21)
    return write(figure, folder, FAMILY)


def _outcome(row: dict) -> str:
    if row["status"] == "refused" and row["exit"] == "2":
        return "bad"
    if row["status"] == "solved" and "uniqueness" in row["why"]:
        return "by laws"
    return row["status"]


def _declared(row: dict) -> dict[str, str]:
    return dict(part.split(": ", 1) for part in row["declared"].split("; ") if part)


def _values(scenes: list, key: str) -> list[str]:
    """Values of a key, the most frequent first."""
    found = [declared[key] for _, declared in scenes if key in declared]
    return sorted(set(found), key=lambda value: (-found.count(value), value))


def _panels(figure: Figure, scenes: list) -> None:
    """A panel a key, a bar a value, its outcomes one after the other."""
    legend, body = figure.subfigures(2, 1, height_ratios=(1, 14))
    columns = body.subfigures(1, 2)
    for column, keys in zip(columns, (LEFT, RIGHT)):
        lengths = [len(_values(scenes, key)) + 1 for key in keys]
        panels = column.subplots(len(keys), 1, height_ratios=lengths, squeeze=False)[:, 0]
        for axes, key in zip(panels, keys):
            _bars(axes, scenes, key)
        panels[-1].set_xlabel("scenes")
    counts = {name: sum(outcome == name for outcome, _ in scenes) for name in OUTCOMES}
    handles = [Patch(color=colour, label=f"{text}: {counts[name]}")
               for name, (colour, text) in OUTCOMES.items() if counts[name]]
    legend.legend(handles=handles, loc="center", ncols=3, frameon=False,
                  title=f"{len(scenes)} random scenes")


def _bars(axes, scenes: list, key: str) -> None:
    """The bars of one key."""
    values = _values(scenes, key)
    for place, value in enumerate(values):
        start = 0
        for name, (colour, _) in OUTCOMES.items():
            count = sum(outcome == name and declared.get(key) == value
                        for outcome, declared in scenes)
            axes.barh(place, count, 0.75, start, color=colour)
            start += count
    axes.set_yticks(range(len(values)), values, fontsize=7)
    axes.set_ylim(len(values) - 0.5, -0.5)
    axes.set_title(key, loc="left", fontsize=8, weight="bold")
    axes.spines[["top", "right"]].set_visible(False)
