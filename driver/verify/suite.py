"""make verify: all cases with both elements on all their meshes, a table and a page of pictures."""

import importlib
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from .. import options
from ..errors import DriverError, InputError
from ..files import write_table
from ..runs.guard import study_folder
from ..text import assignments
from . import peer
from .case import NO_SOLUTION, Case, Check, compared, refusal, size_effects, solve

MODULES = ("plane", "friction", "revolution", "surfaces", "cycles")
COLUMNS = ("case", "quantity", "source", "reference", "value", "error", "tolerance", "met",
           "seconds", "element", "mesh", "claimed", "errors", "remaining", "size_effect", "ratio",
           "size_order", "size_ratios", "size_deviations", "because")


def cases() -> list[Case]:
    """All cases in the order of the page."""
    modules = [importlib.import_module(f"{__package__}.{name}") for name in MODULES]
    return [case for module in modules for case in module.CASES]


def run_suite(pairs: dict[str, str]) -> list[Path]:
    """Run the cases asked for; the paths of the table and of the pictures.

    Raises InputError for options that `make verify` does not have or that exclude one another, and
    for cases that do not exist; DriverError if a number misses its reference by more than its
    tolerance.
    """
    given = options.read("verify", pairs)
    chosen = [case for case in cases()
              if given["case"] in case.name and (case.fast or not given["fast"])]
    if not chosen:
        names = ", ".join(case.name for case in cases() if case.fast or not given["fast"])
        fast = " fast" if given["fast"] else ""
        raise InputError(f"no{fast} case has '{given['case']}' in its name; there are {names}")
    if given["page"] and (given["case"] or given["fast"]):
        raise InputError("PAGE=yes shows all cases: leave out CASE and FAST")
    folder, clock = study_folder(given["out"], "verify"), time.perf_counter()
    rows, curves = judged(chosen, folder, given["jobs"])
    table = write_table(folder / "report.csv", rows, COLUMNS)
    from ..figures.verify import draw

    made = [table, write_table(folder / "curves.csv", curves, ("kind", "case", "x", "y", "x_name",
                                                              "y_name"))]
    made += draw(folder / "curves.csv")
    if not peer.installed():
        print(peer.NOTE)
    orders = []
    if not given["case"] and not given["fast"]:
        from . import rates

        orders = rates.measured(folder)
        made.append(write_table(folder / "rates.csv", orders, rates.COLUMNS))
    if given["page"]:
        from . import page

        print(f"renewed {os.path.relpath(page.write(chosen, rows, orders, made))}")
    missed = [row for row in rows if row["met"] == "no"]
    print(f"{len(chosen)} cases, {len(rows)} numbers, {len(rows) - len(missed)} met; "
          f"{time.perf_counter() - clock:.0f} s")
    if missed:
        raise DriverError(f"{len(missed)} numbers miss their references, see "
                          f"{os.path.relpath(table)}")
    return made


def judged(chosen: list[Case], folder: Path, jobs: int) -> tuple[list[dict], list[dict]]:
    """Rows of the table and of the curves of all cases, in their order."""
    done = {}
    with ProcessPoolExecutor(min(jobs, len(chosen)),
                             mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(judge, case.name, case.elements, folder): case.name
                   for case in chosen}
        try:
            for future in as_completed(waiting):
                name = waiting[future]
                done[name] = future.result()
                print(f"[{len(done)}/{len(chosen)}] {_line(done[name][0])}", flush=True)
        except BaseException:  # what waits must not begin
            pool.shutdown(cancel_futures=True)
            raise
    parts = [done[case.name] for case in chosen]
    return [row for rows, _ in parts for row in rows], [row for _, rows in parts for row in rows]


def _line(rows: list[dict]) -> str:
    missed = [f"{row['quantity']} ({row['element']})" for row in rows if row["met"] == "no"]
    worst = max(rows, key=lambda row: row["remaining"] / row["tolerance"])
    verdict = "met" if not missed else "MISSED: " + ", ".join(missed)
    return (f"{rows[0]['case']}: {verdict} (closest to its tolerance: {worst['quantity']}, "
            f"{worst['remaining']:.1e} of {worst['tolerance']:.1e}), "
            f"{sum({row['element']: row['seconds'] for row in rows}.values()):.1f} s")


# ---- one case ------------------------------------------------------------------------------------

def judge(name: str, elements: tuple[str, ...], folder: Path) -> tuple[list[dict], list[dict]]:
    """Rows of a case with some kinds of element, and of its curves. Raises what its runs raise."""
    case = next(case for case in cases() if case.name == name)
    effects = size_effects(case, folder)
    parts = [_judge(case, element, effects, folder) for element in elements]
    return [row for rows, _ in parts for row in rows], [row for _, rows in parts for row in rows]


def _judge(case: Case, element: str, effects: dict, folder: Path) -> tuple[list, list]:
    levels = case.levels if element == "P1" else case.levels[:-1] or case.levels
    clock = time.perf_counter()
    views = [solve(case, element, level, folder, level is levels[-1]) for level in levels]
    results = [[check.compare(view) for view in views] for check in case.checks]
    seconds = time.perf_counter() - clock
    shared = {"case": case.name, "seconds": seconds, "element": element,
              "mesh": assignments(levels[-1])}
    rows = [{**shared, **_row(case, check, on_meshes, views[-1], effects.get(check.name))}
            for check, on_meshes in zip(case.checks, results)]
    rows += [{**shared, **_refused(case, settings, folder)} for settings in case.refused]
    if case.peer and peer.installed():
        rows.append({**shared, **_beside_getfem(case, element, folder, rows)})
    return rows, _curves(case, element, views[-1])


def _row(case: Case, check: Check, results: list[tuple], view, effect) -> dict:
    value, wanted, deviation = results[-1]
    entry = view.result.summary.get("errors", {}).get("quantities", {}).get(check.quantity, {})
    claimed = entry.get("total")
    remaining, size = abs(deviation), {}
    if effect is not None:
        ratio = case.sizes.ratio(view)
        remaining = effect.remaining(deviation, ratio)
        size = {"size_effect": effect.of(ratio), "ratio": ratio, "size_order": effect.order,
                "size_ratios": " ".join(f"{r:.2g}" for r in effect.ratios),
                "size_deviations": " ".join(f"{d:.1e}" for d in effect.deviations)}
    return {"quantity": check.name, "source": case.source, "reference": wanted,
            "value": value, "error": abs(deviation), "remaining": remaining, **size,
            "tolerance": check.tolerance, "met": "yes" if remaining <= check.tolerance else "no",
            "claimed": "" if claimed is None else claimed / (abs(wanted) or 1.0),
            "errors": " ".join(f"{abs(result[2]):.1e}" for result in results),
            "because": check.because}


def _beside_getfem(case: Case, element: str, folder: Path, rows: list[dict]) -> dict:
    mesh, difference = assignments(case.levels[0]), compared(case, element, folder)
    own = float(rows[0]["errors"].split()[0])
    return {"quantity": "contact forces of the nodes against GetFEM's", "source": "GetFEM",
            "reference": 0.0, "value": difference, "error": difference, "remaining": difference,
            "tolerance": peer.SAME, "met": "yes" if difference <= peer.SAME else "no",
            "claimed": "", "errors": "", "mesh": mesh,
            "because": "the same mesh and conditions at nodes, another program; "
                       f"{rows[0]['quantity'].replace('_', ' ')} errs by {own:.1e} on this mesh"}


def _refused(case: Case, settings: dict, folder: Path) -> dict:
    status = refusal(case, settings, folder)
    words = assignments(settings)
    return {"quantity": f"exit status with {words}", "source": case.source,
            "reference": NO_SOLUTION, "value": status, "error": float(status != NO_SOLUTION),
            "remaining": float(status != NO_SOLUTION), "tolerance": 0.5,
            "met": "yes" if status == NO_SOLUTION else "no", "claimed": "", "errors": "",
            "because": "there is no equilibrium"}


def _curves(case: Case, element: str, view) -> list[dict]:
    if case.curve is None:
        return []
    kinds = ((element, case.curve.run),)
    if element == case.elements[-1]:
        kinds += (("reference", case.curve.reference),)
    return [{"case": case.name, "x": float(x), "y": float(y), "kind": kind,
             "x_name": case.curve.x, "y_name": case.curve.y}
            for kind, values in kinds for x, y in zip(*values(view))]
