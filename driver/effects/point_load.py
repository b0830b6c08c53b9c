"""Forces at vertices of the mesh."""

import numpy as np

from . import NONE, LoadEffect


class Room(LoadEffect):
    """Patterns given at nodes."""

    unlimited = ("displacement",)  # like the logarithm of the element size
    estimates, why = NONE, "under point loads the exact solution has no finite energy"

    def no_estimate(self, weights: np.ndarray) -> str:
        """The reason, in steps in which any point load acts."""
        return self.why if np.any(weights[self.patterns]) else ""
