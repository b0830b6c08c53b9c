"""Images of what repeats itself: where they are, what they have, which periods there may be."""

import numpy as np
import pytest

from driver.contact import periods
from driver.contact.periods import Periods
from driver.contact.side import Side
from driver.errors import InputError


def of(*ways) -> Periods:
    """Periods without nodes."""
    return Periods(np.zeros(0, int), np.zeros((0, 2), int), np.array(ways, float))


@pytest.mark.parametrize("ways, start, far, moves", [
    ([(4, 0)], 0.0, (0, 4), [0, -4, 4]),  # images that touch come beside as well
    ([(4, 0)], 1.0, (0, 4), [0, -4]), ([(-4, 0)], 1.0, (0, 4), [0, -4]),
    ([(4, 0)], 21.0, (0, 4), [0, -24, -20]), ([(4, 0)], 1.0, (0, 9), [0, -4, 4, 8])])
def test_images_are_those_that_come_beside(ways, start, far, moves):
    """Of a side from `start` to start + 4, beside places from far[0] to far[1]."""
    near = np.array([[far[0], 0.0], [far[1], 0.0]])
    found = of(*ways).offsets(near, np.array([[start, 1.0], [start + 4.0, 1.0]]))
    assert found[0].tolist() == [0, 0] and sorted(found[:, 0]) == sorted(moves)
    assert not found[:, 1].any()


def test_images_in_two_directions_are_all_sums_of_periods():
    """A unit square about the origin, one about (3.5, -2.5): moved by -4 or -3, and 3 or 2."""
    square = np.array([[-0.5, -0.5], [0.5, 0.5]])
    found = of((1, 0), (0, 1)).offsets(square, square + [3.5, -2.5])
    assert sorted(map(tuple, found[1:])) == [(-4, 2), (-4, 3), (-3, 2), (-3, 3)]


def test_a_repeated_side_has_the_nodes_and_edges_of_every_image():
    """Three nodes and two edges, twice; what belongs to an edge is that of its image."""
    side = Side(np.array([[1.0, 0], [2, 0], [3, 0]]), np.array([[1, 0], [2, 1]]),
                np.array([[0.0, 1], [0.1, 1]]), length=np.array([5.0, 6.0]))
    found, times = of((2, 0)).repeated(side, np.array([[0.0, 0], [0.9, 0]]))
    assert times == 2
    np.testing.assert_array_equal(found.xy[:, 0], [1, 2, 3, -1, 0, 1])
    np.testing.assert_array_equal(found.edges, [[1, 0], [2, 1], [4, 3], [5, 4]])
    np.testing.assert_array_equal(found.length, [5, 6, 5, 6])
    assert found.bow is None and found.edge_normal.shape == (4, 2)


def test_nodes_in_one_place_have_one_normal():
    """A roof from (0, 0) to (2, 0) over (1, 0.1), which goes on: its ends are valleys.

    By themselves they have the normals of their edges.
    """
    side = Side(np.array([[0.0, 0], [1, 0.1], [2, 0]]), np.array([[1, 0], [2, 1]]),
                np.array([[-0.1, 1], [0.1, 1]]) / np.hypot(0.1, 1))
    np.testing.assert_allclose(side.nodal_normals()[0], side.edge_normal[0])
    known = Periods(np.array([7, 9]), np.array([[9, 7]]), np.array([[2.0, 0]]))
    side.same = known.same_of(np.array([7, 8, 9]))
    assert side.same.tolist() == [[2, 0]] and not len(known.same_of(np.array([8, 9])))
    np.testing.assert_allclose(side.nodal_normals(), [[0, 1]] * 3, atol=1e-15)


@pytest.mark.parametrize("way, ways, new", [
    ((4, 0), [], True), ((4, 0), [(4, 0)], False), ((-4, 1e-9), [(4, 0)], False),
    ((0, 1), [(4, 0)], True), ((4, 1), [(4, 0)], True), ((0, 1), [(4, 0), (0, -1)], False)])
def test_periods_are_those_of_two_directions(way, ways, new):
    """The same one, either way, is no other."""
    found = periods._is_new(np.array(way, float), np.array(ways, float).reshape(-1, 2))
    assert found == new


@pytest.mark.parametrize("way, ways", [((2, 0), [(4, 0)]), ((1, 1), [(4, 0), (0, 1)])])
def test_several_periods_in_one_direction_are_refused(way, ways):
    """And so is a third direction."""
    with pytest.raises(InputError, match="give them one period"):
        periods._is_new(np.array(way, float), np.array(ways, float))
