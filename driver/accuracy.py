"""Study: what accuracy costs. Which part of the error of a scene comes from which knob, and what each digit takes.

    python3 -m driver accuracy SCENE=hertz [EFFORT=quick|full] [REPEATS=3] [QUANTITY=slip] [NP=] [OUT=] [...]

One sweep a knob, from coarse to fine with all others at the base: the mesh (uniform), cycles of adaptive refinement, time
steps, friction's fixed point, MPRGP's tolerance; and `together`, meshes and steps with loose tolerances, where the good
bargains are. Errors are those of the quantities of interest against a closed form where there is one, else against

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
from dataclasses import dataclass, field
from pathlib import Path

from . import freefem
from .budget import FORMAL, extrapolate, main_quantity, mesh_knob, unit
from .errors import DriverError, InputError
from .files import write_table
from .options import Settings
from .run import RESULTS, Run, execute

LEVELS = (0.1, 0.05, 0.02, 0.01, 0.001)
KNOBS = {"mesh": "uniform meshes", "adapt": "adaptive meshes", "steps": "time steps", "friction_rtol": "fixed point",
         "rtol": "MPRGP", "together": "together"}
LOOSE = {"rtol": 1e-4, "friction_rtol": 1e-3, "primal_rtol": 1e-2}
WORTH = 0.9  # a trial of the front has at most so much of the error of the one before
LONG = 10.0  # seconds; runs that take longer are not repeated
OWN = ("scene", "out", "effort", "repeats", "quantity", "np")  # options of the study


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


@dataclass(frozen=True)
class Setting:
    """Numerics of a run; None: the scene does not have this knob."""

    mesh: float | None
    steps: int | None
    adapt: int = 0
    tolerances: tuple = ()  # pairs of name and value

    def options(self, knob: str | None) -> dict[str, str]:
        """As on the command line; `knob` names the parameter of the mesh size."""
        found = {} if self.mesh is None else {knob: f"{self.mesh:.6g}"}
        found |= {} if self.steps is None else {"steps": str(self.steps)}
        found |= {"adapt": str(self.adapt)} if self.adapt else {}
        short = lambda value: f"{value:.0e}".replace("e-0", "e-") if value < 0.1 else f"{value:g}"
        return found | {name: short(value) for name, value in self.tolerances}


@dataclass
class Trial:
    """One setting and what became of it."""

    knob: str
    value: float  # of the knob, the smaller the tighter: relative mesh size, time step, tolerance
    setting: Setting
    words: str
    reason: str = ""  # why there is no result
    values: dict = field(default_factory=dict)
    energy: float | None = None  # estimated relative error in the energy norm
    sizes: dict = field(default_factory=dict)
    solver: list = field(default_factory=list)  # seconds, one entry a repetition
    export: list = field(default_factory=list)
    tight: "Trial | None" = None  # the run that differs in this trial's knob alone, which is tight there

    def take(self, summary: dict) -> None:
        """Keep what a finished run says. Of adaptive runs all cycles count, with their estimates."""
        seconds = summary["seconds"]
        self.export.append(seconds["export"] + seconds.get("export_cycles", 0.0))
        self.solver.append(seconds["read"] + seconds["setup"] + seconds["solve"] + seconds.get("solve_cycles", 0.0))
        self.values, self.energy = summary["quantities"], summary.get("errors", {}).get("energy", {}).get("relative")
        self.sizes = {"primal_dofs": summary["sizes"]["primal_dofs"], "dual_dofs": summary["sizes"]["dual_dofs"],
                      "dual_multiplications": summary["counts"]["dual_multiplications"]}

    def tighter(self, other: "Trial") -> bool:
        """Whether this is `other`, or another run of its sweep with nothing looser."""
        if self.knob != "together" or other.knob != "together":
            return self.knob == other.knob and self.value <= other.value
        adaptive = [bool(trial.setting.adapt) for trial in (self, other)]
        return (adaptive[0] == adaptive[1] and self.sizes["primal_dofs"] >= other.sizes["primal_dofs"]
                and (self.setting.steps or 1) >= (other.setting.steps or 1))

    @property
    def seconds(self) -> float:
        return statistics.median(self.solver)


# ---- the plan ------------------------------------------------------------------------------------------

class Study:
    """The sweeps of one scene: probes it, plans, runs."""

    def __init__(self, pairs: dict[str, str], out: Path):
        self.effort = EFFORTS[_choice(pairs, "effort", tuple(EFFORTS), "full")]
        repeats = pairs.get("repeats", str(self.effort.repeats))
        if not repeats.isdigit() or int(repeats) < 1:
            raise InputError(f"REPEATS expects a whole number of at least 1, not '{repeats}'")
        self.repeats, self.out = int(repeats), out
        self.scene = freefem.find_scene(pairs["scene"])
        self.given = {name: value for name, value in pairs.items() if name not in OWN} | {"np": pairs.get("np", "1")}
        tolerances = {field.name for field in dataclasses.fields(Settings)}
        with tempfile.TemporaryDirectory() as folder:
            manifest = freefem.export(self.scene, Path(folder) / "export",
                                      {n: v for n, v in self.given.items() if n not in tolerances | {"np"}})
        self.parameters, self.units = manifest.parameters, manifest.units
        self.knob = mesh_knob(manifest.parameters)
        self.fixed_point = manifest.effects["friction"].startswith("coulomb")
        self.rubbing = manifest.effects["friction"] != "none"  # else the end does not depend on the steps
        self.steps = manifest.steps if manifest.effects["time"] == "quasistatic" else None
        # every vertex but those of interfaces counts once
        self.unknowns = 2 * manifest.vertices
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
        for cycles in (1, 2) if self.meshes else ():
            add("adapt", 0.5**cycles, mesh=self.start, adapt=cycles)
        for steps in stepped if self.steps and self.rubbing else ():
            add("steps", 1 / steps, steps=steps)
        if self.fixed_point:
            for tol in effort.friction_rtol:
                add("friction_rtol", tol, tolerances=(("friction_rtol", tol),))
        for tol in effort.rtol:  # its safeguard off, which would tighten it
            add("rtol", tol, tolerances=(("rtol", tol), ("primal_rtol", 1.0)))
        for mesh, cycles in [(mesh, 0) for mesh in self.meshes] + [(self.start, k) for k in (1, 2) if self.meshes]:
            for steps in stepped[::2] if self.rubbing else [self.steps]:
                add("together", 0, mesh=mesh, adapt=cycles, steps=steps, tolerances=tuple(
                    (name, value) for name, value in LOOSE.items() if self.fixed_point or name != "friction_rtol"))
        return found

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
        options = setting.options(self.knob)
        return Trial(knob, value, setting, " ".join(f"{name.upper()}={word}" for name, word in options.items()))

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
                    trial.reason = str(problem).split("; what was found is kept in")[0]
                    return

    def run_all(self, quantity: str | None) -> tuple[list[Trial], dict[str, "Reference"]]:
        """Run the reference and all trials, with a line each; the trials and the reference values."""
        clock, overkill, trials = time.perf_counter(), self.references(), self.plan()
        total, number = len(overkill) + len(trials), 0
        known = {}
        for trial in [*overkill.values(), *trials]:
            number += 1
            if number == len(overkill) + 1:
                known = references(overkill, self.closed_form())
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
            trial.tight = overkill.get({"mesh": "finest", "adapt": "finest", "steps": "most", "friction_rtol": "base",
                                        "rtol": "base"}.get(trial.knob))
        return trials, known

    def closed_form(self):
        """The function that gives the scene's closed form, None where there is none."""
        return CLOSED_FORMS.get(self.scene.stem) if self.scene.parent == freefem.SCENES else None


def _choice(pairs: dict, name: str, allowed: tuple, preset: str) -> str:
    value = pairs.get(name, preset)
    if value not in allowed:
        raise InputError(f"{name.upper()} must be one of {', '.join(allowed)}, not '{value}'")
    return value


# ---- reference values ------------------------------------------------------------------------------------

@dataclass
class Reference:
    """What a quantity is, how much that may err, both in its unit, and where it comes from."""

    value: float
    own: float
    source: str

    @property
    def uncertainty(self) -> float:
        """Relative error of the reference."""
        return self.own / abs(self.value)

    def relative(self, difference: float) -> float:
        return abs(difference) / abs(self.value)


def hertz(found: dict[str, Reference]) -> dict[str, Reference]:
    """edp/hertz.edp: Johnson, Contact Mechanics (1985), 4.2(c), at the resultant that was found.

    Half-planes are a disc but for (a/R)^2, of which peak and width lack twice as much (tests/test_scenes_hertz.py); the
    resultant's error counts half.
    """
    E, nu, R = 2000.0, 0.3, 1.0
    P = found["normal_resultant"]
    a = math.sqrt(4 * P.value * R * (1 - nu**2) / (math.pi * E))
    own = 2 * (a / R) ** 2 + P.uncertainty / 2
    return {name: Reference(value, own * value, "Hertz") for name, value in
            (("peak_pressure", 2 * P.value / (math.pi * a)), ("contact_length", 2 * a))}


CLOSED_FORMS = {"hertz": hertz}


def references(runs: dict[str, Trial], closed_form=None) -> dict[str, Reference]:
    """Reference of every quantity that has one: that converges, and on which not all runs agree to rounding.

    Its own error follows from the approach of adaptive meshes, whose cycles halve the error like a halved size, and of
    doubled steps (budget.extrapolate), plus the product of both corrections.
    """
    found = {}
    for name, base in runs["base"].values.items():
        value = {key: trial.values[name] for key, trial in runs.items()}
        best, most = value.get("finest", base), value.get("most", base)
        total, own = best + most - base, abs((best - base) * (most - base) / base) if base else 0.0
        for keys, formal, limit in ((("finest", "finer", "coarser"), FORMAL["mesh"], False),
                                    (("most", "more", "fewer"), FORMAL["time"], True)):
            if keys[0] in value:
                one, two, three = (value[key] for key in keys)
                part = extrapolate([one - two, two - three], [2.0, 2.0], formal, total, limit).error
                own = None if part is None or own is None else own + part
        spread = max(abs(v - base) for v in value.values())
        if own is not None and total and spread > 1e-9 * abs(total):
            found[name] = Reference(total, own, "overkill")
    return found | (closed_form(found) if closed_form else {})


def telling(known: dict[str, Reference]) -> str:
    """The quantity that tells most: what friction dissipates feels every knob; else one with a closed form or the main."""
    closed = [name for name, reference in known.items() if reference.source != "overkill"]
    sure = [name for name, reference in known.items() if reference.uncertainty < 0.02]
    return next(name for name in ("dissipated_energy", *closed, main_quantity(known), *sure, *known) if name in known)


# ---- tables ----------------------------------------------------------------------------------------------

def sure(trials: list[Trial], reference: Reference, name: str) -> dict[int, float]:
    """By id of every trial with a result the error it can be trusted with: the largest of its own and all tighter ones'.

    Errors of mesh and time may cancel at one setting by accident; they do not at all that are tighter. The error is
    never below that of the reference, where runs cannot be told apart.
    """
    error = {id(t): reference.relative(t.values[name] - reference.value) for t in trials if t.values}
    done = [t for t in trials if t.values]
    return {id(t): max(reference.uncertainty, *(error[id(u)] for u in done if u.tighter(t))) for t in done}


def front(trials: list[Trial], error: dict[int, float]) -> list[Trial]:
    """Trials that no other beats in both seconds and the errors of `sure` (Pareto), fast ones first."""
    best, found = math.inf, []
    for trial in sorted((t for t in trials if t.values), key=lambda t: t.seconds):
        if error[id(trial)] < WORTH * best:
            best = error[id(trial)]
            found.append(trial)
    return found


def bargain(trials: list[Trial], error: dict[int, float], level: float) -> Trial | None:
    """The cheapest trial whose error, one of `sure`, is below `level`."""
    return min((t for t in trials if t.values and error[id(t)] <= level), key=lambda t: t.seconds, default=None)


def percent(share: float) -> str:
    """A relative error for people."""
    return f"{100 * share:.2g}%"


def words(name: str) -> str:
    return name.replace("_", " ")


RUN_COLUMNS = ("knob", "value", "setting", "primal_dofs", "dual_dofs", "dual_multiplications", "reason", "energy_estimate",
               "seconds_solver", "seconds_solver_least", "seconds_solver_most", "seconds_export", "seconds_export_least",
               "seconds_export_most", "repeats")
BARGAIN_COLUMNS = ("quantity", "accuracy", "seconds_solver", "seconds_export", "error", "setting")


def rows(trials: list[Trial], known: dict[str, Reference]) -> list[dict]:
    """One row a trial. `error` is relative to the reference, `sure` see there, `own` what its knob alone has of it."""
    trusted = {name: sure(trials, reference, name) for name, reference in known.items()}
    fronts = {name: front(trials, trusted[name]) for name in known}
    found = []
    for trial in trials:
        row = {"knob": trial.knob, "value": trial.value, "setting": trial.words, "reason": trial.reason,
               "energy_estimate": trial.energy, "repeats": len(trial.solver), **trial.sizes}
        for stage in ("solver", "export") if trial.values else ():
            spent = getattr(trial, stage)
            row |= {f"seconds_{stage}": statistics.median(spent), f"seconds_{stage}_least": min(spent),
                    f"seconds_{stage}_most": max(spent)}
        for name, reference in known.items() if trial.values else ():
            value = trial.values[name]
            row |= {name: value, f"{name}_error": reference.relative(value - reference.value),
                    f"{name}_sure": trusted[name][id(trial)],
                    f"{name}_own": trial.tight and reference.relative(value - trial.tight.values[name]),
                    f"{name}_front": int(trial in fronts[name])}
        found.append(row)
    return found


def bargains(trials: list[Trial], known: dict[str, Reference]) -> list[dict]:
    """One row for every quantity and level: the setting that reaches it in the least time, if one does."""
    found = []
    for name, reference in known.items():
        error = sure(trials, reference, name)
        for level in LEVELS:
            trial = bargain(trials, error, level)
            row = {"quantity": name, "accuracy": level}
            if trial:
                row |= {"seconds_solver": trial.seconds, "seconds_export": statistics.median(trial.export),
                        "error": error[id(trial)], "setting": trial.words}
            found.append(row)
    return found


def describe(table: list[dict], known: dict[str, Reference], units: dict, main: str) -> str:
    """The bargains as people read them: the main quantity in full, of the others the seconds."""
    reference = known[main]
    lines = ["", f"{words(main)}: {reference.value:.5g} {unit(main, units)} ({reference.source}, itself good to "
             f"{percent(reference.uncertainty)})", f"{'accuracy':>10s}{'solver':>9s}{'export':>9s}{'error':>9s}  setting"]
    for row in table:
        if row["quantity"] == main:
            cells = ([f"{row['seconds_solver']:.2f} s", f"{row['seconds_export']:.2f} s", percent(row["error"])]
                     if "setting" in row else ["-", "-", "-"])
            why = ("no run is known to reach it, the reference itself is good to " + percent(reference.uncertainty)
                   if reference.uncertainty > row["accuracy"] / 2 else "no run reaches it")
            lines.append(f"{percent(row['accuracy']):>10s}" + "".join(f"{cell:>9s}" for cell in cells)
                         + f"  {row.get('setting', why)}")
    heads = "".join(f"{percent(level):>9s}" for level in LEVELS)
    lines += ["", f"{'seconds of the solver for':26s}{heads}   reference"]
    for name, reference in known.items():
        cells = [f"{row['seconds_solver']:.2f}" if "setting" in row else "-" for row in table if row["quantity"] == name]
        lines.append(f"{words(name):26s}" + "".join(f"{cell:>9s}" for cell in cells)
                     + f"   {reference.source}, good to {percent(reference.uncertainty)}")
    return "\n".join(lines)


def run_accuracy(pairs: dict[str, str]) -> list[Path]:
    """Run the study, write its tables and draw it; returns the files.

    The model example is studied under both loadings unless LOADING is given. Raises InputError for options that
    the study sets itself, and DriverError of a scene that does not run.
    """
    from .work_precision import draw

    if "scene" not in pairs:
        raise InputError("make accuracy SCENE=<name or path to an .edp>; 'make run' lists the scenes")
    for name in ("figures", "fields", "quiet", "errors", "adapt", "accuracy"):
        if name in pairs:
            raise InputError(f"the study decides on {name.upper()} itself")
    scene = freefem.find_scene(pairs["scene"])
    if scene == freefem.SCENES / "model.edp" and "loading" not in pairs:
        out = pairs.get("out", RESULTS / "accuracy" / "model")
        return [path for loading in ("monotone", "nonmonotone")
                for path in run_accuracy({**pairs, "loading": loading, "out": f"{out}-{loading}"})]
    variant = f"-{pairs['loading']}" if "loading" in pairs else ""
    out = Path(pairs.get("out", RESULTS / "accuracy" / f"{scene.stem}{variant}"))
    out.mkdir(parents=True, exist_ok=True)
    study = Study(pairs, out)
    trials, known = study.run_all(pairs.get("quantity"))
    main = pairs.get("quantity") or telling(known)
    table = bargains(trials, known)
    columns = [*RUN_COLUMNS, *(f"{name}{suffix}" for name in known for suffix in ("", "_error", "_sure", "_own", "_front"))]
    values = [{"scene": f"{scene.stem}{variant}", "quantity": name, "value": r.value, "unit": unit(name, study.units),
               "uncertainty": r.uncertainty, "source": r.source, "main": int(name == main)} for name, r in known.items()]
    paths = [write_table(out / "accuracy.csv", rows(trials, known), columns),
             write_table(out / "bargains.csv", table, BARGAIN_COLUMNS),
             write_table(out / "reference.csv", values)]
    print(describe(table, known, study.units, main))
    return paths + draw(out)
