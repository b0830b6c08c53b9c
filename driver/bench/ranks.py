"""Strong and weak scaling over MPI ranks, and the time of every stage by size.

A model fitted to these times, and its prediction for 100,000 subdomains, is
results/reference/scaling.md.
"""

import os
from statistics import median

import numpy as np
from scipy.optimize import nnls

from .workbench import REPEATS, Workbench, on_ranks, ratios

# subdomains, H/h, target: at 512 equal subdomains and where every rank has more to do, with more of
# them, larger ones or such that have a matrix each
STRONG = (("32x16", 10, ">= 1.7"), ("64x32", 10, ""), ("32x16", 20, ""), ("512", 10, ""))
# ranks: subdomains, about 64 a rank, squares as in the model example
WEAK = {1: "12x6", 2: "16x8", 4: "22x11", 8: "32x16", 16: "46x23", 32: "64x32"}
LOAD = {"work": "multiplications", "messages": "messages received", "kB": "kB received",
        "MiB": "MiB beside the program"}
MANY = "400x250", 2, (1, 2, 4, 8)  # subdomains, H/h, ranks: where ranks share the coarse problem
AIM, AIMS = 512, {"product": "<= 0.01", "set-up": "<= 2"}  # ranks, and their seconds
SIZES = (("4x2", 10, 1), ("8x4", 10, 1), ("16x8", 10, 1), ("32x16", 10, 1), ("64x32", 10, 1),
         ("16x8", 5, 1), ("16x8", 20, 1), ("32x16", 10, 2))  # subdomains, H/h, ranks
STAGES = ("export", "read", "skeleton", "reduction", "product")
VOLUME = {"rows": "gluing rows", "coarse": "coarse problem", "dot": "a scalar product"}


def run(bench: Workbench, subdomains: str, cells: int, ranks: int, repeats: int) -> list[dict]:
    """What rank.py measures on the model example, with the slides' stopping rules."""
    return on_ranks(bench, bench.export(subdomains, cells), ranks, repeats)


def measure(bench: Workbench, large: bool = False) -> dict:
    """Strong scaling in time; weak scaling in counts and volume; seconds of the stages by size.

    And, if `large`, what each of some ranks spends on 100,000 subdomains. Ranks beyond the cores of
    the machine say nothing about time.
    """
    _strong(bench)
    if large:
        _many(bench)
    return _weak(bench) | _stages(bench)


def _strong(bench: Workbench) -> None:
    """One against two ranks in turn: set-up and steps, without reading."""
    if (os.cpu_count() or 1) < 2:
        bench.skip("strong scaling needs two cores")
        return
    for subdomains, cells, target in STRONG:
        case, times = f"{subdomains}, H/h = {cells}", {1: [], 2: []}
        for _ in range(REPEATS):
            for ranks, values in times.items():
                spent = run(bench, subdomains, cells, ranks, 1)[0]["seconds"]
                values.append(spent["skeleton"] + spent["reduction"] + spent["steps"])
        for ranks, values in times.items():
            bench.add(f"set-up and 20 steps, {case}, {ranks} ranks", values, "s")
        bench.add(f"one rank over two, {case}", ratios(times[1], times[2]), "", target)


def _many(bench: Workbench) -> None:
    """Processor seconds of the busiest of some ranks, and what a/p + b says of AIM ranks."""
    subdomains, cells, numbers = MANY
    spent = {}
    for ranks in numbers:
        measured = on_ranks(bench, bench.export(subdomains, cells), ranks, 1, "null")[0]
        name = f"{subdomains}, H/h = {cells}, {ranks} ranks"
        for stage in ("skeleton", "reduction", "product"):
            spent.setdefault(stage, []).append(measured["processor"][stage])
            bench.add(f"{stage}, {name}: processor seconds", spent[stage][-1], "s")
        for key, text in LOAD.items():
            bench.add(f"{name}: {text}, largest of a rank", measured["load"][key][0])
    spent["set-up"] = np.add(spent["skeleton"], spent["reduction"])
    for stage, values in spent.items():
        terms = np.column_stack([1 / np.array(numbers), np.ones(len(numbers))])
        shared, repeated = nnls(terms / np.array(values)[:, None], np.ones(len(values)))[0]
        bench.add(f"{stage}, {subdomains}, {AIM} ranks by a/p + b", shared / AIM + repeated, "s",
                  AIMS.get(stage, ""))


def _weak(bench: Workbench) -> dict:
    """Ranks, and kB that a rank receives in a product by purpose.

    Work over that of the same problem on one rank, shared evenly, is an efficiency. The steps are
    made on one rank, as their counts are those of any number.
    """
    volume, first = {text: [] for text in VOLUME.values()}, None
    for ranks, subdomains in WEAK.items():
        alone = run(bench, subdomains, 10, 1, 1)[0]
        measured = on_ranks(bench, bench.export(subdomains, 10), ranks, 1, "null")[0]
        name, load = f"weak scaling, {ranks} ranks", measured["load"]
        products = alone["counts"]["dual_multiplications"]
        first = first or products
        bench.add(f"{name}: products", products)
        bench.add(f"{name}: products over those of one", products / first, "", "<= 1.2")
        for key, text in LOAD.items():
            bench.add(f"{name}: {text}, largest of a rank", load[key][0])
        even = alone["load"]["work"][0] / ranks
        bench.add(f"{name}: even work over the largest", even / load["work"][0], "", ">= 0.9")
        for key, text in VOLUME.items():
            volume[text].append(measured["bytes"][key] / ranks / 1e3)
            bench.add(f"{name}: {text}, received per rank and product", volume[text][-1], "kB")
    return {"ranks": list(WEAK), "volume": volume}


def _stages(bench: Workbench) -> dict:
    """Seconds of every stage at every size; those on one rank with H/h = 10 for the picture."""
    drawn = {"subdomains": [], "stages": {stage: [] for stage in STAGES}}
    for subdomains, cells, ranks in SIZES:
        runs = run(bench, subdomains, cells, ranks, 1 if subdomains == "64x32" else REPEATS)
        bench.export(subdomains, cells, ranks)
        values = {stage: [r["seconds"][stage] for r in runs] for stage in STAGES[1:]}
        values["export"] = [bench.export_seconds[subdomains, cells, ranks]]
        for stage in STAGES:
            bench.add(f"{stage}, {subdomains}, H/h = {cells}, {ranks} ranks", values[stage], "s")
            if (cells, ranks) == (10, 1):
                drawn["stages"][stage].append(median(values[stage]))
        if (cells, ranks) == (10, 1):
            drawn["subdomains"].append(runs[0]["subdomains"])
    return drawn
