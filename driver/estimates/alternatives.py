"""Runs on other kinds of meshes beside one run, for the price list of its accuracy (prices.py).

A run with linear elements gets companions with quadratic ones on meshes four and eight times as
coarse, a quadratic one with linear elements on meshes as fine and half as fine, a large one half
and a quarter as fine; a uniform one a companion that is refined once by the error in the energy
norm of its coarsest one. They have every fourth step of the run. Their errors are bounded from both
sides by their distance from the run: what their own sequence tells counts only in between.
"""

import dataclasses

import numpy as np

from ..energy_norm import adaptivity
from ..energy_norm.energy import EnergyEstimator
from ..errors import DriverError, agreed_writes
from ..results.contact_state import ContactState
from ..scene import element_kinds
from ..timing import memory_used
from . import prices, refinement
from .budget import (Part, coarser, coarser_sizes, extrapolate, formal_order, mesh_knob, ratio,
                     vanishing)
from .caution import by_balance
from .free_peak import UNSEEN, Peaks
from .jumps import Jumps
from .prices import Adaptive, Costs, Measured, Quantity, Uniform, Whole

OTHER = {"P1": "P2", "P2": "P1"}  # P2-mixed: materials in which linear elements lock
# by the elements of the other kind, halvings of its meshes from that of the run: quadratic ones
# have like errors where they are coarser
HALVINGS = {"P2": (2, 3), "P1": (0, 1)}
# dofs of a quadratic run from which linear ones are on meshes half and a quarter as fine: to make
# one as fine as its own takes as long as the run, and coarser ones tell as much there
LARGE, OF_LARGE = 40_000, (1, 2)
RATE = 1.0  # order expected where none was observed
# the same of cycles of adaptive refinement, by degree, if they are like halved sizes. Functionals
# should gain twice the degree there; on coarse meshes they do not yet
ADAPTIVE = {1: 1.0, 2: 1.5}


class Alternatives:
    """Kinds of meshes for one quantity of a run. Collective."""

    def __init__(self, companions, parts: dict[str, dict[str, Part]], name: str, run: Measured):
        """`companions` of the run, `parts` of its budget; `run` is what it has taken itself."""
        self.companions, self.name, self.run = companions, name, run
        self.levels, self.manifest = companions.levels, companions.manifest
        self.knob, self.mesh = companions.knob, parts["mesh"][name]
        self.parts = {source: part[name] for source, part in parts.items()}
        self.stride = companions.strides.up_to(4)
        self.took: dict = {}  # runs by kind of mesh

    # ---- what was measured -----------------------------------------------------------------------
    def _unknowns(self, **mesh) -> float:
        return 2.0 * self.levels.problem(**mesh).manifest.nodes

    def _measured(self, mesh: dict, stride: int, **changes) -> list[Measured]:
        """What a companion took, nothing if it was not run."""
        key = tuple(sorted({**mesh, **changes}.items()))
        level = self.companions.level({**mesh, **changes}, stride)
        if level is None or key not in self.levels.spent:
            return []
        seconds = {**self.levels.spent[key], "solve": level.seconds}
        return [Measured(self._unknowns(**mesh, **changes), level.declared, seconds)]

    def _value(self, mesh: dict, stride: int) -> float | None:
        """The quantity in the run itself, or in a companion of its kind, None if that has failed.
        """
        if stride == 1 and mesh == self.companions.meshes[0]:
            return self.companions.values[self.name]
        level = self.companions.level(mesh, stride)
        return None if level is None else level.values[self.name]

    def _errors(self) -> list[float]:
        """Of the run and its companions on coarser meshes, up to one that has failed."""
        errors = [self.mesh.error]
        for fine, coarse, stride in zip(self.companions.meshes, self.companions.meshes[1:],
                                        (1, self.companions.strides.of_coarse_meshes)):
            values = [self._value(mesh, stride) for mesh in (coarse, fine)]
            if None in values:
                break
            errors.append(errors[-1] + abs(values[0] - values[1]))
        return errors

    # ---- kinds -----------------------------------------------------------------------------------
    def kinds(self) -> list:
        """All kinds of meshes that the scene can have."""
        if self.levels.refined:
            return self._of_cycles()
        own = self._own()
        refined = self._begun(self.companions.meshes[len(own.sizes) - 1])
        kinds = [kind for kind in (own, self._other(own), self._refined(own, refined)) if kind]
        everything = [run for runs in self.took.values() for run in runs]
        for kind in kinds:
            kind.costs = Costs(self.run, self.took[kind.name], self.took[own.name], everything)
            kind.least = self.mesh.floor
        return kinds

    def _own(self) -> Uniform:
        errors = self._errors()
        meshes = self.companions.meshes[: len(errors)]
        runs = []
        for mesh, stride in zip(meshes[1:], (1, self.companions.strides.of_coarse_meshes)):
            runs += self._measured(mesh, stride)
        size, element = self.manifest.parameters[self.knob], self.manifest.element
        self.took[element] = runs
        return Uniform(element, self.knob, [size, *(mesh[self.knob] for mesh in meshes[1:])],
                       errors, [self._unknowns(**mesh) for mesh in meshes], self.mesh.rate,
                       words={} if element == "P1" else {"ELEMENT": element})

    def _other(self, own: Uniform) -> Uniform | None:
        """The other order of elements."""
        others = of_other_elements(self.manifest)
        if not others:
            return None
        element = others[0]["element"]
        changes = {"element": element}
        runs = {mesh[self.knob]: self.companions.level(mesh, self.stride, quiet=True)
                for mesh in others}
        sizes = [size for size, level in runs.items() if level]
        if not sizes:
            return None
        values = [runs[size].values[self.name] for size in sizes]
        ratios = [ratio(self.knob, b, a) for a, b in zip(sizes, sizes[1:])]
        part = extrapolate([a - b for a, b in zip(values, values[1:])], ratios,
                           formal_order("mesh", element, self.name), values[0], True)
        self.took[element] = [run for size in sizes for run in self._measured(
            {self.knob: size}, self.stride, **changes)]
        errors = [max(self._within(values[0], part.error, own), self._unseen(runs[sizes[0]]))]
        if element == "P1":  # linear functions are quadratic ones, too: on no finer mesh, no better
            errors[0] = max(errors[0], own.errors[0])
        for a, b in zip(values, values[1:]):
            errors.append(errors[-1] + abs(a - b))
        return Uniform(element, self.knob, sizes, errors,
                       [self._unknowns(**{self.knob: size}, **changes) for size in sizes],
                       RATE, words={"ELEMENT": element}, like=own)

    def _within(self, value: float, error: float | None, own: Uniform) -> float:
        """An error of a companion's `value`: at least its distance from the run, and at most that
        and the run's error.

        Both have different steps: the mesh of the other companions, which was run with either,
        tells what they make. At least: one of both errs by half of it, and it may be this one.
        """
        companions, name = self.companions, self.name
        base = companions.base
        finer = companions.values[name] - self._value(base, 1)
        apart, bound = abs(value - self._value(base, self.stride) - finer), own.errors[0]
        return max(min(np.inf if error is None else error, apart + bound), apart)

    def _unseen(self, level) -> float:
        """What a companion leaves open of a displacement that a support prescribes, or of one that
        is little more: all meshes agree on that.
        """
        if self.name != "displacement":
            return 0.0
        peaks = Peaks.of_level(level)
        return UNSEEN * peaks.largest if peaks.largest <= (1 + UNSEEN) * peaks.held else 0.0

    def _refined(self, own: Uniform, begun: tuple | None) -> Adaptive | None:
        """Adaptive meshes, from the coarsest mesh of the run's kind; the first one has `begun`."""
        start = self.companions.meshes[len(own.sizes) - 1]
        try:
            level, refined = self._refine(start, begun)
        except DriverError:
            return None
        if level is None:
            return None
        unknowns = self._unknowns(**refined)
        self.took["ADAPT"] = [Measured(unknowns, level.declared, {
            **self.levels.spent[tuple(refined.items())], "solve": level.seconds})]
        first = max(self._within(level.values[self.name], None, own), self._unseen(level))
        degree = element_kinds.DEGREE[self.manifest.element]
        settings = {self.knob.upper(): f"{float(own.sizes[-1]):g}", **own.words}
        return Adaptive("ADAPT", settings, [own.errors[-1], first],
                        [self._unknowns(**start), unknowns], ADAPTIVE[degree])

    def _refine(self, start: dict, begun: tuple | None):
        """The run on the mesh whose export has `begun`, and what names the mesh."""
        if begun is None:
            return None, {}
        key = (("refined", start.get(self.knob, self.manifest.parameters[self.knob])),)
        self.levels.problems[key] = self.levels.exported(*begun, key)
        level = self.companions.level(dict(key), self.stride, quiet=True)
        return level, dict(key)

    def _begun(self, start: dict) -> tuple | None:
        """What `exported` takes for the mesh that is refined once from that of `start`, None where
        there is none. Its export begins, on another core.
        """
        coarse = self.companions.level(start, self.stride)
        try:
            return coarse and self._begin(start, coarse)
        except DriverError:
            return None

    def _begin(self, start: dict, coarse) -> tuple:
        """The same from the run `coarse` on the mesh of `start`. Raises DriverError."""
        problem, levels = self.levels.problem(**start), self.levels
        contact = ContactState(problem.operator, coarse.solver)
        kind = refinement.coarse(dataclasses.asdict(self.companions.settings))["estimator"]
        estimator = EnergyEstimator(problem.operator, problem.manifest, contact, kind)
        for step in coarse.steps:
            problem.operator.follow(step)
            fields = problem.operator.deformations(step.multipliers, step.weights)
            estimator.consider(step, contact.evaluate(step, fields), 1.0)
        estimates = [estimate for _, estimate in estimator.estimates()]
        place = levels.folder / "refined"
        stem = place / refinement.STEM
        with agreed_writes(levels.comm):
            if levels.comm.rank == 0:
                place.mkdir(parents=True)
                adaptivity.next_mesh(stem, estimator, estimates)
        levels.export_ahead((place / "export", start, stem))
        return place / "export", start, stem

    def _of_cycles(self) -> list[Adaptive]:
        """Cycles beyond those of a run that was refined itself."""
        errors = self._errors()[::-1]
        unknowns = [self._unknowns(cycle=k) for k in range(len(self.levels.refined))]
        known = len(unknowns) + 1 - len(errors)
        size = self.manifest.parameters[self.knob]
        words = {} if self.manifest.element == "P1" else {"ELEMENT": self.manifest.element}
        return [Adaptive("ADAPT", {self.knob.upper(): f"{float(size):g}", **words},
                         [errors[0]] * known + errors, [*unknowns, self._unknowns()],
                         self.mesh.rate, Costs(self.run, [], [], []), self.mesh.floor)]

    # ---- the other parts -------------------------------------------------------------------------
    def quantity(self, value: float) -> Quantity:
        """The quantity and its errors that do not depend on the mesh."""
        steps, time = self.manifest.steps, self.parts.get("time")
        times = {steps: time.error if time else 0.0}
        if time and self.companions.effects.frictional:
            for stride in (2, 4):
                if (steps % stride or self.companions.manifest.cycle_start % stride
                        or self.companions.strides.up_to(stride) != stride
                        or self.companions.strides.misses(stride)):
                    continue
                values = [self._value(self.companions.base, each) for each in (stride, 1)]
                if None not in values:
                    times[steps // stride] = times[steps] + abs(values[0] - values[1])
        others = sum(self.parts[source].error for source in ("friction", "solver")
                     if source in self.parts)
        static, jumps = not self.companions.effects.quasistatic, None
        if "jumps" in self.parts:
            jumps = Jumps.of(self.parts["jumps"].error, self.companions.settings.cycles,
                             self.companions.jumps)
        return Quantity(self.name, value, steps, static, times, time.rate if time else 1.0, others,
                        jumps)


def of_other_elements(manifest) -> list[dict]:
    """Meshes of the other order of elements that a run gets companions on, finest first."""
    element, knob = OTHER.get(manifest.element), mesh_knob(manifest.parameters)
    if element is None:
        return []
    sizes, halvings = [manifest.parameters[knob]], HALVINGS[element]
    if element == "P1" and 2 * manifest.nodes > LARGE:
        halvings = OF_LARGE
    while len(sizes) <= max(halvings) and (size := coarser(knob, sizes[-1])):
        sizes.append(size)
    sizes = dict.fromkeys(sizes[min(k, len(sizes) - 1)] for k in halvings)
    return [{knob: size, "element": element} for size in sizes]


def foreseen(manifest) -> list[dict]:
    """Meshes of companions that a run with uniform elements most likely gets, in their order."""
    knob = mesh_knob(manifest.parameters)
    sizes = coarser_sizes(knob, manifest.parameters[knob])
    return [*({knob: size} for size in sizes), *of_other_elements(manifest)]


def price_list(companions, parts: dict, budget: dict, name: str, run: Measured, idle: float,
               spent=None) -> dict:
    """Entry `prices` for the quantity `name`, by default the first with a known error, if
    there is one that is not zero, of resultants that the loads give only where there is no other;
    collective.

    `parts` and `budget` by quantity; `run`: what the run took; `idle`: MiB before it; `spent()`:
    seconds of the estimates so far, by default predicted like all others.
    """
    values, errors = ({q: entry[key] for q, entry in budget.items()} for key in ("value", "total"))
    zero = vanishing(values, errors)
    if not name:
        known = [q for q in budget if errors[q] is not None and values[q] and q not in zero]
        given = by_balance(values, parts["mesh"]) if parts else set()
        other = [q for q in known if q not in given]
        wrong = [q for q in other if errors[q]]  # contact all along a boundary is exact
        name = next(iter(wrong or other or known or budget))
    head = {"quantity": name, "value": values[name], "error": errors[name], "lines": []}
    floor = parts["mesh"][name].floor if parts else 0.0
    if floor and values[name]:
        head["least"] = floor / abs(values[name])
    words = name.replace("_", " ")
    if errors[name] is None:
        return head | {"reason": f"the error of the {words} is not known"}
    if name in zero or not values[name]:
        exactly = not values[name] and not errors[name]
        return head | {"reason": f"the {words} is zero" + ("" if exactly else " but for its error")}
    try:
        found = _predicted(companions, parts, name, values[name], run, idle, spent)
    except DriverError as problem:  # of a companion; other errors are ours
        return head | {"reason": f"they could not be predicted: {problem}"}
    return head | {"lines": found}


def _predicted(companions, parts: dict, name: str, value: float, run: Measured, idle: float,
               spent) -> list[dict]:
    """The lines of `price_list`."""
    alternatives = Alternatives(companions, parts, name, run)
    kinds, quantity = alternatives.kinds(), alternatives.quantity(value)
    costs = kinds[0].costs
    estimates = spent() if spent else costs.companions(run.unknowns, run.steps)
    comm = companions.levels.comm
    whole = Whole(run, estimates, costs, comm.allreduce(memory_used()), idle)
    return comm.bcast(prices.lines(kinds, quantity, whole))
