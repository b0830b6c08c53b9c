"""Sparse Cholesky factors of subdomains: against dense algebra, for any pattern of the interior.

Matrices are random and well conditioned (diagonal 0.5 above a Gram matrix), so that dense and
sparse factors agree to some hundred roundings.
"""

import numpy as np
import pytest
from scipy.sparse import csr_matrix, eye, random

from driver.errors import NoSolution
from driver.feti import cholesky
from driver.feti.cholesky import TornFactor

ROUNDING = 1e-12


def torn(seed: int):
    """A random stiffness, shuffled torn dofs of which some are seen, corners, fixed dofs."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(4, 150))
    A = random(size, size, rng.choice([0.005, 0.02, 0.1]), random_state=seed)
    K = (A @ A.T + 0.5 * eye(size)).tocsr()
    dofs = rng.permutation(size)
    corner, rest = np.sort(dofs[: size // 8]), np.sort(dofs[size // 8 : -1])
    return K, rest, rng.random(len(rest)) < rng.choice([0.0, 0.1, 0.5, 1.0]), corner


@pytest.mark.parametrize("seed", range(60))
def test_blocks_are_those_of_dense_algebra(seed):
    """Sparse patterns have interiors in many parts, interface dofs apart, and none of either."""
    K, dofs, seen, corner = torn(seed)
    factor, dense = TornFactor(K, dofs, seen), K.toarray()
    inverse = np.linalg.inv(dense[np.ix_(dofs, dofs)])
    K_rc = dense[np.ix_(dofs, corner)]
    on_seen, coupling, schur = factor.reduced(corner)
    assert np.abs(on_seen - inverse[np.ix_(seen, seen)]).max(initial=0) < ROUNDING
    assert np.abs(coupling - (inverse @ K_rc)[seen]).max(initial=0) < ROUNDING
    wanted = dense[np.ix_(corner, corner)] - K_rc.T @ inverse @ K_rc
    assert np.abs(schur - wanted).max(initial=0) < ROUNDING
    assert np.array_equal(on_seen, on_seen.T) and np.array_equal(schur, schur.T)
    right = np.random.default_rng(seed).standard_normal((len(dofs), 3))
    assert np.abs(factor.solve(right) - inverse @ right).max(initial=0) < ROUNDING


@pytest.mark.parametrize("seed", range(60))
def test_displacements_between_known_corners_take_a_pass_up_the_factor(seed):
    """Loads anywhere and forces of rows on t, whose pass down is that of all rows of L."""
    K, dofs, seen, corner = torn(seed)
    factor, dense = TornFactor(K, dofs, seen), K.toarray()
    factor.reduced(corner)
    load, on_rows = np.random.default_rng(seed).standard_normal((2, len(dofs)))
    on_rows[~seen] = 0.0
    u_c = np.random.default_rng(seed + 1).standard_normal(len(corner))
    down = factor.forward_of_rows(on_rows)
    assert np.abs(down - factor.forward(on_rows)).max(initial=0) < ROUNDING
    right = load + on_rows - dense[np.ix_(dofs, corner)] @ u_c
    wanted = np.linalg.solve(dense[np.ix_(dofs, dofs)], right)
    between = factor.backward(factor.forward(load) + down, u_c)
    largest = max(1.0, np.abs(wanted).max(initial=0))
    assert np.abs(between - wanted).max(initial=0) < ROUNDING * largest


def test_corners_that_alone_leave_a_body_loose_are_no_obstacle():
    """A bar of two nodes, both corners: nothing is torn, and S is the singular stiffness itself."""
    K = csr_matrix([[1.0, -1.0], [-1.0, 1.0]])
    none = np.empty(0, int)
    _, _, schur = TornFactor(K, none, np.empty(0, bool)).reduced(np.arange(2))
    assert np.abs(schur - K.toarray()).max() < 1e-15


@pytest.mark.parametrize("K", [[[1.0, -1.0], [-1.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]],
                               [[1.0, 0.0], [0.0, 0.0]], [[-1.0, 0.0], [0.0, 1.0]]])
@pytest.mark.parametrize("seen", [[False, False], [False, True], [True, True]])
@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_singular_and_indefinite_stiffness_is_refused(K, seen, unit):
    """Free motions, negative and missing stiffness, inside and where rows act, in any unit; also
    where the last bit of a diagonal entry is left.
    """
    for last in (1.0, 1.0 + np.finfo(float).eps):
        with pytest.raises(NoSolution, match="positive definite"):
            TornFactor(csr_matrix(unit * np.array(K) * [[1.0, 1.0], [1.0, last]]), np.arange(2),
                       np.array(seen)).reduced(np.empty(0, int))
    sound = csr_matrix(unit * np.array([[2.0, -1.0], [-1.0, 2.0]]))
    TornFactor(sound, np.arange(2), np.array(seen)).reduced(np.empty(0, int))


def test_the_lower_triangle_is_mirrored(monkeypatch):
    """In blocks of any size beside that of the matrix."""
    matrix = np.random.default_rng(1).standard_normal((7, 7))
    expected = np.tril(matrix) + np.tril(matrix, -1).T
    for size in (1, 3, 7, 10):
        monkeypatch.setattr(cholesky, "AT_A_TIME", size)
        assert np.array_equal(cholesky.mirrored(matrix.copy()), expected)


def test_dofs_of_a_node_beside_one_another_make_a_block():
    """A lone dof, here of nodes 7, 5, 8 and of another 5, has a place of nothing beside it."""
    place, size = cholesky._pairs(np.array([3, 3, 7, 4, 4, 5, 8, 5]))
    assert place.tolist() == [0, 1, 2, 4, 5, 6, 8, 10] and size == 12
    place, size = cholesky._pairs(np.empty(0, int))
    assert not len(place) and not size


def test_factors_are_kept_in_blocks_of_nodes(monkeypatch):
    """Both dofs of a node have the same neighbours: blocks hold no zeros but on the diagonal."""
    made = []
    monkeypatch.setattr(cholesky, "_in_blocks", lambda upper: made.append(upper))
    side = np.eye(12) * 2 + np.eye(12, k=1) + np.eye(12, k=-1)
    K = csr_matrix(np.kron(np.kron(side, side), [[1.0, 0.1], [0.1, 1.0]]) + 20 * np.eye(288))
    TornFactor(K, np.arange(288), np.zeros(288, bool)).reduced(np.empty(0, int))
    entries, blocks = made[0].nnz, made[0].tobsr((2, 2)).data.size
    assert made[0].shape == (288, 288) and blocks == entries + 144


def test_a_subdomain_that_supports_hold_in_all_dofs_has_nothing():
    """A triangle in a clamped corner."""
    factor = TornFactor(csr_matrix(np.eye(6)), np.empty(0, int), np.empty(0, bool))
    assert [part.shape for part in factor.reduced(np.empty(0, int))] == [(0, 0)] * 3
    none = np.empty(0)
    assert not factor.forward(none).size and not factor.forward_of_rows(none).size
    assert not factor.backward(none, none).size and factor.solve(np.ones((0, 2))).shape == (0, 2)
