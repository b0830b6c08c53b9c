"""Picture of the study `effects`: contact tractions without each effect, changes and costs."""

from pathlib import Path

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..files import read_rows, read_table
from ..text import change
from .reading import contact_boundaries, select
from .scales import scale_for
from .style import BLUE, GREEN, INCH, INK, ORANGE, PURPLE, RED, SKY, canvas, header, literal, write

COLOURS = (INK, RED, BLUE, GREEN, ORANGE, PURPLE, SKY, "#7A4B00")
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))
STAGES = {"export": "#BBBBBB", "read": "#777777", "setup": ORANGE, "solve": BLUE, "output": GREEN}
_ENDS = {"2": "refused", "3": "no solution", "4": "not converged"}  # by exit status
HEADINGS = {  # of the changes at the end of the run
    "peak_normal": "peak\n$|\\sigma_n|$", "peak_tangential": "peak\n$|\\sigma_t|$",
    "resultant_n": "normal\nforce", "resultant_t": "shear\nforce",
    "contact_length": "contact\nlength", "largest_slip": "largest\nslip",
    "dissipated": "friction\nenergy", "max_displacement": "largest\n$|u|$"}


def draw(table: Path) -> list[Path]:
    """Draw ``<scene>.csv`` and ``<scene>-tractions.csv``; returns the files written."""
    variants = read_rows(table)
    curves = _curves(table.with_name(f"{table.stem}-tractions.csv"))
    height = 0.5 * len(variants) + (9.6 if curves else 4.2)
    return write(canvas(lambda figure: _fill(figure, table.stem, variants, curves), height),
                 table.parent, table.stem)


def label(without: str) -> str:
    """Name of a variant by the effect that is left out, "" for the scene as declared."""
    return f"without {without}" if without else "as declared"


def _curves(path: Path) -> dict[str, dict]:
    """Columns of the contact tractions by variant, in the order of the file."""
    table = read_table(path)
    if table is None:
        return {}
    # an empty name is read as nan where all are empty
    name = np.array(["" if text == "nan" else str(text) for text in table["variant"].astype(str)])
    return {str(variant): select(table, name == variant) for variant in dict.fromkeys(name)}


def _fill(figure: Figure, scene: str, variants: list[dict], curves: dict[str, dict]) -> None:
    """Contact tractions at the end of the run above the changes and costs of every variant."""
    matrix = 0.5 * len(variants) + 2
    rows = figure.add_gridspec(2 if curves else 1, 1, height_ratios=[
                               5.2, matrix] if curves else None)
    handles = []
    if curves:
        rubs = any(rows_["sigma_t"].any() for rows_ in curves.values())
        top = rows[0].subgridspec(1, 1 + rubs)
        panels = [figure.add_subplot(top[0, k]) for k in range(1 + rubs)]
        _tractions(panels, curves, [variant["without"] for variant in variants])
        handles = panels[0].get_legend_handles_labels()[0]
    bottom = rows[-1].subgridspec(1, 3, width_ratios=[7.4, 1.5, 1.5])
    _changes(figure.add_subplot(bottom[0, 0]), variants[1:])
    _costs(figure.add_subplot(bottom[0, 1]), figure.add_subplot(bottom[0, 2]), variants)
    header(figure, "Effects left out one at a time",
           f"scene {literal(scene)}; changes at the end of the run, costs of the whole run",
           handles, 2.4)
    _key(figure, bottom=0.62 * INCH / figure.get_figheight())


def _tractions(panels: list, curves: dict[str, dict], names: list[str]) -> None:
    """Tractions along the boundary that carries most, at the end of the run."""
    full = next(iter(curves.values()))
    load = {b: np.abs(rows["sigma_n"] * rows["weight"]).sum()
            for b, rows in contact_boundaries(full)}
    most = max(load, key=load.get)
    shown = {name: dict(contact_boundaries(curve))[most] for name, curve in curves.items()}
    along = scale_for(full["length_unit"][0], full["arc"])
    for panel, column, title in zip(panels, ("sigma_n", "sigma_t"), ("normal", "shear")):
        values, weight = (np.concatenate([rows[n] for rows in shown.values()])
                          for n in (column, "weight"))
        stress = scale_for(full["stress_unit"][0], _spread(np.abs(values), weight, 0.95)[1])
        low, high = np.multiply(_spread(values, weight, 0.97), stress.factor)
        for name, rows in shown.items():
            k = names.index(name)
            panel.plot(rows["arc"] * along.factor, rows[column] * stress.factor, label=label(name),
                       color=COLOURS[k % len(COLOURS)], linestyle=DASHES[k % len(DASHES)],
                       lw=1.8 if k == 0 else 1.2)
        panel.axhline(0, color="0.6", lw=0.5, zorder=0)
        symbol = rf"$\{column}$"
        panel.set(xlabel=f"arc length [{along.label}]", ylabel=f"{symbol} [{stress.label}]")
        if high > low:
            room = 0.08 * (high - low)
            panel.set_ylim(low - room, high + room)
        panel.margins(x=0)
        panel.set_title(f"{title} traction" + (f", boundary {most}" if len(load) > 1 else ""))


def _spread(values: np.ndarray, weight: np.ndarray, share: float) -> tuple[float, float]:
    """Range of all values, 0 included.

    Where a singular edge would flatten all curves: the range on `share` of the length.
    """
    whole = min(values.min(), 0.0), max(values.max(), 0.0)
    order = np.argsort(values)
    along = np.cumsum(weight[order]) / weight.sum()
    ends = np.minimum(np.searchsorted(along, [1 - share, share]), len(values) - 1)
    low, high = values[order][ends]
    low, high = min(low, 0.0), max(high, 0.0)
    return (low, high) if whole[1] - whole[0] > 3 * (high - low) else whole


def _changes(axes, variants: list[dict]) -> None:
    """Matrix of relative changes: a row a variant, a column a quantity."""
    colours = LinearSegmentedColormap.from_list("change", ["#5B9BD0", "#FFFFFF", "#E58A4E"])
    values = np.array([[float(variant[f"{name}_change"] or "nan") for name in HEADINGS]
                       for variant in variants]).reshape(len(variants), len(HEADINGS))
    shade = np.clip(np.nan_to_num(values), -1, 1)
    axes.imshow(np.sign(shade) * np.sqrt(np.abs(shade)) * 0.9, cmap=colours, vmin=-1, vmax=1,
                aspect="auto", interpolation="nearest")
    for i, variant in enumerate(variants):
        if variant["status"] != "0":
            reason = variant["reason"]
            if len(reason) >= 64:
                reason = reason[:61].rsplit(" ", 1)[0] + " …"
            axes.text(len(HEADINGS) / 2 - 0.5, i, f"{_ENDS.get(variant['status'], 'failed')}: "
                      f"{reason}", ha="center", va="center", fontsize=6, color="0.3")
            continue
        for k, value in enumerate(values[i]):
            text = change(value).replace("-", "\N{MINUS SIGN}").replace(" ", "\N{THIN SPACE}")
            axes.text(k, i, text, ha="center", va="center", fontsize=6)
    axes.set_xticks(range(len(HEADINGS)), list(HEADINGS.values()), fontsize=6.5)
    axes.set_yticks(range(len(variants)), [label(variant["without"]) for variant in variants])
    axes.set_xticks(np.arange(-0.5, len(HEADINGS)), minor=True)
    axes.set_yticks(np.arange(-0.5, len(variants)), minor=True)
    axes.grid(which="minor", color="white", lw=1.5)
    axes.tick_params(which="both", length=0)
    axes.xaxis.tick_top()
    for side in axes.spines.values():
        side.set_visible(False)


def _costs(products, seconds, variants: list[dict]) -> None:
    """Products with F and seconds by stage; the scene as declared is the vertical line."""
    full, *others = variants
    for i, variant in enumerate(others):
        if variant["status"] != "0":
            continue
        products.barh(i, float(variant["dual_multiplications"]), 0.62, color="#888888")
        start = 0.0
        for stage, colour in STAGES.items():
            spent = float(variant[f"seconds_{stage}"])
            seconds.barh(i, spent, 0.62, start, color=colour)
            start += spent
    for axes, limit, text in ((products, full["dual_multiplications"], "products\nwith $F$"),
                              (seconds, full["seconds_total"], "seconds")):
        axes.axvline(float(limit), color=INK, lw=1)
        axes.set(ylim=(len(others) - 0.5, -0.5), yticks=[], title=text, xlim=(0, None))
        axes.title.set_fontsize(7)
        axes.tick_params(axis="x", labelsize=7)
        axes.locator_params(axis="x", nbins=2)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)


def _key(figure: Figure, bottom: float) -> None:
    """Key to the bars, at the foot of the figure, from which the axes keep away."""
    keys = [Line2D([], [], color=INK, lw=1, label="as declared")]
    keys += [Patch(color=colour, label=stage) for stage, colour in STAGES.items()]
    engine = figure.get_layout_engine()
    x, _, width, top = engine.get()["rect"]
    engine.set(rect=(x, bottom, width, top - bottom))
    figure.legend(handles=keys, loc="lower right", ncols=len(keys), frameon=False, fontsize=7,
                  handlelength=1, columnspacing=1, handletextpad=0.4, borderaxespad=0.2)
