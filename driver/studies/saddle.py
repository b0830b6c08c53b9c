"""The FETI-DP saddle-point matrix of the slides, assembled as a whole for a small case.

With torn dofs r, corner dofs c and multipliers lambda = (lambda_gluing, lambda_nu, lambda_T) it is

    [ K_rr  K_rc  B_r' ]        K_rr block diagonal, one block a subdomain,
    [ K_cr  K_cc  B_c' ]        K_cc assembled at the corners,
    [ B_r   B_c   0    ]

without the dofs that the supports fix. Nothing in a run uses it: it shows the structure, and its Schur
complement -F onto the multipliers checks the operator of feti/operator.py.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import mmwrite
from scipy.sparse import coo_matrix, csr_matrix

from ..scene import freefem
from ..errors import InputError
from ..files import renamed
from ..feti.reduction import constraint_matrix
from ..feti.rows import RowKind
from ..scene.loader import read_subdomains
from ..march.tearing import build
from ..feti.structure import Substructure

LARGEST = 20_000  # unknowns; a picture of more shows nothing
NAMES = (r"$\lambda_\Gamma$", r"$\lambda_\nu$", r"$\lambda_T$")


@dataclass
class Saddle:
    """Saddle-point matrix (n, n) and where its blocks end.

    `torn` are the ends of the subdomains' blocks of K_rr, `corners` is the end of the corner dofs,
    `kinds` the ends of the gluing, normal and tangential multipliers; `rows` (dual_dofs,) is the dual row
    of every multiplier in the order of the matrix.
    """

    matrix: csr_matrix
    torn: np.ndarray
    corners: int
    kinds: np.ndarray
    rows: np.ndarray


def saddle(structure: Substructure) -> Saddle:
    """Assemble the saddle-point matrix of a structure that is whole on this rank."""
    rows = np.argsort(structure.row_kind, kind="stable")
    position = np.empty_like(rows)
    position[rows] = np.arange(len(rows))
    numbers, end, torn = [], 0, []
    for sub, fixed, corner in zip(structure.subdomains, structure.fixed, structure.corner_dofs):
        number = np.zeros(sub.dofs, np.int64)
        number[fixed] = number[corner] = -1
        free = number == 0
        number[free] = end + np.arange(free.sum())
        end += free.sum()
        torn.append(end)
        numbers.append(number)
    for number, corner, coarse in zip(numbers, structure.corner_dofs, structure.corner_global):
        number[corner] = end + coarse
    corners = end + structure.coarse_dofs
    parts = []
    for sub, number, local in zip(structure.subdomains, numbers, structure.rows):
        kept = (number[sub.rows] >= 0) & (number[sub.columns] >= 0)
        parts.append((number[sub.rows[kept]], number[sub.columns[kept]], sub.values[kept]))
        B = constraint_matrix(local, sub.dofs).tocoo()
        value = B.data * local.sign[B.row]
        kept = (value != 0) & (number[B.col] >= 0)
        i, j = corners + position[local.row[B.row[kept]]], number[B.col[kept]]
        parts += [(i, j, value[kept]), (j, i, value[kept])]
    i, j, value = (np.concatenate(column) for column in zip(*parts))
    size = corners + structure.dual_dofs
    kinds = corners + np.cumsum(np.bincount(structure.row_kind, minlength=len(RowKind)))
    return Saddle(coo_matrix((value, (i, j)), shape=(size, size)).tocsr(), np.array(torn), corners, kinds, rows)


def read_structure(scene: Path, parameters: dict[str, str], comm) -> Substructure:
    """Export a scene to a temporary directory and build its skeleton on `comm` (of one rank)."""
    with tempfile.TemporaryDirectory() as directory:
        manifest = freefem.export(scene, Path(directory) / "export", parameters)
        return build(manifest, read_subdomains(manifest, 0, manifest.subdomains, comm), 0, comm)


def write_saddle(scene: Path, parameters: dict[str, str], folder: Path, comm) -> list[Path]:
    """saddle.mtx and its picture for a scene; returns the files. Raises InputError if it is too large."""
    structure = read_structure(scene, parameters, comm)
    size = structure.primal_dofs + structure.dual_dofs
    if size > LARGEST:
        raise InputError(f"the saddle-point matrix would have about {size:,} unknowns, more than the {LARGEST:,} that a "
                         "picture can show; take fewer SUBDOMAINS or CELLS")
    whole = saddle(structure)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "saddle.mtx"
    comment = (f" FETI-DP saddle-point matrix of {scene.name}: {whole.torn[-1]} torn dofs of {len(whole.torn)} subdomains, "
               f"{structure.coarse_dofs} corner dofs,\n gluing, normal, tangential multipliers end at "
               f"{whole.kinds.tolist()}")
    with renamed(path) as hidden:
        mmwrite(str(hidden), whole.matrix, comment=comment, precision=17, symmetry="symmetric")
    return [path, *_draw(whole, folder)]


def _draw(whole: Saddle, folder: Path) -> list[Path]:
    """Entries of the matrix, coloured by block, with the blocks' names along its sides."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ..figures import BLUE, GREEN, ORANGE, STYLE, WIDTH, write

    n, r, c = whole.matrix.shape[0], whole.torn[-1], whole.corners
    i, j = whole.matrix.nonzero()
    kind = np.maximum(np.searchsorted([r, c], i, side="right"), np.searchsorted([r, c], j, side="right"))
    side = 0.85 * WIDTH
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(side, side), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        for k, colour in enumerate((BLUE, ORANGE, GREEN)):
            axes.plot(j[kind == k], i[kind == k], ls="none", marker="s", mew=0, color=colour,
                      ms=max(0.5, 0.8 * 72 * side / n), rasterized=True)
        ends = [0, *whole.torn.tolist(), c, *whole.kinds.tolist()]
        for at in sorted(set(ends)):
            bold = at in (0, r, c, n)
            for line in (axes.axhline, axes.axvline):
                line(at - 0.5, color="0.3" if bold else "0.8", lw=0.7 if bold else 0.4, zorder=0)
        shown = [((r + c) / 2, "$u_c$")] * (c > r)
        shown += [((a + b) / 2, name) for a, b, name in zip((c, *whole.kinds), whole.kinds, NAMES) if b > a]
        shown += [((a + b) / 2, f"$u_{{r,{s + 1}}}$") for s, (a, b) in enumerate(zip((0, *whole.torn), whole.torn))
                  if len(whole.torn) <= 16]
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_ticks([at for at, _ in shown], [name for _, name in shown])
        axes.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
        span = {"r": (0, r), "c": (r, c), "": (c, n)}
        for row, column, name in (("r", "r", "K_{rr}"), ("r", "c", "K_{rc}"), ("c", "r", "K_{cr}"), ("c", "c", "K_{cc}"),
                                  ("r", "", "B_r^T"), ("c", "", "B_c^T"), ("", "r", "B_r"), ("", "c", "B_c"), ("", "", "0")):
            place = _emptiest(i, j, span[row], span[column], 0.03 * n)
            if place:
                axes.text(*place, f"${name}$", ha="center", va="center")
        axes.set(xlim=(-0.5, n - 0.5), ylim=(n - 0.5, -0.5), aspect="equal")
        axes.set_xlabel(f"{n:,} unknowns: {r:,} torn, {c - r:,} corner, {n - c:,} multipliers")
        return write(figure, folder, "saddle")


def _emptiest(i, j, rows: tuple, columns: tuple, half: float) -> tuple[float, float] | None:
    """Centre (x, y) of the square of side 2 half within a block that hides the fewest entries; None if none fits."""
    if min(rows[1] - rows[0], columns[1] - columns[0]) < 2 * half:
        return None
    xs, ys = (np.linspace(a + half, b - half, 21) for a, b in (columns, rows))
    hidden = {(x, y): np.count_nonzero((abs(j - x) < half) & (abs(i - y) < half)) for x in xs[::-1] for y in ys}
    return min(hidden, key=hidden.get)
