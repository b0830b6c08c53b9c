"""Which errors a mesh that does not resolve the solution leaves unknown."""

from .budget import Part

COARSE = 0.5  # relative error in energy from which coarser meshes tell nothing of a finer one
PRESSING = 3  # nodes on a round boundary below which they tell nothing: one has but one normal
OF_BODIES = ("normal_resultant", "tangential_resultant", "displacement")


def parts(values: dict, energy: dict | None, pressing: int) -> dict[str, Part]:
    """Parts without an error, of those quantities in `values` of which the mesh tells none.

    Where contact opens and slips between its few nodes coarser meshes may agree by chance; of
    resultants and displacements equilibrium and adjoint problems see the whole body's error, but
    of a round boundary a node or two that carry all have one direction. `energy`: the entry of
    energy.report; `pressing`: how many nodes press on round boundaries, 0 without these.
    """
    error = max((estimate["mesh"] / estimate["norm"] for estimate in (
        energy or {}, (energy or {}).get("largest", {})) if estimate.get("norm")), default=0.0)
    reason, spared = "", OF_BODIES
    if error > COARSE:
        reason = f"its error in the energy norm is {100 * error:.0f} %"
    if 0 < pressing < PRESSING:
        reason, spared = "a node or two of a round boundary carry all", OF_BODIES[-1:]
    names = [name for name in values if reason and name not in spared]
    return dict.fromkeys(names, Part(None, note=f"the mesh is too coarse: {reason}"))
