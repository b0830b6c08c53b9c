"""Ties and periodic boundaries: patches, rates, what meets at their ends, closed forms, misuse."""

import csv
import functools

import numpy as np
import pytest

import driver
from driver.files import read_table

TIGHT = {"rtol": 1e-12, "friction_rtol": 1e-10, "primal_rtol": 1e-9, "fields": "yes"}
HEAD = """include "scene.idp"
real E = 1000., nu = 0.3, t = tan(10*pi/180);
"""
MATERIAL = """
macro young() E //
macro poisson() nu //
"""
# two blocks across a tilted cut, meshed as it suits either
CUT = HEAD + """int[int] below = [1, 2, 5, 4], above = [6, 2, 3, 4];
addBody(square(9, 5, [2.*x, y*(0.5 + t*(2.*x - 1.))], label = below))
addBody(square(14, 4, [2.*x, 1. - (1. - y)*(0.5 - t*(2.*x - 1.))], label = above))
""" + MATERIAL
# pressed, the lower one alone held: the tie is all that holds the upper one
PATCH = CUT + """macro support() on(1, u2 = 0.) //
macro displacement1() on(4, u1 = 0., u2 = -(1 - nu^2)/E*y) //
macro load1() pressure(3, 1.) //
macro tie() 6, 5 //
include "export.idp"
"""
# four blocks that meet in one point, no two meshes alike
FOUR = HEAD + """int[int] a = [1, 11, 12, 4], b = [1, 2, 22, 21];
int[int] c = [32, 31, 3, 4], d = [42, 2, 3, 41];
addBody(square(3, 4, [x, y], label = a))
addBody(square(5, 3, [1 + x, y], label = b))
addBody(square(4, 2, [x, 1 + y], label = c))
addBody(square(2, 5, [1 + x, 1 + y], label = d))
""" + MATERIAL + """macro support() on(1, u2 = 0) + on(4, u1 = 0) //
macro load1() pressure(3, 1.) //
macro tie() 11, 21, 12, 32, 22, 42, 31, 41 //
include "export.idp"
"""
# two blocks side by side on a rigid floor, which is all besides the tie that holds the right one
SIDE = HEAD + """int[int] a = [5, 11, 3, 4], b = [5, 2, 3, 21];
addBody(square(3, 4, [x, y], label = a))
addBody(square(5, 3, [1 + x, y], label = b))
""" + MATERIAL + """macro support() on(4, u1 = 0) //
macro load1() pressure(3, 1.) //
macro contact() 5 //
macro tie() 11, 21 //
include "export.idp"
"""
# a square in a square hole, tied all round by one label that turns corners
INCLUSION = HEAD + """border o1(s = 0, 4) { x = s; y = 0; label = 1; }
border o2(s = 0, 4) { x = 4; y = s; label = 2; }
border o3(s = 4, 0) { x = s; y = 4; label = 3; }
border o4(s = 4, 0) { x = 0; y = s; label = 4; }
border h1(s = 1, 3) { x = s; y = 1; label = 5; }
border h2(s = 1, 3) { x = 3; y = s; label = 5; }
border h3(s = 3, 1) { x = s; y = 3; label = 5; }
border h4(s = 3, 1) { x = 1; y = s; label = 5; }
addBody(buildmesh(o1(8) + o2(8) + o3(8) + o4(8) + h1(-6) + h2(-5) + h3(-7) + h4(-4)))
int[int] around = [6, 6, 6, 6];
addBody(square(5, 9, [1 + 2*x, 1 + 2*y], label = around))
""" + MATERIAL + """macro support() on(1, u2 = 0) + on(4, u1 = 0) //
macro load1() pressure(3, 1.) //
macro tie() 6, 5 //
include "export.idp"
"""
# one block on another, tied on the left (5, 6); their sides on the right (7, 8) may press: a crack
CRACK = HEAD + """border a1(s = 0, 1) { x = 2*s; y = 0; label = 1; }
border a2(s = 0, 1) { x = 2; y = s; label = 2; }
border a3(s = 2, 0.7) { x = s; y = 1; label = 7; }
border a4(s = 0.7, 0) { x = s; y = 1; label = 5; }
border a5(s = 1, 0) { x = 0; y = s; label = 4; }
border b1(s = 0, 0.7) { x = s; y = 1; label = 6; }
border b2(s = 0.7, 2) { x = s; y = 1; label = 8; }
border b3(s = 1, 2) { x = 2; y = s; label = 2; }
border b4(s = 2, 0) { x = s; y = 2; label = 3; }
border b5(s = 2, 1) { x = 0; y = s; label = 4; }
addBody(buildmesh(a1(5) + a2(3) + a3(6) + a4(3) + a5(3)))
addBody(buildmesh(b1(3) + b2(7) + b3(4) + b4(6) + b5(4)))
""" + MATERIAL + """macro support() on(1, u1 = 0, u2 = 0) //
macro load1() pressure(3, 1.) //
macro contactPair() 8, 7 //
macro tie() 5, 6 //
include "export.idp"
"""
STRIP = HEAD + """border base(s = 0, 1) { x = s; y = 0; label = 1; }
border right(s = 0, 1) { x = 1 + 0.1*sin(2*pi*s); y = s; label = 2; }
border top(s = 1, 0) { x = s; y = 1; label = 3; }
border left(s = 1, 0) { x = 0.1*sin(2*pi*s); y = s; label = 4; }
addBody(buildmesh(base(5) + right(%s) + top(5) + left(%s)))
""" + MATERIAL + """macro support() on(1, u1 = 0, u2 = 0) //
macro displacement1() on(3, u1 = 0.01, u2 = 0) //
macro periodic() 4, 2 //
include "export.idp"
"""
# a small tube whose inner and outer side are to repeat one another
TUBE = HEAD + """addBody(square(3, 3, [2e-6 + 1e-6*x, 1e-6*y]))
""" + MATERIAL + """macro support() on(1, u2 = 0) //
macro displacement1() on(3, u2 = 1e-8) //
macro axisymmetric() 1 //
macro periodic() 4, 2 //
include "export.idp"
"""


def stresses(run) -> np.ndarray:
    """(m, 4) of the triangles at the end of a run."""
    assert run.status == 0, run.reason
    return driver.open(run.directory).fields().triangle_stress


@pytest.mark.parametrize("text, options", [
    ("patch", {}), ("patch", {"element": "P2", "subdomains": 5}), ("patch", {"subdomains": 7}),
    ("four", {"subdomains": 5}), ("side", {"subdomains": 3}), ("inclusion", {"subdomains": 4}),
    pytest.param("inclusion", {"element": "P2"}, marks=pytest.mark.slow),  # a further mesh
    pytest.param("patch", {"np": 2, "subdomains": 3}, marks=pytest.mark.slow),  # ranks
    pytest.param("four", {"element": "P2"}, marks=pytest.mark.slow),  # a further mesh
    pytest.param("side", {"element": "P2", "np": 2}, marks=pytest.mark.slow)])
@pytest.mark.some(3)
def test_constant_stress_passes(solved, scene, text, options):
    """sigma_yy = -1 in plane strain, everything else zero but sigma_zz: to rounding, 1e-9."""
    text = {"patch": PATCH, "four": FOUR, "side": SIDE, "inclusion": INCLUSION}[text]
    stress = stresses(solved(scene(text), **TIGHT, **options))
    np.testing.assert_allclose(stress, np.tile([0, -1, -0.3, 0], (len(stress), 1)), atol=1e-9)


def test_rows_are_independent_whatever_meets_at_the_ends_of_ties(built, scene):
    """Where four ties meet in a point, and beside contact of nodes that match: F is regular."""
    for text in (FOUR, SIDE.replace("square(5, 3", "square(3, 4")):
        values = np.linalg.eigvalsh(built(scene(text), subdomains=1).F)
        assert values[0] > 1e-6 * values[-1]


@pytest.mark.parametrize("pair, tie", [("8, 7", "5, 6"), ("7, 8", "6, 5"), ("8, 7", "6, 5")])
@pytest.mark.some(2)
def test_rows_are_independent_at_the_tip_of_a_crack_whatever_is_named_first(built, scene, pair,
                                                                            tie):
    """Contact and a tie join the same two vertices there: one of them holds these, F is regular."""
    text = CRACK.replace("() 8, 7", f"() {pair}").replace("() 5, 6", f"() {tie}")
    values = np.linalg.eigvalsh(built(scene(text), subdomains=1).F)
    assert values[0] > 1e-6 * values[-1]


def test_bodies_that_nothing_pushes_settle_at_once(solved, scene):
    """A body held in one direction by ties alone, with no force in it, needs no other method."""
    run = solved(scene(FOUR), subdomains=5, **TIGHT)
    assert not any(run.summary["fallbacks"].values()) and not run.summary["warnings"]


def test_what_nothing_balances_is_refused(solved):
    """A periodic body that contact holds no more flies off, whatever joins it to itself."""
    run = solved("ripple", h=0.1, without="contact")
    assert run.status == 3 and "no equilibrium" in run.reason


@pytest.mark.slow  # the same once more, of revolution
def test_constant_stress_passes_between_bodies_of_revolution(solved, scene):
    """Free to widen, sigma_zz is the hoop stress: zero, with nothing that holds the outer ring."""
    revolved = (("macro support() on(4, u1 = 0) //", "macro axisymmetric() 1 //"),)
    for element in ("P1", "P2"):
        stress = stresses(solved(scene(SIDE, *revolved), element=element, **TIGHT))
        np.testing.assert_allclose(stress, np.tile([0, -1, 0, 0], (len(stress), 1)), atol=2e-9)


# u is a polynomial of degree two, whose body force is constant
SMOOTH = CUT
for old, new in (("real E = 1000.", """int m = whole("lower", 10, 2), n = whole("upper", 14, 2);
real E = 1."""), ("square(9, 5", "square(m, m/2"), ("square(14, 4", "square(n, n/2")):
    assert old in SMOOTH
    SMOOTH = SMOOTH.replace(old, new)
SMOOTH += """real lam = nu/(1 + nu)/(1 - 2*nu), mu = 1/(2*(1 + nu));
macro displacement1() on(1, 2, 3, 4, u1 = x^2 + 2*x*y + y^2/2, u2 = x^2/2 - x*y + 2*y^2) //
macro bodyForce1() [-(lam + 4*mu), -(3*mu + 4*(lam + 2*mu) + 2*lam)] //
macro tie() 6, 5 //
include "export.idp"
"""


def error(run) -> float:
    """||u_h - u|| in L2 by the middles of edges, which is exact for linear u_h but for h^4."""
    fields = driver.open(run.directory).fields()
    corner = fields.nodes[fields.triangles]
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]) / 2
    total = 0.0
    for a, b in ((0, 1), (1, 2), (2, 0)):
        u = fields.displacement[fields.triangles[:, [a, b]]].mean(axis=1)
        x, y = ((corner[:, a] + corner[:, b]) / 2).T
        u -= np.column_stack([x**2 + 2*x*y + y**2 / 2, x**2 / 2 - x*y + 2*y**2])
        total += area @ (u**2).sum(axis=1) / 3
    return float(np.sqrt(total))


def test_displacements_converge_across_a_tie_as_on_one_mesh(solved, scene):
    """Order 2 in L2 with linear elements."""
    coarse, fine = (error(solved(scene(SMOOTH), lower=m, upper=n, fields="yes"))
                    for m, n in ((10, 14), (20, 28)))
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.05)


@pytest.mark.slow  # a tenth of a second, but a third mesh
def test_quadratic_elements_have_the_quadratic_solution(solved, scene):
    """Exactly, with stresses linear along the tie."""
    run = solved(scene(SMOOTH), element="P2", **TIGHT)
    fields = driver.open(run.directory).fields()
    x, y = fields.nodes.T
    exact = np.column_stack([x**2 + 2*x*y + y**2 / 2, x**2 / 2 - x*y + 2*y**2])
    np.testing.assert_allclose(fields.displacement, exact, atol=1e-9)


@pytest.mark.slow  # long strips on fine meshes
def test_a_bimetal_strip_bends_as_timoshenko_says(solved):
    """Curvature in its middle; the ends are 20 heights away. Forces of the tie balance.

    Both have the law of Saint-Venant: 1e-6 is what tolerances leave.
    """
    run = solved("bimetal", element="P2", rtol=1e-10, friction_rtol=1e-9)
    table = read_table(run.directory / "probes.csv")
    down = -table["u_y"][-4:]
    curvature = (down[2] - 2 * down[1] + down[0]) / 10**2
    ratio = 210 / 100
    exact = 6 * 7e-6 * 50 * 4 / (2 * (3 * 4 + (1 + ratio) * (1 + 1 / ratio)))
    assert curvature == pytest.approx(exact, rel=2e-6)
    assert np.abs([table["force_x"], table["force_y"]]).max() < 1e-6 * 210e3 * 7e-6 * 50
    assert run.contact == {} and run.summary["sizes"]["contact_nodes"] == 0
    assert run.summary["effects"]["ties"] and run.summary["effects_ledger"]["tie"]["active"]


def test_forces_through_a_tie_are_those_of_statics(solved, scene):
    """On either side the load of the upper block, with opposite signs."""
    run = solved(scene(PATCH, ("[6, 2, 3, 4]", "[6, 2, 3, 9]"), (
                               "macro load1() pressure(3, 1.) //",
                               "macro load1() traction(3, 0.3, -1.) //\n"
                               "macro probeLabels() [5, 6] //")), **TIGHT)
    table = read_table(run.directory / "probes.csv")
    force = np.column_stack([table["force_x"], table["force_y"]])
    np.testing.assert_allclose(force, [[0.6, -2.0], [-0.6, 2.0]], atol=1e-8)


@pytest.mark.parametrize("right, left", [(8, 8), (7, 10)])
def test_a_sheared_strip_knows_no_ends(solved, scene, right, left):
    """Simple shear G 0.01, whatever its wavy sides are and how they are meshed."""
    stress = stresses(solved(scene(STRIP % (right, left)), subdomains=3, **TIGHT))
    shear = 1000 / (2 * 1.3) * 0.01
    alike = right == left  # else the sides' polygons are no translates of one another, h^2 off
    np.testing.assert_allclose(stress, np.tile([0, 0, 0, shear], (len(stress), 1)),
                               atol=1e-8 * shear if alike else 0.05 * shear)


@pytest.mark.parametrize("options", [{"element": "P2"}, pytest.param(
    {"h": 0.0025, "mean": 0.5}, marks=pytest.mark.slow), pytest.param(
    {"h": 0.0025, "crest": 0.5}, marks=pytest.mark.slow)])  # finer, in contact across the sides
def test_wavy_contact_is_westergaards(solved, options):
    """Half-width and peak to 0.5 %, wherever the crest lies."""
    run = solved("ripple", subdomains=4, **options)
    mean, quantities = options.get("mean", 0.25), run.summary["quantities"]
    half = np.arcsin(np.sqrt(mean)) / np.pi
    full = np.pi / (1 - 0.3**2) * 1e-4
    with open(run.directory / "boundary.csv") as file:
        roles = {row["label"]: row["role"] for row in csv.DictReader(file)}
    assert roles == {"1": "support", "2": "joined", "3": "contact", "4": "joined"}
    assert quantities["normal_resultant"] == pytest.approx(mean * full, rel=1e-5)
    assert quantities["contact_length"] == pytest.approx(2 * half, rel=5e-3)
    assert quantities["peak_pressure"] == pytest.approx(2 * mean * full / np.sqrt(mean), rel=5e-3)


def test_contact_goes_on_where_a_period_ends(solved):
    """A crest on the cut has the peak of Westergaard's to 1 %: its end nodes are one place.

    The line through their neighbours, as at an end of a boundary, had been 4.2 % above it.
    """
    run = solved("ripple", h=0.025, crest=0.5, subdomains=4)
    boundaries = read_table(run.directory / "boundaries.csv")
    exact = np.pi / (1 - 0.3**2) * 1e-4
    for found in (run.summary["quantities"]["peak_pressure"], run.history["peak_pressure"][-1],
                  boundaries["peak_pressure"][-1]):
        assert found == pytest.approx(exact, rel=1e-2)


@pytest.mark.slow  # two runs more
def test_a_tie_does_not_depend_on_cut_and_ranks(solved, scene):
    """Same bits on two ranks; the same forces to the tolerance for another cut."""
    text = scene(SIDE, ("macro contact() 5 //", "macro contact() 5 //\nmacro friction() 0.3 //"),
                 ("macro support() on(4, u1 = 0) //\n", ""))
    one, two, other = (solved(text, subdomains=s, np=np_, **TIGHT)
                       for s, np_ in ((5, 1), (5, 2), (1, 1)))
    for name in ("sigma_n", "sigma_t", "u_t"):
        assert np.array_equal(one.contact[name], two.contact[name])
        np.testing.assert_allclose(one.contact[name], other.contact[name],
                                   atol=1e-7 * np.abs(other.contact[name]).max())


# sides of one edge, one end of which is held along x and the other in contact, where the boundary
# has a corner across the period: none is left that could be periodic in this direction
ONE_EDGE = """include "scene.idp"
subdomains("1");
mesh Vee = square(2, 1, [2.*x, y]);
body = movemesh(Vee, [x, y - (1 - y)*0.5*abs(x - 1)]);
macro young() 1000. //
macro poisson() 0.3 //
macro periodic() 2, 4 //
macro displacement1() on(3, u1 = 0.01) //
macro load1() pressure(3, 4.) //
macro contact() 1 //
include "export.idp"
"""


@pytest.mark.parametrize("text, old, new, reason", [
    (SIDE, "[1 + x, y]", "[1.2 + x, y]", "tied boundaries 11 and 21 do not lie on one another"),
    (SIDE, "11, 21 //", "5, 21 //", "label 5 is declared for contact and tied: a boundary has one "
     "law; give its parts labels of their own"),
    (SIDE, "11, 21 //", "11 //", "tie expects pairs of labels"),
    (SIDE, "11, 21 //", "11, 21, 11, 2 //", "tie names label 11 twice"),
    (SIDE, "tie() 11, 21 //", "tie() 11, 21 //\nmacro periodic() 21, 4 //",
     "label 21 is periodic and tied: a boundary has one law; give its parts labels of their own"),
    (STRIP % (5, 5), "periodic() 4, 2", "periodic() 4, 3", "are no translates of one another"),
    (STRIP % (5, 5), "periodic() 4, 2", "periodic() 4, 9", "no boundary with label 9"),
    (ONE_EDGE, "", "", "constrain all nodes of 2: take a finer mesh"),
    (SIDE.replace("square(3, 4", "square(3, 1"), "on(4, u1 = 0)", "on(3, u1 = 0, u2 = 0)",
     "constrain all nodes of 11: name 21 first, or take a finer mesh"),
    (TUBE, "", "", "have different radii"),
    (STRIP % (5, 5), "macro periodic() 4, 2 //", "macro periodic() 4, 2 //\nmacro contact() 2 //",
     "label 2 is periodic and declared for contact")])
@pytest.mark.some(5)
def test_misuse_is_refused_in_one_line(solved, scene, text, old, new, reason):
    run = solved(scene(text, (old, new)))
    assert run.status == 2 and reason in run.reason and "\n" not in run.reason


# one body on a floor with a law on every part of it, and another one tied to its top
LAWS = HEAD + """border floor1(s = 0, 1) { x = s; y = 0; label = 11; }
border floor2(s = 1, 2) { x = s; y = 0; label = 12; }
border floor3(s = 2, 3) { x = s; y = 0; label = 13; }
border floor4(s = 3, 4) { x = s; y = 0; label = 14; }
border floor5(s = 4, 5) { x = s; y = 0; label = 15; }
border right(s = 0, 1) { x = 5; y = s; label = 2; }
border top(s = 5, 0) { x = s; y = 1; label = 3; }
border left(s = 1, 0) { x = 0; y = s; label = 4; }
addBody(buildmesh(floor1(5) + floor2(5) + floor3(5) + floor4(5) + floor5(5) + right(5) + top(21)
                  + left(5)))
int[int] above = [6, 7, 8, 9];
addBody(square(17, 3, [5*x, 1 + 0.5*y], label = above))
""" + MATERIAL + """macro load1() pressure(8, 3.) + traction(7, 3., 20.) //
macro contact() 11, 12, 13, 14, 15 //
macro friction() (label == 12 ? 0.3 : 0.) //
macro tresca() (label == 13 ? 0.5 : 0.) //
macro cohesion() (label == 14 ? 0.8 : 0.) //
macro bilateral() (label == 15) //
macro tie() 6, 3 //
macro probeLabels() [3, 6] //
include "export.idp"
"""


def test_every_label_has_its_law(solved, scene):
    """Frictionless, Coulomb, Tresca, cohesion, bilateral and tied, side by side in one scene.

    Where labels go on in one another a vertex has the mean of both: their ends are left out. The
    tie carries all loads of the upper body; its whole has only friction against the floor.
    """
    run = solved(scene(LAWS), subdomains=3, **TIGHT)
    assert run.status == 0, run.reason
    c = {name: column[-1] for name, column in run.contact.items()}
    inside = np.abs(c["x"] - np.round(c["x"])) > 1e-6
    shear, pressure = np.abs(c["sigma_t"]), np.maximum(-c["sigma_n"], 0)
    bound = {11: 0 * pressure, 12: 0.3 * pressure, 13: 0.5 + 0 * pressure, 14: 0.8 + 0 * pressure,
             15: 0 * pressure}
    slid = np.abs(c["slip"]) > 1e-6 * np.abs(c["slip"]).max()
    for label, most in bound.items():
        here = inside & (c["boundary"] == label)
        assert here.sum() >= 4
        np.testing.assert_allclose(c["bound"][here], most[here], rtol=1e-7, atol=1e-9)
        assert (shear[here] <= most[here] + 1e-7).all()
        slides = here & slid
        np.testing.assert_allclose(shear[slides], most[slides], atol=1e-6)
    pulled = inside & (c["boundary"] == 15)
    np.testing.assert_allclose(c["u_n"][pulled], 0, atol=1e-9)
    assert c["sigma_n"][pulled].max() > 0 and c["sigma_n"][inside & ~pulled].max() <= 0
    table = read_table(run.directory / "probes.csv")
    force = np.column_stack([table["force_x"], table["force_y"]])
    np.testing.assert_allclose(force, [[1.5, 10 - 15], [-1.5, 15 - 10]], atol=1e-6)


# ---- contact goes on beyond the period -----------------------------------------------------------

LAYERS = HEAD + """real start = physical("start", 0.), far = physical("far", 0.1);
int[int] below = [1, 2, 3, 4], above = [11, 12, 13, 14];
addBody(square(CELLS, 2, [4*x, 2*y - 2], label = below)) bodyMaterial("lower", 100., 0.3);
mesh Upper = square(10, 2, [4*x + start, 2*y], label = above);
addBody(movemesh(Upper, [x, y + (2 - y)*WAVES*(1 + cos(pi*x/2))/2]))
  bodyMaterial("upper", 300., 0.2);
quasistatic(2.);
macro periodic() PERIODIC //
macro contactPair() 3, 11 //
macro friction() 0.3 //
MORE
macro support() on(1, u1 = 0., u2 = 0.) //
macro displacement1() on(13, u1 = 0., u2 = -0.02) //
macro amplitude1(t) min(1., t) //
macro displacement2() on(13, u1 = far) //
macro amplitude2(t) max(0., t - 1.) //
include "export.idp"
"""


def layers(cells="8", waves="0.", more="", periodic="2, 4, 12, 14") -> str:
    """Two layers that repeat themselves, the upper one with a surface in waves of that height."""
    given = {"CELLS": cells, "WAVES": waves, "MORE": more, "PERIODIC": periodic}
    return functools.reduce(lambda text, name: text.replace(name, given[name]), given, LAYERS)


@pytest.mark.parametrize("start, far, following, options", [
    (1.0, 0.05, False, {}), (1.0, 0.05, False, {"element": "P2", "subdomains": 5}),
    (0.0, 1.0, True, {}), (1.7, -9.3, True, {"subdomains": 5}),
    pytest.param(1.7, 9.3, True, {"element": "P2", "np": 2, "subdomains": 3},
                 marks=pytest.mark.slow)])  # ranks, a further mesh
@pytest.mark.some(2)
def test_layers_slide_for_ever(solved, scene, start, far, following, options):
    """One layer begins aside of the other, or slides along it by more than two periods.

    Uniaxial strain: p = 0.02 / (2/M_1 + 2/M_2), M = E (1 - nu) / ((1 + nu) (1 - 2 nu)). At the ends
    of the layers, too, to rounding: 1e-9.
    """
    more = "macro largeSliding() 12. //" if following else ""
    run = solved(scene(layers(more=more)), steps=4, start=start, far=far, **TIGHT, **options)
    stiff = [E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) for E, nu in ((100, 0.3), (300, 0.2))]
    pressure = 0.02 / sum(2 / modulus for modulus in stiff)
    sigma_n, sigma_t = (run.contact[name][-1] for name in ("sigma_n", "sigma_t"))
    assert len(sigma_n) > 6 and not run.summary["warnings"]
    np.testing.assert_allclose(sigma_n, -pressure, rtol=1e-9)
    np.testing.assert_allclose(sigma_t, -np.sign(far) * 0.3 * pressure, rtol=1e-9)


@pytest.mark.some(1)
def test_where_layers_begin_does_not_matter(solved, scene):
    """Waves on a flat layer, small displacements: half of the contact with an image, or none.

    """
    runs = [solved(scene(layers("20", "0.05")), steps=4, start=start, far=0.005, **TIGHT)
            for start in (0.0, 2.0)]
    one, other = (run.contact for run in runs)
    assert not any(run.summary["warnings"] for run in runs)
    assert (one["sigma_n"][-1] == 0).any() and runs[1].summary["validity"]["verdict"] == "ok"
    for name in ("sigma_n", "sigma_t"):
        np.testing.assert_allclose(other[name], one[name], atol=1e-8 * np.abs(one[name]).max())
    assert runs[1].summary["validity"]["largest_normal_error"] < 1e-3  # 3e-3 of the layer alone


@pytest.mark.some(1)
def test_contact_where_the_period_ends_is_that_within(solved, scene):
    """The crest of the layer that carries the contact nodes at both its ends, and in the middle.

    They are one place with one condition: the same numbers, to what residuals leave.
    """
    text = layers("40", "0.08").replace("3, 11 //", "11, 3 //").replace("square(10", "square(40")
    one, other = (solved(scene(text), steps=4, start=start, far=0.05, **TIGHT).summary
                  for start in (2.0, 4.0))
    for name, value in one["quantities"].items():
        assert value == pytest.approx(other["quantities"][name], rel=1e-7), name


WAVE = """include "scene.idp"
real start = physical("start", 0.);
mesh Wave = square(40, 8, [4*x + start, 2*y]);
body = movemesh(Wave, [x, y + (2 - y)*(SHAPE)]);
macro young() 300. //
macro poisson() 0.2 //
macro periodic() 2, 4 //
macro contact() 1 //
macro obstacle(x, y) y //
macro friction() 0.3 //
SLIDING
macro displacement1() on(3, u1 = 0.05, u2 = -0.02) //
include "export.idp"
"""


ROUND, SHARP = "0.04*(1 + cos(pi*x/2))", "abs(x - 2 - 4*rint((x - 2)/4))/4"


@pytest.mark.parametrize("shape, sliding, element", [
    (ROUND, "", "P1"), (ROUND, "", "P2"), (ROUND, "macro largeSliding() 0.2 //", "P1"),
    (SHARP, "", "P1")])
@pytest.mark.some(1)
def test_a_crest_where_the_period_ends_is_as_one_within(solved, scene, shape, sliding, element):
    """A wave, or a tooth, that slides on a rigid plane: on one mesh the same numbers, wherever it
    begins.

    With linear elements to what residuals leave. Quadratic ones know the curve from one side alone
    where a boundary ends, which moves the middles of sides there by 1e-4 of the height of contact.
    """
    text = WAVE.replace("SLIDING", sliding).replace("SHAPE", shape)
    one, other = (solved(scene(text), start=start, element=element, **TIGHT).summary
                  for start in (2.0, 4.0))
    for name, value in one["quantities"].items():
        off = {"P1": 1e-7, "P2": 2e-3}[element]
        assert value == pytest.approx(other["quantities"][name], rel=off), name


def test_bodies_in_contact_have_one_period(solved, scene):
    """Layers of 4 and 2: how often the one is pressed by the other is not said."""
    text = layers().replace("[4*x + start, 2*y]", "[2*x + start, 2*y]")
    run = solved(scene(text), steps=2)
    assert run.status == 2 and "give them one period" in run.reason
