"""Contact that follows the motion: statics and kinematics on obstacles and pairs, cuts, misuse."""

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact import curve, mortar
from driver.contact.side import Side
from driver.errors import InputError
from driver.feti.operator import DualOperator
from driver.feti.torn_factor import TornFactor
from driver.files import read_rows, read_table
from driver.march.problem import assemble
from driver.march.saving import restore, snapshot
from driver.options import Settings
from driver.scene.freefem import find_scene
from driver.scene.manifest import read_manifest
from driver.studies.study import make_study
from driver.validity import starts_inside
from drawn_block import DRAWN

TIGHT = {"rtol": 1e-13, "friction_rtol": 1e-11, "primal_rtol": 1e-9}

# A block that lies on a slope, pressed down and dragged up along it by three of its lengths.
INCLINE = """include "scene.idp"
real F = physical("friction", 0.3), way = physical("way", 12.), lean = 0.2;
real h = meshSize(0.8);
mesh flat = square(rint(4./h), rint(2./h), [4*x, 2*y]);
addBody(movemesh(flat, [x*cos(lean) - y*sin(lean), x*sin(lean) + y*cos(lean)]));
quasistatic(2.);
macro young() 1e3 //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 1.) //
macro amplitude1(t) (way*max(0., t - 1.)) //
macro load2() traction(3, 0., -2.) //
macro amplitude2(t) min(1., t) //
macro contact() 1 //
macro largeSliding() (way + 3.) //
OBSTACLE
macro friction() F //
include "export.idp"
"""
SLOPE = "macro obstacle(x, y) ((y)*cos(lean) - (x)*sin(lean)) //"

# An elastic punch pressed on an elastic block and dragged over three of its widths.
PUNCH = """include "scene.idp"
real F = physical("friction", 0.3);
real h = meshSize(1.);
mesh block = square(rint(24./h), rint(4./h), [24.*x, 4.*y - 4.]);
int[int] own = [11, 12, 13, 14];
mesh punch = square(rint(5./h), rint(2./h), [4. + 4.*x, 2.*y], label = own);
addBody(block)
addBody(punch)
quasistatic(4.);
macro young() 2000. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro displacement1() on(13, u1 = 0., u2 = -0.02) //
macro amplitude1(t) min(1., t) //
macro displacement2() on(13, u1 = 4., u2 = 0.) //
macro amplitude2(t) max(0., t - 1.) //
macro load1() traction(3, 0., -1.) + traction(12, -2., 0.) //
macro contactPair() 11, 3 //
macro largeSliding() 16. //
macro friction() F //
include "export.idp"
"""

# A round indenter that comes down on a block, slides along it and turns; or the block does.
PATH = """include "scene.idp"
real F = physical("friction", 0.3);
real h = meshSize(1.);
body = square(rint(16./h), 4, [16*x, -4*(1 - y)^2]);
quasistatic(2.);
macro pathX(t) (6.*max(0., t - 1.)) //
macro pathY(t) (-0.1*min(1., t)) //
macro young() 100. //
macro poisson() 0.3 //
macro contact() 3 //
macro largeSliding() 8. //
macro obstacle(x, y) (sqrt((x - 5.)^2 + (y - 6.)^2) - 6.) //
macro friction() F //
WHAT MOVES
include "export.idp"
"""
OBSTACLE = """macro support() on(1, u1 = 0., u2 = 0.) //
macro obstacleX(t) pathX(t) //
macro obstacleY(t) pathY(t) //
"""
BODY = """macro displacement1() on(1, u1 = -1., u2 = 0.) //
macro displacement2() on(1, u1 = 0., u2 = -1.) //
macro amplitude1(t) pathX(t) //
macro amplitude2(t) pathY(t) //
"""


def boundaries(run) -> dict:
    """Columns of boundaries.csv as arrays."""
    table = read_table(run.directory / "boundaries.csv")
    return {name: np.array(values) for name, values in table.items()}


# ---- statics -------------------------------------------------------------------------------------

@pytest.mark.slow
@pytest.mark.parametrize("obstacle, options", [
    (SLOPE, {}), pytest.param("", {"subdomains": 5, "element": "P2"}, marks=pytest.mark.slow),
    pytest.param(SLOPE, {"subdomains": 3, "element": "P2-mixed"}, marks=pytest.mark.slow)])
def test_a_block_climbs_a_slope(solved, scene, obstacle, options):
    """N = P/(cos a - F sin a) and T = F N wherever it is, and its height grows by way tan a.

    Of the plane as a curve and of the plane of the label alike; 1e-7: curves are followed to 1e-9
    of the region, whose size is twenty deformations of the block and more.
    """
    run = solved(scene(INCLINE, ("OBSTACLE", obstacle)), steps=8, **TIGHT, **options)
    table, lean, sliding = boundaries(run), 0.2, slice(4, 8)
    normal = table["normal_resultant"][sliding]
    np.testing.assert_allclose(normal, 8 * np.cos(lean) ** -1 * np.cos(lean) / (
        np.cos(lean) - 0.3 * np.sin(lean)), rtol=1e-7)
    np.testing.assert_allclose(np.abs(table["tangential_resultant"][sliding]), 0.3 * normal,
                               rtol=1e-7)
    # together they carry the weight, and nothing else acts upwards
    np.testing.assert_allclose(table["force_y"][sliding], 8, rtol=1e-7)
    np.testing.assert_allclose(np.hypot(table["force_x"], table["force_y"])[sliding],
                               np.hypot(1, 0.3) * normal, rtol=1e-7)
    assert min(run.summary["seconds"].values()) > 0
    c = run.contact
    moved = (c["u_n"][..., None] * np.stack([c["normal_x"], c["normal_y"]], axis=-1)
             + c["u_t"][..., None] * np.stack([-c["normal_y"], c["normal_x"]], axis=-1))
    climbed = np.diff(moved[sliding], axis=0)
    np.testing.assert_allclose(climbed, np.broadcast_to([3.0, 3 * np.tan(lean)], climbed.shape),
                               rtol=1e-7)
    sigma = c["sigma_n"][sliding]
    np.testing.assert_allclose(sigma, np.broadcast_to(sigma[-1], sigma.shape),
                               atol=1e-6 * np.abs(sigma).max())


@pytest.mark.slow
def test_the_first_steps_under_a_moving_obstacle(solved, scene):
    """Contact that follows has distances of one time, obstacles have places of all."""
    moved, back = (solved(scene(PATH, ("WHAT MOVES", what)), steps=4, **TIGHT)
                   for what in (OBSTACLE, BODY))
    assert moved.status == back.status == 0, moved.reason
    for name in ("normal_resultant", "dissipated_energy"):
        assert moved.summary["quantities"][name] == pytest.approx(
            back.summary["quantities"][name], rel=1e-6)


@pytest.mark.slow
def test_a_punch_is_dragged_over_three_of_its_widths(solved, scene):
    """T = F N node by node, forces on one another, and what the block's mesh makes of a place.

    The block's elements repeat with their length of 1, by which the punch moves in two steps: half
    way along the block, far from its ends, forces repeat to what these ends do, a percent.
    """
    run = solved(scene(PUNCH), steps=16, **TIGHT)
    c, table = run.contact, boundaries(run)
    sliding = slice(5, 16)
    np.testing.assert_allclose(np.abs(c["sigma_t"][sliding]), -0.3 * c["sigma_n"][sliding],
                               atol=1e-8 * np.abs(c["sigma_n"]).max())
    assert (c["sigma_n"][sliding] < 0).all()
    np.testing.assert_allclose(c["u_n"], c["gap"], atol=1e-8)  # all of it touches
    normal = table["normal_resultant"][sliding]
    np.testing.assert_allclose(np.abs(table["tangential_resultant"][sliding]), 0.3 * normal,
                               rtol=1e-8)
    np.testing.assert_allclose(normal, normal.mean(), rtol=0.02)
    assert table["slip"][-1] == pytest.approx(12.0, rel=1e-2)
    summary = run.summary
    assert summary["residuals"]["geometry"] <= 1e-9
    assert summary["counts"]["geometries"] == run.history["geometries"].sum() <= 8 * 16
    assert summary["validity"]["largest_normal_error"] < 1e-8
    assert summary["validity"]["verdict"] == "ok"


@pytest.mark.parametrize("options", [{}, pytest.param({"element": "P2", "subdomains": 5},
                                                      marks=pytest.mark.slow)])
def test_on_a_plane_nothing_changes(solved, scene, options):
    """To and fro, sticking and slipping: as without the effect, rounding of coordinates apart."""
    path = scene(INCLINE, ("OBSTACLE", ""), ("(way*max(0., t - 1.))", "(0.02*sin(6*t))"))
    one, other = (solved(path, steps=8, **TIGHT, **options, **more)
                  for more in ({}, {"without": "large_sliding"}))
    assert {"stick", "slip"} <= set(one.contact["status"].ravel())
    for name in ("sigma_n", "sigma_t", "u_n", "u_t", "slip", "gap"):
        size = np.abs(other.contact[name]).max()
        np.testing.assert_allclose(one.contact[name], other.contact[name], atol=1e-9 * (size or 1))
    assert one.summary["counts"]["geometries"] == 8


@pytest.mark.slow  # four runs, two of them on ranks
@pytest.mark.parametrize("options", [{}, {"element": "P2"}])
def test_cuts_and_ranks_change_nothing(solved, scene, options):
    """Where the punch crosses from one subdomain to the next as elsewhere: 1e-6 of the forces."""
    one, many, ranks = (solved(scene(PUNCH), steps=8, subdomains=n, np=p, **TIGHT, **options)
                        for n, p in ((2, 1), (9, 1), (9, 3)))
    for name in ("sigma_n", "sigma_t", "normal_x", "u_t"):
        np.testing.assert_allclose(many.contact[name], one.contact[name],
                                   atol=1e-6 * np.abs(one.contact[name]).max())
    for name, values in many.contact.items():
        np.testing.assert_array_equal(values, ranks.contact[name])


@pytest.mark.slow  # two runs
@pytest.mark.parametrize("options", [{}, {"element": "P2", "subdomains": 3}])
def test_moving_the_obstacle_far_is_moving_the_body_back(solved, scene, options):
    """By six of its lengths, with another place of the obstacle at every step; to 1e-6: to that
    the curve of an obstacle six deformations away is known."""
    moving, body = (solved(scene(PATH, ("WHAT MOVES", what), ("pathX(t) (6", f"pathX(t) ({way}6"),
                                 name=name), steps=8, **TIGHT, **options)
                    for what, way, name in ((OBSTACLE, "", "obstacle"), (BODY, "", "body")))
    assert {"slip", "open"} <= set(body.contact["status"].ravel())
    for name in ("sigma_n", "sigma_t", "slip", "normal_x"):
        size = np.abs(body.contact[name]).max()
        np.testing.assert_allclose(moving.contact[name], body.contact[name], atol=1e-6 * size)
    over = [run.contact["u_n"] - run.contact["gap"] for run in (moving, body)]
    np.testing.assert_allclose(*over, atol=1e-6)
    # nodes that touch are on the circle
    c, t = moving.contact, moving.contact["time"]
    u = [c["u_n"] * c["normal_x"] - c["u_t"] * c["normal_y"],
         c["u_n"] * c["normal_y"] + c["u_t"] * c["normal_x"]]
    x, y = c["x"] + u[0] - 5 - 6 * np.maximum(0, t - 1), c["y"] + u[1] - 6 + 0.1 * np.minimum(1, t)
    closed = c["status"] != "open"
    np.testing.assert_allclose(np.hypot(x, y)[closed], 6.0, atol=1e-7)


@pytest.mark.slow  # quadratic elements in a hundred geometries
def test_a_latch_goes_in_and_comes_out_as_beams_bend(solved):
    """Forces of insertion and retention, where the nose climbs a flank, against beam theory.

    With the lever of the force along the beam, see latch.edp; 1 %: of it 0.4 % are the shear of a
    beam sixteen times as long as thick, and 0.3 % the mesh. The issue asks for 5 %.
    """
    run = solved("latch", steps=40, element="P2")
    E, d, F = 2600 / (1 - 0.38**2), 1.5, 0.2
    c, forces, checked = run.contact, run.history, {-1: 0, 1: 0}
    for k in range(40):
        here = c["status"][k] != "open"
        f = c["sigma_n"][k][here] * c["weight"][k][here]
        push = forces["contact_x"][k]
        if not len(f):
            continue
        n, x, y, u = (np.average(v, weights=f, axis=0) for v in (
            np.column_stack([c["normal_x"][k], c["normal_y"][k]])[here], c["x"][k][here],
            c["y"][k][here], (c["u_n"] * c["normal_y"] + c["u_t"] * c["normal_x"])[k][here]))
        way = np.sign(push)  # -1 in, 1 out
        slope = np.arctan2(-way * n[0], n[1])
        if (k < 20) != (way < 0) or slope < np.radians(10):
            continue
        ratio = (F + np.tan(slope)) / (1 - F * np.tan(slope))
        bending = x**3 / 3 + way * (y - d / 2) * ratio * x**2 / 2
        across = -u * E * d**3 / 12 / bending
        assert -forces["contact_y"][k] == pytest.approx(across, rel=0.01)
        assert abs(push) == pytest.approx(ratio * across, rel=0.01)
        checked[int(way)] += 1
    assert min(checked.values()) >= 3
    assert run.contact["status"][19:21].tolist() == [["open"] * c["x"].shape[1]] * 2


# ---- what is renewed, and what goes on -----------------------------------------------------------

def test_only_contact_rows_are_renewed(exported, scene, monkeypatch):
    """No subdomain and no coarse problem is factorized again; a resumed run has the same bits.

    A side of the punch is bent: at its end a support moves one component of a node in contact.
    """

    count, reduced = [], TornFactor.reduced
    monkeypatch.setattr(TornFactor, "reduced",
                        lambda self, corner: count.append(1) or reduced(self, corner))
    guided = ("u1 = 4., u2 = 0.) //", "u1 = 4., u2 = 0.) + on(14, u1 = 4.01 - y/200.) //")
    place = exported(scene(PUNCH, guided), subdomains=4, steps=8)
    problem = assemble(place, MPI.COMM_WORLD)
    made, coarse = len(count), problem.operator.coarse
    solver, steps, kept = problem.solver(Settings()), [], None
    for step in solver.steps():
        steps.append(step)
        if step.index == 5:
            kept = snapshot(solver)
    assert len(count) == made and problem.operator.coarse is coarse
    assert solver.history.counts["geometries"] > 8
    # what is renewed is what an operator with these rows would have
    operator, fresh = problem.operator, DualOperator(problem.structure, MPI.COMM_WORLD)
    x = np.random.default_rng(1).standard_normal(operator.owned)
    weights = np.array([1.0, 2.0, 0.5])[: problem.structure.patterns]
    for one, other in ((operator.apply(x), fresh.apply(x)),
                       (operator.elastic_response(weights), fresh.elastic_response(weights)),
                       (operator.rigid_response(weights), fresh.rigid_response(weights))):
        assert np.abs(other).max() > 0
        np.testing.assert_allclose(one, other, atol=1e-12 * np.abs(other).max())
    again = assemble(place, MPI.COMM_WORLD).solver(Settings())
    restore(again, kept)
    for step, other in zip(steps[5:], again.steps(), strict=True):
        np.testing.assert_array_equal(step.multipliers, other.multipliers)
        np.testing.assert_array_equal(step.about, other.about)
    assert again.history.counts == solver.history.counts


@pytest.mark.slow  # three runs
def test_what_a_node_has_slid_stays_with_it(solved, scene):
    """Friction that falls with the slip so far, and wear, of a block that runs up the slope."""
    law = "macro friction() F //\nmacro slipFactor(s) (1. - 0.05*(s)) //\nreal slipRange = 20.;"
    run = solved(scene(INCLINE, ("OBSTACLE", SLOPE), ("macro friction() F //", law)), steps=8,
                 **TIGHT)
    table, c = boundaries(run), run.contact
    # of a step in which a node touches or opens half counts
    pressed = np.vstack([c["gap"][:1] <= 1e-9, c["sigma_n"] < 0])
    slid = np.cumsum(np.abs(c["slip"]) * (pressed[1:] * 0.5 + pressed[:-1] * 0.5), axis=0)
    np.testing.assert_allclose(c["bound"], -0.3 * (1 - 0.05 * slid) * c["sigma_n"], rtol=1e-6,
                               atol=1e-9)
    assert table["slip"][-1] == pytest.approx(12 / np.cos(0.2), rel=1e-2)
    worn = solved(scene(INCLINE, ("OBSTACLE", SLOPE), ("macro friction() F //", """
macro friction() F //
macro wear() 1e-4 //"""), name="worn"), steps=8)
    c = worn.contact
    depth = np.cumsum(-1e-4 * np.abs(c["slip"]) * c["sigma_n"], axis=0)
    closed = c["sigma_n"] < 0
    np.testing.assert_allclose((c["u_n"] - c["gap"])[closed], depth[closed],
                               atol=1e-4 * depth.max())


# ---- parts ---------------------------------------------------------------------------------------

def test_of_several_places_that_are_faced_the_nearest_counts():
    """A side below two others, the farther one longer, is coupled to either where it is nearer."""
    first = Side(np.array([[0.0, 0], [4, 0]]), np.array([[1, 0]]), np.array([[0.0, 1]]))
    second = Side(np.array([[1.0, 0.5], [2, 0.5], [-1, 2], [6, 2.0]]),
                         np.array([[0, 1], [2, 3]]), np.array([[0.0, -1], [0, -1]]))
    held = np.zeros(2, bool)
    coupled = mortar.couple(first, second, held, reach=3.0)
    near = np.isin(coupled.of, [0, 1]) & (coupled.side == 1)
    assert coupled.weight.sum() == pytest.approx(4.0)
    # of the total weight a quarter is the nearer side's
    whole = coupled.value * coupled.weight[coupled.node]
    assert whole[near].sum() == pytest.approx(-1.0)
    assert (coupled.weight * coupled.gap).sum() == pytest.approx(0.5 + 3 * 2.0)
    assert not mortar.couple(first, second, held, reach=0.1).weight.any()


def test_what_faces_nothing_between_two_others_is_not_coupled():
    """One place is faced twice, another, beyond a part that faces nothing, once."""
    first = Side(np.array([[0.0, 0], [4, 0]]), np.array([[1, 0]]), np.array([[0.0, 1]]))
    ends = np.array([[1.0, 0.5], [2, 0.5], [0.5, 2], [2.5, 2], [3, 0.5], [4, 0.5]])
    second = Side(ends, np.array([[0, 1], [2, 3], [4, 5]]), np.tile([0.0, -1.0], (3, 1)))
    coupled = mortar.couple(first, second, np.zeros(2, bool), reach=3.0)
    assert coupled.weight.sum() == pytest.approx(2.0 + 1.0)
    assert (coupled.weight * coupled.gap).sum() == pytest.approx(0.5 + 2 * 0.5 * 2.0 + 0.5)


def test_a_curve_of_segments_is_smooth_between_them():
    """Twelve cubics over chords c of a circle of radius 1 miss it by its fourth derivative over its
    chord, 3, times c^4/384, and distances from it by as little."""
    angle = np.linspace(0, 2 * np.pi, 13)
    point = np.column_stack([np.cos(angle), np.sin(angle)])
    circle = curve.through(np.column_stack([point[:-1], point[1:], point[:-1], point[1:]]))
    at = np.linspace(0.01, 6.27, 101)
    place = 1.001 * np.column_stack([np.cos(at), np.sin(at)])
    distance, normal = circle.distance(place)
    miss = 3 * (2 * np.sin(np.pi / 12)) ** 4 / 384
    np.testing.assert_allclose(distance, 0.001, atol=1.3 * miss)  # slopes add to it
    assert np.abs(distance - 0.001).max() > 0.5 * miss
    np.testing.assert_allclose(normal, place / 1.001, atol=0.01)
    # on both sides of a joint alike, also off the curve: there chords alone differ by a hundredth
    beside = np.pi / 6 + np.array([-1e-9, 1e-9])
    _, (one, other) = circle.distance(0.9 * np.column_stack([np.cos(beside), np.sin(beside)]))
    np.testing.assert_allclose(one, other, atol=1e-6)


@pytest.mark.slow  # a fine grid
def test_a_curve_goes_over_ridges_that_end_between_lines_of_its_grid(exported, scene):
    """A ridge of 0.2 by 1 on a grid of 0.14: all pieces are on it, with its tip and its feet.

    A chord across its end is shorter than the ridge goes on, whose flanks are both near to it.
    """
    ridge = "macro obstacle(x, y) ((y) + 2. - max(0., 1. - 10.*abs((x) - 1.013))) //"
    place = exported(scene(INCLINE, ("OBSTACLE", ridge)))
    pieces = np.array(read_manifest(place).rooms["large_sliding"]["curve"])
    ends = np.vstack([pieces[:, :2], pieces[:, 2:4]])
    height = -2 + np.maximum(0, 1 - 10 * np.abs(ends[:, 0] - 1.013))
    np.testing.assert_allclose(ends[:, 1], height, atol=1e-12)
    for corner in ([1.013, -1.0], [0.913, -2.0], [1.113, -2.0]):
        assert np.linalg.norm(ends - corner, axis=1).min() < 2e-4


@pytest.mark.slow  # a long curve; ridges are found like bumps
def test_a_curve_has_bumps_between_the_lines_of_a_coarse_grid(exported, scene):
    """Bumps of 0.6 by 0.01 every 31.2 on a grid of 1.7, which sides of 0.2 find with three nodes.

    Wherever the grid lies, most of them are off its lines and off the middles between these.
    """
    bumps = ("func real bump(real s) { real r = s - 31.2*rint(s/31.2);\n"
             "  return (abs(r) < 0.3 ? (1. + cos(pi*r/0.3))/2 : 0.); }\n"
             "macro obstacle(x, y) ((y) + 2. - 0.01*bump((x))) //")
    pieces = np.array(read_manifest(exported(
        scene(INCLINE, ("OBSTACLE", bumps)), way=200, h=0.2)).rooms["large_sliding"]["curve"])
    ends = np.vstack([pieces[:, :2], pieces[:, 2:4]])
    away = ends[:, 0] - 31.2 * np.round(ends[:, 0] / 31.2)
    height = np.where(np.abs(away) < 0.3, 0.005 * (1 + np.cos(np.pi * away / 0.3)), 0)
    np.testing.assert_allclose(ends[:, 1], height - 2, atol=1e-12)
    met = np.unique(np.round(ends[height > 0.009, 0] / 31.2))
    np.testing.assert_array_equal(met, np.arange(-6, 7))


@pytest.mark.slow  # further grids
def test_the_reach_is_around_a_rectangle_that_is_turned(exported, scene):
    """Turned by 150 degrees the bottom of a rectangle lies along its obstacle from end to end."""
    turned = """include "scene.idp"
rectangle(1., 3., 1., 2.);
rotate(150.);
macro young() 1. //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 1 //
macro largeSliding() 0.1 //
macro obstacle(x, y) ((y)*cos(5*pi/6) - (x)*sin(5*pi/6) - 0.99) //
include "export.idp"
"""
    pieces = np.array(read_manifest(exported(scene(turned))).rooms["large_sliding"]["curve"])
    ends = np.vstack([pieces[:, :2], pieces[:, 2:4]])
    along = ends @ [np.cos(5 * np.pi / 6), np.sin(5 * np.pi / 6)]
    assert along.min() < 1 and along.max() > 3


def test_places_on_a_curve_are_at_no_distance_from_it():
    """On its one segment the cubic with its slopes, beyond either end a parabola that goes on with
    slope and mean curvature; normals are across the curve.
    """
    rise, fall, length = 0.3, -0.1, 2.5
    one = curve.Curve(np.array([[1.0, 2.0]]), np.array([[1.0, 2.0 + length]]),
                      np.array([[-1.0, 0.0]]), *np.array([[rise], [fall]]), np.ones(1, bool),
                      np.ones(1, bool))
    s = np.linspace(-0.4, 1.4, 181)
    off = np.where(s < 0, rise * s + (fall - rise) * s**2 / 2, np.where(
        s > 1, fall * (s - 1) + (fall - rise) * (s - 1) ** 2 / 2,
        rise * s * (1 - s) ** 2 - fall * s**2 * (1 - s)))
    place = np.column_stack([1.0 - length * off, 2.0 + length * s])
    distance, normal = one.distance(place)
    np.testing.assert_allclose(distance, 0.0, atol=1e-14)
    # the slope of what was written down, by differences
    slope = np.gradient(off, s, edge_order=2)
    np.testing.assert_allclose(np.arctan2(-normal[:, 1], -normal[:, 0]), np.arctan(slope),
                               atol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)


# ---- misuse --------------------------------------------------------------------------------------

@pytest.mark.parametrize("changes, said", [
    ([("way + 3.", "0*way")], "largeSliding expects the length of the longest way"),
    pytest.param([("macro friction() F", "macro bilateral() 1 //\nmacro friction() F")],
                 "free to lift off", marks=pytest.mark.slow),
    pytest.param([("macro friction() F", "macro initialX() 1 //\nmacro friction() F")],
                 "start from no displacement", marks=pytest.mark.slow),
    pytest.param([("OBSTACLE", "macro gap() 0.01*x //")], "is not straight or its gap not the same",
                 marks=pytest.mark.slow),
    pytest.param([("OBSTACLE", "macro obstacle(x, y) ((y) - 0.2*(x) + 1e-3*label) //")],
                 "depends on more than x and y", marks=pytest.mark.slow),
    pytest.param([("OBSTACLE", "macro obstacle(x, y) ((y) + 100.) //")],
                 "nowhere zero within the reach", marks=pytest.mark.slow),
    pytest.param([("OBSTACLE", "macro obstacle(x, y) (((y) - 0.2*(x) + 3.)*((x) + 5.)) //")],
                 "cross, touch one another or have a cusp there", marks=pytest.mark.slow)])
def test_misuse_gets_one_line(solved, scene, changes, said):
    whole = [*changes, *([] if changes[0][0] == "OBSTACLE" else [("OBSTACLE", "")])]
    run = solved(scene(INCLINE, *whole), steps=2)
    assert run.status == 2 and said in run.reason and "\n" not in run.reason


@pytest.mark.parametrize("start, status", [("-3. - height", 2), ("height - 0.01", 0)])
@pytest.mark.some(1)
def test_an_obstacle_turned_inside_out_is_asked_about(solved, scene, start, status):
    """Not so a press fit, whose nodes all start inside as well."""
    height = SLOPE.split(") ", 1)[1].removesuffix(" //")
    obstacle = f"macro obstacle(x, y) ({start.replace('height', height)}) //"
    run = solved(scene(INCLINE, ("OBSTACLE", obstacle)), steps=2)
    assert run.status == status and "\n" not in run.reason
    said = "inside the obstacle at the start, by up to 3 at "
    assert (said in run.reason and "is its sign right?" in run.reason) == (status == 2)


@pytest.mark.slow  # what a run refuses, which is tested above
def test_a_search_refuses_an_obstacle_turned_inside_out_as_well(solved, scene):
    height = SLOPE.split(") ", 1)[1].removesuffix(" //")
    obstacle = f"macro obstacle(x, y) (-3. - {height}) //"
    run = solved(scene(INCLINE, ("OBSTACLE", obstacle)), accuracy="5%")
    assert run.status == 2 and "is its sign right?" in run.reason


AWAY = """include "scene.idp"
body = square(4, 2, [4.*x, 2.*y]);
quasistatic(1.);
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 1 //
macro largeSliding() 4. //
macro obstacle(x, y) ((y) - 3.) //
macro obstacleY(t) (-3.*min(1., 20.*t)) //
include "export.idp"
"""


@pytest.mark.slow  # 640 steps
def test_an_obstacle_that_the_first_step_takes_away_is_no_start_inside(exported, named_scene):
    """Of 20 steps it does, of 640 not: a search samples histories so finely, but takes no such
    steps.
    """
    problem = assemble(exported(named_scene("away", AWAY), steps=640), MPI.COMM_SELF)
    starts_inside.check(problem, 0.05)
    with pytest.raises(InputError, match="is its sign right"):
        starts_inside.check(problem)


@pytest.mark.slow  # runs that are refused
def test_what_cannot_be_had_with_it_says_so(solved, scene, tmp_path):
    run = solved(scene(INCLINE, ("OBSTACLE", SLOPE), ("(way + 3.)", "5.")), steps=4)
    assert run.status == 4 and "farther than largeSliding says" in run.reason
    run = solved(scene(PUNCH), steps=2, linearization="updated")
    assert run.status == 2 and "follows the motion already" in run.reason


THROUGH = """include "scene.idp"
quasistatic(1.);
int[int] upper = [11, 12, 13, 14];
addBody(square(4, 2, [2.*x, y]))
addBody(square(3, 2, [0.3 + 1.4*x, 1. + y], label = upper))
macro young() 100. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro displacement1() on(13, u1 = 0., u2 = -0.01) //
macro amplitude1(t) t //
macro contactPair() 11, 3 //
macro largeSliding() REACH //
include "export.idp"
"""


@pytest.mark.parametrize("reach, steps, status", [("0.004", 2, 4), ("0.004", 4, 0), ("0.02", 2, 0)])
def test_a_step_that_takes_bodies_through_each_other_is_no_answer(solved, scene, reach, steps,
                                                                  status):
    """Where bodies come by more than the reach at once nothing faces anything any more."""
    run = solved(scene(THROUGH, ("REACH", reach)), steps=steps)
    assert run.status == status
    if status:
        assert "step 1: " in run.reason and "by 0.005, farther than largeSliding" in run.reason
    else:
        assert run.summary["quantities"]["normal_resultant"] > 0.5


def test_the_latch_ships():
    """Where the documents and the gallery have it from."""
    assert find_scene("latch").is_file()


@pytest.mark.slow  # studies and runs of their last values
@pytest.mark.parametrize("text, parameter, values", [
    (PUNCH, "friction", "0.1,0.3"),
    (PATH.replace("WHAT MOVES", OBSTACLE).replace("6.*max", "way*max").replace(
        "real h =", 'real way = physical("way", 6.);\nreal h ='), "way", "2.,6.")])
def test_values_of_a_study_are_those_of_runs(solved, scene, tmp_path, text, parameter, values):
    """One after the other on one factorization: each starts from where nothing has moved."""
    path, options = scene(text), {"steps": "6", "rtol": "1e-11", "friction_rtol": "1e-10"}
    _, folder = make_study({"scene": str(path), parameter: values, "figures": "no", "quiet": "yes",
                            "out": str(tmp_path / "study"), **options})
    last = values.split(",")[-1]
    single = solved(path, **{parameter: last}, **options)
    rows = [row for row in read_rows(folder / "contact.csv")
            if float(row[parameter]) == float(last)]
    for name in ("sigma_n", "sigma_t", "u_n", "slip"):
        wanted = single.contact[name][-1]
        np.testing.assert_allclose([float(row[name]) for row in rows], wanted,
                                   atol=1e-6 * np.abs(wanted).max(), err_msg=name)
    work = float(read_rows(folder / "study.csv")[-1]["dissipated"])
    assert work == pytest.approx(boundaries(single)["dissipated_energy"][-1], rel=1e-6)


@pytest.mark.slow  # quadratic elements on a fine mesh for a reference
@pytest.mark.parametrize("element, h", [("P1", 1), ("P1", 0.5), ("P2", 1)])
def test_smoothed_stresses_estimate_the_error(solved, element, h):
    """0.7 to 1.1 of the true error where the punch has gone over three widths, without friction.

    Then energies of displaced bodies differ by the square of the error in the energy norm. At the
    edges of the punch stresses are singular, and smoothed ones miss a part of the error.
    """
    fine, coarse = (solved("drag", h=size, element=kind, steps=8, friction=0, errors="energy")
                    for size, kind in ((0.125, "P2"), (h, element)))
    wanted, found = (run.summary["errors"]["energy"] for run in (fine, coarse))
    true = np.sqrt(found["norm"] ** 2 - wanted["norm"] ** 2)
    assert found["kind"] == "recovery" and 0.7 < found["total"] / true < 1.1


@pytest.mark.slow  # two runs
@pytest.mark.parametrize("options", [{}, {"element": "P2", "subdomains": 5}])
def test_who_moves_makes_no_difference(solved, scene, options):
    """The punch dragged over the block that is held, and the block drawn away under it."""
    drawn = [("macro support() on(1, u1 = 0., u2 = 0.)",
              "macro displacement2() on(1, u1 = -4., u2 = 0.)"),
             ("macro displacement2() on(13, u1 = 4., u2 = 0.) //\n", "")]
    one, other = (solved(scene(PUNCH, *changes, name=name), steps=8, **TIGHT, **options)
                  for changes, name in (([], "punch"), (drawn, "block")))
    for name in ("sigma_n", "sigma_t", "slip", "normal_x"):
        np.testing.assert_allclose(one.contact[name], other.contact[name],
                                   atol=1e-6 * np.abs(one.contact[name]).max())


# a rough block drawn along a longer one, whose sides its own ends are in
ROUGH = """include "scene.idp"
int[int] own = [11, 12, 13, 14];
addBody(square(23, 4, [4.*x, y - 1.])) bodyMaterial("long", 1000., 0.3);
addBody(square(11, 4, [0.5 + 3.*x, y], label = own)) bodyMaterial("short", 2000., 0.25);
quasistatic(2.);
macro support() on(1, u1 = 0., u2 = 0.) //
macro displacement1() on(13, u1 = 0., u2 = -1e-3) //
macro displacement2() on(13, u1 = 0.3, u2 = 0.) //
macro amplitude1(t) min(1., t) //
macro amplitude2(t) max(0., t - 1.) //
macro contactPair() 11, 3 //
macro friction() 0.3 //
macro normalCompliance() 500. //
LAW
macro largeSliding() 2. //
include "export.idp"
"""


@pytest.mark.parametrize("element, law", [
    ("P2", ""), *(pytest.param("P1", law, marks=pytest.mark.slow)
                  for law in ("", "macro normalComplianceExponent() 1.5 //"))])
def test_rough_bodies_yield_where_they_face(solved, scene, element, law):
    """The same forces whichever body has the nodes, of which some face the other one in part.

    They had yielded by their whole weights: forces were off by 3 to 5 %.
    """
    one, other = (solved(scene(ROUGH, ("LAW", law), ("Pair() 11, 3", f"Pair() {pair}"),
                               name=name), element=element, steps=4, subdomains=3)
                  for pair, name in (("11, 3", "short"), ("3, 11", "long")))
    for name in ("resultant_n", "resultant_t"):
        np.testing.assert_allclose(np.abs(one.history[name]), np.abs(other.history[name]),
                                   rtol=1e-3, atol=1e-3 * np.abs(one.history[name]).max())


# two blocks side by side under a third one that is pressed on both
SEAM = """include "scene.idp"
int[int] one = [11, 12, 13, 14], two = [21, 22, 13, 24], top = [41, 42, 43, 44];
func real rise(real s) { return 1. - 0.05*cos(pi*s); }
addBody(square(8, 3, [2.5*x - 2., y*rise(2.5*x - 2.)], label = one))
real crack = physical("crack", 0.);
addBody(square(5, 3, [0.5 + crack + 1.5*x, y*rise(0.5 + crack + 1.5*x)], label = two))
addBody(square(7, 3, [2.5*x - 1.2, rise(2.5*x - 1.2) + y*(1.8 - rise(2.5*x - 1.2))], label = top))
quasistatic(1.);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(11, 21, u1 = 0., u2 = 0.) //
macro load1() pressure(43, 1.) //
macro amplitude1(t) t //
macro contactPair() 41, 13 //
macro friction() 0.5 //
macro largeSliding() 3. //
include "export.idp"
"""


# 0.0144 is 4 % of an edge
@pytest.mark.parametrize("crack", [0.0, 0.0144, pytest.param(0.036, marks=pytest.mark.slow)])
def test_a_seam_that_opens_and_closes_under_a_side(solved, scene, crack):
    """The crack between two bodies under one edge, which contact opens and lifting off closes.

    The edge had other multipliers as soon as it was not covered to the last digit: conditions
    jumped, and no geometry was that of its solution.
    """
    run = solved(scene(SEAM), element="P2", steps=3, subdomains=3, crack=crack)
    assert run.status == 0, run.reason
    assert run.history["geometries"][-1] < 10
    forces = read_table(run.directory / "boundaries.csv")
    assert float(forces["force_y"][-1]) == pytest.approx(2.5, rel=1e-4)
    lengths = forces["contact_length"].astype(float)
    assert run.history["contact_length"].tolist() == lengths.tolist()


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.some(1)
def test_a_node_held_along_the_boundary_hands_on_its_weight(solved, tmp_path, element):
    """As it does where contact stays: pressures are forces over weights. 48 % more with linear
    elements, and a length of 19.1, where it did not.
    """
    runs = []
    for name, more in (("stays", ""), ("follows", "macro largeSliding() 3. //\n")):
        path = tmp_path / f"{name}.edp"
        path.write_text(DRAWN.replace('include "export.idp"', f'{more}include "export.idp"'))
        runs.append(solved(path, steps=4, subdomains=3, way=-0.4, element=element).history)
    stays, follows = ({of: float(run[of][-1]) for of in (
        "peak_pressure", "contact_length", "resultant_n")} for run in runs)
    assert follows["contact_length"] == pytest.approx(20.0, rel=1e-6)
    assert follows["peak_pressure"] == pytest.approx(stays["peak_pressure"], rel=0.02)
    assert follows["resultant_n"] == pytest.approx(stays["resultant_n"], rel=1e-3)


# half of a clip, pushed over a hollow shaft by its back
CLIP = """include "scene.idp"
real F = physical("friction", 0.15);
units("mm", "MPa");
real h = meshSize(0.5), g = 50*pi/180, start = g - pi/2, inner = 4.6, outer = 6.1, tip = 0.75;
border lip(s=0, pi) {
  x = (inner + tip)*sin(g) - tip*(cos(s)*sin(g) + sin(s)*cos(g));
  y = -(inner + tip)*cos(g) + tip*(cos(s)*cos(g) - sin(s)*sin(g)); label = 77; }
border out(s=start, pi/2 - 0.2) { x = outer*cos(s); y = outer*sin(s); label = 40; }
border grip(s=pi/2 - 0.2, pi/2) { x = outer*cos(s); y = outer*sin(s); label = 3; }
border middle(s=outer, inner) { x = 0; y = s; label = 4; }
border in(s=pi/2, start) { x = inner*cos(s); y = inner*sin(s); label = 40; }
addBody(buildmesh(lip(5/h) + out(12/h) + grip(1.5/h) + middle(1.5/h) + in(10/h)))
bodyMaterial("clip", 2400., 0.38);
border a(s=0, 2*pi) { x = 5*cos(s); y = -10.2 + 5*sin(s); label = 500; }
border b(s=0, 2*pi) { x = 3*cos(s); y = -10.2 + 3*sin(s); label = 501; }
addBody(buildmesh(a(10*pi/h) + b(-6*pi/h)))
bodyMaterial("shaft", 210e3, 0.3);
quasistatic(1.);
macro support() on(501, u1 = 0., u2 = 0.) + on(4, u1 = 0.) //
macro displacement1() on(3, u1 = 0., u2 = -9.7) //
macro amplitude1(t) t //
macro contactPair() 77, 500 //
macro largeSliding() 12. //
macro friction() F //
include "export.idp"
"""


@pytest.mark.slow  # a way of many steps
def test_a_clip_snaps_over_a_shaft(solved, named_scene):
    """Pushed until its lips are past the shaft's widest place, drawn on after it. The backs of the
    lips see the far side of the shaft through the lips; contact passes from node to node.
    """
    run = solved(named_scene("clip", CLIP), steps=42)
    assert run.status == 0, run.reason
    table = read_table(run.directory / "boundaries.csv")
    push = np.array(table["force_y"])
    past = int(np.argmax(push))
    assert push[past] > 1 and push[-1] < -0.1 and 15 < past < 30
    assert np.abs(run.contact["sigma_n"]).max() < 100
