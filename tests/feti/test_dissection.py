"""Nested dissection of a sum over elements, against the dense matrix."""

import numpy as np
import pytest
from mpi4py import MPI

from driver.errors import NoSolution
from driver.feti import dissection
from driver.feti.dissection import Dissection, Elements, grouped

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


@pytest.mark.parametrize("merged", [1, 2])
@pytest.mark.parametrize("stiff", [1.0, 1e6])
def test_solutions_are_those_of_the_dense_matrix(monkeypatch, merged, stiff):
    """With forces of each element added up; dofs that are asked for stay to the last."""
    monkeypatch.setattr(dissection, "MERGED", merged)
    dofs, places = cells()
    group, depth = grouped(places, MPI.COMM_SELF)
    parts, dense = elements(group, stiff)
    kept, pins = np.zeros((2, len(dense)), bool)
    kept[[0, 1, 50, 77]] = True
    shared = Dissection(MPI.COMM_SELF, parts, depth, kept, pins)
    assert len(shared.levels) == (5 if merged == 1 else 3)
    forces = np.random.default_rng(2).standard_normal(dofs.size)
    total = np.bincount(dofs.ravel(), forces)
    exact = np.linalg.solve(dense, total)
    np.testing.assert_allclose(shared.solve(forces), exact[dofs.ravel()],
                               atol=1e-9 * np.abs(exact).max())
    assert np.isin([0, 1, 50, 77], shared.top).all()
    inverse = np.linalg.inv(dense)[np.ix_(shared.top, shared.top)]
    np.testing.assert_allclose(shared.inverse, inverse, atol=1e-9 * np.abs(inverse).max())
    assert shared.entries > shared.inverse.size and shared.received == shared.messages == 0


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
