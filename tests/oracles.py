"""Dense, slow and certain solvers that the tests compare with.  Each checks its own answer."""

import numpy as np


def box_qp(A, b, lower, upper):
    """Solution x (n,) of min 1/2 x'Ax - b'x, lower <= x <= upper, for A (n, n) SPD, n tiny.

    Primal active set: on the free set F move towards the minimiser of the face; if bounds are in
    the way, stop at the nearest and fix every component that has arrived; at the minimiser of a
    face release the one fixed component whose multiplier has the wrong sign most.

    Terminates: right after a release all free components but the released one are strictly
    inside, and the released one moves inwards because (A_FF^-1)_ii > 0; so the step is positive
    and f decreases strictly between minimisers of faces.  No face comes twice, there are 3^n.

    Works in the variables sqrt(A_ii) x_i, so that units of the components do not matter.
    AssertionError if the KKT residual is more than rounding.
    """
    scale = np.sqrt(np.diag(A))
    S, c = A / np.outer(scale, scale), b / scale
    low, up = lower * scale, upper * scale
    y = np.clip(np.zeros_like(c), low, up)
    free = (y > low) & (y < up)
    movable = low < up
    tiny = 1e-13 * len(c)
    for _ in range(50 * 3 ** min(len(c), 8)):
        y, free, arrived = _towards_face_minimiser(S, c, low, up, y, free)
        if not arrived:
            continue
        g = S @ y - c
        size = tiny * (np.abs(S) @ np.abs(y) + np.abs(c)).max()
        wrong = np.where(y == low, -g, g) * (~free & movable)
        worst = int(np.argmax(wrong))
        if wrong[worst] <= size:
            break
        free[worst] = True
    else:
        raise AssertionError("active set did not terminate")
    x = np.clip(np.where(y == low, lower, np.where(y == up, upper, y / scale)), lower, upper)
    _assert_kkt(A, b, lower, upper, x, scale)
    return x


def _towards_face_minimiser(S, c, low, up, y, free):
    """One step in the face: (new y, new free set, whether the minimiser was reached)."""
    F = np.flatnonzero(free)
    d = np.zeros_like(y)
    if F.size:
        target = np.linalg.solve(S[np.ix_(F, F)], c[F] - S[np.ix_(F, ~free)] @ y[~free])
        d[F] = target - y[F]
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(d > 0, (up - y) / d, np.where(d < 0, (low - y) / d, np.inf))
    step = min(1.0, room.min(initial=np.inf))
    met = free & (room <= step) if step < 1.0 else np.zeros_like(free)
    y = np.clip(y + step * d, low, up)
    y[met] = np.where(d > 0, up, low)[met]
    return y, free & ~met, not met.any()


def _assert_kkt(A, b, lower, upper, x, scale):
    """Feasible, and stationary componentwise in the scaled variables to rounding."""
    assert np.all(lower <= x) and np.all(x <= upper)
    g = A @ x - b
    g = np.where(x == lower, np.minimum(g, 0), g)
    g = np.where(x == upper, np.where(x == lower, 0, np.maximum(A @ x - b, 0)), g)
    size = ((np.abs(A) @ np.abs(x) + np.abs(b)) / scale).max()
    assert np.all(np.abs(g) / scale <= 1e-11 * size), (np.abs(g) / scale / size).max()
