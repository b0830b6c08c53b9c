"""What ranks share out: who meets whom, numbering, large coarse problems, exact sums.

One program on three ranks. Each of them does the same once more alone, for all subdomains (without
any message), and compares: numbers and bits must be those.
"""

import subprocess
import sys

import pytest

from driver import children

SCRIPT = """
import sys
from math import fsum
from pathlib import Path
from driver import environment
environment.prepare_libraries(); environment.start_petsc()
import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix
from driver.feti import coarse, dissection, reduction, vectors
from driver.feti.exchange import Route, components, exchange, sharers
from driver.feti.gathering import exact_sum
from driver.feti.operator import DualOperator
from driver.feti.skeleton import Skeleton
from driver.feti.structure import partition
from driver.march.tearing import build
from driver.scene.loader import read_subdomains
from driver.scene.manifest import read_manifest

comm, alone = MPI.COMM_WORLD, MPI.COMM_SELF
rng = np.random.default_rng(3)  # the same on every rank
keys = [np.sort(rng.choice(40, 17, replace=False)) for _ in range(comm.size)]
mine = keys[comm.rank]
expected = sorted((rank, k) for rank in range(comm.size) if rank != comm.rank
                  for k in range(17) if mine[k] in keys[rank])
assert sharers(comm, mine, 40).tolist() == [[k, rank] for rank, k in expected]

to = rng.integers(0, comm.size, (comm.size, 9))
rows = np.arange(9)[:, None] * [10.0, 1.0] + 1000 * comm.rank
source, got = exchange(comm, to[comm.rank], rows)
expected = [(rank, 1000 * rank + 10 * k) for rank in range(comm.size) for k in range(9)
            if to[rank, k] == comm.rank]
assert list(zip(source.tolist(), got[:, 0].tolist())) == expected
route = Route(comm, to[comm.rank])
assert route.forward(rows[:, 0].copy()).tolist() == [place for _, place in expected]
assert (route.backward(route.forward(rows[:, 0].copy())) == rows[:, 0]).all()

pairs = rng.integers(0, 300, (comm.size, 60, 2))  # links of items, few enough to leave parts
items, groups = pairs[comm.rank].ravel(), np.repeat(np.arange(60), 2)
part = components(comm, items, groups, 300)
whole = components(alone, pairs.ravel(), np.repeat(np.arange(60 * comm.size), 2), 300)
assert len(set(part)) == len(set(whole)) == len(set(zip(part, whole)))

terms = rng.standard_normal((50, 2)) * 10.0 ** rng.integers(-9, 9, (50, 1))
share = slice(*partition(50, comm))
total = exact_sum(comm, terms[share])
assert (total == exact_sum(alone, terms)).all()
size = np.abs(terms).max(axis=0)
for k in range(2):  # 50 terms, each to 2^-81 of the largest, and the rounding of the result
    assert abs(total[k] - fsum(terms[:, k])) <= 2.0**-52 * abs(total[k]) + 2.0**-74 * size[k]

def same(one, other):
    return np.array_equal(one, other) or (len(one) == 0 == len(other))

# keys of several ranks: who has each first, how many there are, and whom the first one is to tell
names = [rng.choice(30, 11, replace=False) for _ in range(comm.size)]
known, others = reduction._met(comm, [b"key %d" % k for k in names[comm.rank]], names[comm.rank])
for k, (first, total) in zip(names[comm.rank], known):
    have = [rank for rank in range(comm.size) if k in names[rank]]
    assert (first, total) == (have[0], k * len(have))
expected = [(j, rank) for j, k in enumerate(names[comm.rank]) for rank in range(comm.size)
            if k in names[rank] and rank > comm.rank
            and not any(k in names[lower] for lower in range(comm.rank))]
assert sorted(map(tuple, others.tolist())) == sorted(expected) and len(expected) > 0 or comm.rank

for directory in sys.argv[1:]:
    manifest = read_manifest(Path(directory))
    first, last = partition(manifest.subdomains, comm)
    subdomains = read_subdomains(manifest, 0, manifest.subdomains, alone)
    structure = build(manifest, subdomains[first:last], first, comm)
    whole = build(manifest, subdomains, 0, alone)
    own = slice(*structure.row_range)
    assert (structure.dual_dofs, structure.coarse_dofs) == (whole.dual_dofs, whole.coarse_dofs)
    for name in ("row_kind", "row_scale", "row_stiffness"):
        assert same(getattr(structure, name), getattr(whole, name)[own]), name
    for name in ("outer_edges", "outer_middles", "with_hats", "rigid_corners"):
        assert same(getattr(structure, name), getattr(whole, name)), name
    for name in ("row", "kind", "scale", "compliance"):
        assert same(getattr(structure.at_contact, name), getattr(whole.at_contact, name)), name
    for name in ("normal_row", "tangential_row", "gid", "chain"):
        assert same(getattr(structure.contact, name), getattr(whole.contact, name)), name
    for name in ("fixed", "corner_dofs", "corner_global"):
        for one, other in zip(getattr(structure, name), getattr(whole, name)[first:last]):
            assert same(one, other), name
    for one, other in zip(structure.rows, whole.rows[first:last]):
        for name in ("row", "sign", "dof", "coefficient", "fixed_part", "scaling"):
            assert same(getattr(one, name), getattr(other, name)), name
    # a rank knows its own nodes and those of neighbours at the same vertices, and nothing else
    known, every = (Skeleton(manifest, *part) for part in (
        (subdomains[first:last], comm), (subdomains, alone)))
    near = np.isin(every.nodes[:, 1], known.gids)
    assert same(known.nodes, every.nodes[near])
    # and hears of what other ranks find there
    rank = ((every.nodes[:, 0] + 1) * comm.size - 1) // manifest.subdomains
    found = every.over_subdomains(np.maximum, every.nodes[:, 1] % 5 == rank)
    heard = known.over_ranks(np.maximum, known.gids % 5 == comm.rank)
    assert same(heard, found[np.isin(every.gids, known.gids)])
    x = np.random.default_rng(7).standard_normal(structure.dual_dofs)
    small = DualOperator(whole, alone).apply(x).copy()
    before = coarse.LARGE, dissection.GROUP, vectors.MANY
    coarse.LARGE, dissection.GROUP, vectors.MANY = 0, 2, 0
    op, reference = DualOperator(structure, comm), DualOperator(whole, alone)
    y, expected = op.apply(x[own]).copy(), reference.apply(x).copy()
    assert len(op.coarse._shared.levels) > 1 or manifest.subdomains == 2
    assert same(y, expected[own]) and op.dot(x[own], y) == reference.dot(x, expected)
    # the same arithmetic in another order, S_cc with condition numbers up to 1e4
    assert np.abs(expected - small).max() <= 1e-10 * np.abs(small).max()
    (coarse.LARGE, dissection.GROUP, vectors.MANY) = before
    near = [s for s, rows in enumerate(whole.rows) if whole.at_contact.has(rows.row).any()]
    corners = np.unique(np.concatenate([whole.corner_global[s] for s in near]))
    inverse = DualOperator(whole, alone).coarse.inverse(corners)
    found = op.coarse.inverse(corners)
    assert same(found, reference.coarse.inverse(corners))
    assert np.abs(found - inverse).max() <= 1e-10 * np.abs(inverse).max()
    # fewer rows than corners: a solution a row, and the same bits
    some = csr_matrix(np.random.default_rng(8).standard_normal((len(corners) - 1, len(corners))))
    through = DualOperator(structure, comm).coarse.compliance(corners, some)
    assert same(through, DualOperator(whole, alone).coarse.compliance(corners, some))
    expected = some @ (some @ inverse).T
    assert np.abs(through - expected).max() <= 1e-10 * np.abs(expected).max()
print("same", flush=True)
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """A call of the program above on some ranks for some exports."""
    script = tmp_path_factory.mktemp("ranks") / "ranks.py"
    script.write_text(SCRIPT)

    def run(ranks: int, *exports) -> None:
        env = {**children.child_environment(), "PYTHONPATH": children.python_path()}
        done = subprocess.run([*children.mpirun(ranks), sys.executable, script, *exports],
                              env=env, text=True, capture_output=True, timeout=300)
        assert done.returncode == 0, done.stderr[-3000:]
        assert done.stdout.count("same") == ranks

    return run


@pytest.mark.slow
def test_ranks_share_out_what_one_rank_does_alone(program, exported):
    """A grid, a metis cut, free bodies; an interface in pieces, whose corners one side chooses."""
    program(3, exported(subdomains="8x4", cells=3), exported("stack", subdomains="13"),
            exported("joint", subdomains="9"), exported("hard/pieces"))


@pytest.mark.slow
def test_a_rank_without_subdomains_knows_quadratic_sides(program, exported):
    """Whose middles it has none of, as it has no edges. It had ended the run."""
    program(3, exported("tutorial", subdomains="2", element="P2"))


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, 7])
def test_any_scene_and_number_of_ranks(program, exported, ranks):
    """Springs, ties, sliding, revolution, curved sides; more ranks than subdomains."""
    program(ranks, *(exported(scene, subdomains=cut) for scene, cut in (
        ("hertz-bodies", "17"), ("punch", "23"), ("slope", "11"), ("bracket", "5"),
        ("hertz", "29"), ("pressfit", "6"), ("mindlin", "10"))))
