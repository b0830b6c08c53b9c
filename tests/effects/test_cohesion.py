"""Friction with cohesion, |sigma_t| <= c + F |sigma_n|: closed forms, the law at every node."""

import numpy as np
import pytest

LENGTH, PRESSURE = 2.0, 10e6  # of the pad in edp/cohesion.edp
TIGHT = {"rtol": 1e-11, "friction_rtol": 1e-10}

# a block under uniform pressure p and shear t, which contact alone carries: sides in equilibrium,
# base stress uniform
BLOCK = """include "scene.idp"
real c = physical("cohesion", 3.), F = physical("friction", 0.2);
real t = physical("shear", 4.), p = 10.;
subdomains("2x2");
rectangle(0., 1., 0., 1.);
macro young() 1e5 //
macro poisson() 0.3 //
macro sigmaX() (-0.3/0.7*p) //
macro load1() traction(3, t, -p) + traction(2, sigmaX, t) + traction(4, -sigmaX, -t) //
macro contact() 1 //
macro friction() F //
macro cohesion() c //
include "export.idp"
"""


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """Path of the block."""
    path = tmp_path_factory.mktemp("block") / "block.edp"
    path.write_text(BLOCK)
    return path


@pytest.mark.parametrize("options", [{}, {"subdomains": 3}, {"element": "P2"},
                                     pytest.param({"np": 2}, marks=pytest.mark.slow),
                                     {"friction": 0}])
@pytest.mark.some(1)
def test_sliding_base_carries_what_the_law_says(solved, options):
    """c L + F N, however the pressure is distributed; solved to 1e-10 of the pressures."""
    run = solved("cohesion", cells=6, **TIGHT, **options)
    friction = options.get("friction", 0.3)
    assert np.all(run.contact["status"][-1] != "stick")
    assert run.summary["quantities"]["normal_resultant"] == pytest.approx(
        PRESSURE * LENGTH, rel=1e-8)
    expected = 2e6 * LENGTH + friction * PRESSURE * LENGTH
    assert -run.summary["quantities"]["tangential_resultant"] == pytest.approx(expected, rel=1e-7)


def test_the_law_holds_at_every_node(solved):
    """bound = c + F |sigma_n|; inside it nothing slips, on it slip dissipates."""
    run = solved("cohesion", cells=6, **TIGHT)
    c = run.contact
    np.testing.assert_allclose(c["bound"], 2e6 + 0.3 * np.abs(c["sigma_n"]), rtol=1e-12)
    force, way = np.abs(c["sigma_t"]).max(), np.abs(c["slip"]).max()
    assert np.all(np.abs(c["sigma_t"]) <= c["bound"] + 1e-9 * force)
    inside = np.abs(c["sigma_t"]) < c["bound"] - 1e-6 * force
    assert inside.any() and np.abs(c["slip"][inside]).max() < 1e-7 * way
    assert np.all(c["sigma_t"] * c["slip"] <= 1e-7 * force * way)  # sticking nodes: the tolerance


@pytest.mark.parametrize("law", ["tresca", "cohesion"])
@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.some(2)
def test_a_strength_is_a_stress_wherever_it_acts(solved, tmp_path, law, element):
    """Also at a node that a roller holds along the boundary, and at the end of a boundary, where
    the dual segment is a half: the bound is the strength that the scene declares, plus F |sigma_n|.
    """
    text = BLOCK.replace("macro load1() traction(3, t, -p) + traction(2, sigmaX, t) + "
                         "traction(4, -sigmaX, -t) //",
                         "macro support() on(4, u1 = 0.) //\n"
                         "macro load1() traction(3, 0., -p*(1. + x)) //")
    text = text.replace("macro sigmaX() (-0.3/0.7*p) //\n", "")
    assert "sigmaX" not in text
    if law == "tresca":
        text = text.replace("macro friction() F //\nmacro cohesion()", "macro tresca()")
    path = tmp_path / "roller.edp"
    path.write_text(text.replace("() c //", "() (c + x) //"))
    run = solved(path, cells=3, element=element, friction=0.2, cohesion=3, **TIGHT)
    assert run.status == 0, run.reason
    c = run.contact
    assert c["x"].min() == 0.0  # the roller's
    # the mean of c + x over a dual segment is its value in the middle of the segment
    own = c["bound"] - (0.2 * np.abs(c["sigma_n"]) if law == "cohesion" else 0)
    assert np.abs(own - 3 - c["x"]).max() <= 1 / 12 * 1.001
    np.testing.assert_allclose((own * c["weight"])[-1].sum(), 3.5, rtol=1e-12)


@pytest.mark.slow  # two runs
def test_no_cohesion_is_coulombs_law(solved):
    """c = 0 and a scene without the declaration give the same tractions."""
    nothing, undeclared = (solved("cohesion", cells=4, steps=6, **TIGHT, **options)
                           for options in ({"cohesion": 0}, {"without": "cohesion"}))
    assert nothing.summary["effects"]["cohesion"]
    assert "cohesion" not in undeclared.summary["effects"]
    for name in ("sigma_n", "sigma_t"):
        size = np.abs(undeclared.contact[name]).max()
        np.testing.assert_allclose(nothing.contact[name], undeclared.contact[name],
                                   atol=1e-8 * size)


@pytest.mark.parametrize("shear, carried", [(4.9, True), (5.1, False)])
def test_limit_of_a_body_that_contact_alone_holds(solved, block, shear, carried):
    """Under uniform stress p = 10, t contact carries t up to c + F p = 5 and no more."""
    run = solved(block, cells=3, shear=shear, **TIGHT)
    if carried:
        assert run.status == 0
        np.testing.assert_allclose(run.contact["sigma_t"][-1], -shear, rtol=1e-6)
        np.testing.assert_allclose(run.contact["sigma_n"][-1], -10.0, rtol=1e-6)
    else:
        assert run.status == 3 and "no equilibrium" in run.reason


def test_negative_cohesion_and_cohesion_without_friction_are_refused(solved, block, tmp_path):
    assert "cohesion is negative" in solved(block, cells=3, cohesion=-1).reason
    alone = tmp_path / "alone.edp"
    alone.write_text(BLOCK.replace("macro friction() F //\n", ""))
    run = solved(alone, cells=3)
    assert run.status == 2 and "friction" in run.reason
