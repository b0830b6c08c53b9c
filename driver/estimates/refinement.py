"""The cycles of refinement of a run: settings and files, what they took and what they reached.

A run asks for them before FreeFEM starts: what computes, energy_norm/adaptivity.py, is imported
while it works.
"""

import dataclasses
import json
from pathlib import Path

from ..files import write_table
from ..options import Settings
from ..text import percent

STEM = "size"  # of the files of a size field, see adaptivity.write_sizes
EXACT = 1e-5  # relative errors below which digits are rounding
COARSE = {"rtol": 1e-4, "friction_rtol": 1e-3, "primal_rtol": 1e-2}  # of cycles, rough


def coarse(settings: dict) -> dict:
    """Solver settings of a cycle: those of the run, loosened to what its mesh is worth."""
    preset = dataclasses.asdict(Settings(**settings))
    kind = "recovery" if preset["estimator"] == "none" else preset["estimator"]
    return {**settings, **{name: max(value, preset[name]) for name, value in COARSE.items()},
            "estimator": kind}


def seconds(cycles: list[Path]) -> dict[str, float]:
    """Seconds of finished cycles: FreeFEM's as export_cycles, all others as solve_cycles."""
    spent = [_summary(place)["seconds"] for place in cycles]
    export, own = sum(s["export"] for s in spent), sum(map(_own_seconds, spent))
    return {"export_cycles": export, "solve_cycles": own - export} if cycles else {}


def describe(place: Path) -> str:
    """One line about a finished cycle."""
    row = _row(0, place)
    relative = row["relative"] or 0.0
    error = percent(relative) if relative >= EXACT or not relative else f"<{percent(EXACT)}"
    return (f"{row['primal_dofs']} primal dofs, error in the energy norm {error}, "
            f"{row['seconds']:.2f} s")


def report(work: Path, cycles: list[Path]) -> None:
    """Write adaptivity.csv, a row for every cycle and one for the run itself in `work`."""
    write_table(work / "adaptivity.csv", [_row(k, p) for k, p in enumerate([*cycles, work])])


def _summary(place: Path) -> dict:
    return json.loads((place / "summary.json").read_text())


def _row(cycle: int, place: Path) -> dict:
    summary = _summary(place)
    s, energy = summary["seconds"], summary.get("errors", {}).get("energy", {})
    sizes = {name: summary["sizes"][name] for name in ("subdomains", "primal_dofs")}
    relative = energy["mesh"] / energy["norm"] if energy.get("norm") else None
    return {"cycle": cycle, **sizes, "mesh_error": energy.get("mesh"), "relative": relative,
            "seconds": round(_own_seconds(s), 3), **summary["quantities"]}


def _own_seconds(s: dict) -> float:
    """Seconds of a run without those of the cycles before it."""
    return s["total"] - s.get("export_cycles", 0.0) - s.get("solve_cycles", 0.0)
