"""Largest displacements of nodes that contact or supports place: others may exceed them."""

import numpy as np
import pytest

# a sleeve with a flange, shrunk on a rigid shaft, warm, and pressed along the axis
HUB = """include "scene.idp"
real h = meshSize(1.5);
border under(t = 0, 1) { x = 10 + 10*t; y = 0; label = 1; }
border rim(t = 0, 1) { x = 20; y = 4*t; label = 2; }
border flange(t = 0, 1) { x = 20 - 6*t; y = 4; label = 3; }
border sleeve(t = 0, 1) { x = 14; y = 4 + 8*t; label = 2; }
border over(t = 0, 1) { x = 14 - 4*t; y = 12; label = 2; }
border bore(t = 0, 1) { x = 10; y = 12 - 12*t; label = 7; }
body = buildmesh(under(10/h) + rim(4/h) + flange(6/h) + sleeve(8/h) + over(4/h) + bore(12/h));
bodyMaterial("hub", 100e3, 0.33);
macro axisymmetric() 1 //
macro contact() 7 //
macro gap() (-0.02) //
macro friction() 0.3 //
macro load1() traction(3, 0., -10.) //
macro thermal1() 0.0001 //
subdomains("1");
include "export.idp"
"""
FINE = 0.2  # element size whose own error is a tenth of the coarse one's


def test_a_free_place_that_exceeds_the_bore_on_finer_meshes_is_in_the_claim(solved, budget_of,
                                                                             tmp_path):
    """The interference places the bore, at 0.0201 on all coarse meshes; the rim goes to 0.0215."""
    scene = tmp_path / "hub.edp"
    scene.write_text(HUB)
    claim = budget_of(scene)["quantities"]["displacement"]
    fine = solved(scene, h=FINE).history["max_displacement"][-1]
    assert fine - claim["value"] > 0.05 * claim["value"]
    assert fine - claim["value"] <= claim["total"] <= 0.5 * claim["value"]


def test_nodes_of_contact_and_of_supports_are_placed(built, steps_of):
    """Of the model, whose top moves freely: all the same number where the largest is there."""
    from driver.results.record import Record

    problem = built(loading="nonmonotone", cells=2, steps=2)
    solver, steps = steps_of(problem)
    record = Record(problem.operator, solver)
    fields, _ = record.add(steps[0])
    sizes = []
    for sub, fixed, u in zip(problem.structure.subdomains, problem.structure.fixed, fields):
        free = ~np.isin(sub.node_gid, problem.structure.contact.gid)
        free[np.asarray(fixed) // 2] = False
        sizes.append(np.linalg.norm(u.reshape(-1, 2), axis=1)[free].max(initial=0))
    assert record.unplaced == [pytest.approx(max(sizes), rel=1e-12)]
    assert record.displacements[0] >= record.unplaced[0] > 0
