"""Resultants that loads give by balance: contact forces work on translations as loads do."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.contact.states import OPEN, SLIP, STICK
from driver.estimates.budget import Part
from driver.estimates.given import Given, by_loads, translations
from driver.estimates.unresolved import known
from driver.feti.rigid_modes import RigidMode

NORMAL, SHEAR = "normal_resultant", "tangential_resultant"
ACROSS, UP, TURNED = [0.0, 0, 1, 1], [1.0, 1, 0, 0], [-2.0, 2, 1, 1]  # of two feet, 4 apart


def feet(motions, status=(STICK, STICK), signs=(1.0, 1.0), coefficient=0.0, normal=(1.0, 1.0),
         lean=(0.0, 0.0)):
    """Record of a body on two nodes that presses and rubs; rows are their normal, then tangential
    ones. `motions` by name; `normal`, `lean`: directions of the normals, upwards and across.
    """
    along = {"across": [1.0, 0.0], "up": [0.0, 1.0], "turned": [0.0, 0.0]}
    modes = [RigidMode(0, np.zeros(1), np.zeros(2), np.array(along[name]), float(name == "turned"))
             for name in motions]
    moved = {"across": ACROSS, "up": UP, "turned": TURNED}
    rows = np.array([moved[name] for name in motions]).reshape(-1, 4)
    rows[:, :2] *= normal
    contact = SimpleNamespace(
        normal=np.arange(2), normal_node=np.arange(2), tangential=np.arange(2, 4), idle=None,
        tangential_node=np.arange(2), pair=np.arange(2), offset=None,
        coefficient=np.full(2, coefficient))
    operator = SimpleNamespace(
        structure=SimpleNamespace(rigid_modes=modes, travel=SimpleNamespace(
            bodies=SimpleNamespace(size=np.array([4.0])))),
        motions=list(rows), owned=4, dot=np.dot, comm=MPI.COMM_SELF)
    state = {"status": np.array(status), "sigma_n": np.where(np.array(status) == OPEN, 0.0, -1.0),
             "sigma_t": -np.full(2, coefficient)}
    return SimpleNamespace(
        operator=operator, displacements=[1.0], state=lambda index: state,
        contact=SimpleNamespace(
            boundary=SimpleNamespace(moves=False, normal=np.column_stack([lean, normal])),
            solver=SimpleNamespace(rows=contact)),
        signed_shares=lambda name, index: np.array(signs if name == SHEAR else (1.0, 1.0)))


VALUES = {NORMAL: 2.0, SHEAR: 1.0, "slip": 0.1}


def _given(record) -> Given:
    return by_loads(record.operator, record, VALUES, 0)


FREE = ("across", "up", "turned")


@pytest.mark.parametrize("motions, given", [(FREE, {NORMAL, SHEAR}), (("up",), {NORMAL}),
                                            (("across", "turned"), {SHEAR}), (("turned",), set()),
                                            ((), set())])
def test_loads_give_resultants_along_translations_that_nothing_resists(motions, given):
    assert _given(feet(motions)).anywhere == given


def test_places_of_contact_have_no_part_in_it():
    """Two feet that push apart: turning the body on its two nodes would give that, but a finer mesh
    has them elsewhere.
    """
    found = _given(feet(FREE, signs=(-1.0, 1.0)))
    assert found.anywhere == found.here == {NORMAL}


@pytest.mark.parametrize("status, here", [((STICK, STICK), set()), ((STICK, OPEN), {NORMAL})])
def test_where_normals_vary_loads_give_what_carries_now(status, here):
    found = _given(feet(("up",), status, normal=(1.0, 0.8)))
    assert found.anywhere == set() and found.here == here


def test_two_ends_of_a_round_boundary_say_nothing_of_places_between_them():
    """They lean alike, so that a load gives their forces; coarser meshes have the same two."""
    assert not _given(feet(("up",), normal=(0.8, 0.8), lean=(0.6, -0.6))).here


@pytest.mark.parametrize("status, coefficient, here", [
    ((SLIP, SLIP), 0.3, {NORMAL, SHEAR}), ((SLIP, STICK), 0.3, {NORMAL})])
def test_friction_of_all_that_slides_is_given_with_the_pressure(status, coefficient, here):
    """On a body that supports hold across; where a node sticks they share with it."""
    found = _given(feet(("up",), status, coefficient=coefficient))
    assert found.anywhere == {NORMAL} and found.here == here


def test_translations_of_a_body_are_motions_that_do_not_turn_it():
    record = feet(FREE)
    moved = np.array(translations(record.operator))
    assert len(moved) == 2 and np.linalg.matrix_rank([ACROSS, UP, *moved]) == 2


@pytest.mark.parametrize("given, error, stays", [
    (Given(frozenset({NORMAL})), 1.0, True), (Given(here=frozenset({NORMAL})), 1e-5, True),
    (Given(here=frozenset({NORMAL})), 1.0, False), (Given(), 1e-5, False)])
def test_what_loads_give_is_claimed_whatever_the_mesh(given, error, stays):
    """By what loads err; by what carries now alone if coarser meshes agree on it."""
    unknown = dict.fromkeys((NORMAL, "slip"), Part(None))
    found = known({NORMAL: Part(error), "slip": Part(0.01)}, unknown, {NORMAL: 100.0}, given)
    assert (found[NORMAL].error is not None) == stays and found["slip"].error is None
