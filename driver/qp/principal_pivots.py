"""Contact under given friction bounds: forces within bounds that minimize a convex energy.

Of such a problem Newton's method changes all rows at once that the present states leave out of
their bounds or moving the wrong way, and may come back to the same states for ever: a body that
rocks opens where it has closed. Where ten steps in a row leave no fewer of these rows than any
before, one row alone changes, the last of them, until there are fewer. Single changes end in the
solution after finitely many steps (K. Murty, Linear Algebra Appl. 7 (1974) 65-108), changes of all
are what takes few, and both together do as a rule (J. Judice, F. Pires, Comput. Oper. Res. 21
(1994) 587-596).
"""

import numpy as np

from .coulomb import BACKWARD, FORWARD, OPEN, STICK, CoulombProblem
from .nearby import nearly_in

TRIES = 10  # changes of all rows that need not leave fewer
MOST = 400  # changes; those of a rocking body of 180 nodes took 50


def solution_within(problem: CoulombProblem, start: np.ndarray) -> np.ndarray | None:
    """z of a `problem` whose friction bounds are given, from the states of `start` z.

    None after MOST changes of states, or where a system is singular, as that of bodies without
    support may be.
    """
    rubs = np.zeros(problem.m, bool) if problem.offset is None else problem.offset > 0
    states, sign = problem.states(start), np.ones(problem.n)
    fewest, tries = problem.rows + 1, TRIES
    for _ in range(MOST):
        z = nearly_in(problem, states, sign)
        if z is None:
            return None
        wanted = problem.states(z)
        rows = np.flatnonzero(_unlike(problem, states, wanted, rubs))
        if not len(rows) or problem.solves(z):
            exact = problem.solution_in(states, sign)
            return exact if problem.solves(exact) else None
        tries = TRIES if len(rows) < fewest else tries - 1
        fewest = min(fewest, len(rows))
        states = wanted if tries >= 0 else _changed(problem, states, wanted, rows[-1], rubs)
    return None


def _unlike(problem: CoulombProblem, states: np.ndarray, wanted: np.ndarray,
            rubs: np.ndarray) -> np.ndarray:
    """(n + m,) rows in which states differ; `rubs` (m,): those that friction acts in."""
    along = np.abs(states[problem.pair]) != np.abs(wanted[problem.pair])
    return np.append((states > OPEN) != (wanted > OPEN), along & rubs)


def _changed(problem: CoulombProblem, states: np.ndarray, wanted: np.ndarray, row: int,
             rubs: np.ndarray) -> np.ndarray:
    """(n,) `states`, of which one `row` becomes what is `wanted`: from one way of sliding to the
    other it sticks first.
    """
    touching = np.where(states > OPEN, STICK, OPEN)
    sliding = np.where(rubs, np.abs(states[problem.pair]), FORWARD)
    if row < problem.n:
        touching[row] = STICK if wanted[row] > OPEN else OPEN
    else:
        next_one = abs(wanted[problem.pair[row - problem.n]])
        turns = {sliding[row - problem.n], next_one} == {FORWARD, BACKWARD}
        sliding[row - problem.n] = STICK if turns else next_one
    return problem.joined(touching, sliding)
