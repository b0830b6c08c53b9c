"""A posteriori estimate of the error in the energy norm, ||v||^2 = int C eps(v) : eps(v).

What is bounded. u is the solution of one time step in the continuum: elasticity on the meshed
polygon with the step's loads, supports that move as the P1 function says, gap and normals linear
along contact edges, slip counted from the computed displacement of the step before, and Tresca
friction with the bound s that the computed pressures give (F |sigma_n| at the nodes for Coulomb,
linear in between). Errors of earlier steps, of the boundary's geometry and of loads that are not
linear on an edge or constant on a third of a triangle, of material and thermal strain that vary
inside a triangle are not part of it (`EXCLUDED`, `EARLIER`, `COULOMB`); how well s fits its own
pressures is the friction part, and what it adds that they err themselves `coupling` estimates.

The bound. v is the computed displacement made admissible: averaged over subdomains, pushed out of
the obstacle. sigma* is in equilibrium with the loads and with contact tractions t* inside the cone
(t*_n <= 0, |t*_t| <= s). Testing both problems with u - v gives

    ||u - v||^2 <= A ||u - v|| + B,   hence   ||u - v|| <= A/2 + sqrt(A^2/4 + B),
    A^2 = int (sigma* - sigma(v)) : C^-1 (sigma* - sigma(v)),
    B = int_contact -t*_n (gap - v_n) + s |slip| + t*_t slip,

to which ||v - u_h|| is added, the distance to the displacements that the run reports. ||u - v|| is
at most the square root A^2 + 2 B of twice the duality gap (for B = 0 it is Prager and
Synge's theorem). t* is linear between the computed nodal tractions and so in the cone. Its moments
are those of the consistent, not of the lumped boundary mass: sigma* starts from the torn
displacements under these nodal forces. FETI-DP keeps every vertex in equilibrium under any
multipliers: one recovery of displacements gives them, without iteration or new gluing multipliers.

Between two bodies the jump takes the displacement's place; what its two sides and meshes that do
not match add to sigma*, v and B stands in pair_bound.py.

Parts (after Rey, Rey, Gosselet 2014: strict error bound with separated contributions of the
discretization and of the iterative solver): with sigma_h of the torn, not yet averaged
displacements, A <= ||sigma* - sigma_h|| + ||sigma_h - sigma(v)||. The first is the mesh's, the
second the gluing jump's and the penetration's; the nodal sum lambda_n (gap - v_n) + ..., which the
QP would make zero, is the solver's share of B. It also gets what vertices are out of balance by:
rounding, and on a body that contact alone holds the torque between the two kinds of nodal forces,
which is spread over it: there its size is an estimate, no bound. The friction part belongs to the
last change of the friction forces, to the bound of their own pressures after the last QP: its
displacements, with those of all changes to come at the rate of the fixed point, and what it adds to
gluing jump, penetration and gap.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..march.step import Step
from ..scene.loader import Subdomain
from ..scene.manifest import Manifest
from . import equilibration
from .contact_tractions import ContactTractions
from .deviations import Deviations
from .torn_body import Gather, TornBody

EXCLUDED = ("curved boundaries",
            "loads and supports that are not linear on an edge",
            "material and thermal strain that vary inside a triangle")
EARLIER = "errors of earlier steps"  # of scenes whose end depends on the way
COULOMB = "the error of the friction bound itself"  # estimated as `coupling`
SLOWEST = 0.99  # largest rate of the fixed point by which its remaining changes are extrapolated
ROUNDING = 1e-6  # part of the largest edge moment below which a reaction in a point counts as none


@dataclass
class Estimate:
    """Error of one step in the energy norm, or the `reason` why there is none.

    Energies are per thickness, so that norms have the unit of sqrt(stress) length.
    """

    step: int
    mesh: float = 0.0
    solver: float = 0.0
    friction: float = 0.0
    correction: float = 0.0
    coupling: float = 0.0  # not part of the total, see `coupling`
    total: float = 0.0
    norm: float = 0.0
    indicator: np.ndarray | None = None  # (n_t,) share of every triangle of the torn body in `mesh`
    reason: str = ""


@dataclass
class _Apart:
    """Displacements made admissible at rigid obstacles, and their nodal duality gap."""

    admissible: np.ndarray  # (vertices, 2)
    stress: np.ndarray  # (n_t, 3) of their difference
    nodal_gap: float


class EquilibratedBound:
    """The bound for steps of one run on P1 elements. Collective; rank 0 computes."""

    def __init__(self, gather: Gather, operator, manifest: Manifest, contact,
                 body: TornBody | None):
        """`contact` is a results.ContactState, `body` of rank 0."""
        self.gather, self.operator, self.manifest, self.body = gather, operator, manifest, body
        self.state, self.boundary, self.rows = contact, contact.boundary, contact.rows
        self.heavy = any(pattern["given_on"] == "triangles" for pattern in manifest.patterns)

    def estimate(self, step: Step, state: dict, displacements: list[np.ndarray]) -> Estimate | None:
        """The estimate of one step on rank 0, None elsewhere.

        `state`: arrays (n_c,) of every `ContactField`, `displacements` (dofs,) by subdomain, less
        the travel.
        """
        contact, pairs = self._contact(step, state), self._pairs(state)
        fields, balanced = self._fields(step, state, contact, pairs, displacements)
        moved = self._moved(step)
        thermal = self.gather.thermal(step.weights, (3,))
        force = self._body_force(step.weights)
        applied = self._applied(step.weights, contact, pairs)
        structure = self.operator.structure
        travel = self.gather.displacements(
            structure.travel.displacements(step.weights, structure.subdomains))
        if not self.gather.root:
            return None
        body = self.body
        elastic = body.stress(fields)
        base = body.stress(balanced) - thermal
        deviation, unbalanced, reason = self._equilibrated(base, force, applied)
        if reason:
            return Estimate(step.index, reason=reason)
        # `_apart` leaves distances and slip of the last displacements in `contact`
        of_qp = None if moved is None else self._apart(fields - moved + travel, contact)
        final = self._apart(fields + travel, contact)
        of_qp = of_qp or final
        lift, bumps, between, more = self._lifted(final.admissible, pairs)
        apart = body.norm(final.stress + body.stress(lift[body.vertex]))
        correction = apart + float(np.sqrt((bumps**2).sum()))
        between += bumps
        # negative where tractions on coarse curved sides leave the cone of friction inside edges
        gap = max(contact.duality_gap() + more, 0.0)
        shift = base - elastic + thermal - body.stress(lift[body.vertex])  # consistent forces'
        mean = self.deviations.mean(deviation)
        share = self.deviations.energy(deviation) + body.work(2 * mean + shift, shift)
        share = np.maximum(share, 0.0)
        whole = np.maximum(share + body.work(final.stress - 2 * (mean + shift), final.stress), 0.0)
        share, whole = (np.sqrt(share) + between) ** 2, (np.sqrt(whole) + between) ** 2
        onward = self._onward(step, moved)
        jump = body.norm(final.stress - of_qp.stress) ** 2
        return Estimate(step.index, mesh=_root(share.sum(), max(gap - final.nodal_gap, 0.0)),
                        solver=_root(body.norm(of_qp.stress) ** 2, of_qp.nodal_gap) + unbalanced,
                        friction=_root(jump, max(final.nodal_gap - of_qp.nodal_gap, 0.0)) + onward,
                        correction=correction,
                        total=_root(whole.sum(), gap) + unbalanced + onward + correction,
                        norm=body.norm(elastic), indicator=np.sqrt(share))

    # ---- displacements ---------------------------------------------------------------------------
    def _fields(self, step: Step, state: dict, contact: ContactTractions,
                pairs: list | None, displacements: list[np.ndarray]) -> tuple:
        """Torn displacements on rank 0: computed, and under the nodal forces of t*."""
        multipliers = contact.multipliers(step.multipliers, self.rows)
        forces = self._forces(pairs, state) if self.boundary.paired.any() else None
        balanced = self.operator.deformations(multipliers, step.weights, forces)
        return self.gather.displacements(displacements), self.gather.displacements(balanced)

    def _moved(self, step: Step) -> np.ndarray | None:
        """Torn displacements by the last change of the friction forces; None if there was none."""
        if not self.operator.comm.allreduce(int(np.count_nonzero(step.moved))):
            return None
        fields = self.operator.deformations(step.moved, np.zeros(len(step.weights)))
        return self.gather.displacements(fields)

    def _onward(self, step: Step, moved: np.ndarray | None) -> float:
        """Energy norm of the last change of the friction forces and all to come, extrapolated."""
        rate = min(np.nan_to_num(step.contraction), SLOWEST)
        change = 0.0 if moved is None else self.body.norm(self.body.stress(moved))
        return change / (1 - rate)

    def _apart(self, torn: np.ndarray, contact: ContactTractions) -> _Apart:
        admissible = self._admissible(torn, contact)
        stress = self.body.stress(admissible[self.body.vertex] - torn)
        return _Apart(admissible, stress, contact.nodal_gap())

    def _admissible(self, torn: np.ndarray, contact: ContactTractions) -> np.ndarray:
        """(vertices, 2) averaged displacements made admissible at rigid obstacles.

        Nodes go out of the obstacle; onto it, or back to where they stuck, if that saves more than
        it costs on the vertex's own stiffness. Sets distances and slip of `contact`.
        """
        body, b = self.body, self.boundary
        u = body.untorn(torn)
        vertex = np.searchsorted(body.gid, b.gid)
        jump = np.zeros((len(b.gid), 2))
        terms = b.term_value[:, None] * u[np.searchsorted(body.gid, b.term_gid)]
        np.add.at(jump, b.term_node, terms)
        contact.place(jump)
        stiffness = body.stiffness[vertex].max(axis=1, initial=0)
        onto, back = contact.onto_obstacle(stiffness), contact.back_to_stick(stiffness)
        corners = b.corners[b.corners[:, 2] > 1, :2]  # both normals at once, where two move freely
        u[vertex[corners[:, 0]]] += np.linalg.solve(b.normal[corners], onto[corners])
        onto[corners] = 0.0
        moves = (b.normal_row, b.normal, onto), (b.tangential_row, b.tangent, back)
        for row, direction, move in moves:
            free = direction * ~body.constrained[vertex]
            square = np.maximum((free**2).sum(axis=1), 1e-300)
            np.add.at(u, vertex, np.where(row >= 0, move, 0.0)[:, None] * free / square[:, None])
        return u

    def _lifted(self, admissible: np.ndarray,
                pairs: list) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """(vertices, 2) to be added to displacements to make them admissible at pairs, too.

        Also the energy norms (n_t,) of what happens inside edges, of displacements and of
        tractions; and the pairs' share of the duality gap.
        """
        body, u = self.body, admissible.copy()
        gap, bumps, between = 0.0, np.zeros(len(body.torn)), np.zeros(len(body.torn))
        for pair in pairs:
            lift = pair.lift(u, body.stiffness, body.constrained, body.elasticity)
            u += lift.vertex
            bumps += lift.bumps
            between += pair.remainder(body.compliance)
            gap += lift.gap
        return u - admissible, bumps, between, gap

    # ---- tractions -------------------------------------------------------------------------------
    def _body_force(self, weights: np.ndarray) -> np.ndarray | None:
        """(n_t, 3, 2) moments of the body force on rank 0; None where the scene declares none."""
        if not self.heavy:
            return None

        def moments(s: int, sub: Subdomain) -> np.ndarray:
            return sum(weights[k] * force for k, force in sub.body_loads.items())

        return self.gather((3, 2), float, moments)

    def _contact(self, step: Step, state: dict) -> ContactTractions:
        now = step.weights[: len(self.manifest.patterns)]
        solver = self.state.solver
        before = solver.amplitudes[step.index - 1]
        values = self.boundary.clamped.values
        return ContactTractions(self.state, state, values @ now, values @ (now - before),
                                (solver.times[step.index - 1], step.time))

    def _pairs(self, state: dict) -> list | None:
        """The PairBound of every contact pair in one step, on rank 0."""
        if not self.gather.root:
            return None
        if not self.boundary.meeting:
            return []
        from ..contact.mortar import meets, reach_of
        from .pair_bound import PairBound

        b, body, outer = self.boundary, self.body, self.operator.structure.outer_edges
        values = {"vertex": np.searchsorted(body.gid, b.gid), "weight": b.weight,
                  "bilateral": self.state.law.bilateral,
                  "own_normal": b.normal_row >= 0, "own_tangential": b.tangential_row >= 0,
                  "normal": b.normal, "gap": b.gap, "pressure": -state["sigma_n"],
                  "shear": state["sigma_t"], "bound": state["bound"],
                  "before": state["u_t"] - state["slip"]}
        about = None
        if b.about is not None:
            about = np.zeros((len(body.gid), 2))
            about[np.searchsorted(body.gid, b.about.gid)] = b.about.u
        pairs = []
        for k, together in enumerate(b.meeting):
            sides = [outer[np.isin(outer[:, 2], labels)] for labels in zip(*together)]
            first, second = (np.searchsorted(body.gid, side[:, :2]) for side in sides)
            able = meets(*(side[:, 2] for side in sides), together)
            nodes = {name: value[b.family == k + 1] for name, value in values.items()}
            bilateral = bool(nodes.pop("bilateral").all())
            pairs.append(PairBound(body.mesh, first, second, nodes, able,
                                   self.state.frictional, bilateral, about, reach_of(together)))
        return pairs

    def _forces(self, pairs: list | None, state: dict) -> list[np.ndarray]:
        """Forces (dofs,) by subdomain for t* instead of multipliers, at a vertex's first one."""
        subs = self.operator.structure.subdomains
        nodal = self._nodal_forces(pairs, state) if self.gather.root else None
        torn, force = self.operator.comm.bcast(nodal)
        start = self.operator.comm.exscan(sum(len(sub.xy) for sub in subs)) or 0
        forces = []
        for sub in subs:
            own = (torn >= start) & (torn < start + len(sub.xy))
            values = np.zeros((len(sub.xy), 2))
            values[torn[own] - start] = force[own]
            forces.append(values.ravel())
            start += len(sub.xy)
        return forces

    def _nodal_forces(self, pairs: list, state: dict) -> tuple[np.ndarray, np.ndarray]:
        """Torn vertices (n,) and the forces (n, 2) of `_forces` there, on rank 0."""
        body, b = self.body, self.boundary
        total = np.zeros((len(body.gid), 2))
        for pair in pairs:
            np.add.at(total, *pair.moments())
        normal, tangential = (state[name] * b.weight for name in ("sigma_n", "sigma_t"))
        force = normal[:, None] * b.normal + tangential[:, None] * b.tangent
        paired = b.paired[b.term_node]
        np.add.at(total, np.searchsorted(body.gid, b.term_gid[paired]),
                  -(b.term_value[:, None] * force[b.term_node])[paired])
        vertex = np.flatnonzero(total.any(axis=1))
        return np.unique(body.vertex, return_index=True)[1][vertex], total[vertex]

    def _applied(self, weights: np.ndarray, contact: ContactTractions, pairs) -> np.ndarray | None:
        """(half-edges, 2) moments of loads and contact tractions on boundary edges, on rank 0."""

        def moments(s: int, sub: Subdomain) -> np.ndarray:
            return sum((weights[k] * m for k, m in sub.edge_loads.items()),
                       np.zeros((len(sub.edges), 2, 2)))

        ends = self.gather((2,), int, lambda s, sub: sub.node_gid[sub.edges])
        loads = self.gather((2, 2), float, moments)
        if not self.gather.root:
            return None
        mesh, gid = self.body.mesh, self.body.gid
        applied = np.zeros((2 * len(mesh.edges), 2))
        given = [(np.searchsorted(gid, ends), loads),
                 (np.searchsorted(gid, contact.gid[contact.node]), contact.moments)]
        for vertex, value in given + [pair.moments() for pair in pairs]:
            edge = mesh.find(vertex)
            for end in range(2):
                np.add.at(applied, 2 * edge + (vertex[:, end] > vertex[:, 1 - end]), value[:, end])
        return applied

    # ---- stress in equilibrium -------------------------------------------------------------------
    def _equilibrated(self, base, force, applied) -> tuple[np.ndarray, float, str]:
        """Deviation of an admissible stress from `base`; _unbalanced of forces spread for it."""
        body, mesh = self.body, self.body.mesh
        load = equilibration.prolongation(mesh, base, force)
        target = equilibration.averaged_moments(mesh, base)
        moments, imbalance = equilibration.edge_moments(mesh, body.chains, load, target, applied,
                                                        body.given)
        start = self.deviations.start(moments, base, force)
        return self.deviations.lessen(start), *self._unbalanced(imbalance, np.abs(moments).max())

    @cached_property
    def deviations(self) -> Deviations:
        """On rank 0."""
        body = self.body
        return Deviations(body.mesh, body.chains, body.given, body.compliance, self.heavy)

    def _unbalanced(self, imbalance: np.ndarray, size: float) -> tuple[float, str]:
        """Energy norm of the imbalance of the vertices, each on its own stiffness.

        A force that a support takes in a single point is no imbalance, but leaves no finite energy:
        the second result then says so.
        """
        body, mesh = self.body, self.body.mesh
        vertex = mesh.triangles.ravel()[body.chains.order[0]]
        constrained = body.constrained[vertex]
        if np.abs(imbalance[constrained]).max(initial=0) > ROUNDING * size:
            return 0.0, ("a support at a single point carries a force: the exact solution has no "
                         "finite energy")
        square = (imbalance**2 / body.stiffness[vertex])[~constrained].sum()
        return float(np.sqrt(square)), ""


def coupling(total: float, contraction: float) -> float:
    """What Coulomb's law adds to a bound `total` with the computed friction bound, an estimate.

    The bound s of the solution u* is not s_h, that of the computed u_h. Let u be the solution with
    s_h, ||u - u_h|| <= total. Where successive approximations contract by q in this norm, two
    friction bounds F |sigma_n(v)|, F |sigma_n(w)| have solutions no farther apart than q ||v - w||:

        ||u* - u|| <= q ||u* - u_h|| <= q (||u* - u|| + total),   ||u* - u|| <= q / (1 - q) total.

    q is the rate observed in the step, of nodal pressures on one mesh: no more than an estimate.
    """
    rate = min(np.nan_to_num(contraction), SLOWEST)
    return total * rate / (1 - rate)


def _root(square: float, gap: float) -> float:
    """Largest x with x^2 <= sqrt(square) x + gap."""
    return float(0.5 * np.sqrt(square) + np.sqrt(0.25 * square + gap))
