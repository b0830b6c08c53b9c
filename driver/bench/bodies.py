"""Several bodies, most of them held by contact alone: products and times over sizes with H/h kept, and on two ranks."""

import shutil

from ..scene import freefem
from ..march.problem import assemble
from .workbench import Workbench, march, on_ranks, seconds

PART = "bodies"
CASES = {  # scene: parameters of every size, four times the subdomains and half the mesh size from one to the next
    "hertz-bodies": [{"subdomains": "12", "h": "0.001"}, {"subdomains": "48", "h": "0.0005"},
                     {"subdomains": "192", "h": "0.00025"}],
    "slope": [{"subdomains": cut} for cut in ("4x2", "8x4", "16x8", "32x16")],
    "stack": [{"subdomains": "9", "h": "0.1"}, {"subdomains": "36", "h": "0.05"}, {"subdomains": "144", "h": "0.025"}],
    "joint": [{"subdomains": "8", "h": "0.8"}, {"subdomains": "32", "h": "0.4"}, {"subdomains": "128", "h": "0.2"}]}
RANKS = (1, 2)


def measure(bench: Workbench) -> dict:
    """Products and seconds of the steps of every scene at every size; the second one on one and two ranks."""
    from mpi4py import MPI

    found = {}
    for scene, sizes in CASES.items():
        found[scene] = []
        for parameters in sizes:
            export = bench.exports / f"{scene}-{parameters['subdomains']}"
            freefem.export(freefem.find_scene(scene), export, parameters)
            problem, kept = assemble(export, MPI.COMM_SELF), []
            spent = seconds(lambda: kept.append(march(problem)))
            one = {"subdomains": problem.structure.total, "products": kept[0].counts["dual_multiplications"],
                   "iterations": kept[0].counts["fixed_point_iterations"], "steps": kept[0].steps, "seconds": spent}
            found[scene].append(one)
            name = f"{scene}, {one['subdomains']} subdomains"
            bench.report.add(PART, f"{name}: products", one["products"], "")
            bench.report.add(PART, f"{name}: fixed-point iterations a step", one["iterations"] / one["steps"], "")
            bench.report.add(PART, f"{name}: steps", spent, "s")
        products = [one["products"] for one in found[scene]]
        bench.report.add(PART, f"{scene}: growth of products to {found[scene][-1]['subdomains']} subdomains",
                         products[-1] / products[0], "", "<= 2")
        _ranks(bench, scene, bench.exports / f"{scene}-{sizes[1]['subdomains']}", products[1])
        shutil.rmtree(bench.exports)
    return found


def _ranks(bench: Workbench, scene: str, export, products: int) -> None:
    """Counts, which do not depend on ranks, and the time of the steps."""
    for ranks in RANKS:
        run = on_ranks(bench, export, ranks, 1, "{}")[0]
        bench.report.add(PART, f"{scene}, {ranks} ranks: steps", run["seconds"]["steps"], "s")
        bench.report.add(PART, f"{scene}, {ranks} ranks: products other than on one",
                         abs(run["counts"]["dual_multiplications"] - products), "", "<= 0")


def draw(figure, found: dict) -> None:
    """Products a step and seconds of the steps over the subdomains."""
    from ..figures import BLUE, GREEN, INK, ORANGE

    counts, times = figure.subplots(1, 2)
    for (scene, sizes), colour in zip(found.items(), (BLUE, GREEN, INK, ORANGE)):
        over = [one["subdomains"] for one in sizes]
        counts.semilogx(over, [one["products"] / one["steps"] for one in sizes], "o-", color=colour, label=scene)
        times.loglog(over, [one["seconds"] for one in sizes], "o-", color=colour, label=scene)
    counts.set(xlabel="subdomains, $H/h$ kept", ylabel="products with $F$ a step", ylim=(0, None))
    times.set(xlabel="subdomains, $H/h$ kept", ylabel="seconds of all steps")
    counts.legend(frameon=False, fontsize="small")
