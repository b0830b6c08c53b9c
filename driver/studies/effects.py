"""Study: what each declared effect of a scene changes and what it costs.

    python3 -m driver effects SCENE=bracket [SUBDOMAINS=] [STEPS=] [NP=] [OUT=results/effects] [...]

The scene runs as declared and with each effect taken out in turn. A variant is the scene's own text without the
macros that declare the effect; it runs in a process of its own, so that its memory is its own. Leaves
``<scene>.csv``, ``.png`` and ``.pdf``.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from .. import environment, files, options
from ..errors import PARTIAL
from ..scene import freefem

FRICTION = r"friction|tresca|slipFactor|displacementFactor|slipRange"
# taken out one after the other: name and the macros that declare it; no macro of a scene may be in the way
EFFECTS = {
    "friction": FRICTION,
    "slip dependence": "slipFactor|displacementFactor|slipRange",
    "contact": f"contact|contactPair|contactNormal|gap|pairGap|obstacle|bilateral|{FRICTION}",
    "gap": "gap|pairGap",
    "obstacle": "obstacle",
    "lift-off": "bilateral",
    "body force": r"bodyForce\d",
    "point loads": r"pointLoad\d",
    "thermal strain": r"thermal\w*",
    "initial state": "initialX|initialY",
}
NAMES = {"lift-off": "adhesion (bilateral)"}
DRIVES = r"(load|displacement)(\d)"  # forces and displacements: taken out one by one where there are several

RESPONSE = {  # at the end of the run: column and its heading in the picture
    "peak_normal": "peak\n$|\\sigma_n|$", "peak_tangential": "peak\n$|\\sigma_t|$", "resultant_n": "total\n$|R_n|$",
    "resultant_t": "total\n$|R_t|$", "contact_length": "contact\nlength", "largest_slip": "largest\nslip",
    "dissipated": "friction\nenergy", "max_displacement": "largest\n$|u|$"}
COST = ("primal_dofs", "dual_gluing", "dual_normal", "dual_tangential", "coarse_dofs", "steps",
        "fixed_point_iterations", "dual_multiplications", "dual_multiplications_setup")
STAGES = ("export", "read", "setup", "solve", "output", "total")
COLUMNS = ("without", "status", "reason", *RESPONSE, *(f"{name}_change" for name in RESPONSE), *COST,
           *(f"seconds_{name}" for name in STAGES), "memory_mib")

# strings and comments first, so that nothing inside them is taken for a declaration; a macro ends at its //
TOKEN = re.compile(
    r'\binclude\s*"(?P<include>[^"\n]*)"|(?P<string>"[^"\n]*")|/\*.*?\*/'
    r"|\bmacro\s+(?P<macro>\w+).*?(?://[^\n]*|\Z)|\bNewMacro\s+(?P<new>\w+).*?\bEndMacro\b"
    r"|\bquasistatic\s*\((?P<end>(?:[^()]|\((?:[^()]|\([^()]*\))*\))*)\)|//[^\n]*", re.S)


# ---- the scene's text --------------------------------------------------------------------------------

def declared(text: str) -> list[str]:
    """Names of the macros that a scene's text defines, in order, and ``quasistatic`` if it calls that."""
    return [match["macro"] or match["new"] or "quasistatic" for match in TOKEN.finditer(text)
            if match["macro"] or match["new"] or match["end"] is not None]


def without(text: str, macros: str) -> str:
    """The text without the definitions of macros whose whole name matches the pattern `macros`."""
    def keep(match):
        name = match["macro"] or match["new"]
        return "" if name and re.fullmatch(macros, name) else match[0]

    return TOKEN.sub(keep, text)


def static(text: str) -> str:
    """The text with ``quasistatic(T)`` replaced by its end time: one step under the final amplitudes."""
    return TOKEN.sub(lambda match: f"timeEnd = {match['end']}" if match["end"] is not None else match[0], text)


def held(text: str, number: str) -> str:
    """The text with amplitude `number` at its final value in every step."""
    def keep(match):
        if match["macro"] != f"amplitude{number}":
            return match[0]
        return re.sub(rf"\bamplitude{number}\b", f"amplitudeUntil{number}", match[0], count=1) + \
            f"\nmacro amplitude{number}(t) amplitudeUntil{number}((timeEnd)) //"

    return TOKEN.sub(keep, text)


def self_contained(scene: Path) -> str:
    """The scene's text with includes that hold declarations put in place and paths of its files made absolute."""
    def resolve(match):
        if match["include"]:
            for folder in (scene.parent, environment.LIBRARY):
                path = folder / match["include"]
                if path.is_file() and path.name not in ("scene.idp", "export.idp"):
                    inner = self_contained(path)
                    if set(declared(inner)) & known or folder == scene.parent:
                        return inner
            return match[0]
        if match["string"] and (scene.parent / match["string"][1:-1]).is_file():
            return f'"{(scene.parent / match["string"][1:-1]).resolve()}"'
        return match[0]

    known = {"young", "poisson", "support", "contact", "gap", "friction", "tresca", "load1", "displacement1", "quasistatic"}
    return TOKEN.sub(resolve, scene.read_text())


def variants(text: str) -> dict[str, str]:
    """Name of every declared effect and the scene's text without it."""
    names = declared(text)
    has = lambda pattern: [name for name in names if re.fullmatch(pattern, name)]
    found = {NAMES.get(effect, effect): without(text, pattern) for effect, pattern in EFFECTS.items()
             if has(pattern.split("|" + FRICTION)[0])}
    drives = has(DRIVES) + has(r"(bodyForce|pointLoad)\d")
    if len(drives) > 1:
        for name in has(DRIVES):
            found[re.sub(r"(\d)", r" \1", name)] = without(text, name)
    if "quasistatic" in names:
        found["time"] = static(text)
        amplitudes = has(r"amplitude\d")
        if len(amplitudes) > 1:
            found.update({f"history of {name[-1]}": held(text, name[-1]) for name in amplitudes})
    return found


# ---- runs --------------------------------------------------------------------------------------------

@dataclass
class Variant:
    """A finished, or failed, run: a row of the table and the contact tractions at its end."""

    name: str  # the effect taken out, "" for the scene as declared
    status: int
    reason: str = ""
    row: dict = field(default_factory=dict)
    contact: dict | None = None
    seconds: dict = field(default_factory=dict)
    units: dict = field(default_factory=dict)


def run_variant(name: str, text: str, scene: Path, pairs: dict[str, str], folder: Path) -> Variant:
    """Run a scene's text with the options `pairs` in a process of its own."""
    place = folder / re.sub(r"\W+", "-", name or "declared")
    place.mkdir()
    (place / scene.name).write_text(text)
    given = {**pairs, "scene": place / scene.name, "out": place / "out", "figures": "no", "fields": "no", "quiet": "yes",
               "errors": "no"}
    if name == "time":
        given.pop("steps", None)
    command = [sys.executable, "-m", "driver", "run", *(f"{key.upper()}={value}" for key, value in given.items())]
    env = {**os.environ, "PYTHONPATH": environment.python_path()}
    done = subprocess.run(command, env=env, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    said = [line for line in done.stderr.splitlines() if line.strip()] or [f"exit status {done.returncode}"]
    if done.returncode:
        reason = said[-1].removeprefix("error: ").split(PARTIAL)[0]
        return Variant(name, done.returncode, reason)
    return read_variant(name, place / "out")


def read_variant(name: str, out: Path) -> Variant:
    """Row, contact tractions, seconds and units of a finished run."""
    from ..figures import read_table, select

    summary, history = json.loads((out / "summary.json").read_text()), read_table(out / "history.csv")
    contact, last = read_table(out / "contact.csv"), {key: column[-1] for key, column in history.items()}
    row = dict.fromkeys(RESPONSE, 0.0)
    row |= {key: abs(float(last[key]))
            for key in ("resultant_n", "resultant_t", "contact_length", "dissipated", "max_displacement")}
    if contact:
        nodes = len(set(contact["node"]))
        row["largest_slip"] = float(abs(contact["slip"]).reshape(-1, nodes).sum(axis=0).max())
        contact = select(contact, contact["step"] == contact["step"].max())
        row |= {"peak_normal": float(abs(contact["sigma_n"]).max()), "peak_tangential": float(abs(contact["sigma_t"]).max())}
    row |= {key: value for part in (summary["sizes"], summary["counts"], summary)
            for key, value in part.items() if key in COST}
    row |= {f"seconds_{stage}": summary["seconds"][stage] for stage in STAGES} | {"memory_mib": summary["memory_mib"]}
    return Variant(name, 0, "", row, contact, summary["seconds"], summary["units"])


def compare(found: list[Variant]) -> None:
    """Add to every row its changes relative to the scene as declared, the first of `found`."""
    full = found[0].row
    for variant in found:
        for name in RESPONSE if variant.row else ():
            change = variant.row[name] - full[name]
            # what friction leaves at a frictionless contact is rounding: nothing, compared with the pressures
            scale = {"resultant_t": "resultant_n", "peak_tangential": "peak_normal"}.get(name, name)
            size = abs(full[name]) if abs(full[name]) > 1e-9 * abs(full[scale]) else 0.0
            variant.row[f"{name}_change"] = change / size if size > 0 else None


def run_effects(pairs: dict[str, str]) -> list[Path]:
    """Run all variants, write the table and draw it; returns the files.

    Raises InputError for options that the study sets itself and for a scene that does not run as declared
    (DriverError of the run's exit status).
    """
    from ..errors import error_of

    given = options.read("effects", pairs)
    scene, out = freefem.find_scene(given["scene"]), given["out"]
    out.mkdir(parents=True, exist_ok=True)
    text = self_contained(scene)
    found = []
    with tempfile.TemporaryDirectory(prefix=f".{scene.stem}.", dir=out) as folder:
        for name, changed in {"": text, **variants(text)}.items():
            found.append(run_variant(name, changed, scene, pairs, Path(folder)))
            print(f"{label(found[-1])}: {found[-1].reason or 'done'}", flush=True)
            if found[0].status:
                raise error_of(found[0].status if found[0].status in (2, 3, 4) else 2, found[0].reason)
    compare(found)
    paths = [write_table(out / f"{scene.stem}.csv", found), *draw(out, scene.stem, found)]
    print(describe(found))
    return paths


# ---- table -------------------------------------------------------------------------------------------

def label(variant: Variant) -> str:
    """Name of a row."""
    return f"without {variant.name}" if variant.name else "as declared"


def write_table(path: Path, found: list[Variant]) -> Path:
    """One row a variant; columns of a variant without solution are empty."""
    rows = [{**v.row, "without": v.name, "status": v.status, "reason": v.reason} for v in found]
    return files.write_table(path, rows, COLUMNS)


def change(value: float | None, short: bool = False) -> str:
    """A relative change as people read it: a percentage, or a factor where that is large."""
    if value is None:
        return "–"
    if abs(value) < 5e-5:
        return "0"
    if value >= 9:
        return f"×{1 + value:.0f}" if value < 9999 else f"×{1 + value:.0e}"
    return f"{100 * value:+.{0 if abs(value) >= 0.1 else 1 if abs(value) >= 0.01 else 2}f}{'' if short else ' '}%"


def describe(found: list[Variant]) -> str:
    """Both tables as text: changes relative to the scene as declared, and costs."""
    width = max(len(label(variant)) for variant in found) + 2
    short = lambda name: name.replace("resultant", "res.").replace("tangential", "tang.").replace("displacement", "displ.")
    heads = [short(name.replace("_", " ")) for name in RESPONSE]
    lines = ["", "changes at the end of the run", " " * width + "".join(f"{head:>16s}" for head in heads)]
    for variant in found:
        cells = [f"{variant.row[name]:.4g}" if not variant.name else change(variant.row[f"{name}_change"])
                 for name in RESPONSE] if variant.row else []
        lines.append(f"{label(variant):{width}s}" + ("".join(f"{cell:>16s}" for cell in cells) or f"  {variant.reason}"))
    heads = ("primal dofs", "multipliers", "coarse dofs", "products", *(f"{stage} s" for stage in STAGES), "MiB")
    lines += ["", "costs", " " * width + "".join(f"{head:>13s}" for head in heads)]
    for variant in found:
        row = variant.row
        if row:
            cells = [row["primal_dofs"], row["dual_gluing"] + row["dual_normal"] + row["dual_tangential"],
                     row["coarse_dofs"], row["dual_multiplications"], *(f"{row[f'seconds_{s}']:.3f}" for s in STAGES),
                     f"{row['memory_mib']:.0f}"]
            lines.append(f"{label(variant):{width}s}" + "".join(f"{cell:>13}" for cell in cells))
    return "\n".join(lines)


# ---- picture -----------------------------------------------------------------------------------------

COLOURS = ("#222222", "#D55E00", "#0072B2", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#7A4B00")
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))
STAGE_COLOURS = {"export": "#BBBBBB", "read": "#777777", "setup": "#E69F00", "solve": "#0072B2", "output": "#009E73"}


def draw(folder: Path, name: str, found: list[Variant]) -> list[Path]:
    """Contact tractions at the end of the run; below them the changes and costs of every variant."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ..figures import INCH, STYLE, WIDTH, place_header, write

    touching = [variant for variant in found if variant.contact]
    matrix = 0.5 * len(found) + 2
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, (matrix + (7.6 if touching else 2.2)) * INCH), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        rows = figure.add_gridspec(2 if touching else 1, 1, height_ratios=[5.2, matrix] if touching else None)
        if touching:
            rubs = any(variant.contact["sigma_t"].any() for variant in touching)
            top = rows[0].subgridspec(1, 1 + rubs)
            _tractions([figure.add_subplot(top[0, k]) for k in range(1 + rubs)], touching, found)
        bottom = rows[-1].subgridspec(1, 3, width_ratios=[7.4, 1.5, 1.5])
        _changes(figure.add_subplot(bottom[0, 0]), found)
        _costs(figure.add_subplot(bottom[0, 1]), figure.add_subplot(bottom[0, 2]), found)
        figure.text(0.5, 1, "Effects taken out one at a time", ha="center", va="top", fontsize=10)
        figure.text(0.5, 1, f"scene {name}; changes at the end of the run, costs of the whole run", ha="center",
                    va="top", fontsize=8, color="0.35")
        if touching:
            handles, names = figure.axes[0].get_legend_handles_labels()
            figure.legend(handles, names, loc="upper center", ncols=min(4, len(names)), frameon=False, borderpad=0,
                          borderaxespad=0, columnspacing=1.2, handlelength=2.4)
        place_header(figure)
        _legends_below(figure, bottom=0.62 * INCH / figure.get_figheight())
        return write(figure, folder, name)


def _style(variant: Variant, found: list[Variant]) -> dict:
    k = found.index(variant)
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": DASHES[k % len(DASHES)], "lw": 1.8 if k == 0 else 1.2}


def _tractions(axes, touching: list[Variant], found: list[Variant]) -> None:
    """Normal and tangential tractions along the contact boundary that carries most, at the end of the run."""
    import numpy as np

    from ..figures import contact_boundaries, scale_for

    full, units = touching[0].contact, touching[0].units
    load = {b: float(np.abs(rows["sigma_n"] * rows["weight"]).sum()) for b, rows in contact_boundaries(full)}
    most = max(load, key=load.get)
    shown = [(variant, dict(contact_boundaries(variant.contact))[most]) for variant in touching]
    along = scale_for(units["length"], full["arc"])
    for panel, column, symbol in zip(axes, ("sigma_n", "sigma_t"), (r"\sigma_n", r"\sigma_t")):
        values, weight = (np.concatenate([rows[name] for _, rows in shown]) for name in (column, "weight"))
        stress = scale_for(units["stress"], _spread(np.abs(values), weight, 0.95)[1])
        low, high = np.multiply(_spread(values, weight, 0.97), stress.factor)
        for variant, rows in shown:
            panel.plot(rows["arc"] * along.factor, rows[column] * stress.factor, label=label(variant),
                       **_style(variant, found))
        panel.axhline(0, color="0.6", lw=0.5, zorder=0)
        room = 0.08 * max(high - low, 1e-300)
        panel.set(xlabel=f"arc length [{along.label}]", ylabel=rf"${symbol}$ [{stress.label}]",
                  ylim=(low - room, high + room)
                  if high > low else None)
        panel.margins(x=0)
        title = "normal traction" if column == "sigma_n" else "tangential traction"
        panel.set_title(title + (f", boundary {most}" if len(load) > 1 else ""))


def _spread(values, weight, share: float) -> tuple[float, float]:
    """Range, 0 included, of all values, or where a singular edge would flatten all curves that of `share` of the length."""
    import numpy as np

    whole = min(values.min(), 0.0), max(values.max(), 0.0)
    order = np.argsort(values)
    along = np.cumsum(weight[order]) / weight.sum()
    low, high = values[order][np.minimum(np.searchsorted(along, [1 - share, share]), len(values) - 1)]
    low, high = min(low, 0.0), max(high, 0.0)
    return (low, high) if whole[1] - whole[0] > 3 * (high - low) else whole


def _changes(axes, found: list[Variant]) -> None:
    """Matrix of relative changes: a row a variant, a column a quantity."""
    import numpy as np
    from matplotlib.colors import LinearSegmentedColormap

    colours = LinearSegmentedColormap.from_list("change", ["#5B9BD0", "#FFFFFF", "#E58A4E"])
    others = found[1:]
    values = np.array([[variant.row.get(f"{name}_change") for name in RESPONSE] for variant in others], dtype=float)
    shade = np.clip(np.nan_to_num(values.reshape(len(others), len(RESPONSE))), -1, 1)
    shade = np.sign(shade) * np.sqrt(np.abs(shade)) * 0.9
    axes.imshow(shade, cmap=colours, vmin=-1, vmax=1, aspect="auto", interpolation="nearest")
    for i, variant in enumerate(others):
        if not variant.row:
            reason = variant.reason if len(variant.reason) < 64 else variant.reason[:61].rsplit(" ", 1)[0] + " …"
            axes.text(len(RESPONSE) / 2 - 0.5, i, f"no solution: {reason}", ha="center", va="center", fontsize=6,
                      color="0.3")
            continue
        for k, name in enumerate(RESPONSE):
            axes.text(k, i, change(variant.row[f"{name}_change"], short=True).replace("-", "\N{MINUS SIGN}"),
                      ha="center", va="center", fontsize=7)
    axes.set_xticks(range(len(RESPONSE)), list(RESPONSE.values()), fontsize=6.5)
    axes.set_yticks(range(len(others)), [label(variant) for variant in others])
    axes.set_xticks(np.arange(-0.5, len(RESPONSE)), minor=True)
    axes.set_yticks(np.arange(-0.5, len(others)), minor=True)
    axes.grid(which="minor", color="white", lw=1.5)
    axes.tick_params(which="both", length=0)
    axes.xaxis.tick_top()
    for side in axes.spines.values():
        side.set_visible(False)


def _costs(products, seconds, found: list[Variant]) -> None:
    """Products with F and seconds by stage; the scene as declared is the vertical line."""
    others, full = found[1:], found[0].row
    for i, variant in enumerate(others):
        if not variant.row:
            continue
        products.barh(i, variant.row["dual_multiplications"], 0.62, color="#888888")
        left = 0.0
        for stage, colour in STAGE_COLOURS.items():
            wide = variant.row[f"seconds_{stage}"]
            seconds.barh(i, wide, 0.62, left, color=colour, label=stage if i == 0 else None)
            left += wide
    for axes, limit, text in ((products, full["dual_multiplications"], "products\nwith $F$"),
                              (seconds, full["seconds_total"], "seconds")):
        axes.axvline(limit, color="#222222", lw=1)
        axes.set(ylim=(len(others) - 0.5, -0.5), yticks=[], title=text, xlim=(0, None))
        axes.title.set_fontsize(7)
        axes.tick_params(axis="x", labelsize=7)
        axes.locator_params(axis="x", nbins=2)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)


def _legends_below(figure, bottom: float) -> None:
    """Key to the bars, at the foot of the figure, from which the axes keep away."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys = [Line2D([], [], color="#222222", lw=1, label="as declared")]
    keys += [Patch(color=colour, label=stage) for stage, colour in STAGE_COLOURS.items()]
    engine = figure.get_layout_engine()
    x, _, width, top = engine.get()["rect"]
    engine.set(rect=(x, bottom, width, top - bottom))
    figure.legend(handles=keys, loc="lower right", ncols=len(keys), frameon=False, fontsize=7, handlelength=1,
                  columnspacing=1, handletextpad=0.4, borderaxespad=0.2)
