"""Materials body by body: bodyMaterial against young and poisson by region, and misuse."""

import re

import numpy as np
import pytest

from driver.errors import InputError
from driver.scene.manifest import read_manifest
from driver.units import assumed

# two squares side by side, unlike ones, pulled apart by different forces: plane stress bars
BARS = """include "scene.idp"
subdomains("auto");
int[int] one = [1, 2, 3, 4], other = [11, 12, 13, 14];
addBody(square(4, 4, [x, y], label = one, region = 5))
bodyMaterial("steel", 200., 0.);
addBody(square(3, 3, [2 + x, y], label = other, region = 7))
bodyMaterial("rubber", 4., 0.);
macro support() on(4, 14, u1 = 0, u2 = 0) //
macro load1() traction(2, 1., 0.) + traction(12, 1., 0.) //
macro probeLabels() [2, 12] //
include "export.idp"
"""


@pytest.fixture
def changed(tmp_path):
    """changed(old, new): path of the scene with a line replaced."""
    def make(old: str = "", new: str = ""):
        assert old in BARS
        path = tmp_path / "bars.edp"
        path.write_text(BARS.replace(old, new))
        return path
    return make


@pytest.mark.parametrize("options", [{}, {"element": "P2", "subdomains": 5}, {"np": 2}])
@pytest.mark.some(2)
def test_every_body_has_its_own(solved, changed, options):
    """u = x/E on either bar; named in summary.json."""
    run = solved(changed(), rtol=1e-11, **options)
    ends = {probe["probe"]: probe["u_x"] for probe in run.summary["probes"]}
    assert ends == pytest.approx({"label2": 1 / 200, "label12": 1 / 4}, rel=1e-9)
    assert [(m["body"], m["name"], m["young"]) for m in run.summary["materials"]] == [
        (1, "steel", 200.0), (2, "rubber", 4.0)]


def test_regions_still_give_materials(solved, changed, tmp_path):
    """The same stiffness by region: the same bits."""
    text = BARS.replace('bodyMaterial("steel", 200., 0.);\n', "").replace(
        'bodyMaterial("rubber", 4., 0.);\n',
        "macro young() (region == 5 ? 200. : 4.) //\nmacro poisson() 0. //\n")
    path = tmp_path / "regions.edp"
    path.write_text(text)
    named, region = solved(changed()), solved(path)
    assert named.summary["probes"] == region.summary["probes"]
    assert "materials" not in region.summary


@pytest.mark.parametrize("calls, said", [("", 1), ('units("m", "Pa");', 0)])
def test_units_that_a_scene_does_not_name_are_assumed_aloud(solved, changed, calls, said):
    """Tables of a scene in mm and MPa that lacks units() say m and Pa; one in m may name them."""
    run = solved(changed('subdomains("auto");', f'subdomains("auto");{calls}'))
    units = run.summary["units"]
    assert (units["length"], units["stress"]) == ("m", "Pa")
    assert len(assumed(units)) == said


@pytest.mark.parametrize("old, new, reason", [
    ('bodyMaterial("rubber", 4., 0.);\n', "", "body 2 has no material"),
    ('"rubber", 4., 0.', '"rubber", -4., 0.', "bodyMaterial of rubber"),
    ('"rubber", 4., 0.', '"rubber", 4., 0.5',
     "poisson = 0.5 is not between -1 and 0.5 in region 7: of a material that keeps its volume"),
    ('subdomains("auto");', 'bodyMaterial("air", 1., 0.);', "after addBody"),
    ('bodyMaterial("rubber", 4., 0.);', 'bodyMaterial("a", 4., 0.); bodyMaterial("b", 4., 0.);',
     "twice for body 2"),
    ("macro support", "macro young() 2. //\nmacro poisson() 0. //\nmacro support",
     "young or c11 is declared"),
    ("macro support", "macro poisson() 0. //\nmacro support", "poisson is declared")])
def test_misuse_is_refused_in_one_line(solved, changed, old, new, reason):
    run = solved(changed(old, new))
    assert run.status == 2 and reason in run.reason


RUBBER = """include "scene.idp"
units("mm", "MPa");
body = square(8, 4, [4*x, 2*y]);
macro young() 3. //
macro poisson() 0.5 //
macro planeStress() 1 //
macro support() on(4, u1 = 0.) + on(1, u2 = 0.) //
macro load1() pressure(2, 0.2) //
macro contact() 3 //
macro gap() 0.02 //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("material", [
    "", 'bodyMaterial("rubber", 3., 0.5);'])
def test_a_thin_body_may_keep_its_volume(solved, named_scene, material, element):
    """A strip of rubber that widens between walls: E eps_y = sigma_y - nu sigma_x.

    It widens by 0.01 of its width, where without walls it would be nu 0.2 / E; sigma_y = -0.07.
    """
    text = RUBBER
    if material:
        text = text.replace("macro young() 3. //\nmacro poisson() 0.5 //\n", material + "\n")
    run = solved(named_scene("rubber", text), element=element, subdomains=5, rtol=1e-11)
    np.testing.assert_allclose(run.contact["sigma_n"], 3 * 0.01 - 0.5 * 0.2, rtol=1e-8)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_directed_material_is_strained_by_its_own_law(solved, tmp_path, element):
    """Patch test: displacements of a uniform strain e on two sides and the tractions of s = C e on
    the others give it everywhere; C is any positive matrix in which nothing is zero.
    """
    C = np.array([[9.0, 2.0, 1.0], [2.0, 5.0, -1.5], [1.0, -1.5, 4.0]])
    a, b, c, d = 0.01, -0.03, 0.02, 0.04  # u = (a x + b y, c x + d y)
    s11, s22, s12 = C @ [a, d, b + c]
    entries = "\n".join(f"macro c{i + 1}{j + 1}() {C[i, j]} //"
                        for i, j in zip(*np.triu_indices(3)))
    path = tmp_path / "directed.edp"
    path.write_text(f"""include "scene.idp"
subdomains("2");
rectangle(0., 2., 0., 1.);
{entries}
func real ux(real p, real q) {{ return {a}*p + ({b})*q; }}
func real uy(real p, real q) {{ return {c}*p + {d}*q; }}
macro displacement1() on(1, 4, u1 = ux(x, y), u2 = uy(x, y)) //
macro load1() traction(2, {s11}, {s12}) + traction(3, {s12}, {s22}) //
macro probePoints() [2., 1., 1.3, 0.6] //
include "export.idp"
""")
    run = solved(path, element=element, cells=3, rtol=1e-12)
    assert run.status == 0, run.reason
    for probe, (x, y) in zip(run.summary["probes"], [(2, 1), (1.3, 0.6)]):
        expected = [a * x + b * y, c * x + d * y]
        assert [probe["u_x"], probe["u_y"]] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_laws_are_positive_definite(built, named_scene, part):
    """In which nothing is zero: a little less of c33 than makes the determinant zero, and more."""
    C = np.array([[9.0, 2.0, 3.0], [2.0, 5.0, -2.0], [3.0, -2.0, 0.0]])
    C[2, 2] = part * C[2, :2] @ np.linalg.solve(C[:2, :2], C[:2, 2])
    laws = "\n".join(f"macro c{i + 1}{j + 1}() {C[i, j]} //" for i, j in zip(*np.triu_indices(3)))
    scene = named_scene(f"law{part}", f"""include "scene.idp"
rectangle(0., 1., 0., 1.);
{laws}
macro support() on(4, u1 = 0, u2 = 0) //
include "export.idp"
""")
    if part > 1:
        assert np.linalg.eigvalsh(C)[0] > 0 and built(scene, reduce=False, cells=2).subdomains
        return
    with pytest.raises(InputError, match="not positive definite"):
        built(scene, reduce=False, cells=2)


def test_plane_stress_of_a_general_law_is_refused(built, named_scene):
    """The law is that of the plane already: the declaration would change nothing."""
    laws = "".join(f"macro c{k}() {v} //\n" for k, v in
                   ((11, 3), (12, 1), (13, 0), (22, 3), (23, 0), (33, 1)))
    scene = named_scene("stressed", f"""include "scene.idp"
rectangle(0., 1., 0., 1.);
{laws}macro planeStress() 1 //
macro support() on(4, u1 = 0, u2 = 0) //
include "export.idp"
""")
    with pytest.raises(InputError, match="take planeStress out"):
        built(scene, reduce=False, cells=2)


@pytest.mark.parametrize("laws", [
    "macro c22() signOfStiffness //\nmacro c33() signOfStiffness //",
    "macro c22() 1. //\nmacro c33() signOfStiffness //"])
def test_the_region_with_an_indefinite_law_is_named(built, named_scene, laws):
    """In the middle of another; also where the law's determinant is positive and a minor is not."""
    scene = named_scene("regions", f"""include "scene.idp"
body = square(6, 3, [2*x, y]);
body = change(body, fregion = (x > 0.7 && x < 1.3 ? 4 : 0));
macro signOfStiffness() (region == 0 ? 1. : -1.) //
macro c11() 1. //
{laws}
macro c12() 0. //
macro c13() 0. //
macro c23() 0. //
macro support() on(4, u1 = 0, u2 = 0) //
include "export.idp"
""")
    with pytest.raises(InputError, match="not positive definite in region 4"):
        built(scene, reduce=False)


UNEVEN = """include "scene.idp"
subdomains("3");
body = square(6, 3, [2*x, y]);
macro young() (YOUNG) //
macro poisson() 0. //
macro support() on(4, u1 = 0., u2 = 0.) //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("young, integral", [("1 + x^2*y^2", 2 + 8 / 9),
                                             ("x < 1 ? 1. : 1000.", 1001.0),
                                             ("x <= 1 ? 1. : 1000.", 1001.0)])
@pytest.mark.some(2)
def test_moduli_are_those_inside_triangles(built, tmp_path, element, young, integral):
    """u = (x, 0) on [0, 2] x [0, 1] takes the energy int E/2, E of a polynomial or with a jump on
    sides, where it is that of either neighbour.

    FreeFEM's own rule is exact to degree 5; those that suffice for constant moduli are not, and
    have points on the sides.
    """
    path = tmp_path / "uneven.edp"
    path.write_text(UNEVEN.replace("YOUNG", young))
    energy = 0.0
    for sub in built(path, reduce=False, element=element).subdomains:
        u = np.zeros(sub.dofs)
        u[0::2] = sub.xy[:, 0]
        energy += u @ (sub.stiffness @ u) / 2
    assert energy == pytest.approx(integral / 2, rel=1e-13)


EXPANDING = """include "scene.idp"
subdomains("2");
body = square(5, 4, [1 + x, y + 0.1*x*y]);
macro young() (100. + 300.*x) //
macro poisson() 0.45 //
macro thermal1() 0.01 //
macro support() on(4, u1 = 0., u2 = 0.) //
MORE
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2", "P2-mixed"])
@pytest.mark.parametrize("more", ["", "macro curved() 2 //", "macro axisymmetric() 1 //"],
                         ids=["plane", "curved", "revolved"])
@pytest.mark.some(3)
def test_a_body_of_any_modulus_expands_without_stress(built, tmp_path, element, more):
    """The stiffness times the displacement of free expansion is the thermal load, node by node: to
    rounding, as both are polynomials that the rules integrate exactly where the modulus is linear.
    """
    path = tmp_path / "expanding.edp"
    path.write_text(EXPANDING.replace("MORE", more))
    strain = 0.01 if "axi" in more else 1.45 * 0.01  # of a plane body, which is held across
    for sub in built(path, reduce=False, element=element).subdomains:
        missing = sub.stiffness @ (strain * sub.xy).ravel() - sub.loads[0]
        assert np.abs(missing).max() <= 1e-12 * np.abs(sub.loads[0]).max()


LAYERS = """include "scene.idp"
border low(t=0, 2) { x = t; y = 0.; label = 1; }
border east(t=0, 1) { x = 2.; y = t; label = 2; }
border top(t=2, 0) { x = t; y = 1.; label = 3; }
border west(t=1, 0) { x = 0.; y = t; label = 4; }
border between(t=0, 2) { x = t; y = 0.5; label = 5; }
body = buildmesh(low(7) + east(4) + top(7) + west(4) + between(7));
macro young() (y > HEIGHT ? 2e5 : SOFT) //
macro poisson() 0.3 //
macro support() on(4, u1 = 0, u2 = 0) //
macro load1() traction(2, 1., 0.) //
include "export.idp"
"""


@pytest.mark.parametrize("height, soft, said", [
    ("0.5", "1e2", False), ("0.57", "1e2", True), ("9.", "2e5*(1 + x/2.)", False)])
def test_a_modulus_that_jumps_inside_triangles_is_said(exported, tmp_path, height, soft, said):
    """Such triangles are of neither material, and no estimate of errors sees why it is large."""
    path = tmp_path / "layers.edp"
    path.write_text(LAYERS.replace("HEIGHT", height).replace("SOFT", soft))
    notes = read_manifest(exported(path)).notes
    assert any(note.startswith("young jumps") for note in notes) == said and len(notes) == said


@pytest.mark.parametrize("cut", ["2x1", "2"])
@pytest.mark.parametrize("height, mixed", [("0.4", 0), ("0.5", 20)])
def test_how_many_triangles_a_jump_crosses_is_said_of_rectangles_too(exported, tmp_path, cut,
                                                                     height, mixed):
    """Of five rows of ten cells the middle one, y from 0.4 to 0.6, has the jump in all triangles;
    pieces cut alike have no mesh of the whole.
    """
    text = LAYERS[:LAYERS.index("border")] + "rectangle(0., 2., 0., 1.);\n" + LAYERS[
        LAYERS.index("macro"):]
    path = tmp_path / "rows.edp"
    path.write_text(text.replace("HEIGHT", height).replace("SOFT", "1e2"))
    notes = read_manifest(exported(path, cells=5, subdomains=cut)).notes
    assert len(notes) == (mixed > 0)
    for note in notes:
        words = r"inside (\d+) triangles, the first at \((.*), (.*)\)"
        count, x, y = re.search(words, note).groups()
        # the graph partition of a rectangle has cells of its own size
        assert int(count) == mixed if cut == "2x1" else 0 < int(count) < 40
        assert 0 < float(x) < 0.3 and abs(float(y) - 0.5) < 0.1
