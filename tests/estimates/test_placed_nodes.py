"""Largest displacements of nodes that contact or supports place: others may exceed them."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.estimates.free_peak import free_peak

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


@pytest.mark.slow
def test_a_free_place_that_exceeds_the_bore_on_finer_meshes_is_in_the_claim(solved, budget_of,
                                                                             tmp_path):
    """The interference places the bore, at 0.0201 on all coarse meshes; the rim goes to 0.0215."""
    scene = tmp_path / "hub.edp"
    scene.write_text(HUB)
    claim = budget_of(scene)["quantities"]["displacement"]
    fine = solved(scene, h=FINE).history["max_displacement"][-1]
    assert fine - claim["value"] > 0.05 * claim["value"]
    assert fine - claim["value"] <= claim["total"] <= 0.5 * claim["value"]


def body_of(parts: list[dict], placed=()):
    """An operator of subdomains with these sizes of displacement by node, along a row of edges."""
    subs, fields = [], []
    for part in parts:
        gid = np.array([*part])
        edges = np.column_stack([np.arange(len(gid) - 1), np.arange(1, len(gid))])
        subs.append(SimpleNamespace(node_gid=gid, elements=edges,
                                    dof_node=np.repeat(np.arange(len(gid)), 2)))
        fields.append(np.column_stack([0 * gid, [*part.values()]]).ravel())
    contact = SimpleNamespace(declared=SimpleNamespace(term_gid=np.array(placed, int)))
    structure = SimpleNamespace(contact=contact, subdomains=subs,
                                fixed=[np.empty(0, int) for _ in subs])
    return SimpleNamespace(structure=structure, comm=MPI.COMM_SELF,
                           displacements=lambda *_: fields)


STEP = SimpleNamespace(multipliers=None, weights=None)


def test_a_peak_is_what_no_neighbour_exceeds_on_either_side_of_an_interface():
    rising, falling = {0: 1.0, 1: 2.0, 2: 3.0}, {2: 3.0, 3: 2.5, 4: 2.7}
    assert free_peak(body_of([rising, falling]), STEP) == 3.0
    # its place is prescribed: the end of the row is the next peak, its neighbours are none
    assert free_peak(body_of([rising, falling], [2]), STEP) == 2.7
    # of an interface that is exceeded in the other subdomain
    assert free_peak(body_of([rising, {2: 3.0, 3: 4.0}], [3]), STEP) == 0.0
    held = body_of([rising])
    held.structure.fixed = [np.array([5])]
    assert free_peak(held, STEP) == 0.0
