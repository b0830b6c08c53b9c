"""Contact pairs whose label turns a corner: a block in a notch, each of them with the nodes.

The patch test: where displacements that belong to one stress are prescribed on the notch's outer
sides, and its tractions on the others, that stress is the solution of both bodies, however their
meshes meet, and contact has its tractions, those of the corner included: linear functions are among
those of the elements, and the multipliers' span has what they transmit. EXACT is what RTOL leaves:
residuals of 1e-12 in displacements over the compliance of a node's force.
"""

import numpy as np
import pytest

TIGHT = {"rtol": 1e-12, "friction_rtol": 1e-11, "primal_rtol": 1e-9}
EXACT, CLOSE = 1e-8, 1e-6
STRESS = np.array([[-1.0, 0.3], [0.3, -2.0]])

SHAPE = """include "scene.idp"
real n = physical("fine", 5), m = physical("coarse", 3), g = physical("clearance", 0.);
real slant = physical("slant", 0), who = physical("who", 0), two = physical("two", 0), R = 0;
real F = physical("friction", 0.5), E = 1000., nu = 0.3;
int l2 = (two > 0 ? 12 : 11), k2 = (two > 0 ? 22 : 21);
border b0(t=0, 1) { x = R + g + t; y = g + slant*t; label = 11; }
border b1(t=0, 1) { x = R + g + 1.; y = g + slant + (1 - slant)*t; label = 3; }
border b2(t=0, 1) { x = R + g + 1 - (1 - slant)*t; y = g + 1.; label = 4; }
border b3(t=0, 1) { x = R + g + slant*(1 - t); y = g + 1 - t; label = l2; }
mesh block = buildmesh(b0(n) + b1(n) + b2(n) + b3(n));
border c0(t=0, 1) { x = R - 1 + 2*t; y = -1.; label = 1; }
border c1(t=0, 1) { x = R + 1.; y = -1 + (1 + slant)*t; label = 3; }
border c2(t=0, 1) { x = R + 1 - t; y = slant*(1 - t); label = 21; }
border c3(t=0, 1) { x = R + slant*t; y = t; label = k2; }
border c4(t=0, 1) { x = R + slant - (1 + slant)*t; y = 1.; label = 4; }
border c5(t=0, 1) { x = R - 1.; y = 1 - 2*t; label = 2; }
mesh notch = buildmesh(c0(2*m) + c1(m) + c2(m) + c3(m) + c4(m) + c5(2*m));
addBody(block)
addBody(notch)
macro young() E //
macro poisson() nu //
macro support() on(1, u1 = 0., u2 = 0.) + on(2, u1 = 0., u2 = 0.) //
macro contactPair() 11, 21 //
macro friction() F //
"""
PATCH = SHAPE + """
real s = 0.3;
func real ux(real a, real b) { return (1 + nu)/E*((2*nu - (1 - nu))*a + s*b); }
func real uy(real a, real b) { return (1 + nu)/E*((nu - 2*(1 - nu))*b + s*a); }
macro displacement1() on(1, u1 = ux(x, y), u2 = uy(x, y)) + on(2, u1 = ux(x, y), u2 = uy(x, y)) //
macro load1() traction(3, -1., s) + traction(4, s, -2.) //
include "export.idp"
"""
RING = SHAPE.replace("R = 0;", "R = 3;") + """
macro axisymmetric() 1 //
func real ux(real a) { return -(1 - 2*nu)/E*a; }
macro displacement1() on(1, u1 = ux(x), u2 = ux(y)) + on(2, u1 = ux(x), u2 = ux(y)) //
macro load1() traction(3, -1., 0.) + traction(4, 0., -1.) //
include "export.idp"
"""
PUSHED = SHAPE + """
quasistatic(3.);
macro load1() traction(4, -0.4 - 0.3*x, -2.*(1 + x)) + traction(3, -1.5*(1 - y), -0.2) //
macro amplitude1(t) min(t, 1.) //
macro load2() traction(3, 1.4, 0.) + traction(4, 0., 0.3) //
macro amplitude2(t) (t < 1. ? 0. : (t < 2. ? t - 1. : 3. - t)) //
include "export.idp"
"""
PAIRS = {"block": "11, 21", "notch": "21, 11"}


def of(text: str, first: str, labels: int = 1, friction: bool = True) -> str:
    """The scene whose contact nodes `first` carries, the pair being one of `labels` pairs."""
    pairs = PAIRS[first]
    if labels == 2:
        pairs += ", " + pairs.replace("11", "12").replace("21", "22")
    text = text.replace("contactPair() 11, 21", f"contactPair() {pairs}")
    return text if friction else text.replace("macro friction() F //\n", "")


def tractions(run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Computed tractions (n, 2) normal and tangential, and the frames: normals, tangents (n, 2)."""
    c = run.contact
    normal = np.column_stack([c["normal_x"][-1], c["normal_y"][-1]])
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    return np.column_stack([c["sigma_n"][-1], c["sigma_t"][-1]]), normal, tangent


def assert_passes(run, stress: np.ndarray) -> None:
    """Contact has the tractions of one `stress`, at the two nodes in the corner, too."""
    assert (run.status, run.reason) == (0, "")
    found, normal, tangent = tractions(run)
    force = normal @ stress
    expected = np.column_stack([(force * normal).sum(axis=1), (force * tangent).sum(axis=1)])
    np.testing.assert_allclose(found, expected, atol=EXACT * np.abs(stress).max())
    place = np.column_stack([run.contact["x"][0], run.contact["y"][0]])
    _, count = np.unique(place.round(9), axis=0, return_counts=True)
    assert sorted(count)[-2:] == [1, 2]


@pytest.mark.parametrize("first, options", [
    ("block", {"errors": "yes"}),
    ("notch", {"subdomains": 5, "fine": 4, "coarse": 4}),
    *(pytest.param(first, options, marks=pytest.mark.slow) for first in PAIRS for options in (
        {"subdomains": 7, "element": "P2"}, {"subdomains": 3, "slant": 0.3},
        {"subdomains": 11, "slant": -0.4}, {"fine": 3, "coarse": 5}, {"fine": 20, "coarse": 21},
        {"subdomains": 40, "fine": 4, "coarse": 4, "element": "P2"}))])
@pytest.mark.some(1)
def test_one_stress_passes_a_corner(solved, named_scene, first, options):
    run = solved(named_scene(first, of(PATCH, first)), **{"subdomains": 1} | TIGHT | options)
    assert_passes(run, STRESS)
    if "errors" in options:  # the solver's alone
        assert run.summary["errors"]["energy"]["relative"] < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("first", PAIRS)
def test_it_passes_without_friction_on_two_labels_and_around_an_axis(solved, named_scene, first,
                                                                     element):
    bare, ring, double = (named_scene(f"{name}-{first}", of(text, first, labels, friction))
                          for name, text, labels, friction in (
                              ("bare", PATCH.replace("s = 0.3", "s = 0"), 1, False),
                              ("ring", RING, 1, True), ("double", PATCH, 2, True)))
    options = {"element": element, "subdomains": 5, **TIGHT}
    assert_passes(solved(bare, **options), np.diag([-1.0, -2.0]))
    assert_passes(solved(ring, **options), -np.eye(2))
    assert_passes(solved(double, two=1, **options), STRESS)


@pytest.mark.slow  # sixteen runs, two of them on ranks
@pytest.mark.parametrize("first", PAIRS)
@pytest.mark.parametrize("options", [{}, {"clearance": 5e-4}, {"clearance": 1e-3, "slant": -0.3}])
def test_cuts_labels_and_ranks_change_nothing(solved, named_scene, first, options):
    """Pushed into the notch, drawn along one flank and pushed back; the gap nearly nothing or not.

    Two ranks leave the same bits.
    """
    one, two = (named_scene(f"pushed-{first}-{labels}", of(PUSHED, first, labels))
                for labels in (1, 2))
    options = {"steps": 6, "rtol": 1e-11, "friction_rtol": 1e-10, "primal_rtol": 1e-7, **options}
    runs = [solved(one, subdomains=cut, **options) for cut in (1, 5, 13)]
    runs += [solved(one, subdomains=5, np=2, **options),
             solved(two, subdomains=5, two=1, **options)]
    forces = [by_place(run) for run in runs]
    for run, force in zip(runs, forces):
        assert (run.status, run.reason) == (0, "")
        assert run.summary["validity"]["verdict"] == "ok"
        assert np.abs(force - forces[0]).max() < CLOSE * np.abs(forces[0]).max()
    np.testing.assert_array_equal(forces[3], forces[1])


def by_place(run) -> np.ndarray:
    """(2, steps, nodes) forces in an order of the nodes that neither cut nor label changes."""
    c = run.contact
    order = np.lexsort([np.round(c[name][0], 9) for name in ("normal_x", "y", "x")])
    return (np.array([c["sigma_n"], c["sigma_t"]]) * c["weight"])[:, :, order]
