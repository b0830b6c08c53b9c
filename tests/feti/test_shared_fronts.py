"""Fronts that ranks share: who has which, and the same bits for any number of ranks."""

import subprocess
import sys

import numpy as np
import pytest

from driver import children
from driver.feti import elimination_tree
from driver.feti.elimination_tree import EliminationTree
from driver.feti.fronts import GluingElimination

SCRIPT = """
import sys
from pathlib import Path
from driver import environment
environment.prepare_libraries(); environment.start_petsc()
import numpy as np
from mpi4py import MPI
from driver.errors import NotConverged
from driver.feti import elimination_tree, fronts
from driver.feti.fronts import GluingElimination
from driver.march.problem import assemble

comm, alone = MPI.COMM_WORLD, MPI.COMM_SELF
pays, one = elimination_tree._pays, fronts.eliminated
for directory in sys.argv[1:]:
    for merged in (pays, lambda child, parent: False):
        elimination_tree._pays = merged
        shared, whole = (GluingElimination(assemble(Path(directory), over).operator)
                         for over in (comm, alone))
        assert shared.price == whole.price
        C = shared.compliance()
        assert np.array_equal(C, whole.compliance())
        residual = np.random.default_rng(5).standard_normal(shared._dual)
        assert np.array_equal(shared.change(residual), whole.change(residual))
        assert np.array_equal(shared.change(-residual), whole.change(-residual))
        # nothing is done twice, and nobody does nearly all of it where there are many fronts: of
        # so few subdomains half the work is that of the last ones, which wait for one another
        numbers = comm.allgather(list(shared._factors))
        assert sorted(sum(numbers, [])) == list(whole._factors)
        if merged is not pays:
            work = [sum(shared._tree.fronts[f].work for f in own) for own in numbers]
            assert max(work) < 0.85 * sum(work), work

        def refused(*given):
            if comm.rank == max(k for k, own in enumerate(numbers) if own):
                raise NotConverged("here alone")
            return one(*given)

        fronts.eliminated = refused
        try:
            GluingElimination(shared._operator).compliance()
        except NotConverged as problem:  # on every rank, and none waits
            pass
        else:
            raise AssertionError("a rank did not hear of it")
        fronts.eliminated = one
print("same", flush=True)
"""


# slow: more ranks than the machine has cores, and than there is work for
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, *(pytest.param(n, marks=pytest.mark.slow) for n in (3, 7))])
def test_any_number_of_ranks_makes_the_same_fronts(tmp_path, exported, ranks):
    """A grid, a metis cut of several materials, mortar rows of two bodies."""
    exports = [exported(subdomains="8x4", cells=3), exported("bracket", subdomains="23"),
               exported("mindlin-bodies", subdomains="11")]
    script = tmp_path / "ranks.py"
    script.write_text(SCRIPT)
    env = {**children.child_environment(), "PYTHONPATH": children.python_path()}
    done = subprocess.run([*children.mpirun(ranks), sys.executable, script, *exports],
                          env=env, text=True, capture_output=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.count("same") == ranks


@pytest.fixture
def tree(built, monkeypatch) -> EliminationTree:
    """Fronts of a grid of 32 subdomains, not merged."""
    monkeypatch.setattr(elimination_tree, "_pays", lambda child, parent: False)
    return GluingElimination(built("model", subdomains="8x4", cells=4).operator)._tree


def totals(tree) -> np.ndarray:
    """Work of the subtrees that end with each front."""
    below = np.append([front.work for front in tree.fronts], 0.0)
    for front, parent in enumerate(tree.parent):
        below[parent] += below[front]
    return below


@pytest.mark.parametrize("ranks", [1, 2, 5, 64])
def test_every_front_has_a_rank_and_small_subtrees_stay_together(tree, ranks):
    """In turn children come before their parents, so that no rank waits for one that waits for it.
    """
    holders = np.arange(32) * min(ranks, 32) // 32
    owner, turn = tree.shared(holders, ranks)
    assert len(owner) == len(tree.fronts) + 1 and 0 <= owner.min() <= owner.max() < ranks
    assert len(set(owner.tolist())) >= min(ranks, 8)
    assert sorted(turn.tolist()) == list(range(len(owner)))
    when = np.argsort(turn)
    assert (when[:-1] < when[tree.parent]).all() and turn[-1] == len(tree.fronts)
    below = totals(tree)
    small = below[tree.parent] <= below[-1] / ranks / max(elimination_tree.PARTS)
    assert (owner[:-1] == owner[tree.parent])[small].all()


def test_ranks_have_about_the_same_where_their_subdomains_are(tree):
    """Fronts that wait for one another, which no more ranks would help, are less than half of it.
    """
    work, held = np.array([front.work for front in tree.fronts]), np.arange(32) // 16
    assert critical(tree, np.append(work, 0.0)) < 0.4 * work.sum()
    for holders in (held, 1 - held):
        owner, _ = tree.shared(holders, 2)
        assert np.bincount(owner[:-1], work).max() <= 0.65 * work.sum()
        assert np.count_nonzero(owner[tree.first] == holders) > 16


def test_a_plan_ends_when_the_slowest_way_does(tree, monkeypatch):
    """One rank has no gaps; of many, where messages take no time, each front begins when its
    children are done; where they take for ever, the rank that has all does everything.
    """
    work = np.array([front.work for front in tree.fronts] + [0.0])
    below, held = totals(tree), np.zeros((len(work), len(work)))
    assert tree._planned(work, below, held[:, :1], 0.0)[0] == pytest.approx(work.sum())
    monkeypatch.setattr(elimination_tree, "A_MOVE", 0.0)
    assert tree._planned(work, below, held, 0.0)[0] == pytest.approx(critical(tree, work))
    monkeypatch.setattr(elimination_tree, "A_MOVE", 1e12)
    owner, _ = tree.shared(np.ones(32, int), 2)
    assert owner.all()


def critical(tree, work: np.ndarray) -> float:
    """Work of the fronts that wait for one another, where that is most."""
    path = work.copy()
    for front, parent in reversed(list(enumerate(tree.parent))):
        path[front] += path[parent]
    return path.max()
