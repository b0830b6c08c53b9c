"""Which contact nodes at one vertex have rows that depend on one another."""

import numpy as np

from ..errors import InputError

NEAR = 0.1  # the same between bodies: the split of forces would be lost in rounding
DEPENDENT = 1e-8  # singular value below which rows of length one depend on one another
OPPOSITE = 1e-4  # sine of the angle below which two normals count as opposite


def corner_pairs(contact, fixed_keys: np.ndarray, yields: np.ndarray) -> np.ndarray:
    """(v, 4) pairs of contact nodes with dependent rows, and how many conditions act at a time.

    Two where the vertex can move freely. One where a support leaves it a single displacement, and
    where a body lies between two obstacles that face one another: of those it may meet either.
    Last, whether rows depend exactly: between bodies with a gap they nearly do, as both flanks meet
    places near the other body's corner.
    `fixed_keys` are 2 gid + component of the displacements that supports fix; `yields` (n_c,):
    the node's surface gives way under pressure. Where both do so at a free vertex the pressures
    follow from where it is, and no rows depend. Raises InputError where more than two nodes depend
    on one another.
    """
    contact = contact.declared  # nodes of joints have no other rows
    gids, count = np.unique(contact.gid[contact.normal_row >= 0], return_counts=True)
    pairs = []
    for gid in gids[count > 1]:
        nodes = np.flatnonzero((contact.gid == gid) & (contact.normal_row >= 0))
        rows = [rows_of(contact, node, fixed_keys) for node in nodes]
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
        for k, i, rank in dependent:
            acting = 1 if _opposite(contact.normal[nodes[[k, i]]]) else rank
            if not (acting == 2 and yields[nodes[[k, i]]].all()):
                pairs.append((nodes[k], nodes[i], acting,
                              _rank([rows[i], rows[k]], DEPENDENT) == rank))
    known = {k for pair in pairs for k in pair[:2]} | set(np.flatnonzero(yields).tolist())
    pairs += _of_rings(contact, fixed_keys, known)
    return np.array(pairs, int).reshape(-1, 4)


def _of_rings(contact, fixed_keys: np.ndarray, known: set[int]) -> list[tuple]:
    """Pairs as `corner_pairs` returns them, beside the nodes `known`, by rows of several vertices.

    Around a hole that is nothing but corners, each flank of a vertex meets the other body in its
    own place. What the two conditions of its vertices differ by adds up to nothing around the hole,
    and forces may run round in it. One vertex on the way, the first by its place, has the states of
    a corner: without the friction of both its sides the rows are independent.
    """
    gids, count = np.unique(contact.gid[contact.normal_row >= 0], return_counts=True)
    order = np.lexsort(contact.xy.T[::-1])
    of = {gid: np.sort(order[contact.gid[order] == gid]) for gid in gids[count == 2]}
    of = {gid: nodes for gid, nodes in of.items()
          if contact.paired[nodes].all() and not known & set(nodes.tolist())}
    rows = {gid: [rows_of(contact, node, fixed_keys) for node in nodes]
            for gid, nodes in of.items()}
    pairs, place = [], {gid: k for k, gid in enumerate(contact.gid[order])}
    for ring in _connected(rows):
        ring = sorted(ring, key=place.get)
        while True:
            bound = [ring[k] for k in _bound([rows[gid] for gid in ring])]
            first = next((gid for gid in bound if len(rows[gid][0]) > 1), None)
            if first is None:
                break
            rows[first] = [row[:1] for row in rows[first]]
            opposite = _opposite(contact.normal[of[first]])
            pairs.append((*of[first], 1 if opposite else 2, False))
    return pairs


def _connected(rows: dict) -> list[list[int]]:
    """Vertices in groups whose `rows`, by vertex, act on common displacements."""
    groups = []
    for gid, of_nodes in rows.items():
        keys, own = {key for of_node in of_nodes for row in of_node for key in row}, [gid]
        apart = []
        for others, touched in groups:
            if touched & keys:
                own, keys = others + own, touched | keys
            else:
                apart.append((others, touched))
        groups = [*apart, (own, keys)]
    return [own for own, _ in groups]


def _opposite(normals: np.ndarray) -> bool:
    """Whether two normals (2, 2) are along one line."""
    return bool(abs(np.linalg.det(normals)) < OPPOSITE)


def rows_of(contact, node: int, fixed_keys: np.ndarray) -> list[dict[int, float]]:
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


def _bound(of_vertices: list) -> list[int]:
    """Which vertices have a part in forces that displace nothing; none if rows are independent."""
    rows = [(vertex, row) for vertex, of_nodes in enumerate(of_vertices)
            for of_node in of_nodes for row in of_node]
    part = np.abs(null_space([row for _, row in rows])).max(axis=1, initial=0.0)
    return sorted({vertex for (vertex, _), share in zip(rows, part) if share > DEPENDENT})


def null_space(rows: list[dict[int, float]]) -> np.ndarray:
    """(rows, m) forces of rows, made of length one, that displace nothing; orthonormal."""
    left, size, _ = np.linalg.svd(_matrix(rows))
    size = np.append(size, np.zeros(max(0, len(rows) - len(size))))
    return left[:, size <= DEPENDENT]


def _rank(of_nodes: list[list[dict[int, float]]], least: float) -> int:
    """Number of independent rows: singular values of rows of length one beyond `least`."""
    rows = [row for rows in of_nodes for row in rows]
    return int(np.count_nonzero(np.linalg.svd(_matrix(rows), compute_uv=False) > least))


def _matrix(rows: list[dict[int, float]]) -> np.ndarray:
    """(rows, displacements) of length one each, by coefficients."""
    keys = {key: place for place, key in enumerate(sorted(set().union(*rows)))}
    matrix = np.zeros((len(rows), len(keys)))
    for number, row in enumerate(rows):
        for key, value in row.items():
            matrix[number, keys[key]] = value
    size = np.linalg.norm(matrix, axis=1)
    return matrix / np.where(size > 0, size, 1.0)[:, None]
