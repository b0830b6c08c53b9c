"""Warnings about mesh and numbers: said where they are due, and only there."""

from types import SimpleNamespace

import constants
import numpy as np
import pytest
from mpi4py import MPI

from driver import environment
from driver.validity import soundness

QUICK = {"SUBDOMAINS": "2x1", "CELLS": 4, "STEPS": 1, "ERRORS": "no"}


def said(run, word: str) -> bool:
    assert run.status == 0, run.reason
    return any(word in line for line in run.summary["warnings"])


@pytest.mark.parametrize("nu, cells, locks",
                         [(0.3, 2, False), (0.45, 4, False), (0.49, 2, True), (0.49, 8, True),
                                              (0.499, 4, True), (0.4999, 2, True),
                          (0.4999, 8, True)])
@pytest.mark.some(2)
def test_locking(solved, nu, cells, locks):
    """By the table in the module's text: from nu = 0.49 on coarse meshes and fine, never at 0.45.
    """
    run = solved("hard/block", **{**QUICK, "CELLS": cells}, POISSON=nu)
    assert said(run, "elements lock") == locks


@pytest.mark.parametrize("element, nu, locks",
                         [("P2", 0.46, False), ("P2", 0.499, True), ("P2-mixed", 0.4999, False)])
@pytest.mark.some(1)
def test_locking_of_quadratic_elements(solved, element, nu, locks):
    run = solved("hard/block", **QUICK, POISSON=nu, ELEMENT=element)
    assert said(run, "P2 elements lock") == said(run, "ELEMENT=P2-mixed does not lock") == locks


@pytest.mark.parametrize("element, squares, locks", [
    ("P1", (2.0, 0.0, 10.0, 10.0, 4.1, 1.0), True), ("P1", (2.0, 0.0, 10.0, 10.0, 3.9, 1.0), False),
    ("P1", (2.0, 0.0, 10.0, 1.9, 0.0, 1.0), True), ("P1", (2.0, 0.0, 10.0, 2.1, 0.0, 1.0), False),
    ("P1", (0.19, 0.0, 10.0, 10.0, 9.0, 1.0), False),
    ("P1", (0.21, 0.0, 10.0, 10.0, 9.0, 1.0), True),
    ("P1", (0.0, 0.0, 0.0, 0.0, 9.0, 1.0), False),
    ("P2", (2.0, 0.22, 10.0, 10.0, 0.0, 1.0), True),
    ("P2", (2.0, 0.23, 10.0, 10.0, 9.0, 1.0), False),
    ("P2", (0.19, 0.0, 10.0, 10.0, 9.0, 1.0), False),
    ("P2-mixed", (9.0, 0.0, 1.0, 1.0, 9.0, 1.0), False)])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e8])
def test_when_elements_are_said_to_lock(monkeypatch, element, squares, locks, unit):
    """Pressure that changes from element to element by more than a tenth of the stress, with four
    times the energy of the rest or more than its stresses are; of quadratic elements by three times
    as much as these change. In any unit of squares of stresses.
    """
    monkeypatch.setattr(soundness, "_oscillation", lambda *_: unit * np.array(squares))
    law = np.array([[[100.0, 98.0, 0], [98.0, 100.0, 0], [0, 0, 1.0]]])
    operator = SimpleNamespace(comm=MPI.COMM_SELF, follow=lambda step: None,
                               deformations=lambda x, weights: [])
    problem = SimpleNamespace(
        operator=operator, structure=SimpleNamespace(subdomains=[SimpleNamespace(elasticity=law)]),
        manifest=SimpleNamespace(element=element, material="isotropic", plane="strain", nodes=9))
    step = SimpleNamespace(index=3, multipliers=None, weights=None)
    lines = soundness.locking(problem, step)
    assert bool(lines) == locks
    change = 100 * np.sqrt(squares[0] / (squares[2] + squares[3])) if locks else 0.0
    assert not locks or f"step 3: {element} elements lock" in lines[0] and (
        f"by {change:.0f} % of the stress" in lines[0])
    law[0, 0, 1] = 9.9  # far enough from incompressible
    assert not soundness.locking(problem, step)


def test_no_locking_in_plane_stress_or_uniform_strain(solved, tmp_path):
    """Plane stress lets the body get thicker; a uniform state is exact in any element."""
    block = (environment.ROOT / "edp" / "hard" / "block.edp").read_text()
    plane = tmp_path / "plane.edp"
    plane.write_text(block.replace("macro contact()", "macro planeStress() 1 //\nmacro contact()"))
    assert not said(solved(plane, **QUICK, POISSON=0.4999), "elements lock")
    patch = tmp_path / "patch.edp"
    text = (environment.ROOT / "edp" / "patch.edp").read_text()
    assert "nu = 0.3" in text
    patch.write_text(text.replace("nu = 0.3", "nu = 0.4999"))
    assert not said(solved(patch, SUBDOMAINS="2x1", CELLS=4, ERRORS="no"), "elements lock")


@pytest.mark.slow
def test_locking_does_not_depend_on_ranks(solved):
    one, two = (solved("hard/block", **QUICK, POISSON=0.499, X0=1e5, NP=ranks) for ranks in (1, 2))
    assert one.summary["warnings"] == two.summary["warnings"] and len(one.summary["warnings"]) == 2


@pytest.mark.parametrize("x0, far", [(0, False), (1000, False), (1e4, True), (-1e6, True)])
@pytest.mark.some(2)
def test_lost_digits(solved, x0, far):
    assert said(solved("hard/block", **QUICK, X0=x0), "digits") == far


RING = """include "scene.idp"
real R = physical("radius", 1e4);
body = square(6, 3, [R + 6.*x - 3., 2.*y]);
bodyMaterial("elastomer", 1000., 0.3);
macro axisymmetric() 1 //
macro load1() pressure(3, 1.) //
macro contact() 1 //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.fixture
def ring(tmp_path):
    """A ring whose radius is given, on a plane."""
    (tmp_path / "ring.edp").write_text(RING)
    return str(tmp_path / "ring.edp")


def test_a_ring_cannot_move_to_its_axis(solved, ring):
    lines = solved(ring, ERRORS="no").summary["warnings"]
    assert any("digits" in line and "take axisymmetric out" in line for line in lines)


def test_a_ring_too_large_for_sixteen_digits_is_refused(solved, ring):
    """Its hoop stiffness, E A / R^2, drowns in the rounding of the section's."""
    run = solved(ring, RADIUS=7e4, ERRORS="no")
    assert run.status == 2 and "take axisymmetric out" in run.reason
    assert solved(ring, RADIUS=5e4, ERRORS="no").status in (0, 4)


def test_a_load_that_jumps_inside_an_edge(solved, tmp_path):
    """Three points an edge see 0, 5, 13 or 18 eighteenths of it: what they miss is said.

    The edges of the top are 0.25 long and the pressure ends at 0.31, in the first quarter of the
    second; with straight lines instead nothing is missed.
    """
    block = tmp_path / "jump.edp"
    text = """include "scene.idp"
body = square(4, 4);
macro young() 1e3 //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load3() traction(3, 0., PRESSED) //
include "export.idp"
"""
    quick = {"SUBDOMAINS": "3", "ERRORS": "no"}
    for pressed, lost in ("(x < 0.31 ? -9. : 0.)", 0.31 - 0.25 * (1 + 5 / 18)), ("-9.*x", 0.0):
        block.write_text(text.replace("PRESSED", pressed))
        run = solved(str(block), **quick)
        whole = 9 * 0.31 if lost else 4.5
        assert run.history["load_y"][-1] + whole == pytest.approx(9 * lost, abs=1e-12)
        assert said(run, "load3 jumps inside an edge") == bool(lost)


@pytest.mark.parametrize("unseen, lost", [((0.0, 0.1), 0.03), ((0.0, 5e-3), 0.0)])
def test_what_loads_lose_is_some_times_what_quadrature_changes(unseen, lost):
    """Of the load that loses most, none of those that are not given on edges; little is none."""
    sub = SimpleNamespace(unseen=unseen, loads=np.array([[1.0, -2.0], [4.0, -6.0], [1.0, 1.0]]))
    patterns = [{"given_on": where, "amplitude": k} for k, where in enumerate(
        ("edges", "edges", "triangles"))]
    problem = SimpleNamespace(structure=SimpleNamespace(subdomains=[sub]),
                              manifest=SimpleNamespace(patterns=patterns),
                              operator=SimpleNamespace(comm=MPI.COMM_SELF))
    assert soundness.lost(problem) == pytest.approx(lost)
    sub.loads[1] = 0.0  # three points miss it, five see some of it: all is lost
    assert soundness.lost(problem) == pytest.approx(soundness.SOME_TIMES)


def test_constants_that_are_called_parts_are_between_none_and_all():
    assert not constants.beyond("estimates")
