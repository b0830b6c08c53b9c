"""Rough surfaces that yield by a power of the pressure: p = c (u_n - g)_+^m.

c is normal_compliance's, with stress per length^m. The law is followed by Newton's method
(march/closure.py): about the closure where m >= 1, where the pressure is a smooth and convex
function of it, about the pressure where m < 1. Tangents at closures that are nothing beside the
largest would have no slope, or an infinite one: they are taken at FLOOR of it, which changes the
way to the solution and not the solution.
"""

import numpy as np

from ..errors import InputError
from . import ESTIMATE, Effect, RunFacts

FLOOR = 1e-3  # part of the largest closure below which tangents are steeper than the law


class Room(Effect):
    """A nodal column: the exponent m > 0."""

    closes = True
    estimates, why = ESTIMATE, "the bound does not include the energy of asperities"

    def prepare(self, contact) -> None:
        """Law of the nodes: p = c z^m; c = 0 is a smooth surface.

        Raises InputError where contact can pull.
        """
        self.c, self.m = contact.columns["normal_compliance"], contact.columns[self.name]
        if np.any((contact.columns.get("bilateral", 0) > 0) & (self.c > 0) & (self.m != 1)):
            raise InputError("bilateral contact where normalComplianceExponent is not 1: a power "
                             "law of the closure is not defined for tension; leave out one of them "
                             "there")
        self.weight = contact.faced

    def about(self, contact) -> None:
        """Weights are those that face anything."""
        self.weight = contact.faced

    def closure(self, nodes, force, slip) -> np.ndarray:
        """(k,) (p/c)^(1/m); of contact that pulls, where m is 1, below zero."""
        c, yields = self.c[nodes], self.c[nodes] > 0
        ratio = np.divide(force / self.weight[nodes], c, out=np.zeros(len(nodes)), where=yields)
        exponent = np.divide(1.0, self.m[nodes], out=np.ones(len(nodes)), where=yields)
        return np.where(exponent == 1, ratio, np.maximum(ratio, 0.0) ** exponent)

    def _about(self, nodes, force, own) -> np.ndarray:
        """(k,) closures to take tangents about."""
        by_force = (self.m[nodes] < 1) | (own <= 0) & (force > 0)
        return np.where(by_force, self.closure(nodes, force, own), np.maximum(own, 0.0))

    def reach(self, nodes, force, own) -> float:
        """The largest closure."""
        return float(self._about(nodes, force, own).max(initial=0.0))

    def tangent(self, nodes, force, own, slip, reach) -> tuple[np.ndarray, np.ndarray]:
        """Closure as a function of the force, about closures z no less than FLOOR of `reach`.

        A linear law is its own tangent, about any.
        """
        z, slope, offset = self._about(nodes, force, own), *np.zeros((2, len(nodes)))
        linear = self.m[nodes] == 1
        here = np.flatnonzero((self.c[nodes] > 0) & (linear | (np.maximum(z, FLOOR * reach) > 0)))
        c, m, z = self.c[nodes][here], self.m[nodes][here], z[here]
        stiffness = c * m * np.maximum(z, FLOOR * reach) ** (m - 1)  # 0^0 is 1
        slope[here] = 1.0 / (stiffness * self.weight[nodes][here])
        offset[here] = z - c * z**m / stiffness
        return slope, offset

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """That of normal compliance."""
        return {}
