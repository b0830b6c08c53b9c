"""Command line: one run from scene to figures, and the studies made of many runs.

    python3 -m driver run SCENE=model LOADING=monotone NP=2 OUT=results/mine
    python3 -m driver figures DIRECTORY ...

Commands and options: options.COMMANDS and options.TABLE. Exit status: 0 converged; 1 a defect of
the suite; 2 bad input or missing dependency; 3 no (unique) solution the method can vouch for; 4 not
converged in time.
"""

import argparse
import sys
from pathlib import Path

from .timing import STARTED  # the earlier the better: users wait for imports, too
from . import environment, options
from .arguments import parse_pairs
from .errors import DriverError, InputError, report_error, shortage, write_error
from .runs import launch
from .runs import run as runs
from .runs.run import Run, execute
from .scene import freefem
from .text import shown

LOADINGS = ("monotone", "nonmonotone")  # of the model example


# ---- runs ----------------------------------------------------------------------------------------

def run(words: list[str]) -> None:
    """One run; without SCENE the list of scenes."""
    pairs = parse_pairs(words)
    if "scene" in pairs:
        _execute(pairs, STARTED)
        return
    print("make run SCENE=<name or path to an .edp>; the scenes that ship:")
    for name, text in freefem.scenes().items():
        print(f"  {name:20s} {text}")


def model(words: list[str]) -> None:
    """The model example under both loading histories, or under the one that is given."""
    pairs = parse_pairs(words)
    options.read("model", pairs)
    pairs["scene"] = "model"
    if {"loading", "out"} <= set(pairs):
        _execute(pairs, STARTED)
        return
    base = pairs.get("out", str(options.RESULTS / "model"))
    for loading in [pairs["loading"]] if "loading" in pairs else LOADINGS:
        _execute({**pairs, "loading": loading, "out": f"{base}-{loading}"})


def _execute(pairs: dict[str, str], since: float | None = None) -> None:
    request = Run.from_pairs(pairs)
    summary = execute(request, since)
    from .runs.outcome import describe

    print(describe(summary, request.out))


def figures(words: list[str]) -> None:
    """Redraw the figures of finished runs and studies from their files."""
    from .figures.redraw import redraw

    drawn = False
    for folder in (folders := _finished("figures", words)):
        paths = redraw(folder)
        drawn |= bool(paths)
        _list(paths)
    if not drawn:
        raise InputError(f"{shown(folders[0])} holds a study without pictures; its tables have "
                         "all that it found")


def report(words: list[str]) -> None:
    """Renew the pages of finished runs and studies from their files."""
    _list([_page(folder) for folder in _finished("report", words)])


def _finished(command: str, words: list[str]) -> list[Path]:
    """The directories that `words` name, as OUT=directory or by themselves, or all in results/."""
    plain = [Path(word) for word in words if "=" not in word]
    given = options.read(command, parse_pairs([word for word in words if "=" in word]))["out"]
    if plain or given:
        return [*plain, *([given] if given else [])]
    from .figures.redraw import finished

    found = list(finished(options.RESULTS))
    if not found:
        raise InputError("results holds no finished run or study; 'make run SCENE=model' leaves "
                         "one in results/model")
    return found


# ---- studies -------------------------------------------------------------------------------------

def study(words: list[str]) -> None:
    """Many values of one parameter on one export."""
    from .studies.study import describe as describe_study
    from .studies.study import make_study

    summary, out = make_study(parse_pairs(words), STARTED)
    print(describe_study(summary, out))


def table(words: list[str]) -> None:
    """The slides' table beside ours."""
    from .studies.table import make_table

    make_table(parse_pairs(words))


def effects(words: list[str]) -> None:
    """What each declared effect of a scene changes and costs."""
    from .studies.effects import run_effects

    _leave(run_effects(parse_pairs(words)))


def accuracy(words: list[str]) -> None:
    """What accuracy costs: sweeps of every numerical choice, or another PART."""
    from .studies.accuracy import run_accuracy

    _leave(run_accuracy(parse_pairs(words)))


def saddle(words: list[str]) -> None:
    """The FETI-DP saddle-point matrix of a small case, written and drawn."""
    given = options.read("saddle", parse_pairs(words))
    environment.start_petsc()
    from mpi4py import MPI

    from .studies.saddle import write_saddle

    scene = freefem.find_scene(given["scene"])
    _list(write_saddle(scene, given.parameters, given["out"], MPI.COMM_WORLD))


def hard(words: list[str]) -> None:
    """The hard cases: each solved and checked, or refused for a stated reason."""
    from .hard.suite import run_suite

    _leave(run_suite(parse_pairs(words)))


def verify(words: list[str]) -> None:
    """Published cases of other codes and closed forms, solved and compared."""
    from .verify.suite import run_suite

    _leave(run_suite(parse_pairs(words)))


def bench(words: list[str]) -> None:
    """What a run costs, beside the slides, other programs and the machine's limits."""
    from .bench.suite import run_bench

    _leave(run_bench(parse_pairs(words)))


def docs(words: list[str]) -> None:
    """What the documents have from the code and from reference files, renewed."""
    environment.start_petsc()
    from .studies.docs import renew

    _list(renew(options.read("docs", parse_pairs(words))["gallery"]))


def _leave(paths: list[Path]) -> None:
    """The files of a study, and the page that is made of them."""
    folders = {path.parent.parent if path.parent.name == "figures" else path.parent
               for path in paths}
    _list([*paths, *map(_page, sorted(folders))])


def _page(folder: Path) -> Path:
    """The page of a finished run or study."""
    from .report.study import write

    return write(folder)


def _list(paths: list[Path]) -> None:
    """The files that were made."""
    for path in paths:
        print(shown(path))


# ---- ranks ---------------------------------------------------------------------------------------

def solve(words: list[str]) -> None:
    """One rank of a stage that several share (started by mpirun): its name, where it works."""
    if len(words) != 2:
        raise InputError("solve is what the processes of a run are started with; 'make run "
                         "SCENE=model' starts a run")
    from mpi4py import MPI

    work = Path(words[1])
    try:
        stage = launch.load(_stage(words[0]))
        request = launch.awaited(work, stage)
        if request is None:
            return
        status, reason = launch.solve_here(work, request, stage)
    except Exception as problem:  # the other ranks do not know of it and wait for this one
        reason = str(problem) if isinstance(problem, DriverError) else shortage(problem)
        if reason:
            report_error(reason)
        else:
            sys.excepthook(*sys.exc_info())
        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(1)
    if MPI.COMM_WORLD.rank == 0:
        launch.write_answer(work, status, reason)


def _stage(name: str):
    """A stage that ranks share, by its name. Raises InputError if there is none."""
    for stage in (runs.solver, runs.search):
        if name == stage.__name__:
            return stage
    from .studies.study import parametric

    if name != parametric.__name__:
        raise InputError(f"ranks have no stage {name}")
    return parametric


# ---- entry ---------------------------------------------------------------------------------------

ENTRIES = {entry.__name__: entry for entry in (
    run, model, table, effects, study, accuracy, bench, hard, verify, saddle, docs, figures, report,
    solve)}
EARLY = ("run", "model")  # start FreeFEM before anything that needs NumPy is imported


def _without_dashes(word: str) -> str:
    """--friction=0.2 as FRICTION=0.2."""
    name, _, value = word.lstrip("-").partition("=")
    return f"{name.upper() or 'NAME'}={value or '...'}"


def main() -> None:
    """Entry point of ``python3 -m driver``; exits with a status that says how it ended."""
    parser = argparse.ArgumentParser(prog="python3 -m driver", description=__doc__.split("\n\n")[0])
    names = ", ".join(name for name in ENTRIES if name != solve.__name__)
    parser.add_argument("command", help=names)
    parser.add_argument("words", nargs="*", help="NAME=VALUE options, or directories for figures")
    given, strange = parser.parse_known_args()
    if given.command not in ENTRIES:
        parser.error(f"there is no command {given.command}; there are {names}")
    try:
        if strange:
            raise InputError(f"'{strange[0]}' is not of the form NAME=VALUE: options have no "
                             f"dashes, as in {_without_dashes(strange[0])}")
        environment.check_process()
        if given.command not in EARLY:
            environment.prepare_numpy()
        ENTRIES[given.command](given.words)
    except DriverError as problem:
        report_error(problem)
        sys.exit(problem.exit_status)
    except OSError as problem:
        report_error(write_error(problem))
        sys.exit(2)
    except KeyboardInterrupt as stop:
        if given.command != "solve":  # ranks leave the message to the process that started them
            message = "interrupted: earlier results and finished runs are unchanged"
            print(message, *stop.args, sep="", file=sys.stderr)
        sys.exit(130)
