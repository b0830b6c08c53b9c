"""Numbers of corner dofs and rows of B, globally and in every local subdomain.

Rows are numbered by the subdomain that owns them (the lowest one that has the node), each rank's by
itself. Every rank knows supports, contact nodes, the outline and the corners as a whole, and of all
else what meets its own subdomains.
"""

from dataclasses import fields

import numpy as np

from ..scene.loader import Subdomain
from .corners import corner_vertices
from .gathering import gather, largest, lookup
from .rigid_modes import all_springs, rigid_modes
from .row_stiffness import left_alone, row_scale, seen_stiffness, shares
from .rows import LocalRows, RowKind
from .structure import ContactTable, Substructure
from .supports import free_along, free_keys
from .travel import separated


def number(manifest, subdomains, first, skeleton, fixed, contact, comm, frictional,
           compliance=None) -> Substructure:
    """Number coarse dofs and dual rows, and express both in the subdomains' dofs; collective.

    `fixed` as `fixed_dofs` returns it, `contact` the ContactBoundary, which gets its row numbers,
    `frictional` whether its nodes have tangential rows, `compliance` (n_c,) what they yield per
    nodal force in the normal direction, None where they are rigid.
    """
    springs = all_springs(manifest, subdomains, comm)
    fixed, travel = separated(skeleton, subdomains, fixed, springs.subdomain, comm,
                              manifest.axisymmetric)
    corner_keys, gluing = _torn(skeleton, fixed[0], comm)
    share, counted = shares(skeleton, contact)
    own = _OwnRows(skeleton, gluing, *_contact_rows(skeleton, contact, fixed[0], frictional,
                                                    range(first, first + len(subdomains))),
                   contact, comm)
    seen, stiffness = (seen_stiffness(skeleton, own.gid[own.order], own.kind[own.order],
                                      own.with_contact(of_node, 1.0))
                       for of_node in (share, counted))
    scale = row_scale(seen, float(largest(comm, np.array([seen.max(initial=0.0)]))[0]))
    numbering = _Numbering(skeleton, corner_keys, fixed, own.glued(skeleton), contact, share)
    local = numbering.localize(subdomains)
    if contact.following is not None:
        contact.following.settle(contact)
    modes, at_corners = rigid_modes(skeleton, travel.bodies, fixed[0], corner_keys, springs,
                                    manifest.axisymmetric)
    edges, middles = skeleton.outline
    return Substructure(subdomains, first, manifest.subdomains, *local,
                        coarse_dofs=len(corner_keys), dual_dofs=own.total,
                        row_kind=own.kind[own.order], row_scale=scale, row_stiffness=stiffness,
                        at_contact=own.table(scale, compliance, comm),
                        yields=compliance is not None, row_range=own.range,
                        row_starts=own.starts(first + np.arange(len(subdomains))),
                        patterns=len(manifest.patterns), travel=travel,
                        contact=contact, rigid_modes=modes, rigid_corners=at_corners,
                        with_hats=_with_hats(skeleton, contact, share, counted, comm),
                        outer_edges=edges, outer_middles=middles,
                        primal_dofs=comm.allreduce(sum(sub.dofs for sub in subdomains)),
                        numbering=None if contact.following is None else numbering)


def _torn(skeleton, fixed_keys, comm) -> tuple[np.ndarray, np.ndarray]:
    """Keys 2 gid + component of corner dofs, all of them, and of the gluing rows of the rank."""
    is_corner = np.isin(skeleton.gids, corner_vertices(skeleton))
    corner_keys = np.sort(gather(comm, free_keys(
        skeleton.gids[is_corner & skeleton.owned], fixed_keys)))
    plain = (skeleton.count == 2) & ~is_corner & skeleton.owned
    return corner_keys, free_keys(skeleton.gids[plain], fixed_keys)


def _contact_rows(skeleton, contact, fixed_keys, frictional: bool,
                  subdomains: range) -> tuple[np.ndarray, np.ndarray]:
    """Positions of contact nodes of the rank's `subdomains` with normal and tangential rows."""
    normal, tangential = free_along(contact.gid, contact.normal, fixed_keys), np.empty(0, np.int64)
    owner = skeleton.at(contact.gid, skeleton.owner)
    normal = np.flatnonzero(normal & (owner >= subdomains.start) & (owner < subdomains.stop))
    # where the support fixes the normal direction there is no contact pressure to rub under
    if frictional:
        tangential = normal[_slides(contact, fixed_keys)[normal]]
    return normal, tangential


def _with_hats(skeleton, contact, share, counted, comm) -> np.ndarray:
    """Global numbers of contact nodes on edges cut unevenly, or whose stiffness is another's."""
    uneven = gather(comm, np.intersect1d(skeleton.uneven_gids, contact.gid))
    return np.union1d(uneven, contact.gid[left_alone(share, counted)])


class _OwnRows:
    """The rows that a rank owns: gluing rows, then normal, then tangential ones. Collective.

    They are numbered by owner, kind and position. `kind`, `gid` and `number` (n,) are those of the
    rows, `order` (n,) sorts them by number, `range` are the first of the rank's numbers and the
    first beyond them, `total` counts those of all ranks.
    """

    def __init__(self, skeleton, gluing, normal, tangential, contact, comm):
        """`gluing` keys, and positions of contact nodes; `contact` gets their numbers."""
        self._gluing, self._normal, self._tangential = gluing, normal, tangential
        self.kind = np.repeat([RowKind.GLUING, RowKind.NORMAL, RowKind.TANGENTIAL],
                              [len(gluing), len(normal), len(tangential)])
        n_g, contact_end = len(gluing), len(gluing) + len(normal)
        self.kind[n_g:contact_end][contact.is_joint[normal]] = RowKind.JOINED
        self.gid = np.concatenate([gluing // 2, contact.gid[normal], contact.gid[tangential]])
        self._node = np.searchsorted(skeleton.gids, self.gid)
        self._owner = skeleton.owner[self._node]
        position = np.concatenate([gluing, normal, tangential])
        self.order = np.lexsort((position, self.kind, self._owner))
        counts = comm.allgather(len(self.order))
        begin, self.total = sum(counts[: comm.rank]), sum(counts)
        self.range = begin, begin + len(self.order)
        self.number = np.empty(len(self.order), np.int64)
        self.number[self.order] = begin + np.arange(len(self.order))
        contact.normal_row[normal] = self.number[n_g:contact_end]
        contact.tangential_row[tangential] = self.number[contact_end:]
        contact.normal_row, contact.tangential_row = (
            largest(comm, rows) for rows in (contact.normal_row, contact.tangential_row))

    def with_contact(self, of_node: np.ndarray, gluing: float) -> np.ndarray:
        """(n,) values by number: those (n_c,) of contact nodes, and one of all gluing rows."""
        return np.concatenate([np.full(len(self._gluing), gluing), of_node[self._normal],
                               of_node[self._tangential]])[self.order]

    def glued(self, skeleton) -> np.ndarray:
        """(nodes, 2) numbers of gluing rows at nodes of the skeleton; -1 where there is none."""
        numbers = np.full((len(skeleton.gids), 2), -1)
        n_g = len(self._gluing)
        numbers[self._node[:n_g], self._gluing % 2] = self.number[:n_g]
        return skeleton.over_ranks(np.maximum, numbers)

    def starts(self, subdomains: np.ndarray) -> np.ndarray:
        """(s,) how many of the rank's rows belong to subdomains before each of these."""
        return np.searchsorted(self._owner[self.order], subdomains)

    def table(self, scale: np.ndarray, compliance: np.ndarray | None, comm) -> ContactTable:
        """Contact rows of all ranks; `scale` (n,) by number, `compliance` (n_c,) of their nodes."""
        yielding, kind = np.zeros(len(self.order)), self.kind[self.order]
        if compliance is not None:
            n_g = len(self._gluing)
            rows = self.number[n_g : n_g + len(self._normal)] - self.range[0]
            yielding[rows] = compliance[self._normal]
        touching = kind != RowKind.GLUING
        return ContactTable(*(gather(comm, of[touching]) for of in (
            np.arange(*self.range), kind, scale, yielding)))


def _slides(contact, fixed_keys) -> np.ndarray:
    """True for the contact nodes that can slide along the boundary while they touch.

    A guided node, with one component held on a rigid obstacle or on a line of symmetry of two
    bodies, has one displacement: where what it meets stops it, it stands. Its friction would be a
    second force along that displacement, and only the sum of the two is determined: all of it is
    taken for contact's.
    """
    stands = contact.guided & free_along(contact.gid, contact.normal, fixed_keys)
    return free_along(contact.gid, contact.tangent, fixed_keys) & ~stands & ~contact.is_joint


def _widen(array: np.ndarray, width: int) -> np.ndarray:
    """(m, width): `array` with columns of zeros added, if any."""
    if array.shape[1] == width:
        return array
    return np.column_stack([array, np.zeros((len(array), width - array.shape[1]), array.dtype)])


class _Numbering:
    """Global numbers at the nodes of the skeleton, and those of the rank's subdomains."""

    def __init__(self, skeleton, corner_keys, fixed, gluing, contact, share):
        self.skeleton, self.fixed, self.contact = skeleton, fixed, contact
        self.coupled = contact.coupled
        self.share = share  # of the stiffness of both sides in the contact node's own
        # number, or -1, of every component at every node of the skeleton
        self.corner, self.gluing = self._at_nodes(corner_keys), gluing
        self.held = self._at_nodes(fixed[0])
        # of (vertex, subdomain) pairs: how many lower, stiffer subdomains share the vertex
        self._span = skeleton.total
        order, start = skeleton.by_vertex, np.cumsum(skeleton.count) - skeleton.count
        self.pairs = skeleton.nodes[order, 1] * self._span + skeleton.nodes[order, 0]
        self.place = np.arange(len(order)) - np.repeat(start, skeleton.count)
        self.shared_stiffness = skeleton.over_subdomains(np.add, skeleton.stiffness)
        self.place_of = np.empty_like(order)
        self.place_of[order] = self.place
        self.may_touch = contact.term_gid
        if contact.following is not None:
            self.may_touch = np.union1d(contact.following.gids, contact.term_gid)
        self.at_contact = np.isin(skeleton.gids, self.may_touch)
        here = np.flatnonzero(self.at_contact[skeleton.node_id[order]])
        stiffer = np.lexsort((-skeleton.stiffness[order[here]], self.pairs[here] // self._span))
        self.rank = np.zeros(len(order), np.int64)
        self.rank[here[stiffer]] = self.place[here]

    def _at_nodes(self, keys: np.ndarray) -> np.ndarray:
        """(nodes, 2) places in the sorted `keys` of the keys 2 gid + component; -1 if not there."""
        place, known = lookup(keys, 2 * self.skeleton.gids[:, None] + [0, 1])
        return np.where(known, place, -1)

    def localize(self, subdomains: list[Subdomain]):
        """Lists of fixed dofs and values, corner dofs and numbers, and rows of all subdomains."""
        skeleton = self.skeleton
        node_id = skeleton.node_id[skeleton.own]
        dof = 2 * skeleton.local[:, None] + [0, 1]  # numbered node by node, see loader
        corner, corner_at = self._present(self.corner[node_id])
        held, held_at = self._present(self.held[node_id])
        corner_dof, corner_number, held_dof = dof[corner], self.corner[node_id][corner], dof[held]
        fixed = [self._fixed(sub, held_dof[part]) for sub, part in zip(subdomains, held_at)]
        rows = self._gluing_rows(node_id, dof)
        touching = np.add.reduceat(np.append(self.at_contact[node_id], 0), skeleton.starts[:-1])
        self.glued = {s: (rows[s], fixed[s][0]) for s in np.flatnonzero(touching).tolist()}
        for s in self.glued:
            rows[s] = self._with_contact(rows[s], subdomains[s], fixed[s][0])
        return ([dofs for dofs, _ in fixed], [values for _, values in fixed],
                [corner_dof[part] for part in corner_at],
                [corner_number[part] for part in corner_at], rows)

    def renewed(self, contact, subdomains: list[Subdomain]) -> dict[int, LocalRows]:
        """Rows of the local subdomains that may touch, with the rows of another `contact`."""
        self.contact, self.coupled = contact, contact.coupled
        return {s: self._with_contact(rows, subdomains[s], fixed)
                for s, (rows, fixed) in self.glued.items()}

    def _present(self, numbers: np.ndarray):
        """Where (nodes, 2) the rank's `numbers` are any, and every subdomain's slice of them."""
        present = numbers >= 0
        ends = np.append(0, np.cumsum(present.sum(axis=1)))[self.skeleton.starts].tolist()
        return present, [slice(a, b) for a, b in zip(ends, ends[1:])]

    def _fixed(self, sub: Subdomain, at_boundary: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Dirichlet dofs of a subdomain and their values (patterns, n_fixed).

        Supports are on boundaries: `at_boundary`, at nodes of the skeleton, are all of them.
        """
        if not len(at_boundary):
            return at_boundary, self.fixed[1][:0].T
        dofs = np.sort(at_boundary)
        place, _ = lookup(self.fixed[0], 2 * sub.node_gid[dofs // 2] + dofs % 2)
        return dofs, self.fixed[1][place].T

    def _gluing_rows(self, node_id: np.ndarray, dof: np.ndarray) -> list[LocalRows]:
        """Gluing rows of the rank's subdomains, in the order of their dofs."""
        skeleton = self.skeleton
        glued, parts = self._present(self.gluing[node_id])
        sign = np.where(self.place_of[skeleton.own] == 0, 1.0, -1.0)
        other = 1.0 - skeleton.stiffness[skeleton.own] / self.shared_stiffness[node_id]
        each, _ = np.nonzero(glued)
        row, sign, scaling = self.gluing[node_id][glued], sign[each], (other * sign)[each]
        dof = np.repeat(dof[glued][:, None], 2, axis=1)
        coefficient = np.zeros(dof.shape)
        coefficient[:, 0] = 1.0
        nothing = np.zeros_like(coefficient)
        return [LocalRows(row[p], sign[p], dof[p], coefficient[p], nothing[p], scaling[p])
                for p in parts]

    def _with_contact(self, glued: LocalRows, sub, fixed) -> LocalRows:
        """The gluing rows of a subdomain followed by its contact rows."""
        held = np.zeros(sub.dofs, bool)
        held[fixed] = True
        pieces = [tuple(getattr(glued, field.name) for field in fields(glued))]
        order, coupled = np.argsort(sub.node_gid), self.coupled.any()
        place, inside = lookup(sub.node_gid[order], self.contact.gid)
        nodes = np.flatnonzero(inside & ~self.coupled)
        vertex = order[place[nodes]]
        for direction, rows in ((self.contact.normal, self.contact.normal_row),
                                (self.contact.tangent, self.contact.tangential_row)):
            acts = rows[nodes] >= 0
            pieces.append(self._contact_rows(sub, held, direction, rows, nodes[acts],
                                             vertex[acts]))
            if coupled:
                pieces.append(self._pair_rows(sub, held, direction, rows, order))
        width = max(piece[2].shape[1] for piece in pieces)
        pieces = [(row, sign, *(_widen(array, width) for array in (dof, *parts)), scaling)
                  for row, sign, dof, *parts, scaling in pieces]
        return LocalRows(*(np.concatenate(column) for column in zip(*pieces)))

    def _contact_rows(self, sub, held, direction, rows, here, vertex):
        """Rows of the contact nodes `here`, at `vertex` of `sub`, that meet a rigid obstacle."""
        dof = 2 * vertex[:, None] + [0, 1]  # numbered vertex by vertex, see loader
        free = ~held[dof]
        # the product takes a shared node's row from its owner, the preconditioner halves it between
        # the two stiffest subdomains: sums of at most two terms do not depend on their order
        pair = self._pair(self.contact.gid[here], sub.index)
        sign = np.where(self.place[pair] == 0, 1.0, 0.0)
        node = np.searchsorted(self.skeleton.gids, self.contact.gid[here])
        alone = self.skeleton.count[node] == 1
        scaling = np.where(alone, 1.0, np.where(self.rank[pair] < 2, 0.5, 0.0))
        return rows[here], sign, dof, direction[here] * free, direction[here] * ~free, scaling

    def _pair(self, gid: np.ndarray, subdomain: int) -> np.ndarray:
        """Positions in `pairs` of vertices on the boundary of `subdomain`."""
        return lookup(self.pairs, gid * self._span + subdomain)[0]

    def _pair_rows(self, sub, held, direction, rows, order):
        """Rows between two bodies, or of several nodes: terms at vertices that this subdomain owns.

        `order` sorts the subdomain's vertices by gid. The preconditioner knows a row by the
        stiffness of the side with the contact nodes alone, as the other side's rows depend on one
        another where its mesh is coarser, and weighs it with what both have in series.
        """
        c = self.contact
        position, inside = lookup(sub.node_gid[order], c.term_gid)
        mine = np.flatnonzero(inside & self.coupled[c.term_node] & (rows[c.term_node] >= 0))
        mine = mine[self.place[self._pair(c.term_gid[mine], sub.index)] == 0]
        mine = mine[np.argsort(c.term_node[mine], kind="stable")]
        here, start, count = np.unique(c.term_node[mine], return_index=True, return_counts=True)
        slot = np.arange(len(mine)) - np.repeat(start, count)  # a term's place in its row
        place = (np.repeat(np.arange(len(here)), count), slot)
        vertex, value, own = np.zeros((3, len(here), count.max(initial=1)))
        vertex[place], value[place] = order[position[mine]], c.term_value[mine]
        own[place] = ~c.term_other[mine]
        shape = (len(here), 2 * vertex.shape[1])
        dof = (2 * vertex.astype(np.int64)[:, :, None] + [0, 1]).reshape(shape)
        coefficient = (value[:, :, None] * direction[here][:, None, :]).reshape(shape)
        free = ~held[dof]
        scaling = (own * value).sum(axis=1) * np.sqrt(self.share[here])  # adds up to the root
        return rows[here], np.ones(len(here)), dof, coefficient * free, coefficient * ~free, scaling
