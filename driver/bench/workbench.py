"""What the parts share: the model example at several sizes, clocks, and the report."""

import dataclasses
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections import deque
from pathlib import Path

import numpy as np

from .. import children, environment
from ..scene import freefem
from ..files import write_rows
from ..options import Settings
from ..studies.table import LOADINGS
from . import peak

REPEATS = 3
BARE = ("ERRORS=no", "FIELDS=no", "FIGURES=no", "QUIET=yes")  # a run without extras


@dataclasses.dataclass
class Row:
    """A measured value, target ("<= 3", empty: none), spread (largest - smallest) / median."""

    part: str
    name: str
    value: float
    unit: str
    target: str
    met: str
    spread: str


class Report:
    """Rows of report.csv, printed as they come."""

    def __init__(self, part: str = ""):
        """`part` of the benchmark that is being measured."""
        self.part, self.rows = part, []

    def add(self, name: str, values, unit: str = "", target: str = "") -> float:
        """Add and return the median of `values` with `target` "<= number" or ">= number"."""
        values = np.atleast_1d(values).astype(float)
        value, met, spread = float(np.median(values)), "", ""
        if target:
            relation, limit = target.split()
            reached = value <= float(limit) if relation == "<=" else value >= float(limit)
            met = "yes" if reached else "no"
        if len(values) > 1 and value:
            spread = f"{np.ptp(values) / abs(value):.2f}"
        self.rows.append(Row(self.part, name, value, unit, target, met, spread))
        note = f"   (target {target}: {met})" if target else ""
        print(f"  {name}: {value:.4g} {unit}{note}", flush=True)
        return value

    def skip(self, reason: str) -> None:
        """A row for what could not be measured, and why."""
        self.rows.append(Row(self.part, reason, float("nan"), "", "", "skipped", ""))
        print(f"  skipped: {reason}", flush=True)

    def write(self, path: Path) -> None:
        """report.csv under a temporary name, renamed."""
        write_rows(path, [field.name for field in dataclasses.fields(Row)],
                   [[f"{v:.6g}" if isinstance(v, float) else v for v in dataclasses.astuple(row)]
                    for row in self.rows])


class Workbench:
    """Exports and operators of the model example by size, made once, in a folder of their own."""

    def __init__(self, folder: Path):
        self.folder, self.report = folder, Report()
        self.add, self.skip = self.report.add, self.report.skip
        self.exports = folder / "exports"
        shutil.rmtree(self.exports, ignore_errors=True)
        self._problems, self._manifests = {}, {}
        self.export_seconds = {}

    def export(self, subdomains: str, cells: int = 10, ranks: int = 1) -> Path:
        """Directory of an export of the model, monotone loading, timed when it is made."""
        key = (subdomains, cells, ranks)
        directory = self.exports / f"{subdomains}-{cells}-{ranks}"
        if key not in self.export_seconds:
            scene, parameters = freefem.find_scene("model"), _parameters(subdomains, cells)
            self.export_seconds[key] = seconds(
                lambda: freefem.export(scene, directory, parameters, ranks))
        return directory

    def problem(self, subdomains: str, loading: str = "monotone", cells: int = 10):
        """The Problem of a size under a loading with its own count; operators are made once."""
        from mpi4py import MPI

        from ..march.problem import assemble

        key = (subdomains, cells)
        if key not in self._problems:
            self._problems[key] = assemble(self.export(subdomains, cells), MPI.COMM_SELF)
        if key not in self._manifests:
            manifests = freefem.export_study(
                freefem.find_scene("model"), self.exports / f"{subdomains}-{cells}-loadings",
                _parameters(subdomains, cells), "loading", list(LOADINGS))
            self._manifests[key] = dict(zip(LOADINGS, manifests))
        problem = self._problems[key]
        operator = problem.operator.with_contact(problem.structure.contact)
        return dataclasses.replace(problem, manifest=self._manifests[key][loading],
                                   operator=operator)

    def forget(self, subdomains: str, cells: int = 10) -> None:
        """Free the operator of a size."""
        self._problems.pop((subdomains, cells), None)

    def close(self) -> None:
        """Remove the exports."""
        shutil.rmtree(self.exports, ignore_errors=True)


def _parameters(subdomains: str, cells: int) -> dict[str, str]:
    return {"subdomains": subdomains, "cells": str(cells)}


def march(problem, **settings):
    """Go through all steps; the history.

    Raises StepFailed if it does not converge: a benchmark must.
    """
    solver = problem.solver(Settings(**settings))
    deque(solver.steps(), maxlen=0)
    return solver.history


def timed(action) -> tuple:
    """Value and wall time of a call."""
    clock = time.perf_counter()
    value = action()
    return value, time.perf_counter() - clock


def seconds(action) -> float:
    """Wall time of a call."""
    return timed(action)[1]


def in_turn(actions: dict, repeats: int = REPEATS) -> dict[str, list[float]]:
    """Seconds of every action, taken in turn so that all see the same state of the machine.

    An action returns the seconds that count, or None for its wall time.
    """
    times = {name: [] for name in actions}
    for _ in range(repeats):
        for name, action in actions.items():
            own, wall = timed(action)
            times[name].append(wall if own is None else own)
    return times


def ratios(over: list[float], under: list[float]) -> list[float]:
    """Ratios of times of the same round."""
    return [a / b for a, b in zip(over, under)]


def child(command: list[str], env: dict | None = None,
          cwd: Path = environment.ROOT) -> tuple[float, float]:
    """Wall seconds and peak memory (MiB) of a process. Raises RuntimeError if it fails."""
    env = {**(env or children.child_environment()), "PYTHONPATH": children.python_path()}
    # options of `make bench` are not the child's; compiled modules are kept, as those of installed
    # packages are
    for name in ("MAKEFLAGS", "MAKEOVERRIDES", "MFLAGS", "MAKELEVEL", "PYTHONDONTWRITEBYTECODE"):
        env.pop(name, None)
    with tempfile.NamedTemporaryFile("r") as measured:
        done = subprocess.run([sys.executable, peak.__file__, measured.name, *command], env=env,
                              cwd=cwd, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, errors="replace", check=False)
        if done.returncode:
            said = " ".join(done.stdout.split())[-300:]
            raise RuntimeError(f"{' '.join(command[:4])} failed: {said}")
        wall, memory = map(float, measured.read().split())
    return wall, memory / 1024


def on_ranks(bench: Workbench, export: Path, ranks: int, repeats: int,
             *settings: str) -> list[dict]:
    """What rank.py measures on an export, `repeats` times in one start of the ranks."""
    out = bench.folder / ".runs.json"
    command = [sys.executable, "-m", "driver.bench.rank",
               str(export), str(out), str(repeats), *settings]
    child([*children.mpirun(ranks), *command] if ranks > 1 else command)
    runs = json.loads(out.read_text())
    out.unlink()
    return runs


def driver(*words: str) -> list[str]:
    """Command line of the driver with this Python."""
    return [sys.executable, "-m", "driver", *words]
