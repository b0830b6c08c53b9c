"""What makes QPs take fewer products: a preconditioner and a relaxation of contact multipliers."""

import numpy as np

from ..feti.contact_block import ContactBlock
from ..feti.deflation import DeflatedPreconditioner, Deflation
from ..feti.dual_problem import DualProblem
from ..options import Settings
from .relaxation import ContactRelaxation


class Accelerators:
    """`preconditioner` and `relaxation`, each None if not asked for. Collective.

    Without gluing too, where the contact block is the whole operator: what a body may do nearly as
    a rigid one, beyond a thin neck or on its clamped end, only deflation knows.
    """

    def __init__(self, operator: DualProblem, settings: Settings, norm_bound: float,
                 scale: np.ndarray, history):
        """`norm_bound`, `scale`, `history`: as ContactRelaxation takes them."""
        choice, relaxed = settings.preconditioner, "contact" in (settings.expansion,
                                                                 settings.corrector)
        # the inverse on a face is at hand where the problem is condensed
        coupled = ((relaxed or choice == "deflated") and len(operator.structure.at_contact.row)
                   and not operator.contact_rows_only)
        self.preconditioner = self.relaxation = self._deflation = None
        self._local = operator.preconditioner() if choice != "none" or coupled else None
        if choice != "none":
            self.preconditioner = self._local
        if coupled:
            block = ContactBlock(operator, self._local)
            self._deflation = Deflation(block, operator.structure)
            if choice == "deflated":
                self.preconditioner = DeflatedPreconditioner(self._local, self._deflation)
            if relaxed:
                self.relaxation = ContactRelaxation(operator, self._deflation, norm_bound, scale,
                                                    history)
        if operator.softness is not None:
            self.soften(operator.softness, norm_bound)

    def soften(self, softness: np.ndarray, norm_bound: float) -> None:
        """Take up a diagonal (owned,) of F, in the place of the one before; collective.

        `norm_bound` is that of F with it.
        """
        for part in (self._local, self._deflation):
            if part is not None:
                part.soften(softness)
        if self.relaxation is not None:
            self.relaxation.norm_bound = norm_bound
