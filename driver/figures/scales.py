"""Units of the axes: factors that bring values between 1 and 1000, with their SI prefixes."""

import math
from typing import NamedTuple

import numpy as np

from ..units import PREFIXES, split_unit, spelt
from .reading import Run


class Scale(NamedTuple):
    """Multiply by `factor` to get numbers in the unit called `label`."""

    factor: float
    label: str


def scale_for(unit: str, values) -> Scale:
    """Scale that brings `values` between 1 and 1000, with an SI prefix if the unit is known."""
    values = np.abs(np.asarray(values, dtype=float))
    peak = float(f"{values.max(initial=0.0):.3g}")  # as it is written: 0.9999 MPa is not 1000 kPa
    known, base = split_unit(unit)
    thousands = 3 * math.floor(math.log10(peak * 10**known) / 3 + 1e-12) if peak > 0 else known
    if base:
        exponent = min(max(thousands, -9), 9)
        return Scale(10.0 ** (known - exponent), PREFIXES[exponent] + base)
    plain = "" if unit in ("", "1", "-") else unit
    if peak == 0 or 0.1 <= peak < 1e4:
        return Scale(1.0, plain or "–")
    return Scale(10.0**-thousands, rf"$10^{{{thousands}}}$ {plain}".strip())


def length_scale(run: Run, values) -> Scale:
    """Scale of lengths of a run."""
    return scale_for(run.summary["units"]["length"], values)


def stress_scale(run: Run, values) -> Scale:
    """Scale of stresses of a run."""
    return scale_for(run.summary["units"]["stress"], values)


def force_scale(run: Run, values) -> Scale:
    """Scale of resultants of tractions over a line, force per unit of thickness."""
    return scale_for(spelt(1, 1, run.summary["units"]), values)


def energy_scale(run: Run, values) -> Scale:
    """Scale of energies per unit of thickness."""
    return scale_for(spelt(1, 2, run.summary["units"]), values)


def round_magnification(wish: float, limit: float = math.inf) -> float:
    """The number among 1, 2, 3, 5 times a power of ten nearest to `wish` on a log scale.

    Not above `limit`, but at least 1.
    """
    target = max(min(wish, limit), 1.0)
    power = 10.0 ** math.floor(math.log10(target))
    steps = [step * power for step in (1, 2, 3, 5, 10) if step * power <= max(limit, 1.0)]
    return min(steps, key=lambda step: abs(math.log(step / target)))
