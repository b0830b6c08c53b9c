"""Statically admissible stress from a P1 solution in nodal equilibrium: equilibrated edge tractions.

Ladeveze's construction (Ladeveze, Leguillon 1983; Ladeveze, Pelle: Mastering calculations in linear and nonlinear
mechanics, 2.4; Ainsworth, Oden 2000, chapter 6): find tractions, linear on every edge, that load each triangle K
like the finite element stress sigma_h does,

    int_dK T phi_i = int_K sigma_h grad phi_i - int_K f phi_i      for its three hat functions phi_i,

so that T is in equilibrium with f on every triangle, rotations included as hat functions span them. For a vertex this
is a chain around it: the moments b of T against its hat on successive edges differ by the right side, which adds up to
nothing around an interior vertex as the solution is in nodal equilibrium. What stays free there is first chosen nearest
to the tractions of sigma_h averaged over the two sides of each edge.

Inside a triangle with given tractions a stress of Johnson and Mercier (1978) is unique: symmetric, linear on each of
the three parts that the centroid cuts off, with continuous tractions between them, and with a constant divergence
on each, chosen to give the moments of f. Tractions, body force and stress map together by the Piola transformation,
so that one constant matrix of the reference triangle serves every element.

The deviation sigma* - sigma_h is a sum of few such stresses: at each corner of the triangle moments +b and -b on its two
sides (the sums at the corner are those of sigma_h), the share of f, and on each side a tangential traction that is linear
and odd about its middle, which loads no triangle and is at first zero. The energy of the deviation is then lessened
over these odd tractions and the free constants of the vertices. A few conjugate gradients suffice, as both act locally;
without the odd tractions the estimate is half as sharp.

All functions are pure and work on arrays over the whole mesh; forces are per thickness.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..scene.elements import areas, cross, hat_gradients

CORNER = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])  # of the reference triangle


# ---- mesh -------------------------------------------------------------------------------------------------
@dataclass
class Mesh:
    """Untorn triangles and their half-edges.

    A half-edge is an edge at one of its ends; it is the `first` of the triangle that lies left of it, seen from
    that end, and the `last` of the other one. Number 2 e + k belongs to end k of edge e, smaller vertex first.
    """

    corner: np.ndarray  # (n_t, 3, 2) coordinates
    triangles: np.ndarray  # (n_t, 3) vertices, counterclockwise
    edges: np.ndarray  # (n_e, 2) vertices
    first: np.ndarray  # (n_t, 3) half-edge towards the next vertex of the triangle, by vertex
    last: np.ndarray  # (n_t, 3) half-edge towards the one before
    boundary: np.ndarray  # (n_e,) true on edges with one triangle

    @classmethod
    def of(cls, triangles: np.ndarray, corner: np.ndarray) -> "Mesh":
        """Mesh of triangles (n_t, 3) with corners (n_t, 3, 2)."""
        start, end = triangles, np.roll(triangles, -1, axis=1)
        span = triangles.max() + 1
        keys, edge, count = np.unique(np.minimum(start, end) * span + np.maximum(start, end),
                                      return_inverse=True, return_counts=True)
        edge = edge.reshape(-1, 3)
        first = 2 * edge + (start > end)
        last = np.roll(2 * edge + (end > start), 1, axis=1)
        return cls(corner, triangles, np.column_stack(np.divmod(keys, span)), first, last, count == 1)

    @cached_property
    def gradient(self) -> np.ndarray:
        """(n_t, 3, 2) gradients of the hat functions."""
        return hat_gradients(self.corner)

    def find(self, ends: np.ndarray) -> np.ndarray:
        """Numbers of edges given by their vertices (n, 2); they must exist."""
        span = self.edges.max() + 1
        low, high = np.sort(ends, axis=1).T
        keys = self.edges[:, 0] * span + self.edges[:, 1]
        return np.searchsorted(keys, low * span + high)

    @cached_property
    def outward(self) -> np.ndarray:
        """(n_t, 3, 2) outward normals of the sides k to k + 1, as long as these."""
        side = np.roll(self.corner, -1, axis=1) - self.corner
        return np.stack([side[..., 1], -side[..., 0]], axis=-1)

    @cached_property
    def length(self) -> np.ndarray:
        """(n_e,) of the edges."""
        found = np.empty(len(self.edges))
        found[self.first // 2] = np.linalg.norm(self.outward, axis=2)
        return found

    @cached_property
    def columns(self) -> np.ndarray:
        """(n_t, 2, 2) Jacobian matrices of the maps from the reference triangle."""
        return np.stack([self.corner[:, 1] - self.corner[:, 0], self.corner[:, 2] - self.corner[:, 0]], axis=2)

    @cached_property
    def area(self) -> np.ndarray:
        """(n_t,)"""
        return areas(self.corner)


def full_tensor(voigt: np.ndarray) -> np.ndarray:
    """(..., 2, 2) tensors of stresses (..., 3): s11, s22, s12."""
    return voigt[..., [[0, 2], [2, 1]]]


# ---- equilibrated tractions ---------------------------------------------------------------------------------
@dataclass
class Chains:
    """Triangles around every vertex in counterclockwise order, one chain a vertex; closed ones start anywhere.

    `order` (levels, n_c) holds 3 triangle + local vertex, -1 beyond the end of a chain.
    """

    order: np.ndarray
    closed: np.ndarray  # (n_c,)
    length: np.ndarray  # (n_c,)


def chains(mesh: Mesh) -> Chains:
    """Order the triangles around every vertex."""
    half_edges = 2 * len(mesh.edges)
    starting = np.full(half_edges, -1)  # triangle corner that starts with a half-edge
    starting[mesh.first.ravel()] = np.arange(mesh.first.size)
    following = starting[mesh.last.ravel()]
    open_start = np.flatnonzero(~np.isin(np.arange(mesh.first.size), following))
    on_boundary = np.zeros(mesh.triangles.max() + 1, bool)
    on_boundary[mesh.edges[mesh.boundary]] = True
    inner, at = np.unique(mesh.triangles, return_index=True)
    inner = ~on_boundary[inner]
    heads = np.concatenate([open_start, at[inner]])
    levels, here = [], heads
    while True:
        levels.append(here)
        here = np.where(here >= 0, following[here], -1)
        here = np.where(here == heads, -1, here)
        if not (here >= 0).any():
            break
    order = np.array(levels)
    return Chains(order, np.arange(len(heads)) >= len(open_start), (order >= 0).sum(axis=0))


def prolongation(mesh: Mesh, stress: np.ndarray, body: np.ndarray | None) -> np.ndarray:
    """(n_t, 3, 2) what tractions must do on each triangle: int sigma_h grad phi - int f phi.

    `stress` (n_t, 3) constant on triangles; `body` (n_t, 3, 2) moments of the body force, if there is one.
    """
    inner = mesh.gradient @ full_tensor(stress * mesh.area[:, None])
    return inner if body is None else inner - body


def side_moments(mesh: Mesh, stress: np.ndarray) -> np.ndarray:
    """(n_t, 3, 2) moments of the tractions of constant stresses (n_t, 3) on the sides k to k + 1, alike at both ends."""
    return 0.5 * mesh.outward @ full_tensor(stress)


def averaged_moments(mesh: Mesh, stress: np.ndarray) -> np.ndarray:
    """Moments (half-edges, 2) of the tractions of sigma_h averaged over the sides of each edge.

    Signed for the triangle left of each half-edge.
    """
    traction = side_moments(mesh, stress)
    total, count = np.zeros((2 * len(mesh.edges), 2)), np.zeros(2 * len(mesh.edges))
    for half, value in ((mesh.first, traction), (mesh.last, -np.roll(traction, 1, axis=1))):
        for c in range(2):
            total[:, c] += np.bincount(half.ravel(), value[..., c].ravel(), minlength=len(total))
        count += np.bincount(half.ravel(), minlength=len(count))
    return total / count[:, None]


def edge_moments(mesh: Mesh, around: Chains, load: np.ndarray, target: np.ndarray,
                 given: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments of the equilibrated tractions (half-edges, 2), signed for the triangle left of each half-edge.

    `load` (n_t, 3, 2) from `prolongation`; `target` from `averaged_moments`; `given` (half-edges, 2) moments on the
    body of boundary edges where `known` (half-edges, 2) says so. Second result: the imbalance (chains, 2) of
    the vertices, which was spread evenly over their triangles.
    """
    load, first, last = load.reshape(-1, 2), mesh.first.ravel(), mesh.last.ravel()
    order, n = around.order, around.order.shape[1]
    weight = np.repeat(mesh.length, 2) ** -2.0  # of a deviation of the moments: that of the tractions, squared
    inside = order >= 0
    end = order[around.length - 1, np.arange(n)]
    head_half, end_half = first[order[0]], last[end]
    total = sum(np.where(level[:, None] >= 0, load[level], 0.0) for level in order)
    opened = ~around.closed[:, None]
    fixed_head, fixed_end = known[head_half] & opened, known[end_half] & opened
    balanced = around.closed[:, None] | (fixed_head & fixed_end)
    applied = np.where(fixed_head, given[head_half], 0.0) + np.where(fixed_end, given[end_half], 0.0)
    imbalance = np.where(balanced, applied - total, 0.0)
    spread = imbalance / around.length[:, None]

    # b_0 - offset_k is the moment on the k-th half-edge
    offset, offsets = np.zeros((n, 2)), []
    best, weights = np.zeros((n, 2)), np.zeros(n)
    for level, real in zip(order, inside):
        offsets.append(offset)
        w = np.where(real, weight[first[level]], 0.0)
        best += w[:, None] * (target[first[level]] + offset)
        weights += w
        offset = offset + np.where(real[:, None], load[level] + spread, 0.0)
    w = np.where(around.closed, 0.0, weight[end_half])
    best += w[:, None] * (target[end_half] + offset)
    start = best / (weights + w)[:, None]
    start = np.where(fixed_end, offset - given[end_half], start)  # the end's moment is -given on the triangle left of it
    start = np.where(fixed_head, given[head_half], start)
    moments = np.zeros_like(target)
    for level, real, offset_k in zip(order, inside, offsets):
        moments[first[level[real]]] = (start - offset_k)[real]
    opened = ~around.closed
    moments[end_half[opened]] = (start - offset)[opened]
    return moments, imbalance


# ---- stress in the triangles -----------------------------------------------------------------------------------
@lru_cache(maxsize=1)
def reference_stress() -> np.ndarray:
    """(3, 3, 3, 18): stress [part, node, s11 s22 s12] of the reference triangle by its data.

    Part k lies opposite to corner k and has the nodes k + 1, k + 2 and the centroid. Data: moments of the
    tractions [side, end, component], side k going from corner k to k + 1, then of the body force [corner, component].
    """
    middle = CORNER.mean(axis=0)
    nodes = [np.array([CORNER[(k + 1) % 3], CORNER[(k + 2) % 3], middle]) for k in range(3)]
    unknown = np.arange(27).reshape(3, 3, 3)
    rows, right = [], []

    def traction(part, node, across):
        row = np.zeros((2, 27))
        row[0, unknown[part, node]] = across[0], 0, across[1]
        row[1, unknown[part, node]] = 0, across[1], across[0]
        return row

    for j in range(3):  # between the parts that meet on the line from corner j to the middle
        across = np.array([[0, 1], [-1, 0]]) @ (middle - CORNER[j])
        for left, right_node in ((1, 0), (2, 2)):
            rows.append(traction((j + 1) % 3, left, across) - traction((j + 2) % 3, right_node, across))
            right.append(np.zeros((2, 18)))
    for side in range(3):  # density over [0, 1] with end values 4 m_a - 2 m_b and 4 m_b - 2 m_a
        part, across = (side + 2) % 3, np.array([[0, 1], [-1, 0]]) @ (CORNER[(side + 1) % 3] - CORNER[side])
        for end in range(2):
            value = np.zeros((2, 18))
            for c in range(2):
                value[c, 4 * side + 2 * end + c], value[c, 4 * side + 2 * (1 - end) + c] = 4, -2
            rows.append(traction(part, end, across))
            right.append(value)
    share = np.linalg.inv((4 - 3 * np.eye(3)) / 9) / (1 / 6)  # constant forces of the parts by their moments
    for part in range(3):
        gradient = hat_gradients(nodes[part][None])[0]
        row, value = np.zeros((2, 27)), np.zeros((2, 18))
        for node in range(3):
            row += traction(part, node, gradient[node])
        for c in range(2):
            value[c, 12 + c :: 2] = -share[part]
        rows.append(row)
        right.append(value)
    solution = np.linalg.pinv(np.concatenate(rows)) @ np.concatenate(right)
    return solution.reshape(3, 3, 3, 18)


@lru_cache(maxsize=2)
def reference_modes(body: bool) -> np.ndarray:
    """(27, 9), with `body` (27, 15), stresses of the reference triangle that deviations from sigma_h consist of.

    Modes 2 k + c: moments +1, -1 of component c at corner k on the sides to its next and previous corner; 6 + k:
    moments +t, -t at the ends of side k along its direction t; 9 + 2 k + c: body force with moment 1 of component c at
    corner k, -1/2 on its two sides.
    """
    data = np.zeros((3, 2, 2, 15))  # [side, end, component, mode]
    force = np.zeros((3, 2, 15))
    for k in range(3):
        vertex, share = slice(2 * k, 2 * k + 2), slice(9 + 2 * k, 11 + 2 * k)
        for side, end, sign in ((k, 0, 1), (k - 1, 1, -1)):
            data[side, end, :, vertex] = sign * np.eye(2)
            data[side, end, :, share] = -0.5 * np.eye(2)
        force[k, :, share] = np.eye(2)
        data[k, 0, :, 6 + k] = CORNER[(k + 1) % 3] - CORNER[k]
        data[k, 1, :, 6 + k] = -data[k, 0, :, 6 + k]
    modes = reference_stress().reshape(27, 18) @ np.concatenate([data.reshape(12, 15), force.reshape(6, 15)])
    return modes if body else modes[:, :9]


# ---- deviations ----------------------------------------------------------------------------------------------------
def piola(mesh: Mesh) -> np.ndarray:
    """(3, 3, n_t) maps of reference stresses s11, s22, s12 to those of the triangles: J s J' / det J."""
    (a, b), (c, d) = mesh.columns.transpose(1, 2, 0)
    rows = [[a * a, b * b, 2 * a * b], [c * c, d * d, 2 * c * d], [a * c, b * d, a * d + b * c]]
    return np.array(rows) / (2 * mesh.area)


class Deviations:
    """Deviations sigma* - sigma_h of statically admissible stresses, by coefficients (m, n_t) of `reference_modes`.

    Changes that keep the equilibrium have unknowns with small support: two a vertex, where given tractions do not close
    its chain, the same moment added on all its half-edges, (n_c, 2); one an edge without given tractions, its odd
    tangential traction, (n_e,). They are stacked flat. Triangles come last in all arrays, so that sums over the few
    coefficients run along contiguous rows.
    """

    def __init__(self, mesh: Mesh, around: Chains, known: np.ndarray, compliance: np.ndarray, body: bool):
        """`known` (half-edges, 2): where tractions are given; `compliance` (n_t, 3, 3); `body`: with body force."""
        self.mesh, self.body, self.map = mesh, body, piola(mesh)
        (a, b), (c, d) = mesh.columns.transpose(1, 2, 0)
        self.inverse = np.array([[d, -b], [-c, a]]) / (2 * mesh.area)
        self.free = self._free(mesh, around, known)
        chain = np.empty(mesh.first.size, int)
        for level in around.order:
            inside = level >= 0
            chain[level[inside]] = np.flatnonzero(inside)
        n, edge = around.order.shape[1], mesh.first // 2
        chain = 2 * chain.reshape(-1, 3)
        unknown = np.stack([chain, chain + 1, 2 * n + edge])  # moment x, moment y, odd traction
        self.unknown = np.ascontiguousarray(unknown.transpose(2, 0, 1))  # [corner, 3, t]
        self.scale = (np.where(mesh.first % 2 == 0, 1.0, -1.0) / mesh.length[edge]).T.copy()
        modes = reference_modes(body).reshape(3, 3, 3, -1)  # [part, node, stress, mode]
        mass = np.einsum("mn,pnsi->pmsi", (np.eye(3) + 1) / 36, modes)
        gram = np.einsum("pmsi,pmrj->ijsr", mass, modes)
        local = np.einsum("rat,trs,sbt,t->abt", self.map, compliance, self.map, mesh.area, optimize=True)
        self.matrix = (gram.reshape(-1, 9) @ local.reshape(9, -1)).reshape(*gram.shape[:2], -1)  # energies of the modes

    @staticmethod
    def _free(mesh: Mesh, around: Chains, known: np.ndarray) -> np.ndarray:
        end = mesh.last.ravel()[around.order[around.length - 1, np.arange(around.order.shape[1])]]
        head = mesh.first.ravel()[around.order[0]]
        vertex = around.closed[:, None] | ~(known[head] | known[end])
        return np.concatenate([vertex.ravel(), ~known[::2].any(axis=1)])

    def start(self, moments: np.ndarray, stress: np.ndarray, force: np.ndarray | None) -> np.ndarray:
        """Coefficients for edge moments (half-edges, 2), stress (n_t, 3) and body force moments (n_t, 3, 2)."""
        found = np.zeros(self.matrix.shape[1:])
        corner = moments[self.mesh.first] - side_moments(self.mesh, stress)
        if force is not None:
            corner += 0.5 * force
            found[9:] = self._to_reference(force.transpose(1, 2, 0))
        found[:6] = self._to_reference(corner.transpose(1, 2, 0))
        return found

    def _to_reference(self, vectors: np.ndarray) -> np.ndarray:
        """(6, n_t) vectors (3, 2, n_t) seen from the reference triangle."""
        return np.einsum("abt,kbt->kat", self.inverse, vectors).reshape(6, -1)

    def local(self, x: np.ndarray) -> np.ndarray:
        """Coefficients (9, n_t) of the unknowns x."""
        here = x[self.unknown]  # [corner, (moment x, moment y, edge), t]
        return np.concatenate([self._to_reference(here[:, :2]), here[:, 2] * self.scale])

    def assemble(self, force: np.ndarray) -> np.ndarray:
        """Transpose of `local` on the free unknowns."""
        value = np.empty(self.unknown.shape)
        np.einsum("abt,kat->kbt", self.inverse, force[:6].reshape(3, 2, -1), out=value[:, :2])
        np.multiply(force[6:9], self.scale, out=value[:, 2])
        return self._add(value)

    def _add(self, value: np.ndarray) -> np.ndarray:
        return np.where(self.free, np.bincount(self.unknown.ravel(), value.ravel(), minlength=len(self.free)), 0.0)

    @cached_property
    def diagonal(self) -> np.ndarray:
        """Diagonal of the energy in the unknowns, one where they are not free."""
        value = np.empty(self.unknown.shape)
        for k in range(3):
            block = self.matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
            value[k, :2] = np.einsum("act,abt,bct->ct", self.inverse, block, self.inverse)
            value[k, 2] = self.matrix[6 + k, 6 + k] * self.scale[k] ** 2
        return np.where(self.free, self._add(value), 1.0)

    def _strain(self, y: np.ndarray, modes: int | None = None) -> np.ndarray:
        """Half the derivative of the energy by the coefficients of all or the first `modes`."""
        return np.einsum("ijt,jt->it", self.matrix[:modes, :modes], y)

    def energy(self, y: np.ndarray) -> np.ndarray:
        """(n_t,) int s : C^-1 s of deviations y."""
        return np.einsum("it,it->t", y, self._strain(y))

    def mean(self, y: np.ndarray) -> np.ndarray:
        """(n_t, 3) mean stress of deviations y."""
        average = reference_modes(self.body).reshape(9, 3, -1).mean(axis=0)
        return np.einsum("ijt,jt->ti", self.map, average @ y)

    def lessen(self, y: np.ndarray, gain: float = 0.02, iterations: int = 50) -> np.ndarray:
        """y with changes added that lessen its energy; whatever the number of iterations, equilibrium is kept.

        Conjugate gradients with the diagonal as preconditioner, until an iteration gains less than the part `gain`.
        """
        force = self._strain(y)
        square, residual = float(np.sum(y * force)), -self.assemble(force)
        x, direction, product = np.zeros(len(self.free)), 0.0, 1.0
        for _ in range(iterations):
            scaled = residual / self.diagonal
            previous, product = product, residual @ scaled
            if product == 0.0:
                break
            direction = scaled + product / previous * direction
            applied = self.assemble(self._strain(self.local(direction), 9))
            step = product / (direction @ applied)
            x += step * direction
            residual -= step * applied
            square -= step * product
            if step * product <= gain * square:
                break
        found = y.copy()
        found[:9] += self.local(x)
        return found


# ---- tractions that are not linear on an edge ------------------------------------------------------------------------
@dataclass
class Fan:
    """Triangles on a boundary, cut from their apex at points of the boundary side: on what is piecewise linear there.

    Corners of the n triangles are start and end of the side and apex, counterclockwise. The m parts of a triangle
    follow one another along its side. Fields on the side are given by their values (m, 2 ends, 2) on the parts.
    """

    triangle: np.ndarray  # (n, 3, 2) corners
    owner: np.ndarray  # (m,) triangle of each part
    at: np.ndarray  # (m, 2) ends on the side, in [0, 1]
    piece: np.ndarray  # (m,) given piece, -1 on what none covers

    @classmethod
    def of(cls, triangle: np.ndarray, owner: np.ndarray, at: np.ndarray) -> "Fan":
        """Parts from pieces `at` (k, 2) of the sides of `owner` (k,); what they leave uncovered is added."""
        order = np.lexsort((at[:, 0], owner))
        owner, at = owner[order], at[order]
        head, tail = np.r_[True, owner[1:] != owner[:-1]], np.r_[owner[1:] != owner[:-1], True]
        before = np.where(head, 0.0, np.r_[0.0, at[:-1, 1]])
        void, rest = at[:, 0] > before + 1e-9, tail & (at[:, 1] < 1.0 - 1e-9)
        at = np.column_stack([np.where(void, at[:, 0], before), np.where(tail & ~rest, 1.0, at[:, 1])])
        piece = np.concatenate([order, np.full(void.sum() + rest.sum(), -1)])
        owner = np.concatenate([owner, owner[void], owner[rest]])
        left, right = np.column_stack([before, at[:, 0]]), np.column_stack([at[:, 1], np.ones(len(at))])
        at = np.concatenate([at, left[void], right[rest]])
        order = np.lexsort((at[:, 0], owner))
        return cls(triangle, owner[order], at[order], piece[order])

    @cached_property
    def along(self) -> np.ndarray:
        """(m, 2) side vectors of the triangles."""
        return (self.triangle[:, 1] - self.triangle[:, 0])[self.owner]

    @cached_property
    def length(self) -> np.ndarray:
        """(m,) of the parts' sides."""
        return np.linalg.norm(self.along, axis=1) * (self.at[:, 1] - self.at[:, 0])

    @cached_property
    def corner(self) -> np.ndarray:
        """(m, 3, 2) of the parts."""
        start, apex = self.triangle[self.owner, 0], self.triangle[self.owner, 2]
        return np.stack([start + self.at[:, k, None] * self.along for k in (0, 1)] + [apex], axis=1)

    def given(self, values: np.ndarray) -> np.ndarray:
        """(m, 2, 2) field of values (k, 2, 2) on the pieces, zero on what they do not cover."""
        return np.where((self.piece >= 0)[:, None, None], values[self.piece], 0.0)

    def joined(self, values: np.ndarray) -> np.ndarray:
        """(m, 2, 2) continuous field of values (k, 2, 2) on the pieces, zero at the ends of the sides."""
        found = self.given(values)
        same = np.r_[False, self.owner[1:] == self.owner[:-1]]
        void = self.piece < 0
        found[void & same, 0] = np.roll(found, 1, axis=0)[void & same, 1]
        same = np.roll(same, -1)
        found[void & same, 1] = np.roll(found, -1, axis=0)[void & same, 0]
        return found

    def moments(self, density: np.ndarray) -> np.ndarray:
        """(n, 2, 2) moments [end, component] of a field against the triangle's hats at the ends of the side."""
        (s0, s1), (d0, d1) = self.at.T[:, :, None], density.transpose(1, 0, 2)
        sixth = self.length[:, None] / 6
        end = sixth * (d0 * (2 * s0 + s1) + d1 * (s0 + 2 * s1))
        found = np.zeros((len(self.triangle), 2, 2))
        np.add.at(found[:, 1], self.owner, end)
        np.add.at(found[:, 0], self.owner, sixth * 3 * (d0 + d1) - end)
        return found

    def remainder(self, density: np.ndarray) -> np.ndarray:
        """(n,) int |r|^2 of what a field has besides the linear one with the same moments on every side."""
        side = np.linalg.norm(self.triangle[:, 1] - self.triangle[:, 0], axis=1)[:, None]
        a, b = (self.moments(density) / side[..., None]).transpose(1, 0, 2)
        start, end = (4 * a - 2 * b)[self.owner, None], (4 * b - 2 * a)[self.owner, None]
        r0, r1 = (density - start - self.at[:, :, None] * (end - start)).transpose(1, 0, 2)
        square = self.length / 3 * (r0 * r0 + r0 * r1 + r1 * r1).sum(axis=1)
        return np.bincount(self.owner, square, minlength=len(self.triangle))

    def bump_energy(self, values: np.ndarray, elasticity: np.ndarray) -> np.ndarray:
        """(n,) int C e : e of displacements linear on the parts, `values` (m, 2, 2) on the side, zero at the apex."""
        d = np.einsum("mki,mkj->mij", hat_gradients(self.corner)[:, :2], values)
        strain = np.column_stack([d[:, 0, 0], d[:, 1, 1], d[:, 0, 1] + d[:, 1, 0]])
        area = areas(self.corner)
        return np.bincount(self.owner, np.einsum("mi,mij,mj->m", strain, elasticity[self.owner], strain) * area,
                           minlength=len(self.triangle))


def johnson_mercier(corner: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """(m, 3 parts, 3 nodes, 3) stress with tractions of the given moments (m, side, end, 2), which balance each other."""
    columns = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=2)
    data = np.einsum("mab,mseb->msea", np.linalg.inv(columns), moments).reshape(-1, 12)
    inner = (data @ reference_stress().reshape(27, 18)[:, :12].T).reshape(-1, 9, 3)
    full = columns[:, None] @ full_tensor(inner) @ columns.transpose(0, 2, 1)[:, None]
    return (full[..., [0, 1, 0], [0, 1, 1]] / np.linalg.det(columns)[:, None, None]).reshape(-1, 3, 3, 3)


APEXES = np.array([[0, 0, 6], [1, 1, 4], [2, 2, 2], [0, 3, 3], [3, 0, 3]]) / 6  # barycentric: of a triangle, and inside


def remainder_constant(triangle: np.ndarray, compliance: np.ndarray) -> np.ndarray:
    """(n,) c with ||s||^2 <= c int |r|^2 for a stress s without divergence and with tractions r on side 0 only.

    s lives on the triangle with this side and that one of the `APEXES` for which c is least.
    """
    side = triangle[:, :2]
    inside = [np.concatenate([side, np.einsum("k,nkj->nj", apex, triangle)[:, None]], axis=1) for apex in APEXES]
    return np.min([_remainder_constant(one, compliance) for one in inside], axis=0)


def _remainder_constant(triangle: np.ndarray, compliance: np.ndarray) -> np.ndarray:
    """(n,) the same with s on all of the triangle.

    r may be any field without moments against linear ones. It is a sum of piecewise linear fields on halves of the
    side, of its halves and so on, each without moments on what it lives on and orthogonal to the others (Alpert,
    A class of bases in L2 for the sparse representation of integral operators, 1993). On each of these parts stands a
    triangle similar to the whole one. There the line from the apex to the middle carries the force and the moment of one
    half, and both halves have their stress of Johnson and Mercier. If k is the largest energy of such a field with
    int |r|^2 = 1 on the whole side, it is k / 2^l on level l, and by Cauchy's inequality c = k sum 2^-l = 2 k.
    """
    n, start, end, apex = len(triangle), *triangle.transpose(1, 0, 2)
    middle = (start + end) / 2
    half = np.linalg.norm(end - start, axis=1)[:, None] / 2
    line = apex - middle
    fields = [(shape * np.sqrt(scale), axis) for axis in np.eye(2)  # int |r|^2 = 1 on a side of length 1
              for shape, scale in ((np.array([[1.0, -1], [-1, 1]]), 3.0), (np.array([[0.5, -1], [1, -0.5]]), 4.0))]
    stress = []
    for shape, axis in fields:
        density = (shape[:, None, :, None] * axis) / np.sqrt(2 * half)[:, None]  # [half, n, end, component]
        base = half[:, None] / 6 * (2 * density + density[:, :, ::-1])
        force = base[0].sum(axis=1)
        far = (-cross(start - middle, base[0, :, 0])[:, None] * np.column_stack([-line[:, 1], line[:, 0]])
               - 0.5 * (force * line).sum(axis=1)[:, None] * line) / (line**2).sum(axis=1)[:, None]
        right, none = np.stack([-force - far, far], axis=1), np.zeros((n, 2, 2))
        moments = np.stack([base[0], right, none], axis=1), np.stack([base[1], none, -right[:, ::-1]], axis=1)
        stress.append([johnson_mercier(np.stack([a, b, apex], axis=1), given)
                       for a, b, given in zip((start, middle), (middle, end), moments)])
    mass = (np.eye(3) + 1) / 12 * (0.5 * cross(end - start, apex - start) / 6)[:, None, None]
    gram = np.einsum("ahtpms,tmn,tsr,bhtpnr->tab", np.array(stress), mass, compliance, np.array(stress), optimize=True)
    return 2 * np.linalg.eigvalsh(gram)[:, -1]


# ---- recovery -------------------------------------------------------------------------------------------------------
def recovered_stress(triangles: np.ndarray, region: np.ndarray, area: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """(n_t, 3 corners, 3) stress of Zienkiewicz and Zhu (1987): means over the triangles at each vertex, by region."""
    _, vertex = np.unique(region[:, None] * (triangles.max() + 1) + triangles, return_inverse=True)
    vertex = vertex.reshape(-1)
    weight = np.repeat(area, 3)
    mean = np.column_stack([np.bincount(vertex, weight * np.repeat(s, 3)) for s in stress.T])
    mean /= np.bincount(vertex, weight)[:, None]
    return mean[vertex].reshape(-1, 3, 3)


def linear_energy(area: np.ndarray, compliance: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """(n_t,) int s : C^-1 s of stresses (n_t, 3 corners, 3) linear on the triangles."""
    strain = (stress + stress.sum(axis=1, keepdims=True)) @ compliance
    return np.einsum("tni,tni->t", stress, strain) * area / 12
