"""punch: the singular pressure of a flat frictionless punch; friction against a dense fixed point."""

import numpy as np
import pytest
from oracles import Assembled, coulomb_history

TIGHT = {"RTOL": 1e-10, "FRICTION_RTOL": 1e-10}


@pytest.fixture(scope="module")
def frictionless(tmp_path_factory):
    """Path of the punch without friction, in one step."""
    from driver import effects, freefem

    text = effects.without(freefem.find_scene("punch").read_text(), "friction")
    path = tmp_path_factory.mktemp("punch") / "punch.edp"
    path.write_text(effects.static(text))
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


def test_frictionless_pressure(solved, frictionless):
    """Within 2% away from the singular edge: |x| < 0.75 a is a dozen cells from it.

    Nodal pressures of linear elements are first order in h: 1.2% at h = a/40. The block is 20 a wide and deep:
    its sides disturb the pressure by O((a/size)^2) = 0.25%.
    """
    assert worst(solved(frictionless), 0.75) < 0.02


@pytest.mark.slow
def test_frictionless_pressure_converges(solved, frictionless):
    """Nodal pressures are first order in h: two halvings must gain 3 of the 4; the floor is the finite block's 0.25%."""
    errors = [worst(solved(frictionless, H=h), 0.75) for h in (1 / 12, 1 / 24, 1 / 48, 1 / 96)]
    assert errors[3] < errors[1] / 3 and errors[2] < errors[0] / 3 and errors[3] < 0.006, errors


@pytest.mark.slow
def test_half_space(solved, frictionless):
    """The shape of the pressure does not depend on the size of the block, down to 10 a."""
    for size in (10, 40):
        assert worst(solved(frictionless, SIZE=size, H=1 / 48), 0.75) < 0.02


class OnSymmetryLine(Assembled):
    """The node on the symmetry line cannot move along the punch: a decoupled unknown that stays zero."""

    def compliance(self):
        C = super().compliance()
        held = np.flatnonzero(np.diag(C) == 0)
        assert len(held) == 1 and not C[held].any()
        C[held, held] = np.diag(C).max()
        return C


@pytest.mark.parametrize("indentation", [0.01, 0.03])
def test_friction_against_dense_fixed_point(solved, built, indentation):
    """F falls along the punch. Multipliers: stopping tolerance 1e-10 times a condition number below 1e5."""
    problem = built("punch", reduce=False, indentation=indentation, steps=4)
    m = problem.manifest
    amplitudes = np.array([[m.amplitude(k, i) for k in range(len(m.patterns))] for i in range(m.steps + 1)])
    body = OnSymmetryLine(m, problem.subdomains)
    # friction is F times the nodal pressure: the scene's coefficient, not the exported one
    assert np.allclose(body.friction, 0.3 * (1 - 0.5 * body.xy[:, 0]), rtol=1e-12)
    expected = coulomb_history(body, amplitudes)
    run = solved("punch", INDENTATION=indentation, STEPS=4, **TIGHT)
    assert run.status == 0, run.reason
    for name in ("sigma_n", "sigma_t", "u_n", "u_t"):
        # the punch does not let the surface move along n: u_n is measured by the indentation
        size = {"u_n": indentation, "u_t": np.abs(expected["u_t"]).max()}.get(name, np.abs(expected["sigma_n"]).max())
        order = np.argsort(run.contact["x"][0])
        assert np.abs(run.contact[name][:, order] - expected[name][:, np.argsort(body.xy[:, 0])]).max() <= 1e-5 * size, name
    status = run.contact["status"][-1]
    assert {"stick", "slip"} <= set(status)  # a stick zone in the middle, slip towards the edge
    x = run.contact["x"][-1]
    assert x[status == "stick"].max() < x[status == "slip"].min()


def test_stick_zone_does_not_grow_with_the_load(solved):
    """The problem is homogeneous in the indentation: all zones stay where they are (Spence's similarity)."""
    run = solved("punch", INDENTATION=0.01, STEPS=4, **TIGHT)
    for status in run.contact["status"][:-1]:
        assert np.array_equal(status, run.contact["status"][-1])
