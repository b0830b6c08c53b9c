"""What the cycles of a repeated history come to, and whether they have: pure comparisons.

The forces and slips of a cycle are compared with those of the cycle before. Elastic bodies with
friction end in one of three ways (Klarbring, Ciavarella, Barber, Int. J. Solids Struct. 44 (2007)
8355): shakedown, in which nothing slides any more; alternating slip, in which what slides comes
back; ratcheting, in which every cycle carries it on by as much. Where surfaces wear, and they do as
long as anything slides, the worn depth at last grows by as much in every cycle.

What cycles to come would still change is the sum of the geometric series that the last changes
begin. That takes three of them: from the first one, of the cycle after the loads were put on, to
the next they fall by a lot, and go on as slowly as surfaces wear or friction changes with slip.
Changes that tolerances leave open go to and fro. Changes as small that go on in one direction are
those of surfaces that wear slowly; over many cycles they are a lot.
"""

import re
from dataclasses import dataclass, field

import numpy as np

SHAKEDOWN, ALTERNATING, RATCHETING, WEAR = "shakedown", "alternating slip", "ratcheting", "wear"
SETTLED = 1e-3  # of the largest contact force, which cycles to come may still change
EVEN = 1e-2  # by which slips and growths of settled cycles may differ
GONE = 5e-2  # of a cycle's slip that a series which ends in no slip may seem to end in
ROUNDED = 30  # times PRIMAL_RTOL: what forces differ by where nothing but tolerances differs
ADDS_UP = 0.9  # change over two cycles, over the sum of both, from which on they go on one way
SHARE = 0.01  # of what grows in a jump that it may err by, where CYCLES gives no other
MOVED, WORN = "u_t", "wear.worn_depth"  # of what a cycle hands on
RIGID = ("weights", "motion", "placed")
FOLLOWING = ("elastic", *RIGID)  # parts of u_t, or beside it


@dataclass(frozen=True)
class Choice:
    """What CYCLES= asks for: a number of cycles, to stop when settled, an error of jumps."""

    count: int | None = None
    settles: bool = False
    jumps: float | None = None

    @classmethod
    def of(cls, words: str) -> "Choice":
        """From the option's text, which arguments.CYCLES has checked."""
        count, rest = re.fullmatch(r"(\d*) ?(.*)", words).groups()
        share = re.search(r"([\d.e-]+)%", rest)
        jumps = (float(share[1]) / 100 if share else SHARE) if "jump" in rest else None
        return cls(int(count) if count else None, "settled" in rest, jumps)


@dataclass
class Cycle:
    """A row of cycles.csv; see results/tables.py."""

    cycle: int
    step: int
    time: float
    kind: str
    settled: bool
    change: float
    remaining: float
    slip: float
    drift: float
    wear: float
    skipped: int
    error: float


@dataclass
class Past:
    """What cycles so far leave to the judgement of the next one; arrays of the rank's nodes."""

    number: int = 0  # cycles gone through, those skipped included
    plan: list = field(default_factory=list)  # cycles skipped after each computed one
    rows: list = field(default_factory=list)  # of Cycle, as dictionaries
    start: dict = field(default_factory=dict)  # what the cycle at hand began with
    growth: dict = field(default_factory=dict)  # in the cycle before
    before: dict = field(default_factory=dict)  # forces (steps, k) of the cycle before
    older: dict = field(default_factory=dict)  # those of the cycle before that
    forces: dict = field(default_factory=dict)  # of the one at hand, so far
    way: np.ndarray | None = None  # (j,) that nodes have slid in it so far


def significant(growth: dict, nothing: float, largest, way: float) -> list[str]:
    """Names of what has grown in a cycle whose largest slip is `way`, by more than `nothing`.

    Displacements count by u_t alone; wear, however little, where there is slip that counts, whose
    digits are its own.
    """
    return [name for name in growth if name not in FOLLOWING
            and largest(growth[name]) > (nothing if name != WORN or way <= nothing else 0.0)]


def judged(past: Past, step, growth: dict, forces: dict, largest, nothing: float,
           rounded: float) -> Cycle:
    """The row of the cycle that ends with `step`, of which `past.number` is the number.

    It has seen `growth` of what is handed on, and the contact `forces` of its steps; `largest` is
    the largest size of an entry of arrays on all ranks, `nothing` the slip, and `rounded` the
    relative change of forces, that tolerances leave open.
    """
    way, drift = largest(past.way), largest(growth[MOVED])
    worn = largest(growth[WORN]) if WORN in growth else 0.0
    change, remaining = _of_forces(past, forces, largest, rounded)
    skipped, error, even = (past.plan[-1] if past.plan else 0), 0.0, bool(past.rows)
    if past.growth:
        bends = {name: largest(growth[name] - past.growth[name])
                 for name in significant(growth, nothing, largest, way)}
        error = skipped * max(bends.values(), default=0.0)
        even = all(bend <= max(nothing, EVEN * max(way, largest(growth[name])))
                   for name, bend in bends.items())
    ways, drifts = ([row[name] for row in past.rows[-2:]] for name in ("slip", "drift"))
    even = even and abs(way - ways[-1]) <= max(nothing, EVEN * way)
    still = way <= nothing
    fades = len(ways) > 1 and limit(*ways, way) <= GONE * way
    closed = drift <= max(nothing, EVEN * way) or (
        len(drifts) > 1 and limit(*drifts, drift) <= GONE * drift)
    settled = still or remaining <= SETTLED and (fades or even)
    return Cycle(past.number, step.index, step.time, _kind(still or fades, closed, worn > 0),
                 bool(settled), change, remaining, way, drift, worn, skipped, error)


def _of_forces(past: Past, forces: dict, largest, rounded: float) -> tuple[float, float]:
    """Relative change of forces against the cycle before, and what is to come of it.

    After a jump the mean change of the cycles since the one before it.
    """
    if not past.before:
        return 1.0, 1.0
    size, remaining = largest(*forces.values()), 1.0
    cycles = 1 + (past.plan[-1] if past.plan else 0)
    whole = _difference(forces, past.before, largest) / size if size > 0 else 0.0
    change = whole / cycles
    *_, before, last = 0.0, 0.0, *(row["change"] for row in past.rows[1:])  # 1 in the first
    if whole <= rounded and not _goes_on(past, forces, change, size, largest, rounded):
        remaining = change
    elif min(before, last) > 0 and not any(past.plan[-3:]):
        remaining = min(1.0, geometric(change, max(change / last, last / before)))
    return change, remaining


def _difference(forces: dict, others: dict, largest) -> float:
    """The largest difference of two cycles' forces."""
    return largest(*(forces[name] - others[name] for name in forces))


def _goes_on(past: Past, forces: dict, change: float, size: float, largest,
             rounded: float) -> bool:
    """Whether a `change` that tolerances may leave open goes on from the last one, as where
    surfaces wear: both are more than what residuals are, and the change over both adds up. After
    two cycles it may: nothing tells yet.
    """
    last = past.rows[-1]["change"]
    if any(past.plan[-2:]) or min(change, last) <= rounded / ROUNDED:
        return False
    if not past.older:
        return len(past.rows) == 1
    return _difference(forces, past.older, largest) >= ADDS_UP * (change + last) * size


def geometric(change: float, ratio: float) -> float:
    """Sum of the changes to come if each is `ratio` times the one before; inf if they do not end.
    """
    return change * ratio / (1 - ratio) if 0 <= ratio < 1 else np.inf


def limit(first: float, second: float, third: float) -> float:
    """What three numbers tend to as a geometric series does, no less than zero; inf if not so."""
    before, change = second - first, third - second
    if change == 0:
        return third
    ratio = change / before if before else np.inf
    return max(0.0, third + change * ratio / (1 - ratio)) if 0 <= ratio < 1 else np.inf


def _kind(still: bool, closed: bool, wears: bool) -> str:
    """What the cycles are, or come to."""
    if still:
        return SHAKEDOWN
    if wears:
        return WEAR
    return ALTERNATING if closed else RATCHETING
