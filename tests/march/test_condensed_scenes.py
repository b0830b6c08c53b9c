"""Kinds of scenes whose steps are condensed, beside successive approximations: the same forces for
fewer products.
"""

import numpy as np
import pytest
from test_shortcut import forces, products

from driver.contact.acting import FIRST, SECOND
from driver.march import shortcut
from driver.march.corner_states import CornerStates
from driver.march.step import Trace


def test_given_friction_bounds_are_no_obstacle(solved, monkeypatch):
    """Tresca's law: one solution whatever the bounds, in steps of a few products."""
    words = {"cells": 6, "subdomains": 5, "steps": 4, "rtol": 1e-9}
    first = solved("model-tresca", **words)
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    later = solved("model-tresca", **words, quiet="no")  # another key
    assert first.summary["counts"]["condensed_steps"] > 0 and products(first) < products(later) / 3
    assert np.abs(forces(first) - forces(later)).max() <= 1e-5 * np.abs(forces(later)).max()


RUBBER = """// a rubber block on a steel plate, pressed down and dragged
include "scene.idp"
real soft = physical("soft", 400.);
addBody(square(15, 4, [30.*x - 15., 6.*y]));
bodyMaterial("steel", 210e3, 0.3);
int[int] sides = [14, 15, 16, 15];
addBody(square(12, 5, [20.*x - 10., 6. + 7.*y + 0.2*(2.*x - 1.)^2*(1. - y)], label = sides));
bodyMaterial("rubber", soft, 0.4);
quasistatic(1.);
macro support() on(1, u1 = 0., u2 = 0.) //
macro contactPair() 14, 3 //
macro friction() 0.3 //
macro displacement1() on(16, u2 = -0.3) //
macro amplitude1(t) min(1., 2.*t) //
macro displacement2() on(16, u1 = 0.8) //
macro amplitude2(t) max(0., 2.*t - 1.) //
include "export.idp"
"""


@pytest.mark.parametrize("soft", [15e3, 400.0, 30.0])
@pytest.mark.some(1)
def test_soft_bodies_on_stiff_ones_are_condensed(solved, named_scene, monkeypatch, soft):
    """Whose gluing rows differ in stiffness by factors of 14 to 7,000: the same forces and states
    as approximations end in, to all rows' own tolerance.
    """
    path = named_scene("rubber", RUBBER)
    words = {"soft": soft, "steps": 6, "subdomains": 7, "rtol": 1e-10, "friction_rtol": 1e-9,
             "primal_rtol": 1e-7}
    first = solved(path, **words)
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    monkeypatch.setattr(shortcut, "LEAST", np.inf)
    later = solved(path, **words, quiet="no")  # another key
    assert not later.summary["counts"]["condensed_steps"]
    assert first.summary["counts"]["condensed_steps"] >= 3
    assert products(first) < products(later) / 3
    assert np.abs(forces(first) - forces(later)).max() <= 1e-6 * np.abs(forces(later)).max()


@pytest.mark.parametrize("scene, words", [
    ("rough", {"subdomains": 5, "cells": 6}),
    ("worn-pad", {"subdomains": 3, "cells": 6, "steps": 4}),
    ("flange", {"subdomains": 4})])
@pytest.mark.some(1)
def test_surfaces_that_yield_are_condensed_with_their_tangents(solved, monkeypatch, scene, words):
    """Each tangent is a problem of its own, whose rows yield by a diagonal: the same forces as
    approximations find, in fewer products.
    """
    tight = {"rtol": 1e-10, "friction_rtol": 1e-9, "primal_rtol": 1e-8}
    first = solved(scene, **words, **tight)
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    monkeypatch.setattr(shortcut, "LEAST", np.inf)
    later = solved(scene, **words, **tight, quiet="no")  # another key
    assert not later.summary["counts"]["condensed_steps"]
    assert first.summary["counts"]["condensed_steps"] == first.summary["steps"]
    assert products(first) < products(later) / 2
    assert np.abs(forces(first) - forces(later)).max() <= 1e-6 * np.abs(forces(later)).max()


def test_what_has_no_contact_has_nothing_to_eliminate_for(solved):
    run = solved("cantilever", subdomains=5, cells=3)
    assert run.status == 0 and not run.summary["counts"]["condensed_steps"]


@pytest.mark.slow
def test_bodies_without_support_are_condensed_with_their_motions(solved, monkeypatch):
    """Plates that only friction holds lengthwise, pulled and pushed: the first step starts without
    forces. The same state as approximations end in, for six products a step.
    """
    words = {"h": 0.8, "steps": 6, "subdomains": 5, "uniqueness": "no"}
    first = solved("joint", **words)
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    later = solved("joint", **words, quiet="no")
    assert not later.summary["counts"]["condensed_steps"]
    assert first.summary["counts"]["condensed_steps"] == 6 and products(first) <= 6 * 6
    assert first.summary["counts"]["fixed_point_iterations"] == 0
    assert first.summary["residuals"]["equilibrium"] <= 1e-9
    assert np.abs(forces(first) - forces(later)).max() <= 1e-4 * np.abs(forces(later)).max()
    assert 0 < first.history["contraction"][-1] < 1  # of exact approximations


CORNER = """// a block pushed into the corner of its floor and a wall, then drawn along both
include "scene.idp"
units("mm", "MPa");
rectangle(0., 4., 0., 2.);
quasistatic(1.);
macro young() 1000. //
macro poisson() 0.3 //
macro support() on(2, u1 = 0., u2 = 0.) //
macro load1() traction(3, -3., -4.) //
macro load2() traction(3, 6., 0.) //
macro amplitude1(t) min(1., 2.*t) //
macro amplitude2(t) max(0., 2.*t - 1.) //
macro contact() 1, 4 //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.parametrize("subdomains", [1, 5])
@pytest.mark.some(1)
def test_corners_are_condensed_with_the_rows_that_act(solved, named_scene, monkeypatch, subdomains):
    """Labels that meet in a rigid corner, at which states choose among four rows: the same forces
    and states as approximations end in, for a fifth of the products.
    """
    path = named_scene("corner", CORNER)
    words = {"cells": 12, "steps": 6, "subdomains": subdomains, "rtol": 1e-10,
             "friction_rtol": 1e-9, "primal_rtol": 1e-7}
    first = solved(path, **words)
    assert first.summary["counts"]["condensed_steps"] >= 4
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    monkeypatch.setattr(shortcut, "LEAST", np.inf)
    later = solved(path, **words, quiet="no")  # another key
    assert not later.summary["counts"]["condensed_steps"]
    assert products(first) < 0.2 * products(later)
    assert np.abs(forces(first) - forces(later)).max() <= 1e-6 * np.abs(forces(later)).max()
    assert first.contact["status"].tolist() == later.contact["status"].tolist()


def test_what_corners_exclude_has_no_force(built, steps_of, named_scene, monkeypatch):
    """Whatever it had in the states before: a vertex that both sides hold is left to one."""
    problem, checked = built(named_scene("corner", CORNER), subdomains=5, cells=8, steps=2), []
    known = CornerStates._settled

    def settled(self, solve, index, load, *start):
        result = known(self, solve, index, load, *start)
        fixed_point, acting = self.fixed_point, self.corners.acting.copy()
        for state in (FIRST, SECOND):
            self.corners.acting = np.array([state])
            fixed_point.condensation.select()
            held = np.abs(result[0][self.corners.excluded]).max()
            x, *_ = fixed_point.condensed(index, load, *result, Trace(), 1e-6)
            checked.append((held, np.abs(x[self.corners.excluded]).max()))
        self.corners.acting = acting
        fixed_point.condensation.select()
        return result

    monkeypatch.setattr(CornerStates, "_settled", settled)
    steps_of(problem, uniqueness="no")
    assert max(held for held, _ in checked) > 0 and max(left for _, left in checked) == 0


@pytest.mark.slow
def test_steps_of_large_sliding_count_once(solved):
    """However many geometries each is solved about."""
    counts = solved("latch", h=0.6, steps=6).summary["counts"]
    assert 0 < counts["condensed_steps"] <= 6 < counts["geometries"]


ROLLER = """// a roller between two plates, pressed, then rolled along by the upper one
include "scene.idp"
units("mm", "MPa");
border c(t=0, 2*pi) {x = 5*sin(t); y = 5 - 5*cos(t); label = 15;}
addBody(square(12, 2, [16.*x - 8., 4.*y - 4.]));
addBody(buildmesh(c(40)));
int[int] sides = [21, 22, 23, 22];
addBody(square(12, 2, [16.*x - 8., 10. + 4.*y], label = sides));
quasistatic(1.);
macro young() (abs(y - 5.) < 5. ? 2000. : 200.) //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro contactPair() 3, 15, 21, 15 //
macro friction() 0.4 //
macro displacement1() on(23, u2 = -0.5) //
macro amplitude1(t) min(1., 2.*t) //
macro displacement2() on(23, u1 = 2.) //
macro amplitude2(t) max(0., 2.*t - 1.) //
macro largeSliding() 40. //
include "export.idp"
"""


@pytest.mark.slow
def test_nodes_that_face_nothing_are_left_out(solved, named_scene, monkeypatch):
    """The ends of plates beyond a roller, which holds by friction alone: the same forces as
    approximations find, for a quarter of the products.
    """
    path = named_scene("roller", ROLLER)
    words = {"steps": 4, "subdomains": 5, "rtol": 1e-9, "friction_rtol": 1e-8,
             "primal_rtol": 1e-6, "uniqueness": "no"}
    first = solved(path, **words)
    assert first.status == 0, first.reason
    assert first.summary["counts"]["condensed_steps"] == 4
    assert (first.contact["sigma_n"] == 0).all(axis=0).any()  # some never touch
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)
    monkeypatch.setattr(shortcut, "LEAST", np.inf)
    later = solved(path, **words, quiet="no")
    assert not later.summary["counts"]["condensed_steps"]
    assert products(first) < 0.25 * products(later)
    assert np.abs(forces(first) - forces(later)).max() <= 1e-5 * np.abs(forces(later)).max()


PUNCH = """// a punch beside a block comes over it, is pressed on it and leaves it
include "scene.idp"
units("mm", "MPa");
addBody(square(10, 4, [10.*x, 4.*y - 4.]));
int[int] own = [11, 12, 13, 14];
addBody(square(5, 3, [14. + 4.*x, 0.2 + 3*y], label = own));
quasistatic(4.);
macro young() 2000. //
macro poisson() 0.35 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro displacement1() on(13, u1 = -7., u2 = 0.) //
macro amplitude1(t) (t < 1. ? t : (t < 3. ? 1. : 4. - t)) //
macro displacement2() on(13, u1 = 0., u2 = -0.22) //
macro amplitude2(t) (t < 1. ? 0. : (t < 2. ? t - 1. : max(0., 3. - t))) //
macro contactPair() 11, 3 //
macro largeSliding() 20. //
macro friction() 0.3 //
include "export.idp"
"""


@pytest.mark.parametrize("choice, verdict", [("yes", "no second solution found"),
                                             ("auto", "not examined")])
@pytest.mark.some(1)
def test_steps_in_which_nothing_faces_anything(solved, named_scene, choice, verdict):
    """They leave nothing to examine, and no claim on those that are not examined."""
    run = solved(named_scene("beside", PUNCH), steps=12, subdomains=5, uniqueness=choice)
    assert run.status == 0, run.reason
    open_, all_of_them = run.history["nodes_open"], run.history["nodes_open"].max()
    assert (open_ == all_of_them).any() and (open_ < all_of_them).any()
    assert run.summary["uniqueness"]["verdict"] == verdict
