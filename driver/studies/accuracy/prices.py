"""make accuracy PART=prices [SCENE=] [OUT=]: whether the prices of accuracy hold.

Runs of shipped scenes end with a price list (estimates/prices.py). Here its lines are run, all
that are to take up to LONG seconds: seconds and memory against the predicted ones, and the true
error, against references as in `coverage`, with the accuracy that the line is for. The aims:
seconds within a factor of two, and 95 of 100 accuracies met.
"""

import math
import tempfile
from pathlib import Path

from ...runs.own_process import BARE, run_alone
from ...text import assignments, percent, words
from . import coverage
from .coverage import Case

LONG = 60.0  # predicted seconds of lines that are run
FACTOR = 2.0
RUNS = {"model": {"cells": 10, "steps": 20}, "model-tresca": {"cells": 8, "steps": 20},
        "model-static": {"cells": 10}, "cohesion": {"cells": 8, "steps": 10}, "hertz": {"h": 0.002},
        "mindlin": {"h": 0.002, "steps": 20}, "hertz-bodies": {"h": 0.004},
        "joint": {"h": 1.6, "steps": 20}, "stack": {"h": 0.1, "steps": 5},
        "wedge": {"h": 2, "steps": 10}, "punch": {"h": 0.05, "steps": 10},
        "bracket": {"h": 8, "steps": 10}, "tutorial": {"h": 1.5, "steps": 20},
        "pressfit": {"h": 1}, "cantilever": {"cells": 8}}
COLUMNS = ("scene", "setting", "quantity", "accuracy", "kind", "price", "seconds_predicted",
           "seconds", "bare_predicted", "bare", "memory_predicted", "memory", "true", "uncertainty",
           "claimed", "met", "within")


def run_prices(out: Path, scene: str | None) -> list[Path]:
    """Run the lines of all scenes' lists, or of `scene`; table and picture in `out`.

    Raises InputError if there is no such scene, or nothing that sets its mesh size.
    """
    from ...figures.prices import draw

    cases = coverage.of_each(RUNS, scene, out)
    table = out / "prices.csv"
    for row in coverage.judged(cases, judge, describe, table, COLUMNS):
        if "no" in (row["met"], row["within"]):
            print(f"  {row['scene']} {row['price']}: {words(row['quantity'])} to "
                  f"{percent(row['accuracy'])}, true {percent(row['true'])}, "
                  f"{row['seconds_predicted']:.2g} s predicted, {row['seconds']:.2g} s taken")
    return [table, *draw(table)]


def settings_of(case: Case) -> dict:
    """Settings of the run that a case starts from: of scenes without any their own mesh size."""
    return RUNS[case.scene] if case.scene in RUNS else case.runs[0]


def judge(case: Case, out: Path) -> list[dict]:
    """Rows of the table: the lines of one run's list, each setting run once."""
    settings = case.common | settings_of(case)
    prices = _run(settings | {"scene": case.scene}, out).get("errors", {}).get("prices")
    if not prices or not prices["lines"]:
        print(f"  {case.scene}: {prices and prices['reason']}")
        return []
    name, done = prices["quantity"], {}
    finer, finest = (values[name] for values in coverage.references(case, out))
    reference = case.exact.get(name, finest)
    uncertainty = 0.0 if name in case.exact else abs(finest - finer) / abs(reference)
    label = assignments(settings)
    rows = []
    for line in prices["lines"]:
        if "settings" not in line or line["seconds"] > LONG:
            continue
        price = assignments(line["settings"])
        if price not in done:
            chosen = {key.lower(): value for key, value in line["settings"].items()}
            done[price] = _run(case.common | chosen | {"scene": case.scene}, out)
        if not done[price]:
            continue
        rows.append({"scene": case.scene, "setting": label, "quantity": name, "price": price,
                     "accuracy": line["accuracy"], "kind": line["kind"],
                     "uncertainty": uncertainty, **_verdict(line, done[price], name, reference,
                                                            uncertainty)})
    return rows


def _run(options: dict, out: Path) -> dict:
    """Summary of a run by itself, as a user starts it; empty if it failed."""
    with tempfile.TemporaryDirectory(prefix=".run.", dir=out) as folder:
        status, answer = run_alone(options | BARE | {"out": Path(folder) / "run"})
    if status:
        print(f"  {assignments(options)}: {answer}", flush=True)
        return {}
    return answer


def _verdict(line: dict, summary: dict, name: str, reference: float, uncertainty: float) -> dict:
    """What a line's run took and missed; `met` is empty where the reference is too coarse."""
    spent = summary["seconds"]
    true = abs(summary["quantities"][name] - reference) / abs(reference)
    claimed = summary.get("errors", {}).get("quantities", {}).get(name, {}).get("relative")
    met = "yes" if true <= line["accuracy"] else "no"
    if abs(true - line["accuracy"]) <= uncertainty:
        met = ""
    ratio = spent["total"] / line["seconds"]
    return {"seconds_predicted": line["seconds"], "seconds": spent["total"],
            "bare_predicted": line["seconds_bare"],
            "bare": spent["total"] - spent.get("estimates", 0.0),
            "memory_predicted": line["memory_mib"], "memory": summary["memory_mib"],
            "true": true, "claimed": claimed, "met": met,
            "within": "yes" if 1 / FACTOR <= ratio <= FACTOR else "no"}


def describe(rows: list[dict]) -> str:
    """How many lines hold, in a sentence."""
    if not rows:
        return "no line to run"
    judged = [row for row in rows if row["met"]]
    met = sum(row["met"] == "yes" for row in judged)
    within = sum(row["within"] == "yes" for row in rows)
    ratio = math.exp(sum(math.log(row["seconds"] / row["seconds_predicted"]) for row in rows)
                     / len(rows))
    return (f"{len(rows)} lines, {met} of {len(judged)} accuracies met, seconds of {within} within "
            f"a factor of {FACTOR:g}, taken over predicted {ratio:.2f} in the mean")
