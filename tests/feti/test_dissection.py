"""Nested dissection of a sum over elements, against the dense matrix."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from driver.errors import NoSolution
from driver.feti import dissection
from driver.feti.dissection import Dissection, Elements, _holders, grouped

SIDE = 7  # cells along either side of a square, an element each, with two dofs a vertex


def cells() -> tuple[np.ndarray, np.ndarray]:
    """Dofs (m, 8) and middles (m, 2) of the elements."""
    i, j = (of.ravel() for of in np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"))
    corner = (i[:, None] + [0, 1, 1, 0]) * (SIDE + 1) + j[:, None] + [0, 0, 1, 1]
    dofs = (2 * corner[:, :, None] + [0, 1]).reshape(-1, 8)
    return dofs, np.column_stack([i, j]) + 0.5


def elements(group: np.ndarray, stiff: float = 1.0) -> tuple[Elements, np.ndarray]:
    """Elements that resist all motions of theirs, `stiff` ones so much more; the dense sum."""
    rng, (dofs, _) = np.random.default_rng(1), cells()
    matrices, n = [], dofs.max() + 1
    dense = np.zeros((n, n))
    for k, own in enumerate(dofs):
        root = rng.standard_normal((8, 8))
        matrices.append((root @ root.T + 0.1 * np.eye(8)) * (stiff if k % 3 else 1.0))
        dense[np.ix_(own, own)] += matrices[-1]
    return Elements(dofs.ravel(), np.full(len(dofs), 8), group, np.ravel(matrices)), dense


@pytest.fixture(autouse=True)
def small_groups(monkeypatch):
    monkeypatch.setattr(dissection, "GROUP", 4)


def test_groups_are_halves_of_halves():
    """Along the longer side; of one size but for one element, four at most in each."""
    _, places = cells()
    group, depth = grouped(places * [3.0, 1.0], MPI.COMM_SELF)
    assert depth == 4 and group.max() == 15
    assert set(np.bincount(group)) == {3, 4}
    for k in range(depth):
        sizes = np.bincount(group >> k)
        assert sizes.max() - sizes.min() <= 1
    first = group >> depth - 1
    assert places[first == 0, 0].max() <= places[first == 1, 0].min()
    alone, depth = grouped(places[:3], MPI.COMM_SELF)
    assert depth == 0 and not alone.any()
    assert grouped(np.zeros((0, 2)), MPI.COMM_SELF)[1] == 0


@pytest.mark.parametrize("stiff", [1.0, 1e6])
def test_solutions_are_those_of_the_dense_matrix(stiff):
    """With forces of each element added up; dofs that are asked for stay to the last."""
    dofs, places = cells()
    group, depth = grouped(places, MPI.COMM_SELF)
    parts, dense = elements(group, stiff)
    kept, pins = np.zeros((2, len(dense)), bool)
    kept[[0, 1, 50, 77]] = True
    shared = Dissection(MPI.COMM_SELF, parts, depth, kept, pins)
    assert len(shared.levels) == 5
    forces = np.random.default_rng(2).standard_normal(dofs.size)
    total = np.bincount(dofs.ravel(), forces)
    exact = np.linalg.solve(dense, total)
    np.testing.assert_allclose(shared.solve(forces), exact[dofs.ravel()],
                               atol=1e-9 * np.abs(exact).max())
    assert shared.top.tolist() == [0, 1, 50, 77]
    inverse = np.linalg.inv(dense)[np.ix_(shared.top, shared.top)]
    np.testing.assert_allclose(shared.inverse, inverse, atol=1e-9 * np.abs(inverse).max())
    assert shared.received == shared.messages == 0


def test_pinned_dofs_do_not_move():
    """Wherever they are: inside a group, between groups, at the top."""
    dofs, places = cells()
    group, depth = grouped(places, MPI.COMM_SELF)
    parts, dense = elements(group)
    kept, pins = np.zeros((2, len(dense)), bool)
    pins[[3, 40, 41, 64]] = kept[[64, 90]] = True
    shared = Dissection(MPI.COMM_SELF, parts, depth, kept, pins)
    forces = np.where(pins[dofs.ravel()], 0.0, np.random.default_rng(3).standard_normal(dofs.size))
    exact, free = np.zeros(len(dense)), np.flatnonzero(~pins)
    exact[free] = np.linalg.solve(dense[np.ix_(free, free)],
                                  np.bincount(dofs.ravel(), forces)[free])
    np.testing.assert_allclose(shared.solve(forces), exact[dofs.ravel()], atol=1e-11)
    at = shared.top.tolist().index(64)
    assert not shared.inverse[at].any() and not shared.inverse[:, at].any()


def test_what_is_loose_is_refused():
    """An element that resists nothing: its corner of the square belongs to no other one."""
    _, places = cells()
    group, depth = grouped(places, MPI.COMM_SELF)
    parts, dense = elements(group)
    parts.matrices[:64] = 0.0
    none = np.zeros(len(dense), bool)
    with pytest.raises(NoSolution):
        Dissection(MPI.COMM_SELF, parts, depth, none, none)
    kept = none.copy()
    kept[0] = True  # found at the top
    with pytest.raises(NoSolution):
        Dissection(MPI.COMM_SELF, parts, depth, kept, none)


@pytest.mark.parametrize("ranks", [1, 2, 5, 8, 32])
def test_groups_of_groups_go_to_ranks_without_any(ranks):
    """Those of groups lie side by side; above them no rank has groups of two levels."""
    comm, taken = SimpleNamespace(size=ranks), []
    for depth in range(7):
        groups = 2**depth
        holders = _holders(np.arange(groups), groups, comm)
        assert (np.diff(holders) >= 0).all() and 0 <= holders.min() <= holders.max() < ranks
        if groups < ranks:
            taken += holders.tolist()
    if ranks in (8, 32):
        assert len(set(taken)) == len(taken) == ranks - 1


def test_what_is_asked_for_changes_no_solution():
    """Groups of one padded shape may have fewer dofs; asking for some of them costs nothing."""
    dofs, places = cells()
    group, depth = grouped(places, MPI.COMM_SELF)
    solutions, works = [], []
    for asked in ([], [0, 1, 50, 77]):
        parts, dense = elements(group)
        kept, pins = np.zeros((2, len(dense)), bool)
        kept[asked] = True
        shared = Dissection(MPI.COMM_SELF, parts, depth, kept, pins)
        solutions.append(shared.solve(np.ones(dofs.size)))
        works.append(shared.work)
    np.testing.assert_array_equal(*solutions)
    assert works[0] == works[1] < len(dense) ** 2
