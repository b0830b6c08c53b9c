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

The energy of sigma* - sigma_h is then lessened over the vertices' free constants and over one more traction an edge that
loads no triangle: tangential, linear and odd about the middle of the edge. A few conjugate gradients suffice, as both
act locally; without the second kind the estimate is half as sharp.

All functions are pure and work on arrays over the whole mesh; forces are per thickness.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .loader import hat_gradients

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

    def find(self, ends: np.ndarray) -> np.ndarray:
        """Numbers of edges given by their vertices (n, 2); they must exist."""
        span = self.edges.max() + 1
        low, high = np.sort(ends, axis=1).T
        keys = self.edges[:, 0] * span + self.edges[:, 1]
        return np.searchsorted(keys, low * span + high)

    @property
    def outward(self) -> np.ndarray:
        """(n_t, 3, 2) outward normals of the sides k to k + 1, as long as these."""
        side = np.roll(self.corner, -1, axis=1) - self.corner
        return np.stack([side[..., 1], -side[..., 0]], axis=-1)

    @property
    def length(self) -> np.ndarray:
        """(n_e,) of the edges."""
        found = np.empty(len(self.edges))
        found[self.first // 2] = np.linalg.norm(self.outward, axis=2)
        return found

    @property
    def columns(self) -> np.ndarray:
        """(n_t, 2, 2) Jacobian matrices of the maps from the reference triangle."""
        return np.stack([self.corner[:, 1] - self.corner[:, 0], self.corner[:, 2] - self.corner[:, 0]], axis=2)

    @property
    def area(self) -> np.ndarray:
        """(n_t,)"""
        a, b = self.corner[:, 1] - self.corner[:, 0], self.corner[:, 2] - self.corner[:, 0]
        return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


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


def prolongation(mesh: Mesh, stress: np.ndarray, body: np.ndarray) -> np.ndarray:
    """(n_t, 3, 2) what tractions must do on each triangle: int sigma_h grad phi - int f phi.

    `stress` (n_t, 3) constant on triangles; `body` (n_t, 3, 2) moments of the body force.
    """
    gradient = hat_gradients(mesh.corner) * mesh.area[:, None, None]
    return gradient @ full_tensor(stress) - body


def averaged_moments(mesh: Mesh, stress: np.ndarray) -> np.ndarray:
    """Moments (half-edges, 2) of the tractions of sigma_h averaged over the sides of each edge.

    Signed for the triangle left of each half-edge.
    """
    traction = 0.5 * np.einsum("tij,tkj->tki", full_tensor(stress), mesh.outward)  # moments, L/2 times the traction
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


def admissible_stress(mesh: Mesh, moments: np.ndarray, body: np.ndarray) -> np.ndarray:
    """(n_t, 3, 3, 3) stress [triangle, part, node, s11 s22 s12] for edge moments and body force moments.

    `moments` (half-edges, 2) as from `edge_moments`; `body` (n_t, 3, 2), which must be in equilibrium with them.
    """
    ends = np.stack([moments[mesh.first], -moments[np.roll(mesh.last, -1, axis=1)]], axis=2)  # [t, side, end, c]
    data = np.concatenate([ends.reshape(len(body), 6, 2), body], axis=1)
    data = data @ np.linalg.inv(mesh.columns).transpose(0, 2, 1)
    inner = data.reshape(-1, 18) @ reference_stress().reshape(27, 18).T
    return (inner.reshape(-1, 9, 3) @ piola(mesh).transpose(0, 2, 1)).reshape(-1, 3, 3, 3)


def piola(mesh: Mesh) -> np.ndarray:
    """(n_t, 3, 3) maps of reference stresses s11, s22, s12 to those of the triangles: J s J' / det J."""
    (a, b), (c, d) = mesh.columns.transpose(1, 2, 0)
    rows = [[a * a, b * b, 2 * a * b], [c * c, d * d, 2 * c * d], [a * c, b * d, a * d + b * c]]
    return np.array(rows).transpose(2, 0, 1) / (2 * mesh.area)[:, None, None]


def energy(area: np.ndarray, compliance: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """(n_t,) int s : C^-1 s of stresses (n_t, parts, 3 nodes, 3) linear on equal parts of the triangles."""
    return np.einsum("tpni,tpni->t", stress, _strain_moments(area, compliance, stress))


def _strain_moments(area: np.ndarray, compliance: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """Moments of the strain C^-1 s against the hats of the parts, shaped like `stress`."""
    weighted = stress + stress.sum(axis=2, keepdims=True)
    flat = weighted.reshape(len(stress), -1, 3) @ (compliance * (area / (12 * stress.shape[1]))[:, None, None])
    return flat.reshape(stress.shape)


# ---- least energy ---------------------------------------------------------------------------------------------------
@lru_cache(maxsize=1)
def reference_modes() -> np.ndarray:
    """(27, 9) stresses of the reference triangle for tractions that load nothing.

    Modes 2 k + c: moments +1, -1 of component c at corner k on its two sides; mode 6 + k: moments +t, -t at the ends
    of side k along its direction t.
    """
    data = np.zeros((3, 2, 2, 9))  # [side, end, component, mode]
    for k in range(3):
        data[k, 0, :, 2 * k : 2 * k + 2] += np.eye(2)
        data[k - 1, 1, :, 2 * k : 2 * k + 2] -= np.eye(2)
        data[k, 0, :, 6 + k] = CORNER[(k + 1) % 3] - CORNER[k]
        data[k, 1, :, 6 + k] = -data[k, 0, :, 6 + k]
    return reference_stress()[..., :12].reshape(27, 12) @ data.reshape(12, 9)


class Modes:
    """Stresses in equilibrium with nothing that may be added to an admissible one, with small support.

    Two a vertex, where its chain is not closed by given tractions: the same moment added on all its half-edges. One an
    edge without given tractions: a tangential traction that is linear, odd and so without force and torque. Unknowns
    are the vertex moments (n_c, 2), then the edge moments (n_e,), stacked flat.
    """

    def __init__(self, mesh: Mesh, around: Chains, known: np.ndarray, compliance: np.ndarray):
        n, last = around.order.shape[1], mesh.last.ravel()
        head = known[mesh.first.ravel()[around.order[0]]]
        end = known[last[around.order[around.length - 1, np.arange(n)]]]
        vertex_free = around.closed[:, None] | ~(head | end)
        edge_free = ~known[::2].any(axis=1)
        self.free = np.concatenate([vertex_free.ravel(), edge_free])
        chain = np.empty(mesh.first.size, int)
        for level in around.order:
            inside = level >= 0
            chain[level[inside]] = np.flatnonzero(inside)
        chain, edge = chain.reshape(-1, 3), mesh.first // 2
        self.unknown = np.concatenate([2 * chain[..., None] + [0, 1], (2 * n + edge)[..., None]], axis=2)
        self.inverse = np.linalg.inv(mesh.columns)
        self.scale = np.where(mesh.first % 2 == 0, 1.0, -1.0) / mesh.length[edge]
        self.map = piola(mesh)
        mass = (np.eye(3) + 1) * (1 / 36)
        modes = reference_modes().reshape(3, 3, 3, 9)
        weighted = np.einsum("mn,pnsi->pmsi", mass, modes)
        gram = np.einsum("pmsi,pmrj->srij", weighted, modes).reshape(9, 81)
        compliance = self.map.transpose(0, 2, 1) @ (compliance * mesh.area[:, None, None]) @ self.map
        self.matrix = (compliance.reshape(-1, 9) @ gram).reshape(-1, 9, 9)  # energies of the reference modes

    def local(self, x: np.ndarray) -> np.ndarray:
        """(n_t, 9) coefficients of the reference modes."""
        here = x[self.unknown]  # [t, corner, (moment x, moment y, edge)]
        vertex = here[..., :2] @ self.inverse.transpose(0, 2, 1)
        return np.concatenate([vertex.reshape(-1, 6), here[..., 2] * self.scale], axis=1)

    def assemble(self, local: np.ndarray) -> np.ndarray:
        """Transpose of `local`, on the free unknowns."""
        vertex, edge = local[:, :6].reshape(-1, 3, 2) @ self.inverse, local[:, 6:] * self.scale
        value = np.concatenate([vertex, edge[..., None]], axis=2)
        return np.where(self.free, np.bincount(self.unknown.ravel(), value.ravel(), minlength=len(self.free)), 0.0)

    def apply(self, x: np.ndarray) -> np.ndarray:
        """Gradient of half the energy of the stress of x."""
        return self.assemble((self.matrix @ self.local(x)[..., None])[..., 0])

    def diagonal(self) -> np.ndarray:
        """Diagonal of `apply`, one where unknowns are not free."""
        matrix, value = self.matrix, np.empty((len(self.matrix), 3, 3))
        for k in range(3):
            block = matrix[:, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
            value[:, k, :2] = np.einsum("tac,tab,tbc->tc", self.inverse, block, self.inverse)
            value[:, k, 2] = matrix[:, 6 + k, 6 + k] * self.scale[:, k] ** 2
        total = np.bincount(self.unknown.ravel(), value.ravel(), minlength=len(self.free))
        return np.where(self.free, total, 1.0)

    def stress(self, x: np.ndarray) -> np.ndarray:
        """(n_t, 3, 3, 3) stress of x."""
        inner = self.local(x) @ reference_modes().T
        return (inner.reshape(-1, 9, 3) @ self.map.transpose(0, 2, 1)).reshape(-1, 3, 3, 3)

    def project(self, strain_moments: np.ndarray) -> np.ndarray:
        """Gradient of half an energy whose strain has these moments (n_t, 3, 3, 3) against the hats of the parts."""
        inner = strain_moments.reshape(-1, 9, 3) @ self.map
        return self.assemble(inner.reshape(-1, 27) @ reference_modes())


def least_energy(modes: Modes, error: np.ndarray, area: np.ndarray, compliance: np.ndarray,
                 gain: float = 0.01, iterations: int = 50) -> np.ndarray:
    """`error` (n_t, 3, 3, 3) = sigma* - sigma_h with modes added that lessen its energy.

    Conjugate gradients with the diagonal as preconditioner, until an iteration gains less than the part `gain` of the
    energy; any iterate is in equilibrium.
    """
    square = energy(area, compliance, error).sum()
    residual = -modes.project(_strain_moments(area, compliance, error))
    diagonal, x, direction, product = modes.diagonal(), np.zeros(len(modes.free)), 0.0, 1.0
    for _ in range(iterations):
        scaled = residual / diagonal
        previous, product = product, residual @ scaled
        if product == 0.0:
            break
        direction = scaled + product / previous * direction
        applied = modes.apply(direction)
        step = product / (direction @ applied)
        x += step * direction
        residual -= step * applied
        square -= step * product
        if step * product <= gain * square:
            break
    return error + modes.stress(x)


# ---- recovery -------------------------------------------------------------------------------------------------------
def recovered_stress(triangles: np.ndarray, region: np.ndarray, area: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """(n_t, 1, 3, 3) stress of Zienkiewicz and Zhu (1987): means over the triangles at each vertex, by region."""
    _, vertex = np.unique(region[:, None] * (triangles.max() + 1) + triangles, return_inverse=True)
    vertex = vertex.reshape(-1)
    weight = np.repeat(area, 3)
    mean = np.column_stack([np.bincount(vertex, weight * np.repeat(s, 3)) for s in stress.T])
    mean /= np.bincount(vertex, weight)[:, None]
    return mean[vertex].reshape(-1, 1, 3, 3)
