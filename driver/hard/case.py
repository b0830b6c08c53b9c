"""What a hard case is, and how it is run: as a user would, in a process with a time limit."""

import functools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from .. import children, environment
from ..files import read_table

# of every run unless a case says otherwise: errors shall be the method's, not the user's
TIGHT = {"RTOL": "1e-10", "FRICTION_RTOL": "1e-8", "PRIMAL_RTOL": "1e-6"}
BLOCK = "hard/block"  # the scene of most cases
KKT = 1e-6  # the largest KKT residual allowed at these tolerances: that of PRIMAL_RTOL


@dataclass
class Outcome:
    """Results of a run; `contact` and `history` are columns, those of contact (steps, nodes)."""

    status: int  # exit status; -1: killed at the time limit
    message: str  # last line on the error channel
    seconds: float
    directory: Path
    summary: dict = field(default_factory=dict)
    contact: dict = field(default_factory=dict)
    history: dict = field(default_factory=dict)
    crashed: bool = False  # a defect, a traceback or death by a signal


@dataclass(frozen=True)
class Check:
    """Result of a check: the largest relative deviation from `oracle`, and how large it may be."""

    oracle: str
    error: float
    tolerance: float


@dataclass(frozen=True)
class Case:
    """One hard case at two or more sizes.

    `scene` (a name such as hard/block) is run with `options`, those of one of the `sizes`, and
    TIGHT where they do not say otherwise. With `status` 0 it must be solved: KKT residuals below
    `kkt`, every one of `checks` within its tolerance, no more than `ratio` times the products of
    the same run with the options of `easy`, and `warning` (a regular expression) among the
    warnings. With another status it must be refused with that one and a reason that `reason` (a
    regular expression) finds. `sweep` names a series and the case's place in it. `perform` runs it
    where a plain run will not do: (case, size, directory) -> Outcome.
    """

    name: str
    scene: str
    options: dict = field(default_factory=dict)
    sizes: tuple[dict, ...] = ({"SUBDOMAINS": "4x2", "CELLS": "4"},
                               {"SUBDOMAINS": "8x4", "CELLS": "4"})
    checks: tuple[Callable[["Case", dict, Outcome], Check], ...] = ()
    easy: dict | None = None
    ratio: float | None = None
    status: int = 0
    reason: str = ""
    warning: str = ""
    kkt: float = KKT
    sweep: tuple[str, float] | None = None
    seconds: float = 120.0
    perform: Callable[["Case", dict, Path], Outcome] | None = None
    family: str = ""  # its module
    fast: bool = False  # its first size is among the default tests

    def arguments(self, size: dict) -> dict[str, str]:
        """All options of the run at one size, as text."""
        given = {**TIGHT, "FIELDS": "no", "FIGURES": "no", "QUIET": "yes", "RESUME": "no",
                 "ERRORS": "no", **self.options, **size}
        return {name: str(value) for name, value in given.items()}


def run_case(case: Case, size: dict, directory: Path) -> Outcome:
    """Run `case` at `size` into `directory`."""
    return (case.perform or run_scene)(case, size, directory)


def run_scene(case: Case, size: dict, directory: Path) -> Outcome:
    """The plain way: python3 -m driver run SCENE=... in a process of its own."""
    return run_command(run_words(case, size, directory), directory, case.seconds)


def run_words(case: Case, size: dict, directory: Path) -> list[str]:
    """The command line of the plain way."""
    given = {"SCENE": case.scene, **case.arguments(size), "OUT": directory}
    return ["run", *(f"{name}={value}" for name, value in given.items())]


def reference(case: Case, size: dict, options: dict) -> Outcome:
    """The same run with other options, made once a process. ValueError if it does not end well."""
    given = replace(case, options={**case.options, **options})
    return _reference((given.scene, *sorted(given.arguments(size).items())), given.seconds)


@functools.cache
def _reference(run: tuple, limit: float) -> Outcome:
    scene, *pairs = run
    with tempfile.TemporaryDirectory() as folder:
        outcome = run_scene(Case("", scene, dict(pairs), seconds=limit), {}, Path(folder) / "run")
    if outcome.status != 0:
        raise ValueError(f"the reference run ended with exit {outcome.status}: {outcome.message}")
    return outcome


def run_command(words: list[str], directory: Path, limit: float, prefix: list[str] = (),
                **changes) -> Outcome:
    """One call of the command line whose results go to `directory`; killed after `limit` seconds.

    `prefix` is a command that runs it, `changes` are environment variables to set.
    """
    for earlier in (directory, directory.with_name(f"{directory.name}-unconverged")):
        shutil.rmtree(earlier, ignore_errors=True)
    env = {**os.environ, "PYTHONPATH": children.python_path(), **changes}
    clock = time.perf_counter()
    with subprocess.Popen([*prefix, sys.executable, "-m", "driver", *words], cwd=environment.ROOT,
                          env=env, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE) as child:
        try:
            _, errors = child.communicate(timeout=limit)
            status = child.returncode
        except subprocess.TimeoutExpired:
            child.terminate()  # the driver cleans up as on an interrupt
            _, errors = child.communicate()
            status, errors = -1, f"killed after {limit:g} s\n"
    seconds = time.perf_counter() - clock
    lines = errors.strip().splitlines() or [""]
    crashed = "Traceback" in errors or status == 1 or status < -1 or status > 128
    return read_results(Outcome(status, lines[-1], seconds, directory, crashed=crashed))


def read_results(outcome: Outcome) -> Outcome:
    """Fill in what the files of a finished run say."""
    folder = outcome.directory
    if (folder / "summary.json").is_file():
        outcome.summary = json.loads((folder / "summary.json").read_text())
        outcome.history = read_table(folder / "history.csv")
        steps, table = outcome.summary["steps"], read_table(folder / "contact.csv") or {}
        outcome.contact = {name: values.reshape(steps, -1) for name, values in table.items()}
    return outcome
