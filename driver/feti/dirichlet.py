"""The Dirichlet preconditioner of FETI-DP, M = sum_i B_D,i S_i B_D,i' restricted to a face.

S_i is the stiffness of the subdomain in the displacements of its rows, the (pseudo) inverse of the
explicit local F_i; corners that carry contact rows of their own are released: with v_b = B_r u, v_c
= B_c' x the energy is that of v_b - A v_c plus that of v_c in S. The weights in B_D are shares of
the stiffness (Klawonn, Rheinbach).
"""

import numpy as np
from scipy.linalg import lapack

from .blocks import BlockDiagonal
from .reduction import LocalClass

DEPENDENT = 1e-9  # relative eigenvalues of a local F: rows below depend on one another
FLOOR = 0.01  # of a released corner's stiffness: holds a subdomain with all corners released


class DirichletPreconditioner:
    """M on the faces of a DualOperator's dual vectors; `schur` are the S_i of its classes."""

    def __init__(self, operator):
        self.vectors = operator.vectors
        structure = operator.structure
        following = structure.numbering is not None
        inverted = _schur
        if structure.numbering is not None:
            inverted = _kept
        elif operator.modes or structure.contact.coupled.any():
            inverted = _released
        schur = [inverted(c) for c in operator.classes]
        self.blocks = BlockDiagonal(operator.classes, schur, "rows", "rows")
        self.schur = self.blocks.blocks

    def __call__(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """M residual on the face `free`, zero elsewhere."""
        vectors = self.vectors
        x, y = vectors.gather(np.where(free, residual, 0.0)), vectors.local
        x *= vectors.scaling
        self.blocks.multiply(x, y)
        y *= vectors.scaling
        result = vectors.add_up()
        result[~free] = 0.0
        return result


def _kept(c: LocalClass) -> np.ndarray:
    """`_released` once for all rows of a class: other classes' may change."""
    if c.schur is None:
        c.schur = _released(c)
    return c.schur


def _schur(c: LocalClass) -> np.ndarray:
    """(m, m) stiffness of one subdomain in its rows' displacements."""
    torn = np.diff(c.B_c.indptr) == 0
    inverse = _inverse(c.F if torn.all() else c.F[np.ix_(torn, torn)])
    if torn.all():
        return inverse
    B_c = c.B_c.toarray()[~torn]
    moved = c.A[torn] @ B_c.T  # v_b - A v_c
    forces, schur = inverse @ moved, np.empty(c.F.shape)
    schur[np.ix_(torn, torn)] = inverse
    schur[np.ix_(torn, ~torn)], schur[np.ix_(~torn, torn)] = -forces, -forces.T
    schur[np.ix_(~torn, ~torn)] = moved.T @ forces + B_c @ c.S @ B_c.T
    return schur


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of an SPD matrix; the costlier pseudo-inverse if it is nearly singular."""
    factor, info = lapack.dpotrf(matrix) if matrix.size else (matrix, 1)
    if info or lapack.dpocon(factor, np.abs(matrix).sum(axis=0).max())[0] < DEPENDENT:
        return np.linalg.pinv(matrix, hermitian=True)
    upper = np.triu(lapack.dpotri(factor)[0])
    return upper + np.triu(upper, 1).T


def _released(c: LocalClass) -> np.ndarray:
    """(m, m) the same for rows of any kind: all corner dofs that contact rows move are released.

    Its inverse is F_i + A S^-1 A' over these corners; a subdomain with no other corners is held a
    little. Rows that depend on one another here, though not with the other body's part, get the
    stiffness of an average row.
    """
    moved = np.abs(c.B_c.toarray()).max(axis=0, initial=0) > 0
    S, A = c.S[np.ix_(moved, moved)], c.A[:, moved]
    S = S + FLOOR * np.diag(c.corner_stiffness[moved])
    compliance, vectors = np.linalg.eigh(c.F + A @ np.linalg.solve(S, A.T))
    independent = compliance > DEPENDENT * compliance.max(initial=0.0)
    average = np.median(compliance[independent]) if independent.any() else 1.0
    return (vectors / np.where(independent, compliance, average)) @ vectors.T
