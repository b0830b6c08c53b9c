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
from .case import NO_SOLUTION, Case, Check, compared, refusal, solve

MODULES = ("plane", "friction", "revolution")
COLUMNS = ("case", "quantity", "source", "reference", "value", "error", "tolerance", "met",
           "seconds", "element", "mesh", "claimed", "errors", "because")


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
        names = ", ".join(case.name for case in cases())
        raise InputError(f"no case has '{given['case']}' in its name; there are {names}")
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
    tasks = [(case.name, element) for case in chosen for element in case.elements]
    done = {}
    with ProcessPoolExecutor(min(jobs, len(tasks)),
                             mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(judge, *task, folder): task for task in tasks}
        try:
            for future in as_completed(waiting):
                task = waiting[future]
                done[task] = future.result()
                print(f"[{len(done)}/{len(tasks)}] {_line(done[task][0])}", flush=True)
        except BaseException:  # what waits must not begin
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    parts = [done[task] for task in tasks]
    return [row for rows, _ in parts for row in rows], [row for _, rows in parts for row in rows]


def _line(rows: list[dict]) -> str:
    missed = [row for row in rows if row["met"] == "no"]
    worst = max(rows, key=lambda row: row["error"] / row["tolerance"])
    verdict = "met" if not missed else "MISSED: " + ", ".join(row["quantity"] for row in missed)
    return (f"{rows[0]['case']} {rows[0]['element']}: {verdict} (closest to its tolerance: "
            f"{worst['quantity']}, {worst['error']:.1e} of {worst['tolerance']:.1e}), "
            f"{rows[0]['seconds']:.1f} s")


# ---- one case ------------------------------------------------------------------------------------

def judge(name: str, element: str, folder: Path) -> tuple[list[dict], list[dict]]:
    """Rows of a case with one kind of element, and of its curves. Raises what its runs raise."""
    case = next(case for case in cases() if case.name == name)
    levels = case.levels if element == "P1" else case.levels[:-1] or case.levels
    clock = time.perf_counter()
    views = [solve(case, element, level, folder, level is levels[-1]) for level in levels]
    results = [[check.compare(view) for view in views] for check in case.checks]
    seconds = time.perf_counter() - clock
    mesh = assignments(levels[-1])
    shared = {"case": case.name, "seconds": seconds, "element": element, "mesh": mesh}
    rows = [{**shared, **_row(case, check, on_meshes, views[-1])}
            for check, on_meshes in zip(case.checks, results)]
    rows += [{**shared, **_refused(case, settings, folder)} for settings in case.refused]
    if case.peer and peer.installed():
        rows.append({**shared, **_beside_getfem(case, element, folder)})
    return rows, _curves(case, element, views[-1])


def _row(case: Case, check: Check, results: list[tuple], view) -> dict:
    value, wanted, error = results[-1]
    entry = view.result.summary.get("errors", {}).get("quantities", {}).get(check.quantity, {})
    claimed = entry.get("total")
    return {"quantity": check.name, "source": case.source, "reference": wanted,
            "value": value, "error": error, "tolerance": check.tolerance,
            "met": "yes" if error <= check.tolerance else "no",
            "claimed": "" if claimed is None else claimed / (abs(wanted) or 1.0),
            "errors": " ".join(f"{result[2]:.1e}" for result in results),
            "because": check.because}


def _beside_getfem(case: Case, element: str, folder: Path) -> dict:
    mesh = assignments(case.levels[0])
    difference = compared(case, element, folder)
    return {"quantity": "contact forces of the nodes against GetFEM's", "source": "GetFEM",
            "reference": 0.0, "value": difference, "error": difference, "tolerance": peer.SAME,
            "met": "yes" if difference <= peer.SAME else "no", "claimed": "", "errors": "",
            "mesh": mesh, "because": "the same mesh and conditions at nodes, another program"}


def _refused(case: Case, settings: dict, folder: Path) -> dict:
    status = refusal(case, settings, folder)
    words = assignments(settings)
    return {"quantity": f"exit status with {words}", "source": case.source,
            "reference": NO_SOLUTION, "value": status, "error": float(status != NO_SOLUTION),
            "tolerance": 0.5, "met": "yes" if status == NO_SOLUTION else "no", "claimed": "",
            "errors": "", "because": "there is no equilibrium"}


def _curves(case: Case, element: str, view) -> list[dict]:
    if case.curve is None:
        return []
    kinds = ((element, case.curve.run),)
    if element == case.elements[-1]:
        kinds += (("reference", case.curve.reference),)
    return [{"case": case.name, "x": float(x), "y": float(y), "kind": kind,
             "x_name": case.curve.x, "y_name": case.curve.y}
            for kind, values in kinds for x, y in zip(*values(view))]
