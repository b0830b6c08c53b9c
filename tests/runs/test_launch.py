"""How many ranks solve what nobody gave a number of ranks for, and how they are started."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from mpi4py import MPI

from driver import children, cli, environment
from driver.errors import InputError
from driver.march.ahead import Ahead
from driver.runs import launch, run, solve
from driver.scene import freefem

WORDS = ("SCENE=model", "STEPS=1", "ERRORS=no", "FIGURES=no", "QUIET=yes")


@pytest.fixture(scope="module")
def manifest(tmp_path_factory):
    """That of a small export."""
    return freefem.export(freefem.find_scene("model"), tmp_path_factory.mktemp("launch") / "export",
                          {"steps": "1"}, 1)


@pytest.mark.parametrize("dofs, subdomains, cores, history, of_one_step", [
    (2, 1, 8, 1, 1), (launch.RANK - 2, 16, 8, 1, 1), (2 * launch.RANK - 2, 16, 8, 1, 1),
    (2 * launch.RANK, 16, 8, 2, 2), (5 * launch.RANK, 16, 8, 5, 5),
    (100 * launch.RANK, 16, 8, 8, 7), (100 * launch.RANK, 3, 8, 3, 3),
    (100 * launch.RANK, 16, 2, 2, 1), (100 * launch.RANK, 16, 1, 1, 1)])
def test_ranks_follow_from_dofs_subdomains_and_cores(
        monkeypatch, manifest, dofs, subdomains, cores, history, of_one_step):
    """One for each RANK dofs, none without a subdomain, no more than there are cores.

    One step alone leaves a core to FreeFEM.
    """
    monkeypatch.setattr(launch, "CORES", cores)
    given = replace(manifest, nodes=dofs // 2, subdomains=subdomains)
    static = replace(given, rooms={})
    assert (launch.ranks_for(given), launch.ranks_for(static)) == (history, of_one_step)


@pytest.mark.slow
def test_a_run_has_the_ranks_that_its_size_pays_for_unless_they_are_given(tmp_path, monkeypatch):
    """The small model has one; if a rank paid for a hundred dofs, two, with the same bits."""
    seen = {}
    for name, dofs, words in (("small", launch.RANK, ()), ("large", 100, ()),
                              ("given", 100, ("NP=1",))):
        monkeypatch.setattr(launch, "CORES", 2)
        monkeypatch.setattr(launch, "RANK", dofs)
        out = tmp_path / name
        run.execute(run.Run.from_pairs(cli.parse_pairs([*WORDS, *words, f"OUT={out}"])))
        ranks = json.loads((out / "summary.json").read_text())["ranks"]
        seen[name] = ranks, (out / "contact.csv").read_bytes()
    ranks, bits = zip(*seen.values())
    assert ranks == (1, 2, 1)
    assert len(set(bits)) == 1


def test_ranks_start_as_soon_as_freefem_has_the_mesh(manifest, tmp_path, monkeypatch):
    """The manifest, which comes first, says how many nodes and subdomains there are."""
    started, content = [], (manifest.directory / "manifest.json").read_bytes()
    monkeypatch.setattr(launch, "CORES", 2)
    monkeypatch.setattr(launch, "RANK", manifest.nodes)
    monkeypatch.setattr(launch.Ranks, "_start", lambda ranks: started.append(ranks.number))
    ranks = launch.Ranks(tmp_path, run.solver, None)
    (tmp_path / "export").mkdir()
    for size in (0, len(content) // 2, len(content)):
        assert not started
        (tmp_path / "export" / "manifest.json").write_bytes(content[:size])
        assert ranks.prepare()
    assert started == [2]


def test_subdomains_are_taken_while_freefem_works(tmp_path, monkeypatch):
    """One after the other, with the bits of a run that waits for FreeFEM's end."""
    words = ["SCENE=tutorial", "STEPS=2", "SUBDOMAINS=20", "H=0.8", *WORDS[2:], "NP=1"]
    bits, seen, advance, claim = [], [], Ahead.advance, Ahead.claim

    def claimed(ahead, subdomains):
        seen.append((len(ahead.interiors), ahead.idle, dict(ahead.seconds)))
        return claim(ahead, subdomains)

    monkeypatch.setattr(Ahead, "claim", claimed)
    monkeypatch.setattr(solve, "_estimated", lambda *parts: (None, str(parts[-1])))
    for allowed in (True, False):
        monkeypatch.setattr(Ahead, "advance", lambda ahead, allowed=allowed:
                            allowed and advance(ahead))
        out = tmp_path / str(allowed)
        summary = run.execute(run.Run.from_pairs(cli.parse_pairs([*words, f"OUT={out}"])))
        bits.append([(out / file).read_bytes() for file in ("contact.csv", "boundary.csv")])
        number, idle, spent = seen[-1]
        assert (number > 0) is allowed and (spent["setup"] > 0) is allowed
        # what was done ahead counts to its stage, and no memory that it took to an idle process
        seconds = summary["seconds"]
        assert all(seconds[stage] > of_stage for stage, of_stage in spent.items())
        assert seconds["total"] == pytest.approx(sum(seconds.values()) - seconds["total"])
        assert str(idle) in summary["warnings"]
    assert bits[0] == bits[1]


@pytest.mark.parametrize("spent, booked", [
    ((0.5, 1.5), (8.0, 0.75, 3.5)), ((0.0, 0.0), (10.0, 0.25, 2.0)),
    ((5.0, 15.0), (0.0, 2.75, 9.5))])
def test_what_is_done_ahead_counts_to_its_stage(spent, booked):
    """As far as FreeFEM has worked so long; the whole stays what it is."""
    seconds = {"export": 10.0, "read": 0.25, "setup": 2.0}
    solve._book(SimpleNamespace(seconds=dict(zip(("read", "setup"), spent))), seconds,
                MPI.COMM_SELF)
    assert tuple(seconds.values()) == booked and sum(booked) == 12.25


def test_ranks_that_wait_begin_with_the_stage(manifest, monkeypatch):
    """Until the end of their input says that there is a request, or that there is none."""
    read, write = os.pipe()
    works, seen = iter([True, False, True]), []

    class Stage(launch.Stage):
        def advance(self, work, comm):
            seen.append((work, comm.size))
            if len(seen) == 5:
                os.close(write)
            return next(works, False)

    with open(read, encoding="ascii") as waiting:
        monkeypatch.setattr(sys, "stdin", waiting)
        assert launch.awaited(manifest.directory, Stage(None)) is None
    assert len(seen) >= 5 and set(seen) == {(manifest.directory, 1)}


def test_ranks_that_wait_end_with_a_run_that_comes_to_nothing(tmp_path):
    """By themselves, without a word: stopped by mpirun they would take two seconds."""
    with pytest.raises(ZeroDivisionError):
        with launch.Ranks(tmp_path, run.solver, 2) as ranks:
            assert ranks.prepare() and ranks.prepare()
            raise ZeroDivisionError
    assert ranks._child.returncode == 0 and not list(tmp_path.iterdir())


def test_ranks_that_die_while_they_wait_end_the_run(tmp_path):
    """At once: FreeFEM may have a long way to go."""
    with pytest.raises(InputError, match="was killed"):
        with launch.Ranks(tmp_path, run.solver, 2) as ranks:
            assert ranks.prepare()
            ranks._child.kill()
            ranks._child.wait()
            ranks.prepare()


def test_a_child_is_heard_while_something_else_is_done():
    """What it prints is more than a pipe holds: it would wait for ever."""
    done = children.run_child([sys.executable, "-c", "print('x' * 1000000)"], lambda: True,
                              stdout=subprocess.PIPE, text=True)
    assert done.returncode == 0 and len(done.stdout) == 1000001


def test_mpirun_keeps_its_files_where_no_other_one_does():
    """Of all runs of a user at a time one that ends would take away the place of one that starts,
    and two that make it at a moment fail, also those of FreeFEM and of the solver of one run.
    """
    start, again = children.mpirun(2), children.mpirun(2)
    place, next_one = (words[words.index(children.OWN_PLACE) + 1] for words in (start, again))
    assert Path(next_one).is_dir() and next_one != place
    code = ("import os; from mpi4py import MPI; comm = MPI.COMM_WORLD; ranks = comm.allreduce(1); "
            f"comm.rank or print(ranks, *os.listdir('{place}'))")
    done = subprocess.run([*start, sys.executable, "-c", code], check=True,
                          env=children.child_environment(), capture_output=True, text=True)
    assert done.stdout.startswith("2 ompi.")
    other = subprocess.run([sys.executable, "-c", "from driver import children as e; "
                            "print(e.place_of_mpirun())"], cwd=environment.ROOT, check=True,
                           capture_output=True, text=True).stdout.strip()
    assert other != place and Path(place).is_dir() and not Path(other).exists()


def test_what_killed_runs_leave_goes_with_a_later_run(tmp_path, monkeypatch):
    """Places of old that nothing is in: others are at work, or not from here."""
    monkeypatch.setattr(children.tempfile, "tempdir", str(tmp_path))
    old = time.time() - 2 * children.OLD
    names = {name: children.PLACE + name for name in ("left", "new", "used", "file")}
    for name in ("left", "new", "used"):
        (tmp_path / names[name]).mkdir()
    (tmp_path / names["used"] / "ompi").write_text("")
    for kept in (tmp_path / names["file"], tmp_path / "left"):
        kept.write_text("")
    for name in ("left", "used", "file"):
        os.utime(tmp_path / names[name], (old, old))
    place = Path(children.place_of_mpirun())
    assert {path.name for path in tmp_path.iterdir()} == {
        place.name, "left", *(names[name] for name in ("new", "used", "file"))}


@pytest.mark.parametrize("flags, asked, kernels", [
    ("fpu avx avx2 fma", None, "HASWELL"), ("fpu avx fma", None, None), (None, None, None),
    ("avx2 fma", "ZEN", "ZEN")])
def test_kernels_of_openblas_are_the_same_where_they_run(flags, asked, kernels, tmp_path,
                                                         monkeypatch):
    """Not those that it takes for a processor that it does not know, unless they are asked for."""
    cpu = tmp_path / "cpuinfo"
    if flags is not None:
        cpu.write_text(f"processor\t: 0\nflags\t\t: {flags}\n\nprocessor\t: 1\n")
    monkeypatch.setattr(environment, "CPU", cpu)
    monkeypatch.setenv("OPENBLAS_CORETYPE", asked or "")
    if asked is None:
        monkeypatch.delenv("OPENBLAS_CORETYPE")
    environment.prepare_libraries()
    assert os.environ.get("OPENBLAS_CORETYPE") == kernels


def test_numpy_asks_for_no_huge_pages():
    """It is told so before it is loaded, as by every process of the driver."""
    lines = ("from driver import environment", "import sys; assert 'numpy' not in sys.modules",
             "environment.prepare_libraries(); import numpy as np",
             "print(np.core.multiarray._set_madvise_hugepage(1))")
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True,
                          cwd=environment.ROOT, timeout=60,
                          env={name: value for name, value in os.environ.items()
                               if name != "NUMPY_MADVISE_HUGEPAGE"})
    assert done.stdout == "False\n", done.stderr


@pytest.fixture
def heeded():
    """Interrupts are, also where the tests run in the background of a shell, which ignores them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeded")
def test_packages_are_loaded_whole(monkeypatch):
    """An interrupt waits for the end of their imports, which could go on with parts of them."""
    monkeypatch.setattr(environment, "prepare_numpy", lambda: None)
    monkeypatch.setattr(environment, "start_petsc", lambda: None)
    loaded = []

    def stage():
        signal.raise_signal(signal.SIGINT)
        loaded.append(True)

    with pytest.raises(KeyboardInterrupt):
        launch.load(stage)
    assert loaded and signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_threads_hold_nothing_back():
    """Only the main one is interrupted; a program may run scenes in others."""
    ran = []

    def work():
        with environment.undisturbed():
            ran.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert ran


def runs_on(number: int) -> bool:
    """Whether a process is there that has not ended."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_child_ends_with_its_parent():
    """However that ends: killed, it can do nothing about it itself."""
    code = ("from driver import children\n"
            "children.run_child(['/bin/sh', '-c', 'echo $$; exec sleep 60'])")
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True,
                          cwd=environment.ROOT) as parent:
        child = int(parent.stdout.readline())
        assert runs_on(child)
        parent.kill()
        deadline = time.monotonic() + 10
        while runs_on(child) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not runs_on(child)


def test_a_child_starts_without_a_fork(monkeypatch):
    """Which takes 50 ms where MPI is loaded: a preexec_fn would ask for it."""
    asked, popen = [], subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *words, **options: asked.append(
        options.get("preexec_fn")) or popen(*words, **options))
    children.run_child(["/bin/true"])
    assert asked == [None]
