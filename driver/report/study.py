"""The page of a study: what its tables come to, its pictures, the tables themselves."""

import json
from pathlib import Path

from ..errors import InputError
from ..files import read_rows, renamed
from . import page
from . import run as single

SHOWN = 200  # rows of a table; the file has all
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
    if summary.is_file() and "study" not in json.loads(summary.read_text()):
        return single.write(directory)
    tables = {path: read_rows(path) for path in sorted(directory.glob("*.csv"))}
    pictures = [*single.pictures(directory), *single.pictures(directory / "figures")]
    if not tables and not pictures:
        raise InputError(f"{directory} holds no finished run and no study to report on")
    path = directory / page.FILE
    title = directory.resolve().name
    if summary.is_file():
        entries = json.loads(summary.read_text())
        title = f"{entries['scene']}: study of {entries['study']}"
    with renamed(path) as hidden:
        hidden.write_text(page.page(title, [
            *(_judgement(table, rows) for table, rows in tables.items()),
            page.section("Warnings", _warnings(summary)),
            page.section("Figures", *pictures),
            page.section("Tables", *(_table(table, rows) for table, rows in tables.items()))]),
            encoding="utf-8")
    return path


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
        return page.verdict(f"{path.stem}: {said}.", "bad" if failed else "good")
    return ""


def _warnings(summary: Path) -> str:
    if not summary.is_file():
        return ""
    return page.bullets(json.loads(summary.read_text()).get("warnings", []))


def _table(path: Path, rows: list[dict]) -> str:
    """A table of a study, folded."""
    head = list(rows[0]) if rows else []
    shown = [[_number(row[name]) for name in head] for row in rows[:SHOWN]]
    more = page.paragraph(f"{len(rows) - SHOWN} more rows in {path.name}") \
        if len(rows) > SHOWN else ""
    return page.folded(f"{path.name}, {len(rows)} rows", page.table(head, shown) + more)


def _number(text: str):
    """A number where the text is one."""
    for kind in (int, float):
        try:
            return kind(text)
        except (TypeError, ValueError):
            continue
    return text or ""
