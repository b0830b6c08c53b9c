"""Which part of a contact node belongs to which label.

Where labels go on in one another, their common vertex is one contact node, which reports one label
but carries the dual segments of both: its forces are divided as the lengths of its segment are, so
that those of a label do not depend on where others end.
"""

import numpy as np

from ..feti.structure import Substructure


def label_shares(structure: Substructure) -> tuple[np.ndarray, np.ndarray]:
    """Labels (l,) of the contact boundary, and their shares (l, n_c) in each node, which sum to
    one.
    """
    b, outer = structure.contact.declared, structure.outer_edges
    ends = np.concatenate([b.edges, _between_bodies(b, outer)])
    gid, place = np.concatenate([b.gid, b.clamped.gid]), np.concatenate([b.xy, b.clamped.xy])
    span = max(outer[:, :2].max(initial=0), gid.max(initial=0)) + 1
    keys = np.sort(outer[:, :2], axis=1) @ [span, 1]
    order = np.argsort(keys, kind="stable")
    found = np.searchsorted(keys[order], np.sort(gid[ends], axis=1) @ [span, 1])
    label = outer[order[found], 2]
    labels = np.unique(np.concatenate([b.label, label])).astype(int)
    plain = (labels[:, None] == b.label).astype(float)
    if len(labels) < 2:
        return labels, plain
    length, total = np.linalg.norm(np.subtract(*place[ends.T]), axis=1), np.zeros((len(labels),
                                                                                   len(gid)))
    for end, other in (ends.T, ends.T[::-1]):
        part = length
        if b.axisymmetric:  # as their rings are: of linear or quadratic functions
            near, far = place[end, 0], place[other, 0]
            part = length * (near if len(structure.outer_middles) else 2 * near + far)
        np.add.at(total, (np.searchsorted(labels, label), end), part)
    total = total[:, : len(b.gid)]
    whole = total.sum(axis=0)
    return labels, np.where(whole > 0, total / np.maximum(whole, 1e-300), plain)


def _between_bodies(b, outer: np.ndarray) -> np.ndarray:
    """(e, 2) nodes of the edges on first labels of pairs, of the `outer` ones (gids, label).

    A corner, whose two nodes are those of one label each, has none.
    """
    firsts = [first for pairs in b.meeting for first, _ in pairs]
    gid, node, count = np.unique(b.gid[b.paired], return_index=True, return_counts=True)
    gid, node = gid[count == 1], np.flatnonzero(b.paired)[node[count == 1]]
    edges = outer[np.isin(outer[:, 2], firsts), :2]
    edges = edges[np.isin(edges, gid).all(axis=1)]
    return node[np.searchsorted(gid, edges)].reshape(-1, 2).astype(int)
