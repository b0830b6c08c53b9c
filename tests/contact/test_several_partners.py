"""Boundaries that are to meet several others: place by place the nearest of their partners."""

import numpy as np
import pytest

from driver.contact.mortar import reach_of

RING = """// a ring pressed between a plate and a block, whose step lies below the plate, too
include "scene.idp"
units("mm", "MPa");
border outer(t=0, 2*pi) { x = 2*cos(t); y = 2*sin(t); label = 5; }
border inner(t=0, 2*pi) { x = 1.2*cos(t); y = 1.2*sin(t); label = 90; }
mesh ring = buildmesh(outer(40) + inner(-24));
ring = change(ring, flabel = (label == 5 ? LABELS : label));
addBody(ring) bodyMaterial("ring", 1000., 0.3);
int[int] of1 = [1, 2, 3, 4], of2 = [31, 32, 33, 34], of3 = [41, 42, 43, 44];
addBody(square(10, 2, [-1. + 2.*x, -2.5 + 0.5*y], label = of1)) bodyMaterial("plate", 2e3, 0.3);
addBody(square(12, 2, [-3. + 6.*x, -3.5 + y], label = of2)) bodyMaterial("block", 2e3, 0.3);
addBody(square(12, 2, [-3. + 6.*x, 2. + y], label = of3)) bodyMaterial("lid", 2e3, 0.3);
macro support() on(31, u1 = 0., u2 = 0.) + on(43, u1 = 0.) //
macro contactPair() PAIRS //
macro friction() 0.2 //
macro load1() pressure(43, 2.) //
macro probeLabels() [43, 41, 3, 33] //
include "export.idp"
"""
APART = RING.replace("LABELS", "(y < 0. ? 5 : 6)").replace("PAIRS", "5, 3, 6, 41, 1, 33")
WHOLE = RING.replace("LABELS", "5").replace("PAIRS", "5, 3, 1, 33, 5, 41, 5, 33")
CLOSE = 1e-6  # of the load: tolerances of 1e-10 and the condition of the contact problem


def forces(run) -> np.ndarray:
    """(nodes, 4) x, y, normal and tangential force of the ring's nodes that press."""
    c = run.contact
    found = np.column_stack([c["x"][-1], c["y"][-1], *(c[name][-1] * c["weight"][-1]
                                                      for name in ("sigma_n", "sigma_t"))])
    found = found[np.isin(c["boundary"][-1], [5, 6]) & (c["sigma_n"][-1] != 0)]
    return found[np.lexsort(found[:, :2].round(9).T)]


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_boundary_meets_the_nearest_of_its_partners(solved, named_scene, element):
    """As if its parts had labels of their own; what lies behind a partner is not met."""
    tight = {"rtol": "1e-10", "friction_rtol": "1e-9", "element": element}
    apart = solved(named_scene("apart", APART), subdomains=4, **tight)
    for cut in (4, 11):
        whole = solved(named_scene("whole", WHOLE), subdomains=cut, **tight)
        assert whole.status == 0
        np.testing.assert_allclose(forces(whole), forces(apart), rtol=0, atol=12.0 * CLOSE)


def test_a_boundary_that_does_not_face_one_of_its_partners(solved, named_scene):
    text = WHOLE.replace("5, 33 //", "5, 2 //")
    run = solved(named_scene("astray", text))
    assert run.status == 2
    assert "the boundaries 5 and 2 of a contact pair do not face each other" in run.reason


@pytest.mark.slow
def test_errors_where_a_boundary_meets_several(solved, named_scene):
    """Their parts are those of the run."""
    run = solved(named_scene("whole", WHOLE), errors="yes")
    assert run.status == 0 and run.summary["errors"]["energy"]["relative"] > 0


def test_places_face_one_partner_where_boundaries_have_one_each():
    assert reach_of([(1, 2), (3, 2), (4, 5)]) is None
    assert reach_of([(1, 2), (3, 2), (1, 5)]) == np.inf
