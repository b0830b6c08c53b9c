"""Meshes that are coarser in one direction alone."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.estimates.adjoint import SEES
from driver.estimates.budget import Part
from driver.estimates.caution import BETWEEN
from driver.estimates.one_way import one_way, with_other_way


def mesh(along: int, across: int):
    """A strip of two triangles a cell, in two subdomains."""
    half = SimpleNamespace(triangles=range(along * across), edge_label=[])
    return SimpleNamespace(operator=SimpleNamespace(comm=MPI.COMM_SELF),
                           structure=SimpleNamespace(subdomains=[half, half]),
                           manifest=SimpleNamespace(contact_labels=[]))


@pytest.mark.parametrize("fine, coarse, ratio, one", [
    ((40, 4), (20, 2), 2.0, False), ((40, 1), (20, 1), 2.0, True), ((40, 2), (20, 1), 2.0, False),
    ((40, 3), (20, 2), 2.0, False), ((30, 2), (20, 2), 1.5, True), ((3, 3), (2, 2), 1.5, False)])
def test_a_mesh_is_coarser_along_a_strip_alone(fine, coarse, ratio, one):
    """Its triangles are fewer by the ratio of the sides, not by its square, rounding apart."""
    assert one_way([mesh(*fine), mesh(*coarse)], [ratio]) == one
    assert not one_way([mesh(*fine)], [])


@pytest.mark.parametrize("along, one", [(10, True), (5, False)])
def test_the_coarsest_mesh_may_be_coarser_along_a_strip_alone(along, one):
    """A belt with two cells across, then one on both coarser meshes, whose differences are of
    unlike errors: its displacement was claimed to 4.2 % and erred by 6.9 %.
    """
    assert one_way([mesh(40, 2), mesh(20, 1), mesh(along, 1)], [2.0, 2.0]) == one


def test_what_elements_across_make_is_in_no_difference():
    """The square of the error in energy is claimed at least, but for pressures, contact length and
    what loads give.
    """
    names = ("peak_pressure", "contact_length", "normal_resultant", "displacement", "slip")
    parts = dict.fromkeys(names, Part(0.01)) | {"slip": Part(0.1, 1.5, rate=1.5)}
    parts["tangential_resultant"] = Part(None, note="?")
    found = with_other_way(parts, dict.fromkeys(parts, 2.0), 0.15 * SEES, {"normal_resultant"})
    assert found.pop("displacement").error == pytest.approx(0.15**2 * 2.0)
    assert found == {name: part for name, part in parts.items() if name != "displacement"}


@pytest.mark.parametrize("error", [0.0, 0.01, 0.04])
def test_what_finer_meshes_agree_on_errs_by_less_if_the_coarsest_alone_has_one_way(error):
    """Between both: forces that loads nearly give differ by nothing on any two meshes."""
    square = 0.15**2 * 2.0
    found = with_other_way({"displacement": Part(error)}, {"displacement": 2.0}, 0.15 * SEES,
                           set(), coarsest=True)["displacement"].error
    assert found == pytest.approx(min(square, BETWEEN * np.sqrt(error * square)) if error < square
                                  else error)


@pytest.mark.slow  # companions
def test_a_band_with_two_cells_across_on_all_meshes_claims_what_it_errs_by(solved, named_scene):
    """Springs leave no adjoint problem; coarser meshes see nothing of how it bends."""
    path = named_scene("band", """include "scene.idp"
int n = whole("n", 2, 1);
real h = meshSize(0.5);
body = square(rint(20/h), n, [20.*x, 1.5*y]);
macro young() 1000. //
macro poisson() 0.3 //
macro load1() traction(2, 1., 0.) //
macro foundation() 3 //
macro foundationTangential() 1. //
macro foundationNormal() 1. //
include "export.idp"
""")
    claim = solved(path, errors="yes").summary["errors"]["quantities"]["displacement"]
    fine = solved(path, errors="no", h=0.25, n=6, element="P2").summary["quantities"]
    error = abs(fine["displacement"] - claim["value"])
    assert error <= claim["total"] <= 5 * error
