"""Tables and JSON as files that appear whole, written under a hidden name; reading files."""

import csv
import io
import itertools
import json
import zlib
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError

FIGURES = ("geometry", "loading", "deformed", "contact_zoom", "contact_normal",
           "contact_tangential", "contact_status", "force_displacement", "cycles", "history",
           "convergence",
           "adaptivity")  # of a run
STUDY = ".study"  # file in the directory of a study: its name


@contextmanager
def renamed(path: Path):
    """A hidden path to write to, renamed to `path` after a block without errors."""
    hidden = path.with_name(f".{path.name}")
    yield hidden
    hidden.replace(path)


def write_json(path: Path, value: dict) -> None:
    """`value` as JSON."""
    with renamed(path) as hidden:
        hidden.write_text(json.dumps(value, indent=1) + "\n")


def write_rows(path: Path, header: list, rows) -> Path:
    """A CSV file of `header` and `rows`, sequences of values in its order; returns `path`."""
    with renamed(path) as hidden, open(hidden, "w", newline="") as file:
        out = csv.writer(file)
        out.writerow(header)
        out.writerows(rows)
    return path


def write_table(path: Path, rows: list[dict], columns=None) -> Path:
    """A CSV file of `rows` with `columns`, by default those of the first row; returns `path`.

    Values that a row lacks stay empty. Raises ValueError for a row with other columns.
    """
    with renamed(path) as hidden, open(hidden, "w", newline="") as file:
        out = csv.DictWriter(file, columns or list(rows[0]))
        out.writeheader()
        out.writerows(rows)
    return path


def is_summary(path: Path) -> bool:
    """Whether a file is the summary of a run or of a parameter study."""
    try:
        summary = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(summary, dict) and {"scene", "units", "seconds"} <= summary.keys()


def is_study(directory: Path) -> bool:
    """Whether a directory bears the mark of a study, which is no link."""
    mark = Path(directory) / STUDY
    return mark.is_file() and not mark.is_symlink()


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, each a dict of texts by column. Raises OSError."""
    with open(path, newline="") as file:
        names, *rows = list(csv.reader(file)) or [[]]
    # as csv.DictReader, which takes three times as long
    return [dict(itertools.zip_longest(names, row)) for row in rows if row]


def read_table(path: Path) -> dict | None:
    """Columns of a CSV file as arrays (rows,); None if the file is absent or has no rows.

    A column is of numbers, empty ones being NaN, if all its entries are; else of texts. Raises
    InputError where the file has been cut off.
    """
    import numpy as np  # here: most of what imports this module reads no tables

    if not path.exists():
        return None
    text = path.read_bytes().decode()
    names, *rows = [row for row in csv.reader(io.StringIO(text, newline="")) if row] or [[]]
    if not text.endswith("\n") or any(len(row) != len(names) for row in rows):
        raise damaged(path, "it is cut off")
    columns = {}
    for name, texts in zip(names, zip(*rows)):
        try:
            columns[name] = np.array([text or "nan" for text in texts], dtype=float)
        except ValueError:
            columns[name] = np.array(texts)
    return columns or None


def damaged(path: Path, reason) -> InputError:
    """The error of a file of a finished run that is not as the run has left it."""
    return InputError(f"{path} is damaged ({reason}): run the scene again")


@contextmanager
def whole(path: Path, *errors):
    """A block that reads a file of fields, which may have been deleted or cut off.

    `errors`: exceptions besides Python's own that its reader raises.
    """
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{path} is missing: run the scene again") from None
    except (OSError, SyntaxError, zlib.error, ValueError, LookupError, TypeError, AttributeError,
            AssertionError, *errors) as problem:  # errors of XML are of syntax
        raise damaged(path, str(problem) or "it is cut off") from None


def read_fields(path: Path):
    """The meshio.Mesh of a VTU file, or of all pieces that a PVTU file names, in their order.

    Raises InputError where one has been deleted or cut off.
    """
    from xml.etree import ElementTree

    import meshio
    import numpy as np

    # not meshio.read, which prints what is wrong with a file and ends the program
    if path.suffix != ".pvtu":
        with whole(path, meshio.ReadError):
            return meshio.vtu.read(path)
    pieces = []
    with whole(path):
        names = [piece.get("Source") for piece in ElementTree.parse(path).iter("Piece")]
    for name in names:
        with whole(path.parent / name, meshio.ReadError):
            pieces.append(meshio.vtu.read(path.parent / name))
    start = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    kind = pieces[0].cells[0].type
    cells = np.concatenate([piece.cells[0].data + first for piece, first in zip(pieces, start)])
    points, data = ({name: np.concatenate([of(piece)[name] for piece in pieces])
                     for name in of(pieces[0])}
                    for of in (lambda piece: piece.point_data,
                               lambda piece: {name: values for name, (values,)
                                              in piece.cell_data.items()}))
    return meshio.Mesh(np.concatenate([piece.points for piece in pieces]), [(kind, cells)],
                       point_data=points, cell_data={name: [of] for name, of in data.items()})
