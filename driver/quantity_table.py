"""The quantities of interest: the few numbers that users read first.

Their meanings and units, and what their errors depend on. results/quantities.py computes the
values; the rooms of effects say which quantities a scene has.
"""

from dataclasses import dataclass

# linear functionals of the solution, whose errors adjoint problems tell; other integrals; what
# hangs on places between nodes
LINEAR, INTEGRAL, LOCAL = "linear", "integral", "local"


@dataclass(frozen=True)
class Quantity:
    """One of them."""

    unit: tuple[int, int]  # powers of stress and length, per thickness
    kind: str
    meaning: str
    # factor of the mesh's part of the error: what about 95 of 100 take, or all but one, on 397
    # triples of meshes of shipped scenes and 790 claims of scenes that were drawn; of those with 1
    # adjoint problems, sharp ends (estimates/sharp_ends.py), the distance of nodes and slip keep
    # errors from being far too small
    caution: float = 1.0
    limit: bool = True  # under refinement, whatever the scene
    summed: bool = False  # over contact boundaries, by magnitude
    order_in_time: float = 1.0


QUANTITIES = {
    "peak_pressure": Quantity(
        (1, 0), LOCAL, "largest contact pressure: between nodes from a parabola through three "
        "nodes, at ends of the boundary (linear elements) extrapolated from inside; with "
        "bilateral contact the largest abs(sigma_n)", caution=1.6, limit=False),
    "normal_resultant": Quantity(
        (1, 1), LINEAR, "contact pressure integrated over the contact boundary", caution=1.2,
        summed=True),
    "tangential_resultant": Quantity(
        (1, 1), LINEAR, "shear traction sigma_t integrated over the contact boundary, with sign",
        summed=True),
    "contact_length": Quantity(
        (0, 1), LOCAL, "length in contact, with its ends interpolated between nodes"),
    "slip": Quantity(
        (0, 1), LOCAL, "largest accumulated slip of a point in contact since time 0"),
    "dissipated_energy": Quantity(
        (1, 2), INTEGRAL, "energy dissipated by friction since time 0",
        order_in_time=2.0),  # by the trapezoid of its friction bound
    "worn_volume": Quantity(
        (0, 2), INTEGRAL, "volume worn off since time 0, if the scene declares wear",
        caution=1.7),
    "displacement": Quantity((0, 1), LINEAR, "largest displacement of a node"),
}


def names(wanted) -> tuple[str, ...]:
    """Those of which `wanted`, a function of a Quantity, is true, in the order of the table."""
    return tuple(name for name, quantity in QUANTITIES.items() if wanted(quantity))


HELD = names(lambda quantity: quantity.kind == LINEAR)  # by adjoint problems
OF_FORCES = names(lambda quantity: quantity.unit[0] > 0)
SUMMED = names(lambda quantity: quantity.summed)
