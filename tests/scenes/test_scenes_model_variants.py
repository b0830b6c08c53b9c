"""model-tresca, model-frictionless, model-static against dense problems on the contact nodes.

The oracle knows the assembled, untorn stiffness only: condensed on the contact nodes it is a dense
compliance C, and every step is a small box-constrained QP whose solution checks its own optimality.
"""

import numpy as np
import pytest
from driver.hard.dense import box_qp, coulomb_history, warm_box_qp
from driver.hard.oracle import Assembled

# MPRGP stops at 1e-10 of the right-hand side; the dual operator's condition number is below 1e4
# (4x2 subdomains),
# so multipliers are good to 1e-6 and displacements, which C maps back, to 1e-8 of the largest
TIGHT = {"RTOL": 1e-10, "FRICTION_RTOL": 1e-10}
MULTIPLIER, DISPLACEMENT = 1e-6, 1e-7


def box_history(problem, tresca):
    """sigma_n, sigma_t, u_n, u_t (steps, n_c) with a given friction bound, or without friction."""
    body, m = Assembled(problem.manifest, problem.subdomains), problem.manifest
    C, n = body.compliance(), len(body.gid)
    g = body.friction * body.weight if tresca else np.zeros(n)
    lower, upper = np.concatenate([np.zeros(n), -g]), np.concatenate([np.full(n, np.inf), g])
    x, u_t, found = np.zeros(2 * n), np.zeros(n), []
    for weights in m.factors[1:]:
        free = body.B @ body.solve(weights)
        d = free - np.concatenate([body.gap, u_t])
        x = warm_box_qp(C, d, lower, upper, np.clip(x, lower, upper))
        moved = free - C @ x
        u_t = moved[n:]
        found.append((-x[:n] / body.weight, -x[n:] / body.weight, moved[:n], u_t))
    return dict(zip(("sigma_n", "sigma_t", "u_n", "u_t"), map(np.array, zip(*found))))


def assert_same(run, expected):
    assert run.status == 0, run.reason
    for name, tolerance in (("sigma_n", MULTIPLIER), ("sigma_t", MULTIPLIER), ("u_n", DISPLACEMENT),
                            ("u_t", DISPLACEMENT)):
        size = np.abs(expected["sigma_n" if "sigma" in name else "u_t"]).max()
        assert np.abs(run.contact[name] - expected[name]).max() <= tolerance * size, name


@pytest.mark.parametrize("loading", ["monotone", "nonmonotone"])
@pytest.mark.some(1)
def test_tresca(solved, built, loading):
    expected = box_history(built("model-tresca", reduce=False, loading=loading), tresca=True)
    run = solved("model-tresca", LOADING=loading, **TIGHT)
    assert_same(run, expected)
    assert run.summary["effects"]["friction"] == "tresca"
    x = run.contact["x"]
    # the scene's bound
    assert np.all(np.abs(run.contact["sigma_t"]) <= 3e7 * (1 - x / 4) * (1 + 1e-12))
    # a given bound: one QP a step
    assert run.summary["counts"]["fixed_point_iterations"] == run.summary["steps"]


@pytest.mark.parametrize("loading", ["monotone", "nonmonotone"])
@pytest.mark.some(1)
def test_frictionless(solved, built, loading):
    expected = box_history(built("model-frictionless", reduce=False, loading=loading), tresca=False)
    run = solved("model-frictionless", LOADING=loading, **TIGHT)
    assert_same(run, expected)
    assert not run.contact["sigma_t"].any()
    # without friction the way does not matter: both histories end in the same state
    other = solved("model-frictionless", LOADING="nonmonotone" if loading == "monotone"
                   else "monotone", **TIGHT)
    size = np.abs(expected["sigma_n"]).max()
    assert np.abs(run.contact["sigma_n"][-1]
                  - other.contact["sigma_n"][-1]).max() <= 2 * MULTIPLIER * size


def test_static(solved, built):
    problem = built("model-static", reduce=False)
    run = solved("model-static", **TIGHT)
    body = Assembled(problem.manifest, problem.subdomains)
    assert_same(run, coulomb_history(body, np.array([[0.0], [1.0]])))
    assert run.summary["steps"] == 1 and run.summary["effects"]["time"] == "static"


def test_static_is_the_last_step_of_proportional_loading(solved):
    """Loads that grow in proportion on a gapless contact repeat the static answer in another size.
    """
    static, last = solved("model-static", **TIGHT), solved("model", LOADING="monotone", **TIGHT)
    for name in ("sigma_n", "sigma_t"):
        size = np.abs(static.contact["sigma_n"]).max()
        assert np.abs(static.contact[name][-1]
                      - last.contact[name][-1]).max() <= 2 * MULTIPLIER * size


def test_oracle_refuses_a_wrong_answer(built):
    """The QP oracle's own check is alive: a perturbed compliance is not optimal for the true one.
    """
    from driver.hard.dense import assert_kkt

    body = Assembled(built("model-static", reduce=False).manifest,
                     built("model-static", reduce=False).subdomains)
    n = len(body.gid)
    C, d = body.compliance()[:n, :n], (body.B @ body.solve([1.0]))[:n]
    lower, upper = np.zeros(n), np.full(n, np.inf)
    x = box_qp(C * (1 + 1e-6 * np.eye(n)), d, lower, upper)
    with pytest.raises(AssertionError):
        assert_kkt(C, d, lower, upper, x, np.sqrt(np.diag(C)))
