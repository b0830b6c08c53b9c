"""Support: bodies held by contact alone are solved or refused; mechanisms of parts solved."""

from .case import BLOCK, Case
from .checks import LAWS

HELD = "hard/held"
WALLS = {"PLACE": "walls", "STEPS": 2, "UNIQUENESS": "no"}
SIZES = ({"SUBDOMAINS": 2, "N": 4}, {"SUBDOMAINS": 6, "N": 12})
SPRINGS, SPRUNG = "hard/springs", ({"SUBDOMAINS": 3, "H": 0.25}, {"SUBDOMAINS": 11, "H": 0.1})

CASES = [
    Case("floating body, pressed down", BLOCK, {"HOLD": "none"}, checks=LAWS, fast=True),
    Case("friction alone holds the body sideways", BLOCK,
         {"HOLD": "none", "PULL": 1e7, "LIFT": 0, "FRICTION": 1}, checks=LAWS),
    Case("contact alone removes a rigid motion", BLOCK, {"HOLD": "roller"}, checks=LAWS),
    Case("floating body on a frictionless floor", BLOCK,
         {"HOLD": "none", "FRICTION": 0, "PULL": 0, "LIFT": 0},
         checks=LAWS, warning="one of many solutions", fast=True),
    Case("floating body on too little friction", BLOCK, {"HOLD": "none", "FRICTION": 0.15},
         status=3, reason="no equilibrium: contact and friction cannot balance", fast=True),
    Case("floating body pulled up", BLOCK, {
         "HOLD": "none", "PRESS": -1e7}, status=3, reason="no equilibrium"),
    Case("squeezed between walls, friction carries the weight", HELD,
         {**WALLS, "SQUEEZE": 1e-3, "FRICTION": 0.4}, SIZES, LAWS, fast=True),
    Case("jammed by friction alone", HELD, {**WALLS, "FRICTION": 4}, SIZES, LAWS),
    Case("squeezed too little for its weight", HELD, {**WALLS, "SQUEEZE": 1e-4, "FRICTION": 0.2},
         SIZES, status=3, reason="no equilibrium was found: .* body 1", fast=True),
    Case("disc that may turn in a groove", HELD, {"PLACE": "groove", "FRICTION": 0, "STEPS": 1},
         SIZES, LAWS, warning="one of many solutions"),
    *(Case(f"body on springs alone, {stiffness:g} of its own stiffness", SPRINGS,
           {"STIFFNESS": stiffness * 1e5, "STEPS": 4}, SPRUNG, LAWS, fast=stiffness == 1e-2)
      for stiffness in (1e-4, 1e-2, 1e3)),
    Case("disc pushed in a groove", HELD, {
         "PLACE": "groove", "PUSH": 2e-5, "STEPS": 4}, SIZES, LAWS),
]
