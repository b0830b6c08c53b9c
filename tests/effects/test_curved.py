"""Curved sides of quadratic elements: patches, closed forms, orders, and what is refused."""

import re

import numpy as np
import pytest
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import spsolve

import driver
from conftest import read_problem
from driver.effects import initial_state
from driver.errors import InputError
from driver.files import read_table
from driver.scene import elements, freefem, sides
from driver.studies.study import make_study

TIGHT = {"rtol": 1e-12, "friction_rtol": 1e-11}
SLOW = pytest.mark.slow
QUADRATIC = ("P2", pytest.param("P2-mixed", marks=SLOW))
E, NU = 1000.0, 0.3
MATERIAL = """
macro young() 1000. //
macro poisson() 0.3 //
"""
# a quarter of a ring, 1 < r < 2, in triangles that no line of symmetry orders; labels 1 outside,
# 2 on the y axis, 3 inside, 4 on the x axis
RING = """include "scene.idp"
real a = 1., b = 2., p = 3., h = meshSize(0.4), k = physical("k", 0.);
border c1(t=0,pi/2){x=b*cos(t);y=b*sin(t);label=1;}
border c2(t=0,1){x=0;y=b+(a-b)*t;label=2;}
border c3(t=0,pi/2){x=a*sin(t);y=a*cos(t);label=3;}
border c4(t=0,1){x=a+(b-a)*t;y=0;label=4;}
int n = ceil(1./h);
body = buildmesh(c1(3*n) + c2(n) + c3(2*n) + c4(n));
macro curved() 1, 3 //
""" + MATERIAL
LAME = RING + """
macro support() on(2, u1 = 0.) + on(4, u2 = 0.) //
macro load1() pressure(3, p) //
include "export.idp"
"""
# a plate with a hole, an ellipse that no axis of the plate goes through; one straight side
PLATE = """include "scene.idp"
subdomains("7");
border b1(t=0,1){x=4*t;y=0;label=1;}
border b2(t=0,1){x=4+0.6*sin(pi*t);y=3*t;label=22;}
border b3(t=0,1){x=4*(1-t);y=3;label=3;}
border b4(t=0,1){x=0;y=3*(1-t);label=4;}
border hole(t=0,2*pi){x=1.7+0.9*cos(t)-0.2*sin(t);y=1.4+0.3*cos(t)+0.7*sin(t);label=9;}
int n = whole("cells", 4, 1);
body = buildmesh(b1(n) + b2(n + 1) + b3(n) + b4(n) + hole(-2*n - 3));
macro curved() 22, 9 //
""" + MATERIAL


def lame(inner=3.0, k=0.0, a=1.0, b=2.0) -> tuple[float, float]:
    """A, B of u_r = A r + B/r under `inner` pressure and springs k outside (Timoshenko, 28)."""
    lam, mu = E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)
    radial = np.array([[2 * (lam + mu), -2 * mu / r**2] for r in (a, b)])
    radial[1] += k * np.array([b, 1 / b])
    return tuple(np.linalg.solve(radial, [-inner, 0.0]))


def elastic(problem) -> np.ndarray:
    """Displacements (dofs,) of the one subdomain of an export without contact."""
    sub, = problem.subdomains
    K, u = csc_matrix(sub.stiffness.toarray()), np.zeros(sub.dofs)
    free = np.setdiff1d(np.arange(sub.dofs), sub.fixed)
    u[free] = spsolve(K[free][:, free], sub.loads.sum(axis=0)[free])
    return u


def error(sub, u: np.ndarray, exact) -> float:
    """Relative error in L2 of displacements u (dofs,) from exact(places (..., 2))."""
    at, weights = elements.POINTS, elements.WEIGHTS
    place = elements.shapes(6, at) @ sub.xy[sub.elements[:, :6]]
    computed = elements.shapes(sub.elements.shape[1], at) @ u.reshape(-1, 2)[sub.elements]
    size = elements.jacobians(sub.corner, at) * weights
    squares = [(size * (of**2).sum(axis=-1)).sum() for of in (computed - exact(place),
                                                              exact(place))]
    return float(np.sqrt(squares[0] / squares[1]))


@pytest.fixture(scope="module")
def rings(exported, named_scene):
    """rings(element, h): the Problem of a ring under inner pressure, on one subdomain."""
    def get(element: str, h: float):
        path = named_scene("lame", LAME)
        return read_problem(exported(path, element=element, h=h, subdomains=1), reduce=False)
    return get


# ------------------------------------------------------------------------------ geometry

@pytest.mark.parametrize("element", QUADRATIC)
def test_rings_converge_in_third_order(rings, element):
    """Order 4 of area and energy, 3 of displacements in L2; straight sides have order 2 of all."""
    A, B = lame()
    found = []
    for h in (0.2, 0.1):
        problem = rings(element, h)
        sub, u = problem.subdomains[0], elastic(problem)
        found.append([abs(elements.areas(sub.corner).sum() / (0.75 * np.pi) - 1),
                      abs(u @ (sub.stiffness @ u) / (3 * np.pi / 2 * (A + B)) - 1),
                      error(sub, u, lambda x: x * (A + B / (x**2).sum(axis=-1, keepdims=True)))])
    order = np.log2(np.array(found[0]) / found[1])
    # not yet asymptotic on five to ten sides a radius: half an order is left
    assert (order > [3.5, 3.5, 2.5]).all(), order
    assert (np.array(found[1]) < [1e-8, 5e-6, 3e-5]).all()


@pytest.mark.parametrize("element", QUADRATIC)
def test_rigid_motions_cost_nothing(rings, element):
    sub = rings(element, 0.2).subdomains[0]
    assert sub.curved
    x, y = sub.xy.T
    for motion in ((1 + 0 * x, 0 * x), (0 * x, 1 + 0 * x), (-y, x)):
        force = sub.stiffness @ np.column_stack(motion).ravel()
        assert np.abs(force).max() < 1e-10 * np.abs(sub.stiffness.values).max()


def test_middles_are_on_circles(rings):
    """Circles through three points are the circle, at any spacing, as near as the vertices are."""
    sub = rings("P2", 0.2).subdomains[0]
    for label, radius in ((1, 2.0), (3, 1.0)):
        edges = sub.edges[sub.edge_label == label]
        off = [np.abs(np.hypot(*sub.xy[nodes].T) - radius).max()
               for nodes in (sub.middles(edges), edges)]
        assert off[0] < 10 * off[1] + 1e-13 and off[1] < 1e-6
    straight = sub.middles(sub.edges[sub.edge_label == 4])
    assert np.abs(sub.xy[straight, 1]).max() < 1e-13


def test_a_long_side_among_short_ones_is_no_corner(exported, named_scene):
    """Eight times as long as its neighbours on one circle: its middle is on it all the same."""
    path = named_scene("uneven", """include "scene.idp"
func real angle(real t) { return 0.5*t + (t > 0.55 ? 0.35 : 0.); }
border a(t=0, 1) { x = 1 + t; y = 0; label = 1; }
border b(t=0, 1) { x = 2*cos(angle(t)); y = 2*sin(angle(t)); label = 2; }
border c(t=0, 1) { x = (2 - t)*cos(0.85); y = (2 - t)*sin(0.85); label = 3; }
border d(t=1, 0) { x = cos(0.85*t); y = sin(0.85*t); label = 4; }
body = buildmesh(a(4) + b(10) + c(4) + d(4), fixedborder = 1);
macro curved() 2 //
""" + MATERIAL + """
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() pressure(2, 1.) //
include "export.idp"
""")
    sub, = read_problem(exported(path, element="P2", subdomains=1), reduce=False).subdomains
    edges = sub.edges[sub.edge_label == 2]
    length = np.linalg.norm(np.diff(sub.xy[edges], axis=1)[:, 0], axis=1)
    assert np.sort(length)[-1] > 7 * np.sort(length)[-2]
    assert np.abs(np.hypot(*sub.xy[sub.middles(edges)].T) - 2).max() < 1e-6


@pytest.mark.parametrize("element", QUADRATIC)
def test_each_side_of_a_corner_on_a_curve_has_its_own_normal(exported, named_scene, element):
    """A label round a quarter of a disc and along its straight foot: the corner is two nodes, one
    of which faces down; all together face and weigh as much as the turned chord of the label.
    """
    path = named_scene("cornered", """include "scene.idp"
border a(t=0, 1) { x = t; y = 0; label = 5; }
border b(t=0, pi/2) { x = cos(t); y = sin(t); label = 5; }
border c(t=1, 0) { x = 0; y = t; label = 3; }
body = buildmesh(a(4) + b(7) + c(4));
macro curved() 5 //
""" + MATERIAL + """
macro support() on(3, u1 = 0.) //
macro contact() 5 //
include "export.idp"
""")
    problem = read_problem(exported(path, element=element, subdomains=1), reduce=False)
    contact = problem.structure.contact
    weight, normal, xy = contact.weight, contact.normal, contact.xy
    np.testing.assert_allclose(weight @ normal, [1.0, -1.0 + 1.0], atol=1e-6)
    corner = np.flatnonzero(np.hypot(xy[:, 0] - 1, xy[:, 1]) < 1e-9)
    assert len(corner) == 2
    down, aside = corner[np.argsort(normal[corner, 1])]
    np.testing.assert_allclose(normal[down], [0, -1], atol=1e-9)
    # of a parabola through three points of an eleventh of a turn
    assert normal[aside, 0] > 0.99 and abs(normal[aside, 1]) < 0.15
    foot = np.abs(xy[:, 1]) < 1e-9
    np.testing.assert_allclose(normal[foot & (xy[:, 0] < 0.99)], np.tile(
        [0, -1], (np.count_nonzero(foot) - 2, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-12)


def test_integrals_along_sides(rng=np.random.default_rng(4)):
    """Normals add up to the turned chord, shape functions to the length of the parabola."""
    xy = np.array([[0.0, 0.0], [2.0, 0.5], [1.1, 0.0]]) + 0.1 * rng.random((5, 3, 2))
    chord = xy[:, 1] - xy[:, 0]
    np.testing.assert_allclose(sides.normals(xy).sum(axis=1),
                               np.column_stack([chord[:, 1], -chord[:, 0]]), rtol=1e-13)
    xi = (np.arange(20000) + 0.5) / 20000
    rise = xy[:, 2] - xy[:, :2].mean(axis=1)
    speed = np.linalg.norm(chord[:, None] + 4 * (1 - 2 * xi)[:, None] * rise[:, None], axis=2)
    # Gauss's rule of degree 5 for a root of a quadratic that varies by a tenth
    np.testing.assert_allclose(sides.integrals(xy).sum(axis=1), speed.mean(axis=1), rtol=1e-4)


# ------------------------------------------------------------------------------ patches

@pytest.mark.parametrize("element", ["P2", "P2-mixed"])
def test_constant_stress_passes(solved, named_scene, element):
    """Tractions sigma n all round a body with curved sides: linear displacements at each node."""
    path = named_scene("patch", PLATE + """
macro pull(label) traction(label, 5.*N.x + 2.*N.y, 2.*N.x - 3.*N.y) //
macro load1() pull(1) + pull(22) + pull(3) + pull(4) + pull(9) //
macro displacement1() on(4, u1 = (1.3*(5*0.7 + 3*0.3)*x + 2.6*2*y)/1000) //
macro support() on(1, u2 = 0.) //
macro probePoints() [4., 3., 1.7, 2.2, 4.6, 1.5] //
include "export.idp"
""")
    run = solved(path, element=element, fields="yes", **TIGHT)
    grown = np.array([[1.3 * (5 * 0.7 + 3 * 0.3), 2 * 2.6],
                      [0.0, 1.3 * (-3 * 0.7 - 5 * 0.3)]]) / 1000
    fields = driver.open(run.directory).fields(1)
    assert np.abs(fields.displacement - fields.nodes @ grown.T).max() < 1e-9 * np.abs(grown).max()
    np.testing.assert_allclose(fields.stress[:, [0, 1, 3]],
                               np.tile([5.0, -3.0, 2.0], (len(fields.nodes), 1)), atol=1e-7)
    probes = read_table(run.directory / "probes.csv")
    places = np.column_stack([probes["x"], probes["y"]])
    # the last one lies between chord and curve
    np.testing.assert_allclose(np.column_stack([probes["u_x"], probes["u_y"]]), places @ grown.T,
                               rtol=1e-8)


def test_sides_of_any_length_carry_loads(exported, named_scene):
    """The shortest side 3e-4 of the longest: the resultant of N is that of the turned chord."""
    path = named_scene("graded", """include "scene.idp"
real angle = pi/2;
int[int] sideLabels = [3, 4, 1, 2];
body = square(10, 3, [(1 + y)*cos(angle*(1 - x)^4), (1 + y)*sin(angle*(1 - x)^4)],
              label = sideLabels);
macro curved() 1, 3 //
""" + MATERIAL + """
macro support() on(4, u2 = 0.) //
macro load1() traction(3, N.x, N.y) //
include "export.idp"
""")
    problem = read_problem(exported(path, element="P2", subdomains=3), reduce=False)
    sides_ = [np.linalg.norm(np.diff(sub.xy[sub.edges[:, :2]], axis=1), axis=2)
              for sub in problem.subdomains]
    assert min(side.min() for side in sides_) < 1e-3 * max(side.max() for side in sides_)
    total = sum(sub.loads.reshape(-1, 2).sum(axis=0) for sub in problem.subdomains)
    np.testing.assert_allclose(total, [-1.0, -1.0], rtol=1e-9)


@pytest.mark.parametrize("element", QUADRATIC)
def test_loads_see_the_curve(rings, exported, named_scene, element):
    """Traction, body force and a prescribed displacement as functions of place, normal and label.

    Resultants of N and of x in closed form; functions that macros do not hold are evaluated at
    the place as well where they are given on boundaries.
    """
    path = named_scene("loads", RING + """
func outside = x*y;
macro support() on(4, u2 = 0.) //
macro load1() traction(3, N.x*y, outside) //
macro bodyForce2() [x, 1.] //
macro displacement3() on(1, u1 = outside, u2 = x^2) //
include "export.idp"
""")
    problem = read_problem(exported(path, element=element, h=0.2, subdomains=3), reduce=False)
    loads = np.zeros((3, 2))
    for sub in problem.subdomains:
        loads += sub.loads.reshape(3, -1, 2).sum(axis=1)
        wanted = sub.xy[sub.dof_node[sub.fixed]]
        moved = np.where(sub.dof_component[sub.fixed] == 0, wanted.prod(axis=1), wanted[:, 0]**2)
        outer = np.isclose(np.hypot(*wanted.T), 2.0, rtol=1e-6)
        np.testing.assert_allclose(sub.fixed_values[2, outer], moved[outer], rtol=1e-12)
    # int -x y ds, int x y ds on the inner circle; int x, area: the parabolas err by h^4
    np.testing.assert_allclose(loads[0], [-0.5, 0.5], rtol=2e-5)
    np.testing.assert_allclose(loads[1], [7 / 3, 0.75 * np.pi], rtol=2e-5)


@SLOW
def test_foundation_on_a_curve(solved, named_scene):
    """Lame's ring on springs, as exact as it is without them: 9e-5 on this mesh."""
    path = named_scene("founded", RING + """
macro support() on(2, u1 = 0.) + on(4, u2 = 0.) //
macro load1() pressure(3, p) //
macro foundation() 1 //
macro foundationNormal() k //
macro probePoints() [a, 0., b, 0.] //
include "export.idp"
""")
    run = solved(path, element="P2", h=0.1, k=100, **TIGHT)
    A, B = lame(k=100.0)
    probes = read_table(run.directory / "probes.csv")
    np.testing.assert_allclose(probes["u_x"], [A + B, 2 * A + B / 2], rtol=1e-4)


# ------------------------------------------------------------------------------ contact

# two rings, or a ring on a rigid shaft, around the origin; labels 1 outside, 2 and 3 where they
# meet, 4 the hole, 5 and 6 the cuts
PRESSED = """include "scene.idp"
real b = 0.6, c = 0.2, p = 1e7, h = meshSize(0.05), fine = physical("fine", 1.3),
     core = physical("core", 0.);
int[int] outer = [5, 1, 6, 2], inner = [5, 3, 6, 4];
func mesh ring(real from, real to, int m, int n, int[int] & sides) {
  return square(m, n, [(from + (to - from)*x)*cos(pi/2*y), (from + (to - from)*x)*sin(pi/2*y)],
                label = sides);
}
int n = rint(pi/2*b/h);
addBody(ring(b, 1., rint((1. - b)/h), n, outer))
addBody(ring(c, b, rint(fine*(b - c)/h), rint(fine*n), inner))
macro young() 1e9 //
macro poisson() 0.2 //
macro support() on(5, u2 = 0.) + on(6, u1 = 0.) //
macro contactPair() 3, 2 //
macro curved() 1, 2, 3, 4 //
macro load1() pressure(1, p) + pressure(4, core*p) //
include "export.idp"
"""


def test_uniform_pressure_passes_between_matching_rings(solved, named_scene):
    """sigma = -p everywhere: forces int phi n ds on either side are those of the other."""
    run = solved(named_scene("rings", PRESSED), element="P2", h=0.1, fine=1, core=1, **TIGHT)
    np.testing.assert_allclose(run.contact["sigma_n"], -1e7, rtol=1e-8)
    np.testing.assert_allclose(np.hypot(run.contact["x"], run.contact["y"]), 0.6, rtol=1e-12)


@pytest.fixture(scope="module")
def pressed_error(solved, named_scene):
    """pressed_error(**options): of the pressures between rings that do not match, in L2."""
    def get(**options) -> float:
        run = solved(named_scene("rings", PRESSED), h=0.04, **options, **TIGHT)
        exact = 1e7 * (1 - 0.04 / 0.36) / (1 - 0.04)
        off, weight = -run.contact["sigma_n"] / exact - 1, run.contact["weight"]
        return float(np.sqrt((weight * off**2).sum() / weight.sum()))
    return get


@pytest.mark.parametrize("element", QUADRATIC)
def test_pressed_rings(pressed_error, element):
    """Meshes that do not match. Lame's pressure, of which a ring of 24 sides may miss h^3."""
    assert pressed_error(element=element) < 3e-4


@SLOW
def test_straight_sides_are_worse_between_rings(pressed_error):
    """Left out, the pressures alternate, by more than those of linear elements do."""
    straight = pressed_error(element="P2", without="curved")
    assert straight > 10 * pressed_error(element="P2")
    assert straight > pressed_error(element="P1")


@SLOW
@pytest.mark.parametrize("element", ["P2", "P2-mixed"])
def test_hollow_sphere_on_a_shaft(solved, named_scene, element):
    """A body of revolution: Lame's sphere, pressed from inside; nodes on the axis as well."""
    path = named_scene("sphere", RING.replace('include "scene.idp"',
                                              'include "scene.idp"\nsubdomains("5");') + """
macro axisymmetric() 1 //
macro support() on(4, u2 = 0.) //
macro contact() 3 //
macro gap() (-0.01) //
macro probeLabels() [3] //
include "export.idp"
""")
    lam, mu = E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)
    A, B = np.linalg.solve([[1.0, 1.0], [3 * lam + 2 * mu, -mu / 2]], [0.01, 0.0])
    pressure = -((3 * lam + 2 * mu) * A - 4 * mu * B)
    found = []
    for h in (0.2, 0.1):
        run = solved(path, element=element, h=h, fields="yes", **TIGHT)
        weight, p = run.contact["weight"][0], -run.contact["sigma_n"][0]
        fields = driver.open(run.directory).fields(1)
        r = np.linalg.norm(fields.nodes, axis=1)
        exact = fields.nodes * (A + B / r**3)[:, None]
        found.append([abs(weight.sum() / (2 * np.pi) - 1),
                      abs(weight @ p / (2 * np.pi * pressure) - 1),
                      np.linalg.norm(fields.displacement - exact) / np.linalg.norm(exact)])
    # straight sides: 8e-4, 3e-4, 9e-4
    assert (np.array(found[1]) < [1e-6, 1e-5, 6e-5]).all(), found
    order = np.log2(np.array(found[0]) / found[1])
    # irregular meshes, half an order less than smooth ones
    assert (order > [3.5, 2.9, 2.4]).all(), order


# ------------------------------------------------------------------------------ cuts and meshes

# a pin in the hole of the plate, with friction
PINNED = PLATE.replace("body = buildmesh", "addBody(buildmesh").replace(
    "hole(-2*n - 3));", """hole(-2*n - 3)))
border pin(t=0,2*pi){x=1.7+0.9*cos(t)-0.2*sin(t);y=1.4+0.3*cos(t)+0.7*sin(t);label=5;}
addBody(buildmesh(pin(3*n + 2)))""").replace("22, 9 //", "22, 9, 5 //") + """
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() pressure(3, press) //
macro contactPair() 5, 9 //
macro friction() 0.2 //
include "export.idp"
"""
PINNED = PINNED.replace('subdomains("7");', 'real press = physical("press", 5.);')


def by_place(run, *names: str) -> list[np.ndarray]:
    """Columns of the contact nodes of the last step, in an order that no cut knows."""
    order = np.lexsort((run.contact["y"][-1].round(9), run.contact["x"][-1].round(9)))
    return [run.contact[name][-1][order] for name in names]


@SLOW
def test_cuts_and_ranks_make_no_difference(solved, named_scene):
    path, names = named_scene("pinned", PINNED), ("weight", "normal_x", "sigma_n", "sigma_t")
    tight = {"rtol": 1e-10, "friction_rtol": 1e-8}
    one, other = (solved(path, element="P2", subdomains=cut, **tight) for cut in ("1", "7"))
    for mine, its in zip(by_place(one, *names), by_place(other, *names)):
        assert np.abs(mine - its).max() < 1e-5 * np.abs(mine).max()
    two = solved(path, element="P2", subdomains="7", np=2, **tight)
    for name, column in two.contact.items():
        assert np.array_equal(column, other.contact[name]), name


@SLOW
def test_studies_find_what_runs_find(named_scene, tmp_path, solved):
    """The values of a study share the export of one body, whose nodes are on the curve."""
    path = named_scene("pinned", PINNED)
    make_study({"scene": str(path), "press": "5,7", "element": "P2",
                          "out": str(tmp_path / "out"), "figures": "no", "quiet": "yes"})
    rows = read_table(tmp_path / "out" / "contact.csv")
    run = solved(path, element="P2", press=7)
    found = rows["sigma_n"][rows["press"] == 7]
    np.testing.assert_allclose(np.sort(found), np.sort(run.contact["sigma_n"][0]), rtol=1e-4,
                               atol=1e-4)


@SLOW
def test_curves_survive_refinement(named_scene, solved):
    """Vertices of adapted meshes are on the curve of the scene's own mesh."""
    path = named_scene("lame-probed", LAME.replace(
        'include "export.idp"', 'macro probePoints() [a, 0., b, 0.] //\ninclude "export.idp"'))
    run = solved(path, element="P2", h=0.2, adapt=2, errors="energy")
    A, B = lame()
    probes = read_table(run.directory / "probes.csv")
    # the curve of the first mesh, whose sides are halved twice: (0.2/4)^4 of the radius
    np.testing.assert_allclose(probes["u_x"], [A + B, 2 * A + B / 2], rtol=1e-5)


@SLOW
def test_estimate_sees_the_curve(named_scene, solved, rings):
    """The recovered stresses' error, over the true one: 1.3 and 1.1; that of straight sides hides.

    There the estimate, 0.2 %, misses what the polygon lacks, 3.6 %.
    """
    A, B = lame()
    for h, low, high in ((0.2, 1.0, 1.5), (0.1, 1.0, 1.25)):
        run = solved(named_scene("lame", LAME), element="P2", h=h, errors="energy")
        sub, = rings("P2", h).subdomains
        u = elastic(rings("P2", h))
        true = np.sqrt(1 - u @ (sub.stiffness @ u) / (3 * np.pi / 2 * (A + B)))
        estimate = run.summary["errors"]["energy"]["relative"]
        assert low < estimate / true < high


# ------------------------------------------------------------------------------ Hertz

@SLOW
@pytest.mark.parametrize("h", [0.004, 0.002])
def test_hertz_is_no_worse_anywhere(solved, h):
    """Inside 0.8 a, in L2; the formula of half-planes errs by 3e-4 on this body."""
    error = []
    for options in ({}, {"without": "curved"}):
        c = solved("hertz", element="P2", h=h, **options).contact
        x, p, w = c["x"][0], -c["sigma_n"][0], c["weight"][0]
        a = np.sqrt(4 * (p @ w) * 0.91 / (np.pi * 2000))
        exact = 2 * (p @ w) / (np.pi * a) * np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
        inside = np.abs(x) < 0.8 * a
        error.append([np.sqrt(w[inside] @ (p - exact)[inside]**2 / (w[inside] @ exact[inside]**2)),
                      w @ np.abs(p - exact) / (p @ w)])
    assert (np.array(error[0]) < error[1]).all()


# ------------------------------------------------------------------------------ what is refused

def test_linear_elements_have_straight_sides(exported, named_scene):
    """The declaration changes no bit of the records."""
    records = []
    for name, text in (("lame", LAME), ("plain", LAME.replace("macro curved() 1, 3 //\n", ""))):
        directory = exported(named_scene(name, text), h=0.4, subdomains=3)
        records.append((directory / "block-0.bin").read_bytes())
    assert records[0] == records[1]


@pytest.mark.parametrize("change, words", [
    (("macro curved() 1, 3 //", "macro curved() 1, 8 //"),
     "curved: the mesh has no boundary with label 8; its labels are 1, 2, 3, 4"),
    (("macro curved() 1, 3 //", "macro curved() 3, 3 //"), "curved names label 3 twice"),
    (("macro curved() 1, 3 //", "macro curved() 1.5 //"), "curved expects labels, not 1.5"),
    # sides of 30 degrees bow by 0.03 b: through a ring of 0.02 b
    (("b = 2., p", "b = 1.02, p"), "the sides with label 3 turn a triangle inside out, at (0.7"),
])
def test_misuse_is_refused(tmp_path, scene, change, words):
    with pytest.raises(InputError, match=re.escape(words)):
        freefem.export(scene(LAME, change), tmp_path / "export", {"element": "P2", "h": "0.7"})


def test_rectangles_are_refused(tmp_path, scene):
    path = scene("""include "scene.idp"
rectangle(0., 1., 0., 1.);
macro curved() 1 //
""" + MATERIAL + 'include "export.idp"\n')
    with pytest.raises(InputError, match="straight sides alone"):
        freefem.export(path, tmp_path / "export", {})


BEAD = """include "scene.idp"
real squeeze = 0.08;
units("mm", "MPa");
quasistatic(1.);
int n = rint(pi/meshSize(0.3));
border low(t=-pi, 0) { x = 10. + cos(t); y = 1. + sin(t); label = 17; }
border right(t=1., 2.5) { x = 11.; y = t; label = 6; }
border top(t=1., -1.) { x = 10. + t; y = 2.5; label = 12; }
border left(t=2.5, 1.) { x = 9.; y = t; label = 8; }
body = buildmesh(low(n) + right(n/2) + top(n/2) + left(n/2));
macro axisymmetric() 1 //
macro young() 6. //
macro poisson() 0.4 //
macro contact() 17 //
macro curved() 17 //
macro obstacle(x, y) y //
macro tresca() 0.05 //
{moves}
include "export.idp"
"""


def test_rings_under_an_obstacle_that_moves_have_their_areas(solved, named_scene):
    """A flange that rises is a bead that sinks: tractions, and forces of a law that has a stress,
    are the same, to the tolerance of both runs.
    """
    ways = {"rises": "macro support() on(12, u2 = 0.) //\nmacro obstacleY(t) squeeze*t //",
            "sinks": "macro displacement1() on(12, u2 = -squeeze) //\nmacro amplitude1(t) t //"}
    one, other = (solved(named_scene(name, BEAD.replace("{moves}", moves)), element="P2", steps=2,
                         rtol=1e-10, friction_rtol=1e-9) for name, moves in ways.items())
    assert one.status == other.status == 0
    for name in ("weight", "sigma_n", "sigma_t"):
        scale = np.abs(one.contact[name]).max()
        assert scale > 0
        np.testing.assert_allclose(one.contact[name], other.contact[name], atol=1e-7 * scale)


def test_initial_displacements_of_rings_are_no_integrals(built, named_scene):
    """u_0 . t at the nodes, of a uniform u_0, with the tangents that all of their sides make."""
    moves = "macro support() on(12, u1 = 0., u2 = 0.) //\nmacro initialX() 0.25 //"
    problem = built(named_scene("initial", BEAD.replace("{moves}", moves)), element="P2")
    contact = problem.structure.contact
    found = initial_state.Room.initial_displacement(None, contact)
    np.testing.assert_allclose(found, 0.25 * contact.tangent[:, 0], rtol=1e-12, atol=1e-15)


def test_initial_displacements_do_not_depend_on_the_cut(built, named_scene):
    """At the coarse vertices of an arc the tangent is that of both sides, whoever has them."""
    text = """include "scene.idp"
border bottom(t = pi, 2*pi) {x = cos(t); y = 1. + sin(t); label = 1;}
border top(t = -1., 1.) {x = -t; y = 1.; label = 3;}
body = buildmesh(bottom(12) + top(8));
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 1 //
macro friction() 0.3 //
macro initialX() 0.25 //
macro initialY() 0.1*x //
include "export.idp"
"""
    found = []
    for cut in (1, 5):
        contact = built(named_scene("arc", text), subdomains=cut).structure.contact
        order = np.lexsort(contact.xy.T)
        u = initial_state.Room.initial_displacement(None, contact)[order]
        x = contact.xy[order]
        expected = 0.25 * contact.tangent[order, 0] + 0.1 * x[:, 0] * contact.tangent[order, 1]
        np.testing.assert_allclose(u, expected, rtol=1e-12, atol=1e-15)
        found.append(u)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("nodes", [6, 7])
def test_strains_of_curved_triangles_are_those_of_systems_one_by_one(nodes):
    """Derivatives along x and y from those by the coordinates of a triangle: at every place two
    equations each, to rounding.
    """
    random = np.random.default_rng(4)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) + 0.1 * random.random((40, 3, 2))
    middles = (corners[:, [1, 2, 0]] + corners[:, [2, 0, 1]]) / 2
    corner = np.concatenate([corners, middles + 0.05 * random.random(middles.shape)], axis=1)
    value, places = random.random((40, nodes, 2)), elements.POINTS

    by_place = [np.einsum("mnc,tnk->tmck", elements.slopes(at.shape[1], places), at)
                for at in (corner, value)]
    d = np.linalg.solve(*(part[:, :, 1:] - part[:, :, :1] for part in by_place))
    found = elements.strains(corner, value, places)
    np.testing.assert_allclose(found[..., 0], d[..., 0, 0], atol=1e-13)
    np.testing.assert_allclose(found[..., 2], d[..., 1, 0] + d[..., 0, 1], atol=1e-13)
