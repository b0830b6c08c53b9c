"""Support: rigid motions that nothing holds are refused; mechanisms of subdomains are not the body's."""

from .case import Case
from .checks import dense, laws

BLOCK, PIECES = "hard/block", "hard/pieces"
BOTH = (dense(1e-6), laws(1e-6))
FREE = "the body can move without deforming"

CASES = [
    Case("floating body, pressed down", "support", BLOCK, {"HOLD": "none"}, status=3, reason=FREE, fast=True),
    Case("friction alone holds the body sideways", "support", BLOCK, {"HOLD": "none", "PULL": 1e7, "LIFT": 0, "FRICTION": 1},
         status=3, reason=FREE),
    Case("contact alone removes a rigid motion", "support", BLOCK, {"HOLD": "roller"}, status=3, reason=FREE),
]
