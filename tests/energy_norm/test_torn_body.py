"""The torn body of the estimates on a few triangles made by hand: edges, strains, stiffness."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.energy_norm import torn_body
from driver.energy_norm.edge_mesh import Mesh, full_tensor, side_moments
from driver.energy_norm.torn_body import Gather, TornBody

# a fan of four triangles about vertex 2, torn between the second and the third
PLACE = np.array([[0.0, 0.0], [2.0, 0.2], [1.1, 0.9], [2.2, 2.0], [-0.1, 1.8]])
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2]])
TORN = np.array([[0, 1, 2], [1, 3, 2], [4, 5, 6], [5, 7, 6]])
VERTEX = np.array([0, 1, 2, 3, 3, 4, 2, 0])


@pytest.fixture(name="body")
def _body() -> TornBody:
    """With another anisotropic law in each triangle."""
    root = np.random.default_rng(2).standard_normal((4, 3, 5))
    elasticity = root @ root.transpose(0, 2, 1)
    mesh = Mesh.of(TRIANGLES, PLACE[TRIANGLES])
    return TornBody(np.arange(5), VERTEX, TORN, np.zeros(4, int), elasticity,
                    np.linalg.inv(elasticity), mesh, np.zeros((5, 2), bool),
                    np.zeros((2 * len(mesh.edges), 2), bool), PLACE[TRIANGLES])


def test_edges_of_triangles():
    """Half-edges belong to ends: the first of a triangle is on its right as seen from there."""
    mesh = Mesh.of(TRIANGLES, PLACE[TRIANGLES])
    assert len(mesh.edges) == 8 and (mesh.edges[:, 0] < mesh.edges[:, 1]).all()
    assert mesh.boundary.sum() == 4 and not mesh.boundary[(mesh.edges == 2).any(axis=1)].any()
    for t, corners in enumerate(TRIANGLES):
        for k, v in enumerate(corners):
            for half, other in ((mesh.first[t, k], corners[(k + 1) % 3]),
                                (mesh.last[t, k], corners[(k + 2) % 3])):
                ends = mesh.edges[half // 2]
                assert ends[half % 2] == v and ends[1 - half % 2] == other
    assert mesh.find(mesh.edges[:, ::-1]).tolist() == list(range(8))
    np.testing.assert_allclose(mesh.length, np.linalg.norm(
        np.diff(PLACE[mesh.edges], axis=1)[:, 0], axis=1))
    # outward: away from the opposite corner; all sides of a triangle add up to nothing
    middle = (PLACE[TRIANGLES] + np.roll(PLACE[TRIANGLES], -1, axis=1)) / 2
    away = middle - PLACE[TRIANGLES].mean(axis=1)[:, None]
    assert ((mesh.outward * away).sum(axis=2) > 0).all()
    np.testing.assert_allclose(mesh.outward.sum(axis=1), 0.0, atol=1e-15)
    x, y = PLACE[[0, 1, 3, 4]].T
    assert mesh.area.sum() == pytest.approx((x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)
    for t in range(4):
        np.testing.assert_allclose(mesh.columns[t] @ [[1, 0], [0, 1]], np.column_stack([
            PLACE[TRIANGLES[t, 1]] - PLACE[TRIANGLES[t, 0]],
            PLACE[TRIANGLES[t, 2]] - PLACE[TRIANGLES[t, 0]]]))


def test_moments_of_stresses_on_sides():
    """Half of the side's force at either end: sigma n times its length."""
    mesh = Mesh.of(TRIANGLES, PLACE[TRIANGLES])
    stress = np.random.default_rng(3).standard_normal((4, 3))
    moments = side_moments(mesh, stress)
    for t, (xx, yy, xy) in enumerate(stress):
        tensor = np.array([[xx, xy], [xy, yy]])
        np.testing.assert_array_equal(full_tensor(stress[t]), tensor)
        for k in range(3):
            np.testing.assert_allclose(moments[t, k], tensor @ mesh.outward[t, k] / 2)


def test_strains_are_those_of_linear_fields(body):
    """Of a field that is torn only where triangles are; rotations strain nothing."""
    gradient = np.array([[0.3, -0.2], [0.5, 0.7]])  # d u_k / d x_j by row k
    u = PLACE[VERTEX] @ gradient.T
    np.testing.assert_allclose(body.strain(u), np.tile([0.3, 0.7, 0.3], (4, 1)))
    turn = PLACE[VERTEX] @ np.array([[0.0, -1.0], [1.0, 0.0]]).T
    assert np.abs(body.strain(turn)).max() < 1e-14
    u[4:] += [9.0, -5.0]  # the other part moves away as a whole
    np.testing.assert_allclose(body.strain(u), np.tile([0.3, 0.7, 0.3], (4, 1)), atol=1e-13)
    np.testing.assert_allclose(body.untorn(u)[[2, 3, 0]], PLACE[[2, 3, 0]] @ gradient.T
                               + [4.5, -2.5])
    np.testing.assert_allclose(body.untorn(u)[1], PLACE[1] @ gradient.T)


def test_energy_and_stiffness_are_those_of_the_strains(body):
    """|sigma(u)|^2 = int eps : C eps; the diagonal of the stiffness is that of unit displacements.
    """
    u = np.random.default_rng(4).standard_normal((8, 2))
    strain = body.strain(u)
    energy = sum(a * e @ C @ e for a, e, C in zip(body.area, strain, body.elasticity))
    assert body.norm(body.stress(u)) ** 2 == pytest.approx(energy, rel=1e-12)
    other = body.stress(u[::-1])
    np.testing.assert_allclose(body.work(body.stress(u), other), body.area * (
        strain * other).sum(axis=1), rtol=1e-10)
    for v in range(5):
        for c in (0, 1):
            unit = np.zeros((8, 2))
            unit[VERTEX == v, c] = 1.0
            strain = body.strain(unit)
            assert body.stiffness[v, c] == pytest.approx(
                sum(a * e @ C @ e for a, e, C in zip(body.area, strain, body.elasticity)))


def test_tractions_are_given_where_no_support_is():
    """On labels with an edge whose ends are not both held, by component; inside nothing is."""
    mesh = Mesh.of(TRIANGLES, PLACE[TRIANGLES])
    number = np.array([10, 11, 12, 13, 14])
    outer = np.array([[11, 10, 1], [13, 11, 2], [13, 14, 3], [10, 14, 3]])
    held = np.zeros((5, 2), bool)
    held[[0, 1], 0] = True  # all of label 1, across
    held[[3, 4], 1] = True  # a part of label 3
    given = torn_body._given(outer, mesh, number, held)
    assert given.shape == (16, 2)
    for e, (a, b) in enumerate(mesh.edges):
        expected = {(0, 1): [False, True], (1, 3): [True, True], (3, 4): [True, True],
                    (0, 4): [True, True]}.get((a, b), [False, False])
        assert given[2 * e].tolist() == given[2 * e + 1].tolist() == expected


def test_fields_are_joined_in_the_order_of_subdomains():
    """Thermal stresses by the factors of the patterns that have one; none is zero."""
    subs = [SimpleNamespace(triangles=np.zeros((k + 1, 3), int), thermal=thermal)
            for k, thermal in enumerate(({}, {0: np.full((2, 3), 2.0), 2: np.full((2, 3), 0.5)}))]
    operator = SimpleNamespace(structure=SimpleNamespace(subdomains=subs), comm=MPI.COMM_SELF)
    gather = Gather(operator)
    assert gather.root
    assert gather.thermal(np.array([3.0, 7.0, 4.0]), (3,)).tolist() == [[0.0] * 3] + [[8.0] * 3] * 2
    assert gather.displacements([np.arange(4.0), np.arange(2.0)]).tolist() == [
        [0, 1], [2, 3], [0, 1]]
