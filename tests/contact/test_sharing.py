"""Forces on a vertex in a corner, shared between its sides: against a program of its own."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from driver.contact.acting import BOTH, FIRST, SECOND, STANDING
from driver.contact.corner_nodes import CornerNodes
from driver.contact.sharing import alike, least_friction


def corner(seed: int, cohesion: bool):
    """Normals, friction, offsets of two sides and a force that they can bear, with their parts."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi) + np.array([0.0, rng.uniform(0.6, 2.5)])
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    F, c = rng.uniform(0, 1, 2), rng.uniform(0, 0.3, 2) * cohesion
    p = rng.uniform(0, 2, 2)
    q = rng.uniform(-1, 1, 2) * (F * p + c)
    return normals, F, c, p @ normals + q @ tangents(normals), q


def tangents(normals):
    return np.column_stack([-normals[:, 1], normals[:, 0]])


def fits(force, normals, F, c, p, q):
    np.testing.assert_allclose(p @ normals + q @ tangents(normals), force, atol=1e-9)
    assert (p >= 0).all() and (np.abs(q) <= F * p + c + 1e-9).all()


@pytest.mark.parametrize("cohesion", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_forces_are_nearest_to_those_beside(seed, cohesion):
    """By the sum of squares of all four, among those that the law of friction allows."""
    normals, F, c, force, start = corner(seed, cohesion)
    beside = np.random.default_rng(100 + seed).standard_normal((2, 2))
    p, q = alike(force, normals, F, c, np.zeros(2, bool), beside)
    fits(force, normals, F, c, p, q)
    own, turn = (np.linalg.solve(normals.T, of) for of in (force, tangents(normals).T))

    def away(q):
        return ((own - turn @ q - beside[:, 0]) ** 2).sum() + ((q - beside[:, 1]) ** 2).sum()

    limits = [lambda q: own - turn @ q, lambda q: F * (own - turn @ q) + c - q,
              lambda q: F * (own - turn @ q) + c + q]
    best = minimize(away, start, tol=1e-12, constraints=[{"type": "ineq", "fun": one}
                                                         for one in limits])
    assert away(q) <= away(best.x) + 1e-6


@pytest.mark.parametrize("cohesion", [False, True])
@pytest.mark.parametrize("before", [(0.0, 0.0), (0.3, -0.1)])
@pytest.mark.parametrize("seed", range(4))
def test_the_least_friction_is_that_of_a_linear_program(seed, before, cohesion):
    """p_1, p_2, and q from what was there before as a difference of two parts."""
    (normals, F, c, force, _), before = corner(seed, cohesion), np.array(before)
    p, q = least_friction(force, normals, F, c, np.zeros(2, bool), before)
    fits(force, normals, F, c, p, q)
    t = tangents(normals)
    bounds = np.hstack([-np.diag(F), np.eye(2), -np.eye(2)])
    bounds = np.vstack([bounds, np.hstack([-np.diag(F), -np.eye(2), np.eye(2)])])
    answer = linprog([0, 0, 1, 1, 1, 1], A_ub=bounds, b_ub=[*(c - before), *(c + before)],
                     A_eq=np.vstack([normals, t, -t]).T, b_eq=force - before @ t)
    assert np.abs(q - before).sum() == pytest.approx(answer.fun, abs=1e-9)
    # those forces go on as they are
    again = least_friction(force, normals, F, c, np.zeros(2, bool), q)
    np.testing.assert_allclose(again, (p, q), atol=1e-9)


def test_forces_that_nothing_bears_are_shared_by_nobody():
    """A pull; borne where one side is bilateral."""
    normals, none = np.array([[0.0, 1.0], [1.0, 0.0]]), np.zeros(2)
    pull = np.array([1.0, -1.0])
    for share in (least_friction, lambda *given: alike(*given, np.zeros((2, 2)))):
        assert share(pull, normals, none, none, np.zeros(2, bool)) is None
        p, q = share(pull, normals, none, none, np.array([True, False]))
        np.testing.assert_allclose(p, [-1, 1])
        assert not q.any()


@pytest.mark.parametrize("size", [0.25, 4.0])
@pytest.mark.parametrize("force, offset, bilateral, expected", [
    ((0.5, 2.0), 0.0, (False, False), BOTH), ((-0.5, 2.0), 0.0, (False, False), FIRST),
    ((2.0, -0.5), 0.0, (False, False), SECOND), ((-0.7, 2.0), 0.0, (False, False), STANDING),
    ((-0.7, 2.0), 0.2, (False, False), FIRST), ((-0.5, 2.0), 0.0, (False, True), BOTH),
    ((-0.5, -2.0), 0.0, (False, False), STANDING)])
def test_who_holds_a_right_corner(force, offset, bilateral, expected, size):
    """Both by pressures, or one in whose friction cone the force is, whatever its size."""
    nodes = object.__new__(CornerNodes)
    nodes.directions, nodes.bilateral = np.array([[[0.0, 1.0], [1.0, 0.0]]]), np.array([bilateral])
    nodes.in_tangential = np.array([[0, 1]])
    rows = SimpleNamespace(coefficient=np.full(2, 0.3), offset=np.full(2, offset * size))
    assert nodes._state_of(0, size * np.array(force), rows) == expected


@pytest.mark.parametrize("cohesion", [False, True])
def test_friction_that_was_at_its_bound_is_there_to_the_last_bit(cohesion):
    """Whether the node slips is told by comparison with the bound, alike for every cut."""
    for seed in range(20):
        normals, F, c, *_ = corner(seed, cohesion)
        pressures = np.random.default_rng(seed).uniform(0.5, 2, 2)
        before = np.array([1, -1]) * (F * pressures + c)
        force = pressures @ normals + before @ tangents(normals)
        p, q = least_friction(force, normals, F, c, np.zeros(2, bool), before)
        np.testing.assert_array_equal(np.abs(q), F * np.abs(p) + c)
