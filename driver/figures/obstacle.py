"""What a body meets, as contact.csv tells it: the obstacle's points beside the contact nodes."""

import math

import numpy as np
from matplotlib.collections import LineCollection

from ..vectors import turned_left
from .outline import chains, right_of, sample, shifted, smoothed
from .reading import Run, select
from .style import INK

FAR = 0.35  # of the body's size; obstacles farther away are not drawn
BACK = -0.5  # cosine of the turn of normals from node to node that is no corner
NEAR = 0.1  # of the body's size: what is drawn of an obstacle beyond the picture
FLAT = 1e-9  # 1 - cosine between normals of a flat obstacle
WHOLE = 1.0  # of the body's size: obstacles up to which are drawn with what is farther away
LATER = 1.5  # of the body's size: how far away obstacles are drawn that it meets later
REACH = 0.2  # of a picture's width: half of what is drawn of a plane
MARKS = "marks"  # what they are called in a picture
ROUND = 4  # marks of a curved obstacle are those of a body at most so many times as large
STRAIGHT = 1.2  # length of an obstacle over its extent up to which its marks do not meet
STEEP = 0.87  # sine of the angle between surface and nodes, from which its ends are not drawn
CORNER = 0.83  # cosine between normals of nodes in a row, below which a corner is between them
FINE = 0.1  # of the body's size: longest side of a smooth obstacle in a picture
BREAK = 0.5  # relative difference of distance and arc where a new piece begins


def hatch(axes, start, end, normal, size: float, colour) -> None:
    """Short slanted marks outside some edges."""
    points, edge = sample(start, end, 0.028 * size)
    out = normal[edge]
    tips = points + 0.034 * size * (out + turned_left(out)) / math.sqrt(2)
    axes.add_collection(LineCollection(
        np.stack([points, tips], axis=1), colors=colour, linewidths=0.6, gid=MARKS))
    axes.update_datalim(tips)


def marks_size(start: np.ndarray, end: np.ndarray, size: float) -> float:
    """The size that marks are scaled by: small ones, where those of a body would fill a curve."""
    extent = np.ptp(np.concatenate([start, end]), axis=0)
    straight = np.linalg.norm(end - start, axis=1).sum() < STRAIGHT * np.linalg.norm(extent)
    return size if straight else min(size, ROUND * extent.max())


def rigid_rows(run: Run, time: float) -> dict | None:
    """Rows of contact.csv at a time that belong to rigid obstacles; None where there are none."""
    if run.contact is None or run.boundary is None:
        return None
    times = run.contact["time"]
    rows = select(run.contact, times == times[np.abs(times - time).argmin()])
    rigid = np.unique(run.boundary["label"][run.boundary["role"] == "contact"])
    if "boundary" in rows:
        rows = select(rows, np.isin(rows["boundary"], rigid))
    elif not len(rigid):
        return None
    return rows if len(rows["x"]) else None


def pieces(rows: dict) -> list[np.ndarray]:
    """Indices of the contact nodes of every connected piece, in the order of arc.

    Nodes follow one another if they are as far apart as their arcs are, whatever their labels; arcs
    grow along a piece and begin anew with the next one.
    """
    order = np.argsort(rows["node"] if "node" in rows else rows["arc"], kind="stable")
    xy = np.column_stack([rows["x"], rows["y"]])[order]
    away = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    apart = np.abs(away - np.diff(rows["arc"][order])) > BREAK * away
    return np.split(order, np.flatnonzero(apart) + 1)


def draw_obstacles(axes, run: Run, time: float, size: float, factor: float, box: np.ndarray,
                   away: float = 0.0, times: float = 0.0) -> None:
    """The rigid obstacles of a run at a time, if any; see `draw_obstacle`.

    Of one that contact follows what lies near the `box` (2, 2), its lower and upper ends in the
    picture, with the rest of curves that are small beside the body.
    """
    if run.obstacle is None:
        if (rows := rigid_rows(run, time)) is not None:
            draw_obstacle(axes, rows, size, factor, away, times)
        return
    table, steps = run.obstacle, run.history["step"]
    step = 0 if time == 0 else steps[np.abs(run.history["time"] - time).argmin()]
    sides = select(table, table["step"] == min(step, table["step"].max()))
    start, end = (factor * np.column_stack([sides[x], sides[y]])
                  for x, y in (("x0", "y0"), ("x1", "y1")))
    start, end = shifted(start, end, away)
    for here in _shown(start, end, size, box):
        axes.add_collection(LineCollection(np.stack(here, axis=1), colors=INK, linewidths=0.8))
        hatch(axes, *here, right_of(*here), marks_size(*here, size), INK)


def where_it_goes(run: Run, box: np.ndarray) -> np.ndarray:
    """The `box` (2, 2) of the body, widened to what of the obstacle its nodes touch at any time,
    where that is at the start, within reason.
    """
    if run.obstacle is None or run.contact is None:
        return box
    rows = select(run.contact, run.contact["status"] != "open")
    if not len(rows["x"]):
        return box
    x, y = rows["normal_x"], rows["normal_y"]
    places = np.column_stack([rows["x"] + rows["u_n"] * x - rows["u_t"] * y,
                              rows["y"] + rows["u_n"] * y + rows["u_t"] * x])
    for step in np.intersect1d(rows["step"], run.obstacle.get("step", [])):  # where it moves
        here = rows["step"] == step
        places[here] = _at_start(run.obstacle, step, places[here])
    room = LATER * np.ptp(box, axis=0).max()
    return np.array([np.minimum(box[0], np.maximum(places.min(axis=0), box[0] - room)),
                     np.maximum(box[1], np.minimum(places.max(axis=0), box[1] + room))])


def _at_start(table: dict, step: int, places: np.ndarray) -> np.ndarray:
    """Where `places` (n, 2) of an obstacle were at the start that are there in a step.

    Its sides have moved as a rigid body, in the complex plane z = a z_0 + b with |a| = 1.
    """
    moved, first = ((table["x0"] + 1j * table["y0"])[table["step"] == k] for k in (step, 0))
    if len(moved) != len(first):
        return places
    arm = first - first.mean()
    turn = np.vdot(arm, moved - moved.mean())
    turn = turn / abs(turn) if turn else 1.0
    found = (places @ [1, 1j] - moved.mean()) / turn + first.mean()
    return np.column_stack([found.real, found.imag])


def _shown(start: np.ndarray, end: np.ndarray, size: float,
           box: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Sides of every connected curve that are drawn, smooth ones: all of a small one, else those
    near the box. Edges may be longer than it, with both their ends far away.
    """
    near, found = _near(start, end, size, box), []
    for chain in map(np.array, chains(start, end)):
        extent = np.ptp(np.concatenate([start[chain], end[chain]]), axis=0).max()
        if extent < WHOLE * size and near[chain].any():
            found.append(smoothed(start, end, chain, FINE * size, CORNER))
        elif near[chain].any():
            sides = smoothed(start, end, chain[near[chain]], FINE * size, CORNER)
            here = _near(*sides, size, box)
            found += [(sides[0][here], sides[1][here])] if here.any() else []
    return found


def _near(start: np.ndarray, end: np.ndarray, size: float, box: np.ndarray) -> np.ndarray:
    """(n,) which edges may have a point in the box, or hardly beyond it."""
    low, high = box[0] - NEAR * size, box[1] + NEAR * size
    return ((np.minimum(start, end) < high) & (np.maximum(start, end) > low)).all(axis=1)


def draw_planes(axes, rows: dict, places: np.ndarray, width: float, factor: float) -> None:
    """The planes by which contact sees an obstacle that has no point in a picture.

    `rows` are the closed ones of `rigid_rows`, `places` (n, 2) where their nodes are in a picture
    of this `width`: bodies that have gone far along an obstacle which is linearized.
    """
    normal = np.column_stack([rows["normal_x"], rows["normal_y"]])
    surface = factor * (np.column_stack([rows["x"], rows["y"]]) + rows["gap"][:, None] * normal)
    if (np.abs(surface[:, None] - places).max(axis=2) < width / 2).any():
        return
    along = REACH * width * turned_left(normal)
    start, end = places - along, places + along
    axes.add_collection(LineCollection(np.stack([start, end], axis=1), colors=INK, linewidths=0.8))
    hatch(axes, start, end, normal, width, INK)


def _facing(nodes: np.ndarray, normal: np.ndarray) -> list[np.ndarray]:
    """Runs of nodes (k,) that meet one surface: not one from above and the next from below."""
    back = (normal[nodes][1:] * normal[nodes][:-1]).sum(axis=1) < BACK
    return [run for run in np.split(nodes, np.flatnonzero(back) + 1) if len(run)]


def _level(nodes: np.ndarray, surface: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """`nodes` (k,) in a row but for ends where the `surface` is steep along the `normal`.

    Seen along the body's normals a round obstacle that moves has no sides: it goes on for ever.
    """
    edge = np.diff(surface[nodes], axis=0)
    across = np.abs((edge * (normal[nodes][:-1] + normal[nodes][1:]) / 2).sum(axis=1))
    level = np.flatnonzero(across <= STEEP * np.linalg.norm(edge, axis=1))
    return nodes[level[0] : level[-1] + 2] if len(level) else nodes


def surfaces(run: Run, time: float, size: float, times: float) -> list[tuple]:
    """Pieces of the rigid obstacles as contact.csv tells them, in the run's own unit of length.

    They are starts, ends and normals (e, 2) away from the body, as far as `draw_obstacle` goes.
    """
    rows = None if run.obstacle is not None else rigid_rows(run, time)
    return [] if rows is None else list(_surfaces(rows, size, 1.0, 0.0, times))


def draw_obstacle(axes, rows: dict, size: float, factor: float, away: float = 0.0,
                  times: float = 0.0) -> None:
    """The surface of the rigid obstacles, hatched, `away` outside of where it is.

    `rows` are those of `rigid_rows`, `size` and `away` lengths of the picture. A flat one goes on
    as far as the body slides in a picture that magnifies displacements `times`.
    """
    for start, end, out in _surfaces(rows, size, factor, away, times):
        axes.add_collection(LineCollection(np.stack([start, end], axis=1), colors=INK,
                                           linewidths=0.8))
        hatch(axes, start, end, out, marks_size(start, end, size), INK)


def _surfaces(rows: dict, size: float, factor: float, away: float, times: float):
    """Starts, ends and normals of the pieces that `draw_obstacle` draws."""
    normal = np.column_stack([rows["normal_x"], rows["normal_y"]])
    gap = rows["gap"] * factor
    surface = np.column_stack([rows["x"], rows["y"]]) * factor + (gap + away)[:, None] * normal
    for near in (_level(part, surface, normal) for piece in pieces(rows)
                 for part in _facing(piece[np.abs(gap[piece]) < FAR * size], normal)):
        points, middle = surface[near], normal[near]
        if len(near) == 1:
            along = turned_left(middle) * 0.05 * size
            points = np.concatenate([points - along, points + along])
        else:
            points, middle = _with_corners(points, middle)
        way = times * factor * np.abs(rows["u_t"][near]).max() if times else 0.0
        along = points[-1] - points[0]
        along = along / (np.linalg.norm(along) or 1.0)
        even = np.abs((points - points[0]) @ [-along[1], along[0]]).max() < 1e-6 * size
        if way > 0 and even and (normal[near] @ normal[near[0]] > 1 - FLAT).all():
            points = np.vstack([points[0] - way * along, points[-1] + way * along])
        start, end = points[:-1], points[1:]
        out = right_of(start, end)
        middle = middle if len(middle) == len(start) else middle[:1]
        out = np.where((out * middle).sum(axis=1, keepdims=True) < 0, -out, out)
        yield start, end, out


def _with_corners(points: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) of an obstacle in a row with its corners between them, where the planes meet
    that contact sees on both sides; normals (n - 1, 2) of the edges.
    """
    middle = (normal[:-1] + normal[1:]) / 2
    along = turned_left(normal)
    for k in np.flatnonzero((normal[1:] * normal[:-1]).sum(axis=1) < CORNER)[::-1]:
        step, both = points[k + 1] - points[k], along[k : k + 2]
        ways = np.linalg.solve(both.T, step)[:, None] * both
        if (ways @ step > 0).all():  # on the way from one to the other
            points = np.insert(points, k + 1, points[k] + ways[0], axis=0)
            middle = np.insert(middle, k + 1, normal[k + 1], axis=0)
            middle[k] = normal[k]
    return points, middle
