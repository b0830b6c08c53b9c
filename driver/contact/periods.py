"""Pairs whose bodies repeat themselves meet beyond their ends, too.

What periodic boundaries (joints.py) declare once goes on for ever: a body that begins elsewhere
than the other one, or slides along it, meets the other's image, moved by a whole number of periods.
Images have the displacements of what they are images of.

Where contact goes on across a periodic side both ends of its boundary are one place, whose
displacements the joint makes equal: one of them has the condition of both, on what either faces,
and the boundary goes on from it to the node that follows the other one. Conditions of their own
would each be on half of what there is around the place. A node of a pair whose boundary does not
go on has none: the next node's multiplier takes its part over, as beside supports (held.py).
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError
from .joints import CONGRUENT, Edges, translation
from .nodes import TURN
from .side import Side

ASKEW = 0.01  # sine of the angle from which on two directions are two


@dataclass(frozen=True)
class Periods:
    """The `gids` (k,) of nodes on periodic sides, `same` (m, 2) those of two in one place, and the
    `ways` (d, 2), d = 1 or 2, by which bodies in pairs repeat themselves; without pairs d = 0.
    """

    gids: np.ndarray
    same: np.ndarray
    ways: np.ndarray

    @classmethod
    def of(cls, joints: list, edges: Edges, manifest) -> "Periods | None":
        """Those of the periodic ones of `joints`, whose sides have the `edges`; None without any.

        Raises InputError for bodies with different periods in one direction.
        """
        joints = [joint for joint in joints if joint.periodic]
        if not joints:
            return None
        ways, same = np.zeros((0, 2)), []
        for joint in joints:
            one, two = edges.of(joint.first), edges.of(joint.second)
            way = translation(joint, one, two, manifest.axisymmetric)
            same.append(_in_one_place(one, two, way))
            if manifest.contact_pairs and _is_new(way, ways):
                ways = np.vstack([ways, way])
        gids = np.unique(np.concatenate([edges.of(label).gid.ravel() for joint in joints
                                         for label in (joint.first, joint.second)]))
        return cls(gids, np.concatenate(same), ways)

    def same_of(self, gids: np.ndarray, pairs: np.ndarray | None = None) -> np.ndarray:
        """(k, 2) which of the nodes `gids` (n,) are in one place; of all these or of some `pairs`.
        """
        pairs, order = self.same if pairs is None else pairs, np.argsort(gids, kind="stable")
        pairs = pairs[np.isin(pairs, gids).all(axis=1)]
        return order[np.searchsorted(gids, pairs, sorter=order)]

    def ends(self, nodes, fixed: np.ndarray) -> "Ends":
        """The Ends of the contact `nodes` of nodes.py; `fixed` are keys 2 gid + component that
        supports hold.

        At corners, where a vertex has several nodes, none are in one place. Of two that are the
        second has the condition of both. Each has its own if a support holds one, if they meet
        different bodies, and where they are the two sides of a corner.
        """
        gid, first, count = np.unique(nodes.gid, return_index=True, return_counts=True)
        gid, first = gid[count == 1], first[count == 1]
        met, held = first[self.same_of(gid)], np.isin(nodes.gid, fixed // 2)
        one, two = met.T
        alike = (nodes.normal[one] * nodes.normal[two]).sum(axis=1) >= TURN
        alike &= (nodes.family[one] == nodes.family[two]) & ~held[met].any(axis=1)
        heir = np.arange(len(nodes.gid))
        heir[one[alike]] = two[alike]
        whole = np.bincount(heir, nodes.weight, len(heir))[heir]
        share = np.divide(nodes.weight, whole, out=np.ones(len(heir)), where=whole > 0)
        return Ends(met, heir, share)

    def having_conditions(self, gids: np.ndarray, known: np.ndarray) -> np.ndarray:
        """(n,) `gids` of contact nodes; of two in one place that of the one whose condition is that
        of both, which alone is `known`.
        """
        one, two = self.same[np.isin(self.same, known) @ [2, 1] == 1].T
        of = dict(zip(one.tolist(), two.tolist()))
        return np.array([of.get(gid, gid) for gid in gids.tolist()], gids.dtype)

    def offsets(self, near: np.ndarray, place: np.ndarray) -> np.ndarray:
        """(m, 2) by which images of places (k, 2) are moved that come beside `near` (n, 2).

        The first is zero: the places themselves.
        """
        basis = np.linalg.pinv(self.ways)
        here, there = near @ basis, place @ basis
        lowest = np.ceil(here.min(axis=0) - there.max(axis=0) - CONGRUENT).astype(int)
        highest = np.floor(here.max(axis=0) - there.min(axis=0) + CONGRUENT).astype(int)
        numbers = product(*(range(low, high + 1) for low, high in zip(lowest, highest)))
        return np.array([[0.0, 0.0], *(np.array(k) @ self.ways for k in numbers if any(k))])

    def repeated(self, side: Side, near: np.ndarray) -> tuple[Side, int]:
        """A side with its images beside the places `near` (n, 2), and how often it is there.

        Image k has nodes and edges of the side, in their order, k times their number on.
        """
        moves, n = self.offsets(near, side.xy), len(side.xy)
        count = len(moves)
        edges = np.concatenate([side.edges + k * n for k in range(count)])
        copied = {name: None if value is None else np.concatenate([value] * count)
                  for name, value in vars(side).items() if name not in ("xy", "edges")}
        place = (moves[:, None] + side.xy).reshape(-1, 2)
        return replace(side, xy=place, edges=edges, **copied), count

    def with_images(self, edges: np.ndarray, place: np.ndarray, moved: np.ndarray,
                    near: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Edges (e, 2) with their images beside `near` (n, 2): edges, places and displacements.

        `place`, `moved` (k, 2) of all nodes; those of images follow them.
        """
        moves, count = self.offsets(near, place[edges].reshape(-1, 2)), len(place)
        return (np.concatenate([edges + k * count for k in range(len(moves))]),
                (moves[:, None] + place).reshape(-1, 2), np.tile(moved, (len(moves), 1)))


@dataclass(frozen=True)
class Ends:
    """Contact nodes that periods make one place, `met` (k, 2), and what has the condition of both:
    node `heir` (n,) has that of each. What are means counts by the nodes' `share` (n,) of its
    weight.
    """

    met: np.ndarray
    heir: np.ndarray
    share: np.ndarray

    def sums(self, of: np.ndarray) -> np.ndarray:
        """(n,) sums over what is one condition, zero for nodes that have none."""
        return np.bincount(self.heir, of, len(of))

    def means(self, of: np.ndarray) -> np.ndarray:
        """(n,) the same of means; nodes that have no condition keep their own."""
        own = self.heir == np.arange(len(of))
        return np.where(own, np.bincount(self.heir, self.share * of, len(of)), of)

    def normals(self, normal: np.ndarray) -> np.ndarray:
        """(n, 2) unit means of normals."""
        mean = np.column_stack([self.means(of) for of in normal.T])
        return mean / np.linalg.norm(mean, axis=1)[:, None]

    def seams(self, along, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (k, 2) of contact nodes that follow one another across a period, and lengths (k,).

        `along` are the Chains. Of an end that has no condition, is not `used` (n,), the next node
        in its chain counts. Where both have one the boundary ends, as at a corner.
        """
        pairs, lengths = [], []
        for ends in self.met:
            found = []
            for end in ends:
                own = np.flatnonzero(used & (along.number == along.number[end]))
                away = np.abs(along.arc[own] - along.arc[end])
                found += [(own[away.argmin()], away.min())] * bool(len(own))
            length = sum(away for _, away in found)
            if len(found) == 2 and length > 0 and found[0][0] != found[1][0]:
                pairs.append([node for node, _ in found])
                lengths.append(length)
        return np.array(pairs, int).reshape(-1, 2), np.array(lengths)


def _in_one_place(one: Edges, two: Edges, way: np.ndarray) -> np.ndarray:
    """(k, 2) gids of nodes of two sides that lie on one another, where `way` takes the second."""
    (gids, place, _), (others, there, _) = one.nodes, two.nodes
    away, nearest = cKDTree(there + way).query(place)
    here = away <= CONGRUENT * one.lengths.sum()
    return np.column_stack([gids[here], others[nearest[here]]])


def _is_new(way: np.ndarray, ways: np.ndarray) -> bool:
    """Whether a period is none of `ways` (d, 2). Raises InputError where it cannot be beside them.
    """
    size = np.linalg.norm(way)
    apart = [min(np.linalg.norm(way - other), np.linalg.norm(way + other)) for other in ways]
    if min(apart, default=np.inf) <= CONGRUENT * size:
        return False
    askew = [abs(np.linalg.det([way, other])) > ASKEW * size * np.linalg.norm(other)
             for other in ways]
    if len(ways) == 2 or not all(askew):
        raise InputError(
            f"bodies in contact repeat themselves by ({way[0]:.6g}, {way[1]:.6g}) and by "
            f"({ways[0, 0]:.6g}, {ways[0, 1]:.6g}): give them one period, as by more waves")
    return True
