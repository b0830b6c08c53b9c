"""Corners: the vertices whose displacements are the primal unknowns of FETI-DP."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .skeleton import Skeleton


def corner_vertices(skeleton: Skeleton) -> np.ndarray:
    """Sorted gids of the primal vertices.

    A vertex of a subdomain's boundary is a corner of the subdomain when its two boundary edges differ in
    neighbour or label, and when it is shared by three or more subdomains. Interfaces that then hold less
    than two corners could act as a hinge: the farthest-point rule gives them the missing ones.
    """
    neighbour = skeleton.neighbour()
    kind = np.where(neighbour >= 0, neighbour, -1 - skeleton.edges[:, 3])
    sub = np.repeat(skeleton.edges[:, 0], 2)
    gid, kind = skeleton.edges[:, 1:3].ravel(), np.repeat(kind, 2)
    order = np.lexsort((kind, gid, sub))
    sub, gid, kind = sub[order], gid[order], kind[order]
    start = np.flatnonzero(np.r_[True, (np.diff(sub) != 0) | (np.diff(gid) != 0)])
    degree = np.diff(np.r_[start, len(gid)])
    mixed = np.minimum.reduceat(kind, start) != np.maximum.reduceat(kind, start)
    corners = np.union1d(gid[start][mixed | (degree != 2)], skeleton.gids[skeleton.count > 2])
    corners = np.union1d(corners, _farthest_points(skeleton, neighbour, corners))
    return np.union1d(corners, _missing_corners(skeleton, corners))


def _missing_corners(skeleton: Skeleton, corners: np.ndarray) -> np.ndarray:
    """Corners for subdomains that have less than two: an undivided body with one label all round."""
    has = np.bincount(skeleton.nodes[np.isin(skeleton.nodes[:, 1], corners), 0],
                      minlength=int(skeleton.nodes[:, 0].max()) + 1)
    added = []
    for weak in np.flatnonzero(has < 2):
        mine = np.flatnonzero(skeleton.nodes[:, 0] == weak)
        first = mine[np.linalg.norm(skeleton.xy[mine] - skeleton.xy[mine[0]], axis=1).argmax()]
        second = mine[np.linalg.norm(skeleton.xy[mine] - skeleton.xy[first], axis=1).argmax()]
        added += [skeleton.nodes[first, 1], skeleton.nodes[second, 1]]
    return np.array(added, np.int64)


def _farthest_points(skeleton: Skeleton, neighbour: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Corners for interface pieces (connected, between one pair of subdomains) with less than two."""
    one_side = neighbour > skeleton.edges[:, 0]
    edges = skeleton.edges[one_side]
    if not len(edges):
        return np.empty(0, np.int64)
    pair = edges[:, 0] * (skeleton.edges[:, 0].max() + 1) + neighbour[one_side]
    # a node of the interface graph is a (pair, vertex), so that pieces of different pairs stay apart; corners cut
    # the graph: a piece that leaves a corner and returns to it hangs on that one corner
    ends = edges[:, 1:3].T.ravel()
    copy = np.where(np.isin(ends, corners), 1 + np.arange(len(ends)), 0)
    nodes, inverse = np.unique(np.column_stack([np.tile(pair, 2), ends, copy]), axis=0, return_inverse=True)
    a, b = np.split(inverse, 2)
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(len(nodes),) * 2)
    pieces, piece = connected_components(graph, directed=False)
    at_corner = np.unique(np.column_stack([piece, nodes[:, 1]])[nodes[:, 2] > 0], axis=0)
    held = np.bincount(at_corner[:, 0], minlength=pieces)
    place = skeleton.place
    added = []
    for weak in np.flatnonzero(held < 2):
        gids = nodes[piece == weak, 1]
        xy = place[np.searchsorted(skeleton.gids, gids)]
        known = np.flatnonzero(np.isin(gids, corners))
        first = known[0] if len(known) else np.linalg.norm(xy - xy[0], axis=1).argmax()
        second = np.linalg.norm(xy - xy[first], axis=1).argmax()
        added += [gids[first], gids[second]]
    return np.array(added, np.int64)
