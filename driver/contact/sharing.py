"""How the force on a vertex in a corner is shared between the two sides that it touches."""

from itertools import combinations, product

import numpy as np

SLIGHT = 1e-9  # part of the force by which a bound may be missed: rounding
PARALLEL = 1e-12  # determinant of lines of unit length that do not meet


def least_friction(force: np.ndarray, normals: np.ndarray, F: np.ndarray, c: np.ndarray,
                   bilateral: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Pressures p and friction forces q (2,) of two nodes at one vertex that make up `force` (2,).

    With `normals` (2, 2), independent, and tangents t = (-n_y, n_x)

        sum_i p_i n_i + q_i t_i = force,   |q_i| <= F_i |p_i| + c_i,   p_i >= 0 if not `bilateral`,

    with the least |q_1| + |q_2|; None if nothing does. For given signs of p this is a linear
    program in q, whose solution is where two of its lines meet: those of the bounds, p_i = 0 and
    q_i = 0. Ties are for the first of them.
    """
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    own = np.linalg.solve(normals.T, force)  # p = own - turn q
    turn = np.linalg.solve(normals.T, tangents.T)
    slight, best, least = SLIGHT * np.linalg.norm(force), None, np.inf
    for signs in product(*([1.0, -1.0] if pulls else [1.0] for pulls in bilateral)):
        for q in _crossings(own, turn, F * signs, c):
            p, rub = own - turn @ q, np.abs(q).sum()
            fits = (p * signs >= -slight).all() and (np.abs(q) <= F * np.abs(p) + c + slight).all()
            if fits and rub < least - slight:
                p = np.where(p * signs > 0, p, 0.0)
                best, least = (p, np.clip(q, -F * np.abs(p) - c, F * np.abs(p) + c)), rub
    return best


def _crossings(own, turn, F, c) -> list[np.ndarray]:
    """Points q (2,) where two lines meet: q_i = 0, p_i = 0, q_i = -+(F_i p_i + c_i)."""
    lines = []  # a . q = b
    for i, unit in enumerate(np.eye(2)):
        lines += [(unit, 0.0), (turn[i], own[i])]
        lines += [(unit + way * F[i] * turn[i], way * (F[i] * own[i] + c[i])) for way in (1, -1)]
    points = []
    for (a, b), (other, value) in combinations(lines, 2):
        matrix = np.array([a, other])
        sizes = np.linalg.norm(matrix, axis=1)
        if abs(np.linalg.det(matrix)) > PARALLEL * sizes.prod():
            points.append(np.linalg.solve(matrix, [b, value]))
    return points
