"""Local Coulomb friction: |sigma_t| <= F |sigma_n|, equal and against the slip of sliding nodes."""

import numpy as np

from ..text import counted
from . import Effect, RunFacts, entry


def slip_entry(facts: RunFacts) -> dict:
    """Ledger entry of a friction law: active where any node slid."""
    (active, reason), stuck = facts.slipped(), facts.most("stick")
    if active is False:
        still = f"{reason} ({counted(stuck, 'node')} stuck at most)"
        reason = still if stuck else "nothing touched"
    return entry(active, reason, facts.sizes["dual_tangential"], facts.seconds["friction"])


class FrictionLaw(Effect):
    """What all friction laws share: tangential rows, their quantities and their ledger entry."""

    frictional, quantities = True, ("tangential_resultant", "slip", "dissipated_energy")

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node slid."""
        return {"friction": slip_entry(facts)}


class Room(FrictionLaw):
    """Tangential rows whose bound follows the pressure."""

    summary = {"friction": "coulomb"}

    def friction_coefficient(self, contact) -> np.ndarray:
        """(n_c,) F, the mean over the node's dual segment."""
        return contact.columns["friction"]
