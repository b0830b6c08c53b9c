"""Factors of subdomains torn but at their corners, by what is left of their rims.

With S of the rim, see cholesky.py, its torn dofs o that no row acts on, those t that rows act on
and the corner dofs c in this order, and alpha > 0 added to the diagonal at c, where S alone may be
singular, q = [o t],

    L = [ L_qq       ],     L_cc L_cc' - alpha = S_cc - S_cq S_qq^-1 S_qc.
        [ L_cq  L_cc ]

So K_rr^-1 on t and what couples t and c come from the last rows of one dense factor; solutions for
every dof of t would take a pass through the whole factor each.
"""

import numpy as np
from scipy.linalg import lapack, solve_triangular

from ..errors import NoSolution
from .cholesky import SINGULAR, Interior
from .halves import mirrored


class TornFactor:
    """Factor of K_rr, the stiffness (n_r, n_r) of the torn dofs."""

    def __init__(self, interior: Interior, torn: np.ndarray, nodes: np.ndarray, together: int = 1):
        """`torn` (n_r,) are the torn dofs, t those of the `nodes` (n,), all of them of the rim.

        L_qq takes so many right-hand sides `together`, filled up with zeros: the bits of one do not
        depend on how many there are.
        """
        self._interior, self._torn, self._together = interior, torn, together
        self.seen = np.isin(torn // 2, nodes)  # (n_r,) marks those of t
        # places in L of torn dofs (n_r,), q (n_q,) and corners (n_c,)
        self._place = interior.place[torn]
        of_rim = self._place >= interior.inner
        self._unseen = torn[of_rim & ~self.seen]  # o
        self._of_q = interior.place[np.append(self._unseen, torn[self.seen])]
        self._of_c = None
        # L_qq, half a matrix in LAPACK's rectangular full packed format, and L_cq
        self._packed = self._coupling = None

    def reduced(self, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """K_rr^-1 (n_t, n_t) and K_rr^-1 K_rc (n_t, n_c) on t, and K_cc - K_cr K_rr^-1 K_rc.

        `corner` (n_c,), ascending, are all free dofs of some nodes of the rim. Raises NoSolution
        unless K_rr is positive definite. Called once, before anything is solved.
        """
        interior, n_o, n_q = self._interior, len(self._unseen), len(self._of_q)
        dofs = np.concatenate([self._unseen, self._torn[self.seen], corner])
        self._of_c = interior.place[corner]
        stiffness, added = interior.stiffness[dofs], np.zeros(len(dofs))
        added[n_q:] = stiffness[n_q:]
        L = _factor(interior.schur(dofs), stiffness, added, interior.size)
        self._packed, self._coupling = _rectangular(L[:n_q, :n_q]), L[n_q:, :n_q].copy()
        L_tt, L_ct, L_cc = L[n_o:n_q, n_o:n_q], L[n_q:, n_o:n_q], L[n_q:, n_q:]
        schur = L_cc @ L_cc.T - np.diag(added[n_q:])
        return _inverse(L_tt), _backward(L_tt, L_ct.T), (schur + schur.T) / 2

    def solve(self, right: np.ndarray) -> np.ndarray:
        """K_rr^-1 times the columns of `right` (n_r, k)."""
        if not right.size:
            return np.zeros_like(right)
        none = np.zeros((right.shape[1], len(self._coupling)))
        return self.backward(self.forward(right.T), none).T

    def forward(self, right: np.ndarray) -> np.ndarray:
        """L^-1 times rows of `right` (k, n_r), zero on the corners, in the order of L (k, n)."""
        whole = np.zeros((len(right), self._interior.size))
        whole[:, self._place] = right
        down = self._interior.columns.forward(whole)
        result, inner = np.zeros_like(down), self._interior.inner
        result[:, :inner] = down[:, :inner]
        result[:, self._of_q] = self._on_rim(down[:, self._of_q])
        return result

    def forward_of_rows(self, right: np.ndarray) -> np.ndarray:
        """`forward` of what is zero but on t: the last rows of L have it all."""
        result, on_rim = (np.zeros((len(right), n)) for n in (self._interior.size,
                                                              len(self._of_q)))
        on_rim[:, len(self._unseen) :] = right[:, self.seen]
        result[:, self._of_q] = self._on_rim(on_rim)
        return result

    def _on_rim(self, right: np.ndarray, trans: str = "N") -> np.ndarray:
        """L_qq^-1 times rows of `right` (k, n_q), or L_qq^-T."""
        result, n_q = np.empty(right.shape), right.shape[1]
        for first in range(0, len(right) if n_q else 0, self._together):
            part = right[first : first + self._together]
            filled = np.zeros((self._together, n_q))
            filled[: len(part)] = part
            solved = lapack.dtfsm(1.0, self._packed, filled.T, uplo="L", trans=trans, overwrite_b=1)
            result[first : first + self._together] = solved.T[: len(part)]
        return result

    def backward(self, forward: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """K_rr^-1 (f_r - K_rc u_c) (k, n_r) by rows of `forward` of f_r and u_c, `corner` (k, n_c).

        K_rc comes in by the rows of L at the corners.
        """
        whole = forward.copy()
        # one by one: bits do not depend on how many there are
        on_rim = forward[:, self._of_q] - np.array([u @ self._coupling for u in corner])
        whole[:, self._of_q] = self._on_rim(on_rim, "T")
        whole[:, self._of_c] = corner
        return self._interior.columns.backward(whole)[:, self._place]


def _rectangular(L: np.ndarray) -> np.ndarray | None:
    """The lower triangle (n, n) in LAPACK's rectangular full packed format; None without rows."""
    return lapack.dtrttf(L, uplo="L")[0] if len(L) else None


def _factor(S: np.ndarray, stiffness: np.ndarray, added: np.ndarray, eliminated: int) -> np.ndarray:
    """Lower triangular factor (n, n) of S, which is used up, with `added` (n,) on the diagonal.

    `stiffness` (n,) is the diagonal of K there, and `eliminated` the number of all dofs of K, which
    rounding grows with. Raises NoSolution.
    """
    if not len(S):
        return S
    S[np.diag_indices_from(S)] += added
    L, failed = lapack.dpotrf(S.T, lower=1, overwrite_a=1)
    # a pivot is what is left of a dof's stiffness when those before it give way
    least = eliminated * np.finfo(float).eps * (stiffness + added)
    if failed or not np.all(np.diag(L) ** 2 > least):
        raise NoSolution(f"a subdomain's {SINGULAR}")
    return L


def _backward(L: np.ndarray, right: np.ndarray) -> np.ndarray:
    """L^-T times `right` (n, k), L (n, n) lower triangular."""
    if not right.size:
        return np.zeros(right.shape)
    return solve_triangular(L, right, lower=True, trans="T", check_finite=False)


def _inverse(L: np.ndarray) -> np.ndarray:
    """(L L')^-1 (n, n), symmetric to the last bit."""
    if not L.size:
        return np.empty((0, 0))
    return mirrored(lapack.dpotri(L, lower=1)[0])
