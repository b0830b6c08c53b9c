"""Interrupted runs: earlier results stay whole, and the same command goes on with the same bits."""

import contextlib
import copy
import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from thin_rail import RAIL

from driver import cli, environment
from driver.effects import Effects
from driver.march import checkpoint, saving
from driver.march.quasistatic import QuasistaticSolver
from driver.march.saving import restore, snapshot
from driver.options import Settings
from driver.runs import run, watch, workspace
from driver.errors import InputError

WORDS = ("SCENE=model", "LOADING=nonmonotone", "CELLS=4", "STEPS=8", "FIGURES=no", "ERRORS=no")
# of summary.json: how a run went, not what it found
OWN = ("seconds", "memory_mib", "ranks", "resumed_after_step")


def listing(out: Path) -> dict:
    """Content of every file that holds results."""
    found = {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*"))
             if path.is_file() and path.suffix not in (".log", ".html")}  # times are in these
    summary = json.loads(found.pop("summary.json"))
    ledger = {name: {k: v for k, v in entry.items() if k != "seconds"}
              for name, entry in summary.pop("effects_ledger").items()}
    return found | {"summary": {k: v for k, v in summary.items() if k not in OWN}, "ledger": ledger}


def execute(*words: str) -> dict:
    return run.execute(run.Run.from_pairs(cli.parse_pairs([*words, "QUIET=yes"])))


def same(one, other) -> bool:
    """Whether two trees of dicts, sequences, arrays and numbers are equal."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    return np.array_equal(one, other)


def test_a_lost_interrupt_ends_a_run_before_its_next_product_or_step(built, steps_of, monkeypatch):
    """NumPy drops what is raised while it looks up an object's own functions."""
    problem = built(loading="nonmonotone", cells=2, steps=3)
    solver = QuasistaticSolver(problem.operator, Effects(problem.manifest),
                               problem.manifest.factors, np.linspace(0, 1, 4), Settings())
    steps = solver.steps()
    next(steps)
    monkeypatch.setattr(environment, "_interrupts", [signal.SIGTERM])
    with pytest.raises(KeyboardInterrupt):
        problem.operator.apply(np.zeros(problem.operator.owned))
    monkeypatch.setattr(problem.operator, "apply", None)
    with pytest.raises(KeyboardInterrupt):
        next(steps)


def test_what_is_restored_is_what_was_kept(built, steps_of):
    """All of it, also what a run seldom has: doubt about a step, rigid motions, a load of its own.
    """
    problem = built(loading="nonmonotone", cells=2, steps=3)
    kept, _ = steps_of(problem)
    kept.doubtful = kept.condensation.eliminated = kept.more_digits.needed = True
    kept.initial[:], kept.initial_weights[:] = 0.5, 0.25
    state = copy.deepcopy(snapshot(kept))
    assert state["doubtful"] and state["eliminated"] and state["more_digits"]
    assert state["history"]["steps"] == 3
    fresh = QuasistaticSolver(problem.operator, Effects(problem.manifest),
                              problem.manifest.factors, kept.times, Settings())
    assert not same(snapshot(fresh), state)
    restore(fresh, copy.deepcopy(state))
    assert same(snapshot(fresh), state)


@pytest.fixture
def every_step(monkeypatch):
    """A checkpoint after every step, whatever it costs."""
    monkeypatch.setattr(checkpoint, "SHARE", np.inf)


@pytest.fixture
def stop_after(monkeypatch):
    """stop_after(k): the next run is interrupted as soon as k steps of its own are behind it."""
    update = watch.Progress.update

    def make(steps: int):
        left = iter(range(steps))

        def stopped(self, found):
            if next(left, None) is None:
                monkeypatch.setattr(watch.Progress, "update", update)
                raise KeyboardInterrupt
            update(self, found)

        monkeypatch.setattr(watch.Progress, "update", stopped)

    return make


def hidden(folder: Path) -> list:
    return sorted(path.name for path in folder.iterdir() if path.name.startswith("."))


# ------------------------------------------------------------------------- the same numbers

MODEL = ("SCENE=model", "LOADING=nonmonotone", "CELLS=4", "STEPS=6", "FIGURES=no", "FIELDS=no",
         "ERRORS=no")
CASES = {
    "energy error": ("ERRORS=energy",),
    "plain": ("PRECONDITIONER=none", "PREDICTOR=previous", "INNER_RTOL=1e-9", "EXPANSION=gradient",
              "RTOL=1e-6"),
    "deflated": ("PRECONDITIONER=deflated", "EXPANSION=contact"),
    "fields": ("FIELDS=yes", "ERRORS=energy"),
    "quadratic": ("ELEMENT=P2", "CELLS=2", "FIELDS=yes", "ERRORS=energy"),
    "slip law": ("SCENE=punch", "LOADING=", "CELLS="),
    "wear": ("SCENE=worn-pad", "LOADING=", "CELLS=3"),
    "cycles": ("SCENE=walking", "LOADING=", "CELLS=2", "STEPS=3", "CYCLES=30 jump 5%"),
    "condensed": ("SCENE=tutorial", "LOADING=", "CELLS=", "H=0.8", "ELEMENT=P2", "SUBDOMAINS=8"),
    "several boundaries": ("SCENE=bracket", "LOADING=", "CELLS=", "H=8", "SUBDOMAINS=4"),
    "corners": ("SCENE=hard/hole", "LOADING=", "CELLS="),
    "floating stack": ("SCENE=stack", "LOADING=", "CELLS=", "H=0.25", "SUBDOMAINS=3")}


def words_of(case: str) -> list[str]:
    """MODEL with what the case changes; an empty value takes a word away."""
    words = {word.split("=")[0]: word for word in (*MODEL, *CASES[case])}.values()
    return [word for word in words if not word.endswith("=")]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_stopped_run_goes_on_with_the_same_bits(tmp_path, every_step, stop_after, case):
    """Stopped twice, after the first step and in the middle."""
    words = words_of(case)
    execute(*words, f"OUT={tmp_path / 'whole'}")
    for more, step in ((1, 1), (3, 4)):
        stop_after(more)
        with pytest.raises(KeyboardInterrupt, match=f"goes on after step {step}$"):
            execute(*words, f"OUT={tmp_path / 'out'}")
        assert not (tmp_path / "out").exists() and len(hidden(tmp_path)) == 1
    summary = execute(*words, f"OUT={tmp_path / 'out'}")
    assert summary["resumed_after_step"] == 4
    assert listing(tmp_path / "out") == listing(tmp_path / "whole")
    assert hidden(tmp_path) == []


@pytest.mark.slow
def test_stopped_refinement_goes_on(tmp_path, every_step, stop_after):
    """Stopped in the cycle before and in the run itself: neither starts over."""
    words = [*words_of("several boundaries"), "STEPS=3", "H=16", "ADAPT=1"]
    words = [word for word in words if word not in ("STEPS=6", "H=8")]
    execute(*words, f"OUT={tmp_path / 'whole'}")
    for more, said in ((2, "goes on from there"), (2, "goes on after step 1")):
        stop_after(more)
        with pytest.raises(KeyboardInterrupt, match=said):
            execute(*words, f"OUT={tmp_path / 'out'}")
    assert execute(*words, f"OUT={tmp_path / 'out'}")["resumed_after_step"] == 1
    found, whole = (listing(tmp_path / name) for name in ("out", "whole"))
    for one in (found, whole):  # its last column is seconds
        one["adaptivity.csv"] = [[v for k, v in row.items() if k != "seconds"]
                                 for row in csv.DictReader(
                                     one["adaptivity.csv"].decode().splitlines())]
    assert found == whole and hidden(tmp_path) == []


@pytest.mark.slow
def test_body_without_support_goes_on(tmp_path, every_step, stop_after):
    """Its rigid motion is part of what is kept."""
    scene = tmp_path / "sledge.edp"
    scene.write_text((environment.ROOT / "edp" / "slope.edp").read_text().replace(
        "macro young()",
        "quasistatic(1.);\nmacro amplitude1(t) (0.5 + t) //\n"
        "macro load2() traction(2, 300*t1, 300*t2) //\nmacro amplitude2(t) sin(6*t) //\n"
        "real t1 = cos(angle*pi/180), t2 = sin(angle*pi/180);\nmacro young()", 1))
    words = (f"SCENE={scene}", "STEPS=6", *MODEL[4:])
    execute(*words, f"OUT={tmp_path / 'whole'}")
    stop_after(3)
    with pytest.raises(KeyboardInterrupt, match="goes on after step 3"):
        execute(*words, f"OUT={tmp_path / 'out'}")
    execute(*words, f"OUT={tmp_path / 'out'}")
    assert listing(tmp_path / "out") == listing(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("cut", ["7x1", "3"])
def test_steps_that_begin_with_refined_displacements_go_on(tmp_path, every_step, stop_after, cut):
    """That the step before needed them is part of what is kept: a thin rail that heat stretches."""
    scene = tmp_path / "rail.edp"
    scene.write_text(RAIL)
    words = (f"SCENE={scene}", "CELLS=1", "STEPS=4", f"SUBDOMAINS={cut}", "PRIMAL_RTOL=1e-9",
             *MODEL[4:])
    execute(*words, f"OUT={tmp_path / 'whole'}")
    stop_after(2)
    with pytest.raises(KeyboardInterrupt, match="goes on after step 2"):
        execute(*words, f"OUT={tmp_path / 'out'}")
    execute(*words, f"OUT={tmp_path / 'out'}")
    assert listing(tmp_path / "out") == listing(tmp_path / "whole")


def test_uninterrupted_run_has_no_trace_of_checkpoints(tmp_path, every_step):
    """Numbers do not depend on checkpoints being written, nor on how many."""
    execute(*WORDS, f"OUT={tmp_path / 'often'}")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint, "SHARE", 1e-9)  # the first one only
        summary = execute(*WORDS, f"OUT={tmp_path / 'once'}")
    assert listing(tmp_path
                   / "often") == listing(tmp_path / "once") and summary["resumed_after_step"] == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["often", "once"]
    assert not [path.name for path in (tmp_path / "often").iterdir() if "checkpoint" in path.name]


# ------------------------------------------------------------------------ when not to go on

@pytest.fixture
def stopped(tmp_path, every_step, stop_after):
    """OUT of a run that was stopped after step 3 of WORDS."""
    stop_after(3)
    with pytest.raises(KeyboardInterrupt):
        execute(*WORDS, f"OUT={tmp_path / 'out'}")
    return tmp_path / "out"


def run_loudly(capsys, *words):
    capsys.readouterr()
    summary = run.execute(run.Run.from_pairs(cli.parse_pairs([*words])))
    return summary, capsys.readouterr().out


@pytest.mark.parametrize("word, said", [
    ("FRICTION=0.2", "of other scene or parameters"), ("STEPS=9", "of other scene or parameters"),
    ("RTOL=1e-7", "of other options"), ("FIELDS=no", "of other options")])
@pytest.mark.some(2)
def test_another_run_starts_over(stopped, capsys, word, said):
    """And what was kept for the interrupted run goes when this one is done: its results would be
    replaced.
    """
    words = {w.split("=")[0]: w for w in (*WORDS, word, f"OUT={stopped}")}.values()
    summary, told = run_loudly(capsys, *words)
    assert summary["resumed_after_step"] == 0 and said in told
    assert hidden(stopped.parent) == []


def test_another_run_that_fails_spares_the_interrupted_one(stopped):
    with pytest.raises(InputError):
        execute(*WORDS, "FRICTION=-1", f"OUT={stopped}")
    assert execute(*WORDS, f"OUT={stopped}")["resumed_after_step"] == 3


def test_edited_scene_starts_over(tmp_path, variant, every_step, stop_after):
    """The export is made anew and compared: no edit of script, library or mesh can go unnoticed."""
    scene, out = variant("resume_edited"), tmp_path / "out"
    words = (f"SCENE={scene}", *WORDS[1:], "FIELDS=no", f"OUT={out}")
    stop_after(3)
    with pytest.raises(KeyboardInterrupt):
        execute(*words)
    scene.write_text(scene.read_text().replace("macro contact() 1 //",
                                               "macro contact() 1 //\nmacro gap() 1e-5 //"))
    assert execute(*words)["resumed_after_step"] == 0
    contact = list(csv.DictReader((out / "contact.csv").read_text().splitlines()))
    assert {float(row["gap"]) for row in contact} == {1e-5}


def test_resume_no_starts_over(stopped):
    assert execute(*WORDS, f"OUT={stopped}", "RESUME=no")["resumed_after_step"] == 0
    assert hidden(stopped.parent) == []


def spoil_checkpoint(work):
    content = bytearray((work / checkpoint.NAME).read_bytes())
    content[len(content) // 2] ^= 4
    (work / checkpoint.NAME).write_bytes(content)


@pytest.mark.parametrize("spoil", [
    spoil_checkpoint, lambda work: (work / checkpoint.NAME).write_bytes(b""),
    lambda work: (work / checkpoint.NAME).write_bytes((work / checkpoint.NAME).read_bytes()[:-9]),
    lambda work: (work / "fields" / "step_0002.vtu").unlink(),
    lambda work: (work / "fields" / "step_0002.vtu").write_bytes(b"")],
    ids=["bit", "empty", "cut", "field lost", "field empty"])
@pytest.mark.some(1)
def test_damaged_remains_are_not_taken_up(stopped, capsys, spoil):
    """After a power failure, say."""
    work, = stopped.parent.glob(".out.*")
    spoil(work)
    summary, told = run_loudly(capsys, *WORDS, f"OUT={stopped}")
    assert summary["resumed_after_step"] == 0 and "damaged" in told
    assert hidden(stopped.parent) == []


def test_every_byte_of_a_checkpoint_counts(stopped):
    work, = stopped.parent.glob(".out.*")
    content = (work / checkpoint.NAME).read_bytes()
    assert checkpoint.steps(checkpoint.read(work)) == 3
    for at in np.random.default_rng(3).integers(0, len(content), 150):
        spoiled = bytearray(content)
        spoiled[at] ^= 16
        (work / checkpoint.NAME).write_bytes(spoiled)
        assert checkpoint.read(work) is None


def test_a_living_run_keeps_its_directory(tmp_path):
    """Two runs to the same place do not get into each other's way."""
    first = workspace.Workspace(tmp_path / "out")
    second = workspace.Workspace(tmp_path / "out")
    assert first.path != second.path and second.abandoned == []
    for place in (first, second):
        with place:
            pass
    assert list(tmp_path.iterdir()) == []


def test_two_runs_to_the_same_place_say_so(tmp_path, capsys):
    """The second that there is another one, the one that ends last whose results it replaces."""
    out = tmp_path / "out"
    said = []
    with workspace.Workspace(out) as first, workspace.Workspace(out) as second:
        said.append(capsys.readouterr().err)
        for place, name in ((second, "second"), (first, "first")):
            (place.path / "summary.json").write_text(SUMMARY % name)
            place.publish(out)
            said.append(capsys.readouterr().err)
    assert [len(words.splitlines()) for words in said] == [1, 0, 1]
    assert "another run also writes to" in said[0] and "give it another OUT" in said[0]
    assert "another run has put its results into" in said[2]
    assert '"first"' in (out / "summary.json").read_text()
    with workspace.Workspace(out) as alone:
        (alone.path / "summary.json").write_text(SUMMARY % "third")
        alone.publish(out)
    assert not capsys.readouterr().err


def test_directories_of_other_results_are_left_alone(tmp_path):
    """OUT=a next to OUT=a.b, and hidden directories that no run has made."""
    for name in (".a.b.1", ".a.1x", ".a.old", ".ab.1"):
        (tmp_path / name).mkdir()
    with workspace.Workspace(tmp_path / "a"):
        pass
    assert hidden(tmp_path) == [".a.1x", ".a.b.1", ".a.old", ".ab.1"]


SUMMARY = '{"scene": "%s", "units": {}, "seconds": {}}'


def published_before(tmp_path):
    """A directory with an old result, and a workspace with the new one to be published there."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "summary.json").write_text(SUMMARY % "old")
    place = workspace.Workspace(out)
    (place.path / "summary.json").write_text(SUMMARY % "new")
    return out, place


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGALRM],
                         ids=["interrupt", "one that comes once more"])
@pytest.mark.parametrize("atomic", [True, False], ids=["exchange", "two renames"])
def test_an_interrupt_while_publishing_waits(tmp_path, monkeypatch, atomic, number):
    """At the moment when an older result might have its private name only."""
    out, place = published_before(tmp_path)
    exchange = workspace._exchange

    def interrupted(*paths):
        signal.raise_signal(number)
        return exchange(*paths) if atomic else False

    monkeypatch.setattr(workspace, "_exchange", interrupted)
    # a shell's background jobs ignore SIGINT
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), place:
            place.publish(out)
    finally:
        signal.signal(number, before)
    assert (out / "summary.json").read_text() == SUMMARY % "new" and hidden(tmp_path) == []


def test_where_directories_cannot_be_exchanged_one_result_is_always_whole(tmp_path, monkeypatch):
    """Before each of the renames and removals the old result or the new one is there, under its
    name or the private one that the next run takes back.
    """
    out, place = published_before(tmp_path)
    monkeypatch.setattr(workspace, "_exchange", lambda *_: False)
    seen = []

    def watched(act):
        def acting(*args, **options):
            whole = [path for path in (out, *tmp_path.glob(".out.old.*"))
                     if (path / "summary.json").is_file()]
            seen.append(bool(whole))
            return act(*args, **options)
        return acting

    monkeypatch.setattr(workspace.Path, "rename", watched(workspace.Path.rename))
    monkeypatch.setattr(workspace.shutil, "rmtree", watched(shutil.rmtree))
    with place:
        place.publish(out)
    assert len(seen) >= 3 and all(seen)
    assert (out / "summary.json").read_text() == SUMMARY % "new" and hidden(tmp_path) == []


def test_checkpoints_of_another_state_of_the_code_are_refused(tmp_path, monkeypatch):
    """In any folder of the package, however deep: an edit, a new file, one that is gone or renamed.
    """
    package = shutil.copytree(environment.ROOT / "driver", tmp_path / "driver",
                              ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(checkpoint, "ROOT", tmp_path)

    def changed() -> bool:
        checkpoint.program.cache_clear()
        different = checkpoint.differences({"fingerprint": before}, checkpoint.fingerprint("", {}))
        assert different in ([], ["program"])
        return bool(different)

    checkpoint.program.cache_clear()
    before = checkpoint.fingerprint("", {})
    # a process that only starts ranks has not loaded PETSc, which sets its place
    monkeypatch.delenv("PETSC_DIR", raising=False)
    assert not changed()
    folders = {path.parent: path for path in package.rglob("*.py")}
    assert max(len(folder.relative_to(package).parts) for folder in folders) >= 2
    for folder, path in folders.items():
        text = path.read_bytes()
        path.write_bytes(text + b"\n")
        assert changed(), path
        path.write_bytes(text)
        path.rename(folder / "other.py")
        assert changed(), path
        (folder / "other.py").unlink()
        assert changed(), path
        path.write_bytes(text)
        (folder / "new.py").touch()
        assert changed(), path
        (folder / "new.py").unlink()
        assert not changed()


# --------------------------------------------------------------------------- killed processes

class Victim:
    """A run in a session of its own, to be stopped from outside; `words` as on the command line."""

    def __init__(self, folder: Path, *words: str):
        self.folder = folder
        self.process = subprocess.Popen(
            [sys.executable, "-m", "driver", "run", *words], cwd=environment.ROOT,
            env=dict(os.environ), text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))

    def relatives(self, word: str = "") -> list[int]:
        """Processes whose command line names the folder and `word`."""
        found = []
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                line = path.read_bytes().decode(errors="replace")
            except OSError:
                continue
            if str(self.folder) in line and word in line:
                found.append(int(path.parent.name))
        return found

    def end(self) -> tuple[int, str]:
        """Exit status and what was said on stderr; nothing of it may run on."""
        _, said = self.process.communicate(timeout=120)
        limit = time.monotonic() + 20
        while self.relatives() and time.monotonic() < limit:
            time.sleep(0.02)
        assert not self.relatives(), "processes outlive their driver"
        return self.process.returncode, said


LONG = ("SCENE=model", "LOADING=nonmonotone", "CELLS=4", "STEPS=60", "RTOL=1e-10", "FIGURES=no",
        "ERRORS=no")


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """An older result, and the listing that LONG leaves undisturbed."""
    folder = tmp_path_factory.mktemp("reference")
    execute(*LONG, f"OUT={folder / 'new'}")
    execute("SCENE=model", "CELLS=2", "STEPS=2", "FIGURES=no", "ERRORS=no", f"OUT={folder / 'old'}")
    return folder / "old", listing(folder / "new")


def kill_and_run_again(folder, reference, ranks, target, number, moment=None, again=None):
    """One try: a run is hit after `moment` seconds, or as soon as it has a checkpoint, and made
    once more.

    Until then the older result is what it was; afterwards the new one is there to the last bit and
    nothing else, and no process is left. Returns the step that the second run started after.
    """
    old, new = reference
    out = folder / "out"
    shutil.copytree(old, out)
    before = listing(out)
    victim = Victim(folder, *LONG, f"NP={ranks}", f"OUT={out}")
    if moment is None:
        wait_for(lambda: list(folder.glob(f".out.*/{checkpoint.NAME}"))
                 or victim.process.poll() is not None)
    else:
        time.sleep(moment)
    if target == "rank":
        wait_for(lambda: victim.relatives("driver\0solve\0") or victim.process.poll() is not None)
    for pid in [victim.process.pid] if target == "driver" else victim.relatives(
        "driver\0solve\0")[-1:]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
    status, said = victim.end()
    assert "Traceback" not in said and len(said.strip().splitlines()) <= 1, said
    assert status in {0, -number, *([130] if number != signal.SIGKILL else []),
                      *([2] if target == "rank" else [])}, said
    found = listing(out)
    assert found == new if status == 0 else found in (before, new)
    status, said = Victim(folder, *LONG, f"NP={again or ranks}", f"OUT={out}").end()
    assert status == 0, said
    assert listing(out) == new
    assert [path.name for path in folder.iterdir()] == ["out"]
    return json.loads((out / "summary.json").read_text())["resumed_after_step"]


def wait_for(event, seconds=60):
    limit = time.monotonic() + seconds
    while not event() and time.monotonic() < limit:
        time.sleep(0.005)


@pytest.mark.parametrize("ranks, target, number, again", [
    pytest.param(1, "driver", signal.SIGINT, 1, marks=pytest.mark.slow),  # as by SIGKILL
    (1, "driver", signal.SIGKILL, 1),
    pytest.param(2, "driver", signal.SIGKILL, 1, marks=pytest.mark.slow),
    pytest.param(2, "rank", signal.SIGKILL, 1, marks=pytest.mark.slow)])
def test_killed_run_goes_on(tmp_path, reference, ranks, target, number, again):
    """In the middle of its steps; some on another number of ranks."""
    assert kill_and_run_again(tmp_path, reference, ranks, target, number, again=again) > 0


@pytest.mark.slow
def test_ranks_end_with_their_driver(tmp_path):
    """A driver that is killed cannot tell them to; the run would take minutes."""
    victim = Victim(tmp_path, *LONG[:3], "STEPS=20000", "FIGURES=no", "FIELDS=no", "NP=2",
                    f"OUT={tmp_path / 'out'}")
    wait_for(lambda: list(tmp_path.glob(f".out.*/{checkpoint.NAME}")))
    victim.process.kill()
    wait_for(lambda: not victim.relatives(), 15)
    left = victim.relatives()
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    victim.process.communicate()
    assert not left


@pytest.mark.slow
def test_fifty_random_kills(tmp_path, reference):
    """At any moment, from the start of the process to its end; some must hit the steps."""
    random, resumed, seconds = np.random.default_rng(50), [], {}
    for ranks in (1, 2):
        clock = time.monotonic()
        assert Victim(tmp_path, *LONG, f"NP={ranks}", f"OUT={tmp_path / 'timed'}").end()[0] == 0
        seconds[ranks] = time.monotonic() - clock
    ways = [(ranks, "driver", number) for ranks in (1, 2)
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)]
    for k in range(50):
        ranks, target, number = [*ways, (2, "rank", signal.SIGKILL)][k % 7]
        folder = tmp_path / str(k)
        folder.mkdir()
        moment = 0.1 + seconds[ranks] * random.uniform()
        resumed.append(kill_and_run_again(folder, reference, ranks, target, number, moment,
                                          random.integers(1, 3)))
        print(f"{k}: NP={ranks} {target} {number.name} after {moment:.2f} s, "
              f"went on after step {resumed[-1]}", flush=True)
        shutil.rmtree(folder)
    assert sum(step > 0 for step in resumed) >= 5


@pytest.mark.parametrize("takes", [0.125, 1.0])
def test_checkpoints_take_a_fiftieth_of_the_time(monkeypatch, takes):
    """Steps take 0.25 s: whatever one checkpoint takes, all of them take SHARE of a long run."""
    clock, written = [0.0], []

    def write(*_):
        clock[0] += takes
        written.append(clock[0])

    monkeypatch.setattr(saving.time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(saving.checkpoint, "write", write)
    for name in ("_gathered", "_stacked", "snapshot"):
        monkeypatch.setattr(saving, name, lambda *_: {})
    one = object.__new__(saving.Checkpoints)
    one.comm, one.next, one.unsaved, one.saved = MPI.COMM_SELF, 0.0, [], []
    one.solver = one.directory = one.identity = None
    for _ in range(4000):
        clock[0] += 0.25
        one.save(None, [])
    assert len(written) * takes == pytest.approx(0.02 * clock[0], rel=0.1)
    assert len(one.saved) + len(one.unsaved) == 4000
