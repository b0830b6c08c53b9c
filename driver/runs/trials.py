"""Runs of a search for settings, and the choice of time steps and tolerances by them.

A search (goal.py) looks for meshes; this tells the steps and tolerances that go with them.

steps       5, 10, 20, ..., from the first that miss nothing noticeable of loads and obstacles,
            until the part of the time step is below TIME of what is allowed; their times are from
            one finely sampled history; one where the end does not depend on the way
tolerances  RTOL, FRICTION_RTOL start far above what single runs use and are tightened until a
            hundredth of them would change the quantity by less than ALGEBRAIC of what is allowed,
            so that nothing is solved beyond the discretization error; with many steps, whose
            errors add up, they are smaller in proportion

Both are checked again on the last mesh but one, tolerances tightened if what they leave, scaled to
the last mesh, does not fit beside the other parts; where two meshes do they were chosen on the last
one.
"""

import dataclasses
import math

from ..effects import Effects
from ..effects.quasistatic import proportional
from ..errors import DriverError, NotConverged
from ..estimates.between_steps import misses, of_earlier_moment
from ..estimates.budget import (OF_TIME, Part, extrapolate, formal_order, located, ratio,
                                summed)
from ..estimates.budget_words import SOURCES, share
from ..estimates.companions import LEFT, MANY, MOSTLY
from .tolerances import TIGHTER, left, much_tighter, scaled, tightened

SAMPLING = 32  # times of the load history per step of the scene
FEWEST = 4  # a fourth of the scene's own steps is where their choice starts
TIME, ALGEBRAIC = 0.35, 0.05
LAST = 0.7  # of what is allowed may be the time step's part where there are no more steps to take
ON_ARRIVAL = "most of it occurred in steps in which nodes first touched: it needs more steps"
RETRIES = (1.0, 0.1, 0.01)  # factors of the tolerances of a run that failed


class Trials:
    """Runs with the settings that a search has chosen so far. Collective."""

    def __init__(self, levels, settings, asked: float, name: str):
        """`levels`: the scene's; `settings` not chosen here; `name` of the quantity."""
        self.levels, self.asked, self.name = levels, asked, name
        self.settings = dataclasses.replace(settings, rtol=0.01 * asked, friction_rtol=0.1 * asked,
                                            primal_rtol=0.03 * asked)
        self.reference = tightened(self.settings, TIGHTER)
        self.knob, self.element = None, {}  # of the meshes; the element where it is not the scene's
        self.sizes: list = []  # of the meshes, coarse to fine
        self.parts: dict = {}  # by source: {quantity: Part}
        # sizes of the meshes that the time step's part is from, and what tolerances leave
        self.timed = self.judged = None

    def begin(self, size, knob: str, element: dict) -> None:
        """Start from the mesh of a size, which the parameter `knob` sets, and of an element."""
        self.knob, self.element, self.sizes = knob, element, [size]

    def follow(self, problem) -> None:
        """Take the history of a `problem` of the scene, in as few steps as the choice starts with.

        Where friction remembers the way they miss nothing noticeable of it; of jumps, which any
        steps miss, no more are made than the scene's own.
        """
        manifest = problem.manifest
        # of a history that is sampled so finely nothing is known between the samples
        self.history = dataclasses.replace(manifest, between=manifest.amplitudes)
        self.motion = problem.structure.contact.motion_of_all_times
        self.effects, self.total = Effects(manifest), manifest.steps
        # a power of two that ends where histories turn
        self.stride = 1
        if self.effects.quasistatic:
            self.stride = math.gcd(SAMPLING * FEWEST, self.total, manifest.cycle_start)
            least = SAMPLING if self._misses(2) else 1
            while self.stride > least and self._misses(self.stride):
                self.stride //= 2

    def _misses(self, stride: int) -> bool:
        """Whether every `stride`-th time misses what the history does."""
        return misses(self.effects, self.history, self.motion, stride)

    # ---- runs ------------------------------------------------------------------------------------
    def mesh(self, size) -> dict:
        """Parameters of the mesh of a size."""
        return {self.knob: size, **self.element}

    def level(self, size, stride=None, settings=None):
        """The run on the mesh of a size, by default as chosen. Raises DriverError if it fails."""
        stride = stride or self.stride
        settings = self.scaled(settings or self.settings, stride)
        for factor in RETRIES:  # loose tolerances can miss the balance of a body that slides
            try:
                return self.levels.run(tightened(settings, factor), stride, **self.mesh(size))
            except DriverError as failure:
                error = failure
        raise error

    def scaled(self, settings, stride: int):
        """Tolerances of a run with many steps: what each step leaves adds up in slip and energy."""
        return tightened(settings, min(1.0, 5 / (self.total // stride)))

    def values(self, size, stride=None, settings=None) -> dict:
        """Quantities of the run on the mesh of a size."""
        return self.level(size, stride, settings).values

    @property
    def steps(self) -> int:
        """Time steps with the chosen stride."""
        return self.total // self.stride

    def choose_steps(self, size, finest: int | None = None) -> None:
        """As few steps as keep their error below TIME of what is allowed.

        The smallest stride tried is `finest`, by default that of the scene's own steps.
        """
        finest = finest or SAMPLING
        fewest, self.timed = self.stride, size
        if "time" in self.parts and not self._misses(2 * self.stride):
            fewest = 2 * self.stride
        strides = [fewest, max(1, fewest // 2)]
        runs = [self.values(size, stride) for stride in strides]
        while strides[-1] > finest and not (
                self._in_time(runs) and (self.name != "slip" or self._told(size, strides[-1]))):
            strides.append(strides[-1] // 2)
            runs.append(self.values(size, strides[-1]))
        self._in_time(runs)
        self.stride, most = strides[-1], self.parts["time"]
        for stride, run in zip(strides[:-1], runs):
            errors = _beside(run, runs[-1], most)
            if errors[self.name].error <= TIME * self.asked * abs(run[self.name]):
                self.stride, self.parts["time"] = stride, errors
                return

    def _told(self, size, stride: int) -> bool:
        """Whether the steps of a `stride` tell the error of slip that is made on touching."""
        if self.total // stride >= MANY:
            return True
        return self.level(size, stride).record.slid_on_arrival() <= MOSTLY

    @property
    def time_share(self) -> float:
        """Part of what is allowed that the time step may take."""
        return TIME if self.stride > 1 else LAST

    def _in_time(self, runs: list[dict]) -> bool:
        """Whether the time steps of the last run err by TIME of what is allowed at most.

        Each of `runs` has twice as many steps as the one before; sets their part of the error.
        """
        last = runs[:-4:-1]
        self.parts["time"] = {q: extrapolate([a[q] - b[q] for a, b in zip(last, last[1:])],
                                             [2.0] * (len(last) - 1),
                                             formal_order("time", "", q), value, True)
                              for q, value in last[0].items()}
        return self.parts["time"][self.name].error <= TIME * self.asked * abs(last[0][self.name])

    def memoryless(self, size) -> bool:
        """Whether one step gives the quantity because the end does not depend on the way to it."""
        problem = self.levels.problem(**self.mesh(size))
        contact, effects = problem.structure.contact, self.effects
        if not self.effects.quasistatic or self.level(size).at < self.steps - 1:
            return False  # nothing to choose, or the quantity belongs to a moment before the end
        if contact.following is not None:
            return False  # the way there is found step by step
        return not effects.frictional or (
            "preload" not in effects
            and effects.homogeneous(contact, effects.initial_displacement(contact))
            and proportional(problem.manifest.factors))

    def more_steps(self, size) -> None:
        """More steps, as the mesh of a size tells; raises NotConverged if there are no more."""
        if self.stride == 1:
            entry = self.budget()[self.name]
            error, value = entry["time"], abs(entry["value"])
            raise NotConverged(
                f"even with {self.total} steps the {self.words} has an error of "
                f"{share(error, value)}: too much of {100 * self.asked:g} %, of which the mesh "
                f"needs a part; {share(error, LAST * value)} may do")
        before = self.stride
        self.choose_steps(size, 1)
        self.stride = min(self.stride, before // 2)

    def renew_time(self, size) -> None:
        """The time step's part of the error on a finer mesh, against half the steps."""
        if "time" not in self.parts or self.stride == self.total or size == self.timed:
            return
        self.timed, own = size, self.values(size)
        if self.stride == 1 or not self._misses(2 * self.stride):
            self._in_time([self.values(size, 2 * self.stride), own])
            return
        finer = self.values(size, self.stride // 2)
        self._in_time([own, finer])
        self.parts["time"] = _beside(own, finer, self.parts["time"])

    @property
    def words(self) -> str:
        """The quantity as people write it."""
        return self.name.replace("_", " ")

    def _tightest(self):
        """Settings much tighter than the chosen ones; those of before, as long as they are."""
        if not much_tighter(self.reference, self.settings):
            self.reference = tightened(self.settings, TIGHTER)
        return self.reference

    def _left(self, size) -> tuple[dict, dict]:
        """Parts of the error that tolerances leave on a mesh, and quantities there.

        By few steps, or where these have no solution, as where they miss the load that clamps a
        body, by those of the search.
        """
        def by(stride: int) -> tuple[dict, dict]:
            return left(lambda settings: self.values(size, stride, settings), self.settings,
                        self._tightest(), self.effects.pressure_bounds_friction)

        few = max(self.stride, min(self.total, SAMPLING * FEWEST))
        try:
            return by(few)
        except DriverError:
            if few == self.stride:
                raise
            return by(self.stride)

    def negligible(self, allowed: float) -> bool:
        """Whether what tolerances leave fits into what is `allowed`, beside the other parts.

        The mesh on which they were chosen tells, or else the mesh before; on the last one it is
        more by the ratio of element sizes, see LEFT.
        """
        for size in dict.fromkeys((self.judged, self.sizes[-2])):
            scale = LEFT * ratio(self.knob, size, self.sizes[-1])
            self.parts |= scaled(self._left(size)[0], scale)
            if self.budget()[self.name]["total"] <= allowed:
                return True
        return False

    def tighten(self, size) -> bool:
        """Tolerances of a part of the error small enough on a mesh; whether they were changed."""
        before, self.judged = self.settings, size
        while True:
            parts, values = self._left(size)
            self.parts |= parts
            if values[self.name] == 0:
                return False
            allowed, changes = ALGEBRAIC * self.asked * abs(values[self.name]), {}
            if parts["solver"][self.name].error > allowed:
                changes |= {"rtol": 0.1 * self.settings.rtol,
                            "primal_rtol": 0.1 * self.settings.primal_rtol}
            if "friction" in parts and parts["friction"][self.name].error > allowed:
                changes["friction_rtol"] = 0.1 * self.settings.friction_rtol
            if not changes or self.settings.rtol < 1e-11 or self.settings.friction_rtol < 1e-11:
                return self.settings != before
            self.settings = dataclasses.replace(self.settings, **changes)

    @property
    def claimed(self) -> dict:
        """The parts of the finest mesh's errors, with what its steps leave open of slip, and of a
        moment before the end.
        """
        parts = dict(self.parts)
        if "slip" in parts.get("time", ()) and self.stride < self.total:
            left_open = OF_TIME * self.level(self.sizes[-1]).record.arrivals()
            slip = located(parts["time"]["slip"], left_open)
            if self.name != "slip" and not self._told(self.sizes[-1], self.stride):
                slip = Part(None, note=ON_ARRIVAL)
            parts["time"] = parts["time"] | {"slip": slip}
        if "time" in parts:
            level = self.level(self.sizes[-1])
            history = dataclasses.replace(self.history, steps=level.declared)
            left = of_earlier_moment(history, level.record, level.at, self.motion)
            parts["time"] = parts["time"] | {
                name: located(parts["time"][name], OF_TIME * size)
                for name, size in left.items() if name in parts["time"]}
        return parts

    def budget(self) -> dict:
        """Budget of every quantity on the finest mesh."""
        values, parts = self.values(self.sizes[-1]), self.claimed
        order = [source for source in SOURCES if source in parts]
        return {q: summed({source: parts[source][q] for source in order}, value)
                for q, value in values.items()}


def _beside(run: dict, finer: dict, parts: dict[str, Part]) -> dict[str, Part]:
    """Parts of a run: what it differs by from one with more steps, and what that errs by."""
    return {q: Part(abs(run[q] - finer[q]) + parts[q].error) for q in run}
