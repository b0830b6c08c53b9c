"""make accuracy PART=stopping [ROWS=1,2,3,4] [OUT=]: what stopping by the error budget saves.

For h = 1/20 to 1/160 of the model example (ROWS as in the slides' table) and both loadings, four
stopping rules on one dual operator:

classical  QPs to RTOL=1e-6, the fixed point to FRICTION_RTOL=1e-6, from the previous step
fixed      the same tolerances, otherwise as runs do: QPs stop when their bound is worth renewing
budget     RTOL is the next below the largest of TRIALS that moves the contact tractions by less
           than SHARE of the discretization error on the mesh of doubled size (the same tolerance
           leaves more on a finer mesh), and FRICTION_RTOL a third of that error
reference  RTOL=1e-10: what the others are compared with

The discretization error is the difference of the references on meshes of size 2h and h, which for
tractions that converge with first order is that of h. Differences of tractions are those of
(sigma_n, sigma_t) in the L2 norm over the contact boundary, relative to the norm of the reference,
the largest of all time steps. Leaves stopping.csv, .png and .pdf.
"""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ...files import write_table
from ...march.problem import assemble
from ...options import Settings
from ...results.record import Record
from ...scene import freefem
from ..table import LOADINGS, ROWS

CELLS = 10
TRIALS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7)
SHARE = 1 / 3
RULES = {"classical": {"rtol": 1e-6, "friction_rtol": 1e-6, "inner_rtol": 1e-9,
                       "predictor": "previous"}, "fixed": {"rtol": 1e-6, "friction_rtol": 1e-6},
         "reference": {"rtol": 1e-10, "friction_rtol": 1e-9, "primal_rtol": 1e-7}}
COLUMNS = ("row", "h", "loading", "discretization", "budget_rtol", "budget_friction_rtol",
           "products_classical", "products_fixed", "products_budget", "products_coarse",
           "saved_fixed", "saved_classical", "change_classical", "change_fixed", "change_budget")


@dataclass
class Tractions:
    """sigma_n, sigma_t (steps, nodes) at x on segments of length `weight`, and their products."""

    x: np.ndarray
    weight: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray
    products: int

    def distance(self, other: "Tractions") -> float:
        """Largest relative L2 distance of all steps from `other`, whose nodes may be others."""
        square = size = 0.0
        for mine, theirs in ((self.normal, other.normal), (self.tangential, other.tangential)):
            moved = np.array([np.interp(self.x, other.x, row) for row in theirs])
            square = square + ((mine - moved) ** 2) @ self.weight
            size = size + (mine**2) @ self.weight
        return float(np.sqrt(square / size).max())


class Mesh:
    """One mesh of the model example and its runs."""

    def __init__(self, folder: Path, loading: str, subdomains: str, cells: int):
        freefem.export(freefem.find_scene("model"), folder,
                       {"loading": loading, "subdomains": subdomains, "cells": str(cells)})
        self.problem = assemble(folder, MPI.COMM_SELF)
        shutil.rmtree(folder)

    def run(self, **settings) -> Tractions:
        """Contact tractions with some settings. Raises DriverError if a step fails."""
        solver = self.problem.solver(Settings(uniqueness="no", **settings))
        record = Record(self.problem.operator, solver)
        for step in solver.steps():
            record.add(step)
        contact, states = self.problem.structure.contact.declared, record.states
        return Tractions(contact.xy[:, 0], contact.weight, np.array(states["sigma_n"]),
                         np.array(states["sigma_t"]), solver.history.counts["dual_multiplications"])


def by_budget(rtol: float, error: float) -> dict:
    """Settings of a run that stops at a discretization error."""
    return {"rtol": rtol, "friction_rtol": error / 3, "primal_rtol": 1.0}


def choose(coarse: Mesh, reference: Tractions, error: float) -> tuple[float, int]:
    """RTOL for a discretization error by trials on a coarse mesh, and the products of these."""
    spent, tighter = 0, TRIALS[-1]
    for rtol, tighter in zip(TRIALS, TRIALS[1:]):
        trial = coarse.run(**by_budget(rtol, error))
        spent += trial.products
        if trial.distance(reference) <= SHARE * error:
            break
    return tighter, spent


def compare(folder: Path, row: int, loading: str) -> dict:
    """One row of the table."""
    coarse, fine = (Mesh(folder / "export", loading, ROWS[row], cells)
                    for cells in (CELLS // 2, CELLS))
    coarse_reference, reference = (mesh.run(**RULES["reference"]) for mesh in (coarse, fine))
    error = reference.distance(coarse_reference)
    rtol, spent = choose(coarse, coarse_reference, error)
    budget = by_budget(rtol, error)
    runs = {name: fine.run(**settings) for name, settings in
            (("classical", RULES["classical"]), ("fixed", RULES["fixed"]), ("budget", budget))}
    values = {"row": row, "h": 2.0 / CELLS / int(ROWS[row].split("x")[0]), "loading": loading,
              "discretization": error, "budget_rtol": rtol,
              "budget_friction_rtol": budget["friction_rtol"], "products_coarse": spent}
    values |= {f"products_{rule}": run.products for rule, run in runs.items()}
    values |= {f"change_{rule}": run.distance(reference) for rule, run in runs.items()}
    return values | {f"saved_{rule}": 1 - runs["budget"].products / runs[rule].products
                     for rule in ("fixed", "classical")}


def run_stopping(out: Path, rows: list[str]) -> list[Path]:
    """Make and draw the table of some `rows` in `out`; returns the files."""
    from ...figures.stopping import draw

    table = []
    with tempfile.TemporaryDirectory(prefix=".stopping.", dir=out) as folder:
        for row in map(int, rows):
            for loading in LOADINGS:
                table.append(compare(Path(folder), row, loading))
                print(describe(table[-1]), flush=True)
    path = write_table(out / "stopping.csv", table, COLUMNS)
    return [path, *draw(path)]


def describe(row: dict) -> str:
    """One row of the table as a sentence."""
    saved = f"{100 * row['saved_fixed']:.0f} % and {100 * row['saved_classical']:.0f} % saved"
    return (f"h = 1/{1 / row['h']:.0f}, {row['loading']}: products {row['products_classical']} "
            f"classical, {row['products_fixed']} fixed, {row['products_budget']} by the budget "
            f"({saved}); tractions change by {row['change_budget']:.1e} (fixed: "
            f"{row['change_fixed']:.1e}), discretization error {row['discretization']:.1e}")
