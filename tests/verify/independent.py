"""An independent program for one body against a rigid obstacle: nothing of the driver is used.

Another language of thought throughout: the body is whole and its matrix dense; elements are
integrated at the points of a product rule on the collapsed square, four by four; displacements and
nodal contact forces are found together, by Newton's method on the states of the nodes (primal-dual
active sets: Alart, Curnier, CMAME 92 (1991) 353). Forces on the body are -p n + q t, t is n turned
by 90 degrees.
"""

from dataclasses import dataclass, field

import numpy as np

GAUSS = np.polynomial.legendre.leggauss(4)


@dataclass
class Problem:
    """What a scene declares, as functions of places (n, 2) and time."""

    E: float
    nu: float
    contact: object  # (n, 2) -> bool: places on the contact boundary
    supports: list  # (places -> bool, component, (places, t) -> displacement)
    # (places -> bool, (places, normals, t) -> (n, 2))
    tractions: list = field(default_factory=list)
    plane_stress: bool = False
    thermal: object = None  # t -> strain
    normal: tuple | None = None  # of the obstacle; by default the body's
    gap: object = None  # places -> distance
    # of an obstacle that moves: (places, normals, t) -> distance, and (places, since, t) -> (n, 2)
    # way of its surface
    distance: object = None
    surface: object = None
    friction: object = None  # places -> coefficient
    shear_strength: object = None  # places -> stress, without pressure
    preload: bool = False


class Body:
    """Mesh of a body, its stiffness matrix and its contact nodes."""

    def __init__(self, nodes, elements, problem: Problem):
        self.x, self.elements, self.problem = nodes, elements, problem
        self.quadratic = elements.shape[1] == 6
        self.D, self.hot = _hooke(problem)
        self.K, self.heat = self._stiffness()
        self.edges = self._outer_edges()
        self._contact_nodes()

    def _stiffness(self):
        n = 2 * len(self.x)
        K, heat = np.zeros((n, n)), np.zeros(n)
        dofs = (2 * self.elements[:, :, None] + [0, 1]).reshape(len(self.elements), -1)
        for a, wa in zip(*GAUSS):
            for b, wb in zip(*GAUSS):
                r, s = (a + 1) / 2, (b + 1) / 2 * (1 - (a + 1) / 2)
                weight = wa * wb / 4 * (1 - r)
                slopes = _triangle(r, s, self.quadratic)[1]  # (k, 2)
                J = np.einsum("mki,kj->mij", self.x[self.elements], slopes)
                det = np.linalg.det(J)
                gradients = np.einsum("kj,mji->mki", slopes, np.linalg.inv(J))
                B = np.zeros((len(J), 3, dofs.shape[1]))
                B[:, 0, 0::2], B[:, 1, 1::2] = gradients[:, :, 0], gradients[:, :, 1]
                B[:, 2, 0::2], B[:, 2, 1::2] = gradients[:, :, 1], gradients[:, :, 0]
                local = np.einsum("m,mai,ab,mbj->mij", weight * det, B, self.D, B)
                np.add.at(K, (dofs[:, :, None], dofs[:, None, :]), local)
                np.add.at(heat, dofs, np.einsum("m,mai,a->mi", weight * det, B,
                                                self.hot * np.array([1, 1, 0])))
        return K, heat

    def _outer_edges(self) -> np.ndarray:
        """(e, 2 or 3) ends, and the middle, of edges that one element has, body on their left."""
        sides = [(0, 1, 3), (1, 2, 4), (2, 0, 5)]
        columns = 3 if self.quadratic else 2
        every = np.concatenate([self.elements[:, list(side[:columns])] for side in sides])
        keys = np.sort(every[:, :2], axis=1)
        _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
        return every[first[count == 1]]

    def _on(self, where) -> np.ndarray:
        return self.edges[np.all([where(self.x[self.edges[:, k]]) for k in (0, 1)], axis=0)]

    def loads(self, t: float) -> np.ndarray:
        """Nodal forces at a time."""
        f = np.zeros(2 * len(self.x))
        if self.problem.thermal is not None:
            f += self.heat * self.problem.thermal(t)
        for where, traction in self.problem.tractions:
            edges = self._on(where)
            along = self.x[edges[:, 1]] - self.x[edges[:, 0]]
            length = np.hypot(*along.T)
            normal = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
            for a, wa in zip(*GAUSS):
                shape = _line((a + 1) / 2, self.quadratic)
                place = np.einsum("k,eki->ei", shape, self.x[edges])
                force = traction(place, normal, t) * (length * wa / 2)[:, None]
                for k, value in enumerate(shape):
                    np.add.at(f, 2 * edges[:, k], value * force[:, 0])
                    np.add.at(f, 2 * edges[:, k] + 1, value * force[:, 1])
        return f

    def _contact_nodes(self) -> None:
        """Nodes, weights (integrals of shape functions), unit normals, gaps, laws."""
        problem, edges = self.problem, self._on(self.problem.contact)
        along = self.x[edges[:, 1]] - self.x[edges[:, 0]]
        length = np.hypot(*along.T)
        parts = (1 / 6, 1 / 6, 4 / 6) if self.quadratic else (1 / 2, 1 / 2)
        weight, normal = np.zeros(len(self.x)), np.zeros((len(self.x), 2))
        outward = np.column_stack([along[:, 1], -along[:, 0]])
        for k, part in enumerate(parts):
            np.add.at(weight, edges[:, k], part * length)
            np.add.at(normal, edges[:, k], part * outward)
        held = np.zeros(2 * len(self.x), bool)
        for where, component, _ in problem.supports:
            held[2 * np.flatnonzero(where(self.x)) + component] = True
        touching = (weight > 0) & ~(held[0::2] & held[1::2])
        self.nodes = np.flatnonzero(touching)
        self.weight, self.free = weight[self.nodes], ~held
        place = self.x[self.nodes]
        n = normal[self.nodes] / np.hypot(*normal[self.nodes].T)[:, None]
        self.n = n if problem.normal is None else np.tile(problem.normal, (len(place), 1))
        self.t = np.column_stack([-self.n[:, 1], self.n[:, 0]])
        zero = np.zeros(len(place))
        self.gap = zero if problem.gap is None else problem.gap(place)
        self.friction = zero if problem.friction is None else problem.friction(place)
        self.strength = zero if problem.shear_strength is None else (
            problem.shear_strength(place) * self.weight)
        self.rough = problem.friction is not None or problem.shear_strength is not None

    def prescribed(self, t: float) -> np.ndarray:
        """Displacements with those of the supports, zero elsewhere."""
        u = np.zeros(2 * len(self.x))
        for where, component, value in self.problem.supports:
            nodes = np.flatnonzero(where(self.x))
            u[2 * nodes + component] = value(self.x[nodes], t)
        return u


def march(body: Body, times) -> list[dict]:
    """p, q (forces of nodes), u_n, u_t at the contact nodes after each of the times."""
    k, found = len(body.nodes), []
    before, states = np.zeros(k), (np.ones(k, bool), np.zeros(k))
    if body.problem.preload:
        state = _step(body, 0.0, before, states, rough=False)
        before, states = state["u_t"], state["states"]
    place, problem, last = body.x[body.nodes], body.problem, 0.0
    for t in times:
        if problem.distance is not None:
            body.gap = problem.distance(place, body.n, t)
        if problem.surface is not None:
            before = before + (problem.surface(place, last, t) * body.t).sum(axis=1)
        state = _step(body, t, before, states, body.rough)
        before, states, last = state["u_t"], state["states"], t
        found.append(state)
    return found


def _step(body: Body, t: float, before, states, rough: bool) -> dict:
    """One step: Newton on the states until they repeat.

    `states`: which nodes touch, and whether they stick (0) or rub with the force along t (1) or
    against it (-1).
    """
    k, free, start = len(body.nodes), body.free, body.prescribed(t)
    rows = np.zeros((2 * k, len(start)))
    for part, direction in ((0, body.n), (k, body.t)):
        for c in (0, 1):
            rows[part + np.arange(k), 2 * body.nodes + c] = direction[:, c]
    signed = rows[:, free] * np.concatenate([-np.ones(k), np.ones(k)])[:, None]
    K, f = body.K[np.ix_(free, free)], (body.loads(t) - body.K @ start)[free]
    n, stiff, seen = len(f), np.abs(body.K).max(), set()
    for _ in range(500):
        closed, rub = states
        A = np.zeros((n + 2 * k, n + 2 * k))
        b = np.concatenate([f, np.zeros(2 * k)])
        A[:n, :n], A[:n, n:] = K, -signed.T
        stick = rough & (rub == 0) & (closed | (body.strength > 0))
        for row, holds, value in ((0, closed, body.gap), (k, stick, before)):
            place = n + row + np.flatnonzero(holds)
            A[place, :n] = stiff * rows[row : row + k, free][holds]
            b[place] = stiff * (value - rows[row : row + k] @ start)[holds]
            place = n + row + np.flatnonzero(~holds)
            A[place, place] = 1.0
        if rough:
            loose = np.flatnonzero(~stick)
            A[n + k + loose, n + loose] = -(rub * body.friction)[loose]
            b[n + k + loose] = (rub * body.strength)[loose]
        answer = np.linalg.solve(A, b)
        p, q, motion = answer[n : n + k], answer[n + k :], start.copy()
        motion[free] += answer[:n]
        u_n, u_t = np.split(rows @ motion, 2)
        after = _next(body, states, p, q, u_n - body.gap, u_t - before, rough)
        if all(map(np.array_equal, after, states)):
            return {"p": p, "q": q, "u_n": u_n, "u_t": u_t, "states": states}
        key = np.concatenate(after).tobytes()
        if key in seen:  # a circle: change one node alone, the first (Murty)
            first = np.flatnonzero((after[0] != closed) | (after[1] != rub))[0]
            after = tuple(np.where(np.arange(k) == first, *pair) for pair in zip(after, states))
        seen.add(key)
        states = after
    raise AssertionError("the states do not settle")


def _next(body: Body, states, p, q, over, slip, rough: bool):
    """States by the signs of forces and motions; rounding changes none."""
    closed, rub = states
    small, little = 1e-12 * np.abs(p).max(), 1e-12 * max(np.abs(over).max(), np.abs(slip).max())
    touches = np.where(closed, p > -small, over > little)
    if not rough:
        return touches, rub
    bound = body.friction * np.maximum(p, 0) + body.strength
    out = np.abs(q) > bound + small  # of nodes that stick; the others do not slide with the force
    rubs = np.where(rub == 0, np.where(out, np.sign(q), 0.0), np.where(rub * slip > little, 0, rub))
    arrived = touches & ~closed & (body.strength == 0)  # rubbing against the way that it comes
    return touches, np.where(arrived, -np.sign(slip), rubs)


def _hooke(problem: Problem):
    E, nu = problem.E, problem.nu
    if problem.plane_stress:
        a, b, hot = E / (1 - nu**2), nu * E / (1 - nu**2), E / (1 - nu)
    else:
        a = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
        b, hot = a * nu / (1 - nu), E / (1 - 2 * nu)
    return np.array([[a, b, 0], [b, a, 0], [0, 0, E / (2 * (1 + nu))]]), hot


def _triangle(r: float, s: float, quadratic: bool):
    """Shape functions and their slopes by (r, s); middles after vertices, of 01, 12, 20."""
    l = np.array([1 - r - s, r, s])
    d = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    if not quadratic:
        return l, d
    pairs = ((0, 1), (1, 2), (2, 0))
    values = np.array([*(l * (2 * l - 1)), *(4 * l[a] * l[b] for a, b in pairs)])
    slopes = np.array([*((4 * l - 1)[:, None] * d),
                       *(4 * (l[a] * d[b] + l[b] * d[a]) for a, b in pairs)])
    return values, slopes


def _line(s: float, quadratic: bool) -> np.ndarray:
    """Shape functions of an edge: its ends, and its middle."""
    if not quadratic:
        return np.array([1 - s, s])
    return np.array([(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)])
