"""probes.csv, displacements and forces where a scene asks for them.

A label's displacement is the mean over its edges, of bodies of revolution over the surface; its
force is what acts on the body through it: tractions, support reactions, springs, point loads,
contact, joints. Where labels meet, a node's reaction goes to those that the support names as a
whole (all their nodes are constrained in that direction), in equal parts, and at a support that is
a point to all labels there, a contact force as shares.py divides it; so the forces of all labels
add up to those of the scene, and of each body to its own. A point's force is the reaction, the
springs' and the point load at its vertex.
"""

from dataclasses import dataclass

import numpy as np

from ..contact.states import ContactField
from ..errors import InputError
from ..feti.operator import DualOperator
from ..feti.supports import constrained_keys
from ..march.step import Step
from ..scene import elements, sides, springs
from .contact_state import HELD, JOINTS
from .places import ON_SIDE, Place, nearest, on_side
from .shares import label_shares
from .tables import PROBES

OUTSIDE = 0.25  # of an element's height; nearer ones belong to a curved side that chords cut off
MEANS = {2: (1 / 2, 1 / 2), 3: (1 / 6, 1 / 6, 4 / 6)}  # of shape functions of an edge's nodes


class Probes:
    """Evaluates the probes of a scene, step by step; collective."""

    def __init__(self, operator: DualOperator, manifest, effects):
        """`effects`: those of the scene, with its probes.

        Raises InputError for a point that lies outside the body. One that lies in several follows
        the first of them, as `warnings` say.
        """
        self.operator, probe = operator, effects.rooms["probe"]
        self.joints = [(joint.first, joint.second) for joint in effects.joints]
        self.nodal = [k for k, pattern in enumerate(manifest.patterns)
                      if pattern["given_on"] == "nodes"]
        founded = manifest.rooms.get("springs", {}).get("labels", [])
        self.shares = shares = _Shares(operator, founded)
        edges = [k for k, pattern in enumerate(manifest.patterns)
                 if pattern["given_on"] == "edges"]
        self.labels = [_Label(label, operator, shares, edges) for label in probe.labels]
        joined = [label for pair in self.joints for label in pair]
        self.points = [_Point(number, xy, operator, joined)
                       for number, xy in enumerate(probe.points, 1)]
        self.warnings = [
            f"probePoints: ({point.xy[0]:g}, {point.xy[1]:g}) lies in several bodies that touch, "
            f"or on both sides of a slit; {point.name} follows the first: move the point slightly "
            "into the intended body" for point in self.points if point.shared]
        self.rows = []  # {column: value}
        self._first = self._first_of_contact()
        self._first_side = dict(zip(*label_shares(operator.structure)))

    def add(self, step: Step, displacements: list[np.ndarray], inner: list[np.ndarray],
            state: dict) -> None:
        """Evaluate a step; arguments as in resultants.py, displacements less the travel."""
        structure, whole = self.operator.structure, self.operator.with_travel(displacements,
                                                                              step.weights)
        reactions, loads, sprung = [], [], []
        rubbing = np.flatnonzero((state[HELD] != 0) & ~structure.contact.declared.paired)
        forces = self.operator.forces_on_supports(step.multipliers)
        for s, sub in enumerate(structure.subdomains):
            load = step.weights[: structure.patterns] @ sub.loads
            reaction, fixed = np.zeros(sub.dofs), structure.fixed[s]
            if len(fixed):
                reaction[fixed] = (inner[s] - load)[fixed] + forces[s]
            self._rub(sub, reaction, state[HELD], rubbing[self._first[rubbing] == sub.index])
            reactions.append(reaction)
            sprung.append(0.0 if sub.springs is None else springs.forces(sub, displacements[s]))
            loads.append(step.weights[self.nodal] @ sub.loads[self.nodal])
        for probe in (*self.labels, *self.points):
            own = np.zeros((len(structure.subdomains), 2, 2))
            for s in range(len(structure.subdomains)):
                own[s] = probe.evaluate(s, whole[s], reactions[s], loads[s], sprung[s],
                                        step.weights)
            # summed in the order of the subdomains on any number of ranks
            u, force = np.concatenate(self.operator.comm.allgather(own)).sum(axis=0)
            force = force + self._contact(probe.label, state)
            values = (step.index, step.time, probe.name, *map(float, (*probe.xy, *u, *force)))
            self.rows.append(dict(zip((str(column.name) for column in PROBES), values)))

    def _rub(self, sub, reaction: np.ndarray, force: np.ndarray, own: np.ndarray) -> None:
        """Add to a subdomain's `reaction` the friction `force` (n_c,) of its `own` contact nodes
        that supports hold.
        """
        b = self.operator.structure.contact.declared
        for k in own:
            node = int(np.flatnonzero(sub.node_gid == b.gid[k])[0])
            reaction[2 * node : 2 * node + 2] += force[k] * b.tangent[k]

    def _first_of_contact(self) -> np.ndarray:
        """(n_c,) least number of a subdomain that has the node."""
        structure, gids = self.operator.structure, self.operator.structure.contact.declared.gid
        first = np.full(len(gids), np.iinfo(np.int64).max)
        for sub in structure.subdomains:
            own = np.isin(gids, sub.node_gid)
            first[own] = np.minimum(first[own], sub.index)
        return np.min(self.operator.comm.allgather(first), axis=0)

    def _contact(self, label: int | None, state: dict) -> np.ndarray:
        """(2,) force of contact, or of joints, on the body through a label, on either side."""
        whole = self.operator.structure.contact
        b = whole.declared
        force = (state[ContactField.SIGMA_N][:, None] * b.normal
                 + state[ContactField.SIGMA_T][:, None] * b.tangent) * b.weight[:, None]
        held = whole.is_joint
        joined, names = -state[JOINTS][:, None] * whole.normal[held], whole.label[held]
        met = [first for first, second in self.joints if second == label]
        total = self._first_side.get(label, np.zeros(len(b.gid))) @ force
        total = total + joined[names == label].sum(axis=0) - joined[np.isin(names, met)].sum(axis=0)
        for number, pairs in enumerate(b.meeting, 1):
            total = total + self._second_side(label, b, number, pairs, force)
        return total

    def _second_side(self, label: int | None, b, family: int, pairs: list,
                     force: np.ndarray) -> np.ndarray:
        """(2,) what the nodes of a family of `pairs` pass on to a label of the other body.

        `force` (n_c, 2) is that on their own body. Where second labels meet, in equal parts.
        """
        seconds = sorted({second for _, second in pairs})
        if label not in seconds:
            return np.zeros(2)
        terms = np.flatnonzero(b.term_other & (b.family[b.term_node] == family))
        on = np.array([np.isin(b.term_gid[terms], self.shares.nodes[second])
                       for second in seconds])
        part = on[seconds.index(label)] / np.maximum(on.sum(axis=0), 1)
        return (part * b.term_value[terms]) @ force[b.term_node[terms]]


class _Shares:
    """Which part of the reaction at a node belongs to which label, see above; collective."""

    def __init__(self, operator: DualOperator, founded: list[int]):
        """`founded` are the labels with an elastic foundation."""
        structure, self.founded = operator.structure, founded
        self.constrained = np.unique(np.concatenate(
            operator.comm.allgather(constrained_keys(structure))))
        edges, middles = structure.outer_edges, structure.outer_middles
        self.nodes = {}  # gids of every label
        for label in np.unique(edges[:, 2]).tolist():
            own = edges[:, 2] == label
            self.nodes[label] = np.unique(np.concatenate([
                edges[own, :2].ravel(), middles[own] if len(middles) else []]).astype(np.int64))
        self.supported = {label: [self._held(nodes, c) for c in (0, 1)]
                          for label, nodes in self.nodes.items()}

    def _held(self, nodes: np.ndarray, component: int) -> bool:
        return bool(np.isin(2 * nodes + component, self.constrained).all())

    def of(self, label: int, gids: np.ndarray, component: int) -> np.ndarray:
        """(n,) part of a label in the nodal reactions of a direction at the nodes `gids` (n,)."""
        meeting = [np.isin(gids, nodes) for nodes in self.nodes.values()]
        whole = np.sum([here for here, name in zip(meeting, self.nodes)
                        if self.supported[name][component]] or [0 * gids], axis=0)
        every = np.sum(meeting, axis=0)
        here = np.isin(gids, self.nodes[label])
        if self.supported[label][component]:
            return here / np.maximum(whole, 1)
        return np.where(whole > 0, 0.0, here / np.maximum(every, 1))


    def of_springs(self, label: int, gids: np.ndarray) -> np.ndarray:
        """(n,) part of a label in the forces of springs at the nodes `gids` (n,).

        They belong to the labels with a foundation, beside those to all.
        """
        meeting = {name: np.isin(gids, nodes) for name, nodes in self.nodes.items()}
        founded = sum((meeting[name] for name in self.founded), np.zeros(len(gids)))
        every = sum(meeting.values(), np.zeros(len(gids)))
        own = meeting[label] / np.maximum(np.where(founded > 0, founded, every), 1)
        return own if label in self.founded else np.where(founded > 0, 0.0, own)


@dataclass
class _Edges:
    """Edges of a label in a subdomain: their numbers, nodes (n, 2 or 3), lengths (n,).

    `parts` (n, 3) are the integrals of the shape functions over curved ones, else None.
    """

    number: np.ndarray
    nodes: np.ndarray
    length: np.ndarray
    parts: np.ndarray | None = None

    def rings(self, sub) -> np.ndarray:
        """(n, 2 or 3) integrals of the shape functions times the radius: Simpson's rule is exact.
        """
        if self.parts is not None:
            return sides.integrals(sub.xy[self.nodes], revolved=True) / (2 * np.pi)
        r = np.maximum(sub.xy[self.nodes, 0], 0.0)
        if self.nodes.shape[1] == 2:
            r = (2 * r + r[:, ::-1]) / 6
        else:
            r = r * MEANS[3]
        return self.length[:, None] * r


class _Label:
    """A probed label."""

    def __init__(self, label: int, operator: DualOperator, shares: _Shares, patterns: list[int]):
        """`patterns` are those given on edges."""
        self.label, self.name = label, f"label{label}"
        subs = operator.structure.subdomains
        self.subs, self.edges = subs, [_edges_of(sub, label) for sub in subs]
        self.share = [self._part(sub, shares) for sub in subs]
        self.rests = [shares.of_springs(label, sub.node_gid[sub.dof_node])
                      for sub in subs]
        revolved = operator.structure.contact.axisymmetric
        self.tractions = [_tractions(sub, edges, patterns, revolved)
                          for sub, edges in zip(subs, self.edges)]
        middle = np.array([_integral(edges, sub.xy) for edges, sub in zip(self.edges, subs)])
        length = np.array([edges.length.sum() for edges in self.edges])
        gathered = operator.comm.allgather((middle.reshape(-1, 2), length))
        self.length = np.concatenate([part for _, part in gathered]).sum()
        self.xy = np.concatenate([part for part, _ in gathered]).sum(axis=0) / self.length
        self.rings = None
        if operator.structure.contact.axisymmetric:
            rings = [edges.rings(sub) for edges, sub in zip(self.edges, subs)]
            area = sum(part for of_rank in operator.comm.allgather([r.sum() for r in rings])
                       for part in of_rank)
            if area > 0:  # the axis has none, and means as in the plane
                self.rings = [ring / area for ring in rings]

    def _part(self, sub, shares: _Shares) -> np.ndarray:
        """(dofs,) of a subdomain: part of the label in the reaction."""
        gids, parts = sub.node_gid[sub.dof_node], np.zeros(sub.dofs)
        for component in (0, 1):
            own = sub.dof_component == component
            parts[own] = shares.of(self.label, gids[own], component)
        return parts

    def evaluate(self, s: int, u, reaction, load, sprung,
                 weights) -> tuple[np.ndarray, np.ndarray]:
        """Contributions (2,) of the rank's subdomain s to displacement and force."""
        force = _by_component(self.subs[s], (reaction + load) * self.share[s]
                              + sprung * self.rests[s])
        force = force + weights[: len(self.tractions[s])] @ self.tractions[s]
        if self.rings is not None:
            values = u.reshape(-1, 2)[self.edges[s].nodes]
            return np.einsum("en,enc->c", self.rings[s], values), force
        return _integral(self.edges[s], u.reshape(-1, 2)) / self.length, force


class _Point:
    """A probed point."""

    label = None

    def __init__(self, number: int, xy: np.ndarray, operator: DualOperator, joined: list[int]):
        """`joined`: labels of boundaries that move with one another."""
        self.name, self.xy, self.subs = f"point{number}", xy, operator.structure.subdomains
        first = operator.structure.first
        # nodes there, of every subdomain
        self.near = [np.linalg.norm(sub.xy - xy, axis=1) <= 1e-9 * np.ptp(sub.xy, axis=0).max()
                     for sub in self.subs]
        found = [Place(*nearest(sub, xy), first + s) for s, sub in enumerate(self.subs)]
        places = [place for part in operator.comm.allgather(found) for place in part]
        depth = max(place.depth for place in places)
        if depth < -OUTSIDE:
            raise InputError(f"probePoints: ({xy[0]:g}, {xy[1]:g}) lies outside the body")
        depth = min(depth, -ON_SIDE)  # on common sides any subdomain is as good: the first one
        inside = [place for place in places if place.depth >= depth]
        self.triangle, self.place, self.own = inside[0].triangle, inside[0].at, (
            inside[0].subdomain - first)
        own = [place for place in inside if 0 <= place.subdomain - first < len(self.subs)]
        known = [on_side(self.subs[place.subdomain - first], place, joined) for place in own]
        known = [on for part in operator.comm.allgather(known) for on in part]
        others = {on for on, alike in known if not alike} - {known[0][0]}
        self.shared = bool(others) and not known[0][1]
        if self.shared:
            self.near = [near & ~np.isin(sub.node_gid, sorted(set().union(*others)))
                         for near, sub in zip(self.near, self.subs)]

    def evaluate(self, s: int, u, reaction, load, sprung,
                 _weights) -> tuple[np.ndarray, np.ndarray]:
        """Contributions (2,) of the rank's subdomain s to displacement and force."""
        sub, moved = self.subs[s], np.zeros(2)
        if s == self.own:
            nodes = sub.elements[self.triangle]
            moved = elements.shapes(len(nodes), self.place[None])[0] @ u.reshape(-1, 2)[nodes]
        return moved, _by_component(sub, (reaction + load + sprung) * self.near[s][sub.dof_node])


def _edges_of(sub, label: int) -> _Edges:
    """The edges of a label in a subdomain."""
    own = np.flatnonzero(sub.edge_label == label)
    nodes = sub.edges[own]
    length = np.linalg.norm(np.subtract(*sub.xy[nodes.T]), axis=1)
    middles = sub.middles(nodes)
    if not len(middles):
        return _Edges(own, nodes, length)
    nodes = np.column_stack([nodes, middles])
    if not sides.are_curved(sub.xy[nodes]):
        return _Edges(own, nodes, length)
    parts = sides.integrals(sub.xy[nodes])
    return _Edges(own, nodes, parts.sum(axis=1), parts)


def _tractions(sub, edges: _Edges, patterns: list[int], revolved: bool) -> np.ndarray:
    """(all patterns, 2) resultants over the edges of the `patterns` that are given on edges.

    With quadratic elements only nodal forces are known. A middle's belongs to its edge; of a
    vertex every edge that is loaded gets what a constant traction would give, a fourth of its
    middle's, and an equal part of the rest; of bodies of revolution (`revolved`) in proportion to
    their radii.
    """
    total = np.zeros((len(sub.loads), 2))
    if not len(edges.number):
        return total
    if sub.elements.shape[1] == 3:
        for k, moments in sub.edge_loads.items():
            total[k] = moments[edges.number].sum(axis=(0, 1))
        return total
    middles = sub.middles(sub.edges)
    own = np.isin(np.arange(len(middles)), edges.number)
    part = np.full(sub.edges.T.shape, 0.25)
    if revolved:
        radius = np.maximum(sub.xy[:, 0], 0.0)
        part = radius[sub.edges.T] / np.maximum(4 * radius[middles], 1e-300)
    for k in patterns:
        force = np.zeros((len(sub.xy), 2))
        force[sub.dof_node, sub.dof_component] = sub.loads[k]
        loaded = force[middles].any(axis=1)
        known, count = np.zeros_like(force), np.zeros(len(force))
        guesses = part[:, :, None] * force[middles]
        for ends, guess in zip(sub.edges.T, guesses):
            np.add.at(known, ends, guess)
            np.add.at(count, ends, loaded)
        rest = (force - known) / np.maximum(count, 1)[:, None]
        mine = own & loaded
        total[k] = force[middles[mine]].sum(axis=0)
        for ends, guess in zip(sub.edges[mine].T, guesses):
            total[k] += (guess[mine] + rest[ends]).sum(axis=0)
    return total


def _integral(edges: _Edges, values: np.ndarray) -> np.ndarray:
    """(2,) integral of nodal values (n_v, 2) over the edges."""
    if not len(edges.number):
        return np.zeros(2)
    if edges.parts is not None:
        return np.einsum("en,enc->c", edges.parts, values[edges.nodes])
    means = np.tensordot(MEANS[edges.nodes.shape[1]], values[edges.nodes], axes=(0, 1))
    return edges.length @ means


def _by_component(sub, values: np.ndarray) -> np.ndarray:
    """(2,) sums of values (dofs,) by component."""
    return np.bincount(sub.dof_component, values, minlength=2)
