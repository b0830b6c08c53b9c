"""The answer does not depend on the cut: every scene that ships in 1 to 16 subdomains and more.

By default a sample; `make test-long` runs all scenes, hard ones included, with P1 and P2.

What may differ: a QP leaves a residual of RTOL ||d|| in displacements that are larger than those
under contact, and forces differ by that times the stiffness: ||d|| is up to 1e3 times the
displacement of a glued body in contact, forces react up to 1e2 times as strongly where contact
changes. FORCES allows this with RTOL = 1e-11. Displacements may jump by PRIMAL_RTOL at every
interface on the way, of which there are fewer than 10: DISPLACEMENTS.
"""

import re

import numpy as np
import pytest

from driver import environment
from driver.scene import freefem

TIGHT = {"rtol": 1e-11, "friction_rtol": 1e-10, "primal_rtol": 1e-7}
FORCES, DISPLACEMENTS = 1e-6, 1e-6
EDP = environment.ROOT / "edp"
# coarse meshes and few steps; scenes that are not named here have no steps to choose
STEPS = {"steps": 4}
OPTIONS = {
    "bar": STEPS, "bimetal": {"h": 0.5}, "bracket": {**STEPS, "h": 8},
    "brake-pad": {"h": 2, "steps": 6}, "cohesion": STEPS, "dovetail": {"h": 1, "steps": 6},
    "drag": {"h": 1, "steps": 8}, "hertz": {"h": 0.004}, "hertz-bodies": {"h": 0.004},
    "indenter": {"h": 0.5, "steps": 6}, "joint": {"h": 2, "steps": 5},
    # rounding of a slender beam's forces leaves jumps of 3e-7
    "latch": {"primal_rtol": 1e-6},
    "mindlin": {"h": 0.004, "steps": 5}, "mindlin-bodies": {"steps": 3, "h": 0.05}, "model": STEPS,
    "model-frictionless": STEPS, "model-tresca": STEPS, "o-ring": {"h": 0.08, "steps": 6},
    "patch-bodies": {"h": 0.2}, "pin": {"h": 1}, "pressfit": {"h": 2},
    "punch": {"h": 0.1, "steps": 3}, "roller": {"h": 0.5, "steps": 6}, "seal": {"steps": 8},
    "stack": {**STEPS, "h": 0.2}, "thermal": STEPS, "tutorial": {**STEPS, "h": 4},
    "walking": {"cycles": 3}, "wedge": {**STEPS, "h": 5}, "zones": STEPS,
    "hard/block": STEPS, "hard/cycles": {"steps": 8}, "hard/fibre": STEPS,
    "hard/held": {**STEPS, "n": 6}, "hard/hole": STEPS, "hard/pair": {**STEPS, "h": 0.25},
    "hard/pieces": {**STEPS, "nx": 8, "ny": 4}, "hard/revolved": {"steps": 8},
    "hard/slope": {**STEPS, "n": 6}, "hard/tower": STEPS, "hard/wedge": {**STEPS, "n": 6},
}
SCENES = sorted(path.relative_to(EDP).with_suffix("").as_posix()
                for path in (*EDP.glob("*.edp"), *EDP.glob("hard/*.edp")))


@pytest.fixture(scope="module")
def one_mesh(tmp_path_factory):
    """one_mesh(scene): path of the scene on one mesh for all cuts.

    A rectangle is meshed anew for every number of subdomains; here it becomes a body of 4 rows of
    cells.
    """
    folder = tmp_path_factory.mktemp("one-mesh")

    def make(name: str):
        path = freefem.find_scene(name)
        text = path.read_text().replace('include "model-body.idp"',
                                        (EDP / "lib" / "model-body.idp").read_text())
        sides = re.search(r"^ *rectangle\(([^;]*)\);", text, re.MULTILINE)
        if not sides:
            return path
        x0, x1, y0, y1 = (f"({side.strip()})" for side in sides[1].split(","))
        mesh = (f"body = square(max(2., round(4*({x1} - {x0})/({y1} - {y0}))), 4,\n"
                f"  [{x0} + ({x1} - {x0})*x, {y0} + ({y1} - {y0})*y]);")
        turned = r"{ real turn = (\1)*pi/180; body = movemesh(body,\n" \
                 r"  [cos(turn)*x - sin(turn)*y, sin(turn)*x + cos(turn)*y]); }"
        text = re.sub(r"rotate\(([^;]*)\);", turned, text.replace(sides[0], mesh))
        made = folder / f"{name.replace('/', '-')}.edp"
        made.write_text(text)
        return made

    return make


def assert_same(found, expected, where):
    """Contact forces and displacements of two runs, step by step, node by node; else quantities."""
    assert (found.status, found.reason) == (0, ""), where
    assert found.summary["steps"] == expected.summary["steps"], where
    if not expected.contact:
        for name, value in expected.summary["quantities"].items():
            assert found.summary["quantities"][name] == pytest.approx(value, rel=FORCES), where
        return
    (one, place), (other, same_place) = map(_ordered, (found, expected))
    np.testing.assert_allclose(place, same_place, atol=1e-9 * np.abs(place).max(), err_msg=where)
    forces, others = one["weight"] * one["sigma"], other["weight"] * other["sigma"]
    assert np.abs(forces - others).max() < FORCES * np.abs(others).max(), where
    if any("one of many solutions" in line for line in expected.summary["warnings"]):
        return
    largest, expected_largest = (run.history["max_displacement"] for run in (found, expected))
    allowed = DISPLACEMENTS * expected_largest.max()
    assert np.abs(largest - expected_largest).max() < allowed, where
    assert np.abs(one["u"] - other["u"]).max() < allowed, where


def _ordered(run):
    """Columns with the nodes in an order that the cut does not change, and the nodes' places.

    `sigma` (2, steps, nodes) are normal and tangential, `u` (2, steps, nodes) along x and y: open
    nodes that follow an obstacle have the normal of a place that only rounding may choose.
    """
    c = run.contact
    along = {"u_n": c["u_n"] * c["normal_x"] - c["u_t"] * c["normal_y"],
             "u_t": c["u_n"] * c["normal_y"] + c["u_t"] * c["normal_x"]}
    c = c | along
    order = np.lexsort([np.round(c[name][0], 9) for name in ("normal_x", "y", "x")])
    columns = {name: np.array([c[f"{name}_n"], c[f"{name}_t"]])[:, :, order]
               for name in ("sigma", "u")}
    place = np.column_stack([c["x"][0], c["y"][0]])[order]
    return columns | {"weight": c["weight"][:, order]}, place


def compare(solved, scene, options, cuts) -> list:
    """Runs of the scene in `cuts`, each compared with the first."""
    runs = [solved(scene, subdomains=cut, **(TIGHT | options)) for cut in cuts]
    for cut, run in zip(cuts, runs):
        assert_same(run, runs[0], f"SUBDOMAINS={cut}")
    return runs


@pytest.mark.slow
@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("scene", SCENES)
def test_every_cut_gives_the_same_answer(solved, one_mesh, scene, element):
    compare(solved, one_mesh(scene), {"element": element, **OPTIONS.get(scene, {})}, range(1, 17))


@pytest.mark.slow
@pytest.mark.parametrize("element", ["P1", "P2", "P2-mixed"])
@pytest.mark.parametrize("scene, options, cuts", [
    ("bracket", {}, (1, "3x7", "10x10", 100)),  # a body with a hole
    ("pin", {}, (1, "1x3", "6x5", 60)),
    ("stack", {}, (1, "4x3", 40, 60)),
    ("hard/tower", {}, (1, "3x1", 80)),
    *(("hard/pieces", {"layout": layout}, (1, "piece", 60))
      for layout in ("island", "chess", "stripes", "sizes", "elements", "scattered")),
], ids=lambda value: value if isinstance(value, str) else value.get("layout", "")
    if isinstance(value, dict) else "")
def test_hundreds_of_subdomains_and_odd_ones(solved, one_mesh, scene, options, cuts, element):
    compare(solved, one_mesh(scene), {"element": element, **OPTIONS[scene], **options}, cuts)


@pytest.mark.parametrize("scene, options, cuts", [
    ("hard/pair", {}, (1, 6, 8)),  # upper pieces on two corners of a horizontal line
    ("hard/tower", {"element": "P2"}, (1, 5, 9)),
    ("hard/pieces", {"element": "P2-mixed", "layout": "scattered"}, (1, 7, "piece")),
    ("model", {}, (3, 60, 64)),  # of 64 triangles
], ids=lambda value: value if isinstance(value, str) else "")
@pytest.mark.some(1)
def test_a_sample_of_cuts(solved, one_mesh, scene, options, cuts):
    runs = compare(solved, one_mesh(scene), {**options, **OPTIONS[scene], "steps": 2}, cuts)
    if scene == "model":  # METIS alone fills 6 of 60 parts
        assert [run.summary["sizes"]["subdomains"] for run in runs] == list(cuts)


BESIDE = """include "scene.idp"
int[int] sides = [7, 50, 3, 12];
mesh A = square(4, 2, [4*x, 2*y], label = sides);
mesh B = square(4, 2, [4*x, 3. + 2*y], label = sides);
B = change(B, fregion = 1, flabel = label + 100);
addBody(A)
addBody(B)
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(12, 50, u1 = 0., u2 = 0.) + on(112, 103, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -1.) + traction(107, 0.3, -0.2) //
macro contact() 7 //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.parametrize("element, cuts", [
    ("P1", (1, 3, 32)), pytest.param("P2", (1, 3, 7, 16, 32), marks=pytest.mark.slow)])
def test_a_body_without_contact_and_triangles_in_clamped_corners(solved, named_scene, element,
                                                                  cuts):
    """Of 32 triangles, each a subdomain, one has no dof that is free; and where gluing rows are
    eliminated the body that touches nothing leaves none.
    """
    compare(solved, named_scene("beside", BESIDE), {"element": element}, cuts)


@pytest.mark.parametrize("number", ["-1", "sqrt(-1. - x)", "1e9*x"])
def test_numbers_of_subdomains_that_cannot_be_meant_are_refused(solved, variant, number):
    last = 'include "export.idp"'
    scene = variant(f"piece{len(number)}", (last, f"macro piece() ({number}) //\n{last}"))
    refused = solved(scene, subdomains="piece", cells=2)
    assert refused.status == 2 and "piece must number the subdomains 0, 1, 2" in refused.reason


def test_more_subdomains_than_triangles_are_refused(solved, one_mesh):
    refused = solved(one_mesh("model"), subdomains=65)
    assert refused.status == 2 and "65 subdomains of 64 triangles" in refused.reason


SLIT = """include "scene.idp"
border a0(t=0, 1) { x = 2*t; y = 0.; label = 2; }
border a1(t=0, 1) { x = 2.; y = 0.4995*t; label = 3; }
border a2(t=0, 1) { x = 2. - t; y = 0.4995; label = 9; }
border a3(t=0, 1) { x = 1.; y = 0.5 + 0.001*(t - 0.5); label = 9; }
border a4(t=0, 1) { x = 1. + t; y = 0.5005; label = 9; }
border a5(t=0, 1) { x = 2.; y = 0.5005 + 0.4995*t; label = 6; }
border a6(t=0, 1) { x = 2. - 2*t; y = 1.; label = 4; }
border a7(t=0, 1) { x = 0.; y = 1. - t; label = 5; }
body = buildmesh(a0(20) + a1(5) + a2(10) + a3(1) + a4(10) + a5(5) + a6(20) + a7(10));
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(5, u1 = 0., u2 = 0.) //
macro load1() traction(6, 0., 1.) + traction(3, 0., -1.) //
macro contact() 2 //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.parametrize("element, cuts", [
    ("P1", (1, 5, "10x1")),
    pytest.param("P2", (1, 5, "10x1", "3x1"), marks=pytest.mark.slow)])
def test_a_slit_much_narrower_than_triangles(solved, named_scene, element, cuts):
    """The faces of a slit stay apart, in subdomains with both of them and none of its end, too."""
    runs = compare(solved, named_scene("slit", SLIT), {"element": element}, cuts)
    assert runs[0].history["max_displacement"][-1] > 0.01  # the upper half bends off
