"""Equilibrated edge tractions of a P1 solution in nodal equilibrium.

Ladeveze's construction (Ladeveze, Leguillon 1983; Ladeveze, Pelle: Mastering calculations in linear
and nonlinear mechanics, 2.4; Ainsworth, Oden 2000, chapter 6): find tractions, linear on every
edge, that load each triangle K like the finite element stress sigma_h does,

    int_dK T phi_i = int_K sigma_h grad phi_i - int_K f phi_i    for its three hat functions phi_i,

so that T is in equilibrium with f on every triangle, rotations included as hat functions span them.
For a vertex this is a chain around it: the moments b of T against its hat on successive edges
differ by the right side, which adds up to nothing around an interior vertex as the solution is in
nodal equilibrium. What stays free there is first chosen nearest to the tractions of sigma_h
averaged over the two sides of each edge.

All functions are pure and work on arrays over the whole mesh; forces are per thickness.
"""

from dataclasses import dataclass

import numpy as np

from .edge_mesh import Mesh, full_tensor, side_moments


@dataclass
class Chains:
    """Triangles round every vertex, counterclockwise, one chain each; closed ones start anywhere.

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
    vertex, corner = np.unique(mesh.triangles, return_index=True)
    heads = np.concatenate([open_start, corner[~on_boundary[vertex]]])
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

    `stress` (n_t, 3) constant on triangles; `body` (n_t, 3, 2) moments of a body force, if any.
    """
    inner = mesh.gradient @ full_tensor(stress * mesh.area[:, None])
    return inner if body is None else inner - body


def averaged_moments(mesh: Mesh, stress: np.ndarray) -> np.ndarray:
    """Moments (half-edges, 2) of edges' mean tractions of sigma_h, signed for the left triangle."""
    traction = side_moments(mesh, stress)
    total, count = np.zeros((2 * len(mesh.edges), 2)), np.zeros(2 * len(mesh.edges))
    for half, value in ((mesh.first, traction), (mesh.last, -np.roll(traction, 1, axis=1))):
        for c in range(2):
            total[:, c] += np.bincount(half.ravel(), value[..., c].ravel(), minlength=len(total))
        count += np.bincount(half.ravel(), minlength=len(count))
    return total / count[:, None]


def edge_moments(mesh: Mesh, around: Chains, load: np.ndarray, target: np.ndarray,
                 given: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments of the equilibrated tractions (half-edges, 2), signed for the triangle on the left.

    `load` (n_t, 3, 2) from `prolongation`; `target` from `averaged_moments`; `given` (half-edges,
    2) moments on the body of boundary edges where `known` (half-edges, 2) says so. Second result:
    the imbalance (chains, 2) of the vertices, which was spread evenly over their triangles.
    """
    load, first, last = load.reshape(-1, 2), mesh.first.ravel(), mesh.last.ravel()
    order, n = around.order, around.order.shape[1]
    weight = np.repeat(mesh.length, 2) ** -2.0  # of a deviation: by traction, squared
    inside = order >= 0
    end = order[around.length - 1, np.arange(n)]
    head_half, end_half = first[order[0]], last[end]
    total = sum(np.where(level[:, None] >= 0, load[level], 0.0) for level in order)
    opened = ~around.closed[:, None]
    fixed_head, fixed_end = known[head_half] & opened, known[end_half] & opened
    balanced = around.closed[:, None] | (fixed_head & fixed_end)
    applied = np.where(fixed_head, given[head_half], 0.0)
    applied = applied + np.where(fixed_end, given[end_half], 0.0)
    imbalance = np.where(balanced, applied - total, 0.0)
    spread = imbalance / around.length[:, None]

    offset, offsets = np.zeros((n, 2)), []  # b_0 - offset_k is the k-th half-edge's moment
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
    # the end's moment is -given on the triangle left of it
    start = np.where(fixed_end, offset - given[end_half], start)
    start = np.where(fixed_head, given[head_half], start)
    moments = np.zeros_like(target)
    for level, real, offset_k in zip(order, inside, offsets):
        moments[first[level[real]]] = (start - offset_k)[real]
    opened = ~around.closed
    moments[end_half[opened]] = (start - offset)[opened]
    return moments, imbalance
