"""One run from scene to figures: the stages in their order, in a private directory that is renamed.

    run = Run.from_pairs({"scene": "model", "loading": "monotone", "out": "results/mine"})
    summary = execute(run)
"""

import contextlib
import dataclasses
import json
import re
import shutil
import sys
import time
import traceback
from pathlib import Path

from .. import options
from ..arguments import EVERY
from ..errors import PARTIAL, InputError, error_of, words_of
from ..estimates import refinement
from ..march import checkpoint
from ..options import RESULTS
from ..scene import explain, freefem, grammar, seal
from ..scene.manifest import Manifest
from ..text import shown
from . import drawing, guard, hosts, launch, seconds, watch
from .request import Request
from .workspace import Workspace, unconverged


NO_FIGURES = ("the figures could not be drawn: {}; 'make figures' draws them from the results")
NO_PAGE = "report.html could not be written: {}; 'make report' writes it from the results"


@dataclasses.dataclass
class Run:
    """A run as a user asks for it; what the entries mean stands in options.TABLE."""

    scene: Path  # the script
    out: Path
    ranks: int | None  # None: the solver's follow from the size, and FreeFEM has one
    settings: dict  # of the solver, only those that were given
    parameters: dict[str, str]  # of the scene, as text
    without: tuple[str, ...] = ()
    fields: bool = True
    figures: bool = True
    animate: bool = False
    quiet: bool = False
    resume: bool = True
    adapt: int = 0
    errors: str = "yes"
    accuracy: tuple[float, str] | None = None
    quantity: str = ""

    @classmethod
    def from_pairs(cls, pairs: dict[str, str]) -> "Run":
        """A run from NAME=VALUE pairs with lower-case names. Raises InputError."""
        given = options.read("run", pairs)
        scene = freefem.find_scene(given["scene"])
        spelled = grammar.parameters(scene)
        for name in sorted(given.parameters):
            if spelled.get(name, name) in grammar.RESERVED:
                raise InputError(f"{name.upper()} is no parameter of a scene: FreeFEM and the "
                                 "driver use the word themselves")
        if given["animate"] and not given["fields"]:
            raise InputError("ANIMATE=yes needs the fields: leave FIELDS=no out")
        if given["quantity"] and given["errors"] != "yes":
            raise InputError("QUANTITY needs estimates of errors, which "
                             f"ERRORS={given['errors']} leaves out: leave one of them out")
        searched = given["adapt"] or given["accuracy"]
        if "estimator" in given.settings and given["errors"] == "no" and not searched:
            raise InputError("ESTIMATOR says how the error in the energy norm is estimated, which "
                             "ERRORS=no leaves out: leave one of them out")
        cycles = given.settings.get("cycles", EVERY)
        if given["accuracy"] and not re.fullmatch(rf"{EVERY}|\d+", cycles):
            raise InputError("ACCURACY compares runs of the same cycles: give their number, such "
                             "as CYCLES=10")
        names = ("without", "fields", "figures", "animate", "quiet", "resume", "adapt", "errors",
                 "accuracy", "quantity")
        return cls(scene, given["out"] or RESULTS / scene.stem,
                   hosts.use(given["hosts"], given["np"]), given.settings,
                   given.parameters, **{name: given[name] for name in names})


    @property
    def front_ranks(self) -> int:
        """The ranks of what begins before the size is known."""
        return self.ranks or 1


# ---- what the ranks do ---------------------------------------------------------------------------

def solver():
    """Stage: the solution of a run."""
    from .solve import Solution

    return Solution()


def search():
    """Stage: the search for settings that reach an accuracy."""
    from .search import run

    return launch.Stage(run)


# ---- the stages of a run -------------------------------------------------------------------------

def execute(run: Run, since: float | None = None) -> dict:
    """Export, solve, draw; the summary. Raises DriverError; `run.out` changes only as a whole.

    Where something else than results has come to be at `run.out` meanwhile, it becomes a place
    beside that. Seconds count from `since`, a time.perf_counter(), by default from now on.
    """
    since = time.perf_counter() if since is None else since
    with Workspace(run.out) as place:
        hosts.check(place.path, run.front_ranks)
        cycles = _refine(run, place)
        if run.accuracy:
            with launch.Ranks(place.path, search, run.front_ranks) as ranks:
                status, reason = solve(run, ranks, Request.of(run))
        else:
            request = Request.of(run, refined=tuple(map(str, cycles)))
            status, reason = _cycle(run, place, place.path, cycles, request)
        if not (place.path / "summary.json").exists():
            raise error_of(status, reason)
        _complete(run, place.path, cycles, since)
        out = _publish(place, converged=not status)
        if status:
            raise error_of(status, f"{reason}{PARTIAL}{shown(out)}")
        run.out = out
        return json.loads((out / "summary.json").read_text())


def _refine(run: Run, place: Workspace) -> list[Path]:
    """Directories of the refinement cycles, each with the element sizes of the mesh after it."""
    cycles = []
    for number in range(1, run.adapt + 1):
        work = place.path / f"cycle-{number - 1}"
        work.mkdir()
        request = Request.of(run, fields=False, errors="energy", refine=True,
                             settings=refinement.coarse(run.settings))
        status, reason = _cycle(run, place, work, cycles, request)
        if status == InputError.exit_status:
            shutil.rmtree(work)  # refused: the same command would be once more
        if status:
            raise error_of(status, f"refinement cycle {number}: {reason}")
        cycles.append(work)
        _say(run, f"refinement cycle {number} of {run.adapt}: {refinement.describe(work)}")
    return cycles


def _cycle(run: Run, place: Workspace, work: Path, before: list[Path],
           request: Request) -> tuple[int, str]:
    """Export and solve in `work` on the mesh after the cycles `before`; exit status and reason.

    FreeFEM runs again on resuming: only equal records show that nothing behind them changed.
    """
    clock = time.perf_counter()
    sizes = before[-1] / refinement.STEM if before else None
    waiting = watch.Waiting(run.scene.stem, work / "export", run.quiet)

    def prepare() -> bool:  # what takes time and does not need the export
        checkpoint.program()
        ranks.prepare()
        return waiting.update()

    with launch.Ranks(work, solver, run.ranks) as ranks:
        manifest = freefem.export(run.scene, work / "export", run.parameters, run.front_ranks,
                                  sizes, prepare, run.without)
        choices = {"fields": request.fields, "without": list(request.without)}
        content = seal.read(work / "export").content
        identity = checkpoint.fingerprint(content, {**request.settings, **choices})
        _resume(run, place, work, identity)
        spent = {**refinement.seconds(before), "export": time.perf_counter() - clock}
        request = dataclasses.replace(request, fingerprint=identity, seconds=spent)
        return solve(run, ranks, request, manifest)


def solve(run: Run, ranks: launch.Ranks, request: Request,
          manifest: Manifest | None = None) -> tuple[int, str]:
    """Exit status and reason of a stage; a refusal has the scene's line."""
    status, reason = ranks.solve(request, manifest)
    refused = status == InputError.exit_status
    return status, explain.placed(reason, run.scene) if refused else reason


def _resume(run: Run, place: Workspace, work: Path, identity: dict) -> None:
    """Take the checkpoint of an interrupted run, unless the run shall start over; say so."""
    steps, misfits = place.take_up(work, identity, run.resume)
    if steps:
        _say(run, f"goes on after step {steps} of an interrupted run; RESUME=no would start over")
    elif misfits:
        reason = " and ".join(sorted(misfits))
        _say(run, f"starts over; there is an interrupted run, but {reason}")


def _complete(run: Run, work: Path, cycles: list[Path], since: float) -> None:
    """Table of the refinement cycles, figures, page; what only the stages needed goes.

    The user has waited `since`, a time.perf_counter().
    """
    if cycles:
        refinement.report(work, cycles)
        for cycle in cycles:
            shutil.rmtree(cycle)
    clock = time.perf_counter()
    drawn = "figures" in json.loads((work / "summary.json").read_text())["seconds"]
    if run.figures and not drawn:
        attempt(lambda: drawing.draw(work), work)
    if run.animate:
        _animate(work)
    if run.figures or run.animate:
        seconds.count(work, "figures", time.perf_counter() - clock)
    seconds.count_rest(work, since)
    attempt(lambda: _report(work), work, NO_PAGE)
    (work / "export" / "freefem.log").rename(work / "freefem.log")
    for folder in ("export", "companions"):  # the latter if a rank has died over the estimates
        shutil.rmtree(work / folder, ignore_errors=True)


def _animate(work: Path) -> None:
    """The animation."""
    def draw():
        from ..figures.animation import draw_animation

        draw_animation(work)

    attempt(draw, work)


def _report(work: Path) -> None:
    """The page of the run."""
    from ..report import run as page

    page.write(work)


def attempt(make, work: Path, failed: str = NO_FIGURES) -> None:
    """Make what the results can do without; where it fails a line says so, the log has more."""
    try:
        make()
    except Exception as problem:  # whatever it is, the results stand
        with contextlib.suppress(OSError), open(work / "run.log", "a") as log:
            traceback.print_exc(file=log)
        print(f"warning: {failed.format(words_of(problem))}", file=sys.stderr)


def _publish(place: Workspace, converged: bool) -> Path:
    """Where the results are now: partial ones do not replace those of a converged run."""
    out = place.out
    if not converged and guard.converged(out):
        out = unconverged(out)
    return place.publish(out)


def _say(run: Run, line: str) -> None:
    if not run.quiet:
        print(f"{run.scene.stem}: {line}", flush=True)
