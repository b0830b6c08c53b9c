"""Steps whose stiff parts deform by less than products with the dual operator round off."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.contact.states import SLIP
from driver.march.condensed_search import CondensedSearch
from driver.march.quasistatic import QuasistaticSolver
from driver.results.record import Record

TIGHT = {"rtol": 1e-10, "friction_rtol": 1e-8}
# a stiff half on a soft one, held by nothing but soft springs and by contact
LOOSE = """include "scene.idp"
units("um", "MPa");
subdomains("4");
rectangle(0., 2000., 0., 1000.);
macro young() (y < 480.7 ? 3e3 : 3e9) //
macro poisson() 0. //
macro load1() pressure(3, 0.3) + traction(3, -0.002683, -0.001342) //
macro bodyForce2() [1.342e-4, -2.683e-4] //
macro contact() 1, 2 //
macro tresca() (label == 2 ? 0. : 0.03) //
macro foundation() 3 //
macro foundationNormal() 3e-4 //
macro foundationTangential() 3e-5 //
include "export.idp"
"""
# a stiff wedge of material that keeps its volume, which hangs on soft material
WEDGE = """include "scene.idp"
units("m", "Pa");
subdomains("4");
real h = 0.8699, g = 0.28811088;
border a0(t=0, 1) { x = 1.713*t; y = 0.; label = 1; }
border a1(t=0, 1) { x = 1.713; y = h*t; label = 11; }
border a2(t=0, 1) { x = 1.713*(1 - t); y = h + (g - h)*t; label = 21; }
border a3(t=0, 1) { x = 0.; y = g*(1 - t); label = 31; }
body = buildmesh(a0(5) + a1(3) + a2(6) + a3(2));
macro young() (x < 0.5476 ? 1. : 1e6) //
macro poisson() 0.4999 //
macro support() on(31, u1 = 0., u2 = 0.) //
macro load1() traction(21, 4.528e-05, -8.916e-05) //
macro bodyForce2() [4.528e-06, -8.916e-06] //
macro contact() 1, 11 //
macro friction() 0.5 //
include "export.idp"
"""
# a soft block and a stiff one on a floor, pushed aside by loads that stay from t = 0.2 on
PUSHED = """include "scene.idp"
units("m", "Pa");
subdomains("4");
quasistatic(1.);
int[int] of0 = [1, 11, 21, 31], of1 = [101, 111, 121, 131];
mesh m0 = square(5, 4, [1.268 * x, 0.6877 * y], label = of0);
mesh m1 = square(5, 5, [1.268 + 0.8286 * x, 0.79842 * y], label = of1);
m1 = change(m1, fregion = 1);
addBody(m0)
addBody(m1)
macro young() (region == 1 ? 1e3 : 1.) //
macro poisson() 0.3 //
macro support() on(111, u1 = 0., u2 = 0.) //
macro load1() traction(31, 8.6e-4, -5.2e-4) //
macro amplitude1(t) min(5.*t, 1.) //
macro contact() 1, 101 //
macro contactPair() 11, 131 //
macro friction() 0.5 //
macro foundation() 21 //
macro foundationNormal() 0.01 //
include "export.idp"
"""
# a stiff block without support but weak springs, on soft ones
FREE = """include "scene.idp"
units("m", "Pa");
subdomains("4");
quasistatic(1.);
int[int] of0 = [1, 11, 21, 31], of1 = [101, 111, 121, 131], of2 = [201, 211, 221, 231];
mesh m0 = square(11, 6, [3.632 * x^4, 1.5538 * y], label = of0);
mesh m1 = square(6, 2, [0.01318568 + 3.4849 * x, 1.5538 + 1.0132 * y], label = of1);
mesh m2 = square(14, 6, [0.989482 + 2.44396 * x, 2.567 + 0.8058 * y], label = of2);
m1 = change(m1, fregion = 1);
m2 = change(m2, fregion = 2);
addBody(m0)
addBody(m1)
addBody(m2)
macro young() (region == 2 ? 2e17 : 2e11) //
macro poisson() 0.45 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() pressure(221, 2e7) //
macro contactPair() 101, 21, 201, 121 //
macro friction() 0.1 //
macro amplitude1(t) t //
macro foundation() 211 //
macro foundationNormal() 1e9 //
macro foundationTangential() 1e8 //
include "export.idp"
"""
# the stiffest body of a stack, which nothing but contact and friction that slip changes holds
SLIPPING = """include "scene.idp"
units("um", "MPa");
subdomains("5");
real slipRange = 0.5;
quasistatic(1.);
border a0(t=0, 1) { x = 1494.*t; y = 0.; label = 1; }
border a1(t=0, 1) { x = 1494.; y = 814.3*t; label = 11; }
border a2(t=0, 1) { x = 1494.*(1 - t); y = 814.3; label = 21; }
border a3(t=0, 1) { x = 0.; y = 814.3*(1 - t); label = 31; }
border c0(t=0, 1) { x = 506.289 + 633.441*t; y = 1273.4; label = 201; }
border c1(t=0, 1) { x = 1139.73; y = 1273.4 + 813.2*t; label = 211; }
border c2(t=0, 1) { x = 1139.73 - 633.441*t; y = 2086.6; label = 221; }
border c3(t=0, 1) { x = 506.289; y = 2086.6 - 813.2*t; label = 231; }
mesh low = buildmesh(a0(5) + a1(2) + a2(5) + a3(2));
mesh high = buildmesh(c0(5) + c1(6) + c2(5) + c3(6));
int[int] ofMiddle = [101, 111, 121, 131];
mesh middle = square(5, 3, [480.711 + 916.569*x, 814.3 + 459.1*y], label = ofMiddle);
high = change(high, fregion = 2);
addBody(low)
addBody(middle)
addBody(high)
macro young() (region == 2 ? 3e9 : 3e3) //
macro poisson() 0. //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() traction(221, 0., -4.5) //
macro contactPair() 101, 21, 201, 121 //
macro pairGap() 5e-06*(x - 747.)^2 //
macro friction() 0.5 //
macro slipFactor(s) (1. + (0.8 - 1.)*s/slipRange) //
macro amplitude1(t) t //
macro foundation() 31 //
macro foundationNormal() 3e-4 //
macro foundationTangential() 3e-4 //
include "export.idp"
"""
# a stiff half of a body that nothing but contact holds, pressed by a million times the load
SQUEEZED = """include "scene.idp"
units("m", "Pa");
subdomains("1");
quasistatic(1.);
border a0(t=0, 1) { x = 1.038*t; y = -0.08205*t; label = 1; }
border a1(t=0, 1) { x = 1.038 - 0.02189*t; y = -0.08205 + 1.21705*t; label = 1; }
border a2(t=0, 1) { x = 1.01611 - 0.91111*t; y = 1.135 - 0.08525*t; label = 1; }
border a3(t=0, 1) { x = 0.105*(1 - t); y = 1.04975*(1 - t); label = 1; }
mesh Th0 = buildmesh(a0(4) + a1(5) + a2(4) + a3(4));
body = Th0;
macro young() (x < 0.6137 ? 1. : 1e6) //
macro poisson() 0.3 //
macro bodyForce1() [0., -1e-4] //
macro contact() 1 //
macro gap() -7.07e-6 //
macro friction() 10. //
macro amplitude1(t) t //
include "export.idp"
"""
SCENES = {"loose": (LOOSE, "P2", {"subdomains": "3x1", "cells": 2}, {"subdomains": "3x3",
                                                                     "cells": 2}),
          "free": (FREE, "P1", {"subdomains": "23", "steps": 4}, {"subdomains": "7", "steps": 1}),
          "wedge": (WEDGE, "P2-mixed", {"subdomains": "5"}, {"subdomains": "10"})}


def forces(problem, step) -> np.ndarray:
    """(2 n_c,) contact forces of the nodes along n, then t."""
    contact = problem.structure.contact
    rows = np.concatenate([contact.normal_row, contact.tangential_row])
    return np.where(rows >= 0, step.multipliers[rows], 0.0)


def solved(built, steps_of, named_scene, name: str, cut: int) -> np.ndarray:
    """Contact forces of a scene at one of its cuts, with residuals as small as asked for."""
    text, element, *cuts = SCENES[name]
    problem = built(scene=named_scene(name, text), element=element, **cuts[cut])
    solver, steps = steps_of(problem, **TIGHT)
    assert solver.failure is None
    assert max(steps[-1].residuals.values()) <= 1e-6
    return forces(problem, steps[-1])


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.some(1)
def test_stiff_parts_on_soft_ones_are_solved_to_what_was_asked(built, steps_of, named_scene, name):
    """Each had ended with stationarity of 1e-5, or 3e-6, and no solution."""
    assert solved(built, steps_of, named_scene, name, 0).any()


@pytest.mark.slow
def test_contact_has_all_digits_under_friction_that_slip_changes(built, steps_of, named_scene):
    """Once friction has settled, contact rows are corrected by increments as if it were given: the
    first step had ended with complementarity of 1.3e-6, what whole solutions round off.
    """
    problem = built(scene=named_scene("slipping", SLIPPING), element="P2", steps=2)
    solver, steps = steps_of(problem, **TIGHT)
    assert solver.failure is None and len(steps) == 2
    assert max(max(step.residuals.values()) for step in steps) <= 1e-6


@pytest.mark.slow
def test_rows_are_judged_by_the_friction_that_they_were_corrected_for(built, steps_of, named_scene,
                                                                      monkeypatch):
    """A node inside a bound that has changed by rounding would count as one that sticks: on some
    processors the second step had ended with a stationarity residual of 0.05.
    """
    corrected, missed, searched = (CondensedSearch._corrected, CondensedSearch._missed,
                                   CondensedSearch._search)
    latest, judged = [], []

    def search(self, *step):
        del latest[:]
        return searched(self, *step)

    def correct(self, load, x, gradient):
        change = corrected(self, load, x, gradient)
        latest[:] = [] if change is None else [self.rows.coefficient.copy()]
        return change

    def miss(self, x, gradient, bound):
        judged.extend(np.array_equal(bound, coefficient * np.abs(x[self.rows.pair]))
                      for coefficient in latest)
        del latest[:]
        return missed(self, x, gradient, bound)

    monkeypatch.setattr(CondensedSearch, "_search", search)
    monkeypatch.setattr(CondensedSearch, "_corrected", correct)
    monkeypatch.setattr(CondensedSearch, "_missed", miss)
    problem = built(scene=named_scene("slipping", SLIPPING), element="P2", steps=2)
    steps_of(problem, **TIGHT)
    assert len(judged) > 3 and all(judged)


@pytest.mark.slow  # two scenes more, seconds
def test_stiff_parts_on_soft_ones_have_the_same_forces_at_any_cut(built, steps_of, named_scene):
    """Those that the stiffness determines: 1e-7 of them, where products tell 1e-4."""
    assert solved(built, steps_of, named_scene, "loose", 1).any()
    one, other = (solved(built, steps_of, named_scene, "wedge", cut) for cut in (0, 1))
    assert one == pytest.approx(other, abs=2e-6 * np.abs(one).max())


def test_reported_displacements_are_those_that_residuals_are_of(built, steps_of):
    """Refined ones where the step was solved by them: of stiff pieces that hang on soft ones, which
    deform by 7e-10, products leave gaps of more than a millionth of that at nodes that press.
    """
    problem = built(scene="hard/block", jump=1e6, board="pieces", subdomains="4x2", cells=4,
                    steps=1)
    solver, (step,) = steps_of(problem, **TIGHT)
    assert step.refined and solver.failure is None
    operator, contact = problem.operator, problem.structure.contact
    pressing = contact.gid[contact.normal_row >= 0][step.multipliers[
        contact.normal_row[contact.normal_row >= 0]] > 0]

    def gap(refined: bool) -> float:
        """Largest distance of nodes that press from the foundation, along y."""
        fields = operator.deformations(step.multipliers, step.weights, refined=refined)
        return max(np.abs(u.reshape(-1, 2)[np.isin(sub.node_gid, pressing), 1]).max(initial=0.0)
                   for u, sub in zip(fields, problem.structure.subdomains))

    assert gap(refined=True) <= 1e-6 * 7e-10 < gap(refined=False)
    written = Record(operator, solver)
    _, state = written.add(step)
    assert np.abs(state["u_n"][state["sigma_n"] < 0]).max() <= 1e-6 * 7e-10


@pytest.mark.slow  # a step of many refined products
def test_springs_that_hold_bodies_are_in_no_residual_of_refined_displacements(
        built, steps_of, named_scene):
    """They had moved the body by 5e-5 of what its stiff half deforms by, 2e-5: distances that the
    step's residuals were of, and those that were reported, differed by as much.
    """
    problem = built(scene=named_scene("squeezed", SQUEEZED), element="P2", steps=2)
    solver, steps = steps_of(problem, **TIGHT)
    assert solver.failure is None and any(step.refined for step in steps)
    written, rows = Record(problem.operator, solver), solver.rows
    for step in steps:
        _, state = written.add(step)
        reported = (state["u_n"] - written.gaps[-1])[rows.normal_node]
        assert reported == pytest.approx(-step.gradient[rows.normal], abs=1e-6 * 2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.some(1)
def test_refined_displacements_are_those_of_factors_but_for_rounding(built, steps_of, named_scene,
                                                                     name):
    """Where bodies without support have moved, too. What stiff parts, springs of the method among
    them, round off beside the springs that hold the rest has been up to 2e-4; a motion left out
    would be all of it.
    """
    text, element, _, cut = SCENES[name]
    problem = built(scene=named_scene(name, text), element=element, **cut)
    _, (step, *_) = steps_of(problem, **TIGHT)
    refined, plain = (np.concatenate(problem.operator.deformations(
        step.multipliers, step.weights, refined=way)) for way in (True, False))
    assert 0 < np.abs(refined - plain).max() <= 1e-2 * np.abs(plain).max()


def test_loads_that_stay_leave_the_state_as_it_is(built, steps_of, named_scene):
    """To the bit, by the two products that show it: the error of a step is no slip of the next."""
    problem = built(scene=named_scene("pushed", PUSHED), element="P2-mixed", steps=5)
    solver, steps = steps_of(problem, **TIGHT)
    assert solver.failure is None
    first, *later = steps
    assert SLIP in first.status
    for step in later:
        np.testing.assert_array_equal(step.multipliers, first.multipliers)
        np.testing.assert_array_equal(step.status, first.status)
        assert not step.gradient[solver.rows.tangential].any()
        assert step.products <= 2 and step.fixed_point_iterations == 0
        assert max(step.residuals.values()) <= 1e-6


@pytest.mark.parametrize("enough, uneven", [(True, False), (False, False), (True, True)])
def test_a_state_that_is_kept_slides_nowhere(enough, uneven):
    """Whatever products round off on the rows that could; not kept if its residuals are large.

    Those of refined displacements where stiffness jumps by much, as those that are reported are.
    """
    def of(load, x, gradient):
        np.testing.assert_array_equal(gradient, [1e-9, 0.0])
        return {}

    march = SimpleNamespace(rows=SimpleNamespace(tangential=np.array([1])),
                            operator=SimpleNamespace(
                                uneven=uneven, gradient=lambda x, load: np.array([1e-9, 1e-7])),
                            residuals=SimpleNamespace(of=of, enough=lambda found: enough))
    kept = QuasistaticSolver._kept(march, None, np.ones(2), np.array([1e-3 * uneven or 1e-9, 1e-8]))
    assert (kept is not None) is enough
    if enough:
        x, gradient, moved, _ = kept
        assert not gradient[1] and not moved.any() and x.all()


def test_a_state_may_stay_where_nothing_changes():
    """Not in the first step, nor where contact follows bodies or obstacles, or surfaces wear."""
    still = {"contact": SimpleNamespace(moves=False), "effects": SimpleNamespace(closes=False),
             "amplitudes": np.array([[0.0, 1.0], [0.5, 1.0], [0.5, 1.0], [0.5, 1.1]])}

    def holds(index, **changes):
        return QuasistaticSolver._holds(SimpleNamespace(**still | changes), index)

    assert [holds(index) for index in (1, 2, 3)] == [False, True, False]
    assert not holds(1, amplitudes=np.ones((3, 2)))
    assert not holds(2, contact=SimpleNamespace(moves=True))
    assert not holds(2, effects=SimpleNamespace(closes=True))
