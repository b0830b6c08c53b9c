"""Chains of the values of a study: one starts near the one before, and ranks share the chains.

Chains do not depend on the number of ranks, so neither do results.
"""

from .. import options
from ..runs import launch
from ..scene.manifest import Manifest

LONGEST = 20  # values that follow one another
FEWEST = 8  # chains, for the ranks to share
STEPS = 300  # for which a rank of its own pays: they take a second, and it half of one to start


def length(count: int) -> int:
    """Values in a chain, of `count` in all."""
    return min(LONGEST, -(-count // FEWEST))


def ranks_for(export: Manifest, count: int) -> int:
    """The ranks that solve `count` values on an `export` where nobody asked for a number.

    Condensed to its contact boundary a body is any rank's own, as a small one is that cannot be
    condensed (parametric.py), and chains are shared out; where contact follows the motion ranks
    share the subdomains as in a run.
    """
    shared = launch.ranks_for(export)
    if "large_sliding" in export.rooms:
        return shared
    chains = -(-count // length(count))
    return max(shared, min(options.CORES, chains, count * export.steps // STEPS))
