"""Obstacles that move: relative motion alone matters, F times N at full sliding, paths, misuse."""

import meshio
import numpy as np
import pytest

from driver.contact.motion import ObstacleMotion
from driver.files import read_rows, read_table
from driver.results.tables import contact_file
from driver.studies.study import make_study

REPEATED = pytest.mark.slow  # the same with other settings: each takes two runs
TIGHT = {"rtol": 1e-13, "friction_rtol": 1e-11, "primal_rtol": 1e-9}

# A pressed block on a floor that slides to the right and back; it is held at its top.
PAD = """include "scene.idp"
real F = physical("friction", 0.3), way = physical("way", 0.5);
subdomains("2x2");
rectangle(0., 4., 0., 2.);
quasistatic(2.);
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(3, u1 = 0.) //
macro load1() pressure(3, 2.) //
macro amplitude1(t) min(1., 2*t) //
macro contact() 1 //
macro friction() F //
macro obstacleX(t) (way*(1. - abs(t - 1.))) //
include "export.idp"
"""

# A body between a floor and a leaning wall, which meet it on a path.
PATH = """include "scene.idp"
real s = 1e-3*physical("size", 1.), way = 1e-6*physical("turned", 0.);
real h = meshSize(0.3), F = physical("friction", 0.4);
border below(t=0, 1) { x = 3*t; y = 0.1*t; label = 7; }
border wall(t=0, 1) { x = 3 + 0.2*t; y = 0.1 + 1.4*t; label = 2; }
border top(t=0, 1) { x = 3.2 - 3*t; y = 1.5; label = 9; }
border left(t=0, 1) { x = 0.2 - 0.2*t; y = 1.5 - 1.5*t; label = 4; }
body = buildmesh(below(3/h) + wall(1.5/h) + top(3/h) + left(1.5/h));
quasistatic(1.);
macro pathX(t) (s*(0.3*t - sin(4*t))) //
macro pathY(t) (s*(sin(3*t))) //
macro young() 1e3 //
macro poisson() 0.3 //
macro contact() 7, 2 //
macro obstacle(x, y) ((label == 7 ? (y) - 0.1*(x)/3 : (3 - (x) + ((y) - 0.1)*0.2/1.4)/1.1)
                      + (label == 2 ? 0.4*s : 0.)) //
macro friction() F //
WHAT MOVES
include "export.idp"
"""
OBSTACLES = """macro support() on(9, u1 = 0., u2 = 0.) //
macro obstacleX(t) pathX(t) //
macro obstacleY(t) pathY(t) //
"""
BODY = """macro displacement1() on(9, u1 = -1., u2 = 0.) //
macro displacement2() on(9, u1 = 0., u2 = -1.) //
macro displacement3() on(9, u1 = y - 0.7, u2 = -(x - 1.)) //
macro amplitude1(t) pathX(t) //
macro amplitude2(t) pathY(t) //
macro amplitude3(t) (way*sin(2*t)) //"""
ANGLE = """macro obstacleAngle(t) (way*sin(2*t)) //
macro obstaclePivot() [1., 0.7] //"""


def frames(solved, scene, *changes, angle="", **options):
    """Runs of PATH in which the obstacles move, and in which the body does."""
    moving = scene(PATH, ("WHAT MOVES", OBSTACLES + angle), *changes, name="moving")
    body = scene(PATH, ("WHAT MOVES", BODY), *changes, name="body")
    return [solved(path, steps=6, **TIGHT, **options) for path in (moving, body)]


def assert_same_contact(one, other, tolerance: float) -> None:
    """The same forces, states and relative motion.

    What rests in a corner with just the friction that it can have sticks or slips by rounding.
    """
    for name in ("sigma_n", "sigma_t", "slip"):
        size = np.abs(other.contact[name]).max()
        np.testing.assert_allclose(one.contact[name], other.contact[name], atol=tolerance * size)
    c = other.contact
    ties = ((np.abs(c["slip"]) < 1e-9 * np.abs(c["slip"]).max()) & (c["status"] != "open")
            & (np.abs(c["sigma_t"]) >= (1 - 1e-9) * c["bound"]))
    np.testing.assert_array_equal(np.where(ties, "", one.contact["status"]),
                                  np.where(ties, "", c["status"]))
    over = [run.contact["u_n"] - run.contact["gap"] for run in (one, other)]
    np.testing.assert_allclose(*over, atol=tolerance * np.abs(other.contact["u_n"]).max())


@pytest.mark.parametrize("options", [
    {}, pytest.param({"element": "P2", "subdomains": 5}, marks=REPEATED),
    pytest.param({"element": "P2-mixed", "subdomains": "1"}, marks=REPEATED)])
def test_a_block_on_a_sliding_floor_drags_with_friction_times_pressure(solved, scene, options):
    """F N to 1e-9 of N, N the pressing force, and -F N after the floor has turned back."""
    run = solved(scene(PAD), cells=3, steps=8, **TIGHT, **options)
    table = read_table(run.directory / "boundaries.csv")
    sliding = [3, 4, 8]  # steps; in others some node may stick
    normal, drag = (np.array(table[f"{name}_resultant"])[[k - 1 for k in sliding]]
                    for name in ("normal", "tangential"))
    np.testing.assert_allclose(normal, 8.0, rtol=1e-9)
    np.testing.assert_allclose(drag, 0.3 * normal * [1, 1, -1], rtol=1e-9)
    times = np.linspace(0, 2, 9)
    assert run.summary["obstacle_motion"] == {
        "1": {"shift_x": pytest.approx(0.5 * (1 - abs(times - 1)), abs=1e-15)}}
    # what slides takes F N over the way of the floor: an eighth of 1 in the last step
    work = np.array(table["dissipated_energy"])
    assert work[-1] - work[-2] == pytest.approx(0.3 * 8 * 0.125, rel=1e-8)


@pytest.mark.slow  # two runs
def test_one_step_of_sliding_ends_as_many(solved, scene):
    """Where all slides the state is that of the last floor's direction alone."""
    runs = [solved(scene(PAD, ("(way*(1. - abs(t - 1.)))", "(way*t)")), cells=3, steps=n, **TIGHT)
            for n in (1, 6)]
    for name in ("sigma_n", "sigma_t", "u_t"):
        one, many = (run.contact[name][-1] for run in runs)
        np.testing.assert_allclose(one, many, atol=1e-8 * np.abs(many).max())
    assert runs[0].contact["slip"][-1] == pytest.approx(runs[1].contact["slip"].sum(axis=0))


@pytest.mark.parametrize("changes, options", [
    ([], {"element": "P2", "subdomains": 5}), pytest.param([], {}, marks=REPEATED),
    pytest.param([("macro friction() F", "macro tresca() (label == 2 ? 0.4 : 0.2)")], {},
                 marks=REPEATED),
    pytest.param([("macro friction() F //", """macro friction() F //
macro bilateral() (label == 2 ? 1. : 0.) //""")], {"subdomains": "3"}, marks=REPEATED),
    pytest.param([("macro friction() F //", """macro friction() F //
macro slipFactor(s) (1. - 200*(s)) //
real slipRange = 2e-3;""")], {}, marks=REPEATED)])
@pytest.mark.slow
def test_moving_the_obstacles_is_moving_the_body_back(solved, scene, changes, options):
    """Two flat obstacles on one path, and the body on the opposite one: contact cannot tell."""
    obstacles, body = frames(solved, scene, *changes, **options)
    assert {"slip", "stick", "open"} & set(body.contact["status"].ravel())
    assert len(set(body.contact["status"].ravel())) > 1
    assert_same_contact(obstacles, body, 1e-8)
    np.testing.assert_allclose(obstacles.history["dissipated"], body.history["dissipated"],
                               rtol=1e-7, atol=1e-9 * body.history["dissipated"].max())


@pytest.mark.slow  # two runs
def test_turning_the_obstacles_is_turning_the_body_back(solved, scene):
    """By a microradian, beside a small shift: the body's linear rotation errs by its square."""
    still = ("macro pathX(t) (s*(0.3*t - sin(4*t)))", "macro pathX(t) (0.)"), (
        "macro pathY(t) (s*(sin(3*t)))", "macro pathY(t) (0.5e-6*t)")
    obstacles, body = frames(solved, scene, *still, angle=ANGLE, turned=1, size=0)
    assert set(body.contact["status"].ravel()) >= {"slip", "stick"}
    assert_same_contact(obstacles, body, 1e-5)


@pytest.mark.slow  # two runs with estimates
def test_estimates_hold_for_moving_obstacles(solved, scene):
    """The error in the energy norm knows the relative motion alone."""
    obstacles, body = frames(solved, scene, errors="energy", h=0.5)
    one, other = (run.summary["errors"]["energy"] for run in (obstacles, body))
    assert other["total"] > 0
    for name in ("mesh", "total"):
        assert one[name] == pytest.approx(other[name], rel=1e-5)


@pytest.mark.slow  # three runs
def test_what_a_moving_obstacle_has_come_to_is_its_function_there(solved, scene):
    """A parabola on a path, as obstacle(x, y) that shifts, as function and as gap of time."""
    text = PAD.replace("contact() 1", "contact() 1 //\nmacro contactNormal() [0., -1.]")
    text = text.replace("macro obstacleX(t) (way*(1. - abs(t - 1.))) //", "SHAPE")
    shapes = ["""macro obstacle(x, y) ((y) + ((x) - 1)^2/80.) //
macro obstacleX(t) (2*t) //
macro obstacleY(t) (0.01*t) //""", """macro obstacleInTime(x, y, t)
((y) - 0.01*(t) + ((x) - 1 - 2*(t))^2/80.) //
macro obstacleX(t) (2*t) //""", """macro gapInTime(t) ((x - 1 - 2*(t))^2/80. - 0.01*(t)) //
macro obstacleX(t) (2*t) //"""]
    runs = [solved(scene(text, ("SHAPE", shape), name=f"shape{k}"), cells=4, steps=4, **TIGHT)
            for k, shape in enumerate(shapes)]
    c = runs[0].contact
    np.testing.assert_allclose(c["gap"], (c["x"] - 1 - 2 * c["time"])**2 / 80 - 0.01 * c["time"],
                               atol=1e-9)
    assert {"open", "slip"} <= set(c["status"].ravel())
    for other in runs[1:]:
        np.testing.assert_allclose(other.contact["gap"], c["gap"], atol=1e-9)
        assert_same_contact(other, runs[0], 1e-6)  # slopes by differences are good to 1e-10


def test_an_obstacle_that_does_not_move_is_one_that_stands(solved, scene):
    """Normals and distances are those of the obstacle, as without a motion."""
    text = PAD.replace("macro obstacleX(t) (way*(1. - abs(t - 1.))) //",
                       "macro obstacle(x, y) (sqrt((x - 2)^2 + (y + 9)^2) - 9) //")
    still = "macro obstacleY(t) 0.*t //\ninclude \"export.idp\""
    one, other = (solved(path, cells=4, steps=2, **TIGHT) for path in (
        scene(text, name="stands"), scene(text, ('include "export.idp"', still), name="still")))
    np.testing.assert_allclose(other.contact["normal_x"], one.contact["normal_x"], atol=1e-9)
    assert_same_contact(other, one, 1e-7)


@pytest.mark.slow  # a run for two tables
def test_laws_of_displacement_see_that_on_the_floor(solved, scene):
    """Friction that depends on |u_t| knows where the floor has gone; ParaView's lines have it."""
    law = """macro friction() F //
macro displacementFactor(s) (1. - 10*(s)) //
real slipRange = 0.1;"""
    run = solved(scene(PAD, ("macro friction() F //", law),
                       ("obstacleX(t)", "obstacleY(t) (1e-3*t) //\nmacro obstacleX(t)")),
                 cells=3, steps=4, fields="yes", **TIGHT)
    c = run.contact
    time = run.history["time"]
    gone = run.summary["parameters"]["way"] * (1 - np.abs(time - 1))  # along x, as the tangent
    factor = 1 - 10 * np.minimum(np.abs(c["u_t"] - gone[:, None]), 0.1)
    assert factor.min() < 0.99
    np.testing.assert_allclose(c["bound"], -0.3 * factor * c["sigma_n"], rtol=1e-6, atol=1e-12)
    line = meshio.read(run.directory / contact_file(4)).point_data
    np.testing.assert_allclose(line["gap"], -2e-3, rtol=1e-9)
    np.testing.assert_allclose(line["obstacle"], np.outer(c["gap"][-1], [0, -1, 0]), rtol=1e-9)


@pytest.mark.slow  # wear has tests of its own
def test_a_floor_that_runs_wears_the_block(solved, scene):
    """Archard's law node by node with the way of the floor, which the block itself does not go."""
    run = solved(scene(PAD, ("macro friction() F //", """macro friction() F //
macro wear() 1e-3 //"""), ("(way*(1. - abs(t - 1.)))", "(way*max(0., t - 1.))")), cells=3, steps=8,
                 rtol=1e-11, friction_rtol=1e-9)
    c = run.contact
    worn = np.cumsum(-1e-3 * np.abs(c["slip"]) * c["sigma_n"], axis=0)
    closed = c["sigma_n"] < 0
    over = c["u_n"] - c["gap"]
    np.testing.assert_allclose(over[closed], worn[closed], atol=1e-5 * worn.max())
    assert worn[-1] @ c["weight"][-1] == pytest.approx(1e-3 * 8 * 0.5, rel=0.03)  # till it slides


def test_a_block_on_a_belt_presses_the_stop_with_its_friction(solved, scene):
    """Nothing else supports it: the belt runs, the stop stands."""
    run = solved(scene(PAD, ("macro support() on(3, u1 = 0.) //\n", ""),
                       ("contact() 1", "contact() 1, 2"),
                       ("macro friction() F", "macro friction() (label == 1 ? F : 0.)"),
                       ("(way*(1. - abs(t - 1.)))", "(label == 1 ? way*t : 0.)")),
                 cells=3, steps=2, subdomains=5, **TIGHT)
    table = read_table(run.directory / "boundaries.csv")
    last = {label: k for k, label in enumerate(np.array(table["boundary"]).tolist())}
    normal = np.array(table["normal_resultant"])
    assert normal[last[1]] == pytest.approx(8.0, rel=1e-8)
    assert normal[last[2]] == pytest.approx(0.3 * 8.0, rel=1e-8)


@pytest.mark.slow  # others cover both parts
def test_a_floor_moves_below_two_bodies(solved, scene):
    """It drags the lower one with F N; the pair between the bodies carries that on."""
    run = solved(scene(PAD, ('subdomains("2x2");\nrectangle(0., 4., 0., 2.);', """
int[int] below = [5, 6, 7, 8];
addBody(square(9, 4, [4*x, 1 + y]))
addBody(square(7, 4, [4*x, y], label = below))
macro contactPair() 1, 7 //"""), ("contact() 1", "contact() 5"),
                       ("macro friction() F", "macro friction() (label == 5 ? F : 2*F)")),
                 steps=4, subdomains=4, **TIGHT)
    table = read_table(run.directory / "boundaries.csv")
    drag = np.array(table["force_x"])[-2:]
    np.testing.assert_allclose(np.abs(drag), 0.3 * 8, rtol=1e-7)
    assert (run.contact["status"][-1] == "stick").any()  # between the bodies


ROUND = """include "scene.idp"
quasistatic(1.);
border low(t = -3*pi/4, -pi/4) { x = cos(t); y = sin(t); label = 4; }
border right(t = -pi/4, pi/4) { x = cos(t); y = sin(t); label = 6; }
border high(t = pi/4, 5*pi/4) { x = cos(t); y = sin(t); label = 8; }
border hole(t = 2*pi, 0) { x = 0.3*cos(t); y = 0.3*sin(t); label = 5; }
mesh disc = buildmesh(low(8) + right(8) + high(16) + hole(10));
int[int] names = [6, SIDE];
disc = change(disc, label = names);
addBody(disc)
bodyMaterial("steel", 1., 0.3);
macro displacement1() on(5, u1 = 0., u2 = -0.01) //
macro amplitude1(t) t //
macro obstacle(x, y) (y + 1.) //
macro obstacleX(t) (0.02*t) //
macro contact() LABELS //
macro tresca() 0.01 //
include "export.idp"
"""


def test_a_round_side_that_turns_away_from_a_moving_floor_is_cut_anywhere(solved, scene):
    """Friction that needs no pressure acts along the normals of nodes, in whatever subdomain and
    with whatever label its parts are.
    """
    whole = solved(scene(ROUND, ("SIDE", "6"), ("LABELS", "4, 6"), name="whole"), subdomains="1",
                   **TIGHT)
    for guise, label, cut in (("labels", "4", "1"), ("five", "6", "5")):
        labels = "4" if label == "4" else "4, 6"
        run = solved(scene(ROUND, ("SIDE", label), ("LABELS", labels), name=guise), subdomains=cut,
                     **TIGHT)
        assert run.summary["sizes"]["contact_nodes"] == whole.summary["sizes"]["contact_nodes"]
        for name in ("dissipated_energy", "displacement"):
            np.testing.assert_allclose(run.summary["quantities"][name],
                                       whole.summary["quantities"][name], rtol=1e-6)


@pytest.mark.slow  # starts processes
def test_ranks_do_not_change_a_bit(solved, scene):
    one, other = (solved(scene(PAD), cells=3, steps=4, np=n) for n in (1, 3))
    for name, values in one.contact.items():
        np.testing.assert_array_equal(values, other.contact[name])


@pytest.mark.slow  # two runs
@pytest.mark.parametrize("motion", ["macro obstacleX(t) (way*(1. - abs(t - 1.))) //", """
macro obstacle(x, y) (y - 0.01*(x - 2)^2) //
macro obstacleX(t) (way*t) //
macro obstacleY(t) (0.02*way*t) //"""])
@pytest.mark.slow  # a study and a run of its last value
def test_studies_vary_the_way(solved, scene, tmp_path, motion):
    """Every value has its own distances and ways: fields and history are those of a single run."""
    path = scene(PAD, ("macro obstacleX(t) (way*(1. - abs(t - 1.))) //", motion))
    options = {"cells": "3", "steps": "4", "rtol": "1e-11", "friction_rtol": "1e-10"}
    _, folder = make_study({"scene": str(path), "way": "0.1,0.5", "figures": "no", "quiet": "yes",
                            "out": str(tmp_path / "study"), **options})
    single = solved(path, way=0.5, **options)
    rows = [row for row in read_rows(folder / "contact.csv") if row["way"] == "0.5"]
    for name in ("sigma_n", "sigma_t", "u_n", "u_t"):
        wanted = single.contact[name][-1]
        np.testing.assert_allclose([float(row[name]) for row in rows], wanted,
                                   atol=1e-6 * np.abs(wanted).max(), err_msg=name)
    last = read_rows(folder / "study.csv")[-1]
    table = read_table(single.directory / "boundaries.csv")
    for name, column in (("dissipated", "dissipated_energy"), ("contact_length",) * 2):
        assert float(last[name]) == pytest.approx(table[column][-1], rel=1e-6)
    lengths = table["contact_length"].astype(float)
    assert single.history["contact_length"].tolist() == lengths.tolist()


def test_leaving_it_out_leaves_the_obstacle_where_it_was(solved, scene):
    run = solved(scene(PAD), cells=3, steps=2, without="obstacle_motion")
    assert np.abs(run.contact["slip"][-1]).max() < 1e-2
    ledger = solved(scene(PAD), cells=3, steps=4, np=1).summary["effects_ledger"]
    assert ledger["obstacle_motion"]["active"]


def test_what_steps_miss_of_a_path_is_said(solved, scene):
    """Three steps cut off the turn at t = 1, a third of the way, half of the 2/3 that they see;
    eight end there."""
    run = solved(scene(PAD, ("contact() 1", "contact() 1, 2"), ("macro friction() F", """
macro gap() (label == 2 ? 1. : 0.) //
macro friction() F"""), ("(way*(1. - abs(t - 1.)))", "(label == 1 ? way*(1. - abs(t - 1.)) : 0.)")
                       ), cells=2, steps=3)
    said = [line for line in run.summary["warnings"] if "obstacleX" in line]
    assert len(said) == 1 and "between steps by 50 %" in said[0] and "at time 1:" in said[0]
    run = solved(scene(PAD), cells=3, steps=8, **TIGHT)
    assert not any("obstacleX" in line for line in run.summary["warnings"])


@pytest.mark.parametrize("macro, shape", [
    ("gapInTime", "gapInTime(t) (0.1 + AWAY)"),
    ("obstacleInTime", "obstacleInTime(x, y, t) (y + 0.1 + AWAY*(2. + x))")])
def test_what_steps_miss_of_a_surface_that_changes_is_said(solved, scene, macro, shape):
    """A pulse between them, which nothing told of; not what grows evenly and errs by rounding."""
    for away, said in (("0.2*exp(-900.*(t - 0.7)^2)", True), ("0.3*t/7.", False)):
        text = scene(PAD, ("macro obstacleX(t) (way*(1. - abs(t - 1.))) //",
                           f"macro {shape.replace('AWAY', away)} //"), name=f"of{len(away)}")
        warnings = solved(text, cells=1, steps=4).summary["warnings"]
        lines = [line for line in warnings if f"{macro} deviates between steps" in line]
        assert len(lines) == said, warnings
        assert not said or "by 100 %" in lines[0] and "at time 0.7" in lines[0]


@pytest.mark.slow  # companions of many steps
def test_a_short_pulse_of_a_path_is_said_and_claimed_for_one_step(solved, scene):
    """Of 1/20 of the history: one step ends where the obstacle was before it."""
    pulse = scene(PAD, ("(way*(1. - abs(t - 1.)))", "(way*max(0., 1. - abs(t - 0.65)/0.05))"))
    run = solved(pulse, cells=3, steps=1, errors="yes")
    said = [line for line in run.summary["warnings"] if "obstacleX" in line]
    assert len(said) == 1 and "between steps by 100 %" in said[0] and "at time 0.6" in said[0]
    work = run.summary["errors"]["quantities"]["dissipated_energy"]
    true = solved(pulse, cells=3, steps=40).summary["quantities"]["dissipated_energy"]
    assert true > 2 * work["value"] and work["time"] > true - work["value"]


# ---- kinematics ----------------------------------------------------------------------------------

def motion_of(xy, shift, angle, pivot) -> ObstacleMotion:
    """Motion over two times of one obstacle that nodes at xy (n, 2) meet, with tangents along x."""
    n = len(xy)
    return ObstacleMotion(np.array([0.0, 1.0]), np.zeros((2, n)),
                          np.array([np.zeros((n, 2)), np.tile(shift, (n, 1))]),
                          np.array([np.zeros(n), np.full(n, angle)]), np.tile(pivot, (n, 1)),
                          np.array(xy, float), np.tile([1.0, 0.0], (n, 1)))


@pytest.mark.parametrize("angle", [0.1, 2.0, -3.0, 1.5 * np.pi, 2 * np.pi, 40.0])
def test_a_surface_that_turns_about_its_middle_goes_round(angle):
    """By the angle times the radius, however many turns that are; and back the same."""
    motion = motion_of([[0.0, -2.0], [3.0, -2.0]], [0.0, 0.0], angle, [0.0, 0.0])
    np.testing.assert_allclose(motion.way(0.0, 1.0), 2 * angle, rtol=1e-14)
    np.testing.assert_allclose(motion.way(1.0, 0.0), -2 * angle, rtol=1e-14)


def test_a_way_is_the_sum_of_its_parts():
    """Of an obstacle that shifts and turns evenly: time steps change nothing of how far it goes."""
    whole = motion_of([[0.3, -2.0], [3.0, 1.0]], [0.7, -0.4], 5.0, [0.2, 0.5])
    times = np.linspace(0.0, 1.0, 8)
    parts = ObstacleMotion(times, np.zeros((8, 2)), times[:, None, None] * whole.shift[1],
                           times[:, None] * whole.angle[1], whole.pivot, whole.xy, whole.tangent)
    np.testing.assert_allclose(sum(parts.way(*step) for step in zip(times, times[1:])),
                               whole.way(0.0, 1.0), rtol=1e-13)


def test_a_roller_does_not_slide_where_it_rests():
    """v - omega R = 0 half way; far above it goes twice as fast."""
    R, angle = 2.0, 0.01
    motion = motion_of([[0.0, 0.0], [0.0, 2 * R]], [R * angle, 0.0], -angle, [-R * angle / 2, R])
    below, above = motion.way(0.0, 1.0)
    assert abs(below) < 1e-15
    assert above == pytest.approx(2 * R * angle, rel=1e-14)


def test_the_way_back_is_the_way_there():
    """For a pivot that shifts, and tangents in any direction: what moved goes back where it was."""
    motion = motion_of([[0.3, -2.0], [3.0, 1.0]], [0.7, -0.4], 0.3, [0.2, 0.5])
    motion.tangent = np.array([[0.6, 0.8], [-0.8, 0.6]])
    np.testing.assert_allclose(motion.way(0.0, 1.0), -motion.way(1.0, 0.0), rtol=1e-14)


def test_shifts_of_any_size_are_exact():
    motion = motion_of([[0.1, 0.3]], [1e6 + 1 / 3, -5.0], 0.0, [1e8, 3.0])
    assert motion.way(0.0, 1.0)[0] == 1e6 + 1 / 3


# ---- misuse --------------------------------------------------------------------------------------

SHIFT = "macro obstacleX(t) (way*(1. - abs(t - 1.))) //"
SHAPE = "macro obstacle(x, y) (y) //\n"


def more(new: str, reason: str):
    """A mistake of which another one stands in the default tests."""
    return pytest.param(new, reason, marks=pytest.mark.slow)


@pytest.mark.parametrize("new, reason", [
    ("macro obstacleX(t) sqrt(0.5 - t) //", "obstacleX cannot be evaluated: a number that is none"),
    more("macro obstacleX(t) (x*t) //", "obstacleX varies along label 1"),
    more(SHAPE + "macro obstacleAngle(t) t //", "the scene must give obstaclePivot"),
    more("macro obstacleAngle(t) t //\nmacro obstaclePivot() [0., 0.] //", "shape is not known"),
    more(SHIFT + "\nmacro obstaclePivot() [0., 0.] //", "obstaclePivot is declared without"),
    more("macro gap() 0.1 //\nmacro gapInTime(t) t //", "gap and gapInTime are both declared"),
    ("macro gap() (0.1*x) //\n" + SHIFT, "slides along it, but its gap is not const"),
    more(SHAPE + "macro obstacleInTime(x, y, t) t //", "obstacle and obstacleInTime are both"),
    ("macro obstacle(x, y) (-1. - y) //\nmacro obstacleY(t) t //", "covers the contact boundary"),
    more("macro obstacleInTime(x, y, t) (y/(1. - t)) //", "cannot be evaluated"),
    more("macro obstacleY(t) (1e200*t*1e200) //", "obstacleY is no finite number at the time 0.5"),
    more("macro axisymmetric() 1 //\n" + SHIFT, "moves an obstacle of revolution off its axis")])
def test_misuse_is_refused_in_one_line(solved, scene, new, reason):
    run = solved(scene(PAD, (SHIFT, new)), cells=1, steps=4)
    assert run.status == 2 and reason in run.reason and "\n" not in run.reason


def test_motion_of_what_is_no_obstacle_is_refused(solved, scene):
    alone = PAD.replace("macro contact() 1 //\n", "").replace("macro friction() F //\n", "")
    run = solved(scene(alone), cells=1, steps=2)
    assert run.status == 2 and "obstacleX is declared without contact" in run.reason
    pair = alone.replace('subdomains("2x2");\nrectangle(0., 4., 0., 2.);', """
int[int] below = [5, 6, 7, 8];
addBody(square(4, 2, [4*x, 1 + y]))
addBody(square(3, 2, [4*x, y], label = below))
macro contactPair() 1, 7 //""")
    run = solved(scene(pair), steps=2)
    assert run.status == 2 and "there is none: bodies of a contactPair" in run.reason


# ---- scenes that ship ----------------------------------------------------------------------------

def test_an_indenter_comes_slides_and_goes(solved):
    """On its way it drags with F times its force, wherever it is; it leaves nothing."""
    run = solved("indenter", h=0.5, steps=9, rtol=1e-10, friction_rtol=1e-9)
    table = read_table(run.directory / "boundaries.csv")
    normal, drag = (np.array(table[f"{name}_resultant"]) for name in ("normal", "tangential"))
    np.testing.assert_allclose(drag[4:6], -0.3 * normal[4:6], rtol=1e-7)
    assert normal[2] > 0 and normal[-1] == drag[-1] == 0
    place = [np.average(run.contact["x"][k], weights=-run.contact["sigma_n"][k] + 1e-30)
             for k in (2, 5)]
    assert place[1] - place[0] == pytest.approx(4, abs=0.5)  # its way, to a cell


@pytest.mark.slow  # four runs
def test_a_roller_drags_as_it_creeps(solved):
    """More creep, more drag, up to F times its force, where all of the contact slides; braked or
    driven by as much, the difference of the drags has the sign of the creep."""
    ratio = []
    for creep in (-0.2, 0.0, 0.005, 0.2):
        run = solved("roller", h=0.5, creep=creep)
        table = read_table(run.directory / "boundaries.csv")
        here = int(np.argmin(np.abs(np.array(table["time"]) - 2)))
        ratio.append(-table["tangential_resultant"][here] / table["normal_resultant"][here])
    assert ratio == sorted(ratio)
    np.testing.assert_allclose([ratio[0], ratio[-1]], [-0.5, 0.5], rtol=1e-6)


@pytest.mark.parametrize("law", ["slipFactor", "displacementFactor"])
def test_laws_of_sliding_know_no_difference_between_body_and_obstacle(solved, named_scene, law):
    """A block dragged along a floor, or the floor drawn away under it: same forces and work."""
    text = """include "scene.idp"
units("mm", "MPa");
real h = meshSize(0.5);
int n = rint(1./h);
body = square(2*n, n, [2.*x + 0.3*y, y]);
quasistatic(2.);
real slipRange = 1.;
macro young() 1000. //
macro poisson() 0.3 //
macro contact() 1 //
macro obstacle(x, y) y //
macro friction() 0.4 //
macro LAW(s) (1. - 0.9*s) //
macro amplitude1(t) min(1., t) //
""".replace("LAW", law)
    ways = {"body": """macro displacement1() on(3, u2 = -0.05) //
macro displacement2() on(3, u1 = 0.6) //
macro amplitude2(t) max(0., t - 1.) //
""", "obstacle": """macro displacement1() on(3, u1 = 0., u2 = -0.05) //
macro obstacleX(t) (-0.6*max(0., t - 1.)) //
"""}
    one, other = (solved(named_scene(f"{law}-{name}", text + way + 'include "export.idp"\n'),
                         steps=6, rtol=1e-10, friction_rtol=1e-9) for name, way in ways.items())
    assert one.status == other.status == 0, (one.reason, other.reason)
    for name in ("sigma_n", "sigma_t", "slip"):
        scale = np.abs(one.contact[name]).max()
        np.testing.assert_allclose(one.contact[name], other.contact[name], atol=1e-6 * scale)
    least = np.abs(one.contact["sigma_t"][-1]).sum() / np.abs(one.contact["sigma_n"][-1]).sum()
    assert least < 0.25  # of a coefficient of 0.4 that has fallen


# a floor passes under the block without touching it (t < 1), is pressed on (t < 2), and drags it
PASSES = """include "scene.idp"
real way = physical("way", 0.), slipRange = 1.;
units("mm", "MPa");
rectangle(0., 4., 0., 2.);
subdomains("2x1");
quasistatic(3.);
macro stepTimes() [1., 2.] //
macro young() 1e3 //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 0., u2 = -0.03) //
macro amplitude1(t) max(0., min(1., t - 1.)) //
macro contact() 1 //
macro gap() 0.01 //
macro obstacleX(t) (way*min(1., t) + 0.05*max(0., t - 2.)) //
macro friction() 0.4 //
macro slipFactor(s) (0.5 + 0.5*exp(-(s)/0.05)) //
include "export.idp"
"""


def test_a_way_through_the_air_wears_no_friction_down(solved, named_scene):
    """Friction falls with the slip in contact: after a passage of ten times the law's range without
    touching nodes that stick have their first coefficient, and all that follows is the same.
    """
    passed, stood = (solved(named_scene("passes", PASSES), way=way, cells=4, steps=6, **TIGHT)
                     for way in (0.5, 0.0))
    c = passed.contact
    pressed = (c["status"] == "stick") & (c["time"] <= 2) & (c["sigma_n"] < 0)
    assert pressed.any() and (c["status"] == "slip").any()
    # some have slid by a hundredth of the range before, as the floor came up
    np.testing.assert_allclose(c["bound"][pressed], -0.4 * c["sigma_n"][pressed], rtol=0.02)
    largest = np.abs(c["sigma_n"]).max()
    for name in ("sigma_n", "sigma_t", "bound"):
        np.testing.assert_allclose(c[name], stood.contact[name], rtol=0, atol=1e-7 * largest)


BOX = """include "scene.idp"
quasistatic(1.);
real turn = physical("turn", 0.)*pi/180., c = cos(turn), s = sin(turn);
int[int] sides = [1, 1, 3, 1];
body = movemesh(square(3, 2, [1.5*x, y], label = sides), [c*x - s*y, s*x + c*y]);
macro young() 100. //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 0.01*s, u2 = -0.01*c) //
macro amplitude1(t) t //
macro contact() 1 //
macro obstacle(x, y) (c*(y) - s*(x)) //
macro obstacleX(t) (0.01*c*t) //
macro obstacleY(t) (0.01*s*t) //
macro tresca() 0.1 //
include "export.idp"
"""


def test_sides_along_which_an_obstacle_moves_keep_their_normals_wherever_they_are_turned_to(
        solved, scene):
    """They stand at a right angle to it, but for rounding, and end on it, but for rounding."""
    path = scene(BOX)
    found = [[run.summary["quantities"][name] for name in ("normal_resultant",
                                                           "tangential_resultant")]
             for run in (solved(path, turn=turn, steps=2) for turn in (0, 13, 37, 45))]
    np.testing.assert_allclose(found, [found[0]] * 4, rtol=1e-6)
