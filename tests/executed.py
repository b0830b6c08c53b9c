"""Which tests execute which lines of the numerical packages: a plugin of pytest for `mutants`.

    EXECUTED=part.json python3 -m pytest -p executed tests/qp

What a fixture or a factory of `conftest` (`SHARED`) executes counts for all tests that use it, not
for the first alone. Processes of Python that a test starts, ranks among them, record as well,
unless they are killed (`_follow_children`); of FreeFEM's processes it is known which files they
read. The result is {"tests": {name: CPU seconds of its own and of all else that it
needs}, "lines": {file: {text of a line: tests as bits of a hexadecimal number}}}; FreeFEM's files
have one text, "". Texts rather than numbers find a line again where others have changed. Tests that
fail are left out.
"""

import json
import os
import resource
import shutil
import sys
from collections import defaultdict
from pathlib import Path

import coverage
import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("qp", "feti", "contact", "effects", "march", "results", "energy_norm",
            "validity", "estimates")
LIBRARY = sorted((ROOT / "edp" / "lib").rglob("*.idp"))
TABLE = Path(os.environ["EXECUTED"]).resolve()
CHILDREN = TABLE.with_suffix(".children")  # what other processes have executed
CONTEXT = "EXECUTED_FOR"  # in their environment: on behalf of what
SHARED = ("once", "exported", "built", "solved", "loaded")


class Contexts:
    """What is executed on behalf of what: a stack of names, lines and seconds of each."""

    def __init__(self):
        self.stack, self.uses = ["none"], defaultdict(set)
        self.seconds, self.read = defaultdict(float), defaultdict(set)
        self.tests, self.failed, self.clock = [], set(), _seconds()
        self.coverage = coverage.Coverage(
            data_file=None, config_file=False,
            source=[str(ROOT / "driver" / name) for name in PACKAGES])
        self.coverage.start()
        self._switch()

    def _switch(self) -> None:
        self.coverage.switch_context(self.stack[-1])
        os.environ[CONTEXT] = self.stack[-1]

    def _credit(self) -> None:
        now = _seconds()
        self.seconds[self.stack[-1]] += now - self.clock
        self.clock = now

    def enter(self, name: str) -> None:
        """What follows is on behalf of `name`, which the one before uses."""
        self._credit()
        self.uses[self.stack[-1]].add(name)
        self.stack.append(name)
        self._switch()

    def leave(self) -> None:
        """Back to the one before."""
        self._credit()
        self.stack.pop()
        self._switch()

    def needed(self, name: str, seen=None) -> set:
        """`name` and all that it uses."""
        seen = {name} if seen is None else seen
        for other in self.uses[name] - seen:
            seen.add(other)
            self.needed(other, seen)
        return seen

    def table(self) -> dict:
        """The result, see above."""
        self.coverage.stop()
        tests, bits = {}, defaultdict(int)  # tests by context
        for k, test in enumerate(test for test in self.tests if test not in self.failed):
            needed = sorted(self.needed(test) - {test})
            tests[test] = {name: round(self.seconds[name], 3) for name in [test, *needed]}
            for name in tests[test]:
                bits[name] |= 1 << k
        lines, data = {}, self.coverage.get_data()
        for path in CHILDREN.glob("data.*"):
            child = coverage.CoverageData(path)
            child.read()
            data.update(child)
        for file in sorted(data.measured_files()):
            texts, by = Path(file).read_text().split("\n"), defaultdict(int)
            for line, names in data.contexts_by_lineno(file).items():
                by[texts[line - 1].strip()] |= union(bits[name] for name in names)
            lines[str(Path(file).relative_to(ROOT))] = {text: f"{bits_:x}"
                                                        for text, bits_ in by.items()}
        for path in LIBRARY:
            by = union(bits[name] for name, files in self.read.items() if path in files)
            lines[str(path.relative_to(ROOT))] = {"": f"{by:x}"}
        return {"tests": tests, "lines": lines}


def union(numbers) -> int:
    """Bits of any of the numbers."""
    total = 0
    for number in numbers:
        total |= number
    return total


def _seconds() -> float:
    """CPU seconds of this process and its children."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in spent)


contexts = Contexts()


def _follow_freefem() -> None:
    """Note which files of the library processes of FreeFEM read, by the times of access."""
    from driver import children

    run_child = children.run_child

    def run(*words, **options):
        for path in LIBRARY:
            os.utime(path, ns=(0, path.stat().st_mtime_ns))
        try:
            return run_child(*words, **options)
        finally:
            contexts.read[contexts.stack[-1]] |= {path for path in LIBRARY
                                                  if path.stat().st_atime_ns > 0}

    children.run_child = run


def _follow_children() -> None:
    """Let processes of Python that are started from now on record, each into a file of its own."""
    shutil.rmtree(CHILDREN, ignore_errors=True)
    CHILDREN.mkdir()
    packages = "".join(f"\n    {ROOT / 'driver' / name}" for name in PACKAGES)
    (CHILDREN / "rc").write_text(f"[run]\nparallel = True\ndata_file = {CHILDREN / 'data'}\n"
                                 f"context = ${{{CONTEXT}}}\nsource ={packages}\n")
    (CHILDREN / "sitecustomize.py").write_text("import coverage\ncoverage.process_startup()\n")
    os.environ["COVERAGE_PROCESS_START"] = str(CHILDREN / "rc")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(CHILDREN), os.environ.get("PYTHONPATH", "")])


def _shared(name: str, function):
    """`function` on behalf of what it is called with."""
    def call(*words, **options):
        contexts.enter(f"{name} {words[name == 'once':]} {sorted(options.items())}")
        try:
            return function(*words, **options)
        finally:
            contexts.leave()

    return call


def pytest_sessionstart():
    _follow_freefem()
    _follow_children()


@pytest.hookimpl(hookwrapper=True)
def pytest_fixture_setup(fixturedef, request):
    wide = fixturedef.scope != "function"
    if wide:
        contexts.enter(_fixture(fixturedef))
    outcome = yield
    if wide:
        contexts.leave()
        if fixturedef.argname in SHARED:
            call = _shared(fixturedef.argname, outcome.get_result())
            fixturedef.cached_result = (call, *fixturedef.cached_result[1:])
            outcome.force_result(call)


def _fixture(fixturedef) -> str:
    return f"fixture {fixturedef.baseid} {fixturedef.argname}"


def _forget() -> None:
    """What the solver has remembered for all times, so that all tests that need it execute it."""
    for name in [name for name in sys.modules if name.startswith("driver.")]:
        for remembered in vars(sys.modules[name]).values():
            if hasattr(remembered, "cache_clear"):
                remembered.cache_clear()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item, nextitem):
    _forget()
    contexts.tests.append(item.nodeid)
    contexts.enter(item.nodeid)
    for fixturedefs in item._fixtureinfo.name2fixturedefs.values():
        contexts.uses[item.nodeid] |= {_fixture(one) for one in fixturedefs
                                       if one.scope != "function"}
    yield
    contexts.leave()


def pytest_runtest_logreport(report):
    if report.failed:
        contexts.failed.add(report.nodeid)


def pytest_sessionfinish():
    TABLE.write_text(json.dumps(contexts.table()))
    shutil.rmtree(CHILDREN)
