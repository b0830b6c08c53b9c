"""make accuracy: which part of the error of a scene comes from which setting, and what each digit
takes.

`sweeps` plans and runs, `reference` says what the quantities are, `cheapest` judges the runs. Two
more parts have scenes of their own: `locking`, elements near incompressibility, and `stopping`,
tolerances from the error budget.
"""

from pathlib import Path

from ... import environment
from ...arguments import choice
from ...runs.run import RESULTS

PARTS = ("sweeps", "locking", "stopping")


def run_accuracy(pairs: dict[str, str]) -> list[Path]:
    """Run the part of the study that the option PART names, `sweeps` by default; returns the files
    written.

    Raises InputError for mistaken options, and what its runs raise.
    """
    options = {name: value for name, value in pairs.items() if name != "part"}
    part = choice(pairs, "part", PARTS, "sweeps")
    if part == "sweeps":
        from .sweeps import run_sweeps

        return run_sweeps(options)
    environment.start_petsc()
    from .locking import run_locking
    from .stopping import run_stopping

    out = Path(options.pop("out", RESULTS / "accuracy" / part))
    out.mkdir(parents=True, exist_ok=True)
    return run_locking(options, out) if part == "locking" else run_stopping(options, out)
