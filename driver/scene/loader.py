"""Read the subdomains of an export and refuse what is not sound.

An export is a directory with ``manifest.json``, ``block-<k>.bin`` and the driver's ``seal.json``. A
block holds the records of a contiguous range of subdomains; those of subdomains that are cut alike
out of a homogeneous rectangle have no stiffness of their own, which they share and ``shared.bin``
has. The seal shows what was changed since FreeFEM wrote it, record_checks.py what FreeFEM, or a
scene, did wrong.
"""

import itertools
import operator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError, agree
from . import elements, records, springs
from . import record_checks as checks
from .manifest import Manifest
from .records import Head, RecordFile
from .rooms import rooms
from .seal import SHARED
from .subdomain import ContactData, Subdomain
from .symmetric import Symmetric

EVEN = 1e-14  # relative difference of elasticities that is rounding


def read_subdomains(manifest: Manifest, start: int, stop: int, comm,
                    growing=None) -> list[Subdomain]:
    """Read subdomains start <= s < stop; collective over `comm`.

    `growing`, if given, is their growing.GrowingExport, which has read some already; they count if
    that is what FreeFEM left. Raises InputError (on all ranks alike) when a block is not what the
    seal says, or a record is truncated, not finite, of the wrong size, out of range, or its
    stiffness is not symmetric or resists a rigid motion.
    """
    subdomains, error, pieces, index = [], None, Pieces(manifest), {}
    try:
        blocks = {block: RecordFile(block.path, manifest.seal)
                  for block in blocks_of(manifest, start, stop)}
        if growing and growing.is_beginning_of(manifest, blocks):
            subdomains, index, pieces = growing.subdomains[:], growing.index, growing.pieces
            pieces.manifest = manifest
        for block, file in blocks.items():
            begin = index.get(block, block.held[0])
            subdomains += _read_block(file, block, begin, manifest, pieces)
    except InputError as problem:
        error = problem
    agree(comm, error)
    return subdomains


class Block(NamedTuple):
    """A file and ranges [first, end) of subdomains: what it holds, and what is wanted of that."""

    path: Path
    held: tuple[int, int]
    wanted: tuple[int, int]


def blocks_of(manifest: Manifest, start: int, stop: int) -> list[Block]:
    """The files that have some of the subdomains start <= s < stop."""
    ends = [manifest.subdomains * block // manifest.blocks for block in range(manifest.blocks + 1)]
    blocks = [Block(manifest.directory / f"block-{block}.bin", (first, end),
                    (max(first, start), min(end, stop)))
              for block, (first, end) in enumerate(itertools.pairwise(ends))]
    return [block for block in blocks if block.wanted[0] < block.wanted[1]]


def _read_block(file: RecordFile, block: Block, index: int, manifest: Manifest,
                pieces: "Pieces") -> list[Subdomain]:
    """The wanted subdomains of a block from `index` on, whose record comes next."""
    subdomains, (first, end) = [], block.wanted
    while index < end:
        head, place = file.head(), checks.Place(file.path, index)
        checks.check_head(head, manifest, place)
        layout = records.record_layout(head, manifest)
        remaining = (first if index < first else end) - index
        count = min(file.alike(head, layout), remaining)
        stack = file.stack(layout, count)
        if index >= first:
            subdomains += subdomains_of(stack, head, manifest, pieces, place)
        index += count
    if end == block.held[1] and not file.ended:
        raise InputError(f"{file.path} goes on after its last record; run the scene again")
    return subdomains


def subdomains_of(stack: dict, head: Head, manifest: Manifest, pieces: "Pieces",
                  place: checks.Place) -> list[Subdomain]:
    """The subdomains of a stack of records, checked."""
    checks.check_numbers(stack["head"][:, 0], place)
    gid, xy = stack["gid"], _places(stack)
    checks.check_indices(gid, manifest.nodes, "node number", place)
    checks.check_distinct(gid, place)
    common = pieces.read(stack, head, xy, place)
    loads = np.zeros((len(gid), head.patterns, head.dofs))
    for k, values in _by_pattern(stack, head, "load").items():
        loads[:, k] = values
    edge_loads = {k: values.reshape(len(gid), -1, 2, 2)
                  for k, values in _by_pattern(stack, head, "edge_load").items()}
    unseen = {k: values[:, 0] for k, values in _by_pattern(stack, head, "unseen").items()}
    body_loads = _body_loads(stack, head, common, xy)
    _check_distributed(loads, edge_loads, body_loads, common, xy, place)
    suppressed = _suppressed(stack, head, manifest)
    checks.check_indices(stack["fixed"], head.dofs, "fixed dof", place)
    fixed_values = np.zeros((len(gid), head.patterns, head.fixed))
    for k, values in _by_pattern(stack, head, "fixed_value").items():
        fixed_values[:, k] = values[:, : head.fixed]
    contact = [None] * len(gid)
    if head.contact:
        contact = _contacts(stack, head, manifest, place)
    fields = {name: stack["field", name] for name in manifest.fields}
    made = [Subdomain(index=place.first + s, node_gid=gid[s], xy=xy[s],
                      **piece | springs.stiffened(piece, _of_record(fields, s)),
                      edge_label=stack["edge_label"][s], thermal=_of_record(suppressed, s),
                      loads=loads[s], edge_loads=_of_record(edge_loads, s),
                      unseen=_of_record(unseen, s),
                      body_loads=_of_record(body_loads, s), fixed=stack["fixed"][s],
                      fixed_values=fixed_values[s], contact=contact[s],
                      fields=_of_record(fields, s), cut_alike=not head.entries,
                      curved=bool(manifest.curved) and _is_curved(xy[s], piece["elements"]))
            for s, piece in enumerate(common)]
    for sub in made if head.entries else ():
        sub.rim = _rim(sub, manifest)
    return made


def _rim(sub: Subdomain, manifest: Manifest) -> np.ndarray:
    """(n,) nodes, ascending, on boundaries where rows act, and where labels meet."""
    edges = sub.edges[np.isin(sub.edge_label, manifest.row_labels)]
    least, most = np.full((2, len(sub.xy)), [[np.inf], [-np.inf]])
    np.minimum.at(least, sub.edges, sub.edge_label[:, None])
    np.maximum.at(most, sub.edges, sub.edge_label[:, None])
    meet = np.flatnonzero(least < most)
    return np.unique(np.concatenate([edges.ravel(), sub.middles(edges), meet]))


def _is_curved(xy: np.ndarray, nodes: np.ndarray) -> bool:
    """Whether middles of sides are off their chords."""
    chords = (xy[nodes[:, [1, 2, 0]]] + xy[nodes[:, [2, 0, 1]]]) / 2
    return bool((np.abs(xy[nodes[:, 3:6]] - chords) > 1e-12 * np.ptp(xy, axis=0).max()).any())


def _by_pattern(stack: dict, head: Head, name: str) -> dict[int, np.ndarray]:
    """The arrays `name` of the load patterns that have one."""
    return {k: stack[name, k] for k in range(head.patterns) if (name, k) in stack}


def _of_record(arrays: dict, record: int) -> dict:
    """Arrays (n, ...) of a stack: those of one of its records."""
    return {key: values[record] for key, values in arrays.items()}


def _suppressed(stack: dict, head: Head, manifest: Manifest) -> dict[int, np.ndarray]:
    """Stresses (n, n_t, [3 corners,] 3 or 4) of the patterns given as initial stress."""
    stresses = {}
    for k in _by_pattern(stack, head, "suppressed_11"):
        rows = [_linear(stack[f"suppressed_{row}", k], manifest) for row in ("11", "22", "12")]
        if manifest.axisymmetric:
            rows.append(rows[0])  # isotropic: the same in all directions
        stresses[k] = np.stack(rows, axis=-1)
    return stresses


def _places(stack: dict) -> np.ndarray:
    """(n, n_v, 2) places of the nodes."""
    return np.stack([stack["x"], stack["y"]], axis=-1)


class Pieces:
    """What subdomains share: that of shared.bin, and the stiffness read last.

    A piece is a dictionary of those attributes of a Subdomain that do not depend on where it is.
    """

    def __init__(self, manifest: Manifest):
        self.manifest = manifest
        self.last, self.last_xy = None, None
        self.stored, self.halved = None, (None, None)
        self.shared, self.shared_xy = None, None

    def read(self, stack: dict, head: Head, xy: np.ndarray, place: checks.Place) -> list[dict]:
        """The pieces of a stack of records with the places `xy` (n, n_v, 2), checked."""
        if head.entries:
            return self._own(stack, head, xy, place)
        if self.shared is None:
            self._read_shared()
        piece = self.shared
        sizes = (len(self.shared_xy), len(piece["elements"]), len(piece["edges"]))
        if sizes != (head.nodes, head.triangles, head.edges):
            place.refuse([True],
                         f"it is of another size than the mesh of {SHARED}, which it refers to")
        pieces = [piece] * len(xy)
        checks.check_mesh(xy, piece["elements"][None], place)
        other = np.flatnonzero(~checks.same_shape(xy, self.shared_xy[None]))
        checks.check_rigid_motions(pieces, xy, other.tolist(), place,
                                   self.manifest.axisymmetric)
        return pieces

    def _read_shared(self) -> None:
        file = RecordFile(self.manifest.directory / SHARED, self.manifest.seal)
        head, place = file.head(), checks.Place(file.path)
        checks.check_sizes(head, place)
        stack = file.stack([records.HEAD, *records.places_layout(head),
                            *records.piece_layout(head, self.manifest)])
        if not file.ended:
            raise InputError(f"{file.path} goes on after its last record; run the scene again")
        xy = _places(stack)
        self.shared = Pieces(self.manifest)._own(stack, head, xy, place)[0]
        self.shared_xy = xy[0]

    def _own(self, stack: dict, head: Head, xy: np.ndarray, place: checks.Place) -> list[dict]:
        """Pieces with a mesh and a stiffness in their record; equal arrays are kept once."""
        nodes = stack["elements"].reshape(len(xy), head.triangles, -1)
        edges = stack["edges"].reshape(len(xy), head.edges, 2)
        _check_mesh(stack, head, nodes, edges, xy, place, bool(self.manifest.curved))
        # whole numbers of 4 bytes hold any piece, and half the memory
        rows, columns = (stack[name].astype(np.int32) for name in ("rows", "columns"))
        arrays = {"elements": nodes, "edges": edges, "rows": rows, "columns": columns,
                  "values": stack["values"]}
        arrays = {name: _kept_once(values, self.stored and self.stored[name])
                  for name, values in arrays.items()}
        self.stored = {name: values[-1] for name, values in arrays.items()}
        given = [arrays.pop(name) for name in ("rows", "columns", "values")]
        checks.check_order(*given[:2], place)
        arrays["stiffness"] = self._halves(list(zip(*given)), head.dofs, place)
        arrays |= {"region": stack["region"], **_elasticity(stack, self.manifest)}
        pieces = [_of_record(arrays, s) for s in range(len(xy))]
        self._check_stiffness(pieces, xy, place)
        return pieces

    def _halves(self, given: list[tuple], dofs: int, place: checks.Place) -> list[Symmetric]:
        """The stiffness of every record by the entries `given`; equal ones are the same object."""
        stiffness = []
        for record, entries in enumerate(given):
            before, half = self.halved
            if before is None or any(map(operator.is_not, entries, before)):
                checks.check_symmetric(*entries, record, len(given), place)
                half = Symmetric.of_lower(*entries, dofs)
                self.halved = entries, half
            stiffness.append(half)
        return stiffness

    def _check_stiffness(self, pieces: list[dict], xy: np.ndarray, place: checks.Place) -> None:
        """Rigid motions, where stiffness or shape are not those of the one before."""
        like, like_xy, moved = self.last, self.last_xy, []
        for s, piece in enumerate(pieces):
            known = like is not None and piece["stiffness"] is like["stiffness"]
            if not (known and checks.same_shape(xy[s : s + 1], like_xy[None])[0]):
                moved.append(s)
            if not known:
                like, like_xy = piece, xy[s]
        self.last, self.last_xy = like, like_xy
        checks.check_rigid_motions(pieces, xy, moved, place, self.manifest.axisymmetric)


def _check_mesh(stack: dict, head: Head, nodes: np.ndarray, edges: np.ndarray, xy: np.ndarray,
                place: checks.Place, curved: bool) -> None:
    """Triangles `nodes` (n, n_t, nodes), `edges` (n, n_e, 2), dofs and indices are sound."""
    checks.check_indices(stack["elements"], head.nodes, "triangle node", place)
    checks.check_mesh(xy, nodes, place, curved)
    checks.check_edges(edges, nodes, head.nodes, place)
    checks.check_dofs(stack["dof_coordinate"], stack["is_x"], xy, place)
    checks.check_indices(stack["rows"], head.dofs, "stiffness row", place)
    checks.check_indices(stack["columns"], head.dofs, "stiffness column", place)


def _kept_once(values: np.ndarray, last: np.ndarray | None) -> list[np.ndarray]:
    """The arrays of `values` (n, ...); one with the bits of the one before is that one itself.

    `last`, if any, comes before the first.
    """
    word = f"i{values.itemsize}"
    bits = values.view(word)
    same = [last is not None and np.array_equal(bits[0], last.view(word))]
    if len(values) > 1:
        same += (bits[1:] == bits[:-1]).all(axis=tuple(range(1, values.ndim))).tolist()
    arrays = []
    for array, is_last in zip(values, same):
        if not is_last:
            last = array.copy() if len(values) > 1 else array
        arrays.append(last)
    return arrays


def _elasticity(stack: dict, manifest: Manifest) -> dict:
    """Elasticity of a stack of records, entry by entry of a Subdomain, None for each if none.

    `elasticity` (n, n_t, 3, 3), `corner_elasticity` (n, n_t, 3, 3, 3), `sigma_zz` (n, n_t); of
    bodies of revolution k = 4 for the 3 of the law.
    """
    moduli = [_linear(stack[name], manifest) for name in records.moduli(manifest)]
    none, k = [None] * len(stack["region"]), 3
    sigma_zz = none  # general plane laws say nothing of the third direction
    if manifest.material == "isotropic":
        lam, mu = moduli
        zero = np.zeros_like(lam)
        moduli = (lam + 2 * mu, lam, zero, lam + 2 * mu, zero, mu)
        if manifest.plane == "strain":
            sigma_zz = lam if lam.ndim == 2 else lam.mean(axis=2)
    c11, c12, c13, c22, c23, c33 = moduli
    entries = [c11, c12, c13, c12, c22, c23, c13, c23, c33]
    if manifest.axisymmetric:
        entries = [c11, c12, zero, c12, c12, c11, zero, c12, zero, zero, mu, zero,
                   c12, c12, zero, c11]
        sigma_zz, k = none, 4
    matrix = np.stack(entries, axis=-1).reshape(*c11.shape, k, k)
    if matrix.ndim == 4:
        return {"elasticity": _even(matrix), "corner_elasticity": none, "sigma_zz": sigma_zz}
    return {"elasticity": _even(matrix.mean(axis=2)), "corner_elasticity": _even(matrix),
            "sigma_zz": sigma_zz}


def _even(laws: np.ndarray) -> list[np.ndarray]:
    """`laws` (n, n_t, ...) of every record; where all its triangles have one, that is kept once.

    They are means over triangles, which differ by rounding.
    """
    return [np.broadcast_to(own[:1].copy(), own.shape)
            if np.abs(own - own[:1]).max() <= EVEN * np.abs(own[0]).max() else own
            for own in laws]


def _linear(values: np.ndarray, manifest: Manifest) -> np.ndarray:
    """(n, n_t) means over the triangles or, of quadratic elements, (n, n_t, 3) corner values.

    These are of the nearest linear function; `values` are the moments of the export.
    """
    if manifest.element == "P1":
        return values
    return values.reshape(len(values), -1, 3) @ elements.INVERSE_MASS


def _stacked(pieces: list[dict], name: str) -> np.ndarray:
    """(n, ...) arrays of the pieces, or (1, ...) where they are one."""
    first = pieces[0][name]
    if all(piece[name] is first for piece in pieces):
        return first[None]
    return np.stack([piece[name] for piece in pieces])


def _body_loads(stack: dict, head: Head, common: list[dict],
                xy: np.ndarray) -> dict[int, np.ndarray]:
    """Moments (n, n_t, 3, 2) of every body force against the hat functions of the triangles.

    The export holds the integrals of f, x f and y f; hats are linear in x and y.
    """
    integrals = _by_pattern(stack, head, "body_load_1")
    if not integrals:
        return {}
    corner = checks.at_nodes(xy, _stacked(common, "elements")[..., :3]).reshape(-1, 3, 2)
    gradient, middle, moments = elements.hat_gradients(corner), corner.mean(axis=1), {}
    for k in integrals:
        f, fx, fy = (stack[f"body_load_{factor}", k].reshape(-1, 2) for factor in "1xy")
        # [t, direction, component]
        slopes = np.stack([fx - middle[:, :1] * f, fy - middle[:, 1:] * f], axis=1)
        moments[k] = (f[:, None, :] / 3 + gradient @ slopes).reshape(len(xy), -1, 3, 2)
    return moments


def _check_distributed(loads: np.ndarray, edge_loads: dict, body_loads: dict, common: list[dict],
                       xy: np.ndarray, place: checks.Place) -> None:
    """Loads of edges and triangles are those of the nodes."""
    if edge_loads:
        edges = _stacked(common, "edges")
        for k, moments in edge_loads.items():
            checks.check_distributed(loads[:, k], edges, moments, "edges", 1.0, place)
    if body_loads:
        triangles = _stacked(common, "elements")[..., :3]
        corner = checks.at_nodes(xy, triangles)
        shortest = np.linalg.norm(corner[:, :, 1] - corner[:, :, 0], axis=-1).min(axis=1)
        cancelled = np.abs(xy).max(axis=(1, 2)) / shortest
        for k, moments in body_loads.items():
            checks.check_distributed(loads[:, k], triangles, moments, "triangles", cancelled,
                                     place)


def _contacts(stack: dict, head: Head, manifest: Manifest,
              place: checks.Place) -> list[ContactData]:
    """Contact nodes of a stack of records."""
    checks.check_indices(stack["node"], head.nodes, "contact node", place)
    checks.check_contact(stack["label"], stack["weight"], manifest.contact_labels, place)
    for name in manifest.columns:
        values = stack["column", name]
        if (values < 0).any() and any(room.column == name and room.nonnegative
                                      for room in rooms()):
            checks.check_not_negative(values, name, place)
    return [contact_of(stack, manifest, s) for s in range(len(stack["node"]))]


def contact_of(stack: dict, manifest: Manifest, s: int) -> ContactData:
    """Contact nodes of record `s` of a stack that holds what `records.contact_layout` says."""
    return ContactData(stack["node"][s], stack["label"][s], stack["weight"][s],
                       np.column_stack([stack["normal_x"][s], stack["normal_y"][s]]),
                       {name: stack["column", name][s] for name in manifest.columns})
