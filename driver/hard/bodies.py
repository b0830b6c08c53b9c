"""Two and more bodies: stiffness, meshes and gaps that differ, towers that friction holds."""

from .case import Case
from .checks import BOTH, LAWS, laws, same_as

PAIR, TOWER, STACK = "hard/pair", "hard/tower", "stack"
STEPS = {"STEPS": 4}
MOVED = {**STEPS, "HOLD": "moved"}  # both bodies are held: a dense oracle knows the answer
SIZES = ({"SUBDOMAINS": "2x2", "H": 0.25}, {"SUBDOMAINS": "4x4", "H": 0.125})
# subdomains of the graph partitioner, ends at the interface
ANY = ({"SUBDOMAINS": 2, "H": 0.2}, {"SUBDOMAINS": 9, "H": 0.2})
SIX = ({"SUBDOMAINS": 6}, {"SUBDOMAINS": 24, "H": 0.1})
ROUNDING = 1e-9  # as in scale.py


def jump(value: float) -> Case:
    """The upper, free block `value` times as stiff; contact nodes on the softer side."""
    return Case(f"E of the body on top times {value:.0e}", PAIR,
                {**STEPS, "JUMP": value, "NODES": "upper" if value < 1 else "lower"}, SIZES, LAWS,
                easy={"JUMP": 1}, ratio=3.0, fast=value == 1e6,
                sweep=("E of the body on top", value))


def stiff_side(value: float) -> Case:
    """Contact nodes on the stiffer, finer side: alternating pressures there deform very little."""
    return Case(f"contact nodes on the body with E times {value:.0e}", PAIR,
                {**STEPS, "JUMP": value}, SIZES, LAWS,
                easy={"JUMP": 1}, ratio=3.0 if value <= 1e3 else None,
                sweep=("the same, contact nodes on top", value), fast=value == 1e3)


def ratio(value: float, nodes: str) -> Case:
    """Elements of the upper block so many times as long, contact nodes on the side `nodes`."""
    of = "finer" if (value < 1) == (nodes == "upper") else "coarser"
    return Case(f"elements on top {value:g} times as long, nodes on the {of} side", PAIR,
                {**MOVED, "RATIO": value, "NODES": nodes},
                ({"SUBDOMAINS": "2x1", "H": 0.1}, {"SUBDOMAINS": "2x1", "H": 0.05}),
                BOTH, easy={"RATIO": 1}, ratio=3.0,
                sweep=(f"ratio of the meshes, nodes on the {of} side", value))


def far(value: float) -> Case:
    """Units of the pair."""
    return Case(f"two bodies, units: length times {value:.0e}, stress times {1 / value:.0e}",
                PAIR, {**STEPS, "LENGTH": value, "STRESS": 1 / value}, SIZES,
                (same_as(ROUNDING, value, 1 / value, options={"LENGTH": 1, "STRESS": 1}),
                 laws(1e-6)))


CASES = [
    *(jump(value) for value in (1e-6, 1e-3, 1, 1e3, 1e6)),
    stiff_side(1e3), stiff_side(1e6),
    *(ratio(value, nodes) for nodes in ("upper", "lower") for value in (0.1, 1, 10)),
    Case("a clearance closes", PAIR, {**MOVED, "GAP": 4e-4}, SIZES, BOTH),
    Case("bodies that overlap", PAIR, {**MOVED, "GAP": -4e-4}, SIZES, BOTH, fast=True),
    Case("two bodies, F = 3", PAIR, {**MOVED, "FRICTION": 3}, SIZES, LAWS),
    Case("a body pushed to 0.2 % below what friction holds", PAIR,
         {**STEPS, "PUSH": 5.988e-4}, SIZES, LAWS, fast=True),
    Case("a body pushed to 0.2 % above what friction holds", PAIR,
         {"STEPS": 1, "PUSH": 6.012e-4}, SIZES, status=3, reason="no equilibrium: .* body 2"),
    Case("the partition ends at the interface", PAIR, STEPS, ANY, LAWS),
    far(1e9), far(1e-9),
    *(Case(f"a block on a block{what}", PAIR, {**STEPS, **options}, SIZES, LAWS)
      for what, options in (("", {}), (", F = 50", {"FRICTION": 50, "UNIQUENESS": "no"}))),
    Case("a floating stack of three", STACK, STEPS,
         ({"SUBDOMAINS": 3, "H": 0.2}, {"SUBDOMAINS": 12}), LAWS),
    Case("a floating stack of six", TOWER, STEPS, SIX, LAWS, fast=True),
    *(Case(f"a floating stack of six, E times {value:g} in every other", TOWER,
           {**STEPS, "JUMP": value}, SIX, LAWS,
           easy={"JUMP": 1}, ratio=3.0) for value in (1e3, 1e6)),
    Case("a floating stack of six, nearly sliding", TOWER, {**STEPS, "PUSH": 0.499}, SIX, LAWS),
    Case("a floating stack of six, sliding", TOWER, {"STEPS": 1, "PUSH": 0.501}, SIX, status=3,
         reason="no equilibrium: .* bodies 1, 2, 3, 4, 5, 6"),
]
