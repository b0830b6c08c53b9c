"""What is said of an error budget: a line or a table for the screen, units and shares."""

import numpy as np

from ..quantity_table import QUANTITIES, SUMMED
from ..units import spelt
from .budget import main_quantity, vanishing

SOURCES = {"mesh": "mesh", "time": "time step", "jumps": "jumps over cycles",
           "friction": "friction's fixed point",
           "solver": "solver's tolerance"}


def advice(quantities: dict, remedies: dict[str, str], doubtful=()) -> str:
    """One sentence: the largest part of the main error and which of `remedies` lowers it; of a
    `doubtful` source, whose error finer runs have not been seen to lower, which may.
    """
    zero = vanishing({name: entry["value"] for name, entry in quantities.items()
                      if "value" in entry})
    name = main_quantity(quantities, zero)
    entry = quantities[name]
    parts = {source: entry[source] for source in SOURCES if source in entry}
    missing = [source for source, error in parts.items() if error is None]
    words = name.replace("_", " ")
    if missing:
        sources = " and ".join(SOURCES[source] for source in missing)
        return f"the error of the {words} from {sources} is not known"
    largest = max(parts, key=parts.get)
    if entry["relative"] is not None and entry["relative"] < 1e-5:
        return f"the {words} needs no finer settings"
    percent = 100 * parts[largest] / entry["total"]
    return (f"{percent:.0f} % of the error of the {words} is due to the {SOURCES[largest]}: "
            f"{remedies[largest]} {'may' if largest in doubtful else 'would'} lower it")


def unit(name: str, units: dict) -> str:
    """Unit of a quantity in the scene's units, as engineers spell it."""
    return spelt(*QUANTITIES[name].unit, units)


def share(error: float | None, value: float) -> str:
    """An error relative to the value, as people read it."""
    if error is None:
        return "?"
    if error == 0:
        return "0"
    if value == 0:
        return f"{error:.0e}"
    percent = 100 * error / abs(value)
    if percent < 0.001:
        return "<0.001 %"
    if percent >= 1000:
        return ">1000 %"  # digits of nothing
    return f"{percent:.{max(0, min(3, 1 - int(np.floor(np.log10(percent)))))}f} %"


def earlier(summary: dict) -> float | None:
    """The time that the quantities of a `summary` belong to, if it is not the end of the history.
    """
    time = summary.get("quantities_time")
    return None if time is None or time >= summary["t_end"] * (1 - 1e-9) else time


def titled(name: str, boundaries: int) -> str:
    """A quantity in a table of a run with so many contact boundaries."""
    title = name.replace("_", " ")
    return f"{title}, sum of {boundaries}" if boundaries > 1 and name in SUMMED else title


def of_sums(names, boundaries: int) -> list[str]:
    """What resultants among the `names` are of several contact boundaries, in a line."""
    if boundaries < 2 or not set(SUMMED) & set(names):
        return []
    both = "both" if boundaries == 2 else "several"
    return [f"sum of {boundaries}: the magnitudes of the contact boundaries; a force that passes "
            f"through {both} of them counts at each (boundaries.csv lists each boundary)"]


def unknown(budget: dict) -> list[str]:
    """Why errors of a `budget` are not known, a line a reason with the quantities that it is of."""
    reasons: dict[str, list[str]] = {}
    for name, entry in budget.items():
        if "note" in entry:
            reasons.setdefault(entry["note"], []).append(name.replace("_", " "))
    return [f"?, {'all of them' if len(names) == len(budget) > 1 else ', '.join(names)}: {reason}"
            for reason, names in reasons.items()]


def describe(errors: dict, units: dict, time: float | None = None,
             boundaries: int = 1) -> list[str]:
    """The budget as lines of a table, then the error in the energy norm.

    `time`: that of the values, if it is not the end of the history. `boundaries`: how many contact
    boundaries there are.
    """
    budget, energy = errors.get("quantities"), describe_energy(errors.get("energy", {}))
    if not budget:
        return energy
    sources = [source for source in SOURCES if any(source in entry for entry in budget.values())]
    heads = {name: f"{titled(name, boundaries)} [{unit(name, units)}]" for name in budget}
    title = "estimated errors" if time is None else f"estimated errors at time {time:.4g}"
    width = max(map(len, (title, *heads.values())))
    lines = [f"{title:{width}s}{'value':>12s}"
             + "".join(f"{s:>11s}" for s in (*sources, "total"))]
    zero = vanishing({name: entry["value"] for name, entry in budget.items()},
                     {name: entry["total"] for name, entry in budget.items()})
    for name, entry in budget.items():
        if name in zero:
            error = "" if entry["total"] is None else f"  within {entry['total']:.2g}"
            lines.append(f"{heads[name]:{width}s}{'about 0':>12s}{error}")
            continue
        cells = [share(entry[s], entry["value"]) if s in entry else "" for s in (*sources, "total")]
        lines.append(f"{heads[name]:{width}s}{entry['value']:12.4g}"
                     + "".join(f"{cell:>11s}" for cell in cells))
    return [*lines, *unknown(budget), *of_sums(budget, boundaries), errors["advice"],
            *errors["notes"], *energy]


def _about(error: float, norm: float) -> str:
    """An estimate relative to the `norm`; of more than all of it no digits are known."""
    return f"about {share(error, norm)}" if error < norm else "more than 100 %"


def describe_energy(entry: dict) -> list[str]:
    """The last step's error in the energy norm as lines, none if it was not estimated."""
    if "reason" in entry:
        return [f"no error in the energy norm: {entry['reason']}"]
    if "total" not in entry:
        return []
    mesh, solver, friction, correction, total = (
        share(entry[name], entry["norm"])
        for name in ("mesh", "solver", "friction", "correction", "total"))
    parts = f"mesh {mesh}, solver {solver}, friction {friction}, correction {correction}"
    bounded = entry["kind"] == "equilibrated"
    lines = [f"error of the last step in the energy norm: {'at most' if bounded else 'about'} "
             f"{total} ({parts})" + ("" if bounded else "; from smoothed stresses, not a bound")]
    more = [f"{words} {_about(entry[name], entry['norm'])}" for name, words in (
        ("coupling", "Coulomb's law"), ("time", "time steps")) if entry.get(name)]
    if more:
        lines.append(f"in addition, in the energy norm: {', '.join(more)}")
    if entry.get("excluded"):
        lines.append(f"not included: {', '.join(entry['excluded'])}")
    return lines
