"""Contents of macros are whole numbers of the scene: sums need no parentheses."""

import numpy as np
import pytest

BLOCK = """include "scene.idp"
rectangle(0., 2., 0., 1.);
subdomains("2x1");
quasistatic(1.);
macro displacement1() on(3, u1 = 0.004, u2 = -0.01) //
macro contact() 1 //
macro friction() 0.2 + 0.1 //
"""
MATERIAL = "macro young() 60. + 40. //\nmacro poisson() 0.1 + 0.2 //\n"
HOOKE = "".join(f"macro {name}() {value} //\n" for name, value in (
    ("c11", "60. + 90."), ("c12", "20. + 30."), ("c13", "0."), ("c22", "100. + 20."),
    ("c23", "1. + 1."), ("c33", "20. + 20.")))


@pytest.mark.parametrize("declared", [
    MATERIAL + "macro gap() 0.001 + 0.002 //\n",
    MATERIAL + "macro obstacle(x, y) y + 0.003 //\n",
    MATERIAL + "macro obstacle(x, y) y - 0.001*x + 0.003 //\n",
    MATERIAL + "macro initialX() 0.001 + 0.001*x //\n",
    MATERIAL + "real slipRange = 0.01;\nmacro slipFactor(s) 1. - 10.*s //\n",
    HOOKE])
@pytest.mark.some(1)
def test_sums_mean_what_they_mean_in_parentheses(solved, tmp_path, declared):
    """The same scene with every content in parentheses has the same results."""
    wrapped = "\n".join(
        line.replace(") ", ") (", 1).replace(" //", ") //") if line.startswith("macro") else line
        for line in declared.splitlines()) + "\n"
    tables = []
    for name, text in (("plain", declared), ("wrapped", wrapped)):
        path = tmp_path / f"{name}.edp"
        path.write_text(BLOCK + text + 'include "export.idp"\n')
        tables.append(solved(path, cells=3, steps=2).contact)
    assert np.abs(tables[0]["sigma_n"]).max() > 0.1
    for column in ("gap", "u_n", "u_t", "sigma_n", "sigma_t"):
        np.testing.assert_array_equal(tables[0][column], tables[1][column])


@pytest.mark.parametrize("cut", ["2x1", "3"])
def test_where_a_rectangle_lies_does_not_matter(solved, tmp_path, cut):
    """The same cells, triangles and forces at any place, whatever the signs of its corners."""
    forces = []
    for k, (x, y) in enumerate([(0, 0), (-7, 5)]):
        path = tmp_path / f"at{k}.edp"
        path.write_text(BLOCK.replace("rectangle(0., 2., 0., 1.)",
                                      f"rectangle({x}., {x + 2}., {y}., {y + 1}.)")
                        + MATERIAL + 'include "export.idp"\n')
        run = solved(path, subdomains=cut, cells=3, steps=1, rtol=1e-10)
        place = np.argsort(run.contact["x"][0])
        forces.append(run.contact["sigma_n"][-1, place])
    assert len(forces[0]) > 6
    for other in forces[1:]:
        np.testing.assert_allclose(other, forces[0], rtol=1e-6)


POINTS = """include "scene.idp"
real turn = physical("turn", 0.);
rectangle(-7., -4., 5., 6.);
rotate(turn);
real c = cos(turn*pi/180), s = sin(turn*pi/180);
subdomains("3x1");
macro young() 1. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro pointLoad1() [c*(-4.) - s*6., s*(-4.) + c*6., 1., 2.,
                    c*(-6.) - s*5.5, s*(-6.) + c*5.5, 4., 8.,
                    c*(-4.) - s*5., s*(-4.) + c*5., 16., 32.] //
macro pointLoad2() [c*(-5.) - s*5., s*(-5.) + c*5., 64., 128.] //
include "export.idp"
"""


@pytest.mark.parametrize("options", [
    {"subdomains": "3x1"}, {"subdomains": "3x1", "turn": 30}, {"subdomains": "3"},
    {"subdomains": "3", "turn": -70, "element": "P2"},
    {"subdomains": "3x2", "turn": 200, "element": "P2"}])
def test_point_loads_act_once_at_their_vertices(built, tmp_path, options):
    """On corners of the rectangle, where pieces meet and inside, however it lies and is cut."""
    path = tmp_path / "points.edp"
    path.write_text(POINTS)
    problem = built(str(path), reduce=False, cells=2, **options)
    forces = {}
    for sub in problem.subdomains:
        loads = sub.loads.reshape(2, -1, 2)
        for k, node in np.argwhere(loads.any(axis=2)):
            place = (k, *np.round(sub.xy[node], 9))
            assert place not in forces
            forces[place] = loads[k, node].tolist()
    angle = np.deg2rad(options.get("turn", 0))
    cos, sin = np.cos(angle), np.sin(angle)
    expected = {(k, round(cos * x - sin * y, 9), round(sin * x + cos * y, 9)): force
                for k, x, y, force in ((0, -4, 6, [1, 2]), (0, -6, 5.5, [4, 8]),
                                       (0, -4, 5, [16, 32]), (1, -5, 5, [64, 128]))}
    found, wanted = ({tuple(np.round(np.array(place) + 0.0, 6)): force
                      for place, force in of.items()} for of in (forces, expected))
    assert found == wanted


CORNERS = """include "scene.idp"
body = square(1, 1, [2*x, y]);
macro young() 1. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro pointLoad1() [0., 0., 1., 64., 2., 0., 2., 128., 0., 1., 4., 256., 2., 1., 8., 512.] //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("cut", [1, 2])
def test_every_vertex_takes_the_force_that_is_given_at_it(built, named_scene, element, cut):
    """Two triangles have a vertex of their own each; of those that both share one takes it."""
    problem = built(named_scene("corners", CORNERS), reduce=False, element=element, subdomains=cut)
    taken = {}
    for sub in problem.subdomains:
        for (x, y), force in zip(sub.xy, sub.loads[0].reshape(-1, 2)):
            taken.setdefault((round(x, 9), round(y, 9)), []).extend([force] if force.any() else [])
    places = [(0.0, 0.0), (2.0, 0.0), (0.0, 1.0), (2.0, 1.0)]
    for k, place in enumerate(places):
        assert [of.tolist() for of in taken.pop(place)] == [[2.0**k, 2.0**(k + 6)]]
    assert not any(taken.values())
