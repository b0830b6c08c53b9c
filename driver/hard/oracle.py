"""Dense, slow and certain solvers that tests and hard cases compare with; each checks itself."""

import copy

import numpy as np

from .motions import unresisted


class OracleFailure(AssertionError):
    """The oracle's own answer does not pass its check: it says nothing about another answer."""


def _require(condition, what: str) -> None:
    if not condition:
        raise OracleFailure(f"the oracle's answer is not certain: {what}")


def box_qp(A, b, lower, upper):
    """Solution x (n,) of min 1/2 x'Ax - b'x, lower <= x <= upper, for A (n, n) SPD, n tiny.

    Primal active set: on the free set F move towards the minimiser of the face; if bounds are in
    the way, stop at the nearest and fix every component that has arrived; at the minimiser of a
    face release the one fixed component whose multiplier has the wrong sign most.

    Terminates: right after a release all free components but the released one are strictly
    inside, and the released one moves inwards because (A_FF^-1)_ii > 0; so the step is positive
    and f decreases strictly between minimisers of faces.  No face comes twice, there are 3^n.

    Works in the variables sqrt(A_ii) x_i, so that units of the components do not matter.
    OracleFailure if the KKT residual is more than rounding.
    """
    scale = np.sqrt(np.diag(A))
    S, c = A / np.outer(scale, scale), b / scale
    low, up = lower * scale, upper * scale
    y = np.clip(np.zeros_like(c), low, up)
    free = (y > low) & (y < up)
    movable = low < up
    tiny = 1e-13 * len(c)
    for _ in range(50 * 3 ** min(len(c), 8)):
        y, free, arrived = _towards_face_minimiser(S, c, low, up, y, free)
        if not arrived:
            continue
        g = S @ y - c
        size = tiny * (np.abs(S) @ np.abs(y) + np.abs(c)).max()
        wrong = np.where(y == low, -g, g) * (~free & movable)
        worst = int(np.argmax(wrong))
        if wrong[worst] <= size:
            break
        free[worst] = True
    else:
        raise OracleFailure("active set did not terminate")
    x = np.clip(np.where(y == low, lower, np.where(y == up, upper, y / scale)), lower, upper)
    assert_kkt(A, b, lower, upper, x, scale)
    return x


def _towards_face_minimiser(S, c, low, up, y, free):
    """One step in the face: (new y, new free set, whether the minimiser was reached)."""
    F = np.flatnonzero(free)
    d = np.zeros_like(y)
    if F.size:
        target = np.linalg.solve(S[np.ix_(F, F)], c[F] - S[np.ix_(F, ~free)] @ y[~free])
        d[F] = target - y[F]
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(d > 0, (up - y) / d, np.where(d < 0, (low - y) / d, np.inf))
    step = min(1.0, room.min(initial=np.inf))
    met = free & (room <= step) if step < 1.0 else np.zeros_like(free)
    y = np.clip(y + step * d, low, up)
    y[met] = np.where(d > 0, up, low)[met]
    return y, free & ~met, not met.any()


def assert_kkt(A, b, lower, upper, x, scale):
    """Feasible, and stationary componentwise in the scaled variables to rounding."""
    _require(np.all(lower <= x) and np.all(x <= upper), "outside its bounds")
    g = A @ x - b
    g = np.where(x == lower, np.minimum(g, 0), g)
    g = np.where(x == upper, np.where(x == lower, 0, np.maximum(A @ x - b, 0)), g)
    size = ((np.abs(A) @ np.abs(x) + np.abs(b)) / scale).max()
    _require(np.all(np.abs(g) / scale <= 1e-11 * size),
             f"gradient of {(np.abs(g) / scale).max():.1e} remains")


# ------------------------------------------------------------------- the assembled (untorn) problem

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
        self._collect_contact(manifest.columns, subdomains, bool(manifest.curved))
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

    def _collect_contact(self, names, subdomains, curved):
        parts, last = {}, 3 + len(names)
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
                for group in _directions(of_vertex)]
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
        if curved:  # a uniform pressure's force
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
        _require(self.motions.shape[1] == 0, "a body that no support holds has no compliance")
        B = self.B[:, self.free]
        C = B @ self._factor.solve(np.ascontiguousarray(B.T))
        return (C + C.T) / 2


def _directions(parts: list) -> list[list]:
    """Parts (label, numbers) of a vertex in groups whose normals enclose at most 34 degrees."""
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


def _majority(parts: list) -> int:
    """The label with most of a node's boundary, of equal ones the smallest."""
    length = {label: sum(numbers[0] for other, numbers in parts if other == label)
              for label, _ in parts}
    return min(length, key=lambda label: (-round(length[label] / max(length.values()), 6), label))


# -------------------------------------------------------- quasistatic contact with Coulomb friction

def warm_box_qp(A, b, lower, upper, guess):
    """box_qp with a guessed solution: tries primal-dual active set steps, falls back on box_qp.

    The active set step may cycle, so its answer is returned only when it passes the KKT check.
    """
    at = np.where(guess <= lower, -1, np.where(guess >= upper, 1, 0))
    at[lower == upper] = -1
    scale = np.sqrt(np.diag(A))
    for _ in range(40):
        x = np.where(at < 0, lower, np.where(at > 0, upper, 0.0))
        F, rest = np.flatnonzero(at == 0), np.flatnonzero(at)
        x[F] = np.linalg.solve(A[np.ix_(F, F)], b[F] - A[np.ix_(F, rest)] @ x[rest])
        g = A @ x - b
        new = np.where((at == 0) & (x < lower), -1, np.where((at == 0) & (x > upper), 1, at))
        new[((at < 0) & (g < 0)) | ((at > 0) & (g > 0))] = 0
        new[lower == upper] = -1
        if np.array_equal(new, at):
            assert_kkt(A, b, lower, upper, x, scale)
            return x
        at = new
    return box_qp(A, b, lower, upper)


def coulomb_step(C, d, friction, start):
    """Multipliers (normal, then tangential) of one time step with local Coulomb friction.

    Successive approximations of the friction bound to rounding around dense QPs; checks the
    conditions of contact and friction of the answer. OracleFailure if the iteration does not
    settle.
    """
    n = len(friction)
    x, rounding = start, max(1e-13, np.finfo(float).eps * np.linalg.cond(C))  # of dense solves
    for _ in range(300):
        g = friction * x[:n]
        new = warm_box_qp(C, d, np.concatenate([np.zeros(n), -g]),
                          np.concatenate([np.full(n, np.inf), g]), x)
        change = np.abs(new[:n] - x[:n]).max()
        x = new
        if change <= rounding * np.abs(x[:n]).max():
            break
    else:
        raise OracleFailure("the oracle's fixed point does not settle")
    _assert_coulomb(C, d, friction, x, max(1e-10, 10 * rounding))
    return x


def _assert_coulomb(C, d, friction, x, slack):
    """Signorini's and Coulomb's conditions at every node, to the relative rounding `slack`."""
    n, move = len(friction), d - C @ x
    size, force = slack * np.abs(d).max(), np.abs(x).max()
    bound = friction * x[:n]
    _require(x[:n].min() >= 0 and move[:n].max() <= size, "penetration or tension")
    _require(np.all(np.abs(move[:n])[x[:n] > 0] <= size), "pressure at a distance")
    _require(np.all(np.abs(x[n:]) <= bound + slack * force), "friction above its bound")
    sticks = np.abs(x[n:]) < bound - slack * force
    _require(np.all(np.abs(move[n:])[sticks] <= size), "slip below the bound")
    _require(np.all(x[n:] * move[n:] >= -size * force), "friction along the slip")


def coulomb_history(body: Assembled, amplitudes):
    """Dict of (steps, n_c): u_n, u_t, sigma_n, sigma_t of the contact nodes.

    `amplitudes` (steps + 1, patterns). Stick refers to the tangential displacement of the step
    before.
    """
    C, B, n = body.compliance(), body.B, len(body.gid)
    unit = np.array([B @ body.solve(w) for w in np.eye(len(body.loads))])
    history = {name: [] for name in ("u_n", "u_t", "sigma_n", "sigma_t")}
    x, u_t = np.zeros(2 * n), np.zeros(n)
    for weights in amplitudes[1:]:
        loaded = weights @ unit
        x = coulomb_step(C, loaded - np.concatenate([body.gap, u_t]), body.friction, x)
        moved = loaded - C @ x
        u_t = moved[n:]
        for name, value in zip(history,
                               (moved[:n], u_t, -x[:n] / body.weight, -x[n:] / body.weight)):
            history[name].append(value)
    return {name: np.array(value) for name, value in history.items()}
