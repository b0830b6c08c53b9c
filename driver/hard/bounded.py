"""Whether a step in which all contact is bilateral has a solution, by the friction that it allows.

Contact that pulls keeps F |lambda_n| from being convex, and bodies that press and pull against one
another rub without a load: no linear program over all forces excludes that. But no distance changes
there. With C the compliance, R the rigid motions and L their loads

    C_nn lambda_n - R_n beta = d_n - C_nt lambda_t,      R_n' lambda_n = L - R_t' lambda_t

make lambda_n = a + B lambda_t whatever slides, and |lambda_t| <= c + F |lambda_n| then is
|lambda_t| <= c + F |a| + F |B| |lambda_t|. Where the spectral radius of F |B| is below one, this
bounds friction by (1 - F |B|)^-1 (c + F |a|) >= 0 (A. Berman, R. Plemmons, Nonnegative Matrices in
the Mathematical Sciences, SIAM 1994, chapter 6), and with it |lambda_n - a|: most signs of lambda_n
are known then, and the friction cone of a known sign is convex. What no such friction balances,
motions that lambda_n does not feel among it, has no solution in any states.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import linprog

from ..environment import PLAIN_PROGRAM, silenced
from .states import States

DEPENDS, INDEPENDENT = 1e-12, 1e-6  # parts of the largest singular value: zero, and surely not
SLACK = 1e-9  # of the largest normal force, for rounding of its bounds


@dataclass(frozen=True)
class _Bounds:
    """Normal forces `a` + `B` friction (n,), (n, n), and friction of at most `friction` (n,).

    `along` (q, n) friction = `given` (q,) is left of the equations.
    """

    a: np.ndarray
    B: np.ndarray
    friction: np.ndarray
    along: np.ndarray
    given: np.ndarray


def unbalanced_by_friction(states: States) -> tuple[float, States]:
    """Share of the forces that no friction within its bounds balances, 0 without an argument.

    And the same step with normal forces kept to what such friction makes of them.
    """
    bounds = _bounds(states)
    if bounds is None:
        return 0.0, states
    share = _imbalance(states, bounds) if len(bounds.given) else 0.0
    return share, _limited(states, bounds)


def _limited(states: States, bounds: _Bounds) -> States:
    """The step within the normal forces that `bounds` leave."""
    far = np.abs(bounds.B) @ bounds.friction
    room = SLACK * (np.abs(bounds.a) + far).max()
    return replace(states, reach=bounds.a + np.array([[-1.0], [1.0]]) * (far + room))


def _bounds(states: States) -> _Bounds | None:
    """Bounds of friction, or None without an argument."""
    n, m = len(states.room), len(states.load)
    if not states.pulls.all() or np.isinf(states.room).any():
        return None
    normal = states.movement[:n]
    matrix = np.block([[normal[:, :n], normal[:, 2 * n :]],
                       [states.balance[:, :n], np.zeros((m, m))]])
    along = np.vstack([normal[:, n : 2 * n], states.balance[:, n:]])
    given = np.append(states.room, -states.load)
    left, sizes, right = np.linalg.svd(matrix)
    held = sizes > DEPENDS * sizes[0]
    if (sizes[held] < INDEPENDENT * sizes[0]).any():
        return None
    inverse = (right[held].T / sizes[held]) @ left[:, held].T
    if np.abs(right[~held][:, :n]).max(initial=0.0) > INDEPENDENT:  # forces that nothing feels
        return None
    a, B = (inverse @ given)[:n], -(inverse @ along)[:n]
    grows = states.most[:, None] * np.abs(B)
    if np.abs(np.linalg.eigvals(grows)).max() >= 1:
        return None
    most = np.linalg.solve(np.eye(n) - grows, states.most * np.abs(a) + states.offset)
    return _Bounds(a, B, most, left[:, ~held].T @ along, left[:, ~held].T @ given)


def _imbalance(states: States, bounds: _Bounds) -> float:
    """Least largest part of `along` times friction less `given`, over their sizes."""
    a, B, bound, along, given = (getattr(bounds, of.name) for of in fields(bounds))
    n, share = len(a), np.ones((len(given), 1))
    sign = np.where(np.abs(a) > np.abs(B) @ bound, np.sign(a), 0.0)
    known = np.flatnonzero(sign)
    cone, room = (sign * states.most)[:, None] * B, sign * states.most * a + states.offset
    rows = [np.hstack([way * np.eye(n)[known] - cone[known], np.zeros((len(known), 1))])
            for way in (1.0, -1.0)]
    with silenced():
        answer = linprog(
            np.append(np.zeros(n), 1.0),
            A_ub=np.vstack([*rows, np.hstack([along, -share]), np.hstack([-along, -share])]),
            b_ub=np.concatenate([room[known], room[known], given, -given]),
            bounds=[*((-most, most) for most in bound), (0.0, None)],
            method="highs", options=PLAIN_PROGRAM)
    size = np.max(np.abs(given) + np.abs(along) @ bound, initial=0.0)
    return float(answer.fun / size) if answer.status == 0 and size > 0 else 0.0
