"""The condensed contact problem, where successive approximations would take longer.

An iteration of the fixed point changes pressures and friction bounds by a factor less than the one
before and takes some products with F: so many are to come until the tolerance. To eliminate the
gluing rows and corners (feti/fronts.py) has a price in products that follows from sizes alone;
then Newton's method on the contact rows (P. Alart, A. Curnier, CMAME 92 (1991) 353-375) ends in a
solution at once, or after successive approximations on these rows alone. What is cheaper is done:
where subdomains have nothing in common and the price is one that successive approximations hardly
stay below, at once. Once eliminated, they are so for the steps to come, which begin with Newton's
method. It is decided from counts and from what a checkpoint keeps: neither ranks nor an
interruption change it.
"""

import functools

import numpy as np

from ..errors import NotConverged
from ..feti.gathering import by_first
from ..qp import one_solution
from ..qp.contraction import contraction
from ..qp.box import projected_gradient
from . import globalization
from .condensation import Condensation
from .friction_qp import FrictionQP
from .slip import SlipState
from .step import WINDOW, Load, Trace
from .uniqueness import DOUBTFUL_FRICTION

SEEN = 3  # changes from which the next ones are extrapolated
FASTEST, SLOWEST = 0.05, 0.9  # factors between changes that this relies on
LEAST = 120  # products to come below which little is to be gained: a few hundredths of a second
SPENT = 30  # products before which the first changes say little of the later ones
# products that elimination may take to come first. The fixed point takes 50 to 200, and each as
# long again and again for what goes with it: preconditioner, relaxation of the contact rows. With
# 40 dual rows 20 steps take 0.03 s in place of 0.11 s, with 700 0.4 s in place of 4.5 s; one step
# with 33,000 (price 250) 6 s in place of 12, with 43,000 (price 340) 11 s in place of 20
AT_ONCE = 400
# dual rows from which it may be so for a rectangle cut into pieces alike, too: with fewer these are
# the example of the publications, whose products with F stand beside theirs
PUBLISHED = 300
FACTORIZATIONS = 6  # that Newton's method may take
# multiplications that a product of the contact rows' relaxation takes, over those with their matrix
# alone: most go with a preconditioner of a face of its own. Of 690 rows 3.9, of 2,401 rows 2.8
RELAXED = 3.0
# such products that go with one with F at least: 20 and 45 in these scenes, where nearly all dual
# rows are those of contact; there Newton's factorizations may take as much more, up to so many
# rows, whose four matrices take 2 GiB
BESIDE, DENSE = 10, 2**13
PASSES = 3  # of Newton's method: products show what rounding has left
# of them where that is about the tolerance, below which it comes now and then, and times that up to
# which it may be: a pass takes some products, to go on without them hundreds
MORE, ABOUT = 12, 10.0


class Shortcut:
    """Of one fixed point. Collective."""

    def __init__(self, qp: FrictionQP, bodies, slip: SlipState, condensation: Condensation):
        """`bodies` as FixedPoint takes them."""
        self.qp, self.rows, self.bodies = qp, qp.rows, bodies
        self.slip, self.condensation = slip, condensation

    @property
    def possible(self) -> bool:
        """Whether the problem is the same one in all iterations and there is room to condense it.

        And it has one solution: of several Newton's method may find another one, and motions that
        rows hardly feel it would obey to the last digit (`FreeBodies.settle` does not). Where
        friction needs no pressure the state of a corner says where it acts, and a body that moves
        freely could be anywhere: it is to move as little as it may.
        """
        moves = self.rows.corners is not None and self.qp.operator.modes > 0
        if not self.condensation.size or moves and self.rows.offset is not None:
            return False
        elimination = self.condensation.elimination
        if elimination is None or not elimination.fits or self.condensation.hardly_felt:
            return False
        if self.slip.effects.coefficient_changes and not self.slip.suspended:
            return False
        return self.condensation.coefficient.max(initial=0.0) <= DOUBTFUL_FRICTION

    def begins(self, load: Load, trace: Trace, x: np.ndarray, gradient: np.ndarray,
               rtol: float) -> bool:
        """Whether approximations are to start from its solution.

        Not where x (owned,) and its `gradient` are one, with bodies balanced to `rtol`: loads that
        only grow may have predicted it.
        """
        known = self.condensation.eliminated if trace.shortcut is None else trace.shortcut
        first = trace.shortcut is None and not known and self.comes_first
        if not (first or known and self.possible):
            return False
        return self.qp.left(x, gradient) > self.qp.tol or self.bodies.imbalance(load, x) > rtol

    @property
    def comes_first(self) -> bool:
        """Whether already the first step begins with elimination."""
        return self._cheaper and self.possible

    @functools.cached_property
    def _cheaper(self) -> bool:
        """Whether sizes alone tell that elimination is cheaper than successive approximations."""
        condensation, operator = self.condensation, self.condensation.operator
        if condensation.whole or not condensation.total:
            return False
        if operator.alike and not condensation.junctions:  # equal bricks share more than shape
            return False
        if operator.structure.dual_dofs < PUBLISHED and operator.cut_alike:
            return False
        elimination = condensation.elimination
        if elimination is None:
            return False
        newton = elimination.products(FACTORIZATIONS * condensation.near**3 / 3)
        each = 1 + self._relaxing(BESIDE) if condensation.total <= DENSE else 1.0
        return elimination.price <= AT_ONCE and newton <= 2 * AT_ONCE * each

    def pays(self, trace: Trace, x: np.ndarray, target: float, spent: int, taken: int) -> bool:
        """Whether it is cheaper than to go on until changes are below `target`.

        `spent` are the products with F of the iterations `taken` so far, x (owned,) the latest
        multipliers.
        """
        changes = trace.changes[-WINDOW:]
        early = spent < SPENT or len(changes) < SEEN
        if early or trace.shortcut is not None or not 0 < target < changes[-1]:
            return False
        rate = trace.contraction
        if not rate < 1.0 and len(changes) < WINDOW:  # the first ones may grow
            return False
        rate = min(max(rate, FASTEST), SLOWEST)
        to_come = spent / taken * np.log(target / changes[-1]) / np.log(rate)
        return to_come > LEAST and self.possible and to_come > self._price(self._free(x))

    def patience(self, trace: Trace):
        """Callable (products) -> whether a QP that has taken so many, and what the contact rows'
        relaxation has taken since this call, is to be left for elimination; None if none is.

        So it is once it has cost as much as all of the elimination would: the whole then costs at
        most twice the least (R. Karp, On-line algorithms versus off-line algorithms, 1992).
        """
        if trace.shortcut is not None:
            return None
        counts = self.qp.history.counts
        before = counts["contact_block_products"]

        def gives_up(products: int) -> bool:
            own = counts["contact_block_products"] - before
            return max(products, own) > LEAST and self._outlasts(products, own)

        return gives_up

    def _outlasts(self, products: int, own: int) -> bool:
        """Whether products with F and `own` ones of the contact rows take longer than elimination.
        """
        if not self.possible:
            return False
        spent = products + self._relaxing(own)
        return spent > max(LEAST, self._price(self.condensation.near))

    def _relaxing(self, own: float) -> float:
        """Products with F in the time of `own` ones of the contact rows' relaxation."""
        multiplications = own * RELAXED * self.condensation.total**2
        return self.condensation.elimination.products(multiplications, dense=False)

    def learn(self, x: np.ndarray, spent: int) -> None:
        """Steps to come begin with elimination if the one QP of this took more, `spent` products.

        It has friction bounds that are given, or none, and ended in x (owned,).
        """
        if spent > LEAST and self.possible and spent > self._price(self._free(x)):
            self.condensation.eliminated = True

    def _price(self, free: float) -> float:
        """Products in the time of the elimination, unless it is made, and of Newton's
        factorizations with so many `free` rows.
        """
        elimination = self.condensation.elimination
        newton = elimination.products(FACTORIZATIONS * free**3 / 3)
        return newton if self.condensation.eliminated else elimination.price + newton

    def _free(self, x: np.ndarray) -> float:
        """Rows that press, or stick, in x."""
        bound = self.rows.friction_bound(x)
        stick = np.zeros(len(x))
        stick[self.rows.normal[x[self.rows.normal] > 0]] = 1.0
        stick[self.rows.tangential[np.abs(x[self.rows.tangential]) < bound]] = 1.0
        return self.condensation.gather(stick).sum()

    def solution(self, index: int, load: Load, x: np.ndarray, trace: Trace,
                 rtol: float) -> tuple | None:
        """Multipliers (owned,), gradient and rows that slide of the solution near x; None if none.

        None where Newton's method does not settle: it is local. Then bodies are where they were.
        `index` of the step: it is noted where approximations did not contract. `rtol` is the
        imbalance of bodies to be reached.
        """
        try:
            found = self._found(index, load, x, trace, rtol)
        except NotConverged:
            found = None
        tried = trace.shortcut is None and len(trace.changes) > 0
        if found is not None and tried and trace.contraction >= 1.0:
            trace.fallback = True
            self.qp.history.fallbacks.note(globalization.NEWTON, index)
        trace.shortcut = found is not None
        return found

    def _found(self, index: int, load: Load, x: np.ndarray, trace: Trace,
               rtol: float) -> tuple | None:
        """As `solution`. Raises NotConverged."""
        place, found = self.bodies.place(load), None
        try:
            found = self._passes(index, load, x, trace, rtol)
        finally:
            if found is None:
                self.bodies.bring(load, place)
                load.forget()
        return found

    def _passes(self, index: int, load: Load, x: np.ndarray, trace: Trace,
                rtol: float) -> tuple | None:
        """As `solution`; where rounding is above a tightened tolerance the pass with the least
        residual that meets the one of the step: its residuals say whether it will do.

        Raises NotConverged.
        """
        rows, qp, condensation = self.rows, self.qp, self.condensation
        best, nearest, comm = None, qp.asked, qp.operator.comm
        problem = condensation.problem_by_loads(load)
        condensation.eliminated = True
        for made in range(1, MORE + 1):
            problem.at_work = lambda: qp.history.at_work(index, qp.operator.products)
            start = problem.whole(condensation.gather(x))
            z = by_first(comm, one_solution.only_solution, problem, start)
            if z is None:
                break
            contact, motion = np.split(z, [condensation.size])
            self.bodies.shift(load, motion)
            x = condensation.place(contact, x)
            x, gradient = condensation.glued(load.d, x, qp.operator.apply(x) - load.d)
            bound = rows.friction_bound(x)
            left = qp.size(projected_gradient(x, gradient, *rows.limits_at(len(x), bound)))
            balanced = self.bodies.imbalance(load, x) <= rtol
            if balanced and left <= nearest:
                best, nearest = (x, gradient, rows.sliding(x, bound), self.bodies.place(load)), left
            if balanced and left <= qp.tol:
                if trace.rated and np.isnan(trace.contraction):
                    trace.rate = by_first(comm, contraction, problem, z, WINDOW)
                break
            if made >= PASSES and not qp.tol < left <= ABOUT * qp.tol:
                break
            problem = condensation.problem(load, x, gradient)
        if best is None:
            return None
        self.bodies.bring(load, best[-1])
        return best[:-1]
