"""Material: stiffness that jumps, has a direction, or hardly lets the body change its volume."""

import math

from .case import BLOCK, Case
from .checks import dense, laws

BOTH = (dense(1e-5), laws(1e-5))
# stiff pieces between compliant ones move nearly rigidly: multipliers answer to the QP's 1e-10
# times the contrast
LOOSE = (dense(1e-3), laws(1e-5))
WHERE = {"pieces": "from subdomain to subdomain", "inside": "inside subdomains",
         "halves": "halfway", "layers": "in layers thinner than elements"}


def jump(value: float, board: str, fast=False) -> Case:
    """Young's modulus jumps by `value` over the chess board `board`."""
    where = WHERE[board]
    return Case(f"E jumps by {value:.0e} {where}", BLOCK, {"JUMP": value, "BOARD": board},
                sizes=({"SUBDOMAINS": "4x2", "CELLS": 8 if board == "halves" else 4},
                       {"SUBDOMAINS": "8x4", "CELLS": 4}),
                checks=LOOSE if abs(math.log10(value)) > 3 else BOTH, easy={"JUMP": 1},
                sweep=(f"jump of E {where}", value), fast=fast)


def jump_without_contact(value: float, board: str) -> Case:
    """The same out of reach of the foundation: the jump's effect on the operator alone."""
    where = WHERE[board]
    return Case(f"E jumps by {value:.0e} {where}, no contact", BLOCK,
                {"JUMP": value, "BOARD": board, "GAP": 1e9, "FRICTION": 0, "STEPS": 1},
                easy={"JUMP": 1}, ratio=2.0, checks=(laws(1e-5),),
                sweep=(f"jump of E {where}, no contact", value), fast=value == 1e-6)


def fibre(stiffness: float) -> Case:
    """Fibres `stiffness` times as stiff along as across, at 30 degrees."""
    return Case(f"fibres stiffer by {stiffness:g}", "hard/fibre", {"STIFFNESS": stiffness},
                checks=BOTH, easy={"STIFFNESS": 1}, ratio=3.0,
                sweep=("stiffness of fibres", stiffness))


def layers(value: float, element: str) -> Case:
    """Young's modulus jumps by `value` from layer to layer within quadratic elements."""
    return Case(f"E jumps by {value:.0e} {WHERE['layers']}, {element}", BLOCK,
                {"JUMP": value, "BOARD": "layers", "ELEMENT": element, "STEPS": 4},
                sizes=({"SUBDOMAINS": "1x1", "CELLS": 8}, {"SUBDOMAINS": 9, "CELLS": 8}),
                checks=(laws(1e-5),), easy={"JUMP": 1}, ratio=3.0,
                fast=(value, element) == (1e6, "P2"),
                sweep=(f"jump of E {WHERE['layers']}, {element}", value))


def poisson(value: float) -> Case:
    """P1 near incompressibility: solved, and the run warns that it locks (see element.py)."""
    return Case(f"Poisson's ratio {value:g}", BLOCK, {"POISSON": value}, checks=BOTH,
                easy={"POISSON": 0.277}, sweep=("1/(1 - 2 nu)", 1 / (1 - 2 * value)),
                warning="P1 elements lock.*ELEMENT=P2-mixed" if value > 0.48 else "")


CASES = [
    *(jump_without_contact(value, board) for board in ("pieces", "halves", "inside")
      for value in (1e3, 1e6, 1e-3, 1e-6)),
    *(jump(value, "pieces", fast=value == 1e6) for value in (1, 1e3, 1e6, 1e-3, 1e-6)),
    *(jump(value, "halves") for value in (1, 1e3, 1e6, 1e-3, 1e-6)),
    *(jump(value, "inside") for value in (1, 1e3, 1e6, 1e-3, 1e-6)),
    *(layers(value, element) for value in (1e3, 1e6, 1e-3, 1e-6)
      for element in ("P2", "P2-mixed")),
    *(fibre(value) for value in (1, 10, 100, 1000)),
    *(poisson(value) for value in (0.3, 0.4, 0.49, 0.499, 0.4999)),
]
