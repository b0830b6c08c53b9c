"""Fixtures: FreeFEM exports, FETI-DP operators and finished runs, each made once.

Tests lie in the order of the packages of `driver/`, so that a failure in an early folder is likely
the cause of those in later ones (PACKAGES of driver/studies/docs.py has the order). In scenes/
stand the scenes that ship against closed forms and dense solutions; test_house.py keeps the rules
that the code itself follows.

    make test                           all but the long ones, on all cores; the files that take
                                        longest come first
    make test ARGS="-k saddle"          those whose name holds a word
    python3 -m pytest tests/feti        one folder, in one process
    make test-long                      what is marked slow: the reason stands beside the mark
    python3 tests/unchanged.py COMMIT   whole runs against those of another commit, bit for bit

Exports and runs of `exported` and `solved` are shared with the other processes of a parallel
session: they lie in its temporary directory under a name made of the scene's text and the options,
and the process that comes first makes them.
"""

import fcntl
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from driver import children, environment

for allotted in ("PBS_NODEFILE", "SLURM_JOB_ID"):  # tests say themselves how many ranks they take
    os.environ.pop(allotted, None)
environment.prepare_libraries()
environment.start_petsc()

import numpy as np
import pytest
from mpi4py import MPI

from driver import cli
from driver.march.tearing import build
from driver.effects import Effects
from driver.errors import DriverError
from driver.files import read_table
from driver.feti.operator import DualOperator
from driver.march.quasistatic import QuasistaticSolver
from driver.march.step import StepFailed
from driver.options import Settings
from driver.runs import run
from driver.scene import freefem
from driver.scene.loader import read_subdomains
from driver.scene.manifest import read_manifest

MODEL = environment.ROOT / "edp" / "model.edp"
pytest_plugins = ["estimated"]  # fixtures of estimates


# ------------------------------------------------------------------------------ order

# Files that take longest, in the order in which processes take them up: what comes last is short,
# and no process waits long for another. A file that is not named here comes after them.
LONGEST = ("test_cli", "test_hard", "test_model", "test_resume", "test_scenes_bodies",
           "test_effectivity", "test_pair_bound", "test_goal", "test_scenes_hertz", "test_loader",
           "test_figures", "test_quadratic", "test_study", "test_accuracy", "test_budget",
           "test_operator")


def pytest_configure(config):
    """Modules are compiled once, not by every process of the driver, also where Python is told to
    leave nothing beside them.
    """
    told = os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if told and hasattr(config, "cache"):  # else in a copy of the tree, as of `make mutants`
        os.environ["PYTHONPYCACHEPREFIX"] = str(config.cache.mkdir("bytecode"))


def pytest_collection_modifyitems(config, items):
    """Of tests with a mark `some` a few parameter sets run by default, evenly spread, the others
    with the slow ones. In a parallel session the longest files come first.
    """
    alike = {}
    for item in items:
        if item.get_closest_marker("some") and not item.get_closest_marker("slow"):
            alike.setdefault((item.path, item.originalname), []).append(item)
    for sets in alike.values():
        count = sets[0].get_closest_marker("some").args[0]
        chosen = {len(sets) * k // count for k in range(count)}
        for number, item in enumerate(sets):
            if number not in chosen:
                item.add_marker("slow")
    if hasattr(config, "workerinput"):
        rank = {name: number for number, name in enumerate(LONGEST)}
        items.sort(key=lambda item: rank.get(item.path.stem, len(LONGEST)))


# -------------------------------------------------------------- what is made once and shared

@pytest.fixture(scope="session")
def once(tmp_path_factory):
    """once(make, *key): directory that `make(directory)` has filled in this or another process.

    If it raises, the next one to ask tries again.
    """
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared"
    folder.mkdir(exist_ok=True)

    def get(make: Callable, *key) -> Path:
        path = folder / hashlib.sha256(repr(key).encode()).hexdigest()[:24]
        with open(path.with_suffix(".lock"), "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # until the file is closed
            if not path.exists():
                hidden = path.with_suffix(".made")
                shutil.rmtree(hidden, ignore_errors=True)
                hidden.mkdir()
                make(hidden)
                hidden.rename(path)
        return path

    return get


def _key(scene: Path, options: dict) -> tuple:
    """What an export of `scene` or a run depends on."""
    return (scene.name, freefem.text_digest(scene), *sorted(options.items()))


@pytest.fixture(scope="session")
def variant(tmp_path_factory):
    """variant(name, (old, new), ...): path of a copy of the model example with changed text."""
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
def exported(once):
    """exported(scene, ranks=1, **parameters): directory of an export; copy it to change it."""

    def get(scene="model", ranks=1, **parameters) -> Path:
        path = freefem.find_scene(str(scene))
        parameters = {name: str(value) for name, value in parameters.items()}
        return once(lambda directory: freefem.export(path, directory, parameters, ranks),
                    "export", ranks, *_key(path, parameters))

    return get


@dataclass
class Problem:
    """An export as read and, unless asked otherwise, its dual operator."""

    manifest: object
    subdomains: list
    structure: object
    operator: object = None

    @property
    def F(self) -> np.ndarray:
        """Dense dual matrix (n_d, n_d), one product a column."""
        columns = [self.operator.apply(e).copy() for e in np.eye(self.structure.dual_dofs)]
        return np.column_stack(columns)


def read_problem(directory: Path, reduce=True) -> Problem:
    """Loader, substructuring and, if asked, the reduction of the export in `directory`."""
    manifest = read_manifest(directory)
    subdomains = read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)
    structure = build(manifest, subdomains, 0, MPI.COMM_SELF)
    operator = DualOperator(structure, MPI.COMM_SELF) if reduce else None
    return Problem(manifest, subdomains, structure, operator)


@pytest.fixture(scope="session")
def read():
    """read(directory, reduce=True): see read_problem."""
    return read_problem


@pytest.fixture(scope="session")
def built(exported):
    """built(scene, reduce=True, **parameters): a Problem, shared by the tests of a process."""
    made = {}

    def get(scene="model", reduce=True, **parameters) -> Problem:
        key = (exported(scene, **parameters), reduce)
        if key not in made:
            made[key] = read_problem(*key)
        return made[key]

    return get


def load_response(problem, weights: np.ndarray) -> np.ndarray:
    """d (owned,) of a dual problem for the load sum_k weights_k f_k, rigid motions included."""
    return problem.elastic_response(weights) + problem.rigid_response(weights)


# ------------------------------------------------------------------------------ runs

@dataclass
class Outcome:
    """A finished run: exit status, reason and its files; contact columns are (steps, nodes)."""

    directory: Path
    status: int = 0
    reason: str = ""
    summary: dict = field(default_factory=dict)
    contact: dict = field(default_factory=dict)
    history: dict = field(default_factory=dict)


def read_outcome(directory: Path, status=0, reason="") -> Outcome:
    """The files of a run in `directory`; what it does not have stays empty."""
    outcome = Outcome(directory, status, reason)
    if (directory / "summary.json").exists():
        outcome.summary = json.loads((directory / "summary.json").read_text())
        contact = read_table(directory / "contact.csv") or {}
        outcome.contact = {name: column.reshape(outcome.summary["steps"], -1)
                           for name, column in contact.items()}
        outcome.history = read_table(directory / "history.csv") or {}
    return outcome


@pytest.fixture(scope="session")
def solved(once):
    """solved(scene, NAME=value, ...): Outcome of a run in a process like this one.

    Options are those of the command line.
    """
    made = {}

    def get(scene="model", **options) -> Outcome:
        path = freefem.find_scene(str(scene))
        options = {name.lower(): str(value) for name, value in options.items()}
        pairs = {"figures": "no", "fields": "no", "quiet": "yes", "errors": "no", **options}
        key = _key(path, pairs)

        def make(directory: Path) -> None:
            status, reason = 0, ""
            try:
                run.execute(run.Run.from_pairs(
                    {"scene": str(path), "out": str(directory / "out"), **pairs}))
            except DriverError as problem:
                status, reason = problem.exit_status, str(problem)
            (directory / "status.json").write_text(json.dumps([status, reason]))

        if key not in made:
            directory = once(make, "run", *key)
            made[key] = read_outcome(directory / "out",
                                     *json.loads((directory / "status.json").read_text()))
        return made[key]

    return get


@pytest.fixture(scope="session")
def steps_of():
    """steps_of(problem, **settings): the solver after its steps, and those steps; see `marched`."""

    def solve(problem: Problem, **settings):
        m = problem.manifest
        times = np.linspace(0, m.t_end, m.steps + 1)
        solver = QuasistaticSolver(problem.operator, Effects(m), m.factors, times,
                                   Settings(**settings))
        return solver, marched(solver)

    return solve


def marched(solver) -> list:
    """All steps of a solver, an unfinished one last.

    The error that ended it, or None, becomes `solver.failure`.
    """
    steps, solver.failure = [], None
    try:
        for step in solver.steps():
            steps.append(step)
    except StepFailed as failure:
        solver.failure = failure
        steps += [failure.step] if failure.step else []
    return steps


@pytest.fixture
def scene(tmp_path):
    """scene(text, (old, new), ..., name="scene"): path of a scene with parts replaced."""
    def make(text: str, *changes, name: str = "scene") -> Path:
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / f"{name}.edp"
        path.write_text(text)
        return path

    return make


@pytest.fixture(scope="module")
def named_scene(tmp_path_factory):
    """named_scene(name, text): path of a scene, the same for all tests of a module."""
    folder = tmp_path_factory.mktemp("named")

    def make(name: str, text: str) -> Path:
        path = folder / f"{name}.edp"
        path.write_text(text)
        return path

    return make


@pytest.fixture(scope="session")
def command():
    """command(*words, **environment): the command line as a user's shell runs it."""

    def call(*words, cwd=environment.ROOT, **changes) -> subprocess.CompletedProcess:
        env = {**os.environ, "PYTHONPATH": children.python_path(), **changes}
        return subprocess.run([sys.executable, "-m", "driver", *map(str, words)], cwd=cwd, env=env,
                              text=True, stdin=subprocess.DEVNULL, capture_output=True,
                              timeout=300, check=False)

    return call


@pytest.fixture
def command_here(capsys, monkeypatch):
    """command_here(*words): the same in this process, without the time that a new one takes.

    For what ends in front of the solver; that `python3 -m driver` comes to the same is what the
    tests with `command` show.
    """
    def call(*words) -> subprocess.CompletedProcess:
        monkeypatch.setattr(sys, "argv", ["driver", *map(str, words)])
        capsys.readouterr()
        status = 0
        try:
            cli.main()
        except SystemExit as end:
            status = end.code
        return subprocess.CompletedProcess(words, status, *capsys.readouterr())

    return call


LOADED = """
import sys
from driver import cli
sys.argv[0] = "driver"
cli.main()
print("loaded:", *sys.modules)
"""


@pytest.fixture(scope="session")
def loaded(once):
    """loaded(scene, *words): names of all modules that a run of its own imports, and its directory.

    The run leaves out figures, fields and error estimates unless the words say otherwise.
    """
    def get(scene: str, *words: str) -> tuple[set[str], Path]:
        path = freefem.find_scene(str(scene))
        options = {"figures": "no", "fields": "no", "errors": "no",
                   **cli.parse_pairs([*words])}

        def make(directory: Path) -> None:
            pairs = {"scene": str(path), "out": str(directory / "out"), **options}
            done = subprocess.run(
                [sys.executable, "-c", LOADED, "run", *(f"{k}={v}" for k, v in pairs.items())],
                cwd=environment.ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True,
                check=True)
            (directory / "modules").write_text(done.stdout.rpartition("loaded: ")[2])

        directory = once(make, "modules", *_key(path, options))
        return set((directory / "modules").read_text().split()), directory / "out"

    return get


@pytest.fixture
def copied(tmp_path):
    """copied(directory): a private copy of an export, to be spoiled."""
    count = iter(range(10_000))

    def make(directory: Path) -> Path:
        return Path(shutil.copytree(directory, tmp_path / f"copy{next(count)}"))

    return make
