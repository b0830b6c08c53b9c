"""Scale: units, loads and places that physics does not depend on."""

from .case import BLOCK, Case
from .checks import laws, same_as

HUMP = {"HISTORY": "hump"}
# the same arithmetic in other units: every number differs by roundings, which tolerances of 1e-10
# let through
ROUNDING = 1e-9


def units(power: float, kind: str) -> Case:
    """The block in units of 10^-power metres or pascals."""
    given = {kind: f"1e{power}"}
    return Case(f"units: {kind.lower()} times 1e{power}", BLOCK, {**HUMP, **given},
                checks=(same_as(ROUNDING, **{kind.lower(): 10.0**power}, options={kind: 1}),
                        laws(1e-6)), easy={kind: 1}, ratio=1.0, fast=power > 0)


def load(factor: float) -> Case:
    """All loads times `factor`; contact without gaps answers in proportion."""
    given = {"PRESS": 10e7 * factor, "PULL": 3e7 * factor, "LIFT": 5e7 * factor}
    plain = {"PRESS": 10e7, "PULL": 3e7, "LIFT": 5e7}
    return Case(f"load times {factor:.0e}", BLOCK, {**HUMP, **given}, ratio=1.0,
                easy=plain, checks=(same_as(ROUNDING, factor, factor, options=plain), laws(1e-6)))


FAR = {"X0": 2e6, "Y0": 2e6}  # a million body lengths
# coordinates are good to 2e-16 * 2e6 there, 4e-9 of a cell, and strains of elements with them;
# contact answers tenfold
DIGITS = 1e-6

CASES = [*(units(power, kind) for kind, powers in (("LENGTH", (9, -9)), ("STRESS", (12, -12)))
           for power in powers), load(1e-12), load(1e12),
         Case("a million body lengths from the origin", BLOCK, {**HUMP, **FAR}, warning="digits",
              fast=True,
              checks=(same_as(DIGITS, options={"X0": 0, "Y0": 0}, counts=False), laws(1e-6)))]
