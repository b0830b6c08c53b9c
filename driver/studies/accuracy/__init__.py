"""make accuracy: which error of a scene comes from which setting, and what each digit takes.

`sweeps` plans and runs, `reference` says what the quantities are, `cheapest` judges the runs. Some
more parts have scenes of their own: `locking`, elements near incompressibility, `curved`, sides of
elements that follow curved boundaries, `stopping`, tolerances from the error budget, `coverage`,
whether claimed errors hold, `prices`, whether what the next digit is said to take holds,
`requests`, whether ACCURACY keeps its word, and `handpicked`, what it takes over settings by hand.
"""

from pathlib import Path

from ... import environment, options
from ...errors import InputError
from ...runs.guard import study_folder

UNREAD = {"sweeps": ("rows",), "locking": ("rows", "scene"), "curved": ("rows", "scene"),
          "stopping": ("scene",), "coverage": ("rows",), "prices": ("rows",), "requests": ("rows",),
          "handpicked": ("rows",)}


def run_accuracy(pairs: dict[str, str]) -> list[Path]:
    """Run the part of the study that the option PART names; returns the files written.

    Raises InputError for mistaken options, and what its runs raise.
    """
    given = options.read("accuracy", pairs)
    part = given["part"]
    for name in pairs:
        if name in UNREAD[part] or part != "sweeps" and name not in ("part", "out", "rows",
                                                                          "scene"):
            raise InputError(f"PART={part} does not read {name.upper()}")
    if part == "sweeps":
        from .sweeps import run_sweeps

        return run_sweeps(pairs)
    out = study_folder(given["out"] or options.RESULTS / "accuracy" / part, "accuracy")
    if part == "coverage":
        from .coverage import run_coverage

        return run_coverage(out, given["scene"])
    if part == "prices":
        from .prices import run_prices

        return run_prices(out, given["scene"])
    if part == "requests":
        from .requests import run_requests

        return run_requests(out, given["scene"])
    if part == "handpicked":
        from .handpicked import run_handpicked

        return run_handpicked(out, given["scene"])
    if part == "curved":
        from .curved import run_curved

        return run_curved(out)
    environment.start_petsc()
    from .locking import run_locking
    from .stopping import run_stopping

    return run_locking(out) if part == "locking" else run_stopping(given["rows"], out)
