"""Algebra of condensed problems on matrices made by hand: fronts, compliances, contact blocks."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from scipy.sparse import csr_matrix, triu

from driver.errors import NotConverged
from driver.feti import coarse, compliance, dense_front, elimination_tree, fronts, halves
from driver.feti.compliance import ContactCompliance, FaceInverse, _Factor, _multiply
from driver.feti.contact_block import ContactBlock
from driver.feti.elimination_tree import EliminationTree
from driver.feti.fronts import GluingElimination
from driver.feti.halves import Half
from driver.feti.operator import DualOperator
from driver.feti.structure import ContactTable, Substructure


def spd(size: int, seed=1) -> np.ndarray:
    """(size, size) random, positive definite."""
    root = np.random.default_rng(seed).standard_normal((size, size + 3))
    return root @ root.T


# ------------------------------------------------------------------------------ fronts

# unknowns of three subdomains: dual rows 0..6, of which 2 and 5 belong to contact; corners 7, 8, 9
NUMBERS = [np.array([0, 1, 2, 7, 8]), np.array([1, 0, 3, 4, 8, 9, 7]), np.array([4, 3, 5, 6, 9])]
ROWS, DUAL, SIZE = np.array([5, 2]), 7, 10
HALVES = np.array([0, 1, 3])  # the third subdomain by itself


def test_unknowns_of_a_front_belong_to_the_same_subdomains():
    """Gluing rows, corners and contact rows apart; those of contact after all others."""
    group, count = elimination_tree.groups(NUMBERS, SIZE, DUAL, ROWS, HALVES)
    sets = [frozenset(k for k, number in enumerate(NUMBERS) if i in number) for i in range(SIZE)]
    kinds = ["contact" if i in ROWS else "glue" if i < DUAL else "corner" for i in range(SIZE)]
    for i in range(SIZE):
        for j in range(SIZE):
            assert (group[i] == group[j]) == ((sets[i], kinds[i]) == (sets[j], kinds[j]))
    assert count == len(set(group[np.setdiff1d(np.arange(SIZE), ROWS)].tolist())) == 5
    assert sorted(set(group.tolist())) == list(range(7)) and group[ROWS].min() == count
    # 0 of no rows: nothing to eliminate
    assert elimination_tree.groups([ROWS], SIZE, DUAL, np.arange(SIZE), HALVES[:1])[1] == 0


@pytest.mark.parametrize("merged", [True, False])
def test_places_follow_the_fronts_and_end_with_contact_in_its_order(monkeypatch, merged):
    """Gluing rows of a front before its corners; children before parents, all they meet in these.
    """
    if not merged:
        monkeypatch.setattr(elimination_tree, "_pays", lambda child, parent: False)
    group, count = elimination_tree.groups(NUMBERS, SIZE, DUAL, ROWS, HALVES)
    tree = EliminationTree(NUMBERS, SIZE, DUAL, ROWS, HALVES)
    place, start = tree.place, tree.start
    assert sorted(place.tolist()) == list(range(SIZE)) and place[ROWS].tolist() == [8, 9]
    # the smallest problems are one front; else there is one for every group
    assert len(tree.fronts) == (1 if merged else count)
    assert sorted(g for front in tree.fronts for g in front.groups) == list(range(count))
    assert len(start) == len(tree.fronts) + 1 and start[-1] == SIZE - len(ROWS)
    for k, (front, (glued, corners)) in enumerate(zip(tree.fronts, tree.pivots)):
        own = np.flatnonzero(np.isin(group, front.groups))
        assert np.sort(place[own]).tolist() == list(range(start[k], start[k + 1]))
        assert np.count_nonzero(own < DUAL) == glued and len(own) == glued + corners
        assert (place[own[own < DUAL]] < start[k] + glued).all()
        met = np.isin(group, list(front.rest))
        assert front.pivots == len(own) and front.size == len(own) + np.count_nonzero(met)
        later = [parent for parent, other in enumerate(tree.fronts)
                 if front.rest.intersection(other.groups)]
        assert tree.parent[k] == min(later, default=len(tree.fronts)) > k
        if later:
            above = tree.fronts[tree.parent[k]]
            assert front.rest <= above.rest.union(above.groups)
    assert tree.first.tolist() == [min(int(np.searchsorted(start, place[number].min(), "right"))
                                       - 1, len(tree.fronts)) for number in NUMBERS]


def test_a_child_is_merged_where_its_rest_fills_the_front():
    """Not where the front would grow by more than a copy of the rest, and a front, take."""
    pays, front = elimination_tree._pays, elimination_tree.Front
    assert pays(front([0], set(), 12, 1412), front([1], set(), 20, 1400))
    assert not pays(front([0], set(), 300, 500), front([1], set(), 20, 1400))
    assert pays(front([0], set(), 18, 90), front([1], set(), 18, 90))  # small ones always


def test_parts_are_added_where_their_indices_are():
    """Of any number and overlap; matrices may be made when they are needed, and are taken out."""
    rng = np.random.default_rng(2)
    indices = [np.array([1, 4, 6]), np.array([0, 1, 4, 6, 9]), np.array([4, 9])]
    given = [rng.standard_normal((len(i), len(i))) for i in indices]
    expected = np.zeros((10, 10))
    for i, matrix in zip(indices, given):
        expected[np.ix_(i, i)] += matrix
    indices.append(np.empty(0, int))  # of a body without contact, eliminated as a whole
    given.append(np.empty((0, 0)))
    for order, count in (([0, 1, 2], 0), ([2, 1, 3, 0], 2), ([1, 2, 0, 3], 3), ([3, 0, 2, 1], 5)):
        parts = [(indices[k], (lambda m=given[k].copy(): m) if k else given[k].copy())
                 for k in order]
        index, columns, rest = dense_front.assembled(parts, count)
        assert index.tolist() == [0, 1, 4, 6, 9] and not parts
        total = np.hstack([columns, np.vstack([np.zeros((count, 5 - count)), rest])])
        np.testing.assert_allclose(np.tril(total), np.tril(expected[np.ix_(index, index)]),
                                   rtol=1e-14)
    index, columns, rest = dense_front.assembled([], 0)
    assert not len(index) and columns.shape == rest.shape == (0, 0)


@pytest.mark.parametrize("count", [0, 3, 4, 9])
@pytest.mark.parametrize("place", [[0, 1, 2, 3], [2, 3, 4, 7], [0, 2, 5, 8], [5]])
def test_blocks_are_added_like_single_entries(monkeypatch, place, count):
    """Rows beside one another and apart, of pivots and others, of a whole matrix and of a half, so
    many at a time: to the last bit, in the lower triangle.
    """
    rng, sums = np.random.default_rng(6), []
    start, matrix = rng.standard_normal((9, 9)), rng.standard_normal([len(place)] * 2)
    for cost, rows in itertools.product((0, 1e9), (None, 1, 2, 3)):
        monkeypatch.setattr(dense_front, "A_BLOCK", cost)
        monkeypatch.setattr(halves, "AT_A_TIME", rows)
        sums.append(start.copy())
        given = Half(matrix) if rows else matrix
        dense_front._add(sums[-1][:, :count], sums[-1][count:, count:], np.array(place), given)
    expected = start.copy()
    expected[np.ix_(place, place)] += matrix
    for total in sums:
        assert np.array_equal(np.tril(total), np.tril(expected))


@pytest.mark.parametrize("pivots", [(3, 2), (3, 0), (0, 2), (5, 0), (0, 0)])
@pytest.mark.parametrize("at_once", (1, 2, 9))
def test_elimination_leaves_the_schur_complement(monkeypatch, pivots, at_once):
    """Of positive pivots, then of negative ones, so many at once; of all matrices the lower
    triangle counts.
    """
    monkeypatch.setattr(dense_front, "AT_ONCE", at_once)
    m, whole = sum(pivots), spd(9)
    whole[pivots[0] : m] *= -1.0
    whole[:, pivots[0] : m] = whole[pivots[0] : m].T
    lower = np.tril(whole)
    parts, left = dense_front.eliminated(lower[:, :m], lower[m:, m:].copy(), np.array(pivots))
    L, below, end, sign = np.zeros((m, m)), np.empty((0, 9 - m)), 0, np.repeat([1.0, -1.0], pivots)
    for part in parts:
        assert 0 < len(part) <= at_once and (sign[end : end + len(part)] == part.sign).all()
        first, end = end, end + len(part)
        L[first:end, first:end][np.tril_indices(len(part))] = part.pivots  # row after row
        L[end:, first:end] = part.sign * part.rest[:, : m - end].T
        below = np.vstack([below, part.rest[:, m - end :]])
    assert end == m
    np.testing.assert_allclose(L * sign @ L.T, whole[:m, :m], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(L @ below, whole[:m, m:], rtol=1e-11, atol=1e-11)
    schur = whole[m:, m:] - whole[m:, :m] @ np.linalg.solve(whole[:m, :m], whole[:m, m:])
    np.testing.assert_allclose(np.tril(left), np.tril(schur), rtol=1e-10, atol=1e-10)
    parts, left = dense_front.eliminated(np.tril(whole[:m, :m]), np.empty((0, 0)), np.array(pivots))
    assert left.shape == (0, 0) and [part.rest.shape[1] for part in parts][-1:] == [0] * (m > 0)


def test_the_price_is_of_fronts_over_that_of_a_product(built):
    """Cubes of fronts and a share for each, over squares of local matrices, twice as the
    preconditioner has some of that size, and a share for all.
    """
    problem = built("model", subdomains="4x2", cells=4)
    elimination, classes = GluingElimination(problem.operator), problem.operator.classes
    work = sum(len(c.members) * (len(c.F) + len(c.S)) ** 2 / (fronts.SHARED if c.shared else 1)
               for c in classes)
    product = 2 * work + fronts.EACH_PRODUCT
    sizes, one = [], fronts.eliminated
    try:
        fronts.eliminated = lambda columns, rest, pivots: sizes.append(
            (pivots.sum(), len(columns))) or one(columns, rest, pivots)
        elimination.compliance()
    finally:
        fronts.eliminated = one
    made = elimination._tree.fronts
    assert sum(m for m, _ in sizes) == sum(front.pivots for front in made)
    operations = sum(front.pivots * front.size**2 / 2 for front in made)
    assert elimination.price == pytest.approx(
        (operations / fronts.SPEED + fronts.EACH_FRONT * len(made)) / product, rel=1e-12)
    assert elimination.products(1e8) == pytest.approx(1e8 / fronts.SPEED / product, rel=1e-12)


def test_elimination_fits_beside_what_is_there_or_takes_little(built, monkeypatch):
    """Factors of fronts against a share for every dof, a larger one where subdomains have factors
    of their own; small ones fit anyway.
    """
    subdomains, cells = 6, 4
    for shared, structured in ((True, f"{subdomains}x1"), (False, str(subdomains))):
        problem = built("model", subdomains=structured, cells=cells)
        elimination = GluingElimination(problem.operator)
        own = [len(c.members) * (not c.shared) for c in problem.operator.classes]
        assert (sum(own) == subdomains) == (not shared)
        elimination.compliance()
        kept = sum(part.pivots.size + part.rest.size for factors in elimination._factors.values()
                   for part in factors.parts)
        assert kept <= elimination._tree.entries  # contact rows and one triangle are left out
        dofs = sum(sub.dofs for sub in problem.structure.subdomains)
        enough = 1.01 * elimination._tree.entries / dofs
        for little, a_dof, factorized, fits in ((1e9, 0, 0, True), (0, 0, 0, False),
                                                (0, enough, 0, True), (0, 0, enough, not shared)):
            for name, value in (("LITTLE", little), ("A_DOF", a_dof), ("FACTORIZED", factorized)):
                monkeypatch.setattr(fronts, name, value)
            assert GluingElimination(problem.operator).fits is fits, (shared, little, a_dof)


HALF_DISC = """include "scene.idp"
border c0(t=pi, 2*pi) { x = 20*cos(t); y = 20*sin(t); label = 1; }
border c1(t=0, 1) { x = 20 - 40*t; y = 0; label = 2; }
body = buildmesh(c0(24) + c1(12));
macro young() 210e3 //
macro poisson() 0.3 //
macro load1() traction(2, 0., -1.) //
macro contact() 1 //
macro friction() 0.4 //
include "export.idp"
"""


@pytest.mark.parametrize("scene, options, motions", [
    ("joint", {"h": 1.6, "subdomains": 5}, 2), ("stack", {"subdomains": 7}, 9),
    ("half-disc", {"subdomains": 1}, 3),  # of two corners, along whose line nothing is stiff
    ("joint", {"h": 1.6, "subdomains": 6, "element": "P2"}, 2)])
@pytest.mark.parametrize("large", [coarse.LARGE, 0])
@pytest.mark.some(2)
def test_bodies_on_springs_are_pinned_first(built, named_scene, monkeypatch, scene, options,
                                            motions, large):
    """C of bodies without support is that of one sparse factorization of the bodies on springs,
    whoever solves the coarse problem; and it costs no products.
    """
    monkeypatch.setattr(coarse, "LARGE", large)
    scene = named_scene(scene, HALF_DISC) if scene == "half-disc" else scene
    operator = DualOperator(built(scene, **options).structure, MPI.COMM_SELF)
    assert operator.modes == motions
    whole, before = ContactCompliance(operator).C, operator.products
    found = GluingElimination(operator).compliance()
    np.testing.assert_allclose(found, whole, rtol=0, atol=1e-10 * np.abs(whole).max())
    assert operator.products == before


def test_movements_have_the_same_bits_wherever_numbers_lie(built):
    """Columns of a matrix lie apart: products with them may round by how many there are."""
    operator = built("model", subdomains="12x6", cells=1, element="P2").operator
    corners = np.random.default_rng(1).standard_normal((len(operator.coarse.numbers), 3))
    for column in corners.T:
        assert np.array_equal(operator.movements(column), operator.movements(column.copy()))


# ------------------------------------------------------------------------------ compliances

def test_a_face_is_inverted_and_nothing_else():
    """Kept as long as it stays, made anew with what rows yield; none has nothing to invert."""
    C, residual = spd(6), np.arange(6.0) - 2
    inverse = FaceInverse(C)
    for free in (np.array([1, 0, 1, 1, 0, 1], bool), np.array([1, 1, 0, 0, 0, 0], bool)):
        for soft in (np.zeros(6), np.arange(6.0)):
            inverse.soften(soft)
            for _ in range(2):
                z = inverse(residual, free)
                assert not z[~free].any()
                whole = (C + np.diag(soft))[np.ix_(free, free)]
                np.testing.assert_allclose(whole @ z[free], residual[free], atol=1e-10)
    assert not inverse(residual, np.zeros(6, bool)).any()
    factor = inverse.factor
    inverse(residual, np.array([1, 1, 0, 0, 0, 0], bool))
    assert inverse.factor is factor


def test_the_compliance_is_a_dual_problem():
    """Products, loads, norms and what moves under them, of its own small matrices."""
    one, rng = object.__new__(ContactCompliance), np.random.default_rng(3)
    one.C, one.d, one.softness, one.products = spd(4), rng.standard_normal((2, 4)), None, 0
    one._loaded, one._moved = rng.standard_normal((2, 3)), rng.standard_normal((3, 4))
    one._exponents = np.array([0, 2])
    x, weights = rng.standard_normal(4), np.array([2.0, -1.0])
    np.testing.assert_allclose(one.apply(x), one.C @ x)
    one.softness = np.arange(4.0)
    np.testing.assert_allclose(one.apply(x), one.C @ x + np.arange(4) * x)
    assert one.products == 2 and one.dot(x, 2 * x) == pytest.approx(2 * x @ x)
    np.testing.assert_allclose(one.elastic_response(weights), 2 * one.d[0] - one.d[1])
    corner = np.abs(2 * one._loaded[0] - one._loaded[1] + one._moved @ x).max()
    node = np.abs(one.C @ x).max()
    assert one.deformation(x, weights) == pytest.approx(max(corner, node))
    assert one.deformation(1e-9 * x, weights) == pytest.approx(
        np.abs(2 * one._loaded[0] - one._loaded[1]).max())
    np.testing.assert_allclose(one.deformation_by_level(x, weights),
                               one.deformation(x, weights) * np.array([1.0, 0.1]))
    scale = np.arange(1.0, 5)
    assert one.norm_bound(scale) == pytest.approx(np.linalg.norm(one.C * np.outer(scale, scale)))
    assert one.norm_bound(scale) >= np.linalg.norm(one.C * np.outer(scale, scale), 2)
    one.C = np.zeros((0, 0))
    assert one.norm_bound(np.zeros(0)) == 1.0
    assert isinstance(one.preconditioner(), FaceInverse)


def test_products_and_solutions_by_an_upper_triangle():
    K = spd(5)
    upper = csr_matrix(triu(K))
    x = np.random.default_rng(4).standard_normal((5, 2))
    np.testing.assert_allclose(_multiply(upper, x[:, 0]), K @ x[:, 0], rtol=1e-12)
    np.testing.assert_allclose(_Factor(upper).solve(K @ x), x, atol=1e-10)
    none = _Factor(csr_matrix((0, 0)))
    assert none.solve(np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("off, refined", [(1e-15, 0), (1e-6, 1), (1e-3, None), (np.nan, None)])
def test_an_elimination_is_refined_before_it_fails(monkeypatch, off, refined):
    """A factor that is `off` leaves the square of it after one refinement, or that is no solution.
    """
    K, calls = spd(5), []
    factor = _Factor(csr_matrix(triu(K)))

    def inexact(_, right):
        calls.append(right)
        return np.linalg.solve(K, right) * (1 + off)

    monkeypatch.setattr(compliance, "solve_columns", inexact)
    x = np.random.default_rng(4).standard_normal((5, 2))
    if refined is None:
        with pytest.raises(NotConverged, match="could not be eliminated"):
            factor.solve(K @ x)
        return
    np.testing.assert_allclose(factor.solve(K @ x), x, rtol=1e-10)
    assert len(calls) == 1 + refined


# ------------------------------------------------------------------------------ contact blocks

def test_a_rank_has_its_contact_rows_in_its_own_part():
    """Rows 4 to 9 are its own, of which 4, 6 and 9 belong to contact."""
    table = ContactTable(np.array([1, 4, 6, 9, 11]), *np.zeros((3, 5)))
    structure = SimpleNamespace(row_range=(4, 10), at_contact=table, subdomains=[], touching=[])
    structure.own_rows = Substructure.own_rows.fget(structure)
    assert structure.own_rows == slice(1, 4)
    operator = SimpleNamespace(structure=structure, comm=MPI.COMM_SELF, classes=[],
                               coarse=SimpleNamespace(inverse=lambda corners: np.zeros((0, 0))))
    block = ContactBlock(operator, SimpleNamespace(schur=[]))
    x = np.arange(10.0, 16.0)
    assert block.gather(x).tolist() == [10, 12, 15] and block.size == 5
    placed = block.scatter(-np.arange(5.0), x)
    assert placed.tolist() == [-1, 11, -2, 13, 14, -3] and x[0] == 10
    assert not block.apply(np.ones(5)).any()
    block.softness = np.arange(5.0)
    assert block.apply(2 * np.ones(5)).tolist() == [0, 2, 4, 6, 8]
