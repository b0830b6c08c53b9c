"""What residuals mean, that a step converges only with those that were asked for, and that they
and the tolerances see deformations and forces instead of motions, travel and spikes.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.kkt import FADED, Scales, kkt_residuals
from driver.contact.rows import ContactRows
from driver.effects import Effects
from driver.errors import InputError
from driver.march import residuals as of_steps
from driver.march.slip import SlipState
from driver.march.outlook import FORESEEN, foresight, growth
from driver.march.quasistatic import QuasistaticSolver
from driver.march.step import Load, Trace
from driver.options import Settings

PAD = """include "scene.idp"
real D = physical("drag", 1.), P = physical("press", 1e-4), A = physical("angle", 0.);
units("m", "Pa");
subdomains("3x1");
quasistatic(1.);
rectangle(0., 2., 0., 1.);
macro young() 1e9 //
macro poisson() 0.3 //
macro displacement1() on(3, u1 = -A*(y - 1.), u2 = -P + A*(x - 1.)) //
macro amplitude1(t) min(1., 2.*t) //
macro displacement2() on(3, u1 = D) //
macro amplitude2(t) max(0., 2.*t - 1.) //
macro contact() 1 //
macro friction() 0.3 //
include "export.idp"
"""
BLOCK = """include "scene.idp"
real push = physical("push", 0.), wall = physical("wall", 1.);
units("m", "Pa");
subdomains("4x2");
quasistatic(1.);
rectangle(0., 2., 0., 1.);
macro young() 1e6 //
macro poisson() 0.3 //
macro load1() traction(3, 0., -1e3*(1. + 0.5*x)) + traction(2, -push, 0.) //
macro amplitude1(t) (t < 0.6 ? t : 1.2 - t) //
macro contact() 1, 4 //
macro gap() (label == 4 ? wall : 0.) //
include "export.idp"
"""

SHEAR = """include "scene.idp"
units("1", "1");
subdomains("4x2");
rectangle(0., 2., 0., 1.);
quasistatic(1.);
macro c11() 1. //
macro c22() 1. //
macro c12() 0.3 //
macro c33() 0.35e-6 //
macro c13() 0. //
macro c23() 0. //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -1e-3) + traction(2, 3e-4, 1e-4) //
macro amplitude1(t) t //
macro contact() 1 //
macro friction() 0.3 //
include "export.idp"
"""
SPIKE = """include "scene.idp"
units("1", "1");
subdomains("2x1");
rectangle(0., 2., 0., 1.);
quasistatic(1.);
macro young() 1. //
macro poisson() 0.3 //
macro support() on(4, u1 = 0., u2 = 0.) //
macro load1() traction(3, 0., -1e-3) + traction(2, 4e-4, 2e-4) //
macro amplitude1(t) (abs(t - 0.5) < 0.01 ? 1e6 : t) //
macro contact() 1 //
macro friction() 0.3 //
include "export.idp"
"""


# ---- residuals -----------------------------------------------------------------------------------

def rows(friction: float) -> ContactRows:
    """Two contact nodes with friction and a gluing row."""
    index = np.arange(2)
    return ContactRows(index, index, np.zeros(2), index + 2, index, index,
                       np.full(2, friction), None, np.array([4]), False)


def residuals(friction: float, multipliers, move) -> dict:
    """Residuals of forces and movements (5,) where the deformation is 1e-3."""
    return kkt_residuals(rows(friction), np.array(multipliers, float), -np.array(move, float),
                         np.zeros(5, int), Scales(displacements=np.array([1e-3])), MPI.COMM_SELF)


@pytest.mark.parametrize("friction", [0.3, 1e3, 1e12])
def test_residuals_do_not_grow_with_friction(friction):
    """A node that sticks with a slip of a millionth of the deformation is off by a millionth."""
    got = residuals(friction, [2e5, 1e5, 1e4, -2e4, 0.0], [0, 0, 1e-9, -1e-9, 0])
    assert got["complementarity"] == pytest.approx(1e-6, rel=1e-9)
    assert max(value for name, value in got.items() if name != "complementarity") == 0


def test_residuals_have_no_negative_zero():
    """Of which the maximum over ranks may be either."""
    got = residuals(0.3, [2e5, 1e5, -6e4, -3e4, 0.0], [0, -0.0, -1e-9, -0.0, -0.0])
    assert not np.signbit(list(got.values())).any()


@pytest.mark.parametrize("multipliers, move, name, size", [
    ([2e5, 0, 0, 0, 0], [0, 1e-6, 0, 0, 0], "penetration", 1e-3),  # of an open node
    ([2e5, 1e5, 0, 0, 0], [0, -1e-4, 0, 0, 0], "complementarity", 0.1),  # presses from afar
    ([2e5, 1e-3, 0, 0, 0], [0, -1e-4, 0, 0, 0], "complementarity", 5e-9),  # but hardly
    ([2e5, -2e4, 0, 0, 0], [0, 0, 0, 0, 0], "sign", 0.1),
    ([2e5, 1e5, 0, 4e4, 0], [0, 0, 0, 1e-5, 0], "cone", 0.05),
    ([2e5, 1e5, 6e4, 0, 0], [0, 0, -1e-4, 0, 0], "complementarity", 0.1),  # slides backward
    ([2e5, 1e5, 6e4, 0, 0], [0, 0, 1e5, 0, 0], "complementarity", 0.0),  # any way forward
    ([2e5, 1e5, 0, 0, 0], [0, 0, 0, 0, -2e-5], "gluing", 2e-2)])
def test_residuals_by_hand(multipliers, move, name, size):
    """Each condition violated alone, by `size` of the largest force or the deformation."""
    assert residuals(0.3, multipliers, move)[name] == pytest.approx(size, rel=1e-12, abs=1e-18)


def test_zeros_have_no_sign():
    """Which of several zeros is the largest depends on the rank: files get the same bits."""
    got = residuals(0.3, [0, 2e5, 0, 0, 0], [-0.0, -0.0, -0.0, 0, 0])
    assert not any(np.signbit(value) for value in got.values())


def test_scales_are_those_of_the_step():
    """After a spike the step's own values count, down to a millionth of the spike's."""
    scales = Scales()
    scales.renew(d=1e6)
    scales.keep()
    scales.renew(d=3.0)
    assert scales.d == 3.0
    scales.renew(d=0.0)
    assert scales.d == FADED * 1e6


# ---- convergence is earned -----------------------------------------------------------------------

@pytest.mark.parametrize("asked", [1e-4, 1e-6, 1e-9])
def test_what_was_asked_for_is_reached(built, steps_of, asked):
    solver, steps = steps_of(built(loading="nonmonotone", cells=4, steps=5), primal_rtol=asked)
    assert solver.failure is None and len(steps) == 5
    assert max(max(step.residuals.values()) for step in steps) <= asked


@pytest.mark.parametrize("friction", ["1e9", "1e12"])
@pytest.mark.some(1)
def test_huge_friction_converges_in_the_same_residuals(solved, friction):
    """All nodes stick: the answer is that of any large coefficient, and residuals say so."""
    words = {"loading": "nonmonotone", "cells": 4, "steps": 3, "uniqueness": "no"}
    huge, large = (solved(friction=F, **words) for F in (friction, "1e3"))
    assert huge.status == large.status == 0
    assert max(huge.summary["residuals"].values()) <= Settings().primal_rtol
    peak = np.abs(large.contact["sigma_n"]).max()
    for name in ("sigma_n", "sigma_t"):
        assert np.abs(huge.contact[name] - large.contact[name]).max() <= 1e-4 * peak


def test_a_residual_that_stays_ends_with_status_4(built, steps_of, monkeypatch):
    """Gluing that no tolerance mends: not converged, with the residual named."""
    honest = of_steps.kkt_residuals
    monkeypatch.setattr(of_steps, "kkt_residuals",
                        lambda *data: honest(*data) | {"gluing": 1e-3})
    solver, steps = steps_of(built(loading="nonmonotone", cells=4, steps=5))
    assert solver.failure.exit_status == 4 and len(steps) == 1
    assert "gluing residual stays at 1.0e-03" in str(solver.failure)
    assert "accepts" not in str(solver.failure)


@pytest.mark.parametrize("name, option", [("gluing", "PRIMAL_RTOL"),
                                          ("equilibrium", "FRICTION_RTOL")])
def test_a_tolerance_that_accepts_what_was_come_to_is_offered(built, steps_of, monkeypatch, name,
                                                              option):
    """The nearest that the step came to, rounded up; before and after it they are worse."""
    honest, left = of_steps.kkt_residuals, iter([2e-2, 3e-6, 4e-2] * 99)
    monkeypatch.setattr(of_steps, "kkt_residuals",
                        lambda *data: honest(*data) | {name: next(left)})
    solver, _ = steps_of(built(loading="nonmonotone", cells=4, steps=5))
    assert f"the {name} residual stays at 3.0e-06" in str(solver.failure)
    assert f"{option}=1e-05 accepts that" in str(solver.failure)


# settings that leave a tenth and less of what the defaults leave
TIGHT = {"rtol": 1e-12, "friction_rtol": 1e-9, "primal_rtol": 1e-7}


def apart(rough, fine) -> float:
    """Largest difference of tractions in the last step, over their largest."""
    rough, fine = (tractions(outcome)[:, -1] for outcome in (rough, fine))
    return np.abs(rough - fine).max() / np.abs(fine).max()


def test_forces_are_right_in_a_nearly_singular_material(solved, named_scene):
    """Shear a million times as soft: displacements are shear alone and say nothing of tractions.

    The residual in forces is 1e-6 of their norm; a node's error may be ten times that.
    """
    rough, fine = (solved(scene=named_scene("shear", SHEAR), cells=4, steps=2, **words)
                   for words in ({}, TIGHT))
    assert rough.status == fine.status == 0
    assert apart(rough, fine) <= 1e-5


@pytest.mark.slow
def test_stiff_parts_know_whether_they_slide(solved):
    """E jumps by 1e6: slip that is nothing to the soft parts decides on friction of the stiff ones.
    """
    words = {"jump": "1e6", "subdomains": "4x2", "cells": 4, "steps": 4}
    rough, fine = (solved(scene="hard/block", **words, **more) for more in ({}, TIGHT))
    assert rough.status == fine.status == 0
    assert apart(rough, fine) <= 1e-4


def test_a_spike_spoils_no_later_step(solved, named_scene):
    """Slip that friction keeps from a spike of 1e6 is a millionth of it too much for its own
    tolerance, and as large as all that follows: so the spike's step is solved further.
    """
    rough, fine = (solved(scene=named_scene("spike", SPIKE), cells=6, steps=6, **words)
                   for words in ({}, TIGHT))
    assert rough.status == fine.status == 0
    largest = np.abs(rough.contact["sigma_n"]).max(axis=1)
    assert largest[2] > 1e5 * largest[-1]
    assert apart(rough, fine) <= 1e-3


@pytest.mark.parametrize("asked", [1e-4, 1e-6])
@pytest.mark.some(1)
def test_what_a_spike_leaves_is_as_exact_as_what_was_asked_for(built, steps_of, named_scene, asked):
    """With friction that keeps more of it, and tolerances alike: a spike of 1e6 may cost FORESEEN
    of the accuracy of later steps, and a node's force errs by ten times the residual. Without
    foresight the last forces are a quarter off and more.
    """
    text = SPIKE.replace("macro friction() 0.3", "macro friction() 0.8")
    problem = built(scene=named_scene("kept", text), cells=6, steps=6)
    fine, rough = (steps_of(problem, rtol=tol, friction_rtol=tol, primal_rtol=primal)[1][-1]
                   for tol, primal in ((1e-13, 1e-9), (asked, asked)))
    size = np.abs(fine.multipliers).max()
    assert np.abs(rough.multipliers - fine.multipliers).max() <= 100 * FORESEEN * asked * size


def test_steps_before_smaller_loads_are_solved_further():
    """By ten times what the loads differ; those of zero and those to come that are larger do not
    count.
    """
    loads = [1.0, 1e4, 2.0, 1.0, 0.0]
    assert [foresight(loads, step) for step in range(1, 6)] == pytest.approx([1, 1e-3, 1, 1, 1])
    assert foresight([1e8, 1.0, 0.0], 1) == pytest.approx(1e-5)
    for unit in (1e-12, 1e12):  # 1e-10 of the first is none of it
        assert foresight([unit, 1e-10 * unit, 1e-4 * unit], 1) == pytest.approx(FORESEEN * 1e-4)


@pytest.mark.parametrize("changes, mean", [
    ([8.0, 4.0, 2.0, 1.0], 0.5), ([9.0, 0.0, 4.0, 0.0, 1.0], 1 / 3), ([1.0, 1.0, 3.0], 3**0.5)])
def test_the_contraction_is_the_mean_ratio_of_changes(changes, mean):
    """Geometric; a QP that changes nothing says nothing."""
    trace = Trace()
    assert np.isnan(trace.contraction)
    trace.changes = changes[:1]
    assert np.isnan(trace.contraction)
    trace.changes = changes
    assert trace.contraction == pytest.approx(mean)


def test_multipliers_go_on_as_the_load_does():
    """In proportion to it while it grows, at most twice as far; on reversal from where they are."""
    first, second = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    assert growth(np.outer([0, 2, 5], first), 2) == pytest.approx(1.5)
    assert growth(np.outer([0, 1, 9], first), 2) == 2.0
    for reversed_ in ([0, 2, 1], [0, -2, -1], [0, 2, -3]):
        assert growth(np.outer(reversed_, first), 2) == 0.0
    assert growth(np.array([0 * first, first, first + second]), 2) == 0.0  # of another load
    assert growth(np.outer([0, 1, 2], first), 1) == 0.0 == growth(np.outer([1, 1, 2], first), 2)


def test_nothing_left_is_nothing_missing(built, steps_of, named_scene):
    """Lifted off and unloaded again: forces that rounding leaves are no forces to be right."""
    text = SPIKE.replace("(abs(t - 0.5) < 0.01 ? 1e6 : t)", "(t < 0.6 ? t : 0.)")
    text = text.replace("traction(3, 0., -1e-3) + traction(2, 4e-4, 2e-4)", "traction(2, 0., 1e-3)")
    solver, steps = steps_of(built(scene=named_scene("lifted", text), cells=4, steps=4), rtol=1e-11,
                             friction_rtol=1e-10)
    assert solver.failure is None and len(steps) == 4


@pytest.mark.parametrize("cut", ["1x1", "3x1", "5x2"])
@pytest.mark.some(2)
def test_a_load_that_is_rounding_is_none(built, steps_of, named_scene, cut):
    """sin(2 pi) presses nothing: all forces are zero, not 1e-16 of those before."""
    text = SPIKE.replace("(abs(t - 0.5) < 0.01 ? 1e6 : t)", "sin(2*pi*t)")
    problem = built(scene=named_scene("round", text), subdomains=cut, cells=3, steps=4)
    assert problem.manifest.factors[-1] == 0
    solver, steps = steps_of(problem, rtol=1e-10, friction_rtol=1e-8)
    assert solver.failure is None and len(steps) == 4
    assert np.abs(steps[0].multipliers).max() > 0 and not steps[-1].multipliers.any()


def test_bounds_are_those_of_the_slip(built, steps_of, named_scene, monkeypatch):
    """The cone residual sees a coefficient that is not that of the slip."""
    text = SPIKE.replace("(abs(t - 0.5) < 0.01 ? 1e6 : t)", "t").replace(
        'include "export', "macro slipFactor(s) (1. - 0.5*s/slipRange) //\ninclude \"export")
    text = text.replace("quasistatic(1.);", "quasistatic(1.);\nreal slipRange = 1e-3;")
    honest, cones = of_steps.Residuals.of, []

    def watched(self, load, x, gradient, exact=False):
        known, self.rows.coefficient = self.rows.coefficient, 1.01 * self.rows.coefficient
        stale = honest(self, load, x, gradient, exact)["cone"]
        self.rows.coefficient = known
        bound = self.rows.friction_bound(x).max() / np.abs(x[self.rows.normal]).max()
        cones.append((honest(self, load, x, gradient, exact), stale, bound))
        return cones[-1][0]

    monkeypatch.setattr(of_steps.Residuals, "of", watched)
    solver, steps = steps_of(built(scene=named_scene("weaker", text), cells=4, steps=2))
    last, stale, bound = cones[-1]
    assert solver.failure is None and len(steps) == 2 and last["cone"] <= 1e-6
    assert stale >= 0.009 * bound > 1e-3


def test_what_grows_without_bound_is_left_at_once():
    assert Trace(changes=[1.0, 1e-2, 1e5]).stalls
    assert not Trace(changes=[1.0, 1e-2, 1e2]).stalls


# ---- deformation, not motion ---------------------------------------------------------------------

def tractions(outcome) -> np.ndarray:
    """Tractions of all nodes and steps."""
    return np.stack([outcome.contact["sigma_n"], outcome.contact["sigma_t"]])


@pytest.mark.parametrize("drag", ["1e4", "1e8"])
@pytest.mark.some(1)
def test_dragging_far_changes_no_traction(solved, named_scene, drag):
    """In full sliding tractions do not depend on the way, which is 1e4 to 1e12 of the press."""
    # tolerances a hundredth of the difference that is allowed
    path, words = named_scene("pad", PAD), {"cells": 4, "steps": 6, "friction_rtol": 1e-8,
                                      "primal_rtol": 1e-8}
    near, far = (solved(scene=path, drag=way, **words) for way in ("1", drag))
    assert near.status == far.status == 0
    peak = np.abs(near.contact["sigma_n"]).max()
    assert np.abs(tractions(far) - tractions(near)).max() <= 1e-6 * peak
    assert (near.contact["status"][-1] != "stick").all()
    # three steps of the drag; strains add less than a thousandth of a press each
    np.testing.assert_allclose(far.contact["slip"][-1], float(drag) / 3, rtol=1e-15, atol=1e-7)
    np.testing.assert_allclose(far.summary["quantities"]["displacement"], float(drag), rtol=1e-3)


def test_there_and_back(solved, named_scene):
    """A pad carried away and back again before it presses is where it was: slip by increments."""
    text = PAD.replace("min(1., 2.*t)", "(t < 0.5 ? 0. : 2.*t - 1.)")
    text = text.replace("max(0., 2.*t - 1.)", "(t < 0.4 ? sin(pi*t/0.4) : 0.)")
    path = named_scene("back", text)
    still, carried = (solved(scene=path, drag=way, cells=4, steps=10) for way in ("0", "1e8"))
    assert still.status == carried.status == 0
    peak = np.abs(still.contact["sigma_n"]).max()
    assert peak > 0
    assert np.abs(tractions(carried) - tractions(still)).max() <= 1e-6 * peak


def test_where_a_pad_presses_does_not_matter(solved, named_scene):
    """Carried far, then pressed and sheared there while it sticks, and back: the floor is the same
    everywhere. Sums of the way and the shear would have lost the shear's digits.
    """
    text = PAD.replace("u1 = -A*(y - 1.), u2 = -P + A*(x - 1.)", "u1 = 0.1*P, u2 = -P")
    text = text.replace("min(1., 2.*t)", "(t < 0.5 ? 0. : 4.*(t - 0.5)*(1.5 - t))")
    path = named_scene("there", text.replace("max(0., 2.*t - 1.)", "min(1., 3.*t)"))
    here, there = (solved(scene=path, drag=way, cells=4, steps=10, friction_rtol=1e-8,
                          primal_rtol=1e-8) for way in ("0", "1e8"))
    assert here.status == there.status == 0 and (here.contact["status"][-1] == "stick").any()
    # the solver's tolerances: residuals of 1e-8 and a node's error of ten times as much
    size = np.abs(here.contact["sigma_t"]).max()
    assert np.abs(tractions(there) - tractions(here)).max() <= 1e-5 * size
    slip = here.contact["slip"][-1]
    np.testing.assert_allclose(there.contact["slip"][-1], slip, rtol=0, atol=1e-9)


def test_travel_is_taken_out_whole(built, named_scene):
    """Strains under a prescribed rigid motion are zero, also where it turns; displacements are not.
    """
    problem = built(scene=named_scene("turned", PAD), cells=3, angle=0.3, press=2.0, drag=5.0)
    operator, weights = problem.operator, np.array([1.0, 1.0])
    nothing = np.zeros(operator.owned)
    assert max(np.abs(u).max() for u in operator.deformations(nothing, weights)) <= 1e-14 * 5
    for sub, u in zip(problem.structure.subdomains, operator.displacements(nothing, weights)):
        x, y = sub.xy.T
        expected = np.column_stack([5 - 0.3 * (y - 1), -2 + 0.3 * (x - 1)])
        np.testing.assert_allclose(u.reshape(-1, 2), expected, atol=1e-13)
    # a translation is exact, and turns nothing
    carried = built(scene=named_scene("turned", PAD), cells=3, angle=0.0, press=2.1, drag=1e9 / 3)
    assert np.array([1.0, 1.0]) @ carried.structure.travel.motion[:, 0] == pytest.approx(
        [1e9 / 3, -2.1, 0.0], rel=1e-15, abs=0)


@pytest.mark.parametrize("way, products", [(0.2, 0), (1e13, 1)])
def test_digits_that_travel_takes_are_brought_back(way, products):
    """Far travel leaves none of the deformation, 0.3 after the step, in increments: F x says it."""
    counted = []

    def apply(x):
        counted.append(1)
        return np.array([0.1])

    operator = SimpleNamespace(
        structure=SimpleNamespace(patterns=1), modes=0, minimum=lambda value: value, apply=apply,
        rigid_response=lambda weights: weights * 1.0,
        elastic_response=lambda weights: np.array([0.4]))
    rows = SimpleNamespace(coefficient=None, tangential_node=[0], tangential=[0])
    slip = SlipState(operator, rows, None, np.array([0.25]))
    moved = slip.advance(np.zeros(1), -np.array([way + 0.05]), np.array([way]),
                         SimpleNamespace(displacement=0.3))
    assert moved[0] == way + 0.05 and len(counted) == products
    assert slip.elastic[0] == pytest.approx(0.3, rel=1e-12)


# ---- bodies without support ----------------------------------------------------------------------

def mean_motion(problem, step) -> np.ndarray:
    """(3,) int R . u over the body, R along x, along y and turning about its centre."""
    parts = problem.operator.rigid_parts
    return parts.coefficients(problem.operator.deformations(step.multipliers, step.weights))[0]


@pytest.mark.parametrize("cut", ["1x1", "4x2", "3"])
def test_least_motion_of_a_free_block(built, steps_of, named_scene, cut):
    """Nothing holds the block along a floor without friction: on average it does not move there,
    however it is cut, and the wall that it does not reach changes nothing.
    """
    problem = built(scene=named_scene("block", BLOCK), cells=4, subdomains=cut, steps=4)
    solver, steps = steps_of(problem)
    assert solver.failure is None
    for step in steps:
        along, down, _ = mean_motion(problem, step)
        assert abs(along) <= 1e-9 * abs(down) and down < 0


def test_least_motion_is_seen_by_its_integral(built, steps_of, named_scene):
    """The first component of `mean_motion` by an own sum over the triangles."""
    problem = built(scene=named_scene("block", BLOCK), cells=4, subdomains="3", steps=4)
    _, steps = steps_of(problem)
    total = area = 0.0
    fields = problem.operator.displacements(steps[-1].multipliers, steps[-1].weights)
    for sub, u in zip(problem.structure.subdomains, fields):
        corner = sub.xy[sub.triangles]
        sizes = np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1])) / 2
        total += sizes @ u.reshape(-1, 2)[sub.triangles].mean(axis=1)
        area += sizes.sum()
    assert np.abs(total[0]) <= 1e-9 * np.abs(total[1]) and total[1] < 0
    assert area == pytest.approx(2.0)


def test_a_pushed_block_stays_where_it_was_left(built, steps_of, named_scene):
    """The wall stops it; without load nothing pulls it back, nor up to where it started from."""
    text = BLOCK.replace("t < 0.6 ? t : 1.2 - t", "t < 0.6 ? t : 1.5*(1. - t)")
    problem = built(scene=named_scene("pushed", text), cells=4, steps=4, push=100.0, wall=1e-3)
    solver, steps = steps_of(problem)
    assert solver.failure is None
    motion = np.array([mean_motion(problem, step) for step in steps])
    assert np.all(motion[:, 0] < -0.7e-3)
    assert np.abs(steps[-1].multipliers).max() <= 1e-6 * np.abs(steps[-2].multipliers).max()
    assert motion[-1, 0] == pytest.approx(motion[-2, 0], rel=1e-9)


@pytest.mark.parametrize("unit", [1.0, 1e-20])
def test_bodies_that_go_far_and_return_leave_nothing_in_d(unit):
    """A sum of the moves would keep the rounding of the farthest, here 1e-4 of d."""
    motions = [np.array([0.3, -0.7, 0.1])]
    load = Load(np.array([1.0, 0.2 * unit]), unit * np.array([1.0, 2.0, 3.0]), unit)
    d = load.d.copy()
    for change in (1.1e12, -0.9e12, 0.7, -0.2e12):
        load.move(motions, np.array([change * unit]))
    way = load.weights[1] - 0.2 * unit
    assert abs(way) < unit and load.farthest == pytest.approx(0.77e12 * unit)
    assert load.d == pytest.approx(d + way * motions[0], rel=1e-15)


def test_missing_forces_are_sought_on_rows_inside_their_bounds():
    """And on those that would leave them; what stays at a bound, lower or upper, bears no part."""
    limits = np.array([[0.0, -1.0, -1.0, -1.0, 0.0], [np.inf, 1.0, 1.0, 1.0, np.inf]])
    x, gradient = np.array([0.0, 1.0, -1.0, 0.5, 2.0]), np.array([3.0, -2.0, -0.25, 0.125, 0.0])
    asked = []

    def preconditioner(residual, face):
        asked.append((residual.copy(), face.copy()))
        return 2 * residual

    found = object.__new__(of_steps.Residuals)
    found.operator = SimpleNamespace(owned=5, dot=np.dot)
    found.rows = SimpleNamespace(limits=lambda owned, _: limits)
    found.contact = np.array([1.0, 1, 1, 1, 0])  # the last row glues
    found.scales = Scales(d=1.0)
    found.qp = SimpleNamespace(size=np.linalg.norm, bound=1e9,
                               accelerators=SimpleNamespace(preconditioner=preconditioner))
    found.condensation = SimpleNamespace(eliminated=False)
    missing = found._missing(None, x, gradient)
    (residual, face), = asked
    assert face.tolist() == [False, False, True, True, True]
    np.testing.assert_array_equal(residual, [0, 0, -0.25, 0.125, 0])
    assert missing == pytest.approx(2 * np.hypot(0.25, 0.125) / np.linalg.norm(x[:4]))
    found.qp.accelerators.preconditioner = None  # then over what the QP's tolerance is relative to
    assert found._missing(None, x, gradient) == pytest.approx(np.hypot(0.25, 0.125))


def test_corners_are_judged_by_the_whole_deformation(built, steps_of):
    """A peg in a square hole: what a corner touches within is the same part of the same deformation
    at any cut, not of a bound of it that the cut decides on.
    """
    found = []
    for subdomains in (1, 4):
        problem = built("hard/hole", subdomains=subdomains, steps=1)
        solver, (step,) = steps_of(problem, rtol=1e-10, friction_rtol=1e-9)
        whole = problem.operator.deformation_by_level(step.multipliers, step.weights)
        assert solver.scales.displacements == pytest.approx(whole, rel=1e-6)
        found.append(solver.scales.displacement)
    assert found[0] == pytest.approx(found[1], rel=1e-6)


# ---- loads beyond what can be squared ------------------------------------------------------------

def test_loads_whose_squares_overflow_are_refused(built, named_scene):
    """Contact without a gap is homogeneous: loads of 1e140 bring about 1e140 times the forces, to
    the tolerance of a step. Those of 1e200 have norms that are no numbers any more.
    """
    text = SPIKE.replace("(abs(t - 0.5) < 0.01 ? 1e6 : t)", "t")
    problem = built(scene=named_scene("far", text), steps=2, cells=3)
    manifest, effects = problem.manifest, Effects(problem.manifest)

    def end(factor: float) -> np.ndarray:
        solver = QuasistaticSolver(problem.operator, effects, factor * manifest.factors,
                                   np.linspace(0, 1, 3), Settings())
        return [*solver.steps()][-1].multipliers

    of_one, of_many = end(1.0), end(1e140)
    assert np.abs(of_many * 1e-140 - of_one).max() <= 1e-5 * np.abs(of_one).max()
    with pytest.raises(InputError, match="loads or prescribed displacements are so large"):
        end(1e200)
