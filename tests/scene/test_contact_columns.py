"""Numbers that an export has of its contact nodes, against functions evaluated at their places."""

import numpy as np
import pytest

from driver.errors import InputError

# a quadrilateral whose lower side, two labels, is uneven; its obstacle is a round one
SCENE = """include "scene.idp"
units("m", "Pa");
subdomains("1");
int[int] sides = [5, 2, 3, 4];
body = square(6, 2, [x + 0.3*x^2, y + 0.2*x*(1 - y)], label = sides);
body = change(body, flabel = (label == 5 && x > 0.55 ? 8 : label));
quasistatic(2.);
macro young() 1. //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 5, 8 //
macro friction() (0.1 + x*y) //
MORE
include "export.idp"
"""
MOTION = """real turn = 0.2;
macro obstacle(x, y) (sqrt((x - 0.6)^2 + (y + 4.)^2) - 3.5) //
macro obstacleX(t) (label == 5 ? 0.05*sin(3*t) : 0.02*abs(t - 1.8125)) //
macro obstacleY(t) (-0.1*t) //
macro obstacleAngle(t) (turn*t^2) //
macro obstaclePivot() [0.6, -3.5] //
"""


@pytest.fixture(scope="module")
def contact(built, named_scene):
    """contact(name, more, **options): the contact boundary of the scene with `more`."""
    def get(name: str, more: str, **options):
        text = SCENE.replace("MORE", more)
        return built(named_scene(name, text), reduce=False, steps=4, **options).structure.contact
    return get


def own(b):
    """Nodes of one label alone, for which means are values at the node."""
    ends = np.isclose(b.xy[:, 0], b.xy[:, 0].min()) | np.isclose(b.xy[:, 0], b.xy[:, 0].max())
    middle = np.abs(b.xy[:, 0] - 0.55) < 0.15  # where the labels meet
    return ~ends & ~middle


def test_columns_are_values_at_the_nodes(contact):
    """Weights the halves of both edges, with linear elements; normals those of the edges."""
    b = contact("plain", "macro gap() (0.01 + x^2) //\nmacro cohesion() (3. + x) //")
    x, y = b.xy.T
    np.testing.assert_allclose(b.columns["friction"], 0.1 + x * y, rtol=1e-12)
    np.testing.assert_allclose(b.gap, 0.01 + x**2, rtol=1e-12)
    np.testing.assert_allclose(b.columns["cohesion"], 3 + x, rtol=1e-12)
    size = np.linalg.norm(np.diff(b.xy, axis=0), axis=1)
    np.testing.assert_allclose(b.weight, (np.r_[size, 0] + np.r_[0, size]) / 2, rtol=1e-12)
    chord = np.diff(b.xy, axis=0)
    force = np.column_stack([chord[:, 1], -chord[:, 0]]) / 2
    total = np.vstack([force, [[0, 0]]]) + np.vstack([[[0, 0]], force])
    np.testing.assert_allclose(b.normal, total / np.linalg.norm(total, axis=1)[:, None],
                               atol=1e-12)
    assert (b.label[x < 0.5] == 5).all() and (b.label[x > 0.7] == 8).all()


def test_where_a_moving_obstacle_stands_at_every_time(contact):
    """Its function where its motion has taken it, slopes by the same, shifts and turns by label."""
    b = contact("moving", MOTION)
    here = own(b)
    x, y = b.xy[here].T
    step = 1e-5
    for k, t in enumerate(np.linspace(0, 2, 5)):
        shift = np.where(b.label[here] == 5, 0.05 * np.sin(3 * t), 0.02 * abs(t - 1.8125)), -0.1 * t
        angle = 0.2 * t**2
        cos, sin = np.cos(angle), np.sin(angle)

        def phi(x, y, shift=shift, cos=cos, sin=sin):
            away = x - 0.6 - shift[0], y + 3.5 - shift[1]
            back = 0.6 + cos * away[0] + sin * away[1], -3.5 - sin * away[0] + cos * away[1]
            return np.sqrt((back[0] - 0.6) ** 2 + (back[1] + 4) ** 2) - 3.5

        found = {name: b.columns[f"{name}@{k}"][here] for name in (
            "obstacle_x", "obstacle_y", "obstacle_angle", "phi", "phi_x", "phi_y")}
        np.testing.assert_allclose(found["obstacle_x"], shift[0], atol=1e-12)
        np.testing.assert_allclose(found["obstacle_y"], shift[1], atol=1e-12)
        np.testing.assert_allclose(found["obstacle_angle"], angle, atol=1e-12)
        np.testing.assert_allclose(found["phi"], phi(x, y), atol=1e-12)
        for name, (dx, dy) in (("phi_x", (step, 0)), ("phi_y", (0, step))):
            slope = (phi(x + dx, y + dy) - phi(x - dx, y - dy)) / (2 * step)
            np.testing.assert_allclose(found[name], slope, atol=1e-8)
    for name, value in (("pivot_x", 0.6), ("pivot_y", -3.5)):
        np.testing.assert_allclose(b.columns[name][here], value, rtol=1e-12)


def test_what_steps_miss_of_a_motion(contact):
    """Its largest departure from lines between them, of 64 places in each of four steps, and when;
    a kink at one of them.
    """
    b = contact("moving", MOTION)
    here = own(b)
    fine, times = np.linspace(0, 2, 257), np.linspace(0, 2, 5)
    for name, paths in (("obstacle_x", {5: lambda t: 0.05 * np.sin(3 * t),
                                        8: lambda t: 0.02 * abs(t - 1.8125)}),
                        ("obstacle_angle", dict.fromkeys((5, 8), lambda t: 0.2 * t**2)),
                        ("obstacle_y", dict.fromkeys((5, 8), lambda t: -0.1 * t))):
        for label, path in paths.items():
            away = np.abs(path(fine) - np.interp(fine, times, path(times)))
            nodes = here & (b.label == label)
            np.testing.assert_allclose(b.columns[f"{name}_missed"][nodes], away.max(), atol=1e-12)
            when = b.columns[f"{name}_missed_at"][nodes]
            if away.max() > 1e-12:
                np.testing.assert_allclose(np.interp(when, fine, away), away.max(), rtol=1e-9)


@pytest.mark.parametrize("below, refused", [("1e-16", False), ("1e-6", True)])
def test_what_is_zero_but_for_rounding_is_not_negative(contact, below, refused):
    """As where a scene is turned: 1e-16 of the largest value, 9, is a rounding of it."""
    more = f"macro cohesion() (9*x - 9*{below}) //"
    if refused:
        with pytest.raises(InputError, match="cohesion is negative on label 5 at"):
            contact("negative", more)
        return
    b = contact("rounded", more)
    assert b.columns["cohesion"].min() == 0.0
    np.testing.assert_allclose(b.columns["cohesion"], 9 * b.xy[:, 0], atol=1e-12)


@pytest.mark.parametrize("still", ["gapInTime(t) (0.1*t + x)",
                                   "obstacleInTime(x, y, t) (y + 0.1*t + 0.3*x)"])
def test_surfaces_given_at_every_time(contact, still):
    b = contact(still[:9], f"macro {still} //")
    x, y = b.xy.T
    for k, t in enumerate(np.linspace(0, 2, 5)):
        if "gap" in still:
            np.testing.assert_allclose(b.columns[f"gap_in_time@{k}"], 0.1 * t + x, atol=1e-12)
        else:
            np.testing.assert_allclose(b.columns[f"phi@{k}"], y + 0.1 * t + 0.3 * x, atol=1e-12)
            np.testing.assert_allclose(b.columns[f"phi_x@{k}"], 0.3, atol=1e-9)
    if "obstacle" in still:  # a flat one that shifts: the normal is its own, to the body
        np.testing.assert_allclose(b.normal, np.tile([-0.3, -1.0] / np.hypot(0.3, 1), (len(x), 1)),
                                   atol=1e-9)


@pytest.mark.parametrize("more, refused", [("", False), (" + 0.1*(label == 8)", True)])
def test_an_obstacle_that_contact_follows_is_one_for_all_labels(contact, more, refused):
    """At any distance; what is traced beside the boundary knows no label."""
    scene = f"macro obstacle(x, y) (y + 0.3 + 0.1*x{more}) //\nmacro largeSliding() 0.5 //"
    if refused:
        with pytest.raises(InputError, match="one for all labels"):
            contact("labelled", scene)
        return
    b = contact("sliding", scene)
    np.testing.assert_allclose(b.gap, (b.xy[:, 1] + 0.3 + 0.1 * b.xy[:, 0]) / np.hypot(1, 0.1),
                               atol=1e-7)
    low, high = b.xy.min(axis=0), b.xy.max(axis=0)  # known as far as it reaches
    assert b.following.surface.box == pytest.approx(
        [low[0] - 0.5, high[0] + 0.5, low[1] - 0.5, high[1] + 0.5])


# one block on another, over an obstacle; other functions for either kind of contact
TWO = """include "scene.idp"
units("m", "Pa");
subdomains("2");
int[int] low = [1, 2, 5, 4], high = [6, 12, 13, 14];
addBody(square(4, 2, [x, y], label = low))
addBody(square(4, 2, [x, 1 + y], label = high, region = 1))
macro young() 1. //
macro poisson() 0.3 //
macro support() on(4, 14, u1 = 0.) //
macro load1() traction(13, 0., -1.) //
macro contact() 1 //
macro contactPair() 6, 5 //
macro gap() (0.1 + 0.05*x) //
macro pairGap() (0.3 - 0.2*x) //
macro friction() (label == 1 ? 0.25 : 0.75) //
include "export.idp"
"""


def test_obstacles_and_pairs_have_gaps_and_friction_of_their_own(built, named_scene):
    """Of several laws that of the kind of contact counts at a node, and none of the other's."""
    boundary = built(named_scene("two", TWO), reduce=False).structure.contact
    x = boundary.xy[:, 0]
    # means of linear functions over dual segments: at inner nodes, which have even ones
    inner = (x > 0.01) & (x < 0.99)
    for kind, gap, friction in ((~boundary.paired, 0.1 + 0.05 * x, 0.25),
                                (boundary.paired, 0.3 - 0.2 * x, 0.75)):
        here = kind & inner
        assert here.sum() == 3
        np.testing.assert_allclose(boundary.gap[here], gap[here], rtol=1e-12)
        np.testing.assert_allclose(boundary.columns["friction"][here], friction, rtol=1e-12)
