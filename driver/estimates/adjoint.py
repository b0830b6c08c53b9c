"""Goal-oriented errors of single quantities: an adjoint problem each on the frozen contact state.

In the state in which a step has ended, open nodes stay open, closed ones closed, sticking ones stay
where they are and sliding ones keep to the friction bound: a linear problem, whose solution u gives
a quantity J = a' lambda + e' u of contact forces lambda and displacements. Its adjoint z has the
loads e and, where contact acts, given displacements:

    K z + B' mu = e,     B_n z + F s B_t z = a_n + F s a_t    at a node that slides (Coulomb; s is
                         B_n z = a_n, B_t z = a_t             the sign of its friction) or sticks,

mu zero in all other rows, so that the error of a conforming solution u_h is (Becker, Rannacher,
Acta Numerica 10 (2001) 1-102; for contact Suttmeier, Int. J. Numer. Meth. Engng 2001)

    J(u) - J(u_h) = a(u - u_h, z - z_h) = int d_u : C^-1 d_z,

d the errors of both stresses. Here these are what smoothed stresses differ by from the computed
ones, triangle by triangle. Three sizes come of it:

    net       abs sum int_T d_u : C^-1 d_z        the estimated error
    gross     sum abs int_T d_u : C^-1 d_z        if nothing cancelled
    product   1/2 ||d_u|| ||d_z||                 half of what Cauchy and Schwarz allow

Solved as march/frozen_state.py does. What a change of the contact state adds is of higher order;
errors of earlier steps are not in it.

Smoothed stresses see SEES of an error in energy, less where its bound is larger than theirs by more
than bounds are (where it is by far, unresolved.py leaves the claim out), so that of an error of a
quantity, in which two errors are multiplied, they see the square of it. What follows depends on
whether meshes tell an order, without turning back:

told        they know how errors cancel, on contact states of their own: a claim is not below NET
            times net, nor above Cauchy's and Schwarz' bound, twice the product over SEES squared.
            Where errors hardly cancel, net over gross, the work of both is that of what smoothed
            stresses do not see of either: a claim of resultants and displacements is not below
            this part of net over SEES squared
not told    two meshes, differences that turn, hardly fall (caution.py), or fall faster than they
            can: coarse meshes agree, or differ by far more than they err, by chance. The adjoint
            problem speaks alone. Errors of contact forces lie at the ends of contact, where
            smoothed stresses are of lower order, and how they cancel hangs on the state: the claim
            is gross over SEES squared. So do those of a displacement of quadratic elements, whose
            errors are small where solutions are smooth; those of linear ones lie in the body: the
            larger of net over SEES squared and gross

Peaks err below one node, where smoothed stresses are of lower order than the pressure: they have a
limit from above alone, PEAK times gross; slip adds up over steps, of which the adjoint problem
knows the last: meshes speak, up to the bound, but where there are two, which agree by chance, the
claim is not below gross over SEES squared. Where slip turned or came to rest, or contact was
unloaded since, all that the last state has of it errs by what earlier ones did: no claim of slip,
shear or displacement is limited from above.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..effects import Effects
from ..energy_norm import recovery
from ..energy_norm.torn_body import Gather
from ..march.frozen_state import FrozenState
from ..quantity_table import HELD
from .budget import Part
from .given import of_resultant
from .nodal_gaps import missed_gaps

NET = 1.5
SEES = 2 / 3  # part of an error in energy that smoothed stresses see, unless its bound says less
FAINT = 0.1  # least part of the bound that counts as seen: below unresolved.BLIND little is claimed
OVER = 1.3  # bounds of errors in energy over the errors, as they mostly are
PEAK = 2.0  # of a peak's gross: its product is that of a concentrated load
ALIKE = 2.0  # product over gross below which both errors lie in one place, under the peak
BLIND = 0.02  # net and gross below this part of a claim see nothing of its error: data err
BALANCED = 1e-4  # part of a value that they leave of forces which balance loads on any mesh
CORNERS = "contact boundaries meet in corners"
EARLIER = "its step was not kept"


@dataclass(frozen=True)
class Sizes:
    """Estimated error of a quantity, without cancellation, and by energy norms; and what nodes miss
    of gaps, which is in none of these.
    """

    net: float
    gross: float
    product: float
    gaps: float = 0.0


def held(name: str, part: Part, sizes: Sizes | None, slack: float = 1.0,
         told: bool = True, seen: float = 1.0, linear: bool = True) -> Part:
    """The mesh's `part` of a quantity's error, held within what `sizes` leave.

    From above with a `slack`: the error may have parts that they do not see. `told`: whether meshes
    tell an order. `seen`: part of the bound of the error in energy that smoothed stresses see.
    `linear`: the elements are.
    """
    if sizes is None or part.error is None or sizes.gross <= BLIND * part.error:
        return part
    unseen = 1 / min(SEES, OVER * max(seen, FAINT))**2
    most = 2 * unseen * sizes.product + sizes.gaps
    least = NET * sizes.net
    if name == "peak_pressure":
        concentrated = sizes.product > ALIKE * sizes.gross
        least, most = 0.0, PEAK * sizes.gross + sizes.gaps if concentrated else np.inf
    elif told and name in HELD:
        least = max(least, unseen * sizes.net**2 / sizes.gross)
    elif not told:
        in_the_body = name == "displacement" and linear
        least = max(unseen * sizes.net, sizes.gross) if in_the_body else unseen * sizes.gross
        least += sizes.gaps
        if name != "slip":  # no more, but for a polygon's error
            most = least / slack if np.isfinite(slack) else np.inf
    error = float(max(min(part.error, slack * most), least))
    return replace(part, error=error)


def unsuited(problem, solver, step) -> str:
    """Why a run has no adjoint problems; empty if it has."""
    if solver.rows.corners is not None:
        return CORNERS
    if step is None:
        return EARLIER
    effects = Effects(problem.manifest)
    return effects.no_bound() or effects.no_estimate(step.weights)


class Adjoint(FrozenState):
    """The adjoint problems of one step of a run. Collective; rank 0 adds up."""

    def __init__(self, problem, record, step, body):
        """`record`: of the run, up to the `step` at least; `body`: the torn body of rank 0."""
        status = record.state(step.index - 1)["status"]
        super().__init__(problem.operator, record.contact.solver, step, status)
        self.record, self.body = record, body
        self.gather = Gather(self.operator)
        self.quadratic = problem.manifest.element != "P1"
        gap, nodes = record.gaps[step.index - 1], record.nodes()
        self.missed = np.zeros(len(gap)) if self.quadratic else missed_gaps(nodes, gap, status)
        fields = self.operator.deformations(step.multipliers, step.weights)
        self.own = self._deviation(fields, step.weights)
        self.smoothed = self.operator.comm.bcast(self._norm(self.own))  # error in energy by it

    def sizes(self, names) -> dict[str, Sizes]:
        """Of the quantities among `names` that have an adjoint problem; the same on all ranks."""
        found = {}
        for name in names:
            solution = self.solution(name)
            if solution is not None:
                gaps = self._of_gaps(solution[0])
                found[name] = self._sizes(solution[1], gaps)
        return self.operator.comm.bcast(found)

    def solution(self, name: str) -> tuple[np.ndarray, list[np.ndarray]] | None:
        """Multipliers (owned,) and displacements (dofs,) of the rank's subdomains: the adjoint
        problem of a quantity, None if it has none. Collective.
        """
        goal = self._goal(name)
        if goal is None:
            return None
        target, start, forces = goal
        moved = -target
        if forces is not None:
            moved += self.operator.response_to(forces)
        if self.operator.minimum(float(not start.any())) == 0:
            moved -= self.operator.apply(start)
        multipliers, motion = self._balanced(start + self._solve(moved), forces)
        weights = np.concatenate([np.zeros(self.operator.structure.patterns), motion])
        return multipliers, self.operator.deformations(multipliers, weights, forces)

    # ---- quantities ------------------------------------------------------------------------------
    def _goal(self, name: str) -> tuple | None:
        """Displacements a (owned,) that contact rows are given, multipliers and forces e (None:
        none) that act besides; None for a quantity without adjoint problem.
        """
        rows, index = self.rows, self.step.index - 1
        target, start = np.zeros(self.operator.owned), np.zeros(self.operator.owned)
        if name == "displacement":
            return target, start, self._at_largest()
        if name in ("normal_resultant", "tangential_resultant"):
            signs = self.record.signed_shares(name, index)
            return of_resultant(rows, signs, name, self.operator.owned), start, None
        if name == "peak_pressure":
            weight = self.record.contact.boundary.weight
            near = self.record.peak_nodes(index)
            here = np.isin(rows.normal_node, near)
            target[rows.normal[here]] = 1 / (len(near) * weight[rows.normal_node[here]])
            return target, start, None
        if name == "slip":
            node = self.record.farthest_node(index)
            start[rows.tangential[rows.tangential_node == node]] = -1.0
            return target, start, None
        return None

    def _at_largest(self) -> list[np.ndarray]:
        """Unit force along the largest displacement of the body, where it is."""
        operator, comm = self.operator, self.operator.comm
        fields = operator.displacements(self.step.multipliers, self.step.weights)
        sizes = [np.linalg.norm(u.reshape(-1, 2), axis=1) for u in fields]
        largest = max([(float(size.max()), -sub.index) for size, sub in zip(
            sizes, operator.structure.subdomains)], default=(-1.0, 0))
        largest = max(comm.allgather(largest))
        forces = [np.zeros_like(u) for u in fields]
        for force, u, size, sub in zip(forces, fields, sizes, operator.structure.subdomains):
            if sub.index == -largest[1] and largest[0] > 0:
                node = 2 * int(size.argmax())
                force[node : node + 2] = u[node : node + 2] / size.max()
        return forces

    # ---- solution --------------------------------------------------------------------------------
    def _of_gaps(self, multipliers: np.ndarray) -> float:
        """What nodes miss of gaps (nodal_gaps.py) changes a quantity by, of its adjoint problem's
        `multipliers` (owned,); on all ranks.
        """
        force = np.zeros(len(self.missed))
        force[self.rows.normal_node] = multipliers[self.rows.normal]
        force = self.operator.comm.allreduce(force)  # of one rank a node: to the last bit for any
        return float(abs(force @ self.missed))

    def _sizes(self, fields: list[np.ndarray], gaps: float) -> Sizes | None:
        other = self._deviation(fields)
        if other is None:
            return None
        area, law = self.body.area, self.body.compliance
        work = recovery.work(area, law, self.own, other)
        product = 0.5 * self._norm(self.own) * self._norm(other)
        return Sizes(abs(work.sum()), np.abs(work).sum(), product, gaps)

    def _norm(self, deviation: np.ndarray | None) -> float | None:
        """In energy, of stresses on rank 0."""
        if deviation is None:
            return None
        return float(np.sqrt(recovery.energy(self.body.area, self.body.compliance,
                                             deviation).sum()))

    def _deviation(self, fields: list, weights: np.ndarray | None = None) -> np.ndarray | None:
        """(n_t, nodes, 3) errors of the stresses of displacements, on rank 0."""
        found = recovery.deviation(self.gather, self.body, fields, self.quadratic, weights)
        return None if found is None else found[0]


def assess(problem, record, step, values, body) -> tuple[dict[str, Sizes], dict]:
    """Sizes of the quantities with `values` in a run's step, and what the summary says of them.

    `record`: of the run; `step`: that of the quantities, None if it was not kept; `body`(): the
    torn body on rank 0. Collective.
    """
    reason = unsuited(problem, record.contact.solver, step)
    if reason:
        return {}, {"reason": reason}
    before = problem.operator.products
    adjoint = Adjoint(problem, record, step, body())
    sizes = adjoint.sizes(values)
    sizes = {name: own for name, own in sizes.items() if own.gross > BALANCED * abs(values[name])}
    return sizes, {"quantities": list(sizes), "products": problem.operator.products - before,
                   "smoothed": adjoint.smoothed}
