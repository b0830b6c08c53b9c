"""Unexpected exceptions: one line that names them as a defect of the suite, and a log; what is done
stays.
"""

import errno
import json
import os
import runpy
import subprocess
import sys
import tempfile

import pytest

from driver import cli, environment
from driver.errors import Defect, write_error
from driver.files import write_json
from driver.march.quasistatic import QuasistaticSolver
from driver.report import run as page
from driver.results import summary
from driver.runs import launch, run

WORDS = ("SCENE=model", "LOADING=monotone", "CELLS=2", "SUBDOMAINS=2x1", "STEPS=3", "FIGURES=no",
         "FIELDS=no", "QUIET=yes", "ERRORS=no")


def spoil(patch, step: int) -> None:
    """Let time step `step` come to an exception that nobody has thought of."""
    advance = QuasistaticSolver._step

    def fails(self, index, *rest):
        if index == step:
            raise KeyError("no such key")
        return advance(self, index, *rest)

    patch.setattr(QuasistaticSolver, "_step", fails)


@pytest.fixture
def logs(tmp_path, monkeypatch):
    """Folder of the logs that belong to no results."""
    folder = tmp_path / "logs"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def test_a_defect_in_a_step_leaves_the_steps_before(tmp_path, monkeypatch, logs, capsys):
    """They are marked as not converged; results of a converged run stay where they are, and were
    left although its page could not be written.
    """
    asked = run.Run.from_pairs(cli.parse_pairs([*WORDS, f"OUT={tmp_path / 'out'}"]))
    with monkeypatch.context() as patch:
        patch.setattr(page, "write", lambda work: {}["no such key"])
        assert run.execute(asked)["converged"]
    assert "report.html could not be written: 'no such key'" in capsys.readouterr().err
    assert "Traceback" in (tmp_path / "out" / "run.log").read_text()
    spoil(monkeypatch, 3)
    with pytest.raises(Defect) as raised:
        run.execute(asked)
    said = str(raised.value)
    assert raised.value.exit_status == 1 and len(said.splitlines()) == 1
    for words in ("step 3: a defect of the suite", "KeyError: 'no such key'", "run.log",
                  "out-unconverged"):
        assert words in said
    left = tmp_path / "out-unconverged"
    summary = json.loads((left / "summary.json").read_text())
    assert (summary["converged"], summary["steps"]) == (False, 2)
    assert "Traceback" in (left / "run.log").read_text()
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["converged"]
    assert not list(logs.iterdir())


def test_a_defect_before_any_result_is_one_line(tmp_path, monkeypatch, logs, capsys):
    """As the command line has it: exit status 1, place of the log, nothing left at OUT."""
    spoil(monkeypatch, 1)
    monkeypatch.setattr(sys, "argv", ["driver", "run", *WORDS, f"OUT={tmp_path / 'out'}"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("driver", run_name="__main__")
    said = capsys.readouterr().err
    assert ended.value.code == 1 and len(said.splitlines()) == 1
    log, = logs.iterdir()
    assert said.startswith("error: a defect of the suite") and str(log) in said
    assert "Traceback" in log.read_text() and not list(tmp_path.glob("*out*"))


def test_a_defect_on_a_rank_is_one_line(logs):
    """What the ranks have printed goes to the log; of a rank that was killed there is none."""
    words = "Traceback (most recent call last):\n  File x\nValueError: singular\nMPI_ABORT\n"
    error = launch._why_no_answer(subprocess.CompletedProcess([], 1, "", words))
    assert isinstance(error, Defect) and "ValueError: singular" in str(error)
    log, = logs.iterdir()
    assert log.read_text() == words and str(log) in str(error)
    killed = launch._why_no_answer(subprocess.CompletedProcess([], 137, "", "mpirun noticed ..."))
    assert killed.exit_status == 2


def test_what_mpirun_says_of_ranks_that_die_without_a_word_is_kept(logs):
    """Otherwise nobody could tell why they did."""
    words = "A call to mkdir was unable to create the desired directory\n"
    error = launch._why_no_answer(subprocess.CompletedProcess([], 1, "", words))
    log, = logs.iterdir()
    assert log.read_text() == words
    assert error.exit_status == 2 and str(error).endswith(f"What it said is in {log}")


def test_an_output_that_nobody_reads_any_more_is_no_disk_error():
    """As with make run | head: the run stops with a line that says why, help without one."""
    assert "reads the output" in str(write_error(BrokenPipeError(errno.EPIPE, "Broken pipe")))
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, "-m", "driver.options"], cwd=environment.ROOT,
                          stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert done.returncode == 0 and not done.stderr


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_said_with_what_to_do(number):
    """An error of writing, unlike one of opening, names no file."""
    said = str(write_error(OSError(number, "No space left on device")))
    assert "No space left on device" in said and "OUT" in said and "FIELDS=no" in said
    other = str(write_error(OSError(errno.EACCES, "Permission denied", "out/summary.json")))
    assert "out/summary.json" in other and "FIELDS" not in other


def test_a_disk_that_estimates_fill_leaves_a_converged_run(tmp_path, monkeypatch):
    """The results were written before: they are no partial ones of a run that has failed."""
    written = []

    def fails(path, content):
        written.append(path)
        if len(written) > 1:
            raise OSError(errno.ENOSPC, "No space left on device")
        write_json(path, content)

    monkeypatch.setattr(summary, "write_json", fails)
    words = [word for word in WORDS if word not in ("ERRORS=no", "STEPS=3")]
    asked = run.Run.from_pairs(
        cli.parse_pairs([*words, "STEPS=1", "ERRORS=energy", f"OUT={tmp_path / 'out'}"]))
    left = run.execute(asked)
    assert left["converged"] and len(written) == 2
    assert [line for line in left["warnings"] if "not all errors could be estimated" in line]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.slow
def test_a_full_disk_has_the_room_of_companions_for_the_summary(tmp_path, monkeypatch):
    """What the estimates have come to is kept: their exports go before the summary is written."""
    there = []

    def looks(path, content):
        there.append((path.parent / "companions").exists())
        write_json(path, content)

    monkeypatch.setattr(summary, "write_json", looks)
    words = [word for word in WORDS if word != "ERRORS=no"]
    run.execute(run.Run.from_pairs(cli.parse_pairs([*words, "NP=1", f"OUT={tmp_path / 'out'}"])))
    assert there == [True, False]  # before the estimates and after them
