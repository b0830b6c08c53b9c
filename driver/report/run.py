"""The page of a run: verdict, quantities with errors, boundaries, probes, figures, settings."""

import json
from pathlib import Path

from ..estimates import price_words
from ..estimates.budget import vanishing
from ..estimates.budget_words import (SOURCES, describe_energy, earlier, of_sums, share, titled,
                                      unit, unknown)
from ..results import screen
from ..results.tables import BOUNDARIES, PROBES
from ..text import called
from ..units import assumed, generic
from . import page

CAPTIONS = {
    "geometry": "Geometry, boundary conditions, loads and subdomains",
    "deformed": "Deformed body", "animation": "Deformation and contact status over time",
    "contact_zoom": "Deformed body at the contact",
    "contact_normal": "Normal traction and displacement on the contact boundary",
    "contact_tangential": "Shear traction, friction bound and displacement",
    "contact_status": "Contact status over time", "force_displacement": "Force and displacement",
    "cycles": "Hysteresis, and what cycles have in common",
    "loading": "History of loading", "history": "Contact forces over time",
    "convergence": "Convergence of the solver", "adaptivity": "Adaptive refinement",
}
SETTINGS = ("subdomains", "primal_dofs", "dual_dofs", "contact_nodes")
HEADS = {"total": "estimated error", "mesh": "of it mesh", "time": "time step", "jumps": "jumps",
         "friction": "fixed point", "solver": "solver"}
KINDS = {"ok": "good", "questionable": "doubtful", "invalid": "bad"}  # of validity's verdict


def write(directory: Path) -> Path:
    """Write the page of the run in `directory` and return its path.

    Raises OSError, and InputError where a report.html is there that is no page of a run.
    """
    summary = json.loads((directory / "summary.json").read_text())
    title = " ".join(filter(None, (summary["scene"], summary["variant"])))
    return page.write(directory, title, [
        *_verdict(summary), page.section("Quantities", *_quantities(summary)),
        page.section("The price of the next digit",
                     *_prices(summary.get("errors", {}).get("prices"))),
        page.section("Contact boundaries, last step",
                     _rows(summary, "boundaries", "boundary", BOUNDARIES)),
        page.section("Probes, last step", _rows(summary, "probes", "probe", PROBES)),
        page.section("Cycles", *map(page.paragraph, screen.cycles(
            summary.get("cycles"), summary["units"]))),
        page.section("Warnings", page.bullets(summary["warnings"])),
        page.section("Figures", *pictures(directory / "figures")),
        page.section("The run", *_settings(summary))])


def _verdict(summary: dict) -> list[str]:
    """Whether the results may be used, and the validity and uniqueness behind it."""
    if not summary["converged"]:
        return [page.verdict(f"Not converged: {summary['reason']}", "bad")]
    validity, worst = summary.get("validity", {}), max(summary["residuals"].values(), default=0)
    words = f"Converged in {summary['steps']} step{'s' if summary['steps'] > 1 else ''}"
    words += f", largest relative residual {worst:.1e}, balance of forces {summary['balance']:.1e}"
    count = len(summary["warnings"])
    if count:
        words += f"; {count} warning{'s' if count > 1 else ''}, see below"
    kind = "doubtful" if count else "good"
    if validity:
        kind = max(kind, KINDS.get(validity["verdict"], "doubtful"),
                   key=list(page.COLOURS).index)
        reason = validity.get("reason", "")
        words += f". Small strains and linearized contact: {validity['verdict']}"
        words += f", {reason}" if reason else ""
    parts = [page.verdict(f"{words}.", kind)]
    parts += [page.paragraph(f"{line}.") for line in assumed(summary["units"])]
    if summary["uniqueness"].get("verdict", "not examined") != "not examined":
        parts.append(page.paragraph(f"Uniqueness: {summary['uniqueness']['verdict']}."))
    return parts


def _quantities(summary: dict) -> list[str]:
    """Table of the quantities of interest with the parts of their errors, and the energy norm."""
    errors, units = summary.get("errors", {}), summary["units"]
    entries = errors.get("quantities") or {name: {"value": value} for name, value
                                           in summary.get("quantities", {}).items()}
    sources = [s for s in ("total", *SOURCES) if any(s in e for e in entries.values())]
    zero = vanishing({name: entry["value"] for name, entry in entries.items()})
    rows, boundaries = [], len(summary.get("boundaries", []))
    for name, entry in entries.items():
        shares = [share(entry[s], entry["value"]) if s in entry else "" for s in sources]
        if name in zero:
            shares = ["about 0", *[""] * (len(sources) - 1)][: len(sources)]
        rows.append([titled(name, boundaries), entry["value"], unit(name, units), *shares])
    time = earlier(summary)
    when = "" if time is None else (
        f"At t = {time:g}, where they are largest: by the end contact is lost.")
    notes = [*unknown(entries), *of_sums(entries, boundaries), *errors.get("notes", [])]
    return [page.paragraph(when),
            page.table(["quantity", "value", "unit", *map(HEADS.get, sources)], rows),
            page.bullets(notes),
            page.paragraph(errors.get("advice", "")),
            *map(page.paragraph, describe_energy(errors.get("energy", {})))]


def _prices(found: dict | None) -> list[str]:
    """What the digits of a quantity would take; where there is no such list, why."""
    lines = price_words.describe(found)
    if not found or not found["lines"]:
        return list(map(page.paragraph, lines))
    head, *rows = price_words.table(found)
    return [page.paragraph(f"{lines[0].capitalize()}."), page.table(head, rows)]


def _rows(summary: dict, key: str, first: str, columns: tuple) -> str:
    """Table of entries of the summary that are rows of a table of `columns`."""
    shown = [column for column in columns if column.name not in ("step", "time")]
    unit = {column.name: generic(column.unit, summary["units"]) for column in shown}
    head = [f"{c.name.replace('_', ' ')} [{unit[c.name]}]".removesuffix(" []").removesuffix(" [1]")
            for c in shown]
    head[0] = first
    rows = screen.without_noise(summary.get(key, []), shown)
    return page.table(head, [[called(row[shown[0].name], row.get("name")),
                              *(row[c.name] for c in shown[1:])] for row in rows])


def pictures(folder: Path, captions: dict[str, str] | None = None,
             wide: float = page.WIDE) -> list[str]:
    """All PNG files and animations of a folder in the order of the `captions`, by file name.

    `captions` by default those of a run, `wide` as of page.picture.
    """
    captions = CAPTIONS if captions is None else captions
    order = list(captions)
    paths = sorted([*folder.glob("*.png"), *folder.glob("*.gif")], key=lambda path: (
        order.index(path.stem) if path.stem in order else len(order), path.stem))
    return [page.picture(path, _caption(path.stem, captions), wide) for path in paths]


def _caption(name: str, captions: dict[str, str]) -> str:
    """What a picture shows: its own caption, that of the pictures of its kind, or its name."""
    kind = max((known for known in captions if name.startswith(f"{known}_")), default="", key=len)
    if name not in captions and kind:
        return f"{captions[kind]}: {name.removeprefix(f'{kind}_').replace('_', ' ')}"
    return captions.get(name, name.replace("_", " "))


def _settings(summary: dict) -> list[str]:
    """Parameters, effects, sizes, times and versions."""
    seconds = {f"{name.replace('_', ' ')}": value for name, value in summary["seconds"].items()}
    effects = [[name.replace("_", " "), page.plain(value)]
               for name, value in summary["effects"].items()]
    sizes = [[name.replace("_", " "), summary["sizes"][name]] for name in SETTINGS]
    counts = [[name.replace("_", " "), value] for name, value in summary["counts"].items()]
    ledger = [[name.replace("_", " "), entry["reason"]]
              for name, entry in summary["effects_ledger"].items() if entry["declared"]]
    return [
        page.table(["effect", ""], effects), page.folded("What they did", page.table(
            ["effect", "in this run"], ledger)),
        page.folded("Parameters and options", page.table(
            ["name", "value"], [[name, page.plain(value)]
                                for name, value in summary["parameters"].items()])),
        page.folded("Sizes and work", page.table(["", ""], [
            *sizes, *counts, ["ranks", summary["ranks"]],
            ["memory [MiB]", summary["memory_mib"]]])),
        page.folded("Residuals", page.table(["condition", "relative"], [
            [name, value] for name, value in summary["residuals"].items()])),
        page.folded("Seconds", page.table(["stage", "s"], list(map(list, seconds.items())))),
        page.paragraph("Versions: " + ", ".join(f"{name} {version}" for name, version
                                                in summary["versions"].items()))]
