"""Sums, means and shares of what subdomains and nodes have, on a few triangles made by hand."""

from pathlib import Path
from types import SimpleNamespace

import constants
import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.states import OPEN, SLIP, STICK, ContactField
from driver.results import (contact_edges, places, probes, quantities, screen, shares, summary,
                            tables, touch)
from driver.results.boundaries import _one_boundary
from driver.results.ledger import shares as seconds_of
from driver.results.nodal_means import NodalMeans
from driver.results.resultants import resultants
from driver.results.touch import Touch, between_nodes
from driver.scene import elements, sides

XY = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1], [1, 1.5], [2, 1]])
TRIANGLES = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])


def torn():
    """Node numbers, places and triangles of two subdomains that share an edge, and a third body."""
    gid = np.array([0, 1, 3, 4, 1, 2, 4, 5, 7, 8, 9])
    xy = np.concatenate([XY[[0, 1, 3, 4, 1, 2, 4, 5]], XY[:3] + [5.0, 0.0]])
    xy[10] += [0.0, 1.0]
    return gid, xy, np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [8, 9, 10]])


PARTS = slice(0, 2), slice(2, 4), slice(4, 5)  # triangles of the subdomains of `torn`


def means_of(gid, xy, triangles):
    """NodalMeans of the subdomains of `torn`."""
    nodes = slice(0, 4), slice(4, 8), slice(8, 11)
    return NodalMeans(MPI.COMM_SELF, [gid[own] for own in nodes], [xy[own] for own in nodes],
                      [triangles[part] - own.start for part, own in zip(PARTS, nodes)])


def test_means_at_nodes_go_over_subdomains_and_not_over_bodies():
    """Weighted with areas; in the middle of a side the mean of its ends."""
    gid, xy, triangles = torn()
    means = means_of(gid, xy, triangles)
    values = np.random.default_rng(1).random((5, 3, 2))
    found, area = means(lambda s: values[PARTS[s]], 2), elements.areas(xy[triangles])
    for node in range(len(gid)):
        here = [(t, k) for t in range(5) for k in range(3) if gid[triangles[t, k]] == gid[node]]
        mean = sum(area[t] * values[t, k] for t, k in here) / sum(area[t] for t, _ in here)
        np.testing.assert_allclose(found[node], mean, rtol=1e-13)
    assert np.concatenate(means.bodies()).tolist() == [0, 0, 0, 0, 1]
    corner = xy[triangles[-1:]]
    middles = (corner[0, [1, 2, 0]] + corner[0, [2, 0, 1]]) / 2
    six = NodalMeans(MPI.COMM_SELF, [np.arange(6)], [np.concatenate([corner[0], middles])],
                     [np.arange(6)[None]])
    np.testing.assert_allclose(six(lambda s: values[-1:], 2)[3:],
                               (values[-1, [1, 2, 0]] + values[-1, [2, 0, 1]]) / 2)


def test_the_ledger_knows_the_largest_value_of_every_pattern(monkeypatch):
    """Of loads and of prescribed displacements, in any subdomain, by their sizes."""
    def sub(loads, fixed_values):
        return SimpleNamespace(loads=np.array(loads), fixed_values=np.array(fixed_values))

    subs = [sub([[1.0, -4.0], [0.0, 0.0], [0.0, 0.0]], np.zeros((3, 0))),
            sub([[2.0, 3.0], [0.5, 0.0], [0.0, 0.0]], [[0.0], [-0.75], [0.0]])]
    problem = SimpleNamespace(structure=SimpleNamespace(patterns=3, subdomains=subs),
                              manifest=SimpleNamespace(factors="factors"))
    writer = SimpleNamespace(operator=SimpleNamespace(comm=MPI.COMM_SELF), history_rows="rows")
    monkeypatch.setattr(summary, "ledger", lambda *given: given)
    monkeypatch.setattr(summary, "asdict", lambda sizes: sizes)
    found = summary._ledger(problem, "sizes", "solver", writer)
    assert found[:3] == ("solver", "sizes", "factors") and found[4] == "rows"
    assert found[3].tolist() == [4.0, 0.75, 0.0]


def test_bodies_are_numbered_by_their_smallest_nodes():
    gid, xy, triangles = torn()
    means = means_of(9 - gid, xy, triangles)
    assert np.concatenate(means.bodies()).tolist() == [1, 1, 1, 1, 0]


@pytest.mark.parametrize("forces, found", [(1e-13, 0.0), (1e-3, 0.4)])
def test_the_balance_of_rounding_is_none(forces, found):
    """As where a support carries a body along that touches nothing."""
    writer = SimpleNamespace(record=SimpleNamespace(displacements=[0.0, 5e-4]), balance=0.4,
                             largest_forces=forces)
    assert summary._balance(writer, 8e4) == found


def test_loads_reactions_and_contact_balance():
    """Nodal forces of a block, K u = f + reaction + contact: sums by component, sizes their
    absolute values; between bodies contact cancels.
    """
    rng = np.random.default_rng(2)
    n, fixed = 4, np.array([0, 1, 3])
    load, inner = rng.standard_normal((2, 2 * n)), rng.standard_normal(2 * n)
    sub = SimpleNamespace(loads=load, dof_component=np.tile([0, 1], n),
                          springs=rng.random((n, 3)))
    held = rng.standard_normal(3)
    b = SimpleNamespace(paired=np.array([False, True]), weight=np.array([2.0, 3.0]),
                        normal=np.array([[0.6, -0.8], [0, 1.0]]),
                        tangent=np.array([[0.8, 0.6], [-1.0, 0]]))
    operator = SimpleNamespace(
        acting=[0], comm=MPI.COMM_SELF, forces_on_supports=lambda multipliers: [held],
        structure=SimpleNamespace(subdomains=[sub], fixed=[fixed], patterns=2,
                                  contact=SimpleNamespace(declared=b)))
    u = rng.standard_normal(2 * n)
    state = {ContactField.SIGMA_N: np.array([-1.5, -9.0]),
             ContactField.SIGMA_T: np.array([0.25, 9.0]), "held": np.array([0.75, 9.0])}
    found, size = resultants(operator, SimpleNamespace(weights=np.array([0.5, -2.0]),
                                                       multipliers=None), [u], [inner], state)
    whole = 0.5 * load[0] - 2 * load[1]
    react = np.zeros(2 * n)
    react[fixed] = (inner - whole)[fixed] + held
    xx, xy, yy = sub.springs.T
    x, y = u[::2], u[1::2]
    sprung = -np.column_stack([xx * x + xy * y, xy * x + yy * y])
    contact = 2.0 * (-1.5 * b.normal[0] + 0.25 * b.tangent[0])
    np.testing.assert_allclose(found["load"], whole.reshape(-1, 2).sum(axis=0))
    np.testing.assert_allclose(found["reaction"], react.reshape(-1, 2).sum(axis=0)
                               + sprung.sum(axis=0) + 0.75 * b.tangent[0])
    np.testing.assert_allclose(found["contact"], contact)
    np.testing.assert_allclose(size, np.abs(whole).reshape(-1, 2).sum(axis=0)
                               + np.abs(react).reshape(-1, 2).sum(axis=0)
                               + np.abs(sprung).sum(axis=0) + np.abs(contact))


@pytest.mark.parametrize("revolved, quadratic", [(False, False), (True, False), (True, True)])
def test_a_node_where_labels_meet_is_shared_as_its_segment_is(revolved, quadratic):
    """Lengths of both edges, or what the rings of their functions have in it."""
    place = np.array([[1.0, 0.0], [2.0, 0.0], [5.0, 0.0]])
    b = SimpleNamespace(gid=np.array([4, 2, 7]), xy=place, label=np.array([1, 1, 3]),
                        edges=np.array([[0, 1], [2, 1]]), axisymmetric=revolved,
                        meeting=[], paired=np.zeros(3, bool),
                        clamped=SimpleNamespace(gid=np.zeros(0, int), xy=np.zeros((0, 2))))
    structure = SimpleNamespace(
        contact=SimpleNamespace(declared=b), outer_middles=np.arange(2 * quadratic),
        outer_edges=np.array([[9, 4, 6], [4, 2, 1], [2, 7, 3]]))
    labels, parts = shares.label_shares(structure)
    first = {(False, False): 1 / 4, (True, False): (2 * 2 + 1) / (2 * 2 + 1 + 3 * (2 * 2 + 5)),
             (True, True): 1 / 4}[revolved, quadratic]
    assert labels.tolist() == [1, 3]
    np.testing.assert_allclose(parts, [[1, first, 0], [0, 1 - first, 1]])


def test_labels_of_a_pair_share_a_node_likewise():
    """A corner has nodes of its own for either label."""
    place = np.array([[1.0, 0.0], [2.0, 0.0], [5.0, 0.0], [5.0, 0.0], [5.0, 4.0]])
    b = SimpleNamespace(gid=np.array([4, 2, 7, 7, 8]), xy=place, label=np.array([1, 1, 3, 5, 5]),
                        edges=np.zeros((0, 2), int), axisymmetric=False,
                        meeting=[[(1, 11), (3, 13)], [(5, 15)]], paired=np.ones(5, bool),
                        clamped=SimpleNamespace(gid=np.zeros(0, int), xy=np.zeros((0, 2))))
    outer = np.array([[9, 4, 6], [4, 2, 1], [2, 7, 3], [7, 8, 5]])
    structure = SimpleNamespace(contact=SimpleNamespace(declared=b), outer_edges=outer,
                                outer_middles=np.zeros(0, int))
    labels, parts = shares.label_shares(structure)
    assert labels.tolist() == [1, 3, 5]
    np.testing.assert_allclose(parts, [[1, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 1]])
    b.xy, b.gid, b.paired = place[:3], b.gid[:3], b.paired[:3]
    b.label, b.meeting = b.label[:3], b.meeting[:1]
    np.testing.assert_allclose(shares.label_shares(structure)[1],
                               [[1, 1 / 4, 0], [0, 3 / 4, 1]])


def test_forces_of_a_boundary_follow_its_normals_where_they_change():
    """Of a label in the nodes it shares; the same as with given normals where these stay."""
    rng = np.random.default_rng(3)
    x = np.arange(4.0)
    angle = rng.uniform(0, 6, 4)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    b = SimpleNamespace(xy=np.column_stack([x, 0 * x]), arc=x, chain=np.zeros(4, int),
                        weight=np.ones(4), length=np.ones(4), gap=np.zeros(4),
                        paired=np.zeros(4, bool), middle=np.zeros(4, bool),
                        mirrored=np.zeros(4, bool), onward=np.full(4, -1), seam=np.zeros(4),
                        normal=normal,
                        tangent=np.column_stack([-normal[:, 1], normal[:, 0]]))
    states = {ContactField.SIGMA_N: -rng.random((2, 4)), ContactField.SIGMA_T: rng.random((2, 4)),
              ContactField.SLIP: np.ones((2, 4)), ContactField.U_N: np.zeros((2, 4)),
              ContactField.STATUS: np.full((2, 4), SLIP), "work": np.ones((2, 4))}
    share = np.array([1.0, 1.0, 0.25, 0.0])
    of_label = 3, share, np.zeros(2)
    still = _one_boundary(b, states, of_label, None)
    moving = _one_boundary(b, states, of_label, [normal, normal])
    for one, other in zip(moving, still, strict=True):
        assert one == pytest.approx(other, rel=1e-12)
    p, t = -states[ContactField.SIGMA_N], states[ContactField.SIGMA_T]
    for k, row in enumerate(still):
        force = (share * t[k]) @ b.tangent - (share * p[k]) @ normal
        assert row["boundary"] == 3 and row["slip"] == k + 1
        assert row["normal_resultant"] == pytest.approx(p[k] @ share)
        assert row["tangential_resultant"] == pytest.approx(t[k] @ share)
        assert (row["force_x"], row["force_y"]) == pytest.approx(tuple(force))
        assert row["dissipated_energy"] == pytest.approx(2.25 * (k + 1))


@pytest.mark.parametrize("slip, force, made", [
    ([1.0, 2.0, 0.5], [1.0, 2.0, 3.0], True), ([1.0, 2.0, 0.0], [1.0, 3.0, 1.0], False),
    ([1.0, 2.0, -0.5], [1.0, 2.0, 3.0], False), ([1.0, 2.0, -0.1], [3.0, 3.0, 2.9], True),
    ([0.0, 0.0, 0.0], [1.0, 3.0, 1.0], True)])
def test_slip_is_that_of_the_last_state_unless_it_turned_or_contact_was_unloaded(slip, force, made):
    """But for little, as where friction takes a part of a load that stays; so is none."""
    nodes = {"weight": np.full(2, 0.5)}
    steps = {"status": np.full((3, 2), SLIP), "slip": np.column_stack([slip, np.zeros(3)]),
             "sigma_n": -np.column_stack([force, force])}
    assert quantities.made_under_load(nodes, steps, 2) == made
    assert quantities.made_under_load(nodes, steps, 0)


def test_slip_that_has_come_to_rest_is_not_that_of_the_last_state():
    """A node that sticks keeps the errors of the steps in which it slid: its adjoint problem holds
    it where it is.
    """
    nodes = {"weight": np.full(2, 0.5)}
    steps = {"status": np.array([[SLIP, STICK], [STICK, SLIP]]),
             "slip": np.array([[2.0, 0.0], [0.0, 1.0]]), "sigma_n": np.full((2, 2), -1.0)}
    assert not quantities.made_under_load(nodes, steps, 1)
    assert quantities.made_under_load(nodes, steps, 0)
    steps["slip"][1, 1] = 3.0  # farther than the one that rests
    assert quantities.made_under_load(nodes, steps, 1)


def test_where_the_peak_and_the_farthest_node_are():
    """Neighbours of the peak belong to it while they touch; slip counts in contact, up to a step.
    """
    x = np.arange(5.0)
    nodes = {"arc": x, "xy": np.column_stack([x, 0 * x]), "chain": np.array([0, 0, 0, 0, 1])}
    steps = {"sigma_n": -np.array([[0, 1, 3, 5, 9.0], [0, 1, 9, 5, 2]]),
             "status": np.array([[OPEN, SLIP, STICK, SLIP, SLIP], [OPEN, SLIP, SLIP, OPEN, SLIP]]),
             "slip": np.array([[9, 1, 9, 2, -3.0], [9, -4, 1, 9, 1]])}
    assert quantities.peak_nodes(nodes, steps, 0).tolist() == [4]
    assert quantities.peak_nodes(nodes, steps, 1).tolist() == [1, 2]
    assert quantities.farthest_node(steps, 0) == 4 and quantities.farthest_node(steps, 1) == 1
    repeated = steps | {quantities.REPEATS: np.array([[5.0] * 5, [1.0] * 5])}
    assert quantities.farthest_node(repeated, 1) == 4


def test_how_nodes_touch():
    """All slide one way, or not; what is open carries and counts nothing."""
    x = np.arange(4.0)
    nodes = {"arc": x, "xy": np.column_stack([x, 0 * x]), "chain": np.zeros(4, int),
             "weight": np.array([1.0, 2, 2, 1]), "gap": np.zeros(4), "paired": np.zeros(4, bool),
             "middle": np.zeros(4, bool), "mirrored": np.zeros(4, bool)}
    steps = {"status": np.array([[SLIP, SLIP, SLIP, OPEN]]), "slip": np.ones((1, 4)),
             "sigma_t": np.array([[1.0, 1, 1, 0]]), "sigma_n": -np.array([[4.0, 2, 0.1, 0]]),
             "u_n": np.zeros((1, 4))}
    touch = Touch.of(nodes, steps, 0, 2)
    assert (touch.nodes, touch.round, touch.dragged) == (3, 2, True)
    mean = (4 * 1 + 2 * 2 + 0.1 * 2) / 5
    assert touch.lighter(0.05) == 0.0 and touch.lighter(0.11 / mean) == 2.0
    assert touch.lighter(2.1 / mean) == 4.0 and Touch().lighter(1.0) == 0.0
    # nodes that are near may touch as well, those that press little may not, nor the last side
    near = Touch.of(nodes | {"gap": np.array([0.0, 0, 0, 0.5])}, steps, 0, 2)
    assert near.beside.tolist() == [[0.5, 1.0]] and near.edges == 1.0 + 1.0
    for way, part, length in ((0.5, 0.0, 0.0), (0.51, 0.0, 1.0), (0.51, 0.11 / mean, 3.0)):
        assert near.uncertain(way, part) == pytest.approx(length + near.edges)
    for name, values in (("sigma_t", [[1.0, -1, 1, 0]]), ("status", [[SLIP, STICK, SLIP, OPEN]])):
        assert not Touch.of(nodes, steps | {name: np.array(values)}, 0, 2).dragged


def test_seconds_are_shared_by_the_products_that_were_caused():
    """Of 10 products 4 in the last step; 3 in iterations after the first, 2 that bounds call for;
    7 were before.
    """
    log = [(0, 1, 1, "start", 1.0), (4, 1, 1, "cg", 0.1), (5, 1, 2, "expansion", 0.1),
           (6, 1, 2, "cg", 0.1), (6, 2, 1, "start", 0.1), (9, 2, 1, "cg", 0.1),
           (10, 2, 2, "proportioning", 0.1)]
    found = seconds_of([(7 + product, *others) for product, *others in log], 5.0)
    assert found == pytest.approx({"contact": 1.0, "friction": 1.5, "history": 3.0})
    assert seconds_of([], 5.0) == {"contact": 0.0, "friction": 0.0, "history": 0.0}


# ------------------------------------------------------------------------------ places, tractions

def test_places_in_triangles_with_curved_sides():
    """Newton's method finds the coordinates that a place was made of; straight ones at once."""
    corner = np.array([[0.0, 0.0], [2.0, 0.0], [0.5, 1.5]])
    middles = (corner[[1, 2, 0]] + corner[[2, 0, 1]]) / 2 + [[0.1, 0.05], [-0.05, 0.1], [0, -0.1]]
    curved = np.concatenate([corner, middles])[None]
    parts = np.array([0.2, 0.5, 0.3])
    place = elements.shapes(6, parts[None])[0] @ curved[0]
    straight = np.linalg.solve(np.vstack([corner.T, np.ones(3)]), [*place, 1.0])
    found = places._on_curved(curved, place, straight[None])
    np.testing.assert_allclose(found[0], parts, atol=1e-12)
    far = np.array([[-3.0, 2.0, 2.0]])
    np.testing.assert_array_equal(places._on_curved(curved, place, far), far)
    sub = SimpleNamespace(xy=XY, triangles=TRIANGLES, curved=False)
    depth, triangle, at = places.nearest(sub, np.array([1.2, 0.9]))
    np.testing.assert_allclose(at @ XY[TRIANGLES[triangle]], [1.2, 0.9], rtol=1e-13)
    assert triangle == 3 and depth == pytest.approx(at.min())
    depth, triangle, _ = places.nearest(sub, np.array([2.5, 0.5]))
    assert triangle == 2 and depth == pytest.approx(-0.5)


def test_rings_of_curved_edges_are_those_of_straight_ones_where_they_are_straight():
    """Integrals of the shape functions times the radius: a label may have edges of both kinds."""
    xy = np.array([[1.0, 0.0], [3.0, 1.0], [2.0, 0.5]])
    sub, nodes = SimpleNamespace(xy=xy), np.array([[0, 1, 2]])
    length = np.array([np.hypot(2, 1)])
    plain = probes._Edges(np.zeros(1, int), nodes, length)
    curved = probes._Edges(np.zeros(1, int), nodes, length, sides.integrals(xy[nodes]))
    np.testing.assert_allclose(curved.rings(sub), plain.rings(sub), rtol=1e-12)
    assert plain.rings(sub).sum() == pytest.approx(length[0] * 2.0)
    ends = probes._Edges(np.zeros(1, int), nodes[:, :2], length)
    np.testing.assert_allclose(ends.rings(sub), length * [[(2 * 1 + 3) / 6, (2 * 3 + 1) / 6]])
    np.testing.assert_allclose(probes._integral(curved, xy), probes._integral(plain, xy))
    assert not probes._integral(probes._Edges(*np.zeros((3, 0))), xy).any()


# ------------------------------------------------------------------------------ single nodes

def test_boundaries_of_a_single_node_have_its_length():
    """Beside a piece of several: in contact or not; no edge, no end, no ring."""
    x = np.array([0.0, 1.0, 2.0, 7.0])
    nodes = {"arc": x, "xy": np.column_stack([x, 0 * x]), "chain": np.array([0, 0, 0, 1]),
             "weight": np.array([0.5, 1.0, 0.5, 0.75]), "gap": np.zeros(4),
             "paired": np.zeros(4, bool), "middle": np.zeros(4, bool),
             "mirrored": np.zeros(4, bool)}
    pieces = contact_edges.chains(nodes)
    assert [piece.tolist() for piece in pieces] == [[0, 1, 2], [3]]
    assert contact_edges.beyond_ends(nodes, pieces[1]).tolist() == [0, 0]
    steps = {"u_n": np.zeros((2, 4)), "slip": np.array([[0, 0, 0, 2.0], [0, 0, 0, -1.0]]),
             "sigma_n": -np.array([[1.0, 1, 1, 9], [1, 1, 1, 0]]), "sigma_t": np.zeros((2, 4)),
             "status": np.array([[SLIP, SLIP, SLIP, SLIP], [STICK, STICK, STICK, OPEN]])}
    assert contact_edges.contact_length(nodes, pieces, steps, 0) == pytest.approx(2.75)
    assert contact_edges.contact_length(nodes, pieces, steps, 1) == pytest.approx(2.0)
    assert quantities.longest_ways(nodes, pieces[1], steps).tolist() == [2.0, 2.0]
    assert contact_edges.edges_of_contact(nodes, pieces[1], steps, 0) == []
    assert quantities.peak(np.zeros(1), np.array([9.0])) == 9.0
    assert between_nodes(nodes, steps, 0) == {"peak_pressure": 0.0, "contact_length": 0.0,
                                               "slip": 0.0}


@pytest.mark.parametrize("pressure, open_length", [
    ([4.5, 5, 11, 16, 20], 1 - 25 / (121 - 25)),  # the line through 11 and 5 ends before 0
    ([12, 11, 19, 25, 27], 1 - 121 / (361 - 121)),  # only the end itself does not fall
    ([2, 4, 6, 8, 10], 0.0), ([9, 10, 11, 11, 10], 0.0), ([30, 20, 18, 19, 20], 0.0),
    ([4, 0, 8, 16, 20], 1.0)])
def test_contact_may_have_ended_where_pressure_falls_to_nothing(pressure, open_length):
    """Pressure vanishes like r^(1/2); at an end that it does not fall to, nothing is open."""
    x = np.arange(5.0)
    for turned in (False, True):
        p = np.array(pressure[::-1] if turned else pressure, float)
        nodes = {"arc": x, "mirrored": np.zeros(5, bool)}
        args = nodes, np.arange(5), np.ones(5, bool), p
        assert touch._before_ends(*args) == pytest.approx(open_length)
        nodes["mirrored"][:] = True
        assert touch._before_ends(*args) == 0.0


# ------------------------------------------------------------------------------ tables, lines

UNITS = {"length": "mm", "stress": "MPa"}


def test_materials_and_probes_are_aligned_tables():
    """None without any; numbers in the scene's units, rounding beside others left out."""
    assert screen.materials([], UNITS) == []
    head, first = screen.materials([{"body": 1, "name": "steel", "young": 210e3, "poisson": 0.3}],
                                   UNITS)
    assert head.split("  ")[0] == "body" and "Young's modulus [MPa]" in head
    assert first.split() == ["1", "steel", "210000", "0.3"]
    same = {"u_y": 1.0, "force_y": 2.0, "x": 0.0, "y": 0.0, "step": 1, "time": 1.0}
    rows = [{"probe": "point1", "u_x": 0.25, "force_x": 1e-20, **same},
            {"probe": "label3", "u_x": -0.5, "force_x": 3.0, **same}]
    head, one, two = screen.probes(rows, UNITS)
    assert head.split()[:4] == ["probe", "force", "x", "[N/mm]"] and "u x [mm]" in head
    assert one.split() == ["point1", "0", "2", "0.25", "1"]
    assert two.split() == ["label3", "3", "2", "-0.5", "1"]
    assert screen.probes([], UNITS) == []


@pytest.mark.parametrize("kind, words", [
    ("shakedown", "forces change by 1.0e-02 a cycle, friction"),
    ("alternating slip", "slip of 0.25 mm a cycle"), ("ratcheting", "advance of 0.5 mm a cycle"),
    ("wear", "0.125 mm worn off a cycle")])
def test_a_line_about_cycles(kind, words):
    last = {"kind": kind, "slip": 0.25, "drift": 0.5, "wear": 0.125, "change": 0.01,
            "dissipated": 3.0}
    line, = screen.cycles({"last": last, "number": 9, "skipped": 4, "error": 1e-3,
                           "settled_after": None}, UNITS)
    assert line.startswith("9 cycles, 4 of them jumped over, with an estimated error of 0.001 mm, "
                           "not settl")
    assert words in line and "friction dissipates 3 " in line
    line, = screen.cycles({"last": last, "number": 1, "skipped": 0, "error": 0.0,
                           "settled_after": 1}, UNITS)
    assert line.startswith(f"1 cycle, settled from cycle 1 on: {kind}")
    # one alone comes to nothing yet: its change of 1 is that from nothing
    line, = screen.cycles({"last": last | {"change": 1.0}, "number": 1, "skipped": 0, "error": 0.0,
                           "settled_after": None}, UNITS)
    assert line == ("1 cycle, no previous cycle to compare with: slip of 0.25 mm, "
                    f"friction dissipates 3 {line.split()[-1]}")
    assert screen.cycles(None, UNITS) == []


def test_names_of_columns_and_files():
    columns = (tables.Column("step", "1", ""), tables.Column("kkt_{}", "1", ""))
    assert tables.header(columns, kkt=["a", "b"]) == ["step", "kkt_a", "kkt_b"]
    assert tables.piece_file("fields/step_0003.pvtu", 12) == "fields/step_0003_0012.vtu"
    assert tables.field_file(3).endswith("step_0003.vtu")
    assert tables.field_file(3, 2).endswith("step_0003.pvtu")
    assert tables.error_file(3, 2).endswith("error_0003.pvtu")
    assert (tables.shown(True), tables.shown(False), tables.shown(1)) == ("yes", "no", 1)
    assert {row["file"] for row in tables.reference()} == set(tables.TABLES)
    assert {"entry", "unit", "meaning"} == set(summary.reference()[0])
    assert any(row["entry"] == "sizes.dual_dofs" for row in summary.reference())


@pytest.mark.parametrize("closed, sides_, ends", [
    ([1, 1, 1, 0, 0], 2.0, [1.0]), ([0, 0, 1, 0, 0], 2.0, [1.0, 1.0]),
    ([0, 0, 0, 1, 1], 2.0, [1.0]), ([0, 0, 0, 0, 0], 0.0, [])])
@pytest.mark.parametrize("middle", [False, True])
def test_sides_in_which_contact_ends_are_those_of_elements(closed, sides_, ends, middle):
    """Sides of length 1, with a node in the middle or without."""
    nodes = {"arc": np.arange(5.0) / (2 if middle else 1), "middle": np.arange(5) % 2 * middle,
             "xy": np.column_stack([np.arange(5.0), np.zeros(5)]), "mirrored": np.zeros(5, bool)}
    piece, state = np.arange(5), np.array(closed, bool)
    assert touch._sides(nodes, piece, state) == sides_
    assert touch._ends(nodes, piece, state) == ends


def test_memory_is_that_of_the_process_in_mib():
    """Two hundred more are used, by touching them, and counted."""
    before = summary.largest_memory(MPI.COMM_SELF)
    now = int(next(line for line in Path("/proc/self/status").read_text().splitlines()
                   if line.startswith("VmRSS")).split()[1]) / 1024
    assert 0.9 * now <= before  # the kernel counts in lots of pages
    size = int(before - now) + 200
    used = np.ones(size * 2**17)
    assert summary.largest_memory(MPI.COMM_SELF) - before == pytest.approx(200, rel=0.2)
    del used


def test_constants_that_are_called_parts_are_between_none_and_all():
    assert not constants.beyond("results")
