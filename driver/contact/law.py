"""Laws of friction at contact nodes.

Every one bounds the tangential multiplier by an affine function of the pressure,

    |lambda_t| <= offset + coefficient |lambda_n|:

Coulomb's law has no offset, a given bound (Tresca) no coefficient, a law with cohesion (Mohr,
Coulomb) both.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ContactLaw:
    """Conditions at the contact nodes by the declared effects: arrays (n_c,)."""

    coefficient: np.ndarray | None  # of friction, None where no effect has one
    offset: np.ndarray | None  # nodal force of the friction bound without pressure, likewise
    bilateral: np.ndarray  # bool: contact pulls as well

    def friction_bound(self, pressure: np.ndarray) -> np.ndarray:
        """(n_c,) largest friction forces under nodal pressures (n_c,), forces of any sign."""
        return friction_bound(self, pressure)


def friction_bound(law, pressure: np.ndarray) -> np.ndarray:
    """(n,) bounds under pressures (n,) by the `coefficient` (n,) and `offset` (n,) of `law`."""
    if law.coefficient is None:
        return np.zeros(len(pressure)) if law.offset is None else law.offset
    bound = law.coefficient * np.abs(pressure)
    return bound if law.offset is None else bound + law.offset


def law_at(law, places: np.ndarray) -> np.ndarray:
    """(2, ...) coefficients and offsets at `places` (...) of those of `law`; zero where it has none
    and at the place -1.
    """
    return np.array([np.zeros(places.shape) if values is None else np.append(values, 0.0)[places]
                     for values in (law.coefficient, law.offset)])
