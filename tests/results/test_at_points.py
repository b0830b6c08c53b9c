"""summary.json knows the places of loads and springs at points."""

import pytest

SCENE = """include "scene.idp"
body = square(6, 3, [2*x, y]);
macro young() 1e3 //
macro poisson() 0.3 //
macro foundation() 1 //
macro foundationNormal() 10. //
macro foundationTangential() 10. //
macro pointSpring() [0., 1., 2., 0.] //
macro pointLoad1() [2., 1., 0., -3.] //
macro pointLoad2() [1., 0., 0., 0.25] //
include "export.idp"
"""


@pytest.mark.parametrize("cut, element", [(1, "P2"), (5, "P1")])
def test_points_are_where_the_scene_has_them(solved, named_scene, cut, element):
    """Once each, however the body is cut; what the foundation holds are no springs at points."""
    run = solved(named_scene("points", SCENE), subdomains=cut, element=element)
    found = sorted(run.summary["points"], key=lambda point: point["place"])
    assert [(p["effect"], p["number"], p["place"], p["value"]) for p in found] == [
        ("springs", 0, [0.0, 1.0], [2.0, 0.0]), ("point_load", 2, [1.0, 0.0], [0.0, 0.25]),
        ("point_load", 1, [2.0, 1.0], [0.0, -3.0])]


def test_a_run_without_any_has_none(solved):
    assert solved("model", STEPS=2, CELLS=3).summary["points"] == []
