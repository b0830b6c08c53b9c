"""What finite rotations change, against closed forms of beams, struts and coned discs."""

import numpy as np
import pytest

from driver.contact.states import SLIP
from driver.validity import buckling, second_order
from driver.validity.finite_rotations import Triangles
from driver.validity.limits import QUESTIONABLE

HEAD = '''include "scene.idp"
units("mm", "MPa");
'''
STRUT = HEAD + '''subdomains("8x1");
real L = 40., share = physical("share", 0.1), side = physical("side", 1e-3);
real critical = pi^2*1000./12./(4.*L^2);   // Euler's stress of a cantilever column, thickness 1
rectangle(0., L, 0., 1.);
macro young() 1000. //
macro poisson() 0. //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(2, -share*critical, side) //
include "export.idp"
'''
BEAM = HEAD + '''subdomains("8x1");
real L = 40., down = physical("down", 0.3), away = physical("away", 0.);
rectangle(0., L, 0., 1.);
macro young() 1000. //
macro poisson() 0. //
macro support() on(4, u1 = 0., u2 = 0.) + on(2, u1 = 0., u2 = 0.) //
macro contact() 3 //
macro obstacle(x, y) (sqrt((x - L/2)^2 + (y - 1. - 100. + down)^2) - 100.) //
include "export.idp"
'''
WASHER = HEAD + '''subdomains("4");
real ri = 10., ro = 20., s = 1., h0 = 0.8, down = physical("down", 0.5);
body = square(20, 2, [ri + (ro - ri)*x, h0*(1 - x) + s*y]);
macro axisymmetric() 1 //
macro young() 206e3 //
macro poisson() 0.3 //
macro contact() 1, 3 //
macro obstacle(x, y) (label == 1 ? y : h0 + s - down - y) //
include "export.idp"
'''


@pytest.fixture(scope="module")
def change(solved, named_scene):
    """change(text, **options): `second_order` of the validity of a run, and its warnings."""
    def get(text, **options):
        summary = solved(named_scene(f"scene{abs(hash(text))}", text), **options).summary
        return summary["validity"]["second_order"], summary["warnings"]

    return get


@pytest.mark.parametrize("element", ["P2", "P2-mixed"])
def test_a_strut_gives_way_to_its_axial_force(change, element):
    """Deflections of a column with a share of Euler's load: 3 (tan u - u) / u^3, u = L sqrt(P/EI).

    Two orders of a series in the share leave a tenth squared of the change.
    """
    u = np.pi / 2 * np.sqrt(0.1)
    exact = 3 * (np.tan(u) - u) / u**3 - 1
    found, warnings = change(STRUT, element=element, cells=2)
    assert found == pytest.approx(exact, rel=0.015)
    assert any("finite rotations change the largest displacement by 0.11" in w for w in warnings)


def test_a_strut_under_little_load_may_be_taken_for_linear(change):
    found, warnings = change(STRUT, element="P2", cells=2, share=0.01)
    assert found == pytest.approx(0.01, rel=0.05) and not warnings


def test_a_beam_between_two_clamps_stretches(change):
    """F = 192 E I w / L^3 (1 + 0.72 (w/t)^2): its length grows by 2.4 w^2 / L.

    By cubic deflections, which a force in the middle makes; shear adds 12/5 (t/L)^2 (1 + nu) to the
    compliance, less than a hundredth.
    """
    found, warnings = change(BEAM, element="P2", cells=2, down=0.3)
    assert found == pytest.approx(0.72 * 0.3**2, rel=0.03)
    assert any("the contact force of boundary 3 by 0.065" in w for w in warnings)


def test_a_coned_washer_gets_softer_as_it_flattens(change):
    """Almen's and Laszlo's formula, F ~ d ((h - d)(h - d/2) t + t^3); it takes sections for rigid,
    which makes forces too large by some hundredths.
    """
    h, d, t = 0.8, 0.5, 1.0
    exact = 1 - ((h - d) * (h - d / 2) * t + t**3) / (h**2 * t + t**3)
    found, warnings = change(WASHER, element="P2")
    assert found == pytest.approx(exact, rel=0.05)
    assert any("results are questionable: finite rotations change the contact force" in w
               for w in warnings)


def test_what_bends_freely_is_no_mistake(change):
    """A cantilever whose end turns by 0.08 moves by what it should, to some theta^2."""
    found, warnings = change(STRUT.replace("-share*critical, side", "0., 8e-4*1000./12./L"),
                             element="P2", cells=2)
    assert found < 0.08**2 < QUESTIONABLE["second_order"] and not warnings


def test_further_solutions_are_asked_for_where_errors_are(solved):
    """Or where stretches that strains leave out are not small beside them, as in those above."""
    one = {"loading": "monotone", "cells": 4, "steps": 2}
    valid = solved("model", **one).summary["validity"]
    assert valid["second_order"] is None and valid["buckling"] is None
    valid = solved("model", **one, errors="energy").summary["validity"]
    assert 0 < valid["second_order"] < QUESTIONABLE["second_order"] and valid["buckling"] >= 0


def stretched(sub, u):
    """Energy of displacements u (dofs,) by Biot's strain, of the polar decomposition."""
    of = Triangles(sub)
    F = np.moveaxis(of.gradient(u), (0, 1), (-2, -1)) + np.eye(2)  # [j, k] = d x_k / d X_j
    turn = np.arctan2(F[..., 0, 1] - F[..., 1, 0], F[..., 0, 0] + F[..., 1, 1])
    back = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    stretch = np.moveaxis(F @ np.moveaxis(back, (0, 1), (-2, -1)) - np.eye(2), (-2, -1), (0, 1))
    np.testing.assert_allclose(stretch[0, 1], stretch[1, 0], atol=1e-12)
    strain = of.strain(stretch, u)
    return (of.share * (of.elastic(strain) * strain).sum(axis=0)).sum() / 2


@pytest.mark.parametrize("scene, options", [("model", dict(cells=2)), ("hertz", dict(h=0.02)),
                                            ("hertz", dict(h=0.02, element="P2")),
                                            ("sphere", dict(h=0.05, element="P2"))])
def test_forces_of_second_order_are_those_of_biots_strain(built, scene, options):
    """Central differences of its energy in amplitude: what is left is of fourth order in that."""
    sub = built(scene, reduce=False, **options).structure.subdomains[0]
    rng = np.random.default_rng(3)
    x = (sub.xy - sub.xy.mean(axis=0)) / np.ptp(sub.xy, axis=0).max()
    smooth = np.column_stack([np.ones(len(x)), x, x**2, x.prod(axis=1)])
    u, v = (0.1 * np.ptp(sub.xy, axis=0).max() * (smooth @ rng.standard_normal((6, 2))).ravel()
            for _ in range(2))
    found = second_order.unbalanced(sub, u, np.zeros(len(sub.loads)))[0] @ v
    a, b = 1e-2, 1e-4  # of u and of v: the even part in a is that of second order
    work = [(stretched(sub, s * a * u + b * v) - stretched(sub, s * a * u - b * v)) / (2 * b)
            for s in (1, -1)]
    assert found == pytest.approx(sum(work) / (2 * a**2), rel=2e-3)


CLAMPED = HEAD + '''real share = physical("share", 1.);
rectangle(0., 40., 0., 1.);
macro young() 1000. //
macro poisson() 0. //
macro support() on(4, u1 = 0., u2 = 0.) + on(2, u1 = 0., u2 = 0.) //
macro thermal1() share*pi^2/3./40.^2 //
include "export.idp"
'''


COLUMN = STRUT.replace("critical, side", "critical, 0.")
TENSION = COLUMN.replace("-share", "share")


@pytest.mark.parametrize("text, share, cut", [
    (COLUMN, 0.3, dict(subdomains="8x1", cells=2)), (COLUMN, 0.3, dict(subdomains=3, cells=8)),
    (COLUMN, 1.2, dict(subdomains="8x1", cells=2)), (TENSION, -1.2, dict(cells=2)),
    (CLAMPED, 0.7, dict(subdomains="8x1", cells=2))],
    ids=["free end", "another cut", "beyond", "tension", "clamped"])
def test_straight_columns_have_a_part_of_eulers_load(solved, tmp_path, text, share, cut):
    """pi^2 E I / 4 L^2 of a free end, of clamped ends, heated, 16 times as much; shear lowers it by
    (pi t / 2 L)^2 / 5 or less, a percent of clamped ends. Displacements show nothing of it.
    """
    path = tmp_path / "column.edp"
    path.write_text(text)
    valid = solved(str(path), element="P2", share=abs(share), errors="energy",
                   **cut).summary["validity"]
    assert valid["buckling"] == pytest.approx(max(share, 0.0), rel=0.02, abs=1e-6)
    assert valid["second_order"] < 1e-3
    verdict = "ok" if share < 0.5 else "questionable" if share < 1 else "invalid"
    assert valid["verdict"] == verdict and ("buckles" in valid["reason"]) == (verdict != "ok")


def test_a_column_that_is_pulled_in_the_end_was_pressed_before(solved, tmp_path):
    """By a little more, so that the strains of both steps are alike: compression alone buckles."""
    path = tmp_path / "column.edp"
    path.write_text(COLUMN.replace("macro young", "quasistatic(2.);\nmacro amplitude1(t) "
                                   "(t < 1.5 ? 1. : -0.95) //\nmacro young"))
    valid = solved(str(path), element="P2", share=0.7, cells=2, steps=2,
                   errors="energy").summary["validity"]
    assert valid["buckling"] == pytest.approx(0.7, rel=0.02)
    assert valid["verdict"] == "questionable"


def test_steps_that_eliminate_gluing_rows_answer_by_contact_rows_alone(built, steps_of):
    """One factorization of the state without Coulomb's coupling, and four products for each of the
    answers, the last to judge it; conjugate gradients take ten and more.
    """
    problem = built("tutorial", h=3, steps=4)
    solver, steps = steps_of(problem)
    assert solver.condensation.eliminated and solver.history.counts["condensed_steps"]
    step, rows, operator = steps[-1], solver.rows, problem.operator
    status = np.zeros(len(operator.structure.contact.gid), int)
    status[rows.normal_node] = step.status
    assert (status == SLIP).any()
    fields, before = operator.deformations(step.multipliers, step.weights), operator.products
    second_order.Change.of(problem, solver, step, status, fields)
    assert operator.products - before <= 4 * (2 + buckling.VECTORS)


PORTAL = HEAD + '''real P = 1.5*2*pi^2*1000./12./40.^2;
border foot1(t=0, 1) { x = t; y = 0; label = 1; }
border in1(t=0, 40) { x = 1; y = t; label = 2; }
border under(t=1, 29) { x = t; y = 40; label = 2; }
border in2(t=40, 0) { x = 29; y = t; label = 2; }
border foot2(t=29, 30) { x = t; y = 0; label = 1; }
border out2(t=0, 50) { x = 30; y = t; label = 2; }
border top(t=30, 0) { x = t; y = 50; label = 3; }
border out1(t=50, 0) { x = 0; y = t; label = 2; }
body = buildmesh(foot1(1) + in1(40) + under(10) + in2(40) + foot2(1) + out2(44) + top(6)
                 + out1(44));
macro young() 1000. //
macro poisson() 0. //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -P/30.) //
include "export.idp"
'''


def test_thin_columns_under_a_stout_beam_buckle(solved, tmp_path):
    """Sideways at pi^2 E I / L^2 each, clamped and guided; the beam, ten times as high, gives way
    by some hundredths as much.
    """
    (tmp_path / "portal.edp").write_text(PORTAL)
    valid = solved(str(tmp_path / "portal.edp"), element="P2",
                   errors="energy").summary["validity"]
    assert valid["buckling"] == pytest.approx(1.5, rel=0.05) and valid["verdict"] == "invalid"


ON_BLOCK = HEAD + '''real a = 100., L = 20.;
border under(t=0, 1) { x = a*t; y = 0; label = 1; }
border right(t=0, 1) { x = a; y = a*t; label = 2; }
border beside(t=0, 1) { x = a - (a/2 - 0.5)*t; y = a; label = 2; }
border up(t=0, 1) { x = a/2 + 0.5; y = a + L*t; label = 2; }
border head(t=0, 1) { x = a/2 + 0.5 - t; y = a + L; label = 3; }
border down(t=0, 1) { x = a/2 - 0.5; y = a + L - L*t; label = 2; }
border beyond(t=0, 1) { x = (a/2 - 0.5)*(1 - t); y = a; label = 2; }
border left(t=0, 1) { x = 0; y = a*(1 - t); label = 2; }
body = buildmesh(under(8) + right(8) + beside(8) + up(20) + head(1) + down(20) + beyond(8)
                 + left(8));
macro young() 1000. //
macro poisson() 0. //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -1.2*pi^2*1000./12./(4.*L^2)) //
include "export.idp"
'''


def test_a_strut_that_is_a_small_part_of_a_body_buckles_as_any_other(solved, tmp_path):
    """With 1.2 of Euler's load; a block of 500 times its area gives way beneath it, by less than
    the twentieth by which a length that is t/2 larger, of 20 t, lowers that.
    """
    (tmp_path / "onblock.edp").write_text(ON_BLOCK)
    valid = solved(str(tmp_path / "onblock.edp"), element="P2",
                   errors="energy").summary["validity"]
    assert valid["buckling"] == pytest.approx(1.2, rel=0.05) and valid["verdict"] == "invalid"


GROOVE = HEAD + '''border low(t = pi, 2*pi) { x = 10.*cos(t); y = 10.*sin(t); label = 1; }
border top(t = 1, -1) { x = 10.*t; y = 0.; label = 3; }
body = buildmesh(low(80) + top(12));
macro young() 2000. //
macro poisson() 0.3 //
macro load1() pressure(3, 5.) //
macro contact() 1 //
macro obstacle(x, y) ((y - sqrt(3.)*abs(x))/2. + 10.) //
macro friction() 0. //
include "export.idp"
'''


def test_a_round_bar_that_may_turn_in_its_groove_does_not_buckle(solved, tmp_path):
    """Loaded in its middle it is at rest wherever it turns to: points of contact change."""
    (tmp_path / "groove.edp").write_text(GROOVE)
    run = solved(str(tmp_path / "groove.edp"), errors="energy")
    assert run.summary["boundaries"][0]["normal_resultant"] == pytest.approx(200.0, rel=1e-6)
    assert run.summary["validity"]["buckling"] == 0.0
    assert run.summary["validity"]["verdict"] == "ok"


BESIDE = HEAD + GROOVE[len(HEAD):].replace("body = buildmesh(low(80) + top(12));", """
addBody(buildmesh(low(24) + top(6)))
int[int] sides = [11, 12, 13, 14];
addBody(square(1, 20, [40. + x, 20.*y], label = sides))""").replace(
    "macro contact()", """macro support() on(11, u1 = 0., u2 = 0.) //
macro load2() pressure(13, 1.2*pi^2*2000./12./(4.*20.^2)) //
macro contact()""").replace("macro poisson() 0.3", "macro poisson() 0.")


def test_a_strut_beside_a_bar_that_may_turn_buckles(solved, tmp_path):
    """With 1.2 of Euler's load; on the bar, which contact alone keeps from turning, nothing is
    claimed.
    """
    (tmp_path / "beside.edp").write_text(BESIDE)
    valid = solved(str(tmp_path / "beside.edp"), element="P2",
                   errors="energy").summary["validity"]
    # L = 20 t: shear takes off some thousandths
    assert valid["buckling"] == pytest.approx(1.2, rel=0.05) and valid["verdict"] == "invalid"


RUBBER = HEAD + '''real uneven = physical("uneven", 0.);
rectangle(0., 10., 0., 5.);
macro young() 4. //
macro poisson() 0.4999 //
macro support() on(1, u2 = 0.) + on(2, u1 = 0.) + on(4, u1 = 0.) //
macro load1() pressure(3, 10. + uneven*sin(x)) //
include "export.idp"
'''


def test_rubber_that_fills_a_groove_does_not_buckle(solved, tmp_path):
    """Under 7.5 times its shear modulus, by strains of 10 (1 + nu) (1 - 2 nu) / (4 (1 - nu))."""
    (tmp_path / "rubber.edp").write_text(RUBBER)
    run = solved(str(tmp_path / "rubber.edp"), element="P2-mixed", cells=4, errors="energy")
    valid = run.summary["validity"]
    assert valid["largest_strain"] == pytest.approx(0.0015, rel=0.01)
    assert valid["buckling"] < 0.01 and valid["verdict"] == "ok"


def test_pressure_from_all_sides_does_no_work_on_rotations(solved, tmp_path):
    """Rubber likewise, under pressure that is uneven by a hundredth: it turns by little."""
    (tmp_path / "rubber.edp").write_text(RUBBER)
    run = solved(str(tmp_path / "rubber.edp"), element="P2-mixed", cells=4, uneven=0.1,
                 errors="energy")
    valid = run.summary["validity"]
    assert 0.02 < valid["largest_rotation"] < 0.05
    assert valid["second_order"] < valid["largest_rotation"] and valid["verdict"] == "ok"
