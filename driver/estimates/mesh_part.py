"""The mesh's part of the error of a run: what coarser meshes tell, held by adjoint problems, and
what neither tells.

Runs and searches claim by the same rules; they differ in the coarser meshes that they have.
"""

from functools import partial

from ..validity import soundness
from . import unresolved
from .budget import Part
from .caution import Caution
from .given import by_loads
from .mesh_counts import contact_ratios
from .one_way import one_way, with_other_way
from .polygons import stand_for_curves


class MeshPart:
    """What is known of a run without its coarser meshes."""

    def __init__(self, problem, record, adjoints: tuple[dict, dict], energy: dict | None,
                 adapted: bool = False):
        """`record` of the run of `problem`, `adjoints` as of adjoint.assess, `energy` the entry of
        energy.report; `adapted`: meshes are refined where errors are large. Collective.
        """
        self.values, at = record.quantities()
        self.touch, self.singular = record.touch(at), record.singular_places()
        self.loads = by_loads(problem.operator, record, self.values, at)
        (sizes, said), error = adjoints, unresolved.energy_error(energy)
        smoothed, self.adjoint = said.get("smoothed"), bool(sizes)
        self.caution = Caution.of(problem, self.touch, sizes, error, adapted,
                                  stand_for_curves(problem),
                                  unresolved.seen(energy, smoothed, at + 1), self.loads.anywhere)
        self._unknown = partial(unresolved.parts, self.values, error, self.touch,
                                problem.manifest.element, bool(sizes),
                                unresolved.blind(energy, smoothed, at + 1))

    def by(self, pairs: list, ratios: list[float], problems: list, touches: list,
           peaks: list, goal: str = "") -> dict[str, Part]:
        """Part by quantity, from `pairs` of values on a finer and a coarser mesh, finest first.

        Elements of a mesh are `ratios` times as long as those of the one before, by their sizes;
        `problems` are those of all meshes that count, `touches` as of Record of the coarser ones,
        `peaks` as Caution.beside takes them. A `goal` that is searched for goes on from errors of
        any size.
        """
        touches, values = [self.touch, *touches], self.values
        lost, sizes = [soundness.lost(problem) for problem in problems], ratios
        if not self.caution.adapted:
            ratios = contact_ratios(problems, ratios)
        found = self.caution.parts(values, pairs, ratios, self.singular, touches, lost)
        if not (self.caution.adapted or self.adjoint) and one_way(problems, sizes):
            given = unresolved.of_loads(values, found, self.loads)
            coarsest = not one_way(problems[:2], sizes)
            found = with_other_way(found, values, self.caution.energy, given, coarsest)
        if pairs:
            found["displacement"] = self.caution.beside(
                found["displacement"], values["displacement"], peaks, touches, ratios)
        # of adapted meshes it is not known how long elements at the corner are
        left = 0.0 if self.caution.adapted else unresolved.halvings(touches, ratios)
        if left:
            found = unresolved.of_corners(found, pairs[0], ratios[0], left)
        claimed = unresolved.claimable(found, values, self.touch.nodes > 0,
                                       pairs[0][1] if pairs else None)
        if goal:
            claimed[goal] = found[goal]
        return unresolved.known(claimed, self._unknown(corners=left > 0), values, self.loads)

    def given(self, parts: dict[str, Part]) -> set[str]:
        """Resultants that the loads give, whatever the mesh, of `parts` as of `by`."""
        return unresolved.of_loads(self.values, parts, self.loads)
