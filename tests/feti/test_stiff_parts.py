"""What stiff parts deform by: levels of rows, parts across cuts, and what runs earn by it."""

import numpy as np
import pytest

from driver.feti.stiff_parts import stressed_alike

# two stiff columns on soft ground, with soft material between them
COLUMNS = """include "scene.idp"
units("mm", "MPa");
subdomains("1");
rectangle(0., 2., 0., 2.);
macro young() (y < 0.5 || (x > 0.5 && x < 1.5) ? 20. : 2e7) //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0.4, -0.2) //
macro contact() 2 //
macro friction() 0.3 //
include "export.idp"
"""

# nine nodes of a stiff, heated block on three edges of a soft one: stiffness alone tells them apart
CROWDED = """include "scene.idp"
units("1", "1");
subdomains("4");
int[int] below = [1, 11, 21, 31];
mesh Th0 = square(9, 6, [1.219*x^4, 0.6555*y], label = below);
int[int] above = [101, 111, 121, 131];
mesh Th1 = square(8, 5, [0.2633 + 0.8254*x, 0.6555 + 0.5609*y], label = above);
Th1 = change(Th1, fregion = 1);
addBody(Th0)
addBody(Th1)
macro young() (region == 1 ? 1e6 : 1.) //
macro poisson() 0.3 //
macro support() on(1, u2 = 0.) //
macro load1() traction(121, 0., -0.0003) //
macro thermal2() -0.001 //
macro contactPair() 101, 21 //
include "export.idp"
"""

# a block on the floor, beside one a million times as stiff: what either rests on, and the friction
# between both, hand on forces that the stiff one alone feels
SIDE_BY_SIDE = """include "scene.idp"
units("um", "MPa");
subdomains("4");
int[int] soft = [1, 11, 21, 31];
mesh Th0 = square(2, 3, [608.7*x, 985.5*y], label = soft);
int[int] stiff = [101, 111, 121, 131];
mesh Th1 = square(4, 3, [608.7 + 1052.*x, 933.663*y], label = stiff);
Th1 = change(Th1, fregion = 1);
addBody(Th0)
addBody(Th1)
macro young() (region == 1 ? 3e9 : 3e3) //
macro poisson() 0.2 //
macro support() on(111, u1 = 0., u2 = 0.) //
macro load1() traction(31, 12., -9.) //
macro bodyForce2() [0.0012, -0.0009] //
macro contact() 1, 101 //
macro contactPair() 11, 131 //
macro friction() (label == 11 ? 0.03 : 0.06) //
include "export.idp"
"""


def moved(problem, factor: float) -> list[np.ndarray]:
    """Fields (dofs,) that shift and turn the body, and let its right column swell by 1e-6."""
    fields = []
    for sub in problem.structure.subdomains:
        x, y = sub.xy.T
        right = 1e-6 * (x > 1.4)
        u = np.column_stack([0.3 - 0.2 * y + (x - 1.75) * right,
                             0.1 + 0.2 * x + (y - 1.25) * right])
        fields.append(factor * u.ravel())
    return fields


@pytest.mark.parametrize("cut", ["1x1", "4x4", "4"])
def test_stiff_parts_deform_without_their_motion(built, named_scene, cut):
    """Half of the column's diagonal times 1e-6, to what 1e-16 of the motion is beside that."""
    problem = built(scene=named_scene("columns", COLUMNS), cells=4, subdomains=cut)
    parts = problem.operator.stiff_parts
    diagonal = np.hypot(0.25, 0.75)
    assert (parts.exponents[0], parts.exponents[-1]) == (0, 6)
    for factor in (1.0, 1e-9):
        own = parts.deformations(moved(problem, factor), 1e-7 * factor)
        assert own[[0, -1]] == pytest.approx([1e-7 * factor, 1e-6 * diagonal * factor],
                                             rel=1e-8)


def test_rows_have_the_level_of_what_they_touch(built, named_scene):
    """Contact of the column, whose foot ends at the ground, against that of the ground."""
    problem = built(scene=named_scene("columns", COLUMNS), cells=4, subdomains="4x4")
    contact, level = problem.structure.contact, problem.operator.stiff_parts.level
    acts = contact.normal_row >= 0
    high = contact.xy[acts, 1] > 0.5 - 1e-9
    assert high.any() and not high.all()
    assert ((level[contact.normal_row[acts]] > 0) == high).all()


def test_alike_stiffness_has_one_level(built):
    operator = built("model", cells=4, subdomains="4x2").operator
    assert operator.levels == 1 and not operator.row_level.any()


def test_stress_of_soft_material_counts_for_stiff_material():
    """A stiff part at rest beside one that deforms by 1: a millionth of it; its own 1e-3 is more.
    """
    exponents = np.array([0, 3, 6])
    assert stressed_alike(np.array([1.0, 0.0, 0.0]), exponents) == pytest.approx([1, 1e-3, 1e-6])
    assert stressed_alike(np.array([1.0, 1e-2, 1e-3]), exponents) == pytest.approx([1, 1e-2, 1e-3])


def test_rows_that_hand_on_forces_have_the_level_of_the_stiffest_body(built, named_scene):
    """Of the soft block the vertex on floor and stiff block, and nodes that meet a vertex there."""
    problem = built(scene=named_scene("sides", SIDE_BY_SIDE), subdomains="3")
    contact, level = problem.structure.contact, problem.operator.stiff_parts.level
    soft = contact.xy[:, 0] < 608.7 + 1e-9
    corner = soft & (contact.xy[:, 0] > 608.6) & (contact.xy[:, 1] < 1e-9)
    apart = soft & (contact.label == 1) & ~corner
    assert corner.sum() >= 2 and apart.any()
    assert (level[contact.normal_row[corner & (contact.normal_row >= 0)]] == 1).all()
    assert (level[contact.normal_row[apart]] == 0).all()


@pytest.mark.slow
def test_cuts_agree_on_forces_that_a_stiff_block_hands_on(solved, named_scene):
    """Those of the vertex differed by a percent: a millionth of the soft block's displacements is
    what its forces deform the stiff one by. A node's error ten times residuals of 1e-6, of two.
    """
    path, words = named_scene("sides", SIDE_BY_SIDE), {"rtol": 1e-10, "friction_rtol": 1e-8}
    forces = []
    for cut in ("1", "7", "12"):
        run = solved(scene=path, subdomains=cut, **words)
        assert run.status == 0
        order = np.lexsort([run.contact[name][-1] for name in ("normal_x", "y", "x")])
        weight = run.contact["weight"][-1][order]
        forces.append(np.stack([run.contact[name][-1][order] * weight
                                for name in ("sigma_n", "sigma_t")]))
    for other in forces[1:]:
        assert np.abs(forces[0] - other).max() <= 2e-5 * np.abs(forces[0]).max()


def test_cuts_agree_on_forces_that_stiffness_alone_shares(solved, named_scene):
    """Ways of 1e-12 of the deformation decide. Residuals of 1e-6, a node's error ten times that,
    of two runs.
    """
    path, words = named_scene("crowded", CROWDED), {"rtol": 1e-10, "friction_rtol": 1e-8}
    forces = []
    for cut in ("1", "5"):
        run = solved(scene=path, subdomains=cut, **words)
        assert run.status == 0
        order = np.argsort(run.contact["x"][-1])
        forces.append(run.contact["sigma_n"][-1][order])
    assert np.abs(forces[0] - forces[1]).max() <= 2e-5 * np.abs(forces[0]).max()


def test_a_state_without_forces_leaves_no_scale(built, steps_of, named_scene):
    """Tried where forces fade, and none: residuals stay relative to what the body deforms by."""
    problem = built(scene=named_scene("columns", COLUMNS), cells=4, subdomains="1x1")
    solver, _ = steps_of(problem)
    x, load = solver.multipliers, solver.load(1, solver.motion, np.zeros(len(solver.multipliers)))
    solver.residuals.of(load, x, problem.operator.apply(x) - load.d)
    known = solver.scales.displacements.copy(), solver.scales.force
    assert x.any() and solver.residuals.free_of_forces(load, x) is None
    assert (solver.scales.displacements == known[0]).all() and solver.scales.force == known[1]


@pytest.mark.parametrize("element, cut", [("P1", "3"), ("P2", "1x1"), ("P2", "3")])
def test_bodies_deform_by_what_their_vertices_do(built, named_scene, element, cut):
    """Least squares by the corners of all triangles as the judge of random scenes has them.

    Middles of quadratic sides that move a hundred times as far, each by the force on it alone, are
    no scale. A mean over vertices is no more than that, one over middles would be.
    """
    problem = built(scene=named_scene("columns", COLUMNS), element=element, subdomains=cut, cells=4)
    structure, parts = problem.structure, problem.operator.rigid_parts
    fields, places, moved, weights = [], [], [], []
    for sub in structure.subdomains:
        x, y = sub.xy.T
        u = np.column_stack([3 - 0.7 * y + np.sin(x), 2 + 0.7 * x + x * y])
        at, vertex = sub.xy[sub.triangles], np.unique(sub.triangles)
        one, other = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
        area = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / 2
        places.append(at.reshape(-1, 2))
        moved.append(u[sub.triangles].reshape(-1, 2))
        weights.append(np.repeat(area, 3))
        u[np.setdiff1d(np.arange(len(u)), vertex)] += 100.0
        fields.append(u.ravel())
    (x, y), u = np.concatenate(places).T, np.concatenate(moved)
    one, none = np.ones(len(x)), np.zeros(len(x))
    rigid = np.stack([[one, none, -y], [none, one, x]]).transpose(2, 0, 1).reshape(-1, 3)
    root = np.repeat(np.sqrt(np.concatenate(weights)), 2)
    factors = np.linalg.lstsq(root[:, None] * rigid, root * u.ravel(), rcond=None)[0]
    expected = np.linalg.norm(u - (rigid @ factors).reshape(-1, 2), axis=1).max()
    assert parts.deformation(fields) == pytest.approx(expected, rel=1e-12)
    corners = [fields[s][structure.corner_dofs[s]] for c in problem.operator.classes
               for s in c.members]
    assert problem.operator._least(np.concatenate(corners)) <= expected
