"""make accuracy PART=locking [OUT=]: how elements converge near incompressibility.

Scene incompressible with Poisson's ratios near 1/2, each element on meshes halved in size; errors
against the exact solution, relative to it, in L2: of the displacement, of the strain and of the
pressure lambda div u. Linear elements lock: the volumes to keep are more than the displacements to
keep them with. Quadratic ones lose one order of the strain (Babuska, Suri, Numer. Math. 62 (1992)
439-463), P2-mixed nothing.
"""

import tempfile
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ...files import write_rows
from ...march.problem import assemble
from ...options import Settings
from ...scene import element_kinds, elements, freefem

POISSON = (0.3, 0.49, 0.4999, 0.499999)
CELLS = (2, 4, 8, 16)
COLUMNS = ("element", "poisson", "h", "unknowns", "displacement", "strain", "pressure")
W, K = 0.01, 2.0  # of the scene
TIGHT = {"rtol": 1e-12, "primal_rtol": 1e-4, "estimator": "none"}


def run_locking(out: Path) -> list[Path]:
    """Make and draw the table in `out`; returns the files."""
    from ...figures.locking import draw

    rows = []
    for poisson in POISSON:
        for element in element_kinds.NODES:
            rows += [row(element, poisson, cells) for cells in CELLS]
            orders = np.log2(np.divide(rows[-2][4:], rows[-1][4:]))
            text = ", ".join(f"{name} {order:.2f}" for name, order in zip(COLUMNS[4:], orders))
            print(f"{element}, Poisson's ratio {poisson:g}: orders {text}", flush=True)
    table = write_rows(out / "locking.csv", COLUMNS, rows)
    return [table, *draw(table)]


def exact(x: np.ndarray, y: np.ndarray, lam: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement (..., 2), strain e11, e22, 2 e12 (..., 3), pressure (..., 1) at Lame's `lam`."""
    s, c, sy, cy = np.sin(K * x), np.cos(K * x), np.sin(K * y), np.cos(K * y)
    u = W * np.stack([s * (cy + sy / lam), -c * sy], axis=-1)
    strain = W * K * np.stack([c * (cy + sy / lam), -c * cy, s * cy / lam], axis=-1)
    return u, strain, (W * K * c * sy)[..., None]


def errors(subdomains: list, fields: list) -> np.ndarray:
    """(3,) relative L2 errors of displacement, strain and pressure of `fields` by subdomain."""
    total = np.zeros(6)
    for sub, u in zip(subdomains, fields):
        corner, value = sub.xy[sub.triangles], u.reshape(-1, 2)[sub.elements]
        lam = sub.elasticity[0, 0, 1]
        volume = elements.linear_strains(corner, value)[..., :2].sum(axis=-1, keepdims=True)
        computed = (elements.shapes(value.shape[1], elements.POINTS) @ value,
                    elements.strains(corner, value, elements.POINTS),
                    lam * elements.POINTS @ volume)
        x, y = np.moveaxis(elements.POINTS @ corner, -1, 0)
        weights = elements.WEIGHTS, elements.areas(corner)
        for k, (mine, true) in enumerate(zip(computed, exact(x, y, lam))):
            total[k] += np.einsum("tqd,q,t->", (mine - true) ** 2, *weights)
            total[3 + k] += np.einsum("tqd,q,t->", true**2, *weights)
    return np.sqrt(total[:3] / total[3:])


def row(element: str, poisson: float, cells: int) -> tuple:
    """One line of the table: a run and its errors."""
    with tempfile.TemporaryDirectory() as folder:
        freefem.export(freefem.find_scene("incompressible"), Path(folder),
                       {"element": element, "poisson": repr(poisson), "cells": str(cells)})
        problem = assemble(Path(folder), MPI.COMM_SELF)
        solver = problem.solver(Settings(**TIGHT))
        step = list(solver.steps())[-1]
    displacements = problem.operator.displacements(step.multipliers, step.weights)
    relative = errors(problem.structure.subdomains, displacements)
    return element, poisson, 0.5 / cells, 2 * problem.manifest.nodes, *relative.tolist()
