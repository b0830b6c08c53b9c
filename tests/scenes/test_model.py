"""The model example against an independent dense oracle, its own laws, and everything it must not
depend on.
"""

import numpy as np
import pytest
from driver.files import read_table
from driver.hard.dense import box_qp, coulomb_history
from driver.hard.oracle import Assembled

from driver.scene.kinematics import corner_stresses, stresses, von_mises

LOADINGS = ["monotone", "nonmonotone"]
# Measured against the oracle, the error of sigma_t (the most sensitive field) is 4e3 (4x2) to 5e4
# (8x4, plain)
# times the tolerance, in proportion over 1e-6 .. 1e-12: about cond F. So 1e-11 leaves room below
# 1e-6.
TIGHT = {"rtol": 1e-11, "friction_rtol": 1e-11}
# the slides' method: no preconditioner, steps start from the previous one, every QP to the full
# tolerance
PLAIN = {"preconditioner": "none", "predictor": "previous", "inner_rtol": 1e-9,
         "expansion": "gradient", "corrector": "none"}
F = 0.3


def assert_close(found, expected, relative):
    """Every step: largest difference over the nodes against the largest value of that step."""
    assert found.shape == expected.shape
    size = np.abs(expected).max(axis=1)
    off = np.abs(found - expected).max(axis=1) / np.where(size > 0, size, 1)
    assert off.max() <= relative, f"{off.max():.1e} in step {off.argmax() + 1}"


# ---------------------------------------------------------------------------------- the oracle

@pytest.fixture(scope="module")
def expected(built):
    """expected(loading, **parameters): the condensed dense solution, and the assembled body."""
    def solve(loading="monotone", **parameters):
        problem = built(reduce=False, loading=loading, **parameters)
        m = problem.manifest
        body = Assembled(m, problem.subdomains)
        return coulomb_history(body, m.factors), body

    return solve


@pytest.mark.parametrize("loading", LOADINGS)
@pytest.mark.parametrize("subdomains, steps", [("4x2", 20), ("8x4", 20)])
@pytest.mark.some(2)
@pytest.mark.some(1)
def test_tractions_and_displacements_equal_the_dense_solution(solved, expected, loading, subdomains,
                                                              steps):
    """Relative error at most cond F (3e3, 8e3) times the tolerance 1e-11, several times that in the
    steps around the reversal, where sigma_t is small and slip of earlier steps has added up; 4e-8
    and 2e-7 were measured."""
    found = solved(loading=loading, subdomains=subdomains, steps=steps, **TIGHT)
    assert found.status == 0, found.reason
    history, body = expected(loading, subdomains=subdomains, steps=steps)
    np.testing.assert_allclose(found.contact["x"][0], body.xy[:, 0], atol=1e-14)
    np.testing.assert_allclose(found.contact["weight"][0], body.weight, rtol=1e-12)
    for name, values in history.items():
        assert_close(found.contact[name], values, 1e-6)


def test_default_tolerances_are_honest(solved, expected):
    """What a user gets without options: 1e-6 in the residual times cond F 3e3; 1.4e-3 was measured
    (sigma_t), 5e-3 on other paths to the same tolerance."""
    found, (history, _) = solved(loading="nonmonotone"), expected("nonmonotone")
    for name, values in history.items():
        assert_close(found.contact[name], values, 1e-2)


def test_fixed_point_tolerance_is_honoured(solved, expected):
    """With exact QPs the fixed point alone leaves an error: friction_rtol 1e-6 times q / (1 - q), q
    near 0.2, in sigma_n; up to ten times that in sigma_t, which is smaller. (By default the QPs are
    what is renewed last.)"""
    options = {"loading": "nonmonotone", "cells": 5, "steps": 5}
    found = solved(**options, **{**PLAIN, "rtol": 1e-11, "friction_rtol": 1e-6})
    history, _ = expected(**options)
    for name, values in history.items():
        assert_close(found.contact[name], values, 1e-5)


def test_displacement_field_equals_the_assembled_solution(built, steps_of):
    """Interior displacements: contact forces of the last step put on the untorn body."""
    problem = built(loading="nonmonotone", cells=4)
    _, steps = steps_of(problem, rtol=1e-10, friction_rtol=1e-10)
    contact, body = problem.structure.contact, Assembled(problem.manifest, problem.subdomains)
    step = steps[-1]
    lam = np.concatenate([step.multipliers[contact.normal_row],
                          step.multipliers[contact.tangential_row]])
    u = body.solve(step.weights, -body.B.T @ lam)
    for sub, found in zip(problem.subdomains,
                          problem.operator.displacements(step.multipliers, step.weights)):
        key = 2 * sub.node_gid[sub.dof_node] + sub.dof_component
        # gluing multipliers are right to rtol cond(F): the jump shows in the field
        assert np.abs(found - u[key]).max() <= 1e-6 * np.abs(u).max()


def test_constant_strain_gives_hookes_stress(built):
    """A linear displacement field has the stress of plane strain, the out-of-plane one in von Mises
    included.
    """
    young, nu, (a, b, c) = 21.19e10, 0.277, (1e-3, -2e-4, 5e-4)
    lam, mu = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
    zz = lam * (a + b)
    expected = np.array([(lam + 2 * mu) * a + lam * b, lam * a + (lam + 2 * mu) * b, zz, mu * c])
    tensor = np.array([[expected[0], mu * c, 0], [mu * c, expected[1], 0], [0, 0, zz]])
    deviator = tensor - np.eye(3) * np.trace(tensor) / 3
    for sub in built(reduce=False, cells=4).subdomains[:3]:
        x, y = sub.xy.T
        u = np.column_stack([a * x + 0.2 * c * y, b * y + 0.8 * c * x]).ravel()
        stress = stresses(sub, u, np.ones(1))
        # gradients on cells of size 1/8 lose three digits
        np.testing.assert_allclose(stress, np.tile(expected, (len(stress), 1)), rtol=1e-12)
        corners = corner_stresses(sub, u, np.ones(1), stress)
        np.testing.assert_allclose(corners, np.tile(expected, (len(stress), 3, 1)), rtol=1e-12)
        np.testing.assert_allclose(von_mises(stress), np.sqrt(1.5 * (deviator**2).sum()),
                                   rtol=1e-12)


# ------------------------------------------------------------------------ laws of the solution

@pytest.fixture(params=[1e-11, 1e-6], ids=["tight", "default"])
def tolerance(request):
    """Tolerance of `run`."""
    return request.param


@pytest.fixture(params=LOADINGS)
def run(request, solved, tolerance):
    return solved(loading=request.param, rtol=tolerance, friction_rtol=tolerance)


def test_no_traction_leaves_its_cone(run):
    c = run.contact
    assert np.all(c["sigma_n"] <= 0)
    np.testing.assert_allclose(c["bound"], F * np.abs(c["sigma_n"]), rtol=1e-12)  # two roundings
    assert np.all(np.abs(c["sigma_t"]) <= c["bound"] * (1 + 1e-12))


def test_no_node_penetrates(run, tolerance):
    c, size = run.contact, np.abs(run.contact["u_t"]).max()
    # tolerance times ||d||, a norm over 260 rows, may sit in one node
    allowed = 100 * tolerance * size
    assert np.all(c["u_n"] - c["gap"] <= allowed)
    # complementarity: where there is pressure there is contact
    assert np.all(np.abs(c["u_n"] - c["gap"])[c["sigma_n"] < 0] <= allowed)


def test_status_says_what_the_numbers_say(run):
    c = run.contact
    free, stick, slip = (c["status"] == name for name in ("open", "stick", "slip"))
    assert np.all(free | stick | slip)
    assert np.array_equal(free, c["sigma_n"] == 0)
    assert np.all(np.abs(c["sigma_t"])[stick] < c["bound"][stick])
    # the bound is reached exactly in forces; dividing by the weight may round differently
    np.testing.assert_allclose(np.abs(c["sigma_t"])[slip], c["bound"][slip], rtol=1e-14)


def test_friction_opposes_slip(run, tolerance):
    c = run.contact
    size = np.abs(c["u_t"]).max()
    allowed = 100 * tolerance * size  # as for penetration
    assert np.all((c["sigma_t"] * c["slip"])[c["status"] == "slip"] <= allowed * c["bound"].max())
    assert np.all(np.abs(c["slip"])[c["status"] == "stick"] <= allowed)
    before = np.vstack([0 * c["u_t"][:1], c["u_t"][:-1]])
    np.testing.assert_allclose(c["slip"], c["u_t"] - before, rtol=0, atol=1e-14 * size)


def test_both_histories_stick_slip_and_lift(solved):
    """The example exercises every branch: without this the tests above could pass on empty sets."""
    for loading in LOADINGS:
        assert {"open", "stick", "slip"} <= set(solved(loading=loading,
                                                       **TIGHT).contact["status"].ravel())
    reversed_ = solved(loading="nonmonotone", **TIGHT).contact["slip"]
    assert (reversed_ > 0).any() and (reversed_ < 0).any()


def test_resultants_balance(run):
    """Loads as integrated by hand, contact forces as summed from contact.csv, reactions as
    reported.
    """
    h, c = run.history, run.contact
    load = h["amplitude_1"][:, None] * np.array([3e7, 5e7 - 2e8])
    np.testing.assert_allclose(np.column_stack([h["load_x"], h["load_y"]]), load, rtol=1e-12)
    force = [((c["sigma_n"] * c[f"normal_{a}"] + c["sigma_t"] * t) * c["weight"]).sum(axis=1)
             for a, t in (("x", -c["normal_y"]), ("y", c["normal_x"]))]
    for k, axis in enumerate("xy"):
        np.testing.assert_allclose(h[f"contact_{axis}"], force[k], rtol=0,
                                   atol=1e-12 * np.abs(load).max())
        total = h[f"load_{axis}"] + h[f"reaction_{axis}"] + h[f"contact_{axis}"]
        # K u = f - B' lambda is solved directly for any multipliers: only rounding is left
        assert np.all(np.abs(total) <= 1e-9 * np.abs(load).max(axis=1))
    assert run.summary["balance"] <= 1e-9


def test_reported_residuals_are_small(run, tolerance):
    residuals = run.summary["residuals"]
    assert set(residuals) >= {"stationarity", "gluing", "penetration", "sign", "cone",
                              "complementarity"}
    assert max(residuals.values()) <= 100 * tolerance  # as for penetration
    # the last multipliers were put into the cone of their own pressures
    assert residuals["sign"] == 0 and residuals["cone"] <= 1e-15


# ------------------------------------------------------------------- what must make no difference

MESHES = [{"subdomains": "8x4", "cells": 5}, {"subdomains": "2x1", "cells": 20},
          {"subdomains": "1x1", "cells": 20},
          {"subdomains": "8", "cells": 10}]  # the last by the graph partitioner


@pytest.mark.parametrize("other", MESHES, ids=lambda p: p["subdomains"])
@pytest.mark.parametrize("loading", LOADINGS)
@pytest.mark.some(1)
def test_partition_makes_no_difference(solved, loading, other):
    """40 x 20 cells however cut; the answers differ by cond F times rtol at most (see the oracle
    test).
    """
    reference, found = solved(loading=loading, **TIGHT), solved(loading=loading, **TIGHT, **other)
    assert found.status == 0, found.reason
    assert found.contact["x"].shape == reference.contact["x"].shape, "not the same mesh"
    for name in ("x", "weight", "u_n", "u_t", "sigma_n", "sigma_t"):
        assert_close(found.contact[name], reference.contact[name], 1e-6)


# slow: more ranks than two, with every split of the subdomains, are also test_fetidp's any_split in
# one process and the stack on three ranks of test_energy_error
@pytest.mark.parametrize("loading, ranks", [
    ("monotone", 2), pytest.param("nonmonotone", 2, marks=pytest.mark.slow),
    pytest.param("nonmonotone", 4, marks=pytest.mark.slow)])
def test_ranks_make_no_difference(solved, loading, ranks):
    """Any number of ranks, FreeFEM's part included.

    Sums are taken in the same order, so even the bits agree.
    """
    one, other = solved(loading=loading), solved(loading=loading, NP=ranks)
    assert other.summary["ranks"] == ranks
    for table in ("contact", "history"):
        for name, column in getattr(one, table).items():
            np.testing.assert_array_equal(getattr(other, table)[name], column)
    for name in ("counts", "residuals", "balance", "dissipated", "quantities", "uniqueness",
                 "warnings"):
        assert other.summary[name] == one.summary[name], name


def with_units(variant, length, stress):
    """The scene in units `length` metres and `stress` pascals."""

    def number(value):
        return repr(float(value))

    return variant(f"units_{length}_{stress}",
                   ("real E = 21.19e10", f"real E = {number(21.19e10 / stress)}"),
                   ("rectangle(0., 2., 0., 1.);",
                    f"rectangle(0., {number(2 / length)}, 0., {number(1 / length)});"),
                   ("traction(3, 0., -10e7)", f"traction(3, 0., {number(-10e7 / stress)})"),
                   ("traction(2, 3e7, 5e7)",
                    f"traction(2, {number(3e7 / stress)}, {number(5e7 / stress)})"))


@pytest.mark.parametrize("loading", LOADINGS)
@pytest.mark.parametrize("length, stress", [(1, 1e6), (1e-3, 1), (1e-3, 1e6), (1e3, 1e-3)])
@pytest.mark.some(1)
def test_units_make_no_difference(solved, variant, loading, length, stress):
    """Pa to MPa, m to mm, both (N, mm, MPa), and something silly: same answers, same counts of
    every kind.
    """
    reference, found = solved(loading=loading), solved(with_units(variant, length, stress),
                                                       loading=loading)
    assert found.status == 0, found.reason
    scale = {"x": length, "u_n": length, "u_t": length, "sigma_n": stress, "sigma_t": stress}
    for name, factor in scale.items():
        # same iterates but for rounding; had they taken another path they would differ by the
        # tolerance
        assert_close(found.contact[name] * factor, reference.contact[name], 1e-5)
    assert found.summary["counts"] == reference.summary["counts"]


@pytest.mark.parametrize("length, stress, friction", [
    (2.0**-10, 2.0**20, 0.6),
    *(pytest.param(*other, marks=pytest.mark.slow)  # the others
      for other in ((2.0**8, 2.0**-30, 1), (2.0**-10, 2.0**20, 1), (2.0**8, 2.0**-30, 0.6)))])
def test_binary_units_change_not_a_bit(solved, variant, friction, length, stress):
    """Even powers of two scale without rounding, square roots included: any difference shows an
    absolute constant.
    """
    options = {"loading": "nonmonotone", "friction": friction}
    reference, found = solved(**options), solved(with_units(variant, length, stress), **options)
    assert found.summary["counts"] == reference.summary["counts"]
    for name, factor in {"u_n": length, "u_t": length, "sigma_n": stress,
                         "sigma_t": stress}.items():
        assert np.array_equal(found.contact[name] * factor, reference.contact[name])
    logs = [read_table(run.directory / "convergence.csv")["residual"] for run in (found, reference)]
    assert np.array_equal(*logs)  # relative ones


# --------------------------------------------------------------------------- counts of the slides

SLIDES = {"4x2": {"monotone": (135, 6515), "nonmonotone": (120, 5565)},
          "8x4": {"monotone": (136, 8326), "nonmonotone": (121, 7309)}}


# slow: the plain method on the larger mesh says no more than on the smaller one
@pytest.mark.parametrize("loading", LOADINGS)
@pytest.mark.parametrize("subdomains, method", [
    ("4x2", PLAIN), ("4x2", {}), ("8x4", {}),
    pytest.param("8x4", PLAIN, marks=pytest.mark.slow)],
    ids=["4x2 plain", "4x2 default", "8x4 default", "8x4 plain"])
@pytest.mark.some(3)
def test_counts_are_not_above_the_slides(solved, subdomains, loading, method):
    found = solved(loading=loading, subdomains=subdomains, **method)
    assert found.status == 0, found.reason
    iterations, products = SLIDES[subdomains][loading]
    counts = found.summary["counts"]
    assert counts["fixed_point_iterations"] <= iterations
    assert counts["dual_multiplications"] <= products
    assert found.history["dual_multiplications"].sum() == counts["dual_multiplications"]
    assert found.history["fixed_point_iterations"].sum() == counts["fixed_point_iterations"]


@pytest.mark.parametrize("loading", LOADINGS)
@pytest.mark.slow
def test_plain_and_default_method_find_the_same(solved, loading):
    default, plain = (solved(loading=loading, cells=5, **TIGHT, **method) for method in ({}, PLAIN))
    for name in ("u_n", "u_t", "sigma_n", "sigma_t"):
        assert_close(plain.contact[name], default.contact[name], 1e-6)  # as against the oracle


# --------------------------------------------------------------------------- special cases

def test_monotone_loading_is_proportional(solved):
    """Zero gap, zero start and a load t P: the solution is t times that of t = 1 (cones are cones).
    """
    c, times = solved(loading="monotone", **TIGHT).contact, np.arange(1, 21) / 20
    for name in ("u_n", "u_t", "sigma_n", "sigma_t"):
        # the tolerance is relative to the largest load so far: early steps are as exact as late
        # ones
        assert_close(c[name], times[:, None] * c[name][-1], 1e-6)


@pytest.mark.slow  # runs of one and of twenty steps
def test_step_count_does_not_matter_for_a_monotone_load(solved):
    one, twenty = (solved(loading="monotone", steps=n, **TIGHT) for n in (1, 20))
    for name in ("u_n", "u_t", "sigma_n", "sigma_t"):
        assert_close(one.contact[name][-1:], twenty.contact[name][-1:], 1e-6)


def test_nonmonotone_history_matters(solved):
    """phi(1) = 1 under both loadings, but friction remembers."""
    a, b = (solved(loading=loading, **TIGHT).contact["sigma_t"][-1] for loading in LOADINGS)
    assert np.abs(a - b).max() > 0.05 * np.abs(a).max()


def test_no_friction_no_tangential_traction(solved, built):
    """FRICTION=0: the frictionless contact problem, whose dense dual QP an active set solves."""
    found = solved(friction=0, steps=1, **TIGHT)
    assert found.status == 0, found.reason
    assert not found.contact["sigma_t"].any() and "stick" not in found.contact["status"]
    problem = built(reduce=False, friction=0, steps=1)
    body = Assembled(problem.manifest, problem.subdomains)
    n = len(body.gid)
    C, d = body.compliance()[:n, :n], (body.B @ body.solve([1.0]))[:n]
    pressure = box_qp(C, d - body.gap, np.zeros(n), np.full(n, np.inf))
    assert_close(found.contact["sigma_n"], -pressure[None] / body.weight, 1e-6)


def test_scene_without_friction_has_no_tangential_rows(solved, variant):
    """Leaving the macro away is the same problem with half the contact rows."""
    scene = variant("frictionless", ("macro friction() F //\n", ""))
    found, zero = solved(scene, steps=1, **TIGHT), solved(friction=0, steps=1, **TIGHT)
    assert found.summary["sizes"]["dual_tangential"] == 0
    assert found.summary["effects"]["friction"] == "none"
    for name in ("u_n", "u_t", "sigma_n"):
        assert_close(found.contact[name], zero.contact[name], 1e-6)


def test_gap_shifts_the_contact(solved, variant):
    """A gap wider than the lifted body can close leaves it free of contact; a narrow one closes in
    part.
    """
    wide, narrow = (solved(variant(f"gap{g}", ("macro contact() 1 //",
                                               f"macro contact() 1 //\nmacro gap() {g} //")),
                           steps=2, **TIGHT) for g in ("1.", "2e-5"))
    assert wide.status == 0 and narrow.status == 0
    assert set(wide.contact["status"].ravel()) == {"open"} and not wide.contact["sigma_n"].any()
    c = narrow.contact
    touching = c["status"] != "open"
    assert touching[-1].any() and not touching[-1].all()
    np.testing.assert_allclose(c["u_n"][touching], 2e-5, rtol=1e-6)  # cond F times rtol


def test_no_load_no_answer_but_zero(solved, variant):
    """A load of zero must not divide by it."""
    scene = variant("idle", ("-10e7", "0."), ("3e7, 5e7", "0., 0."))
    found = solved(scene, steps=2, cells=4)
    assert found.status == 0, found.reason
    for name in ("u_n", "u_t", "sigma_n", "sigma_t"):
        assert not found.contact[name].any()


# ----------------------------------------------------------------------------- honest failure

def test_iteration_limit_of_the_fixed_point(solved):
    found = solved(max_fixed_point=1)
    assert found.status == 4 and "fixed point" in found.reason and "1 iteration" in found.reason
    assert found.summary["converged"] is False and found.summary["warnings"]
    assert found.summary["steps"] == 1 and len(found.contact["x"]) == 1


def test_iteration_limit_of_mprgp(solved):
    found = solved(max_products=3)
    assert found.status == 4 and "MPRGP" in found.reason
    assert found.summary["converged"] is False


@pytest.mark.slow  # hundreds of iterations
def test_fixed_point_that_does_not_contract_is_stopped(built, steps_of, monkeypatch):
    """A friction bound that never settles: stopped with a reason long before the iteration limit.
    """
    from driver.contact.rows import ContactRows

    bound, rng = ContactRows.friction_bound, np.random.default_rng(0)
    monkeypatch.setattr(ContactRows, "friction_bound", lambda self,
                        x: bound(self, x) * (1 + 0.1 * rng.random()))
    solver, steps = steps_of(built(cells=4), max_fixed_point=1000)
    assert solver.failure.exit_status == 3 and "step 1" in str(solver.failure)
    assert "not contract" in str(solver.failure)
    assert len(steps) == 1 and steps[0].fixed_point_iterations < 200


@pytest.mark.parametrize("friction", [1, 2, 5, 30, 300])
@pytest.mark.some(1)
def test_large_friction_is_solved(solved, friction):
    """A step has a solution for any coefficient, perhaps several: one is found, and that is said.
    """
    found = solved(friction=friction, loading="nonmonotone", steps=5)
    assert found.status == 0, found.reason
    assert (found.summary["uniqueness"]["verdict"] == "not unique") == (friction > 5)
    residuals = dict(found.summary["residuals"])
    # lost dissipation is reported against the pressure, friction forces are up to F times that
    assert residuals.pop("complementarity") <= 1e-4 * max(1, friction)
    assert max(residuals.values()) <= 1e-4


# -------------------------------------------------------------------------- work of friction

@pytest.mark.slow
def test_dissipated_energy_is_of_second_order_in_the_step(solved):
    # the rule of the implicit Euler method errs by 18, 9, 5 % with 10, 20, 40 steps
    lost = {steps: solved("model", loading="nonmonotone", steps=steps).summary["dissipated"]
            for steps in (10, 20, 80)}
    assert lost[10] == pytest.approx(lost[80], rel=0.01)
    assert lost[20] == pytest.approx(lost[80], rel=0.005)


def test_dissipated_energy_of_proportional_loading_needs_one_step(solved):
    one, many = (solved("model", loading="monotone", steps=steps, rtol=1e-10, friction_rtol=1e-10)
                 for steps in (1, 8))
    # what tolerances of 1e-10 leave, in sums over steps
    assert one.summary["dissipated"] == pytest.approx(many.summary["dissipated"], rel=1e-6)
