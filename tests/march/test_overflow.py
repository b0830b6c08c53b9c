"""Numbers of a scene that leave no room for squares are refused with a line."""

SOFT = """include "scene.idp"
rectangle(0., 2., 0., 1.);
macro young() 1e-200 //
macro poisson() 0.3 //
macro support() on(3, u1 = 0., u2 = 0.) //
macro contact() 1 //
macro friction() 0.3 //
include "export.idp"
"""


def test_moduli_too_small_to_square_displacements_are_the_scenes_mistake(solved, named_scene):
    """It was said to be a defect of the suite."""
    run = solved(str(named_scene("soft", SOFT)), subdomains="2x1", cells=2)
    assert run.status == 2 and run.reason.startswith("moduli,") and "are so small" in run.reason
