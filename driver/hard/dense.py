"""Dense, slow and certain solvers that tests and hard cases compare with; each checks itself."""

import numpy as np


class OracleFailure(AssertionError):
    """The oracle's own answer does not pass its check: it says nothing about another answer."""


def require(condition, what: str) -> None:
    """Raises OracleFailure if the `condition` does not hold."""
    if not condition:
        raise OracleFailure(f"the oracle's answer is not certain: {what}")


def box_qp(A, b, lower, upper):
    """Solution x (n,) of min 1/2 x'Ax - b'x, lower <= x <= upper, for A (n, n) SPD, n tiny.

    Primal active set: on the free set F move towards the minimiser of the face; if bounds are in
    the way, stop at the nearest and fix every component that has arrived; at the minimiser of a
    face release the one fixed component whose multiplier has the wrong sign most.

    Terminates: right after a release all free components but the released one are strictly
    inside, and the released one moves inwards because (A_FF^-1)_ii > 0; so the step is positive
    and f decreases strictly between minimisers of faces.  No face comes twice, there are 3^n.

    Works in the variables sqrt(A_ii) x_i, so that units of the components do not matter.
    OracleFailure if the KKT residual is more than rounding.
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
        raise OracleFailure("active set did not terminate")
    x = np.clip(np.where(y == low, lower, np.where(y == up, upper, y / scale)), lower, upper)
    assert_kkt(A, b, lower, upper, x, scale)
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


def assert_kkt(A, b, lower, upper, x, scale):
    """Feasible, and stationary componentwise in the scaled variables to rounding."""
    require(np.all(lower <= x) and np.all(x <= upper), "outside its bounds")
    g = A @ x - b
    g = np.where(x == lower, np.minimum(g, 0), g)
    g = np.where(x == upper, np.where(x == lower, 0, np.maximum(A @ x - b, 0)), g)
    size = ((np.abs(A) @ np.abs(x) + np.abs(b)) / scale).max()
    require(np.all(np.abs(g) / scale <= 1e-11 * size),
             f"gradient of {(np.abs(g) / scale).max():.1e} remains")


def warm_box_qp(A, b, lower, upper, guess):
    """box_qp with a guessed solution: tries primal-dual active set steps, falls back on box_qp.

    The active set step may cycle, so its answer is returned only when it passes the KKT check.
    """
    at = np.where(guess <= lower, -1, np.where(guess >= upper, 1, 0))
    at[lower == upper] = -1
    scale = np.sqrt(np.diag(A))
    for _ in range(40):
        x = np.where(at < 0, lower, np.where(at > 0, upper, 0.0))
        F, rest = np.flatnonzero(at == 0), np.flatnonzero(at)
        x[F] = np.linalg.solve(A[np.ix_(F, F)], b[F] - A[np.ix_(F, rest)] @ x[rest])
        g = A @ x - b
        new = np.where((at == 0) & (x < lower), -1, np.where((at == 0) & (x > upper), 1, at))
        new[((at < 0) & (g < 0)) | ((at > 0) & (g > 0))] = 0
        new[lower == upper] = -1
        if np.array_equal(new, at):
            assert_kkt(A, b, lower, upper, x, scale)
            return x
        at = new
    return box_qp(A, b, lower, upper)


def coulomb_step(C, d, friction, start):
    """Multipliers (normal, then tangential) of one time step with local Coulomb friction.

    Successive approximations of the friction bound to rounding around dense QPs; checks the
    conditions of contact and friction of the answer. OracleFailure if the iteration does not
    settle.
    """
    n = len(friction)
    x, rounding = start, max(1e-13, np.finfo(float).eps * np.linalg.cond(C))  # of dense solves
    for _ in range(300):
        g = friction * x[:n]
        new = warm_box_qp(C, d, np.concatenate([np.zeros(n), -g]),
                          np.concatenate([np.full(n, np.inf), g]), x)
        change = np.abs(new[:n] - x[:n]).max()
        x = new
        if change <= rounding * np.abs(x[:n]).max():
            break
    else:
        raise OracleFailure("the oracle's fixed point does not settle")
    _assert_coulomb(C, d, friction, x, max(1e-10, 10 * rounding))
    return x


def _assert_coulomb(C, d, friction, x, slack):
    """Signorini's and Coulomb's conditions at every node, to the relative rounding `slack`."""
    n, move = len(friction), d - C @ x
    size, force = slack * np.abs(d).max(), np.abs(x).max()
    bound = friction * x[:n]
    require(x[:n].min() >= 0 and move[:n].max() <= size, "penetration or tension")
    require(np.all(np.abs(move[:n])[x[:n] > 0] <= size), "pressure at a distance")
    require(np.all(np.abs(x[n:]) <= bound + slack * force), "friction above its bound")
    sticks = np.abs(x[n:]) < bound - slack * force
    require(np.all(np.abs(move[n:])[sticks] <= size), "slip below the bound")
    require(np.all(x[n:] * move[n:] >= -size * force), "friction along the slip")


def coulomb_history(body, amplitudes):
    """Dict of (steps, n_c): u_n, u_t, sigma_n, sigma_t of the contact nodes.

    `amplitudes` (steps + 1, patterns). Stick refers to the tangential displacement of the step
    before.
    """
    C, B, n = body.compliance(), body.B, len(body.gid)
    unit = np.array([B @ body.solve(w) for w in np.eye(len(body.loads))])
    history = {name: [] for name in ("u_n", "u_t", "sigma_n", "sigma_t")}
    x, u_t = np.zeros(2 * n), np.zeros(n)
    for weights in amplitudes[1:]:
        loaded = weights @ unit
        x = coulomb_step(C, loaded - np.concatenate([body.gap, u_t]), body.friction, x)
        moved = loaded - C @ x
        u_t = moved[n:]
        for name, value in zip(history,
                               (moved[:n], u_t, -x[:n] / body.weight, -x[n:] / body.weight)):
            history[name].append(value)
    return {name: np.array(value) for name, value in history.items()}
