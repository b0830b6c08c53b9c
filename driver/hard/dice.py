"""Random choices that a seed determines."""

import numpy as np


class Dice:
    """Choices drawn one after the other from one seed."""

    def __init__(self, seed: int):
        self._random = np.random.default_rng(seed)

    def pick(self, *values, weights=None):
        """One of the values, with probabilities in proportion to `weights`."""
        share = None if weights is None else np.array(weights) / np.sum(weights)
        return values[int(self._random.choice(len(values), p=share))]

    def sample(self, values, count: int) -> list:
        """`count` different ones of the values, in their order."""
        return [values[k] for k in sorted(self._random.permutation(len(values))[:count])]

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return bool(self._random.random() < probability)

    def number(self, low: float, high: float) -> float:
        """A number between two others, of four digits."""
        return float(f"{self._random.uniform(low, high):.4g}")

    def whole(self, low: int, high: int) -> int:
        """A whole number from `low` to `high`."""
        return int(self._random.integers(low, high + 1))
