"""Tolerances of a search for settings: tightened, and what they leave of quantities."""

import dataclasses

from ..estimates.budget import Part

TIGHTER = 0.01  # part of the tolerances of runs that they are compared with ...
APART = 0.15  # ... and what it may have become by tightening them
TOLERANCES = ("rtol", "friction_rtol", "primal_rtol")


def tightened(settings, factor: float):
    """Settings with all tolerances multiplied by a factor."""
    return dataclasses.replace(settings, **{name: max(1e-10, factor * getattr(settings, name))
                                            for name in TOLERANCES})


def much_tighter(reference, settings) -> bool:
    """Whether the tolerances of a `reference` leave nothing beside what those of settings leave."""
    return all(getattr(reference, name) <= APART * getattr(settings, name) for name in TOLERANCES)


def left(values, settings, tightest, coulomb: bool) -> tuple[dict, dict]:
    """Parts of the errors by source that tolerances leave, against the `tightest` settings; and
    the quantities of the run with `settings`.

    `values`: function of settings, quantities of the run; `coulomb`: friction has a fixed point.
    """
    tight = dataclasses.replace(tightest, friction_rtol=settings.friction_rtol)
    plain, exact = values(settings), values(tight)
    parts = {"solver": {name: Part(abs(plain[name] - exact[name])) for name in plain}}
    if coulomb:
        final = values(tightest)
        parts["friction"] = {name: Part(abs(exact[name] - final[name])) for name in plain}
    return parts, plain


def scaled(parts: dict[str, dict[str, Part]], factor: float) -> dict[str, dict[str, Part]]:
    """Parts multiplied by a factor."""
    return {source: {name: Part(factor * part.error) for name, part in own.items()}
            for source, own in parts.items()}
