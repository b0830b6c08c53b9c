"""Which contact nodes at one vertex have rows that depend on one another."""

import numpy as np

from ..errors import InputError

NEAR = 0.1  # the same between bodies: the split of forces would be lost in rounding
DEPENDENT = 1e-8  # singular value below which rows of length one depend on one another
OPPOSITE = 1e-4  # sine of the angle below which two normals count as opposite


def corner_pairs(contact, fixed_keys: np.ndarray) -> np.ndarray:
    """(v, 4) pairs of contact nodes with dependent rows, and how many conditions act at a time.

    Two where the vertex can move freely. One where a support leaves it a single displacement, and
    where a body lies between two obstacles that face one another: of those it may meet either.
    Last, whether rows depend exactly: between bodies with a gap they nearly do, as both flanks meet
    places near the other body's corner.
    `fixed_keys` are 2 gid + component of the displacements that supports fix. Raises InputError
    where more than two nodes depend on one another.
    """
    contact = contact.declared  # nodes of joints have no other rows
    gids, count = np.unique(contact.gid[contact.normal_row >= 0], return_counts=True)
    pairs = []
    for gid in gids[count > 1]:
        nodes = np.flatnonzero((contact.gid == gid) & (contact.normal_row >= 0))
        rows = [_rows(contact, node, fixed_keys) for node in nodes]
        near = NEAR if contact.paired[nodes].any() else DEPENDENT
        if _rank(rows, near) == sum(map(len, rows)):
            continue
        couples = [(i, k, _rank([rows[i], rows[k]], near))
                   for i in range(len(nodes)) for k in range(i)]
        dependent = [(k, i, rank) for i, k, rank in couples
                     if rank < len(rows[i]) + len(rows[k])]
        if len(nodes) > 2 and len(dependent) != 1:
            x, y = contact.xy[nodes[0]]
            raise InputError(f"contact at ({x:g}, {y:g}): more than two conditions meet there on "
                             "what can move; declare contact on less of the boundary")
        pairs += [(nodes[k], nodes[i], 1 if _opposite(contact.normal[nodes[[k, i]]]) else rank,
                   _rank([rows[i], rows[k]], DEPENDENT) == rank) for k, i, rank in dependent]
    return np.array(pairs, int).reshape(-1, 4)


def _opposite(normals: np.ndarray) -> bool:
    """Whether two normals (2, 2) are along one line."""
    return bool(abs(np.linalg.det(normals)) < OPPOSITE)


def _rows(contact, node: int, fixed_keys: np.ndarray) -> list[dict[int, float]]:
    """The rows of a node: coefficients by displacement, fixed ones left out."""
    terms = np.flatnonzero(contact.term_node == node)
    directions = [contact.normal[node]]
    if contact.tangential_row[node] >= 0:
        directions.append(contact.tangent[node])
    rows = []
    for direction in directions:
        row = {}
        for gid, value in zip(contact.term_gid[terms], contact.term_value[terms]):
            for c in (0, 1):
                row[2 * gid + c] = row.get(2 * gid + c, 0.0) + value * direction[c]
        rows.append({key: value for key, value in row.items() if key not in fixed_keys})
    return rows


def _rank(of_nodes: list[list[dict[int, float]]], least: float) -> int:
    """Number of independent rows: singular values of rows of length one beyond `least`."""
    rows = [row for rows in of_nodes for row in rows]
    keys = {key: place for place, key in enumerate(sorted(set().union(*rows)))}
    matrix = np.zeros((len(rows), len(keys)))
    for number, row in enumerate(rows):
        for key, value in row.items():
            matrix[number, keys[key]] = value
    size = np.linalg.norm(matrix, axis=1)
    matrix /= np.where(size > 0, size, 1.0)[:, None]
    return int(np.count_nonzero(np.linalg.svd(matrix, compute_uv=False) > least))
