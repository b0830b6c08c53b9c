"""Runs against the independent program: the same tractions and displacements to 1e-8.

Both solve the same discrete problem, so nothing but the solver's tolerances may be between them.
The scenes are described here once more, by hand, from their words.
"""

import numpy as np
import pytest

from driver.python.result import Result
from tests.verify.independent import Body, Problem, march

CLOSE = 1e-8
TIGHT = {"rtol": "1e-13", "friction_rtol": "1e-12", "primal_rtol": "1e-9", "uniqueness": "no",
         "fields": "yes"}


def side(component: int, value: float):
    return lambda x: np.abs(x[:, component] - value) < 1e-9


def fixed(_place, _t):
    return 0.0


def amplitude(t):
    return -4 * t**2 + 5 * t


def block(history, **law) -> Problem:
    """The model example's block."""
    def pressed(x, _n, t):
        return history(t) * np.tile([0.0, -10e7], (len(x), 1))

    def pulled(x, _n, t):
        return history(t) * np.tile([3e7, 5e7], (len(x), 1))

    clamped = [(side(0, 0.0), 0, fixed), (side(0, 0.0), 1, fixed)]
    loads = [(side(1, 1.0), pressed), (side(0, 2.0), pulled)]
    return Problem(21.19e10, 0.277, side(1, 0.0), clamped, loads, **law)


def coefficient(value: float):
    return lambda x: np.full(len(x), value)


MODEL = block(amplitude, friction=coefficient(0.3))
DISC_TOP = side(1, 1.0)


def disc(moved, **more) -> Problem:
    """The half-disc on the plane y = 0; only a part of its arc is the contact boundary."""
    def arc(x):
        return (np.abs(np.hypot(x[:, 0], x[:, 1] - 1) - 1) < 1e-9) & (np.abs(x[:, 0]) < 0.08 + 1e-9)

    return Problem(2000.0, 0.3, arc, [(DISC_TOP, 0, lambda x, t: moved(t)),
                                      (DISC_TOP, 1, lambda x, t: -0.0021)],
                   normal=(0.0, -1.0), gap=lambda x: x[:, 1], **more)


def to_and_fro(t):
    return 1.2 * 0.3 * 0.0021 * (t if t < 1 else 2 - t if t < 3 else t - 4)


def inner_circle(x):
    return np.abs(np.hypot(*x.T) - 20.0) < 1e-6


def surface(x):
    return np.abs(x[:, 1]) < 1e-12


def clipped(t):
    return min(max(t, 0.0), 1.0)


def over_the_block(E, nu, friction, depth, R, way, middle, creep=None) -> Problem:
    """A round obstacle that comes down by `depth`, goes along by `way` and turns as it rolls.

    Places are complex numbers. `middle` is where it comes down; it lifts by `depth[1]`.
    """
    def centre(t):
        across = depth[1] * clipped(t - 2) - depth[0] * clipped(t)
        return middle + way * clipped(t - 1) + 1j * (R + across)

    def angle(t):
        return 0.0 if creep is None else -(1 - creep) * way * clipped(t - 1) / R

    def distance(x, n, t):
        arm = centre(t) - (x[:, 0] + 1j * x[:, 1])
        r = np.abs(arm)
        return (r - R) * r / (arm * (n[:, 0] - 1j * n[:, 1])).real

    def surface(x, since, t):
        # of the points that come by: their velocity, from the centre half way on average
        arm = x[:, 0] + 1j * x[:, 1] - (centre(t) + centre(since)) / 2
        moved = centre(t) - centre(since) + 1j * (angle(t) - angle(since)) * arm
        return np.column_stack([moved.real, moved.imag])

    held = [(side(1, -6.0), c, fixed) for c in (0, 1)]
    return Problem(E, nu, side(1, 0.0), held, friction=coefficient(friction), distance=distance,
                   surface=surface)


MODULUS = 1 / (1 - 0.09)
CASES = {
    "model": (block(lambda t: t, friction=coefficient(0.3)),
              {"cells": "3", "loading": "monotone", "steps": "3"}, 1.0),
    "model, history": (MODEL, {"cells": "3", "loading": "nonmonotone", "steps": "6"}, 1.0),
    "model, quadratic": (MODEL, {"cells": "2", "loading": "nonmonotone", "steps": "5",
                                 "element": "P2"}, 1.0),
    "model-tresca": (block(amplitude, shear_strength=lambda x: 3e7 * (1 - x[:, 0] / 4)),
                     {"cells": "3", "steps": "6"}, 1.0),
    "model-frictionless": (block(amplitude), {"cells": "3", "steps": "3"}, 1.0),
    "cohesion": (Problem(
        21.19e10, 0.277, side(1, 0.0), [(side(1, 0.4), 0, lambda x, t: 1e-4 * t)],
        [(side(1, 0.4), lambda x, n, t: -10e6 * n)], friction=coefficient(0.3),
        shear_strength=coefficient(2e6)), {"cells": "2", "steps": "5"}, 1.0),
    "bar": (Problem(
        210e3, 0.3, side(0, 10.0), [(side(0, 0.0), 0, fixed), (side(1, 0.0), 1, fixed),
                                    (side(1, 1.0), 1, fixed)],
        [(side(0, 10.0), lambda x, n, t: 200 * (t if t < 1 else 2 - t) * n)],
        gap=coefficient(0.005)), {"cells": "2", "steps": "4"}, 2.0),
    "thermal": (Problem(
        210e3, 0.3, side(0, 100.0), [(side(0, 0.0), 0, fixed), (side(1, 0.0), 1, fixed)],
        plane_stress=True, thermal=lambda t: 1.2e-3 * t, gap=coefficient(0.05)),
        {"cells": "3", "steps": "3"}, 1.0),
    "hertz": (disc(lambda t: 0.0), {"h": "0.006"}, 1.0),
    "mindlin": (disc(to_and_fro, friction=coefficient(0.3), preload=True),
                {"h": "0.006", "steps": "10", "friction": "0.3"}, 5.0),
    "pressfit": (Problem(
        210e3, 0.3, inner_circle, [(side(1, 0.0), 1, fixed), (side(0, 0.0), 0, fixed)],
        gap=coefficient(-0.05)), {"h": "3"}, 1.0),
    "verify/wavy": (Problem(
        1.0, 0.3, surface, [(side(0, 0.5), 0, fixed), (side(0, 0.0), 0, fixed)],
        [(side(1, -3.0), lambda x, n, t: -0.25 * np.pi * MODULUS * 1e-4 * n)],
        gap=lambda x: 2e-4 * np.sin(np.pi * x[:, 0])**2), {"h": "0.05"}, 1.0),
    "verify/indenter": (Problem(
        1.0, 0.3, lambda x: surface(x) & (x[:, 0] < 1.5 + 1e-9),
        [(side(0, 0.0), 0, fixed), (side(1, -8.0), 1, lambda x, t: 4e-3)],
        normal=(0.0, 1.0), gap=lambda x: 1e-3 * x[:, 0]), {"power": "1", "size": "8", "h": "0.2"},
        1.0),
    "indenter": (over_the_block(2000.0, 0.4, 0.3, (0.05, 0.1), 8.0, 4.0, 6.0),
                 {"h": "0.6", "steps": "6"}, 3.0),
    "roller": (over_the_block(10.0, 0.45, 0.5, (0.06, 0.06), 10.0, 6.0, 7.0, 0.01),
               {"h": "1.2", "steps": "6", "element": "P2"}, 3.0),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.some(2)
def test_runs_agree_with_the_independent_program(solved, name):
    problem, options, end = CASES[name]
    scene, steps = name.partition(",")[0], int(options.get("steps", 1))
    outcome = solved(scene, subdomains="1", **options, **TIGHT)
    mesh = Result(outcome.directory).fields(0)
    body = Body(mesh.nodes, mesh.elements, problem)
    found = march(body, [end * k / steps for k in range(1, steps + 1)])
    order = _order(outcome.contact, body)
    w = body.weight
    for column, ours in (("sigma_n", [-s["p"] / w for s in found]),
                         ("sigma_t", [s["q"] / w for s in found]),
                         ("u_n", [s["u_n"] for s in found]), ("u_t", [s["u_t"] for s in found])):
        kinds = ("sigma_n",) if column[0] == "s" else ("u_n", "u_t")
        size = max(np.abs(outcome.contact[kind]).max() for kind in kinds)
        theirs = outcome.contact[column][:, order]
        assert np.abs(theirs - np.array(ours)).max() <= CLOSE * size, column


def _order(contact: dict, body: Body) -> np.ndarray:
    """Where the contact nodes of the body stand in a run's columns."""
    theirs = np.column_stack([contact["x"][0], contact["y"][0]])
    assert len(theirs) == len(body.nodes)
    far = np.hypot(*(theirs[None] - body.x[body.nodes][:, None]).T)
    assert far.min(axis=0).max() < 1e-9
    return far.argmin(axis=0)
