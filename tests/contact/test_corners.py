"""Contact labels that meet: one node where the boundary goes on, two conditions at a corner."""

import numpy as np
import pytest

from driver.environment import ROOT
from driver.hard.case import TIGHT, Case
from driver.hard.checks import laws
from driver.march import shortcut

# the fixed point ends at 1e-8 of the pressures: two runs differ by some of that
CLOSE = 1e-6

FLOOR = """// a block is pressed down, then dragged to the right, away from a wall
include "scene.idp"
real F = physical("friction", 0.3), way = physical("way", 1);
units("1", "1");
subdomains("3");
quasistatic(2.);
body = square(10, 4, [2*x, y]);
macro young() 1. //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 0., u2 = -0.01) //
macro displacement2() on(3, u1 = 0.02*way) //
macro amplitude1(t) min(t, 1.) //
macro amplitude2(t) max(t - 1, 0.) //
macro contact() 1 //
macro gap() (x < 1e-9 && y > 1e-9 ? 0.05 : (label == 4 ? 0.05 : 0.)) //
macro friction() F //
include "export.idp"
"""
MIRROR = """// a block in a corner, part of its floor bilateral, and its mirror image
include "scene.idp"
real F = physical("friction", 0.4), side = physical("side", 1);
units("1", "1");
subdomains("3");
quasistatic(2.);
body = square(8, 4, [2*x, y]);
body = change(body, flabel = (label == 1 ? (x < 0.75 ? 11 : 12) : label));
if (side < 0) body = movemesh(body, [-x, y]);
macro young() 1. //
macro poisson() 0.3 //
macro support() on(2, u1 = 0., u2 = 0.) //
macro load1() traction(3, 1e-3*side, 1e-3*(x*side - 1.2)) //
macro load2() traction(3, -2e-3*side, 5e-4) //
macro amplitude1(t) min(t, 1.) //
macro amplitude2(t) max(t - 1, 0.) //
macro contact() 11, 12, 4 //
macro bilateral() (label == 11) //
macro friction() F //
include "export.idp"
"""
PAIRS = """// two blocks, the upper one's bottom in one label or two, against one of the lower one
include "scene.idp"
units("1", "1");
subdomains("3");
int[int] low = [1, 2, 5, 3], up = [6, 12, 13, 14];
addBody(square(8, 4, [2*x, y], label = low))
addBody(change(square(8, 3, [2*x, 1 + y], label = up, region = 1),
               flabel = (label == 6 && x > 1 ? 6 : label)))
macro young() 1. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(13, 3e-4, -1e-3) //
macro contactPair() 6, 5 //
macro friction() 0.5 //
include "export.idp"
"""
POLYGON = """real turn = physical("turn", 0.), pull = physical("pull", 0.);
real shear = physical("shear", 0.);
border hole(t=0, 2*pi) { x = 0.6*cos(t + turn); y = 0.6*sin(t + turn); label = 5; }
"""
BOWL = """// a bowl whose lowest vertex two subdomains share; its first side is short
include "scene.idp"
units("1", "1");
subdomains("1");
func real angle(real t) { return pi + pi*t*(0.6 + 0.4*t); }
border rim(t=0, 1) { x = cos(angle(t)); y = sin(angle(t)); label = 1; }
border lid(t=0, 1) { x = 1 - 2*t; y = 0; label = 2; }
body = buildmesh(rim(7) + lid(4));
macro piece() (nuTriangle - 3*floor(nuTriangle/3.)) //
macro young() 1. //
macro poisson() 0.3 //
macro support() on(2, u1 = 0., u2 = 0.) //
macro load1() traction(2, 0., -1.) //
macro contact() 1 //
macro gap() (x^2 + 3*(1 + y)) //
include "export.idp"
"""
TRAVEL = """// a stiff block with a soft lid that slides on rollers, over a step and against a wall
include "scene.idp"
units("1", "1");
subdomains("4");
quasistatic(1.);
border a(t=0, 1) { x = 0.42 + 0.58*t; y = 0; label = 1; }
border b(t=0, 1) { x = 1; y = 0.36*t; label = 2; }
border c(t=1, 0) { x = t; y = 0.36; label = 3; }
border d(t=1, 0) { x = 0; y = 0.19 + 0.17*t; label = 4; }
border e(t=0, 1) { x = 0.42*t; y = 0.19; label = 4; }
border f(t=1, 0) { x = 0.42; y = 0.19*t; label = 5; }
body = buildmesh(a(5) + b(3) + c(9) + d(2) + e(4) + f(2));
macro young() (y < 0.17 ? 1. : 10.) //
macro poisson() 0.3 //
macro support() on(3, u2 = 0.) //
macro load1() traction(3, 4e-4, -1.4e-3) //
macro contact() 5, 1, 2 //
macro gap() 0.05 //
macro friction() 0.8 //
macro amplitude1(t) max(0., (t - 0.7)/0.3) //
include "export.idp"
"""
REST = """// a block that is pressed into a corner, not quite a right one, and let go a little
include "scene.idp"
units("1", "1");
subdomains("3");
quasistatic(3.);
border a(t=0, 1) { x = 2*t; y = 0.05*t; label = 1; }
border b(t=0, 1) { x = 2 + 0.1*t; y = 0.05 + 0.95*t; label = 2; }
border c(t=1, 0) { x = 2.1*t; y = 1; label = 3; }
border d(t=1, 0) { x = 0; y = t; label = 4; }
body = buildmesh(a(8) + b(5) + c(7) + d(4));
macro young() 1. //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 0.02, u2 = -0.01) //
macro displacement2() on(3, u1 = -0.001, u2 = 0.004) //
macro amplitude1(t) min(t, 1.) //
macro amplitude2(t) max(t - 1, 0.) //
macro contact() 1, 2 //
macro gap() (label == 2 ? 0. : 2e-4) //
macro friction() 0.4 //
include "export.idp"
"""
SEVERAL = {  # what makes one label several
    "floor": (("macro young()", "body = change(body, flabel = (label == 1 ? 11 + int(x/0.4) : label"
               "));\nmacro young()"), ("contact() 1 ", "contact() 11, 12, 13, 14, 15 ")),
    "pairs": (("? 6 : label", "? 7 : label"), ("contactPair() 6, 5", "contactPair() 6, 5, 7, 5")),
    "hole": (("macro young()", "body = change(body, flabel = (label != 5 ? label : (x < -0.49 && "
              "abs(y) < 0.49 ? 5 : (x > 0.49 && abs(y) < 0.49 ? 7 : (y > 0 ? 6 : 8)))));\n"
              "macro young()"), ("contact() 5", "contact() 5, 6, 7, 8")),
}


def several(name: str, text: str) -> str:
    """A scene's text with several labels for one."""
    for old, new in SEVERAL[name]:
        assert old in text
        text = text.replace(old, new)
    return text


CRACK = """// a plate with a slit is pressed on a floor until it closes
include "scene.idp"
units("1", "1");
subdomains("1");
border a(t=0, 1) { x = 4*t; y = 0; label = 1; }
border b(t=0, 1) { x = 4; y = 3*t; label = 2; }
border c(t=0, 1) { x = 4 - 4*t; y = 3; label = 3; }
border d(t=0, 1) { x = 0; y = 3 - 3*t; label = 4; }
border upper(t=0, 1) { x = 1 + 2*t; y = 1 + t + 0.08*t*(1 - t); label = 11; }
border lower(t=1, 0) { x = 1 + 2*t; y = 1 + t - 0.08*t*(1 - t); label = 12; }
body = buildmesh(a(6) + b(5) + c(6) + d(5) + upper(8) + lower(8));
macro young() 2000. //
macro poisson() 0.35 //
macro load1() traction(3, 6., -40.) //
macro contact() 1, 4 //
macro contactPair() 11, 12 //
macro friction() 0.4 //
include "export.idp"
"""


@pytest.fixture(scope="session")
def checked(solved):
    """checked(scene, NAME=value, ...): a run to tight tolerances that obeys all laws."""

    def get(path, **options):
        run = solved(path, **TIGHT, **options)
        assert run.status == 0, run.reason
        check = laws(CLOSE)(Case("", str(path), options), {}, run)
        assert check.error <= CLOSE
        return run

    return get


def by_place(run, names=("u_n", "u_t", "sigma_n", "sigma_t", "slip"), mirrored=False):
    """(steps, nodes, names) in an order that knows places and normals, but not labels."""
    c = run.contact
    x, normal = (-c[name] if mirrored else c[name] for name in ("x", "normal_x"))
    keys = (*np.round([normal[0], c["normal_y"][0]], 6), c["y"][0], np.round(x[0], 9))
    return np.stack([c[name] for name in names], axis=2)[:, np.lexsort(keys)]


def apart(one, other) -> float:
    """Largest difference of displacements, or tractions, relative to the largest of them."""
    parts = [(one[..., columns], other[..., columns]) for columns in ([0, 1, 4], [2, 3])]
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in parts)


# ---- labels that go on in one another -----------------------------------------------------------

def test_flat_boundary_does_not_know_its_labels(checked, named_scene):
    """One label and five, whole and in seven pieces: the same at every node, and quantities.

    The tangential resultant of one boundary has a sign, of several it adds magnitudes, and here
    shear has one direction.
    """
    whole = checked(named_scene("floor", FLOOR))
    for subdomains in (3, 7):
        run = checked(named_scene("floors", several("floor", FLOOR)), subdomains=subdomains)
        assert apart(by_place(run), by_place(whole)) <= CLOSE
        for name, value in whole.summary["quantities"].items():
            found = run.summary["quantities"][name]
            assert abs(found) == pytest.approx(abs(value), rel=CLOSE)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_normals_and_gaps_do_not_know_the_cut(built, named_scene, element):
    """Sides of unlike length and bow meet in vertices that several subdomains share."""
    path = named_scene("bowl", BOWL)
    whole, pieces = (built(path, reduce=False, element=element, subdomains=cut).structure.contact
                     for cut in (1, "piece"))
    assert np.array_equal(whole.gid, pieces.gid) and len(whole.gid) >= 6
    for name in ("normal", "weight", "gap"):
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), rtol=1e-13,
                                   atol=1e-13)


@pytest.mark.slow  # two runs
def test_a_wall_that_is_not_touched_changes_no_friction(checked, named_scene):
    """In full sliding T = F N, with the corner node's part; in the direction away from the wall
    and, as long as the gap is open, towards it.
    """
    floor = named_scene("wall", several("floor", FLOOR).replace("contact() ", "contact() 4, "))
    for way, sign in ((1, -1), (-1, 1)):
        run = checked(floor, way=way)
        last = {name: column[-1] for name, column in run.contact.items()}
        on_floor = np.abs(last["normal_y"] + 1) < 1e-9
        assert (last["sigma_n"][~on_floor] == 0).all() and (last["status"] != "stick").all()
        normal, tangential = ((last[name] * last["weight"])[on_floor].sum()
                              for name in ("sigma_n", "sigma_t"))
        assert tangential == pytest.approx(-sign * 0.3 * normal, rel=1e-9)
        assert np.count_nonzero(last["x"] ** 2 + last["y"] ** 2 == 0) == 2


def test_pairs_that_go_on_in_one_another_are_one_boundary(solved, named_scene):
    """Meshes match: at the vertex where the labels meet both would have the same condition.

    What is compared are openings, a hundredth of the deformation that residuals are relative to.
    """
    tight = TIGHT | {"PRIMAL_RTOL": str(0.01 * CLOSE)}
    whole, parts = (solved(path, **tight) for path in (
        named_scene("pair", PAIRS), named_scene("pairs", several("pairs", PAIRS))))
    assert whole.status == parts.status == 0
    assert apart(by_place(parts), by_place(whole)) <= CLOSE


# ---- corners -------------------------------------------------------------------------------------

@pytest.mark.slow  # three runs of six steps
def test_corner_does_not_know_its_labels(checked, named_scene):
    """The square hole round a peg, one label or four, and cuts: forces of both conditions too."""
    four = named_scene("holes", several("hole", (ROOT / "edp" / "hard" / "hole.edp").read_text()))
    runs = [checked("hard/hole", steps=6), checked(four, steps=6, subdomains=7),
            checked("hard/hole", steps=6, subdomains=1)]
    for run in runs[1:]:
        assert apart(by_place(run), by_place(runs[0])) <= CLOSE
    assert runs[0].contact["x"].shape[1] == 20
    statuses = runs[0].contact["status"]
    at = np.abs(np.abs(runs[0].contact["x"][0]) + np.abs(runs[0].contact["y"][0]) - 1) < 1e-9
    assert (statuses[:, at] != "open").any() and (statuses[:, at] == "open").any()


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.some(1)
def test_sides_of_a_hole(checked, element):
    """Three sides: the fourth does not exist for the others' corners."""
    run = checked("hard/hole", steps=6, sides=3, element=element)
    corners = np.abs(run.contact["y"][0] + 0.5) < 1e-9
    assert np.count_nonzero(corners) == 2


def test_corner_with_one_free_displacement_has_one_condition(checked, named_scene):
    """A wedge whose lower right side moves up and down only: the wall that is reached first."""
    text = (ROOT / "edp" / "hard" / "wedge.edp").read_text()
    text = text.replace("macro displacement1()", """real right = physical("right", 0.);
macro support() on(1, u1 = 0.) //
macro gap() (label == 1 ? right : 0.001) //
macro displacement1()""").replace("u1 = drag", "u1 = 0.")
    wedge = named_scene("held", text)
    for right, first in ((0.0, 1), (0.002, 4)):
        run = checked(wedge, right=right, steps=2, n=4)
        last = {name: column[-1] for name, column in run.contact.items()}
        tip = last["x"] ** 2 + last["y"] ** 2 < 1e-18
        touched = tip & (last["sigma_n"] < 0)
        assert tip.sum() == 2 and last["boundary"][touched].tolist() == [first]
        assert last["u_n"][touched] == pytest.approx(last["gap"][touched], abs=1e-9)


@pytest.mark.slow  # two runs; labels and cuts are changed by default
def test_mirrored_scene_has_the_mirrored_answer(checked, named_scene):
    """Corner, bilateral and unilateral boundary, friction: x turns, and with it t."""
    block = named_scene("mirror", MIRROR)
    one = by_place(checked(block))
    other = by_place(checked(block, side=-1, subdomains=5), mirrored=True)
    assert apart(other * [1, -1, 1, -1, -1], one) <= CLOSE
    effects = checked(block).summary["effects"]
    assert effects["contact"] == "unilateral and bilateral"


def test_bilateral_contact_pulls_as_it_presses(solved, named_scene):
    """The law is odd: loads of the opposite sign, on a body that nothing else holds."""
    text = MIRROR
    for old, new in (("macro support() on(2, u1 = 0., u2 = 0.) //\n", ""),
                     ("11, 12, 4", "11, 12"), ("(label == 11)", "yes"), ("0.4", "1."),
                     ("macro load2() traction(3, -2e-3*side, 5e-4) //\n", ""),
                     ("macro amplitude2(t) max(t - 1, 0.) //\n", ""),
                     ("if (side < 0) body = movemesh(body, [-x, y]);\n", ""),
                     ("1e-3*side, 1e-3*(x*side - 1.2)", "side*2e-4, -side*1e-3")):
        assert old in text
        text = text.replace(old, new)
    pulled = named_scene("pulled", text)
    press, pull = (solved(pulled, **TIGHT, side=side, steps=2, subdomains=4) for side in (1, -1))
    assert press.status == pull.status == 0
    assert apart(-by_place(pull), by_place(press)) <= CLOSE
    assert press.summary["quantities"]["peak_pressure"] == pytest.approx(
        pull.summary["quantities"]["peak_pressure"], rel=CLOSE)


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.some(1)
def test_a_vertex_that_rests_in_its_corner(checked, named_scene, element):
    """It arrives against the friction of both sides, which stays while pressure bears it, at any
    cut.
    """
    path = named_scene("rest", REST)
    runs = [checked(path, element=element, steps=6, subdomains=n) for n in (1, 5)]
    assert apart(by_place(runs[1]), by_place(runs[0])) <= CLOSE
    c = runs[0].contact
    tip = np.hypot(c["x"][0] - 2, c["y"][0] - 0.05) < 1e-9
    normal, tangential = c["sigma_n"][:, tip], c["sigma_t"][:, tip]
    assert tip.sum() == 2 and (normal < 0).all()
    assert np.abs(tangential[0]) == pytest.approx(-0.4 * normal[0], rel=1e-12)
    assert np.ptp(tangential[:5], axis=0) == pytest.approx([0, 0], abs=1e-12)
    assert tangential[5] == pytest.approx(np.minimum(tangential[0], -0.4 * normal[5]), rel=1e-9)
    assert (tangential[5] < tangential[0]).any() == (element == "P1")


SHOVED = """// a block on a floor that a wall pushes along, once it is pressed down
include "scene.idp"
units("mm", "MPa");
rectangle(0., 4., 0., 2.);
quasistatic(2.);
macro stepTimes() [1.] //
macro young() 1000. //
macro poisson() 0.3 //
macro contact() 1, 2 //
macro friction() (label == 1 ? 0.3 : 0.) //
macro load1() traction(3, 0., -5.) //
macro amplitude1(t) min(1., t) //
macro obstacleX(t) (label == 2 ? -0.5*max(0., t - 1.) : 0.) //
include "export.idp"
"""


@pytest.mark.parametrize("more", ["", "macro largeSliding() 1. //"])
def test_a_wall_that_moves_along_its_normal_drags_the_vertex_along_the_floor(solved, named_scene,
                                                                              more):
    """All of the floor slides: T = F N, the vertex's part of it too, at any mesh."""
    path = named_scene("shoved", SHOVED.replace("macro young()", f"{more}\nmacro young()"))
    run = solved(path, cells=2, steps=4, subdomains="2x1", **TIGHT)
    at = run.contact["boundary"][-1] == 1
    force = {name: (run.contact[name][-1] * run.contact["weight"][-1])[at].sum()
             for name in ("sigma_n", "sigma_t")}
    assert abs(force["sigma_t"]) == pytest.approx(-0.3 * force["sigma_n"], rel=1e-6)


def test_a_step_in_which_nothing_changes_keeps_the_forces_in_a_corner(solved, named_scene):
    """The wall stands 0.05 inside the block and has pushed it along the floor; nothing moves more.
    """
    text = SHOVED.replace("macro obstacleX(t) (label == 2 ? -0.5*max(0., t - 1.) : 0.) //",
                          "macro gap() (label == 2 ? -0.05 : 0.) //")
    c = solved(named_scene("wedged", text), cells=2, steps=4, subdomains="2x1", **TIGHT).contact
    largest = np.abs(c["sigma_n"][-1]).max()
    for name in ("sigma_n", "sigma_t"):
        assert np.abs(np.diff(c[name][1:], axis=0)).max() <= CLOSE * largest


def test_every_state_has_its_iterations(checked, named_scene, monkeypatch):
    """Two states in the first step, 11 iterations together, at most 8 for each."""
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    run = checked(named_scene("rest", REST), element="P1", steps=6, subdomains=1,
                  max_fixed_point=8)
    assert run.history["fixed_point_iterations"][0] > 8
    assert not any("bound did not converge" in line for line in run.summary["warnings"])


@pytest.mark.parametrize("subdomains", [1, 5])
def test_corners_of_a_body_that_comes_from_far(checked, named_scene, subdomains):
    """States of corners that hold it too little let it go far: nothing of that stays."""
    checked(named_scene("travel", TRAVEL), element="P2", steps=5, subdomains=subdomains)


@pytest.mark.parametrize("name, text, options", [
    ("rest", "REST", {}), ("wall", "FLOOR", {"subdomains": 4})])
@pytest.mark.some(1)
def test_a_preload_at_corners_knows_no_friction(solved, named_scene, name, text, options):
    """It is the equilibrium without friction, and where loads stay friction has nothing to do:
    steps with any coefficient have the tractions of the scene that declares none.
    """
    text = globals()[text].replace("min(t, 1.)", "1.").replace("max(t - 1, 0.)", "0.")
    text = text.replace('include "export', 'macro preload() 1 //\ninclude "export')
    if name == "wall":  # pushed into the corner of floor and wall
        text = text.replace("contact() 1 ", "contact() 1, 4 ").replace(
            "gap() (x < 1e-9 && y > 1e-9 ? 0.05 : (label == 4 ? 0.05 : 0.))", "gap() 0.").replace(
                "u1 = 0., u2 = -0.01", "u1 = -0.004, u2 = -0.01")
    text = text.replace("friction() F", "friction() 0.9").replace("friction() 0.4",
                                                                  "friction() 0.9")
    path = named_scene(f"preload-{name}", text)
    rough = solved(path, **TIGHT, **options, steps=2)
    assert rough.status == 0, rough.reason
    smooth = solved(path, **TIGHT, **options, steps=2, without="friction,preload")
    held, free = (by_place(run, ("sigma_n", "sigma_t")) for run in (rough, smooth))
    assert (free[0, :, 0] < 0).any()
    assert np.abs(held - free).max() <= CLOSE * np.abs(free).max()


@pytest.mark.parametrize("options", [
    {"sides": 8, "turn": 0.725, "friction": 0.7, "pull": -0.00134, "shear": -0.00204},
    {"sides": 6, "turn": 0.423, "friction": 0.75, "pull": -0.00285, "shear": 0.00104}])
@pytest.mark.some(1)
def test_friction_drags_corners_from_side_to_side(checked, named_scene, options):
    """A press fit whose sides turn by 45 and 60 degrees, clamped: vertices stand on two sides that
    friction alone holds together. All laws, and the cut makes no difference.
    """
    text = (ROOT / "edp" / "hard" / "hole.edp").read_text()
    assert text.count("border hole") == 4
    before, rest = text.split("border holeLeft")
    rest = rest.split("body = ")[1]
    text = before + POLYGON + "body = " + rest
    sides = " + holeLeft(n) + holeTop(n)\n                 + holeRight(n) + holeBottom(n)"
    for old, new in ((sides, " + hole(-int(sides))"), ("2e-3, -1e-3)", "pull, shear)")):
        assert text.count(old) == 1
        text = text.replace(old, new)
    polygon_scene = named_scene("polygon", text)
    whole, cut = (checked(polygon_scene, gap=-1e-4, steps=2, subdomains=n, **options)
                  for n in (1, 3))
    assert apart(by_place(cut), by_place(whole)) <= CLOSE


@pytest.mark.parametrize("law", ["tresca() 1e-4", "cohesion() 1e-4 //\nmacro friction() 0.5"])
@pytest.mark.some(1)
def test_friction_without_pressure_on_both_sides_of_an_open_corner(checked, named_scene, law):
    """A block is dragged away from floor and wall: every node slides at the given bound, and the
    lid gives what all of them take: 1e-4 times the length of the floor, and of the wall.
    """
    text = FLOOR.replace("gap() (x < 1e-9 && y > 1e-9 ? 0.05 : (label == 4 ? 0.05 : 0.))",
                         "gap() 0.").replace("contact() 1 ", "contact() 1, 4 ")
    text = text.replace("friction() F", law).replace("u1 = 0., u2 = -0.01", "u1 = 0., u2 = 0.01")
    runs = [checked(named_scene(f"given-{law[:3]}", text), steps=2, subdomains=n) for n in (1, 4)]
    assert apart(by_place(runs[1]), by_place(runs[0])) <= CLOSE
    last = {name: column[-1] for name, column in runs[0].contact.items()}
    assert (last["sigma_n"] == 0).all()
    vertex = last["x"] ** 2 + last["y"] ** 2 == 0
    assert vertex.sum() == 2 and np.abs(last["sigma_t"][vertex]) == pytest.approx(1e-4, rel=1e-9)
    force = (last["sigma_t"] * last["weight"])
    floor, wall = last["normal_y"] < -0.5, last["normal_x"] < -0.5
    assert abs(force[floor].sum()) == pytest.approx(2e-4, rel=1e-9)
    assert np.abs(last["sigma_t"][wall]).max() <= 1e-4 * (1 + 1e-9)


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.some(1)
def test_tips_of_a_crack_take_no_force(checked, named_scene, element):
    """Both lips are one node there, which has no condition; its part of the boundary is that of the
    next nodes, so that weights make up the crack's length. It is closed all along, at any cut.
    """
    crack = named_scene("crack", CRACK)
    one, other = (checked(crack, element=element, subdomains=n) for n in (1, 5))
    assert apart(by_place(other), by_place(one)) <= CLOSE
    first = {name: column[0] for name, column in one.contact.items()}
    lips = first["boundary"] == 11
    tips = lips & (np.abs(first["x"] - 2) > 1 - 1e-9)
    assert first["weight"][lips].sum() == pytest.approx(5**0.5, rel=0.01)
    assert not tips.any() and (first["sigma_n"][lips] < 0).all()


def test_labels_have_any_number(solved, named_scene):
    """Also that of the edges which cuts make, were it not taken: the answer knows no numbers."""
    found = []
    for labels in ("1, 2, 3, 4", "10000, 10001, -5, 0"):
        bottom, right, top, left = labels.split(", ")
        block = named_scene("numbers", f"""include "scene.idp"
units("1", "1");
int[int] sides = [{labels}];
body = square(6, 3, [2*x, y], label = sides);
macro young() 1. //
macro poisson() 0.3 //
macro support() on({left}, u1 = 0., u2 = 0.) //
macro load1() traction({top}, 0.01, -0.02) //
macro contact() {bottom}, {right} //
include "export.idp"
""")
        run = solved(block, **TIGHT, subdomains=3)
        assert run.status == 0 and sorted(set(run.contact["boundary"][0])) == sorted(
            [int(bottom), int(right)])
        found.append(by_place(run))
    assert apart(*found) <= 1e-12
