"""Products with F in 20 steps beside the slides' table, also without each ingredient."""

from ..studies.table import LOADINGS, ROWS, SLIDES, method_settings
from .workbench import Workbench, march

LEFT_OUT = {"predictor": "previous", "inner_rtol": 1e-9, "preconditioner": "dirichlet",
            "expansion": "cg", "corrector": "none"}
ABLATED = (1, 3)  # rows of the table


def measure(bench: Workbench) -> dict:
    """Counts of every row and loading; of the default and without each ingredient for some rows."""
    default = method_settings("default")
    counts, shares = {loading: [] for loading in LOADINGS}, {}
    for row, subdomains in ROWS.items():
        for loading in LOADINGS:
            history = march(bench.problem(subdomains, loading), **default)
            count = history.counts["dual_multiplications"]
            slides = SLIDES[row][5 + LOADINGS.index(loading)]
            bench.add(f"products, {subdomains}, {loading}", count, "", f"<= {slides / 10}")
            counts[loading].append(count)
        setup = history.counts["dual_multiplications_setup"]
        bench.add(f"products of the set-up, {subdomains}", setup, "", "<= 200")
        for loading in LOADINGS if row in ABLATED else ():
            shares[f"{subdomains}, {loading}"] = values = []
            for name, value in LEFT_OUT.items():
                history = march(bench.problem(subdomains, loading), **{**default, name: value})
                values.append(history.counts["dual_multiplications"] / counts[loading][-1])
                text = f"{name}={value}, {subdomains}, {loading}: products over the default's"
                bench.add(text, values[-1])
        if row != max(ROWS):
            bench.forget(subdomains)
    for loading in LOADINGS:
        growth = counts[loading][-1] / counts[loading][0]
        bench.add(f"growth of products from 8 to 2048 subdomains, {loading}", growth, "", "<= 1.5")
    slides = {loading: [SLIDES[row][k] for row in ROWS] for k, loading in enumerate(LOADINGS, 5)}
    return {"subdomains": [SLIDES[1][0] * 4 ** (row - 1) for row in ROWS], "counts": counts,
            "shares": shares, "slides": slides,
            "left_out": [f"{name}={value}" for name, value in LEFT_OUT.items()]}
