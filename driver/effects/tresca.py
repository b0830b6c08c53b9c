"""Friction with a given bound (Tresca): |sigma_t| <= g, whatever the pressure is."""

import numpy as np

from . import Effect, RunFacts
from .friction import QUANTITIES, slip_entry


class Room(Effect):
    """Tangential rows with a given bound."""

    frictional, quantities = True, QUANTITIES

    def summary(self) -> dict:
        """Friction is Tresca's."""
        return {"friction": "tresca"}

    def friction_offset(self, contact) -> np.ndarray:
        """(n_c,) g times the length of the node's dual segment."""
        return contact.columns["tresca"] * contact.weight

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node slid."""
        return {"friction": slip_entry(facts)}
