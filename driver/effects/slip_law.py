"""A friction coefficient that depends on the accumulated slip or on the tangential displacement.

Slip is the way in contact: what a node goes before it touches, or after it has opened, changes no
surface. Of a step the part counts in which it presses: all of it where it does so at both ends,
half where at one, as in the mean over nodes that touch or open at any time of the step.
"""

import numpy as np

from ..errors import InputError
from . import Effect

LEVEL = 1e-9  # part of the boundary's extent below which a distance is none


class Way:
    """What the nodes (n_c,) of a contact boundary have `slid` in contact; which `pressed` at last.
    """

    def __init__(self, contact):
        """Nothing has slid, and nodes without a distance touch."""
        extent = np.abs(contact.xy - contact.xy[:1]).max(initial=0.0)
        self.slid = np.zeros(len(contact.gid))
        self.pressed = contact.at(0.0).gap <= LEVEL * extent

    def after(self, nodes, slip: np.ndarray, presses: np.ndarray | bool = True) -> np.ndarray:
        """(j,) the way of `nodes` (j,) after a step with this slip (j,), if they press then."""
        part = 0.5 * (self.pressed[nodes].astype(float) + presses)
        return self.slid[nodes] + part * np.abs(slip)

    def add(self, nodes, slip: np.ndarray, force: np.ndarray) -> None:
        """A step ends, with normal forces (j,)."""
        self.slid[nodes] = self.after(nodes, slip, force != 0)
        self.pressed[nodes] = force != 0


class Room(Effect):
    """Factor of the coefficient, tabulated at equal steps over [0, range], constant beyond.

    `argument` is "slip" (accumulated slip) or "displacement" (|u_t|), `missed` by how much the
    factor departs from a straight line between the first two values.
    """

    changes_coefficient = True
    summary = {"friction": "coulomb-slip-dependent"}

    def __init__(self, name: str, manifest):
        super().__init__(name, manifest)
        try:
            self.argument, values = self.data["argument"], np.array(self.data["values"], float)
            reach, self.missed = float(self.data["range"]), float(self.data.get("missed", 0.0))
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
        self.way = Way(contact)

    def of_others(self, contact) -> Way:
        """The way of nodes that have no rows, as supports hold them: a run's results follow it."""
        return Way(contact)

    def coefficient_factor(self, nodes, u_t, last) -> np.ndarray:
        """(j,) factors where they press; see Effect."""
        return self.factor_at(u_t, self.way.after(nodes, u_t - last))

    def factor_at(self, u_t, slid) -> np.ndarray:
        """(n,) factors of any nodes at displacements u_t, after a way `slid` in contact."""
        argument = np.abs(u_t) if self.argument == "displacement" else slid
        return np.interp(argument, self.arguments, self.values)

    def largest_factor(self, nodes) -> np.ndarray:
        """(j,) of any displacement, or of any slip beyond that so far; see Effect."""
        if self.argument == "displacement":
            return np.full(len(nodes), self.values.max())
        to_come = np.maximum.accumulate(self.values[::-1])[::-1]  # at the arguments
        slid = self.way.slid[nodes]
        beyond = np.searchsorted(self.arguments, slid, side="right")
        return np.maximum(np.interp(slid, self.arguments, self.values),
                          np.append(to_come, self.values[-1])[beyond])

    def carried(self) -> dict[str, np.ndarray]:
        """The accumulated slip, and which nodes press."""
        return {"accumulated_slip": self.way.slid, "pressed": self.way.pressed}

    def step_ends(self, nodes: np.ndarray, slip: np.ndarray, force: np.ndarray) -> None:
        """Slip in contact adds up."""
        self.way.add(nodes, slip, force)
