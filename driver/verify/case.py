"""What a case of `make verify` is, and how it is run and compared with its reference."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import DriverError
from ..python.result import Result
from ..runs.run import Run, execute
from ..scene import freefem
from .peer import Peer, difference
from .sizes import Effect, Sizes, fitted

ELEMENTS = ("P1", "P2")
NO_SOLUTION = 3  # exit status
TABLES = ("contact", "boundaries", "probes", "history")  # of a Result


class View:
    """The last step of a finished run, as references are compared with it.

    Columns of contact.csv are sorted along x.
    """

    def __init__(self, result: Result, settings: dict):
        self.result, self.settings = result, settings
        self.quantities = result.summary["quantities"]
        contact = result.contact
        last = contact["step"] == contact["step"].max() if contact else np.zeros(0, bool)
        order = np.argsort(contact["x"][last], kind="stable") if contact else []
        self.contact = {name: values[last][order] for name, values in contact.items()}

    def __getitem__(self, name: str) -> np.ndarray:
        """A column of contact.csv at the last step."""
        return self.contact[name]

    @property
    def P(self) -> float:
        """Normal resultant of a straight contact boundary; of half a body, of that half."""
        return float(-(self["sigma_n"] * self["weight"]).sum())

    @property
    def Q(self) -> float:
        """Magnitude of the tangential resultant of a straight contact boundary."""
        return float(abs((self["sigma_t"] * self["weight"]).sum()))

    def probe(self, name: str, column: str) -> float:
        """A number of probes.csv at the last step."""
        probes = self.result.probes
        return float(probes[column][probes["probe"] == name][-1])


@dataclass(frozen=True)
class Check:
    """One number of a case.

    `reference` is the number or follows from the run (a closed form for the resultant found);
    `tolerance` is relative to it, or absolute where it is zero, and `because` says where it comes
    from: the uncertainty of the reference, or the size of the body. `quantity` is the name of the
    run's own quantity, whose claimed error is put beside the true one; "" where it has none.
    """

    name: str
    reference: float | Callable[[View], float]
    value: Callable[[View], float]
    tolerance: float
    because: str
    quantity: str = ""

    def compare(self, view: View) -> tuple[float, float, float]:
        """Value, reference, deviation: relative, or absolute where the reference is zero."""
        wanted = self.reference(view) if callable(self.reference) else self.reference
        value = self.value(view)
        return value, wanted, (value - wanted) / (abs(wanted) or 1.0)


@dataclass(frozen=True)
class Curve:
    """What a case's picture shows: the run's (x, y), and the reference's at places of its own."""

    x: str
    y: str
    run: Callable[[View], tuple[np.ndarray, np.ndarray]]
    reference: Callable[[View], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Case:
    """A scene with published numbers or a closed form.

    `levels` are the meshes of P1, coarse to fine; P2 is run on all but the finest of them.
    `refused` are settings with which there is no solution. `sizes`, see sizes.py, are runs that
    show what the size of the body adds; tolerances then are those of what remains. `others` says
    what other codes give, `note` what the numbers do not say. `fast` cases run in the default test
    suite. `peer`, see peer.py, tells GetFEM the problem.
    """

    name: str
    title: str
    scene: str
    source: str
    levels: tuple[dict, ...]
    checks: tuple[Check, ...]
    settings: dict = field(default_factory=dict)
    curve: Curve | None = None
    refused: tuple[dict, ...] = ()
    sizes: Sizes | None = None
    elements: tuple[str, ...] = ELEMENTS
    peer: Callable[[View], Peer] | None = None
    others: str = ""
    note: str = ""
    fast: bool = False


def solve(case: Case, element: str, level: dict, folder: Path, errors: bool) -> View:
    """Run a case on one mesh. Raises what the run raises."""
    settings = {**case.settings, **level, "element": element}
    return View(_run(case, settings, folder, "yes" if errors else "no"), settings)


def size_effects(case: Case, folder: Path) -> dict[str, Effect]:
    """What the size of the body adds to each check, by its name; with quadratic elements.

    Published numbers, which hold for the very body, have none.
    """
    if case.sizes is None:
        return {}
    views = [solve(case, "P2", run, folder, False) for run in case.sizes.runs]
    ratios = [case.sizes.ratio(view) for view in views]
    return {check.name: fitted(ratios, [check.compare(view)[2] for view in views],
                               check.reference == 0.0)
            for check in case.checks if callable(check.reference) or check.reference == 0.0}


def compared(case: Case, element: str, folder: Path) -> float:
    """Difference from GetFEM on the coarsest mesh, see peer.py. Raises what either raises."""
    settings = {**case.settings, **case.levels[0], "element": element, "subdomains": 1,
                "fields": "yes"}
    with tempfile.TemporaryDirectory(prefix=".run.", dir=folder) as hidden:
        view = View(_left(case, settings, Path(hidden), "no"), settings)
        return difference(view, case.peer(view), Path(hidden))


def refusal(case: Case, settings: dict, folder: Path) -> int:
    """Exit status of a run that has no solution; 0 if it has one after all."""
    try:
        _run(case, case.settings | case.levels[0] | settings, folder, "no")
    except DriverError as problem:
        return problem.exit_status
    return 0


def _run(case: Case, settings: dict, folder: Path, errors: str) -> Result:
    """The tables of a run whose files are gone."""
    with tempfile.TemporaryDirectory(prefix=".run.", dir=folder) as hidden:
        result = _left(case, settings, Path(hidden), errors)
        for table in TABLES:  # read while they are there
            getattr(result, table)
    return result


def _left(case: Case, settings: dict, folder: Path, errors: str) -> Result:
    """A run in `folder`/run."""
    pairs = {name: str(value) for name, value in settings.items()}
    execute(Run.from_pairs({
        "figures": "no", "fields": "no", "quiet": "yes", "primal_rtol": "1e-8", "rtol": "1e-10",
        "friction_rtol": "1e-9", "uniqueness": "no", "errors": errors, **pairs,
        "scene": str(freefem.find_scene(case.scene)), "out": str(folder / "run")}))
    return Result(folder / "run")
