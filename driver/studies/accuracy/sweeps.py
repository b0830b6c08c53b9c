"""The sweeps of `make accuracy`: errors by setting, and what each digit takes.

    python3 -m driver accuracy SCENE=hertz [EFFORT=quick|full] [REPEATS=3] [QUANTITY=slip] [NP=]
    [OUT=] [...]

One sweep a setting, from coarse to fine with all others at the base: the mesh (uniform), the same
with quadratic elements, cycles of adaptive refinement, time steps, friction's fixed point, MPRGP's
tolerance; and `together`, meshes and steps with loose tolerances, where the cheapest settings are.
Errors are those of the quantities of interest against a closed form where there is one, else
against

    q(finest adaptive mesh) + q(base mesh, most steps) - q(base mesh, base steps),

reference runs that are fine in space and in time, and the report says how much they may err
themselves. A quantity that does not converge (the pressure at a sharp corner) is left out.
Leaves accuracy.csv (a row a run), reference.csv, cheapest.csv and pictures.
"""

import dataclasses
import math
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from ... import options
from ...effects import Effects
from ...errors import PARTIAL, DriverError, InputError, error_of
from ...estimates.budget import mesh_knob
from ...estimates.budget_words import unit
from ...files import write_table
from ...options import RESULTS
from ...runs import guard
from ...runs.run import Run, execute
from ...scene import freefem
from ...text import assignments, percent, words
from .cheapest import CHEAPEST_COLUMNS, RUN_COLUMNS, cheapest_rows, describe, run_rows
from .reference import CLOSED_FORMS, Reference, most_sensitive, references
from .trial import TIGHT, Setting, Trial

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
    "full": Effort(32_000, 5, (0.25, 0.5, 1, 2, 4, 8), (1e-1, 1e-2, 1e-3, 1e-4, 1e-5),
                   (1e-2, 1e-3, 1e-4, 1e-5, 1e-6), 3)}


class Study:
    """The sweeps of one scene: exports it once to know its settings, plans, runs."""

    def __init__(self, pairs: dict[str, str], out: Path):
        given = options.read("accuracy", pairs)
        self.effort = EFFORTS[given["effort"]]
        self.repeats = given["repeats"] or self.effort.repeats
        self.out = out
        self.scene = freefem.find_scene(given["scene"])
        self.given = {name: pairs[name] for name in (*given.parameters, *given.settings)}
        self.given |= options.ranks(pairs)
        with tempfile.TemporaryDirectory() as folder:
            manifest = freefem.export(self.scene, Path(folder) / "export", given.parameters)
        self.parameters, self.units = manifest.parameters, manifest.units
        self.element = manifest.element
        self.mesh_name = mesh_knob(manifest.parameters)
        effects = Effects(manifest)
        self.fixed_point = effects.pressure_bounds_friction
        self.rubbing = effects.frictional  # else the end does not depend on the steps
        self.steps = manifest.steps if manifest.quasistatic else None
        self.unknowns = 2 * manifest.nodes  # every vertex but those of interfaces counts once
        self.meshes = self._meshes()
        self.base = Setting(self.meshes[-2:][0], self.steps)
        self.start = self.meshes[-3:][0]  # of adaptive refinement
        # of quadratic elements: with as many unknowns as linear ones have on the next finer mesh
        self.coarser = self.meshes[:-1] if self.element == "P1" else []

    def _meshes(self) -> list[float]:
        """Sizes of the uniform meshes, coarse to fine, each half the one before."""
        finer = math.floor(math.log2(max(self.effort.unknowns / self.unknowns, 1e-9)) / 2)
        halvings = range(finer - self.effort.meshes + 1, finer + 1)
        size = self.parameters[self.mesh_name]
        if self.mesh_name == "cells":
            return sorted({max(1, round(size * 2.0**k)) for k in halvings})
        return [size * 2.0**-k for k in halvings]

    def _trial(self, sweep: str, value: float, **changes) -> Trial:
        """A trial of a sweep with the base's setting but for `changes`."""
        setting = dataclasses.replace(self.base, **changes)
        options = setting.options(self.mesh_name)
        return Trial(sweep, value, setting,
                     assignments(options))

    def plan(self) -> list[Trial]:
        """All trials but the reference's."""
        effort, trials = self.effort, []
        size = {mesh: 1 / mesh if self.mesh_name == "cells" else mesh for mesh in self.meshes}
        steps = [max(1, round(f * self.steps)) for f in effort.steps] if self.steps else [None]
        cycles = (1, 2)
        trials += [self._trial("mesh", size[mesh], mesh=mesh) for mesh in self.meshes]
        trials += [self._trial("quadratic", size[mesh], mesh=mesh, element="P2")
                   for mesh in self.coarser]
        trials += [self._trial("adapt", 0.5**k, mesh=self.start, adapt=k) for k in cycles]
        if self.steps and self.rubbing:
            trials += [self._trial("steps", 1 / n, steps=n) for n in steps]
        if self.fixed_point:
            trials += [self._trial("friction_rtol", tol, tolerances=(("friction_rtol", tol),))
                       for tol in effort.friction_rtol]
        trials += [self._trial("rtol", tol, tolerances=(("rtol", tol), ("primal_rtol", 1.0)))
                   for tol in effort.rtol]  # its safeguard off, which would tighten it
        loose = tuple((name, value) for name, value in LOOSE.items()
                      if self.fixed_point or name != "friction_rtol")
        together = [{"mesh": mesh} for mesh in self.meshes]
        together += [{"mesh": self.start, "adapt": k} for k in cycles]
        together += [{"mesh": mesh, "element": "P2"} for mesh in self.coarser]
        few = steps[::2] if self.rubbing else [self.steps]
        return trials + [self._trial("together", 0, **changes, steps=n, tolerances=loose)
                         for changes in together for n in few]

    def reference_runs(self) -> dict[str, Trial]:
        """Trials of the reference: fine and less fine in space, in time."""
        trials = {"base": self._trial("base", 0)}
        for name, cycles in (("coarser", 1), ("finer", 2), ("finest", 3)):
            trials[name] = self._trial("reference", 0, mesh=self.start, adapt=cycles)
        if self.steps and self.rubbing:
            for name, factor in (("fewer", 0.5), ("more", 1), ("most", 2)):
                steps = round(factor * self.effort.steps[-1] * self.steps)
                trials[name] = self._trial("reference", 0, steps=steps)
        return trials

    # ---- runs ------------------------------------------------------------------------------------
    def run(self, trial: Trial, repeats: int = 1) -> None:
        """Run a trial, and again until `repeats` are done or it has taken long enough."""
        pairs = {**self.given, **trial.setting.options(self.mesh_name), "scene": str(self.scene),
                 "fields": "no", "figures": "no", "quiet": "yes", "errors": "energy"}
        with tempfile.TemporaryDirectory(prefix=".run.", dir=self.out) as folder:
            while len(trial.solver) < repeats and sum(trial.solver) + sum(trial.export) < LONG:
                try:
                    trial.add(execute(Run.from_pairs({**pairs, "out": f"{folder}/run"})))
                except DriverError as problem:
                    trial.reason = str(problem).split(PARTIAL)[0]
                    trial.status = problem.exit_status
                    return

    def run_all(self, quantity: str | None) -> tuple[list[Trial], dict[str, Reference], str | None]:
        """Run the reference and all trials, with a line each.

        Returns the trials, the reference values and the quantity to show: `quantity`, by default
        the most sensitive one. Raises InputError if the reference does not have that quantity, and
        what a run of the reference has failed with.
        """
        clock, reference, trials = time.perf_counter(), self.reference_runs(), self.plan()
        total = len(reference) + len(trials)
        for number, trial in enumerate(reference.values(), 1):
            self.run(trial)
            if trial.reason:
                raise error_of(trial.status,
                               f"the reference run {trial.label} failed: {trial.reason}")
            if quantity and quantity not in trial.values:
                raise InputError(f"QUANTITY={quantity}: the scene has no such quantity; it has "
                                 f"{', '.join(trial.values)}")
            _report(trial, "", number, total, clock)
        closed_form = None
        if self.scene.parent == freefem.SCENES:
            closed_form = CLOSED_FORMS.get(self.scene.stem)
        known = references(reference, closed_form, self.element)
        if not known:
            raise InputError("no quantity of this scene converges: nothing to compare with")
        quantity = quantity or most_sensitive(known)
        if quantity not in known:
            raise InputError(f"QUANTITY must be one of {', '.join(known)}, not '{quantity}'")
        for number, trial in enumerate(trials, len(reference) + 1):
            self.run(trial, self.repeats)
            trial.tight = reference.get(TIGHT.get(trial.sweep))
            error = ""
            if not trial.reason:
                error = known[quantity].relative(trial.values[quantity] - known[quantity].value)
                error = f", error of the {words(quantity)} {percent(error)}"
            _report(trial, error, number, total, clock)
        return trials, known, quantity


def _report(trial: Trial, error: str, number: int, total: int, clock: float) -> None:
    """A line on the screen about a trial that has been run, the `number`th of `total`."""
    text = trial.reason
    if not text:
        text = f"{trial.seconds:.2f} s + {statistics.median(trial.export):.2f} s export{error}"
    spent = time.perf_counter() - clock
    print(f"[{number}/{total}, {spent:.0f} s] {trial.sweep}: {trial.label}: {text}", flush=True)


def run_sweeps(pairs: dict[str, str]) -> list[Path]:
    """Run the sweeps, write their tables and draw them; returns the files.

    The model example is studied under both loadings unless LOADING is given. Raises InputError for
    options that the study sets itself, and DriverError of a scene that does not run.
    """
    from ...figures.accuracy import draw

    given = options.read("accuracy", pairs)
    if given["scene"] is None:
        raise InputError("make accuracy needs SCENE=<name|path>; 'make run' lists the scenes")
    scene = freefem.find_scene(given["scene"])
    if scene == freefem.SCENES / "model.edp" and "loading" not in pairs:
        out = pairs.get("out", RESULTS / "accuracy" / "model")
        folders = {loading: guard.study_folder(f"{out}-{loading}", "accuracy")
                   for loading in ("monotone", "nonmonotone")}
        return [path for loading, folder in folders.items()
                for path in run_sweeps({**pairs, "loading": loading, "out": str(folder)})]
    name = f"{scene.stem}-{pairs['loading']}" if "loading" in pairs else scene.stem
    out = guard.study_folder(pairs.get("out", RESULTS / "accuracy" / name), "accuracy")
    study = Study(pairs, out)
    trials, known, main = study.run_all(given["quantity"])
    table = cheapest_rows(trials, known)
    columns = [*RUN_COLUMNS, *(f"{name}{suffix}" for name in known
                               for suffix in ("", "_error", "_trusted", "_own", "_front"))]
    values = [{"scene": name, "quantity": quantity, "value": r.value,
               "unit": unit(quantity, study.units), "uncertainty": r.uncertainty,
               "source": r.source, "main": int(quantity == main)} for quantity, r in known.items()]
    runs = write_table(out / "accuracy.csv", run_rows(trials, known), columns)
    paths = [runs, write_table(out / "cheapest.csv", table, CHEAPEST_COLUMNS),
             write_table(out / "reference.csv", values)]
    print(describe(table, known, study.units, main))
    return paths + draw(runs)
