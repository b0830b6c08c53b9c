"""Sides of pairs and joints, rings of bodies of revolution: integrals, normals, corners."""

import numpy as np
import pytest

from driver.contact import joints, rings
from driver.contact.axis import on_axis, smooth_normals
from driver.contact.side import Side, before_flanks, rises, sagitta, split
from driver.errors import InputError
from driver.scene import sides


def normals(xy: np.ndarray) -> np.ndarray:
    """(e, 2) outward unit normals of chords from xy[:, 0] to xy[:, 1]."""
    x, y = (xy[:, 1] - xy[:, 0]).T
    return np.column_stack([y, -x]) / np.hypot(x, y)[:, None]


def meridian(shape: str, count: int):
    """Ends and middles (places, edges, middles) along a meridian that begins on the axis."""
    s = np.linspace(0, 1, 2 * count + 1) ** 1.2
    r, z = {"cone": (2 * s, 1 - s), "disc": (3 * s, 0 * s),
            "sphere": (np.sin(s * np.pi / 2), np.cos(s * np.pi / 2))}[shape]
    xy = np.column_stack([r, z])
    if shape != "sphere":
        xy[1::2] = (xy[:-1:2] + xy[2::2]) / 2
    at = np.arange(0, 2 * count, 2)
    return xy, np.column_stack([at, at + 2]), at + 1


# ------------------------------------------------------------------------------ rings

AREA = {"cone": np.pi * 2 * np.sqrt(5), "disc": 9 * np.pi, "sphere": 2 * np.pi}


@pytest.mark.parametrize("shape", AREA)
def test_rings_add_up_to_the_surface_and_pass_what_is_uniform(shape):
    """Where edges begin on the axis multipliers belong to their ends, dual to the hat functions:
    their rows see a hat at its own node alone. Elsewhere a row is the node's own displacement.
    """
    xy, edges, middles = meridian(shape, 6)
    weight, (row, other, value) = rings.ring_rows(xy, edges, middles)
    assert weight.sum() == pytest.approx(AREA[shape], rel=1e-4 if shape == "sphere" else 1e-13)
    assert weight[middles[0]] == 0.0 and (np.delete(weight, middles[0]) > 0).all()
    rows = np.zeros((len(xy), len(xy)))
    np.add.at(rows, (row, other), value)
    used = weight > 0
    np.testing.assert_allclose(rows.sum(axis=1), used, atol=1e-12)
    hats = np.zeros((len(xy), 2))  # of both ends of the edge on the axis
    hats[[0, 1, 2], [0, 0, 1]], hats[1, 1] = (1.0, 0.5, 1.0), 0.5
    alone = rows @ hats
    np.testing.assert_allclose(alone[[0]], [[1, 0]], atol=1e-12)
    # of the second end the next edge has a share, of its own node
    assert alone[2, 1] == pytest.approx(1.0) and alone[2, 0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(rows[3:, 3:], np.eye(len(xy) - 3), atol=1e-15)
    assert not rows[3:, :3].any()


def test_rings_of_linear_elements_are_integrals_of_hats():
    """Of a cone: a hat from r to R at a distance L has 2 pi L (2 r + R)/6 of it."""
    xy = np.array([[0.0, 0.0], [1.0, 2.0], [4.0, 6.0]])
    weight, (row, other, value) = rings.ring_rows(xy, np.array([[0, 1], [1, 2]]),
                                                  np.zeros(0, int))
    first, second = np.sqrt(5), 5.0
    np.testing.assert_allclose(weight, 2 * np.pi / 6 * np.array([
        first * 1, first * 2 + second * (2 + 4), second * (8 + 1)]), rtol=1e-14)
    assert row.tolist() == other.tolist() == [0, 1, 2] and (value == 1).all()


def test_normals_on_the_axis():
    """Upright on a sphere, whose next node's is turned twice as far, and on no cone; a surface that
    looks down stays so.
    """
    angle = np.array([0.05, 0.1, 0.3])
    edges, radius = np.array([[0, 1], [1, 2]]), np.array([0.0, 1.0, 2.0])
    for sign in (1, -1):
        sphere = np.column_stack([np.sin(angle), sign * np.cos(angle)])
        for order in (edges, edges[:, ::-1]):
            smooth = smooth_normals(sphere, order, radius)
            np.testing.assert_allclose(smooth, [[0, sign], *sphere[1:]], atol=1e-15)
        cone = np.tile(sphere[2], (3, 1))
        np.testing.assert_array_equal(smooth_normals(cone, edges, radius), cone)
    assert on_axis(np.array([1e-10, -1e-10, 1e-8, 1.0])).tolist() == [True, True, False, False]


# ------------------------------------------------------------------------------ sides

def arc(count: int, R=2.0, turn=1.2, uneven=0.0):
    """Places of an arc that has the body on its left when walked, and its edges."""
    angle = turn * np.linspace(0, 1, count + 1) ** (1 + uneven)
    xy = R * np.column_stack([np.cos(angle), np.sin(angle)])
    at = np.arange(count)
    return xy, np.column_stack([at, at + 1])


def test_heights_of_chords_below_their_circle():
    """L^2/8R in second order, R the radius, at ends of the side too; none on a bend to both sides,
    and negative round a hole.
    """
    xy, edges = arc(12)
    length = 2 * 2 * np.sin(0.05)
    np.testing.assert_allclose(sagitta(xy, edges), length**2 / 16, rtol=0.05**2)
    np.testing.assert_allclose(sagitta(xy, edges[:, ::-1]), -length**2 / 16, rtol=0.05**2)
    wave = np.array([[0.0, 0], [1, 0.1], [2, 0.1], [3, 0.2]])
    flat = sagitta(wave, np.array([[0, 1], [1, 2], [2, 3]]))
    assert flat[1] == 0.0 and flat[0] * flat[2] < 0
    sharper = np.array([[0.0, 0], [1, 0], [2, -0.1], [3, -0.4]])
    turned = np.arctan(0.1) / ((1 + np.hypot(1, 0.1)) / 2)
    bends = sagitta(sharper, np.array([[0, 1], [1, 2], [2, 3]]))
    assert abs(bends[1]) == pytest.approx(turned * 1.01 / 8, rel=1e-3)  # of the wider circle


@pytest.mark.parametrize("uneven", [0.0, 0.5])
def test_normals_at_vertices_of_an_arc_are_radial(uneven):
    """However lengths change from edge to edge: to second order in their turn."""
    xy, edges = arc(12, uneven=uneven)
    side = Side(xy, edges, normals(xy[edges]))
    inner = slice(1, -1)
    error = np.abs(side.nodal_normals() - xy / 2)[inner].max()
    assert error < 0.1**2 / 8
    # middles, and the two ends, have the mean direction of the ends of their edge
    with_middles = np.column_stack([edges, 13 + np.arange(12)])
    places = np.concatenate([xy, xy[edges].mean(axis=1)])
    whole = Side(places, with_middles, normals(xy[edges])).nodal_normals()
    np.testing.assert_allclose(whole[:13], side.nodal_normals(), rtol=1e-14)
    mean = whole[edges].sum(axis=1)
    np.testing.assert_allclose(whole[13:], mean / np.linalg.norm(mean, axis=1)[:, None], rtol=1e-14)


def test_curved_edges_have_their_own_length_normal_and_ring():
    """Parabolas: force of a uniform pressure, arc length per chord, and circumference."""
    end, middle = np.array([[1.0, 0.0], [3.0, 1.0]]), np.array([[2.2, 0.1]])
    xy = np.concatenate([end, middle])
    known = rises(xy[None])
    assert not rises(np.array([[*end, end.mean(axis=0)]]))
    chord, rise = known["chord"][0], known["rise"][0]
    np.testing.assert_allclose(chord, [2, 1])
    np.testing.assert_allclose(rise, [0.2, -0.4])
    flat = np.concatenate([end, end.mean(axis=0)[None]])
    side = Side(flat, np.array([[0, 1, 2]]), normals(flat[None]), known["rise"], radius=flat[:, 0],
                **known)
    xi = (np.arange(4000) + 0.5) / 4000
    e = np.zeros(4000, int)
    tangent = chord + 4 * (1 - 2 * xi)[:, None] * rise
    speed = np.linalg.norm(tangent, axis=1)
    np.testing.assert_allclose(side.stretch(e, xi) * np.linalg.norm(chord), speed, rtol=1e-13)
    r = 1 + 2 * xi + 4 * xi * (1 - xi) * 0.2
    np.testing.assert_allclose(side.ring(e, xi), 2 * np.pi * r, rtol=1e-13)
    force, length = side.uniform()
    np.testing.assert_allclose(force.sum(axis=0), [1, -2], rtol=1e-13)
    phi = np.array([(1 - xi) * (1 - 2 * xi), xi * (2 * xi - 1), 4 * xi * (1 - xi)])
    np.testing.assert_allclose(force, (phi @ np.column_stack([tangent[:, 1], -tangent[:, 0]]))
                               / 4000, atol=1e-6)
    np.testing.assert_allclose(length, phi @ speed / 4000, rtol=2e-3)
    np.testing.assert_allclose(side.nodal_normals(),
                               force / np.linalg.norm(force, axis=1)[:, None], rtol=1e-14)
    assert not side.begins_on_axis.any()
    side.radius[0] = 0.0
    assert side.begins_on_axis.all()
    plane = Side(flat, np.array([[0, 1, 2]]), normals(flat[None]))
    assert plane.ring(e, xi) == plane.stretch(e, xi) == 1.0 and not plane.begins_on_axis.any()


def test_a_corner_becomes_two_vertices_one_of_each_flank():
    """By what nodes face, whichever comes first, with the edges that face like them."""
    xy = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 2.0]])
    edges = np.array([[0, 1], [1, 2], [2, 3]])
    down, right = np.array([0.0, -1.0]), np.array([1.0, 0.0])
    for swapped in (False, True):
        facing = np.array([down, down, right, right, right])
        vertex = np.array([0, 1, 1, 2, 3])
        if swapped:
            facing[[1, 2]] = facing[[2, 1]]
        found, copied, places = split(edges, normals(xy[edges]), vertex, facing)
        assert copied.tolist() == [1] and sorted(places[[1, 2]].tolist()) == [1, 4]
        assert places[[0, 3, 4]].tolist() == [0, 2, 3]
        of_right = places[1 if swapped else 2]
        assert found[1, 0] == of_right and found[0, 1] == 5 - of_right
        assert found[[0, 1, 2], [0, 1, 0]].tolist() == [0, 2, 2] and found[2, 1] == 3
    assert edges.tolist() == [[0, 1], [1, 2], [2, 3]]  # those given stay
    alone = split(edges, normals(xy[edges]), np.arange(4), np.tile(down, (4, 1)))
    assert not len(alone[1]) and alone[2].tolist() == [0, 1, 2, 3]


# ------------------------------------------------------------------------------ joints

def outline(xy, label=1) -> joints.Edges:
    """Edges along places (n, 2)."""
    xy, at = np.array(xy, float), np.arange(len(xy) - 1)
    gid = np.column_stack([at, at + 1])
    return joints.Edges(np.full(len(at), label), gid, xy[gid])


def test_corners_divide_a_joined_boundary():
    """Smooth bends do not, whatever the order of the edges."""
    edges = outline([[0, 0], [1, 0], [2, 0.2], [2, 1], [2, 2]])
    order = np.array([3, 0, 2, 1])
    mixed = joints.Edges(edges.label[order], edges.gid[order], edges.xy[order])
    for one in (edges, mixed):
        pieces, corners = one.smooth_pieces()
        assert corners.tolist() == [2]
        assert sorted(sorted(np.unique(piece.gid).tolist()) for piece in pieces) == [
            [0, 1, 2], [2, 3, 4]]
        np.testing.assert_allclose(np.sort(one.ends, axis=0), [[0, 0], [2, 2]])
        assert one.lengths.sum() == pytest.approx(1 + np.hypot(1, 0.2) + 1.8)


def test_periodic_boundaries_are_translates_of_one_another():
    """Whatever their meshes; of other lengths, shapes or radii they are refused."""
    joint = joints.Joint("periodic", 1, 2, True)
    one = outline([[0, 0], [0, 1], [0.2, 2]])
    two = outline([[5, 0.5], [5, 1.1], [5, 1.5], [5.2, 2.5]], 2)
    np.testing.assert_allclose(joints.translation(joint, one, two, False), [-5, -0.5])
    for other in ([[5, 0.5], [5.3, 2.5]], [[5, 0.5], [4, 1.5], [5.2, 2.5]]):
        with pytest.raises(InputError, match="no translates"):
            joints.translation(joint, one, outline(other, 2), False)
    with pytest.raises(InputError, match="different radii"):
        joints.translation(joint, one, two, True)
    above = outline([[0, 3], [0, 4], [0.2, 5]], 2)
    np.testing.assert_allclose(joints.translation(joint, one, above, True), [0, -3])
    ring = outline([[0, 0], [1, 0], [1, 1], [0, 0]])
    ring.gid[-1, 1] = 0
    far = joints.Edges(ring.label, ring.gid, ring.xy + [3.0, 0.0])
    assert not len(ring.ends)
    np.testing.assert_allclose(joints.translation(joint, ring, far, False), [-3, 0])


def test_arc_lengths_along_a_joined_side():
    """From the start of every connected piece; a closed one begins anywhere."""
    xy = np.array([[0.0, 0], [3, 4], [3, 6], [9, 0], [9, 1]])
    edges = np.array([[1, 2], [3, 4], [0, 1]])
    arc_, piece = joints._along(Side(xy, edges, normals(xy[edges])))
    np.testing.assert_allclose(arc_, [0, 5, 7, 0, 1])
    assert piece[0] == piece[1] == piece[2] != piece[3] == piece[4]
    closed = np.array([[0, 1], [1, 2], [2, 0]])
    arc_, piece = joints._along(Side(xy[:3], closed, normals(xy[closed])))
    np.testing.assert_allclose(arc_, [0, 5, 7])
    assert (piece == 0).all()
    middles = np.array([[0, 2, 1]])
    line = np.array([[0.0, 0], [1, 0], [3, 0]])
    np.testing.assert_allclose(joints._along(Side(line, middles, normals(line[middles])))[0],
                               [0, 1, 3])


def test_integrals_over_revolved_sides():
    """Radii below zero are rounding on the axis."""
    xy = np.array([[[-1e-17, 0.0], [2.0, 0.0], [1.0, 0.0]]])
    assert sides.integrals(xy, revolved=True).sum() == pytest.approx(4 * np.pi)
    assert sides.densities(xy - [5.0, 0.0], revolved=True).max() == 0.0


def test_what_opposes_both_flanks_alike_is_before_both():
    """Flanks of a corner that face down and to the left; what looks up is before the first alone,
    what looks right before the second, and between them before either; a flank of another corner,
    or of one that is a whole side, is before all.
    """
    xy = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.0], [0.0, 2.0], [5.0, 0.0], [6.0, 0.0]])
    edges = np.array([[0, 1], [3, 2], [4, 5]])
    facing = np.array([[0.0, -1.0], [-1.0, 0.0], [0.0, -1.0]])
    other = np.array([[0.0, 1.0], [1.0, 0.0], [np.sqrt(0.5), np.sqrt(0.5)]])
    for twins in ([[0, 2]], [[2, 0]]):
        able = before_flanks(Side(xy, edges, facing), np.array(twins), other)
        assert able.tolist() == [[True, False, True], [False, True, True], [True, True, True]]
    joined_up = np.array([[0, 1], [1, 2], [4, 5]])
    assert before_flanks(Side(xy, joined_up, facing), np.array([[0, 2]]), other).all()
    assert before_flanks(Side(xy, edges, facing), np.zeros((0, 2), int), other).all()
