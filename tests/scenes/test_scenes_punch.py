"""punch: singular pressure of a flat frictionless punch; friction against a dense fixed point."""

import numpy as np
import pytest
from driver.scene import freefem
from driver.hard.dense import coulomb_history, warm_box_qp
from driver.hard.oracle import Assembled

TIGHT = {"RTOL": 1e-10, "FRICTION_RTOL": 1e-10}


# the punch without friction, in one step
FRICTIONLESS = {"WITHOUT": "friction,quasistatic"}


@pytest.fixture(scope="module")
def constant(tmp_path_factory):
    """Path of the punch with a friction coefficient that depends on the place only."""
    text = freefem.find_scene("punch").read_text()
    law = [line for line in text.splitlines() if line.startswith("macro slipFactor")]
    assert len(law) == 1
    path = tmp_path_factory.mktemp("constant") / "punch.edp"
    path.write_text(text.replace(law[0], ""))
    return path


def pressures(run):
    """x, pressure and P of the last step; P counts both halves."""
    last = {name: column[-1] for name, column in run.contact.items()}
    assert np.all(last["status"] != "open")
    pressure = -last["sigma_n"]
    return last["x"], pressure, 2 * pressure @ last["weight"]


def flat_punch(x, P, a=1.0):
    """Johnson, Contact Mechanics (1985), equation 2.64: frictionless flat punch on a half-plane."""
    return P / (np.pi * np.sqrt(a**2 - x**2))


def worst(run, reach):
    x, pressure, P = pressures(run)
    inside = x < reach
    return np.abs(pressure[inside] / flat_punch(x[inside], P) - 1).max()


def test_frictionless_pressure(solved):
    """Within 2% away from the singular edge: |x| < 0.75 a is a dozen cells from it.

    Nodal pressures of linear elements are first order in h: 1.2% at h = a/40. The block is 20 a
    wide and deep: its sides disturb the pressure by O((a/size)^2) = 0.25%.
    """
    assert worst(solved("punch", **FRICTIONLESS), 0.75) < 0.02


@pytest.mark.slow
def test_frictionless_pressure_converges(solved):
    """Nodal pressures are first order in h: two halvings must gain 3 of the 4; the floor is the
    finite block's 0.25%.
    """
    errors = [
        worst(solved("punch", **FRICTIONLESS, H=h), 0.75) for h in (1 / 12, 1 / 24, 1 / 48, 1 / 96)
    ]
    assert errors[3] < errors[1] / 3 and errors[2] < errors[0] / 3 and errors[3] < 0.006, errors


@pytest.mark.slow
def test_half_space(solved):
    """The shape of the pressure does not depend on the size of the block, down to 10 a."""
    for size in (10, 40):
        assert worst(solved("punch", **FRICTIONLESS, SIZE=size, H=1 / 48), 0.75) < 0.02


class OnSymmetryLine(Assembled):
    """The node on the symmetry line cannot move along the punch: a decoupled unknown that stays
    zero.
    """

    def compliance(self):
        C = super().compliance()
        held = np.flatnonzero(np.diag(C) == 0)
        assert len(held) == 1 and not C[held].any()
        C[held, held] = np.diag(C).max()
        return C


@pytest.mark.parametrize("indentation", [0.01, 0.03])
@pytest.mark.some(1)
def test_friction_against_dense_fixed_point(solved, built, constant, indentation):
    """F falls along the punch.

    Multipliers: stopping tolerance 1e-10 times a condition number below 1e5.
    """
    problem = built(constant, reduce=False, indentation=indentation, steps=4)
    m = problem.manifest
    body = OnSymmetryLine(m, problem.subdomains)
    # friction is F times the nodal pressure: the scene's coefficient, not the exported one
    assert np.allclose(body.friction, 0.3 * (1 - 0.5 * body.xy[:, 0]), rtol=1e-12)
    expected = coulomb_history(body, m.factors)
    run = solved(constant, INDENTATION=indentation, STEPS=4, **TIGHT)
    assert run.status == 0, run.reason
    for name in ("sigma_n", "sigma_t", "u_n", "u_t"):
        # the punch does not let the surface move along n: u_n is measured by the indentation
        size = {"u_n": indentation,
                "u_t": np.abs(expected["u_t"]).max()}.get(name, np.abs(expected["sigma_n"]).max())
        order = np.argsort(run.contact["x"][0])
        assert np.abs(run.contact[name][:, order]
                      - expected[name][:, np.argsort(body.xy[:, 0])]).max() <= 1e-5 * size, name
    status = run.contact["status"][-1]
    assert {"stick", "slip"} <= set(status)  # a stick zone in the middle, slip towards the edge
    x = run.contact["x"][-1]
    assert x[status == "stick"].max() < x[status == "slip"].min()


def test_stick_zone_does_not_grow_with_the_load(solved, constant):
    """The problem is homogeneous in the indentation: all zones stay where they are (Spence's
    similarity).
    """
    run = solved(constant, INDENTATION=0.01, STEPS=4, **TIGHT)
    for status in run.contact["status"][:-1]:
        assert np.array_equal(status, run.contact["status"][-1])


# ---- F that depends on the way slid, or on the tangential displacement ---------------------------

RANGE = 5e-4  # the scene's; the edge slips further than that
LAWS = {"slipFactor": lambda now, before, way: way + np.abs(now - before),
        "displacementFactor": lambda now, before, way: np.abs(now)}


def weakening(s):
    """The scene's law: from 1 to 0.5 at RANGE, constant beyond.

    Linear, so that the driver's table of it is exact.
    """
    return 1 - 0.5 * np.minimum(s / RANGE, 1)


def dense_history(body, amplitudes, argument):
    """Successive approximations of the bound F(s) lambda_n to rounding; asserts Coulomb's law of
    the answer.
    """
    C, n = body.compliance(), len(body.gid)
    x, u_t, way, found = np.zeros(2 * n), np.zeros(n), np.zeros(n), []
    for weights in amplitudes[1:]:
        free = body.B @ body.solve(weights)
        d = free - np.concatenate([body.gap, u_t])
        for _ in range(500):
            F = body.friction * weakening(argument((free - C @ x)[n:], u_t, way))
            g = F * x[:n]
            new = warm_box_qp(C, d, np.concatenate([np.zeros(n), -g]),
                              np.concatenate([np.full(n, np.inf), g]), x)
            change, x = np.abs(new - x).max(), new
            if change <= 1e-13 * np.abs(x).max():
                break
        else:
            raise AssertionError("the oracle's fixed point does not settle")
        moved = (free - C @ x)[n:]
        bound = body.friction * weakening(argument(moved, u_t, way)) * x[:n]
        slip, size = moved - u_t, np.abs(x).max()
        assert np.all(np.abs(x[n:]) <= bound + 1e-10 * size)
        assert np.all(np.abs(slip)[np.abs(x[n:]) < bound - 1e-9 * size] <= 1e-10 * np.abs(d).max())
        assert np.all(x[n:] * slip >= -1e-10 * size * np.abs(d).max())
        way, u_t = way + np.abs(slip), moved
        found.append((-x[:n] / body.weight, -x[n:] / body.weight, u_t))
    return dict(zip(("sigma_n", "sigma_t", "u_t"), map(np.array, zip(*found))))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.some(1)
def test_slip_dependent_friction(solved, exported, read, tmp_path_factory, law):
    """The punch goes in and half out again, so that the way slid and the displacement are not the
    same.
    """
    text = freefem.find_scene("punch").read_text()
    assert "macro slipFactor(s)" in text and "macro amplitude1(t) t //" in text
    text = text.replace("macro slipFactor(s)", f"macro {law}(s)").replace(
        "macro amplitude1(t) t //", "macro amplitude1(t) (t < 0.6 ? t/0.6 : 1. - 1.5*(t - 0.6)) //")
    path = tmp_path_factory.mktemp("law") / f"{law}.edp"
    path.write_text(text)
    problem = read(exported(path, steps=5, h=1 / 16), reduce=False)
    m = problem.manifest
    body = OnSymmetryLine(m, problem.subdomains)
    expected = dense_history(body, m.factors, LAWS[law])
    run = solved(path, STEPS=5, H=1 / 16, **TIGHT)
    assert run.status == 0, run.reason
    assert run.summary["effects"]["friction"] == "coulomb-slip-dependent"
    order, oracle_order = np.argsort(run.contact["x"][0]), np.argsort(body.xy[:, 0])
    for name in ("sigma_n", "sigma_t", "u_t"):
        size = np.abs(expected["u_t" if name == "u_t" else "sigma_n"]).max()
        assert np.abs(run.contact[name][:, order]
                      - expected[name][:, oracle_order]).max() <= 1e-5 * size, name
    # the law is felt: the outer half slips far enough to lose friction
    constant = dense_history(body, m.factors, lambda now, before, way: np.zeros(len(now)))
    assert np.abs(expected["sigma_t"]
                  - constant["sigma_t"]).max() > 0.01 * np.abs(constant["sigma_n"]).max()


def test_a_negative_factor_is_refused(solved, tmp_path):
    text = freefem.find_scene("punch").read_text()
    path = tmp_path / "negative.edp"
    path.write_text(text.replace("(1. - weakening*(s)/slipRange)", "(1. - 3.*(s)/slipRange)"))
    run = solved(path, STEPS=2)
    assert run.status == 2 and "factor of the friction coefficient is negative" in run.reason
