"""Searches among the few nodes that touch, of a contact problem of many."""

import numpy as np
import pytest

from driver.qp import branching, few_nodes
from driver.qp.coulomb import CoulombProblem


def random_problem(seed: int, nodes: int, motions: int):
    """Bodies free in `motions`, of which a part has no equilibrium."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2 * nodes, 2 * nodes + 1))
    return CoulombProblem(root @ root.T, rng.standard_normal(2 * nodes),
                          rng.uniform(0.1, 4.0, nodes), np.arange(nodes), False,
                          rng.standard_normal((2 * nodes, motions)), rng.standard_normal(motions))


def searched(problem, _start):
    return branching.search_states(problem).solution, "search"


def beside_far_ones(problem, far=70):
    """The problem with as many nodes more, which nothing brings into contact; its own rows."""
    n, count = problem.n, problem.n + far
    rng = np.random.default_rng(7)
    rows = np.concatenate([np.arange(n), count + np.arange(n)])
    root = 0.01 * rng.standard_normal((2 * count, 2 * count))
    C = root @ root.T + np.eye(2 * count)
    C[np.ix_(rows, rows)] = problem.compliance
    load = np.append(np.full(count, -1e3), np.zeros(count))
    motions = np.zeros((2 * count, problem.k))
    load[rows], motions[rows] = problem.load, problem.motions
    return CoulombProblem(C, load, np.append(problem.coefficient, np.ones(far)), np.arange(count),
                          False, motions, problem.balance), rows


def with_solution(nodes=4, motions=1):
    """A problem that has a solution in which several nodes touch, and that solution."""
    for seed in range(100):
        problem = random_problem(seed, nodes, motions)
        z = branching.search_states(problem).solution
        if z is not None and (z[:nodes] > 0).sum() >= 2:
            return problem, z
    raise AssertionError("none of a hundred")


@pytest.mark.parametrize("fewest", [2, 24])
def test_few_nodes_that_touch_are_found_among_many(monkeypatch, fewest):
    """Those that the first ones leave penetrated are added."""
    monkeypatch.setattr(few_nodes, "FEWEST", fewest)
    monkeypatch.setattr(few_nodes, "MORE", 1)
    small, _ = with_solution()
    problem, rows = beside_far_ones(small)
    found, method = few_nodes.solution_among(problem, np.zeros(problem.rows + 1), 60, searched)
    assert method == "search" and problem.solves(found)
    assert not np.delete(found[: problem.rows], rows).any()
    assert branching.search_states(problem).solution is None  # too many nodes for the search


def test_nodes_that_are_penetrated_are_added(monkeypatch):
    """Six are pressed; a start with all force on one of them has lifted the others."""
    monkeypatch.setattr(few_nodes, "FEWEST", 2)
    monkeypatch.setattr(few_nodes, "MORE", 1)
    C, load, start = np.eye(140), np.append(np.full(70, -1e3), np.zeros(70)), np.zeros(140)
    C[:6, :6] += 0.5
    load[:6], start[0] = 1.0, 100.0
    problem, sizes = CoulombProblem(C, load, np.ones(70), np.arange(70), False), []

    def counted(few, start):
        sizes.append(few.n)
        return searched(few, start)

    found, _ = few_nodes.solution_among(problem, start, 60, counted)
    assert problem.solves(found) and (found[:6] > 0).all() and sizes == [2, 3, 4, 5, 6]


def test_nodes_that_have_to_be_there_are(monkeypatch):
    """Bilateral ones, and those that resist slip although they are open."""
    problem, _ = beside_far_ones(with_solution()[0])
    bilateral, offset = np.zeros(problem.n, bool), np.zeros(problem.n)
    bilateral[50], offset[60] = True, 0.5
    held = CoulombProblem(problem.compliance, problem.load, problem.coefficient, problem.pair,
                          bilateral, problem.motions, problem.balance, offset)
    seen = []
    few_nodes.solution_among(held, np.zeros(held.rows + 1), 60,
                             lambda few, start: (seen.append(few), (None, ""))[1])
    assert seen[0].bilateral.sum() == 1 and (seen[0].offset == 0.5).sum() == 1
    assert few_nodes.solution_among(held, np.zeros(held.rows + 1), 1, searched) == (None, "")


def test_where_no_few_nodes_solve_a_problem_nothing_is_found():
    """Pulled off: none of the smaller problems has a solution, which proves nothing."""
    motions = np.append(np.ones(70), np.zeros(70))[:, None]
    problem = CoulombProblem(np.eye(140), np.zeros(140), np.ones(70), np.arange(70), False, motions,
                             np.array([-1.0]))
    assert few_nodes.solution_among(problem, np.zeros(141), 60, searched) == (None, "")
