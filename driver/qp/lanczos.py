"""Upper bound of the norm of a symmetric operator by Lanczos' method, from its products alone."""

import numpy as np

EPS = np.finfo(float).eps
LANCZOS_RISK = 1e-3  # probability with which the bound may fall short of the norm


def _lanczos(A, v, dot, steps):
    """Lanczos tridiagonal matrix from v (n,): diagonal (k), off-diagonal (k), invariant or not.

    The last off-diagonal entry belongs to the residual.  Without reorthogonalisation: lost
    orthogonality only repeats Ritz values, which does not disturb the largest one.
    """
    v_old, beta, diagonal, off = np.zeros_like(v), 0.0, [], []
    for _ in range(steps):
        w = A(v) - beta * v_old
        diagonal.append(dot(v, w))
        w = w - diagonal[-1] * v
        with np.errstate(over="ignore"):
            beta = np.sqrt(dot(w, w))
        if np.isinf(beta):
            raise OverflowError("squares of the values of A exceed the largest number")
        if not np.isfinite(beta):
            raise ValueError("A returned values that are not finite")
        off.append(beta)
        if beta <= 10 * EPS * max(np.abs(diagonal).max(), max(off)):
            return diagonal, off, True
        v_old, v = v, w / beta
    return diagonal, off, False


def norm_bound(A, n, *, dot=np.dot, steps=15, seed=0, start=None):
    """Upper bound of ||A|| by Lanczos: (bound, calls of A).

    n is the local length.  The start vector is random from `seed`, or `start` (n,), the rank's part
    of one.  After k steps theta + |beta_k s_k|, the Ritz value largest in modulus plus its residual
    (s_k: last component of its eigenvector), proves an eigenvalue nearby but not that it is the
    last one; on evenly spread spectra it falls short by a few per cent.  The bound is therefore
    also at least theta / (1 - eps) with the relative error eps that a start vector uniform on the
    sphere of R^N exceeds with probability LANCZOS_RISK at most, for any SPSD matrix:

        LANCZOS_RISK = 1.648 sqrt(N) exp(-sqrt(eps) (2k - 1))

    (J. Kuczynski, H. Wozniakowski, SIAM J. Matrix Anal. Appl. 13 (1992) 1094-1122); eps is not
    taken above 1/2.  Breakdown (beta_k within rounding of zero) leaves an invariant subspace: theta
    is exact and returned with its residual only.  Raises OverflowError where squares of values of A
    overflow.
    """
    v = np.random.default_rng(seed).standard_normal(n) if start is None else np.array(start, float)
    length = np.sqrt(dot(v, v))
    if steps < 1 or not (np.isfinite(length) and length > 0):
        raise ValueError("Lanczos needs a step and a finite start vector that is not zero")
    diagonal, off, invariant = _lanczos(A, v / length, dot, steps)
    T = np.diag(diagonal) + np.diag(off[:-1], 1) + np.diag(off[:-1], -1)
    ritz, vectors = np.linalg.eigh(T)
    k = int(np.argmax(np.abs(ritz)))
    theta, residual = abs(ritz[k]), abs(off[-1] * vectors[-1, k])
    if invariant:
        return float(theta + residual), len(diagonal)
    ones = np.ones_like(v)
    size = dot(ones, ones)
    root = np.log(1.648 * np.sqrt(size) / LANCZOS_RISK) / (2 * len(diagonal) - 1)
    return float(max(theta + residual, theta / (1 - min(root**2, 0.5)))), len(diagonal)
