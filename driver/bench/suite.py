"""All parts of the benchmark, or those asked for: report.csv and pictures."""

import time
from pathlib import Path

from .. import environment, options
from ..files import write_json
from ..runs.guard import study_folder

PARTS = options.find("bench", "parts").kind.choices
GROWING = ("getfem", "geometry", "ranks")  # parts that LARGE=yes adds sizes to


def run_bench(pairs: dict[str, str]) -> list[Path]:
    """Measure and write; the paths of report and pictures.

    Raises InputError for options that `make bench` does not have.
    """
    given = options.read("bench", pairs)
    folder = study_folder(given["out"], "bench")
    environment.start_petsc()
    chosen = given["parts"] or PARTS
    return _measure([name for name in PARTS if name in chosen], given["large"], folder)


def _measure(chosen: list[str], large: bool, folder: Path) -> list[Path]:
    """Measure the parts `chosen`; report.csv, <part>.json and a picture after each."""
    from ..figures.bench import draw_part
    from . import (bodies, factorization, geometry, peers, products, ranks, roofline, stages,
                   studies, tao)
    from .workbench import Workbench

    modules = (products, factorization, geometry, peers, tao, roofline, stages, ranks, studies,
               bodies)
    parts = {module.__name__.rpartition(".")[2]: module for module in modules}
    parts["getfem"] = parts.pop("peers")
    bench, paths, start = Workbench(folder), [folder / "report.csv"], time.perf_counter()
    try:
        for k, name in enumerate(chosen, 1):
            print(f"[{k}/{len(chosen)}] {name}, {time.perf_counter() - start:.0f} s so far",
                  flush=True)
            bench.report.part = name
            measured = parts[name].measure(bench, *[large] if name in GROWING else [])
            bench.report.write(folder / "report.csv")
            if measured:
                write_json(folder / f"{name}.json", measured)
                paths += draw_part(folder, name)
    finally:
        bench.close()
    missed = [row for row in bench.report.rows if row.met == "no"]
    targets = [row for row in bench.report.rows if row.target]
    met = f"{len(targets) - len(missed)} of {len(targets)} targets met"
    print(f"{time.perf_counter() - start:.0f} s; {met}")
    for row in missed:
        print(f"  missed: {row.name}: {row.value:.4g} {row.unit} ({row.target})")
    return paths
