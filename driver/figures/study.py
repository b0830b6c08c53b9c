"""Picture of a parameter study: forces, pressure, zones and energy at the end over the values."""

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..files import read_table
from ..text import words
from .reading import select
from ..units import spelt
from .scales import scale_for
from .style import BLUE, INK, RED, STATUS, canvas, literal, write

FAR = 30  # times the least value: from there on values may stand on a logarithmic axis


def draw(directory: Path) -> list[Path]:
    """Draw study.csv into ``<directory>/figures``, if a value converged; returns the files."""
    summary = json.loads((directory / "summary.json").read_text())
    table = read_table(directory / "study.csv")
    table = select(table, table["converged"] == "yes")
    if not len(table["converged"]):
        return []
    (directory / "figures").mkdir(exist_ok=True)
    return write(canvas(lambda figure: _fill(figure, summary, table), 12), directory / "figures",
                 "study")


def _fill(figure: Figure, summary: dict, table: dict) -> None:
    name, values = summary["study"], next(iter(table.values()))
    numbers = values.dtype.kind == "f"  # nothing lies between words

    def plot(axes, what: str, unit: str, curves: dict) -> None:
        scale = scale_for(unit, np.concatenate([curve for curve, _ in curves.values()]))
        for label, (curve, colour) in curves.items():
            axes.plot(values, curve * scale.factor, color=colour, ls="-" if numbers else "",
                      marker="" if numbers and len(curve) > 20 else "o", label=label)
        axes.set_ylabel(f"{what} [{scale.label}]" if unit else what)
        axes.margins(x=0.05 if numbers else 0.3)

    units = summary["units"]
    forces, peak, zones, energy = figure.subplots(2, 2, sharex=True).ravel()
    plot(forces, "contact force", spelt(1, 1, units),
         {"normal resultant": (-table["resultant_n"], RED),
          "tangential resultant": (table["resultant_t"], BLUE)})
    plot(peak, "peak pressure", units["stress"], {"": (table["peak_pressure"], RED)})
    states = {zone: (table[f"nodes_{zone}"], colour) for zone, colour in STATUS.items()}
    occurring = {zone: curve for zone, curve in states.items() if curve[0].any()}
    plot(zones, "contact nodes", "", occurring or states)  # lines of zeros hide one another
    zones.update_datalim([(values[0], 0.0)] if numbers else [(0.0, 0.0)])
    zones.autoscale_view()
    plot(energy, "dissipated energy", spelt(1, 2, units), {"": (table["dissipated"], INK)})
    for axes in (forces, zones):
        axes.legend(frameon=False)
    for axes in (zones, energy):
        axes.set_xlabel(words(name))
        if numbers:
            _scaled(axes, values)
    figure.suptitle(f"{literal(summary['scene'])}: {summary['values']} values of {name}, "
                    "end of the history")


def _scaled(axes, values: np.ndarray) -> None:
    """An axis of numbers: logarithmic where most of it would be one step between them, else with
    the power of ten of small and large ones at its end.
    """
    steps = np.diff(np.sort(values))
    if values.min() > 0 and values.max() > FAR * values.min() and steps.max() > steps.sum() / 2:
        axes.set_xscale("log")
    else:
        axes.ticklabel_format(axis="x", style="sci", scilimits=(-3, 4), useMathText=True)
