"""Bodies of random scenes: outlines, which sides touch, which are held and which are loaded."""

from dataclasses import dataclass, replace

import numpy as np

from .dice import Dice
from .shapes import Shape, Side, block, disc, lattice, number_text, polygon, split, with_hole

HOLE = 91  # label of a hole


@dataclass(frozen=True)
class Hold:
    """How a side is held: clamped, roller (component `axis` only) or moved."""

    kind: str
    label: int
    axis: int = 0


@dataclass(frozen=True)
class Bodies:
    """One to three bodies, of size one.

    `press` (2,) is the direction that closes contact, `loaded` are sides for tractions, the one to
    press first; `piece` is the content of a macro that numbers subdomains by place, or empty.
    """

    name: str
    pattern: str
    shapes: tuple[Shape, ...]
    lengths: tuple[float, ...]  # of the elements of each
    contact: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...]
    holds: tuple[Hold, ...]
    loaded: tuple[Side, ...]
    press: tuple[float, float]
    rectangle: bool = False
    piece: str = ""

    @property
    def loose(self) -> bool:
        """Whether friction alone may have to hold a body in some direction."""
        held = {hold.label // 100 for hold in self.holds if hold.kind != "roller"}
        return len(held) < len(self.shapes)

    @property
    def title(self) -> str:
        """What there is in words."""
        return f"{self.name}: {self.pattern}"

    @property
    def reach(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Extent in x and y."""
        places = np.vstack([side.places for shape in self.shapes for side in shape.sides])
        return tuple((float(low), float(high)) for low, high in zip(places.min(0), places.max(0)))

    @property
    def triangles(self) -> int:
        """About as many as the mesh has."""
        return sum(2 * s.cells[0] * s.cells[1] if s.mesher == "square" else
                   int(2.0 * s.area / h**2) for s, h in zip(self.shapes, self.lengths))

    def text(self, size: float) -> list[str]:
        """FreeFEM statements that make the bodies, lengths times `size`."""
        if self.rectangle:
            (x0, x1), (y0, y1) = self.reach
            return [f"rectangle({', '.join(number_text(size * v) for v in (x0, x1, y0, y1))});"]
        lines = []
        for k, (shape, h) in enumerate(zip(self.shapes, self.lengths)):
            lines += shape.text(f"Th{k}", "abcd"[k], h, size, k)
        if len(self.shapes) > 1:
            return lines + [f"addBody(Th{k})" for k in range(len(self.shapes))]
        lines.append("body = Th0;")
        return lines + ([f"macro piece() ({self.piece}) //"] if self.piece else [])


def compose(dice: Dice, quadratic: bool) -> Bodies:
    """Bodies with their contact; fewer elements if they are `quadratic`."""
    if dice.chance(0.62):
        return _single(dice, quadratic)
    kind = dice.pick(_stack, _beside, _corner, _disc_on_block, _pin, weights=(4, 2, 2, 1, 1))
    return kind(dice, quadratic)


def _length(dice: Dice, shape: Shape, quadratic: bool) -> float:
    """Length of the elements' sides of a body."""
    triangles = dice.whole(16, 60) if quadratic else dice.whole(24, 160)
    return float(np.sqrt(2.3 * shape.area / triangles))


def _meshed(dice: Dice, shape: Shape, quadratic: bool) -> Shape:
    """A block on a lattice, as often as not."""
    if not dice.chance(0.6):
        return shape
    high, (width, height) = shape.corner, (shape.sides[0].length, shape.sides[1].length)
    assert high[0] > shape.sides[0].start[0]
    rows = dice.whole(2, 4 if quadratic else 6)
    columns = min(max(2, round(rows * width / height * dice.number(0.7, 1.4))), 14)
    return lattice(shape, (columns, rows), dice.pick(1.0, 1.0, 1.0, 2.0, 4.0))


# ---- one body ------------------------------------------------------------------------------------

def _outline(dice: Dice, quadratic: bool) -> Shape:
    """One of the outlines."""
    w, h, r = dice.number(0.8, 2.2), dice.number(0.5, 1.2), dice.number
    kind = dice.pick("block", "quadrilateral", "L", "T", "wedge", "disc", "notched", "half disc",
                     weights=(5, 2, 2, 1, 1, 1, 1, 1))
    if kind == "block":
        return _meshed(dice, block(0.0, 0.0, w, h), quadratic)
    if kind == "quadrilateral":
        return polygon(kind, [(0, 0), (w, r(-0.1, 0.1)), (w + r(-0.2, 0.2), h),
                              (r(-0.2, 0.2), h + r(-0.1, 0.1))])
    if kind == "L":
        a, b = r(0.3, 0.7) * w, r(0.3, 0.7) * h
        return polygon(kind, [(a, 0), (w, 0), (w, h), (0, h), (0, b), (a, b)])
    if kind == "T":
        a, b = r(0.2, 0.4) * w, r(0.3, 0.6) * h
        return polygon(kind, [(a, 0), (w - a, 0), (w - a, b), (w, b), (w, h), (0, h), (0, b),
                              (a, b)])
    if kind == "wedge":
        return polygon(kind, [(0, 0), (w, 0), (w, h), (0, r(0.15, 0.4) * h)])
    if kind == "disc":
        return disc(0.0, 0.5, 0.5, quarter=dice.pick(0.0, 0.0, r(-0.5, 0.5)))
    if kind == "notched":
        a, b, c = r(0.25, 0.4) * w, r(0.6, 0.75) * w, r(0.25, 0.5) * h
        return polygon(kind, [(0, 0), (a, 0), (a, c), (b, c), (b, 0), (w, 0), (w, h), (0, h)])
    arc = Side(1, (-0.8, 0.8), (0.8, 0.8), (0.0, 0.8), np.pi)
    return Shape(kind, (arc, Side(11, (0.8, 0.8), (-0.8, 0.8))), np.pi * 0.32)


def _single(dice: Dice, quadratic: bool) -> Bodies:
    """One body against rigid obstacles."""
    if dice.chance(0.06):
        shape, rectangle = block(0.0, 0.0, 2.0, 1.0), True
        shape = replace(shape, name="rectangle()", mesher="square", cells=(12, 6), sides=tuple(
            replace(side, label=k) for k, side in enumerate(shape.sides, 1)))
    else:
        shape, rectangle = _outline(dice, quadratic), False
        if shape.name in ("block", "quadrilateral", "disc") and dice.chance(0.3):
            (x0, x1), (y0, y1) = Bodies("", "", (shape,), (), (), (), (), (), (0, 0)).reach
            radius = dice.number(0.15, 0.3) * min(x1 - x0, y1 - y0)
            shape = with_hole(shape, (x0 + x1) / 2, (y0 + y1) / 2, radius, HOLE,
                              dice.pick(1, 1, 2, 4))
    shape, touching, pattern = _touching(dice, shape, rectangle)
    rest = [side for side in shape.sides if side.label not in touching and not side.hole]
    press = _press(shape, touching)
    rest.sort(key=lambda side: float(side.normal @ press))
    holds = _holds(dice, rest, [side for side in shape.sides if side.hole
                                and side.label not in touching])
    held = {hold.label for hold in holds if hold.kind != "roller"}
    loaded = [side for side in rest if side.label not in held] or [
        side for side in shape.sides if side.label not in held and side.label not in touching]
    piece = _piece(dice) if not rectangle and dice.chance(0.15) else ""
    return Bodies(shape.name, pattern, (shape,), (_length(dice, shape, quadratic),),
                  tuple(touching), (), tuple(holds), tuple(loaded),
                  (float(press[0]), float(press[1])), rectangle, piece)


def _touching(dice: Dice, shape: Shape, rectangle: bool) -> tuple[Shape, list[int], str]:
    """The shape with sides cut where labels meet, the labels that touch, and the pattern."""
    outer = [side for side in shape.sides if not side.hole]
    holes = [side.label for side in shape.sides if side.hole]
    if holes and dice.chance(0.5):
        pattern = "a hole" if len(holes) == 1 else "labels that meet in a hole"
        if dice.chance(0.25):
            return shape, [*holes, outer[0].label], f"{pattern} and a side"
        return shape, holes, pattern
    pattern = dice.pick("a side", "labels that meet on a flat side", "labels that meet at corners",
                        "three sides", "two sides apart", "all round",
                        weights=(4, 4, 4, 2, 1, 0.7))
    count, first = len(outer), dice.whole(0, 1) if len(outer) > 4 else 0
    if rectangle and pattern == "labels that meet on a flat side":
        pattern = "labels that meet at corners"
    if pattern == "a side" or count < 3:
        return shape, [outer[0].label], "a side"
    if pattern == "labels that meet on a flat side":
        label = outer[first].label
        for more in range(dice.pick(1, 1, 2)):
            shape = split(shape, label + more, dice.number(0.3, 0.6))
        labels = [side.label for side in shape.sides if label <= side.label < label + 3]
        return shape, labels, pattern if len(labels) > 1 else "a side"
    around = [side.label for side in outer[first:] + outer[:first]]
    if pattern == "labels that meet at corners":
        if shape.name in ("L", "notched", "T"):
            pattern = "labels that meet at re-entrant corners"
            around = {"L": [outer[4].label, outer[5].label],
                      "notched": [side.label for side in outer[1:4]],
                      "T": [outer[2].label, outer[3].label]}[shape.name]
        return shape, around[:3] if "notched" in shape.name else around[:2], pattern
    if pattern == "three sides":
        return shape, [around[-1], *around[:2]], pattern
    if pattern == "two sides apart":
        return shape, [around[0], around[2]], pattern
    return shape, around, pattern


def _press(shape: Shape, touching: list[int]) -> np.ndarray:
    """(2,) unit vector into the contact: the sum of its normals, else downwards."""
    total = sum(side.length * side.normal for side in shape.labelled(*touching))
    size = np.hypot(*total)
    press = total / size if size > 0.05 else np.array([0.0, -1.0])
    return np.round(press, 4)


def _holds(dice: Dice, rest: list[Side], holes: list[Side]) -> list[Hold]:
    """Supports of one body among the sides `rest`, those to press first, and holes."""
    kind = dice.pick("clamped", "moved", "roller", "none", "hole", weights=(6, 5, 2, 2, 1))
    if kind == "hole" and holes:
        return [Hold("clamped", side.label) for side in holes]
    if not rest or kind == "none":
        return []
    side = rest[0] if kind == "moved" else dice.pick(*rest)
    if kind == "roller":
        return [Hold(kind, side.label, dice.whole(0, 1))]
    return [Hold("moved" if kind == "moved" else "clamped", side.label)]


def _piece(dice: Dice) -> str:
    """A number of the subdomain by place, or by element."""
    return dice.pick("nuTriangle - 5*floor(nuTriangle/5.)", "floor(nuTriangle/3.)", "nuTriangle")


# ---- several bodies ------------------------------------------------------------------------------

def _base_hold(dice: Dice, label: int) -> tuple[list[Hold], list[int]]:
    """The lowest body is clamped, on rollers or lies on a rigid floor: holds, contact labels."""
    kind = dice.pick("clamped", "floor", "roller", weights=(5, 2, 1))
    if kind == "floor":
        return [], [label]
    return [Hold(kind, label, 1)], []


def _several(dice: Dice, name: str, pattern: str, shapes: list[Shape], quadratic: bool, contact,
             pairs, holds, loaded, press) -> Bodies:
    shapes = [shape if shape.mesher == "border" else shape for shape in shapes]
    lengths = tuple(_length(dice, shape, quadratic) for shape in shapes)
    pairs = tuple(pair if dice.chance(0.7) else pair[::-1] for pair in pairs)
    return Bodies(name, pattern, tuple(shapes), lengths, tuple(contact), pairs, tuple(holds),
                  tuple(loaded), press)


def _stack(dice: Dice, quadratic: bool) -> Bodies:
    """Two or three blocks on each other."""
    count, x, y, width = dice.pick(2, 2, 3), 0.0, 0.0, dice.number(1.2, 2.2)
    shapes, pairs = [], []
    for k in range(count):
        height = dice.number(0.4, 0.9)
        shapes.append(_meshed(dice, block(x, y, width, height, 1 + 100 * k), quadratic))
        if k:
            pairs.append((100 * k + 1, 100 * k - 79))
        y = float(f"{y + height:.6g}")
        smaller = dice.number(0.5, 1.0) * width
        x = float(f"{x + dice.number(0.0, 1.15) * (width - smaller):.6g}")
        width = float(f"{smaller:.6g}")
    holds, contact = _base_hold(dice, 1)
    top = shapes[-1].sides
    if dice.chance(0.5):
        kind = dice.pick("moved", "roller")
        holds.append(Hold(kind, top[2].label, dice.whole(0, 1)))
    loaded = [top[2], top[1], top[3]]
    return _several(dice, f"stack of {count}", "one on the other", shapes, quadratic, contact,
                    pairs, holds, loaded, (0.0, -1.0))


def _beside(dice: Dice, quadratic: bool) -> Bodies:
    """Two blocks side by side, on a floor or clamped, pressed together."""
    a, b, h = dice.number(0.6, 1.4), dice.number(0.6, 1.4), dice.number(0.5, 1.0)
    tall = float(f"{h * dice.number(0.7, 1.3):.6g}")
    shapes = [_meshed(dice, block(0.0, 0.0, a, h), quadratic),
              _meshed(dice, block(a, 0.0, b, tall, 101), quadratic)]
    holds, contact, pattern = [Hold("clamped", 111)], [], "side by side"
    if dice.chance(0.5):
        contact = [1] if dice.chance(0.5) else [1, 101]
        pattern = "side by side on a floor"
    else:
        holds.append(Hold("roller", 1, 1))
    loaded = [shapes[0].sides[3], shapes[0].sides[2], shapes[1].sides[2]]
    return _several(dice, "two blocks", pattern, shapes, quadratic, contact, [(11, 131)], holds,
                    loaded, (0.8, -0.6) if contact else (1.0, 0.0))


def _corner(dice: Dice, quadratic: bool) -> Bodies:
    """A body in the corner of two others, or of one of them and a rigid wall."""
    a, b, h = dice.number(0.6, 1.0), dice.number(0.5, 0.9), dice.number(0.5, 1.0)
    small = dice.number(0.4, 0.9)
    base = split(block(0.0, 0.0, a + b, h), 21, b / (a + b))  # from the right to the left: 21, 22
    left = block(0.0, h, a, dice.number(0.6, 1.0), 101)
    third = _meshed(dice, block(a, h, small * b, small, 201), quadratic)
    holds, contact = _base_hold(dice, 1)
    if dice.chance(0.8):
        holds.append(Hold("clamped", 131))
    if dice.chance(0.4):
        holds.append(Hold("moved", 221))
    shapes, pairs = [base, left, third], [(101, 22), (201, 21), (231, 111)]
    loaded = [third.sides[2], third.sides[1], left.sides[2]]
    return _several(dice, "three blocks", "a body in a corner of two", shapes, quadratic, contact,
                    pairs, holds, loaded, (-0.6, -0.8))


def _disc_on_block(dice: Dice, quadratic: bool) -> Bodies:
    """A disc on a block."""
    w, h, radius = dice.number(1.2, 2.0), dice.number(0.4, 0.8), dice.number(0.3, 0.6)
    base = _meshed(dice, block(0.0, 0.0, w, h), quadratic)
    round_body = disc(w / 2, h + radius, radius, 101)
    holds, contact = _base_hold(dice, 1)
    if dice.chance(0.7):
        holds.append(Hold(dice.pick("moved", "roller"), 121, 0))
    top = round_body.sides
    return _several(dice, "disc on a block", "a curved side", [base, round_body], quadratic,
                    contact, [(101, 21)], holds, [top[2], top[1]], (0.0, -1.0))


def _pin(dice: Dice, quadratic: bool) -> Bodies:
    """A pin in the hole of a plate."""
    w, h = dice.number(1.5, 2.2), dice.number(1.2, 1.8)
    radius = dice.number(0.3, 0.4)
    inner = float(f"{radius * dice.pick(1.0, 1.0, 0.995, 0.97):.6g}")
    plate = with_hole(block(0.0, 0.0, w, h), w / 2, h / 2, radius, HOLE)
    pin = disc(w / 2, h / 2, inner, 101)
    pin = replace(pin, sides=tuple(replace(side, label=101) for side in pin.sides))
    if dice.chance(0.6):
        pin = with_hole(pin, w / 2, h / 2, 0.4 * inner, 191)
    holds, contact = _base_hold(dice, 1)
    loaded = list(pin.sides[4:]) or [plate.sides[2]]
    if len(pin.sides) > 4 and dice.chance(0.5):
        holds.append(Hold("moved", 191))
        loaded = [plate.sides[2]]
    return _several(dice, "pin in a hole", "a hole", [plate, pin], quadratic, contact,
                    [(HOLE, 101)], holds, loaded, (0.0, -1.0))
