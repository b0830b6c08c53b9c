"""Which errors a mesh that does not resolve the solution leaves unknown.

Contact of a node or two acts where a node is, which the mesh has chosen. At the corner of a body it
acts at the corner, on any mesh: what meshes miss there is how the body yields around it, which
grows like log(h/w), w the width of contact that none of them resolves. Halved elements change
forces and displacements by about as much each time until they are as short as w: so many times
what the last two meshes differ by is what is claimed at least. Of w the node that opens least
tells: with elements of size h it opens by t h - A, t the angle of the corner, so that w = A/t.
"""

import numpy as np

from ..quantity_table import HELD
from ..results.touch import Touch
from .budget import Part, located, vanishing
from .budget_words import share
from .caution import LONE, PRESSING, by_balance, fewest
from .given import Given

COARSE = 0.5  # relative error in energy from which coarser meshes tell nothing of a finer one
FINE = 0.02  # the same up to which a body is resolved as a whole, however few its contact nodes
APART = 1.0  # change of a quantity to the next mesh over the quantity itself, of another problem
BLIND = 0.25  # smoothed stresses' error in energy over its bound; that is 2.6 times the true one
# at most in the tests, so that two thirds of the error are all that they see
OPENS = 1.5  # power of the size of elements with which the next node opens: a corner 1, a curve 2
OWN = "too coarse: its value may be nothing but its error"
STICKS, BEGINS = "no node slides on this mesh", "no node slides on the next coarser mesh"
PLACED = ("displacement",)  # which nodes in contact do not make
OF_SLIP = ("slip", "dissipated_energy")
OF_PLACES = ("peak_pressure", "contact_length", *OF_SLIP)  # what displacements bring in contact
ALIKE = ("normal_resultant", "displacement")  # of meshes of the same problem
# what hangs on the place of a force, which is known at corners, and on no pressure
OF_CORNERS = ("normal_resultant", "tangential_resultant", "displacement", "slip",
              "dissipated_energy")
NARROWEST = 1e-3  # of a side: width of contact at a corner that openings still tell


def _steps(energy: dict | None) -> list[dict]:
    """The steps of the entry of energy.report."""
    return [energy or {}, *((energy or {}).get(name, {}) for name in ("largest", "carrying"))]


def energy_error(energy: dict | None) -> float:
    """Largest relative error of the mesh in the energy norm, of the entry of energy.report."""
    return max((estimate["mesh"] / estimate["norm"] for estimate in _steps(energy)
                if estimate.get("norm")), default=0.0)


def blind(energy: dict | None, smoothed: float | None, step: int) -> bool:
    """Whether smoothed stresses, of which adjoint problems are made, miss most of the error.

    `energy`: the entry of energy.report, which may know of the `step` of these problems, `smoothed`
    its error by them; it may be that of no other mesh than one of a few elements, whose stresses
    are smooth whatever they miss.
    """
    return seen(energy, smoothed, step) < BLIND


def seen(energy: dict | None, smoothed: float | None, step: int) -> float:
    """Part of the bound of the error in energy that smoothed stresses see, as `blind` takes them;
    all of it where there is none.
    """
    if not energy or energy.get("kind") != "equilibrated" or smoothed is None:
        return 1.0
    bounds = [entry["mesh"] for entry in _steps(energy)
              if entry.get("step") == step and entry.get("mesh")]
    return min((smoothed / bound for bound in bounds), default=1.0)


def parts(values: dict, error: float, touch: Touch, element: str, adjoint: bool,
          unseen: bool = False, corners: bool = False) -> dict[str, Part]:
    """Parts without an error, of those quantities in `values` of which the mesh tells none.

    Where contact opens and slips between its few nodes coarser meshes may agree by chance; of
    displacements and resultants `adjoint` problems see the whole body's error if there are any (of
    displacements so does an error in energy that is FINE), but where normals vary a node or two
    that carry all have one direction, and where areas of contact have no more nodes their force
    acts at a node. `error`: of energy_error; `unseen`: these problems are blind; `corners`: areas
    of contact are at corners on all meshes, and halvings of them say what is open.
    """
    placed = PLACED if adjoint or 0 < error <= FINE else ()  # zero is unknown
    reason, spared = "", HELD if adjoint else placed
    if error > COARSE:
        reason = f"its error in the energy norm is {100 * error:.0f} %"
    if 0 < touch.nodes < fewest(element):
        reason = f"{touch.nodes} nodes are in contact"
    if touch.lone > LONE:
        reason = f"contact areas of one or two nodes carry {share(touch.lone, 1.0)} of the force"
        spared = OF_CORNERS if corners and error <= COARSE else placed
    if 0 < touch.round < PRESSING:
        reason = ("one or two nodes carry the whole force where the body or the other side is "
                  "round: refine the mesh there")
        spared = placed
    if unseen:
        reason, spared = "smoothed stresses miss most of its error in energy", PLACED
    names = [name for name in values if reason and name not in spared]
    return dict.fromkeys(names, Part(None, note=f"too coarse: {reason}"))


def alike(runs: list) -> list:
    """Pairs of the values of finer and coarser runs, up to a mesh that makes another problem.

    Such are polygons that overlap where circles have play: one of its ALIKE quantities changes by
    more than the finer mesh has of it.
    """
    def same(fine, coarse):
        named = [name for name in ALIKE if name in fine and name not in vanishing(fine)]
        return all(abs(coarse[name] - fine[name]) <= APART * abs(fine[name]) for name in named)

    return runs[: next((k for k, pair in enumerate(runs) if not same(*pair)), len(runs))]


def at_corners(touches: list[Touch], ratio: float) -> bool:
    """Whether contact is at corners, of which no finer mesh has more nodes.

    `touches` of meshes, finest first, whose elements grow by `ratio` from the first to the last. On
    all of them a node or two carry all beside ends of boundaries, on finer ones by no more nodes,
    and the node that opens least opens like a corner does, not like a curve.
    """
    nodes = [touch.nodes for touch in touches]
    if not all(touch.cornered and touch.lone > LONE for touch in touches):
        return False
    if nodes != sorted(nodes):
        return False
    fine, coarse = (touch.beside[:, 0].min(initial=np.inf) for touch in (touches[0], touches[-1]))
    return bool(0 < fine < np.inf and coarse < fine * ratio**OPENS)


def halvings(touches: list[Touch], ratios: list[float]) -> float:
    """How many times elements are to be halved until contact at corners is as wide as they are; 0
    where three meshes, `touches` finest first, do not show that it is there alone.
    """
    factor = float(np.prod(ratios[:len(touches) - 1]))
    if len(touches) < 3 or not at_corners(touches, factor):
        return 0.0
    fine, coarse = (touch.beside[:, 0].min() for touch in touches[:2])
    angle = (coarse - fine) / (ratios[0] - 1)  # times the side
    width = max((angle - fine) / angle, NARROWEST) if angle > 0 else NARROWEST
    return float(np.log2(1 / min(width, 0.5)))


def of_corners(found: dict[str, Part], pair: tuple[dict, dict], ratio: float,
               left: float) -> dict[str, Part]:
    """The parts `found`, no less than what `left` halvings, as of `halvings`, may change.

    `pair`: values of the two finest meshes, whose sizes have the `ratio`.
    """
    each = {name: abs(pair[0][name] - pair[1][name]) / np.log2(ratio)
            for name in OF_CORNERS if name in found}
    return found | {name: located(found[name], left * change) for name, change in each.items()}


def claimable(found: dict[str, Part], values: dict, touches: bool = False,
              coarser: dict | None = None) -> dict[str, Part]:
    """The parts `found`, but those as large as the value itself: meshes on which it comes and goes
    do not bound its error, nor that of the work of such a slip; nor, of such displacements, those
    of what they bring in contact. What vanishes, but for the mesh, is said to do so; by how much,
    if all that `touches` sticks, finer meshes know, on which it slides at the ends of contact
    first. So it is if all sticks on the next `coarser` mesh, of these values: how slip goes on
    takes two meshes that have some.
    """
    zero = vanishing(values, {name: part.error for name, part in found.items()})
    unknown = {name for name, part in found.items() if name not in zero
               and part.error is not None and part.error >= abs(values[name]) > 0}
    if "slip" in unknown and "dissipated_energy" in found:
        unknown.add("dissipated_energy")
    if "displacement" in unknown:
        unknown |= {name for name in OF_PLACES if name in found and name not in zero
                    and found[name].error is not None}
    found = found | {name: Part(None, note=OWN) for name in unknown}
    slip, before = values.get("slip"), (coarser or {}).get("slip")
    if touches and 0 in (slip, before):
        note = BEGINS if slip else STICKS
        found |= {name: Part(None, note=note) for name in OF_SLIP if name in found}
    return found


def known(found: dict[str, Part], unknown: dict[str, Part], values: dict,
          given: Given) -> dict[str, Part]:
    """The parts `found`, but those that are `unknown`; resultants that the loads give stay.

    They give them by balance anywhere, or where contact is, if coarser meshes agree on it. `values`
    of the run.
    """
    stay = of_loads(values, found, given)
    return found | {name: part for name, part in unknown.items() if name not in stay}


def of_loads(values: dict, parts: dict[str, Part], given: Given) -> set[str]:
    """Resultants that the loads give, whatever the mesh; `parts` of the error by the mesh."""
    return given.anywhere | by_balance(values, parts) & given.here
