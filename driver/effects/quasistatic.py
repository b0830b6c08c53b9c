"""A load history on [0, T] in implicit time steps."""

import numpy as np

from . import NO_STEP, Effect, RunFacts, entry


class Room(Effect):
    """Matters where the end depends on the way there."""

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """With friction the end depends on the history, unless loads grow in proportion from zero.

        Then every step repeats the first one in another size.
        """
        if not facts.steps:
            active, reason = None, NO_STEP
        elif len(facts.amplitudes) < 3:
            active, reason = False, "one step was taken"
        elif not facts.sizes["dual_tangential"] or facts.most("stick", "slip") == 0:
            active, reason = False, "without friction the last step does not depend on those before"
        elif facts.homogeneous and proportional(facts.amplitudes):
            active, reason = False, "loads grow in proportion: one step gives the same end"
        else:
            active, reason = True, "friction depends on the load history"
        return {"time": entry(active, reason, 0, facts.seconds["history"])}


def proportional(amplitudes: np.ndarray) -> bool:
    """Whether all columns of (steps + 1, patterns) grow from zero by one common factor."""
    last = amplitudes[-1]
    size = np.abs(last).max(initial=0.0)
    if size == 0:
        return not amplitudes.any()
    factor = amplitudes @ last / (last @ last)
    rest = np.abs(amplitudes - np.outer(factor, last)).max()
    return bool(rest <= 1e-12 * size and abs(factor[0]) <= 1e-12 and np.all(np.diff(factor) >= 0))
