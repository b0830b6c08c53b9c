"""Bodies that move and nothing deforms them: the answer is no force at all, not rounding; and
friction that needs no pressure is a force even so.
"""

import numpy as np
import pytest

from driver.errors import NotConverged
from driver.march.fixed_point import FixedPoint
from driver.march.step import Unfinished

BOXES = """include "scene.idp"
units("m", "Pa");
subdomains("2");
quasistatic(1.);
int[int] low = [1, 2, 3, 4];
int[int] top = [11, 12, 13, 14];
mesh Ta = square(4, 3, [2.*x, 1.*y], label = low);
mesh Tb = square(3, 3, [0.3 + 1.1*x, 1. + 0.8*y], label = top);
Tb = change(Tb, fregion = 1);
addBody(Ta)
addBody(Tb)
macro young() (region == 0 ? 1e3 : 1.)*1e9 //
macro poisson() 0.3 //
macro displacement1() on(13, u1 = 0.3, u2 = -0.1) //
macro amplitude1(t) t //
macro contact() 1 //
macro contactPair() 11, 3 //
macro gap() 0.2 //
macro friction() 0.3 //
include "export.idp"
"""
SINKING = """include "scene.idp"
units("m", "Pa");
subdomains("4");
quasistatic(1.);
int[int] low = [1, 11, 21, 31];
mesh Ta = square(5, 2, [3.024*x, 1.0366*y], label = low);
border b0(t=0, 1) { x = 1.253154 + 1.654732*t; y = 1.0366; label = 101; }
border b1(t=0, 1) { x = 2.907886; y = 1.0366 + 1.289*t; label = 111; }
border b2(t=0, 1) { x = 2.907886 - 1.654732*t; y = 2.3256; label = 121; }
border b3(t=0, 1) { x = 1.253154; y = 2.3256 - 1.289*t; label = 131; }
mesh Tb = buildmesh(b0(9) + b1(7) + b2(9) + b3(7));
border c0(t=0, 1) { x = 1.538026 + 1.401062*t; y = 2.3256; label = 201; }
border c1(t=0, 1) { x = 2.939088; y = 2.3256 + 0.8062*t; label = 211; }
border c2(t=0, 1) { x = 2.939088 - 1.401062*t; y = 3.1318; label = 221; }
border c3(t=0, 1) { x = 1.538026; y = 3.1318 - 0.8062*t; label = 231; }
mesh Tc = buildmesh(c0(7) + c1(4) + c2(7) + c3(4));
Tb = change(Tb, fregion = 1);
Tc = change(Tc, fregion = 2);
addBody(Ta)
addBody(Tb)
addBody(Tc)
macro young() 200e9 //
macro poisson() 0. //
macro displacement1() on(221, u1 = 0., u2 = -0.03) //
macro amplitude1(t) (1. - abs(2*t - 1.)) //
macro contact() 1 //
macro contactPair() 21, 101, 201, 121 //
macro gap() 0.2 //
macro friction() 0.5 //
include "export.idp"
"""
SHELF = """include "scene.idp"
units("m", "Pa");
subdomains("1");
quasistatic(1.);
border a(t=0, 1) { x = 0.3 + 1.9*t; y = 0.1 - 0.2*t; label = 1; }
border b(t=0, 1) { x = 2.2; y = -0.1 + t; label = 2; }
border c(t=0, 1) { x = 2.2 - 1.9*t; y = 0.9 + 0.17*t; label = 3; }
border d(t=0, 1) { x = 0.3; y = 1.07 - 0.97*t; label = 4; }
body = buildmesh(a(7) + b(4) + c(6) + d(5));
macro young() 1e6 //
macro poisson() 0.3 //
macro displacement1() on(4, u1 = 0., u2 = 0.1) //
macro amplitude1(t) t //
macro contact() 2 //
macro tresca() 50. //
include "export.idp"
"""
LID = """include "scene.idp"
units("m", "Pa");
subdomains("2x1");
quasistatic(1.);
rectangle(0., 2., 0., 1.);
macro young() 1. //
macro poisson() 0.2 //
macro support() on(3, u1 = 0.) //
macro load1() traction(3, 0., -1e-4) //
macro load2() traction(3, 1e-5, 0.) //
macro amplitude1(t) sin(2*pi*t) //
macro amplitude2(t) t*(2.5 - 2.*t) //
macro contact() 1 //
macro friction() 0.2 //
include "export.idp"
"""
TIGHT = {"rtol": 1e-10, "friction_rtol": 1e-8}


@pytest.mark.parametrize("cut", [2, 7])
@pytest.mark.parametrize("lid", ["t", "0.5*t*t - t", "min(1., 2.*t)"], ids=["down", "up", "stops"])
@pytest.mark.some(1)
def test_boxes_carried_through_the_air_feel_nothing(built, steps_of, named_scene, lid, cut):
    """A soft one is moved by its lid and pushes a stiff one, both without weight, down a gap; or
    leaves it behind, or both stop.
    """
    text = BOXES.replace("amplitude1(t) t", f"amplitude1(t) {lid}")
    problem = built(scene=named_scene(f"boxes{len(lid)}", text), subdomains=cut, steps=3)
    solver, steps = steps_of(problem, **TIGHT)
    assert solver.failure is None and len(steps) == 3
    # of E times the way of 0.1 at least, if anything held them
    assert max(np.abs(step.multipliers).max() for step in steps) <= 1e-9 * 1e8


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_the_last_digits_of_a_way_are_no_penetration(built, steps_of, named_scene, rtol):
    """Boxes go down by 0.1: rows off by 10 roundings of that are nothing, whatever is asked for;
    by 1e-9 of it they are not.
    """
    problem = built(scene=named_scene("down", BOXES), subdomains=3, steps=1)
    solver, (step,) = steps_of(problem, **{**TIGHT, "primal_rtol": rtol})
    assert solver.failure is None and not step.multipliers.any()
    load = solver.load(1, step.weights[problem.structure.patterns :], 0 * step.gradient)
    for off, fine in ((10 * np.finfo(float).eps * 0.1, True), (1e-9 * 0.1, False)):
        gradient = step.gradient.copy()
        gradient[solver.rows.normal] = -off
        residuals = solver.residuals.of(load, step.multipliers, gradient)
        assert solver.residuals.enough(residuals) == fine, residuals


@pytest.mark.parametrize("cut", [1, 7])
@pytest.mark.some(1)
def test_rounding_is_no_other_solution(built, steps_of, named_scene, cut):
    """Three blocks on one another, of which the top one is moved down a gap: states of contact
    nodes of all kinds fit forces of 1e-22, and the last digits of the way are no penetration.
    """
    problem = built(scene=named_scene("sinking", SINKING), subdomains=cut, steps=3)
    solver, steps = steps_of(problem, **TIGHT, uniqueness="yes")
    assert solver.failure is None and len(steps) == 3
    assert max(max(step.residuals.values()) for step in steps) < 5e-7  # half of what is asked for
    assert solver.uniqueness.examined and not solver.uniqueness.several


@pytest.mark.parametrize("cut", [1, 5])
def test_given_friction_holds_what_slides_along_it(built, steps_of, named_scene, cut):
    """A body carried along a wall that it only touches: rubbed by 50 N/m2 on its side of 1 m."""
    problem = built(scene=named_scene("shelf", SHELF), subdomains=cut, steps=2, element="P2")
    solver, steps = steps_of(problem, **TIGHT)
    assert solver.failure is None and len(steps) == 2
    tangential = solver.rows.tangential
    # to the rounding of nodal forces
    assert steps[-1].multipliers[tangential].sum() == pytest.approx(50.0, rel=1e-12)


@pytest.mark.parametrize("cut", ["1x1", "3x1", "12x6"])
@pytest.mark.some(1)
def test_a_load_that_steps_see_at_its_zeros_alone_is_none(built, steps_of, named_scene, cut):
    """Two steps of a sine, its rounding beside a sine of size one; and a traction along what the
    support holds works on no motion that it leaves free, not by rounding either.
    """
    problem = built(scene=named_scene("lid", LID), subdomains=cut, cells=2, steps=2)
    assert not problem.manifest.factors[:, 0].any() and problem.manifest.factors[2, 1] > 0
    assert not problem.operator.rigid_work[0, 1].any()
    solver, steps = steps_of(problem, **TIGHT)
    assert solver.failure is None
    assert not any(step.multipliers[solver.residuals.contact > 0].any() for step in steps)


def test_a_fixed_point_lost_in_rounding_is_no_failure_without_forces(built, steps_of, named_scene,
                                                                     monkeypatch):
    """Where no iteration ends and bodies are driven away, the state without any force is tried."""
    def lost(self, index, load, x, *_):
        self.bodies.shift(load, np.full(self.operator.modes, 1e3))
        raise Unfinished(NotConverged("stagnated"), 1e-20 + x, x)

    monkeypatch.setattr(FixedPoint, "find", lost)
    resting = built(scene=named_scene("lid", LID), subdomains="3x1", cells=2, steps=2)
    solver, steps = steps_of(resting, **TIGHT)
    assert solver.failure is None and not any(step.multipliers.any() for step in steps)


SWELLING = """include "scene.idp"
units("mm", "MPa");
subdomains("20");
quasistatic(1.);
rectangle(0., 30., 0., 6.);
macro young() 40. //
macro poisson() 0.35 //
macro thermal1() 0.04 //
macro amplitude1(t) t //
macro support() on(4, u1 = 0.) //
macro contact() 3 //
macro gap() 0.05 //
include "export.idp"
"""


@pytest.mark.parametrize("cut", ["1x1", "3", "10x2", "20x4"])
@pytest.mark.some(2)
def test_a_swelling_body_moves_off_its_lid_without_force(built, steps_of, named_scene, cut):
    """All of its side touches at once, and nothing holds it: any force would be wrong."""
    problem = built(scene=named_scene("swelling", SWELLING), subdomains=cut, steps=10, cells=5)
    solver, steps = steps_of(problem, rtol=1e-8)
    assert solver.failure is None and len(steps) == 10
    # of E times the strain, were the body held
    largest = max(np.abs(step.multipliers[solver.rows.normal]).max() for step in steps)
    assert largest <= 1e-9 * 40.0 * 0.04 * 30.0
