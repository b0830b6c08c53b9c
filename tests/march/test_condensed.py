"""Contact conditions condensed onto their rows: digits where stiffness jumps, friction that slip
changes.
"""

import pytest

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
