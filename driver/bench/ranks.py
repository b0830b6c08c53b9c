"""Strong and weak scaling over MPI ranks, and a model of the time of every stage with what it predicts."""

import os

import numpy as np
from scipy.optimize import nnls

from .workbench import REPEATS, Workbench, median, on_ranks, ratios

PART = "ranks"
# subdomains, H/h, target: at 512 equal subdomains and where every rank has more to do, with more of them, larger ones or
# such that have a matrix each
STRONG = (("32x16", 10, ">= 1.7"), ("64x32", 10, ""), ("32x16", 20, ""), ("512", 10, ""))
WEAK = {1: "8x8", 2: "16x8", 4: "16x16", 8: "32x16"}  # ranks: subdomains, 64 a rank
MODELLED = [("4x2", 10, 1), ("8x4", 10, 1), ("16x8", 10, 1), ("16x8", 5, 1), ("16x8", 20, 1), ("32x16", 10, 1),
            ("32x16", 10, 2), ("64x32", 10, 1)]  # subdomains, H/h, ranks
PREDICTED = (100_000, 10, (1, 64, 512))
# time of a stage: sum of coefficients >= 0 times these functions of subdomains n, H/h = m and ranks p; what is not
# divided by p is done by every rank
TERMS = {
    "export": {"n m²/p": lambda n, m, p: n * m**2 / p, "n/p": lambda n, m, p: n / p, "1": lambda n, m, p: 1.0},
    "read": {"n m²/p": lambda n, m, p: n * m**2 / p, "n/p": lambda n, m, p: n / p, "1": lambda n, m, p: 1.0},
    "skeleton": {"n m": lambda n, m, p: n * m, "n m/p": lambda n, m, p: n * m / p, "n m²/p": lambda n, m, p: n * m**2 / p,
                 "n/p": lambda n, m, p: n / p, "1": lambda n, m, p: 1.0},
    "reduction": {"m³": lambda n, m, p: m**3, "n m²/p": lambda n, m, p: n * m**2 / p, "n": lambda n, m, p: n,
                  "n^1.5": lambda n, m, p: n**1.5,
                  "1": lambda n, m, p: 1.0},
    "product": {"n m²/p": lambda n, m, p: n * m**2 / p, "n log n": lambda n, m, p: n * np.log2(n),
                "1": lambda n, m, p: 1.0},
}


def run(bench: Workbench, subdomains: str, cells: int, ranks: int, repeats: int) -> list[dict]:
    """What rank.py measures on the model example, with the slides' stopping rules."""
    return on_ranks(bench, bench.export(subdomains, cells), ranks, repeats)


def measure(bench: Workbench) -> dict:
    """Strong scaling in time; weak scaling in counts and volume, as ranks beyond the cores tell nothing of time."""
    return {"strong": _strong(bench), "weak": _weak(bench), "model": _model(bench)}


def _strong(bench: Workbench) -> dict:
    """One against two ranks in turn: set-up and steps, without reading."""
    if (os.cpu_count() or 1) < 2:
        bench.report.skip(PART, "strong scaling needs two cores")
        return {}
    found = {}
    for subdomains, cells, target in STRONG:
        case, times = f"{subdomains}, H/h = {cells}", {1: [], 2: []}
        for _ in range(REPEATS):
            for ranks in times:
                spent = run(bench, subdomains, cells, ranks, 1)[0]["seconds"]
                times[ranks].append(spent["skeleton"] + spent["reduction"] + spent["steps"])
        for ranks, values in times.items():
            bench.report.add(PART, f"set-up and 20 steps, {case}, {ranks} ranks", values, "s")
        bench.report.add(PART, f"one rank over two, {case}", ratios(times[1], times[2]), "", target)
        found[case] = times
    return found


def _weak(bench: Workbench) -> dict:
    found = {}
    for ranks, subdomains in WEAK.items():
        one = run(bench, subdomains, 10, ranks, 1)[0]
        per_rank = {name: size / ranks / 1e3 for name, size in one["bytes"].items()}
        products = one["counts"]["dual_multiplications"]
        bench.report.add(PART, f"weak scaling, {ranks} ranks: products", products, "")
        for name, text in (("rows", "gluing rows"), ("coarse", "coarse problem"), ("dot", "a scalar product")):
            bench.report.add(PART, f"weak scaling, {ranks} ranks: {text}, received per rank and product",
                             per_rank[name], "kB")
        found[ranks] = {"products": products, **per_rank}
    return found


def _model(bench: Workbench) -> dict:
    """Fit every stage to measured times, relative errors weighing alike; predict a size out of reach."""
    measured = {stage: [] for stage in TERMS}
    for subdomains, cells, ranks in MODELLED:
        runs = run(bench, subdomains, cells, ranks, 1 if subdomains == "64x32" else REPEATS)
        bench.export(subdomains, cells, ranks)
        point = (runs[0]["subdomains"], cells, ranks)
        for stage in TERMS:
            values = ([bench.export_seconds[subdomains, cells, ranks]] if stage == "export"
                      else [r["seconds"][stage] for r in runs])
            measured[stage].append((point, median(values)))
    fits = {}
    n, m, many = PREDICTED
    for stage, terms in TERMS.items():
        matrix = np.array([[term(*point) for term in terms.values()] for point, _ in measured[stage]])
        times = np.array([t for _, t in measured[stage]])
        scaled = matrix / times[:, None]
        size = np.linalg.norm(scaled, axis=0)
        coefficients = nnls(scaled / size, np.ones(len(times)))[0] / size
        fitted = matrix @ coefficients
        error = float(np.abs(fitted / times - 1).max())
        law = " + ".join(f"{c:.2e} {name}" for c, name in zip(coefficients, terms) if c > 0)
        bench.report.add(PART, f"model of {stage}: {law} s; largest relative error", error, "")
        for p in many:
            predicted = float(sum(c * term(n, m, p) for c, term in zip(coefficients, terms.values())))
            bench.report.add(PART, f"predicted {stage}, {n} subdomains, H/h = {m}, {p} ranks", predicted, "s")
        fits[stage] = {"points": [point for point, _ in measured[stage]], "times": times.tolist(),
                       "coefficients": coefficients.tolist()}
    return fits


def draw(figure, found: dict) -> None:
    """Message volume by ranks; measured stages and their model by subdomains."""
    from ..figures import BLUE, GREEN, INK, ORANGE, RED

    volume, model = figure.subplots(1, 2)
    for (name, text), colour in zip((("rows", "gluing rows"), ("coarse", "coarse problem"), ("dot", "scalar product")),
                                    (BLUE, ORANGE, GREEN)):
        volume.plot(list(found["weak"]), [one[name] for one in found["weak"].values()], "o-", color=colour, label=text)
    volume.set(xlabel="ranks, 64 subdomains each", ylabel="kB received per rank and product")
    volume.set_xticks(list(found["weak"]))
    volume.legend(frameon=False, fontsize="small")
    sizes = np.logspace(np.log10(8), 5, 60)
    for (stage, fit), colour in zip(found["model"].items(), (BLUE, ORANGE, GREEN, INK, RED)):
        terms = TERMS[stage].values()
        model.loglog(sizes, [sum(c * term(n, 10, 1) for c, term in zip(fit["coefficients"], terms)) for n in sizes],
                     color=colour, lw=1, label=stage)
        shown = [(point[0], t) for point, t in zip(fit["points"], fit["times"]) if point[1:] == (10, 1)]
        model.loglog(*zip(*shown), "o", color=colour)
    model.set(xlabel="subdomains, $H/h = 10$", ylabel="seconds on one rank")
    model.legend(frameon=False, fontsize="small")
