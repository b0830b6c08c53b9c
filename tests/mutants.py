"""Small changes of meaning, made one at a time, and the tests that notice them.

    make mutants                               # 40 mutants of all numerical packages
    make mutants MODULE=qp COUNT=20 SEED=7     # of a package, a file of it, or lib (edp/lib)
    make mutants COUNT=320 SEED=11 FIRST=161   # the second half of a sample
    python3 tests/mutants.py --change driver/march/slip.py 'old text' 'new text'    # one by hand

Mutants (`mutations`) are drawn without replacement, packages in turn, with the same SEED the same
ones. Each is tried in a copy of the tree, one copy a core, against the tests that execute the
changed line, cheap ones and those of its package first, until one fails or they have taken LIMIT
seconds of a processor. Which tests execute what is found out once (`executed`, minutes) and kept in
results/mutants/executed: remove it where tests have changed much. What survives is written with
the change, to be noticed by a new test or argued equivalent: in `tests/equivalent.txt`, a block of
lines for each (file, line before, line after, argument). The table is OUT/mutants.csv,
results/mutants/mutants.csv by default.
"""

import argparse
import ast
import csv
import json
import os
import queue
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mutations import PACKAGES, ROOT, Mutant, drawn, mutant

COPIED = ("driver", "edp", "tests", "meshes", "results/reference", "results/README.md", "README.md",
          "Makefile", "LICENSE", "apt-packages.txt", "pyproject.toml", ".github", ".ci")
FEW = 10  # mutants that are not worth compiling the assertions of all tests for
# the tests that concern numerical packages, in parts that take about as long as one another
PARTS = (("tests/qp", "tests/contact", "tests/effects", "tests/scene/test_loader.py",
          "tests/scene/test_materials.py", "tests/scene/test_contents.py",
          "tests/scene/test_library.py", "tests/scene/test_contact_columns.py",
          "tests/scene/test_messages.py",
          "tests/verify/test_independent.py"),
         ("tests/feti", "tests/march", "tests/results", "tests/energy_norm", "tests/validity",
          "tests/estimates", "tests/python"),
         ("tests/scenes",))
CHEAP = 6.0  # CPU seconds of the tests that are tried first
OWN = 0.2  # what a second of tests of a package or module counts in their order
SLOW, START = 6.0, 20.0  # what a mutant may take of the time without it, and seconds more
MEMORY = 8 * 2**30  # bytes that it may take
UNKNOWN, NOTHING = 4, 5  # pytest's status where a test is not there, and where none is to be run
COLUMNS = ("seed", "file", "line", "before", "after", "outcome", "noticed by", "seconds")
HOME = ROOT / "results" / "mutants"
OPTIONS = {"MODULE": "", "COUNT": "40", "SEED": "1", "FIRST": "1", "LIMIT": "60", "OUT": str(HOME)}
SOUND = set()  # tests that passed when it was found out which lines they execute
EQUIVALENT = ROOT / "tests" / "equivalent.txt"


# ------------------------------------------------------------------------------ copies, runs

def copies(folder: Path, count: int, compiled: bool) -> list[Path]:
    """`count` copies of what the tests need, `compiled` ones if so, with the tests' assertions."""
    first, *others = (folder / str(k) for k in range(count))
    copy(first)
    if compiled:
        pytest(first, "--collect-only", PYTHONDONTWRITEBYTECODE="")
    for other in others:
        shutil.copytree(first, other)
    return [first, *others]


def copy(folder: Path) -> Path:
    """A copy of what the tests need."""
    for name in COPIED:
        source, target = ROOT / name, folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.exists():
            shutil.copy2(source, target)
    return folder


def pytest(folder: Path, *words: str, path=(), seconds=None, **more: str) -> tuple[int, str]:
    """Status and output of pytest in the copy `folder`; -9 where it takes more CPU `seconds`."""
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1",
                   "PYTHONPATH": os.pathsep.join(["tests", *map(str, path)]), **more}

    def limits():
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        if seconds:
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))

    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=no", "-rfE",
               "--basetemp", str(folder / "made"), *words]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, env=environment, start_new_session=True,
                          preexec_fn=limits) as child:
        try:
            said = child.communicate(timeout=10 * seconds if seconds else None)[0]
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            return -9, ""
    return child.returncode, said


# ------------------------------------------------------------------------------ tests of a line

def executed(home: Path) -> list[dict]:
    """The tables of `executed`, made if they are not there."""
    home.mkdir(parents=True, exist_ok=True)

    def part(k: int) -> dict:
        table = home / f"{k}.json"
        if not table.exists():
            folder = home / f"copy{k}"
            shutil.rmtree(folder, ignore_errors=True)  # of a recording that was interrupted
            copy(folder)
            said = pytest(folder, "-p", "executed", *PARTS[k], path=sys.path,
                          EXECUTED=str(table))[1]
            if not table.exists():
                sys.exit(f"the tests did not run:\n{said}")
            shutil.rmtree(folder)
        return json.loads(table.read_text())

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return list(pool.map(part, range(len(PARTS))))


def function_of(text: str, line: int) -> tuple[int, int]:
    """First line of the body and last line of the innermost function around `line`, or (0, 0)."""
    spans = [(node.body[0].lineno, node.end_lineno) for node in ast.walk(ast.parse(text))
             if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))]
    return max((span for span in spans if span[0] <= line <= span[1]), default=(0, 0))


def concerned(one: Mutant, tables: list[dict]) -> dict[str, dict[str, float]]:
    """Tests that execute the changed line, and CPU seconds of each and of what it needs.

    What stands outside of functions concerns all that execute anything of the file, and the tests
    of its package, which may look at it without executing more.
    """
    text, tests = (ROOT / one.file).read_text(), {}
    start, _ = function_of(text, one.line) if one.package != "lib" else (0, 0)
    above = [line.strip() for line in text.split("\n")[start - 1 : one.line]][::-1] if start else []
    for table in tables:
        known = table["lines"].get(one.file, {})
        nearest = next((known[line] for line in above if line in known), None)
        bits = [int(by, 16) for by in ([nearest] if nearest else known.values())]
        tests |= {test: needs for k, (test, needs) in enumerate(table["tests"].items())
                  if any(number >> k & 1 for number in bits)
                  or not start and test.startswith(f"tests/{one.package}/")}
    return tests


def phases(tests: dict[str, dict[str, float]], file: str, before: list, limit: float) -> list:
    """Names in the order in which they are tried, by file: cheap ones, and the others up to `limit`
    CPU seconds, with the seconds of each phase; those of `before` come first, then those that lie
    in the folder of the changed `file`'s package (the library's are in scene) or have its name in
    theirs.
    """
    folder = f"tests/{Path(file).parent.name.replace('lib', 'scene')}/"
    stem = Path(file).stem.removesuffix("s")

    def price(test: str) -> float:
        own = test.startswith(folder) or stem in test
        return sum(tests[test].values()) * (0 if test in before else OWN if own else 1)

    made, spent, found = set(), [0.0, 0.0], [{}, {}]
    for test in sorted(tests, key=price):
        extra = sum(seconds for name, seconds in tests[test].items() if name not in made)
        phase = sum(spent) + extra > CHEAP
        if sum(spent) + extra <= limit:
            made |= set(tests[test])
            spent[phase] += extra
            found[phase].setdefault(test.split("::")[0], []).append(test)
    return [([test for names in of.values() for test in names], seconds)
            for of, seconds in zip(found, spent) if of]


# ------------------------------------------------------------------------------ trials

def failed(said: str, names: list) -> str:
    """The first test that fails, by what pytest says; `names` may be files."""
    first = re.search(r"^(?:FAILED|ERROR) (.*)", said, re.MULTILINE)
    if not first:
        return (said.strip().splitlines() or ["?"])[-1]
    known = [name for name in names if first[1].startswith(name) and "::" in name]
    return max(known, key=len, default=first[1].split(" - ")[0])


def tried(one: Mutant, folder: Path, chosen: list, broken: set) -> tuple[str, str, float]:
    """Outcome ("noticed" or "survived"), the test that noticed, seconds; in the copy `folder`.

    A test that is not SOUND, and fails without the mutant as well, becomes one of `broken`.
    """
    path, clock = folder / one.file, time.perf_counter()
    before, stat = path.read_text(), path.stat()
    kept = folder.parent / "exports"
    kept.mkdir(exist_ok=True)
    plugin = ("-p", "kept_exports") if one.package != "lib" else ()

    def attempt(names: list, seconds: float) -> tuple[int, str]:
        return pytest(folder, "-x", *plugin, *names, seconds=START + SLOW * seconds, KEPT=str(kept))

    def noticed_by() -> str:
        """The first test that fails of all that are `chosen`, or ""."""
        for tests, seconds in chosen:
            names = [name for name in tests if name not in broken]
            if not names:
                continue
            status, said = attempt(names, seconds)
            if status == UNKNOWN:  # values of parameters have changed since
                names = list(dict.fromkeys(name.split("[")[0] for name in names))
                status, said = attempt(names, 2 * seconds)
            if status == NOTHING:
                continue
            if status < 0:
                return f"time: {START + SLOW * seconds:.0f} s"
            if status:
                return failed(said, names)
        return ""

    while True:
        path.write_text(one.text)
        by = noticed_by()
        path.write_text(before)
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # so that its bytecode is good
        if "::" not in by or by in SOUND or pytest(folder, by)[0] == 0:
            return "noticed" if by else "survived", by, time.perf_counter() - clock
        broken.add(by)


def arguments() -> dict[tuple, str]:
    """Why mutants are equivalent, by file, line before and after: blocks of four lines."""
    if not EQUIVALENT.exists():
        return {}
    blocks = [block.split("\n") for block in EQUIVALENT.read_text().strip().split("\n\n")]
    return {tuple(block[:3]): " ".join(block[3:]) for block in blocks}


def run(mutants: list[Mutant], out: Path, limit: float, tests=(), seed="") -> list[dict]:
    """Rows of the table of `mutants` of a `seed`, written as they come in; `tests` instead of those
    of lines.
    """
    known, rows, broken, free = arguments(), [], set(), queue.Queue()
    tables, before = [] if tests else executed(HOME / "executed"), {}
    SOUND.update(*(table["tests"] for table in tables))
    work = out / "copies"
    shutil.rmtree(work, ignore_errors=True)
    workers = min(len(os.sched_getaffinity(0)), len(mutants))
    for made in copies(work, workers, len(mutants) > FEW):
        free.put(made)

    def one(m: Mutant) -> None:
        key = m.file, m.before, m.after
        if key in known:
            outcome, by, seconds = "equivalent", known[key], 0.0
        else:
            chosen = [(tests, limit)] if tests else phases(
                concerned(m, tables), m.file, before.setdefault(m.file, []), limit)
            folder = free.get()
            try:
                outcome, by, seconds = tried(m, folder, chosen, broken)
            finally:
                free.put(folder)
            before[m.file] = [*before.get(m.file, []), by]
        rows.append(dict(zip(COLUMNS, (seed, m.file, m.line, m.before, m.after, outcome, by,
                                       f"{seconds:.0f}"))))
        print(f"{outcome:10} {m.file}:{m.line}  {by}  {seconds:.0f} s\n    - {m.before}\n"
              f"    + {m.after}", flush=True)
        with open(out / "mutants.csv", "w", newline="") as file:
            table = csv.DictWriter(file, COLUMNS)
            table.writeheader()
            table.writerows(rows)

    try:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(one, mutants))
    finally:
        shutil.rmtree(work, ignore_errors=True)
    if broken:
        print("failing without mutants as well:", *sorted(broken), sep="\n    ")
    return rows


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("words", nargs="*", help="MODULE= COUNT= SEED= FIRST= LIMIT= OUT=")
    parser.add_argument("--change", nargs=3, metavar=("FILE", "OLD", "NEW"))
    parser.add_argument("--tests", nargs="+", default=(), help="instead of those of the line")
    given = parser.parse_args()
    words = dict(OPTIONS)
    for word in given.words:
        name, equals, value = word.partition("=")
        if name not in words or not equals or name not in ("MODULE", "OUT") and not value.isdigit():
            sys.exit(f"{word}: it takes MODULE= (of {', '.join(PACKAGES)}), OUT= and whole numbers "
                     "COUNT=, SEED=, FIRST=, LIMIT=")
        words[name] = value
    out = Path(words["OUT"]).resolve()  # tests run in copies
    out.mkdir(parents=True, exist_ok=True)
    if given.change:
        file, old, new = given.change
        text = (ROOT / file).read_text()
        if text.count(old) != 1:
            sys.exit(f"{file} holds this text {text.count(old)} times, not once")
        mutants = [mutant(file, text, text.replace(old, new))]
    else:
        mutants = drawn(words["MODULE"], int(words["COUNT"]), int(words["SEED"]))
    rows = run(mutants[int(words["FIRST"]) - 1 :], out, float(words["LIMIT"]), given.tests,
               "" if given.change else words["SEED"])
    counts = {name: sum(row["outcome"] == name for row in rows)
              for name in ("noticed", "survived", "equivalent")}
    print(f"{len(rows)} mutants: " + ", ".join(f"{n} {name}" for name, n in counts.items())
          + f"; {out / 'mutants.csv'}")


if __name__ == "__main__":
    main()
