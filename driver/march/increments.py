"""Contact multipliers of a condensed solution to their own digits, where stiffness jumps.

What products round off on gluing rows between soft parts may be more than stiff parts deform by.
Solving for the gluing multipliers anew leaves another such residual r_g every time, which comes
back on the contact rows: they get no more digits by that, though their own are known. So r_g stays
where it is, and contact is solved beside it: the change of the contact multipliers that their
gradient asks for is that of the condensed problem, and the change y_g of the gluing multipliers
follows from it alone,

    F_gg y_g = -F_gc y_c,

to digits of the change, whatever the size of x. It is iterative refinement (N. Higham, Accuracy
and Stability of Numerical Algorithms, SIAM 2002, chapter 12) of the contact rows.
"""

import numpy as np

from ..errors import NotConverged
from ..qp import complementarity
from ..qp.mprgp import projected_gradient
from .step import Load, Unfinished

HEADWAY = 0.5  # part of the residual before, which an increment must leave at most
DIGITS = 1e-3  # of an increment that gluing multipliers answer to


def solved_by_increments(qp, condensation, bodies, index: int, load: Load, x: np.ndarray,
                         gradient: np.ndarray, iteration: int) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers (owned,) near x whose contact rows miss as little as products show there.

    And their gradient. `qp` is the FrictionQP, `condensation` the Condensation of its problem,
    `bodies` what moves where no support holds it. They are x and `gradient` themselves where the
    stiffness does not jump, and where Newton's method fails from there. Collective.
    """
    rows, op, best = qp.rows, qp.operator, np.inf
    motions = slice(op.structure.patterns, None)
    answer = x, gradient, load.weights[motions].copy()
    if op.levels == 1 or op.contact_rows_only:
        return x, gradient
    while True:
        residual = projected_gradient(x, gradient, *rows.limits(op.owned, x))
        residual[rows.gluing] = 0.0
        missed = qp.size(residual)
        if not missed < best:
            break
        idle, best = missed > HEADWAY * best, missed
        answer = x, gradient, load.weights[motions].copy()
        if idle or missed == 0:
            break
        try:
            change, moved = _increment(qp, condensation, index, load, x, gradient, iteration)
        except (NotConverged, Unfinished):
            break
        x = x + change
        bodies.shift(load, moved)
        gradient = op.apply(x) - load.d
    x, gradient, place = answer
    bodies.shift(load, place - load.weights[motions])
    return x, gradient


def _increment(qp, condensation, index, load, x, gradient, iteration):
    """Change (owned,) of x for its `gradient` on contact rows, and motions (modes,) of bodies.

    Raises NotConverged, Unfinished.
    """
    op, rows = qp.operator, qp.rows
    problem = condensation.problem(load, x, gradient)
    solution = complementarity.newton(problem, problem.whole(condensation.gather(x)))
    if solution is None:
        raise NotConverged("no solution of the condensed problem near the last one")
    size = condensation.size
    change = condensation.place(solution[:size], x) - x
    pushed, tol = op.apply(change), qp.tol
    for contact in (rows.normal, rows.tangential):
        pushed[contact] = 0.0
    qp.tol = DIGITS * qp.size(pushed)
    try:
        result = qp.solve(index, iteration, np.zeros(op.owned), condensation.fixing(change),
                          change, 0.0)
    finally:
        qp.tol = tol
    return result.x, solution[size:]
