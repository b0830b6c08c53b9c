"""Parts of the error in the energy norm, and what runs say of them."""

import json
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from bounds import expected_total, true_error
from driver.energy_norm import energy
from driver.energy_norm.bound import COULOMB, EARLIER, coupling
from driver.energy_norm.energy import EnergyEstimator, of_time
from driver.estimates import budget_words


@pytest.mark.parametrize("element, kind, why, taken", [
    ("P1", "equilibrated", "", "equilibrated"), ("P1", "equilibrated", "points", "recovery"),
    ("P2", "equilibrated", "", "recovery"), ("P1", "recovery", "points", "recovery"),
    ("P2", "none", "", "none")])
def test_smoothed_stresses_take_the_place_of_a_bound_that_there_is_not(monkeypatch, element, kind,
                                                                      why, taken):
    """And only there it is said why: who asks for them gets what was asked for."""
    monkeypatch.setattr(energy, "Effects", lambda manifest: SimpleNamespace(no_bound=lambda: why))
    monkeypatch.setattr(EnergyEstimator, "_changes_kind", lambda self: False)
    operator = SimpleNamespace(structure=None, comm=MPI.COMM_SELF)
    found = EnergyEstimator(operator, SimpleNamespace(element=element), None, kind)
    assert found.kind == taken and bool(found.why) == (taken != kind)
    steps = [SimpleNamespace(index=k) for k in range(4)]
    for step, stored in zip(steps, (1.0, 3.0, 3.0, 2.0)):
        found.consider(step, {"step": step.index}, stored)
    # the last one, and the first of those with most energy, in the order in which they came
    assert sorted(step.index for step, _ in found.considered) == [1, 3]


@pytest.mark.slow  # four runs
def test_parts_answer_to_their_own_knob(estimated):
    base = dict(cells=4, steps=2, loading="nonmonotone")
    loose = (("rtol", 1e-3), ("primal_rtol", 1.0), ("friction_rtol", 1e-10), ("inner_rtol", 1e-9))
    tight = (("rtol", 1e-9), *loose[1:])
    one, two = estimated(settings=loose, **base)[2], estimated(settings=tight, **base)[2]
    assert one.solver > 1e3 * two.solver and one.mesh == pytest.approx(two.mesh, rel=0.02)
    finer = estimated(settings=tight, **{**base, "cells": 8})[2]
    assert finer.mesh < 0.75 * two.mesh and max(finer.solver, two.solver) < 1e-4 * finer.mesh
    early = (("rtol", 1e-9), ("friction_rtol", 0.3), ("inner_rtol", 1e-9))
    one, two = (estimated(settings=s, **base, friction=0.8)[2] for s in (early, tight))
    assert one.friction > 1e3 * max(two.friction, one.solver)
    assert one.mesh == pytest.approx(two.mesh, rel=0.02)


@pytest.mark.parametrize("load, kept", [(1e-5, [2, 1]), (1e-7, [1])])
def test_a_last_step_that_tolerances_leave_is_left_out(load, kept):
    """By the root of energies: of displacements, 1e-5 of the largest are a load and 1e-7 none."""
    estimator = object.__new__(EnergyEstimator)
    estimator.kind, estimator.last, estimator.largest = "recovery", None, None
    estimator.carrying = None
    estimator.operator = SimpleNamespace(comm=MPI.COMM_SELF)
    estimator._estimate = lambda step, state: None
    for index, size in ((1, 1.0), (2, load)):
        estimator.consider(SimpleNamespace(index=index), {}, size**2)
    assert [step.index for step, _ in estimator.estimates()] == kept


@pytest.mark.parametrize("forces, energies, estimated", [
    ((1.0, 3.0, 0.0), (1.0, 2.0, 5.0), 2),  # lost at the end: that in which it carries most
    ((1.0, 3.0, 2.0), (1.0, 2.0, 5.0), None), ((1.0, 3.0, 0.0), (1.0, 9.0, 5.0), None),
    ((0.0, 0.0, 0.0), (1.0, 2.0, 5.0), None)])
def test_the_step_of_the_quantities_is_kept_where_contact_is_lost(monkeypatch, forces, energies,
                                                                   estimated):
    """And estimated, unless it is one of the others, or nothing ever touches."""
    monkeypatch.setattr(EnergyEstimator, "_no_bound", lambda self: "points")
    of = EnergyEstimator(SimpleNamespace(structure=None, comm=MPI.COMM_SELF),
                         SimpleNamespace(element="P1"),
                         SimpleNamespace(boundary=SimpleNamespace(weight=np.ones(1))),
                         "equilibrated")
    of._estimate = lambda step, state: step.index
    for k, (force, stored) in enumerate(zip(forces, energies)):
        of.consider(SimpleNamespace(index=k + 1), {"sigma_n": np.array([-force])}, stored)
    assert of.unloaded(of.estimates()) == estimated
    assert [of.kept(k) is None for k in (2, 3)] == [not any(forces), False]
    looked_at = {step.index for step, _ in of.considered}  # validity, sizes of the next mesh
    assert (2 in looked_at) == (estimated == 2 or energies[1] > energies[2])


def test_the_friction_part_is_the_way_to_the_fixed_point(estimated):
    """Displacements of an early and of the last iterate: their distance is the friction part, to a
    factor of two.
    """
    base = dict(cells=4, steps=2, loading="nonmonotone", friction=0.8)
    early, last = (estimated(settings=(("rtol", 1e-9), ("friction_rtol", tolerance),
                                       ("inner_rtol", 1e-9)), **base)
                   for tolerance in (0.3, 1e-10))
    assert 0.5 < true_error(early[1], last[1]) / early[2].friction < 2
    problem, estimator, found = early
    step = estimator.last[1]
    onward = np.sqrt(step.moved @ problem.operator.apply(step.moved)) / (1 - step.contraction)
    # of a sum 1e4 times as large
    rest = found.total - found.correction - expected_total(estimator)
    assert rest == pytest.approx(onward, rel=1e-3)


def test_point_loads_have_no_estimate(variant, estimated):
    pushed = variant("pushed-point", (
        'include "export.idp"', 'macro pointLoad1() [2., 1., 0., -1e5] //\ninclude "export.idp"'))
    assert "point loads" in estimated(pushed, cells=2, steps=1)[2].reason


@pytest.mark.slow
def test_displacements_under_point_loads_have_no_claim(variant, solved):
    """They grow like the logarithm of the elements; other quantities keep theirs."""
    of = {}
    for name, push in (("point", "macro pointLoad1() [2., 1., 0., -1e5]"), ("plain", "")):
        path = variant(f"pushed-{name}", (
            'include "export.idp"', f'{push} //\ninclude "export.idp"'))
        of[name] = solved(path, cells=4, steps=2, errors="yes").summary["errors"]["quantities"]
    assert of["point"]["displacement"]["total"] is None
    assert "does not converge" in of["point"]["displacement"]["note"]
    assert of["plain"]["displacement"]["total"] > 0
    assert of["point"]["normal_resultant"]["total"] > 0


def test_the_summary_and_the_field_agree(solved):
    run = solved("model", loading="nonmonotone", cells=3, steps=4, fields="yes", errors="energy")
    found = run.summary["errors"]["energy"]
    assert found["kind"] == "equilibrated" and found["step"] == 4
    assert found["total"] <= sum(found[name] for name in ("mesh", "solver", "friction",
                                                          "correction"))
    assert found["relative"] == pytest.approx(found["total"] / found["norm"])
    # phi_2 is largest at t = 0.625
    assert found["largest"]["step"] == 2 and found["largest"]["norm"] > found["norm"]
    for entry in (found, found["largest"]):
        mesh = meshio.read(run.directory / f"fields/error_{entry['step']:04d}.vtu")
        field = mesh.cell_data["error_indicator"][0]
        # the field leaves out what contact adds between nodes
        assert np.linalg.norm(field) == pytest.approx(entry["mesh"], rel=1e-2)
    assert not (run.directory / "fields/error_0003.vtu").exists()
    assert (run.directory / "error.pvd").read_text().count("<DataSet") == 2
    assert (run.directory / "fields.pvd").read_text().count("<DataSet") == 5


def test_what_the_friction_bound_adds_is_the_sum_of_all_rounds():
    """total (q + q^2 + ...): each round of successive approximations errs q times the last."""
    for rate in (0.0, 0.1, 0.5, 0.9):
        rounds = sum(0.3 * rate**k for k in range(1, 500))
        assert coupling(0.3, rate) == pytest.approx(rounds, abs=1e-12)
    assert coupling(0.3, np.nan) == 0.0  # no change of the bound was seen
    assert np.isfinite(coupling(0.3, 1.2))


@pytest.mark.slow
def test_what_coulombs_law_and_time_add_is_named_beside_the_bound(solved):
    """Only where there are such: not with a given friction bound, nor in a single step."""
    run = solved("model", loading="nonmonotone", cells=4, steps=8, errors="yes")
    found = run.summary["errors"]["energy"]
    assert 0 < found["coupling"] < found["total"]
    work = run.summary["errors"]["quantities"]["dissipated_energy"]["time"]
    assert found["time"] ** 2 / 2 == pytest.approx(work)
    assert {EARLIER, COULOMB} < set(found["excluded"])
    words = budget_words.describe_energy(found)
    assert "Coulomb's law about" in words[1] and EARLIER in words[2]
    given = solved("model-tresca", cells=3, steps=1, errors="energy").summary["errors"]["energy"]
    assert given["coupling"] == 0 and not {EARLIER, COULOMB} & set(given["excluded"])


@pytest.mark.slow
def test_a_long_way_adds_nothing_to_the_error_of_what_is_stored(solved, tmp_path):
    """A pad whose ends are held in x slides steadily: its stresses do not know how far.

    The bound is at most that of a way of a hundredth: beside the ends all shear is F |sigma_n|, of
    which the friction bound misses nothing. Work of friction on it says nothing of what is stored.
    """
    scene = tmp_path / "pad.edp"
    scene.write_text("""include "scene.idp"
real way = physical("way", 5.);
rectangle(0., 7., 0., 3.);
quasistatic(1.);
macro young() 800. //
macro poisson() 0.25 //
macro support() on(2, u1 = 0.) + on(4, u1 = 0.) //
macro load1() pressure(3, 3.) //
macro contact() 1 //
macro friction() 0.35 //
macro obstacleX(t) way*t //
include "export.idp"
""")
    near, far = (solved(str(scene), way=way, cells=6, steps=3, errors="energy")
                 .summary["errors"]["energy"] for way in (5.0, 500.0))
    assert far["total"] == pytest.approx(near["total"], rel=0.05) and far["relative"] < 0.1
    stored = far["norm"] ** 2 / 2
    for taken in (0.5, 2.0):
        work = {"dissipated_energy": {"value": taken * stored, "time": 0.01 * stored}}
        assert of_time(work, far) == ({"time": pytest.approx(0.02**0.5 * stored**0.5)}
                                      if taken < 1 else {})


@pytest.mark.slow
def test_any_number_of_ranks_gives_the_same_estimate(solved):
    one, two = (solved("model", loading="nonmonotone", cells=3, steps=2, fields="yes",
                       errors="energy", np=n)
                for n in (1, 2))
    assert json.dumps(one.summary["errors"]) == json.dumps(two.summary["errors"])
    fields = [meshio.read(run.directory / "fields/error_0002.vtu").cell_data["error_indicator"][0]
              for run in (one, two)]
    assert np.array_equal(*fields)


@pytest.mark.slow
def test_pairs_on_any_number_of_ranks_give_the_same_estimate(solved):
    one, two = (solved("stack", subdomains="5", steps=1, errors="energy", np=n) for n in (1, 3))
    assert one.summary["errors"]["energy"]["total"] > 0
    assert json.dumps(one.summary["errors"]) == json.dumps(two.summary["errors"])


def test_kinds(solved):
    run = solved("model", cells=3, steps=1, errors="energy",
                 estimator="recovery").summary["errors"]["energy"]
    assert run["kind"] == "recovery" and run["total"] == run["mesh"] > 0
    assert run["solver"] == run["friction"] == 0
    assert solved("model", cells=3, steps=1, errors="energy",
                  estimator="none").summary["errors"]["energy"] == {"kind": "none"}
    assert solved("model", cells=3, steps=1, estimator="exact").status == 2


def test_an_unloaded_end_is_left_to_the_largest_step(solved):
    """The bar's load goes back to nothing: there rounding would be compared with rounding."""
    found = solved("bar", cells=2, steps=4, errors="energy").summary["errors"]["energy"]
    assert found["step"] == 2 and "largest" not in found
