"""Stage 2: read an export (manifest and subdomain records) and refuse what is not sound.

An export is a directory with ``manifest.json``, ``block-<k>.bin`` and the driver's ``seal.json``. A block holds
the records of a contiguous range of subdomains; each array of a record is an int64 count followed by its raw
int64 or float64 values, in the order written by ``edp/lib/export.idp``. The seal shows what was changed since
FreeFEM wrote it, the checks of this module what FreeFEM, or a scene, did wrong.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from . import elements
from . import seal as seals
from .errors import InputError, agree, file_error

OPTIONAL = ("slip_law", "initial_state", "contact_pairs")  # parts of the manifest that only some scenes have
HEAD = 9  # subdomain, nodes, triangles, boundary edges, dofs, nnz, patterns, fixed dofs, contact nodes


@dataclass
class ContactData:
    """Contact nodes of one subdomain, one entry per node and contact label.

    All arrays have length n_c. Weights are integrals of the nodes' shape functions over the boundary of this
    subdomain: of an edge its ends get 1/2 each or, with quadratic elements, 1/6 each and its middle 4/6.
    """

    node: np.ndarray
    label: np.ndarray
    weight: np.ndarray
    normal: np.ndarray  # (n_c, 2), outward, length 1 on straight parts
    gap: np.ndarray
    friction: np.ndarray
    initial: np.ndarray  # tangential displacement at time 0


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
    # by thermal pattern: (n_t, 3) stress of its strain if that is suppressed; of quadratic elements (n_t, 3 corners, 3)
    thermal: dict[int, np.ndarray]
    sigma_zz: np.ndarray | None  # (n_t,) factor of (e11 + e22) in the out-of-plane stress; None where that is zero
    dof_node: np.ndarray
    dof_component: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    loads: np.ndarray  # (patterns, dofs)
    edge_loads: dict[int, np.ndarray]  # by traction pattern: (n_e, 2, 2) moments [end, component] against the hats
    body_loads: dict[int, np.ndarray]  # by body force pattern: (n_t, 3, 2) moments [vertex, component] likewise
    fixed: np.ndarray  # (n_fixed,) Dirichlet dofs
    fixed_values: np.ndarray  # (patterns, n_fixed); zero for patterns that move no support
    contact: ContactData | None = None
    corner_elasticity: np.ndarray | None = None  # (n_t, 3 corners, 3, 3) Hooke's law at the corners of quadratic elements
    bow: np.ndarray | None = None  # (n_v, 2) ways from the middles of edges that meet another body to the boundary's curve

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


@dataclass
class Manifest:
    """What the scene declared: sizes, effects, patterns, histories, parameters, units."""

    directory: Path
    subdomains: int
    blocks: int
    nodes: int  # of the untorn bodies
    interface_label: int
    element: str
    plane: str
    material: str
    units: dict
    effects: dict
    steps: int
    t_end: float
    bodies: int
    contact_labels: list
    labels: list
    patterns: list
    amplitudes: dict
    parameters: dict
    contact_pairs: list = field(default_factory=list)  # [label with contact nodes, label of the other body]
    initial_state: bool = False  # whether contact nodes carry a displacement at time 0
    slip_law: dict | None = None  # argument, range, values: factor of the friction coefficient
    seal: seals.Seal | None = field(repr=False, default=None)
    raw: dict = field(repr=False, default_factory=dict)

    def amplitude(self, pattern: int, step: int) -> float:
        """Factor of load pattern `pattern` at time step `step` (0 is the start)."""
        return self.amplitudes[str(self.patterns[pattern]["amplitude"])][step]


def read_manifest(directory: Path, scene: str | None = None) -> Manifest:
    """Read and check ``manifest.json``; `scene`, if given, is the digest that the scene's text has now.

    Raises InputError when it is missing, spoiled, of another text, not JSON, incomplete or not finite.
    """
    path = Path(directory) / "manifest.json"
    if not path.exists():
        raise InputError(f"{path} is missing: the FreeFEM stage did not finish; run the scene again")
    seal = seals.read(path.parent, scene)
    seals.check(seal, path)
    try:
        raw = json.loads(path.read_text())
    except (ValueError, OSError, RecursionError) as problem:
        raise file_error(problem, f"{path} is not readable ({problem}); run the scene again") from None
    names = [name for name in Manifest.__dataclass_fields__ if name not in ("directory", "raw", "seal")]
    missing = [name for name in names if not isinstance(raw, dict) or name not in raw and name not in OPTIONAL]
    if missing:
        raise InputError(f"{path} lacks {', '.join(missing)}; run the scene again")
    manifest = Manifest(directory=Path(directory), raw=raw, seal=seal,
                        **{name: raw[name] for name in names if name in raw})
    try:
        _check_manifest(manifest)
    except InputError as problem:
        raise InputError(f"{path}: {problem}; run the scene again") from None
    return manifest


KINDS = {"subdomains": int, "blocks": int, "nodes": int, "interface_label": int, "element": str, "plane": str,
         "material": str, "units": dict, "effects": dict, "steps": int, "t_end": (int, float), "contact_labels": list,
         "labels": list, "bodies": int, "contact_pairs": list,
         "patterns": list, "amplitudes": dict, "parameters": dict, "initial_state": bool, "slip_law": (dict, type(None))}
# words that mean something to the stages that follow; any other would silently count as "not declared"
WORDS = {"element": tuple(elements.NODES), "plane": ("strain", "stress"), "material": ("isotropic", "general")}
EFFECTS = {"contact": ("none", "unilateral", "bilateral"), "time": ("static", "quasistatic"),
           "friction": ("none", "tresca", "coulomb", "coulomb-slip-dependent"), "initial": ("preload",)}
PATTERNS = ("traction", "body_force", "point", "thermal", "displacement")


def _is(value, kind) -> bool:
    """isinstance, but True is no number."""
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def _finite(values) -> bool:
    """A list of finite numbers?"""
    return isinstance(values, list) and all(_is(v, (int, float)) and abs(v) < np.inf for v in values)


def _check_manifest(manifest: Manifest) -> None:
    for name, kind in KINDS.items():
        if not _is(getattr(manifest, name), kind):
            raise InputError(f"{name} is not of the right type")
    if min(manifest.subdomains, manifest.blocks, manifest.nodes, manifest.steps, manifest.bodies) <= 0:
        raise InputError("subdomains, blocks, nodes, steps and bodies must be positive whole numbers")
    if manifest.blocks != len(manifest.seal.files) - 1:
        raise InputError(f"{manifest.blocks} blocks are declared, {len(manifest.seal.files) - 1} were sealed")
    if not 0 < manifest.t_end < np.inf:
        raise InputError("t_end must be a positive number")
    if not all(_is(label, int) for label in [*manifest.labels, *manifest.contact_labels]):
        raise InputError("a label is no whole number")
    for pair in manifest.contact_pairs:
        if not (isinstance(pair, list) and len(pair) == 2 and pair[0] in manifest.contact_labels
                and pair[1] in manifest.labels):
            raise InputError(f"contact_pairs has {pair!r} where two labels of the mesh belong")
    found = {name: getattr(manifest, name) for name in WORDS} | manifest.effects
    for name, words in (WORDS | EFFECTS).items():
        if name in found and found[name] not in words or name not in (*found, "initial"):
            raise InputError(f"{name} must be one of {', '.join(words)}, not {found.get(name)!r}")
    _check_histories(manifest)
    if manifest.slip_law is not None:
        _check_slip_law(manifest.slip_law)


def _check_histories(manifest: Manifest) -> None:
    for number, history in manifest.amplitudes.items():
        if not _finite(history):
            raise InputError(f"amplitude {number} is not finite at every step")
        if len(history) != manifest.steps + 1:
            raise InputError(f"amplitude {number} has {len(history)} values for {manifest.steps} steps")
    for pattern in manifest.patterns:
        if not isinstance(pattern, dict) or not {"kind", "amplitude"} <= set(pattern):
            raise InputError("a load pattern lacks its kind or amplitude")
        if pattern["kind"] not in PATTERNS:
            raise InputError(f"{pattern['kind']!r} is no kind of load pattern")
        if str(pattern["amplitude"]) not in manifest.amplitudes:
            raise InputError(f"amplitude {pattern['amplitude']} is used but not given")


def _check_slip_law(law: dict) -> None:
    sound = set(law) == {"argument", "range", "values"} and law["argument"] in ("slip", "displacement")
    if not (sound and _finite([law["range"]]) and law["range"] > 0 and _finite(law["values"]) and len(law["values"]) > 1):
        raise InputError("slip_law must have argument, a positive range and finite values")


class _Block:
    """Sequential reader of the counted arrays of one block file."""

    def __init__(self, path: Path, seal: seals.Seal):
        self.path, self.at = path, 0
        content = seals.check(seal, path)
        if len(content) % 8:
            raise InputError(f"{path} is truncated: its size is not a multiple of 8 bytes")
        self.words = content.view(np.int64).view(np.ndarray)  # slices of a memmap cost more than small arrays

    def array(self, count: int, dtype=np.int64, like: np.ndarray | None = None) -> np.ndarray:
        """The next array, which must have `count` entries; float64 ones must be finite.

        If it has the entries of `like`, an array that was read before, that one is returned.
        """
        start = self.at + 1
        if count < 0 or start + count > len(self.words):
            raise InputError(f"{self.path} is truncated: {count} more numbers expected at word {self.at}")
        if self.words[self.at] != count:
            raise InputError(
                f"{self.path}: an array of {count} numbers expected at word {self.at}, found a count of "
                f"{self.words[self.at]}"
            )
        self.at = start + count
        if like is not None and np.array_equal(self.words[start : self.at], like.ravel().view(np.int64)):
            return like
        values = np.array(self.words[start : self.at]).view(dtype)
        if dtype is np.float64 and not np.all(np.isfinite(values)):
            raise InputError(f"{self.path}: a number that is not finite in the array at word {start}")
        return values

    def indices(self, count: int, bound: int, what: str, like: np.ndarray | None = None) -> np.ndarray:
        """The next integer array, with entries in [0, bound), which those of `like` are known to be."""
        values = self.array(count, like=like)
        if count and values is not like and (values.min() < 0 or values.max() >= bound):
            raise InputError(f"{self.path}: {what} out of range in the array ending at word {self.at}")
        return values

    def skip(self, manifest: Manifest) -> None:
        """Move over one record."""
        head = self.array(HEAD)
        self.at += _record_words(head, manifest)


def _record_words(head: np.ndarray, manifest: Manifest) -> int:
    """Words that follow a record's head."""
    _, nv, nt, ne, nd, nnz, patterns, fixed, contact = (int(n) for n in head)
    moving = sum(pattern["kind"] == "displacement" for pattern in manifest.patterns)
    moduli = 2 if manifest.material == "isotropic" else 6
    heated = sum(pattern["kind"] == "thermal" for pattern in manifest.patterns)
    moments = 1 if manifest.element == "P1" else 3
    counted = [nv] * 3 + [elements.NODES[manifest.element] * nt, nt, 3 * ne] + [moments * nt] * (moduli + 3 * heated)
    counted += [nd] * 2 + [nnz] * 3 + [nd] * patterns + [fixed]
    kinds = [pattern["kind"] for pattern in manifest.patterns] if manifest.element == "P1" else []
    counted += [4 * ne] * kinds.count("traction") + [2 * nt] * (3 * kinds.count("body_force"))
    counted += [nv] * (2 * _bowed(manifest)) + [max(1, fixed)] * moving
    counted += [contact] * (7 + manifest.initial_state) if contact else []
    return sum(counted) + len(counted)


def read_subdomains(manifest: Manifest, start: int, stop: int, comm) -> list[Subdomain]:
    """Read subdomains start <= s < stop; collective over `comm`.

    Raises InputError (on all ranks alike) when a block is not what the seal says, or a record is truncated, not
    finite, of the wrong size, out of range, or its stiffness is not symmetric or resists a rigid motion.
    """
    found, error, model = [], None, None
    try:
        for block in range(manifest.blocks):
            first = manifest.subdomains * block // manifest.blocks
            last = manifest.subdomains * (block + 1) // manifest.blocks
            if max(first, start) >= min(last, stop):
                continue
            reader = _Block(manifest.directory / f"block-{block}.bin", manifest.seal)
            for _ in range(first, max(first, start)):
                reader.skip(manifest)
            for index in range(max(first, start), min(last, stop)):
                found.append(_read_record(reader, manifest, index, model))
                if model is None or found[-1].values is not model.values:
                    model = found[-1]
            if last <= stop and reader.at != len(reader.words):
                raise InputError(f"{reader.path} goes on after its last record; run the scene again")
    except InputError as problem:
        error = problem
    agree(comm, error)
    return found


def _read_record(reader: _Block, manifest: Manifest, index: int, model: Subdomain | None) -> Subdomain:
    """The next subdomain, number `index`. It shares mesh and stiffness with `model`, read before, where they are equal.

    What is shared has been checked.
    """
    number, nv, nt, ne, nd, nnz, patterns, fixed, contact = (int(n) for n in reader.array(HEAD))
    where = f"{reader.path}, subdomain {index}"
    if number != index:
        raise InputError(f"{where}: the record belongs to subdomain {number}; blocks were mixed up")
    if patterns != len(manifest.patterns):
        raise InputError(f"{where}: {patterns} load patterns, the manifest has {len(manifest.patterns)}")
    if min(nv, nt, ne, nd, nnz) <= 0 or nd != 2 * nv:
        raise InputError(f"{where}: sizes that make no subdomain ({nv} nodes, {nt} triangles, {nd} dofs)")
    if model is None or (nv, nt) != (len(model.xy), len(model.elements)):
        like = dict.fromkeys(("elements", "rows", "columns", "values"))
    else:
        like = vars(model)
    gid = reader.indices(nv, manifest.nodes, "node number")
    xy = np.column_stack([reader.array(nv, np.float64), reader.array(nv, np.float64)])
    if len(np.unique(gid)) != nv:
        raise InputError(f"{where}: a node number stands twice in the record")
    nodes = reader.indices(elements.NODES[manifest.element] * nt, nv, "triangle node", like["elements"])
    nodes = nodes if nodes is like["elements"] else nodes.reshape(nt, -1)
    triangles = nodes[:, :3]
    a, b = xy[triangles[:, 0]], xy[triangles[:, 1]]
    if np.min(elements.areas(xy[triangles])) <= 0:
        raise InputError(f"{where}: a triangle is flat or turned inside out; the body penetrates itself")
    _check_middles(nodes, xy, where)
    region = reader.array(nt)
    edge = reader.array(3 * ne).reshape(ne, 3)
    at_vertex = np.zeros(nv, bool)
    at_vertex[triangles] = True
    if edge[:, :2].min() < 0 or edge[:, :2].max() >= nv or not at_vertex[edge[:, :2]].all():
        raise InputError(f"{where}: a boundary edge ends at no vertex")
    elasticity, sigma_zz = _read_elasticity(reader, manifest, nt)
    thermal = {k: np.stack([_read_linear(reader, manifest, nt) for _ in range(3)], axis=-1)
               for k, pattern in enumerate(manifest.patterns) if pattern["kind"] == "thermal"}
    dof_node, component = _dof_layout(reader, nd, xy, where)
    rows = reader.indices(nnz, nd, "stiffness row", like["rows"])
    columns = reader.indices(nnz, nd, "stiffness column", like["columns"])
    values = reader.array(nnz, np.float64, like["values"])
    known = rows is like["rows"] and columns is like["columns"] and values is like["values"]
    if not known:
        _check_symmetric(rows, columns, values, nd, where)
    if not (known and _same_shape(xy, model.xy)):
        _check_rigid_motions(rows, columns, values, xy[dof_node], component, where)
    loads = np.array([reader.array(nd, np.float64) for _ in range(patterns)]).reshape(patterns, nd)
    edge_loads, body_loads = {}, {}
    if manifest.element == "P1":
        edge_loads = _read_edge_loads(reader, manifest, ne)
        body_loads = _read_body_loads(reader, manifest, xy[triangles])
        _check_distributed(loads, edge[:, :2], edge_loads, "edges", 1.0, where)
        cancelled = np.abs(xy).max() / np.linalg.norm(b - a, axis=1).min() if body_loads else 0.0
        _check_distributed(loads, triangles, body_loads, "triangles", cancelled, where)
    fixed_dofs = reader.indices(fixed, nd, "fixed dof")
    fixed_values = np.zeros((patterns, fixed))
    for k, pattern in enumerate(manifest.patterns):
        if pattern["kind"] == "displacement":
            fixed_values[k] = reader.array(max(1, fixed), np.float64)[:fixed]
    bow = np.column_stack([reader.array(nv, np.float64) for _ in "xy"]) if _bowed(manifest) else None
    data = _read_contact(reader, manifest, contact, nv, where) if contact else None
    corner_elasticity = elasticity if elasticity.ndim == 4 else None
    if corner_elasticity is not None:
        elasticity = corner_elasticity.mean(axis=1)
    return Subdomain(index, gid, xy, nodes, region, edge[:, :2], edge[:, 2], elasticity, thermal, sigma_zz,
                     dof_node, component,
                     rows, columns, values, loads, edge_loads, body_loads, fixed_dofs, fixed_values, data,
                     corner_elasticity, bow)


def _read_elasticity(reader: _Block, manifest: Manifest, nt: int):
    """Plane elasticity matrices (n_t, 3, 3), of quadratic elements at the corners (n_t, 3, 3, 3), and the factor of the
    out-of-plane stress."""
    if manifest.material == "isotropic":
        lam, mu = _read_linear(reader, manifest, nt), _read_linear(reader, manifest, nt)
        zero = np.zeros_like(lam)
        entries = (lam + 2 * mu, lam, zero, lam + 2 * mu, zero, mu)
        sigma_zz = lam.reshape(nt, -1).mean(axis=1) if manifest.plane == "strain" else None
    else:
        entries = [_read_linear(reader, manifest, nt) for _ in range(6)]
        sigma_zz = None  # general plane laws say nothing of the third direction
    c11, c12, c13, c22, c23, c33 = entries
    return np.stack([c11, c12, c13, c12, c22, c23, c13, c23, c33], axis=-1).reshape(*c11.shape, 3, 3), sigma_zz


def _read_linear(reader: _Block, manifest: Manifest, nt: int) -> np.ndarray:
    """(n_t,) means over the triangles or, with quadratic elements, (n_t, 3) corner values of the nearest linear function."""
    if manifest.element == "P1":
        return reader.array(nt, np.float64)
    return reader.array(3 * nt, np.float64).reshape(nt, 3) @ elements.INVERSE_MASS


def _dof_layout(reader: _Block, nd: int, xy: np.ndarray, where: str):
    """Node and component of every dof.

    FreeFEM numbers the dofs of a vector space node by node; the exported coordinates and components of the dofs
    are compared with that instead of being trusted.
    """
    coordinate = reader.array(nd, np.float64)
    component = np.where(reader.array(nd, np.float64) > 0.5, 0, 1)
    node = np.arange(nd) // 2
    if not np.array_equal(component, np.arange(nd) % 2):
        raise InputError(f"{where}: dofs are not numbered node by node")
    if np.abs(coordinate - xy.ravel()).max() > 1e-12 * np.ptp(xy):
        raise InputError(f"{where}: dof coordinates do not match the nodes")
    return node, component


def _bowed(manifest: Manifest) -> bool:
    """Whether records say how far edges bow: quadratic elements of several bodies."""
    return bool(manifest.contact_pairs) and manifest.element != "P1"


def _check_middles(nodes: np.ndarray, xy: np.ndarray, where: str) -> None:
    """The middles of sides, and centroids, must be where they are said to be."""
    for k in range(3, nodes.shape[1]):
        around = xy[nodes[:, [0, 1, 2] if k == 6 else [(k + 1) % 3, (k + 2) % 3]]]
        if np.abs(xy[nodes[:, k]] - around.mean(axis=1)).max() > 1e-12 * np.ptp(xy):
            raise InputError(f"{where}: the middle of a triangle or of its side is elsewhere")


def _read_edge_loads(reader: _Block, manifest: Manifest, ne: int) -> dict[int, np.ndarray]:
    """Moments of every traction pattern on the boundary edges."""
    return {k: reader.array(4 * ne, np.float64).reshape(ne, 2, 2)
            for k, pattern in enumerate(manifest.patterns) if pattern["kind"] == "traction"}


def _read_body_loads(reader: _Block, manifest: Manifest, corner: np.ndarray) -> dict[int, np.ndarray]:
    """Moments of every body force against the hat functions of the triangles with corners (n_t, 3, 2).

    The export holds the integrals of f, x f and y f; hats are linear in x and y.
    """
    found = {}
    for k, pattern in enumerate(manifest.patterns):
        if pattern["kind"] == "body_force":
            gradient, middle = elements.hat_gradients(corner), corner.mean(axis=1)
            f, fx, fy = (reader.array(2 * len(corner), np.float64).reshape(-1, 2) for _ in range(3))
            slopes = np.stack([fx - middle[:, :1] * f, fy - middle[:, 1:] * f], axis=1)  # [t, direction, component]
            found[k] = f[:, None, :] / 3 + gradient @ slopes
    return found


def _check_distributed(loads, nodes, found: dict, what: str, cancelled: float, where: str) -> None:
    """Moments by edge or triangle must add up to the nodal loads, to rounding times what was `cancelled`."""
    for pattern, moments in found.items():
        if not (moments.any() or loads[pattern].any()):
            continue
        total = np.zeros((loads.shape[1] // 2, 2))
        np.add.at(total, nodes, moments)
        slack = 1e-12 * (1 + cancelled) * np.abs(loads[pattern]).max()
        if np.abs(total.ravel() - loads[pattern]).max() > slack:
            raise InputError(f"{where}: the loads of the {what} do not add up to those of the nodes")


def _same_shape(xy: np.ndarray, other: np.ndarray) -> bool:
    """Whether places (n, 2) are `other`, moved, to the rounding of coordinates."""
    rounding = np.finfo(float).eps * max(np.abs(xy).max(), np.abs(other).max())
    return bool(np.abs((xy - xy[0]) - (other - other[0])).max() <= 4 * rounding)


def _check_symmetric(rows, columns, values, nd, where) -> None:
    entry, mirrored = rows * nd + columns, columns * nd + rows
    forward, backward = np.argsort(entry, kind="stable"), np.argsort(mirrored, kind="stable")
    same = np.array_equal(entry[forward], mirrored[backward])
    # assembled from symmetric element matrices: only the order of additions can differ
    slack = 1e-12 * np.abs(values).max()
    if not same or np.abs(values[forward] - values[backward]).max() > slack:
        raise InputError(f"{where}: the stiffness matrix is not symmetric")


def _check_rigid_motions(rows, columns, values, place, component, where) -> None:
    """The pure Neumann stiffness resists neither translations nor the rotation about the row's own node.

    `place` (dofs, 2) and `component` (dofs,) are those of the dofs. Element matrices are positive semidefinite, so
    the element contributions that were added up to K_ij are at most sqrt(K_ii K_jj) together, and each carries
    some roundings: a row of K times a motion m is zero to 1e-13 of sum_j sqrt(K_ii K_jj) |m_j|, which leaves
    some hundred roundings to the products and sums of assembly and of this check.
    """
    diagonal = np.zeros(len(place))
    on = rows == columns
    diagonal[rows[on]] = values[on]
    if diagonal.min() <= 0:
        raise InputError(f"{where}: a diagonal entry of the stiffness matrix is not positive")
    arm = place[columns] - place[rows]
    x, size = component[columns] == 0, np.sqrt(diagonal[rows] * diagonal[columns])
    for motion in (x.astype(float), 1.0 - x, np.where(x, -arm[:, 1], arm[:, 0])):
        force = np.bincount(rows, values * motion, minlength=len(place))
        if np.any(np.abs(force) > 1e-13 * np.bincount(rows, size * np.abs(motion), minlength=len(place))):
            raise InputError(f"{where}: the stiffness matrix resists a rigid motion; it is not the body's")


def read_contact(directory: Path, manifest: Manifest) -> list[tuple[ContactData, np.ndarray, np.ndarray]]:
    """Contact nodes of one value of a parameter study, piece by piece: data, node numbers and places.

    Raises InputError as `read_subdomains`.
    """
    reader, found = _Block(directory / "contact.bin", manifest.seal), []
    while reader.at < len(reader.words):
        count = int(reader.array(1)[0])
        if count == 0:  # a body without contact nodes
            continue
        label, gid = reader.array(count), reader.indices(count, manifest.nodes, "node number")
        weight, nx, ny, gap, friction, x, y = (reader.array(count, np.float64) for _ in range(7))
        initial = reader.array(count, np.float64) if manifest.initial_state else np.zeros(count)
        data = ContactData(np.arange(count), label, weight, np.column_stack([nx, ny]), gap, friction, initial)
        found.append((data, gid, np.column_stack([x, y])))
    return found


def _read_contact(reader: _Block, manifest: Manifest, count: int, nv: int, where: str) -> ContactData:
    node = reader.indices(count, nv, "contact node")
    label = reader.array(count)
    weight, nx, ny, gap, friction = (reader.array(count, np.float64) for _ in range(5))
    if not np.isin(label, manifest.contact_labels).all():
        raise InputError(f"{where}: a contact node has a label that the scene does not declare for contact")
    if weight.min() <= 0:
        raise InputError(f"{where}: a contact node has no length of boundary")
    if friction.min() < 0:
        raise InputError(f"{where}: a contact node has a negative friction coefficient or bound")
    initial = reader.array(count, np.float64) if manifest.initial_state else np.zeros(count)
    return ContactData(node, label, weight, np.column_stack([nx, ny]), gap, friction, initial)
