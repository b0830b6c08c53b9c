"""The product with F against the machine's dense products and memory, measured beside it."""

from statistics import median

import numpy as np

from .workbench import REPEATS, Workbench, in_turn, ratios, seconds

CASES = {"64x32": {}, "512": {}}  # equal squares; a graph partition, whose matrices all differ
WORDS = 6_000_000  # of each array of the triad: beyond the caches
CALLS = 20  # products timed at a time


def triad() -> float:
    """Seconds per byte of a = b + s c, four passes as numpy does it."""
    a, b, c = (np.ones(WORDS) for _ in range(3))
    np.multiply(c, 3.0, out=a)
    return seconds(lambda: (np.multiply(c, 3.0, out=a), np.add(a, b, out=a))) / (5 * 8 * WORDS)


def gemm() -> float:
    """Seconds per flop of a dense product of 512 by 512 matrices."""
    a, b = (np.random.default_rng(0).standard_normal((512, 512)) for _ in range(2))
    out = a @ b
    return seconds(lambda: [np.matmul(a, b, out=out) for _ in range(4)]) / (4 * 2 * 512**3)


def work(operator) -> dict[str, float]:
    """Flops and bytes that a product with F cannot do without.

    Flops: two a matrix entry and member of F, A and A'. Bytes: a local row is gathered (read,
    index, write), goes through its dense product (read, write) and is added up (read, index,
    write); matrices and the coarse factor (entry and index, forward and backward) are read once.
    """
    flops = sum(len(c.members) * 2 * (c.F.size + 2 * c.A.size) for c in operator.classes)
    rows = sum(len(c.members) * len(c.F) for c in operator.classes)
    corners = sum(len(c.members) * c.A.shape[1] for c in operator.classes)
    matrices = sum(8 * (c.F.size + 2 * c.A.size) for c in operator.classes)
    coarse = operator.coarse.work * (8 + 4)
    return {"flops": float(flops),
            "bytes": float((rows + corners) * (6 * 8 + 2 * 4) + matrices + coarse)}


def measure(bench: Workbench) -> dict:
    """Product, triad and dense product in turn, for equal and for distinct local matrices."""
    measured = {}
    for subdomains in CASES:
        operator = bench.problem(subdomains).operator
        x = np.random.default_rng(1).standard_normal(operator.owned)
        operator.apply(x)

        def product() -> float:
            return seconds(lambda: [operator.apply(x) for _ in range(CALLS)]) / CALLS

        times = in_turn({"product": product, "byte": triad, "flop": gemm}, 2 * REPEATS)
        needed = work(operator)
        # dense products and the passes over memory follow one another
        bound = [flop * needed["flops"] + byte * needed["bytes"]
                 for flop, byte in zip(times["flop"], times["byte"])]
        label = f"{subdomains}, {len(operator.classes)} distinct matrices"
        bench.add(f"product with F, {label}", np.multiply(times["product"], 1e3), "ms")
        bench.add(f"flops of a product, {subdomains}", needed["flops"] / 1e6, "Mflop")
        bench.add(f"bytes of a product, {subdomains}", needed["bytes"] / 1e6, "MB")
        bench.add(f"share of the roofline reached, {label}", ratios(bound, times["product"]),
                   "", ">= 0.5")
        medians = {name: median(values) for name, values in times.items()}
        measured[subdomains] = {**needed, **medians}
    for key, name, unit in (("flop", "dense product rate", "Gflop/s"),
                            ("byte", "memory bandwidth (triad)", "GB/s")):
        bench.add(name, 1e-9 / measured["64x32"][key], unit)
    return measured
