"""Places where three conditions meet on two bodies: forces that displacements do not tell."""

import numpy as np
import pytest

from driver.contact.junctions import Junction, junctions
from driver.march import junction_bounds, junction_forces

TIGHT = {"rtol": "1e-11", "friction_rtol": "1e-10"}
CLOSE = 1e-6  # of the largest traction: tolerances of 1e-10 and the condition of the problem
BESIDE = """// two blocks beside one another on {below}, pressed down, pushed together and let go
include "scene.idp"
int[int] sb = [11, 12, 13, 14], sc = [21, 22, 23, 24];
addBody(square({left}, 3, [-4 + 4*x, 3*y], label = sb)) bodyMaterial("B", 400., 0.3);
addBody(square({right}, 3, [4*x, 3*y], label = sc)) bodyMaterial("C", 300., 0.3);
{more}
quasistatic(2.);
macro stepTimes() [1., 1.5] //
macro friction() 0.3 //
macro load1() traction(13, 0., -4.) + traction(23, 0., -2.) //
macro amplitude1(t) min(1., t) //
macro load2() traction(14, 2.4, 0.) + traction(22, -1., 0.) //
macro amplitude2(t) (t < 1. ? 0. : (t < 1.5 ? 2*(t - 1.) : 2*(2 - t))) //
include "export.idp"
"""
FLOOR = "macro contact() 11, 21 //\nmacro contactPair() 12, 24 //"
BODY = """int[int] sa = [1, 2, 3, 4];
addBody(square(12, 2, [-6 + 12*x, -2 + 2*y], label = sa)) bodyMaterial("A", 500., 0.3);
macro support() on(1, u1 = 0., u2 = 0.) //
macro contactPair() 11, 3, 21, 3, 12, 24 //"""


def by_place(run) -> np.ndarray:
    """(steps, nodes, 2) tractions, sorted by boundary and place."""
    c = run.contact
    order = np.lexsort((c["y"][0].round(9), c["x"][0].round(9), c["boundary"][0]))
    return np.stack([c["sigma_n"], c["sigma_t"]], axis=2)[:, order]


@pytest.mark.slow
@pytest.mark.parametrize("more, element", [(FLOOR, "P1"), (FLOOR, "P2"), (BODY, "P1")])
@pytest.mark.some(1)
def test_forces_where_two_blocks_and_what_they_stand_on_meet(solved, named_scene, more, element):
    """The same at any cut and on two ranks, within Coulomb's law, and in balance."""
    path = named_scene("beside", BESIDE.format(below="a floor", left=5, right=4, more=more))
    runs = [solved(path, steps=8, element=element, **TIGHT, **cut) for cut in (
        {"subdomains": 2 + (more == BODY)}, {"subdomains": 5}, {"subdomains": 7, "np": 2})]
    one = by_place(runs[0])
    largest = np.abs(one).max()
    for other in runs[1:]:
        assert np.abs(by_place(other) - one).max() <= CLOSE * largest
    c = runs[0].contact
    assert (np.abs(c["sigma_t"]) <= c["bound"] + 1e-12 * largest).all()
    assert max(runs[0].summary["residuals"].values()) < 1e-5


FOUR = """// four blocks that meet in a point on a floor, pressed, then pushed and dragged
include "scene.idp"
units("mm", "MPa");
int[int] s1 = [11, 12, 13, 14], s2 = [21, 22, 23, 24], s3 = [31, 32, 33, 34], s4 = [41, 42, 43, 44];
addBody(square(4, 3, [4.*(x - 1) - GAP, 3.*y], label = s1))
addBody(square(4, 4, [4.*x, 3.*y], label = s2))
addBody(square(3, 3, [4.*(x - 1) - GAP, 3. + 3.*y], label = s3))
addBody(square(4, 3, [4.*x, 3. + 3.*y], label = s4))
quasistatic(2.);
macro stepTimes() [1.] //
macro young() 1000. //
macro poisson() 0.3 //
macro load1() traction(33, 0., -2.) + traction(43, 0., -1.5) //
macro amplitude1(t) min(1., t) //
macro load2() traction(14, 0.6, 0.) + traction(22, -0.6, 0.) + traction(34, 0.8, 0.)
  + traction(42, -0.4, 0.) //
macro amplitude2(t) max(0., t - 1.) //
macro contact() 11, 21 //
macro contactPair() 12, 24, 13, 31, 23, 41PAIR //
macro friction() 0.5 //
MORE
include "export.idp"
"""
APART = ", 32, 44"


@pytest.mark.parametrize("pair, gap, more, close", [
    (APART, 0.0, "", 1e-5),
    (APART, 0.0, "macro normalCompliance() 2000. //", 1e-6),
    (APART, 0.0, "macro largeSliding() 2. //", 1e-5),
    (APART, 0.0, "macro wear() 1e-3 //", 1e-4),
    (APART, 2e-5, "", 1e-5),  # which slide as the gap closes
    ("", 0.0, "macro tie() 32, 44 //", 1e-6)])
@pytest.mark.some(1)
def test_forces_where_four_blocks_meet(solved, named_scene, pair, gap, more, close):
    """The same at two cuts, whatever laws the boundaries have; rough ones obey theirs."""
    text = FOUR.replace("PAIR", pair).replace("GAP", str(gap)).replace("MORE", more)
    path = named_scene("four", text)
    tight = {"rtol": "1e-10", "friction_rtol": "1e-9", "primal_rtol": "1e-9"}
    one, other = (solved(path, steps=6, subdomains=cut, **tight) for cut in (4, 13))
    assert one.status == other.status == 0
    largest = np.abs(by_place(one)).max()
    assert np.abs(by_place(other) - by_place(one)).max() <= close * largest
    if "normalCompliance" in more:
        c = one.contact
        law = 2000 * np.maximum(c["u_n"] - c["gap"], 0)
        np.testing.assert_allclose(-c["sigma_n"], law, atol=1e-6 * largest)


WALL = """// bricks in running bond on a floor, pressed from above and pushed at the top
include "scene.idp"
func mesh brick(real left, real y0, int halves, int base) {{
  mesh Th = square(2*halves, 2, [left + halves*x, y0 + y]);
  return change(Th, flabel = base + (label == 1)*(1 + (x > left + 1)) + 3*(label == 2)
                             + (label == 3)*(4 + (x > left + 1)) + 6*(label == 4));
}}
{bricks}
quasistatic(1.);
macro young() 5e4 //
macro poisson() 0.2 //
macro contact() {floor} //
macro contactPair() {pairs} //
macro friction() 0.5 //
macro bodyForce1() [0., -0.4] //
macro load2() {loads} //
macro amplitude2(t) min(1., 4*t) //
macro load3() traction({push}, 0.17, 0.) //
macro amplitude3(t) max(0., (t - 0.25)/0.75) //
include "export.idp"
"""


def wall(rows: int, length: int) -> str:
    """Scene of a wall so many bricks high and long, halves at the ends of every other row."""
    bricks, pairs, floor, below = [], [], [], {}
    for row in range(rows):
        ends, tops = sorted({0, 2 * length, *range(row % 2, 2 * length + 1, 2)}), {}
        for left, right in zip(ends, ends[1:]):
            base = 10 * (len(bricks) + 1)
            bricks.append(f"addBody(brick({left}, {row}, {right - left}, {base}))")
            for half in range(right - left):
                tops[left + half] = base + 4 + half
                under = below.get(left + half)
                floor += [] if under else [base + 1 + half]
                pairs += [base + 1 + half, under] if under else []
            pairs += [base - 7, base + 6] if left else []
        below, push = tops, base - 10 * (len(ends) - 2) + 6
    return WALL.format(
        bricks="\n".join(bricks), floor=", ".join(map(str, floor)), push=push,
        pairs=", ".join(map(str, pairs)),
        loads=" + ".join(f"traction({label}, 0., -0.2)" for label in below.values()))


@pytest.mark.slow  # two runs of a dozen bodies
def test_a_wall_of_bricks_is_solved_by_its_contact_rows(solved, named_scene):
    """Vertices where three bricks meet: states by forces that go around there had Newton's method
    go to and fro, and thousands of products were taken instead. The same at another cut.
    """
    path = named_scene("wall", wall(4, 3))
    one, other = (solved(path, steps=4, **cut, **TIGHT) for cut in ({}, {"subdomains": 23}))
    counts = one.summary["counts"]
    assert counts["condensed_steps"] == 4 and counts["dual_multiplications"] < 40
    largest = np.abs(by_place(one)).max()
    assert np.abs(by_place(other) - by_place(one)).max() <= 1e-5 * largest


def test_without_bodies_that_meet_there_are_none(built):
    for scene in ("model", "wedge"):
        contact = built(scene).structure.contact
        assert junctions(contact, np.zeros(0, int), np.zeros(len(contact.gid), bool)) == []


# what the pair presses, the floor takes as friction under both; and its friction as pressure
FREE = np.array([[0, 1], [1, 0], [0, -1], [-1, 0], [1, 0], [0, 1.0]]) / np.sqrt(3)


def nearest(force, moved, near, F=0.3, wears=False, known=True, bilateral=False, given=None):
    """Forces of three nodes of which the first two stand on a floor, the third between them."""
    force = np.array(force)
    bound = F * np.abs(force[:, 0]) if given is None else np.array(given)
    found = junction_forces.Found(force, np.array(moved), np.full(3, F), np.zeros(3),
                                  np.full(3, bilateral), np.full(3, wears), bound,
                                  given is not None, 1e-6)
    return junction_forces._nearest(Junction(np.arange(3), np.arange(6), FREE), found,
                                    np.array(near), np.full(3, known))


def total(force):
    """What moves the two vertices."""
    f = np.array(force)
    return [f[0, 0] - f[2, 1], f[0, 1] - f[2, 0], f[1, 0] + f[2, 1], f[1, 1] + f[2, 0]]


def test_forces_are_as_near_to_those_beside_as_the_laws_allow():
    force = [[2.0, 0.1], [3.0, 0.2], [0.5, 0.1]]
    still = np.zeros((3, 2))
    # what is beside obeys and moves nothing: that
    aim = np.array(force) + 0.05 * np.array([[1, 1], [-1, -1], [1, 1.0]])
    found = nearest(force, still, aim)
    np.testing.assert_allclose(found, aim, atol=1e-8)
    # beyond a law: on its bound
    found = nearest(force, still, np.array(force) + [[0, 3], [0, -3], [3, 0.0]])
    assert total(found) == pytest.approx(total(force), abs=1e-7)
    assert (np.abs(found[:, 1]) <= 0.3 * found[:, 0] + 1e-12).all()
    assert np.abs(found[0, 1]) == pytest.approx(0.3 * found[0, 0])


@pytest.mark.parametrize("bilateral", [False, True])
@pytest.mark.parametrize("around", [[-0.3, 0.2], [-5.0, 2.0], [4e8, 3e8], [-2e7, 1e8]])
def test_forces_that_a_solver_leaves_going_around_do_not_count(around, bilateral):
    """However large, of either sign: jammed bodies, and bilateral contact, whose cones are two."""
    force, still = np.array([[2.0, 0.1], [3.0, 0.2], [0.5, 0.1]]), np.zeros((3, 2))
    aim = force + [[0, 3], [0, -3], [-3, 0.0]]
    one = nearest(force, still, aim, bilateral=bilateral)
    other = nearest(force + (FREE @ around).reshape(3, 2), still, aim, bilateral=bilateral)
    rounded = 1e-7 + 1e-15 * np.abs(around).max()
    np.testing.assert_allclose(other, one, atol=rounded)
    assert total(other) == pytest.approx(total(force), abs=rounded)


def test_what_slides_and_what_is_open_stay_so():
    force = [[2.0, 0.6], [3.0, 0.2], [0.5, 0.1]]
    found = nearest(force, [[0, -1e-3], [0, 0], [0, 0.0]], np.array(force) + 0.1)
    assert found[0, 1] == pytest.approx(0.3 * found[0, 0], rel=1e-12)
    assert total(found) == pytest.approx(total(force), abs=1e-7)
    # and keeps its pressure if it wears
    found = nearest(force, [[0, -1e-3], [0, 0], [0, 0.0]], np.array(force) + 0.1, wears=True)
    assert found[0] == pytest.approx(force[0], abs=1e-7)
    # pressed anew, what slides has the friction of it, against its way
    force[0] = [0.0, 0.0]
    aim = np.array(force) + [[0.3, 0], [0, 0], [0, 0]]
    found = nearest(force, [[0, 1e-3], [0, 0], [0, 0.0]], aim)
    assert found[0, 0] > 0.01 and found[0, 1] == pytest.approx(-0.3 * found[0, 0], rel=1e-6)
    force[2] = [0.0, 0.0]
    found = nearest(force, [[0, 0], [0, 0], [1e-3, 0.0]], np.array(force) + 0.1)
    assert not found[2].any()


def test_of_given_friction_what_slides_keeps_it():
    """The pressure is the nearest by which it does, its bound goes with that: here by 0.05 more,
    with which friction between the blocks is on its bound.
    """
    force, slips = [[2.0, 0.6], [3.0, 0.2], [0.5, 0.1]], [[0, -1e-3], [0, 0], [0, 0.0]]
    aim = np.array(force) + [[0.4, 0.3], [0.0, 0.0], [0.0, 0.2]]
    found = nearest(force, slips, aim, given=[0.6, 0.9, 0.15])
    assert found[0] == pytest.approx([2.05, 0.3 * 2.05])
    kept = found.copy()
    kept[0, 1] = 0.6
    assert total(kept) == pytest.approx(total(force), abs=1e-14)
    assert (np.abs(kept[1:, 1]) <= 0.3 * kept[1:, 0] + 1e-14).all()
    force[2], slips[2] = [0.0, 0.0], [1e-3, 0.0]  # apart: no force at all, not one of rounding
    assert not nearest(force, slips, aim, given=[0.6, 0.9, 0.0])[2].any()


SLIDING = """// two blocks abreast on a floor that drags them on, to one of which it clings
include "scene.idp"
quasistatic(1.);
int[int] sb = [11, 12, 13, 14], sc = [21, 22, 23, 24];
addBody(square(6, 4, [1.5*x, y], label = sb)) bodyMaterial("B", 300., 0.3);
addBody(square(6, 4, [1.5*(1. + x), 1.2*y], label = sc)) bodyMaterial("C", 300., 0.4);
macro contact() 11, 14, 21 //
macro contactPair() 12, 24 //
macro friction() 0.3 //
macro cohesion() 0.16 //
real slipRange = 0.05;
macro slipFactor(s) (1. - 0.3*min(1., s/0.05)) //
macro bilateral() (label == 11) //
macro load1() traction(23, 0., -0.7) //
macro amplitude1(t) min(1., 2*t) //
macro obstacleX(t) 0.006*t //
include "export.idp"
"""


def test_friction_where_bodies_meet_and_slide(solved, named_scene, monkeypatch):
    """Displacements leave open what presses there, and friction depends on it: one solution at any
    cut, the other ones are said to be there where it is not found.
    """
    path = named_scene("sliding", SLIDING)
    tight = {"rtol": "1e-10", "friction_rtol": "1e-9", "primal_rtol": "1e-8", "steps": 2}
    one, other = (solved(path, subdomains=cut, **tight) for cut in (1, 5))
    largest = np.abs(by_place(one)).max()
    assert np.abs(by_place(other) - by_place(one)).max() <= 1e-6 * largest
    assert "several" not in " ".join(one.summary["warnings"])
    monkeypatch.setattr(junction_bounds, "gives_up", len)
    left = solved(path, subdomains=2, **tight)
    assert "one of several solutions at (1.5, 0)" in " ".join(left.summary["warnings"])
    assert np.abs(by_place(left) - by_place(one)).max() > 1e-4 * largest
    closed, c = left.contact["sigma_n"] < 0, left.contact  # bodies are where those forces have them
    np.testing.assert_allclose((c["u_n"] - c["gap"])[closed], 0.0, atol=1e-6 * c["u_t"].max())


ABREAST = """// three blocks abreast, the first of which is held, on a floor that drags them
include "scene.idp"
quasistatic(1.);
int[int] sb = [11, 12, 13, 14], sc = [21, 22, 23, 24], sd = [31, 32, 33, 34];
addBody(square(8, 6, [x, 1.3*y], label = sb)) bodyMaterial("B", 300., 0.3);
addBody(square(8, 7, [1. + x, 0.8*y], label = sc)) bodyMaterial("C", 300., 0.45);
addBody(square(5, 4, [2. + 2.*x, 0.8*y], label = sd)) bodyMaterial("D", 300., 0.2);
macro contact() 11, 21, 31 //
macro contactPair() 12, 24, 22, 34 //
macro support() on(14, u1 = 0.) //
macro friction() 0.3 //
macro cohesion() 0.05 //
macro load1() traction(13, 0., -2.) + traction(23, 0., -0.5) + traction(33, 0., -1.) //
macro amplitude1(t) 1. //
macro obstacleX(t) 0.003*t //
include "export.idp"
"""


PUSHED = """// three blocks abreast, pushed together over gaps: what sticks on its bound has
// friction of the other sign by other forces
include "scene.idp"
quasistatic(2.);
int[int] sb = [11, 12, 13, 14], sc = [21, 22, 23, 24], sd = [31, 32, 33, 34];
addBody(square(7, 6, [x, 0.8*y], label = sb)) bodyMaterial("B", 100., 0.3);
addBody(square(8, 5, [1.0001 + 1.5*x, 0.8*y], label = sc)) bodyMaterial("C", 1000., 0.3);
addBody(square(9, 4, [2.5002 + 1.5*x, 0.8*y], label = sd)) bodyMaterial("D", 100., 0.45);
macro contact() 11, 21, 31 //
macro contactPair() 12, 24, 34, 22 //
macro friction() 0.1 //
macro load1() traction(13, 0., -1.) + traction(23, 0., -0.5) + traction(33, 0., -1.) //
macro amplitude1(t) min(1., 3*t) //
macro load2() traction(14, 1., 0.) + traction(32, -0.8, 0.) //
macro amplitude2(t) t //
include "export.idp"
"""


@pytest.mark.parametrize("scene", [ABREAST, PUSHED], ids=["dragged", "pushed"])
def test_forces_where_much_slides_settle_soon(solved, named_scene, scene):
    """Bounds that go with forces hardly contract at two junctions: 1500 products by themselves."""
    run = solved(named_scene("abreast", scene), steps=5, subdomains=3, rtol="1e-10",
                 friction_rtol="1e-9", primal_rtol="1e-8")
    assert run.status == 0 and run.summary["counts"]["dual_multiplications"] < 200
    assert "several" not in " ".join(run.summary["warnings"])


def test_forces_that_no_law_bears_are_left():
    force = [[2.0, 0.1], [-3.0, 0.2], [0.5, 0.1]]
    assert nearest(force, np.zeros((3, 2)), force).tolist() == force
    assert not nearest(np.zeros((3, 2)), np.zeros((3, 2)), np.ones((3, 2))).any()


SOFT = """// a soft block pushed against a stiff one beside it, both on a floor to which they stick
include "scene.idp"
units("mm", "MPa");
int[int] sb = [1, 11, 21, 31], sc = [101, 111, 121, 131];
addBody(square(9, 7, [0.9*x, 0.75*y], label = sb)) bodyMaterial("soft", 5., 0.2);
addBody(square(7, 5, [0.9 + x, 0.65*y], label = sc)) bodyMaterial("stiff", 5000., 0.2);
quasistatic(1.);
macro support() on(111, u1 = 0., u2 = 0.) //
macro load1() traction(31, 0.02, -0.015) //
macro contact() 1, 101 //
macro contactPair() 11, 131 //
macro friction() 0.1 //
macro cohesion() (label == 11 ? 0.00075 : 0.0075) //
macro amplitude1(t) t //
include "export.idp"
"""


@pytest.mark.slow
def test_a_soft_and_a_stiff_block_that_meet_on_a_floor(solved, named_scene):
    """Forces that go around the place where they meet are no residual, at any cut."""
    path = named_scene("soft", SOFT)
    runs = [solved(path, steps=2, **TIGHT, **cut) for cut in (
        {"subdomains": 1}, {"subdomains": 3}, {"subdomains": 30, "np": 2})]
    one = by_place(runs[0])
    for run in runs:
        assert run.status == 0 and run.summary["residuals"]["stationarity"] < 1e-6
        assert np.abs(by_place(run) - one).max() <= CLOSE * np.abs(one).max()
