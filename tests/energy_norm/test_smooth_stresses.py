"""Recovered stresses and deviations on small meshes, against polynomials and their integrals."""

import numpy as np
import pytest

from driver.energy_norm import adaptivity, recovery
from driver.energy_norm.deviations import Deviations
from driver.energy_norm.edge_mesh import Mesh, side_moments
from driver.energy_norm.equilibration import chains
from driver.scene import elements

LAW = np.array([[3.0, 1.0, 0.2], [1.0, 2.5, 0.1], [0.2, 0.1, 1.0]])


def grid(n: int, rng=None):
    """Vertices and triangles of the unit square, its inner vertices moved by `rng`."""
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    xy = np.column_stack([x.ravel(), y.ravel()])
    if rng is not None:
        inner = ((xy > 0) & (xy < 1)).all(axis=1)
        xy[inner] += rng.uniform(-0.25 / n, 0.25 / n, (inner.sum(), 2))
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (of.ravel() for of in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    return xy, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def field(xy: np.ndarray, degree: int) -> np.ndarray:
    """(..., 3) stresses that are polynomials of a degree."""
    x, y = xy[..., 0], xy[..., 1]
    linear = np.stack([1 + 2 * x - y, 3 * y, x + y], axis=-1)
    if degree < 2:
        return linear
    return linear + np.stack([x * y, x**2 - y**2, y**2], axis=-1)


@pytest.mark.parametrize("curved", [False, True])
def test_recovered_stresses_hold_quadratics(curved):
    """Fitted to values in the middles of sides: a linear stress exactly from its own values, in
    each of two regions its own, at nodes of curved sides where these are.
    """
    xy, triangles = grid(4, np.random.default_rng(1))
    corner = xy[triangles]
    region = (corner.mean(axis=1)[:, 0] > 0.5).astype(int)
    place = recovery.AT_NODES @ corner
    if curved:
        place = place.copy()
        place[:, 3:] += 0.01
    jump = np.array([5.0, -3.0, 2.0]) * region[:, None, None]
    found = recovery.Patches(place if curved else corner, triangles, region).smooth(
        field(corner, 1) + jump)
    if not curved:
        np.testing.assert_allclose(found, field(place, 1) + jump, atol=1e-11)
    else:  # values of middles belong to places 0.01 beside them
        np.testing.assert_allclose(found[:, 3:], (field(place - 0.01, 1) + jump)[:, 3:], atol=1e-11)


def test_recovered_stresses_are_of_higher_order():
    """A quadratic stress, of which elements have the line through its corners: its recovery errs by
    less, and inside by a constant of the order of h^2 alone.
    """
    errors = []
    for n in (4, 8):
        xy, triangles = grid(n)
        corner = xy[triangles]
        middles = recovery.AT_NODES @ corner
        exact = field(middles, 2)
        line = recovery.AT_NODES @ field(corner, 2)
        found = recovery.Patches(corner, triangles, np.zeros(len(triangles), int)).smooth(
            field(corner, 2))
        errors.append(np.abs(found - exact).max())
        assert np.abs(found - line).max() > 0
    assert errors[1] < errors[0] / 3


def test_mean_stresses_are_those_of_the_triangles_round_a_vertex():
    """Weighted with areas, of one region each; a constant stress stays."""
    xy, triangles = grid(3, np.random.default_rng(2))
    area, n = elements.areas(xy[triangles]), len(triangles)
    region = np.arange(n) % 2
    stress = np.random.default_rng(3).random((n, 3))
    found = recovery.averaged_stress(triangles, region, area, stress)
    for t in (0, 7, n - 1):
        for k in range(3):
            near = (triangles == triangles[t, k]).any(axis=1) & (region == region[t])
            mean = area[near] @ stress[near] / area[near].sum()
            np.testing.assert_allclose(found[t, k], mean, rtol=1e-13)


def test_work_of_stresses_is_its_integral():
    """Of linear and quadratic stresses by their nodal values, exact for products of degree four."""
    xy, triangles = grid(2, np.random.default_rng(4))
    corner, compliance = xy[triangles], np.linalg.inv(LAW)
    area = elements.areas(corner)
    # over the unit square by Gauss's rule
    at, weight = np.polynomial.legendre.leggauss(4)
    x, y = np.meshgrid((1 + at) / 2, (1 + at) / 2)
    places = np.stack([x, y], axis=-1)

    def integral(one, two):
        work = np.einsum("abi,ij,abj->ab", field(places, one), compliance, field(places, two))
        return weight @ work @ weight / 4

    nodes = recovery.AT_NODES @ corner
    laws = np.tile(compliance, (len(area), 1, 1))
    assert recovery.energy(area, laws, field(corner, 1)).sum() == pytest.approx(integral(1, 1))
    assert recovery.work(area, laws, field(nodes, 2), field(nodes, 1)).sum() == pytest.approx(
        integral(2, 1))
    assert recovery.energy(area, laws, field(nodes, 2)).sum() == pytest.approx(integral(2, 2))


def test_sizes_at_vertices():
    """Geometric means over triangles; lowered until no edge is steeper than the slope."""
    xy, triangles = grid(5)
    size = np.random.default_rng(5).uniform(0.1, 1, len(triangles))
    nodal = adaptivity.vertex_sizes(xy, triangles, size)
    near = (triangles == 14).any(axis=1)
    assert nodal[14] == pytest.approx(np.prod(size[near]) ** (1 / near.sum()))
    even = adaptivity.even(xy, triangles, nodal, 0.5)
    a, b = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    far = np.linalg.norm(xy[a] - xy[b], axis=1)
    assert (np.abs(even[a] - even[b]) <= 0.5 * far * (1 + 1e-12)).all() and (even <= nodal).all()
    least = np.array([min(nodal[j] + 0.5 * path for j, path in enumerate(row))
                      for row in ways(xy, triangles)])
    np.testing.assert_allclose(even, least, rtol=1e-12)


def ways(xy, triangles) -> np.ndarray:
    """(n, n) lengths of shortest ways along edges."""
    far = np.full((len(xy), len(xy)), np.inf)
    np.fill_diagonal(far, 0.0)
    for k in range(3):
        a, b = triangles[:, k], triangles[:, (k + 1) % 3]
        far[a, b] = far[b, a] = np.linalg.norm(xy[a] - xy[b], axis=1)
    for k in range(len(xy)):
        far = np.minimum(far, far[:, [k]] + far[[k]])
    return far


# ------------------------------------------------------------------------------ deviations

@pytest.fixture(name="spread", params=[False, True], ids=["", "body force"])
def spread_(request):
    """Deviations on a small mesh, given tractions on one side of it; and what loads them."""
    xy, triangles = grid(3, np.random.default_rng(6))
    mesh = Mesh.of(triangles, xy[triangles])
    known = np.zeros((2 * len(mesh.edges), 2), bool)
    right = (xy[mesh.edges][..., 0] == 1).all(axis=1)
    known[np.repeat(right, 2), 0] = True
    known[np.repeat(right, 2), 1] = True
    compliance = np.tile(np.linalg.inv(LAW), (len(triangles), 1, 1))
    return Deviations(mesh, chains(mesh), known, compliance, request.param), request.param


def test_changes_keep_the_equilibrium_and_lessen_the_energy(spread):
    """Their conjugate gradients end where no change lessens it: against the dense solution."""
    of, body = spread
    rng = np.random.default_rng(7)
    moments, stress = rng.random((2 * len(of.mesh.edges), 2)), rng.random((len(of.mesh.area), 3))
    force = rng.random((len(of.mesh.area), 3, 2)) if body else None
    y = of.start(moments, stress, force)
    assert y.shape == (15 if body else 9, len(of.mesh.area)) and not y[6:9].any()
    better = of.lessen(y, 1e-12, 500)
    unit = np.eye(len(of.free))[of.free]
    changes = np.array([of.local(e) for e in unit])
    whole = np.zeros((len(unit), *y.shape))
    whole[:, :9] = changes
    gram = np.einsum("ait,ijt,bjt->ab", whole, of.matrix, whole)
    right = np.einsum("ait,ijt,jt->a", whole, of.matrix, y)
    best = y - np.tensordot(np.linalg.lstsq(gram, right, rcond=None)[0], whole, axes=1)
    assert of.energy(better).sum() == pytest.approx(of.energy(best).sum(), rel=1e-6)
    assert of.energy(best).sum() < of.energy(y).sum()
    np.testing.assert_allclose(of.diagonal[of.free], np.diag(gram), rtol=1e-12)
    assert (of.diagonal[~of.free] == 1).all()
    early = of.energy(of.lessen(y, 0.5)).sum()
    assert of.energy(better).sum() < early < of.energy(y).sum()
    assert (of.lessen(0 * y) == 0).all()


def test_assembling_is_the_transpose_of_taking_apart(spread):
    of, _ = spread
    rng = np.random.default_rng(8)
    x = np.where(of.free, rng.random(len(of.free)), 0.0)
    y = rng.random((9, len(of.mesh.area)))
    assert np.sum(of.local(x) * y) == pytest.approx(x @ of.assemble(y), rel=1e-12)


def test_tractions_of_the_stress_itself_are_no_deviation():
    """On one triangle: moments of sigma_h on its sides, and a constant body force with its own."""
    corner = np.array([[[0.0, 0.0], [2.0, 0.5], [0.3, 1.0]]])
    mesh = Mesh.of(np.array([[0, 1, 2]]), corner)
    stress = np.array([[1.0, -2.0, 0.5]])
    moments = np.zeros((6, 2))
    moments[mesh.first[0]] = side_moments(mesh, stress)[0]
    of = Deviations(mesh, chains(mesh), np.zeros((6, 2), bool), np.linalg.inv(LAW)[None], False)
    np.testing.assert_allclose(of.start(moments, stress, None), 0.0, atol=1e-15)
    mean = of.mean(of.start(moments, 0 * stress, None))
    assert mean.shape == (1, 3)
