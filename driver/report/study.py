"""The page of a study: what its tables come to, its pictures, the tables themselves."""

import json
from pathlib import Path

from ..errors import InputError
from ..files import is_study, is_summary, read_rows
from ..results.screen import UNCHECKED
from ..units import spelt
from . import page
from . import run as single

# what a study is, by the tables that it leaves or by the first column of one, and what its figures
# show
STUDIES = {"accuracy.csv": "What accuracy costs", "stopping.csv": "Tolerances of the solver",
           "coverage.csv": "Errors claimed and errors made", "prices.csv": "Prices of accuracy",
           "requests.csv": "Accuracies asked for",
           "handpicked.csv": "Accuracies asked for, and settings by hand",
           "locking.csv": "Nearly incompressible material",
           "table.csv": "The slides' table", "without": "What each effect changes and costs",
           "family": "Hard cases", "case": "Published cases and closed forms", "part": "Benchmark"}
CAPTIONS = {
    "report": "Every case with its residuals, its error and its work",
    "study": "Forces, pressure, states of the contact nodes and dissipated energy",
    "work_precision": "Errors of all runs over seconds of the solver; the Pareto front below",
    "products": "Products with F beside a tenth of the slides', and without an ingredient",
    "table": "Products with F, the dual operator, in 20 steps, beside the slides'",
    "random": "What became of scenes drawn at random", "sweeps": "Products from easy to hard"}
DEFAULTS = ("effects", "hard", "verify", "bench", "accuracy", "table")  # directories
# what the columns of a table are that stands in the page as it is read
READ = {"table.csv": "n_s, n_p, n_d: subdomains, primal and dual dofs; it: fixed-point iterations; "
                     "n_m: products with F; both in 20 steps, ours / the slides'."}
THEIRS = "slides_"  # of a column beside which one without stands
SHOWN = 200  # rows of a table; the file has all
OPEN = 12  # rows of a table that is not folded
# column, its words that are as they should be with what they mean, and its bad words
JUDGED = (("met", {"yes": "met"}, {"no"}), ("converged", {"yes": "converged"}, {"no"}),
          ("status", {"solved": "solved", "refused": "refused as it should be"}, {"FAILED"}),
          ("status", {"0": "converged", "2": "refused", "3": "without a solution"}, {"4"}))


def write(directory: Path) -> Path:
    """Write the page of all that lies in `directory`, a run or a study; returns its path.

    Raises InputError if there is neither.
    """
    directory = Path(directory)
    summary = directory / "summary.json"
    is_run = is_summary(summary)
    if is_run and "study" not in json.loads(summary.read_text()):
        return single.write(directory)
    tables = {path: read_rows(path) for path in sorted(directory.glob("*.csv"))}
    # pictures of studies have panels side by side: all but narrow ones are scrolled
    pictures = [*single.pictures(directory, CAPTIONS, 0),
                *single.pictures(directory / "figures", CAPTIONS, 0)]
    # a table or a picture alone may be anybody's
    if not (is_run or is_study(directory)) or not tables and not pictures:
        raise InputError(f"{directory} holds no finished run and no study to report on: name the "
                         "directory that make run or a study wrote")
    title = _title(directory, tables, summary if is_run else None)
    judgements = [_judgement(table, rows) for table, rows in tables.items()]
    tables = dict(sorted(tables.items(), key=lambda table: not _judgement(*table)))
    return page.write(directory, title, [
        *judgements, _unchecked() if is_run else "", _units(summary),
        page.section("Warnings", _warnings(summary)),
        page.section("Figures", *pictures),
        page.section("Tables", *(_table(table, rows) for table, rows in tables.items()))])


def _unchecked() -> str:
    """What values of a parameter are not examined for, beside the verdict that they converged."""
    return page.paragraph(f"{UNCHECKED[0].upper()}{UNCHECKED[1:]}.")


def _title(directory: Path, tables: dict[Path, list[dict]], summary: Path | None) -> str:
    """What a study is, by its summary or its tables, and the name of its directory."""
    if summary is not None:
        entries = json.loads(summary.read_text())
        return f"{entries['scene']}: study of {entries['study']}"
    title = directory.resolve().name
    found = {path.name for path in tables} | {next(iter(rows[0]), "") for rows in tables.values()
                                              if rows}
    if kind := next((words for name, words in STUDIES.items() if name in found), ""):
        title = kind if title in DEFAULTS else f"{kind}: {title}"
    return title


def _judgement(path: Path, rows: list[dict]) -> str:
    """How many rows of a table are as they should be; nothing for tables that judge nothing."""
    for column, good, bad in JUDGED:
        texts = [row[column] for row in rows if row.get(column)]
        if not texts or not set(texts) <= {*good, *bad}:
            continue
        counts = [f"{texts.count(word)} {meaning}" for word, meaning in good.items()
                  if word in texts]
        failed = sum(text in bad for text in texts)
        counts += [f"{failed} not"] if failed else []
        said = f"of {len(texts)} rows {', '.join(counts)}"
        if len(counts) == 1 and not failed:
            said = f"all {counts[0]}"
        verdict = page.verdict(f"{path.stem}: {said}.", "bad" if failed else "good")
        return verdict + _rows([row for row in rows if row.get(column) in bad])
    return ""


def _rows(rows: list[dict]) -> str:
    """Rows of a study in a table, columns that are empty in all of them left out."""
    head = [name for name in (rows[0] if rows else ()) if any(row[name] for row in rows)]
    return page.table(head, [[_number(row[name]) for name in head] for row in rows[:SHOWN]])


def _units(summary: Path) -> str:
    """Units of the tables of a study of a parameter, whose columns have none in their names; empty
    where the scene has none.
    """
    if not summary.is_file():
        return ""
    units = json.loads(summary.read_text())["units"]
    powers = {"Lengths": (0, 1), "stresses": (1, 0), "forces": (1, 1), "energies": (1, 2)}
    named = {name: spelt(*power, units) for name, power in powers.items()}
    if set(named.values()) == {"1"}:
        return ""
    return page.paragraph(", ".join(f"{name} in {unit}" for name, unit in named.items()) + ".")


def _warnings(summary: Path) -> str:
    if not summary.is_file():
        return ""
    return page.bullets(json.loads(summary.read_text()).get("warnings", []))


def _table(path: Path, rows: list[dict]) -> str:
    """A table of a study, folded unless it is a short one that judges."""
    more = page.paragraph(f"{len(rows) - SHOWN} more rows in {path.name}") \
        if len(rows) > SHOWN else ""
    title = f"{path.name}, {len(rows)} row{'s' if len(rows) > 1 else ''}"
    if path.name in READ:
        return (page.paragraph(READ[path.name]) + _beside(rows)
                + page.folded(title, _rows(rows) + more))
    if len(rows) <= OPEN and _judgement(path, rows):
        return page.paragraph(title) + _rows(rows)
    return page.folded(title, _rows(rows) + more)


def _beside(rows: list[dict]) -> str:
    """The columns of which there are ours and theirs, as "ours / theirs" where they differ."""
    head = [name for name in (rows[0] if rows else ()) if THEIRS + name in rows[0]]
    cells = [[ours if ours == theirs else f"{ours} / {theirs}" for ours, theirs in
              ((row[name], row[THEIRS + name]) for name in head)] for row in rows]
    return page.table(["method", *head],
                      [[row["method"], *cell] for row, cell in zip(rows, cells)])


def _number(text: str):
    """A number where the text is one."""
    for kind in (int, float):
        try:
            return kind(text)
        except (TypeError, ValueError):
            continue
    return text or ""
