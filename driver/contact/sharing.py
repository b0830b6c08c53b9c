"""How the force on a vertex in a corner is shared between the two sides that it touches."""

from itertools import combinations, product

import numpy as np

from ..vectors import turned_left

SLIGHT = 1e-9  # part of the force by which a bound may be missed: rounding
PARALLEL = 1e-12  # determinant of lines of unit length that do not meet


def alike(force: np.ndarray, normals: np.ndarray, F: np.ndarray, c: np.ndarray,
          bilateral: np.ndarray, beside: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Forces of two nodes at one vertex as `least_friction` has them, but nearest to others.

    `beside` (2, 2) are the pressure and the friction force of either node, p_i and q_i, if the
    tractions of the next node on its side were its own: what one stress leaves on both sides is
    what comes out. For given signs of p a convex quadratic program in q, whose solution is its
    minimum in the plane, on one of the lines of the bounds, or where two of them meet.
    """
    own, turn, slight = _resolved(force, normals)
    (P, Q), best, least = beside.T, None, np.inf
    inverse = np.linalg.inv(turn.T @ turn + np.eye(2))
    middle = inverse @ (turn.T @ (own - P) + Q)
    for signs in product(*([1.0, -1.0] if pulls else [1.0] for pulls in bilateral)):
        on_lines = [middle + inverse @ a * ((b - a @ middle) / (a @ inverse @ a))
                    for a, b in _lines(own, turn, F * signs, c)]
        for q in [middle, *on_lines, *_crossings(own, turn, F * signs, c)]:
            p = own - turn @ q
            away = np.linalg.norm([p - P, q - Q])
            if _fits(p, q, signs, F, c, slight) and away < least - slight:
                best, least = _within(p, q, signs, F, c, slight), away
    return best


def least_friction(force: np.ndarray, normals: np.ndarray, F: np.ndarray, c: np.ndarray,
                   bilateral: np.ndarray,
                   before=(0.0, 0.0)) -> tuple[np.ndarray, np.ndarray] | None:
    """Pressures p and friction forces q (2,) of two nodes at one vertex that make up `force` (2,).

    With `normals` (2, 2), independent, and tangents t = (-n_y, n_x)

        sum_i p_i n_i + q_i t_i = force,   |q_i| <= F_i |p_i| + c_i,   p_i >= 0 if not `bilateral`,

    with the least |q_1 - b_1| + |q_2 - b_2| from friction forces b (2,) that were there `before`;
    None if nothing does. For given signs of p this is a linear program in q, whose solution is
    where two of its lines meet: those of the bounds, p_i = 0 and q_i = b_i. Ties are for the first
    of them.
    """
    own, turn, slight = _resolved(force, normals)
    best, least = None, np.inf
    for signs in product(*([1.0, -1.0] if pulls else [1.0] for pulls in bilateral)):
        for q in _crossings(own, turn, F * signs, c, before):
            p, rub = own - turn @ q, np.abs(q - before).sum()
            if _fits(p, q, signs, F, c, slight) and rub < least - slight:
                best, least = _within(p, q, signs, F, c, slight), rub
    return best


def _resolved(force, normals) -> tuple[np.ndarray, np.ndarray, float]:
    """own (2,), turn (2, 2) with p = own - turn q, and the force that rounding may leave."""
    tangents = turned_left(normals)
    return (np.linalg.solve(normals.T, force), np.linalg.solve(normals.T, tangents.T),
            SLIGHT * np.linalg.norm(force))


def _fits(p, q, signs, F, c, slight: float) -> bool:
    """Whether forces have their `signs` and obey the law of friction."""
    return bool((p * signs >= -slight).all()
                and (np.abs(q) <= F * np.abs(p) + c + slight).all())


def _within(p, q, signs, F, c, slight: float) -> tuple[np.ndarray, np.ndarray]:
    """The same without what rounding left: friction forces at their bounds are the bounds."""
    p = np.where(p * signs > 0, p, 0.0)
    bound = F * np.abs(p) + c
    return p, np.where(np.abs(q) > bound - slight, np.sign(q) * bound, q)


def _lines(own, turn, F, c, before=(0.0, 0.0)) -> list[tuple[np.ndarray, float]]:
    """(a, b) of the lines a . q = b: q_i = before_i, p_i = 0, q_i = -+(F_i p_i + c_i)."""
    lines = []
    for i, unit in enumerate(np.eye(2)):
        lines += [(unit, before[i]), (turn[i], own[i])]
        lines += [(unit + way * F[i] * turn[i], way * (F[i] * own[i] + c[i])) for way in (1, -1)]
    return lines


def _crossings(own, turn, F, c, before=(0.0, 0.0)) -> list[np.ndarray]:
    """Points q (2,) where two of the lines meet."""
    points = []
    for (a, b), (other, value) in combinations(_lines(own, turn, F, c, before), 2):
        matrix = np.array([a, other])
        sizes = np.linalg.norm(matrix, axis=1)
        if abs(np.linalg.det(matrix)) > PARALLEL * sizes.prod():
            points.append(np.linalg.solve(matrix, [b, value]))
    return points
