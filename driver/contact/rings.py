"""Contact of bodies of revolution: nodes are rings, weights integrals over the revolution.

The weight of a node is that of a uniform pressure's force, w_i = int phi_i 2 pi r ds. With linear
elements all weights are positive, that of a node on the axis too, 2 pi L r/6 from an edge of length
L that goes out to r. Of quadratic elements the function of an end has no such integral on an edge
that begins on the axis: there multipliers belong to the two ends alone, dual to the hat functions,

    jump_i = 1/w_i int psi_i u 2 pi r ds,    w_i = int hat_i 2 pi r ds,    int psi_i hat_j r ds
    = delta_ij int hat_i r ds,

as on edges that a mortar coupling covers in part (mortar.py). The psi_i add up to one, so that
uniform pressure passes exactly in cells on the axis as well. Along curved sides (scene/sides.py)
the integrals are by Gauss's rule.
"""

import numpy as np

from ..scene import sides
from .axis import on_axis

HAT = np.column_stack([1 - sides.POINT, sides.POINT])  # at Gauss's points


def ring_rows(xy: np.ndarray, edges: np.ndarray, middles: np.ndarray):
    """Weights (n,) of the nodes at xy (n, 2), and terms (row, node, value) of their conditions.

    `edges` (e, 2) are the nodes at the ends of the boundary's edges, `middles` (e,) those in
    between, or (0,). A row's displacement is the sum of its terms: the node's own, but for what
    begins on the axis with quadratic elements, where middles get no row.
    """
    weight, length = np.zeros(len(xy)), np.linalg.norm(xy[edges[:, 1]] - xy[edges[:, 0]], axis=1)
    r = np.maximum(xy[edges, 0], 0.0)  # (e, 2)
    share = 2 * np.pi * length[:, None]
    hats = share * (2 * r + r[:, ::-1]) / 6
    if not len(middles):
        np.add.at(weight, edges, hats)
        own = np.arange(len(xy))
        return weight, (own, own, np.ones(len(xy)))
    begins = on_axis(xy[:, 0])[edges].any(axis=1)
    whole = np.column_stack([edges, middles])
    ring = share * sides.WEIGHT * (r @ HAT.T)  # (e, points)
    own = np.column_stack([share * r / 6, (share * r * 2 / 6).sum(axis=1)])
    if sides.are_curved(xy[whole]):
        ring = sides.densities(xy[whole], revolved=True)
        hats, own = ring @ HAT, ring @ sides.SHAPE
    np.add.at(weight, edges, np.where(begins[:, None], hats, own[:, :2]))
    np.add.at(weight, middles[~begins], own[~begins, 2])
    plain = weight.copy()  # what a row has of its own node's displacement without the axis
    np.add.at(plain, edges[begins], -hats[begins])
    rows, others, values = [np.arange(len(xy))], [np.arange(len(xy))], [plain]
    whole = whole[begins]
    for k, part in enumerate(_axis_terms(ring[begins]).transpose(1, 2, 0)):
        for j, value in enumerate(part):
            rows.append(whole[:, k])
            others.append(whole[:, j])
            values.append(value)
    row, other, value = (np.concatenate(parts) for parts in (rows, others, values))
    keys, place = np.unique(np.column_stack([row, other]), axis=0, return_inverse=True)
    row, other = keys.T
    value = np.bincount(place, value, len(keys)) / np.where(weight > 0, weight, 1.0)[row]
    used = (weight[row] > 0) & (np.abs(value) > 1e-12)
    return weight, (row[used], other[used], value[used])


def _axis_terms(ring: np.ndarray) -> np.ndarray:
    """(e, 2, 3) int psi_k phi_j 2 pi r ds of edges with 2 pi r ds (e, points) at Gauss's points.

    phi_j are the functions of the ends and the middle.
    """
    D = np.einsum("ep,pk->ek", ring, HAT)
    M = np.einsum("ep,pk,pj->ekj", ring, HAT, HAT)
    mixed = np.einsum("ep,pk,pj->ekj", ring, HAT, sides.SHAPE)
    return D[:, :, None] * np.linalg.solve(M, mixed)
