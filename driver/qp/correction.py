"""Changes of nearly a solution of the dense contact problem to one, to digits of the change.

States are those that x + r movement falls into (complementarity.py), r the rigidity of a row. Its
own, one over its compliance, tells little of a stiff body on soft springs, all of whose nodes move
with it: one that slides inside its bound by a rounding would stick. So where states do not settle
r is the force that moves a row by one while all others stay.
"""

import numpy as np

from .coulomb import ROUNDING, CoulombProblem

STEPS = 50
# part of its compliance that a row yields by beside it where its rigidity is measured: rows that
# depend on one another are rigid against each other, and with less (1e-8, beside rigid motions)
# what steps are is below the rounding of systems with them
BESIDE = 1e-6


def corrected(problem: CoulombProblem, z: np.ndarray, movement: np.ndarray) -> np.ndarray | None:
    """Change of z to a solution by Newton steps, to digits of the change.

    `movement` (n + m,) is that at z, better known than a product with the compliance knows it. None
    where states do not settle: on their border they may come again, in a solution to rounding. Nor
    do states that settle balance motions that they do not hold.
    """
    change = _settled(problem, z, movement)
    if change is None:
        held = problem.under(problem.load, problem.coefficient)
        held.augmentation = rigidity(problem.compliance)
        change = _settled(held, z, movement)
    return change


def _settled(problem: CoulombProblem, z: np.ndarray, movement: np.ndarray) -> np.ndarray | None:
    """The same, with the problem's own augmentation of multipliers."""
    change, moved, seen = np.zeros_like(z), movement, []
    for _ in range(STEPS):
        states, sign = problem.states(z + change, moved), problem.signs(z + change)
        key = states.tobytes() + sign.tobytes()
        if key in seen:
            settled = key == seen[-1] and not problem.k
            obeys = settled or problem.violation(z + change, moved) <= ROUNDING
            return change if obeys else None
        seen.append(key)
        found = problem.correction_in(states, sign, z, movement)
        if found is None:
            return None
        change, moved = found
    return None


def rigidity(compliance: np.ndarray) -> np.ndarray:
    """(n + m,) forces that move a row by one while all others stay.

    Rows that depend on one another cannot: they count as 1 / BESIDE times their own rigidity, and
    so do all where rounding makes even that system singular.
    """
    root = np.sqrt(np.diag(compliance))
    alike = compliance / np.outer(root, root) + BESIDE * np.eye(len(root))
    try:
        held = np.diag(np.linalg.inv(alike))
    except np.linalg.LinAlgError:
        held = np.full(len(root), 1.0 / BESIDE)
    return held / root**2
