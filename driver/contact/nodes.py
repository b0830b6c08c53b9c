"""Contact nodes from the parts of their dual segments: one for every direction, not every label.

FreeFEM gives each subdomain's part of a dual segment by label, on either side of a sharp corner
one. Where the boundary goes on smoothly, or is a polygon for a smooth curve, all parts of a vertex
make one node: its weight is their sum, its normal and its columns are their means, as within a
label. What comes out does not know where a label, or a subdomain, ends. Where the contact normals
turn by more than `TURN` they are conditions of their own, on displacements in two directions.

`TURN` is 34 degrees: the polygon of a circle, whose vertices turn by 360/n, is smooth from eleven
sides on; angles that are drawn on purpose (36, 40, 45, 60, 90 degrees, the corners of regular
polygons up to ten sides) are corners, and none of them, nor 30, is so near that rounding decides.
At a corner of 34 degrees a node with the mean normal errs by a twentieth, 1 - cos(17 degrees), in
how far either side may move, which halves with every other halving of a smooth curve's sides.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..scene.loader import ContactData
from ..vectors import unit

TURN = np.cos(np.deg2rad(34.0))  # least cosine between the normals of one node
ALIKE = 1e-6  # relative difference of lengths that rounding may leave


@dataclass
class Nodes:
    """Contact nodes of the whole body, in no particular order; arrays of length n.

    `label` is that of the longest part of the dual segment, of equal ones the smallest;
    `family` (n,) is 0 on rigid obstacles, between bodies the number of those `meeting`, from 1 on:
    the pairs of labels that are one boundary. `length` is the part of the boundary, which `weight`
    is as well on straight sides. `members` are the nodes at a vertex on a label, by
    (label, gid).
    """

    gid: np.ndarray
    label: np.ndarray
    family: np.ndarray
    xy: np.ndarray
    weight: np.ndarray
    length: np.ndarray
    normal: np.ndarray
    columns: dict[str, np.ndarray]
    meeting: list[list[tuple[int, int]]]
    members: dict[tuple[int, int], list[int]]


def contact_table(c: ContactData, columns: list[str], gid: np.ndarray,
                  xy: np.ndarray) -> np.ndarray:
    """(n, 7 + columns) parts of dual segments: of one subdomain, or all of them.

    label, gid, weight; normal and columns times weight; place.
    """
    part = np.column_stack([c.normal, *(c.columns[name] for name in columns)]) * c.weight[:, None]
    return np.column_stack([c.label, gid, c.weight, part, xy])


def _meeting(label, gid, normal, pairs: list) -> list[list[tuple[int, int]]]:
    """The `pairs`, those together whose first labels go on in one another at a vertex.

    There the conditions of either would nearly repeat, between meshes that match exactly.
    """
    root = list(range(len(pairs)))
    for k, (one, _) in enumerate(pairs):
        for i, (other, _) in enumerate(pairs[:k]):
            here, there = np.flatnonzero(label == one), np.flatnonzero(label == other)
            _, a, b = np.intersect1d(gid[here], gid[there], return_indices=True)
            if ((normal[here[a]] * normal[there[b]]).sum(axis=1) >= TURN).any():
                root = [root[i] if r == root[k] else r for r in root]
    return [[tuple(pair) for pair, r in zip(pairs, root) if r == one]
            for one in dict.fromkeys(root)]


def merge_parts(table: np.ndarray, columns: list[str], pairs: list,
                one_a_vertex: bool = False, curved: bool = False,
                normals: Callable = None) -> Nodes:
    """The nodes of a `contact_table`; `columns` are the names of its columns, `pairs` the labels.

    `one_a_vertex`: whatever their directions, all parts at a vertex are one node. In scenes with
    `curved` sides weights count along the node's normal: normal times weight is the force of a
    uniform pressure there, of bodies of revolution that on the ring. `normals` gives those of
    obstacles for nodes with their columns and own normals, see obstacle_normals of Effect; parts
    whose normals they make alike are one node. Raises InputError where a vertex has more than two
    directions.
    """
    label, gid = table[:, :2].T.astype(np.int64)
    normal = unit(table[:, 3:5])
    meeting, family = _meeting(label, gid, normal, pairs), np.zeros(len(table), np.int64)
    for k, together in enumerate(meeting):
        family[np.isin(label, [first for first, _ in together])] = k + 1
    turn = -np.inf if one_a_vertex else TURN
    node = _node_of_parts(label, gid, family, normal, table[:, -2:], turn)
    total = _sums(table, node)
    if normals is not None:
        given = normals({name: total[:, 3 + k] / total[:, 0] for k, name in enumerate(columns)},
                        unit(total[:, 1:3]))
        table = table.copy()
        table[:, 3:5] = np.where(np.isnan(given[node]), table[:, 3:5],
                                 given[node] * table[:, 2:3])
        node = _node_of_parts(label, gid, family, unit(table[:, 3:5]), table[:, -2:], turn)
        total = _sums(table, node)
    count = len(total)
    _, first = np.unique(node, return_index=True)
    weight = total[:, 0].copy()
    keys, share = np.unique(np.column_stack([node, label]), axis=0, return_inverse=True)
    share = np.bincount(share, table[:, 2], len(keys))
    of_node, of_label = keys.T
    longest = np.zeros(count)
    np.maximum.at(longest, of_node, share)
    able = share >= (1 - ALIKE) * longest[of_node]
    reported = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(reported, of_node[able], of_label[able])
    members = {}
    for of, one in keys.tolist():
        members.setdefault((one, int(gid[first[of]])), []).append(of)
    length = weight
    if curved:
        weight = np.linalg.norm(total[:, 1:3], axis=1)
    return Nodes(gid[first], reported, family[first], table[first, -2:], weight, length,
                 unit(total[:, 1:3]),
                 {name: total[:, 3 + k] / length for k, name in enumerate(columns)}, meeting,
                 members)


def _sums(table: np.ndarray, node: np.ndarray) -> np.ndarray:
    """(nodes, 3 + columns) weight, normal and columns times weight: sums over a node's parts."""
    total = np.zeros((int(node.max(initial=-1)) + 1, table.shape[1] - 4))
    np.add.at(total, node, table[:, 2:-2])
    return total


def _node_of_parts(label, gid, family, normal, xy, turn: float) -> np.ndarray:
    """(parts,) numbers of the nodes that parts belong to; `turn`: cosine of one node's normals."""
    _, first, vertex = np.unique(np.column_stack([family, gid]), axis=0, return_index=True,
                                 return_inverse=True)
    apart = (normal * normal[first[vertex]]).sum(axis=1) < turn
    node = 2 * vertex
    for kinked in np.unique(vertex[apart]):
        parts = np.flatnonzero(vertex == kinked)
        # in an order that does not depend on the cut
        parts = parts[np.lexsort((np.arctan2(*normal[parts].T), label[parts]))]
        other = (normal[parts] * normal[parts[0]]).sum(axis=1) < TURN
        beside = normal[parts[other]]
        if (beside @ beside[0] < TURN).any():
            x, y = xy[parts[0]]
            raise InputError(f"contact at ({x:g}, {y:g}): more than two directions meet there, on "
                             "two displacements; declare contact on less of the boundary")
        node[parts[other]] += 1
    return np.unique(node, return_inverse=True)[1]
