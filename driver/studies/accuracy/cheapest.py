"""What each accuracy takes: trusted errors, the Pareto front, the cheapest settings, tables."""

import math
import statistics

from ...estimates.budget_words import unit
from ...text import aligned, percent, words
from .reference import Reference
from .trial import Trial

LEVELS = (0.1, 0.05, 0.02, 0.01, 0.001)
WORTH = 0.9  # a trial of the front has at most so much of the error of the one before
RUN_COLUMNS = ("sweep", "value", "setting", "primal_dofs", "dual_dofs", "dual_multiplications",
               "reason",
               "energy_estimate", "seconds_solver", "seconds_solver_least", "seconds_solver_most",
               "seconds_export", "seconds_export_least", "seconds_export_most", "repeats")
CHEAPEST_COLUMNS = ("quantity", "accuracy", "seconds_solver", "seconds_export", "error", "setting")


def trusted(trials: list[Trial], reference: Reference, name: str) -> dict[int, float]:
    """By id of every trial with a result the error it can be trusted with.

    That is the largest of its own and all tighter ones': errors of mesh and time may cancel at one
    setting by accident; they do not at all that are tighter. The error is never below that of the
    reference, where runs cannot be distinguished.
    """
    done = [t for t in trials if t.values]
    error = {id(t): reference.relative(t.values[name] - reference.value) for t in done}
    return {id(t): max(reference.uncertainty,
                       *(error[id(u)] for u in done if u.tighter(t))) for t in done}


def front(trials: list[Trial], error: dict[int, float]) -> list[Trial]:
    """Trials that no other beats in both seconds and `trusted` errors (Pareto), fast ones first."""
    best, chosen = math.inf, []
    for trial in sorted((t for t in trials if t.values), key=lambda t: t.seconds):
        if error[id(trial)] < WORTH * best:
            best = error[id(trial)]
            chosen.append(trial)
    return chosen


def cheapest(trials: list[Trial], error: dict[int, float], level: float) -> Trial | None:
    """The fastest trial whose error, one of `trusted`, is below `level`."""
    return min((t for t in trials if t.values and error[id(t)] <= level), key=lambda t: t.seconds,
               default=None)


def run_rows(trials: list[Trial], known: dict[str, Reference]) -> list[dict]:
    """Rows of accuracy.csv, one a trial.

    `error` is relative to the reference, for `trusted` see there, `own` is the part of the sweep
    alone.
    """
    errors = {name: trusted(trials, reference, name) for name, reference in known.items()}
    fronts = {name: front(trials, errors[name]) for name in known}
    table = []
    for trial in trials:
        row = {"sweep": trial.sweep, "value": trial.value, "setting": trial.label,
               "reason": trial.reason,
               "energy_estimate": trial.energy, "repeats": len(trial.solver), **trial.sizes}
        table.append(row)
        if not trial.values:
            continue
        for stage in ("solver", "export"):
            spent = getattr(trial, stage)
            row |= {f"seconds_{stage}": statistics.median(spent),
                    f"seconds_{stage}_least": min(spent), f"seconds_{stage}_most": max(spent)}
        for name, reference in known.items():
            value, own = trial.values[name], None
            if trial.tight:
                own = reference.relative(value - trial.tight.values[name])
            row |= {name: value, f"{name}_error": reference.relative(value - reference.value),
                    f"{name}_trusted": errors[name][id(trial)], f"{name}_own": own,
                    f"{name}_front": int(trial in fronts[name])}
    return table


def cheapest_rows(trials: list[Trial], known: dict[str, Reference]) -> list[dict]:
    """Rows of cheapest.csv: the fastest setting, if any, for every quantity and level."""
    table = []
    for name, reference in known.items():
        error = trusted(trials, reference, name)
        for level in LEVELS:
            trial = cheapest(trials, error, level)
            table.append({"quantity": name, "accuracy": level})
            if trial:
                table[-1] |= {"seconds_solver": trial.seconds,
                              "seconds_export": statistics.median(trial.export),
                              "error": error[id(trial)], "setting": trial.label}
    return table


def describe(table: list[dict], known: dict[str, Reference], units: dict, main: str) -> str:
    """The rows of cheapest.csv as text: the main quantity in full, of the others the seconds."""
    reference = known[main]
    good = percent(reference.uncertainty)
    lines = [["accuracy", "solver", "export", "error", "setting"]]
    for row in (row for row in table if row["quantity"] == main):
        cells = ["-", "-", "-"]
        setting = row.get("setting", "no run reaches it")
        if "setting" in row:
            cells = [f"{row['seconds_solver']:.2f} s", f"{row['seconds_export']:.2f} s",
                     percent(row["error"])]
        elif reference.uncertainty > row["accuracy"] / 2:
            setting = f"no run can be shown to reach it: the reference is good to {good}"
        lines.append([percent(row["accuracy"]), *cells, setting])
    others = [["seconds of the solver for", *map(percent, LEVELS), "reference good to", "source"]]
    for name, known_value in known.items():
        cells = [f"{row['seconds_solver']:.2f}" if "setting" in row else "-"
                 for row in table if row["quantity"] == name]
        others.append([words(name), *cells, percent(known_value.uncertainty), known_value.source])
    title = (f"{words(main)}: {reference.value:.5g} {unit(main, units)} ({reference.source}, "
             f"itself good to {good})")
    return f"\n{title}\n{aligned(lines, 'lrrrl')}\n\n{aligned(others, 'lrrrrrrl')}"
