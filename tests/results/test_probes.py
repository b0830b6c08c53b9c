"""Probes: places and labels where a scene asks for displacements and forces."""

import re

import numpy as np
import pytest

from driver.effects import Effects
from driver.errors import InputError
from driver.files import read_table

BLOCK = """include "scene.idp"
units("mm", "MPa");
subdomains("{cut}");
int[int] sides = [7, 5, 31, 12];
body = square(6, 4, [3.*x, {rise}*x + 2.*y], label = sides);
quasistatic(1.);
macro young() 100. //
macro poisson() 0.25 //
macro support() on(12, u1 = 0.) + {support} //
macro load1() traction(5, 2., 0.5) //
macro amplitude1(t) t //
{more}
include "export.idp"
"""
PROBES = """macro probeLabels() [5, 12, 7, 31] //
macro probePoints() [3., 1., 1.1, 0.7, 0., 0.] //"""


@pytest.fixture(scope="module")
def block(solved, tmp_path_factory):
    """block(cut, more, **options): outcome of a run, and its probes by name, columns (steps,)."""
    folder = tmp_path_factory.mktemp("scenes")

    def get(name: str, cut="1", more=PROBES, support="on(7, u2 = 0.)", rise=0.0, **options):
        path = folder / f"{name}.edp"
        path.write_text(BLOCK.format(cut=cut, more=more, support=support, rise=rise))
        run = solved(path, steps=2, **options)
        table = read_table(run.directory / "probes.csv") if not run.status else None
        return run, {probe: {key: column[table["probe"] == probe] for key, column in table.items()}
                     for probe in np.unique(table["probe"])} if table else None

    return get


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_uniform_tension_is_reproduced_at_any_place(block, element):
    """Rollers left and below, tension 2 and no shear: u = (s (1 - nu^2)/E x, -nu (1 + nu) s/E y)
    is linear, so that every element has it exactly.
    """
    run, found = block("tension", element=element, more=PROBES
                       + "\nmacro load2() traction(5, 0., -0.5) //\nmacro amplitude2(t) t //")
    stretch, thinning = 2 * (1 - 0.25**2) / 100, -2 * 0.25 * 1.25 / 100
    for name, (x, y) in {"point1": (3, 1), "point2": (1.1, 0.7), "point3": (0, 0),
                         "label5": (3, 1), "label31": (1.5, 2), "label12": (0, 1)}.items():
        probe = found[name]
        assert [probe["x"][0], probe["y"][0]] == pytest.approx([x, y], abs=1e-12)
        for t, k in ((0.5, 0), (1.0, 1)):
            assert probe["u_x"][k] == pytest.approx(stretch * x * t, abs=1e-8)
            assert probe["u_y"][k] == pytest.approx(thinning * y * t, abs=1e-8)
    force = {name: [probe["force_x"][-1], probe["force_y"][-1]] for name, probe in found.items()}
    assert force["label5"] == pytest.approx([4, 0], abs=1e-9)
    assert force["label12"] == pytest.approx([-4, 0], abs=1e-6)
    assert force["label7"] == pytest.approx([0, 0], abs=1e-6)
    corner = {"P1": 1 / 2, "P2": 1 / 6}[element]  # of a side of the length 1/2 that is pulled by 2
    assert force["point3"] == pytest.approx([-corner, 0], abs=1e-6)
    assert force["point2"] == pytest.approx([0, 0], abs=1e-6)
    assert run.summary["probes"][0]["probe"] == "label5"


RING = """include "scene.idp"
border below(t=2., 5.) { x = t; y = 0.; label = 1; }
border outside(t=0., 1.) { x = 5.; y = t; label = 2; }
border outer(t=5., 4.) { x = t; y = 1.; label = 31; }
border inner(t=4., 2.) { x = t; y = 1.; label = 32; }
border inside(t=1., 0.) { x = 2.; y = t; label = 4; }
body = buildmesh(below(6) + outside(2) + outer(2) + inner(5) + inside(2));
macro axisymmetric() 1 //
macro young() 100. //
macro poisson() 0.25 //
macro support() on(1, u2 = 0.) //
macro load1() traction(31, 0.5, 2.) + traction(32, 0.25, -1.) //
macro probeLabels() [31, 32, 1] //
include "export.idp"
"""


@pytest.mark.parametrize("options", [{"element": "P1"}, {"element": "P2", "subdomains": 1}])
def test_labels_of_a_ring_share_the_vertex_where_their_tractions_jump(solved, scene, options):
    """Each has its traction times its own area, whatever the other one carries."""
    table = read_table(solved(scene(RING), **options).directory / "probes.csv")
    outer, inner = np.pi * (5**2 - 4**2), np.pi * (4**2 - 2**2)
    force = np.column_stack([table["force_x"], table["force_y"]])
    by = dict(zip(table["probe"].tolist(), force))
    np.testing.assert_allclose(by["label31"], [0.5 * outer, 2 * outer], rtol=1e-10)
    np.testing.assert_allclose(by["label32"], [0.25 * inner, -inner], rtol=1e-10)
    assert by["label1"][1] == pytest.approx(inner - 2 * outer, rel=1e-8)


@pytest.mark.parametrize("cut, element", [("1", "P1"), ("3", "P1"), ("4", "P2")])
@pytest.mark.some(2)
def test_forces_of_all_labels_balance(block, cut, element):
    """With contact below, on a slope: tractions, reactions and contact forces of the four labels
    add up to nothing, direction by direction; the cut does not matter. They meet in corners, where
    rollers take a part of the contact forces.
    """
    more = ("macro contact() 7 //\nmacro friction() 0.3 //\nmacro load2() pressure(31, 4.) //\n"
            "macro pointLoad3() [0., 1., 0.3, 0.2, 3., 2.6, 0.1, -0.4] //\n" + PROBES)
    _, found = block(f"balance-{cut}", cut, more, support="on(5, u1 = 0.)", rise=0.6,
                     primal_rtol=1e-9, friction_rtol=1e-9, rtol=1e-11, element=element)
    labels = [probe for name, probe in found.items() if name.startswith("label")]
    for axis in ("x", "y"):
        total = np.sum([probe[f"force_{axis}"] for probe in labels], axis=0)
        assert abs(total).max() < 1e-6
    assert found["label7"]["force_y"][-1] > 6
    # pressure 4 x 3 and half of the point load in the corner of 5 and 31
    assert found["label31"]["force_y"][-1] == pytest.approx(-12.2)


def test_supports_that_meet_in_a_corner_share_its_reaction(block):
    """The left and the lower side are clamped, the corner counts for both, in equal parts."""
    _, found = block("corner", more=PROBES, support="on(12, u2 = 0.) + on(7, u1 = 0., u2 = 0.)",
                     primal_rtol=1e-9, rtol=1e-11)
    clamped = [found[name] for name in ("label12", "label7")]
    for axis, pull in (("x", 4.0), ("y", 1.0)):
        assert sum(probe[f"force_{axis}"][-1] for probe in clamped) == pytest.approx(-pull)
        assert all(probe[f"force_{axis}"][-1] < 0 for probe in clamped)


def test_contact_and_both_sides_of_a_pair(solved, tmp_path):
    """What a pair's first label feels, the second feels with the opposite sign."""
    path = tmp_path / "two.edp"
    path.write_text("""include "scene.idp"
units("m", "Pa");
subdomains("4");
addBody(square(5, 3, [2.*x, y]))
int[int] sides = [11, 12, 13, 14];
addBody(square(4, 3, [0.3 + 1.2*x, 1. + y], label = sides))
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro displacement1() on(13, u1 = 0.01, u2 = -0.05) //
macro contactPair() 11, 3 //
macro friction() 0.5 //
macro probeLabels() [11, 3, 13, 1] //
include "export.idp"
""")
    run = solved(path)
    found = {row["probe"]: np.array([row["force_x"], row["force_y"]])
             for row in run.summary["probes"]}
    scale = np.linalg.norm(found["label13"])
    assert found["label13"][1] < 0 < found["label11"][1]
    assert abs(found["label11"] + found["label3"]).max() <= 1e-12 * scale
    assert abs(found["label11"] + found["label13"]).max() < 1e-5 * scale
    assert abs(found["label3"] + found["label1"]).max() < 1e-5 * scale
    own, = run.summary["boundaries"]
    assert [own["force_x"], own["force_y"]] == pytest.approx(found["label11"], rel=1e-12)


TOUCHING = """include "scene.idp"
units("m", "Pa");
subdomains("3");
border b(t=0, 1) { x = 0.1 + 0.8*t; y = 1.; label = 5; }
border c(t=0, 1) { x = 0.9 + 0.9*t; y = 1.; label = 7; }
border r(t=0, 1) { x = 1.8 - 0.3*t; y = 1. + 0.6*t; label = 2; }
border a(t=0, 1) { x = 1.5 - t; y = 1.6; label = 3; }
border l(t=0, 1) { x = 0.5 - 0.4*t; y = 1.6 - 0.6*t; label = 4; }
addBody(buildmesh(b(4) + c(4) + r(3) + a(5) + l(3)))
int[int] left = [11, 12, 16, 14], right = [21, 22, 26, 24];
addBody(square(4, 4, [0.9*x, y], label = left))
addBody(square(5, 4, [0.9 + 1.2*x, y], label = right))
quasistatic(1.);
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(11, u1 = 0., u2 = 0.) + on(21, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0.3, -1.) //
macro amplitude1(t) t //
macro contactPair() 5, 16, 7, 26 //
macro friction() 0.5 //
{more}
include "export.idp"
"""


def test_labels_of_pairs_that_meet_share_their_vertex(solved, named_scene):
    """A body that stands on two: each of these gives back what it takes, and the tables of
    boundaries and of probes agree.
    """
    more = "macro probeLabels() [3, 5, 7, 16, 26, 11, 21] //"
    run = solved(named_scene("two", TOUCHING.replace("{more}", more)), steps=2)
    force = {row["probe"]: np.array([row["force_x"], row["force_y"]])
             for row in run.summary["probes"]}
    scale = np.linalg.norm(force["label3"])
    for one, other in (("label16", "label11"), ("label26", "label21")):
        assert np.abs(force[one] + force[other]).max() < 1e-5 * scale
    assert np.abs(force["label5"] + force["label7"] + force["label3"]).max() < 1e-5 * scale
    for row in run.summary["boundaries"]:
        assert [row["force_x"], row["force_y"]] == pytest.approx(force[f"label{row['boundary']}"],
                                                                 rel=1e-12)


def test_second_labels_that_meet_share_what_they_get(solved, named_scene):
    """One body under both pairs, with one label each: a vertex between gives half to either."""
    one = TOUCHING.replace("{more}", "macro probeLabels() [5, 7, 16, 26, 11] //")
    one = one[:one.index("int[int] left")] + """int[int] low = [11, 12, 16, 14];
mesh lower = square(9, 4, [2.1*x, y], label = low);
addBody(change(lower, flabel = (label == 16 && x > 0.93 ? 26 : label)))
""" + one[one.index("quasistatic"):].replace(" + on(21, u1 = 0., u2 = 0.)", "")
    run = solved(named_scene("under", one), steps=2)
    force = {row["probe"]: np.array([row["force_x"], row["force_y"]])
             for row in run.summary["probes"]}
    scale = np.linalg.norm(force["label11"])
    below = force["label16"] + force["label26"]
    assert np.abs(below + force["label5"] + force["label7"]).max() < 1e-9 * scale
    assert np.abs(below + force["label11"]).max() < 1e-5 * scale
    assert force["label16"][1] < 0 and force["label26"][1] < 0


@pytest.mark.parametrize("cut", [1, 4])
@pytest.mark.parametrize("more, reason", [
    ("macro pointLoad2() [0.9, 1., 1., 0.] //\nmacro amplitude2(t) t //",
     r"pointLoad2: 3 vertices lie at \(0.9, 1\)"),
    ("macro pointSpring() [0.9, 0., 1., 1.] //", r"pointSpring: 2 vertices lie at \(0.9, 0\)")])
def test_loads_at_places_of_several_bodies_are_refused(solved, named_scene, more, reason, cut):
    """Nothing tells which of the bodies is meant, and what follows would hang on their order."""
    path = named_scene(f"several-{abs(hash(more))}", TOUCHING.replace("{more}", more))
    run = solved(path, subdomains=cut)
    assert run.status == 2 and re.search(reason, run.reason), run.reason


@pytest.mark.parametrize("cut", [1, 4, 7])
@pytest.mark.some(1)
def test_a_probe_of_several_bodies_follows_the_first_and_says_so(solved, named_scene, cut):
    """On the pair's boundary, and at the foot of the two lower bodies, whose supports meet there:
    its force is the reaction of the left one.
    """
    more = "macro probePoints() [0.7, 1., 0.9, 0., 1.5, 1.3] //\nmacro probeLabels() [5] //"
    run = solved(named_scene("first", TOUCHING.replace("{more}", more)), subdomains=cut, steps=2)
    said = [line for line in run.summary["warnings"] if line.startswith("probePoints")]
    assert [re.search(r"point\d", line)[0] for line in said] == ["point1", "point2"]
    assert "(0.7, 1) lies in several bodies" in said[0]
    upper, foot, _ = [row for row in run.summary["probes"] if row["probe"].startswith("point")]
    inside = solved(named_scene("above", TOUCHING.replace(
        "{more}", "macro probePoints() [0.7, 1.0001] //")), subdomains=cut, steps=2)
    near, = inside.summary["probes"]
    assert upper["u_y"] == pytest.approx(near["u_y"], rel=1e-2)  # strains over 1e-4
    assert 0 < foot["force_y"] < 0.5 and (foot["u_x"], foot["u_y"]) == (0, 0)


def test_a_probe_may_lie_between_subdomains_and_on_a_tie(solved, named_scene):
    """What lies in several bodies that move alike is one place."""
    tied = TOUCHING.replace("contactPair", "tie").replace("macro friction() 0.5 //", "")
    tied = tied.replace("{more}", "macro probePoints() [0.7, 1., 1.1, 1.3] //\n"
                        "macro pointLoad2() [0.45, 1., 0.1, 0.] //\nmacro amplitude2(t) t //")
    found = [solved(named_scene("tied", tied), subdomains=cut).summary["probes"]
             for cut in (3, 7)]
    for one, other in zip(*found):
        assert one["u_x"] == pytest.approx(other["u_x"], rel=1e-6) and one["u_x"] > 0


@pytest.mark.slow  # what ranks put together is in tests/feti/test_ranks.py
def test_the_number_of_ranks_does_not_matter(block):
    one, four = (block("ranks", "3", np=ranks)[0].directory / "probes.csv" for ranks in (1, 2))
    assert one.read_bytes() == four.read_bytes()


@pytest.mark.parametrize("more, reason", [
    ("macro probePoints() [9., 1.] //", "(9, 1) lies outside the body"),
    ("macro probePoints() [1., 1., 2.] //", "not 3 numbers"),
    ("macro probeLabels() [8] //", "8")])
def test_probes_that_cannot_be_meant_are_refused(block, more, reason):
    name = f"refused-{abs(hash(reason))}"
    run, _ = block(name, more=more)
    assert run.status == 2 and reason in run.reason
    assert re.match(r"\S+\.edp line \d+: probe", run.reason)


def test_places_of_a_spoiled_manifest_are_refused(built):
    manifest = built("patch", reduce=False).manifest
    for data in ({"labels": [], "points": [1.0]}, {"labels": [99], "points": []}, {},
                 {"labels": [], "points": [1.0, float("nan")]}):
        with pytest.raises(InputError):
            Effects(_with(manifest, data))


def _with(manifest, data):
    import dataclasses

    return dataclasses.replace(manifest, rooms={**manifest.rooms, "probe": data})


def test_a_scene_without_probes_pays_nothing(loaded):
    modules, out = loaded("patch")
    assert not {"driver.results.probes", "driver.effects.probe"} & modules
    assert not (out / "probes.csv").exists()
