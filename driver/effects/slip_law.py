"""A friction coefficient that depends on the accumulated slip or on the tangential displacement."""

import numpy as np

from ..errors import InputError
from . import Effect


class Room(Effect):
    """Factor of the coefficient, tabulated by the scene at equal steps over [0, range] and constant beyond.

    `argument` is "slip" (length of the way slid so far) or "displacement" (|u_t|).
    """

    changes_coefficient = True

    def __init__(self, name: str, manifest):
        super().__init__(name, manifest)
        self.argument = self.data["argument"]
        self.values = np.asarray(self.data["values"], float)
        self.at = np.linspace(0.0, self.data["range"], len(self.values))
        if self.argument not in ("slip", "displacement"):
            raise InputError(f"slip_law: its argument is {self.argument!r} instead of slip or displacement")

    def summary(self) -> dict:
        """Coulomb friction with a coefficient that depends on slip."""
        return {"friction": "coulomb-slip-dependent"}

    def prepare(self, contact) -> None:
        """Nothing has slid."""
        self.slid = np.zeros(len(contact.gid))

    def coefficient_factor(self, nodes: np.ndarray, u_t: np.ndarray, last: np.ndarray) -> np.ndarray:
        """(j,) factors; see Effect."""
        s = np.abs(u_t) if self.argument == "displacement" else self.slid[nodes] + np.abs(u_t - last)
        return np.interp(s, self.at, self.values)

    def carried(self) -> dict[str, np.ndarray]:
        """The accumulated slip."""
        return {"accumulated_slip": self.slid}

    def step_ends(self, nodes: np.ndarray, slip: np.ndarray) -> None:
        """Slip adds up."""
        self.slid[nodes] += np.abs(slip)
