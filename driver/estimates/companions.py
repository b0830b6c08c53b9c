"""Runs beside a run, on coarser meshes, in other steps, with tighter tolerances, and the parts of
its error that follow from them (budget.py).
"""

import dataclasses

from ..errors import DriverError
from ..march.problem import Problem
from ..march.step import Step
from ..options import Settings
from ..results.record import Record
from . import caution, jumps, unresolved
from .between_steps import Strides, finer, more_steps, of_earlier_moment
from .budget import (OF_TIME, Part, coarser_sizes, extrapolate, falls, formal_order, located,
                     main_quantity, mesh_knob, name_of, of_one_step, ratio, summed, vanishing)
from .budget_words import advice
from .free_peak import Peaks
from .levels import Level, Levels, samples
from .mesh_part import MeshPart

# a loose fixed point may stop where a much tighter one does: the companion's is this at most
SETTLED = 1e-7
FEW = 4  # steps below which coarser times tell nothing
MANY = 20  # steps of which the first one matters little, where coarser times share it
MOSTLY = 0.5  # of the largest slip
FINER = 4  # times as many steps then, also where steps miss what a history does
ENOUGH = 64  # steps of a companion up to which there may be more, so that it misses nothing
OF_MESHES, OF_STEPS, OF_JUMPS = "coarser meshes", "time steps", "jumps over cycles"
OF_TOLERANCES, OF_PRICES = "tolerances", "price of the next digit"
UNTRIED = "no run with more steps to compare with"
UNLOOKED = ("the time step's part was not computed: it needs runs with more steps, and without a "
            "known mesh part there would be no total")
STIFFLY = 0.25  # of the displacement, by which one more mesh makes it larger
MOVED = 0.02  # of the displacement, by which it may change where supports prescribe it
TIGHTER = 100.0  # tolerances of the companions that tell what those of the run leave
LEFT = 2.0  # safety of what they tell: another mesh answers by chance with more or less
SKIPPING = {2: "in every second step", 4: "in every fourth step"}
EARNED = 1e-8  # residuals that rounding still lets a companion reach


class Companions:
    """Runs beside one run, and what each part of its error follows from."""

    def __init__(self, levels: Levels, problem: Problem, settings: Settings, record: Record,
                 adjoints: tuple[dict, dict], energy: dict | None = None,
                 step: Step | None = None):
        """`record` of the run of `problem` with `settings`, `adjoints` as of adjoint.assess,
        `energy` the entry of energy.report. `step`: that of the quantities.
        """
        self.record = record
        self.values, self.at = record.quantities()
        self.operator, self.step = problem.operator, step
        self.of_mesh = MeshPart(problem, record, adjoints, energy, bool(levels.refined))
        self.levels, self.manifest, self.settings = levels, problem.manifest, settings
        self.effects = problem.effects
        self.strides = Strides(self.effects, self.manifest,
                               self.operator.structure.contact.motion_of_all_times)
        self.arrivals = record.arrivals() if "slip" in self.values else 0.0
        self.on_arrival = record.slid_on_arrival() if "slip" in self.values else 0.0
        self.open_work = record.open_work()
        rows = record.cycles.past.rows if levels.plan else ()
        self.summed = {"dissipated_energy": record.cycle_work,
                       "slip": [row["slip"] for row in rows]} if rows else {}
        # cycles skipped after each computed one, where any were
        self.jumps = levels.plan if any(levels.plan or ()) else None
        levels.problems[()] = problem
        self.knob = mesh_knob(self.manifest.parameters)
        self.notes = []
        self.meshes, self.ratios = self._adapted() if levels.refined else self._uniform()
        self.base = self.meshes[1 if len(self.meshes) > 1 else 0]  # companions for other parts

    def _uniform(self) -> tuple[list[dict], list[float]]:
        """Meshes with elements twice and four times as long, as far as there are such."""
        sizes = [self.manifest.parameters[self.knob]]
        for size in coarser_sizes(self.knob, sizes[0]):
            if not self._meshed(size) or not self._coarser(size, sizes[-1]):
                break
            sizes.append(size)
        if len(sizes) == 1:
            finest = name_of(self.knob, sizes[0])
            self.notes.append(f"no coarser mesh than {finest} to compare with")
        ratios = [ratio(self.knob, b, a) for a, b in zip(sizes, sizes[1:])]
        return [{}, *({self.knob: size} for size in sizes[1:])], ratios

    def _adapted(self) -> tuple[list[dict], list[float]]:
        """Meshes of the last two cycles but one; a cycle lessens errors like a halved size.

        It does so where a uniform mesh does not: the number of its elements would say too little.
        """
        meshes = [{}, *({"cycle": k} for k in reversed(range(len(self.levels.refined))))][:3]
        return meshes, [2.0] * (len(meshes) - 1)

    def _meshed(self, size: float) -> bool:
        """Whether the scene can be had at a mesh size; if not, a note says why."""
        try:
            self.levels.problem(**{self.knob: size})
        except DriverError as problem:
            self.notes.append(f"companion {name_of(self.knob, size)}: {problem}")
            return False
        return True

    def _coarser(self, size: float, than: float) -> bool:
        """Whether the mesh of a size is coarser than that of another; if not, a note says so.

        Scenes may limit sizes, or numbers of edges: equal meshes agree, and tell no error.
        """
        mesh = {} if than == self.manifest.parameters[self.knob] else {self.knob: than}
        if self.levels.refines(mesh, {self.knob: size}):
            return True
        self.notes.append(f"companion {name_of(self.knob, size)} has no fewer triangles, or no "
                          f"fewer sides in contact, than {name_of(self.knob, than)}")
        return False

    def level(self, mesh: dict, stride: int = 1, settings: Settings | None = None,
              quiet: bool = False, plan=None) -> Level | None:
        """A run on a mesh, None and, unless `quiet`, a note if it fails."""
        try:
            return self.levels.run(settings or self.settings, stride, plan, **mesh)
        except DriverError as problem:
            if not quiet:
                tighter = settings is not None and settings != self.settings
                self.notes.append(f"{_called(mesh, stride, tighter)}: {problem}")
            return None

    def _values(self, mesh: dict, stride: int = 1, settings: Settings | None = None) -> dict | None:
        """Quantities of a run on a mesh, None and a note if it fails."""
        if not mesh and stride == 1 and settings is None:  # the run itself
            return self.values
        level = self.level(mesh, stride, settings)
        return level and level.values

    def remedies(self) -> dict[str, str]:
        """For every part the setting that lowers it, as on the command line."""
        if self.levels.refined:
            mesh = f"ADAPT={len(self.levels.refined) + 1}"
        else:
            size = self.manifest.parameters[self.knob]
            mesh = name_of(self.knob, 2 * size if self.knob == "cells" else size / 2)
        steps = more_steps(self.manifest) or 2 * self.manifest.steps
        return {"mesh": mesh,
                "time": f"STEPS={steps}" if self.effects.quasistatic else "quasistatic(1.)",
                **({"jumps": jumps.remedy(self.settings.cycles, self.jumps)} if self.jumps else {}),
                "friction": f"FRICTION_RTOL={self.settings.friction_rtol / 10:.0e}",
                "solver": f"RTOL={self.settings.rtol / 10:.0e}"}

    def doubtful(self, parts: dict[str, dict[str, Part]]) -> set[str]:
        """Sources of which no run tells that their `remedies` lower the main error."""
        name = main_quantity(self.values, vanishing(self.values))
        jump = {"time"} if more_steps(self.manifest) is None else set()
        return jump | {source for source, part in parts.items() if not falls(part[name])}

    def parts(self) -> dict[str, dict[str, Part]]:
        """Part by source and quantity."""
        effects, settings = self.effects, self.settings
        tight = {"rtol": settings.rtol / TIGHTER}
        earned = {"primal_rtol": min(settings.primal_rtol,
                                     max(settings.primal_rtol / TIGHTER, EARNED))}
        timed = effects.quasistatic and (
            effects.frictional or self.at < self.manifest.steps - 1)
        stages = [OF_MESHES, *([OF_STEPS] if timed else []), *([OF_JUMPS] if self.jumps else []),
                  OF_TOLERANCES, OF_PRICES]
        self.levels.watch.stage(OF_MESHES, stages)
        parts = {"mesh": self._mesh()}
        self.notes += self._stiff()
        self.given = self.of_mesh.given(parts["mesh"])
        if timed:
            self.levels.watch.stage(OF_STEPS, stages)
            alone = not effects.frictional and self.strides.motion is None
            parts["time"] = {} if alone else self._time(_known(parts["mesh"]))
            parts["time"] |= self._of_instant(parts["time"])
            if "slip" in self.values:
                parts["time"]["slip"] = located(parts["time"]["slip"], OF_TIME * self.arrivals)
        elif self.open_work and not effects.quasistatic:
            parts["time"] = of_one_step(self.values, self.open_work)
        if self.jumps:
            self.levels.watch.stage(OF_JUMPS, stages)
            parts["jumps"] = self._jumps()
        self.levels.watch.stage(OF_TOLERANCES, stages)
        found = self._of_tolerances(tight, earned)
        self.levels.watch.stage(OF_PRICES, stages)
        return parts | found

    def _of_tolerances(self, tight: dict, earned: dict) -> dict[str, dict[str, Part]]:
        """Parts of what the run's tolerances leave, by companions with `tight`er ones."""
        effects, settings = self.effects, self.settings
        if effects.pressure_bounds_friction:
            settled = min(settings.friction_rtol / TIGHTER, SETTLED)
            return {"friction": self._algebraic(tight, earned | {"friction_rtol": settled}),
                    "solver": self._algebraic({}, tight)}
        return {"solver": self._algebraic({}, tight | earned)}

    def _mesh(self) -> dict[str, Part]:
        """Coarser meshes, the coarsest against the middle one, at fewer times; held within what
        adjoint problems leave.
        """
        runs = [(self.values, self._values(self.meshes[1]))] if len(self.meshes) > 1 else []
        stride = self.strides.of_coarse_meshes
        if len(self.meshes) > 2:
            runs.append([self._values(mesh, stride) for mesh in self.meshes[1:]])
        solved = _whole(runs)
        good = unresolved.alike(solved)
        if len(good) < len(solved):
            other = " ".join(name_of(*pair) for pair in self.meshes[len(good) + 1].items())
            self.notes.append(f"companion {other}: forces or displacements are at least twice "
                              "those of the finer mesh: so coarse a mesh represents another "
                              "problem")
        touches = [self.level(mesh, each).touch
                   for mesh, each, _ in zip(self.meshes[1:], (1, stride), good)]
        problems = [self.levels.problem(**mesh) for mesh in self.meshes[:len(good) + 1]]
        peaks = self._peaks(len(good), stride) if good and self.step else []
        return self.of_mesh.by(good, self.ratios, problems, touches, peaks)

    def _peaks(self, pairs: int, stride: int) -> list[tuple[Peaks, Peaks]]:
        """Of the first `pairs` of finer and coarser meshes, finest first."""
        def of(k: int, stride: int) -> Peaks:
            return Peaks.of_level(self.level(self.meshes[k], stride))

        own = Peaks.of(self.operator, self.step, self.values["displacement"])
        first = of(1, 1)
        return [(own, first), *((of(1, stride), of(2, stride)) for _ in range(pairs - 1))]

    def _stiff(self) -> list[str]:
        """A note where linear triangles are, by far, too stiff: a finer mesh moves by much more, or
        where it moves as supports have it much less force does that.
        """
        coarse = self._values(self.meshes[1]) if len(self.meshes) > 1 else None
        if self.manifest.element != "P1" or coarse is None:
            return []
        way = self.values["displacement"]
        change = way - coarse["displacement"]
        force = abs(self.values.get("normal_resultant", 0.0))
        less = abs(coarse.get("normal_resultant", 0.0)) - force
        if change > STIFFLY * abs(way):
            said = f"displacement grew by {100 * change / way:.0f} %"
            still = "grow further"
        elif less > STIFFLY * force > 0 and abs(change) <= MOVED * abs(way):
            said = f"normal resultant fell by {100 * less / force:.0f} %"
            still = "fall further"
        else:
            return []
        return [f"linear triangles may be too stiff, as in bending: the {said} from the next "
                f"coarser mesh, and may {still}; ELEMENT=P2"]

    def _time(self, wanted: bool = True) -> dict[str, Part]:
        """Every second and fourth time; without friction only the instant counts.

        Where there are few steps, or so few would miss what the history does, twice and four times
        as many. So it is where these times would leave the first step of few as it is: what
        friction does in it would be right in all of them; and where most of the largest slip was
        made in steps in which nodes touched first, which fewer steps join with more of the air
        before, where a way may lead elsewhere. These are not run if they are not `wanted`.
        """
        steps = self.manifest.steps
        coarser_by = [by for by in (2, 4) if steps >= MANY or not steps % by]
        if self.effects.frictional and (steps < FEW or not coarser_by
                                        or self.strides.misses(FEW)
                                        or steps < MANY and self.on_arrival > MOSTLY):
            if wanted:
                return self._more_time()
            self.notes.append(UNLOOKED)
            return dict.fromkeys(self.values, Part(None))
        strides = [1, *coarser_by] if self.effects.frictional else [1, 2]
        strides = [stride for stride in strides if stride <= steps]
        mesh = self._telling()
        values = [self._values(mesh, stride) for stride in strides]
        counts = [len(samples(self.manifest, stride)) - 1 for stride in strides]
        ratios = [a / b for a, b in zip(counts, counts[1:])]
        return self._parts("time", list(zip(values, values[1:])), ratios)

    def _of_instant(self, found: dict[str, Part]) -> dict[str, Part]:
        """The parts `found` of steps, no less than what is open of a moment before the end."""
        least = dict.fromkeys(self.values, 0.0)
        left = of_earlier_moment(self.manifest, self.record, self.at, self.strides.motion)
        least |= {name: OF_TIME * size for name, size in left.items() if name in least}
        return {name: located(found.get(name, Part(0.0)), least[name]) for name in least}

    def _telling(self) -> dict:
        """The mesh on which steps are compared: the run's own where so few nodes touch on the next
        one that they tell nothing of contact.
        """
        level = self.level(self.base, quiet=True) if self.base else None
        few = level is not None and 0 < level.touch.nodes < caution.fewest(self.manifest.element)
        return {} if few else self.base

    def _more_time(self) -> dict[str, Part]:
        """From runs with more steps: their distance, that of another mesh mostly, and what the
        finest errs by itself, at least what the distance tells at the formal order: the finest ones
        may agree by chance.
        """
        parts = finer(self.manifest, self.strides.motion, FINER, ENOUGH)
        mesh = self._telling()
        try:
            self.levels.problem(**mesh, sampling=parts)
        except DriverError as problem:
            self.notes.append(f"companion with {parts * self.manifest.steps} steps: {problem}")
            return dict.fromkeys(self.values, Part(None, note=UNTRIED))
        # every `parts`-th of the finest steps are the run's own, in which the mesh was run before
        values = [self._values(mesh) if stride == parts
                  else self._values({**mesh, "sampling": parts}, stride) for stride in (1, 2, 4)]
        own = values[2] if parts == FINER else self._values(mesh)
        if None in (*values, own):
            return dict.fromkeys(self.values, Part(None, note=UNTRIED))
        found = self._parts("time", list(zip(values, values[1:])), [2.0, 2.0])
        away = {name: OF_TIME * abs(own[name] - values[0][name]) for name in found}
        left = {name: size / (parts ** self._order("time", name) - 1)
                for name, size in away.items()}
        return {name: Part(away[name] + max(part.error, left[name]), part.order, rate=part.rate)
                for name, part in found.items()}

    def _jumps(self) -> dict[str, Part]:
        """Jumps over cycles that are half as long."""
        shorter = self.level(self.base, plan=jumps.halved(self.jumps))
        parts = self._parts("jumps", [(self._values(self.base), shorter and shorter.values)], [2.0])
        for name, values in self.summed.items():
            if name in parts:
                parts[name] = located(parts[name], jumps.carried_on(values, self.jumps))
        return parts

    def _algebraic(self, first: dict, then: dict) -> dict[str, Part]:
        """What settings `then` change in a run with those of `first`.

        On the coarser mesh and in fewer steps they change less: what each step leaves adds up, and
        contact forces answer to a residual like the condition of their problem, one over the size
        of elements. Resultants that the loads give by balance do neither. Fewer steps may have no
        solution where those of the run have one, as where they miss the load that clamps a body:
        then it is these.
        """
        loose, said = dataclasses.replace(self.settings, **first), len(self.notes)
        for stride in dict.fromkeys((self.strides.up_to(4), 1)):
            del self.notes[said:]
            before, after = (self._settled(stride, settings)
                             for settings in (loose, dataclasses.replace(loose, **then)))
            if before is not None and after is not None:
                break
        else:
            unknown = Part(None, note="the companion with tighter tolerances failed")
            return dict.fromkeys(self.values, unknown)
        scale = stride * (self.ratios[0] if self.base else 1.0)
        return {name: Part(LEFT * (1.0 if name in self.given else scale)
                           * abs(before[name] - after[name])) for name in self.values}

    def _settled(self, stride: int, settings: Settings) -> dict | None:
        """As `_values` on the base mesh, where rounding allows it with the residuals asked for."""
        try:
            return self.levels.run(settings, stride, **self.base).values
        except DriverError:
            as_run = dataclasses.replace(settings, primal_rtol=self.settings.primal_rtol)
            return self._values(self.base, stride, as_run)

    def _parts(self, source: str, runs: list, ratios: list[float]) -> dict[str, Part]:
        """Parts of steps from pairs of finer and coarser runs, finest first."""
        good = _whole(runs)
        return {name: extrapolate([fine[name] - coarse[name] for fine, coarse in good], ratios,
                                  self._order(source, name), value, True, safety=OF_TIME)
                for name, value in self.values.items()}

    def _order(self, source: str, name: str) -> float:
        """Formal order of a quantity's part."""
        return formal_order(source, self.manifest.element, name)


def _called(mesh: dict, stride: int, tighter: bool) -> str:
    """What a note calls a companion on a `mesh`, in every `stride`-th step of the run."""
    steps = [SKIPPING[stride]] if stride in SKIPPING else []
    tolerances = ["with tighter tolerances"] if tighter else []
    return " ".join(["companion", *(name_of(*change) for change in mesh.items()), *steps,
                     *tolerances])


def _known(parts: dict[str, Part]) -> bool:
    """Whether any of the `parts` has an error."""
    return any(part.error is not None for part in parts.values())


def _whole(runs: list) -> list:
    """Pairs of runs up to the first that failed."""
    return runs[: next((k for k, pair in enumerate(runs) if None in pair), len(runs))]


def assess(entry: dict, companions: Companions) -> dict[str, dict[str, Part]]:
    """Fill the `entry` for summary.json with the error budget of a run; parts by source.

    quantities, advice, notes: errors are absolute, `relative` is the total relative to the value;
    None where a part is not known. Collective.
    """
    parts = companions.parts()
    budget = {name: summed({source: part[name] for source, part in parts.items()}, value)
              for name, value in companions.values.items()}
    said = advice(budget, companions.remedies(), companions.doubtful(parts))
    entry |= {"quantities": budget, "advice": said, "notes": list(dict.fromkeys(companions.notes))}
    return parts
