"""Bodies that supports hold: the interface of effects/free_bodies.py with nothing to do."""

import numpy as np


class SupportedBodies:
    """No rigid motion is free: every equilibrium is the elastic body's own."""

    placed = np.zeros((0, 3))  # see FreeBodies

    def can_rest(self, index: int, weights: np.ndarray) -> np.ndarray:
        """No motion (0,)."""
        return np.zeros(0)

    def secants(self) -> None:
        """Nothing to combine."""

    def shift(self, load, change: np.ndarray) -> float:
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
