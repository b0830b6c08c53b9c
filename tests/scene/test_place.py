"""An export depends on where its scene lies by places alone: whatever is given at places goes with
the body.
"""

import dataclasses

import numpy as np
import pytest

# of two, as the grids of the meshes are: shifted places are exact
AWAY = 512.0, -2048.0
GRID = 'subdomains("2x2");\nrectangle(X, X + 4., Y, Y + 2.);'
MESH = """subdomains("3");
body = square(8, 4, [X + 4*x, Y + 2*y]);"""
PAIR = """subdomains("4");
int[int] below = [5, 6, 7, 8];
addBody(square(8, 4, [X + 4*x, Y + 2*y]))
addBody(square(6, 2, [X + 4*x, Y - 1 + y], label = below))
macro contactPair() 1, 7 //
macro pairGap() (0.01*(x - X)) //"""
SCENE = """include "scene.idp"
real X = physical("beside", 0.), Y = physical("above", 0.);
BODY
quasistatic(2.);
macro young() (1e3 + 100.*(x - X)) //
macro poisson() (0.25 + 0.05*(y - Y)) //
macro support() on(4, u1 = 0., u2 = 0.) //
macro displacement1() on(4, u1 = 0.01*(y - Y), u2 = 0.) //
macro load1() traction(3, 0., -1. - (x - X)) //
macro bodyForce1() [0.1*(y - Y), 0.2*(x - X)] //
macro pointLoad1() [X + 4., Y + 2., 1., -2., X + 2., Y + 2., 0.5, 0.25] //
macro pointSpring() [X + 4., Y + 1., 3., 5., X + 2., Y + 2., 7., 0.] //
macro thermal1() (1e-3*(x - X)*(y - Y)) //
macro amplitude1(t) t //
macro contact() CONTACT //
macro friction() (0.1 + 0.1*(x - X)) //
MORE
include "export.idp"
"""
STANDS = """macro obstacle(x, y) (sqrt(((x) - X - 1.)^2 + ((y) - Y + R)^2) - R + 0.25) //
real R = 6.;
"""
MOVES = STANDS + """macro obstacleX(t) (0.05*t^3) //
macro obstacleY(t) (0.01*sin(t)) //
macro obstacleAngle(t) (0.02*t^3) //
macro obstaclePivot() [X + 1., Y - 4.] //
"""
FIXED = """macro obstacleY(t) (0.01*t^3) //
macro gap() (0.01*(x - X)^2) //
"""
FOLLOWED = STANDS + """macro obstacleX(t) (0.05*t^3) //
macro largeSliding() 0.5 //
"""
CASES = {"grid": (GRID, "1", MOVES, {}), "quadratic": (GRID, "1", STANDS, {"element": "P2"}),
         "follows": (GRID, "1", FOLLOWED, {}), "mesh": (MESH, "1", MOVES, {}),
         "pair": (PAIR, "5", FIXED, {"element": "P2"})}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.some(1)
def test_an_export_elsewhere_differs_by_its_place(built, named_scene, name):
    """To rounding, beside the places, which beside the bodies' are those of the curve."""
    body, contact, more, options = CASES[name]
    text = SCENE.replace("BODY", body).replace("CONTACT", contact).replace("MORE", more)
    scene = named_scene(f"place-{name}", text)
    here, there = (built(scene, reduce=False, steps=3, beside=x, above=y, **options)
                   for x, y in ((0.0, 0.0), AWAY))
    size, shift = 2048.0, np.array(AWAY)  # the largest coordinate: what places round off
    for one, other in zip(here.subdomains, there.subdomains, strict=True):
        np.testing.assert_allclose(other.xy - shift, one.xy, atol=1e-14 * size)
        for field in dataclasses.fields(one):
            if field.name not in ("xy", "contact"):
                same(getattr(one, field.name), getattr(other, field.name))
        assert (one.contact is None) == (other.contact is None)
        if one.contact is not None:
            for key in ("node", "label", "weight", "normal"):
                same(getattr(one.contact, key), getattr(other.contact, key))
            for key, column in one.contact.columns.items():
                moved = {"pivot_x": shift[0], "pivot_y": shift[1]}.get(key, 0.0)
                same(column, other.contact.columns[key] - moved)
    rooms = [problem.manifest.rooms.get("large_sliding", {}) for problem in (here, there)]
    if "curve" in rooms[0]:
        boxes = [np.array(room["box"]).reshape(2, 2) for room in rooms]
        np.testing.assert_allclose(boxes[1] - shift[:, None], boxes[0], atol=1e-12 * size)
        curves = [np.array(room["curve"]) for room in rooms]
        curves[1][:, :4] -= np.tile(shift, 2)
        # roots of a function of which differences over 1e-6 of the box are taken
        np.testing.assert_allclose(curves[1], curves[0], atol=1e-6)


def same(one, other) -> None:
    """Equal to ten times what differences over 1e-5 of a body leave of coordinates' rounding."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            same(one[key], other[key])
    elif dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            same(getattr(one, field.name), getattr(other, field.name))
    elif np.asarray(one).dtype.kind == "f":
        np.testing.assert_allclose(other, one, atol=1e-7 * max(1.0, np.max(np.abs(one), initial=0)))
    elif isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
    else:
        assert one == other
