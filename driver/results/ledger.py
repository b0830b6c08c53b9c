"""The effects ledger of a run: what the scene declared, whether it ever mattered, what it cost.

Pure functions of what the run already holds; nothing is solved or measured for it. Seconds are shares of the
time steps' wall time, in proportion to the products with the dual matrix that the effect caused.
"""

import numpy as np

PATTERNS = {"traction": "load", "point_load": "load", "thermal_strain": "thermal"}  # ledger entries of pattern kinds; others go by their own name


def effects_ledger(effects: dict, sizes: dict, patterns: list[dict], amplitudes: np.ndarray, history: list[dict],
                   log: list[tuple], seconds: float, gaps: bool, initial: bool) -> dict:
    """Entry {declared, active, reason, unknowns, seconds} of every effect.

    `effects` as in summary.json; `sizes` its counts of dual rows; `patterns` those of the manifest with
    `largest`, the largest nodal value; `amplitudes` (steps + 1, patterns); `history` the rows of history.csv
    (empty if none were kept: then nothing is said on what was active); `log` the rows of convergence.csv;
    `seconds` of the time steps; `gaps` whether any contact node starts away from its obstacle, `initial`
    whether the body starts displaced.
    """
    spent = _shares(log, seconds)
    ledger = {"contact": _contact(effects, sizes, history, spent["contact"]),
              "friction": _friction(effects, sizes, history, spent["friction"])}
    ledger["gap"] = _entry(gaps, bool(history) and ledger["contact"]["active"] if gaps else False,
                           "some node starts away from, or inside, its obstacle" if gaps else "")
    ledger["time"] = _time(effects, amplitudes, history, ledger["friction"], gaps or initial, spent["history"])
    if initial:
        ledger["initial_state"] = _entry(True, ledger["friction"]["active"], "friction starts from it")
    for kind in ("load", *sorted({"displacement", "body_force"} | {PATTERNS.get(p["kind"], p["kind"]) for p in patterns} - {"load"})):
        mine = [k for k, p in enumerate(patterns) if PATTERNS.get(p["kind"], p["kind"]) == kind]
        ledger[kind] = _pattern(patterns, amplitudes, mine)
    return ledger


def never_mattered(ledger: dict) -> list[str]:
    """One sentence for every effect that is declared and was not active."""
    return [f"{name.replace('_', ' ')} is declared but {entry['reason']}" for name, entry in ledger.items()
            if entry["declared"] and entry["active"] is False]


def _entry(declared: bool, active, reason: str, unknowns: int = 0, seconds=None) -> dict:
    if not declared:
        return {"declared": False, "active": False, "reason": "not declared", "unknowns": 0, "seconds": 0.0}
    return {"declared": True, "active": active, "reason": reason, "unknowns": int(unknowns), "seconds": seconds}


def _most(history: list[dict], *columns) -> int:
    return max((sum(row[c] for c in columns) for row in history), default=0)


def _contact(effects, sizes, history, seconds) -> dict:
    touched = _most(history, "nodes_stick", "nodes_slip")
    active = touched > 0 if history else None
    reason = f"{touched} nodes touched at most" if touched else "nothing touched" if history else "no step was kept"
    return _entry(effects["contact"] != "none", active, reason, sizes["dual_normal"], seconds)


def _friction(effects, sizes, history, seconds) -> dict:
    slipped, stuck = _most(history, "nodes_slip"), _most(history, "nodes_stick")
    active = slipped > 0 if history else None
    reason = (f"{slipped} nodes slipped at most" if slipped else "no step was kept" if not history else
              f"nothing slipped ({stuck} nodes stuck at most)" if stuck else "nothing touched")
    return _entry(effects["friction"] != "none", active, reason, sizes["dual_tangential"], seconds)


def _time(effects, amplitudes, history, friction, offset, seconds) -> dict:
    """History matters where the end of the way depends on the way: with friction, unless loads only grow in
    proportion from nothing, when every step repeats the first one in another size."""
    steps = len(amplitudes) - 1
    if not history:
        active, reason = None, "no step was kept"
    elif steps < 2:
        active, reason = False, "one step was taken"
    elif not friction["declared"] or _most(history, "nodes_stick", "nodes_slip") == 0:
        active, reason = False, "without friction the last step does not depend on those before"
    elif not offset and proportional(amplitudes) and effects["friction"] == "coulomb":
        active, reason = False, "loads grow in proportion: one step gives the same end"
    else:
        active, reason = True, "friction remembers the way to the final load"
    return _entry(effects["time"] == "quasistatic", active, reason, 0, seconds)


def proportional(amplitudes: np.ndarray) -> bool:
    """Do all patterns (columns) grow from zero by one common factor that never falls?"""
    last = amplitudes[-1]
    size = np.abs(last).max(initial=0.0)
    if size == 0:
        return not amplitudes.any()
    factor = amplitudes @ last / (last @ last)
    rest = np.abs(amplitudes - np.outer(factor, last)).max()
    return bool(rest <= 1e-12 * size and abs(factor[0]) <= 1e-12 and np.all(np.diff(factor) >= 0))


def _pattern(patterns, amplitudes, mine) -> dict:
    active = any(amplitudes[:, k].any() and patterns[k]["largest"] > 0 for k in mine)
    return _entry(bool(mine), active, f"{len(mine)} patterns" if active else "is zero at every step")


def _shares(log: list[tuple], seconds: float) -> dict:
    """Seconds of the products that contact, friction and the steps before the last one caused.

    contact: products of expansion and proportioning steps, which bounds alone call for; friction: those of
    the fixed point's iterations after the first; history: those of all steps but the last.
    """
    spent = dict.fromkeys(("contact", "friction", "history"), 0)
    total, before = 0, log[0][0] if log else 0
    last = log[-1][1] if log else 0
    for product, step, iteration, kind, _ in log:
        count, before = max(0, product - before), product
        total += count
        spent["contact"] += count * (kind in ("expansion", "proportioning"))
        spent["friction"] += count * (iteration > 1)
        spent["history"] += count * (step < last)
    return {name: seconds * count / total if total else 0.0 for name, count in spent.items()}
