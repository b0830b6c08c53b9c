"""The seconds of a summary: stages that follow the solution are counted, and all are told."""

import json
import time
from pathlib import Path

from ..files import write_json

LITTLE = 0.02  # of the total: stages below it together go without a word
# what stands in the line, and the entries of the summary that it is the sum of
STAGES = {"refinement": ("export_cycles", "solve_cycles"), "FreeFEM": ("export",),
          "setup": ("read", "setup"), "condensation": ("condense",), "solve": ("solve",),
          "contact geometry": ("geometry",), "other solutions": ("uniqueness",),
          "output": ("output",), "error estimates": ("estimates",), "figures": ("figures",),
          "start": ("start",)}


def count(work: Path, stage: str, spent: float) -> None:
    """Add the seconds of a stage after the solution to the summary: the user waits for it, too."""
    summary = json.loads((work / "summary.json").read_text())
    total = summary["seconds"].pop("total") + spent
    summary["seconds"] |= {stage: summary["seconds"].get(stage, 0.0) + spent, "total": total}
    write_json(work / "summary.json", summary)


def count_rest(work: Path, since: float) -> None:
    """Count what no stage does: programs, packages and ranks take time to start.

    Seconds before an interruption are among those of the stages, and more than those `since` a
    time.perf_counter().
    """
    stages = json.loads((work / "summary.json").read_text())["seconds"]["total"]
    count(work, "start", max(0.0, time.perf_counter() - since - stages))


def words(seconds: dict) -> str:
    """The seconds of the stages in words."""
    spent = {title: sum(seconds.get(name, 0.0) for name in names)
             for title, names in STAGES.items() if any(name in seconds for name in names)}
    other = seconds["total"] - sum(spent.values())
    if other >= LITTLE * seconds["total"]:
        spent["other"] = other
    parts = [f"{title} {value:.2f}" for title, value in spent.items()]
    return f"{seconds['total']:.2f} s ({', '.join(parts)})"
