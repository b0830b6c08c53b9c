"""The mesh's part of the error of a run from others on coarser meshes, as a search makes them."""

from . import adjoint, soundness, unresolved
from .budget import Part
from .caution import Caution
from .energy import of_level
from .free_peak import Peaks
from .given import by_loads
from .levels import Level
from .polygons import stand_for_curves
from .torn_body import Gather, gather_body


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
    alike = len(good) + 1
    touches = [level.touch for level in levels[:alike]]
    lost = [soundness.lost(of) for of in problems[:alike]]
    held = {q: value for q, value in finest.values.items() if (q == name) != others}
    adjoints, said = adjoint.assess(problem, finest.record, finest.steps[finest.at], held,
                                    lambda: gather_body(Gather(problem.operator)))
    if finest.energy is None:
        finest.energy = of_level(problem, finest, estimator)
    energy = finest.energy
    error = unresolved.energy_error(energy)
    loads = by_loads(problem.operator, finest.record, finest.values, finest.at)
    caution = Caution.of(problem, touches[0], adjoints, error, polygons=stand_for_curves(problem),
                         seen=unresolved.seen(energy, said.get("smoothed"), finest.at + 1),
                         given=loads.anywhere)
    found = caution.parts(values[0], good, ratios, finest.singular, touches, lost)
    if good:
        peaks = [Peaks.of_level(level) for level in levels[:alike]]
        found["displacement"] = caution.beside(
            found["displacement"], values[0]["displacement"], list(zip(peaks, peaks[1:])),
            touches, ratios)
    if left := unresolved.halvings(touches, ratios):
        found = unresolved.of_corners(found, good[0], ratios[0], left)
    # what is asked for goes on from errors of any size
    found = unresolved.claimable(found, values[0], touches[0].nodes > 0) | {name: found[name]}
    unknown = unresolved.parts(values[0], error, touches[0], problem.manifest.element,
                               bool(adjoints),
                               unresolved.blind(energy, said.get("smoothed"), finest.at + 1),
                               left > 0)
    return unresolved.known(found, unknown, values[0], loads)
