"""make locking: how elements converge in a material that hardly changes its volume.

Scene incompressible with Poisson's ratios near 1/2, each element on meshes halved in size; errors against the exact
solution, relative to it, in L2: of the displacement, of the strain and of the pressure lambda div u. Linear elements lock:
they have more volumes to keep than displacements to keep them with. Quadratic ones lose one order of the strain (Babuska,
Suri, Numer. Math. 62 (1992) 439-463), P2-mixed nothing.
"""

import tempfile
from pathlib import Path

import numpy as np

from ..scene import elements, freefem
from .. import options
from ..files import write_rows

POISSON = (0.3, 0.49, 0.4999, 0.499999)
CELLS = (2, 4, 8, 16)
COLUMNS = ("element", "poisson", "h", "unknowns", "displacement", "strain", "pressure")
W, K = 0.01, 2.0  # of the scene
TIGHT = {"rtol": 1e-12, "primal_rtol": 1e-4, "estimator": "none"}


def run_locking(pairs: dict[str, str]) -> list[Path]:
    """Make and draw the table; returns the files. Raises InputError for unknown options."""
    out = options.read("locking", pairs)["out"]
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    for poisson in POISSON:
        for element in elements.NODES:
            rows += [row(element, poisson, cells) for cells in CELLS]
            orders = np.log2(np.divide(rows[-2][4:], rows[-1][4:]))
            print(f"{element}, Poisson's ratio {poisson:g}: orders " +
                  ", ".join(f"{name} {order:.2f}" for name, order in zip(COLUMNS[4:], orders)), flush=True)
    return [write_rows(out / "locking.csv", COLUMNS, rows), *draw(out, rows)]


def exact(x: np.ndarray, y: np.ndarray, lam: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement (..., 2), strain e11, e22, 2 e12 (..., 3) and pressure (..., 1) of the scene at Lame's lambda."""
    s, c, sy, cy = np.sin(K * x), np.cos(K * x), np.sin(K * y), np.cos(K * y)
    u = W * np.stack([s * (cy + sy / lam), -c * sy], axis=-1)
    strain = W * K * np.stack([c * (cy + sy / lam), -c * cy, s * cy / lam], axis=-1)
    return u, strain, (W * K * c * sy)[..., None]


def errors(subdomains: list, fields: list) -> np.ndarray:
    """(3,) relative errors of displacement, strain and pressure in L2, of fields on `subdomains`."""
    total = np.zeros(6)
    for sub, u in zip(subdomains, fields):
        corner, value = sub.xy[sub.triangles], u.reshape(-1, 2)[sub.elements]
        lam = sub.elasticity[0, 0, 1]
        volume = elements.linear_strains(corner, value)[..., :2].sum(axis=-1, keepdims=True)
        found = (elements.shapes(value.shape[1], elements.POINTS) @ value, elements.strains(corner, value, elements.POINTS),
                 lam * elements.POINTS @ volume)
        x, y = np.moveaxis(elements.POINTS @ corner, -1, 0)
        square = lambda v: np.einsum("tqd,q,t->", v**2, elements.WEIGHTS, elements.areas(corner))
        total += [square(v) for one, wanted in zip(found, exact(x, y, lam)) for v in (one - wanted, wanted)]
    return np.sqrt(total[0::2] / total[1::2])


def row(element: str, poisson: float, cells: int) -> tuple:
    """One line of the table: a run and its errors."""
    from mpi4py import MPI

    from ..options import Settings
    from ..march.problem import assemble

    with tempfile.TemporaryDirectory() as folder:
        freefem.export(freefem.find_scene("incompressible"), Path(folder),
                       {"element": element, "poisson": repr(poisson), "cells": str(cells)})
        problem = assemble(Path(folder), MPI.COMM_SELF)
        solver = problem.solver(Settings(**TIGHT))
        step = list(solver.steps())[-1]
    subs = problem.structure.subdomains
    found = errors(subs, problem.operator.displacements(step.multipliers, step.weights))
    return element, poisson, 0.5 / cells, 2 * problem.manifest.nodes, *found.tolist()


def draw(folder: Path, rows: list[tuple]) -> list[Path]:
    """Strain above, pressure below, over the mesh size; one column a Poisson's ratio."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ..figures import BLUE, INCH, INK, RED, STYLE, WIDTH, write

    style = {"P1": ("#777777", "s"), "P2": (BLUE, "o"), "P2-mixed": (RED, "D")}
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 11 * INCH), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(2, len(POISSON), sharex=True, sharey="row", squeeze=False)
        for column, poisson in enumerate(POISSON):
            for element, (colour, marker) in style.items():
                here = [r for r in rows if r[0] == element and r[1] == poisson]
                for line, quantity in enumerate(("strain", "pressure")):
                    found = [r[COLUMNS.index(quantity)] for r in here]
                    panels[line, column].loglog([r[2] for r in here], found, color=colour, marker=marker, ms=4,
                                                label=element)
            h = np.array([0.5 / cells for cells in CELLS])
            for panel in panels[:, column]:
                panel.loglog(h, 0.003 * (h / h[0]) ** 2, color=INK, lw=0.8, ls=":", label="$h^2$")
            panels[0, column].set_title(rf"$\nu = {poisson:g}$")
            panels[1, column].set(xlabel="element size $h$", xticks=h, xticklabels=[f"1/{1 / size:.0f}" for size in h])
            panels[1, column].minorticks_off()
        panels[0, 0].set_ylabel("error of the strain\n(relative, $L_2$)")
        panels[1, 0].set_ylabel("error of the pressure\n(relative, $L_2$)")
        panels[0, 0].set_ylim(top=100 * panels[0, 0].get_ylim()[1])  # sharey: room for the legend in all columns
        panels[0, 0].legend(loc="upper left", handlelength=1.5)
        return write(figure, folder, "locking")
