"""Coarser meshes whose elements are longer in one direction alone, as across a thin body.

Where a scene keeps a cell or two across a thickness, whatever the size, meshes differ by what
elements along it make, and agree on what those across make. It is enough that the two coarsest
meshes do: the finest one then differs by more, as it has more cells across. The error in energy, of
which smoothed stresses on the run's own mesh see two thirds, has both: its square is what a
functional of the whole errs by, as the compliance does. No less is claimed. Adjoint problems see it
likewise: this is for quantities without.
"""

import numpy as np

from ..quantity_table import LOCAL, QUANTITIES
from .adjoint import SEES
from .budget import Part, located
from .caution import BETWEEN
from .mesh_counts import elements

# power of the sides' ratio by which the number of triangles falls: 2 in all directions, 1 in one
BOTH = 1.5


def one_way(problems: list, ratios: list[float]) -> bool:
    """Whether any of the `problems`, finest first, is coarser than the one before in one direction
    alone; collective.

    If it is the coarsest alone the two differences are of unlike errors, and tell no order.
    """
    counts = [elements(problem)[0] for problem in problems]
    return any(fine < coarse * ratio ** BOTH
               for fine, coarse, ratio in zip(counts, counts[1:], ratios))


def with_other_way(parts: dict[str, Part], values: dict, energy: float,
                   given: set[str], coarsest: bool = False) -> dict[str, Part]:
    """The `parts` of `values`, no less than the square of the relative error in `energy` but for
    places and pressures; what loads have `given` has no part in it.

    `coarsest`: it is the coarsest mesh alone. The finer ones then differ by a part of what elements
    across make, and what they agree on errs by less: between both.
    """
    square = (energy / SEES) ** 2

    def least(name: str) -> float:
        size, error = square * abs(values[name]), parts[name].error
        return min(size, BETWEEN * np.sqrt((error or 0.0) * size)) if coarsest else size

    wide = {name for name in parts.keys() - given if QUANTITIES[name].kind != LOCAL}
    wide |= {"slip"} & parts.keys()  # a displacement
    return parts | {name: located(parts[name], float(least(name))) for name in wide}
