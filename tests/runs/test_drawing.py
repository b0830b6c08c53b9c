"""Figures of a run that are drawn on another core while its errors are estimated."""

import os
import signal

import pytest

from driver import processes
from driver.runs import drawing
from driver.runs.request import Request
from driver.runs.run import Run, execute

SMALL = {"scene": "model", "loading": "nonmonotone", "cells": "2", "subdomains": "2x1",
         "steps": "2", "quiet": "yes", "fields": "no"}


def test_what_is_done_aside_is_waited_for(tmp_path):
    by = tmp_path / "by"
    with processes.aside(lambda: by.write_text(str(os.getpid()))) as done:
        assert done()
    assert by.read_text() != str(os.getpid())


def fail() -> None:
    raise MemoryError


def kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("end", [fail, kill])
def test_what_fails_aside_is_not_done(capfd, end):
    with processes.aside(end) as done:
        assert not done()
    assert capfd.readouterr() == ("", "")


def test_where_there_is_no_process_more_nothing_is_done_aside(monkeypatch):
    def refuse(_process) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(processes.FORK.Process, "start", refuse)
    with processes.aside(lambda: None) as done:
        assert not done()


def test_an_error_of_the_block_ends_what_is_done_aside(tmp_path):
    """Whoever interrupts the estimates waits for no figure."""
    started, children = processes.FORK.Process.start, []

    def noted(process) -> None:
        children.append(process)
        started(process)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(processes.FORK.Process, "start", noted)
        with processes.aside(signal.pause):
            raise KeyboardInterrupt
    assert not children[0].is_alive()


@pytest.mark.parametrize("nodes, ranks, cores, more", [
    (drawing.SMALL + 1, 1, 2, {}), (9, 2, 2, {}), (9, 1, 1, {}), (9, 1, 2, {"figures": False}),
    (9, 1, 2, {"refined": ("one",)})])
def test_nothing_is_drawn_aside(monkeypatch, tmp_path, nodes, ranks, cores, more):
    """On large bodies both would take too much memory, ranks and other work keep the cores busy,
    and cycles of refinement have a figure of their own, whose table comes later.
    """
    monkeypatch.setattr(processes, "CORES", cores)
    monkeypatch.setattr(processes, "aside", None)
    request = Request("mine", "mine.edp", {}, {}, **{"figures": True} | more)
    with drawing.drawn_aside(tmp_path, request, nodes, ranks) as drawn:
        assert not drawn()


@pytest.mark.parametrize("aside", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_run_has_its_figures_wherever_they_are_drawn(monkeypatch, tmp_path, aside):
    """Aside or, where that fails, when all is done; the seconds are those that the user waits."""
    monkeypatch.setattr(processes, "CORES", 2)
    here, draw = os.getpid(), drawing.draw
    by_this = []

    def noted(directory, *cores) -> None:
        if os.getpid() == here:
            by_this.append(directory)
        elif not aside:
            raise MemoryError
        draw(directory, *cores)

    monkeypatch.setattr(drawing, "draw", noted)
    summary = execute(Run.from_pairs(SMALL | {"out": str(tmp_path / "run"), "errors": "yes"}))
    assert len(by_this) == (0 if aside else 1)
    assert len(list((tmp_path / "run" / "figures").glob("*.png"))) >= 6
    seconds = summary["seconds"]
    assert seconds["estimates"] > 0 and seconds["figures"] > 0
    assert seconds["total"] == pytest.approx(sum(seconds.values()) - seconds["total"])
