"""The scene library: obstacles, several contact labels, point loads, gmsh bodies; bad scenes are refused in one line."""

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
PARTS = dict(extra="", body="rectangle(0., 2., 0., 1.);", young="1.", poisson="0.3", support="on(4, u1 = 0., u2 = 0.)",
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
    (dict(contact="macro contact() 1 //\nmacro friction() (0.5 - x) //"), "friction is negative on label 1"),
    (dict(contact="macro contact() 1 //\nmacro friction() 1. //\nmacro tresca() 1. //"), "one friction law"),
    (dict(contact="macro contact() 4 //"), "overlap on label 4"),
    (dict(contact="macro contact() 1 //\nmacro contactNormal() [0., 1.] //"), "does not point out of the body on label 1"),
    (dict(young="(x > 1 ? -1. : 1.)"), "young = -1"),
    (dict(poisson="0.5"), "poisson = 0.5"),
    (dict(body="body = square(4, 4) + square(4, 4, [x + 3, y]);"), "not connected"),
    (dict(contact="macro pointLoad1() [0.52, 0.5, 1., 0.] //"), "no vertex of the mesh at (0.52, 0.5)"),
    (dict(extra='include "gmsh.idp"', body='body = gmshBody("nowhere.geo", 0.1);'), "nowhere.geo"),
], ids=lambda value: value if isinstance(value, str) else "")
def test_bad_scene_is_refused_in_one_line(solved, scene, parts, said):
    run = solved(scene(**parts))
    assert run.status == 2
    assert said in run.reason and "\n" not in run.reason


def test_several_contact_labels_have_their_own_data(solved, scene):
    run = solved(scene(contact="macro contact() 1, 2 //\nmacro friction() (label == 1 ? 0.2 : 0.5) //\n"
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
        c = solved(scene(contact=f"macro contact() 1 //\nmacro {law}() (0.1 + 0.2*x) //"), cells=5, rtol=1e-9).contact
        inside = c["x"] < 1.99  # the last node has half a segment, whose lumped data are still its own
        np.testing.assert_allclose(c["bound"][inside], ((0.1 + 0.2 * c["x"]) * scale(c))[inside], rtol=1e-10, atol=1e-15)


def test_obstacle_gives_normal_and_gap(solved, scene):
    # phi = y - 0.1 x - 0.05 x^2 + 0.3: differences are exact for quadratics up to 1e-16/1e-5
    c = solved(scene(contact="macro contact() 1 //\nmacro obstacle(x, y) (y - 0.1*x - 0.05*x^2 + 0.3) //"), cells=4).contact
    slope, phi = -0.1 - 0.1 * c["x"], 0.3 - 0.1 * c["x"] - 0.05 * c["x"] ** 2
    size = np.hypot(slope, 1)
    np.testing.assert_allclose(c["normal_x"], -slope / size, atol=1e-9)
    np.testing.assert_allclose(c["normal_y"], -1 / size, atol=1e-9)
    np.testing.assert_allclose(c["gap"], phi / size, atol=1e-9)


@pytest.mark.parametrize("subdomains", ["4x2", "5"])
def test_point_load_acts_once(solved, scene, subdomains):
    # the first point is shared by four subdomains of the structured partition
    run = solved(scene(load="pressure(3, 0.)", contact="macro pointLoad2() [1., 0.5, 1., 2., 2., 1., 0., 4.] //"),
                 subdomains=subdomains, cells=4 if subdomains == "4x2" else 5)  # "5": 16 x 8 cells
    np.testing.assert_allclose([run.history["load_x"][0], run.history["load_y"][0]], [1.0, 6.0], rtol=1e-12)
    np.testing.assert_allclose([run.history["reaction_x"][0], run.history["reaction_y"][0]], [-1.0, -6.0], rtol=1e-9)


GEO = """DefineConstant[ h = {0.5} ];
Point(1) = {0, 0, 0, h}; Point(2) = {2, 0, 0, h}; Point(3) = {2, 1, 0, h}; Point(4) = {0, 1, 0, h}; Point(5) = {9, 9, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {-1, -4, -3, -2};
Plane Surface(1) = {1};
Physical Curve(1) = {1}; Physical Curve(2) = {2}; Physical Curve(3) = {3}; Physical Curve(4) = {4};
Physical Surface(1) = {1};
"""


def test_gmsh_body_with_clockwise_surface_and_stray_point(solved, scene, tmp_path):
    (tmp_path / "box.geo").write_text(GEO)
    run = solved(scene(extra='include "gmsh.idp"', body='body = gmshBody("box.geo", meshSize(0.3));', young="(region == 1 ? 1. : 2.)"),
                 subdomains=3, h=0.2)
    assert run.status == 0
    assert run.history["load_y"][0] == pytest.approx(-0.02, rel=1e-12)  # pressure times length
    finer = solved(scene(extra='include "gmsh.idp"', body='body = gmshBody("box.geo", meshSize(0.3));'), subdomains=3, h=0.1)
    assert finer.summary["sizes"]["primal_dofs"] > 2 * run.summary["sizes"]["primal_dofs"]
