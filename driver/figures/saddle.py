"""Picture of a FETI-DP saddle-point matrix: its entries, coloured and named by block."""

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.io import mmread

from .style import BLUE, GREEN, ORANGE, WIDTH, canvas, write

SIDE = 0.85 * WIDTH  # centimetres
NAMES = (r"$\lambda_\Gamma$", r"$\lambda_\nu$", r"$\lambda_T$")
BLOCKS = (("r", "r", "K_{rr}"), ("r", "c", "K_{rc}"), ("c", "r", "K_{cr}"), ("c", "c", "K_{cc}"),
          ("r", "", "B_r^T"), ("c", "", "B_c^T"), ("", "r", "B_r"), ("", "c", "B_c"), ("", "", "0"))


def draw(folder: Path) -> list[Path]:
    """Draw saddle.mtx with the ends of blocks in saddle.json; returns the files written."""
    matrix = mmread(str(folder / "saddle.mtx"))
    ends = json.loads((folder / "saddle.json").read_text())
    return write(canvas(lambda figure: _fill(figure, matrix, ends), SIDE, SIDE), folder, "saddle")


def _fill(figure: Figure, matrix, ends: dict) -> None:
    n, torn, c, kinds = matrix.shape[0], ends["torn"], ends["corners"], ends["kinds"]
    r = torn[-1]
    i, j = matrix.nonzero()
    block = np.maximum(np.searchsorted([r, c], i, side="right"),
                       np.searchsorted([r, c], j, side="right"))
    axes = figure.add_subplot()
    for k, colour in enumerate((BLUE, ORANGE, GREEN)):
        axes.plot(j[block == k], i[block == k], ls="none", marker="s", mew=0, color=colour,
                  ms=max(0.5, 0.8 * 72 * figure.get_figwidth() / n), rasterized=True)
    for end in sorted({0, *torn, c, *kinds}):
        bold = end in (0, r, c, n)
        for line in (axes.axhline, axes.axvline):
            line(end - 0.5, color="0.3" if bold else "0.8", lw=0.7 if bold else 0.4, zorder=0)
    shown = _names(torn, c, kinds)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_ticks([place for place, _ in shown], [name for _, name in shown])
    axes.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
    span = {"r": (0, r), "c": (r, c), "": (c, n)}
    for row, column, name in BLOCKS:
        place = _emptiest(i, j, span[row], span[column], 0.03 * n)
        if place:
            axes.text(*place, f"${name}$", ha="center", va="center")
    axes.set(xlim=(-0.5, n - 0.5), ylim=(n - 0.5, -0.5), aspect="equal")
    axes.set_xlabel(f"{n:,} unknowns: {r:,} torn, {c - r:,} corner, {n - c:,} multipliers")


def _names(torn: list[int], corners: int, kinds: list[int]) -> list[tuple[float, str]]:
    """Middle and name of every group of unknowns; of many subdomains only the common groups."""
    names = [((a + b) / 2, name) for a, b, name in zip((corners, *kinds), kinds, NAMES) if b > a]
    if corners > torn[-1]:
        names.append(((torn[-1] + corners) / 2, "$u_c$"))
    if len(torn) <= 16:
        names += [((a + b) / 2, f"$u_{{r,{s}}}$")
                  for s, (a, b) in enumerate(zip((0, *torn), torn), 1)]
    return names


def _emptiest(i, j, rows: tuple, columns: tuple, half: float) -> tuple[float, float] | None:
    """Centre (x, y) of the square in a block that hides the fewest entries; None if none fits.

    The square has the side 2 `half`; `rows` and `columns` are the ends of the block, i and j the
    entries.
    """
    if min(rows[1] - rows[0], columns[1] - columns[0]) < 2 * half:
        return None
    xs, ys = (np.linspace(a + half, b - half, 21) for a, b in (columns, rows))
    hidden = {(x, y): np.count_nonzero((abs(j - x) < half) & (abs(i - y) < half))
              for x in xs[::-1] for y in ys}
    return min(hidden, key=hidden.get)
