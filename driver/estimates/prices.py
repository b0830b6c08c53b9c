"""The price of the next digit: what 10, 3, 1, 0.3 and 0.1 % of a quantity's error take.

A run with an error budget ends with it: for each accuracy settings, seconds and memory that are
predicted from what the run and its companions have measured. Three kinds of meshes are compared,
linear and quadratic elements on uniform meshes (alternatives.py runs a coarse mesh or two of the
kind that the run is not) and adaptive ones; the fastest is named first.

error     that of the run times (size over its size)^p, p the order that its budget expects
          (`Part.rate`), nowhere less than what is claimed on any mesh (`Part.floor`); coarser
          settings are those that a companion has run: how far it is from the run, and the error of
          the run. Of adaptive meshes a companion refined once by the error in the energy norm tells
          the error, which falls like one over the number of triangles (degree p: their p-th power)
          wherever the solution is singular
time      likewise: every second and fourth time by their companions, more by its order
unknowns  a polynomial of 1/size through those of the run and its companions: a scene may set the
          sizes of elements along a line or in a part of the body alone; of other elements, whose
          companions are too coarse to tell, they grow like those of the run
seconds   a + b N^q by stage through what was measured at N unknowns, q below; the estimates' by
          what their companions would take
memory    with estimates, whose companions stay there: grows with N above an idle process

Predicted errors are claims like others: larger than the true ones. What they take for granted is
that the settings which were run are near the limit enough for their orders to go on.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .budget import coarser, finer, ratio
from .jumps import Jumps

ASKED = (0.1, 0.03, 0.01, 0.003, 0.001)
STEPS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)  # times the run's
MOST, FARTHEST = 600_000, 1e6  # unknowns and times as fine, beyond which nothing is promised
CYCLES = 8  # of adaptive refinement at most
GROWTH = 4.0  # triangles of a cycle over those of the last one
# powers of the unknowns by which seconds of the stages grow, above a constant
POWERS = {"export": 1.0, "setup": 1.2, "solve": 1.2, "output": 1.0}
EVERY_STEP = ("solve", "output")
MOSTLY = 0.9
# MiB an unknown takes at most (measured: 6 to 9 kB, 2 to 4 kB of them without estimates): what a
# small run takes beyond is more packages
HEAVIEST = 0.008
SHORTEST = 1e-4  # seconds that clocks tell from nothing
# that an unknown takes in any stage on the machine that was measured (85,000 of linear elements:
# 2.5 s in all stages, 338,000 of quadratic ones 7.9 s), doubled; more where FreeFEM starts slowly
UNKNOWN = 2e-5
LARGE = 2e4  # unknowns from which a run's seconds are its own, and not those of starts and chance
LEVELS = (0.5, 4.0)  # factors that one kind of mesh may have on the seconds of another
# that an unknown takes in a step of the solution: in every step, and in the first one
SOLVED = 1e-5, 2e-5
LEAST = 0.1  # of the unknowns of a mesh grow with its fineness squared
ROUGH = 0.6  # seconds of a refinement cycle's steps over those of a run: its tolerances are loose
START = 0.1  # seconds that FreeFEM takes to start, where one mesh alone was measured
STEP, ONCE = 0.01, 0.1  # seconds of output that a step and a run take on the smallest mesh ...
DEAREST = 1e-5, 5e-5  # ... and an unknown in them at most: the rest is spent on reading packages


@dataclass(frozen=True)
class Measured:
    """What a run took: unknowns, time steps, seconds by stage (of `solve` and `output` all)."""

    unknowns: float
    steps: int
    seconds: dict

    def per(self, stage: str) -> float:
        """Seconds of a stage, of those that every step has for a step."""
        return self.seconds[stage] / (self.steps if stage in EVERY_STEP else 1)

    @classmethod
    def of(cls, seconds: dict, manifest) -> "Measured":
        """What a run took by its `seconds` as in summary.json; what is small goes with output."""
        stages = {name: seconds[name] for name in ("export", "setup", "solve")}
        more = ("read", "output", "validity", "energy_error")
        stages["output"] = sum(seconds.get(name, 0.0) for name in more)
        return cls(2.0 * manifest.nodes, manifest.steps, stages)


class Costs:
    """Seconds of the stages of runs of one kind of mesh, from measured ones."""

    def __init__(self, whole: Measured, runs: list[Measured], alike: list[Measured],
                 companions: list[Measured]):
        """`whole`: the run; `runs`: companions of the kind, `alike`: of the run's own kind.

        Companions are short: all of them tell how the seconds of FreeFEM's stage grow, those of
        the run's kind, which have about as many steps, how others do, those of the kind a factor.
        What FreeFEM's stage of the run has taken beyond that is the same for all runs: packages
        are read meanwhile.
        """
        self.stages, self.once = {}, 0.0
        exports = [seconds for _, seconds in _points(companions, "export")]
        slow = max(1.0, min(exports, default=START) / START)
        dearest = {"solve": SOLVED[0] + SOLVED[1] / whole.steps}
        for stage, power in POWERS.items():
            points, own = _points(companions, stage), _points([whole], stage)
            if stage == "export" and points:
                common = curve(points, power, most=slow * UNKNOWN)
                self.once = max(0.0, own[0][1] - common(whole.unknowns))
            else:
                grows = (DEAREST[0] + DEAREST[1] / whole.steps) * whole.unknowns
                least = {"export": START, "output": max(
                    STEP + ONCE / whole.steps, own[0][1] - grows)}.get(stage, 0.0)
                most = slow * dearest.get(stage, UNKNOWN)
                common = curve([*_points(alike, stage), *own], power, least, most)
            self.stages[stage] = scaled(common, _points(runs, stage))

    def stage(self, name: str, unknowns: float, steps: int = 1) -> float:
        """Seconds of a stage."""
        return self.stages[name](unknowns) * (steps if name in EVERY_STEP else 1)

    def run(self, unknowns: float, steps: int) -> float:
        """Seconds of a run without error estimates."""
        return self.once + sum(self.stage(name, unknowns, steps) for name in POWERS)

    def companions(self, unknowns: float, steps: int, compared: bool = True) -> float:
        """What the companions of a run's budget take, relative to those of another run.

        They are on meshes with a quarter and a sixteenth of its unknowns, or, where the mesh has
        no coarser one to be compared with, on its own.
        """
        if not compared:
            return self.stage("solve", unknowns, 2 * steps)
        coarse, coarsest = unknowns / 4, unknowns / 16
        made = sum(self.stage(name, n) for name in ("export", "setup") for n in (coarse, coarsest))
        return made + self.stage("solve", coarse, 2 * steps) + self.stage("solve", coarsest, steps)


def _points(runs: list[Measured], stage: str) -> list[tuple[float, float]]:
    """Unknowns and seconds of a stage in the runs that have it."""
    return [(run.unknowns, max(run.per(stage), SHORTEST)) for run in runs if stage in run.seconds]


def curve(points: list[tuple[float, float]], power: float, least: float = 0.0,
          most: float = math.inf) -> Callable[[float], float]:
    """N -> a + b N^power, a and b >= 0, nearest to the `points` (N, t), relative to t.

    A single point leaves the constant open: it is `least`. It is MOSTLY of the largest point at
    most: where there is no growth yet, there will be. No unknown of the largest point takes more
    than `most` where it is not LARGE: what small runs take beyond is chance, and constant.
    """
    from scipy.optimize import nnls  # the front imports this module

    size = max(n for n, _ in points)
    n, t = np.array([(n / size, t) for n, t in points]).T
    constant = min(least, MOSTLY * t[0])
    slope = t[0] - constant
    if len(points) > 1:
        constant, slope = nnls(np.column_stack([1 / t, n**power / t]), np.ones(len(t)))[0]
    if slope < (1 - MOSTLY) * t[n.argmax()]:
        constant, slope = MOSTLY * t[n.argmax()], (1 - MOSTLY) * t[n.argmax()]
    if size < LARGE and slope > most * size:
        constant, slope = max(constant, t[n.argmax()] - most * size), most * size
    return lambda unknowns: constant + slope * (unknowns / size) ** power


def growth(fineness: list[float], unknowns: list[float]) -> np.ndarray:
    """Coefficients c2, c1, c0 >= 0 of the unknowns c2 f^2 + c1 f + c0 of meshes f times as fine.

    They are those of the first mesh there and nearest to the others, relative to them. Uniform
    elements in all of a body make c2, those along a line c1, those whose sizes the scene fixes c0.
    At least LEAST of the first mesh grows with the square.
    """
    from scipy.optimize import nnls  # the front imports this module

    f, n = np.array(fineness), np.array(unknowns)
    terms = np.column_stack([f**2, f, np.ones(len(f))])[:, :len(f)]
    powers = np.zeros(3)
    powers[:len(f)] = nnls(terms / n[:, None], np.ones(len(f)))[0]
    powers[0] = max(powers[0], LEAST * n[0])
    return powers * (n[0] / powers.sum())


def scaled(curve: Callable[[float], float],
           points: list[tuple[float, float]]) -> Callable[[float], float]:
    """A curve times the factor by which measured `points` (N, t) exceed it, in the geometric mean.

    Stages without a point are like the curve.
    """
    factors = [t / curve(n) for n, t in points]
    mean = math.prod(factors) ** (1 / max(len(factors), 1))
    factor = min(max(mean, LEVELS[0]), LEVELS[1])
    return lambda unknowns: factor * curve(unknowns)


@dataclass(frozen=True)
class Choice:
    """Settings of a kind of mesh that leave no more than an error, and the unknowns of each mesh
    on the way: of adaptive refinement those of the cycles come before that of the run."""

    settings: dict
    unknowns: tuple
    compared: bool = True  # there are coarser meshes


@dataclass
class Uniform:
    """Meshes of one kind of element in all sizes."""

    name: str
    knob: str
    sizes: list  # that were run, finest first
    errors: list  # at these
    unknowns: list  # at these
    rate: float
    costs: Costs | None = None
    words: dict = field(default_factory=dict)  # further settings
    like: "Uniform | None" = None  # other elements, whose finer meshes were run
    least: float = 0.0  # error on any mesh

    def count(self, size: float) -> float:
        """Unknowns at a size: those of the meshes that were run, else what they grow like."""
        if size in self.sizes:
            return self.unknowns[self.sizes.index(size)]
        if self.like:
            return self.unknowns[0] * self.like.count(size) / self.like.count(self.sizes[0])
        powers = growth([ratio(self.knob, self.sizes[0], s) for s in self.sizes], self.unknowns)
        return float(np.polyval(powers, ratio(self.knob, self.sizes[0], size)))

    def meets(self, room: float) -> Choice | None:
        """The coarsest of the meshes whose error is at most `room`, None if out of reach."""
        finest, error = self.sizes[0], self.errors[0]
        size, worst = None, self.least
        if room < self.least:
            return None
        for known, own in zip(self.sizes, self.errors):
            worst = max(worst, own)
            if worst <= room:
                size = known
        if size is None:
            factor = (error / room) ** (1 / max(self.rate, 0.05))
            if not factor < FARTHEST:
                return None
            size = finer(self.knob, finest, factor)
        if not self.count(size) <= MOST:
            return None
        settings = {self.knob.upper(): f"{float(size):g}", **self.words}
        return Choice(settings, (self.count(size),), coarser(self.knob, size) is not None)


@dataclass
class Adaptive:
    """Meshes refined by the error in the energy norm from one uniform mesh."""

    name: str
    settings: dict  # of the uniform mesh
    errors: list  # after 0, 1, ... cycles, as far as they were run
    unknowns: list  # likewise
    rate: float  # order in the size of elements, of which a cycle is half
    costs: Costs | None = None
    least: float = 0.0  # error on any mesh

    def meets(self, room: float) -> Choice | None:
        """The fewest cycles whose error is at most `room`, None if out of reach."""
        known = len(self.errors) - 1
        if room < self.least:
            return None
        for cycles in range(1, CYCLES + 1):
            beyond = cycles - known
            error = (max(self.errors[cycles:]) if beyond <= 0
                     else self.errors[-1] * 2.0 ** (-self.rate * beyond))
            on_the_way = [*self.unknowns[: cycles + 1], *(
                self.unknowns[-1] * GROWTH**k for k in range(1, beyond + 1))]
            if on_the_way[-1] > MOST:
                return None
            if error <= room:
                return Choice({**self.settings, "ADAPT": str(cycles)}, tuple(on_the_way))
        return None


@dataclass
class Quantity:
    """What the list is made for: a quantity, and its errors but for that of the mesh."""

    name: str
    value: float
    steps: int
    static: bool  # there is no STEPS to choose
    times: dict  # error by number of steps, as far as they were run; the run's at least
    rate: float  # order of the time step
    others: float  # fixed point and solver
    jumps: Jumps | None = None  # over cycles

    def choices(self, room: float) -> list[tuple[dict, float, float]]:
        """Settings, steps in the run's cycles that cost as much, and what this leaves of `room` for
        the mesh, where it leaves any.
        """
        jumps = self.jumps.choices() if self.jumps else [("", 0.0, 1.0)]
        return [({} if self.static else {"STEPS": str(steps), **({"CYCLES": f'"{words}"'}
                                                                 if words else {})},
                 steps * more, left - error)
                for steps, left in self._steps(room) for words, error, more in jumps
                if left > error]

    def _steps(self, room: float) -> list[tuple[int, float]]:
        """Numbers of steps and what each leaves of `room`, where it leaves any."""
        room -= self.others
        more = [] if self.static or not self.times[self.steps] else STEPS
        known = [(steps, max(error for other, error in self.times.items() if other >= steps))
                 for steps in sorted(self.times)]
        known += [(factor * self.steps, self.times[self.steps] * factor**-self.rate)
                  for factor in more]
        return [(steps, room - error) for steps, error in known if room > error]


@dataclass
class Whole:
    """The run that all is relative to."""

    run: Measured
    estimates: float  # seconds of its error budget and of this list
    costs: Costs  # of its kind of mesh
    memory: float  # MiB, with the estimates
    idle: float  # of it before anything was read

    def memory_of(self, unknowns: float) -> float:
        """MiB of a run: of what came after packages were read, little is not for unknowns."""
        grows = min(self.memory - self.idle, HEAVIEST * self.run.unknowns)
        return self.memory + grows * (unknowns / self.run.unknowns - 1)


def price(kind: Uniform | Adaptive, quantity: Quantity, whole: Whole, asked: float) -> dict | None:
    """The fastest settings of a kind of mesh for a relative error, with what they take."""
    best = None
    for settings, steps, room in quantity.choices(asked * abs(quantity.value)):
        choice = kind.meets(room)
        if choice is None:
            continue
        *cycles, unknowns = choice.unknowns
        bare = kind.costs.run(unknowns, steps)
        bare += sum(kind.costs.run(n, steps)
                    - (1 - ROUGH) * kind.costs.stage("solve", n, steps) for n in cycles)
        own = whole.costs.companions(whole.run.unknowns, whole.run.steps)
        made = kind.costs.companions(unknowns, steps, choice.compared)
        estimates = whole.estimates * made / own
        entry = {"settings": choice.settings | settings,
                 "seconds": bare + estimates, "seconds_bare": bare,
                 "memory_mib": whole.memory_of(unknowns)}
        if best is None or entry["seconds"] < best["seconds"]:
            best = entry
    return best


def lines(kinds: list, quantity: Quantity, whole: Whole) -> list[dict]:
    """An entry for each of ASKED: the fastest settings, and under `compared` those of each kind."""
    table = []
    for asked in ASKED:
        offers = {kind.name: price(kind, quantity, whole, asked) for kind in kinds}
        offers = {name: offer for name, offer in offers.items() if offer}
        entry = {"accuracy": asked}
        if offers:
            name = min(offers, key=lambda name: offers[name]["seconds"])
            entry |= {"kind": name, **offers[name], "compared": offers}
        table.append(entry)
    return table
