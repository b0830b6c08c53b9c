"""Bodies that hold their nodes unevenly: thin triangles, stiffness that jumps or has a direction.

The condition number of the preconditioned operator, computed densely, stays that of an even body.
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from small_scenes import LEFT, TOP, Body, Scene, grown, rectangle
from test_cuts import torn
from test_deflation import condition, dense, spread

from driver.feti import row_stiffness
from driver.feti.coarse import CoarseProblem
from driver.feti.contact_block import ContactBlock, Galerkin
from driver.feti.deflation import DeflatedPreconditioner, Deflation
from driver.feti.row_stiffness import left_alone
from driver.feti.rows import RowKind
from driver.feti.skeleton import JUMP, THIN, Outline, Skeleton, _shear_ratio

NX, NY = 14, 10
# Triangles just below THIN raise the condition number as THIN^2, jumps just below JUMP as JUMP do
# where the other half of a pair is rigid: both about 10. Measured: up to 5 times an even body's.
TIMES = 10.0


def progression(n: int, ratio: float) -> np.ndarray:
    """(n + 1,) places in [0, 1], the last interval `ratio` times as long as the first."""
    steps = ratio ** (np.arange(n) / (n - 1))
    return np.append(0.0, np.cumsum(steps)) / steps.sum()


def even():
    """Vertices, stiffness of the triangles."""
    return rectangle(NX, NY)[0], np.ones(2 * NX * NY)


def graded(ratio: float, both: bool):
    """Columns, and perhaps rows, whose widths grow."""
    xy, young = even()
    xy[:, 0] = np.interp(xy[:, 0], np.linspace(0, 2, NX + 1), 2 * progression(NX, ratio))
    if both:
        xy[:, 1] = np.interp(xy[:, 1], np.linspace(0, 1, NY + 1), progression(NY, ratio))
    return xy, young


def thin(aspect: float):
    """All triangles so many times as high as wide, or as wide as high."""
    xy, young = even()
    return xy * [1.0, aspect], young


def striped(jump: float):
    """Slanted layers thinner than triangles, which each have the stiffness of their middles."""
    xy, young = even()
    x, y = xy[rectangle(NX, NY)[1]].mean(axis=1).T
    young[np.abs(np.sin(10 * (y + 0.37 * x))) < 0.3] = jump
    return xy, young


def speckled(jump: float):
    """Triangles that are stiff or compliant at random."""
    xy, young = even()
    young[np.random.default_rng(5).random(len(young)) < 0.3] = jump
    return xy, young


def scene(made, parts: int, poisson: float = 0.3) -> Scene:
    """The body in pieces that have grown at random, pressed down with friction."""
    xy, young = made
    _, triangles, outline = rectangle(NX, NY)
    part = grown(triangles, parts, np.random.default_rng(parts))
    return Scene(Body(xy, triangles, outline, part, young, poisson), [{TOP: (0.0, -1.0)}],
                 np.array([[0.0], [1.0]]), support=LEFT)


def conditions(given: Scene) -> dict[str, float]:
    """Condition number on the faces without contact, without friction, and on all rows."""
    problem = torn(given)
    local = problem.operator.preconditioner()
    block = ContactBlock(problem.operator, local)
    preconditioner = DeflatedPreconditioner(local, Deflation(block, problem.structure))
    kind, F = problem.structure.row_kind, problem.F
    faces = {"gluing": kind == RowKind.GLUING, "frictionless": kind <= RowKind.NORMAL,
             "all": kind >= 0}
    return {name: condition(dense(preconditioner, free), F[np.ix_(free, free)])
            for name, free in faces.items() if free.any()}


HARD = {"columns 1:1e4": lambda: graded(1e4, False), "both 1:1e4": lambda: graded(1e4, True),
        "high": lambda: thin(100.0), "flat": lambda: thin(0.01),
        "layers 1e6": lambda: striped(1e6), "layers 1e-6": lambda: striped(1e-6),
        "speckles 1e6": lambda: speckled(1e6)}


@pytest.mark.parametrize("parts", [3, 7])
@pytest.mark.parametrize("body", HARD)
@pytest.mark.some(5)
def test_condition_does_not_depend_on_grading_and_jumps(body, parts):
    easy, hard = conditions(scene(even(), parts)), conditions(scene(HARD[body](), parts))
    for face, value in hard.items():
        assert value < TIMES * easy[face], (face, hard, easy)


RUBBER = """include "scene.idp"
real nu = physical("nu", 0.3);
units("1", "1");
subdomains("7");
body = square(16, 8, [2*x, y]);
macro young() 1. //
macro poisson() nu //
macro load1() traction(3, 0.005, -0.1) //
macro contact() 1, 2 //
macro gap() (label == 2 ? 0.02 : 0.) //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.slow
def test_incompressible_bodies_take_no_more_products(solved, named_scene):
    """A rubber block on a floor that swells against a wall; without corners all along its
    interfaces it took ten times as many.
    """
    rubber = named_scene("rubber", RUBBER)
    easy, hard = (solved(rubber, element="P2-mixed", nu=nu) for nu in (0.3, 0.4999))
    assert easy.status == hard.status == 0
    counts = [run.summary["counts"]["dual_multiplications"] for run in (easy, hard)]
    assert counts[1] <= 1.2 * counts[0], counts


@pytest.mark.slow
def test_contact_nodes_on_a_stiff_fine_body_take_hardly_more_products(solved):
    """A thousand times as stiff as the coarser one that it stands on: forces that alternate move
    its nodes alone. Without hats of their own there they took 2.6 times as many products.
    """
    easy, hard = (solved("hard/pair", steps=4, jump=jump, subdomains="2x2", h=0.25, rtol=1e-10,
                         friction_rtol=1e-8) for jump in (1, 1e3))
    assert easy.status == hard.status == 0
    counts = [run.summary["counts"]["dual_multiplications"] for run in (easy, hard)]
    assert counts[1] <= 1.8 * counts[0], counts


def test_which_contact_nodes_are_left_alone(monkeypatch):
    """Those that count by far more than what they are scaled by; few of them."""
    share, counted = np.array([1.0, 0.01, 0.01, 0.2, 2e-6]), np.array([1.0, 0.01, 1.0, 1.0, 1.0])
    assert left_alone(share, counted).tolist() == [2, 4]
    monkeypatch.setattr(row_stiffness, "MOST_ALONE", 1)
    assert not len(left_alone(share, counted))


def test_where_whole_interfaces_are_corners_the_contact_block_is_one_matrix():
    """More corners than contact rows: F_cc and W'F_cc W as before, of the dense operator."""
    problem = torn(scene(even(), 5, 0.4999))
    block = ContactBlock(problem.operator, problem.operator.preconditioner())
    assert not len(block.G) and problem.operator.structure.coarse_dofs > block.size
    F = problem.F[np.ix_(block.rows, block.rows)]
    found = np.array([block.apply(e) for e in np.eye(block.size)])
    assert np.abs(found - F).max() <= 1e-9 * np.abs(F).max()
    rng = np.random.default_rng(2)
    columns, entries = rng.integers(0, 4, (block.size, 2)), rng.standard_normal((block.size, 2))
    W = spread(columns, entries, 4)
    wanted = W.T @ F @ W
    assert np.abs(Galerkin(block, columns, 4)(entries) - wanted).max() <= 1e-9 * np.abs(
        wanted).max()


def skeleton_of(given: Scene) -> Skeleton:
    return Skeleton(given.manifest(), given.subdomains(), MPI.COMM_SELF)


def test_even_bodies_have_no_uneven_nodes():
    """Up to the limits: neither a jump below JUMP nor triangles up to THIN ask for corners."""
    for made in (even(), thin(0.4), striped(0.9 * JUMP)):
        assert not skeleton_of(scene(made, 5)).uneven.any()
    assert not skeleton_of(scene(even(), 5, 0.495)).bulky.any()  # BULK is 100
    assert skeleton_of(scene(even(), 5, 0.496)).bulky.all()
    # right triangles of legs 1 and a have a + 1/a; a cell is 2/NX wide, 1/NY high
    aspect = 4.3 * NY / NX * 2
    assert 4.3 + 1 / 4.3 > THIN
    assert skeleton_of(scene(thin(aspect), 5)).uneven.all()


def test_a_jump_between_subdomains_is_not_uneven():
    """The preconditioner weighs the two sides of an interface; only jumps within one count."""
    given = scene(even(), 5)
    stiff = given.body.part % 2 == 1
    jumps = dataclasses.replace(given.body, young=np.where(stiff, 1e6, 1.0))
    assert not skeleton_of(dataclasses.replace(given, body=jumps)).uneven.any()


def test_directions_and_variation_within_triangles_are_uneven():
    """A tenth of the shear modulus of one kind is even, less is not; so are the triangles' corners.
    """
    sub = scene(even(), 5).subdomains()[0]
    corners = np.repeat(sub.elasticity[:, None], 3, axis=1)
    for modulus, wanted in ((1.01 / JUMP, False), (0.99 / JUMP, True)):
        directed = sub.elasticity * np.array([[1, 1, 1], [1, 1, 1], [1, 1, modulus]])
        assert set(Outline(sub).uneven(dataclasses.replace(sub, elasticity=directed))) == {wanted}
        varying = corners * np.array([1.0, 1.0, modulus])[:, None, None]
        varying = dataclasses.replace(sub, corner_elasticity=varying)
        assert set(Outline(sub).uneven(varying)) == {wanted}


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2])
def test_shear_ratio(angle):
    """The ratio of the moduli for shear, however the axes lie; 1 for isotropic laws."""
    c, s = np.cos(angle), np.sin(angle)
    # of strains (e11, e22, 2 e12) in axes turned by the angle
    T = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s,
                                                                  c * c - s * s]])
    isotropic = 7 * np.array([[1, 1, 0], [1, 1, 0], [0, 0, 0]]) + np.diag([2.0, 2, 1])
    soft = isotropic - np.diag([0.0, 0, 0.99])
    ratios = _shear_ratio(np.array([T.T @ law @ T for law in (isotropic, soft)]))
    np.testing.assert_allclose(ratios, [1, 100], rtol=1e-12)


@pytest.mark.parametrize("follows", [False, True])
def test_the_coarse_problem_is_solved_once_a_contact_row_where_corners_are_more(monkeypatch,
                                                                               follows):
    """Once a corner dof, and not again, where the contact rows are renewed again and again."""
    problem, counted = torn(scene(even(), 5, 0.4999)), []
    one = CoarseProblem._on_springs
    monkeypatch.setattr(CoarseProblem, "_on_springs",
                        lambda self, forces: counted.append(1) or one(self, forces))
    operator, structure = problem.operator, problem.operator.structure
    preconditioner = operator.preconditioner()
    if follows:
        structure.numbering = SimpleNamespace(glued={})
    corners = np.unique(np.concatenate([structure.corner_global[s] for s in structure.touching]))
    block = ContactBlock(operator, preconditioner)
    assert len(corners) > block.size
    assert len(counted) == (len(corners) if follows else block.size)
    again = ContactBlock(operator, preconditioner)
    assert len(counted) == (len(corners) if follows else 2 * block.size)
    np.testing.assert_array_equal(again.local, block.local)
    # once known, the columns are taken: the same matrix, but for rounding
    operator.coarse.inverse(corners)
    known = ContactBlock(operator, preconditioner)
    assert np.abs(known.local - block.local).max() <= 1e-12 * np.abs(block.local).max()
