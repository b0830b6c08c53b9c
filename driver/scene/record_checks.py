"""What FreeFEM, or a scene, did wrong: checks of the records of an export, many at once.

Arrays have the records along their first axis. A record that is not sound is refused with its name
and the reason.
"""

import numpy as np

from ..errors import InputError
from ..vectors import turned_left
from . import elements
from .manifest import Manifest
from .records import Head

ENTRIES = 1 << 20  # of stiffnesses that are looked at together
ROUNDING = 1e-13  # relative, of sums of the stiffness
FEW_DIGITS = 64 * np.finfo(float).eps  # the same, for every size of an element from the origin


class Place:
    """Where records come from, to say which of them is refused."""

    def __init__(self, path, first: int | None = None):
        """`first` is the number of the first subdomain, None where records are of none."""
        self.path, self.first = path, first

    def refuse(self, bad: np.ndarray, what: str) -> None:
        """Raises InputError for the first record with anything true in `bad`, (records, ...)."""
        if np.any(bad):
            bad = np.asarray(bad)
            record = int(np.argmax(bad.reshape(len(bad), -1).any(axis=1)))
            which = "" if self.first is None else f", subdomain {self.first + record}"
            raise InputError(f"{self.path}{which}: {what}")


def check_head(head: Head, manifest: Manifest, place: Place) -> None:
    """Sizes, before anything is read by them."""
    if head.patterns != len(manifest.patterns):
        place.refuse([True], f"{head.patterns} load patterns, "
                             f"the manifest has {len(manifest.patterns)}")
    check_sizes(head, place)


def check_sizes(head: Head, place: Place) -> None:
    """Sizes of a mesh and its stiffness."""
    sound = min(head.nodes, head.triangles, head.edges) > 0 and head.dofs == 2 * head.nodes
    if not sound or min(head.entries, head.fixed, head.contact) < 0:
        place.refuse([True], f"sizes that make no subdomain ({head.nodes} nodes, "
                             f"{head.triangles} triangles, {head.dofs} dofs)")


def check_numbers(numbers: np.ndarray, place: Place) -> None:
    """Records (n,) follow one another."""
    wrong = numbers != place.first + np.arange(len(numbers))
    if wrong.any():
        place.refuse(wrong, f"the record belongs to subdomain {numbers[np.argmax(wrong)]}; "
                            "blocks were mixed up")


def check_indices(values: np.ndarray, bound: int, what: str, place: Place) -> None:
    """Integers (n, count) are in [0, bound)."""
    if values.size and (values.min() < 0 or values.max() >= bound):
        place.refuse((values.min(axis=1) < 0) | (values.max(axis=1) >= bound),
                     f"{what} out of range")


def check_distinct(gid: np.ndarray, place: Place) -> None:
    """No node number stands twice."""
    ordered = np.sort(gid, axis=1)
    place.refuse(ordered[:, 1:] == ordered[:, :-1], "a node number stands twice in the record")


def at_nodes(values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """(n, ..., m): `values` (n, n_v, m) at `nodes` (n, ...), or (1, ...): the same for all."""
    start = len(values[0]) * np.arange(len(values)).reshape(-1, *[1] * (nodes.ndim - 1))
    return values.reshape(-1, values.shape[-1])[start + nodes]


def check_mesh(xy: np.ndarray, nodes: np.ndarray, place: Place, curved: bool = False) -> None:
    """Triangles are not turned; middles of sides, and centroids, are where they belong.

    Where sides are `curved` middles within a record are, and all triangles have positive Jacobians.
    Far from the origin coordinates have few digits for a triangle, and so have means of them.
    """
    corner = at_nodes(xy, nodes[..., :3])
    turned = elements.areas(corner.reshape(-1, 3, 2)).reshape(len(xy), -1) <= 0
    if curved:
        whole = at_nodes(xy, nodes[..., :6]).reshape(-1, 6, 2)
        sound = (elements.jacobians(whole, elements.NODE_PLACES) > 0).all(axis=1)
        turned |= ~sound.reshape(len(xy), -1)
    place.refuse(turned, "a triangle is flat or turned inside out; the body penetrates itself")
    allowed = np.maximum(1e-12 * np.ptp(xy, axis=(1, 2)),
                         FEW_DIGITS * np.abs(xy).max(axis=(1, 2)))
    for k in range(3, nodes.shape[-1]):
        around = corner[:, :, [0, 1, 2] if k == 6 else [(k + 1) % 3, (k + 2) % 3]].mean(axis=2)
        off = np.abs(at_nodes(xy, nodes[..., k]) - around).max(axis=2)
        if curved:
            off = np.where(_inner(nodes, k, len(xy[0])), off, 0.0)
        off = off.max(axis=1)
        place.refuse(off > allowed, "the middle of a triangle or of its side is elsewhere")


def _inner(nodes: np.ndarray, k: int, count: int) -> np.ndarray:
    """(n, n_t) whether node k of the triangles belongs to the side of another one as well.

    There are `count` nodes in a record; no centroid counts.
    """
    sides = nodes[..., 3:6] + count * np.arange(len(nodes))[:, None, None]
    shared = np.bincount(sides.ravel(), minlength=count * len(nodes)) > 1
    return shared[sides[..., k - 3]] if k < 6 else np.zeros(nodes.shape[:2], bool)


def check_edges(edges: np.ndarray, nodes: np.ndarray, count: int, place: Place) -> None:
    """Boundary edges (n, n_e, 2) join vertices of the triangles; there are `count` nodes."""
    what, start = "a boundary edge ends at no vertex", count * np.arange(len(nodes))[:, None, None]
    place.refuse((edges < 0) | (edges >= count), what)
    at_vertex = np.zeros(len(nodes) * count, bool)
    at_vertex[start + nodes[..., :3]] = True
    place.refuse(~at_vertex[start + edges], what)


def check_dofs(coordinate: np.ndarray, is_x: np.ndarray, xy: np.ndarray, place: Place) -> None:
    """FreeFEM numbers the dofs of a vector space node by node, x before y.

    The exported coordinates and components of the dofs are compared with that instead of being
    trusted.
    """
    place.refuse((is_x > 0.5) != (np.arange(is_x.shape[1]) % 2 == 0),
                 "dofs are not numbered node by node")
    off = np.abs(coordinate - xy.reshape(len(xy), -1)).max(axis=1)
    place.refuse(off > 1e-12 * np.ptp(xy, axis=(1, 2)), "dof coordinates do not match the nodes")


def same_shape(xy: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n,) whether places (n, n_v, 2) are `other`, (n, n_v, 2) or (1, n_v, 2), moved.

    They may differ by the rounding of coordinates.
    """
    largest = np.maximum(np.abs(xy).max(axis=(1, 2)), np.abs(other).max(axis=(1, 2)))
    off = np.abs((xy - xy[:, :1]) - (other - other[:, :1])).max(axis=(1, 2))
    return off <= 4 * (np.finfo(float).eps * largest)


def check_order(rows: list[np.ndarray], columns: list[np.ndarray], place: Place) -> None:
    """The stored entries (entries,) of every stiffness come row by row, none twice."""
    known = ordered = None
    bad = np.zeros(len(rows), bool)
    for record, pattern in enumerate(zip(rows, columns)):
        if known is None or pattern[0] is not known[0] or pattern[1] is not known[1]:
            (i, j), known = pattern, pattern
            ordered = ((i[1:] > i[:-1]) | (i[1:] == i[:-1]) & (j[1:] > j[:-1])).all()
        bad[record] = not ordered
    place.refuse(bad, "the entries of the stiffness matrix are not in order")


def check_symmetric(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, record: int,
                    records: int, place: Place) -> None:
    """The stiffness of one of so many `records`, by its entries (entries,), is symmetric.

    Where its lower triangle alone was given there is nothing to compare.
    """
    if not (columns > rows).any():
        return
    # short integers are sorted without comparisons
    keys = columns.astype(np.uint16) if columns.max() < 1 << 16 else columns
    mirror = np.argsort(keys, kind="stable")
    # assembled from symmetric element matrices: only the order of additions can differ
    off = np.abs(values - values[mirror]).max() > 1e-12 * np.abs(values).max()
    if off or (rows != columns[mirror]).any() or (columns != rows[mirror]).any():
        place.refuse(np.arange(records) == record, "the stiffness matrix is not symmetric")


def check_rigid_motions(pieces: list[dict], xy: np.ndarray, which: list[int],
                        place: Place, axisymmetric: bool) -> None:
    """The pure Neumann stiffness of the pieces `which` resists no rigid motion.

    These are translations and rotations about a row's own node, of a body of revolution the
    translation along y alone. Element matrices are positive
    semidefinite, so the element contributions that were added up to K_ij are at most
    sqrt(K_ii K_jj) together, and each carries some roundings: a row of K times a motion m is zero
    to 1e-13 of sum_j sqrt(K_ii K_jj) |m_j|, which allows some hundred roundings for the products
    and sums of assembly and of this check.
    """
    bad_diagonal, resists = np.zeros((2, len(pieces)), bool)
    together = max(1, ENTRIES // max((len(pieces[record]["stiffness"].values) for record in which),
                                      default=1))
    for start in range(0, len(which), together):
        records = which[start : start + together]
        bad_diagonal[records], resists[records] = _stiff_motions(
            [pieces[record] for record in records], xy[records], axisymmetric)
    place.refuse(bad_diagonal, "a diagonal entry of the stiffness matrix is not positive")
    place.refuse(resists, "the stiffness matrix resists a rigid motion; it is not the body's")


def _stiff_motions(pieces: list[dict], xy: np.ndarray,
                   axisymmetric: bool) -> tuple[np.ndarray, np.ndarray]:
    """Of every piece whether its diagonal is not positive, and whether it resists a rigid motion.

    The pieces are looked at as one matrix. Far from the origin their coordinates have few digits
    for a triangle, and so has the stiffness.
    """
    dofs, span = xy[0].size, np.ptp(xy, axis=1)
    element = np.sqrt(span.prod(axis=1) / len(xy[0]))
    far = np.abs(xy).max(axis=(1, 2)) / np.where(element > 0, element, np.inf)
    rounding = np.repeat(np.maximum(ROUNDING, FEW_DIGITS * far), dofs)
    entries = [piece["stiffness"].entries() for piece in pieces]
    rows, columns, values = map(_joined, zip(*entries))
    if len(pieces) > 1:
        start = np.repeat(dofs * np.arange(len(pieces)), [len(own[0]) for own in entries])
        rows, columns = rows + start, columns + start
    diagonal = _joined([piece["stiffness"].diagonal() for piece in pieces])
    root, along_y = np.sqrt(np.abs(diagonal)), columns & 1
    size = root[columns]
    # translations along x and y meet the columns of one component each
    entry = 2 * rows + along_y
    force, bound = (np.bincount(entry, what, minlength=2 * len(diagonal)).reshape(-1, 2)
                    for what in (values, size))
    of_piece, excess = (len(pieces), dofs), np.abs(force) > (rounding * root)[:, None] * bound
    if axisymmetric:
        return ((diagonal <= 0).reshape(of_piece).any(axis=1),
                excess[:, 1].reshape(of_piece).any(axis=1))
    resists = excess.any(axis=1)
    # rotations about the origin less that of the row's own node
    turn = turned_left(xy).ravel()
    turned = turn[columns] - turn[rows - (rows & 1) + along_y]
    force, bound = (np.bincount(rows, what, minlength=len(diagonal))
                    for what in (values * turned, size * np.abs(turned)))
    resists |= np.abs(force) > rounding * root * bound
    return (diagonal <= 0).reshape(of_piece).any(axis=1), resists.reshape(of_piece).any(axis=1)


def _joined(arrays: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(arrays) if len(arrays) > 1 else arrays[0]


def check_distributed(loads: np.ndarray, nodes: np.ndarray, moments: np.ndarray, what: str,
                      cancelled, place: Place) -> None:
    """Moments (n, m, k, 2) by edge or triangle add up to the nodal loads (n, dofs).

    `nodes` (n or 1, m, k) are those of the edges or triangles. Rounding is allowed, times what was
    `cancelled`, a number or (n,).
    """
    records, dofs = loads.shape
    start = (dofs // 2 * np.arange(records))[:, None, None]
    row = (np.broadcast_to(nodes, moments.shape[:3]) + start).ravel()
    total = np.column_stack([np.bincount(row, moments[..., c].ravel(), records * dofs // 2)
                             for c in (0, 1)])
    slack = 1e-12 * (1 + cancelled) * np.abs(loads).max(axis=1)
    place.refuse(np.abs(total.reshape(loads.shape) - loads).max(axis=1) > slack,
                 f"the loads of the {what} do not add up to those of the nodes")


def check_contact(label: np.ndarray, weight: np.ndarray, labels: list, place: Place) -> None:
    """Contact nodes (n, n_c) have a label out of `labels` and a length."""
    place.refuse(~np.isin(label, labels),
                 "a contact node has a label that the scene does not declare for contact")
    place.refuse(weight <= 0, "a contact node has no length of boundary")


def check_not_negative(values: np.ndarray, name: str, place: Place) -> None:
    """No contact node has a negative number in `values` (n, n_c), the column `name`."""
    place.refuse(values < 0, f"a contact node has a negative {name}")
