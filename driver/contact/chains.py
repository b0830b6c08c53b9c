"""Chains of contact nodes: in which order they follow one another along the boundary.

Labels that go on in one another, at a vertex where they share a node, make one chain of edges with
one arc length, so that what is done along it (contact length, peaks, slowly varying tractions) does
not end where a label does. At a corner, whose two nodes are two conditions, a chain ends.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .nodes import Nodes


@dataclass
class Chains:
    """Places of the n contact nodes along the boundary, and its edges.

    `arc` (n,) runs on from piece to piece of labels that belong together. `number` (n,) of the
    chain: pieces without corners share one, each piece that ends at a corner has its own.
    `order` (n,) sorts by number, within a chain as its pieces follow. `edges` (e, 2): the nodes at
    the ends of the edges, `middles` (e,) those in between, none with linear elements.
    """

    arc: np.ndarray
    number: np.ndarray
    order: np.ndarray
    edges: np.ndarray
    middles: np.ndarray

    def handed_on(self, amount: np.ndarray, lost: np.ndarray) -> np.ndarray:
        """(n,) amounts where those of `lost` nodes (n,) have gone to the next ones on their edges.

        In equal parts: the middle of an edge, or its other end.
        """
        if not lost.any():
            return amount
        one, two = np.vstack([self.edges, self.edges[:, ::-1]]).T
        heir = np.tile(self.middles, 2) if len(self.middles) else two
        here = lost[one]
        one, heir = one[here], heir[here]
        count = np.bincount(one, minlength=len(amount))
        moved = np.bincount(heir, amount[one] / count[one], len(amount))
        return np.where(lost & (count > 0), 0.0, amount + moved)


def chains(nodes: Nodes, skeleton) -> Chains:
    """The chains of all contact labels; `skeleton` of the torn body has their edges.

    A piece starts at its end with the smaller x (then y), a closed one at its node with the
    smallest gid. Raises InputError where an edge ends at no contact node.
    """
    labels = sorted({label for label, _ in nodes.members})
    links, ends, middles = [[] for _ in nodes.gid], [], []
    for label in labels:
        for a, b, *middle in _edges(nodes, skeleton, label):
            ends.append((a, b))
            middles += middle
            for p, q in zip((a, *middle), (*middle, b)):
                links[p].append(q)
                links[q].append(p)
    _, vertex, count = np.unique(nodes.gid, return_inverse=True, return_counts=True)
    _, side, shared = np.unique(np.column_stack([nodes.family, nodes.gid]), axis=0,
                                return_inverse=True, return_counts=True)
    corner = (count[vertex] > 1) & (nodes.family == 0) | (shared[side] > 1)
    arc, number, sequence = np.zeros(len(links)), np.zeros(len(links), int), 0
    walked = []  # where one piece ends another starts with the same arc: that tells no order
    for together in _joined(nodes, labels):
        plain, start, remaining = sequence, 0.0, set(together)
        sequence += 1
        while remaining:
            piece = _walk(remaining, links, nodes)
            remaining.difference_update(piece)
            own = plain
            if corner[piece].any():
                own, sequence = sequence, sequence + 1
            steps = np.linalg.norm(np.diff(nodes.xy[piece], axis=0), axis=1)
            number[piece], arc[piece] = own, np.cumsum(np.append(start, steps))
            start = arc[piece[-1]]
            walked += piece
    walked = np.array(walked, int)
    order = walked[np.argsort(number[walked], kind="stable")]
    return Chains(arc, number, order, np.array(ends, int).reshape(-1, 2),
                  np.array(middles, int))


def _joined(nodes: Nodes, labels: list[int]) -> list[list[int]]:
    """Nodes of labels that share nodes, in the order of the smallest label."""
    root = {label: label for label in labels}
    of_node = [[] for _ in nodes.gid]
    for (label, _), members in nodes.members.items():
        for node in members:
            of_node[node].append(label)
    changed = True
    while changed:
        changed = False
        for sharing in of_node:
            least = min(root[label] for label in sharing)
            for label in sharing:
                changed = changed or root[label] != least
                root[label] = least
    together = {label: [] for label in labels}
    for node, sharing in enumerate(of_node):
        together[root[sharing[0]]].append(node)
    return [members for members in together.values() if members]


def _edges(nodes: Nodes, skeleton, label: int):
    """Nodes of the edges with a label: both ends, and the middle with quadratic elements."""
    for gids in skeleton.labelled(label).tolist():
        known = [nodes.members.get((label, gid)) for gid in gids]
        if not all(known):
            raise InputError(f"a boundary edge of contact label {label} has an end that is no "
                             "contact node; run the scene again")
        if any(len(members) > 1 for members in known):
            a, b = (nodes.xy[members[0]] for members in known[:2])
            x, y = b - a
            # at a corner within the label the node that faces as the edge does
            known = [[max(members, key=lambda k: abs(nodes.normal[k] @ (y, -x)))]
                     for members in known]
        yield [members[0] for members in known]


def _walk(remaining: set[int], links: list[list[int]], nodes: Nodes) -> list[int]:
    """One of the `remaining` pieces, node by node."""
    ends = [i for i in remaining if len(links[i]) == 1]
    here, piece, seen = min(remaining, key=lambda i: nodes.gid[i]), [], set()
    if ends:
        here = min(ends, key=lambda i: (*nodes.xy[i], nodes.gid[i]))
    while here is not None:
        piece.append(here)
        seen.add(here)
        onward = [i for i in links[here] if i in remaining and i not in seen]
        here = min(onward, key=lambda i: nodes.gid[i], default=None)
    return piece
