"""The hard cases: the fast ones as the suite judges them, and that the suite notices what goes
wrong."""

import time
from dataclasses import replace

import numpy as np
import pytest

from driver.errors import DriverError
from driver.files import read_rows
from driver.hard import case as cases
from driver.hard import random, suite
from driver.hard.case import Case, Outcome
from driver.hard.checks import Check, face_condition, holds, laws
from driver.runs import run

SMALL = {"SUBDOMAINS": "2x1", "CELLS": 2, "STEPS": 2}
PLAIN = Case("plain", "hard/block", SMALL, sizes=({}, {"CELLS": 3}), checks=(laws(1e-6),))
FAST = [case for case in suite.cases() if case.fast]


def run_here(case, size, directory) -> Outcome:
    """`cases.run_scene` without the time that a process of its own takes to start."""
    pairs = {name.lower(): value for name, value in case.arguments(size).items()}
    clock, status, message = time.perf_counter(), 0, ""
    try:
        run.execute(run.Run.from_pairs({**pairs, "scene": case.scene, "out": str(directory)}))
    except DriverError as problem:
        status, message = problem.exit_status, str(problem)
    seconds = time.perf_counter() - clock
    return cases.read_results(Outcome(status, message, seconds, directory))


@pytest.fixture
def here(monkeypatch):
    """Cases run in this process; `make hard` and test_report give each one of its own."""
    monkeypatch.setattr(cases, "run_scene", run_here)


@pytest.mark.parametrize("case", [
    # a third by default
    pytest.param(case, id=case.name, marks=[pytest.mark.slow] * (number % 3 > 0))
    for number, case in enumerate(FAST)])
@pytest.mark.usefixtures("here")
@pytest.mark.some(2)
def test_fast(case, tmp_path):
    row = suite.judge(case, case.sizes[0], tmp_path)
    assert row.status == ("refused" if case.status else "solved"), row.why


@pytest.mark.slow
@pytest.mark.parametrize("family", [name for name in suite.FAMILIES if name != random.FAMILY])
def test_family(family, tmp_path):
    suite.run_suite({"family": family, "out": str(tmp_path / "hard")})


def test_every_case_says_what_is_expected():
    everyone = suite.cases()
    assert len({case.name for case in everyone}) == len(everyone)
    for case in everyone:
        assert len(case.sizes) >= 2, case.name
        assert bool(case.reason) == bool(case.status) and bool(
            case.checks) != bool(case.status), case.name


@pytest.mark.parametrize("change, why", [
    ({}, ""),
    ({"checks": (lambda *_: Check("a false oracle", 2e-6, 1e-6),)}, "false oracle"),
    ({"checks": (holds("a false claim", lambda outcome: False),)}, "false claim"),
    ({"checks": ()}, "no oracle"),
    ({"kkt": 1e-30}, "KKT residual"),
    ({"status": 3, "reason": "moves"}, "."),
    ({"easy": {"CELLS": 1}, "ratio": 0.1}, "easy reference"),
    ({"warning": "the moon"}, "no warning"),
    ({"seconds": 0.05, "perform": cases.run_scene}, "killed"),
    ({"options": {**SMALL, "HOLD": "none", "FRICTION": 0.1}}, "no equilibrium"),
    ({"options": {**SMALL, "HOLD": "none", "FRICTION": 0.1},
     "status": 3, "reason": "the moon"}, "no equilibrium"),
    ({"options": {**SMALL, "HOLD": "none", "FRICTION": 0.1},
     "status": 2, "reason": "no equilibrium"}, "no equilibrium"),
    ({"perform": lambda case, size, folder: Outcome(
        1, "Traceback", 0.0, folder, crashed=True), "status": 1}, "Traceback"),
], ids=lambda value: "" if isinstance(value, dict) else value or "solved")
@pytest.mark.usefixtures("here")
@pytest.mark.some(2)
def test_judge(change, why, tmp_path):
    """A case fails for each of the things it can do wrong, and says which."""
    case = replace(PLAIN, **change)
    row = suite.judge(case, case.sizes[0], tmp_path)
    assert row.status == ("FAILED" if why else "solved"), row.why
    assert why in row.why or why == "."


def test_laws_notice_wrong_forces(tmp_path):
    """The assembled body tells contact forces that are off by a thousandth from the right ones."""
    def spoil(case, size, folder):
        outcome = suite.run_case(replace(case, perform=None), size, folder)
        outcome.contact["sigma_n"][-1] *= 1.001
        return outcome

    row = suite.judge(replace(PLAIN, perform=spoil), {}, tmp_path)
    assert row.status == "FAILED" and "laws" in row.why


@pytest.mark.slow
def test_report(command, tmp_path):
    done = command("hard", "FAMILY=contact", "CASE=zero load", "FAST=yes", f"OUT={tmp_path}")
    assert done.returncode == 0, done.stderr
    rows = read_rows(tmp_path / "report.csv")
    assert [(row["case"], row["status"], row["exit"])
             for row in rows] == [("zero load", "solved", "0")]
    assert (tmp_path / "report.png").stat().st_size > 0
    for words in (("FAMILY=moon",), ("CASE=moon",), ("JOBS=0",), ("FAST=maybe",), ("MOON=1",)):
        done = command("hard", *words)
        assert done.returncode == 2 and done.stderr.startswith(
            "error: ") and "Traceback" not in done.stderr


def test_condition_of_a_known_operator():
    """Ritz values of a diagonal operator with few distinct values are exact."""
    class Diagonal:
        values = np.array([1.0, 4.0, 4.0, 25.0, 1e9])

        def apply(self, x):
            return self.values * x

    free = np.array([True] * 4 + [False])
    assert np.isclose(face_condition(Diagonal(), lambda r, free: r, free), 25.0, rtol=1e-10)
    assert np.isclose(face_condition(Diagonal(), lambda r, free: r / \
                      np.sqrt(Diagonal.values), free), 5.0, rtol=1e-10)
    assert np.isnan(face_condition(Diagonal(), lambda r, free: r, np.zeros(5, bool)))
