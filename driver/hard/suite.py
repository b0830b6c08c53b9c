"""All hard cases at all sizes: run, judge, report.csv, pictures."""

import hashlib
import importlib
import multiprocessing
import os
import re
import shutil
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import environment, options
from ..errors import DriverError, InputError
from ..processes import die_of_signals
from ..runs.guard import study_folder
from . import random
from .case import Case, Outcome, reference, run_case
from .dense import OracleFailure
from .report import Row, line, write

FAMILIES = options.find("hard", "family").kind.choices


def cases(family: str | None = None) -> list[Case]:
    """All cases, or those of one family."""
    names = (family,) if family else FAMILIES
    modules = {name: importlib.import_module(f"{__package__}.{name}") for name in names}
    return [replace(case, family=name) for name, module in modules.items() for case in module.CASES]


def run_suite(pairs: dict[str, str]) -> list[Path]:
    """Run the cases asked for; the paths of report and pictures.

    Raises InputError for options that `make hard` does not have, and DriverError if a case ends in
    neither of the two ways. An interrupt leaves the rows that there are, and says how to go on.
    """
    tasks, folder, jobs = _chosen(pairs)
    folder = study_folder(folder, "hard")
    for earlier in ("runs", random.KEPT):
        shutil.rmtree(folder / earlier, ignore_errors=True)
    rows, clock = [], time.perf_counter()
    try:
        for row in _judged(tasks, folder, jobs):
            rows.append(row)
            print(line(row), flush=True)
    except KeyboardInterrupt as stop:
        raise KeyboardInterrupt(_rest(rows, tasks, folder)) from stop
    finally:
        shutil.rmtree(folder / "runs", ignore_errors=True)
        if rows:
            write(folder / "report.csv", rows)
    from ..figures.hard import draw

    made = [folder / "report.csv", *draw(folder / "report.csv")]
    failed = [row for row in rows if row.status == "FAILED"]
    print(f"{_summary(rows)}; {time.perf_counter() - clock:.0f} s")
    if failed:
        raise DriverError(
            f"{len(failed)} hard cases failed, see {os.path.relpath(folder / 'report.csv')}")
    return made


def _rest(rows: list[Row], tasks: list, folder: Path) -> str:
    """What an interrupted suite has done, and how random scenes go on."""
    said = f"; {len(rows)} of {len(tasks)} rows are in {os.path.relpath(folder / 'report.csv')}"
    left = tasks[len(rows) :]
    if left and all(case == random.FAMILY for case, _ in left):
        said += f"; FAMILY=random SEED={left[0][1]} COUNT={len(left)} goes on, with another OUT"
    return said


def _summary(rows: list[Row]) -> str:
    """How many cases and random scenes ended how."""
    drawn = [row for row in rows if row.family == random.FAMILY]
    parts = []
    for some, what in (([row for row in rows if row.family != random.FAMILY], "cases"),
                       (drawn, "random scenes")):
        ended = {name: sum(row.status == name for row in some)
                 for name in ("solved", "refused", "FAILED")}
        sizes = "" if some is drawn else f" at {len(some)} sizes"
        if some:
            parts.append(f"{len({row.case for row in some})} {what}{sizes}: {ended['solved']} "
                         f"solved and checked, {ended['refused']} refused as they must be, "
                         f"{ended['FAILED']} failed")
    return "; ".join(parts)


def _chosen(pairs: dict[str, str]):
    """Cases with their sizes and seeds, result directory and number of jobs from the options."""
    given = options.read("hard", pairs)
    fast, families = given["fast"], given["family"] or FAMILIES
    idle = [name.upper() for name in ("seed", "count") if name in pairs]
    if idle and random.FAMILY not in families:
        raise InputError(f"scenes drawn at random have {' and '.join(idle)}: add "
                         f"FAMILY={random.FAMILY}, or leave out what is not used")
    chosen = [(case, size) for family in families for case in cases(family)
              if given["case"] in case.name and (case.fast or not fast)
              for size in (case.sizes[:1] if fast else case.sizes)]
    if random.FAMILY in families:
        count = min(given["count"], random.FAST) if fast else given["count"]
        chosen += [(random.FAMILY, seed) for seed in range(given["seed"], given["seed"] + count)
                   if given["case"] in random.name(seed)]
    if not chosen:
        raise InputError(f"no hard case has '{given['case']}' in its name")
    return chosen, given["out"].absolute(), given["jobs"]


# ---- the processes -------------------------------------------------------------------------------

def _judged(tasks: list, folder: Path, jobs: int) -> Iterator[Row]:
    """Rows of all tasks in their order.

    Where a process dies, those of its tasks that may have been running are run alone.
    """
    while tasks:
        with _pool(min(jobs, len(tasks))) as pool:
            futures = [_submitted(pool, task, folder) for task in tasks]
            try:
                while futures:
                    row = futures[0].result()
                    futures.pop(0)
                    tasks = tasks[1:]
                    yield row
            except BrokenProcessPool:
                pass
            # an interrupt may have come to this process alone: what runs ends, nothing else begins
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                for worker in (workers := multiprocessing.active_children()):
                    worker.terminate()
                for worker in workers:
                    worker.join()
                raise
        if tasks:
            yield _alone(tasks[0], folder)
            tasks = tasks[1:]


def _pool(jobs: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"),
                               initializer=die_of_signals)


def _submitted(pool: ProcessPoolExecutor, task: tuple, folder: Path):
    case, size = task
    if case == random.FAMILY:
        return pool.submit(_task, random.judge, size, folder)
    return pool.submit(_task, _judge_named, case.family, case.name, size, folder / "runs")


def _task(judged, *given) -> Row:
    """The row of a task. An interrupt, after which it has cleaned up, ends the process: the pool
    would give it the next task."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    environment.heed_interrupts()
    try:
        row = judged(*given)
    except KeyboardInterrupt:
        os._exit(130)
    finally:
        die_of_signals()
    return row


def _alone(task: tuple, folder: Path) -> Row:
    """The row of a task in a process of its own, which may die of it."""
    with _pool(1) as pool:
        try:
            return _submitted(pool, task, folder).result()
        except BrokenProcessPool:
            return random.died(task[1], folder)


# ---- one case ------------------------------------------------------------------------------------

def _judge_named(family: str, name: str, size: dict, folder: Path) -> Row:
    """`judge` for another process, to which checks cannot be sent."""
    return judge(next(case for case in cases(family) if case.name == name), size, folder)


def judge(case: Case, size: dict, folder: Path) -> Row:
    """Run a case at one size and judge how it ended; never raises for what a case does."""
    outcome = run_case(case, size, folder / _folder_name(case, size))
    expected = "solved" if case.status == 0 else f"refused (exit {case.status})"
    row = Row(case.family, case.name, " ".join(f"{n}={v}" for n, v in size.items()), expected,
              "FAILED", outcome.status, outcome.message, seconds=round(outcome.seconds, 2))
    row.sweep, row.place = case.sweep or ("", np.nan)
    if outcome.crashed or outcome.status != case.status:
        return row
    if case.status:
        # results before an iteration limit, or a step without solution, are kept, marked as not
        # converged; else nothing remains
        marked = outcome.summary.get("converged") is False
        proper = marked
        if case.status != 4:
            proper = marked and case.status == 3 or not outcome.directory.exists()
        if re.search(case.reason, outcome.message) and proper:
            row.status = "refused"
        return row
    try:
        row.why = _judge_solved(case, size, outcome, row)
    except (DriverError, OracleFailure, ValueError, KeyError) as problem:
        row.why = f"the check failed: {problem!r}"
        return row
    row.status = "FAILED" if row.why else "solved"
    row.why = row.why or "; ".join(outcome.summary["warnings"])
    return row


def _judge_solved(case: Case, size: dict, outcome: Outcome, row: Row) -> str:
    """Fill in the row of a case that claims to be solved; what is wrong with it, or nothing."""
    from .checks import condition

    summary, wrong = outcome.summary, []
    for name, value in summary["residuals"].items():
        setattr(row, name, value)
    row.kkt_tolerance = case.kkt
    if summary["residuals"] and not row.kkt <= case.kkt:
        wrong.append(f"KKT residual {row.kkt:.1e}")
    row.products = summary["counts"]["dual_multiplications"]
    row.fixed_point = summary["counts"]["fixed_point_iterations"]
    checks = [check(case, size, outcome) for check in case.checks]
    row.oracle = ", ".join(c.oracle for c in checks)
    row.error = max((c.error / c.tolerance for c in checks), default=np.nan)
    wrong += [f"{c.error:.1e} off {c.oracle}" for c in checks if not c.error <= c.tolerance]
    if not checks:
        wrong.append("the case names no oracle")
    if case.warning and not re.search(case.warning, "\n".join(summary["warnings"])):
        wrong.append(f"no warning of '{case.warning}'")
    if case.easy is not None:
        easy = reference(case, size, case.easy).summary["counts"]
        # products of QPs are compared with those of QPs: elimination takes next to none
        alike = bool(easy["condensed_steps"]) == bool(summary["counts"]["condensed_steps"])
        allowed = case.ratio if alike else None
        row.iterations_ratio = row.products / max(easy["dual_multiplications"], 1)
        row.ratio_allowed = allowed or np.nan
        if allowed and row.iterations_ratio > allowed:
            wrong.append(f"{row.iterations_ratio:.1f} times the products of the easy reference")
    if case.scene and case.perform is None:
        row.condition = condition(case, size, outcome)
    return "; ".join(wrong)


def _folder_name(case: Case, size: dict) -> str:
    """A directory of its own for every run of every process."""
    text = repr((case.name, sorted(case.arguments(size).items()), os.getpid()))
    name = re.sub("[^a-z0-9]+", "-", case.name.lower())
    return f"{name}-{hashlib.sha1(text.encode()).hexdigest()[:10]}"
