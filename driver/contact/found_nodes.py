"""Contact nodes as the subdomains give them, and the contact boundary that is made of them."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..feti.gathering import gather
from ..feti.supports import held_nodes
from .boundary import ClampedContact, ContactBoundary, HeldInPairs
from .chains import chains
from .nodes import contact_table, merge_parts


@dataclass
class Measured:
    """What contact nodes have before they meet another body: `weight`, `length` and `gap` (n,),
    `normal` (n, 2) and `columns` (n,) each.

    `rows`: node, node and coefficient of the conditions on normal displacements that are the
    nodes' own. `heir` (n,): gids of the nodes whose conditions they have across a period, None
    where nothing repeats itself.
    """

    weight: np.ndarray
    length: np.ndarray
    gap: np.ndarray
    normal: np.ndarray
    columns: dict[str, np.ndarray]
    rows: tuple[np.ndarray, np.ndarray, np.ndarray]
    heir: np.ndarray | None
    covered: np.ndarray | None = None  # (n,) part of the weight, where contact follows the motion


@dataclass
class Meeting:
    """The k contact nodes of a boundary that meets another one."""

    gid: np.ndarray  # (k,)
    # (k, 2) how they face: two at a corner are a condition each, the first boundary's normals and
    # multipliers being those of one of its flanks
    facing: np.ndarray
    corner: np.ndarray  # (k,) there is another condition, on this boundary or another one
    rubs: np.ndarray  # (k,) with friction
    heir: np.ndarray | None  # (k,) as of Measured


def contact_boundary(manifest, effects, subdomains, skeleton, fixed, comm, sides=None,
                     periods=None) -> ContactBoundary:
    """Contact nodes of all subdomains, the parts of a node's dual segment added up.

    `effects` are those of the scene, `sides` the boundaries that meet in pairs (pair_sides.py),
    None without pairs, `periods` the Periods, None where nothing repeats itself. Raises InputError
    for contact on a label without nodes.
    """
    parts = [np.empty((0, 7 + len(manifest.columns)))]
    for sub in subdomains:
        if sub.contact is not None:
            gid, xy = sub.node_gid[sub.contact.node], sub.xy[sub.contact.node]
            parts.append(contact_table(sub.contact, manifest.columns, gid, xy))
    nodes = merge_parts(gather(comm, np.concatenate(parts)), manifest.columns,
                        manifest.contact_pairs, effects.one_node_a_vertex,
                        bool(manifest.curved), effects.obstacle_normals)
    known = {label for label, _ in nodes.members}
    missing = [wanted for wanted in manifest.contact_labels if wanted not in known]
    if missing:
        raise InputError(f"no contact node has the label {missing[0]}: the scene declares contact "
                         "on a label that its mesh lacks")
    ends = periods and periods.ends(nodes, fixed[0])  # what the periods make one place
    found = FoundNodes(nodes, chains(nodes, skeleton), fixed,
                       skeleton.are_middles(nodes.gid), manifest.axisymmetric,
                       bool(manifest.curved), ends,
                       rubbing(effects, nodes) if nodes.meeting else None)
    gap = effects.distance(nodes.columns, len(nodes.gid))
    motion = effects.motion(nodes, gap)
    following = effects.following(nodes, motion)
    if following is None:
        boundary = found.boundary(gap, motion, sides)
    else:
        boundary = following.first(found, gap, sides)
    return boundary if periods is None else replace(boundary, periods=periods)


def rubbing(effects, nodes) -> np.ndarray:
    """(n,) to which of the `nodes` the laws of friction give a bound, under whatever pressure.

    They are asked before there is a ContactBoundary: for columns, weight and place.
    """
    alike = replace(nodes, weight=np.ones(len(nodes.gid)))  # on the axis of a revolution as well
    rubs = np.zeros(len(nodes.gid), bool)
    for room in effects:
        for law in (room.friction_coefficient(alike), room.friction_offset(alike)):
            if law is not None:
                rubs |= law != 0
    return rubs


@dataclass
class FoundNodes:
    """The n nodes of all contact labels, of which boundaries are made; `middles` (n,) of edges.

    `fixed` as `fixed_dofs` of feti returns it, `along` the Chains.
    """

    nodes: object
    along: object
    fixed: tuple[np.ndarray, np.ndarray]
    middles: np.ndarray
    axisymmetric: bool
    curved: bool = False  # sides of elements, see nodes.merge_parts
    ends: object = None  # the Ends of periods.py; None: nothing repeats itself
    rubs: np.ndarray | None = None  # (n,) which have friction; None: no node has

    @property
    def paired(self) -> np.ndarray:
        """(n,) which meet another body."""
        return self.nodes.family > 0

    def boundary(self, gap: np.ndarray, motion, sides, following=None,
                 normal: np.ndarray | None = None) -> ContactBoundary:
        """The boundary with gaps (n,) and the ObstacleMotion, if any, of the nodes.

        With `following` nodes of pairs that face nothing stay, idle, and all have the weights that
        they have on boundaries that are faced as a whole; `normal` (n, 2) are those on obstacles.
        """
        of = self._measured(gap, motion, normal)
        row, other, value = of.rows
        rigid, whole, full = ~self.paired[row], of.weight.copy(), of.length.copy()
        guided, lost, terms, behind = self._coupled(of, motion, sides, following)
        if following is not None:
            if following.lost is None:
                following.lost = lost
            whole, of.length = (self.along.handed_on(each, following.lost)
                                for each in (whole, full))
            of.covered = np.divide(of.weight, whole, out=np.zeros(len(whole)), where=whole > 0)
            rigid = rigid | (of.covered[row] <= 0)
            of.weight = whole
        own = row, self.nodes.gid[other], value, np.zeros(len(row), bool)
        terms.insert(0, tuple(column[rigid] for column in own))
        terms = [np.concatenate(column) for column in zip(*terms)]
        return replace(self._assembled(of, motion, guided, terms), about=sides and sides.about,
                       following=following, held=self._held(of.normal, behind))

    def _measured(self, gap: np.ndarray, motion, normal: np.ndarray | None) -> Measured:
        """See Measured; `motion` gets the gaps of the conditions. Arguments as of `boundary`."""
        nodes, n = self.nodes, len(self.nodes.gid)
        rows = np.arange(n), np.arange(n), np.ones(n)
        weight, length = nodes.weight.copy(), nodes.length.copy()
        normal = (nodes.normal if normal is None else normal).copy()
        if self.axisymmetric:
            from . import rings  # here: no plane scene needs it

            weight, rows = rings.ring_rows(nodes.xy, self.along.edges, self.along.middles)
            row, other, value = rows
            if self.curved:  # the export's weights are those of rings
                weight = np.where(weight > 0, nodes.weight, 0.0)
            gap = np.bincount(row, value * gap[other], n)
            if motion is not None:
                motion.gap = np.array([np.bincount(row, value * g[other], n) for g in motion.gap])
        columns, ends, heir = nodes.columns, self.ends, None
        if ends is not None:
            weight, length, heir = ends.sums(weight), ends.sums(length), nodes.gid[ends.heir]
            gap, normal = ends.means(gap), ends.normals(normal)
            columns = {name: ends.means(of) for name, of in columns.items()}
            if motion is not None:
                motion.gap = np.array([ends.means(g) for g in motion.gap])
        return Measured(weight, length, gap, normal, columns, rows, heir)

    def _coupled(self, of: Measured, motion, sides, following) -> tuple:
        """Which nodes are guided and which have no condition (n,) each, and the terms of the jump,
        a tuple a boundary, by contact nodes (see pair_sides.Coupled), and likewise what nodes that
        supports hold are behind of; `of` and `motion` become what pairs have. Arguments as of
        `boundary`.
        """
        nodes, n = self.nodes, len(self.nodes.gid)
        _, vertex, count = np.unique(nodes.gid[self.paired], return_inverse=True,
                                     return_counts=True)
        rubs = np.zeros(n, bool) if self.rubs is None else self.rubs
        guided, terms, behind = np.isin(nodes.gid, self.fixed[0] // 2), [], []
        twin, lost = np.zeros((2, n), bool)
        twin[self.paired] = count[vertex] > 1
        for k, pairs in enumerate(nodes.meeting):
            here = np.flatnonzero(nodes.family == k + 1)
            without = None if following is None or following.lost is None else following.lost[here]
            meeting = Meeting(nodes.gid[here], nodes.normal[here], twin[here], rubs[here],
                              None if of.heir is None else of.heir[here])
            found = sides.couple(pairs, meeting, following and following.reach, without)
            of.weight[here], of.length[here], of.normal[here] = (found.weight, found.length,
                                                                 found.normal)
            guided[here], lost[here] = found.guided, found.lost
            if found.behind is not None:
                node, *term, away = found.behind
                behind.append((here[node], *term, here, of.gap[here] + away))
            of.gap[here] += found.gap
            if motion is not None:
                motion.gap[:, here] = of.gap[here]
            node, *term = found.terms
            terms.append((here[node], *term))
        return guided, lost, terms, behind

    def _held(self, normal: np.ndarray, behind: list) -> HeldInPairs | None:
        """The nodes of pairs that supports hold along their `normal` (n, 2), as of `_coupled`."""
        if not behind:
            return None
        node, gid, value, here, away = (np.concatenate(column) for column in zip(*behind))
        nodes, own = self.nodes, here[~np.isnan(away)]
        met = [[two for one, two in nodes.meeting[nodes.family[k] - 1] if one == nodes.label[k]]
               for k in own]
        other = [labels[0] if len(labels) == 1 else -1 for labels in met]
        position = np.full(len(nodes.gid), -1)
        position[own] = np.arange(len(own))
        return HeldInPairs(nodes.label[own], np.array(other, int), nodes.xy[own], normal[own],
                           away[~np.isnan(away)], position[node], gid, value)

    def _assembled(self, of: Measured, motion, guided: np.ndarray, terms: list):
        """The boundary of the nodes that are used, in the order along the outline."""
        nodes, along, fixed, paired = self.nodes, self.along, self.fixed, self.paired
        held = held_nodes(nodes.gid, fixed[0])
        clamped, unused = np.flatnonzero(held & ~paired), held | (of.weight <= 0)
        order = along.order[~unused[along.order]]
        position = np.full(len(nodes.gid), -1)
        position[order] = np.arange(len(order))
        position[clamped] = len(order) + np.arange(len(clamped))
        node, gids, value, other = terms
        used = ~unused[node]
        terms = position[node[used]], gids[used], value[used], other[used]
        gap = of.gap if motion is None else motion.gap[0]
        values = fixed[1][np.searchsorted(fixed[0], 2 * nodes.gid[clamped][:, None] + [0, 1])]
        clamped = ClampedContact(
            *(each[clamped] for each in (nodes.gid, nodes.label, nodes.xy, of.normal, gap)), values,
            motion and motion.of(clamped))
        none = np.full(len(order), -1)
        edges = position[along.edges[~paired[along.edges].any(axis=1)]]
        seams = ContactBoundary.seams
        if self.ends is not None:
            pairs, lengths = self.ends.seams(along, ~unused)
            seams = position[pairs], lengths
        return ContactBoundary(
            *(each[order] for each in (nodes.gid, nodes.label, along.number, nodes.xy, along.arc,
                                       of.weight, of.length, of.normal)),
            {name: column[order] for name, column in of.columns.items()}, gap[order],
            nodes.family[order], nodes.meeting, self.middles[order], *terms,
            guided[order], none, none.copy(), edges[(edges >= 0).all(axis=1)], clamped,
            axisymmetric=self.axisymmetric, motion=motion and motion.of(order), seams=seams,
            covered=None if of.covered is None else of.covered[order])
