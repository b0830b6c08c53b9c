"""Stage 7: what a run leaves: summary.json, contact.csv, history.csv, convergence.csv, VTU fields.

Fields are gathered on rank 0, which alone writes. Files go to the run's private directory, which the
command line renames as a whole, so a result directory that is there is complete.
"""

from pathlib import Path

import numpy as np

from ..scene import elements
from ..errors import agreed_writes
from ..feti.fetidp import DualOperator
from ..files import renamed, write_json, write_rows
from ..contact.rows import OPEN, STATUS_NAMES
from ..scene.loader import Subdomain
from ..scene.manifest import Manifest
from .quantities import quantities
from ..march.quasistatic import QuasistaticSolver
from ..march.step import Step

CONTACT_COLUMNS = ("step,time,node,x,y,arc,weight,normal_x,normal_y,gap,u_n,u_t,slip,sigma_n,sigma_t,"
                   "bound,status").split(",")
CONTACT_STATE = ("u_n", "u_t", "slip", "sigma_n", "sigma_t", "bound", "status")


def strains(sub: Subdomain, u: np.ndarray) -> np.ndarray:
    """(n_t, 3) mean strains e11, e22, 2 e12 of the displacements u (dofs,) over the triangles."""
    return elements.mean_strains(sub.xy[sub.triangles], u.reshape(-1, 2)[sub.elements])


def stresses(sub: Subdomain, u: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean stresses (n_t, 3) s11, s22, s12 and von Mises stress (n_t,) of displacements u (dofs,).

    `weights` (patterns,) are the factors of the load patterns: what thermal strains would have of stress if
    they were suppressed is taken off.
    """
    strain = strains(sub, u)
    s = np.einsum("tij,tj->ti", sub.elasticity, strain)
    zz = 0.0 if sub.sigma_zz is None else sub.sigma_zz * (strain[:, 0] + strain[:, 1])
    for pattern, suppressed in sub.thermal.items():
        suppressed = suppressed if suppressed.ndim == 2 else suppressed.mean(axis=1)
        s -= weights[pattern] * suppressed
        if sub.sigma_zz is not None:  # isotropic: the same in all directions
            zz = zz - weights[pattern] * suppressed[:, 0]
    mises = np.sqrt(0.5 * ((s[:, 0] - s[:, 1]) ** 2 + (s[:, 1] - zz) ** 2 + (zz - s[:, 0]) ** 2) + 3 * s[:, 2] ** 2)
    return s, mises


class ContactState:
    """Nodal contact quantities of the whole body in every step, on every rank; arrays (n_c,)."""

    def __init__(self, operator: DualOperator, solver: QuasistaticSolver):
        self.operator, self.rows, self.law = operator, solver.rows, solver.law
        self.boundary = operator.structure.contact
        self.frictional = solver.effects.frictional
        self.u_t = solver.initial
        self.held = self._held()
        self._find_terms()

    def _held(self) -> np.ndarray:
        """(n_c, 2): displacement components of the contact nodes that a support holds."""
        mine = np.isin(2 * self.boundary.gid[:, None] + [0, 1], _fixed_keys(self.operator.structure))
        return np.any(self.operator.comm.allgather(mine), axis=0)

    def _find_terms(self) -> None:
        """Where the displacements are that meet at the contact nodes: in every subdomain that has such a node."""
        gids, self._term = np.unique(self.boundary.term_gid, return_inverse=True)
        subs = self.operator.structure.subdomains
        gid = np.concatenate([np.empty(0, np.int64), *(sub.node_gid for sub in subs)])
        here, start = np.flatnonzero(np.isin(gid, gids)), np.cumsum([0, *(len(sub.node_gid) for sub in subs)])
        owner = np.searchsorted(start, here, side="right") - 1
        self._copies = [(s, here[owner == s] - start[s]) for s in np.unique(owner)]  # of the rank: (subdomain, its nodes)
        self._copied = np.concatenate(self.operator.comm.allgather(np.searchsorted(gids, gid[here])))

    def evaluate(self, step: Step, fields: list[np.ndarray]) -> dict[str, np.ndarray]:
        """u_n, u_t, slip, sigma_n, sigma_t, bound and status code of every contact node."""
        b, rows, n = self.boundary, self.rows, len(self.boundary.gid)
        values = np.zeros((4, n))  # lambda_n, lambda_t, bound, status
        values[0, rows.normal_node] = step.multipliers[rows.normal]
        values[1, rows.tangential_node] = step.multipliers[rows.tangential]
        values[2, rows.tangential_node] = rows.friction_bound(step.multipliers)
        values[3, rows.normal_node] = step.status
        values = np.sum(self.operator.comm.allgather(values), axis=0)
        if self.frictional:  # a node that a support holds tangentially has no row of its own, but a bound
            alone = b.tangential_row < 0
            values[2, alone] = self.law.friction_bound(values[0])[alone]
        u = self._jump(fields)
        u_n, u_t = (u * b.normal).sum(axis=1), (u * b.tangent).sum(axis=1)
        slip, self.u_t = u_t - self.u_t, u_t
        return {"u_n": u_n, "u_t": u_t, "slip": slip, "sigma_n": 0.0 - values[0] / b.weight,
                "sigma_t": 0.0 - values[1] / b.weight, "bound": values[2] / b.weight,
                "status": values[3].astype(int)}

    def _jump(self, fields: list[np.ndarray]) -> np.ndarray:
        """(n_c, 2) displacement of the contact nodes, relative to the other body where there is one."""
        b = self.boundary
        copies = np.concatenate([np.empty((0, 2)), *(fields[s].reshape(-1, 2)[node] for s, node in self._copies)])
        copies = np.concatenate(self.operator.comm.allgather(copies))  # in the order of subdomains on any ranks
        mean = np.column_stack([np.bincount(self._copied, u) for u in copies.T]) / np.bincount(self._copied)[:, None]
        jump = np.zeros((len(b.gid), 2))
        np.add.at(jump, b.term_node, b.term_value[:, None] * mean[self._term])
        return jump


def resultants(operator: DualOperator, step: Step, inner, contact: dict) -> tuple[dict, np.ndarray]:
    """Resultants (2,) of loads, support reactions and the obstacles' forces, which add up to zero, and `size`.

    `inner` are the forces K u of the rank's subdomains.

    `size` (2,) is the sum of the absolute values of all these nodal forces: the measure of their balance,
    because resultants themselves may vanish. A support takes what K u leaves after load and contact forces.
    """
    structure, totals = operator.structure, np.zeros((len(inner), 3, 2))
    forces = operator.forces_on_supports(step.multipliers)
    for s in operator.acting:
        sub, force, total = structure.subdomains[s], inner[s], totals[s]
        load = step.weights[: structure.patterns] @ sub.loads
        reaction = (force - load)[structure.fixed[s]] + forces[s]
        total[0] += np.bincount(sub.dof_component, load, minlength=2)
        held = sub.dof_component[structure.fixed[s]]
        total[1] += np.bincount(held, reaction, minlength=2)
        total[2] += np.bincount(sub.dof_component, np.abs(load), minlength=2)
        total[2] += np.bincount(held, np.abs(reaction), minlength=2)
    load, reaction, size = np.concatenate(operator.comm.allgather(totals)).sum(axis=0)  # the same order on any ranks
    b = structure.contact
    weight = np.where(b.paired, 0.0, b.weight)  # forces between two bodies cancel
    force = ((contact["sigma_n"] * weight)[:, None] * b.normal + (contact["sigma_t"] * weight)[:, None] * b.tangent)
    return {"load": load, "reaction": reaction, "contact": force.sum(axis=0)}, size + np.abs(force).sum(axis=0)


class Record:
    """The steps of a run at the contact nodes, on every rank: what its quantities of interest follow from."""

    def __init__(self, operator: DualOperator, solver: QuasistaticSolver):
        self.operator, self.effects, self.contact = operator, solver.effects, ContactState(operator, solver)
        self.states = {name: [] for name in CONTACT_STATE}  # one array (n_c,) a step
        self.displacements = []  # the largest of the body

    def add(self, step: Step) -> tuple[list[np.ndarray], dict[str, np.ndarray]]:
        """Evaluate one step; displacements of the rank's subdomains and the state of the contact nodes."""
        fields = self.operator.displacements(step.multipliers, step.weights)
        state = self.contact.evaluate(step, fields)
        for name, column in self.states.items():
            column.append(state[name])
        squares = np.concatenate([np.zeros(2), *fields]).reshape(-1, 2) ** 2
        largest = float(np.sqrt(squares.sum(axis=1).max()))
        self.displacements.append(max(self.operator.comm.allgather(largest)))
        return fields, state

    def quantities(self) -> tuple[dict[str, float], int]:
        """Quantities of interest, and the index of the step that they belong to."""
        nodes = {name: getattr(self.contact.boundary, name)
                 for name in ("xy", "arc", "weight", "gap", "label", "paired", "middle")}
        steps = {name: np.array(column) for name, column in self.states.items()}
        return quantities(self.effects, nodes, steps, self.displacements)

    def snapshot(self) -> dict:
        """The steps so far, for `restore`."""
        return {"states": {name: np.array(column) for name, column in self.states.items()}, "u_t": self.contact.u_t,
                "displacements": self.displacements}

    def restore(self, state: dict) -> None:
        """Continue from a `snapshot` of the same problem."""
        self.states = {name: list(columns) for name, columns in state["states"].items()}
        self.contact.u_t, self.displacements = state["u_t"], state["displacements"]


class Writer:
    """Collects the steps of a run and writes its files; collective, rank 0 writes."""

    def __init__(self, directory: Path, manifest: Manifest, operator: DualOperator, solver: QuasistaticSolver,
                 fields: bool):
        self.directory, self.manifest, self.operator, self.solver = directory, manifest, operator, solver
        self.root, self.write_fields = operator.comm.rank == 0, fields
        self.record = Record(operator, solver)
        self.contact = self.record.contact
        self.history_rows, self.vtu = [], []  # vtu: (time, name) of every file of fields
        self.several = len(manifest.contact_labels) > 1  # then contact.csv ends with a column for the label
        self.balance, self.dissipated = (0.0, 0.0), 0.0  # the largest resultant left and the largest forces of the run
        self.mesh = self._gather_mesh() if fields else None
        self._boundary()
        with agreed_writes(operator.comm):
            if fields and self.root:
                (directory / "fields").mkdir(exist_ok=True)

    # ---- per step --------------------------------------------------------------------------------
    def add(self, step: Step) -> tuple[dict[str, np.ndarray], float]:
        """Evaluate and record one step; the state of the contact nodes and the body's energy u' K u."""
        fields, state = self.record.add(step)
        inner = self.operator.inner_forces(fields)
        forces, size = resultants(self.operator, step, inner, state)
        left = np.abs(sum(forces.values())).max()
        self.balance = (max(self.balance[0], float(left)), max(self.balance[1], float(size.max())))
        self.dissipated += float(-(state["sigma_t"] * state["slip"] * self.contact.boundary.weight).sum())
        self._history_row(step, state, forces, self.record.displacements[-1])
        if self.write_fields:
            self.vtu.append((step.time, self._write_vtu(step, fields)))
        energy = float(sum(u @ force for u, force in zip(fields, inner)))
        return state, self.operator.comm.allreduce(energy)

    def indicate(self, step: Step, indicator: np.ndarray) -> None:
        """Write the fields of a step again, with the error indicator of every triangle."""
        if self.write_fields:
            fields = self.operator.displacements(step.multipliers, step.weights)
            self._write_vtu(step, fields, {"error_indicator": [indicator]})

    def _history_row(self, step: Step, state, forces, largest) -> None:
        weight, touching = self.contact.boundary.weight, state["status"] != OPEN
        row = {"step": step.index, "time": step.time}
        for number, history in self.manifest.amplitudes.items():
            row[f"amplitude_{number}"] = history[step.index]
        counts = np.bincount(state["status"], minlength=3)
        row |= {"fixed_point_iterations": step.fixed_point_iterations, "dual_multiplications": step.products,
                "contraction": step.contraction,
                "resultant_n": float(state["sigma_n"] @ weight), "resultant_t": float(state["sigma_t"] @ weight)}
        row |= {f"{name}_{axis}": float(force[k]) for name, force in forces.items() for k, axis in enumerate("xy")}
        row |= {f"nodes_{name}": int(count) for name, count in zip(STATUS_NAMES, counts)}
        row |= {"contact_length": float(weight[touching].sum()), "max_displacement": largest,
                "peak_pressure": float(-state["sigma_n"].min(initial=0)), "dissipated": self.dissipated}
        row |= {f"kkt_{name}": value for name, value in step.residuals.items()}
        self.history_rows.append(row)

    def _contact_rows(self):
        """Rows of contact.csv."""
        b, states = self.contact.boundary, self.record.states
        nodes = [[repr(float(v)) for v in (*b.xy[i], b.arc[i], b.weight[i], *b.normal[i], b.gap[i])]
                 for i in range(len(b.gid))]
        for k, row in enumerate(self.history_rows):
            *values, status = (states[name][k].tolist() for name in CONTACT_STATE)
            for i, found in enumerate(zip(*values)):
                yield ([row["step"], repr(row["time"]), i, *nodes[i], *map(repr, found), STATUS_NAMES[status[i]]]
                       + [b.label[i]] * self.several)

    # ---- checkpoints -------------------------------------------------------------------------------
    def snapshot(self) -> dict:
        """What the steps so far have left here, for `restore`."""
        return {"record": self.record.snapshot(), "rows": self.history_rows, "balance": self.balance,
                "dissipated": self.dissipated, "vtu": self.vtu}

    def restore(self, state: dict) -> None:
        """Continue from a `snapshot` of the same problem."""
        self.record.restore(state["record"])
        self.history_rows, self.balance, self.dissipated = state["rows"], state["balance"], state["dissipated"]
        self.vtu = state["vtu"]

    # ---- meshes and fields -------------------------------------------------------------------------
    def _gather_mesh(self):
        """Points, nodes of the elements and subdomain numbers of the torn body on rank 0."""
        subs, nodes = self.operator.structure.subdomains, min(6, elements.NODES[self.manifest.element])
        drawn = [_drawn(sub) for sub in subs]
        number = [(np.cumsum(shown) - 1)[sub.elements[:, :nodes]] for sub, shown in zip(subs, drawn)]
        offset = np.cumsum([0, *(shown.sum() for shown in drawn)])
        part = (np.concatenate([np.empty((0, 2)), *(sub.xy[shown] for sub, shown in zip(subs, drawn))]),
                np.concatenate([np.empty((0, nodes), int), *(own + o for own, o in zip(number, offset))]),
                np.concatenate([np.empty(0, int), *(np.full(len(sub.triangles), sub.index) for sub in subs)]))
        parts = self.operator.comm.gather(part)
        if not self.root:
            return None
        start = np.cumsum([0, *(len(xy) for xy, _, _ in parts)])
        xy, number = (np.concatenate([p[k] for p in parts]) for k in (0, 2))
        return xy, np.concatenate([t + o for (_, t, _), o in zip(parts, start)]), number

    def _write_vtu(self, step: Step, fields, more: dict | None = None) -> str:
        """Displacements and stresses for ParaView; the file's name, under which it is never there in part."""
        name = f"step_{step.index:04d}.vtu"
        mesh = self._deformed(step, fields, more)
        with agreed_writes(self.operator.comm):
            if self.root:
                with renamed(self.directory / "fields" / name) as hidden:
                    mesh.write(hidden)
        return f"fields/{name}"

    def _deformed(self, step: Step, fields, more: dict | None):
        """The mesh with its fields, on rank 0."""
        import meshio

        tensors = [stresses(sub, u, step.weights) for sub, u in zip(self.operator.structure.subdomains, fields)]
        shown = [u.reshape(-1, 2)[_drawn(sub)] for sub, u in zip(self.operator.structure.subdomains, fields)]
        part = (np.concatenate([np.empty((0, 2)), *shown]), np.concatenate([np.empty((0, 3)), *(s for s, _ in tensors)]),
                np.concatenate([np.empty(0), *(m for _, m in tensors)]))
        parts = self.operator.comm.gather(part)
        if not self.root:
            return None
        u, stress, mises = (np.concatenate([p[k] for p in parts]) for k in range(3))
        xy, nodes, number = self.mesh
        cells = ("triangle", nodes) if nodes.shape[1] == 3 else ("triangle6", nodes[:, elements.TO_VTK])
        flat = lambda pairs: np.column_stack([pairs, np.zeros(len(pairs))])
        return meshio.Mesh(flat(xy), [cells], point_data={"displacement": flat(u)},
                           cell_data={"stress": [stress], "von_mises": [mises], "subdomain": [number], **(more or {})})

    def _boundary(self) -> None:
        """boundary.csv: edges of the body's outline with their part in the scene and the unit traction."""
        structure, comm = self.operator.structure, self.operator.comm
        subs, traction = structure.subdomains, [k for k, p in enumerate(self.manifest.patterns) if p["given_on"] == "edges"]
        outline = np.zeros(self.manifest.nodes, bool)
        outline[structure.outer_edges[:, :2]] = outline[structure.outer_middles] = True
        gid = np.concatenate([np.empty(0, np.int64), *(sub.node_gid for sub in subs)])
        near = outline[gid]
        xy = np.concatenate([np.empty((0, 2)), *(sub.xy for sub in subs)])[near]
        loads = np.concatenate([np.empty((structure.patterns, 0)), *(sub.loads for sub in subs)], axis=1)
        force = loads[traction].sum(axis=0).reshape(-1, 2)[near]
        found = comm.gather((gid[near], xy, force, _fixed_keys(structure) // 2))
        with agreed_writes(comm):
            if self.root:
                self._write_boundary(found)

    def _write_boundary(self, found) -> None:
        """`found`: of every rank the nodes on the outline, their places and forces, and the nodes that are held."""
        structure, held = self.operator.structure, np.zeros(self.manifest.nodes, bool)
        place, push = np.zeros((2, self.manifest.nodes, 2))
        for gid, xy, force, fixed in found:
            place[gid], held[fixed] = xy, True
            np.add.at(push, gid, force)
        traction = _edge_tractions(structure.outer_edges, structure.outer_middles, place, push)
        paired = {label for pair in self.manifest.contact_pairs for label in pair}
        start, end, label = structure.outer_edges.T
        rows = []
        for p, q, edge, is_held in zip(place[start].tolist(), place[end].tolist(), label.tolist(), held[start] & held[end]):
            pull = traction.get(edge, [0.0, 0.0])
            role = ("pair" if edge in paired else "contact" if edge in self.manifest.contact_labels else
                    "support" if is_held else "load" if any(pull) else "free")
            rows.append([*p, *q, edge, role, *pull])
        write_rows(self.directory / "boundary.csv", "x0,y0,x1,y1,label,role,traction_x,traction_y".split(","), rows)

    # ---- end of the run --------------------------------------------------------------------------------
    def close(self, summary: dict) -> None:
        """Write tables and summary; `summary` is completed by what the writer knows."""
        with agreed_writes(self.operator.comm):
            if self.root:
                self._write_all(summary)

    def _write_all(self, summary: dict) -> None:
        if len(self.contact.boundary.gid):
            columns = CONTACT_COLUMNS + ["boundary"] * self.several
            write_rows(self.directory / "contact.csv", columns, self._contact_rows())
        if self.history_rows:
            rows = [list(row.values()) for row in self.history_rows]
            write_rows(self.directory / "history.csv", list(self.history_rows[0]), rows)
        write_rows(self.directory / "convergence.csv", ["product", "step", "iteration", "kind", "residual"],
                   self.solver.history.log)
        if self.vtu:
            sets = "".join(f'<DataSet timestep="{t!r}" part="0" file="{name}"/>\n' for t, name in self.vtu)
            (self.directory / "fields.pvd").write_text(
                f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n{sets}'
                "</Collection>\n</VTKFile>\n")
        left, forces = self.balance
        summary["balance"] = left / forces if forces > 0 else 0.0
        if self.history_rows:
            summary["quantities"], at = self.record.quantities()
            summary["quantities_time"] = self.history_rows[at]["time"]
        summary["dissipated"] = self.dissipated
        write_json(self.directory / "summary.json", summary)


def _drawn(sub: Subdomain) -> np.ndarray:
    """(n_v,) whether a node is a point of the files: not the centroids of P2-mixed."""
    found = np.ones(len(sub.xy), bool)
    found[sub.elements[:, 6:]] = False
    return found


def _fixed_keys(structure) -> np.ndarray:
    """(n,) keys 2 gid + component of the displacements of the rank's subdomains that a support holds."""
    keys = [2 * sub.node_gid[sub.dof_node[fixed]] + sub.dof_component[fixed]
            for sub, fixed in zip(structure.subdomains, structure.fixed) if len(fixed)]
    return np.concatenate([np.empty(0, np.int64), *keys])


def _edge_tractions(edges: np.ndarray, middles: np.ndarray, place: np.ndarray, push: np.ndarray) -> dict[int, list[float]]:
    """Mean traction of every outer label, from the nodal forces `push` (nodes, 2) of nodes inside the label.

    `edges` (n, 3) have two ends and a label. A node's part of an edge is the integral of its shape function: halves, with
    `middles` (n,) a sixth, a sixth and the rest.
    """
    size = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1)
    nodes, parts = (edges[:, :2], [0.5, 0.5]) if not len(middles) else (np.column_stack([edges[:, :2], middles]),
                                                                       [1 / 6, 1 / 6, 4 / 6])
    length = np.bincount(nodes.ravel(), np.outer(size, parts).ravel(), len(place))
    first, last = np.full(len(place), np.iinfo(np.int64).max), np.full(len(place), np.iinfo(np.int64).min)
    np.minimum.at(first, nodes, edges[:, 2:])
    np.maximum.at(last, nodes, edges[:, 2:])
    inside, mean = np.flatnonzero(first == last), {}
    for label in np.unique(first[inside]).tolist():
        own = inside[first[inside] == label]
        mean[label] = push[own].sum(axis=0) / length[own].sum()
    largest = max((np.abs(f).max() for f in mean.values()), default=0.0)
    return {label: np.where(np.abs(f) > 1e-9 * largest, f, 0.0).tolist() for label, f in mean.items()}
