"""The bound against nested references and closed forms, near the solution and far from it."""

import numpy as np
import pytest

from bounds import expected_total, reported, slip_away, stir, true_error
from test_scenes_zones import strain as exact_zones


NESTED = [("model", dict(cells=4, steps=2, loading="nonmonotone"), 32),
          ("model-tresca", dict(cells=4, steps=1), 32),
          ("hertz", dict(h=0.006), 4), ("punch", dict(h=0.15, steps=2), 4),
          ("pressfit", dict(h=6), 4),
          ("bracket", dict(h=12, steps=2), 4), ("wedge", dict(steps=1), 4),
          ("hertz-bodies", dict(h=0.016), 4),
          ("joint", dict(h=1.6, steps=5), 4), ("mindlin-bodies", dict(h=0.3, steps=3), 3)]


LONG = "hertz", "bracket", "wedge", "joint"  # the other scenes have what these have


@pytest.mark.parametrize("scene, parameters, finer", [
    pytest.param(*case, marks=[pytest.mark.slow] * (case[0] in LONG)) for case in NESTED])
@pytest.mark.some(1)
def test_effectivity_against_a_nested_mesh(estimated, split, scene, parameters, finer):
    """The overkill error is too small by the error of the fine mesh itself: the bound must exceed
    it, and not by far.
    """
    if "cells" in parameters:
        coarse, fine = estimated(scene,
                                 **parameters), estimated(scene, **{**parameters, "cells": finer})
    else:
        coarse = estimated(split(scene, 1), **parameters)
        same = coarse[0].structure.contact if coarse[0].structure.contact.paired.any() else None
        fine = estimated(split(scene, finer), gap=same, **parameters)
    # of what the run reports and of what the bound is made with
    own, error = true_error(coarse[1], fine[1], reported(coarse[1])), true_error(coarse[1], fine[1])
    bound = coarse[2].total - coarse[2].correction
    assert error <= bound <= 2 * error and own <= coarse[2].total <= 2.5 * own
    # the correction is the distance between the two
    assert own <= error + 1.01 * coarse[2].correction
    assert fine[2].total < coarse[2].total


def exact_cantilever(x, y):
    """Strains e11, e22, 2 e12 of the displacement that edp/cantilever.edp gives."""
    w, k, a = 0.0025, 1.3, 0.005
    e = w * k * np.cos(k * x) * np.cos(k * y)
    return np.stack([e, e, -2 * w * k * np.sin(k * x) * np.sin(k * y) + 2 * a * x], axis=-1)


def exact_ring(x, y, b=20.0, c=35.0, interference=0.05, nu=0.3):
    """Lame: u_r = A r + B/r with u_r(b) = interference, sigma_r(c) = 0 in plane strain."""
    slope = (1 - 2 * nu) / c**2  # A / B
    B = interference / (slope * b + 1 / b)
    A, r = slope * B, np.hypot(x, y)
    radial, hoop, cos, sin = A - B / r**2, A + B / r**2, x / r, y / r
    return np.stack([radial * cos**2 + hoop * sin**2, radial * sin**2 + hoop * cos**2,
                     2 * (radial - hoop) * cos * sin], axis=-1)


@pytest.mark.parametrize("scene, exact, parameters", [
    ("cantilever", exact_cantilever, dict(cells=3)),
    ("cantilever", exact_cantilever, dict(cells=9, subdomains="5")),
    ("pressfit", exact_ring, dict(h=3)), ("pressfit", exact_ring, dict(h=1.5)),
    ("zones", exact_zones, dict(cells=8, steps=1)),
    ("zones", exact_zones, dict(cells=16, steps=1, subdomains="6"))])
@pytest.mark.some(3)
def test_effectivity_against_a_closed_form(estimated, scene, exact, parameters):
    """Elasticity, Lame's ring (whose polygon it does not see: that errs by h^2 against an error of
    order h), and contact that sticks, slips and opens."""
    _, estimator, found = estimated(scene, **parameters)
    body = estimator.body
    corner = body.mesh.corner
    # edge midpoints: exact for squares
    points = np.einsum("qn,tni->tqi", (np.ones((3, 3)) - np.eye(3)) / 2, corner)
    apart = exact(*points.transpose(2, 0, 1)) - body.strain(estimator.kinematic)[:, None]
    error = np.sqrt(np.einsum("tqi,tij,tqj,t->", apart, body.elasticity, apart, body.mesh.area / 3))
    assert 0.99 * error <= found.total <= 1.5 * error, found.total / error


def test_effectivity_of_recovery_is_near_one_where_the_solution_is_smooth(estimated):
    one, two = (estimated("cantilever", kind=kind, cells=9, subdomains="5")[2]
                for kind in ("equilibrated", "recovery"))
    assert two.total == pytest.approx(one.total, rel=0.1)


@pytest.mark.slow  # a fine mesh for reference
def test_the_bound_holds_far_from_the_solution(estimated):
    """With a given friction bound any admissible pair is bounded: this needs every term of the
    duality gap.
    """
    fine = estimated("model-tresca", cells=32, steps=1)[1]
    _, estimator, found = estimated("model-tresca", cells=4, steps=1, change=stir)
    error = true_error(estimator, fine)
    undisturbed = true_error(estimated("model-tresca", cells=4, steps=1)[1], fine)
    assert error > 1.2 * undisturbed
    assert error <= found.total <= found.mesh + found.solver + found.correction
    assert found.solver > 0.5 * found.mesh


def test_the_total_is_that_of_its_stress_and_displacements(estimated):
    """The estimate adds up squares and products of small differences; here the two stresses are
    subtracted.
    """
    _, estimator, found = estimated("model-tresca", cells=4, steps=1, change=stir)
    # vertices are out of balance by rounding
    body = estimator.body
    apart = body.norm(body.stress(estimator.kinematic - reported(estimator)))
    assert apart > 0.1 * found.total
    assert found.total == pytest.approx(expected_total(estimator) + apart, rel=1e-6)


def test_the_duality_gap_is_the_integral_over_the_contact_boundary(estimated):
    """By a rule of many points; slip changes its sign inside edges, where the rule is good to
    1/n^2.
    """
    _, estimator, _ = estimated("model-tresca", cells=4, steps=1, change=stir)
    c, n = estimator.contact, 2000
    assert (np.diff(np.sign(c.slip[c.node]), axis=1) != 0).any() and c.distance.max() > 0
    at = (np.arange(n) + 0.5) / n

    def along(value):
        return (1 - at) * value[c.node[:, :1]] + at * value[c.node[:, 1:]]

    pressure, shear, bound, distance, slip = map(along,
                                                 (c.pressure, c.shear, c.bound, c.distance, c.slip))
    parts = [(c.length @ term.mean(axis=1))
             for term in (pressure * distance, bound * np.abs(slip) + shear * slip)]
    assert min(parts) > 1e-3 * max(parts)
    assert c.duality_gap() == pytest.approx(sum(parts), rel=1e-5)


def test_lost_friction_shows_in_the_duality_gap(estimated):
    """The displacements are those of equilibrium without friction: only the contact term can tell.
    """
    fine = estimated("model-tresca", cells=32, steps=1)[1]
    _, estimator, found = estimated("model-tresca", cells=4, steps=1, change=slip_away)
    assert found.total >= true_error(estimator, fine)
    assert estimator.contact.duality_gap() > 0.2 * found.mesh**2
    assert found.solver > 0.3 * found.mesh
