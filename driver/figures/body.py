"""The deformed bodies with their stress, as a whole and at the contact where that is small.

Displacements are magnified where they are small, but not so far that bodies would run through each
other or through an obstacle in the picture: gaps are not magnified. The von Mises
stress is that of the averaged stresses at the nodes.
"""

from dataclasses import replace
from itertools import product

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import cKDTree

from .crossing import without_crossing
from .layout import map_axes, run_header, shrink_to_body
from .obstacle import draw_obstacles, draw_planes, pieces, rigid_rows
from .outline import outer, place_inside
from .reading import Mesh, Run, select
from .scales import length_scale, round_magnification, stress_scale
from .style import INK, RED, STATUS, literal, status_name

SHOWN = 0.08  # largest displacement in the picture over the body's size
STRAIN = 0.25  # or where that strains most of the body so much in the picture, whichever is less
MOST = 98  # percentage of the triangles: corners strain more
LARGE = 0.03  # displacements of this part of the size are shown as they are
OVERLAP = 0.01  # of the size: bodies may run so far through each other in the picture,
APART = 0.005  # of the size: gaps that are not magnified are told of beyond
ZOOMED = 0.003  # and so far where the contact has a picture of its own
SMALL = 0.12  # a contact of this part of the size has a picture of its own
BAR = 40  # length of the bar of colours over its thickness
INSIDE = 1e-6  # of the size: so far inside a body a vertex is told from another body's
ROOM = 3.0  # width of that picture over the length of the contact
BESIDE = (0.4, 0.6, 0.3, 0.7, 0.2, 0.8, 0.1, 0.9)  # of a body's length, where names may stand


def magnification(run: Run, mesh: Mesh | None = None, size: float | None = None) -> float:
    """300 as in the slides for their model, else what shows displacements, at least 1.

    `size` of the picture, by default the body's.
    """
    mesh = mesh or run.last
    size = size or np.ptp(mesh.xy, axis=0).max()
    if run.scene == "model":
        return 300.0
    if run.summary["effects"].get("large_sliding"):  # what is met is where it is
        return 1.0
    largest = np.linalg.norm(mesh.displacement, axis=1).max()
    if largest == 0 or largest > LARGE * size:
        return 1.0
    wish = min(SHOWN * size / largest, STRAIN / max(_strain(mesh), np.finfo(float).tiny))
    times = round_magnification(wish, _without_overlap(run, mesh.time, size))
    return without_crossing(run, mesh, times, size, _allowed(run))


def _strain(mesh: Mesh) -> float:
    """The norm of the strain that MOST triangles stay below."""
    xy, u = mesh.xy[mesh.triangles], mesh.displacement[mesh.triangles]
    sides, moves = xy[:, 1:] - xy[:, :1], u[:, 1:] - u[:, :1]
    plain = np.linalg.det(sides) != 0
    gradient = np.linalg.solve(sides[plain], moves[plain])
    return float(np.percentile(np.linalg.norm(gradient + gradient.transpose(0, 2, 1),
                                              axis=(1, 2)) / 2, MOST))


def _without_overlap(run: Run, time: float, size: float) -> float:
    """The magnification at which contact nodes run OVERLAP through what they meet, or closed ones
    stand so far away from it; ZOOMED where the picture at the contact shows more.
    """
    if run.contact is None:
        return np.inf
    overlap = _allowed(run)
    times = run.contact["time"]
    rows = select(run.contact, times == times[np.abs(times - time).argmin()])
    towards, closed = rows["u_n"] > 0, rows["status"] != "open"
    room = rows["gap"][towards] + overlap * size
    limit = np.maximum(room / rows["u_n"][towards], 1.0).min(initial=np.inf)
    gap = np.abs(rows["gap"][closed]).max(initial=0)
    return float(min(limit, 1 + overlap * size / gap if gap > 0 else np.inf))


def _allowed(run: Run) -> float:
    """How far bodies may run through each other at the contact, as a part of the size."""
    return OVERLAP if contact_window(run) is None else ZOOMED


def deformed(figure: Figure, run: Run) -> None:
    """Deformed bodies with von Mises stress, obstacles, and the undeformed outline."""
    draw_deformed(figure, run, run.last, magnification(run))


def draw_deformed(figure: Figure, run: Run, mesh: Mesh, times: float, top: float | None = None,
                  box: np.ndarray | None = None, more=None, room: np.ndarray | None = None) -> None:
    """The picture of one step, magnified `times`.

    `top` is the highest stress of the colours and `box` (2, 2) the lower and upper ends of what is
    shown, by default those of the step. `more`(axes, run, mesh, moved) draws and gives legend
    entries. `room` (2, 2) is what obstacles take in all pictures alike, from `obstacles_room`.
    """
    axes, scale = map_axes(figure, run, mesh.xy)
    size = np.ptp(mesh.xy, axis=0).max() * scale.factor
    moved = (mesh.xy + times * mesh.displacement) * scale.factor
    handles = _outline(axes, run, mesh, moved, scale.factor)
    shown = np.array([moved.min(axis=0), moved.max(axis=0)])
    if box is not None:
        shown = box * scale.factor
    draw_obstacles(axes, run, mesh.time, size, scale.factor, shown, times=times)
    handles += more(axes, run, mesh, moved) if more else []
    axes.autoscale_view()
    if box is not None:
        low, high = box * scale.factor
        axes.update_datalim([low - 0.05 * size, high + 0.05 * size])
        if room is not None:
            axes.update_datalim(room)
        axes.autoscale_view()
    extent = np.ptp(moved if box is None else box, axis=0)
    wide = extent[0] > 1.3 * extent[1]
    _stress(figure, axes, run, mesh, moved, wide, top)
    title = f"Deformed {_plural(mesh)}{run.at(mesh.time)}, {_magnified(times)}"
    note = ", ".join(filter(None, (_overlapping(run), _not_magnified(run, mesh, times))))
    run_header(figure, run, title, handles, note)
    shrink_to_body(figure, axes)
    _name_materials(axes, run, mesh, moved)


def obstacles_room(run: Run, meshes: list[Mesh], times: float,
                   box: np.ndarray) -> np.ndarray | None:
    """Lower and upper ends (2, 2) of what is drawn of obstacles beside all `meshes`, in the unit of
    the pictures; None where there are none. The other arguments are those of `draw_deformed`.
    """
    axes, xy = Figure().add_subplot(), meshes[0].xy
    factor = length_scale(run, xy).factor
    size = np.ptp(xy, axis=0).max() * factor
    for mesh in meshes:
        draw_obstacles(axes, run, mesh.time, size, factor, box * factor, times=times)
    return axes.dataLim.get_points() if axes.collections else None


def _plural(mesh: Mesh) -> str:
    return "bodies" if mesh.body.max() > 0 else "body"


def _magnified(times: float) -> str:
    """Words for the magnification."""
    if times == 1:
        return "displacements to scale"
    return f"displacements magnified {times:,.0f}×".replace(",", "\u2009")


def _not_magnified(run: Run, mesh: Mesh, times: float) -> str:
    """That gaps are as they are, where bodies that close or overlap them would seem to be apart.

    By a magnified displacement they run through an obstacle, or have a slit between them after a
    press fit. Where contact follows the motion obstacles stand where they do at the time.
    """
    if times == 1 or run.contact is None or run.obstacle is not None:
        return ""
    now = run.contact["time"]
    rows = select(run.contact, now == now[np.abs(now - mesh.time).argmin()])
    closed = np.abs(rows["gap"][rows["status"] != "open"])
    apart = abs(times - 1) * closed.max(initial=0.0)
    return "gaps not magnified" if apart > APART * np.ptp(mesh.xy, axis=0).max() else ""


def _overlapping(run: Run) -> str:
    """What the run says of bodies that run through each other where no contact is declared."""
    overlaps = run.summary.get("validity", {}).get("overlaps", [])
    if not overlaps:
        return ""
    one, other, _ = max(overlaps, key=lambda overlap: overlap[2])
    return f"boundaries {one} and {other} overlap: no contact is declared there"


def _outline(axes, run: Run, mesh: Mesh, moved: np.ndarray, factor: float) -> list:
    """The undeformed outline and, of several bodies, the deformed one; legend entries."""
    if not run.boundary:
        return []
    b = {n: run.boundary[n] * factor for n in ("x0", "y0", "x1", "y1")}
    lines = np.stack([np.column_stack([b["x0"], b["y0"]]), np.column_stack([b["x1"], b["y1"]])],
                     axis=1)
    axes.add_collection(LineCollection(lines, colors=INK, linewidths=0.5))
    handles = [Line2D([], [], color=INK, lw=0.5, label="undeformed outline")]
    if mesh.body.max() > 0:  # where they touch, the colours alone may not distinguish them
        rim = moved[mesh.rim()[0][outer(mesh, run.boundary)]]
        axes.add_collection(LineCollection(rim, colors=RED, linewidths=0.9))
        handles.append(Line2D([], [], color=RED, lw=0.9, label="bodies"))
        if periods := run.summary.get("periods"):
            handles.append(_images(axes, rim, factor * np.array(periods)))
    return handles


def _images(axes, rim: np.ndarray, periods: np.ndarray) -> Line2D:
    """The bodies' outlines `rim` (e, 2, 2) beside them, moved by `periods` (d, 2); legend entry.

    As far as the picture shows them: it is that of the bodies.
    """
    extent = np.ptp(rim.reshape(-1, 2), axis=0)
    most = [int(np.ceil(np.linalg.norm(extent) / np.linalg.norm(period))) for period in periods]
    style = {"color": RED, "lw": 0.6, "ls": (0, (3, 3))}
    for numbers in product(*(range(-n, n + 1) for n in most)):
        if any(numbers):
            axes.add_collection(LineCollection(rim + numbers @ periods, colors=style["color"],
                                               linewidths=style["lw"], linestyles=[style["ls"]]),
                                autolim=False)
    return Line2D([], [], label="as they repeat themselves", **style)


def _name_materials(axes, run: Run, mesh: Mesh, moved: np.ndarray) -> None:
    """The names of the bodies' materials, where they are given: each in the middle of its body, or
    beside it where another name is there. The figure has its final size.
    """
    rim, taken = moved[mesh.rim()[0][outer(mesh, run.boundary)]].mean(axis=1), []
    for row in run.summary.get("materials", []):
        own = moved[mesh.triangles[mesh.body == row["body"] - 1]]
        if not len(own):
            continue
        name = axes.annotate(literal(row["name"]), rim[0], color=INK, ha="center", va="center",
                             fontsize=8,
                             bbox={"fc": "white", "ec": "none", "alpha": 0.7, "pad": 1.0})
        boxes = []
        for place in _inside(own, rim):
            name.xy = place
            name.set_position(place)
            boxes.append((place, name.get_window_extent()))
            if not any(boxes[-1][1].overlaps(box) for box in taken):
                break
        else:
            name.xy = boxes[0][0]
            name.set_position(boxes[0][0])
        taken.append(name.get_window_extent())


def _inside(corners: np.ndarray, rim: np.ndarray) -> list[np.ndarray]:
    """Places in a body of triangles (m, 3, 2): in the middle, or farthest from any `rim` (e, 2)
    where that is in a hole, then along its length.
    """
    own = corners.mean(axis=1)
    wanted = [place_inside(corners, rim)]
    far = np.ptp(own, axis=0).argmax()
    for part in BESIDE:
        wanted.append(np.median(own[np.abs(own[:, far] - np.quantile(own[:, far], part)).argsort()
                                    [: max(1, len(own) // 10)]], axis=0))
    return [own[np.linalg.norm(own - place, axis=1).argmin()] for place in wanted]


def _stress(figure: Figure, axes, run: Run, mesh: Mesh, moved: np.ndarray, wide: bool,
            top: float | None = None) -> None:
    """Von Mises stress in colours, and their bar; singularities must not take all of them."""
    stress = stress_scale(run, np.percentile(mesh.von_mises, 99.5) if top is None else top)
    values = mesh.von_mises * stress.factor
    largest = values[mesh.triangles].max()
    limit = np.percentile(values, 99.5) if top is None else top * stress.factor
    beyond = largest > 1.05 * limit
    limit = limit if beyond or top is not None else largest
    # as a bitmap: 1e5 triangles in a PDF would choke a reader
    picture = axes.tripcolor(*moved.T, mesh.triangles, values, shading="gouraud", rasterized=True,
                             cmap="viridis", vmin=0, vmax=limit or 1, zorder=0.5)
    width, height = np.ptp(moved, axis=0)
    thick = max(width, height) / BAR  # of the bar, in units of the picture
    bar = figure.colorbar(picture, ax=axes, location="bottom" if wide else "right", aspect=BAR,
                          fraction=max(0.15, thick / (thick + min(width, height))), pad=0.02,
                          extend="max" if beyond else "neither")
    most = f", largest value {largest:.3g}" if largest < 1000 else f", largest value {largest:.0f}"
    bar.set_label(f"von Mises stress [{stress.label}]{most if beyond else ''}")


# ---- at the contact ------------------------------------------------------------------------------

def contact_window(run: Run) -> tuple[np.ndarray, float] | None:
    """Middle (2,), as displaced, and width of the picture of a contact that is small, else None.

    Of several pieces of the boundary it is the one with the largest normal force.
    """
    if run.contact is None or run.last is None:
        return None
    times = run.contact["time"]
    rows = select(run.contact, times == times[np.abs(times - run.last.time).argmin()])
    force = -rows["sigma_n"] * rows["weight"]
    piece = max(pieces(rows), key=lambda own: force[own].sum())
    closed = piece[rows["status"][piece] != "open"]
    if not len(closed):
        return None
    xy = np.column_stack([rows["x"], rows["y"]])[closed]
    size = np.ptp(run.last.xy, axis=0).max()
    length = max(np.ptp(xy, axis=0).max(), rows["length"][closed].sum())
    if length > SMALL * size:
        return None
    width = ROOM * length if len(closed) > 2 else max(ROOM * length, SMALL * size)
    now = xy + run.last.displacement[vertices_of(run.last, select(rows, closed))]
    return (now.min(axis=0) + now.max(axis=0)) / 2, width


def contact_zoom(figure: Figure, run: Run) -> None:
    """Deformed bodies at a small contact, with the status of its nodes."""
    mesh, (middle, width) = run.last, contact_window(run)
    now = mesh.xy + mesh.displacement
    near = np.abs(now - middle).max(axis=1) < width
    local = replace(mesh, triangles=mesh.triangles[near[mesh.triangles].any(axis=1)])
    axes, scale = map_axes(figure, run, middle + width * np.array([[-0.5], [0.5]]))
    moved, place = now * scale.factor, middle * scale.factor
    half = width * scale.factor / 2
    draw_obstacles(axes, run, mesh.time, width * scale.factor, scale.factor,
                   np.array([place - half, place + half]), times=1.0)
    _planes(axes, run, mesh, moved, width * scale.factor, scale.factor)
    handles = status_nodes(axes, run, mesh, moved)
    if mesh.body.max() > 0 and run.boundary:
        rim = moved[mesh.rim()[0][outer(mesh, run.boundary)]]
        axes.add_collection(LineCollection(rim, colors=RED, linewidths=0.9))
    _stress(figure, axes, run, local, moved, True, float(mesh.von_mises[near].max()))
    x, y = place
    axes.set(xlim=(x - half, x + half), ylim=(y - 0.55 * half, y + 0.55 * half))
    run_header(figure, run, f"The contact{run.at(mesh.time)}, displacements to scale", handles)
    shrink_to_body(figure, axes)


def _planes(axes, run: Run, mesh: Mesh, moved: np.ndarray, width: float, factor: float) -> None:
    """Where closed nodes are far from the obstacle's known points, its planes beside them."""
    rows = rigid_rows(run, mesh.time) if run.obstacle is None else None
    if rows is None:
        return
    closed = select(rows, rows["status"] != "open")
    draw_planes(axes, closed, moved[vertices_of(mesh, closed)], width, factor)


def vertices_of(mesh: Mesh, rows: dict) -> np.ndarray:
    """(n,) vertices of the contact nodes of `rows` of contact.csv.

    Where two bodies have one in the same place it is that of the body which the normals leave.
    """
    corners = mesh.xy[mesh.triangles]
    inwards = np.zeros(mesh.xy.shape)
    np.add.at(inwards, mesh.triangles, corners.mean(axis=1, keepdims=True) - corners)
    inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-300)
    little = INSIDE * np.ptp(mesh.xy, axis=0).max()
    normal = np.column_stack([rows["normal_x"], rows["normal_y"]])
    places = np.column_stack([rows["x"], rows["y"]]) - little * normal
    return cKDTree(mesh.xy + little * inwards).query(places)[1]


def status_nodes(axes, run: Run, mesh: Mesh, moved: np.ndarray) -> list:
    """The contact nodes in the colours of their status; legend entries."""
    if run.contact is None:
        return []
    times = run.contact["time"]
    rows = select(run.contact, times == times[np.abs(times - mesh.time).argmin()])
    node = vertices_of(mesh, rows)
    started = mesh.time >= times.min() * (1 - 1e-9)
    for status, colour in STATUS.items():
        own = (rows["status"] == status) & started
        axes.plot(*moved[node[own]].T, "o", ms=4, mew=0.5, mec="white", color=colour, zorder=4)
    shown = [status for status in STATUS if (run.contact["status"] == status).any()]
    return [Line2D([], [], ls="", marker="o", ms=5, color=STATUS[status],
                   label=status_name(status, run.friction)) for status in shown]
