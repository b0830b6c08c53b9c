"""Study: what accuracy costs. Which part of the error of a scene comes from which knob, and what each digit takes.

    python3 -m driver accuracy SCENE=hertz [EFFORT=quick|full] [REPEATS=3] [QUANTITY=slip] [NP=] [OUT=] [...]

One sweep a knob, from coarse to fine with all others at the base: the mesh (uniform), the same with quadratic elements,
cycles of adaptive refinement, time steps, friction's fixed point, MPRGP's tolerance; and `together`, meshes and steps
with loose tolerances, where the good bargains are. Errors are those of the quantities of interest against a closed form
where there is one, else against

    q(finest adaptive mesh) + q(base mesh, most steps) - q(base mesh, base steps),

overkill in space and time, and it is said how much that reference may err itself. A quantity that does not converge (the
pressure at a sharp corner) is left out.
Leaves accuracy.csv (a row a run), reference.csv, bargains.csv and pictures.
"""

import dataclasses
import math
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from ... import options
from ...scene import freefem
from ...estimates.budget import mesh_knob, unit
from ...effects import Effects
from ...errors import PARTIAL, DriverError, InputError
from ...files import write_table
from ...options import RESULTS
from ...runs.run import Run, execute
from .bargains import BARGAIN_COLUMNS, RUN_COLUMNS, bargains, describe, rows
from .reference import CLOSED_FORMS, Reference, references, telling
from .trial import KNOBS, Setting, Trial, percent, words

LOOSE = {"rtol": 1e-4, "friction_rtol": 1e-3, "primal_rtol": 1e-2}
LONG = 10.0  # seconds; runs that take longer are not repeated


@dataclass(frozen=True)
class Effort:
    """How far the sweeps go."""

    unknowns: int  # primal dofs of the finest mesh, about
    meshes: int  # uniform ones
    steps: tuple  # times the scene's
    friction_rtol: tuple
    rtol: tuple
    repeats: int


EFFORTS = {
    "quick": Effort(8_000, 4, (0.25, 0.5, 1, 2, 4), (1e-1, 1e-2, 1e-4), (1e-2, 1e-3, 1e-5), 1),
    "full": Effort(32_000, 5, (0.25, 0.5, 1, 2, 4, 8), (1e-1, 1e-2, 1e-3, 1e-4, 1e-5), (1e-2, 1e-3, 1e-4, 1e-5, 1e-6), 3),
}


class Study:
    """The sweeps of one scene: probes it, plans, runs."""

    def __init__(self, pairs: dict[str, str], out: Path):
        given = options.read("accuracy", pairs)
        self.effort = EFFORTS[given["effort"]]
        self.repeats = given["repeats"] or self.effort.repeats
        self.out = out
        self.scene = freefem.find_scene(given["scene"])
        self.given = {name: pairs[name] for name in (*given.parameters, *given.settings)} | {"np": str(given["np"])}
        with tempfile.TemporaryDirectory() as folder:
            manifest = freefem.export(self.scene, Path(folder) / "export", given.parameters)
        self.parameters, self.units, self.element = manifest.parameters, manifest.units, manifest.element
        self.knob = mesh_knob(manifest.parameters)
        effects = Effects(manifest)
        self.fixed_point = effects.pressure_bounds_friction
        self.rubbing = effects.frictional  # else the end does not depend on the steps
        self.steps = manifest.steps if manifest.quasistatic else None
        # every vertex but those of interfaces counts once
        self.unknowns = 2 * manifest.nodes
        self.meshes = self._meshes()
        self.base = Setting(self.meshes[max(0, len(self.meshes) - 2)] if self.meshes else None, self.steps)
        self.start = self.meshes[max(0, len(self.meshes) - 3)] if self.meshes else None  # of adaptive refinement

    def _meshes(self) -> list[float]:
        """Sizes of the uniform meshes, coarse to fine, each half the one before."""
        if self.knob is None:
            return []
        finer = math.floor(math.log2(max(self.effort.unknowns / self.unknowns, 1e-9)) / 2)
        sizes = []
        for k in range(finer - self.effort.meshes + 1, finer + 1):
            size = self.parameters[self.knob] * 2.0 ** (-k if self.knob == "h" else k)
            sizes.append(size if self.knob == "h" else max(1, round(size)))
        return sorted(set(sizes), reverse=self.knob == "h")

    def plan(self) -> list[Trial]:
        """All trials but the reference's."""
        base, effort, found = self.base, self.effort, []
        add = lambda knob, value, **changes: found.append(self.trial(knob, value, dataclasses.replace(base, **changes)))
        stepped = [max(1, round(f * self.steps)) for f in effort.steps] if self.steps else [None]
        for mesh in self.meshes:
            add("mesh", mesh if self.knob == "h" else 1 / mesh, mesh=mesh)
        for mesh in self.coarser:
            add("quadratic", mesh if self.knob == "h" else 1 / mesh, mesh=mesh, element="P2")
        for cycles in (1, 2) if self.meshes else ():
            add("adapt", 0.5**cycles, mesh=self.start, adapt=cycles)
        for steps in stepped if self.steps and self.rubbing else ():
            add("steps", 1 / steps, steps=steps)
        if self.fixed_point:
            for tol in effort.friction_rtol:
                add("friction_rtol", tol, tolerances=(("friction_rtol", tol),))
        for tol in effort.rtol:  # its safeguard off, which would tighten it
            add("rtol", tol, tolerances=(("rtol", tol), ("primal_rtol", 1.0)))
        loose = tuple((name, value) for name, value in LOOSE.items() if self.fixed_point or name != "friction_rtol")
        together = [(mesh, 0, "") for mesh in self.meshes] + [(self.start, k, "") for k in (1, 2) if self.meshes]
        for mesh, cycles, element in together + [(mesh, 0, "P2") for mesh in self.coarser]:
            for steps in stepped[::2] if self.rubbing else [self.steps]:
                add("together", 0, mesh=mesh, adapt=cycles, steps=steps, tolerances=loose, element=element)
        return found

    @property
    def coarser(self) -> list[float]:
        """Meshes for quadratic elements: all but the finest, with as many unknowns as linear ones have on the next."""
        return self.meshes[:-1] if self.element == "P1" else []

    def references(self) -> dict[str, Trial]:
        """Trials of the overkill reference: fine and less fine in space, in time."""
        base, found = self.base, {"base": self.trial("base", 0, self.base)}
        if self.meshes:
            for name, cycles in (("coarser", 1), ("finer", 2), ("finest", 3)):
                found[name] = self.trial("reference", 0, dataclasses.replace(base, mesh=self.start, adapt=cycles))
        if self.steps and self.rubbing:
            for name, factor in (("fewer", 0.5), ("more", 1), ("most", 2)):
                steps = round(factor * self.effort.steps[-1] * self.steps)
                found[name] = self.trial("reference", 0, dataclasses.replace(base, steps=steps))
        return found

    def trial(self, knob: str, value: float, setting: Setting) -> Trial:
        pairs = setting.options(self.knob)
        return Trial(knob, value, setting, " ".join(f"{name.upper()}={word}" for name, word in pairs.items()))

    # ---- runs -----------------------------------------------------------------------------------------
    def run(self, trial: Trial, repeats: int = 1) -> None:
        """Run a trial, and again until `repeats` are done or it has taken long enough."""
        pairs = {**self.given, **trial.setting.options(self.knob), "scene": str(self.scene), "fields": "no",
                 "figures": "no", "quiet": "yes", "errors": "energy"}
        with tempfile.TemporaryDirectory(prefix=".run.", dir=self.out) as folder:
            while len(trial.solver) < repeats and sum(trial.solver) + sum(trial.export) < LONG:
                try:
                    trial.take(execute(Run.from_pairs({**pairs, "out": f"{folder}/run"})))
                except DriverError as problem:
                    trial.reason = str(problem).split(PARTIAL)[0]
                    return

    def run_all(self, quantity: str | None) -> tuple[list[Trial], dict[str, Reference]]:
        """Run the reference and all trials, with a line each; the trials and the reference values."""
        clock, overkill, trials = time.perf_counter(), self.references(), self.plan()
        total, number = len(overkill) + len(trials), 0
        known = {}
        for trial in [*overkill.values(), *trials]:
            number += 1
            if number == len(overkill) + 1:
                known = references(overkill, self.closed_form(), self.element)
                if quantity is None:
                    quantity = telling(known)
                elif quantity not in known:
                    raise InputError(f"QUANTITY must be one of {', '.join(known)}, not '{quantity}'")
            self.run(trial, self.repeats if number > len(overkill) else 1)
            if trial.reason and trial in overkill.values():
                raise InputError(f"the reference run {trial.words} failed: {trial.reason}")
            if trial.reason:
                said = trial.reason
            else:
                error = ""
                if known:
                    reference = known[quantity]
                    share = reference.relative(trial.values[quantity] - reference.value)
                    error = f", {words(quantity)} errs by {percent(share)}"
                said = f"{trial.seconds:.2f} s + {statistics.median(trial.export):.2f} s export{error}"
            print(f"[{number}/{total}, {time.perf_counter() - clock:.0f} s] {KNOBS.get(trial.knob, 'reference')}: "
                  f"{trial.words}: {said}", flush=True)
        for trial in trials:
            trial.tight = overkill.get({"mesh": "finest", "quadratic": "finest", "adapt": "finest", "steps": "most",
                                        "friction_rtol": "base",
                                        "rtol": "base"}.get(trial.knob))
        return trials, known

    def closed_form(self):
        """The function that gives the scene's closed form, None where there is none."""
        return CLOSED_FORMS.get(self.scene.stem) if self.scene.parent == freefem.SCENES else None


def run_accuracy(pairs: dict[str, str]) -> list[Path]:
    """Run the study, write its tables and draw it; returns the files.

    The model example is studied under both loadings unless LOADING is given. Raises InputError for options that
    the study sets itself, and DriverError of a scene that does not run.
    """
    from .work_precision import draw

    given = options.read("accuracy", pairs)
    scene = freefem.find_scene(given["scene"])
    if scene == freefem.SCENES / "model.edp" and "loading" not in pairs:
        out = pairs.get("out", RESULTS / "accuracy" / "model")
        return [path for loading in ("monotone", "nonmonotone")
                for path in run_accuracy({**pairs, "loading": loading, "out": f"{out}-{loading}"})]
    variant = f"-{pairs['loading']}" if "loading" in pairs else ""
    out = Path(pairs.get("out", RESULTS / "accuracy" / f"{scene.stem}{variant}"))
    out.mkdir(parents=True, exist_ok=True)
    study = Study(pairs, out)
    trials, known = study.run_all(given["quantity"])
    main = given["quantity"] or telling(known)
    table = bargains(trials, known)
    columns = [*RUN_COLUMNS, *(f"{name}{suffix}" for name in known for suffix in ("", "_error", "_sure", "_own", "_front"))]
    values = [{"scene": f"{scene.stem}{variant}", "quantity": name, "value": r.value, "unit": unit(name, study.units),
               "uncertainty": r.uncertainty, "source": r.source, "main": int(name == main)} for name, r in known.items()]
    paths = [write_table(out / "accuracy.csv", rows(trials, known), columns),
             write_table(out / "bargains.csv", table, BARGAIN_COLUMNS),
             write_table(out / "reference.csv", values)]
    print(describe(table, known, study.units, main))
    return paths + draw(out)
