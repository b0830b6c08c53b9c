"""Small changes of meaning, made one at a time, and the tests that notice them.

    make mutants                               # 40 mutants of all numerical packages
    make mutants MODULE=qp COUNT=20 SEED=7     # of a package, a file of it, or lib (edp/lib)
    python3 tests/mutants.py --change driver/march/slip.py 'old text' 'new text'    # one by hand

Mutants of the driver are made by cosmic-ray, those of the FreeFEM library by `TEXTS`. They are
drawn without replacement, packages in turn, with the same SEED the same ones. Each is tried in a
copy of the tree, one copy a core, against the tests of `TESTS` in their order until one fails. What
survives is written with the change, to be noticed by a new test or argued equivalent: in
`tests/equivalent.txt`, a block of lines for each (file, line before, line after, argument). The
table is OUT/mutants.csv, results/mutants/mutants.csv by default.
"""

import argparse
import csv
import os
import queue
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
COPIED = ("driver", "edp", "tests", "meshes", "results/reference", "results/README.md", "README.md",
          "Makefile", "LICENSE", "apt-packages.txt", "pyproject.toml", ".github", ".ci")
TIME = 900  # seconds after which a mutant has been noticed by its slowness
INDEPENDENT = ("tests/verify/test_independent.py", "tests/scenes/test_model.py",
               "tests/scenes/test_scenes_exact.py")
# tests that concern a package, those most likely to notice first
TESTS = {
    "qp": ("tests/qp", "tests/march/test_residuals.py", "tests/feti/test_deflation.py",
           *INDEPENDENT),
    "feti": ("tests/feti", "tests/march/test_residuals.py", "tests/effects/test_free_bodies.py",
             *INDEPENDENT, "tests/results/test_energy.py"),
    "contact": ("tests/contact", "tests/qp/test_properties.py", *INDEPENDENT,
                "tests/march/test_residuals.py", "tests/scenes/test_scenes_bodies.py",
                "tests/effects"),
    "effects": ("tests/effects", *INDEPENDENT, "tests/scenes/test_scenes_model_variants.py",
                "tests/scenes/test_scenes_bodies.py"),
    "march": ("tests/march", *INDEPENDENT, "tests/effects/test_free_bodies.py",
              "tests/scenes/test_scenes_model_variants.py"),
    "results": ("tests/results", "tests/python", "tests/scenes/test_model.py",
                "tests/scenes/test_quadratic.py", "tests/scenes/test_scenes_hertz.py"),
    "estimates": ("tests/estimates",),
    "lib": ("tests/verify/test_independent.py", "tests/scene", "tests/effects", "tests/scenes"),
}
# operators of cosmic-ray: those whose mutants are no mere TypeErrors
BINARY = {"Add": ("Sub",), "Sub": ("Add",), "Mul": ("Div",), "Div": ("Mul",), "Pow": ("Mul",),
          "FloorDiv": ("Mul",), "Mod": ("Mul",), "BitAnd": ("BitOr",), "BitOr": ("BitAnd",)}
COMPARED = {"Eq": ("NotEq",), "NotEq": ("Eq",), "Lt": ("LtE", "GtE"), "LtE": ("Lt", "Gt"),
            "Gt": ("GtE", "LtE"), "GtE": ("Gt", "Lt")}
OPERATORS = (*(f"ReplaceBinaryOperator_{a}_{b}" for a, others in BINARY.items() for b in others),
             *(f"ReplaceComparisonOperator_{a}_{b}" for a, others in COMPARED.items()
               for b in others), "ReplaceUnaryOperator_Delete_USub",
             "ReplaceUnaryOperator_Delete_Not", "ReplaceUnaryOperator_Delete_Invert", "AddNot",
             "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr",
             "ReplaceOrWithAnd", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak",
             "NumberReplacer", "ZeroIterationForLoop")
# of the FreeFEM library: pattern and what it becomes
TEXTS = (
    (r"(?<![\w.])(?!0\.(?!\d))\d+\.\d*(?![\w.])", lambda m: f"({m[0]} * 1.01)"),  # a factor
    (r"(?<=[\w)\]]) - (?=[\w(\[])", lambda m: " + "),
    (r"(?<=[\w)\]]) \+ (?=[\w(\[])", lambda m: " - "),
    (r"(?<=[=(,] )-(?=[\w(])|(?<=[=(])-(?=[\w(])", lambda m: ""),
    (r"(?<=; )\w+ < [\w.]+(?=;)", lambda m: f"{m[0]} - 1"),  # the last element
    (r"\blabel\b(?! *[=(])", lambda m: "(label + 1)"),
    (r"\bmax\(", lambda m: "min("), (r"\bmin\(", lambda m: "max("),
    (r" > ", lambda m: " < "), (r" && ", lambda m: " || "),
)
COLUMNS = ("file", "line", "before", "after", "outcome", "noticed by", "seconds")
OPTIONS = {"MODULE": "", "COUNT": "40", "SEED": "1", "OUT": str(ROOT / "results" / "mutants")}
SOUND = set()  # tests that are known to pass without mutants
EQUIVALENT = ROOT / "tests" / "equivalent.txt"


@dataclass(frozen=True)
class Mutant:
    """A file (relative to the tree) and its changed text; the line that changes."""

    file: str
    text: str
    line: int
    before: str
    after: str

    @property
    def package(self) -> str:
        """Key of `TESTS`."""
        return "lib" if self.file.startswith("edp") else self.file.split("/")[1]


def mutant(file: str, text: str, changed: str) -> Mutant:
    """The mutant that makes `changed` of `text`; lines of more than one are joined."""
    before, after = text.splitlines(), changed.splitlines()
    start = next(k for k, pair in enumerate(zip(before, after)) if pair[0] != pair[1])
    stop = next(k for k, pair in enumerate(zip(before[::-1], after[::-1])) if pair[0] != pair[1])
    return Mutant(file, changed, start + 1, *(" ".join(
        line.strip() for line in lines[start : max(len(lines) - stop, start + 1)])
        for lines in (before, after)))


def of_python(path: Path, rng: random.Random) -> list:
    """Functions without arguments that make the mutants of a module, five of an operator at most.
    """
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    text, file, made = path.read_text(), str(path.relative_to(ROOT)), []
    nodes, lines = list(ast_nodes(get_ast(text))), text.splitlines()
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        starts = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        places = [k for k, (line, _) in enumerate(starts) if not _idle(lines[line - 1])]
        for place in rng.sample(places, min(len(places), 5)):
            made.append(lambda operator=operator, place=place: mutant(
                file, text, mutate_code(text, operator, place)))
    return made


def _idle(line: str) -> bool:
    """Whether a change there is none of meaning: hints of types, messages."""
    return bool(re.match(r"\s*(def |class |\w+: |f?\"|raise )", line) or ") -> " in line)


def of_freefem(path: Path) -> list:
    """As `of_python`, of an include; comments and lines with messages stay."""
    text, file, made = path.read_text(), str(path.relative_to(ROOT)), []
    lines = text.split("\n")
    for number, line in enumerate(lines):
        code = line.split("//")[0]
        for pattern, become in TEXTS if '"' not in code else ():
            for match in re.finditer(pattern, code):
                new = line[:match.start()] + become(match) + line[match.end():]
                new = "\n".join([*lines[:number], new, *lines[number + 1:]])
                made.append(lambda new=new: mutant(file, text, new))
    return made


def files(module: str) -> dict[str, list[Path]]:
    """Files to mutate by package; `module` is a package, a file of one, or empty for all."""
    every = {name: sorted((ROOT / "driver" / name).glob("*.py")) for name in TESTS if name != "lib"}
    every["lib"] = sorted((ROOT / "edp" / "lib").rglob("*.idp"))
    if module in ("", *every):  # a package rather than a file of the same name
        return every if module == "" else {module: every[module]}
    chosen = {name: [path for path in paths
                     if path.match(module) or path.stem == module.removesuffix(".py")]
              for name, paths in every.items()}
    chosen = {name: paths for name, paths in chosen.items() if paths}
    if not chosen:
        sys.exit(f"MODULE={module} is none of {', '.join(every)}, nor a file of them")
    return chosen


def drawn(module: str, count: int, seed: int) -> list[Mutant]:
    """`count` mutants, packages in turn."""
    rng, decks = random.Random(seed), []
    for paths in files(module).values():
        deck = [one for path in paths
                for one in (of_freefem(path) if path.suffix == ".idp" else of_python(path, rng))]
        rng.shuffle(deck)
        decks.append(deck)
    chosen = []
    while len(chosen) < count and any(decks):
        chosen += [deck.pop() for deck in decks if deck]
    return [make() for make in chosen[:count]]


def copy(folder: Path) -> Path:
    """A copy of what the tests need, compiled."""
    for name in COPIED:
        source, target = ROOT / name, folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.exists():
            shutil.copy2(source, target)
    subprocess.run([sys.executable, "-m", "compileall", "-q", "driver"], cwd=folder, check=True)
    return folder


def tested(folder: Path, tests, broken=()) -> tuple[bool, str]:
    """Whether all `tests` pass in the copy `folder`, but for `broken` ones; the first that fails.
    """
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": "",
                   "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--basetemp",
               str(folder / "made"), "--tb=no", "-rfE", *tests]
    command += [word for name in broken for word in ("--deselect", name)]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, env=environment, start_new_session=True) as child:
        try:
            said = child.communicate(timeout=TIME)[0]
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            return False, f"takes more than {TIME} s"
    first = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
    return child.returncode == 0, first[1] if first else (said.strip().splitlines() or [""])[-1]


def tried(one: Mutant, folder: Path, broken: set, tests=()) -> tuple[str, str, float]:
    """Outcome ("noticed" or "survived"), the test that noticed, seconds; in the copy `folder`.

    A test that fails without the mutant as well notices nothing: it becomes one of `broken`.
    """
    path, clock = folder / one.file, time.perf_counter()
    before, stat = path.read_text(), path.stat()
    tests = tests or TESTS[one.package]
    while True:
        path.write_text(one.text)
        passed, by = tested(folder, tests, broken)
        path.write_text(before)
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # so that its bytecode is good
        seconds = time.perf_counter() - clock
        if passed:
            return "survived", "", seconds
        if "::" not in by or by in SOUND or tested(folder, [by])[0]:
            SOUND.add(by)
            return "noticed", by, seconds
        broken.add(by)


def arguments() -> dict[tuple, str]:
    """Why mutants are equivalent, by file, line before and after: blocks of four lines."""
    if not EQUIVALENT.exists():
        return {}
    blocks = [block.split("\n") for block in EQUIVALENT.read_text().strip().split("\n\n")]
    return {tuple(block[:3]): " ".join(block[3:]) for block in blocks}


def run(mutants: list[Mutant], out: Path, tests=()) -> list[dict]:
    """Rows of the table of `mutants`, written as they come in."""
    known, rows, broken, copies = arguments(), [], set(), queue.Queue()
    work = out / "copies"
    shutil.rmtree(work, ignore_errors=True)
    workers = len(os.sched_getaffinity(0))
    for k in range(min(workers, len(mutants))):
        copies.put(copy(work / str(k)))

    def one(m: Mutant) -> None:
        key = m.file, m.before, m.after
        if key in known:
            outcome, by, seconds = "equivalent", known[key], 0.0
        else:
            folder = copies.get()
            try:
                outcome, by, seconds = tried(m, folder, broken, tests)
            finally:
                copies.put(folder)
        rows.append(dict(zip(COLUMNS, (m.file, m.line, m.before, m.after, outcome, by,
                                       f"{seconds:.0f}"))))
        print(f"{outcome:10} {m.file}:{m.line}  {by}\n    - {m.before}\n    + {m.after}",
              flush=True)
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
    parser.add_argument("words", nargs="*", help="MODULE= COUNT= SEED= OUT=")
    parser.add_argument("--change", nargs=3, metavar=("FILE", "OLD", "NEW"))
    parser.add_argument("--tests", nargs="+", default=(), help="instead of those of the package")
    given = parser.parse_args()
    words = dict(OPTIONS)
    for word in given.words:
        name, equals, value = word.partition("=")
        if name not in words or not equals or name in ("COUNT", "SEED") and not value.isdigit():
            sys.exit(f"{word}: it takes MODULE=, COUNT=, SEED= (whole numbers) and OUT=")
        words[name] = value
    out = Path(words["OUT"])
    out.mkdir(parents=True, exist_ok=True)
    if given.change:
        file, old, new = given.change
        text = (ROOT / file).read_text()
        if text.count(old) != 1:
            sys.exit(f"{file} holds this text {text.count(old)} times, not once")
        mutants = [mutant(file, text, text.replace(old, new))]
    else:
        mutants = drawn(words["MODULE"], int(words["COUNT"]), int(words["SEED"]))
    rows = run(mutants, out, given.tests)
    counts = {name: sum(row["outcome"] == name for row in rows)
              for name in ("noticed", "survived", "equivalent")}
    print(f"{len(rows)} mutants: " + ", ".join(f"{n} {name}" for name, n in counts.items())
          + f"; {out / 'mutants.csv'}")


if __name__ == "__main__":
    main()
