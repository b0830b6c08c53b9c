"""Ends of contact boundaries at which the outline goes on: a label ends there, but no side.

Force that is at such an end on coarse meshes is at no corner. It moves with the nodes, along the
label or to what lies beyond it.
"""

import numpy as np

from ..contact.nodes import TURN
from ..feti.nodal import NodalFields
from .contact_edges import chains, is_ring


def smooth_ends(structure, nodes: dict, comm) -> np.ndarray:
    """(n_c,) whether a contact node ends its boundary and the outline does not turn by a corner's
    angle there; `nodes` as of quantities.py. Collective.
    """
    found = np.zeros(len(structure.contact.declared.gid), bool)
    ends = [node for piece in chains(nodes) if len(piece) and not is_ring(nodes, piece)
            for node in piece[[0, -1]]]
    gids, pairs = structure.contact.declared.gid[ends], structure.outer_edges[:, :2].astype(int)
    pairs = pairs[np.isin(pairs, gids).any(axis=1)]
    if not len(pairs):
        return found
    places = np.unique(pairs)
    xy = NodalFields(structure, places, comm)([sub.xy.ravel() for sub in structure.subdomains])
    for node, gid in zip(ends, gids):
        own = pairs[(pairs == gid).any(axis=1)]
        if len(own) != 2:  # two parts of a body meet there
            continue
        away = xy[np.searchsorted(places, own.sum(axis=1) - gid)] - xy[np.searchsorted(places, gid)]
        one, two = away / np.linalg.norm(away, axis=1)[:, None]
        found[node] = one @ two <= -TURN
    return found
