"""A setting of the numerics and what became of it."""

import statistics
from dataclasses import dataclass, field

KNOBS = {"mesh": "uniform meshes", "quadratic": "uniform, P2", "adapt": "adaptive meshes", "steps": "time steps",
         "friction_rtol": "fixed point",
         "rtol": "MPRGP", "together": "together"}


@dataclass(frozen=True)
class Setting:
    """Numerics of a run; None: the scene does not have this knob."""

    mesh: float | None
    steps: int | None
    adapt: int = 0
    tolerances: tuple = ()  # pairs of name and value
    element: str = ""  # that of the study where empty

    def options(self, knob: str | None) -> dict[str, str]:
        """As on the command line; `knob` names the parameter of the mesh size."""
        found = {} if self.mesh is None else {knob: f"{self.mesh:.6g}"}
        found |= {"element": self.element} if self.element else {}
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
        kind = [(bool(trial.setting.adapt), trial.setting.element) for trial in (self, other)]
        return (kind[0] == kind[1] and self.sizes["primal_dofs"] >= other.sizes["primal_dofs"]
                and (self.setting.steps or 1) >= (other.setting.steps or 1))

    @property
    def seconds(self) -> float:
        return statistics.median(self.solver)


def words(name: str) -> str:
    return name.replace("_", " ")


def percent(share: float) -> str:
    """A relative error for people."""
    return f"{100 * share:.2g}%"
