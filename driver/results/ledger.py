"""The effects ledger of a run: what the scene declared, whether it ever mattered, what it cost.

Made of what the run already holds; nothing is solved or measured for it. Seconds are shares of the
time steps' wall time, in proportion to the products with the dual matrix that an effect caused.
What is said of an effect stands in its room.
"""

import numpy as np

from ..contact.states import STATUS_NAMES
from ..effects import RunFacts


def ledger(solver, sizes: dict, amplitudes: np.ndarray, largest: np.ndarray,
           history: list[dict]) -> dict[str, dict]:
    """Entry {declared, active, reason, unknowns, seconds} of every effect of a finished run.

    `solver` has marched through it. `sizes` as in summary.json, `amplitudes` (steps + 1, patterns),
    `largest` (patterns,) the largest nodal value of every pattern, `history` the rows of
    history.csv, empty if no step was kept.
    """
    contact = solver.operator.structure.contact.start
    facts = RunFacts(sizes, amplitudes, largest,
                     {state: np.array([row[f"nodes_{state}"] for row in history], int)
                      for state in STATUS_NAMES},
                     shares(solver.history.log, solver.history.seconds), bool(contact.gap.any()),
                     bool(solver.initial.any()),
                     solver.effects.homogeneous(contact, solver.initial))
    return solver.effects.ledger(facts)


def shares(log: list[tuple], seconds: float) -> dict[str, float]:
    """Seconds of the products that contact, friction and the steps before the last one caused.

    contact: products of expansion and proportioning steps, which bounds alone call for; friction:
    those of the fixed point's iterations after the first; history: those of all steps but the last.
    `log` as in convergence.csv.
    """
    spent = dict.fromkeys(("contact", "friction", "history"), 0)
    total, before = 0, log[0][0] if log else 0
    last = log[-1][1] if log else 0
    for product, step, iteration, kind, _ in log:
        count, before = max(0, product - before), product
        total += count
        spent["contact"] += count * (kind in ("expansion", "proportioning"))
        spent["friction"] += count * (iteration > 1)
        spent["history"] += count * (step < last)
    return {name: seconds * count / total if total else 0.0 for name, count in spent.items()}
