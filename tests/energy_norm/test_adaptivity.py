"""Adaptive refinement: sizes from an indicator, meshes that keep the geometry, error per unknown,
no harm done.
"""

import csv
import json
import types

import numpy as np
import pytest

from driver.energy_norm import adaptivity
from driver.estimates import refinement
from driver.files import read_rows
from driver.scene import freefem
from driver.scene.loader import read_subdomains
from driver.scene.manifest import read_manifest

# ---- sizes from an indicator ---------------------------------------------------------------------


def grid(n):
    """Vertices and triangles of the unit square cut into n x n cells."""
    xy = np.stack(np.meshgrid(np.arange(n + 1), np.arange(n + 1)), axis=-1).reshape(-1, 2) / n
    at = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    return xy, np.concatenate([np.column_stack([at, at + 1, at + n + 2]),
                               np.column_stack([at, at + n + 2, at + n + 1])])


def test_a_body_alone_is_written_with_its_outline(tmp_path):
    """FreeFEM's format counts from one: vertices, triangles, then sides of the outline."""
    xy, triangles = grid(2)
    xy, triangles = np.vstack([xy, xy + 2.0]), np.vstack([triangles, triangles + 9])
    rim = np.array([[0, 1], [1, 2], [2, 5], [5, 8], [8, 7], [7, 6], [6, 3], [3, 0]])
    adaptivity.write_sizes(tmp_path / "size", xy, triangles, np.vstack([rim, rim + 9]),
                           np.arange(18.0))
    for k in (0, 1):
        rows = [line.split() for line in (tmp_path / f"size-{k}.msh").read_text().splitlines()]
        assert rows[0] == ["9", "8", "8"]
        np.testing.assert_array_equal(np.array(rows[1:10], float)[:, :2], xy[9 * k : 9 * k + 9])
        inside, sides = (np.array(part, int) for part in (rows[10:18], rows[18:]))
        np.testing.assert_array_equal(inside[:, :3] - 1, triangles[:8])
        np.testing.assert_array_equal(sides[:, :2] - 1, rim)
        data = (tmp_path / f"size-{k}.bin").read_bytes()
        assert np.frombuffer(data[:8], np.int64)[0] == 9
        assert np.frombuffer(data[8:]).tolist() == list(range(9 * k, 9 * k + 9))


@pytest.mark.parametrize("degree", [1, 2])
def test_sizes_spread_the_error_evenly(degree):
    rng = np.random.default_rng(3)
    size, indicator = rng.uniform(0.5, 2, 1000), rng.uniform(0.5, 2, 1000)
    new = adaptivity.new_sizes(size, indicator, 4000, degree)
    ratio = new / size
    # the new triangles: (size/new)^2 in each old one, with the error indicator * ratio^(degree + 1)
    # each
    assert (ratio**-2).sum() == pytest.approx(4000, rel=1e-12)
    error = indicator * ratio ** (degree + 1)
    np.testing.assert_allclose(error, error[0], rtol=1e-12)


def test_sizes_keep_their_limits_and_the_number_of_triangles():
    indicator = np.full(1000, 1e-9)
    indicator[:5] = 1.0
    ratio = adaptivity.new_sizes(np.ones(1000), indicator, 4000)
    # five triangles may hold 64 new ones each, the others make up for the rest: 4000 are not to be
    # had
    assert ratio[:5].max() == adaptivity.SMALLEST and ratio.max() <= adaptivity.LARGEST
    indicator[5:] = 1e-3
    ratio = adaptivity.new_sizes(np.ones(1000), indicator, 4000)
    assert (ratio**-2).sum() == pytest.approx(4000, rel=0.01)


def test_without_error_the_mesh_is_refined_evenly():
    np.testing.assert_allclose(adaptivity.new_sizes(np.ones(50), np.zeros(50), 200), 0.5)


def test_element_size_is_the_side_of_an_equilateral_triangle():
    xy = np.array([[0, 0], [2, 0], [1, np.sqrt(3)], [1, -np.sqrt(3)]])
    np.testing.assert_allclose(adaptivity.element_sizes(xy, np.array([[0, 1, 2], [0, 3, 1]])), 2)


def test_nodal_sizes_do_not_jump():
    xy, triangles = grid(16)
    size = np.full(len(triangles), 1.0)
    size[0] = 1e-3
    nodal = adaptivity.even(xy, triangles, adaptivity.vertex_sizes(xy, triangles, size),
                            adaptivity.STEEPEST)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        i, j = triangles[:, a], triangles[:, b]
        rise = np.abs(nodal[i] - nodal[j]) / np.linalg.norm(xy[i] - xy[j], axis=1)
        assert rise.max() <= adaptivity.STEEPEST * (1 + 1e-12)
    assert nodal.max() <= 1 and nodal.min() > 1e-3


def chain(pressure, sticks=np.inf):
    """41 contact nodes on -1 < x < 1, a second chain of five, and a state with these tractions."""
    x = np.concatenate([np.linspace(-1, 1, 41), 5 + np.arange(5)])
    boundary = types.SimpleNamespace(
        xy=np.column_stack([x, np.zeros(len(x))]), arc=x, chain=(x > 2).astype(int),
        middle=np.zeros(len(x), bool), weight=np.full(len(x), 0.05))
    p = pressure(x)
    return boundary, {"sigma_n": -p, "sigma_t": p * (np.abs(x) > sticks)}


def test_contact_is_refined_where_tractions_bend():
    """An end of contact, ends of sticking; not between, nor across two chains, nor where linear."""
    boundary, state = chain(lambda x: np.maximum(0.0, 0.5 - np.abs(x) * (np.abs(x) < 2)), 0.2)
    state["sigma_n"][41:] = 0.0
    places, sizes = adaptivity.contact_sizes(boundary, [state])
    fine = places[sizes < 0.02, 0]
    assert {0.5, 0.2} <= set(np.abs(np.round(fine, 9))) and np.abs(fine).max() < 0.6
    assert sizes[places[:, 0] > 2].min() > 1 and len(places) == 39 + 3
    assert sizes[np.isclose(places[:, 0], 0.35)] > 0.05 / 2
    beside = np.abs(places[:, 0]).round(9)[:, None] == [0.45, 0.55, 0.15, 0.25]
    assert sizes[beside.any(axis=1)].max() < 0.02  # a kink may be anywhere between its neighbours
    weak = {**state, "sigma_t": 0.01 * state["sigma_t"]}  # its ends of sticking count as much
    assert np.allclose(adaptivity.contact_sizes(boundary, [weak])[1], sizes, rtol=1e-9)
    nothing = adaptivity.contact_sizes(boundary, [{"sigma_n": 0 * state["sigma_n"],
                                                   "sigma_t": 0 * state["sigma_t"]}])
    assert len(nothing[1]) == 0


# ---- meshes --------------------------------------------------------------------------------------

LENS = """include "scene.idp"
// two arcs of radius 2 that meet in corners, a notch of 8 degrees in a straight side, two regions
subdomains("4"); units("1", "1");
real h = meshSize(0.2);
border below(t=-pi/6, pi/6) {{ x = 2*sin(t); y = -2*cos(t); label = 1; }}
border right(t=0, 1) {{ x = 1 + 0.07*(t < 0.5 ? t : 1 - t)*2; y = -sqrt(3.) + 2*t; label = 2; }}
border top(t=1, -1) {{ x = t; y = 2 - sqrt(3.); label = 3; }}
border left(t=0, 1) {{ x = -1; y = 2 - sqrt(3.) - 2*t; label = 4; }}
border line(t=-1, 1) {{ x = t; y = -0.5; label = 0; }}
body = buildmesh(below(2*pi/3/h) + right(2*ceil(1/h)) + top(2/h) + left(2/h));
body = change(body, fregion = (y > -0.5 ? 2 : 1));
macro young() 1. //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 1 //
macro obstacle(x, y) (y + 1.99) //
include "export.idp"
"""


HOLED = """include "scene.idp"
real h = meshSize(1.);
border floorSide(t=-5, 5) { x = t; y = 0.; label = 1; }
border right(t=0, 8) { x = 5.; y = t; label = 2; }
border top(t=5, -5) { x = t; y = 8.; label = 3; }
border left(t=8, 0) { x = -5.; y = t; label = 4; }
border hole(t=2*pi, 0) { x = 2*cos(t); y = 4. + 2*sin(t); label = 5; }
body = buildmesh(floorSide(10/h) + right(8/h) + top(10/h) + left(8/h) + hole(4*pi/h));
macro young() 1. //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -1.) //
include "export.idp"
"""


@pytest.fixture(scope="module")
def adapted(tmp_path_factory):
    """adapted(scene, function, **parameters): subdomains of the scene's mesh and of that with the
    sizes function(x, y).
    """
    from mpi4py import MPI

    def read(folder):
        manifest = read_manifest(folder)
        return read_subdomains(manifest, 0, manifest.subdomains, MPI.COMM_SELF)

    def make(scene, function, **parameters):
        folder = tmp_path_factory.mktemp("adapted")
        parameters = {name: str(value) for name, value in parameters.items()}
        freefem.export(scene, folder / "first", parameters)
        first = read(folder / "first")
        xy = np.zeros((1 + max(s.node_gid.max() for s in first), 2))
        for s in first:
            xy[s.node_gid] = s.xy
        triangles = np.concatenate([s.node_gid[s.triangles] for s in first])
        edges = np.concatenate([s.node_gid[s.edges[s.edge_label < 100]] for s in first])
        adaptivity.write_sizes(folder / "size", xy, triangles, edges, function(*xy.T))
        freefem.export(scene, folder / "second", parameters, sizes=folder / "size")
        return first, read(folder / "second")

    return make


def edges_of(subdomains, label):
    """(n, 2, 2) ends of the boundary edges with a label."""
    return np.concatenate([s.xy[s.edges[s.edge_label == label]] for s in subdomains])


@pytest.mark.slow
def test_bodies_from_gmsh_that_are_moved_keep_their_curves(adapted):
    """The lower disc is turned round after gmsh has made it: where gmsh meshes, the sizes are not
    what belongs there.
    """

    def wanted(x, y):
        return np.maximum(0.002, 0.1 * np.hypot(x, y))

    first, second = adapted(freefem.find_scene("hertz-bodies"), wanted, h=0.004)
    for label, centre, radius in ((1, 1.0, 1.0), (2, 1.0, 1.0), (11, -1.5, 1.5), (12, -1.5, 1.5)):
        chord = np.linalg.norm(np.diff(edges_of(first, label), axis=1), axis=2).max()
        off = np.abs(np.linalg.norm(edges_of(second, label) - [0, centre], axis=2) - radius)
        # the first mesh has h^2/(8 R) between chord and arc; the curve through its vertices takes
        # most of that away
        assert off.max() < chord**2 / (8 * radius) / 4


def test_freefem_mesh_keeps_curves_corners_labels_and_regions(adapted, tmp_path):
    scene = tmp_path / "lens.edp"
    scene.write_text(LENS.format())

    def wanted(x, y):
        return np.maximum(0.01, 0.2 * np.hypot(x - 0.3, y + 2))

    first, second = adapted(scene, wanted)
    size = np.concatenate([adaptivity.element_sizes(s.xy, s.triangles) for s in second])
    centre = np.concatenate([s.xy[s.triangles].mean(axis=1) for s in second])
    # a mesher meets sizes to some ten percent
    assert 0.85 < np.median(size / wanted(*centre.T)) < 1.15
    arc = edges_of(second, 1)
    chord = np.linalg.norm(arc[:, 0] - arc[:, 1], axis=1)
    off = np.abs(np.linalg.norm(arc, axis=2) - 2)
    # "on the geometry as well as before": a chord h of the first mesh left h^2/(8 R) = 2.5e-3
    # between curve and mesh; the curve through its vertices misses by the fourth power of h/R,
    # hundredths of that
    assert chord.min() < 0.02 and off.max() < 0.2**2 / 16 / 20
    for label in (1, 2, 3, 4):
        ends = [np.array([found.reshape(-1, 2).min(axis=0), found.reshape(-1, 2).max(axis=0)])
                for found in
                (edges_of(first, label), edges_of(second, label))]
        np.testing.assert_allclose(*ends, atol=2e-3)
    # the tip of the flat notch is a vertex still (buildmesh puts it a bit beside y = 1 - sqrt(3),
    # on the finer mesh that is the outline elsewhere), straight sides are straight
    side = edges_of(first, 2).reshape(-1, 2)
    tip = side[side[:, 0].argmax()]
    assert np.abs(edges_of(second, 2) - tip).sum(axis=2).min() < 2e-3
    assert edges_of(second, 2)[..., 0].max() == pytest.approx(tip[0], abs=1e-5)
    assert np.ptp(edges_of(second, 3)[:, :, 1]) < 1e-12
    # the line between the regions is made of sides of the scene's own mesh: its steps are as small
    # as those; rectangle, segment of the circle, and what the notch has of each
    below, notch = np.sqrt(3) - 0.5, 0.07 * (2 - np.sqrt(3) + 0.5) ** 2 / 2
    exact = {1: 2 * below + 2 * (np.pi / 3 - np.sin(np.pi / 3)) + 0.07 - notch,
             2: 2 * (2 - below) + notch}
    for region, area in exact.items():
        found = sum((np.sqrt(3) / 4
                     * adaptivity.element_sizes(s.xy, s.triangles)[s.region == region] ** 2).sum()
                    for s in second)
        assert found == pytest.approx(area, rel=5e-3)


def test_a_hole_of_few_sides_is_remeshed_as_the_circle_that_it_is(adapted, tmp_path):
    """Six sides turn by 60 degrees: corners, were the scene not asked for more of them."""
    scene = tmp_path / "holed.edp"
    scene.write_text(HOLED)
    first, second = adapted(scene, lambda x, y: 0.4 + 0 * x, h=2)
    off = [np.abs(np.linalg.norm(edges_of(found, 5) - [0, 4], axis=2) - 2).max()
           for found in (first, second)]
    sides = [len(edges_of(found, 5)) for found in (first, second)]
    assert sides[0] == 6 and sides[1] >= 24
    # of 24 sides, between chord and arc; the curve through their ends errs by hundredths of it
    assert off[1] < 2 * (1 - np.cos(np.pi / 24)) / 20


def test_gmsh_mesh_lies_on_the_geometry(adapted):
    def wanted(x, y):
        return np.maximum(0.004, 0.2 * np.hypot(x, y))

    _, second = adapted(freefem.find_scene("hertz"), wanted, h=0.02)
    for label in (1, 2):
        arc = edges_of(second, label)
        # every vertex on the circle, whose centre is (0, 1): gmsh writes 16 digits
        assert np.abs(np.hypot(arc[..., 0], arc[..., 1] - 1) - 1).max() < 1e-12
    arc = edges_of(second, 1)
    assert np.linalg.norm(arc[:, 0] - arc[:, 1], axis=1).min() < 0.006


# ---- runs ----------------------------------------------------------------------------------------

def cycles(run):
    with open(run.directory / "adaptivity.csv", newline="") as file:
        return [{name: float(value or "nan") for name, value in row.items()}
                for row in csv.DictReader(file)]


def test_patch_stays_exact(solved):
    run = solved("patch", angle=30, cells=4, adapt=1, rtol=1e-13)
    assert run.status == 0
    # as in test_scenes_exact: the linear solution is in every mesh's space
    np.testing.assert_allclose(run.contact["sigma_n"], -1, rtol=1e-9)


def test_touching_bodies_are_remeshed_each_by_itself(solved):
    run = solved("patch-bodies", h=0.2, adapt=1, rtol=1e-12)
    assert run.status == 0
    first, last = cycles(run)
    assert last["primal_dofs"] > 2 * first["primal_dofs"]
    # the contact patch test holds for every pair of meshes: linear displacement, uniform stress
    assert np.abs(run.contact["sigma_n"] / np.median(run.contact["sigma_n"]) - 1).max() < 1e-6


@pytest.mark.slow
def test_error_falls_faster_than_on_uniform_meshes(solved):
    """The clamped corners are singular like r^0.7: uniform meshes lose the rate 1/2 in unknowns,
    adaptive ones keep it.
    """
    run = solved(cells=4, steps=2, adapt=2, errors="energy")
    found = cycles(run)
    dofs, error = (np.array([row[name] for row in found]) for name in ("primal_dofs", "mesh_error"))
    # 1/2, and the first cycle repairs what the uniform mesh does badly
    rate = np.log(error[:-1] / error[1:]) / np.log(dofs[1:] / dofs[:-1])
    assert rate[0] > 0.6 and rate[1] > 0.48, (dofs, error)
    uniform = [solved(cells=c, steps=2, errors="energy").summary for c in (8, 32)]
    size, coarse = ([summary[a][b] for summary in uniform]
                    for a, b in (("sizes", "primal_dofs"), ("errors", "energy")))
    coarse = [energy["mesh"] for energy in coarse]
    # h^0.7 is 0.35 in unknowns, where the regular part, of rate 1/2, has gone
    assert np.log(coarse[0] / coarse[1]) / np.log(size[1] / size[0]) < 0.45, coarse
    # a smaller error with less than a third of the unknowns
    assert run.summary["sizes"]["primal_dofs"] == dofs[-1] < size[1] / 3
    assert error[-1] < coarse[1], (error, coarse)
    # loads alone move the body, so that |u| at the loaded corner comes from below: the coarse mesh
    # lacks 11% of it
    fine = uniform[1]["quantities"]["displacement"]
    assert run.summary["quantities"]["displacement"] > 0.995 * fine


def test_a_refusal_to_refine_leaves_nothing_to_go_on_from(command_here, named_scene, tmp_path):
    """Under a point load the same command would be refused again."""
    scene = named_scene("pushed", """include "scene.idp"
body = square(4, 4);
bodyMaterial("a", 1., 0.3);
macro support() on(1, u1 = 0., u2 = 0.) //
macro pointLoad1() [0.5, 1., 0., -1.] //
include "export.idp"
""")
    done = command_here("run", f"SCENE={scene}", "ADAPT=1", "QUIET=yes", "FIGURES=no",
                        f"OUT={tmp_path / 'out'}")
    assert done.returncode == 2 and "ADAPT has no error to refine by" in done.stderr
    assert "goes on" not in done.stderr and not list(tmp_path.iterdir())


@pytest.mark.slow
def test_options_of_adaptation(solved):
    assert "ADAPT expects" in solved("punch", adapt="x").reason
    run = solved("bar", cells=2, adapt=1, subdomains="4x1")
    # on an adapted mesh NxM is the number of subdomains
    assert run.status == 0 and run.summary["sizes"]["subdomains"] == 4
    assert len(cycles(run)) == 2
    assert min(run.summary["seconds"][name] for name in ("export_cycles", "solve_cycles")) > 0
    assert not list(run.directory.glob("size*")) and not list(run.directory.glob("cycle*"))


@pytest.mark.slow  # two refined runs; estimates on ranks are in test_energy_error
def test_meshes_do_not_depend_on_the_ranks(solved):
    one, two = (solved("pressfit", h=8, adapt=1, np=ranks) for ranks in (1, 2))
    # to the last bit, as all results
    assert (one.directory
            / "contact.csv").read_bytes() == (two.directory / "contact.csv").read_bytes()


@pytest.mark.slow
def test_figure_of_the_mesh_and_its_error(solved):
    from driver import figures

    run = solved("pressfit", h=5, adapt=1, errors="energy", fields="yes")
    assert "adaptivity" in figures.wanted(figures.read_run(run.directory))
    drawn = figures.compose("adaptivity", figures.read_run(run.directory))
    _, error = drawn.axes
    sizes, relative = error.lines[0].get_data()
    np.testing.assert_allclose(sizes, [row["primal_dofs"] for row in cycles(run)])
    assert relative[-1] == pytest.approx(100 * run.summary["errors"]["energy"]["mesh"]
                                         / run.summary["errors"]["energy"]["norm"])


def test_point_loads_have_no_error_to_refine_by(solved, tmp_path):
    scene = tmp_path / "point.edp"
    scene.write_text(freefem.find_scene("bar").read_text().replace(
        'include "export.idp"', 'macro pointLoad1() [0., 0., 1., 0.] //\ninclude "export.idp"'))
    run = solved(scene, cells=2, adapt=1)
    assert run.status == 2 and "point loads" in run.reason and "\n" not in run.reason
    assert "goes on" not in run.reason


def test_a_row_of_the_report_is_of_its_own_cycle(tmp_path):
    """Seconds without those of the cycles before, errors relative to the norm, or none."""
    places = []
    for k, (energy, before) in enumerate([({"mesh": 2.0, "norm": 8.0}, {}), ({}, {
            "export_cycles": 3.0, "solve_cycles": 4.5})]):
        places.append(tmp_path / f"{k}")
        places[-1].mkdir()
        (places[-1] / "summary.json").write_text(json.dumps({
            "seconds": {"total": 10.0, **before}, "errors": {"energy": energy},
            "sizes": {"subdomains": 4, "primal_dofs": 100 * k}, "quantities": {"slip": 0.25}}))
    refinement.report(places[1], places[:1])
    first, last = read_rows(places[1] / "adaptivity.csv")
    assert (first["seconds"], first["relative"], first["primal_dofs"]) == ("10.0", "0.25", "0")
    assert (last["seconds"], last["relative"], last["slip"]) == ("2.5", "", "0.25")
    assert refinement.describe(places[0]) == (
        "0 primal dofs, error in the energy norm 25 %, 10.00 s")
    summary = json.loads((places[0] / "summary.json").read_text())
    summary["errors"]["energy"]["mesh"] = 4e-13  # rounding
    (places[0] / "summary.json").write_text(json.dumps(summary))
    assert "norm <0.001 %," in refinement.describe(places[0])
