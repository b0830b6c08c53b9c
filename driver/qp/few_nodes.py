"""A contact problem among the nodes that touch or nearly do, all others open.

Most nodes of a contact boundary are far from contact, and their laws hold whatever the others do.
A solution among the nodes that touch, and those that it leaves penetrated, is one for all: an
active set of whole laws. Searches whose price grows with the number of states so reach as far as
few nodes touch. That there is none among some nodes proves nothing.
"""

from collections.abc import Callable

import numpy as np

from .coulomb import OPEN, ROUNDING, CoulombProblem

FEWEST = 24  # nodes that a search starts with
MORE = 8  # penetrated ones that are added at a time


def solution_among(problem: CoulombProblem, start: np.ndarray, most: int,
                   solve: Callable) -> tuple[np.ndarray | None, str]:
    """A solution z found among up to `most` nodes, and the method that found it; None if none is.

    Nodes are those that `start` leaves nearest to contact, bilateral ones and those that resist
    slip without pressure. `solve` gives solution and method for a smaller problem and its start.
    """
    trial = (start[: problem.rows] + problem.rigidity * problem.movement(start))[: problem.n]
    needed = problem.bilateral.copy()
    if problem.offset is not None:
        needed[problem.pair[problem.offset > 0]] = True
    trial[needed] = np.inf
    if needed.sum() > most:
        return None, ""
    count = min(max(FEWEST, int((trial > 0).sum())), most)
    chosen = np.sort(np.argsort(-trial, kind="stable")[:count])
    while True:
        few, rows = among(problem, chosen)
        found, method = solve(few, np.append(start[rows], start[problem.rows :]))
        problem.products += few.products
        if found is None:
            return None, ""
        z = np.zeros(problem.rows + problem.k)
        z[rows], z[problem.rows :] = found[: few.rows], found[few.rows :]
        if problem.violation(z) <= ROUNDING:
            return z, method
        missed = np.setdiff1d(np.flatnonzero(problem.states(z) != OPEN), chosen)
        if not len(missed) or len(chosen) == most:
            return None, ""
        over = (problem.rigidity * problem.movement(z))[missed]
        worst = missed[np.argsort(-over, kind="stable")][: min(MORE, most - len(chosen))]
        chosen = np.union1d(chosen, worst)


def among(problem: CoulombProblem, nodes: np.ndarray) -> tuple[CoulombProblem, np.ndarray]:
    """The problem of `nodes` (l,), in order, with all others open, and its rows (l + m',)."""
    place = np.full(problem.n, -1)
    place[nodes] = np.arange(len(nodes))
    pairs = np.flatnonzero(place[problem.pair] >= 0)
    rows = np.append(nodes, problem.n + pairs)
    offset = None if problem.offset is None else problem.offset[pairs]
    return CoulombProblem(problem.compliance[np.ix_(rows, rows)], problem.load[rows],
                          problem.coefficient[pairs], place[problem.pair[pairs]],
                          problem.bilateral[nodes], problem.motions[rows], problem.balance,
                          offset), rows
