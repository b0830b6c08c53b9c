"""Forces on a vertex in a corner, shared between its sides: against a program of its own."""

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

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
@pytest.mark.parametrize("seed", range(4))
def test_the_least_friction_is_that_of_a_linear_program(seed, cohesion):
    """p_1, p_2, and q as a difference of two parts."""
    normals, F, c, force, _ = corner(seed, cohesion)
    p, q = least_friction(force, normals, F, c, np.zeros(2, bool))
    fits(force, normals, F, c, p, q)
    t = tangents(normals)
    bounds = np.hstack([-np.diag(F), np.eye(2), -np.eye(2)])
    bounds = np.vstack([bounds, np.hstack([-np.diag(F), -np.eye(2), np.eye(2)])])
    answer = linprog([0, 0, 1, 1, 1, 1], A_ub=bounds, b_ub=np.tile(c, 2),
                     A_eq=np.vstack([normals, t, -t]).T, b_eq=force)
    assert np.abs(q).sum() == pytest.approx(answer.fun, abs=1e-9)


def test_forces_that_nothing_bears_are_shared_by_nobody():
    """A pull; borne where one side is bilateral."""
    normals, none = np.array([[0.0, 1.0], [1.0, 0.0]]), np.zeros(2)
    pull = np.array([1.0, -1.0])
    for share in (least_friction, lambda *given: alike(*given, np.zeros((2, 2)))):
        assert share(pull, normals, none, none, np.zeros(2, bool)) is None
        p, q = share(pull, normals, none, none, np.array([True, False]))
        np.testing.assert_allclose(p, [-1, 1])
        assert not q.any()
