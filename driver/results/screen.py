"""What a finished run prints about contact boundaries and probes, from its summary."""

import re

from ..text import aligned, called
from ..units import generic
from .tables import BOUNDARIES, PROBES

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")
ROUNDING = 1e-13  # of the largest value of the same unit
LONG = 60  # characters; longer lists of steps are left to summary.json
UNCHECKED = ("a study does not estimate errors, nor check that strains, rotations and sliding "
             "distances are small: use make run for values that matter")
HEADS = {"force_x": "force x", "force_y": "force y", "u_x": "u x", "u_y": "u y",
         "normal_resultant": "normal", "tangential_resultant": "tangential",
         "peak_pressure": "peak pressure", "contact_length": "length", "slip": "slip",
         "dissipated_energy": "dissipated"}


def boundaries(rows: list[dict], units: dict[str, str]) -> list[str]:
    """Lines of a table with a contact boundary each, from `boundaries` of summary.json."""
    return _table("boundary", rows, BOUNDARIES, units)


def probes(rows: list[dict], units: dict[str, str]) -> list[str]:
    """Lines of a table with a probe each, from `probes` of summary.json."""
    return _table("probe", rows, PROBES, units)


def materials(bodies: list[dict], units: dict[str, str]) -> list[str]:
    """Lines of a table with the material of each body, from `materials` of summary.json."""
    if not bodies:
        return []
    stress = generic("stress", units)
    table = [["body", "material", f"Young's modulus [{stress}]", "Poisson's ratio"]]
    table += [[str(row["body"]), row["name"], f"{row['young']:.6g}", f"{row['poisson']:.6g}"]
              for row in bodies]
    return aligned(table).splitlines()


def cycles(found: dict | None, units: dict[str, str]) -> list[str]:
    """A line about the cycles of a repeated history, from `cycles` of summary.json."""
    if not found:
        return []
    last, length = found["last"], units["length"]
    count = f"{found['number']} cycle{'s' if found['number'] > 1 else ''}"
    if found["skipped"]:
        count += (f", {found['skipped']} of them jumped over, with an estimated error of "
                  f"{found['error']:.2g} {length}")
    energy = generic("stress length^2", units)
    work = f"friction dissipates {last['dissipated']:.4g} {energy}"
    if found["settled_after"] is None and found["number"] == 1:
        return [f"{count}, no previous cycle to compare with: slip of {last['slip']:.3g} {length}, "
                f"{work}"]
    if found["settled_after"] is None:
        verdict = f"not settled, {last['kind']} so far: "
    else:
        verdict = f"settled from cycle {found['settled_after']} on: {last['kind']}; "
    grows = {"shakedown": "", "alternating slip": f"slip of {last['slip']:.3g} {length} a cycle, ",
             "ratcheting": f"advance of {last['drift']:.3g} {length} a cycle, ",
             "wear": f"{last['wear']:.3g} {length} worn off a cycle, "}[last["kind"]]
    return [f"{count}, {verdict}forces change by {last['change']:.1e} a cycle, {grows}{work}"]


def warnings(sentences: list[str]) -> list[str]:
    """Warnings as lines; those that differ in the number of the step alone are one, counted."""
    steps: dict[str, list[str]] = {}
    for sentence in sentences:
        step = re.match(r"step (\d+): ", sentence)
        steps.setdefault(NUMBER.sub("#", sentence), []).append(step[1] if step else "")
    lines, seen = [], set()
    for sentence in sentences:
        kind = NUMBER.sub("#", sentence)
        if kind in seen:
            continue
        seen.add(kind)
        more = len(steps[kind]) - 1
        again = ""
        if more:
            others = ", ".join(filter(None, steps[kind][1:]))
            shown = f", steps {others}" if others and len(others) < LONG else ""
            again = f" (and {more} more like it{shown})"
        lines.append(f"warning: {sentence}{again}")
    return lines


def _table(first: str, rows: list[dict], columns: tuple, units: dict[str, str]) -> list[str]:
    """A line a row, under a head with units; none without rows."""
    if not rows:
        return []
    unit = {str(column.name): generic(column.unit, units) for column in columns}
    names = [name for name in HEADS if name in unit]
    table = [[first, *(f"{HEADS[name]} [{unit[name]}]".removesuffix(" [1]") for name in names)]]
    rows = without_noise(rows, columns)
    table += [[called(row[first], row.get("name")), *(f"{row[name]:.4g}" for name in names)]
              for row in rows]
    return aligned(table).splitlines()


def without_noise(rows: list[dict], columns) -> list[dict]:
    """The rows with zeros where a value is rounding beside the largest of its unit."""
    cleaned = [dict(row) for row in rows]
    numbers = [column for column in columns if column.unit and all(
        isinstance(row[column.name], float) for row in rows)]
    for unit in {column.unit for column in numbers}:
        names = [column.name for column in numbers if column.unit == unit]
        least = ROUNDING * max((abs(row[name]) for row in rows for name in names), default=0.0)
        for row in cleaned:
            row |= {name: 0.0 for name in names if abs(row[name]) < least}
    return cleaned
