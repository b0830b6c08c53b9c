"""Environment: failing disks, programs, exports, processes; one line says so, no result is lost."""

import contextlib
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from ..children import program, python_path
from ..environment import ROOT
from ..march.checkpoint import NAME
from ..options import OF_RUNS
from ..runs.request import Request
from .case import BLOCK, Case, Check, Outcome, run_command, run_scene, run_words



# ---- what surrounds the run ----------------------------------------------------------------------

def mounted(how: str, instead: str):
    """A run whose results go to a file system of its own, mounted with the options `how`.

    Where a user may not mount, `instead` is a shell command that has the same effect as nearly as
    can be.
    """
    def perform(case, size, directory):
        directory.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as place:
            mount = f"mount -t tmpfs -o {how} none {shlex.quote(place)}"
            own = ["unshare", "-rm", "sh", "-c"]
            prefix = [*own, f'{mount} && exec "$@"', "sh"]
            if subprocess.run([*own, mount], stderr=subprocess.DEVNULL).returncode:
                instead_here = f'cd {shlex.quote(place)} && {instead} && cd / && exec "$@"'
                prefix = ["sh", "-c", instead_here, "sh"]
            words = run_words(case, size, Path(place) / "out")
            return run_command(words, directory, case.seconds, prefix)

    return perform


def without(*programs: str):
    """A run on a machine where `programs` are not installed."""
    def perform(case, size, directory):
        with tempfile.TemporaryDirectory() as place:
            for folder in reversed(os.environ["PATH"].split(os.pathsep)):
                for path in Path(folder).glob("*"):
                    link = Path(place) / path.name
                    link.unlink(missing_ok=True)
                    link.symlink_to(path)
            for name in programs:
                (Path(place) / name).unlink(missing_ok=True)
            words = run_words(case, size, directory)
            return run_command(words, directory, case.seconds, PATH=place)

    return perform


def freefem(script: str):
    """A run with a script for FreeFEM; `$freefem` is the program, `$export` its directory."""
    def perform(case, size, directory):
        with tempfile.TemporaryDirectory() as place:
            path = Path(place) / "FreeFem++"
            find = 'for word; do test "$last" = -export && export=$word; last=$word; done'
            path.write_text(f"#!/bin/sh\nfreefem={shlex.quote(program('FreeFem++'))}\n{find}\n"
                            + script)
            path.chmod(0o755)
            search = os.pathsep.join([place, os.environ["PATH"]])
            words = run_words(case, size, directory)
            return run_command(words, directory, case.seconds, PATH=search)

    return perform


def no_package(name: str):
    """A run for which a Python package is not installed."""
    def perform(case, size, directory):
        with tempfile.TemporaryDirectory() as place:
            text = f"raise ModuleNotFoundError('no such package', name={name!r})\n"
            (Path(place) / f"{name}.py").write_text(text)
            search = os.pathsep.join([place, python_path()])
            words = run_words(case, size, directory)
            return run_command(words, directory, case.seconds, PYTHONPATH=search)

    return perform


def edited(case, size, directory):
    """A scene that is edited while FreeFEM runs."""
    with tempfile.TemporaryDirectory() as place:
        scene = Path(place) / "own.edp"
        shutil.copy(ROOT / "edp" / f"{case.scene}.edp", scene)
        edit = freefem(f'"$freefem" "$@"; echo "// more" >> {shlex.quote(str(scene))}\n')
        return edit(replace(case, scene=str(scene)), size, directory)


def spoiled(spoil):
    """The solver alone, on a sealed export that `spoil`(directory of the export) has changed."""
    def perform(case, size, directory):
        from ..scene.freefem import export, find_scene
        from ..scene.seal import read

        with tempfile.TemporaryDirectory() as place:
            work = Path(place)
            pairs = {name.lower(): value for name, value in case.arguments(size).items()}
            parameters = {name: value for name, value in pairs.items() if name not in OF_RUNS}
            export(find_scene(case.scene), work / "export", parameters)
            Request("block", "", parameters, {}, quiet=True, fields=False, errors="no",
                    fingerprint={"scene or parameters": read(work / "export").content}).write(work)
            spoil(work / "export")
            clock = time.perf_counter()
            outcome = run_command(["solve", "solver", place], directory, case.seconds)
            if (work / "answer.json").exists():
                answer = json.loads((work / "answer.json").read_text())
                outcome.status, outcome.message = answer["status"], answer["reason"]
            outcome.seconds = time.perf_counter() - clock
            return outcome

    return perform


def _flip(export: Path) -> None:
    content = bytearray((export / "block-0.bin").read_bytes())
    content[len(content) // 2] ^= 1
    (export / "block-0.bin").write_bytes(content)


def _cut(export: Path) -> None:
    content = (export / "block-0.bin").read_bytes()
    (export / "block-0.bin").write_bytes(content[: len(content) // 2])


# ---- interruptions -------------------------------------------------------------------------------

def stopped(number: signal.Signals, rank: bool = False):
    """A run that a signal ends, itself or a rank, after its first checkpoint, and made again."""
    def heed_interrupts():
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def perform(case, size, directory):
        words = [word for word in run_words(case, size, directory) if word != "RESUME=no"]
        env = {**os.environ, "PYTHONPATH": python_path()}
        directory.parent.mkdir(parents=True, exist_ok=True)
        with subprocess.Popen([sys.executable, "-m", "driver", *words], cwd=ROOT, env=env,
                              stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL, preexec_fn=heed_interrupts) as child:
            limit, checkpoints = time.monotonic() + case.seconds, f".{directory.name}.*/{NAME}"
            while child.poll() is None and not list(directory.parent.glob(checkpoints)):
                if time.monotonic() > limit:
                    child.kill()
                time.sleep(0.01)
            for pid in _ranks(directory) if rank else [child.pid]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, number)
            child.wait()
        outcome = run_command(words, directory, case.seconds)
        if outcome.status == 0 and outcome.summary["resumed_after_step"] == 0:
            outcome.status, outcome.message = -1, "started over"
        if list(directory.parent.glob(f".{directory.name}.*")):
            outcome.status, outcome.message = -1, "a private directory was left"
        return outcome

    return perform


def _ranks(directory: Path) -> list[int]:
    """One of the ranks that work for the results `directory`."""
    ranks, hidden = [], os.fsencode(directory.parent / f".{directory.name}.")
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            line = path.read_bytes().split(b"\0")
            if b"solve" in line and hidden in b"\0".join(line) and b"mpirun" not in line[0]:
                ranks.append(int(path.parent.name))
    return ranks[-1:]


def undisturbed(case: Case, size: dict, outcome: Outcome) -> Check:
    """The same run without interruption: every table, to the last byte."""
    with tempfile.TemporaryDirectory() as place:
        whole = run_scene(case, size, Path(place) / "run").directory
        names = sorted(path.name for path in whole.glob("*.csv"))
        same = all((whole / name).read_bytes() == (outcome.directory / name).read_bytes()
                   for name in names)
        return Check("the run without interruption, bit by bit", float(not (same and names)), 0.5)


def _refused(name: str, perform, reason: str, fast: bool = False, **options) -> Case:
    return Case(name, BLOCK, options, status=2, reason=reason, perform=perform, fast=fast)


CASES = [
    _refused("disk full while FreeFEM writes", mounted("size=24k", "ulimit -f 20"),
             "No space left|File too large|signal 25", fast=True),
    _refused("disk full while results are written", mounted("size=1m", "ulimit -f 100"),
             "No space left.*goes on after step|File too large|signal 25", FIELDS="yes", STEPS=40,
             CELLS=2),
    _refused("results on a read-only disk", mounted("ro", ": > out && mkdir .out"),
             "cannot write results.*Read-only|is no directory", fast=True),
    _refused("FreeFEM missing", without("FreeFem++"),
             "FreeFem\\+\\+ is not installed; run 'make setup'"),
    _refused("mpirun missing", without("mpirun"), "mpirun is not installed; run 'make setup'",
             NP=2),
    _refused("petsc4py missing", no_package("petsc4py"),
             "package petsc4py is not installed; run 'make setup'", fast=True),
    _refused("petsc4py missing on ranks", no_package("petsc4py"),
             "package petsc4py is not installed", NP=2),
    _refused("FreeFEM fails", freefem("echo 'Out of bound'; exit 6\n"), "FreeFEM failed.*exit 6"),
    _refused("FreeFEM is killed", freefem("kill -9 $$\n"), "FreeFEM was killed by signal 9",
             fast=True),
    _refused("FreeFEM writes nothing", freefem("exit 0\n"), "left no manifest.json"),
    _refused("FreeFEM loses a block", freefem('"$freefem" "$@"; rm "$export/block-0.bin"\n'),
             "block-0.bin is missing"),
    _refused("FreeFEM writes half a block",
             freefem('"$freefem" "$@"; truncate -s 4000 "$export/block-0.bin"\n'), "is truncated"),
    _refused("FreeFEM writes half a manifest",
             freefem('"$freefem" "$@"; truncate -s 400 "$export/manifest.json"\n'),
             "manifest.json is not readable"),
    _refused("scene edited while FreeFEM runs", edited, "stale", fast=True),
    _refused("export with a flipped bit", spoiled(_flip), "was changed after FreeFEM wrote it",
             fast=True),
    _refused("export cut in half", spoiled(_cut), "is truncated"),
    _refused("export without its seal", spoiled(lambda export: (export / "seal.json").unlink()),
             "seal.json is missing"),
    Case("interrupted", BLOCK, {"STEPS": 40}, checks=(
        undisturbed,), perform=stopped(signal.SIGINT)),
    Case("driver killed", BLOCK, {"STEPS": 40}, checks=(undisturbed,),
         perform=stopped(signal.SIGKILL), fast=True),
    Case("a rank killed", BLOCK, {"STEPS": 20, "NP": 2}, checks=(undisturbed,),
         perform=stopped(signal.SIGKILL, rank=True)),
]
