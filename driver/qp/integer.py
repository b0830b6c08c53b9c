"""A solution of the dense contact problem by one mixed-integer program.

Complementarity as alternatives that binary variables choose (J. Fortuny-Amat, B. McCarl, J. Oper.
Res. Soc. 32 (1981) 783-792): a node presses or not, pulls or not, its friction slides forth, back
or not at all. Alternatives need limits of forces and ways, so that no answer is no proof; within
them cutting planes and the search's own heuristics lead to states that Newton's method does not
come near: many of both signs where contact pulls and friction is large.
"""

import numpy as np
from scipy.sparse import csr_matrix

from ..environment import PLAIN_PROGRAM, silenced
from .branching import MOST_NODES
from .complementarity import BRIEFLY, newton
from .coulomb import CoulombProblem
from .scaled import Scaled

LIMITS = (5.0, 50.0)  # of forces and ways, times those that the load makes
NODES = 200  # of the tree of each program


def solution_within_limits(problem: CoulombProblem) -> np.ndarray | None:
    """A solution z (n + m + k,) if one of the programs comes to it; deterministic.

    None for more than MOST_NODES nodes.
    """
    if problem.n > MOST_NODES:
        return None
    scaled = Scaled(problem)
    for limit in LIMITS:
        x = _answer(scaled, limit)
        if x is not None:
            z = newton(problem, scaled.exact(x), BRIEFLY)
            if z is not None:
                return z
    return None


def _answer(scaled: Scaled, limit: float) -> np.ndarray | None:
    """x (n + m + k,) of states with forces and ways up to `limit`, None if none is known.

    Unknowns are x, sizes of pressing and of pulling forces (n,) each, and the binaries: presses
    (n,), slides forth (m,), slides back (m,).
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    problem, inf = scaled.problem, np.inf
    n, m, k = problem.n, problem.m, scaled.k
    pulls, zero = problem.bilateral, np.zeros
    moved, given = scaled.rows[: n + m].toarray(), scaled.given
    way = limit * np.maximum(1.0, np.maximum(np.abs(moved).max(axis=1), np.abs(given)))
    cone, unit, along = scaled.cone_matrix, np.eye(n), np.eye(m)
    first = np.hstack([unit, zero((n, m + k))])
    rub = np.hstack([zero((m, n)), along, zero((m, k))])
    big = 2 * (limit * cone.sum(axis=1) + scaled.offset)
    over, slip = (moved[:n], given[:n]), (moved[n:], given[n:])
    none, apart = zero((n, n)), zero((n, 2 * m))
    still, beside = zero((m, 2 * n)), zero((m, n))
    blocks = [  # rows, lower and upper limits
        (np.hstack([first, -unit, unit, none, apart]), zero(n), zero(n)),
        (np.hstack([over[0], none, none, none, apart]),
         np.where(pulls, -over[1], -inf), -over[1]),
        (np.hstack([over[0], none, none, -np.diag(way[:n]), apart]),
         np.where(pulls, -inf, -over[1] - way[:n]), np.full(n, inf)),
        (np.hstack([zero((n, n + m + k)), unit, none, -limit * unit, apart]),
         np.full(n, -inf), zero(n)),
        (np.hstack([zero((n, n + m + k)), none, unit, limit * unit, apart]),
         np.full(n, -inf), np.where(pulls, limit, inf)),
        (np.hstack([slip[0], still, beside, -np.diag(way[n:]), 0 * along]),
         np.full(m, -inf), -slip[1]),
        (np.hstack([slip[0], still, beside, 0 * along, np.diag(way[n:])]),
         -slip[1], np.full(m, inf)),
        (np.hstack([zero((m, n + m + k)), still, beside, along, along]),
         np.full(m, -inf), np.ones(m)),
        (np.hstack([scaled.rows[n + 3 * m :].toarray()[:, : n + m + k], zero((k, 3 * n + 2 * m))]),
         scaled.work, scaled.work)]
    for sign, column in ((1.0, 0), (-1.0, 1)):
        slides = np.hstack([(column == which) * np.diag(big) for which in range(2)])
        blocks += [
            (np.hstack([sign * rub, -cone, -cone, beside, 0 * slides]),
             np.full(m, -inf), scaled.offset),
            (np.hstack([-sign * rub, cone, cone, beside, slides]),
             np.full(m, -inf), big - scaled.offset)]
    rows, low, high = (np.concatenate(part) for part in zip(*blocks))
    size = n + m + k
    most = np.concatenate([np.full(size, inf), np.full(n, limit), np.where(pulls, limit, 0.0),
                           np.ones(n + 2 * m)])
    least = np.append(np.full(size, -inf), zero(len(most) - size))
    with silenced():
        answer = milp(zero(len(most)), bounds=Bounds(least, most),
                      integrality=np.repeat([0, 1], [size + 2 * n, n + 2 * m]),
                      constraints=LinearConstraint(csr_matrix(rows), low, high),
                      options={**PLAIN_PROGRAM, "node_limit": NODES})
    return None if answer.x is None else answer.x[:size]
