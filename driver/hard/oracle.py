"""The assembled (untorn) problem that tests and hard cases compare with, and its contact."""

import copy

import numpy as np

from .dense import require
from .motions import unresisted


class Assembled:
    """The untorn body: stiffness by vertex, its supports, and compliance of its contact nodes.

    Knows nothing of corners, gluing or dual rows. Free dofs only; dof 2 gid + component.
    """

    def __init__(self, manifest, subdomains):
        from scipy.sparse import coo_matrix, csc_matrix

        size, self.subdomains = 2 * manifest.nodes, subdomains
        keys = [2 * sub.node_gid[sub.dof_node] + sub.dof_component for sub in subdomains]
        self.K = csc_matrix((size, size))
        for sub, k in zip(subdomains, keys):
            row, column, value = sub.stiffness.entries()
            self.K = self.K + coo_matrix((value, (k[row], k[column])), self.K.shape)
        self.loads = np.zeros((len(manifest.patterns), size))
        self.held = np.zeros_like(self.loads)
        used, free = np.zeros(size, bool), np.ones(size, bool)
        for sub, k in zip(subdomains, keys):
            used[k] = True
            free[k[sub.fixed]] = False
            known = self.held[:, k[sub.fixed]]  # a vertex of two boundaries has what moves it
            self.held[:, k[sub.fixed]] = np.where(np.abs(sub.fixed_values) > np.abs(known),
                                                  sub.fixed_values, known)
            for total, load in zip(self.loads, sub.loads):
                np.add.at(total, k, load)
        self.free = np.flatnonzero(free & used)
        place = np.zeros(size)
        for sub, k in zip(subdomains, keys):
            place[k] = sub.xy[sub.dof_node, sub.dof_component]
        self.motions = self._free_motions(place, manifest.axisymmetric)
        self._factorize()
        self._collect_contact(manifest, subdomains)
        if manifest.axisymmetric:
            self._revolve(manifest, subdomains)

    def _factorize(self) -> None:
        from scipy.sparse import bmat, csc_matrix
        from scipy.sparse.linalg import splu

        border = csc_matrix(self.motions[self.free])
        held = self.K[self.free][:, self.free]
        self._factor = splu(bmat([[held, border], [border.T, None]]).tocsc()
                            if border.shape[1] else held.tocsc())

    def rounded(self, seed: int) -> "Assembled":
        """The same body, every entry of its stiffness off at random by the rounding of a solution.

        What Cholesky's method finds solves a system with K_ij off by (n + 1) eps |l_i| |l_j| at
        most, |l_i| = sqrt(K_ii) the norm of a row of the factor (N. Higham, Accuracy and Stability
        of Numerical Algorithms, SIAM 2002, theorem 10.3), n the products in the sum that makes an
        entry of the factor: as many as a row has. Their roundings have both signs and add up like
        sqrt(n) (N. Higham, T. Mary, SIAM J. Sci. Comput. 41 (2019) A2815-A2835).
        """
        from scipy.sparse import triu

        other, upper = copy.copy(self), triu(self.K).tocoo()
        signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(upper.data))
        row, factor = np.sqrt(self.K.diagonal()), self._factor.L
        one = np.finfo(float).eps * np.sqrt(factor.nnz / factor.shape[0])
        upper.data = upper.data + signs * one * row[upper.row] * row[upper.col]
        other.K = (upper + triu(upper, 1).T).tocsc()
        other._factorize()
        return other

    def _free_motions(self, place, axisymmetric: bool) -> np.ndarray:
        """(2 vertices, modes): motions that supports and springs leave free; `place` by dof.

        A body of revolution has the one along its axis alone.
        """
        from scipy.linalg import null_space
        from scipy.sparse.csgraph import connected_components

        _, body = connected_components(self.K, directed=False)
        held = np.ones(self.K.shape[0], bool)
        held[self.free] = False
        columns = [np.zeros((self.K.shape[0], 0))]
        for number in np.unique(body[self.free]):
            own = body == number
            vertex = np.flatnonzero(own) // 2
            x, y = (place[2 * vertex + c] - place[2 * vertex + c].mean() for c in (0, 1))
            even = np.flatnonzero(own) % 2 == 0
            size = max(np.ptp(x), np.ptp(y))
            rigid = np.zeros((self.K.shape[0], 3))
            rigid[own] = np.column_stack([even, ~even, np.where(even, -y, x) / size])
            if axisymmetric:
                rigid = rigid[:, 1:2]
            supported, kernel = held & own, np.eye(rigid.shape[1])
            if supported.any():
                kernel = null_space(rigid[supported], rcond=1e-10)
            free = rigid @ kernel
            free[held] = 0.0  # not by rounding either
            columns.append(free @ unresisted(self.K, free))
        return np.hstack(columns)

    def _collect_contact(self, manifest, subdomains):
        names, parts = manifest.columns, {}
        last = 3 + len(names)
        moving = manifest.rooms.get("obstacle_motion", {}).get("own_normals", False)
        for sub in subdomains:
            if sub.contact is None:
                continue
            c = sub.contact
            columns = np.column_stack([c.normal, *(c.columns[name] for name in names)])
            for vertex, label, w, column in zip(c.node, c.label, c.weight, columns):
                part = int(label), np.array([w, *(w * column), *sub.xy[vertex]])
                parts.setdefault(int(sub.node_gid[vertex]), []).append(part)
        free = set(self.free.tolist())
        kept = [(_majority(group), vertex, np.array([part for _, part in group]))
                for vertex, of_vertex in parts.items() if free & {2 * vertex, 2 * vertex + 1}
                for group in _directions(of_vertex, names if moving else None)]
        # label, then x: the model's order along the arc
        kept.sort(key=lambda node: (node[0], *node[2][0, last:], *node[2][0, 1:3]))
        self.label, self.gid = np.array([node[:2] for node in kept], int).reshape(-1, 2).T
        total = np.array([p.sum(axis=0) for _, _, p in kept]).reshape(-1, last + 2)
        self.weight = total[:, 0]
        self.columns = {name: total[:, 3 + k] / self.weight for k, name in enumerate(names)}
        self.gap, self.friction = (sum((self.columns.get(name, 0.0) for name in pair),
                                       np.zeros(len(kept)))
                                   for pair in (("gap", "obstacle"), ("friction", "tresca")))
        self.bilateral = self.columns.get("bilateral", np.zeros(len(kept))) > 0
        self.xy = np.array([p[0, last:] for _, _, p in kept]).reshape(-1, 2)
        self.normal = total[:, 1:3] / np.linalg.norm(total[:, 1:3], axis=1)[:, None]
        if manifest.curved:  # a uniform pressure's force
            self.weight = np.linalg.norm(total[:, 1:3], axis=1)
        self.tangent = np.column_stack([-self.normal[:, 1], self.normal[:, 0]])
        # node, vertex, weight in what meets
        self.terms = np.arange(len(self.gid)), self.gid, np.ones(len(self.gid))

    def _revolve(self, manifest, subdomains) -> None:
        """Weights over the revolution: of a node the integral of its hat times 2 pi r.

        Linear elements only: others, and pairs, `meet` the driver's conditions. One contact
        boundary that turns nowhere by more than a corner has one node a vertex.
        """
        weight = dict.fromkeys(self.gid.tolist(), 0.0)
        for sub in subdomains:
            for (a, b), label in zip(sub.edges, sub.edge_label):
                if label not in manifest.contact_labels:
                    continue
                (r, y), (s, z) = sub.xy[a], sub.xy[b]
                length = np.hypot(s - r, z - y)
                for node, near, far in ((a, r, s), (b, s, r)):
                    gid = int(sub.node_gid[node])
                    if gid in weight:
                        weight[gid] += np.pi * length * (2 * near + far) / 3
        self.weight = np.array([weight[gid] for gid in self.gid.tolist()])

    def meet(self, contact) -> None:
        """Take the conditions of a ContactBoundary: where bodies meet, rows are mortar jumps.

        The weights of the jumps are then the driver's; stiffness and solution stay independent of
        it.
        """
        for name in ("gid", "label", "xy", "weight", "gap", "normal", "tangent", "columns"):
            setattr(self, name, getattr(contact, name))
        self.friction = contact.columns.get("friction", np.zeros(len(contact.gid)))
        self.bilateral = contact.columns.get("bilateral", np.zeros(len(contact.gid))) > 0
        self.terms = contact.term_node, contact.term_gid, contact.term_value

    def distances(self) -> np.ndarray:
        """(1 or steps + 1, n_c) distances at every time, one row where no obstacle moves."""
        moved = self._history("obstacle_x"), self._history("obstacle_y")
        if "phi@0" in self.columns:
            slope = np.stack([self._history("phi_x"), self._history("phi_y")], axis=-1)
            along = -(slope * self.normal).sum(axis=-1)
            met = along != 0  # else the node belongs to a pair
            gap = self._history("phi") / np.where(met, along, 1.0)
            return np.where(met, gap, self.gap)
        still = self.gap
        if "obstacle_x@0" in self.columns or "obstacle_y@0" in self.columns:
            own = np.bincount(self.terms[0], minlength=len(self.gid)) == 1  # not between bodies
            still = np.where(own, self.columns.get("gap", 0.0), self.gap)
        return still + moved[0] * self.normal[:, 0] + moved[1] * self.normal[:, 1]

    def ways(self) -> np.ndarray:
        """(1 or steps, n_c) tangential way of the obstacles in every step."""
        moved = (np.diff(self._history(f"obstacle_{axis}"), axis=0) for axis in "xy")
        along = sum(way * self.tangent[:, c] for c, way in enumerate(moved) if len(way))
        return along if np.ndim(along) else np.zeros((1, len(self.gid)))

    def _history(self, name: str) -> np.ndarray:
        """(steps + 1, n_c) of a column at every time; (1, n_c) zeros if there is none."""
        times = [column for column in self.columns if column.startswith(f"{name}@")]
        if not times:
            return np.zeros((1, len(self.gid)))
        return np.array([self.columns[f"{name}@{k}"] for k in range(len(times))])

    def solve(self, weights, forces=None):
        """Displacements (2 vertices,) under weighted patterns and nodal `forces`."""
        u = np.asarray(weights) @ self.held
        right = np.asarray(weights) @ self.loads + (0 if forces is None else forces) - self.K @ u
        bordered = np.append(right[self.free], np.zeros(self.motions.shape[1]))
        u[self.free] = self._factor.solve(bordered)[: len(self.free)]
        return u

    @property
    def B(self):
        """(2 n_c, 2 vertices): what meets at every contact node, n.u or its jump, then t.u."""
        n, (node, gid, value) = len(self.gid), self.terms
        B = np.zeros((2 * n, self.K.shape[0]))
        for c in (0, 1):
            np.add.at(B, (node, 2 * gid + c), value * self.normal[node, c])
            np.add.at(B, (n + node, 2 * gid + c), value * self.tangent[node, c])
        return B

    def compliance(self):
        """C (2 n_c, 2 n_c): n.u, t.u of the contact nodes under unit nodal forces there."""
        require(self.motions.shape[1] == 0, "a body that no support holds has no compliance")
        B = self.B[:, self.free]
        C = B @ self._factor.solve(np.ascontiguousarray(B.T))
        return (C + C.T) / 2


def _directions(parts: list, columns: list[str] | None = None) -> list[list]:
    """Parts (label, numbers) of a vertex in groups whose normals enclose at most 34 degrees.

    With the `columns` of an obstacle that moves groups that face it have its normal, where that is
    the same at all times.
    """
    if columns is not None:
        parts = [(label, _by_obstacle(numbers, sum(part for _, part in group), columns))
                 for group in _directions(parts) for label, numbers in group]
    groups = []
    for part in parts:
        for group in groups:
            (x, y), (p, q) = part[1][1:3], group[0][1][1:3]
            if abs(np.degrees(np.arctan2(x * q - y * p, x * p + y * q))) <= 34:
                group.append(part)
                break
        else:
            groups.append([part])
    return groups


def _by_obstacle(part, whole, columns: list[str]):
    """The numbers of a `part` of a dual segment, with the obstacle's normal if it meets `whole`."""
    x, y = ([whole[3 + k] for k, name in enumerate(columns) if name.startswith(f"phi_{c}@")]
            for c in "xy")
    turns = np.arctan2(y, x) - np.arctan2(y[0], x[0])
    steady = np.abs(np.sin(turns)).max() <= 1e-7 and np.cos(turns).min() > 0
    normal = np.array([x[0], y[0]]) / max(np.hypot(x[0], y[0]), 1e-300)
    if not (steady and normal @ whole[1:3] < -1e-6 * whole[0]):
        return part
    ring = part[3 + columns.index("ring")] if "ring" in columns else part[0]
    return np.concatenate([part[:1], -normal * ring, part[3:]])


def _majority(parts: list) -> int:
    """The label with most of a node's boundary, of equal ones the smallest."""
    length = {label: sum(numbers[0] for other, numbers in parts if other == label)
              for label, _ in parts}
    return min(length, key=lambda label: (-round(length[label] / max(length.values()), 6), label))
