"""The QP with given friction bounds, solved by MPRGP scaled, preconditioned, relaxed."""

import functools

import numpy as np
from mpi4py import MPI

from ..contact.kkt import Scales
from ..contact.rows import ContactRows
from ..errors import InputError, NoSolution, NotConverged
from ..feti.dual_problem import DualProblem
from ..options import Settings
from ..qp.lanczos import norm_bound
from ..qp.box import projected_gradient
from ..qp.mprgp import Result, mprgp
from ..text import step_name
from .accelerators import Accelerators
from .step import History, Unfinished

ROUNDED = 1e-9  # part of travel below which displacements are its rounding
FINEST = 1e-14  # of the displacements to be overcome: what a product may well round off
NEAR_ROUNDING = 1e2  # times that: it may be as much where stiffness jumps, so it is measured
SPARED = 1e-2  # times that: no tolerance is tightened below, whatever is measured
LINEAR = 200  # products of a linear problem at most
STEADY = 2.0  # times what a product rounds off: two of the same differ by as much


class FrictionQP:
    """Solves one QP after another to the tolerance `tol`, which the time step sets. Collective.

    `bound` is an upper bound of the scaled ||F||; counts and the log of its iterations go to
    `history`.
    """

    def __init__(self, operator: DualProblem, rows: ContactRows, settings: Settings, scales: Scales,
                 history: History, bound: float | None = None):
        """`bound`: that of other contact rows, to be taken as it is."""
        self.operator, self.rows, self.settings = operator, rows, settings
        self.scales, self.history = scales, history
        structure = operator.structure
        self.scale = structure.row_scale
        self.softest = self._softest()
        self.bound = self._bound_norm() if bound is None else bound
        self.tol, self._rigid_bound = 0.0, self.bound
        self._known_bound = self.bound  # which no QP has raised yet

    def soften(self, softness: np.ndarray) -> None:
        """Add a diagonal (owned,) to F, in the place of the one before; collective."""
        op = self.operator
        op.softness = softness
        largest = -op.minimum(-float((self.scale**2 * softness).max(initial=0.0)))
        self.bound = self._known_bound = self._rigid_bound + largest
        if "accelerators" in vars(self):  # else they take it up when they are made
            self.accelerators.soften(softness, self.bound)

    def _softest(self) -> float:
        """The smallest scale of all rows; collective."""
        return self.operator.minimum(float(self.scale.min(initial=1.0)))

    def _bound_norm(self) -> float:
        """Upper bound of the scaled ||F||; the same random start vector for any number of ranks.

        Raises InputError where squares of displacements overflow.
        """
        structure, op = self.operator.structure, self.operator
        known = op.norm_bound(self.scale)
        if known is not None:
            return known
        if structure.dual_dofs == 0:  # one subdomain without contact: nothing to iterate on
            return 1.0
        start = np.random.default_rng(1).standard_normal(structure.dual_dofs)
        try:
            return norm_bound(lambda y: self.scale * op.apply(self.scale * y), op.owned, dot=op.dot,
                              start=start[slice(*structure.row_range)])[0]
        except OverflowError:
            raise InputError("moduli, or the stiffness of rough surfaces, are so small that the "
                             "squares of displacements exceed the largest number, 1.8e308: check "
                             "their values and units") from None

    @functools.cached_property
    def accelerators(self) -> Accelerators:
        """Made when a QP or a residual first needs them: steps by elimination do not.

        The same whenever that is, after an interruption too.
        """
        return Accelerators(self.operator, self.settings, self._known_bound, self.scale,
                            self.history)

    def size(self, displacements: np.ndarray) -> float:
        """Norm of displacements of the dual rows in the scale that MPRGP works in."""
        scaled = self.scale * displacements
        return np.sqrt(self.operator.dot(scaled, scaled))

    @property
    def asked(self) -> float:
        """The tolerance of a step before it is tightened."""
        return self.settings.rtol * self.scales.d

    def left(self, x: np.ndarray, gradient: np.ndarray) -> float:
        """The residual of multipliers x (owned,) at the friction bounds of their own pressures."""
        return self.size(projected_gradient(x, gradient, *self.rows.limits(len(x), x)))

    def asked_for(self, displacements: np.ndarray) -> float:
        """The size of displacements that loads bring about.

        Raises InputError where their squares overflow.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            size = self.size(displacements)
        if not np.isfinite(size):
            raise InputError("loads or prescribed displacements are so large that the squares of "
                             "displacements exceed the largest number, 1.8e308: check their values "
                             "and amplitudes")
        return size

    def largest(self, x: np.ndarray) -> float:
        """||F|| ||x||, a bound of what x moves, in the same scale."""
        unscaled = x / self.scale
        return self.bound * np.sqrt(self.operator.dot(unscaled, unscaled))

    def rounded(self, x: np.ndarray) -> float:
        """What a product F x rounds off, in the same scale."""
        return self.size(self._rounding(x))

    def rounded_by_level(self, x: np.ndarray) -> np.ndarray:
        """(levels,) what a product F x rounds off at most on a row of every level; collective."""
        op = self.operator
        largest = np.zeros(op.levels)
        np.maximum.at(largest, op.row_level, np.abs(self._rounding(x)))
        op.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        return largest

    def _rounding(self, x: np.ndarray) -> np.ndarray:
        """(owned,) what a product F x rounds off on every row: 3 x, whose digits differ, shows it.
        """
        return self.operator.apply(x) - self.operator.apply(3 * x) / 3

    def hides(self, x: np.ndarray) -> bool:
        """Whether what a product with the forces x rounds off is beyond the tolerance of a step."""
        return self.rounded(x) > self.asked

    def extent(self, elastic: np.ndarray, rigid: np.ndarray, before: np.ndarray,
               moved: np.ndarray, given: bool = False) -> float:
        """Norm of the displacements that multipliers have to overcome, in MPRGP's scale.

        `elastic` B w (owned,) by the loads, `rigid` B r (owned,) by motions of whole bodies over
        the step, `before` (j,) the elastic tangential displacements of the step before. Left out is
        what may be of any size and is not overcome: openings beyond the load's own response, unless
        contact is bilateral, and travel beyond all of this and what multipliers near those of the
        step bring about, `moved` (owned,), `given` ones if so: the body slides. Raises InputError
        where the squares of displacements overflow.
        """
        rows, comm, seen = self.rows, self.operator.comm, elastic.copy()
        over = elastic[rows.normal] + rigid[rows.normal] - rows.gap
        least = np.where(rows.bilateral, -np.inf, -np.abs(elastic[rows.normal]))
        seen[rows.normal] = np.maximum(over, least)
        seen[rows.tangential] -= before
        moving = self.operator.structure.contact.motion is not None
        if self.operator.travels or self.operator.modes or moving:
            far = np.abs(self.scale * np.array([seen, moved])).max(initial=0)
            limit = comm.allreduce(float(far), op=MPI.MAX) / self.scale[rows.tangential]
            seen[rows.tangential] += np.clip(rigid[rows.tangential], -limit, limit)
        size = self.asked_for(seen)
        if rows.offset is not None and not given and size <= ROUNDED * self.size(rigid):
            # travel deforms by friction alone, and that needs no pressure
            x = np.zeros(len(elastic))
            x[rows.tangential] = rows.offset * np.sign(rigid[rows.tangential])
            return self.extent(elastic, rigid, before, self.operator.apply(x), True)
        return size

    def aim(self, part: float, x: np.ndarray) -> None:
        """Tolerance of the QPs to come: the step's, or `part` of it, but then not below rounding.

        What a product rounds off may be far more than its result has, where stiffness jumps, or
        far less. It is measured at multipliers near theirs, `x`, where tolerances come near to it:
        beyond it MPRGP stagnates however good the solution is. Collective.
        """
        own, least = self.asked, FINEST * self.scales.d
        if part * own < NEAR_ROUNDING * least:
            least = max(SPARED * least, STEADY * self.rounded(x))
        self.tol = max(part * own, min(own, least))

    def placed(self, moved, d, x, gradient):
        """`moved` and its gradient, by a product unless it is x, where `gradient` is known."""
        if gradient is None or not self.operator.minimum(float(np.array_equal(moved, x))):
            return moved, self.operator.apply(moved) - d
        return x, gradient

    def linear(self, d, limits, x, tol, gradient=None) -> Result:
        """MPRGP from x for rows that `limits` fix or leave free, to a residual `tol`.

        After LINEAR products the best that it has come to, silently.
        """
        op = self.operator
        return mprgp(op.apply, d, *limits, x, tol=tol, norm_bound=self.bound, max_products=LINEAR,
                     preconditioner=self.accelerators.preconditioner, gradient0=gradient,
                     dot=op.dot, minimum=op.minimum, scale=self.scale)

    def solve(self, index, iteration, d, limits, x, reduction, gradient=None, gives_up=None):
        """MPRGP from x until the residual has fallen by the factor `reduction` or is `tol`.

        `gives_up` (products) -> whether to leave it at that; then the Result's status is "stopped".
        `index` and `iteration` go to the log. Raises Unfinished where MPRGP does not converge.
        """
        op, settings, history = self.operator, self.settings, self.history
        if gradient is None:
            gradient = op.apply(x) - d
        residual = self.size(projected_gradient(x, gradient, *limits))
        tol = max(self.tol, reduction * residual)
        offset, before, relax = op.products, op.products, None

        def monitor(kind, products, residual):
            relative = residual / (self.scales.d or 1.0)
            history.log.append((offset + products, index, iteration, kind, relative))
            history.at_work(index, op.products, relative)
            return gives_up is not None and gives_up(op.products - before)

        if residual <= self.tol:
            monitor("start", 0, residual)
            return Result(x, gradient, "converged", "projected gradient within tolerance", 0, 0, 0,
                          0, self.bound, residual)
        preconditioner, relaxation = self.accelerators.preconditioner, self.accelerators.relaxation
        if relaxation is not None and settings.expansion == "contact":
            relax = functools.partial(relaxation.relaxed, limits=limits, tol=0.5 * tol)

        def attempt(x, gradient, relax):
            ended = mprgp(op.apply, d, *limits, x, tol=tol, norm_bound=self.bound,
                          preconditioner=preconditioner, max_products=settings.max_products,
                          gradient0=gradient, dot=op.dot, dots=op.dots, minimum=op.minimum,
                          monitor=monitor, scale=self.scale, relax=relax,
                          expansion="gradient" if settings.expansion == "gradient" else "cg")
            self.bound = ended.norm_bound
            for name in ("cg_steps", "expansion_steps", "proportioning_steps"):
                history.counts[name] += getattr(ended, name)
            return ended

        result = attempt(x, gradient, relax)
        if result.status == "stagnated" and relax is not None:
            # steps on contact rows may be all rounding where stiffness jumps within subdomains
            offset = op.products
            result = attempt(result.x, op.apply(result.x) - d, None)
        if result.status not in ("converged", "stopped"):
            kind = NoSolution if result.status == "indefinite operator" else NotConverged
            error = kind(f"{step_name(index)}: MPRGP ended with '{result.status}': {result.reason}")
            raise Unfinished(error, result.x, result.gradient,
                             stagnated=result.status == "stagnated")
        return result
