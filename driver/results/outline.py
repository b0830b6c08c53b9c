"""Stage 7: boundary.csv, the edges of the outline, their part in the scene, unit tractions."""

from pathlib import Path

import numpy as np

from ..errors import agreed_writes
from ..feti.gathering import joined
from ..feti.structure import Substructure
from ..files import write_rows
from ..scene.manifest import Manifest
from .contact_state import constrained_keys
from .tables import BOUNDARY, header


def write_outline(path: Path, manifest: Manifest, structure: Substructure, comm) -> None:
    """Write the table to `path` on rank 0; collective. Raises InputError if that fails."""
    subs = structure.subdomains
    traction = [k for k, pattern in enumerate(manifest.patterns) if pattern["given_on"] == "edges"]
    outline = np.zeros(manifest.nodes, bool)
    outline[structure.outer_edges[:, :2]] = outline[structure.outer_middles] = True
    gid = joined((sub.node_gid for sub in subs), np.int64)
    near = outline[gid]
    xy = joined((sub.xy for sub in subs), float, 2)[near]
    force = joined((sub.loads[traction].sum(axis=0) for sub in subs), float).reshape(-1, 2)[near]
    parts = comm.gather((gid[near], xy, force, constrained_keys(structure) // 2))
    with agreed_writes(comm):
        if comm.rank == 0:
            write_rows(path, header(BOUNDARY), _rows(manifest, structure, parts))


def _rows(manifest: Manifest, structure: Substructure, parts: list[tuple]) -> list[list]:
    """Rows of the table from `parts` of every rank, see `_part`."""
    constrained = np.zeros(manifest.nodes, bool)
    place, push = np.zeros((2, manifest.nodes, 2))
    for gid, xy, force, fixed in parts:
        place[gid], constrained[fixed] = xy, True
        np.add.at(push, gid, force)
    traction = _edge_tractions(structure.outer_edges, structure.outer_middles, place, push)
    paired = {label for pair in manifest.contact_pairs for label in pair}
    start, end, label = structure.outer_edges.T
    supported = constrained[start] & constrained[end]
    rows = []
    for p, q, edge, support in zip(place[start].tolist(), place[end].tolist(), label.tolist(),
                                   supported):
        pull = traction.get(edge, [0.0, 0.0])
        if edge in paired:
            role = "pair"
        elif edge in manifest.contact_labels:
            role = "contact"
        elif support:
            role = "support"
        else:
            role = "load" if any(pull) else "free"
        rows.append([*p, *q, edge, role, *pull])
    return rows


def _edge_tractions(edges: np.ndarray, middles: np.ndarray, place: np.ndarray,
                    push: np.ndarray) -> dict[int, list[float]]:
    """Mean traction of every outer label, from nodal forces `push` (nodes, 2) inside it.

    `edges` (n, 3) have two ends and a label. A node's part of an edge is the integral of its shape
    function: halves, with `middles` (n,) a sixth, a sixth and the rest.
    """
    size = np.linalg.norm(place[edges[:, 0]] - place[edges[:, 1]], axis=1)
    nodes, parts = edges[:, :2], [0.5, 0.5]
    if len(middles):
        nodes, parts = np.column_stack([edges[:, :2], middles]), [1 / 6, 1 / 6, 4 / 6]
    length = np.bincount(nodes.ravel(), np.outer(size, parts).ravel(), len(place))
    first = np.full(len(place), np.iinfo(np.int64).max)
    last = np.full(len(place), np.iinfo(np.int64).min)
    np.minimum.at(first, nodes, edges[:, 2:])
    np.maximum.at(last, nodes, edges[:, 2:])
    inside, mean = np.flatnonzero(first == last), {}
    for label in np.unique(first[inside]).tolist():
        own = inside[first[inside] == label]
        mean[label] = push[own].sum(axis=0) / length[own].sum()
    largest = max((np.abs(f).max() for f in mean.values()), default=0.0)
    return {label: np.where(np.abs(f) > 1e-9 * largest, f, 0.0).tolist()
            for label, f in mean.items()}
