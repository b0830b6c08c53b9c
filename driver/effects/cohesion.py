"""Shear strength that needs no pressure: |sigma_t| <= c + F |sigma_n| (Mohr, Coulomb)."""

import numpy as np

from . import Effect, RunFacts
from .friction import slip_entry


class Room(Effect):
    """Adds a part to the friction bound that does not depend on the pressure, as Tresca's does."""

    summary = {"cohesion": True}

    def friction_offset(self, contact) -> np.ndarray:
        """(n_c,) nodal force: c times the length of the node's dual segment."""
        return contact.columns["cohesion"] * contact.weight

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node slid: below its strength a boundary does not know it."""
        return {"cohesion": slip_entry(facts)}
