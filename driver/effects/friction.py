"""Local Coulomb friction:

|sigma_t| <= F |sigma_n|, with equality and against the slip where a node slides.
"""

import numpy as np

from . import Effect, RunFacts, entry

QUANTITIES = ("tangential_resultant", "slip", "dissipated_energy")


def slip_entry(facts: RunFacts) -> dict:
    """Ledger entry of a friction law: active where any node slid."""
    slipped, stuck = facts.most("slip"), facts.most("stick")
    if slipped:
        active, reason = True, f"{slipped} nodes slipped at most"
    elif not facts.steps:
        active, reason = None, "no step was kept"
    else:
        active = False
        reason = f"nothing slipped ({stuck} nodes stuck at most)" if stuck else "nothing touched"
    return entry(active, reason, facts.sizes["dual_tangential"], facts.seconds["friction"])


class Room(Effect):
    """Tangential rows whose bound follows the pressure."""

    frictional, quantities = True, QUANTITIES

    def summary(self) -> dict:
        """Coulomb's law unless another effect says more."""
        return {"friction": "coulomb"}

    def friction_coefficient(self, contact) -> np.ndarray:
        """(n_c,) F, the mean over the node's dual segment."""
        return contact.columns["friction"]

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node slid."""
        return {"friction": slip_entry(facts)}
