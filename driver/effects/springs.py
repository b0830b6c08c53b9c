"""Springs: elastic foundation of boundaries (Winkler), springs at points."""

from ..errors import InputError
from . import NONE, Effect, RunFacts, entry


class Room(Effect):
    """Springs at nodes, which scene/springs.py puts into the stiffness of the subdomains."""

    summary = {"springs": True}
    estimates, why = NONE, "stresses in equilibrium have no part for what springs carry"

    def __init__(self, name: str, manifest):
        """Raises InputError for labels that the mesh lacks."""
        super().__init__(name, manifest)
        labels = self.data.get("labels")
        if not isinstance(labels, list) or any(k not in manifest.labels for k in labels):
            raise InputError("the labels of springs are none of the mesh")

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active in every step: springs follow any displacement."""
        return {"springs": entry(*facts.in_every_step("springs follow every displacement"))}
