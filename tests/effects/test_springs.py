"""Springs: beams on an elastic foundation, forces, and bodies that springs alone support."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest

from driver.effects import springs
from driver.errors import InputError
from driver.files import read_table
from driver.verify.surfaces import deflection

TIGHT = {"rtol": 1e-11, "friction_rtol": 1e-9}

HELD = "hard/springs"  # springs of all kinds and a rigid floor, no symmetry
# a block in uniform stress, turned by an angle, on a foundation below it alone
BLOCK = """include "scene.idp"
real k = 50., kx = 20., p = 8., t = 3., angle = physical("angle", 30.);
real c = cos(angle*pi/180), s = sin(angle*pi/180);
subdomains("3x2");
rectangle(0., 2., 0., 1.);
rotate(angle);
macro young() 1e3 //
macro poisson() 0. //
macro load1() traction(3, c*t + s*p, s*t - c*p) + traction(2, -s*t, c*t) + traction(4, s*t, -c*t) //
macro foundation() 1 //
macro foundationNormal() k //
macro foundationTangential() kx //
macro probeLabels() [1, 3] //
include "export.idp"
"""


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """Path of the block."""
    path = tmp_path_factory.mktemp("springs") / "block.edp"
    path.write_text(BLOCK)
    return path


def probed(run, probe: str, column: str) -> float:
    """A column of probes.csv at the end of a run."""
    table = read_table(run.directory / "probes.csv")
    return float(table[column][(table["probe"] == probe)][-1])


@pytest.mark.parametrize("options, tolerance", [
    ({"element": "P2", "h": 37.5}, 1e-3), ({"element": "P2", "h": 75, "subdomains": 7}, 1e-3),
    ({"h": 18.75}, 1.5e-2)])
@pytest.mark.some(2)
def test_rail_against_hetenyi(solved, options, tolerance):
    """With Timoshenko's correction. Near the wheel the plane rail is pressed flat as well, by about
    P/E; 1 m away beams differ by some (height / wave length)^2 of what shear adds, 1e-4 of the
    largest deflection. Linear triangles lock by (h / height)^2, 1.5 %.
    """
    run = solved("rail", **options)
    with open(run.directory / "boundary.csv") as file:
        roles = {row["label"]: row["role"] for row in csv.DictReader(file)}
    assert roles == {"1": "springs", "2": "free", "3": "free", "4": "free", "5": "load"}
    k, P, d, E = 0.7, 100.0, 150.0, 210e3
    EI, GA = E * d**3 / 12, 10 * 1.3 / (12 + 11 * 0.3) * E / 2.6 * d
    slender, beam = (deflection(0.0, k, EI, stiff, P, 100.0) for stiff in (np.inf, GA))
    b = (k / 4 / EI) ** 0.25
    assert slender == pytest.approx(P * b / 2 / k, rel=2e-3)  # 100 mm are nearly a point
    assert beam / slender - 1 < 0.05  # shear is a small part
    down = -probed(run, "point1", "u_y")
    assert down == pytest.approx(beam, abs=P / E + tolerance * beam)
    away = deflection(1000.0, k, EI, GA, P, 100.0)
    assert -probed(run, "point2", "u_y") == pytest.approx(away, abs=tolerance * beam)
    assert probed(run, "label1", "force_y") == pytest.approx(P, rel=1e-8)
    reaction = run.history["reaction_y"][-1]
    assert reaction == pytest.approx(P, rel=1e-8) and run.summary["effects"]["springs"]


@pytest.mark.parametrize("options", [{}, {"element": "P2"}, {"element": "P2-mixed"},
                                     {"angle": 0}, {"subdomains": 7, "angle": -71}])
@pytest.mark.some(3)
def test_block_in_uniform_stress(solved, block, options):
    """u = (t/kx + t y/G, -p/k - p y/E) in its own axes: polynomials that all elements have."""
    run = solved(block, cells=3, **TIGHT, **options)
    angle = np.radians(options.get("angle", 30.0))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for label, y in ((1, 0.0), (3, 1.0)):
        u = [probed(run, f"label{label}", f"u_{c}") for c in "xy"]
        np.testing.assert_allclose(turn.T @ u, [3 / 20 + 3 * y / 500, -8 / 50 - 8 * y / 1e3],
                                   rtol=1e-9)
    force = [probed(run, "label1", f"force_{c}") for c in "xy"]
    np.testing.assert_allclose(turn.T @ force, [-6.0, 16.0], rtol=1e-9)


@pytest.mark.parametrize("element, stiffness", [("P1", 1e9), ("P2", 1e3)])
@pytest.mark.some(1)
def test_forces_balance_and_cuts_do_not_matter(solved, element, stiffness):
    """Of a body that springs alone support, in contact with friction; by label they add up."""
    runs = [solved(HELD, steps=3, element=element, stiffness=stiffness, **TIGHT, **cut)
            for cut in ({}, {"subdomains": 5}, {"subdomains": 11})]
    for run in runs:
        assert run.summary["balance"] < 1e-12
        # labels hold all springs, contact and loads
        total = sum(probed(run, f"label{k}", "force_y") for k in (3, 7, 12, 15))
        assert abs(total) < 1e-9 * 60
    first = runs[0].contact
    for run in runs[1:]:
        for name in ("sigma_n", "sigma_t", "u_t"):
            size = np.abs(first[name]).max()
            order = np.lexsort((run.contact["y"][0], run.contact["x"][0]))
            mine = np.lexsort((first["y"][0], first["x"][0]))
            np.testing.assert_allclose(run.contact[name][:, order], first[name][:, mine],
                                       atol=1e-5 * size)


@pytest.mark.slow
@pytest.mark.parametrize("element", ["P1", "P2"])
def test_round_block_on_a_foundation(solved, tmp_path, element):
    """Of revolution: u_y = -p/k - p y/E, and the force p pi R^2 on the ring-shaped foundation."""
    text = BLOCK.replace("rotate(angle);", "macro axisymmetric() 1 //")
    start = text.index("macro load1")
    text = text[:start] + "macro load1() pressure(3, p) //\n" + text[text.index("macro found"):]
    (tmp_path / "round.edp").write_text(text.replace("macro foundationTangential() kx //\n", ""))
    run = solved(tmp_path / "round.edp", cells=3, element=element, **TIGHT)
    for label, y in ((1, 0.0), (3, 1.0)):
        assert probed(run, f"label{label}", "u_y") == pytest.approx(-8 / 50 - 8 * y / 1e3,
                                                                    rel=1e-9)
    assert probed(run, "label1", "force_y") == pytest.approx(8 * np.pi * 4, rel=1e-9)


@pytest.mark.slow  # springs are in the matrices of subdomains, whose ranks test_model shows
def test_ranks_leave_the_same_bits(solved):
    one, two = (solved(HELD, steps=2, subdomains=5, np=n) for n in (1, 2))
    for name, values in one.contact.items():
        np.testing.assert_array_equal(values, two.contact[name])


def test_what_springs_leave_free_is_free(solved, tmp_path):
    """Normal springs below hold no motion along: refused, like a missing support."""
    text = BLOCK.replace("macro foundationTangential() kx //\n", "")
    (tmp_path / "loose.edp").write_text(text)
    run = solved(tmp_path / "loose.edp", cells=2)
    assert run.status == 3 and "no equilibrium" in run.reason


@pytest.mark.parametrize("old, new, reason", [
    ("foundationNormal() k", "foundationNormal() (x - 1.)", "foundationNormal is negative"),
    ("foundationTangential() kx", "foundationTangential() (-kx)",
     "foundationTangential is negative"),
    ("foundation() 1", "foundation() 9", "no boundary with label 9"),
    ("foundation() 1", "foundation() 1, 1", "label 1 twice"),
    ("macro foundation() 1 //", "macro pointSpring() [0., 0., 1., -1.] //",
     "without foundation"),
    ("macro foundation() 1 //", "macro foundation() 1 //\n"
     "macro pointSpring() [0., 0., 1., -1.] //", "pointSpring has a negative stiffness")])
def test_misuse_is_refused_in_one_line(solved, tmp_path, old, new, reason):
    assert old in BLOCK
    (tmp_path / "misused.edp").write_text(BLOCK.replace(old, new))
    run = solved(tmp_path / "misused.edp", cells=2)
    assert run.status == 2 and reason in run.reason


def test_where_its_stiffness_is_zero_a_foundation_is_none(solved, tmp_path):
    """Edges of its label are then free in boundary.csv, and in the picture of the geometry."""
    text = BLOCK.replace("() k //", "() (x < 0.6 ? k : 0.) //").replace(
        "() kx //", "() (x < 0.6 ? kx : 0.) //")
    (tmp_path / "half.edp").write_text(text)
    run = solved(tmp_path / "half.edp", cells=1, angle=0)  # edges of 2/3
    with open(run.directory / "boundary.csv") as file:
        roles = [(float(row["x0"]) < 0.6, row["role"]) for row in csv.DictReader(file)
                 if row["label"] == "1"]
    assert sorted(roles) == [(False, "free"), (False, "free"), (True, "springs")]


@pytest.mark.parametrize("sprung", [11, 21])
def test_springs_hold_back_their_own_body_alone(built, named_scene, sprung):
    """Both bodies are carried by (0.3, -0.2); the travel of that on springs is no rigid motion."""
    problem = built(scene=named_scene(f"carried{sprung}", f"""include "scene.idp"
subdomains("3");
int[int] one = [11, 12, 13, 14], two = [21, 22, 23, 24];
addBody(square(3, 3, [x, y], label = one))
addBody(square(2, 3, [2 + x, y], label = two))
macro young() 1e3 //
macro poisson() 0.3 //
macro foundation() {sprung} //
macro foundationNormal() 5. //
macro displacement1() on(13, 23, u1 = 0.3, u2 = -0.2) //
include "export.idp"
"""))
    motion = problem.structure.travel.motion[0]
    own = 0 if sprung == 11 else 1
    assert motion[own].tolist() == [0, 0, 0]
    np.testing.assert_allclose(motion[1 - own], [0.3, -0.2, 0], rtol=1e-15)


@pytest.mark.parametrize("cut", [1, 3, 8])
def test_springs_at_all_vertices_carry_alike(solved, tmp_path, cut):
    """A stiff block on nine springs of stiffness 2 sinks by a ninth of half its load, any cut."""
    points = ", ".join(f"{x / 2}, {y / 2}, 2., 2." for x in range(3) for y in range(3))
    path = tmp_path / "mattress.edp"
    path.write_text(f"""include "scene.idp"
body = square(2, 2);
macro young() 1e9 //
macro poisson() 0.3 //
macro pointSpring() [{points}] //
macro load1() traction(3, 0., -1.) //
macro probePoints() [0., 0., 1., 0., 0.5, 1.] //
include "export.idp"
""")
    run = solved(path, subdomains=cut, **TIGHT)
    for point in ("point1", "point2", "point3"):
        assert probed(run, point, "u_y") == pytest.approx(-1 / 18, rel=1e-6)
        assert abs(probed(run, point, "u_x")) < 1e-7


@pytest.mark.parametrize("k, known", [(1000, False), (1e-4, True)])
@pytest.mark.some(1)
def test_a_spring_at_a_point_has_no_limit_where_it_matters(solved, named_scene, k, known):
    """A body that nothing else holds along its floor gives way at the point like log h: no error
    is claimed of what follows from it; a spring that is soft beside the body's log is no matter.
    """
    path = named_scene("held", """include "scene.idp"
real k = physical("k", 1.);
real h = meshSize(0.25);
units("mm", "MPa");
int n = rint(1./h);
body = square(2*n, n, [2.*x, y]);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(1, u2 = 0.) //
macro load1() traction(2, 1., 0.) //
macro pointSpring() [0., 1., k, 0.] //
include "export.idp"
""")
    entry = solved(path, k=k, errors="yes").summary["errors"]["quantities"]["displacement"]
    assert (entry["total"] is not None) == known


def test_a_manifest_that_does_not_say_where_springs_are_is_refused():
    manifest = SimpleNamespace(rooms={"springs": {"labels": []}}, patterns=[], labels=[1])
    with pytest.raises(InputError, match="does not say where springs are"):
        springs.Room("springs", manifest)
