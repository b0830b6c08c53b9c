"""What a run may replace, take up and write to: its own results, and nothing of anybody else.

Attacks are carried out as another user could who may write to the directory that OUT lies in.
"""

import io
import json
import os
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from driver import children, cli, environment
from driver.errors import InputError
from driver.estimates import alternatives, companions, prices
from driver.march import checkpoint
from driver.runs import guard, run, solve, watch, workspace

STRANGER = 12345  # another user's number
WORDS = ("SCENE=model", "LOADING=monotone", "CELLS=2", "SUBDOMAINS=2x1", "STEPS=2", "FIGURES=no",
         "FIELDS=no", "QUIET=yes")
SUMMARY = json.dumps({"scene": "model", "units": {}, "seconds": {}, "converged": True})


def execute(*words: str) -> run.Run:
    """The run after it has been executed; the later of equal names counts."""
    chosen = {word.split("=")[0]: word for word in (*WORDS, "ERRORS=no", *words)}
    asked = run.Run.from_pairs(cli.parse_pairs([*chosen.values()]))
    run.execute(asked)
    return asked


def results(out: Path, summary: str = SUMMARY) -> Path:
    """A directory that an earlier run has left."""
    out.mkdir()
    (out / "summary.json").write_text(summary)
    (out / "history.csv").write_text("step\n")
    return out


def tree(folder: Path) -> dict:
    """Names and contents of everything in a folder, links as such."""
    return {str(path.relative_to(folder)): os.readlink(path) if path.is_symlink()
            else path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


# ---- OUT -----------------------------------------------------------------------------------------

def foreign_file(out):
    (results(out) / "thesis.tex").write_text("years")


def foreign_folder(out):
    (results(out) / "mine").mkdir()


def foreign_figure(out):
    (results(out) / "figures").mkdir()
    (out / "figures" / "own.png").write_text("drawn by hand")


def foreign_page(out):
    (results(out) / "report.html").write_text("<!doctype html><title>mine</title>")


def foreign_link(out):
    (results(out) / "contact.csv").symlink_to("/etc/passwd")


def any_summary(out):
    results(out, '{"converged": true}')


def damaged_summary(out):
    results(out, "{")


def unconverged_place(out):
    out.with_name("out-unconverged").mkdir()
    (out.with_name("out-unconverged") / "thesis.tex").write_text("years")


def a_file(out):
    out.write_text("mine")


def dangling(out):
    out.symlink_to("nowhere")


def loop(out):
    out.symlink_to("out")


def link_to_others(out):
    out.with_name("real").mkdir()
    (out.with_name("real") / "thesis.tex").write_text("years")
    out.symlink_to("real")


def strangers_link(out):
    out.with_name("real").mkdir()
    out.symlink_to("real")
    os.lchown(out, STRANGER, STRANGER)


ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")


@pytest.mark.parametrize("make", [
    foreign_file, foreign_folder, foreign_figure, foreign_page, foreign_link, any_summary,
    damaged_summary, unconverged_place, a_file, dangling, loop, link_to_others,
    pytest.param(strangers_link, marks=ROOT)])
def test_what_is_no_run_is_refused_before_work_begins(tmp_path, make):
    make(tmp_path / "out")
    before = tree(tmp_path)
    with pytest.raises(InputError, match="OUT="):
        workspace.Workspace(tmp_path / "out")
    assert tree(tmp_path) == before


@pytest.mark.parametrize("out", ["/", "/proc/foo", "/proc/self/foo", "/dev/null", ".", "..",
                                 "a;b", "x" * 300])
def test_places_that_cannot_be(tmp_path, monkeypatch, out):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="OUT=|cannot write"):
        workspace.Workspace(Path(out))
    assert not tree(tmp_path)


def test_a_link_to_a_run_stays_and_the_run_is_replaced(tmp_path):
    results(tmp_path / "real")
    (tmp_path / "out").symlink_to("real")
    assert execute(f"OUT={tmp_path / 'out'}").out == tmp_path / "real"
    assert (tmp_path / "out").is_symlink() and not guard.foreign(tmp_path / "real")
    assert json.loads((tmp_path / "real" / "summary.json").read_text())["steps"] == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "real"]


@pytest.mark.slow
@pytest.mark.parametrize("words", [("FIGURES=yes", "FIELDS=yes"), ("ADAPT=1", "SCENE=bracket"),
                                   ("MAX_FIXED_POINT=1",)], ids=["all", "adapted", "partial"])
@pytest.mark.some(1)
def test_a_run_finds_nothing_foreign_in_what_a_run_leaves(tmp_path, words):
    given = {word.split("=")[0]: word for word in (*WORDS, *words)}
    if "ADAPT=1" in words:
        given = {name: word for name, word in given.items() if name not in ("LOADING", "CELLS")}
        given |= {"H": "H=16", "SUBDOMAINS": "SUBDOMAINS=2"}
    try:
        run.execute(run.Run.from_pairs(cli.parse_pairs([*given.values(), "ERRORS=energy",
                                                        f"OUT={tmp_path / 'out'}"])))
    except run.error_of(4, "").__class__:
        assert "MAX_FIXED_POINT=1" in words
    assert guard.foreign(tmp_path / "out") == guard.obstacle(tmp_path / "out") == ""


@pytest.mark.parametrize("make", [foreign_file, a_file, dangling])
def test_what_comes_to_be_there_during_a_run_loses_neither(tmp_path, monkeypatch, capsys, make):
    """The finished results go beside it, and a line says where."""
    complete = run._complete

    def meanwhile(*rest):
        make(tmp_path / "out")
        complete(*rest)

    monkeypatch.setattr(run, "_complete", meanwhile)
    done = execute(f"OUT={tmp_path / 'out'}")
    assert done.out.name == "out-2" and (done.out / "summary.json").exists()
    assert "out-2" in capsys.readouterr().err
    assert tree(tmp_path).keys() & {"out/thesis.tex", "out"}


def test_directories_that_were_made_go_again(tmp_path):
    with pytest.raises(InputError):
        execute(f"OUT={tmp_path / 'a' / 'b' / 'out'}", "FRICTION=x")
    assert not tree(tmp_path)


def test_a_home_directory_that_the_shell_left(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    asked = run.Run.from_pairs(cli.parse_pairs(["SCENE=model", "OUT=~/mine"]))
    assert asked.out == tmp_path / "mine"


def test_figures_that_fail_leave_the_results(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("driver.figures.draw_run", lambda work, *_more, **_options: 1 / 0)
    assert (execute(f"OUT={tmp_path / 'out'}", "FIGURES=yes").out / "summary.json").exists()
    assert "division by zero" in capsys.readouterr().err


# ---- estimates -----------------------------------------------------------------------------------

@pytest.mark.parametrize("failure", [ValueError("Singular\nmatrix"), MemoryError(),
                                     InputError("refused")])
@pytest.mark.some(2)
def test_estimates_that_fail_leave_the_results_with_a_warning(tmp_path, monkeypatch, failure):
    """Whatever goes wrong in a companion of a run that has converged."""
    def fail(*_):
        raise failure

    monkeypatch.setattr(companions, "assess", fail)
    out = execute(f"OUT={tmp_path / 'out'}", "ERRORS=yes").out
    summary = json.loads((out / "summary.json").read_text())
    warning, = (line for line in summary["warnings"] if line.startswith(solve.NO_ESTIMATES))
    assert "\n" not in warning and len(warning) > len(solve.NO_ESTIMATES)
    assert summary["converged"] and set(summary["errors"]) == {"energy"}
    assert not guard.foreign(out)


def test_a_price_list_that_fails_leaves_the_budget_with_a_warning(tmp_path, monkeypatch):
    """A mistake in the code is one in the warning too, with its place in run.log; it is not taken
    for prices that cannot be predicted.
    """
    monkeypatch.setattr(prices, "lines", lambda *_: {}["no such key"])
    out = execute(f"OUT={tmp_path / 'out'}", "ERRORS=yes").out
    summary = json.loads((out / "summary.json").read_text())
    assert any("no such key" in line for line in summary["warnings"]
               if line.startswith(solve.NO_ESTIMATES))
    assert "normal_resultant" in summary["errors"]["quantities"]
    assert "prices" not in summary["errors"] and "Traceback" in (out / "run.log").read_text()


def test_memory_is_that_of_a_run_with_its_estimates(tmp_path, monkeypatch):
    """Companions stay in memory: 533 MiB for 241 without, of a run whose list had said 205."""
    used, assess = [100.0], companions.assess

    def estimated(*given):
        used[0] = 1e5  # whatever the process of the tests has had
        return assess(*given)

    monkeypatch.setattr(companions, "assess", estimated)
    monkeypatch.setattr(alternatives, "memory_used", lambda: used[0])
    monkeypatch.setattr(solve.summary, "largest_memory", lambda _comm: used[0])
    out = execute(f"OUT={tmp_path / 'out'}", "ERRORS=yes").out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["memory_mib"] == 1e5
    lines = [line for line in summary["errors"]["prices"]["lines"] if "settings" in line]
    assert lines and all(line["memory_mib"] > 0.99e5 for line in lines)


SPOILED = """
import sys
from driver import cli, environment
from driver.estimates import companions
from mpi4py import MPI
def assess(*_):
    if MPI.COMM_WORLD.rank == 1:
        raise ValueError("Singular matrix")
    MPI.COMM_WORLD.barrier()
companions.assess = assess
cli.main()
"""


@pytest.mark.slow
def test_a_rank_that_dies_over_estimates_leaves_the_results(tmp_path, monkeypatch):
    """Ranks that wait for it are ended, and what was finished before is published."""
    (tmp_path / "spoiled.py").write_text(SPOILED)
    monkeypatch.setattr("driver.runs.launch.sys.executable", "/bin/sh")
    script = tmp_path / "sh.sh"
    script.write_text(f'#!/bin/sh\nshift 2\nexec /usr/bin/python3 {tmp_path / "spoiled.py"} "$@"\n')
    script.chmod(0o755)
    monkeypatch.setattr("driver.runs.launch.sys.executable", str(script))
    out = execute(f"OUT={tmp_path / 'out'}", "ERRORS=yes", "NP=2").out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["converged"] and solve.NO_ESTIMATES in summary["warnings"][-1]
    assert not guard.foreign(out) and not list(tmp_path.glob(".out*"))


# ---- planted checkpoints -------------------------------------------------------------------------

@pytest.fixture(scope="module")
def interrupted(tmp_path_factory):
    """Directory with what a run left that was stopped after its first step."""
    folder, update = tmp_path_factory.mktemp("interrupted"), watch.Progress.update

    def stop(self, step):
        if step.index == 2:
            raise KeyboardInterrupt
        update(self, step)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint, "SHARE", np.inf)
        patch.setattr(watch.Progress, "update", stop)
        with pytest.raises(KeyboardInterrupt):
            execute(f"OUT={folder / 'out'}")
    return folder


@pytest.fixture
def stopped(interrupted, tmp_path):
    """OUT of that run; a copy of its directory is beside it."""
    shutil.copytree(interrupted, tmp_path, dirs_exist_ok=True)
    return tmp_path / "out"


def private(out: Path) -> Path:
    """The directory of the stopped run."""
    place, = out.parent.glob(f".{out.name}.[0-9]*")
    return place


def rewritten(place: Path, change) -> None:
    """The checkpoint of a directory with its text changed and a checksum that is right."""
    content = (place / checkpoint.NAME).read_bytes()
    with np.load(io.BytesIO(content[4:])) as kept:
        arrays = {name: kept[name] for name in kept.files}
    state = json.loads(arrays["text"].tobytes())
    change(state, arrays)
    arrays["text"] = np.frombuffer(json.dumps(state).encode(), np.uint8)
    whole = io.BytesIO()
    np.savez(whole, **arrays)
    (place / checkpoint.NAME).write_bytes(zlib.crc32(whole.getbuffer()).to_bytes(4, "little")
                                          + whole.getvalue())


def resumed(out: Path) -> int:
    """Steps that a run took up; it ends well."""
    return json.loads((execute(f"OUT={out}").out / "summary.json").read_text())[
        "resumed_after_step"]


def test_the_users_own_is_taken_up(stopped):
    assert resumed(stopped) == 1 and [path.name for path in stopped.parent.iterdir()] == ["out"]


@ROOT
def test_one_of_another_user_is_left_alone(stopped):
    place = private(stopped)
    for path in (place, *place.rglob("*")):
        os.chown(path, STRANGER, STRANGER)
    before = tree(place)
    assert resumed(stopped) == 0 and tree(place) == before


def test_one_that_others_may_write_to_is_left_alone(stopped):
    place = private(stopped)
    place.chmod(0o777)
    assert resumed(stopped) == 0 and place.exists()


def test_a_link_to_one_is_left_alone(stopped, tmp_path):
    """Neither followed nor removed with what it leads to."""
    place = private(stopped)
    place.rename(tmp_path / "elsewhere")
    place.symlink_to("elsewhere")
    before = tree(tmp_path / "elsewhere")
    assert resumed(stopped) == 0
    assert place.is_symlink() and tree(tmp_path / "elsewhere") == before


@pytest.mark.parametrize("name", ["run.log", "checkpoint.bin", "fields", "export"])
@pytest.mark.some(2)
def test_links_in_one_lead_nowhere(stopped, tmp_path, name):
    place = private(stopped)
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "file").write_text("mine")
    path = place / name
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.symlink_to(tmp_path / "secret" / ("" if name in ("fields", "export") else "file"))
    before = tree(tmp_path / "secret")
    assert resumed(stopped) == 0
    assert tree(tmp_path / "secret") == before and place.exists()


@pytest.mark.parametrize("name", ["../secret/file", "{}/secret/file", "fields/../../secret/file"])
def test_names_that_lead_outside_count_as_damage(stopped, tmp_path, name):
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "file").write_bytes(checkpoint.END)
    (private(stopped) / "fields").mkdir()
    rewritten(private(stopped),
              lambda state, arrays: state["files"].append(name.format(tmp_path)))
    before = tree(tmp_path / "secret")
    assert checkpoint.read(private(stopped)) is None and tree(tmp_path / "secret") == before


def no_text(state, arrays):
    state.clear()


def no_steps(state, arrays):
    state["solver"] = []


def wrong_names(state, arrays):
    state["files"] = [3]


def missing_array(state, arrays):
    state["solver"]["more"] = {"array": "array99999"}


@pytest.mark.parametrize("change", [no_text, no_steps, wrong_names, missing_array])
def test_what_no_run_has_written_counts_as_damage(stopped, change):
    rewritten(private(stopped), change)
    assert checkpoint.read(private(stopped)) is None


class Shell:
    """Creates a file when it is read by pickle."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_a_planted_pickle_is_not_read(stopped, tmp_path):
    rewritten(private(stopped), lambda state, arrays: arrays.update(
        array0=np.array([Shell(tmp_path / "owned")], dtype=object)))
    assert resumed(stopped) == 0 and not (tmp_path / "owned").exists()


@pytest.mark.parametrize("content", [b"", b"\0" * 4, b"junk" * 100,
                                     zlib.crc32(b"junk").to_bytes(4, "little") + b"junk"])
def test_files_that_are_no_checkpoint(stopped, content):
    (private(stopped) / checkpoint.NAME).write_bytes(content)
    assert checkpoint.read(private(stopped)) is None


@pytest.mark.parametrize("name", [".out.7", ".out.old.7"])
def test_hidden_directories_with_files_of_others_stay(tmp_path, name):
    """A name like that of a run's directory is not enough to remove it."""
    (tmp_path / name).mkdir()
    (tmp_path / name / "thesis.tex").write_text("years")
    with workspace.Workspace(tmp_path / "out"):
        pass
    assert (tmp_path / name / "thesis.tex").exists()


def test_a_directory_exchanged_for_a_link_is_not_written_to(tmp_path, monkeypatch):
    """Where others may rename what the user makes, files go to the directory that was made."""
    shared, secret = tmp_path / "shared", tmp_path / "secret"
    shared.mkdir()
    shared.chmod(0o777)
    secret.mkdir()
    export = run.freefem.export

    def swap(*arguments):
        place, = shared.glob(".out.*")
        place.rename(shared / "taken")
        place.symlink_to(secret)
        return export(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(run.freefem, "export", swap)
        with pytest.raises(InputError, match="exchanged"):
            execute(f"OUT={shared / 'out'}")
    assert not tree(secret)
    assert resumed(shared / "fine") == 0 and not guard.foreign(shared / "fine")
    assert not list(shared.glob(".fine*"))


def test_results_get_the_users_permissions(tmp_path):
    before = os.umask(0o027)
    try:
        out = execute(f"OUT={tmp_path / 'out'}").out
    finally:
        os.umask(before)
    assert out.stat().st_mode & 0o777 == 0o750


# ---- studies ------------------------------------------------------------------------------------

STUDIES = [("effects", "SCENE=patch"), ("accuracy", "SCENE=patch", "EFFORT=quick"),
           ("accuracy", "PART=locking"), ("accuracy", "PART=coverage", "SCENE=patch"),
           ("hard", "CASE=jump"), ("bench", "PARTS=stages"), ("saddle", "CELLS=1")]


@pytest.mark.parametrize("words", STUDIES, ids=lambda words: "-".join(words[:2]))
def test_a_study_leaves_what_is_no_study_alone(command_here, tmp_path, monkeypatch, words):
    """Before FreeFEM starts: folders that are named as its own, tables of somebody else."""
    monkeypatch.setattr(children, "run_child", None)  # nothing can be started
    out = tmp_path / "mine"
    (out / "runs").mkdir(parents=True)
    (out / "runs" / "thesis.txt").write_text("years of work")
    (out / "report.csv").write_text("a,b\n1,2\n")
    done = command_here(*words, f"OUT={out}")
    assert done.returncode == 2
    assert f"OUT={out} holds files but no results of make {words[0]}" in done.stderr
    assert sorted(path.name for path in out.rglob("*")) == ["report.csv", "runs", "thesis.txt"]


def test_the_folder_of_a_study(tmp_path):
    """New, empty or its own; not a file, another study's, or where nobody can write."""
    for out in (tmp_path / "new" / "below", tmp_path):
        if out == tmp_path:
            shutil.rmtree(tmp_path / "new")
        for _ in range(2):
            assert guard.study_folder(out, "hard") == out and (out / guard.STUDY).is_file()
    (tmp_path / "table.csv").write_text("")
    assert guard.study_folder(str(tmp_path), "hard") == tmp_path
    with pytest.raises(InputError, match="holds results of make hard, not of make bench"):
        guard.study_folder(tmp_path, "bench")
    with pytest.raises(InputError, match="is no directory"):
        guard.study_folder(tmp_path / "table.csv", "hard")
    with pytest.raises(InputError, match="cannot hold results|is no directory"):
        guard.study_folder(tmp_path / "table.csv" / "below", "hard")
    (tmp_path / "link").symlink_to("nowhere")
    with pytest.raises(InputError, match="which does not exist"):
        guard.study_folder(tmp_path / "link", "hard")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / guard.STUDY).symlink_to(tmp_path / guard.STUDY)
    with pytest.raises(InputError, match="no results of make hard"):
        guard.study_folder(tmp_path / "other", "hard")


def test_two_studies_do_not_work_in_one_place(tmp_path):
    """The second would remove the first one's folders; this process may come back to its own."""
    other = (f"import sys; sys.path.insert(0, {str(environment.ROOT)!r})\n"
             "from driver.runs import guard\n"
             f"guard.study_folder({str(tmp_path)!r}, 'hard')\n"
             "print('there', flush=True)\ninput()")
    with subprocess.Popen([sys.executable, "-c", other], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "there\n"
        with pytest.raises(InputError, match="is in use by another make hard: wait"):
            guard.study_folder(tmp_path, "hard")
        process.communicate("\n")
    for _ in range(2):
        assert guard.study_folder(tmp_path, "hard") == tmp_path
