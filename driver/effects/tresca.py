"""Friction with a given bound (Tresca): |sigma_t| <= g, whatever the pressure is."""

import numpy as np

from .friction import FrictionLaw


class Room(FrictionLaw):
    """Tangential rows with a given bound."""

    summary = {"friction": "tresca"}

    def friction_offset(self, contact) -> np.ndarray:
        """(n_c,) g times the length of the node's dual segment."""
        return contact.columns["tresca"] * contact.weight
