"""Random scenes, as a stranger would write them: drawn from a seed, for `make hard FAMILY=random`.

The same seed gives the same scene. `draw` composes bodies and contact (composition.py), then
material, laws, supports, loads and histories, and says at how many subdomains to solve it.
"""

from dataclasses import dataclass

import numpy as np

from ..text import assignments
from . import additions, composition
from .dice import Dice
from .shapes import number_text

UNITS = (("m", "Pa", 1.0, 1.0), ("mm", "MPa", 40.0, 210e3), ("m", "Pa", 2.0, 2e11),
         ("um", "MPa", 1e3, 3e3), ("1", "1", 1.0, 1.0), ("m", "Pa", 1e-3, 5e6))
# of t in [0, 1], by name
HISTORIES = {"ramp": "t", "early": "min(1., 2.5*t)", "hump": "(-4*t^2 + 5*t)",
             "unloading": "(1. - abs(2*t - 1.))", "reversal": "sin(2*pi*t)",
             "kink": "(t < 0.5 ? 2*t : 2 - 1.5*t)", "spike": "(abs(t - 0.5) < 0.11 ? 8. : t)",
             "late": "max(0., (t - 0.7)/0.3)", "constant": "1."}
JUMPS = (1e-3, 1e-2, 0.1, 10.0, 1e3, 1e6)
# a scene that is bad on purpose: what is wrong, what is replaced, by what, and the refusal
SPOILT = (("a label that the mesh lacks", "macro contact() ", "macro contact() 77, ", "label 77"),
          ("a negative coefficient", "macro friction() ", "macro friction() -", "negative"),
          ("contact declared twice", "macro contact() {first}", "macro contact() {first}, {first}",
           "twice"))


# of loads that are put on until t = 0.5 and repeated from there on, and that set in there
REPEATED = "min(1., 2*t)", ("(t < 0.5 ? 0. : sin(4*pi*t))", "(t < 0.5 ? 0. : sin(2*pi*t)^2)")
OTHER, LATEST, LAST = 2**40 + 5, 2**40 + 7, 2**40 + 9  # added to the seed of dice that came later


@dataclass(frozen=True)
class RandomScene:
    """A scene, what it declares (key: value), and how it is run."""

    seed: int
    text: str
    declared: dict[str, str]
    cuts: tuple[dict[str, str], ...]  # mesh options of the runs that must agree
    options: dict[str, str]  # of all runs: element, steps
    refusal: str = ""  # of a scene that is bad on purpose: what its refusal says


def draw(seed: int) -> RandomScene:
    """The scene of a seed."""
    dice = Dice(seed)
    length, stress, size, modulus = dice.pick(*UNITS)
    element = dice.pick("P1", "P2", "P2-mixed", weights=(6, 3, 1))
    bodies = composition.compose(dice, element != "P1")
    strain = dice.pick(1e-4, 1e-3, 5e-3)
    scene = _Writer(dice, bodies, size, modulus, strain)
    scene.material(element)
    scene.supports_and_loads()
    scene.contact()
    scene.histories()
    scene.motion(Dice(seed + OTHER))
    scene.later(Dice(seed + LATEST), element)
    additions.add(Dice(seed + LAST), scene)
    bodies, cuts = scene.bodies, _cuts(dice, bodies)
    options = {"element": element, **scene.options}
    text = "\n".join([
        f"// random-{seed}.edp - {bodies.title}", f"//   make run SCENE=random-{seed}.edp "
        + assignments({**options, **cuts[-1]}),
        'include "scene.idp"', "", f'units("{length}", "{stress}");', 'subdomains("4");',
        *scene.calls, *bodies.text(size), "", *scene.macros, "", 'include "export.idp"', ""])
    refusal = ""
    if dice.chance(0.02):
        text, refusal = _spoil(dice, text, scene)
    declared = {"outline": bodies.name, "labels": bodies.pattern, "element": element,
                **scene.declared}
    return RandomScene(seed, text, declared, cuts, options, refusal)


def _spoil(dice: Dice, text: str, scene: "_Writer") -> tuple[str, str]:
    """The text made bad in some way that it admits, and what its refusal says."""
    first = scene.bodies.contact[0] if scene.bodies.contact else ""
    ways = [way for way in SPOILT if way[1].format(first=first) in text
            and not (way[3] == "negative" and "friction() 0." in text)]
    if not ways:
        return text, ""
    scene.declared["spoilt"], old, new, refusal = dice.pick(*ways)
    return text.replace(old.format(first=first), new.format(first=first)), refusal


def _cuts(dice: Dice, bodies) -> tuple[dict[str, str], ...]:
    """One subdomain a body, an odd number, many: mesh options."""
    if bodies.rectangle:
        return tuple({"subdomains": cut, "cells": cells} for cut, cells in dice.sample(
            (("1x1", "6"), ("3x1", "4"), ("6x3", "2"), ("12x6", "1"), ("3x3", "2")), 3))
    most = max(bodies.triangles // 2, 2)
    odd, many = dice.pick(3, 5, 7, 9), dice.pick(12, 16, 23, 30)
    cuts = [{"subdomains": str(number)} for number in sorted({1, min(odd, most), min(many, most)})]
    if bodies.piece and dice.chance(0.5):
        cuts[-1] = {"subdomains": "piece"}
    return tuple(cuts)


class _Writer:
    """Collects calls and macros of a scene."""

    def __init__(self, dice: Dice, bodies, size: float, modulus: float, strain: float):
        self.dice, self.bodies, self.size, self.modulus = dice, bodies, size, modulus
        self.strain, self.far = strain, strain * size  # of the deformation
        self.calls, self.macros, self.declared, self.options = [], [], {}, {}
        self.patterns: list[str] = []  # kinds of the numbered loads
        self.softest = 1.0

    def say(self, macro: str, content: str) -> None:
        """One macro."""
        self.macros.append(f"macro {macro} {content} //")

    def extend(self, macro: str, term: str) -> bool:
        """Add a term to the sum that a macro is; False if there is none of this name."""
        for place, line in enumerate(self.macros):
            if line.startswith(f"macro {macro} "):
                self.macros[place] = f"{line[:-3]} + {term} //"
                return True
        return False

    def number(self, value: float) -> str:
        """A number in the scene."""
        return number_text(float(f"{value:.4g}") + 0.0)  # no -0.0

    # ---- material ------------------------------------------------------------------------------
    def material(self, element: str) -> None:
        """One material, a jump inside the body, or one a body."""
        dice, E, count = self.dice, self.number(self.modulus), len(self.bodies.shapes)
        nu = dice.pick(0.0, 0.2, 0.3, 0.3, 0.45)
        if element == "P2-mixed" and dice.chance(0.4):
            nu = 0.4999
        jump = dice.pick(*JUMPS) if dice.chance(0.35) else 1.0
        self.declared["jump"] = f"{jump:g}" if jump != 1 else "none"
        self.softest = min(1.0, jump)
        content = E
        if jump != 1 and count > 1:
            content = f"(region == {dice.whole(0, count - 1)} ? {self.number(jump)}*{E} : {E})"
        elif jump != 1:
            axis, (low, high) = dice.pick(("x", self.bodies.reach[0]), ("y", self.bodies.reach[1]))
            place = self.size * (low + dice.number(0.3, 0.7) * (high - low))
            content = f"({axis} < {self.number(place)} ? {E} : {self.number(jump)}*{E})"
        if element != "P2-mixed" and dice.chance(0.06):
            self.declared["material"] = "directed"
            for name, share in (("c11", 1.0), ("c12", 0.2), ("c13", 0.05), ("c22", dice.pick(
                    0.3, 3.0)), ("c23", 0.0), ("c33", dice.pick(0.1, 0.5))):
                self.say(f"{name}()", f"({self.number(share)}*{content})")
            return
        if dice.chance(0.15):
            self.say("planeStress()", "1")
        self.say("young()", content)
        self.say("poisson()", self.number(nu))

    # ---- supports and loads --------------------------------------------------------------------
    def supports_and_loads(self) -> None:
        """How every body is held and what presses it."""
        dice, fixed, moved = self.dice, [], []
        for hold in self.bodies.holds:
            if hold.kind == "clamped":
                fixed.append(f"on({hold.label}, u1 = 0., u2 = 0.)")
            elif hold.kind == "roller":
                fixed.append(f"on({hold.label}, u{1 + hold.axis} = 0.)")
            elif hold.kind == "moved":
                moved.append(hold)
        self.declared["support"] = " and ".join(dict.fromkeys(
            hold.kind for hold in self.bodies.holds)) or "none"
        if fixed:
            self.say("support()", " + ".join(fixed))
        for hold in moved[:1]:
            press = self.far * dice.pick(0.3, 1.0, 3.0) * np.array(self.bodies.press)
            self._load("displacement", f"on({hold.label}, u1 = {self.number(press[0])}, "
                                       f"u2 = {self.number(press[1])})")
            if dice.chance(0.6):
                push = self.far * dice.pick(0.1, 0.5, 2.0) * np.array(self._across())
                self._load("displacement", f"on({hold.label}, u1 = {self.number(push[0])}, "
                                           f"u2 = {self.number(push[1])})")
        self._tractions(bool(moved))
        self._volume()

    def _across(self) -> tuple[float, float]:
        """Direction across the press, to either side."""
        x, y = self.bodies.press
        turn = self.dice.pick(-1.0, 1.0)
        return -turn * y, turn * x

    def _load(self, kind: str, content: str) -> None:
        self.patterns.append(kind)
        self.say(f"{kind}{len(self.patterns)}()", content)

    def _tractions(self, moved: bool) -> None:
        """A press on one side, a push on another."""
        dice, sides = self.dice, self.bodies.loaded
        stress = self.modulus * self.strain * min(1.0, max(self.softest, 1e-3)) ** 0.5
        if sides and (not moved or dice.chance(0.2)):
            sign = -1.0 if dice.chance(0.02 if self.bodies.loose else 0.08) else 1.0
            x, y = sign * stress * dice.pick(0.3, 1.0) * np.array(self.bodies.press)
            term = f"traction({sides[0].label}, {self.number(x)}, {self.number(y)})"
            if dice.chance(0.15):
                term = f"pressure({sides[0].label}, {self.number(sign * stress)})"
            self._load("load", term)
        if sides and dice.chance(0.6):
            # bodies that friction alone holds are pushed little
            shares = (0.01, 0.03, 0.1) if self.bodies.loose else (0.1, 0.5, 1.0)
            share = dice.pick(*shares)
            x, y = stress * share * np.array(self._across())
            side = dice.pick(*sides)
            self._load("load", f"traction({side.label}, {self.number(x)}, {self.number(y)})")

    def _volume(self) -> None:
        """Weight, thermal strain."""
        dice, free, sides = self.dice, not self.bodies.holds, self.bodies.loaded
        stress = self.modulus * self.strain
        if dice.chance(0.5 if free else 0.12) or not self.patterns:
            weight = self.modulus * self.strain / self.size * dice.pick(0.1, 1.0)
            x, y = weight * np.array(self.bodies.press)
            self._load("bodyForce", f"[{self.number(x)}, {self.number(y)}]")
            self.declared["body force"] = "yes"
        if sides and dice.chance(0.04):
            (x, y), force = np.multiply(sides[0].start, self.size), stress * self.size * 0.1
            values = (x, y, *(force * np.array(self.bodies.press)))
            self._load("pointLoad", f"[{', '.join(number_text(v + 0.0) for v in values)}]")
            self.declared["point load"] = "yes"
        if dice.chance(0.08) and "material" not in self.declared:
            self._load("thermal", self.number(self.strain * dice.pick(-1.0, 0.3, 1.0)))
            self.declared["thermal"] = "yes"

    # ---- contact -------------------------------------------------------------------------------
    def contact(self) -> None:
        """Labels, gaps and the law of friction."""
        bodies, dice = self.bodies, self.dice
        if bodies.contact:
            self.say("contact()", ", ".join(map(str, bodies.contact)))
        if bodies.pairs:
            self.say("contactPair()", ", ".join(f"{a}, {b}" for a, b in bodies.pairs))
        self._gaps()
        law = dice.pick("frictionless", "coulomb", "coulomb by label", "tresca", "cohesion",
                        "slip law", "displacement law",
                        weights=(1 if bodies.loose else 3, 8, 4, 2, 1.5, 1.5, 0.7))
        self.declared["law"] = law
        stress = self.modulus * self.strain
        if law == "tresca":
            self.say("tresca()", self.by_label(lambda: stress * dice.pick(0.0, 0.01, 0.1, 1.0)))
        elif law != "frictionless":
            same = law != "coulomb by label"
            largest = dice.pick(0.1, 0.3, 0.5, 0.8, 1.5, 10.0, 1e3, weights=(3, 5, 3, 2, 1, .7, .7))
            self.declared["friction"] = "> 0.8" if largest > 0.8 else "<= 0.8"
            content = self.number(largest) if same else self.by_label(
                lambda: largest * dice.pick(0.0, 0.3, 0.6, 1.0))
            self.say("friction()", content)
        if law == "cohesion":
            self.say("cohesion()", self.by_label(lambda: stress * dice.pick(0.0, 0.03, 0.3)))
        if law in ("slip law", "displacement law"):
            name = "slipFactor" if law == "slip law" else "displacementFactor"
            reach, low = self.far * dice.pick(0.1, 1.0), dice.pick(0.4, 0.8, 1.3)
            self.calls.append(f"real slipRange = {self.number(reach)};")
            self.say(f"{name}(s)", f"(1. + ({self.number(low)} - 1.)*s/slipRange)")
        if law != "frictionless" and dice.chance(0.06):
            self.say("initialX()", self.number(self.far * dice.pick(-0.3, 0.1)))
            self.declared["initial state"] = "displaced"
        elif law in ("coulomb", "coulomb by label") and dice.chance(0.03):
            self.say("preload()", "1")
            self.declared["initial state"] = "preload"
        self._bilateral()

    def _bilateral(self) -> None:
        self.declared["contact"] = "unilateral"
        if self.dice.chance(0.07):
            self.say("bilateral()", "1")
            self.declared["contact"] = "bilateral"

    def _gaps(self) -> None:
        """Distances of several scales, the same or one a label."""
        bodies, dice = self.bodies, self.dice
        faces_down = bodies.pattern == "a side" and bodies.press[1] < -0.98
        if faces_down and bodies.name != "half disc" and dice.chance(0.25):
            # the ground: a plane, or a cylinder from below, a little under the body; the ends of a
            # half disc face to the sides
            x, y = (self.size * np.array(bodies.reach)).tolist()
            ground = self.number(y[0] - dice.pick(0.0, 0.3, -0.2) * self.far)
            content = f"y - {ground}"
            # (ends of a half circle face away from a cylinder: no contact can be there)
            if dice.chance(0.4) and "disc" not in bodies.name:
                content += f" + (x - {self.number(sum(x) / 2)})^2*{self.number(1 / self.size)}/10."
            self.say("obstacle(x, y)", f"({content})")
            self.declared["gap"] = "obstacle"
            return
        names, weights = ("none", "tiny", "deformation", "large", "negative", "curved", "mixed"), (
            8, 2, 3, 1, 2, 2, 2)
        gap = dice.pick(*names, weights=weights)
        scale = {"tiny": 1e-9 * self.size, "deformation": self.far * dice.number(0.1, 1.0),
                 "large": 20 * self.far, "negative": -self.far * dice.number(0.05, 0.5)}
        self.declared["gap"] = gap
        if gap == "none":
            return
        if gap == "curved":
            centre = self.number(self.size * (bodies.reach[0][0] + bodies.reach[0][1]) / 2)
            content = f"{self.number(self.far / self.size**2)}*(x - {centre})^2"
        elif gap == "mixed":
            content = self.by_label(lambda: dice.pick(0.0, *scale.values()))
        else:
            content = self.number(scale[gap])
        if bodies.contact:
            self.say("gap()", content)
        elif gap != "mixed":
            self.say("pairGap()", content)

    def motion(self, dice: Dice) -> None:
        """Obstacles that shift, in some scenes: each label's by as much as it likes.

        Dice of their own: what else a seed draws stays the same.
        """
        labels = self.bodies.contact
        if not labels or not dice.chance(0.1):
            return
        for axis in "XY" if dice.chance(0.5) else dice.pick("X", "Y"):
            if self.declared.get("gap") == "curved" and self._slides(axis):
                continue  # its shape would have to shift as well
            content = self.number(0.0)
            for label in labels:
                way = self.number(self.far * dice.pick(-1.0, -0.1, 0.0, 0.1, 1.0, 100.0 * (
                    axis == "X" and len(labels) == 1)))
                content = f"(label == {label} ? {way} : {content})"
            history = dice.pick(*(name for name in HISTORIES if name != "constant"))
            self.say(f"obstacle{axis}(t)", f"({content}*{HISTORIES[history]})")
            self.declared["obstacles"] = "shift"

    def _slides(self, axis: str) -> bool:
        """Whether an obstacle that shifts along `axis` slides along some contact side."""
        sides = (side for shape in self.bodies.shapes
                 for side in shape.labelled(*self.bodies.contact))
        return any(side.centre is not None
                   or np.abs(np.delete(side.normal, "XY".index(axis)))[0] > 1e-9 for side in sides)

    def later(self, dice: Dice, element: str) -> None:
        """Curved sides, sliding of any length along planes, cycles: in some scenes that admit them.

        What else a seed draws stays the same, but for the histories of cycles.
        """
        bodies, declared = self.bodies, self.declared
        arcs = [side.label for shape in bodies.shapes for side in shape.sides
                if side.centre is not None]
        if arcs and element != "P1" and dice.chance(0.5):
            self.say("curved()", ", ".join(map(str, dict.fromkeys(arcs))))
            declared["sides"] = "curved"
        since = "obstacles" in declared or "initial state" in declared
        plane = not arcs and not bodies.pairs and declared["gap"] not in (
            "curved", "mixed", "obstacle")
        apart = declared["contact"] == "unilateral" and declared["law"] != "displacement law"
        if plane and apart and not since and dice.chance(0.15):
            self.say("largeSliding()", self.number(3 * self.size))
            declared["sliding"] = "large"
        elif declared["law"] != "frictionless" and "steps" in self.options and (
                not since and dice.chance(0.1)):
            self._repeat(dice)

    def _repeat(self, dice: Dice) -> None:
        """Histories that repeat from the middle on, twice or three times."""
        always, sometimes = REPEATED
        self.macros = [macro for macro in self.macros if not macro.startswith("macro amplitude")]
        for number, kind in enumerate(self.patterns, 1):
            steady = number == 1 or kind == "bodyForce" or dice.chance(0.3)
            self.say(f"amplitude{number}(t)", always if steady else dice.pick(*sometimes))
        self.options["steps"] = str(2 * dice.whole(2, 4))
        self.declared["cycles"] = str(dice.whole(2, 3))
        self.say("cycles()", self.declared["cycles"])
        self.say("cycleStart()", "0.5")

    def by_label(self, value) -> str:
        """A number for every label with contact nodes."""
        labels = [*self.bodies.contact, *(a for a, _ in self.bodies.pairs)]
        content = self.number(value())
        for label in labels[1:]:
            content = f"(label == {label} ? {self.number(value())} : {content})"
        return content

    # ---- time ----------------------------------------------------------------------------------
    def histories(self) -> None:
        """Static, or some steps with a history for every load."""
        dice = self.dice
        if dice.chance(0.15):
            self.declared["history"] = "static"
            return
        self.options["steps"] = str(dice.whole(2, 6))
        self.calls.append("quasistatic(1.);")
        used = []
        for number, kind in enumerate(self.patterns, 1):
            names = ("ramp", "early", "constant") if kind == "bodyForce" else tuple(HISTORIES)
            if self.bodies.loose and dice.chance(0.8):  # which a load that turns round would lift
                names = tuple(name for name in names if name not in ("reversal", "spike", "late"))
            used.append(dice.pick(*names))
            self.say(f"amplitude{number}(t)", HISTORIES[used[-1]])
        self.declared["history"] = used[0] if used else "static"
