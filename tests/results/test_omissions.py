"""What a scene leaves out silently is said: loads that are not there, overlaps, coarse tolerances;
and warnings that repeat are counted.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.options import Settings
from driver.results import omissions, screen, tables

BLOCK = """include "scene.idp"
units("mm", "MPa");
subdomains("2");
body = square(8, 4, [2.*x, y]);
quasistatic(1.);
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
{more}
include "export.idp"
"""
LOAD = "macro load1() traction(3, 0., -1.) //\n"
BLOCKS = """include "scene.idp"
units("mm", "MPa");
subdomains("2");
addBody(square(8, 4, [2.*x, y]))
int[int] sides = [11, 12, 13, 14];
addBody(square(6, 4, [2.*x, {bottom} + y], label = sides))
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) + on(13, u1 = 0.) //
macro load1() traction(13, 0., -1.) //
macro contactPair() 11, 3 //
{more}
include "export.idp"
"""


@pytest.fixture
def run_of(solved, tmp_path):
    """run_of(text, **options): a run of a scene of this text."""
    def get(text: str, **options):
        path = tmp_path / "own.edp"
        path.write_text(text)
        return solved(path, **options)

    return get


@pytest.mark.parametrize("friction, said", [(0.0, True), (0.3, False)])
def test_a_slip_law_of_no_friction_is_said(run_of, friction, said):
    """It multiplies the coefficient alone: cohesion that it is to weaken stays."""
    law = (f"macro contact() 1 //\nmacro friction() {friction} //\nmacro cohesion() 2. //\n"
           "macro slipFactor(s) max(0., 1. - s) //\nreal slipRange = 1.;\n")
    found = run_of(BLOCK.format(more=LOAD + law), steps=1).summary["warnings"]
    assert any("factor of slip changes nothing" in line for line in found) == said


def test_a_material_stiffer_than_any_is_said():
    """Of the softest alone: a body may be given any stiffness so that it hardly yields."""
    def said(softest, stress):
        none = SimpleNamespace(gid=())
        return omissions.warnings(none, {"gap"}, [1.0], Settings(), softest,
                                  {"length": "mm", "stress": stress})

    assert "unit of stress" in said(8.1e10, "MPa")[0]
    assert not said(8.1e10, "Pa") and not said(8.1e4, "MPa") and not said(1e20, "1")


def test_an_obstacle_of_the_shape_of_a_round_boundary_is_said():
    """Where none is declared; flat boundaries, corners and pairs are what they seem to be."""
    def said(degrees, paired=False, declared=()):
        angle = np.radians(degrees)
        n = len(angle)
        none = SimpleNamespace(gid=np.arange(n), label=np.full(n, 7), paired=np.full(n, paired),
                               normal=np.column_stack([np.sin(angle), -np.cos(angle)]),
                               gap=np.zeros(n), length=np.ones(n), xy=np.eye(n, 2))
        return omissions.warnings(none, declared, [1.0], Settings(), 1.0,
                                  {"length": "mm", "stress": "MPa"})

    arc = np.linspace(-40, 40, 9)
    assert ["label 7 is round" in line for line in said(arc)] == [True]
    for clear in (said(0 * arc), said([0, 0, 90, 90]), said(arc, paired=True),
                  said(arc, declared={"gap"}), said(arc, declared={"obstacle"})):
        assert not clear


def test_a_corner_that_is_rough_on_one_side_is_said():
    """Where the laws of both sides are not followed; where both are rough or smooth they are."""
    def said(c, declared=("gap", "normal_compliance")):
        none = SimpleNamespace(gid=np.array([3, 3]), label=np.array([7, 9]), xy=np.ones((2, 2)),
                               columns={"normal_compliance": np.array(c)},
                               corners=np.array([[0, 1, 2, 1]]))
        return omissions.warnings(none, {*declared, "bilateral"}, [1.0], Settings(), 1.0,
                                  {"length": "mm", "stress": "MPa"})

    assert "the rough boundary 9 and the smooth boundary 7 meet in a corner" in said([0.0, 5.0])[0]
    assert "the rough boundary 7 and the smooth boundary 9" in said([5.0, 0.0])[0]
    assert not said([0.0, 0.0]) and not said([5.0, 0.0], ("gap",))


@pytest.mark.parametrize("more, words", [
    (LOAD + "macro amplitude2(t) t //", "amplitude2 multiplies nothing"),
    ("macro load1() int1d(Ti, 3)(2.*u2*v2) - int1d(Ti, 3)(v1) //", "u2, the unknown"),
    ("macro pull() int1d(Ti, 3)(u1*v1) //\nmacro load3() pull //", None)])
def test_histories_and_terms_without_effect_are_refused(run_of, more, words):
    """The last one hides its term behind a macro of its own; there the run says that nothing moves.
    """
    run = run_of(BLOCK.format(more=more), steps=1)
    if words:
        assert run.status == 2 and words in run.reason
    else:
        assert any("nothing moves" in warning for warning in run.summary["warnings"])


@pytest.mark.parametrize("more, quiet", [
    ("macro contact() 1 //", False), ("macro load1() traction(3, 0., 0.) //", False),
    (LOAD + "macro amplitude1(t) 0.*t //", False), (LOAD, True)])
@pytest.mark.some(2)
def test_a_scene_in_which_nothing_moves_says_so(run_of, more, quiet):
    warnings = run_of(BLOCK.format(more=more), steps=2).summary["warnings"]
    assert any("nothing moves" in warning for warning in warnings) != quiet


@pytest.mark.parametrize("bottom, more, said", [
    ("0.95", "", "contact label 11 starts up to 0.05 inside"),
    ("0.95", "macro pairGap() 0. //", ""), ("0.9999", "", ""), ("1.", "", "")])
@pytest.mark.some(2)
def test_bodies_that_overlap_at_the_start(run_of, bottom, more, said):
    warnings = run_of(BLOCKS.format(bottom=bottom, more=more)).summary["warnings"]
    assert any("inside the other side" in warning for warning in warnings) == bool(said)
    assert not said or any(said in warning and "pairGap" in warning for warning in warnings)


@pytest.mark.parametrize("gap, said", [("pairGap", True), ("gap", False)])
def test_a_distance_between_bodies_says_nothing_of_obstacles(run_of, gap, said):
    """A body that starts inside an obstacle says so, unless the scene declares that distance."""
    more = (f"macro contact() 1 //\nmacro obstacle(x, y) (y - 0.05) //\nmacro {gap}() 0. //\n"
            if said else f"macro contact() 1 //\nmacro {gap}() -0.05 //\n")
    text = BLOCKS.format(bottom="1.", more=more)
    text = text.replace("on(1, u1 = 0., u2 = 0.)", "on(4, u1 = 0.)")
    warnings = run_of(text).summary["warnings"]
    words = "contact label 1 starts up to 0.05 inside the other side"
    found = [warning for warning in warnings if words in warning]
    assert bool(found) == said
    assert not any("declare macro gap" in warning for warning in found)  # obstacle gives the gap


def test_an_obstacle_that_starts_inside_the_body(run_of):
    more = LOAD + "macro contact() 1 //\nmacro obstacle(x, y) (y - 0.1) //"
    warnings = run_of(BLOCK.format(more=more), steps=1).summary["warnings"]
    assert any("0.1 inside the other side" in warning and "gap()" in warning
               for warning in warnings)


def test_curved_boundaries_that_fit_are_not_complained_of(solved):
    for scene in ("hertz-bodies", "pin"):
        warnings = solved(scene, h={"hertz-bodies": 0.008, "pin": 2}[scene]).summary["warnings"]
        assert not any("inside" in warning for warning in warnings)


def test_coarse_tolerances(run_of):
    warnings = run_of(BLOCK.format(more=LOAD), rtol=0.5, steps=1).summary["warnings"]
    assert any(warning.startswith("RTOL=0.5 is too coarse") for warning in warnings)


def test_repeated_warnings_are_one_line():
    said = [*(f"step {k}: residual {10.0 ** -k:.1e} above 1e-04" for k in (1, 2, 5)), "locking",
            *(f"step {k}: slides" for k in range(1, 40))]
    lines = screen.warnings(said)
    assert lines == [
        "warning: step 1: residual 1.0e-01 above 1e-04 (and 2 more like it, steps 2, 5)",
        "warning: locking", "warning: step 1: slides (and 38 more like it)"]


def test_rounding_beside_large_values_is_shown_as_zero():
    """A coordinate of -3e-17 in a body of some millimetres; texts and other units stay."""
    row = {"probe": "label3", "x": -2.8e-17, "y": 16.0, "u_x": 1e-3, "u_y": 1e-14, "force_x": 1e-9,
           "force_y": 0.0, "step": 3, "time": 1.0}
    cleaned, = screen.without_noise([row], tables.PROBES)
    assert cleaned == row | {"x": 0.0, "u_y": 0.0}


HELD = """include "scene.idp"
body = square(8, 4, [4.*x, 2.*y]);
bodyMaterial("a", 1000., 0.3);
quasistatic(1.);
macro load1() pressure(3, 5.) //
macro contact() 1 //
DECLARED
include "export.idp"
"""


@pytest.mark.parametrize("declared, held", [
    # both ends of the label, by prescribed displacements, one while the floor moves
    ("macro displacement2() on(2, u1 = 0.01) + on(4, u1 = 0.01) //\nmacro friction() 0.3 //\n"
     "macro wear() 1e-4 //", 2),
    ("macro support() on(4, u1 = 0.) //\nmacro obstacleX(t) t //\nmacro friction() 0. //\n"
     "macro wear() 1e-4 //", 1),
    # what does not slide, or does not wear
    ("macro support() on(2, u1 = 0.) + on(4, u1 = 0.) //\nmacro friction() 0.3 //\n"
     "macro wear() 1e-4 //", 0),
    ("macro support() on(4, u1 = 0.) //\nmacro obstacleX(t) t //\nmacro friction() 0. //", 0),
    ("macro support() on(3, u1 = 0.) //\nmacro obstacleX(t) t //\nmacro friction() 0.3 //", 0)])
@pytest.mark.some(2)
def test_nodes_that_are_held_and_slide_without_wear_are_named(solved, named_scene, declared, held):
    run = solved(named_scene("held", HELD.replace("DECLARED", declared)), steps=2, subdomains=3)
    assert run.status == 0, run.reason
    said = [line for line in run.summary["warnings"]
            if "constrains them along the boundary" in line]
    assert len(said) == bool(held) and all(line.startswith(f"{held} contact") for line in said)


RAMP = """include "scene.idp"
body = square(8, 4, [4.*x, 2.*y + SLOPE*x]);
bodyMaterial("a", 1000., 0.3);
quasistatic(1.);
macro load1() pressure(3, 5.) //
macro displacement2() on(4, u1 = 0.01) //
macro amplitude2(t) t //
macro contact() 1 //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.parametrize("slope, lacking", [("1.", True), ("0.", False)])
def test_a_node_without_friction_on_a_slanted_boundary_is_named(solved, named_scene, slope,
                                                                lacking):
    """A support leaves the corner (0, 0) one component; on a level boundary it prescribes how the
    corner slides, and friction follows.
    """
    run = solved(named_scene("ramp", RAMP.replace("SLOPE", slope)), steps=2, subdomains=3)
    assert run.status == 0, run.reason
    said = [line for line in run.summary["warnings"] if line.startswith("no friction acts on")]
    assert len(said) == lacking
    assert all("1 contact node of a slanted boundary, the first at (0, 0)" in line for line in said)


def test_loads_are_told_body_by_body(run_of):
    """Weight of the upper block alone, 2 mm by 1 mm; the traction pushes on the same one."""
    summary = run_of(BLOCKS.format(bottom=1.0, more="macro bodyForce2() "
                                   "[0., (y > 1. ? -0.5 : 0.)] //"), subdomains=3).summary
    loads = {load["effect"]: load["bodies"] for load in summary["loads"]}
    order = int(np.abs(loads["traction"][1][1]) > 0)
    for name, force in (("traction", -2.0), ("body_force", -1.0)):
        assert loads[name][order] == pytest.approx([0.0, force], abs=1e-12)
        assert loads[name][1 - order] == [0.0, 0.0]


@pytest.mark.parametrize("macro, text", [("pairGap", BLOCKS), ("gap", BLOCK.replace(
    "{more}", LOAD + "macro contact() 1 //\n{more}"))])
@pytest.mark.some(1)
def test_a_distance_in_another_unit_is_said(run_of, macro, text):
    """Of a label that lies far away as a whole: one that is curved may do so at its ends."""
    for distance, far in (("9.", True), ("0.001", False), ("-0.001", False), ("0.1*x*x", False)):
        run = run_of(text.format(bottom=1, more=f"macro {macro}() {distance} //"))
        said = [line for line in run.summary["warnings"] if "check its sign" in line]
        assert len(said) == far, run.summary["warnings"]
        assert not far or said[0].startswith(f"{macro} keeps contact label ")


def test_an_overlap_declared_to_an_obstacle_is_not_said_of_a_pair_of_the_same_label():
    """A label may meet an obstacle in one place and a body in another: gap is for the first."""
    paired = np.arange(8) >= 4
    some = SimpleNamespace(
        gid=np.arange(8), label=np.ones(8), paired=paired, gap=np.where(paired, 0.0, -0.05),
        length=np.full(8, 0.01), xy=np.column_stack([np.arange(8.0), np.zeros(8)]),
        normal=np.tile([0.0, -1.0], (8, 1)))
    of = SimpleNamespace(declares=lambda paired: ~paired)
    assert omissions.half_declared(some, {"gap": of}) == []
    some.gap = np.where(paired, -0.05, 0.0)
    line, = omissions.half_declared(some, {"gap": of})
    assert "0.05 inside the other side" in line and "macro pairGap() 0." in line


BELT = """include "scene.idp"
units("mm", "MPa");
subdomains("2x1");
quasistatic(1.);
rectangle(0., 1., 0., 1.);
macro young() 1000. //
macro poisson() 0.3 //
macro load1() traction(3, 0., -1.) //
macro amplitude1(t) 1. //
macro contact() 1 //
macro friction() 0.5 //
macro obstacleX(t) (20.*t) //
include "export.idp"
"""


def test_a_body_that_begins_far_away_is_said(run_of):
    """As one drawn in another unit; its fall onto the other is no deformation."""
    said = {bottom: run_of(BLOCKS.format(bottom=bottom, more="")).summary["warnings"]
            for bottom in (2.0, 30.0)}
    assert not any("without support moves by" in line for line in said[2.0])
    line, = (line for line in said[30.0] if "without support moves by 29" in line)
    assert "times the size of the largest body" in line


def test_a_body_that_a_support_moves_far_is_not_said_to_be_far_away(run_of):
    """It does what the scene prescribes; a support that stands still says nothing of its fall."""
    for more, bottom, far in (("macro displacement1() on(13, u1 = 29.) //", 2.0, False),
                              ("macro displacement1() on(13, u1 = 0.) //", 30.0, True)):
        said = run_of(BLOCKS.format(bottom=bottom, more=more)).summary["warnings"]
        assert any("without support moves by" in line for line in said) == far


def test_a_body_that_an_obstacle_carries_far_is_not_said_to_be_far_away(run_of):
    """A belt carries what lies on it."""
    said = run_of(BELT, cells=1, steps=1).summary["warnings"]
    assert not any("without support moves by" in line for line in said)


@pytest.mark.parametrize("load, ways", [
    ("traction(4, 1., 2.)", "x and y"), ("pressure(4, 1.)", "x"),
    ("traction(3, 1., 0.) + pressure(4, 1.)", ""), ("traction(3, 1., 0.)", "")])
@pytest.mark.some(1)
def test_a_load_on_what_supports_hold_is_said(run_of, load, ways):
    """The support takes all of it, in any direction in which it holds all nodes."""
    text = BLOCK.format(more=LOAD + f"macro load2() {load} //")
    for cut in (2, 5):
        said = [line for line in run_of(text, subdomains=cut).summary["warnings"]
                if "it moves nothing" in line]
        assert [line.split(" only on")[0] for line in said] == (
            [f"load2 acts along {ways}"] if ways else [])


def test_a_coefficient_that_looks_like_a_percentage_is_said():
    """Beyond any that is measured; 1e6, for contact that does not slip, is none."""
    def said(*friction):
        some = SimpleNamespace(gid=(), label=np.array([3, 8]),
                               columns={"friction": np.array(friction)})
        return omissions.warnings(some, {"gap", "friction"}, [1.0], Settings(), 1.0,
                                  {"length": "mm", "stress": "MPa"})

    assert said(0.3, 30.0) == ["friction is 30 on contact label 8: if percent are meant, write 0.3"]
    assert said(0.3, 5.0) == said(0.0, 0.0) == said(1e6, 1e6) == []
