"""driver.open: the files of a finished run as dictionaries and numpy arrays."""

import functools
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import is_study, is_summary, read_fields, read_table
from ..results.tables import STRESSES, field_file
from ..runs.outcome import describe

WHOLE = ("step", "node", "boundary", "label")  # columns of whole numbers
COMPONENTS = STRESSES


@dataclass(frozen=True)
class Fields:
    """Fields of one step: n nodes, m triangles, lengths and stresses in the scene's units.

    Nodes on common sides of subdomains are there once for each. With quadratic elements `triangles`
    holds the corners and `elements` all six nodes, in VTK's order. Components of stresses are
    COMPONENTS; those at nodes are averages, those of triangles means.
    """

    step: int
    time: float
    nodes: np.ndarray  # (n, 2)
    triangles: np.ndarray  # (m, 3)
    elements: np.ndarray  # (m, 3) or (m, 6)
    displacement: np.ndarray  # (n, 2)
    stress: np.ndarray  # (n, 4)
    triangle_stress: np.ndarray  # (m, 4)
    von_mises: np.ndarray  # (m,)
    subdomain: np.ndarray  # (m,)
    body: np.ndarray  # (m,)
    region: np.ndarray  # (m,)

    def __getitem__(self, name: str):
        """A field by its name."""
        return getattr(self, name)


class Columns(dict):
    """Columns of a table by their names; one that is not there is a KeyError that lists them."""

    def __init__(self, name: str, columns: dict[str, np.ndarray]):
        super().__init__(columns)
        self.name = name

    def __missing__(self, column):
        if not self:
            raise KeyError(f"the run left no {self.name}.csv")
        raise KeyError(f"{self.name}.csv has no column {column!r}; it has {', '.join(self)}")


class Result:
    """A finished run; tables are dictionaries of columns, empty where the run has no such table."""

    def __init__(self, directory, text: str = ""):
        """`text` is what the run printed, by default what its summary says. Raises InputError where
        there is no finished run.
        """
        self.directory, self._printed = Path(directory), text
        if self.directory.is_file():
            raise InputError(f"{directory} is a file: give the directory of a run")
        try:
            self.summary = json.loads((self.directory / "summary.json").read_text())
        except FileNotFoundError:
            what = "a study, not a run" if is_study(self.directory) else "no finished run"
            raise InputError(f"{directory} holds {what} (no summary.json)") from None
        except (OSError, ValueError) as problem:
            raise InputError(f"{directory}/summary.json is not readable ({problem})") from None
        if not is_summary(self.directory / "summary.json"):
            raise InputError(f"{directory}/summary.json is not the summary of a run")
        if "study" in self.summary:
            raise InputError(f"{directory} holds a study of {self.summary['study']}, not a run: "
                             "its tables are .csv files; driver.open takes runs")

    @functools.cached_property
    def text(self) -> str:
        """What the run printed at its end."""
        return self._printed or describe(self.summary, self.directory) + "\n"

    def __repr__(self) -> str:
        converged = "" if self.summary["converged"] else ", not converged"
        return f"<Result {self.summary['scene']}{converged}: {self.directory}>"

    @functools.cached_property
    def contact(self) -> dict[str, np.ndarray]:
        """contact.csv: columns (steps x nodes,) by name."""
        return self._table("contact")

    @functools.cached_property
    def history(self) -> dict[str, np.ndarray]:
        """history.csv: columns (steps,) by name."""
        return self._table("history")

    @functools.cached_property
    def boundaries(self) -> dict[str, np.ndarray]:
        """boundaries.csv: columns (steps x boundaries,) by name."""
        return self._table("boundaries")

    @functools.cached_property
    def probes(self) -> dict[str, np.ndarray]:
        """probes.csv: columns (steps x probes,) by name."""
        return self._table("probes")

    @functools.cached_property
    def cycles(self) -> dict[str, np.ndarray]:
        """cycles.csv: columns (cycles,) by name, of a history that is repeated."""
        return self._table("cycles")

    def fields(self, step: int = -1) -> Fields:
        """Fields at the end of `step`; 0 is the start, -1 the last. Raises InputError."""
        if not isinstance(step, (int, np.integer)):
            raise InputError(f"fields takes the number of a step, not {step!r}")
        step = self.summary["steps"] + 1 + step if step < 0 else step
        path = self.directory / field_file(step)
        if not path.is_file():  # in pieces
            path = path.with_suffix(".pvtu")
        if not path.is_file():
            raise InputError(f"{self.directory} has no fields of step {step}: the run has "
                             f"{self.summary['steps']} steps, and FIELDS=no writes none")
        data = read_fields(path)
        kind, = data.cells_dict
        elements = data.cells_dict[kind].astype(np.int64)
        cells = {name: parts[0] for name, parts in data.cell_data.items()}
        times = np.append(0.0, self.history["time"])
        return Fields(step, float(times[step]), data.points[:, :2], elements[:, :3], elements,
                      data.point_data["displacement"][:, :2], data.point_data["stress"],
                      cells["stress"], cells["von_mises"], cells["subdomain"], cells["body"],
                      cells["region"])

    def _table(self, name: str) -> dict[str, np.ndarray]:
        columns = read_table(self.directory / f"{name}.csv") or {}
        return Columns(name, {column: values.astype(int) if column in WHOLE else values
                              for column, values in columns.items()})
