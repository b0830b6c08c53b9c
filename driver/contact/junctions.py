"""Junctions: places where bodies meet one another and others, as two blocks abreast on a floor.

Each of the contact nodes there has its conditions, and together they depend on one another: what
the blocks press one another by, the floor may take as friction under both. Displacements leave
forces N y open, N the null space of the transposed rows; march/junction_forces.py chooses them.

They are ends of contact boundaries that lie together, nearer than the nodes beside them, or with a
gap in between, and the rows of joints that act on the same vertices. A node on a rough surface has
the pressure that its law gives: its normal row takes no part.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from .beside import neighbours
from .corner_pairs import null_space, rows_of

NEAR = 0.3  # of the way to the node beside, within which ends of boundaries lie together


@dataclass
class Junction:
    """Nodes (k,) of contact and joints, their rows and forces (rows, m) that displace nothing.

    `rows`: 2 i for the normal, 2 i + 1 for the tangential row of the i-th node.
    """

    nodes: np.ndarray
    rows: np.ndarray
    free: np.ndarray


def junctions(contact, fixed_keys: np.ndarray, yields: np.ndarray) -> list[Junction]:
    """Those of a ContactBoundary; empty where bodies meet nothing but obstacles.

    `fixed_keys` are 2 gid + component of the displacements that supports fix; `yields` (n_c,): the
    node's surface gives way under pressure. Nodes whose rows depend on those of the same vertex are
    corners (corner_pairs.py), and take no part.
    """
    able = (contact.normal_row >= 0) & ~contact.idle
    if not contact.paired[able].any():
        return []
    ends = _ends(contact, np.flatnonzero(able & ~contact.is_joint))
    ends = np.setdiff1d(ends, contact.corners[:, :2])
    joined, found = np.flatnonzero(able & contact.is_joint), []
    for nodes in _together(contact, ends):
        nodes = np.concatenate([nodes, _on_same_vertices(contact, nodes, joined)])
        rows, of = [], []
        for i, node in enumerate(nodes if len(nodes) > 2 else ()):
            for kind, row in enumerate(rows_of(contact, node, fixed_keys)):
                if row and not (kind == 0 and yields[node]):
                    rows.append(row)
                    of.append(2 * i + kind)
        free = null_space(rows) if rows else np.zeros((0, 0))
        if free.shape[1]:
            size = np.array([np.linalg.norm(list(row.values())) for row in rows])
            found.append(Junction(nodes, np.array(of), free / size[:, None]))
    return found


def _ends(contact, nodes: np.ndarray) -> np.ndarray:
    """Those of the `nodes` at which boundaries end or turn a corner."""
    along = np.column_stack([contact.chain, contact.family])[nodes]
    new = (along[1:] != along[:-1]).any(axis=1)
    _, vertex, count = np.unique(contact.gid[nodes], return_inverse=True, return_counts=True)
    return nodes[np.append(True, new) | np.append(new, True) | (count[vertex] > 1)]


def _together(contact, nodes: np.ndarray) -> list[np.ndarray]:
    """The `nodes` in groups that lie together."""
    near = neighbours(contact, nodes)
    reach = NEAR * np.where(near >= 0, np.linalg.norm(contact.xy[near] - contact.xy[nodes],
                                                      axis=1), 0.0)
    away = np.linalg.norm(contact.xy[nodes][:, None] - contact.xy[nodes], axis=2)
    count, group = connected_components(away <= np.minimum(reach[:, None], reach))
    return [nodes[group == k] for k in range(count)]


def _on_same_vertices(contact, nodes: np.ndarray, joined: np.ndarray) -> np.ndarray:
    """The rows of joints among `joined` that act on vertices on which contact `nodes` do."""
    acts = contact.term_value != 0
    gids = contact.term_gid[acts & np.isin(contact.term_node, nodes)]
    on = acts & np.isin(contact.term_gid, gids)
    return np.intersect1d(contact.term_node[on], joined)
