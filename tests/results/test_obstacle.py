"""The polygon that an obstacle's curve is written as."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.following import Outline
from driver.files import read_table
from driver.results.obstacle import BEND, SIDES, polygon, write_obstacle


def sides_of(points: np.ndarray, closed: bool, rng) -> np.ndarray:
    """Polygon of the curve through `points` (n, 2), body on its left, given as a scene may give it:
    in any order, each segment from either end.
    """
    start, end = points, np.roll(points, -1, axis=0)
    start, end = (ends if closed else ends[:-1] for ends in (start, end))
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    normal = np.column_stack([-along[:, 1], along[:, 0]])  # to the body
    turned = (rng.random(len(start)) < 0.5)[:, None]
    start, end = np.where(turned, end, start), np.where(turned, start, end)
    order = rng.permutation(len(start))
    return polygon(SimpleNamespace(start=start[order], end=end[order], normal=normal[order]))


@pytest.mark.parametrize("size", [1e-3, 7.0])
def test_corners_stay_and_straight_sides_are_few(size):
    """A square of 400 segments: its corners, and no side longer than it need be."""
    rng, s = np.random.default_rng(3), np.linspace(0, 1, 100, endpoint=False)
    square = np.concatenate([np.column_stack(xy) for xy in (
        (s, 0 * s), (1 + 0 * s, s), (1 - s, 1 + 0 * s), (0 * s, 1 - s))]) - 0.5
    sides = sides_of(size * square, True, rng)
    start, end = sides[:, :2], sides[:, 2:]
    length = np.linalg.norm(end - start, axis=1)
    assert length.sum() == pytest.approx(4 * size)
    assert length.max() <= size / SIDES + 2 * size / 100
    assert 4 * SIDES / 2 < len(sides) <= 4 * (SIDES + 1)
    area = (start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]).sum() / 2
    assert area == pytest.approx(size**2)  # the body, on the left, is inside


def test_a_round_obstacle_turns_by_little_a_side():
    """Of 720 segments, half a degree each, so many make a side that it bends by BEND at most."""
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    sides = sides_of(np.column_stack([np.cos(angle), np.sin(angle)]), True,
                     np.random.default_rng(5))
    along = sides[:, 2:] - sides[:, :2]
    assert np.linalg.norm(along, axis=1).max() <= 2 * np.sin(BEND / 2 + np.pi / 720)
    assert len(sides) < 2.5 * 2 * np.pi / BEND


def test_an_open_curve_is_one_way_from_end_to_end():
    x = np.linspace(0, 1, 301)
    sides = sides_of(np.column_stack([x, 0.2 * np.sin(3 * x)]), False, np.random.default_rng(7))
    np.testing.assert_array_equal(sides[1:, :2], sides[:-1, 2:])
    assert sides[0, :2].tolist() == [0, 0] and sides[-1, 2] == 1


def test_where_an_obstacle_stands_in_every_step(tmp_path):
    """A bar that shifts, and then turns by 90 degrees about (1, 0) as well; a node that it does not
    concern moves otherwise. Nodes see it apart by rounding.
    """
    bar = SimpleNamespace(start=np.array([[0.0, 0.0]]), end=np.array([[1.0, 1.0]]),
                          normal=np.array([[0.0, 1.0]]))
    there = [[0.5, 2.0], [0.5 + 1e-15, 2.0 - 1e-15], [7.0, 7.0]]
    shift = np.array([[[0.0, 0.0]] * 3, there, there])
    motion = SimpleNamespace(times=np.arange(3), shift=shift, pivot=np.array([[1.0, 0.0]] * 3),
                             angle=np.array([[0.0] * 3, [0.0] * 3, [np.pi / 2] * 3]))
    following = SimpleNamespace(surface=Outline(bar, None), rigid=np.array([0, 1]), motion=motion)
    write_obstacle(tmp_path / "obstacle.csv", following, MPI.COMM_SELF)
    table = read_table(tmp_path / "obstacle.csv")
    rows = np.column_stack(list(table.values()))
    np.testing.assert_allclose(rows, [[0, 0, 0, 1, 1], [1, 0.5, 2, 1.5, 3], [2, 1.5, 1, 0.5, 2]],
                               atol=1e-15)
    following.motion = None
    write_obstacle(tmp_path / "still.csv", following, MPI.COMM_SELF)
    still = np.column_stack(list(read_table(tmp_path / "still.csv").values()))
    assert still.tolist() == [[0, 0, 0, 1, 1]]
