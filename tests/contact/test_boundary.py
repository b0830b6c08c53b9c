"""The contact boundary of nodes made by hand: their order, what supports take, what is added."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from driver.contact.beside import beside
from driver.contact.boundary import ContactBoundary
from driver.contact.chains import Chains, chains
from driver.contact.corner_pairs import corner_pairs
from driver.contact.curve import through
from driver.contact.following import Following, Outline, Plane
from driver.contact.found_nodes import FoundNodes
from driver.contact.joints import appended
from driver.contact.motion import ObstacleMotion
from driver.contact.nodes import merge_parts
from driver.contact.pair_sides import Coupled
from driver.errors import InputError

# labels and ends of edges by vertices: 6 goes on in 5; 5 has two pieces; 8 turns a corner at 13
EDGES = {5: [(3, 4), (1, 9), (4, 7)], 6: [(7, 2)], 8: [(12, 13), (13, 14)]}
PLACE = {3: (0, 0), 4: (1, 0), 7: (3, 0), 2: (3.5, 0), 9: (8, 0), 1: (6, 0),
         12: (0, -5), 13: (2, -5), 14: (2, -4)}


def found(middles=False, turn=0.0) -> tuple:
    """Contact nodes and the skeleton of these edges; `turn` of the whole."""
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    place = {k: spin @ xy for k, xy in PLACE.items()}
    rows, edges = [], {}
    for label, ends in EDGES.items():
        edges[label] = []
        for a, b in ends:
            along = place[b] - place[a]
            if label != 8:  # walked the other way round
                along = -along
            size, outward = np.linalg.norm(along), np.array([along[1], -along[0]])
            shares = {a: 0.5, b: 0.5}
            if middles:
                middle = 100 + 10 * a + b
                place[middle] = (place[a] + place[b]) / 2
                shares = {a: 1 / 6, b: 1 / 6, middle: 4 / 6}
            edges[label].append((a, b, *list(shares)[2:]))
            rows += [(label, k, part * size, *(part * outward), part * size * k, *place[k])
                     for k, part in shares.items()]
    nodes = merge_parts(np.array(rows), ["gap"], [])
    return nodes, SimpleNamespace(labelled=lambda label: np.array(edges[label]))


@pytest.mark.parametrize("turn", [0.0, 2.0])
@pytest.mark.parametrize("middles", [False, True])
def test_nodes_follow_one_another_along_chains(middles, turn):
    """Labels that share a node, and pieces without corners, have one arc; what turns a corner is a
    chain of its own on either side.
    """
    nodes, skeleton = found(middles, turn)
    along = chains(nodes, skeleton)
    number = {}
    for k, gid in enumerate(nodes.gid):
        number.setdefault(int(gid), set()).add(int(along.number[k]))
    plain = {gid: next(iter(of)) for gid, of in number.items() if len(of) == 1}
    assert len({plain[k] for k in (1, 2, 3, 4, 7, 9)}) == 1
    assert plain[12] != plain[14] and number[13] == {plain[12], plain[14]}
    assert plain[3] not in (plain[12], plain[14])
    # within a piece arcs differ by distances, and go on from piece to piece
    arc = {int(gid): along.arc[k] for k, gid in enumerate(nodes.gid)}
    assert abs(arc[4] - arc[3]) == pytest.approx(1) and abs(arc[7] - arc[4]) == pytest.approx(2)
    assert abs(arc[2] - arc[7]) == pytest.approx(0.5) and abs(arc[9] - arc[1]) == pytest.approx(2)
    assert abs(arc[3] - arc[2]) == pytest.approx(3.5)
    ends = {3: 0, 2: 3.5, 1: 3.5, 9: 5.5}  # from the end with the smaller x
    if turn:
        ends = {9: 0, 1: 2, 2: 2, 3: 5.5}
    assert {k: arc[k] for k in ends} == pytest.approx(ends)
    ordered = np.column_stack([along.number, along.arc])[along.order]
    assert (np.diff(ordered[:, 0]) >= 0).all()
    assert all(b[1] >= a[1] for a, b in zip(ordered, ordered[1:]) if a[0] == b[0])
    pairs = {tuple(sorted(nodes.gid[list(edge)].tolist())) for edge in along.edges}
    assert pairs == {tuple(sorted(edge)) for of in EDGES.values() for edge in of}
    assert len(along.middles) == (6 if middles else 0)
    if middles:
        np.testing.assert_allclose(nodes.xy[along.middles], nodes.xy[along.edges].mean(axis=1))
    # at the corner the node of an edge is the one that faces as the edge does
    for a, b in along.edges:
        chord = nodes.xy[b] - nodes.xy[a]
        facing = np.array([chord[1], -chord[0]]) / np.linalg.norm(chord)
        assert abs(nodes.normal[[a, b]] @ facing) == pytest.approx(1.0)


def test_an_edge_without_contact_nodes_is_refused():
    nodes, skeleton = found()
    skeleton.labelled = lambda label: np.array([(3, 99)])
    with pytest.raises(InputError, match="label 5 has an end that is no contact node"):
        chains(nodes, skeleton)


def boundary(fixed=(np.empty(0, int), np.zeros((0, 1))), motion=None) -> ContactBoundary:
    """Rigid contact of these nodes, with keys 2 gid + component of what supports fix."""
    nodes, skeleton = found()
    whole = FoundNodes(nodes, chains(nodes, skeleton), fixed, np.zeros(len(nodes.gid), bool), False)
    return whole.boundary(nodes.columns["gap"].copy(), motion and motion(nodes), None)


def test_clamped_nodes_have_no_condition_and_keep_what_supports_prescribe():
    """One that is held in one component alone stays. In the order of chains and arcs."""
    keys = np.array([2 * 3 + 1, 2 * 4, 2 * 4 + 1, 2 * 9 + 1, 2 * 13, 2 * 13 + 1])
    values = np.arange(12.0).reshape(6, 2)
    b = boundary((keys, values))
    assert sorted(b.gid.tolist()) == [1, 2, 3, 7, 9, 12, 14]
    assert sorted(b.clamped.gid.tolist()) == [4, 13, 13]
    at = b.clamped.gid.tolist().index(4)
    np.testing.assert_array_equal(b.clamped.values[at], values[1:3])
    np.testing.assert_array_equal(b.clamped.values[b.clamped.gid == 13], [values[4:], values[4:]])
    np.testing.assert_allclose(b.clamped.xy[at], PLACE[4])
    np.testing.assert_allclose(b.clamped.gap[at], 4.0)  # the column is the number of the vertex
    np.testing.assert_allclose(b.gap, b.gid)
    assert (np.diff(b.chain) >= 0).all() and not b.paired.any()
    np.testing.assert_array_equal(b.term_gid[np.argsort(b.term_node)], b.gid)
    assert (b.term_value == 1).all() and not b.term_other.any()
    gid = np.concatenate([b.gid, b.clamped.gid])
    assert {tuple(sorted(gid[list(edge)].tolist())) for edge in b.edges} == {
        tuple(sorted(edge)) for of in EDGES.values() for edge in of}
    np.testing.assert_allclose(b.tangent, np.column_stack([-b.normal[:, 1], b.normal[:, 0]]))
    np.testing.assert_allclose(b.weight[b.gid == 7], 1.25)
    assert b.at(3.0) is b and b.way(0.0, 1.0) == 0.0 and not b.moves and b.start is b


def moving(nodes) -> ObstacleMotion:
    """Obstacles that come nearer by the vertex' number times the time, and go along x."""
    n, times = len(nodes.gid), np.array([0.0, 1.0])
    shift = np.zeros((2, n, 2))
    shift[1, :, 0] = 0.25
    tangent = np.column_stack([-nodes.normal[:, 1], nodes.normal[:, 0]])
    return ObstacleMotion(times, 100 - np.outer(times, nodes.gid), shift, np.zeros((2, n)),
                          np.zeros((n, 2)), nodes.xy, tangent)


def test_nodes_that_face_nothing_yet_have_rows_of_their_own():
    """Where contact follows the motion: what faces the other body has that one's terms alone, and
    weights are those of boundaries faced as a whole; without following, only what faces counts.
    """
    nodes, skeleton = found()
    here = np.flatnonzero(nodes.label == 8)
    nodes.family[here], nodes.meeting = 1, [[(8, 9)]]
    covered, none = np.arange(len(here)) % 2 == 0, np.zeros(len(here))
    whole = nodes.weight[here]
    sides = SimpleNamespace(about=None, periods=None, couple=lambda _, met, *rest: Coupled(
        np.where(covered, 0.5 * whole, 0.0), nodes.length[here], met.facing, none, none > 0,
        none > 0, (np.flatnonzero(covered), np.full(covered.sum(), 77),
                   np.full(covered.sum(), -1.0), np.ones(covered.sum(), bool))))
    made = FoundNodes(nodes, chains(nodes, skeleton), (np.empty(0, int), np.zeros((0, 1))),
                      np.zeros(len(nodes.gid), bool), False)
    follows = made.boundary(nodes.columns["gap"].copy(), None, sides,
                            SimpleNamespace(reach=1.0, lost=None))
    paired = np.flatnonzero(follows.paired)
    own = [set(follows.term_gid[follows.term_node == k]) for k in paired]
    assert all(of == ({77} if part > 0 else {follows.gid[k]})
               for of, part, k in zip(own, follows.covered[paired], paired))
    assert sorted(follows.covered[paired]) == sorted(0.5 * covered)
    np.testing.assert_allclose(np.sort(follows.weight[paired]), np.sort(whole))
    rest = np.flatnonzero(~follows.paired)
    assert all(follows.term_gid[follows.term_node == k].tolist() == [follows.gid[k]] for k in rest)
    plain = made.boundary(nodes.columns["gap"].copy(), None, sides)
    assert plain.paired.sum() == covered.sum() and plain.covered is None
    np.testing.assert_allclose(np.sort(plain.weight[plain.paired]), np.sort(0.5 * whole[covered]))


def test_distances_to_obstacles_that_move():
    b = boundary((np.array([8, 9]), np.zeros((2, 1))), moving)
    assert (b.gap == 100).all() and b.moves
    now = b.at(1.0)
    np.testing.assert_allclose(now.gap, 100 - b.gid)
    assert now.clamped.gap.tolist() == [96.0]
    np.testing.assert_allclose(b.way(0.0, 1.0), 0.25 * b.tangent[:, 0])


def test_rows_of_joints_come_last_and_are_left_out_again():
    """They have no gap, move with nothing, and carry their own terms."""
    b = boundary(motion=moving)
    n = len(b.gid)
    parts = [{"gid": np.array([40, 41]), "label": np.array([9, 9]), "chain": np.array([7, 7]),
              "xy": np.ones((2, 2)), "arc": np.arange(2.0), "weight": np.ones(2),
              "length": np.ones(2), "normal": np.tile(np.eye(2)[c], (2, 1)),
              "term_node": np.array([0, 1, 1]), "term_gid": np.array([40, 41, 50]),
              "term_value": np.array([1.0, 1.0, -1.0]), "term_other": np.array([0, 0, 1], bool)}
             for c in (0, 1)]
    whole = appended(b, parts)
    assert len(whole.gid) == n + 4 and whole.is_joint.sum() == 4 and whole.joined == 4
    assert whole.gap[n:].tolist() == [0] * 4 and (whole.normal_row == -1).all()
    assert whole.term_node[-6:].tolist() == [n, n + 1, n + 1, n + 2, n + 3, n + 3]
    assert (whole.family[n:] == 1).all() and not whole.middle[n:].any()
    assert not whole.way(0.0, 1.0)[n:].any() and not whole.at(1.0).gap[n:].any()
    np.testing.assert_array_equal(whole.columns["gap"], np.append(b.columns["gap"], np.zeros(4)))
    back = whole.declared
    assert back.declared is back and back.joined == 0
    for name in ("gid", "gap", "weight", "term_node", "term_gid", "term_value", "normal"):
        np.testing.assert_array_equal(getattr(back, name), getattr(b, name))
    np.testing.assert_array_equal(back.at(1.0).gap, b.at(1.0).gap)
    part = np.linspace(0.0, 1.0, n + 4)
    assert replace(whole, covered=part).declared.covered.tolist() == part[:n].tolist()
    assert back.has_rows_of(b)
    back.normal[0] *= 1 + 1e-15
    assert not back.has_rows_of(b) or (back.normal[0] == b.normal[0]).all()


def test_neighbours_beside_corners_between_bodies():
    """The nearer one of the two along each flank, with the forces that its tractions make here."""
    xy = np.array([[0.0, 0], [1, 0], [3, 0], [3, 0], [3, 0.5], [3, 4]])
    contact = SimpleNamespace(
        xy=xy, chain=np.array([0, 0, 0, 1, 1, 1]), family=np.ones(6, int), paired=np.ones(6, bool),
        normal_row=np.arange(6), tangential_row=np.arange(6, 12),
        weight=np.array([1.0, 2.0, 3.0, 0.5, 4.0, 1.0]))
    of = beside(contact, np.array([[2, 3]]), lambda rows: rows)
    assert of.rows.tolist() == [[[1, 7], [4, 10]]] and of.known.all()
    np.testing.assert_allclose(of.ratio, [[3 / 2, 0.5 / 4]])
    x = np.arange(12.0)
    comm = SimpleNamespace(allgather=lambda mine: [mine, mine])
    np.testing.assert_allclose(of.forces(x, comm), 2 * np.array([[
        [1.5 * 1, 1.5 * 7], [4 / 8, 10 / 8]]]))
    alone = beside(contact, np.array([[2, 3]]), lambda rows: np.where(rows == 7, -1, rows))
    assert alone.forces(x, comm)[0, 0].tolist() == [3.0, 0.0]
    contact.chain[1] = 5
    assert not beside(contact, np.array([[2, 3]]), lambda rows: rows).known.any()


# ------------------------------------------------------------------------------ obstacles that move

class Faced:
    """Boundaries of the nodes of label 8, every second of which faces another body at a distance of
    2 along its normal, wherever it is.
    """

    about = periods = None

    def __init__(self, nodes):
        self.nodes, self.here = nodes, np.flatnonzero(nodes.label == 8)
        nodes.family[self.here], nodes.meeting = 1, [[(8, 9)]]
        self.gid, self.configuration = np.array([500, 501]), None

    def displaced(self, configuration):
        self.configuration = configuration
        return self

    def couple(self, pairs, nodes, reach, _without):
        assert pairs == [(8, 9)] and reach == 7.0 and nodes.heir is None
        faces = np.arange(len(nodes.gid)) % 2 == 0
        weight = np.where(faces, self.nodes.weight[self.here], 0.0)
        node = np.flatnonzero(faces)
        none = np.zeros(len(faces), bool)
        return Coupled(weight, self.nodes.length[self.here], nodes.facing,
                       np.full(len(faces), 2.0), none, none,
                       (node, nodes.gid[node], np.ones(len(node)), none[node]))


@pytest.fixture(name="follower")
def _follower():
    """Contact nodes that follow their motion over a plane that comes and shifts, and Faced."""
    nodes, skeleton = found()
    nodes.normal[nodes.label != 8] = [0.0, -1.0]
    sides, n = Faced(nodes), len(nodes.gid)
    motion = replace(moving(nodes), gap=np.zeros((2, n)))
    motion.shift[1] = [0.25, 0.125]
    plane = Plane(nodes.normal, np.arange(n) + 3.0)
    following = Following(nodes, motion, plane, 7.0)
    made = FoundNodes(nodes, chains(nodes, skeleton), (np.zeros(0, int), np.zeros((0, 1))),
                      np.zeros(n, bool), False)
    first = following.first(made, np.full(n, 0.5), sides)
    first.normal_row[:], first.tangential_row[:] = np.arange(n), n + np.arange(n)
    following.settle(first)
    return following, first, sides


def test_what_follows_has_the_condition_of_the_plane_about_any_displacement(follower):
    """n . u <= gap with the same gap: that of the plane as it stands at the time, of the other body
    beyond what is added to its geometry; rows are those of the first boundary.
    """
    following, first, sides = follower
    nodes, gids = following.nodes, following.gids
    assert gids.tolist() == sorted({*nodes.gid.tolist(), 500, 501}) and first.start is first
    moved = np.random.default_rng(3).standard_normal((len(gids), 2))
    for time in (0.0, 1.0):
        about = following.about(moved, time)
        assert sides.configuration.u is moved and about.about.gid is gids and about.time == time
        u = moved[np.searchsorted(gids, about.gid)]
        rigid = ~about.paired
        order = np.array([np.flatnonzero((nodes.gid == g) & (nodes.label == label)
                                         & (np.abs(nodes.normal - normal).sum(axis=1) < 1e-9))[0]
                          for g, label, normal in zip(about.gid, about.label, about.normal)])
        offset = (order + 3.0 - (about.normal * nodes.xy[order]).sum(axis=1)
                  + (about.normal * [0.25 * time, 0.125 * time]).sum(axis=1))
        np.testing.assert_allclose(about.gap[rigid], offset[rigid], rtol=1e-12)
        faces = about.paired & ~about.idle
        np.testing.assert_allclose(about.gap[faces], 0.5 + 2.0)
        # what faces nothing may go as far as it is asked to be followed
        idle = about.idle
        assert 0 < idle.sum() < faces.sum() + idle.sum()
        np.testing.assert_allclose(about.gap[idle], 7.0 + (about.normal * u).sum(axis=1)[idle])
        np.testing.assert_array_equal(about.motion.gap_at(5.0), about.gap)
        np.testing.assert_allclose(about.motion.xy, nodes.xy[order] + u)
        np.testing.assert_allclose(about.motion.tangent, about.tangent)
        np.testing.assert_array_equal(about.normal_row, first.normal_row)
        np.testing.assert_array_equal(about.tangential_row, first.tangential_row)


def test_gaps_are_along_the_normals_where_nodes_come_to(follower, monkeypatch):
    """Of an obstacle that is steeper there than where the nodes were: n_w . u <= d_w + n_w . w."""
    following, _, _ = follower
    there = np.array([0.6, -0.8])
    monkeypatch.setattr(following, "surface", SimpleNamespace(
        distance=lambda place, nodes: (np.full(len(place), 0.25), np.tile(there, (len(place), 1)))))
    moved = np.random.default_rng(4).standard_normal((len(following.gids), 2))
    about = following.about(moved, 0.0)
    u, rigid = moved[np.searchsorted(following.gids, about.gid)], ~about.paired
    assert rigid.any()
    np.testing.assert_allclose(about.normal[rigid], np.tile(there, (rigid.sum(), 1)))
    np.testing.assert_allclose(about.gap[rigid], 0.25 + u[rigid] @ there)


def test_joints_are_rows_of_what_follows_as_well(follower, monkeypatch):
    following, _, _ = follower
    monkeypatch.setattr("driver.contact.joints.appended",
                        lambda boundary, rows: replace(boundary, joined=len(rows)))
    moved = np.zeros((len(following.gids), 2))
    assert following.about(moved, 0.0).joined == 0
    following.joints = ["a row", "another"]
    assert following.about(moved, 0.0).joined == 2


def test_times_after_the_last_are_those_of_the_cycle():
    """From the one it begins with on; the end of a cycle is itself, not its beginning."""
    n, times = 1, np.array([0.0, 1.0, 2.0, 3.5, 5.0])
    motion = ObstacleMotion(times, np.arange(5.0)[:, None], np.zeros((5, n, 2)), np.zeros((5, n)),
                            np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 2)), again=1)
    for time, index in ((0.0, 0), (1.0, 1), (5.0, 4), (5.0 + 1e-12, 4), (6.0, 2), (7.5, 3),
                        (9.0, 1), (10.0, 2), (13.5 + 2, 3)):
        assert motion.index(time) == index and motion.gap_at(time) == index
    assert motion.padded(0) is motion
    more = motion.padded(2)
    assert more.gap.shape == (5, 3) and not more.gap[:, 1:].any() and more.pivot.shape == (3, 2)
    assert more.shift.shape == (5, 3, 2) and more.tangent.shape == more.xy.shape == (3, 2)
    assert not motion.returns()
    motion.gap[4] = 1.0
    assert motion.returns()
    motion.angle[4] = 1.0
    assert not motion.returns()
    motion.angle[4] = -2.4e-16  # sin(2 pi), and all along the history
    assert motion.returns()


def test_a_moving_outline_is_seen_from_where_it_stands():
    """A circle that has shifted and turned about a point: distances and normals of the circle
    there; of a plane what is left of its offset.
    """
    angle = np.linspace(0, 2 * np.pi, 41)
    ends = np.column_stack([np.cos(angle), np.sin(angle)])
    outline = Outline(through(np.column_stack([ends[:-1], ends[1:], ends[:-1], ends[1:]])),
                      np.array([-3.0, 3.0, -3.0, 3.0]))
    place = np.array([[2.0, 0.5], [1.0, 1.5], [0.0, 0.0]])
    shift, turn, pivot = np.array([0.5, 0.25]), 0.7, np.array([1.0, 0.0])
    motion = ObstacleMotion(np.array([0.0, 1.0]), np.zeros((2, 3)),
                            np.array([np.zeros((3, 2)), np.tile(shift, (3, 1))]),
                            np.outer([0.0, turn], np.ones(3)), np.tile(pivot, (3, 1)), place,
                            np.zeros((3, 2)))
    nodes = SimpleNamespace(family=np.array([0, 0, 1]))
    following = Following(nodes, motion, outline, 1.0)
    distance, normal = following._from_obstacles(place[:2], 1.0)
    arm = -pivot
    centre = pivot + shift + [np.cos(turn) * arm[0] - np.sin(turn) * arm[1],
                              np.sin(turn) * arm[0] + np.cos(turn) * arm[1]]
    away = place[:2] - centre
    far = np.linalg.norm(away, axis=1)
    np.testing.assert_allclose(distance, far - 1, atol=6e-6)  # cubics between points
    np.testing.assert_allclose(normal, -away / far[:, None], atol=1e-3)
    before, _ = following._from_obstacles(place[:2], 0.0)
    np.testing.assert_allclose(before, np.linalg.norm(place[:2], axis=1) - 1, atol=6e-6)
    still, _ = Following(nodes, None, outline, 1.0)._from_obstacles(place[:2], 1.0)
    np.testing.assert_allclose(still, before)
    plane = Plane(np.tile([0.6, 0.8], (3, 1)), np.array([2.0, 3.0, 9.0]))
    distance, normal = plane.distance(place[:2], np.array([0, 1]))
    np.testing.assert_allclose(distance, [2 - 1.6, 3 - 1.8])
    np.testing.assert_allclose(normal, [[0.6, 0.8]] * 2)
    none = Following(SimpleNamespace(family=np.ones(3, int)), motion, outline, 1.0)
    assert not len(none._from_obstacles(np.zeros((0, 2)), 1.0)[0])


@pytest.mark.parametrize("place", [[3.1, 0], [-3.1, 0], [0, 3.1], [0, -3.1]])
def test_places_out_of_the_box_are_said(place):
    outline = Outline(None, np.array([-3.0, 3.0, -3.0, 3.0]))
    with pytest.raises(InputError, match=re.escape("({:.4g}, {:.4g})".format(*place))) as said:
        outline.distance(np.array([[0.0, 0.0], place]), np.arange(2))
    assert "by 0.1 farther than largeSliding says" in str(said.value)


def vertex(normals, fixed=(), **more):
    """What is paired of contact nodes at one vertex with these normals."""
    normals = np.array(normals, float)
    n = len(normals)
    contact = SimpleNamespace(**{
        "gid": np.full(n, 5), "xy": np.ones((n, 2)), "normal": normals,
        "tangent": np.column_stack([-normals[:, 1], normals[:, 0]]),
        "normal_row": np.arange(n), "tangential_row": n + np.arange(n), "paired": np.zeros(n, bool),
        "term_node": np.arange(n), "term_gid": np.full(n, 5), "term_value": np.ones(n),
        "term_other": np.zeros(n, bool)}, **more)
    contact.declared = contact
    smooth = np.zeros(len(contact.gid), bool)
    return corner_pairs(contact, np.array(fixed, int), smooth)


def test_conditions_that_depend_at_a_vertex():
    """Four rows on two displacements; a support leaves one; obstacles may face one another. More
    than two nodes that depend are refused.
    """
    assert vertex([[0, -1], [1, 0]]).tolist() == [[0, 1, 2, 1]]
    assert vertex([[0, -1], [0.6, -0.8]], fixed=[10]).tolist()[0][:3] == [0, 1, 1]
    assert vertex([[0, -1], [0, 1]]).tolist()[0][:3] == [0, 1, 1]
    assert not len(vertex([[0, -1]]))
    with pytest.raises(InputError, match=r"contact at \(1, 1\): more than two conditions"):
        vertex([[0, -1], [1, 0], [0, 1]])


@pytest.mark.parametrize("curved", [False, True])
def test_middles_of_edges_on_the_axis_have_no_condition(curved):
    """Their displacement counts in those of the ends, whose conditions are of several nodes; with
    curved sides weights are the export's. Gaps are means likewise.
    """
    r = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    n, gap = len(r), np.array([5.0, 4.0, 3.0, 2.0, 1.0])
    nodes = SimpleNamespace(
        gid=np.arange(n), label=np.ones(n, int), family=np.zeros(n, int),
        xy=np.column_stack([r, 0 * r]), weight=10.0 + r, length=np.full(n, 0.5),
        normal=np.tile([0.0, -1.0], (n, 1)), columns={}, meeting=[])
    along = Chains(r, np.zeros(n, int), np.arange(n), np.array([[0, 2], [2, 4]]), np.array([1, 3]))
    found_ = FoundNodes(nodes, along, (np.zeros(0, int), np.zeros((0, 1))),
                        np.array([False, True] * 2 + [False]), True, curved)
    b = found_.boundary(gap.copy(), None, None)
    assert b.gid.tolist() == [0, 2, 3, 4] and b.middle.tolist() == [False, False, True, False]
    if curved:
        np.testing.assert_array_equal(b.weight, [10, 11, 11.5, 12])
    else:
        assert b.weight.sum() == pytest.approx(np.pi * 4)
    sums = np.bincount(b.term_node, b.term_value)
    np.testing.assert_allclose(sums, 1.0)  # what is uniform passes
    np.testing.assert_allclose(b.gap, np.bincount(b.term_node, b.term_value * gap[b.term_gid]))
    assert b.coupled.tolist() == [True, True, False, False]
    assert not replace(b, axisymmetric=False).coupled.any()


@pytest.mark.parametrize("gap, expected", [
    (lambda x: 0.0 * x, True), (lambda x: 0.3 * x**2, True), (lambda x: np.sqrt(4 - x**2), True),
    (lambda x: 0.01 * x, False), (lambda x: 0.3 * (x + 1) ** 2, False),
    (lambda x: 0.3 * (x + 0.01) ** 2, True)],  # no mesh of these edges tells this from level
    ids=["flat", "parabola", "circle", "wedge", "beyond", "nearly"])
@pytest.mark.parametrize("side", [1, -1])
def test_an_obstacle_with_a_slope_at_a_line_of_symmetry_has_a_kink_there(gap, expected, side):
    """At either end of a boundary of any orientation."""
    x = np.array([0.0, 0.1, 0.25, 0.35, 0.5])[::side]
    place = 1.0 + side * x  # its arc ascends
    nodes = SimpleNamespace(guided=x == 0, normal_row=np.arange(5), paired=x < 0,
                            normal=np.tile([0.0, -1.0], (5, 1)), tangent=np.tile([1.0, 0], (5, 1)),
                            chain=np.zeros(5, int), arc=place, gap=gap(x))
    nodes._level_at = lambda end: ContactBoundary._level_at(nodes, end)
    assert ContactBoundary.mirrored.fget(nodes).tolist() == [expected and k == 0 for k in x]
    nodes.paired = x >= 0  # polygons of two bodies say nothing of slopes
    assert ContactBoundary.mirrored.fget(nodes).any()


def test_what_supports_leave_no_condition_hands_its_weight_on():
    """To the other end of each of its edges, or to their middles; the sum stays."""
    lost = np.array([True, False, False, True, False])
    amount = np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    along = SimpleNamespace(edges=np.array([[0, 1], [1, 2], [2, 3], [3, 4]]),
                            middles=np.zeros(0, int))
    assert Chains.handed_on(along, amount, lost).tolist() == [0, 3, 8, 0, 20]
    assert Chains.handed_on(along, amount, np.zeros(5, bool)) is amount
    along = SimpleNamespace(edges=np.array([[0, 1], [1, 3]]), middles=np.array([4, 2]))
    assert Chains.handed_on(along, amount, lost).tolist() == [0, 2, 12, 0, 17]
