"""The contact problem for given gluing multipliers.

Among all multipliers with the gluing ones kept, those of the contact rows that minimise the QP's
functional solve a box problem with F_cc, which costs next to nothing (see contact_block.py). As it
holds all bounds and nearly all of the coupling along the contact boundary, contact zones move in it
over any number of nodes at once, and what is left to products with F is the answer of the gluing.
"""

import numpy as np

from ..feti.deflation import Deflation
from ..feti.dual_problem import DualProblem
from ..qp.box import clipped, projected_gradient
from ..qp.mprgp import mprgp

REDUCTION = 0.1  # of the residual: the gluing's answer spoils more than that
LIMIT = 1000  # products with F_cc
# of them at most for more than that: F_cc costs as much as F there, and a step in vain a few of F
MORE = 10


class ContactRelaxation:
    """Minimises over the contact multipliers. Collective."""

    def __init__(self, operator: DualProblem, deflation: Deflation, norm_bound: float,
                 scale: np.ndarray, history):
        """`scale` (owned,) of MPRGP and `norm_bound` of F in it, which bounds F_cc as well.

        Products with F_cc are counted in the History `history`.
        """
        self.operator, self.deflation, self.norm_bound = operator, deflation, norm_bound
        self.scale, self.contact_scale = scale, deflation.block.gather(scale)
        self.history = history
        self.whole = len(operator.structure.at_contact.row) == operator.structure.dual_dofs

    def __call__(self, y: np.ndarray, gradient: np.ndarray, limits, tol: float,
                 known: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
        """Feasible multipliers (owned,) and their gradient, from any y with its gradient.

        The box problem is solved until its residual is a tenth of the whole residual or `tol`.
        Without gluing rows, whose answer would spoil it, a few products more go to a tenth of the
        `known` residual of feasible multipliers that these are to better: where compliances differ
        much, y may be far outside the box and the residual at its nearest point huge. The gradient
        is right on the contact rows only. MPRGP never raises f: where it does not get that far, the
        answer is poorer but still one.
        """
        block = self.deflation.block
        before, g, lower, upper = block.gathered(y, gradient, *limits)
        start = clipped(before, lower, upper)
        g = g + block.apply(start - before)
        projected = projected_gradient(start, g, lower, upper)
        scaled = self.scale * block.scatter(projected, gradient)
        residual = np.sqrt(self.operator.dot(scaled, scaled))
        asked, load = [(residual, LIMIT)], block.apply(start) - g
        if self.whole and known < residual:
            asked.append((known, MORE))
        for size, most in asked:
            result = mprgp(block.apply, load, lower, upper, start, tol=max(tol, REDUCTION * size),
                           norm_bound=self.norm_bound, preconditioner=self.deflation.contact,
                           max_products=most, gradient0=g, expansion="cg",
                           scale=self.contact_scale)
            self.history.counts["contact_block_products"] += result.products
            start, g = result.x, result.gradient
        return block.scatter(start, y), block.scatter(g, gradient)

    def relaxed(self, y: np.ndarray, gradient: np.ndarray, known: float, limits,
                tol: float) -> np.ndarray:
        """The multipliers alone."""
        return self(y, gradient, limits, tol, known)[0]

    def moved(self, x: np.ndarray, before: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Contact rows' gradient at x from that at `before` with other contact multipliers."""
        block = self.deflation.block
        x, before, own = block.gathered(x, before, gradient)
        return block.scatter(own + block.apply(x - before), gradient)
