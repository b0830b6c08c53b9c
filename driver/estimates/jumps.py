"""What jumps over cycles leave in the quantities of interest, and what less of it takes.

A jump goes on with the growth of one cycle (march/cycles.py), as the explicit Euler method does:
errors are of first order in its length. A companion with jumps half as long so tells the error,
and shorter jumps are had by a smaller share in CYCLES="jump share%".
"""

from dataclasses import dataclass

from ..march.cycle_verdict import Choice

SHORTEST = 4  # cycles in a jump that are gone through one by one instead of halved
SETTLE = 2  # cycles between two jumps, the first of which follows a state that no cycle had
SMALLEST = 1e-5  # share of what grows that jumps may be asked to err by


def halved(plan: list[int]) -> list[int]:
    """Cycles skipped after each computed one, of jumps half as long as those of `plan`."""
    shorter = []
    for skip in plan:
        if skip < SHORTEST:
            shorter += (skip + 1) * [0]
        else:
            first = (skip - SETTLE + 1) // 2
            shorter += [first, *(SETTLE - 1) * [0], skip - SETTLE - first]
    return shorter


def carried_on(values: list[float], plan: list[int]) -> float:
    """What a sum over cycles may err by that jumps of a `plan` go on with: `values` are those of
    the computed cycles, of which one after a jump tells what the last one before it has missed.

    Companions with other jumps go on with much the same values. Where they still settle as in a
    geometric series the first cycle after the jump knows the next change alone: to come is the sum.
    """
    missed = 0.0
    for k, skip in enumerate(plan[: len(values) - 1]):
        change = abs(values[k + 1] - values[k])
        before = abs(values[k] - values[k - 1]) if k else 0.0
        missed += skip * change / (1 - change / before if change < before else 1.0)
    return missed


def remedy(words: str, plan: list[int]) -> str:
    """The option with jumps half as long as those of CYCLES=`words`, which came to `plan`."""
    return f'CYCLES="{Jumps.of(0.0, words, plan).words(1)}"'


@dataclass(frozen=True)
class Jumps:
    """Jumps of a run: their error in a quantity, the share that CYCLES= allows them, cycles."""

    error: float
    share: float
    computed: int
    cycles: int

    @classmethod
    def of(cls, error: float, words: str, plan: list[int]) -> "Jumps":
        """`error` in a quantity of the run with CYCLES=`words` that skipped cycles by `plan`."""
        return cls(error, Choice.of(words).jumps, len(plan), len(plan) + sum(plan))

    def words(self, halvings: int) -> str:
        """CYCLES= for jumps that were halved so often; none where that is no jump any more."""
        share, computed = self.share * 0.5**halvings, self.computed * 2**halvings
        if computed >= self.cycles or share < SMALLEST:
            return f"{self.cycles}"
        return f"{self.cycles} jump {100 * share:.4g}%"

    def choices(self) -> list[tuple[str, float, float]]:
        """CYCLES=, error, and cycles computed over those of the run, of shorter and shorter jumps.
        """
        found, k = [(self.words(0), self.error, 1.0)], 0
        while "jump" in found[-1][0]:
            k += 1
            words = self.words(k)
            found.append((words, 0.5**k * self.error, 2.0**k) if "jump" in words
                         else (words, 0.0, self.cycles / self.computed))
        return found
