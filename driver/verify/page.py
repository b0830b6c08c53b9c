"""edp/verify/README.md: all cases with pictures, numbers and errors, for a sceptic to read."""

from pathlib import Path

from PIL import Image

from ..environment import ROOT
from ..files import renamed
from ..text import assignments, percent, words
from .case import Case

FOLDER = ROOT / "edp" / "verify"
PICTURES = ROOT / "results" / "reference" / "verify"
WIDTH = 560  # pixels
HEAD = """# Verified by others' cases

Published numbers of other codes and closed forms, solved by `make verify` (`CASE=` chooses) with
linear and quadratic elements on meshes whose elements are halved in turn. This page is made by
`make verify PAGE=yes`. *Error* is that of the finest mesh, relative to the reference (absolute
where the reference is zero); *refined* shows it on the meshes before, coarse to fine; *claimed* is
what the run itself says that its error is.

Formulas of half-planes and half-spaces are not those of the bodies computed. What the *size* of the
body adds is computed: runs with larger contact and meshes alike against it, listed under the table,
give the power k of contact over body that deviations follow, and so what is there on the body at
hand. *Remaining* is the error without it (of distances of curves the root of the difference of the
squares), which the tolerance is for. In the pictures points are the reference, lines are ours;
those of single numbers show relative errors, in black what is allowed.
"""


def write(cases: list[Case], rows: list[dict], orders: list[dict], pictures: list[Path]) -> Path:
    """Write the page of `rows` of all `cases`, of `orders`, and pictures; returns its path."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    drawn = {path.stem: _small(path) for path in pictures if path.suffix == ".png"}
    parts = [HEAD, _contents(cases, rows)]
    for case in cases:
        own = [row for row in rows if row["case"] == case.name]
        parts.append(_section(case, own, drawn.get(case.name)))
    parts.append(_orders(orders))
    path = FOLDER / "README.md"
    with renamed(path) as hidden:
        hidden.write_text("\n".join(parts), encoding="utf-8")
    return path


def _small(path: Path) -> Path:
    """A small copy of a picture beside the references."""
    target = PICTURES / path.name
    with Image.open(path) as picture:
        size = WIDTH, round(picture.height * WIDTH / picture.width)
        small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        with renamed(target) as hidden:
            small.quantize(64).save(hidden, format="PNG", optimize=True)
    return target


def _contents(cases: list[Case], rows: list[dict]) -> str:
    met = sum(row["met"] == "yes" for row in rows)
    links = " · ".join(f"[{case.name}](#{case.name})" for case in cases)
    return (f"{len(cases)} cases, {len(rows)} numbers, {met} of them within their tolerances.\n\n"
            f"{links} · [orders with friction](#orders-with-friction)\n")


def _orders(rows: list[dict]) -> str:
    """The table of orders with friction."""
    if not rows:
        return ""
    lines = ["## Orders with friction", "",
             "`zones` is a manufactured problem with stick, slip and separation; *two cylinders* "
             "are those of `cattaneo-mindlin`, whose formula is that of half-planes, so errors "
             "stay at the order of a/R, and for time steps the run with 96 stands for the limit. "
             "Between two turns of the load slip zones only grow and slip keeps its direction, so "
             "that a single step ends in the same state: orders in the time step say little here. "
             "On the *rough sphere* of `spence-0.2` contact grows, and one step is far off. "
             "Adaptive meshes follow the energy of the whole body, and tractions on the contact "
             "boundary where they bend: with a solution as smooth as that of `zones` they gain "
             "little; those of the cylinders begin with a mesh that is even along the contact "
             "(`cattaneo-mindlin-adaptive`), the others with one that the scene makes finer where "
             "contact and sticking should end.", "",
             "| problem | element | quantity | by | with | errors | order |",
             "| --- | --- | --- | --- | --- | --- | --- |"]
    for row in rows:
        fitted = f"{row['order']:.1f}" if row["order"] != "" else "none"
        lines.append(f"| {row['problem']} | {row['element']} | {row['quantity']} | "
                     f"{row['varied']} | {row['values']} | {row['errors']} | {fitted} |")
    return "\n".join([*lines, ""])


def _section(case: Case, rows: list[dict], picture: Path | None) -> str:
    scene = case.scene.removeprefix("verify/")
    link = f"{scene}.edp" if case.scene != scene else f"../{scene}.edp"
    settings = assignments(case.settings)
    lines = [f"## {case.name}", "",
             f"{case.title}. Scene [{scene}.edp]({link}){f' with `{settings}`' if settings else ''}"
             f"; reference: {case.source}.", ""]
    if case.others:
        lines += [f"{case.others}.", ""]
    if case.note:
        lines += [case.note, ""]
    if picture:
        lines += [f'<img src="../../results/reference/verify/{picture.name}" width="420" '
                  f'alt="{case.name}">', ""]
    sized = any("size_effect" in row for row in rows)
    names = ["quantity", "element", "ours", "reference", "error", "refined", "claimed",
             *(("size", "remaining") if sized else ()), "tolerance", "because"]
    lines += _head(names) + [_line([*_numbers(row, sized), f"{row['tolerance']:.1e}",
                                    row["because"]]) for row in rows]
    return "\n".join([*lines, "", *(_sizes(case, rows) if sized else ())])


def _head(names: list[str]) -> list[str]:
    return [_line(names), _line(["---"] * len(names))]


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _numbers(row: dict, sized: bool) -> list[str]:
    """Cells of a row up to its tolerance."""
    claimed = "" if row["claimed"] == "" else percent(row["claimed"])
    met = "" if row["met"] == "yes" else " **missed**"
    cells = [words(row["quantity"]), row["element"], f"{row['value']:.6g}",
             f"{row['reference']:.6g}", f"{row['error']:.1e}{met}", row["errors"], claimed]
    if not sized:
        return cells
    if "size_effect" not in row:
        return [*cells, "", ""]
    return [*cells, f"{row['size_effect']:+.1e}", f"{row['remaining']:.1e}"]


def _sizes(case: Case, rows: list[dict]) -> list[str]:
    """The runs that show what the size of the body adds."""
    own = {row["quantity"]: row for row in rows if "size_effect" in row}
    some = next(iter(own.values()))
    ratios = [f"{case.sizes.words} = {ratio}" for ratio in some["size_ratios"].split()]
    lines = [_line([words(name), *row["size_deviations"].split(), str(row["size_order"]),
                    f"{row['ratio']:.2g}"]) for name, row in own.items()]
    return _head(["deviation on bodies with", *ratios, "k", f"{case.sizes.words} of the case"]) + [
        *lines, ""]
