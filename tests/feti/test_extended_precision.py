"""Displacements of the dual rows beyond the digits that factors leave."""

import numpy as np
import pytest
from small_scenes import halved

from driver.feti import extended_precision
from driver.feti.extended_precision import LONG
from driver.march.step import Load

# a stiff half under a soft one, both on springs that are hardly any
LOOSE = """include "scene.idp"
units("um", "MPa");
subdomains("3x1");
rectangle(0., 2000., 0., 1000.);
macro young() (y > 480.7 ? 3e3 : 3e9) //
macro poisson() 0.3 //
macro load1() pressure(3, 0.3) //
macro bodyForce2() [1e-4, -2e-4] //
macro contact() 1 //
macro friction() 0.3 //
macro foundation() 3 //
macro foundationNormal() 3e-4 //
macro foundationTangential() 3e-5 //
include "export.idp"
"""
# a stiff part that hangs on a soft one, which its support pushes
HELD = LOOSE.replace("y > 480.7", "x < 480.7").replace(
    "macro foundation() 3 //", "macro displacement1() on(4, u1 = 0.1, u2 = 0.) //").replace(
    "macro foundationNormal", "// macro normal").replace(
    "macro foundationTangential", "// macro tangential")
# a stiff block without support on a soft one, whose springs move it by ten thousand times as much
FREE = """include "scene.idp"
units("m", "Pa");
subdomains("5");
mesh below = square(8, 3, [3. * x, y]);
int[int] sides = [11, 12, 13, 14];
mesh above = square(9, 3, [0.4 + 2. * x, 1. + 0.8 * y], label = sides);
above = change(above, fregion = 1);
addBody(below)
addBody(above)
macro young() (region == 1 ? 2e17 : 2e11) //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() pressure(13, 2e7) //
macro bodyForce2() [1e5, -2e6] //
macro contactPair() 11, 3 //
macro friction() 0.3 //
include "export.idp"
"""


def exact(problem, multipliers: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """B u of the torn body by elimination in extended precision, sums included.

    Without what springs of bodies without support move.
    """
    structure, subs = problem.structure, problem.subdomains
    number, count = [], structure.coarse_dofs  # of every local dof; corners come first
    for s, sub in enumerate(subs):
        of = np.arange(count, count + sub.dofs)
        of[structure.corner_dofs[s]] = structure.corner_global[s]
        number.append(of)
        count += sub.dofs
    K, f, u = np.zeros((count, count), LONG), np.zeros(count, LONG), np.zeros(count, LONG)
    free = np.zeros(count, bool)
    for s, (sub, of) in enumerate(zip(subs, number)):
        inner = np.delete(np.arange(sub.dofs), structure.fixed[s])
        free[of[inner]] = True
        u[of[structure.fixed[s]]] = weights @ structure.fixed_values[s]
        np.add.at(K, np.ix_(of, of), sub.stiffness.toarray().astype(LONG))
        f[of] += weights @ sub.loads.astype(LONG)
        rows = structure.rows[s]
        force = rows.sign * multipliers[rows.row]
        np.add.at(f, of[rows.dof], -(rows.coefficient * force[:, None]).astype(LONG))
    f -= K @ u
    springs, corners = structure.rigid_corners.astype(LONG), structure.coarse_dofs
    K[:corners, :corners] += springs / problem.operator.rho @ springs.T
    u[free] = eliminated(K[np.ix_(free, free)], f[free])
    moved = np.zeros(structure.dual_dofs, LONG)
    for s, of in enumerate(number):
        rows = structure.rows[s]
        part = ((rows.coefficient + rows.fixed_part) * u[of][rows.dof]).sum(axis=1)
        np.add.at(moved, rows.row, rows.sign * part)
    for motion, of in zip(problem.operator.motions, springs.T @ u[:corners]):
        moved -= motion * of
    return moved


def eliminated(K: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Solution of K u = f, K positive definite, with LONG's digits; refined twice."""
    n, L = len(f), K.copy()
    for k in range(n):
        L[k + 1 :, k] /= L[k, k]
        L[k + 1 :, k + 1 :] -= np.outer(L[k + 1 :, k], L[k, k + 1 :])

    def solve(b: np.ndarray) -> np.ndarray:
        y = b.copy()
        for k in range(n):
            y[k + 1 :] -= L[k + 1 :, k] * y[k]
        for k in reversed(range(n)):
            y[k] = (y[k] - L[k, k + 1 :] @ y[k + 1 :]) / L[k, k]
        return y

    u = solve(f)
    return u + solve(f - K @ u)


@pytest.mark.parametrize("name", ["loose", "held", "free"])
def test_gradients_of_stiff_parts_have_digits_that_products_lose(built, named_scene, name):
    """Forces as in a step: they balance the load, so that the body moves by less than they do.

    Three digits more, but for the last bits of the way that the load alone would move it: products
    round off some hundred of these, by the kernels of BLAS more or less.
    """
    scene = {"loose": LOOSE, "held": HELD, "free": FREE}[name]
    problem = built(scene=named_scene(name, scene), **{} if name == "free" else {"cells": 2})
    operator, contact = problem.operator, problem.structure.contact
    weights = np.ones(problem.structure.patterns)
    d = operator.elastic_response(weights)
    # of bodies without support forces that balance the loads
    D = np.array(operator.motions).reshape(operator.modes, len(d)).T
    both = np.block([[problem.F, D], [D.T, np.zeros((operator.modes,) * 2)]])
    work = weights @ operator.rigid_work[0]
    x = np.linalg.solve(both, np.append(d, work))[: len(d)]
    x *= 1 + 1e-7 * np.random.default_rng(1).standard_normal(len(x))
    rest = 1e-8 * np.abs(exact(problem, x, weights)).max().astype(float) * np.cos(x)
    truth = -exact(problem, x, weights) - rest
    load = Load(weights, d + rest, 1.0, rest=rest)
    product, refined = operator.apply(x) - load.d, operator.gradient(x, load)
    rows = contact.normal_row[contact.normal_row >= 0]
    missed, left = (np.abs(of - truth)[rows].max() for of in (product, refined))
    last = 4 * np.finfo(float).eps * np.abs(load.d).max()
    assert left <= 1e-2 * missed and left <= max(1e-3 * missed, last)
    before = operator.products
    operator.gradient(x, load)  # known
    assert operator.products == before
    operator.gradient(2 * x, load)
    assert 2 < operator.products - before <= 1 + extended_precision.PASSES


def test_a_product_in_two_parts_keeps_what_cancels():
    """Of a stiff bar far away: its ends move alike, but for 2^-60 of it."""
    k = 3e9 * np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    k[2, 2] += 0.1
    u = LONG(1 / 3) * np.ones((3, 2), LONG)
    u[1] += LONG(2.0) ** -60
    inner = sum(extended_precision._product(halved(k), u))
    whole = [[-3e9 * 2.0**-60] * 2, [6e9 * 2.0**-60] * 2,
             [-3e9 * 2.0**-60 + (k[2, 2] - 3e9) / 3] * 2]
    np.testing.assert_allclose(inner.astype(float), whole, rtol=1e-12)
