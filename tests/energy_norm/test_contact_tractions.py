"""Tractions in the cone on rigid obstacles, on three edges made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.energy_norm.contact_tractions import ContactTractions, continued

X = np.array([0.0, 1.0, 3.0, 4.0])  # the last node is clamped
N = 3


def made(normals=None, constrained=(), frictional=True, bilateral=False, **state):
    """Tractions at a straight boundary, or one with other normals; a support holds `constrained`
    (node, component)."""
    normal = np.tile([0.0, -1.0], (4, 1)) if normals is None else np.array(normals, float)
    held = np.zeros((N, 2), bool)
    for node, component in constrained:
        held[node, component] = True
    b = SimpleNamespace(
        gid=np.arange(N), xy=np.column_stack([X, 0 * X])[:N], normal=normal[:N],
        tangent=np.column_stack([-normal[:N, 1], normal[:N, 0]]), weight=np.array([0.5, 1.5, 1.5]),
        edges=np.array([[0, 1], [1, 2], [2, 3]]), paired=np.zeros(N, bool),
        normal_row=np.where(held[:, 1], -1, np.arange(N)),
        tangential_row=np.where(held[:, 0] | (not frictional), -1, N + np.arange(N)),
        gap=np.array([0.1, 0.0, 0.2]), corners=np.zeros((0, 4), int), motion=None)
    b.clamped = SimpleNamespace(gid=np.array([9]), xy=np.array([[4.0, 0.0]]), normal=normal[N:],
                                gap=np.array([0.25]), motion=None)
    b.at = lambda time: b
    contact = SimpleNamespace(boundary=b, constrained=held, frictional=frictional,
                              law=SimpleNamespace(bilateral=np.full(N, bilateral)))
    numbers = {"sigma_n": -np.array([2.0, 4.0, 1.0]), "sigma_t": np.array([0.5, -2.0, 0.25]),
               "bound": np.array([1.0, 2.0, 0.5]), "u_t": np.array([0.5, 0.75, 1.0]),
               "slip": np.array([0.0, 0.25, 0.0]), **state}
    return ContactTractions(contact, numbers, np.array([[0.125, -0.0625]]),
                            np.array([[0.5, 9.0]]), (0.0, 1.0))


def test_nodes_without_a_traction_of_their_own_take_their_neighbours_mean():
    edges = np.array([[0, 1], [1, 2], [2, 3]])
    own = np.array([True, False, True, False])
    assert continued(edges, np.array([2.0, 99, 4, 99]), own).tolist() == [2, 3, 4, 4]
    assert continued(edges, np.zeros(4), np.zeros(4, bool)).tolist() == [0, 0, 0, 0]


def test_tractions_are_those_of_the_nodes():
    """Pressure and bound go on to the clamped node; of the shear the part of the bound that it is,
    never more than the bound.
    """
    of = made()
    np.testing.assert_allclose(of.pressure, [2, 4, 1, 1])
    np.testing.assert_allclose(of.bound, [1, 2, 0.5, 0.5])
    np.testing.assert_allclose(of.shear, [0.5, -2, 0.25, 0.25])
    np.testing.assert_allclose(of.length, [1, 2, 1])
    held = made(constrained=[(1, 0)])  # no friction of its own: the mean part, 0.5 of its bound
    np.testing.assert_allclose(held.shear[1], 0.5 * 2.0)
    assert not made(frictional=False).shear.any()
    assert of.distance[3] == pytest.approx(0.25 - 0.0625) and of.slip[3] == pytest.approx(0.5)


def test_moments_are_integrals_against_hats():
    """Of linear tractions: the resultant and the moment about a point of each edge."""
    of = made()
    traction = np.column_stack([of.shear, of.pressure])  # up and along
    for edge, (i, j) in enumerate(of.node):
        size = X[j] - X[i]
        np.testing.assert_allclose(of.moments[edge].sum(axis=0),
                                   size * (traction[i] + traction[j]) / 2)
        np.testing.assert_allclose(of.moments[edge][1], size * (traction[i] / 6 + traction[j] / 3))


def test_without_friction_nothing_tangential_is_left_at_a_node():
    """Where normals differ from node to node; a support may hold what is."""
    angle = np.array([0.0, 0.2, 0.5, 0.6])
    normals = np.column_stack([np.sin(angle), -np.cos(angle)])
    of = made(normals, frictional=False)
    force = of._nodal(of.moments)
    assert np.abs((force * of.tangent).sum(axis=1)[:N]).max() < 1e-14
    plain = made(normals, frictional=False, constrained=[(1, 0)])
    rest = (plain._nodal(plain.moments) * plain.tangent).sum(axis=1)
    assert abs(rest[1]) > 1e-3 and abs(rest[0]) < 1e-14


def test_multipliers_make_the_same_forces():
    """On either row of a node; where one component alone acts, along the direction that is free.
    Of pairs they stay.
    """
    rows = SimpleNamespace(normal=np.arange(3), normal_node=np.arange(3),
                           tangential=3 + np.arange(3), tangential_node=np.arange(3))
    angle = np.array([0.0, 0.2, 0.5, 0.6])
    normals = np.column_stack([np.sin(angle), -np.cos(angle)])
    of = made(normals)
    b, force = of.boundary, of._nodal(of.moments)[:N]
    found = of.multipliers(np.full(7, 9.0), rows)
    np.testing.assert_allclose(-(found[:3, None] * b.normal + found[3:6, None] * b.tangent), force)
    assert found[6] == 9.0
    of.constrained[0] = [False, True]  # with a row along the boundary all the same
    np.testing.assert_allclose(of.multipliers(np.full(7, 9.0), rows), found)
    b.tangential_row -= N  # of rows that are numbered from zero on
    np.testing.assert_allclose(of.multipliers(np.full(7, 9.0), rows), found)
    held = made(normals, constrained=[(1, 0)])
    force = held._nodal(held.moments)[:N]
    normal = held.multipliers(np.zeros(7), rows)[1]
    assert -normal * normals[1, 1] == pytest.approx(force[1, 1])  # the support takes the rest
    of.boundary.paired[2] = True
    paired = of.multipliers(np.full(7, 9.0), rows)
    assert paired[2] == paired[5] == 9.0 and paired[1] == found[1]


def test_displacements_are_moved_onto_the_obstacle_and_back_to_stick():
    """Out of it, and onto it where that costs less than the work of the pressure over the distance;
    back where friction has lost more work than the move costs.
    """
    of = made()
    of.place(np.array([[0.5, 0.3], [1.0, -0.25], [1.25, -0.1]]))
    np.testing.assert_allclose(of.distance[:3], [0.1 + 0.3, -0.25, 0.2 - 0.1])
    # tangential displacements are along x; before the step they were u_t - slip
    np.testing.assert_allclose(of.slip[:3], [0.0, 0.5, 0.25])
    stiffness = np.array([2.0, 100.0, 30.0])
    move = of.onto_obstacle(stiffness)
    # 2 x 0.4 <= 2 x 0.5; inside; 30 x 0.1 > 1 x 1.5
    np.testing.assert_allclose(move, [0.4, -0.25, 0.0])
    np.testing.assert_allclose(of.distance[:3], [0.0, 0.0, 0.1])
    back = of.back_to_stick(np.array([1.0, 1.0, 5.0]))
    # of the second all friction works against the slip; of the third 0.5 + 0.25 over 1.5 is lost
    np.testing.assert_allclose(back, [0.0, 0.0, 0.0])
    back = of.back_to_stick(np.array([1.0, 1.0, 4.0]))
    np.testing.assert_allclose(back, [0.0, 0.0, -0.25])
    np.testing.assert_allclose(of.slip[:3], [0.0, 0.5, 0.0])
    pulls = made(bilateral=True)
    pulls.place(np.array([[0.5, 0.3], [1.0, -0.25], [1.25, -0.1]]))
    np.testing.assert_allclose(pulls.onto_obstacle(stiffness), [0.4, -0.25, 0.1])
    assert not pulls.distance[:3].any()


def test_the_duality_gap_is_an_integral():
    """Of linear fields on edges, with |slip| that changes its sign inside: by fine sums."""
    of = made()
    of.distance[:3], of.slip[:3] = [0.5, 0.0, 0.25], [0.5, -0.25, 0.125]
    total, fine = 0.0, (np.arange(20000) + 0.5) / 20000
    for (i, j), size in zip(of.node, of.length):
        def along(values, i=i, j=j):
            return values[i] + fine * (values[j] - values[i])
        total += size * (along(of.pressure) * along(of.distance) + along(of.shear) * along(of.slip)
                         + along(of.bound) * np.abs(along(of.slip))).mean()
    assert of.duality_gap() == pytest.approx(total, rel=1e-6)
    nodal = of.boundary.weight @ (np.array([2, 4, 1]) * of.distance[:3] + np.array(
        [1, 2, 0.5]) * np.abs(of.slip[:3]) + np.array([0.5, -2, 0.25]) * of.slip[:3])
    assert of.nodal_gap() == pytest.approx(nodal)
    of.distance[:3] = -9.0
    assert of.nodal_gap() == 0.0
