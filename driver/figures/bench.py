"""Pictures of the benchmark: one a part that left ``<part>.json`` beside report.csv."""

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from .style import BLUE, GREEN, INK, ORANGE, WIDTH, canvas, write

SMALL = {"frameon": False, "fontsize": "small"}


def draw(report: Path) -> list[Path]:
    """Draw the parts that have data beside report.csv; returns the files written."""
    return [path for part in PARTS for path in draw_part(report.parent, part)]


def draw_part(folder: Path, part: str) -> list[Path]:
    """Draw one part from ``<folder>/<part>.json``, if there is one; returns the files written."""
    data = folder / f"{part}.json"
    if not data.exists():
        return []
    measured = json.loads(data.read_text())
    figure = canvas(lambda figure: PARTS[part](figure, measured), 9, 1.4 * WIDTH)
    return write(figure, folder, part)


def products(figure: Figure, measured: dict) -> None:
    """Products over the size, and by how much they grow where an ingredient is left out."""
    over, bars = figure.subplots(1, 2)
    for (loading, counts), colour in zip(measured["counts"].items(), (BLUE, ORANGE)):
        over.loglog(measured["subdomains"], counts, "o-", color=colour, label=f"ours, {loading}")
        over.loglog(measured["subdomains"], np.divide(measured["slides"][loading], 10), "--",
                    color=colour, label="a tenth of the slides'")
    over.set(xlabel="subdomains", ylabel="products with $F$ in 20 steps")
    over.legend(**SMALL)
    ingredients = measured["left_out"]
    for k, (label, values) in enumerate(measured["shares"].items()):
        places = np.arange(len(ingredients)) + 0.2 * (k - 1.5)
        bars.bar(places, values, 0.18, color=(BLUE, ORANGE, GREEN, INK)[k], label=label)
    bars.axhline(1, color="0.5", lw=0.7)
    bars.set(yscale="log", ylabel="products, without over with")
    bars.set_xticks(range(len(ingredients)), [text.replace("=", "=\n") for text in ingredients],
                    fontsize="x-small")
    bars.legend(**SMALL)


def factorization(figure: Figure, measured: dict) -> None:
    """Stacked times of the solver beside MUMPS under every ordering."""
    axes, times, trials = figure.subplots(), measured["seconds"], measured["orderings"]
    start = 0.0
    for name, colour in zip(times, (BLUE, GREEN, ORANGE)):
        axes.barh(0, times[name], left=start, color=colour, label=name)
        start += times[name]
    axes.barh(range(1, 1 + len(trials)), list(trials.values()), color=INK, label="MUMPS")
    axes.set_yticks(range(1 + len(trials)),
                    ["FETI-DP,\nboth loadings", *(f"MUMPS, {name}" for name in trials)])
    axes.set_xlabel(f"seconds on one core, {measured['subdomains']} subdomains")
    axes.legend(**SMALL)


def geometry(figure: Figure, measured: dict) -> None:
    """Time and memory of whole processes over those of the direct ones."""
    axes = figure.subplots(1, 2)
    for k, (case, curve) in enumerate(measured.items()):
        look = {"color": (BLUE, GREEN, ORANGE, INK)[k // 2 % 4], "label": case,
                "linestyle": "--" if case.endswith("P2") else "-", "marker": "o"}
        for panel, unit in zip(axes, ("", "_mib")):
            over = np.divide(curve[f"driver{unit}"], curve[f"direct{unit}"])
            panel.semilogx(curve["dofs"], over, **look)
    for panel, what in zip(axes, ("time", "memory")):
        panel.axhline(1, color="0.5", lw=0.7)
        panel.set(xlabel="dofs", ylabel=f"{what} over one direct solution", ylim=(0, None))
    axes[0].legend(**SMALL)


def getfem(figure: Figure, measured: dict) -> None:
    """Whole processes over the mesh size."""
    axes, cells = figure.subplots(), measured["cells"]
    for name, colour in (("driver", BLUE), ("GetFEM", ORANGE)):
        axes.loglog(cells, measured[name], "o-", color=colour, label=name)
    for n, ours, theirs in zip(cells, measured["driver"], measured["GetFEM"]):
        axes.annotate(f"{theirs / ours:.1f}×", (n, ours), (0, -14),
                      textcoords="offset points", ha="center")
    axes.set_xticks(cells, [f"1/{n}" for n in cells])
    axes.minorticks_off()
    axes.margins(y=0.2)
    axes.set(xlabel="mesh size $h$ [m]",
             ylabel=f"seconds of the whole process, {measured['steps']} steps")
    axes.legend(frameon=False)


def tao(figure: Figure, measured: dict) -> None:
    """Products of every solver, a group of bars a size."""
    axes, solvers = figure.subplots(), measured["solvers"]
    for k, (colour, (subdomains, counts)) in enumerate(zip((BLUE, ORANGE, GREEN),
                                                           measured["products"].items())):
        axes.bar(np.arange(len(solvers)) + 0.27 * (k - 1), counts, 0.25, color=colour,
                 label=f"{subdomains} subdomains")
    axes.set_xticks(range(len(solvers)), [name.upper() for name in solvers])
    axes.set(yscale="log", ylabel=f"products with $F$ until {measured['rtol']:.0e}")
    axes.legend(frameon=False)


def roofline(figure: Figure, measured: dict) -> None:
    """Attainable and reached flop rates over flops per byte."""
    axes, machine = figure.subplots(), next(iter(measured.values()))
    intensity = np.logspace(-1.5, 2, 200)
    # both follow one another, so the line is the harmonic sum of the two limits
    rate = 1 / (machine["flop"] + machine["byte"] / intensity)
    axes.loglog(intensity, rate / 1e9, color=INK,
                label="dense products and memory, one after the other")
    axes.loglog(intensity, rate / 2e9, "--", color="0.6", label="half of it")
    for (subdomains, case), colour in zip(measured.items(), (BLUE, ORANGE)):
        axes.loglog(case["flops"] / case["bytes"], case["flops"] / case["product"] / 1e9, "o",
                    color=colour, label=f"product with $F$, {subdomains} subdomains")
    axes.set(xlabel="flops per byte", ylabel="Gflop/s on one core")
    axes.legend(**SMALL)


def ranks(figure: Figure, measured: dict) -> None:
    """Message volume by ranks, and seconds of the stages by subdomains."""
    volume, stages = figure.subplots(1, 2)
    for (text, sizes), colour in zip(measured["volume"].items(), (BLUE, ORANGE, GREEN)):
        volume.plot(measured["ranks"], sizes, "o-", color=colour, label=text)
    volume.set(xlabel="ranks, about 64 subdomains each", xscale="log",
               ylabel="kB received per rank and product")
    volume.set_xticks(measured["ranks"], [str(ranks) for ranks in measured["ranks"]])
    volume.minorticks_off()
    volume.legend(**SMALL)
    for (stage, seconds), colour in zip(measured["stages"].items(),
                                        (BLUE, ORANGE, GREEN, INK, "#D55E00")):
        stages.loglog(measured["subdomains"], seconds, "o-", color=colour, lw=1, label=stage)
    stages.set(xlabel="subdomains, $H/h = 10$", ylabel="seconds on one rank")
    stages.legend(**SMALL)


def bodies(figure: Figure, measured: dict) -> None:
    """Products a step and seconds of the steps over the subdomains."""
    counts, times = figure.subplots(1, 2)
    for (scene, sizes), colour in zip(measured.items(), (BLUE, GREEN, INK, ORANGE)):
        over = [size["subdomains"] for size in sizes]
        counts.semilogx(over, [size["products"] / size["steps"]
                        for size in sizes], "o-", color=colour, label=scene)
        times.loglog(over, [size["seconds"] for size in sizes], "o-", color=colour, label=scene)
    counts.set(xlabel="subdomains, $H/h$ kept", ylabel="products with $F$ a step", ylim=(0, None))
    times.set(xlabel="subdomains, $H/h$ kept", ylabel="seconds of all steps")
    counts.legend(**SMALL)


PARTS = {function.__name__: function for function in
         (products, factorization, geometry, getfem, tao, roofline, ranks, bodies)}
