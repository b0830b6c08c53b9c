"""Whether the assumptions of a run hold: small strains, small rotations, linear contact.

Checked are the last step, that with most energy and, where contact is lost at the end, that in
which it carries most, at the displaced places:

strain    largest principal strain of a triangle's mean. Linear strains lack half the square of the
          displacement gradient: their relative error is about half of the strain
rotation  largest rotation of a triangle. It counts 1 - cos as strain, and turns loads, lever arms
          and normals that stay as they were. Both are infinite at sharp corners: the verdict asks
          whether they are too large on more than `SPOT` of a body's area
normals   of closed nodes: distance from the obstacle or the other body, measured at the displaced
          places, less the distance that the contact conditions used, over the contact length; and
          the angle between the normal there and the one that was used (`normal_turn`)
swelling  what a body that contact holds from two sides grows by as it turns, as rotations are
          linear, over what it is squeezed by (swelling.py); nothing where loads alone press it
slide     of closed nodes on another body: how far they are along it from where their forces act on
          it, over the contact length (`largest_slide`); nothing where contact follows the motion
second    what rotations of second order change of forces of contact and of the largest
order     displacement (second_order.py)
overlaps  boundaries without declared contact that penetrate, of two bodies or of one, by more than
          `TOUCH` of the smaller body's size; a gap that lets an obstacle, or another body, reach
          through the body, beside the mean of its length and height

Limits, and what they stand for, are in limits.py.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..contact.nodes import TURN
from ..contact.states import OPEN, ContactField
from ..errors import NotConverged
from ..feti.gathering import gather, joined
from ..scene import elements
from ..vectors import turned_left
from . import second_order, swelling, true_distance
from .limits import FELT, INVALID, NEGLIGIBLE, QUESTIONABLE, SPOT, TOUCH, UNPLACED, VERDICTS, WORDS
from .small_strains import MEASURES, SmallStrains


@dataclass
class Worst:
    """Largest value of a measure, and where: place (2,), step, words about it."""

    value: float = 0.0
    place: tuple = ()
    step: int = 0
    more: dict = field(default_factory=dict)


class Validity:
    """Checks steps of one solved problem. Collective; rank 0 compares boundaries."""

    def __init__(self, problem, contact, estimates: bool = True):
        """`problem` a march.Problem, `contact` its ContactState; `estimates` as of `assess`."""
        self.estimates, self.estimated = estimates, set()  # names of what was
        self.problem, self.structure, self.solver = problem, problem.structure, contact.solver
        self.comm, self.boundary = problem.operator.comm, contact.boundary
        self.worst = {name: Worst() for name in QUESTIONABLE}
        self.strained = 0.0 if estimates else None  # as second_order.py has it
        self.overlaps = {}  # largest part of the size by pair of labels
        self.outline = np.zeros(problem.manifest.nodes, bool)
        for nodes in (self.structure.outer_edges[:, :2], self.structure.outer_middles,
                      self.boundary.gid):
            self.outline[nodes] = True
        self.member, self.body = self._bodies()
        self.parts = {name: np.zeros(2) for name in MEASURES}  # of a body's area beyond the limits

    def _bodies(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the bodies of all subdomains (total,) and nodes (nodes,)."""
        subs = self.structure.subdomains
        part = [np.column_stack([np.full(len(sub.node_gid), sub.index), sub.node_gid])
                for sub in subs] if self.problem.manifest.bodies > 1 else []
        links = gather(self.comm, joined(part, np.int64, 2))
        total, nodes = self.structure.total, self.problem.manifest.nodes
        number = np.zeros(total + nodes, int)
        if len(links):
            graph = coo_matrix((np.ones(len(links)), (links[:, 0], total + links[:, 1])),
                               shape=(total + nodes,) * 2)
            number = connected_components(graph, directed=False)[1]
        return number[:total], number[total:]

    def note(self, name: str, value: float, place, step: int, **more) -> None:
        """Keep the largest value of a measure."""
        if value > self.worst[name].value:
            self.worst[name] = Worst(float(value), tuple(map(float, place)), step, more)

    # ---- a step ----------------------------------------------------------------------------------
    def check(self, step, state: dict) -> None:
        """Check a step with the `state` of its contact nodes, arrays (n_c,) by ContactField."""
        operator = self.problem.operator
        operator.follow(step)
        self.boundary = self.structure.contact.declared
        fields = operator.deformations(step.multipliers, step.weights)
        stretched = self._check_deformation(step, fields)
        turned = self.parts["largest_rotation"][0] > SPOT  # by too much anyway
        wanted = self.estimates or stretched > NEGLIGIBLE and not turned
        change = self._check_second_order(step, state, fields) if wanted else None
        place, moved = self._outline(operator.with_travel(fields, step.weights))
        if place is None:
            return
        if len(self.boundary.gid):
            self._check_contact(step, state, place, moved)
            self._check_swelling(step, state, moved, change)
        passed = state[ContactField.U_N] - self.boundary.at(step.time).gap + self.boundary.behind
        self._check_overlaps(step, place, moved, passed[self.boundary.paired].max(initial=0.0))

    def _check_deformation(self, step, fields) -> float:
        """Strains and rotations of triangles, prescribed ones included; SmallStrains.left_out."""
        travel, subs = self.structure.travel, self.structure.subdomains
        turned = travel.of(step.weights)[:, 2] / travel.bodies.size
        limits = np.array([[of[name] for of in (QUESTIONABLE, INVALID)] for name in MEASURES])
        own = np.array([sub.index for sub in subs], int)
        found = SmallStrains.of(subs, fields, turned[travel.bodies.number[own]],
                                self.structure.total, limits)
        for of_rank in self.comm.allgather(found.largest):
            for name, (value, center) in of_rank.items():
                self.note(name, value, center, step.index)
        beyond, areas = self.comm.allreduce(found.beyond), self.comm.allreduce(found.areas)
        whole, turns = (np.bincount(self.member, values, self.member.max() + 1)
                        for values in (areas, self.comm.allreduce(found.turns)))
        self.grown = swelling.expansions(self.problem, self.member, step.weights)
        self.turns, whole = turns / np.where(whole > 0, whole, 1.0), whole[self.member]
        for m, name in enumerate(MEASURES):
            for g in (0, 1):
                share = np.bincount(self.member, beyond[m, g])[self.member] / whole
                self.parts[name][g] = max(self.parts[name][g], share.max())
        return found.left_out(self.comm, self.member)

    def _check_second_order(self, step, state: dict, fields) -> second_order.Change | None:
        status = state.get(ContactField.STATUS, np.zeros(0, int))
        try:
            found = second_order.Change.of(self.problem, self.solver, step, status, fields,
                                           self.strained)
        except NotConverged:  # a state that holds nothing
            return None
        for value, what in found.parts(self.boundary.label):
            self.note("second_order", value, (), step.index, what=what)
        if found.buckling:
            part, self.strained = found.buckling
            self.note("buckling", part, (), step.index)
        self.estimated |= UNPLACED if found.buckling else {"second_order"}
        return found

    def _outline(self, fields) -> tuple:
        """Places and displacements (nodes, 2) of the nodes of the outline on rank 0, else None."""
        subs = self.structure.subdomains
        near = [self.outline[sub.node_gid] for sub in subs]
        own = (joined((sub.node_gid[n] for sub, n in zip(subs, near)), np.int64),
               joined((sub.xy[n] for sub, n in zip(subs, near)), float, 2),
               joined((u.reshape(-1, 2)[n] for u, n in zip(fields, near)), float, 2))
        everyone = self.comm.gather(own)
        if everyone is None:
            return None, None
        place, moved = np.zeros((2, len(self.outline), 2))
        for gid, xy, u in everyone:
            place[gid], moved[gid] = xy, u
        return place, moved

    # ---- contact ---------------------------------------------------------------------------------
    def _check_contact(self, step, state: dict, place, moved) -> None:
        b, closed = self.boundary.at(step.time), state[ContactField.STATUS] != OPEN
        pairs = self.problem.manifest.contact_pairs
        groups = [np.flatnonzero((b.chain == chain) & ~b.paired) for chain in np.unique(b.chain)]
        groups += [np.flatnonzero((b.label == label) & b.paired) for label in np.unique(b.label)]
        for here in groups:
            touching = here[closed[here]]
            length = b.length[touching].sum()
            if not len(touching):
                continue
            used = (b.gap - state[ContactField.U_N])[touching]
            xy, u = b.xy[touching], moved[b.gid[touching]]
            if b.following is not None:
                true, normal = self._followed(step, moved)
                true, turn = true[touching], _angle(-normal[touching], b.normal[touching])
            elif b.paired[here[0]]:
                others = [two for one, two in pairs if one == b.label[here[0]]]
                true, turn = self._from_other(others, xy, u, place, moved, touching)
            else:
                true, normal = true_distance.from_obstacle(b, here, xy + u)
                if true is None:
                    continue
                turn = _angle(normal, b.normal[touching])
            found = {"largest_normal_error": np.abs(true - used) / length, "normal_turn": turn}
            if b.paired[here[0]] and b.following is None and b.about is None:
                found["largest_slide"] = np.abs(state[ContactField.U_T][touching]) / length
            for name, values in found.items():
                k = int(values.argmax())
                self.note(name, values[k], xy[k], step.index, paired=bool(b.paired[here[0]]))

    def _check_swelling(self, step, state: dict, moved: np.ndarray, change) -> None:
        """As far as the `change` by finite rotations, where it is known, says that forces feel it:
        a belt round a drum keeps those that pull at its ends.
        """
        structure, manifest = self.structure, self.problem.manifest
        if manifest.axisymmetric:  # whose sections are held by their hoops
            return
        partners, free = swelling.holders(structure, manifest, self.member, self.body)
        for value, nodes, more, place in swelling.of_bodies(
                self.boundary, state, moved, self.body, self.turns, partners, free, self.grown):
            felt = FELT * change.of_nodes(nodes) if change else np.inf
            self.note("largest_swelling", min(value, felt), place, step.index, **more)

    def _followed(self, step, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (n_c,) and the contact's normals (n_c, 2) about displacements (nodes, 2)."""
        following = self.boundary.following
        u = moved[following.gids]
        now = following.about(u, step.time).declared
        jump = (now.normal[now.term_node] * u[np.searchsorted(following.gids, now.term_gid)])
        over = np.bincount(now.term_node, now.term_value * jump.sum(axis=1), len(now.gid))
        return now.gap - over, now.normal

    def _from_other(self, labels: list, xy, u, place, moved, touching):
        """Distances from the boundaries `labels` of other bodies, and turns of their normals.

        What polygons lack of curved boundaries is there before any load and does not count, of
        normals as far as their edges turn. Nor does what the other surface turns where the own one,
        whose normals are used, keeps its direction. Nodes at corners meet what faces them.
        """
        edges = self.structure.outer_edges
        ends, periods = edges[np.isin(edges[:, 2], labels), :2], self.boundary.periods
        if periods is not None:
            ends, place, moved = periods.with_images(ends, place, moved, xy)
        start, end = ends.T
        own = self.boundary.normal[touching]
        _, near = true_distance.nearest((place[start] + place[end]) / 2, xy, xy)
        outward = -turned_left(place[end] - place[start])  # of edges with the body left
        back = (outward * own[near]).sum(axis=1) > 0
        start, end = np.where(back, end, start), np.where(back, start, end)

        mine = np.isin(edges[:, 2], self.boundary.label[touching])
        facets = sum(true_distance.largest_bend(place[a], place[b]) / 2
                     for a, b in ((start, end), edges[mine, :2].T))
        turned = self._turned(mine, place, moved)[self.boundary.gid[touching]]

        def measured(at, edges) -> tuple[np.ndarray, np.ndarray]:
            a, b = start[edges], end[edges]
            now = true_distance.polygon(place[a] + moved[a], place[b] + moved[b])
            true, normal = now.distance((xy + u)[at])
            turn = _angle(normal, own[at])
            if self.boundary.about is not None:
                turn = np.maximum(turn - facets, 0.0)
            else:
                before, normal = true_distance.polygon(place[a], place[b]).distance(xy[at])
                true = true - before + self.boundary.gap[touching[at]]
                turn = np.maximum(turn - np.minimum(_angle(normal, own[at]), facets), 0.0)
                turn = np.minimum(turn, turned[at])
            return true, turn

        true, turn = measured(slice(None), slice(None))
        outward = -turned_left(place[end] - place[start])
        outward /= np.linalg.norm(outward, axis=1)[:, None]
        gid, count = np.unique(self.boundary.gid[self.boundary.paired], return_counts=True)
        for node in np.flatnonzero(np.isin(self.boundary.gid[touching], gid[count > 1])):
            facing = outward @ own[node] < -TURN
            if facing.any():
                (true[node],), (turn[node],) = measured([node], facing)
        return true, turn

    def _turned(self, mine: np.ndarray, place, moved) -> np.ndarray:
        """(nodes,) angles by which the edges `mine` of the outline have turned, means at nodes.

        Infinite at their ends: what a corner meets says which way it presses.
        """
        ends = self.structure.outer_edges[mine, :2]
        before, now = (of[ends[:, 1]] - of[ends[:, 0]] for of in (place, place + moved))
        turn = np.abs(np.arctan2(elements.cross(before, now), (before * now).sum(axis=1)))
        nodes = ends.T
        if len(self.structure.outer_middles):
            nodes = np.vstack([nodes, *[self.structure.outer_middles[mine]] * 2])
        count = np.bincount(nodes.ravel(), minlength=len(place))
        total = np.bincount(nodes.ravel(), np.tile(turn, len(nodes)), len(place))
        return np.where(count > 1, total / np.maximum(count, 1), np.inf)

    # ---- overlaps --------------------------------------------------------------------------------
    def _check_overlaps(self, step, place, moved, passed: float) -> None:
        """`passed`: how far surfaces of pairs pass through each other, as drawn, to their ends."""
        edges = self.structure.outer_edges
        start, end = (place + moved)[edges[:, :2]].transpose(1, 0, 2)
        body = self.body[edges[:, 0]]
        pairs = {frozenset(pair) for pair in self.problem.manifest.contact_pairs}
        pairs |= {frozenset((one.first, one.second)) for one in self.problem.effects.joints}
        size = {k: np.ptp(place[edges[body == k, 0]], axis=0).max() for k in np.unique(body)}
        declared = np.isin(edges[:, 2], self.problem.manifest.contact_pairs)
        meets = np.isin(edges[:, 0], edges[declared, :2])
        for one in size:
            for two in size:
                if one == two:
                    continue
                mine, theirs = np.flatnonzero(body == one), np.flatnonzero(body == two)
                low, high = start[theirs].min(axis=0), start[theirs].max(axis=0)
                mine = mine[((start[mine] > low) & (start[mine] < high)).all(axis=1)]
                mine = mine[true_distance.inside(start[mine], start[theirs], end[theirs])]
                if len(mine):
                    depth, near = true_distance.nearest(start[mine], start[theirs], end[theirs])
                    depth[meets[mine] & (depth <= passed)] = 0.0
                    self._note_depth(step, mine, theirs[near], depth / min(size[one], size[two]),
                                     pairs, start, end)
        cut = true_distance.crossings(start, end, edges[:, :2])
        cut = cut[body[cut[:, 0]] == body[cut[:, 1]]]
        for i, k in cut[[not true_distance.may_meet(edges, *two, pairs) for two in cut]]:
            depth = np.linalg.norm(end[i] - start[i]) / size[body[i]]
            self._note_depth(step, np.array([i]), np.array([k]), np.array([depth]), pairs, start,
                             end)
        if len(self.boundary.gid):
            self._check_gap(step, place)

    def _check_gap(self, step, place) -> None:
        """How far contact starts inside, beside the mean of the body's length and height.

        Of a pair that of the smaller body: a thin one that is bent by more than its height is no
        mistake.
        """
        b, edges = self.boundary, self.structure.outer_edges
        body = self.body[edges[:, 0]]
        size = {k: np.ptp(place[edges[body == k, 0]], axis=0).mean() for k in np.unique(body)}
        deep = -self.boundary.start.declared.at(step.time).gap
        for label, paired in sorted({*zip(b.label.tolist(), b.paired.tolist())}):
            here = np.flatnonzero((b.label == label) & (b.paired == paired))
            others = [two for one, two in self.problem.manifest.contact_pairs if one == label]
            met = np.unique(body[np.isin(edges[:, 2], others)]) if paired else []
            k = here[deep[here].argmax()]
            whole = min(size[n] for n in (self.body[b.gid[k]], *met))
            self.note("gap", deep[k] / whole, b.xy[k], step.index,
                      other="other body" if paired else "obstacle")

    def _note_depth(self, step, mine, theirs, depth, pairs, start, end) -> None:
        """Depths of vertices (edges `mine` start there) behind the edges `theirs`.

        A vertex of two labels is named by that of its edges which faces the other boundary: with
        the flank of a corner there may be contact. Edges that cross have their own labels.
        """
        edges = self.structure.outer_edges
        along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
        for i, k, value in zip(mine, theirs, depth):
            here = np.flatnonzero((edges[:, :2] == edges[i, 0]).any(axis=1))
            if value <= TOUCH or any(frozenset((a, edges[k, 2])) in pairs
                                     for a in edges[here, 2]):
                continue
            own = i
            if self.body[edges[i, 0]] != self.body[edges[k, 0]]:
                askew = np.abs(elements.cross(along[here], along[k]))
                own = here[np.lexsort((edges[here, 2], np.round(askew, 6)))[0]]
            two = tuple(sorted((int(edges[own, 2]), int(edges[k, 2]))))
            self.overlaps[two] = max(self.overlaps.get(two, 0.0), float(value))
            self.note("overlaps", value, start[i], step.index, pair=two,
                      labels=f"boundaries {two[0]} and {two[1]}")

    # ---- the verdict -----------------------------------------------------------------------------
    def summary(self) -> dict:
        """Entry `validity` of summary.json; the same on all ranks, collective."""
        worst = self.comm.bcast(self.worst)
        # the pair that the reason names first, where others are as deep
        named = worst["overlaps"].more.get("pair")
        overlaps = self.comm.bcast([[*labels, depth] for labels, depth in sorted(
            self.overlaps.items(), key=lambda pair: (-pair[1], pair[0] != named))])
        grade = {name: int(w.value > QUESTIONABLE[name]) + int(w.value > INVALID[name])
                 for name, w in worst.items()}
        grade |= {name: int((self.parts[name] > SPOT).sum()) for name in MEASURES}
        excess = {name: w.value / (QUESTIONABLE[name] or TOUCH) for name, w in worst.items()}
        # what others say says where, too
        name = max(grade, key=lambda name: (grade[name], name not in UNPLACED, excess[name]))
        entry = {measure: worst[measure].value for measure in
                 ("largest_strain", "largest_rotation", "largest_normal_error", "normal_turn",
                  "largest_slide", "largest_swelling", "second_order", "buckling")}
        entry |= dict.fromkeys(UNPLACED - self.estimated)
        entry |= {"overlaps": overlaps, "verdict": VERDICTS[grade[name]], "reason": ""}
        if grade[name]:
            entry["reason"] = self._reason(name, worst[name])
        return entry

    def _reason(self, name: str, worst: Worst) -> str:
        """What is wrong, where, what was taken for granted and what to do."""
        what, granted, remedy = WORDS[name]
        remedies = "apply smaller loads, or start nearer to the final position"
        if worst.more.get("paired") and self.boundary.about is None:
            remedies = "use largeSliding or LINEARIZATION=updated, or smaller loads"
        what = what.format(worst.value, **worst.more)
        where = " at ({:.4g}, {:.4g})".format(*worst.place) if worst.place else ""
        return (f"{what}{where} in step {worst.step}, but {granted}: "
                f"{remedy.format(remedy=remedies)}")


def _angle(normal: np.ndarray, used: np.ndarray) -> np.ndarray:
    """(n,) angles between normals (n, 2) of what is met and those of the body, which oppose."""
    return np.arccos(np.clip(-(normal * used).sum(axis=1), -1.0, 1.0))


def assess(problem, contact, considered: list[tuple], estimates: bool = True) -> dict:
    """Entry `validity` for steps (step, state of the contact nodes); `estimates`: whether all that
    takes further solutions is estimated. Collective.
    """
    checks = Validity(problem, contact, estimates)
    for step, state in considered:
        checks.check(step, state)
    return checks.summary()
