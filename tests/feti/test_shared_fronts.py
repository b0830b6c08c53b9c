"""Fronts that ranks share: who has which, and the same bits for any number of ranks."""

import subprocess
import sys

import numpy as np
import pytest

from driver import environment
from driver.feti import elimination_tree
from driver.feti.elimination_tree import EliminationTree
from driver.feti.fronts import GluingElimination

SCRIPT = """
import sys
from pathlib import Path
from driver import environment
environment.single_threaded(); environment.start_petsc()
import numpy as np
from mpi4py import MPI
from driver.errors import NotConverged
from driver.feti import elimination_tree, fronts
from driver.feti.fronts import GluingElimination
from driver.march.problem import assemble

comm, alone = MPI.COMM_WORLD, MPI.COMM_SELF
pays, one = elimination_tree._pays, fronts._eliminated
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

        def refused(matrix, m, sign):
            if comm.rank == max(k for k, own in enumerate(numbers) if own):
                raise NotConverged("here alone")
            return one(matrix, m, sign)

        fronts._eliminated = refused
        try:
            GluingElimination(shared._operator).compliance()
        except NotConverged as problem:  # on every rank, and none waits
            pass
        else:
            raise AssertionError("a rank did not hear of it")
        fronts._eliminated = one
print("same", flush=True)
"""


# slow: more ranks than the machine has cores, and than there is work for
@pytest.mark.parametrize("ranks", [2, *(pytest.param(n, marks=pytest.mark.slow) for n in (3, 7))])
def test_any_number_of_ranks_makes_the_same_fronts(tmp_path, exported, ranks):
    """A grid, a metis cut of several materials, mortar rows of two bodies."""
    exports = [exported(subdomains="8x4", cells=3), exported("bracket", subdomains="23"),
               exported("mindlin-bodies", subdomains="11")]
    script = tmp_path / "ranks.py"
    script.write_text(SCRIPT)
    env = {**environment.child_environment(), "PYTHONPATH": environment.python_path()}
    done = subprocess.run([*environment.mpirun(ranks), sys.executable, script, *exports],
                          env=env, text=True, capture_output=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.count("same") == ranks


@pytest.fixture
def tree(built, monkeypatch) -> EliminationTree:
    """Fronts of a grid of 32 subdomains, not merged."""
    monkeypatch.setattr(elimination_tree, "_pays", lambda child, parent: False)
    return GluingElimination(built("model", subdomains="8x4", cells=4).operator)._tree


@pytest.mark.parametrize("ranks", [1, 2, 5, 64])
def test_every_front_has_a_rank_and_subtrees_stay_together(tree, ranks):
    """Fronts have the rank of their heaviest child, so that its rest, the largest, stays there."""
    holders = np.arange(32) * min(ranks, 32) // 32
    owner = tree.owners(holders, ranks)
    assert len(owner) == len(tree.fronts) + 1 and 0 <= owner.min() <= owner.max() < ranks
    assert len(set(owner.tolist())) >= min(ranks, 8)
    below = [front.work for front in tree.fronts]
    for front, parent in enumerate(tree.parent):
        if parent < len(below):
            below[parent] += below[front]
    moved = np.count_nonzero(owner[:-1] != owner[tree.parent])
    assert moved <= len(tree.fronts) / 2
    for front, children in enumerate(tree.children):
        if children:
            assert owner[front] == owner[max(children, key=lambda child: below[child])]


def test_two_ranks_take_half_each_where_their_subdomains_are(tree):
    work = np.array([front.work for front in tree.fronts])
    held = np.arange(32) // 16
    for holders in (held, 1 - held):
        owner = tree.owners(holders, 2)
        load = np.bincount(owner[:-1], work)
        assert load.max() <= 0.75 * load.sum()  # the last fronts are of one rank
        assert np.count_nonzero(owner[tree.first] == holders) > 16
        assert tree._end(np.append(work, 0.0), owner, 2) <= 0.75 * work.sum()


def test_the_end_is_that_of_the_slowest_way(tree):
    """One rank has no gaps; a front waits for its children."""
    work = np.append(np.array([front.work for front in tree.fronts]), 0.0)
    assert tree._end(work, np.zeros(len(work), int), 1) == pytest.approx(work.sum())
    many = len(work)
    critical = np.zeros(many)
    for front, parent in enumerate(tree.parent):
        critical[front] += work[front]
        critical[parent] = max(critical[parent], critical[front])
    assert tree._end(work, np.arange(many), many) == pytest.approx(critical[-1])


def test_the_heaviest_pairs_come_first():
    weight = np.array([[1.0, 5.0, 2.0], [4.0, 9.0, 0.0], [3.0, 3.0, 3.0]])
    assert elimination_tree._paired(weight).tolist() == [2, 1, 0]
