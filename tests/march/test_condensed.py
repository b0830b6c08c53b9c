"""Contact conditions condensed onto their rows: digits where stiffness jumps, friction that slip
changes.
"""

import pytest

from driver.errors import NotConverged
from driver.march.fixed_point import FixedPoint
from driver.march.step import Unfinished
from driver.march.step import Load
from driver.qp import complementarity

STACK = """include "scene.idp"
units("m", "Pa");
subdomains("4");
int[int] low = [1, 11, 21, 31], high = [101, 111, 121, 131];
mesh Low = square(14, 4, [1.373*x^4, 0.4557*y], label = low);
mesh High = square(8, 4, [0.0018 + 1.3697*x, 0.4557 + 0.7695*y], label = high);
High = change(High, fregion = 1);
addBody(Low)
addBody(High)
macro planeStress() 1 //
macro young() (region == 0 ? 1e6 : 1.) //
macro poisson() 0.3 //
macro load1() traction(121, 0., -0.0015) //
macro contact() 1 //
macro contactPair() 101, 21 //
macro friction() 0.5 //
include "export.idp"
"""


@pytest.mark.parametrize("cut", ["4", "9"])
def test_a_soft_block_on_a_stiff_one_is_balanced_exactly(built, steps_of, named_scene, cut):
    """Rows differ by 1e7, motions of both bodies are one system's: its LU factors alone leave 1e-9.
    """
    problem = built(scene=named_scene("stack", STACK), subdomains=cut, element="P2")
    solver, steps = steps_of(problem)
    last = steps[-1]
    dense = solver.condensation.problem(
        Load(last.weights, solver.operator.apply(last.multipliers) - last.gradient, 1.0),
        last.multipliers, last.gradient)
    z = complementarity.newton(dense, complementarity.all_alike(dense)[0])
    assert z is not None and dense.violation(z) < 1e-10


DISC = """include "scene.idp"
units("1", "1");
subdomains("1");
real slipRange = 0.005;
border arc(t=pi, 2*pi) { x = 0.8*cos(t); y = 0.8 + 0.8*sin(t); label = 1; }
border top(t=0, 1) { x = 0.8 - 1.6*t; y = 0.8; label = 11; }
body = buildmesh(arc(6) + top(3));
macro planeStress() 1 //
macro young() (y < 0.3934 ? 1.0 : 0.001) //
macro poisson() 0.2 //
macro load1() traction(11, -4.7e-6, -1.6e-4) //
macro contact() 1 //
macro gap() 0.005*x^2 //
macro friction() 0.5 //
macro slipFactor(s) (1. + 0.3*s/slipRange) //
include "export.idp"
"""


def test_slip_of_a_free_body_is_found_with_its_own_friction(built, steps_of, named_scene,
                                                            monkeypatch):
    """Soft material holds the springs: the last digit of a friction force moves the body visibly.

    Forces stay those that balance, at the friction they were found with; open nodes have none.
    """
    def condensed(self, index, load, x, gradient, sliding, trace, rtol):
        return self.condensed(index, load, x, gradient, sliding, trace, rtol)

    monkeypatch.setattr(FixedPoint, "find", condensed)
    problem = built(scene=named_scene("disc", DISC), element="P2")
    solver, steps = steps_of(problem, rtol=1e-10, friction_rtol=1e-8)
    assert solver.failure is None
    assert max(steps[-1].residuals.values()) <= 1e-6


def test_forces_that_hide_the_loads_are_no_start(built, steps_of, named_scene, monkeypatch):
    """Friction that jams lets forces balance at any size: the step begins once more without them.
    """
    calls = []

    def astray(self, index, load, x, gradient, sliding, trace, rtol):
        calls.append(rtol)
        if len(calls) > 1:
            raise Unfinished(NotConverged("lost in rounding"), calls[0], None)
        calls[0] = 1e6 * (1.0 + x)
        return calls[0], None, sliding

    monkeypatch.setattr(FixedPoint, "find", astray)
    solver, steps = steps_of(built(scene=named_scene("disc", DISC), element="P2"), rtol=1e-10)
    assert solver.failure is None and len(calls) == 2
    assert max(steps[-1].residuals.values()) <= 1e-6
