"""Distances to rigid obstacles that shift, turn and change, at nodes made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.contact.motion import ObstacleMotion
from driver.effects import obstacle_motion
from driver.errors import InputError

TIMES = np.array([0.0, 0.5, 1.0])


def nodes(xy, normal, columns=None, label=None, members=()) -> SimpleNamespace:
    """Contact nodes on an obstacle at places and with normals (n, 2)."""
    xy, normal = np.array(xy, float), np.array(normal, float)
    n = len(xy)
    return SimpleNamespace(xy=xy, normal=normal, gid=np.arange(n), family=np.zeros(n, int),
                           label=np.full(n, 1) if label is None else np.array(label),
                           columns=columns or {}, members=members)


def room(**more) -> obstacle_motion.Room:
    manifest = SimpleNamespace(rooms={"obstacle_motion": {"own_normals": True}, **more},
                               patterns=[], steps=2, t_end=1.0)
    return obstacle_motion.Room("obstacle_motion", manifest)


def test_the_distance_of_a_plane_is_that_along_the_normal():
    """Whatever multiple of the distance the function is: d over the cosine between both normals.

    Where the line along the normal misses the plane, or the function is flat, it stays finite and
    is no shorter than the way there.
    """
    slope, facing = np.array([0.6, 0.8]), np.array([[0, -1], [-0.6, -0.8], [1, 0], [0, -1]])
    at = nodes(np.zeros((4, 2)), facing)
    gradient = np.tile(3 * slope, (3, 4, 1))
    gradient[:, 3] = 0.0
    phi = 3 * np.outer(1 + TIMES, np.ones(4)) * 0.5
    found = obstacle_motion._distance(phi, gradient, at, TIMES)
    way = 0.5 * (1 + TIMES)
    np.testing.assert_allclose(found[:, 0], way / 0.8, rtol=1e-14)
    np.testing.assert_allclose(found[:, 1], way, rtol=1e-14)
    assert np.isfinite(found).all() and (found[:, 2] >= way).all() and (found[:, 3] > 0).all()


@pytest.mark.parametrize("reach, refused", [(0.1, False), (0.0, False), (-0.1, True)])
def test_an_obstacle_that_comes_from_behind_is_refused(reach, refused):
    """At the time and the place where it covers a node that looks away from it."""
    at = nodes([[2, 3], [4, 5]], [[0, -1], [0, 1]])
    phi, slope = np.ones((3, 2)), np.tile([0.0, 2.0], (3, 2, 1))
    phi[1:, 1] = reach
    phi[2, 0] = -0.5  # this one faces it: an overlap that contact undoes
    if not refused:
        assert obstacle_motion._distance(phi, slope, at, TIMES)[2, 0] == -0.25
        return
    with pytest.raises(InputError, match=r"\(4, 5\) at the time 0.5"):
        obstacle_motion._distance(phi, slope, at, TIMES)


def test_a_function_of_reversed_sign_is_refused_where_the_body_touches_at_the_start():
    """A body on its obstacle is no distance off by either sign, but by one of them inside it."""
    at = nodes([[-1, 0], [1, 0]], [[0, -1], [0, -1]])
    phi = np.tile(TIMES[:, None], 2) * 0.1  # lowered by time
    assert (obstacle_motion._distance(phi, np.tile([0.0, 1.0], (3, 2, 1)), at, TIMES) == phi).all()
    with pytest.raises(InputError, match=r"\(-1, 0\) at the time 0, but does not face it"):
        obstacle_motion._distance(phi, np.tile([0.0, -1.0], (3, 2, 1)), at, TIMES)


def test_a_side_that_leans_away_from_a_moving_obstacle_may_end_on_it():
    """A block that is widest at its foot, with its sides as contact: that is no reversed sign."""
    at = nodes([[0, 0], [1, 0], [1, 0], [0.5, 1]], [[0, -1], [0, -1], [0.8, 0.6], [0.8, 0.6]])
    phi = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    found = obstacle_motion._distance(phi, np.tile([0.0, 1.0], (3, 4, 1)), at, TIMES)
    np.testing.assert_array_equal(found[:, :3], 0.0)
    assert (found[:, 3] >= 1.0).all()


def test_even_obstacles_slide_along_their_labels_and_others_do_not():
    """Rounding of places is no unevenness; nor are steps from label to label, at whose common
    vertex the mean stands.
    """
    xy = np.column_stack([np.arange(5.0), np.zeros(5)])
    at = nodes(xy, np.tile([0, -1], (5, 1)), label=[1, 1, 1, 2, 2],
               members=[(1, 0), (1, 1), (1, 2), (2, 2), (2, 3), (2, 4)])
    along, still = np.tile(TIMES[:, None], 5), np.zeros((3, 5))
    even, uneven = np.array([1, 1, 1.5, 2, 2]), np.array([1, 1.1, 1.5, 2, 2])
    obstacle_motion._refuse_uneven(at, even + 1e-10, along)
    obstacle_motion._refuse_uneven(at, uneven, still)
    moving = along * (at.label == 2)
    obstacle_motion._refuse_uneven(at, uneven, moving)
    at.family[:2] = 1  # between bodies there is no obstacle
    obstacle_motion._refuse_uneven(at, uneven, along)
    at.family[:] = 0
    for unit in (1e-3, 1.0, 1e6):
        place = nodes(unit * xy, at.normal, label=at.label, members=at.members)
        obstacle_motion._refuse_uneven(place, unit * (even + [1e-10, 0, 0, 0, 0]), unit * along)
        with pytest.raises(InputError, match="label 1 slides"):
            obstacle_motion._refuse_uneven(place, unit * (even + [1e-7, 0, 0, 0, 0]), unit * along)
    with pytest.raises(InputError, match="label 1 slides"):
        obstacle_motion._refuse_uneven(at, uneven, along)
    with pytest.raises(InputError, match="label 2 slides"):
        obstacle_motion._refuse_uneven(at, even + [0, 0, 0, 0, 1e-8], along)


def test_a_plane_that_shifts_is_nearer_by_what_it_comes_along_the_normal():
    """And drags the surface by the rest; nodes of pairs keep their distances."""
    normal = np.array([[0.6, -0.8], [0.0, -1.0], [0.0, -1.0]])
    columns = {f"obstacle_{c}@{k}": np.full(3, way * k)
               for c, way in (("x", 0.5), ("y", -0.25)) for k in range(3)}
    columns |= {"obstacle_x_missed": np.array([0.0, 0.25, 0.1]),
                "obstacle_x_missed_at": np.array([0.1, 0.2, 0.3])}
    at = nodes([[0, 0], [1, 0], [2, 0]], normal, columns)
    at.family[2] = 1
    moved = room().motion(at, np.array([3.0, 3.0, 7.0]))
    np.testing.assert_allclose(moved.gap_at(1.0), [3 + 2 * (0.6 * 0.5 + 0.8 * 0.25), 3.5, 7])
    np.testing.assert_allclose(moved.way(0.5, 1.0)[:2], [0.8 * 0.5 - 0.6 * 0.25, 0.5])
    assert moved.missed == {"obstacleX": (0.25, 0.2)}
    assert obstacle_motion._missed({"a_missed": np.zeros(2), "a_missed_at": np.zeros(2)}, "a",
                                   np.zeros((3, 2)))[0] == 0.0
    np.testing.assert_allclose(
        obstacle_motion._missed({"a_missed": np.full(2, 4.0), "a_missed_at": np.ones(2)}, "a",
                                np.ones((3, 2))), (1.0, 1.0))


def test_obstacles_give_normals_that_stay_and_face_the_body():
    """Neither where the obstacle's own turn or turn round, nor beside the obstacle, nor to pairs,
    where there is no function. Their length is that of rings.
    """
    steady = np.array([[0.0, 2.0]] * 3)
    turning, reversing = steady + [[0, 0], [1e-3, 0], [0, 0]], steady * [[1], [-1], [1]]
    slopes = np.array([steady, steady, turning, reversing, 0 * steady, steady])
    normal = np.array([[0.6, -0.8], [1.0, -1e-9], [0, -1], [0, -1], [0, -1], [0, 1]])
    columns = {f"phi_{c}@{k}": slopes[:, k, i] for i, c in enumerate("xy") for k in range(3)}
    found = room().obstacle_normals(columns, normal)
    assert np.isnan(found[1:]).all()
    np.testing.assert_allclose(found[0], [0, -1])
    rings = room().obstacle_normals(columns | {"ring": np.full(6, 3.0)}, normal)
    np.testing.assert_allclose(rings[0], [0, -3])
    given = room()
    given.data["own_normals"] = False
    assert given.obstacle_normals is None


def test_cycles_end_where_they_begin():
    """An obstacle that comes back by the end of the cycle repeats its ways; another is refused."""
    def moved(*ways):
        columns = {f"obstacle_x@{k}": np.array([way]) for k, way in enumerate(ways)}
        return room(cycles={"start": 1}).motion(nodes([[0, 0]], [[0, -1]], columns), np.zeros(1))

    back = moved(0.0, 1.0, 1.0)
    assert back.again == 1 and back.way(0.0, 1.5)[0] == pytest.approx(1.0)
    with pytest.raises(InputError, match="an obstacle is at another place"):
        moved(0.0, 1.0, 1.001)


def turned(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize("angle", [1e-9, 0.3, 7.0])
def test_ways_of_a_surface_that_turns(angle):
    """What its points go by at the node, each for a moment, as shift and angle grow together; so
    that there and back again is no way at all.
    """
    pivot, xy, shift = np.array([0.3, -0.2]), np.array([1.0, 0.5]), np.array([0.1, 0.2])
    tangent = np.array([0.8, 0.6])
    motion = ObstacleMotion(np.array([0.0, 1.0]), np.zeros((2, 1)),
                            np.array([[0 * shift], [shift]]), np.array([[0.0], [angle]]),
                            pivot[None], xy[None], tangent[None])
    parts = 2000
    passed = np.zeros(2)
    for first, last in ((k / parts, (k + 1) / parts) for k in range(parts)):
        turn = turned((last - first) * angle)
        # of the point that is at the node first, and of the one that is there last
        after = pivot + last * shift + turn @ (xy - pivot - first * shift)
        before = pivot + first * shift + turn.T @ (xy - pivot - last * shift)
        passed += (after - before) / 2
    expected = passed @ tangent
    assert motion.way(0.0, 1.0)[0] == pytest.approx(expected, rel=1e-5)  # 1/24 (7/2000)^2 each
    assert motion.way(1.0, 0.0) == pytest.approx(-motion.way(0.0, 1.0), rel=1e-13)


def test_what_an_obstacle_does_is_told_by_its_histories():
    """Shifts and turns that are not zero; without any of them the distance of the nearest node."""
    times, n = np.array([0.0, 1.0]), 3
    gap = np.array([[1.0, 2.0, 3.0], [1.5, 0.5, 3.0]])
    still = ObstacleMotion(times, gap, np.zeros((2, n, 2)), np.zeros((2, n)), *np.zeros((3, n, 2)))
    assert still.histories(np.array([0, 1])) == {"distance": [1.0, 0.5]}
    assert still.histories(np.array([2])) == {}
    still.shift[1, 1, 1] = 0.25
    still.angle[1, 2] = 0.125
    assert still.histories(np.array([1, 2])) == {"shift_y": [0.0, 0.25]}
    assert still.of(np.array([2])).histories(np.array([0])) == {"angle": [0.0, 0.125]}
    still.own = True  # gapInTime beside a shift, which says only how fast the surface slides
    assert still.histories(np.array([1])) == {"shift_y": [0.0, 0.25], "distance": [2.0, 0.5]}
    assert still.histories(np.array([2])) == {"angle": [0.0, 0.125]}


PAIRS = """include "scene.idp"
subdomains("6");
int[int] below = [5, 6, 7, 8];
addBody(square(6, 4, [2*x, 1 + y]))
addBody(square(5, 2, [2*x, y], label = below))
macro contactPair() 1, 7 //
macro young() 1. //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 5 //
quasistatic(1.);
macro obstacleX(t) (0.25 + t) //
macro obstacleY(t) (0.5 - t) //
include "export.idp"
"""


def test_bodies_have_no_motion_of_an_obstacle(built, named_scene):
    """In whatever order pieces on obstacles and between bodies are exported."""
    problem = built(named_scene("pairs", PAIRS), reduce=False, steps=2)
    count = 0
    for contact in (sub.contact for sub in problem.subdomains if sub.contact is not None):
        rigid = contact.label == 5
        count += (~rigid).sum()
        for k, t in enumerate((0.0, 0.5, 1.0)):
            for name, value in (("x", 0.25 + t), ("y", 0.5 - t)):
                np.testing.assert_allclose(contact.column(f"obstacle_{name}@{k}"),
                                           np.where(rigid, value, 0.0), atol=1e-15)
        for name in ("obstacle_x_missed", "obstacle_y_missed_at"):
            assert name in contact.columns and not contact.columns[name][~rigid].any()
    assert count > 5
