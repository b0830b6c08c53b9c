"""Runs in processes of their own, beside this one or alone."""

import contextlib
import os
import signal
import sys

import pytest

from driver import cli, options
from driver.errors import InputError
from driver.runs import own_process

SAYS = "import sys; print('done'); print('so far', file=sys.stderr); sys.exit({})"
WAITS = "import time; print('never said'); time.sleep(600)"


@pytest.fixture(name="program")
def _program(monkeypatch):
    """program(code): what runs is Python with this code."""
    def use(code: str) -> None:
        monkeypatch.setattr(own_process, "_process", lambda *_: {
            "command": [sys.executable, "-c", code], "env": dict(os.environ)})
    return use


def test_what_a_run_beside_says_comes_after_the_block(program, capfd):
    program(SAYS.format(0))
    with own_process.run_beside({}):
        print("first", flush=True)
    assert capfd.readouterr() == ("first\ndone\n", "so far\n")


def test_the_status_of_a_run_beside_is_that_of_both(program, capfd):
    program(SAYS.format(4))
    with pytest.raises(SystemExit) as end, own_process.run_beside({}):
        pass
    assert end.value.code == 4 and capfd.readouterr().err == "so far\n"


def test_an_error_ends_the_run_beside_without_a_word(program, capfd, monkeypatch):
    """One line says what is wrong with what both are given."""
    program(WAITS)
    children, started = [], own_process.environment.started

    @contextlib.contextmanager
    def watched(*words, **more):
        with started(*words, **more) as child:
            children.append(child)
            yield child

    monkeypatch.setattr(own_process.environment, "started", watched)
    with pytest.raises(InputError, match="mistaken"), own_process.run_beside({}):
        raise InputError("mistaken")
    assert children[0].returncode == -signal.SIGTERM
    assert capfd.readouterr() == ("", "")


def test_a_run_alone_says_why_it_fails(tmp_path):
    status, words = own_process.run_alone({"scene": "modle", "out": tmp_path / "run"})
    assert status == 2 and "modle" in words


@pytest.mark.parametrize("cores, words, beside", [
    (2, [], True), (1, [], False), (2, ["NP=2"], False), (2, ["LOADING=monotone"], False)])
def test_histories_of_the_model_run_at_once(monkeypatch, cores, words, beside):
    """Where there is a core for each and ranks are not asked for."""
    at_once, here = [], []

    @contextlib.contextmanager
    def noted(pairs):
        at_once.append(pairs)
        yield

    monkeypatch.setattr(options, "CORES", cores)
    monkeypatch.setattr(cli, "run_beside", noted)
    monkeypatch.setattr(cli, "_execute", lambda pairs, *_: here.append(pairs))
    cli.model(["OUT=mine", "CELLS=2", *words])
    assert [pairs["loading"] for pairs in at_once] == ["nonmonotone"] * beside
    assert len(here) == (1 if beside or words == ["LOADING=monotone"] else 2)
    for pairs in (*here, *at_once):
        assert pairs["scene"] == "model" and pairs["cells"] == "2"
        assert pairs["out"] in (f"mine-{pairs['loading']}", "mine")
