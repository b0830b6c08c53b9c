"""Curved sides where contact follows the motion: a body that comes from afar meets what one meets
that was drawn there.
"""

import numpy as np
import pytest

TIGHT = {"rtol": 1e-12, "friction_rtol": 1e-10, "primal_rtol": 1e-8}
SLOW = pytest.mark.slow
# a round nose that goes over the back of a block, or of a rigid obstacle with the same shape
NOSE = """include "scene.idp"
real shift = physical("shift", 0.), way = physical("way", 0.), F = physical("friction", 0.);
real h = meshSize(0.25);
int n = rint(1./h);
border c1(t=-pi/2-1.2,-pi/2+1.2){x=1.5*cos(t);y=1.5+1.5*sin(t);label=8;}
border c2(t=0,1){x=1.5*sin(1.2)*(1-2*t);y=1.5-1.5*cos(1.2);label=19;}
mesh nose = buildmesh(c1(4*n) + c2(2*n));
addBody(movemesh(nose, [x - 0.8 + shift, y]))
bodyMaterial("nose", 1000., 0.3);
quasistatic(1.);
macro displacement1() on(19, u1 = way, u2 = 0.) //
macro displacement2() on(19, u1 = 0., u2 = -0.05) //
macro amplitude1(t) t //
macro amplitude2(t) t //
macro largeSliding() 3. //
"""
BACK = """border b1(t=0,1){x=-3+6*t;y=-2;label=31;}
border b2(t=0,1){x=3;y=-2+1.1*t;label=4;}
border b3(t=0,1){x=3-6*t;y=-0.9+0.9*(1-(1-2*t)^2);label=17;}
border b4(t=0,1){x=-3;y=-0.9-1.1*t;label=2;}
addBody(buildmesh(b1(3*n) + b2(n) + b3(7*n) + b4(n)))
bodyMaterial("block", 700., 0.3);
macro support() on(31, u1 = 0., u2 = 0.) //
macro contactPair() 8, 17 //
macro curved() 8, 17 //
"""
RIGID = """macro contact() 8 //
macro obstacle(x, y) (y + (x)^2/10.) //
macro curved() 8 //
"""
END = """macro friction() F //
include "export.idp"
"""


@pytest.mark.parametrize("below, element", [
    (BACK, "P2"), pytest.param(BACK, "P2-mixed", marks=SLOW), pytest.param(RIGID, "P2", marks=SLOW),
    pytest.param(BACK, "P1", marks=SLOW)], ids=["back", "mixed", "rigid", "P1"])
@pytest.mark.slow
def test_from_afar_or_drawn_there(solved, named_scene, below, element):
    """Without friction the way does not matter: forces, normals and openings of all nodes.

    To 1e-7 of them: geometries are found to PRIMAL_RTOL of the deformation, pressures answer to
    distances ten times as strongly.
    """
    path, options = named_scene("nose", NOSE + below + END), {"element": element, "steps": 4}
    far, there = (solved(path, shift=shift, way=way, subdomains=5, **TIGHT, **options)
                  for shift, way in ((0.0, 1.1), (1.1, 0.0)))
    one, other = ({name: values[-1] for name, values in run.contact.items()}
                  for run in (far, there))
    touching = other["status"] != "open"
    assert touching.any()
    np.testing.assert_array_equal(one["status"], other["status"])
    np.testing.assert_allclose(one["sigma_n"], other["sigma_n"],
                               atol=1e-7 * np.abs(other["sigma_n"]).max())
    for name in ("normal_x", "normal_y", "weight"):
        np.testing.assert_allclose(one[name], other[name], atol=1e-7)
    np.testing.assert_allclose(one["gap"] - one["u_n"], other["gap"] - other["u_n"], atol=1e-7)
    assert far.summary["residuals"]["geometry"] <= TIGHT["primal_rtol"]


@SLOW  # six runs
@pytest.mark.parametrize("below", [BACK, RIGID], ids=["back", "rigid"])
def test_dragged_with_friction_by_any_cut(solved, named_scene, below):
    """T = F N node by node at full sliding; cuts agree to 1e-6 and ranks to the last bit."""
    path = named_scene("nose", NOSE + below + END)
    options = {"element": "P2", "way": 1.1, "friction": 0.3, "steps": 6, **TIGHT}
    one, many, ranks = (solved(path, subdomains=cut, np=np_, **options)
                        for cut, np_ in ((1, 1), (7, 1), (7, 2)))
    c = one.contact
    slides = c["status"][-1] == "slip"
    assert slides.any() and not (c["status"][-1] == "stick").any()
    np.testing.assert_allclose(np.abs(c["sigma_t"][-1]), -0.3 * c["sigma_n"][-1],
                               atol=1e-7 * np.abs(c["sigma_n"]).max())
    for name in ("sigma_n", "sigma_t", "u_n", "u_t"):
        np.testing.assert_allclose(_by_place(many, name), _by_place(one, name),
                                   atol=1e-6 * np.abs(c[name]).max())
    for name, values in many.contact.items():
        np.testing.assert_array_equal(values, ranks.contact[name])


def _by_place(run, name: str) -> np.ndarray:
    """A column (steps, n) with the nodes in an order that no cut knows."""
    order = np.lexsort((run.contact["y"][0].round(9), run.contact["x"][0].round(9)))
    return run.contact[name][:, order]
