"""The identities FETI-DP carries within itself, and its answers against the assembled problem."""

import dataclasses
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import load_response
from small_scenes import halved
from mpi4py import MPI
from driver.hard.oracle import Assembled

from driver import children
from driver.feti import numbering, reduction
from driver.feti.dirichlet import DirichletPreconditioner, _inverse
from driver.feti.dual_problem import DualProblem
from driver.feti.operator import DualOperator
from driver.feti.rows import RowKind
from driver.march.tearing import build

EPS = np.finfo(float).eps
PARTITIONS = ["4x2", "3x3", "7"]  # two structured ones and a graph partition


@pytest.fixture(params=[*PARTITIONS, "4x2 P2", "7 P2"])
def problem(request, built):
    subdomains, *quadratic = request.param.split()
    if quadratic:
        return built(cells=2, subdomains=subdomains, element="P2")
    return built(cells=4, subdomains=subdomains)


def keys(problem):
    """Of every subdomain the body's dof number 2 gid + component of every local dof."""
    return [2 * sub.node_gid[sub.dof_node] + sub.dof_component for sub in problem.subdomains]


def local_B(rows, dofs):
    """(m, dofs) unsigned rows of one subdomain."""
    B = np.zeros((len(rows.row), dofs))
    np.add.at(B, (np.arange(len(rows.row))[:, None], rows.dof), rows.coefficient)
    return B


def spread(problem, weight):
    """(dual dofs, stacked local dofs) matrix with the local rows weighted by rows.<weight>."""
    parts = []
    for sub, rows in zip(problem.subdomains, problem.structure.rows):
        part = np.zeros((problem.structure.dual_dofs, sub.dofs))
        part[rows.row] = getattr(rows, weight)[:, None] * local_B(rows, sub.dofs)
        parts.append(part)
    return np.hstack(parts)


def free_field(problem, rng):
    """A random displacement of the untorn body that respects the supports, on the stacked local
    dofs.
    """
    w = rng.standard_normal(2 * problem.manifest.nodes)
    for key, fixed in zip(keys(problem), problem.structure.fixed):
        w[key[fixed]] = 0
    return w[np.concatenate(keys(problem))]


# ------------------------------------------------------------------------------ numbering

def test_every_row_is_numbered_once(problem):
    """Each number is used; a gluing row by two subdomains with opposite signs, at the same dof of
    the body.
    """
    s = problem.structure
    seen = [[] for _ in range(s.dual_dofs)]
    for index, (key, rows) in enumerate(zip(keys(problem), s.rows)):
        assert len(np.unique(rows.row)) == len(rows.row)
        for k, row in enumerate(rows.row):
            seen[row].append((index, rows.sign[k], key[rows.dof[k, 0]]))
    for row, uses in enumerate(seen):
        if s.row_kind[row] == RowKind.GLUING:
            (i, a, key_i), (j, b, key_j) = uses
            assert i < j and (a, b) == (1, -1) and key_i == key_j
        else:
            assert [sign for _, sign, _ in uses] == [1] + [0] * (len(uses) - 1)


def test_rows_are_owned_in_the_order_of_subdomains(problem):
    s = problem.structure
    lowest = np.full(s.dual_dofs, len(problem.subdomains))
    for index, rows in enumerate(s.rows):
        lowest[rows.row] = np.minimum(lowest[rows.row], index)
    assert np.all(np.diff(lowest) >= 0)
    assert s.row_range == (0, s.dual_dofs)
    np.testing.assert_array_equal(s.row_starts,
                                  np.searchsorted(lowest, np.arange(len(problem.subdomains))))


def test_coarse_numbers_round_trip(problem):
    """The same corner dof of the body has one number in all its subdomains, and every number is
    used.
    """
    s, of_key = problem.structure, {}
    for key, dofs, number in zip(keys(problem), s.corner_dofs, s.corner_global):
        for k, n in zip(key[dofs], number):
            assert of_key.setdefault(k, n) == n
    assert sorted(of_key.values()) == list(range(s.coarse_dofs))


def test_dofs_are_torn_corner_or_fixed(problem):
    for c in problem.operator.classes:
        for member in c.members:
            fixed = problem.structure.fixed[member]
            everything = np.concatenate([c.torn, c.corner, fixed])
            assert sorted(everything) == list(range(problem.subdomains[member].dofs))


def test_subdomains_with_contact_rows_are_known(problem):
    structure = problem.structure
    assert structure.touching == [s for s, rows in enumerate(structure.rows)
                                  if np.isin(rows.row, structure.at_contact.row).any()]


def test_equal_subdomains_are_measured_once(built, monkeypatch):
    """The trace of Hooke's law, for the skeleton and for levels of stiffness."""
    problem, whole, traces = built(cells=4, subdomains="4x2"), np.einsum, []

    def einsum(indices, *arrays, **options):
        traces.extend([1] * (indices == "tii->t"))
        return whole(indices, *arrays, **options)

    monkeypatch.setattr(np, "einsum", einsum)
    DualOperator(build(problem.manifest, problem.subdomains, 0, MPI.COMM_SELF), MPI.COMM_SELF)
    assert len(traces) == 2


def test_places_of_contact_nodes_are_looked_up_once_a_subdomain(built, monkeypatch):
    """For normal and tangential rows alike, in subdomains that touch alone."""
    problem, whole, looked = built(cells=4, subdomains="4x2"), numbering.lookup, []
    contact = problem.structure.contact.gid

    def lookup(keys, wanted):
        looked.extend([1] * np.array_equal(wanted, contact))
        return whole(keys, wanted)

    monkeypatch.setattr(numbering, "lookup", lookup)
    build(problem.manifest, problem.subdomains, 0, MPI.COMM_SELF)
    assert len(looked) == len(problem.structure.touching)


def test_contact_rows_point_back_to_their_nodes(problem):
    s, c = problem.structure, problem.structure.contact
    for kind, numbers, direction in ((RowKind.NORMAL, c.normal_row, c.normal),
                                     (RowKind.TANGENTIAL, c.tangential_row, c.tangent)):
        assert sorted(numbers) == np.flatnonzero(s.row_kind == kind).tolist()
        for sub, rows in zip(problem.subdomains, s.rows):
            for k in np.flatnonzero(np.isin(rows.row, numbers)):
                node = int(np.flatnonzero(numbers == rows.row[k])[0])
                assert sub.node_gid[rows.dof[k] // 2].tolist() == [c.gid[node]] * 2
                np.testing.assert_allclose(rows.coefficient[k], direction[node], atol=1e-15)


def test_gather_and_assemble_are_transposed(problem):
    """Sending a dual vector to the subdomains and adding it up counts every row's subdomains."""
    op, s = problem.operator, problem.structure
    uses = np.bincount(np.concatenate([rows.row for rows in s.rows]), minlength=s.dual_dofs)
    x = np.arange(1.0, s.dual_dofs + 1)
    # small whole numbers: exact
    assert np.array_equal(op.vectors.assemble(op.vectors.gather(x).copy()), uses * x)


@pytest.mark.parametrize("subdomains, primal, dual",
                         [("4x2", 1936, 260), ("8x4", 7744, 1096), ("16x8", 30976, 4496)])
def test_sizes_of_the_slides(built, subdomains, primal, dual):
    s = built(reduce=False, subdomains=subdomains).structure
    assert (s.primal_dofs, s.dual_dofs) == (primal, dual)


# ------------------------------------------------------------------- tearing and gluing identities

def test_continuous_fields_have_no_jump(problem):
    w = free_field(problem, np.random.default_rng(0))
    B = spread(problem, "sign")[problem.structure.row_kind == RowKind.GLUING]
    assert np.all(B @ w == 0)  # a difference of two equal numbers


def test_contact_rows_read_normal_and_tangential_displacement(problem):
    """n.u and t.u of a continuous field, once per node however many subdomains share it (corners
    included).
    """
    w, c = free_field(problem, np.random.default_rng(0)), problem.structure.contact
    read = spread(problem, "sign") @ w
    u = np.zeros(2 * problem.manifest.nodes)
    u[np.concatenate(keys(problem))] = w
    u = u.reshape(-1, 2)[c.gid]
    np.testing.assert_allclose(read[c.normal_row], (u * c.normal).sum(axis=1),
                               atol=4 * EPS * np.abs(u).max())
    np.testing.assert_allclose(read[c.tangential_row], (u * c.tangent).sum(axis=1),
                               atol=4 * EPS * np.abs(u).max())


def average(problem, w):
    """E_D w: mean over the subdomains that share a dof; the identity on fields without jumps."""
    key = np.concatenate(keys(problem))
    count = np.bincount(key, minlength=2 * problem.manifest.nodes)
    return (np.bincount(key, w, minlength=len(count)) / np.maximum(count, 1))[key]


def torn_field(problem, rng):
    """A random field of X: continuous at the corners, zero at the supports, torn elsewhere."""
    w = rng.standard_normal(sum(sub.dofs for sub in problem.subdomains))
    whole, at = free_field(problem, rng), 0
    for sub, corner, fixed in zip(problem.subdomains, problem.structure.corner_dofs,
                                  problem.structure.fixed):
        w[at + corner], w[at + fixed] = whole[at + corner], 0
        at += sub.dofs
    return w


def test_every_contact_row_has_its_compliance_once(problem):
    """Of the subdomains that know of a row one owns what its asperities add to F."""
    structure, known = problem.structure, problem.structure.at_contact
    expected, total = np.zeros(structure.dual_dofs), np.zeros(structure.dual_dofs)
    expected[known.row] = 1.0 + np.arange(len(known.row))
    structure.at_contact = dataclasses.replace(known, compliance=expected[known.row])
    try:
        for s, rows in enumerate(structure.rows):
            np.add.at(total, rows.row, structure.own_compliance(s))
    finally:
        structure.at_contact = known
    np.testing.assert_array_equal(total, expected)


def test_a_rank_alone_receives_nothing(problem):
    assert not any(problem.operator.message_bytes().values())
    assert problem.operator.load()["messages"] == 0


def test_a_product_multiplies_by_local_matrices_and_twice_by_the_coarse_factor(problem):
    """By the compliance of its rows and, forth and back, what couples them to corners, a subdomain;
    a triangular factor has at least its diagonal.
    """
    structure = problem.structure
    rows = np.array([len(np.unique(rows.row)) for rows in structure.rows])
    corners = np.array([len(dofs) for dofs in structure.corner_dofs])
    coarse = problem.operator.load()["work"] - (rows * (rows + 2 * corners)).sum()
    assert coarse % 2 == 0 and coarse >= 2 * structure.coarse_dofs


def test_average_and_jump_add_up_to_the_identity(problem):
    """E_D + P_D = I on fields with common corners, P_D = B_D' B: weights and gluing rows fit
    together.
    """
    gluing = problem.structure.row_kind == RowKind.GLUING
    B, B_D = (spread(problem, name)[gluing] for name in ("sign", "scaling"))
    w = torn_field(problem, np.random.default_rng(1))
    jump = B_D.T @ (B @ w)
    assert np.abs(jump).max() > 0.1  # the field is torn
    np.testing.assert_allclose(average(problem, w) + jump, w, atol=8 * EPS)
    np.testing.assert_allclose(average(problem, jump), 0, atol=8 * EPS)  # R_D' P_D = 0
    np.testing.assert_allclose(B_D.T @ (B @ jump), jump, atol=8 * EPS)  # a projection


def test_scaled_jump_is_a_right_inverse(problem):
    gluing = problem.structure.row_kind == RowKind.GLUING
    B, B_D = (spread(problem, name)[gluing] for name in ("sign", "scaling"))
    assert np.array_equal(B @ B_D.T, np.eye(gluing.sum()))  # halves and ones: exact


def test_contact_rows_are_shared_out_between_their_subdomains(problem):
    """The preconditioner takes the whole of every contact row, half of it from each of two
    subdomains.
    """
    contact = problem.structure.row_kind != RowKind.GLUING
    scaling = np.bincount(np.concatenate([rows.row for rows in problem.structure.rows]),
                          np.concatenate([rows.scaling for rows in problem.structure.rows]))
    assert np.all(scaling[contact] == 1.0)


def test_the_softer_side_of_an_interface_counts_more(built, variant):
    """Weights of a gluing row are the other side's share of the stiffness, here 1 : 7."""
    scene = variant("jump", ("macro young() E //", "macro young() (E*(x < 1 ? 1 : 7)) //"))
    structure = built(scene, reduce=False, subdomains="4x2").structure
    found = {}
    for s, rows in enumerate(structure.rows):
        for row, scaling in zip(rows.row, np.abs(rows.scaling)):
            # numbered from left to right, two rows
            found.setdefault(row, []).append((s % 4 > 1, scaling))
    # the soft side first
    glued = [sorted(pair) for row, pair in found.items()
             if structure.row_kind[row] == RowKind.GLUING]
    # two interfaces of nine nodes
    assert sum(one != other for (one, _), (other, _) in glued) == 2 * 2 * 9
    for (one, soft), (other, stiff) in glued:
        expected = (7 / 8, 1 / 8) if one != other else (0.5, 0.5)
        # means over triangles are kept to nine digits
        assert (soft, stiff) == pytest.approx(expected, rel=1e-8)


# ------------------------------------------------------------------------ the dual operator

def condensed(problem, rows):
    """F at the contact rows `rows` after elimination of the gluing multipliers, and the load's part
    likewise.
    """
    s, F = problem.structure, problem.F
    d = load_response(problem.operator, np.ones(s.patterns))
    gluing = s.row_kind == RowKind.GLUING
    if not gluing.any():
        return F[np.ix_(rows, rows)], d[rows]
    inner = np.linalg.solve(F[np.ix_(gluing, gluing)],
                            np.column_stack([F[np.ix_(gluing, rows)], d[gluing]]))
    across = F[np.ix_(rows, gluing)]
    return F[np.ix_(rows, rows)] - across @ inner[:, :-1], d[rows] - across @ inner[:, -1]


def check_compliance(problem):
    """F and d condensed onto the contact nodes are those of the assembled body.

    Rounding: eps times the condition of the stiffness (of order (2/h)^2 times 10, so below 1e5 for
    these meshes) and of the gluing block (below 1e2) would allow 1e-9; 1e-10 leaves no room for a
    modelling error.
    """
    body, contact = Assembled(problem.manifest, problem.subdomains), problem.structure.contact
    # a node at a corner of the body stands there once for each of its normals
    apart = np.linalg.norm(contact.normal[:, None] - body.normal, axis=2)
    apart[contact.gid[:, None] != body.gid] = np.inf
    at = apart.argmin(axis=1)
    assert sorted(at) == list(range(len(body.gid)))
    rows, at = np.concatenate([contact.normal_row,
                               contact.tangential_row]), np.concatenate([at, len(at) + at])
    rows, at = rows[rows >= 0], at[rows >= 0]
    C, unit = body.compliance()[np.ix_(at, at)], (body.B @ body.solve(np.ones(len(body.loads))))[at]
    found, d = condensed(problem, rows)
    assert np.abs(found - C).max() <= 1e-10 * np.abs(C).max()
    assert np.abs(d - unit).max() <= 1e-10 * np.abs(unit).max()


def test_dual_operator_is_symmetric_positive_definite(problem):
    F = problem.F
    # the product with S_cc^-1 is not symmetric to the last bit: eps times the coarse problem's
    # condition
    assert np.abs(F - F.T).max() <= 1e-12 * np.abs(F).max()
    values = np.linalg.eigvalsh((F + F.T) / 2)
    # a dependent row would give 1e-16; conditions here are 1e3 to 1e4
    assert values[0] > 1e-6 * values[-1]


def test_corners_bound_the_deformation_from_below(problem):
    """And less a rigid motion: turning the corners changes nothing but rounding."""
    operator, rng = problem.operator, np.random.default_rng(11)
    for _ in range(3):
        multipliers = rng.standard_normal(operator.owned)
        least = operator.least_deformation(multipliers, np.ones(1))
        assert least <= operator.deformation(multipliers, np.ones(1)) * (1 + 1e-12)
        if problem.structure.coarse_dofs > 8:  # three numbers of them are a rigid motion
            assert least > 0.01 * operator.deformation(multipliers, np.ones(1))
    bound = operator._least
    corner = rng.standard_normal(len(operator.coarse.numbers))
    turned = corner + 100 * bound._R.T @ [0.3, -0.2, 0.5]
    assert bound(turned) == pytest.approx(bound(corner), abs=1e-11)


def test_products_are_counted(problem):
    before = problem.operator.products
    problem.operator.apply(np.ones(problem.structure.dual_dofs))
    assert problem.operator.products == before + 1


def test_apply_does_not_change_its_argument(problem):
    x = np.random.default_rng(0).standard_normal(problem.structure.dual_dofs)
    kept = x.copy()
    first = problem.operator.apply(x)
    second = first.copy()
    problem.operator.apply(2 * x)
    assert np.array_equal(x, kept) and np.array_equal(first, second)


def test_condensed_operator_is_the_compliance_of_the_body(problem):
    check_compliance(problem)


def test_condensed_operator_at_the_size_of_the_slides(built):
    check_compliance(built())


ANNULUS = """
border outer0(t=0, 4) { x=t; y=0; label=1; }
border outer1(t=0, 1.5) { x=4; y=t; label=2; }
border outer2(t=4, 0) { x=t; y=1.5; label=3; }
border outer3(t=1.5, 0) { x=0; y=t; label=4; }
border hole(t=0, 2*pi) { x=2 + 0.4*cos(t); y=0.75 + 0.4*sin(t); label=5; }
body = buildmesh(outer0(20) + outer1(8) + outer2(20) + outer3(8) + hole(-12));
"""


@pytest.mark.parametrize("subdomains", ["1x1", "3x1", "1x3", "5x3", "2", "9"])
@pytest.mark.some(3)
def test_body_with_a_hole(built, variant, subdomains):
    """Unstructured mesh; subdomains around the hole, in two pieces (1x3) or meeting a neighbour
    twice (2x1).
    """
    scene = variant("hole", ("rectangle(0., 2., 0., 1.);", ANNULUS))
    check_compliance(built(scene, subdomains=subdomains))


@pytest.mark.parametrize("contact", ["5", "1, 5", "3, 2"])
def test_contact_on_a_curve_and_on_several_labels(built, variant, contact):
    """Normals of every direction; a node at a corner of the body has a pair of rows for each of its
    labels.
    """
    scene = variant(f"contact{len(contact)}{contact[0]}", ("rectangle(0., 2., 0., 1.);", ANNULUS),
                    ("macro contact() 1 //", f"macro contact() {contact} //"))
    check_compliance(built(scene, subdomains="4x2"))


SLANTED = """
border side1(t=0, 2) { x=t; y=0.2*t; label=1; }
border side2(t=0.4, 1) { x=2; y=t; label=2; }
border side3(t=2, 0) { x=t; y=1; label=3; }
border side4(t=1, 0) { x=0; y=t; label=4; }
body = buildmesh(side1(16) + side2(6) + side3(16) + side4(8));
"""


@pytest.mark.parametrize("subdomains", ["1x1", "4x2", "5"])
def test_contact_node_with_one_prescribed_component(built, variant, subdomains):
    """On a slope n.u at the end node is part unknown (u2), part prescribed (u1 = 1e-3): both belong
    to d.
    """
    scene = variant("slanted", ("rectangle(0., 2., 0., 1.);", SLANTED),
                    ("macro friction() F //\n", ""),
                    ('include "export.idp"',
                     "macro displacement1() on(2, u1 = 1e-3) //\ninclude \"export.idp\""))
    check_compliance(built(scene, subdomains=subdomains))


@pytest.mark.parametrize("young", ["(x < 0.9 ? E : 10*E)", "E*(1 + 1e-8*x)", "E*(1 + x*y)"])
def test_subdomains_of_different_material_share_nothing(built, variant, young):
    """Classes are formed by matrices, not by shape: also a difference in the eighth digit must
    count.
    """
    scene = variant(f"young{len(young)}", ("macro young() E //", f"macro young() {young} //"))
    problem = built(scene, cells=3)
    check_compliance(problem)
    for c in problem.operator.classes:
        model = problem.subdomains[c.members[0]].stiffness.values
        for member in c.members:
            assert np.abs(problem.subdomains[member].stiffness.values
                          - model).max() <= 1e-11 * np.abs(model).max()


def test_sharing_classes_changes_nothing(built, monkeypatch):
    shared = built()
    assert len(shared.operator.classes) < len(shared.subdomains)
    monkeypatch.setattr(reduction, "_fingerprint", lambda structure, s, pattern: str(s).encode())
    alone = DualOperator(shared.structure, MPI.COMM_SELF)
    assert len(alone.classes) == len(shared.subdomains)
    x = np.random.default_rng(3).standard_normal(alone.owned)
    # equal subdomains differ in the last bits of K: eps times the condition of K_rr (1e3 for 10x10
    # cells)
    for one, other in zip((alone.apply(x), load_response(alone, np.ones(1))),
                          (shared.operator.apply(x), load_response(shared.operator, np.ones(1)))):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


# ------------------------------------------------------------------------------ corners

@pytest.mark.parametrize("subdomains", ["1x2", "5x1", "2x6", "2", "3", "5", "6", "8", "11", "13",
                                        "17", "23", "30"])
@pytest.mark.some(2)
def test_torn_subdomains_are_held(built, subdomains):
    """K_rr of every subdomain is positive definite: corners and supports leave no rigid motion or
    hinge.
    """
    problem = built(cells=4, subdomains=subdomains)
    s = problem.structure
    for sub, fixed, corner in zip(problem.subdomains, s.fixed, s.corner_dofs):
        K = sub.stiffness.toarray()
        kept = np.setdiff1d(np.arange(sub.dofs), np.concatenate([fixed, corner]))
        values = np.linalg.eigvalsh(K[np.ix_(kept, kept)])
        # a motion would give rounding, 1e-16; a piece hung up on two corners a mesh width apart
        # gives 1e-4
        assert values[0] > 1e-6 * values[-1], sub.index
    check_compliance(problem)


def test_structured_corners_are_the_subdomain_vertices(built):
    s = built().structure
    found = {tuple(sub.xy[v]) for sub, dofs in zip(s.subdomains, s.corner_dofs) for v in dofs // 2}
    assert found == {(x, y) for x in (0.5, 1, 1.5, 2) for y in (0, 0.5, 1)}


# ------------------------------------------------------------------- Dirichlet preconditioner

def gluing_condition(problem):
    """Condition number of the preconditioned gluing block M F."""
    operator, gluing = problem.operator, problem.structure.row_kind == RowKind.GLUING
    columns = np.eye(problem.structure.dual_dofs)[gluing]
    F = np.array([operator.apply(e)[gluing] for e in columns])
    M = DirichletPreconditioner(operator)
    M = np.array([M(e, gluing)[gluing] for e in columns])
    # pinv costs eps times the condition of F_i, 1e4
    assert np.abs(M - M.T).max() <= 1e-10 * np.abs(M).max()
    L = np.linalg.cholesky((M + M.T) / 2)  # fails unless positive definite
    values = np.linalg.eigvalsh(L.T @ ((F + F.T) / 2) @ L)
    return values[-1] / values[0]


def test_dirichlet_preconditioner_is_good_and_scalable(built):
    """4.7 to 5.0 were measured for 10x10 cells (algorithms.md), and no growth with the number of
    subdomains.
    """
    small, large = (gluing_condition(built(subdomains=n)) for n in ("4x2", "8x4"))
    assert small < 6 and large < 6
    assert abs(large / small - 1) < 0.15


def test_stiffness_of_rows_that_depend_on_one_another():
    """The inverse of a compliance; if two rows are the same the pseudo-inverse, not a large number.
    """
    rng = np.random.default_rng(8)
    A = rng.standard_normal((12, 12))
    A = A @ A.T + np.eye(12)
    np.testing.assert_allclose(_inverse(A) @ A, np.eye(12), atol=100 * EPS * np.linalg.cond(A))
    twice = A[np.ix_([*range(12), 3], [*range(12), 3])]
    found = _inverse(twice)
    assert np.linalg.norm(found, 2) <= np.linalg.norm(np.linalg.inv(A),
                                                      2) * (1 + 100 * EPS * np.linalg.cond(A))
    np.testing.assert_allclose(twice @ found @ twice, twice,
                               atol=1000 * EPS * np.linalg.cond(A) * np.abs(A).max())


def test_preconditioner_respects_the_face(problem):
    """Zero outside the free set, and symmetric on it: MPRGP needs both in every face."""
    rng = np.random.default_rng(5)
    free = (problem.structure.row_kind
            == RowKind.GLUING) | (rng.random(problem.structure.dual_dofs) < 0.5)
    M = DirichletPreconditioner(problem.operator)
    x, y = rng.standard_normal((2, len(free)))
    Mx, My = M(x, free).copy(), M(y, free).copy()
    assert not Mx[~free].any()
    assert np.array_equal(Mx, M(np.where(free, x, 0), free))
    # eps times the condition of the local F_i (1e4) times the cancellation of a random product
    # (1e2)
    assert abs(Mx @ y - My @ x) <= 1e-9 * np.linalg.norm(Mx) * np.linalg.norm(y)
    assert Mx @ x > 0


# ------------------------------------------------------------------- linear problems and supports

NO_CONTACT = (("macro contact() 1 //\n", ""), ("macro friction() F //\n", ""))


def check_linear(problem):
    """Without contact the displacements are those of the assembled body.

    Both solves round with eps times a condition of the stiffness below 1e5: 1e-10 relative is safe.
    """
    assert not np.any(problem.structure.row_kind != RowKind.GLUING)
    weights = np.ones(problem.structure.patterns)
    d = load_response(problem.operator, weights)
    lam = np.linalg.solve(problem.F, d) if len(d) else d
    u = Assembled(problem.manifest, problem.subdomains).solve(weights)
    for key, found in zip(keys(problem), problem.operator.displacements(lam, weights)):
        assert np.abs(found - u[key]).max() <= 1e-10 * np.abs(u).max()


@pytest.mark.parametrize("subdomains", ["4x2", "2x1", "1x1", "9", "1"])
@pytest.mark.some(2)
def test_linear_problem_equals_a_direct_solve(built, variant, subdomains):
    check_linear(built(variant("linear", *NO_CONTACT), cells=5, subdomains=subdomains))


@pytest.mark.parametrize("subdomains", ["4x2", "2x2", "1x1", "6"])
@pytest.mark.some(2)
def test_prescribed_displacement_equals_a_direct_solve(built, variant, subdomains):
    prescribed = "macro displacement1() on(2, u1 = 1e-3, u2 = 2e-3*y) //\n"
    pushed = variant("pushed", *NO_CONTACT,
                     ('include "export.idp"', prescribed + 'include "export.idp"'))
    check_linear(built(pushed, cells=5, subdomains=subdomains))


@pytest.mark.parametrize("subdomains", ["4x2", "1x1", "5"])
@pytest.mark.parametrize("name, support", [
    ("loose", ""),  # three rigid motions
    ("rolling", "macro support() on(4, u1 = 0.) //\n"),  # slides along y
    ("sliding", "macro support() on(1, u2 = 0.) //\n")])  # slides along x
@pytest.mark.some(2)
def test_body_that_can_move_is_refused(solved, variant, subdomains, name, support):
    """Nothing takes the load's work on the free rigid motions: no equilibrium, whatever the body
    deforms.
    """
    scene = variant(name, ("macro support() on(4, u1 = 0., u2 = 0.) //\n", support), *NO_CONTACT)
    run = solved(scene, cells=4, subdomains=subdomains)
    assert run.status == 3 and "which no support holds" in run.reason


@pytest.mark.parametrize("friction, status", [(0.3, 0), (0.15, 3)])
def test_friction_alone_holds_the_model_or_not(solved, variant, friction, status):
    """The final load is 3e7 sideways on 15e7 downwards: friction holds the body from F = 0.2 on."""
    scene = variant("loose_contact", ("macro support() on(4, u1 = 0., u2 = 0.) //\n", ""))
    run = solved(scene, cells=4, friction=friction)
    assert run.status == status
    if status:
        assert "which no support holds" in run.reason
    else:
        np.testing.assert_allclose([run.history["contact_x"][-1], run.history["contact_y"][-1]],
                                   [-3e7, 15e7], rtol=1e-6)


# ------------------------------------------------------------------------------ ranks

SCRIPT = """
import hashlib, sys
from driver import environment
environment.prepare_libraries(); environment.start_petsc()
import numpy as np
from mpi4py import MPI
from pathlib import Path
from driver.scene.loader import read_subdomains
from driver.scene.manifest import read_manifest
from driver.march.tearing import build
from driver.feti.dirichlet import DirichletPreconditioner
from driver.feti.operator import DualOperator
from driver.feti.structure import partition
from driver.march.problem import Problem
from driver.options import Settings
comm = MPI.COMM_WORLD
for directory in sys.argv[1:]:
    manifest = read_manifest(Path(directory))
    first, last = partition(manifest.subdomains, comm)
    structure = build(manifest, read_subdomains(manifest, first, last, comm), first, comm)
    op = DualOperator(structure, comm)
    mine = slice(*structure.row_range)
    x = np.random.default_rng(7).standard_normal(structure.dual_dofs)[mine]
    free = np.random.default_rng(8).random(structure.dual_dofs)[mine] < 0.7
    y = op.apply(x).copy()
    ones = np.ones(structure.patterns)
    d = op.elastic_response(ones) + op.rigid_response(ones)
    found = [y, d, DirichletPreconditioner(op)(x, free),
             np.array([op.dot(x, y), op.dot(x, x)])[: 2 if comm.rank == 0 else 0]]
    assert op.dots((x, y), (x, x)).tolist() == [op.dot(x, y), op.dot(x, x)]
    solver = Problem(manifest, structure, op).solver(Settings())
    found.append(np.array([step.multipliers for step in solver.steps()]).T)
    fields = op.deformations(x, ones)
    found.append([op.rigid_parts.deformation(fields)] * (comm.rank == 0))
    found.append(np.concatenate([np.empty(0), *fields]))
    found = [np.concatenate(comm.gather(np.asarray(part, float)) or [[]]) for part in found]
    if comm.rank == 0:
        print(*(hashlib.sha1(part.tobytes()).hexdigest()[:12] for part in found))
"""


@pytest.mark.slow
def test_any_split_gives_the_same_bits(exported, tmp_path):
    """Products, loads, preconditioner, scalar products, one by one and several at once, all steps,
    displacements and what bodies deform by: sums are taken in an order the ranks do not change.
    """
    script = tmp_path / "split.py"
    script.write_text(SCRIPT)
    cases = [exported(), exported(subdomains="7", cells=4), exported(subdomains="2x1", cells=4)]
    answers = {}
    for ranks in (1, 2, 3):  # 3 ranks on 2 subdomains: one has none
        env = {**children.child_environment(), "PYTHONPATH": children.python_path()}
        done = subprocess.run([*children.mpirun(ranks), sys.executable, script, *cases],
                              env=env, text=True,
                              capture_output=True, timeout=120)
        assert done.returncode == 0, done.stderr[-2000:]
        answers[ranks] = done.stdout
    assert len(answers[1].split()) == 21
    assert answers[1] == answers[2] == answers[3]


def test_block_diagonal_products_shared_and_padded():
    """Against one product a member, for blocks that many share, blocks of their own and empty ones.
    """
    from driver.feti.blocks import BlockDiagonal

    rng = np.random.default_rng(31)
    classes, matrices, x_at, y_at = [], [], 0, 0
    for members, m, n, shared in ((6, 5, 3, True), (1, 7, 2, False), (2, 7, 1, False),
                                  (1, 0, 2, False),
                                  (1, 4, 0, False), (1, 9, 9, True)):
        classes.append(SimpleNamespace(members=list(range(members)), shared=shared,
                                       rows=slice(x_at, x_at + members * m),
                                       corners=slice(y_at, y_at + members * n)))
        matrices.append(rng.standard_normal((m, n)))
        x_at, y_at = x_at + members * m, y_at + members * n
    x, before = rng.standard_normal(x_at), rng.standard_normal(y_at)
    expected = np.zeros(y_at)
    for c, M in zip(classes, matrices):
        expected[c.corners] = (x[c.rows].reshape(len(c.members), -1) @ M).ravel()
    blocks, y = BlockDiagonal(classes, matrices, "rows", "corners"), np.zeros(y_at)
    blocks.multiply(x, y)
    # sums of up to nine terms
    assert np.abs(y - expected).max() <= 1e-14 * np.abs(expected).max() * 10
    y = before.copy()
    blocks.multiply(x, y, add=True)
    assert np.abs(y - before - expected).max() <= 1e-14 * (np.abs(before)
                                                           + np.abs(expected)).max() * 10


def test_a_class_is_shared_by_its_members_on_all_ranks(built):
    operator = built(subdomains="4x2", cells=4).operator
    assert all(c.shared == (len(c.members) >= 4) for c in operator.classes)


def test_rows_of_a_slanted_boundary_that_ends_at_a_roller_are_independent(built):
    """The tip has one displacement left: normal and tangential rows there would be multiples of
    each other.
    """
    problem = built("hard/slope", left="roller", n=4, steps=1)
    values = np.linalg.eigvalsh(problem.F)
    assert values[0] > 1e-6 * values[-1]  # condition of F below a million: no row repeats another
    contact = problem.structure.contact
    tip = np.flatnonzero(np.linalg.norm(contact.xy, axis=1) < 1e-12)
    assert contact.normal_row[tip] >= 0 > contact.tangential_row[tip]
    assert (np.delete(contact.tangential_row, tip) >= 0).all()


def test_rows_are_scaled_by_the_stiffness_they_see(built):
    """Ones on a homogeneous body; with a jump of 2^20, 2^-10 on gluing rows (the soft side) and on
    soft contact.
    """
    small = {"subdomains": "2x1", "cells": 4, "steps": 1}
    assert (built("hard/block", **small).structure.row_scale == 1).all()
    # the left half is stiff
    structure = built("hard/block", jump=2**20, board="halves", **small).structure
    scale, contact = structure.row_scale, structure.contact
    assert (scale[structure.row_kind == RowKind.GLUING] == 2.0**-10).all()
    assert np.array_equal(scale[contact.normal_row], np.where(contact.xy[:, 0] <= 1, 1.0, 2.0**-10))


@pytest.mark.parametrize("about, time, rows, expected", [
    ("same", 1.0, True, "kept"), ("other", 1.0, True, "taken"), ("same", 2.0, True, "taken"),
    ("other", 2.0, False, "renewed"), (None, 2.0, True, "kept")])
def test_contact_that_follows_is_that_of_the_step(about, time, rows, expected):
    """Its displacements and its time; rows that are others are made anew."""
    places = {"same": np.zeros(2), "other": np.zeros(2), None: None}
    now = SimpleNamespace(has_rows_of=lambda contact: rows)
    made, renewed = [], []

    def follow(u, at):
        made.append((u, at))
        return now

    op = object.__new__(DualOperator)
    contact = SimpleNamespace(about=SimpleNamespace(u=places["same"]), time=1.0,
                              following=SimpleNamespace(about=follow))
    op.structure, op.renew = SimpleNamespace(contact=contact), renewed.append
    op.follow(SimpleNamespace(about=places[about], time=time))
    found = "kept" if op.structure.contact is contact and not renewed else (
        "renewed" if renewed == [now] else "taken")
    assert found == expected and len(made) == (expected != "kept")
    assert all(u is places[about] and at == time for u, at in made)


class Nothing(DualProblem):
    """A dual problem of two rows that feel nothing."""

    def apply(self, multipliers):
        return 0 * multipliers

    def dot(self, a, b):
        return a @ b

    def elastic_response(self, weights):
        return np.zeros(2)

    def deformation(self, multipliers, weights):
        return 3.0

    def preconditioner(self):
        return None


def test_a_dual_problem_has_no_free_bodies_by_default():
    """No motions, springs, work or travel; nothing counted yet, one level of stiffness."""
    one = Nothing(SimpleNamespace(patterns=3), 2, MPI.COMM_SELF)
    assert one.products == one.modes == 0 and one.levels == 1 and not one.contact_rows_only
    assert one.rho.shape == (0,) and one.rigid_work.shape == (2, 3, 0) and one.motions == []
    assert not one.rigid_response(np.ones(3)).any() and one.softness is None
    assert [of.shape for of in one.imbalance(np.ones(2), np.ones(3))] == [(0,), (0,)]
    assert one.deformation_by_level(None, None).tolist() == [3.0]
    assert one.least_deformation(None, None) == 3.0 and one.norm_bound(np.ones(2)) is None
    assert one.row_level.tolist() == [0, 0]


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e12])
def test_stiffness_that_differs_by_rounding_is_shared(unit):
    """Of pieces cut alike at other places, in any unit; what differs by more is its own."""
    values = unit * np.random.default_rng(1).standard_normal((10, 10))
    one = halved(values)
    assert reduction._same(one, one) and reduction._same(one, halved(values * (1 + 1e-15)))
    assert not reduction._same(one, halved(values + 1e-6 * np.abs(values).max()))
