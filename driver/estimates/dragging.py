"""Shear of contact that slides as a whole: friction is at its bound on all meshes, which agree.

They agree by chance where a node sticks on finer ones. What slides on a mesh by less than ways err
may stick: all of it where the largest slip may be nothing but its own error, and where motion has
turned just before, those nodes that have slid least since. Over the longest way since then friction
has built up from none, or from the other direction, to its bound; over the way that a node lacks it
is by so much less.
"""

from ..results.touch import Touch
from .budget import Part, located


def unsure(values: dict, parts: dict[str, Part]) -> bool:
    """Whether anything slides is not sure: the largest slip may be its own error."""
    error = parts["slip"].error
    return error is not None and error >= values["slip"]


def lacking(touch: Touch, part: float) -> float:
    """Friction force that sliding nodes may lack of their bounds if ways err by a `part` of the
    longest that any has slid since it last stuck or turned.
    """
    way, force = touch.onward.T
    longest = way.max(initial=0.0)
    return float(force @ (part - way / longest).clip(0.0)) if longest > 0 else 0.0


def with_lacking(shear: Part, touch: Touch, values: dict, parts: dict[str, Part]) -> Part:
    """The part of the `shear` force, no less than what nodes may lack; ways err like the largest
    slip, by all of it where its error is not known.
    """
    error, slip = parts["slip"].error, values["slip"]
    part = 1.0 if error is None or error >= slip else error / slip
    return located(shear, lacking(touch, part)) if touch.dragged else shear
