"""Line contact of a half-disc: Hertz without friction, Cattaneo and Mindlin with it."""

import numpy as np
import pytest
from driver.files import read_table
from halfplane import HalfPlane

E, NU, R = 2000.0, 0.3, 1.0


def plane_modulus(nu=NU):
    return E / (1 - nu**2)


def hertz(P, nu=NU):
    """Half-width and peak pressure of the half-plane under P per length."""
    a = np.sqrt(4 * P * R / (np.pi * plane_modulus(nu)))
    return a, 2 * P / (np.pi * a)


def profile(x, a, height):
    return height * np.sqrt(np.maximum(0.0, 1 - (x / a) ** 2))


def fit(x, traction):
    """Half-width and height of the ellipse through `traction` where it is above 0.3 of its peak.

    traction^2 is linear in x^2; counting nodes could not tell a better than by h.
    """
    high = traction > 0.3 * traction.max()
    slope, square = np.polyfit(x[high] ** 2, traction[high] ** 2, 1)
    return np.sqrt(-square / slope), np.sqrt(square)


def distance(weight, one, other):
    """Relative L2 distance over the contact boundary."""
    return np.sqrt((weight * (one - other) ** 2).sum() / (weight * other**2).sum())


# ------------------------------------------------------------------------------ hertz

def hertz_errors(run):
    """Errors of half-width, peak and profile."""
    assert run.status == 0
    x, weight, pressure = (run.contact[name][-1] for name in ("x", "weight", "sigma_n"))
    pressure = -pressure
    a, p0 = hertz(pressure @ weight)
    a_found, p0_found = fit(x, pressure)
    return np.array([abs(a_found / a - 1), abs(p0_found / p0 - 1),
                     distance(weight, pressure, profile(x, a, p0))])


def test_hertz_at_the_shipped_mesh(solved):
    width, peak, shape = hertz_errors(solved("hertz"))
    # asked for: 1%; a/R = 0.03 lets the closed form err by 0.1%, h/a = 0.03 the profile's ends by
    # about 1%
    assert width < 0.01 and peak < 0.01 and shape < 0.02
    measured = (0.0007, 0.0012, 0.0041)
    assert np.all(np.array([width, peak, shape]) < 3 * np.array(measured))


@pytest.mark.slow
def test_hertz_error_falls_with_the_mesh(solved):
    # the error of one run depends on where the edge of contact falls between nodes: average over
    # loads
    loads = [0.0015, 0.0017, 0.0019, 0.0021]
    found = [np.mean([hertz_errors(solved("hertz", h=h, approach=d))[2] for d in loads])
             for h in (0.006, 0.003, 0.0015)]
    rate = np.log2(found[0] / found[2]) / 2
    # sqrt-shaped ends of the pressure: the edge elements' traction errs by sqrt(h/a) over a length
    # h: order 1
    assert found[0] > found[1] > found[2]
    assert rate > 0.7, (found, rate)


@pytest.mark.slow
def test_hertz_quantities_converge_to_the_closed_form(solved):
    """Peak and length of contact, located between nodes, against Hertz's at the resultant of each
    run.
    """
    found = []
    for h in (0.016, 0.004, 0.0015):
        errors = []
        for d in (0.0015, 0.0017, 0.0019, 0.0021):
            q = solved("hertz", h=h, approach=d).summary["quantities"]
            a, p0 = hertz(q["normal_resultant"])
            errors.append((q["peak_pressure"] / p0 - 1, q["contact_length"] / (2 * a) - 1))
        found.append(np.sqrt(np.mean(np.square(errors), axis=0)))
    rate = np.log2(found[0] / found[1]) / 2
    # order 1 at least: the edge lies anywhere in an element; the peak, inside, gains more (measured
    # 1.8, length 1.5)
    assert np.all(rate > 1), (found, rate)
    # down to what the half-planes leave out, about 2 (a/R)^2
    assert np.all(found[2] < 2 * 2 * (hertz(1.76)[0] / R) ** 2), found


@pytest.mark.parametrize("subdomains", ["3", "4x2"])
@pytest.mark.some(1)
def test_hertz_does_not_depend_on_the_partition(solved, subdomains):
    options = dict(h=0.004, rtol=1e-11)
    one, other = (solved("hertz", subdomains=s, **options).contact for s in ("8", subdomains))
    order = [np.argsort(c["x"][0]) for c in (one, other)]
    # the QP's 1e-11 times the condition number of the contact rows, about 1e3
    np.testing.assert_allclose(*(c["sigma_n"][0][o] for c, o in zip((one, other), order)), rtol=0,
                               atol=1e-7 * np.abs(one["sigma_n"]).max())


# ------------------------------------------------------------------------------ mindlin

def tangential_force(run):
    """P and Q of every step."""
    c = run.contact
    return -(c["sigma_n"] * c["weight"]).sum(axis=1), (c["sigma_t"] * c["weight"]).sum(axis=1)


def march(run, F):
    """The coupled half-plane under the run's own P, Q: tractions at the run's nodes and work lost,
    per step.
    """
    P, Q = tangential_force(run)
    a, p0 = hertz(P[0])
    reference = HalfPlane(E, NU, R, F, 1.3 * a).preload(P[0], a, p0)
    shear, lost = [], []
    for x, *force in zip(run.contact["x"], P, Q):
        reference.step(*force)
        shear.append(np.interp(x, reference.x, reference.q, left=0, right=0))
        lost.append(reference.dissipated)
    return np.array(shear), np.array(lost)


def loop_energy(P, amplitude, F, nu):
    """Work lost in one cycle of the uncoupled contact between tangential forces -amplitude and
    amplitude.

    Normal approach has d delta/dP = (const - ln P)/(pi E'); Q growing from 0 moves the disc
    sideways by F (delta(P) - delta(P - Q/F)) and, after a turn, twice that with half the force
    (Masing). So the loop's area is 4 F^2 int_0^S (2s - S) (-ln(P - s))/(pi E') ds,  S =
    amplitude/F; the constant drops out.
    """
    S = amplitude / F
    node, weight = np.polynomial.legendre.leggauss(40)
    s = S * (node + 1) / 2
    return -4 * F**2 / (np.pi * plane_modulus(nu)) * (weight * S / 2) @ ((2 * s - S) * np.log(P
                                                                                              - s))


def at(run, time):
    return int(np.argmin(np.abs(run.history["time"] - time)))


def check_mindlin(run, F, shear_error, classical_error, loop_error):
    assert run.status == 0
    P, Q = tangential_force(run)
    assert np.ptp(P) < 2e-3 * P[0]  # the shear hardly changes the normal force
    shear, lost = march(run, F)
    weight, c = run.contact["weight"], run.contact
    for time in (1, 3, 5):
        i = at(run, time)
        assert distance(weight[i], c["sigma_t"][i], shear[i]) < shear_error, time
    peak, end = at(run, 1), at(run, 5)
    loop = run.history["dissipated"][end] - run.history["dissipated"][peak]
    assert loop == pytest.approx(lost[end] - lost[peak], rel=loop_error)

    # the closed form, which leaves the coupling out
    i, x = peak, c["x"][peak]
    a, p0 = hertz(P[i])
    load = abs(Q[i]) / (F * P[i])
    stick = a * np.sqrt(1 - load)
    classical = np.sign(Q[i]) * F * (profile(x, a, p0) - profile(x, stick, p0 * stick / a))
    assert distance(weight[i], c["sigma_t"][i], classical) < classical_error
    lack = F * profile(x, a, p0) - np.abs(c["sigma_t"][i])  # an ellipse over the stick zone
    assert fit(x, np.maximum(lack, 0))[0] == pytest.approx(stick, rel=classical_error)


@pytest.mark.slow  # a fine mesh
def test_mindlin_at_the_shipped_mesh(solved):
    # asked for: 2%; measured 1.1 to 1.7%, 1.6%, 0.2%
    check_mindlin(solved("mindlin"), 0.02, shear_error=0.02, classical_error=0.02, loop_error=0.02)


@pytest.mark.slow  # a run of its own
def test_every_cycle_of_mindlin_takes_the_same_work(solved):
    """The closed form, which leaves the coupling out: 1.7 beta^2 = 1.4 % at nu = 0.45."""
    run = solved("mindlin", nu=0.45, cycles=3)
    P, Q = tangential_force(run)
    table = read_table(run.directory / "cycles.csv")
    assert list(table["kind"]) == ["alternating slip"] * 3 and table["settled"][-1] == "yes"
    np.testing.assert_allclose(table["dissipated"], table["dissipated"][0], rtol=1e-3)
    expected = loop_energy(P.mean(), np.abs(Q).max(), 0.02, 0.45)
    np.testing.assert_allclose(table["dissipated"], expected, rtol=0.03)


@pytest.mark.slow  # two meshes
def test_mindlin_shear_converges(solved):
    # square-root ends of stick and contact: order 1 in L2, as for the pressure; 3.3, 1.6% were
    # measured (0.7% at h = 0.001)
    errors = []
    for h in (0.004, 0.002):
        run = solved("mindlin", h=h, steps=5)
        i, (shear, _) = at(run, 1), march(run, 0.02)
        errors.append(distance(run.contact["weight"][i], run.contact["sigma_t"][i], shear[i]))
    assert errors[1] < errors[0] / 1.7 and errors[1] < 0.02, errors


@pytest.mark.slow
def test_mindlin_has_no_error_in_time(solved):
    """At constant pressure the shear of a sliding point is constant, so that implicit steps which
    meet the turning points are exact, in what they dissipate as well; the pressure changes by the
    coupling alone, 1e-3 (check_mindlin)."""
    few, many = (solved("mindlin", h=0.004, steps=n) for n in (5, 20))
    assert few.summary["dissipated"] == pytest.approx(many.summary["dissipated"], rel=1e-3)
    size = np.abs(many.contact["sigma_t"]).max()
    for time in (1, 3, 5):
        assert np.abs(few.contact["sigma_t"][at(few, time)]
                      - many.contact["sigma_t"][at(many, time)]).max() < 2e-3 * size


@pytest.mark.slow
def test_mindlin_loop_energy(solved):
    # the coupling lowers the loop's area by 1.7 beta^2: 14% at nu = 0.3, 1.4% at nu = 0.45, where
    # 1.3% was measured
    nu, F = 0.45, 0.03
    run = solved("mindlin", nu=nu, friction=F)
    assert run.status == 0
    P, Q = tangential_force(run)
    peak, back, end = (at(run, t) for t in (1, 3, 5))
    loop = run.history["dissipated"][end] - run.history["dissipated"][peak]
    assert loop == pytest.approx(loop_energy(P[peak], abs(Q[peak] - Q[back]) / 2, F, nu), rel=0.02)


def test_half_plane_reference_without_coupling_is_mindlins():
    P, F = 2.3, 0.05
    a, p0 = hertz(P)
    reference = HalfPlane(E, NU, R, F, 1.3 * a)
    reference.cross = np.zeros_like(reference.cross)
    reference.preload(P, a, p0)
    turn = 0.77 * F * P
    for Q in np.linspace(0, turn, 9)[1:]:
        reference.step(P, Q)
    stick = a * np.sqrt(1 - 0.77)
    expected = F * (profile(reference.x, a, p0) - profile(reference.x, stick, p0 * stick / a))
    # 120 segments across the contact, square-root ends
    assert distance(1.0, reference.q, expected) < 0.01
    before = reference.dissipated
    for Q in [*np.linspace(turn, -turn, 17)[1:], *np.linspace(-turn, turn, 17)[1:]]:
        reference.step(P, Q)
    # at constant P sliding traction is constant in time, so that only the segments limit it
    assert reference.dissipated - before == pytest.approx(loop_energy(P, turn, F, NU), rel=1e-3)


@pytest.mark.slow
def test_mindlin_with_a_finer_mesh_and_strong_coupling(solved):
    # with F = 0.1 the coupling moves the pressure by 2% of a: only the coupled reference can follow
    run = solved("mindlin", friction=0.1, h=0.0006, steps=40)
    check_mindlin(run, 0.1, shear_error=0.02, classical_error=0.08, loop_error=0.01)


def test_mindlin_loop_closes(solved):
    run = solved("mindlin")
    c, first, last = run.contact, at(run, 1), at(run, 5)
    # memory of partial slip: back at the peak the shear is what it was, but for the fixed point's
    # 1e-6 over 16 steps
    # and the change of contact by the coupling
    assert distance(c["weight"][first], c["sigma_t"][last], c["sigma_t"][first]) < 0.01


@pytest.mark.slow  # three meshes
def test_the_resultant_converges_with_the_elements_at_the_contact(solved):
    """Elsewhere they follow with the root of H, and linear ones err by the square of that: order 1,
    so a fourth is left.
    """
    # 0.01 % from one of half the size
    exact = solved("hertz", h=0.002, element="P2").history["resultant_n"][-1]
    coarse, fine = (abs(solved("hertz", h=h).history["resultant_n"][-1] - exact)
                    for h in (0.002, 0.0005))
    assert fine <= coarse / 3
