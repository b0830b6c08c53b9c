"""make accuracy: which error of a scene comes from which setting, and what each digit takes.

`sweeps` plans and runs, `reference` says what the quantities are, `cheapest` judges the runs. Some
more parts have scenes of their own: `locking`, elements near incompressibility, `curved`, sides of
elements that follow curved boundaries, `stopping`, tolerances from the error budget, `coverage`,
whether claimed errors hold, `prices`, whether what the next digit is said to take holds,
`requests`, whether ACCURACY keeps its word, and `handpicked`, what it takes over settings by hand.
"""

import importlib
from pathlib import Path

from ... import environment, options
from ...errors import InputError
from ...runs.guard import study_folder

# parts with scenes of their own, each a module with a function run_...: options that they read
READ = {"locking": (), "curved": (), "stopping": ("rows",), "coverage": ("scene",),
        "prices": ("scene",), "requests": ("scene",), "handpicked": ("scene",)}
SOLVING = ("locking", "stopping")  # those that solve in this process


def run_accuracy(pairs: dict[str, str]) -> list[Path]:
    """Run the part of the study that the option PART names; returns the files written.

    Raises InputError for mistaken options, and what its runs raise.
    """
    given = options.read("accuracy", pairs)
    part = given["part"]
    if part == "sweeps":
        if "rows" in pairs:
            raise InputError("PART=sweeps does not read ROWS")
        from .sweeps import run_sweeps

        return run_sweeps(pairs)
    for name in pairs:
        if name not in ("part", "out", *READ[part]):
            known = ", ".join(map(str.upper, ("part", "out", *READ[part])))
            raise InputError(f"PART={part} does not read {name.upper()}; it reads {known}")
    out = study_folder(given["out"] or options.RESULTS / "accuracy" / part, "accuracy")
    if part in SOLVING:
        environment.start_petsc()
    run = getattr(importlib.import_module(f"{__name__}.{part}"), f"run_{part}")
    return run(out, *(given[name] for name in READ[part]))
