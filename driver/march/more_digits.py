"""Steps that rounding keeps from ending, solved anew by refined displacements.

Products with F round off parts of the largest displacements: of slender bodies, whose loads alone
would bend them far beyond what contact lets them, of bodies on soft springs, of stiff ones beside
soft ones. Displacements refined in extended precision show what is left, and contact rows are
corrected by increments (condensed_search.py).
"""

from .step import Load, Trace, Unfinished


class MoreDigits:
    """Of one run. Collective.

    `needed`: steps begin with refined displacements, as the one before needed them.
    """

    def __init__(self, march):
        """`march`: the QuasistaticSolver whose steps they are."""
        self.march, self.needed = march, False

    @property
    def may_help(self) -> bool:
        """Whether a step may be solved anew.

        Not where it has been by refined displacements, nor where tangents of laws have changed its
        load.
        """
        return not (self.march.operator.uneven or self.march.effects.closes)

    @property
    def likely(self) -> bool:
        """Whether rounding alone is likely to keep residuals up that fail by little.

        Beside much stiffer bodies their few digits may be all there are.
        """
        return self.may_help and not self.march.operator.bodies_differ

    def settled(self, index: int, load: Load, start: tuple, trace: Trace) -> tuple:
        """What the march's closure settles from `start` (multipliers, gradient, rows that slide),
        anew to more digits where it fails by little, or beside much stiffer bodies.

        Raises Unfinished.
        """
        march, place, first = self.march, self.march.fixed_point.place(load), start
        if not self.needed:
            try:
                return march.closure.settled(index, load, start, trace, march.solve)
            except Unfinished as failed:
                differ = march.operator.bodies_differ
                if not (self.may_help and (failed.near or differ)):
                    raise
                if differ:
                    start = march.fixed_point.back(load, place, start)
                else:
                    bound = march.rows.friction_bound(failed.x)
                    start = failed.x, failed.gradient, march.rows.sliding(failed.x, bound)
            self.needed = not differ  # beside stiff bodies other loads may need it no more
        with march.condensation.refined():
            try:
                return march.closure.settled(index, load, start, trace, march.solve)
            except Unfinished as failed:
                if not (failed.near and self.needed):
                    raise
            # so near to what is asked for another way there may do: that from the first start
            start = march.fixed_point.back(load, place, first)
            return march.closure.settled(index, load, start, trace, march.solve)
