"""Functions of FreeFEM's library by themselves, on outlines whose corners and arcs are known."""

import subprocess

import numpy as np
import pytest

from driver import children
from driver.scene import declarations

HEAD = """
load "bfstream"
string sizeField = "";
bool outlineIsFiner = false;
int outlineFiner = 4;
int[int] libCurvedLabels = [1];
macro quadraticElement() 1 //
include "speck.idp"
include "smooth.idp"
include "arcs.idp"
include "adapt.idp"
cout.precision(15);
"""
CORNER = 'cout << libSharpCorner(Th{0}) << endl;\n'
RISES = """
{{
  real[int] riseX(Th{0}.nbe), riseY(Th{0}.nbe);
  int found = findRises(Th{0}, riseX, riseY);
  cout << found << " " << Th{0}.nbe << endl;
  for (int k = 0; k < Th{0}.nbe; ++k)
    cout << Th{0}.be(k)[0] << " " << Th{0}.be(k)[1] << " " << riseX[k] << " " << riseY[k] << endl;
  mesh fine = halvedOnCurves(Th{0});
  cout << fine.nt << " " << fine.nbe << endl;
  for (int k = 0; k < fine.nbe; ++k) {{
    int i = fine.be(k)[0];
    cout << fine(i).x << " " << fine(i).y << endl;
  }}
}}
"""


def path(turns, lengths, start=0.7) -> np.ndarray:
    """Places (n, 2) of a closed walk: sides of `lengths`, each after a turn in degrees."""
    heading = start + np.cumsum(np.deg2rad(turns))
    xy = np.cumsum(np.array(lengths)[:, None] * np.column_stack([np.cos(heading),
                                                                 np.sin(heading)]), axis=0)
    assert np.abs(xy[-1]).max() < 1e-12 * np.sum(lengths)
    return xy


def lens(sides: int, sharper: float) -> tuple[np.ndarray, float]:
    """Two arcs of so many sides, with kinks of `sharper` times the turn of an arc; that turn."""
    turn = 180 / (sides - 1 + sharper)
    return path(2 * [sharper * turn, *(sides - 1) * [turn]], 2 * sides * [1.0]), turn


def drop(corner: float, sides: int) -> np.ndarray:
    """An arc of radius 1 and its tangents, which meet with a kink of `corner` degrees, first."""
    half = np.deg2rad(corner / 2)
    angle = np.linspace(half, 2 * np.pi - half, sides + 1) + 0.4
    tip = np.array([np.cos(0.4), np.sin(0.4)]) / np.cos(half)
    return np.vstack([tip, np.column_stack([np.cos(angle), np.sin(angle)])])


def library(tmp_path, outlines, what: str) -> list[np.ndarray]:
    """What FreeFEM prints, a row of numbers a line, of fans of triangles within the outlines."""
    lines = [HEAD]
    for k, xy in enumerate(outlines):
        n = len(xy)
        sides = [(i + 1, i % n + 2) for i in range(1, n + 1)]
        rows = [(n + 1, n, n), (*xy.mean(axis=0), 0), *((*place, 1) for place in xy),
                *((1, *side, 0) for side in sides), *((*side, 1) for side in sides)]
        file = tmp_path / f"{k}.msh"
        file.write_text("".join(" ".join(map(str, row)) + "\n" for row in rows))
        lines += [f'mesh Th{k} = readmesh("{file}");', what.format(k)]
    script = tmp_path / "library.edp"
    script.write_text("\n".join(lines))
    return printed(tmp_path, script)


def printed(tmp_path, script) -> list[np.ndarray]:
    """What FreeFEM prints for a script, a row of numbers a line."""
    declarations.write(tmp_path)
    env = children.child_environment(False, "P2")
    env["FF_INCLUDEPATH"] = f"{tmp_path};{env['FF_INCLUDEPATH']}"
    done = children.run_child(
        [children.program("FreeFem++"), "-nw", "-ns", "-v", "0", str(script)],
        env=env, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, done.stdout
    return [np.array(line.split(), float) for line in done.stdout.splitlines() if line.strip()]


def test_a_corner_is_known_by_its_angle_whichever_vertex_it_is(tmp_path):
    """From 45 degrees on; less where it turns by three times as much as both its neighbours.

    A corner that few sides round off turns beside a straight side, but not beside the next one.
    """
    one, rounded = drop(36.0, 60), 4 * [0, 0, *4 * [22.5]]
    outlines = [one, np.roll(one, -1, axis=0), lens(13, 3.05)[0], lens(13, 2.95)[0],
                path(rounded, 4 * [3, 3, 3, 1, 1, 1]), path(4 * [90], 4 * [1])]
    found = np.ravel(library(tmp_path, outlines, CORNER))
    turn = 3.05 * lens(13, 3.05)[1]
    np.testing.assert_allclose(found, 0.99 * np.array([36, 36, turn, 45, 45, 45]), rtol=1e-9)


def test_sides_of_arcs_rise_to_their_circles(tmp_path):
    """Between corners, by the way from the middle of a chord to its circle; halves end on it."""
    corners, smooth = lens(13, 3.05), lens(13, 2.95)
    radius = [0.5 / np.sin(np.deg2rad(turn / 2)) for _, turn in (corners, smooth)]
    uneven = 2 * np.pi * (np.arange(9) + [0, 0.3, 0.1, -0.2, 0, 0.3, 0.2, 0.1, -0.1]) / 9
    circle = 2.0 * np.column_stack([np.cos(uneven), np.sin(uneven)])
    rows = iter(library(tmp_path, [corners[0], circle, smooth[0]], RISES))
    for xy, r in ((corners[0], radius[0]), (circle, 2.0), (smooth[0], radius[1])):
        n, right = len(xy), []
        assert next(rows).tolist() == [n, n]
        for start, end, *rise in (next(rows) for _ in range(n)):
            chord = xy[int(end) - 1] - xy[int(start) - 1]
            size = np.linalg.norm(chord)
            outward = np.array([chord[1], -chord[0]]) / size
            right.append(np.allclose(rise, (r - np.sqrt(r**2 - size**2 / 4)) * outward,
                                     rtol=1e-9, atol=1e-12))
        # corners that are none are smoothed: the sides beside them and no others
        assert right.count(False) == (4 if xy is smooth[0] else 0)
        assert next(rows).tolist() == [4 * n, 2 * n]
        halves = np.array([next(rows) for _ in range(2 * n)])
        if xy is circle:
            np.testing.assert_allclose(np.hypot(*halves.T), 2.0, rtol=1e-9)


TRACE = """
load "bfstream"
include "scene.idp"
int rigidLabels = 0;
bool builtDirectly = true;
int cellsX = 1, cellsY = 1;
int[int] contactLabels(1);
real[int] bound(4);
macro libTurn(Th) //
macro largeSliding() 1. //
macro obstacleAsked() 1 //
macro obstacle(x, y) {phi} //
include "effects/large_sliding.idp"
bound = [{box}];
slidingShortest = 0.05;
slidingTrace(bound);
cout.precision(15);
for (int k = 0; k < slidingSegments; ++k) {{
  for (int c = 0; c < 8; ++c) cout << slidingCurve(k, c) << " ";
  cout << endl;
}}
"""


def traced(tmp_path, phi: str, box: str, more: str = "") -> np.ndarray:
    """Segments (s, 8) of the curve phi = 0 in a box: both ends, and directions there."""
    script = tmp_path / "trace.edp"
    script.write_text(TRACE.format(phi=phi, box=box) + more)
    return np.array(printed(tmp_path, script))


@pytest.mark.slow
def test_the_curve_of_an_obstacle_is_traced_as_a_whole(tmp_path):
    """A circle, also in the last row and column of the grid, as far as it is in the box: by cubics
    that are off it by a billionth of the box, and no more of these than their fourth order takes.
    """
    x0, y0, r = 0.96, 0.955, 0.0445
    segments = traced(tmp_path, f"{r} - sqrt((x - {x0})^2 + (y - {y0})^2)", "-1., 1., -1., 1.")
    arms = segments[:, :4].reshape(-1, 2, 2) - [x0, y0]
    np.testing.assert_allclose(np.linalg.norm(arms, axis=2), r, rtol=1e-8)
    np.testing.assert_allclose(segments[:, 4:].reshape(-1, 2, 2), -arms / r, atol=1e-5)
    angle = np.arccos((arms[:, 0] * arms[:, 1]).sum(axis=1) / r**2).sum()
    np.testing.assert_allclose(angle, 2 * np.pi - 2 * np.arccos((1 - x0) / r), rtol=1e-6)
    chord = arms[:, 1] - arms[:, 0]
    size = np.linalg.norm(chord, axis=1)
    along, middle = chord / size[:, None], arms.mean(axis=1)
    away = middle / np.linalg.norm(middle, axis=1)[:, None]
    rise, fall = (-(way * along).sum(axis=1) / (way * away).sum(axis=1)
                  for way in (segments[:, 4:6], segments[:, 6:8]))
    middle = middle + (size * (rise - fall) / 8)[:, None] * away
    np.testing.assert_allclose(np.linalg.norm(middle, axis=1), r, atol=2.1e-9)
    # r a^4 / 384 is what a cubic over the angle a misses; halves are half as long as need be
    assert len(segments) < 4 * angle / (384 * 2e-9 / r) ** 0.25
    ends, count = np.unique(np.round(arms.reshape(-1, 2), 7), axis=0, return_counts=True)
    assert (count <= 2).all()
    up = np.sqrt(r**2 - (1 - x0) ** 2)
    np.testing.assert_allclose(ends[count == 1], [[1 - x0, -up], [1 - x0, up]], atol=1e-6)


AGAIN = """
for (int c = 0; c < 4; c += 3) {
  real[int] other = bound;
  other[c] *= 1.25;
  slidingTrace(other);
  for (int i = 0; i < 4; ++i) cout << slidingTraced[i] << " ";
  for (int i = 0; i < 4; ++i) cout << other[i] << " ";
  cout << endl;
}
"""


@pytest.mark.slow
def test_corners_of_an_obstacle_are_traced(tmp_path):
    """Short straight ends meet in them. In another box the curve is traced again."""
    rows = traced(tmp_path, "max(abs(x - 0.3), abs(y)) - 0.05", "-1., 1., -0.8, 1.6", AGAIN)
    segments, again = rows[:-2], rows[-2:]
    np.testing.assert_array_equal(again[:, :4], again[:, 4:])
    size = np.linalg.norm(segments[:, 2:4] - segments[:, :2], axis=1)
    np.testing.assert_allclose(size.sum(), 8 * 0.05, rtol=1e-5)
    assert np.abs(segments[:, :2] - [0.3, 0.0]).max() <= 0.05 * (1 + 1e-9)
    assert (((segments[:, :2] - [0.3, 0.0]) * segments[:, 4:6]).sum(axis=1) > 0).all()
