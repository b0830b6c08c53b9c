"""Laws of friction boundary by boundary: each label its own, in one scene."""

import numpy as np
import pytest

# a block with three feet on a floor, pressed down and dragged along:
# the label of each foot has a law of its own
FLOOR = """include "scene.idp"
real h = meshSize(0.25), drag = physical("drag", 0.05);
border one(t = 0, 1) { x = t; y = 0; label = 21; }
border between(t = 0, 1) { x = 1 + 0.5*t; y = 0.5*sin(pi*t); label = 5; }
border two(t = 0, 1) { x = 1.5 + t; y = 0; label = 4; }
border beyond(t = 0, 1) { x = 2.5 + 0.5*t; y = 0.5*sin(pi*t); label = 5; }
border three(t = 0, 1) { x = 3 + t; y = 0; label = 33; }
border right(t = 0, 1) { x = 4; y = t; label = 2; }
border top(t = 0, 1) { x = 4 - 4*t; y = 1; label = 3; }
border left(t = 0, 1) { x = 0; y = 1 - t; label = 9; }
int n = rint(1/h);
addBody(buildmesh(one(n) + between(n) + two(n) + beyond(n) + three(n) + right(n) + top(4*n)
                  + left(n)))
bodyMaterial("block", 1e3, 0.3);
subdomains("1");
quasistatic(1.);
macro displacement1() on(3, u1 = drag, u2 = -0.02) //
macro amplitude1(t) t //
macro contact() 21, 4, 33 //
macro friction() (label == 21 ? 0.3 : 0.) //
macro tresca() (label == 4 ? 2. : 0.) //
include "export.idp"
"""


@pytest.fixture
def floor(tmp_path):
    """floor(old, new): path of the scene with a line replaced."""
    def make(old: str = "", new: str = ""):
        assert old in FLOOR
        path = tmp_path / "floor.edp"
        path.write_text(FLOOR.replace(old, new))
        return path
    return make


@pytest.mark.parametrize("options", [{}, {"subdomains": 5}, {"element": "P2", "subdomains": 3}])
@pytest.mark.some(1)
def test_coulomb_tresca_and_none_side_by_side(solved, floor, options):
    """At full sliding 0.3 p, 2 and 0, node by node, to the tolerance of the fixed point."""
    run = solved(floor(), steps=4, rtol=1e-11, friction_rtol=1e-10, **options)
    assert run.summary["effects"]["friction"] == "coulomb and tresca"
    x, pressed = run.contact["x"][-1], run.contact["status"][-1] != "open"
    t, n = run.contact["sigma_t"][-1], run.contact["sigma_n"][-1]
    one, two, three = (pressed & (x > low) & (x < low + 1.2) for low in (-0.1, 1.4, 2.9))
    assert one.sum() > 2 and two.sum() > 2 and three.sum() > 2
    np.testing.assert_allclose(t[one], 0.3 * n[one], atol=1e-8 * np.abs(n).max())
    np.testing.assert_allclose(t[two], -2.0, rtol=1e-9)
    assert not t[three].any()


def test_two_laws_on_one_label_are_refused(solved, floor):
    run = solved(floor("label == 4 ? 2.", "label != 33 ? 2."))
    assert run.status == 2
    assert "friction and tresca are both positive on label 21" in run.reason


def test_cohesion_where_a_bound_is_given_is_refused(solved, floor):
    run = solved(floor("macro tresca()", "macro cohesion() 1. //\nmacro tresca()"))
    assert run.status == 2
    assert "cohesion and tresca are both positive on label 4" in run.reason
