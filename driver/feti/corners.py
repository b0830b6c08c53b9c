"""Corners: the nodes whose displacements are the primal unknowns of FETI-DP.

They are chosen such that no matrix of a subdomain, and not the coarse problem either, can be
singular by the way a body is cut, whatever its supports are. A *component* is a part of a subdomain
whose triangles edges connect; a subdomain may have several. A *chain* is an interface between two
components, cut at the corners. Then

(1) every chain holds two corners, and both lie in both components: a vertex inside a chain has two
    boundary edges in each of its two subdomains, so one component on each side;
(2) every component holds two corners, SPREAD of its size apart.

K_rr is positive definite: a displacement without energy is one rigid motion in each component, as
it is one in each triangle and those that share an edge share two points; by (2) it vanishes at two
points, so everywhere. The distance bounds its condition number by that of the triangles.

The kernel of S_cc is that of the glued body: corner displacements without energy extend to one
rigid motion of each component, which its two corners determine; by (1) components that share an
edge share this motion. Bodies are connected by edges (Skeleton.check_connected), so each moves as
a whole: the kernel are the rigid motions that its supports leave to it, none if it is supported.

Uneven nodes of interfaces are corners, too (Skeleton.uneven): where triangles are thin, or the
stiffness jumps or has a direction, the Dirichlet preconditioner with any diagonal weights fails,
and adaptive coarse spaces (Mandel, Sousedik, CMAME 196 (2007); Klawonn, Radtke, Rheinbach, SIAM J.
Numer. Anal. 53 (2015)) would need nearly all of such an interface's displacements. In two
dimensions there is room for them. What multipliers then join is as well shaped as in an even body:
condition numbers of 1e5 (P1) to 1e13 (P2) with triangles graded 1:1e4 fall below 400.

So are those of nearly incompressible material (Skeleton.bulky), whose pieces keep their areas: the
flux through each chain would have to be primal at least (Li, Widlund, SIAM J. Numer. Anal. 44
(2006) 2432-2455). With nu = 0.4999 one to two thousand products become less than a hundred.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .skeleton import Skeleton

SPREAD = 0.25  # of a component's size: the least extent of its corners


def corner_vertices(skeleton: Skeleton) -> np.ndarray:
    """Sorted gids of the primal vertices of the rank's subdomains; collective.

    A vertex of a subdomain's boundary is a corner of the subdomain when its two boundary edges
    differ in neighbour or label, when it is shared by three or more subdomains, and where a node
    (of any kind) is uneven. Chains that then hold less than two corners, and components whose
    corners lie close together, get the missing ones by the farthest-point rule.
    """
    neighbour = skeleton.neighbour[skeleton.own_edges]
    edges = skeleton.edges[skeleton.own_edges]
    kind = np.where(neighbour >= 0, neighbour, -1 - edges[:, 3])
    sub = np.repeat(edges[:, 0], 2)
    gid, kind = edges[:, 1:3].ravel(), np.repeat(kind, 2)
    order = np.lexsort((kind, gid, sub))
    sub, gid, kind = sub[order], gid[order], kind[order]
    start = np.flatnonzero((np.diff(sub, prepend=-1) != 0) | (np.diff(gid, prepend=-1) != 0))
    corners = np.empty(0, np.int64)
    if len(start):
        degree = np.diff(np.r_[start, len(gid)])
        mixed = np.minimum.reduceat(kind, start) != np.maximum.reduceat(kind, start)
        corners = gid[start][mixed | (degree != 2)]
    whole = np.union1d(skeleton.uneven_gids, skeleton.bulky_gids)
    uneven = np.intersect1d(whole, skeleton.gids[skeleton.count > 1])
    corners = np.concatenate([corners, skeleton.gids[skeleton.count > 2], uneven])
    corners = _known_to_all(skeleton, corners)
    for missing in (_farthest_points, _spread):
        corners = _known_to_all(skeleton, np.append(corners, missing(skeleton, corners)))
    return corners


def _known_to_all(skeleton: Skeleton, corners: np.ndarray) -> np.ndarray:
    """Sorted `corners` of the rank's subdomains that any rank knows as such; collective."""
    mine = np.isin(skeleton.gids, corners)
    return skeleton.gids[skeleton.over_ranks(np.logical_or, mine)]


def _spread(skeleton: Skeleton, corners: np.ndarray) -> np.ndarray:
    """Corners for components whose corners are less than SPREAD of their size apart, or missing."""
    vertices = len(skeleton.gids)
    own, edges = skeleton.component[skeleton.own_edges], skeleton.edges[skeleton.own_edges]
    if not len(edges):
        return np.empty(0, np.int64)
    component = edges[:, 0] * (own.max() + 1) + own
    vertex = np.searchsorted(skeleton.gids, edges[:, 1:3].T.ravel())
    component, vertex = np.divmod(np.unique(np.tile(component, 2) * vertices + vertex), vertices)
    start = np.flatnonzero(np.diff(component, prepend=-1))
    is_corner, place = np.isin(skeleton.gids, corners)[vertex], skeleton.place[vertex]

    def extent(places: np.ndarray) -> np.ndarray:
        """Diagonals of the components' boxes around their `places`; NaN are none."""
        return np.linalg.norm(np.fmax.reduceat(places, start) - np.fmin.reduceat(places, start),
                              axis=1)

    held = extent(np.where(is_corner[:, None], place, np.nan))
    added = []
    for weak in np.flatnonzero(~(held >= SPREAD * extent(place))):
        mine = slice(start[weak], start[weak + 1] if weak + 1 < len(start) else None)
        xy, known = place[mine], np.flatnonzero(is_corner[mine])
        first = known[0] if len(known) else np.linalg.norm(xy - xy[0], axis=1).argmax()
        second = np.linalg.norm(xy - xy[first], axis=1).argmax()
        added += [skeleton.gids[vertex[mine][k]] for k in (first, second)]
    return np.array(added, np.int64)


def _farthest_points(skeleton: Skeleton, corners: np.ndarray) -> np.ndarray:
    """Corners for connected interface pieces between two subdomains that have less than two.

    The rank of the first of the two sees to it.
    """
    edges = skeleton.edges[skeleton.own_edges]
    neighbour = skeleton.neighbour[skeleton.own_edges]
    one_side = neighbour > edges[:, 0]
    edges = edges[one_side]
    if not len(edges):
        return np.empty(0, np.int64)
    pair = np.unique(edges[:, 0] * skeleton.total + neighbour[one_side],
                     return_inverse=True)[1]
    # a node of the interface graph is a (pair, vertex), so that pieces of different pairs stay
    # apart; corners cut the graph, with a node for every edge that ends there: a piece that leaves
    # a corner and returns to it hangs on that one corner
    ends, vertices = edges[:, 1:3].T.ravel(), len(skeleton.gids)
    vertex, cut = np.searchsorted(skeleton.gids, ends), np.isin(ends, corners)
    inner, number = np.unique((np.tile(pair, 2) * vertices + vertex)[~cut], return_inverse=True)
    node = np.empty(len(ends), np.int64)
    node[~cut], node[cut] = number, len(inner) + np.arange(cut.sum())
    vertex_of = np.concatenate([inner % vertices, vertex[cut]])
    graph = coo_matrix((np.ones(len(pair)), np.split(node, 2)), shape=(len(vertex_of),) * 2)
    pieces, piece = connected_components(graph, directed=False)
    at_corner = np.unique((piece.astype(np.int64) * vertices + vertex_of)[len(inner):])
    held = np.bincount(at_corner // vertices, minlength=pieces)
    added = []
    for weak in np.flatnonzero(held < 2):
        vertices_of_piece = np.sort(vertex_of[piece == weak])
        gids, xy = skeleton.gids[vertices_of_piece], skeleton.place[vertices_of_piece]
        known = np.flatnonzero(np.isin(gids, corners))
        first = known[0] if len(known) else np.linalg.norm(xy - xy[0], axis=1).argmax()
        second = np.linalg.norm(xy - xy[first], axis=1).argmax()
        added += [gids[first], gids[second]]
    return np.array(added, np.int64)
