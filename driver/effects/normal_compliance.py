"""Rough surfaces, which yield under pressure: p = c (u_n - g)_+.

The Signorini conditions with the closure p / c of the asperities added to the gap,

    u_n - lambda_n / (c w) <= g,      lambda_n >= 0,      one of them an equality,

w the node's weight: a diagonal of the dual operator. So the step stays the same kind of QP, and
multipliers exist whatever c is. See Kikuchi, Oden, Contact Problems in Elasticity, SIAM 1988,
chapter 11.
"""

import numpy as np

from . import ESTIMATE, Effect, RunFacts, entry


class Room(Effect):
    """A nodal column: the asperities' stiffness per area, zero where the surface is smooth."""

    summary = {"normal_compliance": True}
    estimates, why = ESTIMATE, "the bound does not include the energy of asperities"

    def yields(self, contact) -> np.ndarray:
        """(n_c,) whether the surface is rough."""
        return contact.columns["normal_compliance"] > 0

    def compliance(self, contact) -> np.ndarray | None:
        """(n_c,) 1 / (c w); with an exponent the law is followed by tangents instead."""
        if "compliance_exponent" in self.manifest.rooms:
            return None
        stiffness = contact.columns["normal_compliance"] * contact.weight
        return np.divide(1.0, stiffness, out=np.zeros(len(stiffness)), where=stiffness > 0)

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node touched: what is open does not know it."""
        return {"normal_compliance": entry(*facts.touched())}
