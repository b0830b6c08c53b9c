"""Error budget of the quantities of interest: the parts of mesh, time step, friction and solver.

Companions of the run on coarser meshes tell the parts. With sizes h, r h, r s h and values q0, q1,
q2 the error of q0 is taken for C h^p, so that

    |q1 - q2| / |q0 - q1| = (s^p - 1) r^p / (r^p - 1)  gives p,   rest = |q0 - q1| / (r^p - 1)

as in the grid convergence index (P. J. Roache, "Perspective: a method for uniform reporting of grid
refinement studies", J. Fluids Eng. 116 (1994) 405-413). Three meshes are rarely near the limit, and
their differences have chance in them, as the edge of contact falls between nodes. So

p in [1, formal]  error = S max(rest, FLOOR first), first = |q0 - q1| / (r - 1)
p above           trusted as little as below, down to the first order, or the formal one where that
                  is less (sharp_ends.py); rest follows from q1 - q2
p below 1         error = S SLOW rest, at the observed order, however slow; of integrals at the
                  order UNSETTLED or more: the strongest stresses leave that, slower is chance
turning back      error = S times the larger of first and |q1 - q2| / (s - 1), both at the formal
                  order p where that is below 1; of forces and displacements the latter is what q1
                  errs by, and q0 by 1 / r^p of it: whatever the sign, their errors fall so fast,
                  while those of places, pressures and work lie between nodes by chance
no decrease       error = S |q0 - q1| / (r^p - 1), p = UNSETTLED; a pressure, the only quantity that
                  may be without limit, gets none below the order DOUBTFUL, and at an end of contact
                  none where it changes by more than STILL
two meshes        error = PAIR |q0 - q1| / (r^q - 1), q = 1; 2 for integrals, which quadratic
                  elements and adaptive meshes approach so fast; at most the formal order

with FLOOR, SLOW, PAIR chosen on synthetic sequences, sums of two powers of h and of a disorder of
order 1 to 1.5 (tests/estimates/test_budget.py): 94 to 99 of 100 errors are covered, and the median
of error over truth is 2.3 to 3.5; S by quantity (quantity_table.py) on 397 triples of meshes of
shipped scenes, of which 96 of 100 hold with a median of 3.8; caution.py says where more is needed.
The same holds for time steps.

mesh      the same run on meshes with elements 2 and 4 times as long, or of the cycles before
          (ADAPT)
time      on the finer one of these meshes, or on the run's own where that one has too few nodes in
          contact, every second and every fourth time of the load history
jumps     on the finer one of these meshes, jumps over cycles of half the length (jumps.py)
friction  there at every fourth time: FRICTION_RTOL and PRIMAL_RTOL, which makes a step go on,
          against a hundredth of them, both with RTOL/100
solver    likewise RTOL (MPRGP, gluing) against a hundredth of it, without Coulomb friction
          PRIMAL_RTOL too; both times the ratios of steps and of element sizes, by which a run adds
          up more and answers more to its tolerances

What the run does not have has no part: jumps where it made none; time in a static scene, or where
the end of the history does not depend on the way to it (no friction); the fixed point without
Coulomb friction.
"""

import dataclasses
from collections.abc import Collection

import numpy as np

from ..quantity_table import QUANTITIES

# orders of the elements for functionals, and of the implicit Euler method. Functionals gain twice
# the order in the energy norm: 1 with linear elements, with quadratic ones 3/2, as stresses have
# kinks where contact begins and ends (Moussaoui, Khodja, Comm. PDE 17 (1992) 805-826)
FORMAL = {"mesh": {"P1": 2.0, "P2": 3.0, "P2-mixed": 3.0}, "jumps": 1.0}
OF_CHORDS = 2.0  # of a polygon that stands for a curve
SAFETY, FLOOR, SLOW, PAIR = 1.75, 0.8, 1.1, 3.0
OF_TIME = 1.2  # of the time step's part
FIRST = 0.999  # an observed first order, rounding apart
SLOWEST = 0.02  # an observed order below this is no convergence
# the order that is expected of finer runs then: that of stresses r^-3/4, the strongest in a body of
# one material, at a slit that is held on one side
UNSETTLED = 0.5
DOUBTFUL = 0.3  # nor is one below this of a quantity that may have no limit
WANDER = 0.02  # relative spread below which values that do not converge visibly just wander
STILL = 1e-3  # the same at places where there may be no limit, of three meshes ...
EXACT = 1e-5  # ... and of two, which agree by chance
ALONE = "no coarser run to compare with"
SINGULAR = "does not converge under refinement: it may be singular, or the mesh too coarse"
CANCELLED = 1e-9  # of the peak pressure times the length: bilateral contact pulls as it presses
VANISHED = 1e-6  # of what its unit suggests: a quantity that is zero but for tolerances
SMALL = 1e-3  # of it: one that is zero but for an error as large as itself


def formal_order(source: str, element: str, name: str, chords: bool = False,
                 most: float = np.inf) -> float:
    """Order at which the part of a quantity's error falls where the solution is smooth.

    `chords`: sides of the elements are chords of a round boundary. `most`: what the solution's
    stresses leave where they are not smooth.
    """
    if source == "mesh":
        return min(FORMAL["mesh"][element], OF_CHORDS if chords else np.inf, most)
    return QUANTITIES[name].order_in_time if source == "time" else FORMAL[source]


def main_quantity(values: dict, zero: Collection[str] = ()) -> str:
    """The quantity for a run that names none: normal resultant, or displacement where there is none
    or it is among those that are `zero`, as that of contact which pulls as well.
    """
    pressed = "normal_resultant" in values and "normal_resultant" not in zero
    return "normal_resultant" if pressed else "displacement"


# ---- one part ------------------------------------------------------------------------------------

@dataclasses.dataclass
class Part:
    """Error (None: unknown), observed order (None: not observed) and what may be wrong.

    `rate`: the order at which the error is expected to fall further, `floor`: what is claimed on
    any mesh.
    """

    error: float | None
    order: float | None = None
    note: str = ""
    rate: float = 1.0
    floor: float = 0.0


def observed_order(d1: float, d2: float, r: float, s: float) -> float:
    """p of (s^p - 1) r^p / (r^p - 1) = d2/d1, which grows with p; -inf where differences grow."""

    def growth(p):
        return (s**p - 1) * r**p / (r**p - 1)

    if d1 == 0:
        return np.inf
    if d2 / d1 <= growth(1e-3):
        return -np.inf
    low, high = 1e-3, 8.0
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if growth(middle) < d2 / d1 else (low, middle)
    return low


def extrapolate(changes: list[float], ratios: list[float], formal: float, value: float,
                limit: bool = False, singular: bool = False, safety: float = SAFETY,
                pair: float = 1.0, least: float = 0.0, falling: bool = False) -> Part:
    """Error of a `value` from its changes q0 - q1, q1 - q2 (up to two) between sizes in `ratios`.

    `limit`: there is a limit in any case, so that changes that grow only tell that it is not near.
    `singular`: the value belongs to a place where it may be infinite, and has an error only where
    it hardly changes. `pair`: the order that two sizes alone are taken for; `least`: what there is
    at least, so that slower changes are chance; `falling`: errors fall from size to size, of
    whatever sign.
    """
    if not changes:
        return Part(None, note=ALONE)
    d1, r = abs(changes[0]), ratios[0]
    if len(changes) == 1:
        if singular and d1 > EXACT * abs(value):
            return Part(None, note=SINGULAR)
        return Part(PAIR * d1 / (r**min(pair, formal) - 1))
    d2, s = abs(changes[1]), ratios[1]
    if d1 == d2 == 0:
        return Part(0.0)
    turned = changes[0] * changes[1] < 0
    order = observed_order(d1, d2, r, s)
    slow = min(1.0, formal)
    first = d1 / (r**slow - 1), d2 / (s**slow - 1)  # errors at the first order, or a lower formal
    spread = max(first) if turned else d1 + d2
    unlimited = not limit and not turned and spread > WANDER * abs(value)
    if singular and d1 + d2 > STILL * abs(value) or unlimited and order < DOUBTFUL:
        return Part(None, note=SINGULAR)
    if turned:
        return Part(safety * (max(first[0], first[1] / r**slow) if falling else spread), order)
    if order < SLOWEST:
        return Part(safety * d1 / (r**UNSETTLED - 1), rate=UNSETTLED)
    p = order if order <= formal else max(min(1.0, formal), 2 * formal - order)
    rest = d2 / ((s**p - 1) * r**p)  # = d1/(r^p - 1), but where p was changed
    if order < min(least, formal):
        p = min(least, formal)
        return Part(safety * SLOW * d1 / (r**p - 1), order, rate=p)
    if order < FIRST:
        return Part(safety * SLOW * rest, order, rate=p)
    return Part(safety * max(rest, FLOOR * first[0]), order, rate=p)


def located(part: Part, least: float) -> Part:
    """A part of the error that is not below what nodes leave open, `least`.

    Where contact ends, and where slip is largest, lies between nodes: meshes may agree by chance.
    """
    if part.error is None or part.error >= least:
        return part
    return dataclasses.replace(part, error=least)


def enlarged(part: Part, more: float) -> Part:
    """A part, known or not, by `more` larger."""
    error = None if part.error is None else part.error + more
    return dataclasses.replace(part, error=error)


def falls(part: Part) -> bool:
    """Whether finer runs lower the error, as far as there are any: not where they change by as much
    from one to the next, or by more. Two alone are taken at their word.
    """
    return part.rate != UNSETTLED if part.order is None else part.order > SLOWEST


def of_one_step(values: dict, open_work: float) -> dict[str, Part]:
    """The time step's part of static quantities `values`: what one step leaves open of the work of
    friction, as of Record.
    """
    return dict.fromkeys(values, Part(0.0)) | {"dissipated_energy": Part(open_work)}


# ---- the budget of a run -------------------------------------------------------------------------

def summed(parts: dict[str, Part], value: float) -> dict:
    """The budget of one quantity."""
    errors = {source: part.error for source, part in parts.items()}
    total = None if None in errors.values() else float(sum(errors.values()))
    relative = 0.0 if total == 0 else total / abs(value) if total is not None and value else None
    orders = {f"{source}_order": part.order for source, part in parts.items()
              if part.order is not None and np.isfinite(part.order)}
    note = "; ".join(f"{source}: {part.note}" for source, part in parts.items() if part.note)
    return {"value": value, **errors, "total": total, "relative": relative, **orders,
            **({"note": note} if note else {})}


def vanishing(values: dict[str, float], errors: dict | None = None) -> set[str]:
    """Quantities that are zero but for rounding or, by symmetry or in stick, for the mesh.

    Their relative errors mean nothing. `errors`: absolute ones by name, None where unknown.
    """
    force, way = abs(values.get("normal_resultant", 0.0)), abs(values.get("displacement", 0.0))
    scales = {"tangential_resultant": force, "dissipated_energy": force * way, "slip": way}
    pressing = abs(values.get("peak_pressure", 0.0)) * values.get("contact_length", 0.0)
    zero = {"normal_resultant"} if 0 < pressing and force <= CANCELLED * pressing else set()
    for name, scale in scales.items():
        size = abs(values.get(name, np.inf))
        error = (errors or {}).get(name)
        within = error is not None and size <= error and size <= SMALL * scale
        if size <= VANISHED * scale or within:
            zero.add(name)
    return zero | ({"worn_volume"} & set(values) if "slip" in zero else set())


# ---- knobs and words -----------------------------------------------------------------------------

def mesh_knob(parameters: dict) -> str:
    """Name of the parameter that sets the mesh size."""
    return next(name for name in ("cells", "remesh", "h") if name in parameters)


def coarser(knob: str, size: float) -> float | None:
    """The mesh size twice as coarse (CELLS: rounded up), None where there is none."""
    if knob == "cells":
        return (size + 1) // 2 if size > 1 else None
    return 2 * size


def coarser_sizes(knob: str, size: float) -> list[float]:
    """Sizes of elements twice and four times as long, as far as there are such."""
    sizes = [size]
    while len(sizes) < 3 and (size := coarser(knob, size)):
        sizes.append(size)
    return sizes[1:]


def ratio(knob: str, coarse: float, fine: float) -> float:
    """Length of an element at size `coarse` over that at size `fine`."""
    return fine / coarse if knob == "cells" else coarse / fine


def finer(knob: str, size: float, factor: float) -> float:
    """The mesh `size` refined by about `factor`, as a number that people would type."""
    if knob == "cells":
        return max(size + 1, int(np.ceil(size * factor - 1e-9)))
    digits = 1 - int(np.floor(np.log10(size / factor)))
    return min(float(np.floor(size / factor * 10.0**digits + 1e-9) / 10.0**digits), size)


def name_of(knob: str, value: float | str) -> str:
    """A setting, a number or a word such as P2, as on the command line."""
    return f"{knob.upper()}={value if isinstance(value, str) else format(value, 'g')}"
