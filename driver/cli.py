"""Command line: one run from scene to figures, and the tables made of many runs.

    python3 -m driver run SCENE=model LOADING=monotone NP=2 OUT=results/mine
    python3 -m driver scenes | figures DIRECTORY | table [ROWS=1,2,3] | saddle SCENE=model OUT=...

Exit status: 0 converged; 2 bad input or missing dependency; 3 no (unique) solution the method can vouch
for; 4 not converged in the allowed iterations. A user's mistake is told in one line.
"""

import argparse
import dataclasses
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from . import environment, freefem
from .errors import DriverError, InputError, error_of
from .ledger import never_mattered

RESULTS = environment.ROOT / "results"
# driver options beside quasistatic.Settings; everything else is a parameter of the scene
OPTIONS = ("scene", "np", "out", "fields", "figures", "quiet")


def parse_pairs(words: list[str]) -> dict[str, str]:
    """NAME=VALUE words as a dictionary with lower-case names."""
    pairs = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name or not value:
            raise InputError(f"'{word}' is not of the form NAME=VALUE")
        if name.lower() in pairs:
            raise InputError(f"{name.upper()} is given twice")
        pairs[name.lower()] = value
    return pairs


def _setting(field, text: str):
    """Value of a solver option from its text. Raises InputError for the wrong type."""
    choices = {"preconditioner": ("dirichlet", "none"), "predictor": ("load", "previous"),
               "expansion": ("cg", "gradient")}.get(field.name)
    if choices and text not in choices:
        raise InputError(f"{field.name.upper()} must be one of {', '.join(choices)}, not '{text}'")
    try:
        value = field.type(text)
    except ValueError:
        raise InputError(f"{field.name.upper()} expects {'a whole number' if field.type is int else 'a number'}, not '{text}'") from None
    if field.type is not str and not (0 < value < float("inf")):
        raise InputError(f"{field.name.upper()} must be positive, not '{text}'")
    return value


def _yes(options: dict, name: str, preset: str) -> bool:
    value = options.get(name, preset)
    if value not in ("yes", "no"):
        raise InputError(f"{name.upper()} must be yes or no, not '{value}'")
    return value == "yes"


@dataclasses.dataclass
class Run:
    """A run as asked for on the command line."""

    scene: Path
    out: Path
    ranks: int
    settings: dict
    parameters: dict
    fields: bool = True
    figures: bool = True
    quiet: bool = False

    @classmethod
    def from_pairs(cls, pairs: dict[str, str]) -> "Run":
        """Sort NAME=VALUE pairs into options, solver settings and scene parameters."""
        from .options import Settings

        scene = freefem.find_scene(pairs["scene"])
        ranks = pairs.get("np", "1")
        if not ranks.isdigit() or int(ranks) < 1:
            raise InputError(f"NP expects a number of ranks, not '{ranks}'")
        known = {f.name: f for f in dataclasses.fields(Settings)}
        settings = {n: _setting(known[n], v) for n, v in pairs.items() if n in known}
        parameters = {n: v for n, v in pairs.items() if n not in known and n not in OPTIONS}
        out = Path(pairs["out"]) if "out" in pairs else RESULTS / scene.stem
        return cls(scene, out, int(ranks), settings, parameters, _yes(pairs, "fields", "yes"),
                   _yes(pairs, "figures", "yes"), _yes(pairs, "quiet", "no"))


def execute(run: Run) -> dict:
    """Export, solve, draw; returns the summary. Raises DriverError; `run.out` changes only as a whole."""
    out = run.out.absolute()
    _check_out(out)
    work = out.with_name(f".{out.name}.{os.getpid()}")
    try:
        work.mkdir(parents=True)
    except OSError as problem:
        raise InputError(f"cannot write results to {out.parent}: {problem.strerror}") from None
    try:
        return _execute(run, work, out)
    except OSError as problem:
        raise InputError(f"writing the results failed: {problem}") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _check_out(out: Path) -> None:
    """A run replaces its whole directory: it must be new, empty, or hold an earlier run."""
    if not out.name or out.is_file():
        raise InputError(f"OUT={out} is no directory that results can be written to")
    if out.is_dir() and any(out.iterdir()) and not (out / "summary.json").is_file():
        raise InputError(f"OUT={out} holds files but no earlier run; choose another directory or empty it")


def _execute(run: Run, work: Path, out: Path) -> dict:
    clock = time.perf_counter()
    freefem.export(run.scene, work / "export", run.parameters, run.ranks)
    request = {"scene": run.scene.stem, "settings": run.settings, "fields": run.fields, "output": True,
               "quiet": run.quiet, "seconds": {"export": time.perf_counter() - clock}}
    status, reason = solve(work, request, run.ranks)
    if not (work / "summary.json").exists():
        raise error_of(status, reason)
    if run.figures:
        from .figures import draw_run

        draw_run(work)
    (work / "export" / "freefem.log").rename(work / "freefem.log")
    shutil.rmtree(work / "export")
    _publish(work, out)
    if status:
        raise error_of(status, f"{reason}; what was found is kept in {out}")
    return json.loads((out / "summary.json").read_text())


def solve(work: Path, request: dict, ranks: int) -> tuple[int, str]:
    """Run the SPMD part on `ranks` ranks; exit status and reason."""
    if ranks == 1:
        return solve_here(work, request)
    (work / "request.json").write_text(json.dumps(request))
    command = [*environment.mpirun(ranks), sys.executable, "-m", "driver", "solve", str(work)]
    env = environment.child_environment()
    env["PYTHONPATH"] = os.pathsep.join(filter(None, [str(environment.ROOT), env.get("PYTHONPATH")]))
    done = subprocess.run(command, env=env, stdin=subprocess.DEVNULL)
    try:
        answer = json.loads((work / "answer.json").read_text())
    except FileNotFoundError:
        raise InputError(f"a rank of the solver died (mpirun exit {done.returncode}); nothing was changed") from None
    for name in ("request.json", "answer.json"):
        (work / name).unlink()
    return answer["status"], answer["reason"]


def solve_here(work: Path, request: dict) -> tuple[int, str]:
    """The SPMD part on the ranks this process was started with."""
    environment.prepare_petsc()
    try:
        import petsc4py

        petsc4py.init(["driver", "-no_signal_handler"])  # SIGINT and SIGPIPE are ours to report
        from mpi4py import MPI

        from . import solve as spmd
    except ImportError as problem:
        raise InputError(f"the Python package {problem.name} is not installed; {environment.SET_UP}") from None
    return spmd.run(work, request, MPI.COMM_WORLD)


def _publish(work: Path, out: Path) -> None:
    """Put the finished directory in the place of an older one, which is removed last."""
    old = out.with_name(f".{out.name}.old.{os.getpid()}")
    if out.exists():
        out.rename(old)
    work.rename(out)
    shutil.rmtree(old, ignore_errors=True)


def describe(summary: dict, out: Path) -> str:
    """Few lines about a finished run."""
    sizes, counts, worst = summary["sizes"], summary["counts"], max(summary["residuals"].values(), default=0)
    s, idle = summary["seconds"], never_mattered(summary["effects_ledger"])
    return (f"{' '.join(filter(None, (summary['scene'], summary['variant'])))}: {sizes['subdomains']} subdomains, {sizes['primal_dofs']} primal and "
            f"{sizes['dual_dofs']} dual dofs, {summary['steps']} steps\n"
            f"  {counts['fixed_point_iterations']} fixed-point iterations, {counts['dual_multiplications']} products with F, "
            f"largest KKT residual {worst:.1e}, force balance {summary['balance']:.1e}\n"
            f"  {s['total']:.2f} s (FreeFEM {s['export']:.2f}, setup {s['setup']:.2f}, solve {s['solve']:.2f}, output "
            f"{s['output']:.2f}), results in {os.path.relpath(out)}" + "".join(f"\n  {line}" for line in idle))


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
    """Redraw the figures of finished runs from their files."""
    from .figures import draw_run

    if not words:
        raise InputError("no finished run to draw; 'make run SCENE=model' leaves one in results/model")
    for word in words:
        if not (Path(word) / "summary.json").is_file():
            raise InputError(f"{word} holds no finished run (no summary.json)")
        for path in draw_run(Path(word)):
            print(path)


def command_table(words: list[str]) -> None:
    """The slides' table beside ours."""
    from .table import make_table

    make_table(parse_pairs(words))


def command_saddle(words: list[str]) -> None:
    """The FETI-DP saddle-point matrix of a small case, written and drawn."""
    environment.prepare_petsc()
    from mpi4py import MPI

    from .saddle import write_saddle

    pairs = {"scene": "model", **parse_pairs(words)}
    scene, folder = freefem.find_scene(pairs.pop("scene")), Path(pairs.pop("out", RESULTS / "saddle"))
    for path in write_saddle(scene, pairs, folder, MPI.COMM_WORLD):
        print(os.path.relpath(path))


def command_effects(words: list[str]) -> None:
    """What each declared effect of a scene changes and costs."""
    from .effects import run_effects

    for path in run_effects(parse_pairs(words)):
        print(os.path.relpath(path))


def command_solve(words: list[str]) -> None:
    """One rank of the SPMD part (started by mpirun)."""
    from mpi4py import MPI

    work = Path(words[0])
    status, reason = solve_here(work, json.loads((work / "request.json").read_text()))
    if MPI.COMM_WORLD.rank == 0:
        (work / "answer.json").write_text(json.dumps({"status": status, "reason": reason}))


COMMANDS = {name.removeprefix("command_"): function for name, function in list(globals().items())
            if name.startswith("command_")}


def main() -> None:
    """Entry point of ``python3 -m driver``."""
    environment.single_threaded()
    parser = argparse.ArgumentParser(prog="python3 -m driver", description=__doc__.split("\n\n")[0])
    parser.add_argument("command", choices=COMMANDS)
    parser.add_argument("words", nargs="*", help="NAME=VALUE options, or directories for figures")
    given = parser.parse_args()
    try:
        COMMANDS[given.command](given.words)
    except DriverError as problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(problem.exit_status)
    except KeyboardInterrupt:
        print("interrupted: nothing was changed", file=sys.stderr)
        sys.exit(130)
    except ImportError as problem:
        print(f"error: the Python package {problem.name} is not installed; {environment.SET_UP}", file=sys.stderr)
        sys.exit(2)
