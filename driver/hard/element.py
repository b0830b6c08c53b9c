"""Elements: quadratic ones in trials of the other families and in nearly incompressible bodies."""

from dataclasses import replace

from . import friction, geometry, material, scale, support
from .case import BLOCK, Case
from .checks import dense, holds, laws

TRIALS = {
    geometry: ("subdomains of one element", "subdomains touch in one node", "30 metis subdomains",
               "aspect ratio 100", "slender body 30:1",
               "one contact boundary round a convex corner", "slanted contact ends at a roller"),
    material: ("E jumps by 1e+06 from subdomain to subdomain", "E jumps by 1e-03 halfway",
               "fibres stiffer by 100"),
    friction: ("F = 1", "everything sticks", "F jumps from 0.1 to 1"),
    scale: ("units: length times 1e9", "a million body lengths from the origin"),
    support: ("floating body, pressed down", "friction alone holds the body sideways"),
}


def trial(module, name: str) -> Case:
    """The case of a module with a name."""
    return next(case for case in module.CASES if case.name == name)


def quadratic(case: Case, element: str = "P2") -> Case:
    """The case with quadratic elements; a vertex weighs a sixth of an edge, half in linear ones."""
    easy = None if case.easy is None else {**case.easy, "ELEMENT": element}
    # for the same error of pressures
    tight = {"RTOL": case.options["RTOL"] / 3} if "RTOL" in case.options else {}
    return replace(case, name=f"{case.name}, {element}",
                   options={**case.options, **tight, "ELEMENT": element}, easy=easy, sweep=None,
                   fast=False)


def incompressible(value: float, fast=False) -> Case:
    """P2-mixed near incompressibility: solved and not warned of."""
    unlocked = holds("nothing locks", lambda run: "lock" not in str(run.summary["warnings"]))
    # stiffness entries of lambda cancel and leave those of mu: rounding grows by their ratio
    close = max(1e-5, 1e-10 / (1 - 2 * value))
    return Case(f"Poisson's ratio {value:g}, P2-mixed", BLOCK,
                {"POISSON": value, "ELEMENT": "P2-mixed"},
                checks=(dense(close), laws(close), unlocked),
                easy={"POISSON": 0.277, "ELEMENT": "P2-mixed"}, fast=fast)


def locking(value: float) -> Case:
    """P2 there: the problem is solved, and the run warns that its pressures are unreliable."""
    return replace(material.poisson(value), name=f"Poisson's ratio {value:g}, P2",
                   sweep=None, options={"POISSON": value, "ELEMENT": "P2"},
                   easy={"POISSON": 0.277, "ELEMENT": "P2"},
                   warning="P2 elements lock.*ELEMENT=P2-mixed")


CASES = [
    *(quadratic(trial(module, name)) for module, names in TRIALS.items() for name in names),
    *(locking(value) for value in (0.499, 0.4999)),
    *(incompressible(value, fast=value == 0.4999) for value in (0.49, 0.4999, 0.499999)),
    quadratic(trial(geometry, "aspect ratio 100"), "P2-mixed"),
]
