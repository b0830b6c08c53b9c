"""Straight sides that stand for curves, on the outline of a body."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.estimates.polygons import stand_for_curves


def problem(rings, curved=()):
    """Of closed outlines, each the (n, 2) vertices and the labels (n,) of the sides after them."""
    places = np.concatenate([place for place, _ in rings])
    edges, first = [], 0
    for place, label in rings:
        own = first + np.arange(len(place))
        edges.append(np.column_stack([own, np.roll(own, -1), np.broadcast_to(label, len(own))]))
        first += len(place)
    half = len(places) // 2
    subs = [SimpleNamespace(node_gid=gid, xy=places[gid])
            for gid in (np.arange(half + 1), np.arange(half, len(places)))]
    structure = SimpleNamespace(subdomains=subs, outer_edges=np.concatenate(edges))
    return SimpleNamespace(structure=structure, operator=SimpleNamespace(comm=MPI.COMM_SELF),
                           manifest=SimpleNamespace(nodes=len(places), curved=list(curved)))


def circle(sides):
    angle = -2 * np.pi * np.arange(sides) / sides
    return np.column_stack([np.cos(angle), np.sin(angle)])


SQUARE = 4 * np.array([[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [-1, 1]])


@pytest.mark.parametrize("sides", [6, 12, 200])
def test_a_hole_is_a_polygon_for_a_curve(sides):
    assert stand_for_curves(problem([(SQUARE, 1), (circle(sides), 5)]))
    assert not stand_for_curves(problem([(SQUARE, 1), (circle(sides), 5)], curved=[5]))


def test_corners_are_no_curves():
    """Right angles of one label, a slight bend alone, and one where labels meet."""
    assert not stand_for_curves(problem([(SQUARE, 1)]))
    bent = np.array([[-4, -4], [-2, -4], [0, -4], [2, -3.6], [4, -3.2], [4, 4], [-4, 4]])
    assert not stand_for_curves(problem([(bent, 1)]))
    arc = np.array([[-4, -4], [-1, -4.4], [1, -4.4], [4, -4], [4, 4], [-4, 4]])
    assert stand_for_curves(problem([(arc, 1)]))
    assert not stand_for_curves(problem([(arc, [1, 2, 3, 4, 5, 6])]))
