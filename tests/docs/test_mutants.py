"""make mutants: its choices, and the table of what the tests notice."""

import csv
import re
from functools import cache

import mutants
import mutations
import pytest

from driver.environment import ROOT

REFERENCE = ROOT / "results" / "reference" / "mutants.csv"
AIM = 0.08  # share that may survive without an argument


@cache
def table() -> list[dict]:
    with open(REFERENCE, newline="") as file:
        return list(csv.DictReader(file))


@cache
def names_in(file: str) -> set[str]:
    return set(re.findall(r"^def (test_\w+)", (ROOT / file).read_text(), re.MULTILINE))


# where files, and whole packages, stood when the table's lines were drawn from the packages
DRAWN_FROM = {"driver/march/free_bodies.py": "driver/effects/free_bodies.py"}
PARTS = {"energy_norm": "estimates", "validity": "estimates"}


def test_the_reference_table_meets_the_aim():
    """Of at least 300, of all packages alike; what is noticed is so by a test that is there."""
    rows = table()
    assert len(rows) >= 300
    packages = [mutations.package(DRAWN_FROM.get(row["file"], row["file"])) for row in rows]
    packages = [PARTS.get(name, name) for name in packages]
    counts = {name: packages.count(name) for name in mutations.PACKAGES if name not in PARTS}
    assert max(counts.values()) - min(counts.values()) <= 3
    assert sum(row["outcome"] == "survived" for row in rows) <= AIM * len(rows)
    for row in table():
        if row["outcome"] == "noticed" and not row["noticed by"].startswith("time"):
            file, name = re.match(r"(.*?\.py)(?:::(\w+))?", row["noticed by"]).groups()
            assert (ROOT / file).exists() and (not name or name in names_in(file)), row


def test_what_is_called_equivalent_has_its_argument():
    known = mutants.arguments()
    assert all(known.values())
    for row in table():
        key = row["file"], row["before"], row["after"]
        assert (row["outcome"] == "equivalent") == (key in known), key


def test_a_line_concerns_the_tests_that_execute_it(monkeypatch, tmp_path):
    """Its own function's line above it where it is none that is executed; outside of functions all
    of the file and of the package; of the library all that read the file.
    """
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    (tmp_path / "driver" / "qp").mkdir(parents=True)
    (tmp_path / "driver" / "qp" / "some.py").write_text(
        "LIMIT = 3\n\n\ndef one(x):\n    y = x + (\n        LIMIT)\n    return y\n\n\n"
        "def two(x):\n    return -x\n")
    costs = {"tests/qp/test_a.py::test_1": 0.5, "tests/qp/test_a.py::test_2": 0.1,
             "tests/qp/test_b.py::test_3": 0.1, "tests/feti/test_c.py::test_4": 0.1}
    tables = [{"tests": {name: {name: seconds} for name, seconds in costs.items()},
               "lines": {"driver/qp/some.py": {"y = x + (": "1", "return y": "1",
                                               "return -x": "2"}}}]

    def of(line: int) -> list[str]:
        one = mutations.Mutant("driver/qp/some.py", "", line, "", "")
        return sorted(name[-1] for name in mutants.concerned(one, tables))

    assert of(6) == of(7) == ["1"] and of(11) == ["2"] and of(1) == ["1", "2", "3"]


def test_cheap_tests_and_those_of_the_package_come_first():
    """What several need is paid once; LIMIT ends the list."""
    shared = {"run": 3.0}
    costs = {"tests/scenes/test_a.py::test_1": {"a1": 0.1} | shared,
             "tests/scenes/test_a.py::test_2": {"a2": 0.1} | shared,
             "tests/qp/test_b.py::test_3": {"b3": 2.0}, "tests/feti/test_c.py::test_4": {"c": 0.2},
             "tests/march/test_d.py::test_5": {"d": 50.0},
             "tests/march/test_d.py::test_6": {"e": 9.0}}
    (first, spent), (then, more) = mutants.phases(costs, "driver/qp/some.py", [], 20.0)
    assert [name[-1] for name in first] == ["4", "3", "1", "2"]
    assert spent == pytest.approx(5.4)
    assert [name[-1] for name in then] == ["6"] and more == pytest.approx(9.0)
    before = mutants.phases(costs, "driver/qp/some.py", ["tests/march/test_d.py::test_6"], 20.0)
    assert before[0][0][0][-1] == "6"


@pytest.mark.parametrize("said, name", [
    ("FAILED tests/a.py::test_x[1 - t] - assert 0", "tests/a.py::test_x[1 - t]"),
    ("..F\nERROR tests/a.py::test_y\n1 error", "tests/a.py::test_y"),
    ("no tests ran in 0.01s", "no tests ran in 0.01s")])
def test_the_test_that_noticed_is_named(said, name):
    names = ["tests/a.py::test_x[1]", "tests/a.py::test_x[1 - t]", "tests/a.py::test_y"]
    assert mutants.failed(said, names) == name


def test_changes_are_of_meaning():
    """Neither hints of types, decorators and messages, nor what Python cannot read."""
    for line in ("@dataclass(frozen=True)", "def f(x: int = 3):", '    f"{1 + x} nodes"',
                 'raise InputError("1")', "    x: int = 3", 'words = f"{2 * x}"'):
        assert mutations._idle(line)
    assert not mutations._idle("    x = 2 * y  # half")
    one = mutations.mutant("driver/qp/a.py", "x = 1\ny = 2\n", "x = 1\ny = 3\n")
    assert (one.line, one.before, one.after, one.package) == (2, "y = 2", "y = 3", "qp")
    assert mutations._compiles(one)
    assert not mutations._compiles(mutations.mutant("driver/qp/a.py", "y = 2\n", "y = = 2\n"))
    for after, alike in (("x.reshape(n, - 2).T", True), ("x.reshape(n, -1)", False)):
        assert mutations._alike(mutations.Mutant("", "", 1, "x.reshape(n, -1).T", after)) == alike


@pytest.mark.parametrize("answers, outcome", [
    ([(0, "")], "survived"),
    ([(1, "FAILED tests/qp/test_a.py::test_x[2] - assert 0")], "noticed"),
    ([(-9, "")], "noticed"),  # it takes too long
    ([(5, "3 deselected")], "survived"),  # none of them is to be run
    ([(4, "not found"), (0, "")], "survived"),  # parameters have other values by now
    ([(4, "not found"), (1, "ERROR tests/qp/test_a.py::test_x[3]")], "noticed")])
def test_only_a_test_that_fails_notices(monkeypatch, tmp_path, answers, outcome):
    """And the file is afterwards what it was."""
    tree, remaining, file = tmp_path / "0", list(answers), "driver/qp/some.py"
    (tree / "driver" / "qp").mkdir(parents=True)
    (tree / file).write_text("x = 1\n")
    name, seen = "tests/qp/test_a.py::test_x[2]", []

    def answer(folder, *words, **_):
        seen.append(((folder / file).read_text(), words[-1]))
        return remaining.pop(0) if remaining else (0, "")  # without the mutant

    monkeypatch.setattr(mutants, "pytest", answer)
    monkeypatch.setattr(mutants, "SOUND", {name})
    one = mutations.Mutant(file, "x = 2\n", 1, "x = 1", "x = 2")
    found, by, _ = mutants.tried(one, tree, [([name], 1.0)], set())
    assert found == outcome and bool(by) == (outcome == "noticed")
    assert (tree / file).read_text() == "x = 1\n" and seen[0] == ("x = 2\n", name)
    if len(answers) == 2:
        assert seen[1] == ("x = 2\n", "tests/qp/test_a.py::test_x")
