"""make accuracy PART=curved [OUT=]: what curved sides of elements are worth between two rings.

Scene verify/rings under even pressure on meshes halved in size: linear elements, quadratic ones
with straight sides (WITHOUT=curved) and with curved ones. Errors in L2 against Lame's rings,
relative to them: of the contact pressures and, at the nodes of the bodies, of displacements.
"""

import tempfile
from pathlib import Path

import meshio
import numpy as np

from ...files import read_table, write_rows
from ...results.tables import field_file
from ...runs.run import Run, execute
from ...scene import freefem

SIZES = (0.08, 0.04, 0.02, 0.01)
SIDES = {"P1": ("P1", {}), "P2, straight": ("P2", {"without": "curved"}), "P2": ("P2", {}),
         "P2-mixed": ("P2-mixed", {})}
COLUMNS = ("sides", "h", "unknowns", "pressure", "displacement")
YOUNG, POISSON, HOLE, MEET, LOAD = 1e9, 0.2, 0.2, 0.6, 1e7  # of the scene, whose rim is at 1


def run_curved(out: Path) -> list[Path]:
    """Make and draw the table in `out`; returns the files."""
    from ...figures.curved import draw

    rows = []
    for sides in SIDES:
        rows += [row(sides, h) for h in SIZES]
        orders = np.log2(np.divide(rows[-2][3:], rows[-1][3:]))
        text = ", ".join(f"{name} {order:.2f}" for name, order in zip(COLUMNS[3:], orders))
        print(f"{sides}: orders {text}", flush=True)
    table = write_rows(out / "curved.csv", COLUMNS, rows)
    return [table, *draw(table)]


def lame() -> tuple[float, float, float]:
    """A, B of u_r = A r + B/r in both rings, which are one, and the pressure where they meet."""
    outer = LOAD / (1 - HOLE**2)  # sigma_r = -outer (1 - HOLE^2/r^2)
    scale = -(1 + POISSON) / YOUNG * outer
    return (scale * (1 - 2 * POISSON), scale * HOLE**2, outer * (1 - HOLE**2 / MEET**2))


def row(sides: str, h: float) -> tuple:
    """One line of the table: a run and its errors."""
    element, options = SIDES[sides]
    with tempfile.TemporaryDirectory() as folder:
        pairs = {"scene": str(freefem.find_scene("verify/rings")), "wave": "0", "h": repr(h),
                 "element": element, "rtol": "1e-11", "figures": "no", "errors": "no",
                 "quiet": "yes", **options, "out": f"{folder}/run"}
        summary = execute(Run.from_pairs(pairs))
        contact = read_table(Path(folder) / "run" / "contact.csv")
        mesh = meshio.read(Path(folder) / "run" / field_file(1))
    A, B, pressure = lame()
    weight, off = contact["weight"], -contact["sigma_n"] / pressure - 1
    exact = (A + B / (mesh.points**2).sum(axis=1, keepdims=True)) * mesh.points
    missed = mesh.point_data["displacement"] - exact
    return (sides, h, summary["sizes"]["primal_dofs"],
            float(np.sqrt(weight @ off**2 / weight.sum())),
            float(np.linalg.norm(missed) / np.linalg.norm(exact)))
