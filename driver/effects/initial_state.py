"""A displacement u_0 of the body at time 0, from which the first step's slip is measured."""

import numpy as np

from . import Effect, RunFacts, entry


class Room(Effect):
    """Nodal columns: the components of u_0 at the contact nodes, between bodies of their jump."""

    def initial_displacement(self, contact) -> np.ndarray:
        """(n_c,) u_0 . t."""
        initial = np.column_stack([contact.columns["initial_x"], contact.columns["initial_y"]])
        return (initial * contact.tangent).sum(axis=1)

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Matters where friction slides."""
        if not facts.initial:
            return {}
        active = facts.most("slip") > 0 if facts.steps else None
        return {"initial_state": entry(active, "friction starts from it")}
