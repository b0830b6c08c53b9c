"""Wear by Archard's law: where a surface slides under pressure the gap grows by k |slip| p.

Implicit: pressure and slip are those at the end of the step, so that its wear, k |slip| / w per
nodal force, is a diagonal of the dual operator that follows the slip (march/closure.py), w the
node's weight. See Archard, J. Appl. Phys. 24 (1953) 981-988; Stromberg, Johansson, Klarbring, Int.
J. Solids Struct. 33 (1996) 1817-1836.
"""

import numpy as np

from . import ESTIMATE, Effect, RunFacts, entry


class Room(Effect):
    """A nodal column: the wear coefficient k, per stress; between bodies that of both together."""

    closes, quantities = True, ("worn_volume",)
    summary = {"wear": True}
    estimates, why = ESTIMATE, "the bound does not include wear"

    def prepare(self, contact) -> None:
        """Nothing has worn away."""
        self.softness = contact.columns["wear"] / contact.weight
        self.depth = np.zeros(len(contact.gid))

    def worn(self, nodes: np.ndarray) -> np.ndarray:
        """(k,) the depth so far."""
        return self.depth[nodes]

    def closure(self, nodes, force, slip) -> np.ndarray:
        """(k,) wear of a step by `slip` >= 0; contact that pulls wears nothing."""
        return self.softness[nodes] * slip * np.maximum(force, 0.0)

    def tangent(self, nodes, force, own, slip, reach) -> tuple[np.ndarray, np.ndarray]:
        """Proportional to the force, with the slip of the iterate."""
        return self.softness[nodes] * slip * (force > 0), np.zeros(len(nodes))

    def carried(self) -> dict[str, np.ndarray]:
        """The worn depth."""
        return {"worn_depth": self.depth}

    def step_ends(self, nodes: np.ndarray, slip: np.ndarray, force: np.ndarray) -> None:
        """Wear adds up."""
        self.depth[nodes] += self.closure(nodes, force, np.abs(slip))

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """Active where any node slid."""
        return {"wear": entry(*facts.slipped())}
