"""The slides' table: five sizes of the model example under both loadings, ours beside theirs.

The slides (Haslinger, Vlach, Dostal, SNA'07) state neither steps nor tolerances; 20 steps and 1e-6
are what reproduces the size of their counts. `default` is the driver as it comes, `plain` the
slides' own method: no preconditioner, each step started from the previous one, every QP solved to
the full tolerance and without help from the contact block.
"""

import dataclasses
import json
import os
from pathlib import Path

from .. import options
from ..files import write_json, write_table
from ..options import RESULTS, Settings
from ..report import study as report
from ..runs.guard import study_folder
from ..runs.run import Run, execute
from ..text import aligned

LOADINGS = ("monotone", "nonmonotone")
STAGES = ("export", "setup", "solve")
METHODS = {"default": {}, "plain": {"preconditioner": "none", "predictor": "previous",
                                    "inner_rtol": 1e-9,
                                    "expansion": "gradient", "corrector": "none"}}
ROWS = {1: "4x2", 2: "8x4", 3: "16x8", 4: "32x16", 5: "64x32"}
# as printed: n_s, n_p, n_d, iterations (monotone, nonmonotone), products (monotone, nonmonotone)
SLIDES = {1: (8, 1936, 260, 135, 120, 6515, 5565), 2: (32, 7744, 1096, 136, 121, 8326, 7309),
          3: (128, 30974, 4496, 136, 122, 11423, 9844),
          4: (512, 123904, 18208, 135, 122, 15206, 13237),
          5: (1024, 495616, 73280, 146, 129, 22887, 19659)}
MISPRINTS = ("The slides print n_p = 30974 for 128 subdomains of 242 dofs (30976), and n_s = 1024 "
             "in the last row, whose n_p and n_d belong to 2048.")
KEYS = ("n_s", "n_p", "n_d",
        *(f"{count}_{loading}" for count in ("it", "n_m") for loading in LOADINGS))


def make_table(pairs: dict[str, str]) -> None:
    """Make the rows that are not there yet, then write and print the table and draw it.

    Raises InputError for options that `make table` does not have, and what a run raises.
    """
    from ..figures.table import draw

    given = options.read("table", pairs)
    folder = study_folder(RESULTS / "table", "table")
    for row in sorted(map(int, given["rows"])):
        for method in given["method"]:
            if not given["fresh"] and _finished(folder, method, row):
                print(f"{method}, {ROWS[row]} subdomains: from an earlier run "
                      "(FRESH=yes makes it anew)")
            else:
                _make_row(folder, method, row, pairs)
    rows = (_finished(folder, method, row) for method in METHODS for row in ROWS)
    table = [row for row in rows if row]
    path = write_table(folder / "table.csv", table)
    print(_text(table))
    for path in (path, *draw(path), report.write(folder)):
        print(os.path.relpath(path))


def method_settings(method: str) -> dict:
    """Solver settings of a method: the slides' stopping rules, not the driver's defaults."""
    return {"rtol": 1e-6, "friction_rtol": 1e-6, "primal_rtol": 1.0, **METHODS[method]}


def _row_file(folder: Path, method: str, row: int) -> Path:
    return folder / "rows" / f"{method}-{SLIDES[1][0] * 4 ** (row - 1)}.json"


def _finished(folder: Path, method: str, row: int) -> dict | None:
    """The row's result from an earlier call, if it was made with the same solver settings."""
    try:
        earlier = json.loads(_row_file(folder, method, row).read_text())
    except FileNotFoundError:
        return None
    same = earlier["settings"] == dataclasses.asdict(Settings(**method_settings(method)))
    return earlier["row"] if same else None


def _make_row(folder: Path, method: str, row: int, given: dict[str, str]) -> None:
    """Run both loadings of a row on the ranks `given` and keep what the table needs."""
    summary = {}
    for loading in LOADINGS:
        print(f"{method}, {ROWS[row]} subdomains, {loading}")
        pairs = {"scene": "model", "loading": loading, "subdomains": ROWS[row], "cells": "10",
                 "steps": "20", "fields": "no", "figures": "no", "errors": "no",
                 **options.ranks(given),
                 "out": str(folder / "runs" / f"{method}-{ROWS[row]}-{loading}"),
                 **{name: str(value) for name, value in method_settings(method).items()}}
        summary[loading] = execute(Run.from_pairs(pairs))
    path = _row_file(folder, method, row)
    path.parent.mkdir(parents=True, exist_ok=True)
    settings = dataclasses.asdict(Settings(**method_settings(method)))
    write_json(path, {"settings": settings, "row": _columns(row, method, summary)})


def _columns(row: int, method: str, summary: dict[str, dict]) -> dict:
    """One row of table.csv from the summaries of its two runs."""
    both = [summary[loading] for loading in LOADINGS]
    sizes = both[0]["sizes"]
    ours = (sizes["subdomains"], sizes["primal_dofs"], sizes["dual_dofs"],
            *(s["counts"]["fixed_point_iterations"] for s in both),
            *(s["counts"]["dual_multiplications"] for s in both))
    columns = dict(zip(KEYS, ours))
    columns |= {f"slides_{key}": value for key, value in zip(KEYS, SLIDES[row])}
    for s, loading in zip(both, LOADINGS):
        columns |= {f"seconds_{stage}_{loading}": round(s["seconds"][stage], 3) for stage in STAGES}
    columns |= {f"n_m_setup_{loading}": s["counts"]["dual_multiplications_setup"]
                for s, loading in zip(both, LOADINGS)}
    return columns | {"memory_mib": round(max(s["memory_mib"] for s in both)),
                      "ranks": both[0]["ranks"], "method": method}


def _text(table: list[dict]) -> str:
    """The table to read: counts as ours/slides', times of both loadings added."""
    names = ["method", "n_s", "n_p", "n_d",
             *(f"{count} {loading}" for count in ("it", "n_m") for loading in LOADINGS),
             "export s", "setup s", "solve s", "MiB"]
    lines = [names]
    for row in table:
        counts = [f"{row[key]:,} / {row['slides_' + key]:,}" for key in KEYS[3:]]
        times = [f"{sum(row[f'seconds_{stage}_{loading}'] for loading in LOADINGS):.1f}"
                 for stage in STAGES]
        lines.append([row["method"], *(f"{row[key]:,}" for key in KEYS[:3]), *counts, *times,
                      f"{row['memory_mib']:,}"])
    return (f"\n{aligned(lines)}\n\nit: fixed-point iterations, n_m: products with F, ours / the "
            f"slides'; seconds of both loadings together.\n{MISPRINTS}\n")
