"""Text for people: aligned columns, relative numbers, names."""

import math
import os
from pathlib import Path


def aligned(rows: list[list], sides: str = "") -> str:
    """The cells of `rows`, all of one length, as text in columns.

    `sides` has a letter a column, l flush left, r right; by default l for the first, r for others.
    """
    texts = [[str(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*texts)]
    sides = sides or "l" + "r" * len(widths)
    lines = ("  ".join(cell.rjust(width) if side == "r" else cell.ljust(width)
                       for cell, width, side in zip(row, widths, sides)) for row in texts)
    return "\n".join(line.rstrip() for line in lines)


def words(name: str) -> str:
    """A column's name as words."""
    return name.replace("_", " ")


def called(label, name: str | None):
    """A label, or what has it in its own name, with the name that a file gives it, if any."""
    return f"{label} '{name}'" if name else label


def near(name: str, known) -> str:
    """What a misspelt name may mean, as the end of a message; "" if nothing is near.

    Of numbered ones the first, where the name has no number.
    """
    import difflib  # takes longer to import than the check takes

    found = difflib.get_close_matches(name, sorted(known), 1)
    if not found:
        return ""
    meant, digits = found[0], "0123456789"
    if name == name.rstrip(digits):
        stem = meant.rstrip(digits)
        meant = min(word for word in known if word.rstrip(digits) == stem)
    return f"; did you mean {meant}?"


def step_name(index: int) -> str:
    """A time step in a message; before the first one is the preload."""
    return f"step {index}" if index else "preload"


def counted(number: int, name: str) -> str:
    """A number of what has a name, such as 1 step or 20 steps."""
    return f"{number} {name}" if number == 1 else f"{number} {name}s"


def ends(lines) -> str:
    """Lines in one; of more than two the first and the last, and how many there are between."""
    shown_lines = list(lines)
    if len(shown_lines) > 2:
        shown_lines[1:-1] = [f"{len(shown_lines) - 2} more"]
    return "; ".join(shown_lines)


def assignments(settings: dict) -> str:
    """Settings as on the command line: NAME=value NAME=value."""
    return " ".join(f"{name.upper()}={value}" for name, value in settings.items())


def shown(path: Path) -> str:
    """A path as seen from the current directory, absolute where that no longer exists."""
    try:
        return os.path.relpath(path)
    except FileNotFoundError:
        return str(path)


def percent(share: float) -> str:
    """A relative error, such as 0.012, in percent."""
    return f"{100 * share:.2g} %" if abs(share) < 0.995 else f"{100 * share:.0f} %"


def change(value: float | None) -> str:
    """A relative change: a percentage, or a factor where that is large; a dash for none."""
    if value is None or math.isnan(value):
        return "–"
    if abs(value) < 5e-5:
        return "0"
    if value >= 9:
        return f"×{1 + value:.0f}" if value < 9999 else f"×{1 + value:.0e}"
    digits = 0 if abs(value) >= 0.1 else 1 if abs(value) >= 0.01 else 2
    return f"{100 * value:+.{digits}f} %"
