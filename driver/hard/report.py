"""The rows of the report on the hard cases: on screen and in report.csv."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..files import write_table

RESIDUALS = ("stationarity", "gluing", "penetration", "sign",
             "cone", "equilibrium", "complementarity")


@dataclass
class Row:
    """One line of report.csv: a case at one size; numbers that do not apply are NaN."""

    family: str
    case: str
    size: str
    expected: str  # "solved" or "refused (exit n)"
    status: str  # "solved", "refused" or "FAILED"
    exit: int
    why: str  # the reason of a refusal or a failure, warnings of a solved case
    stationarity: float = np.nan
    gluing: float = np.nan
    penetration: float = np.nan
    sign: float = np.nan
    cone: float = np.nan
    equilibrium: float = np.nan  # of bodies without support
    complementarity: float = np.nan
    kkt_tolerance: float = np.nan
    oracle: str = ""
    error: float = np.nan  # largest deviation over its tolerance, of all checks
    products: int = 0
    fixed_point: int = 0
    iterations_ratio: float = np.nan  # products over those of the easy reference
    ratio_allowed: float = np.nan
    condition: float = np.nan
    seconds: float = np.nan
    sweep: str = ""
    place: float = np.nan  # in the sweep
    seed: int = 0  # of a random scene
    declared: str = ""  # what it declares
    disagreement: float = np.nan  # of contact forces between cuts, relative
    repeat: str = ""  # command that repeats a failed random scene

    @property
    def kkt(self) -> float:
        """The largest KKT residual."""
        values = [getattr(self, name) for name in RESIDUALS]
        return float(np.nanmax(values)) if np.isfinite(values).any() else np.nan


def line(row: Row) -> str:
    """A case at one size for the screen."""
    start = f"{row.status:8s} {row.family}: {row.case} [{row.size}]"
    if row.status != "solved":
        again = f"; repeat: {row.repeat}" if row.repeat else ""
        return f"{start}: exit {row.exit}, {row.why}{again}"
    ratio = f" ({row.iterations_ratio:.2g} of easy)" if np.isfinite(row.iterations_ratio) else ""
    return (f"{start}: KKT {row.kkt:.1e}, {row.error:.2g} of the tolerance off {row.oracle}, "
            f"{row.products} products{ratio}")


def write(path: Path, rows: list[Row]) -> None:
    """report.csv; numbers that do not apply are empty."""
    write_table(path, [{name: "" if isinstance(value, float) and np.isnan(value) else value
                        for name, value in asdict(row).items()} for row in rows])
