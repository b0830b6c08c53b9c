"""A rigid obstacle by a function phi(x, y), positive outside: phi(x) + grad phi . u >= 0."""

import numpy as np

from . import Effect


class Room(Effect):
    """FreeFEM makes normals and distances of the function."""

    def distance(self, columns: dict[str, np.ndarray]) -> np.ndarray:
        """(n_c,) phi/|grad phi|."""
        return columns["obstacle"]
