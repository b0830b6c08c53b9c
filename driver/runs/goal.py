"""ACCURACY=1%[,quantity]: choose mesh, steps and tolerances for the error that is asked for.

The search starts from a mesh eight times coarser than the scene's own and refines. Runs of
successive meshes are each other's companions (estimates/budget.py): nothing is run for the
estimate alone but cheap things on the second mesh, which tell how many time steps and what
tolerances the request takes (trials.py).

Then meshes follow, each sized by the observed order so that its estimate uses up ROOM of what is
left, until all parts together are within the request. At least three meshes are compared, as two
coarse ones may agree by accident, but where an adjoint problem holds the quantity and two leave
CLEAR of what is allowed at most; up to SMALL nodes, and of a quantity that is not SMOOTH, elements
are halved at least, as sizes that are nearly alike tell little. For a SMOOTH one they are quadratic
from the first mesh on, unless ELEMENT is given or the scene refuses them: coarse meshes take the
time of linear ones, and fewer are needed. It is meant to be met in at least 95 of 100 cases.
"""

import contextlib
from itertools import product

from ..errors import DriverError, InputError, NoSolution, NotConverged
from ..estimates.adjoint import unsuited
from ..estimates.budget import (DOUBTFUL, FORMAL, SINGULAR, Part, extrapolate, finer,
                                main_quantity, mesh_knob, name_of, observed_order, of_one_step,
                                ratio, vanishing)
from ..estimates.budget_words import share
from ..estimates.caution import FAST
from ..estimates.free_peak import ROUNDING, UNSEEN
from ..estimates.successive import mesh_parts
from ..estimates.unresolved import at_corners
from ..quantity_table import HELD
from ..validity import starts_inside
from .tolerances import TOLERANCES
from .trials import SAMPLING, Trials

COARSENING = (8, 4, 2, 1)  # of the scene's own mesh, for the first one that can be had
FIXED = 1 / 8  # of it, down to which no size has another mesh: it does not depend on the size
ROOM = 0.85
CLEAR = 0.25  # of what is allowed may be estimated from two meshes
LARGEST = 300_000  # nodes; twice as many unknowns
SMALL = 1_500  # nodes up to which a run costs no more than the start of programs
# that quadratic elements approach faster: others hang on places between nodes
SMOOTH = (*HELD, "peak_pressure")
PRESSED = ("normal_resultant", "peak_pressure")  # none of which is there where nothing touches
DEPEND = ("peak_pressure", "contact_length")  # on the mesh, also where the loads give the force
HALVED = 1.9  # ratio of sizes from which on elements are half as long, numbers of cells rounded
GIVEN = 0.1  # of the request is the error of a force that hardly depends on the mesh
QUADRATIC = {"element": "P2"}


class Search(Trials):
    """Looks for the settings that meet a request. Collective."""

    def __init__(self, levels, settings, asked: float, quantity: str, say=lambda line: None):
        """`levels`: the scene's; `settings` not chosen here; `say` takes lines for the user."""
        super().__init__(levels, settings, asked, quantity)
        self.say = say
        self.enough, self.unnamed = 3, not quantity  # meshes
        smooth = not quantity or quantity in SMOOTH  # as the main quantities are
        self._begin(smooth and "element" not in levels.parameters)
        coarsest = self.levels.problem(**self.mesh(self.sizes[0]))
        self.follow(coarsest)
        # histories are sampled more finely than any step is long
        samples = min(max(self.stride, SAMPLING), self.total)
        starts_inside.check(coarsest, samples * coarsest.manifest.t_end / self.total)

    def _begin(self, quadratic: bool) -> None:
        """Have the coarsest mesh made; `quadratic` as of `_first`."""
        self.coarsening, self.first, element = self._first(quadratic)
        knob = mesh_knob(self.first.parameters)
        self.begin(self.first.parameters[knob], knob, element)

    def _first(self, quadratic: bool) -> tuple:
        """Part of the scene's own mesh that the coarsest has, its manifest and its element.

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
            parameters = problem.manifest.parameters
            knob = mesh_knob(parameters)
            changes = {knob: parameters[knob], **element}  # the same mesh under its own name
            self.levels.problems[tuple(sorted(changes.items()))] = problem
            return factor, problem.manifest, element

    # ---- meshes ----------------------------------------------------------------------------------
    def _assess(self) -> dict:
        """Budget of the quantity on the finest mesh."""
        self.parts["mesh"] = mesh_parts(*self.compared())
        return self.budget()[self.name]

    def compared(self) -> tuple:
        """What mesh_parts compares: the finest meshes, for the quantity."""
        sizes = self.sizes[:-4:-1]
        levels = [self.level(size) for size in sizes]
        ratios = [ratio(self.knob, b, a) for a, b in zip(sizes, sizes[1:])]
        problems = [self.levels.problem(**self.mesh(size)) for size in sizes]
        return problems, levels, ratios, self.name, self.settings.estimator

    def _skip_unsolved(self) -> None:
        """Refine the first mesh until the scene can be solved on it, up to its own mesh.

        Where quadratic elements are solved on none of them linear ones are tried.
        """
        while True:
            try:
                self.level(self.sizes[0])
                return
            except DriverError:
                if self.coarsening > 1:
                    self.coarsening /= 2
                    self.sizes[0] = self._halved
                elif self.element:
                    self._begin(quadratic=False)
                else:
                    raise

    def _skip_equal(self) -> None:
        """Append the second size, and refine the first one until their meshes differ.

        Scenes may limit their sizes: equal meshes agree, and tell no error.
        """
        self.sizes.append(self._halved)
        while not self._refines(self.sizes[-1]):
            if self.coarsening <= FIXED:
                raise InputError(f"{self.knob.upper()} does not change this scene's mesh, or not "
                                 "its contact boundary: ACCURACY has nothing to choose")
            self.coarsening /= 2
            self.sizes = [self.sizes[-1], self._halved]

    def _refines(self, size) -> bool:
        """Whether a size has a finer mesh than the size before it, or than the last one."""
        before = self.sizes[-2] if size == self.sizes[-1] else self.sizes[-1]
        return self.levels.refines(self.mesh(size), self.mesh(before))

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

    def _held(self, size) -> bool:
        """Whether an adjoint problem holds the quantity on the mesh of a size."""
        level = self.level(size)
        return self.name in HELD and not unsuited(
            self.levels.problem(**self.mesh(size)), level.record.contact.solver,
            level.steps[level.at])

    def _third(self) -> None:
        """Run a third mesh, sized by what two differ by: their error would not be enough."""
        coarse, fine = (self.values(size)[self.name] for size in self.sizes)
        if fine == 0:
            return  # it is refused
        between, order = ratio(self.knob, *self.sizes), 1.0 if self.first.element == "P1" else FAST
        part = extrapolate([fine - coarse], [between], order, fine, pair=order)
        if part.error <= CLEAR * self.asked * abs(fine) and self._held(self.sizes[-1]):
            self.enough = 2
            return
        size = self._next({"value": fine, "mesh": part.error})
        if self._nodes(size) <= LARGEST:
            with contextlib.suppress(DriverError):  # the search says why, if it comes to it
                if self._refines(size):
                    self.level(size)
                    self.sizes.append(size)

    def run(self):
        """Search, leaving the finest run. Raises InputError, NoSolution or NotConverged."""
        self._prepare()
        unsettled = 0
        while True:
            entry = self._assess()
            self._report(entry)
            self._refuse_zero()
            allowed = self.asked * abs(entry["value"])
            met = self._met(entry)
            if met and self._settled(allowed):
                entry = self.budget()[self.name]
                met = entry["total"] <= allowed
                if met:
                    return
            if self._short_of_steps(entry):
                self.more_steps(self.sizes[-2])
                continue
            if met:  # tolerances were tightened
                continue
            unsettled = unsettled + 1 if self._grows() else 0
            if unsettled > 1:
                raise NoSolution(f"the {self.words} cannot be computed to {100 * self.asked:g} %: "
                                 "it grows from mesh to mesh, as at a singular point; choose "
                                 "another quantity")
            self._refuse_corners(entry)
            self._refuse_supported(entry)
            size = self._next(entry)
            self.sizes.append(self._made(size, share(entry["total"], entry["value"])))

    def _grows(self) -> bool:
        """Whether the quantity grew from mesh to mesh, and not by less and less, as at a singular
        point. One that turns back, or settles where it might be singular, takes finer meshes.
        """
        if self.parts["mesh"][self.name].note != SINGULAR:
            return False
        sizes = self.sizes[:-4:-1]
        values = [abs(self.values(size)[self.name]) for size in sizes]
        changes = [fine - coarse for fine, coarse in zip(values, values[1:])]
        ratios = [ratio(self.knob, b, a) for a, b in zip(sizes, sizes[1:])]
        return min(changes) > 0 and (
            len(changes) == 1 or observed_order(*changes, *ratios) < DOUBTFUL)

    def _prepare(self) -> None:
        """Run two meshes, choose steps and tolerances on the second one; a third if it is needed.
        """
        self._skip_unsolved()
        self._skip_equal()
        second = self.sizes[-1]
        values = self.values(second)
        self.name = self.name or main_quantity(values, vanishing(values))
        if self.name not in values:
            raise InputError(f"ACCURACY names '{self.name}', which is not among the quantities of "
                             f"the scene: {', '.join(values)}")
        while self.name in vanishing(values) and self.coarsening > 1:
            # where nothing slides yet on coarse meshes: up to twice as fine as the scene's own
            self.coarsening /= 2
            self.sizes = [second, finer(self.knob, second, 2.0)]
            second = self.sizes[-1]
            values = self.values(second)
        if self.memoryless(second):
            self.stride = self.total
            if self.effects.frictional:  # all that depends on the way grows in proportion
                self.parts["time"] = dict.fromkeys(self.values(second), Part(0.0))
        self._take_one_step(second)
        self.tighten(second)
        if self.stride < self.total:
            self.choose_steps(second)
        self._third()

    def _take_one_step(self, size) -> None:
        """The time step's part of a static scene, where there is any."""
        left = 0.0 if self.effects.quasistatic else self.level(size).record.open_work()
        if left:
            self.parts["time"] = of_one_step(self.values(size), left)

    def _report(self, entry: dict) -> None:
        """Tell the user of a mesh."""
        total, mesh = (share(entry[key], entry["value"]) for key in ("total", "mesh"))
        self.say(f"{name_of(self.knob, self.sizes[-1])} STEPS={self.steps}: {self.words} "
                 f"{entry['value']:.4g}, estimated error {total} (mesh {mesh})")

    def _met(self, entry: dict) -> bool:
        """Whether the error estimated from enough meshes is within the request."""
        most = self.asked * abs(entry["value"]) * (1.0 if len(self.sizes) > 2 else CLEAR)
        return (len(self.sizes) >= self.enough and entry["total"] is not None
                and entry["total"] <= most)

    def _settled(self, allowed: float) -> bool:
        """Whether tolerances are confirmed on the last mesh but one; the time step's part from it.

        Of two meshes they were chosen on the last one.
        """
        if len(self.sizes) == 2:
            return True
        if self.negligible(allowed) or not self.tighten(self.sizes[-2]):
            self.renew_time(self.sizes[-2])
            return True
        return False

    def _short_of_steps(self, entry: dict) -> bool:
        """Whether the time step's part is too much of what is allowed, and not the mesh's."""
        allowed, spent = self.asked * abs(entry["value"]), entry.get("time", 0.0)
        return (len(self.sizes) > 2 and spent > self.time_share * allowed
                and entry["mesh"] is not None and (entry["mesh"] <= allowed or spent > allowed))

    def _refuse_zero(self) -> None:
        """Raise NoSolution where the quantity is zero: it has no relative error to be met."""
        budget = self.budget()
        values, errors = ({name: entry[key] for name, entry in budget.items()}
                          for key in ("value", "total"))
        if self.name in vanishing(values) or not values[self.name]:
            error = f" but for its error of {errors[self.name]:.1g}" if errors[self.name] else ""
            pressed = [values[name] for name in PRESSED if name in values]
            cause = "by symmetry, or as nothing slides"
            if pressed and not any(pressed):
                cause = "nothing touches"
            raise NoSolution(f"the {self.words} is zero{error} ({cause}): it has no relative "
                             "error; choose another quantity")
        if self.name in vanishing(values, errors):
            raise NoSolution(f"the {self.words} is {values[self.name]:.1g} with an error of "
                             f"{errors[self.name]:.1g}, both negligible beside the displacements "
                             "or forces of the body: it may be zero, and has no relative error; "
                             "choose another quantity")

    def _refuse_corners(self, entry: dict) -> None:
        """Raise NotConverged where three meshes tell no error as contact is at corners on all."""
        sizes = self.sizes[:-4:-1]
        if entry["mesh"] is not None or len(sizes) < 3:
            return
        levels = [self.level(size) for size in sizes]
        if at_corners([level.touch for level in levels], ratio(self.knob, sizes[-1], sizes[0])):
            fine, coarse = (level.values[self.name] for level in levels[:2])
            raise NotConverged(
                f"no mesh gives an error of the {self.words}: contact is at corners, where one or "
                "two nodes carry all the force on any mesh; the last two meshes differ by "
                f"{share(abs(fine - coarse), fine)}; round the corners, or choose another quantity")

    def _refuse_supported(self, entry: dict) -> None:
        """Raise NotConverged where a support has the largest displacement on three meshes, and none
        of them tells as much as is asked.
        """
        if self.name != "displacement" or entry["mesh"] is None or len(self.sizes) < 3:
            return
        if abs(entry["mesh"] / entry["value"] - UNSEEN) <= ROUNDING:
            raise NotConverged(
                "the largest displacement is at a support or beside it: no mesh shows by how much "
                f"others may exceed it, possibly {100 * UNSEEN:g} %; reached: "
                f"{share(entry['total'], entry['value'])}; choose another quantity")

    def _nodes(self, size) -> float:
        """Of the mesh of a size, by those of the last one."""
        nodes = self.levels.problem(**self.mesh(self.sizes[-1])).manifest.nodes
        return nodes * ratio(self.knob, self.sizes[-1], size) ** 2

    def _made(self, size, reached: str) -> float:
        """The size of a finer mesh, whose problem is made. Raises NotConverged if it cannot be.

        With elements half as long where the scene rounds the size to that of the last mesh; a
        quarter as long where its own mesh, of sides without order, comes between.
        """
        demand = (f"{100 * self.asked:g} % of the {self.words} would need "
                  f"{name_of(self.knob, size)}")
        nodes = self._nodes(size)
        if nodes > LARGEST:
            raise NotConverged(f"{demand}, {nodes:.0f} nodes; reached: {reached}")
        try:
            self.levels.problem(**self.mesh(size))
        except InputError as problem:
            reason = f"{demand}, which cannot be made ({problem}); reached: {reached}"
            raise NotConverged(reason) from None
        if self._refines(size):
            return size
        finer_by = ratio(self.knob, self.sizes[-1], size)
        if finer_by < HALVED:
            return self._made(self._halved, reached)
        if finer_by < 2 * HALVED:
            with contextlib.suppress(NotConverged):  # what was wanted says why
                return self._made(finer(self.knob, size, 2.0), reached)
        raise NotConverged(f"{demand}, but the scene makes no finer mesh, or no finer contact "
                           f"boundary, than at {name_of(self.knob, self.sizes[-1])}; reached: "
                           f"{reached}")

    def others(self) -> str:
        """What to ask for where the request, of no quantity, was met by a force that hardly depends
        on the mesh, and others do; empty elsewhere.
        """
        budget = self.budget()
        errors = {name: entry["relative"] for name, entry in budget.items()}
        name = next((name for name in DEPEND if name in errors), "")
        if not self.unnamed or self.name != "normal_resultant" or not name:
            return ""
        if errors[self.name] is None or errors[self.name] > GIVEN * self.asked:
            return ""
        if errors[name] is not None and errors[name] <= self.asked:
            return ""
        return (f"the {self.words} hardly depends on the mesh, as if given by the loads: "
                f"ACCURACY={100 * self.asked:g}%,{name} requests the {name.replace('_', ' ')}")

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
