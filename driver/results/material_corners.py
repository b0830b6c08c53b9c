"""Places of contact boundaries where materials meet: corners of one material beside the other.

At such a corner stresses grow like r^-a with the distance r, pressure as at an end of contact, the
more the less alike the materials are (D. B. Bogy, J. Appl. Mech. 38 (1971) 377-386). Where neither
friction acts nor the other side yields, and the materials meet along the normal, the mirror image
beyond the boundary continues them without a corner; meshes then see no growth.
"""

import numpy as np

from ..feti.gathering import gather, joined, largest

JUMP = 1.5  # of the stiffness from triangle to triangle: less grows by no more than meshes hide


def material_corners(structure, comm) -> np.ndarray:
    """(n_c,) whether triangles round a contact node, or round a node of the other body that it
    meets, differ in stiffness by JUMP or more. Collective.
    """
    boundary = structure.contact.declared
    found = np.zeros(len(boundary.gid), bool)
    laws = {id(sub.elasticity): sub.elasticity for sub in structure.subdomains}
    traces = [np.einsum("tii->t", law) for law in laws.values()]
    softest, stiffest = [-1, 1] * largest(comm, np.array([
        max((-k.min() for k in traces), default=-np.inf),
        max((k.max() for k in traces), default=-np.inf)]))
    if stiffest < JUMP * softest:  # one material, as in most scenes
        return found
    gids = np.unique(boundary.term_gid)
    own = [_stiffness(sub, gids) for sub in structure.subdomains]
    place = gather(comm, joined((place for place, _ in own), np.int64))
    stiffness = gather(comm, joined((stiffness for _, stiffness in own), float))
    low, high = np.full(len(gids), np.inf), np.zeros(len(gids))
    np.minimum.at(low, place, stiffness)
    np.maximum.at(high, place, stiffness)
    jumps = (high >= JUMP * low)[np.searchsorted(gids, boundary.term_gid)]
    found[boundary.term_node[jumps & (boundary.term_value != 0)]] = True
    return found


def _stiffness(sub, gids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places among the sorted `gids`, and traces of Hooke's law, of triangles beside such nodes."""
    vertex = sub.node_gid[sub.elements[:, :3]]
    triangle, corner = np.nonzero(np.isin(vertex, gids))
    trace = np.einsum("tii->t", sub.elasticity)
    return np.searchsorted(gids, vertex[triangle, corner]), trace[triangle]
