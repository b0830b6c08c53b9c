"""Archard's wear: k N S in full slip, level pressure, order in the time step, the law, misuse."""

import numpy as np
import pytest

TIGHT = {"rtol": 1e-10, "friction_rtol": 1e-9, "primal_rtol": 1e-8}

# a block, nearly rigid, that slides under a given force, as a whole from the first step on
RIGID = """include "scene.idp"
real k = physical("k", 1e-12);
subdomains("2x2");
rectangle(-1., 1., 0., 1.);
macro young() 1e9 //
macro poisson() 0.3 //
quasistatic(2.);
macro load1() pressure(3, 5.) //
macro displacement2() on(3, u1 = 3.) //
macro amplitude1(t) min(1., t) //
macro amplitude2(t) max(0., t - 1.) //
macro contact() 1 //
macro friction() 0.3 //
macro wear() k //
include "export.idp"
"""
# one that slides on another, of revolution about a far axis or plane
PAIR = """include "scene.idp"
int[int] above = [5, 6, 7, 8];
addBody(square(7, 3, [3.*x, y - 1.]))
addBody(square(4, 3, [0.5 + x, y], label = above))
macro young() 1e3 //
macro poisson() 0.3 //
quasistatic(2.);
macro support() on(1, u1 = 0., u2 = 0.) //
macro displacement1() on(7, u1 = 0., u2 = -0.01) //
macro displacement2() on(7, u1 = 0.2, u2 = 0.) //
macro amplitude1(t) min(1., t) //
macro amplitude2(t) max(0., t - 1.) //
macro contactPair() 5, 3 //
macro friction() 0.3 //
macro wear() 1e-3 //
include "export.idp"
"""
# a periodic strip whose obstacle moves on by less than what friction holds, under less pressure
HELD = """include "scene.idp"
subdomains("2x1");
rectangle(0., 2., 0., 2.);
macro young() 1000. //
macro poisson() 0.3 //
quasistatic(3.);
macro periodic() 4, 2 //
macro displacement1() on(3, u1 = 0., u2 = -0.01) //
macro amplitude1(t) (t < 1.5 ? 0. : (t < 2.5 ? 2. : 1.4)) //
macro contact() 1 //
macro gap() 0.004 //
macro obstacleX(t) (t < 2.5 ? 0. : 0.007) //
macro friction() 0.3 //
macro wear() 1. //
include "export.idp"
"""


def test_what_sticks_in_a_step_wears_nothing(solved, scene):
    """Pressure M eps and shear G gamma of a strip that sticks: M 0.01/2 and G 0.007/2.

    With the slip that the prediction of the step has, the wear of that slip would take the pressure
    that holds the strip: a second solution of the same step, which no history leads to.
    """
    contact = solved(scene(HELD), cells=2, steps=3, **TIGHT).contact
    G, M = 1000 / 2.6, 1000 * 0.7 / (1.3 * 0.4)
    np.testing.assert_allclose(contact["sigma_n"][-1], -0.005 * M, rtol=1e-7)
    np.testing.assert_allclose(np.abs(contact["sigma_t"][-1]), 0.0035 * G, rtol=1e-6)
    assert contact["wear"].max() < 1e-9


def test_full_slip_wears_off_knS(solved, scene):
    """k N S to 1e-6: wear so small that pressures stay, bodies so stiff that slip is the way."""
    run = solved(scene(RIGID), cells=3, steps=4, **TIGHT)
    assert run.summary["quantities"]["worn_volume"] == pytest.approx(1e-12 * 10 * 3, rel=1e-6)
    assert run.summary["effects_ledger"]["wear"]["active"]


@pytest.mark.parametrize("options", [{}, pytest.param(  # further meshes
    {"element": "P2", "subdomains": 5, "np": 2}, marks=pytest.mark.slow)])
def test_the_law_holds_at_every_node_and_step(solved, options):
    """What wears off in a step is k |slip| p, and where a node presses u_n = gap + wear."""
    run = solved("worn-pad", cells=3, steps=8, **TIGHT, **options)
    c = run.contact
    step = np.diff(np.vstack([0 * c["wear"][:1], c["wear"]]), axis=0)
    law = 1e-4 * np.abs(c["slip"]) * -c["sigma_n"]
    assert law.max() > 1e-3 and np.abs(step - law).max() < 1e-6 * law.max()
    presses, depth = c["sigma_n"] < 0, c["u_n"] - c["gap"] - c["wear"]
    assert np.abs(depth[presses]).max() < 1e-7 * c["wear"].max()
    assert depth.max() < 1e-7 * c["wear"].max()
    volume = (c["wear"][-1] * c["weight"][-1]).sum()
    assert run.summary["quantities"]["worn_volume"] == pytest.approx(volume, rel=1e-12)


def test_wear_levels_the_pressure(solved):
    """p = N/2a to 0.1 % after a way that wears off far more than the lining is compressed by."""
    run = solved("worn-pad", cells=3, steps=12, stroke=4000)
    first, last = -run.contact["sigma_n"][5], -run.contact["sigma_n"][-1]
    assert np.ptp(first) > 0.2 * first.mean()
    np.testing.assert_allclose(last, run.history["resultant_n"][-1] / -20, rtol=1e-3)
    np.testing.assert_allclose(last, 5.0, rtol=1e-3)


@pytest.mark.slow  # a series of runs
def test_the_worn_volume_is_of_first_order_in_the_step(solved):
    """Halved steps halve the difference to the next: order 1."""
    volumes = [solved("worn-pad", cells=3, steps=n, stroke=100, **TIGHT)
               .summary["quantities"]["worn_volume"] for n in (8, 16, 32, 64)]
    change = np.diff(volumes)
    np.testing.assert_allclose(np.log2(change[:-1] / change[1:]), 1.0, atol=0.15)


@pytest.mark.slow  # two runs more
@pytest.mark.parametrize("change", ["", "macro axisymmetric() 1 //\n"])
def test_between_bodies_and_of_revolution(solved, scene, change):
    """The law at every node; the volume is that of the revolution, weights being areas."""
    run = solved(scene(PAIR, ("macro young", change + "macro young")), steps=6, **TIGHT)
    c = run.contact
    step = np.diff(np.vstack([0 * c["wear"][:1], c["wear"]]), axis=0)
    law = 1e-3 * np.abs(c["slip"]) * -c["sigma_n"]
    assert np.abs(step - law).max() < 1e-6 * law.max() and law.max() > 0
    presses = c["sigma_n"] < 0
    assert np.abs((c["u_n"] - c["gap"] - c["wear"])[presses]).max() < 1e-6 * c["wear"].max()


@pytest.mark.parametrize("old, new, reason", [
    ("macro friction() 0.3 //\n", "", "wear is declared without friction"),
    ("macro wear() k //", "macro wear() -1e-3 //", "wear is negative")])
def test_misuse_is_refused_in_one_line(solved, scene, old, new, reason):
    run = solved(scene(RIGID, (old, new)), cells=2)
    assert run.status == 2 and reason in run.reason and "\n" not in run.reason


@pytest.mark.slow  # wear without wear: a run more
def test_no_wear_is_no_wear(solved, scene):
    """k = 0 gives what the scene gives without wear, to the tolerance."""
    none, without = (solved(scene(RIGID), cells=3, steps=4, k=0, **TIGHT),
                     solved(scene(RIGID), cells=3, steps=4, without="wear", **TIGHT))
    assert not none.contact["wear"].any()
    for name in ("sigma_n", "u_n"):
        np.testing.assert_allclose(none.contact[name], without.contact[name],
                                   atol=1e-7 * np.abs(without.contact[name]).max())


def test_contact_that_pulls_wears_nothing(solved, scene):
    """An obstacle slides along a bilateral boundary, one half of which is pulled by its support."""
    text = RIGID.replace("1e9", "1e3")
    text = text.replace("subdomains(", "macro bilateral() yes //\nsubdomains(")
    text = text.replace("macro load1() pressure(3, 5.) //",
                        "macro displacement1() on(3, u1 = 0., u2 = 0.01*x) //")
    text = text.replace("macro displacement2() on(3, u1 = 3.) //",
                        "macro obstacleX(t) 9.*(t > 1.) //")
    text = text.replace("macro amplitude2(t) max(0., t - 1.) //\n", "")
    c = solved(scene(text), cells=4, steps=4, k=1e-4, **TIGHT).contact
    pulls = c["sigma_n"] > 1e-3 * np.abs(c["sigma_n"]).max()
    assert pulls[-1].sum() > 2 and c["wear"].max() > 1e-4 and not c["wear"][pulls & (
        np.cumsum(~pulls, axis=0) == 0)].any()
    away = c["u_n"] - c["gap"] - c["wear"]
    assert np.abs(away).max() < 1e-6 * c["wear"].max()


def test_a_worn_boundary_that_turns_to_pulling_stays_where_it_has_worn(solved, scene):
    """It slides, pressed, by far more than it wears, and is pulled in the next step: from where the
    last tangent of the law was taken no force may be left in it.
    """
    text = RIGID.replace("1e9", "200.")
    text = text.replace("subdomains(", "macro bilateral() yes //\nsubdomains(")
    for old, new in (("macro load1() pressure(3, 5.)", "macro displacement1() on(3, u2 = -0.05)"),
                     ("on(3, u1 = 3.)", "on(3, u1 = 0.5)"),
                     ("macro amplitude1(t) min(1., t)", "macro amplitude1(t) (1.5 - t)"),
                     ("macro amplitude2(t) max(0., t - 1.)", "macro amplitude2(t) (t - 1.)")):
        assert old in text
        text = text.replace(old, new)
    c = solved(scene(text), cells=3, steps=2, k=0.1, **TIGHT).contact
    assert (c["sigma_n"][0] < 0).all() and c["sigma_n"][1].min() > 0 and c["wear"][1].max() > 1e-4
    np.testing.assert_array_equal(c["wear"][1], c["wear"][0])  # the block is brought back to x = 0
    assert np.abs(c["u_n"] - c["gap"] - c["wear"]).max() < 1e-7 * np.abs(c["u_t"]).max()


@pytest.mark.parametrize("more", ["", "macro largeSliding() 20. //"], ids=["fixed", "following"])
def test_worn_contact_lifts_off(solved, named_scene, more):
    """Pressed, dragged over a plane, lifted: an open node may stay as far beyond the gap as it has
    worn, also where contact follows the motion.
    """
    text = """include "scene.idp"
units("mm", "MPa");
border b(t=0, 1) { x = 2.*t; y = 0.; label = 1; }
border r(t=0, 1) { x = 2. - 0.3*t; y = t; label = 2; }
border c(t=0, 1) { x = 1.7 - 1.2*t; y = 1.; label = 3; }
border l(t=0, 1) { x = 0.5 - 0.5*t; y = 1. - t; label = 4; }
body = buildmesh(b(8) + r(4) + c(5) + l(4));
quasistatic(3.);
macro stepTimes() [1., 2.] //
macro young() 1000. //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = 0., u2 = -0.01) //
macro amplitude1(t) (t < 1. ? t : (t < 2. ? 1. : 1. - 1.2*(t - 2.))) //
macro contact() 1 //
macro obstacleX(t) (5.*max(0., min(t, 2.) - 1.)) //
macro friction() 0.3 //
macro wear() 1e-4 //
{more}
include "export.idp"
"""
    run = solved(named_scene(f"lifts-{len(more)}", text.replace("{more}", more)), steps=12)
    assert run.status == 0, run.reason
    c = run.contact
    assert not c["sigma_n"][-1].any() and c["wear"][-1].max() > 0
    worn = c["wear"][-1] @ c["weight"][-1]
    assert run.summary["quantities"]["worn_volume"] == pytest.approx(worn, rel=1e-12)


CORNERS = """include "scene.idp"
units("mm", "MPa");
border b0(t=0, 1) { x = -4*(1 - t); y = 3*(1 - t); label = 11; }
border b1(t=0, 1) { x = 5*t; y = 2*t; label = 4; }
border b2(t=0, 1) { x = 5; y = 2 + 4*t; label = 9; }
border b3(t=0, 1) { x = 5 - 9*t; y = 6; label = 2; }
border b4(t=0, 1) { x = -4; y = 6 - 3*t; label = 30; }
body = buildmesh(b0(9) + b1(11) + b2(6) + b3(12) + b4(5));
macro young() 700. //
macro poisson() 0.35 //
quasistatic(4.);
macro contact() 11, 4, 9 //
macro friction() (label == 11 ? 0.4 : (label == 4 ? 0.2 : 0.1)) //
macro gap() (label == 9 ? 0.003 : 0.) //
macro load1() pressure(2, 4.) //
macro load2() traction(2, 1.5, 0.3) //
macro amplitude1(t) (t < 1 ? t : 1 - 0.2*(t - 1)) //
macro amplitude2(t) (t < 1 ? 0. : sin(pi*(t - 1))) //
macro stepTimes() [1., 1.5, 2.5, 3.5] //
macro foundation() 30 //
macro foundationNormal() 1. //
macro foundationTangential() 0.3 //
macro wear() 4e-3 //
macro obstacleX(t) (label == 11 ? 0.02*max(0., t - 1) : 0.) //
macro obstacleY(t) (label == 11 ? 0.015*max(0., t - 1) : 0.) //
include "export.idp"
"""


@pytest.mark.parametrize("subdomains", ["1", "7"])
@pytest.mark.slow
def test_a_vertex_between_worn_sides_goes_as_friction_lets_it(solved, tmp_path, subdomains):
    """In step 11 the vertex of labels 4 and 9 slides, and is short of its wall. The first tangents
    of the law have it in its corner, which it must not keep. Values of a program of its own, that
    tries the states of all nodes with the wear of the step.
    """
    path = tmp_path / "corners.edp"
    path.write_text(CORNERS)
    c = solved(path, subdomains=subdomains).contact
    own = (c["x"][10] == 5) & (c["y"][10] == 2)
    slides, wall = ((c["boundary"][10] == label) & own for label in (4, 9))
    assert c["slip"][10, slides] == pytest.approx(0.000948, rel=2e-3)
    assert c["sigma_t"][10, slides] == pytest.approx(-1.7299, rel=1e-3)
    assert c["u_n"][10, wall] == pytest.approx(0.001309, rel=2e-3)
    assert c["status"][10, wall] == "open"
