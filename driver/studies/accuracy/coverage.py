"""make accuracy PART=coverage [SCENE=] [OUT=]: whether claimed errors hold, over many runs.

Runs of shipped scenes and of published cases, coarse to fine, with linear and quadratic elements,
adaptive meshes, many and few steps and by ACCURACY; of any other scene by its path at its own mesh
size, at twice that and there with quadratic elements. What each claims of every quantity is
compared with the error that it truly has: against a closed form, or against the finest of runs that
are much finer, whose distance from the finer of them is their uncertainty. A claim is judged where
the reference is better than half of the claim and of the error. The aims: 95 of 100 claims hold,
none is below half of the true error, the median of claim over truth is 4 at most.
"""

import math
import statistics
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from ...errors import DriverError, InputError, NotConverged
from ...estimates.budget import coarser, finer, mesh_knob, vanishing
from ...files import write_table
from ...runs.run import Run, execute
from ...scene import freefem
from ...text import assignments, percent, words

TIGHT = {"rtol": "1e-9", "friction_rtol": "1e-8", "primal_rtol": "1e-7", "uniqueness": "no",
         "errors": "no"}
# relative: smaller errors and claims are those of tolerances, which agree, as of forces that loads
# give; the screen says less than 0.001 % of them
NOTHING = 1e-5
COLUMNS = ("scene", "setting", "quantity", "value", "claimed", "true", "ratio", "judged", "held",
           "reference", "uncertainty", "source", "mesh", "time", "friction", "solver")


@dataclass(frozen=True)
class Case:
    """Settings of runs of a scene, and of the reference runs, the finest last.

    `common` settings belong to all of them; `exact` are closed forms of quantities.
    """

    scene: str
    runs: tuple
    references: tuple
    common: dict = field(default_factory=dict)
    exact: dict = field(default_factory=dict)


def _by(name: str, *values, **more) -> tuple:
    return tuple({name: value, **more} for value in values)


MODEL = (*_by("cells", 3, steps=5), {"cells": 6, "steps": 20}, {"cells": 6, "steps": 1},
         {"cells": 5, "element": "P2", "steps": 10}, {"cells": 4, "adapt": 2, "steps": 10},
         {"accuracy": "3%"}, {"accuracy": "3%,dissipated_energy"})
FINE = ({"cells": 32}, {"cells": 64})
LAME = 210e3 / 1.3 * 0.05 / (0.4 * 20 / 35**2 + 1 / 20) * (1 / 20**2 - 1 / 35**2)
CASES = (
    Case("model", MODEL, ({"cells": 24, "steps": 40}, {"cells": 48, "steps": 80}),
         {"loading": "nonmonotone"}),
    Case("model", MODEL[:5], ({"cells": 32, "steps": 1}, {"cells": 64, "steps": 1}),
         {"loading": "monotone"}),
    Case("model-static", _by("cells", 4, 10), FINE),
    Case("model-tresca", ({"cells": 4, "steps": 5}, {"cells": 8, "steps": 20}),
         ({"cells": 20, "steps": 40}, {"cells": 40, "steps": 40})),
    Case("model-frictionless", _by("cells", 4, 8, steps=4),
         ({"cells": 32, "steps": 4}, {"cells": 64, "steps": 4})),
    Case("cohesion", ({"cells": 4}, {"cells": 8, "steps": 10}),
         ({"cells": 24, "steps": 40}, {"cells": 48, "steps": 80})),
    Case("hertz", (*_by("h", 0.008, 0.004, 0.002), {"h": 0.004, "element": "P2"},
                   {"h": 0.008, "adapt": 2}), _by("h", 0.0007, 0.00035)),
    Case("mindlin", ({"h": 0.004, "steps": 10}, {"h": 0.002, "steps": 20},
                     {"h": 0.004, "steps": 15}),
         ({"h": 0.0007, "steps": 20}, {"h": 0.0005, "steps": 40})),
    Case("hertz-bodies", _by("h", 0.008, 0.004), _by("h", 0.001, 0.0005)),
    # quadratic references: plates of linear elements bend 3 % too little at h = 0.27
    Case("joint", ({"h": 1.6, "steps": 10}, {"h": 0.8, "steps": 20}, {"h": 3.2, "steps": 5}),
         ({"h": 0.8, "element": "P2", "steps": 160}, {"h": 0.55, "element": "P2", "steps": 320})),
    Case("stack", (*_by("h", 0.2, 0.1, steps=5), {"h": 0.2, "element": "P2", "steps": 5}),
         ({"h": 0.03, "steps": 10}, {"h": 0.02, "steps": 20})),
    Case("mindlin-bodies", _by("h", 0.15, 0.075, steps=5),
         ({"h": 0.03, "steps": 10}, {"h": 0.02, "steps": 20})),
    Case("wedge", _by("h", 4, 2, steps=5), ({"h": 0.5, "steps": 10}, {"h": 0.3, "steps": 20})),
    Case("pin", _by("h", 2, 1), _by("h", 0.2, 0.12)),
    Case("punch", ({"h": 0.1, "steps": 5}, {"h": 0.05, "steps": 10}),
         ({"h": 0.02, "steps": 20}, {"h": 0.012, "steps": 40})),
    Case("bracket", ({"h": 12, "steps": 5}, {"h": 8, "steps": 10},
                     {"h": 12, "element": "P2", "steps": 10}),
         ({"h": 3, "steps": 10}, {"h": 2, "steps": 20})),
    Case("tutorial", ({"h": 3, "steps": 10}, {"h": 1.5, "steps": 20},
                      {"h": 3, "element": "P2", "steps": 10}),
         ({"h": 0.6, "steps": 20}, {"h": 0.4, "steps": 40})),
    Case("cantilever", (*_by("cells", 4, 8, 16), {"cells": 4, "element": "P2"},
                        {"accuracy": "3%"}), FINE,
         exact={"displacement": math.hypot(0.0025 * math.sin(2.6), 0.02)}),
    Case("pressfit", (*_by("h", 4, 2, 1), {"h": 4, "adapt": 2}), _by("h", 0.4, 0.2),
         exact={"peak_pressure": LAME, "normal_resultant": LAME * 10 * math.pi,
                "contact_length": 10 * math.pi}),
    Case("zones", ({"cells": 4, "steps": 4}, {"cells": 8, "steps": 2},
                   {"cells": 4, "element": "P2", "steps": 4}),
         ({"cells": 40, "steps": 2}, {"cells": 80, "steps": 2})),
    Case("o-ring", ({"h": 0.12, "steps": 5}, {"h": 0.06, "steps": 10}),
         ({"h": 0.025, "steps": 10}, {"h": 0.017, "steps": 20})),
    Case("verify/wavy", (*_by("h", 0.04, 0.02), {"h": 0.04, "element": "P2"}),
         _by("h", 0.005, 0.003)),
    Case("verify/indenter", (*_by("h", 0.08, 0.04), {"h": 0.08, "element": "P2"}),
         _by("h", 0.01, 0.006)),
    # shear of linear elements is of first order here: 9 % off at h = 1
    # quadratic references: with linear elements the shear is still 3 % off at h = 0.2
    Case("verify/cylinder-on-block", (*_by("h", 2, 1), {"h": 2, "element": "P2"}),
         _by("h", 0.6, 0.4, element="P2")),
    Case("verify/rings", _by("h", 0.08, 0.04), _by("h", 0.01, 0.006)),
    Case("verify/shrinkfit", _by("h", 4, 2), _by("h", 0.6, 0.4)),
    Case("hard/block", ({"cells": 4, "steps": 4}, {"cells": 8, "steps": 8}),
         ({"cells": 16, "steps": 10}, {"cells": 32, "steps": 20})),
    Case("hard/cycles", ({"cells": 3, "steps": 20}, {"cells": 6, "steps": 40}),
         ({"cells": 12, "steps": 80}, {"cells": 24, "steps": 80})),
)

EXACT = {case.scene: case.exact for case in CASES if case.exact}  # closed forms by scene


def run_coverage(out: Path, scene: str | None) -> list[Path]:
    """Run all cases, or those of `scene`; make and draw the table in `out`; returns the files.

    Raises InputError for a scene that is not there or has no mesh size to be changed.
    """
    from ...figures.coverage import draw

    cases, table = chosen(CASES, scene, out), out / "coverage.csv"
    for row in judged(cases, judge, describe, table, COLUMNS):
        if row["held"] == "no":
            print(f"  {row['scene']} {row['setting']}: {words(row['quantity'])} claimed "
                  f"{percent(row['claimed'])}, true {percent(row['true'])}")
    return [table, *draw(table)]


def judged(cases: list[Case], judge_case, describe_rows, table: Path, columns) -> list[dict]:
    """Rows of `judge_case`(case, directory) of all cases, in `table` from the first case on.

    What `describe_rows`(rows) says of each case and of all is printed.
    """
    rows = []
    for number, case in enumerate(cases, 1):
        own = judge_case(case, table.parent)
        rows += own
        print(f"[{number}/{len(cases)}] {case.scene}: {describe_rows(own)}", flush=True)
        write_table(table, rows, columns)
    print(f"all: {describe_rows(rows)}")
    return rows


def references(case: Case, out: Path) -> tuple[dict, dict]:
    """Quantities of the last two reference runs of a case. Raises NotConverged where they fail."""
    fine = [_values(case, settings | TIGHT, out)[0] for settings in case.references]
    fine = [values for values in fine if values]
    if len(fine) < 2:
        raise NotConverged(f"{case.scene}: there are no two reference runs to compare with")
    return fine[-2], fine[-1]


def of_any(scene: str, out: Path) -> Case:
    """The case of a scene that is not in the table: by its own mesh size and steps.

    References have three and six times the steps, of which some end wherever histories turn at a
    half, a third or a quarter. Raises InputError if there is no such scene or it cannot be solved.
    """
    freefem.find_scene(scene)
    summary = summary_of(Case(scene, (), ()), {"errors": "no"}, out)
    if not summary:
        raise InputError(f"{scene}: it cannot be solved on its own mesh")
    given, steps = summary["parameters"], summary.get("steps", 1)
    knob = mesh_knob(given)
    coarse = coarser(knob, given[knob]) or given[knob]
    fine = [finer(knob, given[knob], factor) for factor in (2, 3)]  # linear ones err too long
    references = [{knob: size, "element": "P2", **({"steps": more * steps} if steps > 1 else {})}
                  for size, more in zip(fine, (3, 6))]
    return Case(scene, ({knob: given[knob]}, {knob: coarse}, {knob: coarse, "element": "P2"}),
                tuple(references))


def of_each(scenes, scene: str | None, out: Path) -> list[Case]:
    """A case of each of `scenes`, or that of `scene`, see `chosen`."""
    first = {case.scene: case for case in reversed(CASES) if case.scene in scenes}
    return chosen(list(first.values())[::-1], scene, out)


def chosen(cases, scene: str | None, out: Path) -> list[Case]:
    """All cases, or those of a scene, which is not among them perhaps: see `of_any`."""
    return [case for case in cases if scene in (None, case.scene)] or [of_any(scene, out)]


def judge(case: Case, out: Path) -> list[dict]:
    """Rows of the table of a case's runs."""
    (finer, finest), rows = references(case, out), []
    for settings in case.runs:
        _, errors = _values(case, {"quiet": "yes", **settings}, out)
        label = assignments(case.common | settings)
        zero = vanishing({name: entry["value"] for name, entry in errors.items()},
                         {name: entry["total"] for name, entry in errors.items()})
        for name, entry in errors.items():
            reference, uncertainty = finest[name], abs(finest[name] - finer[name])
            if name in case.exact:
                reference, uncertainty = case.exact[name], 0.0
            source = "closed form" if name in case.exact else "finer runs"
            parts = {part: entry.get(part) for part in ("mesh", "time", "friction", "solver")}
            rows.append({"scene": case.scene, "setting": label, "quantity": name,
                         "value": entry["value"], "reference": reference, "source": source,
                         **_verdict(entry, reference, uncertainty, name in zero), **parts})
    return rows


def _verdict(entry: dict, reference: float, uncertainty: float, zero: bool) -> dict:
    """Claimed and true error, relative to the reference, and whether the claim holds."""
    size = abs(reference) or 1.0
    true, uncertainty = abs(entry["value"] - reference) / size, uncertainty / size
    row = {"true": true, "uncertainty": uncertainty, "judged": "no", "held": ""}
    if entry["total"] is None or zero:
        return row
    claimed = entry["total"] / size
    row |= {"claimed": claimed, "ratio": claimed / true if true > 0 else ""}
    if max(claimed, true) < NOTHING:
        return row
    sure = uncertainty <= 0.5 * max(claimed, true)
    if sure:
        row |= {"judged": "yes", "held": "yes" if claimed + uncertainty >= true else "no"}
    return row


def _values(case: Case, settings: dict, out: Path) -> tuple[dict, dict]:
    """Quantities of a run and the budget of their errors; empty if it failed."""
    summary = summary_of(case, settings, out)
    return summary.get("quantities", {}), summary.get("errors", {}).get("quantities", {})


def summary_of(case: Case, settings: dict, out: Path) -> dict:
    """Summary of a run with settings beside those of all runs of a case; empty if it failed."""
    pairs = {name: str(value) for name, value in (case.common | settings).items()}
    with tempfile.TemporaryDirectory(prefix=".run.", dir=out) as folder:
        try:
            return execute(Run.from_pairs({
                "figures": "no", "fields": "no", "quiet": "yes", **pairs,
                "scene": str(freefem.find_scene(case.scene)), "out": f"{folder}/run"}))
        except DriverError as problem:
            print(f"  {case.scene} {pairs}: {problem}", flush=True)
            return {}


def describe(rows: list[dict]) -> str:
    """How many claims hold, in a sentence."""
    count, held, half, median = totals(rows)
    if not count:
        return "nothing to judge"
    middle = "" if median is None else f", median of claim over truth {median:.2f}"
    return f"{count} claims, {held:.1f} % hold, {half} below half of the true error{middle}"


def totals(rows: list[dict]) -> tuple[int, float, int, float | None]:
    """Claims that could be judged, per cent that hold, claims below half of the true error, median
    of claim over truth (None where all of it is zero); of rows as made here or as read from a file.
    """
    judged = [row for row in rows if row["judged"] == "yes"]
    held = sum(row["held"] == "yes" for row in judged)
    ratio = [float(row["ratio"]) for row in judged if row["ratio"] != ""]
    half = sum(row["held"] == "no" and float(row["ratio"]) < 0.5 for row in judged)
    return (len(judged), 100 * held / max(1, len(judged)), half,
            statistics.median(ratio) if ratio else None)
