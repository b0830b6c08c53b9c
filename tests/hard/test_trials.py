"""Solutions of a step from random states of its nodes, which confirm or disprove refusals."""

from types import SimpleNamespace

import numpy as np
import pytest

from driver.hard import judgement, random, refusal, states, trials
from driver.hard.slip_limits import SlipLimits


def step(rng, modes: int, **more) -> states.States:
    """Three nodes with friction up to F = 4, and so many motions that no support holds."""
    n = 3
    root = rng.standard_normal((2 * n, 2 * n))
    C, F = root @ root.T + 0.1 * np.eye(2 * n), rng.uniform(0.0, 4.0, n)
    moved, work = rng.standard_normal((2 * n, modes)), rng.standard_normal(modes)
    room, start = rng.standard_normal((2, n))
    given = {"pulls": np.zeros(n, bool), "corners": np.zeros((n, n), bool), **more}
    return states.States(np.hstack([C, moved]), room, start, F, F, np.zeros(n), moved.T, work,
                         **given)


@pytest.mark.parametrize("modes", [0, 1, 3])
@pytest.mark.some(1)
def test_random_states_lead_to_a_solution_where_there_is_one(modes):
    """The same verdict as that of a search of all states, on 12 random problems."""
    rng, none = np.random.default_rng(modes), 0
    for _ in range(12):
        problem = step(rng, modes)
        expected = problem.search(500)
        assert (trials.solution(problem, 10) is not None) == expected
        none += not expected
    assert (none > 0) == (modes > 0)


def test_contact_may_pull():
    """Three bilateral nodes, whose friction goes by forces of either sign.

    One start is enough, as states in circles go on by chance; without that it is for one in four.
    """
    rng, solved = np.random.default_rng(5), 0
    for _ in range(20):
        problem = step(rng, 1, pulls=np.ones(3, bool))
        found = trials.solution(problem, 1)
        assert found is None or problem.search(2000)
        solved += found is not None
    assert solved >= 15


@pytest.mark.parametrize("push, solved", [(1.1, True), (1.3, False)])
def test_friction_is_that_of_the_slip_of_a_solution(push, solved):
    """Two feet pressed by 1, one of them half of the law's way ahead: 1.2 is all they resist by."""
    law = SlipLimits(np.linspace(0.0, 1.0, 3), np.array([0.2, 1.0, 0.2]), np.ones(2), np.ones(2),
                     np.array([0.0, 0.5]), True)
    turned = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    none = np.zeros(2)
    problem = states.States(
        np.hstack([1e-3 * np.eye(4), turned]), none, none, none + 0.2, none + 1.0, none, turned.T,
        np.array([2.0, 0.0, push]), np.zeros(2, bool), np.zeros((2, 2), bool), law=law,
        slips=np.array([[-np.inf], [np.inf]]) * np.ones(2))
    assert (trials.solution(problem, 30) is not None) == solved


def test_a_vertex_rests_in_its_corner():
    """Pushed against floor and wall by 1: both are closed, and friction is any that they allow."""
    C = np.array([[1.0, 0.0, 0.0, -1.0], [0.0, 1.0, 1.0, 0.0],
                  [0.0, 1.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 1.0]])
    none, beside = np.zeros(2), np.array([[False, True], [True, False]])
    problem = states.States(C, none - 1.0, none, none + 0.3, none + 0.3, none, np.zeros((0, 4)),
                            np.zeros(0), np.zeros(2, bool), beside)
    x = trials.solution(problem, 20)
    assert x is not None and C[:2] @ x == pytest.approx([-1.0, -1.0])


@pytest.mark.parametrize("found, ends, shown, why", [
    (True, None, False, "random states lead"), (False, None, True, "dense complementarity"),
    (True, False, True, "search of states"), (False, True, False, "has a solution")])
def test_a_refusal_is_confirmed_where_random_states_lead_nowhere(monkeypatch, found, ends, shown,
                                                                 why):
    """Where a search of all states comes to an end that says it."""
    problem = SimpleNamespace(search=lambda programs: ends)
    monkeypatch.setattr(refusal, "_in_units", lambda *_: problem)
    monkeypatch.setattr(refusal, "unbalanced_by_friction", lambda states: (0.0, states))
    monkeypatch.setattr(refusal, "none_within", lambda *_: False)
    monkeypatch.setattr(refusal, "solution", lambda *_: np.zeros(1) if found else None)
    confirmed, said = refusal.no_state(None, None, None, np.zeros(1))
    assert confirmed == shown and why in said


@pytest.mark.parametrize("unique, violation, status, said", [
    ("not unique", 0.0, "refused", "of different solutions"),
    ("not unique", 1e-3, "FAILED", "another cut solves it, with penetration 1.0e-03"),
    ("", 0.0, "FAILED", "cuts refuse different steps: exit 3 step 3: no equilibrium; exit 0")])
def test_a_cut_may_solve_what_others_refuse_after_another_solution(monkeypatch, unique, violation,
                                                                   status, said):
    """Where steps before have several; it must obey the laws all the same."""
    contact = {"sigma_n": np.zeros((4, 2))}
    runs = [random.Outcome(3, "step 3: no equilibrium", 0.0, None, contact=contact),
            random.Outcome(0, "", 0.0, None, summary={"residuals": {}}, contact=contact)]
    monkeypatch.setattr(judgement.laws, "distance", lambda *_: 1.0)
    monkeypatch.setattr(judgement.Problem, "not_unique", lambda *_: unique)
    monkeypatch.setattr(judgement.Problem, "_none_in", lambda *_: (True, "none"))
    monkeypatch.setattr(judgement.Problem, "worst", lambda *_: ("penetration", violation))
    result, why = judgement.Problem(None, None).refusal(runs)
    assert result == status and said in why
