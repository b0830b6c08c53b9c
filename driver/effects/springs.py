"""Springs: elastic foundation of boundaries (Winkler), springs at points."""

from . import ESTIMATE, Effect, RunFacts, entry


class Room(Effect):
    """Springs at nodes, which scene/springs.py puts into the stiffness of the subdomains."""

    labelled = True
    summary = {"springs": True}
    estimates, why = ESTIMATE, "stresses in equilibrium have no part for what springs carry"

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active in every step: springs follow any displacement."""
        return {"springs": entry(*facts.in_every_step("springs follow every displacement"))}
