"""A setting of the numerics and the outcome of a run with it."""

import statistics
from dataclasses import dataclass, field

SWEEPS = ("mesh", "quadratic", "adapt", "steps", "friction_rtol", "rtol", "together")
# sweep: the run of the reference in which all that the sweep does not vary is the same, and what it
# varies is tight
TIGHT = {"mesh": "finest", "quadratic": "finest", "adapt": "finest", "steps": "most",
         "friction_rtol": "base", "rtol": "base"}


@dataclass(frozen=True)
class Setting:
    """Numerics of a run; None: the scene does not have this option."""

    mesh: float
    steps: int | None
    adapt: int = 0
    tolerances: tuple = ()  # pairs of name and value
    element: str = ""  # that of the study where empty

    def options(self, mesh_name: str) -> dict[str, str]:
        """As on the command line; `mesh_name` is the parameter of the mesh size."""
        given = {mesh_name: f"{self.mesh:.6g}"}
        if self.element:
            given["element"] = self.element
        if self.steps is not None:
            given["steps"] = str(self.steps)
        if self.adapt:
            given["adapt"] = str(self.adapt)
        for name, value in self.tolerances:
            given[name] = f"{value:.0e}".replace("e-0", "e-") if value < 0.1 else f"{value:g}"
        return given


@dataclass
class Trial:
    """One setting and the outcome of its runs."""

    sweep: str
    # of what is varied, the smaller the tighter: relative mesh size, time step, tolerance
    value: float
    setting: Setting
    label: str
    reason: str = ""  # why there is no result
    status: int = 0  # exit status of the run
    values: dict = field(default_factory=dict)
    energy: float | None = None  # estimated relative error in the energy norm
    sizes: dict = field(default_factory=dict)
    solver: list = field(default_factory=list)  # seconds, one entry a repetition
    export: list = field(default_factory=list)
    tight: "Trial | None" = None  # the run of the reference that TIGHT names

    def add(self, summary: dict) -> None:
        """Keep the results of a finished run; of adaptive runs all cycles count."""
        seconds = summary["seconds"]
        self.export.append(seconds["export"] + seconds.get("export_cycles", 0.0))
        self.solver.append(seconds["read"] + seconds["setup"] + seconds["solve"]
                           + seconds.get("solve_cycles", 0.0))
        self.values = summary["quantities"]
        self.energy = summary.get("errors", {}).get("energy", {}).get("relative")
        self.sizes = {"primal_dofs": summary["sizes"]["primal_dofs"],
                      "dual_dofs": summary["sizes"]["dual_dofs"],
                      "dual_multiplications": summary["counts"]["dual_multiplications"]}

    def tighter(self, other: "Trial") -> bool:
        """Whether this is `other`, or another run of its sweep with nothing looser."""
        if self.sweep != "together" or other.sweep != "together":
            return self.sweep == other.sweep and self.value <= other.value
        mine, theirs = ((bool(trial.setting.adapt), trial.setting.element)
                        for trial in (self, other))
        return (mine == theirs and self.sizes["primal_dofs"] >= other.sizes["primal_dofs"]
                and (self.setting.steps or 1) >= (other.setting.steps or 1))

    @property
    def seconds(self) -> float:
        """Seconds of the solver, the median of all repetitions."""
        return statistics.median(self.solver)
