"""make accuracy PART=requests [SCENE=] [OUT=]: whether ACCURACY keeps its word.

Scenes by ACCURACY at 10, 3 and 1 %, for every quantity of their budgets. A request that ends with
status 0 is compared with references as in `coverage`; of one that is refused the reason is kept,
and whether it is consistent: nothing tighter may have been met, and what was reached is worse than
what was asked for. The aims: what is met is true, no refusal contradicts another, no run fails on a
mesh that is too coarse to be solved.
"""

import json
import tempfile
from pathlib import Path

from ...errors import DriverError
from ...runs.run import Run, execute
from ...runs.workspace import unconverged
from ...scene import freefem
from ...text import percent, words
from . import coverage
from .coverage import Case
from .prices import settings_of

ASKED = (0.1, 0.03, 0.01)
SCENES = ("model", "model-static", "model-tresca", "cohesion", "hertz", "mindlin", "hertz-bodies",
          "joint", "stack", "wedge", "punch", "tutorial", "pressfit", "cantilever")
COLUMNS = ("scene", "quantity", "asked", "status", "reached", "true", "uncertainty", "right",
           "seconds", "settings", "reason")


def run_requests(out: Path, scene: str | None) -> list[Path]:
    """Run all requests, or those of `scene`; make the table in `out`.

    Raises InputError if there is no such scene, or nothing that sets its mesh size.
    """
    cases = coverage.of_each(SCENES, scene, out)
    table = out / "requests.csv"
    for row in coverage.judged(cases, judge, describe, table, COLUMNS):
        if row["right"] == "no":
            print(f"  {row['scene']} {words(row['quantity'])} to {percent(row['asked'])}: "
                  f"{row['reason'] or 'true error ' + percent(row['true'])}")
    return [table]


def judge(case: Case, out: Path) -> list[dict]:
    """Rows of the table: every quantity of a scene at every accuracy."""
    (finer, finest), rows = coverage.references(case, out), []
    for name in coverage.summary_of(case, settings_of(case), out).get("quantities", {}):
        reference = case.exact.get(name, finest[name])
        apart = 0.0 if name in case.exact else abs(finest[name] - finer[name])
        own = [_request(case, name, asked, out) for asked in ASKED]
        for row in own:
            row["uncertainty"] = apart / abs(reference) if reference else ""
            value = row.pop("value", None)
            if value is not None and reference:
                row["true"] = abs(value / reference - 1)
            row["right"] = _right(row, own)
        rows += own
    return rows


def _right(row: dict, rows: list[dict]) -> str:
    """Whether a request was met in truth, or its refusal is consistent with the other `rows`.

    Empty where the reference is too coarse to tell.
    """
    if row["status"] == 0:
        if "true" not in row:
            return ""
        if abs(row["true"] - row["asked"]) <= row["uncertainty"]:
            return ""
        return "yes" if row["true"] <= row["asked"] else "no"
    tighter = [other for other in rows if other["asked"] < row["asked"] and other["status"] == 0]
    better = row["reached"] is not None and row["reached"] <= row["asked"]
    return "no" if tighter or better or row["status"] not in (3, 4) else "yes"


def _request(case: Case, name: str, asked: float, out: Path) -> dict:
    """One request: what came of it."""
    row = {"scene": case.scene, "quantity": name, "asked": asked, "status": 0, "reason": ""}
    with tempfile.TemporaryDirectory(prefix=".run.", dir=out) as folder:
        place = Path(folder) / "run"
        pairs = {key: str(value) for key, value in case.common.items()}
        try:
            execute(Run.from_pairs({
                "figures": "no", "fields": "no", "quiet": "yes", **pairs, "out": str(place),
                "scene": str(freefem.find_scene(case.scene)), "accuracy": f"{asked},{name}"}))
        except DriverError as refusal:
            row |= {"status": refusal.exit_status, "reason": str(refusal).split("; partial")[0]}
        kept = [p / "summary.json" for p in (place, unconverged(place))]
        summary = next((json.loads(p.read_text()) for p in kept if p.exists()), {})
    found = summary.get("accuracy", {})
    settings = " ".join(f"{key}={value}" for key, value in found.get("settings", {}).items())
    row |= {"reached": found.get("reached"), "settings": settings,
            "seconds": summary.get("seconds", {}).get("total")}
    return row | ({"value": summary["quantities"][name]} if summary else {})


def describe(rows: list[dict]) -> str:
    """How many requests were met or refused rightly, in a sentence."""
    met = [row for row in rows if row["status"] == 0]
    judged = [row for row in met if row["right"]]
    refused = [row for row in rows if row["status"]]
    return (f"{len(rows)} requests, {len(met)} met, in truth {_count(judged)} of {len(judged)}; "
            f"{len(refused)} refused, consistently {_count(refused)}")


def _count(rows: list[dict]) -> int:
    return sum(row["right"] == "yes" for row in rows)
