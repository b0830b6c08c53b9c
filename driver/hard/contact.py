"""Contact: none, all of it, gaps that just close, loads that vanish, reverse and alternate."""

import numpy as np

from .case import BLOCK, Case
from .checks import BOTH, closed_form, holds, laws


def touching(outcome) -> np.ndarray:
    """(steps,) number of nodes in contact."""
    return (outcome.contact["status"] != "open").sum(axis=1)


MODULUS = 210e3 * 0.7 / (1.3 * 0.4)  # of bar.edp, which cannot get thinner
REACH = 200 * 10 / MODULUS  # displacement of its free end under PULL = 200


def bar_that_just_touches(outcome):
    """The end of the bar moves by p L/M to the wall and back, and never presses."""
    pull = 200 * np.minimum(outcome.history["time"], 2 - outcome.history["time"])
    ones = np.ones_like(outcome.contact["u_n"])
    yield outcome.contact["u_n"], (pull * 10 / MODULUS)[:, None] * ones
    yield 1 + outcome.contact["sigma_n"] / 200, ones


def nothing_moves(outcome) -> bool:
    """No displacement and no traction at any contact node."""
    return not any(outcome.contact[name].any() for name in ("u_n", "u_t", "sigma_n", "sigma_t"))


def asperities(outcome):
    """Of rough.edp: p = c (u_n - g)_+ at every node."""
    closure = outcome.contact["u_n"] - outcome.contact["gap"]
    yield (-outcome.contact["sigma_n"],
           outcome.summary["parameters"]["asperities"] * np.maximum(closure, 0))


def bent_strip(outcome):
    """Of bimetal.edp: Timoshenko's curvature between a quarter and three quarters of its length."""
    down = -np.array([row["u_y"] for row in outcome.summary["probes"][-4:-1]])
    ratio, rise = 210 / 100, outcome.summary["parameters"]["rise"]
    exact = 6 * 7e-6 * rise * 4 / (2 * (3 * 4 + (1 + ratio) * (1 + 1 / ratio)))
    yield np.diff(down, 2) / 10**2, np.array([exact])


def flattened_waves(outcome):
    """Of ripple.edp: load and peak of the pressure, Westergaard's."""
    mean, full = outcome.summary["parameters"]["mean"], np.pi / (1 - 0.3**2) * 1e-4
    known = outcome.summary["quantities"]
    yield (np.array([known["normal_resultant"], known["peak_pressure"]]),
           full * np.array([mean, 2 * np.sqrt(mean)]))


def power_law(outcome):
    """Of flange.edp: p = c (u_n - g)_+^m at every node, as what is smooth in the other one."""
    closure = np.maximum(outcome.contact["u_n"] - outcome.contact["gap"], 0)
    known, pressure = outcome.summary["parameters"], -outcome.contact["sigma_n"]
    if known["exponent"] < 1:
        yield closure, (pressure / known["asperities"]) ** (1 / known["exponent"])
    else:
        yield pressure, known["asperities"] * closure ** known["exponent"]


def worn_level(outcome):
    """Of worn-pad.edp after a long way: 5 MPa at every node, k N S in the last step."""
    last = -outcome.contact["sigma_n"][-1]
    yield last, np.full(len(last), 5.0)


ROUGH = ({"SUBDOMAINS": "4x2", "CELLS": 4}, {"SUBDOMAINS": 9, "CELLS": 9})

CASES = [
    *(Case(f"rough surface, {c:g} of the block's stiffness", "rough", {"ASPERITIES": c * 7e4},
           ROUGH, (closed_form("p = c (u_n - g)", 1e-4, asperities),), fast=c == 1)
      for c in (1e-4, 1, 1e3)),
    Case("tied strips bend", "bimetal", {"ELEMENT": "P2"}, ({"SUBDOMAINS": 5}, {"SUBDOMAINS": 23}),
         (closed_form("curvature", 1e-5, bent_strip),), fast=True),
    *(Case(f"waves with crests at {crest:g} of the periodic side", "ripple",
           {"CREST": crest, "ELEMENT": "P2", "H": 0.01}, ({"SUBDOMAINS": 3}, {"SUBDOMAINS": 17}),
           (closed_form("load and peak", 5e-3, flattened_waves),)) for crest in (0, 0.3, 0.5)),
    *(Case(f"faces that close by the power {m:g}, c = {c:g}", "flange",
           {"EXPONENT": m, "ASPERITIES": c, "H": 5}, ({"SUBDOMAINS": 3}, {"SUBDOMAINS": 19}),
           (closed_form("p = c (u_n - g)^m", 1e-5, power_law),), fast=m == 2)
      for m, c in ((0.5, 5e3), (2, 1e8), (3.33, 1e13))),
    *(Case(f"a lining that wears off {k:g} times as fast", "worn-pad",
           {"WEAR": k * 1e-4, "STROKE": 4000 / k, "STEPS": 12},
           ({"SUBDOMAINS": "2x1", "CELLS": 4}, {"SUBDOMAINS": "4x2", "CELLS": 4}),
           (closed_form("level pressure", 1e-3, worn_level),)) for k in (0.1, 1, 10)),
    Case("full lift-off", BLOCK, {"PRESS": -10e7, "PULL": 0, "GAP": 1e-3},
         checks=(*BOTH, holds("nothing touches", lambda o: not touching(o).any()))),
    Case("lift-off after contact", BLOCK, {"PULL": 0, "LIFT": 0, "PRESS": -10e7, "GAP": -1e-4},
         checks=(*BOTH, holds("contact is lost", lambda o: touching(o)[0] > touching(o)[-1] == 0)),
         fast=True),
    Case("everything touches", BLOCK, {"LIFT": 0, "PULL": 0},
         checks=(*BOTH,
                 holds("all touch", lambda o: (touching(o) == o.contact["x"].shape[1]).all()))),
    Case("grazing: the gap closes with no pressure", "bar", {"GAP": repr(REACH), "PULL": 200},
         sizes=({"SUBDOMAINS": "4x1", "CELLS": 4}, {"SUBDOMAINS": "10x2", "CELLS": 4}),
         checks=(closed_form("u = p L/M", 1e-6, bar_that_just_touches), laws(1e-6)), fast=True),
    Case("zero load", BLOCK, {"HISTORY": "none"}, fast=True,
         checks=(holds("all zero", nothing_moves),)),
    Case("load reversal through zero", BLOCK, {"HISTORY": "reversal"}, checks=BOTH),
    Case("initial penetration", BLOCK, {"GAP": -2e-4}, checks=BOTH),
    Case("initial penetration without load", BLOCK, {"GAP": -2e-4, "HISTORY": "none"}, checks=BOTH),
    Case("contact and separation alternate", BLOCK,
         {"HISTORY": "alternating", "LIFT": 0, "PULL": 0},
         checks=(*BOTH, holds("alternates", lambda o: (np.diff(touching(o)) != 0).all())),
         fast=True),
    Case("one node touches", BLOCK, {"TIP": 1, "GAP": 1e-5, "PULL": 0, "LIFT": 0},
         checks=(*BOTH, holds("one node touches", lambda o: touching(o).max() == 1))),
    Case("one contact node", BLOCK, {"WIDTH": 1},
         sizes=({"SUBDOMAINS": "1x1", "CELLS": 1}, {"SUBDOMAINS": "1x2", "CELLS": 1, "HEIGHT": 2}),
         checks=(*BOTH, holds("one contact node", lambda o: o.contact["x"].shape[1] == 1))),
]
