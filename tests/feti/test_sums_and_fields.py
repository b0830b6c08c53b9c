"""Sums in any order, nodal means, kept fields: small parts of the operator, by hand."""

from math import fsum
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.feti import reduction, vectors
from driver.feti.gathering import by_node, exact_sum, joined, lookup
from driver.feti.nodal import NodalFields
from driver.feti.operator import DualOperator
from driver.feti import rigid_parts
from driver.feti.rigid_parts import LeastDeformation, RigidParts
from driver.feti.rigid_modes import RigidMode, Springs, _motions
from driver.feti.travel import Bodies, _rigid_part


def test_whole_numbers_add_up_in_any_order():
    """To 2^-80 of the largest term of a column, whichever order they come in."""
    rng = np.random.default_rng(1)
    terms = rng.standard_normal((50, 3)) * 10.0 ** rng.integers(-9, 9, (50, 3))
    terms[:, 2] = 0.0
    total = exact_sum(MPI.COMM_SELF, terms)
    for k in range(3):
        exact = fsum(terms[:, k])
        assert total[k] == pytest.approx(exact, rel=2**-51, abs=2**-74 * np.abs(terms[:, k]).max())
    for _ in range(3):
        np.testing.assert_array_equal(exact_sum(MPI.COMM_SELF, rng.permutation(terms)), total)


def test_arrays_by_node_and_by_key():
    found = by_node({"a": np.array([1.0, 2.0])}, np.array([3, 0]), 5, MPI.COMM_SELF)
    assert found["a"].tolist() == [2, 0, 0, 1, 0]
    place, known = lookup(np.array([2, 5, 9]), np.array([[5, 1], [9, 10]]))
    assert known.tolist() == [[True, False], [True, False]] and place[known].tolist() == [1, 2]
    assert not lookup(np.zeros(0, int), np.array([1]))[1].any()
    assert joined([], int, 2).shape == (0, 2) and joined([np.ones((1, 2))], int, 2).dtype == int


def test_displacements_of_vertices_are_means_over_subdomains():
    """In the order of the vertices that are asked for."""
    subs = [SimpleNamespace(node_gid=np.array(gid)) for gid in ([4, 7, 1], [7, 2], [9])]
    of = NodalFields(SimpleNamespace(subdomains=subs), np.array([2, 4, 7]), MPI.COMM_SELF)
    fields = [np.array([1.0, 2, 3, 4, 99, 99]), np.array([5.0, 8, 7, 6]), np.array([99.0, 99])]
    np.testing.assert_array_equal(of(fields), [[7, 6], [1, 2], [4, 6]])


@pytest.fixture(name="operator")
def operator_(built):
    return built(cells=4, subdomains="4x2").operator


def test_the_latest_fields_are_kept_for_readers_alone(operator):
    """Asked for again they are the same arrays, which nobody may write to; with other multipliers,
    factors or forces they are others.
    """
    x = np.random.default_rng(2).standard_normal(operator.owned)
    weights = np.ones(operator.structure.patterns)
    one = operator.deformations(x, weights)
    assert operator.deformations(x.copy(), weights.copy()) is one
    with pytest.raises(ValueError, match="read-only"):
        one[0][0] = 1.0
    copies = [u.copy() for u in one]
    for other in (operator.deformations(2 * x, weights), operator.deformations(x, 2 * weights)):
        assert max(np.abs(u - v).max() for u, v in zip(other, copies)) > 0
    forces = [np.zeros_like(u) for u in copies]
    for u, v in zip(operator.deformations(x, weights, forces), copies):
        np.testing.assert_allclose(u, v, atol=1e-12 * np.abs(v).max())
    again = operator.deformations(x, weights)
    for u, v in zip(again, copies):
        np.testing.assert_array_equal(u, v)


def test_fields_have_the_same_bits_in_any_groups_of_a_class(built, monkeypatch):
    """Which subdomains that are alike are solved for at once follows from ranks. Those of which
    only one bears forces: its mates are at rest, with zeros that have no sign.
    """
    operator = built(cells=4, subdomains="8x4").operator
    many = max(operator.classes, key=lambda c: len(c.members))
    assert many.shared and len(many.members) > 8
    rng = np.random.default_rng(4)
    rows = np.zeros(operator.classes[-1].rows.stop)
    own = slice(many.rows.start, many.rows.start + many.F.shape[0])
    rows[own] = rng.standard_normal(many.F.shape[0])
    weights, corner = np.zeros(operator.structure.patterns), np.zeros(len(operator.coarse.numbers))
    fields = operator._recovery.between_corners(rows, weights, corner)
    rest = [s for s in range(len(fields)) if s != many.members[0]]
    assert fields[many.members[0]].any()
    assert not any(fields[s].any() or np.signbit(fields[s]).any() for s in rest)
    rows, corner = rng.standard_normal(len(rows)), rng.standard_normal(len(corner))
    fields = operator._recovery.between_corners(rows, weights + 1, corner)
    monkeypatch.setattr(reduction, "ENTRIES", 0)
    apart = operator._recovery.between_corners(rows, weights + 1, corner)
    assert [u.tobytes() for u in fields] == [u.tobytes() for u in apart]


def test_displacements_of_corners_are_those_of_the_fields(operator):
    """By their numbers in the coarse problem, whichever subdomain has them."""
    x = np.random.default_rng(5).standard_normal(operator.owned)
    weights, structure = np.ones(operator.structure.patterns), operator.structure
    whole, known = operator.coarse_displacements(x, weights), 0
    for u, dofs, numbers in zip(operator.deformations(x, weights), structure.corner_dofs,
                                structure.corner_global):
        np.testing.assert_allclose(whole[numbers], u[dofs], atol=1e-10 * np.abs(u).max())
        known += len(numbers)
    assert known > structure.coarse_dofs == len(whole)


@pytest.mark.parametrize("many", [0, 10**6])
def test_scalar_products_of_blocks_are_those_of_columns(operator, monkeypatch, many):
    """By partial sums in the order of subdomains, or, of more than MANY of them, by whole numbers.
    """
    monkeypatch.setattr(vectors, "MANY", many)
    of = DualOperator(operator.structure, MPI.COMM_SELF).vectors
    a, b = np.random.default_rng(3).standard_normal((2, operator.owned, 3))
    exact = [fsum(a[:, k] * b[:, k]) for k in range(3)]
    np.testing.assert_allclose(of.dots(a, b), exact, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(of.dots(a, b), [of.dot(a[:, k].copy(), b[:, k].copy())
                                               for k in range(3)], rtol=1e-14)


# ------------------------------------------------------------------------------ rigid motions

def test_rigid_motions_in_two_units():
    """A mode's displacements by factors of shifts and of a turn about the middle of its body."""
    bodies = Bodies(np.array([0, 1, 1]), np.array([[9.0, 9.0], [1.0, 2.0]]), np.array([1.0, 4.0]),
                    np.ones(3))
    mode = RigidMode(1, np.array([1, 2]), np.array([0.5, -1.0]), np.array([3.0, -2.0]), 0.25)
    xy = np.random.default_rng(4).random((5, 2))
    moved = mode.displacement(xy)
    away = xy - mode.center
    np.testing.assert_allclose(moved, [3.0, -2.0] + 0.25 * np.column_stack([-away[:, 1],
                                                                            away[:, 0]]))
    factors = bodies.coefficients(mode)
    assert not factors[:3].any()
    np.testing.assert_allclose(bodies.rigid(1, xy) @ factors[3:], moved)
    np.testing.assert_allclose(_motions(xy, bodies.center[1], 4.0).reshape(5, 2, 3),
                               bodies.rigid(1, xy))
    bodies.possible = np.array([0.0, 1.0, 0.0])  # of revolution: along the axis alone
    assert not bodies.rigid(1, xy)[:, :, [0, 2]].any()


def bodies_in_pieces():
    """Two bodies, the first in two subdomains, of triangles far from the origin."""
    first = np.array([[7.0, 3], [9, 3.5], [8.5, 5], [6.5, 4.5]])
    places = [first[[0, 1, 2]], first[[0, 2, 3]], np.array([[-4.0, 2], [-3, 2], [-3.5, 2.25]])]
    subs = [SimpleNamespace(index=k, xy=xy, elements=np.array([[0, 1, 2]]),
                            triangles=np.array([[0, 1, 2]]))
            for k, xy in enumerate(places)]
    bodies = Bodies(np.array([0, 0, 1]), np.array([[7.75, 4.0], [-3.5, 2.125]]),
                    np.array([2.5, 1.0]), np.ones(3))
    return SimpleNamespace(subdomains=subs, travel=SimpleNamespace(bodies=bodies), first=0)


def test_rigid_parts_are_the_nearest_motions_of_bodies():
    """In the mean square over the body, in the factors that bodies have; of a rigid motion it is
    the motion, and nothing deforms. What deforms is beside the nearest at corners alone.
    """
    structure, rng = bodies_in_pieces(), np.random.default_rng(6)
    bodies, subs = structure.travel.bodies, structure.subdomains
    parts = RigidParts(structure, MPI.COMM_SELF)
    factors = rng.standard_normal((2, 3))
    rigid = [(bodies.rigid(bodies.number[sub.index], sub.xy)
              @ factors[bodies.number[sub.index]]).ravel() for sub in subs]
    np.testing.assert_allclose(parts.coefficients(rigid), factors, rtol=1e-11)
    assert parts.deformation(rigid) < 1e-13
    fields = [rng.standard_normal(6) for _ in subs]
    own, far = parts.coefficients(fields), 0.0
    # the rule of the middles of sides is exact for products of linear functions
    middles, corners = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]]) / 2, np.eye(3)

    def nearest_by(rule, body):
        rows, right = [], []
        for sub, u in zip(subs, fields):
            if bodies.number[sub.index] != body:
                continue
            (a, b), (c, d) = sub.xy[1] - sub.xy[0], sub.xy[2] - sub.xy[0]
            root = np.sqrt(abs(a * d - b * c) / 2 / 3)
            rows.append(root * bodies.rigid(body, rule @ sub.xy).reshape(-1, 3))
            right.append(root * (rule @ u.reshape(-1, 2)).ravel())
        return np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]

    for body in (0, 1):
        np.testing.assert_allclose(own[body], nearest_by(middles, body), rtol=1e-11)
        nearest = nearest_by(corners, body)
        far = max(far, *(np.linalg.norm(u.reshape(-1, 2) - bodies.rigid(body, sub.xy) @ nearest,
                                        axis=1).max()
                         for sub, u in zip(subs, fields) if bodies.number[sub.index] == body))
    assert parts.deformation(fields) == pytest.approx(far, rel=1e-12)
    assert parts.deformation([u + r for u, r in zip(fields, rigid)]) == pytest.approx(far, rel=1e-9)


def test_rigid_parts_look_at_meshes_only_when_they_are_asked():
    """Many runs ask for no rigid part, and supported bodies never for integrals over the mesh."""
    structure = bodies_in_pieces()
    meshes = [sub.elements for sub in structure.subdomains]
    for sub in structure.subdomains:
        del sub.elements
    parts = RigidParts(structure, MPI.COMM_SELF)
    for sub, mesh in zip(structure.subdomains, meshes):
        sub.elements = mesh
    parts.deformation([np.arange(6.0) for _ in meshes])
    assert not {"_moments", "_triangles"} & vars(parts).keys()  # nor are triangles kept


def test_subdomains_of_one_mesh_ask_once_which_nodes_are_vertices(monkeypatch):
    structure, asked = bodies_in_pieces(), []
    mesh = structure.subdomains[0].elements
    for sub in structure.subdomains:
        sub.elements = mesh
    structure.corner_dofs = [np.array([0, 1])] * 3
    whole = rigid_parts._vertices
    monkeypatch.setattr(rigid_parts, "_vertices", lambda sub: asked.append(sub) or whole(sub))
    LeastDeformation(structure, [SimpleNamespace(members=[0, 1, 2])], MPI.COMM_SELF)
    assert len(asked) == 1


def test_corners_tell_of_deformation_what_no_rigid_motion_is():
    """The root of the mean square that the best motion leaves at the corners of a body."""
    structure, rng = bodies_in_pieces(), np.random.default_rng(7)
    bodies = structure.travel.bodies
    structure.corner_dofs = [np.array([0, 1, 4, 5]), np.array([0, 1, 2, 3]), np.array([1])]
    members = [[1], [0, 2]]
    least = LeastDeformation(structure, [SimpleNamespace(members=m) for m in members],
                             MPI.COMM_SELF)
    order = [1, 0, 2]
    motions = {s: bodies.rigid(bodies.number[s], structure.subdomains[s].xy).reshape(-1, 3)[
        structure.corner_dofs[s]] for s in order}
    factors = rng.standard_normal((2, 3))
    assert least(np.concatenate([motions[s] @ factors[bodies.number[s]] for s in order])) < 1e-13
    corner = {s: rng.standard_normal(len(structure.corner_dofs[s])) for s in order}
    R, u = np.concatenate([motions[1], motions[0]]), np.append(corner[1], corner[0])
    left = u - R @ np.linalg.lstsq(R, u, rcond=None)[0]
    expected = np.sqrt((left**2).mean())
    assert least(np.concatenate([corner[s] for s in order])) == pytest.approx(expected)


def test_springs_resist_the_motions_of_their_body():
    """Relative to the stiffest of these; of other bodies they count nothing."""
    stiffness = np.array([[[2.0, 0], [0, 4]], [[1.0, 0.5], [0.5, 1]], [[99.0, 0], [0, 99]]])
    springs = Springs(np.array([3, 4, 7]), np.array([[1.0, 0], [0, 2], [5, 5]]), stiffness)
    found = springs.resistance(np.array([3, 4]), np.zeros(2), 2.0)
    motions = np.array([[[1, 0, 0], [0, 1, 0.5]], [[1, 0, -1], [0, 1, 0]]])
    np.testing.assert_allclose(found.reshape(2, 2, 3), stiffness[:2] / 4 @ motions)
    assert springs.resistance(np.array([5]), np.zeros(2), 1.0).shape == (0, 3)


def test_the_rigid_part_of_what_supports_prescribe():
    """A translation to the last bit, from the middle of the values; turned where these tell so."""
    bodies = Bodies(np.array([0]), np.array([[0.0, 0.0]]), np.array([2.0]), np.ones(3))
    xy = np.array([[1.0, 0], [0, 1], [-1, 0]])
    motions, component = bodies.rigid(0, xy).reshape(-1, 3), np.tile([0, 1], 3)
    given = np.where(component == 0, 0.1, -0.3)
    assert _rigid_part(motions, component, given).tolist() == [0.1, -0.3, 0.0]
    exact = np.array([0.5, -1.0, 0.25])
    np.testing.assert_allclose(_rigid_part(motions, component, motions @ exact), exact, atol=1e-14)
    along = _rigid_part(motions[::2], component[::2], np.array([0.0, 0.0, 1.0]))
    assert along[1] == 0.0 and along[2] == 0.0  # one component tells no rotation
    assert along[0] == 0.5
