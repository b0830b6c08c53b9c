"""A history whose last part, a cycle, is gone through over and over; march/cycles.py judges cycles.
"""

from ..errors import InputError
from . import Effect, RunFacts, entry

SAME = 1e-9  # part of the largest value of a history by which it may miss where it began
LEAST = 1e-3  # value that counts at least: steps may meet a sine at its zeros alone, with 1e-16


class Room(Effect):
    """The step at which a cycle begins, and how many cycles there are."""

    def __init__(self, name: str, manifest):
        """Raises InputError for a history that does not end where the cycle begins."""
        super().__init__(name, manifest)
        start, count = self.data.get("start"), self.data.get("count")
        if not (isinstance(start, int) and isinstance(count, int) and count > 0
                and 0 <= start < manifest.steps):
            raise InputError("cycles must have a start and a count; run the scene again")
        if "large_sliding" in manifest.rooms:
            raise InputError("cycles cannot be compared where contact follows the motion, as nodes "
                             "meet another place in every cycle: leave out cycles or largeSliding")
        self.repeats = start, count
        self.summary = {"cycles": count}
        period = manifest.t_end * (1 - start / manifest.steps)
        for number, history in manifest.amplitudes.items():
            if abs(history[-1] - history[start]) > SAME * max(LEAST, *map(abs, history)):
                raise InputError(
                    f"a cycle must end as it begins, but amplitude{number} is {history[start]:g} "
                    f"at time {manifest.t_end - period:g}, when the cycle begins, and "
                    f"{history[-1]:g} at its end: declare one cycle in the history, and its start "
                    "by  macro cycleStart() time //")

    def ledger(self, facts: RunFacts) -> dict[str, dict]:
        """It matters in every step."""
        return {"cycles": entry(*facts.in_every_step("the history is gone through again"))}
