"""The Dirichlet preconditioner of FETI-DP, M = sum_i B_D,i S_i B_D,i' restricted to a face.

S_i is the stiffness of the subdomain in the displacements of its rows, the (pseudo) inverse of the
explicit local F_i; corners that carry contact rows of their own are released: with v_b = B_r u, v_c
= B_c' x the energy is that of v_b - A v_c plus that of v_c in S. The weights in B_D are shares of
the stiffness (Klawonn, Rheinbach).

Where rows yield by themselves, F has a diagonal D besides (surfaces that are rough or wear). Each
subdomain of a row takes its share D_i of it, by its weight in B_D: S_i gives way to

    (S_i^-1 + D_i)^-1 = S_i - S_i (D_i^-1 + S_i)^-1 S_i    on the rows that yield.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack

from .blocks import BlockDiagonal, by_half, whole
from .halves import Half, mirrored
from .reduction import LocalClass

DEPENDENT = 1e-9  # relative eigenvalues of a local F: rows below depend on one another
YIELDS = 1e-3  # of a row's own compliance, below which what it yields makes no difference
FLOOR = 0.01  # of a released corner's stiffness: holds a subdomain with all corners released


class DirichletPreconditioner:
    """M on the faces of a DualOperator's dual vectors; `schur` are the S_i of its classes, by half
    where they are kept so.
    """

    def __init__(self, operator):
        self.vectors, self.classes = operator.vectors, operator.classes
        structure = operator.structure
        inverted = _schur
        if structure.numbering is not None:
            inverted = _kept
        elif operator.modes or structure.contact.coupled.any():
            inverted = _released
        schur = [by_half(inverted(c), c.shared) for c in operator.classes]
        self.blocks = BlockDiagonal(operator.classes, schur, "rows", "rows")
        self.schur = self.blocks.blocks
        self.softened: dict[tuple[int, int], _Softened] = {}  # by class and member

    def soften(self, softness: np.ndarray) -> None:
        """Take up a diagonal (owned,) of F, in the place of the one before; collective."""
        vectors, self.softened = self.vectors, {}
        share = np.abs(vectors.scaling)  # of a row, which sum up to its own, above zero
        own = share / vectors.gather(vectors.assemble(share)) * vectors.gather(softness)
        for number, (c, kept) in enumerate(zip(self.classes, self.schur)):
            for k, _ in enumerate(c.members):
                rows = slice(c.rows.start + k * len(kept), c.rows.start + (k + 1) * len(kept))
                if not own[rows].any():
                    continue
                S = whole(kept)
                here = np.flatnonzero(own[rows] * np.diag(S) > YIELDS)
                if len(here):
                    self.softened[number, k] = _Softened(S, rows, here, own[rows][here])

    def __call__(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """M residual on the face `free`, zero elsewhere."""
        vectors = self.vectors
        x, y = vectors.gather(np.where(free, residual, 0.0)), vectors.local
        x *= vectors.scaling
        self.blocks.multiply(x, y)
        for member in self.softened.values():
            y[member.rows] -= member.less(y[member.rows])
        y *= vectors.scaling
        result = vectors.add_up()
        result[~free] = 0.0
        return result


class _Softened:
    """What a subdomain with stiffness S (m, m) of its `rows` loses where rows `here` yield."""

    def __init__(self, S: np.ndarray, rows: slice, here: np.ndarray, softness: np.ndarray):
        self.rows, self.here, self.S = rows, here, np.ascontiguousarray(S[:, here])
        self._factor = cho_factor(S[np.ix_(here, here)] + np.diag(1.0 / softness),
                                  check_finite=False)

    def less(self, forces: np.ndarray) -> np.ndarray:
        """(m,) S (D^-1 + S)^-1 `forces`, which are S times displacements."""
        return self.S @ cho_solve(self._factor, forces[self.here], check_finite=False)


def _kept(c: LocalClass) -> np.ndarray | Half:
    """`_released` once for all rows of a class: other classes' may change."""
    if c.schur is None:
        c.schur = by_half(_released(c), c.shared)
    return c.schur


def _schur(c: LocalClass) -> np.ndarray:
    """(m, m) stiffness of one subdomain in its rows' displacements."""
    torn, F = np.diff(c.B_c.indptr) == 0, c.F
    inverse = _inverse(F if torn.all() else F[np.ix_(torn, torn)])
    if torn.all():
        return inverse
    B_c = c.B_c.toarray()[~torn]
    moved = c.A[torn] @ B_c.T  # v_b - A v_c
    forces, schur = inverse @ moved, np.empty(F.shape)
    schur[np.ix_(torn, torn)] = inverse
    schur[np.ix_(torn, ~torn)], schur[np.ix_(~torn, torn)] = -forces, -forces.T
    schur[np.ix_(~torn, ~torn)] = moved.T @ forces + B_c @ c.S @ B_c.T
    return schur


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of an SPD matrix; the costlier pseudo-inverse if it is nearly singular."""
    factor, info = lapack.dpotrf(matrix) if matrix.size else (matrix, 1)
    if info or lapack.dpocon(factor, np.abs(matrix).sum(axis=0).max())[0] < DEPENDENT:
        return np.linalg.pinv(matrix, hermitian=True)
    return mirrored(lapack.dpotri(factor)[0].T)


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
