"""Stage 6, data: the state at the end of a time step, what drives one, and what a run of them has counted."""

from dataclasses import dataclass, field

import numpy as np

from . import globalization
from ..errors import error_of

WINDOW = 8  # iterations of the fixed point over which its changes must have fallen


@dataclass
class Step:
    """State at the end of a time step; multiplier arrays hold the rank's rows."""

    index: int
    time: float
    weights: np.ndarray  # factors of the load patterns, then of the free rigid motions
    multipliers: np.ndarray
    gradient: np.ndarray | None  # None in a step from a checkpoint
    status: np.ndarray  # of the rank's nodes with a normal row
    friction_bound: np.ndarray  # (j,) largest friction forces at the rank's tangential rows
    fixed_point_iterations: int
    products: int
    contraction: float  # mean ratio of successive changes of the fixed point, NaN if there was one
    residuals: dict
    moved: np.ndarray  # last change of the multipliers, to the friction bound of their own pressures


@dataclass
class Load:
    """What drives a time step: factors of the load patterns, then of the free rigid motions, and the d they make."""

    weights: np.ndarray
    d: np.ndarray


@dataclass
class History:
    """Counts over a run, the log of MPRGP steps and how the run ended."""

    counts: dict = field(default_factory=lambda: dict.fromkeys(
        ("fixed_point_iterations", "dual_multiplications", "dual_multiplications_setup", "cg_steps",
         "expansion_steps", "proportioning_steps", "contact_block_products"), 0))
    log: list = field(default_factory=list)  # (product, step, iteration, kind, residual)
    residuals: dict = field(default_factory=dict)
    steps: int = 0
    exit_status: int = 0
    reason: str = ""
    warnings: list = field(default_factory=list)
    fallbacks: globalization.Fallbacks = field(default_factory=globalization.Fallbacks)
    contraction: float = 0.0  # worst of the steps
    seconds: float = 0.0

    def check(self, where: str = "") -> None:
        """Raise the DriverError of a run that failed, its reason after `where`."""
        if self.exit_status:
            raise error_of(self.exit_status, where + self.reason)

    def end(self, status: int, reason: str) -> None:
        """The run ends after this step, with an exit status and the reason."""
        self.exit_status, self.reason = status, reason


@dataclass
class Trace:
    """Iterations of the fixed point in one time step and the changes they made."""

    iterations: int = 0
    changes: list = field(default_factory=list)
    fallback: bool = False  # successive approximations did not contract
    exact: bool = False  # every QP is solved to the tolerance: where multipliers answer violently to residuals

    @property
    def contraction(self) -> float:
        """Geometric mean of the ratios of successive changes, over the last `WINDOW` ones; NaN if there are none.

        A QP that is left as it is makes no change, which says nothing of the next one.
        """
        last = [change for change in self.changes if change > 0][-WINDOW - 1 :]
        return (last[-1] / last[0]) ** (1 / (len(last) - 1)) if len(last) > 1 else np.nan

    @property
    def stalls(self) -> bool:
        """Whether the changes have not fallen over a window."""
        return len(self.changes) > 2 * WINDOW and bool(min(self.changes[-WINDOW:]) >= min(self.changes[:-WINDOW]))
