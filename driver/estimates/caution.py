"""The mesh's part of errors: what coarser meshes tell of a quantity, and how far they are trusted.

Smooth sequences (budget.py) are what meshes give that resolve a solution. They are trusted less

- where linear elements are stiffer than the material and meshes tell no order: where it hardly
  changes its volume the loss grows like the root of lambda / mu (validity/soundness.py), and coarse
  meshes approach something else; an order that is observed has the loss in it, however slow, but
  for integrals one that is too slow to be theirs;
- where the error in the energy norm is large: so many of the coarser meshes are far from the limit,
  and the largest displacement may err by its square;
- where no adjoint problem holds resultants, displacements and slip: the second order of two meshes
  of quadratic elements or of two cycles is then not taken for granted, and two meshes alone say
  nothing of shear, which has either sign and agrees by chance, unless all that touches slides one
  way on both: it is friction's part of the pressing force then;
- for shear on a body that is pressed, if no adjoint problem holds it: it is not claimed to less
  than a part of the pressing force times the square of the error in energy, as both errors of a
  functional would be, since it may vanish by a symmetry of no mesh; none where meshes agree but for
  tolerances, as balance gives it. So it is for the pressing force of two meshes;
- where pressure grows from mesh to mesh at an end of contact: the order of integrals, of slip and
  of the contact length is at most what such stresses leave (sharp_ends.py), however fast coarse
  meshes seem to converge, of slip that is largest there half of it; that, the work of friction and
  the length, if contact ends between nodes, with the safety of what nothing else holds. Meshes that
  show an order ABOUT as high may tell it or not: more is claimed;
- where slip turned or came to rest, or contact was unloaded since: adjoint problems of the last
  state do not see the errors of earlier ones, so that they hold what slip is LEFT in from below
  alone;
- where areas of contact of a node or two carry a tenth of the force: it acts where a node is, as
  it does in adjoint problems, which then hold errors from below alone, and the second order of two
  meshes is not taken for granted; a displacement that no adjoint problem holds is not claimed where
  they do on the other one of two meshes;
- not where loads give a resultant by balance, wherever contact is (given.py): coarser meshes tell
  what loads err by, and neither contact nor adjoint problems have a part in it;
- for order three, where quadratic elements have straight sides on a round boundary, of contact or
  not: a polygon is of second order, and adjoint problems, which smooth stresses, do not see it, so
  that they hold errors from below alone;
- where nothing touches, but does on a coarser mesh, or is nearer to it than displacements err;
- where pressures are so small beside the mean one as the error in energy is beside the energy, and
  contact may not be there;
- where all nodes that touch slide one way and it is not sure that all do: meshes then have
  friction at its bound, and agree (dragging.py);
- for the work of friction where the largest slip may be nothing but its own error: neither is sure;
- where the coarsest mesh has so few nodes in contact that they tell nothing of it: an order with it
  may be chance, and no less is claimed than by the two other meshes alone: of quantities without
  an adjoint problem, and of displacements that theirs holds from below alone; pressures, a force
  over the length of a node, are claimed by the two others alone if no order is told;
- where meshes tell no order of a displacement that no adjoint problem holds: no less is claimed
  than about the square of the error in energy, as both errors of a functional would be;
- where slip wanders from mesh to mesh and sticks at the end, so that adjoint problems tell of other
  quantities alone;
- where resultants and displacements change more and more from mesh to mesh, to and fro or one way,
  as where contact opens elsewhere on each, or where two meshes have a sharp end of contact: not
  less than a mean of what the adjoint problem says and of the last change;
- for loads that jump inside edges, which quadrature sees in part (validity/soundness.py): by as
  much more as those of the run's mesh, or of the next one, may err;
- for displacements where a node or two of a round boundary carry all: their force acts where a
  node is, on all meshes that have it, and not where the boundaries would meet.

Nor is less claimed than nodes leave open (results/touch.py). The contact length is claimed to no
less than the doubt that the nodes next to its ends leave of them, and to BETWEEN times that where
meshes tell no order; to no more than could touch or open within the errors of displacements and
pressures and its boundary is too short by, nor than a mean of what meshes say and of that doubt.
Found on 2,500 claims of shipped scenes, other scenes and random combinations of effects, of which
97 of 100 hold.
"""

from dataclasses import dataclass, field, replace
from itertools import takewhile

import numpy as np

from ..quantity_table import HELD, LOCAL, QUANTITIES, SUMMED
from ..results.touch import Touch
from . import sharp_ends
from .adjoint import SEES, held
from .budget import (SAFETY, UNSETTLED, Part, enlarged, extrapolate, formal_order, located,
                     observed_order)
from .dragging import unsure, with_lacking
from .free_peak import Peaks, exceeded
from .polygons import too_short

LOCKED = 2.0  # lambda / mu (Poisson's ratio 1/3) from which linear elements are too stiff
BY_FAR = 2.0  # factor of caution from which they are too stiff by far, Poisson's ratio 0.444
ROUGH, STEEP = 0.25, 2.0  # relative error in energy from which caution grows, and how fast
LENGTH, PEAK = "contact_length", "peak_pressure"
FORCE, SHEAR_FORCE = "normal_resultant", "tangential_resultant"
WORK, WAY = "dissipated_energy", "displacement"
SLIP = "slip"
LEFT = (SHEAR_FORCE, WAY, SLIP)  # what earlier slip stays in; pressures hardly depend on it
# of the geometric mean of two estimates, each off by a factor; what meshes and nodes say of the
# contact length: 87 of 88 claims of shipped scenes and of awkward meshes hold, down to 1.5
BETWEEN = 1.75
# of the square of the relative error in energy: what 35 of 40 displacements on coarse meshes of
# linear elements err by at most, whose errors in energy are bounded
COMPLIANCE = 0.65
LIGHT = 0.25  # of the relative error in energy, and of the mean pressure
SHEAR = 0.25  # of the square of the relative error in energy times the pressing force: functionals
BALANCE = 1e-5  # of the pressing force: what tolerances leave of forces that loads give
LONE = 0.1  # of the pressing force in areas of contact of a node or two: it acts where a node is
PRESSING = 3  # nodes that press on a round boundary: fewer have but one normal
FEWEST = {"P1": 5}  # nodes in contact that tell something of it: those of four sides ...
QUADRATIC = 7  # ... or three, of quadratic elements
OF_TWO = "two meshes allow no claim"
GRAZES = "too coarse: there may be contact"
# half of what the strongest stresses of one material leave: by chance rather than an order; adjoint
# problems, which see the stresses themselves, then speak alone
NO_ORDER = UNSETTLED / 2
ABOUT = 0.1  # by which the order that sharp ends leave may be another: pressures' growth is noisy
FAST = 2.0  # their order on two meshes of quadratic elements, or of two cycles


def stiffness(problem) -> float:
    """Factor of caution for linear elements in what hardly changes its volume; collective."""
    if problem.manifest.element != "P1":
        return 1.0
    own = max((float((sub.elasticity[:, 0, 1] / sub.elasticity[:, 2, 2]).max())
               for sub in problem.structure.subdomains), default=0.0)
    largest = max(problem.operator.comm.allgather(own))
    return float(np.sqrt(max(1.0, largest / LOCKED)))


def fewest(element: str) -> int:
    """How many nodes in contact tell something of it."""
    return FEWEST.get(element, QUADRATIC)


@dataclass(frozen=True)
class Caution:
    """How far coarser meshes of a run are trusted."""

    element: str
    adapted: bool = False  # meshes are those of cycles of refinement
    chords: bool = False  # straight sides of quadratic elements stand for curves
    stiff: float = 1.0  # elements beside the material, see `stiffness`
    energy: float = 0.0  # relative error in the energy norm
    touch: Touch = field(default_factory=Touch)
    sizes: dict = field(default_factory=dict)  # of adjoint problems, by quantity
    length: float = np.inf  # of the largest body
    tips: float = np.inf  # order that tips of cracks leave, see sharp_ends.py
    seen: float = 1.0  # part of the bound of the error in energy that smoothed stresses see
    given: frozenset = frozenset()  # resultants that loads give, wherever contact is

    @classmethod
    def of(cls, problem, touch: Touch, sizes: dict, energy: float = 0.0,
           adapted: bool = False, polygons: bool = False, seen: float = 1.0,
           given: frozenset = frozenset()) -> "Caution":
        """`energy`: relative error in the energy norm; `polygons` as of polygons.py, `seen` of
        unresolved.py, `given` of given.py. Collective.
        """
        element = problem.manifest.element
        curve = touch.round > 0 and not touch.straight  # or is it the obstacle that is round?
        polygons |= curve and "curved" not in problem.effects
        chords = element != "P1" and polygons
        largest = float(problem.structure.travel.bodies.size.max(initial=0.0)) or np.inf
        return cls(element, adapted, chords, stiffness(problem), energy, touch, sizes, largest,
                   sharp_ends.of_tips(problem, touch), seen, given)

    def parts(self, values: dict, runs: list, ratios: list[float], singular,
              touches: list[Touch] = (), lost: list[float] = ()) -> dict[str, Part]:
        """Part by quantity from pairs of the values of finer and coarser runs, finest first.

        `singular`: quantities at places where they may be infinite; on the meshes, finest first,
        `touches`: contact, and `lost`: parts by which loads may err, none if it is not given.
        """
        most, over = (self.order(touches, ratios, of)
                      for of in (sharp_ends.order, sharp_ends.order_of_history))
        changes = {name: [fine[name] - coarse[name] for fine, coarse in runs] for name in values}
        between = (LENGTH,) if self.touch.doubt > 0 else ()  # nodes, where contact ends
        orders = dict.fromkeys((*HELD, *between), most) | {
            WORK: over, SLIP: sharp_ends.order_of_way(self.touch, over)}
        parts = {name: self._part(name, changes[name], ratios, value, name in singular,
                                  orders.get(name, np.inf)) for name, value in values.items()}
        few = 0 < min((touch.nodes for touch in touches[2:]), default=0) < fewest(self.element)
        if few and PEAK in parts and PEAK not in singular:
            parts[PEAK] = self._of_few(parts[PEAK], changes[PEAK], ratios, values[PEAK])
        more = max(lost[:2], default=0.0)
        parts |= {name: enlarged(part, more * abs(values[name]))
                  for name, part in parts.items() if name != LENGTH}
        if few:
            parts |= {name: located(part, extrapolate(changes[name][:1], ratios, np.inf, 0.0).error)
                      for name, part in parts.items()
                      if name != LENGTH and (name not in self.sizes
                                             or name == WAY and self._unseen(name))}
        if self._grazes(parts, [coarse for _, coarse in runs]):
            unknown = Part(None, note=GRAZES)
            return dict.fromkeys(parts, unknown) | {WAY: parts[WAY]}
        if WAY in values:
            at_nodes = max((touch.lone for touch in touches[1:]), default=0.0) > LONE
            if len(runs) == 1 and WAY not in self.sizes and at_nodes:
                parts[WAY] = Part(None, note=OF_TWO)
            formal = formal_order("mesh", self.element, WAY, self.chords)
            alone = WAY not in self.sizes and not self._told(parts[WAY], changes[WAY], formal)
            parts[WAY] = self._square(parts[WAY], abs(values[WAY]), alone)
            if 0 < self.touch.round < PRESSING:  # their places, of sides beside the whole
                share = min(1.0, self.touch.edges / self.length)
                parts[WAY] = located(parts[WAY], share * abs(values[WAY]))
        if LENGTH in values:
            parts[LENGTH] = self._ended(parts[LENGTH], parts[WAY].error, too_short(touches, ratios))
            parts[LENGTH] = self._between(parts[LENGTH], changes[LENGTH], abs(values[WAY]))
            parts[LENGTH] = located(parts[LENGTH], self.touch.lighter(LIGHT * self.energy))
        if len(runs) == 1 and FORCE in parts:
            parts[FORCE] = self._of_two(parts[FORCE], changes[FORCE][0], abs(values[FORCE]))
        if SHEAR_FORCE in values.keys() - self.given:
            part = self._shear(values, changes, parts)
            parts[SHEAR_FORCE] = with_lacking(part, self.touch, values, parts)
        if WORK in values and unsure(values, parts):
            parts[WORK] = located(parts[WORK], abs(values[WORK]))
        return parts

    def beside(self, part: Part, value: float, peaks: list[tuple[Peaks, Peaks]],
               touches: list[Touch], ratios: list[float]) -> Part:
        """The `part` of the largest displacement, no less than what other places may have beyond
        it; `peaks` of finer and coarser meshes as of free_peak.exceeded.
        """
        most = self.order(touches, ratios)
        return exceeded(part, value, peaks, ratios,
                        formal_order("mesh", self.element, WAY, most=most), self.energy)

    def order(self, touches: list[Touch], ratios: list[float], of=sharp_ends.order) -> float:
        """Order that ends of contact and tips of cracks leave functionals at most.

        On a mesh where areas of contact are nodes the mean pressure is none, nor what ends have
        over it: growth to the next mesh tells nothing, nor does its coming to an end.
        """
        known = [*touches[:1], *takewhile(lambda touch: touch.lone <= LONE, touches[1:])]
        return np.inf if self.adapted else min(self.tips, of(known, ratios))

    def _grazes(self, parts: dict, coarser: list[dict]) -> bool:
        """Whether nothing touches, and something may."""
        if self.touch.nodes or PEAK not in parts:
            return False
        error = parts[WAY].error
        return (any(values[PEAK] > 0 for values in coarser)
                or error is not None and self.touch.apart <= error)

    def _ended(self, part: Part, way: float | None, shape: float) -> Part:
        """Part of the contact length, not above what could touch or open; `way`: error of the
        displacements, `shape`: of the length of the boundaries themselves.
        """
        if None in (part.error, way) or not (self.energy and self.touch.nodes):
            return part
        most = self.touch.uncertain(way, self.energy) + shape
        return replace(part, error=min(part.error, most))

    def _square(self, part: Part, size: float, alone: bool) -> Part:
        """Part of the largest displacement `size`, beside the square of a large error in energy.

        That is what a displacement under the loads errs by, whatever coarse meshes and adjoint
        problems, of smoothed stresses, agree on; others may err by less. Between both, so that what
        supports prescribe has no error. So it is of any error in energy where it stands `alone`, as
        neither an order nor an adjoint problem tells of the displacement.
        """
        if part.error is None or not (alone or self.energy > ROUGH):
            return part
        square = COMPLIANCE * (self.energy / (SEES if alone else 1.0))**2 * size
        least = min(square, BETWEEN * float(np.sqrt(part.error * square)))
        return located(part, least)

    def _between(self, part: Part, changes: list, way: float) -> Part:
        """Part of the contact length, between what meshes say and what nodes do.

        Meshes differ by where their nodes lie, more than they err; the nodes of one mesh do not see
        what the whole mesh errs by. Both are off by a factor, and so is their geometric mean, but
        by less. At least half of what meshes say stays: a claim that they made rightly is still
        half of the error where contact elsewhere is not what its ends know. Nor is it less than the
        doubt itself, and that by its factor where meshes tell no order: they may agree by chance.
        So may meshes of too stiff elements on boundaries of which nothing touches, nearer to that
        than their displacements err, of which the largest is a `way`.
        """
        doubt = self.touch.doubt
        if part.error is None:
            return part
        told = self._told(part, changes, formal_order("mesh", self.element, LENGTH, self.chords))
        if self.stiff >= BY_FAR and not told and self.touch.nodes:
            opening, length = self.touch.aside.T
            part = located(part, float(length[opening < self.energy * way].sum()))
        if doubt <= 0:
            return part
        mean = BETWEEN * float(np.sqrt(part.error * doubt))
        error = min(part.error, max(part.error / 2, mean))
        least = max(doubt if told else BETWEEN * doubt, (self.touch.open or {}).get(LENGTH, 0.0))
        return located(replace(part, error=error), least)

    def _of_few(self, part: Part, changes: list, ratios: list, value: float) -> Part:
        """Part of the largest pressure; a mesh with few nodes, each its force over a length, counts
        if it tells an order.
        """
        told = self._told(part, changes, formal_order("mesh", self.element, PEAK, self.chords))
        return part if told else self._part(PEAK, changes[:1], ratios, value, False, np.inf)

    def _of_two(self, part: Part, change: float, force: float) -> Part:
        """Part of the pressing force, which two meshes may agree on by chance: if no adjoint
        problem holds it no less than both errors of a functional leave, unless balance gives it.
        """
        if self.sizes or FORCE in self.given or abs(change) <= BALANCE * force:
            return part
        return located(part, SHEAR * self.energy**2 * force)

    def _shear(self, values: dict, changes: dict, parts: dict) -> Part:
        """Part of the shear force, with what is open of it whatever coarser meshes say.

        Where all slides it is friction's part of the pressing force, and errs by that of the error.
        """
        part, force = parts[SHEAR_FORCE], abs(values[FORCE])
        own = np.abs(changes[SHEAR_FORCE])
        if self.touch.dragged and unsure(values, parts):
            return located(part, abs(values[SHEAR_FORCE]))
        if own.max(initial=0.0) <= BALANCE * force:
            return part
        if len(own) == 1 and not self.sizes:
            share = values[SHEAR_FORCE] / (force or 1.0)
            apart = abs(changes[SHEAR_FORCE][0] - share * changes[FORCE][0])
            if self.touch.dragged and apart <= BALANCE * force and parts[FORCE].error is not None:
                return replace(parts[FORCE], error=abs(share) * parts[FORCE].error)
            return Part(None, note=OF_TWO)
        if self.sizes:
            return part
        return located(part, SHEAR * self.energy**2 * force)

    def _doubted(self, part: Part, told: bool) -> Part:
        """A part with what the mesh itself leaves in doubt; `told`: meshes tell an order.

        Errors of elements that are too stiff hardly fall until these are fine enough; where an
        order is observed, however slow, it has the loss in it.
        """
        rough = 1 + STEEP * max(0.0, self.energy - ROUGH)
        error = part.error and part.error * rough * (1.0 if told else self.stiff)
        return replace(part, error=error)

    def _part(self, name: str, changes: list, ratios: list, value: float, singular: bool,
              most: float) -> Part:
        quantity = QUANTITIES[name]
        if name in self.given:  # the error of the loads, which a polygon errs by at most
            return extrapolate(changes, ratios, formal_order("mesh", self.element, name,
                                                             self.chords), value, True, pair=FAST)
        known = self.sizes and (name in self.sizes or name != SLIP or not _wander(changes, ratios))
        caution = quantity.caution if known or name not in (*HELD, SLIP) else SAFETY
        estimated = np.isfinite(most)
        if estimated and (name in (WORK, LENGTH) or name == SLIP and self.touch.way_at_end):
            caution = SAFETY  # nodes beside a sharp end differ by far less than it errs
        fast = (self.element != "P1" or self.adapted) and name in HELD and self.sizes
        fast = fast and self.touch.lone <= LONE
        formal = formal_order("mesh", self.element, name, self.chords, most)
        # of integrals an order below this is chance: their errors fall by twice the order that
        # those of stresses do, which the strongest of one material, r^-3/4, leave at 1/4
        least = UNSETTLED if quantity.kind != LOCAL else 0.0
        part = extrapolate(changes, ratios, formal, value, quantity.limit, singular,
                           caution, FAST if fast else 1.0, least, name in HELD)
        slowest = NO_ORDER if self.sizes and name in HELD else min(least, formal)
        told = {self._told(part, changes, formal + above, slowest)
                for above in (0.0, ABOUT * estimated)}
        found = [self._held(name, part, changes, ratios, each, estimated) for each in told]
        part = max(found, key=lambda part: part.error or 0.0)
        return located(part, (self.touch.open or {}).get(name, 0.0))

    def _unseen(self, name: str) -> bool:
        """Whether a quantity errs by what its adjoint problem, if there is one, does not see."""
        return (self.chords or self.touch.lone > LONE
                or self.touch.earlier and name in LEFT)

    def _held(self, name: str, part: Part, changes: list, ratios: list, told: bool,
              sharp: bool) -> Part:
        """The part within what adjoint problems leave; `told`: whether meshes tell an order,
        `sharp`: an end is, where smoothed stresses see less of an error.
        """
        part = self._doubted(part, told)
        slack = np.inf if self._unseen(name) else self.stiff  # for what smoothed stresses miss
        told |= name not in HELD and (name != SLIP or len(changes) > 1)
        part = held(name, part, self.sizes.get(name), slack, told, self.seen,
                    self.element == "P1")
        alone = name in self.sizes and not told  # the adjoint problem speaks
        apart = _grow(changes, ratios) or sharp and len(changes) == 1
        if part.error is not None and alone and apart:
            part = located(part, BETWEEN * float(np.sqrt(part.error * abs(changes[0]))))
        return part

    @staticmethod
    def _told(part: Part, changes: list, formal: float, slowest: float = 0.0) -> bool:
        """Whether changes, without turning back, tell an order that there may be."""
        falls = len(changes) > 1 and changes[0] * changes[1] > 0
        return falls and part.order is not None and slowest < part.order <= formal


def _grow(changes: list, ratios: list[float]) -> bool:
    """Whether changes from mesh to mesh hardly fall, of one sign or turning back."""
    if len(changes) < 2 or changes[0] * changes[1] == 0:
        return False
    return observed_order(abs(changes[0]), abs(changes[1]), *ratios[:2]) <= NO_ORDER


def _wander(changes: list, ratios: list[float]) -> bool:
    """Whether changes from mesh to mesh turn back and hardly fall."""
    return len(changes) > 1 and changes[0] * changes[1] < 0 and _grow(changes, ratios)


def by_balance(values: dict, parts: dict) -> set[str]:
    """Resultants that the loads give, whatever the mesh; `parts` of the error by the mesh."""
    force = abs(values.get("normal_resultant", 0.0))
    errors = {name: parts[name].error for name in SUMMED if name in values}
    return {name for name, error in errors.items()
            if error is not None and error <= BALANCE * force}
