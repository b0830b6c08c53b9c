"""Convergence of the QP solver over its products, and of the mesh over the cycles of refinement."""

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from ..text import counted
from .layout import as_map, run_header
from .reading import Run, select
from .style import BLUE, GREEN, INCH, INK, ORANGE

POINTS = 4000  # markers a convergence plot can carry before it turns into a smear
KINDS = {"start": (INK, "D", 3.2), "cg": (BLUE, "o", 1.7), "expansion": (ORANGE, "^", 2.4),
         "proportioning": (GREEN, "s", 2.4)}


def iterated(table: dict) -> bool:
    """Whether the QP solver had iterations: starts at the solution, Newton's, say nothing of it."""
    return bool(((table["kind"] != "start") & (table["residual"] > 0)).any())


def thin_out(table: dict) -> tuple[dict, int]:
    """All start rows and every k-th of the others, about POINTS of them; and k."""
    every = max(1, math.ceil(len(table["product"]) / POINTS))
    keep = (np.arange(len(table["product"])) % every == 0) | (table["kind"] == "start")
    return select(table, keep), every


def mark_steps(axes, table: dict) -> None:
    """Faint lines where time steps begin, with as many step numbers above as have room.

    Of steps that begin near one another that of the most products.
    """
    steps, first = np.unique(table["step"], return_index=True)
    begin = table["product"][first]
    for x in begin[1:]:
        axes.axvline(x, color="0.85", lw=0.5, zorder=0)
    room = (0.012 + 0.01 * len(f"{steps.max():.0f}")) * np.ptp(table["product"])
    ticks, products = [], np.diff(begin, append=table["product"].max())
    for k, x in enumerate(begin):
        if ticks and x - begin[ticks[-1]] < room:
            if products[k] <= room or products[k] <= products[ticks[-1]]:
                continue
            ticks.pop()
        ticks.append(k)
    top = axes.secondary_xaxis("top")
    top.set_xticks(begin[ticks], [f"{steps[k]:.0f}" for k in ticks])
    top.tick_params(labelsize=7, length=2)
    top.set_xlabel("time step (at its first product)", fontsize=8)


def convergence(figure: Figure, run: Run) -> None:
    """Relative projected gradient of the QP solver over the products with the dual operator."""
    table = run.convergence
    figure.set_figheight(9 * INCH)
    axes = figure.add_subplot()
    thin, every = thin_out(select(table, table["residual"] > 0))
    grown = 2 if len(thin["product"]) < 150 else 1.4 if len(thin["product"]) < 600 else 1
    axes.semilogy(thin["product"], thin["residual"], color="0.75", lw=0.3, zorder=1)
    if len(thin["residual"]) and np.ptp(np.log10(thin["residual"])) < 1:  # or none at all
        axes.set_ylim(0.1 * thin["residual"].min(), 10 * thin["residual"].max())
    handles = []
    for kind, (colour, marker, size) in KINDS.items():
        own, total = thin["kind"] == kind, np.count_nonzero(table["kind"] == kind)
        if total:
            axes.plot(thin["product"][own], thin["residual"][own], ls="none", marker=marker,
                      ms=grown * size, mew=0, color=colour, zorder=3 if kind == "start" else 2)
            handles.append(Line2D([], [], ls="none", marker=marker, ms=4, mew=0, color=colour,
                                  label=f"{kind} ({total:,})".replace(",", "\u2009")))
    axes.set(xlabel="dual multiplications, cumulative", ylabel="relative projected gradient [–]")
    axes.margins(x=0.01)
    mark_steps(axes, table)
    note = f"one iteration in {every} and all starts drawn" if every > 1 else ""
    run_header(figure, run, "Convergence of MPRGP", handles, note)


def adaptivity(figure: Figure, run: Run) -> None:
    """The adapted mesh, and the error in the energy norm over the unknowns of all cycles."""
    figure.set_figheight(8.5 * INCH)
    body, error = figure.subplots(1, 2, width_ratios=[1.7, 1])
    scale = as_map(body, run, run.first.xy)
    body.triplot(*(run.first.xy * scale.factor).T, run.first.corners,
                 lw=0.25, color=INK, rasterized=True)
    size, relative = run.adaptivity["primal_dofs"], 100 * run.adaptivity["relative"]
    error.loglog(size, relative, "o-", color=BLUE, label="cycles")
    degree = run.first.degree
    error.loglog(size, relative[0] * (size / size[0]) ** (-degree / 2), "--", color="0.6", lw=0.8,
                 label=r"$N^{-1/2}$" if degree == 1 else "$N^{-1}$")
    error.set(xlabel="primal unknowns $N$", ylabel="error in the energy norm [%]")
    error.grid(color="0.9", lw=0.5, which="both")
    for axis in (error.xaxis, error.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(FuncFormatter(
            lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else ""))
    error.tick_params(which="both", labelsize=7, length=3)
    run_header(figure, run, "Adaptive refinement", error.get_legend_handles_labels()[0],
               f"{len(run.first.corners)} triangles after {counted(len(size) - 1, 'cycle')}")
