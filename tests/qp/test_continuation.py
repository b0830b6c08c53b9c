"""Paths of solutions under loads that become the step's: by the law at every point, and their end.
"""

import numpy as np
import pytest

from driver.qp import complementarity, continuation
from driver.qp.continuation import _Path, at_the_end_of_a_path
from driver.qp.coulomb import CoulombProblem

SEEDS = 8


def random_problem(seed: int, nodes: int, motions: int = 0, pulls: str = "none",
                   largest: float = 4.0) -> CoulombProblem:
    """Nodes of which a third has offsets and a quarter no friction; the last has no tangential row.

    Some are bilateral if `pulls` says so, or all.
    """
    rng = np.random.default_rng(seed)
    pair = np.arange(nodes - 1)
    rows = nodes + len(pair)
    root, unit = rng.standard_normal((rows, rows + 1)), 10 ** rng.uniform(-0.5, 0.5, rows)
    offset = rng.uniform(0.1, 1.0, len(pair)) * (pair % 3 == 0)
    coefficient = rng.uniform(0.1, largest, len(pair)) * (pair % 4 != 0)
    bilateral = np.isin(np.arange(nodes) % 2, {"none": (), "some": (1,), "all": (0, 1)}[pulls])
    free = {}
    if motions:
        R = rng.standard_normal((rows, motions))
        forces = np.append(rng.uniform(0.2, 1.0, nodes), rng.uniform(-0.1, 0.1, len(pair)))
        free = {"motions": R, "balance": R.T @ forces}
    return CoulombProblem(root @ root.T * np.outer(unit, unit), rng.standard_normal(rows),
                          coefficient, pair, bilateral, offset=offset, **free)


def at(path: _Path) -> CoulombProblem:
    """The problem that the present point of a path solves."""
    problem = path.problem
    balance = problem.balance - (1.0 - path.theta) * path.more
    return problem.under(path.load + path.theta * path.change, problem.coefficient, balance)


@pytest.mark.parametrize("motions", [0, 2])
@pytest.mark.parametrize("pulls", ["none", "some", "all"])
@pytest.mark.some(2)
def test_every_point_of_a_path_solves_its_own_problem(monkeypatch, motions, pulls):
    """Where it begins, at every border of states, and at its end, where the load is the step's."""
    honest, borders, turns = _Path._crossed, [], 0

    def crossed(path, *given):
        assert at(path).violation(path.z) <= 1e-8
        borders.append(path.theta)
        return honest(path, *given)

    monkeypatch.setattr(_Path, "_crossed", crossed)
    for seed in range(SEEDS):
        problem, borders[:] = random_problem(seed, 6, motions, pulls), []
        for near in (np.zeros(problem.rows + motions), *complementarity.all_alike(problem)):
            path = _Path(problem, near, 1e-2)
            assert at(path).violation(path.z) <= 1e-8
            z = path.end()
            assert z is None or problem.violation(z) <= 1e-8
        turns += (np.diff(borders) < 0).any()
    assert turns > 1  # loads fall on the way


@pytest.mark.parametrize("motions, pulls, least", [
    (0, "none", 1.0), (0, "some", 0.9), (1, "none", 0.9), (3, "some", 0.9)])
def test_paths_end_in_solutions(motions, pulls, least):
    """With supports and contact that does not pull always, elsewhere nearly always."""
    ends = 0
    for seed in range(2 * SEEDS):
        problem = random_problem(seed, 7, motions, pulls)
        z = at_the_end_of_a_path(problem, np.zeros(problem.rows + motions))
        assert z is None or problem.solves(z)
        ends += z is not None
    assert ends >= least * 2 * SEEDS


def test_a_path_of_a_body_that_is_pulled_off_runs_off():
    """Two smooth feet: pushed by one it rests on them, by their compliances; pulled it never does.
    """
    motions = np.array([[1.0], [1.0], [0.0], [0.0]])
    for force in (-1.0, 1.0):
        problem = CoulombProblem(np.diag([1.0, 2.0, 1.0, 2.0]), np.zeros(4), np.zeros(2),
                                 np.arange(2), False, motions, np.array([force]))
        z = at_the_end_of_a_path(problem, np.zeros(5))
        assert (z is None) == (force < 0)
    assert z[:4] == pytest.approx([2 / 3, 1 / 3, 0.0, 0.0])


def test_a_body_moves_on_the_way_until_a_node_stops_it(monkeypatch):
    """Pushed along a floor it slides off under a load that stays, up to a stop half a unit ahead.
    """
    stays, honest = [], _Path._direction
    motions = np.array([[0.0, 1.0], [-1.0, 0.0], [1.0, 0.0]])  # pressed on the floor, and pushed
    problem = CoulombProblem(np.eye(3), np.array([0.0, -0.5, 0.0]), np.array([0.3]),
                             np.zeros(1, int), False, motions, np.array([-1.0, 1.0]))

    def direction(path):
        way, faster = honest(path)
        stays.append(abs(faster) < 1e-12 * np.abs(way).max())
        return way, faster

    monkeypatch.setattr(_Path, "_direction", direction)
    z = _Path(problem, np.array([1.0, 0.0, 0.0, 0.0, 0.0]), 1e-3).end()
    assert problem.solves(z) and any(stays)
    assert z[:3] == pytest.approx([1.0, 0.7, -0.3])


@pytest.mark.parametrize("kind", ["PIVOTS", "FAR"])
def test_paths_know_their_limits(monkeypatch, kind):
    """Changes of states, and how far loads may go beyond those of the step."""
    problem = random_problem(3, 7, 1)
    near = complementarity.all_alike(problem)[0]
    assert _Path(problem, near, 1e-2).end() is not None
    monkeypatch.setattr(continuation, kind, 0)
    assert _Path(problem, near, 1e-2).end() is None


def test_conditions_that_depend_on_one_another_have_forces_all_the_same(monkeypatch):
    """Two nodes at one place, as where three bodies meet: on the path their forces are unique."""
    honest, made = _Path.__init__, []

    def init(path, problem, *given):
        made.append(problem)
        honest(path, problem, *given)

    monkeypatch.setattr(_Path, "__init__", init)
    for seed in range(SEEDS):
        one = random_problem(seed, 5, 1)
        twice = np.array([0, 1, 2, 3, 4, 0, 5, 6, 7, 8, 5])  # node 0 and its tangential row
        problem = CoulombProblem(
            one.compliance[np.ix_(twice, twice)], one.load[twice], one.coefficient[[0, 1, 2, 3, 0]],
            np.array([0, 1, 2, 3, 5]), False, one.motions[twice], one.balance)
        z = at_the_end_of_a_path(problem, np.zeros(problem.rows + 1))
        assert problem.solves(z), seed
        assert np.linalg.eigvalsh(problem.compliance)[0] < 1e-13 * problem.compliance.max()
        assert np.linalg.cholesky(made[-1].compliance).diagonal().min() > 0
