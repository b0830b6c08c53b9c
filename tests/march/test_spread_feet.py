"""An arch on two feet that spread: friction of both is used up but for a node."""

import pytest

ARCH = """include "scene.idp"
units("mm", "MPa");
real h = meshSize(0.8);
func real n(real l) { return max(1., rint(l/h)); }
border footL(t=-20, -14) { x = t; y = 0; label = 1; }
border inner(t=pi, 0) { x = 14*cos(t); y = 14*sin(t); label = 2; }
border footR(t=14, 20) { x = t; y = 0; label = 3; }
border outer(t=0, pi) { x = 20*cos(t); y = 20*sin(t); label = 4; }
body = buildmesh(footL(n(6)) + inner(n(44)) + footR(n(6)) + outer(n(63)));
macro young() 2000. //
macro poisson() 0.25 //
macro load1() traction(4, 0., -(abs(x) < 5 ? 3. : 0.)) //
macro contact() 1, 3 //
macro friction() 0.35 //
include "export.idp"
"""


@pytest.mark.slow
@pytest.mark.parametrize("cut", [1, 4])
def test_feet_of_more_nodes_than_are_searched_come_to_rest(solved, named_scene, cut):
    """94 contact nodes, of which twenty touch: thrust is friction on both feet."""
    run = solved(named_scene("arch", ARCH), h=0.26, element="P2", subdomains=cut, rtol=1e-9,
                 friction_rtol=1e-8, primal_rtol=1e-7, uniqueness="no")
    assert run.status == 0 and run.summary["residuals"]["equilibrium"] < 1e-7
    forces = run.summary["quantities"]
    slides = 0.35 * forces["normal_resultant"]
    assert forces["tangential_resultant"] == pytest.approx(slides, rel=1e-3)
    assert forces["normal_resultant"] == pytest.approx(30.0, rel=0.01)
