"""Springs: elastic foundation of boundaries (Winkler), springs at points."""

from ..errors import InputError
from ..quantity_table import QUANTITIES
from . import ESTIMATE, Effect, RunFacts, entry

# at a point a body gives way like the logarithm of the element size: with the motions that springs
# there hold, and so with what follows from them, down to the shares of loads among supports
FOLLOWING = tuple(QUANTITIES)


class Room(Effect):
    """Springs at nodes, which scene/springs.py puts into the stiffness of the subdomains."""

    labelled = True
    summary = {"springs": True}
    estimates, why = ESTIMATE, "equilibrated stresses do not include spring forces"

    def __init__(self, name: str, manifest):
        """Raises InputError for labels that the mesh lacks, and where it is not said what there is.
        """
        super().__init__(name, manifest)
        at_points = self.data.get("at_points")
        if not isinstance(at_points, bool):
            raise InputError(f"the manifest does not say where {name} are; run the scene again")
        self.unlimited = FOLLOWING if at_points else ()

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active in every step: springs follow any displacement."""
        return {"springs": entry(*facts.in_every_step("springs follow every displacement"))}
