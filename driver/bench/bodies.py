"""Several bodies, mostly held by contact alone: products and times over sizes with equal H/h."""

import shutil
from pathlib import Path

from mpi4py import MPI

from ..march.problem import assemble
from ..scene import freefem
from .workbench import Workbench, march, on_ranks, timed

# scene: parameters of every size, four times the subdomains and half the mesh size from one to the
# next
CASES = {"hertz-bodies": [{"subdomains": "12", "h": "0.001"}, {"subdomains": "48", "h": "0.0005"},
                          {"subdomains": "192", "h": "0.00025"}],
         "slope": [{"subdomains": cut} for cut in ("4x2", "8x4", "16x8", "32x16")],
         "stack": [{"subdomains": "9", "h": "0.1"}, {"subdomains": "36", "h": "0.05"},
                   {"subdomains": "144", "h": "0.025"}],
         "joint": [{"subdomains": "8", "h": "0.8"}, {"subdomains": "32", "h": "0.4"},
                   {"subdomains": "128", "h": "0.2"}]}


def measure(bench: Workbench) -> dict:
    """Products and seconds of the steps at every size; the second size on one and two ranks.

    Returns lists of dicts by scene: subdomains, products, iterations, steps, seconds.
    """
    measured = {}
    for scene, sizes in CASES.items():
        runs = [_run(bench, scene, parameters) for parameters in sizes]
        growth = runs[-1]["products"] / runs[0]["products"]
        text = f"{scene}: growth of products to {runs[-1]['subdomains']} subdomains"
        bench.add(text, growth, "", "<= 2")
        export = bench.exports / f"{scene}-{sizes[1]['subdomains']}"
        _ranks(bench, scene, export, runs[1]["products"])
        shutil.rmtree(bench.exports)
        measured[scene] = runs
    return measured


def _run(bench: Workbench, scene: str, parameters: dict) -> dict:
    """One scene at one size on this process."""
    export = bench.exports / f"{scene}-{parameters['subdomains']}"
    freefem.export(freefem.find_scene(scene), export, parameters)
    problem = assemble(export, MPI.COMM_SELF)
    history, spent = timed(lambda: march(problem))
    run = {"subdomains": problem.structure.total,
           "products": history.counts["dual_multiplications"],
           "iterations": history.counts["fixed_point_iterations"], "steps": history.steps,
           "seconds": spent}
    name = f"{scene}, {run['subdomains']} subdomains"
    bench.add(f"{name}: products", run["products"])
    bench.add(f"{name}: fixed-point iterations a step", run["iterations"] / run["steps"])
    bench.add(f"{name}: steps", spent, "s")
    return run


def _ranks(bench: Workbench, scene: str, export: Path, products: int) -> None:
    """Counts, which do not depend on ranks, and the time of the steps."""
    for ranks in (1, 2):
        run = on_ranks(bench, export, ranks, 1, "{}")[0]
        bench.add(f"{scene}, {ranks} ranks: steps", run["seconds"]["steps"], "s")
        others = abs(run["counts"]["dual_multiplications"] - products)
        bench.add(f"{scene}, {ranks} ranks: products other than on one", others, "", "<= 0")
