"""What each accuracy takes: trusted errors, the Pareto front, the cheapest settings, and their tables."""

import math
import statistics

from ...estimates.budget import unit
from .reference import Reference
from .trial import Trial, percent, words

LEVELS = (0.1, 0.05, 0.02, 0.01, 0.001)
WORTH = 0.9  # a trial of the front has at most so much of the error of the one before
RUN_COLUMNS = ("knob", "value", "setting", "primal_dofs", "dual_dofs", "dual_multiplications", "reason", "energy_estimate",
               "seconds_solver", "seconds_solver_least", "seconds_solver_most", "seconds_export", "seconds_export_least",
               "seconds_export_most", "repeats")
BARGAIN_COLUMNS = ("quantity", "accuracy", "seconds_solver", "seconds_export", "error", "setting")


def sure(trials: list[Trial], reference: Reference, name: str) -> dict[int, float]:
    """By id of every trial with a result the error it can be trusted with: the largest of its own and all tighter ones'.

    Errors of mesh and time may cancel at one setting by accident; they do not at all that are tighter. The error is
    never below that of the reference, where runs cannot be told apart.
    """
    error = {id(t): reference.relative(t.values[name] - reference.value) for t in trials if t.values}
    done = [t for t in trials if t.values]
    return {id(t): max(reference.uncertainty, *(error[id(u)] for u in done if u.tighter(t))) for t in done}


def front(trials: list[Trial], error: dict[int, float]) -> list[Trial]:
    """Trials that no other beats in both seconds and the errors of `sure` (Pareto), fast ones first."""
    best, found = math.inf, []
    for trial in sorted((t for t in trials if t.values), key=lambda t: t.seconds):
        if error[id(trial)] < WORTH * best:
            best = error[id(trial)]
            found.append(trial)
    return found


def bargain(trials: list[Trial], error: dict[int, float], level: float) -> Trial | None:
    """The cheapest trial whose error, one of `sure`, is below `level`."""
    return min((t for t in trials if t.values and error[id(t)] <= level), key=lambda t: t.seconds, default=None)


def rows(trials: list[Trial], known: dict[str, Reference]) -> list[dict]:
    """One row a trial. `error` is relative to the reference, `sure` see there, `own` what its knob alone has of it."""
    trusted = {name: sure(trials, reference, name) for name, reference in known.items()}
    fronts = {name: front(trials, trusted[name]) for name in known}
    found = []
    for trial in trials:
        row = {"knob": trial.knob, "value": trial.value, "setting": trial.words, "reason": trial.reason,
               "energy_estimate": trial.energy, "repeats": len(trial.solver), **trial.sizes}
        for stage in ("solver", "export") if trial.values else ():
            spent = getattr(trial, stage)
            row |= {f"seconds_{stage}": statistics.median(spent), f"seconds_{stage}_least": min(spent),
                    f"seconds_{stage}_most": max(spent)}
        for name, reference in known.items() if trial.values else ():
            value = trial.values[name]
            row |= {name: value, f"{name}_error": reference.relative(value - reference.value),
                    f"{name}_sure": trusted[name][id(trial)],
                    f"{name}_own": trial.tight and reference.relative(value - trial.tight.values[name]),
                    f"{name}_front": int(trial in fronts[name])}
        found.append(row)
    return found


def bargains(trials: list[Trial], known: dict[str, Reference]) -> list[dict]:
    """One row for every quantity and level: the setting that reaches it in the least time, if one does."""
    found = []
    for name, reference in known.items():
        error = sure(trials, reference, name)
        for level in LEVELS:
            trial = bargain(trials, error, level)
            row = {"quantity": name, "accuracy": level}
            if trial:
                row |= {"seconds_solver": trial.seconds, "seconds_export": statistics.median(trial.export),
                        "error": error[id(trial)], "setting": trial.words}
            found.append(row)
    return found


def describe(table: list[dict], known: dict[str, Reference], units: dict, main: str) -> str:
    """The bargains as people read them: the main quantity in full, of the others the seconds."""
    reference = known[main]
    lines = ["", f"{words(main)}: {reference.value:.5g} {unit(main, units)} ({reference.source}, itself good to "
             f"{percent(reference.uncertainty)})", f"{'accuracy':>10s}{'solver':>9s}{'export':>9s}{'error':>9s}  setting"]
    for row in table:
        if row["quantity"] == main:
            cells = ([f"{row['seconds_solver']:.2f} s", f"{row['seconds_export']:.2f} s", percent(row["error"])]
                     if "setting" in row else ["-", "-", "-"])
            why = ("no run is known to reach it, the reference itself is good to " + percent(reference.uncertainty)
                   if reference.uncertainty > row["accuracy"] / 2 else "no run reaches it")
            lines.append(f"{percent(row['accuracy']):>10s}" + "".join(f"{cell:>9s}" for cell in cells)
                         + f"  {row.get('setting', why)}")
    heads = "".join(f"{percent(level):>9s}" for level in LEVELS)
    lines += ["", f"{'seconds of the solver for':26s}{heads}   reference"]
    for name, reference in known.items():
        cells = [f"{row['seconds_solver']:.2f}" if "setting" in row else "-" for row in table if row["quantity"] == name]
        lines.append(f"{words(name):26s}" + "".join(f"{cell:>9s}" for cell in cells)
                     + f"   {reference.source}, good to {percent(reference.uncertainty)}")
    return "\n".join(lines)
