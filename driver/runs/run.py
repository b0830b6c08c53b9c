"""One run from scene to figures: the stages in their order, in a private directory that is renamed at the end."""

import dataclasses
import json
import os
import shutil
import time
from pathlib import Path

from ..estimates import adaptivity, budget
from .. import environment
from ..scene import freefem, seal
from . import goal, launch
from ..arguments import choice, count, positive, yes
from ..march.checkpoint import fingerprint
from ..errors import InputError, error_of
from ..results.ledger import never_mattered
from .workspace import Workspace

RESULTS = environment.ROOT / "results"
# driver options beside options.Settings; everything else is a parameter of the scene
OPTIONS = ("scene", "np", "out", "fields", "figures", "quiet", "resume", "adapt", "errors", "accuracy")
ERRORS = ("yes", "energy", "no")
RANKS_PER_CORE = 64  # more could not even start
MOST_CYCLES = 20  # of refinement, each with four times the triangles


def _setting(field, text: str):
    """Value of a solver option from its text. Raises InputError for the wrong type."""
    choices = {"preconditioner": ("deflated", "dirichlet", "none"), "predictor": ("load", "previous"),
               "expansion": ("contact", "cg", "gradient"), "corrector": ("contact", "none"),
               "estimator": ("equilibrated", "recovery", "none"), "uniqueness": ("auto", "yes", "no"),
               "linearization": ("initial", "updated")}.get(field.name)
    if choices:
        return choice({field.name: text}, field.name, choices, "")
    if field.type is int:
        return count(field.name, text, "a whole number", 1)
    return positive(field.name, text)


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
    resume: bool = True  # go on where an interrupted run has stopped
    adapt: int = 0  # cycles of adaptive refinement before the run itself
    errors: str = "yes"  # which error estimates: all, "energy": that of the energy norm alone, or "no"
    accuracy: tuple[float, str] | None = None  # relative error asked for and quantity: the settings follow from it

    @classmethod
    def from_pairs(cls, pairs: dict[str, str]) -> "Run":
        """Sort NAME=VALUE pairs into options, solver settings and scene parameters."""
        from ..options import Settings

        scene = freefem.find_scene(pairs["scene"])
        ranks = count("np", pairs.get("np", "1"), "a number of ranks", 1, RANKS_PER_CORE * os.cpu_count())
        adapt = count("adapt", pairs.get("adapt", "0"), "a number of refinement cycles", 0, MOST_CYCLES)
        known = {f.name: f for f in dataclasses.fields(Settings)}
        settings = {n: _setting(known[n], v) for n, v in pairs.items() if n in known}
        parameters = {n: v for n, v in pairs.items() if n not in known and n not in OPTIONS}
        errors = choice(pairs, "errors", ERRORS, "yes")
        accuracy = goal.parse(pairs["accuracy"]) if "accuracy" in pairs else None
        chosen = [name for name in goal.CHOSEN if accuracy and name in pairs]
        if chosen:
            raise InputError(f"ACCURACY chooses {chosen[0].upper()} itself: leave one of them out")
        out = Path(pairs["out"]) if "out" in pairs else RESULTS / scene.stem
        for name in sorted(set(parameters) & set(freefem.RESERVED)):
            raise InputError(f"{name.upper()} is no parameter of a scene: FreeFEM and the driver use the word themselves")
        return cls(scene, out, ranks, settings, parameters, yes(pairs, "fields", "yes"), yes(pairs, "figures", "yes"),
                   yes(pairs, "quiet", "no"), yes(pairs, "resume", "yes"), adapt, errors, accuracy)


def execute(run: Run) -> dict:
    """Export, solve, draw; returns the summary. Raises DriverError; `run.out` changes only as a whole."""
    with Workspace(run.out.absolute()) as place:
        return _execute(run, place)


def _execute(run: Run, place: Workspace) -> dict:
    work, out = place.path, place.out
    cycles = _refine(run, place)
    request = {"fields": run.fields, "errors": run.errors, "path": str(run.scene), "parameters": run.parameters,
               "cycles": [str(cycle) for cycle in cycles]}
    if run.accuracy:
        request |= {"scene": run.scene.stem, "settings": run.settings, "quiet": run.quiet, "accuracy": run.accuracy}
        status, reason = launch.solve(work, request, run.ranks)
    else:
        status, reason = _cycle(run, place, work, cycles, request)
    if not (work / "summary.json").exists():
        raise error_of(status, reason)
    if cycles:
        adaptivity.report(work, cycles)
        for cycle in cycles:
            shutil.rmtree(cycle)
    if run.figures:
        from ..figures import draw_run

        draw_run(work)
    (work / "export" / "freefem.log").rename(work / "freefem.log")
    shutil.rmtree(work / "export")
    if status and (out / "summary.json").is_file() and json.loads((out / "summary.json").read_text())["converged"]:
        out = out.with_name(f"{out.name}-unconverged")  # what was there before is worth more
    place.publish(out)
    if status:
        raise error_of(status, f"{reason}; what was found is kept in {os.path.relpath(out)}")
    return json.loads((out / "summary.json").read_text())


def _refine(run: Run, place: Workspace) -> list[Path]:
    """Directories of the finished refinement cycles; each holds the element sizes of the mesh that follows."""
    cycles = []
    for cycle in range(run.adapt):
        work = place.path / f"cycle-{cycle}"
        work.mkdir()
        status, reason = _cycle(run, place, work, cycles, {"fields": False, "errors": "energy", "refine": True,
                                                           "settings": adaptivity.coarse(run.settings)})
        if status:
            raise error_of(status, f"refinement cycle {cycle + 1}: {reason}")
        cycles.append(work)
        if not run.quiet:
            print(f"{run.scene.stem}: refinement cycle {cycle + 1} of {run.adapt}: {adaptivity.describe(work)}", flush=True)
    return cycles


def _cycle(run: Run, place: Workspace, work: Path, before: list[Path], request: dict) -> tuple[int, str]:
    """Export and solve in `work` on the mesh that the cycles `before` lead to; exit status and reason.

    FreeFEM runs again when an interrupted run is taken up: that its records are the same is what shows that nothing
    they depend on has changed.
    """
    clock = time.perf_counter()
    freefem.export(run.scene, work / "export", run.parameters, run.ranks, before[-1] / adaptivity.STEM if before else None,
                   launch.load if run.ranks == 1 else lambda: None)
    request = {"scene": run.scene.stem, "settings": run.settings, "quiet": run.quiet, **request}
    request["fingerprint"] = fingerprint(seal.read(work / "export").content,
                                         {**request["settings"], "fields": request["fields"]})
    _take_up(run, place, work, request["fingerprint"])
    request["seconds"] = {**adaptivity.seconds(before), "export": time.perf_counter() - clock}
    return launch.solve(work, request, run.ranks)


def _take_up(run: Run, place: Workspace, work: Path, identity: dict) -> None:
    """Go on where an interrupted run has stopped, unless it shall start over; says so."""
    steps, wrong = place.take_up(work, identity, run.resume)
    told = [f"goes on after step {steps} of an interrupted run; RESUME=no would start over"] if steps else []
    if wrong and not steps:
        told = [f"starts over; an interrupted run is there, but {' and '.join(sorted(wrong))}"]
    for line in told if not run.quiet else ():
        print(f"{run.scene.stem}: {line}", flush=True)


def describe(summary: dict, out: Path) -> str:
    """Few lines about a finished run."""
    sizes, counts, worst = summary["sizes"], summary["counts"], max(summary["residuals"].values(), default=0)
    s, idle = summary["seconds"], never_mattered(summary["effects_ledger"])
    estimated = f", error estimates {s['estimates']:.2f}" if "estimates" in s else ""
    known = budget.describe(summary.get("errors", {}), summary["units"])
    return (f"{' '.join(filter(None, (summary['scene'], summary['variant'])))}: {sizes['subdomains']} subdomains, "
            f"{sizes['primal_dofs']} primal and {sizes['dual_dofs']} dual dofs, {summary['steps']} steps\n"
            f"  {counts['fixed_point_iterations']} fixed-point iterations, {counts['dual_multiplications']} products "
            f"with F, largest KKT residual {worst:.1e}, force balance {summary['balance']:.1e}\n"
            f"  {s['total']:.2f} s (FreeFEM {s['export']:.2f}, setup {s['setup']:.2f}, solve {s['solve']:.2f}, output "
            f"{s['output']:.2f}{estimated}), results in {os.path.relpath(out)}"
            + "".join(f"\n  {line}" for line in [*idle, *known, *(f"warning: {w}" for w in summary["warnings"])]))
