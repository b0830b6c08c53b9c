"""Friction coefficients that a slip law gives while slip is within limits, for searches of states.

A law is piecewise linear in the sum of a node's slip, or in its displacement; over an interval it
is between its least and its largest value at the ends and at the points of the table in between.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SlipLimits:
    """The law of n nodes in a step, in the units of the search.

    `table`, `values` (k,): the factor of the coefficient by what the law depends on; `own` (n,) the
    coefficients that it multiplies; `unit` (n,) the way of a slip of one. `before` (n,): the sum of
    slip (`travelled`) or the displacement that a node has where it does not slide in the step.
    """

    table: np.ndarray
    values: np.ndarray
    own: np.ndarray
    unit: np.ndarray
    before: np.ndarray
    travelled: bool

    def at(self, slip: np.ndarray) -> np.ndarray:
        """(n,) coefficients after a slip (n,)."""
        least, _ = self.within(slip, slip)
        return least

    def end(self, node: int) -> float:
        """Slip of a node, either way, from which its coefficient no longer changes."""
        return (self.table[-1] + abs(self.before[node])) / self.unit[node]

    def within(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) least and largest coefficients with slip between `low` and `high` (n,)."""
        start = np.zeros(len(low)) if self.travelled else self.before
        low, high = start + low * self.unit, start + high * self.unit
        near = np.where((low < 0) & (high > 0), 0.0, np.minimum(np.abs(low), np.abs(high)))
        far = np.maximum(np.abs(low), np.abs(high))
        if self.travelled:
            near, far = near + self.before, far + self.before
        ends = np.interp([near, far], self.table, self.values)
        met = (self.table > near[:, None]) & (self.table < far[:, None])
        least = np.minimum(ends.min(axis=0), np.where(met, self.values, np.inf).min(axis=1))
        most = np.maximum(ends.max(axis=0), np.where(met, self.values, -np.inf).max(axis=1))
        return self.own * least, self.own * most
