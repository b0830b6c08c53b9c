"""Sparse Cholesky factors of subdomains: against dense algebra, for any pattern of the interior.

Matrices are random and well conditioned (diagonal 0.5 above a Gram matrix), so that dense and
sparse factors agree to some hundred roundings.
"""

import numpy as np
import pytest
from cvxopt import matrix
from scipy.sparse import bsr_matrix, csr_matrix, eye, random

from driver.errors import NoSolution
from driver.feti import cholesky
from driver.feti.cholesky import Interior
from driver.feti.torn_factor import TornFactor
from small_scenes import halved

ROUNDING = 1e-12


def factor_of(K, dofs, seen, corner, together=1, rim=()):
    """A TornFactor of the torn `dofs`, those `seen` with rows, and the rim that they need."""
    free, nodes = np.zeros(K.shape[0], bool), np.unique(dofs[seen] // 2)
    free[dofs] = free[corner] = True
    rim = np.unique(np.concatenate([nodes, corner // 2, np.array(rim, int)]))
    return TornFactor(Interior(halved(K), rim, free), dofs, nodes, together)


def torn(seed: int):
    """A random stiffness, torn dofs, those of seen nodes, and corners; some dofs are fixed."""
    rng = np.random.default_rng(seed)
    size = 2 * int(rng.integers(2, 75))
    A = random(size, size, rng.choice([0.005, 0.02, 0.1]), random_state=seed)
    K = (A @ A.T + 0.5 * eye(size)).tocsr()
    nodes, fixed = rng.permutation(size // 2), rng.random(size) < rng.choice([0.0, 0.1, 0.5])
    of_corners = np.isin(np.arange(size) // 2, nodes[: size // 16])
    rest = np.flatnonzero(~of_corners & ~fixed)
    seen = rng.random(size // 2) < rng.choice([0.0, 0.1, 0.5, 1.0])
    return K, rest, seen[rest // 2], np.flatnonzero(of_corners & ~fixed)


def wider(seed: int, K) -> np.ndarray:
    """A third of all nodes, for every other seed: more than the rim needs."""
    nodes = np.random.default_rng(seed).permutation(K.shape[0] // 2)
    return nodes[: len(nodes) // 3 * (seed % 2)]


@pytest.mark.parametrize("seed", range(60))
def test_blocks_are_those_of_dense_algebra(seed):
    """Sparse patterns have interiors in many parts, interface dofs apart, and none of either; rims
    have dofs that no row acts on, or that supports hold.
    """
    K, dofs, seen, corner = torn(seed)
    factor, dense = factor_of(K, dofs, seen, corner, rim=wider(seed, K)), K.toarray()
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
    factor, dense = factor_of(K, dofs, seen, corner, rim=wider(seed, K)), K.toarray()
    factor.reduced(corner)
    load, on_rows = np.random.default_rng(seed).standard_normal((2, 3, len(dofs)))
    on_rows[:, ~seen] = 0.0
    u_c = np.random.default_rng(seed + 1).standard_normal((3, len(corner)))
    down = factor.forward_of_rows(on_rows)
    assert np.abs(down - factor.forward(on_rows)).max(initial=0) < ROUNDING
    right = load + on_rows - u_c @ dense[np.ix_(corner, dofs)]
    wanted = np.linalg.solve(dense[np.ix_(dofs, dofs)], right.T).T
    between = factor.backward(factor.forward(load) + down, u_c)
    largest = max(1.0, np.abs(wanted).max(initial=0))
    assert np.abs(between - wanted).max(initial=0) < ROUNDING * largest


@pytest.mark.parametrize("seed", range(20))
def test_the_bits_of_a_solution_do_not_depend_on_how_many_there_are(seed):
    """Subdomains that are alike on several ranks: any of them are solved for side by side."""
    K, dofs, seen, corner = torn(seed)
    factor, rng = factor_of(K, dofs, seen, corner, 4, wider(seed, K)), np.random.default_rng(seed)
    factor.reduced(corner)
    load, u_c = rng.standard_normal((7, len(dofs))), rng.standard_normal((7, len(corner)))
    on_rows = np.where(seen, rng.standard_normal((7, len(dofs))), 0.0)
    down, on_rows_down = factor.forward(load), factor.forward_of_rows(on_rows)
    together = factor.backward(down + on_rows_down, u_c)
    for some in ([5], [6, 2], [1, 0, 3, 4, 5]):
        part = factor.forward(load[some]) + factor.forward_of_rows(on_rows[some])
        assert np.array_equal(factor.backward(part, u_c[some]), together[some])


def test_corners_that_alone_leave_a_body_loose_are_no_obstacle():
    """A bar of two nodes, both corners: nothing is torn, and S is the singular stiffness itself."""
    K = csr_matrix([[1.0, -1.0], [-1.0, 1.0]])
    none, both = np.empty(0, int), np.arange(2)
    _, _, schur = factor_of(K, none, none, both).reduced(both)
    assert np.abs(schur - K.toarray()).max() < 1e-15


@pytest.mark.parametrize("K", [[[1.0, -1.0], [-1.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]],
                               [[1.0, 0.0], [0.0, 0.0]], [[-1.0, 0.0], [0.0, 1.0]]])
@pytest.mark.parametrize("seen", [[False, False], [False, True], [True, True]])
@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_singular_and_indefinite_stiffness_is_refused(K, seen, unit):
    """Free motions, negative and missing stiffness, inside and where rows act, in any unit; also
    where the last bit of a diagonal entry is left. Two nodes that move in one direction.
    """
    none = np.empty(0, int)
    both = np.array([0, 2]), np.array(seen), none
    for last in (1.0, 1.0 + np.finfo(float).eps):
        bad = csr_matrix(unit * np.kron(np.array(K) * [[1.0, 1.0], [1.0, last]], np.eye(2)))
        with pytest.raises(NoSolution, match="positive definite"):
            factor_of(bad, *both).reduced(none)
    sound = csr_matrix(unit * np.kron([[2.0, -1.0], [-1.0, 2.0]], np.eye(2)))
    factor_of(sound, *both).reduced(none)


@pytest.mark.parametrize("seed", range(20))
def test_factors_are_kept_in_blocks_of_nodes(seed, monkeypatch):
    """Nothing is left out, and blocks hold no zeros that L has not but one above the diagonal,
    whatever the entries of the stiffness are and whichever dofs are free.
    """
    made, split = [], cholesky._blocks
    monkeypatch.setattr(cholesky, "_blocks", lambda *L: made.append((*L, split(*L))) or made[0][2])
    K, dofs, seen, corner = torn(seed)
    factor_of(K, dofs, seen, corner).reduced(corner)
    L, inner, (start, row, values) = made[0]
    wanted = np.eye(L.size[0])
    wanted[:, :inner] = np.array(matrix(L))[:, :inner]
    whole = bsr_matrix((values.transpose(0, 2, 1), row, start), L.size)
    assert np.array_equal(whole.toarray().T, wanted)
    assert 4 * start[inner // 2] == len(L[:, :inner]) + inner // 2


def test_a_subdomain_that_supports_hold_in_all_dofs_has_nothing():
    """A triangle in a clamped corner."""
    factor = factor_of(csr_matrix(np.eye(6)), *np.empty((3, 0), int))
    assert [part.shape for part in factor.reduced(np.empty(0, int))] == [(0, 0)] * 3
    none = np.empty((2, 0))
    assert not factor.forward(none).size and not factor.forward_of_rows(none).size
    assert not factor.backward(none, none).size and factor.solve(none.T).shape == (0, 2)
