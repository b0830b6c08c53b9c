"""Distance to the rigid obstacle along the normal, or of a pair beyond its geometry."""

import numpy as np

from . import Effect


class Room(Effect):
    """A nodal column; positive, zero or negative. Its ledger entry is contact's."""

    def distance(self, columns: dict[str, np.ndarray]) -> np.ndarray:
        """(n_c,) the declared distance."""
        return columns["gap"]

    def declares(self, paired: np.ndarray) -> np.ndarray:
        """(n_c,) whether the scene gives the distance of nodes, `paired` or of an obstacle."""
        return np.where(paired, self.data["of_pairs"], self.data["of_obstacles"])
