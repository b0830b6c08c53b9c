"""The scene library: obstacles, several contact labels, point loads, gmsh bodies; bad scenes are
refused in one line.
"""

import re

import numpy as np
import pytest

BLOCK = '''include "scene.idp"
{extra}
subdomains("4x2");
{body}
macro young() {young} //
macro poisson() {poisson} //
macro support() {support} //
macro load1() {load} //
{contact}
include "export.idp"
'''
PARTS = dict(extra="", body="rectangle(0., 2., 0., 1.);", young="1.", poisson="0.3",
             support="on(4, u1 = 0., u2 = 0.)",
             load="pressure(3, 0.01)", contact="macro contact() 1 //")


@pytest.fixture
def scene(tmp_path):
    count = iter(range(100))

    def write(**parts):
        path = tmp_path / f"block{next(count)}.edp"  # runs are kept by the name of their scene
        path.write_text(BLOCK.format(**{**PARTS, **parts}))
        return path

    return write


@pytest.mark.parametrize("parts, said", [
    (dict(contact="macro contact() 7 //"), "label 7; its labels are 1, 2, 3, 4"),
    (dict(load="pressure(8, 1.)"), "label 8"),
    (dict(contact="macro friction() 0.3 //"), "friction is declared without contact"),
    (dict(contact="macro gap() 0.3 //"), "gap is declared without contact"),
    (dict(contact="macro contact() 1 //\nmacro friction() (0.5 - x) //"),
     "friction is negative on label 1"),
    (dict(contact="macro contact() 1 //\nmacro friction() 1. //\nmacro tresca() 1. //"),
     "one friction law"),
    (dict(body="rectangle(0., 2., 0., 1.);\nrotate(30.);", contact="macro contact() 4 //"),
     "overlap on label 4"),
    (dict(contact="macro contact() 1 //\nmacro contactNormal() [0., 1.] //"),
     "does not point out of the body on label 1"),
    (dict(young="(x > 1 ? -1. : 1.)"), "young = -1"),
    (dict(poisson="0.5"), "poisson = 0.5"),
    (dict(support="on(9, u1 = 0., u2 = 0.)"),
     "line 7: on(9, ...) names no boundary of the mesh"),
    (dict(body="mesh T = square(60, 3);\n"
               "body = movemesh(T, [(1.2 - 0.2*y)*cos(6.6*x), (1.2 - 0.2*y)*sin(6.6*x)]);"),
     "penetrates itself or another one: outlines cross near"),
    (dict(body="body = square(4, 4) + square(4, 4, [x + 3, y]);"), "not connected"),
    (dict(body="body = trunc(square(4, 4), nuTriangle < 8 || nuTriangle == 31);"), "not connected"),
    (dict(contact="macro pointLoad1() [0.52, 0.5, 1., 0.] //"),
     "no vertex of the mesh at (0.52, 0.5)"),
    (dict(extra='include "gmsh.idp"', body='body = gmshBody("nowhere.geo", 0.1);'), "nowhere.geo"),
    (dict(contact="macro thermal() 1e-3 //"), "thermal needs a number: thermal1 ... thermal9"),
    (dict(contact="macro amplitude(t) t //"), "amplitude needs a number"),
], ids=lambda value: value if isinstance(value, str) else "")
@pytest.mark.some(6)
def test_bad_scene_is_refused_in_one_line(solved, scene, parts, said):
    run = solved(scene(**parts))
    assert run.status == 2
    assert said in run.reason and "\n" not in run.reason


def test_several_contact_labels_have_their_own_data(solved, scene):
    run = solved(scene(contact="macro contact() 1, 2 //\n"
                               "macro friction() (label == 1 ? 0.2 : 0.5) //\n"
                               "macro gap() (label == 2 ? 0.01 : 0.) //"), cells=5)
    c = run.contact
    assert set(c["boundary"][0]) == {1, 2}
    touching = c["status"] != "open"
    # the data are constant along a label: exact but for the quadrature's rounding
    expected = np.where(c["boundary"] == 1, 0.2, 0.5) * np.abs(c["sigma_n"])
    np.testing.assert_allclose(c["bound"][touching], expected[touching], rtol=1e-12)
    np.testing.assert_allclose(c["gap"], np.where(c["boundary"] == 2, 0.01, 0.0), atol=1e-14)


def test_friction_and_tresca_follow_the_place(solved, scene):
    for law, scale in (("friction", lambda c: np.abs(c["sigma_n"])), ("tresca", lambda c: 1.0)):
        c = solved(scene(contact=f"macro contact() 1 //\nmacro {law}() (0.1 + 0.2*x) //"), cells=5,
                   rtol=1e-9).contact
        # the last node has half a segment, whose lumped data are still its own
        inside = c["x"] < 1.99
        np.testing.assert_allclose(c["bound"][inside], ((0.1 + 0.2 * c["x"]) * scale(c))[inside],
                                   rtol=1e-10, atol=1e-15)


def test_obstacle_gives_normal_and_gap(solved, scene):
    # phi = y - 0.1 x - 0.05 x^2 + 0.3: differences are exact for quadratics up to 1e-16/1e-5
    obstacle = "macro obstacle(x, y) (y - 0.1*x - 0.05*x^2 + 0.3) //"
    c = solved(scene(contact=f"macro contact() 1 //\n{obstacle}"), cells=4).contact
    slope, phi = -0.1 - 0.1 * c["x"], 0.3 - 0.1 * c["x"] - 0.05 * c["x"] ** 2
    size = np.hypot(slope, 1)
    np.testing.assert_allclose(c["normal_x"], -slope / size, atol=1e-9)
    np.testing.assert_allclose(c["normal_y"], -1 / size, atol=1e-9)
    np.testing.assert_allclose(c["gap"], phi / size, atol=1e-9)


@pytest.mark.parametrize("subdomains", ["4x2", "5"])
def test_point_load_acts_once(solved, scene, subdomains):
    # the first point is shared by four subdomains of the structured partition
    run = solved(scene(load="pressure(3, 0.)",
                       contact="macro pointLoad2() [1., 0.5, 1., 2., 2., 1., 0., 4.] //"),
                 subdomains=subdomains, cells=4 if subdomains == "4x2" else 5)  # "5": 16 x 8 cells
    np.testing.assert_allclose([run.history["load_x"][0], run.history["load_y"][0]], [1.0, 6.0],
                               rtol=1e-12)
    np.testing.assert_allclose([run.history["reaction_x"][0], run.history["reaction_y"][0]],
                               [-1.0, -6.0], rtol=1e-9)


GEO = """DefineConstant[ h = {0.5} ];
Point(1) = {0, 0, 0, h}; Point(2) = {2, 0, 0, h}; Point(3) = {2, 1, 0, h};
Point(4) = {0, 1, 0, h}; Point(5) = {9, 9, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {-1, -4, -3, -2};
Plane Surface(1) = {1};
Physical Curve(1) = {1}; Physical Curve(2) = {2}; Physical Curve(3) = {3}; Physical Curve(4) = {4};
Physical Surface(1) = {1};
"""


def test_gmsh_body_with_clockwise_surface_and_stray_point(solved, scene, tmp_path):
    (tmp_path / "box.geo").write_text(GEO)
    run = solved(scene(extra='include "gmsh.idp"',
                       body='body = gmshBody("box.geo", meshSize(0.3));',
                       young="(region == 1 ? 1. : 2.)"),
                 subdomains=3, h=0.2)
    assert run.status == 0
    assert run.history["load_y"][0] == pytest.approx(-0.02, rel=1e-12)  # pressure times length
    finer = solved(scene(extra='include "gmsh.idp"',
                         body='body = gmshBody("box.geo", meshSize(0.3));'), subdomains=3, h=0.1)
    assert finer.summary["sizes"]["primal_dofs"] > 2 * run.summary["sizes"]["primal_dofs"]
    none = solved(scene(extra='include "gmsh.idp"', body='body = gmshBody("box.geo", 0.);'))
    assert none.status == 2 and 'gmshBody("box.geo", 0) has an element size that' in none.reason


def test_what_helps_to_draw_a_geometry_is_no_part_of_the_body(solved, scene, tmp_path):
    """Points and curves apart from its surface, at another z or where a corner is, change no bit.
    """
    drawn = """Point(6) = {-5, 9, 3, h}; Point(7) = {-6, 9, 3, h}; Line(6) = {6, 7};
Point(8) = {0, 0, 0, h};
Physical Point(1) = {5}; Physical Point(2) = {8}; Physical Curve(7) = {6};
"""
    runs = []
    for name, more in (("bare", ""), ("drawn", drawn)):
        (tmp_path / f"{name}.geo").write_text(GEO + more)
        runs.append(solved(scene(extra='include "gmsh.idp"',
                                 body=f'body = gmshBody("{name}.geo", 0.3);'), subdomains=2))
    assert [run.status for run in runs] == [0, 0]
    for name, column in runs[0].contact.items():
        np.testing.assert_array_equal(column, runs[1].contact[name])


def test_a_surface_that_no_physical_group_has_is_missed(solved, scene, tmp_path):
    """Its curves hang on the body, or stand apart, whatever else the file draws."""
    curves = GEO.replace("Physical Surface(1) = {1};\n", "").replace("Physical Curve(2) = {2};", "")
    beside = """Point(6) = {3, 0, 0, h}; Point(7) = {3, 1, 0, h};
Line(5) = {2, 6}; Line(6) = {6, 7}; Line(7) = {7, 3};
Curve Loop(2) = {5, 6, 7, -2}; Plane Surface(2) = {2};
Physical Curve(2) = {6};
"""
    said = {}
    for name, more in (("hanging", "Physical Curve(5) = {5}; Physical Surface(1) = {1};"),
                       ("apart", "Physical Surface(1) = {1};"),
                       ("whole", "Physical Curve(5) = {5}; Physical Surface(1) = {1, 2};")):
        (tmp_path / f"{name}.geo").write_text(curves + beside + more + "\n")
        said[name] = solved(scene(extra='include "gmsh.idp"', load="pressure(2, 0.01)",
                                  body=f'body = gmshBody("{name}.geo", 0.3);'))
    assert [run.status for run in said.values()] == [2, 2, 0]
    assert ("the physical curve 5 of hanging.geo leads to where there are no triangles"
            in said["hanging"].reason)
    assert "label 2" in said["apart"].reason


@pytest.mark.parametrize("name, text, words", [
    ("meshes", None, "meshes is a directory: gmshBody takes a .geo or a .msh"),
    ("box.step", "", "box.step has no triangles: gmshBody takes a .geo or a .msh; of another file"),
    ("solid.geo", GEO.replace("Physical Surface(1) = {1};", "e[] = Extrude {0, 0, 1} {Surface{1};};"
                              " Physical Volume(1) = {1};"),
     "solid.geo is a body in three dimensions: mesh its plane section"),
    ("bare.geo", GEO.replace("Physical Surface(1) = {1};", ""),
     "bare.geo has no triangles: give its surfaces a Physical Surface")])
def test_what_holds_no_plane_body_is_said(solved, scene, tmp_path, name, text, words):
    if text is None:
        (tmp_path / name).mkdir()
    else:
        (tmp_path / name).write_text(text)
    run = solved(scene(extra='include "gmsh.idp"', body=f'body = gmshBody("{name}", 0.3);'))
    assert run.status == 2 and re.search(r"\.edp line \d+: " + re.escape(words), run.reason)


def test_material_must_be_declared_and_stable(solved, scene, tmp_path):
    bare = tmp_path / "bare.edp"
    bare.write_text(scene().read_text().replace("macro young() 1. //\n", ""))
    assert "no material" in solved(bare).reason
    soft = tmp_path / "soft.edp"
    soft.write_text(scene().read_text().replace(
        "macro young() 1. //\nmacro poisson() 0.3 //",
        "macro c11() 1. //\nmacro c12() 2. //\nmacro c13() 0. //\n"
        "macro c22() 1. //\nmacro c23() 0. //\nmacro c33() 1. //"))
    found = solved(soft)
    assert found.status == 2 and "not positive definite" in found.reason


def test_isotropic_and_general_law_agree(solved, scene, tmp_path):
    """c11 = c22 = lambda + 2 mu, c12 = lambda, c33 = mu: the same body, so equal but for rounding.
    """
    lam, mu = 0.3 / (1.3 * 0.4), 1 / 2.6
    general = tmp_path / "general.edp"
    general.write_text(scene().read_text().replace(
        "macro young() 1. //\nmacro poisson() 0.3 //",
        f"macro c11() {lam + 2 * mu!r} //\nmacro c12() {lam!r} //\nmacro c13() 0. //\n"
        f"macro c22() {lam + 2 * mu!r} //\nmacro c23() 0. //\nmacro c33() {mu!r} //"))
    one, two = solved(scene(), cells=5, rtol=1e-12), solved(general, cells=5, rtol=1e-12)
    # condition of F below 1e4
    np.testing.assert_allclose(two.contact["sigma_n"], one.contact["sigma_n"], atol=1e-8 * 0.01)


def test_residuals_of_an_unloaded_step_are_relative_to_the_run(solved):
    """The bar's last step has no load and no displacement; its rounding is no residual of order
    one.
    """
    found = solved("bar", cells=4)
    assert found.history["max_displacement"][-1] < 1e-9 * found.history["max_displacement"].max()
    assert max(found.summary["residuals"].values()) < 1e-5


def test_steps_tighten_mprgp_until_displacements_are_good(solved):
    """rtol = 1e-3 of the displacements without contact would leave jumps of a percent of the real
    ones.
    """
    loose = solved(cells=5, rtol=1e-3, friction_rtol=1e-3, primal_rtol=0.5, steps=5)
    tight = solved(cells=5, rtol=1e-3, friction_rtol=1e-3, primal_rtol=1e-4, steps=5)
    worst = [max(run.summary["residuals"][name] for name in ("gluing", "penetration"))
             for run in (loose, tight)]
    assert worst[0] > 1e-3 and worst[1] <= 1e-4
    assert not tight.summary["warnings"]
