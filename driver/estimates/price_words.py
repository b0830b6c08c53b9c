"""What is said of the prices of accuracy: a table for the screen."""

from ..text import aligned, assignments, words
from .budget_words import share
from .prices import MOST


def seconds(value: float) -> str:
    """Seconds, minutes or hours, two digits."""
    unit, size = next(((unit, size) for unit, size in (("s", 1.0), ("min", 60.0))
                       if value < 99.5 * size), ("h", 3600.0))
    number = value / size
    return f"{number:.0f} {unit}" if number >= 9.95 else f"{number:.2g} {unit}"


def table(prices: dict) -> list[list[str]]:
    """Head and rows of the list: accuracy, settings, seconds, memory, other kinds of meshes.

    Of accuracies that take the same the finest has a row, of those that nothing reaches the first.
    """
    rows = [["to", "settings", "takes", "without estimates", "memory", "instead"]]
    for entry in prices["lines"]:
        asked = f"{100 * entry['accuracy']:g} %"
        if "settings" not in entry:
            said = f"more than {MOST / 1e6:g} million unknowns"
            if entry["accuracy"] <= prices.get("least", 0.0):
                said = "no mesh gives it: other displacements may exceed that of the support"
            row = [asked, said, "", "", "", ""]
            rows += [row] if rows[-1][1:] != row[1:] else []
            continue
        others = [f"{assignments(offer['settings'])}: {seconds(offer['seconds'])}"
                  for name, offer in entry["compared"].items() if name != entry["kind"]]
        row = [asked, assignments(entry["settings"]), seconds(entry["seconds"]),
               seconds(entry["seconds_bare"]), f"{entry['memory_mib']:.0f} MiB", "; ".join(others)]
        if rows[-1][1:] == row[1:]:
            rows.pop()
        rows.append(row)
    return rows


def describe(prices: dict | None) -> list[str]:
    """What the list is about and its table, as lines; where there is none, why."""
    if not prices:
        return []
    if prices.get("reason"):
        return [f"no prices of accuracy: {prices['reason']}"]
    return [title(prices), *aligned(table(prices), "rlrrrl").splitlines()]


def title(prices: dict) -> str:
    """What a list with lines is about."""
    now = share(prices["error"], prices["value"])
    return f"predicted cost of the {words(prices['quantity'])} (present error: {now})"
