"""Orders in mesh size and time step with friction: the manufactured zones, and Mindlin's cylinders.

Of `zones` slip, contact tractions and dissipated energy are known; of the cylinders the stick zone
and the shear (half-planes, so errors stay at the order of a/R), and for the time steps the run with
the most of them stands for the limit.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..text import assignments
from . import friction, halfspace, revolution
from .case import Case, View, solve

COLUMNS = ("problem", "element", "quantity", "varied", "values", "errors", "order")
F, P, A = 0.3, 1.0, 0.002  # of zones


@dataclass(frozen=True)
class Series:
    """Runs of a scene along one setting, by `sizes` the mesh sizes or time steps, relative.

    `errors` maps quantities to functions of (view, last view), absolute or relative alike.
    """

    problem: str
    element: str
    varied: str
    scene: str
    runs: tuple[dict, ...]
    sizes: tuple[float, ...]
    errors: dict


# ---- zones ---------------------------------------------------------------------------------------

def _ramp(s):
    return np.maximum(s, 0.0)


def _slip(x):
    return A * _ramp(x - 0.7)**4


def _pressure(x):
    return P * _ramp(1.5 - x)**2


def _l2(view: View, column: str, exact, end: float = np.inf) -> float:
    """Relative error in L2 on x < `end`."""
    x, w = view["x"], np.where(view["x"] < end, view["weight"], 0.0)
    wanted = exact(x)
    return float(np.sqrt((w * (np.abs(view[column]) - wanted)**2).sum() / (w * wanted**2).sum()))


def _work() -> float:
    x = 0.7 + 0.8 * (np.arange(20000) + 0.5) / 20000
    return float(0.5 * F * (_pressure(x) * _slip(x)).sum() * 0.8 / 20000)


ZONES = {
    "slip in L2": lambda view, _: _l2(view, "u_t", _slip, 1.5),
    "pressure in L2": lambda view, _: _l2(view, "sigma_n", _pressure),
    "shear in L2": lambda view, _: _l2(view, "sigma_t", lambda x: F * _pressure(x) * (
        1 - _ramp(0.7 - x)**4)),
    "dissipated energy": lambda view, _: abs(view.quantities["dissipated_energy"] / _work() - 1)}

# ---- two cylinders -------------------------------------------------------------------------------


def _against_last(name: str):
    return lambda view, last: abs(view.quantities[name] / last.quantities[name] - 1)


MINDLIN = {
    "half-width of the stick zone": lambda view, _: abs(
        friction.stick_width(view) / friction.mindlin(view, friction.cylinders)[2] - 1),
    "shear in L1": lambda view, _: friction.shear_error(friction.cylinders)(view),
    "shear in L2": lambda view, _: friction.shear_error(friction.cylinders, power=2)(view)}
STEPPING = {
    "dissipated energy": _against_last("dissipated_energy"),
    "half-width of the stick zone": lambda view, last: abs(
        friction.stick_width(view) / friction.stick_width(last) - 1)}

SPHERE = {"radius that sticks": lambda view, _: abs(
    revolution.stick_ratio(view) / halfspace.stick_ratio(0.2, 0.3) - 1)}

HALVED = (1.0, 0.5, 0.25)
SERIES = (
    Series("zones", "P1", "h", "zones", tuple({"cells": n, "steps": 1} for n in (4, 8, 16)), HALVED,
           ZONES),
    Series("zones", "P2", "h", "zones", tuple({"cells": n, "steps": 1} for n in (2, 4, 8)), HALVED,
           ZONES),
    Series("zones", "adaptive P1", "h", "zones",
           tuple({"cells": 4, "steps": 1, "adapt": n} for n in (0, 1, 2)), HALVED, ZONES),
    Series("two cylinders", "P1", "h", "mindlin-bodies",
           tuple({"h": h, "steps": 12} for h in (0.12, 0.06, 0.03, 0.015)), (*HALVED, 0.125),
           MINDLIN),
    Series("two cylinders", "P2", "h", "mindlin-bodies",
           tuple({"h": h, "steps": 12} for h in (0.12, 0.06, 0.03)), HALVED, MINDLIN),
    Series("two cylinders", "adaptive P1", "h", "verify/cylinders",
           tuple({"h": 0.05, "steps": 3, "adapt": n} for n in (0, 1, 2)), HALVED, MINDLIN),
    Series("two cylinders", "adaptive P2", "h", "verify/cylinders",
           tuple({"h": 0.05, "steps": 3, "adapt": n} for n in (0, 1)), HALVED[:2], MINDLIN),
    Series("rough sphere", "P1", "time step", "sphere",
           tuple({"friction": 0.2, "approach": revolution.APPROACH, "h": 2e-4, "steps": n}
                 for n in (1, 2, 4, 8, 16, 32)), (*HALVED, 1 / 8, 1 / 16, 1 / 32), SPHERE),
    Series("two cylinders", "P1", "time step", "mindlin-bodies",
           tuple({"h": 0.06, "steps": n} for n in (3, 6, 12, 24, 96)), (*HALVED, 0.125), STEPPING),
)


def measured(folder: Path) -> list[dict]:
    """Rows of the table of all series. Raises what their runs raise."""
    return [row for series in SERIES for row in _rows(series, folder)]


def _rows(series: Series, folder: Path) -> list[dict]:
    case = Case("", "", series.scene, "", series.runs, ())
    element = series.element.split()[-1]
    views = [solve(case, element, run, folder, False) for run in series.runs]
    names = {"h": ("cells", "h"), "time step": ("steps",)}[series.varied]
    values = [assignments({key: value for key, value in run.items() if key in (*names, "adapt")})
              for run in series.runs]
    rows = []
    for quantity, error in series.errors.items():
        errors = [error(view, views[-1]) for view in views[: len(series.sizes)]]
        rows.append({"problem": series.problem, "element": series.element, "quantity": quantity,
                     "varied": series.varied, "values": ", ".join(values[: len(errors)]),
                     "errors": " ".join(f"{value:.1e}" for value in errors),
                     "order": order(series.sizes, errors)})
    return rows


def order(sizes, errors) -> float | str:
    """Slope of log error over log size; empty where errors are at most those of tolerances."""
    if min(errors) < 1e-9:
        return ""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
