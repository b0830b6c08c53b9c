"""Stage 7: a posteriori estimate of the error in the energy norm, ||v||^2 = int C eps(v) : eps(v).

What is bounded. u is the solution of one time step in the continuum: elasticity on the meshed polygon with the
step's loads, supports that move as the P1 function says, gap and normals linear along contact edges, slip counted
from the computed displacement of the step before, and Tresca friction with the bound s that the computed pressures
give (F |sigma_n| at the nodes for Coulomb, linear in between). Errors of earlier steps, of the boundary's geometry and of
loads that are not linear on an edge or constant on a third of a triangle are not part of it; how well s fits its own
pressures is the friction part.

The bound. v is the computed displacement made admissible: averaged over subdomains, pushed out of the obstacle.
sigma* is in equilibrium with the loads and with contact tractions t* inside the cone (t*_n <= 0, |t*_t| <= s).
Testing both problems with u - v gives

    ||u - v||^2 <= A ||u - v|| + B,   hence   ||u - v|| <= A/2 + sqrt(A^2/4 + B),
    A^2 = int (sigma* - sigma(v)) : C^-1 (sigma* - sigma(v)),
    B = int_contact -t*_n (gap - v_n) + s |slip| + t*_t slip,

which is at most the square root A^2 + 2 B of twice the duality gap (for B = 0 it is Prager and Synge's theorem). t* is
linear between the computed nodal tractions and so in the cone. Its moments are those of the consistent, not of the
lumped boundary mass: sigma* starts from the torn displacements under these nodal forces. FETI-DP keeps every vertex
in equilibrium under any multipliers, so that one recovery of displacements gives them (no iteration, no new
multipliers of the glue).

Between two bodies the jump takes the displacement's place; what its two sides and meshes that do not match add to
sigma*, v and B stands in pairbound.py.

Parts (after Rey, Rey, Gosselet 2014: strict error bound with separated contributions of the discretization and of the
iterative solver): with sigma_h of the torn, not yet averaged displacements, A <= ||sigma* - sigma_h|| + ||sigma_h -
sigma(v)||. The first is the mesh's, the second the gluing jump's and the penetration's; the nodal sum
lambda_n (gap - v_n) + ..., which the QP would make zero, is the solver's share of B. It also gets what vertices are
out of balance by: rounding, and on a body that contact alone holds the torque between the two kinds of nodal forces,
which is spread over it: there its size is an estimate, no bound.
The friction part belongs to the last change of the friction forces, to the bound of their own pressures after the
last QP: its displacements, with those of all changes to come at the rate of the fixed point, and what it adds to
gluing jump, penetration and gap.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..scene import elements
from . import equilibration, recovery
from ..scene.loader import Subdomain
from ..scene.manifest import Manifest
from .pair_bound import PairBound, continued, slid
from ..march.step import Step, gathered, scattered

NOTHING = 1e-6  # displacements below this part of the largest ones of the run are what tolerances leave
SLOWEST = 0.99  # largest rate of contraction of the fixed point that its remaining changes are extrapolated with
ROUNDING = 1e-6  # part of the largest edge moment below which a reaction in a single point counts as none


@dataclass
class Estimate:
    """Error of one step in the energy norm, or the `reason` why there is none.

    Energies are per thickness, so that norms have the unit of sqrt(stress) length.
    """

    step: int
    mesh: float = 0.0
    solver: float = 0.0
    friction: float = 0.0
    total: float = 0.0
    norm: float = 0.0
    indicator: np.ndarray | None = None  # (n_t,) share of every triangle of the torn body in `mesh`
    reason: str = ""


@dataclass
class _Body:
    """The torn body on rank 0; vertices of the untorn body are numbered without gaps."""

    gid: np.ndarray  # (vertices,) exported number of every untorn vertex
    vertex: np.ndarray  # (n_torn,) untorn vertex of every torn one
    torn: np.ndarray  # (n_t, 3) torn vertices of the triangles
    region: np.ndarray
    elasticity: np.ndarray
    compliance: np.ndarray
    mesh: equilibration.Mesh
    held: np.ndarray  # (vertices, 2) components that supports hold
    given: np.ndarray  # (half-edges, 2) where the traction is given: boundary edges without support, by component

    @cached_property
    def chains(self) -> equilibration.Chains:
        """Of the bound alone, like `stiffness`."""
        return equilibration.chains(self.mesh)

    @cached_property
    def stiffness(self) -> np.ndarray:
        """(vertices, 2) diagonal entries of the assembled stiffness."""
        return _vertex_stiffness(self.mesh, self.elasticity)

    def strain(self, u: np.ndarray) -> np.ndarray:
        """(n_t, 3) e11, e22, 2 e12 of torn displacements (n_torn, 2)."""
        d = self.mesh.gradient.transpose(0, 2, 1) @ u[self.torn]  # d[t, j, k] = d u_k / d x_j
        return np.column_stack([d[:, 0, 0], d[:, 1, 1], d[:, 1, 0] + d[:, 0, 1]])

    def untorn(self, u: np.ndarray) -> np.ndarray:
        """(vertices, 2) means of torn displacements over the subdomains that share a vertex."""
        count = np.bincount(self.vertex)
        return np.column_stack([np.bincount(self.vertex, u[:, c]) / count for c in (0, 1)])

    def norm(self, stress: np.ndarray) -> float:
        """Energy norm of constant stresses (n_t, 3)."""
        return float(np.sqrt(self.work(stress, stress).sum()))

    def work(self, stress: np.ndarray, other: np.ndarray) -> np.ndarray:
        """(n_t,) int s : C^-1 r of constant stresses (n_t, 3)."""
        return np.einsum("ti,tij,tj->t", stress, self.compliance, other) * self.mesh.area


class EnergyEstimator:
    """Estimates the last step of a run and the one with the largest energy. Collective; rank 0 computes."""

    def __init__(self, operator, manifest: Manifest, contact, kind: str):
        """`contact` is results.ContactState; `kind` "equilibrated" (the bound above) or "recovery" (no bound:
        Zienkiewicz and Zhu's averaged stresses)."""
        self.quadratic = manifest.element != "P1"  # the bound's equilibrated stresses belong to linear elements
        self.operator, self.manifest = operator, manifest
        self.kind = "recovery" if kind == "equilibrated" and self.quadratic else kind
        self.root = operator.comm.rank == 0
        self.state, self.boundary, self.rows = contact, contact.boundary, contact.rows
        self.heavy = any(pattern["given_on"] == "triangles" for pattern in manifest.patterns)
        self.body = None
        self.last = self.largest = None

    def consider(self, step: Step, state: dict, energy: float) -> None:
        """Keep a finished step, its contact state and energy, if its estimate may be wanted."""
        self.last = (energy, step, state)
        if self.largest is None or energy > (1 + 1e-9) * self.largest[0]:
            self.largest = self.last

    def snapshot(self) -> dict | None:
        """The steps kept so far, for `restore`, on rank 0; collective."""
        kept = {name: getattr(self, name) for name in ("last", "largest")}
        found = {name: gathered(step, self.rows, len(self.boundary.gid), self.operator.comm)
                 for name, (_, step, _) in kept.items()}
        return {name: {"energy": energy, "step": found[name], "state": state}
                for name, (energy, _, state) in kept.items()} if self.root else None

    def restore(self, state: dict) -> None:
        """Continue from a `snapshot` of the same problem; the same on every rank."""
        for name, kept in state.items():
            step = scattered(kept["step"], self.rows, self.operator.structure.row_range)
            setattr(self, name, (kept["energy"], step, kept["state"]))

    def estimates(self) -> list[tuple[Step, Estimate]]:
        """Of the last step and, if it is another one, of the step with the largest energy; the same on all ranks.

        A last step without load, whose displacements tolerances have left, is left out.
        """
        wanted = {}
        if self.kind != "none" and self.last:
            loaded = self.last[0] > NOTHING**2 * self.largest[0] or self.last[1].index == self.largest[1].index
            wanted = {kept[1].index: kept for kept in [self.last] * loaded + [self.largest]}
        if wanted:
            self.body = self._gather_body()
        return [(step, self.operator.comm.bcast(self._estimate(step, state))) for _, step, state in wanted.values()]

    # ---- data on rank 0 ------------------------------------------------------------------------------------
    def _gather(self, width: tuple, kind, of) -> np.ndarray | None:
        """Concatenation on rank 0 of arrays of(s, subdomain), (n, *width), in the order of subdomains."""
        subs = self.operator.structure.subdomains
        local = np.concatenate([np.empty((0, *width), kind), *(of(s, sub) for s, sub in enumerate(subs))])
        parts = self.operator.comm.gather(local)
        return np.concatenate(parts) if self.root else None

    def _gather_body(self) -> _Body | None:
        structure = self.operator.structure
        gid = self._gather((), int, lambda s, sub: sub.node_gid[sub.vertices])
        size = self._gather((2,), int, lambda s, sub: np.array([[sub.vertices.sum(), len(sub.triangles)]]))
        triangles = self._gather((3,), int, lambda s, sub: (np.cumsum(sub.vertices) - 1)[sub.triangles])
        corner = self._gather((3, 2), float, lambda s, sub: sub.xy[sub.triangles])
        region = self._gather((), int, lambda s, sub: sub.region)
        elasticity = self._gather((3, 3), float, lambda s, sub: sub.elasticity)
        fixed = self._gather((2,), int, lambda s, sub: np.column_stack(
            [sub.node_gid[sub.dof_node[structure.fixed[s]]], sub.dof_component[structure.fixed[s]]]))
        if not self.root:
            return None
        torn = triangles + np.repeat(np.cumsum(size[:, 0]) - size[:, 0], size[:, 1])[:, None]
        number, vertex = np.unique(gid, return_inverse=True)
        mesh = equilibration.Mesh.of(vertex[torn], corner)
        held = np.zeros((len(number), 2), bool)
        fixed = fixed[np.isin(fixed[:, 0], number)]  # at the vertices
        held[np.searchsorted(number, fixed[:, 0]), fixed[:, 1]] = True
        return _Body(number, vertex, torn, region, elasticity, np.linalg.inv(elasticity), mesh, held,
                     self._given(mesh, number, held))

    def _given(self, mesh, number, held) -> np.ndarray:
        """Half-edges and components with given traction: on the outline, but for labels that are held as a whole."""
        outer = self.operator.structure.outer_edges
        ends = np.searchsorted(number, outer[:, :2])
        label, of = np.unique(outer[:, 2], return_inverse=True)
        both = held[ends].all(axis=1)
        supported = np.column_stack([np.bincount(of, ~both[:, c], minlength=len(label)) == 0 for c in (0, 1)])
        given = np.zeros((len(mesh.edges), 2), bool)
        given[mesh.find(ends)] = ~supported[of]
        return np.repeat(given, 2, axis=0)

    def _gather_fields(self, fields: list[np.ndarray]) -> np.ndarray | None:
        return self._gather((2,), float, lambda s, sub: fields[s].reshape(-1, 2))

    # ---- one step ------------------------------------------------------------------------------------------
    def _estimate(self, step: Step, state: dict) -> Estimate | None:
        """The estimate of one step on rank 0, None elsewhere."""
        points = [k for k, p in enumerate(self.manifest.patterns) if p["given_on"] == "nodes"]
        if np.any(step.weights[points]):
            return Estimate(step.index, reason="under point loads the exact solution has no finite energy")
        fields = self.operator.displacements(step.multipliers, step.weights)
        if self.quadratic:
            return self._recover_quadratic(step, fields)
        thermal = self._thermal(step, (3,))
        fields = self._gather_fields(fields)
        if self.kind == "recovery":
            return self._recover(step, fields, thermal)
        return self._bound(step, state, fields, thermal)

    def _thermal(self, step: Step, shape: tuple) -> np.ndarray | None:
        """(n_t, *shape) suppressed thermal stresses on rank 0."""
        return self._gather(shape, float, lambda s, sub: sum(
            (step.weights[k] * t for k, t in sub.thermal.items()), np.zeros((len(sub.triangles), *shape))))

    def _recover_quadratic(self, step: Step, fields) -> Estimate | None:
        """As `_recover`, for stresses that are linear on the triangles."""
        strain = lambda s, sub: elements.linear_strains(sub.xy[sub.triangles], fields[s].reshape(-1, 2)[sub.elements])
        elastic = self._gather((3, 3), float, lambda s, sub: np.einsum(
            "tmij,tmj->tmi", sub.corner_elasticity, strain(s, sub)))
        thermal = self._thermal(step, (3, 3))
        if not self.root:
            return None
        body, compliance = self.body, self.body.compliance
        sigma = elastic - thermal
        smooth = recovery.recovered_stress(body.mesh.corner, body.mesh.triangles, body.region, sigma)
        share = recovery.energy(body.mesh.area, compliance, smooth - recovery.AT_NODES @ sigma)
        size, norm = np.sqrt(share.sum()), np.sqrt(recovery.energy(body.mesh.area, compliance, elastic).sum())
        return Estimate(step.index, mesh=size, total=size, norm=norm, indicator=np.sqrt(share))

    def _recover(self, step: Step, fields, thermal) -> Estimate | None:
        if not self.root:
            return None
        body = self.body
        elastic = _stress(body.elasticity, body.strain(fields))
        sigma = elastic - thermal
        smooth = equilibration.recovered_stress(body.mesh.triangles, body.region, body.mesh.area, sigma)
        share = equilibration.linear_energy(body.mesh.area, body.compliance, smooth - sigma[:, None])
        size = np.sqrt(share.sum())
        return Estimate(step.index, mesh=size, total=size, norm=body.norm(elastic), indicator=np.sqrt(share))

    def _bound(self, step: Step, state: dict, fields, thermal) -> Estimate | None:
        contact, pairs = self._contact(step, state), self._pairs(state)
        multipliers = contact.multipliers(step.multipliers, self.rows)
        forces = self._forces(pairs, state) if self.boundary.paired.any() else None
        balanced = self._gather_fields(self.operator.displacements(multipliers, step.weights, forces))
        moved = self._moved(step)
        force = self._body_force(step.weights)
        applied = self._applied(step.weights, contact, pairs)
        if not self.root:
            return None
        body = self.body
        elastic = _stress(body.elasticity, body.strain(fields))
        base = _stress(body.elasticity, body.strain(balanced)) - thermal
        deviation, unbalanced, reason = self._equilibrated(base, force, applied)
        if reason:
            return Estimate(step.index, reason=reason)
        pull = lambda u, admissible: _stress(body.elasticity, body.strain(admissible - u))
        before = None
        if moved is not None:  # the QP's own solution
            before = pull(fields - moved, self._admissible(fields - moved, contact)), contact.nodal_gap()
        admissible = self._admissible(fields, contact)
        apart, gap, nodal_gap = pull(fields, admissible), contact.duality_gap(), contact.nodal_gap()
        apart_qp, gap_qp = before or (apart, nodal_gap)
        lift, between, more = self._lifted(admissible, pairs)
        gap += more
        shift = base - elastic + thermal - _stress(body.elasticity, body.strain(lift))  # by the consistent contact forces
        mean = self.deviations.mean(deviation)
        share = np.maximum(self.deviations.energy(deviation) + body.work(2 * mean + shift, shift), 0.0)
        whole = np.maximum(share + body.work(apart - 2 * (mean + shift), apart), 0.0)
        share, whole = (np.sqrt(share) + between) ** 2, (np.sqrt(whole) + between) ** 2
        rate = min(np.nan_to_num(step.contraction), SLOWEST)
        change = 0.0 if moved is None else body.norm(_stress(body.elasticity, body.strain(moved)))
        onward = change / (1 - rate)  # of all changes to come
        return Estimate(
            step.index, mesh=_root(share.sum(), max(gap - nodal_gap, 0.0)),
            solver=_root(body.norm(apart_qp) ** 2, gap_qp) + unbalanced,
            friction=_root(body.norm(apart - apart_qp) ** 2, max(nodal_gap - gap_qp, 0.0)) + onward,
            total=_root(whole.sum(), gap) + unbalanced + onward, norm=body.norm(elastic), indicator=np.sqrt(share))

    def _moved(self, step: Step) -> np.ndarray | None:
        """Torn displacements by the last change of the friction forces, on rank 0; None where there was none."""
        if step.moved is None:
            return None
        return self._gather_fields(self.operator.displacements(step.moved, np.zeros(len(step.weights))))

    def _body_force(self, weights: np.ndarray) -> np.ndarray | None:
        """(n_t, 3, 2) moments of the body force on rank 0; None where the scene declares none."""
        if not self.heavy:
            return None
        return self._gather((3, 2), float, lambda s, sub: sum(weights[k] * f for k, f in sub.body_loads.items()))

    def _contact(self, step: Step, state: dict) -> "_ContactTractions":
        now = step.weights[: len(self.manifest.patterns)]
        before = self.manifest.factors[step.index - 1]
        values = self.boundary.clamped.values
        return _ContactTractions(self.state, self.operator.structure.outer_edges, state, values @ now,
                                 values @ (now - before))

    def _admissible(self, torn: np.ndarray, contact: "_ContactTractions") -> np.ndarray:
        """Torn copy of the displacements averaged over subdomains and made admissible at rigid obstacles.

        Nodes go out of the obstacle. They go onto it, or back to where they stuck, if that costs less energy on the
        vertex's own stiffness than the work it saves. Sets distances and slip of `contact`.
        """
        body, b = self.body, self.boundary
        u = body.untorn(torn)
        at = np.searchsorted(body.gid, b.gid)
        jump = np.zeros((len(b.gid), 2))
        np.add.at(jump, b.term_node, b.term_value[:, None] * u[np.searchsorted(body.gid, b.term_gid)])
        contact.place(jump)
        stiffness = body.stiffness[at].max(axis=1, initial=0)
        for row, direction, move in ((b.normal_row, b.normal, contact.onto_obstacle(stiffness)),
                                     (b.tangential_row, b.tangent, contact.back_to_stick(stiffness))):
            free = direction * ~body.held[at]
            change = np.where(row >= 0, move, 0.0)[:, None] * free / np.maximum((free**2).sum(axis=1), 1e-300)[:, None]
            np.add.at(u, at, change)
        return u[body.vertex]

    def _pairs(self, state: dict) -> list[PairBound] | None:
        """The contact pairs in one step, on rank 0."""
        if not self.root:
            return None
        b, body, outer = self.boundary, self.body, self.operator.structure.outer_edges
        edges = lambda label: np.searchsorted(body.gid, outer[outer[:, 2] == label, :2])
        values = {"vertex": np.searchsorted(body.gid, b.gid), "weight": b.weight, "own_normal": b.normal_row >= 0,
                  "own_tangential": b.tangential_row >= 0, "gap": b.gap, "pressure": -state["sigma_n"],
                  "shear": state["sigma_t"], "bound": state["bound"], "before": state["u_t"] - state["slip"]}
        about = None
        if b.about is not None:
            about = np.zeros((len(body.gid), 2))
            about[np.searchsorted(body.gid, b.about.gid)] = b.about.u
        return [PairBound(body.mesh, edges(one), edges(two), {name: of[b.label == one] for name, of in values.items()},
                          self.state.frictional, self.rows.bilateral, about) for one, two in self.manifest.contact_pairs]

    def _forces(self, pairs: list[PairBound] | None, state: dict) -> list[np.ndarray]:
        """Forces on the rank's subdomains that replace those of the mortar multipliers by those of t*.

        A vertex's force goes to the first subdomain that has it.
        """
        subs, found = self.operator.structure.subdomains, None
        if self.root:
            body, b = self.body, self.boundary
            total = np.zeros((len(body.gid), 2))
            for pair in pairs:
                np.add.at(total, *pair.moments())
            force = (state["sigma_n"] * b.weight)[:, None] * b.normal + (state["sigma_t"] * b.weight)[:, None] * b.tangent
            mine = b.paired[b.term_node]
            np.add.at(total, np.searchsorted(body.gid, b.term_gid[mine]),
                      -(b.term_value[:, None] * force[b.term_node])[mine])
            vertex = np.flatnonzero(total.any(axis=1))
            found = np.unique(body.vertex, return_index=True)[1][vertex], total[vertex]
        torn, force = self.operator.comm.bcast(found)
        start = self.operator.comm.exscan(sum(len(sub.xy) for sub in subs)) or 0
        made = []
        for sub in subs:
            here = (torn >= start) & (torn < start + len(sub.xy))
            values = np.zeros((len(sub.xy), 2))
            values[torn[here] - start] = force[here]
            made.append(values.ravel())
            start += len(sub.xy)
        return made

    def _lifted(self, admissible: np.ndarray, pairs: list[PairBound]):
        """Torn displacements to be added to those that are admissible at rigid obstacles: the sum is at the pairs, too.

        Also the energy norms (n_t,) of what happens inside edges, of displacements and tractions; and the pairs' share
        of the duality gap.
        """
        body = self.body
        u, gap, between = np.zeros((len(body.gid), 2)), 0.0, np.zeros(len(body.torn))
        u[body.vertex] = admissible
        for pair in pairs:
            lift = pair.lift(u, body.stiffness, body.held, body.elasticity)
            u += lift.vertex
            between += lift.bumps + pair.remainder(body.compliance)
            gap += lift.gap
        return u[body.vertex] - admissible, between, gap

    def _applied(self, weights: np.ndarray, contact: "_ContactTractions", pairs) -> np.ndarray | None:
        """(half-edges, 2) moments of loads and contact tractions on the boundary edges, on rank 0."""
        def moments(sub: Subdomain) -> np.ndarray:
            return sum((weights[k] * m for k, m in sub.edge_loads.items()), np.zeros((len(sub.edges), 2, 2)))

        ends = self._gather((2,), int, lambda s, sub: sub.node_gid[sub.edges])
        loads = self._gather((2, 2), float, lambda s, sub: moments(sub))
        if not self.root:
            return None
        mesh = self.body.mesh
        applied = np.zeros((2 * len(mesh.edges), 2))
        number = lambda gid: np.searchsorted(self.body.gid, gid)
        given = [(number(ends), loads), (number(contact.gid[contact.node]), contact.moments)]
        for vertex, value in given + [pair.moments() for pair in pairs]:
            edge = mesh.find(vertex)
            for end in range(2):
                np.add.at(applied, 2 * edge + (vertex[:, end] > vertex[:, 1 - end]), value[:, end])
        return applied

    def _equilibrated(self, base, force, applied) -> tuple[np.ndarray, float, str]:
        """Deviation of a statically admissible stress from `base`, and of _unbalanced what had to be spread for it."""
        body, mesh = self.body, self.body.mesh
        load = equilibration.prolongation(mesh, base, force)
        target = equilibration.averaged_moments(mesh, base)
        moments, imbalance = equilibration.edge_moments(mesh, body.chains, load, target, applied, body.given)
        start = self.deviations.start(moments, base, force)
        return self.deviations.lessen(start), *self._unbalanced(imbalance, np.abs(moments).max())

    @cached_property
    def deviations(self) -> equilibration.Deviations:
        """On rank 0."""
        body = self.body
        return equilibration.Deviations(body.mesh, body.chains, body.given, body.compliance, self.heavy)

    def _unbalanced(self, imbalance: np.ndarray, size: float) -> tuple[float, str]:
        """Energy norm of the forces that vertices are out of balance by, each on the stiffness of its vertex.

        A force that a support takes in a single point is no imbalance, but leaves no finite energy: the second result
        then says so.
        """
        body, mesh = self.body, self.body.mesh
        vertex = mesh.triangles.ravel()[body.chains.order[0]]
        held = body.held[vertex]
        if np.abs(imbalance[held]).max(initial=0) > ROUNDING * size:
            return 0.0, "a support in a single point takes a force: the exact solution has no finite energy"
        return float(np.sqrt((imbalance**2 / body.stiffness[vertex])[~held].sum())), ""


def report(estimates: list[tuple[Step, Estimate]], kind: str) -> dict:
    """Entry for summary.json: the last step's estimate and, under `largest`, that of the step with most energy."""
    if not estimates:
        return {"kind": kind}
    entries = []
    for _, found in estimates:
        parts = {name: float(getattr(found, name)) for name in ("mesh", "solver", "friction", "total", "norm")}
        relative = found.total / found.norm if found.norm > 0 else 0.0
        entries.append({"step": found.step, "reason": found.reason} if found.reason else
                       {"step": found.step, **parts, "relative": float(relative)})
    return {"kind": kind, **entries[0], **({"largest": entries[1]} if len(entries) > 1 else {})}


def _stress(elasticity: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """(n_t, 3) elastic stress."""
    return np.einsum("tij,tj->ti", elasticity, strain)


def _vertex_stiffness(mesh: equilibration.Mesh, elasticity: np.ndarray) -> np.ndarray:
    """(vertices, 2) diagonal entries of the assembled stiffness."""
    gx, gy = mesh.gradient.transpose(2, 0, 1)
    (xx, _, xz), (_, yy, yz), (_, _, zz) = elasticity.transpose(1, 2, 0)[..., None] * mesh.area[:, None]
    local = (xx * gx**2 + 2 * xz * gx * gy + zz * gy**2, yy * gy**2 + 2 * yz * gx * gy + zz * gx**2)
    return np.column_stack([np.bincount(mesh.triangles.ravel(), value.ravel()) for value in local])


def _root(square: float, gap: float) -> float:
    """Largest x with x^2 <= sqrt(square) x + gap."""
    return float(0.5 * np.sqrt(square) + np.sqrt(0.25 * square + gap))


class _ContactTractions:
    """Contact tractions t* of rigid obstacles in the cone, linear on every edge between the computed nodal ones.

    Arrays over the nodes: those of the contact boundary, then the clamped ones. A node that a support holds has no
    traction of its own in the held direction and takes the mean of its neighbours'.
    """

    def __init__(self, contact, outer_edges: np.ndarray, state: dict, move: np.ndarray, step_move: np.ndarray):
        """`contact` is results.ContactState, `outer_edges` (n, 3) vertex, vertex, label, `state` of the step;
        `move`, `step_move` (n_k, 2): displacement of the clamped nodes and its change in the step."""
        b, c = contact.boundary, contact.boundary.clamped
        self.boundary, self.held, self.computed = b, contact.held, state
        self.gid, self.label = np.concatenate([b.gid, c.gid]), np.concatenate([b.label, c.label])
        self.xy, self.normal = np.concatenate([b.xy, c.xy]), np.concatenate([b.normal, c.normal])
        self.tangent = np.column_stack([-self.normal[:, 1], self.normal[:, 0]])
        self.node, self.length = self._edges(outer_edges)
        join = lambda values, more=None: np.concatenate([values, np.zeros(len(c.gid)) if more is None else more])
        self.own_normal, self.own_tangential = (join((rows >= 0) & ~b.paired, np.zeros(len(c.gid), bool))
                                                for rows in (b.normal_row, b.tangential_row))
        self.pressure = -continued(self.node, join(state["sigma_n"]), self.own_normal)
        self.bound = continued(self.node, join(state["bound"]), self.own_normal)
        self.shear = np.zeros(len(self.gid))
        if contact.frictional:
            self.shear = continued(self.node, join(state["sigma_t"]), self.own_tangential)
            self.shear = np.clip(self.shear, -self.bound, self.bound)
        self.bilateral = contact.rows.bilateral
        self.before = state["u_t"] - state["slip"]
        self.distance = join(np.zeros(len(b.gid)), np.maximum(c.gap - (move * c.normal).sum(axis=1), 0.0))
        self.slip = join(np.zeros(len(b.gid)), (step_move * self.tangent[len(b.gid) :]).sum(axis=1))
        self.moments = self._moments()

    def _edges(self, outer_edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contact edges as pairs of nodes (n, 2), and their lengths (n,)."""
        span = outer_edges[:, :2].max() + 1
        keys = self.label * span + self.gid
        order = np.argsort(keys)
        rigid = self.label[np.r_[~self.boundary.paired, np.ones(len(self.boundary.clamped.gid), bool)]]
        edges = outer_edges[np.isin(outer_edges[:, 2], rigid)]
        node = order[np.searchsorted(keys[order], edges[:, 2:] * span + edges[:, :2])]
        return node, np.linalg.norm(self.xy[node[:, 0]] - self.xy[node[:, 1]], axis=1)

    def _moments(self) -> np.ndarray:
        """(n, 2, 2) moments [edge, end, component] of t* against the hats.

        Without friction, where normals differ from node to node, the small tangential sums that the neighbours' normals
        leave at a node are taken off its edges: there is nothing that could hold them.
        """
        i, j = self.node.T
        traction = -self.pressure[:, None] * self.normal + self.shear[:, None] * self.tangent
        third = self.length[:, None] / 6
        moments = np.stack([third * (2 * traction[i] + traction[j]), third * (traction[i] + 2 * traction[j])], axis=1)
        loose = self.own_normal & ~self.own_tangential
        loose[: len(self.held)] &= ~self.held.any(axis=1)
        edges = np.bincount(self.node.ravel(), minlength=len(self.gid))
        rest = (self._nodal(moments) * self.tangent).sum(axis=1) * loose / np.maximum(edges, 1)
        return moments - (rest[:, None] * self.tangent)[self.node]

    def _nodal(self, moments: np.ndarray) -> np.ndarray:
        """Sums of the moments at the nodes, two components each."""
        total = np.zeros((len(self.gid), 2))
        np.add.at(total, self.node, moments)
        return total

    def multipliers(self, computed: np.ndarray, rows) -> np.ndarray:
        """The rank's multipliers with the nodal forces of t* in their contact rows, the others as computed."""
        b = self.boundary
        force = self._nodal(self.moments)[: len(b.gid)]
        normal, tangential = -(force * b.normal).sum(axis=1), -(force * b.tangent).sum(axis=1)
        alone = (b.tangential_row < 0) & self.held.any(axis=1)  # then only one component of the row acts
        free = b.normal * ~self.held
        normal = np.where(alone, -(force * free).sum(axis=1) / np.maximum((free**2).sum(axis=1), 1e-300), normal)
        found = computed.copy()
        for row, node, force in ((rows.normal, rows.normal_node, normal),
                                 (rows.tangential, rows.tangential_node, tangential)):
            found[row] = np.where(b.paired[node], found[row], force[node])
        return found

    def place(self, u: np.ndarray) -> None:
        """Set distances and slip of the contact nodes by their displacements or jumps (n_c, 2)."""
        b, n = self.boundary, len(self.boundary.gid)
        self.distance[:n] = b.gap - (u * b.normal).sum(axis=1)
        self.slip[:n] = (u * b.tangent).sum(axis=1) - self.before

    def onto_obstacle(self, stiffness: np.ndarray) -> np.ndarray:
        """(n_c,) moves of the contact nodes along the normal, see _admissible; stiffness of the nodes."""
        n, force = len(self.boundary.gid), -self.computed["sigma_n"] * self.boundary.weight
        distance = self.distance[:n]
        onto = (distance < 0) | self.bilateral | (stiffness * distance <= force)
        move = np.where(onto & self.own_normal[:n], distance, 0.0)
        self.distance[:n] = np.where(self.bilateral, 0.0, np.maximum(distance - move, 0.0))
        return move

    def back_to_stick(self, stiffness: np.ndarray) -> np.ndarray:
        """(n_c,) moves of the contact nodes along the tangent, see _admissible; stiffness of the nodes."""
        n, c = len(self.boundary.gid), self.computed
        slip = self.slip[:n]
        lost = (c["bound"] + c["sigma_t"] * np.sign(slip)) * self.boundary.weight  # work per slip that friction misses
        move = np.where((stiffness * np.abs(slip) <= lost) & self.own_tangential[:n], -slip, 0.0)
        self.slip[:n] += move
        return move

    def duality_gap(self) -> float:
        """int -t*_n (gap - v_n) + s |slip| + t*_t slip over the contact boundary."""
        product = lambda f, g: float((self.length / 3) @ (
            f[self.node] * g[self.node] + 0.5 * f[self.node] * g[self.node[:, ::-1]]).sum(axis=1))
        return (product(self.pressure, self.distance) + product(self.shear, self.slip)
                + slid(self.length, self.bound[self.node], self.slip[self.node]))

    def nodal_gap(self) -> float:
        """What the QP would make zero: lambda_n (gap - v_n) + g |slip| - lambda_t slip, summed over the nodes."""
        b, c = self.boundary, self.computed
        n = len(b.gid)
        slip = self.slip[:n]
        slid = np.where(b.tangential_row >= 0, c["bound"] * np.abs(slip) + c["sigma_t"] * slip, 0.0)
        return max(float(b.weight @ (-c["sigma_n"] * self.distance[:n] + slid)), 0.0)
