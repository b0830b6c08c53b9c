"""Vertices with two contact nodes: which rows depend on one another, and what is beside them."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.contact.beside import beside
from driver.contact.corner_pairs import corner_pairs

X, Y = [1.0, 0.0], [0.0, 1.0]
NONE, FIXED_X = np.empty(0, int), np.array([2 * 4])
SMOOTH, ROUGH = np.zeros(8, bool), np.ones(8, bool)


def vertex(normals, friction: bool, others=()) -> SimpleNamespace:
    """Contact nodes with `normals` at the vertex 4; `others`: (node, gid, value) of paired bodies.
    """
    normal, n = np.array(normals), len(normals)
    terms = [(k, 4, 1.0) for k in range(n)] + list(others)
    contact = SimpleNamespace(
        gid=np.full(n, 4), xy=np.zeros((n, 2)), normal=normal, normal_row=np.arange(n),
        tangent=np.column_stack([-normal[:, 1], normal[:, 0]]), paired=np.full(n, bool(others)),
        tangential_row=n + np.arange(n) if friction else np.full(n, -1))
    contact.term_node, contact.term_gid, contact.term_value = map(np.array, zip(*terms))
    contact.declared = contact
    return contact


@pytest.mark.parametrize("normals, friction, fixed, expected", [
    # a displacement has two components, so that two conditions are independent, four are not
    ([X, Y], False, NONE, []),
    ([X, Y], True, NONE, [(0, 1, 2, 1)]),
    # along the one component that a support leaves free everything depends on everything
    ([X, Y], True, FIXED_X, [(0, 1, 1, 1)]),
    ([[0.6, 0.8], Y], False, FIXED_X, [(0, 1, 1, 1)]),
    # between two obstacles that face one another one acts at a time
    ([X, [-1.0, 0.0]], False, NONE, [(0, 1, 1, 1)]),
    ([X, [-1.0, 0.0]], True, NONE, [(0, 1, 1, 1)]),
    ([X], True, NONE, [])])
def test_two_conditions_on_what_can_move(normals, friction, fixed, expected):
    found = corner_pairs(vertex(normals, friction), fixed, SMOOTH)
    assert found.tolist() == [list(pair) for pair in expected]


@pytest.mark.parametrize("normals, fixed, yields, expected", [
    ([X, Y], NONE, ROUGH, []),
    # what one of them leaves undetermined the other one's law does not know
    ([X, Y], NONE, np.array([True, False]), [(0, 1, 2, 1)]),
    # where one acts at a time both rub along the same displacement
    ([X, [-1.0, 0.0]], NONE, ROUGH, [(0, 1, 1, 1)]),
    ([X, Y], FIXED_X, ROUGH, [(0, 1, 1, 1)])])
def test_pressures_of_rough_sides_follow_from_where_the_vertex_is(normals, fixed, yields, expected):
    found = corner_pairs(vertex(normals, True), fixed, yields)
    assert found.tolist() == [list(pair) for pair in expected]


def test_between_bodies_rows_depend_nearly():
    """Both nodes see the other body's vertex 9, with a gap a little of vertex 8 as well: rows of
    four displacements that nearly are those of two.
    """
    across = [(0, 9, -1.0), (1, 9, -1.0)]
    assert corner_pairs(vertex([X, Y], True, across), NONE, SMOOTH).tolist() == [[0, 1, 2, 1]]
    nearly = [(0, 9, -0.97), (0, 8, -0.03), (1, 9, -1.0)]
    assert corner_pairs(vertex([X, Y], True, nearly), NONE, SMOOTH).tolist() == [[0, 1, 2, 0]]
    # faced by different parts of the other body they are conditions of their own
    apart = [(0, 9, -1.0), (1, 8, -1.0)]
    assert corner_pairs(vertex([X, Y], True, apart), NONE, SMOOTH).tolist() == []


def ring(friction: bool, apart: bool) -> SimpleNamespace:
    """A square hole, vertices 0 to 3 at its corners, around a body whose vertices 10 to 13 face the
    middles of its sides; 14 is the fifth of them if the body is `apart` there.
    """
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    side = [np.linalg.matrix_power(turn, k) @ [1.0, 0.0] for k in range(4)]
    gid = np.repeat(np.arange(4), 2)
    sides = (gid + np.tile([0, 1], 4)) % 4  # at which the flanks of vertex k end
    place = [side[k] + side[(k + 1) % 4] for k in gid]
    n, met = 8, 10 + sides
    met[-1] = 14 if apart else met[-1]
    normal = np.array([side[k] for k in sides])
    contact = SimpleNamespace(
        gid=gid, xy=np.array(place), normal=normal, normal_row=np.arange(n), tangent=normal @ turn,
        tangential_row=n + np.arange(n) if friction else np.full(n, -1), paired=np.ones(n, bool),
        term_node=np.tile(np.arange(n), 2), term_gid=np.append(gid, met),
        term_value=np.repeat([1.0, -1.0], n))
    contact.declared = contact
    return contact


@pytest.mark.parametrize("friction, apart, vertices", [
    (True, False, [2]), (True, True, []), (False, False, [])])
def test_a_hole_of_nothing_but_corners_has_one_that_is_not_independent(friction, apart, vertices):
    """What the flanks of the vertices differ by adds up to nothing around it; the first vertex by
    its place has two conditions at a time. The 14 rows that are left are independent.
    """
    contact = ring(friction, apart)
    B = np.zeros((8, 15))
    np.add.at(B, (contact.term_node, contact.term_gid), contact.term_value)
    assert np.linalg.matrix_rank(B) == (8 if apart else 7)
    found = corner_pairs(contact, NONE, SMOOTH)
    nodes = [np.flatnonzero(contact.gid == gid).tolist() for gid in vertices]
    assert found.tolist() == [[*pair, 2, 0] for pair in nodes]
    assert not len(corner_pairs(contact, NONE, ROUGH))
    assert all(contact.xy[k].tolist() == [-1, -1] for pair in nodes for k in pair)


def test_the_nodes_beside_a_corner_are_the_next_of_its_own_flanks():
    """Two flanks, nodes 0 to 2 and 3 to 5 with the corner in 2 and 3, and one that ends there."""
    contact = SimpleNamespace(
        xy=np.array([[-2, 0], [-0.5, 0], [0, 0], [0, 0], [0, 1], [0, 3], [0.1, 3]], float),
        chain=np.array([0, 0, 0, 1, 1, 1, 2]), family=np.array([1, 1, 1, 1, 1, 1, 1]),
        paired=np.ones(7, bool), normal_row=10 * np.arange(7),
        tangential_row=10 * np.arange(7) + 5, weight=np.array([1.0, 2, 4, 8, 16, 32, 64]))
    found = beside(contact, np.array([[2, 3], [3, 6], [5, 2]]), lambda rows: rows)
    assert found.known.tolist() == [True, False, True]
    assert found.rows[0].tolist() == [[10, 15], [40, 45]]
    assert found.rows[2].tolist() == [[40, 45], [10, 15]]
    assert found.ratio[0].tolist() == [2, 0.5] and found.ratio[2].tolist() == [2, 2]
