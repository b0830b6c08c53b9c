"""zones: stick, slip and separation with a known solution.

Rates in h and in the time step against it.
"""

import numpy as np
import pytest

E, NU, F, P, A = 1000.0, 0.3, 0.3, 1.0, 0.002
LAMBDA, MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
M = LAMBDA + 2 * MU


def pos(s):
    return np.maximum(s, 0.0)


def pressure(x):
    return P * pos(1.5 - x) ** 2


def slide(x):
    return A * pos(x - 0.7) ** 4


def shear(x):
    """Of the body's surface in the direction of x."""
    return F * pressure(x) * (1 - pos(0.7 - x) ** 4)


def strain(x, y):
    """e11, e22, 2 e12; the derivatives of lift and shear by differences, exact to 1e-9."""
    step = 1e-5

    def slope(f):
        return (f(x + step) - f(x - step)) / (2 * step)

    def stretch(at):
        return 4 * A * pos(at - 0.7) ** 3

    def lift(at):
        return -(pressure(at) + LAMBDA * stretch(at)) / M

    return np.stack([stretch(x) + y * slope(shear) / MU, lift(x), shear(x) / MU + y * slope(lift)],
                    axis=-1)


def integral(f):
    """Over the contact boundary from 0 to 2; smooth between 0.7, 1.5 and 2."""
    node, weight = np.polynomial.legendre.leggauss(20)
    parts = ((0.0, 0.7), (0.7, 1.5), (1.5, 2.0))
    return sum((b - a) / 2 * weight @ f((a + b) / 2 + (b - a) / 2 * node) for a, b in parts)


DISSIPATED = 0.5 * integral(lambda x: F * pressure(x) * slide(x))


# ------------------------------------------------------------------------------ in h

CELLS = (8, 16, 32)


def energy_error(problem, steps_of):
    """Relative error in the energy norm at the end, by the edge-midpoint rule."""
    from driver.scene.kinematics import strains

    solver, steps = steps_of(problem, rtol=1e-10, friction_rtol=1e-9)
    assert solver.failure is None
    fields = problem.operator.displacements(steps[-1].multipliers, steps[-1].weights)
    total = np.zeros(2)
    for sub, u in zip(problem.subdomains, fields):
        corner = sub.xy[sub.triangles]
        side = corner[:, 1:] - corner[:, :1]
        area = 0.5 * (side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0])
        middle = 0.5 * (corner + np.roll(corner, 1, axis=1))
        exact = strain(middle[..., 0], middle[..., 1])

        def energy(e):
            return np.einsum("tqi,tij,tqj,t->", e, sub.elasticity, e, area / 3)

        total += energy(strains(sub, u)[:, None] - exact), energy(exact)
    return np.sqrt(total[0] / total[1])


@pytest.mark.slow  # test_quadratic.py has the rate of the second order by default
def test_energy_error_is_of_first_order(built, steps_of):
    """Hild, Renard (2012): h^1 in the energy norm for linear elements where u is in H^2, contact
    and friction included.
    """
    found = np.array([energy_error(built("zones", cells=n, steps=1), steps_of) for n in CELLS])
    rate = np.log2(found[:-1] / found[1:])
    assert np.all(np.abs(rate - 1) < 0.08), (found, rate)


@pytest.fixture(scope="module")
def meshes(solved):
    return [solved("zones", cells=n, steps=1, rtol=1e-10, friction_rtol=1e-9) for n in CELLS]


def l2(run, column, exact):
    c = {name: values[-1] for name, values in run.contact.items()}
    inside = c["x"] > 0.3  # the clamped corner has no multiplier, its neighbours carry its share
    weight = c["weight"][inside]
    return np.sqrt(weight @ (c[column][inside] - exact(c["x"][inside])) ** 2
                   / (weight @ exact(c["x"][inside]) ** 2))


def test_tractions_and_slip_converge(meshes):
    # the solution is in H^2 and more on a uniform mesh: nodal tractions gain the order that theory
    # leaves open, 2 in L2,
    # like the displacements; 1.8 to 2.1 were measured
    for column, exact in (("sigma_n", lambda x: -pressure(x)), ("sigma_t", lambda x: -shear(x)),
                          ("u_t", slide)):
        found = np.array([l2(run, column, exact) for run in meshes])
        assert np.all(np.log2(found[:-1] / found[1:]) > 1.6) and found[-1] < 0.003, (column, found)


def test_quantities_converge(meshes):
    # resultants and peak lack what lies on the clamped node, which carries no multiplier: h/2 p(0),
    # order 1; friction
    # dissipates nothing there: order 2, less where slip is cut off with the contact
    exact = {"peak_pressure": (pressure(0.0), 0.9), "normal_resultant": (integral(pressure), 0.9),
             "tangential_resultant": (-integral(shear), 0.9),
             "dissipated_energy": (DISSIPATED, 1.5)}
    for name, (value, order) in exact.items():
        found = np.array([abs(run.summary["quantities"][name] / value - 1) for run in meshes])
        assert np.all(np.log2(found[:-1] / found[1:]) > order), (name, found)
    # the pressure vanishes with its slope, so that a small error of it moves the edge by its root:
    # some elements
    for run, n in zip(meshes, CELLS):
        assert run.summary["quantities"]["contact_length"] == pytest.approx(1.5, abs=4 * 0.5 / n)


def test_zones_lie_where_they_should(meshes):
    c = {name: values[-1] for name, values in meshes[-1].contact.items()}
    h = 0.5 / CELLS[-1]
    # pressure, shear and gap are flat where zones meet (second to fourth order): the edge is found
    # to some elements

    def near(at):
        return np.abs(c["x"] - at) < 8 * h

    wanted = np.where(c["x"] > 1.5, "open", np.where(c["x"] > 0.7, "slip", "stick"))
    clear = ~near(1.5) & ~near(0.7)
    assert clear.sum() > 0.6 * len(clear) and np.array_equal(c["status"][clear], wanted[clear])


# ------------------------------------------------------------------------------ in the time step

STEPS = (1, 2, 4, 8, 16)


@pytest.fixture(scope="module")
def histories(solved):
    return [solved("zones", cells=8, steps=n, rtol=1e-11, friction_rtol=1e-10) for n in STEPS]


@pytest.mark.slow  # three histories
def test_dissipation_is_exact_in_one_step(histories):
    """Pressure and slip grow in proportion: the trapezoid gives their work with any steps."""
    lost = np.array([run.summary["quantities"]["dissipated_energy"] for run in histories])
    np.testing.assert_allclose(lost, lost[0], rtol=1e-6)


@pytest.mark.slow  # three histories
def test_proportional_loading_has_no_other_error_in_time(histories):
    last = histories[-1].contact
    for run in histories[:-1]:
        for column in ("sigma_n", "sigma_t", "u_n", "u_t"):
            # friction_rtol times the condition of the contact problem, about 1e3
            size = np.abs(last[column[:-1] + ("n" if column[0] == "s" else "t")][-1]).max()
            np.testing.assert_allclose(run.contact[column][-1], last[column][-1], rtol=0,
                                       atol=1e-6 * size)
