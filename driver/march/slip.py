"""What friction keeps from step to step at the tangential rows."""

import numpy as np

from ..contact.kkt import Scales
from ..contact.rows import ContactRows
from ..feti.dual_problem import DualProblem

FAR = 1e4  # travel over a step, relative to the deformation, that costs slip four digits


class SlipState:
    """Tangential displacements of the last step, from which the next slip is measured.

    They are `elastic` (j,) and those of the rigid motions of whole bodies, prescribed and free,
    with the factors `weights` (patterns + modes,): kept apart, since increments of motions are
    exact where their sums have lost the digits of the deformation. Friction coefficients that
    depend on slip or displacement are renewed in `rows`. `way` (j,) is that of the surfaces of
    moving obstacles in the step at hand, `travelled` (j,) that in all steps before, 0 where none
    moves: laws see displacements relative to the surface.
    """

    def __init__(self, operator: DualProblem, rows: ContactRows, effects, initial: np.ndarray):
        """`initial` (n_c,): tangential displacement of the contact nodes at time 0."""
        self.operator, self.rows, self.effects = operator, rows, effects
        self.coefficient = rows.coefficient
        self.elastic = initial[rows.tangential_node]
        self.weights = np.zeros(operator.structure.patterns + operator.modes)
        self.way: np.ndarray | float = 0.0
        self.travelled: np.ndarray | float = 0.0
        self.suspended = False  # whether an equilibrium without friction is looked for

    @property
    def u_t(self) -> np.ndarray:
        """(j,) tangential displacements at the end of the last step."""
        return self.elastic + self._carried(self.weights)

    def _carried(self, weights: np.ndarray) -> np.ndarray:
        """(j,) tangential displacements by rigid motions with the factors `weights`."""
        return self.operator.rigid_response(weights)[self.rows.tangential]

    def renew_coefficient(self, gradient: np.ndarray) -> None:
        """Friction coefficients at the tangential displacements of the latest iterate."""
        if self.effects.coefficient_changes:
            last = self.u_t - self.travelled  # where a node is on the surface before the step
            u_t = last - gradient[self.rows.tangential]
            factor = self.effects.coefficient_factor(self.rows.tangential_node, u_t, last)
            self.rows.coefficient = self.coefficient * factor

    def largest_coefficient(self) -> np.ndarray | None:
        """(j,) the largest friction coefficients that the step at hand may end with."""
        if not self.effects.coefficient_changes:
            return self.rows.coefficient
        return self.coefficient * self.effects.largest_factor(self.rows.tangential_node)

    def advance(self, x: np.ndarray, gradient: np.ndarray, weights: np.ndarray,
                scales: Scales) -> np.ndarray:
        """A step ends with multipliers x, their gradient and the factors `weights`; collective.

        Returns its slip (j,). Travel that has taken digits of it costs a product to bring them
        back.
        """
        op, slip = self.operator, -gradient[self.rows.tangential]
        carried = self._carried(weights - self.weights) - self.way
        self.elastic = self.elastic + slip - carried
        if op.minimum(-float(np.abs(carried).max(initial=0))) < -FAR * scales.displacement:
            moved = op.elastic_response(weights) - op.apply(x)
            self.elastic = moved[self.rows.tangential]
        self.weights = weights.copy()
        return slip
