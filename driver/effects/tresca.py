"""Friction with a given bound (Tresca): |sigma_t| <= g, whatever the pressure is."""

import numpy as np

from .friction import FrictionLaw


class Room(FrictionLaw):
    """Tangential rows with a given bound."""

    def __init__(self, name: str, manifest):
        super().__init__(name, manifest)
        beside = "friction" in manifest.rooms
        self.summary = {"friction": "coulomb and tresca" if beside else "tresca"}

    def friction_offset(self, contact) -> np.ndarray:
        """(n_c,) g times the length of the node's dual segment."""
        return contact.columns["tresca"] * contact.weight
