"""Pictures of the whole body: its parts and loads, and its deformation."""

import math

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import cKDTree

from .layout import run_header, map_axes, shrink_to_body
from .outline import bodies, outer, outward_edges, right_of, sample
from .reading import Run, select
from .scales import round_magnification, stress_scale
from .style import BLUE, GREEN, INK, RED

TINTS = ["#F1F1EC", "#DDE8F0", "#F3E6D8"]  # of bodies
ROLES = {"free": INK, "support": BLUE, "load": RED, "contact": GREEN, "pair": GREEN}


def hatch(axes, start, end, normal, size: float, colour) -> None:
    """Short slanted marks outside some edges."""
    points, edge = sample(start, end, 0.028 * size)
    out = normal[edge]
    tips = points + 0.034 * size * (out + np.column_stack([-out[:, 1], out[:, 0]])) / math.sqrt(2)
    axes.add_collection(LineCollection(
        np.stack([points, tips], axis=1), colors=colour, linewidths=0.6))
    axes.update_datalim(tips)


def foundation(axes, contact: dict, start, end, size: float, factor: float) -> None:
    """The rigid foundation: the contact boundary moved outward by its gap and by a little more,
    hatched."""
    nodes = cKDTree(np.column_stack([contact["x"], contact["y"]]) * factor)
    # Without the little more the foundation would hide the contact boundary where the gap is zero.
    away = contact["gap"] * factor + 0.016 * size
    shift = away[:, None] * np.column_stack([contact["normal_x"], contact["normal_y"]])
    start, end = (p + shift[nodes.query(p)[1]] for p in (start, end))
    axes.add_collection(LineCollection(np.stack([start, end], axis=1), colors=INK, linewidths=0.8))
    hatch(axes, start, end, right_of(start, end), size, INK)


def load_arrows(axes, edges, traction: np.ndarray, label: np.ndarray, size: float) -> None:
    """Tractions as arrows that end on the body when they push and start on it when they pull."""
    start, end, normal = edges
    longest = np.linalg.norm(traction, axis=1).max()
    for name in np.unique(label):
        own = np.flatnonzero(label == name)
        points, edge = sample(start[own], end[own], 0.075 * size)
        edge = own[edge]
        arrow = 0.16 * size * traction[edge] / longest
        points = points + 0.012 * size * normal[edge]
        pushes = np.sum(arrow * normal[edge], axis=1) < 0
        tails = np.where(pushes[:, None], points - arrow, points)
        axes.quiver(*tails.T, *arrow.T, angles="xy", scale_units="xy", scale=1, color=RED,
                    units="inches",
                    width=0.014, headwidth=4.5, headlength=6, headaxislength=5.5, zorder=3)
        axes.update_datalim(np.concatenate([tails, tails + arrow]))


def paint_body(axes, xy: np.ndarray, triangles: np.ndarray, values, **style):
    """One flat colour a triangle, as a bitmap: 1e5 triangles in a PDF would choke a reader."""
    return axes.tripcolor(*xy.T, triangles, facecolors=values, rasterized=True, antialiased=False,
                          **style)


def geometry(figure: Figure, run: Run) -> None:
    """Body, parts of its boundary, loads at amplitude one, rigid foundation and subdomains."""
    mesh, boundary, role = run.first, run.boundary, run.boundary["role"]
    axes, scale = map_axes(figure, run, mesh.xy)
    xy, size = mesh.xy * scale.factor, np.ptp(mesh.xy, axis=0).max() * scale.factor
    start, end, normal = outward_edges(boundary, mesh)
    start, end = start * scale.factor, end * scale.factor
    body = bodies(mesh, boundary)
    paint_body(axes, xy, mesh.triangles, body % len(TINTS),
               cmap=ListedColormap(TINTS), vmin=0, vmax=len(TINTS) - 1)
    inner = LineCollection(xy[mesh.rim()[0]], colors="0.62", linewidths=0.35, rasterized=True)
    axes.add_collection(inner)
    for name, colour in ROLES.items():
        own = role == name
        if own.any():
            lines = np.stack([start[own], end[own]], axis=1)
            axes.add_collection(LineCollection(lines, colors=colour, capstyle="round", zorder=2.5,
                                               linewidths=1 if name == "free" else 2.2))
    part = {n: (start[role == n], end[role == n], normal[role == n]) for n in ROLES}
    if (role == "support").any():
        hatch(axes, *part["support"], size, BLUE)
    if (role == "contact").any() and run.contact:
        last = run.contact["step"] == run.contact["step"].max()
        foundation(axes, select(run.contact, last), *part["contact"][:2], size, scale.factor)
    traction = np.column_stack([boundary["traction_x"], boundary["traction_y"]])[role == "load"]
    if np.any(traction):
        load_arrows(axes, part["load"], traction, boundary["label"][role == "load"], size)
    axes.autoscale_view()
    longest = np.linalg.norm(traction, axis=1).max(initial=0)
    stress = stress_scale(run, longest)
    arrow = ""
    if longest:
        arrow = rf"longest arrow {longest * stress.factor:.3g} {stress.label} at $\varphi = 1$"
    run_header(figure, run, "Geometry, boundary conditions and subdomains",
               geometry_legend(run, role), arrow)
    shrink_to_body(figure, axes)


def geometry_legend(run: Run, role: np.ndarray) -> list:
    """Legend entries for the boundary parts that occur."""
    names = {"support": r"$\Gamma_u$ support", "load": r"$\Gamma_p$ traction",
             "contact": r"$\Gamma_c$ contact, rigid foundation",
             "pair": r"$\Gamma_c$ contact of two bodies", "free": "free"}
    handles = [Line2D([], [], color=ROLES[n], lw=1 if n == "free" else 2.2, label=text)
               for n, text in names.items() if (role == n).any()]
    if run.summary["sizes"]["subdomains"] > 1:
        handles.append(Line2D([], [], color="0.62", lw=0.6, label="subdomains"))
    return handles


def magnification(run: Run) -> float:
    """300 as in the slides for their model, else what shows the largest displacement as 8%."""
    largest = np.linalg.norm(run.last.displacement, axis=1).max()
    if run.scene == "model":
        return 300.0
    size = np.ptp(run.last.xy, axis=0).max()
    return round_magnification(0.08 * size / largest) if largest else 1.0


def deformed(figure: Figure, run: Run) -> None:
    """Magnified deformed body with von Mises stress, and the undeformed outline."""
    mesh, times = run.last, magnification(run)
    axes, scale = map_axes(figure, run, mesh.xy)
    stress = stress_scale(run, np.percentile(mesh.von_mises, 99.5))
    values = mesh.von_mises * stress.factor
    top = np.percentile(values, 99.5)
    # corner singularities, which grow with refinement, must not take all colours
    beyond = values.max() > 1.05 * top
    moved = (mesh.xy + times * mesh.displacement) * scale.factor
    limit = top if beyond else values.max() or 1
    picture = paint_body(axes, moved, mesh.triangles, values, cmap="viridis", vmin=0, vmax=limit)
    handles, note = [], ""
    if run.boundary:
        b = {n: run.boundary[n] * scale.factor for n in ("x0", "y0", "x1", "y1")}
        outline = np.stack([np.column_stack([b["x0"], b["y0"]]),
                           np.column_stack([b["x1"], b["y1"]])], axis=1)
        axes.add_collection(LineCollection(outline, colors=INK, linewidths=0.7))
        handles.append(Line2D([], [], color=INK, lw=0.7, label="undeformed outline"))
        # where they touch, the colours alone may not distinguish them
        if bodies(mesh, run.boundary).max() > 0:
            rim = moved[mesh.rim()[0][outer(mesh, run.boundary)]]
            axes.add_collection(LineCollection(rim, colors=RED, linewidths=0.9))
            handles.append(Line2D([], [], color=RED, lw=0.9, label="bodies"))
            note = "gaps are not magnified: bodies overlap in the picture alone"
    axes.autoscale_view()
    wide = np.ptp(moved[:, 0]) > 1.3 * np.ptp(moved[:, 1])
    bar = figure.colorbar(picture, ax=axes, location="bottom" if wide else "right", aspect=40,
                          pad=0.02, extend="max" if beyond else "neither")
    largest = f", largest value {values.max():.3g}" if beyond else ""
    bar.set_label(f"von Mises stress [{stress.label}]{largest}")
    size = f"{times:,.0f}".replace(",", "\u2009") if times >= 1 else f"{times:g}"
    run_header(figure, run, f"Deformed body{run.at(mesh.time)}, displacements magnified {size}×",
               handles, note)
    shrink_to_body(figure, axes)
