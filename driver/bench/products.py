"""Products with F in 20 steps beside the slides' table, and the share of every ingredient by leaving it out."""

from ..studies.table import LOADINGS, ROWS, SLIDES, method_settings
from .workbench import Workbench, march

PART = "products"
LEFT_OUT = {"predictor": "previous", "inner_rtol": 1e-9, "preconditioner": "dirichlet", "expansion": "cg",
            "corrector": "none"}
ABLATED = (1, 3)  # rows of the table


def measure(bench: Workbench) -> dict:
    """Counts of every row and loading; of the default and without each ingredient for some rows."""
    report, counts, shares = bench.report, {}, {}
    for row, subdomains in ROWS.items():
        for loading in LOADINGS:
            history = march(bench.problem(subdomains, loading), **method_settings("default"))
            counts[row, loading] = history.counts["dual_multiplications"]
            slides = SLIDES[row][5 + LOADINGS.index(loading)]
            report.add(PART, f"products, {subdomains}, {loading}", counts[row, loading], "", f"<= {slides / 10}")
            setup = history.counts["dual_multiplications_setup"]
        report.add(PART, f"products of the set-up, {subdomains}", setup, "", "<= 200")
        if row in ABLATED:
            for loading in LOADINGS:
                for name, value in LEFT_OUT.items():
                    history = march(bench.problem(subdomains, loading), **{**method_settings("default"), name: value})
                    shares[row, loading, name] = history.counts["dual_multiplications"] / counts[row, loading]
                    report.add(PART, f"{name}={value}, {subdomains}, {loading}: products over the default's",
                               shares[row, loading, name], "")
        if row != max(ROWS):
            bench.forget(subdomains)
    for loading in LOADINGS:
        growth = counts[max(ROWS), loading] / counts[min(ROWS), loading]
        report.add(PART, f"growth of products from 8 to 2048 subdomains, {loading}", growth, "", "<= 1.5")
    return {"counts": counts, "shares": shares}


def draw(figure, found: dict) -> None:
    """Products over the size, and what leaving an ingredient out multiplies them by."""
    from ..figures import BLUE, GREEN, INK, ORANGE

    over, bars = figure.subplots(1, 2)
    sizes = [SLIDES[1][0] * 4 ** (row - 1) for row in ROWS]
    for loading, colour in zip(LOADINGS, (BLUE, ORANGE)):
        over.loglog(sizes, [found["counts"][row, loading] for row in ROWS], "o-", color=colour, label=f"ours, {loading}")
        tenth = [SLIDES[row][5 + LOADINGS.index(loading)] / 10 for row in ROWS]
        over.loglog(sizes, tenth, "--", color=colour, label="a tenth of the slides'")
    over.set(xlabel="subdomains", ylabel="products with $F$ in 20 steps")
    over.legend(frameon=False, fontsize="small")
    styles = [(row, loading) for row in ABLATED for loading in LOADINGS]
    for k, (row, loading) in enumerate(styles):
        values = [found["shares"][row, loading, name] for name in LEFT_OUT]
        at = [i + 0.2 * (k - 1.5) for i in range(len(LEFT_OUT))]
        bars.bar(at, values, 0.18, color=(BLUE, ORANGE, GREEN, INK)[k], label=f"{ROWS[row]}, {loading}")
    bars.axhline(1, color="0.5", lw=0.7)
    bars.set(yscale="log", ylabel="products, without over with")
    bars.set_xticks(range(len(LEFT_OUT)), [f"{n}=\n{v}" for n, v in LEFT_OUT.items()], fontsize="x-small")
    bars.legend(frameon=False, fontsize="small")
