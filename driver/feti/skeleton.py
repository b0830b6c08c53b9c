"""The torn body's skeleton: boundary edges and nodes of subdomains, and what couples them.

A rank has those of its own subdomains, beside them the copies that others have of the same nodes
and edges. What is derived at a node goes over its copies in the order of subdomains, so that
nothing depends on how these are distributed over ranks.
"""

from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..errors import InputError, agree
from ..scene.elements import cross
from ..scene.loader import Subdomain
from ..scene.manifest import Manifest
from .edges import edge_labels, split_edges
from .exchange import Copies, components, exchange
from .gathering import gather, joined, largest, lookup


THIN = 4.0  # longest side squared over twice the area: 1 to 1.2 for regular triangles
JUMP = 10.0  # of the stiffness around a node
ROUNDED = 1e-9  # of a ratio: no rounding decides
# stiffness against change of area over that against shear, 1/(1 - 2 nu); products grow with its
# root and are three times those for nu = 0.3 there
BULK = 100.0


class Skeleton:
    """Boundary edges and nodes of the rank's subdomains, and what others have of the same.

    `nodes` are those of the rank's subdomains and their copies in all others, in the order of
    subdomains; `edges` likewise, with the other side of interfaces. `own` is the slice of `nodes`
    that belongs to the rank's subdomains, `own_edges` that of `edges`, `starts` where each of them
    starts in `own` (and the end), `local` the numbers of these nodes in their subdomains.
    Collective over `comm`.
    """

    def __init__(self, manifest: Manifest, subdomains: list[Subdomain], comm):
        pieces, self.comm, self.total = _Pieces(subdomains), comm, manifest.subdomains
        self._quadratic = manifest.element != "P1"
        self._copies = Copies(comm, pieces.nodes[:, 1], manifest.nodes)
        self.own = slice(self._copies.below, self._copies.below + len(pieces.nodes))
        self.nodes, self.xy, self.stiffness, self.uneven, self.bulky = map(self.spread, (
            pieces.nodes,  # subdomain, gid
            pieces.xy, pieces.stiffness,
            pieces.uneven, pieces.bulky))  # of every node, see Outline
        self._edges_of(pieces, manifest.nodes)
        self.local, self.starts = pieces.local, pieces.starts
        self.interface_label = manifest.interface_label
        key = self.edges[:, 1] * manifest.nodes + self.edges[:, 2]
        _, self.edge_id, self.edge_count = np.unique(key, return_inverse=True, return_counts=True)
        self.shared = self.edge_count[self.edge_id] == 2
        # the nodes vertex by vertex, those of a vertex in the order of subdomains
        self.by_vertex = np.argsort(self.nodes[:, 1], kind="stable")
        gid = self.nodes[self.by_vertex, 1]
        self._vertex_starts = np.flatnonzero(np.diff(gid, prepend=-1))
        self.gids = gid[self._vertex_starts]
        self.count = np.diff(np.append(self._vertex_starts, len(gid)))
        self.node_id = np.empty(len(gid), np.int64)
        self.node_id[self.by_vertex] = np.repeat(np.arange(len(self.gids)), self.count)
        lowest = self.by_vertex[self._vertex_starts]
        self.owner = self.nodes[lowest, 0]  # of every one of `gids` the lowest subdomain
        self.owned = (lowest >= self.own.start) & (lowest < self.own.stop)  # it is the rank's

    def _edges_of(self, pieces: "_Pieces", span: int) -> None:
        """`edges`: subdomain, gid, gid, label; `middles` of them, empty with linear elements.

        `component` of an edge in its subdomain, see Outline; numbered in every subdomain.
        """
        middles = pieces.middles if self._quadratic else np.full(len(pieces.edges), -1)
        table = np.column_stack([pieces.edges, pieces.component, middles])
        edges, below = table, 0
        if self.comm.size > 1:
            to, row = self._ranks_of(pieces, span)
            source, others = exchange(self.comm, to, table[row])
            known = np.isin(others[:, 1] * span + others[:, 2], table[:, 1] * span + table[:, 2])
            source, others = source[known], others[known]
            lower = source < self.comm.rank
            edges, below = np.concatenate([others[lower], table, others[~lower]]), int(lower.sum())
        self.own_edges = slice(below, below + len(table))
        self.edges, self.component = edges[:, :4], edges[:, 4]
        self.middles = edges[:, 5] if self._quadratic else np.empty(0, np.int64)

    def _ranks_of(self, pieces: "_Pieces", span: int) -> tuple[np.ndarray, np.ndarray]:
        """Ranks (n,) that have both ends of some of the rank's edges, and these edges (n,)."""
        gid = pieces.nodes[self._copies.entries, 1]
        met = np.unique(self._copies.to * span + gid)
        rank, gid = np.divmod(met, span)
        order = np.lexsort((rank, gid))
        rank, gid = rank[order], gid[order]
        low, high = (np.searchsorted(gid, pieces.edges[:, 1], side) for side in ("left", "right"))
        count = high - low
        row = np.repeat(np.arange(len(count)), count)
        to = rank[np.repeat(low - np.cumsum(count) + count, count) + np.arange(count.sum())]
        both = np.isin(to * span + pieces.edges[row, 2], met)
        return to[both], row[both]

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values of `nodes` from those (n, ...) of the rank's own ones; collective."""
        return self._copies.spread(values)

    def over_subdomains(self, operation: np.ufunc, values: np.ndarray) -> np.ndarray:
        """Minimum, maximum or sum of nodal `values` over the subdomains of each of `gids`."""
        if not len(self.gids):
            return values
        return operation.reduceat(values[self.by_vertex], self._vertex_starts)

    def over_ranks(self, operation: np.ufunc, values: np.ndarray) -> np.ndarray:
        """Minimum or maximum of what the ranks know at `gids`, (gids, ...) each; collective."""
        if self.comm.size == 1:
            return values
        return self.over_subdomains(operation, self.spread(values[self.node_id[self.own]]))

    def at(self, gids: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(n,) values at vertices that are the same on every rank, from those at `gids`.

        Numbers from 0 on, that do not depend on the rank; collective.
        """
        place, known = lookup(self.gids, gids)
        found = np.full(len(gids), -1, values.dtype)
        found[known] = values[place[known]]
        return largest(self.comm, found)

    def labelled(self, label: int) -> np.ndarray:
        """(n, 2) or (n, 3) gids of both ends, and the middle, of the edges with a label."""
        here = np.flatnonzero(self.edges[self.own_edges, 3] == label) + self.own_edges.start
        gids = self.edges[here, 1:3]
        if self._quadratic:  # also of a rank without edges
            gids = np.column_stack([gids, self.middles[here]])
        return np.unique(gather(self.comm, gids), axis=0)

    def are_middles(self, gids: np.ndarray) -> np.ndarray:
        """(n,) whether vertices, the same on every rank, are middles of edges; collective."""
        return largest(self.comm, np.isin(gids, self.middles).astype(np.int64)) > 0

    @cached_property
    def outline(self) -> tuple[np.ndarray, np.ndarray]:
        """Gid, gid, label (n, 3) of the untorn body's edges, and gids of their middles, if any.

        Collective.
        """
        outer = self._outer()
        middles = self.middles[outer] if len(self.middles) else self.middles
        return gather(self.comm, self.edges[outer, 1:]), gather(self.comm, middles)

    def _outer(self) -> np.ndarray:
        """Those of the rank's own edges that have no other side."""
        start = self.own_edges.start
        return np.flatnonzero(~self.shared[self.own_edges]) + start

    @cached_property
    def uneven_gids(self) -> np.ndarray:
        """Those of `gids` whose neighbours hold them unevenly in some subdomain."""
        return self.gids[self.over_subdomains(np.logical_or, self.uneven)]

    @cached_property
    def bulky_gids(self) -> np.ndarray:
        """Those of `gids` that nearly incompressible material of some subdomain has."""
        return self.gids[self.over_subdomains(np.logical_or, self.bulky)]

    @cached_property
    def place(self) -> np.ndarray:
        """(nodes, 2) places of `gids`."""
        place = np.empty((len(self.gids), 2))
        place[self.node_id] = self.xy
        return place

    def check_conformity(self) -> None:
        """Every interface edge must have exactly two sides, with vertices at the same places."""
        lonely = (~self.shared) & (self.edges[:, 3] == self.interface_label)
        wrong = (lonely | (self.edge_count[self.edge_id] > 2))[self.own_edges]
        error = None
        if wrong.any():
            bad = self.edges[self.own_edges][np.flatnonzero(wrong)[0]]
            error = InputError(f"the meshes do not conform along an interface of subdomain "
                               f"{bad[0]}: an edge has no match on the other side; export all "
                               "subdomains from one mesh")
        agree(self.comm, error)
        low, high = (self.over_subdomains(extreme, self.xy) for extreme in (np.minimum, np.maximum))
        apart = np.abs(high - low).max(axis=1, initial=0.0)
        ends = np.array([self.xy, -self.xy]).max(axis=1, initial=-np.inf)
        size = largest(self.comm, ends).sum(axis=0).max()
        if apart.max(initial=0.0) > 1e-10 * size:
            place = self.xy[self.node_id == apart.argmax()][0]
            error = InputError("the meshes do not conform along an interface: a shared node near "
                               f"({place[0]:g}, {place[1]:g}) has different coordinates in its "
                               "subdomains")
        agree(self.comm, error)

    def check_connected(self) -> None:
        """Refuse bodies parts of which share vertices only, as such parts hinge on one another."""
        width = 1 + int(largest(self.comm, np.array([self.component.max(initial=0)]))[0])
        component = self.edges[:, 0] * width + self.component
        part = components(self.comm, component, self.edge_id, self.total * width)[component]
        ends = np.searchsorted(self.gids, self.edges[self.own_edges, 1:3])
        low, high = np.full(len(self.gids), np.iinfo(np.int64).max), np.full(len(self.gids), -1)
        for end in ends.T:
            np.minimum.at(low, end, part[self.own_edges])
            np.maximum.at(high, end, part[self.own_edges])
        low, high = self.over_ranks(np.minimum, low), self.over_ranks(np.maximum, high)
        hinge = np.flatnonzero((low < high) & (high >= 0))
        mine = [(self.gids[k], *self.place[k]) for k in hinge[:1]]
        found = [place for part in self.comm.allgather(mine) for place in part]
        if found:
            _, x, y = min(found)
            raise InputError(f"parts of a body share no edge but only the vertex at ({x:g}, {y:g}),"
                             " on which they hinge: connect them by edges, or give each by "
                             "addBody(mesh)")

    def check_overlap(self, paired: np.ndarray) -> None:
        """Refuse an outline that crosses itself, but not where pairs `paired` fit only roughly.

        The ranks share the work.
        """
        outer = self._outer()
        outer = outer[~np.isin(self.edges[outer, 3], paired)]
        ends = self.place[np.searchsorted(self.gids, self.edges[outer, 1:3])]
        p, q = gather(self.comm, ends).swapaxes(0, 1)
        low, high = np.minimum(p, q), np.maximum(p, q)
        order = np.argsort(low[:, 0])
        last = np.searchsorted(low[order, 0], high[order, 0], side="right")  # start before
        crossed = len(order)
        for i in range(self.comm.rank, len(order), self.comm.size):
            here, other = order[i], order[i + 1 : last[i]]
            other = other[(low[other, 1] < high[here, 1]) & (high[other, 1] > low[here, 1])]
            if len(other) and _crosses(p[here], q[here], p[other], q[other]).any():
                crossed = i
                break
        crossed = -int(largest(self.comm, np.array([-crossed]))[0])
        if crossed < len(order):
            middle = (p[order[crossed]] + q[order[crossed]]) / 2
            raise InputError("a body penetrates itself or another one: outlines cross near "
                             f"({middle[0]:g}, {middle[1]:g})")

    @cached_property
    def neighbour(self) -> np.ndarray:
        """For every boundary edge the subdomain on its other side, or -1."""
        other = np.full(len(self.edges), -1)
        one, two = self._sides.T
        other[one], other[two] = self.edges[two, 0], self.edges[one, 0]
        return other

    @cached_property
    def _sides(self) -> np.ndarray:
        """(n, 2) the two of `edges` that every shared edge is."""
        order = np.argsort(self.edge_id, kind="stable")
        return order[self.shared[order]].reshape(-1, 2)


class _Pieces:
    """What the rank's subdomains have of the skeleton, one after the other; see Skeleton.

    Nodes count from the first one of all these subdomains here.
    """

    def __init__(self, subdomains: list[Subdomain]):
        known = {}  # outlines by mesh, which subdomains of the same shape share
        outlines = [known.get(id(sub.elements)) or known.setdefault(id(sub.elements), Outline(sub))
                    for sub in subdomains]
        first = np.cumsum([0, *(len(sub.node_gid) for sub in subdomains)])

        def shifted(arrays, *width: int) -> np.ndarray:
            """The subdomains' node numbers, counted on from one subdomain to the next."""
            return joined((n + start for n, start in zip(arrays, first)), np.int64, *width)

        def subdomain(arrays) -> np.ndarray:
            """The subdomain that each entry of `arrays` belongs to."""
            index = [sub.index for sub in subdomains]
            return np.repeat(index, [len(array) for array in arrays]).astype(np.int64)

        gid = joined([sub.node_gid for sub in subdomains], np.int64)
        edges = [outline.edges for outline in outlines]
        nodes = [outline.nodes for outline in outlines]
        ends, boundary = shifted(edges, 2), shifted(nodes)
        labelled = shifted((sub.edges for sub in subdomains), 2)
        labels = joined([sub.edge_label for sub in subdomains], np.int64)
        label = edge_labels(labelled, labels, ends)
        self.edges = np.column_stack([subdomain(edges), np.sort(gid[ends], axis=1), label])
        self.component = joined((outline.component for outline in outlines), np.int64)
        self.nodes = np.column_stack([subdomain(nodes), gid[boundary]])
        self.xy = joined((sub.xy for sub in subdomains), float, 2)[boundary]
        self.middles = gid[shifted(outline.middles for outline in outlines)]
        self.local = joined(nodes, np.int64)
        self.starts = np.cumsum([0, *(len(own) for own in nodes)])
        keys = [(id(sub.elements), id(sub.elasticity)) for sub in subdomains]
        known = {}  # by mesh and material
        for key, outline, sub in zip(keys, outlines, subdomains):
            if key not in known:
                known[key] = outline.stiffness(sub)
        stiffness = joined((known[key] for key in keys), float)
        # means over triangles differ by rounding: nine digits make equals equal
        mantissa, exponent = np.frexp(stiffness)
        self.stiffness = np.ldexp(np.round(mantissa * 2.0**30) / 2.0**30, exponent)
        kinds = {}  # subdomains that share their stiffness are as uneven as one another
        for outline, sub in zip(outlines, subdomains):
            if id(sub.stiffness) not in kinds:
                kinds[id(sub.stiffness)] = outline.uneven(sub), outline.bulky(sub)
        self.uneven, self.bulky = (
            joined((kinds[id(sub.stiffness)][k] for sub in subdomains), bool) for k in (0, 1))


class Outline:
    """The boundary of a subdomain in its own numbering: edges (n, 2), nodes (m,), edge middles.

    `component` (n,) numbers the components of the subdomain at its edges: triangles that edges
    connect. Subdomains with the same `elements` have the same outline.
    """

    def __init__(self, sub: Subdomain):
        self.edges, triangle, inner = split_edges(sub.triangles)
        count = len(sub.triangles)
        graph = coo_matrix((np.ones(len(inner)), inner.T), shape=(count, count))
        self.component = connected_components(graph, directed=False)[1][triangle]
        self.middles = sub.middles(self.edges)
        self.nodes = np.union1d(self.edges, self.middles)
        order = np.argsort(sub.elements, axis=None, kind="stable")
        node = sub.elements.ravel()[order]
        order = order[np.isin(node, self.nodes)]
        self._triangle = order // sub.elements.shape[1]
        self._first = np.searchsorted(sub.elements.ravel()[order], self.nodes)

    def stiffness(self, sub: Subdomain) -> np.ndarray:
        """(m,) stiffness at the nodes: trace of Hooke's law in the stiffest triangle there."""
        trace = np.einsum("tii->t", sub.elasticity)
        return np.maximum.reduceat(trace[self._triangle], self._first)

    def uneven(self, sub: Subdomain) -> np.ndarray:
        """(m,) whether a node's neighbours hold it much more firmly in some way than in another.

        Where a triangle there is thin, resists one kind of shear more than JUMP times as much as
        another, or where the stiffness varies by more than JUMP over the triangles there and within
        them.
        """
        triangles, place = np.unique(self._triangle, return_inverse=True)
        p, q, r = sub.xy[sub.triangles[triangles]].swapaxes(0, 1)
        longest = np.max([((b - a) ** 2).sum(axis=1) for a, b in ((p, q), (q, r), (r, p))], axis=0)
        thin = longest > THIN * np.abs(cross(q - p, r - p))
        C = sub.elasticity[:, None] if sub.corner_elasticity is None else sub.corner_elasticity
        trace = np.einsum("tcii->tc", C[triangles])
        high = np.maximum.reduceat(trace.max(axis=1)[place], self._first)
        low = np.minimum.reduceat(trace.min(axis=1)[place], self._first)
        directed = _shear_ratio(sub.elasticity[triangles]) > JUMP
        return np.logical_or.reduceat((thin | directed)[place], self._first) | (high > JUMP * low)

    def bulky(self, sub: Subdomain) -> np.ndarray:
        """(m,) whether a triangle at the node resists change of area BULK times as much as shear.

        By the traces of Hooke's law on both: nu above 0.495 in plane strain.
        """
        C = sub.elasticity
        area = (C[:, 0, 0] + C[:, 1, 1]) / 2 + C[:, 0, 1]
        shear = (C[:, 0, 0] + C[:, 1, 1]) / 2 - C[:, 0, 1] + 2 * C[:, 2, 2]
        bulky = area > (1 + ROUNDED) * BULK * shear / 2
        return np.logical_or.reduceat(bulky[self._triangle], self._first)


def _shear_ratio(C: np.ndarray) -> np.ndarray:
    """(n,) ratio of the two moduli that Hooke's laws C (n, 3, 3) have for shear; isotropic: 1.

    They are the eigenvalues of C for strains (e, -e, 2 g), at right angles to a change of area.
    """
    plain, mixed = (C[:, 0, 0] + C[:, 1, 1] - 2 * C[:, 0, 1]) / 4, (C[:, 0, 2] - C[:, 1, 2]) / 2
    middle, half = (plain + C[:, 2, 2]) / 2, np.hypot((plain - C[:, 2, 2]) / 2, mixed)
    return (middle + half) / np.maximum(middle - half, np.finfo(float).eps * middle)


def _crosses(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether the segment p-q has an inner point in common with the inside of each segment a-b."""
    # touching ends do not count; a side's rounding is about eps times the edge's square
    slack = 1e-12 * np.maximum(((q - p) ** 2).sum(), ((b - a) ** 2).sum(axis=1))

    def apart(start, stop, first, second):
        """Whether two points lie on different sides of the line through start and stop."""
        a, b = cross(stop - start, first - start), cross(stop - start, second - start)
        return (a > slack) & (b < -slack) | (a < -slack) & (b > slack)

    return apart(p, q, a, b) & apart(a, b, p, q)
