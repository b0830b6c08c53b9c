"""Scenes whose exact solution the elements hold: patch, bar; and cantilever, a manufactured
solution.
"""

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

TIGHT = 1e-13  # of the QP, so that what is left is rounding


# ------------------------------------------------------------------------------ patch

@pytest.mark.parametrize("options", [
    dict(subdomains="4x2"), dict(subdomains="4x2", angle=30), dict(subdomains="7", angle=0),
    dict(subdomains="7", angle=-137.5), dict(subdomains="1x1"),
], ids=str)
@pytest.mark.some(1)
def test_patch_is_exact(solved, options):
    run = solved("patch", cells=6, rtol=TIGHT, **options)
    assert run.status == 0
    angle = np.deg2rad(options.get("angle", 0))
    E, nu, p = 1000.0, 0.3, 1.0
    c = run.contact
    along = c["x"] * np.cos(angle) + c["y"] * np.sin(angle)  # distance from the held corner
    # condition number of the stiffness about 1e4 at these sizes, times machine precision: 1e-12
    np.testing.assert_allclose(c["sigma_n"], -p, rtol=1e-9)
    np.testing.assert_allclose(c["u_t"], nu * (1 + nu) * p / E * along, rtol=1e-9)
    assert np.abs(c["u_n"]).max() < 1e-9 * p / E
    assert np.ptp(c["x"]) + np.ptp(c["y"]) > 1  # the whole bottom was looked at
    np.testing.assert_allclose(c["normal_x"], np.sin(angle), atol=1e-12)
    np.testing.assert_allclose(c["normal_y"], -np.cos(angle), atol=1e-12)


def test_patch_without_friction_has_no_tangential_rows(solved):
    run = solved("patch", cells=6, rtol=TIGHT, subdomains="4x2")
    assert run.summary["sizes"]["dual_tangential"] == 0
    assert run.summary["counts"]["fixed_point_iterations"] == run.summary["steps"] == 1


# ------------------------------------------------------------------------------ bar

L, GAP, PULL = 10.0, 0.005, 200.0
MODULUS = 210e3 * (1 - 0.3) / ((1 + 0.3) * (1 - 2 * 0.3))  # of a bar that keeps its thickness


@pytest.mark.parametrize("gap", [GAP, 0.0, -0.002])
@pytest.mark.some(1)
def test_bar_against_a_gap(solved, gap):
    run = solved("bar", gap=gap, cells=4, rtol=TIGHT)
    assert run.status == 0
    time = run.contact["time"]
    pull = PULL * np.where(time < 1, time, 2 - time)
    pressure = np.maximum(0.0, pull - MODULUS * gap / L)
    # the solution is piecewise linear: exact up to rounding (condition about 1e4)
    np.testing.assert_allclose(-run.contact["sigma_n"], pressure, atol=1e-9 * PULL)
    np.testing.assert_allclose(run.contact["u_n"], (pull - pressure) * L / MODULUS, atol=1e-9 * GAP)
    # at the very moment of touching either is right
    clear = np.abs(pull - MODULUS * gap / L) > 1e-9 * PULL
    np.testing.assert_array_equal((run.contact["status"] == "open")[clear], (pressure == 0)[clear])


# ------------------------------------------------------------------------------ cantilever

E, NU, W, K, A = 1000.0, 0.3, 0.0025, 1.3, 0.005


def exact(x, y):
    return np.stack([W * np.sin(K * x) * np.cos(K * y),
                     W * np.cos(K * x) * np.sin(K * y) + A * x**2], axis=-1)


def exact_strain(x, y):
    """e11, e22, 2 e12."""
    stretch = W * K * np.cos(K * x) * np.cos(K * y)
    return np.stack([stretch, stretch, -2 * W * K * np.sin(K * x) * np.sin(K * y) + 2 * A * x],
                    axis=-1)


MIDPOINTS = np.array([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])  # exact for quadratics


def errors(problem, fields):
    """Relative errors in L2 and energy by the edge-midpoint rule."""
    from driver.scene.kinematics import strains

    total = np.zeros(4)
    for sub, u in zip(problem.subdomains, fields):
        corner = sub.xy[sub.triangles]
        side = corner[:, 1:] - corner[:, :1]
        area = 0.5 * np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0])
        at = np.einsum("qk,tkd->tqd", MIDPOINTS, corner)
        here = np.einsum("qk,tkd->tqd", MIDPOINTS, u.reshape(-1, 2)[sub.triangles])
        u_exact, e_exact = exact(at[..., 0], at[..., 1]), exact_strain(at[..., 0], at[..., 1])

        def energy(e):
            return np.einsum("tqi,tij,tqj,t->", e, sub.elasticity, e, area / 3)

        def square(v):
            return np.einsum("tqd,t->", v**2, area / 3)

        total += (square(here - u_exact), square(u_exact),
                  energy(strains(sub, u)[:, None] - e_exact), energy(e_exact))
    return np.sqrt(total[0::2] / total[1::2])


def solve(problem, steps_of, **settings):
    solver, steps = steps_of(problem, rtol=TIGHT, **settings)
    assert solver.failure is None
    step = steps[-1]
    return problem.operator.displacements(step.multipliers, step.weights)


def test_cantilever_converges_at_the_rates_of_linear_elements(built, steps_of):
    cells = [4, 8, 16]
    found = np.array([errors(p, solve(p, steps_of))
                      for p in (built("cantilever", cells=n) for n in cells)])
    l2, energy = np.log2(found[:-1] / found[1:]).T
    # the theory's 2 and 1 are asymptotic: from cells 3 to 6 L2 falls by 1.87, from 6 to 12 by 1.96
    assert np.all(np.abs(l2 - 2) < 0.1), l2
    assert np.all(np.abs(energy - 1) < 0.05), energy


@pytest.mark.parametrize("subdomains", ["4x2", "6"])
def test_cantilever_equals_an_assembled_solve(built, steps_of, subdomains):
    problem = built("cantilever", cells=5, subdomains=subdomains)
    fields, n = solve(problem, steps_of), 2 * problem.manifest.nodes
    keys = [2 * s.node_gid[s.dof_node] + s.dof_component for s in problem.subdomains]
    stiffness = sum(coo_matrix((value, (k[row], k[column])), (n, n)).tocsr()
                    for (row, column, value), k in zip(
                        (s.stiffness.entries() for s in problem.subdomains), keys))
    load, u = np.zeros(n), np.zeros(n)
    free = np.ones(n, bool)
    for s, k in zip(problem.subdomains, keys):
        np.add.at(load, k, s.loads.sum(axis=0))
        free[k[s.fixed]] = False
        u[k[s.fixed]] = s.fixed_values.sum(axis=0)
    u[free] = spsolve(stiffness[free][:, free].tocsc(), (load - stiffness @ u)[free])
    for field, k in zip(fields, keys):
        # condition about 1e4, relative residual 1e-13
        np.testing.assert_allclose(field, u[k], rtol=0, atol=1e-9 * np.abs(u).max())


def test_cantilever_is_a_linear_solve(solved):
    run = solved("cantilever", cells=4)
    sizes, counts = run.summary["sizes"], run.summary["counts"]
    assert run.summary["effects"]["contact"] == run.summary["effects"]["friction"] == "none"
    assert sizes["dual_normal"] == sizes["dual_tangential"] == sizes["contact_nodes"] == 0
    assert counts["expansion_steps"] == counts["proportioning_steps"] == 0
    assert run.summary["steps"] == 1
    assert not (run.directory / "contact.csv").exists()
