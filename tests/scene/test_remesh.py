"""REMESH: meshes without a size of their own, made anew with larger and smaller elements."""

import shutil

import numpy as np
import pytest
from mpi4py import MPI

from driver.energy_norm.adaptivity import write_sizes
from driver.errors import InputError
from driver.scene import freefem
from driver.scene.elements import areas
from driver.scene.loader import read_subdomains
from rounded_block import ROUNDED_BODY

# a plate with a hole, a core of another region and a foot of label 5; edges are counted by hand
PLATE = """include "scene.idp"
border bottom(t = 0, 4) { x = t; y = 0; label = (t > 1 && t < 3) ? 5 : 1; }
border right(t = 0, 3) { x = 4; y = t; label = 2; }
border top(t = 4, 0) { x = t; y = 3; label = 3; }
border left(t = 3, 0) { x = 0; y = t; label = 4; }
border hole(t = 0, 2*pi) { x = 1.2 + 0.5*cos(t); y = 1.8 + 0.5*sin(t); label = 6; }
border core(t = 0, 2*pi) { x = 2.9 + 0.6*cos(t); y = 1.8 + 0.6*sin(t); label = 70; }
body = buildmesh(bottom(16) + right(12) + top(16) + left(12) + hole(-20) + core(24));
int inside = body(2.9, 1.8).region;
macro young() (region == inside ? 2e5 : 7e4) //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 0., u2 = -0.001) //
macro contact() 5 //
macro friction() 0.3 //
include "export.idp"
"""
SQUARE = """lc = 0.5;
Point(1) = {0, 0, 0, lc}; Point(2) = {3, 0, 0, lc};
Point(3) = {3, 4, 0, lc}; Point(4) = {0, 4, 0, lc};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Curve(1) = {1};
Physical Curve(3) = {3};
Physical Surface(1) = {1};
"""
FILE = """include "scene.idp"
include "gmsh.idp"
body = gmshBody("half.msh", meshSize(1.));
macro young() (region == 2 ? 2e5 : 7e4) //
macro poisson() 0.3 //
macro displacement1() on(12, u1 = 0., u2 = -0.001) //
macro contact() 11 //
macro gap() y //
include "export.idp"
"""


@pytest.fixture
def from_file(scene, exported):
    """A scene whose mesh comes from a .msh: that which gmsh made for a scene with a .geo."""
    path = scene(FILE)
    shutil.copy(exported("hertz-bodies", h=0.02) / "body-0.raw", path.parent / "half.msh")
    return path


def body(problem) -> dict:
    """Numbers of triangles, area by region, and length by label, of the whole body."""
    found = {"triangles": 0}
    for sub in problem.subdomains:
        found["triangles"] += len(sub.triangles)
        area = areas(sub.xy[sub.triangles])
        for region in np.unique(sub.region):
            found["region", region] = found.get(("region", region), 0.0) + area[
                sub.region == region].sum()
        length = np.linalg.norm(np.diff(sub.xy[sub.edges], axis=1)[:, 0], axis=1)
        for label in np.unique(sub.edge_label):
            found["label", label] = found.get(("label", label), 0.0) + length[
                sub.edge_label == label].sum()
    # interfaces, and lines between regions, are no boundaries: where cut they count twice
    inner = ("label", 10000), ("label", 70)
    return {key: size for key, size in found.items() if key not in inner}


@pytest.mark.parametrize("factor, cut", [(2, 1), (0.5, 3), (0.3, 7)])
@pytest.mark.some(1)
def test_elements_are_so_many_times_as_long(scene, built, factor, cut):
    """A triangle's area goes with the square, to the quarter of a length that adaptmesh may be off
    where sizes change; outline, labels and regions stay, but for what a
    polygon of n sides lacks of a circle: pi^2 / (6 n^2) of its length, four times that of the area.
    """
    path = scene(PLATE)
    own, made = (body(built(path, subdomains=cut, remesh=each, reduce=False))
                 for each in (1, factor))
    assert 0.75**2 < made["triangles"] * factor**2 / own["triangles"] < 1.25**2
    assert made.keys() == own.keys() and len(own) == 1 + 2 + 6
    circle = 4 * np.pi**2 / 6 / (20 / max(factor, 1)) ** 2
    for key in own.keys() - {"triangles"}:
        straight = key[0] == "label" and key[1] < 6
        assert made[key] == pytest.approx(own[key], rel=1e-12 if straight else circle)


@pytest.mark.parametrize("x, y, size", [("1e6 + x", "y - 3e6", 1.0), ("1e9*x", "1e9*y", 1e9)])
def test_bodies_far_away_and_huge_ones_are_remeshed_as_others(scene, built, x, y, size):
    """The mesh is that of the body at the origin, to the digits that far coordinates have."""
    near = scene(PLATE)
    moved = ".region;\n" + f"body = movemesh(body, [{x}, {y}]);"
    far = scene(PLATE, (".region;", moved), name="far")
    own, made = (body(built(path, remesh=0.5, reduce=False)) for path in (near, far))
    assert made.keys() == own.keys()
    assert made["triangles"] == pytest.approx(own["triangles"], rel=0.05)
    for key in own.keys() - {"triangles"}:
        power = 1 if key[0] == "label" else 2
        assert made[key] / size**power == pytest.approx(own[key], rel=1e-2)


@pytest.mark.parametrize("away, size", [(0.0, 1.0), (1e6, 1.0), (0.0, 1e9)])
def test_sizes_that_were_found_are_those_of_bodies_far_away_too(scene, tmp_path, away, size):
    path = scene(PLATE, ("int inside = body(2.9, 1.8).region;",
                         f"body = square(4, 4, [{away} + {size}*x, {away} + {size}*y]);"),
                 ("(region == inside ? 2e5 : 7e4)", "7e4"), ("contact() 5", "contact() 1"))
    xy = away + size * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    rim = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    write_sizes(tmp_path / "sizes", xy, np.array([[0, 1, 2], [0, 2, 3]]), rim,
                size * np.array([0.5, 0.1, 0.1, 0.5]))
    manifest = freefem.export(path, tmp_path / "export", {"subdomains": "1"},
                              sizes=tmp_path / "sizes")
    assert manifest.nodes == pytest.approx(38, rel=0.2)
    xy = read_subdomains(manifest, 0, 1, MPI.COMM_SELF)[0].xy
    assert ((xy - away) / size)[:, 0].mean() > 0.6  # finer at the right


def test_the_scene_s_own_mesh_is_left_as_it_is(scene, built):
    """By default, and by its factor of one."""
    path = scene(PLATE)
    one, other = built(path, reduce=False), built(path, remesh=1, reduce=False)
    assert all(np.array_equal(a.xy, b.xy) for a, b in zip(one.subdomains, other.subdomains))
    assert one.manifest.parameters["remesh"] == 1


@pytest.mark.parametrize("text, change, options, said", [
    (PLATE, (), {"remesh": "0"}, "REMESH expects a positive factor"),
    (PLATE, (), {"remesh": "fine"}, "REMESH expects a number"),
    (PLATE, (), {"remesh": "1e-4"}, "more than the 2e7"),
    (PLATE, (), {"h": "0.1"}, "H does not set the size of this scene's mesh, which does not call "
     "meshSize.*REMESH=0.5"),
    (PLATE, ("top(16)", "top(3/meshSize(0.2))"), {"remesh": "2"}, "this scene has H"),
    ('include "scene.idp"\nrectangle(0., 1., 0., 1.);\nmacro young() 1. //\nmacro poisson() 0. //\n'
     'macro contact() 1 //\nmacro displacement1() on(3, u1 = 0., u2 = -0.1) //\n'
     'include "export.idp"\n', (), {"remesh": "2"}, "this scene has CELLS")])
def test_what_has_no_meaning_is_refused(scene, tmp_path, text, change, options, said):
    path = scene(text, *([change] if change else []))
    with pytest.raises(InputError, match=said):
        freefem.export(path, tmp_path / "export", options)


def test_h_changes_no_mesh_of_a_file(from_file, tmp_path):
    """What changes it is said; so it is where a .geo takes no size."""
    with pytest.raises(InputError, match="comes from half.msh: REMESH=0.5 makes"):
        freefem.export(from_file, tmp_path / "export", {"h": "0.5"})
    (from_file.parent / "square.geo").write_text(SQUARE)
    other = from_file.with_name("other.edp")
    other.write_text(from_file.read_text().replace("half.msh", "square.geo").replace(
        "region == 2", "y > 2").replace("on(12", "on(3").replace("contact() 11", "contact() 1"))
    with pytest.raises(InputError, match=r"where no  DefineConstant\[ h = .* REMESH=0.5 makes"):
        freefem.export(other, tmp_path / "export", {"h": "0.5"})
    counts = [freefem.export(other, tmp_path / factor, {"remesh": factor}).nodes
              for factor in ("1", "0.5")]
    assert 3 < counts[1] / counts[0] < 5
    (from_file.parent / "square.geo").write_text(f"DefineConstant[\n h = {{1}} ];\n{SQUARE}")
    assert "remesh" not in freefem.export(other, tmp_path / "h", {"h": "0.5"}).parameters


@pytest.mark.slow  # companions and a price list
def test_meshes_without_a_size_have_errors_and_prices(scene, solved):
    """By runs on meshes with elements twice and four times as long."""
    run = solved(scene(PLATE), ERRORS="yes")
    errors = run.summary["errors"]
    entry = errors["quantities"]["normal_resultant"]
    finer = solved(scene(PLATE), REMESH=0.2).summary["quantities"]["normal_resultant"]
    assert abs(entry["value"] - finer) < entry["total"] < 0.2 * finer
    assert "REMESH=0.5" in errors["advice"] and errors["prices"]["lines"]


WAVE = """include "scene.idp"
func real wave(real s) { return 0.4*sin(pi*s/5); }
border base(t = -5, 5) { x = t; y = -8; label = 1; }
border right(t = 0, 1) { x = 5 + 2*sin(pi*t); y = -8*(1 - t); label = 2; }
border surface(t = 5, -5) { x = t; y = wave(t); label = 3; }
border left(t = 1, 0) { x = -5; y = -8*(1 - t); label = 4; }
body = buildmesh(base(7) + right(9) + surface(23) + left(12));
macro young() 1. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
include "export.idp"
"""


def test_a_corner_between_curves_stays_one_on_the_finer_outline(scene, built):
    """Its sides turn there by 38.3 degrees, the curves through them by less; rounded it was off by
    4e-3, and sides as short as that.
    """
    problem = built(scene(WAVE), remesh=0.5, subdomains=1)
    sub = problem.subdomains[0]
    x, y = sub.xy[np.unique(sub.edges[sub.edge_label == 3])].T
    assert abs(y - 0.4*np.sin(np.pi*x/5)).max() < 1e-3
    assert 40 <= len(x) <= 50


@pytest.mark.parametrize("rise", [0.02, 0.2, 0.4])
def test_a_circle_stays_round_beside_a_blunt_corner(scene, built, rise):
    """The middle of its top turns by 1, 11 or 23 degrees, the hole's vertices by 18."""
    text = PLATE.replace("x = t; y = 3; label = 3;", f"x = t; y = 3 + {rise}*(2 - abs(t - 2))"
                         "/2; label = 3;")
    problem = built(scene(text), remesh=0.5, subdomains=1)
    sub = problem.subdomains[0]
    radius = np.linalg.norm(sub.xy[np.unique(sub.edges[sub.edge_label == 6])] - [1.2, 1.8], axis=1)
    assert len(radius) > 30
    np.testing.assert_allclose(radius, 0.5, atol=1e-4)  # its own sides are off by 6e-3
    top = sub.xy[np.unique(sub.edges[sub.edge_label == 3])]
    np.testing.assert_allclose(top[:, 1], 3 + rise * (2 - abs(top[:, 0] - 2)) / 2,
                               atol=1e-9 if rise > 0.3 else 5e-3)


RINGS = """include "scene.idp"
border one(t = 0, 0.9) { x = 10*cos(t); y = 10*sin(t); label = 1; }
border two(t = 0.9, 2*pi) { x = 10*cos(t); y = 10*sin(t); label = 2; }
border core(t = 0, 2*pi) { x = 5*cos(t); y = 5*sin(t); label = 3; }
border spoke(t = 5, 10) { x = t*cos(0.9); y = t*sin(0.9); label = 98; }
border other(t = 5, 10) { x = t; y = 0; label = 99; }
body = buildmesh(one(8) + two(34) + core(28) + spoke(6) + other(6));
macro young() 1. //
macro poisson() 0.3 //
macro support() on(1, 2, u1 = 0., u2 = 0.) //
include "export.idp"
"""
ROUNDED = f"""include "scene.idp"
{ROUNDED_BODY}
macro young() 1. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
include "export.idp"
"""


@pytest.mark.parametrize("remesh", [0.5, 0.2])
def test_circles_of_uneven_sides_stay_round(scene, built, remesh):
    """Also where regions meet their boundary; its sides are off by 0.03 and more."""
    sub = built(scene(RINGS), remesh=remesh, subdomains=1).subdomains[0]
    nodes = np.unique(sub.edges[np.isin(sub.edge_label, (1, 2))])
    np.testing.assert_allclose(np.linalg.norm(sub.xy[nodes], axis=1), 10, atol=1e-3)


def test_a_flat_side_stays_flat_beside_a_rounding(scene, built):
    sub = built(scene(ROUNDED), remesh=0.4, subdomains=1).subdomains[0]
    flat = sub.xy[np.unique(sub.edges[sub.edge_label == 4])]
    assert len(flat) > 20 and abs(flat[:, 1]).max() < 1e-3  # a side of 0.67 bulged by 5e-3
    x, y = sub.xy[np.unique(sub.edges[sub.edge_label == 3])].T
    away = np.hypot(abs(x) - 3, y - 1)
    np.testing.assert_allclose(away, 1, atol=5e-3)  # its sides are off by 8.6e-3
