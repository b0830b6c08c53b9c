"""Geometry: flat elements, slender bodies, awkward subdomains, contact at corners and supports."""

from .case import BLOCK, Case
from .checks import BOTH, LAWS, dense, laws

PIECES = "hard/pieces"
CUTS = ({"NX": 8, "NY": 4}, {"NX": 16, "NY": 8})


def layout(name: str, description: str, fast=False) -> Case:
    """The model example in the subdomains that hard/pieces calls `name`."""
    return Case(description, PIECES, {"LAYOUT": name}, sizes=CUTS, checks=BOTH,
                easy={"SUBDOMAINS": "4x2"}, fast=fast)


def ragged(parts: int) -> Case:
    """A partition by metis."""
    return Case(f"{parts} metis subdomains", PIECES, {"SUBDOMAINS": parts, "STEPS": 10},
                sweep=("metis subdomains", parts),
                sizes=({"NX": 24, "NY": 12}, {"NX": 36, "NY": 18}), checks=BOTH,
                easy={"SUBDOMAINS": "4x2"})


def aspect(value: float) -> Case:
    """Elements along the contact boundary `value` times as wide as high."""
    return Case(f"aspect ratio {value:g}", PIECES, {"SUBDOMAINS": "4x2", "ASPECT": value},
                checks=BOTH, sizes=({"NX": 16, "NY": 12}, {"NX": 32, "NY": 24}), easy={"ASPECT": 1},
                ratio=3.0, sweep=("aspect ratio of elements", value))


def graded(value: float, element: str) -> Case:
    """Triangles that grow by `value` along both axes, cut at random."""
    return Case(f"triangles graded 1:{value:.0e}, {element}", "hard/graded",
                {"RATIO": value, "ELEMENT": element, "STEPS": 4}, checks=LAWS,
                sizes=({"SUBDOMAINS": 5}, {"SUBDOMAINS": 13, "NX": 30, "NY": 24}),
                easy={"RATIO": 1}, ratio=3.0, sweep=(f"grading of triangles, {element}", value),
                fast=(value, element) == (1e4, "P2"))


def slender(value: float) -> Case:
    """A clamped beam `value` times as long as high, lifted at its end and pressed down a little."""
    return Case(f"slender body {value:g}:1", BLOCK,
                {"WIDTH": value, "PRESS": 4e9 / value**3, "PULL": 0,
                    "LIFT": 1e9 / value**2, "RTOL": 1e-11},
                sizes=({"SUBDOMAINS": "10x1", "CELLS": 2}, {"SUBDOMAINS": "20x1", "CELLS": 4}),
                # RTOL is of the bending, by (length / height)^3 larger than what pressures come
                # from, ten times that where they wave from element to element
                checks=(dense(max(1e-6, 1e-10 * value**3)), laws(1e-6)),
                sweep=("length over height", value), seconds=300)


def revolved(name: str, **more) -> Case:
    """A body of revolution; `more` are settings, `fast` and `sweep` as of all cases."""
    other = {key: more.pop(key) for key in ("fast", "sweep") if key in more}
    return Case(f"body of revolution: {name}", "hard/revolved", {"STEPS": 6, **more}, checks=LAWS,
                easy={"INNER": 1, "WIDTH": 1}, **other,
                sizes=({"SUBDOMAINS": "3x2", "CELLS": 4}, {"SUBDOMAINS": 13, "CELLS": 4}))


def curved(name: str, **more) -> Case:
    """Curved sides of quadratic elements; `more` are settings."""
    return Case(f"curved sides: {name}", "hard/curved", {"STEPS": 6, "ELEMENT": "P2", **more},
                checks=LAWS, easy={"RATIO": 1},
                sizes=({"SUBDOMAINS": 3}, {"SUBDOMAINS": 13, "SIDES": 30}))


CASES = [
    layout("elements", "subdomains of one element", fast=True),
    layout("sizes", "subdomains of very different sizes"),
    layout("chess", "subdomains touch in one node"),
    layout("stripes", "subdomains in separate pieces"),
    layout("scattered", "subdomains of scattered elements", fast=True),
    layout("island", "an enclosed subdomain", fast=True),
    Case("one subdomain", PIECES, {"SUBDOMAINS": 1},
         sizes=CUTS, checks=BOTH, easy={"SUBDOMAINS": "4x2"}),
    *(ragged(parts) for parts in (2, 8, 30, 100, 200)),
    *(aspect(value) for value in (1, 10, 100, 1000)),
    *(graded(value, element) for value in (1, 1e2, 1e4) for element in ("P1", "P2")),
    *(slender(value) for value in (10, 30, 100)),
    Case("contact on both sides of a convex corner", "hard/wedge", checks=LAWS,
         sizes=({"N": 8}, {"N": 16, "SUBDOMAINS": 8})),
    Case("one contact boundary round a convex corner", "hard/slope",
         {"LEFT": "contact"}, checks=LAWS, sizes=({"N": 8}, {"N": 16, "SUBDOMAINS": 8})),
    Case("one label round a square hole", "hard/hole", {"STEPS": 8}, checks=LAWS,
         sizes=({}, {"H": 0.125, "SUBDOMAINS": 9}), fast=True),
    Case("square hole, much friction", "hard/hole",
         {"FRICTION": 1, "GAP": 0, "STEPS": 8}, checks=LAWS,
         sizes=({}, {"H": 0.125, "SUBDOMAINS": 9})),
    Case("contact on three sides of a hole", "hard/hole", {"SIDES": 3, "STEPS": 8}, checks=LAWS,
         sizes=({}, {"H": 0.125, "SUBDOMAINS": 9})),
    Case("slanted contact ends at a roller", "hard/slope", {"LEFT": "roller"},
         checks=LAWS, sizes=({"N": 8}, {"N": 16, "SUBDOMAINS": 8}), fast=True),
    Case("slanted contact ends at a roller, with gap", "hard/slope",
         {"LEFT": "roller", "GAP": 0.003}, checks=LAWS,
         sizes=({"N": 8}, {"N": 16, "SUBDOMAINS": 8})),
    revolved("cells on the axis", fast=True),
    revolved("a hole of 1e-4 of the radius", INNER=1e-4),
    # the wider, the less its hoops resist: a ring of 300 radii takes 25 times the products
    *(revolved(f"a ring of {value:g} times its width", INNER=value, WIDTH=1,
               sweep=("hole over width of a ring", value)) for value in (1, 10, 100)),
    revolved("stiffness jumps by 1e6", JUMP=1e6),
    revolved("quadratic elements on the axis", ELEMENT="P2"),
    revolved("much friction, units of 1e9 and 1e-12", FRICTION=2, LENGTH=1e9, STRESS=1e-12),
    curved("an elliptic hole"),
    curved("a slit, seven times as wide as high", RATIO=7, SIDES=16),
    curved("sides of 40 degrees", RATIO=1, SIDES=9),
    curved("nearly incompressible", ELEMENT="P2-mixed", POISSON=0.4999),
    curved("much friction, units of 1e9 and 1e-12", FRICTION=2, LENGTH=1e9, STRESS=1e-12),
    Case("sides that turn a triangle inside out", "hard/curved",
         {"RATIO": 1, "RIM": 1.05, "ELEMENT": "P2"}, status=2,
         sizes=({"SIDES": 12}, {"SIDES": 16}),
         reason="turn a triangle inside out, at"),
    Case("rough sphere", "sphere", {"STEPS": 6}, checks=LAWS,
         sizes=({"H": 0.004}, {"H": 0.002, "SUBDOMAINS": 7})),
    Case("curved contact boundary", "mindlin", {"STEPS": 5}, checks=LAWS,
         sizes=({"H": 0.002}, {"H": 0.001})),
]
