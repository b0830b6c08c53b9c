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

Parts (after Rey, Rey, Gosselet 2014: strict error bound with separated contributions of the discretization and of the
iterative solver): with sigma_h of the torn, not yet averaged displacements, A <= ||sigma* - sigma_h|| + ||sigma_h -
sigma(v)||. The first is the mesh's, the second the gluing jump's and the penetration's; the nodal sum
-lambda_n (gap - v_n) + ... , which the QP would make zero, is the solver's share of B.
"""

from dataclasses import dataclass

import numpy as np

from . import equilibration
from .loader import Manifest, Subdomain, hat_gradients
from .quasistatic import Step, gathered, scattered

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
    chains: equilibration.Chains
    held: np.ndarray  # (vertices, 2) components that supports hold
    given: np.ndarray  # (half-edges, 2) where the traction is given: boundary edges without support, by component

    def strain(self, u: np.ndarray) -> np.ndarray:
        """(n_t, 3) e11, e22, 2 e12 of torn displacements (n_torn, 2)."""
        d = np.einsum("tij,tik->tjk", hat_gradients(self.mesh.corner), u[self.torn])
        return np.column_stack([d[:, 0, 0], d[:, 1, 1], d[:, 1, 0] + d[:, 0, 1]])

    def stress(self, u: np.ndarray, thermal: np.ndarray) -> np.ndarray:
        """(n_t, 3) stress of torn displacements; `thermal` (n_t, 3) what suppressed expansion takes off."""
        return np.einsum("tij,tj->ti", self.elasticity, self.strain(u)) - thermal

    def norm(self, u: np.ndarray) -> float:
        """Energy norm of torn displacements."""
        strain = self.strain(u)
        return float(np.sqrt(np.einsum("ti,tij,tj,t->", strain, self.elasticity, strain, self.mesh.area, optimize=True)))

    def energy(self, stress: np.ndarray) -> np.ndarray:
        """(n_t,) complementary energies, twice, of stresses (n_t, parts, nodes, 3)."""
        return equilibration.energy(self.mesh.area, self.compliance, stress)


class EnergyEstimator:
    """Estimates the last step of a run and the one with the largest energy. Collective; rank 0 computes."""

    def __init__(self, operator, manifest: Manifest, contact, kind: str):
        """`contact` is results.ContactState; `kind` "equilibrated" (the bound above) or "recovery" (no bound:
        Zienkiewicz and Zhu's averaged stresses)."""
        # between two bodies the equilibrated tractions of both sides would have to be those of one mortar: averaged
        # stresses, which know nothing of contact, stand in
        self.operator, self.manifest, self.kind = operator, manifest, (
            "recovery" if kind == "equilibrated" and contact.boundary.paired.any() else kind)
        self.root = operator.comm.rank == 0
        self.state, self.boundary, self.rows = contact, contact.boundary, contact.rows
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
        found = {name: gathered(step, self.rows, len(self.boundary.gid), self.operator.comm) for name, (_, step, _) in kept.items()}
        return {name: {"energy": energy, "step": found[name], "state": state}
                for name, (energy, _, state) in kept.items()} if self.root else None

    def restore(self, state: dict) -> None:
        """Continue from a `snapshot` of the same problem; the same on every rank."""
        for name, kept in state.items():
            step = scattered(kept["step"], self.rows, self.operator.structure.row_range)
            setattr(self, name, (kept["energy"], step, kept["state"]))

    def estimates(self) -> list[tuple[Step, Estimate]]:
        """Of the last step and, if it is another one, of the step with the largest energy; the same on all ranks."""
        wanted = {kept[1].index: kept for kept in (self.last, self.largest) if kept} if self.kind != "none" else {}
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
        gid = self._gather((), int, lambda s, sub: sub.vertex_gid)
        size = self._gather((2,), int, lambda s, sub: np.array([[len(sub.xy), len(sub.triangles)]]))
        triangles = self._gather((3,), int, lambda s, sub: sub.triangles)
        corner = self._gather((3, 2), float, lambda s, sub: sub.xy[sub.triangles])
        region = self._gather((), int, lambda s, sub: sub.region)
        elasticity = self._gather((3, 3), float, lambda s, sub: sub.elasticity)
        fixed = self._gather((2,), int, lambda s, sub: np.column_stack(
            [sub.vertex_gid[sub.dof_vertex[structure.fixed[s]]], sub.dof_component[structure.fixed[s]]]))
        if not self.root:
            return None
        torn = triangles + np.repeat(np.cumsum(size[:, 0]) - size[:, 0], size[:, 1])[:, None]
        number, vertex = np.unique(gid, return_inverse=True)
        mesh = equilibration.Mesh.of(vertex[torn], corner)
        held = np.zeros((len(number), 2), bool)
        held[np.searchsorted(number, fixed[:, 0]), fixed[:, 1]] = True
        return _Body(number, vertex, torn, region, elasticity, np.linalg.inv(elasticity), mesh,
                     equilibration.chains(mesh), held, self._given(mesh, number, held))

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
        points = [k for k, p in enumerate(self.manifest.patterns) if p["kind"] == "point"]
        if np.any(step.weights[points]):
            return Estimate(step.index, reason="under point loads the exact solution has no finite energy")
        fields = self._gather_fields(self.operator.displacements(step.multipliers, step.weights))
        thermal = self._gather((3,), float, lambda s, sub: sum(
            (step.weights[k] * t for k, t in sub.thermal.items()), np.zeros((len(sub.triangles), 3))))
        if self.kind == "recovery":
            return self._recover(step, fields, thermal)
        return self._bound(step, state, fields, thermal)

    def _recover(self, step: Step, fields, thermal) -> Estimate | None:
        if not self.root:
            return None
        body = self.body
        sigma = body.stress(fields, thermal)
        smooth = equilibration.recovered_stress(body.mesh.triangles, body.region, body.mesh.area, sigma)
        share = body.energy(smooth - sigma[:, None, None])
        size = float(np.sqrt(share.sum()))
        return Estimate(step.index, mesh=size, total=size, norm=body.norm(fields), indicator=np.sqrt(share))

    def _bound(self, step: Step, state: dict, fields, thermal) -> Estimate | None:
        contact = self._contact(step, state)
        multipliers = contact.multipliers(step.multipliers, self.rows)
        balanced = self._gather_fields(self.operator.displacements(multipliers, step.weights))
        force = self._gather((3, 2), float, lambda s, sub: sum(
            (step.weights[k] * f for k, f in sub.body_loads.items()), np.zeros((len(sub.triangles), 3, 2))))
        applied = self._applied(step.weights, contact)
        if not self.root:
            return None
        body, mesh = self.body, self.body.mesh
        sigma, kinematic = body.stress(fields, thermal), body.stress(self._admissible(fields), thermal)
        start, imbalance, largest = self._equilibrated(body.stress(balanced, thermal), force, applied)
        unbalanced, reason = self._unbalanced(imbalance, largest)
        if reason:
            return Estimate(step.index, reason=reason)
        error = equilibration.least_energy(equilibration.Modes(mesh, body.chains, body.given, body.compliance),
                                           start - sigma[:, None, None], mesh.area, body.compliance)
        share, gap, nodal_gap = body.energy(error), contact.duality_gap(), contact.nodal_gap()
        self.stress = error + sigma[:, None, None]
        apart = (sigma - kinematic)[:, None, None]
        friction = step.mismatch / (1 - min(step.contraction, 0.99)) if step.contraction > 0 else step.mismatch
        return Estimate(
            step.index, mesh=_root(share.sum(), max(gap - nodal_gap, 0.0)),
            solver=_root(body.energy(apart.repeat(3, 2)).sum(), nodal_gap) + unbalanced, friction=friction,
            total=_root(body.energy(error + apart).sum(), gap) + unbalanced + friction, norm=body.norm(fields),
            indicator=np.sqrt(share))

    def _contact(self, step: Step, state: dict) -> "_ContactTractions":
        now = step.weights[: len(self.manifest.patterns)]
        before = np.array([self.manifest.amplitude(k, step.index - 1) for k in range(len(now))])
        values = self.boundary.clamped.values
        return _ContactTractions(self.state, self.operator.structure.outer_edges, state, values @ now,
                                 values @ (now - before))

    def _admissible(self, torn: np.ndarray) -> np.ndarray:
        """Torn copy of the displacements averaged over subdomains and pushed out of the obstacle."""
        body, b = self.body, self.boundary
        count = np.bincount(body.vertex)
        u = np.column_stack([np.bincount(body.vertex, torn[:, c]) / count for c in (0, 1)])
        at = np.searchsorted(body.gid, b.gid)
        for i in np.flatnonzero(b.normal_row >= 0):
            free = b.normal[i] * ~body.held[at[i]]
            over = u[at[i]] @ b.normal[i] - b.gap[i]
            if over > 0 or self.rows.bilateral:
                u[at[i]] -= over * free / (free @ free)
        return u[body.vertex]

    def _applied(self, weights: np.ndarray, contact: "_ContactTractions") -> np.ndarray | None:
        """(half-edges, 2) moments of loads and contact tractions on the boundary edges, on rank 0."""
        def moments(sub: Subdomain) -> np.ndarray:
            return sum((weights[k] * m for k, m in sub.edge_loads.items()), np.zeros((len(sub.edges), 2, 2)))

        ends = self._gather((2,), int, lambda s, sub: sub.vertex_gid[sub.edges])
        loads = self._gather((2, 2), float, lambda s, sub: moments(sub))
        if not self.root:
            return None
        mesh = self.body.mesh
        applied = np.zeros((2 * len(mesh.edges), 2))
        for gid, value in ((ends, loads), (contact.gid[contact.node], contact.moments)):
            vertex = np.searchsorted(self.body.gid, gid)
            edge = mesh.find(vertex)
            for end in range(2):
                np.add.at(applied, 2 * edge + (vertex[:, end] > vertex[:, 1 - end]), value[:, end])
        return applied

    def _equilibrated(self, sigma, force, applied) -> tuple[np.ndarray, np.ndarray, float]:
        """Statically admissible stress (n_t, 3, 3, 3), imbalance (vertices, 2) that was spread, largest moment."""
        body, mesh = self.body, self.body.mesh
        load = equilibration.prolongation(mesh, sigma, force)
        target = equilibration.averaged_moments(mesh, sigma)
        moments, imbalance = equilibration.edge_moments(mesh, body.chains, load, target, applied, body.given)
        return equilibration.admissible_stress(mesh, moments, force), imbalance, float(np.abs(moments).max())

    def _unbalanced(self, imbalance: np.ndarray, size: float) -> tuple[float, str]:
        """Energy norm of the forces that vertices are out of balance by, each on the stiffness of its vertex.

        A force that a support takes in a single point is no imbalance, but leaves no finite energy: the second result
        then says so.
        """
        body, mesh = self.body, self.body.mesh
        g = hat_gradients(mesh.corner)
        zero = np.zeros(g.shape[:2])
        strain = np.stack([np.stack([g[..., 0], zero, g[..., 1]], -1), np.stack([zero, g[..., 1], g[..., 0]], -1)], 2)
        local = np.einsum("tvci,tij,tvcj,t->tvc", strain, body.elasticity, strain, mesh.area, optimize=True)
        stiffness = np.column_stack([np.bincount(mesh.triangles.ravel(), local[..., c].ravel()) for c in (0, 1)])
        vertex = mesh.triangles.ravel()[body.chains.order[0]]
        held = body.held[vertex]
        if np.abs(imbalance[held]).max(initial=0) > ROUNDING * size:
            return 0.0, "a support in a single point takes a force: the exact solution has no finite energy"
        return float(np.sqrt((imbalance**2 / stiffness[vertex])[~held].sum())), ""


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


def _root(square: float, gap: float) -> float:
    """Largest x with x^2 <= sqrt(square) x + gap."""
    return float(0.5 * np.sqrt(square) + np.sqrt(0.25 * square + gap))


class _ContactTractions:
    """Contact tractions t* in the cone, linear on every edge between the computed nodal ones.

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
        self.own_normal, self.own_tangential = (join(rows, np.full(len(c.gid), -1)) >= 0
                                                for rows in (b.normal_row, b.tangential_row))
        self.pressure = -self._continued(join(state["sigma_n"]), ~self.own_normal)
        self.bound = self._continued(join(state["bound"]), ~self.own_normal)
        self.shear = np.zeros(len(self.gid))
        if contact.frictional:
            self.shear = self._continued(join(state["sigma_t"]), ~self.own_tangential)
            self.shear = np.clip(self.shear, -self.bound, self.bound)
        distance = join(b.gap - state["u_n"], c.gap - (move * c.normal).sum(axis=1))
        self.distance = np.zeros(len(self.gid)) if contact.rows.bilateral else np.maximum(distance, 0.0)
        self.slip = join(state["slip"], (step_move * self.tangent[len(b.gid) :]).sum(axis=1))
        self.moments = self._moments()

    def _edges(self, outer_edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contact edges as pairs of nodes (n, 2), and their lengths (n,)."""
        span = outer_edges[:, :2].max() + 1
        keys = self.label * span + self.gid
        order = np.argsort(keys)
        edges = outer_edges[np.isin(outer_edges[:, 2], self.label)]
        node = order[np.searchsorted(keys[order], edges[:, 2:] * span + edges[:, :2])]
        return node, np.linalg.norm(self.xy[node[:, 0]] - self.xy[node[:, 1]], axis=1)

    def _continued(self, value: np.ndarray, lacking: np.ndarray) -> np.ndarray:
        """Nodal values, the `lacking` ones replaced by the mean of their neighbours' on the boundary."""
        total, count = np.zeros(len(value)), np.zeros(len(value))
        for here, there in (self.node.T, self.node[:, ::-1].T):
            np.add.at(total, here, np.where(lacking[there], 0.0, value[there]))
            np.add.at(count, here, ~lacking[there])
        return np.where(lacking, total / np.maximum(count, 1), value)

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
        found[rows.normal] = normal[rows.normal_node]
        found[rows.tangential] = tangential[rows.tangential_node]
        return found

    def duality_gap(self) -> float:
        """int -t*_n (gap - v_n) + s |slip| + t*_t slip over the contact boundary."""
        product = lambda f, g: float((self.length / 3) @ (
            f[self.node] * g[self.node] + 0.5 * f[self.node] * g[self.node[:, ::-1]]).sum(axis=1))
        return product(self.pressure, self.distance) + product(self.shear, self.slip) + self._slid()

    def _slid(self) -> float:
        """int s |slip|: slip may change its sign inside an edge; each piece by Simpson's rule, exact there."""
        (s0, s1), (d0, d1) = self.bound[self.node].T, self.slip[self.node].T
        changes = d0 * d1 < 0
        at = np.where(changes, d0 / np.where(changes, d0 - d1, 1.0), 1.0)
        value = lambda x: (s0 + x * (s1 - s0)) * np.abs(d0 + x * (d1 - d0))
        simpson = lambda a, c: (c - a) / 6 * (value(a) + 4 * value((a + c) / 2) + value(c))
        return float(self.length @ (simpson(0.0, at) + simpson(at, 1.0)))

    def nodal_gap(self) -> float:
        """What the QP would make zero: lambda_n (gap - v_n) + g |slip| - lambda_t slip, summed over the nodes."""
        b, c = self.boundary, self.computed
        n = len(b.gid)
        slid = np.where(b.tangential_row >= 0, c["bound"] * np.abs(c["slip"]) + c["sigma_t"] * c["slip"], 0.0)
        return max(float(b.weight @ (-c["sigma_n"] * self.distance[:n] + slid)), 0.0)
