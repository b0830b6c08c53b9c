"""A friction coefficient that depends on the accumulated slip or on the tangential displacement."""

import numpy as np

from ..errors import InputError
from . import Effect


class Room(Effect):
    """Factor of the coefficient, tabulated at equal steps over [0, range], constant beyond.

    `argument` is "slip" (accumulated slip) or "displacement" (|u_t|).
    """

    changes_coefficient = True
    summary = {"friction": "coulomb-slip-dependent"}

    def __init__(self, name: str, manifest):
        super().__init__(name, manifest)
        try:
            self.argument, values = self.data["argument"], np.array(self.data["values"], float)
            reach = float(self.data["range"])
            sound = self.argument in ("slip", "displacement") and 0 < reach < np.inf
        except (TypeError, ValueError, KeyError):
            sound = False
        if not (sound and values.ndim == 1 and len(values) > 1 and np.isfinite(values).all()):
            raise InputError("slip_law must have argument, a positive range and finite values; run "
                             "the scene again")
        self.values, self.arguments = values, np.linspace(0.0, reach, len(values))
        if values.min() < 0:
            raise InputError("the factor of the friction coefficient is negative at "
                             f"{self.argument} {self.arguments[values.argmin()]:g}")

    def prepare(self, contact) -> None:
        """Nothing has slid."""
        self.accumulated = np.zeros(len(contact.gid))

    def coefficient_factor(self, nodes, u_t, last) -> np.ndarray:
        """(j,) factors; see Effect."""
        if self.argument == "displacement":
            return np.interp(np.abs(u_t), self.arguments, self.values)
        slid = self.accumulated[nodes] + np.abs(u_t - last)
        return np.interp(slid, self.arguments, self.values)

    def largest_factor(self, nodes) -> np.ndarray:
        """(j,) of any displacement, or of any slip beyond that so far; see Effect."""
        if self.argument == "displacement":
            return np.full(len(nodes), self.values.max())
        to_come = np.maximum.accumulate(self.values[::-1])[::-1]  # at the arguments
        slid = self.accumulated[nodes]
        beyond = np.searchsorted(self.arguments, slid, side="right")
        return np.maximum(np.interp(slid, self.arguments, self.values),
                          np.append(to_come, self.values[-1])[beyond])

    def carried(self) -> dict[str, np.ndarray]:
        """The accumulated slip."""
        return {"accumulated_slip": self.accumulated}

    def step_ends(self, nodes: np.ndarray, slip: np.ndarray, force: np.ndarray) -> None:
        """Slip adds up."""
        self.accumulated[nodes] += np.abs(slip)
