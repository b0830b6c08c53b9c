"""Contact nodes from the parts of a boundary that end in a vertex: how many, and which label."""

import re

import numpy as np
import pytest

from driver import environment
from driver.contact.nodes import TURN, merge_parts
from driver.errors import InputError


def polygon(sides: int, label, cut) -> np.ndarray:
    """Parts of the dual segments of a regular polygon; `label`, `cut` of edge k."""
    angle = 2 * np.pi * np.arange(sides) / sides
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    rows = [(label(k), end % sides, 0.5, *(0.5 * normal[k]), 0.5 * k, 0.0, 0.0)
            for k in range(sides) for end in (k, k + 1)]
    return np.array(sorted(rows, key=lambda row: cut(row[1])))


@pytest.mark.parametrize("sides, count", [(4, 8), (6, 12), (8, 16), (10, 20), (11, 11), (12, 12),
                                          (40, 40)])
def test_polygon_of_a_circle_has_a_node_at_each_vertex(sides, count):
    """From eleven sides on; the corners of others have two. Labels and cuts make no difference."""
    rng = np.random.default_rng(sides)
    order = rng.permutation(sides)
    tables = [polygon(sides, lambda k: 1, lambda vertex: vertex),
              polygon(sides, lambda k: 1 + k % 3, lambda vertex: order[int(vertex)])]
    nodes = [merge_parts(table, ["gap"], []) for table in tables]
    for found in nodes:
        assert len(found.gid) == count
        assert found.weight == pytest.approx(np.full(count, 1.0 if count == sides else 0.5))
    kept = [{(gid, *np.round(normal, 9)): gap for gid, normal, gap in
             zip(found.gid, found.normal, found.columns["gap"])} for found in nodes]
    assert kept[0].keys() == kept[1].keys()
    assert all(kept[0][key] == pytest.approx(kept[1][key]) for key in kept[0])


def test_reported_label_is_that_of_the_longest_part():
    """Of parts that only rounding tells apart the smallest label's."""
    rows = [(7, 0, 0.6, 0.6, 0.0, 0, 0), (3, 0, 0.4, 0.4, 0.0, 0, 0),
            (7, 1, 0.5 + 1e-13, 0.5, 0.0, 0, 0), (3, 1, 0.5, 0.5, 0.0, 0, 0)]
    for turn in (1, -1):
        assert merge_parts(np.array(rows[::turn]), [], []).label.tolist() == [7, 3]


def test_more_than_two_directions_are_refused():
    """Three conditions act on two displacements."""
    angles = np.deg2rad([0, 120, 240])
    rows = [(k, 0, 1.0, np.cos(a), np.sin(a), 0, 0) for k, a in enumerate(angles)]
    with pytest.raises(InputError, match="more than two directions"):
        merge_parts(np.array(rows), [], [])


def corner(label, gid, normal, weight=1.0, gap=0.0, place=(0.0, 0.0)):
    """A part of the dual segment at a vertex."""
    size = np.hypot(*normal)
    return (label, gid, weight, *(weight * c / size for c in normal), weight * gap, *place)


def test_pairs_that_go_on_in_one_another_are_one_boundary():
    """Where first labels share a vertex without a corner; others stay apart, in their order."""
    rows = [corner(1, 0, (0, 1)), corner(1, 1, (0, 1)), corner(2, 1, (0.1, 1)),
            corner(2, 2, (0.1, 1)), corner(3, 2, (1, 0.1)), corner(3, 3, (1, 0.1)),
            corner(4, 9, (0, 1)), corner(5, 8, (0, 1)), corner(5, 3, (1, 0.2))]
    pairs = [(4, 40), (1, 10), (2, 20), (3, 30), (5, 50)]
    nodes = merge_parts(np.array(rows), ["gap"], pairs)
    assert nodes.meeting == [[(4, 40)], [(1, 10), (2, 20)], [(3, 30), (5, 50)]]
    family = {int(gid): int(of) for gid, of in zip(nodes.gid, nodes.family) if gid not in (2,)}
    assert family == {0: 2, 1: 2, 3: 3, 8: 3, 9: 1}
    assert sorted(nodes.family[nodes.gid == 2]) == [2, 3]
    assert merge_parts(np.array(rows), ["gap"], []).meeting == []


def test_a_node_is_the_sum_of_its_parts():
    """Weights add up, normals and columns are means; of curved sides weights count along the
    normal.
    """
    rows = np.array([corner(7, 5, (0, -1), 1.0, 2.0, (3, 4)),
                     corner(7, 5, (0.28, -0.96), 3.0, 6.0, (3, 4))])
    nodes = merge_parts(rows, ["gap"], [])
    assert nodes.weight.tolist() == [4.0] and nodes.length.tolist() == [4.0]
    np.testing.assert_allclose(nodes.columns["gap"], [5.0])
    total = np.array([0.84, -1 - 2.88])
    np.testing.assert_allclose(nodes.normal, [total / np.linalg.norm(total)])
    assert nodes.xy.tolist() == [[3, 4]] and nodes.members == {(7, 5): [0]}
    curved = merge_parts(rows, ["gap"], [], curved=True)
    np.testing.assert_allclose(curved.weight, [np.linalg.norm(total)])
    assert curved.length.tolist() == [4.0]
    apart = np.array([corner(7, 5, (0, -1), 1.0, 2.0), corner(7, 5, (1, 0), 3.0, 6.0)])
    assert len(merge_parts(apart, ["gap"], []).gid) == 2
    one = merge_parts(apart, ["gap"], [], one_a_vertex=True)
    assert len(one.gid) == 1 and one.columns["gap"].tolist() == [5.0]


@pytest.mark.parametrize("labels", [(7, 7), (3, 7)])
def test_normals_of_obstacles_are_those_of_whole_nodes(labels):
    """Of parts that different subdomains or labels have; those that they make alike are one node.

    A part that faces an obstacle below and one that does not make a node that does not; at a
    corner both flanks may face it. Normals count with their length, as of rings.
    """
    def below(columns, normal):
        assert columns["gap"].shape == (len(normal),)
        return np.where(normal[:, 1:] < -1e-6, np.array([[0.0, -0.5]]), np.nan)

    one, other = labels
    slant = np.sin(0.1), np.cos(0.1)
    rows = np.array([corner(one, 0, (slant[1], -slant[0])), corner(other, 0, (slant[1], slant[0])),
                     corner(one, 1, (0.8, -0.6)), corner(other, 1, (-0.6, -0.8), 3.0, 2.0)])
    assert len(merge_parts(rows, ["gap"], []).gid) == 3
    nodes = merge_parts(rows, ["gap"], [], normals=below)
    assert nodes.gid.tolist() == [0, 1] and nodes.weight.tolist() == [2.0, 4.0]
    np.testing.assert_allclose(nodes.normal, [[1, 0], [0, -1]], atol=1e-12)
    np.testing.assert_allclose(nodes.columns["gap"], [0.0, 1.5])
    curved = merge_parts(rows, ["gap"], [], curved=True, normals=below)
    np.testing.assert_allclose(curved.weight, [2 * slant[1], 2.0])


CORNER = """include "scene.idp"
subdomains("1");
rectangle(0., 2., 0., 1.);
rotate(20.);
macro young() 1. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) + on(2, u2 = 0.) //
macro contact() 1, 2 //
macro friction() 0.5 //
include "export.idp"
"""


@pytest.mark.parametrize("support, act", [("", 2), (" + on(2, u2 = 0.)", 1)])
def test_a_support_leaves_a_corner_one_condition_at_a_time(built, named_scene, support, act):
    """Contact of both sides; where the vertex moves one way alone their rows depend on that."""
    text = CORNER.replace(" + on(2, u2 = 0.)", support)
    contact = built(named_scene(f"corner{act}", text), reduce=False, cells=2).structure.contact
    (one, two, conditions, _), = contact.corners
    corner = 2 * np.array([np.cos(np.deg2rad(20)), np.sin(np.deg2rad(20))])
    assert contact.gid[one] == contact.gid[two] and contact.xy[one] == pytest.approx(corner)
    assert conditions == act


def test_the_library_and_the_driver_have_corners_alike():
    """FreeFEM gives a gap and a side to both conditions of what the driver makes two nodes of."""
    text = (environment.LIBRARY / "contact.idp").read_text()
    degrees, = re.findall(r"^real sharpest = cos\((\d+)\*pi/180\);", text, re.MULTILINE)
    assert np.cos(np.radians(float(degrees))) == pytest.approx(TURN, rel=1e-15)
