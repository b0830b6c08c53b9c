"""Algorithm: degenerate, ill-conditioned QPs, limits that cannot be met, idle ranks."""

import numpy as np

from .case import BLOCK, Case, Check, Outcome, reference
from .checks import BOTH, LAWS, holds, laws

FREED = {"PULL": 0, "LIFT": 0, "PRESS": 0}


def same_bits(name: str, **options):
    """Contact quantities and counts equal those of the run with other `options` bit by bit."""
    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        other = reference(case, size, options)
        same = outcome.summary["counts"] == other.summary["counts"]
        for field in ("u_n", "u_t", "sigma_n", "sigma_t"):
            same = same and np.array_equal(outcome.contact[field], other.contact[field])
        return Check(name, 0.0 if same else np.inf, 1.0)
    return check


def degenerate(outcome) -> bool:
    """No node presses, and all touch: multiplier and distance vanish together everywhere."""
    c = outcome.contact
    free = not c["sigma_n"].any() and not c["sigma_t"].any()
    return free and np.abs(c["u_n"] - c["gap"]).max() == 0


CASES = [
    Case("multiplier and gap zero at every node", BLOCK, FREED,
         checks=(laws(1e-12), holds("all grazing", degenerate)), fast=True),
    Case("pressed, then free with the gaps just closed", BLOCK,
         {"HISTORY": "hump", "PULL": 0, "LIFT": 0, "STEPS": 5}, checks=BOTH),
    Case("friction bounds of zero width", BLOCK,
         {"FRICTION": 0, "HISTORY": "reversal"}, checks=BOTH),
    Case("plain method", BLOCK, {"PRECONDITIONER": "none", "PREDICTOR": "previous",
                                 "EXPANSION": "gradient", "INNER_RTOL": 1e-9}, checks=BOTH),
    Case("stiffness of the halves 1 to 1e10", BLOCK,
         {"JUMP": 1e10, "BOARD": "halves", "FRICTION": 0.3}, checks=LAWS),
    Case("more ranks than subdomains", BLOCK, {"NP": 3, "STEPS": 4},
         sizes=({"SUBDOMAINS": "1x1", "CELLS": 4}, {"SUBDOMAINS": "2x1", "CELLS": 4}),
         checks=(*BOTH, same_bits("one rank", NP=1))),
    Case("tolerance below rounding", BLOCK, {"RTOL": 1e-18, "STEPS": 4}, status=4,
         reason="stagnated", fast=True),
    Case("one iteration of the fixed point", BLOCK, {"MAX_FIXED_POINT": 1}, status=4,
         reason="no fixed point.* in 1 iterations"),
    Case("two products a QP", BLOCK, {"MAX_PRODUCTS": 2}, status=4, reason="products used: 2"),
]
