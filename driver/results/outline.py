"""boundary.csv, the edges of the outline, their part in the scene, unit tractions."""

from pathlib import Path

import numpy as np

from ..errors import agreed_writes
from ..feti.gathering import joined, lookup
from ..feti.structure import Substructure
from ..feti.supports import constrained_keys
from ..files import write_rows
from ..scene import sides
from ..scene.manifest import Manifest
from .tables import BOUNDARY, header


def write_outline(path: Path, manifest: Manifest, structure: Substructure, comm) -> None:
    """Write the table to `path` on rank 0; collective. Raises InputError if that fails."""
    subs = structure.subdomains
    outline = np.zeros(manifest.nodes, bool)
    outline[structure.outer_edges[:, :2]] = outline[structure.outer_middles] = True
    gid, xy, around, pushed, push, sprung = [], [], [], [], [], []
    for sub in subs:
        near = outline[sub.node_gid]
        if not near.any():  # as of most of many
            continue
        gid.append(sub.node_gid[near])
        xy.append(sub.xy[near])
        edges = sub.node_gid[sub.triangles[:, [0, 1, 1, 2, 2, 0]]].reshape(-1, 2)
        around.append(edges[outline[edges].all(axis=1)])  # counterclockwise
        if sub.springs is not None:
            sprung.append(sub.node_gid[near & sub.springs.any(axis=1)])
        where, force = _pushes(sub, manifest)
        pushed.append(where)
        push.append(force)
    parts = comm.gather((joined(gid, np.int64), joined(xy, float, 2), constrained_keys(structure),
                         _moves(structure), joined(around, np.int64, 2) @ [manifest.nodes, 1],
                         joined(pushed, np.int64), joined(push, float, 2),
                         joined(sprung, np.int64)))
    with agreed_writes(comm):
        if comm.rank == 0:
            write_rows(path, header(BOUNDARY), _rows(manifest, structure, parts))


def _pushes(sub, manifest: Manifest) -> tuple[np.ndarray, np.ndarray]:
    """Where a Subdomain's edges are loaded, and how much (n, 2), at amplitude 1.

    Of linear elements forces on edges, by their ends as one number; of quadratic ones those of all
    nodes, of which the middle of an edge is no other edge's.
    """
    if sub.elements.shape[1] == 3:
        total = sum((moments.sum(axis=1) for moments in sub.edge_loads.values()),
                    np.zeros((len(sub.edges), 2)))
        where = np.sort(sub.node_gid[sub.edges], axis=1) @ [manifest.nodes, 1]
    else:
        on_edges = [k for k, of in enumerate(manifest.patterns) if of["given_on"] == "edges"]
        total = sub.loads[on_edges].sum(axis=0).reshape(-1, 2)
        where = sub.node_gid
    loaded = total.any(axis=1)
    return where[loaded], total[loaded]


def _rows(manifest: Manifest, structure: Substructure, parts: list[tuple]) -> list[list]:
    """Rows of the table from the `parts` that every rank has gathered."""
    place, fixed, moved = np.zeros((3, manifest.nodes, 2))
    on_springs = np.zeros(manifest.nodes, bool)
    for gid, xy, keys, moves, *_, sprung in parts:
        place[gid] = xy
        on_springs[sprung] = True
        fixed.ravel()[keys], moved.ravel()[keys] = 1, moves
    edges = structure.outer_edges.copy()
    around, pushed, push = (np.concatenate([part[k] for part in parts]) for k in (4, 5, 6))
    turned = ~np.isin(edges[:, :2] @ [manifest.nodes, 1], around)
    edges[turned, :2] = edges[turned, 1::-1]
    where = structure.outer_middles
    if not len(where):
        where = np.sort(edges[:, :2], axis=1) @ [manifest.nodes, 1]
    force = _sums(pushed, push, where)
    size = _measures(place, edges[:, :2], structure.outer_middles, manifest.axisymmetric)
    traction = np.divide(force, size[:, None], out=np.zeros_like(force), where=size[:, None] > 0)
    small = np.abs(traction) <= 1e-9 * np.abs(traction).max(initial=0)
    traction[small] = 0.0
    paired = {label for pair in manifest.contact_pairs for label in pair}
    start, end, label = edges.T
    whole = {name: fixed[edges[label == name, :2]].min(axis=(0, 1))
             for name in np.unique(label).tolist()}  # a support holds a label, not its neighbours
    founded = manifest.rooms.get("springs", {}).get("labels", [])
    # where its stiffness is zero a foundation is none
    carried = np.isin(label, founded) & on_springs[edges[:, :2]].all(axis=1)
    joined_labels = {label for kind in ("tie", "periodic")
                     for pair in manifest.rooms.get(kind, {}).get("labels", []) for label in pair}
    motion = (moved[start] + moved[end]) / 2
    rows = []
    for points, edge, move, pull, on_spring in zip(
            _points(place, edges, structure.outer_middles), label.tolist(), motion,
            traction.tolist(), carried.tolist()):
        held = whole[edge]
        if edge in paired:
            role = "pair"
        elif edge in manifest.contact_labels:
            role = "contact"
        elif held.any():
            role = "support"
        elif on_spring:
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


def _sums(places: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(m, 2) sums of the `values` (n, 2) at each of the `wanted` places (m,), among `places` (n,).
    """
    order = np.argsort(wanted)
    at, known = lookup(wanted[order], places)
    sums = np.zeros((len(wanted), 2))
    np.add.at(sums, order[at[known]], values[known])
    return sums


def _measures(place: np.ndarray, edges: np.ndarray, middles: np.ndarray,
              revolved: bool) -> np.ndarray:
    """(n,) what the edges (n, 2) have of a constant traction: lengths, of bodies of revolution
    (`revolved`) times 2 pi r; of quadratic elements what the shape functions of `middles` have.
    """
    if len(middles):
        return sides.integrals(place[np.column_stack([edges, middles])], revolved)[:, 2]
    length = np.linalg.norm(place[edges[:, 1]] - place[edges[:, 0]], axis=1)
    return length * 2 * np.pi * place[edges, 0].mean(axis=1) if revolved else length
