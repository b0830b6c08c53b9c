"""Cycles of a repeated history: the hysteresis loop, and how each cycle differs from the last."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from ..text import counted
from .history import coordinate, loops, markers
from .layout import run_header
from .reading import Run, contact_boundaries, select
from .scales import energy_scale, force_scale, length_scale
from .style import BLUE, GREEN, INCH, ORANGE, RED

LEAST = 1e-6  # of the largest way, below which none is drawn
VARIES = 1e-3  # of a force by which it varies at least in a loop


def cycles(figure: Figure, run: Run) -> None:
    """Force over displacement in all cycles; dissipated energy, changes and ways by cycle."""
    table = run.cycles
    figure.set_figheight(13.5 * INCH)
    (loop, work), (change, way) = figure.subplots(2, 2)
    named = _loop(loop, run, table)
    _work(work, run, table)
    _changes(change, table)
    _ways(way, run, table)
    first, last = table["cycle"][[0, -1]]
    for axes in (work, change, way):
        axes.set_xlabel("cycle")
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True, min_n_ticks=1))
        axes.set_xlim(first - 0.05 * max(last - first, 10), last + 0.05 * max(last - first, 10))
    for axes in (loop, work, change, way):
        axes.grid(color="0.9", lw=0.5)
        axes.set_axisbelow(True)
    found = run.summary["cycles"]
    verdict = "not settled" if found["settled_after"] is None else (
        f"settled from cycle {found['settled_after']} on")
    skipped = f", {found['skipped']} of them jumped over" if found["skipped"] else ""
    title = f"{counted(found['number'], 'cycle')}{skipped}: {found['last']['kind']}, {verdict}"
    if found["number"] == 1 and found["settled_after"] is None:
        title = "1 cycle, no previous cycle to compare with"
    run_header(figure, run, title, [], f"loop: {named}")


def _force_and_way(run: Run) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """What the loop shows, its steps, displacements and forces.

    That of the probe whose force does most work, or the shear force and the mean displacement u_t
    of the boundary with most of it; where such forces are constant, shear force and u_t of the node
    that moves most. Where obstacles move the way in place of u_t is that of `_way`.
    """
    probes = [(f"force and displacement of {name.replace('label', 'label ')}, "
               f"${coordinate(run, axis)}$",
               rows["step"], rows[f"u_{axis}"], rows[f"force_{axis}"])
              for name, axis, rows in loops(run)]
    own = []
    for label, rows in contact_boundaries(run.contact):
        steps, place = np.unique(rows["step"], return_inverse=True)
        weight = np.bincount(place, rows["weight"])
        named = f"shear force and mean {_named(run)} the contact boundary {label or ''}".strip()
        own.append((named, steps,
                    np.bincount(place, rows["weight"] * _way(run, rows)) / weight,
                    np.bincount(place, rows["weight"] * rows["sigma_t"])))
    vary = [curve for curve in probes or own
            if np.ptp(curve[3]) > VARIES * np.abs(curve[3]).max()]
    return max(vary or [_one_node(run)], key=lambda c: np.ptp(c[2]) * np.ptp(c[3]))


def _slides(run: Run) -> bool:
    """Whether obstacles move: what slides is not the body alone."""
    return bool(run.summary["effects"].get("obstacle_motion"))


def _named(run: Run) -> str:
    """What `_way` is, in words."""
    return "way of the other side past" if _slides(run) else "$u_t$ of"


def _way(run: Run, rows: dict) -> np.ndarray:
    """Displacement u_t of each of the rows, nodes step by step.

    Where obstacles move it is by how much what the node meets has gone past it so far, so that
    loops have the area of the work that friction takes.
    """
    if not _slides(run):
        return rows["u_t"]
    steps = len(np.unique(rows["step"]))
    return -np.cumsum(rows["slip"].reshape(steps, -1), axis=0).ravel()


def _one_node(run: Run) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """The same of the node whose force and slip do most work."""
    contact = run.contact
    way = np.bincount(contact["node"].astype(int), np.abs(
        contact["slip"] * contact["sigma_t"] * contact["weight"]))
    rows = select(contact, contact["node"] == way.argmax())
    place = f"({rows['x'][0]:.4g}, {rows['y'][0]:.4g})"
    return (f"shear force and {_named(run)} the contact node at {place}", rows["step"],
            _way(run, rows), rows["weight"] * rows["sigma_t"])


def _loop(axes, run: Run, table: dict) -> str:
    """The loop of every cycle, the last one on top; what it shows."""
    named, steps, u, force = _force_and_way(run)
    length, unit = length_scale(run, u), force_scale(run, force)
    ends = table["step"]
    count = ends[1] - ends[0] if len(ends) > 1 else ends[0] - np.searchsorted(
        run.history["time"], run.summary["cycles"]["start"] * (1 + 1e-12))
    for k, end in enumerate(ends):
        own = (steps >= end - count) & (steps <= end)
        if k and table["skipped"][k]:  # what comes before belongs to another cycle
            own &= steps > end - count
        last = k == len(ends) - 1
        style = markers(np.count_nonzero(own)) if last else {"lw": 0.7}
        axes.plot(u[own] * length.factor, force[own] * unit.factor,
                  color=RED if last else "0.7", zorder=2 + last, **style)
    axes.set(xlabel=rf"displacement $\delta$ [{length.label}]",
             ylabel=f"force $Q$ [{unit.label}]", title="hysteresis, last cycle in colour")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    return named


def _work(axes, run: Run, table: dict) -> None:
    scale = energy_scale(run, table["dissipated"])
    axes.plot(table["cycle"], table["dissipated"] * scale.factor, "o-", color=ORANGE)
    axes.set_ylim(0, 1.1 * scale.factor * table["dissipated"].max() or 1)
    axes.set(ylabel=f"dissipated energy [{scale.label}]", title="friction in a cycle")


def _changes(axes, table: dict) -> None:
    later = select(table, slice(1, None))  # the first has nothing to be compared with
    if not np.any(later["change"] > 0):
        said = "no change" if len(later["cycle"]) else "one cycle alone"
        axes.text(0.5, 0.5, said, ha="center", transform=axes.transAxes, color="0.4")
    else:
        seen = np.where(later["change"] > 0, later["change"], np.nan)
        axes.semilogy(later["cycle"], seen, "o-", color=BLUE)
        _decades(axes, seen)
    axes.set(ylabel="relative change [–]", title="forces against the cycle before")


def _decades(axes, values) -> None:
    """Whole decades of a logarithmic axis that hold the values."""
    low, high = np.log10(np.nanmin(values)), np.log10(np.nanmax(values))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(10 ** np.floor(low), 10 ** np.ceil(high + 0.1))


def _ways(axes, run: Run, table: dict) -> None:
    curves = [(name, colour, marker, table[name]) for name, colour, marker in (
        ("slip", ORANGE, "o"), ("drift", RED, "s"), ("wear", GREEN, "^"))]
    largest = max(values.max() for *_, values in curves)
    curves = [curve for curve in curves if curve[3].max() > LEAST * largest]
    scale = length_scale(run, [largest])
    for name, colour, marker, values in curves:
        seen = np.where(values > LEAST * largest, values * scale.factor, np.nan)
        axes.semilogy(table["cycle"], seen, marker=marker, color=colour, label=name)
        _decades(axes, [*axes.get_ylim(), *seen])
    axes.set(ylabel=f"largest of a node [{scale.label}]", title="slip and growth in a cycle")
    if curves:
        axes.legend(frameon=False)
