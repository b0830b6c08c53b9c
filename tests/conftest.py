"""Fixtures: FreeFEM exports, FETI-DP operators and finished runs, each made once per session."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from driver import environment

environment.single_threaded()
environment.start_petsc()

import numpy as np
import pytest

from mpi4py import MPI

from driver.scene import freefem
from driver.runs import run
from driver.errors import DriverError
from driver.files import read_table

MODEL = environment.ROOT / "edp" / "model.edp"


def _key(scene, options) -> tuple:
    return (str(scene), *sorted(options.items()))


@pytest.fixture(scope="session")
def variant(tmp_path_factory):
    """variant(name, (old, new), ...): path of a copy of the model example with its text changed."""
    folder = tmp_path_factory.mktemp("scenes")

    def make(name: str, *changes) -> Path:
        text = MODEL.read_text()
        for old, new in changes:
            assert old in text, f"model.edp has no {old!r} any more: adapt the test"
            text = text.replace(old, new)
        path = folder / f"{name}.edp"
        path.write_text(text)
        return path

    return make


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """exported(scene, ranks=1, **parameters): directory of a FreeFEM export, shared: copy it to change it."""
    made = {}

    def make(scene="model", ranks=1, **parameters) -> Path:
        parameters = {name: str(value) for name, value in parameters.items()}
        key = _key(scene, {**parameters, "ranks": ranks})
        if key not in made:
            made[key] = tmp_path_factory.mktemp("export")
            freefem.export(freefem.find_scene(str(scene)), made[key], parameters, ranks)
        return made[key]

    return make


@dataclass
class Problem:
    """An export as read and, unless asked otherwise, its dual operator."""

    manifest: object
    subdomains: list
    structure: object
    operator: object = None

    @property
    def F(self) -> np.ndarray:
        """Dense dual matrix, one product a column."""
        return np.column_stack([self.operator.apply(e).copy() for e in np.eye(self.structure.dual_dofs)])


def read_problem(directory: Path, reduce=True) -> Problem:
    """Loader, substructuring and, if asked, the reduction of the export in `directory`."""
    from driver.feti.fetidp import DualOperator
    from driver.scene.loader import read_subdomains
    from driver.scene.manifest import read_manifest
    from driver.march.tearing import build

    manifest = read_manifest(directory)
    subdomains = read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)
    structure = build(manifest, subdomains, 0, MPI.COMM_SELF)
    return Problem(manifest, subdomains, structure, DualOperator(structure, MPI.COMM_SELF) if reduce else None)


@pytest.fixture(scope="session")
def read():
    """read(directory, reduce=True): see read_problem."""
    return read_problem


@pytest.fixture(scope="session")
def built(exported):
    """built(scene, reduce=True, **parameters): a Problem, shared by the tests of a session."""
    made = {}

    def make(scene="model", reduce=True, **parameters) -> Problem:
        key = _key(scene, {**parameters, "reduce": reduce})
        if key not in made:
            made[key] = read_problem(exported(scene, **parameters), reduce)
        return made[key]

    return make


@dataclass
class Outcome:
    """A finished run: exit status, reason and what its files say; contact arrays are (steps, nodes)."""

    directory: Path
    status: int = 0
    reason: str = ""
    summary: dict = field(default_factory=dict)
    contact: dict = field(default_factory=dict)
    history: dict = field(default_factory=dict)


def read_outcome(directory: Path, status=0, reason="") -> Outcome:
    """The files of a run in `directory`."""
    found = Outcome(directory, status, reason)
    if not (directory / "summary.json").exists():
        return found
    found.summary = json.loads((directory / "summary.json").read_text())
    if (directory / "contact.csv").exists():
        steps = found.summary["steps"]
        found.contact = {name: column.reshape(steps, -1) for name, column in read_table(directory / "contact.csv").items()}
    found.history = read_table(directory / "history.csv")
    return found


@pytest.fixture(scope="session")
def solved(tmp_path_factory):
    """solved(scene, NAME=value, ...): Outcome of a whole run in this process, options as on the command line."""
    made = {}

    def make(scene="model", **options) -> Outcome:
        key = _key(scene, options)
        if key not in made:
            out = tmp_path_factory.mktemp("run") / "out"
            pairs = {"scene": str(scene), "out": str(out), "figures": "no", "fields": "no", "quiet": "yes", "errors": "no"}
            pairs.update({name.lower(): str(value) for name, value in options.items()})
            status, reason = 0, ""
            try:
                run.execute(run.Run.from_pairs(pairs))
            except DriverError as problem:
                status, reason = problem.exit_status, str(problem)
            made[key] = read_outcome(out, status, reason)
        return made[key]

    return make


@pytest.fixture(scope="session")
def steps_of():
    """steps_of(problem, **settings): the solver after its steps, and those steps (white box); see `marched`."""
    from driver.effects import Effects
    from driver.options import Settings
    from driver.march.quasistatic import QuasistaticSolver

    def run(problem: Problem, **settings):
        m = problem.manifest
        solver = QuasistaticSolver(problem.operator, Effects(m), m.factors, np.linspace(0, m.t_end, m.steps + 1),
                                   Settings(**settings))
        return solver, marched(solver)

    return run


def marched(solver) -> list:
    """All steps of a solver, an unfinished one last; the error that ended it, or None, becomes `solver.failure`."""
    from driver.march.step import StepFailed

    steps, solver.failure = [], None
    try:
        for step in solver.steps():
            steps.append(step)
    except StepFailed as failure:
        solver.failure = failure
        steps += [failure.step] if failure.step else []
    return steps


@pytest.fixture(scope="session")
def command():
    """command(*words, **environment): the command line as a user's shell runs it, output captured."""

    def run(*words, cwd=environment.ROOT, **changes) -> subprocess.CompletedProcess:
        env = {**os.environ, "PYTHONPATH": environment.python_path(), **changes}
        return subprocess.run([sys.executable, "-m", "driver", *map(str, words)], cwd=cwd, env=env, text=True,
                              stdin=subprocess.DEVNULL, capture_output=True, timeout=120)

    return run


@pytest.fixture
def copied(tmp_path):
    """copied(directory): a private copy of an export, to be spoiled."""
    count = iter(range(10_000))

    def make(directory: Path) -> Path:
        return Path(shutil.copytree(directory, tmp_path / f"copy{next(count)}"))

    return make
