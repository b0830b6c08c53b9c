"""Command line: one run from scene to figures, and the tables made of many runs.

    python3 -m driver run SCENE=model LOADING=monotone NP=2 OUT=results/mine
    python3 -m driver scenes | figures DIRECTORY | table [ROWS=1,2,3] | effects SCENE=punch | hard [FAMILY=scale]
    python3 -m driver study SCENE=model FRICTION=0:1:11 | bench [PARTS=products] | saddle SCENE=model OUT=...

Exit status: 0 converged; 2 bad input or missing dependency; 3 no (unique) solution the method can vouch
for; 4 not converged in the allowed iterations. A user's mistake is told in one line.
"""

import argparse
import json
import os
import sys
from pathlib import Path

from . import environment
from .scene import freefem
from .errors import DriverError, InputError, shortage, tell, write_error
from .runs.launch import solve_here
from .runs.run import RESULTS, Run, describe, execute


def parse_pairs(words: list[str]) -> dict[str, str]:
    """NAME=VALUE words as a dictionary with lower-case names."""
    pairs = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name or not value:
            raise InputError(f"{word!r} is not of the form NAME=VALUE")
        if not word.isprintable():
            raise InputError(f"{word!r} holds characters that cannot be printed")
        if name.lower() in pairs:
            raise InputError(f"{name.upper()} is given twice")
        pairs[name.lower()] = value
    return pairs


def command_run(words: list[str]) -> None:
    """One run; without SCENE the list of scenes."""
    pairs = parse_pairs(words)
    if "scene" not in pairs:
        print("make run SCENE=<name or path to an .edp>; the scenes that ship:")
        for name, text in freefem.scenes().items():
            print(f"  {name:20s} {text}")
        return
    run = Run.from_pairs(pairs)
    print(describe(execute(run), run.out))


def command_model(words: list[str]) -> None:
    """The model example under both loading histories, in results/model-<loading> (or OUT-<loading>)."""
    pairs = parse_pairs(words)
    base = pairs.get("out", str(RESULTS / "model"))
    for loading in [pairs["loading"]] if "loading" in pairs else ["monotone", "nonmonotone"]:
        out = base if {"loading", "out"} <= set(pairs) else f"{base}-{loading}"
        run = Run.from_pairs({**pairs, "scene": "model", "loading": loading, "out": out})
        print(describe(execute(run), run.out))


def command_figures(words: list[str]) -> None:
    """Redraw the figures of finished runs and studies from their files."""
    from .figures.redraw import redraw

    if not words:
        raise InputError("no finished run to draw; 'make run SCENE=model' leaves one in results/model")
    for word in words:
        print(*redraw(Path(word)), sep="\n")


def command_table(words: list[str]) -> None:
    """The slides' table beside ours."""
    from .studies.table import make_table

    make_table(parse_pairs(words))


def command_saddle(words: list[str]) -> None:
    """The FETI-DP saddle-point matrix of a small case, written and drawn."""
    environment.start_petsc()
    from mpi4py import MPI

    from .studies.saddle import write_saddle

    pairs = {"scene": "model", **parse_pairs(words)}
    scene, folder = freefem.find_scene(pairs.pop("scene")), Path(pairs.pop("out", RESULTS / "saddle"))
    for path in write_saddle(scene, pairs, folder, MPI.COMM_WORLD):
        print(os.path.relpath(path))


def command_effects(words: list[str]) -> None:
    """What each declared effect of a scene changes and costs."""
    from .studies.effects import run_effects

    for path in run_effects(parse_pairs(words)):
        print(os.path.relpath(path))


def command_hard(words: list[str]) -> None:
    """The hard cases: each solved and checked, or refused for a stated reason."""
    from .hard.suite import run_suite

    for path in run_suite(parse_pairs(words)):
        print(os.path.relpath(path))


def command_bench(words: list[str]) -> None:
    """What a run costs, beside the slides, a factorization, other programs and the machine's limits."""
    from .bench.suite import run_bench

    for path in run_bench(parse_pairs(words)):
        print(os.path.relpath(path))


def command_study(words: list[str]) -> None:
    """Many values of one parameter on one export."""
    from .studies.study import describe as describe_study
    from .studies.study import make_study

    summary, out = make_study(parse_pairs(words))
    print(describe_study(summary, out))


def command_accuracy(words: list[str]) -> None:
    """What accuracy costs: sweeps over the numerics of a scene, or PART=locking, PART=stopping."""
    from .studies.accuracy import run_accuracy

    for path in run_accuracy(parse_pairs(words)):
        print(os.path.relpath(path))


def command_solve(words: list[str]) -> None:
    """One rank of the SPMD part (started by mpirun)."""
    from mpi4py import MPI

    work = Path(words[0])
    try:
        status, reason = solve_here(work, json.loads((work / "request.json").read_text()))
    except Exception as problem:  # the other ranks know nothing of it and wait for this one: end them
        reason = str(problem) if isinstance(problem, DriverError) else shortage(problem)
        if reason:
            tell(reason)
        else:
            sys.excepthook(*sys.exc_info())
        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(1)
    if MPI.COMM_WORLD.rank == 0:
        (work / "answer.json").write_text(json.dumps({"status": status, "reason": reason}))


COMMANDS = {name.removeprefix("command_"): function for name, function in list(globals().items())
            if name.startswith("command_")}


def main() -> None:
    """Entry point of ``python3 -m driver``."""
    parser = argparse.ArgumentParser(prog="python3 -m driver", description=__doc__.split("\n\n")[0])
    parser.add_argument("command", choices=COMMANDS)
    parser.add_argument("words", nargs="*", help="NAME=VALUE options, or directories for figures")
    given = parser.parse_args()
    try:
        COMMANDS[given.command](given.words)
    except DriverError as problem:
        tell(problem)
        sys.exit(problem.exit_status)
    except OSError as problem:
        tell(write_error(problem))
        sys.exit(2)
    except KeyboardInterrupt as stop:
        if given.command != "solve":  # ranks leave the message to the process that started them
            print(f"interrupted: earlier results and finished runs are as they were{''.join(stop.args)}", file=sys.stderr)
        sys.exit(130)
