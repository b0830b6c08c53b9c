"""Junctions: places where bodies meet one another and others, as two blocks abreast on a floor.

Each of the contact nodes there has its conditions, and together they depend on one another: what
the blocks press one another by, the floor may take as friction under both. Displacements leave
forces N y open, N the null space of the transposed rows; march/junction_forces.py chooses them.
"""

from dataclasses import dataclass

import numpy as np

from .corner_pairs import rows_of

SAME = 1e-9  # part of the boundary's extent within which places are one
DEPENDENT = 1e-8  # singular value, of the largest, below which rows depend on one another


@dataclass
class Junction:
    """Contact nodes (k,) at one place, their rows and forces (rows, m) that displace nothing.

    `rows`: 2 i for the normal, 2 i + 1 for the tangential row of the i-th node.
    """

    nodes: np.ndarray
    rows: np.ndarray
    free: np.ndarray


def junctions(contact, fixed_keys: np.ndarray) -> list[Junction]:
    """Those of a ContactBoundary; empty where bodies meet nothing but obstacles.

    `fixed_keys` are 2 gid + component of the displacements that supports fix. Vertices whose own
    rows depend on one another are corners (corner_pairs.py), and no junctions.
    """
    contact, known = contact.declared, set(contact.corners[:, :2].ravel().tolist())
    able = np.flatnonzero(contact.normal_row >= 0)
    if not contact.paired[able].any():
        return []
    size = np.ptp(contact.xy[able], axis=0).max() or 1.0
    _, place, count = np.unique(np.round(contact.xy[able] / (SAME * size)), axis=0,
                                return_inverse=True, return_counts=True)
    found = []
    for group in np.flatnonzero(count > 2):
        nodes = able[place.ravel() == group]
        if known & set(nodes.tolist()):
            continue
        matrix, rows = _matrix(contact, nodes, fixed_keys)
        left, values, _ = np.linalg.svd(matrix)
        values = np.append(values, np.zeros(len(matrix) - len(values)))
        if (values <= DEPENDENT * values.max()).any():
            found.append(Junction(nodes, rows, left[:, values <= DEPENDENT * values.max()]))
    return found


def _matrix(contact, nodes: np.ndarray, fixed_keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(rows, displacements) of the nodes' rows, and which these are."""
    rows, of = [], []
    for i, node in enumerate(nodes):
        for kind, row in enumerate(rows_of(contact, node, fixed_keys)):
            rows.append(row)
            of.append(2 * i + kind)
    keys = {key: place for place, key in enumerate(sorted(set().union(*rows)))}
    matrix = np.zeros((len(rows), len(keys)))
    for number, row in enumerate(rows):
        matrix[number, [keys[key] for key in row]] = list(row.values())
    return matrix, np.array(of)
