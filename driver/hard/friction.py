"""Friction: none to much of it, jumps, full sliding, many cycles, and beyond uniqueness."""

import numpy as np

from .case import BLOCK, KKT, Case, Check, Outcome
from .checks import BOTH, LAWS, assembled, closed_form, exported, holds, laws, ratio

CYCLES = "hard/cycles"


def cycle_to_cycle(tolerance: float):
    """The last cycle of eight steps repeats the one before: nothing drifts.

    Relative to the run's largest values.
    """
    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        error = 0.0
        for names in (("u_n", "u_t"), ("sigma_n", "sigma_t")):
            largest = max(np.abs(outcome.contact[name]).max() for name in names)
            for name in names:
                drift = outcome.contact[name][-8:] - outcome.contact[name][-16:-8]
                error = max(error, ratio(np.abs(drift).max(), largest))
        return Check("the cycle before", error, tolerance)
    return check


def energy(tolerance: float):
    """In every cycle what the loads give is what the body stores and friction takes.

    With K u = f - B' lambda at both ends of every step the sums of mean forces times displacements
    obey

        1/2 (f_k + f_k-1)' Du = D(1/2 u'Ku) + 1/2 (lambda_k + lambda_k-1)' B Du

    exactly. The work of the loads and the stored energy are those of the assembled body under the
    reported contact forces, the work of contact is from the reported displacements: relative to the
    largest work of a cycle.
    """
    def check(case: Case, size: dict, outcome: Outcome) -> Check:
        manifest, _ = exported(case, size)
        body, c, history = assembled(case, size), outcome.contact, manifest.factors
        lam = -np.concatenate([c["sigma_n"] * c["weight"], c["sigma_t"] * c["weight"]], axis=1)
        u = np.array([body.solve(w, -body.B.T @ x) for w, x in zip(history[1:], lam)])
        given = work(history[1:] @ body.loads, u)
        stored = np.diff(np.append(0.0, 0.5 * np.einsum("ki,ki->k", u, (body.K @ u.T).T)))
        rubbed = work(lam, np.concatenate([c["u_n"], c["u_t"]], axis=1))
        missing, whole = cycles(given - stored - rubbed), cycles(np.abs(given))
        return Check("balance of energy", ratio(np.abs(missing).max(), np.abs(whole).max()),
                     tolerance)

    def work(force: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """(steps,) mean forces times changes of displacement, both (steps, n), from zero."""
        force, displacement = (np.vstack([0 * values[:1], values])
                               for values in (force, displacement))
        return (0.5 * (force[1:] + force[:-1]) * np.diff(displacement, axis=0)).sum(axis=1)

    def cycles(values: np.ndarray) -> np.ndarray:
        """Sums over cycles of eight steps, after the first, in which the press comes on."""
        return values[8:].reshape(-1, 8).sum(axis=1)

    return check


def dissipates_the_same(outcome):
    """Friction's work in the last cycles, by history.csv: equal and positive."""
    taken = np.diff(outcome.history["dissipated"][7::8])
    yield taken[-2:], np.full(2, taken[-3])


def three_solutions(case: Case, size: dict, outcome: Outcome) -> Check:
    """By hand: one node sticks, slides with lambda_t = F lambda_n, or is open; all are named."""
    manifest, _ = exported(case, size)
    body = assembled(case, size)
    C, F = body.compliance(), float(body.friction[0])
    d = body.B @ body.solve(manifest.factors[-1])
    stick, slip = np.linalg.solve(C, d), d[0] / (C[0, 0] + F * C[0, 1])
    if not (d[0] < 0 and 0 <= stick[1] < F * stick[0] and slip > 0):
        return Check("by hand", np.inf, 1.0)
    named = sorted(-s["resultant_n"] for s in outcome.summary["uniqueness"]["solutions"])
    expected = sorted([0.0, stick[0], slip])
    error = np.abs(np.array(named) - expected).max() / expected[-1] if len(named) == 3 else np.inf
    return Check("three solutions by hand", float(error), 1e-6)


def solutions(number: int):
    """The first step with several solutions names `number`, whose indices add up to one."""
    return holds(f"{number} solutions",
                 lambda o: len(o.summary["uniqueness"]["solutions"]) == number
                 and sum(s["index"] for s in o.summary["uniqueness"]["solutions"]) == 1)


def states(outcome) -> set:
    """Which of open, stick, slip occur in the last step."""
    return set(outcome.contact["status"][-1])


def full_sliding(outcome):
    """Where all slides one way the tangential force is F times the normal one."""
    c, F = outcome.contact, float(outcome.summary["parameters"]["friction"])
    pressed = (c["sigma_n"] * c["weight"]).sum(axis=1)[-1]
    yield abs((c["sigma_t"] * c["weight"]).sum(axis=1)[-1]), F * abs(pressed)


# a step inherits the slip of all before it: errors of 800 steps may add up
MANY = {"CYCLES": 99, "STEPS": 16, "RTOL": 1e-12, "FRICTION_RTOL": 1e-11}
CASES = [
    Case("no friction", BLOCK, {"FRICTION": 0}, checks=BOTH, easy={"FRICTION": 0.3},
         ratio=2.0, sweep=("friction coefficient", 0.01)),
    *(Case(f"F = {F:g}", BLOCK, {"FRICTION": F}, checks=BOTH, easy={"FRICTION": 0.3},
           sweep=("friction coefficient", F), fast=F == 1) for F in (1e-9, 0.1, 0.3, 1, 2)),
    # the dense fixed point may settle on another solution, or on none: the law says whether this is
    # one
    *(Case(f"F = {F:g}", BLOCK, {"FRICTION": F}, checks=LAWS,
           easy={"FRICTION": 0.3}, sweep=("friction coefficient", F)) for F in (5, 10, 100)),
    Case("F jumps from 0.1 to 1", CYCLES,
         {"CYCLES": 1, "STEPS": 16, "FRICTION": 0.1, "JUMP": 10}, checks=BOTH, fast=True),
    Case("F jumps from 1 to 0", CYCLES, {
         "CYCLES": 1, "STEPS": 16, "FRICTION": 1, "JUMP": 0}, checks=BOTH),
    Case("full sliding sets in", "tutorial", {"STEPS": 10}, sizes=({}, {"SUBDOMAINS": 12}),
         checks=(laws(1e-6), closed_form("T = F N", 1e-6, full_sliding),
                 holds("all slide", lambda o: "stick" not in states(o)))),
    # an obstacle that moves, by no way to speak of and by 100 km
    Case("the obstacle slides to and fro", "brake-pad", {"STEPS": 9, "H": 3},
         sizes=({"SLIDE": 1}, {"SLIDE": 1e8}),
         checks=(closed_form("T = F N", 1e-6, full_sliding),
                 holds("all slide", lambda o: not {"stick"} & states(o)))),
    # contact that follows the motion, between bodies and on an obstacle
    Case("a punch is dragged over three widths", "drag", {"STEPS": 12, "H": 1},
         sizes=({"SUBDOMAINS": 2}, {"SUBDOMAINS": 9}),
         checks=(closed_form("T = F N", 1e-6, full_sliding),
                 holds("all slide at last", lambda o: states(o) == {"slip"}),
                 holds("its geometry", lambda o: o.summary["residuals"]["geometry"] <= KKT))),
    Case("a hook goes in and comes out", "latch", {"STEPS": 60, "H": 0.6},
         sizes=({"SUBDOMAINS": 1}, {"SUBDOMAINS": 7}),
         checks=(holds("it is out", lambda o: states(o) == {"open"}),
                 holds("its geometry", lambda o: o.summary["residuals"]["geometry"] <= KKT))),
    Case("everything sticks", BLOCK, {"FRICTION": 1, "LIFT": 0, "PULL": 0},
         # nothing moves: no displacement to compare
         checks=(laws(1e-6), holds("all stick", lambda o: states(o) == {"stick"}))),
    Case("contact ends at the clamped side", CYCLES, {"CYCLES": 1, "STEPS": 16},
         checks=BOTH, sizes=({"CELLS": 8}, {"CELLS": 16})),
    Case("100 cycles", CYCLES, MANY,
         sizes=({"SUBDOMAINS": "2x1", "CELLS": 4}, {"SUBDOMAINS": "4x2", "CELLS": 4}),
         checks=(*BOTH, cycle_to_cycle(1e-8), energy(1e-6),
                 closed_form("the cycles before", 1e-6, dissipates_the_same)), seconds=400),
    Case("one node: sticks, slides or lifts off", BLOCK,
         {"WIDTH": 1, "PRESS": 0, "FRICTION": 10, "STEPS": 1},
         sizes=({"SUBDOMAINS": "1x1", "CELLS": 1, "PULL": 8e7, "LIFT": -5e5},
                {"SUBDOMAINS": "1x2", "CELLS": 1, "HEIGHT": 2, "PULL": 5.8e7, "LIFT": -2.2e6}),
         checks=(laws(1e-6), three_solutions), warning="not unique", fast=True),
    *(Case(f"model beyond uniqueness, F = {F:g}", "model", {"FRICTION": F, "STEPS": 1},
           checks=(laws(1e-6), solutions(3)),
           sizes=({"SUBDOMAINS": "4x2"}, {"SUBDOMAINS": "8x4", "CELLS": 5}),
           warning="not unique") for F in (6, 15)),
    Case("a hump of load beyond uniqueness", BLOCK, {
         "FRICTION": 15, "HISTORY": "hump"}, checks=LAWS),
]
