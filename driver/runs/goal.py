"""ACCURACY=1%[,quantity]: choose mesh, steps and tolerances for the error that is asked for.

The search starts from a mesh eight times coarser than the scene's own and refines. Runs of
successive meshes are each other's companions (budget.py): nothing is run for the estimate alone but
cheap things on the second mesh,

steps       5, 10, 20, ... until the part of the time step is below TIME of what is allowed; their
            times are from one finely sampled history; one where the end does not depend on the way
tolerances  RTOL, FRICTION_RTOL start far above what single runs use and are tightened until a
            hundredth of them would change the quantity by less than ALGEBRAIC of what is allowed,
            so that nothing is solved beyond the discretization error; with many steps, whose
            errors add up, they are smaller in proportion

Both are checked again on the last mesh but one, tolerances tightened if what they leave, scaled to
the last mesh, does not fit beside the other parts.

Then meshes follow, each sized by the observed order so that its estimate uses up ROOM of what is
left, until all parts together are within the request. At least three meshes are compared, as two
coarse ones may agree by accident; up to SMALL nodes, and of a quantity that is not SMOOTH, elements
are halved at least, as sizes that are nearly alike tell little. For a SMOOTH one they are quadratic
from the first mesh on, unless ELEMENT is given or the scene refuses them: coarse meshes take the
time of linear ones, and fewer are needed. It is meant to be met in at least 95 of 100 cases.
"""

import contextlib
import dataclasses
import math
from itertools import product

from ..effects import Effects
from ..effects.quasistatic import proportional
from ..errors import DriverError, InputError, NoSolution, NotConverged
from ..estimates.budget import (FORMAL, SINGULAR, SOURCES, Part, extrapolate, finer, formal_order,
                                main_quantity, mesh_knob, name_of, ratio, share, summed, vanishing)
from ..estimates.caution import FAST
from ..estimates.companions import LEFT
from ..estimates.successive import mesh_parts
from .tolerances import TIGHTER, TOLERANCES, left, much_tighter, scaled, tightened

COARSENING = (8, 4, 2, 1)  # of the scene's own mesh, for the first one that can be had
SAMPLING = 32  # times of the load history per step of the scene
FEWEST = 4  # a fourth of the scene's own steps is where their choice starts
TIME, ALGEBRAIC, ROOM = 0.35, 0.05, 0.85
LAST = 0.7  # of what is allowed may be the time step's part where there are no more steps to take
LARGEST = 300_000  # nodes; twice as many unknowns
SMALL = 1_500  # nodes up to which a run costs no more than the start of programs
# that quadratic elements approach faster: others hang on places between nodes
SMOOTH = ("normal_resultant", "tangential_resultant", "displacement", "peak_pressure")
QUADRATIC = {"element": "P2"}
RETRIES = (1.0, 0.1, 0.01)  # factors of the tolerances of a run that failed


class Search:
    """Looks for the settings that meet a request. Collective."""

    def __init__(self, levels, settings, asked: float, quantity: str, say=lambda line: None):
        """`levels`: the scene's; `settings` not chosen here; `say` takes lines for the user."""
        self.levels, self.asked, self.say = levels, asked, say
        self.settings = dataclasses.replace(settings, rtol=0.01 * asked, friction_rtol=0.1 * asked,
                                            primal_rtol=0.03 * asked)
        self.reference = tightened(self.settings, TIGHTER)
        self.element = {}  # that of the meshes, where it is not the scene's
        smooth = not quantity or quantity in SMOOTH  # as the main quantities are
        self._begin(smooth and "element" not in levels.parameters)
        self.effects, self.total = Effects(self.first), self.first.steps
        self.stride = self._longest_stride() if self.effects.quasistatic else 1
        self.name = quantity
        self.parts: dict = {}  # by source: {quantity: Part}
        self.timed = None  # size of the mesh that the time step's part is from

    def _begin(self, quadratic: bool) -> None:
        """Have the coarsest mesh made; `quadratic` as of `_first`."""
        self.coarsening, self.first = self._first(quadratic)
        self.knob = mesh_knob(self.first.parameters)
        if self.knob is None:
            raise InputError("no parameter (CELLS, H) sets the mesh size of this scene: "
                             "ACCURACY has nothing to choose")
        self.sizes = [self.first.parameters[self.knob]]

    def _first(self, quadratic: bool) -> tuple:
        """Part of the scene's own mesh that the coarsest has, and its manifest.

        `quadratic`: the elements shall be, if the scene admits it.
        """
        for factor, element in product(COARSENING, [QUADRATIC, {}] if quadratic else [{}]):
            changes = {"coarsening": factor, **element}
            try:
                problem = self.levels.problem(**changes)
            except DriverError:
                if factor == COARSENING[-1] and not element:
                    raise
                continue
            self.element, parameters = element, problem.manifest.parameters
            knob = mesh_knob(parameters)
            if knob:  # the same mesh under its own name
                changes = {knob: parameters[knob], **element}
                self.levels.problems[tuple(sorted(changes.items()))] = problem
            return factor, problem.manifest

    def _longest_stride(self) -> int:
        """With which the choice of steps starts: a power of two that ends where histories turn."""
        return math.gcd(SAMPLING * FEWEST, self.total, self.first.cycle_start)

    # ---- runs ------------------------------------------------------------------------------------
    def mesh(self, size) -> dict:
        """Parameters of the mesh of a size."""
        return {self.knob: size, **self.element}

    def _level(self, size, stride=None, settings=None):
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

    def _values(self, size, stride=None, settings=None) -> dict:
        return self._level(size, stride, settings).values

    @property
    def steps(self) -> int:
        """Time steps with the chosen stride."""
        return self.total // self.stride

    def _choose_steps(self, size, finest: int) -> None:
        """As few steps as keep their error below TIME of what is allowed, strides from `finest`."""
        fewest, self.timed = 2 * self.stride if "time" in self.parts else self.stride, size
        strides = [fewest, max(1, fewest // 2)]
        runs = [self._values(size, stride) for stride in strides]
        while not self._in_time(runs) and strides[-1] > finest:
            strides.append(strides[-1] // 2)
            runs.append(self._values(size, strides[-1]))
        self.stride, most = strides[-1], self.parts["time"]
        # fewer steps err by what they differ by and what the most err by
        for stride, run in zip(strides[:-1], runs):
            errors = {q: Part(abs(run[q] - runs[-1][q]) + most[q].error) for q in run}
            if errors[self.name].error <= TIME * self.asked * abs(run[self.name]):
                self.stride, self.parts["time"] = stride, errors
                return

    @property
    def _time_share(self) -> float:
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

    def _memoryless(self, size) -> bool:
        """Whether one step gives the quantity because the end does not depend on the way to it."""
        problem = self.levels.problem(**self.mesh(size))
        contact, effects = problem.structure.contact, self.effects
        if not self.effects.quasistatic or self._level(size).at < self.steps - 1:
            return False  # nothing to choose, or the quantity belongs to a moment before the end
        if contact.following is not None:
            return False  # the way there is found step by step
        return not effects.frictional or (
            "preload" not in effects
            and effects.homogeneous(contact, effects.initial_displacement(contact))
            and proportional(problem.manifest.factors))

    def _more_steps(self, size) -> None:
        """More steps, as the mesh of a size tells; raises NotConverged if there are no more."""
        if self.stride == 1:
            error, value = self.parts["time"][self.name].error, abs(self._values(size)[self.name])
            raise NotConverged(
                f"even {self.total} steps leave the {self._words()} an error of "
                f"{share(error, value)}: too much of {100 * self.asked:g} %, of which the mesh "
                f"needs a part; {share(error, LAST * value)} may do")
        before = self.stride
        self._choose_steps(size, 1)
        self.stride = min(self.stride, before // 2)

    def _renew_time(self, size) -> None:
        """The time step's part of the error on a finer mesh, against half the steps."""
        if "time" in self.parts and self.stride < self.total and size != self.timed:
            self.timed = size
            self._in_time([self._values(size, 2 * self.stride), self._values(size)])

    def _name(self, values: dict) -> str:
        """The quantity asked for; raises InputError if the scene has no such."""
        name = self.name or main_quantity(values)
        if name not in values:
            raise InputError(f"the scene has no quantity '{name}'; it has {', '.join(values)}")
        return name

    def _words(self) -> str:
        return self.name.replace("_", " ")

    def _tightest(self):
        """Settings much tighter than the chosen ones; those of before, as long as they are."""
        if not much_tighter(self.reference, self.settings):
            self.reference = tightened(self.settings, TIGHTER)
        return self.reference

    def _left(self, size) -> tuple[dict, dict]:
        """Parts of the error that tolerances leave on a mesh, and quantities there."""
        stride = max(self.stride, min(self.total, SAMPLING * FEWEST))
        return left(lambda settings: self._values(size, stride, settings), self.settings,
                    self._tightest(), self.effects.pressure_bounds_friction)

    def _negligible(self, allowed: float) -> bool:
        """Whether what tolerances leave fits into what is `allowed`, beside the other parts.

        The mesh before tells; on the last one it is more by the ratio of element sizes, see LEFT.
        """
        scale = LEFT * ratio(self.knob, *self.sizes[-2:])
        self.parts |= scaled(self._left(self.sizes[-2])[0], scale)
        return self.budget()[self.name]["total"] <= allowed

    def _tighten(self, size) -> bool:
        """Tolerances of a part of the error small enough on a mesh; whether they were changed."""
        before = self.settings
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

    # ---- meshes ----------------------------------------------------------------------------------
    def _assess(self) -> dict:
        """Budget of the quantity on the finest mesh."""
        sizes = self.sizes[:-4:-1]
        levels = [self._level(size) for size in sizes]
        ratios = [ratio(self.knob, b, a) for a, b in zip(sizes, sizes[1:])]
        problem = self.levels.problem(**self.mesh(sizes[0]))
        self.parts["mesh"] = mesh_parts(problem, levels, ratios, self.name,
                                        self.settings.estimator)
        return self.budget()[self.name]

    def budget(self) -> dict:
        """Budget of every quantity on the finest mesh."""
        values = self._values(self.sizes[-1])
        order = [source for source in SOURCES if source in self.parts]
        return {q: summed({source: self.parts[source][q] for source in order}, value)
                for q, value in values.items()}

    def _skip_unsolved(self) -> None:
        """Refine the first mesh until the scene can be solved on it, up to its own mesh.

        Where quadratic elements are solved on none of them linear ones are tried.
        """
        while True:
            try:
                self._level(self.sizes[0])
                return
            except DriverError:
                if self.coarsening > 1:
                    self.coarsening /= 2
                    self.sizes[0] = self._halved
                elif self.element:
                    self._begin(quadratic=False)
                else:
                    raise

    def _next(self, entry: dict) -> float:
        """The next mesh size: its estimate is to use up ROOM of what other parts leave."""
        others = sum(entry[s] for s in ("time", "friction", "solver") if s in entry)
        factor = 2.0
        if entry["mesh"] is not None:
            value = abs(entry["value"])
            room = ROOM * max(self.asked * value - others, 0.1 * self.asked * value)
            formal = FORMAL["mesh"][self.first.element]
            order = min(max(entry.get("mesh_order", 1.0), 0.7), formal)
            most = 2.0 if len(self.sizes) < 3 else 4.0
            factor = min(max((entry["mesh"] / room) ** (1 / order), 1.25), most)
        if self.name not in SMOOTH or self._nodes(self._halved) <= SMALL:
            factor = max(factor, 2.0)
        return finer(self.knob, self.sizes[-1], factor)

    @property
    def _halved(self) -> float:
        """The size after the last one with elements half as long."""
        return finer(self.knob, self.sizes[-1], 2.0)

    def _third(self) -> None:
        """Run a third mesh, sized by what two differ by: their error would not be enough."""
        coarse, fine = (self._values(size)[self.name] for size in self.sizes)
        if fine == 0:
            return  # it is refused
        between, order = ratio(self.knob, *self.sizes), 1.0 if self.first.element == "P1" else FAST
        part = extrapolate([fine - coarse], [between], order, fine, pair=order)
        size = self._next({"value": fine, "mesh": part.error})
        if self._nodes(size) <= LARGEST:
            with contextlib.suppress(DriverError):  # the search says why, if it comes to it
                self._level(size)
                self.sizes.append(size)

    def run(self):
        """Search, leaving the finest run. Raises InputError, NoSolution or NotConverged."""
        self._skip_unsolved()
        self.sizes.append(self._halved)
        self.name = self._name(self._values(self.sizes[-1]))
        if self._memoryless(self.sizes[-1]):
            self.stride = self.total
            if self.effects.frictional:  # all that depends on the way grows in proportion
                none = dict.fromkeys(self._values(self.sizes[-1]), Part(0.0))
                self.parts["time"] = none
        self._tighten(self.sizes[-1])
        if self.stride < self.total:
            self._choose_steps(self.sizes[-1], SAMPLING)
        self._third()
        unsettled = 0
        while True:
            entry = self._assess()
            self.say(f"{name_of(self.knob, self.sizes[-1])} STEPS={self.steps}: "
                     f"{self._words()} {entry['value']:.4g}, estimated error "
                     f"{share(entry['total'], entry['value'])} "
                     f"(mesh {share(entry['mesh'], entry['value'])})")
            self._refuse_zero()
            allowed = self.asked * abs(entry["value"])
            met = len(self.sizes) > 2 and entry["total"] is not None and entry["total"] <= allowed
            if met and (self._negligible(allowed) or not self._tighten(self.sizes[-2])):
                self._renew_time(self.sizes[-2])
                entry = self.budget()[self.name]
                met = entry["total"] <= allowed
                if met:
                    return
            spent = entry.get("time", 0.0)
            if (len(self.sizes) > 2 and spent > self._time_share * allowed
                and entry["mesh"] is not None and (entry["mesh"] <= allowed or spent > allowed)):
                self._more_steps(self.sizes[-2])
                continue
            if met:  # tolerances were tightened
                continue
            grows = self.parts["mesh"][self.name].note == SINGULAR
            unsettled = unsettled + 1 if grows else 0
            if unsettled > 1:
                raise NoSolution(f"the {self._words()} cannot be had to {100 * self.asked:g} %: "
                                 "it grows from mesh to mesh, as at a singular point; "
                                 "ask for another quantity")
            size = self._next(entry)
            self._make(size, share(entry["total"], entry["value"]))
            self.sizes.append(size)

    def _refuse_zero(self) -> None:
        """Raise NoSolution where the quantity is zero: it has no relative error to be met."""
        budget = self.budget()
        values, errors = ({name: entry[key] for name, entry in budget.items()}
                          for key in ("value", "total"))
        if self.name in vanishing(values, errors):
            error = f" but for its error of {errors[self.name]:.1g}" if errors[self.name] else ""
            raise NoSolution(f"the {self._words()} is zero{error} (by symmetry, or as nothing "
                             "slides): it has no relative error to be met; ask for another "
                             "quantity")

    def _nodes(self, size) -> float:
        """Of the mesh of a size, by those of the last one."""
        nodes = self.levels.problem(**self.mesh(self.sizes[-1])).manifest.nodes
        return nodes * ratio(self.knob, self.sizes[-1], size) ** 2

    def _make(self, size, reached: str) -> None:
        """Have the problem of a finer mesh made. Raises NotConverged if it cannot be."""
        demand = (f"{100 * self.asked:g} % of the {self._words()} would take "
                  f"{name_of(self.knob, size)}")
        nodes = self._nodes(size)
        if nodes > LARGEST:
            raise NotConverged(f"{demand}, {nodes:.0f} nodes; reached: {reached}")
        try:
            self.levels.problem(**self.mesh(size))
        except InputError as problem:
            reason = f"{demand}, which cannot be made ({problem}); reached: {reached}"
            raise NotConverged(reason) from None

    def chosen(self) -> dict[str, str]:
        """The settings as options of the command line."""
        chosen = {self.knob.upper(): f"{self.sizes[-1]:g}"}
        if self.element:
            chosen["ELEMENT"] = self.element["element"]
        if self.effects.quasistatic:
            chosen["STEPS"] = str(self.steps)
        settings = self.scaled(self.settings, self.stride)
        return chosen | {name.upper(): f"{getattr(settings, name):.1g}" for name in TOLERANCES
                         if self.effects.frictional or name != "friction_rtol"}
