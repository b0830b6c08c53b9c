"""Successive approximations of friction bounds, where Newton's method goes round in circles."""

import numpy as np
import pytest
from contact_law import assert_obeys
from test_complementarity import random_problem

from driver.qp import approximations
from driver.qp.approximations import approached, approximation
from driver.qp.complementarity import newton
from driver.qp.coulomb import CoulombProblem

def test_approximations_lead_out_of_a_cycle_of_states():
    """From rest Newton's method goes round and round in some of these problems, and in all of them
    the bounds of an approximation or two are near enough.
    """
    cycles = 0
    for seed in range(40, 70):
        problem = random_problem(seed, 10)
        rest = np.zeros(problem.rows)
        cycles += newton(problem, rest) is None
        assert_obeys(problem, approached(problem, rest))
    assert cycles


@pytest.mark.parametrize("descends", [True, False])
def test_a_cycle_without_friction_is_not_approached_again(monkeypatch, descends):
    """There are no bounds to approximate: Newton's method is tried once, a descent ends it; where
    there is none, once for each augmentation.
    """
    tried = []
    monkeypatch.setattr(approximations, "newton", lambda *_: tried.append(1))
    if not descends:
        monkeypatch.setattr(approximations, "solution_within", lambda *_: None)
    problem = random_problem(1, 4)
    problem = problem.under(problem.load, np.zeros(4))
    assert problem.solves(approached(problem, np.zeros(8))) == descends
    assert len(tried) == (1 if descends else len(approximations.PARTS))


def test_approximations_are_made_once(monkeypatch):
    """Movements that count by less change Newton's method alone; none was ever from the start."""
    made = []
    monkeypatch.setattr(approximations, "newton", lambda *_, **how: None)
    monkeypatch.setattr(approximations, "solution_within",
                        lambda problem, start, least: made.append(start) or start)
    assert approached(random_problem(1, 4), np.zeros(8)) is None
    assert len(made) == approximations.APPROXIMATIONS - 1


def test_forces_that_slid_begin_at_the_next_bounds(monkeypatch):
    """Else each would have to come to its own, one after the other, where bounds grow."""
    starts = []
    monkeypatch.setattr(approximations, "_within", lambda problem, z, *_, **how: starts.append(z))
    problem, before = random_problem(1, 4), np.array([1.0, 2.0, 3.0, 0.5])
    z = np.append(np.ones(4), [1.0, -2.0, 1.5, 0.0])
    approximation(problem, z, np.array([2.0, 4.0, 5.0, 6.0]), before)
    np.testing.assert_array_equal(starts[0], np.append(np.ones(4), [2.0, -4.0, 1.5, 0.0]))


@pytest.mark.parametrize("nodes", [8, 20])
@pytest.mark.parametrize("together", [1.0, 10.0])
def test_a_surface_that_turns_back_is_followed_by_softer_movements(nodes, together, monkeypatch):
    """All nodes slid forward and are dragged back: each is rigid, but together they give way by
    `together` more. Counted by the rigidity of one a movement throws them to and fro; a descent of
    the energy, left out here, ends that as well, but not of bodies without support.
    """
    monkeypatch.setattr(approximations, "solution_within", lambda *_: None)
    distance = np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    near, none = np.exp(-distance), np.zeros((nodes, nodes))
    compliance = np.block([[near, none], [none, near + together]])
    pressure = np.linspace(1.0, 2.0, nodes)
    forth = np.append(pressure, 0.4 * pressure)
    back = np.append(pressure, -0.2 * pressure)  # all nodes stick: there is no slip to be undone
    problem = CoulombProblem(compliance, compliance @ back, np.full(nodes, 0.4), np.arange(nodes))
    np.testing.assert_allclose(approached(problem, forth), back, rtol=1e-9)
    monkeypatch.setattr(approximations, "PARTS", (1.0,))
    assert approached(problem, forth) is None
