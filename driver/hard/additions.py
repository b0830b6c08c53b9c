"""What some random scenes have beside the rest: a slit, springs, an axis of revolution, a body that
nothing touches, rough surfaces.

Drawn after all else, by dice of their own: what else a seed draws stays the same.
"""

from dataclasses import replace

import numpy as np

from .composition import Hold
from .dice import Dice
from .shapes import block, lattice, with_slit

LIPS = 81  # label of a slit's upper lip, the lower one's is the next
PLAIN = ("block", "graded block", "quadrilateral")  # outlines with room for a slit
SLITS, OTHERS = 0.25, 0.08  # shares of the scenes that may have one


def add(dice: Dice, scene) -> None:
    """Change the bodies of `scene`, a writer of the generator, and what it declares."""
    for make, share in ((_slit, SLITS), (_springs, OTHERS), (_revolve, OTHERS),
                        (_bystander, OTHERS), (_rough, OTHERS)):
        if dice.chance(share):
            make(dice, scene)


def _slit(dice: Dice, scene) -> None:
    """A slit inside one body, whose lips touch one another and share the nodes at its tips.

    They are arcs; the gap beyond their geometry closes it but for what gaps elsewhere have.
    """
    bodies = scene.bodies
    shape = bodies.shapes[0]
    apart = scene.declared.get("sliding") == "large"  # which the judge does not follow in pairs
    if apart or len(bodies.shapes) > 1 or bodies.rectangle or shape.name not in PLAIN:
        return
    x, y = np.mean(bodies.reach, axis=1)
    length = dice.number(0.3, 0.6) * float(np.ptp(bodies.reach, axis=1).min())
    angle, rise = dice.number(-1.0, 1.0), dice.number(0.03, 0.06) * length
    slit = with_slit(shape, (float(x), float(y)), length, angle, rise, LIPS)
    scene.bodies = replace(bodies, shapes=(slit,), pairs=((LIPS, LIPS + 1),))
    start, way = slit.sides[-2].start[0], length * np.cos(angle)
    along = f"(x - {scene.number(scene.size * start)})/{scene.number(scene.size * way)}"
    closed = scene.number(8 * scene.size * rise)
    room = scene.number(scene.far * dice.pick(0.0, 0.0, 0.1, -0.1))
    scene.say("contactPair()", f"{LIPS}, {LIPS + 1}")
    scene.say("pairGap()", f"({room} - {closed}*{along}*(1. - {along}))")
    scene.declared["slit"] = "yes"


def _springs(dice: Dice, scene) -> None:
    """A side that nothing touches or holds rests on springs, along its normal or its tangent too.
    """
    bodies = scene.bodies
    taken = {hold.label for hold in bodies.holds} | set(bodies.contact) | {
        label for pair in bodies.pairs for label in pair}
    rest = [side.label for shape in bodies.shapes for side in shape.sides
            if side.label not in taken]
    if not rest:
        return
    stiffness = scene.modulus / scene.size * dice.pick(1e-4, 1e-2, 1.0, 100.0)
    scene.say("foundation()", str(dice.pick(*rest)))
    scene.say("foundationNormal()", scene.number(stiffness))
    if dice.chance(0.5):
        scene.say("foundationTangential()", scene.number(stiffness * dice.pick(0.1, 1.0)))
    scene.declared["springs"] = "yes"


def _revolve(dice: Dice, scene) -> None:
    """The bodies are sections of rings about an axis to their left."""
    shifts = "obstacles" in scene.declared or scene.declared.get("sliding") == "large"
    plane = any(name in macro for macro in scene.macros
                for name in ("planeStress", "pointLoad", "c11", " (x < ", "(x - "))
    if shifts or plane or scene.bodies.rectangle:
        return
    away = dice.pick(0.3, 1.0, 3.0) - scene.bodies.reach[0][0]
    scene.bodies = replace(scene.bodies, shapes=tuple(
        shape.shifted(away) for shape in scene.bodies.shapes))
    scene.macros.insert(0, "macro axisymmetric() 1 //")
    scene.declared["revolution"] = "yes"


def _bystander(dice: Dice, scene) -> None:
    """A block to the right of the others, clamped at one or two sides, without contact.

    Where two clamped sides meet a triangle may have no dof that is free.
    """
    bodies = scene.bodies
    if bodies.rectangle or bodies.piece or "load" not in scene.patterns:
        return
    (_, right), (low, _) = bodies.reach
    body = block(right + 0.4, low, dice.number(0.4, 0.9), dice.number(0.3, 0.8), 301)
    if dice.chance(0.6):
        body = lattice(body, (dice.whole(2, 5), dice.whole(2, 4)))
    clamped = [311, 301][: dice.whole(1, 2)]
    scene.bodies = replace(bodies, shapes=(*bodies.shapes, body),
                           lengths=(*bodies.lengths, dice.pick(0.15, 0.3)),
                           holds=(*bodies.holds, *(Hold("clamped", side) for side in clamped)))
    stress = scene.modulus * scene.strain * dice.pick(0.01, 0.1, 1.0)
    held = f"on({', '.join(map(str, clamped))}, u1 = 0., u2 = 0.)"
    pulled = f"traction(321, {scene.number(stress)}, {scene.number(-stress)})"
    if not scene.extend("support()", held):
        scene.say("support()", held)
    scene.extend(f"load{1 + scene.patterns.index('load')}()", pulled)
    scene.declared["bystander"] = "yes"


def _rough(dice: Dice, scene) -> None:
    """Surfaces yield, from hardly to by more than the bodies.

    All do: where a rough one and a smooth one meet in a corner the laws are not both followed.
    """
    if not (scene.bodies.contact or scene.bodies.pairs):
        return
    exponent = dice.pick(1.0, 1.5, 0.7, weights=(3, 1, 1))
    if scene.declared["contact"] == "bilateral":
        exponent = 1.0
    stiffness = scene.modulus * scene.strain / scene.far**exponent
    scene.say("normalCompliance()", scene.by_label(
        lambda: stiffness * dice.pick(0.1, 1.0, 30.0, 1e4, weights=(1, 2, 2, 1))))
    if exponent != 1 or dice.chance(0.2):
        scene.say("normalComplianceExponent()", str(exponent))
    scene.declared["surface"] = "rough"
