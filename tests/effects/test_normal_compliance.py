"""Rough surfaces, p = c (u_n - g)_+: uniform blocks, the law at every node, smooth contact."""

import numpy as np
import pytest

TIGHT = {"rtol": 1e-12, "friction_rtol": 1e-10, "primal_rtol": 1e-8}

# a block in uniform stress that rests on a rough floor and nothing else
BLOCK = """include "scene.idp"
real c = physical("asperities", 100.);
subdomains("2x2");
rectangle(0., 2., 0., 1.);
macro young() 1e3 //
macro poisson() 0. //
macro load1() pressure(3, 8.) //
macro contact() 1 //
macro gap() 0.01 //
macro friction() 0.2 //
macro normalCompliance() c //
include "export.idp"
"""
# and one that rests on another, finer one
PAIR = """include "scene.idp"
real c = physical("asperities", 100.);
int[int] below = [5, 6, 7, 8];
addBody(square(5, 4, [2*x, y]))
bodyMaterial("upper", 1e3, 0.);
addBody(square(7, 3, [2*x, -1 + y], label = below))
bodyMaterial("lower", 2e3, 0.);
macro load1() pressure(3, 8.) //
macro support() on(5, u1 = 0, u2 = 0) + on(4, u1 = 0) //
macro contactPair() 7, 1 //
macro normalCompliance() c //
include "export.idp"
"""


@pytest.mark.parametrize("options", [{}, {"element": "P2", "subdomains": 5}, {"np": 2},
                                     {"asperities": 1e-1}, {"asperities": 1e7}])
@pytest.mark.some(1)
def test_uniform_block_closes_by_p_over_c(solved, scene, options):
    run = solved(scene(BLOCK), cells=4, **TIGHT, **options)
    c = run.contact
    closure = c["u_n"] - c["gap"]
    np.testing.assert_allclose(c["sigma_n"], -8.0, rtol=1e-7)
    np.testing.assert_allclose(closure, 8 / options.get("asperities", 100.0), rtol=1e-7,
                               atol=1e-8 * 0.01)


@pytest.mark.parametrize("text, old, new", [
    (PAIR, "", ""), (BLOCK, "rectangle", "macro axisymmetric() 1 //\nrectangle")])
def test_between_bodies_and_of_revolution(solved, scene, text, old, new):
    run = solved(scene(text, (old, new)), **TIGHT)
    closure = run.contact["u_n"] - run.contact["gap"]
    np.testing.assert_allclose(run.contact["sigma_n"], -8.0, rtol=1e-7)
    np.testing.assert_allclose(closure, 0.08, rtol=1e-6)


@pytest.mark.parametrize("options", [{}, {"element": "P2", "subdomains": 5}])
@pytest.mark.some(1)
def test_the_law_holds_at_every_node(solved, options):
    """p = c (u_n - g)_+ to the tolerance of the QP; nodes with none of it are open."""
    run = solved("rough", cells=6, **TIGHT, **options)
    c = run.contact
    pressure, closure = -c["sigma_n"], c["u_n"] - c["gap"]
    largest = pressure.max()
    np.testing.assert_allclose(pressure, np.maximum(2e4 * closure, 0), atol=1e-6 * largest)
    assert (pressure == 0).any() and np.all((c["status"] == "open") == (pressure == 0))
    smooth = solved("rough", cells=6, without="normal_compliance", **TIGHT, **options)
    assert -smooth.contact["sigma_n"].min() > 1.1 * largest  # roughness spreads the pressure


@pytest.mark.slow  # two runs
def test_stiff_asperities_are_smooth_contact(solved):
    """The difference falls as 1/c: by 10 for a tenth of the closure."""
    smooth = solved("rough", cells=6, without="normal_compliance", **TIGHT)
    apart = [np.abs(solved("rough", cells=6, asperities=c, **TIGHT).contact["sigma_n"]
                    - smooth.contact["sigma_n"]).max() for c in (1e8, 1e9)]
    assert apart[1] == pytest.approx(apart[0] / 10, rel=0.05)


def test_misuse_is_refused_in_one_line(solved, scene):
    assert "normalCompliance is negative" in solved(scene(BLOCK), cells=2, asperities=-1).reason
    alone = BLOCK.replace("macro contact() 1 //\n", "").replace("macro gap() 0.01 //\n", "")
    run = solved(scene(alone.replace("macro friction() 0.2 //\n", "")), cells=2)
    assert run.status == 2 and "normalCompliance is declared without contact" in run.reason


# ---- p = c (u_n - g)_+^m -------------------------------------------------------------------------

POWER = BLOCK.replace("macro normalCompliance() c //", """macro normalCompliance() c //
real m = physical("exponent", 2.);
macro normalComplianceExponent() m //""")


@pytest.mark.parametrize("exponent, options", [
    (2, {}), (0.5, {}), (3.33, {"asperities": 1e5}),
    pytest.param(2, {"element": "P2", "subdomains": 5, "np": 2}, marks=pytest.mark.slow),
    pytest.param(1, {}, marks=pytest.mark.slow)])  # ranks; what needs no tangents
@pytest.mark.some(2)
def test_a_uniform_block_closes_by_a_power(solved, scene, exponent, options):
    """(p/c)^(1/m), exactly."""
    run = solved(scene(POWER), cells=3, exponent=exponent, **TIGHT, **options)
    closure = run.contact["u_n"] - run.contact["gap"]
    exact = (8 / options.get("asperities", 100.0)) ** (1 / exponent)
    np.testing.assert_allclose(run.contact["sigma_n"], -8.0, rtol=1e-7)
    np.testing.assert_allclose(closure, exact, rtol=1e-7, atol=1e-8 * 0.01)


@pytest.mark.parametrize("options", [{"h": 5}, pytest.param(  # a further mesh
    {"h": 5, "element": "P2", "subdomains": 5}, marks=pytest.mark.slow)])
def test_a_power_law_holds_at_every_node(solved, options):
    """Of two faces, to the tolerance; nothing pulls, and nothing is closed without pressure."""
    run = solved("flange", **TIGHT, **options)
    pressure, closure = -run.contact["sigma_n"], run.contact["u_n"] - run.contact["gap"]
    law = 1e8 * np.maximum(closure, 0) ** 2
    assert np.abs(pressure - law).max() < 1e-6 * pressure.max() and (pressure == 0).any()
    balance = run.summary["quantities"]["normal_resultant"]
    assert balance == pytest.approx(400, rel=1e-7)


@pytest.mark.slow  # three runs more
def test_stiff_power_laws_are_smooth_contact(solved):
    """The closure falls as c^(-1/m), and with it the difference: by 10 for a hundred times c."""
    smooth = solved("flange", h=5, without="normal_compliance", **TIGHT)
    apart = [np.abs(solved("flange", h=5, asperities=c, **TIGHT).contact["sigma_n"]
                    - smooth.contact["sigma_n"]).max() for c in (1e14, 1e16)]
    assert apart[1] == pytest.approx(apart[0] / 10, rel=0.1)


@pytest.mark.slow  # many runs, each short
def test_exponent_one_is_the_diagonal_of_the_dual_operator(solved, scene):
    """Tangents of a line are the line: the same tractions as without an exponent."""
    power, line = (solved(scene(text), cells=4, subdomains=3, **TIGHT, **more)
                   for text, more in ((POWER, {"exponent": 1}), (BLOCK, {})))
    np.testing.assert_allclose(power.contact["u_n"], line.contact["u_n"], rtol=1e-8)


@pytest.mark.parametrize("start", [-1.0, 0.0], ids=["in part", "everywhere"])
@pytest.mark.some(1)
def test_exponent_one_pulls_as_no_exponent_does(solved, scene, start):
    """On a bilateral boundary sigma_n = -c (u_n - g) has either sign."""
    change = (("macro load1() pressure(3, 8.) //",
               f"macro displacement1() on(3, u1 = 0., u2 = 0.05*(x + {start})) //"),
              ("macro normalCompliance() c //",
               "macro bilateral() yes //\nmacro normalCompliance() c //"))
    power, line = (solved(scene(text, *change), cells=3, **TIGHT, **more).contact
                   for text, more in ((POWER, {"exponent": 1}), (BLOCK, {})))
    assert line["sigma_n"].max() > 0 and (line["sigma_n"].min() < 0) == (start < 0)
    size = np.abs(line["sigma_n"]).max()
    np.testing.assert_allclose(line["sigma_n"], -100 * (line["u_n"] - line["gap"]),
                               atol=1e-7 * size)
    np.testing.assert_allclose(power["sigma_n"], line["sigma_n"], atol=1e-7 * size)


# into the corner of two rough sides, on one of which the vertex slides as it gives way
CORNER = """include "scene.idp"
real m = physical("exponent", 1.);
subdomains("1x1");
rectangle(0., 1., 0., 1.);
macro young() 200. //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 0.004, u2 = -0.01) //
macro contact() 1, 2 //
macro friction() 0.4 //
macro normalCompliance() (1000.*10^(3*(m - 1))) //
macro normalComplianceExponent() m //
include "export.idp"
"""
SEAT = CORNER.replace("rectangle(0., 1., 0., 1.);", """
border b1(t = -0.5, 2.) {x = t; y = -0.5; label = 14;}
border b2(t = -0.5, 1.) {x = 2.; y = t; label = 15;}
border b3(t = 0., 1.) {x = 2. - t; y = 1.; label = 15;}
border b4(t = 0., 1.) {x = 1.; y = 1. - t; label = 12;}
border b5(t = -1., 0.5) {x = -t; y = 0.; label = 11;}
border b6(t = 0., 0.5) {x = -0.5; y = -t; label = 15;}
addBody(square(4, 4, [x, y]))
bodyMaterial("block", 200., 0.3);
addBody(buildmesh(b1(10) + b2(6) + b3(4) + b4(5) + b5(7) + b6(2)))
bodyMaterial("seat", 2e6, 0.3);
macro support() on(14, u1 = 0., u2 = 0.) //""").replace(
    "macro young() 200. //\nmacro poisson() 0.3 //\n", "").replace(
    "macro contact() 1, 2 //", "macro contactPair() 1, 11, 2, 12 //")


@pytest.mark.parametrize("text, exponent", [
    (CORNER, 1), (CORNER, 2), (SEAT, 1), pytest.param(SEAT, 0.5, marks=pytest.mark.slow)],
    ids=["obstacle-1", "obstacle-2", "pair-1", "pair-0.5"])
@pytest.mark.parametrize("cut", [{"subdomains": 1}, pytest.param({"subdomains": 3},
                                                                 marks=pytest.mark.slow)])
def test_both_sides_of_a_corner_obey_their_laws(solved, scene, text, exponent, cut):
    """p = c (u_n - g)^m and Coulomb's law hold at either node of the vertex, which touches both."""
    cells = {"cells": 4} if text is CORNER else {}
    run = solved(scene(text), exponent=exponent, **cells, **TIGHT, **cut)
    assert run.status == 0, run.reason
    c = {name: values[-1] for name, values in run.contact.items()}
    corner = np.flatnonzero((c["x"] == 1) & (c["y"] == 0))
    assert len(corner) == 2 and (c["sigma_n"][corner] < -0.01).all()
    law = 1000 * 1e3 ** (exponent - 1) * np.maximum(c["u_n"], 0.0) ** exponent
    np.testing.assert_allclose(-c["sigma_n"], law, atol=1e-6 * law.max())
    slides = np.abs(c["slip"]) > 1e-6 * np.abs(c["slip"]).max()
    np.testing.assert_allclose(c["sigma_t"][slides],
                               (0.4 * c["sigma_n"] * np.sign(c["slip"]))[slides],
                               atol=1e-6 * law.max())
    assert slides[corner].all()


@pytest.mark.parametrize("old, new, reason", [
    ("Exponent() m //", "Exponent() 0. //", "normalComplianceExponent is not positive"),
    ("macro normalCompliance() c //", "macro bilateral() yes //\nmacro normalCompliance() c //",
     "is not defined for tension"),
    ("macro normalCompliance() c //\n", "", "without normal compliance")])
def test_misuse_of_exponents_is_refused(solved, scene, old, new, reason):
    run = solved(scene(POWER, (old, new)), cells=2)
    assert run.status == 2 and reason in run.reason and "\n" not in run.reason
