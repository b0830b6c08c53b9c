"""Study: what stopping by the error budget saves on the model example, against fixed tolerances.

    python3 -m driver stopping [ROWS=1,2,3,4] [OUT=results/accuracy]

For h = 1/20 to 1/160 (ROWS as in the slides' table) and both loadings, four stopping rules on one dual operator:

classical  every QP to RTOL=1e-6 and the fixed point to FRICTION_RTOL=1e-6, from the multipliers of the previous step
fixed      RTOL=1e-6 FRICTION_RTOL=1e-6, otherwise as runs do: QPs stop when their friction bound is worth renewing
budget     RTOL is the next below the largest of TRIALS that moves the contact tractions by less than SHARE of the
           discretization error on the mesh of doubled size (the same tolerance leaves more on a finer mesh), and
           FRICTION_RTOL a third of that error
reference  RTOL=1e-10: what the others are compared with

The discretization error is the difference of the references on meshes of size 2h and h, which for tractions that converge
with first order is that of h. Differences of tractions are those of (sigma_n, sigma_t) in the L2 norm over the contact
boundary, relative to the norm of the reference, the largest of all time steps. Leaves stopping.csv, .png and .pdf.
"""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..scene import freefem
from .. import options
from ..files import write_table
from ..options import Settings
from .table import LOADINGS, ROWS

CELLS = 10
TRIALS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7)
SHARE = 1 / 3
RULES = {"classical": {"rtol": 1e-6, "friction_rtol": 1e-6, "inner_rtol": 1e-9, "predictor": "previous"},
         "fixed": {"rtol": 1e-6, "friction_rtol": 1e-6},
         "reference": {"rtol": 1e-10, "friction_rtol": 1e-9, "primal_rtol": 1e-7}}
COLUMNS = ("row", "h", "loading", "discretization", "budget_rtol", "budget_friction_rtol", "products_classical",
           "products_fixed", "products_budget", "products_coarse", "saved_fixed", "saved_classical", "change_classical",
           "change_fixed", "change_budget")


@dataclass
class Tractions:
    """sigma_n, sigma_t (steps, nodes) at x with dual segments of length `weight` (nodes,), and the products they took."""

    x: np.ndarray
    weight: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray
    products: int

    def distance(self, other: "Tractions") -> float:
        """Largest relative L2 distance of all steps from `other`, whose nodes may be others."""
        on_mine = lambda values: np.array([np.interp(self.x, other.x, row) for row in values])
        square = sum(((mine - on_mine(theirs)) ** 2) @ self.weight for mine, theirs in
                     ((self.normal, other.normal), (self.tangential, other.tangential)))
        size = sum((values**2) @ self.weight for values in (self.normal, self.tangential))
        return float(np.sqrt(square / size).max())


class Mesh:
    """One mesh of the model example and its runs."""

    def __init__(self, folder: Path, loading: str, subdomains: str, cells: int):
        from mpi4py import MPI

        from ..march.problem import assemble

        freefem.export(freefem.find_scene("model"), folder,
                       {"loading": loading, "subdomains": subdomains, "cells": str(cells)})
        self.problem = assemble(folder, MPI.COMM_SELF)
        shutil.rmtree(folder)

    def run(self, **settings) -> Tractions:
        """Contact tractions with some settings. Raises DriverError if a step fails."""
        from ..results.record import Record

        solver = self.problem.solver(Settings(uniqueness="no", **settings))
        record = Record(self.problem.operator, solver)
        for step in solver.steps():
            record.add(step)
        contact, states = self.problem.structure.contact, record.states
        return Tractions(contact.xy[:, 0], contact.weight, np.array(states["sigma_n"]), np.array(states["sigma_t"]),
                         solver.history.counts["dual_multiplications"])


def by_budget(rtol: float, error: float) -> dict:
    """Settings of a run that stops at a discretization error."""
    return {"rtol": rtol, "friction_rtol": error / 3, "primal_rtol": 1.0}


def choose(coarse: Mesh, reference: Tractions, error: float) -> tuple[float, int]:
    """RTOL for a discretization error from trials on a coarse mesh, and the products that the trials took."""
    spent = 0
    for rtol, tighter in zip(TRIALS, TRIALS[1:]):
        trial = coarse.run(**by_budget(rtol, error))
        spent += trial.products
        if trial.distance(reference) <= SHARE * error:
            break
    return tighter, spent


def compare(folder: Path, row: int, loading: str) -> dict:
    """One row of the table."""
    coarse, fine = (Mesh(folder / "export", loading, ROWS[row], cells) for cells in (CELLS // 2, CELLS))
    coarse_reference, reference = (mesh.run(**RULES["reference"]) for mesh in (coarse, fine))
    error = reference.distance(coarse_reference)
    rtol, spent = choose(coarse, coarse_reference, error)
    budget = by_budget(rtol, error)
    runs = {"classical": fine.run(**RULES["classical"]), "fixed": fine.run(**RULES["fixed"]), "budget": fine.run(**budget)}
    found = {"row": row, "h": 2.0 / CELLS / int(ROWS[row].split("x")[0]), "loading": loading, "discretization": error,
             "budget_rtol": rtol, "budget_friction_rtol": budget["friction_rtol"], "products_coarse": spent}
    found |= {f"products_{rule}": run.products for rule, run in runs.items()}
    found |= {f"change_{rule}": run.distance(reference) for rule, run in runs.items()}
    return found | {f"saved_{rule}": 1 - runs["budget"].products / runs[rule].products for rule in ("fixed", "classical")}


def run_stopping(pairs: dict[str, str]) -> list[Path]:
    """Make and draw the table; returns the files. Raises InputError for unknown options."""
    given = options.read("stopping", pairs)
    out = given["out"]
    out.mkdir(parents=True, exist_ok=True)
    table = []
    with tempfile.TemporaryDirectory(prefix=".stopping.", dir=out) as folder:
        for row in map(int, given["rows"]):
            for loading in LOADINGS:
                table.append(compare(Path(folder), row, loading))
                print(describe(table[-1]), flush=True)
    return [write_table(out / "stopping.csv", table, COLUMNS), *draw(out, table)]


def describe(row: dict) -> str:
    """One line."""
    return (f"h = 1/{1 / row['h']:.0f}, {row['loading']}: products {row['products_classical']} classical, "
            f"{row['products_fixed']} fixed, {row['products_budget']} by the budget "
            f"({100 * row['saved_fixed']:.0f} % and {100 * row['saved_classical']:.0f} % saved); tractions change by "
            f"{row['change_budget']:.1e} (fixed: {row['change_fixed']:.1e}), discretization error "
            f"{row['discretization']:.1e}")


def draw(folder: Path, table: list[dict]) -> list[Path]:
    """Products above, changes of the tractions below, over 1/h; one column a loading."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ..figures import INCH, STYLE, WIDTH, write

    style = {"classical": ("#777777", "s"), "fixed": ("#0072B2", "o"), "budget": ("#D55E00", "D")}
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 11 * INCH), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(2, 2, sharex=True, sharey="row")
        for column, loading in enumerate(LOADINGS):
            rows = [row for row in table if row["loading"] == loading]
            n = [1 / row["h"] for row in rows]
            above, below = panels[:, column]
            for rule, (colour, marker) in style.items():
                above.loglog(n, [row[f"products_{rule}"] for row in rows], color=colour, marker=marker, ms=4, label=rule)
                below.loglog(n, [row[f"change_{rule}"] for row in rows], color=colour, marker=marker, ms=4)
            below.loglog(n, [row["discretization"] for row in rows], color="#222222", ls="--", label="discretization error")
            above.set_title(loading)
            below.set(xlabel=r"$1/h$ [1/m]", xticks=n, xticklabels=[f"{value:.0f}" for value in n])
            below.minorticks_off()
        panels[0, 0].set_ylabel("products with $F$")
        panels[1, 0].set_ylabel("relative change\nof contact tractions")
        for row, names in ((0, 3), (1, 1)):  # sharey: room for the legend above the curves of both columns
            panels[row, 0].set_ylim(top=6 * panels[row, 0].get_ylim()[1])
            panels[row, 0].legend(loc="upper left", ncols=names, columnspacing=1.0, handlelength=1.5)
        return write(figure, folder, "stopping")
