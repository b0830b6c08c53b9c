"""Boundaries that meet in contact pairs: what their contact nodes are coupled to (mortar.py)."""

import copy
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..feti.edges import edge_labels, outward_edges
from ..feti.gathering import gather
from ..feti.supports import free_along, held_nodes
from ..scene.loader import Subdomain
from . import mortar
from .boundary import Configuration
from .found_nodes import Meeting
from .held import check_passed_on, lost_and_guided, met_by
from .shared_labels import of_pairs
from .side import Side, before_flanks, rises, sagitta, split


@dataclass
class Coupled:
    """What they meet: `weight` and `length` (n,) of what faces them, `normal` (n, 2), `gap` (n,),
    `guided` (n,) which of them carry pressure and no friction and `lost` (n,) which have no
    condition (held.py), and the `terms` of the jump, one for every node of either side: contact
    node, gid, coefficient, whether it is the other side's, (terms,) each. `behind` as of _behind.
    """

    weight: np.ndarray
    length: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    guided: np.ndarray
    lost: np.ndarray
    terms: tuple[np.ndarray, ...]
    behind: tuple[np.ndarray, ...] | None = None


class PairSides:
    """Boundaries that meet in contact pairs, replicated on every rank.

    `fixed` as `fixed_dofs` of feti returns it. `moved`, if given, holds displacements (dofs,) of
    the rank's subdomains: normals, facing parts and gaps are then those of the displaced
    boundaries.
    """

    def __init__(self, manifest, subdomains: list[Subdomain], fixed, comm, moved=None):
        labels, self.fixed, self.about = np.unique(manifest.contact_pairs), fixed, None
        self.periods = None  # Periods by which bodies repeat themselves
        self.at_first = {}  # by labels the nodal normals at first, shared by all that are displaced
        self.axisymmetric = manifest.axisymmetric
        self.nodes = n = 2 if manifest.element == "P1" else 3  # of an edge
        parts = [np.empty((0, 3 + 5 * n))]
        for s, sub in enumerate(subdomains if len(labels) else ()):
            edges = outward_edges(sub.triangles)
            label = edge_labels(sub.edges, sub.edge_label, np.sort(edges, axis=1))
            edges, label = edges[np.isin(label, labels)], label[np.isin(label, labels)]
            bow, u = np.zeros((len(edges), 2)), np.zeros_like(sub.xy)
            if moved is not None:
                u = moved[s].reshape(-1, 2)
            if n == 3:
                edges = np.column_stack([edges, sub.middles(edges)])
                bow = np.column_stack([sub.fields["bow_x"], sub.fields["bow_y"]])[edges[:, 2]]
            places, moves = (of[edges].reshape(-1, 2 * n) for of in (sub.xy, u))
            parts.append(np.column_stack([label, bow, sub.node_gid[edges], places, moves]))
        table = gather(comm, np.concatenate(parts))
        self.label, self.bow, self.gid = table[:, 0], table[:, 1:3], table[:, 3:3 + n].astype(int)
        self.xy, self.u = (table[:, 3 + k * n:3 + (k + 2) * n].reshape(-1, n, 2) for k in (1, 3))
        if moved is not None:
            gids, first = np.unique(self.gid, return_index=True)
            self.about = Configuration(gids, self.u.reshape(-1, 2)[first])

    def displaced(self, about: Configuration) -> "PairSides":
        """The same boundaries about other displacements of all their nodes."""
        other = copy.copy(self)
        other.about, other.u = about, about.u[np.searchsorted(about.gid, self.gid)]
        return other

    def couple(self, pairs: list[tuple[int, int]], nodes: Meeting, reach: float | None = None,
               without: np.ndarray | None = None) -> Coupled:
        """What the contact `nodes` meet; `pairs` are labels whose first ones make one boundary.

        `reach`: of several places that a place faces within it the nearest counts, and there may
        be none. By default there must be one. Nodes `without` (n,) condition stay so wherever the
        boundaries are.

        About a displacement w with the normals n of the displaced boundaries the condition n . [u]
        <= gap has as much room at u = w as there is distance then: gap = distance + n . [w].
        """
        labels, other_labels = zip(*pairs)
        first, gids, one, places, twins = self._side(labels, nodes.gid, nodes.facing)
        second, others, two, *_ = self._side(other_labels)
        within = mortar.reach_of(pairs) if reach is None else reach
        if self.periods is not None:
            one_place = np.column_stack([nodes.gid, nodes.heir])[nodes.gid != nodes.heir]
            first.same = self.periods.same_of(gids, one_place)
            second, times = self.periods.repeated(second, first.xy)
            others, two = np.tile(others, times), np.tile(two, times)
            within = np.inf if within is None else within  # of images the nearest
        able = mortar.meets(one, two, pairs)
        if len(twins):
            able &= before_flanks(first, twins, second.edge_normal)
        sharp = np.zeros(len(gids), bool)
        sharp[places] = nodes.corner
        # at the tip of a crack both sides are one node, which cannot move from itself
        tip = np.isin(gids, others)
        # rows of contact that follows the motion are those of its start
        if reach is not None and labels not in self.at_first:
            unmoved, *_ = self._side(labels, nodes.gid, nodes.facing, moved=False)
            self.at_first[labels] = unmoved.nodal_normals()
        normal = first.nodal_normals() if reach is None else self.at_first[labels]
        rubbing = np.zeros(len(gids), bool)
        rubbing[places] = nodes.rubs
        with of_pairs(pairs):
            lost, guided = lost_and_guided(first, second, (gids, others), self.fixed[0], normal,
                                           rubbing, able, within)
            lost &= ~tip
            if self.periods is not None:
                lost |= np.isin(gids, self.periods.gids)
                lost[first.same] = False
            if without is not None:
                lost[places] |= without
            held = held_nodes(gids, self.fixed[0]) | tip | lost
            both = np.isin(self.fixed[0] // 2, others).any()
            check_passed_on(first, one, lost, held, pairs, both)
            stands = ~free_along(gids, normal, self.fixed[0])
            # where contact follows the motion they are the same ones in all steps
            stands &= lost if reach is None else np.isin(np.arange(len(gids)), places)
            behind = met_by(first, second, stands, able, within) if stands.any() else None
            if behind is not None:
                behind[-1][stands & ~lost] = np.inf
            pair = mortar.couple(first, second, held, able, within, sharp if sharp.any() else None)
        met = np.isin(second.edges[:, :2], pair.of[pair.side == 1]).all(axis=1)
        missed = _missed(pairs, two[met]) if pair.weight.any() else pairs
        if held.all() or reach is None and missed:
            one, two = (missed or pairs)[0]
            raise InputError(
                f"the boundaries {one} and {two} of a contact pair do not face each other, or a "
                f"support holds all nodes of {one}: then name {two} first")
        position = np.full(len(gids), -1)
        position[places] = np.arange(len(nodes.gid))
        node_gid = np.where(pair.side == 0, gids[np.where(pair.side == 0, pair.of, 0)],
                            others[np.where(pair.side == 1, pair.of, 0)])
        gap = pair.gap
        if self.about is not None:
            u = self.about.u[np.searchsorted(self.about.gid, node_gid)]
            jump = pair.value * (pair.normal[pair.node] * u).sum(axis=1)
            gap = gap + np.bincount(pair.node, jump, minlength=len(gap))
        terms = position[pair.node], node_gid, pair.value, pair.side == 1
        return Coupled(pair.weight[places], pair.length[places], pair.normal[places], gap[places],
                       guided[places], lost[places], terms,
                       behind and self._behind(behind, gids, others, pair.normal, position))

    def _behind(self, met: tuple, gids: np.ndarray, others: np.ndarray, normal: np.ndarray,
                position: np.ndarray) -> tuple[np.ndarray, ...]:
        """What nodes meet that supports hold along their normal, and that have no condition: terms
        of the jump, contact node, gid and coefficient (terms,) each, and distances (nodes,) at
        first, inf of those that face nothing now, NaN of all others.

        `met` as of held.met_by; `gids` and `others` of both sides' nodes, `position` (n,) the
        contact nodes of the first one's.
        """
        node, of, value, away = met
        own = np.flatnonzero(~np.isnan(away))
        row, gid = np.append(own, node), np.append(gids[own], others[of])
        value = np.append(np.ones(len(own)), -value)
        if self.about is not None:
            u = self.about.u[np.searchsorted(self.about.gid, gid)]
            away = away + np.bincount(row, value * (normal[row] * u).sum(axis=1), len(away))
        here = position >= 0
        gap = np.full(np.count_nonzero(here), np.nan)
        gap[position[here]] = away[here]
        return position[row], gid, value, gap

    def _side(self, labels: tuple[int, ...], nodes: np.ndarray = np.zeros(0, int),
              facing: np.ndarray = np.zeros((0, 2)), moved: bool = True):
        """The Side about `about`, with the initial geometry's lengths and radii.

        Where it was at first unless it has `moved`.

        Also gids of its nodes, labels of its edges, which of its nodes the contact `nodes` are, and
        its nodes (k, 2) that are the two of a corner.
        """
        here = np.isin(self.label, labels)
        gids, first, inverse = np.unique(self.gid[here], return_index=True, return_inverse=True)
        xy, u = self.xy[here], self.u[here] * moved
        edges = inverse.reshape(-1, self.nodes)
        edges, copied, places = split(edges, _normals(xy), np.searchsorted(gids, nodes), facing)
        twins = np.column_stack([copied, len(gids) + np.arange(len(copied))])
        first, gids = np.append(first, first[copied]), np.append(gids, gids[copied])
        length = np.linalg.norm(xy[:, 1] - xy[:, 0], axis=1)
        radius = xy.reshape(-1, 2)[first, 0] if self.axisymmetric else None
        curved = {}
        if self.nodes == 2:
            rise = sagitta(xy.reshape(-1, 2)[first], edges)
        else:  # middles stay on the straight edge between the ends
            curved = rises(xy)
            straight = u[:, :2].mean(axis=1)
            bow, u[:, 2] = self.bow[here] + u[:, 2] - straight, straight
            if curved:
                bow = bow + curved["rise"]
                xy = np.concatenate([xy[:, :2], xy[:, :2].mean(axis=1, keepdims=True)], axis=1)
        xy = xy + u
        normal = _normals(xy)
        if self.nodes == 2:
            bow = rise[:, None] * normal
        side = Side(xy.reshape(-1, 2)[first], edges, normal, bow, length, radius, **curved)
        return side, gids, self.label[here], places, twins


def _missed(pairs: list[tuple[int, int]], met: np.ndarray) -> list[tuple[int, int]]:
    """Of the `pairs` of a first label that is to meet several those whose second one is not `met`.
    """
    firsts = [one for one, _ in pairs]
    return [(one, two) for one, two in pairs if firsts.count(one) > 1 and two not in met]


def _normals(xy: np.ndarray) -> np.ndarray:
    """(e, 2) outward unit normals of straight edges between the first two of places (e, k, 2)."""
    x, y = (xy[:, 1] - xy[:, 0]).T
    return np.column_stack([y, -x]) / np.hypot(x, y)[:, None]
