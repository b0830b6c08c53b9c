"""Parameter studies: the condensed compliance, agreement with single runs, what a study refuses."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import load_response
from mpi4py import MPI
from scipy.sparse import csr_matrix

from driver import cli
from driver.cli import parse_pairs
from driver.errors import DriverError, InputError, NotConverged
from driver.feti import compliance
from driver.feti.compliance import ContactCompliance
from driver.feti.rows import RowKind, contact_row_numbers
from driver.files import read_rows
from driver.scene import freefem
from driver.scene.script import changed_by
from driver.scene.study_value import Loads, Value, read_value
from driver.studies import parametric, study, value_chains
from driver.studies.load_values import LoadValues

# The projected gradient to 1e-11 |d| leaves multipliers good to cond(F) = 3e3 times that, the fixed
# point to 1e-10 / (1 - q) with a contraction q < 0.9 (contraction.csv of the model): together below
# 1e-6 of the largest traction.
TIGHT = {"rtol": "1e-11", "friction_rtol": "1e-10"}
CLOSE = 1e-6


@pytest.fixture
def made(tmp_path):
    """made(NAME=value, ...): summary and rows of the files of a study, by file name."""

    def make(**options):
        pairs = {"out": str(tmp_path / "study"), "figures": "no", "quiet": "yes", **TIGHT,
                 **options}
        summary, folder = study.make_study(pairs)
        return summary, {path.stem: read_rows(path) for path in folder.glob("*.csv")}

    return make


def tractions(rows: list[dict], **where) -> np.ndarray:
    """(nodes, 2) sigma_n, sigma_t of the rows with the given values."""
    return np.array([[float(row["sigma_n"]), float(row["sigma_t"])] for row in rows
                     if all(row[name] == value for name, value in where.items())])


def compare(rows: list[dict], single, **where) -> None:
    """Tractions of one value against the last step of a single run."""
    ours = tractions(rows, **where)
    theirs = np.column_stack([single.contact[name][-1] for name in ("sigma_n", "sigma_t")])
    assert np.abs(ours - theirs).max() <= CLOSE * np.abs(theirs).max()


@pytest.mark.parametrize("scene, options", [
    ("model", {"subdomains": "4x2", "cells": 4}),
    ("model", {"subdomains": "4x2", "cells": 3, "element": "P2"}),
    ("bracket", {}),  # graph partition, more than WIDTH contact rows
    ("stack", {}),    # three bodies, two of which contact alone holds
])
def test_compliance_is_schur_complement_of_dual_matrix(built, scene, options):
    problem = built(scene, **options)
    F, gluing = problem.F, problem.structure.row_kind == RowKind.GLUING
    contact = contact_row_numbers(problem.structure.contact)
    condensed = ContactCompliance(problem.operator)
    solved = np.linalg.solve(F[gluing][:, gluing], F[gluing][:, contact])
    schur = F[contact][:, contact] - F[contact][:, gluing] @ solved
    # rounding, times a condition number of F_gg of less than 1e3 in these bodies; their springs add
    # a factor of 1e3
    assert np.abs(condensed.C - schur).max() <= 1e-10 * np.abs(schur).max()
    weights = np.linspace(1.0, 2.0, problem.structure.patterns)
    d = load_response(problem.operator, weights)
    reduced = d[contact] - F[contact][:, gluing] @ np.linalg.solve(F[gluing][:, gluing], d[gluing])
    error = np.abs(load_response(condensed, weights) - reduced).max()
    assert error <= 1e-10 * np.abs(reduced).max()
    numbers = contact_row_numbers(condensed.structure.contact)
    assert np.array_equal(numbers, np.arange(len(contact))) and len(contact) == (~gluing).sum()
    for name in ("row_kind", "row_scale"):
        assert np.array_equal(getattr(condensed.structure, name),
                              getattr(problem.structure, name)[contact])


def test_an_elimination_that_leaves_a_residual_is_refused():
    """Gluing rows that contradict one another: the same row twice."""
    factor = compliance._Factor(csr_matrix([[2.0, 2.0], [0.0, 2.0]]))
    assert factor.solve(np.array([[1.0], [1.0]])).sum() == pytest.approx(0.5)
    with pytest.raises(NotConverged, match="could not be eliminated"):
        factor.solve(np.array([[1.0], [0.0]]))


def test_condensed_deformation(built):
    """Corners move as in the whole problem, contact nodes by contact forces as without loads."""
    problem = built(subdomains="4x2", cells=4)
    F, gluing = problem.F, problem.structure.row_kind == RowKind.GLUING
    condensed, weights = ContactCompliance(problem.operator), np.ones(1)
    whole, loads = np.random.default_rng(8).standard_normal(len(gluing)), []
    contact = contact_row_numbers(problem.structure.contact)
    for d in (load_response(problem.operator, weights), np.zeros(len(gluing))):
        right = d[gluing] - F[gluing][:, ~gluing] @ whole[~gluing]
        whole[gluing] = np.linalg.solve(F[gluing][:, gluing], right)
        loads.append(whole.copy())
    corners = np.abs(problem.operator.coarse_displacements(loads[0], weights)).max()
    nodes = np.abs((F @ loads[1])[contact]).max()
    assert condensed.deformation(whole[contact], weights) == pytest.approx(
        max(corners, nodes), rel=1e-8)
    assert condensed.deformation(0 * whole[contact], weights) == pytest.approx(np.abs(
        weights @ condensed._loaded).max(), rel=1e-12)


def test_friction_values_agree_with_single_runs(made, solved):
    values = ("0.1", "0.3", "0.7")
    summary, files = made(scene="model", loading="nonmonotone",
                          friction=",".join(values), steps="6")
    assert summary["condensed"] and summary["converged"] and len(files["history"]) == 3 * 6
    for value, row in zip(values, files["study"]):
        single = solved(loading="nonmonotone", friction=value, steps=6, **TIGHT)
        compare(files["contact"], single, friction=value)
        assert float(row["dissipated"]) == pytest.approx(single.summary["dissipated"], rel=1e-5)
        for name in ("peak_pressure", "contact_length"):
            assert float(row[name]) == pytest.approx(single.summary["quantities"][name], rel=1e-5)
        assert [int(row[f"nodes_{s}"]) for s in ("open", "stick", "slip")] == [
            int(single.history[f"nodes_{s}"][-1]) for s in ("open", "stick", "slip")]


@pytest.mark.parametrize("loading", ["monotone", "nonmonotone"])
@pytest.mark.slow
def test_values_depend_neither_on_their_order_nor_on_newton(made, monkeypatch, loading):
    """Forth and back, in chains of three that start elsewhere, and by successive approximations
    alone."""
    monkeypatch.setattr(value_chains, "LONGEST", 3)
    monkeypatch.setattr(value_chains, "FEWEST", 1)
    values = ["0.1", "0.12", "0.14", "0.16", "0.18", "0.9", "0.92", "1.2"]
    of = dict(scene="model", loading=loading, steps="6", uniqueness="no")
    forth, back, plain = (made(friction=",".join(order), **of, **more)[1] for order, more in (
        (values, {}), (values[::-1], {}), (values, {"corrector": "none"})))
    # where every step ends in Newton's method the same systems are solved: rounding, times a
    # condition number of 3e3
    for other, close in ((back, 1e-11 if loading == "monotone" else CLOSE), (plain, CLOSE)):
        for value in values:
            ours, theirs = (tractions(files["contact"], friction=value) for files in (forth, other))
            assert np.abs(ours - theirs).max() <= close * np.abs(theirs).max()
    assert len({(row["nodes_open"], row["nodes_stick"])
               for row in forth["study"]}) > 4  # they are not all alike
    iterations = [sum(int(row["fixed_point_iterations"]) for row in files["study"])
                  for files in (forth, plain)]
    assert 2 * iterations[0] < iterations[1] or loading == "nonmonotone"


def test_a_step_in_known_states_takes_one_iteration_and_two_products(made):
    """Monotone loads grow in proportion: from the second step on Newton's method is there at
    once."""
    _, files = made(scene="model", friction="0.3,0.31", steps="5")
    later = [row for row in files["history"] if row["step"] != "1"]
    assert {(row["fixed_point_iterations"], row["dual_multiplications"])
            for row in later} == {("1", "2")}


@pytest.mark.slow
def test_values_beyond_uniqueness_are_reported(made):
    """The model example at one step, which has three solutions from F = 5.45 on and one at 0.3."""
    summary, files = made(scene="model", friction="0.3,5.6", steps="1",
                          subdomains="4x2", uniqueness="yes")
    assert [row["uniqueness"] for row in files["study"]] == [
        "no second solution found", "not unique"]
    assert any(line.startswith("FRICTION=5.6: step 1: the solution is not unique")
               for line in summary["warnings"])
    assert not any("FRICTION=0.3" in line for line in summary["warnings"])
    assert "warning: FRICTION=5.6" in study.describe(summary, Path("out"))


def test_slip_that_rows_do_not_tell_is_not_left_wrong_without_a_word(made, named_scene):
    """A support holds the end of a slanted boundary in one direction; of a straight one all."""
    held = RUBBED.replace("on(3, u1", "on(4, u1")
    slanted = held.replace("4.*y]", "4.*y + 2.*x]")
    words = "a support holds 1 contact node of a slanted boundary in one direction"
    for text, said in ((held, False), (slanted, True)):
        summary, _ = made(scene=str(named_scene(f"slanted-{said}", text)), friction="0.2,0.3",
                          steps="2")
        assert any(words in line for line in summary["warnings"]) == said


def test_slip_without_friction_is_not_told_as_zero(made):
    """The foundation's model example slides where it is pressed; its rows are normal ones alone."""
    _, files = made(scene="model-frictionless", loading="monotone,nonmonotone", steps="2",
                    cells="2", subdomains="2x1")
    told = [*(float(row[name]) for row in files["contact"] for name in ("u_t", "slip")),
            *(float(row["largest_slip"]) for name in ("study", "history") for row in files[name])]
    assert np.isnan(told).all() and tractions(files["contact"]).any()
    assert all(float(row["dissipated"]) == 0 for row in files["study"])


FREE = """include "scene.idp"
real F = physical("friction", 0.3);
subdomains("2x2");
rectangle(0., 2., 0., 1.);
quasistatic(1.);
bodyMaterial("pad", 1000., 0.3);
macro contact() 1 //
macro friction() F //
macro load1() traction(3, 0.5, -10.) //
include "export.idp"
"""


def test_ranks_take_values_of_their_own_of_small_bodies_that_are_not_condensed(
        made, named_scene, capfd):
    """Together they took four times as long as one alone; zero slip had two signs."""
    values = {"scene": str(named_scene("free", FREE)), "friction": "0.1,0.3", "steps": "1",
              "cells": "3"}
    _, one = made(**values)
    capfd.readouterr()
    summary, two = made(**values, np="2", quiet="no")
    assert not summary["condensed"] and summary["ranks"] == 2 and one == two
    assert "1 of 1, as other ranks do" in capfd.readouterr().out


@pytest.mark.slow  # two studies
def test_loadings_and_steps(made, solved):
    _, files = made(scene="model", loading="monotone,nonmonotone", steps="4")
    for loading in ("monotone", "nonmonotone"):
        compare(files["contact"], solved(loading=loading, steps=4, **TIGHT), loading=loading)
    _, files = made(scene="model", loading="nonmonotone", steps="2,4")
    compare(files["contact"], solved(loading="nonmonotone", steps=4, **TIGHT), steps="4")


# loads of every kind that a parameter can reach: edges, triangles, points, supports
LOADED = (("macro amplitude1(t)", """real size = physical("size", 1.);
macro bodyForce1() [0., -size*1e6*x] //
macro displacement2() on(2, u2 = -size*1e-4*y) //
macro amplitude1(t)"""), ("traction(2, 3e7, 5e7)", "traction(2, size*3e7*y, 0.)"))


@pytest.mark.parametrize("options", [{"cells": "3"}, {"cells": "2", "element": "P2",
                                                       "subdomains": "5"}])
@pytest.mark.some(1)
def test_loads_and_prescribed_displacements_agree_with_single_runs(made, solved, variant, options):
    """Each kind on the pieces of a rectangle and on a graph partition; values that only multiply
    patterns, as well as values that shift them."""
    path = str(variant("loaded", *LOADED))
    summary, files = made(scene=path, size="0.5,-1,2", steps="2", **options)
    assert summary["converged"]
    for size in ("0.5", "2"):
        single = solved(path, size=size, steps=2, **options, **TIGHT)
        compare(files["contact"], single, size=size)
    forces = [float(row["resultant_n"]) for row in files["study"]]
    assert len({round(force / forces[0], 3) for force in forces}) == 3


def test_an_initial_stress_agrees_with_a_single_run(made, solved):
    """The bar that closes its gap at rise 50 presses in proportion to what remains of it."""
    _, files = made(scene="thermal", rise="60,100,140", steps="2")
    low, middle, high = (float(row["resultant_n"]) for row in files["study"])
    assert high - middle == pytest.approx(middle - low, rel=1e-6)
    compare(files["contact"], solved("thermal", rise=140, steps=2, **TIGHT), rise="140")


@pytest.mark.slow
def test_travel_of_bodies_without_support_is_studied_on_any_number_of_ranks(made, solved):
    """The wedge's stroke moves a body as a whole; bodies without support are not condensed."""
    values = dict(scene="wedge", stroke="0.02,0.08", h="8", steps="2")
    summary, files = made(**values)
    assert not summary["condensed"] and files == made(**values, np="2")[1]
    compare(files["contact"], solved("wedge", stroke=0.08, h=8, steps=2, **TIGHT), stroke="0.08")

@pytest.mark.parametrize("axisymmetric, gap", [
    ("", "d*(1. + x)"), ("macro axisymmetric() 1 //", "d")])
@pytest.mark.slow
def test_gaps_between_bodies_vary(made, solved, tmp_path, axisymmetric, gap):
    """What pairGap adds to the geometry; and contact of a body of revolution without its loads."""
    path = tmp_path / "apart.edp"
    path.write_text(f"""include "scene.idp"
real d = physical("d", 0.002), F = physical("friction", 0.3);
int[int] lower = [11, 12, 13, 14];
addBody(square(4, 4))
addBody(square(5, 4, [x, y - 1], label = lower))
{axisymmetric}
macro young() 1000. //
macro poisson() 0.3 //
macro contactPair() 1, 13 //
macro pairGap() {gap} //
macro friction() F //
macro support() on(11, u2 = 0.) + on(14, u1 = 0.) //
macro displacement1() on(3, {"" if axisymmetric else "u1 = 0.002, "}u2 = -0.02) //
include "export.idp"
""")
    for parameter, values in (("d", "0.002,-0.004"), ("friction", "0.3,0.1")):
        _, files = made(scene=str(path), subdomains="3", **{parameter: values})
        for value in values.split(","):
            single = solved(path, subdomains=3, **{parameter: value}, **TIGHT)
            compare(files["contact"], single, **{parameter: value})


@pytest.mark.parametrize("more", ["", pytest.param("macro largeSliding() 0.2 //\n",
                                                  marks=pytest.mark.slow)])  # seconds
def test_values_where_contact_goes_on_across_a_period(made, tmp_path, more):
    """A wave whose crest is at both ends of the period or within, on one mesh: the same numbers in
    all steps, also of contact that ends in the edge across the period's end.
    """
    path = tmp_path / "wave.edp"
    path.write_text(f"""include "scene.idp"
real start = physical("start", 0.), F = physical("friction", 0.3);
mesh Wave = square(40, 4, [4*x + start, 2*y]);
body = movemesh(Wave, [x, y + (2 - y)*0.04*(1 + cos(pi*x/2))]);
macro young() 300. //
macro poisson() 0.2 //
quasistatic(1.);
macro amplitude1(t) t //
macro periodic() 2, 4 //
macro contact() 1 //
macro obstacle(x, y) y //
macro friction() F*(1 + 0.2*cos(pi*x)) //
{more}macro displacement1() on(3, u1 = 0.05, u2 = -0.02) //
include "export.idp"
""")
    one, other = (made(scene=str(path), start=start, friction="0.1,0.3", steps="16",
                       out=str(tmp_path / start))[1]["history"] for start in ("2", "4"))
    for name in ("resultant_n", "resultant_t", "peak_pressure", "contact_length", "dissipated"):
        np.testing.assert_allclose(*([float(row[name]) for row in rows] for rows in (one, other)),
                                   rtol=1e-6, err_msg=name)


def test_loads_that_no_value_changes_are_one_pattern(built):
    """Equal to the last bit: they are solved for once."""
    problem = built(cells=2)
    base, subs = problem.manifest, problem.structure.subdomains
    own = {sub.index: Loads(sub.loads, sub.fixed, sub.fixed_values) for sub in subs}
    twice = {k: Loads(2 * part.forces, *part[1:]) for k, part in own.items()}
    loads = LoadValues("size", [Value(None, None, part) for part in (own, twice, twice, {})],
                       MPI.COMM_SELF)
    wide, wider = loads.widen(base, subs)
    assert loads.columns == [[0], [1], [1], [0]] and len(wide.patterns) == 2
    assert all(np.array_equal(sub.loads[1], 2 * sub.loads[0]) for sub in wider)
    assert loads.history(1, base, wide).factors[:, 0].max() == 0
    assert np.array_equal(loads.history(1, base, wide).factors[:, 1], base.factors[:, 0])


def test_a_value_that_changes_the_mesh_is_refused_with_what_to_do(tmp_path):
    """One export does not do: driver.run in a loop does."""
    path = tmp_path / "wide.edp"
    path.write_text("""include "scene.idp"
real wide = physical("wide", 2.);
body = square(2, int(wide), [wide*x, y]);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro load1() traction(2, 1., -1.) //
macro contact() 1 //
macro friction() 0.3 //
include "export.idp"
""")
    with pytest.raises(InputError, match="a study cannot vary WIDE: it .*; sweep it by driver.run"):
        study.make_study({"scene": str(path), "wide": "2,3", "quiet": "yes",
                          "out": str(tmp_path / "out")})


def test_a_value_that_moves_a_support_is_refused(variant, tmp_path):
    path = variant("moved", ("macro amplitude1(t)", """real side = physical("side", 2.);
macro displacement1() on(int(side), u2 = -1e-4) //
macro amplitude1(t)"""))
    with pytest.raises(InputError, match="changes where displacements are prescribed; sweep it"):
        study.make_study({"scene": str(path), "side": "2,3", "steps": "2", "quiet": "yes",
                          "out": str(tmp_path / "out"), "cells": "2"})


@pytest.mark.slow
def test_gaps_on_a_graph_partition_without_condensation(made, solved, monkeypatch):
    monkeypatch.setattr(parametric, "LARGEST", 0)
    summary, files = made(scene="bracket", play="0.01,0.03", steps="3")
    assert not summary["condensed"]
    compare(files["contact"], solved("bracket", play=0.03, steps=3, **TIGHT), play="0.03")


def test_values_are_solved_on_the_whole_where_the_elimination_fails(made, solved, monkeypatch):
    for limit in ("REFINED", "ROUNDING"):
        monkeypatch.setattr(compliance, limit, 0.0)  # what no solution meets
    summary, files = made(scene="model", friction="0.2,0.3", steps="2")
    assert not summary["condensed"]
    compare(files["contact"], solved(friction=0.3, steps=2, **TIGHT), friction="0.3")


def test_bodies_without_support_agree_with_single_runs(made, solved):
    """Nodes of the second and third body keep their numbers, a second parameter in the friction's
    statement its value."""
    summary, files = made(scene="stack", friction="0.3,0.6", h="0.3", steps="3")
    assert not summary["condensed"]
    # friction and balance are settled to 1e-10, and tractions of bodies that stand on one another
    # answer to both
    compare(files["contact"], solved("stack", friction=0.3,
            h=0.3, steps=3, **TIGHT), friction="0.3")


def test_a_value_without_equilibrium_is_reported_and_the_others_kept(tmp_path):
    out = tmp_path / "study"
    with pytest.raises(DriverError,
                       match="1 of 2 values did not converge, the first FRICTION=0.3: step 1: no "
                             "equilibrium"):
        study.make_study({"scene": "slope", "friction": "0.3,0.5", "cells": "3", "out": str(out),
                          "quiet": "yes", "figures": "no"})
    rows = read_rows(out / "study.csv")
    assert [row["converged"] for row in rows] == ["no", "yes"] and float(rows[1]["resultant_n"]) < 0


@pytest.mark.slow
def test_any_number_of_ranks_gives_the_same_bits(made):
    # more than one chain
    values = dict(scene="model", friction=f"0.2:0.3:{value_chains.LONGEST + 2}", steps="2")
    one = made(**values)[1]
    assert one == made(**values, np="2")[1]


VARIED = (("macro friction() F //", """real shift = physical("shift", 0.01);
macro friction() F //
macro gap() (shift*x) //
macro initialX() (shift*(x + y^2)) //
macro initialY() (shift*y) //"""),)


@pytest.mark.parametrize("scene, name, values, options", [
    ("model", "friction", ["0.3", "0.4"], {}),
    (VARIED, "shift", ["0.01", "0.02"], {"cells": "2"}),
    (VARIED, "shift", ["0.01", "0.02"], {"cells": "2", "element": "P2", "subdomains": "5"}),
    ("bracket", "play", ["0.01", "0.03"], {"element": "P2"}),
    ("stack", "friction", ["0.3", "0.6"], {}),
])
@pytest.mark.some(1)
def test_contact_data_of_a_later_value_are_those_of_a_first_one(tmp_path, variant, scene, name,
                                                                values, options):
    """Contact nodes are found for the first value only, what a value changes for each: the same to
    the last bit."""
    path = variant("varied", *scene) if scene is VARIED else freefem.find_scene(scene)
    both = freefem.export_study(path, tmp_path / "both", options, name, values)
    alone, = freefem.export_study(path, tmp_path / "alone", options, name, values[1:])

    def read(manifest):
        return read_value(manifest.directory, manifest)[:2]

    first, (later, gid), (expected, numbers) = read(both[0])[0], read(both[1]), read(alone)
    assert np.array_equal(gid, numbers) and len(gid)
    for part in ("node", "label", "weight", "normal"):
        assert np.array_equal(getattr(later, part), getattr(expected, part)), part
    assert later.columns.keys() == expected.columns.keys()
    assert all(np.array_equal(values, expected.columns[part])
               for part, values in later.columns.items())
    assert not all(np.array_equal(first.columns[part], values)
                   for part, values in later.columns.items())


@pytest.mark.parametrize("text, changed", [
    ("", {"friction"}),
    ("real E2 = 3.*F, other = 1.;", {"friction"}),
    ("real other = 1., E = F*1e9;", {"friction", "young"}),
    ("real other = min(F, 1.), E = 1e9;", {"friction"}),
    ("macro strength() (2.*F) //\nreal E = strength*1e9;", {"friction", "young"}),
    ("rotate(F);", {"friction", "'rotate(F)'"}),
    ('units("F", "Pa");', {"friction"}),  # a word in a text is no variable
])
def test_what_a_parameter_changes(variant, text, changed):
    old = "real E = 21.19e10, nu = 0.277;"
    kept = "" if "E = " in text else old
    scene = variant(f"changed-{abs(hash(text))}", (old, f"{kept}\n{text}"))
    assert changed_by(scene, "friction") == changed


@pytest.mark.parametrize("words, reason", [
    ("SCENE=model FRICTION=0.3", "exactly one parameter"),
    ("SCENE=model FRICTION=0.3,0.4 STEPS=2,3", "exactly one parameter"),
    ("SCENE=model FRICTION=0.3:0.4", "first:last:count"),
    ("SCENE=model FRICTION=0.3:0.4:0", "the count, 0, must be 2 or more"),
    ("SCENE=model FRICTION=0.3,0.3", "gives one twice"),
    ("SCENE=model CELLS=5,10", "reads no parameter CELLS"),
    ("SCENE=model VALUES=5,10", "as FRICTION=a,b,c or FRICTION=first:last:count"),
    ("SCENE=thermal POISSON=0.2,0.3",
     "also changes poisson: sweep it by driver.run, as driver/README.md shows"),
    ("SCENE=cantilever STEPS=1,2", "static scene has one step"),
    ("SCENE=model FRICTION=0.3,-1", "friction is negative"),
    ("FRICTION=0.3,0.4", "needs SCENE="),
    ("SCENE=model FRICTION=0.3,0.4 ADAPT=1", "one mesh"),
    ("SCENE=model FRICTION=0.3,0.4 ACCURACY=1%", "ACCURACY belongs to single runs"),
])
def test_refusals(words, reason, tmp_path):
    with pytest.raises(InputError, match=reason):
        study.make_study({**parse_pairs(words.split()),
                         "out": str(tmp_path / "study"), "quiet": "yes"})
    assert not list(tmp_path.iterdir())


def test_a_value_without_solution_is_reported_and_the_others_kept(tmp_path):
    out = tmp_path / "study"
    pairs = {"scene": "model", "friction": "0.3,0.4", "steps": "2", "out": str(out),
             "max_products": "40", "quiet": "yes", "figures": "no", "max_fixed_point": "1"}
    with pytest.raises(DriverError, match="2 of 2 values did not converge, the first FRICTION=0.3"):
        study.make_study(pairs)
    rows = read_rows(out / "study.csv")
    assert [row["converged"] for row in rows] == ["no", "no"]


@pytest.mark.slow
@pytest.mark.parametrize("scene, name, values, options", [
    ("worn-pad", "wear", ("1e-5", "2e-4"), {"cells": "3", "steps": "6"}),
    pytest.param("flange", "exponent", ("0.6", "2.5"), {"h": "4", "asperities": "1e5"},
                 marks=pytest.mark.slow),
    pytest.param("worn-pad", "wear", ("0", "1e-3"),
                 {"cells": "2", "steps": "4", "element": "P2", "subdomains": "5"},
                 marks=pytest.mark.slow)])
def test_surfaces_that_wear_or_yield_agree_with_single_runs(made, solved, scene, name, values,
                                                            options):
    """Tractions, displacements and wear of every value; where supports hold bodies condensed."""
    tight = {**options, "primal_rtol": "1e-8"}
    summary, files = made(scene=scene, **{name: ",".join(values)}, **tight)
    assert summary["condensed"] == (scene == "worn-pad") and summary["converged"]
    for value, row in zip(values, files["study"]):
        single = solved(scene, **{name: value}, **tight, **TIGHT)
        compare(files["contact"], single, **{name: value})
        mine = [row for row in files["contact"] if row[name] == value]
        worn = {"worn_depth": "wear"} if scene == "worn-pad" else {}
        for field in ("u_n", "slip", *worn):
            expected = single.contact[worn.get(field, field)][-1]
            ours = np.array([float(row[field]) for row in mine])
            assert np.abs(ours - expected).max() <= CLOSE * np.abs(expected).max()
        assert float(row["dissipated"]) == pytest.approx(single.summary["dissipated"], rel=1e-5)
        if scene == "worn-pad":
            assert float(row["worn_volume"]) == pytest.approx(
                single.summary["quantities"]["worn_volume"], rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("values", ["0.1,0.3", "0.3,0.1"])
@pytest.mark.slow
def test_corners_that_open_do_not_change_what_other_values_find(made, solved, named_scene, values):
    """The vertex of two boundaries with cohesion, of which one lets go: rows kept apart in one
    state are as they were in the next, for other steps and other values.
    """
    scene = named_scene("corner", """include "scene.idp"
units("mm", "MPa");
real F = physical("friction", 0.3);
rectangle(0., 4., 0., 3.);
quasistatic(2.);
macro young() 200. //
macro poisson() 0.35 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -2.) //
macro amplitude1(t) (t < 1. ? t : 3.*(4./3. - t)) //
macro contact() 1, 2 //
macro gap() 0.005 //
macro friction() F //
macro cohesion() 0.2 //
include "export.idp"
""")
    options = {"cells": "3", "steps": "10", "subdomains": "2x1"}
    files, run = made(scene=scene, friction=values, **options)[1], solved(
        scene, friction=0.3, **options, **TIGHT)
    compare(files["contact"], run, friction="0.3")
    row = next(row for row in files["study"] if row["friction"] == "0.3")
    assert float(row["dissipated"]) == pytest.approx(run.summary["quantities"]["dissipated_energy"],
                                                     rel=CLOSE)


def test_work_in_corners_that_slide_by_a_given_bound(made, solved, named_scene):
    """A block that warms up between walls: its corners rub by Tresca's bound on two sides."""
    scene = named_scene("warm", """include "scene.idp"
real F = physical("friction", 0.1);
rectangle(-3., 3., 0., 2.);
quasistatic(1.);
macro young() 1000. //
macro poisson() 0.3 //
macro contact() 1, 2, 4 //
macro gap() (label == 1 ? 0. : 0.002) //
macro tresca() F //
macro load1() traction(3, 0., -2.) //
macro thermal2() 0.002 //
include "export.idp"
""")
    options = {"cells": "3", "steps": "2", "subdomains": "4x2"}
    row = made(scene=scene, friction="0.1,0.4", **options)[1]["study"][0]
    run = solved(scene, friction=0.1, **options, **TIGHT)
    assert float(row["dissipated"]) == pytest.approx(run.summary["quantities"]["dissipated_energy"],
                                                     rel=1e-5)


@pytest.mark.slow  # runs of its own
def test_cycles_of_every_value_end_where_they_settle(made, solved):
    """As in single runs: number, kind, work; jumps are refused."""
    options = {"cells": "3", "steps": "16", "cycles": "5 until settled"}
    _, files = made(scene="hard/cycles", friction="0.1,0.4", **options)
    for row in files["study"]:
        single = solved("hard/cycles", friction=row["friction"], **options, **TIGHT).summary
        last = single["cycles"]["last"]
        assert (int(row["cycles"]), row["kind"], row["settled"]) == (
            last["cycle"], last["kind"], "yes")
        assert float(row["dissipated"]) == pytest.approx(single["dissipated"], rel=1e-5)
    with pytest.raises(InputError, match="goes through all cycles"):
        made(scene="hard/cycles", friction="0.1,0.4", cycles="jump")


def test_a_scene_whose_path_freefem_does_not_include(tmp_path):
    """Letters beyond ASCII in the path: the values are those of the same scene elsewhere."""
    text = freefem.find_scene("tutorial").read_text()
    tables = []
    for folder in ("plain", "rädern"):
        path = tmp_path / folder / "scene.edp"
        path.parent.mkdir()
        path.write_text(text)
        study.make_study({"scene": str(path), "friction": "0.1,0.3", "figures": "no",
                          "quiet": "yes", "h": "2", "out": str(tmp_path / f"out-{folder}")})
        tables.append((tmp_path / f"out-{folder}" / "study.csv").read_bytes())
    assert tables[0] == tables[1]


HEATED = """include "scene.idp"
real T = physical("heat", 1e-3);
int[int] below = [1, 2, 5, 4], above = [6, 7, 3, 9];
addBody(square(4, 2, [4.*x, 2.*y], label = below))
bodyMaterial("stiff", 1000., 0.3);
addBody(square(4, 2, [4.*x, 2. + 2.*y], label = above))
bodyMaterial("soft", 100., 0.4);
macro contactPair() 6, 5 //
macro support() on(1, u1 = 0., u2 = 0.) + on(3, u1 = 0., u2 = 0.) //
macro thermal1() T //
include "export.idp"
"""


def test_loads_of_bodies_are_made_with_their_own_materials(made, solved, named_scene):
    """Heat presses each body by its own modulus."""
    path = str(named_scene("heated", HEATED))
    _, files = made(scene=path, heat="1e-3,2e-3")
    compare(files["contact"], solved(path, heat="2e-3", **TIGHT), heat="2e-3")


RUBBED = """include "scene.idp"
real F = physical("friction", 0.3);
body = square(8, 4, [8.*x, 4.*y]);
quasistatic(1.);
bodyMaterial("pad", 1e6, 0.);
macro support() on(3, u1 = 0.) //
macro contact() 1 //
macro friction() F //
macro load1() pressure(3, 2.) //
macro obstacleX(t) 0.5*t //
include "export.idp"
"""


def test_the_user_waits_for_all_that_is_printed(tmp_path, monkeypatch, capsys):
    """Tables, figures and page count, as programs that start: `since` is before all of them."""
    monkeypatch.setattr("driver.figures.study.draw", lambda folder: time.sleep(0.2))
    monkeypatch.setattr(cli, "STARTED", time.perf_counter() - 100.0)
    out = tmp_path / "study"
    cli.study(["SCENE=model", "CELLS=2", "STEPS=1", "FRICTION=0.1,0.2", f"OUT={out}", "QUIET=yes"])
    seconds = json.loads((out / "summary.json").read_text())["seconds"]
    assert seconds["figures"] >= 0.2 and seconds["start"] >= 100.0 and seconds["output"] > 0
    assert seconds["total"] == pytest.approx(sum(seconds.values()) - seconds["total"])
    assert f"{seconds['total']:.2f} s (FreeFEM" in capsys.readouterr().out
    assert (out / "report.html").exists()


def test_tables_stand_without_figures_and_page(tmp_path, monkeypatch, capsys):
    def fails(_folder):
        raise ValueError("no such color")

    for drawn in ("driver.figures.study.draw", "driver.report.study.write"):
        monkeypatch.setattr(drawn, fails)
    out = tmp_path / "study"
    cli.study(["SCENE=model", "CELLS=2", "STEPS=1", "FRICTION=0.1,0.2", f"OUT={out}", "QUIET=yes"])
    said = capsys.readouterr().err
    assert "'make figures' draws them" in said and "'make report' writes it" in said
    assert len(read_rows(out / "study.csv")) == 2


def test_friction_takes_the_work_that_it_takes_in_single_runs(made, named_scene):
    """F p L s, under a load that stands from time 0, beside an obstacle that moves."""
    _, files = made(scene=str(named_scene("rubbed", RUBBED)), friction="0.2,0.3", steps="3")
    for row in files["study"]:
        work = float(row["friction"]) * 2 * 8 * 0.5
        assert float(row["dissipated"]) == pytest.approx(work, rel=1e-4)


# what holds the end of the pad along the floor, or drags it there and back
HELD = {"a floor that moves": ("on(3, u1 = 0.)", "on(4, u1 = 0.)"),
        "a support that moves": ("macro obstacleX(t) 0.5*t //", "macro displacement2() on(4, "
                                 "u1 = 0.2) //\nmacro amplitude2(t) (t < 0.6 ? t : 1.2 - t) //"),
        "a law of slip": ("macro obstacleX(t) 0.5*t //", "macro displacement2() on(4, u1 = 0.2) //"
                          "\nmacro amplitude2(t) (t < 0.6 ? t : 1.2 - t) //\n"
                          "macro slipFactor(s) (1. - s) //\nreal slipRange = 0.5;"),
        "a start elsewhere": ("macro obstacleX(t) 0.5*t //", "macro displacement2() on(4, u1 = "
                              "0.2) //\nmacro amplitude2(t) t //\nmacro initialX() 0.05 //"),
        "a start under load": ("macro obstacleX(t) 0.5*t //", "macro displacement2() on(4, u1 = "
                               "0.2) //\nmacro amplitude2(t) 1. + t //\nmacro preload() 1 //")}


@pytest.mark.parametrize("kind", HELD)
def test_nodes_that_a_support_holds_rub_as_in_single_runs(made, solved, named_scene, kind):
    """They slide as it has them, or as the floor does below them, and it takes their friction."""
    path = str(named_scene("sided", RUBBED.replace(*HELD[kind])))
    summary, files = made(scene=path, friction="0.2,0.3", steps="5")
    assert not any("hold" in line for line in summary["warnings"])
    single = solved(path, friction="0.3", steps="5", **TIGHT)
    rows = [row for row in files["contact"] if row["friction"] == "0.3"]
    if kind == "a start under load":
        assert single.contact["slip"][0][0] == pytest.approx(0.04)  # not all that it is at
    held = np.flatnonzero(single.contact["x"][-1] == 0.0)
    assert len(held) == 1 and abs(single.contact["sigma_t"][-1][held[0]]) > 0.1
    for name in ("u_t", "slip", "sigma_t", "bound"):
        ours = np.array([float(row[name]) for row in rows])
        np.testing.assert_allclose(ours, single.contact[name][-1], atol=CLOSE)
    assert [row["status"] for row in rows] == list(single.contact["status"][-1])
    history = [row for row in files["history"] if row["friction"] == "0.3"]
    for name in ("resultant_t", "dissipated"):
        ours = np.array([float(row[name]) for row in history])
        np.testing.assert_allclose(ours, single.history[name], atol=1e-5 * np.abs(ours).max())


def test_a_node_on_the_axis_stays_there_whatever_the_body_starts_from(made, named_scene):
    """No row tells of it: it was told to stand where u_0 has it."""
    text = (RUBBED.replace("macro support() on(3, u1 = 0.) //", "macro axisymmetric() 1 //")
            .replace("macro obstacleX(t) 0.5*t //", "macro initialX() 0.01 //"))
    _, files = made(scene=str(named_scene("round", text)), friction="0.2,0.3", steps="2")
    axis = [row for row in files["contact"] if float(row["x"]) == 0.0]
    assert [float(row["u_t"]) for row in axis] == [0.0, 0.0]



@pytest.mark.slow  # two studies
def test_a_parameter_may_have_the_name_of_a_column(made, named_scene, tmp_path):
    """Values have a column of their own, in tables and in the picture."""
    text = freefem.find_scene("bar").read_text()
    path = str(named_scene("slips", text.replace('physical("pull"', 'physical("slip"')))
    summary, files = made(scene=path, slip="100,200", cells="2", figures="yes")
    assert summary["study"] == "slip"
    for rows in files.values():
        assert [*rows[0]][0] == "slip_value" and {row["slip_value"] for row in rows} == {"100",
                                                                                         "200"}
    # a column of its own still: without friction it tells nothing
    assert np.isnan([float(row["slip"]) for row in files["contact"]]).all()
    assert (tmp_path / "study" / "figures" / "study.png").exists()
