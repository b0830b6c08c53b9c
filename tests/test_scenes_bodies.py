"""Several bodies and bodies without support: scenes patch-bodies, slope."""

import numpy as np
import pytest

from driver import mortar

EXACT = {"rtol": 1e-12, "friction_rtol": 1e-10}


def nodal_error(run, exact) -> float:
    """Largest error of the nodal values (n, 2) against exact(x, y), relative to the largest exact value."""
    import meshio

    mesh = meshio.read(run.directory / "fields" / "step_0001.vtu")
    u, wanted = mesh.point_data["displacement"][:, :2], exact(*mesh.points[:, :2].T)
    return np.abs(u - wanted).max() / np.abs(wanted).max()


@pytest.mark.parametrize("options", [
    {"tilt": 0}, {"tilt": 10}, {"tilt": -12, "ratio": 0.6}, {"tilt": 5, "ratio": 2.7, "subdomains": 2},
    {"tilt": 10, "subdomains": 11}, {"tilt": 10, "subdomains": "3x2"}, {"tilt": 10, "ratio": 1}])
def test_contact_patch_test(solved, options):
    """Constant stress passes between any two meshes; what remains is the QP's tolerance over its conditioning."""
    run = solved("patch-bodies", fields="yes", **options, **EXACT)
    assert run.status == 0, run.reason
    c, s = np.cos(np.radians(options["tilt"])), np.sin(np.radians(options["tilt"]))
    np.testing.assert_allclose(run.contact["sigma_n"][0], -c * c, atol=1e-7)
    np.testing.assert_allclose(np.abs(run.contact["sigma_t"][0]), abs(c * s), atol=1e-7)
    strain = 1 / 1000 * np.array([0.3 * 1.3, -(1 - 0.3**2)])
    assert nodal_error(run, lambda x, y: np.column_stack([strain[0] * x, strain[1] * y])) < 1e-9
    assert run.summary["balance"] < 1e-12 and run.summary["effects"]["bodies"] == 2


def sides(n: int, m: int, height=lambda x: 0.0 * x, gap: float = 0.0):
    """Two facing boundaries over [0, 1] with n and m edges, along y = height(x) and, `gap` above, the same."""
    made = []
    for count, lift, up in ((n, 0.0, 1.0), (m, gap, -1.0)):
        x = np.linspace(0, 1, count + 1)
        xy = np.column_stack([x, height(x) + lift])
        t = np.diff(xy, axis=0)
        normal = up * np.column_stack([-t[:, 1], t[:, 0]]) / np.linalg.norm(t, axis=1)[:, None]
        made.append(mortar.Side(xy, np.column_stack([np.arange(count), np.arange(1, count + 1)]), normal))
    return made


@pytest.mark.parametrize("n, m", [(4, 4), (4, 7), (9, 2)])
def test_mortar_jump_of_a_common_linear_motion_is_zero(n, m):
    """Both sides moved by the same linear field on a straight boundary: no jump in any row, to rounding."""
    first, second = sides(n, m, gap=0.25)
    found = mortar.couple(first, second, np.zeros(n + 1, bool))
    u = [3.0 + 2.0 * side.xy[:, 0] for side in (first, second)]
    jump = np.bincount(found.node, found.value * np.where(found.side == 0, u[0][np.minimum(found.vertex, n)],
                                                          u[1][np.minimum(found.vertex, m)]), minlength=n + 1)
    assert np.abs(jump).max() < 1e-14
    np.testing.assert_allclose(found.gap, 0.25, rtol=1e-14)
    assert found.weight.sum() == pytest.approx(1.0, rel=1e-14)


def arc(radius: float, n: int, outward: float) -> mortar.Side:
    """n chords of a quarter circle about the origin; the body lies inside if `outward` is 1."""
    angle = np.linspace(0, np.pi / 2, n + 1)
    xy = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    middle = (angle[1:] + angle[:-1]) / 2
    return mortar.Side(xy, np.column_stack([np.arange(n), np.arange(1, n + 1)]),
                       outward * np.column_stack([np.cos(middle), np.sin(middle)]))


def test_mortar_gap_of_concentric_arcs_converges():
    """Distance 0.1 everywhere but for the sag of the chords, which is of second order in their length."""
    errors = []
    for n in (8, 16):
        found = mortar.couple(arc(1.0, n, 1.0), arc(1.1, 3 * n // 2 + 1, -1.0), np.zeros(n + 1, bool))
        errors.append(np.abs(found.gap[2:-2] - 0.1).max())
    assert errors[1] < errors[0] / 3


def test_side_that_faces_nothing(solved, tmp_path):
    text = open("edp/patch-bodies.edp").read().replace("contactPair() 6, 5", "contactPair() 6, 1")
    scene = tmp_path / "astray.edp"
    scene.write_text(text)
    run = solved(scene)
    assert run.status == 2 and "face each other" in run.reason


@pytest.mark.parametrize("angle", [0, 20, 26.5])
@pytest.mark.parametrize("subdomains", ["4x2", "5"])
def test_block_rests_on_a_slope(solved, angle, subdomains):
    """Friction angle of F = 0.5: 26.565 degrees. Weight per thickness 7850 * 9.81 * 0.4 * 0.2."""
    run = solved("slope", angle=angle, subdomains=subdomains)
    assert run.status == 0, run.reason
    weight, a = 7850 * 9.81 * 0.08, np.radians(angle)
    normal, tangential = run.history["resultant_n"][0], run.history["resultant_t"][0]
    # forces on the free motions balance to the tolerance of the rigid motions, RTOL = 1e-8, and what the last
    # projection of the multipliers into the cone adds
    assert normal == pytest.approx(-weight * np.cos(a), rel=1e-6)
    assert tangential == pytest.approx(weight * np.sin(a), rel=1e-6, abs=1e-6 * weight)
    assert run.summary["residuals"]["equilibrium"] < 1e-6


@pytest.mark.parametrize("options", [{"angle": 26.6}, {"angle": 45}, {"angle": 5, "friction": 0.05}, {"angle": 180}])
def test_impossible_equilibrium_is_named(solved, options):
    run = solved("slope", **options)
    assert run.status == 3 and "no equilibrium" in run.reason and "body 1" in run.reason
