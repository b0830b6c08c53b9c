"""Figures drawn by several processes, each once, and work done ahead of this process in turn; what
others cannot do, this one does.
"""

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from driver import children, processes

NAMES = ["geometry", "loading", "deformed", "history", "convergence"]


@pytest.fixture
def noted(tmp_path):
    """noted(name): leaves a file of this name in which the process stands, a line for every time.
    """
    def note(name: str) -> None:
        with open(tmp_path / name, "a", encoding="utf-8") as file:
            file.write(f"{os.getpid()}\n")

    note.read = lambda: {path.name: path.read_text().split() for path in tmp_path.iterdir()}
    return note


@pytest.mark.parametrize("cores, count", [(1, 1), (2, 2), (3, 3), (9, 5)])
def test_every_figure_is_drawn_once(noted, cores, count):
    processes.share(noted, NAMES, cores)
    drawn = noted.read()
    assert sorted(drawn) == sorted(NAMES) and all(len(by) == 1 for by in drawn.values())
    assert len({by[0] for by in drawn.values()}) == count


def test_no_figure_is_none():
    processes.share(None, [])


def fail(_name: str) -> None:
    """As drawing does for want of memory."""
    raise MemoryError


@pytest.mark.parametrize("end", [fail, lambda _: os.kill(os.getpid(), signal.SIGKILL),
                                 lambda _: os.kill(os.getpid(), signal.SIGTERM)])
def test_what_another_process_cannot_draw_is_drawn_here(noted, capfd, end):
    here = os.getpid()
    processes.share(lambda name: (noted if os.getpid() == here else end)(name), NAMES, 3)
    assert noted.read() == {name: [str(here)] for name in NAMES}
    assert capfd.readouterr() == ("", "")


def test_where_there_is_no_process_more_all_are_drawn_here(noted, monkeypatch):
    def refuse(_process) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(processes.FORK.Process, "start", refuse)
    processes.share(noted, NAMES, 2)
    assert noted.read() == {name: [str(os.getpid())] for name in NAMES}


def test_an_error_is_that_of_this_process_and_leaves_no_process_behind():
    here = os.getpid()

    def wait(name: str) -> None:
        if os.getpid() != here:
            signal.pause()
        raise ValueError(name)

    with pytest.raises(ValueError, match="geometry"):
        processes.share(wait, NAMES, 2)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("start", [
    "with processes.aside(wait): wait()",
    "processes.share(wait, ['first', 'other'], 2)",
    "processes.Series(wait, 1); wait()"])
def test_a_process_that_helps_ends_with_the_one_it_helps(start):
    """It holds the lock of the result directory, and nobody waits for what it draws."""
    script = f"""
import os, signal
from driver import processes
def wait(*_):
    os.write(1, f"{{os.getpid()}}\\n".encode())
    signal.pause()
{start}
"""
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        other, = {int(run.stdout.readline()), int(run.stdout.readline())} - {run.pid}
        run.kill()
        try:
            assert run.communicate(timeout=30)[0] == ""  # the last of them has closed it
        except subprocess.TimeoutExpired:
            os.kill(other, signal.SIGKILL)
            raise


def test_another_process_does_one_after_the_other():
    """Answers may be asked for in any order, and more than once."""
    series = processes.Series(lambda number: (number, os.getpid()), 3)
    answers = [series.wait(number) for number in (2, 0, 1, 0)]
    series.close()
    assert [number for number, _ in answers] == [2, 0, 1, 0]
    assert len({by for _, by in answers} - {os.getpid()}) == 1
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("end", [fail, lambda _: os.kill(os.getpid(), signal.SIGKILL)])
def test_what_another_process_has_not_come_to_has_no_answer(capfd, end):
    series = processes.Series(lambda number: end(number) if number else "done", 3)
    assert [series.wait(number) for number in range(3)] == ["done", None, None]
    series.close()
    assert capfd.readouterr() == ("", "")


def test_where_there_is_no_process_more_there_are_no_answers(monkeypatch):
    def refuse(_process) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(processes.FORK.Process, "start", refuse)
    series = processes.Series(abs, 2)
    assert series.wait(1) is None
    series.close()


@pytest.mark.parametrize("handler", [signal.SIG_DFL, signal.SIG_IGN])
def test_a_program_that_works_ahead_has_ended_once_a_series_is_closed(tmp_path, monkeypatch,
                                                                      handler):
    """Its folder is removed next. So it is where the process that closes it ignores signals."""
    monkeypatch.setattr(children, "PATIENCE", 60)  # it is not asked twice
    before = signal.signal(signal.SIGTERM, handler)
    try:
        _close_while_it_works(tmp_path)
    finally:
        signal.signal(signal.SIGTERM, before)


def _close_while_it_works(tmp_path) -> None:
    code = f"import time; open({str(tmp_path / 'at-work')!r}, 'w').close(); time.sleep(60)"
    series = processes.Series(
        lambda _: children.run_child([sys.executable, "-c", code]).returncode, 1)
    while not (tmp_path / "at-work").exists():
        time.sleep(0.01)
    clock = time.monotonic()
    series.close()
    assert time.monotonic() - clock < 30  # half of what it would take by itself
    listed = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True)
    assert str(tmp_path / "at-work") not in listed.stdout


def test_what_is_done_ahead_has_the_priority_of_what_waits_for_it():
    """With a lower one a run waits for it without end on a machine where others compute."""
    series = processes.Series(lambda _: os.nice(0), 1)
    assert series.wait(0) == os.nice(0)
    series.close()
