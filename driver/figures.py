"""Last stage: draw the figures of a run from the files it left, never from the solver.

Every figure is 16 cm wide, written as .png and .pdf into ``<run>/figures``. A figure for which the scene
declares nothing (no contact, no friction, a static problem) is not drawn. Signs are those of contact.csv:
n is the outward normal of the body, t is n turned by +90 degrees, sigma_n <= 0 is compression.
"""

import csv
import json
import math
import os
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import matplotlib
import meshio
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator
from scipy.spatial import cKDTree

from .errors import InputError

INCH = 1 / 2.54  # inches in a centimetre
WIDTH = 16 * INCH
PAD = 0.06  # inches around the title and the legend
PANELS = 4  # contact boundaries that fit in one figure
POINTS = 4000  # markers a convergence plot can carry before it turns into a smear
WORDS = {"status", "kind", "role"}  # the columns that are not numbers

# Okabe and Ito's palette keeps its contrasts for colour-blind readers.
BLUE, ORANGE, GREEN, RED, INK = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#222222"
STATUS = {"open": "#C8C8C8", "stick": BLUE, "slip": ORANGE}
KINDS = {"start": (INK, "D", 3.2), "cg": (BLUE, "o", 1.7), "expansion": (ORANGE, "^", 2.4),
         "proportioning": (GREEN, "s", 2.4)}
ROLES = {"free": INK, "support": BLUE, "load": RED, "contact": GREEN, "pair": GREEN}

STYLE = {
    "font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9,
    "legend.fontsize": 8, "xtick.labelsize": 8, "ytick.labelsize": 8,
    "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "lines.linewidth": 1.3, "lines.markersize": 3.2, "axes.formatter.useoffset": False,
    "hatch.linewidth": 0.5, "pdf.fonttype": 42, "figure.constrained_layout.h_pad": 0.05,
}


# ------------------------------------------------------------------------------------------ data

@dataclass
class Mesh:
    """Torn mesh of one step: points (n, 2), triangles (m, 3), displacement (n, 2), von Mises stress (m,)."""

    time: float
    xy: np.ndarray
    triangles: np.ndarray
    displacement: np.ndarray
    von_mises: np.ndarray

    def rim(self):
        """Edges (e, 2) of the subdomain boundaries and, for each, the corner of its triangle inside."""
        i, j, k = self.triangles.T
        pairs = np.concatenate([np.column_stack(c) for c in ((i, j), (j, k), (k, i))])
        keys = np.sort(pairs, axis=1) @ [len(self.xy), 1]
        _, first, count = np.unique(keys, return_index=True, return_counts=True)
        once = first[count == 1]
        return pairs[once], np.concatenate([k, i, j])[once]


@dataclass
class Run:
    """All that the figures are drawn from. Tables are dicts of columns; what a run lacks is None."""

    summary: dict
    history: dict
    contact: dict | None
    convergence: dict | None
    boundary: dict | None
    first: Mesh | None
    last: Mesh | None
    adaptivity: dict | None = None

    @property
    def quasistatic(self) -> bool:
        return self.summary["effects"]["time"] == "quasistatic"

    @property
    def friction(self) -> bool:
        return self.summary["effects"]["friction"] != "none"

    @property
    def fixed_point(self) -> bool:
        """Does the bound depend on the solution, so that a fixed point is sought in every step?"""
        return self.summary["effects"]["friction"].startswith("coulomb")

    @property
    def scene(self) -> str:
        return Path(self.summary["scene"]).stem

    def at(self, time: float) -> str:
        return f" at $t = {time:g}$" if self.quasistatic else ""


def read_table(path: Path) -> dict | None:
    """Columns of a CSV file as arrays, empty numbers as nan; None if the file is absent or has no rows."""
    if not path.exists():
        return None
    with open(path, newline="") as file:
        names, *rows = csv.reader(file)
    if not rows:
        return None
    return {n: np.array(c) if n in WORDS else np.array([v or "nan" for v in c], dtype=float)
            for n, c in zip(names, zip(*rows))}


def read_mesh(path: Path, time: float) -> Mesh:
    """One .vtu of a run."""
    data = meshio.read(path)
    return Mesh(time, data.points[:, :2], data.cells_dict["triangle"].astype(np.int64),
                data.point_data["displacement"][:, :2], data.cell_data_dict["von_mises"]["triangle"].ravel())


def read_run(directory: Path) -> Run:
    """Read a run directory; raises InputError if it is not one."""
    for name in ("summary.json", "history.csv"):
        if not (directory / name).exists():
            raise InputError(f"{directory} holds no {name}: run the scene before drawing it")
    first = last = None
    if (directory / "fields.pvd").exists():
        sets = [(float(d.get("timestep")), directory / d.get("file"))
                for d in ElementTree.parse(directory / "fields.pvd").iter("DataSet")]
        if sets:
            first, last = (read_mesh(path, time) for time, path in (min(sets), max(sets)))
    tables = {n: read_table(directory / f"{n}.csv") for n in ("history", "contact", "convergence", "boundary", "adaptivity")}
    return Run(json.loads((directory / "summary.json").read_text()), first=first, last=last, **tables)


def select(table: dict, rows) -> dict:
    """The rows of a table picked by a mask or an index array."""
    return {name: column[rows] for name, column in table.items()}


def contact_boundaries(contact: dict) -> list[tuple[int, dict]]:
    """(label, rows sorted by step and arc) of every contact boundary; one unnamed boundary is label 0."""
    label = contact.get("boundary", np.zeros(len(contact["step"])))
    order = np.lexsort((contact["arc"], contact["step"]))
    return [(int(b), select(contact, order[label[order] == b])) for b in np.unique(label)]


def segment_ends(arc: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The n+1 ends of the dual segments of n nodes: midpoints inside, the segments' lengths at both ends."""
    if len(arc) == 1:
        return arc[0] + weight[0] * np.array([-0.5, 0.5])
    middle = (arc[1:] + arc[:-1]) / 2
    return np.concatenate([[middle[0] - weight[0]], middle, [middle[-1] + weight[-1]]])


# ----------------------------------------------------------------------------------------- units

class Scale(NamedTuple):
    """Multiply by `factor` to get numbers in the unit called `label`."""

    factor: float
    label: str


PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def split_unit(unit: str) -> tuple[int, str | None]:
    """Exponent and base of an SI unit of length or stress, e.g. (6, "Pa") for MPa; base None for others."""
    for base in ("Pa", "m"):
        for exponent, prefix in PREFIXES.items():
            if unit in (prefix + base, prefix.replace("µ", "u") + base):
                return exponent, base
    return 0, None


def scale_for(unit: str, values) -> Scale:
    """Scale that brings `values` between 1 and 1000, with an SI prefix if the unit is a known one."""
    values = np.abs(np.asarray(values, dtype=float))
    peak = values.max(initial=0.0)
    known, base = (split_unit(unit) if unit != "N/m" else (0, "N/m"))
    thousands = 3 * math.floor(math.log10(peak * 10**known) / 3 + 1e-12) if peak > 0 else known
    if base:
        exponent = min(max(thousands, -9), 9)
        return Scale(10.0 ** (known - exponent), PREFIXES[exponent] + base)
    plain = "" if unit in ("", "1", "-") else unit
    if peak == 0 or 0.1 <= peak < 1e4:
        return Scale(1.0, plain or "–")
    return Scale(10.0**-thousands, rf"$10^{{{thousands}}}$ {plain}".strip())


def length_scale(run: Run, values) -> Scale:
    return scale_for(run.summary["units"]["length"], values)


def stress_scale(run: Run, values) -> Scale:
    return scale_for(run.summary["units"]["stress"], values)


def force_scale(run: Run, values) -> Scale:
    """Scale of resultants of tractions over a line, force per unit of thickness."""
    length, stress = run.summary["units"]["length"], run.summary["units"]["stress"]
    (a, metre), (b, pascal) = split_unit(length), split_unit(stress)
    if metre != "m" or pascal != "Pa":
        product = "·".join(u for u in (stress, length) if u not in ("", "1", "-"))
        return scale_for(product, values)
    scale = scale_for("N/m", np.asarray(values) * 10.0 ** (a + b))
    return Scale(scale.factor * 10.0 ** (a + b), scale.label)


def round_magnification(raw: float) -> float:
    """The number among 1, 2, 3, 5 times a power of ten that is nearest to `raw` on a log scale."""
    power = 10.0 ** math.floor(math.log10(raw))
    return min((m * power for m in (1, 2, 3, 5, 10)), key=lambda m: abs(math.log(m / raw)))


# ---------------------------------------------------------------------------------------- layout

def header(figure: Figure, run: Run, caption: str, handles: list, note: str = "") -> None:
    """Title, identity of the run and legend, stacked above the axes."""
    state = "" if run.summary["converged"] else " (not converged)"
    variant = run.summary.get("variant")
    identity = ", ".join(w for w in (f"scene {run.scene}", variant, note) if w)
    figure.text(0.5, 1, caption + state, ha="center", va="top", fontsize=10)
    figure.text(0.5, 1, identity, ha="center", va="top", fontsize=8, color="0.35")
    columns = len(handles)
    while handles:
        figure.legend(handles=handles, loc="upper center", ncols=columns, frameon=False, borderpad=0,
                      handlelength=1.8, columnspacing=1.4, borderaxespad=0)
        width = figure.legends[0].get_window_extent(figure.canvas.get_renderer()).width
        if columns == 1 or width < figure.bbox.width - 2 * PAD * figure.dpi:
            break
        figure.legends[0].remove()
        columns -= 1
    place_header(figure)


def place_header(figure: Figure) -> None:
    """Stack title, identity and legend from the top down and leave the rest to the axes."""
    inches = figure.get_figheight()
    top = 1 - PAD / inches
    for artist in (*figure.texts, *figure.legends):
        if artist in figure.legends:
            artist.set_bbox_to_anchor((0.5, top), transform=figure.transFigure)
        else:
            artist.set_position((0.5, top))
        height = artist.get_window_extent(figure.canvas.get_renderer()).height / figure.dpi
        top -= (height + PAD) / inches
    figure.get_layout_engine().set(rect=(0, 0, 1, top))


def shrink_to_body(figure: Figure, axes) -> None:
    """Take from the figure the height that equal scales of x and y leave unused."""
    figure.draw_without_rendering()
    slack = axes.get_position(original=True).height - axes.get_position().height
    figure.set_figheight(figure.get_figheight() * (1 - slack))
    place_header(figure)


def map_axes(figure: Figure, run: Run, xy: np.ndarray):
    """Axes with equal scales for a picture of the body, and the scale of its coordinates."""
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    scale = length_scale(run, xy)
    axes.set(xlabel=f"$x$ [{scale.label}]", ylabel=f"$y$ [{scale.label}]")
    return axes, scale


def panel_grid(figure: Figure, boundaries: list, stacked: int, height: float) -> list:
    """For every boundary a list of `stacked` axes with a common arc axis; at most two boundaries a row."""
    columns = min(len(boundaries), 2)
    rows = math.ceil(len(boundaries) / columns)
    figure.set_figheight(height * INCH * rows)
    grid = figure.subplots(rows * stacked, columns, squeeze=False)
    cells = []
    for number in range(rows * columns):
        row, column = divmod(number, columns)
        cell = list(grid[row * stacked:(row + 1) * stacked, column])
        if number >= len(boundaries):
            for axes in cell:
                axes.remove()
            continue
        for axes in cell[:-1]:
            axes.sharex(cell[-1])
            axes.tick_params(labelbottom=False)
        if len(boundaries) > 1:
            cell[0].set_title(rf"$\Gamma_c$, label {boundaries[number][0]}")
        cells.append(cell)
    return cells


def left_out(boundaries: list) -> str:
    """Says how many contact boundaries did not find a panel."""
    return f"{PANELS} of {len(boundaries)} contact boundaries shown" if len(boundaries) > PANELS else ""


# -------------------------------------------------------------------------------------- geometry

def right_of(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Unit normals (e, 2) on the right of directed edges."""
    along = end - start
    return np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)


def outward_edges(boundary: dict, mesh: Mesh):
    """Boundary edges as (start, end, outward normal), directed so that the body lies on their left."""
    start = np.column_stack([boundary["x0"], boundary["y0"]])
    end = np.column_stack([boundary["x1"], boundary["y1"]])
    edges, inside = mesh.rim()
    nearest = cKDTree(mesh.xy[edges].mean(axis=1)).query((start + end) / 2)[1]
    inward = mesh.xy[inside[nearest]] - start
    turned = np.sum(inward * right_of(start, end), axis=1) > 0
    start[turned], end[turned] = end[turned], start[turned].copy()
    return start, end, right_of(start, end)


def chains(start: np.ndarray, end: np.ndarray) -> list[list[int]]:
    """Edge numbers grouped into connected chains, each in the order of its edges."""
    size = np.ptp(np.concatenate([start, end]), axis=0).max()

    def key(point):
        return tuple(np.rint(point / size * 1e7).astype(np.int64))

    following = {}
    for edge, point in enumerate(start):
        following.setdefault(key(point), []).append(edge)
    reached = {key(point) for point in end}
    heads = [e for e, point in enumerate(start) if key(point) not in reached]
    found, used = [], set()
    for edge in heads + list(range(len(start))):  # whatever no head leads to is a closed curve
        chain = []
        while edge is not None and edge not in used:
            used.add(edge)
            chain.append(edge)
            edge = next((e for e in following.get(key(end[edge]), []) if e not in used), None)
        if chain:
            found.append(chain)
    return found


def sample(start: np.ndarray, end: np.ndarray, spacing: float):
    """Points spread evenly over the chains of some edges, and the edge that each lies on."""
    points, owners = [], []
    for chain in chains(start, end):
        chain = np.array(chain)
        length = np.linalg.norm(end[chain] - start[chain], axis=1)
        ends = np.cumsum(length)
        number = max(1, round(ends[-1] / spacing))
        position = (np.arange(number) + 0.5) * ends[-1] / number
        place = np.searchsorted(ends, position)
        part = 1 - (ends[place] - position) / length[place]
        edge = chain[place]
        points.append(start[edge] + part[:, None] * (end[edge] - start[edge]))
        owners.append(edge)
    return np.concatenate(points), np.concatenate(owners)


def hatch(axes, start, end, normal, size: float, colour) -> None:
    """Short slanted marks outside some edges."""
    points, edge = sample(start, end, 0.028 * size)
    out = normal[edge]
    tips = points + 0.034 * size * (out + np.column_stack([-out[:, 1], out[:, 0]])) / math.sqrt(2)
    axes.add_collection(LineCollection(np.stack([points, tips], axis=1), colors=colour, linewidths=0.6))
    axes.update_datalim(tips)


def foundation(axes, contact: dict, start, end, size: float, factor: float) -> None:
    """The rigid foundation: the contact boundary moved outward by its gap and by a little more, hatched."""
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
        axes.quiver(*tails.T, *arrow.T, angles="xy", scale_units="xy", scale=1, color=RED, units="inches",
                    width=0.014, headwidth=4.5, headlength=6, headaxislength=5.5, zorder=3)
        axes.update_datalim(np.concatenate([tails, tails + arrow]))


def paint_body(axes, xy: np.ndarray, triangles: np.ndarray, values, **style):
    """One flat colour a triangle; a bitmap even in the PDF, where 1e5 triangles would choke a reader."""
    return axes.tripcolor(*xy.T, triangles, facecolors=values, rasterized=True, antialiased=False, **style)


def geometry(figure: Figure, run: Run) -> None:
    """Body, parts of its boundary, loads at amplitude one, rigid foundation and subdomains."""
    mesh, boundary, role = run.first, run.boundary, run.boundary["role"]
    axes, scale = map_axes(figure, run, mesh.xy)
    xy, size = mesh.xy * scale.factor, np.ptp(mesh.xy, axis=0).max() * scale.factor
    start, end, normal = outward_edges(boundary, mesh)
    start, end = start * scale.factor, end * scale.factor
    paint_body(axes, xy, mesh.triangles, np.zeros(len(mesh.triangles)), cmap=ListedColormap(["#F1F1EC"]))
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
    arrow = rf"longest arrow {longest * stress.factor:.3g} {stress.label} at $\varphi = 1$" if longest else ""
    header(figure, run, "Geometry, boundary conditions and subdomains", geometry_legend(run, role), arrow)
    shrink_to_body(figure, axes)


def geometry_legend(run: Run, role: np.ndarray) -> list:
    """Legend entries for the boundary parts that occur."""
    names = {"support": r"$\Gamma_u$ support", "load": r"$\Gamma_p$ traction",
             "contact": r"$\Gamma_c$ contact, rigid foundation", "pair": r"$\Gamma_c$ contact of two bodies",
             "free": "free"}
    handles = [Line2D([], [], color=ROLES[n], lw=1 if n == "free" else 2.2, label=text)
               for n, text in names.items() if (role == n).any()]
    if run.summary["sizes"]["subdomains"] > 1:
        handles.append(Line2D([], [], color="0.62", lw=0.6, label="subdomains"))
    return handles


# ------------------------------------------------------------------------------------ whole body

def loading(figure: Figure, run: Run) -> None:
    """Amplitudes of the load patterns over time, with a marker at every step."""
    histories = list(run.summary["amplitudes"].values())
    figure.set_figheight(6.5 * INCH)
    axes = figure.add_subplot()
    handles = []
    for number, (name, values) in enumerate(run.summary["amplitudes"].items()):
        symbol = r"$\varphi(t)$" if len(histories) == 1 else rf"$\varphi_{{{name}}}(t)$"
        times = np.linspace(0, run.summary["t_end"], len(values))
        handles += axes.plot(times, values, "-", marker="osD^v"[number % 5], ms=3.2,
                             color=[BLUE, RED, GREEN, ORANGE, INK][number % 5], label=symbol)
    axes.set(xlabel="time $t$", ylabel=r"amplitude $\varphi$ [–]" if len(histories) == 1 else "amplitude [–]")
    axes.margins(x=0.02)
    axes.autoscale_view()
    axes.grid(color="0.9", lw=0.5)
    steps = int(run.history["step"].max())
    header(figure, run, f"History of loading, {steps} time steps (markers)", handles)


def magnification(run: Run) -> float:
    """300 as in the slides for their model example, else what shows the largest displacement as about 8%."""
    largest = np.linalg.norm(run.last.displacement, axis=1).max()
    if run.scene == "model":
        return 300.0
    return round_magnification(0.08 * np.ptp(run.last.xy, axis=0).max() / largest) if largest else 1.0


def deformed(figure: Figure, run: Run) -> None:
    """Magnified deformed body with von Mises stress at the last time, and the undeformed outline."""
    mesh, times = run.last, magnification(run)
    axes, scale = map_axes(figure, run, mesh.xy)
    stress = stress_scale(run, np.percentile(mesh.von_mises, 99.5))
    values = mesh.von_mises * stress.factor
    top = np.percentile(values, 99.5)
    # Corner singularities grow with refinement; they must not take the colours from the rest of the body.
    beyond = values.max() > 1.05 * top
    moved = (mesh.xy + times * mesh.displacement) * scale.factor
    limit = top if beyond else values.max() or 1
    picture = paint_body(axes, moved, mesh.triangles, values, cmap="viridis", vmin=0, vmax=limit)
    handles = []
    if run.boundary:
        b = {n: run.boundary[n] * scale.factor for n in ("x0", "y0", "x1", "y1")}
        outline = np.stack([np.column_stack([b["x0"], b["y0"]]), np.column_stack([b["x1"], b["y1"]])], axis=1)
        axes.add_collection(LineCollection(outline, colors=INK, linewidths=0.7))
        handles.append(Line2D([], [], color=INK, lw=0.7, label="undeformed outline"))
    axes.autoscale_view()
    wide = np.ptp(moved[:, 0]) > 1.3 * np.ptp(moved[:, 1])
    bar = figure.colorbar(picture, ax=axes, location="bottom" if wide else "right", aspect=40, pad=0.02,
                          extend="max" if beyond else "neither")
    largest = f", largest value {values.max():.3g}" if beyond else ""
    bar.set_label(f"von Mises stress [{stress.label}]{largest}")
    size = f"{times:,.0f}".replace(",", "\u2009") if times >= 1 else f"{times:g}"
    header(figure, run, f"Deformed body{run.at(mesh.time)}, displacements magnified {size}×", handles)
    shrink_to_body(figure, axes)


# --------------------------------------------------------------------------------- contact zones

def pale(colour: str) -> tuple:
    """A tint light enough to carry curves."""
    return tuple(0.72 + 0.28 * c for c in to_rgb(colour))


def status_names(run: Run) -> dict:
    """What the legend calls each status; without friction a closed node neither sticks nor slips."""
    return {"open": "open", "stick": "stick", "slip": "slip" if run.friction else "contact"}


def shade_zones(axes, rows: dict, factor: float) -> None:
    """Tint the background by the status of the nodes' dual segments."""
    ends = segment_ends(rows["arc"], rows["weight"]) * factor
    status = rows["status"]
    jumps = np.flatnonzero(status[1:] != status[:-1]) + 1
    for left, right in zip([0, *jumps], [*jumps, len(status)]):
        axes.axvspan(ends[left], ends[right], color=pale(STATUS[status[left]]), lw=0, zorder=0)
    axes.set_xlim(ends[0], ends[-1])


def zone_handles(run: Run, status: np.ndarray, tint) -> list:
    """Legend patches for the statuses that occur; a frictionless closed node is one kind, however written."""
    names = status_names(run)
    return [Patch(facecolor=tint(STATUS[s]), edgecolor="0.5", lw=0.4, label=names[s])
            for s in STATUS if (status == s).any()]


def final_boundaries(run: Run) -> list:
    """Contact boundaries with their rows of the last step, in the order of arc."""
    last = select(run.contact, run.contact["step"] == run.contact["step"].max())
    if not run.friction:
        last["status"] = np.where(last["status"] == "open", "open", "slip")
    return contact_boundaries(last)


def curve_style(nodes: int) -> dict:
    """Markers show the nodes as long as they can be told apart."""
    return {"marker": "o", "ms": 2.6} if nodes <= 60 else {"lw": 1.1}


def contact_scales(run: Run, shown: list, stresses: tuple, displacements: tuple):
    """Scales of arc, stress and displacement common to all panels of a figure."""
    def gather(names):
        return np.concatenate([rows[n] for _, rows in shown for n in names])
    return (length_scale(run, gather(("arc",))), stress_scale(run, gather(stresses)),
            length_scale(run, np.append(gather(displacements), visible(run))))


def visible(run: Run) -> float:
    """Displacement that still counts as one: 1% of the body's largest; below it axes would show rounding."""
    return 0.01 * run.history["max_displacement"].max()


def widen(axes, span: float) -> None:
    """Limits of y at least `span` apart, about the same middle."""
    low, high = axes.get_ylim()
    if high - low < span:
        axes.set_ylim((low + high - span) / 2, (low + high + span) / 2)


def contact_panels(figure: Figure, run: Run, caption: str, panels: tuple) -> None:
    """Stress above displacement for every contact boundary; `panels` are the two functions that draw them."""
    boundaries = final_boundaries(run)
    shown = boundaries[:PANELS]
    names = (("sigma_n",), ("u_n",)) if panels[0] is normal_stress else (("sigma_t", "bound"), ("u_t",))
    arc, stress, length = contact_scales(run, shown, *names)
    handles = {}
    for (_, rows), (above, below) in zip(shown, panel_grid(figure, shown, 2, 11)):
        for axes, draw, scale in ((above, panels[0], stress), (below, panels[1], length)):
            shade_zones(axes, rows, arc.factor)
            lines = draw(axes, rows, rows["arc"] * arc.factor, scale)
            handles.update({line.get_label(): line for line in lines})
            axes.axhline(0, color="0.45", lw=0.5, zorder=1)
            axes.locator_params(axis="y", nbins=6)
        widen(below, visible(run) * length.factor)
        below.set_xlabel(rf"arc length along $\Gamma_c$ [{arc.label}]")
    figure.align_ylabels()
    status = np.concatenate([rows["status"] for _, rows in shown])
    time = run.contact["time"].max()
    header(figure, run, caption + run.at(time), [*handles.values(), *zone_handles(run, status, pale)],
           left_out(boundaries))


def normal_stress(axes, rows: dict, arc: np.ndarray, scale: Scale) -> list:
    """sigma_n over arc."""
    axes.set_ylabel(rf"$\sigma_n$ [{scale.label}]")
    return axes.plot(arc, rows["sigma_n"] * scale.factor, color=RED, label=r"stress $\sigma_n$",
                     **curve_style(len(arc)))


def normal_displacement(axes, rows: dict, arc: np.ndarray, scale: Scale) -> list:
    """u_n and the gap over arc; a gap that opens far beyond u_n is cut rather than flattening u_n."""
    u, gap = rows["u_n"] * scale.factor, rows["gap"] * scale.factor
    closed = rows["status"] != "open"
    matter = np.concatenate([u, gap[closed] if closed.any() else [gap.min()]])
    margin = 0.08 * (np.ptp(matter) or 1.0)
    axes.set_ylim(matter.min() - margin, matter.max() + margin)
    axes.set_ylabel(rf"$u_n$ [{scale.label}]")
    return (axes.plot(arc, gap, color=INK, ls=(0, (4, 2)), lw=1.0, label="gap")
            + axes.plot(arc, u, color=BLUE, label="displacement $u_n$", **curve_style(len(arc))))


def tangential_stress(axes, rows: dict, arc: np.ndarray, scale: Scale) -> list:
    """sigma_t between minus and plus its bound."""
    bound = rows["bound"] * scale.factor
    axes.set_ylabel(rf"$\sigma_t$ [{scale.label}]")
    axes.plot(arc, -bound, color=INK, ls=(0, (4, 2)), lw=1.0)
    return (axes.plot(arc, bound, color=INK, ls=(0, (4, 2)), lw=1.0, label=r"bound $\pm g$")
            + axes.plot(arc, rows["sigma_t"] * scale.factor, color=RED, label=r"stress $\sigma_t$",
                        **curve_style(len(arc))))


def tangential_displacement(axes, rows: dict, arc: np.ndarray, scale: Scale) -> list:
    """u_t over arc."""
    axes.set_ylabel(rf"$u_t$ [{scale.label}]")
    return axes.plot(arc, rows["u_t"] * scale.factor, color=BLUE, label="displacement $u_t$",
                     **curve_style(len(arc)))


def contact_normal(figure: Figure, run: Run) -> None:
    """Normal stress and displacement along the contact boundaries at the last time."""
    contact_panels(figure, run, r"Normal stress and displacement on $\Gamma_c$",
                   (normal_stress, normal_displacement))


def contact_tangential(figure: Figure, run: Run) -> None:
    """Tangential stress, its bound and tangential displacement at the last time."""
    contact_panels(figure, run, r"Tangential stress and displacement on $\Gamma_c$",
                   (tangential_stress, tangential_displacement))


def contact_status(figure: Figure, run: Run) -> None:
    """Open, stick and slip over arc and time; the cell of a step covers the time since the step before."""
    boundaries = contact_boundaries(run.contact)
    shown = boundaries[:PANELS]
    (arc, _, _), seen = contact_scales(run, shown, ("sigma_n",), ("u_n",)), []
    for (_, rows), (axes,) in zip(shown, panel_grid(figure, shown, 1, 8.5)):
        times, nodes = np.unique(rows["time"]), np.count_nonzero(rows["step"] == rows["step"][0])
        status = rows["status"]
        if not run.friction:
            status = np.where(status == "open", "open", "slip")
        codes = np.array([list(STATUS).index(s) for s in status]).reshape(len(times), nodes)
        ends = segment_ends(rows["arc"][:nodes], rows["weight"][:nodes]) * arc.factor
        axes.pcolormesh(ends, np.concatenate([[0.0], times]), codes, vmin=0, vmax=2,
                        cmap=ListedColormap(list(STATUS.values())), rasterized=nodes * len(times) > 5000,
                        edgecolors="white" if nodes <= 60 and len(times) <= 60 else "none", linewidth=0.3)
        axes.set(xlabel=rf"arc length along $\Gamma_c$ [{arc.label}]", ylabel="time $t$")
        seen.append(status)
    header(figure, run, r"Contact status on $\Gamma_c$ over time",
           zone_handles(run, np.concatenate(seen), str), left_out(boundaries))


# ---------------------------------------------------------------------------------- convergence

def thin_out(table: dict) -> tuple[dict, int]:
    """Every k-th row and all start rows, with the smallest k that leaves about POINTS others; and k."""
    every = max(1, math.ceil(len(table["product"]) / POINTS))
    keep = (np.arange(len(table["product"])) % every == 0) | (table["kind"] == "start")
    return select(table, keep), every


def mark_steps(axes, table: dict) -> None:
    """Faint lines where time steps begin, with as many step numbers above as have room."""
    steps, first = np.unique(table["step"], return_index=True)
    begin = table["product"][first]
    for x in begin[1:]:
        axes.axvline(x, color="0.85", lw=0.5, zorder=0)
    room, ticks = 0.03 * np.ptp(table["product"]), []
    for step, x in zip(steps, begin):
        if not ticks or x - ticks[-1][1] >= room:
            ticks.append((step, x))
    top = axes.secondary_xaxis("top")
    top.set_xticks([x for _, x in ticks], [f"{s:.0f}" for s, _ in ticks])
    top.tick_params(labelsize=7, length=2)
    top.set_xlabel("time step (at its first product)", fontsize=8)


def convergence(figure: Figure, run: Run) -> None:
    """Relative projected gradient of the QP solver over the products with the dual operator."""
    table = run.convergence
    figure.set_figheight(9 * INCH)
    axes = figure.add_subplot()
    thin, every = thin_out(select(table, table["residual"] > 0))
    axes.semilogy(thin["product"], thin["residual"], color="0.75", lw=0.3, zorder=1)
    handles = []
    for kind, (colour, marker, size) in KINDS.items():
        own, total = thin["kind"] == kind, np.count_nonzero(table["kind"] == kind)
        if total:
            axes.plot(thin["product"][own], thin["residual"][own], ls="none", marker=marker, ms=size, mew=0,
                      color=colour, zorder=3 if kind == "start" else 2)
            handles.append(Line2D([], [], ls="none", marker=marker, ms=4, mew=0, color=colour,
                                  label=f"{kind} ({total:,})".replace(",", "\u2009")))
    axes.set(xlabel="dual multiplications, cumulative", ylabel="relative projected gradient [–]")
    axes.margins(x=0.01)
    mark_steps(axes, table)
    note = f"every {every}th iteration and all starts drawn" if every > 1 else ""
    header(figure, run, "Convergence of MPRGP", handles, note)


# ------------------------------------------------------------------------------------ adaptivity

def adaptivity(figure: Figure, run: Run) -> None:
    """The adapted mesh, and the error in the energy norm over the unknowns of all cycles."""
    figure.set_figheight(8.5 * INCH)
    body, error = figure.subplots(1, 2, width_ratios=[1.7, 1])
    scale = length_scale(run, run.first.xy)
    body.set_aspect("equal")
    body.triplot(*(run.first.xy * scale.factor).T, run.first.triangles, lw=0.25, color=INK, rasterized=True)
    body.set(xlabel=f"$x$ [{scale.label}]", ylabel=f"$y$ [{scale.label}]")
    size, relative = run.adaptivity["primal_dofs"], 100 * run.adaptivity["relative"]
    error.loglog(size, relative, "o-", color=BLUE, label="cycles")
    error.loglog(size, relative[0] * (size / size[0]) ** -0.5, "--", color="0.6", lw=0.8, label=r"$N^{-1/2}$")
    error.set(xlabel="primal unknowns $N$", ylabel="error in the energy norm [%]")
    error.grid(color="0.9", lw=0.5, which="both")
    for axis in (error.xaxis, error.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else ""))
    error.tick_params(which="both", labelsize=7)
    header(figure, run, "Adaptive refinement", error.get_legend_handles_labels()[0],
           f"{len(run.first.triangles)} triangles after {len(size) - 1} cycles")


# ----------------------------------------------------------------------------------------- history

def history(figure: Figure, run: Run) -> None:
    """Resultant contact forces over time and, with Coulomb friction, fixed-point iterations per step."""
    table = run.history
    forces = {"resultant_n": ("normal", RED, "o"), "resultant_t": ("tangential", BLUE, "s")}
    if not run.friction:
        del forces["resultant_t"]
    figure.set_figheight((11 if run.fixed_point else 7) * INCH)
    panels = figure.subplots(2 if run.fixed_point else 1, sharex=True, squeeze=False)[:, 0]
    scale = force_scale(run, np.concatenate([table[n] for n in forces]))
    handles = []
    for name, (word, colour, marker) in forces.items():
        handles += panels[0].plot(table["time"], table[name] * scale.factor, marker=marker, ms=3, color=colour,
                                  label=f"{word} resultant")
    panels[0].axhline(0, color="0.45", lw=0.5, zorder=1)
    panels[0].set_ylabel(f"contact force [{scale.label}]")
    if run.fixed_point:
        solved = select(table, table["step"] > 0)
        width = 0.7 * np.diff(solved["time"], prepend=0.0).min()
        panels[1].bar(solved["time"], solved["fixed_point_iterations"], width, color="0.55")
        panels[1].set_ylabel("fixed-point iterations")
        panels[1].yaxis.set_major_locator(MaxNLocator(6, integer=True))
    for axes in panels:
        axes.grid(color="0.9", lw=0.5)
        axes.set_axisbelow(True)
    panels[-1].set_xlabel("time $t$")
    figure.align_ylabels()
    total = int(table["fixed_point_iterations"].sum())
    caption, note = r"Resultant forces on $\Gamma_c$", ""
    if run.fixed_point:
        caption, note = f"{caption} and fixed-point iterations", f"{total} fixed-point iterations"
    header(figure, run, caption, handles, note)


# --------------------------------------------------------------------------------------- the run

def wanted(run: Run) -> dict:
    """The figures that the run has something to show for, in the order in which they are drawn."""
    steps = len(run.history["step"]) if run.history else 0
    touching = run.contact is not None
    moving = run.quasistatic and steps > 1
    choice = {
        geometry: run.boundary is not None and run.first is not None,
        loading: moving,
        deformed: run.last is not None,
        contact_normal: touching,
        contact_tangential: touching and run.friction,
        contact_status: touching and run.quasistatic and len(np.unique(run.contact["step"])) > 1,
        convergence: run.convergence is not None,
        history: touching and moving,
        adaptivity: run.adaptivity is not None and run.first is not None and np.isfinite(run.adaptivity["relative"]).all(),
    }
    return {draw.__name__: draw for draw, yes in choice.items() if yes}


FILES = ("geometry", "loading", "deformed", "contact_normal", "contact_tangential", "contact_status",
         "convergence", "history", "adaptivity")


def compose(name: str, run: Run) -> Figure:
    """The finished figure `name` of a run, laid out and not yet written."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 12 * INCH), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        wanted(run)[name](figure, run)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # frozen, so that the bitmap and the PDF are the same picture
    return figure


def write(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write .png and .pdf under temporary names and rename them; returns the final paths."""
    paths = []
    for kind, dpi, metadata in (("png", 150, {}), ("pdf", 300, {"CreationDate": None})):
        path, temporary = folder / f"{name}.{kind}", folder / f".{name}.{kind}.part"
        with matplotlib.rc_context(STYLE):
            figure.savefig(temporary, format=kind, dpi=dpi, metadata=metadata)
        os.replace(temporary, path)
        paths.append(path)
    return paths


def draw_run(directory: Path) -> list[Path]:
    """Draw all figures of a run directory into its folder ``figures``; returns the files written.

    Figures of an earlier run that this one has nothing to show for are removed. Raises InputError if the
    directory holds no run.
    """
    directory = Path(directory)
    run = read_run(directory)
    folder = directory / "figures"
    folder.mkdir(exist_ok=True)
    names = list(wanted(run))
    for name in set(FILES) - set(names):
        for kind in ("png", "pdf"):
            (folder / f"{name}.{kind}").unlink(missing_ok=True)
    return [path for name in names for path in write(compose(name, run), folder, name)]
