"""Bodies that supports hold and surfaces that do not yield: interfaces with nothing to do.

Those of free_bodies.py and of closure.py.
"""

import numpy as np


class SupportedBodies:
    """No rigid motion is free: every equilibrium is the elastic body's own."""

    placed = np.zeros((0, 3))  # see FreeBodies

    def can_rest(self, index: int, weights: np.ndarray,
                 last: np.ndarray | None = None) -> np.ndarray:
        """No motion (0,)."""
        return np.zeros(0)

    def secants(self) -> None:
        """Nothing to combine."""

    def shift(self, load, change: np.ndarray) -> float:
        """No motion, no change of d."""
        return 0.0

    def place(self, load) -> np.ndarray:
        """No motion (0,)."""
        return np.zeros(0)

    def bring(self, load, place: np.ndarray) -> float:
        """No motion, no change of d."""
        return 0.0

    def imbalance(self, load, x: np.ndarray) -> float:
        """Supports balance everything."""
        return 0.0

    def settle(self, load, x: np.ndarray, gradient: np.ndarray) -> float:
        """Nothing to move, no change of d."""
        return 0.0

    def note_loose_motion(self, index: int, x: np.ndarray) -> None:
        """No motion is loose."""


class RigidSurfaces:
    """No node yields by a law of its own: the step's equations are all there is."""

    worn = 0.0

    def begin_step(self, moving: bool, slides: bool = True) -> None:
        """Nothing has worn away."""

    def yielded(self, x: np.ndarray) -> float:
        """No closure."""
        return 0.0

    def settled(self, index: int, load, start: tuple, trace, solve):
        """What `solve` finds."""
        return solve(index, load, *start, trace)
