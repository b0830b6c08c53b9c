"""What every contact boundary carries: statics of bodies that stand on one another, sums of nodal
forces, and that two flanks of a groove do not cancel.
"""

import json

import numpy as np
import pytest

from driver.files import read_table
from driver.results import screen, tables
from driver.results.quantities import resultant

DOVETAIL = """include "scene.idp"
units("mm", "MPa");
subdomains("3");
// a wedge-shaped tenon, pulled upward against two flanks at 45 degrees
border right(t = 0, 1) { x = 10 - 6*t; y = 6*t; label = 21; }
border top(t = 0, 1) { x = 4 - 8*t; y = 6; label = 30; }
border left(t = 0, 1) { x = -4 - 6*t; y = 6 - 6*t; label = 9; }
border bottom(t = 0, 1) { x = -10 + 20*t; y = 0; label = 4; }
body = buildmesh(right(6) + top(6) + left(6) + bottom(14));
quasistatic(1.);
macro young() 1e3 //
macro poisson() 0.3 //
macro load1() traction(30, 0., 10.) //
macro amplitude1(t) t //
macro contact() 9, 21 //
macro friction() 0.2 //
include "export.idp"
"""


def columns(run) -> dict:
    """Columns (steps, boundaries) of boundaries.csv."""
    table = read_table(run.directory / "boundaries.csv")
    return {name: column.reshape(run.summary["steps"], -1) for name, column in table.items()}


@pytest.fixture(scope="module")
def tenon(solved, tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "tenon.edp"
    path.write_text(DOVETAIL)
    return solved(path, steps=4)


def test_the_flanks_of_a_groove_share_the_pull_and_do_not_cancel(tenon):
    """Statics: together they push down by the pull 8 x 10, sideways not at all; as the tenon slips
    upward along both flanks, shear is F times pressure on each, of opposite sign.
    """
    table, summary = columns(tenon), tenon.summary
    assert np.array_equal(table["boundary"][-1], [9, 21])
    pull = 80 * table["time"]
    assert table["force_y"].sum(axis=1) == pytest.approx(-pull[:, 0], rel=1e-6)
    assert abs(table["force_x"].sum(axis=1)).max() < 1e-6 * pull.max()
    normal, shear = table["normal_resultant"][-1], table["tangential_resultant"][-1]
    assert shear[0] * shear[1] < 0
    found = summary["quantities"]
    assert found["tangential_resultant"] == pytest.approx(abs(shear).sum(), rel=1e-12)
    assert found["normal_resultant"] == pytest.approx(normal.sum(), rel=1e-12)
    last = tenon.history
    assert last["resultant_t"][-1] == pytest.approx(abs(shear).sum(), rel=1e-12)
    assert last["resultant_n"][-1] == pytest.approx(-normal.sum(), rel=1e-12)


def test_forces_are_sums_over_the_nodes_of_the_boundary(tenon):
    table, nodes = columns(tenon), tenon.contact
    for k, label in enumerate((9, 21)):
        own = nodes["boundary"][0] == label
        c = {name: column[:, own] for name, column in nodes.items() if name != "status"}
        for axis, tangent in (("x", -c["normal_y"]), ("y", c["normal_x"])):
            nodal = c["weight"] * (c["sigma_n"] * c[f"normal_{axis}"] + c["sigma_t"] * tangent)
            assert table[f"force_{axis}"][:, k] == pytest.approx(nodal.sum(axis=1), rel=1e-10)
        # proportional loading: zones do not change, bounds grow by the trapezoid that is exact
        bound = np.vstack([0 * c["bound"][:1], c["bound"]])
        mean = np.where(nodes["status"][:, own] == "slip", bound[1:] + bound[:-1], 0) / 2
        work = (c["weight"] * mean * np.abs(c["slip"])).sum(axis=1).cumsum()
        assert table["dissipated_energy"][:, k] == pytest.approx(work, rel=1e-5)
    found = tenon.summary["quantities"]
    for name, merge in (("peak_pressure", max), ("slip", max), ("contact_length", sum),
                        ("dissipated_energy", sum)):
        assert found[name] == pytest.approx(merge(table[name][-1]), rel=1e-12)


def test_blocks_carry_what_stands_on_them(solved):
    """Force on the block that carries the contact nodes: the weight above, minus the push."""
    run = solved("stack", steps=4)
    table, weights = columns(run), 2400 * 9.81 * 0.5 * np.array([1.2, 1.0, 0.8])
    above = weights[::-1].cumsum()[::-1]
    push = run.history["load_x"]
    assert np.array_equal(table["boundary"][0], [11, 21, 31])
    assert -run.history["load_y"] == pytest.approx(weights.sum(), rel=1e-9)
    assert table["force_y"] == pytest.approx(np.tile(above, (4, 1)), rel=1e-5)
    for k in range(3):  # within the tolerance of the multipliers, relative to the weight
        assert abs(table["force_x"][:, k] + push).max() < 1e-5 * above[0]


def test_the_summary_has_the_rows_of_the_last_step(tenon):
    table = columns(tenon)
    rows = json.loads((tenon.directory / "summary.json").read_text())["boundaries"]
    assert [row["boundary"] for row in rows] == [9, 21] and rows[0]["step"] == 4
    for name in (column.name for column in tables.BOUNDARIES):
        assert [row[name] for row in rows] == table[name][-1].tolist()


def test_a_frictionless_boundary_has_a_way_and_no_shear(solved):
    found = columns(solved("wedge", friction=0, without="friction", steps=2))
    assert not found["tangential_resultant"].any() and not found["dissipated_energy"].any()
    assert (np.diff(found["slip"][:, 0]) > 0).all() and found["slip"][0] > 0


def test_a_scene_without_contact_has_no_boundaries(solved):
    run = solved("cantilever", cells=4)
    assert not (run.directory / "boundaries.csv").exists() and "boundaries" not in run.summary


def test_resultants_of_one_boundary_have_a_sign_and_of_several_a_size():
    forces = np.array([[1.0, 2.0, -5.0], [3.0, 0.0, -1.0]])
    weight = np.ones(3)
    assert resultant(np.ones((1, 3)), forces, weight).tolist() == [-2, 2]
    assert resultant(np.array([[1.0, 1, 0], [0, 0, 1]]), forces, weight).tolist() == [8, 4]
    assert resultant(np.array([[1.0, 0.5, 0], [0, 0.5, 1]]), forces, weight).tolist() == [6, 4]
    assert resultant(np.empty((0, 0)), np.empty(0), np.empty(0)) == 0


FLOOR = """include "scene.idp"
units("m", "Pa");
subdomains("{cut}");
// three labels on a straight floor, the middle one a single edge
border first(t = 0, 1) {{ x = 1.2*t; y = 0; label = 8; }}
border second(t = 0, 1) {{ x = 1.2 + 0.2*t; y = 0; label = 5; }}
border third(t = 0, 1) {{ x = 1.4 + 0.6*t; y = 0; label = {last}; }}
border right(t = 0, 1) {{ x = 2; y = t; label = 2; }}
border top(t = 0, 1) {{ x = 2 - 2*t; y = 1; label = 3; }}
border left(t = 0, 1) {{ x = 0; y = 1 - t; label = 4; }}
body = buildmesh(first(6) + second(1) + third(3) + right(5) + top(10) + left(5));
macro young() 1e3 //
macro poisson() 0. //
macro support() on(4, u1 = 0.) //
macro load1() traction(3, 0., -2.) //
macro contact() 8, 5, {last} //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.parametrize("element, cut", [("P1", 1), ("P1", 4), ("P2", 3)])
@pytest.mark.some(2)
def test_labels_that_go_on_in_one_another_share_their_nodes(solved, tmp_path, element, cut):
    """Under uniform pressure 2 without Poisson's effect each label carries 2 x its length, however
    short it is: a node between two labels counts for both by its dual segment. The ends of an open
    chain of linear elements have half a segment, which the uniform pressure does not notice.
    """
    path = tmp_path / "floor.edp"
    path.write_text(FLOOR.format(cut=cut, last=7))
    run = solved(path, element=element, rtol=1e-12, primal_rtol=1e-9, friction_rtol=1e-9)
    table = columns(run)
    assert np.array_equal(table["boundary"][-1], [5, 7, 8])
    lengths = np.array([0.2, 0.6, 1.2])
    assert table["normal_resultant"][-1] == pytest.approx(2 * lengths, rel=1e-6)
    assert table["force_y"][-1] == pytest.approx(2 * lengths, rel=1e-6)
    assert table["contact_length"][-1] == pytest.approx(lengths, rel=1e-9)
    assert table["peak_pressure"][-1] == pytest.approx([2, 2, 2], rel=1e-5)
    assert run.summary["quantities"]["normal_resultant"] == pytest.approx(4, rel=1e-6)


def test_the_screen_has_a_line_a_boundary_and_units_of_engineers(tenon):
    head, *lines = screen.boundaries(tenon.summary["boundaries"], tenon.summary["units"])
    assert [line.split()[0] for line in lines] == ["9", "21"]
    assert "force x [N/mm]" in head and "dissipated [J/m]" in head
    assert screen.boundaries([], tenon.summary["units"]) == []


PIECES = """include "scene.idp"
border b1(s = 0, 10) { x = s; y = 0; label = 5; }
border b2(s = 10, 30) { x = s; y = 0; label = 1; }
border b3(s = 30, 40) { x = s; y = 0; label = 5; }
border r(s = 0, 20) { x = 40; y = s; label = 2; }
border t(s = 40, 0) { x = s; y = 20; label = 3; }
border l(s = 20, 0) { x = 0; y = s; label = 4; }
body = buildmesh(b1(4) + b2(6) + b3(4) + r(5) + t(8) + l(5));
macro young() 210e3 //
macro poisson() 0.3 //
macro contact() 1, 5 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro gap() -0.01 //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_label_on_both_sides_of_another_one_has_its_own_length(scene, solved, element):
    """What lies between its pieces is the other one's."""
    run = solved(scene(PIECES), ELEMENT=element)
    assert columns(run)["contact_length"][-1] == pytest.approx([20, 20], rel=1e-9)


HANGING = """include "scene.idp"
int[int] above = [5, 6, 7, 8];
addBody(square({below}, 4, [3.*x, y - 1.]))
addBody(square({above}, 4, [{start} + {long}*x, y], label = above))
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) + on(7, u1 = 0.) //
macro displacement1() on(7, u2 = -0.01) //
macro contactPair() 5, 3 //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("start, long, length", [(-0.37, 2.0, 1.63), (1.21, 3.0, 1.79),
                                                 (-0.41, 4.0, 3.0), (0.5, 2.0, 2.0)],
                         ids=["left", "right", "both", "none"])
@pytest.mark.some(2)
def test_what_hangs_over_is_not_in_contact(scene, solved, element, start, long, length):
    """Of edges that the other body ends under, the part that faces it."""
    run = solved(scene(HANGING.format(start=start, long=long, below=11, above=9)), ELEMENT=element)
    assert columns(run)["contact_length"][-1] == pytest.approx([length], rel=1e-9)
    assert run.summary["quantities"]["contact_length"] == pytest.approx(length, rel=1e-9)


PARTLY = """include "scene.idp"
subdomains("3");
rectangle(0., 2., 0., 1.);
{more}
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0.5, (x > 0.7 && x < 1.3 ? -4. : 0.)) + pressure(2, 2. + y) //
macro load2() pressure(2, 1.) //
include "export.idp"
"""


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("more", ["", "macro axisymmetric() 1 //"], ids=["plane", "revolved"])
@pytest.mark.some(2)
def test_tractions_of_the_outline_are_those_of_each_edge(scene, solved, element, more):
    """Of all loads, at amplitude one; where a label is loaded in part the rest is not."""
    run = solved(scene(PARTLY.format(more=more)), ELEMENT=element, cells=8)
    table = read_table(run.directory / "boundary.csv")
    x, y, label, px, py = (np.array(table[name], float) for name in (
        "x0", "y0", "label", "traction_x", "traction_y"))
    x, y = ((one + np.array(table[name], float)) / 2 for one, name in ((x, "x1"), (y, "y1")))
    top, right = label == 3, label == 2
    # quadratic elements: by the middles' forces, which weigh what varies on an edge
    accuracy = 1e-9 if element == "P1" and not more else 2e-2
    np.testing.assert_allclose(px[top], 0.5, rtol=accuracy)
    loaded = np.abs(x[top] - 1) < 0.3
    np.testing.assert_allclose(py[top], np.where(loaded, -4.0, 0.0), rtol=accuracy, atol=1e-9)
    np.testing.assert_allclose(px[right], -(3 + y[right]), rtol=accuracy)
    assert not px[~top & ~right].any() and not py[~top].any()
    assert set(np.array(table["role"])[top]) == {"load"}
