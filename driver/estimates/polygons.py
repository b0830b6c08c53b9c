"""Whether straight sides stand for curves somewhere on the outline of a body.

A curve that is meshed is a polygon, whose vertices turn by angles that are alike: each at most
three times those of its neighbours with the same label, one of them at least, as in the library
(adapt.idp). What straight sides lack of it is of second order in their length, whatever the
element, and in no stress of the polygon: neither smoothed stresses nor adjoint problems see it.
"""

import numpy as np

from ..feti.gathering import gather, joined
from ..results.touch import Touch
from ..scene.elements import cross
from .budget import SAFETY

FLAT, CORNER = np.radians(0.1), np.radians(80)  # turning of a straight side's vertices, of corners
ALIKE = 3.0


def stand_for_curves(problem) -> bool:
    """Of a solved problem; labels whose sides are curved do not count. Collective."""
    structure, manifest = problem.structure, problem.manifest
    edges = structure.outer_edges
    edges = edges[~np.isin(edges[:, 2], manifest.curved)]
    ends = np.zeros(manifest.nodes, bool)
    ends[edges[:, :2]] = True
    gid = joined((sub.node_gid for sub in structure.subdomains), np.int64)
    xy = joined((sub.xy for sub in structure.subdomains), float, 2)
    near, comm = ends[gid], problem.operator.comm
    place = np.zeros((manifest.nodes, 2))
    place[gather(comm, gid[near])] = gather(comm, xy[near])
    return any(_is_curve(place, edges[edges[:, 2] == label, :2])
               for label in np.unique(edges[:, 2]))


def _is_curve(place: np.ndarray, edges: np.ndarray) -> bool:
    """Whether a chain of `edges` (n, 2), ends in `place`, turns as a polygon on a curve does."""
    order = np.argsort(edges.ravel(), kind="stable")
    vertex, edge = edges.ravel()[order], order // 2
    pairs = np.flatnonzero((vertex[1:] == vertex[:-1])
                           & (np.bincount(vertex)[vertex[1:]] == 2))
    first, second, at = edge[pairs], edge[pairs + 1], vertex[pairs]
    if not len(at):
        return False
    other = [edges[k].sum(axis=1) - at for k in (first, second)]
    before, after = place[at] - place[other[0]], place[other[1]] - place[at]
    turn = np.abs(np.arctan2(cross(before, after), (before * after).sum(axis=1)))
    of_vertex = np.zeros(len(place))
    of_vertex[at] = np.where(turn < CORNER, turn, 0.0)
    beside = np.maximum(of_vertex[other[0]], of_vertex[other[1]])
    own = of_vertex[at]
    return bool(((own > FLAT) & (own <= ALIKE * beside)).any())


def too_short(touches: list[Touch], ratios: list[float]) -> float:
    """Error of the length of the contact boundaries: straight sides on a curve are too short, in
    the second order of their length.
    """
    if len(touches) < 2:
        return 0.0
    return SAFETY * abs(touches[0].whole - touches[1].whole) / (ratios[0] ** 2 - 1)
