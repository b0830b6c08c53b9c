"""A preload is solved as if its scene had no friction, whatever friction depends on later."""

PRESSED = """include "scene.idp"
real slipRange = 1.;
body = square(12, 6, [2.*x, y + 0.02*x*y]);
quasistatic(1.);
macro young() 100. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro contact() 1 //
macro friction() 0.3 //
macro load1() pressure(3, 2.) + traction(2, 0., 0.2) //
macro preload() 1 //
{law}
include "export.idp"
"""


def test_a_law_of_slip_leaves_the_preload_to_newtons_method(solved, named_scene):
    """It has no friction that could change. Motions that rows hardly feel are exact with it alone:
    a ring in another turned by 4e-4 of the largest displacement more or less, by the cut.
    """
    def iterated(name, law):
        run = solved(str(named_scene(name, PRESSED.format(law=law))), steps=1, subdomains=5)
        log = run.directory / "convergence.csv"  # none without iterations
        rows = log.read_text().splitlines()[1:] if log.exists() else []
        return [row for row in rows if row.split(",")[1] == "0"]  # before the first step

    assert not iterated("constant", "")
    assert not iterated("changing", "macro displacementFactor(s) 1. //")
