"""Machine parts among the shipped scenes: balance of forces, Hertz, beams, work of full sliding."""

import numpy as np
import pytest

from driver.files import read_table


def carried(run) -> dict[int, dict]:
    """What each contact boundary carries in the last step, by label."""
    return {each["boundary"]: each for each in run.summary["boundaries"]}


def shoelace(corners) -> tuple[float, float]:
    """Area of a polygon and the integral of y over it."""
    (x, y), (x1, y1) = np.array(corners).T, np.roll(corners, -1, axis=0).T
    cross = x * y1 - x1 * y
    return cross.sum() / 2, (cross * (y + y1)).sum() / 6


def test_a_squeezed_o_ring_is_in_contact_as_hertz_says(solved):
    """Bottom and lid alike: half-width b = sqrt(4 P R (1 - nu^2)/(pi E)). Either edge is located to
    a tenth of an element of 0.1, 3 % of b, and the ring is no half-plane: (b/R)^2 = 3 %."""
    run = solved("o-ring", pressure=0, steps=2, h=0.1)
    for label in (1, 5):
        force, length = (carried(run)[label][name] for name in ("force_y", "contact_length"))
        half = np.sqrt(4 * abs(force) * 1.75 * (1 - 0.45**2) / (np.pi * 8))
        assert length == pytest.approx(2 * half, rel=0.06)
    # the friction of both stays symmetric: nothing pushes the ring aside but the mesh
    assert carried(run)[1]["force_y"] == pytest.approx(carried(run)[5]["force_y"], rel=1e-5)
    assert 2 not in carried(run) or carried(run)[2]["normal_resultant"] < 1e-2


def test_the_wall_and_friction_carry_the_pressure_on_an_o_ring(solved):
    """Chord of a quarter of the mesh's circle times the pressure; forces balance to FRICTION_RTOL
    of the largest, which is that on the lid."""
    run = solved("o-ring", steps=4, h=0.2)
    forces = carried(run)
    pushed = 0.2 * 2 * 1.75 * np.sin(np.pi / 4)
    # of the pair the lid has the nodes: the ring's force is the opposite
    assert forces[1]["force_x"] + forces[2]["force_x"] - forces[5]["force_x"] == pytest.approx(
        -pushed, rel=1e-5)
    assert forces[1]["force_y"] + forces[2]["force_y"] == pytest.approx(forces[5]["force_y"],
                                                                        rel=1e-5)
    assert run.summary["converged"] and not run.summary["warnings"]


def test_a_brake_pad_that_slides_drags_with_friction_times_pressure(solved):
    """The abutments feel F p L, to the right and back, and every length of sliding takes that work.
    """
    run = solved("brake-pad", h=3, steps=12)
    drag = 0.4 * 2 * 60
    felt = read_table(run.directory / "boundaries.csv")["tangential_resultant"]
    probe = read_table(run.directory / "probes.csv")
    for step, way in ((8, 1), (12, -1)):
        assert felt[step - 1] == pytest.approx(way * drag, rel=2e-6)
        assert probe["force_x"][step - 1] == pytest.approx(-way * drag, rel=2e-6)
    # from t = 1.75 to 2 all of the pad slides by a quarter of 0.2
    work = read_table(run.directory / "boundaries.csv")["dissipated_energy"][6:8]
    assert work[1] - work[0] == pytest.approx(drag * 0.05, rel=1e-5)
    # and it presses most where the disc comes in
    pressure, x = -run.contact["sigma_n"][7], run.contact["x"][7]
    left, right = pressure[(x > 3) & (x < 30)], pressure[(x > 30) & (x < 57)]
    assert left.min() > right.max()


def test_a_snap_fit_bends_as_a_beam(solved):
    """P and W at the nose, W beside the axis by e, bend the beam by v and turn it by w there; the
    nose stays on the ramp, v = tan(a) (push + e w). Shear adds 0.7 (d/l)^2 = 0.6 %, the clamped
    root as much again."""
    run = solved("snap-fit", element="P2", h=0.7, steps=2)
    nose, angle = carried(run)[5], np.radians(30)
    across, along = -nose["force_y"], -nose["force_x"]
    ratio = (0.2 + np.tan(angle)) / (1 - 0.2 * np.tan(angle))
    assert along / across == pytest.approx(ratio, rel=1e-6)
    length, e, bending = 22 + np.sin(angle), 1 + np.cos(angle), 2600 / (1 - 0.38**2) * 8 / 12
    bent = (length**3 / 3 - ratio * e * length**2 / 2) / bending  # by a unit force P
    turned = (length**2 / 2 - ratio * e * length) / bending
    force = np.tan(angle) / (bent - np.tan(angle) * e * turned)
    assert across == pytest.approx(force, rel=0.02)


def test_both_flanks_of_a_dovetail_carry_the_centrifugal_force(solved):
    """Blade of corners as in dovetail.geo; its end is pushed by the side load besides."""
    run = solved("dovetail", h=2, steps=6)
    flanks = carried(run)
    right = [(4, 16), (4, -2), (8, -8), (8, -11)]
    area, moment = shoelace([(-x, y) for x, y in right] + right[::-1])  # counterclockwise
    pulled = 7.85e-9 * 1000**2 * (300 * area + moment)
    assert flanks[1]["force_y"] + flanks[2]["force_y"] == pytest.approx(-pulled, rel=1e-6)
    assert flanks[1]["force_x"] + flanks[2]["force_x"] == pytest.approx(-4 * 8, rel=1e-4)
    assert min(flanks[k]["dissipated_energy"] for k in (1, 2)) > 0
    assert run.summary["validity"]["verdict"] == "ok"
