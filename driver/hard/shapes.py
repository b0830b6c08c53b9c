"""Outlines of random bodies: sides with labels, and the FreeFEM text that meshes them.

Lengths are those of a body of size one; `Shape.text` writes them in the scene's unit.
"""

from dataclasses import dataclass, replace

import numpy as np

CIRCLE = 2 * np.pi


@dataclass(frozen=True)
class Side:
    """One side of an outline, counterclockwise around the body; of holes clockwise.

    A straight line from `start` to `end`, or an arc about `centre` by the angle `turn` (radians,
    negative around holes).
    """

    label: int
    start: tuple[float, float]
    end: tuple[float, float]
    centre: tuple[float, float] | None = None
    turn: float = 0.0
    hole: bool = False

    @property
    def length(self) -> float:
        """Arc length."""
        if self.centre is None:
            return float(np.hypot(*np.subtract(self.end, self.start)))
        return abs(self.turn) * float(np.hypot(*np.subtract(self.start, self.centre)))

    @property
    def normal(self) -> np.ndarray:
        """(2,) outward unit normal of the chord; zero of whole circles."""
        x, y = np.subtract(self.end, self.start)
        size = np.hypot(x, y)
        return np.array([y, -x]) / size if size > 1e-9 else np.zeros(2)

    @property
    def places(self) -> np.ndarray:
        """(n, 2) places along the side, its ends first and last."""
        if self.centre is None:
            return np.array([self.start, self.end])
        (x, y), angles = np.subtract(self.start, self.centre), np.linspace(0.0, self.turn, 65)
        c, s = np.cos(angles), np.sin(angles)
        return self.centre + np.column_stack([c * x - s * y, s * x + c * y])

    def halves(self, share: float, label: int) -> tuple["Side", "Side"]:
        """The side cut at `share` of its length; the second half gets the new `label`."""
        if self.centre is None:
            middle = tuple(float(a + share * (b - a)) for a, b in zip(self.start, self.end))
            return replace(self, end=middle), replace(self, start=middle, label=label)
        x, y = np.subtract(self.start, self.centre)
        c, s = np.cos(share * self.turn), np.sin(share * self.turn)
        middle = (float(self.centre[0] + c * x - s * y), float(self.centre[1] + s * x + c * y))
        return (replace(self, end=middle, turn=share * self.turn),
                replace(self, start=middle, turn=(1 - share) * self.turn, label=label))


@dataclass(frozen=True)
class Shape:
    """A body: its sides in their order, and how it is meshed.

    `mesher`: border (buildmesh along the sides), square (a lattice of `cells`, of rectangles
    whose first four sides are bottom, right, top, left) or graded (the same with elements that
    grow by the power `grade` from the left to the right).
    """

    name: str
    sides: tuple[Side, ...]
    area: float
    mesher: str = "border"
    cells: tuple[int, int] = (0, 0)
    grade: float = 1.0

    def labelled(self, *labels: int) -> list[Side]:
        """The sides with these labels."""
        return [side for side in self.sides if side.label in labels]

    def shifted(self, way: float) -> "Shape":
        """The same body moved by `way` along x."""
        def moved(place):
            return place and (place[0] + way, place[1])

        return replace(self, sides=tuple(
            replace(side, start=moved(side.start), end=moved(side.end), centre=moved(side.centre))
            for side in self.sides))

    def text(self, mesh: str, prefix: str, h: float, scale: float, region: int) -> list[str]:
        """FreeFEM statements that set the mesh `mesh`; `h` is the length of an element's side."""
        if self.mesher == "border":
            return self._borders(mesh, prefix, h, scale, region)
        return self._square(mesh, scale, region)

    def _borders(self, mesh, prefix, h, scale, region) -> list[str]:
        lines, calls = [], []
        for number, side in enumerate(self.sides):
            name, cells = f"{prefix}{number}", max(2, round(side.length / h))
            (x0, y0), (x1, y1) = (np.multiply(place, scale) for place in (side.start, side.end))
            if side.centre is None:
                course = (f"t=0, 1) {{ x = {number_text(x0)} + ({number_text(x1 - x0)})*t; "
                          f"y = {number_text(y0)} + ({number_text(y1 - y0)})*t;")
            else:
                cx, cy = np.multiply(side.centre, scale)
                radius = round_off(np.hypot(x0 - cx, y0 - cy))
                first = float(np.arctan2(y0 - cy, x0 - cx))
                cells = max(cells, round(abs(side.turn) / CIRCLE * 8))
                course = (f"t={number_text(first)}, {number_text(first + side.turn)}) {{ "
                          f"x = {number_text(cx)} + {number_text(radius)}*cos(t); "
                          f"y = {number_text(cy)} + {number_text(radius)}*sin(t);")
            lines.append(f"border {name}({course} label = {side.label}; }}")
            calls.append(f"{name}({cells})")
        made = [f"mesh {mesh} = buildmesh({' + '.join(calls)});"]
        return [*lines, *made, *_region(mesh, region)]

    def _square(self, mesh, scale, region) -> list[str]:
        low, high = self.sides[0].start, self.corner
        place = "x" if self.grade == 1 else f"x^{self.grade:g}"
        x, y = (f"{number_text(scale * low[c])} + {number_text(scale * (high[c] - low[c]))}*{along}"
                for c, along in ((0, place), (1, "y")))
        at = [self.sides[k].label for k in self.outer]
        lines = [f"int[int] {mesh}Labels = [{', '.join(map(str, at))}];",
                 f"mesh {mesh} = square({self.cells[0]}, {self.cells[1]}, [{x}, {y}], "
                 f"label = {mesh}Labels);"]
        for side in self.sides:
            if side.label in at:
                continue
            axis = 0 if side.start[1] == side.end[1] else 1
            sign = "<" if side.end[axis] < side.start[axis] else ">"
            lines.append(f"{mesh} = change({mesh}, flabel = (label == {side.label - 1} "
                         f"&& {'xy'[axis]} "
                         f"{sign} {number_text(scale * side.start[axis])} ? {side.label} "
                         f": label));")
        return [*lines, *_region(mesh, region)]

    @property
    def outer(self) -> list[int]:
        """Places of bottom, right, top and left among the sides of a rectangle: no cut halves."""
        normals, places = [tuple(np.round(side.normal)) for side in self.sides], []
        for wanted in ((0, -1), (1, 0), (0, 1), (-1, 0)):
            places.append(normals.index(wanted))
        return places

    @property
    def corner(self) -> tuple[float, float]:
        """Upper right corner of a rectangle."""
        return (max(side.end[0] for side in self.sides), max(side.end[1] for side in self.sides))


def _region(mesh: str, region: int) -> list[str]:
    return [f"{mesh} = change({mesh}, fregion = {region});"] if region else []


def round_off(value: float) -> float:
    """The value without the last digits, which are rounding."""
    return float(f"{value:.14g}")


def number_text(value: float) -> str:
    """A number as FreeFEM reads it back exactly."""
    return repr(float(value))


def polygon(name: str, corners, first: int = 1) -> Shape:
    """Body with these corners, counterclockwise; labels from `first` on."""
    corners = [tuple(map(float, corner)) for corner in corners]
    ends = corners[1:] + corners[:1]
    x, y = np.array(corners).T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return Shape(name, tuple(Side(first + 10 * k, *pair)
                             for k, pair in enumerate(zip(corners, ends))), area)


def block(x: float, y: float, width: float, height: float, first: int = 1) -> Shape:
    """Rectangle with its lower left corner at (x, y): bottom, right, top, left."""
    return polygon("block", [(x, y), (x + width, y), (x + width, y + height), (x, y + height)],
                   first)


def lattice(shape: Shape, cells: tuple[int, int], grade: float = 1.0) -> Shape:
    """A rectangle that square() meshes with so many cells."""
    return replace(shape, mesher="square", cells=cells, grade=grade,
                   name="block" if grade == 1 else "graded block")


def disc(x: float, y: float, radius: float, first: int = 1, quarter: float = 0.0) -> Shape:
    """Disc of four arcs, the first one at the bottom; `quarter`: angle by which it is turned."""
    angles = quarter - 3 * np.pi / 4 + np.pi / 2 * np.arange(5)
    places = [(float(x + radius * np.cos(a)), float(y + radius * np.sin(a))) for a in angles]
    places[4] = places[0]
    sides = tuple(Side(first + 10 * k, places[k], places[k + 1], (x, y), np.pi / 2)
                  for k in range(4))
    return Shape("disc", sides, np.pi * radius**2)


def with_hole(shape: Shape, x: float, y: float, radius: float, label: int, parts: int = 1) -> Shape:
    """The same with a round hole, whose `parts` arcs have labels from `label` on."""
    angles = -CIRCLE * np.arange(parts + 1) / parts
    places = [(float(x + radius * np.cos(a)), float(y + radius * np.sin(a))) for a in angles]
    places[parts] = places[0]
    arcs = tuple(Side(label + k, places[k], places[k + 1], (x, y), -CIRCLE / parts, True)
                 for k in range(parts))
    return replace(shape, name=f"{shape.name} with a hole", mesher="border",
                   sides=shape.sides + arcs, area=shape.area - np.pi * radius**2)


def with_slit(shape: Shape, centre: tuple[float, float], length: float, angle: float, rise: float,
              label: int) -> Shape:
    """The same with a slit at `angle` whose two lips, arcs, rise by `rise` in their middles.

    The upper lip has the `label`, the lower one the next.
    """
    along = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    ends = [tuple((centre + sign * along).tolist()) for sign in (-1.0, 1.0)]
    across = np.array([-along[1], along[0]]) / (0.5 * length)
    radius = (0.25 * length**2 + rise**2) / (2 * rise)
    turn = -2 * float(np.arcsin(0.5 * length / radius))
    middles = [tuple((centre + sign * (radius - rise) * across).tolist()) for sign in (-1.0, 1.0)]
    lips = (Side(label, *ends, middles[0], turn, True),
            Side(label + 1, *ends[::-1], middles[1], turn, True))
    return replace(shape, name=f"{shape.name} with a slit", mesher="border",
                   sides=shape.sides + lips)


def split(shape: Shape, label: int, share: float) -> Shape:
    """The same with the side `label` cut in two at `share`; the second half is label + 1.

    On lattices the cut moves to the nearest vertex; a side without a vertex inside stays whole.
    """
    sides = []
    for side in shape.sides:
        if side.label != label:
            sides.append(side)
            continue
        if shape.mesher == "square":
            share = _on_lattice(shape, side, share)
        sides += side.halves(share, label + 1) if share else [side]
    return replace(shape, sides=tuple(sides))


def _on_lattice(shape: Shape, side: Side, share: float) -> float:
    """The share of `side` at the lattice's vertex next to `share` inside it, 0 if there is none."""
    axis = 0 if side.start[1] == side.end[1] else 1
    low, high = shape.sides[0].start[axis], shape.corner[axis]
    power = shape.grade if axis == 0 else 1.0
    ticks = low + (high - low) * (np.arange(shape.cells[axis] + 1) / shape.cells[axis]) ** power
    shares = (ticks - side.start[axis]) / (side.end[axis] - side.start[axis])
    shares = shares[(shares > 1e-6) & (shares < 1 - 1e-6)]
    return float(shares[np.abs(shares - share).argmin()]) if len(shares) else 0.0
