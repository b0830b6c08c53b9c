"""Seconds of the stages of a run: each is booked once, under its own name."""

import time

import pytest
from mpi4py import MPI

from driver.march import uniqueness
from driver.march.problem import assemble
from driver.options import Settings
from driver.scene import freefem

SMALL = {"loading": "nonmonotone", "cells": 2, "steps": 2}
SEARCH = 0.3  # seconds


def test_a_search_for_other_solutions_has_its_own_seconds(solved):
    examined, not_examined = (solved("model", **SMALL, uniqueness=choice).summary["seconds"]
                              for choice in ("yes", "no"))
    assert examined["uniqueness"] > 0 and "uniqueness" not in not_examined
    for seconds in (examined, not_examined):
        stages = sum(value for name, value in seconds.items() if name != "total")
        assert seconds["total"] == pytest.approx(stages)
        assert min(seconds.values()) >= 0


def test_the_steps_are_not_charged_for_it(tmp_path, monkeypatch):
    """With a slow search the steps take what they take."""
    freefem.export(freefem.find_scene("model"), tmp_path / "export",
                   {name: str(value) for name, value in SMALL.items()})
    problem = assemble(tmp_path / "export", MPI.COMM_SELF)
    monkeypatch.setattr(uniqueness.Uniqueness, "examine", lambda *_: time.sleep(SEARCH))
    solver = problem.solver(Settings(uniqueness="yes"))
    clock = time.perf_counter()
    assert len(list(solver.steps())) == 2
    spent, history = time.perf_counter() - clock, solver.history
    assert history.examining >= 2 * SEARCH
    assert history.seconds + history.examining <= spent
    assert history.seconds <= spent - 2 * SEARCH
