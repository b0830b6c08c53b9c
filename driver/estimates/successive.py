"""The mesh's part of the error of a run from others on coarser meshes, as a search makes them."""

from ..energy_norm.energy import of_level
from ..energy_norm.torn_body import Gather, gather_body
from . import adjoint, unresolved
from .budget import Part
from .free_peak import Peaks
from .levels import Level
from .mesh_part import MeshPart


def mesh_parts(problems: list, levels: list[Level], ratios: list[float], name: str,
               estimator: str, others: bool = False) -> dict[str, Part]:
    """Part by quantity of the first of `levels`, runs of the `problems`; collective.

    The other ones are of ever coarser meshes, whose elements are `ratios` times as long as those
    before. An adjoint problem holds the quantity `name` alone, which a search goes by, or, for
    `others`, each of these that has one; `estimator`: of the error in energy.
    """
    problem, finest = problems[0], levels[0]
    values = [level.values for level in levels]
    good = unresolved.alike(list(zip(values, values[1:])))
    alike = levels[:len(good) + 1]
    held = {q: value for q, value in finest.values.items() if (q == name) != others}
    adjoints = adjoint.assess(problem, finest.record, finest.steps[finest.at], held,
                              lambda: gather_body(Gather(problem.operator)))
    if finest.energy is None:
        finest.energy = of_level(problem, finest, estimator)
    peaks = [Peaks.of_level(level) for level in alike] if good else []
    return MeshPart(problem, finest.record, adjoints, finest.energy).by(
        good, ratios, problems[:len(alike)], [level.touch for level in alike[1:]],
        list(zip(peaks, peaks[1:])), name)
