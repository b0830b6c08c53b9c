"""What friction keeps from step to step at the tangential rows."""

import numpy as np

from ..contact.rows import ContactRows


class SlipState:
    """Tangential displacements `u_t` (j,) of the last step, from which the next slip is measured.

    Friction coefficients that depend on slip or displacement are renewed in `rows`.
    """

    def __init__(self, rows: ContactRows, effects, initial: np.ndarray):
        """`initial` (n_c,): tangential displacement of the contact nodes at time 0."""
        self.rows, self.effects, self.coefficient = rows, effects, rows.coefficient
        self.u_t = initial[rows.tangential_node]

    def renew_coefficient(self, gradient: np.ndarray) -> None:
        """Friction coefficients at the tangential displacements of the latest iterate."""
        if self.effects.coefficient_changes:
            u_t = self.u_t - gradient[self.rows.tangential]
            factor = self.effects.coefficient_factor(self.rows.tangential_node, u_t, self.u_t)
            self.rows.coefficient = self.coefficient * factor

    def advance(self, gradient: np.ndarray) -> None:
        """A step ends with this gradient."""
        slip = -gradient[self.rows.tangential]
        self.u_t = self.u_t + slip
        self.effects.step_ends(self.rows.tangential_node, slip)
