"""The contact part of the dual vectors: dense, in the order of the contact nodes, on every rank."""

import contextlib
import functools
from dataclasses import dataclass

import numpy as np

from ..errors import NoSolution
from ..qp import complementarity
from ..qp.coulomb import ROUNDING, SLIGHT, CoulombProblem
from ..feti.cholesky import SINGULAR
from ..feti.compliance import contact_compliance
from ..feti.dual_problem import DualProblem
from ..feti.fronts import GluingElimination
from ..feti.gathering import by_first, gather
from ..feti.rows import contact_row_numbers
from ..contact.equilibrium import felt
from ..contact.rows import ContactRows
from .step import Load

NEAR = 0.01  # of the size of the largest body: gaps that strains, which are small, may close
FAINT = 1e-3  # part of the motion that rows feel most, below which they hardly feel one


@dataclass
class Condensation:
    """Contact rows in the order of the contact nodes, normal ones first, and their compliance.

    Without those that the states of corners exclude and those of nodes that face nothing: `nodes`
    (n,) have a normal row. Where a corner is open on both sides and rubs, its normal rows stay,
    alone and open: `apart` are their places. `junctions`: there are such, whose rows depend on
    one another. `guess` is a dual vector near the solution of the first step, `eliminated` whether
    steps have begun to go by the `elimination`. Collective.
    """

    operator: DualProblem
    rows: ContactRows
    junctions: bool = False
    guess: np.ndarray | None = None
    eliminated: bool = False

    def __post_init__(self):
        self._compliance = self._softness = None
        # this rank's rows among all contact rows, and their places in its part of a dual vector
        self._every = self._owned_of(contact_row_numbers(self.operator.structure.contact))
        self.select()

    def _owned_of(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """Which of the dual rows `numbers` the rank owns, and where; how many there are."""
        first, last = self.operator.structure.row_range
        owned = np.flatnonzero((numbers >= first) & (numbers < last))
        return owned, numbers[owned] - first, len(numbers)

    def select(self) -> None:
        """Take the rows that act in the present states of corners."""
        contact, corners = self.operator.structure.contact, self.rows.corners
        rows = [contact.normal_row >= 0, contact.tangential_row >= 0]
        known = np.concatenate(rows)
        rows = [have & ~contact.idle for have in rows]
        apart = np.zeros(len(contact.gid), bool)
        if corners is not None:
            rows = [have & acts for have, acts in zip(rows, corners.act(len(contact.gid)))]
            apart = rows[1] & ~rows[0]
            rows[0] = rows[0] | apart
        acting = np.concatenate(rows)[known]
        self._acting = None if acting.all() else acting
        self.nodes, tangential = map(np.flatnonzero, rows)
        self.apart = np.flatnonzero(apart[self.nodes])
        self._rubbing = np.isin(self.rows.tangential_node, tangential)  # of the rank's rows
        self.pair = np.searchsorted(self.nodes, tangential)
        self.n, self.m = len(self.nodes), len(tangential)
        self._acts = self._owned_of(np.concatenate([contact.normal_row[self.nodes],
                                                    contact.tangential_row[tangential]]))
        self._selected = self._law = None

    @property
    def size(self) -> int:
        """Number of contact rows that act."""
        return self.n + self.m

    @property
    def total(self) -> int:
        """Number of contact rows, whether they act or not."""
        return self._every[2]

    @functools.cached_property
    def near(self) -> int:
        """Number of contact rows of nodes that lie near what they meet: others hardly touch it."""
        structure = self.operator.structure
        contact, size = structure.contact, structure.travel.bodies.size.max()
        near = (contact.gap <= NEAR * size) & ~contact.idle
        return sum(np.count_nonzero(rows[near] >= 0)
                   for rows in (contact.normal_row, contact.tangential_row))

    @property
    def whole(self) -> bool:
        """Whether the contact rows are all there are."""
        return self.operator.contact_rows_only

    def gather(self, local: np.ndarray) -> np.ndarray:
        """(n + m,) contact part of a dual vector, on every rank."""
        return self._gathered(local, self._acts)

    def _gathered(self, local: np.ndarray, owned: tuple) -> np.ndarray:
        """Entries of a dual vector at the rows that are `owned`, on every rank."""
        own, places, count = owned
        part, comm = np.zeros(count), self.operator.comm
        part[own] = local[places]
        return np.sum(comm.allgather(part), axis=0) if comm.size > 1 else part

    def place(self, x: np.ndarray, into: np.ndarray) -> np.ndarray:
        """The dual vector `into` with its contact part replaced by x (n + m,).

        Rows that the states of corners exclude, and those that face nothing, have no force.
        """
        moved, (own, places, _) = into.copy(), self._acts
        moved[self.rows.excluded] = 0.0
        moved[places] = x[own]
        return moved

    def fixing(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Limits that fix the contact part of the dual vector x and leave its gluing part free."""
        lower, upper = np.full(len(x), -np.inf), np.full(len(x), np.inf)
        for rows in (self.rows.normal, self.rows.tangential):
            lower[rows] = upper[rows] = x[rows]
        return lower, upper

    @functools.cached_property
    def elimination(self) -> GluingElimination | None:
        """That of the gluing rows; None where there are none, or stiffness jumps by so much that
        displacements have too few digits: pivots keep more there.
        """
        if self.whole or self.operator.uneven:
            return None
        return GluingElimination(self.operator)

    @contextlib.contextmanager
    def refined(self):
        """A block in which displacements are refined, as where stiffness jumps inside a body.

        What has been eliminated stays so, unless bodies differ by as much as parts do then.
        """
        op, known, elimination = self.operator, self.eliminated, self.elimination
        op.uneven = True
        if op.bodies_differ:
            self.eliminated, self.elimination = False, None
        try:
            yield
        finally:
            op.uneven, self.eliminated, self.elimination = False, known, elimination

    @functools.cached_property
    def hardly_felt(self) -> bool:
        """Whether there is a motion of bodies without support that contact rows resist by little.

        As the turning of a disc that sides, which are not quite round, hold in its hole.
        """
        if not self.operator.modes or not self.total:
            return False
        motions = self._every_motion
        reach = np.abs(motions).max(axis=0)
        sizes = np.linalg.svd(motions / np.where(reach > 0, reach, 1.0), compute_uv=False)
        return bool(((sizes > SLIGHT) & (sizes < FAINT * sizes[0])).any())

    def _motions(self) -> np.ndarray | None:
        """(n + m, k) what contact rows move by with bodies without support; None if all have some.
        """
        if not self.operator.modes:
            return None
        motions = self._of_acting(self._every_motion).copy()
        motions[self.apart] = 0.0
        return motions

    @functools.cached_property
    def _every_motion(self) -> np.ndarray:
        """(contact rows, k) what all that face something move by, whether they act or not."""
        motions = felt(self.rows, np.column_stack(self.operator.motions))
        return np.column_stack([self._gathered(d, self._every) for d in motions.T])

    def _of_acting(self, values: np.ndarray) -> np.ndarray:
        """(n + m, ...) of `values` (contact rows, ...) those of the rows that act."""
        return values if self._acting is None else values[self._acting]

    def glued(self, d: np.ndarray, x: np.ndarray,
              gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x with the gluing multipliers of its contact multipliers, and its gradient: a product.

        `gradient` is that at x, F x - `d`. Where there is an `elimination`. Collective; raises
        NotConverged.
        """
        op, (first, last) = self.operator, self.operator.structure.row_range
        self.elimination.compliance()
        x = x + self.elimination.change(gather(op.comm, gradient))[first:last]
        return x, op.apply(x) - d

    def correction(self, load: Load, x: np.ndarray, gradient: np.ndarray) -> np.ndarray | None:
        """Change (owned,) of contact forces by a step of Newton's method from x and its gradient.

        Under the `load`, which says what acts on bodies without support. None if its system may be
        singular. Needs an `elimination`. Where x is a solution the factors of Newton's last system
        are used again. Collective; raises NotConverged.
        """
        op, (first, last) = self.operator, self.operator.structure.row_range
        compliance = self.compliance()
        glued = self.elimination.change(gather(op.comm, gradient))[first:last]
        forces, movement = self.gather(x), -self.gather(gradient + op.apply(glued))
        problem = self._under(load, compliance @ forces + movement)
        movement = self._opened(movement)
        change = by_first(op.comm, self._step, problem, problem.whole(forces), movement)
        return None if change is None else self.place(change[: self.size], np.zeros(op.owned))

    @staticmethod
    def _step(problem: CoulombProblem, z: np.ndarray, movement: np.ndarray) -> np.ndarray | None:
        """Change of z by one of Newton's method, from z and its `movement`."""
        # of a solution movements say the same but on the border of states, where they are rounding
        states = (problem.states_by_forces(z) if problem.violation(z, movement) <= ROUNDING
                  else problem.states(z, movement))
        signs = problem.signs(z)
        if problem.system(states, signs).doubtful:
            return None
        change = problem.correction_in(states, signs, z, movement)
        return None if change is None else change[0]

    @functools.cached_property
    def _responses(self) -> np.ndarray:
        """Movements (contact rows, patterns) of the glued bodies by unit loads, without contact
        forces; of all rows, whether they act or not.
        """
        op, products = self.operator, self.operator.products
        loads = map(op.elastic_response, np.eye(op.structure.patterns))
        moved = [-self._gathered(self.glued(d, np.zeros_like(d), -d)[1], self._every)
                 for d in loads]
        op.products = products  # a part of the elimination, made again after an interruption
        return np.reshape(moved, (op.structure.patterns, self.total)).T

    def without_contact(self, weights: np.ndarray, apart: np.ndarray) -> np.ndarray:
        """(owned,) movements of the contact rows of glued bodies by loads of `weights`, where there
        are no contact forces but those of bilateral contact.

        These close the rows that pull, which whole bodies move by `apart` (k,) more than the gaps
        of normal rows are. Where there is an `elimination`. Collective; raises NotConverged.
        """
        rows, moved = self.rows, self._responses @ weights[: self.operator.structure.patterns]
        beyond, pulls = np.zeros((2, self.operator.owned))
        beyond[rows.normal], pulls[rows.normal] = apart, rows.pulls
        held = np.flatnonzero(self._gathered(pulls, self._every))
        if held.size:
            compliance = self.elimination.compliance()[:, held]
            beyond = self._gathered(beyond, self._every)
            force = np.linalg.solve(compliance[held], (moved + beyond)[held])
            moved -= compliance @ force
        found, (own, places, _) = np.zeros(self.operator.owned), self._every
        found[places] = moved[own]
        return found

    def compliance(self) -> np.ndarray:
        """C (n + m, n + m), computed at the first call.

        Raises NotConverged, and NoSolution where rounding leaves a row no positive compliance.
        """
        if self._compliance is None:
            self._compliance = (contact_compliance(self.operator) if self.elimination is None
                                else self.elimination.compliance())
            if not np.all(np.diag(self._compliance) >= 0):
                raise NoSolution(f"the contact nodes' {SINGULAR}")
        if self._selected is None or self.operator.softness is not self._softness:
            self._selected, self._law = self._compliance, None
            self._softness = self.operator.softness
            if self.operator.softness is not None:
                own = self._gathered(self.operator.softness, self._every)
                self._selected = self._compliance + np.diag(own)
            if self._acting is not None:
                self._selected = self._selected[np.ix_(self._acting, self._acting)]
            if len(self.apart):  # others go on with the compliance as it is
                self._selected = self._selected.copy()
                own = self._selected[self.apart, self.apart]
                self._selected[self.apart] = self._selected[:, self.apart] = 0.0
                self._selected[self.apart, self.apart] = own
        return self._selected

    def solution(self, load: Load, x, gradient, sliding) -> tuple[np.ndarray, np.ndarray] | None:
        """Multipliers that solve a step, and their gradient, where there are contact rows alone.

        Newton's method from `guess`, if there is one, and from x, where the tangential rows slide
        as `sliding` says. It ends exactly in the states that it reaches: what it started from
        leaves no trace. None if it fails.
        """
        problem, start, pair = self.problem(load, x, gradient), self.gather(x), None
        if self.guess is not None:
            near, self.guess = self.gather(self.guess), None
            pair = complementarity.settled(problem, near, problem.movement(near))
        if pair is None:
            states = problem.states_of(start, sliding[self._rubbing])
            movement = self._opened(-self.gather(gradient))
            pair = complementarity.settled(problem, start, movement, states)
        self.operator.products += problem.products
        if pair is None:
            return None
        x = self.place(pair[0], x)
        if self._acting is not None or len(self.apart):  # what does not act moves, too
            return x, self.operator.apply(x) - load.d
        return x, self.place(-pair[1], x)

    def problem(self, load: Load, x: np.ndarray, gradient: np.ndarray) -> CoulombProblem:
        """The condensed problem whose load is exact at the dual vector x.

        The gradient on the gluing rows is taken as zero. Rigid motions of bodies without support
        are relative to those in `load`. Raises NotConverged if the compliance cannot be computed.
        """
        if self.whole:
            return self._under(load, self.gather(load.d))
        return self._under(load, self.compliance() @ self.gather(x) - self.gather(gradient))

    def problem_by_loads(self, load: Load) -> CoulombProblem:
        """The same from the loads alone, to fewer digits; where there is an `elimination`."""
        weights = load.weights[: self.operator.structure.patterns]
        moved = self._of_acting(self._responses) @ weights
        return self._under(load, self.gather(load.rest) + moved)

    def _under(self, load: Load, d: np.ndarray) -> CoulombProblem:
        """The condensed problem under the movements d (n + m,) that contact forces have to undo.

        The `load` is asked what acts on free bodies, if there are any.
        """
        op, balance, rows = self.operator, None, self.rows
        compliance = self.compliance()
        if self._law is None:
            self._law = CoulombProblem(compliance, np.zeros(self.n + self.m),
                                       np.zeros(self.m), self.pair, self._bilateral(),
                                       self._motions(), depends=self._dependent)
        offset = None
        if rows.offset is not None:
            offset = self.of_tangential(rows.offset)
        if op.modes:
            balance = load.weights[: op.structure.patterns] @ op.rigid_work[0]
        return self._law.under(self._opened(d), self.coefficient, balance, offset)

    @property
    def _dependent(self) -> bool:
        """Whether rows depend on one another: those of junctions do, unless rows yield by a law of
        their own, where surfaces wear or are rough.
        """
        softness = self.operator.softness
        yields = softness is not None and self._gathered(softness, self._acts).any()
        return self.junctions and not yields

    @property
    def coefficient(self) -> np.ndarray:
        """(m,) friction coefficients, zero where bounds are given."""
        given = self.rows.bound_is_given
        return np.zeros(self.m) if given else self.of_tangential(self.rows.coefficient)

    def _opened(self, movement: np.ndarray) -> np.ndarray:
        """`movement` (n + m,) with nodes that are kept apart as far open as anything moves."""
        movement[self.apart] = -np.abs(movement).max(initial=0.0) or -1.0
        return movement

    def _bilateral(self) -> np.ndarray:
        """(n,) whether contact is bilateral, on every rank."""
        full = np.zeros(self.operator.owned)
        full[self.rows.normal] = self.rows.bilateral
        return self.gather(full)[: self.n] > 0

    def of_tangential(self, values: np.ndarray) -> np.ndarray:
        """(m,) values (j,) of the rank's tangential rows, on every rank."""
        full = np.zeros(self.operator.owned)
        full[self.rows.tangential] = values
        return self.gather(full)[self.n :]
