"""Mortar coupling of straight boundaries with meshes that do not match, by hand."""

import numpy as np
import pytest

from driver.contact import facing, mortar
from driver.contact.side import Side
from driver.errors import InputError
from driver.scene import freefem

ABOVE, BELOW = np.array([0.0, 0.7, 1.5, 3.0, 4.0]), np.array([-0.5, 0.4, 1.1, 2.9, 3.3, 4.6])


def side(x, y, down: bool, quadratic: bool, turn=0.3) -> Side:
    """A boundary over places x at heights y(x), whose normal points down or up; all turned."""
    x = np.asarray(x, float)
    ends = np.column_stack([x, y(x)])
    at = np.arange(len(x) - 1)
    edges = np.column_stack([at, at + 1] if down else [at + 1, at])
    if quadratic:
        ends = np.concatenate([ends, (ends[:-1] + ends[1:]) / 2])
        edges = np.column_stack([edges, len(x) + at])
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    xy = ends @ spin.T
    chord = xy[edges[:, 1]] - xy[edges[:, 0]]
    normal = np.column_stack([chord[:, 1], -chord[:, 0]])
    found = Side(xy, edges, normal / np.linalg.norm(normal, axis=1)[:, None])
    found.x = ends[:, 0]
    return found


def sides(quadratic=False, below=BELOW, gap=lambda x: -0.5 + 0 * x):
    return (side(ABOVE, lambda x: 0 * x, True, quadratic), side(below, gap, False, quadratic))


def jump(found, first, second, own, other=None):
    """(n,) jumps of a function of x on either side."""
    other = own if other is None else other
    u = np.where(found.side == 0, own(first.x[np.where(found.side == 0, found.of, 0)]),
                 other(second.x[np.where(found.side == 1, found.of, 0)]))
    return np.bincount(found.node, found.value * u, len(first.xy))


def dual_weights(x, quadratic):
    """Integrals of the shape functions."""
    size, n = np.diff(x), len(x)
    weight = np.zeros(n)
    np.add.at(weight, np.arange(n - 1), size * (1 / 6 if quadratic else 1 / 2))
    np.add.at(weight, np.arange(1, n), size * (1 / 6 if quadratic else 1 / 2))
    return np.r_[weight, 4 / 6 * size] if quadratic else weight


@pytest.mark.parametrize("quadratic", [False, True])
def test_fields_of_the_element_pass(quadratic):
    """Constant and linear ones, and quadratic ones of quadratic elements; distances likewise, at
    the nodes themselves. Weights are those of the shape functions.
    """
    first, second = sides(quadratic)
    found = mortar.couple(first, second, np.zeros(len(first.xy), bool))
    np.testing.assert_allclose(found.weight, dual_weights(ABOVE, quadratic), rtol=1e-12)
    np.testing.assert_array_equal(found.length, found.weight)
    np.testing.assert_allclose(found.gap, 0.5, rtol=1e-12)
    own = np.bincount(found.node, found.value * (found.side == 0))
    np.testing.assert_allclose(own, 1.0, rtol=1e-12)
    for power in range(3 if quadratic else 2):
        np.testing.assert_allclose(jump(found, first, second, lambda x, p=power: x**p), 0.0,
                                   atol=1e-12)
    # a jump between other fields is the difference of their means with the dual functions
    np.testing.assert_allclose(jump(found, first, second, lambda x: 2 * x, lambda x: x - 1),
                               first.x + 1, atol=1e-12)
    np.testing.assert_allclose(found.normal, np.tile(first.edge_normal[0], (len(first.xy), 1)))
    first, second = sides(quadratic, gap=lambda x: -0.5 - 0.1 * x)
    inclined = mortar.couple(first, second, np.zeros(len(first.xy), bool))
    np.testing.assert_allclose(inclined.gap, 0.5 + 0.1 * first.x, rtol=1e-10)


@pytest.mark.parametrize("end", [2.0, 2.6])
@pytest.mark.parametrize("quadratic", [False, True])
def test_what_is_covered_in_part_has_a_part_of_the_weight(quadratic, end):
    """Hats over the part that faces something, of less than half an edge the next node has it all;
    constants pass, nothing is left of the rest.
    """
    first, second = sides(quadratic, below=[-1.0, 0.3, 1.0, end])
    found = mortar.couple(first, second, np.zeros(len(first.xy), bool))
    assert found.weight.sum() == pytest.approx(end)
    covered = (end - 1.5) / 1.5  # of the third edge
    hats = 1.5 * np.array([covered - covered**2 / 2, covered**2 / 2])
    if covered < 0.5:
        hats = np.array([hats.sum(), 0.0])
    full = dual_weights(ABOVE, quadratic)
    vertex = 0.8 * (1 / 6 if quadratic else 1 / 2)
    np.testing.assert_allclose(found.weight[[2, 3]], [vertex + hats[0], hats[1]])
    np.testing.assert_allclose(found.weight[[0, 1]], full[[0, 1]])
    assert found.weight[4] == 0.0 and (not quadratic or not found.weight[7:].any())
    used = found.weight > 0
    np.testing.assert_allclose(jump(found, first, second, lambda x: 1 + 0 * x)[used], 0.0,
                               atol=1e-12)
    np.testing.assert_allclose(found.gap, np.where(used, 0.5, 0.0), atol=1e-12)
    assert not np.isin(found.node, np.flatnonzero(~used)).any()


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("open_", [0.0, 0.031, 0.039, 0.08, 0.2])
def test_a_crack_in_the_other_side_changes_as_little_as_it_is_wide(quadratic, open_):
    """Where two bodies lie side by side under an edge, as they move apart: conditions do not jump,
    wherever they are.
    """
    held, rows = np.zeros(len(sides(quadratic)[0].xy), bool), []
    for width in (open_, open_ + 2e-4):  # of an edge as long as 0.8
        first, one = sides(quadratic, np.array([-0.5, 0.4, 1.1]))
        two = sides(quadratic, np.array([1.1 + width, 2.9, 4.6]))[1]
        second = Side(np.concatenate([one.xy, two.xy]),
                      np.concatenate([one.edges, two.edges + len(one.xy)]),
                      np.concatenate([one.edge_normal, two.edge_normal]))
        second.x = np.append(one.x, two.x)
        found = mortar.couple(first, second, held)
        constant = jump(found, first, second, np.ones_like)
        np.testing.assert_allclose(constant, 0.0, atol=1e-12)  # constant stress passes
        rows.append([found.weight, jump(found, first, second, np.cos, lambda x: 0 * x),
                     jump(found, first, second, np.cos, lambda x: x**2)])
    np.testing.assert_allclose(*rows, rtol=0, atol=2e-3)


@pytest.mark.parametrize("quadratic", [False, True])
def test_held_nodes_leave_their_part_to_the_next(quadratic):
    """Constant stress stays exact: weights add up to the length; of quadratic edges the middle
    takes it.
    """
    first, second = sides(quadratic)
    held = np.zeros(len(first.xy), bool)
    held[[0, 2]] = True
    found = mortar.couple(first, second, held)
    full = dual_weights(ABOVE, quadratic)
    assert found.weight[0] == found.weight[2] == 0.0 and found.weight.sum() == pytest.approx(4.0)
    if quadratic:
        np.testing.assert_allclose(found.weight[5:8], full[5:8] + [0.7 / 6, 0.8 / 6, 1.5 / 6])
    else:
        np.testing.assert_allclose(found.weight[[1, 3]], full[[1, 3]] + [0.35 + 0.4, 0.75])
    np.testing.assert_allclose(jump(found, first, second, lambda x: 1 + 0 * x), 0.0, atol=1e-12)
    np.testing.assert_allclose(found.gap[~held], 0.5)


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("end", [0, 4])
def test_conditions_at_corners_are_those_of_the_place(quadratic, end):
    """u - u* where the corner is; what else there was goes to the next node, so that constants pass
    and weights stay.
    """
    first, second = sides(quadratic, gap=lambda x: -0.5 - 0.1 * (x - 2) ** 2)
    none = np.zeros(len(first.xy), bool)
    corner = none.copy()
    corner[end] = True
    plain, found = (mortar.couple(first, second, none, corners=of) for of in (None, corner))
    np.testing.assert_allclose(found.weight, plain.weight)
    here = found.node == end
    own = here & (found.side == 0)
    assert found.of[own].tolist() == [end] and found.value[own].tolist() == pytest.approx([1.0])
    near = {0: (0, 1), 4: (4, 5)}[end]
    share = (ABOVE[end] - BELOW[near[0]]) / (BELOW[near[1]] - BELOW[near[0]])
    height = np.interp(ABOVE[end], BELOW, -0.5 - 0.1 * (BELOW - 2) ** 2)
    if not quadratic:
        values = dict(zip(found.of[here & ~own], found.value[here & ~own]))
        assert values == pytest.approx({near[0]: share - 1, near[1]: -share})
    assert found.gap[end] == pytest.approx(-height)
    total = [(of.weight * of.gap).sum() for of in (plain, found)]
    assert total[0] == pytest.approx(total[1])
    np.testing.assert_allclose(jump(found, first, second, lambda x: 1 + 0 * x), 0.0, atol=1e-12)
    for of in (plain, found):  # a uniform pressure does the same work on any displacement
        work = of.weight @ jump(of, first, second, lambda x: x**2)
        assert work == pytest.approx(plain.weight @ jump(plain, first, second, lambda x: x**2))
    both = corner.copy()
    both[5 if quadratic else {0: 1, 4: 3}[end]] = True
    if not quadratic:  # where the next node is a corner as well nobody takes it
        alike = mortar.couple(first, second, none, corners=both)
        np.testing.assert_allclose(alike.value[alike.node == end], plain.value[plain.node == end])


def test_parts_that_face_one_another():
    """Cut at the vertices of either side, without what rounding leaves; places opposite them."""
    first, second = sides(below=[-0.5, 0.7 + 1e-9, 1.1, 4.0 - 1e-9])
    found = facing.segments(first, second)
    x = ABOVE[found.edge][:, None] + found.at * np.diff(ABOVE)[found.edge][:, None]
    np.testing.assert_allclose(x, [[0, 0.7], [0.7, 1.1], [1.1, 1.5], [1.5, 3], [3, 4]], atol=1e-8)
    assert (found.at[[0, 1, 3, 4], 0] == 0).all() and (found.at[[0, 2, 3, 4], 1] == 1).all()
    assert found.at[1, 1] == found.at[2, 0]
    a, b = second.x[second.edges[found.other]].T
    np.testing.assert_allclose(a[:, None] + found.facing * (b - a)[:, None], x, atol=1e-8)
    assert found.other.tolist() == [0, 1, 2, 2, 2]


def test_places_that_face_several_others():
    """Refused, unless the nearest within reach is to count; edges that are not able do not meet."""
    first, near = sides()
    far = side(BELOW, lambda x: -1.5 + 0 * x, False, False)
    both = Side(np.concatenate([near.xy, far.xy]), np.concatenate([near.edges, far.edges + 6]),
                np.concatenate([near.edge_normal, far.edge_normal]))
    both.x = np.r_[near.x, far.x]
    none = np.zeros(5, bool)
    with pytest.raises(InputError, match="several places of the other side; give "
                       "parts that meet different places labels and pairs of their own"):
        mortar.couple(first, both, none)
    found = mortar.couple(first, both, none, reach=2.0)
    np.testing.assert_allclose(found.gap, 0.5)
    able = np.ones((4, 10), bool)
    able[:, :5] = False
    np.testing.assert_allclose(mortar.couple(first, both, none, able).gap, 1.5)
    assert not mortar.couple(first, both, none, able, reach=1.0).weight.any()
    pairs = mortar.meets(np.array([1, 2]), np.array([3, 4, 5]), [(1, 3), (2, 5), (1, 4)])
    assert pairs.tolist() == [[True, True, False], [False, False, True]]


SAME = """include "scene.idp"
subdomains("{cut}");
int[int] upper = [1, 2, {top}, 4];
addBody(square(8, 2, [4.*x, y]))
addBody(square(5, 2, [1. + 2.*x, 1. + y], label = upper))
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(2, u1 = 0., u2 = 0.) //
macro load1() traction(4, 1., 0.) //
macro contactPair() 1, 3 //
include "export.idp"
"""


@pytest.mark.parametrize("top, words", [
    (3, "labels 1 and 3 are on bodies 1 and 2; give each body labels of its own"),
    (5, None)])
def test_labels_of_both_bodies(scene, read, tmp_path, top, words):
    """They are what is wrong where a place faces several others, whichever cut; else they may be.
    """
    path = scene(SAME.replace("{cut}", "4").replace("{top}", str(top)))
    freefem.export(path, tmp_path / "export", {})
    if words is None:
        assert read(tmp_path / "export", reduce=False).structure.contact.weight.sum() > 1.9
        return
    with pytest.raises(InputError, match=f"faces several places of the other side: {words}"):
        read(tmp_path / "export", reduce=False)


def outline(corners) -> Side:
    """The whole boundary of a polygon, counterclockwise."""
    xy = np.array(corners, float)
    at = np.arange(len(xy))
    edges = np.column_stack([at, np.roll(at, -1)])
    chord = xy[edges[:, 1]] - xy[edges[:, 0]]
    normal = np.column_stack([chord[:, 1], -chord[:, 0]])
    return Side(xy, edges, normal / np.linalg.norm(normal, axis=1)[:, None])


@pytest.mark.parametrize("depth, faces", [(-2.0, True), (0.2, True), (1.9, False)])
def test_the_back_of_a_thin_part_faces_nothing_through_it(depth, faces):
    """A plate right of a square, or in it: its left side faces the square's right one. Its right
    side would see the square's left one, far behind both. A plate that is in the square by more
    than its thickness has passed it.
    """
    square = outline([(-1, -2), (1, -2), (1, 2), (-1, 2)])
    left = 1.0 - depth
    plate = outline([(left, -1), (left + 0.5, -1), (left + 0.5, 1), (left, 1)])
    e, o, *_ = facing.facing_parts(plate, plate.edge_normal[plate.edges[:, 0]], square, None, 10.0)
    found = [(int(a), int(b)) for a, b in zip(e, o)]
    assert ((3, 1) in found) == faces
    assert (1, 3) not in found


@pytest.mark.parametrize("seed", [1, 2])
def test_what_lies_beside_an_edge_is_left_out_before_feet_are_looked_for(seed, monkeypatch):
    """And nothing that faces it, before and behind the focus of its normals: of two rough rings,
    one through the other, also where edges are looked at one by one.
    """
    rng, rings = np.random.default_rng(seed), []
    for centre, radius, count in ((0.0, 1.0, 23), (1.4, 0.9, 31)):
        angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
        radius = radius * (1 + 0.1 * rng.standard_normal(count))
        rings.append(outline(np.column_stack([centre + radius * np.cos(angle),
                                              radius * np.sin(angle)])))
    one, other = rings
    normal = one.nodal_normals()
    found = facing.facing_parts(one, normal, other, None, 10.0)
    monkeypatch.setattr(facing, "AT_ONCE", 1)
    alone = facing.facing_parts(one, normal, other, None, 10.0)
    able = one.edge_normal @ other.edge_normal.T < facing.FACING
    candidates = set(zip(*facing._candidates(one, normal, other, None)))
    monkeypatch.setattr(facing, "_candidates", lambda *_: np.nonzero(able))
    everything = facing.facing_parts(one, normal, other, None, 10.0)
    assert len(candidates) < 0.6 * np.count_nonzero(able)
    for part, by_itself, known in zip(found, alone, everything):
        np.testing.assert_array_equal(part, known)
        np.testing.assert_array_equal(by_itself, known)


def test_an_edge_is_met_from_outside():
    """Normals of nodes turn round a corner: a place may look out of the other body where normals of
    edges still face one another.
    """
    first, _ = sides()
    turned = np.tile([0.95, -0.3], (len(first.xy), 1))
    edge = np.array([[1.0, -1.0], [0.0, -0.5]])
    for normal, seen in (([-0.5, 0.866], True), ([0.5, 0.866], False)):
        wall = Side(edge, np.array([[0, 1]]), np.array([normal]))
        assert first.edge_normal[0] @ normal < facing.FACING
        one = facing._from_outside(first, turned, wall, np.zeros(1, int), np.zeros(1, int),
                                   np.array([0.5]))
        assert one.tolist() == [seen]
