"""Contact: none, all of it, gaps that just close, loads that vanish, reverse and alternate."""

import numpy as np

from .case import Case
from .checks import closed_form, dense, holds, laws

BLOCK = "hard/block"
# tolerances 1e-10 and 1e-8 of QP and fixed point, times what a multiplier may answer to them
BOTH = (dense(1e-6), laws(1e-6))


def touching(outcome) -> np.ndarray:
    """(steps,) number of nodes in contact."""
    return (outcome.contact["status"] != "open").sum(axis=1)


# bar.edp: modulus of a bar that cannot get thinner, and the displacement of its free end under PULL
# = 200
MODULUS = 210e3 * 0.7 / (1.3 * 0.4)
REACH = 200 * 10 / MODULUS


def bar_that_just_touches(outcome):
    """The end of the bar moves by p L/M to the wall and back, and never presses."""
    pull = 200 * np.minimum(outcome.history["time"], 2 - outcome.history["time"])
    yield outcome.contact["u_n"], (pull * 10 / MODULUS)[:,
                                                        None] * np.ones_like(outcome.contact["u_n"])
    yield 1 + outcome.contact["sigma_n"] / 200, np.ones_like(outcome.contact["sigma_n"])


CASES = [
    Case("full lift-off", "contact", BLOCK, {"PRESS": -10e7, "PULL": 0, "GAP": 1e-3},
         checks=(*BOTH, holds("nothing touches", lambda o: not touching(o).any()))),
    Case("lift-off after contact", "contact", BLOCK,
         {"PULL": 0, "LIFT": 0, "PRESS": -10e7, "GAP": -1e-4},
         checks=(*BOTH, holds("contact is lost", lambda o: touching(o)[0] > touching(o)[-1] == 0)),
         fast=True),
    Case("everything touches", "contact", BLOCK, {"LIFT": 0, "PULL": 0},
         checks=(*BOTH,
                 holds("all touch", lambda o: (touching(o) == o.contact["x"].shape[1]).all()))),
    Case("grazing: the gap closes with no pressure", "contact", "bar",
         {"GAP": repr(REACH), "PULL": 200},
         sizes=({"SUBDOMAINS": "4x1", "CELLS": 4}, {"SUBDOMAINS": "10x2", "CELLS": 4}),
         checks=(closed_form("u = p L/M", 1e-6, bar_that_just_touches), laws(1e-6)), fast=True),
    Case("zero load", "contact", BLOCK, {"HISTORY": "none"}, fast=True,
         checks=(holds("all zero",
                       lambda o: not any(o.contact[n].any() for n in ("u_n", "u_t", "sigma_n",
                                                                      "sigma_t"))),)),
    Case("load reversal through zero", "contact", BLOCK, {"HISTORY": "reversal"}, checks=BOTH),
    Case("initial penetration", "contact", BLOCK, {"GAP": -2e-4}, checks=BOTH),
    Case("initial penetration without load", "contact", BLOCK,
         {"GAP": -2e-4, "HISTORY": "none"}, checks=BOTH),
    Case("contact and separation alternate", "contact", BLOCK,
         {"HISTORY": "alternating", "LIFT": 0, "PULL": 0},
         checks=(*BOTH, holds("alternates", lambda o: (np.diff(touching(o)) != 0).all())),
         fast=True),
    Case("one node touches", "contact", BLOCK, {"TIP": 1, "GAP": 1e-5, "PULL": 0, "LIFT": 0},
         checks=(*BOTH, holds("one node touches", lambda o: touching(o).max() == 1))),
    Case("one contact node", "contact", BLOCK, {"WIDTH": 1},
         sizes=({"SUBDOMAINS": "1x1", "CELLS": 1}, {"SUBDOMAINS": "1x2", "CELLS": 1, "HEIGHT": 2}),
         checks=(*BOTH, holds("one contact node", lambda o: o.contact["x"].shape[1] == 1))),
]
