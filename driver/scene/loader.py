"""Stage 2: read the subdomains of an export and refuse what is not sound.

An export is a directory with ``manifest.json``, ``block-<k>.bin`` and the driver's ``seal.json``. A block holds the
records of a contiguous range of subdomains; those of subdomains that are cut alike out of a homogeneous rectangle have
no stiffness of their own, which they share and ``shared.bin`` has. The seal shows what was changed since FreeFEM wrote
it, record_checks.py what FreeFEM, or a scene, did wrong.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError, agree
from . import elements, records
from . import record_checks as checks
from .manifest import Manifest
from .records import Head, RecordFile
from .rooms import rooms
from .seal import SHARED


@dataclass
class ContactData:
    """Contact nodes of one subdomain, one entry per node and contact label.

    All arrays have length n_c. `columns` are those that declared effects give their nodes, means over the dual segments. Weights are integrals of the nodes' shape functions over the boundary of this
    subdomain: of an edge its ends get 1/2 each or, with quadratic elements, 1/6 each and its middle 4/6.
    """

    node: np.ndarray
    label: np.ndarray
    weight: np.ndarray
    normal: np.ndarray  # (n_c, 2), outward, length 1 on straight parts
    columns: dict[str, np.ndarray] = field(default_factory=dict)

    def column(self, name: str) -> np.ndarray:
        """(n_c,) numbers of a column, zero where no effect has declared it."""
        return self.columns[name] if name in self.columns else np.zeros(len(self.weight))


@dataclass
class Subdomain:
    """One torn subdomain as exported.

    Its n_v nodes are the vertices of the mesh and, with quadratic elements, the middles of the (straight) edges and, with
    P2-mixed, the centroids.
    `dof_node` and `dof_component` give node and displacement component of every dof; `rows`,
    `columns`, `values` are the pure Neumann stiffness in coordinate form, both triangles.
    """

    index: int
    node_gid: np.ndarray  # (n_v,) node numbers in the untorn body
    xy: np.ndarray  # (n_v, 2)
    elements: np.ndarray  # (n_t, 3), (n_t, 6) or (n_t, 7) nodes as in elements.py
    region: np.ndarray  # (n_t,)
    edges: np.ndarray  # (n_e, 2) vertices of the boundary edges
    edge_label: np.ndarray  # (n_e,)
    elasticity: np.ndarray  # (n_t, 3, 3) plane Hooke's law in Voigt form, the means over the triangles
    # by pattern given as initial stress: (n_t, 3) stress of its strain if that is suppressed; of quadratic elements (n_t, 3 corners, 3)
    thermal: dict[int, np.ndarray]
    sigma_zz: np.ndarray | None  # (n_t,) factor of (e11 + e22) in the out-of-plane stress; None where that is zero
    dof_node: np.ndarray
    dof_component: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    loads: np.ndarray  # (patterns, dofs)
    edge_loads: dict[int, np.ndarray]  # by pattern given on edges: (n_e, 2, 2) moments [end, component] against the hats
    body_loads: dict[int, np.ndarray]  # by pattern given on triangles: (n_t, 3, 2) moments [vertex, component] likewise
    fixed: np.ndarray  # (n_fixed,) Dirichlet dofs
    fixed_values: np.ndarray  # (patterns, n_fixed); zero for patterns that move no support
    contact: ContactData | None = None
    corner_elasticity: np.ndarray | None = None  # (n_t, 3 corners, 3, 3) Hooke's law at the corners of quadratic elements
    fields: dict[str, np.ndarray] = field(default_factory=dict)  # (n_v,) what declared effects give all nodes

    @property
    def dofs(self) -> int:
        return len(self.dof_node)

    @property
    def triangles(self) -> np.ndarray:
        """(n_t, 3) vertices of the triangles."""
        return self.elements[:, :3]

    @property
    def vertices(self) -> np.ndarray:
        """(n_v,) whether a node is a vertex of the mesh."""
        found = np.ones(len(self.xy), bool)
        found[self.elements[:, 3:]] = False
        return found

    def middles(self, edges: np.ndarray) -> np.ndarray:
        """(n,) nodes in the middle of edges given by their vertices (n, 2); none with linear elements."""
        if self.elements.shape[1] == 3:
            return np.empty(0, np.int64)
        span = len(self.xy)
        sides = np.sort(self.triangles[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2), axis=1) @ [span, 1]
        keys, at = np.unique(sides, return_index=True)
        return self.elements[:, 3:6].ravel()[at[np.searchsorted(keys, np.sort(edges, axis=1) @ [span, 1])]]

    def multiply(self, u: np.ndarray) -> np.ndarray:
        """K u for u of shape (dofs,)."""
        return np.bincount(self.rows, self.values * u[self.columns], minlength=self.dofs)


def read_subdomains(manifest: Manifest, start: int, stop: int, comm) -> list[Subdomain]:
    """Read subdomains start <= s < stop; collective over `comm`.

    Raises InputError (on all ranks alike) when a block is not what the seal says, or a record is truncated, not
    finite, of the wrong size, out of range, or its stiffness is not symmetric or resists a rigid motion.
    """
    found, error, pieces = [], None, _Pieces(manifest)
    try:
        for block in range(manifest.blocks):
            first = manifest.subdomains * block // manifest.blocks
            last = manifest.subdomains * (block + 1) // manifest.blocks
            if max(first, start) >= min(last, stop):
                continue
            file, index = RecordFile(manifest.directory / f"block-{block}.bin", manifest.seal), first
            while index < min(last, stop):
                head, place = file.head(), checks.Place(file.path, index)
                checks.check_head(head, manifest, place)
                layout = records.record_layout(head, manifest)
                count = min(file.alike(head, layout), (start if index < start else min(last, stop)) - index)
                stack = file.stack(layout, count)
                if index >= start:
                    found += _subdomains(stack, head, manifest, pieces, place)
                index += count
            if last <= stop and not file.ended:
                raise InputError(f"{file.path} goes on after its last record; run the scene again")
    except InputError as problem:
        error = problem
    agree(comm, error)
    return found


def _subdomains(stack: dict, head: Head, manifest: Manifest, pieces: "_Pieces", place: checks.Place) -> list[Subdomain]:
    """The subdomains of a stack of records, checked."""
    checks.check_numbers(stack["head"][:, 0], place)
    gid, xy = stack["gid"], _places(stack)
    checks.check_indices(gid, manifest.nodes, "node number", place)
    checks.check_distinct(gid, place)
    common = pieces.read(stack, head, xy, place)
    by_pattern = lambda name: {k: stack[name, k] for k in range(head.patterns) if (name, k) in stack}
    loads = np.zeros((len(gid), head.patterns, head.dofs))
    for k, values in by_pattern("load").items():
        loads[:, k] = values
    edge_loads = {k: values.reshape(len(gid), -1, 2, 2) for k, values in by_pattern("edge_load").items()}
    body_loads = _body_loads(stack, by_pattern("body_load_1"), common, xy)
    _check_distributed(loads, edge_loads, body_loads, common, xy, place)
    suppressed = {k: np.stack([_linear(stack[f"suppressed_{row}", k], manifest) for row in ("11", "22", "12")], axis=-1)
                  for k in by_pattern("suppressed_11")}
    checks.check_indices(stack["fixed"], head.dofs, "fixed dof", place)
    fixed_values = np.zeros((len(gid), head.patterns, head.fixed))
    for k, values in by_pattern("fixed_value").items():
        fixed_values[:, k] = values[:, : head.fixed]
    contact = _contacts(stack, head, manifest, place) if head.contact else [None] * len(gid)
    fields = {name: stack["field", name] for name in manifest.fields}
    of = lambda found, s: {k: values[s] for k, values in found.items()}
    return [Subdomain(index=place.first + s, node_gid=gid[s], xy=xy[s], **piece, edge_label=stack["edge_label"][s],
                      thermal=of(suppressed, s), loads=loads[s], edge_loads=of(edge_loads, s), body_loads=of(body_loads, s),
                      fixed=stack["fixed"][s], fixed_values=fixed_values[s], contact=contact[s], fields=of(fields, s))
            for s, piece in enumerate(common)]


def _places(stack: dict) -> np.ndarray:
    """(n, n_v, 2) places of the nodes."""
    return np.stack([stack["x"], stack["y"]], axis=-1)


class _Pieces:
    """What subdomains share: that of shared.bin, and what the last one had that was read with a stiffness of its own.

    A piece is a dictionary of those attributes of a Subdomain that do not depend on where it is.
    """

    def __init__(self, manifest: Manifest):
        self.manifest = manifest
        self.last, self.last_xy = None, None
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
            place.refuse([True], f"it is of another size than the mesh of {SHARED}, which it refers to")
        found = [piece] * len(xy)
        checks.check_mesh(xy, piece["elements"][None], place)
        other = np.flatnonzero(~checks.same_shape(xy, self.shared_xy[None]))
        checks.check_rigid_motions(found, xy, other.tolist(), place)
        return found

    def _read_shared(self) -> None:
        file = RecordFile(self.manifest.directory / SHARED, self.manifest.seal)
        head, place = file.head(), checks.Place(file.path)
        checks.check_sizes(head, place)
        stack = file.stack([records.HEAD, *records.places_layout(head), *records.piece_layout(head, self.manifest)])
        if not file.ended:
            raise InputError(f"{file.path} goes on after its last record; run the scene again")
        xy = _places(stack)
        self.shared, self.shared_xy = _Pieces(self.manifest)._own(stack, head, xy, place)[0], xy[0]

    def _own(self, stack: dict, head: Head, xy: np.ndarray, place: checks.Place) -> list[dict]:
        """Pieces with a mesh and a stiffness in their record; what has the bits of the one before is that."""
        nodes = stack["elements"].reshape(len(xy), head.triangles, -1)
        edges = stack["edges"].reshape(len(xy), head.edges, 2)
        checks.check_indices(stack["elements"], head.nodes, "triangle node", place)
        checks.check_mesh(xy, nodes, place)
        checks.check_edges(edges, nodes, head.nodes, place)
        checks.check_dofs(stack["dof_coordinate"], stack["is_x"], xy, place)
        checks.check_indices(stack["rows"], head.dofs, "stiffness row", place)
        checks.check_indices(stack["columns"], head.dofs, "stiffness column", place)
        once = {"elements": nodes, "edges": edges, **{name: stack[name] for name in ("rows", "columns", "values")}}
        once = {name: _kept_once(values, self.last and self.last[name]) for name, values in once.items()}
        dof_node, component = np.divmod(np.arange(head.dofs), 2)
        elasticity, corner_elasticity, sigma_zz = _elasticity(stack, self.manifest)
        each = lambda values, s: None if values is None else values[s]
        found = [{**{name: values[s] for name, values in once.items()}, "region": stack["region"][s],
                  "elasticity": elasticity[s], "corner_elasticity": each(corner_elasticity, s), "sigma_zz": each(sigma_zz, s),
                  "dof_node": dof_node, "dof_component": component} for s in range(len(xy))]
        self._check_stiffness(found, xy, place)
        return found

    def _check_stiffness(self, found: list[dict], xy: np.ndarray, place: checks.Place) -> None:
        """Symmetry and rigid motions, of those not checked already with the stiffness and shape of the one before."""
        like, like_xy, unlike, moved = self.last, self.last_xy, [], []
        for s, piece in enumerate(found):
            known = like is not None and all(piece[name] is like[name] for name in ("rows", "columns", "values"))
            if not known:
                unlike.append(s)
            if not (known and checks.same_shape(xy[s : s + 1], like_xy[None])[0]):
                moved.append(s)
            if not known:
                like, like_xy = piece, xy[s]
        self.last, self.last_xy = like, like_xy
        checks.check_symmetric(found, unlike, place)
        checks.check_rigid_motions(found, xy, moved, place)


def _kept_once(values: np.ndarray, last: np.ndarray | None) -> list[np.ndarray]:
    """Arrays `values` (n, ...), where they have the bits of the one before, at first `last`, that one itself."""
    same = [last is not None and np.array_equal(values[0].view(np.int64), last.view(np.int64))]
    if len(values) > 1:
        same += (values[1:].view(np.int64) == values[:-1].view(np.int64)).all(axis=tuple(range(1, values.ndim))).tolist()
    found = []
    for array, is_last in zip(values, same):
        last = last if is_last else array.copy() if len(values) > 1 else array
        found.append(last)
    return found


def _elasticity(stack: dict, manifest: Manifest):
    """Plane elasticity matrices (n, n_t, 3, 3), at the corners (n, n_t, 3, 3, 3) or None, factor of the stress out of plane."""
    moduli = [_linear(stack[name], manifest) for name in records.moduli(manifest)]
    sigma_zz = None  # general plane laws say nothing of the third direction
    if manifest.material == "isotropic":
        lam, mu = moduli
        zero = np.zeros_like(lam)
        moduli = (lam + 2 * mu, lam, zero, lam + 2 * mu, zero, mu)
        if manifest.plane == "strain":
            sigma_zz = lam if lam.ndim == 2 else lam.mean(axis=2)
    c11, c12, c13, c22, c23, c33 = moduli
    found = np.stack([c11, c12, c13, c12, c22, c23, c13, c23, c33], axis=-1).reshape(*c11.shape, 3, 3)
    return (found, None, sigma_zz) if found.ndim == 4 else (found.mean(axis=2), found, sigma_zz)


def _linear(values: np.ndarray, manifest: Manifest) -> np.ndarray:
    """(n, n_t) means over the triangles or, of quadratic elements, (n, n_t, 3) corner values of the nearest linear function."""
    return values if manifest.element == "P1" else values.reshape(len(values), -1, 3) @ elements.INVERSE_MASS


def _stacked(pieces: list[dict], name: str) -> np.ndarray:
    """(n, ...) arrays of the pieces, or (1, ...) where they are one."""
    first = pieces[0][name]
    return first[None] if all(piece[name] is first for piece in pieces) else np.stack([piece[name] for piece in pieces])


def _body_loads(stack: dict, integrals: dict, common: list[dict], xy: np.ndarray) -> dict[int, np.ndarray]:
    """Moments (n, n_t, 3, 2) of every body force against the hat functions of the triangles.

    The export holds the integrals of f, x f and y f; hats are linear in x and y.
    """
    if not integrals:
        return {}
    corner = checks.at_nodes(xy, _stacked(common, "elements")[..., :3]).reshape(-1, 3, 2)
    gradient, middle, found = elements.hat_gradients(corner), corner.mean(axis=1), {}
    for k in integrals:
        f, fx, fy = (stack[f"body_load_{factor}", k].reshape(-1, 2) for factor in "1xy")
        slopes = np.stack([fx - middle[:, :1] * f, fy - middle[:, 1:] * f], axis=1)  # [t, direction, component]
        found[k] = (f[:, None, :] / 3 + gradient @ slopes).reshape(len(xy), -1, 3, 2)
    return found


def _check_distributed(loads, edge_loads: dict, body_loads: dict, common: list[dict], xy, place: checks.Place) -> None:
    """Loads of edges and triangles are those of the nodes."""
    if edge_loads:
        edges = _stacked(common, "edges")
        for k, moments in edge_loads.items():
            checks.check_distributed(loads[:, k], edges, moments, "edges", 1.0, place)
    if body_loads:
        triangles = _stacked(common, "elements")[..., :3]
        corner = checks.at_nodes(xy, triangles)
        shortest = np.linalg.norm(corner[:, :, 1] - corner[:, :, 0], axis=-1).min(axis=1)
        for k, moments in body_loads.items():
            checks.check_distributed(loads[:, k], triangles, moments, "triangles",
                                     np.abs(xy).max(axis=(1, 2)) / shortest, place)


def _contacts(stack: dict, head: Head, manifest: Manifest, place: checks.Place) -> list[ContactData]:
    """Contact nodes of a stack of records."""
    checks.check_indices(stack["node"], head.nodes, "contact node", place)
    checks.check_contact(stack["label"], stack["weight"], manifest.contact_labels, place)
    for name in manifest.columns:
        values = stack["column", name]
        if (values < 0).any() and any(room.column == name and room.nonnegative for room in rooms()):
            checks.check_not_negative(values, name, place)
    return [_contact(stack, manifest, s) for s in range(len(stack["node"]))]


def _contact(stack: dict, manifest: Manifest, s: int) -> ContactData:
    return ContactData(stack["node"][s], stack["label"][s], stack["weight"][s],
                       np.column_stack([stack["normal_x"][s], stack["normal_y"][s]]),
                       {name: stack["column", name][s] for name in manifest.columns})


def read_contact(directory: Path, manifest: Manifest) -> tuple[ContactData, np.ndarray]:
    """Contact nodes of all pieces for one value of a parameter study: data and node numbers.

    Raises InputError as `read_subdomains`.
    """
    file = RecordFile(directory / "contact.bin", manifest.seal)
    count = int(file.stack([("count", 1, np.int64)])["count"][0, 0])
    numbers = records.contact_layout(count, manifest)
    stack = file.stack([("label", count, np.int64), ("gid", count, np.int64), *numbers])
    checks.check_indices(stack["gid"], manifest.nodes, "node number", checks.Place(file.path))
    stack["node"] = np.arange(count)[None]
    return _contact(stack, manifest, 0), stack["gid"][0]
