"""Numbers of labels in the picture of a scene, beside their boundary and on nothing else.

Every number has a few places to choose from, along the longest piece of its boundary: inside the
body, outside of it, and farther off at the end of a line. The one with the least against it is
taken: other numbers, arrows, marks of obstacles, a place that is nearer to another boundary, on the
far side of a thin body, or inside another one.
"""

import numpy as np
from matplotlib.quiver import Quiver

from ..vectors import turned_left
from .obstacle import MARKS
from .outline import chains

MOST_LABELS = 30
ALONG = (0.5, 0.25, 0.75, 0.1, 0.9)  # where on a piece of boundary, in the order of preference
# of the body's size: distance from the boundary
INSIDE, OUTSIDE, AWAY = 0.032, 0.04, (0.075, 0.15)
WIDER = 0.009  # of it: more where a boundary is beside the number, for each digit beyond two
# of the body's size: from another number, from an arrow, from a mark
APART, CLEAR, UNMARKED = 0.045, 0.026, 0.015
TOUCHING = 0.3  # of a number's distance from its boundary, by which another one may be nearer
# what there is against a place
CROWDED, FOREIGN, CROSSED, MARKED, LED, BETWEEN, INTO, OUTER, BUSY, FAR, FARTHER = (
    5.0, 4.0, 3.0, 2.0, 1.5, 1.2, 1.0, 0.5, 0.5, 0.4, 0.3)


def label_numbers(axes, boundary: dict, edges: tuple, size: float, colours: dict) -> None:
    """The number of every label, in the colour of its role.

    `edges` are starts, ends and outward normals (e, 2) of the boundary, `size` that of the body in
    the picture, which has its arrows already.
    """
    names, taken = np.unique(boundary["label"]), np.empty((0, 2))
    arrows, marks = _arrows(axes), _marks(axes)
    for name in names if len(names) <= MOST_LABELS else ():
        own = np.flatnonzero(boundary["label"] == name)
        # a load may act on a part of its label
        role = next((str(role) for role in boundary["role"][own] if role != "free"), "free")
        places = _places(own, edges, size, role, WIDER * max(0, len(f"{name:g}") - 2))
        place, start, led = min(places, key=lambda p: p[-1] + _against(p, own, edges, size, taken,
                                                                      arrows, marks))[:3]
        taken = np.vstack([taken, place])
        if led:
            axes.plot(*np.stack([start, place]).T, color=colours[role], lw=0.5, zorder=3.5)
        axes.text(*place, f"{name:g}", color=colours[role], fontsize=7, ha="center", va="center",
                  zorder=4, bbox={"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none",
                                  "alpha": 0.75})
        margin = CLEAR * size
        axes.update_datalim([place - margin, place + margin])


def _places(own: np.ndarray, edges: tuple, size: float, role: str,
            wider: float = 0.0) -> list[tuple]:
    """Places for the number of the edges `own`: the place, where it belongs to, whether a line
    leads there, what there is against it by itself. `wider`: half of what the number is wider by
    than one of two digits, over the size.
    """
    start, end, normal = edges
    groups = [own[chain] for chain in chains(start[own], end[own])]
    longest = max(groups, key=lambda group: np.linalg.norm(end[group] - start[group], axis=1).sum())
    busy = BUSY * (role != "free")  # hatches, obstacles and arrows are outside
    outside = AWAY[0] if role == "springs" else OUTSIDE  # beyond their ends
    places = []
    for part in ALONG:
        point, edge = _at(start[longest], end[longest], part)
        out, off = normal[longest[edge]], FAR * abs(part - 0.5)
        aside, more = turned_left(out), wider * abs(out[0])
        beyond = point + (outside + more) * size * out
        places += [(point - (INSIDE + more) * size * out, point, False, off),
                   (beyond, point, False, off + OUTER + busy + INTO * within(beyond, start, end))]
        places += [(point + away * size * (way * out + across * aside), point, True,
                    off + LED + FARTHER * (away > AWAY[0]))
                   for away in AWAY for way in (1, -1) for across in (0, 1, -1)]
    return places


def within(place: np.ndarray, start: np.ndarray, end: np.ndarray) -> bool:
    """Whether a point (2,) is inside a body: a ray from it crosses the boundary an odd number of
    times.
    """
    x, y = place
    crossed = (start[:, 1] > y) != (end[:, 1] > y)
    (x1, y1), (x2, y2) = start[crossed].T, end[crossed].T
    return np.count_nonzero(x1 + (y - y1) / (y2 - y1) * (x2 - x1) > x) % 2 == 1


def _at(start: np.ndarray, end: np.ndarray, part: float) -> tuple[np.ndarray, int]:
    """Point (2,) of a chain of edges at a part of its length, and the edge that it lies on."""
    ways = np.cumsum(np.linalg.norm(end - start, axis=1))
    edge = int(np.searchsorted(ways, part * ways[-1]))
    back = (ways[edge] - part * ways[-1]) / np.linalg.norm(end[edge] - start[edge])
    return end[edge] + back * (start[edge] - end[edge]), edge


def _against(candidate: tuple, own: np.ndarray, edges: tuple, size: float, taken: np.ndarray,
             arrows: tuple, marks: tuple) -> float:
    """What there is against a place in its surroundings."""
    place, point, led, _ = candidate
    against = CROWDED * (np.linalg.norm(taken - place, axis=1) < APART * size).any()
    against += CROSSED * (distances(place, *arrows) < CLEAR * size).any()
    against += MARKED * (distances(place, *marks) < UNMARKED * size).any()
    away = distances(place, *edges[:2])
    if led:  # the line says whose it is
        return against + FOREIGN * (away.min() < CLEAR * size)
    nearest = away.min() + 1e-9 * size
    wanted = np.linalg.norm(place - point)
    # bodies that touch have two boundaries in one place, but for their polygons
    foreign = away[own].min() > nearest + TOUCHING * wanted
    # as near to the other side of a thin body
    beyond = distances(point, *edges[:2]) > wanted
    beyond[own] = False
    between = away[beyond].min(initial=np.inf) < (1 + TOUCHING) * wanted
    return (against + BETWEEN * between
            + FOREIGN * (foreign or nearest < 0.75 * wanted))


def _arrows(axes) -> tuple[np.ndarray, np.ndarray]:
    """Tails and heads (a, 2) of all arrows in the picture."""
    drawn = [part for part in axes.collections if isinstance(part, Quiver)]
    tails = [np.column_stack([part.X, part.Y]) for part in drawn]
    heads = [tail + np.column_stack([part.U, part.V]) for tail, part in zip(tails, drawn)]
    none = [np.empty((0, 2))]
    return np.concatenate(tails or none), np.concatenate(heads or none)


def _marks(axes) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends (m, 2) of the marks of obstacles in the picture."""
    drawn = [part.get_segments() for part in axes.collections if part.get_gid() == MARKS]
    ends = np.array([segment for part in drawn for segment in part]).reshape(-1, 2, 2)
    return ends[:, 0], ends[:, 1]


def distances(place: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n,) distances of a point (2,) from segments, given by starts and ends (n, 2)."""
    along = end - start
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    part = np.clip(((place - start) * along).sum(axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(start + part[:, None] * along - place, axis=1)
