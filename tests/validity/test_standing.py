"""Bodies that stand on flat feet, and those that roll, against Euler's load of a column."""

import pytest

FOOT = '''include "scene.idp"
units("mm", "MPa");
real share = physical("share", 1.2), L = 20., critical = pi^2*1000./12./(4.*L^2);
int[int] sides = [11, 12, 13, 14];
addBody(square(1, 20, [x, L*y], label = sides))
macro young() 1000. //
macro poisson() 0. //
macro load1() traction(13, 0., -share*critical) //
macro contact() 11 //
macro friction() 0.3 //
include "export.idp"
'''
ON_A_BODY = FOOT.replace("macro young", """int[int] others = [1, 2, 3, 4];
addBody(square(8, 4, [-5 + 11*x, -5 + 5*y], label = others))
macro young""").replace("macro young() 1000.", "macro young() (y < 0. ? 1e5 : 1000.)").replace(
    "contact() 11 //", "contact() 1 //\nmacro contactPair() 11, 3 //")
ON_A_ROLLER = ON_A_BODY.replace("addBody(square(8", """border bend(t = pi, 2*pi) {
    x = 0.5 + 5.5*cos(t); y = 5.5*sin(t); label = 1; }
border top(t = 1, -1) { x = 0.5 + 5.5*t; y = 0.; label = 3; }
addBody(buildmesh(bend(24) + top(8)))
//""").replace("macro friction", "macro obstacle(x, y) y + 5.5 //\nmacro friction")


@pytest.fixture(scope="module")
def validity(solved, tmp_path_factory):
    """What a run of a scene's text says of its assumptions."""
    def get(text, **options):
        path = tmp_path_factory.mktemp("standing") / "column.edp"
        path.write_text(text)
        return solved(str(path), element="P2", errors="energy", **options).summary["validity"]
    return get


@pytest.mark.parametrize("text", [FOOT, ON_A_BODY], ids=["on the floor", "on a body"])
def test_a_column_that_only_stands_buckles_as_a_clamped_one(validity, text):
    """With 1.2 of Euler's load, of which nothing was said. Its foot is pressed everywhere and
    sticks; shear, L = 20 t, takes off some thousandths.
    """
    valid = validity(text)
    assert valid["buckling"] == pytest.approx(1.2, rel=0.02) and valid["verdict"] == "invalid"


@pytest.mark.parametrize("text", [
    FOOT.replace("friction() 0.3", "friction() 0."), ON_A_ROLLER], ids=["slides", "on a roller"])
def test_what_slides_or_stands_on_a_roller_is_not_looked_at(validity, text):
    """Nothing keeps the foot where it is, or what it stands on from turning."""
    assert not validity(text)["buckling"]


def test_a_part_of_eulers_load_is_told_for_any_cut(validity):
    """Three subdomains, one of which has the foot."""
    valid = validity(FOOT, share=0.3, subdomains=3)
    assert valid["buckling"] == pytest.approx(0.3, rel=0.02) and valid["verdict"] == "ok"
