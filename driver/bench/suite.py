"""All parts of the benchmark, or those asked for: report.csv and a picture for parts that have one."""

import time
from pathlib import Path

from .. import environment, options

PARTS = options.find("bench", "parts").kind.choices


def run_bench(pairs: dict[str, str]) -> list[Path]:
    """Measure and write; the paths of report and pictures.

    Raises InputError for options that `make bench` does not have.
    """
    given = options.read("bench", pairs)
    folder = given["out"].absolute()
    folder.mkdir(parents=True, exist_ok=True)
    environment.start_petsc()
    chosen = given["parts"] or PARTS
    return _measure([name for name in PARTS if name in chosen], given["large"], folder)


def _measure(chosen: list[str], large: bool, folder: Path) -> list[Path]:
    from . import bodies, factorization, peers, products, ranks, roofline, stages, studies, tao
    from .workbench import Workbench

    parts = {module.PART: module for module in (products, factorization, peers, tao, roofline, stages, ranks, studies,
                                                bodies)}
    bench, paths, start = Workbench(folder), [folder / "report.csv"], time.perf_counter()
    try:
        for k, name in enumerate(chosen, 1):
            print(f"[{k}/{len(chosen)}] {name}, {time.perf_counter() - start:.0f} s so far", flush=True)
            module = parts[name]
            found = module.measure(bench, large) if name == "getfem" else module.measure(bench)
            if found and hasattr(module, "draw"):
                paths += _picture(module, found, folder)
            bench.report.write(folder / "report.csv")
    finally:
        bench.close()
    missed = [row for row in bench.report.rows if row.met == "no"]
    targets = [row for row in bench.report.rows if row.target]
    print(f"{time.perf_counter() - start:.0f} s; {len(targets) - len(missed)} of {len(targets)} targets met"
          + "".join(f"\n  missed: {row.name}: {row.value:.4g} {row.unit} ({row.target})" for row in missed))
    return paths


def _picture(module, found, folder: Path) -> list[Path]:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ..figures import INCH, STYLE, WIDTH, write

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(1.4 * WIDTH, 9 * INCH), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        module.draw(figure, found)
        return write(figure, folder, module.PART)

