"""Data of the time stepping: the state after a step, its load, and the counts of a run."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..errors import DriverError
from .globalization import Fallbacks

WINDOW = 8  # iterations of the fixed point over which its changes must have fallen

DIVERGED = 1e6  # growth of these changes after which no window is waited for


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
    moved: np.ndarray  # last change of the multipliers, to the bound of their own pressures
    refined: bool = False  # displacements that it is a solution by have been refined
    cycle: int = 0  # number of the cycle that ends with it, if one does
    skips: int = 0  # cycles that are jumped over after it ...
    grown: tuple = ()  # ... and names of what goes on growing in them, as in march/cycles.py
    # where contact follows the motion: displacements (k, 2) about which the step was solved, and
    # how many times it was
    about: np.ndarray | None = None
    geometries: int = 1


@dataclass
class Load:
    """Factors of the load patterns, then of the free rigid motions, and the d they make.

    `rest` is what d has beside B w of the patterns, with its own digits: springs of bodies without
    support move them far by loads, and d loses the digits of the rest.

    `extent` is what multipliers have to overcome, see FrictionQP.extent, and `travel` the largest
    displacement of the rank's rows as bodies move as a whole. Bodies without support may go far and
    come back in a step: d is always that of its `start` and of the way from there, never a sum of
    moves, whose rounding would stay. `farthest` d was off by this way in the step, so far.
    """

    weights: np.ndarray
    d: np.ndarray
    extent: float
    travel: float = 0.0
    farthest: float = 0.0
    rest: np.ndarray | None = None

    def __post_init__(self):
        self.rest = self.d.copy() if self.rest is None else self.rest
        self.start = self.weights.copy(), self.d.copy(), self.rest.copy()

    def forget(self) -> None:
        """Bodies are back, and nothing is kept that was found while they were elsewhere."""
        self.farthest = float(np.abs(self.d - self.start[1]).max(initial=0.0))

    def widen(self, change: np.ndarray) -> None:
        """Add `change` (owned,) to d, where gaps get smaller by it; bodies stay where they are."""
        self.d, self.rest = self.d + change, self.rest + change
        self.start = self.start[0], self.start[1] + change, self.start[2] + change

    def correct(self, missed: np.ndarray) -> None:
        """Add `missed` (owned,) to d, which products F x near a solution are off by."""
        self.d, self.start = self.d + missed, (self.start[0], self.start[1] + missed, self.start[2])

    def move(self, motions: list[np.ndarray], change: np.ndarray) -> np.ndarray:
        """Move bodies by `change` (modes,) of their `motions` of dual rows; the change of d."""
        (weights, d, rest), before = self.start, self.d
        first = len(self.weights) - len(motions)
        self.weights[first:] += change
        way = sum((factor * moved for factor, moved in
                   zip((self.weights - weights)[first:], motions)), np.zeros(len(d)))
        self.d, self.farthest = d + way, max(self.farthest, np.abs(way).max(initial=0.0))
        self.rest = rest + way
        return self.d - before


@dataclass
class History:
    """Counts over a run and the log of MPRGP steps."""

    counts: dict = field(default_factory=lambda: dict.fromkeys(
        ("fixed_point_iterations", "dual_multiplications", "dual_multiplications_setup", "cg_steps",
         "expansion_steps", "proportioning_steps", "contact_block_products", "condensed_steps"),
        0))
    log: list = field(default_factory=list)  # (product, step, iteration, kind, residual)
    residuals: dict = field(default_factory=dict)
    steps: int = 0
    warnings: list = field(default_factory=list)
    fallbacks: Fallbacks = field(default_factory=Fallbacks)
    contraction: float = 0.0  # worst of the steps
    seconds: float = 0.0  # of the steps, without those of ...
    examining: float = 0.0  # ... the search for other solutions
    renewing: float = 0.0  # of the steps, in which contact rows were renewed
    watch: Callable | None = None  # is told of long steps: number, products of all, residual

    def at_work(self, index: int, products: int, residual: float | None = None) -> None:
        """Step `index` goes on, after so many `products` with F in all."""
        if self.watch is not None:
            self.watch(index, products, residual)


class StepFailed(DriverError):
    """A time step ended without a solution, with status and message of the error that says why.

    `step`, if there is one, is the unconverged state in which the step was left.
    """

    def __init__(self, error: DriverError, step: Step | None = None):
        super().__init__(str(error))
        self.exit_status, self.step = error.exit_status, step


class Unfinished(Exception):
    """A step fails with `error`; the latest multipliers `x` and their `gradient`.

    `final`: whatever their residuals say, they are no solution. `stagnated`: rounding ended a QP.
    `near`: their residuals are so small that more digits may be all that is missing.
    """

    def __init__(self, error: DriverError, x: np.ndarray, gradient: np.ndarray,
                 final: bool = False, stagnated: bool = False, near: bool = False):
        super().__init__(str(error))
        self.error, self.x, self.gradient = error, x, gradient
        self.final, self.stagnated, self.near = final, stagnated, near


@dataclass
class Trace:
    """Iterations of the fixed point in one time step and the changes they made."""

    iterations: int = 0
    changes: list = field(default_factory=list)
    fallback: bool = False  # successive approximations did not contract
    # QPs to the tolerance, and from the forces of the one before: multipliers answer violently to
    # residuals, or starts of QPs led in circles
    exact: bool = False
    shortcut: bool | None = None  # whether the condensed problem gave a solution, if it was tried
    refined: bool = False  # the latest gradient is that of refined displacements
    rated: bool = False  # `contraction` is asked for where no iterations tell it, too
    rate: float = np.nan  # the answer

    def again(self) -> None:
        """Forget that they did not contract."""
        self.changes, self.fallback, self.exact, self.rate = [], False, False, np.nan

    @property
    def contraction(self) -> float:
        """Geometric mean of the ratios of the last `WINDOW` successive changes; `rate` without any.

        A QP whose start was its solution makes no change, which says nothing of the next one.
        """
        last = [change for change in self.changes if change > 0][-WINDOW - 1 :]
        return (last[-1] / last[0]) ** (1 / (len(last) - 1)) if len(last) > 1 else self.rate

    @property
    def stalls(self) -> bool:
        """Whether the changes have not fallen over a window, or grow beyond all bounds."""
        if self.changes and self.changes[-1] > DIVERGED * min(self.changes):
            return True
        return len(self.changes) > 2 * WINDOW and bool(
            min(self.changes[-WINDOW :]) >= min(self.changes[:-WINDOW]))
