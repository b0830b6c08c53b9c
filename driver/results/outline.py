"""Stage 7: boundary.csv, the edges of the outline, their part in the scene, unit tractions."""

from pathlib import Path

import numpy as np

from ..errors import agreed_writes
from ..feti.gathering import joined
from ..feti.structure import Substructure
from ..feti.supports import constrained_keys
from ..files import write_rows
from ..scene import sides
from ..scene.manifest import Manifest
from .tables import BOUNDARY, header


def write_outline(path: Path, manifest: Manifest, structure: Substructure, comm) -> None:
    """Write the table to `path` on rank 0; collective. Raises InputError if that fails."""
    subs = structure.subdomains
    traction = [k for k, pattern in enumerate(manifest.patterns) if pattern["given_on"] == "edges"]
    outline = np.zeros(manifest.nodes, bool)
    outline[structure.outer_edges[:, :2]] = outline[structure.outer_middles] = True
    gid, xy, force, around = [], [], [], []
    for sub in subs:
        near = outline[sub.node_gid]
        gid.append(sub.node_gid[near])
        xy.append(sub.xy[near])
        force.append(sub.loads[traction].sum(axis=0).reshape(-1, 2)[near])
        edges = sub.node_gid[sub.triangles[:, [0, 1, 1, 2, 2, 0]]].reshape(-1, 2)
        around.append(edges[outline[edges].all(axis=1)])  # counterclockwise
    parts = comm.gather((joined(gid, np.int64), joined(xy, float, 2), joined(force, float, 2),
                         constrained_keys(structure), _moves(structure),
                         joined(around, np.int64, 2) @ [manifest.nodes, 1]))
    with agreed_writes(comm):
        if comm.rank == 0:
            write_rows(path, header(BOUNDARY), _rows(manifest, structure, parts))


def _rows(manifest: Manifest, structure: Substructure, parts: list[tuple]) -> list[list]:
    """Rows of the table from `parts` of every rank, see `_part`."""
    place, push, fixed, moved = np.zeros((4, manifest.nodes, 2))
    for gid, xy, force, keys, moves, _ in parts:
        place[gid] = xy
        fixed.ravel()[keys], moved.ravel()[keys] = 1, moves
        np.add.at(push, gid, force)
    edges = structure.outer_edges.copy()
    sides = np.concatenate([part[-1] for part in parts])
    turned = ~np.isin(edges[:, :2] @ [manifest.nodes, 1], sides)
    edges[turned, :2] = edges[turned, 1::-1]
    traction = _edge_tractions(edges, structure.outer_middles, place, push, manifest.axisymmetric)
    paired = {label for pair in manifest.contact_pairs for label in pair}
    start, end, label = edges.T
    whole = {name: fixed[edges[label == name, :2]].min(axis=(0, 1))
             for name in np.unique(label).tolist()}  # a support holds a label, not its neighbours
    sprung = manifest.rooms.get("springs", {}).get("labels", [])
    joined_labels = {label for kind in ("tie", "periodic")
                     for pair in manifest.rooms.get(kind, {}).get("labels", []) for label in pair}
    motion = (moved[start] + moved[end]) / 2
    rows = []
    for points, edge, move, pull in zip(_points(place, edges, structure.outer_middles),
                                        label.tolist(), motion, traction.tolist()):
        held = whole[edge]
        if edge in paired:
            role = "pair"
        elif edge in manifest.contact_labels:
            role = "contact"
        elif held.any():
            role = "support"
        elif edge in sprung:
            role = "springs"
        elif edge in joined_labels:
            role = "joined"
        else:
            role = "load" if any(pull) else "free"
        rows += [[*p, *q, edge, role, *pull, *held.astype(int).tolist(),
                  *(held * move).tolist()] for p, q in zip(points, points[1:])]
    return rows


def _points(place: np.ndarray, edges: np.ndarray, middles: np.ndarray) -> list[list]:
    """Ends of every edge, between those of a curved one its middle."""
    ends = place[edges[:, :2]].tolist()
    if not len(middles) or not sides.are_curved(place[np.column_stack([edges[:, :2], middles])]):
        return ends
    return [[p, m, q] for (p, q), m in zip(ends, place[middles].tolist())]


def _moves(structure: Substructure) -> np.ndarray:
    """(n,) prescribed displacements at amplitude 1, in the order of `constrained_keys`."""
    travel = structure.travel.displacements(np.ones(structure.patterns), structure.subdomains)
    return joined((values.sum(axis=0) + whole[fixed] for values, whole, fixed in zip(
        structure.fixed_values, travel, structure.fixed)), float)


def _edge_tractions(edges: np.ndarray, middles: np.ndarray, place: np.ndarray,
                    push: np.ndarray, revolved: bool) -> np.ndarray:
    """(n, 2) tractions of the outer edges, means of their label from nodal forces inside it.

    `edges` (n, 3) have two ends and a label, `push` (nodes, 2) are the forces. A node's part of an
    edge is the integral of its shape function, of bodies of revolution (`revolved`) times 2 pi r.
    Of a curved label it is the mean of pressure and shear, where these vary less.
    """
    along = place[edges[:, 1]] - place[edges[:, 0]]
    size = np.linalg.norm(along, axis=1)
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    nodes = np.column_stack([edges[:, :2], middles]) if len(middles) else edges[:, :2]
    parts = _shape_integrals(place[edges[:, :2], 0] if revolved else None, len(middles) > 0)
    lengths, normals = size[:, None] * parts, [c[:, None] * parts for c in outward.T]
    if len(middles) and sides.are_curved(place[nodes]):
        lengths = sides.integrals(place[nodes], revolved)
        normals = np.moveaxis(sides.normals(place[nodes]), 2, 0)
    length = np.bincount(nodes.ravel(), lengths.ravel(), len(place))
    normal = np.column_stack([np.bincount(nodes.ravel(), of.ravel(), len(place))
                              for of in normals])
    first = np.full(len(place), np.iinfo(np.int64).max)
    last = np.full(len(place), np.iinfo(np.int64).min)
    np.minimum.at(first, nodes, edges[:, 2:])
    np.maximum.at(last, nodes, edges[:, 2:])
    inside = np.flatnonzero((first == last) & (length > 0))  # a quadratic one on the axis has none
    traction = np.zeros((len(edges), 2))
    for label in np.unique(first[inside]):
        own, here = inside[first[inside] == label], edges[:, 2] == label
        frame = outward[here] / size[here, None]
        traction[here] = _mean_traction(push[own], length[own], normal[own], frame)
    largest = np.abs(traction).max(initial=0)
    return np.where(np.abs(traction) > 1e-9 * largest, traction, 0.0)


def _shape_integrals(radii: np.ndarray | None, quadratic: bool) -> np.ndarray:
    """Integrals of an edge's shape functions over its length, ends first, then the middle: (2,) or
    (3,), or of (n, 2) radii at its ends (n, 2), (n, 3) with the weight 2 pi r.
    """
    if radii is None:
        return np.array([1, 1, 4]) / 6 if quadratic else np.array([0.5, 0.5])
    moments = [[1, 0, 2], [0, 1, 2]] if quadratic else [[2, 1], [1, 2]]
    return 2 * np.pi * radii @ (np.array(moments) / 6)


def _mean_traction(push: np.ndarray, length: np.ndarray, normal: np.ndarray,
                   outward: np.ndarray) -> np.ndarray:
    """(k, 2) tractions on edges with normals `outward` (k, 2), from nodes' forces (j, 2) with the
    lengths (j,) of their parts and normals (j, 2) of any length.
    """
    mean = push.sum(axis=0) / length.sum()
    unit = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    turned = np.column_stack([-unit[:, 1], unit[:, 0]])
    local = np.column_stack([(push * unit).sum(axis=1), (push * turned).sum(axis=1)])
    follows = local.sum(axis=0) / length.sum()
    spread = [((of / length[:, None] - m) ** 2).sum(axis=1) @ length
              for of, m in ((push, mean), (local, follows))]
    if spread[1] < 0.5 * spread[0] and spread[0] > 1e-12 * (push**2).sum() / length.sum():
        return (follows[0] * outward
                + follows[1] * np.column_stack([-outward[:, 1], outward[:, 0]]))
    return np.tile(mean, (len(outward), 1))
