"""Whether the assumptions of a run hold: distances at displaced places, strains, overlaps."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.states import OPEN, STICK, ContactField
from driver.validity import assumptions, true_distance
from driver.validity.assumptions import INVALID, QUESTIONABLE
from drawn_block import DRAWN

HEAD = '''include "scene.idp"
units("mm", "MPa");
subdomains("2x2");
'''
BLOCK = HEAD + '''rectangle(0., 40., 0., 20.);
real push = physical("push", 100.), reach = physical("reach", 0.);
macro young() 210e3 //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -push) //
macro contact() 1 //
macro gap() reach //
include "export.idp"
'''
HOOK = '''include "scene.idp"
units("mm", "MPa");
subdomains("6");
quasistatic(1.);
real push = physical("push", 3.), R = 2.;
real h = meshSize(0.5);
border bottom(t=0, 20) { x = t; y = 0; label = 1; }
border nose1(t=0, 1) { x = 20 + t; y = -1.2*t; label = 6; }
border nose2(t=0, 1) { x = 21 + t; y = -1.2*(1 - t); label = 2; }
border tip(t=0, 2) { x = 22; y = t; label = 3; }
border top(t=22, 0) { x = t; y = 2; label = 4; }
border root(t=2, 0) { x = 0; y = t; label = 5; }
body = buildmesh(bottom(20/h) + nose1(2/h) + nose2(2/h) + tip(2/h) + top(22/h) + root(2/h));
macro young() 2200. //
macro poisson() 0.38 //
macro displacement1() on(5, u1 = push, u2 = 0.) //
macro amplitude1(t) t //
macro contact() 2 //
macro obstacle(x, y) (sqrt((x-23.5)^2 + (y+2.5)^2) - R) //
macro friction() 0.2 //
include "export.idp"
'''
PLATES = '''include "scene.idp"
units("mm", "MPa");
subdomains("4");
real down = physical("down", 0.5);
int[int] low = [11, 12, 13, 14], high = [21, 22, 23, 24];
addBody(square(8, 2, [8*x, 2*y], label = low))
addBody(square(6, 2, [1 + 6*x, 2.4 + 2*y], label = high))
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(11, u1 = 0., u2 = 0.) //
macro displacement1() on(23, u1 = 0., u2 = -down) //
include "export.idp"
'''


PRESSED = """include "scene.idp"
units("mm", "MPa");
subdomains("2");
real reach = physical("reach", 0.);
int[int] above = [11, 12, 13, 14];
addBody(square(10, 3, [40*x, 10*y]))
addBody(square(6, 3, [10 + 20*x, 10 + 10*y], label = above))
macro young() 210e6 //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) + on(14, u1 = 0.) //
macro load1() pressure(13, 50.) //
macro contactPair() 11, 3 //
macro pairGap() reach //
include "export.idp"
"""
BUSH = HEAD.replace('"2x2"', '"4"') + '''real h = meshSize(2.);
int inner = rint(2*pi*10/h), outer = rint(2*pi*10/(1.3*h));
border pin(t=0, 2*pi) { x = 10*cos(t); y = 10*sin(t); label = 1; }
border bore(t=0, 2*pi) { x = 4*cos(t); y = 4*sin(t); label = 2; }
border hole(t=0, 2*pi) { x = 10*cos(t + 0.05); y = 10*sin(t + 0.05); label = 3; }
border rim(t=0, 2*pi) { x = 16*cos(t); y = 16*sin(t); label = 4; }
addBody(buildmesh(pin(inner) + bore(-inner/2)))
addBody(buildmesh(rim(outer) + hole(-outer)))
macro young() 2000. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro displacement1() on(2, u1 = 0., u2 = -1e-4) //
macro contactPair() 1, 3 //
include "export.idp"
'''


@pytest.fixture(scope="module")
def verdict(solved, named_scene):
    """verdict(text, **options): entry `validity` of a run, its warnings and its status."""
    def get(text, **options):
        run = solved(named_scene(f"scene{abs(hash(text))}", text), **options)
        return run.summary["validity"], run.summary["warnings"], run.status

    return get


# ------------------------------------------------------------------------------ distances, overlaps

@pytest.mark.parametrize("sense", [1, -1])
def test_distance_from_a_circle_by_its_feet(sense):
    """Feet of a body round a pin, or of a pin: exact on the feet, fourth order between them, third
    beyond their ends.
    """
    R, angle = 2.0, np.linspace(0.2, 1.4, 13)
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    curve = true_distance.obstacle(R * ray, -sense * ray)  # normals point to the obstacle

    def error(at, away):
        place = (R + away) * np.column_stack([np.cos(at), np.sin(at)])
        distance, normal = curve.distance(place)
        assert np.all((normal * place).sum(axis=1) * sense > 0)  # to the body
        return np.abs(distance - sense * away).max()

    assert error(np.linspace(0.2, 1.4, 100), 0.0) < R * 0.1**4
    assert error(np.linspace(0.2, 1.4, 100), 0.1) < R * 0.1**3
    beyond = np.array([0.1, 1.5])
    assert error(beyond, 0.0) < R * 0.1**3


def test_feet_that_do_not_follow_one_another_make_no_curve():
    foot = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.0]])
    curve = true_distance.obstacle(foot, np.tile([0.0, -1.0], (3, 1)))
    assert len(curve.start) == 1
    assert true_distance.obstacle(foot[:1], foot[:1]) is None


@pytest.mark.parametrize("turn", [0.0, 0.6, np.pi])
def test_feet_make_one_curve_in_either_order(turn):
    """On a parabola, wherever it is turned to; a gap in the boundary is one in the curve."""
    x = np.linspace(-1, 1, 9)
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    foot = np.column_stack([x, 0.2 * x**2]) @ spin.T
    normal = np.column_stack([0.4 * x, -np.ones(9)]) / np.hypot(0.4 * x, 1)[:, None] @ spin.T
    there = true_distance.obstacle(foot, normal)
    back = true_distance.obstacle(foot[::-1], normal[::-1])
    middle = np.linspace(-0.95, 0.95, 20)
    place = np.column_stack([middle, 0.2 * middle**2 + 0.1]) @ spin.T
    for curve in (there, back):
        distance, away = curve.distance(place)
        np.testing.assert_allclose(distance, 0.1 / np.hypot(1, 0.4 * middle), atol=3e-3)
        assert ((away @ spin)[:, 1] > 0.9).all()
    np.testing.assert_allclose(there.distance(place)[0], back.distance(place)[0], rtol=1e-12)
    joined = np.arange(8) != 3
    assert len(true_distance.obstacle(foot, normal, joined).start) == 7
    assert true_distance.obstacle(foot, normal, np.zeros(8, bool)) is None


def test_an_outline_ends_nowhere_and_ends_reach_what_is_nearest_to_them():
    """Feet all round a square, with a slanted normal at each corner, first of a half of them.

    A curve that goes on beyond its end has the curvature of its last side, here a corner's; it is
    no part of the square that its other feet know, and a ring has no end.
    """
    side = np.column_stack([np.linspace(-1, 1, 5)[:4], np.full(4, -1.0)])
    away = np.concatenate([[[-np.sqrt(0.5)] * 2], np.tile([0.0, -1.0], (3, 1))])
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    foot, normal = (np.concatenate([of @ np.linalg.matrix_power(quarter, k) for k in range(4)])
                    for of in (side, away))
    ring = np.append(np.arange(16), 0)
    curve = true_distance.obstacle(foot[ring], normal[ring], ring=True)
    assert not curve.before.any() and not curve.after.any() and len(curve.start) == 16
    half = np.arange(3, 14)  # begins and ends beside corners
    for known, first in ((curve, 2), (true_distance.obstacle(foot[half], normal[half]), 6)):
        distance, toward = known.distance(0.9 * foot[[first, 10]])
        np.testing.assert_allclose(distance, 0.1, rtol=1e-12)
        np.testing.assert_allclose(toward, -normal[[first, 10]], atol=1e-12)


def test_depth_in_a_polygon_by_its_own_formula():
    """Of a triangle that turns either way: inside where the smallest distance of its lines is."""
    corner = np.array([[0.0, 0.0], [3.0, 1.0], [1.0, 2.0]])
    place = np.random.default_rng(2).uniform(-1, 4, (300, 2))
    for start in (corner, corner[::-1]):
        end = np.roll(start, -1, axis=0)
        chord = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
        away = place[:, None] - start
        off = chord[:, 0] * away[..., 1] - chord[:, 1] * away[..., 0]
        within = (off > 0).all(axis=1) | (off < 0).all(axis=1)
        np.testing.assert_array_equal(true_distance.inside(place, start, end), within)
        depth, edge = true_distance.nearest(place, start, end)
        np.testing.assert_allclose(depth[within], np.abs(off[within]).min(axis=1), rtol=1e-12)
        np.testing.assert_array_equal(edge[within], np.abs(off[within]).argmin(axis=1))
        to_corner = np.linalg.norm(place[:, None] - corner, axis=2).min(axis=1)
        assert (depth <= to_corner + 1e-15).all()


def test_points_in_polygons_and_crossing_edges():
    corner = np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]])
    start, end = corner, np.roll(corner, -1, axis=0)
    assert true_distance.inside(np.array([[1, 0.5], [3, 0.5], [1, 1.5]]), start, end).tolist() == [
        True, False, False]
    depth, edge = true_distance.nearest(np.array([[1, 0.9]]), start, end)
    assert depth[0] == pytest.approx(0.1) and edge[0] == 2
    ends = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    assert len(true_distance.crossings(start, end, ends)) == 0
    bow = corner[[0, 2, 1, 3]]
    assert true_distance.crossings(bow, np.roll(bow, -1, axis=0), ends).tolist() in ([[0, 2]],
                                                                                    [[2, 0]])


@pytest.mark.parametrize("pairs", [1, 7, 10**6])
def test_crossing_edges_are_those_that_all_pairs_say(monkeypatch, pairs):
    """However many are looked at together; by the signs of areas, and not where a vertex is shared.
    """
    monkeypatch.setattr(true_distance, "PAIRS", pairs)
    corner = np.random.default_rng(3).random((24, 2))
    corner[6:12, 0] = 0.5  # edges along a line
    ends = np.column_stack([np.arange(24), np.roll(np.arange(24), -1)])
    start, end = corner[ends[:, 0]], corner[ends[:, 1]]

    def area(a, b, c) -> float:
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    expected = {(i, k) for i in range(24) for k in range(i)
                if not set(ends[i]) & set(ends[k])
                and area(start[i], end[i], start[k]) * area(start[i], end[i], end[k]) < 0
                and area(start[k], end[k], start[i]) * area(start[k], end[k], end[i]) < 0}
    found = true_distance.crossings(start, end, ends)
    assert len(found) == len(expected) > 20
    assert {(max(pair), min(pair)) for pair in found.tolist()} == expected
    assert true_distance.crossings(*np.empty((2, 0, 2)), np.empty((0, 2), int)).shape == (0, 2)


def checks(unit=1.0):
    """What checks steps of two boundaries on circular pins; where nothing has been found yet."""
    R, angle = unit * np.array([2.0, 5.0]), np.linspace(-0.3, 0.3, 13)
    ray = np.column_stack([np.sin(angle), -np.cos(angle)])
    n = len(angle)
    xy = np.concatenate([r * ray + [10 * unit * k, 0] for k, r in enumerate(R)])
    b = SimpleNamespace(
        gid=np.arange(2 * n), chain=np.repeat([0, 1], n), label=np.repeat([4, 5], n), xy=xy,
        arc=np.concatenate([2 * r * np.sin(0.025) * np.arange(n) for r in R]), gap=np.zeros(2 * n),
        normal=np.concatenate([-ray, -ray]), paired=np.zeros(2 * n, bool), following=None,
        about=None, length=np.repeat(0.05 * R, n))
    b.at = lambda time: b
    found = object.__new__(assumptions.Validity)
    found.boundary, found.comm = b, MPI.COMM_SELF
    found.problem = SimpleNamespace(manifest=SimpleNamespace(contact_pairs=[]))
    found.worst = {name: assumptions.Worst() for name in QUESTIONABLE}
    found.estimated = set()
    found.overlaps, found.parts = {}, {name: np.zeros(2) for name in assumptions.MEASURES}
    return found


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_nodes_that_touch_are_compared_with_the_obstacle_and_others_are_not(unit):
    """A node of a bush that slides by s along its pin's tangent is off it by s^2/2R, and its normal
    by s/R: relative to the length in contact. Nodes apart go where they like.
    """
    found = checks(unit)
    b, n, s = found.boundary, 13, 0.2 * unit
    status = np.full(2 * n, OPEN)
    status[3:10] = STICK  # of the first pin, where radii are 2; none of the second touches
    tangent = np.column_stack([-b.normal[:, 1], b.normal[:, 0]])
    moved = s * tangent
    moved[status == OPEN] *= -3
    u_n = (moved * b.normal).sum(axis=1)
    found._check_contact(SimpleNamespace(time=1.0, index=7),
                         {ContactField.STATUS: status, ContactField.U_N: u_n}, None, moved)
    off, turn = found.worst["largest_normal_error"], found.worst["normal_turn"]
    length = 7 * 0.05 * 2
    assert off.value * length == pytest.approx(np.hypot(2, 0.2) - 2, rel=2e-3)
    assert turn.value == pytest.approx(np.arctan(0.1), rel=2e-3)
    assert off.step == turn.step == 7 and off.more == {"paired": False}
    assert found.summary()["normal_turn"] == turn.value


@pytest.mark.parametrize("share, verdict_", [(0.5, 0), (1.5, 1), (40.0, 2)])
def test_the_verdict_is_that_of_the_worst_measure(share, verdict_):
    """The measure that is beyond most limits, with its place, step and reason."""
    found = checks()
    for name, part in (("largest_normal_error", share), ("normal_turn", 0.9)):
        found.note(name, part * QUESTIONABLE[name], (1.0, 2.0), 3, paired=True)
        found.note(name, 0.5 * part * QUESTIONABLE[name], (5.0, 6.0), 4, paired=True)
    entry = found.summary()
    assert entry["verdict"] == assumptions.VERDICTS[verdict_]
    assert entry["largest_normal_error"] == share * QUESTIONABLE["largest_normal_error"]
    words = ("(1, 2) in step 3", "LINEARIZATION=updated")
    assert all((word in entry["reason"]) == bool(verdict_) for word in words)


# ------------------------------------------------------------------------------ runs

BOX = """include "scene.idp"
real turn = physical("turn", 0.)*pi/180.;
border one(t = -3*pi/4, -pi/4) { x = cos(t + turn); y = sin(t + turn); label = 1; }
border two(t = -pi/4, 5*pi/4) { x = cos(t + turn); y = sin(t + turn); label = 2; }
border hole(t = 2*pi, 0) { x = 0.3*cos(t); y = 0.3*sin(t); label = 5; }
body = buildmesh(one(9) + two(27) + hole(9));
macro young() 1000. //
macro poisson() 0.3 //
macro displacement1() on(5, u1 = 0., u2 = -0.006) //
macro contact() 1, 2 //
macro normalCompliance() 1e4 //
macro obstacle(x, y) (1. - max(abs(x), abs(y))) //
include "export.idp"
"""


@pytest.mark.parametrize("turn", [0, 110, 200])
def test_a_disc_in_a_box_is_ok_wherever_its_outline_begins(verdict, turn):
    """Its whole outline is a contact boundary; walls are straight, so that distances are exact."""
    entry, _, status = verdict(BOX, turn=turn)
    assert status == 0 and entry["verdict"] == "ok" and entry["largest_normal_error"] < 1e-9


def test_a_stiff_block_is_ok(verdict):
    entry, warnings, status = verdict(BLOCK)
    assert entry["verdict"] == "ok" and entry["reason"] == "" and status == 0
    assert not any("results are" in line for line in warnings)
    # an elastic block under 100 MPa: strains of its size over E
    assert 100 / 210e3 / 2 < entry["largest_strain"] < 20 * 100 / 210e3


def test_strains_grow_with_the_load_until_they_are_large(verdict):
    """Linear: a load 1e6 times as large has 1e6 times the strains, the same tractions and no
    meaning.
    """
    small, _, _ = verdict(BLOCK)
    large, warnings, status = verdict(BLOCK, push=1e8)
    assert status == 0 and large["verdict"] == "invalid"
    assert large["largest_strain"] == pytest.approx(1e6 * small["largest_strain"], rel=1e-3)
    line, = (line for line in warnings if "results are invalid" in line)
    assert "in step 1" in line and " at (" in line and "smaller loads" in line


@pytest.mark.parametrize("stretch, shear, expected", [
    (0.05, 0.05, "ok"), (0.2, 0.05, "questionable"), (-0.4, 0.1, "invalid")])
def test_a_strain_of_the_whole_body_is_judged(verdict, stretch, shear, expected):
    """Uniform, prescribed at the boundary: its larger principal value, and half of the shear as
    rotation.
    """
    text = BLOCK.replace("macro support() on(4, u1 = 0., u2 = 0.) //", "macro displacement1() "
                         f"on(1, 2, 3, 4, u1 = {stretch}*x + {shear}*y, u2 = 0.) //")
    text = text.replace("macro contact() 1 //\nmacro gap() reach //\n", "").replace(
        "macro load1() traction(3, 0., -push) //\n", "").replace(
        'real push = physical("push", 100.), reach = physical("reach", 0.);\n', "")
    entry, warnings, _ = verdict(text, cells=2)
    principal = abs(stretch) / 2 + np.hypot(stretch, shear) / 2
    assert entry["largest_strain"] == pytest.approx(principal, rel=1e-6)
    assert entry["largest_rotation"] == pytest.approx(shear / 2, rel=1e-6)
    assert entry["verdict"] == expected
    assert f"strain is {principal:.2g}" in entry["reason"] or expected == "ok"
    assert any("results are" in line for line in warnings) == (expected != "ok")


@pytest.mark.parametrize("turn, expected", [(0.05, "ok"), (-0.2, "questionable"), (0.5, "invalid")])
def test_a_rotation_that_supports_prescribe_is_judged(verdict, turn, expected):
    """Of a whole body: linear kinematics stretch it by the square of the angle over two."""
    text = BLOCK.replace("macro support() on(4, u1 = 0., u2 = 0.) //", "macro displacement1() "
                         f"on(4, u1 = ({-turn})*y, u2 = ({turn})*x) //")
    text = text.replace("macro contact() 1 //\nmacro gap() reach //\n", "")
    entry, _, _ = verdict(text.replace(', reach = physical("reach", 0.)', ""), cells=2, push=1e-3)
    assert entry["largest_rotation"] == pytest.approx(abs(turn), rel=1e-6)
    assert entry["largest_strain"] < 1e-6
    assert entry["verdict"] == expected and ("turns by" in entry["reason"]) == (expected != "ok")


WHEEL = HEAD.replace('subdomains("2x2");\n', 'subdomains("3");\nquasistatic(1.);\n') + '''
border tread(t=-0.6, 0.6) { x = 100*sin(t); y = 100 - 100*cos(t); label = 5; }
border right(t=0, 1) { x = 100*sin(0.6); y = 100 - 100*cos(0.6) + t*(100*cos(0.6)); label = 6; }
border axle(t=1, -1) { x = 100*sin(0.6)*t; y = 100; label = 7; }
border left(t=1, 0) { x = -100*sin(0.6); y = 100 - 100*cos(0.6) + t*(100*cos(0.6)); label = 6; }
addBody(buildmesh(tread(60) + right(10) + axle(12) + left(10)))
int[int] rail = [11, 12, 13, 12];
addBody(square(40, 6, [80*x - 40, 20*y - 20], label = rail))
real pull = physical("pull", 0.15);
macro young() 210e3 //
macro poisson() 0.3 //
macro support() on(11, u1 = 0., u2 = 0.) //
macro load1() traction(7, 0., -4.) //
macro amplitude1(t) min(1., 2*t) //
macro load2() traction(7, 4*pull, 0.) //
macro amplitude2(t) max(0., 2*t - 1) //
macro contactPair() 5, 13 //
macro friction() 0.3 //
include "export.idp"
'''


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.slow
def test_a_wheel_that_rolls_away_is_judged(verdict, element):
    """Pulled at its axle it has no equilibrium. Lever arms and normals that stay as they were make
    one, turned by the part of its weight that pulls.
    """
    entry, warnings, status = verdict(WHEEL, steps=4, element=element)
    assert status == 0 and entry["verdict"] == "questionable"
    assert any("results are questionable" in line for line in warnings)
    assert entry["largest_rotation"] == pytest.approx(0.15, rel=0.1)
    assert entry["normal_turn"] == pytest.approx(0.15, rel=0.1)
    resting, _, _ = verdict(WHEEL, steps=4, element=element, pull=0.0)
    assert resting["verdict"] == "ok" and resting["normal_turn"] < 0.01


@pytest.mark.parametrize("way, expected", [(1.0, "ok"), (6.0, "questionable"), (22.0, "invalid")])
@pytest.mark.some(1)
def test_a_block_drawn_along_another_body_is_judged(verdict, way, expected):
    """By its way over its length of 20: forces act where it stood. Contact that follows is as it
    should be, unless the distance that it lags behind says otherwise.
    """
    entry, _, status = verdict(DRAWN, steps=4, subdomains=3, way=way)
    assert status == 0 and entry["verdict"] == expected
    assert entry["largest_slide"] == pytest.approx(way / 20, rel=0.05)
    assert expected == "ok" or "largeSliding" in entry["reason"]
    follows, _, _ = verdict(DRAWN, steps=4, subdomains=3, way=way, linearization="updated")
    assert follows["largest_slide"] == 0.0


def test_a_gap_of_the_wrong_unit_is_said(verdict):
    entry, _, status = verdict(BLOCK, reach=-1e6)
    assert entry["verdict"] == "invalid" and status == 0


def test_a_gap_of_a_pair_is_judged_by_the_smaller_body(verdict):
    """Blocks 40 x 10 and 20 x 10: by 10 and by 4 of 15, the mean of the sides of the smaller one.
    """
    for reach, expected in ((-10.0, "questionable"), (-4.0, "ok"), (-1e3, "invalid")):
        entry, warnings, _ = verdict(PRESSED, reach=reach)
        assert entry["verdict"] == expected, entry
        said = [line for line in warnings if "the other body reaches through the body" in line]
        assert len(said) == (expected != "ok")
    assert "by 67 of its size" in said[0]


TREAD = HEAD + '''rectangle(0., 20., 0., 10.);
quasistatic(1.);
macro young() 50. //
macro poisson() 0.4 //
macro contact() 1 //
macro obstacle(x, y) (y + 0.1 + 0.05*(1. - cos(pi*x/10.))) //
macro largeSliding() 30. //
macro periodic() 2, 4 //
macro displacement1() on(3, u1 = 0., u2 = -0.3) //
include "export.idp"
'''


@pytest.mark.slow  # a history
def test_rows_of_joints_beside_contact_that_follows_are_no_nodes(verdict):
    """Their gap of zero had been taken for the least of a contact node beyond the last one."""
    entry, warnings, _ = verdict(TREAD, steps=2, cells=4)
    assert entry["verdict"] == "ok" and not any("not checked" in line for line in warnings)


def test_a_hook_past_a_ramp_leaves_the_obstacle_that_it_met(verdict):
    """Pushed by 3 mm round a radius of 2 mm: linear contact has no idea of the ramp any more."""
    entry, warnings, status = verdict(HOOK)
    assert status == 0 and entry["verdict"] == "invalid"
    assert entry["largest_normal_error"] > INVALID["largest_normal_error"]
    assert any("away from the opposite surface" in line for line in warnings)
    entry, _, _ = verdict(HOOK, push=0.3)  # it touches after 0.24 mm
    assert entry["largest_normal_error"] < QUESTIONABLE["largest_normal_error"]


def test_bodies_through_each_other_are_named(verdict):
    entry, warnings, status = verdict(PLATES)
    assert status == 0
    # the corners are 0.1 deep in a plate of length 6, but for the plate's own change of shape
    (_, _, depth), = [row for row in entry["overlaps"] if row[:2] == [13, 21]]
    assert depth == pytest.approx(0.1 / 6, rel=0.3)
    assert any("boundaries" in line and "overlap" in line for line in warnings)
    entry, _, _ = verdict(PLATES, down=0.39)
    assert entry["overlaps"] == [] and entry["verdict"] == "ok"


CORNER = """include "scene.idp"
units("mm", "MPa");
subdomains("3");
int[int] block = [21, 22, 23, 24], wall = [31, 32, 33, 34];
addBody(square(4, 2, [8*x, 2*y]))
addBody(square(4, 4, [3.9*x, 2.1 + 3.9*y], label = block))
addBody(square(2, 4, [3.9 + x, 2.1 + 3.9*y], label = wall))
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) + on(32, u1 = 0., u2 = 0.) //
macro displacement1() on(23, u1 = 0., u2 = -{down}) //
macro contactPair() 22, 34 //
include "export.idp"
"""


def test_corners_are_named_by_the_edge_that_faces(verdict):
    """A block beside a wall, with contact there, goes into the floor: not by the flank's label."""
    entry, warnings, _ = verdict(CORNER.replace("{down}", "0.3"))
    deepest = entry["overlaps"][0]
    assert deepest[:2] == [3, 21] and deepest[2] == max(row[2] for row in entry["overlaps"])
    assert any("boundaries 3 and 21 overlap" in line for line in warnings)
    assert all(22 not in row[:2] and 24 not in row[:2] for row in entry["overlaps"])


@pytest.mark.parametrize("pin", ["first", "last"])
def test_it_is_enough_that_one_body_has_vertices_in_the_other(verdict, pin):
    """A pin in a plate between its vertices, 0.3 deep, whichever is declared first."""
    lines = ["addBody(square(8, 2, [8*x, 2*y], label = low))",
             "addBody(square(1, 6, [3.2 + 0.6*x, 2.2 + 3*y], label = high))"]
    text = PLATES.replace("addBody(square(6, 2, [1 + 6*x, 2.4 + 2*y], label = high))\n", "")
    text = text.replace(lines[0], "\n".join(lines[:: -1 if pin == "first" else 1]))
    entry, _, _ = verdict(text)
    assert max(depth for *labels, depth in entry["overlaps"]) == pytest.approx(0.3 / 3, rel=1e-3)


def test_rigid_motion_of_a_free_body_is_no_strain(solved):
    """The blocks of hard/slope glide down as a whole."""
    run = solved("slope")
    entry = run.summary["validity"]
    assert entry["verdict"] == "ok" and entry["largest_strain"] < 1e-5


def test_what_polygons_lack_of_a_curve_is_there_before_the_load(verdict):
    """A pin in a bush of its size, with other vertices: the polygons are up to h^2/(8 R) = 0.05
    apart before anything moves, of which contact conditions know. What the displacement of 1e-4
    adds is slip times the turn of a chord at its ends, h/(2 R) = 0.13, over a length of 20 at
    least.
    """
    entry, _, _ = verdict(BUSH)
    assert entry["largest_normal_error"] < 0.13 * 1e-4 / 20 * 2
    assert entry["verdict"] == "ok"


@pytest.mark.parametrize("scene", ["bar", "hertz-bodies", "pin", "pressfit", "stack", "tutorial",
                                   "wedge", "zones"])
@pytest.mark.some(1)
def test_scenes_that_ship_are_ok(solved, scene):
    entry = solved(scene).summary["validity"]
    assert entry["verdict"] == "ok"
    # rounding or, on curved boundaries, slip times slope: no part of what polygons lack of curves
    assert entry["largest_normal_error"] < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_edges_cross_where_both_lines_meet_inside(seed):
    """By the parameters of the point that two lines have in common; edges of one vertex do not."""
    rng = np.random.default_rng(seed)
    vertex = rng.standard_normal((24, 2)) * [1.0, 3.0]
    ends = np.array([rng.choice(24, 2, replace=False) for _ in range(30)])
    start, end = vertex[ends].transpose(1, 0, 2)
    expected = set()
    for i in range(30):
        for k in range(i):
            if not set(ends[i]) & set(ends[k]):
                along = np.column_stack([end[i] - start[i], start[k] - end[k]])
                part = np.linalg.solve(along, start[k] - start[i])
                if ((part > 0) & (part < 1)).all():
                    expected.add((k, i))
    found = true_distance.crossings(start, end, ends)
    assert {tuple(sorted(map(int, pair))) for pair in found} == expected and len(expected) > 10
    assert len(found) == len(expected)


FLUSH = '''include "scene.idp"
units("mm", "MPa");
int[int] low = [11, 12, 13, 14], high = [21, 22, 23, 24];
addBody(square(8, 4, [4*x, 2*y - 2], label = low))
bodyMaterial("low", 1000., 0.3);
addBody(square(9, 4, [4*x, 2*y], label = high))
bodyMaterial("high", 500., 0.2);
macro support() on(11, u1 = 0., u2 = 0.) //
macro displacement1() on(23, u1 = 0.04, u2 = -0.1) //
macro contactPair() 21, 13 //
macro friction() 0.1 //
macro normalCompliance() 300. //
include "export.idp"
'''


def test_rough_blocks_that_end_flush_do_not_overlap_beside_their_contact(solved, scene):
    """A corner of the one is in the other by its asperities, nearer to the side than to the top."""
    run = solved(scene(FLUSH))
    assert (run.contact["u_n"] - run.contact["gap"]).max() > 0.01
    assert run.summary["validity"]["verdict"] == "ok"


JAWS = """include "scene.idp"
real turn = physical("turn", 0.);
border under(t = 0, 1) { x = 2*t; y = -1; label = 1; }
border lowEnd(t = 0, 1) { x = 2; y = -1 + 0.98*t; label = 2; }
border low(t = 0, 1) { x = 2 - 1.5*t; y = -0.02; label = 7; }
border root(t = 0, 1) { x = 0.5; y = -0.02 + 0.04*t; label = 9; }
border high(t = 0, 1) { x = 0.5 + 1.5*t; y = 0.02; label = 8; }
border highEnd(t = 0, 1) { x = 2; y = 0.02 + 0.98*t; label = 4; }
border above(t = 0, 1) { x = 2 - 2*t; y = 1; label = 3; }
border back(t = 0, 1) { x = 0; y = 1 - 2*t; label = 5; }
real c = cos(turn*pi/180.), s = sin(turn*pi/180.);
body = movemesh(buildmesh(under(8) + lowEnd(4) + low(15) + root(1) + high(18) + highEnd(4)
                          + above(8) + back(8)), [c*x - s*y, s*x + c*y]);
macro young() 130. //
macro poisson() 0. //
macro support() on(5, u1 = 0., u2 = 0.) //
macro load1() pressure(3, 0.4) + pressure(1, 0.6) + traction(4, -0.02*c, -0.02*s) //
macro contactPair() 7, 8 //
macro normalCompliance() 300. //
include "export.idp"
"""


@pytest.mark.parametrize("turn", [0, 13, 90, 180])
def test_jaws_that_end_flush_do_not_overlap_beside_their_contact(verdict, turn):
    """One body, whose faces press by their asperities, and an end of the other edge behind each:
    wherever it is turned to.
    """
    entry, _, status = verdict(JAWS, turn=turn)
    assert status == 0 and entry["overlaps"] == [] and entry["verdict"] == "ok"


def test_blocks_with_a_clearance_that_end_flush_do_not_overlap_beside_their_contact(solved, scene):
    """Surfaces behind those that are drawn touch where the drawn ones have passed each other."""
    run = solved(scene(FLUSH, ("normalCompliance() 300.", "pairGap() 0.05")))
    assert (run.contact["status"] != "open").any()
    assert run.summary["validity"]["verdict"] == "ok"
