"""Stresses, displacements and status along the contact boundaries."""

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from . import theory
from .layout import fitting, panel_grid, run_header
from .reading import Run, contact_boundaries, segment_ends, select
from .scales import Scale, length_scale, stress_scale
from .style import BLUE, INK, RED, STATUS, status_name


FAINT = 0.01  # of the largest pressure: the least that an axis of stresses shows
MEET = 1.01  # nodes that share an edge are no farther apart than so many times their segments
LEAST = 0.02  # of an axis of arcs: closed zones in a picture of the status are at least as wide
NOTHING = 1e-9  # of the largest stress in the bodies, below which those on the boundary are zero


def pale(colour: str) -> tuple:
    """A tint light enough to carry curves."""
    return tuple(0.72 + 0.28 * c for c in to_rgb(colour))


def shade_zones(axes, rows: dict, factor: float) -> None:
    """Tint the background by the status of the nodes' dual segments."""
    limits, apart = [], breaks(rows)
    for first in rows["arc"][apart]:  # a gap in the tint also where arcs go on
        axes.axvline(first * factor, color="white", lw=4, zorder=0.5)
    for part in np.split(np.arange(len(rows["arc"])), apart):
        ends, status = segment_ends(rows["arc"][part], rows["length"][part]) * factor, (
            rows["status"][part])
        jumps = np.flatnonzero(status[1:] != status[:-1]) + 1
        for left, right in zip([0, *jumps], [*jumps, len(status)]):
            axes.axvspan(ends[left], ends[right], color=pale(STATUS[status[left]]), lw=0, zorder=0)
        limits += [ends[0], ends[-1]]
    axes.set_xlim(min(limits), max(limits))


def breaks(rows: dict) -> np.ndarray:
    """Places in the `rows` of a boundary's nodes at which another part begins that does not meet
    the one before.

    Nodes that share an edge are no farther apart than their dual segments are long or, where the
    other body ends beside that edge, as the nodes next to them are.
    """
    length = rows["length"]
    away = np.maximum(np.diff(rows["arc"]), np.hypot(np.diff(rows["x"]), np.diff(rows["y"])))
    reach = length[:-1] + length[1:]
    sides = np.concatenate([[0.0], np.where(away > MEET * reach, 0.0, away), [0.0]])
    return np.flatnonzero(away > MEET * np.maximum(reach, np.maximum(sides[:-2], sides[2:]))) + 1


def zone_handles(run: Run, status: np.ndarray, tint) -> list:
    """Legend patches for the statuses that occur; a frictionless closed node is one kind."""
    return [Patch(facecolor=tint(colour), edgecolor="0.5", lw=0.4,
                  label=status_name(s, run.friction))
            for s, colour in STATUS.items() if (status == s).any()]


def final_time(run: Run) -> float:
    """The end or, where contact is lost by then, the time of its largest resultant."""
    times = np.unique(run.contact["time"])
    return times[np.abs(times - run.summary.get("quantities_time", times[-1])).argmin()]


def final_boundaries(run: Run) -> list:
    """Contact boundaries with their rows at the time of the quantities, in the order of arc."""
    last = select(run.contact, run.contact["time"] == final_time(run))
    if not run.friction:
        last["status"] = np.where(last["status"] == "open", "open", "slip")
    return [(label, in_one(rows)) for label, rows in contact_boundaries(last)]


def in_one(rows: dict) -> dict:
    """Rows of a boundary, sorted by step and arc, whose arc does not begin inside of it.

    The arc of a closed outline begins at any of its nodes. What comes last and ends beside the
    first node then stands before it, with negative arcs.
    """
    nodes = np.count_nonzero(rows["step"] == rows["step"][0])
    one = {name: rows[name][:nodes] for name in ("arc", "length", "x", "y")}
    away = np.hypot(one["x"][-1] - one["x"][0], one["y"][-1] - one["y"][0])
    apart = breaks(one)
    if not len(apart) or not 0 < away < MEET * (one["length"][0] + one["length"][-1]):
        return rows
    back = np.where(np.arange(nodes) >= apart[-1], one["arc"][-1] + away - one["arc"][0], 0.0)
    rows = rows | {"arc": rows["arc"] - np.tile(back, len(rows["arc"]) // nodes)}
    return select(rows, np.lexsort((rows["arc"], rows["step"])))


def curve_style(nodes: int) -> dict:
    """Markers show the nodes as long as they can be distinguished."""
    return {"marker": "o", "ms": 2.6} if nodes <= 60 else {"lw": 1.1}


def contact_scales(run: Run, shown: list, stresses: tuple, displacements: tuple):
    """Scales of arc, stress and displacement common to all panels of a figure."""
    def gather(names):
        return np.concatenate([rows[n] for _, rows in shown for n in names])
    return (length_scale(run, gather(("arc",))),
            stress_scale(run, np.append(gather(stresses), least_stress(run))),
            length_scale(run, np.append(gather(displacements), visible(run))))


def visible(run: Run) -> float:
    """Smallest displacement worth a scale, 1% of the body's largest: less would show rounding."""
    return 0.01 * run.history["max_displacement"].max()


def least_stress(run: Run) -> float:
    """Smallest stress worth a scale: less would show rounding."""
    inside = run.last.von_mises.max() if run.last is not None else 0.0
    return max(FAINT * np.abs(run.contact["sigma_n"]).max(), NOTHING * inside)


def widen(axes, span: float) -> None:
    """Limits of y at least `span` apart, about the same middle; -1 and 1 where all is zero."""
    low, high = axes.get_ylim()
    if not any(np.any(line.get_ydata()) for line in axes.lines):
        axes.set_ylim(-1, 1)
    elif high - low < span:
        axes.set_ylim((low + high - span) / 2, (low + high + span) / 2)


def contact_panels(figure: Figure, run: Run, caption: str, panels: tuple) -> None:
    """Stress above displacement for every contact boundary, drawn by the two functions `panels`."""
    shown, note = fitting(final_boundaries(run), run.contact)
    names = ("sigma_t", "bound"), ("u_t",)
    if panels[0] is normal_stress:
        names = ("sigma_n",), ("u_n",)
    arc, stress, length = contact_scales(run, shown, *names)
    handles = {}
    for (_, rows), (above, below) in zip(shown, panel_grid(figure, run, shown, 2, 11)):
        rows["theory"] = theory.curves(run, rows)
        curves = in_parts(rows)
        for axes, draw, scale in ((above, panels[0], stress), (below, panels[1], length)):
            shade_zones(axes, rows, arc.factor)
            lines = draw(axes, curves, curves["arc"] * arc.factor, scale)
            handles.update({line.get_label(): line for line in lines})
            for line in lines:
                mark_alone(axes, line)
            axes.axhline(0, color="0.45", lw=0.5, zorder=1)
            axes.locator_params(axis="y", nbins=6)
        widen(above, least_stress(run) * stress.factor)
        widen(below, visible(run) * length.factor)
        below.set_xlabel(rf"arc length along $\Gamma_c$ [{arc.label}]")
    figure.align_ylabels()
    status = np.concatenate([rows["status"] for _, rows in shown])
    run_header(figure, run, caption + run.at(final_time(run)),
               [*handles.values(), *zone_handles(run, status, pale)], note)


def mark_alone(axes, line) -> None:
    """Mark the points of a line between others that are not: without markers none would be seen."""
    x, y = line.get_xydata().T
    known = np.concatenate([[False], np.isfinite(y), [False]])
    alone = np.flatnonzero(known[1:-1] & ~known[:-2] & ~known[2:])
    if len(alone):
        axes.plot(x[alone], y[alone], ls="none", marker="o", ms=2.6, color=line.get_color())


def in_parts(rows: dict) -> dict:
    """Rows with NaN, which curves leave out, between parts of a boundary that do not meet."""
    gaps = breaks(rows)

    def parted(values: np.ndarray) -> np.ndarray:
        return np.insert(values, gaps, np.nan if values.dtype == float else values[gaps])

    theory_of = {name: (label, parted(values))
                 for name, (label, values) in rows["theory"].items()}
    return {name: parted(values) for name, values in rows.items() if name != "theory"} | {
        "theory": theory_of}


def normal_stress(axes, rows: dict, arc: np.ndarray, scale: Scale) -> list:
    """sigma_n over arc."""
    axes.set_ylabel(rf"$\sigma_n$ [{scale.label}]")
    lines = axes.plot(arc, rows["sigma_n"] * scale.factor, color=RED, label=r"traction $\sigma_n$",
                      **curve_style(len(arc)))
    return lines + _theory(axes, rows, "sigma_n", arc, scale)


def _theory(axes, rows: dict, column: str, arc: np.ndarray, scale: Scale) -> list:
    """The closed form of a stress, where there is one."""
    if column not in rows.get("theory", {}):
        return []
    label, values = rows["theory"][column]
    return axes.plot(arc, values * scale.factor, color=INK, lw=0.9, ls=(0, (1, 1)), label=label)


def normal_displacement(axes, rows: dict, arc: np.ndarray, scale: Scale) -> list:
    """u_n over arc, and what it is at most: the gap, of surfaces that wear with the worn depth. One
    far beyond u_n is cut rather than flattening u_n.
    """
    worn = rows.get("wear", np.zeros_like(arc))
    u, gap = rows["u_n"] * scale.factor, (rows["gap"] + worn) * scale.factor
    name = "gap and worn depth" if "wear" in rows else "gap"
    closed = rows["status"] != "open"
    matter = np.concatenate([u, gap[closed] if closed.any() else [np.nanmin(gap)]])
    matter = matter[np.isfinite(matter)]
    margin = 0.08 * (np.ptp(matter) or 1.0)
    axes.set_ylim(matter.min() - margin, matter.max() + margin)
    axes.set_ylabel(rf"$u_n$ [{scale.label}]")
    return (axes.plot(arc, gap, color=INK, ls=(0, (4, 2)), lw=1.0, label=name)
            + axes.plot(arc, u, color=BLUE, label="displacement $u_n$", **curve_style(len(arc))))


def tangential_stress(axes, rows: dict, arc: np.ndarray, scale: Scale) -> list:
    """sigma_t between minus and plus its bound."""
    bound = rows["bound"] * scale.factor
    axes.set_ylabel(rf"$\sigma_t$ [{scale.label}]")
    axes.plot(arc, -bound, color=INK, ls=(0, (4, 2)), lw=1.0)
    return (axes.plot(arc, bound, color=INK, ls=(0, (4, 2)), lw=1.0, label=r"bound $\pm g$")
            + axes.plot(arc, rows["sigma_t"] * scale.factor, color=RED,
                        label=r"traction $\sigma_t$", **curve_style(len(arc)))
            + _theory(axes, rows, "sigma_t", arc, scale))


def tangential_displacement(axes, rows: dict, arc: np.ndarray, scale: Scale) -> list:
    """u_t over arc."""
    axes.set_ylabel(rf"$u_t$ [{scale.label}]")
    return axes.plot(arc, rows["u_t"] * scale.factor, color=BLUE, label="displacement $u_t$",
                     **curve_style(len(arc)))


def contact_normal(figure: Figure, run: Run) -> None:
    """Normal traction and displacement on the contact boundaries, at the quantities' time."""
    contact_panels(figure, run, r"Normal traction and displacement on $\Gamma_c$",
                   (normal_stress, normal_displacement))


def contact_tangential(figure: Figure, run: Run) -> None:
    """Shear traction, its bound and tangential displacement at the time of the quantities."""
    contact_panels(figure, run, r"Shear traction and displacement on $\Gamma_c$",
                   (tangential_stress, tangential_displacement))


def contact_status(figure: Figure, run: Run) -> None:
    """Open, stick and slip over arc and time; a step's cell covers the time since the last one."""
    boundaries = [(label, in_one(rows)) for label, rows in contact_boundaries(run.contact)]
    shown, missing = fitting(boundaries, run.contact)
    seen, widened = [], False
    arc = contact_scales(run, shown, ("sigma_n",), ("u_n",))[0]
    for (_, rows), (axes,) in zip(shown, panel_grid(figure, run, shown, 1, 8.5)):
        times, nodes = np.unique(rows["time"]), np.count_nonzero(rows["step"] == rows["step"][0])
        status = rows["status"]
        if not run.friction:
            status = np.where(status == "open", "open", "slip")
        codes = np.array([list(STATUS).index(s) for s in status]).reshape(len(times), nodes)
        one = {name: rows[name][:nodes] for name in ("arc", "length", "x", "y")}
        parts = [(part, segment_ends(one["arc"][part], one["length"][part]) * arc.factor)
                 for part in np.split(np.arange(nodes), breaks(one))]
        limits = min(ends[0] for _, ends in parts), max(ends[-1] for _, ends in parts)
        for part, ends in parts:
            axes.pcolormesh(ends, np.concatenate([[0.0], times]), codes[:, part], vmin=0, vmax=2,
                            cmap=ListedColormap(list(STATUS.values())),
                            rasterized=nodes * len(times) > 5000, linewidth=0.3,
                            edgecolors="white" if max(nodes, len(times)) <= 60 else "none")
            widened |= _narrow_zones(axes, ends, times, codes[:, part], limits)
        axes.set(xlabel=rf"arc length along $\Gamma_c$ [{arc.label}]", ylabel="time $t$")
        seen.append(status)
    note = ["narrow closed zones drawn wider"] * widened + [missing]
    run_header(figure, run, r"Contact status on $\Gamma_c$ over time",
               zone_handles(run, np.concatenate(seen), str), ", ".join(filter(None, note)))


def _narrow_zones(axes, ends: np.ndarray, times: np.ndarray, codes: np.ndarray,
                  limits: tuple) -> bool:
    """Draw closed zones between open nodes LEAST wide that would be hairlines; whether there are.

    `ends` (n + 1,) are those of the nodes' cells, `codes` (t, n) the places of their statuses.
    """
    wide, cells, colours = LEAST * (limits[1] - limits[0]), [], []
    for below, above, row in zip([0.0, *times], times, codes):
        closed = np.concatenate([[0], row > 0, [0]])
        for first, last in np.flatnonzero(np.diff(closed)).reshape(-1, 2):
            own = ends[first:last + 1]
            if own[-1] - own[0] >= wide:
                continue
            middle = np.clip((own[0] + own[-1]) / 2, limits[0] + wide / 2, limits[1] - wide / 2)
            own = middle + wide * ((own - own[0]) / (own[-1] - own[0]) - 0.5)
            cells += [[(x, below), (y, below), (y, above), (x, above)]
                      for x, y in zip(own, own[1:])]
            colours += [list(STATUS.values())[code] for code in row[first:last]]
    if cells:
        axes.add_collection(PolyCollection(cells, facecolors=colours, linewidths=0,
                                           antialiased=False, rasterized=len(cells) > 5000))
    return bool(cells)
