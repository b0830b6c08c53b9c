"""bracket: unstructured, two materials, two contact boundaries; no closed form, so independence and
balance.
"""

import shutil

import numpy as np
import pytest

pytestmark = pytest.mark.skipif(not shutil.which("gmsh"), reason="gmsh is not installed")

TIGHT = {"RTOL": 1e-10, "FRICTION_RTOL": 1e-10}


def assert_same(run, other):
    """Stopping tolerance 1e-10 times the condition number (below 1e5, the tractions' amplification)
    on multipliers; displacements are the weaker norm by the same factor's root."""
    for name, tolerance in (("u_n", 1e-6), ("u_t", 1e-6), ("sigma_n", 3e-5), ("sigma_t", 3e-5)):
        size = np.abs(other.contact["sigma_n" if "sigma" in name else name]).max()
        assert np.abs(run.contact[name] - other.contact[name]).max() <= tolerance * size, name


@pytest.mark.slow  # as those of test_any_cut
def test_partition_independent(solved):
    runs = [solved("bracket", SUBDOMAINS=parts, H=6, STEPS=6, **TIGHT) for parts in (4, 9, 16)]
    for run in runs:
        assert run.status == 0, run.reason
    for run in runs[1:]:
        assert_same(run, runs[0])


@pytest.mark.slow
@pytest.mark.parametrize("parts", [1, 9, 16, 40])
def test_partition_independent_on_the_shipped_mesh(solved, parts):
    assert_same(solved("bracket", SUBDOMAINS=parts, **TIGHT),
                solved("bracket", SUBDOMAINS=4, **TIGHT))


def test_balance(solved):
    """Loads, weight, bolt and both contacts add up to rounding: thousands of forces, each good to
    1e-16.
    """
    run = solved("bracket", SUBDOMAINS=4, H=6, STEPS=6, **TIGHT)
    assert run.summary["balance"] < 1e-9
    # the force on the arm is the scene's (-12, -20) times 20 mm, the shock 1000 m/s^2 times the
    # mass
    load, weight = np.array([-240.0,
                             -400.0]), run.history["load_y"] + 400 * run.history["amplitude_1"]
    assert np.allclose(run.history["load_x"], load[0] * run.history["amplitude_1"], rtol=1e-12)
    # steel foot 90 x 8; aluminium arm 90 x 20 and 20 x 52 with a fillet of radius 15, less a hole
    # of radius 6:
    # the polygons of chords miss O(h^2) of the two circles, about 1% of their areas
    area = 90 * 20 + 20 * 52 + 15**2 * (1 - np.pi / 4) - np.pi * 6**2
    mass = 7.85e-6 * 90 * 8 + 2.7e-6 * area
    assert np.allclose(weight, -1000 * mass * run.history["amplitude_2"], rtol=3e-3)


def test_boundaries_have_their_own_data(solved):
    contact = solved("bracket", SUBDOMAINS=4, H=6, STEPS=6, **TIGHT).contact
    foot, back = contact["boundary"][-1] == 1, contact["boundary"][-1] == 2
    assert foot.any() and back.any()
    assert np.allclose(contact["gap"][-1][foot], 0) and np.allclose(contact["gap"][-1][back], 0.01)
    pressed = contact["sigma_n"] < 0
    for nodes, F in ((foot, 0.2), (back, 0.4)):
        ratio = (contact["bound"] / -np.where(pressed, contact["sigma_n"],
                                              -1))[:, nodes][pressed[:, nodes]]
        assert np.allclose(ratio, F, rtol=1e-10)
    assert pressed[:, foot].any() and pressed[:, back].any()


def test_all_effects_are_active(solved):
    ledger = solved("bracket", SUBDOMAINS=4, H=6, STEPS=6, **TIGHT).summary["effects_ledger"]
    for name in ("contact", "friction", "gap", "time", "body_force", "load"):
        assert ledger[name]["declared"] and ledger[name]["active"], name
