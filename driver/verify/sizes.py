"""What the size of a body adds to a formula of half-planes: computed with contact of growing size.

Runs with ever larger contact, meshes as fine against it, differ from the formula by d0 + C r^k, r
the contact over the size of the body: d0 belongs to the mesh, C r^k to the body. Large contacts
show C and k well above the errors of coarse meshes; on the body of the case, where r is small, that
is what the formula cannot know. Where a number is a distance of curves (its reference is zero) the
squares add, d^2 = d0^2 + (C r^k)^2.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

ORDERS = (1, 2)  # the first from forces that the body carries, which symmetric cases lack


@dataclass(frozen=True)
class Sizes:
    """Settings of the runs, contact over body of a case.View, and how that ratio is written."""

    runs: tuple[dict, ...]
    ratio: Callable[[object], float]
    words: str


@dataclass(frozen=True)
class Effect:
    """C r^k of one number, and the runs it follows from: contact over body, differences."""

    factor: float
    order: int
    ratios: tuple[float, ...]
    deviations: tuple[float, ...]
    distance: bool  # of curves: never negative, squares add

    def of(self, ratio: float) -> float:
        """What a body with this ratio adds to the number, relative."""
        return self.factor * ratio**self.order

    def remaining(self, deviation: float, ratio: float) -> float:
        """Magnitude of the deviation that the size of the body does not explain."""
        added = self.of(ratio)
        if self.distance:
            return float(np.sqrt(max(0.0, deviation**2 - added**2)))
        return abs(deviation - added)


def fitted(ratios, deviations, distance: bool) -> Effect:
    """The effect with the order of `ORDERS` that leaves the least of the deviations."""
    r, d = np.asarray(ratios, float), np.asarray(deviations, float)
    found = []
    for order in ORDERS:
        power, wanted = (2 * order, d**2) if distance else (order, d)
        columns = np.column_stack([np.ones_like(r), r**power])
        (_, factor), *_ = np.linalg.lstsq(columns, wanted, rcond=None)
        left = float(np.linalg.norm(columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
                                    - wanted))
        found.append((left, order, float(np.sqrt(max(0.0, factor)) if distance else factor)))
    _, order, factor = min(found)
    return Effect(factor, order, tuple(map(float, r)), tuple(map(float, d)), distance)
